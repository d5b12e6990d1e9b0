#include "check.h"
#include "rotation.cuh"
#include "upsample.h"

enum { THREADS = 128 };

static __global__ void __launch_bounds__(THREADS) copy_kernel(gpu_iteration iteration, int count, double *d_out)
{
    int n = (int)(blockIdx.x * THREADS + threadIdx.x);
    if (n < count) d_out[n] = iteration.d_x[iteration.d_state->now][n];
}

/* displacements: exactly at rest when the coarse nodes are */
static __global__ void __launch_bounds__(THREADS) linear_kernel(gpu_system system, gpu_iteration iteration, double *d_fine)
{
    int n = (int)(blockIdx.x * THREADS + threadIdx.x);
    if (n >= system.num_fine) return;
    const double *x = iteration.d_x[iteration.d_state->now];
    int4 nodes = reinterpret_cast<const int4 *>(system.d_tets)[system.d_coarse_tet[n]];
    const int node[4] = {nodes.x, nodes.y, nodes.z, nodes.w};
    double sum[3] = {0, 0, 0};
    if (!(system.d_still && system.d_still[n]))
        for (int v = 0; v < 4; v++)
            for (int d = 0; d < 3; d++) sum[d] += system.d_weights[4 * (size_t)n + v] * (x[3 * node[v] + d] - system.d_rest[3 * node[v] + d]);
    for (int d = 0; d < 3; d++) d_fine[3 * (size_t)n + d] = sum[d] + system.d_fine_rest[3 * (size_t)n + d];
}

/* frame_of */
static __device__ void frame_of(const gpu_system &system, const double *x, const int *node, int tet, double *rotation, double *centre, double *rest_centre)
{
    double f[9] = {};
    for (int d = 0; d < 3; d++) centre[d] = rest_centre[d] = 0;
    for (int v = 0; v < 4; v++)
        for (int r = 0; r < 3; r++) {
            double at = x[3 * node[v] + r];
            centre[r] += 0.25 * at;
            rest_centre[r] += 0.25 * system.d_rest[3 * node[v] + r];
            for (int c = 0; c < 3; c++) f[3 * r + c] += (at - x[3 * node[0] + r]) * system.d_gradients[(size_t)(3 * v + c) * system.num_tets + tet];
        }
    if (system.d_grounded && system.d_grounded[tet])
        for (int m = 0; m < 9; m++) rotation[m] = m % 4 == 0;
    else
        rotation_of(f, rotation);
}

/* R (N u_c + X_f - C) + c, with u_c = R' (x_c - c) - (X_c - C). [H] 4, 5, 7 */
static __device__ void shaped_position(const gpu_system &system, const double *x, int tet, const double *shape, const double *rest, double *out)
{
    int4 nodes = reinterpret_cast<const int4 *>(system.d_tets)[tet];
    const int node[4] = {nodes.x, nodes.y, nodes.z, nodes.w};
    double rotation[9], c[3], big_c[3], u[12], local[3];
    frame_of(system, x, node, tet, rotation, c, big_c);
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++) {
            u[3 * v + d] = -(system.d_rest[3 * node[v] + d] - big_c[d]);
            for (int r = 0; r < 3; r++) u[3 * v + d] += rotation[3 * r + d] * (x[3 * node[v] + r] - c[r]);
        }
    for (int d = 0; d < 3; d++) {
        local[d] = rest[d] - big_c[d];
        for (int m = 0; m < 12; m++) local[d] += shape[12 * d + m] * u[m];
    }
    for (int d = 0; d < 3; d++) out[d] = rotation[3 * d] * local[0] + rotation[3 * d + 1] * local[1] + rotation[3 * d + 2] * local[2] + c[d];
}

static __global__ void __launch_bounds__(THREADS) shaped_kernel(gpu_system system, gpu_iteration iteration, double *d_fine)
{
    int n = (int)(blockIdx.x * THREADS + threadIdx.x);
    if (n >= system.num_fine) return;
    const double *x = iteration.d_x[iteration.d_state->now], *rest = system.d_fine_rest + 3 * (size_t)n;
    double sum[3] = {0, 0, 0};
    if (!(system.d_still && system.d_still[n]))
        for (int e = system.d_entry_start[n]; e < system.d_entry_start[n + 1]; e++) {
            double at[3];
            shaped_position(system, x, system.d_entry_tet[e], system.d_entry_shape + 36 * (size_t)e, rest, at);
            for (int d = 0; d < 3; d++) sum[d] += system.d_entry_share[e] * (at[d] - rest[d]);
        }
    for (int d = 0; d < 3; d++) d_fine[3 * (size_t)n + d] = sum[d] + rest[d];
}

static pliant_status copy_present(const gpu_iteration *iteration, int count, double *d_out, cudaStream_t stream)
{
    copy_kernel<<<(unsigned)((count + THREADS - 1) / THREADS), THREADS, 0, stream>>>(*iteration, count, d_out);
    return CUDA_LAUNCHED("copy_kernel");
}

extern "C" pliant_status pliant_cuda_upsample(const gpu_system *system, const gpu_iteration *iteration, double *d_fine, double *d_solved, cudaStream_t stream)
{
    unsigned blocks = (unsigned)((system->num_fine + THREADS - 1) / THREADS);
    if (d_solved) CUDA_TRY(copy_present(iteration, 3 * system->num_nodes, d_solved, stream));
    if (!system->d_fine_rest) return copy_present(iteration, 3 * system->num_nodes, d_fine, stream);
    if (system->d_coarse_tet) linear_kernel<<<blocks, THREADS, 0, stream>>>(*system, *iteration, d_fine);
    else shaped_kernel<<<blocks, THREADS, 0, stream>>>(*system, *iteration, d_fine);
    return CUDA_LAUNCHED("upsample kernel");
}
