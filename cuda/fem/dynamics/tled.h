/* Explicit dynamics on the GPU. Tools, time steps and what to do about divergence stay with the host's pliant_tled;
 * the state stays on the GPU from frame to frame, and displacements and increments come to the host's at the end of
 * each. */
#ifndef PLIANT_CUDA_TLED_H
#define PLIANT_CUDA_TLED_H

#include "fem/dynamics/tled.h"

#include <cuda_runtime_api.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_cuda_tled pliant_cuda_tled;

/* tled: borrowed; outlives the object. Errors: MEMORY (with figures), UNAVAILABLE. */
pliant_status pliant_cuda_tled_create(pliant_tled *tled, int device, pliant_cuda_tled **out);
void pliant_cuda_tled_free(pliant_cuda_tled *gpu); /* Nullable */
/* The next frame begins with the host's state. */
void pliant_cuda_tled_restart(pliant_cuda_tled *gpu);
/* A pliant_tled_runner; with: the object. Errors: MEMORY, UNAVAILABLE: the host's state is that of the last frame. */
pliant_status pliant_cuda_tled_run(void *with, pliant_tled *tled, pliant_tool *tools, int num_tools, pliant_tled_frame *out);
/* Of the last frame, on the GPU (num_nodes x 3), and where work that needs them is to be enqueued. */
const double *pliant_cuda_tled_positions(const pliant_cuda_tled *gpu);
/* Until the next frame, others: where the host has moved nodes. Errors: UNAVAILABLE. */
pliant_status pliant_cuda_tled_set_positions(pliant_cuda_tled *gpu, const double *h_positions);
cudaStream_t pliant_cuda_tled_stream(const pliant_cuda_tled *gpu);

#ifdef __cplusplus
}
#endif
#endif
