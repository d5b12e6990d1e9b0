#include "cuda/base/check.h"
#include "cuda/base/launch.h"
#include "fem/element/macro_element.h"
#include "fem/coarse/shape_interpolation.h"
#include "cuda/fem/element/rotation.cuh"
#include "cuda/fem/coarse/upsample.h"

enum { THREADS = 128 };

static __global__ void __launch_bounds__(THREADS) copy_kernel(gpu_iteration iteration, int count, double *d_out)
{
    int n = (int)(blockIdx.x * THREADS + threadIdx.x);
    if (n < count) d_out[n] = iteration.d_x[iteration.d_state->now][n];
}

/* Displacements are interpolated, so that a fine node is exactly at rest if its coarse nodes are. */
static __global__ void __launch_bounds__(THREADS)
    linear_kernel(gpu_system system, gpu_iteration iteration, double *d_fine)
{
    int n = (int)(blockIdx.x * THREADS + threadIdx.x);
    if (n >= system.num_fine) return;
    const double *x = iteration.d_x[iteration.d_state->now];
    double sum[3] = {0, 0, 0};
    if (!(system.d_still && system.d_still[n]))
        for (int v = 0; v < system.corners; v++) {
            const size_t at = (size_t)system.corners * n + v;
            const int node = system.d_upsample_node[at];
            for (int d = 0; d < 3; d++)
                sum[d] += system.d_weights[at] * (x[3 * node + d] - system.d_rest[3 * node + d]);
        }
    for (int d = 0; d < 3; d++) d_fine[3 * (size_t)n + d] = sum[d] + system.d_fine_rest[3 * (size_t)n + d];
}

static __device__ void shaped_position(const gpu_system &system, const double *d_x, int tet, const double *shape,
                                       const double *rest, double *out)
{
    int4 nodes = reinterpret_cast<const int4 *>(system.d_tets)[tet];
    const int node[4] = {nodes.x, nodes.y, nodes.z, nodes.w};
    double x[12], corner[12], gradients[12], f[9];
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++) {
            x[3 * v + d] = d_x[3 * node[v] + d];
            corner[3 * v + d] = system.d_rest[3 * node[v] + d];
            gradients[3 * v + d] = system.d_gradients[(size_t)(3 * v + d) * system.tet_stride + tet];
        }
    pliant_shaped_frame frame;
    if (system.d_grounded && system.d_grounded[tet]) {
        pliant_shaped_ground(&frame);
    } else {
        pliant_shaped_find_frame(x, corner, gradients, f, &frame);
        rotation_of(f, frame.rotation);
    }
    pliant_shaped_position(&frame, x, corner, shape, rest, out);
}

/* Do the same with one hexahedron, or a tetrahedron next to a cut, whose frame is known. */
static __device__ void macro_position(const gpu_system &system, const double *d_x, int element, const double *shape,
                                      const double *rest, double *out)
{
    const gpu_macros &macros = system.macros;
    const int begin = macros.d_start[element], corners = macros.d_start[element + 1] - begin;
    double q[24], w[3];
    for (int c = 0; c < corners; c++) {
        const size_t node = 3 * (size_t)macros.d_node[begin + c];
        pliant_macro_corner(macros.d_frame + element, macros.d_held[begin + c], d_x + node, system.d_rest + node,
                            q + 3 * c);
    }
    pliant_macro_shaped_by_all(corners, shape, q, w);
    for (int d = 0; d < 3; d++) out[d] = rest[d];
    pliant_macro_follow(macros.d_frame + element, macros.d_grounded[element], w, out);
}

static __global__ void __launch_bounds__(THREADS)
    shaped_kernel(gpu_system system, gpu_iteration iteration, double *d_fine)
{
    int n = (int)(blockIdx.x * THREADS + threadIdx.x);
    if (n >= system.num_fine) return;
    const double *x = iteration.d_x[iteration.d_state->now], *rest = system.d_fine_rest + 3 * (size_t)n;
    double sum[3] = {0, 0, 0};
    if (!(system.d_still && system.d_still[n]))
        for (int e = system.d_entry_start[n]; e < system.d_entry_start[n + 1]; e++) {
            double at[3];
            const double *shape = system.d_entry_shape + 9 * (size_t)system.corners * e;
            if (system.macros.count > 0) macro_position(system, x, system.d_entry_element[e], shape, rest, at);
            else shaped_position(system, x, system.d_entry_element[e], shape, rest, at);
            for (int d = 0; d < 3; d++) sum[d] += system.d_entry_weight[e] * (at[d] - rest[d]);
        }
    for (int d = 0; d < 3; d++) d_fine[3 * (size_t)n + d] = sum[d] + rest[d];
}

static pliant_status copy_present(const gpu_iteration *iteration, int count, double *d_out, cudaStream_t stream)
{
    copy_kernel<<<blocks_for(count, THREADS), THREADS, 0, stream>>>(*iteration, count, d_out);
    return CUDA_LAUNCHED("copy_kernel");
}

pliant_status pliant_cuda_upsample(const gpu_system *system, const gpu_iteration *iteration, double *d_fine,
                                   double *d_solved, cudaStream_t stream)
{
    unsigned blocks = blocks_for(system->num_fine, THREADS);
    if (d_solved) CUDA_TRY(copy_present(iteration, 3 * system->num_nodes, d_solved, stream));
    if (!system->d_fine_rest) return copy_present(iteration, 3 * system->num_nodes, d_fine, stream);
    if (system->macros.d_fine_start) return pliant_cuda_macro_positions(system, iteration, d_fine, stream);
    if (!system->d_upsample_node && system->macros.count > 0)
        CUDA_TRY(pliant_cuda_macro_frames(system, iteration, stream));
    if (system->d_upsample_node) linear_kernel<<<blocks, THREADS, 0, stream>>>(*system, *iteration, d_fine);
    else shaped_kernel<<<blocks, THREADS, 0, stream>>>(*system, *iteration, d_fine);
    return CUDA_LAUNCHED("upsample kernel");
}
