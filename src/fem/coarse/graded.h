/* What making a graded system needs (graded.c), shared by those who find its elements (graded_elements.c) and how fine
 * nodes follow (graded_follow.c). */
#ifndef PLIANT_FEM_COARSE_GRADED_H
#define PLIANT_FEM_COARSE_GRADED_H

#include "fem/system.h"

typedef struct grading {
    pliant_system *system;
    const pliant_system *base;
    const pliant_kept *kept;   /* Nullable */
    const pliant_system *before; /* Nullable: graded, of the body before */
    const pliant_body *body;
    const pliant_mesh *fine, *coarse;
    const pliant_macros *elements; /* coarse ones, all */
    pliant_graded *graded;
    int32_t ratio[3];
    bool hexahedra;
    int32_t *tet, num_tets;    /* fine tetrahedra in refined cubes, ascending */
    int32_t *beside, num_beside; /* those in the cubes around, which are not refined */
    int32_t *now;              /* (coarse elements) its number here, or -1 */
    uint8_t *alike;            /* Nullable: (fine nodes) one of a refined cube that follows, or moves itself, as it did in the system before */
    uint8_t *free;             /* (solved nodes) an element has it, and nothing holds it */
    int32_t *point;            /* (fine nodes) the element without stiffness that stands for it, or -1; schur */
} grading;

enum { GRADED_CORNERS = 8 };

/* nodes, and their weights: what a solved node is, or follows */
typedef struct followed {
    int32_t node[GRADED_CORNERS];
    double weight[GRADED_CORNERS];
    int count;
} followed;

/* the coarse cube of a fine tetrahedron */
static inline int32_t graded_cell_of(const grading *work, int32_t tet) { return work->coarse->lattice_of_tet[work->body->coarse_of_fine[tet]] / 5; }

/* ---- graded_elements.c */
/* The elements, those at load first. Errors: MEMORY. */
pliant_status pliant_graded_elements(grading *work);

/* ---- graded_follow.c */
/* Which fine nodes are in refined cubes, what they follow, and of which that is as it was. */
void pliant_graded_followers(grading *work);
/* what a fine node of a coarse element follows, or itself: a fixed one follows what is fixed alone */
void pliant_graded_follow(const grading *work, int32_t node, followed *out);
/* The upsampling. Errors: MEMORY. */
pliant_status pliant_graded_upsample(grading *work);

#endif
