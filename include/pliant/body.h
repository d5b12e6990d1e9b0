/** @file body.h
 *  The topology of the tissue at one moment: meshes, materials, masses, fixed nodes and the surface.
 *
 *  A body is constant and reference-counted. A cut creates the next body. Nodes and tetrahedra keep their numbers: new
 *  ones are appended. A model owns the body at load. A simulation holds its current body.
 */
#ifndef PLIANT_BODY_H
#define PLIANT_BODY_H

#include "pliant/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_voxels pliant_voxels;           /**< opaque: links between voxels at load */
typedef struct pliant_cuts pliant_cuts;               /**< opaque: links that cuts have severed since load */
typedef struct pliant_subdivision pliant_subdivision; /**< opaque: tetrahedra that cut/kind subdivide has divided */
typedef struct pliant_pieces pliant_pieces;           /**< opaque: detached pieces */

/** Difference from the previous body. Nodes and tetrahedra from nodes_before and tets_before on were appended. */
typedef struct pliant_body_changes {
    uint64_t since;            /**< revision of the previous body; 0 for the body at load */
    int32_t nodes_before, tets_before;
    int32_t num_touched;       /**< number of previous fine tetrahedra with changed nodes, material or voxels */
    int32_t *touched;          /**< (num_touched) ascending */
    int32_t *node_source;      /**< (appended nodes) copied node of the previous body; NULL without appended nodes */
    int32_t *tet_source;       /**< (appended tetrahedra) copied tetrahedron of the previous body; NULL without appended
                                *   tetrahedra */
} pliant_body_changes;

/** Whether a node is solved for. Nodes of detached pieces are fixed at their current position for a quasi-static
 *  solver. */
typedef enum pliant_fixing { PLIANT_MOVES, PLIANT_FIXED_AT_REST, PLIANT_FIXED_AT_POSITION } pliant_fixing;

/** Topology of the tissue. All arrays belong to the body. */
typedef struct pliant_body {
    uint64_t revision;         /**< 1 at load; unique among the bodies of a simulation */
    /* MESH */
    pliant_mesh fine, coarse;  /**< coarse is empty for the fine method; cuts do not change it */
    int32_t *node_parent;      /**< (fine.num_nodes) copied node at load; NULL: no node is a copy */
    int32_t *tet_parent;       /**< (fine.num_tets) copied tetrahedron at load; NULL: no tetrahedron is a copy */
    int32_t *coarse_of_fine;   /**< (fine.num_tets) enclosing coarse tetrahedron; NULL without a coarse mesh */
    int32_t *fine_of_coarse;   /**< (coarse.num_nodes) fine node at the same rest position, -1 without one; NULL
                                *   without a coarse mesh */
    int32_t *across;           /**< (fine.num_tets x 4) tetrahedron across each face, -1 at the surface; NULL: not
                                *   stored */
    int32_t *triangles;        /**< (num_triangles x 3) surface of the fine mesh, oriented outwards */
    int32_t num_triangles;
    int32_t *outside;          /**< (num_triangles) face of each triangle: 4 * tetrahedron + opposite corner, ascending;
                                *   NULL: not stored */
    /* MATERIAL */
    pliant_tet_material *fine_material;   /**< (fine.num_tets) */
    pliant_tet_material *coarse_material; /**< (coarse.num_tets) means over their voxels; NULL except for model/method
                                           *   coarse */
    double *node_mass;         /**< (fine.num_nodes) [kg] */
    /* FIXED NODES */
    uint8_t *fine_fixed;       /**< (fine.num_nodes) pliant_fixing */
    uint8_t *coarse_fixed;     /**< (coarse.num_nodes) pliant_fixing; NULL without a coarse mesh */
    int32_t num_held_pieces;   /**< number of pieces at load without fixed nodes; they stay at rest */
    bool falls;                /**< those pieces fall instead: explicit dynamics with a ground */
    bool has_inertia;          /**< explicit dynamics: detached pieces move as all tissue does; otherwise they move as
                                *   rigid bodies */
    pliant_pieces *pieces;     /**< Nullable: no piece is detached */
    /* CUTS */
    const pliant_voxels *voxels; /**< Nullable: the scene does not cut voxels */
    pliant_cuts *cuts;         /**< Nullable: nothing is severed */
    pliant_subdivision *subdivision; /**< Nullable: the scene does not subdivide tetrahedra. With it, voxels and cuts
                                      *   are NULL */

    pliant_body_changes changes;
    const struct pliant_body *lender;    /**< Nullable: retained owner of the lattice's tables */
    struct pliant_body_holders *holders; /**< reference count */
} pliant_body;

/** Add a reference to a body, from any thread.
 *  @param body The body.
 *  @return Body */
PLIANT_API const pliant_body *pliant_body_retain(const pliant_body *body);

/** Remove a reference from a body, from any thread. The last call frees it.
 *  @param body Nullable. */
PLIANT_API void pliant_body_release(const pliant_body *body);

#ifdef __cplusplus
}
#endif
#endif
