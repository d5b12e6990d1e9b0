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

typedef struct pliant_voxels pliant_voxels;           /**< opaque: links between voxels at load */
typedef struct pliant_cuts pliant_cuts;               /**< opaque: what cuts have severed since load */
typedef struct pliant_subdivision pliant_subdivision; /**< opaque: what cut/kind subdivide has made */
typedef struct pliant_pieces pliant_pieces;           /**< opaque: pieces that have come off */

/** What differs from the body before. Tetrahedra and nodes from the counts of the body before on were appended. */
typedef struct pliant_body_changes {
    uint64_t since;            /**< revision of the body before; 0: this is the body at load */
    int32_t nodes_before, tets_before;
    int32_t num_touched;       /**< fine tetrahedra that were there before and whose nodes, material or voxels changed */
    int32_t *touched;          /**< (num_touched) ascending */
    /* what appended ones are copies of, in the body before; NULL: none were appended */
    int32_t *node_source, *tet_source; /**< (those of now - those before) */
} pliant_body_changes;

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

#ifdef __cplusplus
}
#endif
#endif
