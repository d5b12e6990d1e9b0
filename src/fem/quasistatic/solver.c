#include "base/fail.h"
#include "fem/linear/dense.h"
#include "fem/patch/space.h"
#include "fem/quasistatic/anderson.h"
#include "fem/quasistatic/solver.h"
#include "pliant/memory.h"

#include <math.h>
#include <string.h>

static size_t unknowns(const pliant_solver *solver) { return 3 * (size_t)solver->system->num_free; }

/* Fewer nodes than this are sooner done by one thread. */
enum { NODES_FOR_THREADS = 4096, PRODUCT_PARTS = 32 };

/* a . b over the unknowns, in parts that do not depend on the number of threads */
double pliant_solver_product(const pliant_solver *solver, const double *a, const double *b)
{
    const size_t n = unknowns(solver);
    if (solver->system->num_free < NODES_FOR_THREADS) return pliant_dot(n, a, b);
    double parts[PRODUCT_PARTS], sum = 0;
#pragma omp parallel for schedule(static) num_threads(solver->system->num_threads)
    for (int p = 0; p < PRODUCT_PARTS; p++) {
        size_t from = n * (size_t)p / PRODUCT_PARTS, to = n * (size_t)(p + 1) / PRODUCT_PARTS;
        parts[p] = pliant_dot(to - from, a + from, b + from);
    }
    for (int p = 0; p < PRODUCT_PARTS; p++) sum += parts[p];
    return sum;
}

/* ---- tools: rows of W */

/* out += W v, v in the nodes' own axes */
static void apply_rows(const pliant_handle *handle, const double *v, double out[3])
{
    for (int32_t h = 0; h < handle->count; h++) {
        const double *block = handle->turned + 9 * h, *at = v + 3 * handle->unknown[h];
        for (int r = 0; r < 3; r++) out[r] += block[3 * r] * at[0] + block[3 * r + 1] * at[1] + block[3 * r + 2] * at[2];
    }
}

static void pull_by(const pliant_handle *handle, const double *blocks, const double force[3], double *v)
{
    for (int32_t h = 0; h < handle->count; h++) {
        const double *block = blocks + 9 * h;
        double *at = v + 3 * handle->unknown[h];
        for (int c = 0; c < 3; c++) at[c] += block[c] * force[0] + block[3 + c] * force[1] + block[6 + c] * force[2];
    }
}

void pliant_handle_pull(const pliant_handle *handle, const double force[3], double *v) { pull_by(handle, handle->turned, force, v); }

/* y = origin + W x, x over all nodes of the solved mesh */
static void held_point(const pliant_solver *solver, const pliant_handle *handle, const double *x, double out[3])
{
    memcpy(out, handle->origin, 3 * sizeof *out);
    for (int32_t h = 0; h < handle->count; h++) {
        const double *block = handle->block + 9 * h, *at = x + 3 * solver->system->node_of_free[handle->unknown[h]];
        for (int r = 0; r < 3; r++) out[r] += block[3 * r] * at[0] + block[3 * r + 1] * at[1] + block[3 * r + 2] * at[2];
    }
}

void pliant_solver_release(pliant_solver *solver, int tool)
{
    pliant_handle *handle = solver->handles + tool;
    pliant_free(handle->unknown);
    pliant_free(handle->block);
    pliant_free(handle->turned);
    pliant_free(handle->response);
    memset(handle, 0, sizeof *handle);
    pliant_solver_forget(solver);
}

void pliant_solver_turned(pliant_solver *solver)
{
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        pliant_handle *handle = solver->handles + t;
        if (handle->count == 0) continue;
        memcpy(handle->turned, handle->block, 9 * (size_t)handle->count * sizeof *handle->block);
        for (int32_t row = 0; row < 3 * handle->count; row++)
            pliant_turn_into(solver->turn, handle->unknown[row / 3], handle->turned + 3 * row);
    }
}

pliant_status pliant_solver_hold(pliant_solver *solver, int tool, int32_t count, const int32_t *nodes, const double *weights,
                                 const double *fine_positions)
{
    const pliant_system *system = solver->system;
    pliant_handle *old = solver->handles + tool, handle = *old;
    double *dense = solver->dense_weights;
    memset(dense, 0, 9 * (size_t)system->num_free * sizeof *dense);
    pliant_upsample_weights(system, solver->now.x, count, nodes, weights, dense);
    handle.count = 0;
    for (int32_t n = 0; n < system->num_free; n++)
        for (int m = 0; m < 9; m++)
            if (dense[9 * n + m] != 0) {
                handle.count++;
                break;
            }
    handle.unknown = NULL;
    handle.block = handle.turned = handle.response = NULL;
    if (handle.count > 0) {
        handle.unknown = pliant_calloc((size_t)handle.count, sizeof *handle.unknown);
        handle.block = pliant_calloc((size_t)handle.count, 9 * sizeof *handle.block);
        handle.turned = pliant_calloc((size_t)handle.count, 9 * sizeof *handle.turned);
        handle.response = pliant_calloc(3 * unknowns(solver), sizeof *handle.response);
        if (!handle.unknown || !handle.block || !handle.turned || !handle.response) {
            pliant_free(handle.unknown);
            pliant_free(handle.block);
            pliant_free(handle.turned);
            pliant_free(handle.response);
            return pliant_fail_memory("a tool's hold");
        }
    }
    int32_t next = 0;
    for (int32_t n = 0; n < system->num_free; n++) {
        bool used = false;
        for (int m = 0; m < 9; m++) used = used || dense[9 * n + m] != 0;
        if (!used) continue;
        handle.unknown[next] = n;
        memcpy(handle.block + 9 * next++, dense + 9 * n, 9 * sizeof *dense);
    }
    bool was_active = old->active;
    pliant_free(old->unknown);
    pliant_free(old->block);
    pliant_free(old->turned);
    pliant_free(old->response);
    *old = handle;
    old->active = true;
    old->response_of = 0;
    if (!was_active) memset(old->force, 0, sizeof old->force);
    double y[3] = {0, 0, 0}, moved[3];
    for (int32_t h = 0; h < count; h++)
        for (int d = 0; d < 3; d++) y[d] += weights[h] * fine_positions[3 * nodes[h] + d];
    memset(old->origin, 0, sizeof old->origin);
    held_point(solver, old, solver->now.x, moved);
    for (int d = 0; d < 3; d++) old->origin[d] = y[d] - moved[d];
    pliant_solver_turned(solver);
    pliant_solver_forget(solver);
    return PLIANT_OK;
}

static pliant_status update_responses(pliant_solver *solver)
{
    size_t n = unknowns(solver);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        pliant_handle *handle = solver->handles + t;
        if (!handle->active || handle->by_force || handle->count == 0 || handle->response_of == solver->factor_serial) continue;
        memset(handle->response, 0, 3 * n * sizeof *handle->response);
        for (int d = 0; d < 3; d++) {
            double unit[3] = {d == 0, d == 1, d == 2};
            pliant_handle_pull(handle, unit, handle->response + n * (size_t)d);
        }
        pliant_status status = pliant_preconditioner_solve(solver->preconditioner, 3, handle->response, handle->response);
        if (status != PLIANT_OK) return status;
        handle->response_of = solver->factor_serial;
    }
    return PLIANT_OK;
}

/* dl = S^-1 (e - W g0), and the step with it: g = g0 + Z dl, K0 g = r + W' dl */
bool pliant_solver_step_tools(const pliant_solver *solver, pliant_iterate *at)
{
    const pliant_handle *list[PLIANT_MAX_TOOLS];
    int index[PLIANT_MAX_TOOLS], count = 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        if (pliant_handle_is_spring(solver->handles + t)) {
            index[count] = t;
            list[count++] = solver->handles + t;
        }
    memset(at->step_force, 0, sizeof at->step_force);
    if (count == 0) return true;
    size_t n = unknowns(solver);
    double s[PLIANT_MAX_ROWS * PLIANT_MAX_ROWS] = {0}, right[PLIANT_MAX_ROWS];
    int rows = 3 * count;
    for (int a = 0; a < count; a++) {
        double y[3], w[3] = {0, 0, 0};
        held_point(solver, list[a], at->x, y);
        apply_rows(list[a], at->step, w);
        for (int d = 0; d < 3; d++)
            right[3 * a + d] = list[a]->target[d] - y[d] - list[a]->compliance * at->force[3 * index[a] + d] - w[d];
        for (int b = 0; b < count; b++)
            for (int d = 0; d < 3; d++) {
                double column[3] = {0, 0, 0};
                apply_rows(list[a], list[b]->response + n * (size_t)d, column);
                for (int r = 0; r < 3; r++) s[(3 * a + r) * rows + 3 * b + d] = column[r] + (a == b && r == d ? list[a]->compliance : 0);
            }
    }
    if (!pliant_dense_solve(rows, s, 1, right)) return false;
    for (int a = 0; a < count; a++) {
        memcpy(at->step_force + 3 * index[a], right + 3 * a, 3 * sizeof *right);
        pliant_handle_pull(list[a], right + 3 * a, at->pull);
        for (int d = 0; d < 3; d++) {
            const double *z = list[a]->response + n * (size_t)d;
            for (size_t i = 0; i < n; i++) at->step[i] += right[3 * a + d] * z[i];
        }
    }
    return true;
}

/* sum over tools of c a' b */
static double spring_energy(const pliant_solver *solver, const double *a, const double *b)
{
    double sum = 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        if (pliant_handle_is_spring(solver->handles + t))
            for (int d = 0; d < 3; d++) sum += solver->handles[t].compliance * a[3 * t + d] * b[3 * t + d];
    return sum;
}

/* ---- one evaluation: forces, a solve, the merit of the state */

/* From loads and tools' forces in pull and elastic forces in step: what is left of them, in the nodes' own axes, and the scale. */
static void find_pull(const pliant_solver *solver, pliant_iterate *at)
{
    const pliant_system *system = solver->system;
    const int parts = system->num_free < NODES_FOR_THREADS ? 1 : PRODUCT_PARTS;
    double work[PRODUCT_PARTS], elastic[PRODUCT_PARTS];
#pragma omp parallel for schedule(static) num_threads(system->num_threads) if (parts > 1)
    for (int p = 0; p < parts; p++) {
        work[p] = elastic[p] = 0;
        const int32_t to = (int32_t)((int64_t)system->num_free * (p + 1) / parts);
        for (int32_t f = (int32_t)((int64_t)system->num_free * p / parts); f < to; f++) {
            const size_t node = 3 * (size_t)system->node_of_free[f];
            for (int d = 0; d < 3; d++) {
                double u = at->x[node + (size_t)d] - system->mesh->rest[node + (size_t)d];
                double base = system->space ? solver->load[3 * f + d] : 0; /* holds a patch where it does not move: not its tools' work */
                work[p] += u * (at->pull[3 * f + d] - base);
                elastic[p] += u * (at->step[3 * f + d] - base);
                at->pull[3 * f + d] -= at->step[3 * f + d];
            }
            pliant_turn_into(solver->turn, f, at->pull + 3 * f);
        }
    }
    for (int p = 1; p < parts; p++) {
        work[0] += work[p];
        elastic[0] += elastic[p];
    }
    at->scale = fmax(sqrt(fmax(fabs(work[0]), fabs(elastic[0]))), solver->smallest_scale);
}

static pliant_status evaluate(pliant_solver *solver, pliant_iterate *at)
{
    const pliant_system *system = solver->system;
    size_t n = unknowns(solver);
    solver->evaluations++;
    pliant_system_element_forces(system, at->x, solver->element_forces);
    pliant_system_gather(system, solver->element_forces, at->step);
    if (system->space) pliant_space_far_forces(system->space, at->x, at->step);
    memcpy(at->pull, solver->load, n * sizeof *at->pull);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        if (solver->handles[t].active)
            pull_by(solver->handles + t, solver->handles[t].block, solver->handles[t].by_force ? solver->handles[t].force : at->force + 3 * t,
                    at->pull);
    find_pull(solver, at);
    at->merit = INFINITY;
    if (!isfinite(at->scale)) return PLIANT_OK; /* not a state: never accepted */
    pliant_status status = pliant_preconditioner_solve(solver->preconditioner, 1, at->pull, at->step);
    if (status != PLIANT_OK) return status;
    if (!pliant_solver_step_tools(solver, at)) return PLIANT_OK;
    const double energy = pliant_solver_product(solver, at->step, at->pull) + spring_energy(solver, at->step_force, at->step_force);
    at->merit = pliant_anderson_merit(energy, at->scale);
    return PLIANT_OK;
}

/* ---- Anderson */

int32_t pliant_solver_depth(const pliant_solver *solver, int32_t evaluations)
{
    if (solver->depth == 0) return 0;
    int32_t wanted = evaluations >= PLIANT_MAX_HISTORY ? PLIANT_MAX_HISTORY : (3 * evaluations + 1) / 2;
    wanted = wanted > solver->depth ? wanted : solver->depth;
    return wanted < PLIANT_MAX_HISTORY ? wanted : PLIANT_MAX_HISTORY;
}

/* the last one takes its place */
static void forget_oldest(pliant_solver *solver)
{
    int32_t oldest = 0, last = --solver->num_history;
    for (int32_t h = 1; h <= last; h++)
        if (solver->history[h].born < solver->history[oldest].born) oldest = h;
    pliant_secant secant = solver->history[oldest];
    solver->history[oldest] = solver->history[last];
    solver->history[last] = secant;
    double *gram = solver->gram, own = gram[last * PLIANT_MAX_HISTORY + last];
    for (int32_t h = 0; h < last; h++)
        gram[oldest * PLIANT_MAX_HISTORY + h] = gram[h * PLIANT_MAX_HISTORY + oldest] = gram[last * PLIANT_MAX_HISTORY + h];
    gram[oldest * PLIANT_MAX_HISTORY + oldest] = own;
}

static void remember(pliant_solver *solver, const pliant_iterate *from, const pliant_iterate *to)
{
    if (solver->depth == 0 || !isfinite(to->merit)) return;
    const int32_t wanted = pliant_solver_depth(solver, solver->last_evaluations), depth = wanted < solver->room ? wanted : solver->room;
    while (solver->num_history >= depth) forget_oldest(solver);
    const int32_t now = solver->num_history++;
    pliant_secant *secant = solver->history + now;
    secant->born = ++solver->num_secants;
    const pliant_system *system = solver->system;
    const int32_t *node = system->node_of_free;
#pragma omp parallel for schedule(static) num_threads(system->num_threads) if (system->num_free >= NODES_FOR_THREADS)
    for (int32_t f = 0; f < system->num_free; f++) {
        for (int d = 0; d < 3; d++) {
            size_t i = 3 * (size_t)f + (size_t)d, x = 3 * (size_t)node[f] + (size_t)d;
            secant->x[i] = to->x[x] - from->x[x];
            secant->step[i] = to->step[i] - from->step[i];
            secant->pull[i] = to->pull[i] - from->pull[i];
        }
        pliant_turn_into(solver->turn, f, secant->x + 3 * f);
    }
    for (int r = 0; r < PLIANT_MAX_ROWS; r++) {
        secant->force[r] = to->force[r] - from->force[r];
        secant->step_force[r] = to->step_force[r] - from->step_force[r];
    }
    for (int32_t h = 0; h <= now; h++) {
        const pliant_secant *other = solver->history + h;
        double product = pliant_solver_product(solver, secant->step, other->pull) + spring_energy(solver, secant->step_force, other->step_force);
        solver->gram[now * PLIANT_MAX_HISTORY + h] = solver->gram[h * PLIANT_MAX_HISTORY + now] = product;
    }
}

bool pliant_solver_mix(const pliant_solver *solver, const pliant_iterate *at, double noise, double weights[PLIANT_MAX_HISTORY])
{
    int32_t m = solver->num_history;
    double gram[PLIANT_MAX_HISTORY * PLIANT_MAX_HISTORY], trace = 0;
    if (m == 0) return false;
    for (int32_t a = 0; a < m; a++) {
        const pliant_secant *sa = solver->history + a;
        weights[a] = pliant_solver_product(solver, sa->step, at->pull) + spring_energy(solver, sa->step_force, at->step_force);
        for (int32_t b = 0; b < m; b++) gram[a * m + b] = solver->gram[a * PLIANT_MAX_HISTORY + b];
    }
    /* secants differ in size by orders: scale to a unit diagonal, then a little regularization */
    double scale[PLIANT_MAX_HISTORY];
    for (int32_t a = 0; a < m; a++) {
        scale[a] = gram[a * m + a] > 0 && gram[a * m + a] <= solver->largest_secant ? 1 / sqrt(gram[a * m + a]) : 0;
        trace += scale[a] > 0;
    }
    if (trace == 0) return false;
    for (int32_t a = 0; a < m; a++) {
        weights[a] *= scale[a];
        for (int32_t b = 0; b < m; b++) gram[a * m + b] *= scale[a] * scale[b];
    }
    for (int32_t a = 0; a < m; a++) gram[a * m + a] = 1 + noise * noise;
    if (!pliant_dense_cholesky(m, gram)) return false;
    pliant_dense_cholesky_solve(m, gram, 1, weights);
    for (int32_t a = 0; a < m; a++) weights[a] *= scale[a];
    return true;
}

/* trial = at + damping * (mixed step) */
static void propose(pliant_solver *solver, const pliant_iterate *at, const double *weights, double damping, pliant_iterate *trial)
{
    const pliant_system *system = solver->system;
    int32_t m = weights ? solver->num_history : 0;
    memcpy(trial->x, at->x, 3 * (size_t)system->mesh->num_nodes * sizeof *trial->x);
#pragma omp parallel for schedule(static) num_threads(system->num_threads) if (system->num_free >= NODES_FOR_THREADS)
    for (int32_t f = 0; f < system->num_free; f++) {
        double step[3];
        for (int d = 0; d < 3; d++) {
            size_t i = 3 * (size_t)f + (size_t)d;
            step[d] = at->step[i];
            for (int32_t a = 0; a < m; a++) step[d] -= weights[a] * (solver->history[a].x[i] + solver->history[a].step[i]);
        }
        pliant_turn_out(solver->turn, f, step);
        for (int d = 0; d < 3; d++) trial->x[3 * system->node_of_free[f] + d] += damping * step[d];
    }
    for (int r = 0; r < PLIANT_MAX_ROWS; r++) {
        double step = at->step_force[r];
        for (int32_t a = 0; a < m; a++) step -= weights[a] * (solver->history[a].force[r] + solver->history[a].step_force[r]);
        trial->force[r] = at->force[r] + damping * step;
    }
}

static void swap_iterates(pliant_solver *solver)
{
    pliant_iterate swap = solver->now;
    solver->now = solver->trial;
    solver->trial = swap;
}

/* The trial after so many refusals, from the present iterate: once more with what the refused state taught; then without secants that
 * are far larger than what is left, of which they are not true enough, though they will be of the next step; then the plain step; then
 * ever shorter ones. */
typedef struct pliant_trial_kind {
    bool mixed, limited; /* with secants; with those alone that are not too large */
    double damping;
} pliant_trial_kind;

static pliant_trial_kind propose_after(pliant_solver *solver, int refused, bool limited)
{
    const double still_true = 30; /* secants up to so many times the merit */
    double weights[PLIANT_MAX_HISTORY];
    /* around a patch the merit may be lost altogether: straight to the plain step there */
    pliant_trial_kind kind = {.limited = refused == 2 && !limited && isfinite(solver->now.merit) && !solver->system->space,
                              .damping = refused < 3 ? 1 : ldexp(1, 2 - refused)};
    if (kind.limited) solver->largest_secant = pow(still_true * solver->now.merit, 2);
    kind.mixed = (refused < 2 || kind.limited) && pliant_solver_mix(solver, &solver->now, 1e-5, weights);
    if (refused == 2 && !kind.mixed) pliant_solver_forget(solver);
    propose(solver, &solver->now, kind.mixed ? weights : NULL, kind.damping, &solver->trial);
    return kind;
}

/* The step at the last iterate is known already: take it without looking where it leads, if the one before went well, or if the frame
 * would not move otherwise. It costs nothing, and the next frame's first evaluation looks; what it left is kept until then. The merit
 * that is reported stays that of the last evaluation. */
static void last_step(pliant_solver *solver, bool accepted)
{
    size_t bytes = 3 * (size_t)solver->system->mesh->num_nodes * sizeof *solver->left_x;
    memcpy(solver->left_x, solver->now.x, bytes);
    memcpy(solver->left_force, solver->now.force, sizeof solver->left_force);
    solver->ahead = true;
    pliant_trial_kind kind = propose_after(solver, solver->refused, solver->limited);
    /* where it turns out to lead nowhere, these have been tried */
    if (!accepted && (solver->refused > 0 || !kind.mixed)) {
        solver->limited = true;
        solver->refused = kind.mixed ? 2 : solver->refused < 3 ? 3 : solver->refused + 1;
    }
    double *swap = solver->now.x;
    solver->now.x = solver->trial.x;
    solver->trial.x = swap;
    memcpy(solver->now.force, solver->trial.force, sizeof solver->now.force);
}

/* The first evaluation of a frame. If the step before was taken blindly and the merit is far above that of the last frame that was
 * found to begin well, look at the state that it left, too, and keep the better one. */
static pliant_status begin(pliant_solver *solver, pliant_statistics *statistics)
{
    const double too_high = 2;
    pliant_status status = evaluate(solver, &solver->now);
    statistics->iterations = 1;
    if (status == PLIANT_OK) status = pliant_hindsight_look(solver);
    bool went_on = solver->ahead;
    const bool suspect = went_on && !(solver->now.merit < too_high * solver->sound_merit);
    if (status == PLIANT_OK && suspect) {
        memcpy(solver->trial.x, solver->left_x, 3 * (size_t)solver->system->mesh->num_nodes * sizeof *solver->left_x);
        memcpy(solver->trial.force, solver->left_force, sizeof solver->left_force);
        status = evaluate(solver, &solver->trial);
        statistics->iterations++;
        if (status == PLIANT_OK && solver->trial.merit < solver->now.merit) {
            swap_iterates(solver);
            pliant_solver_forget(solver);
            went_on = false;
        }
    }
    if (went_on) { /* what was tried after refusals was good */
        solver->refused = 0;
        solver->limited = false;
    }
    solver->first_merit = solver->now.merit;
    if (suspect || !solver->ahead || solver->now.merit < solver->sound_merit) solver->sound_merit = solver->now.merit;
    solver->ahead = false;
    return status;
}

/* Where nothing leads on from here, the body at rest may be the better place to start from: after collapses and other states
 * that no tissue is in. Taken only when its merit is lower. */
static pliant_status start_from_rest(pliant_solver *solver, pliant_statistics *statistics)
{
    memcpy(solver->trial.x, solver->system->mesh->rest, 3 * (size_t)solver->system->mesh->num_nodes * sizeof *solver->trial.x);
    memset(solver->trial.force, 0, sizeof solver->trial.force);
    pliant_status status = evaluate(solver, &solver->trial);
    statistics->iterations++;
    solver->slow = solver->refused = 0;
    if (status == PLIANT_OK && solver->trial.merit < solver->now.merit) {
        swap_iterates(solver);
        pliant_solver_forget(solver);
    }
    return status;
}

/* Whether the potential energy still falls where a plain step has led to. Springs have no part in it: where there are some, no. */
static bool energy_falls(const pliant_solver *solver)
{
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        if (pliant_handle_is_spring(solver->handles + t)) return false;
    return isfinite(solver->trial.merit) && pliant_solver_product(solver, solver->now.step, solver->trial.pull) > 0;
}

/* The merit has a minimum here that is no equilibrium: beside a state that the tissue leaves, as it snaps over. Its energy falls on:
 * the longest step that it fell along is taken, though the merit rises. One that was found steps ago, for other loads or tools,
 * may no longer lead down: it is left. */
static pliant_status go_down(pliant_solver *solver, pliant_statistics *statistics, int *refused)
{
    propose(solver, &solver->now, NULL, solver->escape, &solver->trial);
    pliant_status status = evaluate(solver, &solver->trial);
    statistics->iterations++;
    solver->escape = 0;
    if (status != PLIANT_OK || !energy_falls(solver)) return status;
    swap_iterates(solver);
    pliant_solver_forget(solver);
    *refused = 0;
    return status;
}

/* whether one more evaluation as long as those so far would end within the budget */
static bool time_left(const pliant_solver *solver, double start, int32_t evaluations)
{
    double spent = solver->budget > 0 ? solver->clock(solver->clock_user) - start : 0;
    return spent + spent / evaluations <= solver->budget;
}

/* Iterate until the merit is small or the iterations or the time are spent; every accepted iterate has a lower merit than the last.
 * Refusals go on into the next step where this one ends first. */
static pliant_status iterate(pliant_solver *solver, pliant_statistics *statistics)
{
    const double went_well = 0.5, slow = 0.9; /* merit over the merit before */
    enum { MOST_REFUSED = 12, MOST_SLOW = 10 };
    bool accepted = false;
    solver->stumbled = false;
    solver->largest_secant = INFINITY;
    double before = INFINITY;
    double start = solver->clock(solver->clock_user);
    pliant_status status = begin(solver, statistics);
    int refused = solver->refused;
    bool limited = solver->limited;
    while (status == PLIANT_OK && solver->now.merit > solver->tolerance * solver->now.scale &&
           statistics->iterations < solver->max_iterations && refused < MOST_REFUSED && time_left(solver, start, statistics->iterations)) {
        const pliant_trial_kind kind = propose_after(solver, refused, limited);
        limited = kind.limited;
        status = evaluate(solver, &solver->trial);
        statistics->iterations++;
        if (status != PLIANT_OK) break;
        if (solver->trial.merit < solver->now.merit) {
            remember(solver, &solver->now, &solver->trial);
            before = solver->now.merit;
            swap_iterates(solver);
            if (accepted) pliant_estimate_learn(solver, solver->now.merit / before);
            refused = 0;
            solver->escape = 0;
            accepted = true;
        } else {
            if (refused < 2 || kind.mixed) remember(solver, &solver->now, &solver->trial);
            else if (energy_falls(solver)) solver->escape = fmax(solver->escape, kind.damping);
            refused += !(kind.limited && kind.mixed);
            solver->stumbled = true;
            statistics->rejected++;
        }
        if (refused == MOST_REFUSED && solver->escape > 0) status = go_down(solver, statistics, &refused);
    }
    solver->last_evaluations = statistics->iterations;
    int steps = statistics->iterations - 1;
    solver->rate = steps > 0 && solver->first_merit > 0 ? pow(solver->now.merit / solver->first_merit, 1.0 / steps) : 0;
    solver->refused = accepted ? 0 : refused;
    solver->limited = limited;
    solver->slow = solver->rate > slow ? solver->slow + 1 : 0;
    if (status == PLIANT_OK && (solver->refused >= MOST_REFUSED || solver->slow == MOST_SLOW)) return start_from_rest(solver, statistics);
    const bool far = isfinite(solver->now.merit) && solver->now.merit > solver->tolerance * solver->now.scale;
    if (status == PLIANT_OK && far && (accepted ? refused == 0 && solver->now.merit < went_well * before : refused < MOST_REFUSED))
        last_step(solver, accepted);
    return status;
}

/* The axes follow the tissue, after so many evaluations that it costs little beside them. Responses to springs hold for the axes
 * that they were found in: those wait for the next factor. Of tools that pull by force for now, they are found anew. */
static void turn_on(pliant_solver *solver)
{
    enum { EVALUATIONS = 2 };
    bool follows = solver->turn && (!solver->turn->turned || solver->evaluations >= EVALUATIONS);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        const pliant_handle *handle = solver->handles + t;
        if (pliant_handle_is_spring(handle) && handle->response_of == solver->factor_serial) follows = false;
    }
    if (!follows) return;
    solver->evaluations = 0;
    pliant_turn_to(solver->system, solver->now.x, solver->turn);
    pliant_solver_turned(solver);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) solver->handles[t].response_of = 0;
}

pliant_status pliant_solver_step(pliant_solver *solver, pliant_statistics *statistics)
{
    pliant_status status = pliant_refresh_step(solver, statistics);
    if (status == PLIANT_OK) turn_on(solver);
    if (status == PLIANT_OK) status = update_responses(solver);
    if (status != PLIANT_OK) return status;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) memcpy(solver->now.force + 3 * t, solver->handles[t].force, 3 * sizeof(double));
    status = iterate(solver, statistics);
    if (status != PLIANT_OK) return status;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) memcpy(solver->handles[t].force, solver->now.force + 3 * t, 3 * sizeof(double));
    if (!isfinite(solver->now.merit)) return pliant_fail(PLIANT_ERROR_NUMERIC, PLIANT_LOAD_NOT_FINITE);
    statistics->residual = solver->now.merit / solver->now.scale;
    statistics->error_before = pliant_hindsight_tell(solver);
    statistics->error = solver->foreseen = pliant_estimate_now(solver);
    pliant_hindsight_keep(solver);
    statistics->residual_force = 0;
    for (int32_t f = 0; f < solver->system->num_free; f++) {
        const double *r = solver->now.pull + 3 * f;
        statistics->residual_force = fmax(statistics->residual_force, sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2]));
    }
    return statistics->residual > solver->tolerance ? PLIANT_NOT_CONVERGED : PLIANT_OK;
}
