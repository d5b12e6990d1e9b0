/* Splits the cubes of an octree: by their materials, and so that adjacent cubes differ by at most one level. */
#include "mesh/octree.h"

#include "base/fail.h"
#include "base/memory.h"

#include <string.h>

/* Most frequent material of a cube's voxels, and its count. For larger cubes the count is a lower bound. */
typedef struct majority { uint32_t count, total; uint8_t material; } majority;

/* Return the first voxel of a cell along an axis. A voxel belongs to the cell that contains its centre. */
static int32_t first_voxel(int32_t voxels, int32_t cells, int32_t cell)
{
    int32_t i = (int32_t)((double)cell * voxels / cells - 0.5);
    if (i < 0) i = 0;
    while (i > 0 && (i - 0.5) * cells / voxels >= cell) i--;
    while (i < voxels && (i + 0.5) * cells / voxels < cell) i++;
    return i;
}

static void count_voxels(const pliant_octree *tree, const pliant_geometry *geometry, const uint8_t *material_of_voxel,
                         int32_t *const first[3], majority *out)
{
    const int32_t *cells = tree->cells[tree->depth], *size = geometry->size;
#pragma omp parallel for schedule(static)
    for (int32_t c = 0; c < cells[2]; c++)
        for (int32_t b = 0; b < cells[1]; b++)
            for (int32_t a = 0; a < cells[0]; a++) {
                uint32_t count[256] = {0};
                int32_t at[3] = {a, b, c}, low[3], high[3];
                for (int d = 0; d < 3; d++) {
                    low[d] = first[d][at[d]];
                    high[d] = first[d][at[d] + 1];
                    if (low[d] < high[d]) continue;
                    if (low[d] >= size[d]) low[d] = size[d] - 1; /* smaller than a voxel: use the adjacent voxel */
                    high[d] = low[d] + 1;
                }
                for (int32_t k = low[2]; k < high[2]; k++)
                    for (int32_t j = low[1]; j < high[1]; j++) {
                        const uint8_t *row =
                            material_of_voxel + (size_t)size[0] * ((size_t)j + (size_t)size[1] * (size_t)k);
                        for (int32_t i = low[0]; i < high[0]; i++) count[row[i]]++;
                    }
                majority *one = out + pliant_octree_flat(tree, tree->depth, at);
                for (int m = 0; m < 256; m++) {
                    one->total += count[m];
                    if (count[m] <= one->count) continue;
                    one->count = count[m];
                    one->material = (uint8_t)m;
                }
            }
}

static majority of_children(const pliant_octree *tree, int32_t level, const int32_t at[3], const majority *below)
{
    majority children[8], best = {0};
    for (int child = 0; child < 8; child++) {
        int32_t lower[3];
        for (int d = 0; d < 3; d++) lower[d] = 2 * at[d] + (child >> d & 1);
        children[child] = below[pliant_octree_flat(tree, level + 1, lower)];
        best.total += children[child].total;
    }
    for (int child = 0; child < 8; child++) {
        uint32_t sum = 0;
        for (int other = 0; other < 8; other++)
            if (children[other].material == children[child].material) sum += children[other].count;
        if (sum <= best.count) continue;
        best.count = sum;
        best.material = children[child].material;
    }
    return best;
}

/* Mark splits from the smallest cells up. Cubes below an unsplit cube are marked as well; they are removed later. */
static pliant_status split_by_material(pliant_octree *tree, double purity, const pliant_geometry *geometry,
                                       const uint8_t *material_of_voxel)
{
    int32_t *first[3] = {NULL, NULL, NULL};
    majority *below = pliant_calloc(pliant_octree_count(tree, tree->depth), sizeof *below), *here = NULL;
    pliant_status status = below ? PLIANT_OK : pliant_fail_memory("the octree");
    for (int d = 0; status == PLIANT_OK && d < 3; d++) {
        int32_t cells = tree->cells[tree->depth][d];
        first[d] = pliant_calloc((size_t)cells + 1, sizeof *first[d]);
        if (!first[d]) status = pliant_fail_memory("the octree");
        for (int32_t cell = 0; first[d] && cell <= cells; cell++)
            first[d][cell] = first_voxel(geometry->size[d], cells, cell);
    }
    if (status == PLIANT_OK) count_voxels(tree, geometry, material_of_voxel, first, below);
    for (int32_t level = tree->depth - 1; status == PLIANT_OK && level >= 0; level--) {
        here = pliant_calloc(pliant_octree_count(tree, level), sizeof *here);
        if (!here) {
            status = pliant_fail_memory("the octree");
            break;
        }
        int32_t at[3];
        for (at[2] = 0; at[2] < tree->cells[level][2]; at[2]++)
            for (at[1] = 0; at[1] < tree->cells[level][1]; at[1]++)
                for (at[0] = 0; at[0] < tree->cells[level][0]; at[0]++) {
                    size_t flat = pliant_octree_flat(tree, level, at);
                    here[flat] = of_children(tree, level, at, below);
                    tree->split[level][flat] = here[flat].count < purity * here[flat].total;
                }
        pliant_free(below);
        below = here;
    }
    pliant_free(below);
    for (int d = 0; d < 3; d++) pliant_free(first[d]);
    return status;
}

/* Remove the splits of cubes whose ancestors are not split. A cube that is pure as a whole stays whole. */
static void remove_orphan_splits(pliant_octree *tree)
{
    int32_t at[3];
    for (int32_t level = 1; level < tree->depth; level++)
        for (at[2] = 0; at[2] < tree->cells[level][2]; at[2]++)
            for (at[1] = 0; at[1] < tree->cells[level][1]; at[1]++)
                for (at[0] = 0; at[0] < tree->cells[level][0]; at[0]++) {
                    int32_t parent[3] = {at[0] / 2, at[1] / 2, at[2] / 2};
                    if (!tree->split[level - 1][pliant_octree_flat(tree, level - 1, parent)])
                        tree->split[level][pliant_octree_flat(tree, level, at)] = 0;
                }
}

/* Balance from the smallest cells up. Cubes that share a face or an edge with a split cube must be at most as large
 * as it, so their parents are split, and the cube's own parent. Splits are only added one level up, so one pass
 * suffices. */
static void balance(pliant_octree *tree)
{
    int32_t at[3], step[3];
    for (int32_t level = tree->depth - 1; level > 0; level--)
        for (at[2] = 0; at[2] < tree->cells[level][2]; at[2]++)
            for (at[1] = 0; at[1] < tree->cells[level][1]; at[1]++)
                for (at[0] = 0; at[0] < tree->cells[level][0]; at[0]++) {
                    if (!tree->split[level][pliant_octree_flat(tree, level, at)]) continue;
                    for (int n = 0; n < 27; n++) {
                        bool inside = true;
                        int32_t parent[3], away = 0;
                        for (int d = 0; d < 3; d++) {
                            step[d] = (d == 0 ? n % 3 : d == 1 ? n / 3 % 3 : n / 9) - 1;
                            away += step[d] != 0;
                            int32_t adjacent = at[d] + step[d];
                            inside = inside && adjacent >= 0 && adjacent < tree->cells[level][d];
                            parent[d] = adjacent / 2;
                        }
                        if (inside && away < 3) tree->split[level - 1][pliant_octree_flat(tree, level - 1, parent)] = 1;
                    }
                }
}

static int32_t level_of(const pliant_octree *tree, const int32_t cell[3])
{
    for (int32_t level = 0; level < tree->depth; level++) {
        int32_t shift = tree->depth - level, at[3] = {cell[0] >> shift, cell[1] >> shift, cell[2] >> shift};
        if (!tree->split[level][pliant_octree_flat(tree, level, at)]) return level;
    }
    return tree->depth;
}

static pliant_status number_leaves(pliant_octree *tree)
{
    const int32_t *cells = tree->cells[tree->depth];
    size_t count = pliant_octree_count(tree, tree->depth);
    int32_t cell[3];
    tree->leaf_of_cell = pliant_calloc(count, sizeof *tree->leaf_of_cell);
    if (!tree->leaf_of_cell) return pliant_fail_memory("the octree");
    /* A leaf's number is assigned at its first cell. Other cells copy it from the previous cell along an axis inside
     * the leaf. */
    for (int pass = 0; pass < 2; pass++) {
        int32_t leaves = 0;
        for (cell[2] = 0; cell[2] < cells[2]; cell[2]++)
            for (cell[1] = 0; cell[1] < cells[1]; cell[1]++)
                for (cell[0] = 0; cell[0] < cells[0]; cell[0]++) {
                    int32_t level = level_of(tree, cell), mask = (1 << (tree->depth - level)) - 1;
                    int32_t first[3] = {cell[0] & ~mask, cell[1] & ~mask, cell[2] & ~mask};
                    bool begins = memcmp(first, cell, sizeof first) == 0;
                    int32_t *leaf = tree->leaf_of_cell + pliant_octree_flat(tree, tree->depth, cell);
                    *leaf = begins ? leaves++ : tree->leaf_of_cell[pliant_octree_flat(tree, tree->depth, first)];
                    if (pass == 0 || !begins) continue;
                    memcpy(tree->origin[*leaf], cell, sizeof first);
                    tree->level[*leaf] = (uint8_t)level;
                }
        if (pass == 1) break;
        tree->num_leaves = leaves;
        tree->origin = pliant_calloc((size_t)leaves, sizeof *tree->origin);
        tree->level = pliant_calloc((size_t)leaves, sizeof *tree->level);
        if (!tree->origin || !tree->level) return pliant_fail_memory("the octree");
    }
    return PLIANT_OK;
}

pliant_status pliant_octree_create(const int32_t roots[3], int32_t depth, double purity,
                                   const pliant_geometry *geometry, const uint8_t *material_of_voxel,
                                   pliant_octree *out)
{
    pliant_octree tree = {.depth = depth};
    pliant_status status = PLIANT_OK;
    for (int32_t level = 0; level <= depth; level++)
        for (int d = 0; d < 3; d++) tree.cells[level][d] = roots[d] << level;
    for (int32_t level = 0; status == PLIANT_OK && level < depth; level++) {
        tree.split[level] = pliant_calloc(pliant_octree_count(&tree, level), 1);
        if (!tree.split[level]) status = pliant_fail_memory("the octree");
    }
    if (status == PLIANT_OK) status = split_by_material(&tree, purity, geometry, material_of_voxel);
    if (status == PLIANT_OK) {
        remove_orphan_splits(&tree);
        balance(&tree);
        status = number_leaves(&tree);
    }
    if (status == PLIANT_OK) *out = tree;
    else pliant_octree_free(&tree);
    return status;
}

void pliant_octree_free(pliant_octree *tree)
{
    for (int32_t level = 0; level <= PLIANT_MAX_DEPTH; level++) pliant_free(tree->split[level]);
    PLIANT_FREE(tree->leaf_of_cell, tree->origin, tree->level);
    memset(tree, 0, sizeof *tree);
}
