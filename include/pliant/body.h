/** @file body.h
 *  The topology of the tissue at one moment: meshes, materials, masses, what is fixed, the surface.
 *
 *  A body never changes once it is shared. What changes the topology makes the next body, which says what became of the one
 *  before it. Nodes and tetrahedra keep their numbers: new ones are appended. A model owns the body at load; a simulation holds
 *  the one that is true now. Bodies are counted by reference, from any thread.
 */
#ifndef PLIANT_BODY_H
#define PLIANT_BODY_H

#include "pliant/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

/** What differs from the body before. Tetrahedra and nodes from the counts of the body before on were appended. */
typedef struct pliant_body_changes {
    uint64_t since;            /**< revision of the body before; 0: this is the body at load */
    int32_t nodes_before, tets_before;
    int32_t num_touched;       /**< fine tetrahedra that were there before and whose nodes, material or voxels changed */
    int32_t *touched;          /**< (num_touched) ascending */
    /* what appended ones are copies of, in the body before; NULL: none were appended */
    int32_t *node_source, *tet_source; /**< (those of now - those before) */
} pliant_body_changes;

/** Which voxels are joined at load: the finest level of a body, made only where a scene may cut (pliant_voxels_create), constant, shared by
 *  all bodies of a load and counted by reference. A fragment of a fine tetrahedron is a set of its voxels.
 *
 *  Neighbours along an axis are joined by a link, unless it is severed (pliant_cuts); neighbours across an edge by one of the two ways over
 *  links through a voxel that a tetrahedron owns, where neither of its links is severed. Bridges join what these leave apart: within an uncut
 *  tetrahedron, across a face, and at a node where tetrahedra meet that no faces join. */
typedef struct pliant_voxels {
    pliant_geometry geometry;
    int32_t num_tets, num_nodes; /**< of the fine mesh at load */
    int32_t *owner;            /**< (voxels) the tetrahedron at load that owns it, ties to the central one; -1: none */
    int32_t *start, *voxel;    /**< (num_tets + 1), (those that are owned): by tetrahedron, ascending */
    uint8_t *material;         /**< (those that are owned, in this order) index into of_material */
    int32_t num_materials;
    pliant_tet_material *of_material; /**< (num_materials) of a single voxel */
    uint8_t *fixed_material;   /**< (num_materials) does not move */
    pliant_tet_material *load; /**< (num_tets) of the tetrahedra at load */
    int32_t num_bridges;
    int32_t *bridge;           /**< (num_bridges x 2) voxels; those within a tetrahedron first, by tetrahedron */
    int32_t *bridge_start;     /**< (num_tets + 1) into those within */
    int32_t *beside_start, *beside; /**< (num_tets + 1), the other bridges of every tetrahedron, ascending */
    int32_t *across;           /**< (num_tets x 4) the tetrahedron across each face at load (pliant_mesh_neighbours) */
    int32_t *around_start, *around; /**< (num_nodes + 1), (4 x num_tets) corners of tetrahedra at load, 4 tetrahedron + corner, of every node */
    struct pliant_voxels_holders *holders; /**< how many there are (src/topology) */
} pliant_voxels;

/** What has been severed since load, and the fragments that it leaves. NULL in a body of which nothing is severed. */
typedef struct pliant_cuts {
    int32_t num_links;
    uint32_t *link;            /**< (num_links) 4 voxel + axis: to the next voxel along the axis; ascending */
    int32_t num_bridges;
    int32_t *bridge;           /**< (num_bridges) of pliant_voxels.bridge; ascending */
    int32_t num_tets;          /**< tetrahedra at load that own an end of what is severed, or a voxel that moves with one of them */
    int32_t *tet;              /**< (num_tets) ascending */
    int32_t *start, *fragment; /**< (num_tets + 1), (start[num_tets]) the fine tetrahedra that each is now, ascending, so itself the first */
    int32_t *voxel_start;      /**< (num_tets) where those of each begin in voxel_fragment */
    int32_t *voxel_fragment;   /**< (voxels of each, as pliant_voxels lists them) the fine tetrahedron that each moves with: a fragment of
                                *   its own one, or, of a chip that hangs on nothing else, of another */
    struct pliant_cuts_pool *pool; /**< what voxel_fragment is of, shared with bodies before and after (src/topology); NULL: num_tets is 0 */
    int32_t num_chips;
    int32_t *chip;             /**< (num_chips x 2) tetrahedron at load, fine tetrahedron of another one that some of its voxels move with */
    int32_t num_joins;
    int32_t *join;             /**< (num_joins x 2) fine tetrahedra that links or bridges join, the first below the second, one at least of those
                                *   in fragment; ascending */
    int32_t num_cuts;          /**< bodies from the one at load to this one, which pliant_body_sever makes again */
    int32_t *cut_end;          /**< (num_cuts) into severed: what each of them severed */
    uint32_t *stroke;          /**< (num_cuts x 2) blade and stroke that each of them was of, as its sweep said; stroke 0: of none */
    uint32_t *severed;         /**< (num_links + num_bridges) of each cut, 4 voxel + axis of its links, ascending, and 4 bridge + 3 of its bridges */
    int32_t num_pieces;        /**< with tissue, that hang together at a node at least */
} pliant_cuts;

/** Where a node is that a cut has put on an edge: end[0] + share (end[1] - end[0]), at rest and in the state that it takes after them. Both have
 *  lower numbers. Of a copy: twice its source, and 0. */
typedef struct pliant_between {
    int32_t end[2];
    double share;
} pliant_between;

/** A node that lies on the way of a blade's stroke, which may go on. */
typedef struct pliant_cut_mark {
    uint32_t blade, stroke;
    int32_t node;
} pliant_cut_mark;

/** Of a body whose tetrahedra cuts subdivide (cut/kind: subdivide). Each is a tetrahedron of its own, all of whose inside is its own. */
typedef struct pliant_subdivision {
    int32_t load_nodes;        /**< nodes at load */
    double least_edge;         /**< nearer to a node than this no edge is cut: the node itself is [m] */
    double least_volume;       /**< no tetrahedron that a cut makes has less [m^3] */
    pliant_between *between;   /**< (fine.num_nodes - load_nodes) of those appended since load; NULL: none */
    int32_t num_marks;
    pliant_cut_mark *mark;     /**< (num_marks) the last stroke of every blade */
} pliant_subdivision;

/** Pieces that have come off since load: nothing that is fixed holds them any more. Those that touch, if only at a node, count as one. */
typedef struct pliant_pieces {
    int32_t count;
    int32_t *start, *node;     /**< (count + 1), (start[count]) fine nodes of each, ascending; no other piece or tissue has them */
    int32_t num_joints;        /**< what a piece hangs on where it is a node or two */
    int32_t num_inner;         /**< after those: what has come off hanging on one another, one piece now */
    int32_t *joint;            /**< ((num_joints + num_inner) x 2) its own node, and the one that it hangs on; twice its own: that stays where it
                                *   was at rest */
} pliant_pieces;

/** Whether a node moves. What a solve is not asked for, since it is of a piece that has come off, is fixed where it was then, not at rest. */
typedef enum pliant_fixing { PLIANT_MOVES, PLIANT_FIXED_AT_REST, PLIANT_FIXED_WHERE_IT_WAS } pliant_fixing;

typedef struct pliant_body {
    uint64_t revision;         /**< 1 at load; no two bodies of a simulation share one */
    /* MESH */
    pliant_mesh fine, coarse;  /**< coarse is empty for the fine method; cuts leave it as it is */
    int32_t *node_parent;      /**< (fine.num_nodes) the node at load that it is a copy of; NULL: every node is its own */
    int32_t *tet_parent;       /**< (fine.num_tets) likewise; NULL: likewise */
    int32_t *coarse_of_fine;   /**< (fine.num_tets) the coarse tetrahedron that holds it, whole or cut; NULL: no coarse mesh */
    int32_t *fine_of_coarse;   /**< (coarse.num_nodes) the fine node at its place at load; -1: none; NULL: likewise */
    int32_t *across;           /**< (fine.num_tets x 4) who is across each face (pliant_mesh_neighbours); NULL: a body at load */
    int32_t *triangles;        /**< (num_triangles x 3) surface of the fine mesh, outwards */
    int32_t num_triangles;
    int32_t *outside;          /**< (num_triangles) the face that each is, 4 tetrahedron + opposite corner, ascending; NULL: not known */
    /* MATERIAL */
    pliant_tet_material *fine_material;   /**< (fine.num_tets) */
    pliant_tet_material *coarse_material; /**< (coarse.num_tets) means over their voxels; NULL but for the coarse method */
    double *node_mass;         /**< (fine.num_nodes) [kg] */
    /* WHAT HOLDS IT */
    uint8_t *fine_fixed;       /**< (fine.num_nodes) pliant_fixing */
    uint8_t *coarse_fixed;     /**< (coarse.num_nodes) likewise; NULL: no coarse mesh */
    int32_t num_held_pieces;   /**< pieces that nothing fixed held at load: kept where they are */
    bool falls;                /**< those are left to fall: explicit dynamics on a ground */
    bool has_inertia;          /**< explicit dynamics: what comes off falls as everything moves; otherwise its nodes are fixed for the solve, and
                                *   it falls as a rigid body */
    pliant_pieces *pieces;     /**< Nullable: nothing has come off */

    const pliant_voxels *voxels; /**< Nullable: only where a scene may cut; one holder of them */
    pliant_cuts *cuts;         /**< Nullable: nothing is severed */
    pliant_subdivision *subdivision; /**< Nullable: only where cuts subdivide tetrahedra; then there are no voxels and no cuts */

    pliant_body_changes changes;
    const struct pliant_body *lender;    /**< Nullable: whose are the tables of the lattice, which never change; one holder of it */
    struct pliant_body_holders *holders; /**< how many there are (src/topology) */
} pliant_body;

/** One more holder. @return body */
PLIANT_API const pliant_body *pliant_body_retain(const pliant_body *body);
/** One holder less; the last one frees it. Nullable. */
PLIANT_API void pliant_body_release(const pliant_body *body);

/** An empty body of a revision, with one holder. Errors: MEMORY. */
PLIANT_API pliant_status pliant_body_create(uint64_t revision, pliant_body **out);
/** The next body, with the topology of this one: everything copied, nothing touched. Who makes it changes it before anybody else
 *  holds it. @param revision a simulation's last_revision + 1. Errors: MEMORY, ARGUMENT (not above this one's). */
PLIANT_API pliant_status pliant_body_next(const pliant_body *body, uint64_t revision, pliant_body **out);

/** Whether a scene may cut this body. */
PLIANT_API bool pliant_body_may_be_cut(const pliant_body *body);

/** What a cut makes of the fine mesh. Elements keep their shape, unless it is subdivided; a node's copies lie where it does. */
typedef struct pliant_division {
    int32_t num_tets;          /**< of the next body: those of the body before, and fragments of them that are appended */
    const int32_t *tet_source; /**< (those appended) tetrahedron of the body before that each is a fragment of; NULL: none are appended */
    int32_t num_changed;
    const int32_t *changed;    /**< (num_changed) ascending tetrahedra of the body before: corners and material list only these, then those
                                *   appended; NULL: all of them */
    const int32_t *corners;    /**< (those listed x 4) node of every corner: the one of the body before, or a copy, numbered from there on.
                                *   Every node keeps a corner at least */
    const pliant_tet_material *material; /**< (those listed) means over the whole tetrahedron of what is in the fragment; NULL: as before, no
                                *   fragments */
    const uint8_t *copy_fixed; /**< (nodes appended) pliant_fixing; NULL: as their sources */
    const pliant_between *between; /**< (nodes appended) of a body with a subdivision: corners may be any nodes then, and sources are whose
                                *   material and state a tetrahedron takes; NULL: all that is appended is copies */
    int32_t num_touched;       /**< tetrahedra of the body before whose voxels changed, too, where nothing else tells */
    const int32_t *touched;    /**< (num_touched) ascending */
    int32_t num_joints;
    const int32_t *joint;      /**< (num_joints x 2) corners, 4 tetrahedron + corner, of what is left of the joints of its pieces; NULL: all of it */
    bool same_pieces;          /**< no piece comes off another: it is not looked for what falls */
    pliant_cuts *cuts;         /**< of the next body, which takes them; NULL: as before */
} pliant_division;
/** The next body: nodes and fragments appended with their parents, masses, what is fixed, and surface. Pieces that nothing holds any more are
 *  listed.
 *  Errors: MEMORY, ARGUMENT (not a division of this body), FORMAT (faces of three tetrahedra). */
PLIANT_API pliant_status pliant_body_divide(const pliant_body *body, uint64_t revision, const pliant_division *division, pliant_body **out);

/** A fourth of the mass of a tetrahedron to each of its nodes ([H] 2.1). @param mass (fine.num_nodes) out [kg] */
PLIANT_API void pliant_body_masses(const pliant_body *body, double *mass);
/** Of pieces that nothing holds at load, the stiffness is taken down to this part: they keep their place in the picture. */
#define PLIANT_LOOSE_STIFFNESS 1e-6

/** The voxels of a body at load, with one holder. @param material_of_voxel (voxels) index into the table.
 *  Errors: MEMORY, FORMAT, SCENE (more than 2^30 voxels). */
PLIANT_API pliant_status pliant_voxels_create(const pliant_body *body, const pliant_geometry *geometry, const uint8_t *material_of_voxel,
                                              const pliant_material_table *table, const pliant_voxels **out);
/** One more holder. @return voxels */
PLIANT_API const pliant_voxels *pliant_voxels_retain(const pliant_voxels *voxels);
/** One holder less; the last one frees them. Nullable. */
PLIANT_API void pliant_voxels_release(const pliant_voxels *voxels);
/** Whether two voxels that are owned are joined, by a link or across an edge; only neighbours are. @param cuts Nullable */
PLIANT_API bool pliant_voxels_joined(const pliant_voxels *voxels, const pliant_cuts *cuts, int32_t a, int32_t b);
/** Parts of a tetrahedron at load: its voxels that hang together within it, numbered by their first ones.
 *  @param cuts Nullable
 *  @param part (start[tet + 1] - start[tet]) out, of each of its voxels. @return how many there are */
PLIANT_API int32_t pliant_voxels_parts(const pliant_voxels *voxels, const pliant_cuts *cuts, int32_t tet, int32_t *part);
/** The fine tetrahedron that a voxel moves with; -1: none. @param cuts Nullable */
PLIANT_API int32_t pliant_voxels_fragment(const pliant_voxels *voxels, const pliant_cuts *cuts, int32_t voxel);

PLIANT_API pliant_status pliant_cuts_copy(const pliant_cuts *cuts, pliant_cuts **out); /**< Errors: MEMORY */
PLIANT_API void pliant_cuts_free(pliant_cuts *cuts); /**< Nullable */

/** Whether nothing but the revision differs. */
PLIANT_API bool pliant_body_same(const pliant_body *a, const pliant_body *b);

/** Which node and tetrahedron of another body each one takes its state from: itself, or what it is a copy of. */
typedef struct pliant_body_map {
    int32_t *node, *tet;               /**< (of the body `to`) */
    int32_t num_nodes;                 /**< of the body `to` */
    int32_t num_same;                  /**< of these, from the first one on, that are the other body's node of their own number */
    pliant_between *between;           /**< (num_nodes) of nodes that lie between others of the body `to`; end[0] < 0: it is as `node` says; NULL: all are */
} pliant_body_map;
/** Errors: MEMORY, ARGUMENT (bodies of different loads). */
PLIANT_API pliant_status pliant_body_map_create(const pliant_body *from, const pliant_body *to, pliant_body_map *out);
PLIANT_API void pliant_body_map_free(pliant_body_map *map);
/** Vectors at the fine nodes of the body `to`, from those of the other. @param from, out (nodes x 3) of each; where num_same are all that there were they
 *  may be the same array */
PLIANT_API void pliant_body_map_vectors(const pliant_body_map *map, const double *from, double *out);

/** Room for what cuts leave in a body at load that they subdivide. @param snap part of the shortest edge that no cut goes below.
 *  Errors: MEMORY. */
PLIANT_API pliant_status pliant_subdivision_create(const pliant_mesh *fine, double snap, pliant_subdivision **out);

#ifdef __cplusplus
}
#endif
#endif
