/* What the files that make parts share (parts.c). */
#ifndef PLIANT_WARP_PARTS_MAKER_H
#define PLIANT_WARP_PARTS_MAKER_H

#include "topology/links.h"
#include "warp/parts.h"

#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A list that grows; size: of one. */
typedef struct part_list { void *at; size_t count, room, size; } part_list;

/* A tetrahedron at load, in indices of the scan: barycentric coordinate v is slope[v] . index + value[v]. */
typedef struct part_shape { double corner[4][3], slope[4][3], value[4]; } part_shape;

/* What a maker has made for one tetrahedron: where it begins in the lists of that maker. */
typedef struct part_made {
    int32_t maker;                 /* -1: no box */
    bool by_node;                  /* parts.h */
    int32_t carriers, guests;
    size_t labels;
    int32_t num_carriers, num_guests, num_labels;
} part_made;

/* One thread's. */
typedef struct part_maker {
    const pliant_body *body;
    const pliant_voxels *voxels;
    const pliant_cuts *cuts;
    const pliant_geometry *scan;
    const int32_t *cut_of;         /* (tetrahedra at load) their place in the cuts, or -1 */
    /* of the tetrahedron at work */
    int32_t tet;
    part_shape at;
    part_box box;
    int32_t count, room;           /* voxels of the box */
    int32_t *label;                /* (count) -1: none yet */
    uint8_t *step, *severed, *touched, *wanted; /* (count) links away; links that are cut; corners of cells that the tetrahedron touches; of
                                    * another one, and without a label so far */
    uint8_t *wall;                 /* (count) bit 2 d: the box ends there along axis d, going back; bit 2 d + 1: going on */
    int32_t *queue, *carried;      /* (count) */
    int32_t num_carriers, num_fragments, first_carrier;
    bool by_node;                  /* parts.h */
    part_list carriers, labels, guests;
} part_maker;

/* Where a body differs from the one before, by regions of so many voxels along each axis. */
enum { PART_REGION = 4 };
typedef struct part_changes {
    int32_t regions[3];
    uint8_t *other;                /* (regions) of some voxels along each axis: links, carriers or nodes differ there */
    int32_t low[3], high[3];       /* regions that differ lie within */
    int32_t num_listed, *listed;   /* tetrahedra at load whose list of fragments differs, ascending */
} part_changes;

/* Corners of guests lie so much further out, of the way from their middle: where they meet others, rounding leaves no gap. */
#define PART_GROWTH (1.0 / 1024)

/* the most of slope times index between low and low + size */
static inline double part_most(double slope, double low, double size) { return slope * low + (slope > 0 ? slope * size : 0); }

static inline void part_place_of(const int32_t size[3], int32_t voxel, int32_t at[3])
{
    at[0] = voxel % size[0];
    at[1] = voxel / size[0] % size[1];
    at[2] = voxel / size[0] / size[1];
}

static inline int32_t part_index_of(const int32_t size[3], const int32_t at[3]) { return at[0] + size[0] * (at[1] + size[1] * at[2]); }

static inline int32_t part_count(const part_box *box) { return box->size[0] * box->size[1] * box->size[2]; }

static inline bool part_same_list(const int32_t *a, int32_t a_count, const int32_t *b, int32_t b_count)
{
    return a_count == b_count && memcmp(a, b, (size_t)a_count * sizeof *a) == 0;
}

static inline int32_t part_load_node(const part_maker *work, int32_t node) { return work->body->node_parent ? work->body->node_parent[node] : node; }

/* parts_room.c: room for more, NULL: none */
void *pliant_parts_grow(part_list *list, size_t more);
pliant_status pliant_parts_no_memory(void);

/* parts_box.c: of one tetrahedron; out->maker stays as it is where there is no box */
pliant_status pliant_parts_make_box(part_maker *work, int32_t tet, const part_box *box, int32_t maker, part_made *out);

/* parts_guests.c: a tetrahedron at rest, and the voxels around it */
void pliant_parts_shape(const part_maker *work, int32_t tet, part_shape *out);
void pliant_parts_box(const part_maker *work, int32_t tet, part_box *out);
/* whether a shape, grown as guests are, may touch a box from low on; by its planes */
bool pliant_parts_touches(const part_shape *at, const double low[3], const double size[3]);
/* those of the tetrahedron at work, by its labels */
pliant_status pliant_parts_add_guests(part_maker *work);

/* parts_labels.c: labels and boxes that bodies share */
void pliant_part_pool_release(part_pool *pool); /* Nullable */
/* Room for so many more; where there is none, other labels, to which `live` ones are to be copied. */
pliant_status pliant_part_pool_find(const pliant_parts *before, size_t live, size_t more, part_pool **out);

/* parts_before.c: finds where another body differs; out is the caller's to free */
pliant_status pliant_parts_compare(const part_maker *work, const pliant_body *body_before, const part_hosts *hosts, part_changes *out);
void pliant_part_changes_free(part_changes *changes);
/* whether the parts of a tetrahedron that is not listed may be others now; @param by_node: they were by nodes before */
bool pliant_parts_differ(const part_changes *changes, const part_box *box, bool by_node);
/* whether anything in one of the hosts' cubes does */
bool pliant_parts_differ_in(const part_changes *changes, const int32_t cube[3]);

#ifdef __cplusplus
}
#endif
#endif
