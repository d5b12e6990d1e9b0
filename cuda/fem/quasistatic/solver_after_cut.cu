/* Carries the GPU solver's data over a cut. */
#include "base/fail.h"
#include "cuda/base/check.h"
#include "cuda/base/launch.h"
#include "cuda/fem/element/forces.h"
#include "base/memory.h"
#include "cuda/fem/quasistatic/solver.h"

enum { THREADS = 128 };

static __global__ void __launch_bounds__(THREADS)
    take_axes_kernel(int count, const int *d_before, const double *d_axes, double *d_out)
{
    const int n = (int)(blockIdx.x * THREADS + threadIdx.x), f = n / 9, m = n % 9;
    if (f >= count) return;
    d_out[n] = d_before[f] >= 0 ? d_axes[9 * (size_t)d_before[f] + m] : m % 4 == 0;
}

/* Allocate the arrays for the new system and copy the axes of the nodes. h_before: (num_free) unknown before the cut,
 * or -1. */
static pliant_status size_with_axes(pliant_cuda_solver *gpu, const pliant_solver *solver, const int32_t *h_before)
{
    const int32_t count = gpu->system.num_free;
    const size_t axes = 9 * (size_t)count * sizeof(double), list = (size_t)count * sizeof *h_before;
    CUDA_TRY(pliant_cuda_ensure(axes + list, true, "the solver", &gpu->d_between, &gpu->between_capacity));
    int32_t *d_before = reinterpret_cast<int32_t *>(gpu->d_between + 9 * (size_t)count);
    CUDA_TRY(pliant_cuda_send(h_before, list, d_before, gpu->stream));
    take_axes_kernel<<<blocks_for(9 * (size_t)count, THREADS), THREADS, 0, gpu->stream>>>(
        count, d_before, gpu->iteration.d_axes, gpu->d_between);
    CUDA_TRY(CUDA_LAUNCHED("take_axes_kernel"));
    CUDA_TRY(pliant_cuda_solver_size(gpu, solver));
    return CUDA_CALL(
        cudaMemcpyAsync(gpu->iteration.d_axes, gpu->d_between, axes, cudaMemcpyDeviceToDevice, gpu->stream));
}

static pliant_status carry(pliant_cuda_solver *gpu, const pliant_solver *solver, const int32_t *h_before,
                           bool *possible)
{
    gpu_preconditioner *preconditioner = &gpu->preconditioner;
    const int32_t *h_below = preconditioner->carried.base_free > 0 ? preconditioner->capacity.h_source : nullptr,
                  count = solver->system->num_free;
    int32_t *h_source = static_cast<int32_t *>(pliant_calloc((size_t)count, sizeof *h_source));
    if (!h_source) return pliant_fail_memory("the preconditioner");
    for (int32_t f = 0; f < count; f++) h_source[f] = h_before[f] >= 0 && h_below ? h_below[h_before[f]] : h_before[f];
    return pliant_cuda_carried_set(solver->system, &gpu->system, &preconditioner->layout, h_source, gpu->stream,
                                   &preconditioner->carried, &preconditioner->capacity, possible);
}

pliant_status pliant_cuda_solver_carry_over_cut(pliant_cuda_solver *gpu, const pliant_solver *solver,
                                                const pliant_solver *before, const int32_t *node, bool *possible)
{
    const pliant_system *system = solver->system;
    *possible = system->macros ? !system->macros->fine_start : !before->system->macros;
    if (!*possible) return PLIANT_OK;
    CUDA_TRY(CUDA_CALL(cudaSetDevice(gpu->device)));
    const bool was_deformed = gpu->iteration.d_reference;
    CUDA_TRY(pliant_cuda_refresh_return_to_rest(gpu));
    if (was_deformed) CUDA_TRY(pliant_cuda_rotate(&gpu->system, &gpu->iteration, false, gpu->stream));
    int32_t *h_before = static_cast<int32_t *>(pliant_calloc((size_t)system->num_free, sizeof *h_before));
    if (!h_before) return pliant_fail_memory("the solver");
    for (int32_t f = 0; f < system->num_free; f++) {
        const int32_t was = node[system->node_of_free[f]];
        h_before[f] = was >= 0 ? before->system->free_of_node[was] : -1;
    }
    pliant_status status =
        pliant_cuda_system_carry_over_cut(system, before->system, gpu->stream, &gpu->system, &gpu->system_capacity);
    if (status == PLIANT_OK) status = carry(gpu, solver, h_before, possible);
    if (status == PLIANT_OK && *possible) status = size_with_axes(gpu, solver, h_before);
    pliant_free(h_before);
    if (status != PLIANT_OK || !*possible) return status;
    CUDA_TRY(pliant_cuda_refresh_carry_over_cut(gpu, system->mesh->num_nodes, node));
    pliant_cuda_compliance_discard(&gpu->contacts.blocks);
    CUDA_TRY(pliant_cuda_solver_record(gpu));
    CUDA_TRY(pliant_cuda_pressures_send(&gpu->iteration.pressures, solver, gpu->stream));
    return pliant_cuda_solver_begin(gpu, solver);
}
