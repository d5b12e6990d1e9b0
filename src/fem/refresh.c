/* New factors in the background: started from the state of one step, put to use a fixed number of steps later, whether the
 * other thread was fast or not, so that timing never changes results. */
#include "core/fail.h"
#include "fem/solver.h"
#include "pliant/memory.h"

#include <pthread.h>
#include <string.h>

struct pliant_refresh {
    pthread_t thread;
    bool running;
    bool in_thread;             /* false: no thread could be had, the work was done at once */
    uint64_t started;           /* step */
    bool wanted;                /* the factor at hand has served badly since the last start */
    pliant_system system;       /* a copy of the constant system, one thread */
    pliant_preconditioner *preconditioner; /* the one being made */
    double *x;                  /* (3 num_nodes) */
    pliant_tangent *tangents;
    pliant_status status;
};

static void *make_factor(void *argument)
{
    pliant_refresh *refresh = argument;
    /* the exact tangent where it is found to be positive definite, as it is near a state that lasts */
    int first = pliant_preconditioner_refuses(refresh->preconditioner) ? PLIANT_TWIST_EXACT : PLIANT_TWIST_POSITIVE;
    for (int twist = first; twist <= PLIANT_TWIST_POSITIVE; twist++) {
        pliant_system_tangents(&refresh->system, refresh->x, (pliant_twist)twist, refresh->tangents);
        refresh->status = pliant_preconditioner_numeric(refresh->preconditioner, refresh->tangents);
        if (refresh->status != PLIANT_ERROR_NUMERIC) break;
    }
    return NULL;
}

static pliant_status refresh_create(pliant_solver *solver)
{
    const pliant_system *system = solver->system;
    pliant_refresh *refresh = solver->refresh = pliant_calloc(1, sizeof *refresh);
    if (!refresh) return pliant_fail_memory("the background factorization");
    refresh->system = *system;
    refresh->system.num_threads = 1;
    refresh->x = pliant_calloc((size_t)system->mesh->num_nodes, 3 * sizeof *refresh->x);
    refresh->tangents = pliant_calloc((size_t)system->num_blocks, sizeof *refresh->tangents);
    pliant_status status = refresh->x && refresh->tangents ? PLIANT_OK : pliant_fail_memory("the background factorization");
    if (status == PLIANT_OK) status = pliant_preconditioner_clone(system->preconditioner, 1, &refresh->preconditioner);
    if (status != PLIANT_OK) pliant_refresh_free(solver);
    return status;
}

static void join(pliant_refresh *refresh)
{
    if (refresh->running && refresh->in_thread) pthread_join(refresh->thread, NULL);
    refresh->running = false;
}

static void deliver(pliant_solver *solver, pliant_statistics *statistics)
{
    pliant_refresh *refresh = solver->refresh;
    join(refresh);
    if (refresh->status != PLIANT_OK) {
        pliant_log(PLIANT_LOG_DEBUG, "a new factor could not be made; the old one stays");
        return;
    }
    pliant_preconditioner *old = solver->preconditioner;
    solver->preconditioner = refresh->preconditioner;
    refresh->preconditioner = old;
    solver->factor_serial++;
    bool kept = solver->hindsight.kept; /* a state stays what it is */
    pliant_solver_forget(solver); /* steps of the history belong to the old factor */
    solver->hindsight.kept = kept;
    statistics->factors++;
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
    if (refresh->running && step >= refresh->started + (uint64_t)solver->refresh_delay) deliver(solver, statistics);
    /* a good factor brings every evaluation's merit down to a fraction; a new one costs the history */
    const double served_badly = 0.15;
    refresh->wanted = refresh->wanted || solver->rate > served_badly;
    bool due = step >= refresh->started + (uint64_t)solver->refresh_interval;
    if (refresh->running || !due || !refresh->wanted) return PLIANT_OK;
    memcpy(refresh->x, solver->now.x, 3 * (size_t)solver->system->mesh->num_nodes * sizeof *refresh->x);
    refresh->started = step;
    refresh->wanted = false;
    refresh->running = true;
    refresh->in_thread = pthread_create(&refresh->thread, NULL, make_factor, refresh) == 0;
    if (!refresh->in_thread) make_factor(refresh);
    return PLIANT_OK;
}

void pliant_refresh_free(pliant_solver *solver)
{
    pliant_refresh *refresh = solver->refresh;
    if (!refresh) return;
    join(refresh);
    pliant_preconditioner_free(refresh->preconditioner);
    pliant_free(refresh->x);
    pliant_free(refresh->tangents);
    pliant_free(refresh);
    solver->refresh = NULL;
}

size_t pliant_refresh_bytes(const pliant_solver *solver)
{
    return solver->refresh && !solver->refresh->running ? pliant_preconditioner_bytes(solver->refresh->preconditioner) : 0;
}
