/* From solved nodes to fine nodes (src/fem/coarse/upsample.c). */
#ifndef PLIANT_CUDA_UPSAMPLE_H
#define PLIANT_CUDA_UPSAMPLE_H

#include "cuda/fem/state.h"
#include "cuda/fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The present iterate to d_fine (num_fine x 3), and to d_solved (num_nodes x 3) too where that is not NULL. */
pliant_status pliant_cuda_upsample(const gpu_system *system, const gpu_iteration *iteration, double *d_fine, double *d_solved, cudaStream_t stream);

#ifdef __cplusplus
}
#endif
#endif
