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
    int32_t coarse_nodes_before, coarse_tets_before;
    int32_t num_touched;       /**< fine tetrahedra that were there before and whose nodes, material or voxels changed */
    int32_t *touched;          /**< (num_touched) ascending */
    int32_t num_touched_coarse;
    int32_t *touched_coarse;   /**< (num_touched_coarse) ascending; also those whose fine tetrahedra changed */
} pliant_body_changes;

typedef struct pliant_body {
    uint64_t revision;         /**< 1 at load; no two bodies of a simulation share one */
    /* MESH */
    pliant_mesh fine, coarse;  /**< coarse is empty for the fine method */
    int32_t *node_parent;      /**< (fine.num_nodes) the node at load that it is a copy of; NULL: every node is its own */
    int32_t *tet_parent;       /**< (fine.num_tets) likewise; NULL: likewise */
    int32_t *coarse_node_parent, *coarse_tet_parent; /**< likewise */
    int32_t *coarse_of_fine;   /**< (fine.num_tets) the coarse tetrahedron that holds it; NULL: no coarse mesh */
    int32_t *triangles;        /**< (num_triangles x 3) surface of the fine mesh, outwards */
    int32_t num_triangles;
    /* MATERIAL */
    pliant_tet_material *fine_material;   /**< (fine.num_tets) */
    pliant_tet_material *coarse_material; /**< (coarse.num_tets) means over their voxels; NULL but for the coarse method */
    double *node_mass;         /**< (fine.num_nodes) [kg] */
    /* WHAT HOLDS IT */
    uint8_t *fine_fixed;       /**< (fine.num_nodes) 1: does not move */
    uint8_t *coarse_fixed;     /**< (coarse.num_nodes); NULL: no coarse mesh */
    int32_t num_held_pieces;   /**< pieces that nothing fixed held at load: kept where they are */

    pliant_body_changes changes;
    struct pliant_body_holders *holders; /**< how many there are (src/body) */
} pliant_body;

/** One more holder. @return body */
PLIANT_API const pliant_body *pliant_body_retain(const pliant_body *body);
/** One holder less; the last one frees it. Nullable. */
PLIANT_API void pliant_body_release(const pliant_body *body);

/** An empty body of a revision, with one holder. Errors: MEMORY. */
PLIANT_API pliant_status pliant_body_create(uint64_t revision, pliant_body **out);
/** The next body, with the topology of this one: everything copied, the revision one higher, nothing touched. Who makes it changes it
 *  before anybody else holds it. Errors: MEMORY. */
PLIANT_API pliant_status pliant_body_next(const pliant_body *body, pliant_body **out);

#ifdef __cplusplus
}
#endif
#endif
