/* Safeguarded Anderson acceleration on the GPU, with the rules of src/fem/quasistatic/solver.c. */
#ifndef PLIANT_CUDA_ANDERSON_H
#define PLIANT_CUDA_ANDERSON_H

#include "cuda/fem/solver_state.h"

/* Return the number of blocks of the dot products. */
int pliant_cuda_dot_blocks(const gpu_iteration *iteration);

/* Start a step: copy the host's inputs, set the forces of tools with prescribed force, compute S and its inverse. */
pliant_status pliant_cuda_begin(const gpu_iteration *iteration, const gpu_step *step, cudaStream_t stream);
/* Process an evaluation after the preconditioner (d_left). `complete` computes dl, the full dx and K0 dx, and their dot
 * products. The step of the pressures follows (pressures.h). `decide` accepts or refuses the state and chooses the next
 * action. `propose` computes the next trial.
 * @param known          The step's first state was evaluated at the end of the last step: forces, sums and
 *     preconditioned step are available.
 * @param gather_blocks  Result of pliant_cuda_gather_blocks. */
pliant_status pliant_cuda_complete(const gpu_iteration *iteration, bool known, int gather_blocks, cudaStream_t stream);
pliant_status pliant_cuda_decide(const gpu_iteration *iteration, int gather_blocks, cudaStream_t stream);
pliant_status pliant_cuda_propose(const gpu_iteration *iteration, cudaStream_t stream);

#endif
