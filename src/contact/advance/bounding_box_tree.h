/* Tree of boxes around the surface's triangles during a leg. Its structure stays until the triangles change; its
 * boxes are recomputed for each leg. */
#ifndef PLIANT_CONTACT_ADVANCE_BOUNDING_BOX_TREE_H
#define PLIANT_CONTACT_ADVANCE_BOUNDING_BOX_TREE_H

#include "base/inline.h"
#include "contact/advance/advance.h"

/* Box around an object throughout a leg. */
typedef struct pliant_advance_box {
    double low[3], high[3];
} pliant_advance_box;

/* bits, shifted by 0, 1 or 2; edge k joins the corners k and k + 1 */
enum { PLIANT_OWNS_NODE = 1, PLIANT_OWNS_EDGE = 8 };

typedef struct pliant_advance_branch {
    int32_t first, count; /* triangles in order */
    int32_t child;        /* first of two children; leaf: -1 */
} pliant_advance_branch;

typedef struct pliant_advance_tree {
    int32_t num_triangles, num_branches, max_triangles;
    int32_t *triangles;            /* (num_triangles x 3) triangles for which the tree was built */
    uint8_t *owns; /* (num_triangles) bits of the nodes and edges that the triangle owns; each has one owner */
    int32_t *order;                /* (num_triangles) */
    pliant_advance_branch *branch; /* (num_branches) parents before children */
    pliant_advance_box *box;       /* (num_triangles) in order */
    pliant_advance_box *around;    /* (num_branches) */
} pliant_advance_tree;

#ifdef __cplusplus
extern "C" {
#endif

/* Rebuild the tree if the triangles have changed, without its boxes. positions: they determine the tree. Errors: MEMORY
 * (the tree is empty then). */
pliant_status pliant_advance_tree_set(pliant_advance_tree *tree, int32_t num_triangles, const int32_t *triangles,
                                      const double *positions);
/* Do the same, and update the boxes.
 * @param rest Nullable: positions at rest, which determine the tree; NULL: `from` does */
pliant_status pliant_advance_tree_update(pliant_advance_tree *tree, int32_t num_triangles, const int32_t *triangles,
                                         const double *rest, const double *from, const double *to);
void pliant_advance_tree_free(pliant_advance_tree *tree);

#ifdef __cplusplus
}
#endif

/* fmin and fmax would be function calls */
PLIANT_INLINE double pliant_advance_lower(double a, double b) { return a < b ? a : b; }
PLIANT_INLINE double pliant_advance_upper(double a, double b) { return a > b ? a : b; }

PLIANT_INLINE void pliant_advance_box_add(pliant_advance_box *box, const double x[3])
{
    for (int d = 0; d < 3; d++) {
        box->low[d] = pliant_advance_lower(box->low[d], x[d]);
        box->high[d] = pliant_advance_upper(box->high[d], x[d]);
    }
}

/* Return the box around up to three nodes throughout a leg. */
PLIANT_INLINE pliant_advance_box pliant_advance_box_of(int count, const int32_t *node, const double *from,
                                                       const double *to)
{
    const double *first = from + 3 * (size_t)node[0];
    pliant_advance_box out = {{first[0], first[1], first[2]}, {first[0], first[1], first[2]}};
    pliant_advance_box_add(&out, to + 3 * (size_t)node[0]);
    for (int c = 1; c < count; c++) {
        pliant_advance_box_add(&out, from + 3 * (size_t)node[c]);
        pliant_advance_box_add(&out, to + 3 * (size_t)node[c]);
    }
    return out;
}

PLIANT_INLINE bool pliant_advance_boxes_separated(const pliant_advance_box *a, const pliant_advance_box *b,
                                                  double margin)
{
    return (a->low[0] > b->high[0] + margin) | (b->low[0] > a->high[0] + margin) | (a->low[1] > b->high[1] + margin) |
           (b->low[1] > a->high[1] + margin) | (a->low[2] > b->high[2] + margin) | (b->low[2] > a->high[2] + margin);
}

#endif
