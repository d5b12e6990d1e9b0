/* Overlapping tetrahedra on the GPU: a list of tetrahedra for every cell of a grid, then pairs in a list whose
 * boxes intersect, then the overlap test.
 *
 * The grid is unbounded: a hash of a cell's position selects its list, and each entry names its cell. The lengths
 * of the lists are counted first. Then the lists are stored one after the other, and threads share the entries
 * after each entry. The order of the pairs varies; they are sorted when they are copied to the host. */
#include "cuda/contact/overlaps.cuh"
#include "cuda/base/launch.h"

#include "contact/detect/overlap.h"
#include "base/fail.h"
#include "base/memory.h"

#include <cstring>

using namespace overlaps;

namespace {

enum {
    THREADS = 128,
    WARPS = THREADS / 32,
    LANES_OF_TET = 8 /* threads that share the cells of a tetrahedron */,
    LANES_OF_ENTRY = 8 /* threads that share the list of an entry */
};

/* The cells that a box covers; none if the box is not finite, or too large. */
struct cells {
    int32_t low[3], wide[3], count;
    __device__ cells(const view &v, const tet_box &box) : count(0)
    {
        double sum = 0;
        for (int d = 0; d < 3; d++) sum += box.low[d] + box.high[d];
        if (!isfinite(sum)) return;
        const double side = v.now->side,
                     widest = fmax(box.high[0] - box.low[0], fmax(box.high[1] - box.low[1], box.high[2] - box.low[2]));
        const number wide_as = (number)fmin(ceil(widest / v.now->fine), GPU_MAX_FINE_CELLS);
        if (wide_as > GPU_MAX_CELLS) atomicMax(v.counts + CELLS, wide_as);
        if (wide_as > v.now->maximum) return;
        count = 1;
        for (int d = 0; d < 3; d++) {
            low[d] = cell_of(side, box.low[d]);
            wide[d] = cell_of(side, box.high[d]) - low[d] + 1;
            count *= wide[d];
        }
    }
    __device__ void place(int32_t n, int32_t at[3]) const
    {
        at[0] = low[0] + n % wide[0];
        at[1] = low[1] + n / wide[0] % wide[1];
        at[2] = low[2] + n / (wide[0] * wide[1]);
    }
};

__global__ void __launch_bounds__(THREADS) count_kernel(view v)
{
    const int32_t i = (int32_t)(((size_t)blockIdx.x * THREADS + threadIdx.x) / LANES_OF_TET),
                  lane = (int32_t)threadIdx.x % LANES_OF_TET;
    if (i >= v.count) return;
    const int4 nodes = *(const int4 *)(v.tets + 4 * (size_t)v.tet[i]);
    const int32_t node[4] = {nodes.x, nodes.y, nodes.z, nodes.w};
    tet_box box;
    bool finite = true;
    for (int d = 0; d < 3; d++) {
        double x[4];
        for (int k = 0; k < 4; k++) {
            x[k] = v.positions[3 * (size_t)node[k] + d];
            finite = finite && isfinite(x[k]);
        }
        box.low[d] = fmin(fmin(x[0], x[1]), fmin(x[2], x[3])) - v.now->margin;
        box.high[d] = fmax(fmax(x[0], x[1]), fmax(x[2], x[3])) + v.now->margin;
    }
    if (!finite) box.low[0] = NAN; /* minima ignore NaN */
    if (lane == 0) v.box[i] = box;
    const cells of(v, box);
    for (int32_t n = lane; n < of.count; n += LANES_OF_TET) {
        int32_t at[3];
        of.place(n, at);
        atomicAdd(v.length + hash_of(v, at[0], at[1], at[2]), 1);
    }
}

/* One thread for each list: compute its start. The order of the lists depends on the order of the warps. */
__global__ void __launch_bounds__(THREADS) start_kernel(view v)
{
    const int32_t list = (int32_t)(blockIdx.x * THREADS + threadIdx.x), lane = (int32_t)threadIdx.x % 32;
    const int32_t length = list <= v.table ? v.length[list] : 0;
    number before = (number)length, first = 0;
    for (int step = 1; step < 32; step *= 2) {
        const number other = __shfl_up_sync(0xffffffffu, before, step);
        if (lane >= step) before += other;
    }
    if (lane == 31) first = atomicAdd(v.counts + ENTRIES, before);
    first = __shfl_sync(0xffffffffu, first, 31) + before - (number)length;
    if (list <= v.table) v.start[list] = v.next[list] = (int32_t)min(first, (number)INT32_MAX);
}

__global__ void __launch_bounds__(THREADS) fill_kernel(view v)
{
    const int32_t i = (int32_t)(((size_t)blockIdx.x * THREADS + threadIdx.x) / LANES_OF_TET),
                  lane = (int32_t)threadIdx.x % LANES_OF_TET;
    if (i >= v.count || !are_whole(v)) return;
    const tet_box box = v.box[i];
    const cells of(v, box);
    entry one;
    one.tet = i;
    for (int d = 0; d < 3; d++) {
        one.low[d] = __double2float_rd(box.low[d]);
        one.high[d] = __double2float_ru(box.high[d]);
    }
    for (int32_t n = lane; n < of.count; n += LANES_OF_TET) {
        int32_t at[3];
        of.place(n, at);
        const uint32_t list = hash_of(v, at[0], at[1], at[2]);
        const int32_t where = atomicAdd(v.next + list, 1);
        one.cell = key_of(at[0], at[1], at[2]);
        one.end = v.start[list] + v.length[list];
        v.entries[where] = one;
    }
}

struct candidate_pair { unsigned long long cell; int32_t a, b; };

/* Queues of one warp: pairs whose boxes intersect, and pairs for the overlap test. They collect work for all
 * threads of the warp. */
struct warp_queues { candidate_pair pairs[64]; int2 tests[64]; };
struct queue_counts { int pairs, tests; };

/* Select pairs without a common node, in the one cell that contains the lowest corner of the boxes' intersection. */
__device__ bool is_for_test(const view &v, const candidate_pair &pair)
{
    const tet_box mine = v.box[pair.a], other = v.box[pair.b];
    const int4 m = *(const int4 *)(v.tets + 4 * (size_t)v.tet[pair.a]),
               o = *(const int4 *)(v.tets + 4 * (size_t)v.tet[pair.b]);
    const int32_t a[4] = {m.x, m.y, m.z, m.w}, b[4] = {o.x, o.y, o.z, o.w};
    int32_t home[3];
    bool is = true;
    for (int k = 0; k < 4; k++)
        for (int l = 0; l < 4; l++) is = is && a[k] != b[l];
    for (int d = 0; d < 3; d++) {
        is = is && mine.low[d] < other.high[d] && other.low[d] < mine.high[d];
        home[d] = cell_of(v.now->side, fmax(mine.low[d], other.low[d]));
    }
    return is && key_of(home[0], home[1], home[2]) == pair.cell;
}

__device__ bool overlap(const view &v, int2 pair)
{
    const int32_t *a = v.tets + 4 * (size_t)v.tet[pair.x], *b = v.tets + 4 * (size_t)v.tet[pair.y];
    double x[3][4], y[3][4];
    for (int k = 0; k < 4; k++)
        for (int d = 0; d < 3; d++) {
            x[d][k] = v.positions[3 * (size_t)a[k] + d];
            y[d][k] = v.positions[3 * (size_t)b[k] + d];
        }
    return pliant_tets_overlap(x, y);
}

/* Test the last `count` pairs of the queue, one in each thread. */
__device__ void test(const view &v, const warp_queues &on, queue_counts &left, int count)
{
    const int lane = (int)threadIdx.x % 32;
    __syncwarp();
    left.tests -= count;
    const int2 pair = lane < count ? on.tests[left.tests + lane] : make_int2(0, 0);
    const bool is = lane < count && overlap(v, pair);
    const unsigned all = __ballot_sync(0xffffffffu, is);
    number first = 0;
    if (lane == 0 && all != 0) first = atomicAdd(v.counts + PAIRS, (number)__popc(all));
    first = __shfl_sync(0xffffffffu, first, 0) + (number)__popc(all & ((1u << lane) - 1));
    if (is && first < v.capacity[PAIRS])
        v.pairs[first] = make_int2(min(v.tet[pair.x], v.tet[pair.y]), max(v.tet[pair.x], v.tet[pair.y]));
    __syncwarp();
}

/* Select from the last `count` pairs of the queue, likewise. */
__device__ void select_pairs(const view &v, warp_queues &on, queue_counts &left, int count)
{
    const int lane = (int)threadIdx.x % 32;
    __syncwarp();
    left.pairs -= count;
    const bool is = lane < count && is_for_test(v, on.pairs[left.pairs + lane]);
    const unsigned all = __ballot_sync(0xffffffffu, is);
    if (is)
        on.tests[left.tests + __popc(all & ((1u << lane) - 1))] =
            make_int2(on.pairs[left.pairs + lane].a, on.pairs[left.pairs + lane].b);
    left.tests += __popc(all);
    if (left.tests >= 32) test(v, on, left, 32);
    __syncwarp();
}

/* Compare each entry with the following entries of its list. */
__global__ void __launch_bounds__(THREADS) pair_kernel(view v)
{
    __shared__ warp_queues desks[WARPS];
    warp_queues &on = desks[threadIdx.x / 32];
    queue_counts left = {0, 0};
    const int lane = (int)threadIdx.x % 32, step = 32 / LANES_OF_ENTRY;
    if (!are_whole(v)) return;
    const int32_t entries = (int32_t)v.counts[ENTRIES];
    for (int64_t first = (int64_t)(blockIdx.x * WARPS + threadIdx.x / 32) * step; first < entries;
         first += (int64_t)(gridDim.x * WARPS) * step) {
        const int32_t at = (int32_t)min(first + lane / LANES_OF_ENTRY, (int64_t)entries);
        const entry mine = v.entries[min(at, entries - 1)];
        const int32_t end = at < entries ? min(mine.end, entries) : 0;
        for (int32_t k = at + 1 + lane % LANES_OF_ENTRY; __any_sync(0xffffffffu, k < end); k += LANES_OF_ENTRY) {
            bool meets = k < end;
            int32_t other = 0;
            if (meets) {
                const entry one = v.entries[k];
                other = one.tet;
                meets = one.cell == mine.cell;
                for (int d = 0; d < 3; d++) meets = meets && mine.low[d] < one.high[d] && one.low[d] < mine.high[d];
            }
            const unsigned all = __ballot_sync(0xffffffffu, meets);
            if (meets)
                on.pairs[left.pairs + __popc(all & ((1u << lane) - 1))] = {mine.cell, min(mine.tet, other),
                                                                           max(mine.tet, other)};
            left.pairs += __popc(all);
            if (left.pairs >= 32) select_pairs(v, on, left, 32);
        }
    }
    select_pairs(v, on, left, left.pairs);
    test(v, on, left, left.tests);
}

} // namespace

struct gpu_overlaps {
    view v;
    int32_t *d_tets, *d_tet;
    number *h_counts;
    step *d_now, *h_now;
    gpu_cells cells;
    size_t entries_bytes, pairs_bytes;
    int blocks; /* that run on the device at the same time */
    cudaGraphExec_t graph; /* Nullable: recorded for made_for */
    view made_for;
    int32_t found;
};

void gpu_overlaps_free(gpu_overlaps *overlaps)
{
    if (!overlaps) return;
    if (overlaps->graph) cudaGraphExecDestroy(overlaps->graph);
    void *blocks[] = {overlaps->d_tets,   overlaps->d_tet,     overlaps->d_now,  overlaps->v.box,
                      overlaps->v.counts, overlaps->v.entries, overlaps->v.pairs};
    for (void *block : blocks) pliant_cuda_release(block);
    pliant_cuda_release_host(overlaps->h_counts);
    pliant_cuda_release_host(overlaps->h_now);
    pliant_free(overlaps);
}

/* Grow the buffers to these numbers. */
static pliant_status reserve_capacity(gpu_overlaps *overlaps, const number counts[CELLS])
{
    view *v = &overlaps->v;
    if (counts[ENTRIES] > INT32_MAX || counts[PAIRS] > INT32_MAX)
        return pliant_fail(
            PLIANT_ERROR_MEMORY,
            "collision detection: %llu grid entries and %llu pairs of tetrahedra are too many for the GPU",
            counts[ENTRIES], counts[PAIRS]);
    CUDA_TRY(pliant_cuda_ensure((size_t)counts[ENTRIES] * sizeof *v->entries, true, "cells of tetrahedra",
                                (void **)&v->entries, &overlaps->entries_bytes));
    CUDA_TRY(pliant_cuda_ensure((size_t)counts[PAIRS] * sizeof *v->pairs, true, "pairs of tetrahedra",
                                (void **)&v->pairs, &overlaps->pairs_bytes));
    v->capacity[ENTRIES] = std::min<size_t>(overlaps->entries_bytes / sizeof *v->entries, INT32_MAX);
    v->capacity[PAIRS] = std::min<size_t>(overlaps->pairs_bytes / sizeof *v->pairs, INT32_MAX);
    return PLIANT_OK;
}

static pliant_status prepare(gpu_overlaps *overlaps, int32_t num_tets, const int32_t *tets, int32_t count,
                             const int32_t *tet, double side, cudaStream_t stream)
{
    view *v = &overlaps->v;
    int device = 0, processors = 0;
    const number counts[CELLS] = {8 * (number)count + 1024, 2 * (number)count + 1024};
    int32_t table = 1024;
    while (table < (int64_t)count && table < 1 << 28) table *= 2;
    v->count = count;
    v->table = table - 1;
    overlaps->cells = {side, 1, 1};
    CUDA_TRY(CUDA_CALL(cudaGetDevice(&device)));
    CUDA_TRY(CUDA_CALL(cudaDeviceGetAttribute(&processors, cudaDevAttrMultiProcessorCount, device)));
    overlaps->blocks = 16 * processors;
    CUDA_TRY(pliant_cuda_upload(tets, 4 * (size_t)num_tets * sizeof *tets, "tetrahedra", stream,
                                (void **)&overlaps->d_tets));
    CUDA_TRY(pliant_cuda_upload(tet, (size_t)count * sizeof *tet, "tetrahedra at the surface", stream,
                                (void **)&overlaps->d_tet));
    v->tets = overlaps->d_tets;
    v->tet = overlaps->d_tet;
    CUDA_TRY(pliant_cuda_allocate((size_t)count * sizeof *v->box, "boxes of tetrahedra", (void **)&v->box));
    CUDA_TRY(pliant_cuda_allocate(NUM_COUNTS * sizeof *v->counts + 3 * (size_t)table * sizeof *v->length,
                                  "cells of tetrahedra", (void **)&v->counts));
    v->length = reinterpret_cast<int32_t *>(v->counts + NUM_COUNTS);
    v->start = v->length + table;
    v->next = v->start + table;
    CUDA_TRY(pliant_cuda_allocate_host(NUM_COUNTS * sizeof *overlaps->h_counts, "pairs of tetrahedra",
                                       (void **)&overlaps->h_counts));
    CUDA_TRY(pliant_cuda_allocate(sizeof *overlaps->d_now, "pairs of tetrahedra", (void **)&overlaps->d_now));
    CUDA_TRY(pliant_cuda_allocate_host(sizeof *overlaps->h_now, "pairs of tetrahedra", (void **)&overlaps->h_now));
    v->now = overlaps->d_now;
    return reserve_capacity(overlaps, counts);
}

pliant_status gpu_overlaps_create(int32_t num_tets, const int32_t *tets, int32_t count, const int32_t *tet, double side,
                                  cudaStream_t stream, gpu_overlaps **out)
{
    gpu_overlaps *overlaps = (gpu_overlaps *)pliant_calloc(1, sizeof *overlaps);
    if (!overlaps) return pliant_fail(PLIANT_ERROR_MEMORY, "out of memory: pairs of tetrahedra");
    const pliant_status status = prepare(overlaps, num_tets, tets, count, tet, side, stream);
    if (status == PLIANT_OK) *out = overlaps;
    else gpu_overlaps_free(overlaps);
    return status;
}

static pliant_status enqueue(gpu_overlaps *overlaps, cudaStream_t stream)
{
    const view &v = overlaps->v;
    const unsigned shared = (unsigned)(((size_t)v.count * LANES_OF_TET + THREADS - 1) / THREADS),
                   lists = (unsigned)((v.table + THREADS) / THREADS);
    CUDA_TRY(CUDA_CALL(
        cudaMemcpyAsync(overlaps->d_now, overlaps->h_now, sizeof *overlaps->h_now, cudaMemcpyHostToDevice, stream)));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(
        v.counts, 0, NUM_COUNTS * sizeof *v.counts + ((size_t)v.table + 1) * sizeof *v.length, stream)));
    count_kernel<<<shared, THREADS, 0, stream>>>(v);
    CUDA_TRY(CUDA_LAUNCHED("count_kernel"));
    start_kernel<<<lists, THREADS, 0, stream>>>(v);
    CUDA_TRY(CUDA_LAUNCHED("start_kernel"));
    fill_kernel<<<shared, THREADS, 0, stream>>>(v);
    CUDA_TRY(CUDA_LAUNCHED("fill_kernel"));
    pair_kernel<<<(unsigned)overlaps->blocks, THREADS, 0, stream>>>(v);
    CUDA_TRY(CUDA_LAUNCHED("pair_kernel"));
    return CUDA_CALL(
        cudaMemcpyAsync(overlaps->h_counts, v.counts, NUM_COUNTS * sizeof *v.counts, cudaMemcpyDeviceToHost, stream));
}

/* Record the work of a step as one CUDA graph. */
static pliant_status record(gpu_overlaps *overlaps, cudaStream_t stream)
{
    if (overlaps->graph && memcmp(&overlaps->made_for, &overlaps->v, sizeof overlaps->v) == 0) return PLIANT_OK;
    overlaps->made_for = overlaps->v;
    return pliant_cuda_record(stream, &overlaps->graph, [&] { return enqueue(overlaps, stream); });
}

pliant_status gpu_overlaps_find(gpu_overlaps *overlaps, const double *d_positions, double margin, cudaStream_t stream,
                                gpu_overlaps_more more, void *context, int32_t *count)
{
    overlaps->found = *count = 0;
    overlaps->v.positions = d_positions;
    if (overlaps->v.count == 0) return PLIANT_OK;
    for (bool again = true; again;) { /* entries and pairs are counted also if they do not fit */
        /* maximum number of entries in the grid */
        const number *h_counts = overlaps->h_counts, maximum = 64 * (number)overlaps->v.count + 1024;
        gpu_cells *cells = &overlaps->cells;
        *overlaps->h_now = {cells->side * gpu_cells_coarser(cells), cells->side, margin, gpu_cells_max(cells)};
        CUDA_TRY(record(overlaps, stream));
        CUDA_TRY(CUDA_CALL(cudaGraphLaunch(overlaps->graph, stream)));
        if (more) CUDA_TRY(more(context, overlaps));
        CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(stream)));
        const bool coarser = gpu_cells_update(cells, h_counts[CELLS], h_counts[ENTRIES], maximum);
        again = coarser || h_counts[ENTRIES] > overlaps->v.capacity[ENTRIES] ||
                h_counts[PAIRS] > overlaps->v.capacity[PAIRS];
        if (again && !coarser) CUDA_TRY(reserve_capacity(overlaps, h_counts));
    }
    overlaps->found = *count = (int32_t)overlaps->h_counts[PAIRS];
    return PLIANT_OK;
}

const view &gpu_overlaps_view(const gpu_overlaps *overlaps) { return overlaps->v; }

pliant_status gpu_overlaps_get_pairs(const gpu_overlaps *overlaps, cudaStream_t stream, int32_t *pair)
{
    if (overlaps->found == 0) return PLIANT_OK;
    const size_t count = (size_t)overlaps->found;
    CUDA_TRY(CUDA_CALL(
        cudaMemcpyAsync(pair, overlaps->v.pairs, count * sizeof *overlaps->v.pairs, cudaMemcpyDeviceToHost, stream)));
    CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(stream)));
    int2 *first = (int2 *)pair;
    std::sort(first, first + count, [](const int2 &a, const int2 &b) { return a.x != b.x ? a.x < b.x : a.y < b.y; });
    return PLIANT_OK;
}
