/* What the files that make parts share (parts.c). */
#ifndef PLIANT_WARP_PARTS_MAKER_H
#define PLIANT_WARP_PARTS_MAKER_H

#include "body/links.h"
#include "warp/parts.h"

#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A list that grows; size: of one. */
typedef struct part_list { void *at; size_t count, room, size; } part_list;

/* A tetrahedron at load, in indices of the scan: barycentric coordinate v is slope[v] . index + value[v]. */
typedef struct part_shape { double corner[4][3], slope[4][3], value[4]; } part_shape;

typedef struct part_maker {
    const pliant_body *body;
    const pliant_voxels *voxels;
    const pliant_cuts *cuts;
    const pliant_geometry *scan;
    int32_t *cut_of;               /* (tetrahedra at load) their place in the cuts, or -1 */
    uint8_t *near;                 /* (likewise) in the cuts, or shares a node with one that is */
    /* of the tetrahedron at work */
    int32_t tet;
    part_shape at;
    part_box box;
    int32_t count, room;           /* voxels of the box */
    int32_t *label;                /* (count) -1: none yet */
    uint8_t *step, *severed, *touched, *wanted; /* (count) links away; links that are cut; corners of cells that the tetrahedron touches; of
                                    * another one, and without a label so far */
    int32_t *queue, *carried;      /* (count) */
    int32_t num_carriers, num_fragments, first_carrier;
    /* what a body before has of it, where `other` says that nothing differs; NULL: nothing */
    const pliant_body *body_before;
    const pliant_parts *before;
    int32_t guest_before;          /* the first of it that is no earlier host's */
    int32_t regions[3];
    uint8_t *other;                /* (regions) of some voxels along each axis: links, carriers or nodes differ there */
    bool by_node;                  /* parts.h, of the tetrahedron at work */
    part_list carriers, labels, boxes, hosts, by_nodes, taken, starts, guests;
} part_maker;

static inline void part_place_of(const int32_t size[3], int32_t voxel, int32_t at[3])
{
    at[0] = voxel % size[0];
    at[1] = voxel / size[0] % size[1];
    at[2] = voxel / size[0] / size[1];
}

static inline int32_t part_index_of(const int32_t size[3], const int32_t at[3]) { return at[0] + size[0] * (at[1] + size[1] * at[2]); }

static inline bool part_same_list(const int32_t *a, int32_t a_count, const int32_t *b, int32_t b_count)
{
    return a_count == b_count && memcmp(a, b, (size_t)a_count * sizeof *a) == 0;
}

/* parts.c: room for more, NULL: none; a box and its labels likewise, of the carriers from first_carrier on. taken: parts.h */
void *pliant_parts_grow(part_list *list, size_t more);
uint16_t *pliant_parts_add_box(part_maker *work, int32_t tet, const part_box *box, size_t count, bool by_node, int32_t taken);
pliant_status pliant_parts_no_memory(void);

/* parts_guests.c: a tetrahedron at rest, and the voxels around it */
void pliant_parts_shape(const part_maker *work, int32_t tet, part_shape *out);
void pliant_parts_box(const part_maker *work, const part_shape *at, part_box *out);
/* whether a shape, grown as guests are, may touch a box from low on; by its planes */
bool pliant_parts_touches(const part_shape *at, const double low[3], const double size[3]);
/* those of the tetrahedron at work, by its labels */
pliant_status pliant_parts_add_guests(part_maker *work);

/* parts_before.c: finds where another body, Nullable with its parts, differs */
pliant_status pliant_parts_compare(part_maker *work, const pliant_body *body_before, const pliant_parts *before);
/* The box of a tetrahedron as it was before, or that it had none; false: it may be another one now. */
bool pliant_parts_take_before(part_maker *work, int32_t tet, pliant_status *status);

#ifdef __cplusplus
}
#endif
#endif
