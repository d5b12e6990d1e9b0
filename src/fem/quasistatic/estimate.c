/* How far a step still is from where it would converge to: the largest error of a node [m].
 *
 * The mixed step of Anderson's method is the best guess of the error of an evaluated state. Of what the secants do not
 * explain, every evaluation leaves a part c; corrections of it are a geometric series (Aitken), so that it counts 1 /
 * (1 - c) times (anderson.h).
 *
 * The state that a step ends with was most often reached blindly. It is what the next step begins with, under other
 * loads: its elastic forces stay what they are, and so does what the preconditioner makes of them where no load has
 * changed but the tools' targets. So the evaluation is done at the end of a step in place of the beginning of the next
 * one, and the step can tell how good its end is. */
#include "base/fail.h"
#include "fem/quasistatic/solver.h"
#include "pliant/memory.h"

#include <math.h>
#include <string.h>

pliant_status pliant_posterior_create(pliant_solver *solver)
{
    size_t n = 3 * (size_t)solver->system->num_free;
    pliant_posterior *posterior = &solver->posterior;
    posterior->at.step = pliant_calloc(n, sizeof *posterior->at.step);
    posterior->at.residual = pliant_calloc(n, sizeof *posterior->at.residual);
    return posterior->at.step && posterior->at.residual ? PLIANT_OK : pliant_fail_memory("the solver");
}

void pliant_posterior_free(pliant_solver *solver)
{
    pliant_free(solver->posterior.at.step);
    pliant_free(solver->posterior.at.residual);
}

void pliant_posterior_keep(pliant_solver *solver)
{
    pliant_posterior *posterior = &solver->posterior;
    const size_t bytes = pliant_solver_unknowns(solver) * sizeof(double);
    memcpy(posterior->at.step, solver->now.step, bytes);
    memcpy(posterior->at.residual, solver->now.residual, bytes);
    memcpy(posterior->at.step_force, solver->now.step_force, sizeof posterior->at.step_force);
}
