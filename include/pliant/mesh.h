/** @file mesh.h
 *  Tetrahedral meshes on a lattice ([H] 2): each cube has five tetrahedra, with alternating parity.
 *
 *  Lattice cell (a, b, c) has flat index a + cells[0] * (b + cells[1] * c). Lattice nodes are numbered likewise, with
 *  one more node along each axis. Slot 0 of a cell is the central tetrahedron, slots 1 to 4 are the corners. Tetrahedra
 *  are positively oriented in world space: det(x1 - x0, x2 - x0, x3 - x0) > 0.
 *
 *  Nodes of an octree mesh lie on the lattice of its smallest cells; larger leaves span several cells. Nodes that were
 *  moved onto bone keep the number of their lattice node.
 */
#ifndef PLIANT_MESH_H
#define PLIANT_MESH_H

#include "pliant/material.h"

#ifdef __cplusplus
extern "C" {
#endif

/** A tetrahedral mesh at rest. */
typedef struct pliant_mesh {
    int32_t cells[3];          /**< number of lattice cells along i, j, k */
    double cell_size[3];       /**< along i, j, k [m] */
    double corner[3];          /**< lattice node (0, 0, 0), LPS [m]: the outer corner of the scan's box */
    double direction[9];       /**< axes, as of the scan's geometry */
    int32_t num_nodes, num_tets;
    double *rest;              /**< (num_nodes x 3) rest positions, LPS [m] */
    int32_t *tets;             /**< (num_tets x 4) node indices */
    int32_t *lattice_of_node;  /**< (num_nodes) flat lattice node */
    int32_t *lattice_of_tet;   /**< (num_tets) 5 * flat cell + slot; NULL: octree */
    int32_t *tet_of_lattice;   /**< (5 * cells) tetrahedron or -1; NULL: octree */
    int32_t *node_of_lattice;  /**< (lattice nodes) node or -1 */
    int32_t num_leaves;        /**< leaves of an octree; 0 otherwise */
    int32_t *leaf_of_cell;     /**< (cells) octree only */
    int32_t *leaf_start;       /**< (num_leaves + 1) first tetrahedron of every leaf; octree only. A leaf may be without
                                *   tetrahedra */
    int32_t num_moved;         /**< number of nodes that mesh/bone_surface moved onto bone */
    uint8_t *place_of_node;    /**< (num_nodes) 0 outside of bone, 1 inside, 2 on its surface; NULL without
                                *   mesh/bone_surface */
} pliant_mesh;

#ifdef __cplusplus
}
#endif
#endif
