/* Rotations to and from the axes of one unknown node (nodal_rotations.h), and points that tools hold. */
#ifndef PLIANT_CUDA_AXES_CUH
#define PLIANT_CUDA_AXES_CUH

#include "cuda/base/warp_sum.cuh"
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

/* Compute origin + W (x + T left), the point that a tool holds after the free step, with one warp. */
static __device__ __forceinline__ void held_point(const gpu_iteration &iteration, const gpu_tool &tool, int target,
                                                  double out[3])
{
    double moved[3] = {0, 0, 0};
    for (int h = (int)threadIdx.x % 32; h < tool.count; h += 32) {
        const size_t unknown = (size_t)tool.d_unknown[h];
        const double *block = tool.d_block + 9 * (size_t)h,
                     *x = iteration.d_x[target] + 3 * (size_t)iteration.d_node_of_free[unknown];
        const float *left = iteration.d_left + 3 * unknown;
        double at[3] = {left[0], left[1], left[2]};
        turn_out(iteration, unknown, at);
        for (int d = 0; d < 3; d++) at[d] += x[d];
        for (int r = 0; r < 3; r++)
            moved[r] += block[3 * r] * at[0] + block[3 * r + 1] * at[1] + block[3 * r + 2] * at[2];
    }
    for (int d = 0; d < 3; d++) out[d] = tool.origin[d] + warp_sum(moved[d]);
}

#endif
