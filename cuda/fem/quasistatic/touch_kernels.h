/* Kernels of contact in the quasi-static solve. */
#ifndef PLIANT_CUDA_TOUCH_KERNELS_H
#define PLIANT_CUDA_TOUCH_KERNELS_H

#include "cuda/fem/quasistatic/touch.h"

#ifdef __cplusplus
extern "C" {
#endif

/* At the start of a step, compute the weights in the nodes' axes, and A. */
pliant_status pliant_cuda_touch_begin(const gpu_touch_view *view, const gpu_iteration *iteration, cudaStream_t stream);
/* d_view: the view in device memory. Recorded graphs use it while the points change. */
/* Before an evaluation, accept the forces of the last one if its state was accepted, and compute their load. */
pliant_status pliant_cuda_touch_load(const gpu_touch_view *d_view, const gpu_iteration *iteration, cudaStream_t stream);
/* Compute the motion of points and held nodes by the free step. After a step, compute the final motion of the
 * points. */
pliant_status pliant_cuda_touch_measure(const gpu_touch_view *view, const gpu_iteration *iteration,
                                        cudaStream_t stream);
/* Compute the contact forces and their pull with one block, in `bytes` of shared memory. */
pliant_status pliant_cuda_touch_cones(const gpu_touch_view *d_view, const gpu_iteration *iteration, int32_t bytes,
                                      cudaStream_t stream);
pliant_status pliant_cuda_touch_cones_room(int32_t *bytes);
/* Add dl to the residual (pull), and the resulting change to the step (push). */
pliant_status pliant_cuda_touch_pull(const gpu_touch_view *view, const gpu_iteration *iteration, cudaStream_t stream);
pliant_status pliant_cuda_touch_push(const gpu_touch_view *d_view, const gpu_iteration *iteration, cudaStream_t stream);

#ifdef __cplusplus
}
#endif
#endif
