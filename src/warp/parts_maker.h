/* Shared declarations of the files that compute parts (parts.c). */
#ifndef PLIANT_WARP_PARTS_MAKER_H
#define PLIANT_WARP_PARTS_MAKER_H

#include "topology/body.h"
#include "topology/links.h"
#include "warp/parts.h"

#include <string.h>

/* A growing list; size: bytes per element. */
typedef struct part_list { void *at; size_t count, capacity, size; } part_list;

/* An initial tetrahedron in scan indices: barycentric coordinate v is slope[v] . index + value[v]. */
typedef struct part_shape { double corner[4][3], slope[4][3], value[4]; } part_shape;

/* Result of a maker for one tetrahedron: its range in the maker's lists. */
typedef struct part_made {
    int32_t maker;                 /* -1: no box */
    bool by_node;                  /* see parts.h */
    int32_t carriers, carried_tets;
    size_t labels;
    int32_t num_carriers, num_carried_tets, num_labels;
} part_made;

/* State of one thread. */
typedef struct part_maker {
    const pliant_body *body;
    const pliant_voxels *voxels;
    const pliant_cuts *cuts;
    const pliant_geometry *scan;
    const int32_t *cut_of;         /* (initial tetrahedra) index in the cuts, or -1 */
    /* the current tetrahedron */
    int32_t tet;
    part_shape at;
    part_box box;
    int32_t count, capacity; /* number of voxels in the box, and capacity */
    int32_t *label;          /* (count) -1: none yet */
    /* (count) number of links from a labelled voxel; severed links; corners of touched cells; needs a label from
     * another tetrahedron */
    uint8_t *step, *severed, *touched, *wanted;
    /* (count) whether the box ends there along axis d: bit 2 d backwards, bit 2 d + 1 forwards */
    uint8_t *wall;
    int32_t *queue, *carried;      /* (count) */
    int32_t num_carriers, num_fragments, first_carrier;
    bool by_node;                  /* see parts.h */
    part_list carriers, labels, carried_tets;
} part_maker;

/* Differences between a body and the previous one, in regions of this number of voxels along each axis. */
enum { PART_REGION = 4 };
typedef struct part_changes {
    int32_t regions[3];
    uint8_t *other;                /* (regions) whether links, carriers or nodes differ */
    int32_t low[3], high[3];       /* bounding box of the regions that differ */
    int32_t num_listed, *listed;   /* initial tetrahedra whose list of fragments differs, ascending */
} part_changes;

/* Corners of carried tetrahedra are moved outwards by this fraction of the distance from the centre, so that rounding
 * leaves no gap to adjacent elements. */
#define PART_GROWTH (1.0 / 1024)

/* Return the maximum of slope times index between low and low + size. */
static inline double part_max_on_interval(double slope, double low, double size)
{
    return slope * low + (slope > 0 ? slope * size : 0);
}

static inline void part_place_of(const int32_t size[3], int32_t voxel, int32_t at[3])
{
    at[0] = voxel % size[0];
    at[1] = voxel / size[0] % size[1];
    at[2] = voxel / size[0] / size[1];
}

static inline int32_t part_index_of(const int32_t size[3], const int32_t at[3])
{
    return at[0] + size[0] * (at[1] + size[1] * at[2]);
}

static inline int32_t part_count(const part_box *box) { return box->size[0] * box->size[1] * box->size[2]; }

static inline bool part_same_list(const int32_t *a, int32_t a_count, const int32_t *b, int32_t b_count)
{
    return a_count == b_count && memcmp(a, b, (size_t)a_count * sizeof *a) == 0;
}

static inline int32_t part_load_node(const part_maker *work, int32_t node)
{
    return work->body->node_parent ? work->body->node_parent[node] : node;
}

/* growing_lists.c: reserve capacity; NULL: out of memory */
void *pliant_parts_grow(part_list *list, size_t more);
pliant_status pliant_parts_no_memory(void);

/* label_tet.c: compute the box of one tetrahedron; out->maker is unchanged if there is no box */
pliant_status pliant_parts_make_box(part_maker *work, int32_t tet, const part_box *box, int32_t maker, part_made *out);

/* carried_tets.c: a tetrahedron at rest, and the voxels around it */
void pliant_parts_shape(const part_maker *work, int32_t tet, part_shape *out);
void pliant_parts_box(const part_maker *work, int32_t tet, part_box *out);
/* Return whether a shape, extended as carried tetrahedra are, may touch a box, by its planes.
 * low: lower corner of the box */
bool pliant_parts_touches(const part_shape *at, const double low[3], const double size[3]);
/* Add the carried tetrahedra of the current tetrahedron, by its labels. */
pliant_status pliant_parts_add_carried_tets(part_maker *work);

/* parts_pool.c: labels and boxes that bodies share */
void pliant_part_pool_release(part_pool *pool); /* Nullable */
/* Return a pool with capacity for `more` labels. If the previous pool is full, it is a new one, to which the `live`
 * labels must be copied. */
pliant_status pliant_part_pool_find(const pliant_parts *before, size_t live, size_t more, part_pool **out);

/* parts_compare.c: find the differences to another body
 * out: owned by the caller */
pliant_status pliant_parts_compare(const part_maker *work, const pliant_body *body_before, const part_hosts *hosts,
                                   part_changes *out);
void pliant_part_changes_free(part_changes *changes);
/* Return whether the parts of a tetrahedron that is not listed may differ.
 * @param by_node whether the previous labels depend on nodes */
bool pliant_parts_differ(const part_changes *changes, const part_box *box, bool by_node);
/* Return whether anything in a cube of the hosts differs. */
bool pliant_parts_differ_in(const part_changes *changes, const int32_t cube[3]);

#endif
