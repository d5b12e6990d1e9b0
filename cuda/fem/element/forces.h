/* Corotated elastic forces and the residual (src/fem/element/elements.c, src/fem/quasistatic/evaluate.c). */
#ifndef PLIANT_CUDA_FORCES_H
#define PLIANT_CUDA_FORCES_H

#include "cuda/fem/state.h"
#include "cuda/fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Blocks of the gather, and numbers that each sums up: work of the load, work of the elastic forces. */
int pliant_cuda_gather_blocks(const gpu_system *system);

/* Of the iterate under evaluation: element forces; the tools' forces to d_extra. */
pliant_status pliant_cuda_forces(const gpu_system *system, const gpu_iteration *iteration, cudaStream_t stream);
/* d_residual = T' (load + extra - elastic), T = d_axes; d_right = the same; sums of work to d_sums. In a fixed
 * order. */
pliant_status pliant_cuda_gather(const gpu_system *system, const gpu_iteration *iteration, cudaStream_t stream);
/* d_axes: the rotation nearest to the mean of the elements' rotations around each node of the present iterate;
 * identity: none at all. */
pliant_status pliant_cuda_rotate(const gpu_system *system, const gpu_iteration *iteration, bool identity, cudaStream_t stream);

#ifdef __cplusplus
}
#endif
#endif
