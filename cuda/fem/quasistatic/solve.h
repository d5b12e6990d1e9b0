/* The quasi-static solve on the GPU. Tools, loads and decisions of when to begin stay with the host's pliant_solver;
 * the state stays on the GPU from step to step. */
#ifndef PLIANT_CUDA_SOLVE_H
#define PLIANT_CUDA_SOLVE_H

#include "fem/quasistatic/solver.h"

#include <cuda_runtime_api.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_cuda_solver pliant_cuda_solver;

/* From the present state of the host's solver. Errors: MEMORY, NUMERIC, UNAVAILABLE; the message has figures. */
/* grows: there may be cuts: its arrays have room for more. */
pliant_status pliant_cuda_solver_create(const pliant_solver *solver, pliant_preconditioner_choice choice, bool grows, int device, cudaStream_t stream,
                                        pliant_cuda_solver **out);
/* To the solver of the next body, which has followed the one before; what stands for the inverse of the stiffness is
 * carried over, and what is the same is not sent again. node: (nodes of the solved mesh) what each takes after. Where
 * this is not possible, or fails, it is left for being freed. Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_solver_follow(pliant_cuda_solver *gpu, const pliant_solver *solver, const pliant_solver *before, const int32_t *node, bool *possible);
void pliant_cuda_solver_free(pliant_cuda_solver *gpu); /* Nullable */
/* Take the host's state again (after a reset). */
pliant_status pliant_cuda_solver_restart(pliant_cuda_solver *gpu, const pliant_solver *solver);
/* Take where the host has the nodes; the preconditioner stays, of whatever state it is. */
pliant_status pliant_cuda_solver_move(pliant_cuda_solver *gpu, const pliant_solver *solver);

/* pliant_solver_step: the tools' forces and the statistics come back, positions stay. */
pliant_status pliant_cuda_solver_step(pliant_cuda_solver *gpu, pliant_solver *solver, const double gravity[3], pliant_statistics *statistics);
/* Enqueue the upsampling. *d_positions: (fine nodes x 3), valid when the stream has come so far */
pliant_status pliant_cuda_solver_upsample(pliant_cuda_solver *gpu, const double **d_positions);
/* Enqueue the solved nodes' copy to the host; NULL when they are the fine nodes. Valid after the stream was
 * synchronized. */
pliant_status pliant_cuda_solver_download(pliant_cuda_solver *gpu, const double **h_solved);
/* Enqueue other fine positions (fine nodes x 3) where those of the last upsampling are. */
pliant_status pliant_cuda_solver_place(pliant_cuda_solver *gpu, const double *h_fine);

#ifdef __cplusplus
}
#endif
#endif
