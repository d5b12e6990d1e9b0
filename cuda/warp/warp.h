/* A warp's object on the GPU: the scan, the mesh and the deformed volume, from update to update. */
#ifndef PLIANT_CUDA_WARP_H
#define PLIANT_CUDA_WARP_H

#include "warp/device.h"

#include <cuda_runtime_api.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_cuda_warp pliant_cuda_warp;

/* Errors: MEMORY (with figures), UNAVAILABLE. */
pliant_status pliant_cuda_warp_create(const pliant_warp_parts *parts, int device, pliant_cuda_warp **out);
void pliant_cuda_warp_free(pliant_cuda_warp *gpu); /* Nullable */
/* An update on a stream, from positions that are on the GPU (num_nodes x 3). */
pliant_status pliant_cuda_warp_enqueue(pliant_cuda_warp *gpu, const double *d_positions, cudaStream_t stream);
/* Its end: the stream was synchronized. Changed bricks and seconds go to the parts. Where lists of tetrahedra were too short,
 * makes longer ones and does the update again. */
pliant_status pliant_cuda_warp_finish(pliant_cuda_warp *gpu, const double *d_positions, cudaStream_t stream);
/* All of it, from positions of the host. */
pliant_status pliant_cuda_warp_update(pliant_cuda_warp *gpu, const double *positions);
pliant_status pliant_cuda_warp_fetch(pliant_cuda_warp *gpu);
/* The first crossing of a ray at this sample or after it, in the volume as it is on the GPU. */
pliant_status pliant_cuda_warp_cross(pliant_cuda_warp *gpu, const march_ray *ray, int64_t first, march_crossing *out);

#ifdef __cplusplus
}
#endif
#endif
