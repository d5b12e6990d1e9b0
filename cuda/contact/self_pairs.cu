/* The surface against itself. Groups of 32 triangles are adjacent in the tree. Near groups are found first, then pairs
 * of triangles whose boxes are near each other, then pairs of nodes and triangles and pairs of edges. Each list is
 * counted, a prefix sum computes where its parts start, and then it is written. So the order does not vary. */
#include "cuda/contact/self_pairs.h"

#include "base/buffer.h"
#include "base/fail.h"
#include "base/memory.h"
#include "contact/advance/self_rules.h"
#include "cuda/base/launch.h"
#include "cuda/base/prefix_sum.cuh"

#include <algorithm>
#include <climits>
#include <cstring>

namespace {

enum {
    THREADS = 128,
    GROUP = 32 /* triangles, one for each thread of a warp */,
    WARPS = 8 /* for each group */,
    SCAN_THREADS = 1024,
    FIRST_PAIRS = 1024
};

/* Numbers of pairs of triangles, of pairs, and of edges that cross a triangle. */
struct totals { int32_t near, pairs, crossings; };

/* Pointers are device pointers. */
struct view {
    int32_t num_triangles, num_groups;
    const int32_t *order;           /* (num_triangles) */
    pliant_advance_box *box;        /* (num_groups x GROUP) in order; empty beyond the triangles */
    pliant_advance_box *around;     /* (num_groups) */
    int32_t *warp_start;            /* (num_groups x WARPS) number of triangle pairs, then their start */
    int2 *near;                     /* (max_near) pairs of triangles, as indices into order */
    uint8_t *near_count;            /* (max_near) pairs that each of them has */
    int32_t *part_start;            /* (max_near / THREADS) number of pairs, then their start */
    pliant_advance_self_pair *pair; /* (max_pairs) */
    int32_t max_near, max_pairs;
    totals *found;
    pliant_advance_self_search search;
};

/* ---- kernels */

__device__ __forceinline__ void enlarge(pliant_advance_box *box, int lanes)
{
    for (int d = 0; d < 3; d++) {
        box->low[d] = fmin(box->low[d], __shfl_xor_sync(0xffffffffu, box->low[d], lanes));
        box->high[d] = fmax(box->high[d], __shfl_xor_sync(0xffffffffu, box->high[d], lanes));
    }
}

/* One thread for each triangle, one warp for each group. */
__global__ void __launch_bounds__(THREADS) box_kernel(view v)
{
    const int32_t n = (int32_t)(blockIdx.x * THREADS + threadIdx.x);
    if (n / GROUP >= v.num_groups) return;
    pliant_advance_box box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    if (n < v.num_triangles)
        box = pliant_advance_box_of(3, v.search.triangles + 3 * (size_t)v.order[n], v.search.from, v.search.to);
    v.box[n] = box;
    for (int lanes = GROUP / 2; lanes > 0; lanes /= 2) enlarge(&box, lanes);
    if (n % GROUP == 0) v.around[n / GROUP] = box;
}

/* Test a group's triangles against several triangles, from n to end. Return the number of near pairs, to all threads of
 * the warp.
 * @param m this thread's triangle of the group, with the box `own`
 * @param room capacity of out
 * @param out Nullable: the pairs are only counted */
__device__ int32_t test_boxes(const view &v, const pliant_advance_box &own, int32_t m, int32_t n, int32_t end,
                              int32_t room, int2 *out)
{
    const unsigned before = (1u << (threadIdx.x % GROUP)) - 1;
    int32_t count = 0;
    for (; n < end; n++) {
        const bool is_near = n > m && !pliant_advance_boxes_separated(&own, v.box + n, v.search.margin);
        const unsigned near = __ballot_sync(0xffffffffu, is_near);
        const int32_t at = count + __popc(near & before);
        if (out && is_near && at < room) out[at] = make_int2(m, n);
        count += __popc(near);
    }
    return count;
}

/* Find the near pairs of each group with itself and with the groups after it. Each warp of a group tests a part of the
 * other group. */
template <bool writes> __global__ void __launch_bounds__(THREADS) near_kernel(view v)
{
    const int32_t warp = (int32_t)(blockIdx.x * THREADS + threadIdx.x) / 32, lane = (int32_t)threadIdx.x % 32,
                  group = warp / WARPS, part = GROUP / WARPS * (warp % WARPS), m = GROUP * group + lane;
    if (group >= v.num_groups) return;
    const pliant_advance_box own = v.box[m], around = v.around[group];
    const int32_t start = writes ? v.warp_start[warp] : 0;
    int32_t count = 0;
    for (int32_t first = group; first < v.num_groups; first += 32) {
        const int32_t other = first + lane;
        const bool is_near =
            other < v.num_groups && !pliant_advance_boxes_separated(&around, v.around + other, v.search.margin);
        for (unsigned near = __ballot_sync(0xffffffffu, is_near); near != 0; near &= near - 1) {
            const int32_t n = GROUP * (first + __ffs((int)near) - 1) + part;
            count += test_boxes(v, own, m, n, n + GROUP / WARPS, v.max_near - start - count,
                                writes ? v.near + start + count : nullptr);
        }
    }
    if (!writes && lane == 0) v.warp_start[warp] = count;
}

/* One block: replace counts by the sums of the counts before them. total: out */
__global__ void __launch_bounds__(SCAN_THREADS) scan_kernel(int32_t count, int32_t *counts, int32_t *total)
{
    __shared__ int32_t sums[SCAN_THREADS];
    int32_t before = 0;
    for (int32_t first = 0; first < count; first += SCAN_THREADS) {
        const int32_t n = first + (int32_t)threadIdx.x, own = n < count ? counts[n] : 0,
                      start = before + sum_before<SCAN_THREADS>(own, sums);
        if (n < count) counts[n] = start;
        before += sums[SCAN_THREADS - 1];
        __syncthreads();
    }
    if (threadIdx.x == 0) *total = before;
}

/* Return the number of triangle pairs in the buffer. */
__device__ __forceinline__ int32_t num_near(const view &v) { return min(v.found->near, v.max_near); }

/* Find the pairs of two triangles. tests_crossings: find their crossings, too */
template <bool tests_crossings>
__device__ __forceinline__ void test_triangles(const view &v, int32_t n, pliant_advance_self_list *out)
{
    const int2 two = v.near[n];
    const pliant_advance_box *const boxes[2] = {v.box + two.x, v.box + two.y};
    const int32_t a = v.order[two.x], b = v.order[two.y];
    if (tests_crossings) pliant_advance_try_crossings(&v.search, a, b, boxes, out);
    pliant_advance_try_pairs(&v.search, a, b, boxes, out);
}

/* One thread for each pair of triangles: count its pairs and crossings. Blocks share the parts of THREADS pairs. */
__global__ void __launch_bounds__(THREADS) count_kernel(view v)
{
    __shared__ int32_t sums[THREADS];
    for (int32_t part = (int32_t)blockIdx.x; part < (v.max_near + THREADS - 1) / THREADS; part += (int32_t)gridDim.x) {
        const int32_t n = THREADS * part + (int32_t)threadIdx.x;
        pliant_advance_self_list list = {nullptr, 0, 0, 0};
        if (n < num_near(v)) {
            test_triangles<true>(v, n, &list);
            v.near_count[n] = (uint8_t)list.count;
            if (list.crossings > 0) atomicAdd(&v.found->crossings, list.crossings);
        }
        sum_before<THREADS>(list.count, sums);
        if (threadIdx.x == 0) v.part_start[part] = sums[THREADS - 1];
        __syncthreads();
    }
}

/* One thread for each pair of triangles: write its pairs. */
__global__ void __launch_bounds__(THREADS) pair_kernel(view v)
{
    __shared__ int32_t sums[THREADS];
    for (int32_t part = (int32_t)blockIdx.x; THREADS * part < num_near(v); part += (int32_t)gridDim.x) {
        const int32_t n = THREADS * part + (int32_t)threadIdx.x, own = n < num_near(v) ? v.near_count[n] : 0,
                      at = v.part_start[part] + sum_before<THREADS>(own, sums);
        pliant_advance_self_list list = {v.pair + at, 0, v.max_pairs - at, 0};
        if (own > 0) test_triangles<false>(v, n, &list);
        __syncthreads();
    }
}

} // namespace

/* ---- host */

struct gpu_self_pairs {
    view v;
    int blocks; /* that run on the device at the same time */
    int32_t num_nodes;
    int32_t *d_order, *d_triangles, *d_piece;
    uint8_t *d_owns, *d_exempt, *d_crossing;
    totals *h_found;
    pliant_advance_self_pair *h_pair;
    uint8_t *h_crossing;
    size_t near_bytes, near_count_bytes, part_bytes, pair_bytes, h_pair_bytes;
};

static const char *const pairs_of_surface = "pairs of the surface";

extern "C" void gpu_self_pairs_free(gpu_self_pairs *pairs)
{
    if (!pairs) return;
    view *v = &pairs->v;
    pliant_cuda_release(pairs->d_order, pairs->d_triangles, pairs->d_piece, pairs->d_owns, pairs->d_exempt,
                        pairs->d_crossing, v->box, v->around, v->warp_start, v->near, v->near_count, v->part_start,
                        v->pair, v->found);
    pliant_cuda_release_host(pairs->h_found, pairs->h_pair, pairs->h_crossing);
    pliant_free(pairs);
}

static pliant_status reserve_pairs(gpu_self_pairs *pairs, int32_t near, int32_t count)
{
    view *v = &pairs->v;
    const char *what = pairs_of_surface;
    CUDA_TRY(pliant_cuda_ensure((size_t)near * sizeof *v->near, true, what, &v->near, &pairs->near_bytes));
    v->max_near = (int32_t)std::min<size_t>(pairs->near_bytes / sizeof *v->near, INT32_MAX - THREADS);
    const size_t capacity = (size_t)v->max_near, parts = (capacity + THREADS - 1) / THREADS;
    CUDA_TRY(pliant_cuda_ensure(capacity, false, what, &v->near_count, &pairs->near_count_bytes));
    CUDA_TRY(pliant_cuda_ensure(parts * sizeof *v->part_start, false, what, &v->part_start, &pairs->part_bytes));
    CUDA_TRY(pliant_cuda_ensure((size_t)count * sizeof *v->pair, true, what, &v->pair, &pairs->pair_bytes));
    v->max_pairs = (int32_t)std::min<size_t>(pairs->pair_bytes / sizeof *v->pair, INT32_MAX);
    if (pairs->pair_bytes <= pairs->h_pair_bytes) return PLIANT_OK;
    pliant_cuda_release_host(pairs->h_pair);
    pairs->h_pair = nullptr;
    pairs->h_pair_bytes = 0;
    CUDA_TRY(pliant_cuda_allocate_host(pairs->pair_bytes, what, &pairs->h_pair));
    pairs->h_pair_bytes = pairs->pair_bytes;
    return PLIANT_OK;
}

static pliant_status send_triangles(gpu_self_pairs *pairs, const pliant_advance_tree *tree, const uint8_t *exempt,
                                    const int32_t *piece, cudaStream_t stream)
{
    view *v = &pairs->v;
    pliant_advance_self_search *search = &v->search;
    const size_t triangles = (size_t)tree->num_triangles, nodes = (size_t)pairs->num_nodes;
    const char *what = pairs_of_surface;
    CUDA_TRY(pliant_cuda_upload(tree->order, triangles * sizeof *tree->order, what, stream, &pairs->d_order));
    CUDA_TRY(pliant_cuda_upload(tree->triangles, 3 * triangles * sizeof *tree->triangles, what, stream,
                                &pairs->d_triangles));
    CUDA_TRY(pliant_cuda_upload(tree->owns, triangles, what, stream, &pairs->d_owns));
    CUDA_TRY(pliant_cuda_upload(exempt, nodes, what, stream, &pairs->d_exempt));
    if (piece) CUDA_TRY(pliant_cuda_upload(piece, nodes * sizeof *piece, what, stream, &pairs->d_piece));
    v->order = pairs->d_order;
    search->triangles = pairs->d_triangles;
    search->owns = pairs->d_owns;
    search->self.exempt = pairs->d_exempt;
    search->self.piece = pairs->d_piece;
    CUDA_TRY(pliant_cuda_allocate(nodes, what, &pairs->d_crossing));
    search->crossing = pairs->d_crossing;
    return PLIANT_OK;
}

static pliant_status prepare(gpu_self_pairs *pairs, const pliant_advance_tree *tree, const uint8_t *exempt,
                             const int32_t *piece, cudaStream_t stream)
{
    view *v = &pairs->v;
    int device = 0, processors = 0;
    const char *what = pairs_of_surface;
    v->num_triangles = tree->num_triangles;
    v->num_groups = (tree->num_triangles + GROUP - 1) / GROUP;
    CUDA_TRY(CUDA_CALL(cudaGetDevice(&device)));
    CUDA_TRY(CUDA_CALL(cudaDeviceGetAttribute(&processors, cudaDevAttrMultiProcessorCount, device)));
    pairs->blocks = 16 * processors;
    CUDA_TRY(send_triangles(pairs, tree, exempt, piece, stream));
    const size_t groups = (size_t)v->num_groups;
    CUDA_TRY(pliant_cuda_allocate(GROUP * groups * sizeof *v->box, what, &v->box));
    CUDA_TRY(pliant_cuda_allocate(groups * sizeof *v->around, what, &v->around));
    CUDA_TRY(pliant_cuda_allocate(WARPS * groups * sizeof *v->warp_start, what, &v->warp_start));
    CUDA_TRY(pliant_cuda_allocate(sizeof *v->found, what, &v->found));
    CUDA_TRY(pliant_cuda_allocate_host(sizeof *pairs->h_found, what, &pairs->h_found));
    CUDA_TRY(pliant_cuda_allocate_host((size_t)pairs->num_nodes, what, &pairs->h_crossing));
    return reserve_pairs(pairs, 16 * v->num_triangles + THREADS, 4 * v->num_triangles + THREADS);
}

extern "C" pliant_status gpu_self_pairs_create(const pliant_advance_tree *tree, int32_t num_nodes,
                                               const uint8_t *exempt, const int32_t *piece, cudaStream_t stream,
                                               gpu_self_pairs **out)
{
    gpu_self_pairs *pairs = static_cast<gpu_self_pairs *>(pliant_calloc(1, sizeof *pairs));
    if (!pairs) return pliant_fail_memory(pairs_of_surface);
    pairs->num_nodes = num_nodes;
    const pliant_status status = prepare(pairs, tree, exempt, piece, stream);
    if (status == PLIANT_OK) *out = pairs;
    else gpu_self_pairs_free(pairs);
    return status;
}

static pliant_status enqueue(gpu_self_pairs *pairs, cudaStream_t stream)
{
    const view &v = pairs->v;
    const unsigned boxes = blocks_for(GROUP * v.num_groups, THREADS),
                   warps = blocks_for(32 * WARPS * v.num_groups, THREADS);
    const int32_t parts = (v.max_near + THREADS - 1) / THREADS;
    const unsigned blocks = (unsigned)std::min(parts, pairs->blocks);
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(v.found, 0, sizeof *v.found, stream)));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(pairs->d_crossing, 0, (size_t)pairs->num_nodes, stream)));
    box_kernel<<<boxes, THREADS, 0, stream>>>(v);
    CUDA_TRY(CUDA_LAUNCHED("box_kernel"));
    near_kernel<false><<<warps, THREADS, 0, stream>>>(v);
    CUDA_TRY(CUDA_LAUNCHED("near_kernel"));
    scan_kernel<<<1, SCAN_THREADS, 0, stream>>>(WARPS * v.num_groups, v.warp_start, &v.found->near);
    CUDA_TRY(CUDA_LAUNCHED("scan_kernel"));
    near_kernel<true><<<warps, THREADS, 0, stream>>>(v);
    CUDA_TRY(CUDA_LAUNCHED("near_kernel"));
    count_kernel<<<blocks, THREADS, 0, stream>>>(v);
    CUDA_TRY(CUDA_LAUNCHED("count_kernel"));
    scan_kernel<<<1, SCAN_THREADS, 0, stream>>>(parts, v.part_start, &v.found->pairs);
    CUDA_TRY(CUDA_LAUNCHED("scan_kernel"));
    pair_kernel<<<blocks, THREADS, 0, stream>>>(v);
    CUDA_TRY(CUDA_LAUNCHED("pair_kernel"));
    return CUDA_CALL(
        cudaMemcpyAsync(pairs->h_found, v.found, sizeof *pairs->h_found, cudaMemcpyDeviceToHost, stream));
}

/* Copy the pairs to the host. */
static pliant_status take(gpu_self_pairs *pairs, cudaStream_t stream, pliant_advance *advance, uint8_t *crossing)
{
    const totals *found = pairs->h_found;
    const size_t count = (size_t)found->pairs, bytes = count * sizeof *pairs->h_pair;
    if (found->pairs > advance->max_self) {
        const int32_t larger = std::max(found->pairs + found->pairs / 2, (int32_t)FIRST_PAIRS);
        if (!pliant_grow(&advance->self, (size_t)larger, sizeof *advance->self))
            return pliant_fail_memory(pairs_of_surface);
        advance->max_self = larger;
    }
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(pairs->h_pair, pairs->v.pair, bytes, cudaMemcpyDeviceToHost, stream)));
    if (found->crossings > 0)
        CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(pairs->h_crossing, pairs->d_crossing, (size_t)pairs->num_nodes,
                                           cudaMemcpyDeviceToHost, stream)));
    CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(stream)));
    if (count > 0) memcpy(advance->self, pairs->h_pair, bytes);
    advance->num_self = found->pairs;
    for (int32_t n = 0; found->crossings > 0 && n < pairs->num_nodes; n++) crossing[n] |= pairs->h_crossing[n];
    return PLIANT_OK;
}

extern "C" pliant_status gpu_self_pairs_find(gpu_self_pairs *pairs, const double *d_positions, double margin,
                                             cudaStream_t stream, pliant_advance *advance, uint8_t *crossing)
{
    view *v = &pairs->v;
    const totals *found = pairs->h_found;
    v->search.from = v->search.to = d_positions;
    v->search.margin = margin;
    advance->num_self = 0;
    for (;;) { /* pairs are counted also if they do not fit */
        CUDA_TRY(enqueue(pairs, stream));
        CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(stream)));
        if (found->near <= v->max_near && found->pairs <= v->max_pairs) break;
        if (found->near < 0 || found->pairs < 0 || found->near > INT32_MAX / 2 || found->pairs > INT32_MAX / 2)
            return pliant_fail(PLIANT_ERROR_MEMORY, "collision detection: the surface has too many near pairs");
        CUDA_TRY(reserve_pairs(pairs, std::max(found->near, v->max_near), std::max(found->pairs, v->max_pairs)));
    }
    return take(pairs, stream, advance, crossing);
}
