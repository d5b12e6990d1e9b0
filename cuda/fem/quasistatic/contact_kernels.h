/* Kernels of contact in the quasi-static solve. */
#ifndef PLIANT_CUDA_CONTACT_KERNELS_H
#define PLIANT_CUDA_CONTACT_KERNELS_H

#include "cuda/fem/quasistatic/contact.h"

/* Maximum number of points and springs for which one block computes the forces. It has the shared memory for them. */
enum { CONTACT_BLOCK_POINTS = 256 };

/* At the start of a step, compute the weights in the nodes' axes, and A. */
pliant_status pliant_cuda_contact_begin(const gpu_contact_view *view, const gpu_iteration *iteration,
                                        cudaStream_t stream);
/* d_view: the view in device memory. Recorded graphs use it while the points change. */
/* Before an evaluation, accept the forces of the last one if its state was accepted, and compute their load. */
pliant_status pliant_cuda_contact_load(const gpu_contact_view *d_view, const gpu_iteration *iteration,
                                       cudaStream_t stream);
/* Compute the motion of points and held nodes by the free step. After a step, compute the final motion of the
 * points. count: at least the number of points */
pliant_status pliant_cuda_contact_measure(const gpu_contact_view *d_view, int32_t count, const gpu_iteration *iteration,
                                          cudaStream_t stream);
/* Compute the contact forces and their pull with one block, in `bytes` of shared memory. */
pliant_status pliant_cuda_contact_cones(const gpu_contact_view *d_view, const gpu_iteration *iteration, int32_t bytes,
                                        cudaStream_t stream);
/* Compute them with all blocks that run at the same time, which share the large systems of equations. */
pliant_status pliant_cuda_contact_cones_with_all_blocks(const gpu_contact_view *view, const gpu_contact_view *d_view,
                                             const gpu_iteration *iteration, const gpu_cone_limits *limits,
                                             cudaStream_t stream);
pliant_status pliant_cuda_contact_cone_limits(gpu_cone_limits *out);
/* Add dl to the residual (pull), and the resulting change to the step (push). */
pliant_status pliant_cuda_contact_pull(const gpu_contact_view *view, const gpu_iteration *iteration,
                                       cudaStream_t stream);
pliant_status pliant_cuda_contact_push(const gpu_contact_view *d_view, const gpu_iteration *iteration,
                                       cudaStream_t stream);

#endif
