/* Work data for building a graded system (graded.c). Shared by the construction of elements (graded_elements.c) and of
 * the upsampling (graded_upsample.c). */
#ifndef PLIANT_FEM_COARSE_GRADED_H
#define PLIANT_FEM_COARSE_GRADED_H

#include "fem/system.h"

typedef struct grading {
    pliant_system *system;
    const pliant_system *base;
    const pliant_unchanged_elements *kept; /* Nullable */
    const pliant_system *before;           /* Nullable: the graded system before the cut */
    const pliant_body *body;
    const pliant_mesh *fine, *coarse;
    const pliant_macros *elements; /* all coarse elements */
    pliant_graded *graded;
    int32_t ratio[3];
    bool hexahedra;
    int32_t *tet, num_tets;          /* fine tetrahedra in refined cubes, ascending */
    int32_t *adjacent, num_adjacent; /* fine tetrahedra in adjacent cubes that are not refined */
    int32_t *now;                    /* (coarse elements) number in the graded system, or -1 */
    /* Nullable: (fine nodes) nonzero: a node of a refined cube that follows the same nodes, or moves freely, as before
     * the cut. */
    uint8_t *alike;
    uint8_t *free;             /* (solved nodes) nonzero: an element uses the node, and it is not fixed */
    /* (fine nodes) element without stiffness that carries the node's shape function, or -1; schur only. */
    int32_t *point;
} grading;

enum { GRADED_CORNERS = 8 };

/* Nodes and weights that a solved node follows. A free node follows itself. */
typedef struct followed {
    int32_t node[GRADED_CORNERS];
    double weight[GRADED_CORNERS];
    int count;
} followed;

/* Return the coarse cube of a fine tetrahedron. */
static inline int32_t graded_cell_of(const grading *work, int32_t tet)
{
    return work->coarse->lattice_of_tet[work->body->coarse_of_fine[tet]] / 5;
}

/* ---- Implemented in graded_elements.c. */
/* Build the elements, coarse elements first. Errors: MEMORY. */
pliant_status pliant_graded_elements(grading *work);

/* ---- Implemented in graded_upsample.c. */
/* Find the fine nodes in refined cubes, the nodes that they follow, and the nodes that are unchanged. */
void pliant_graded_followers(grading *work);
/* Compute the nodes that a fine node of a coarse element follows, or the node itself. A fixed node follows only fixed
 * nodes. */
void pliant_graded_follow(const grading *work, int32_t node, followed *out);
/* Build the upsampling. Errors: MEMORY. */
pliant_status pliant_graded_upsample(grading *work);

#endif
