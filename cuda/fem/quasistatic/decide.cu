/* Decisions after an evaluation, by one block, on a copy of the state in shared memory. */
#include "cuda/fem/quasistatic/anderson.h"
#include "cuda/fem/quasistatic/pressures.h"
#include "cuda/base/check.h"
#include "fem/quasistatic/secant_equations.h"
#include "cuda/base/warp_sum.cuh"

/* One warp per sum, except in a step's first evaluation. */
enum { DECIDERS = 32 * (SINGLE_SUMS + PLIANT_MAX_HISTORY + GATHER_SUMS) };

enum { TRIAL, ESTIMATE, PAST, KINDS }; /* kinds of weights */

struct decision {
    gpu_state state;
    gpu_secants secants;
    double sums[DOT_SUMS], work[GATHER_SUMS];
    double of_pressures; /* part of the pressures in products 1 and 2, which the sums do not contain */
    double new_row[GPU_HISTORY], along[KINDS][GPU_HISTORY];
    pliant_secant_equations equations[KINDS];
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

/* Sum over blocks, one warp per sum, in a fixed order. Unused sums are undefined. */
static __device__ void add_up(const gpu_iteration &iteration, int gather_blocks, int dot_blocks, decision &now)
{
    const int lane = (int)threadIdx.x % 32, num_dots = SINGLE_SUMS + 2 * iteration.capacity;
    const double *dots = iteration.d_sums + GATHER_SUMS * gather_blocks;
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

/* Add the pressures' part of the products, in the same way. Sums 1 and 2 stay without it: the potential energy has no
 * such part, and sum 2 is its slope. */
static __device__ void add_pressures(const gpu_pressures &pressures, int capacity, int blocks, decision &now)
{
    const int lane = (int)threadIdx.x % 32, sums = PRESSURE_SECANTS + (gpu_looks_back(&now.state) ? 2 : 1) * capacity;
    for (int s = (int)threadIdx.x / 32; s < sums; s += DECIDERS / 32) {
        if (s >= PRESSURE_SECANTS && now.state.rules.number[(s - PRESSURE_SECANTS) % capacity] == 0) continue;
        double sum = 0;
#pragma unroll 8
        for (int b = lane; b < blocks; b += 32) sum += pressures.d_sums[(size_t)blocks * s + b];
        sum = warp_sum(sum);
        if (lane > 0) continue;
        if (s == PRESSURE_NOW) now.of_pressures = sum;
        else now.sums[s == PRESSURE_OWN ? 0 : s == PRESSURE_PAST ? 4 : SINGLE_SUMS + s - PRESSURE_SECANTS] += sum;
    }
}

/* Compute the products of the secant from the present iterate to the evaluated state in new_row. */
static __device__ void find_products(decision &now)
{
    gpu_state &state = now.state;
    const int place = state.rules.secant_slot;
    double *along_trial = now.sums + SINGLE_SUMS;
    for (int a = 0; a < GPU_HISTORY; a++)
        now.new_row[a] = state.rules.number[a] > 0 ? along_trial[a] - state.along[a] : 0;
    const double own = now.sums[0], by_now = now.sums[1] + now.of_pressures, of_now = now.sums[2] + now.of_pressures;
    now.new_row[place] = own - by_now - of_now + state.energy;
    /* Secant . residual, of the iterate that stays or of the accepted one. */
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

/* Accept or refuse the state and choose the next action, with anderson.h, as in solver.c. */
static __device__ void judge(decision &now, int capacity)
{
    gpu_state &state = now.state;
    pliant_anderson &rules = state.rules;
    const bool first = rules.next == PLIANT_NEXT_FIRST;
    const int target = gpu_target(&state);
    const double merit = find_merit(now, target);
    const int32_t left =
        pliant_evaluations_left(&state.step.limit, rules.evaluations + 1, first ? merit : rules.first_merit);
    const bool plain = !rules.uses_secants && state.rows == 0 && !state.step.has_contacts &&
                       (rules.next == PLIANT_NEXT_TRIAL || rules.next == PLIANT_NEXT_DESCENT);
    state.evaluated = 1;
    if (state.evaluates_end) state.evaluated = pliant_anderson_judge_end(&rules, merit);
    else pliant_anderson_judge(&rules, merit, plain ? now.sums[2] : 0.0, left);
    if (rules.next == PLIANT_NEXT_PREVIOUS) state.restored_previous = 1;
    state.was_accepted = !state.evaluates_end && (rules.accepts_state || first); /* the state's contact forces */
    state.iterations = rules.evaluations;
    state.skips = 0;
    state.last_target = target;
    state.old_now = state.now;
    if (rules.secant_slot >= 0) find_products(now);
    if (rules.accepts_state || first) {
        state.now = target;
        state.energy = now.sums[0];
        state.past_of_now = now.sums[4];
        for (int a = 0; a < capacity; a++) state.along[a] = now.sums[SINGLE_SUMS + a];
    }
    for (int a = 0; first && state.start_is_evaluated && a < capacity; a++)
        state.past_along[a] = now.sums[SINGLE_SUMS + capacity + a];
    if (!state.evaluates_end) {
        state.accepted_scale = state.scale[state.now];
        state.accepted_residual_force = state.residual_force[state.now];
    }
    for (int m = 0; m < 4; m++) state.largest[m] = 0;
    state.blocks = 0;
}

/* Store the secant's spring forces in the history, one thread per row, and then its products, one thread per secant. */
static __device__ void keep_springs(decision &now, gpu_secants &kept)
{
    const gpu_state &state = now.state;
    const int place = state.rules.secant_slot, thread = (int)threadIdx.x, from = state.old_now, to = 1 - from;
    if (thread >= GPU_ROWS) return;
    kept.force[place][thread] = now.secants.force[place][thread] = state.force[to][thread] - state.force[from][thread];
    kept.step_force[place][thread] = now.secants.step_force[place][thread] =
        state.step_force[to][thread] - state.step_force[from][thread];
}
static __device__ void keep_products(decision &now, gpu_secants &kept)
{
    const int place = now.state.rules.secant_slot, h = (int)threadIdx.x;
    if (h >= GPU_HISTORY) return;
    const double product =
        now.new_row[h] + spring_energy(now.state, now.secants.step_force[place], now.secants.step_force[h]);
    const int one = place * GPU_HISTORY + h, other = h * GPU_HISTORY + place;
    kept.gram[one] = kept.gram[other] = now.secants.gram[one] = now.secants.gram[other] = product;
}

/* Compute the weights of one kind, with one warp (GPU_HISTORY is less than 32). Return false if there are none. */
static __device__ bool find_weights(decision &now, int kind)
{
    const gpu_state &state = now.state;
    const int h = (int)threadIdx.x % 32;
    const bool previous = kind == TRIAL ? state.rules.uses_secants
                                        : kind == ESTIMATE || state.start_is_evaluated; /* the same for all lanes */
    if (h < GPU_HISTORY) {
        const double *along = kind == PAST ? state.past_along : state.along,
                     *force = kind == PAST ? state.past_step_force : state.step_force[state.now];
        now.along[kind][h] = along[h] + spring_energy(state, now.secants.step_force[h], force);
        now.state.weights[kind][h] = 0;
    }
    __syncwarp();
    return previous && pliant_secant_weights(h, 32, &state.rules, now.secants.gram, now.along[kind], kind != TRIAL,
                                             now.equations + kind, now.state.weights[kind]);
}

/* Set a tool's force in the next iterate. A restored state has its force already. */
static __device__ void plan_force(gpu_state &state, const gpu_secants &secants, int row)
{
    if (state.rules.next == PLIANT_NEXT_PREVIOUS || state.evaluates_end) return;
    double step = state.step_force[state.now][row];
    for (int a = 0; a < GPU_HISTORY; a++)
        if (state.weights[TRIAL][a] != 0)
            step -= state.weights[TRIAL][a] * (secants.force[a][row] + secants.step_force[a][row]);
    state.force[1 - state.now][row] =
        state.rules.next == PLIANT_NEXT_REST ? 0 : state.force[state.now][row] + state.rules.damping * step;
}

template <class T> static __device__ void copy(const T &from, T &to)
{
    static_assert(sizeof(T) % sizeof(double) == 0, "copied as doubles");
    for (int n = (int)threadIdx.x; n < (int)(sizeof(T) / sizeof(double)); n += DECIDERS)
        reinterpret_cast<double *>(&to)[n] = reinterpret_cast<const double *>(&from)[n];
}

static __global__ void __launch_bounds__(DECIDERS)
    decide_kernel(gpu_iteration iteration, int gather_blocks, int dot_blocks, int pressure_blocks)
{
    __shared__ decision now;
    const int thread = (int)threadIdx.x;
    gpu_secants &kept = iteration.d_history->secants;
    copy(*iteration.d_state, now.state);
    copy(kept, now.secants);
    add_up(iteration, gather_blocks, dot_blocks, now);
    if (thread == 0) now.of_pressures = 0;
    __syncthreads();
    if (now.state.done) return;
    if (pressure_blocks > 0) {
        add_pressures(iteration.pressures, iteration.capacity, pressure_blocks, now);
        __syncthreads();
    }
    if (thread == 0) judge(now, iteration.capacity);
    __syncthreads();
    if (now.state.rules.secant_slot >= 0) keep_springs(now, kept);
    __syncthreads();
    if (now.state.rules.secant_slot >= 0) keep_products(now, kept);
    __syncthreads();
    if (thread < 32 * KINDS) {
        bool mixed = find_weights(now, thread / 32);
        if (thread == 0) now.state.mixed = mixed;
    }
    __syncthreads();
    if (thread < GPU_ROWS) plan_force(now.state, now.secants, thread);
    __syncthreads();
    copy(now.state, *iteration.d_state);
}

pliant_status pliant_cuda_decide(const gpu_iteration *iteration, int gather_blocks, cudaStream_t stream)
{
    decide_kernel<<<1, DECIDERS, 0, stream>>>(*iteration, gather_blocks, pliant_cuda_dot_blocks(iteration),
                                              pliant_cuda_pressure_blocks(&iteration->pressures));
    return CUDA_LAUNCHED("decide_kernel");
}
