#include "cuda/base/check.h"
#include "cuda/base/launch.h"
#include "base/fail.h"
#include "fem/linear/hierarchy.h"
#include "cuda/fem/linear/multigrid.h"
#include "base/memory.h"

#include <initializer_list>

enum { THREADS = 128, LANES_PER_NODE = 8, NODES = THREADS / LANES_PER_NODE };

/* Chebyshev smoothing acts on the spectrum above this fraction, with two steps before and two after, as on the CPU. */
static const double spectrum_share = 0.12;

struct chebyshev { float first, again, fresh; }; /* step = first D^-1 r; then step = again step + fresh D^-1 r */

/* Arrays of one level; pointers are device pointers. */
struct grid_level {
    int num_free, num_coarse;
    int *d_row_start, *d_column;    /* complete rows of 3 x 3 blocks */
    float *d_blocks;                /* (entries x 9) */
    float *d_inverse;               /* (num_free x 9) inverted diagonal blocks */
    int *d_to, *d_from_start, *d_from;
    int corners;                    /* of a coarse element */
    float *d_weight;                /* (num_free x corners) */
    float *d_x[2], *d_step, *d_residual, *d_right; /* (3 num_free), padded for the dense level; for several vectors: */
    size_t stride;                  /* distance between two vectors */
    chebyshev smoother;
};

enum { NUM_WIDE = 12 }; /* vectors processed at once for columns */

/* Work arrays for several vectors, allocated at the first use. */
struct wide_capacity {
    float *d_buffer; /* memory of all arrays below; NULL: not used yet */
    grid_level level[PLIANT_MAX_LEVELS]; /* as for one vector, except for these arrays and the d_right of the first
                                          * level */
    gpu_inverse inverse;
    float *d_out;
};

struct gpu_multigrid {
    int num_levels; /* the last level is dense */
    grid_level level[PLIANT_MAX_LEVELS];
    gpu_inverse inverse;
    wide_capacity wide;
    size_t bytes;
};

/* ---- Creation. */

template <class T>
static pliant_status upload(gpu_multigrid *multigrid, const T *h_from, size_t count, cudaStream_t stream, T **d_out)
{
    CUDA_TRY(pliant_cuda_upload(h_from, count * sizeof(T), "the multigrid", stream, d_out));
    multigrid->bytes += count * sizeof(T);
    return PLIANT_OK;
}

static pliant_status allocate(gpu_multigrid *multigrid, size_t count, cudaStream_t stream, float **d_out)
{
    CUDA_TRY(pliant_cuda_allocate(count * sizeof(float), "the multigrid", d_out));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(*d_out, 0, count * sizeof(float), stream)));
    multigrid->bytes += count * sizeof(float);
    return PLIANT_OK;
}

/* Return the coefficients of two steps of Chebyshev iteration on [share, 1] of the spectrum of D^-1 A (Saad, Iterative
 * Methods, 12.3). */
static chebyshev coefficients(double largest)
{
    const double low = spectrum_share * largest, centre = 0.5 * (largest + low), half = 0.5 * (largest - low);
    const double sigma = centre / half, rho = 1 / sigma, next = 1 / (2 * sigma - rho);
    return {(float)(1 / centre), (float)(next * rho), (float)(2 * next / half)};
}

static pliant_status fill_level(gpu_multigrid *multigrid, const pliant_grid_level *grid,
                                const pliant_multigrid *numbers, int l, cudaStream_t stream)
{
    grid_level *level = multigrid->level + l;
    const size_t n = (size_t)grid->system.num_free, entries = (size_t)grid->row_start[n],
                 coarse = (size_t)grid[1].system.num_free;
    const size_t corners = (size_t)grid->corners;
    const float *h_blocks, *h_inverse;
    double largest;
    pliant_multigrid_level(numbers, l, &h_blocks, &h_inverse, &largest);
    level->num_free = grid->system.num_free;
    level->num_coarse = grid[1].system.num_free;
    level->corners = grid->corners;
    level->smoother = coefficients(largest);
    CUDA_TRY(upload(multigrid, grid->row_start, n + 1, stream, &level->d_row_start));
    CUDA_TRY(upload(multigrid, grid->column, entries, stream, &level->d_column));
    CUDA_TRY(upload(multigrid, h_blocks, 9 * entries, stream, &level->d_blocks));
    CUDA_TRY(upload(multigrid, h_inverse, 9 * n, stream, &level->d_inverse));
    CUDA_TRY(upload(multigrid, grid->to, corners * n, stream, &level->d_to));
    CUDA_TRY(upload(multigrid, grid->weight, corners * n, stream, &level->d_weight));
    CUDA_TRY(upload(multigrid, grid->from_start, coarse + 1, stream, &level->d_from_start));
    CUDA_TRY(upload(multigrid, grid->from, (size_t)grid->from_start[coarse], stream, &level->d_from));
    for (float *&d_x : level->d_x) CUDA_TRY(allocate(multigrid, 3 * n, stream, &d_x));
    CUDA_TRY(allocate(multigrid, 3 * n, stream, &level->d_step));
    CUDA_TRY(allocate(multigrid, 3 * n, stream, &level->d_residual));
    return allocate(multigrid, 3 * n, stream, &level->d_right);
}

static pliant_status fill(gpu_multigrid *multigrid, const pliant_hierarchy *hierarchy, const pliant_multigrid *numbers,
                          cudaStream_t stream)
{
    const int last = hierarchy->num_levels - 1;
    multigrid->num_levels = hierarchy->num_levels;
    for (int l = 0; l < last; l++) CUDA_TRY(fill_level(multigrid, hierarchy->level + l, numbers, l, stream));
    const pliant_pattern *pattern = &hierarchy->level[last].system.pattern;
    const size_t padded = (size_t)pliant_cuda_inverse_padded(3 * pattern->num_columns);
    size_t kept;
    CUDA_TRY(
        pliant_cuda_inverse_create(pattern, pliant_multigrid_coarsest(numbers), true, stream, &multigrid->inverse));
    pliant_cuda_inverse_memory(multigrid->inverse.size, &kept);
    multigrid->bytes += kept;
    CUDA_TRY(allocate(multigrid, padded, stream, &multigrid->level[last].d_right));
    return allocate(multigrid, padded, stream, &multigrid->level[last].d_x[0]);
}

/* Copy the values of the CPU's multigrid. */
static pliant_status fill_at(const double *h_x, gpu_multigrid *multigrid, const pliant_system *system,
                             const pliant_hierarchy *hierarchy, cudaStream_t stream)
{
    pliant_multigrid *numbers = nullptr;
    pliant_tangent *h_tangents =
        static_cast<pliant_tangent *>(pliant_calloc((size_t)system->num_blocks, sizeof(pliant_tangent)));
    pliant_status status = h_tangents ? pliant_multigrid_create(hierarchy, system->num_threads, &numbers)
                                      : pliant_fail_memory("the multigrid");
    if (status == PLIANT_OK) {
        pliant_system_tangents(system, h_x, PLIANT_TWIST_POSITIVE, h_tangents);
        status = pliant_multigrid_numeric(numbers, h_tangents);
    }
    if (status == PLIANT_OK) status = fill(multigrid, hierarchy, numbers, stream);
    pliant_multigrid_free(numbers);
    pliant_free(h_tangents);
    return status;
}

/* Build a hierarchy that separates fragments at cuts. If it has too many unknowns for the dense level, build one
 * without cuts. *out: NULL: that one has too many as well. */
static pliant_status find_levels(const pliant_system *system, int32_t largest, pliant_hierarchy **out)
{
    for (bool fragments : {true, false}) {
        CUDA_TRY(pliant_hierarchy_create(system, fragments, largest, out));
        if (!*out || (*out)->level[(*out)->num_levels - 1].system.num_free <= largest) return PLIANT_OK;
        pliant_hierarchy_free(*out);
        *out = nullptr;
    }
    return PLIANT_OK;
}

pliant_status pliant_cuda_multigrid_create(const pliant_system *system, const double *h_x, int32_t largest,
                                           cudaStream_t stream, gpu_multigrid **out)
{
    pliant_hierarchy *hierarchy = nullptr;
    *out = nullptr;
    CUDA_TRY(find_levels(system, largest, &hierarchy));
    if (!hierarchy) return PLIANT_OK;
    gpu_multigrid *multigrid = static_cast<gpu_multigrid *>(pliant_calloc(1, sizeof *multigrid));
    pliant_status status =
        multigrid ? fill_at(h_x, multigrid, system, hierarchy, stream) : pliant_fail_memory("the multigrid");
    pliant_hierarchy_free(hierarchy);
    if (status != PLIANT_OK) {
        pliant_cuda_multigrid_free(multigrid);
        return status;
    }
    *out = multigrid;
    return PLIANT_OK;
}

void pliant_cuda_multigrid_free(gpu_multigrid *multigrid)
{
    if (!multigrid) return;
    for (grid_level &level : multigrid->level) {
        pliant_cuda_release(level.d_row_start, level.d_column, level.d_blocks, level.d_inverse, level.d_to,
                            level.d_from_start, level.d_from, level.d_weight, level.d_x[0], level.d_x[1], level.d_step,
                            level.d_residual, level.d_right);
    }
    pliant_cuda_release(multigrid->wide.d_buffer);
    pliant_cuda_inverse_free(&multigrid->inverse);
    pliant_free(multigrid);
}

size_t pliant_cuda_multigrid_bytes(const gpu_multigrid *multigrid) { return multigrid->bytes; }

/* ---- The cycle, for one vector, or for several by the blocks' second index. Eight threads per node divide the blocks
 * of its row. */

struct vector3 { float x, y, z; };

static __device__ __forceinline__ vector3 load3(const float *from, int node)
{
    return {from[3 * node], from[3 * node + 1], from[3 * node + 2]};
}
static __device__ __forceinline__ void store3(float *to, int node, const vector3 &v)
{
    to[3 * node] = v.x;
    to[3 * node + 1] = v.y;
    to[3 * node + 2] = v.z;
}
/* Multiply by a column-major block; inverted diagonal blocks are symmetric. */
static __device__ __forceinline__ vector3 times(const float *a, const vector3 &v)
{
    return {a[0] * v.x + a[3] * v.y + a[6] * v.z, a[1] * v.x + a[4] * v.y + a[7] * v.z,
            a[2] * v.x + a[5] * v.y + a[8] * v.z};
}

/* Return right - A x at one node, to all eight threads. */
static __device__ __forceinline__ vector3 residual_at(const grid_level &level, const float *right, const float *x,
                                                      int node, bool there)
{
    vector3 sum = {0, 0, 0};
    if (there) {
        const int end = level.d_row_start[node + 1];
        for (int e = level.d_row_start[node] + (int)threadIdx.x % LANES_PER_NODE; e < end; e += LANES_PER_NODE) {
            vector3 part = times(level.d_blocks + 9 * (size_t)e, load3(x, level.d_column[e]));
            sum.x += part.x;
            sum.y += part.y;
            sum.z += part.z;
        }
    }
    for (int half = LANES_PER_NODE / 2; half > 0; half /= 2) {
        sum.x += __shfl_xor_sync(0xffffffff, sum.x, half);
        sum.y += __shfl_xor_sync(0xffffffff, sum.y, half);
        sum.z += __shfl_xor_sync(0xffffffff, sum.z, half);
    }
    if (!there) return sum;
    vector3 r = load3(right, node);
    return {r.x - sum.x, r.y - sum.y, r.z - sum.z};
}

/* Start from zero: step = first D^-1 right, x = step. */
static __global__ void __launch_bounds__(THREADS)
    begin_smooth_kernel(grid_level level, const int *d_skip, const float *d_right, float *d_x)
{
    const int node = (int)(blockIdx.x * THREADS + threadIdx.x);
    const size_t own = level.stride * blockIdx.y;
    if ((d_skip && *d_skip) || node >= level.num_free) return;
    vector3 step = times(level.d_inverse + 9 * (size_t)node, load3(d_right + own, node));
    step = {level.smoother.first * step.x, level.smoother.first * step.y, level.smoother.first * step.z};
    store3(level.d_step + own, node, step);
    store3(d_x + own, node, step);
}

/* Compute step = again step + fresh D^-1 (right - A x), x' = x + step. */
static __global__ void __launch_bounds__(THREADS)
    smooth_kernel(grid_level level, const int *d_skip, const float *d_right, const float *d_x, float *d_next,
                  float again, float fresh)
{
    if (d_skip && *d_skip) return;
    const int node = (int)(blockIdx.x * NODES + threadIdx.x / LANES_PER_NODE);
    const size_t own = level.stride * blockIdx.y;
    const bool there = node < level.num_free;
    vector3 residual = residual_at(level, d_right + own, d_x + own, node, there);
    if (!there || threadIdx.x % LANES_PER_NODE != 0) return;
    vector3 step = times(level.d_inverse + 9 * (size_t)node, residual), x = load3(d_x + own, node);
    vector3 before = again != 0 ? load3(level.d_step + own, node) : vector3{0, 0, 0};
    step = {again * before.x + fresh * step.x, again * before.y + fresh * step.y, again * before.z + fresh * step.z};
    store3(level.d_step + own, node, step);
    store3(d_next + own, node, {x.x + step.x, x.y + step.y, x.z + step.z});
}

static __global__ void __launch_bounds__(THREADS)
    residual_kernel(grid_level level, const int *d_skip, const float *d_right, const float *d_x)
{
    if (d_skip && *d_skip) return;
    const int node = (int)(blockIdx.x * NODES + threadIdx.x / LANES_PER_NODE);
    const size_t own = level.stride * blockIdx.y;
    const bool there = node < level.num_free;
    vector3 residual = residual_at(level, d_right + own, d_x + own, node, there);
    if (there && threadIdx.x % LANES_PER_NODE == 0) store3(level.d_residual + own, node, residual);
}

/* Restrict the residual, eight threads per coarse node. */
static __global__ void __launch_bounds__(THREADS)
    restrict_kernel(grid_level level, const int *d_skip, size_t coarse_stride, float *d_coarse)
{
    if (d_skip && *d_skip) return;
    const int node = (int)(blockIdx.x * NODES + threadIdx.x / LANES_PER_NODE);
    const bool there = node < level.num_coarse;
    vector3 sum = {0, 0, 0};
    if (there) {
        const int end = level.d_from_start[node + 1];
        for (int e = level.d_from_start[node] + (int)threadIdx.x % LANES_PER_NODE; e < end; e += LANES_PER_NODE) {
            const int from = level.d_from[e];
            const float weight = level.d_weight[from];
            vector3 r = load3(level.d_residual + level.stride * blockIdx.y, from / level.corners);
            sum = {sum.x + weight * r.x, sum.y + weight * r.y, sum.z + weight * r.z};
        }
    }
    for (int half = LANES_PER_NODE / 2; half > 0; half /= 2) {
        sum.x += __shfl_xor_sync(0xffffffff, sum.x, half);
        sum.y += __shfl_xor_sync(0xffffffff, sum.y, half);
        sum.z += __shfl_xor_sync(0xffffffff, sum.z, half);
    }
    if (there && threadIdx.x % LANES_PER_NODE == 0) store3(d_coarse + coarse_stride * blockIdx.y, node, sum);
}

static __global__ void __launch_bounds__(THREADS)
    correct_kernel(grid_level level, const int *d_skip, size_t coarse_stride, const float *d_coarse, float *d_x)
{
    const int node = (int)(blockIdx.x * THREADS + threadIdx.x);
    if ((d_skip && *d_skip) || node >= level.num_free) return;
    d_x += level.stride * blockIdx.y;
    vector3 x = load3(d_x, node);
    for (int v = 0; v < level.corners; v++) {
        const size_t at = (size_t)level.corners * (size_t)node + (size_t)v;
        const float weight = level.d_weight[at];
        if (weight == 0) continue;
        vector3 by = load3(d_coarse + coarse_stride * blockIdx.y, level.d_to[at]);
        x = {x.x + weight * by.x, x.y + weight * by.y, x.z + weight * by.z};
    }
    store3(d_x, node, x);
}

/* Run the cycle from d_right of this level to d_out, for `count` vectors. */
static pliant_status cycle(int num_levels, const grid_level *levels, const gpu_inverse *inverse, int l,
                           const int32_t *d_skip, int32_t count, const float *d_right, float *d_out,
                           cudaStream_t stream)
{
    const grid_level &level = levels[l];
    if (l == num_levels - 1)
        return pliant_cuda_inverse_apply_all(inverse, d_skip, count, level.stride, d_right, d_out, stream);
    const grid_level &coarse = levels[l + 1];
    const chebyshev &smoother = level.smoother;
    const unsigned many = (unsigned)count;
    const dim3 light(blocks_for(level.num_free, THREADS), many), heavy(blocks_for(level.num_free, NODES), many);
    begin_smooth_kernel<<<light, THREADS, 0, stream>>>(level, d_skip, d_right, level.d_x[0]);
    smooth_kernel<<<heavy, THREADS, 0, stream>>>(level, d_skip, d_right, level.d_x[0], level.d_x[1], smoother.again,
                                                 smoother.fresh);
    residual_kernel<<<heavy, THREADS, 0, stream>>>(level, d_skip, d_right, level.d_x[1]);
    restrict_kernel<<<dim3(blocks_for(level.num_coarse, NODES), many), THREADS, 0, stream>>>(
        level, d_skip, coarse.stride, coarse.d_right);
    CUDA_TRY(CUDA_LAUNCHED("restrict_kernel"));
    CUDA_TRY(cycle(num_levels, levels, inverse, l + 1, d_skip, count, coarse.d_right, coarse.d_x[0], stream));
    correct_kernel<<<light, THREADS, 0, stream>>>(level, d_skip, coarse.stride, coarse.d_x[0], level.d_x[1]);
    float *d_last = l == 0 ? d_out : level.d_x[0];
    float *d_between = level.d_residual; /* not needed any more */
    smooth_kernel<<<heavy, THREADS, 0, stream>>>(level, d_skip, d_right, level.d_x[1], d_between, 0, smoother.first);
    smooth_kernel<<<heavy, THREADS, 0, stream>>>(level, d_skip, d_right, d_between, d_last, smoother.again,
                                                 smoother.fresh);
    return CUDA_LAUNCHED("smooth_kernel");
}

pliant_status pliant_cuda_multigrid_apply(const gpu_multigrid *multigrid, const int32_t *d_skip, const float *d_right,
                                          float *d_left, cudaStream_t stream)
{
    return cycle(multigrid->num_levels, multigrid->level, &multigrid->inverse, 0, d_skip, 1, d_right, d_left, stream);
}

/* ---- Columns. */

/* Allocate the levels' arrays in one block. Many allocations during a step would take longer than the columns. */
static pliant_status make_wide(gpu_multigrid *multigrid, cudaStream_t stream)
{
    wide_capacity *wide = &multigrid->wide;
    const int last = multigrid->num_levels - 1;
    const size_t parts = NUM_WIDE * pliant_cuda_inverse_parts(&multigrid->inverse);
    size_t numbers = parts;
    float *d_buffer = nullptr;
    if (wide->d_buffer) return PLIANT_OK;
    for (int l = 0; l <= last; l++) {
        grid_level *level = wide->level + l;
        *level = multigrid->level[l];
        level->stride =
            l == last ? (size_t)pliant_cuda_inverse_padded(multigrid->inverse.size) : 3 * (size_t)level->num_free;
        numbers += (l == last ? 2 : 5) * NUM_WIDE * level->stride;
    }
    numbers += NUM_WIDE * wide->level[0].stride;
    const pliant_status status = allocate(multigrid, numbers, stream, &d_buffer);
    if (status != PLIANT_OK) {
        pliant_cuda_release(d_buffer);
        return status;
    }
    float *next = d_buffer; /* vectors that are read four numbers at a time come first */
    for (int l = last; l >= 0; l--) {
        grid_level *level = wide->level + l;
        float **arrays[] = {&level->d_right, level->d_x, level->d_x + 1, &level->d_step, &level->d_residual};
        for (int b = 0; b < (l == last ? 2 : 5); b++, next += NUM_WIDE * level->stride) *arrays[b] = next;
    }
    wide->inverse = multigrid->inverse;
    wide->inverse.d_parts = next;
    wide->d_out = next + parts;
    wide->d_buffer = d_buffer;
    return PLIANT_OK;
}

/* Set unit vectors, one thread per vector. */
static __global__ void unit_kernel(const int32_t *d_which, size_t stride, float *d_right)
{
    const int n = (int)threadIdx.x;
    d_right[stride * (size_t)n + 3 * (size_t)d_which[2 * (n / 3)] + n % 3] = 1;
}

static __global__ void __launch_bounds__(THREADS)
    store_kernel(const int32_t *d_which, size_t from_stride, const float *d_from, size_t stride, float *d_column)
{
    const size_t n = blockIdx.x * THREADS + threadIdx.x;
    const int vector = (int)blockIdx.y;
    if (n < from_stride)
        d_column[stride * (size_t)(d_which[2 * (vector / 3) + 1] + vector % 3) + n] =
            d_from[from_stride * (size_t)vector + n];
}

pliant_status pliant_cuda_multigrid_columns(gpu_multigrid *multigrid, int32_t count, const int32_t *d_which,
                                            size_t stride, float *d_column, cudaStream_t stream)
{
    CUDA_TRY(make_wide(multigrid, stream));
    const wide_capacity *wide = &multigrid->wide;
    const grid_level &first = wide->level[0];
    for (int32_t done = 0; done < count; done += NUM_WIDE / 3) {
        const int32_t left = 3 * (count - done), many = left < NUM_WIDE ? left : NUM_WIDE;
        const int32_t *d_these = d_which + 2 * (size_t)done;
        CUDA_TRY(CUDA_CALL(cudaMemsetAsync(first.d_right, 0, (size_t)many * first.stride * sizeof(float), stream)));
        unit_kernel<<<1, (unsigned)many, 0, stream>>>(d_these, first.stride, first.d_right);
        CUDA_TRY(CUDA_LAUNCHED("unit_kernel"));
        CUDA_TRY(cycle(multigrid->num_levels, wide->level, &wide->inverse, 0, NULL, many, first.d_right, wide->d_out,
                       stream));
        store_kernel<<<dim3(blocks_for(3 * first.num_free, THREADS), (unsigned)many), THREADS, 0, stream>>>(
            d_these, first.stride, wide->d_out, stride, d_column);
        CUDA_TRY(CUDA_LAUNCHED("store_kernel"));
    }
    return PLIANT_OK;
}
