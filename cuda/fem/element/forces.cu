#include "cuda/base/check.h"
#include "cuda/base/launch.h"
#include "cuda/fem/element/forces.h"
#include "cuda/fem/element/rotation.cuh"
#include "cuda/fem/element/volume.cuh"
#include "fem/element/neo_hookean.h"

enum { ELEMENT_THREADS = 64, GATHER_THREADS = 128, NODES = GATHER_THREADS / 4 };

struct corners { double x[12], g[12]; };

static __device__ __forceinline__ void load_corners(const gpu_system &system, const double *x, int t, corners &out)
{
    int4 nodes = reinterpret_cast<const int4 *>(system.d_tets)[t];
    const int node[4] = {nodes.x, nodes.y, nodes.z, nodes.w};
#pragma unroll
    for (int v = 0; v < 4; v++)
#pragma unroll
        for (int d = 0; d < 3; d++) out.x[3 * v + d] = x[3 * (size_t)node[v] + d];
#pragma unroll
    for (int m = 0; m < 12; m++) out.g[m] = system.d_gradients[(size_t)m * system.tet_stride + t];
}

static __device__ __forceinline__ void homogenized_force(const gpu_system &system, int t, const corners &c,
                                                         const double *r, double *out)
{
    int4 nodes = reinterpret_cast<const int4 *>(system.d_tets)[t];
    const int node[4] = {nodes.x, nodes.y, nodes.z, nodes.w};
    double rest[12];
#pragma unroll
    for (int v = 0; v < 4; v++)
#pragma unroll
        for (int d = 0; d < 3; d++) rest[3 * v + d] = system.d_rest[3 * (size_t)node[v] + d];
    pliant_homogenized_force(system.d_stiffness + t, (size_t)system.tet_stride, c.x, rest, r,
                             system.d_grounded && system.d_grounded[t], out);
}

static __device__ __forceinline__ void element_rotation(const gpu_system &system, int t, const double *f, double *r)
{
    if (system.d_grounded && system.d_grounded[t]) {
#pragma unroll
        for (int m = 0; m < 9; m++) r[m] = m % 4 == 0;
    } else {
        rotation_of(f, r);
    }
}

/* Add the tools' forces on their nodes, one tool after the other, since they may share nodes. */
static __device__ void spread_forces(const gpu_iteration &iteration, const gpu_state &state)
{
    const double *force = state.force[gpu_target(&state)];
    for (int t = 0; t < GPU_TOOLS; t++) {
        const gpu_tool &tool = state.step.tools[t];
        if (!tool.active) continue;
        for (int h = (int)threadIdx.x; h < tool.count; h += (int)blockDim.x)
            for (int c = 0; c < 3; c++) iteration.d_extra[3 * (size_t)tool.d_unknown[h] + c] = 0;
    }
    __syncthreads();
    for (int t = 0; t < GPU_TOOLS; t++) {
        const gpu_tool &tool = state.step.tools[t];
        if (!tool.active) continue;
        const double *f = tool.spring ? force + 3 * t : tool.force;
        for (int h = (int)threadIdx.x; h < tool.count; h += (int)blockDim.x) {
            const double *block = tool.d_block + 9 * (size_t)h;
            double *at = iteration.d_extra + 3 * (size_t)tool.d_unknown[h];
            for (int c = 0; c < 3; c++) at[c] += block[c] * f[0] + block[3 + c] * f[1] + block[6 + c] * f[2];
        }
        __syncthreads();
    }
}

/* Used with macro-elements. */
static __global__ void __launch_bounds__(ELEMENT_THREADS) spread_kernel(gpu_iteration iteration)
{
    const gpu_state &state = *iteration.d_state;
    if (!state.done) spread_forces(iteration, state);
}

/* Store the change of volume of a tetrahedron, and add the force of its pressure. */
static __device__ void add_pressures(const gpu_pressures &pressures, pliant_elasticity law, int target, int t,
                                     const double *f, const double *r, const double *gradients, double *force)
{
    const int p = pressures.d_of_element[t];
    double derivative[9];
    if (p < 0) return;
    store_volume(pressures, law, t, f, r, derivative);
    const double pressure = pressures.d_pressure[target][p], volume = pressures.d_element_volume[t];
#pragma unroll
    for (int v = 0; v < 4; v++) add_pressure(pressure, volume, derivative, gradients + 3 * v, force + 3 * v);
}

/* PRESSED: there are pressures. */
template <bool PRESSED>
static __global__ void __launch_bounds__(ELEMENT_THREADS) force_kernel(gpu_system system, gpu_iteration iteration)
{
    const gpu_state &state = *iteration.d_state;
    if (state.done) return;
    if (blockIdx.x == gridDim.x - 1) {
        spread_forces(iteration, state);
        return;
    }
    int t = (int)(blockIdx.x * ELEMENT_THREADS + threadIdx.x);
    if (t >= system.num_tets || gpu_has_forces(&state)) return;
    corners c;
    double f[9], r[9], force[12];
    load_corners(system, iteration.d_x[gpu_target(&state)], t, c);
    pliant_deformation(c.x, c.g, f);
    if (system.law == PLIANT_ELASTICITY_NEO_HOOKEAN) {
        pliant_neo_hookean_force(f, system.d_grounded && system.d_grounded[t], system.d_lame[t],
                                 system.d_lame[(size_t)system.tet_stride + t], c.g, force);
    } else {
        element_rotation(system, t, f, r);
        if (system.d_stiffness) homogenized_force(system, t, c, r, force);
        else
            pliant_corotational_force(f, r, system.d_lame[t], system.d_lame[(size_t)system.tet_stride + t], c.g, force);
    }
    if (PRESSED) add_pressures(iteration.pressures, system.law, gpu_target(&state), t, f, r, c.g, force);
    double2 *out = reinterpret_cast<double2 *>(iteration.d_element_force + 16 * (size_t)t);
#pragma unroll
    for (int v = 0; v < 4; v++) {
        out[2 * v] = make_double2(force[3 * v], force[3 * v + 1]);
        out[2 * v + 1] = make_double2(force[3 * v + 2], 0);
    }
}

/* Sum forces with four threads per node: three components, and one idle thread. */
static __global__ void __launch_bounds__(GATHER_THREADS) gather_kernel(gpu_system system, gpu_iteration iteration)
{
    __shared__ double sums[GATHER_SUMS][GATHER_THREADS];
    const gpu_state &state = *iteration.d_state;
    if (state.done) return;
    const int target = gpu_target(&state), thread = (int)threadIdx.x, d = thread % 4,
              n = (int)blockIdx.x * NODES + thread / 4;
    double residual = 0, work = 0, elastic = 0;
    if (n < system.num_free && d < 3) {
        double sum = 0;
        const int end = system.d_corner_end[n];
#pragma unroll 4
        for (int c = system.d_corner_start[n]; c < end; c++)
            sum += iteration.d_element_force[4 * (size_t)system.d_corner[c] + d];
        const size_t i = 3 * (size_t)n + d, x = 3 * (size_t)system.d_node_of_free[n] + d;
        double load = iteration.d_load[i] + iteration.d_extra[i] + iteration.d_contact_force[i],
               u = iteration.d_x[target][x] - system.d_rest[x];
        work = u * load;
        elastic = u * sum;
        residual = load - sum;
    }
    /* T' residual: component d needs the two others, from the neighbouring threads. */
    double turned = 0;
    for (int e = 0; e < 3; e++) {
        double other = __shfl_sync(0xffffffff, residual, (thread & 31 & ~3) + e);
        if (n < system.num_free && d < 3) turned += iteration.d_axes[9 * (size_t)n + 3 * e + d] * other;
    }
    if (n < system.num_free && d < 3) {
        if (state.iterations == 0 && state.start_is_evaluated) { /* save the end of the previous step */
            iteration.d_past_step[3 * (size_t)n + d] = iteration.d_step[target][3 * (size_t)n + d];
            iteration.d_past_residual[3 * (size_t)n + d] = iteration.d_residual[target][3 * (size_t)n + d];
        }
        iteration.d_residual[target][3 * (size_t)n + d] = turned;
        iteration.d_right[3 * (size_t)n + d] = (float)turned;
    }
    sums[0][thread] = work;
    sums[1][thread] = elastic;
    for (int half = GATHER_THREADS / 2; half > 0; half /= 2) {
        __syncthreads();
        if (thread < half)
            for (int s = 0; s < GATHER_SUMS; s++) sums[s][thread] += sums[s][thread + half];
    }
    __syncthreads();
    if (thread < GATHER_SUMS) iteration.d_sums[gridDim.x * (unsigned)thread + blockIdx.x] = sums[thread][0];
}

/* Compute an element's contribution to the axes of its nodes (nodal_rotations.h): V mu F, with F0 = I at rest. A
 * homogenized element contributes only a rotation. */
static __global__ void __launch_bounds__(GATHER_THREADS) rotation_kernel(gpu_system system, gpu_iteration iteration)
{
    int t = (int)(blockIdx.x * GATHER_THREADS + threadIdx.x);
    if (t >= system.num_tets) return;
    corners c;
    double f[9], r[9];
    load_corners(system, iteration.d_x[iteration.d_state->now], t, c);
    pliant_deformation(c.x, c.g, f);
    const bool turns = !(system.d_grounded && system.d_grounded[t]);
    if (system.d_stiffness) element_rotation(system, t, f, r);
    for (int m = 0; m < 9; m++) {
        const double own =
            system.d_stiffness ? r[m] : system.d_lame[(size_t)system.tet_stride + t] * (turns ? f[m] : m % 4 == 0);
        iteration.d_rotations[16 * (size_t)t + m] = own;
    }
}

static __device__ void sum_elements(const gpu_system &system, const gpu_iteration &iteration, int n, double sum[9])
{
    for (int m = 0; m < 9; m++) sum[m] = 0;
    for (int c = system.d_corner_start[n]; c < system.d_corner_end[n]; c++) {
        const int corner = system.d_corner[c],
                  t = system.macros.count > 0 ? system.macros.d_cube_of_corner[corner] : corner / 4;
        for (int m = 0; m < 9; m++) sum[m] += iteration.d_rotations[16 * (size_t)t + m];
    }
}

/* As smooth() in src/fem/quasistatic/nodal_rotations.c, in two kernels. d_axes holds the sums in between. */
static __global__ void __launch_bounds__(GATHER_THREADS) sum_kernel(gpu_system system, gpu_iteration iteration)
{
    int n = (int)(blockIdx.x * GATHER_THREADS + threadIdx.x);
    if (n >= system.num_free) return;
    double sum[9];
    sum_elements(system, iteration, n, sum);
    for (int m = 0; m < 9; m++) iteration.d_axes[9 * (size_t)n + m] = sum[m];
}

static __global__ void __launch_bounds__(GATHER_THREADS) smooth_kernel(gpu_system system, gpu_iteration iteration)
{
    int t = (int)(blockIdx.x * GATHER_THREADS + threadIdx.x);
    if (t >= system.num_tets) return;
    double sum[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0};
    for (int v = 0; v < 4; v++) {
        const int f = system.d_free_of_node[system.d_tets[4 * (size_t)t + v]];
        for (int m = 0; m < 9 && f >= 0; m++) sum[m] += iteration.d_axes[9 * (size_t)f + m];
    }
    for (int m = 0; m < 9; m++) iteration.d_rotations[16 * (size_t)t + m] = sum[m];
}

static __global__ void __launch_bounds__(GATHER_THREADS)
    turn_kernel(gpu_system system, gpu_iteration iteration, bool identity)
{
    int n = (int)(blockIdx.x * GATHER_THREADS + threadIdx.x);
    if (n >= system.num_free) return;
    double sum[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, turn[9];
    if (!identity) sum_elements(system, iteration, n, sum);
    rotation_of(sum, turn);
    for (int m = 0; m < 9; m++) sum[m] = turn[m];
    const double *from = iteration.d_reference + 9 * (size_t)n;
    for (int m = 0; m < 9 && iteration.d_reference && !identity; m++) {
        const double *now = turn + m / 3 * 3, *before = from + m % 3 * 3;
        sum[m] = now[0] * before[0] + now[1] * before[1] + now[2] * before[2];
    }
    for (int m = 0; m < 9; m++) iteration.d_axes[9 * (size_t)n + m] = sum[m];
}

int pliant_cuda_gather_blocks(const gpu_system *system) { return (int)blocks_for(system->num_free, NODES); }

pliant_status pliant_cuda_forces(const gpu_system *system, const gpu_iteration *iteration, cudaStream_t stream)
{
    if (system->macros.count > 0) {
        CUDA_TRY(pliant_cuda_macro_forces(system, iteration, stream));
        spread_kernel<<<1, ELEMENT_THREADS, 0, stream>>>(*iteration);
        return CUDA_LAUNCHED("spread_kernel");
    }
    const unsigned blocks = blocks_for(system->num_tets, ELEMENT_THREADS) + 1;
    if (iteration->pressures.count > 0) force_kernel<true><<<blocks, ELEMENT_THREADS, 0, stream>>>(*system, *iteration);
    else force_kernel<false><<<blocks, ELEMENT_THREADS, 0, stream>>>(*system, *iteration);
    return CUDA_LAUNCHED("force_kernel");
}

pliant_status pliant_cuda_gather(const gpu_system *system, const gpu_iteration *iteration, cudaStream_t stream)
{
    gather_kernel<<<blocks_for(system->num_free, NODES), GATHER_THREADS, 0, stream>>>(*system, *iteration);
    return CUDA_LAUNCHED("gather_kernel");
}

static pliant_status smooth(const gpu_system *system, const gpu_iteration *iteration, cudaStream_t stream)
{
    sum_kernel<<<blocks_for(system->num_free, GATHER_THREADS), GATHER_THREADS, 0, stream>>>(*system, *iteration);
    CUDA_TRY(CUDA_LAUNCHED("sum_kernel"));
    smooth_kernel<<<blocks_for(system->num_tets, GATHER_THREADS), GATHER_THREADS, 0, stream>>>(*system, *iteration);
    return CUDA_LAUNCHED("smooth_kernel");
}

pliant_status pliant_cuda_rotate(const gpu_system *system, const gpu_iteration *iteration, bool identity,
                                 cudaStream_t stream)
{
    if (!identity && system->macros.count > 0) {
        CUDA_TRY(pliant_cuda_macro_rotations(system, iteration, stream));
    } else if (!identity) {
        rotation_kernel<<<blocks_for(system->num_tets, GATHER_THREADS), GATHER_THREADS, 0, stream>>>(*system,
                                                                                                     *iteration);
        CUDA_TRY(CUDA_LAUNCHED("rotation_kernel"));
        if (system->d_free_of_node) CUDA_TRY(smooth(system, iteration, stream));
    }
    turn_kernel<<<blocks_for(system->num_free, GATHER_THREADS), GATHER_THREADS, 0, stream>>>(*system, *iteration,
                                                                                             identity);
    return CUDA_LAUNCHED("turn_kernel");
}
