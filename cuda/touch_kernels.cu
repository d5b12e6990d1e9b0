#include "touch_kernels.h"

#include "check.h"
#include "warp_sum.cuh"

enum { THREADS = 128, ONE_BLOCK = 256, PAIRS = 16, LANES_OF_STEP = 32, GROUPS = 8 };

/* ---- as a step begins */

/* rows of the frame times the block, in the axes of all */
static __device__ __forceinline__ void rows_of(const gpu_touch_view &view, int w, double rows[9])
{
    const double *frame = view.d_frame + 9 * (size_t)view.d_point[w], *block = view.d_block + 9 * (size_t)w;
    for (int r = 0; r < 3; r++)
        for (int d = 0; d < 3; d++) rows[3 * r + d] = frame[3 * r] * block[d] + frame[3 * r + 1] * block[3 + d] + frame[3 * r + 2] * block[6 + d];
}

static __global__ void __launch_bounds__(THREADS) turn_kernel(gpu_touch_view view, gpu_iteration iteration)
{
    const int w = (int)(blockIdx.x * THREADS + threadIdx.x);
    if (w >= view.num_weights) return;
    const double *turn = iteration.d_axes + 9 * (size_t)view.d_unknown[w];
    double rows[9], *out = view.d_turned + 9 * (size_t)w;
    rows_of(view, w, rows);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) out[3 * r + c] = turn[c] * rows[3 * r] + turn[3 + c] * rows[3 * r + 1] + turn[6 + c] * rows[3 * r + 2];
}

/* A thread a pair of points: their block of A and its transpose. */
static __global__ void __launch_bounds__(PAIRS * PAIRS) matrix_kernel(gpu_touch_view view)
{
    const int a = (int)(blockIdx.y * PAIRS + threadIdx.y), b = (int)(blockIdx.x * PAIRS + threadIdx.x);
    const size_t row = 3 * (size_t)(view.count + view.num_springs);
    if (a >= view.count || b > a) return;
    double out[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0};
    for (int v = view.d_start[a]; v < view.d_start[a + 1]; v++) {
        double moved[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0}; /* of the unknown of v, by unit forces at b */
        const double *by = view.d_turned + 9 * (size_t)v;
        for (int w = view.d_start[b]; w < view.d_start[b + 1]; w++) {
            const double *block = view.d_turned + 9 * (size_t)w;
            const float *column = view.d_column + view.stride * (size_t)view.d_first[view.d_place[w]] + 3 * (size_t)view.d_unknown[v];
            for (int k = 0; k < 3; k++)
                for (int r = 0; r < 3; r++) {
                    const double answer = column[view.stride * k + r];
                    for (int c = 0; c < 3; c++) moved[3 * r + c] += answer * block[3 * c + k];
                }
        }
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) out[3 * r + c] += by[3 * r] * moved[c] + by[3 * r + 1] * moved[3 + c] + by[3 * r + 2] * moved[6 + c];
    }
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            view.d_matrix[(3 * (size_t)b + c) * row + 3 * (size_t)a + r] = out[3 * r + c];
            if (a != b) view.d_matrix[(3 * (size_t)a + r) * row + 3 * (size_t)b + c] = out[3 * r + c];
        }
}

/* A thread a number of the springs' columns: W Z of points and of what springs hold, and c. */
static __global__ void __launch_bounds__(ONE_BLOCK) spring_kernel(gpu_touch_view view, gpu_iteration iteration)
{
    const gpu_tool *tools = iteration.d_state->step.tools;
    const int points = 3 * view.count, rows = points + 3 * view.num_springs, columns = 3 * view.num_springs;
    const size_t n = 3 * (size_t)iteration.num_free;
    for (int m = (int)threadIdx.x; m < rows * columns; m += ONE_BLOCK) {
        const int i = m / columns, j = m % columns, axis = i % 3;
        const double *z = tools[view.spring[j / 3]].d_response + n * (size_t)(j % 3);
        double sum = i == points + j ? tools[view.spring[j / 3]].compliance : 0;
        if (i < points) {
            for (int w = view.d_start[i / 3]; w < view.d_start[i / 3 + 1]; w++) {
                double own[9];
                rows_of(view, w, own);
                for (int d = 0; d < 3; d++) sum += own[3 * axis + d] * z[3 * (size_t)view.d_unknown[w] + d];
            }
            view.d_matrix[(size_t)(points + j) * rows + i] = sum;
        } else {
            const gpu_tool &tool = tools[view.spring[(i - points) / 3]];
            for (int h = 0; h < tool.count; h++)
                for (int d = 0; d < 3; d++) sum += tool.d_block[9 * h + 3 * axis + d] * z[3 * (size_t)tool.d_unknown[h] + d];
        }
        view.d_matrix[(size_t)i * rows + points + j] = sum;
    }
}

/* ---- evaluations */

static __global__ void __launch_bounds__(ONE_BLOCK) load_kernel(gpu_touch_view view, gpu_iteration iteration)
{
    const gpu_state &state = *iteration.d_state;
    if (state.done) return;
    for (int i = (int)threadIdx.x; state.took && i < 3 * view.count; i += ONE_BLOCK) view.d_force[i] = view.d_found[i];
    __syncthreads();
    for (int m = (int)threadIdx.x; m < 3 * view.num_slots; m += ONE_BLOCK) {
        const int s = m / 3, k = m % 3;
        double sum = 0;
        for (int i = view.d_weight_start[s]; i < view.d_weight_start[s + 1]; i++) {
            const int w = view.d_weight[i], p = view.d_point[w];
            const double *frame = view.d_frame + 9 * (size_t)p, *f = view.d_force + 3 * (size_t)p, *block = view.d_block + 9 * (size_t)w;
            for (int d = 0; d < 3; d++) sum += block[3 * d + k] * (frame[d] * f[0] + frame[3 + d] * f[1] + frame[6 + d] * f[2]);
        }
        iteration.d_touch[3 * (size_t)view.d_touched[s] + k] = sum;
    }
}

/* by a warp: one of the points */
static __device__ void measure_point(const gpu_touch_view &view, const gpu_iteration &iteration, const gpu_state &state, int c)
{
    const int lane = (int)threadIdx.x % 32;
    const double *x = iteration.d_x[state.done ? state.now : gpu_target(&state)];
    double y[3] = {0, 0, 0}, moved[3] = {0, 0, 0};
    for (int w = view.d_start[c] + lane; w < view.d_start[c + 1]; w += 32) {
        const size_t unknown = (size_t)view.d_unknown[w];
        const double *block = view.d_block + 9 * (size_t)w, *turned = view.d_turned + 9 * (size_t)w, *at = x + 3 * (size_t)iteration.d_node_of_free[unknown];
        const float *left = iteration.d_left + 3 * unknown;
        for (int r = 0; r < 3; r++) {
            y[r] += block[3 * r] * at[0] + block[3 * r + 1] * at[1] + block[3 * r + 2] * at[2];
            moved[r] += turned[3 * r] * left[0] + turned[3 * r + 1] * left[1] + turned[3 * r + 2] * left[2];
        }
    }
    for (int r = 0; r < 3; r++) {
        y[r] = warp_sum(y[r]);
        moved[r] = warp_sum(moved[r]);
    }
    if (lane != 0) return;
    const double *frame = view.d_frame + 9 * (size_t)c, *goal = view.d_goal + 3 * (size_t)c;
    for (int r = 0; r < 3; r++) {
        double motion = y[r];
        if (!state.done) motion = moved[r] + frame[3 * r] * (y[0] - goal[0]) + frame[3 * r + 1] * (y[1] - goal[1]) + frame[3 * r + 2] * (y[2] - goal[2]);
        view.d_motion[3 * (size_t)c + r] = motion;
    }
}

/* by a warp: what a spring holds */
static __device__ void measure_spring(const gpu_touch_view &view, const gpu_iteration &iteration, const gpu_state &state, int s)
{
    const int lane = (int)threadIdx.x % 32, target = gpu_target(&state), t = view.spring[s];
    const gpu_tool &tool = state.step.tools[t];
    double moved[3] = {0, 0, 0}; /* W (x + free step) */
    for (int h = lane; h < tool.count; h += 32) {
        const size_t unknown = (size_t)tool.d_unknown[h];
        const double *block = tool.d_block + 9 * (size_t)h, *x = iteration.d_x[target] + 3 * (size_t)iteration.d_node_of_free[unknown];
        const double *turn = iteration.d_axes + 9 * unknown;
        const float *left = iteration.d_left + 3 * unknown;
        double at[3];
        for (int r = 0; r < 3; r++) at[r] = x[r] + turn[3 * r] * left[0] + turn[3 * r + 1] * left[1] + turn[3 * r + 2] * left[2];
        for (int r = 0; r < 3; r++) moved[r] += block[3 * r] * at[0] + block[3 * r + 1] * at[1] + block[3 * r + 2] * at[2];
    }
    for (int d = 0; d < 3; d++) {
        const double y = tool.origin[d] + warp_sum(moved[d]);
        if (lane == 0) view.d_motion[3 * (size_t)(view.count + s) + d] = y + tool.compliance * state.force[target][3 * t + d] - tool.target[d];
    }
}

static __global__ void __launch_bounds__(THREADS) measure_kernel(gpu_touch_view view, gpu_iteration iteration)
{
    const gpu_state &state = *iteration.d_state;
    const int at = (int)(blockIdx.x * THREADS + threadIdx.x) / 32;
    if (at < view.count) measure_point(view, iteration, state, at);
    else if (at < view.count + view.num_springs && !state.done) measure_spring(view, iteration, state, at - view.count);
}

/* W' dl in the nodes' axes, to the residual, too */
static __global__ void __launch_bounds__(ONE_BLOCK) pull_kernel(gpu_touch_view view, gpu_iteration iteration)
{
    const gpu_state &state = *iteration.d_state;
    if (state.done) return;
    double *residual = iteration.d_residual[gpu_target(&state)];
    for (int m = (int)threadIdx.x; m < 3 * view.num_slots; m += ONE_BLOCK) {
        const int s = m / 3, k = m % 3;
        double sum = 0;
        for (int i = view.d_weight_start[s]; i < view.d_weight_start[s + 1]; i++) {
            const int w = view.d_weight[i];
            const double *turned = view.d_turned + 9 * (size_t)w, *change = view.d_change + 3 * (size_t)view.d_point[w];
            sum += turned[k] * change[0] + turned[3 + k] * change[1] + turned[6 + k] * change[2];
        }
        view.d_pull[m] = sum;
        residual[3 * (size_t)view.d_touched[s] + k] += sum;
    }
}

/* Columns times that, to the free step: a group of threads a part of the columns. */
static __global__ void __launch_bounds__(LANES_OF_STEP * GROUPS) push_kernel(gpu_touch_view view, gpu_iteration iteration)
{
    __shared__ double sums[GROUPS][LANES_OF_STEP];
    if (iteration.d_state->done) return;
    const int lane = (int)threadIdx.x, group = (int)threadIdx.y, i = (int)blockIdx.x * LANES_OF_STEP + lane;
    double sum = 0;
    if (i < 3 * iteration.num_free) {
#pragma unroll 4
        for (int s = group; s < view.num_slots; s += GROUPS) {
            const float *column = view.d_column + view.stride * (size_t)view.d_first[s] + i;
            const double *pull = view.d_pull + 3 * (size_t)s;
            sum += column[0] * pull[0] + column[view.stride] * pull[1] + column[2 * view.stride] * pull[2];
        }
    }
    sums[group][lane] = sum;
    __syncthreads();
    if (group != 0 || i >= 3 * iteration.num_free) return;
    for (int g = 1; g < GROUPS; g++) sum += sums[g][lane];
    iteration.d_left[i] = (float)(iteration.d_left[i] + sum);
}

/* ---- launches */

static unsigned blocks_for(int count, int threads) { return (unsigned)((count + threads - 1) / threads); }

extern "C" pliant_status pliant_cuda_touch_begin(const gpu_touch_view *view, const gpu_iteration *iteration, cudaStream_t stream)
{
    const unsigned pairs = blocks_for(view->count, PAIRS);
    turn_kernel<<<blocks_for(view->num_weights, THREADS), THREADS, 0, stream>>>(*view, *iteration);
    CUDA_TRY(CUDA_LAUNCHED("turn_kernel"));
    matrix_kernel<<<dim3(pairs, pairs), dim3(PAIRS, PAIRS), 0, stream>>>(*view);
    CUDA_TRY(CUDA_LAUNCHED("matrix_kernel"));
    if (view->num_springs == 0) return PLIANT_OK;
    spring_kernel<<<1, ONE_BLOCK, 0, stream>>>(*view, *iteration);
    return CUDA_LAUNCHED("spring_kernel");
}

extern "C" pliant_status pliant_cuda_touch_load(const gpu_touch_view *view, const gpu_iteration *iteration, cudaStream_t stream)
{
    load_kernel<<<1, ONE_BLOCK, 0, stream>>>(*view, *iteration);
    return CUDA_LAUNCHED("load_kernel");
}

extern "C" pliant_status pliant_cuda_touch_measure(const gpu_touch_view *view, const gpu_iteration *iteration, cudaStream_t stream)
{
    measure_kernel<<<blocks_for(32 * (view->count + view->num_springs), THREADS), THREADS, 0, stream>>>(*view, *iteration);
    return CUDA_LAUNCHED("measure_kernel");
}

extern "C" pliant_status pliant_cuda_touch_push(const gpu_touch_view *view, const gpu_iteration *iteration, cudaStream_t stream)
{
    pull_kernel<<<1, ONE_BLOCK, 0, stream>>>(*view, *iteration);
    CUDA_TRY(CUDA_LAUNCHED("pull_kernel"));
    push_kernel<<<blocks_for(3 * iteration->num_free, LANES_OF_STEP), dim3(LANES_OF_STEP, GROUPS), 0, stream>>>(*view, *iteration);
    return CUDA_LAUNCHED("push_kernel");
}
