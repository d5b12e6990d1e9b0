/* Kernels of a sub-step. */
#include "cuda/base/check.h"
#include "cuda/fem/dynamics/tled_forces.cuh"
#include "cuda/fem/dynamics/tled_tools.cuh"

#include <climits>

/* Return whether there is no work: the frame has no such sub-step, or dynamic relaxation has finished. Results of this
 * sub-step do not count, so that all blocks decide equally. */
static __device__ __forceinline__ bool is_idle(const gpu_tled &tled, int32_t step)
{
    const gpu_outcome *outcome = tled.d_outcome;
    return step >= tled.d_frame->substeps || (tled.still && (outcome->settled || outcome->first_unstable_step < step));
}

/* Combine two values: maximum for errors, sum for others. */
static __device__ __forceinline__ double combine(int slot, double a, double b)
{
    return slot == PLIANT_SUM_ERROR_BEFORE || slot == PLIANT_SUM_ERROR ? fmax(a, b) : a + b;
}

/* Reduce three numbers over all threads in a tree, and store them in d_sums. scratch: (3 x warps). */
static __device__ void add_up(double *d_sums, const int slot[3], const double numbers[3],
                              double (*scratch)[GPU_THREADS / 32])
{
    const int lane = (int)threadIdx.x % 32, warp = (int)threadIdx.x / 32;
    for (int s = 0; s < 3; s++) {
        double value = numbers[s];
        for (int step = 16; step > 0; step /= 2)
            value = combine(slot[s], value, __shfl_xor_sync(0xffffffffu, value, step));
        if (lane == 0) scratch[s][warp] = value;
    }
    __syncthreads();
    if (threadIdx.x >= 3) return;
    double sum = 0;
    for (int w = 0; w < GPU_THREADS / 32; w++) sum = combine(slot[threadIdx.x], sum, scratch[threadIdx.x][w]);
    d_sums[(size_t)blockIdx.x * PLIANT_NUM_SUMS + slot[threadIdx.x]] = sum;
}

/* Sum one number over all blocks, with all threads of one block. */
static __device__ double total_of(const double *d_sums, int32_t blocks, int slot, double *scratch)
{
    double sum = 0;
    for (int32_t b = (int32_t)threadIdx.x; b < blocks; b += GPU_THREADS)
        sum += __ldcg(d_sums + (size_t)b * PLIANT_NUM_SUMS + slot);
    return block_sum(sum, scratch);
}

/* Return the maximum of one number over all blocks, likewise. */
static __device__ double largest_of(const double *d_sums, int32_t blocks, int slot, double *scratch)
{
    double maximum = 0;
    for (int32_t b = (int32_t)threadIdx.x; b < blocks; b += GPU_THREADS)
        maximum = fmax(maximum, __ldcg(d_sums + (size_t)b * PLIANT_NUM_SUMS + slot));
    for (int step = 16; step > 0; step /= 2) maximum = fmax(maximum, __shfl_xor_sync(0xffffffffu, maximum, step));
    __syncthreads();
    if (threadIdx.x % 32 == 0) scratch[threadIdx.x / 32] = maximum;
    __syncthreads();
    for (int w = 0; w < GPU_THREADS / 32; w++) maximum = fmax(maximum, scratch[w]);
    return maximum;
}

/* Dynamic relaxation: compute the damping. */
static __device__ void choose_damping(const gpu_tled &tled, double *scratch)
{
    gpu_outcome *outcome = tled.d_outcome;
    const double load = total_of(tled.d_sums, tled.num_groups, PLIANT_SUM_LOAD, scratch);
    const double inertia = total_of(tled.d_sums, tled.num_groups, PLIANT_SUM_INERTIA, scratch);
    const double stiffness = total_of(tled.d_sums, tled.num_groups, PLIANT_SUM_STIFFNESS, scratch);
    if (threadIdx.x != 0) return;
    const double frequency = pliant_substep_frequency(outcome->quotient, stiffness, inertia);
    outcome->sums[PLIANT_SUM_LOAD] = load;
    outcome->factor = 1 / (1 + frequency);
    outcome->kept = (1 - frequency) / (1 + frequency);
}

/* One component of a node. Three threads move a node; a warp handles ten nodes. */
struct component {
    bool moves;                /* the node exists and is not fixed */
    int32_t n, begin, end;     /* node; its corners in d_corner */
    int k;
    gpu_node node;
    double u, d, factor, kept;
};

/* Load the node and its corners. load_component loads the rest after the element forces. Fewer live registers let a
 * multiprocessor hold more blocks, and the sum over the corners hides the latency. */
static __device__ __forceinline__ component find_component(const gpu_tled &tled, int32_t first, int32_t count)
{
    component out = {};
    const int lane = (int)threadIdx.x % 32;
    const int32_t j = (int32_t)threadIdx.x / 32 * 10 + lane / 3;
    out.n = -1;
    out.k = lane % 3;
    if (lane >= 30 || j >= count) return out;
    out.n = tled.d_order[first + j];
    out.begin = tled.d_corner_start[first + j];
    out.end = tled.d_corner_start[first + j + 1];
    return out;
}

static __device__ __forceinline__ void load_component(const gpu_tled &tled, int present, component *out)
{
    out->factor = tled.d_frame->factor;
    out->kept = tled.d_frame->kept;
    if (out->n < 0) return;
    const size_t n = (size_t)out->n;
    const double2 *from = reinterpret_cast<const double2 *>(tled.d_nodes + n);
    const double2 masses = from[0], others = from[1];
    out->node.inverse_mass = masses.x, out->node.mass = masses.y, out->node.limit = others.x, out->node.held = others.y;
    out->moves = masses.x != 0;
    out->u = tled.d_u[present][4 * n + out->k];
    out->d = tled.d_d[present][3 * n + out->k];
}

/* Keep the position of a fixed node. */
static __device__ __forceinline__ void keep_fixed(const gpu_tled &tled, const component &at, double *d_next,
                                                  double *d_d)
{
    if (at.n < 0 || at.moves) return;
    d_next[4 * (size_t)at.n + at.k] = at.u;
    if (tled.damped) d_d[3 * (size_t)at.n + at.k] = at.d;
}

/* Exchange the three components of a node between neighbouring threads. Call it from all threads of a warp. */
static __device__ __forceinline__ void gather_components(double mine, int k, double all[3])
{
    const int base = (int)threadIdx.x % 32 - k;
    for (int m = 0; m < 3; m++) all[m] = __shfl_sync(0xffffffffu, mine, base + m);
}

/* Select a component. A runtime index would move the array to slow local memory. */
static __device__ __forceinline__ double pick(const double all[3], int k)
{
    return k == 0 ? all[0] : k == 1 ? all[1] : all[2];
}

/* Cases of the sub-step kernel. A simpler case needs fewer registers, so that a multiprocessor holds more blocks of 256
 * threads: 4 blocks up to 64 registers, 3 up to 80, 2 up to 128. */
enum kernel_kind {
    FREE_TETS,                 /* tetrahedra without contact to a wall */
    TETS,
    ANY_ELEMENTS               /* also hexahedra, or stiffness-proportional damping */
};

/* Move a node by central differences from its acceleration. Call it from all threads of a warp. Return this component
 * of the acceleration by all forces. */
template <bool WALLS>
static __device__ __forceinline__ double move_component(const gpu_tled &tled, int32_t step, component at,
                                                        double acceleration, double *d_next, double *d_d)
{
    double u[3], d[3], a[3];
    at.d = at.factor * acceleration + at.kept * at.d;
    at.u += at.d;
    if (WALLS && tled.num_walls > 0) {
        gather_components(at.u, at.k, u);
        gather_components(at.d, at.k, d);
        gather_components(acceleration, at.k, a);
        if (at.moves && at.node.held == 0) {
            collide(tled, tled.d_rest + 3 * (size_t)at.n, at.factor, u, d, a);
            at.u = pick(u, at.k);
            at.d = pick(d, at.k);
            acceleration = pick(a, at.k);
        }
    }
    gather_components(at.d, at.k, d);
    if (!at.moves) return 0;
    if (at.node.held != 0) tled.d_acceleration[3 * (size_t)at.n + at.k] = acceleration;
    else if (at.k == 0 && !(d[0] * d[0] + d[1] * d[1] + d[2] * d[2] <= at.node.limit))
        atomicMin(&tled.d_outcome->first_unstable_step, step);
    d_d[3 * (size_t)at.n + at.k] = at.d;
    d_next[4 * (size_t)at.n + at.k] = at.u;
    return acceleration;
}

/* Return the error of time integration at a node before it moves, as error_at in src/fem/dynamics/tled_step.c. The
 * previous acceleration follows from the last two increments. Call it from all threads of a warp.
 * @param older  Increment before the last one. */
template <bool WALLS>
static __device__ __forceinline__ double error_of_component(const gpu_tled &tled, const component &at,
                                                            double acceleration, double older)
{
    double u[3], d[3], changes[3];
    gather_components(at.d, at.k, d);
    gather_components(at.moves ? acceleration - (at.d - at.kept * older) / at.factor : 0, at.k, changes);
    gather_components(at.u, at.k, u);
    if (!at.moves || at.node.held != 0 || at.k != 0) return 0;
    if (WALLS && pliant_substep_touches(tled.walls, tled.num_walls, tled.d_rest + 3 * (size_t)at.n, u)) return 0;
    const double change = sqrt(changes[0] * changes[0] + changes[1] * changes[1] + changes[2] * changes[2]);
    const double step = tled.d_frame->time_step;
    return pliant_substep_error(tled.d_frame->whole * step, step, change,
                                sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]));
}

/* Dynamic relaxation: store the acceleration, and compute the terms of the damping: sums of load, stiffness,
 * inertia. */
static __device__ __forceinline__ void keep_component(const gpu_tled &tled, const component &at, double acceleration,
                                                      double sums[3])
{
    if (!at.moves) return;
    const size_t place = 3 * (size_t)at.n + at.k;
    sums[1] = at.d * (tled.d_own[place] - acceleration) / at.node.inverse_mass;
    sums[2] = at.d * at.d / at.node.inverse_mass;
    tled.d_own[place] = tled.d_acceleration[place] = acceleration;
}

template <int LAW, bool VISCOUS, bool NODAL, int KIND>
__global__ void __launch_bounds__(GPU_THREADS, KIND == ANY_ELEMENTS ? 2 : (KIND == TETS ? 3 : 4) - VISCOUS)
substep_kernel(const gpu_tled tled, int32_t number)
{
    constexpr bool MORE = KIND == ANY_ELEMENTS, WALLS = KIND != FREE_TETS;
    __shared__ float force[MORE ? 24 : 12][GPU_THREADS];
    __shared__ double scratch[3][GPU_THREADS / 32];
    const int32_t step = tled.d_outcome->base + number,
                  element = tled.d_element[(size_t)blockIdx.x * GPU_THREADS + threadIdx.x];
    const int32_t first = tled.d_group[blockIdx.x], count = tled.d_group[blockIdx.x + 1] - first;
    const int from = tled.still ? 0 : number & 1;
    if ((VISCOUS || tled.still) && is_idle(tled, step)) return;
    const bool is_tet = element >= 0 && (!MORE || element >> 1 < tled.num_tets);
    gpu_tet tet;
    if (is_tet) tet = load_tet(tled.d_tets, element >> 1); /* first, since most other loads depend on it */
    component at = find_component(tled, first, count);
    if (is_tet) element_forces<LAW, VISCOUS, NODAL, MORE>(tled, from, number & 1, element, tet, force);
    else if (MORE && element >= 0) cube_forces<LAW, VISCOUS>(tled, from, number & 1, element, force);
    __syncthreads();
    load_component(tled, from, &at);
    const int32_t substeps = tled.d_frame->substeps;
    double *d_next = tled.d_u[1 - from], sum = 0;
    for (int32_t c = at.begin; c < at.end; c++) {
        const int32_t place = __ldg(tled.d_corner + c);
        sum += force[place / GPU_THREADS * 3 + at.k][place % GPU_THREADS];
    }
    if (step >= substeps) return; /* tested only here, so that earlier work does not wait for the value */
    const double weight = at.node.mass * tled.d_frame->gravity[at.k];
    double acceleration = at.node.inverse_mass * (weight - sum),
           sums[3] = {at.node.inverse_mass * weight * weight, 0, 0};
    if (tled.still) {
        const int slots[3] = {PLIANT_SUM_LOAD, PLIANT_SUM_STIFFNESS, PLIANT_SUM_INERTIA};
        keep_component(tled, at, acceleration, sums);
        add_up(tled.d_sums, slots, sums, scratch);
        if (is_last_block(tled.d_outcome)) choose_damping(tled, scratch[0]);
        return;
    }
    keep_fixed(tled, at, d_next, tled.d_d[1 - from]);
    const int32_t left = tled.d_frame->whole - tled.d_frame->substeps_done - step;
    const bool is_measured = left <= 2;
    double *d_older = tled.d_older + 3 * (size_t)at.n + at.k;
    if (is_measured) sums[2] = error_of_component<WALLS>(tled, at, acceleration, at.moves ? *d_older : 0);
    if (left <= 3 && at.moves) *d_older = at.d; /* only the last three sub-steps of a frame need it */
    acceleration = move_component<WALLS>(tled, step, at, acceleration, d_next, tled.d_d[1 - from]);
    if (!is_measured) return;
    const int slots[3] = {PLIANT_SUM_LOAD, PLIANT_SUM_RESIDUAL, left == 1 ? PLIANT_SUM_ERROR : PLIANT_SUM_ERROR_BEFORE};
    if (at.moves && at.node.held == 0) sums[1] = acceleration * acceleration / at.node.inverse_mass;
    add_up(tled.d_sums, slots, sums, scratch);
}

/* Apply tools and contacts after all nodes were moved, with one block. */
__global__ void __launch_bounds__(GPU_THREADS) pull_kernel(const gpu_tled tled, int32_t number)
{
    extern __shared__ double touch_block[];
    __shared__ gpu_tool_work work;
    const int32_t step = tled.d_outcome->base + number, left = tled.d_frame->substeps - step, to = 1 - (number & 1);
    if (left <= 0) return;
    double residual;
    const gpu_contact_buffers buffers = make_contact_buffers(tled, tled.shared_bytes > 0, touch_block);
    if (pull_and_settle(tled, tled.d_frame->factor, left, step, tled.d_u[to], tled.d_d[to], &work, buffers, &residual))
        atomicMin(&tled.d_outcome->first_unstable_step, step);
    if (threadIdx.x == 0) tled.d_outcome->sums[PLIANT_SUM_RESIDUAL] = residual;
}

static __device__ __forceinline__ void store_u(double *d_u, int32_t n, const double u[3])
{
    double2 *to = reinterpret_cast<double2 *>(d_u + 4 * (size_t)n);
    to[0] = make_double2(u[0], u[1]);
    to[1].x = u[2];
}

/* Dynamic relaxation after the forces: move all nodes, then apply the tools, then test convergence. */
__global__ void __launch_bounds__(GPU_THREADS) relax_kernel(const gpu_tled tled, int32_t number)
{
    __shared__ gpu_tool_work work;
    gpu_outcome *outcome = tled.d_outcome;
    const int32_t step = outcome->base + number, n = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x);
    if (is_idle(tled, step)) return;
    const double factor = outcome->factor, kept = outcome->kept;
    double residual = 0, held_residual = 0;
    bool first_unstable_step = false;
    if (n < tled.num_nodes && tled.d_nodes[n].inverse_mass != 0) {
        const gpu_node node = tled.d_nodes[n];
        double u[3], d[3], acceleration[3];
        for (int k = 0; k < 3; k++) {
            const size_t at = 3 * (size_t)n + k;
            acceleration[k] = tled.d_acceleration[at];
            d[k] = factor * acceleration[k] + kept * tled.d_d[0][at];
            u[k] = tled.d_u[0][4 * (size_t)n + k] + d[k];
        }
        if (node.held == 0) first_unstable_step = settle(tled, n, node, factor, u, d, acceleration, &residual);
        for (int k = 0; k < 3; k++) tled.d_d[0][3 * (size_t)n + k] = d[k];
        store_u(tled.d_u[0], n, u);
    }
    residual = block_sum(residual, work.scratch);
    if (threadIdx.x == 0) tled.d_sums[(size_t)blockIdx.x * PLIANT_NUM_SUMS + PLIANT_SUM_RESIDUAL] = residual;
    if (first_unstable_step) atomicMin(&outcome->first_unstable_step, step);
    if (!is_last_block(outcome)) return;
    const gpu_frame *frame = tled.d_frame;
    if (frame->num_held > 0) {
        const gpu_contact_buffers buffers = make_contact_buffers(tled, false, nullptr);
        if (pull_and_settle(tled, factor, 1, step, tled.d_u[0], tled.d_d[0], &work, buffers, &held_residual))
            atomicMin(&outcome->first_unstable_step, step);
    }
    const double total = total_of(tled.d_sums, (int32_t)gridDim.x, PLIANT_SUM_RESIDUAL, work.scratch) + held_residual;
    __syncthreads();
    if (threadIdx.x != 0) return;
    const double load = outcome->sums[PLIANT_SUM_LOAD] + (frame->num_held > 0 ? outcome->tool_load : 0);
    outcome->residual = pliant_substep_relative(frame->smallest_load, total, load);
    outcome->steps = step + 1;
    outcome->settled = outcome->residual <= frame->tolerance && atomicAdd(&outcome->first_unstable_step, 0) > step;
}

/* Compute average nodal pressures, as pliant_tled_pressures. */
__global__ void __launch_bounds__(GPU_THREADS) pressure_kernel(const gpu_tled tled, int32_t number)
{
    __shared__ float change[GPU_THREADS];
    const int32_t element = tled.d_element[(size_t)blockIdx.x * GPU_THREADS + threadIdx.x],
                  first = tled.d_group[blockIdx.x];
    if (element >= 0) {
        const gpu_tet tet = load_tet(tled.d_tets, element >> 1);
        float h[9], cofactor[9];
        load_gradient(tled.d_u[tled.still ? 0 : number & 1], tet, h);
        change[threadIdx.x] = tet.volume * pliant_change_of(h, cofactor);
    }
    __syncthreads();
    const int32_t j = first + (int32_t)threadIdx.x;
    if (j >= tled.d_group[blockIdx.x + 1]) return;
    const int32_t n = tled.d_order[j];
    double sum = 0;
    for (int32_t c = tled.d_corner_start[j]; c < tled.d_corner_start[j + 1]; c++)
        sum += change[__ldg(tled.d_corner + c) % GPU_THREADS];
    const float mean = (float)(0.25 * sum) * tled.d_node_volume[n];
    tled.d_pressure[n] = tled.d_node_modulus[n] * pliant_law_float_volume(tled.law, mean);
}

__global__ void advance_base_kernel(gpu_outcome *outcome, int32_t steps) { outcome->base += steps; }

/* Return the index of a number of an element's memory in the host's layout. */
static __device__ size_t host_place(int32_t element, int term, int m)
{
    return ((size_t)(element / LANES) * 6 * PLIANT_PRONY_TERMS + 6 * (size_t)term + (size_t)m) * LANES +
           (size_t)(element % LANES);
}

__global__ void finish_kernel(const gpu_tled tled)
{
    __shared__ double scratch[GPU_THREADS / 32];
    gpu_outcome *outcome = tled.d_outcome;
    const int32_t steps = tled.still ? outcome->steps : tled.d_frame->substeps,
                  threads = (int32_t)(gridDim.x * blockDim.x);
    const int from = tled.still ? 0 : steps & 1, from_memory = steps & 1;
    for (int32_t n = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x); n < tled.num_nodes; n += threads)
        for (int k = 0; k < 3; k++) {
            const double u = tled.d_u[from][4 * (size_t)n + k];
            tled.d_u[0][4 * (size_t)n + k] = u;
            if (tled.damped) tled.d_d[0][3 * (size_t)n + k] = tled.d_d[from][3 * (size_t)n + k];
            tled.d_packed_u[3 * (size_t)n + k] = u;
            tled.d_positions[3 * (size_t)n + k] = tled.d_rest[3 * (size_t)n + k] + u;
        }
    for (int32_t t = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x); tled.viscous && t < tled.num_elements;
         t += threads)
        for (int term = 0; term < tled.num_prony; term++)
            for (int m = 0; m < 6; m++) {
                const size_t place = 8 * ((size_t)term * (size_t)tled.num_elements + (size_t)t) + (size_t)m;
                const float y = tled.d_memory[from_memory][place];
                tled.d_memory[0][place] = y;
                tled.d_packed_memory[host_place(t, term, m)] = y;
            }
    if (tled.still || blockIdx.x > 0) return;
    const double load = total_of(tled.d_sums, tled.num_groups, PLIANT_SUM_LOAD, scratch);
    const double residual = total_of(tled.d_sums, tled.num_groups, PLIANT_SUM_RESIDUAL, scratch);
    const double before = largest_of(tled.d_sums, tled.num_groups, PLIANT_SUM_ERROR_BEFORE, scratch);
    const double error = largest_of(tled.d_sums, tled.num_groups, PLIANT_SUM_ERROR, scratch);
    if (threadIdx.x != 0) return;
    outcome->sums[PLIANT_SUM_ERROR_BEFORE] = before;
    outcome->sums[PLIANT_SUM_ERROR] = error;
    outcome->sums[PLIANT_SUM_LOAD] = load;
    outcome->sums[PLIANT_SUM_RESIDUAL] += residual;
}

__global__ void unpack_kernel(const gpu_tled tled)
{
    const int32_t threads = (int32_t)(gridDim.x * blockDim.x);
    for (int32_t n = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x); n < tled.num_nodes; n += threads) {
        double *d_u = tled.d_u[0] + 4 * (size_t)n;
        for (int k = 0; k < 3; k++) d_u[k] = tled.d_packed_u[3 * (size_t)n + k];
    }
    for (int32_t t = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x); tled.viscous && t < tled.num_elements;
         t += threads)
        for (int term = 0; term < tled.num_prony; term++)
            for (int m = 0; m < 6; m++)
                tled.d_memory[0][8 * ((size_t)term * (size_t)tled.num_elements + (size_t)t) + (size_t)m] =
                    tled.d_packed_memory[host_place(t, term, m)];
}

__global__ void release_kernel(gpu_node *d_nodes, int32_t num_nodes)
{
    const int32_t n = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x);
    if (n < num_nodes) d_nodes[n].held = 0;
}

__global__ void hold_kernel(gpu_node *d_nodes, const int32_t *d_held_node, int32_t num_held)
{
    const int32_t h = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x);
    if (h < num_held) d_nodes[d_held_node[h]].held = 1;
}

/* ---- Kernel launches. */

static unsigned blocks_for(int32_t count) { return (unsigned)((count + GPU_THREADS - 1) / GPU_THREADS); }

template <int LAW, bool VISCOUS, int KIND> static void launch(const gpu_tled *tled, int32_t number, cudaStream_t stream)
{
    const unsigned groups = (unsigned)tled->num_groups;
    constexpr bool NODAL = LAW != PLIANT_LAW_SAINT_VENANT_KIRCHHOFF;
    if (NODAL && (tled->nodal || KIND == ANY_ELEMENTS))
        substep_kernel<LAW, VISCOUS, NODAL, KIND><<<groups, GPU_THREADS, 0, stream>>>(*tled, number);
    else substep_kernel<LAW, VISCOUS, false, KIND><<<groups, GPU_THREADS, 0, stream>>>(*tled, number);
}

template <int LAW, bool VISCOUS> static void launch(const gpu_tled *tled, int32_t number, cudaStream_t stream)
{
    if (tled->d_cubes || tled->damped) launch<LAW, VISCOUS, ANY_ELEMENTS>(tled, number, stream);
    else if (tled->num_walls > 0) launch<LAW, VISCOUS, TETS>(tled, number, stream);
    else launch<LAW, VISCOUS, FREE_TETS>(tled, number, stream);
}

template <int LAW> static void launch(const gpu_tled *tled, int32_t number, cudaStream_t stream)
{
    if (tled->viscous) launch<LAW, true>(tled, number, stream);
    else launch<LAW, false>(tled, number, stream);
}

pliant_status pliant_cuda_tled_use_shared_memory(gpu_tled *tled, size_t bytes, size_t maximum)
{
    cudaFuncAttributes kernel;
    CUDA_TRY(CUDA_CALL(cudaFuncGetAttributes(&kernel, pull_kernel)));
    tled->shared_bytes = bytes + kernel.sharedSizeBytes <= maximum ? bytes : 0;
    /* A property of the kernel: another simulation may need more. */
    if (tled->shared_bytes <= (size_t)kernel.maxDynamicSharedSizeBytes) return PLIANT_OK;
    return CUDA_CALL(cudaFuncSetAttribute(pull_kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, (int)bytes));
}

pliant_status pliant_cuda_tled_substep(const gpu_tled *tled, int32_t number, bool pulled, cudaStream_t stream)
{
    if (tled->nodal) {
        pressure_kernel<<<(unsigned)tled->num_groups, GPU_THREADS, 0, stream>>>(*tled, number);
        CUDA_TRY(CUDA_LAUNCHED("the nodal pressures"));
    }
    switch (tled->law) {
    case PLIANT_LAW_NEO_HOOKEAN: launch<PLIANT_LAW_NEO_HOOKEAN>(tled, number, stream); break;
    case PLIANT_LAW_COMPRESSIBLE: launch<PLIANT_LAW_COMPRESSIBLE>(tled, number, stream); break;
    case PLIANT_LAW_SAINT_VENANT_KIRCHHOFF: launch<PLIANT_LAW_SAINT_VENANT_KIRCHHOFF>(tled, number, stream); break;
    }
    CUDA_TRY(CUDA_LAUNCHED("a sub-step"));
    if (!tled->still && pulled) {
        pull_kernel<<<1, GPU_THREADS, tled->shared_bytes, stream>>>(*tled, number);
        return CUDA_LAUNCHED("the tools");
    }
    if (!tled->still) return PLIANT_OK;
    relax_kernel<<<blocks_for(tled->num_nodes), GPU_THREADS, 0, stream>>>(*tled, number);
    return CUDA_LAUNCHED("dynamic relaxation");
}

pliant_status pliant_cuda_tled_advance_base(const gpu_tled *tled, int32_t steps, cudaStream_t stream)
{
    advance_base_kernel<<<1, 1, 0, stream>>>(tled->d_outcome, steps);
    return CUDA_LAUNCHED("the count of sub-steps");
}

pliant_status pliant_cuda_tled_finish(const gpu_tled *tled, cudaStream_t stream)
{
    finish_kernel<<<blocks_for(tled->viscous ? tled->num_elements : tled->num_nodes), GPU_THREADS, 0, stream>>>(*tled);
    return CUDA_LAUNCHED("the end of a frame");
}

pliant_status pliant_cuda_tled_unpack(const gpu_tled *tled, cudaStream_t stream)
{
    unpack_kernel<<<blocks_for(tled->viscous ? tled->num_elements : tled->num_nodes), GPU_THREADS, 0, stream>>>(*tled);
    return CUDA_LAUNCHED("the state of the dynamics");
}

pliant_status pliant_cuda_tled_hold(const gpu_tled *tled, int32_t num_held, cudaStream_t stream)
{
    release_kernel<<<blocks_for(tled->num_nodes), GPU_THREADS, 0, stream>>>(tled->d_nodes, tled->num_nodes);
    CUDA_TRY(CUDA_LAUNCHED("the held nodes"));
    if (num_held == 0) return PLIANT_OK;
    hold_kernel<<<blocks_for(num_held), GPU_THREADS, 0, stream>>>(tled->d_nodes, tled->d_held_node, num_held);
    return CUDA_LAUNCHED("the held nodes");
}
