/* From the solver of one body to that of the next. */
#include "fem/quasistatic/solver.h"

#include <string.h>

void pliant_solver_carry(pliant_solver *solver, const pliant_solver *from, const int32_t *source)
{
    solver->rules.most_evaluations = from->rules.most_evaluations;
    solver->rules.tolerance = from->rules.tolerance;
    solver->budget = from->budget;
    solver->clock = from->clock;
    solver->clock_user = from->clock_user;
    solver->rules.log_contraction = from->rules.log_contraction;
    for (int32_t n = 0; n < solver->system->mesh->num_nodes; n++) /* also where the next body holds what moved before */
        memcpy(solver->now.x + 3 * n, from->now.x + 3 * source[n], 3 * sizeof *solver->now.x);
}

pliant_status pliant_solver_carry_hold(pliant_solver *solver, const pliant_solver *from, int tool, int32_t count, const int32_t *nodes,
                                       const double *weights, const double *fine_positions, const double force[3])
{
    pliant_status status = pliant_solver_hold(solver, tool, count, nodes, weights, fine_positions);
    if (status != PLIANT_OK) return status;
    pliant_handle *handle = solver->handles + tool;
    const pliant_handle *before = from->handles + tool;
    handle->by_force = before->by_force;
    handle->compliance = before->compliance;
    memcpy(handle->target, before->target, sizeof handle->target);
    memcpy(handle->force, force, sizeof handle->force);
    return PLIANT_OK;
}
