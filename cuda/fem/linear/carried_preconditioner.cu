#include "cuda/fem/linear/carried_preconditioner.h"
#include "base/fail.h"
#include "cuda/base/check.h"
#include "cuda/base/launch.h"
#include "fem/element/corotational.h"
#include "base/memory.h"
#include "cuda/fem/linear/sweep.cuh"
#include "cuda/base/warp_sum.cuh"

#include <cstring>

enum { THREADS = 128, ENTRIES = 36, MACRO_ENTRIES = 72, WARP = 32, COLUMNS = 32, GROUPS = 8 };
/* Maximum number of sweeps within the time of a frame. Beyond it, a new preconditioner is as fast. */
enum { MAX_SWEEPS = 32, MAX_TILES = 72 };
/* Pivot threshold for parts attached by a hinge, as a fraction of the original diagonal. */
static constexpr double hinge = 1e-6;

enum { SOURCE, TAKER_START, TAKER, NEAR, PLACE, ANSWER, FOUND, PULL, RIGHT, LEFT, WHOLE };

/* ---- Neighbourhood of a cut, on the host. */

struct neighbours {
    uint8_t *inner;                   /* (num_free) nonzero: inner */
    int32_t *near;                    /* (num_free) inner unknowns, then outer ones */
    int32_t *place;                   /* (nodes) index in near + 1 */
    int32_t *taker_start, *taker;
    int32_t num_inner, num_near;
};

static void neighbours_free(neighbours *found)
{
    void *blocks[] = {found->inner, found->near, found->place, found->taker_start, found->taker};
    for (void *block : blocks) pliant_free(block);
}

template <class T> static T *numbers(size_t count) { return static_cast<T *>(pliant_calloc(count, sizeof(T))); }

static void find_outer(const pliant_system *system, neighbours *found)
{
    const int32_t *nodes = pliant_element_nodes(system);
    for (int32_t i = 0; i < found->num_inner; i++) found->place[system->node_of_free[found->near[i]]] = i + 1;
    found->num_near = found->num_inner;
    for (int32_t i = 0; i < found->num_inner; i++)
        for (int32_t c = system->corner_start[found->near[i]]; c < system->corner_end[found->near[i]]; c++) {
            const int32_t element = pliant_element_of_corner(system, system->corner[c]);
            for (int32_t v = pliant_element_begin(system, element); v < pliant_element_begin(system, element + 1);
                 v++) {
                const int32_t node = nodes[v], f = system->free_of_node[node];
                if (f < 0 || found->place[node] > 0) continue;
                found->near[found->num_near++] = f;
                found->place[node] = found->num_near;
            }
        }
}

static void find_takers(int32_t num_free, int32_t base_free, const int32_t *source, neighbours *found)
{
    for (int32_t f = 0; f < num_free; f++)
        if (source[f] >= 0) found->taker_start[source[f] + 1]++;
    for (int32_t b = 0; b < base_free; b++) found->taker_start[b + 1] += found->taker_start[b];
    const int32_t all = found->taker_start[base_free];
    for (int32_t f = num_free - 1; f >= 0; f--) /* in ascending order; afterwards the starts are shifted by one entry */
        if (source[f] >= 0) found->taker[--found->taker_start[source[f] + 1]] = f;
    for (int32_t b = 0; b < base_free; b++) found->taker_start[b] = found->taker_start[b + 1];
    found->taker_start[base_free] = all;
}

static pliant_status find_neighbours(const pliant_system *system, const pliant_carried_layout *base,
                                     const int32_t *source, neighbours *found)
{
    const int32_t base_free = base->num_free;
    const size_t count = (size_t)system->num_free;
    found->inner = numbers<uint8_t>(count);
    found->near = numbers<int32_t>(count);
    found->place = numbers<int32_t>((size_t)system->mesh->num_nodes);
    found->taker_start = numbers<int32_t>((size_t)base_free + 1);
    found->taker = numbers<int32_t>(count);
    if (!found->inner || !found->near || !found->place || !found->taker_start || !found->taker)
        return pliant_fail_memory("the preconditioner");
    CUDA_TRY(pliant_carried_mark_opened(system, base, source, found->inner));
    found->num_inner = pliant_subdomain_inner(system, PLIANT_CARRIED_RINGS, found->inner, found->near);
    find_outer(system, found);
    find_takers(system->num_free, base_free, source, found);
    return PLIANT_OK;
}

/* ---- The local stiffness, in tiles: inner unknowns, padded to complete tiles, then outer ones. */

struct near_matrix { double *tiles, *whole; int inner, begin; }; /* nodes; first outer unknown */

static __device__ __forceinline__ int unknown_of(const near_matrix &matrix, int place)
{
    return place < matrix.inner ? 3 * place : matrix.begin + 3 * (place - matrix.inner);
}

static __device__ __forceinline__ void add(const near_matrix &matrix, int row, int column, double value)
{
    const int i = row / SWEEP, j = column / SWEEP, r = row % SWEEP, c = column % SWEEP;
    double *tile = matrix.tiles + SWEEP_TILE * triangle((size_t)i, (size_t)j);
    const double sum = tile[SWEEP * r + c] + value;
    tile[SWEEP * r + c] = sum;
    if (i == j) tile[SWEEP * c + r] = sum;
}

static __device__ double entry_at_rest(const gpu_system &system, int tet, int row, int column)
{
    const size_t stride = (size_t)system.tet_stride;
    if (system.d_stiffness) return system.d_stiffness[(size_t)(12 * row + column) * stride + (size_t)tet];
    double a[3], b[3];
    for (int d = 0; d < 3; d++) {
        a[d] = system.d_gradients[(size_t)(3 * (row / 3) + d) * stride + (size_t)tet];
        b[d] = system.d_gradients[(size_t)(3 * (column / 3) + d) * stride + (size_t)tet];
    }
    return pliant_isotropic_entry(a, b, system.d_lame[tet], system.d_lame[stride + (size_t)tet], row % 3, column % 3);
}

/* Compute an entry of a hexahedron, or of a tetrahedron next to a cut, from its root. */
static __device__ double macro_entry_at_rest(const gpu_macros &macros, int element, int unknowns, int row, int column)
{
    const float *root = macros.d_root + macros.d_root_start[element];
    double sum = 0;
    for (int m = 0; m < macros.d_rank[element]; m++)
        sum += (double)root[m * unknowns + row] * root[m * unknowns + column];
    return sum;
}

/* Assemble the columns of one inner node per block, from the diagonal down, element by element. Nine threads handle a
 * corner of the element, up to eight corners at a time. */
static __global__ void __launch_bounds__(MACRO_ENTRIES)
    assemble_kernel(gpu_system system, gpu_carried carried, near_matrix matrix)
{
    const int own = (int)blockIdx.x, node = carried.d_near[own], at = unknown_of(matrix, own);
    const int r = (int)threadIdx.x / 3 % 3, c = (int)threadIdx.x % 3;
    const gpu_macros &macros = system.macros;
    const bool of_macros = macros.count > 0;
    for (int n = system.d_corner_start[node]; n < system.d_corner_end[node]; n++) {
        const int corner = system.d_corner[n], element = of_macros ? macros.d_cube_of_corner[corner] : corner / 4;
        const int begin = of_macros ? macros.d_start[element] : 4 * element,
                  corners = of_macros ? macros.d_start[element + 1] - begin : 4;
        for (int w = (int)threadIdx.x / 9; w < corners; w += (int)blockDim.x / 9) {
            const int place = carried.d_place[(of_macros ? macros.d_node : system.d_tets)[begin + w]] - 1;
            if (place < own || (place == own && r < c)) continue;
            const int row = 3 * w + r, column = 3 * (corner - begin) + c;
            add(matrix, unknown_of(matrix, place) + r, at + c,
                of_macros ? macro_entry_at_rest(macros, element, 3 * corners, row, column)
                          : entry_at_rest(system, element, row, column));
        }
        __syncthreads();
    }
    if (threadIdx.x >= 3) return;
    const int row = at + (int)threadIdx.x, tile = row / SWEEP, place = row % SWEEP;
    matrix.whole[row] = matrix.tiles[SWEEP_TILE * triangle((size_t)tile, (size_t)tile) + SWEEP * place + place];
}

static __global__ void pad_kernel(near_matrix matrix)
{
    const int n = 3 * matrix.inner + (int)threadIdx.x;
    if (n >= matrix.begin) return;
    put(matrix.tiles, n, n, 1);
    matrix.whole[n] = 1;
}

/* Convert the matrix to single precision, one block per row. */
static __global__ void __launch_bounds__(THREADS) narrow_kernel(gpu_carried carried, near_matrix matrix)
{
    const int n = (int)blockIdx.x, inner = n < 3 * matrix.inner, row = inner ? n : matrix.begin + n - 3 * matrix.inner;
    for (int column = (int)threadIdx.x; column < 3 * matrix.inner; column += THREADS) {
        const int high = row / SWEEP >= column / SWEEP ? row : column, low = high == row ? column : row;
        const double value = matrix.tiles[SWEEP_TILE * triangle((size_t)(high / SWEEP), (size_t)(low / SWEEP)) +
                                          SWEEP * (high % SWEEP) + low % SWEEP];
        carried.d_answer[(size_t)n * carried.stride + column] = (float)(inner ? -value : value);
    }
}

/* ---- Creation. */

template <class T> static pliant_status capacity_for(size_t count, int array, gpu_carried_capacity *capacity, T **d_out)
{
    return pliant_cuda_ensure(count * sizeof(T), true, "the preconditioner", d_out, capacity->bytes + array);
}

template <class T>
static pliant_status send(const T *h_from, size_t count, int array, cudaStream_t stream, gpu_carried_capacity *capacity,
                          T **d_out)
{
    CUDA_TRY(capacity_for(count, array, capacity, d_out));
    return pliant_cuda_send(h_from, count * sizeof(T), *d_out, stream);
}

static pliant_status invert(const gpu_system *gpu, int32_t pivots, int32_t tiles, cudaStream_t stream,
                            gpu_carried *carried, gpu_carried_capacity *capacity)
{
    gpu_sweep *sweep = &capacity->sweep;
    const char *what = "the preconditioner";
    const size_t bytes = pliant_cuda_sweep_bytes(tiles), buffer = pliant_cuda_sweep_buffer_bytes(tiles),
                 failed = ((size_t)SWEEP * (size_t)pivots + 1) * sizeof(double);
    CUDA_TRY(pliant_cuda_ensure(bytes, true, what, &sweep->d_tiles, capacity->sweep_capacity));
    CUDA_TRY(pliant_cuda_ensure(buffer, true, what, &sweep->d_buffer, capacity->sweep_capacity + 1));
    CUDA_TRY(pliant_cuda_ensure(failed, true, what, &sweep->d_failed, capacity->sweep_capacity + 2));
    const near_matrix matrix = {sweep->d_tiles, reinterpret_cast<double *>(sweep->d_failed) + 1, carried->inner,
                                SWEEP * pivots};
    const unsigned rows = 3 * (unsigned)(carried->inner + carried->outer);
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(sweep->d_tiles, 0, bytes, stream)));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(sweep->d_failed, 0, failed, stream)));
    const int threads = gpu->macros.count > 0 ? MACRO_ENTRIES : ENTRIES;
    assemble_kernel<<<(unsigned)carried->inner, threads, 0, stream>>>(*gpu, *carried, matrix);
    CUDA_TRY(CUDA_LAUNCHED("assemble_kernel"));
    pad_kernel<<<1, SWEEP, 0, stream>>>(matrix);
    CUDA_TRY(CUDA_LAUNCHED("pad_kernel"));
    CUDA_TRY(pliant_cuda_sweep(sweep, matrix.whole, hinge, pivots, tiles, stream));
    narrow_kernel<<<rows, THREADS, 0, stream>>>(*carried, matrix);
    return CUDA_LAUNCHED("narrow_kernel");
}

static pliant_status send_all(const pliant_system *system, const gpu_system *gpu, const neighbours &found,
                              const int32_t *h_source, cudaStream_t stream, gpu_carried *carried,
                              gpu_carried_capacity *capacity)
{
    const size_t inner = 3 * (size_t)carried->inner, outer = 3 * (size_t)carried->outer,
                 free_nodes = (size_t)carried->num_free;
    const size_t padded = (size_t)pliant_cuda_inverse_padded(3 * carried->base_free);
    CUDA_TRY(send(h_source, free_nodes, SOURCE, stream, capacity, &carried->d_source));
    CUDA_TRY(send(found.taker_start, (size_t)carried->base_free + 1, TAKER_START, stream, capacity,
                  &carried->d_taker_start));
    CUDA_TRY(send(found.taker, free_nodes, TAKER, stream, capacity, &carried->d_taker));
    CUDA_TRY(send(found.place, (size_t)system->mesh->num_nodes, PLACE, stream, capacity, &carried->d_place));
    CUDA_TRY(capacity_for(padded, RIGHT, capacity, &carried->d_right));
    CUDA_TRY(capacity_for(padded, LEFT, capacity, &carried->d_left));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(carried->d_right, 0, padded * sizeof(float), stream)));
    if (carried->inner == 0) return PLIANT_OK;
    CUDA_TRY(send(found.near, (size_t)found.num_near, NEAR, stream, capacity, &carried->d_near));
    CUDA_TRY(capacity_for((inner + outer) * (size_t)carried->stride, ANSWER, capacity, &carried->d_answer));
    CUDA_TRY(capacity_for(inner, FOUND, capacity, &carried->d_found));
    CUDA_TRY(capacity_for(outer, PULL, capacity, &carried->d_pull));
    const int32_t pivots = (int32_t)((inner + SWEEP - 1) / SWEEP),
                  tiles = pivots + (int32_t)((outer + SWEEP - 1) / SWEEP);
    return invert(gpu, pivots, tiles, stream, carried, capacity);
}

pliant_status pliant_cuda_carried_set(const pliant_system *system, const gpu_system *gpu,
                                      const pliant_carried_layout *base, int32_t *h_source, cudaStream_t stream,
                                      gpu_carried *carried, gpu_carried_capacity *capacity, bool *possible)
{
    neighbours found = {};
    pliant_status status = find_neighbours(system, base, h_source, &found);
    const int32_t outer = found.num_near - found.num_inner, pivots = (3 * found.num_inner + SWEEP - 1) / SWEEP,
                  tiles = pivots + (3 * outer + SWEEP - 1) / SWEEP;
    *possible = pivots <= MAX_SWEEPS && tiles <= MAX_TILES;
    if (status == PLIANT_OK && *possible) {
        carried->num_free = system->num_free;
        carried->base_free = base->num_free;
        carried->inner = found.num_inner;
        carried->outer = outer;
        carried->stride = (3 * found.num_inner + WARP - 1) / WARP * WARP;
        carried->d_node_of_free = gpu->d_node_of_free;
        pliant_free(capacity->h_source);
        capacity->h_source = h_source;
        status = send_all(system, gpu, found, h_source, stream, carried, capacity);
    } else {
        pliant_free(h_source);
    }
    neighbours_free(&found);
    return status;
}

void pliant_cuda_carried_clear(gpu_carried *carried, gpu_carried_capacity *capacity)
{
    carried->base_free = 0;
    pliant_free(capacity->h_source);
    capacity->h_source = nullptr;
}

void pliant_cuda_carried_free(gpu_carried *carried, gpu_carried_capacity *capacity)
{
    pliant_cuda_release(carried->d_source, carried->d_taker_start, carried->d_taker, carried->d_near, carried->d_place,
                        carried->d_answer, carried->d_found, carried->d_pull, carried->d_right, carried->d_left,
                        capacity->sweep.d_tiles, capacity->sweep.d_buffer, capacity->sweep.d_failed);
    pliant_free(capacity->h_source);
    memset(carried, 0, sizeof *carried);
    memset(capacity, 0, sizeof *capacity);
}

/* ---- In a step. */

/* Compute S r_i and K_oi S r_i, one warp per row. */
static __global__ void __launch_bounds__(THREADS)
    near_kernel(gpu_carried carried, const int *d_skip, const float *__restrict__ d_right)
{
    if (d_skip && *d_skip) return;
    const int row = (int)(blockIdx.x * THREADS + threadIdx.x) / WARP, lane = (int)threadIdx.x % WARP,
              inner = 3 * carried.inner;
    if (row >= inner + 3 * carried.outer) return;
    float sum = 0;
    for (int column = lane; column < inner; column += WARP)
        sum += carried.d_answer[(size_t)row * carried.stride + column] *
               d_right[3 * carried.d_near[column / 3] + column % 3];
    sum = warp_sum(sum);
    if (lane != 0) return;
    if (row < inner) carried.d_found[row] = sum;
    else carried.d_pull[row - inner] = sum;
}

/* Compute P' E' r, one thread per number of the base. */
static __global__ void __launch_bounds__(THREADS)
    below_kernel(gpu_carried carried, const int *d_skip, const float *__restrict__ d_right)
{
    if (d_skip && *d_skip) return;
    const int n = (int)(blockIdx.x * THREADS + threadIdx.x), base = n / 3, d = n % 3;
    if (base >= carried.base_free) return;
    float sum = 0;
    for (int t = carried.d_taker_start[base]; t < carried.d_taker_start[base + 1]; t++) {
        const int f = carried.d_taker[t], place = carried.d_place[carried.d_node_of_free[f]] - 1;
        if (place >= 0 && place < carried.inner) continue;
        const float pull = place >= 0 ? carried.d_pull[3 * (place - carried.inner) + d] : 0;
        sum += d_right[3 * f + d] - pull;
    }
    carried.d_right[n] = sum;
}

static __device__ __forceinline__ float above(const gpu_carried &carried, int f, int d)
{
    const int source = carried.d_source[f];
    return source >= 0 ? carried.d_left[3 * source + d] : 0;
}

/* Compute E P z + S r. Blocks handle inner unknowns with some columns of K_oi S each; then one thread per number
 * handles the others. */
static __global__ void __launch_bounds__(COLUMNS *GROUPS)
    above_kernel(gpu_carried carried, const int *d_skip, float *__restrict__ d_left)
{
    __shared__ float sums[GROUPS][COLUMNS];
    if (d_skip && *d_skip) return;
    const int inner = 3 * carried.inner, outer = 3 * carried.outer, blocks = (inner + COLUMNS - 1) / COLUMNS;
    if ((int)blockIdx.x >= blocks) {
        const int n = ((int)blockIdx.x - blocks) * COLUMNS * GROUPS + (int)threadIdx.x, f = n / 3;
        if (f >= carried.num_free) return;
        const int place = carried.d_place[carried.d_node_of_free[f]] - 1;
        if (place < 0 || place >= carried.inner) d_left[n] = above(carried, f, n % 3);
        return;
    }
    const int column = (int)blockIdx.x * COLUMNS + (int)threadIdx.x % COLUMNS, group = (int)threadIdx.x / COLUMNS;
    float sum = 0;
    if (column < inner) {
#pragma unroll 4
        for (int row = group; row < outer; row += GROUPS)
            sum += carried.d_answer[(size_t)(inner + row) * carried.stride + column] *
                   above(carried, carried.d_near[carried.inner + row / 3], row % 3);
    }
    sums[group][threadIdx.x % COLUMNS] = sum;
    __syncthreads();
    if (group != 0 || column >= inner) return;
    for (int g = 1; g < GROUPS; g++) sum += sums[g][threadIdx.x];
    d_left[3 * carried.d_near[column / 3] + column % 3] = carried.d_found[column] - sum;
}

pliant_status pliant_cuda_carried_restrict(const gpu_carried *carried, const int32_t *d_skip, const float *d_right,
                                           cudaStream_t stream)
{
    if (carried->inner > 0) {
        near_kernel<<<blocks_for(3 * (carried->inner + carried->outer), THREADS / WARP), THREADS, 0, stream>>>(
            *carried, d_skip, d_right);
        CUDA_TRY(CUDA_LAUNCHED("near_kernel"));
    }
    below_kernel<<<blocks_for(3 * carried->base_free, THREADS), THREADS, 0, stream>>>(*carried, d_skip, d_right);
    return CUDA_LAUNCHED("below_kernel");
}

pliant_status pliant_cuda_carried_extend(const gpu_carried *carried, const int32_t *d_skip, float *d_left,
                                         cudaStream_t stream)
{
    const unsigned near = blocks_for(3 * carried->inner, COLUMNS),
                   rest = blocks_for(3 * carried->num_free, COLUMNS * GROUPS);
    above_kernel<<<near + rest, COLUMNS * GROUPS, 0, stream>>>(*carried, d_skip, d_left);
    return CUDA_LAUNCHED("above_kernel");
}

pliant_status pliant_cuda_carried_load_kernels(void)
{
    return pliant_cuda_load_kernels(assemble_kernel, pad_kernel, narrow_kernel, near_kernel, below_kernel,
                                    above_kernel);
}
