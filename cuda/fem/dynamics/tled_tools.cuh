/* External actions on the tissue in a sub-step, as in src/fem/dynamics/tled_tools.c: walls, node by node; tools and
 * contacts, by one block after all nodes were moved. */
#ifndef PLIANT_CUDA_TLED_TOOLS_CUH
#define PLIANT_CUDA_TLED_TOOLS_CUH

#include "cuda/fem/dynamics/tled_contact.cuh"

/* Sum over a block in a tree. All threads get the same result. scratch: (GPU_THREADS / 32). */
static __device__ double block_sum(double value, double *scratch)
{
    const int warp = (int)threadIdx.x / 32, lane = (int)threadIdx.x % 32;
    for (int step = 16; step > 0; step /= 2) value += __shfl_xor_sync(0xffffffffu, value, step);
    __syncthreads();
    if (lane == 0) scratch[warp] = value;
    __syncthreads();
    value = 0;
    for (int w = 0; w < GPU_THREADS / 32; w++) value += scratch[w];
    return value;
}

/* Return whether this is the last block of the kernel to arrive. It then reads the results of the other blocks,
 * bypassing its own cache. */
static __device__ bool is_last_block(gpu_outcome *outcome)
{
    __shared__ bool last;
    __threadfence();
    __syncthreads();
    if (threadIdx.x == 0) {
        last = atomicAdd(&outcome->arrived, 1u) == gridDim.x - 1;
        if (last) outcome->arrived = 0;
    }
    __syncthreads();
    if (last) __threadfence();
    return last;
}

/* Do the same as pliant_tled_collide for one node in registers. */
static __device__ __forceinline__ void collide(const gpu_tled &tled, const double rest[3], double factor, double u[3],
                                               double d[3], double acceleration[3])
{
    pliant_substep_collide(tled.walls, tled.num_walls, tled.friction, tled.restitution, rest, factor, u, d,
                           acceleration);
}

/* Finish a free node after all forces: apply walls and compute its part of the residual. Return whether it moved faster
 * than sound. */
static __device__ __forceinline__ bool settle(const gpu_tled &tled, int32_t n, const gpu_node &node, double factor,
                                              double u[3], double d[3], double acceleration[3], double *residual)
{
    if (tled.num_walls > 0) collide(tled, tled.d_rest + 3 * (size_t)n, factor, u, d, acceleration);
    const double square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    if (tled.still && square > node.limit) pliant_substep_shorten(node.limit, square, u, d);
    *residual =
        (acceleration[0] * acceleration[0] + acceleration[1] * acceleration[1] + acceleration[2] * acceleration[2]) /
        node.inverse_mass;
    return tled.still ? square != square : !(square <= node.limit);
}

/* ---- Tools, by all threads of one block. */

typedef struct gpu_tool_work {
    double tile[6][GPU_THREADS], point[6]; /* held point at present, and before this sub-step */
    double matrix[PLIANT_MAX_TOOLS][PLIANT_MAX_TOOLS], force[PLIANT_MAX_TOOLS][3];
    int32_t pulls[PLIANT_MAX_TOOLS]; /* tools that pull at a point */
    double scratch[GPU_THREADS / 32];
    gpu_frame frame;           /* a copy, loaded at once instead of one value after the other */
} gpu_tool_work;

/* Compute the held point in `point`, in the order of the nodes, as on the CPU. */
static __device__ void held_point(const gpu_tled &tled, const gpu_hold &hold, const double *d_u, const double *d_d,
                                  gpu_tool_work *work)
{
    double sum = 0;
    for (int32_t first = 0; first < hold.count; first += GPU_THREADS) {
        const int32_t h = first + (int32_t)threadIdx.x, end = min(hold.count - first, (int32_t)GPU_THREADS);
        if (h < hold.count) {
            const size_t node = (size_t)tled.d_tool_node[hold.first + h];
            const double weight = tled.d_tool_weight[hold.first + h];
            for (int k = 0; k < 3; k++) {
                const double at = tled.d_rest[3 * node + k] + __ldcg(d_u + 4 * node + k);
                work->tile[k][threadIdx.x] = weight * at;
                work->tile[3 + k][threadIdx.x] = weight * (at - __ldcg(d_d + 3 * node + k));
            }
        }
        __syncthreads();
        if (threadIdx.x < 6)
            for (int32_t m = 0; m < end; m++) sum += work->tile[threadIdx.x][m];
        __syncthreads();
    }
    if (threadIdx.x < 6) work->point[threadIdx.x] = sum;
    __syncthreads();
}

static __device__ void push(const gpu_tled &tled, const gpu_hold &hold, const double force[3], double factor,
                            double *d_u, double *d_d)
{
    for (int32_t h = (int32_t)threadIdx.x; h < hold.count; h += GPU_THREADS) {
        const size_t node = (size_t)tled.d_tool_node[hold.first + h];
        const double answer = tled.d_nodes[node].inverse_mass * tled.d_tool_weight[hold.first + h];
        for (int k = 0; k < 3; k++) {
            const double by = factor * answer * force[k];
            double *d_by = d_d + 3 * node + k, *d_at = d_u + 4 * node + k,
                   *d_acceleration = tled.d_acceleration + 3 * node + k;
            *d_at = __ldcg(d_at) + by;
            *d_by = __ldcg(d_by) + by;
            *d_acceleration = __ldcg(d_acceleration) + answer * force[k];
        }
    }
    __syncthreads();
}

/* Compute row i of the tools' equations from its held point, with one thread. */
static __device__ void set_row(const gpu_tled &tled, const gpu_hold &hold, double factor, int32_t parts, int i,
                               gpu_tool_work *work)
{
    const gpu_frame *frame = &work->frame;
    const int32_t tool = work->pulls[i];
    gpu_outcome *outcome = tled.d_outcome;
    double *target = outcome->target[tool], *previous_point = outcome->previous_point[tool],
           *previous_target = outcome->previous_target[tool];
    /* Tools with mass run on the CPU: pliant_cuda_tled_run. */
    const double old[3] = {target[0], target[1], target[2]}, none[3] = {0, 0, 0};
    pliant_substep_approach(target, hold.goal, parts + hold.substeps_after_part, frame->reach);
    const bool spring = hold.drive == PLIANT_DRIVE_SPRING;
    double stiffness = spring ? hold.stiffness : 0,
           damper = spring && !tled.still ? hold.damping / frame->time_step : 0;
    double gap[3], older[3], pushed[3] = {0, 0, 0};
    for (int k = 0; k < 3; k++) {
        gap[k] = old[k] - work->point[3 + k];
        older[k] = previous_target[k] - previous_point[k];
        previous_point[k] = work->point[3 + k];
        previous_target[k] = old[k];
    }
    for (int j = 0; j <= i; j++) work->matrix[i][j] = factor * frame->answer[tool][work->pulls[j]];
    if (spring && !tled.still)
        pliant_substep_center(work->matrix[i][i], frame->time_step / outcome->previous_time_step, gap, older,
                              &stiffness, &damper, pushed);
    work->matrix[i][i] += pliant_substep_gap(stiffness, damper, 0, target, old, work->point, work->point + 3, none,
                                             pushed, work->force[i]);
}

/* Sum a tool's force over a frame, with one thread. In dynamic relaxation the last force counts. */
static __device__ void add_force(const gpu_tled &tled, int32_t tool, const gpu_hold &hold, const double force[3],
                                 double *load)
{
    double *sum = tled.d_outcome->force[tool];
    for (int k = 0; k < 3; k++) sum[k] = (tled.still ? 0 : sum[k]) + force[k];
    *load += hold.load_share * (force[0] * force[0] + force[1] * force[1] + force[2] * force[2]);
}

/* Do the same as pliant_tled_pull, and add the load to the outcome. */
static __device__ void pull(const gpu_tled &tled, double factor, int32_t parts, double *d_u, double *d_d,
                            gpu_tool_work *work)
{
    const gpu_frame *frame = &work->frame;
    int count = 0;
    double load = 0;
    for (int32_t t = 0; t < frame->num_tools; t++) {
        const gpu_hold &hold = frame->tools[t];
        if (!hold.active) continue;
        if (hold.drive == PLIANT_DRIVE_FORCE) {
            push(tled, hold, hold.driving_force, factor, d_u, d_d);
            if (threadIdx.x == 0) add_force(tled, t, hold, hold.driving_force, &load);
        } else {
            if (threadIdx.x == 0) work->pulls[count] = t;
            count++;
        }
    }
    __syncthreads();
    for (int i = 0; i < count; i++) {
        held_point(tled, frame->tools[work->pulls[i]], d_u, d_d, work);
        if (threadIdx.x == 0) set_row(tled, frame->tools[work->pulls[i]], factor, parts, i, work);
        __syncthreads();
    }
    if (threadIdx.x == 0) {
        tled.d_outcome->previous_time_step = frame->time_step;
        pliant_substep_forces(count, work->matrix, work->force);
    }
    __syncthreads();
    for (int i = 0; i < count; i++) {
        const int32_t t = work->pulls[i];
        push(tled, frame->tools[t], work->force[i], factor, d_u, d_d);
        if (threadIdx.x == 0) add_force(tled, t, frame->tools[t], work->force[i], &load);
    }
    if (threadIdx.x == 0) tled.d_outcome->tool_load = load;
}

/* Move held nodes after all others: by tools, by contacts, and then by walls and limits like any node. residual: out:
 * their part of the residual. Return, per thread, whether one of its nodes moved faster than sound.
 * @param made  Sub-steps of this part of the frame before this one. */
static __device__ __forceinline__ bool pull_and_settle(const gpu_tled &tled, double factor, int32_t parts, int32_t made,
                                                       double *d_u, double *d_d, gpu_tool_work *work,
                                                       const gpu_contact_buffers &capacity, double *residual)
{
    double sum = 0;
    bool first_unstable_step = false;
    const double *from = reinterpret_cast<const double *>(tled.d_frame);
    for (size_t m = threadIdx.x; m < sizeof(gpu_frame) / sizeof *from; m += GPU_THREADS)
        reinterpret_cast<double *>(&work->frame)[m] = from[m];
    __syncthreads();
    pull(tled, factor, parts, d_u, d_d, work);
    __syncthreads();
    if (work->frame.num_points > 0) {
        const double load =
            block_sum(correct_contacts(tled, work->frame, factor, made, d_u, d_d, capacity), work->scratch);
        if (threadIdx.x == 0) tled.d_outcome->tool_load += load;
    }
    for (int32_t h = (int32_t)threadIdx.x; h < work->frame.num_held; h += GPU_THREADS) {
        const int32_t n = tled.d_held_node[h];
        const gpu_node node = tled.d_nodes[n];
        if (node.inverse_mass == 0) continue;
        double u[3], d[3], acceleration[3], mine;
        for (int k = 0; k < 3; k++) {
            u[k] = __ldcg(d_u + 4 * (size_t)n + k);
            d[k] = __ldcg(d_d + 3 * (size_t)n + k);
            acceleration[k] = __ldcg(tled.d_acceleration + 3 * (size_t)n + k);
        }
        first_unstable_step |= settle(tled, n, node, factor, u, d, acceleration, &mine);
        sum += mine;
        for (int k = 0; k < 3; k++) {
            d_u[4 * (size_t)n + k] = u[k];
            d_d[3 * (size_t)n + k] = d[k];
        }
    }
    *residual = block_sum(sum, work->scratch);
    return first_unstable_step;
}

#endif
