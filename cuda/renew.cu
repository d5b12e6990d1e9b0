/* A preconditioner made in the background, as src/fem/quasistatic/refresh.c makes factors: begun in one step, put to use a fixed number of
 * steps later or as background.h says. What is being made for a body when the next one comes becomes the base of what is carried over. */
#include "base/fail.h"
#include "base/room.h"
#include "base/threads.h"
#include "check.h"
#include "fem/quasistatic/background.h"
#include "pliant/memory.h"
#include "solver.h"
#include "state/discretization.h"

#include <pthread.h>

#include <atomic>
#include <cstring>
#include <new>

struct gpu_renewal {
    pthread_t thread;
    bool running, in_thread;          /* in_thread: false: no thread could be had */
    std::atomic<bool> finished;
    uint64_t due;                     /* step */
    int device;
    pliant_preconditioner_choice choice;
    cudaStream_t stream;              /* lets that of the steps go first */
    cudaMemPool_t pool;               /* Nullable: of all that is made here */
    const pliant_discretization *of;  /* Nullable: retained: what it is made for */
    int32_t *source;                  /* (nodes of the solved mesh) node of that one's mesh, -1: none; NULL: they are the same */
    gpu_preconditioner made;          /* nothing but a base */
    gpu_preconditioner discarded;     /* freed by the thread */
    pliant_status status;
};

/* In the thread. No other one looks at the pattern before this one has ended. */
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
    pliant_cuda_preconditioner_free(&renewal->made); /* of one that failed */
    CUDA_TRY(pliant_system_find_pattern(renewal->of->system));
    pliant_system system = *renewal->of->system;
    system.num_threads = 1;
    CUDA_TRY(pliant_cuda_preconditioner_create(&system, renewal->choice, renewal->stream, &renewal->made));
    return CUDA_CALL(cudaStreamSynchronize(renewal->stream));
}

static void *in_background(void *argument)
{
    gpu_renewal *renewal = static_cast<gpu_renewal *>(argument);
    pliant_threads_step_back();
    pliant_memory_apart();
    pliant_fail_quietly(true);
    pliant_cuda_background_begin();
    renewal->status = make(renewal);
    pliant_cuda_background_end();
    pliant_fail_quietly(false);
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
    renewal->due = step + 2 * (uint64_t)solver->refresh_delay; /* as the CPU's first factor of a body */
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
    a->num_free = b->num_free;
    a->h_whole = b->h_whole;
    a->bytes = b->bytes;
    b->inverse = other.inverse;
    b->multigrid = other.multigrid;
    b->num_free = other.num_free;
    b->h_whole = other.h_whole;
    b->bytes = other.bytes;
}

/* of a body before: false: too much has been opened since */
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
    return pliant_cuda_carried_set(system, &gpu->system, renewal->made.num_free, h_source, renewal->made.h_whole, gpu->stream, &now->carried, &now->room, possible);
}

static pliant_status deliver(pliant_cuda_solver *gpu, const pliant_solver *solver, pliant_statistics *statistics, bool *renewed)
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
    }
    forget_body(renewal);
    if (status != PLIANT_OK || !*renewed) return status;
    gpu->in_use.number++;
    pliant_cuda_answers_forget(&gpu->touches.answers);
    return pliant_cuda_solver_record(gpu);
}

extern "C" pliant_status pliant_cuda_renewal_step(pliant_cuda_solver *gpu, const pliant_solver *solver, pliant_statistics *statistics, bool *renewed)
{
    const gpu_renewal *renewal = gpu->renewal;
    if (renewal && renewal->running && pliant_background_arrives(solver->background, solver->takes_factor, renewal->finished, statistics->step >= renewal->due))
        CUDA_TRY(deliver(gpu, solver, statistics, renewed));
    if (gpu->preconditioner.carried.base_free == 0 || (renewal && renewal->running)) return PLIANT_OK;
    return start(gpu, solver, statistics->step);
}

extern "C" pliant_status pliant_cuda_renewal_follow(pliant_cuda_solver *gpu, int32_t num_nodes, const int32_t *node)
{
    gpu_renewal *renewal = gpu->renewal;
    if (!renewal || !renewal->running) return PLIANT_OK;
    int32_t *source = static_cast<int32_t *>(pliant_calloc((size_t)num_nodes, sizeof *source));
    if (!source) return pliant_fail_memory("the background preconditioner");
    for (int32_t n = 0; n < num_nodes; n++) source[n] = renewal->source && node[n] >= 0 ? renewal->source[node[n]] : node[n];
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
