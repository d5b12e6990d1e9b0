/* Kernels of contact in the quasi-static solve. */
#ifndef PLIANT_CUDA_TOUCH_KERNELS_H
#define PLIANT_CUDA_TOUCH_KERNELS_H

#include "touch.h"

#ifdef __cplusplus
extern "C" {
#endif

/* In a step that has begun: weights in the nodes' axes, and A. */
pliant_status pliant_cuda_touch_begin(const gpu_touch_view *view, const gpu_iteration *iteration, cudaStream_t stream);
/* Before an evaluation: forces of the last one, if it was taken; their load. */
pliant_status pliant_cuda_touch_load(const gpu_touch_view *view, const gpu_iteration *iteration, cudaStream_t stream);
/* How the free step moves the points and what springs hold; of a step that is done where it has led the points. */
pliant_status pliant_cuda_touch_measure(const gpu_touch_view *view, const gpu_iteration *iteration, cudaStream_t stream);
/* The step and the residual with dl. */
pliant_status pliant_cuda_touch_push(const gpu_touch_view *view, const gpu_iteration *iteration, cudaStream_t stream);

#ifdef __cplusplus
}
#endif
#endif
