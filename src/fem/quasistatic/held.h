/* Constraints that act while tangent products are computed (opened.c): the springs of tools, and closed contact points
 * with a normal force. Sticking points stay at their position. Conjugate gradients keep all directions within the
 * constraints W dx + c dl = 0 (Gould, Hribar, Nocedal 2001, On the solution of equality constrained quadratic
 * programming problems arising in optimization, 3). The preconditioner is [K0 -W'; W c] instead of K0. */
#ifndef PLIANT_FEM_QUASISTATIC_HELD_H
#define PLIANT_FEM_QUASISTATIC_HELD_H

#include "fem/quasistatic/solver.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_held {
    int num_tools, tool[PLIANT_MAX_TOOLS];
    int rows, contact_rows; /* number of all rows, and of contact rows, which come first */
    int32_t *contact_row;   /* (contact_rows) 3 * point + direction; direction 0 is normal, 1 and 2 are tangential */
    double *factor;         /* (rows x rows) Cholesky factor of A */
    double *right;          /* (rows) work array */
    double *point_force;    /* (3 points) work array */
    double *pulled;         /* (3 num_free) work array; only with contact points */
} pliant_held;

/* Forces of all constraints. */
typedef struct pliant_held_forces {
    double tool[PLIANT_MAX_ROWS]; /* [N] */
    double *row;                  /* (contact_rows) [N] */
} pliant_held_forces;

/* Create the constraints after an evaluation of the state. holds: out: false if the constraint matrix is singular.
 * Errors: MEMORY. */
pliant_status pliant_held_create(const pliant_solver *solver, pliant_held *held, bool *holds);
void pliant_held_free(pliant_held *held);
/* Compute dl that keeps the constraints for v, and add U dl to v. dl: out. Errors: MEMORY. */
pliant_status pliant_held_keep(const pliant_solver *solver, const pliant_held *held, double *v, pliant_held_forces *dl);
/* Add share W' dl to v. */
void pliant_held_pull(const pliant_solver *solver, const pliant_held *held, const pliant_held_forces *dl, double share,
                      double *v);

#ifdef __cplusplus
}
#endif

#endif
