/* What the solver keeps on the GPU is sized, and carried over to the next body. */
#include "anderson.h"
#include "base/fail.h"
#include "check.h"
#include "forces.h"
#include "pliant/memory.h"
#include "solver.h"

enum { THREADS = 128 };

/* ---- arrays of the iteration */

struct sized_array { void **d_block; size_t bytes; bool zeroed; }; /* zeroed: also where the block is kept */

template <class T> static sized_array array_of(T **d_block, size_t count, bool zeroed = false)
{
    return {reinterpret_cast<void **>(d_block), count * sizeof(T), zeroed};
}

static size_t count_of_forces(const gpu_system *system)
{
    return system->macros.count == 0 ? 16 * (size_t)system->num_tets : 4 * (size_t)system->macros.corners;
}

static size_t count_of_rotations(const gpu_system *system) { return 16 * (size_t)(system->macros.count == 0 ? system->num_tets : system->macros.count); }

extern "C" pliant_status pliant_cuda_solver_size(pliant_cuda_solver *gpu, const pliant_solver *solver)
{
    gpu_iteration *it = &gpu->iteration;
    const gpu_system *system = &gpu->system;
    const size_t n = 3 * (size_t)system->num_free, nodes = 3 * (size_t)system->num_nodes, padded = (size_t)pliant_cuda_inverse_padded((int32_t)n);
    it->num_free = system->num_free;
    it->num_nodes = system->num_nodes;
    it->d_node_of_free = system->d_node_of_free;
    it->d_rest = system->d_rest;
    it->room = solver->rules.room;
    gpu->gather_blocks = pliant_cuda_gather_blocks(system);
    const size_t history = n * (size_t)(it->room > 0 ? it->room : 1);
    const size_t sums = (size_t)GATHER_SUMS * (size_t)gpu->gather_blocks + (size_t)DOT_SUMS * (size_t)pliant_cuda_dot_blocks(it);
    const sized_array arrays[] = {
        array_of(&it->d_state, 1, true),       array_of(&it->d_history, 1, true),          array_of(&it->d_x[0], nodes),
        array_of(&it->d_x[1], nodes),          array_of(&it->d_step[0], n),                array_of(&it->d_step[1], n),
        array_of(&it->d_residual[0], n),       array_of(&it->d_residual[1], n),            array_of(&it->d_load, n),
        array_of(&it->d_extra, n, true),       array_of(&it->d_touch, n, true),
             array_of(&it->d_secant_x, history),         array_of(&it->d_secant_step, history),
        array_of(&it->d_secant_residual, history), array_of(&it->d_element_force, count_of_forces(system)), array_of(&it->d_axes, 3 * n),
        array_of(&it->d_free_residual, n),     array_of(&it->d_past_step, n),              array_of(&it->d_past_residual, n),
        array_of(&it->d_rotations, count_of_rotations(system)),
        array_of(&it->d_right, padded, true),  array_of(&it->d_left, padded),              array_of(&it->d_sums, sums),
        array_of(&gpu->d_fine, 3 * (size_t)system->num_fine), array_of(&gpu->d_solved, nodes),
    };
    static_assert(sizeof arrays / sizeof *arrays == SOLVER_ARRAYS, "room for each");
    for (int a = 0; a < SOLVER_ARRAYS - (system->d_fine_rest ? 0 : 1); a++) {
        const void *before = *arrays[a].d_block;
        CUDA_TRY(pliant_cuda_ensure(arrays[a].bytes, gpu->system_room.grows, "the solver", arrays[a].d_block, gpu->room + a));
        if (before != *arrays[a].d_block || arrays[a].zeroed) CUDA_TRY(CUDA_CALL(cudaMemsetAsync(*arrays[a].d_block, 0, gpu->room[a], gpu->stream)));
    }
    if (!system->d_fine_rest || gpu->solved_room >= nodes * sizeof(double)) return PLIANT_OK;
    pliant_cuda_release_host(gpu->h_solved);
    gpu->h_solved = nullptr;
    gpu->solved_room = (gpu->system_room.grows ? nodes + nodes / 4 : nodes) * sizeof(double);
    return pliant_cuda_allocate_host(gpu->solved_room, "the solved nodes", reinterpret_cast<void **>(&gpu->h_solved));
}

/* ---- the next body */

static __global__ void __launch_bounds__(THREADS) take_axes_kernel(int count, const int *d_before, const double *d_axes, double *d_out)
{
    const int n = (int)(blockIdx.x * THREADS + threadIdx.x), f = n / 9, m = n % 9;
    if (f >= count) return;
    d_out[n] = d_before[f] >= 0 ? d_axes[9 * (size_t)d_before[f] + m] : m % 4 == 0;
}

/* Its arrays, and in them the axes of the nodes that were before. h_before: (num_free) unknown there or -1. */
static pliant_status size_with_axes(pliant_cuda_solver *gpu, const pliant_solver *solver, const int32_t *h_before)
{
    const int32_t count = gpu->system.num_free;
    const size_t axes = 9 * (size_t)count * sizeof(double), list = (size_t)count * sizeof *h_before;
    void *d_between = gpu->d_between;
    pliant_status status = pliant_cuda_ensure(axes + list, true, "the solver", &d_between, &gpu->between_room);
    gpu->d_between = static_cast<double *>(d_between);
    CUDA_TRY(status);
    int32_t *d_before = reinterpret_cast<int32_t *>(gpu->d_between + 9 * (size_t)count);
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(d_before, h_before, list, cudaMemcpyHostToDevice, gpu->stream)));
    take_axes_kernel<<<(unsigned)((9 * (size_t)count + THREADS - 1) / THREADS), THREADS, 0, gpu->stream>>>(count, d_before, gpu->iteration.d_axes, gpu->d_between);
    CUDA_TRY(CUDA_LAUNCHED("take_axes_kernel"));
    CUDA_TRY(pliant_cuda_solver_size(gpu, solver));
    return CUDA_CALL(cudaMemcpyAsync(gpu->iteration.d_axes, gpu->d_between, axes, cudaMemcpyDeviceToDevice, gpu->stream));
}

static pliant_status carry(pliant_cuda_solver *gpu, const pliant_solver *solver, const int32_t *h_before, bool *possible)
{
    gpu_preconditioner *preconditioner = &gpu->preconditioner;
    const int32_t *h_below = preconditioner->carried.base_free > 0 ? preconditioner->room.h_source : nullptr, count = solver->system->num_free;
    int32_t *h_source = static_cast<int32_t *>(pliant_calloc((size_t)count, sizeof *h_source));
    if (!h_source) return pliant_fail_memory("the preconditioner");
    for (int32_t f = 0; f < count; f++) h_source[f] = h_before[f] >= 0 && h_below ? h_below[h_before[f]] : h_before[f];
    return pliant_cuda_carried_set(solver->system, &gpu->system, preconditioner->num_free, h_source, preconditioner->h_whole, gpu->stream,
                                   &preconditioner->carried, &preconditioner->room, possible);
}

extern "C" pliant_status pliant_cuda_solver_follow(pliant_cuda_solver *gpu, const pliant_solver *solver, const pliant_solver *before, const int32_t *node,
                                                   bool *possible)
{
    const pliant_system *system = solver->system;
    *possible = !system->macros == !before->system->macros && (!system->macros || !system->macros->fine_start);
    if (!*possible) return PLIANT_OK;
    CUDA_TRY(CUDA_CALL(cudaSetDevice(gpu->device)));
    int32_t *h_before = static_cast<int32_t *>(pliant_calloc((size_t)system->num_free, sizeof *h_before));
    if (!h_before) return pliant_fail_memory("the solver");
    for (int32_t f = 0; f < system->num_free; f++) h_before[f] = before->system->free_of_node[node[system->node_of_free[f]]];
    pliant_status status = pliant_cuda_system_follow(system, before->system, gpu->stream, &gpu->system, &gpu->system_room);
    if (status == PLIANT_OK) status = carry(gpu, solver, h_before, possible);
    if (status == PLIANT_OK && *possible) status = size_with_axes(gpu, solver, h_before);
    pliant_free(h_before);
    if (status != PLIANT_OK || !*possible) return status;
    CUDA_TRY(pliant_cuda_renewal_follow(gpu, system->mesh->num_nodes, node));
    pliant_cuda_answers_forget(&gpu->touches.answers);
    CUDA_TRY(pliant_cuda_solver_record(gpu));
    return pliant_cuda_solver_begin(gpu, solver);
}
