#include "check.h"
#include "forces.h"
#include "rotation.cuh"

enum { ELEMENT_THREADS = 64, GATHER_THREADS = 128, NODES = GATHER_THREADS / 4 };

/* the iterate that an evaluation is about */
static __device__ __forceinline__ int target_of(const gpu_state &state) { return state.iterations == 0 ? state.now : 1 - state.now; }

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
    for (int m = 0; m < 12; m++) out.g[m] = system.d_gradients[(size_t)m * system.num_tets + t];
}

static __device__ __forceinline__ void deformation_of(const corners &c, double *f)
{
#pragma unroll
    for (int r = 0; r < 3; r++)
#pragma unroll
        for (int d = 0; d < 3; d++)
            f[3 * r + d] = (c.x[3 + r] - c.x[r]) * c.g[3 + d] + (c.x[6 + r] - c.x[r]) * c.g[6 + d] + (c.x[9 + r] - c.x[r]) * c.g[9 + d];
}

/* f_v = V P g_v with P = R (2 mu e + lambda tr(e) I), e = sym(R' F) - I */
static __device__ __forceinline__ void isotropic_force(const gpu_system &system, int t, const corners &c, const double *f, const double *r,
                                                       double *out)
{
    double lambda = system.d_lame[t], twice = 2 * system.d_lame[(size_t)system.num_tets + t], s[9], p[9];
#pragma unroll
    for (int a = 0; a < 3; a++)
#pragma unroll
        for (int b = 0; b < 3; b++) s[3 * a + b] = r[a] * f[b] + r[3 + a] * f[3 + b] + r[6 + a] * f[6 + b];
    double e00 = s[0] - 1, e11 = s[4] - 1, e22 = s[8] - 1;
    double e01 = 0.5 * (s[1] + s[3]), e02 = 0.5 * (s[2] + s[6]), e12 = 0.5 * (s[5] + s[7]);
    double pressure = lambda * (e00 + e11 + e22);
    const double e[9] = {twice * e00 + pressure, twice * e01, twice * e02, twice * e01, twice * e11 + pressure, twice * e12,
                         twice * e02, twice * e12, twice * e22 + pressure};
#pragma unroll
    for (int a = 0; a < 3; a++)
#pragma unroll
        for (int b = 0; b < 3; b++) p[3 * a + b] = r[3 * a] * e[b] + r[3 * a + 1] * e[3 + b] + r[3 * a + 2] * e[6 + b];
#pragma unroll
    for (int v = 0; v < 4; v++)
#pragma unroll
        for (int a = 0; a < 3; a++) out[3 * v + a] = p[3 * a] * c.g[3 * v] + p[3 * a + 1] * c.g[3 * v + 1] + p[3 * a + 2] * c.g[3 * v + 2];
}

/* f = R K (R' x - X), [H] 2.2 */
static __device__ __forceinline__ void homogenized_force(const gpu_system &system, int t, const corners &c, const double *r, bool grounded,
                                                         double *out)
{
    int4 nodes = reinterpret_cast<const int4 *>(system.d_tets)[t];
    const int node[4] = {nodes.x, nodes.y, nodes.z, nodes.w};
    double u[12], f[12];
#pragma unroll
    for (int v = 0; v < 4; v++) {
        /* relative to corner 0, so that a large translation costs no digits; a grounded element does feel it */
        double y[3];
#pragma unroll
        for (int d = 0; d < 3; d++) y[d] = grounded ? c.x[3 * v + d] : c.x[3 * v + d] - c.x[d];
#pragma unroll
        for (int d = 0; d < 3; d++) {
            double rest = system.d_rest[3 * (size_t)node[v] + d];
            if (!grounded) rest -= system.d_rest[3 * (size_t)node[0] + d];
            u[3 * v + d] = r[d] * y[0] + r[3 + d] * y[1] + r[6 + d] * y[2] - rest;
        }
    }
#pragma unroll
    for (int a = 0; a < 12; a++) {
        f[a] = 0;
#pragma unroll
        for (int b = 0; b < 12; b++) f[a] += system.d_stiffness[(size_t)(12 * a + b) * system.num_tets + t] * u[b];
    }
#pragma unroll
    for (int v = 0; v < 4; v++)
#pragma unroll
        for (int d = 0; d < 3; d++) out[3 * v + d] = r[3 * d] * f[3 * v] + r[3 * d + 1] * f[3 * v + 1] + r[3 * d + 2] * f[3 * v + 2];
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

/* the tools' forces on their nodes; tools after each other, since they may share nodes */
static __device__ void spread_forces(const gpu_iteration &iteration, const gpu_state &state)
{
    const double *force = state.force[target_of(state)];
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

static __global__ void __launch_bounds__(ELEMENT_THREADS) force_kernel(gpu_system system, gpu_iteration iteration)
{
    const gpu_state &state = *iteration.d_state;
    if (state.done) return;
    if (blockIdx.x == gridDim.x - 1) {
        spread_forces(iteration, state);
        return;
    }
    int t = (int)(blockIdx.x * ELEMENT_THREADS + threadIdx.x);
    if (t >= system.num_tets) return;
    corners c;
    double f[9], r[9], force[12];
    load_corners(system, iteration.d_x[target_of(state)], t, c);
    deformation_of(c, f);
    element_rotation(system, t, f, r);
    if (system.d_stiffness)
        homogenized_force(system, t, c, r, system.d_grounded && system.d_grounded[t], force);
    else
        isotropic_force(system, t, c, f, r, force);
    double2 *out = reinterpret_cast<double2 *>(iteration.d_element_force + 16 * (size_t)t);
#pragma unroll
    for (int v = 0; v < 4; v++) {
        out[2 * v] = make_double2(force[3 * v], force[3 * v + 1]);
        out[2 * v + 1] = make_double2(force[3 * v + 2], 0);
    }
}

/* four threads a node: three components, and one that rests */
static __global__ void __launch_bounds__(GATHER_THREADS) gather_kernel(gpu_system system, gpu_iteration iteration)
{
    __shared__ double sums[GATHER_SUMS][GATHER_THREADS];
    const gpu_state &state = *iteration.d_state;
    if (state.done) return;
    const int target = target_of(state), thread = (int)threadIdx.x, d = thread % 4, n = (int)blockIdx.x * NODES + thread / 4;
    double pull = 0, work = 0, elastic = 0;
    if (n < system.num_free && d < 3) {
        double sum = 0;
        const int end = system.d_corner_start[n + 1];
#pragma unroll 4
        for (int c = system.d_corner_start[n]; c < end; c++) sum += iteration.d_element_force[4 * (size_t)system.d_corner[c] + d];
        const size_t i = 3 * (size_t)n + d, x = 3 * (size_t)system.d_node_of_free[n] + d;
        double load = iteration.d_load[i] + iteration.d_extra[i], u = iteration.d_x[target][x] - system.d_rest[x];
        work = u * load;
        elastic = u * sum;
        pull = load - sum;
        iteration.d_pull[target][i] = pull;
    }
    /* R' pull: component d needs the other two, which its neighbours have */
    double turned = 0;
    for (int e = 0; e < 3; e++) {
        double other = __shfl_sync(0xffffffff, pull, (thread & 31 & ~3) + e);
        if (n < system.num_free && d < 3) turned += iteration.d_turn[9 * (size_t)n + 3 * e + d] * other;
    }
    if (n < system.num_free && d < 3) iteration.d_right[3 * (size_t)n + d] = (float)turned;
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

static __global__ void __launch_bounds__(GATHER_THREADS) rotation_kernel(gpu_system system, gpu_iteration iteration)
{
    int t = (int)(blockIdx.x * GATHER_THREADS + threadIdx.x);
    if (t >= system.num_tets) return;
    corners c;
    double f[9], r[9];
    load_corners(system, iteration.d_x[iteration.d_state->now], t, c);
    deformation_of(c, f);
    element_rotation(system, t, f, r);
    for (int m = 0; m < 9; m++) iteration.d_element_force[16 * (size_t)t + m] = r[m]; /* room that is not in use between steps */
}

static __global__ void __launch_bounds__(GATHER_THREADS) turn_kernel(gpu_system system, gpu_iteration iteration, bool identity)
{
    int n = (int)(blockIdx.x * GATHER_THREADS + threadIdx.x);
    if (n >= system.num_free) return;
    double mean[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, turn[9];
    if (!identity) {
        for (int m = 0; m < 9; m++) mean[m] = 0;
        for (int c = system.d_corner_start[n]; c < system.d_corner_start[n + 1]; c++) {
            int t = system.d_corner[c] / 4;
            double weight = system.d_stiffness ? 1 : system.d_lame[t] + system.d_lame[(size_t)system.num_tets + t];
            for (int m = 0; m < 9; m++) mean[m] += weight * iteration.d_element_force[16 * (size_t)t + m];
        }
    }
    rotation_of(mean, turn);
    for (int m = 0; m < 9; m++) iteration.d_turn[9 * (size_t)n + m] = turn[m];
}

static unsigned blocks_for(int count, int threads) { return (unsigned)((count + threads - 1) / threads); }

extern "C" int pliant_cuda_gather_blocks(const gpu_system *system) { return (int)blocks_for(system->num_free, NODES); }

extern "C" pliant_status pliant_cuda_forces(const gpu_system *system, const gpu_iteration *iteration, cudaStream_t stream)
{
    force_kernel<<<blocks_for(system->num_tets, ELEMENT_THREADS) + 1, ELEMENT_THREADS, 0, stream>>>(*system, *iteration);
    return CUDA_LAUNCHED("force_kernel");
}

extern "C" pliant_status pliant_cuda_gather(const gpu_system *system, const gpu_iteration *iteration, cudaStream_t stream)
{
    gather_kernel<<<blocks_for(system->num_free, NODES), GATHER_THREADS, 0, stream>>>(*system, *iteration);
    return CUDA_LAUNCHED("gather_kernel");
}

extern "C" pliant_status pliant_cuda_turn(const gpu_system *system, const gpu_iteration *iteration, bool identity, cudaStream_t stream)
{
    if (!identity) {
        rotation_kernel<<<blocks_for(system->num_tets, GATHER_THREADS), GATHER_THREADS, 0, stream>>>(*system, *iteration);
        CUDA_TRY(CUDA_LAUNCHED("rotation_kernel"));
    }
    turn_kernel<<<blocks_for(system->num_free, GATHER_THREADS), GATHER_THREADS, 0, stream>>>(*system, *iteration, identity);
    return CUDA_LAUNCHED("turn_kernel");
}
