/* Render images from the volume on the GPU, one thread per pixel. The operations are those in src/warp/ray.h, so the
 * images are bitwise identical to the CPU's. */
#ifndef PLIANT_CUDA_RENDER_H
#define PLIANT_CUDA_RENDER_H

#include "warp/ray.h"

#include <cuda_runtime_api.h>

/* Buffers that are kept between images. */
typedef struct gpu_pictures {
    float *d_bricks;
    size_t brick_bytes;
    void *d_pixels, *h_pixels; /* consecutive arrays; h_pixels is page-locked */
    size_t device_bytes, host_bytes;
} gpu_pictures;

/* Render an image.
 * scene: with device voxels and labels
 * out: host memory, complete when this function returns
 * Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_render(gpu_pictures *pictures, const render_scene *scene, const render_output *out,
                                 cudaStream_t stream);
void pliant_cuda_pictures_free(gpu_pictures *pictures);

#endif
