/* New factors in the background: started from the state of one step, put to use a fixed number of steps later, whether the
 * other thread was fast or not, so that timing never changes results; or as background.h says.
 *
 * Steps of the history belong to the factor that made them. They are made anew in the background, too, where no spring's
 * response goes into them: a second stay in the thread, on the secants that the solver has when the factor is there. */
#include "base/fail.h"
#include "base/threads.h"
#include "fem/linear/dense.h"
#include "fem/quasistatic/background.h"
#include "fem/quasistatic/solver.h"
#include "pliant/memory.h"

#include <pthread.h>
#include <stdatomic.h>
#include <string.h>

struct pliant_refresh {
    pthread_t thread;
    bool running;
    void (*work)(pliant_refresh *);
    bool in_thread;             /* false: no thread could be had, the work was done at once */
    atomic_bool finished;
    uint64_t started, due;      /* steps */
    bool wanted;                /* the factor at hand has served badly since the last start */
    pliant_system system;       /* a copy of the constant system, one thread */
    pliant_preconditioner *preconditioner; /* the one being made */
    double *x;                  /* (3 num_nodes) that it is made at */
    pliant_tangent *tangents;
    pliant_status status;

    /* THE HISTORY */
    bool converting;
    pliant_nodal_rotations *rotations;          /* Nullable; axes of the new factor */
    double *now;                /* (3 num_nodes) that they are turned to */
    uint64_t number[PLIANT_MAX_HISTORY]; /* as the rules have it */
    pliant_secant history[PLIANT_MAX_HISTORY];
    double gram[PLIANT_MAX_HISTORY * PLIANT_MAX_HISTORY];
    uint64_t forgotten;         /* the solver's when it was copied */
};

static void make_factor(pliant_refresh *refresh)
{
    /* the exact tangent where it is found to be positive definite, as it is near a state that lasts */
    int first = pliant_preconditioner_refuses(refresh->preconditioner) ? PLIANT_TWIST_EXACT : PLIANT_TWIST_POSITIVE;
    for (int twist = first; twist <= PLIANT_TWIST_POSITIVE; twist++) {
        pliant_system_tangents(&refresh->system, refresh->x, (pliant_twist)twist, refresh->tangents);
        refresh->status = pliant_preconditioner_numeric(refresh->preconditioner, refresh->tangents);
        if (refresh->status != PLIANT_ERROR_NUMERIC) break;
    }
    pliant_nodal_rotations_refer(&refresh->system, refresh->x, refresh->rotations);
}

static void convert_history(pliant_refresh *refresh)
{
    const int32_t num_free = refresh->system.num_free;
    pliant_nodal_rotations_update(&refresh->system, refresh->now, refresh->rotations);
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
            if (refresh->number[b] > 0) refresh->gram[a * PLIANT_MAX_HISTORY + b] = refresh->gram[b * PLIANT_MAX_HISTORY + a] =
                pliant_dot(3 * (size_t)num_free, refresh->history[a].step, refresh->history[b].residual);
}

static pliant_status refresh_create(pliant_solver *solver)
{
    const pliant_system *system = solver->system;
    pliant_refresh *refresh = solver->refresh = pliant_calloc(1, sizeof *refresh);
    if (!refresh) return pliant_fail_memory("the background factorization");
    refresh->system = *system;
    refresh->system.num_threads = 1;
    const size_t nodes = (size_t)system->mesh->num_nodes;
    refresh->x = pliant_calloc(nodes, 3 * sizeof *refresh->x);
    refresh->now = pliant_calloc(nodes, 3 * sizeof *refresh->now);
    refresh->tangents = pliant_calloc((size_t)system->num_blocks, sizeof *refresh->tangents);
    bool good = refresh->x && refresh->now && refresh->tangents;
    pliant_status status = good ? PLIANT_OK : pliant_fail_memory("the background factorization");
    if (status == PLIANT_OK) status = pliant_nodal_rotations_create(system, &refresh->rotations);
    if (status == PLIANT_OK) status = pliant_secants_create(system, solver->rules.room, refresh->history);
    if (status == PLIANT_OK) status = pliant_preconditioner_clone(system->preconditioner, 1, &refresh->preconditioner);
    if (status != PLIANT_OK) pliant_refresh_free(solver);
    return status;
}

static void *in_background(void *argument)
{
    pliant_refresh *refresh = argument;
    pliant_threads_step_back();
    refresh->work(refresh);
    atomic_store(&refresh->finished, true);
    return NULL;
}

static void start(pliant_refresh *refresh, void (*work)(pliant_refresh *), uint64_t due)
{
    refresh->work = work;
    refresh->due = due;
    refresh->status = PLIANT_OK;
    refresh->running = true;
    atomic_store(&refresh->finished, false);
    refresh->in_thread = pthread_create(&refresh->thread, NULL, in_background, refresh) == 0;
    if (refresh->in_thread) return;
    work(refresh);
    atomic_store(&refresh->finished, true);
}

static void join(pliant_refresh *refresh)
{
    if (refresh->running && refresh->in_thread) pthread_join(refresh->thread, NULL);
    refresh->running = false;
}

/* the history in the axes of all */
static void copy_history(const pliant_solver *solver, pliant_refresh *refresh)
{
    const int32_t num_free = solver->system->num_free;
    const size_t bytes = 3 * (size_t)num_free * sizeof(double);
    memcpy(refresh->number, solver->rules.number, sizeof refresh->number);
    refresh->forgotten = solver->forgotten;
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
}

static void put_in(pliant_solver *solver, pliant_statistics *statistics)
{
    pliant_refresh *refresh = solver->refresh;
    pliant_preconditioner *old = solver->preconditioner;
    pliant_preconditioner_threads(refresh->preconditioner, solver->system->num_threads);
    solver->preconditioner = refresh->preconditioner;
    pliant_preconditioner_threads(old, 1);
    refresh->preconditioner = old;
    pliant_nodal_rotations *axes = solver->rotations;
    solver->rotations = refresh->rotations;
    refresh->rotations = axes;
    pliant_solver_turned(solver);
    solver->factor_serial++;
    statistics->factors++;
    bool converted = refresh->converting && refresh->forgotten == solver->forgotten;
    refresh->converting = false;
    bool kept = solver->posterior.kept; /* a state stays what it is */
    pliant_solver_forget(solver);
    solver->posterior.kept = kept;
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

static void deliver(pliant_solver *solver, uint64_t step, pliant_statistics *statistics)
{
    pliant_refresh *refresh = solver->refresh;
    join(refresh);
    if (refresh->status != PLIANT_OK) {
        pliant_log(PLIANT_LOG_DEBUG, "a new factor could not be made; the old one stays");
        refresh->converting = false;
        return;
    }
    /* what led to a refusal is better forgotten */
    bool useless = pliant_anderson_secants(&solver->rules) == 0 || solver->rules.refused_any;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) useless = useless || pliant_handle_is_spring(solver->handles + t);
    if (refresh->converting || useless) {
        put_in(solver, statistics);
        return;
    }
    copy_history(solver, refresh);
    memcpy(refresh->now, solver->now.x, 3 * (size_t)solver->system->mesh->num_nodes * sizeof *refresh->now);
    refresh->converting = true;
    start(refresh, convert_history, step + (uint64_t)solver->convert_delay);
}

pliant_status pliant_refresh_step(pliant_solver *solver, pliant_statistics *statistics)
{
    if (solver->refresh_interval == 0) return PLIANT_OK;
    if (!solver->refresh) {
        pliant_status status = refresh_create(solver);
        if (status != PLIANT_OK) return status;
    }
    pliant_refresh *refresh = solver->refresh;
    uint64_t step = statistics->step;
    const uint32_t result = refresh->converting ? solver->takes_history : solver->takes_factor;
    if (refresh->running && pliant_background_arrives(solver->background, result, atomic_load(&refresh->finished), step >= refresh->due))
        deliver(solver, step, statistics);
    refresh->wanted = refresh->wanted || solver->rules.rate > PLIANT_SERVES_BADLY;
    bool due = step >= refresh->started + (uint64_t)solver->refresh_interval;
    if (refresh->running || !due || !refresh->wanted) return PLIANT_OK;
    memcpy(refresh->x, solver->now.x, 3 * (size_t)solver->system->mesh->num_nodes * sizeof *refresh->x);
    refresh->started = step;
    refresh->wanted = false;
    start(refresh, make_factor, step + (uint64_t)solver->refresh_delay);
    return PLIANT_OK;
}

void pliant_refresh_free(pliant_solver *solver)
{
    pliant_refresh *refresh = solver->refresh;
    if (!refresh) return;
    join(refresh);
    pliant_preconditioner_free(refresh->preconditioner);
    pliant_nodal_rotations_free(refresh->rotations);
    pliant_secants_free(refresh->history);
    pliant_free(refresh->x);
    pliant_free(refresh->now);
    pliant_free(refresh->tangents);
    pliant_free(refresh);
    solver->refresh = NULL;
}

size_t pliant_refresh_bytes(const pliant_solver *solver)
{
    return solver->refresh && !solver->refresh->running ? pliant_preconditioner_bytes(solver->refresh->preconditioner) : 0;
}
