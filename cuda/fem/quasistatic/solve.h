/* The quasi-static solve on the GPU. Tools, loads and the rules for the start of a step are in the host's
 * pliant_solver. The state stays on the GPU from step to step. */
#ifndef PLIANT_CUDA_SOLVE_H
#define PLIANT_CUDA_SOLVE_H

#include "fem/quasistatic/solver.h"

#include <cuda_runtime_api.h>

typedef struct pliant_cuda_solver pliant_cuda_solver;

/* Create the GPU solver from the present state of the host's solver. Errors: MEMORY, NUMERIC, UNAVAILABLE; the message
 * contains figures. */
/* @param grows  Cuts are possible: reserve memory for more elements. */
pliant_status pliant_cuda_solver_create(const pliant_solver *solver, pliant_preconditioner_choice choice, bool grows,
                                        int device, cudaStream_t stream, pliant_cuda_solver **out);
/* Switch to the solver after a cut. The preconditioner is carried over, and unchanged data is not sent again. Errors:
 * MEMORY, UNAVAILABLE.
 * @param node      (nodes of the solved mesh) node before the cut whose values each node takes.
 * @param possible  Out: false: the solver cannot follow; the caller frees it, as after an error. */
pliant_status pliant_cuda_solver_carry_over_cut(pliant_cuda_solver *gpu, const pliant_solver *solver,
                                                const pliant_solver *before, const int32_t *node, bool *possible);
void pliant_cuda_solver_free(pliant_cuda_solver *gpu); /* Nullable */
/* Read the host's state again (after a reset). */
pliant_status pliant_cuda_solver_restart(pliant_cuda_solver *gpu, const pliant_solver *solver);
/* Read the host's node positions. The preconditioner stays unchanged. */
pliant_status pliant_cuda_solver_move(pliant_cuda_solver *gpu, const pliant_solver *solver);

/* Run pliant_solver_step on the GPU. The tools' forces and the statistics are copied to the host, positions
 * and pressures are not. */
pliant_status pliant_cuda_solver_step(pliant_cuda_solver *gpu, pliant_solver *solver, const double gravity[3],
                                      pliant_statistics *statistics);
/* Enqueue the upsampling. *d_positions: (fine nodes x 3), valid when the stream has reached this point. */
pliant_status pliant_cuda_solver_upsample(pliant_cuda_solver *gpu, const double **d_positions);
/* Enqueue a copy of the state to the host's memory: pressures, and solved nodes unless they are the fine nodes. */
pliant_status pliant_cuda_solver_download(pliant_cuda_solver *gpu);
/* Give this copy to the host's solver. The stream was synchronized. */
void pliant_cuda_solver_take(const pliant_cuda_solver *gpu, pliant_solver *solver);
/* Enqueue a replacement of the last upsampling's fine positions (fine nodes x 3). */
pliant_status pliant_cuda_solver_place(pliant_cuda_solver *gpu, const double *h_fine);

#endif
