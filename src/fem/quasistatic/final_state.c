/* Error estimate of a step: the largest distance of a node from its converged position [m].
 *
 * The mixed step of Anderson's method estimates the error of an evaluated state. Each evaluation leaves the fraction c
 * of an error that no secant explains. The corrections are a geometric series (Aitken), so the unexplained part counts
 * 1 / (1 - c) times (anderson.h).
 *
 * The final state of a step was usually reached blindly. The next step starts there, with other loads. Its elastic
 * forces stay valid. So does the preconditioned step, if only the tools' targets have changed. The evaluation is
 * therefore done at the end of a step instead of the start of the next one, and the step can report its final error. */
#include "base/fail.h"
#include "fem/quasistatic/pressure.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

pliant_status pliant_final_state_create(pliant_solver *solver)
{
    size_t n = 3 * (size_t)solver->system->num_free;
    pliant_final_state *final_state = &solver->final_state;
    final_state->at.step = pliant_calloc(n, sizeof *final_state->at.step);
    final_state->at.residual = pliant_calloc(n, sizeof *final_state->at.residual);
    if (!final_state->at.step || !final_state->at.residual) return pliant_fail_memory("the solver");
    return pliant_pressure_allocate(solver->pressures, &final_state->at.pressure_step, NULL);
}

void pliant_final_state_free(pliant_solver *solver)
{
    pliant_free(solver->final_state.at.step);
    pliant_free(solver->final_state.at.residual);
    pliant_free(solver->final_state.at.pressure_step);
}

void pliant_final_state_store(pliant_solver *solver)
{
    pliant_final_state *final_state = &solver->final_state;
    const size_t bytes = pliant_solver_unknowns(solver) * sizeof(double);
    memcpy(final_state->at.step, solver->now.step, bytes);
    memcpy(final_state->at.residual, solver->now.residual, bytes);
    pliant_pressure_copy(solver, solver->now.pressure_step, final_state->at.pressure_step);
    memcpy(final_state->at.step_force, solver->now.step_force, sizeof final_state->at.step_force);
}
