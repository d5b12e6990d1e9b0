/* Which tetrahedra overlap: lists of those in every cell of a grid, pairs of a list whose boxes meet, and which of those overlap.
 *
 * Cells have no bounds: a table takes them by a hash of their place, and an entry tells which cell it is of. Lists are linked, in the order in which
 * threads come; pairs are the same in any order, and are sorted where they are asked for. */
#include "overlaps.h"

#include "contact/overlap.h"
#include "pliant/fail.h"
#include "pliant/memory.h"

#include <algorithm>
#include <cstring>

namespace {

enum { THREADS = 128, MOST_CELLS = 16 /* that a box lies in along an axis */ };

struct entry { unsigned long long cell; int32_t next, tet; float low[3], high[3]; /* outwards */ };
struct tet_box { double low[3], high[3]; };

/* how many there are, and the most cells along an axis that a box lies in */
enum { ENTRIES, CANDIDATES, PAIRS, CELLS, NUM_COUNTS };

/* what kernels see */
struct view {
    int32_t count, table; /* table: a power of two, less 1 */
    double side;
    const int32_t *tets, *tet;
    const double *positions;
    tet_box *box;        /* (count) */
    int32_t *head;       /* (table + 1) the first entry of each list; -1: none */
    entry *entries;
    int2 *candidates, *pairs;
    int32_t room[CELLS], *counts;
};

__device__ __forceinline__ int32_t cell_of(const view &v, double x) { return (int32_t)fmin(fmax(floor(x / v.side), -1e9), 1e9); }

__device__ __forceinline__ uint32_t hash_of(const view &v, int32_t a, int32_t b, int32_t c)
{
    return ((uint32_t)a * 73856093u ^ (uint32_t)b * 19349663u ^ (uint32_t)c * 83492791u) & (uint32_t)v.table;
}

__device__ __forceinline__ unsigned long long key_of(int32_t a, int32_t b, int32_t c)
{
    const unsigned long long mask = (1ull << 21) - 1; /* no box reaches as far as a cell with the same key */
    return ((unsigned long long)a & mask) | ((unsigned long long)b & mask) << 21 | ((unsigned long long)c & mask) << 42;
}

__global__ void fill_kernel(view v)
{
    const int32_t i = (int32_t)(blockIdx.x * THREADS + threadIdx.x);
    if (i >= v.count) return;
    const int32_t *node = v.tets + 4 * (size_t)v.tet[i];
    tet_box box;
    double sum = 0;
    for (int d = 0; d < 3; d++) {
        box.low[d] = box.high[d] = v.positions[3 * (size_t)node[0] + d];
        for (int k = 0; k < 4; k++) {
            const double x = v.positions[3 * (size_t)node[k] + d];
            box.low[d] = fmin(box.low[d], x);
            box.high[d] = fmax(box.high[d], x);
            sum += x;
        }
    }
    v.box[i] = box;
    if (!isfinite(sum)) return;
    const double widest = fmax(box.high[0] - box.low[0], fmax(box.high[1] - box.low[1], box.high[2] - box.low[2])) / v.side;
    if (widest > MOST_CELLS) {
        atomicMax(v.counts + CELLS, (int32_t)fmin(widest, 1e9));
        return;
    }
    const int32_t low[3] = {cell_of(v, box.low[0]), cell_of(v, box.low[1]), cell_of(v, box.low[2])};
    const int32_t high[3] = {cell_of(v, box.high[0]), cell_of(v, box.high[1]), cell_of(v, box.high[2])};
    for (int32_t c = low[2]; c <= high[2]; c++)
        for (int32_t b = low[1]; b <= high[1]; b++)
            for (int32_t a = low[0]; a <= high[0]; a++) {
                const int32_t at = atomicAdd(v.counts + ENTRIES, 1);
                if (at >= v.room[ENTRIES]) continue;
                entry one;
                one.tet = i;
                one.cell = key_of(a, b, c);
                for (int d = 0; d < 3; d++) {
                    one.low[d] = __double2float_rd(box.low[d]);
                    one.high[d] = __double2float_ru(box.high[d]);
                }
                one.next = atomicExch(v.head + hash_of(v, a, b, c), at);
                v.entries[at] = one;
            }
}

__device__ __forceinline__ void append(const view &v, int what, int2 *list, int32_t a, int32_t b)
{
    const int32_t at = atomicAdd(v.counts + what, 1);
    if (at < v.room[what]) list[at] = make_int2(a, b);
}

/* each entry with those after it in its list */
__global__ void pair_kernel(view v)
{
    const int32_t entries = min(v.counts[ENTRIES], v.room[ENTRIES]);
    for (int32_t at = (int32_t)(blockIdx.x * THREADS + threadIdx.x); at < entries; at += (int32_t)(gridDim.x * THREADS)) {
        const entry mine = v.entries[at];
        const tet_box box = v.box[mine.tet];
        const int4 node = *(const int4 *)(v.tets + 4 * (size_t)v.tet[mine.tet]);
        for (int32_t next = mine.next; next >= 0;) {
            const entry other = v.entries[next];
            next = other.next;
            bool meets = other.cell == mine.cell;
            for (int d = 0; d < 3; d++) meets = meets && mine.low[d] < other.high[d] && other.low[d] < mine.high[d];
            if (!meets) continue;
            const tet_box beside = v.box[other.tet];
            int32_t home[3];
            for (int d = 0; d < 3; d++) { /* the cell of the lowest corner of what they have in common */
                meets = meets && box.low[d] < beside.high[d] && beside.low[d] < box.high[d];
                home[d] = cell_of(v, fmax(box.low[d], beside.low[d]));
            }
            if (!meets || key_of(home[0], home[1], home[2]) != mine.cell) continue;
            const int4 to = *(const int4 *)(v.tets + 4 * (size_t)v.tet[other.tet]);
            const int32_t a[4] = {node.x, node.y, node.z, node.w}, b[4] = {to.x, to.y, to.z, to.w};
            bool shared = false;
            for (int k = 0; k < 4; k++)
                for (int l = 0; l < 4; l++) shared = shared || a[k] == b[l];
            if (!shared) append(v, CANDIDATES, v.candidates, min(mine.tet, other.tet), max(mine.tet, other.tet));
        }
    }
}

__global__ void test_kernel(view v)
{
    const int32_t candidates = min(v.counts[CANDIDATES], v.room[CANDIDATES]);
    for (int32_t at = (int32_t)(blockIdx.x * THREADS + threadIdx.x); at < candidates; at += (int32_t)(gridDim.x * THREADS)) {
        const int32_t a = v.tet[v.candidates[at].x], b = v.tet[v.candidates[at].y];
        double x[3][4], y[3][4];
        for (int k = 0; k < 4; k++)
            for (int d = 0; d < 3; d++) {
                x[d][k] = v.positions[3 * (size_t)v.tets[4 * (size_t)a + k] + d];
                y[d][k] = v.positions[3 * (size_t)v.tets[4 * (size_t)b + k] + d];
            }
        if (pliant_tets_overlap(x, y)) append(v, PAIRS, v.pairs, min(a, b), max(a, b));
    }
}

} // namespace

struct gpu_overlaps {
    view v;
    int32_t *d_tets, *d_tet, *h_counts;
    size_t entries_bytes, candidates_bytes, pairs_bytes;
    int blocks; /* that the device runs at once */
    cudaGraphExec_t graph; /* Nullable: of what it was made for */
    view made_for;
    int32_t found;
};

void gpu_overlaps_free(gpu_overlaps *overlaps)
{
    if (!overlaps) return;
    if (overlaps->graph) cudaGraphExecDestroy(overlaps->graph);
    void *blocks[] = {overlaps->d_tets, overlaps->d_tet, overlaps->v.box, overlaps->v.head, overlaps->v.entries, overlaps->v.candidates, overlaps->v.pairs, overlaps->v.counts};
    for (void *block : blocks) pliant_cuda_release(block);
    pliant_cuda_release_host(overlaps->h_counts);
    pliant_free(overlaps);
}

/* Room for so many of each. */
static pliant_status make_room(gpu_overlaps *overlaps, const int32_t counts[CELLS])
{
    view *v = &overlaps->v;
    CUDA_TRY(pliant_cuda_ensure((size_t)counts[ENTRIES] * sizeof *v->entries, true, "cells of tetrahedra", (void **)&v->entries, &overlaps->entries_bytes));
    CUDA_TRY(pliant_cuda_ensure((size_t)counts[CANDIDATES] * sizeof *v->candidates, true, "pairs of tetrahedra", (void **)&v->candidates, &overlaps->candidates_bytes));
    CUDA_TRY(pliant_cuda_ensure((size_t)counts[PAIRS] * sizeof *v->pairs, true, "pairs of tetrahedra", (void **)&v->pairs, &overlaps->pairs_bytes));
    v->room[ENTRIES] = (int32_t)std::min<size_t>(overlaps->entries_bytes / sizeof *v->entries, INT32_MAX);
    v->room[CANDIDATES] = (int32_t)std::min<size_t>(overlaps->candidates_bytes / sizeof *v->candidates, INT32_MAX);
    v->room[PAIRS] = (int32_t)std::min<size_t>(overlaps->pairs_bytes / sizeof *v->pairs, INT32_MAX);
    return PLIANT_OK;
}

static pliant_status prepare(gpu_overlaps *overlaps, int32_t num_tets, const int32_t *tets, int32_t count, const int32_t *tet, double side, cudaStream_t stream)
{
    view *v = &overlaps->v;
    int device = 0, processors = 0;
    const int32_t counts[CELLS] = {8 * count + 1024, 8 * count + 1024, 2 * count + 1024};
    int32_t table = 1024;
    while (table < 4 * (int64_t)count && table < 1 << 28) table *= 2;
    v->count = count;
    v->table = table - 1;
    v->side = side;
    CUDA_TRY(CUDA_CALL(cudaGetDevice(&device)));
    CUDA_TRY(CUDA_CALL(cudaDeviceGetAttribute(&processors, cudaDevAttrMultiProcessorCount, device)));
    overlaps->blocks = 8 * processors;
    CUDA_TRY(pliant_cuda_upload(tets, 4 * (size_t)num_tets * sizeof *tets, "tetrahedra", stream, (void **)&overlaps->d_tets));
    CUDA_TRY(pliant_cuda_upload(tet, (size_t)count * sizeof *tet, "tetrahedra at the surface", stream, (void **)&overlaps->d_tet));
    v->tets = overlaps->d_tets;
    v->tet = overlaps->d_tet;
    CUDA_TRY(pliant_cuda_allocate((size_t)count * sizeof *v->box, "boxes of tetrahedra", (void **)&v->box));
    CUDA_TRY(pliant_cuda_allocate((size_t)table * sizeof *v->head, "cells of tetrahedra", (void **)&v->head));
    CUDA_TRY(pliant_cuda_allocate(NUM_COUNTS * sizeof *v->counts, "pairs of tetrahedra", (void **)&v->counts));
    CUDA_TRY(pliant_cuda_allocate_host(NUM_COUNTS * sizeof *overlaps->h_counts, "pairs of tetrahedra", (void **)&overlaps->h_counts));
    return make_room(overlaps, counts);
}

pliant_status gpu_overlaps_create(int32_t num_tets, const int32_t *tets, int32_t count, const int32_t *tet, double side, cudaStream_t stream,
                                  gpu_overlaps **out)
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
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(v.head, 0xff, ((size_t)v.table + 1) * sizeof *v.head, stream)));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(v.counts, 0, NUM_COUNTS * sizeof *v.counts, stream)));
    fill_kernel<<<(unsigned)((v.count + THREADS - 1) / THREADS), THREADS, 0, stream>>>(v);
    CUDA_TRY(CUDA_LAUNCHED("fill_kernel"));
    pair_kernel<<<(unsigned)overlaps->blocks, THREADS, 0, stream>>>(v);
    CUDA_TRY(CUDA_LAUNCHED("pair_kernel"));
    test_kernel<<<(unsigned)overlaps->blocks, THREADS, 0, stream>>>(v);
    CUDA_TRY(CUDA_LAUNCHED("test_kernel"));
    return CUDA_CALL(cudaMemcpyAsync(overlaps->h_counts, v.counts, NUM_COUNTS * sizeof *v.counts, cudaMemcpyDeviceToHost, stream));
}

/* The same work in every step is launched as one graph. */
static pliant_status record(gpu_overlaps *overlaps, cudaStream_t stream)
{
    cudaGraph_t graph = NULL;
    if (overlaps->graph && memcmp(&overlaps->made_for, &overlaps->v, sizeof overlaps->v) == 0) return PLIANT_OK;
    if (overlaps->graph) cudaGraphExecDestroy(overlaps->graph);
    overlaps->graph = NULL;
    CUDA_TRY(CUDA_CALL(cudaStreamBeginCapture(stream, cudaStreamCaptureModeThreadLocal)));
    pliant_status status = enqueue(overlaps, stream);
    const cudaError_t ended = cudaStreamEndCapture(stream, &graph);
    if (status == PLIANT_OK) status = CUDA_CALL(ended);
    if (status == PLIANT_OK) status = CUDA_CALL(cudaGraphInstantiateWithFlags(&overlaps->graph, graph, 0));
    if (graph) cudaGraphDestroy(graph);
    overlaps->made_for = overlaps->v;
    return status;
}

static pliant_status run(gpu_overlaps *overlaps, cudaStream_t stream)
{
    CUDA_TRY(record(overlaps, stream));
    CUDA_TRY(CUDA_CALL(cudaGraphLaunch(overlaps->graph, stream)));
    return CUDA_CALL(cudaStreamSynchronize(stream));
}

pliant_status gpu_overlaps_find(gpu_overlaps *overlaps, const double *d_positions, cudaStream_t stream, int32_t *count)
{
    overlaps->found = *count = 0;
    overlaps->v.positions = d_positions;
    if (overlaps->v.count == 0) return PLIANT_OK;
    for (bool again = true; again;) { /* what had no room is counted, as far as what is before it had */
        CUDA_TRY(run(overlaps, stream));
        again = overlaps->h_counts[CELLS] > 0;
        if (again) overlaps->v.side *= overlaps->h_counts[CELLS] / 2.0;
        for (int n = 0; n < CELLS; n++) again = again || overlaps->h_counts[n] > overlaps->v.room[n];
        if (again) CUDA_TRY(make_room(overlaps, overlaps->h_counts));
    }
    overlaps->found = *count = overlaps->h_counts[PAIRS];
    return PLIANT_OK;
}

pliant_status gpu_overlaps_get_pairs(const gpu_overlaps *overlaps, cudaStream_t stream, int32_t *pair)
{
    if (overlaps->found == 0) return PLIANT_OK;
    const size_t count = (size_t)overlaps->found;
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(pair, overlaps->v.pairs, count * sizeof *overlaps->v.pairs, cudaMemcpyDeviceToHost, stream)));
    CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(stream)));
    int2 *first = (int2 *)pair;
    std::sort(first, first + count, [](const int2 &a, const int2 &b) { return a.x != b.x ? a.x < b.x : a.y < b.y; });
    return PLIANT_OK;
}
