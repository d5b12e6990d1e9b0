#include "cuda/warp/fit.h"

#include "cuda/base/check.h"
#include "cuda/base/launch.h"
#include "base/fail.h"
#include "base/memory.h"
#include "cuda/warp/raster_math.cuh"
#include "cuda/base/prefix_sum.cuh"
#include "scan/volume.h"

enum { SORT_THREADS = 1024, TET_THREADS = 128, MAP_THREADS = 32, DRAW_THREADS = BRICK * BRICK };

struct pliant_cuda_fit {
    fit_view *d_view;          /* contains device pointers */
    fit_view view;             /* host copy, without the position-dependent data */
    raster_source source;
    int32_t *d_cursor;         /* (bins) */
    void *d_voxels;
    int32_t *d_owner;          /* (target voxels) zone element that owns the voxel, -1: none; NULL: no cuts */
};

/* ---- sort nodes into bins, by one block; for some thousand nodes each stage takes one or two microseconds */

static __device__ double extreme(double value, bool maximum, double *scratch)
{
    __syncthreads();
    for (int step = 16; step > 0; step /= 2) {
        const double other = __shfl_xor_sync(0xffffffffu, value, step);
        value = maximum ? fmax(value, other) : fmin(value, other);
    }
    if (threadIdx.x % 32 == 0) scratch[threadIdx.x / 32] = value;
    __syncthreads();
    value = scratch[0];
    for (int w = 1; w < SORT_THREADS / 32; w++) value = maximum ? fmax(value, scratch[w]) : fmin(value, scratch[w]);
    return value;
}

static __device__ int32_t place_nodes(fit_view *view, const double *d_positions, double *scratch)
{
    __shared__ int32_t count;
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (int32_t n = (int32_t)threadIdx.x; n < view->num_nodes; n += SORT_THREADS) {
        double at[3];
        fit_node_at(&view->target, d_positions + 3 * (size_t)n, at);
        for (int d = 0; d < 3; d++) {
            view->at[3 * (size_t)n + d] = at[d];
            low[d] = fmin(low[d], at[d]);
            high[d] = fmax(high[d], at[d]);
        }
    }
    for (int d = 0; d < 3; d++) {
        low[d] = extreme(low[d], false, scratch);
        high[d] = extreme(high[d], true, scratch);
    }
    if (threadIdx.x == 0) count = fit_set_bins(view, low, high);
    __syncthreads();
    return count;
}

/* Convert the counts in start[bin + 1] to the start of each bin (prefix sum). Each thread sums one run of bins. */
static __device__ void add_starts(int32_t *start, int32_t *cursor, int32_t count, int32_t *scratch)
{
    const int32_t length = (count + SORT_THREADS - 1) / SORT_THREADS, first = (int32_t)threadIdx.x * length,
                  end = min(first + length, count);
    int32_t sum = 0;
    for (int32_t b = first; b < end; b++) sum += start[b + 1];
    int32_t begin = sum_before<SORT_THREADS>(sum, scratch);
    for (int32_t b = first; b < end; b++) {
        cursor[b] = begin;
        begin += start[b + 1];
    }
    __syncthreads();
    for (int32_t b = first; b < end; b++) start[b] = cursor[b];
}

__global__ void __launch_bounds__(SORT_THREADS)
    sort_kernel(fit_view *d_view, const double *d_positions, int32_t *d_cursor)
{
    __shared__ double scratch[SORT_THREADS / 32];
    __shared__ int32_t sums[SORT_THREADS];
    const int32_t count = place_nodes(d_view, d_positions, scratch), nodes = d_view->num_nodes;
    int32_t *start = d_view->bin_start, *sorted = d_view->bin_node;
    for (int32_t b = (int32_t)threadIdx.x; b <= count; b += SORT_THREADS) start[b] = 0;
    __syncthreads();
    for (int32_t n = (int32_t)threadIdx.x; n < nodes; n += SORT_THREADS)
        atomicAdd(start + fit_flat_bin(d_view, d_view->at + 3 * (size_t)n) + 1, 1);
    __syncthreads();
    add_starts(start, d_cursor, count, sums);
    if (threadIdx.x == 0) start[count] = nodes;
    __syncthreads();
    for (int32_t n = (int32_t)threadIdx.x; n < nodes; n += SORT_THREADS)
        sorted[atomicAdd(d_cursor + fit_flat_bin(d_view, d_view->at + 3 * (size_t)n), 1)] = n;
    __syncthreads();
    /* sort ascending as on the CPU, because the threads insert in any order */
    for (int32_t b = (int32_t)threadIdx.x; b < count; b += SORT_THREADS)
        for (int32_t s = start[b] + 1; s < start[b + 1]; s++) {
            const int32_t node = sorted[s];
            int32_t place = s;
            for (; place > start[b] && sorted[place - 1] > node; place--) sorted[place] = sorted[place - 1];
            sorted[place] = node;
        }
    __syncthreads();
    for (int32_t place = (int32_t)threadIdx.x; place < nodes; place += SORT_THREADS) fit_set_place(d_view, place);
}

/* One warp per tetrahedron, one row of voxels per lane. Several threads may write 1 to the same byte. */
__global__ void __launch_bounds__(TET_THREADS) cover_kernel(const fit_view *d_view)
{
    const int64_t thread = (int64_t)blockIdx.x * TET_THREADS + threadIdx.x, t = thread / 32;
    const int32_t lane = (int32_t)(thread % 32);
    fit_tet tet;
    int32_t first[2], last[2];
    if (t >= d_view->num_tets || !fit_covers(d_view, (int32_t)t, true) || !fit_tet_at(d_view, (int32_t)t, &tet)) return;
    if (lane == 0) fit_mark_needed_points(d_view, &tet, 0, d_view->size[2]);
    if (!fit_covers(d_view, (int32_t)t, false)) return;
    for (int d = 0; d < 2; d++)
        if (!fit_range(tet.low[d + 1], tet.high[d + 1], d_view->target.size[d + 1], first + d, last + d)) return;
    const int64_t across = last[0] - first[0] + 1, rows = across * (last[1] - first[1] + 1);
    for (int64_t row = lane; row < rows; row += 32)
        fit_cover_row(d_view, &tet, first[0] + (int32_t)(row % across), first[1] + (int32_t)(row / across));
}

__global__ void __launch_bounds__(MAP_THREADS) map_kernel(const fit_view *d_view)
{
    const int64_t point = (int64_t)blockIdx.x * MAP_THREADS + threadIdx.x;
    const int32_t *size = d_view->size;
    if (point >= (int64_t)size[0] * size[1] * size[2]) return;
    const int32_t at[3] = {(int32_t)(point % size[0]), (int32_t)(point / size[0] % size[1]),
                           (int32_t)(point / size[0] / size[1])};
    float out[3];
    fit_point(d_view, at, out);
    for (int d = 0; d < 3; d++) d_view->map[3 * point + d] = out[d];
}

/* One block per brick, one column along k per thread. */
__global__ void __launch_bounds__(DRAW_THREADS)
    draw_kernel(const fit_view *d_view, const raster_source source, const gpu_raster raster, const int32_t *d_owner)
{
    const int32_t *size = d_view->target.size;
    const int32_t i = (int32_t)(blockIdx.x * BRICK + threadIdx.x % BRICK),
                  j = (int32_t)(blockIdx.y * BRICK + threadIdx.x / BRICK);
    const int32_t first = (int32_t)blockIdx.z * BRICK, end = min(first + (int32_t)BRICK, size[2]);
    bool other = false;
    if (i < size[0] && j < size[1])
        for (int32_t k = first; k < end; k++) {
            const double target[3] = {(double)i, (double)j, (double)k};
            const size_t v = (size_t)i + (size_t)size[0] * ((size_t)j + (size_t)size[1] * (size_t)k);
            double index[3] = {0, 0, 0};
            if (d_owner && d_owner[v] >= 0) {
                const double(*map)[4] = static_cast<const gpu_tet *>(raster.d_setup)[d_owner[v]].map;
                for (int d = 0; d < 3; d++) index[d] = part_index(map[d][0], map[d][1], map[d][2], map[d][3], target);
                other |= fit_draw_owned(d_view, &raster.parts, &source, d_owner[v], target, index, raster.d_volume, v);
                continue;
            }
            const bool known = d_view->covered[v] && fit_map_at(d_view, target, index);
            other |= fit_draw_voxel(d_view, &source, known, index, raster.d_volume, v);
        }
    other = __syncthreads_or(other) != 0;
    if (threadIdx.x == 0)
        raster.d_changed[blockIdx.x + (size_t)gridDim.x * (blockIdx.y + (size_t)gridDim.y * blockIdx.z)] = other;
}

/* ---- host functions */

template <class T> static pliant_status allocate(size_t count, T **d_out)
{
    return pliant_cuda_allocate(count * sizeof(T), "the fit", d_out);
}

template <class T> static pliant_status upload(const T *h_from, size_t count, cudaStream_t stream, T **d_out)
{
    return pliant_cuda_upload(h_from, count * sizeof(T), "the fit", stream, d_out);
}

static size_t target_voxels(const fit_view *view) { return pliant_geometry_voxels(&view->target); }
static size_t lattice_points(const fit_view *view)
{
    return (size_t)view->size[0] * (size_t)view->size[1] * (size_t)view->size[2];
}

static pliant_status fill(pliant_cuda_fit *fit, const fit_view *parts, const double *rest, const raster_source *source,
                          cudaStream_t stream)
{
    const size_t edge = (size_t)FIT_MAX_BINS + 2, nodes = (size_t)parts->num_nodes, max_bins = edge * edge * edge;
    const size_t points = lattice_points(parts),
                 scan = (size_t)parts->scan_size[0] * (size_t)parts->scan_size[1] * (size_t)parts->scan_size[2];
    double *d_rest;
    fit_view *view = &fit->view;
    CUDA_TRY(upload(rest, 3 * nodes, stream, &d_rest));
    view->rest = d_rest;
    int32_t *d_tets;
    CUDA_TRY(upload(parts->tets, 4 * (size_t)parts->num_tets, stream, &d_tets));
    view->tets = d_tets;
    CUDA_TRY(upload(parts->tissue, scan, stream, &view->tissue));
    CUDA_TRY(allocate(target_voxels(parts), &view->covered));
    CUDA_TRY(allocate(points, &view->wanted));
    CUDA_TRY(allocate(3 * points, &view->map));
    CUDA_TRY(allocate(3 * nodes, &view->at));
    CUDA_TRY(allocate(6 * nodes, &view->sorted));
    CUDA_TRY(allocate(nodes, &view->bin_node));
    CUDA_TRY(allocate(max_bins + 1, &view->bin_start));
    CUDA_TRY(allocate(max_bins, &fit->d_cursor));
    CUDA_TRY(pliant_cuda_upload(source->voxels, (size_t)source->count * pliant_encoding_size(source->encoding),
                                "the scan", stream, &fit->d_voxels));
    fit->source.voxels = fit->d_voxels;
    if (parts->zone) {
        uint8_t *d_zone, *d_near;
        CUDA_TRY(upload(parts->zone, (size_t)parts->num_elements, stream, &d_zone));
        view->zone = d_zone;
        CUDA_TRY(upload(parts->near, nodes, stream, &d_near));
        view->near = d_near;
        CUDA_TRY(allocate(target_voxels(parts), &fit->d_owner));
    }
    return upload(view, 1, stream, &fit->d_view);
}

pliant_status pliant_cuda_fit_create(const fit_view *parts, const double *rest, const raster_source *source,
                                     cudaStream_t stream, pliant_cuda_fit **out)
{
    pliant_cuda_fit *fit = static_cast<pliant_cuda_fit *>(pliant_calloc(1, sizeof *fit));
    if (!fit) return pliant_fail_memory("the fit");
    fit->view = *parts;
    fit->source = *source;
    fit_view *view = &fit->view;
    view->rest = view->at = view->sorted = NULL;
    view->map = NULL;
    view->tets = NULL;
    view->tissue = view->covered = view->wanted = NULL;
    view->zone = view->near = NULL;
    view->bin_start = view->bin_node = NULL;
    pliant_status status = fill(fit, parts, rest, source, stream);
    if (status != PLIANT_OK) {
        pliant_cuda_fit_free(fit);
        return status;
    }
    *out = fit;
    return PLIANT_OK;
}

void pliant_cuda_fit_free(pliant_cuda_fit *fit)
{
    if (!fit) return;
    const fit_view *view = &fit->view;
    pliant_cuda_release(view->rest, view->tets, view->tissue, view->covered, view->wanted, view->map, view->at,
                        view->sorted, view->bin_node, view->bin_start, fit->d_cursor, fit->d_voxels, fit->d_view,
                        view->zone, view->near, fit->d_owner);
    pliant_free(fit);
}

pliant_status pliant_cuda_fit_map(const pliant_cuda_fit *fit, const double *d_positions, cudaStream_t stream)
{
    sort_kernel<<<1, SORT_THREADS, 0, stream>>>(fit->d_view, d_positions, fit->d_cursor);
    CUDA_TRY(CUDA_LAUNCHED("the nodes of the fit"));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(fit->view.wanted, 0, lattice_points(&fit->view), stream)));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(fit->view.covered, 0, target_voxels(&fit->view), stream)));
    cover_kernel<<<blocks_for(32 * (int64_t)fit->view.num_tets, TET_THREADS), TET_THREADS, 0, stream>>>(fit->d_view);
    CUDA_TRY(CUDA_LAUNCHED("the tetrahedra of the fit"));
    map_kernel<<<blocks_for(lattice_points(&fit->view), MAP_THREADS), MAP_THREADS, 0, stream>>>(fit->d_view);
    return CUDA_LAUNCHED("the fit");
}

const uint8_t *pliant_cuda_fit_zone(const pliant_cuda_fit *fit) { return fit->view.zone; }

pliant_status pliant_cuda_fit_own(const pliant_cuda_fit *fit, const gpu_raster *raster, cudaStream_t stream)
{
    return pliant_cuda_find_owners(raster, fit->d_owner, stream);
}

pliant_status pliant_cuda_fit_draw(const pliant_cuda_fit *fit, const gpu_raster *raster, cudaStream_t stream)
{
    const int32_t *bricks = raster->grid.bricks;
    const dim3 grid((unsigned)bricks[0], (unsigned)bricks[1], (unsigned)bricks[2]);
    draw_kernel<<<grid, DRAW_THREADS, 0, stream>>>(fit->d_view, fit->source, *raster, fit->d_owner);
    return CUDA_LAUNCHED("the voxels of the fit");
}
