/* A preconditioner computed in the background, like the factors in src/fem/quasistatic/refresh.c. It is started in
 * one step and installed a fixed number of steps later, or as in background.h. After a cut, work still in progress
 * becomes the base of the carried preconditioner. Background preconditioners belong to the rest state. A
 * preconditioner of the present state is computed during a step, which waits for it. If that one converges slowly
 * later, one at rest follows. */
#include "base/account.h"
#include "base/fail.h"
#include "base/room.h"
#include "base/threads.h"
#include "cuda/base/check.h"
#include "cuda/fem/element/forces.h"
#include "fem/quasistatic/background.h"
#include "base/memory.h"
#include "cuda/fem/quasistatic/solver.h"
#include "state/discretization.h"

#include <pthread.h>

#include <atomic>
#include <cstring>
#include <new>

struct gpu_renewal {
    pthread_t thread;
    bool running, in_thread;          /* in_thread: false: the thread could not be created */
    std::atomic<bool> finished;
    pliant_account *account;          /* account of the simulation */
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
static pliant_status make(gpu_renewal *renewal)
{
    CUDA_TRY(CUDA_CALL(cudaSetDevice(renewal->device)));
    if (!renewal->stream) {
        int least = 0, greatest = 0;
        CUDA_TRY(CUDA_CALL(cudaDeviceGetStreamPriorityRange(&least, &greatest)));
        CUDA_TRY(CUDA_CALL(cudaStreamCreateWithPriority(&renewal->stream, cudaStreamNonBlocking, least)));
        renewal->pool = pliant_cuda_pool_create(renewal->device);
    }
    pliant_cuda_background_pool(renewal->pool, renewal->stream);
    pliant_cuda_preconditioner_free(&renewal->discarded);
    pliant_cuda_preconditioner_free(&renewal->made); /* left by a failed attempt */
    CUDA_TRY(pliant_system_find_pattern(renewal->of->system));
    pliant_system system = *renewal->of->system;
    system.num_threads = 1;
    CUDA_TRY(pliant_cuda_preconditioner_create(&system, renewal->choice, nullptr, renewal->stream, &renewal->made));
    return CUDA_CALL(cudaStreamSynchronize(renewal->stream));
}

static void *in_background(void *argument)
{
    gpu_renewal *renewal = static_cast<gpu_renewal *>(argument);
    pliant_threads_step_back();
    pliant_memory_apart();
    pliant_account *const before = pliant_account_use(renewal->account);
    pliant_fail_quietly(true);
    pliant_cuda_background_begin();
    renewal->status = make(renewal);
    pliant_cuda_background_end();
    pliant_fail_quietly(false);
    pliant_account_use(before);
    renewal->finished = true;
    return nullptr;
}

static void join(gpu_renewal *renewal)
{
    if (renewal->running && renewal->in_thread) pthread_join(renewal->thread, nullptr);
    renewal->running = false;
}

static void forget_body(gpu_renewal *renewal)
{
    pliant_discretization_release(renewal->of);
    renewal->of = nullptr;
    pliant_free(renewal->source);
    renewal->source = nullptr;
}

static pliant_status start(pliant_cuda_solver *gpu, const pliant_solver *solver, uint64_t step)
{
    if (!gpu->renewal) {
        void *block = pliant_calloc(1, sizeof(gpu_renewal));
        if (!block) return pliant_fail_memory("the background preconditioner");
        gpu->renewal = new (block) gpu_renewal();
    }
    gpu_renewal *renewal = gpu->renewal;
    renewal->device = gpu->device;
    renewal->choice = gpu->choice;
    renewal->of = pliant_discretization_retain(solver->system->of);
    renewal->started = step;
    renewal->due = step + 2 * (uint64_t)solver->refresh_delay; /* as the CPU's first factor after a cut */
    renewal->account = pliant_account_in_use();
    renewal->running = true;
    renewal->finished = false;
    renewal->in_thread = pthread_create(&renewal->thread, nullptr, in_background, renewal) == 0;
    if (!renewal->in_thread) in_background(renewal);
    return PLIANT_OK;
}

static void exchange_bases(gpu_preconditioner *a, gpu_preconditioner *b)
{
    const gpu_preconditioner other = *a;
    a->inverse = b->inverse;
    a->multigrid = b->multigrid;
    a->layout = b->layout;
    a->d_axes = b->d_axes;
    a->d_turned = b->d_turned;
    a->bytes = b->bytes;
    b->inverse = other.inverse;
    b->multigrid = other.multigrid;
    b->layout = other.layout;
    b->d_axes = other.d_axes;
    b->d_turned = other.d_turned;
    b->bytes = other.bytes;
}

/* Install a preconditioner from before a cut as the base. possible: out: false: the cut has opened too much tissue
 * since. */
static pliant_status put_below(pliant_cuda_solver *gpu, const pliant_system *system, bool *possible)
{
    const gpu_renewal *renewal = gpu->renewal;
    int32_t *h_source = static_cast<int32_t *>(pliant_calloc((size_t)system->num_free, sizeof *h_source));
    if (!h_source) return pliant_fail_memory("the preconditioner");
    for (int32_t f = 0; f < system->num_free; f++) {
        const int32_t was = renewal->source[system->node_of_free[f]];
        h_source[f] = was >= 0 ? renewal->of->system->free_of_node[was] : -1;
    }
    gpu_preconditioner *now = &gpu->preconditioner;
    return pliant_cuda_carried_set(system, &gpu->system, &renewal->made.layout, h_source, gpu->stream, &now->carried,
                                   &now->room, possible);
}

static pliant_status deliver(pliant_cuda_solver *gpu, const pliant_solver *solver, pliant_statistics *statistics,
                             bool *renewed)
{
    gpu_renewal *renewal = gpu->renewal;
    gpu_preconditioner *now = &gpu->preconditioner;
    bool possible = true;
    join(renewal);
    pliant_status status = PLIANT_OK;
    if (renewal->status != PLIANT_OK) {
        pliant_log(PLIANT_LOG_DEBUG, "a new preconditioner could not be made on the GPU; the old one stays");
    } else {
        if (renewal->source) status = put_below(gpu, solver->system, &possible);
        else pliant_cuda_carried_clear(&now->carried, &now->room);
        if (possible) exchange_bases(now, &renewal->made);
        exchange_bases(&renewal->discarded, &renewal->made);
        *renewed = possible;
        statistics->factors += possible;
        gpu->of_state = gpu->of_state && !possible;
    }
    forget_body(renewal);
    if (status != PLIANT_OK || !*renewed) return status;
    gpu->in_use.number++;
    pliant_cuda_answers_forget(&gpu->touches.answers);
    return pliant_cuda_solver_record(gpu);
}

extern "C" pliant_status pliant_cuda_renewal_step(pliant_cuda_solver *gpu, const pliant_solver *solver,
                                                  pliant_statistics *statistics, bool *renewed)
{
    const gpu_renewal *renewal = gpu->renewal;
    if (renewal && renewal->running &&
        pliant_background_arrives(solver->background, solver->takes_factor, renewal->finished,
                                  statistics->step >= renewal->due))
        CUDA_TRY(deliver(gpu, solver, statistics, renewed));
    const bool again = gpu->fresh; /* after restored positions, a slow preconditioner may become good again, and the
                                    * next one of the state would wait for one at rest */
    const bool wanted =
        gpu->preconditioner.carried.base_free > 0 || (gpu->of_state && gpu->in_use.served_badly && !again);
    return wanted && !(renewal && renewal->running) ? start(gpu, solver, statistics->step) : PLIANT_OK;
}

/* ---- Immediate creation. */

extern "C" pliant_status pliant_cuda_preconditioner_make(pliant_cuda_solver *gpu, const pliant_solver *solver,
                                                         const gpu_state_made_at *at, gpu_preconditioner *out)
{
    const double start = solver->clock(solver->clock_user);
    CUDA_TRY(pliant_cuda_preconditioner_create(solver->system, gpu->choice, at, gpu->stream, out));
    CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(gpu->stream)));
    return PLIANT_OK;
}

extern "C" pliant_status pliant_cuda_preconditioner_time(pliant_cuda_solver *gpu, const pliant_solver *solver)
{
    gpu_preconditioner another = {};
    pliant_fail_quietly(true);
    const pliant_status status = pliant_cuda_preconditioner_make(gpu, solver, nullptr, &another);
    pliant_fail_quietly(false);
    pliant_cuda_preconditioner_free(&another);
    return status == PLIANT_ERROR_UNAVAILABLE ? pliant_fail(status, "computing the preconditioner on the GPU failed")
                                              : PLIANT_OK;
}

/* Discard the background work. */
static void stop(pliant_cuda_solver *gpu)
{
    gpu_renewal *renewal = gpu->renewal;
    if (!renewal || !renewal->running) return;
    join(renewal);
    forget_body(renewal);
}

/* Replace the present or carried preconditioner immediately. at: Nullable. If no preconditioner can be computed, the
 * old one stays. */
static pliant_status make_now(pliant_cuda_solver *gpu, const pliant_solver *solver, const gpu_state_made_at *at,
                              bool *made)
{
    gpu_preconditioner other = {};
    if (solver->system->of) CUDA_TRY(pliant_system_find_pattern(solver->system->of->system));
    pliant_fail_quietly(true);
    const pliant_status status = pliant_cuda_preconditioner_make(gpu, solver, at, &other);
    pliant_fail_quietly(false);
    *made = status == PLIANT_OK;
    if (*made) {
        pliant_cuda_carried_clear(&gpu->preconditioner.carried, &gpu->preconditioner.room);
        exchange_bases(&gpu->preconditioner, &other);
    }
    pliant_cuda_preconditioner_free(&other);
    if (!*made)
        return status == PLIANT_ERROR_UNAVAILABLE
                   ? pliant_fail(status, "computing the preconditioner on the GPU failed")
                   : PLIANT_OK;
    gpu->of_state = at != nullptr;
    gpu->in_use.number++;
    pliant_cuda_answers_forget(&gpu->touches.answers);
    return pliant_cuda_solver_record(gpu);
}

/* Copy the present state of the step to the host, with matching axes. Both arrays are allocated with pliant_calloc. */
static pliant_status download_state(pliant_cuda_solver *gpu, double *x, double *axes)
{
    const gpu_iteration *it = &gpu->iteration;
    if (!gpu->in_use.rough) {
        CUDA_TRY(pliant_cuda_rotate(&gpu->system, it, false, gpu->stream));
        pliant_in_use_turned(&gpu->in_use);
    }
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(x, it->d_x[gpu->h_state->now], 3 * (size_t)it->num_nodes * sizeof *x,
                                       cudaMemcpyDeviceToHost, gpu->stream)));
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(axes, it->d_axes, 9 * (size_t)it->num_free * sizeof *axes,
                                       cudaMemcpyDeviceToHost, gpu->stream)));
    return CUDA_CALL(cudaStreamSynchronize(gpu->stream));
}

extern "C" pliant_status pliant_cuda_renew_at_rest(pliant_cuda_solver *gpu, const pliant_solver *solver)
{
    bool made;
    if (!gpu->of_state || gpu->preconditioner.carried.base_free > 0) return PLIANT_OK;
    stop(gpu);
    return make_now(gpu, solver, nullptr, &made);
}

extern "C" pliant_status pliant_cuda_renewal_follow(pliant_cuda_solver *gpu, int32_t num_nodes, const int32_t *node)
{
    gpu_renewal *renewal = gpu->renewal;
    if (!renewal || !renewal->running) return PLIANT_OK;
    int32_t *source = static_cast<int32_t *>(pliant_calloc((size_t)num_nodes, sizeof *source));
    if (!source) return pliant_fail_memory("the background preconditioner");
    for (int32_t n = 0; n < num_nodes; n++)
        source[n] = renewal->source && node[n] >= 0 ? renewal->source[node[n]] : node[n];
    pliant_free(renewal->source);
    renewal->source = source;
    return PLIANT_OK;
}

extern "C" void pliant_cuda_renewal_free(pliant_cuda_solver *gpu)
{
    gpu_renewal *renewal = gpu->renewal;
    if (!renewal) return;
    join(renewal);
    pliant_cuda_preconditioner_free(&renewal->made);
    pliant_cuda_preconditioner_free(&renewal->discarded);
    if (renewal->stream) cudaStreamDestroy(renewal->stream);
    pliant_cuda_pool_destroy(renewal->pool);
    forget_body(renewal);
    pliant_free(renewal);
    gpu->renewal = nullptr;
}
