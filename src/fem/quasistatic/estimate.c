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

pliant_status pliant_hindsight_create(pliant_solver *solver)
{
    size_t n = 3 * (size_t)solver->system->num_free;
    pliant_hindsight *hindsight = &solver->hindsight;
    hindsight->at.step = pliant_calloc(n, sizeof *hindsight->at.step);
    hindsight->at.pull = pliant_calloc(n, sizeof *hindsight->at.pull);
    hindsight->load = pliant_calloc(n, sizeof *hindsight->load);
    return hindsight->at.step && hindsight->at.pull && hindsight->load ? PLIANT_OK : pliant_fail_memory("the solver");
}

void pliant_hindsight_free(pliant_solver *solver)
{
    pliant_free(solver->hindsight.at.step);
    pliant_free(solver->hindsight.at.pull);
    pliant_free(solver->hindsight.load);
}

void pliant_estimate_learn(pliant_solver *solver, double ratio)
{
    const double weight = 0.2, least = 1e-3;
    solver->log_contraction += weight * (log(fmin(fmax(ratio, least), 1)) - solver->log_contraction);
}

static double contraction(const pliant_solver *solver) { return fmin(exp(solver->log_contraction), 0.8); }

/* Largest move of a node by the mixed step. Secants are as true as the system is linear over them: taken for exact, as the
 * solver may that looks where it went, they explain small residuals by large moves that cancel. */
static double largest_move(const pliant_solver *solver, const pliant_iterate *at)
{
    const double noise = 0.01;
    double weights[PLIANT_MAX_HISTORY], largest = 0;
    int32_t m = pliant_solver_mix(solver, at, noise, weights) ? solver->num_history : 0;
    for (int32_t f = 0; f < solver->system->num_free; f++) {
        double squares = 0;
        for (size_t i = 3 * (size_t)f; i < 3 * (size_t)f + 3; i++) {
            double step = at->step[i];
            for (int32_t a = 0; a < m; a++) step -= weights[a] * (solver->history[a].x[i] + solver->history[a].step[i]);
            squares += step * step;
        }
        largest = fmax(largest, squares);
    }
    return sqrt(largest);
}

/* of the blind step that was made */
static double last_move(const pliant_solver *solver)
{
    double largest = 0;
    for (int32_t f = 0; f < solver->system->num_free; f++) {
        size_t node = 3 * (size_t)solver->system->node_of_free[f];
        double squares = 0;
        for (size_t i = node; i < node + 3; i++) squares += (solver->now.x[i] - solver->left_x[i]) * (solver->now.x[i] - solver->left_x[i]);
        largest = fmax(largest, squares);
    }
    return sqrt(largest);
}

double pliant_estimate_now(const pliant_solver *solver)
{
    double c = contraction(solver);
    /* a blind step is worth less than an evaluated one, and more than none */
    return solver->ahead ? last_move(solver) * sqrt(c) / (1 - c) : largest_move(solver, &solver->now) / (1 - c);
}

/* Back to the loads of then: the step anew where they were others. known: false where that would cost too much */
static pliant_status add_loads(pliant_solver *solver, bool *known)
{
    const size_t n = 3 * (size_t)solver->system->num_free;
    pliant_hindsight *hindsight = &solver->hindsight;
    bool same = memcmp(hindsight->load, solver->load, n * sizeof *solver->load) == 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        same = same && !(solver->handles[t].by_force && memcmp(hindsight->force + 3 * t, solver->handles[t].force, 3 * sizeof(double)) != 0);
    /* a factor, not a V-cycle; and no time that the step was given for getting better */
    *known = same || (pliant_preconditioner_refuses(solver->preconditioner) && !(solver->budget > 0));
    if (same || !*known) return PLIANT_OK;
    for (int32_t f = 0; f < solver->system->num_free; f++) {
        double change[3];
        for (int d = 0; d < 3; d++) change[d] = hindsight->load[3 * f + d] - solver->load[3 * f + d];
        pliant_turn_into(solver->turn, f, change);
        for (int d = 0; d < 3; d++) hindsight->at.pull[3 * f + d] += change[d];
    }
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        const pliant_handle *handle = solver->handles + t;
        double change[3];
        for (int d = 0; d < 3; d++) change[d] = hindsight->force[3 * t + d] - handle->force[d];
        if (handle->active && handle->by_force) pliant_handle_pull(handle, change, hindsight->at.pull);
    }
    return pliant_preconditioner_solve(solver->preconditioner, 1, hindsight->at.pull, hindsight->at.step);
}

static void swap_targets(pliant_solver *solver)
{
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        for (int d = 0; d < 3; d++) {
            double target = solver->handles[t].target[d];
            solver->handles[t].target[d] = solver->hindsight.target[3 * t + d];
            solver->hindsight.target[3 * t + d] = target;
        }
}

pliant_status pliant_hindsight_look(pliant_solver *solver)
{
    const size_t n = 3 * (size_t)solver->system->num_free;
    pliant_hindsight *hindsight = &solver->hindsight;
    pliant_iterate *at = &hindsight->at;
    hindsight->seen = false;
    /* around a patch more has changed than its loads */
    if (!hindsight->kept || solver->system->space || !isfinite(solver->now.merit)) return PLIANT_OK;
    memcpy(at->step, solver->now.step, n * sizeof *at->step);
    memcpy(at->pull, solver->now.pull, n * sizeof *at->pull);
    /* without what the tools' new targets ask for */
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        const pliant_handle *handle = solver->handles + t;
        if (!pliant_handle_is_spring(handle)) continue;
        double back[3];
        for (int d = 0; d < 3; d++) back[d] = -solver->now.step_force[3 * t + d];
        pliant_handle_pull(handle, back, at->pull);
        for (int d = 0; d < 3; d++)
            for (size_t i = 0; i < n; i++) at->step[i] += back[d] * handle->response[n * (size_t)d + i];
    }
    bool known;
    pliant_status status = add_loads(solver, &known);
    if (status != PLIANT_OK || !known) return status;
    swap_targets(solver);
    at->x = solver->now.x;
    memcpy(at->force, solver->now.force, sizeof at->force);
    hindsight->seen = pliant_solver_step_tools(solver, at);
    at->x = NULL;
    swap_targets(solver);
    return PLIANT_OK;
}

double pliant_hindsight_tell(const pliant_solver *solver)
{
    if (!solver->hindsight.seen) return solver->foreseen;
    double c = contraction(solver);
    /* the next step's corrections are known too, so that c^2 is missed; but a V-cycle hides the same slow errors from both */
    return largest_move(solver, &solver->hindsight.at) / (1 - (pliant_preconditioner_refuses(solver->preconditioner) ? c * c : c));
}

void pliant_hindsight_keep(pliant_solver *solver)
{
    pliant_hindsight *hindsight = &solver->hindsight;
    memcpy(hindsight->load, solver->load, 3 * (size_t)solver->system->num_free * sizeof *solver->load);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        memcpy(hindsight->force + 3 * t, solver->handles[t].force, 3 * sizeof(double));
        memcpy(hindsight->target + 3 * t, solver->handles[t].target, 3 * sizeof(double));
    }
    hindsight->kept = true;
}
