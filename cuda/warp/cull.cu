/* Set up the tetrahedra for drawing, and list them by brick. */
#include "cuda/base/check.h"
#include "cuda/base/launch.h"
#include "cuda/warp/raster_math.cuh"
#include "cuda/warp/rasterize.h"

enum { THREADS = 128 };

/* Return the bricks of a mask that one of the four threads handles: those with even or odd position along i and along
 * j. Each thread gets a quarter of them. */
static __device__ __forceinline__ unsigned long long own_bricks(unsigned long long bricks, int v)
{
    static_assert(MASK_EDGE == 4, "a row of the mask has 4 bits, a slice 16");
    return bricks & 0x0505050505050505ull << ((v & 1) + MASK_EDGE * (v >> 1));
}

/* bricks that a tetrahedron touches, and its bounding box */
struct footprint { unsigned long long bricks; gpu_box box; };

/* Visit the bricks of a tetrahedron that spans more bricks than the mask covers. The planes of the tetrahedron select
 * them. */
template <class Visit>
static __device__ __forceinline__ void visit_many(const gpu_raster &raster, int t, const int *low, const int *high,
                                                  Visit visit)
{
    const int v = (int)threadIdx.x % 4;
    exact_plane planes[4];
    for (int p = 0; p < 4; p++) planes[p] = gpu_exact_plane(corners_of(raster), t, p);
    int at[3], number = 0;
    for (at[2] = low[2]; at[2] <= high[2]; at[2]++)
        for (at[1] = low[1]; at[1] <= high[1]; at[1]++)
            for (at[0] = low[0]; at[0] <= high[0]; at[0]++) {
                if (number++ % 4 != v) continue;
                int begin[3], end[3];
                for (int d = 0; d < 3; d++) {
                    begin[d] = BRICK * at[d];
                    end[d] = begin[d] + BRICK - 1;
                }
                bool cuts = true; /* same rule as pliant_raster_cuts */
                for (int p = 0; p < 4; p++) cuts = cuts && gpu_max_corner(planes[p], begin, end) >= 0;
                if (cuts) visit(at[0] + raster.grid.bricks[0] * (at[1] + raster.grid.bricks[1] * at[2]), -1);
            }
}

/* Visit the bricks of a tetrahedron. Each of the four threads takes its part, two bricks at a time. */
template <class Visit>
static __device__ __forceinline__ void visit_bricks(const gpu_raster &raster, int t, const footprint &foot, Visit visit)
{
    if (foot.box.kind == RASTER_NOTHING) return;
    const int across = raster.grid.bricks[0], down = raster.grid.bricks[1], v = (int)threadIdx.x % 4;
    int low[3], high[3];
    for (int d = 0; d < 3; d++) {
        low[d] = foot.box.low[d] / BRICK;
        high[d] = foot.box.high[d] / BRICK;
    }
    if (!gpu_in_mask(foot.box.low, foot.box.high)) {
        visit_many(raster, t, low, high, visit);
        return;
    }
    const int first = low[0] + across * (low[1] + down * low[2]);
    for (unsigned long long left = own_bricks(foot.bricks, v); left; left &= left - 1) {
        int brick[2];
        for (int n = 0; n < 2; n++) {
            const int bit = __ffsll((long long)left) - 1;
            brick[n] = left ? first + (bit & 3) + across * ((bit >> 2 & 3) + down * (bit >> 4)) : -1;
            if (n == 0) left &= left - 1;
        }
        visit(brick[0], brick[1]);
    }
}

static __device__ __forceinline__ void list_in(const gpu_raster &raster, int t, int brick, int place)
{
    if (brick >= 0 && place < raster.capacity) raster.d_list[(size_t)brick * raster.capacity + place] = t;
}

/* Compute the bounding box in voxels inside the target; false if it is empty (find_box). */
static __device__ __forceinline__ bool find_box(const raster_grid &grid, const int fixed[4][3], short *low, short *high)
{
    bool any = true;
    for (int d = 0; d < 3; d++) {
        int minimum = fixed[0][d], maximum = minimum;
        for (int n = 1; n < 4; n++) {
            minimum = min(minimum, fixed[n][d]);
            maximum = max(maximum, fixed[n][d]);
        }
        minimum = max(-(-minimum >> grid.fraction_bits), 0);
        maximum = min(maximum >> grid.fraction_bits, grid.target.size[d] - 1);
        any = any && minimum <= maximum;
        low[d] = (short)minimum;
        high[d] = (short)maximum;
    }
    return any;
}

/* Same operations as pliant_raster_tet. All four threads of the tetrahedron must call it together.
 * own_rest: rest position of the thread's own node
 * wanted: whether the tetrahedron is drawn
 * out: NULL: no output */
static __device__ __forceinline__ void set_up(const gpu_raster &raster, const int fixed[4][3], const double *own_rest,
                                              bool wanted, gpu_tet *out, footprint &foot)
{
    const raster_grid &grid = raster.grid;
    const int v = (int)threadIdx.x % 4, axis = v < 3 ? v : 0;
    long long normal[3];
    const double volume = gpu_normals(fixed, v, normal);
    gpu_box &box = foot.box;
    const bool drawn = wanted & (grid.mirrored ? volume < 0 : volume > 0) & find_box(grid, fixed, box.low, box.high);
    double rest[4], map[4], rounded[4], exact[3];
    for (int d = 0; d < 3; d++) exact[d] = (double)normal[d]; /* exact, since the value is below 2^53 */
    for (int n = 0; n < 4; n++) {
        double x = of_thread(own_rest[0], n), y = of_thread(own_rest[1], n), z = of_thread(own_rest[2], n);
        rest[n] = axis == 0 ? x : axis == 1 ? y : z;
    }
    gpu_map(grid, fixed, rest, exact, volume, map);
    const bool whole = all_of_four(gpu_is_whole(grid, raster.source_size[axis], fixed, rest, map, rounded));
    for (int c = 0; c < 4; c++) map[c] = whole ? rounded[c] : map[c];
    box.inner = all_of_four(gpu_stays_inside(raster.source_size[axis], rest, map));
    box.kind = !drawn ? RASTER_NOTHING : whole ? RASTER_COPY : RASTER_SAMPLE;
    int point[3], middle[3];
    for (int d = 0; d < 3; d++) {
        if (grid.mirrored) normal[d] = -normal[d];
        exact[d] = grid.mirrored ? -exact[d] : exact[d];
        point[d] = v == 0 ? fixed[1][d] : fixed[0][d];
        middle[d] = box.middle(d);
    }
    const long long value = gpu_plane_value(grid.fraction_bits, normal, point);
    long long near = value;
    for (int d = 0; d < 3; d++) near += normal[d] * (box.low[d] / BRICK * BRICK);
    foot.bricks = and_of_four(drawn ? gpu_find_bricks(box.low, box.high, exact, (double)near) : 0);
    gpu_tet *bounds = drawn ? out : NULL;
    const unsigned begins = set_rows(normal, value, middle, v, bounds),
                   lows = set_slices(grid, fixed, begins, middle, v, bounds);
    box.row_begins = (unsigned char)__popc(begins);
    box.slice_begins = (unsigned char)__popc(lows);
    if (out && v == 0) {
        out->box = box;
        out->bricks = foot.bricks;
    }
    if (bounds && v < 3)
        for (int c = 0; c < 4; c++) bounds->map[v][c] = map[c];
}

/* Return the deformed and the rest position of a thread's own corner.
 * CARRY: there may be carried tetrahedra */
template <bool CARRY>
static __device__ __forceinline__ void find_corner(const gpu_raster &raster, const double *d_positions, int t, int v,
                                                   int *mine, double *rest)
{
    if (CARRY && t >= raster.num_tets) {
        const part_carried_tet &carried_tet = raster.d_carried[t - raster.num_tets];
        const double *nodes[4];
        double corner[3];
        for (int n = 0; n < 4; n++)
            nodes[n] = d_positions + 3 * (size_t)raster.d_tets[4 * (size_t)carried_tet.carrier + n];
        part_carried_tet_corner(carried_tet.blend[v], nodes, corner);
        for (int d = 0; d < 3; d++) rest[d] = carried_tet.rest[v][d];
        gpu_fix(raster.grid, raster.reciprocal, corner, mine);
        return;
    }
    const size_t node = (size_t)raster.d_tets[4 * (size_t)t + v];
    for (int d = 0; d < 3; d++) rest[d] = raster.d_rest[3 * node + d];
    gpu_fix(raster.grid, raster.reciprocal, d_positions + 3 * node, mine);
}

/* List each element in all bricks that it touches, with four threads per element. Unmoved elements are listed too,
 * because they may share a brick with a moved one. A brick becomes dirty if a moved element touches or has touched
 * it. */
template <bool PARTS>
static __global__ void __launch_bounds__(THREADS, 4)
    cull_kernel(gpu_raster raster, const double *__restrict__ d_positions, bool all)
{
    const int own = (int)(blockIdx.x * THREADS + threadIdx.x) / 4, v = (int)threadIdx.x % 4;
    const bool there = own < raster.num_elements;
    /* the last threads take part, because all threads of a warp exchange values */
    const int t = there ? own : raster.num_elements - 1;
    gpu_tet *stored = static_cast<gpu_tet *>(raster.d_setup) + t;
    footprint foot = {};
    if (!all) {
        foot.bricks = stored->bricks;
        foot.box = stored->box;
    }
    int mine[3], fixed[4][3], *last = raster.d_fixed + 12 * (size_t)t + 3 * v;
    double rest[3];
    find_corner<PARTS>(raster, d_positions, t, v, mine, rest);
    bool still = !all;
    for (int d = 0; d < 3; d++) {
        still = still && last[d] == mine[d];
        for (int n = 0; n < 4; n++) fixed[n][d] = of_thread(mine[d], n);
    }
    still = all_of_four(still);
    if (there && !still)
        visit_bricks(raster, t, foot, [&](int one, int other) {
            raster.d_dirty[one] = 1;
            if (other >= 0) raster.d_dirty[other] = 1;
        });
    __syncwarp();
    if (__any_sync(0xffffffff, there && !still)) { /* the setup of an unmoved element gives the same result as before */
        if (there)
            for (int d = 0; d < 3; d++) last[d] = mine[d];
        set_up(raster, fixed, rest, !PARTS || !raster.d_zone || raster.d_zone[t] > 0, there ? stored : NULL, foot);
        __syncwarp();
    }
    if (!there) return;
    const bool has_parts = PARTS && raster.parts.elements[t].box >= 0;
    visit_bricks(raster, t, foot, [&](int one, int other) {
        if (has_parts) {
            raster.d_has_parts[one] = 1;
            if (other >= 0) raster.d_has_parts[other] = 1;
        }
        if (!still) {
            raster.d_dirty[one] = 1;
            if (other >= 0) raster.d_dirty[other] = 1;
        }
        /* the order is arbitrary, because the lowest index wins */
        const int place = atomicAdd(raster.d_count + one, 1),
                  other_place = other >= 0 ? atomicAdd(raster.d_count + other, 1) : 0;
        list_in(raster, t, one, place);
        list_in(raster, t, other, other_place);
    });
}

size_t pliant_cuda_setup_bytes(void) { return sizeof(gpu_tet); }

pliant_status pliant_cuda_cull(const gpu_raster *raster, const double *d_positions, bool all, cudaStream_t stream)
{
    const long long threads = 4 * (long long)raster->num_elements;
    const unsigned blocks = blocks_for(threads, THREADS);
    if (all) CUDA_TRY(CUDA_CALL(cudaMemsetAsync(raster->d_dirty, 1, (size_t)raster->num_bricks, stream)));
    if (raster->parts.elements) cull_kernel<true><<<blocks, THREADS, 0, stream>>>(*raster, d_positions, all);
    else cull_kernel<false><<<blocks, THREADS, 0, stream>>>(*raster, d_positions, all);
    return CUDA_LAUNCHED("cull_kernel");
}

/* ---- change to another body */

/* Set the corners to a position that no node has, so that the next update sets up the element. */
static __device__ void set_up_rebuilt(gpu_raster now, int e)
{
    gpu_tet &out = static_cast<gpu_tet *>(now.d_setup)[e];
    out.bricks = 0;
    out.box = {};
    out.box.kind = RASTER_NOTHING;
    for (int n = 0; n < 12; n++) now.d_fixed[12 * (size_t)e + n] = INT32_MIN;
}

static __global__ void carry_kernel(gpu_raster before, gpu_raster now, int common, const int32_t *__restrict__ d_from)
{
    const int e = (int)(blockIdx.x * THREADS + threadIdx.x);
    if (e >= now.num_elements) return;
    const int from = e < common ? e : d_from[e - common];
    if (from < 0) {
        set_up_rebuilt(now, e);
        return;
    }
    static_cast<gpu_tet *>(now.d_setup)[e] = static_cast<const gpu_tet *>(before.d_setup)[from];
    for (int n = 0; n < 12; n++) now.d_fixed[12 * (size_t)e + n] = before.d_fixed[12 * (size_t)from + n];
}

static __global__ void rebuild_kernel(gpu_raster now, int count, const int32_t *__restrict__ d_rebuilt)
{
    const int i = (int)(blockIdx.x * THREADS + threadIdx.x);
    if (i < count) set_up_rebuilt(now, d_rebuilt[i]);
}

/* four threads per element */
static __global__ void leave_kernel(gpu_raster before, int count, const int32_t *__restrict__ d_removed)
{
    const int i = (int)(blockIdx.x * THREADS + threadIdx.x) / 4;
    if (i >= count) return;
    const int e = d_removed[i];
    const gpu_tet *stored = static_cast<const gpu_tet *>(before.d_setup) + e;
    visit_bricks(before, e, {stored->bricks, stored->box}, [&](int one, int other) {
        before.d_dirty[one] = 1;
        if (other >= 0) before.d_dirty[other] = 1;
    });
}

pliant_status pliant_cuda_carry_elements(const gpu_raster *before, const gpu_raster *now, int32_t common,
                                         const int32_t *d_from, int32_t num_rebuilt, const int32_t *d_rebuilt,
                                         cudaStream_t stream)
{
    carry_kernel<<<blocks_for(now->num_elements, THREADS), THREADS, 0, stream>>>(*before, *now, common, d_from);
    CUDA_TRY(CUDA_LAUNCHED("carry_kernel"));
    if (num_rebuilt == 0) return PLIANT_OK;
    rebuild_kernel<<<blocks_for(num_rebuilt, THREADS), THREADS, 0, stream>>>(*now, num_rebuilt, d_rebuilt);
    return CUDA_LAUNCHED("rebuild_kernel");
}

pliant_status pliant_cuda_mark_removed(const gpu_raster *before, int32_t num_removed, const int32_t *d_removed,
                                       cudaStream_t stream)
{
    if (num_removed == 0) return PLIANT_OK;
    leave_kernel<<<blocks_for(4 * (long long)num_removed, THREADS), THREADS, 0, stream>>>(*before, num_removed,
                                                                                          d_removed);
    return CUDA_LAUNCHED("leave_kernel");
}
