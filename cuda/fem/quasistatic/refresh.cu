/* A preconditioner computed in the background, like the factors in src/fem/quasistatic/refresh.c. It is started in
 * one step and installed a fixed number of steps later, or as in model_data/background.h. After a cut, work still in
 * progress becomes the base of the carried preconditioner. Every preconditioner belongs to the rest state. */
#include "base/worker.h"
#include "base/fail.h"
#include "cuda/base/check.h"
#include "base/memory.h"
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
    const pliant_discretization *of;  /* Nullable: retained: discretization of the result */
    /* (nodes of the solved mesh) node of that discretization's mesh, -1: none; NULL: the meshes are equal. */
    int32_t *source;
    gpu_preconditioner made;          /* contains only a base */
    gpu_preconditioner discarded;     /* freed by the thread */
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
    pliant_cuda_preconditioner_free(&refresh->discarded);
    pliant_cuda_preconditioner_free(&refresh->made); /* left by a failed attempt */
    CUDA_TRY(pliant_system_find_pattern(refresh->of->system));
    pliant_system system = *refresh->of->system;
    system.num_threads = 1;
    CUDA_TRY(pliant_cuda_preconditioner_create(&system, refresh->choice, refresh->stream, &refresh->made));
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
    pliant_discretization_release(refresh->of);
    refresh->of = nullptr;
    pliant_free(refresh->source);
    refresh->source = nullptr;
}

static pliant_status start(pliant_cuda_solver *gpu, const pliant_solver *solver, uint64_t step)
{
    if (!gpu->refresh) {
        gpu->refresh = static_cast<gpu_refresh *>(pliant_calloc(1, sizeof *gpu->refresh));
        if (!gpu->refresh) return pliant_fail_memory("the background preconditioner");
    }
    gpu_refresh *refresh = gpu->refresh;
    refresh->device = gpu->device;
    refresh->choice = gpu->choice;
    refresh->of = pliant_discretization_retain(solver->system->of);
    refresh->started = step;
    refresh->due = step + 2 * (uint64_t)solver->refresh_delay; /* as the CPU's first factor after a cut */
    refresh->running = true;
    pliant_worker_start(&refresh->worker, work, refresh);
    return PLIANT_OK;
}

static void exchange_bases(gpu_preconditioner *a, gpu_preconditioner *b)
{
    std::swap(a->inverse, b->inverse);
    std::swap(a->multigrid, b->multigrid);
    std::swap(a->layout, b->layout);
    std::swap(a->bytes, b->bytes);
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
    } else {
        if (refresh->source) status = install_below_carried(gpu, solver->system, &possible);
        else pliant_cuda_carried_clear(&now->carried, &now->capacity);
        if (possible) exchange_bases(now, &refresh->made);
        exchange_bases(&refresh->discarded, &refresh->made);
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
    const bool wanted = gpu->preconditioner.carried.base_free > 0;
    return wanted && !(refresh && refresh->running) ? start(gpu, solver, statistics->step) : PLIANT_OK;
}

pliant_status pliant_cuda_refresh_carry_over_cut(pliant_cuda_solver *gpu, int32_t num_nodes, const int32_t *node)
{
    gpu_refresh *refresh = gpu->refresh;
    if (!refresh || !refresh->running) return PLIANT_OK;
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
    pliant_cuda_preconditioner_free(&refresh->discarded);
    if (refresh->stream) cudaStreamDestroy(refresh->stream);
    pliant_cuda_pool_destroy(refresh->pool);
    forget_body(refresh);
    pliant_free(refresh);
    gpu->refresh = nullptr;
}
