/* Data of a warp for cut bodies: voxel labels (part.h) and carried tetrahedra. */
#ifndef PLIANT_WARP_PARTS_H
#define PLIANT_WARP_PARTS_H

#include "pliant/body.h"
#include "warp/part.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Part of an initial tetrahedron that moves with a tetrahedron which is no fragment of it: a chip, or a corner beyond a
 * cut without a voxel centre. It is drawn as an additional tetrahedron that follows its carrier. */
typedef struct part_carried_tet {
    int32_t host, carrier;
    /* its corners as combinations of the carrier's corners, slightly outside the host's corners */
    double blend[4][4];
    double rest[4][3];    /* scan index of its corners */
} part_carried_tet;

/* Labels shared by the parts of successive bodies. New labels are appended, and kept labels do not move. */
typedef struct part_pool {
    int32_t holders;
    size_t capacity, used;
    uint16_t *at;
} part_pool;

/* Boxes of all initial tetrahedra, which are the same for all bodies, and the list of boxes in each cube of PART_CUBE
 * voxels along each axis. */
enum { PART_CUBE = 16 };
typedef struct part_hosts {
    int32_t holders;
    part_box *box;
    int32_t cubes[3], *cube_start, *of_cube; /* (cubes + 1) start of each cube's list, which is ascending */
} part_hosts;

/* Parts of a body. Elements are the tetrahedra followed by the carried tetrahedra. */
typedef struct pliant_parts {
    part_view view;            /* its labels point to the pool */
    part_pool *pool;
    part_hosts *hosts;
    int32_t num_boxes;
    int32_t num_labels;        /* number of labels in the pool, including earlier ones */
    size_t live;               /* number of labels in use */
    int32_t *host;             /* (num_boxes) initial tetrahedron, ascending */
    uint8_t *by_node;          /* (num_boxes) whether labels depend on the nodes of tetrahedra */
    int32_t *taken;            /* (num_boxes) reused box of the previous body; -1: new */
    /* initial tetrahedra, ascending, whose previous box was not reused or which have a new one */
    int32_t num_other, *other;
    int32_t *carrier_start, *carrier; /* (num_boxes + 1) by box and label: tetrahedron of each label */
    int32_t num_carried_tets;
    int32_t *carried_tet_start;     /* (num_boxes + 1) */
    part_carried_tet *carried_tets; /* sorted by box, then label */
} pliant_parts;

/* Compute the boxes of all initial tetrahedra, for all bodies with these voxels. The caller owns one reference. Errors:
 * MEMORY. */
pliant_status pliant_part_hosts_create(const pliant_body *body, const pliant_geometry *scan, part_hosts **out);
void pliant_part_hosts_release(part_hosts *hosts); /* Nullable */

/* Compute the parts of a body; NULL without cuts. Unchanged parts of an earlier body are reused.
 * body_before, before: Nullable
 * hosts: Nullable: computed from the body's voxels
 * Errors: MEMORY, ARGUMENT (voxels of another scan). */
pliant_status pliant_parts_create(const pliant_body *body, const pliant_geometry *scan, const pliant_body *body_before,
                                  const pliant_parts *before, part_hosts *hosts, int num_threads, pliant_parts **out);
/* Compute the parts of a body whose tetrahedra are subdivided by cuts; each draws all that it contains. NULL without
 * cuts, and for a NULL body. Errors: MEMORY. */
pliant_status pliant_parts_whole(const pliant_body *body, const pliant_geometry *scan, pliant_parts **out);
void pliant_parts_free(pliant_parts *parts); /* Nullable */

/* Return whether a box is the same in the parts of two bodies. Both parts are Nullable; box -1: no box. */
bool pliant_parts_same(const pliant_parts *before, int32_t box_before, const pliant_parts *now, int32_t box);

/* Compute a corner of a carried tetrahedron from the positions of its carrier's nodes. */
PLIANT_INLINE void part_carried_tet_corner(const double blend[4], const double *const node[4], double out[3])
{
    PLIANT_UNROLL for (int d = 0; d < 3; d++) out[d] =
        blend[0] * node[0][d] + blend[1] * node[1][d] + blend[2] * node[2][d] + blend[3] * node[3][d];
}

#ifdef __cplusplus
}
#endif
#endif
