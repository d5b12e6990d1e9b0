/* How far a step still is from where it would converge to: the largest error of a node [m].
 *
 * The mixed step of Anderson's method is the best guess of the error of an evaluated state. It misses what neither the
 * preconditioner nor the history knows; when every evaluation leaves a part c of the error, corrections are a geometric series
 * (Aitken) and the error is 1 / (1 - c) of the next one. c is learned from the merits of the steps so far.
 *
 * The state that a step ends with has seldom been evaluated: its last correction was made blindly. But the next step begins with
 * its evaluation, for other loads; the system is linear in those, so that the residual for the old ones costs little, and the
 * secants of the next step help to judge it. */
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
    posterior->load = pliant_calloc(n, sizeof *posterior->load);
    return posterior->at.step && posterior->at.residual && posterior->load ? PLIANT_OK : pliant_fail_memory("the solver");
}

void pliant_posterior_free(pliant_solver *solver)
{
    pliant_free(solver->posterior.at.step);
    pliant_free(solver->posterior.at.residual);
    pliant_free(solver->posterior.load);
}

/* Back to the loads of then: the step anew where they were others. known: false where that would cost too much */
static pliant_status add_loads(pliant_solver *solver, bool *known)
{
    const size_t n = 3 * (size_t)solver->system->num_free;
    pliant_posterior *posterior = &solver->posterior;
    bool same = memcmp(posterior->load, solver->load, n * sizeof *solver->load) == 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        same = same && !(solver->handles[t].by_force && memcmp(posterior->force + 3 * t, solver->handles[t].force, 3 * sizeof(double)) != 0);
    /* a factor, not a V-cycle; and no time that the step was given for getting better */
    *known = same || (pliant_preconditioner_refuses(solver->preconditioner) && !(solver->budget > 0));
    if (same || !*known) return PLIANT_OK;
    for (int32_t f = 0; f < solver->system->num_free; f++) {
        double change[3];
        for (int d = 0; d < 3; d++) change[d] = posterior->load[3 * f + d] - solver->load[3 * f + d];
        pliant_into_node_axes(solver->rotations, f, change);
        for (int d = 0; d < 3; d++) posterior->at.residual[3 * f + d] += change[d];
    }
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        const pliant_handle *handle = solver->handles + t;
        double change[3];
        for (int d = 0; d < 3; d++) change[d] = posterior->force[3 * t + d] - handle->force[d];
        if (handle->active && handle->by_force) pliant_handle_pull(handle, change, posterior->at.residual);
    }
    return pliant_preconditioner_solve(solver->preconditioner, 1, posterior->at.residual, posterior->at.step);
}

static void swap_targets(pliant_solver *solver)
{
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        for (int d = 0; d < 3; d++) {
            double target = solver->handles[t].target[d];
            solver->handles[t].target[d] = solver->posterior.target[3 * t + d];
            solver->posterior.target[3 * t + d] = target;
        }
}

pliant_status pliant_posterior_look(pliant_solver *solver)
{
    const size_t n = 3 * (size_t)solver->system->num_free;
    pliant_posterior *posterior = &solver->posterior;
    pliant_iterate *at = &posterior->at;
    posterior->seen = false;
    /* around a patch more has changed than its loads */
    if (!posterior->kept || solver->system->basis || !isfinite(solver->now.merit)) return PLIANT_OK;
    memcpy(at->step, solver->now.step, n * sizeof *at->step);
    memcpy(at->residual, solver->now.residual, n * sizeof *at->residual);
    /* without what the tools' new targets ask for */
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        const pliant_handle *handle = solver->handles + t;
        if (!pliant_handle_is_spring(handle)) continue;
        double back[3];
        for (int d = 0; d < 3; d++) back[d] = -solver->now.step_force[3 * t + d];
        pliant_handle_pull(handle, back, at->residual);
        for (int d = 0; d < 3; d++)
            for (size_t i = 0; i < n; i++) at->step[i] += back[d] * handle->response[n * (size_t)d + i];
    }
    bool known;
    pliant_status status = add_loads(solver, &known);
    if (status != PLIANT_OK || !known) return status;
    swap_targets(solver);
    at->x = solver->now.x;
    memcpy(at->force, solver->now.force, sizeof at->force);
    posterior->seen = pliant_solver_step_tools(solver, at);
    at->x = NULL;
    swap_targets(solver);
    return PLIANT_OK;
}

double pliant_posterior_tell(const pliant_solver *solver)
{
    if (!solver->posterior.seen) return solver->foreseen;
    double c = pliant_anderson_contraction(&solver->rules);
    /* the next step's corrections are known too, so that c^2 is missed; but a V-cycle hides the same slow errors from both */
    return pliant_secants_left(solver, &solver->posterior.at) / (1 - (pliant_preconditioner_refuses(solver->preconditioner) ? c * c : c));
}

void pliant_posterior_keep(pliant_solver *solver)
{
    pliant_posterior *posterior = &solver->posterior;
    memcpy(posterior->load, solver->load, 3 * (size_t)solver->system->num_free * sizeof *solver->load);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        memcpy(posterior->force + 3 * t, solver->handles[t].force, 3 * sizeof(double));
        memcpy(posterior->target + 3 * t, solver->handles[t].target, 3 * sizeof(double));
    }
    posterior->kept = true;
}

/* K x = f by x += M^-1 (f - K x) for a load in every direction, small enough for the elements not to turn. What a cycle leaves in the end is
 * what it leaves of the slowest error. */
pliant_status pliant_solver_measure(pliant_solver *solver)
{
    enum { CYCLES = 8, LAST = 3 };
    const pliant_system *system = solver->system;
    const size_t n = pliant_solver_unknowns(solver);
    pliant_iterate *at = &solver->trial;
    double load = 1, energy[CYCLES];
    memcpy(at->x, system->mesh->rest, 3 * (size_t)system->mesh->num_nodes * sizeof *at->x);
    for (int cycle = -1; cycle < CYCLES; cycle++) { /* once more at first, to find the load */
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
    const double left = pow(energy[CYCLES - 1] / energy[CYCLES - 1 - LAST], 0.5 / LAST), most_left = 0.95;
    if (left > 0) solver->rules.cycle_contraction = fmin(left, most_left);
    return PLIANT_OK;
}
