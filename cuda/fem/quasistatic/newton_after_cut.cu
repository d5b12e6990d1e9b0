/* The first step after a cut on the GPU, as in src/fem/quasistatic/newton_after_cut.c. Vectors stay on the GPU; the
 * host decides from a few numbers. The state must be fresh: it is in the first buffer, without known quantities, and no
 * step is running. With contact points there is no Newton step. */
#include "cuda/fem/quasistatic/axes.cuh"
#include "cuda/base/check.h"
#include "cuda/base/launch.h"
#include "base/dense.h"
#include "fem/quasistatic/newton_rules.h"
#include "cuda/fem/element/forces.h"
#include "cuda/fem/quasistatic/solver.h"
#include "cuda/base/warp_sum.cuh"

#include <cmath>
#include <cstring>

enum { THREADS = 128, WARPS = THREADS / 32, NEWTON_SUMS = 2 };

/* The vectors (3 num_free), in the nodes' axes, in arrays that a fresh state does not use. */
struct newton_vectors { double *d_elastic, *d_left, *d_along, *d_correction, *d_pulled, *d_step; };

static newton_vectors vectors_of(const gpu_iteration *it)
{
    return {it->d_past_residual, it->d_residual[1], it->d_step[1], it->d_past_step, it->d_free_residual, it->d_step[0]};
}

/* ---- Kernels with one thread per node. */

static __device__ __forceinline__ void elastic_at(const gpu_system &system, const double *d_element_force, int n,
                                                  double *out)
{
    for (int d = 0; d < 3; d++) out[d] = 0;
    for (int c = system.d_corner_start[n]; c < system.d_corner_end[n]; c++)
        for (int d = 0; d < 3; d++) out[d] += d_element_force[4 * (size_t)system.d_corner[c] + d];
}

/* Store a sum and a maximum of each block. */
static __device__ void keep_sums(double own, double largest, double *d_sums)
{
    __shared__ double sums[NEWTON_SUMS][WARPS];
    own = warp_sum(own);
    largest = warp_largest(largest);
    if (threadIdx.x % 32 == 0) {
        sums[0][threadIdx.x / 32] = own;
        sums[1][threadIdx.x / 32] = largest;
    }
    __syncthreads();
    if (threadIdx.x > 0) return;
    for (int w = 1; w < WARPS; w++) {
        sums[0][0] += sums[0][w];
        sums[1][0] = fmax(sums[1][0], sums[1][w]);
    }
    for (int s = 0; s < NEWTON_SUMS; s++) d_sums[NEWTON_SUMS * (size_t)blockIdx.x + s] = sums[s][0];
}

enum open_mode { RESIDUAL, PRODUCT, SLOPE };

/* RESIDUAL: compute elastic forces, and left = T' (load - elastic).
 * PRODUCT: pulled = T' (elastic at the trial - elastic) / fraction, and along . pulled.
 * SLOPE: correction . T' (load - elastic at the trial). */
template <open_mode MODE>
static __global__ void __launch_bounds__(THREADS)
    open_kernel(gpu_system system, gpu_iteration it, newton_vectors at, double fraction, double *d_sums)
{
    const int n = (int)(blockIdx.x * THREADS + threadIdx.x);
    double own = 0;
    if (n < it.num_free) {
        const size_t first = 3 * (size_t)n;
        double v[3];
        elastic_at(system, it.d_element_force, n, v);
        for (int d = 0; d < 3; d++) {
            if (MODE == RESIDUAL) at.d_elastic[first + d] = v[d];
            v[d] = MODE == PRODUCT ? (v[d] - at.d_elastic[first + d]) / fraction : it.d_load[first + d] - v[d];
        }
        turn_into(it, (size_t)n, v);
        for (int d = 0; d < 3; d++) {
            if (MODE != SLOPE) (MODE == RESIDUAL ? at.d_left : at.d_pulled)[first + d] = v[d];
            if (MODE != RESIDUAL) own += (MODE == PRODUCT ? at.d_along : at.d_correction)[first + d] * v[d];
        }
    }
    if (MODE != RESIDUAL) keep_sums(own, 0, d_sums);
}

/* Compute to = from + share T v. */
static __global__ void __launch_bounds__(THREADS)
    open_place_kernel(gpu_iteration it, const double *d_v, double fraction, const double *d_from, double *d_to)
{
    const int n = (int)(blockIdx.x * THREADS + threadIdx.x);
    if (n >= it.num_free) return;
    double step[3] = {d_v[3 * (size_t)n], d_v[3 * (size_t)n + 1], d_v[3 * (size_t)n + 2]};
    const size_t x = 3 * (size_t)it.d_node_of_free[n];
    turn_out(it, (size_t)n, step);
    for (int d = 0; d < 3; d++) d_to[x + d] = d_from[x + d] + fraction * step[d];
}

/* Compute correction += fraction along, left -= fraction pulled, and the preconditioner's input. */
static __global__ void __launch_bounds__(THREADS)
    open_advance_kernel(gpu_iteration it, newton_vectors at, double fraction)
{
    const int n = (int)(blockIdx.x * THREADS + threadIdx.x);
    if (n >= it.num_free) return;
    for (size_t i = 3 * (size_t)n; i < 3 * (size_t)n + 3; i++) {
        if (fraction != 0) {
            at.d_correction[i] += fraction * at.d_along[i];
            at.d_left[i] -= fraction * at.d_pulled[i];
        }
        it.d_right[i] = (float)at.d_left[i];
    }
}

struct newton_pulls { int count; const double *d_response[GPU_TOOLS]; double force[GPU_ROWS]; };

/* Compute step = (preconditioner's output) + T' Z dl, left . step, and the squared maximum over the nodes. */
static __global__ void __launch_bounds__(THREADS)
    open_step_kernel(gpu_iteration it, newton_vectors at, newton_pulls pulls, double *d_sums)
{
    const int n = (int)(blockIdx.x * THREADS + threadIdx.x);
    const size_t all = 3 * (size_t)it.num_free, i = 3 * (size_t)n;
    double own = 0, square = 0;
    if (n < it.num_free) {
        double moved[3] = {0, 0, 0};
        for (int r = 0; r < 3 * pulls.count; r++)
            for (int d = 0; d < 3; d++)
                moved[d] += pulls.force[r] * pulls.d_response[r / 3][all * (size_t)(r % 3) + i + d];
        turn_into(it, (size_t)n, moved);
        for (int d = 0; d < 3; d++) {
            const double step = it.d_left[i + d] + moved[d];
            at.d_step[i + d] = step;
            own += at.d_left[i + d] * step;
            square += step * step;
        }
    }
    keep_sums(own, square, d_sums);
}

/* Compute along = step + turned along. */
static __global__ void __launch_bounds__(THREADS)
    open_combine_kernel(gpu_iteration it, newton_vectors at, double previous_weight)
{
    const size_t i = (size_t)blockIdx.x * THREADS + threadIdx.x;
    if (i < 3 * (size_t)it.num_free)
        at.d_along[i] = previous_weight != 0 ? at.d_step[i] + previous_weight * at.d_along[i] : at.d_step[i];
}

static __global__ void __launch_bounds__(THREADS)
    open_longest_kernel(gpu_iteration it, const double *d_v, double *d_sums)
{
    const int n = (int)(blockIdx.x * THREADS + threadIdx.x);
    const double *v = d_v + 3 * (size_t)n;
    keep_sums(0, n < it.num_free ? v[0] * v[0] + v[1] * v[1] + v[2] * v[2] : 0, d_sums);
}

/* ---- Kernels of a tool, one thread per held node. */

/* Compute v += share T' W' force. */
static __global__ void __launch_bounds__(THREADS)
    open_pull_kernel(gpu_iteration it, gpu_tool tool, double x, double y, double z, double *d_v)
{
    const int h = (int)(blockIdx.x * THREADS + threadIdx.x);
    if (h >= tool.count) return;
    const size_t node = (size_t)tool.d_unknown[h];
    const double *block = tool.d_block + 9 * (size_t)h;
    double pull[3];
    for (int c = 0; c < 3; c++) pull[c] = block[c] * x + block[3 + c] * y + block[6 + c] * z;
    turn_into(it, node, pull);
    for (int c = 0; c < 3; c++) d_v[3 * node + c] += pull[c];
}

/* Compute W v with one block. turns: v is in the nodes' axes. */
template <class T>
static __global__ void __launch_bounds__(THREADS)
    open_moved_kernel(gpu_iteration it, gpu_tool tool, const T *d_v, bool turns, double *d_out)
{
    __shared__ double sums[WARPS][3];
    double moved[3] = {0, 0, 0};
    for (int h = (int)threadIdx.x; h < tool.count; h += THREADS) {
        const size_t node = (size_t)tool.d_unknown[h];
        const double *block = tool.d_block + 9 * (size_t)h;
        double v[3] = {d_v[3 * node], d_v[3 * node + 1], d_v[3 * node + 2]};
        if (turns) turn_out(it, node, v);
        for (int r = 0; r < 3; r++) moved[r] += block[3 * r] * v[0] + block[3 * r + 1] * v[1] + block[3 * r + 2] * v[2];
    }
    for (int r = 0; r < 3; r++) {
        moved[r] = warp_sum(moved[r]);
        if (threadIdx.x % 32 == 0) sums[threadIdx.x / 32][r] = moved[r];
    }
    __syncthreads();
    if (threadIdx.x > 2) return;
    double sum = 0;
    for (int w = 0; w < WARPS; w++) sum += sums[w][threadIdx.x];
    d_out[threadIdx.x] = sum;
}

/* ---- On the host. */

struct opening {
    pliant_cuda_solver *gpu;
    pliant_solver *solver;
    const gpu_step *step;
    newton_vectors at;
    unsigned blocks;
    int num_springs, spring[GPU_TOOLS];
    double factor[GPU_ROWS * GPU_ROWS];                                     /* Cholesky factor of S */
    /* Forces of springs: of the step so far, of the present direction, of the next direction. */
    double pulls[GPU_ROWS], pulls_along[GPU_ROWS], pulls_next[GPU_ROWS];
    double norm, longest, energy; /* longest: maximum of along over the nodes; energy: residual . correction [J] */
};

static size_t newton_bytes(const gpu_iteration *it)
{
    return (NEWTON_SUMS * (size_t)((it->num_free + THREADS - 1) / THREADS) + GPU_ROWS * GPU_ROWS) * sizeof(double);
}

pliant_status pliant_cuda_solver_newton_reserve(pliant_cuda_solver *gpu)
{
    const size_t bytes = newton_bytes(&gpu->iteration);
    if (gpu->newton_capacity >= bytes) return PLIANT_OK;
    pliant_cuda_release_host(gpu->h_newton);
    gpu->h_newton = nullptr;
    gpu->newton_capacity = bytes + bytes / 4;
    return pliant_cuda_allocate_host(gpu->newton_capacity, "the step after a cut", &gpu->h_newton);
}

static pliant_status fetch(const opening *work, size_t count)
{
    const pliant_cuda_solver *gpu = work->gpu;
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(gpu->h_newton, gpu->iteration.d_sums, count * sizeof(double),
                                       cudaMemcpyDeviceToHost, gpu->stream)));
    return CUDA_CALL(cudaStreamSynchronize(gpu->stream));
}

/* Add up the results of keep_sums in a fixed order. largest: Nullable: maximum from squares. */
static pliant_status add_up(const opening *work, double *sum, double *largest)
{
    double square = 0;
    CUDA_TRY(fetch(work, NEWTON_SUMS * (size_t)work->blocks));
    *sum = 0;
    for (unsigned b = 0; b < work->blocks; b++) {
        *sum += work->gpu->h_newton[NEWTON_SUMS * b];
        square = fmax(square, work->gpu->h_newton[NEWTON_SUMS * b + 1]);
    }
    if (largest) *largest = sqrt(square);
    return PLIANT_OK;
}

/* Compute v += share T' W' forces of the springs. */
static pliant_status pull(const opening *work, const double *forces, double fraction, double *d_v)
{
    for (int s = 0; s < work->num_springs; s++) {
        const gpu_tool *tool = work->step->tools + work->spring[s];
        const double *f = forces + 3 * work->spring[s];
        open_pull_kernel<<<blocks_for(tool->count, THREADS), THREADS, 0, work->gpu->stream>>>(
            work->gpu->iteration, *tool, fraction * f[0], fraction * f[1], fraction * f[2], d_v);
        CUDA_TRY(CUDA_LAUNCHED("open_pull_kernel"));
    }
    return PLIANT_OK;
}

/* Add the tools' forces of the present state: v += T' W' f. */
static pliant_status load_tools(const opening *work, double *d_v)
{
    for (int t = 0; t < GPU_TOOLS; t++) {
        const gpu_tool *tool = work->step->tools + t;
        const double *f = work->solver->grasps[t].force;
        if (!tool->active) continue;
        open_pull_kernel<<<blocks_for(tool->count, THREADS), THREADS, 0, work->gpu->stream>>>(
            work->gpu->iteration, *tool, f[0], f[1], f[2], d_v);
        CUDA_TRY(CUDA_LAUNCHED("open_pull_kernel"));
    }
    return PLIANT_OK;
}

/* Compute S = c I + W Z of the springs. *regular: it is positive definite. */
static pliant_status find_springs(opening *work, bool *regular)
{
    const pliant_cuda_solver *gpu = work->gpu;
    const size_t n = 3 * (size_t)gpu->iteration.num_free;
    for (int t = 0; t < GPU_TOOLS; t++)
        if (work->step->tools[t].active && work->step->tools[t].spring) work->spring[work->num_springs++] = t;
    const int springs = work->num_springs, rows = 3 * springs;
    *regular = true;
    if (rows == 0) return PLIANT_OK;
    for (int a = 0; a < springs; a++)
        for (int c = 0; c < rows; c++) {
            const double *d_column = work->step->tools[work->spring[c / 3]].d_response + n * (size_t)(c % 3);
            open_moved_kernel<double>
                <<<1, THREADS, 0, gpu->stream>>>(gpu->iteration, work->step->tools[work->spring[a]], d_column, false,
                                                 gpu->iteration.d_sums + 3 * (a * rows + c));
            CUDA_TRY(CUDA_LAUNCHED("open_moved_kernel"));
        }
    CUDA_TRY(fetch(work, (size_t)rows * (size_t)rows));
    for (int r = 0; r < rows; r++)
        for (int c = 0; c < rows; c++)
            work->factor[r * rows + c] = gpu->h_newton[3 * (r / 3 * rows + c) + r % 3] +
                                         (r == c ? work->step->tools[work->spring[r / 3]].compliance : 0);
    *regular = pliant_dense_cholesky(rows, work->factor);
    return PLIANT_OK;
}

/* Compute forces = S^-1 (e - W v). stretch: Nullable: e is zero. */
template <class T> static pliant_status keep(const opening *work, const T *d_v, const double *stretch, double *forces)
{
    const pliant_cuda_solver *gpu = work->gpu;
    double right[GPU_ROWS];
    memset(forces, 0, GPU_ROWS * sizeof *forces);
    if (work->num_springs == 0) return PLIANT_OK;
    for (int s = 0; s < work->num_springs; s++) {
        open_moved_kernel<T><<<1, THREADS, 0, gpu->stream>>>(gpu->iteration, work->step->tools[work->spring[s]], d_v,
                                                             true, gpu->iteration.d_sums + 3 * s);
        CUDA_TRY(CUDA_LAUNCHED("open_moved_kernel"));
    }
    CUDA_TRY(fetch(work, 3 * (size_t)work->num_springs));
    for (int r = 0; r < 3 * work->num_springs; r++) right[r] = (stretch ? stretch[r] : 0) - gpu->h_newton[r];
    pliant_dense_cholesky_solve(3 * work->num_springs, work->factor, 1, right);
    for (int r = 0; r < 3 * work->num_springs; r++) forces[3 * work->spring[r / 3] + r % 3] = right[r];
    return PLIANT_OK;
}

static pliant_status advance(const opening *work, double fraction)
{
    open_advance_kernel<<<work->blocks, THREADS, 0, work->gpu->stream>>>(work->gpu->iteration, work->at, fraction);
    return CUDA_LAUNCHED("open_advance_kernel");
}

/* Compute the preconditioned step of the remaining residual with springs, and their product. */
static pliant_status precondition(const opening *work, const double *stretch, double *forces, double *norm,
                                  double *longest)
{
    const pliant_cuda_solver *gpu = work->gpu;
    const gpu_iteration *it = &gpu->iteration;
    newton_pulls pulls = {};
    CUDA_TRY(pliant_cuda_precondition(&gpu->preconditioner, it, gpu->stream));
    CUDA_TRY(keep(work, it->d_left, stretch, forces));
    pulls.count = work->num_springs;
    for (int s = 0; s < work->num_springs; s++) {
        pulls.d_response[s] = work->step->tools[work->spring[s]].d_response;
        memcpy(pulls.force + 3 * s, forces + 3 * work->spring[s], 3 * sizeof *forces);
    }
    open_step_kernel<<<work->blocks, THREADS, 0, gpu->stream>>>(*it, work->at, pulls, it->d_sums);
    CUDA_TRY(CUDA_LAUNCHED("open_step_kernel"));
    return add_up(work, norm, longest);
}

static pliant_status combine(opening *work, double previous_weight)
{
    const size_t n = 3 * (size_t)work->gpu->iteration.num_free;
    open_combine_kernel<<<blocks_for(n, THREADS), THREADS, 0, work->gpu->stream>>>(work->gpu->iteration, work->at,
                                                                                   previous_weight);
    for (int r = 0; r < GPU_ROWS; r++)
        work->pulls_along[r] = work->pulls_next[r] + previous_weight * work->pulls_along[r];
    return CUDA_LAUNCHED("open_combine_kernel");
}

/* Write x + share v to a buffer, which may be the same one. */
static pliant_status place(const opening *work, const double *d_v, double fraction, double *d_to)
{
    const gpu_iteration *it = &work->gpu->iteration;
    open_place_kernel<<<work->blocks, THREADS, 0, work->gpu->stream>>>(*it, d_v, fraction, it->d_x[0], d_to);
    return CUDA_LAUNCHED("open_place_kernel");
}
static pliant_status find_forces(const opening *work, double *d_x)
{
    gpu_iteration it = work->gpu->iteration;
    it.d_x[0] = d_x;
    return pliant_cuda_forces(&work->gpu->system, &it, work->gpu->stream);
}

/* Compute pulled = K along and along . pulled, from a difference over `fraction` times along. */
static pliant_status multiply(const opening *work, double fraction, double *curvature)
{
    const pliant_cuda_solver *gpu = work->gpu;
    CUDA_TRY(place(work, work->at.d_along, fraction, gpu->iteration.d_x[1]));
    CUDA_TRY(find_forces(work, gpu->iteration.d_x[1]));
    open_kernel<PRODUCT><<<work->blocks, THREADS, 0, gpu->stream>>>(gpu->system, gpu->iteration, work->at, fraction,
                                                                    gpu->iteration.d_sums);
    CUDA_TRY(CUDA_LAUNCHED("open_kernel"));
    return add_up(work, curvature, nullptr);
}

/* Compute the state's residual and the first direction. prescribed: out: held nodes have moved since the last step, and
 * the direction is taken with length 1. */
static pliant_status begin(opening *work, bool *prescribed)
{
    const pliant_cuda_solver *gpu = work->gpu;
    const gpu_iteration *it = &gpu->iteration;
    double stretch[GPU_ROWS] = {}, maximum = 0;
    CUDA_TRY(find_forces(work, it->d_x[0]));
    open_kernel<RESIDUAL><<<work->blocks, THREADS, 0, gpu->stream>>>(gpu->system, *it, work->at, 1, nullptr);
    CUDA_TRY(CUDA_LAUNCHED("open_kernel"));
    CUDA_TRY(load_tools(work, work->at.d_left));
    CUDA_TRY(
        CUDA_CALL(cudaMemsetAsync(work->at.d_correction, 0, 3 * (size_t)it->num_free * sizeof(double), gpu->stream)));
    for (int s = 0; s < work->num_springs; s++) {
        const int t = work->spring[s];
        memcpy(work->solver->now.force + 3 * t, work->solver->grasps[t].force, 3 * sizeof *stretch);
        pliant_grasp_stretch(work->solver, t, &work->solver->now, stretch + 3 * s);
        for (int d = 0; d < 3; d++) maximum = fmax(maximum, fabs(stretch[3 * s + d]));
    }
    CUDA_TRY(advance(work, 0));
    CUDA_TRY(precondition(work, stretch, work->pulls_next, &work->norm, &work->longest));
    *prescribed = maximum > pliant_get_quasistatic_settings().newton_still * work->longest;
    return combine(work, 0);
}

/* Run conjugate gradients as find_step in newton_after_cut.c. products: in: maximum number; out: number used. */
static pliant_status find_step(opening *work, bool prescribed, int32_t *products)
{
    const int32_t maximum = *products;
    const double first = work->norm;
    for (*products = 0; *products < maximum && pliant_newton_continues(work->norm, first);) {
        const double difference =
            pliant_newton_difference_length(work->solver->rules.smallest_displacement, work->longest);
        double curvature, longest;
        if (!(difference > 0)) break;
        CUDA_TRY(multiply(work, difference, &curvature));
        curvature += pliant_solver_spring_energy(work->solver, work->pulls_along, work->pulls_along);
        const double fraction = pliant_newton_step_length(prescribed, work->norm, curvature);
        ++*products;
        if (!(fraction > 0)) break;
        CUDA_TRY(pull(work, work->pulls_along, -1, work->at.d_pulled));
        for (int r = 0; r < GPU_ROWS; r++) work->pulls[r] += fraction * work->pulls_along[r];
        work->energy += fraction * work->norm;
        CUDA_TRY(advance(work, fraction));
        if (*products == maximum) break;
        const double before = work->norm;
        CUDA_TRY(precondition(work, nullptr, work->pulls_next, &work->norm, &longest));
        const double previous_weight = pliant_newton_direction_weight(prescribed, work->norm, before);
        prescribed = false;
        work->longest = longest + previous_weight * work->longest;
        CUDA_TRY(combine(work, previous_weight));
    }
    return PLIANT_OK;
}

/* ---- The motion, in axes that rotate with the tissue. */

static pliant_status apply_fraction(const opening *work, double fraction)
{
    pliant_cuda_solver *gpu = work->gpu;
    CUDA_TRY(place(work, work->at.d_correction, fraction, gpu->iteration.d_x[0]));
    for (int t = 0; t < GPU_TOOLS; t++)
        for (int d = 0; d < 3; d++) work->solver->grasps[t].force[d] += fraction * work->pulls[3 * t + d];
    return gpu->in_use.has_inaccurate_rotations ? PLIANT_OK
                                                : pliant_cuda_rotate(&gpu->system, &gpu->iteration, false, gpu->stream);
}

/* Compute the decrease of the potential energy along the step at its present end. */
static pliant_status find_slope(const opening *work, double *slope)
{
    const pliant_cuda_solver *gpu = work->gpu;
    double of_tools = 0;
    for (int t = 0; t < GPU_TOOLS; t++) {
        if (!work->step->tools[t].active) continue;
        open_moved_kernel<double><<<1, THREADS, 0, gpu->stream>>>(gpu->iteration, work->step->tools[t],
                                                                  work->at.d_correction, true, gpu->iteration.d_sums);
        CUDA_TRY(CUDA_LAUNCHED("open_moved_kernel"));
        CUDA_TRY(fetch(work, 3));
        for (int d = 0; d < 3; d++) of_tools += work->solver->grasps[t].force[d] * gpu->h_newton[d];
    }
    CUDA_TRY(find_forces(work, gpu->iteration.d_x[0]));
    open_kernel<SLOPE><<<work->blocks, THREADS, 0, gpu->stream>>>(gpu->system, gpu->iteration, work->at, 1,
                                                                  gpu->iteration.d_sums);
    CUDA_TRY(CUDA_LAUNCHED("open_kernel"));
    CUDA_TRY(add_up(work, slope, nullptr));
    *slope += of_tools;
    return PLIANT_OK;
}

/* Take the step as take_step in newton_after_cut.c. The state before it goes to the other buffer. */
static pliant_status take_step(const opening *work)
{
    pliant_cuda_solver *gpu = work->gpu;
    const gpu_iteration *it = &gpu->iteration;
    const size_t bytes = 3 * (size_t)it->num_nodes * sizeof(double);
    double none, longest, completed = 0, slope = work->energy;
    open_longest_kernel<<<work->blocks, THREADS, 0, gpu->stream>>>(*it, work->at.d_correction, it->d_sums);
    CUDA_TRY(CUDA_LAUNCHED("open_longest_kernel"));
    CUDA_TRY(add_up(work, &none, &longest));
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(it->d_x[1], it->d_x[0], bytes, cudaMemcpyDeviceToDevice, gpu->stream)));
    const double length = longest / work->solver->rules.smallest_displacement,
                 fraction = pliant_newton_step_fraction(length);
    const int parts = pliant_newton_num_parts(length);
    for (int p = 0; p < parts; p++) {
        const double part = fraction / parts;
        CUDA_TRY(apply_fraction(work, part));
        completed += part;
        if (!pliant_newton_checks_slope(completed, length)) continue;
        const double before = slope;
        CUDA_TRY(find_slope(work, &slope));
        if (slope > 0) continue;
        CUDA_TRY(apply_fraction(work, -pliant_newton_backtrack(part, before, slope)));
        break;
    }
    if (gpu->in_use.has_inaccurate_rotations) gpu->in_use.number++;
    else pliant_preconditioner_use_rotated(&gpu->in_use);
    return PLIANT_OK;
}

pliant_status pliant_cuda_newton_load_kernels(void)
{
    return pliant_cuda_load_kernels(open_kernel<RESIDUAL>, open_kernel<PRODUCT>, open_kernel<SLOPE>, open_place_kernel,
                                    open_advance_kernel, open_step_kernel, open_combine_kernel, open_longest_kernel);
}

pliant_status pliant_cuda_solver_newton_step(pliant_cuda_solver *gpu, pliant_solver *solver, gpu_step *step,
                                             int32_t *evaluations)
{
    opening work = {};
    bool prescribed = false, regular;
    const int32_t maximum = pliant_solver_newton_limit(
        solver, &step->limit, pliant_get_quasistatic_settings().newton_evaluation_fraction_gpu);
    const bool is_valid = solver->is_after_cut && gpu->fresh && !pliant_contact_problem_has_points(solver->contacts) &&
                          maximum >= PLIANT_NEWTON_MIN_EVALUATIONS;
    *evaluations = 0;
    solver->is_after_cut = false;
    if (!is_valid) return PLIANT_OK;
    int32_t products = pliant_newton_max_products(maximum);
    work.gpu = gpu;
    work.solver = solver;
    work.step = step;
    work.at = vectors_of(&gpu->iteration);
    work.blocks = blocks_for(gpu->iteration.num_free, THREADS);
    for (int t = 0; t < GPU_TOOLS; t++)
        memcpy(step->previous_force + 3 * t, solver->grasps[t].force, 3 * sizeof(double));
    CUDA_TRY(pliant_cuda_solver_newton_reserve(gpu));
    CUDA_TRY(find_springs(&work, &regular));
    *evaluations = 1;
    if (!regular) return PLIANT_OK;
    CUDA_TRY(begin(&work, &prescribed));
    if (!std::isfinite(work.norm) || !(work.norm > 0)) return PLIANT_OK;
    /* The body's displacement is unknown on the host here, so the smallest one is used. */
    if (pliant_newton_is_negligible(work.longest, solver->rules.tolerance * solver->rules.smallest_displacement))
        return PLIANT_OK;
    CUDA_TRY(find_step(&work, prescribed, &products));
    *evaluations = 1 + products;
    if (!(work.energy > 0)) return PLIANT_OK;
    CUDA_TRY(take_step(&work));
    step->after_newton = 1;
    step->trusted_merit = sqrt(work.energy);
    return PLIANT_OK;
}
