#include "cuda/fem/quasistatic/anderson.h"
#include "cuda/fem/quasistatic/axes.cuh"
#include "cuda/base/check.h"
#include "fem/quasistatic/anderson.h"
#include "cuda/base/warp_sum.cuh"

enum { THREADS = 256 };

/* ---- Start of a step. */

/* Invert the leading rows x rows of a by Gauss-Jordan elimination with row exchanges, one thread per column. Return
 * false if a is singular. */
static __device__ bool invert_rows(int rows, double (*a)[2 * GPU_ROWS])
{
    const int thread = (int)threadIdx.x;
    __shared__ int pivot;
    for (int p = 0; p < rows; p++) {
        __syncthreads();
        if (thread == 0) {
            pivot = p;
            for (int r = p + 1; r < rows; r++)
                if (fabs(a[r][p]) > fabs(a[pivot][p])) pivot = r;
        }
        __syncthreads();
        double d = a[pivot][p];
        if (!(fabs(d) > 0) || !isfinite(d)) return false; /* the same for all threads */
        __syncthreads();
        if (thread < 2 * rows) {
            double own = a[pivot][thread];
            a[pivot][thread] = a[p][thread];
            a[p][thread] = own / d;
        }
        __syncthreads();
        double by[GPU_ROWS];
        for (int r = 0; r < rows; r++) by[r] = a[r][p];
        __syncthreads();
        if (thread < 2 * rows)
            for (int r = 0; r < rows; r++)
                if (r != p) a[r][thread] -= by[r] * a[p][thread];
    }
    __syncthreads();
    return true;
}

static __global__ void __launch_bounds__(THREADS) begin_kernel(gpu_iteration iteration, gpu_step step)
{
    __shared__ double a[GPU_ROWS][2 * GPU_ROWS];
    __shared__ int rows, row_of[GPU_ROWS];
    gpu_state &state = *iteration.d_state;
    const int thread = (int)threadIdx.x, now = state.now;
    const size_t n = 3 * (size_t)iteration.num_free;
    if (thread == 0) {
        rows = 0;
        for (int t = 0; t < GPU_TOOLS; t++)
            for (int d = 0; d < 3; d++) {
                state.force[now][3 * t + d] = step.tools[t].force[d];
                if (step.tools[t].spring) row_of[rows++] = 3 * t + d;
            }
        state.step = step;
        state.done = state.needs_host = state.iterations = state.evaluates_end = 0;
        state.was_accepted = state.restored_previous = 0;
        state.start_is_evaluated = step.start_is_evaluated;
        state.skips = step.known == PLIANT_KNOWN_STEP;
        pliant_anderson &rules = state.rules;
        if (step.restart) pliant_anderson_reset(&rules);
        if (step.drops_secants) pliant_anderson_drop_secants(&rules);
        rules.max_evaluations = step.max_evaluations;
        rules.depth = step.depth;
        rules.capacity = step.capacity;
        rules.limits_secants = 1;
        rules.tolerance = step.tolerance;
        rules.is_cycle = step.is_cycle;
        rules.is_bounded = step.has_contacts;
        rules.smallest_displacement = step.smallest_displacement;
        if (step.after_newton) { /* as after a blind step */
            rules.follows_blind_step = 1;
            rules.trusted_merit = step.trusted_merit;
            for (int r = 0; r < GPU_ROWS; r++) state.force[1 - now][r] = step.previous_force[r];
        }
        pliant_anderson_begin(&rules);
        state.rows = rows;
        for (int r = 0; r < rows; r++) state.row_of[r] = row_of[r];
    }
    if (thread < GPU_ROWS) state.past_step_force[thread] = state.step_force[now][thread];
    __syncthreads();
    for (int m = thread; m < rows * rows; m += THREADS) { /* S = c I + W Z */
        int r = m / rows, c = m % rows;
        const gpu_tool &tool = step.tools[row_of[r] / 3];
        const double *z = step.tools[row_of[c] / 3].d_response + n * (size_t)(row_of[c] % 3);
        double sum = r == c ? tool.compliance : 0;
        for (int h = 0; h < tool.count; h++)
            for (int d = 0; d < 3; d++)
                sum += tool.d_block[9 * h + 3 * (row_of[r] % 3) + d] * z[3 * tool.d_unknown[h] + d];
        a[r][c] = sum;
        a[r][rows + c] = r == c;
    }
    __syncthreads();
    bool regular = invert_rows(rows, a);
    if (thread == 0) state.singular = !regular;
    for (int m = thread; m < rows * rows; m += THREADS) iteration.d_history->inverse[m] = a[m / rows][rows + m % rows];
}

/* ---- After the preconditioner. */

enum { NODES = 64 }; /* threads of a block, one per node */

/* Effect of all tools' springs. Every block computes dl, and the part of W' dl on its nodes. */
struct spring_share {
    double right[GPU_ROWS], force[GPU_ROWS], pull[NODES][3];
};

/* Compute dl = S^-1 (e - W step0), one warp per tool. */
static __device__ void find_spring_forces(const gpu_iteration &iteration, const gpu_state &state, int target,
                                          spring_share &share)
{
    const int thread = (int)threadIdx.x, lane = thread % 32, rows = state.rows;
    for (int row = thread / 32 * 3; row < rows; row += NODES / 32 * 3) {
        const int t = state.row_of[row] / 3;
        const gpu_tool &tool = state.step.tools[t];
        double y[3];
        held_point(iteration, tool, target, y);
        for (int d = 0; d < 3 && lane == 0; d++)
            share.right[row + d] = tool.target[d] - y[d] - tool.compliance * state.force[target][3 * t + d];
    }
    __syncthreads();
    if (thread < rows) {
        double sum = 0;
        for (int c = 0; c < rows; c++) sum += iteration.d_history->inverse[rows * thread + c] * share.right[c];
        share.force[state.row_of[thread]] = sum;
    }
    __syncthreads();
}

/* Add the tools one after the other, since they may share nodes. */
static __device__ void find_spring_pull(const gpu_state &state, int first_node, spring_share &share)
{
    for (int row = 0; row < state.rows; row += 3) {
        const gpu_tool &tool = state.step.tools[state.row_of[row] / 3];
        const double *f = share.force + state.row_of[row];
        for (int h = (int)threadIdx.x; h < tool.count; h += NODES) {
            const int local = tool.d_unknown[h] - first_node;
            if (local < 0 || local >= NODES) continue;
            const double *block = tool.d_block + 9 * (size_t)h;
            for (int c = 0; c < 3; c++)
                share.pull[local][c] += block[c] * f[0] + block[3 + c] * f[1] + block[6 + c] * f[2];
        }
        __syncthreads();
    }
}

/* Read a node's residual without the springs' part, and the final residual of the previous step (past). With KNOWN,
 * that is the same state. */
template <bool KNOWN>
static __device__ void take_residual(const gpu_iteration &iteration, const gpu_state &state, int target, size_t i,
                                     double *residual, double *past)
{
    for (int d = 0; d < 3; d++) {
        if (KNOWN) {
            residual[d] = iteration.d_free_residual[i + d];
            past[d] = iteration.d_past_residual[i + d] = iteration.d_residual[target][i + d];
            iteration.d_past_step[i + d] = iteration.d_step[target][i + d];
        } else {
            residual[d] = iteration.d_residual[target][i + d];
            if (state.start_is_evaluated) past[d] = iteration.d_past_residual[i + d];
            iteration.d_free_residual[i + d] = residual[d];
        }
    }
}

/* Compute step = left + T' Z dl at one node, and add T' W' dl to the residual. */
static __device__ void finish_node(const gpu_iteration &iteration, const gpu_state &state, const spring_share &share,
                                   int target, size_t node, double *step, double *residual)
{
    const size_t n = 3 * (size_t)iteration.num_free, i = 3 * node;
    double moved[3] = {0, 0, 0}, pulled[3];
    for (int row = 0; row < state.rows; row++) {
        int at = state.row_of[row];
        const double *z = state.step.tools[at / 3].d_response + n * (size_t)(at % 3) + i;
        for (int d = 0; d < 3; d++) moved[d] += share.force[at] * z[d];
    }
    for (int d = 0; d < 3; d++) pulled[d] = share.pull[threadIdx.x][d];
    if (state.rows > 0) {
        turn_into(iteration, node, moved);
        turn_into(iteration, node, pulled);
    }
    for (int d = 0; d < 3; d++) {
        step[d] = iteration.d_left[i + d] + moved[d];
        residual[d] += pulled[d];
        iteration.d_residual[target][i + d] = residual[d];
        iteration.d_step[target][i + d] = step[d];
    }
}

/* List the stored secants in shared memory, with one warp. */
static __device__ void list_secants(const gpu_iteration &iteration, const gpu_state &state, int *used, int *count)
{
    const int lane = (int)threadIdx.x % 32;
    const bool is = lane < iteration.capacity && state.rules.number[lane] > 0;
    const unsigned all = __ballot_sync(0xffffffff, is);
    if (is) used[__popc(all & ((1u << lane) - 1))] = lane;
    if (lane == 0) *count = __popc(all);
}

/* Reduce the products of one warp, and the largest nodal residual, and store them. */
static __device__ __forceinline__ void reduce_single_sums(int lane, double own, double by_now, double of_now,
                                                          double length, double of_past, double *sums)
{
    own = warp_sum(own);
    by_now = warp_sum(by_now);
    of_now = warp_sum(of_now);
    of_past = warp_sum(of_past);
    const double largest = warp_largest(length);
    if (lane != 0) return;
    sums[0] = own;
    sums[1] = by_now;
    sums[2] = of_now;
    sums[3] = largest;
    sums[4] = of_past;
}

/* Complete the step and compute its products, one thread per node. The products are with its residual, crosswise with
 * the present iterate's, and with the previous step's residual. The secants' products with its residual follow, and in
 * a first evaluation with the previous step's. The largest nodal residual is found as well. KNOWN: the first state
 * equals the final state of the last step, and so does the preconditioner's result. */
template <bool KNOWN>
static __global__ void __launch_bounds__(NODES) complete_kernel(gpu_iteration iteration, int gather_blocks)
{
    __shared__ spring_share share;
    __shared__ double sums[NODES / 32][DOT_SUMS];
    __shared__ int used[GPU_HISTORY], num_used;
    gpu_state &state = *iteration.d_state;
    if (state.done) return;
    const int thread = (int)threadIdx.x, warp = thread / 32, lane = thread % 32, target = gpu_target(&state),
              now = state.now;
    const bool looks_back = gpu_looks_back(&state);
    const int node = (int)(blockIdx.x * NODES) + thread,
              num_sums = SINGLE_SUMS + (looks_back ? 2 : 1) * iteration.capacity;
    const size_t n = 3 * (size_t)iteration.num_free, i = 3 * (size_t)node;
    const bool there = node < iteration.num_free;
    if (warp == 0) list_secants(iteration, state, used, &num_used);
    for (int s = lane; s < DOT_SUMS; s += 32) sums[warp][s] = 0;
    for (int d = 0; d < 3; d++) share.pull[thread][d] = 0;
    if (thread < GPU_ROWS) share.force[thread] = 0;
    __syncthreads();
    find_spring_forces(iteration, state, target, share);
    find_spring_pull(state, node - thread, share);
    if (blockIdx.x == 0 && thread < GPU_ROWS) state.step_force[target][thread] = share.force[thread];
    double step[3] = {0, 0, 0}, residual[3] = {0, 0, 0}, past[3] = {0, 0, 0}, own = 0, by_now = 0, of_now = 0,
           of_past = 0;
    if (there) {
        take_residual<KNOWN>(iteration, state, target, i, residual, past);
        finish_node(iteration, state, share, target, (size_t)node, step, residual);
        for (int d = 0; d < 3; d++) {
            own += step[d] * residual[d];
            of_past += step[d] * past[d];
            if (now == target) continue;
            by_now += step[d] * iteration.d_residual[now][i + d];
            of_now += iteration.d_step[now][i + d] * residual[d];
        }
    }
    const double length =
        sqrt(residual[0] * residual[0] + residual[1] * residual[1] + residual[2] * residual[2]);
    reduce_single_sums(lane, own, by_now, of_now, length, of_past, sums[warp]);
#pragma unroll 4
    for (int u = 0; u < num_used; u++) {
        double secant[3] = {0, 0, 0};
        for (int d = 0; there && d < 3; d++) secant[d] = iteration.d_secant_step[n * (size_t)used[u] + i + d];
        const double along = warp_sum(secant[0] * residual[0] + secant[1] * residual[1] + secant[2] * residual[2]);
        if (lane == 0) sums[warp][SINGLE_SUMS + used[u]] = along;
        if (!looks_back) continue;
        const double then = warp_sum(secant[0] * past[0] + secant[1] * past[1] + secant[2] * past[2]);
        if (lane == 0) sums[warp][SINGLE_SUMS + iteration.capacity + used[u]] = then;
    }
    __syncthreads();
    if (thread >= num_sums) return;
    double sum = sums[0][thread];
    for (int w = 1; w < NODES / 32; w++) sum = thread == 3 ? fmax(sum, sums[w][thread]) : sum + sums[w][thread];
    iteration.d_sums[GATHER_SUMS * gather_blocks + (size_t)gridDim.x * (size_t)thread + blockIdx.x] = sum;
}

/* ---- The next trial. */

/* Secants with a weight in the proposal, in the error estimate, or in the previous step's error estimate. */
struct weighted { int count, place[GPU_HISTORY]; double weight[GPU_HISTORY][3]; };

/* List them with one warp. */
static __device__ void list_weights(const gpu_iteration &iteration, const gpu_state &state, weighted &list)
{
    const int lane = (int)threadIdx.x % 32;
    double own[3] = {0, 0, 0};
    for (int k = 0; k < 3 && lane < iteration.capacity; k++) own[k] = state.weights[k][lane];
    const bool is = own[0] != 0 || own[1] != 0 || own[2] != 0;
    const unsigned all = __ballot_sync(0xffffffff, is);
    const int place = __popc(all & ((1u << lane) - 1));
    if (is) list.place[place] = lane;
    for (int k = 0; is && k < 3; k++) list.weight[place][k] = own[k];
    if (lane == 0) list.count = __popc(all);
}

/* Store the secant and compute the proposal at one node. left, made, past: out: remaining motion, proposed motion, and
 * remaining motion of the previous step, in the node's axes. */
static __device__ void propose_node(const gpu_iteration &iteration, const gpu_state &state,
                                    const pliant_anderson &rules, const weighted &list, size_t node, double *left,
                                    double *made, double *past)
{
    const size_t n = 3 * (size_t)iteration.num_free, i = 3 * node, x = 3 * (size_t)iteration.d_node_of_free[node];
    const int now = state.now, next = rules.next;
    const double damping = rules.damping;
    const bool stays = next == PLIANT_NEXT_PREVIOUS || state.evaluates_end; /* the state exists already, and is kept */
    if (rules.secant_slot >= 0) {
        const int from = state.old_now, to = 1 - from;
        const size_t place = n * (size_t)rules.secant_slot + i;
        double moved[3];
        for (int d = 0; d < 3; d++) moved[d] = iteration.d_x[to][x + d] - iteration.d_x[from][x + d];
        turn_into(iteration, node, moved);
        for (int d = 0; d < 3; d++) {
            iteration.d_secant_x[place + d] = moved[d];
            iteration.d_secant_step[place + d] = iteration.d_step[to][i + d] - iteration.d_step[from][i + d];
            iteration.d_secant_residual[place + d] =
                iteration.d_residual[to][i + d] - iteration.d_residual[from][i + d];
        }
    }
    const double unexplained = pliant_anderson_error_factor(&rules);
    for (int d = 0; d < 3; d++) {
        made[d] = iteration.d_step[now][i + d];
        left[d] = unexplained * made[d];
        past[d] = state.start_is_evaluated ? unexplained * iteration.d_past_step[i + d] : 0;
    }
#pragma unroll 4
    for (int u = 0; u < list.count; u++)
        for (int d = 0; d < 3; d++) {
            const size_t place = n * (size_t)list.place[u] + i + d;
            const double moved = iteration.d_secant_x[place], step = iteration.d_secant_step[place],
                         left_by = moved + unexplained * step;
            made[d] -= list.weight[u][0] * (moved + step);
            left[d] -= list.weight[u][1] * left_by;
            past[d] -= list.weight[u][2] * left_by;
        }
    if (stays) return;
    double out[3] = {made[0], made[1], made[2]};
    turn_out(iteration, node, out);
    for (int d = 0; d < 3; d++)
        iteration.d_x[1 - now][x + d] =
            next == PLIANT_NEXT_REST ? iteration.d_rest[x + d] : iteration.d_x[now][x + d] + damping * out[d];
}

/* The same for a pressure (pliant_pressure_remember and pliant_pressure_propose). */
static __device__ void propose_pressure(const gpu_iteration &iteration, const gpu_state &state,
                                        const pliant_anderson &rules, const weighted &list, int p)
{
    const gpu_pressures &pressures = iteration.pressures;
    const size_t count = (size_t)pressures.count;
    const int now = state.now;
    if (rules.secant_slot >= 0) {
        const int from = state.old_now, to = 1 - from;
        const size_t place = count * (size_t)rules.secant_slot + (size_t)p;
        pressures.d_secant_pressure[place] = pressures.d_pressure[to][p] - pressures.d_pressure[from][p];
        pressures.d_secant_step[place] = pressures.d_step[to][p] - pressures.d_step[from][p];
    }
    if (rules.next == PLIANT_NEXT_PREVIOUS || state.evaluates_end) return;
    double step = pressures.d_step[now][p];
#pragma unroll 4
    for (int u = 0; u < list.count; u++) {
        const size_t place = count * (size_t)list.place[u] + (size_t)p;
        step -= list.weight[u][0] * (pressures.d_secant_pressure[place] + pressures.d_secant_step[place]);
    }
    pressures.d_pressure[1 - now][p] =
        rules.next == PLIANT_NEXT_REST ? 0 : pressures.d_pressure[now][p] + rules.damping * step;
}

/* Finish a proposal after all blocks are done: test convergence, or continue with the blind step and its end. rules: a
 * copy in shared memory. */
static __device__ void settle(gpu_state &state, pliant_anderson &rules)
{
    double largest[4];
    /* Bypasses the cache. */
    for (int m = 0; m < 4; m++) largest[m] = sqrt(__longlong_as_double((long long)atomicMax(&state.largest[m], 0ull)));
    if (!state.evaluates_end &&
        (rules.next == PLIANT_NEXT_TRIAL || rules.next == PLIANT_NEXT_BLIND || rules.next == PLIANT_NEXT_DONE))
        pliant_anderson_finish_proposal(&rules, state.mixed, largest[0], rules.damping * largest[1], largest[2]);
    else if (state.evaluates_end && state.evaluated)
        rules.error = pliant_anderson_error(largest[0]);
    const bool done = state.evaluates_end || rules.next == PLIANT_NEXT_DONE;
    state.done = done;
    if (!done) {
        state.evaluates_end = rules.next == PLIANT_NEXT_BLIND;
        return;
    }
    state.skips = 1;
    state.evaluated = state.evaluated && state.now == state.last_target;
    pliant_anderson_report_error(&rules, state.start_is_evaluated, largest[3]);
}

static __device__ void copy_rules(const pliant_anderson *from, pliant_anderson *to)
{
    static_assert(sizeof *from % sizeof(double) == 0, "copied as doubles");
    for (int n = (int)threadIdx.x; n < (int)(sizeof *from / sizeof(double)); n += NODES)
        reinterpret_cast<double *>(to)[n] = reinterpret_cast<const double *>(from)[n];
}

/* Store the secant and compute the next iterate, one thread per node. The blocks after node_blocks have one thread per
 * pressure. */
static __global__ void __launch_bounds__(NODES) propose_kernel(gpu_iteration iteration, int node_blocks)
{
    __shared__ double maximum[4][NODES / 32];
    __shared__ weighted list;
    __shared__ pliant_anderson rules;
    __shared__ bool is_last;
    gpu_state &state = *iteration.d_state;
    if (state.done) return;
    const int node = (int)(blockIdx.x * NODES + threadIdx.x), lane = (int)threadIdx.x % 32,
              warp = (int)threadIdx.x / 32;
    if (warp == 0) list_weights(iteration, state, list);
    copy_rules(&state.rules, &rules);
    __syncthreads();
    double squares[4] = {0, 0, 0, 0};
    const int pressure = node - node_blocks * NODES;
    if (pressure >= 0) {
        if (pressure < iteration.pressures.count) propose_pressure(iteration, state, rules, list, pressure);
    } else if (node < iteration.num_free) {
        const size_t x = 3 * (size_t)iteration.d_node_of_free[node];
        for (int d = 0; d < 3; d++) {
            double u = iteration.d_x[state.now][x + d] - iteration.d_rest[x + d];
            squares[2] += u * u;
        }
        double left[3], made[3], past[3];
        propose_node(iteration, state, rules, list, (size_t)node, left, made, past);
        for (int d = 0; d < 3; d++) {
            squares[0] += left[d] * left[d];
            squares[1] += made[d] * made[d];
            squares[3] += past[d] * past[d];
        }
    }
    for (int m = 0; m < 4; m++) {
        /* NaN counts as infinite */
        const double largest = warp_largest(isfinite(squares[m]) ? squares[m] : INFINITY);
        if (lane == 0) maximum[m][warp] = largest;
    }
    __syncthreads();
    if (threadIdx.x == 0) {
        for (int m = 0; m < 4; m++) {
            double largest = maximum[m][0];
            for (int w = 1; w < NODES / 32; w++) largest = fmax(largest, maximum[m][w]);
            /* Independent of the order. */
            atomicMax(&state.largest[m], (unsigned long long)__double_as_longlong(largest));
        }
        __threadfence();
        is_last = atomicAdd(&state.blocks, 1ull) + 1 == gridDim.x;
    }
    __syncthreads();
    if (!is_last) return;
    if (threadIdx.x == 0) settle(state, rules);
    __syncthreads();
    copy_rules(&rules, &state.rules);
}

/* ---- Kernel launches. */

int pliant_cuda_dot_blocks(const gpu_iteration *iteration) { return (iteration->num_free + NODES - 1) / NODES; }

pliant_status pliant_cuda_begin(const gpu_iteration *iteration, const gpu_step *step, cudaStream_t stream)
{
    begin_kernel<<<1, THREADS, 0, stream>>>(*iteration, *step);
    return CUDA_LAUNCHED("begin_kernel");
}

pliant_status pliant_cuda_complete(const gpu_iteration *iteration, bool known, int gather_blocks, cudaStream_t stream)
{
    const unsigned blocks = (unsigned)pliant_cuda_dot_blocks(iteration);
    if (known) complete_kernel<true><<<blocks, NODES, 0, stream>>>(*iteration, gather_blocks);
    else complete_kernel<false><<<blocks, NODES, 0, stream>>>(*iteration, gather_blocks);
    return CUDA_LAUNCHED("complete_kernel");
}

pliant_status pliant_cuda_propose(const gpu_iteration *iteration, cudaStream_t stream)
{
    const int node_blocks = pliant_cuda_dot_blocks(iteration),
              pressure_blocks = (iteration->pressures.count + NODES - 1) / NODES;
    propose_kernel<<<(unsigned)(node_blocks + pressure_blocks), NODES, 0, stream>>>(*iteration, node_blocks);
    return CUDA_LAUNCHED("propose_kernel");
}
