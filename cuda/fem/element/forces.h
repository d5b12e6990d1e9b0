/* Elastic forces and the residual (src/fem/element/elements.c, src/fem/quasistatic/residual.c). */
#ifndef PLIANT_CUDA_FORCES_H
#define PLIANT_CUDA_FORCES_H

#include "cuda/fem/solver_state.h"
#include "cuda/fem/system.h"

/* Return the number of blocks of the gather. Each block has two sums: work of the load, and of the elastic forces. */
int pliant_cuda_gather_blocks(const gpu_system *system);

/* Compute the element forces of the evaluated iterate, including the forces of pressures and the changes of volume on
 * which they act, and the tools' forces in d_extra. */
pliant_status pliant_cuda_forces(const gpu_system *system, const gpu_iteration *iteration, cudaStream_t stream);
/* Compute d_residual = T' (load + extra - elastic) with T = d_axes, d_right as its copy, and the sums of work in
 * d_sums. The order is fixed. */
pliant_status pliant_cuda_gather(const gpu_system *system, const gpu_iteration *iteration, cudaStream_t stream);
/* Compute d_axes: the rotation nearest to the mean of the rotations of adjacent elements in the present iterate, since
 * d_reference.
 * identity: set I instead. */
pliant_status pliant_cuda_rotate(const gpu_system *system, const gpu_iteration *iteration, bool identity,
                                 cudaStream_t stream);

#endif
