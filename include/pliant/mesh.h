/** @file mesh.h
 *  Tetrahedral meshes on a lattice: five tetrahedra per cube with alternating parity ([H] 2, src/fem/coarse/NUMERICS.md).
 *
 *  Lattice cell (a, b, c) has flat index a + cells[0] * (b + cells[1] * c); lattice node likewise with one more
 *  node along each axis. Tetrahedron `slot` 0 of a cell is the central one, 1 to 4 the corners.
 *  Tetrahedra are positively oriented in world space: det(x1 - x0, x2 - x0, x3 - x0) > 0.
 *
 *  An octree's mesh has its nodes on the lattice of its smallest cells; its larger leaves span several of them.
 *  Nodes that were moved onto bone are still called by the place on the lattice that they had.
 */
#ifndef PLIANT_MESH_H
#define PLIANT_MESH_H

#include "pliant/material.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_mesh {
    int32_t cells[3];
    double cell_size[3];       /**< along i, j, k [m] */
    double corner[3];          /**< world position of lattice node (0, 0, 0): the outer corner of the scan's box [m] */
    double direction[9];       /**< as the scan's */
    int32_t num_nodes, num_tets;
    double *rest;              /**< (num_nodes x 3) [m], LPS */
    int32_t *tets;             /**< (num_tets x 4) nodes */
    int32_t *lattice_of_node;  /**< (num_nodes) flat lattice node */
    int32_t *lattice_of_tet;   /**< (num_tets) 5 * flat cell + slot; NULL: octree */
    int32_t *tet_of_lattice;   /**< (5 * cells) tetrahedron or -1; NULL: octree */
    int32_t *node_of_lattice;  /**< (lattice nodes) node or -1 */
    int32_t num_leaves;        /**< octree: 0 otherwise */
    int32_t *leaf_of_cell;     /**< octree: (cells) */
    int32_t *leaf_start;       /**< octree: (num_leaves + 1) first tetrahedron of every leaf; a leaf may have none */
    int32_t num_moved;         /**< nodes that pliant_mesh_bone moved */
    uint8_t *place_of_node;    /**< (num_nodes) pliant_bone_place; NULL: pliant_mesh_bone was not asked */
} pliant_mesh;

#ifdef __cplusplus
}
#endif
#endif
