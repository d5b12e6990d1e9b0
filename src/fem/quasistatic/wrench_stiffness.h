/* Derivative of a tool's wrench with respect to its pose, in the solver's last linearization. */
#ifndef PLIANT_FEM_QUASISTATIC_WRENCH_STIFFNESS_H
#define PLIANT_FEM_QUASISTATIC_WRENCH_STIFFNESS_H

#include "fem/quasistatic/solver.h"

/* Compute the 6 x 6 derivative of force and torque about the tip with respect to translation and rotation vector of the
 * tool. It is zero without grasp and contact.
 * @param known  Out: false if the response of the grasped nodes is not available.
 * Errors: MEMORY. */
pliant_status pliant_solver_stiffness(const pliant_solver *solver, int tool, const double tip[3], double stiffness[36],
                                      bool *known);

#endif
