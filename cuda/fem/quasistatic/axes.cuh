/* Rotations to and from the axes of one unknown node (nodal_rotations.h). */
#ifndef PLIANT_CUDA_AXES_CUH
#define PLIANT_CUDA_AXES_CUH

#include "cuda/fem/solver_state.h"

/* Compute T v (out of the node's axes) or T' v (into them), overwriting v. */
static __device__ __forceinline__ void turn_out(const gpu_iteration &iteration, size_t node, double *v)
{
    const double *turn = iteration.d_axes + 9 * node, at[3] = {v[0], v[1], v[2]};
    for (int r = 0; r < 3; r++) v[r] = turn[3 * r] * at[0] + turn[3 * r + 1] * at[1] + turn[3 * r + 2] * at[2];
}
static __device__ __forceinline__ void turn_into(const gpu_iteration &iteration, size_t node, double *v)
{
    const double *turn = iteration.d_axes + 9 * node, at[3] = {v[0], v[1], v[2]};
    for (int r = 0; r < 3; r++) v[r] = turn[r] * at[0] + turn[3 + r] * at[1] + turn[6 + r] * at[2];
}

#endif
