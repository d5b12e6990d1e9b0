/* Pressures of nearly incompressible tissue in a step. Without such tissue, every function does nothing. */
#ifndef PLIANT_FEM_QUASISTATIC_PRESSURE_H
#define PLIANT_FEM_QUASISTATIC_PRESSURE_H

#include "fem/quasistatic/solver.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Allocate arrays of pressures that are NULL. second: Nullable. Errors: MEMORY. */
pliant_status pliant_pressure_allocate(const pliant_pressures *pressures, double **first, double **second);
/* Allocate the arrays for a step. Errors: MEMORY. */
pliant_status pliant_pressure_wake(pliant_solver *solver);
void pliant_pressure_copy(const pliant_solver *solver, const double *from, double *to);
/* Compute the changes of volume of a state, and add the forces of its pressures: elastic (num_free x 3) [N]. */
void pliant_pressure_forces(pliant_solver *solver, const pliant_iterate *at, double *elastic);
/* Compute the changes of volume of a state. */
void pliant_pressure_find(pliant_solver *solver, const pliant_iterate *at);
/* Compute the step of the pressures after the step of the nodes. */
void pliant_pressure_step(pliant_solver *solver, pliant_iterate *at);
/* Compute pressure times volume of every element: out (elements) [N m]. */
void pliant_pressure_times_volume(const pliant_solver *solver, double *out);
/* Return the product of two changes of pressure in the merit's norm [J]. */
double pliant_pressure_energy(const pliant_solver *solver, const double *a, const double *b);
/* Write the pressures of a secant. */
void pliant_pressure_remember(const pliant_solver *solver, const pliant_iterate *from, const pliant_iterate *to,
                              pliant_secant *secant);
/* Set the trial's pressures from the present state and the weights of the secants. */
void pliant_pressure_propose(pliant_solver *solver, const double weights[PLIANT_MAX_HISTORY]);
/* Take over the pressures from before a cut, cell by cell. Errors: MEMORY. */
pliant_status pliant_pressure_carry(pliant_solver *solver, const pliant_solver *from);

#ifdef __cplusplus
}
#endif
#endif
