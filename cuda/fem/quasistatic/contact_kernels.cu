#include "cuda/fem/quasistatic/contact_kernels.h"

#include "cuda/base/check.h"
#include "cuda/base/launch.h"
#include "contact/solve/cone_rules.h"
#include "contact/solve/coupling_rules.h"
#include "cuda/base/warp_sum.cuh"
#include "cuda/fem/quasistatic/axes.cuh"

enum { CONE_THREADS = 512, COPIES = 8, THREADS = 128, ONE_BLOCK = 256, PAIRS = 16, LANES_OF_STEP = 32, GROUPS = 8 };

/* ---- Start of a step. */

/* Compute rows of the frame times the block, in world axes. */
static __device__ __forceinline__ void rows_of(const gpu_contact_view &view, int w, double rows[9])
{
    const double *frame = view.d_frame + 9 * (size_t)view.d_point[w], *block = view.d_block + 9 * (size_t)w;
    for (int r = 0; r < 3; r++)
        for (int d = 0; d < 3; d++)
            rows[3 * r + d] =
                frame[3 * r] * block[d] + frame[3 * r + 1] * block[3 + d] + frame[3 * r + 2] * block[6 + d];
}

static __global__ void __launch_bounds__(THREADS) turn_kernel(gpu_contact_view view, gpu_iteration iteration)
{
    const int w = (int)(blockIdx.x * THREADS + threadIdx.x);
    if (w >= view.num_weights) return;
    const double *turn = iteration.d_axes + 9 * (size_t)view.d_unknown[w];
    double rows[9], *out = view.d_turned + 9 * (size_t)w;
    rows_of(view, w, rows);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            out[3 * r + c] = turn[c] * rows[3 * r] + turn[3 + c] * rows[3 * r + 1] + turn[6 + c] * rows[3 * r + 2];
}

/* Add the pieces' contribution to a block of A for two points (contact_bodies.c). */
static __device__ void answer_pieces(const gpu_contact_view &view, int a, int b, double out[9])
{
    for (int i = view.d_arm_start[a]; i < view.d_arm_start[a + 1]; i++)
        for (int j = view.d_arm_start[b]; j < view.d_arm_start[b + 1]; j++)
            if (view.d_arm[i].moving == view.d_arm[j].moving)
                pliant_arms_compliance(view.d_piece + view.d_arm[i].moving, view.d_arm + i,
                                       view.d_frame + 9 * (size_t)a, view.d_arm + j, view.d_frame + 9 * (size_t)b, out);
    for (int d = 0; a == b && d < 3; d++) out[4 * d] += view.d_own_compliance[a];
}

/* Compute A, one thread per pair of points: their block and its transpose. */
static __global__ void __launch_bounds__(PAIRS *PAIRS) matrix_kernel(gpu_contact_view view)
{
    const int a = (int)(blockIdx.y * PAIRS + threadIdx.y), b = (int)(blockIdx.x * PAIRS + threadIdx.x);
    const size_t row = 3 * (size_t)(view.count + view.num_springs);
    if (a >= view.count || b > a) return;
    double out[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0};
    for (int v = view.d_start[a]; v < view.d_start[a + 1]; v++) {
        double moved[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0}; /* displacement of the unknown of v per unit force at b */
        const double *by = view.d_turned + 9 * (size_t)v;
        for (int w = view.d_start[b]; w < view.d_start[b + 1]; w++) {
            const double *block = view.d_turned + 9 * (size_t)w;
            const float *column =
                view.d_column + view.stride * (size_t)view.d_first[view.d_place[w]] + 3 * (size_t)view.d_unknown[v];
            for (int k = 0; k < 3; k++)
                for (int r = 0; r < 3; r++) {
                    const double compliance = column[view.stride * k + r];
                    for (int c = 0; c < 3; c++) moved[3 * r + c] += compliance * block[3 * c + k];
                }
        }
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                out[3 * r + c] += by[3 * r] * moved[c] + by[3 * r + 1] * moved[3 + c] + by[3 * r + 2] * moved[6 + c];
    }
    if (view.num_moving > 0) answer_pieces(view, a, b, out);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            view.d_matrix[(3 * (size_t)b + c) * row + 3 * (size_t)a + r] = out[3 * r + c];
            if (a != b) view.d_matrix[(3 * (size_t)a + r) * row + 3 * (size_t)b + c] = out[3 * r + c];
        }
}

/* Compute the springs' columns, one thread per number: W Z of points and of held nodes, and c. */
static __global__ void __launch_bounds__(ONE_BLOCK) spring_kernel(gpu_contact_view view, gpu_iteration iteration)
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
                for (int d = 0; d < 3; d++)
                    sum += tool.d_block[9 * h + 3 * axis + d] * z[3 * (size_t)tool.d_unknown[h] + d];
        }
        view.d_matrix[(size_t)i * rows + points + j] = sum;
    }
}

/* ---- Evaluations. */

/* Compute the motion of the pieces under all contact forces, one warp per piece. */
static __device__ void move_pieces(const gpu_contact_view &view)
{
    const int lane = (int)threadIdx.x % 32;
    for (int m = (int)threadIdx.x / 32; m < view.num_moving; m += (int)blockDim.x / 32) {
        double load[6] = {0, 0, 0, 0, 0, 0};
        for (int c = lane; c < view.count; c += 32)
            for (int a = view.d_arm_start[c]; a < view.d_arm_start[c + 1]; a++)
                if (view.d_arm[a].moving == m)
                    pliant_arm_load(view.d_arm + a, view.d_frame + 9 * (size_t)c, view.d_force + 3 * (size_t)c, load);
        for (int k = 0; k < 6; k++) load[k] = warp_sum(load[k]);
        if (lane < 6) view.d_piece_moved[6 * (size_t)m + lane] = pliant_body_motion(view.d_piece + m, load, lane);
    }
}

/* Change the compliance of a coupling and of its body. */
static __device__ void set_coupling(const gpu_contact_view &view, pliant_coupling *of, double wanted)
{
    pliant_coupling_soften_body(of, wanted - of->compliance, view.d_piece + of->moving);
    of->compliance = wanted;
}

static __global__ void __launch_bounds__(ONE_BLOCK) load_kernel(const gpu_contact_view *d_view, gpu_iteration iteration)
{
    const gpu_contact_view view = *d_view;
    const gpu_state &state = *iteration.d_state;
    for (int i = (int)threadIdx.x; state.was_accepted && i < 3 * view.count; i += ONE_BLOCK) {
        view.d_force[i] = view.d_found[i];
        view.d_taken_motion[i] = view.d_found_motion[i];
    }
    for (int n = (int)threadIdx.x; n < view.num_couplings; n += ONE_BLOCK) {
        pliant_coupling *of = view.d_coupling + n;
        if (state.was_accepted) of->taken = of->found;
        if (state.done && !state.needs_host) set_coupling(view, of, of->taken);
    }
    __syncthreads();
    move_pieces(view);
    if (state.done) return;
    for (int m = (int)threadIdx.x; m < 3 * view.num_slots; m += ONE_BLOCK) {
        const int s = m / 3, k = m % 3;
        double sum = 0;
        for (int i = view.d_weight_start[s]; i < view.d_weight_start[s + 1]; i++) {
            const int w = view.d_weight[i], p = view.d_point[w];
            const double *frame = view.d_frame + 9 * (size_t)p, *f = view.d_force + 3 * (size_t)p,
                         *block = view.d_block + 9 * (size_t)w;
            for (int d = 0; d < 3; d++)
                sum += block[3 * d + k] * (frame[d] * f[0] + frame[3 + d] * f[1] + frame[6 + d] * f[2]);
        }
        iteration.d_contact_force[3 * (size_t)view.d_moved_unknowns[s] + k] = sum;
    }
}

/* Add the motion of a point's pieces to the point's motion, in its frame. */
static __device__ void move_with_pieces(const gpu_contact_view &view, int c, double motion[3])
{
    for (int a = view.d_arm_start[c]; a < view.d_arm_start[c + 1]; a++)
        pliant_arm_move(view.d_arm + a, view.d_frame + 9 * (size_t)c,
                        view.d_piece_moved + 6 * (size_t)view.d_arm[a].moving, motion);
}

enum { POINT_LANES = 8, WARP_POINTS = 32 / POINT_LANES };

/* Return the sum over the lanes of a point, to each of them. */
static __device__ __forceinline__ double point_sum(double value)
{
    const unsigned lanes = ((1u << POINT_LANES) - 1) << (threadIdx.x % 32 / POINT_LANES * POINT_LANES);
    for (int half = POINT_LANES / 2; half > 0; half /= 2) value += __shfl_xor_sync(lanes, value, half);
    return value;
}

/* Measure the motion of one point, with POINT_LANES threads. */
static __device__ void measure_point(const gpu_contact_view &view, const gpu_iteration &iteration,
                                     const gpu_state &state, int c, double *out)
{
    const int lane = (int)threadIdx.x % POINT_LANES;
    const double *x = iteration.d_x[state.done ? state.now : gpu_target(&state)];
    double y[3] = {0, 0, 0}, moved[3] = {0, 0, 0};
    for (int w = view.d_start[c] + lane; w < view.d_start[c + 1]; w += POINT_LANES) {
        const size_t unknown = (size_t)view.d_unknown[w];
        const double *block = view.d_block + 9 * (size_t)w, *turned = view.d_turned + 9 * (size_t)w,
                     *at = x + 3 * (size_t)iteration.d_node_of_free[unknown];
        const float *left = iteration.d_left + 3 * unknown;
        for (int r = 0; r < 3; r++) {
            y[r] += block[3 * r] * at[0] + block[3 * r + 1] * at[1] + block[3 * r + 2] * at[2];
            moved[r] += turned[3 * r] * left[0] + turned[3 * r + 1] * left[1] + turned[3 * r + 2] * left[2];
        }
    }
    for (int r = 0; r < 3; r++) {
        y[r] = point_sum(y[r]);
        moved[r] = point_sum(moved[r]);
    }
    const double *frame = view.d_frame + 9 * (size_t)c, *goal = view.d_goal + 3 * (size_t)c,
                 *force = view.d_force + 3 * (size_t)c;
    double with[3] = {0, 0, 0};
    if (view.num_moving > 0) move_with_pieces(view, c, with);
    for (int r = 0; r < 3; r++) {
        double motion = y[r] + frame[r] * with[0] + frame[3 + r] * with[1] + frame[6 + r] * with[2];
        if (!state.done)
            motion = moved[r] + frame[3 * r] * (y[0] - goal[0]) + frame[3 * r + 1] * (y[1] - goal[1]) +
                     frame[3 * r + 2] * (y[2] - goal[2]) + with[r];
        if (!state.done && view.num_moving > 0) motion += view.d_own_compliance[c] * force[r];
        if (lane == 0) out[3 * (size_t)c + r] = motion;
    }
}

/* Measure the motion of a spring's held point, with one warp. */
static __device__ void measure_spring(const gpu_contact_view &view, const gpu_iteration &iteration,
                                      const gpu_state &state, int s, double *out)
{
    const int target = gpu_target(&state), t = view.spring[s];
    const gpu_tool &tool = state.step.tools[t];
    double y[3];
    held_point(iteration, tool, target, y);
    for (int d = 0; d < 3 && threadIdx.x % 32 == 0; d++)
        out[3 * (size_t)(view.count + s) + d] =
            y[d] + tool.compliance * state.force[target][3 * t + d] - tool.target[d];
}

/* Measure the motion of several points or of one spring with each warp. */
static __global__ void __launch_bounds__(THREADS)
    measure_kernel(const gpu_contact_view *d_view, gpu_iteration iteration)
{
    const gpu_contact_view &view = *d_view;
    const gpu_state &state = *iteration.d_state;
    const int warp = (int)(blockIdx.x * THREADS + threadIdx.x) / 32,
              spring = warp - (view.count + WARP_POINTS - 1) / WARP_POINTS,
              point = warp * WARP_POINTS + (int)threadIdx.x % 32 / POINT_LANES;
    if (spring < 0 && point < view.count) measure_point(view, iteration, state, point, view.d_motion);
    if (spring >= 0 && spring < view.num_springs && !state.done)
        measure_spring(view, iteration, state, spring, view.d_motion);
}

/* Compute W' dl in the nodes' axes and add it to the residual, with one block. */
static __device__ void pull(const gpu_contact_view &view, const gpu_iteration &iteration, const gpu_state &state)
{
    double *residual = iteration.d_residual[gpu_target(&state)];
    for (int m = (int)threadIdx.x; m < 3 * view.num_slots; m += (int)blockDim.x) {
        const int s = m / 3, k = m % 3;
        double sum = 0;
        for (int i = view.d_weight_start[s]; i < view.d_weight_start[s + 1]; i++) {
            const int w = view.d_weight[i];
            const double *turned = view.d_turned + 9 * (size_t)w, *change = view.d_change + 3 * (size_t)view.d_point[w];
            sum += turned[k] * change[0] + turned[3 + k] * change[1] + turned[6 + k] * change[2];
        }
        view.d_pull[m] = sum;
        residual[3 * (size_t)view.d_moved_unknowns[s] + k] += sum;
    }
}

static __global__ void __launch_bounds__(ONE_BLOCK) pull_kernel(gpu_contact_view view, gpu_iteration iteration)
{
    if (!iteration.d_state->done) pull(view, iteration, *iteration.d_state);
}

/* Doubles of the cones of one point and its friction, without equations and A. */
enum { CONE_DOUBLES = 3 * 4 + 1 + (sizeof(pliant_cone_point) + 2 * sizeof(int32_t)) / sizeof(double) };

/* Put the cone problem into shared memory, up to its size: first A, which is read most often, and then the equations of
 * the pressing points. Larger data stays in global memory. */
static __device__ pliant_cones place_cones(const gpu_contact_view &view, double *shared, size_t capacity)
{
    pliant_cones on;
    const size_t count = (size_t)(view.count + view.num_springs), row = 3 * count;
    double *next = shared + CONE_DOUBLES * count, *const end = shared + capacity;
    size_t rows = row < PLIANT_CONE_MAX_ROWS ? row : PLIANT_CONE_MAX_ROWS;
    on.count = (int32_t)count;
    on.motion = shared;
    on.force = shared + row;
    on.change = shared + 2 * row;
    on.moved = shared + 3 * row;
    on.before = view.d_before + blockIdx.x * row;
    double *friction = shared + 4 * row;
    for (size_t p = threadIdx.x; p < count; p += CONE_THREADS) friction[p] = view.d_friction[p];
    on.friction = friction;
    on.point = reinterpret_cast<pliant_cone_point *>(friction + count);
    on.list = reinterpret_cast<int32_t *>(on.point + count);
    on.changing = on.list + count;
    const bool fits = next + row * row <= end;
    on.matrix = fits ? next : view.d_matrix;
    on.equations = fits ? next + row * row : next;
    while (rows > 0 && on.equations + rows * (rows + 1) > end) rows -= 3;
    on.fast_rows = (int32_t)rows;
    on.large_equations = view.d_equations;
    if (!fits) return on;
    for (size_t i = threadIdx.x; i < row * row; i += COPIES * CONE_THREADS) { /* several loads in flight at once */
        double some[COPIES];
        for (size_t c = 0; c < COPIES; c++)
            some[c] = i + c * CONE_THREADS < row * row ? view.d_matrix[i + c * CONE_THREADS] : 0;
        for (size_t c = 0; c < COPIES; c++)
            if (i + c * CONE_THREADS < row * row) next[i + c * CONE_THREADS] = some[c];
    }
    return on;
}

/* Solve the cone problem, and keep the loads of couplings within their limits. Return false if too many points press.
 * coupling: shared memory */
static __device__ bool solve_within_limits(const pliant_team *team, const pliant_cones *on,
                                           const gpu_contact_view &view, pliant_coupling *coupling)
{
    pliant_couplings limits = {};
    limits.count = view.num_couplings;
    limits.points = view.count;
    limits.coupling = coupling;
    limits.columns = view.d_coupling_columns;
    limits.matrix = view.d_matrix;
    limits.copy = on->matrix == view.d_matrix ? nullptr : const_cast<double *>(on->matrix);
    for (int n = team->rank; n < limits.count; n += team->size) coupling[n] = view.d_coupling[n];
    pliant_team_wait(team);
    pliant_couplings_begin(team, &limits);
    do {
        if (pliant_cones_run(team, on) < 0) return false;
    } while (pliant_couplings_adapt(team, on, &limits));
    return true;
}

/* Compute the contact forces of an evaluation from the measured motions, and their pull. Several blocks share the large
 * systems of equations; all else is done by each of them, with the same result. If the motions are not finite, the old
 * forces stay. If too many points press, the evaluation ends, and the host repeats it. */
static __global__ void __launch_bounds__(CONE_THREADS)
    cones_kernel(const gpu_contact_view *d_view, gpu_iteration iteration, int capacity)
{
    extern __shared__ double shared[];
    __shared__ double sums[CONE_THREADS / 32], resistance;
    __shared__ pliant_coupling coupling[3 * PLIANT_MAX_TOOLS];
    gpu_state &state = *iteration.d_state;
    const gpu_contact_view &view = *d_view;
    if (state.done) return;
    const pliant_team team = {(int)threadIdx.x, CONE_THREADS, sums, nullptr},
                      all = {(int)(blockIdx.x * CONE_THREADS + threadIdx.x), (int)(gridDim.x * CONE_THREADS), nullptr,
                             view.d_arrivals};
    pliant_cones on = place_cones(view, shared, (size_t)capacity / sizeof(double));
    on.all = gridDim.x > 1 ? &all : &team;
    on.few_rows = gridDim.x > 1 ? PLIANT_CONE_MAX_ROWS : PLIANT_CONE_FEW_ROWS;
    on.resistance = &resistance;
    if (threadIdx.x == 0) resistance = PLIANT_CONE_WEAK_RESISTANCE;
    const int points = 3 * view.count;
    for (int i = (int)threadIdx.x; i < 3 * on.count; i += CONE_THREADS) {
        on.motion[i] = view.d_motion[i];
        on.force[i] = i < points ? view.d_force[i] : 0;
    }
    __syncthreads();
    double wrong = 0;
    for (int i = (int)threadIdx.x; i < 3 * on.count; i += CONE_THREADS) wrong += !isfinite(on.motion[i]);
    const bool sensible = pliant_team_sum(&team, wrong) == 0,
               is_solved = !sensible || solve_within_limits(&team, &on, view, coupling);
    /* Now the first block changes what other blocks have read at the start. If one of them has not even started, no
     * block has waited for it: it reads the same values, or `done`. */
    if (blockIdx.x > 0) return;
    for (int n = (int)threadIdx.x; n < view.num_couplings; n += CONE_THREADS) {
        pliant_coupling *of = view.d_coupling + n;
        if (sensible) {
            of->tissue = coupling[n].tissue;
            set_coupling(view, of, coupling[n].compliance);
        }
        if (is_solved) of->found = sensible ? of->compliance : of->taken;
    }
    if (!is_solved) {
        if (threadIdx.x == 0) state.done = state.needs_host = 1;
        return;
    }
    for (int i = (int)threadIdx.x; i < points; i += CONE_THREADS) {
        view.d_found[i] = on.force[i];
        view.d_found_motion[i] = sensible ? on.motion[i] : view.d_taken_motion[i];
        view.d_change[i] = on.force[i] - view.d_force[i];
    }
    __syncthreads();
    pull(view, iteration, state);
}

/* Multiply the columns by the pull and add the result to the free step. Groups of threads divide the columns. */
static __global__ void __launch_bounds__(LANES_OF_STEP *GROUPS)
    push_kernel(const gpu_contact_view *d_view, gpu_iteration iteration)
{
    __shared__ double sums[GROUPS][LANES_OF_STEP];
    if (iteration.d_state->done) return;
    const gpu_contact_view &view = *d_view;
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

/* ---- Kernel launches. */

pliant_status pliant_cuda_contact_begin(const gpu_contact_view *view, const gpu_iteration *iteration,
                                        cudaStream_t stream)
{
    const unsigned pairs = blocks_for(view->count, PAIRS);
    if (view->num_weights > 0) { /* otherwise only pieces are in contact */
        turn_kernel<<<blocks_for(view->num_weights, THREADS), THREADS, 0, stream>>>(*view, *iteration);
        CUDA_TRY(CUDA_LAUNCHED("turn_kernel"));
    }
    matrix_kernel<<<dim3(pairs, pairs), dim3(PAIRS, PAIRS), 0, stream>>>(*view);
    CUDA_TRY(CUDA_LAUNCHED("matrix_kernel"));
    if (view->num_springs == 0) return PLIANT_OK;
    spring_kernel<<<1, ONE_BLOCK, 0, stream>>>(*view, *iteration);
    return CUDA_LAUNCHED("spring_kernel");
}

pliant_status pliant_cuda_contact_load(const gpu_contact_view *d_view, const gpu_iteration *iteration,
                                       cudaStream_t stream)
{
    load_kernel<<<1, ONE_BLOCK, 0, stream>>>(d_view, *iteration);
    return CUDA_LAUNCHED("load_kernel");
}

pliant_status pliant_cuda_contact_measure(const gpu_contact_view *d_view, int32_t count, const gpu_iteration *iteration,
                                          cudaStream_t stream)
{
    const int warps = (count + WARP_POINTS - 1) / WARP_POINTS + PLIANT_MAX_TOOLS;
    measure_kernel<<<blocks_for(32 * warps, THREADS), THREADS, 0, stream>>>(d_view, *iteration);
    return CUDA_LAUNCHED("measure_kernel");
}

pliant_status pliant_cuda_contact_pull(const gpu_contact_view *view, const gpu_iteration *iteration,
                                       cudaStream_t stream)
{
    pull_kernel<<<1, ONE_BLOCK, 0, stream>>>(*view, *iteration);
    return CUDA_LAUNCHED("pull_kernel");
}

pliant_status pliant_cuda_contact_push(const gpu_contact_view *d_view, const gpu_iteration *iteration,
                                       cudaStream_t stream)
{
    push_kernel<<<blocks_for(3 * iteration->num_free, LANES_OF_STEP), dim3(LANES_OF_STEP, GROUPS), 0, stream>>>(
        d_view, *iteration);
    return CUDA_LAUNCHED("push_kernel");
}

static_assert(CONE_DOUBLES * CONTACT_BLOCK_POINTS * sizeof(double) + 3 * PLIANT_MAX_TOOLS * sizeof(pliant_coupling) <
                  47 << 10,
              "every GPU has this shared memory");

pliant_status pliant_cuda_contact_cone_limits(gpu_cone_limits *out)
{
    int device = 0, maximum = 0, processors = 0, cooperates = 0, per_processor = 0;
    cudaFuncAttributes own;
    CUDA_TRY(CUDA_CALL(cudaGetDevice(&device)));
    CUDA_TRY(CUDA_CALL(cudaDeviceGetAttribute(&maximum, cudaDevAttrMaxSharedMemoryPerBlockOptin, device)));
    CUDA_TRY(CUDA_CALL(cudaDeviceGetAttribute(&processors, cudaDevAttrMultiProcessorCount, device)));
    CUDA_TRY(CUDA_CALL(cudaDeviceGetAttribute(&cooperates, cudaDevAttrCooperativeLaunch, device)));
    CUDA_TRY(CUDA_CALL(cudaFuncGetAttributes(&own, cones_kernel)));
    out->shared_bytes = maximum - (int)own.sharedSizeBytes;
    CUDA_TRY(
        CUDA_CALL(cudaFuncSetAttribute(cones_kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, out->shared_bytes)));
    CUDA_TRY(CUDA_CALL(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&per_processor, cones_kernel, CONE_THREADS,
                                                                     (size_t)out->shared_bytes)));
    out->num_blocks = cooperates && per_processor > 0 ? processors : 1;
    out->max_points = CONTACT_BLOCK_POINTS;
    if (out->num_blocks > 1) out->max_points = out->shared_bytes / (int)(CONE_DOUBLES * sizeof(double));
    return PLIANT_OK;
}

pliant_status pliant_cuda_contact_cones(const gpu_contact_view *d_view, const gpu_iteration *iteration, int32_t bytes,
                                        cudaStream_t stream)
{
    cones_kernel<<<1, CONE_THREADS, (size_t)bytes, stream>>>(d_view, *iteration, bytes);
    return CUDA_LAUNCHED("cones_kernel");
}

pliant_status pliant_cuda_contact_cones_with_all_blocks(const gpu_contact_view *view, const gpu_contact_view *d_view,
                                                        const gpu_iteration *iteration, const gpu_cone_limits *limits,
                                                        cudaStream_t stream)
{
    gpu_iteration copy = *iteration;
    int bytes = limits->shared_bytes;
    void *arguments[] = {&d_view, &copy, &bytes};
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(view->d_arrivals, 0, sizeof *view->d_arrivals, stream)));
    return CUDA_CALL(cudaLaunchCooperativeKernel(cones_kernel, dim3((unsigned)limits->num_blocks), dim3(CONE_THREADS),
                                                 arguments, (size_t)bytes, stream));
}
