/* Kernels of contact in the quasi-static solve. */
#ifndef PLIANT_CUDA_TOUCH_KERNELS_H
#define PLIANT_CUDA_TOUCH_KERNELS_H

#include "cuda/fem/quasistatic/touch.h"

#ifdef __cplusplus
extern "C" {
#endif

/* In a step that has begun: weights in the nodes' axes, and A. */
pliant_status pliant_cuda_touch_begin(const gpu_touch_view *view, const gpu_iteration *iteration, cudaStream_t stream);
/* d_view: where the GPU has it, for what stays recorded while points come and go. */
/* Before an evaluation: forces of the last one, if it was taken; their load. */
pliant_status pliant_cuda_touch_load(const gpu_touch_view *d_view, const gpu_iteration *iteration, cudaStream_t stream);
/* How the free step moves the points and what springs hold; of a step that is done where it has led the points. */
pliant_status pliant_cuda_touch_measure(const gpu_touch_view *view, const gpu_iteration *iteration, cudaStream_t stream);
/* Between the two: the forces, and what they pull with, by one block in so much of shared memory. */
pliant_status pliant_cuda_touch_cones(const gpu_touch_view *d_view, const gpu_iteration *iteration, int32_t bytes, cudaStream_t stream);
pliant_status pliant_cuda_touch_cones_room(int32_t *bytes);
/* The residual with dl; then the step with what that pulls. */
pliant_status pliant_cuda_touch_pull(const gpu_touch_view *view, const gpu_iteration *iteration, cudaStream_t stream);
pliant_status pliant_cuda_touch_push(const gpu_touch_view *d_view, const gpu_iteration *iteration, cudaStream_t stream);

#ifdef __cplusplus
}
#endif
#endif
