/* What the files that make the surface of a cut body share (surface.c).
 *
 * Tetrahedra at load ("hosts") that are in fragments are refined: edgewise, into n^3 smaller ones (Edelsbrunner and Grayson, Edgewise subdivision
 * of a simplex, Discrete Comput. Geom. 24:707, 2000), whose faces meet those of the next host. Every point of that lattice is of one of the
 * fragments. An edge of the lattice whose ends are of two of them is crossed; where, follows from the voxels around it. The surface between two
 * fragments runs through the crossings, within each small tetrahedron and on each of its faces by the same rule, whoever asks: so it is closed. */
#ifndef PLIANT_BODY_SURFACE_H
#define PLIANT_BODY_SURFACE_H

#include "topology/links.h"
#include "pliant/surface.h"

#include <stdatomic.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    SURFACE_MOST_PARTS = 4,    /* of an edge */
    SURFACE_LATTICE = (SURFACE_MOST_PARTS + 1) * (SURFACE_MOST_PARTS + 1) * (SURFACE_MOST_PARTS + 1),
    SURFACE_SHARE = 12         /* weights in keys are multiples of 1 / (SURFACE_SHARE n): those of points, edges' and triangles' middles */
};

/* A place of the lattice, or the middle of what lies between: nodes with weight, ascending, then zeros. Of nodes at load it says where; of
 * nodes now, also what it moves with. */
typedef struct surface_key { int32_t node[4], weight[4]; } surface_key;

/* Keys, numbered as they come. */
typedef struct surface_map {
    int32_t count, room, num_slots;
    surface_key *key;          /* (count) */
    int32_t *slot;             /* (num_slots) number + 1; 0: free */
} surface_map;

/* Corners of a small tetrahedron in a host: as a key by the host's corners, and where it really lies. */
typedef struct surface_point { int32_t weight[4]; double share[4]; } surface_point;

typedef struct surface_vertex {
    surface_key key;           /* of nodes now */
    int32_t tet;
    double weight[4];          /* of its corners */
    uint16_t material;
} surface_vertex;

/* What one host adds; shared by the surfaces that have it. */
typedef struct surface_block {
    atomic_int holders;
    int32_t host;
    bool split;                /* it is refined */
    int32_t *label;            /* (SURFACE_LATTICE) of the points of its lattice: the fragment; NULL: it is not split */
    int32_t num_vertices, num_outer, num_cut;
    surface_vertex *vertex;
    int32_t *triangle;         /* ((num_outer + num_cut) x 3) vertices; those outside first */
} surface_block;

/* A voxel near an edge of the lattice [m along the scan's axes], on the first side of it (1) or the second (-1). */
typedef struct surface_sample { double at[3], side; } surface_sample;

typedef struct surface_list { void *at; size_t count, room, size; } surface_list;

typedef struct surface_maker {
    const pliant_body *body;
    const pliant_voxels *voxels;
    const pliant_cuts *cuts;
    int parts;                 /* of every edge */
    const int32_t *cut_of;     /* (tetrahedra at load) their place in the cuts, or -1 */
    surface_block *const *block; /* (tetrahedra at load) NULL: none */
    surface_map crossings;     /* edges of the lattice, by nodes at load */
    surface_list where;        /* double: how far along each, from the end with the lower key; < 0: it is not crossed */
    surface_list near;         /* surface_sample */
    /* of the block at work */
    surface_map vertices;      /* by nodes now */
    surface_list made;         /* surface_vertex */
    surface_list triangles[2]; /* int32_t [3]: outside, cut */
} surface_maker;

/* ---- surface_map.c */

/* The number of a key; it is added where it is new. -1: no memory */
int32_t pliant_surface_number(surface_map *map, const surface_key *key);
void pliant_surface_map_clear(surface_map *map);
void pliant_surface_map_free(surface_map *map);
/* One more; NULL: no memory */
void *pliant_surface_add(surface_list *list);
/* of (node, weight) pairs, those without a weight left out */
void pliant_surface_key_of(const int32_t node[4], const int32_t weight[4], surface_key *out);

/* ---- surface_label.c */

static inline int32_t pliant_surface_load_node(const surface_maker *maker, int32_t node) { return maker->body->node_parent ? maker->body->node_parent[node] : node; }

/* place of a point in label; by corners of the host, which together are `parts` */
static inline int32_t pliant_surface_place(const int32_t at[4])
{
    const int32_t x[3] = {at[1] + at[2] + at[3], at[2] + at[3], at[3]};
    return x[0] + (SURFACE_MOST_PARTS + 1) * (x[1] + (SURFACE_MOST_PARTS + 1) * x[2]);
}

/* nodes at load of a host */
void pliant_surface_corners(const surface_maker *maker, int32_t host, int32_t out[4]);
/* whether fragments of a host differ in their nodes */
bool pliant_surface_is_split(const surface_maker *maker, int32_t host);
/* The fragments of a host's points. out: (SURFACE_LATTICE) */
void pliant_surface_find_labels(const surface_maker *maker, int32_t host, int32_t *out);
/* Where an edge of a host's lattice, from a to b in units of the lattice, is crossed, for anybody: how far from a. < 0: it is not; NAN: no memory */
double pliant_surface_crossing(surface_maker *maker, int32_t host, const int32_t a[4], const int32_t b[4]);
/* whether one of the hosts around an edge is split */
bool pliant_surface_is_refined(const surface_maker *maker, int32_t a, int32_t b);
/* the material of the voxel nearest to a point of a fragment */
uint16_t pliant_surface_material(const surface_maker *maker, int32_t host, int32_t fragment, const double share[4]);

/* ---- surface_block.c */

/* The triangles of a host; labels are set of all. Errors: MEMORY. */
pliant_status pliant_surface_fill(surface_maker *maker, surface_block *block);
pliant_status pliant_surface_no_memory(void);

/* ---- surface_flatten.c */

/* Tips on the faces of cuts; there is room for a vertex for each. is_lattice: (num_vertices) a corner of small tetrahedra. Errors: MEMORY. */
pliant_status pliant_surface_flatten(const surface_maker *maker, const uint8_t *is_lattice, pliant_surface *surface);

/* ---- surface_subdivided.c */

/* Of a body whose tetrahedra cuts have subdivided: its triangles, faces of cuts last. triangle has room. Errors: MEMORY. */
pliant_status pliant_surface_part_subdivided(pliant_surface *surface);

#ifdef __cplusplus
}
#endif
#endif
