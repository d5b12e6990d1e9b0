/* Allocates the arrays of the GPU solver's iteration for the size of the system. */
#include "cuda/fem/quasistatic/anderson.h"
#include "cuda/base/check.h"
#include "cuda/fem/element/forces.h"
#include "cuda/fem/quasistatic/solver.h"

struct sized_array { void **d_block; size_t bytes; bool zeroed; }; /* zeroed: also if the block is reused */

template <class T> static sized_array array_of(T **d_block, size_t count, bool zeroed = false)
{
    return {reinterpret_cast<void **>(d_block), count * sizeof(T), zeroed};
}

static size_t count_of_forces(const gpu_system *system)
{
    return system->macros.count == 0 ? 16 * (size_t)system->num_tets : 4 * (size_t)system->macros.corners;
}

static size_t count_of_rotations(const gpu_system *system)
{
    return 16 * (size_t)(system->macros.count == 0 ? system->num_tets : system->macros.count);
}

pliant_status pliant_cuda_solver_size(pliant_cuda_solver *gpu, const pliant_solver *solver)
{
    gpu_iteration *it = &gpu->iteration;
    const gpu_system *system = &gpu->system;
    const size_t n = 3 * (size_t)system->num_free, nodes = 3 * (size_t)system->num_nodes,
                 padded = (size_t)pliant_cuda_inverse_padded((int32_t)n);
    it->num_free = system->num_free;
    it->num_nodes = system->num_nodes;
    it->d_node_of_free = system->d_node_of_free;
    it->d_rest = system->d_rest;
    it->capacity = solver->rules.capacity;
    gpu->gather_blocks = pliant_cuda_gather_blocks(system);
    const size_t history = n * (size_t)(it->capacity > 0 ? it->capacity : 1);
    const size_t all_sums =
        (size_t)GATHER_SUMS * (size_t)gpu->gather_blocks + (size_t)DOT_SUMS * (size_t)pliant_cuda_dot_blocks(it);
    const size_t sums = all_sums > GPU_ROWS * GPU_ROWS ? all_sums : GPU_ROWS * GPU_ROWS; /* newton_after_cut.cu */
    const sized_array arrays[] = {
        array_of(&it->d_state, 1, true),
        array_of(&it->d_history, 1, true),
        array_of(&it->d_x[0], nodes),
        array_of(&it->d_x[1], nodes),
        array_of(&it->d_step[0], n),
        array_of(&it->d_step[1], n),
        array_of(&it->d_residual[0], n),
        array_of(&it->d_residual[1], n),
        array_of(&it->d_load, n),
        array_of(&it->d_extra, n, true),
        array_of(&it->d_contact_force, n, true),
        array_of(&it->d_secant_x, history),
        array_of(&it->d_secant_step, history),
        array_of(&it->d_secant_residual, history),
        array_of(&it->d_element_force, count_of_forces(system)),
        array_of(&it->d_axes, 3 * n),
        array_of(&it->d_free_residual, n),
        array_of(&it->d_past_step, n),
        array_of(&it->d_past_residual, n),
        array_of(&it->d_rotations, count_of_rotations(system)),
        array_of(&it->d_right, padded, true),
        array_of(&it->d_left, padded),
        array_of(&it->d_sums, sums),
        array_of(&gpu->d_fine, 3 * (size_t)system->num_fine),
        array_of(&gpu->d_solved, nodes),
    };
    static_assert(sizeof arrays / sizeof *arrays == SOLVER_ARRAYS, "room for each");
    for (int a = 0; a < SOLVER_ARRAYS - (system->d_fine_rest ? 0 : 1); a++) {
        const void *before = *arrays[a].d_block;
        CUDA_TRY(pliant_cuda_ensure(arrays[a].bytes, gpu->system_capacity.grows, "the solver", arrays[a].d_block,
                                    gpu->capacity + a));
        if (before != *arrays[a].d_block || arrays[a].zeroed)
            CUDA_TRY(CUDA_CALL(cudaMemsetAsync(*arrays[a].d_block, 0, gpu->capacity[a], gpu->stream)));
    }
    CUDA_TRY(pliant_cuda_pressures_set(solver, gpu->system_capacity.grows, gpu->stream, &gpu->iteration.pressures,
                                       &gpu->pressure_memory));
    if (!system->d_fine_rest || gpu->solved_capacity >= nodes * sizeof(double)) return PLIANT_OK;
    pliant_cuda_release_host(gpu->h_solved);
    gpu->h_solved = nullptr;
    gpu->solved_capacity = (gpu->system_capacity.grows ? nodes + nodes / 4 : nodes) * sizeof(double);
    return pliant_cuda_allocate_host(gpu->solved_capacity, "the solved nodes", &gpu->h_solved);
}
