/* Pictures where the GPU has drawn the volume: a thread a pixel, the operations of src/warp/ray.h, and so the CPU's bits. */
#ifndef PLIANT_CUDA_RENDER_H
#define PLIANT_CUDA_RENDER_H

#include "warp/ray.h"

#include <cuda_runtime_api.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Room for pictures, kept for the next ones. */
typedef struct gpu_pictures {
    float *d_bricks;
    size_t brick_bytes;
    void *d_pixels, *h_pixels; /* one array behind the other; page-locked */
    size_t device_bytes, host_bytes;
} gpu_pictures;

/* scene: with voxels and labels of the device. out: of the host; it is there when this returns. Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_see(gpu_pictures *pictures, const render_scene *scene, const render_output *out, cudaStream_t stream);
void pliant_cuda_pictures_free(gpu_pictures *pictures);

#ifdef __cplusplus
}
#endif
#endif
