#include "contact/advance/bounding_box_tree.h"

#include "base/fail.h"
#include "base/median.h"
#include "base/memory.h"
#include "base/pairs.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { LEAF = 2 };

/* ---- owners of nodes and edges */

typedef struct claim {
    int32_t a, b, triangle, k;
} claim; /* of an edge; for a node, b is -1 */

/* The first triangle with a node or edge owns it. */
static bool find_owners(pliant_advance_tree *tree)
{
    const size_t count = 6 * (size_t)tree->num_triangles;
    claim *all = pliant_calloc(count, sizeof *all);
    if (!all) return false;
    for (int32_t t = 0; t < tree->num_triangles; t++)
        for (int k = 0; k < 3; k++) {
            const int32_t a = tree->triangles[3 * (size_t)t + (size_t)k],
                          b = tree->triangles[3 * (size_t)t + (size_t)((k + 1) % 3)];
            all[6 * (size_t)t + (size_t)k] = (claim){a, -1, t, k};
            all[6 * (size_t)t + 3 + (size_t)k] = (claim){a < b ? a : b, a < b ? b : a, t, k};
        }
    qsort(all, count, sizeof *all, pliant_triple_order);
    memset(tree->owns, 0, (size_t)tree->num_triangles);
    for (size_t n = 0; n < count; n++)
        if (n == 0 || all[n].a != all[n - 1].a || all[n].b != all[n - 1].b)
            tree->owns[all[n].triangle] |= (uint8_t)((all[n].b < 0 ? PLIANT_OWNS_NODE : PLIANT_OWNS_EDGE) << all[n].k);
    pliant_free(all);
    return true;
}

/* ---- structure */

static bool build(pliant_advance_tree *tree, const double *positions)
{
    pliant_numbered_point *of = pliant_calloc((size_t)tree->num_triangles, sizeof *of);
    if (!of) return false;
    for (int32_t t = 0; t < tree->num_triangles; t++) {
        of[t].number = t;
        for (size_t c = 0; c < 3; c++)
            for (size_t d = 0; d < 3; d++) of[t].at[d] += positions[3 * (size_t)tree->triangles[3 * (size_t)t + c] + d];
    }
    tree->branch[0] = (pliant_advance_branch){0, tree->num_triangles, -1};
    tree->num_branches = 1;
    for (int32_t b = 0; b < tree->num_branches; b++) {
        pliant_advance_branch *branch = tree->branch + b;
        double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
        int axis = 0;
        if (branch->count <= LEAF) continue;
        for (int32_t n = branch->first; n < branch->first + branch->count; n++)
            for (int d = 0; d < 3; d++) {
                low[d] = pliant_advance_lower(low[d], of[n].at[d]);
                high[d] = pliant_advance_upper(high[d], of[n].at[d]);
            }
        for (int d = 1; d < 3; d++)
            if (high[d] - low[d] > high[axis] - low[axis]) axis = d;
        const int32_t half = branch->count / 2;
        pliant_split_at_median(of, branch->first, branch->first + branch->count - 1, branch->first + half, axis);
        branch->child = tree->num_branches;
        tree->branch[tree->num_branches++] = (pliant_advance_branch){branch->first, half, -1};
        tree->branch[tree->num_branches++] = (pliant_advance_branch){branch->first + half, branch->count - half, -1};
    }
    for (int32_t n = 0; n < tree->num_triangles; n++) tree->order[n] = of[n].number;
    pliant_free(of);
    return true;
}

static bool reserve(pliant_advance_tree *tree, int32_t count)
{
    if (count <= tree->max_triangles) return true;
    pliant_advance_tree_free(tree);
    tree->triangles = pliant_calloc((size_t)count, 3 * sizeof *tree->triangles);
    tree->owns = pliant_calloc((size_t)count, sizeof *tree->owns);
    tree->order = pliant_calloc((size_t)count, sizeof *tree->order);
    tree->branch = pliant_calloc((size_t)count, 2 * sizeof *tree->branch);
    tree->box = pliant_calloc((size_t)count, sizeof *tree->box);
    tree->around = pliant_calloc((size_t)count, 2 * sizeof *tree->around);
    if (!tree->triangles || !tree->owns || !tree->order || !tree->branch || !tree->box || !tree->around) return false;
    tree->max_triangles = count;
    return true;
}

static void fit(pliant_advance_tree *tree, const double *from, const double *to)
{
    for (int32_t n = 0; n < tree->num_triangles; n++)
        tree->box[n] = pliant_advance_box_of(3, tree->triangles + 3 * (size_t)tree->order[n], from, to);
    for (int32_t b = tree->num_branches - 1; b >= 0; b--) {
        const pliant_advance_branch *branch = tree->branch + b;
        const pliant_advance_box *part = branch->child < 0 ? tree->box + branch->first : tree->around + branch->child;
        const int32_t count = branch->child < 0 ? branch->count : 2;
        pliant_advance_box out = part[0];
        for (int32_t k = 1; k < count; k++) {
            pliant_advance_box_add(&out, part[k].low);
            pliant_advance_box_add(&out, part[k].high);
        }
        tree->around[b] = out;
    }
}

pliant_status pliant_advance_tree_set(pliant_advance_tree *tree, int32_t num_triangles, const int32_t *triangles,
                                      const double *positions)
{
    const size_t bytes = 3 * (size_t)num_triangles * sizeof *triangles;
    if (num_triangles == tree->num_triangles && memcmp(triangles, tree->triangles, bytes) == 0) return PLIANT_OK;
    tree->num_triangles = 0;
    bool good = reserve(tree, num_triangles);
    if (good) {
        memcpy(tree->triangles, triangles, bytes);
        tree->num_triangles = num_triangles;
        good = find_owners(tree) && build(tree, positions);
    }
    if (good) return PLIANT_OK;
    pliant_advance_tree_free(tree);
    return pliant_fail_memory("contact advance");
}

pliant_status pliant_advance_tree_update(pliant_advance_tree *tree, int32_t num_triangles, const int32_t *triangles,
                                         const double *rest, const double *from, const double *to)
{
    const pliant_status status = pliant_advance_tree_set(tree, num_triangles, triangles, rest ? rest : from);
    if (status == PLIANT_OK) fit(tree, from, to);
    return status;
}

void pliant_advance_tree_free(pliant_advance_tree *tree)
{
    PLIANT_FREE(tree->triangles, tree->owns, tree->order, tree->branch, tree->box, tree->around);
    *tree = (pliant_advance_tree){.num_triangles = 0};
}
