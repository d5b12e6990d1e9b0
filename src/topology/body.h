/* The topology of tissue that cuts change: voxels and their links, fragments and pieces. Also the construction of the
 * next body. */
#ifndef PLIANT_TOPOLOGY_BODY_H
#define PLIANT_TOPOLOGY_BODY_H

#include "base/export.h"
#include "pliant/body.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The connectivity of voxels at load, the finest level of a body. It exists only if the scene may cut
 * (pliant_voxels_create). It is constant, and all bodies of a load share it by reference counting. A fragment of a fine
 * tetrahedron is a set of its voxels.
 *
 * A link joins neighbours along an axis, unless it is severed (pliant_cuts). Neighbours across an edge are joined if
 * one of the two paths over links through a voxel with an owner is intact. Bridges join what these links leave
 * unconnected: within an uncut tetrahedron, across a face, and at a node of tetrahedra without a common face. */
struct pliant_voxels {
    pliant_geometry geometry;
    int32_t num_tets, num_nodes; /* of the fine mesh at load */
    int32_t *owner;            /* (voxels) the tetrahedron at load that owns it, ties to the central one; -1: none */
    int32_t *start, *voxel;    /* (num_tets + 1), (voxels with an owner): by tetrahedron, ascending */
    uint8_t *material;         /* (voxels with an owner, in this order) index into of_material */
    int32_t num_materials;
    pliant_tet_material *of_material; /* (num_materials) of a single voxel */
    uint8_t *fixed_material;   /* (num_materials) does not move */
    pliant_tet_material *load; /* (num_tets) of the tetrahedra at load */
    int32_t num_bridges;
    int32_t *bridge;           /* (num_bridges x 2) voxels; bridges within a tetrahedron first, by tetrahedron */
    int32_t *bridge_start;     /* (num_tets + 1) index into the bridges within tetrahedra */
    int32_t *adjacent_start, *adjacent; /* (num_tets + 1), the other bridges of every tetrahedron, ascending */
    int32_t *across;           /* (num_tets x 4) the tetrahedron across each face at load (pliant_mesh_neighbours) */
    /* (num_nodes + 1), (4 x num_tets) for each node the corners of tetrahedra at load: 4 tetrahedron + corner */
    int32_t *around_start, *around;
    struct pliant_voxels_holders *holders; /* reference count (src/topology) */
};

/* The severed links since load, and the resulting fragments. NULL in a body without severed links. */
struct pliant_cuts {
    int32_t num_links;
    uint32_t *link;            /* (num_links) 4 voxel + axis: to the next voxel along the axis; ascending */
    int32_t num_bridges;
    int32_t *bridge;           /* (num_bridges) index into pliant_voxels.bridge; ascending */
    /* tetrahedra at load that own an end of a severed link, or a voxel that moves with one of them */
    int32_t num_tets;
    int32_t *tet;              /* (num_tets) ascending */
    /* (num_tets + 1), (start[num_tets]) the fine tetrahedra that replace each one, ascending; the first is the
     * tetrahedron itself */
    int32_t *start, *fragment;
    int32_t *voxel_start;      /* (num_tets) first entry of each in voxel_fragment */
    /* (voxels of each, in the order of pliant_voxels) the fine tetrahedron that each voxel moves with: a fragment of
     * its own tetrahedron or, for a chip without other links, of another one */
    int32_t *voxel_fragment;
    /* storage of voxel_fragment, shared with earlier and later bodies (src/topology); NULL: num_tets is 0 */
    struct pliant_cuts_pool *pool;
    int32_t num_chips;
    /* (num_chips x 2) tetrahedron at load, and the fine tetrahedron of another parent that carries some of its
     * voxels */
    int32_t *chip;
    int32_t num_joins;
    /* (num_joins x 2) fine tetrahedra that links or bridges join, the lower one first, at least one of them in
     * `fragment`; ascending */
    int32_t *join;
    int32_t num_cuts;          /* number of cuts since load, which pliant_body_sever can repeat */
    int32_t *cut_end;          /* (num_cuts) end of each cut's entries in `severed` */
    uint32_t *stroke;          /* (num_cuts x 2) blade and stroke of each cut's sweep; stroke 0: none */
    /* (num_links + num_bridges) for each cut: 4 voxel + axis of its links, ascending, and 4 bridge + 3 of its
     * bridges */
    uint32_t *severed;
    int32_t num_pieces;        /* pieces with tissue; one common node connects a piece */
};

/* The position of a node that a cut has put on an edge: end[0] + share (end[1] - end[0]), at rest and in the initial
 * state. Both ends have lower numbers. For a copy: its source, and a node on its side of the cut. */
typedef struct pliant_between {
    int32_t end[2];
    double fraction;
} pliant_between;

/* A node on the surface of a blade's stroke that may continue. */
typedef struct pliant_cut_mark {
    uint32_t blade, stroke;
    int32_t node;
    bool passed; /* whether the blade has passed it; otherwise it is ahead of or next to the blade */
} pliant_cut_mark;

/* Maximum distance of a copy from its source, over min_edge. Nodes on edges are farther from both ends. */
#define PLIANT_COPY_DISTANCE 0.98

/* Data of a body whose tetrahedra cuts subdivide (cut/kind: subdivide). Each new tetrahedron owns its whole
 * interior. */
struct pliant_subdivision {
    int32_t load_nodes;      /* nodes at load */
    double min_edge;         /* minimum length of the parts of an edge that a cut makes [m] */
    double min_height;       /* minimum height of a tetrahedron that a cut makes [m] */
    double min_volume;       /* minimum volume of a tetrahedron that a cut makes [m^3] */
    double kerf;             /* maximum distance between the sides of a cut at rest [m] */
    pliant_geometry scan;    /* the voxels over which the severed area is summed */
    bool is_empty[PLIANT_MAX_MATERIALS + 1]; /* by material of a voxel: not tissue */
    pliant_between *between; /* (fine.num_nodes - load_nodes) of the nodes appended since load; NULL: none */
    int32_t num_marks;
    pliant_cut_mark *mark;     /* (num_marks) the last stroke of every blade */
};

/* Pieces detached since load: no fixed tissue holds them. Pieces with a common node count as one. */
struct pliant_pieces {
    int32_t count;
    /* (count + 1), (start[count]) fine nodes of each, ascending; no other piece or tissue has them */
    int32_t *start, *node;
    int32_t num_joints;        /* joints that connect a piece by one or two nodes */
    int32_t num_inner;         /* after those: joints within one piece, between parts that were detached together */
    /* ((num_joints + num_inner) x 2) a node of the piece, and the node that holds it; twice the same node: its rest
     * position holds it */
    int32_t *joint;
};

/* Create an empty body of a revision, with one reference. Errors: MEMORY. */
pliant_status pliant_body_create(uint64_t revision, pliant_body **out);

/* Create the next body as a copy with the same topology. Its creator may change it before anyone else holds a
 * reference.
 *   @param revision a simulation's last_revision + 1
 * Errors: MEMORY, ARGUMENT (not above this one's). */
pliant_status pliant_body_next(const pliant_body *body, uint64_t revision, pliant_body **out);

/* Return whether a scene may cut this body. */
bool pliant_body_is_cuttable(const pliant_body *body);

/* The effect of a cut on the fine mesh. Elements keep their shape, except with subdivision. Copies of a node have its
 * position. */
typedef struct pliant_division {
    int32_t num_tets;          /* of the next body: the previous tetrahedra and appended fragments */
    /* (appended tetrahedra) source tetrahedron of the previous body; NULL: none are appended */
    const int32_t *tet_source;
    int32_t num_changed;
    /* (num_changed) ascending tetrahedra of the previous body: corners and material list only these and then the
     * appended ones; NULL: all of them */
    const int32_t *changed;
    /* (listed tetrahedra x 4) node of every corner: a node of the previous body, or a copy, numbered from its end on.
     * Every node keeps at least one corner */
    const int32_t *corners;
    /* (listed tetrahedra) means over the whole tetrahedron of the fragment's material; NULL: unchanged, no fragments */
    const pliant_tet_material *material;
    const uint8_t *copy_fixed; /* (appended nodes) pliant_fixing; NULL: as their sources */
    /* (appended nodes) with subdivision: corners may then be any nodes, and a tetrahedron takes material and state from
     * its source; NULL: all appended nodes are copies */
    const pliant_between *between;
    int32_t num_touched;       /* further tetrahedra of the previous body whose voxels have changed */
    const int32_t *touched;    /* (num_touched) ascending */
    int32_t num_joints;
    /* (num_joints x 2) corners, 4 tetrahedron + corner, of the remaining joints of its pieces; NULL: all joints */
    const int32_t *joint;
    bool same_pieces;          /* no piece is detached, so the search for detached pieces is skipped */
    pliant_cuts *cuts;         /* of the next body, which takes ownership; NULL: unchanged */
} pliant_division;

/* Build the next body: appended nodes and fragments with their sources, masses, fixed nodes and surface. It lists the
 * detached pieces.
 * Errors: MEMORY, ARGUMENT (not a division of this body), FORMAT (faces of three tetrahedra). */
PLIANT_INTERNAL pliant_status pliant_body_divide(const pliant_body *body, uint64_t revision,
                                                 const pliant_division *division, pliant_body **out);

/* Give each node a fourth of the mass of its tetrahedra ([H] 2.1).
 *   @param mass (fine.num_nodes) out [kg] */
void pliant_body_masses(const pliant_body *body, double *mass);

/* The stiffness of pieces without support at load is reduced to this fraction, so that they keep their position in
 * the picture. */
#define PLIANT_LOOSE_STIFFNESS 1e-6

/* Create the voxels of a body at load, with one reference.
 *   @param material_of_voxel (voxels) index into the table
 * Errors: MEMORY, FORMAT, SCENE (more than 2^30 voxels). */
pliant_status pliant_voxels_create(const pliant_body *body, const pliant_geometry *geometry,
                                   const uint8_t *material_of_voxel, const pliant_material_table *table,
                                   const pliant_voxels **out);

/* Add a reference. Return voxels. */
const pliant_voxels *pliant_voxels_retain(const pliant_voxels *voxels);

/* Release a reference. The last release frees the voxels. Nullable. */
void pliant_voxels_release(const pliant_voxels *voxels);

/* Find the connected parts of a tetrahedron's voxels at load, numbered by their first voxels.
 *   @param cuts Nullable
 *   @param part (start[tet + 1] - start[tet]) out: part of each voxel
 * Return the number of parts. */
int32_t pliant_voxels_parts(const pliant_voxels *voxels, const pliant_cuts *cuts, int32_t tet, int32_t *part);

/* Return the fine tetrahedron that a voxel moves with; -1: none.
 *   @param cuts Nullable */
int32_t pliant_voxels_fragment(const pliant_voxels *voxels, const pliant_cuts *cuts, int32_t voxel);

pliant_status pliant_cuts_copy(const pliant_cuts *cuts, pliant_cuts **out); /* Errors: MEMORY */

void pliant_cuts_free(pliant_cuts *cuts); /* Nullable */

/* Return whether two bodies differ in their revision only. */
PLIANT_INTERNAL bool pliant_body_same(const pliant_body *a, const pliant_body *b);

/* For each node and tetrahedron of a body, the source of its state in another body: itself, or the original of a
 * copy. */
typedef struct pliant_body_map {
    int32_t *node, *tet;               /* (of the body `to`) */
    int32_t num_nodes;                 /* of the body `to` */
    int32_t num_same;                  /* number of leading nodes that have the same number in the other body */
    /* (num_nodes) nodes between two nodes of the body `to`; end[0] < 0, or NULL: `node` is the source */
    pliant_between *between;
} pliant_body_map;

/* Errors: MEMORY, ARGUMENT (bodies of different loads). */
pliant_status pliant_body_map_create(const pliant_body *from, const pliant_body *to, pliant_body_map *out);

void pliant_body_map_free(pliant_body_map *map);

/* Transfer vectors at the fine nodes to the body `to`.
 *   @param from, out (nodes x 3) of each body; the same array is allowed if num_same includes all previous nodes
 */
void pliant_body_map_vectors(const pliant_body_map *map, const double *from, double *out);

/* Create the data of a body at load that cuts subdivide. kerf: cuts leave a distance between their sides
 * Errors: MEMORY. */
pliant_status pliant_subdivision_create(const pliant_mesh *fine, bool kerf, const pliant_geometry *scan,
                                        const pliant_material_table *table, pliant_subdivision **out);

#ifdef __cplusplus
}
#endif
#endif
