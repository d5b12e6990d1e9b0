#include "anderson.h"
#include "check.h"
#include "fem/quasistatic/anderson.h"

enum { THREADS = 256, MOST_REFUSED = 12, MOST_SLOW = 10 };
enum { DECIDERS = 32 * (DOT_SUMS + GATHER_SUMS) }; /* a warp a sum */

static __device__ __forceinline__ int target_of(const gpu_state &state) { return state.iterations == 0 ? state.now : 1 - state.now; }

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

/* step0 = T left at one unknown node */
static __device__ __forceinline__ void turned_left(const gpu_iteration &iteration, size_t node, double *out)
{
    const double *turn = iteration.d_turn + 9 * node;
    const float *left = iteration.d_left + 3 * node;
    for (int r = 0; r < 3; r++) out[r] = turn[3 * r] * left[0] + turn[3 * r + 1] * left[1] + turn[3 * r + 2] * left[2];
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
        state.done = state.iterations = state.rejected = state.accepted = 0;
        state.remember = -1;
        state.propose = PLAN_NOTHING;
        state.before = INFINITY;
        if (step.forget) state.num_history = state.next_history = 0;
        state.rows = rows;
        for (int r = 0; r < rows; r++) state.row_of[r] = row_of[r];
    }
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
            double at[3];
            turned_left(iteration, unknown, at);
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

/* step = T left + Z dl at one node; pull += W' dl */
static __device__ void finish_node(const gpu_iteration &iteration, const gpu_state &state, const spring_share &share, int target, size_t node,
                                   double *step, double *pull)
{
    const size_t n = 3 * (size_t)iteration.num_free, i = 3 * node;
    turned_left(iteration, node, step);
    for (int row = 0; row < state.rows; row++) {
        int at = state.row_of[row];
        const double *z = state.step.tools[at / 3].d_response + n * (size_t)(at % 3) + i;
        for (int d = 0; d < 3; d++) step[d] += share.force[at] * z[d];
    }
    for (int d = 0; d < 3; d++) {
        pull[d] = iteration.d_pull[target][i + d] + share.pull[threadIdx.x][d];
        if (state.rows > 0) iteration.d_pull[target][i + d] = pull[d];
        iteration.d_step[target][i + d] = step[d];
    }
}

/* The step complete, and its products: with its own pull, crosswise with the present iterate's, secants' with its pull; the
 * largest nodal residual. One thread a node. */
static __global__ void __launch_bounds__(NODES) complete_kernel(gpu_iteration iteration, int gather_blocks)
{
    __shared__ spring_share share;
    __shared__ double sums[NODES / 32][DOT_SUMS];
    gpu_state &state = *iteration.d_state;
    if (state.done) return;
    const int thread = (int)threadIdx.x, warp = thread / 32, lane = thread % 32, target = target_of(state), now = state.now;
    const int node = (int)(blockIdx.x * NODES) + thread, num_sums = 4 + state.num_history;
    const size_t n = 3 * (size_t)iteration.num_free, i = 3 * (size_t)node;
    const bool there = node < iteration.num_free;
    for (int d = 0; d < 3; d++) share.pull[thread][d] = 0;
    if (thread < GPU_ROWS) share.force[thread] = 0;
    __syncthreads();
    find_spring_forces(iteration, state, target, share);
    find_spring_pull(state, node - thread, share);
    if (blockIdx.x == 0 && thread < GPU_ROWS) state.step_force[target][thread] = share.force[thread];
    double step[3] = {0, 0, 0}, pull[3] = {0, 0, 0}, own = 0, by_now = 0, of_now = 0;
    if (there) {
        finish_node(iteration, state, share, target, (size_t)node, step, pull);
        for (int d = 0; d < 3; d++) {
            own += step[d] * pull[d];
            if (now == target) continue;
            by_now += step[d] * iteration.d_pull[now][i + d];
            of_now += iteration.d_step[now][i + d] * pull[d];
        }
    }
    own = warp_sum(own);
    by_now = warp_sum(by_now);
    of_now = warp_sum(of_now);
    double largest = warp_largest(sqrt(pull[0] * pull[0] + pull[1] * pull[1] + pull[2] * pull[2]));
    if (lane == 0) {
        sums[warp][0] = own;
        sums[warp][1] = by_now;
        sums[warp][2] = of_now;
        sums[warp][3] = largest;
    }
    for (int a = 0; a < num_sums - 4; a++) {
        double along = 0;
        if (there) {
            const double *secant = iteration.d_secant_step + n * (size_t)a + i;
            along = secant[0] * pull[0] + secant[1] * pull[1] + secant[2] * pull[2];
        }
        along = warp_sum(along);
        if (lane == 0) sums[warp][4 + a] = along;
    }
    __syncthreads();
    if (thread >= num_sums) return;
    double sum = sums[0][thread];
    for (int w = 1; w < NODES / 32; w++) sum = thread == 3 ? fmax(sum, sums[w][thread]) : sum + sums[w][thread];
    iteration.d_sums[GATHER_SUMS * gather_blocks + (size_t)gridDim.x * (size_t)thread + blockIdx.x] = sum;
}

/* ---- decisions: one block, on a copy of the state in shared memory */

struct decision {
    gpu_state state;
    double sums[DOT_SUMS], work[GATHER_SUMS];
    double new_row[GPU_HISTORY], gram[GPU_HISTORY][GPU_HISTORY], scale[GPU_HISTORY];
    int plan; /* PLAN_... */
    bool mixes;
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
    const int s = (int)threadIdx.x / 32;
    double sum = 0;
    if (s >= DOT_SUMS) {
#pragma unroll 16
        for (int b = lane; b < gather_blocks; b += 32) sum += iteration.d_sums[gather_blocks * (s - DOT_SUMS) + b];
    } else if (s < 4 + now.state.num_history) {
#pragma unroll 16
        for (int b = lane; b < dot_blocks; b += 32) {
            double part = dots[(size_t)dot_blocks * s + b];
            sum = s == 3 ? fmax(sum, part) : sum + part;
        }
    }
    sum = s == 3 ? warp_largest(sum) : warp_sum(sum);
    if (lane == 0) *(s < DOT_SUMS ? now.sums + s : now.work + s - DOT_SUMS) = sum;
}

/* What the refused or the accepted trial taught; its row of products to new_row. */
static __device__ void remember(decision &now, bool accepted)
{
    gpu_state &state = now.state;
    const int place = state.next_history, depth = state.step.depth;
    const double *along_trial = now.sums + 4;
    for (int a = 0; a < state.num_history; a++) now.new_row[a] = along_trial[a] - state.along[a];
    const double own = now.sums[0], by_now = now.sums[1], of_now = now.sums[2];
    now.new_row[place] = own - by_now - of_now + state.energy;
    if (accepted)
        for (int a = 0; a < state.num_history; a++) state.along[a] = along_trial[a];
    state.along[place] = accepted ? own - of_now : by_now - state.energy;
    state.remember = place;
    state.next_history = (place + 1) % depth;
    if (state.num_history < depth) state.num_history++;
}

/* the first evaluation of a step; true: the state that was left in the last one is to be looked at, too */
static __device__ bool judge_first(decision &now)
{
    const double too_high = 2;
    gpu_state &state = now.state;
    state.energy = now.sums[0];
    for (int a = 0; a < state.num_history; a++) state.along[a] = now.sums[4 + a];
    bool suspect = state.ahead && !(state.merit[state.now] < too_high * state.first_merit);
    state.ahead = 0;
    state.first_merit = state.merit[state.now];
    return suspect;
}

/* the better of the present state and the one that was left */
static __device__ void judge_left(decision &now)
{
    gpu_state &state = now.state;
    const int left = 1 - state.now;
    if (!(state.merit[left] < state.merit[state.now])) return;
    state.now = left;
    state.energy = now.sums[0];
    state.num_history = state.next_history = 0;
    state.first_merit = state.merit[left];
}

/* the body at rest, where nothing led on from the present state */
static __device__ void judge_rest(decision &now)
{
    gpu_state &state = now.state;
    const int rest = 1 - state.now;
    if (!(state.merit[rest] < state.merit[state.now])) return;
    state.now = rest;
    state.num_history = state.next_history = 0;
}

static __device__ void judge_trial(decision &now)
{
    gpu_state &state = now.state;
    const int old = state.now, trial = 1 - old;
    bool accepted = state.merit[trial] < state.merit[old];
    if ((accepted || state.refused < 2) && state.step.depth > 0 && isfinite(state.merit[trial])) remember(now, accepted);
    if (accepted) {
        state.before = state.merit[old];
        state.energy = now.sums[0];
        state.now = trial;
        state.refused = 0;
        state.accepted = 1;
    } else {
        state.refused++;
        state.rejected++;
    }
}

/* No more trials. false: the body at rest is to be looked at, too (start_from_rest of the CPU). */
static __device__ bool finish(gpu_state &state)
{
    const double slow = 0.9;
    const int steps = state.iterations - 1;
    state.rate = steps > 0 && state.first_merit > 0 ? pow(state.merit[state.now] / state.first_merit, 1.0 / steps) : 0;
    state.slow = state.rate > slow ? state.slow + 1 : 0;
    if (state.accepted) state.refused = 0;
    const bool stuck = state.refused >= MOST_REFUSED || state.slow == MOST_SLOW;
    if (stuck) state.refused = state.slow = 0;
    state.done = !stuck;
    return !stuck;
}

static __device__ void find_merit(decision &now)
{
    gpu_state &state = now.state;
    const int target = target_of(state);
    state.scale[target] = fmax(sqrt(fmax(fabs(now.work[0]), fabs(now.work[1]))), state.step.smallest_scale);
    double energy = now.sums[0] + spring_energy(state, state.step_force[target], state.step_force[target]);
    state.merit[target] = state.singular ? INFINITY : pliant_anderson_merit(energy, state.scale[target]);
    state.residual_force[target] = now.sums[3];
}

/* accept or refuse; whether to go on, and how */
static __device__ void judge(decision &now)
{
    const double went_well = 0.5; /* merit over the merit before */
    gpu_state &state = now.state;
    find_merit(now);
    state.old_now = state.now;
    state.remember = -1;
    state.damping = 1;
    now.mixes = false;
    now.plan = PLAN_NOTHING;
    const int looked_at = state.propose;
    bool look_back = false;
    if (state.iterations == 0) look_back = judge_first(now);
    else if (looked_at == PLAN_LEFT) judge_left(now);
    else if (looked_at == PLAN_REST) judge_rest(now);
    else judge_trial(now);
    state.iterations++;
    if (look_back) {
        now.plan = PLAN_LEFT;
        return;
    }
    if (looked_at == PLAN_REST) {
        state.done = 1;
        return;
    }
    const double merit = state.merit[state.now];
    bool far = merit > state.step.tolerance * state.scale[state.now];
    if (far && state.iterations < state.step.max_iterations && state.refused < MOST_REFUSED) {
        if (state.refused == 2) state.num_history = state.next_history = 0;
        now.plan = PLAN_TRIAL;
        now.mixes = state.refused < 2 && state.num_history > 0;
        state.damping = state.refused < 3 ? 1 : ldexp(1.0, 2 - state.refused);
        return;
    }
    const bool went_on = state.refused == 0;
    if (!finish(state)) {
        now.plan = PLAN_REST;
        return;
    }
    state.ahead = far && went_on && isfinite(merit) && merit < went_well * state.before;
    now.plan = state.ahead ? PLAN_LAST : PLAN_NOTHING;
    now.mixes = state.ahead && state.num_history > 0;
}

/* the secant's part in the history, as remember() planned it */
static __device__ void keep_secant(const gpu_state &state, const double *new_row, gpu_history &history)
{
    const int place = state.remember, thread = (int)threadIdx.x, from = state.old_now, to = 1 - from;
    if (thread < GPU_ROWS) {
        history.force[place][thread] = state.force[to][thread] - state.force[from][thread];
        history.step_force[place][thread] = state.step_force[to][thread] - state.step_force[from][thread];
    }
    if (thread < state.num_history) history.gram[thread][place] = history.gram[place][thread] = new_row[thread];
}

/* The weights that make the step smallest in the energy norm: the normal equations, scaled to a unit diagonal. */
static __device__ void fill_equations(decision &now, const gpu_history &history)
{
    gpu_state &state = now.state;
    const int m = state.num_history, thread = (int)threadIdx.x;
    for (int n = thread; n < m * m; n += DECIDERS)
        now.gram[n / m][n % m] = history.gram[n / m][n % m] + spring_energy(state, history.step_force[n / m], history.step_force[n % m]);
    if (thread < m) state.weights[thread] = state.along[thread] + spring_energy(state, history.step_force[thread], state.step_force[state.now]);
    __syncthreads();
    if (thread < m) now.scale[thread] = now.gram[thread][thread] > 0 ? 1 / sqrt(now.gram[thread][thread]) : 0;
    __syncthreads();
    for (int n = thread; n < m * m; n += DECIDERS)
        now.gram[n / m][n % m] = n / m == n % m ? 1 + 1e-10 : now.gram[n / m][n % m] * now.scale[n / m] * now.scale[n % m];
    if (thread < m) state.weights[thread] *= now.scale[thread];
    __syncthreads();
}

/* Cholesky by one warp, a lane a row (GPU_HISTORY is less than 32); false: no weights to be had */
static __device__ bool solve_equations(decision &now)
{
    gpu_state &state = now.state;
    const int m = state.num_history, lane = (int)threadIdx.x;
    double(*gram)[GPU_HISTORY] = now.gram;
    if (!__any_sync(0xffffffff, lane < m && now.scale[lane < m ? lane : 0] > 0)) return false;
    double own = lane < m ? state.weights[lane] : 0;
    for (int c = 0; c < m; c++) {
        double pivot = gram[c][c];
        if (!(pivot > 0)) return false; /* the same for all lanes */
        double below = lane >= c && lane < m ? gram[lane][c] / sqrt(pivot) : 0;
        __syncwarp();
        if (lane >= c && lane < m) gram[lane][c] = below;
        __syncwarp();
        for (int b = c + 1; b <= lane && lane < m; b++) gram[lane][b] -= below * gram[b][c];
        __syncwarp();
    }
    for (int c = 0; c < m; c++) {
        double known = __shfl_sync(0xffffffff, own, c) / gram[c][c];
        if (lane == c) own = known;
        else if (lane > c && lane < m) own -= gram[lane][c] * known;
    }
    for (int c = m - 1; c >= 0; c--) {
        double known = __shfl_sync(0xffffffff, own, c) / gram[c][c];
        if (lane == c) own = known;
        else if (lane < c) own -= gram[c][lane] * known;
    }
    if (lane < m) state.weights[lane] = own * now.scale[lane];
    return true;
}

/* a tool's force in the iterate to come */
static __device__ void plan_force(gpu_state &state, const gpu_history &history, int what, int row)
{
    if (what == PLAN_LEFT || what == PLAN_REST) {
        state.force[1 - state.now][row] = what == PLAN_LEFT ? state.left_force[row] : 0;
        return;
    }
    if (what == PLAN_LAST) state.left_force[row] = state.force[state.now][row];
    double step = state.step_force[state.now][row];
    for (int a = 0; a < state.num_weights; a++) step -= state.weights[a] * (history.force[a][row] + history.step_force[a][row]);
    state.force[what == PLAN_LAST ? state.now : 1 - state.now][row] = state.force[state.now][row] + state.damping * step;
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
    if (was_done) {
        if (thread == 0) {
            iteration.d_state->propose = PLAN_NOTHING;
            iteration.d_state->remember = -1;
        }
        return;
    }
    copy_state(*iteration.d_state, now.state);
    __syncthreads();
    add_up(iteration, gather_blocks, dot_blocks, now);
    __syncthreads();
    if (thread == 0) judge(now);
    __syncthreads();
    gpu_history &history = *iteration.d_history;
    if (now.state.remember >= 0) keep_secant(now.state, now.new_row, history);
    __syncthreads();
    if (now.mixes) fill_equations(now, history);
    if (thread < 32) {
        bool mixed = now.mixes && solve_equations(now);
        if (thread == 0) {
            now.state.propose = now.plan;
            now.state.num_weights = mixed ? now.state.num_history : 0;
        }
        __syncwarp();
        if (now.plan != PLAN_NOTHING && thread < GPU_ROWS) plan_force(now.state, history, now.plan, thread);
    }
    __syncthreads();
    copy_state(now.state, *iteration.d_state);
}

/* the secant, and the iterate to look at next */
static __global__ void __launch_bounds__(THREADS) propose_kernel(gpu_iteration iteration)
{
    const gpu_state &state = *iteration.d_state;
    const int thread = (int)(blockIdx.x * THREADS + threadIdx.x);
    const size_t n = 3 * (size_t)iteration.num_free, i = (size_t)thread;
    if (i >= n || (state.propose == PLAN_NOTHING && state.remember < 0)) return;
    const size_t x = 3 * (size_t)iteration.d_node_of_free[thread / 3] + (size_t)(thread % 3);
    if (state.remember >= 0) {
        const int from = state.old_now, to = 1 - from;
        const size_t place = n * (size_t)state.remember + i;
        iteration.d_secant_x[place] = iteration.d_x[to][x] - iteration.d_x[from][x];
        iteration.d_secant_step[place] = iteration.d_step[to][i] - iteration.d_step[from][i];
        iteration.d_secant_pull[place] = iteration.d_pull[to][i] - iteration.d_pull[from][i];
    }
    if (state.propose == PLAN_NOTHING) return;
    const int now = state.now;
    if (state.propose == PLAN_LEFT || state.propose == PLAN_REST) {
        iteration.d_x[1 - now][x] = state.propose == PLAN_LEFT ? iteration.d_left_x[x] : iteration.d_rest[x];
        return;
    }
    double step = iteration.d_step[now][i];
    for (int a = 0; a < state.num_weights; a++) {
        const size_t place = n * (size_t)a + i;
        step -= state.weights[a] * (iteration.d_secant_x[place] + iteration.d_secant_step[place]);
    }
    const double from = iteration.d_x[now][x];
    if (state.propose == PLAN_LAST) iteration.d_left_x[x] = from;
    iteration.d_x[state.propose == PLAN_LAST ? now : 1 - now][x] = from + state.damping * step;
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
    propose_kernel<<<(unsigned)((3 * iteration->num_free + THREADS - 1) / THREADS), THREADS, 0, stream>>>(*iteration);
    return CUDA_LAUNCHED("propose_kernel");
}
