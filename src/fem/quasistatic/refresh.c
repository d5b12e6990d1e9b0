/* New factors in the background. A factor is started at the state of one step and installed a fixed number of steps
 * later. The thread's speed therefore does not change results. model_data/background.h defines the other modes.
 *
 * Steps in the history belong to the factor that computed them. A second run of the thread recomputes them for the new
 * factor. With springs, the secants are dropped instead: secants of the old factor slow down convergence with the new
 * one (NUMERICS.md). In live steps the thread also computes the springs' responses, so that no step takes longer.
 *
 * After a cut, the new factor is computed including its pattern. The elimination order is the earlier factor's, with
 * copied nodes next to their sources. A factor still in progress for the earlier body is used as the base of the
 * carried preconditioner (carried.h). The thread reads retained data. In live use no step waits for the thread. */
#include "base/worker.h"
#include "base/fail.h"
#include "base/dense.h"
#include "fem/quasistatic/pressure.h"
#include "base/memory.h"
#include "model_data/discretization.h"

#include <string.h>

struct pliant_refresh {
    pliant_worker worker;
    bool running;               /* the result was not taken yet */
    uint64_t started, due;      /* steps */
    bool wanted;                /* the present factor has converged slowly since the last start */
    const pliant_discretization *of; /* Nullable: discretization that contains the system; retained */
    pliant_system system;       /* copy of the constant system, with one thread */
    /* (nodes of the solver's mesh) node of this system from before a cut; NULL: the nodes are equal. */
    int32_t *source;
    int32_t *order;             /* Nullable: (num_free) elimination order */
    bool layered;               /* true: create a multigrid if the system has no preconditioner */
    pliant_preconditioner *preconditioner; /* the result of the thread, which also creates it */
    pliant_preconditioner *spare; /* Nullable: used for the next result */
    pliant_preconditioner *discarded; /* Nullable: freed by the thread */
    double *x;                  /* (3 num_nodes) state of the factor [m] */
    double *volume_pressure;    /* Nullable: (elements) its pressures times volume [N m] */
    pliant_tangent *tangents;
    pliant_status status;

    /* THE HISTORY */
    bool converting;
    pliant_nodal_rotations *rotations;          /* Nullable; axes of the new factor */
    double *now;                /* (3 num_nodes) state of the axes */
    uint64_t number[PLIANT_MAX_HISTORY]; /* secant numbers, as in the rules */
    pliant_secant history[PLIANT_MAX_HISTORY];
    double gram[PLIANT_MAX_HISTORY * PLIANT_MAX_HISTORY];
    pliant_grasp_constraint grasps[PLIANT_MAX_TOOLS]; /* copies of the springs; empty for other tools */
};

/* Do the initial work in the thread; after a cut it includes the symbolic analysis. */
static pliant_status make_ready(pliant_refresh *refresh)
{
    pliant_system *system = &refresh->system;
    pliant_preconditioner_free(refresh->discarded);
    refresh->discarded = NULL;
    if (refresh->preconditioner) return PLIANT_OK;
    if (!refresh->tangents &&
        !(refresh->tangents = pliant_calloc((size_t)system->num_blocks, sizeof *refresh->tangents)))
        return pliant_fail_memory("the background factorization");
    if (system->preconditioner) return pliant_preconditioner_clone(system->preconditioner, 1, &refresh->preconditioner);
    pliant_system *shared = refresh->of->system; /* no other thread reads its pattern until this one has finished */
    pliant_status status = pliant_system_find_pattern(shared);
    if (status != PLIANT_OK) return status;
    system->pattern = shared->pattern;
    return pliant_preconditioner_create(system, refresh->layered ? PLIANT_MULTIGRID : PLIANT_DIRECT, refresh->order,
                                        &refresh->preconditioner);
}

static void make_factor(void *argument)
{
    pliant_refresh *refresh = argument;
    const bool first_of_all = !refresh->preconditioner && !refresh->system.preconditioner;
    if ((refresh->status = make_ready(refresh)) != PLIANT_OK) return;
    /* Use the exact tangent if it is positive definite, as it is near a stable state. If no factor can be computed, the
     * old one stays. */
    pliant_fail_quietly(true);
    int first = pliant_preconditioner_can_fail(refresh->preconditioner) ? PLIANT_TWIST_EXACT : PLIANT_TWIST_POSITIVE;
    for (int twist = first; twist <= PLIANT_TWIST_POSITIVE; twist++) {
        pliant_system_tangents(&refresh->system, refresh->x, (pliant_twist)twist, refresh->tangents);
        refresh->status = pliant_preconditioner_numeric(refresh->preconditioner, refresh->tangents);
        if (refresh->status != PLIANT_ERROR_NUMERIC) break;
    }
    pliant_fail_quietly(false);
    if (first_of_all && refresh->status == PLIANT_OK)
        refresh->status = pliant_preconditioner_clone(refresh->preconditioner, 1, &refresh->spare);
    pliant_nodal_rotations_refer(&refresh->system, refresh->x, refresh->rotations);
}

static void convert_history(void *argument)
{
    pliant_refresh *refresh = argument;
    const int32_t num_free = refresh->system.num_free;
    const size_t unknowns = 3 * (size_t)num_free;
    pliant_nodal_rotations_update(&refresh->system, refresh->now, refresh->rotations);
    for (int t = 0; t < PLIANT_MAX_TOOLS && refresh->status == PLIANT_OK; t++) {
        if (!refresh->grasps[t].active) continue;
        pliant_grasp_rotate(refresh->grasps + t, refresh->rotations);
        refresh->status = pliant_grasp_find_response(refresh->grasps + t, unknowns, refresh->preconditioner);
    }
    for (int32_t h = 0; h < PLIANT_MAX_HISTORY && refresh->status == PLIANT_OK; h++) {
        if (refresh->number[h] == 0) continue;
        pliant_secant *secant = refresh->history + h;
        for (int32_t f = 0; f < num_free; f++) {
            pliant_into_node_axes(refresh->rotations, f, secant->x + 3 * f);
            pliant_into_node_axes(refresh->rotations, f, secant->residual + 3 * f);
        }
        refresh->status = pliant_preconditioner_solve(refresh->preconditioner, 1, secant->residual, secant->step);
    }
    for (int32_t a = 0; a < PLIANT_MAX_HISTORY; a++)
        for (int32_t b = 0; b <= a && refresh->number[a] > 0; b++)
            if (refresh->number[b] > 0)
                refresh->gram[a * PLIANT_MAX_HISTORY + b] = refresh->gram[b * PLIANT_MAX_HISTORY + a] =
                    pliant_dot(unknowns, refresh->history[a].step, refresh->history[b].residual);
}

/* Order the unknowns as in the base, with copies directly after their source. */
static pliant_status order_after(const pliant_solver *solver, const pliant_preconditioner *base,
                                 pliant_refresh *refresh)
{
    const int32_t *source, count = solver->system->num_free;
    const int32_t before = pliant_preconditioner_source(solver->preconditioner, &source)->system->num_free;
    int32_t *first = pliant_calloc((size_t)before + 1, sizeof *first),
            *next = pliant_calloc((size_t)count, sizeof *next);
    int32_t *order = pliant_calloc((size_t)before, sizeof *order), placed = 0;
    refresh->order = pliant_calloc((size_t)count, sizeof *refresh->order);
    if (first && next && order && refresh->order && pliant_preconditioner_order(base, order) == before) {
        for (int32_t f = count - 1; f >= 0; f--) { /* lists by source, ascending; unknowns without a source last */
            int32_t *list = first + (source[f] >= 0 ? source[f] : before);
            next[f] = *list;
            *list = f + 1;
        }
        for (int32_t i = 0; i <= before; i++)
            for (int32_t f = first[i < before ? order[i] : before]; f > 0; f = next[f - 1])
                refresh->order[placed++] = f - 1;
    }
    PLIANT_FREE(first, next, order);
    return placed == count ? PLIANT_OK : pliant_fail_memory("the background factorization");
}

static pliant_status refresh_create(pliant_solver *solver)
{
    const pliant_system *system = solver->system;
    pliant_preconditioner **base = pliant_preconditioner_base(solver->preconditioner);
    pliant_refresh *refresh = solver->refresh = pliant_calloc(1, sizeof *refresh);
    if (!refresh) return pliant_fail_memory("the background factorization");
    if (system->of) refresh->of = pliant_discretization_retain(system->of);
    refresh->system = *system;
    refresh->system.num_threads = 1;
    const size_t nodes = (size_t)system->mesh->num_nodes;
    refresh->x = pliant_calloc(nodes, 3 * sizeof *refresh->x);
    refresh->now = pliant_calloc(nodes, 3 * sizeof *refresh->now);
    if (solver->pressures)
        refresh->system.volume_pressure = refresh->volume_pressure =
            pliant_calloc((size_t)pliant_element_count(system), sizeof *refresh->volume_pressure);
    const bool allocated = refresh->x && refresh->now && (refresh->volume_pressure || !solver->pressures);
    pliant_status status = allocated ? PLIANT_OK : pliant_fail_memory("the background factorization");
    if (status == PLIANT_OK) status = pliant_nodal_rotations_create(system, &refresh->rotations);
    if (status == PLIANT_OK) status = pliant_secants_create(system, solver->rules.capacity, refresh->history);
    if (base) refresh->layered = pliant_preconditioner_is_multigrid(*base);
    if (status == PLIANT_OK && base && !refresh->layered && !system->graded)
        status = order_after(solver, *base, refresh);
    if (status != PLIANT_OK) pliant_refresh_free(solver);
    return status;
}

static void start(pliant_refresh *refresh, void (*work)(void *), uint64_t due)
{
    refresh->due = due;
    refresh->status = PLIANT_OK;
    refresh->running = true;
    pliant_worker_start(&refresh->worker, work, refresh);
}

static void join(pliant_refresh *refresh)
{
    pliant_worker_join(&refresh->worker);
    refresh->running = false;
}

/* Copy the data that belongs to the factor: the holds and, if it keeps it, the history in world axes. */
static pliant_status copy_history(pliant_solver *solver, bool keeps_history, pliant_refresh *refresh)
{
    const int32_t num_free = solver->system->num_free;
    const size_t bytes = 3 * (size_t)num_free * sizeof(double);
    memset(refresh->number, 0, sizeof refresh->number);
    if (keeps_history) memcpy(refresh->number, solver->rules.number, sizeof refresh->number);
    solver->history_was_dropped = false;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        pliant_grasp_free(refresh->grasps + t);
        if (!pliant_grasp_is_spring(solver->grasps + t)) continue;
        pliant_status status = pliant_grasp_copy(solver->grasps + t, refresh->grasps + t);
        if (status != PLIANT_OK) return status;
    }
    for (int32_t h = 0; h < PLIANT_MAX_HISTORY; h++) {
        if (refresh->number[h] == 0) continue;
        const pliant_secant *from = solver->history + h;
        pliant_secant *to = refresh->history + h;
        memcpy(to->x, from->x, bytes);
        memcpy(to->residual, from->residual, bytes);
        memcpy(to->force, from->force, sizeof to->force);
        memcpy(to->step_force, from->step_force, sizeof to->step_force);
#pragma omp parallel for schedule(static) num_threads(solver->system->num_threads)
        for (int32_t f = 0; f < num_free; f++) {
            pliant_from_node_axes(solver->rotations, f, to->x + 3 * f);
            pliant_from_node_axes(solver->rotations, f, to->residual + 3 * f);
        }
    }
    return PLIANT_OK;
}

/* Install the responses that the thread has computed for the present factor. */
static void take_responses(pliant_solver *solver)
{
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        pliant_grasp_constraint *found = solver->refresh->grasps + t, *grasp = solver->grasps + t;
        if (!found->active || !pliant_grasp_is_spring(grasp) || !pliant_grasp_is_same(found, grasp)) continue;
        double *response = grasp->response;
        grasp->response = found->response;
        grasp->response_number = solver->in_use.number;
        found->response = response;
    }
}

static void install_factor(pliant_solver *solver, pliant_statistics *statistics)
{
    pliant_refresh *refresh = solver->refresh;
    pliant_preconditioner *old = solver->preconditioner;
    pliant_preconditioner_threads(refresh->preconditioner, solver->system->num_threads);
    solver->preconditioner = refresh->preconditioner;
    refresh->preconditioner = old;
    if (refresh->spare || pliant_preconditioner_base(old)) { /* a carried preconditioner accepts no other matrix */
        refresh->discarded = old;
        refresh->preconditioner = refresh->spare;
        refresh->spare = NULL;
    }
    if (refresh->preconditioner) pliant_preconditioner_threads(refresh->preconditioner, 1);
    pliant_nodal_rotations *axes = solver->rotations;
    solver->rotations = refresh->rotations;
    refresh->rotations = axes;
    pliant_solver_rotate_grasps(solver);
    solver->factors++;
    solver->in_use.number++;
    statistics->factors++;
    if (refresh->converting) take_responses(solver);
    bool converted = refresh->converting && !solver->history_was_dropped;
    refresh->converting = false;
    bool is_comparable = solver->previous.is_comparable; /* the evaluated state stays valid */
    pliant_solver_drop_history(solver);
    solver->previous.is_comparable = is_comparable;
    if (!converted) return;
    for (int32_t h = 0; h < PLIANT_MAX_HISTORY; h++) {
        if (refresh->number[h] == 0) continue;
        pliant_secant secant = solver->history[h];
        solver->history[h] = refresh->history[h];
        refresh->history[h] = secant;
    }
    memcpy(solver->gram, refresh->gram, sizeof solver->gram);
    memcpy(solver->rules.number, refresh->number, sizeof refresh->number);
}

/* Install a factor from before the cut as the base of the carried preconditioner. */
static pliant_status install_below_carried(pliant_solver *solver, pliant_statistics *statistics)
{
    const pliant_system *system = solver->system;
    pliant_refresh *refresh = solver->refresh;
    int32_t *source = pliant_calloc((size_t)system->num_free, sizeof *source);
    double *x = pliant_calloc((size_t)system->mesh->num_nodes, 3 * sizeof *x);
    pliant_preconditioner *made = NULL;
    if (!source || !x) {
        pliant_free(source);
        pliant_free(x);
        return pliant_fail_memory("the preconditioner");
    }
    for (int32_t f = 0; f < system->num_free; f++) {
        const int32_t was = refresh->source[system->node_of_free[f]];
        source[f] = was >= 0 ? refresh->system.free_of_node[was] : -1;
    }
    for (int32_t n = 0; n < system->mesh->num_nodes; n++)
        memcpy(x + 3 * n, refresh->source[n] >= 0 ? refresh->x + 3 * refresh->source[n] : solver->now.x + 3 * n,
               3 * sizeof *x);
    pliant_nodal_rotations_refer(system, x, solver->rotations);
    pliant_nodal_rotations_update(system, solver->now.x, solver->rotations);
    pliant_free(x);
    pliant_status status = pliant_preconditioner_carry(system, refresh->of, refresh->of->system, source, solver->now.x,
                                                       solver->rotations ? solver->rotations->rotation : NULL, &made);
    if (status != PLIANT_OK) return status;
    pliant_preconditioner_take_base(made, &refresh->preconditioner);
    pliant_preconditioner_threads(made, system->num_threads);
    refresh->discarded = solver->preconditioner;
    solver->preconditioner = made;
    pliant_solver_rotate_grasps(solver);
    solver->factors++;
    solver->in_use.number++;
    statistics->factors++;
    pliant_solver_drop_history(solver);
    return PLIANT_OK;
}

static void deliver(pliant_solver *solver, uint64_t step, pliant_statistics *statistics)
{
    pliant_refresh *refresh = solver->refresh;
    join(refresh);
    if (refresh->status == PLIANT_OK && refresh->source) refresh->status = install_below_carried(solver, statistics);
    if (refresh->status != PLIANT_OK) pliant_log(PLIANT_LOG_DEBUG, "a new factor could not be made; the old one stays");
    if (refresh->source) {
        pliant_refresh_free(solver); /* the next one belongs to the present body */
        return;
    }
    if (refresh->status != PLIANT_OK) {
        refresh->converting = false;
        return;
    }
    bool springs = false, responses = false;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        if (!pliant_grasp_is_spring(solver->grasps + t)) continue;
        springs = true;
        responses = responses || solver->grasps[t].response_number == solver->in_use.number;
    }
    /* Secants that led to a refusal are dropped. */
    const bool keeps_history = !springs && !solver->pressures;
    const bool learned = keeps_history && pliant_anderson_secants(&solver->rules) > 0 && !solver->rules.refused_any;
    if (refresh->converting || !(learned || (responses && pliant_background_is_live(solver->background)))) {
        install_factor(solver, statistics);
        return;
    }
    if ((refresh->status = copy_history(solver, keeps_history, refresh)) != PLIANT_OK) return;
    memcpy(refresh->now, solver->now.x, 3 * (size_t)solver->system->mesh->num_nodes * sizeof *refresh->now);
    refresh->converting = true;
    start(refresh, convert_history, step + (uint64_t)solver->convert_delay);
}

pliant_status pliant_refresh_step(pliant_solver *solver, pliant_statistics *statistics)
{
    const bool carried = pliant_preconditioner_base(solver->preconditioner) != NULL;
    if (solver->refresh_interval == 0 && !carried && !solver->refresh) return PLIANT_OK;
    uint64_t step = statistics->step;
    pliant_refresh *refresh = solver->refresh;
    if (refresh && refresh->running) {
        const uint32_t result = refresh->converting ? solver->takes_history : solver->takes_factor;
        if (pliant_background_installs(solver->background, result, pliant_worker_has_finished(&refresh->worker),
                                       step >= refresh->due))
            deliver(solver, step, statistics);
    }
    if (!solver->refresh) {
        pliant_status status = refresh_create(solver);
        if (status != PLIANT_OK) return status;
    }
    refresh = solver->refresh;
    refresh->wanted = refresh->wanted || solver->rules.rate > pliant_get_quasistatic_settings().poor_rate;
    bool due = solver->refresh_interval > 0 && step >= refresh->started + (uint64_t)solver->refresh_interval &&
               refresh->wanted;
    if (refresh->running || (!due && pliant_preconditioner_base(solver->preconditioner) == NULL)) return PLIANT_OK;
    memcpy(refresh->x, solver->now.x, 3 * (size_t)solver->system->mesh->num_nodes * sizeof *refresh->x);
    pliant_pressure_times_volume(solver, refresh->volume_pressure);
    refresh->started = step;
    refresh->wanted = false;
    /* The symbolic analysis takes about as long as the factorization. */
    const bool first = !refresh->preconditioner && !solver->system->preconditioner;
    start(refresh, make_factor, step + (uint64_t)solver->refresh_delay * (first ? 2 : 1));
    return PLIANT_OK;
}

pliant_status pliant_refresh_carry(pliant_solver *solver, const pliant_solver *from, const int32_t *source)
{
    const pliant_refresh *before = from->refresh;
    if (!before || !before->running) return PLIANT_OK;
    pliant_refresh *refresh = solver->refresh = pliant_calloc(1, sizeof *refresh);
    const size_t nodes = (size_t)solver->system->mesh->num_nodes;
    if (refresh) refresh->source = pliant_calloc(nodes, sizeof *refresh->source);
    if (!refresh || !refresh->source) return pliant_fail_memory("the background factorization");
    for (size_t n = 0; n < nodes; n++)
        refresh->source[n] = before->source && source[n] >= 0 ? before->source[source[n]] : source[n];
    return PLIANT_OK;
}

void pliant_refresh_take(pliant_solver *solver, pliant_solver *from)
{
    pliant_refresh *refresh = from->refresh;
    if (!solver->refresh) return;
    pliant_free(refresh->source);
    refresh->source = solver->refresh->source;
    solver->refresh->source = NULL;
    from->refresh = solver->refresh;
    solver->refresh = refresh;
    solver->history_was_dropped = from->history_was_dropped;
}

void pliant_refresh_free(pliant_solver *solver)
{
    pliant_refresh *refresh = solver->refresh;
    if (!refresh) return;
    join(refresh);
    pliant_preconditioner_free(refresh->preconditioner);
    pliant_preconditioner_free(refresh->spare);
    pliant_preconditioner_free(refresh->discarded);
    pliant_nodal_rotations_free(refresh->rotations);
    pliant_secants_free(refresh->history);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) pliant_grasp_free(refresh->grasps + t);
    PLIANT_FREE(refresh->x, refresh->volume_pressure, refresh->now, refresh->tangents, refresh->source, refresh->order);
    pliant_discretization_release(refresh->of);
    pliant_free(refresh);
    solver->refresh = NULL;
}

bool pliant_refresh_is_busy(const pliant_solver *solver)
{
    return solver->refresh && solver->refresh->running && !pliant_worker_has_finished(&solver->refresh->worker);
}

size_t pliant_refresh_bytes(const pliant_solver *solver)
{
    return solver->refresh && !solver->refresh->running ? pliant_preconditioner_bytes(solver->refresh->preconditioner)
                                                        : 0;
}
