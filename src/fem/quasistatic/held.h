/* What holds the tissue while tangent products are taken (opened.c): tools' springs, and points of contact that press, which stay closed, and where
 * they stick, stay there. Of constraints W dx + c dl = 0 conjugate gradients keep all directions (Gould, Hribar, Nocedal 2001, On the solution of
 * equality constrained quadratic programming problems arising in optimization, 3): preconditioned with [K0 -W'; W c] in place of K0. */
#ifndef PLIANT_FEM_QUASISTATIC_HELD_H
#define PLIANT_FEM_QUASISTATIC_HELD_H

#include "fem/quasistatic/solver.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_held {
    int num_tools, tool[PLIANT_MAX_TOOLS];
    int rows, contact_rows; /* of all; of points, which come first */
    int32_t *contact_row;   /* (contact_rows) three times the point, and 0 along its normal, 1 and 2 across */
    double *factor;         /* (rows x rows) of A, as Cholesky has it */
    double *right;          /* (rows) room */
    double *point_force;    /* (3 points) room */
    double *pulled;         /* (3 num_free) room; with points alone */
} pliant_held;

/* Forces of all that holds. */
typedef struct pliant_held_forces {
    double tool[PLIANT_MAX_ROWS]; /* [N] */
    double *row;                  /* (contact_rows) [N] */
} pliant_held_forces;

/* After an evaluation of the state. *holds: false: what it would be solved by is singular. Errors: MEMORY. */
pliant_status pliant_held_create(const pliant_solver *solver, pliant_held *held, bool *holds);
void pliant_held_free(pliant_held *held);
/* dl that keeps the constraints on v, and v += U dl. dl: out. Errors: MEMORY. */
pliant_status pliant_held_keep(const pliant_solver *solver, const pliant_held *held, double *v, pliant_held_forces *dl);
/* v += share W' dl */
void pliant_held_pull(const pliant_solver *solver, const pliant_held *held, const pliant_held_forces *dl, double share, double *v);

#ifdef __cplusplus
}
#endif

#endif
