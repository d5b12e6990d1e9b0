/* A preconditioner computed in the background, like the factors in src/fem/quasistatic/refresh.c. It is started in
 * one step and installed a fixed number of steps later, or as in model_data/background.h.
 *
 * Under tools, after a refused trial, a preconditioner of the present, deformed state is made. After a cut, one of the
 * rest state replaces the carried one. Carried ones belong to the rest state, so a cut drops all others. */
#include "base/worker.h"
#include "base/fail.h"
#include "cuda/base/check.h"
#include "base/memory.h"
#include "cuda/fem/element/forces.h"
#include "fem/quasistatic/pressure.h"
#include "cuda/fem/quasistatic/solver.h"
#include "model_data/discretization.h"

#include <cstring>
#include <utility>

struct gpu_refresh {
    pliant_worker worker;
    bool running;                     /* the result was not taken yet */
    uint64_t started, due;            /* steps */
    int device;
    pliant_preconditioner_choice choice;
    cudaStream_t stream;              /* lower priority than the steps' stream */
    cudaMemPool_t pool;               /* Nullable: memory pool of everything allocated here */
    const pliant_discretization *of;  /* Nullable: retained: discretization that contains the system */
    pliant_system system;             /* of the result, if no discretization contains it */
    /* (nodes of the solved mesh) node of that discretization's mesh, -1: none; NULL: the meshes are equal. */
    int32_t *source;
    /* Nullable: (3 num_nodes) deformed state of the result; NULL: the rest state. */
    double *x;
    double *volume_pressure;          /* Nullable: (elements) its pressures times volume [N m] */
    double *d_reference;              /* Nullable: its axes (gpu_iteration.d_reference) */
    size_t reference_capacity;
    bool is_dropped;                  /* the result will not be used */
    gpu_preconditioner made;          /* contains only a base */
    gpu_preconditioner discarded[2];  /* freed by the thread */
    pliant_status status;
};

/* Compute the preconditioner, in the thread. No other thread reads the pattern until it has finished. */
static pliant_status make(gpu_refresh *refresh)
{
    CUDA_TRY(CUDA_CALL(cudaSetDevice(refresh->device)));
    if (!refresh->stream) {
        int lowest = 0, highest = 0;
        CUDA_TRY(CUDA_CALL(cudaDeviceGetStreamPriorityRange(&lowest, &highest)));
        CUDA_TRY(CUDA_CALL(cudaStreamCreateWithPriority(&refresh->stream, cudaStreamNonBlocking, lowest)));
        refresh->pool = pliant_cuda_pool_create(refresh->device);
    }
    pliant_cuda_background_pool(refresh->pool, refresh->stream);
    for (gpu_preconditioner &discarded : refresh->discarded) pliant_cuda_preconditioner_free(&discarded);
    pliant_cuda_preconditioner_free(&refresh->made); /* left by a failed attempt */
    if (refresh->of) CUDA_TRY(pliant_system_find_pattern(refresh->of->system));
    pliant_system system = refresh->of ? *refresh->of->system : refresh->system;
    system.num_threads = 1;
    system.volume_pressure = refresh->volume_pressure;
    const double *h_x = refresh->x ? refresh->x : system.mesh->rest;
    CUDA_TRY(pliant_cuda_preconditioner_create(&system, h_x, refresh->choice, refresh->stream, &refresh->made));
    return CUDA_CALL(cudaStreamSynchronize(refresh->stream));
}

static void work(void *argument)
{
    gpu_refresh *refresh = static_cast<gpu_refresh *>(argument);
    pliant_fail_quietly(true);
    pliant_cuda_background_begin();
    refresh->status = make(refresh);
    pliant_cuda_background_end();
    pliant_fail_quietly(false);
}

static void join(gpu_refresh *refresh)
{
    pliant_worker_join(&refresh->worker);
    refresh->running = false;
}

static void forget_body(gpu_refresh *refresh)
{
    if (refresh->of) pliant_discretization_release(refresh->of);
    pliant_free(refresh->source);
    pliant_free(refresh->x);
    pliant_free(refresh->volume_pressure);
    refresh->of = nullptr;
    refresh->source = nullptr;
    refresh->x = refresh->volume_pressure = nullptr;
    refresh->is_dropped = false;
}

static void exchange_bases(gpu_preconditioner *a, gpu_preconditioner *b)
{
    std::swap(a->inverse, b->inverse);
    std::swap(a->multigrid, b->multigrid);
    std::swap(a->layout, b->layout);
    std::swap(a->bytes, b->bytes);
}

/* Save the present state: positions, pressures, and rotations since rest. */
static pliant_status save_state(pliant_cuda_solver *gpu, const pliant_solver *solver, gpu_refresh *refresh)
{
    const pliant_system *system = solver->system;
    const size_t count = 3 * (size_t)system->mesh->num_nodes;
    refresh->x = static_cast<double *>(pliant_calloc(count, sizeof *refresh->x));
    if (solver->pressures)
        refresh->volume_pressure = static_cast<double *>(
            pliant_calloc((size_t)pliant_element_count(system), sizeof *refresh->volume_pressure));
    if (!refresh->x || (solver->pressures && !refresh->volume_pressure))
        return pliant_fail_memory("the background preconditioner");
    memcpy(refresh->x, solver->now.x, count * sizeof *refresh->x);
    pliant_pressure_times_volume(solver, refresh->volume_pressure);
    CUDA_TRY(pliant_cuda_ensure(9 * (size_t)system->num_free * sizeof(double), gpu->system_capacity.grows, "the solver",
                                &refresh->d_reference, &refresh->reference_capacity));
    gpu_iteration since_rest = gpu->iteration;
    since_rest.d_axes = refresh->d_reference;
    since_rest.d_reference = nullptr;
    return pliant_cuda_rotate(&gpu->system, &since_rest, false, gpu->stream);
}

static pliant_status start(pliant_cuda_solver *gpu, const pliant_solver *solver, bool is_deformed, uint64_t step)
{
    if (!gpu->refresh) {
        gpu->refresh = static_cast<gpu_refresh *>(pliant_calloc(1, sizeof *gpu->refresh));
        if (!gpu->refresh) return pliant_fail_memory("the background preconditioner");
    }
    gpu_refresh *refresh = gpu->refresh;
    refresh->started = step;
    gpu->wants_refresh = false;
    const pliant_status status = is_deformed ? save_state(gpu, solver, refresh) : PLIANT_OK;
    if (status != PLIANT_OK) {
        forget_body(refresh);
        return status == PLIANT_ERROR_MEMORY ? PLIANT_OK : status; /* the old preconditioner stays */
    }
    refresh->device = gpu->device;
    refresh->choice = gpu->choice;
    if (solver->system->of) refresh->of = pliant_discretization_retain(solver->system->of);
    refresh->system = *solver->system;
    refresh->due = step + (uint64_t)solver->refresh_delay * (is_deformed ? 1 : 2); /* as the CPU's factors */
    refresh->running = true;
    exchange_bases(refresh->discarded + 1, &gpu->unused);
    pliant_worker_start(&refresh->worker, work, refresh);
    return PLIANT_OK;
}

/* Install a preconditioner of a deformed state, and its axes. */
static pliant_status install_deformed(pliant_cuda_solver *gpu)
{
    gpu_refresh *refresh = gpu->refresh;
    if (!gpu->iteration.d_reference) exchange_bases(&gpu->at_rest, &gpu->preconditioner);
    exchange_bases(&gpu->preconditioner, &refresh->made);
    std::swap(gpu->d_reference, refresh->d_reference);
    std::swap(gpu->reference_capacity, refresh->reference_capacity);
    gpu->iteration.d_reference = gpu->d_reference;
    pliant_preconditioner_use_rotated(&gpu->in_use);
    return pliant_cuda_rotate(&gpu->system, &gpu->iteration, false, gpu->stream);
}

/* Install a preconditioner from before a cut as the base. possible: out: false: the cut has opened too much tissue
 * since. */
static pliant_status install_below_carried(pliant_cuda_solver *gpu, const pliant_system *system, bool *possible)
{
    const gpu_refresh *refresh = gpu->refresh;
    int32_t *h_source = static_cast<int32_t *>(pliant_calloc((size_t)system->num_free, sizeof *h_source));
    if (!h_source) return pliant_fail_memory("the preconditioner");
    for (int32_t f = 0; f < system->num_free; f++) {
        const int32_t was = refresh->source[system->node_of_free[f]];
        h_source[f] = was >= 0 ? refresh->of->system->free_of_node[was] : -1;
    }
    gpu_preconditioner *now = &gpu->preconditioner;
    return pliant_cuda_carried_set(system, &gpu->system, &refresh->made.layout, h_source, gpu->stream, &now->carried,
                                   &now->capacity, possible);
}

static pliant_status deliver(pliant_cuda_solver *gpu, const pliant_solver *solver, pliant_statistics *statistics,
                             bool *renewed)
{
    gpu_refresh *refresh = gpu->refresh;
    gpu_preconditioner *now = &gpu->preconditioner;
    bool possible = true;
    join(refresh);
    pliant_status status = PLIANT_OK;
    if (refresh->status != PLIANT_OK) {
        pliant_log(PLIANT_LOG_DEBUG, "a new preconditioner could not be made on the GPU; the old one stays");
    } else if (refresh->is_dropped) {
        exchange_bases(refresh->discarded, &refresh->made);
    } else {
        if (refresh->x) status = install_deformed(gpu);
        else if (refresh->source) status = install_below_carried(gpu, solver->system, &possible);
        else pliant_cuda_carried_clear(&now->carried, &now->capacity);
        if (possible && !refresh->x) exchange_bases(now, &refresh->made);
        exchange_bases(refresh->discarded, &refresh->made);
        *renewed = possible;
        statistics->factors += possible;
    }
    forget_body(refresh);
    if (status != PLIANT_OK || !*renewed) return status;
    gpu->in_use.number++;
    pliant_cuda_compliance_discard(&gpu->contacts.blocks);
    return pliant_cuda_solver_record(gpu);
}

pliant_status pliant_cuda_refresh_step(pliant_cuda_solver *gpu, const pliant_solver *solver,
                                       pliant_statistics *statistics, bool *renewed)
{
    const gpu_refresh *refresh = gpu->refresh;
    if (refresh && refresh->running &&
        pliant_background_installs(solver->background, solver->takes_factor,
                                   pliant_worker_has_finished(&refresh->worker), statistics->step >= refresh->due))
        CUDA_TRY(deliver(gpu, solver, statistics, renewed));
    const bool is_carried = gpu->preconditioner.carried.base_free > 0;
    const uint64_t interval = (uint64_t)solver->refresh_interval,
                   next = refresh ? refresh->started + interval : interval;
    const bool is_due = gpu->wants_refresh && interval > 0 && statistics->step >= next;
    if ((refresh && refresh->running) || !(is_carried || is_due)) return PLIANT_OK;
    return start(gpu, solver, !is_carried, statistics->step);
}

pliant_status pliant_cuda_refresh_return_to_rest(pliant_cuda_solver *gpu)
{
    gpu->wants_refresh = false;
    if (gpu->refresh && gpu->refresh->running && gpu->refresh->x) gpu->refresh->is_dropped = true;
    if (!gpu->iteration.d_reference) return PLIANT_OK;
    gpu->iteration.d_reference = nullptr;
    exchange_bases(&gpu->preconditioner, &gpu->at_rest);
    exchange_bases(&gpu->unused, &gpu->at_rest);
    gpu->in_use.number++;
    pliant_cuda_compliance_discard(&gpu->contacts.blocks);
    return pliant_cuda_solver_record(gpu);
}

pliant_status pliant_cuda_refresh_restart(pliant_cuda_solver *gpu, const pliant_solver *solver)
{
    gpu_refresh *refresh = gpu->refresh;
    if (refresh && refresh->running && refresh->x && !pliant_background_is_live(solver->background)) {
        join(refresh);
        forget_body(refresh);
    }
    if (refresh) refresh->started = 0;
    return pliant_cuda_refresh_return_to_rest(gpu);
}

pliant_status pliant_cuda_refresh_carry_over_cut(pliant_cuda_solver *gpu, int32_t num_nodes, const int32_t *node)
{
    gpu_refresh *refresh = gpu->refresh;
    if (!refresh || !refresh->running || refresh->is_dropped) return PLIANT_OK;
    int32_t *source = static_cast<int32_t *>(pliant_calloc((size_t)num_nodes, sizeof *source));
    if (!source) return pliant_fail_memory("the background preconditioner");
    for (int32_t n = 0; n < num_nodes; n++)
        source[n] = refresh->source && node[n] >= 0 ? refresh->source[node[n]] : node[n];
    pliant_free(refresh->source);
    refresh->source = source;
    return PLIANT_OK;
}

void pliant_cuda_refresh_free(pliant_cuda_solver *gpu)
{
    gpu_refresh *refresh = gpu->refresh;
    if (!refresh) return;
    join(refresh);
    pliant_cuda_preconditioner_free(&refresh->made);
    for (gpu_preconditioner &discarded : refresh->discarded) pliant_cuda_preconditioner_free(&discarded);
    pliant_cuda_release(refresh->d_reference);
    if (refresh->stream) cudaStreamDestroy(refresh->stream);
    pliant_cuda_pool_destroy(refresh->pool);
    forget_body(refresh);
    pliant_free(refresh);
    gpu->refresh = nullptr;
}
