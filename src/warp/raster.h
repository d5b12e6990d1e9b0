/* What the files of this folder share.
 *
 * Nodes are put on a fixed-point grid in the target's index space: integers, `scale` steps to a voxel. All that
 * follows is a function of those integers alone, and whether a voxel centre lies in a tetrahedron is decided exactly,
 * so neighbours agree on the face, edge or node they share: no hole, and with "lowest index first" one owner. Two
 * updates with the same integers have the same volume, which is also what change detection compares.
 *
 * Exactness: differences of two coordinates of a node are at most 2^22 steps, so a component of a face normal (a
 * cross product) is at most 2^45. Divided by the scale and rounded down, the plane's value at a voxel is
 *     value(i, j, k) = value(0, 0, 0) + normal . (i, j, k)        [integers]
 * with the same sign as before. Relative to a brick that the plane cuts these are below 2^52: exact in double.
 */
#ifndef PLIANT_WARP_RASTER_H
#define PLIANT_WARP_RASTER_H

#include "scan/march.h"
#include "pliant/warp.h"
#include "warp/part.h"

#include <stdalign.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    BRICK = PLIANT_BRICK_SIZE,
    BRICK_ROWS = BRICK * BRICK,
    BRICK_VOXELS = BRICK * BRICK * BRICK,
    ROWS_AT_ONCE = 4,     /* rows whose intervals are found together, neighbours along j */
    MASK_EDGE = 4,        /* a tetrahedron's brick mask covers so many bricks along each axis */
    FRACTION_BITS_MIN = 7, FRACTION_BITS_MAX = 16, SPAN_BITS = 22
};

/* The fixed-point grid of a target. */
typedef struct raster_grid {
    pliant_geometry target;
    int32_t bricks[3];
    double low[3], high[3]; /* nodes further out are moved here [voxels] */
    int32_t fraction_bits;
    double scale;           /* 2^fraction_bits */
    bool mirrored;          /* the target's axes are left-handed */
} raster_grid;

typedef enum raster_kind {
    RASTER_NOTHING, /* inverted, flat, or beside the target */
    RASTER_SAMPLE,
    RASTER_COPY     /* the map takes voxel centres to voxel centres of the scan */
} raster_kind;

/* A tetrahedron ready to be rasterized: a function of its four fixed-point nodes. */
typedef struct raster_tet {
    double normal[3][4];       /* of plane 0 to 3, inward, per voxel along i, j, k; integers */
    int64_t value[4];          /* of the planes at target voxel (0, 0, 0) */
    double factor[4];          /* 1 / |normal along i|; where that is 0, enough to leave the row on either side */
    double map[4][4]; /* source index = map[0] i + map[1] j + map[2] k + map[3]; the fourth column is padding */
    uint64_t bricks;           /* of the MASK_EDGE^3 bricks from low on; not used when it spans more */
    int16_t low[3], high[3];   /* first and last voxel along each axis, inside the target */
    uint8_t kind;              /* raster_kind */
    bool small;                /* values of its planes anywhere in the target are below 2^51 */
    bool parted;               /* not all that it holds is its own (part.h) */
    bool inner;                /* all it maps to lies so far inside the scan that no index needs a limit */
} raster_tet;

/* The scan, as the row loops see it. */
typedef struct raster_source {
    const void *voxels;
    pliant_encoding encoding;
    int32_t size[3];
    ptrdiff_t step[3]; /* voxels from one to the next along each axis; 0 along an axis of one voxel */
    ptrdiff_t count;
    union { uint8_t u8; int16_t i16; float f32; } background;
    bool nearest;      /* of 8 bits: the nearest voxel's value, in place of an interpolated one */
} raster_source;

/* The map of one tetrahedron relative to one brick and one corner of the source. */
typedef struct raster_slot {
    float origin[4], step_i[4], step_j[4], step_k[4]; /* source index at the brick's first voxel, and its steps */
} raster_slot;
typedef struct raster_copy {
    int64_t first, step_i, step_j, step_k;            /* flat source index, likewise */
} raster_copy;

/* Who owns which voxel of a row: slot, and one bit per voxel. The masks of a row are disjoint. */
enum { ENTRY_COPY = 1 << 30, ENTRY_SLOT_SHIFT = 16, ENTRY_SLOT = BRICK_VOXELS - 1, ENTRY_MASK = 0xffff };

/* Scratch of one thread, for one brick at a time. Each slot owns at least one voxel, so slots cannot run out. */
typedef struct raster_brick {
    uint64_t owned[BRICK_ROWS / ROWS_AT_ONCE];  /* 16 bits a row */
    int32_t num_free;                           /* voxels without owner */
    uint8_t num_entries[BRICK_ROWS];
    uint32_t entry[BRICK + 1][BRICK_ROWS];      /* first ones of all rows, second ones ...; the last are only written */
    alignas(64) union { raster_slot sample; raster_copy copy; } slot[BRICK_VOXELS];
    /* where slots are relative to: source voxel `base`; limits are relative to it too */
    int32_t base[3];
    float low[3], high[3], last[3];             /* first and last voxel centre; last voxel with a right neighbour */
    ptrdiff_t base_index;                       /* flat index of base */
    bool inner;                                 /* so are all its owners */
    bool all_masked;                            /* as if all were */
    int32_t num_masked;                         /* voxels that are interpolated from an owner's voxels alone: written again, after all others */
    uint16_t masked[BRICK_VOXELS];              /* 256 k + 16 j + i */
    int32_t masked_by[BRICK_VOXELS];            /* their owners */
} raster_brick;

/* Inner loops, chosen when a warp is made. All sets give the same bits. */
typedef struct raster_kernels {
    /* Owners of a brick's voxels, from candidates in ascending order, and their slots. parts: where any is parted. origin: of the brick */
    void (*find_owners)(const raster_source *source, const part_view *parts, const raster_tet *tets, const int32_t *candidates,
                        size_t num_candidates, const int32_t origin[3], raster_brick *brick);
    /* Voxels of a brick from its entries. out: its first voxel in the target; row_step, slice_step: voxels between rows
     * and slices of the target. */
    void (*write)(const raster_source *source, const raster_brick *brick, const int32_t extent[3], void *out,
                  ptrdiff_t row_step, ptrdiff_t slice_step);
} raster_kernels;

raster_kernels pliant_raster_kernels_portable(const raster_source *source);
/* false when this machine or this scan (too small, too large) cannot use them */
bool pliant_raster_kernels_avx2(const raster_source *source, raster_kernels *out);
bool pliant_raster_kernels_avx512(const raster_source *source, raster_kernels *out);

/* sample_portable.c: the 16 voxels of one row */
void pliant_raster_row_u8(const raster_source *source, const raster_brick *brick, int32_t row, uint8_t values[BRICK]);

/* fixed_point.c: false when the target or its tetrahedra are too large for the fixed-point grid */
bool pliant_raster_grid(const pliant_geometry *target, const pliant_mesh *mesh, raster_grid *out);
void pliant_raster_fix(const raster_grid *grid, const double position[3], int32_t fixed[3]);
void pliant_raster_tet(const raster_grid *grid, const raster_source *source, const int32_t *const fixed[4],
                       const double *const rest[4], raster_tet *out);
/* whether a tetrahedron may hold a voxel of a brick, by its planes alone */
bool pliant_raster_cuts(const raster_tet *tet, const int32_t brick[3]);
/* bricks in its box; whether its mask covers them */
static inline bool raster_range(const raster_tet *tet, int32_t low[3], int32_t high[3])
{
    bool covered = true;
    for (int d = 0; d < 3; d++) {
        low[d] = tet->low[d] / BRICK;
        high[d] = tet->high[d] / BRICK;
        covered &= high[d] - low[d] < MASK_EDGE;
    }
    return covered;
}
static inline int32_t raster_lowest_bit(uint64_t bits)
{
#if defined(__GNUC__)
    return __builtin_ctzll(bits);
#else
    int32_t bit = 0;
    while (!(bits >> bit & 1)) bit++;
    return bit;
#endif
}

/* rasterize.c: nobody owns a voxel of a brick, of this extent inside the target */
void pliant_raster_clear(const int32_t extent[3], raster_brick *brick);

/* rasterize_parts.c: the masked voxels of a brick; out, row_step, slice_step: as of write */
void pliant_raster_write_masked(const raster_source *source, const part_view *parts, const raster_tet *tets, const int32_t origin[3],
                                const raster_brick *brick, void *out, ptrdiff_t row_step, ptrdiff_t slice_step);

/* rasterize.c: all voxels of one brick of `out` from its candidates, lowest index first */
void pliant_raster_brick(const raster_grid *grid, const raster_source *source, const part_view *parts, const raster_kernels *kernels,
                         const raster_tet *tets, const int32_t *candidates, size_t num_candidates,
                         const int32_t brick[3], raster_brick *scratch, void *out);

/* warp.c, for picks: the fine mesh and the target, which stay what they are */
const pliant_mesh *pliant_warp_mesh(const pliant_warp *warp);
const pliant_geometry *pliant_warp_geometry(const pliant_warp *warp);
/* The first crossing at this sample or after it, found where the volume was drawn; the sample before it counts as above. false:
 * the volume is on the host, or its backend could not say. */
bool pliant_warp_cross(const pliant_warp *warp, const march_ray *ray, int64_t first, march_crossing *out);

/* warp.c, for tests: other inner loops from now on; false when they cannot be used here */
typedef enum raster_set { RASTER_PORTABLE, RASTER_AVX2, RASTER_AVX512 } raster_set;
bool pliant_warp_use(pliant_warp *warp, raster_set set);

#ifdef __cplusplus
}
#endif
#endif
