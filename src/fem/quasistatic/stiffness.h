/* How the forces of a tool change with its pose, in the solver's last linearization. */
#ifndef PLIANT_FEM_QUASISTATIC_STIFFNESS_H
#define PLIANT_FEM_QUASISTATIC_STIFFNESS_H

#include "fem/quasistatic/solver.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Of force and torque about the tip by translation and rotation vector of the tool; nothing held and touched: zeros.
 * known: false where the answers of what it holds are not there. Errors: MEMORY. */
pliant_status pliant_solver_stiffness(const pliant_solver *solver, int tool, const double tip[3], double stiffness[36], bool *known);

#ifdef __cplusplus
}
#endif
#endif
