/* Constraints that act while tangent products are computed (newton_after_cut.c): the springs of tools, and closed
 * contact points with a normal force. Sticking points stay at their position. Conjugate gradients keep all directions
 * within the constraints W dx + c dl = 0 (Gould, Hribar, Nocedal 2001, On the solution of equality constrained
 * quadratic programming problems arising in optimization, 3). The preconditioner is [K0 -W'; W c] instead of K0. */
#ifndef PLIANT_FEM_QUASISTATIC_ACTIVE_SET_H
#define PLIANT_FEM_QUASISTATIC_ACTIVE_SET_H

#include "fem/quasistatic/solver.h"

typedef struct pliant_active_set {
    int num_tools, tool[PLIANT_MAX_TOOLS];
    int rows, contact_rows; /* number of all rows, and of contact rows, which come first */
    int32_t *contact_row;   /* (contact_rows) 3 * point + direction; direction 0 is normal, 1 and 2 are tangential */
    double *factor;         /* (rows x rows) Cholesky factor of A */
    double *right;          /* (rows) work array */
    double *point_force;    /* (3 points) work array */
    double *pulled;         /* (3 num_free) work array; only with contact points */
} pliant_active_set;

/* Forces of all constraints. */
typedef struct pliant_active_forces {
    double tool[PLIANT_MAX_ROWS]; /* [N] */
    double *row;                  /* (contact_rows) [N] */
} pliant_active_forces;

/* Create the constraints after an evaluation of the state. holds: out: false if the constraint matrix is singular.
 * Errors: MEMORY. */
pliant_status pliant_active_set_create(const pliant_solver *solver, pliant_active_set *active, bool *holds);
void pliant_active_set_free(pliant_active_set *active);
/* Compute dl that keeps the constraints for v, and add U dl to v. dl: out. Errors: MEMORY. */
pliant_status pliant_active_set_project(const pliant_solver *solver, const pliant_active_set *active, double *v,
                                        pliant_active_forces *dl);
/* Add share W' dl to v. */
void pliant_active_set_add_forces(const pliant_solver *solver, const pliant_active_set *active,
                                  const pliant_active_forces *dl, double fraction, double *v);

#endif
