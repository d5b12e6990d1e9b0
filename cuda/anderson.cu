#include "anderson.h"
#include "check.h"
#include "fem/quasistatic/anderson.h"

enum { THREADS = 256 };
enum { DECIDERS = 32 * (SINGLE_SUMS + PLIANT_MAX_HISTORY + GATHER_SUMS) }; /* a warp a sum, but in a step's first evaluation */

/* Sum over a warp, the same in every run; all lanes get it. */
static __device__ __forceinline__ double warp_sum(double value)
{
    for (int half = 16; half > 0; half /= 2) value += __shfl_xor_sync(0xffffffff, value, half);
    return value;
}

static __device__ __forceinline__ double warp_largest(double value)
{
    for (int half = 16; half > 0; half /= 2) value = fmax(value, __shfl_xor_sync(0xffffffff, value, half));
    return value;
}

/* T v at one unknown node, T' v: from its own axes and into them */
static __device__ __forceinline__ void turn_out(const gpu_iteration &iteration, size_t node, double *v)
{
    const double *turn = iteration.d_axes + 9 * node, at[3] = {v[0], v[1], v[2]};
    for (int r = 0; r < 3; r++) v[r] = turn[3 * r] * at[0] + turn[3 * r + 1] * at[1] + turn[3 * r + 2] * at[2];
}
static __device__ __forceinline__ void turn_into(const gpu_iteration &iteration, size_t node, double *v)
{
    const double *turn = iteration.d_axes + 9 * node, at[3] = {v[0], v[1], v[2]};
    for (int r = 0; r < 3; r++) v[r] = turn[r] * at[0] + turn[3 + r] * at[1] + turn[6 + r] * at[2];
}

/* ---- at the beginning of a step */

/* inverse of the leading rows x rows of a, by Gauss and Jordan with row exchanges; one thread a column. false: singular */
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
        state.done = state.iterations = state.ending = 0;
        state.knows_forces = step.kept && state.evaluated;
        state.seen = state.knows_forces && step.same_axes;
        state.skips = state.seen && step.same_step;
        pliant_anderson &rules = state.rules;
        rules.cycle_contraction = step.cycle_contraction;
        if (step.restart) pliant_anderson_reset(&rules);
        if (step.forget) pliant_anderson_forget(&rules);
        rules.most_evaluations = step.most_evaluations;
        rules.depth = step.depth;
        rules.room = step.room;
        rules.limits_secants = 1;
        rules.tolerance = step.tolerance;
        rules.smallest_displacement = step.smallest_displacement;
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
            for (int d = 0; d < 3; d++) sum += tool.d_block[9 * h + 3 * (row_of[r] % 3) + d] * z[3 * tool.d_unknown[h] + d];
        a[r][c] = sum;
        a[r][rows + c] = r == c;
    }
    __syncthreads();
    bool regular = invert_rows(rows, a);
    if (thread == 0) state.singular = !regular;
    for (int m = thread; m < rows * rows; m += THREADS) iteration.d_history->inverse[m] = a[m / rows][rows + m % rows];
}

/* ---- after the preconditioner */

enum { NODES = 64 }; /* threads of a block, one a node */

/* What the springs of all tools do: every block finds dl for itself, and the part of W' dl that falls on its nodes. */
struct spring_share {
    double right[GPU_ROWS], force[GPU_ROWS], pull[NODES][3];
};

/* dl = S^-1 (e - W step0), a warp a tool */
static __device__ void find_spring_forces(const gpu_iteration &iteration, const gpu_state &state, int target, spring_share &share)
{
    const int thread = (int)threadIdx.x, lane = thread % 32, rows = state.rows;
    for (int row = thread / 32 * 3; row < rows; row += NODES / 32 * 3) {
        const int t = state.row_of[row] / 3;
        const gpu_tool &tool = state.step.tools[t];
        double moved[3] = {0, 0, 0}; /* W (x + step0) */
        for (int h = lane; h < tool.count; h += 32) {
            size_t unknown = (size_t)tool.d_unknown[h];
            const double *block = tool.d_block + 9 * (size_t)h, *x = iteration.d_x[target] + 3 * (size_t)iteration.d_node_of_free[unknown];
            const float *left = iteration.d_left + 3 * unknown;
            double at[3] = {left[0], left[1], left[2]};
            turn_out(iteration, unknown, at);
            for (int d = 0; d < 3; d++) at[d] += x[d];
            for (int r = 0; r < 3; r++) moved[r] += block[3 * r] * at[0] + block[3 * r + 1] * at[1] + block[3 * r + 2] * at[2];
        }
        for (int d = 0; d < 3; d++) {
            double y = tool.origin[d] + warp_sum(moved[d]);
            if (lane == 0) share.right[row + d] = tool.target[d] - y - tool.compliance * state.force[target][3 * t + d];
        }
    }
    __syncthreads();
    if (thread < rows) {
        double sum = 0;
        for (int c = 0; c < rows; c++) sum += iteration.d_history->inverse[rows * thread + c] * share.right[c];
        share.force[state.row_of[thread]] = sum;
    }
    __syncthreads();
}

/* tools after each other: they may share nodes */
static __device__ void find_spring_pull(const gpu_state &state, int first_node, spring_share &share)
{
    for (int row = 0; row < state.rows; row += 3) {
        const gpu_tool &tool = state.step.tools[state.row_of[row] / 3];
        const double *f = share.force + state.row_of[row];
        for (int h = (int)threadIdx.x; h < tool.count; h += NODES) {
            const int local = tool.d_unknown[h] - first_node;
            if (local < 0 || local >= NODES) continue;
            const double *block = tool.d_block + 9 * (size_t)h;
            for (int c = 0; c < 3; c++) share.pull[local][c] += block[c] * f[0] + block[3 + c] * f[1] + block[6 + c] * f[2];
        }
        __syncthreads();
    }
}

/* step = left + T' Z dl at one node; residual += T' W' dl */
static __device__ void finish_node(const gpu_iteration &iteration, const gpu_state &state, const spring_share &share, int target, size_t node,
                                   double *step, double *residual)
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
        residual[d] = iteration.d_residual[target][i + d] + pulled[d];
        if (state.rows > 0) iteration.d_residual[target][i + d] = residual[d];
        iteration.d_step[target][i + d] = step[d];
    }
}

/* The step complete, and its products: with its own residual, crosswise with the present iterate's, with that of the state before, secants'
 * with its residual, at first secants' with that of the state before; the largest nodal residual. One thread a node. */
static __global__ void __launch_bounds__(NODES) complete_kernel(gpu_iteration iteration, int gather_blocks)
{
    __shared__ spring_share share;
    __shared__ double sums[NODES / 32][DOT_SUMS];
    gpu_state &state = *iteration.d_state;
    if (state.done) return;
    const int thread = (int)threadIdx.x, warp = thread / 32, lane = thread % 32, target = gpu_target(&state), now = state.now;
    const bool looks_back = state.seen && state.iterations == 0;
    const int node = (int)(blockIdx.x * NODES) + thread, num_sums = SINGLE_SUMS + (looks_back ? 2 : 1) * iteration.room;
    const size_t n = 3 * (size_t)iteration.num_free, i = 3 * (size_t)node;
    const bool there = node < iteration.num_free;
    for (int d = 0; d < 3; d++) share.pull[thread][d] = 0;
    if (thread < GPU_ROWS) share.force[thread] = 0;
    __syncthreads();
    find_spring_forces(iteration, state, target, share);
    find_spring_pull(state, node - thread, share);
    if (blockIdx.x == 0 && thread < GPU_ROWS) state.step_force[target][thread] = share.force[thread];
    double step[3] = {0, 0, 0}, residual[3] = {0, 0, 0}, past[3] = {0, 0, 0}, own = 0, by_now = 0, of_now = 0, of_past = 0;
    if (there) {
        finish_node(iteration, state, share, target, (size_t)node, step, residual);
        for (int d = 0; d < 3; d++) {
            own += step[d] * residual[d];
            if (state.seen) past[d] = iteration.d_past_residual[i + d];
            of_past += step[d] * past[d];
            if (now == target) continue;
            by_now += step[d] * iteration.d_residual[now][i + d];
            of_now += iteration.d_step[now][i + d] * residual[d];
        }
    }
    own = warp_sum(own);
    by_now = warp_sum(by_now);
    of_now = warp_sum(of_now);
    of_past = warp_sum(of_past);
    double largest = warp_largest(sqrt(residual[0] * residual[0] + residual[1] * residual[1] + residual[2] * residual[2]));
    if (lane == 0) {
        sums[warp][0] = own;
        sums[warp][1] = by_now;
        sums[warp][2] = of_now;
        sums[warp][3] = largest;
        sums[warp][4] = of_past;
    }
    for (int a = 0; a < num_sums - SINGLE_SUMS; a++) {
        const int place = a % iteration.room;
        const double *by = a < iteration.room ? residual : past;
        double along = 0;
        if (there && state.rules.number[place] > 0) {
            const double *secant = iteration.d_secant_step + n * (size_t)place + i;
            along = secant[0] * by[0] + secant[1] * by[1] + secant[2] * by[2];
        }
        if (state.rules.number[place] > 0) along = warp_sum(along); /* the same for all lanes */
        if (lane == 0) sums[warp][SINGLE_SUMS + a] = along;
    }
    __syncthreads();
    if (thread >= num_sums) return;
    double sum = sums[0][thread];
    for (int w = 1; w < NODES / 32; w++) sum = thread == 3 ? fmax(sum, sums[w][thread]) : sum + sums[w][thread];
    iteration.d_sums[GATHER_SUMS * gather_blocks + (size_t)gridDim.x * (size_t)thread + blockIdx.x] = sum;
}

/* ---- decisions: one block, on a copy of the state in shared memory */

enum { TRIAL, ESTIMATE, PAST, KINDS }; /* of weights */

struct decision {
    gpu_state state;
    double sums[DOT_SUMS], work[GATHER_SUMS];
    double new_row[GPU_HISTORY], gram[KINDS][GPU_HISTORY][GPU_HISTORY], scale[KINDS][GPU_HISTORY];
};

static __device__ double spring_energy(const gpu_state &state, const double *a, const double *b)
{
    double sum = 0;
    for (int row = 0; row < state.rows; row++) {
        int at = state.row_of[row];
        sum += state.step.tools[at / 3].compliance * a[at] * b[at];
    }
    return sum;
}

/* sums over blocks, a warp a sum, always in the same order */
static __device__ void add_up(const gpu_iteration &iteration, int gather_blocks, int dot_blocks, decision &now)
{
    const int lane = (int)threadIdx.x % 32;
    const double *dots = iteration.d_sums + GATHER_SUMS * gather_blocks;
    const bool looks_back = now.state.seen && now.state.iterations == 0;
    const int num_dots = SINGLE_SUMS + (looks_back ? 2 : 1) * iteration.room;
    for (int s = (int)threadIdx.x / 32; s < num_dots + GATHER_SUMS; s += DECIDERS / 32) {
        double sum = 0;
        if (s >= num_dots) {
#pragma unroll 16
            for (int b = lane; b < gather_blocks; b += 32) sum += iteration.d_sums[gather_blocks * (s - num_dots) + b];
        } else {
#pragma unroll 16
            for (int b = lane; b < dot_blocks; b += 32) {
                double part = dots[(size_t)dot_blocks * s + b];
                sum = s == 3 ? fmax(sum, part) : sum + part;
            }
        }
        sum = s == 3 ? warp_largest(sum) : warp_sum(sum);
        if (lane == 0) *(s < num_dots ? now.sums + s : now.work + s - num_dots) = sum;
    }
}

/* The products of the secant from the present iterate to what was evaluated: its row to new_row. */
static __device__ void find_products(decision &now)
{
    gpu_state &state = now.state;
    const int place = state.rules.keep;
    double *along_trial = now.sums + SINGLE_SUMS;
    for (int a = 0; a < GPU_HISTORY; a++) now.new_row[a] = state.rules.number[a] > 0 ? along_trial[a] - state.along[a] : 0;
    const double own = now.sums[0], by_now = now.sums[1], of_now = now.sums[2];
    now.new_row[place] = own - by_now - of_now + state.energy;
    /* secant . residual, of the iterate that stays or of the one that is taken */
    state.along[place] = by_now - state.energy;
    along_trial[place] = own - of_now;
    state.past_along[place] = now.sums[4] - state.past_of_now;
}

static __device__ double find_merit(decision &now, int target)
{
    gpu_state &state = now.state;
    state.scale[target] = fmax(sqrt(fmax(fabs(now.work[0]), fabs(now.work[1]))), state.step.smallest_scale);
    state.residual_force[target] = now.sums[3];
    double energy = now.sums[0] + spring_energy(state, state.step_force[target], state.step_force[target]);
    return state.singular ? INFINITY : pliant_anderson_merit(energy, state.scale[target]);
}

/* accept or refuse; whether to go on, and how: anderson.h, as solver.c follows it */
static __device__ void judge(decision &now, int room)
{
    gpu_state &state = now.state;
    pliant_anderson &rules = state.rules;
    const bool first = rules.next == PLIANT_NEXT_FIRST;
    const int target = gpu_target(&state);
    const double merit = find_merit(now, target);
    const bool plain = !rules.mixes && state.rows == 0 && (rules.next == PLIANT_NEXT_TRIAL || rules.next == PLIANT_NEXT_DESCENT);
    state.evaluated = 1;
    if (state.ending) state.evaluated = pliant_anderson_judge_end(&rules, merit);
    else pliant_anderson_judge(&rules, merit, plain ? now.sums[2] : 0.0, true);
    state.iterations = rules.evaluations;
    state.skips = 0;
    state.last_target = target;
    state.old_now = state.now;
    if (rules.keep >= 0) find_products(now);
    if (rules.take || first) {
        state.now = target;
        state.energy = now.sums[0];
        state.past_of_now = now.sums[4];
        for (int a = 0; a < room; a++) state.along[a] = now.sums[SINGLE_SUMS + a];
    }
    for (int a = 0; first && state.seen && a < room; a++) state.past_along[a] = now.sums[SINGLE_SUMS + room + a];
    if (!state.ending) {
        state.told_scale = state.scale[state.now];
        state.told_residual_force = state.residual_force[state.now];
    }
    for (int m = 0; m < 4; m++) state.largest[m] = 0;
    state.blocks = 0;
}

/* the secant's part in the history */
static __device__ void keep_secant(const gpu_state &state, const double *new_row, gpu_history &history)
{
    const int place = state.rules.keep, thread = (int)threadIdx.x, from = state.old_now, to = 1 - from;
    if (thread < GPU_ROWS) {
        history.force[place][thread] = state.force[to][thread] - state.force[from][thread];
        history.step_force[place][thread] = state.step_force[to][thread] - state.step_force[from][thread];
    }
    if (thread < GPU_HISTORY) history.gram[thread][place] = history.gram[place][thread] = new_row[thread];
}

/* The weights that make the step smallest in the energy norm: the normal equations, scaled to a unit diagonal. Secants that are not used
 * have a row of their own. */
static __device__ void fill_equations(decision &now, const gpu_history &history)
{
    gpu_state &state = now.state;
    const pliant_anderson &rules = state.rules;
    const int m = GPU_HISTORY, thread = (int)threadIdx.x;
    for (int a = thread; a < KINDS * m; a += DECIDERS) {
        const int kind = a / m, h = a % m;
        double energy = history.gram[h][h] + spring_energy(state, history.step_force[h], history.step_force[h]);
        const bool used = rules.number[h] > 0 && (kind == TRIAL ? rules.mixes : kind == ESTIMATE || state.seen);
        now.scale[kind][h] = used ? pliant_anderson_scale(energy, kind == TRIAL ? rules.largest_secant : INFINITY) : 0;
        const double *along = kind == PAST ? state.past_along : state.along, *force = kind == PAST ? state.past_step_force : state.step_force[state.now];
        double right = now.scale[kind][h] > 0 ? along[h] + spring_energy(state, history.step_force[h], force) : 0;
        state.weights[kind][h] = right * now.scale[kind][h];
    }
    __syncthreads();
    for (int n = thread; n < m * m; n += DECIDERS) {
        const int a = n / m, b = n % m;
        double product = history.gram[a][b] + spring_energy(state, history.step_force[a], history.step_force[b]);
        for (int kind = 0; kind < KINDS; kind++) {
            const double noise = kind == TRIAL ? PLIANT_NOISE_OF_TRIAL : PLIANT_NOISE_OF_ESTIMATE, by = now.scale[kind][a] * now.scale[kind][b];
            now.gram[kind][a][b] = a == b ? 1 + noise * noise : by > 0 ? product * by : 0;
        }
    }
    __syncthreads();
}

/* Cholesky by one warp, a lane a row (GPU_HISTORY is less than 32); false: no weights to be had */
static __device__ bool solve_equations(decision &now, int kind)
{
    gpu_state &state = now.state;
    const int m = GPU_HISTORY, lane = (int)threadIdx.x % 32;
    double(*gram)[GPU_HISTORY] = now.gram[kind];
    double *weights = state.weights[kind], own = lane < m ? weights[lane] : 0;
    bool good = __any_sync(0xffffffff, lane < m && now.scale[kind][lane < m ? lane : 0] > 0);
    for (int c = 0; good && c < m; c++) {
        double pivot = gram[c][c];
        good = pivot > 0; /* the same for all lanes */
        double below = lane >= c && lane < m ? gram[lane][c] / sqrt(pivot) : 0;
        __syncwarp();
        if (lane >= c && lane < m) gram[lane][c] = below;
        __syncwarp();
        for (int b = c + 1; b <= lane && lane < m; b++) gram[lane][b] -= below * gram[b][c];
        __syncwarp();
    }
    for (int c = 0; good && c < m; c++) {
        double known = __shfl_sync(0xffffffff, own, c) / gram[c][c];
        if (lane == c) own = known;
        else if (lane > c && lane < m) own -= gram[lane][c] * known;
    }
    for (int c = m - 1; good && c >= 0; c--) {
        double known = __shfl_sync(0xffffffff, own, c) / gram[c][c];
        if (lane == c) own = known;
        else if (lane < c) own -= gram[c][lane] * known;
    }
    if (lane < m) weights[lane] = good ? own * now.scale[kind][lane] : 0;
    return good;
}

/* a tool's force in the iterate to come; that of a state before is still there */
static __device__ void plan_force(gpu_state &state, const gpu_history &history, int row)
{
    if (state.rules.next == PLIANT_NEXT_PREVIOUS || state.ending) return;
    double step = state.step_force[state.now][row];
    for (int a = 0; a < GPU_HISTORY; a++)
        if (state.weights[TRIAL][a] != 0) step -= state.weights[TRIAL][a] * (history.force[a][row] + history.step_force[a][row]);
    state.force[1 - state.now][row] = state.rules.next == PLIANT_NEXT_REST ? 0 : state.force[state.now][row] + state.rules.damping * step;
}

static __device__ void copy_state(const gpu_state &from, gpu_state &to)
{
    static_assert(sizeof(gpu_state) % sizeof(double) == 0, "copied as doubles");
    for (int n = (int)threadIdx.x; n < (int)(sizeof(gpu_state) / sizeof(double)); n += DECIDERS)
        reinterpret_cast<double *>(&to)[n] = reinterpret_cast<const double *>(&from)[n];
}

static __global__ void __launch_bounds__(DECIDERS) decide_kernel(gpu_iteration iteration, int gather_blocks, int dot_blocks)
{
    __shared__ decision now;
    const int thread = (int)threadIdx.x;
    const bool was_done = iteration.d_state->done;
    __syncthreads();
    if (was_done) return;
    copy_state(*iteration.d_state, now.state);
    __syncthreads();
    add_up(iteration, gather_blocks, dot_blocks, now);
    __syncthreads();
    if (thread == 0) judge(now, iteration.room);
    __syncthreads();
    gpu_history &history = *iteration.d_history;
    if (now.state.rules.keep >= 0) keep_secant(now.state, now.new_row, history);
    __syncthreads();
    fill_equations(now, history);
    if (thread < 32 * KINDS) {
        bool mixed = solve_equations(now, thread / 32);
        if (thread == 0) now.state.mixed = mixed;
    }
    __syncthreads();
    if (thread < GPU_ROWS) plan_force(now.state, history, thread);
    __syncthreads();
    copy_state(now.state, *iteration.d_state);
}

/* The secant and the proposal at one node: what is left, what the proposal moves, and what was left at the state before, in the node's own
 * axes. */
static __device__ void propose_node(const gpu_iteration &iteration, const gpu_state &state, size_t node, double *left, double *made, double *past)
{
    const pliant_anderson &rules = state.rules;
    const size_t n = 3 * (size_t)iteration.num_free, i = 3 * node, x = 3 * (size_t)iteration.d_node_of_free[node];
    const int now = state.now;
    if (rules.keep >= 0) {
        const int from = state.old_now, to = 1 - from;
        const size_t place = n * (size_t)rules.keep + i;
        double moved[3];
        for (int d = 0; d < 3; d++) moved[d] = iteration.d_x[to][x + d] - iteration.d_x[from][x + d];
        turn_into(iteration, node, moved);
        for (int d = 0; d < 3; d++) {
            iteration.d_secant_x[place + d] = moved[d];
            iteration.d_secant_step[place + d] = iteration.d_step[to][i + d] - iteration.d_step[from][i + d];
            iteration.d_secant_residual[place + d] = iteration.d_residual[to][i + d] - iteration.d_residual[from][i + d];
        }
    }
    for (int d = 0; d < 3; d++) {
        left[d] = made[d] = iteration.d_step[now][i + d];
        past[d] = state.seen ? iteration.d_past_step[i + d] : 0;
    }
    for (int a = 0; a < iteration.room; a++) {
        const double by = state.weights[TRIAL][a], likely = state.weights[ESTIMATE][a], then = state.weights[PAST][a];
        if (by == 0 && likely == 0 && then == 0) continue;
        for (int d = 0; d < 3; d++) {
            const size_t place = n * (size_t)a + i + d;
            const double secant = iteration.d_secant_x[place] + iteration.d_secant_step[place];
            made[d] -= by * secant;
            left[d] -= likely * secant;
            past[d] -= then * secant;
        }
    }
    if (rules.next == PLIANT_NEXT_PREVIOUS || state.ending) return; /* it is there; it is kept */
    double out[3] = {made[0], made[1], made[2]};
    turn_out(iteration, node, out);
    for (int d = 0; d < 3; d++)
        iteration.d_x[1 - now][x + d] = rules.next == PLIANT_NEXT_REST ? iteration.d_rest[x + d] : iteration.d_x[now][x + d] + rules.damping * out[d];
}

/* All blocks are done: whether what is left is little enough, or else the blind step, and then its end. */
static __device__ void settle(gpu_state &state)
{
    pliant_anderson &rules = state.rules;
    double largest[4];
    for (int m = 0; m < 4; m++) largest[m] = sqrt(__longlong_as_double((long long)atomicMax(&state.largest[m], 0ull))); /* past the cache */
    if (!state.ending && (rules.next == PLIANT_NEXT_TRIAL || rules.next == PLIANT_NEXT_BLIND || rules.next == PLIANT_NEXT_DONE))
        pliant_anderson_settle(&rules, state.mixed, largest[0], rules.damping * largest[1], largest[2]);
    else if (state.ending && state.evaluated)
        pliant_anderson_settle_end(&rules, largest[0]);
    state.done = state.ending || rules.next == PLIANT_NEXT_DONE;
    if (!state.done) {
        state.ending = rules.next == PLIANT_NEXT_BLIND;
        return;
    }
    state.skips = 1;
    state.evaluated = state.evaluated && state.now == state.last_target;
    pliant_anderson_tell(&rules, state.seen, largest[3], state.step.is_cycle);
}

/* the secant, and the iterate to look at next; one thread a node */
static __global__ void __launch_bounds__(NODES) propose_kernel(gpu_iteration iteration)
{
    __shared__ double most[4][NODES / 32];
    gpu_state &state = *iteration.d_state;
    if (state.done) return;
    const int node = (int)(blockIdx.x * NODES + threadIdx.x), lane = (int)threadIdx.x % 32, warp = (int)threadIdx.x / 32;
    double squares[4] = {0, 0, 0, 0};
    if (node < iteration.num_free) {
        const size_t x = 3 * (size_t)iteration.d_node_of_free[node];
        for (int d = 0; d < 3; d++) {
            double u = iteration.d_x[state.now][x + d] - iteration.d_rest[x + d];
            squares[2] += u * u;
        }
        double left[3], made[3], past[3];
        propose_node(iteration, state, (size_t)node, left, made, past);
        for (int d = 0; d < 3; d++) {
            squares[0] += left[d] * left[d];
            squares[1] += made[d] * made[d];
            squares[3] += past[d] * past[d];
        }
    }
    for (int m = 0; m < 4; m++) {
        /* what is no number is no small one */
        const double largest = warp_largest(isfinite(squares[m]) ? squares[m] : INFINITY);
        if (lane == 0) most[m][warp] = largest;
    }
    __syncthreads();
    if (threadIdx.x > 0) return;
    for (int m = 0; m < 4; m++) {
        double largest = most[m][0];
        for (int w = 1; w < NODES / 32; w++) largest = fmax(largest, most[m][w]);
        atomicMax(&state.largest[m], (unsigned long long)__double_as_longlong(largest)); /* any order gives the same */
    }
    __threadfence();
    if (atomicAdd(&state.blocks, 1ull) + 1 == gridDim.x) settle(state);
}

/* ---- launches */

extern "C" int pliant_cuda_dot_blocks(const gpu_iteration *iteration) { return (iteration->num_free + NODES - 1) / NODES; }

extern "C" pliant_status pliant_cuda_begin(const gpu_iteration *iteration, const gpu_step *step, cudaStream_t stream)
{
    begin_kernel<<<1, THREADS, 0, stream>>>(*iteration, *step);
    return CUDA_LAUNCHED("begin_kernel");
}

extern "C" pliant_status pliant_cuda_complete(const gpu_iteration *iteration, int gather_blocks, cudaStream_t stream)
{
    complete_kernel<<<(unsigned)pliant_cuda_dot_blocks(iteration), NODES, 0, stream>>>(*iteration, gather_blocks);
    return CUDA_LAUNCHED("complete_kernel");
}

extern "C" pliant_status pliant_cuda_decide(const gpu_iteration *iteration, int gather_blocks, cudaStream_t stream)
{
    decide_kernel<<<1, DECIDERS, 0, stream>>>(*iteration, gather_blocks, pliant_cuda_dot_blocks(iteration));
    return CUDA_LAUNCHED("decide_kernel");
}

extern "C" pliant_status pliant_cuda_propose(const gpu_iteration *iteration, cudaStream_t stream)
{
    propose_kernel<<<(unsigned)pliant_cuda_dot_blocks(iteration), NODES, 0, stream>>>(*iteration);
    return CUDA_LAUNCHED("propose_kernel");
}
