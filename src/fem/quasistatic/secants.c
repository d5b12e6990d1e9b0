/* History of Anderson's method: secants, their weights, and proposals. */
#include "base/fail.h"
#include "base/lanes.h"
#include "base/buffer.h"
#include "fem/quasistatic/secant_equations.h"
#include "fem/quasistatic/pressure.h"
#include "base/memory.h"

#include <string.h>

pliant_status pliant_secants_create(const pliant_system *system, int32_t count, pliant_secant *secants)
{
    size_t n = 3 * (size_t)system->num_free;
    for (int32_t h = 0; h < count; h++) {
        pliant_secant *secant = secants + h;
        secant->x = pliant_malloc(n, sizeof *secant->x); /* written by pliant_solver_store_secant */
        secant->step = pliant_malloc(n, sizeof *secant->step);
        secant->residual = pliant_malloc(n, sizeof *secant->residual);
        if (!secant->x || !secant->step || !secant->residual) return pliant_fail_memory("the solver's history");
    }
    return PLIANT_OK;
}

void pliant_secants_free(pliant_secant secants[PLIANT_MAX_HISTORY])
{
    for (int32_t h = 0; h < PLIANT_MAX_HISTORY; h++) {
        PLIANT_FREE(secants[h].x, secants[h].step, secants[h].residual, secants[h].pressure, secants[h].pressure_step);
    }
}

void pliant_solver_reset_after_move(pliant_solver *solver)
{
    pliant_solver_drop_history(solver);
    pliant_anderson_reset_after_move(&solver->rules);
    pliant_evaluations_clear(&solver->evaluation_history);
    solver->in_use.evaluations =
        pliant_get_quasistatic_settings().rotation_interval; /* the axes rotate in the next step */
    solver->is_after_cut = false;
}

void pliant_solver_store_secant(pliant_solver *solver, int32_t place, const pliant_iterate *from,
                                const pliant_iterate *to)
{
    pliant_secant *secant = solver->history + place;
    const pliant_system *system = solver->system;
    const int32_t *node = system->node_of_free;
#pragma omp parallel for schedule(static) \
    num_threads(system->num_threads) if (system->num_free >= PLIANT_NODES_FOR_THREADS)
    for (int32_t f = 0; f < system->num_free; f++) {
        for (int d = 0; d < 3; d++) {
            size_t i = 3 * (size_t)f + (size_t)d, x = 3 * (size_t)node[f] + (size_t)d;
            secant->x[i] = to->x[x] - from->x[x];
            secant->step[i] = to->step[i] - from->step[i];
            secant->residual[i] = to->residual[i] - from->residual[i];
        }
        pliant_into_node_axes(solver->rotations, f, secant->x + 3 * f);
    }
    for (int r = 0; r < PLIANT_MAX_ROWS; r++) {
        secant->force[r] = to->force[r] - from->force[r];
        secant->step_force[r] = to->step_force[r] - from->step_force[r];
    }
    pliant_pressure_remember(solver, from, to, secant);
    for (int32_t h = 0; h < PLIANT_MAX_HISTORY; h++) {
        if (solver->rules.number[h] == 0) continue;
        const pliant_secant *other = solver->history + h;
        double product = pliant_solver_product(solver, secant->step, other->residual) +
                         pliant_solver_spring_energy(solver, secant->step_force, other->step_force) +
                         pliant_pressure_energy(solver, secant->pressure_step, other->pressure_step);
        solver->gram[place * PLIANT_MAX_HISTORY + h] = solver->gram[h * PLIANT_MAX_HISTORY + place] = product;
    }
}

/* Compute the products of the secants' steps with a residual. Return false if there are no secants. */
static bool multiply_secants(const pliant_solver *solver, const pliant_iterate *at, double along[PLIANT_MAX_HISTORY])
{
    bool any = false;
    for (int32_t h = 0; h < PLIANT_MAX_HISTORY; h++) {
        const pliant_secant *secant = solver->history + h;
        along[h] = 0;
        if (solver->rules.number[h] == 0) continue;
        any = true;
        along[h] = pliant_solver_product(solver, secant->step, at->residual) +
                   pliant_solver_spring_energy(solver, secant->step_force, at->step_force) +
                   pliant_pressure_energy(solver, secant->pressure_step, at->pressure_step);
    }
    return any;
}

/* Compute the weights of the secants (secant_equations.h). */
static bool mix_secants(const pliant_solver *solver, const double along[PLIANT_MAX_HISTORY], bool estimates,
                        double weights[PLIANT_MAX_HISTORY])
{
    pliant_secant_equations equations;
    return pliant_secant_weights(0, 1, &solver->rules, solver->gram, along, estimates, &equations, weights);
}

/* Block size: the numbers of all secants in a block fit in a core's cache. */
enum { PART_NODES = 32, PART = 3 * PART_NODES };

/* Compute a step - sum of weights (x + a step of the secants) for a block of numbers. */
PLIANT_VECTORIZED static void combine(const pliant_secant *history, const double *weights, double a, const double *step,
                                      size_t first, size_t count, double *out)
{
    for (size_t i = 0; i < count; i++) out[i] = a * step[first + i];
    for (int32_t h = 0; h < PLIANT_MAX_HISTORY; h++) {
        if (weights[h] == 0) continue;
        const double weight = weights[h], *x = history[h].x + first, *of_secant = history[h].step + first;
        for (size_t i = 0; i < count; i++) out[i] -= weight * (x[i] + a * of_secant[i]);
    }
}

/* Return the squared maximum over the nodes. */
static double longest_of(const double *v, int32_t nodes)
{
    double longest = 0;
    for (int32_t n = 0; n < nodes; n++)
        longest = fmax(longest, v[3 * n] * v[3 * n] + v[3 * n + 1] * v[3 * n + 1] + v[3 * n + 2] * v[3 * n + 2]);
    return longest;
}

static int32_t nodes_of_part(const pliant_system *system, int32_t first)
{
    return system->num_free - first < PART_NODES ? system->num_free - first : PART_NODES;
}

double pliant_secants_error(const pliant_solver *solver, const pliant_iterate *at)
{
    double along[PLIANT_MAX_HISTORY], weights[PLIANT_MAX_HISTORY], largest = 0;
    multiply_secants(solver, at, along);
    mix_secants(solver, along, true, weights);
    const pliant_system *system = solver->system;
    const double unexplained = pliant_anderson_error_factor(&solver->rules);
#pragma omp parallel for schedule(static) num_threads(system->num_threads) \
    reduction(max \
              : largest) if (system->num_free >= PLIANT_NODES_FOR_THREADS)
    for (int32_t first = 0; first < system->num_free; first += PART_NODES) {
        const int32_t nodes = nodes_of_part(system, first);
        double left[PART];
        combine(solver->history, weights, unexplained, at->step, 3 * (size_t)first, 3 * (size_t)nodes, left);
        largest = fmax(largest, longest_of(left, nodes));
    }
    return sqrt(largest);
}

/* Mix the tools' forces. */
static void propose_forces(pliant_solver *solver, const double weights[PLIANT_MAX_HISTORY])
{
    for (int r = 0; r < PLIANT_MAX_ROWS; r++) {
        double step = solver->now.step_force[r];
        for (int32_t h = 0; h < PLIANT_MAX_HISTORY; h++)
            if (weights[h] != 0) step -= weights[h] * (solver->history[h].force[r] + solver->history[h].step_force[r]);
        solver->trial.force[r] = solver->now.force[r] + solver->rules.damping * step;
    }
}

bool pliant_solver_propose(pliant_solver *solver, double *left, double *made)
{
    const pliant_system *system = solver->system;
    const pliant_anderson *rules = &solver->rules;
    const pliant_iterate *at = &solver->now;
    double along[PLIANT_MAX_HISTORY], weights[PLIANT_MAX_HISTORY] = {0}, likely[PLIANT_MAX_HISTORY] = {0},
                                      *x = solver->trial.x;
    bool mixed = false;
    if (multiply_secants(solver, at, along)) {
        mixed = rules->uses_secants && mix_secants(solver, along, false, weights);
        mix_secants(solver, along, true, likely);
    }
    const double unexplained = pliant_anderson_error_factor(rules);
    double max_left = 0, max_made = 0;
    memcpy(x, at->x, 3 * (size_t)system->mesh->num_nodes * sizeof *x);
#pragma omp parallel for schedule(static) num_threads(system->num_threads) \
    reduction(max \
              : max_left, max_made) if (system->num_free >= PLIANT_NODES_FOR_THREADS)
    for (int32_t first = 0; first < system->num_free; first += PART_NODES) {
        const int32_t nodes = nodes_of_part(system, first);
        double step[PART], estimate[PART];
        combine(solver->history, weights, 1, at->step, 3 * (size_t)first, 3 * (size_t)nodes, step);
        combine(solver->history, likely, unexplained, at->step, 3 * (size_t)first, 3 * (size_t)nodes, estimate);
        max_left = fmax(max_left, longest_of(estimate, nodes));
        max_made = fmax(max_made, longest_of(step, nodes));
        for (int32_t n = 0; n < nodes; n++) {
            pliant_from_node_axes(solver->rotations, first + n, step + 3 * n);
            for (int d = 0; d < 3; d++)
                x[3 * (size_t)system->node_of_free[first + n] + (size_t)d] += rules->damping * step[3 * n + d];
        }
    }
    propose_forces(solver, weights);
    pliant_pressure_propose(solver, weights);
    *left = sqrt(max_left);
    *made = rules->damping * sqrt(max_made);
    return mixed;
}
