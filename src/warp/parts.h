/* What a warp keeps of a body that is cut: labels of voxels (part.h), and guests. */
#ifndef PLIANT_WARP_PARTS_H
#define PLIANT_WARP_PARTS_H

#include "pliant/body.h"
#include "warp/part.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The part of a tetrahedron at load that moves with a tetrahedron that is no fragment of it: a chip, or a corner beyond a cut in which no
 * voxel has its centre. It is drawn as one more tetrahedron, which follows its carrier. */
typedef struct part_guest {
    int32_t host, carrier;
    double blend[4][4];   /* its corners, a little further out than the host's, as sums of the carrier's */
    double rest[4][3];    /* of its corners, index in the scan */
} part_guest;

/* Labels of the parts of one body after another: those of a next one are appended, those that it keeps stay where they are. */
typedef struct part_pool {
    int32_t holders;
    size_t room, used;
    uint16_t *at;
} part_pool;

/* The boxes of all tetrahedra at load: the same for all bodies; and which of them have a voxel in a cube of PART_CUBE along each axis. */
enum { PART_CUBE = 16 };
typedef struct part_hosts {
    int32_t holders;
    part_box *box;
    int32_t cubes[3], *cube_start, *of_cube; /* (cubes + 1), ascending in each */
} part_hosts;

/* Elements are the tetrahedra of a body, and after them its guests. */
typedef struct pliant_parts {
    part_view view;            /* its labels are those of pool */
    part_pool *pool;
    part_hosts *hosts;
    int32_t num_boxes;
    int32_t num_labels;        /* of the pool, those in use and those before them */
    size_t live;               /* those in use */
    int32_t *host;             /* (num_boxes) tetrahedron at load, ascending */
    uint8_t *by_node;          /* (num_boxes) labels depend on which nodes tetrahedra have */
    int32_t *taken;            /* (num_boxes) box of the body before that it was taken from; -1: made anew */
    int32_t num_other, *other; /* tetrahedra at load whose boxes of before, Nullable, were not taken, or that have new ones; ascending */
    int32_t *carrier_start, *carrier; /* (num_boxes + 1), by box and label: the tetrahedron that each label stands for */
    int32_t num_guests;
    int32_t *guest_start;      /* (num_boxes + 1) */
    part_guest *guests;        /* by box, then label */
} pliant_parts;

/* Of all bodies of these voxels; one holder. Errors: MEMORY. */
pliant_status pliant_part_hosts_create(const pliant_body *body, const pliant_geometry *scan, part_hosts **out);
void pliant_part_hosts_release(part_hosts *hosts); /* Nullable */

/* Of a body; NULL where nothing is severed. What is the same in a body before, Nullable with its parts, is taken from there. hosts: Nullable: of the
 * body's voxels. Errors: MEMORY, ARGUMENT (voxels of another scan). */
pliant_status pliant_parts_create(const pliant_body *body, const pliant_geometry *scan, const pliant_body *body_before, const pliant_parts *before,
                                  part_hosts *hosts, int num_threads, pliant_parts **out);
/* Of a body whose tetrahedra cuts have subdivided: each draws all that it holds. NULL where none is, and for body NULL. Errors: MEMORY. */
pliant_status pliant_parts_whole(const pliant_body *body, const pliant_geometry *scan, pliant_parts **out);
void pliant_parts_free(pliant_parts *parts); /* Nullable */

/* Whether a box is the same in parts and in those of the body before; both Nullable, and -1 where there is none. */
bool pliant_parts_same(const pliant_parts *before, int32_t box_before, const pliant_parts *now, int32_t box);

/* Corner of a guest, from the positions of its carrier's nodes. */
PLIANT_INLINE void part_guest_corner(const double blend[4], const double *const node[4], double out[3])
{
    PLIANT_UNROLL for (int d = 0; d < 3; d++) out[d] = blend[0] * node[0][d] + blend[1] * node[1][d] + blend[2] * node[2][d] + blend[3] * node[3][d];
}

#ifdef __cplusplus
}
#endif
#endif
