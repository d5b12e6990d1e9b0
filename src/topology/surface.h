/* Shared declarations of the files that compute the surface of a cut body (surface.c).
 *
 * Tetrahedra of the initial mesh that consist of fragments ("hosts") are refined by edgewise subdivision into n^3
 * smaller tetrahedra (Edelsbrunner and Grayson, Edgewise subdivision of a simplex, Discrete Comput. Geom. 24:707,
 * 2000). Their faces match the faces of adjacent hosts. Every point of this lattice belongs to one fragment. A lattice
 * edge whose ends belong to two fragments is crossed; the surrounding voxels determine the position. The surface
 * between two fragments connects the crossings. The same rule applies within each small tetrahedron and on each face,
 * for every host, so the surface is closed. */
#ifndef PLIANT_BODY_SURFACE_H
#define PLIANT_BODY_SURFACE_H

#include "topology/links.h"
#include "topology/visible_surface.h"

#include <stdatomic.h>

enum {
    SURFACE_MAX_PARTS = 4, /* maximum number of parts per edge */
    SURFACE_LATTICE = (SURFACE_MAX_PARTS + 1) * (SURFACE_MAX_PARTS + 1) * (SURFACE_MAX_PARTS + 1),
    /* weights in keys are multiples of 1 / (SURFACE_WEIGHT_DIVISOR n), which represents points and the centres of edges
     * and triangles */
    SURFACE_WEIGHT_DIVISOR = 12
};

/* A lattice point or a centre: nodes with their weights, ascending, padded with zeros. With nodes of the initial mesh
 * the key defines the position; with current nodes it also defines the motion. */
typedef struct surface_key { int32_t node[4], weight[4]; } surface_key;

/* Keys in order of insertion. */
typedef struct surface_map {
    int32_t count, capacity, num_slots;
    surface_key *key;          /* (count) */
    int32_t *slot;             /* (num_slots) 1 + number of the key; 0: free */
} surface_map;

/* Point of a small tetrahedron in a host: its key weights and its actual position, both in barycentric coordinates of
 * the host. */
typedef struct surface_point { int32_t weight[4]; double fraction[4]; } surface_point;

typedef struct surface_vertex {
    surface_key key;           /* by current nodes */
    int32_t tet;
    double weight[4];          /* barycentric coordinates in tet */
    uint16_t material;
} surface_vertex;

/* Surface of one host, shared by the surfaces that contain it. */
typedef struct surface_block {
    atomic_int holders;
    int32_t host;
    bool split;                /* whether the host is refined */
    int32_t *label;            /* (SURFACE_LATTICE) fragment of each lattice point; NULL: not split */
    int32_t num_vertices, num_outer, num_cut;
    surface_vertex *vertex;
    int32_t *triangle;         /* ((num_outer + num_cut) x 3) vertices; outer triangles first */
} surface_block;

/* A voxel near a lattice edge [m along the scan's axes], on the first side of the crossing (1) or the second (-1). */
typedef struct surface_sample { double at[3], side; } surface_sample;

typedef struct surface_list { void *at; size_t count, capacity, size; } surface_list;

typedef struct surface_maker {
    const pliant_body *body;
    const pliant_voxels *voxels;
    const pliant_cuts *cuts;
    int parts;                 /* parts per edge */
    const int32_t *cut_of;     /* (initial tetrahedra) index in the cuts, or -1 */
    surface_block *const *block; /* (initial tetrahedra) NULL: none */
    surface_map crossings;     /* lattice edges, by nodes of the initial mesh */
    /* double: position of the crossing from the end with the lower key, as a fraction; < 0: not crossed */
    surface_list where;
    surface_list near;         /* surface_sample */
    /* the current block */
    surface_map vertices;      /* by current nodes */
    surface_list made;         /* surface_vertex */
    surface_list triangles[2]; /* int32_t [3]: outer triangles, faces of cuts */
} surface_maker;

/* ---- surface_map.c */

/* Return the number of a key, which is added if it is new; -1: out of memory. */
int32_t pliant_surface_number(surface_map *map, const surface_key *key);
void pliant_surface_map_clear(surface_map *map);
void pliant_surface_map_free(surface_map *map);
/* Append an element; NULL: out of memory. */
void *pliant_surface_add(surface_list *list);
/* Build a key from (node, weight) pairs; zero weights are omitted. */
void pliant_surface_key_of(const int32_t node[4], const int32_t weight[4], surface_key *out);

/* ---- surface_label.c */

static inline int32_t pliant_surface_load_node(const surface_maker *maker, int32_t node)
{
    return maker->body->node_parent ? maker->body->node_parent[node] : node;
}

/* Return the index of a lattice point in label.
 * at: coordinates with a sum of `parts` */
static inline int32_t pliant_surface_place(const int32_t at[4])
{
    const int32_t x[3] = {at[1] + at[2] + at[3], at[2] + at[3], at[3]};
    return x[0] + (SURFACE_MAX_PARTS + 1) * (x[1] + (SURFACE_MAX_PARTS + 1) * x[2]);
}

/* Return the initial nodes of a host. */
void pliant_surface_corners(const surface_maker *maker, int32_t host, int32_t out[4]);
/* Return whether the fragments of a host have different nodes. */
bool pliant_surface_is_split(const surface_maker *maker, int32_t host);
/* Find the fragments of a host's lattice points.
 * out: (SURFACE_LATTICE) */
void pliant_surface_find_labels(const surface_maker *maker, int32_t host, int32_t *out);
/* Return the position of the crossing on a lattice edge, as a fraction from a to b. It is the same for every host that
 * has the edge. < 0: not crossed; NAN: out of memory.
 * a, b: in lattice units */
double pliant_surface_crossing(surface_maker *maker, int32_t host, const int32_t a[4], const int32_t b[4]);
/* Return whether a host around an edge is split. */
bool pliant_surface_is_refined(const surface_maker *maker, int32_t a, int32_t b);
/* Return the material of a fragment's voxel nearest to a point. */
uint16_t pliant_surface_material(const surface_maker *maker, int32_t host, int32_t fragment, const double fraction[4]);

/* ---- surface_block.c */

/* Compute the triangles of a host. The labels of all hosts must be set. Errors: MEMORY. */
pliant_status pliant_surface_fill(surface_maker *maker, surface_block *block);
pliant_status pliant_surface_no_memory(void);

/* ---- surface_flatten.c */

/* Flatten the tips on the faces of cuts. The surface must have capacity for one more vertex per tip.
 * is_lattice: (num_vertices) whether the vertex is a corner of small tetrahedra
 * Errors: MEMORY. */
pliant_status pliant_surface_flatten(const surface_maker *maker, const uint8_t *is_lattice, pliant_surface *surface);

/* ---- surface_subdivided.c */

/* Compute the triangles of a body whose tetrahedra cuts have subdivided, with the faces of cuts last. The triangle
 * array must be allocated. Errors: MEMORY. */
pliant_status pliant_surface_part_subdivided(pliant_surface *surface);

#endif
