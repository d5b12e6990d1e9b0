/* State of a warp on the GPU, kept between updates: the scan, the mesh and the deformed volume. */
#ifndef PLIANT_CUDA_WARP_H
#define PLIANT_CUDA_WARP_H

#include "warp/device.h"

#include <cuda_runtime_api.h>

typedef struct pliant_cuda_warp pliant_cuda_warp;

/* Enqueue an update on a stream from device positions (num_nodes x 3). */
pliant_status pliant_cuda_warp_enqueue(pliant_cuda_warp *gpu, const double *d_positions, cudaStream_t stream);
/* Finish an update after the stream was synchronized. Stores the changed bricks and times in the parts. If lists of
 * tetrahedra were too short, they are enlarged and the update is repeated. */
pliant_status pliant_cuda_warp_finish(pliant_cuda_warp *gpu, const double *d_positions, cudaStream_t stream);

#endif
