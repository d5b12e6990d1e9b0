/* Tetrahedra set up for drawing, and listed by brick. */
#include "check.h"
#include "raster_math.cuh"
#include "rasterize.h"

enum { THREADS = 128 };

/* each of the four threads takes its share of the bricks that a tetrahedron touches */
template <class Visit> static __device__ void visit_bricks(const gpu_raster &raster, const gpu_tet &tet, Visit visit)
{
    if (tet.kind == RASTER_NOTHING) return;
    const int across = raster.grid.bricks[0], down = raster.grid.bricks[1], v = (int)threadIdx.x % 4;
    int low[3], high[3], at[3];
    for (int d = 0; d < 3; d++) {
        low[d] = tet.low[d] / BRICK;
        high[d] = tet.high[d] / BRICK;
    }
    int number = 0;
    if (gpu_in_mask(tet.low, tet.high)) {
        for (unsigned long long left = tet.bricks; left; left &= left - 1) {
            int bit = __ffsll((long long)left) - 1;
            if (number++ % 4 == v) visit(low[0] + (bit & 3) + across * (low[1] + (bit >> 2 & 3) + down * (low[2] + (bit >> 4))));
        }
        return;
    }
    for (at[2] = low[2]; at[2] <= high[2]; at[2]++)
        for (at[1] = low[1]; at[1] <= high[1]; at[1]++)
            for (at[0] = low[0]; at[0] <= high[0]; at[0]++)
                if (number++ % 4 == v && gpu_cuts(tet, at)) visit(at[0] + across * (at[1] + down * at[2]));
}

/* its box in voxels inside the target; false when that is empty (find_box) */
static __device__ __forceinline__ bool find_box(const raster_grid &grid, const int fixed[4][3], short *low, short *high)
{
    bool any = true;
    for (int d = 0; d < 3; d++) {
        int least = fixed[0][d], most = least;
        for (int n = 1; n < 4; n++) {
            least = min(least, fixed[n][d]);
            most = max(most, fixed[n][d]);
        }
        least = max(-(-least >> grid.fraction_bits), 0);
        most = min(most >> grid.fraction_bits, grid.target.size[d] - 1);
        any = any && least <= most;
        low[d] = (short)least;
        high[d] = (short)most;
    }
    return any;
}

/* pliant_raster_tet. own_rest: of its own node. All four threads come here together. */
static __device__ __forceinline__ void set_up(const gpu_raster &raster, const int fixed[4][3], const double *own_rest, bool keep, gpu_tet &out)
{
    const raster_grid &grid = raster.grid;
    const int v = (int)threadIdx.x % 4, axis = v < 3 ? v : 0;
    long long normal[3];
    short low[3], high[3];
    const double volume = gpu_normals(fixed, v, normal);
    const bool drawn = (grid.mirrored ? volume < 0 : volume > 0) & find_box(grid, fixed, low, high);
    double rest[4], map[4], rounded[4];
    for (int n = 0; n < 4; n++) {
        double x = of_thread(own_rest[0], n), y = of_thread(own_rest[1], n), z = of_thread(own_rest[2], n);
        rest[n] = axis == 0 ? x : axis == 1 ? y : z;
    }
    gpu_map(grid, fixed, rest, normal, volume, map);
    const bool whole = all_of_four(gpu_is_whole(grid, raster.source_size[axis], fixed, rest, map, rounded));
    for (int c = 0; c < 4; c++) map[c] = whole ? rounded[c] : map[c];
    const bool inner = all_of_four(gpu_stays_inside(raster.source_size[axis], rest, map));
    gpu_tet::plane plane;
    for (int d = 0; d < 3; d++) {
        if (grid.mirrored) normal[d] = -normal[d];
        plane.normal[d] = (double)normal[d];
    }
    int point[3];
    for (int d = 0; d < 3; d++) point[d] = v == 0 ? fixed[1][d] : fixed[0][d];
    const long long value = gpu_plane_value(grid, normal, point);
    long long near = value;
    for (int d = 0; d < 3; d++) near += normal[d] * (low[d] / BRICK * BRICK);
    plane.near = (double)near;
    const unsigned long long bricks = and_of_four(drawn ? gpu_find_bricks(low, high, plane) : 0);
    if (!keep) return;
    if (v == 0) {
        out.kind = !drawn ? RASTER_NOTHING : whole ? RASTER_COPY : RASTER_SAMPLE;
        out.inner = inner;
        out.bricks = bricks;
        for (int d = 0; d < 3; d++) {
            out.low[d] = low[d];
            out.high[d] = high[d];
        }
    }
    if (!drawn) return;
    out.planes[v] = plane;
    out.factor[v] = normal[0] != 0 ? 1 / fabs(plane.normal[0]) : 4 * BRICK;
    out.value[v] = value;
    if (v < 3)
        for (int c = 0; c < 4; c++) out.map[v][c] = map[c];
}

/* Four threads a tetrahedron. Every one is listed in every brick that it touches, since one that stays may share a brick with
 * one that moves; bricks are dirty where one that moved was or is. */
static __global__ void __launch_bounds__(THREADS, 4) cull_kernel(gpu_raster raster, const double *__restrict__ d_positions, bool all)
{
    const int own = (int)(blockIdx.x * THREADS + threadIdx.x) / 4, v = (int)threadIdx.x % 4;
    const bool there = own < raster.num_tets;
    const int t = there ? own : raster.num_tets - 1; /* the last threads go along, since all talk to each other */
    const size_t node = (size_t)raster.d_tets[4 * (size_t)t + v];
    int mine[3], fixed[4][3], *last = raster.d_fixed + 12 * (size_t)t + 3 * v;
    gpu_fix(raster.grid, d_positions + 3 * node, mine);
    bool still = !all;
    for (int d = 0; d < 3; d++) {
        still = still && last[d] == mine[d];
        for (int n = 0; n < 4; n++) fixed[n][d] = of_thread(mine[d], n);
    }
    still = all_of_four(still);
    gpu_tet *stored = static_cast<gpu_tet *>(raster.d_setup) + t;
    auto dirty = [&](int brick) { raster.d_dirty[brick] = 1; };
    auto add = [&](int brick) {
        int place = atomicAdd(raster.d_count + brick, 1); /* any order: the lowest index wins all the same */
        if (place < raster.capacity) raster.d_list[(size_t)brick * raster.capacity + place] = t;
    };
    if (there && !still && !all) visit_bricks(raster, *stored, dirty);
    __syncwarp();
    if (__any_sync(0xffffffff, there && !still)) { /* setting up one that stayed gives what it was */
        double rest[3];
        for (int d = 0; d < 3; d++) rest[d] = raster.d_rest[3 * node + d];
        if (there)
            for (int d = 0; d < 3; d++) last[d] = mine[d];
        set_up(raster, fixed, rest, there, *stored);
        __syncwarp();
    }
    if (!there) return;
    visit_bricks(raster, *stored, [&](int brick) {
        if (!still) dirty(brick);
        add(brick);
    });
}

extern "C" size_t pliant_cuda_setup_bytes(void) { return sizeof(gpu_tet); }

extern "C" pliant_status pliant_cuda_cull(const gpu_raster *raster, const double *d_positions, bool all, cudaStream_t stream)
{
    const long long threads = 4 * (long long)raster->num_tets;
    if (all) CUDA_TRY(CUDA_CALL(cudaMemsetAsync(raster->d_dirty, 1, (size_t)raster->num_bricks, stream)));
    cull_kernel<<<(unsigned)((threads + THREADS - 1) / THREADS), THREADS, 0, stream>>>(*raster, d_positions, all);
    return CUDA_LAUNCHED("cull_kernel");
}
