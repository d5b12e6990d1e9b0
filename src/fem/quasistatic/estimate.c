/* How far a step still is from where it would converge to: the largest error of a node [m].
 *
 * The mixed step of Anderson's method is the best guess of the error of an evaluated state. Of what the secants do not explain, every
 * evaluation leaves a part c; corrections of it are a geometric series (Aitken), so that it counts 1 / (1 - c) times (anderson.h).
 *
 * The state that a step ends with was most often reached blindly. It is what the next step begins with, under other loads: its elastic
 * forces stay what they are, and so does what the preconditioner makes of them where no load has changed but the tools' targets. So the
 * evaluation is done at the end of a step in place of the beginning of the next one, and the step can tell how good its end is. */
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

pliant_known pliant_posterior_begin(pliant_solver *solver)
{
    pliant_posterior *posterior = &solver->posterior;
    const bool known = posterior->kept && posterior->evaluated;
    posterior->kept = false; /* until this step has ended */
    bool loads_change = memcmp(posterior->gravity, solver->gravity, sizeof posterior->gravity) != 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        loads_change = loads_change || (solver->handles[t].by_force && memcmp(posterior->force + 3 * t, solver->handles[t].force, 3 * sizeof(double)) != 0);
    posterior->seen = known && posterior->factor_serial == solver->factor_serial && posterior->axes_serial == solver->axes_serial;
    if (!known) return PLIANT_KNOWN_NOTHING;
    const bool same = !posterior->touched && !pliant_touches_any(solver->touches) && posterior->seen && !loads_change && memcmp(posterior->force, solver->now.force, sizeof posterior->force) == 0;
    return same ? PLIANT_KNOWN_STEP : PLIANT_KNOWN_FORCES;
}

bool pliant_posterior_rests(const pliant_solver *solver)
{
    const pliant_posterior *posterior = &solver->posterior;
    /* around a patch more changes than is looked at here */
    bool same = !solver->system->basis && posterior->kept && posterior->evaluated && solver->rules.converged && !posterior->touched && !pliant_touches_any(solver->touches) &&
                memcmp(posterior->gravity, solver->gravity, sizeof posterior->gravity) == 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS && same; t++) {
        const pliant_handle *handle = solver->handles + t;
        if (!handle->active) continue;
        same = memcmp(posterior->force + 3 * t, handle->force, sizeof handle->force) == 0 && posterior->compliance[t] == handle->compliance &&
               memcmp(posterior->target + 3 * t, handle->target, sizeof handle->target) == 0;
    }
    return same;
}

void pliant_posterior_keep(pliant_solver *solver, bool evaluated)
{
    pliant_posterior *posterior = &solver->posterior;
    const size_t bytes = pliant_solver_unknowns(solver) * sizeof(double);
    posterior->kept = true;
    posterior->evaluated = evaluated;
    posterior->touched = pliant_touches_any(solver->touches);
    memcpy(posterior->gravity, solver->gravity, sizeof posterior->gravity);
    memcpy(posterior->force, solver->now.force, sizeof posterior->force);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        posterior->compliance[t] = solver->handles[t].compliance;
        memcpy(posterior->target + 3 * t, solver->handles[t].target, sizeof solver->handles[t].target);
    }
    if (!evaluated) return;
    memcpy(posterior->at.step, solver->now.step, bytes);
    memcpy(posterior->at.residual, solver->now.residual, bytes);
    memcpy(posterior->at.step_force, solver->now.step_force, sizeof posterior->at.step_force);
    posterior->factor_serial = solver->factor_serial;
    posterior->axes_serial = solver->axes_serial;
}
