/* Upsampling from solved nodes to fine nodes (src/fem/coarse/upsample.c). */
#ifndef PLIANT_CUDA_UPSAMPLE_H
#define PLIANT_CUDA_UPSAMPLE_H

#include "cuda/fem/solver_state.h"
#include "cuda/fem/system.h"

/* Copy the present iterate's fine nodes to d_fine (num_fine x 3), and the solved nodes to d_solved (num_nodes x 3)
 * unless it is NULL. */
pliant_status pliant_cuda_upsample(const gpu_system *system, const gpu_iteration *iteration, double *d_fine,
                                   double *d_solved, cudaStream_t stream);

#endif
