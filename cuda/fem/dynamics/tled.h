/* Explicit dynamics on the GPU. The host's pliant_tled handles tools, time steps and divergence. The state stays on the
 * GPU from frame to frame. Displacements and increments are copied to the host at the end of each frame. */
#ifndef PLIANT_CUDA_TLED_H
#define PLIANT_CUDA_TLED_H

#include "fem/dynamics/tled.h"

#include <cuda_runtime_api.h>

typedef struct pliant_cuda_tled pliant_cuda_tled;

/* Create the GPU state. tled: borrowed; it outlives the object. Errors: MEMORY (with figures), UNAVAILABLE. */
pliant_status pliant_cuda_tled_create(pliant_tled *tled, int device, pliant_cuda_tled **out);
void pliant_cuda_tled_free(pliant_cuda_tled *gpu); /* Nullable */
/* Read the host's state at the start of the next frame. */
void pliant_cuda_tled_restart(pliant_cuda_tled *gpu);
/* Run a frame (pliant_tled_runner). with: the object. Errors: MEMORY, UNAVAILABLE: the host's state stays that of the
 * last frame. */
pliant_status pliant_cuda_tled_run(void *with, pliant_tled *tled, pliant_tool *tools, int num_tools,
                                   pliant_tled_frame *out);
/* Return the positions of the last frame on the GPU (num_nodes x 3), and the stream for work that needs them. */
const double *pliant_cuda_tled_positions(const pliant_cuda_tled *gpu);
/* Replace these positions until the next frame, after the host has moved nodes. Errors: UNAVAILABLE. */
pliant_status pliant_cuda_tled_set_positions(pliant_cuda_tled *gpu, const double *h_positions);
cudaStream_t pliant_cuda_tled_stream(const pliant_cuda_tled *gpu);

#endif
