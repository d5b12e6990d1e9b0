/* Safeguarded Anderson acceleration decided on the GPU: the rules of src/fem/quasistatic/solver.c, step by step. */
#ifndef PLIANT_CUDA_ANDERSON_H
#define PLIANT_CUDA_ANDERSON_H

#include "cuda/fem/state.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Blocks of the dot products. */
int pliant_cuda_dot_blocks(const gpu_iteration *iteration);

/* The step as the host wants it; forces of by-force tools; S and its inverse. */
pliant_status pliant_cuda_begin(const gpu_iteration *iteration, const gpu_step *step, cudaStream_t stream);
/* After the preconditioner (d_left): the springs' share dl, dx and K0 dx complete, their dot products; whether to
 * accept and what comes next; the next trial. gather_blocks: of pliant_cuda_gather_blocks; known: a step's first state,
 * of which the end of the last step has left the forces, their sums and what the preconditioner makes of them. */
pliant_status pliant_cuda_complete(const gpu_iteration *iteration, bool known, int gather_blocks, cudaStream_t stream);
pliant_status pliant_cuda_decide(const gpu_iteration *iteration, int gather_blocks, cudaStream_t stream);
pliant_status pliant_cuda_propose(const gpu_iteration *iteration, cudaStream_t stream);

#ifdef __cplusplus
}
#endif
#endif
