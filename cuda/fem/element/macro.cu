#include "cuda/base/check.h"
#include "base/fail.h"
#include "fem/element/macro_element.h"
#include "fem/element/neo_hookean.h"
#include "cuda/fem/element/macro.h"
#include "cuda/fem/element/rotation.cuh"
#include "cuda/fem/element/volume.cuh"
#include "cuda/fem/solver_state.h"
#include "cuda/fem/system.h"
#include "cuda/base/warp_sum.cuh"

#include <cstring>
#include <new>
#include <vector>

enum { THREADS = 256, WARP = 32, CUBES = THREADS / WARP, FRAMES = 64 };

/* ---- Creation. */

enum {
    START,
    NODE,
    HELD,
    GROUNDED,
    OWN,
    GRADIENT,
    RANK,
    CUBE_OF_CORNER,
    FRAME,
    ROOT_START,
    ROOT,
    FINE_START,
    FINE,
    ENTRY_START,
    ENTRY_CORNER,
    ENTRY_SHAPE,
    SHEAR,
    LAW,
    ADDITION
};

struct sending { bool grows; cudaStream_t stream; size_t *capacity; };

template <class T> static pliant_status capacity_for(const sending &to, int array, size_t count, T **d_out)
{
    void *d_block = *d_out;
    CUDA_TRY(pliant_cuda_ensure(count * sizeof(T), to.grows, "the macro-elements", &d_block, to.capacity + array));
    *d_out = static_cast<T *>(d_block);
    return PLIANT_OK;
}

template <class T> static pliant_status upload(const sending &to, int array, const T *h_from, size_t count, T **d_out)
{
    if (count == 0) return PLIANT_OK;
    CUDA_TRY(capacity_for(to, array, count, d_out));
    return CUDA_CALL(cudaMemcpyAsync(*d_out, h_from, count * sizeof(T), cudaMemcpyHostToDevice, to.stream));
}

static pliant_status upload_roots(const pliant_macros *macros, const sending &to, gpu_macros *out)
{
    std::vector<int64_t> start;
    std::vector<float> root;
    for (int32_t cube = 0; cube < macros->count; cube++) {
        const int32_t unknowns = 3 * (macros->start[cube + 1] - macros->start[cube]), rank = macros->rank[cube];
        start.push_back((int64_t)root.size());
        root.insert(root.end(), macros->root[cube], macros->root[cube] + (size_t)rank * (size_t)unknowns);
        if (unknowns > out->max_unknowns) out->max_unknowns = unknowns;
        if (rank > out->max_rank) out->max_rank = rank;
    }
    CUDA_TRY(upload(to, ROOT_START, start.data(), start.size(), &out->d_root_start));
    CUDA_TRY(upload(to, ROOT, root.data(), root.size(), &out->d_root));
    return CUDA_CALL(cudaStreamSynchronize(to.stream)); /* the host buffers are freed on return */
}

static pliant_status upload_followers(const pliant_macros *macros, const sending &to, gpu_macros *out)
{
    if (!macros->fine_start) return PLIANT_OK; /* the solved mesh is the fine mesh */
    std::vector<int32_t> start(1, 0);
    std::vector<uint16_t> corner;
    std::vector<float> shape;
    for (int32_t cube = 0; cube < macros->count; cube++) {
        const int32_t followers = macros->fine_start[cube + 1] - macros->fine_start[cube], before = start.back();
        if (followers == 0) continue;
        for (int32_t i = 1; i <= followers; i++) start.push_back(before + macros->entry_start[cube][i]);
        const size_t entries = (size_t)macros->entry_start[cube][followers];
        corner.insert(corner.end(), macros->entry_corner[cube], macros->entry_corner[cube] + entries);
        shape.insert(shape.end(), macros->entry_shape[cube], macros->entry_shape[cube] + 9 * entries);
    }
    CUDA_TRY(upload(to, FINE_START, macros->fine_start, (size_t)macros->count + 1, &out->d_fine_start));
    CUDA_TRY(upload(to, FINE, macros->fine, (size_t)macros->fine_start[macros->count], &out->d_fine));
    CUDA_TRY(upload(to, ENTRY_START, start.data(), start.size(), &out->d_entry_start));
    CUDA_TRY(upload(to, ENTRY_CORNER, corner.data(), corner.size(), &out->d_entry_corner));
    CUDA_TRY(upload(to, ENTRY_SHAPE, shape.data(), shape.size(), &out->d_entry_shape));
    return CUDA_CALL(cudaStreamSynchronize(to.stream));
}

static size_t shared_bytes(const gpu_macros *macros)
{
    return ((size_t)macros->max_unknowns + (size_t)macros->max_rank) * sizeof(double);
}

/* Return whether the cubes have few corners. One warp then handles a cube. */
static bool is_small(const gpu_macros *macros) { return macros->max_unknowns <= WARP; }

static __global__ void macro_force_kernel(gpu_system system, gpu_iteration iteration);

pliant_status pliant_cuda_macros_set(const pliant_macros *macros, bool grows, cudaStream_t stream, size_t *capacity,
                                     gpu_macros *out)
{
    const sending to = {grows, stream, capacity};
    const size_t count = (size_t)macros->count, corners = (size_t)macros->start[count];
    out->count = macros->count;
    out->corners = macros->start[count];
    out->max_unknowns = out->max_rank = 0;
    CUDA_TRY(upload(to, START, macros->start, count + 1, &out->d_start));
    CUDA_TRY(upload(to, NODE, macros->node, corners, &out->d_node));
    CUDA_TRY(upload(to, HELD, macros->held, corners, &out->d_held));
    CUDA_TRY(upload(to, GROUNDED, macros->grounded, count, &out->d_grounded));
    CUDA_TRY(upload(to, OWN, macros->own, 8 * count, &out->d_own));
    CUDA_TRY(upload(to, GRADIENT, macros->gradient, 24 * count, &out->d_gradient));
    CUDA_TRY(upload(to, RANK, macros->rank, count, &out->d_rank));
    CUDA_TRY(upload(to, SHEAR, macros->shear, macros->shear ? count : 0, &out->d_shear));
    CUDA_TRY(upload(to, LAW, macros->law, macros->law ? count : 0, &out->d_law));
    if (macros->law) CUDA_TRY(capacity_for(to, ADDITION, 9 * count, &out->d_addition));
    CUDA_TRY(upload(to, CUBE_OF_CORNER, macros->cube_of_corner, corners, &out->d_cube_of_corner));
    CUDA_TRY(capacity_for(to, FRAME, count, &out->d_frame));
    try {
        CUDA_TRY(upload_roots(macros, to, out));
        CUDA_TRY(upload_followers(macros, to, out));
    } catch (const std::bad_alloc &) {
        return pliant_fail_memory("the macro-elements");
    }
    cudaFuncAttributes kernel;
    CUDA_TRY(CUDA_CALL(cudaFuncGetAttributes(&kernel, macro_force_kernel)));
    /* A property of the kernel: another model may need more. */
    if (shared_bytes(out) <= (size_t)kernel.maxDynamicSharedSizeBytes) return PLIANT_OK;
    return CUDA_CALL(
        cudaFuncSetAttribute(macro_force_kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, (int)shared_bytes(out)));
}

void pliant_cuda_macros_free(gpu_macros *macros)
{
    void *blocks[] = {macros->d_start,          macros->d_node,        macros->d_own,          macros->d_rank,
                      macros->d_cube_of_corner, macros->d_fine_start,  macros->d_fine,         macros->d_held,
                      macros->d_grounded,       macros->d_gradient,    macros->d_frame,        macros->d_root_start,
                      macros->d_root,           macros->d_entry_start, macros->d_entry_corner, macros->d_entry_shape,
                      macros->d_shear,          macros->d_law,         macros->d_addition};
    for (void *block : blocks) pliant_cuda_release(block);
    memset(macros, 0, sizeof *macros);
}

/* ---- Frames: one thread per cube. */

/* Compute the frame of a cube. f: out: its deformation gradient. */
static __device__ void frame_of(const gpu_system &system, const double *x, int cube, double f[9],
                                pliant_macro_frame *out)
{
    const gpu_macros &macros = system.macros;
    pliant_macro_find_frame(macros.d_own + 8 * (size_t)cube, macros.d_gradient + 24 * (size_t)cube, x, system.d_rest, f,
                            out);
    if (macros.d_grounded[cube])
        for (int m = 0; m < 9; m++) out->rotation[m] = m % 4 == 0;
    else
        rotation_of(f, out->rotation);
}

/* Compute all frames. evaluates: use the evaluated iterate, and compute the additional stresses of the law; otherwise
 * use the present one. PRESSED: compute the changes of volume as well. */
template <bool PRESSED>
static __global__ void __launch_bounds__(FRAMES)
    macro_frame_kernel(gpu_system system, gpu_iteration iteration, bool evaluates)
{
    const gpu_state &state = *iteration.d_state;
    const int cube = (int)(blockIdx.x * FRAMES + threadIdx.x);
    if (cube >= system.macros.count || (evaluates && (state.done || gpu_has_forces(&state)))) return;
    const gpu_macros &macros = system.macros;
    double f[9];
    frame_of(system, iteration.d_x[evaluates ? gpu_target(&state) : state.now], cube, f, macros.d_frame + cube);
    if (PRESSED && iteration.pressures.d_of_element[cube] >= 0) {
        double derivative[9];
        store_volume(iteration.pressures, system.law, cube, f, macros.d_frame[cube].rotation, derivative);
    }
    if (!evaluates || !macros.d_law) return;
    const pliant_macro_law law = macros.d_law[cube];
    double addition[9];
    pliant_neo_hookean_addition(f, macros.d_frame[cube].rotation, law.lambda, law.mu, addition);
    for (int m = 0; m < 9; m++) macros.d_addition[9 * (size_t)cube + m] = addition[m];
}

/* ---- One block per cube. */

/* Compute q of every corner, with all threads of the block. */
static __device__ void corners_in_frame(const gpu_system &system, const double *x, int cube, double *q)
{
    const gpu_macros &macros = system.macros;
    const int begin = macros.d_start[cube], count = macros.d_start[cube + 1] - begin;
    for (int c = (int)threadIdx.x; c < count; c += THREADS) {
        const size_t node = 3 * (size_t)macros.d_node[begin + c];
        pliant_macro_corner(macros.d_frame + cube, macros.d_held[begin + c], x + node, system.d_rest + node, q + 3 * c);
    }
    __syncthreads();
}

/* Compute f = root' (root q): one warp per row, then one thread per column. The order of the sums is fixed. */
static __device__ void apply_root(const float *root, int rank, int n, double *q, double *row)
{
    const int lane = (int)threadIdx.x % WARP, warp = (int)threadIdx.x / WARP;
    for (int m = warp; m < rank; m += THREADS / WARP) {
        double sum = 0;
        for (int i = lane; i < n; i += WARP) sum += (double)root[(size_t)m * n + i] * q[i];
        for (int half = WARP / 2; half > 0; half /= 2) sum += __shfl_down_sync(0xffffffff, sum, half);
        if (lane == 0) row[m] = sum;
    }
    __syncthreads();
    for (int i = (int)threadIdx.x; i < n; i += THREADS) {
        double sum = 0;
        for (int m = 0; m < rank; m++) sum += (double)root[(size_t)m * n + i] * row[m];
        q[i] = sum;
    }
    __syncthreads();
}

static __global__ void __launch_bounds__(THREADS) macro_force_kernel(gpu_system system, gpu_iteration iteration)
{
    extern __shared__ double shared[];
    const gpu_state &state = *iteration.d_state;
    if (state.done || gpu_has_forces(&state)) return;
    const gpu_macros &macros = system.macros;
    const int cube = (int)blockIdx.x, begin = macros.d_start[cube], count = macros.d_start[cube + 1] - begin;
    double *q = shared, *row = shared + macros.max_unknowns;
    corners_in_frame(system, iteration.d_x[gpu_target(&state)], cube, q);
    apply_root(macros.d_root + macros.d_root_start[cube], macros.d_rank[cube], 3 * count, q, row);
    for (int c = (int)threadIdx.x; c < count; c += THREADS) {
        double force[3];
        pliant_macro_turn(macros.d_frame[cube].rotation, q + 3 * c, force);
        for (int d = 0; d < 3; d++) iteration.d_element_force[4 * (size_t)(begin + c) + d] = force[d];
    }
}

/* Add the force of a cube's pressure on a corner. */
static __device__ void add_pressure_of_corner(const gpu_system &system, const gpu_iteration &iteration, int cube,
                                              int corner, double *force)
{
    const gpu_pressures &pressures = iteration.pressures;
    const int p = pressures.d_of_element[cube];
    double derivative[9];
    if (p < 0) return;
    load_derivative(pressures, cube, derivative);
    add_pressure(pressures.d_pressure[gpu_target(iteration.d_state)][p], pressures.d_element_volume[cube], derivative,
                 system.macros.d_gradient + 24 * (size_t)cube + 3 * corner, force);
}

/* Compute forces of small cubes: one warp per cube, one lane per unknown, and each row is read once. PRESSED: there are
 * pressures. */
template <bool PRESSED>
static __global__ void __launch_bounds__(THREADS) small_force_kernel(gpu_system system, gpu_iteration iteration)
{
    __shared__ double shared[CUBES][WARP];
    const gpu_state &state = *iteration.d_state;
    const gpu_macros &macros = system.macros;
    const int lane = (int)threadIdx.x % WARP, cube = (int)(blockIdx.x * THREADS + threadIdx.x) / WARP;
    if (state.done || gpu_has_forces(&state) || cube >= macros.count) return;
    const int begin = macros.d_start[cube], count = macros.d_start[cube + 1] - begin, n = 3 * count,
              rank = macros.d_rank[cube];
    const float *root = macros.d_root + macros.d_root_start[cube];
    const double *x = iteration.d_x[gpu_target(&state)];
    double *q = shared[threadIdx.x / WARP];
    if (lane < count) {
        const size_t node = 3 * (size_t)macros.d_node[begin + lane];
        pliant_macro_corner(macros.d_frame + cube, macros.d_held[begin + lane], x + node, system.d_rest + node,
                            q + 3 * lane);
    }
    double pushed[3] = {0, 0, 0};
    if (PRESSED && lane < count) add_pressure_of_corner(system, iteration, cube, lane, pushed);
    __syncwarp();
    const double own = lane < n ? q[lane] : 0;
    double force = 0;
#pragma unroll 8
    for (int m = 0; m < rank; m++) {
        const double entry = lane < n ? (double)root[m * n + lane] : 0;
        force += entry * warp_sum(entry * own);
    }
    __syncwarp();
    if (lane < n) q[lane] = force;
    __syncwarp();
    if (lane >= count) return;
    double turned[3];
    pliant_macro_turn(macros.d_frame[cube].rotation, q + 3 * lane, turned);
    if (macros.d_law) /* the corners are the cube's own nodes */
        pliant_add_product(macros.d_addition + 9 * (size_t)cube, macros.d_gradient + 24 * (size_t)cube + 3 * lane,
                           turned);
    for (int d = 0; d < 3; d++)
        iteration.d_element_force[4 * (size_t)(begin + lane) + d] = PRESSED ? turned[d] + pushed[d] : turned[d];
}

static __global__ void __launch_bounds__(FRAMES) macro_rotation_kernel(gpu_system system, gpu_iteration iteration)
{
    const int cube = (int)(blockIdx.x * FRAMES + threadIdx.x);
    if (cube >= system.macros.count) return;
    const double *d_shear = system.macros.d_shear;
    pliant_macro_frame frame;
    double f[9];
    frame_of(system, iteration.d_x[iteration.d_state->now], cube, f, &frame);
    for (int m = 0; m < 9; m++)
        iteration.d_rotations[16 * (size_t)cube + m] = d_shear ? d_shear[cube] * f[m] : frame.rotation[m];
}

static __global__ void __launch_bounds__(THREADS)
    macro_position_kernel(gpu_system system, gpu_iteration iteration, double *d_fine)
{
    extern __shared__ double q[];
    const gpu_macros &macros = system.macros;
    const int cube = (int)blockIdx.x;
    corners_in_frame(system, iteration.d_x[iteration.d_state->now], cube, q);
    for (int i = macros.d_fine_start[cube] + (int)threadIdx.x; i < macros.d_fine_start[cube + 1]; i += THREADS) {
        const size_t node = 3 * (size_t)macros.d_fine[i];
        double w[3], x[3];
        for (int d = 0; d < 3; d++) x[d] = system.d_fine_rest[node + d];
        pliant_macro_shaped(macros.d_entry_start[i], macros.d_entry_start[i + 1], macros.d_entry_corner,
                            macros.d_entry_shape, q, w);
        pliant_macro_follow(macros.d_frame + cube, macros.d_grounded[cube], w, x);
        for (int d = 0; d < 3; d++) d_fine[node + d] = x[d];
    }
}

static unsigned blocks_for(int count, int threads) { return (unsigned)((count + threads - 1) / threads); }

static pliant_status find_frames(const gpu_system *system, const gpu_iteration *iteration, bool evaluates,
                                 cudaStream_t stream)
{
    const unsigned blocks = blocks_for(system->macros.count, FRAMES);
    if (evaluates && iteration->pressures.count > 0)
        macro_frame_kernel<true><<<blocks, FRAMES, 0, stream>>>(*system, *iteration, evaluates);
    else macro_frame_kernel<false><<<blocks, FRAMES, 0, stream>>>(*system, *iteration, evaluates);
    return CUDA_LAUNCHED("macro_frame_kernel");
}

pliant_status pliant_cuda_macro_frames(const gpu_system *system, const gpu_iteration *iteration, cudaStream_t stream)
{
    return find_frames(system, iteration, false, stream);
}

pliant_status pliant_cuda_macro_forces(const gpu_system *system, const gpu_iteration *iteration, cudaStream_t stream)
{
    CUDA_TRY(find_frames(system, iteration, true, stream));
    const unsigned blocks = blocks_for(system->macros.count, CUBES);
    if (iteration->pressures.count > 0) { /* of hexahedra, which are small */
        small_force_kernel<true><<<blocks, THREADS, 0, stream>>>(*system, *iteration);
        return CUDA_LAUNCHED("small_force_kernel");
    }
    if (is_small(&system->macros)) {
        small_force_kernel<false><<<blocks, THREADS, 0, stream>>>(*system, *iteration);
        return CUDA_LAUNCHED("small_force_kernel");
    }
    macro_force_kernel<<<(unsigned)system->macros.count, THREADS, shared_bytes(&system->macros), stream>>>(*system,
                                                                                                           *iteration);
    return CUDA_LAUNCHED("macro_force_kernel");
}

pliant_status pliant_cuda_macro_rotations(const gpu_system *system, const gpu_iteration *iteration, cudaStream_t stream)
{
    macro_rotation_kernel<<<blocks_for(system->macros.count, FRAMES), FRAMES, 0, stream>>>(*system, *iteration);
    return CUDA_LAUNCHED("macro_rotation_kernel");
}

pliant_status pliant_cuda_macro_positions(const gpu_system *system, const gpu_iteration *iteration, double *d_fine,
                                          cudaStream_t stream)
{
    /* Fixed nodes follow no cube and are at rest. */
    const size_t bytes = 3 * (size_t)system->num_fine * sizeof *d_fine;
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(d_fine, system->d_fine_rest, bytes, cudaMemcpyDeviceToDevice, stream)));
    const size_t shared = (size_t)system->macros.max_unknowns * sizeof(double);
    CUDA_TRY(find_frames(system, iteration, false, stream));
    macro_position_kernel<<<(unsigned)system->macros.count, THREADS, shared, stream>>>(*system, *iteration, d_fine);
    return CUDA_LAUNCHED("macro_position_kernel");
}
