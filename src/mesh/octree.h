/* The tree of an adaptive mesh in flat arrays, one per level. Level 0 has the roots, level `depth` the smallest
 * cells. */
#ifndef PLIANT_MESH_OCTREE_H
#define PLIANT_MESH_OCTREE_H

#include "pliant/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_MAX_DEPTH = 6 };

typedef struct pliant_octree {
    int32_t depth;
    int32_t cells[PLIANT_MAX_DEPTH + 1][3];
    uint8_t *split[PLIANT_MAX_DEPTH + 1]; /* (cells of the level) 1: has children; NULL at the last level */
    /* LEAVES, in the order of their first smallest cell. */
    int32_t num_leaves;
    int32_t *leaf_of_cell;                /* (smallest cells) */
    int32_t (*origin)[3];                 /* (num_leaves) in smallest cells */
    uint8_t *level;                       /* (num_leaves) */
} pliant_octree;

/* Build the tree: split by the materials of voxels, then balance. Leaves with a common face or edge differ by at most
 * one level. Errors: MEMORY. */
pliant_status pliant_octree_create(const int32_t roots[3], int32_t depth, double purity,
                                   const pliant_geometry *geometry, const uint8_t *material_of_voxel,
                                   pliant_octree *out);
void pliant_octree_free(pliant_octree *tree);

/* Return the lattice node of the smallest cells. */
static inline int32_t pliant_octree_node(const int32_t cells[3], const int32_t at[3])
{
    return at[0] + (cells[0] + 1) * (at[1] + (cells[1] + 1) * at[2]);
}

static inline size_t pliant_octree_count(const pliant_octree *tree, int32_t level)
{
    return (size_t)tree->cells[level][0] * (size_t)tree->cells[level][1] * (size_t)tree->cells[level][2];
}
static inline size_t pliant_octree_flat(const pliant_octree *tree, int32_t level, const int32_t at[3])
{
    return (size_t)at[0] +
           (size_t)tree->cells[level][0] * ((size_t)at[1] + (size_t)tree->cells[level][1] * (size_t)at[2]);
}

#ifdef __cplusplus
}
#endif

#endif
