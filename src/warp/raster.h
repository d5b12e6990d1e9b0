/* Shared declarations of this folder's rasterizer.
 *
 * Nodes are rounded to a fixed-point grid in the target's index space: integers with `scale` steps per voxel. All
 * further results depend on these integers alone. Whether a voxel centre lies in a tetrahedron is decided exactly, so
 * adjacent tetrahedra agree on their common face, edge or node. There are no holes, and the lowest index gives a unique
 * owner. Two updates with the same integers give the same volume; change detection compares these integers.
 *
 * Exactness: differences of two node coordinates are at most 2^22 steps, so a component of a face normal (a cross
 * product) is at most 2^45. Divided by the scale and rounded down, the plane's value at a voxel is
 *     value(i, j, k) = value(0, 0, 0) + normal . (i, j, k)        [integers]
 * with the same sign as before. Relative to a brick that the plane intersects, these values are below 2^52 and exact in
 * double precision. */
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
    ROWS_AT_ONCE = 4,     /* adjacent rows along j whose intervals are found together */
    MASK_EDGE = 4,        /* number of bricks along each axis in a tetrahedron's brick mask */
    FRACTION_BITS_MIN = 7, FRACTION_BITS_MAX = 16, SPAN_BITS = 22
};

/* The fixed-point grid of a target. */
typedef struct raster_grid {
    pliant_geometry target;
    int32_t bricks[3];
    double low[3], high[3]; /* nodes outside are clamped to these limits [voxels] */
    int32_t fraction_bits;
    double scale;           /* 2^fraction_bits */
    bool mirrored;          /* the target's axes are left-handed */
} raster_grid;

typedef enum raster_kind {
    RASTER_NOTHING, /* inverted, flat, or outside the target */
    RASTER_SAMPLE,
    RASTER_COPY     /* the map takes voxel centres to voxel centres of the scan */
} raster_kind;

/* A tetrahedron prepared for rasterization; depends only on its four fixed-point nodes. */
typedef struct raster_tet {
    double normal[3][4];       /* inward normals of planes 0 to 3, per voxel along i, j, k; integers */
    int64_t value[4];          /* values of the planes at target voxel (0, 0, 0) */
    double factor[4];          /* 1 / |normal along i|; if that is 0, large enough to leave the row on either side */
    double map[4][4]; /* source index = map[0] i + map[1] j + map[2] k + map[3]; the fourth column is padding */
    uint64_t bricks;           /* mask of the MASK_EDGE^3 bricks from low on; unused if it spans more */
    int16_t low[3], high[3];   /* first and last voxel along each axis, inside the target */
    uint8_t kind;              /* raster_kind */
    bool small;                /* plane values anywhere in the target are below 2^51 */
    bool has_parts;               /* whether it contains voxels of other parts (part.h) */
    bool inner;                /* whether it maps so far inside the scan that no index needs clamping */
} raster_tet;

/* The scan, as the inner loops use it. */
typedef struct raster_source {
    const void *voxels;
    pliant_encoding encoding;
    int32_t size[3];
    ptrdiff_t step[3]; /* offset to the next voxel along each axis; 0 along an axis with one voxel */
    ptrdiff_t count;
    union { uint8_t u8; int16_t i16; float f32; } background;
    bool nearest;      /* 8 bit labels: take the nearest voxel's value instead of interpolating */
} raster_source;

/* Map of one tetrahedron relative to one brick and one base voxel of the source. */
typedef struct raster_slot {
    float origin[4], step_i[4], step_j[4], step_k[4]; /* source index at the brick's first voxel, and its steps */
} raster_slot;
typedef struct raster_copy {
    int64_t first, step_i, step_j, step_k;            /* flat source index at the brick's first voxel, and its steps */
} raster_copy;

/* Entry of a row: slot of the owner, and one bit per voxel. The masks of a row are disjoint. */
enum { ENTRY_COPY = 1 << 30, ENTRY_SLOT_SHIFT = 16, ENTRY_SLOT = BRICK_VOXELS - 1, ENTRY_MASK = 0xffff };

/* Buffers of one thread for one brick. Each slot owns at least one voxel, so there are always enough slots. */
typedef struct raster_brick {
    uint64_t owned[BRICK_ROWS / ROWS_AT_ONCE];  /* 16 bits per row */
    int32_t num_free;                           /* number of voxels without owner */
    uint8_t num_entries[BRICK_ROWS];
    /* first entries of all rows, then second entries, ...; the last ones are only written */
    uint32_t entry[BRICK + 1][BRICK_ROWS];
    alignas(64) union { raster_slot sample; raster_copy copy; } slot[BRICK_VOXELS];
    /* base voxel of the source to which slots and limits are relative */
    int32_t base[3];
    float low[3], high[3], last[3];             /* first and last voxel centre; last voxel with a right neighbour */
    ptrdiff_t base_index;                       /* flat index of the base voxel */
    bool inner;                                 /* whether all owners are inner */
    bool all_masked;                            /* treat all voxels as masked */
    /* number of voxels interpolated from their owner's part alone; written after all others */
    int32_t num_masked;
    uint16_t masked[BRICK_VOXELS];              /* 256 k + 16 j + i */
    int32_t masked_by[BRICK_VOXELS];            /* their owners */
} raster_brick;

/* Inner loops, chosen when a warp is created. All sets give bitwise identical results. */
typedef struct raster_kernels {
    /* Find the owners of a brick's voxels and their slots.
     * parts: used if a candidate is at a cut
     * candidates: ascending
     * origin: first voxel of the brick */
    void (*find_owners)(const raster_source *source, const part_view *parts, const raster_tet *tets,
                        const int32_t *candidates, size_t num_candidates, const int32_t origin[3], raster_brick *brick);
    /* Write the voxels of a brick from its entries.
     * out: its first voxel in the target
     * row_step, slice_step: voxels between rows and slices of the target */
    void (*write)(const raster_source *source, const raster_brick *brick, const int32_t extent[3], void *out,
                  ptrdiff_t row_step, ptrdiff_t slice_step);
} raster_kernels;

raster_kernels pliant_raster_kernels_portable(const raster_source *source);
/* false if this machine or the size of this scan does not support them */
bool pliant_raster_kernels_avx2(const raster_source *source, raster_kernels *out);
bool pliant_raster_kernels_avx512(const raster_source *source, raster_kernels *out);

/* sample_portable.c: compute the 16 voxels of one row */
void pliant_raster_row_u8(const raster_source *source, const raster_brick *brick, int32_t row, uint8_t values[BRICK]);

/* prepare_tets.c: false if the target or its tetrahedra are too large for the fixed-point grid */
bool pliant_raster_grid(const pliant_geometry *target, const pliant_mesh *mesh, raster_grid *out);
void pliant_raster_fix(const raster_grid *grid, const double position[3], int32_t fixed[3]);
void pliant_raster_tet(const raster_grid *grid, const raster_source *source, const int32_t *const fixed[4],
                       const double *const rest[4], raster_tet *out);
/* Return whether a tetrahedron may contain a voxel of a brick, by its planes alone. */
bool pliant_raster_cuts(const raster_tet *tet, const int32_t brick[3]);
/* Find the bricks in its box; return whether its mask covers them. */
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

/* rasterize_parts.c: write the masked voxels of a brick
 * out, row_step, slice_step: as for write */
void pliant_raster_write_masked(const raster_source *source, const part_view *parts, const raster_tet *tets,
                                const int32_t origin[3], const raster_brick *brick, void *out, ptrdiff_t row_step,
                                ptrdiff_t slice_step);

/* warp.c: the fine mesh and the constant target, for picking */
const pliant_mesh *pliant_warp_mesh(const pliant_warp *warp);
const pliant_geometry *pliant_warp_geometry(const pliant_warp *warp);
/* Find the first threshold crossing at sample `first` or later where the volume was drawn; the sample before it counts
 * as above. Return false if the volume is on the host or its backend failed. */
bool pliant_warp_cross(const pliant_warp *warp, const march_ray *ray, int64_t first, march_crossing *out);

/* warp.c, for tests: use other inner loops; false if they are not supported */
typedef enum raster_set { RASTER_PORTABLE, RASTER_AVX2, RASTER_AVX512 } raster_set;
bool pliant_warp_use(pliant_warp *warp, raster_set set);

#ifdef __cplusplus
}
#endif
#endif
