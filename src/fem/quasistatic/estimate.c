/* How far a step still is from where it would converge to: the largest error of a node [m].
 *
 * The mixed step of Anderson's method is the best guess of the error of an evaluated state. It misses what neither the
 * preconditioner nor the history knows; when every evaluation leaves a part c of the error, corrections are a geometric series
 * (Aitken) and the error is 1 / (1 - c) of the next one. c is learned from the merits of the steps so far.
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
    posterior->loads_change = memcmp(posterior->gravity, solver->gravity, sizeof posterior->gravity) != 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        posterior->loads_change = posterior->loads_change || (solver->handles[t].by_force && memcmp(posterior->force + 3 * t, solver->handles[t].force, 3 * sizeof(double)) != 0);
    posterior->seen = known && posterior->factor_serial == solver->factor_serial && posterior->axes_serial == solver->axes_serial;
    if (!known) return PLIANT_KNOWN_NOTHING;
    const bool same = !posterior->touched && !pliant_touches_any(solver->touches) && posterior->seen && !posterior->loads_change && memcmp(posterior->force, solver->now.force, sizeof posterior->force) == 0;
    return same ? PLIANT_KNOWN_STEP : PLIANT_KNOWN_FORCES;
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
    if (!evaluated) return;
    memcpy(posterior->at.step, solver->now.step, bytes);
    memcpy(posterior->at.residual, solver->now.residual, bytes);
    memcpy(posterior->at.step_force, solver->now.step_force, sizeof posterior->at.step_force);
    posterior->factor_serial = solver->factor_serial;
    posterior->axes_serial = solver->axes_serial;
}

double pliant_solver_left_by_a_cycle(const double energy[PLIANT_MEASURED_CYCLES])
{
    enum { LAST = PLIANT_MEASURED_CYCLES - 1, MEAN_OF = 3 };
    const double left = pow(energy[LAST] / energy[LAST - MEAN_OF], 0.5 / MEAN_OF), most_left = 0.95;
    return left > 0 ? fmin(left, most_left) : 0;
}

/* K x = f by x += M^-1 (f - K x) for a load in every direction, small enough for the elements not to turn. What a cycle leaves in the end is
 * what it leaves of the slowest error. */
pliant_status pliant_solver_measure(pliant_solver *solver)
{
    const pliant_system *system = solver->system;
    const size_t n = pliant_solver_unknowns(solver);
    pliant_iterate *at = &solver->trial;
    double load = 1, energy[PLIANT_MEASURED_CYCLES];
    memcpy(at->x, system->mesh->rest, 3 * (size_t)system->mesh->num_nodes * sizeof *at->x);
    for (int cycle = -1; cycle < PLIANT_MEASURED_CYCLES; cycle++) { /* once more at first, to find the load */
        pliant_system_element_forces(system, at->x, solver->element_forces);
        pliant_system_gather(system, solver->element_forces, at->step);
        double most = 0;
        for (size_t i = 0; i < n; i++) at->residual[i] = load * system->gravity_mass[9 * (i / 3) + 4 * (i % 3)] - at->step[i];
        pliant_status status = pliant_preconditioner_solve(solver->preconditioner, 1, at->residual, at->step);
        if (status != PLIANT_OK) return status;
        for (size_t i = 0; i < n; i++) most = fmax(most, fabs(at->step[i]));
        if (cycle < 0) {
            if (!(most > 0) || !isfinite(most)) return PLIANT_OK;
            load = solver->rules.smallest_displacement / most;
            continue;
        }
        energy[cycle] = pliant_solver_product(solver, at->step, at->residual);
        for (size_t i = 0; i < n; i++) at->x[3 * (size_t)system->node_of_free[i / 3] + i % 3] += at->step[i];
    }
    solver->rules.cycle_contraction = pliant_solver_left_by_a_cycle(energy);
    return PLIANT_OK;
}
