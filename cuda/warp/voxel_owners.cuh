/* Find the owner of each voxel of a brick, or of an eighth of a brick: the element with the lowest index that contains
 * it (src/warp/voxel_owners.h), subject to the labels at a cut (src/warp/part.h).
 * PARTS: some elements may be parts of a cut tetrahedron
 * Rows are found in single precision. If rounding could change the result, the row is computed exactly from the integer
 * corners. */
#ifndef PLIANT_CUDA_VOXEL_OWNERS_CUH
#define PLIANT_CUDA_VOXEL_OWNERS_CUH

#include "cuda/warp/raster_math.cuh"
#include "cuda/warp/rasterize.h"
#include "cuda/warp/sample.cuh"

enum {
    THREADS = 256,
    WARPS = THREADS / 32,
    CHUNK = THREADS / 4,  /* number of tetrahedra whose bounds are in shared memory at once */
    SHARE = BRICK / 4,    /* number of slices of a tetrahedron per thread */
    QUEUE = 3072,         /* maximum number of a chunk's rows that are distributed at once */
    /* maximum number of rows stored for exact computation; if there are more, all rows are computed exactly */
    DOUBTFUL = 1024,
    MAX_CANDIDATES = 254,           /* maximum number of candidates that a byte can index */
    NO_OWNER = 255,
    ROW_STEP = BRICK + 1  /* padding of the owner rows that avoids shared-memory bank conflicts */
};

/* Bounds of a candidate's rows. doubt: maximum inward error of the bounds; they have no outward error. */
struct alignas(16) held { float doubt; unsigned char low, high, row_begins; unsigned key; };

/* Region that is drawn at once: the brick or an eighth of it. Voxels are counted from the brick's origin. */
struct part { int low[3], size; };

struct brick_state {
    union {
        struct {
            /* as in gpu_tet, but relative to the centre of a brick's rows */
            float at[CHUNK][4], step_j[CHUNK][4], step_k[CHUNK][4];
            held rows[CHUNK];
            unsigned short queue[QUEUE], doubtful[DOUBTFUL]; /* rows: 256 index in the chunk + 16 k + j */
        };
        exact_plane planes[CHUNK][4];
        slot slots[NO_OWNER + 1];
    };
    int id[MAX_CANDIDATES];
    unsigned char copies[NO_OWNER + 1];
    alignas(16) unsigned owner[BRICK_ROWS * ROW_STEP]; /* 256 index + position among the candidates; the minimum wins */
    unsigned first; /* minimum owner */
    int counts[WARPS];
    int base[3];
    unsigned base_index;
    limits limit;
    int inner, num_doubtful, num_rows[2]; /* counts of this chunk and of the next one */
};

static __device__ __forceinline__ const gpu_tet &tet_of(const gpu_raster &raster, int id)
{
    return static_cast<const gpu_tet *>(raster.d_setup)[id];
}

/* Return the maximum of the first `begins` (1 to 3) of four numbers, and the minimum of the others. */
static __device__ __forceinline__ float last_begin(const float *at, int begins)
{
    return fmaxf(at[0], fmaxf(begins > 1 ? at[1] : -far_away, begins > 2 ? at[2] : -far_away));
}
static __device__ __forceinline__ float first_end(const float *at, int begins)
{
    return fminf(at[3], fminf(begins > 2 ? far_away : at[2], begins > 1 ? far_away : at[1]));
}

static const float middle_row = 0.5f * (BRICK - 1);

/* Store small integers in the low bits of floats. */
static __device__ __forceinline__ float shifted(int whole)
{
    return __int_as_float((int)(FLOOR_BITS + (unsigned)whole));
}
static __device__ __forceinline__ int unshifted(float value) { return __float_as_int(value) - (int)FLOOR_BITS; }

/* Voxels of a row that a candidate contains. */
struct interval { int first, count; unsigned row, key; };

/* Return the scan index, along an axis, of the rest position of a target voxel. */
static __device__ __forceinline__ double gpu_index(const gpu_tet &tet, int d, const double *voxel)
{
    return part_index(tet.map[d][0], tet.map[d][1], tet.map[d][2], tet.map[d][3], voxel);
}

/* Return which voxels of an element at a cut it may claim. */
static __device__ __forceinline__ part_claim claim_of(const gpu_raster &raster, int id, const double *voxel)
{
    const gpu_tet &tet = tet_of(raster, id);
    const double index[3] = {gpu_index(tet, 0, voxel), gpu_index(tet, 1, voxel), gpu_index(tet, 2, voxel)};
    return part_claims(&raster.parts, raster.parts.elements[id], index);
}

/* Claim voxels one by one for an element at a cut. */
static __device__ __forceinline__ unsigned claim_part(const gpu_raster &raster, brick_state &brick, const interval &own,
                                                      const int *origin, unsigned minimum)
{
    const int id = (int)(own.key >> 8);
    double voxel[3] = {0, (double)(origin[1] + (int)(own.row & 15)), (double)(origin[2] + (int)(own.row >> 4 & 15))};
    for (int i = own.first; i < own.first + own.count; i++) {
        voxel[0] = origin[0] + i;
        if (claim_of(raster, id, voxel) == PART_OTHERS) continue;
        atomicMin(brick.owner + ROW_STEP * (own.row & 255) + i, own.key);
        minimum = min(minimum, own.key);
    }
    return minimum;
}

/* Claim an interval; all threads of a warp must call it. A voxel stays with the lowest index. */
template <bool PARTS>
static __device__ __forceinline__ unsigned claim(const gpu_raster &raster, brick_state &brick, interval own,
                                                 const int *origin, unsigned minimum)
{
    if (PARTS && own.count > 0 && raster.parts.elements[own.key >> 8].box >= 0) {
        minimum = claim_part(raster, brick, own, origin, minimum);
        own.count = 0;
    }
    unsigned *voxel = brick.owner + ROW_STEP * (own.row & 255) + own.first;
    for (int left = own.count; __any_sync(0xffffffff, left > 0); left -= 4, voxel += 4)
#pragma unroll
        for (int i = 0; i < 4; i++)
            if (left > i) atomicMin(voxel + i, own.key);
    return own.count > 0 ? min(minimum, own.key) : minimum;
}

/* Find the voxels of a queued row inside a candidate. A row in doubt is stored for exact computation, and the result is
 * empty. */
static __device__ __forceinline__ interval find_interval(brick_state &brick, unsigned row)
{
    const int c = (int)(row >> 8);
    const float4 start = *reinterpret_cast<const float4 *>(brick.at[c]),
                 step_j = *reinterpret_cast<const float4 *>(brick.step_j[c]),
                 step_k = *reinterpret_cast<const float4 *>(brick.step_k[c]);
    const held by = brick.rows[c];
    const float j = (float)(row & 15) - middle_row, k = (float)(row >> 4 & 15) - middle_row;
    const float at[4] = {fmaf(step_k.x, k, fmaf(step_j.x, j, start.x)), fmaf(step_k.y, k, fmaf(step_j.y, j, start.y)),
                         fmaf(step_k.z, k, fmaf(step_j.z, j, start.z)), fmaf(step_k.w, k, fmaf(step_j.w, j, start.w))};
    const float begin = last_begin(at, by.row_begins), end = first_end(at, by.row_begins), low = shifted(by.low),
                high = shifted(by.high);
    const float first = fmaxf(__fadd_ru(begin, floor_shift), low), last = fminf(__fadd_rd(end, floor_shift), high);
    interval out = {unshifted(first), first > last ? 0 : unshifted(last) - unshifted(first) + 1, row, by.key};
    const bool sure = first == fmaxf(__fadd_ru(begin + by.doubt, floor_shift), low) &&
                      last == fminf(__fadd_rd(end - by.doubt, floor_shift), high);
    if (out.count > 0 && !sure) {
        const int place = atomicAdd(&brick.num_doubtful, 1);
        if (place < DOUBTFUL) brick.doubtful[place] = (unsigned short)row;
        out.count = 0;
    }
    return out;
}

template <bool PARTS>
static __device__ __forceinline__ unsigned claim_all(const gpu_raster &raster, brick_state &brick, int rows,
                                                     const int *origin, unsigned minimum)
{
    for (int n = (int)threadIdx.x; n - (int)threadIdx.x % 32 < rows; n += THREADS) {
        interval own = {0, 0, 0, 0};
        if (n < rows) own = find_interval(brick, brick.queue[n]);
        minimum = claim<PARTS>(raster, brick, own, origin, minimum);
    }
    return minimum;
}

/* Compute rows in doubt with integers, with four threads per row and one per plane (see voxel_owners.h). */
template <bool PARTS>
static __device__ __forceinline__ unsigned claim_exactly(const gpu_raster &raster, brick_state &brick, int rows,
                                                         const int *origin, unsigned minimum)
{
    const bool all = brick.num_doubtful > DOUBTFUL;
    const unsigned short *list = all ? brick.queue : brick.doubtful;
    const int count = all ? rows : brick.num_doubtful, v = (int)threadIdx.x % 4;
    for (int begin = (int)threadIdx.x / 32 * 8; begin < count; begin += CHUNK) {
        const int n = begin + (int)threadIdx.x % 32 / 4;
        const unsigned row = list[min(n, count - 1)];
        const held by = brick.rows[row >> 8];
        const exact_plane plane = gpu_exact_plane(corners_of(raster), (int)(by.key >> 8), v);
        const long long value = plane.at(origin[0], origin[1] + (int)(row & 15), origin[2] + (int)(row >> 4 & 15));
        const double across = (double)plane.normal[0],
                     t = ((double)value + 0.5) * (across != 0 ? 1 / fabs(across) : 4 * BRICK);
        double rise = across > 0 ? t : BRICK, fall = across > 0 ? BRICK : t;
        for (int step = 1; step < 4; step *= 2) {
            rise = fmin(rise, __shfl_xor_sync(0xffffffff, rise, step));
            fall = fmin(fall, __shfl_xor_sync(0xffffffff, fall, step));
        }
        const int first = max(rise < -BRICK ? BRICK : -__double2int_rd(rise), by.low),
                  last = min(fall < -1 ? -1 : __double2int_rd(fall), by.high);
        const interval own = {first, v == 0 && n < count ? last - first + 1 : 0, row, by.key};
        minimum = claim<PARTS>(raster, brick, own, origin, minimum);
    }
    return minimum;
}

/* Evaluate plane v of a candidate at the centre of a brick's rows. The doubt bounds the error of the four planes: three
 * numbers and two sums, each rounded by at most 2^-24 of `size`, plus the rounding of the added doubt. */
static __device__ __forceinline__ void place_plane(const gpu_tet &tet, int v, const float *from, int begins, int c,
                                                   brick_state &brick, float *doubt)
{
    const double step_j = tet.step_j[v], step_k = tet.step_k[v];
    const float at = (float)(tet.at[v] + step_j * (from[1] + middle_row) + step_k * (from[2] + middle_row) - from[0]);
    const float size = fabsf(at) + 0.5f * BRICK * (fabsf((float)step_j) + fabsf((float)step_k)),
                own = 3e-7f * size + 2e-6f;
    brick.at[c][v] = at + (v < begins ? -own : own);
    brick.step_j[c][v] = (float)step_j;
    brick.step_k[c][v] = (float)step_k;
    *doubt = fmaxf(own, __shfl_xor_sync(0xffffffff, own, 1));
    *doubt = 2 * fmaxf(*doubt, __shfl_xor_sync(0xffffffff, *doubt, 2));
}

/* Find the rows of some slices that a candidate may touch, between the edges of its outline; the estimate never misses
 * a row. Thread v takes slice low[2] + v and every fourth slice after it. */
static __device__ __forceinline__ int find_rows(const gpu_tet &tet, int v, const float *from, const int *low,
                                                const int *high, int *first, int *count)
{
    const float step = tet.edge_step[v], edge = tet.edge[v];
    const float slack = 1e-3f + 1e-6f * (fabsf(edge) + fabsf(step) * (fabsf(from[2]) + BRICK) + fabsf(from[1]));
    const int begins = tet.box.slice_begins;
    const float own = fmaf(step, from[2], edge) - from[1] + (v < begins ? -slack : slack);
    float edges[4], steps[4];
    for (int n = 0; n < 4; n++) {
        edges[n] = __shfl_sync(0xffffffff, own, n, 4);
        steps[n] = __shfl_sync(0xffffffff, step, n, 4);
    }
    int total = 0;
#pragma unroll
    for (int n = 0; n < SHARE; n++) {
        const int k = low[2] + v + 4 * n;
        float at[4];
        for (int e = 0; e < 4; e++) at[e] = fmaf(steps[e], (float)k, edges[e]);
        const float begin = fmaxf(__fadd_ru(last_begin(at, begins), floor_shift), shifted(low[1]));
        const float end = fminf(__fadd_rd(first_end(at, begins), floor_shift), shifted(high[1]));
        first[n] = unshifted(begin);
        count[n] = k <= high[2] && begin <= end ? unshifted(end) - first[n] + 1 : 0;
        total += count[n];
    }
    return total;
}

/* Rows that a thread has found, and their position among the chunk's rows. */
struct found { int first[SHARE], count[SHARE], slice, place; };

/* Prepare up to CHUNK candidates, with four threads each: their bounds and rows. */
static __device__ __forceinline__ found take_candidate(const gpu_raster &raster, const part &where, int begin,
                                                       int count, const int *origin, brick_state &brick, int *num_rows)
{
    const int c = (int)threadIdx.x / 4, v = (int)threadIdx.x % 4, lane = (int)threadIdx.x % 32;
    const bool there = begin + c < count;
    const int id = brick.id[there ? begin + c : 0];
    const gpu_tet &tet = tet_of(raster, id);
    const gpu_box box = tet.box;
    int low[3], high[3];
    float from[3], doubt;
    bool any = there;
    for (int d = 0; d < 3; d++) {
        low[d] = max(box.low[d] - origin[d], where.low[d]);
        high[d] = min(box.high[d] - origin[d], where.low[d] + where.size - 1);
        from[d] = (float)(origin[d] - box.middle(d));
        any = any && low[d] <= high[d];
    }
    if (!any) high[2] = -1;
    place_plane(tet, v, from, box.row_begins, c, brick, &doubt);
    if (v == 0)
        brick.rows[c] = {doubt, (unsigned char)low[0], (unsigned char)high[0], box.row_begins,
                         (unsigned)id << 8 | (unsigned)(begin + c)};
    found out;
    const int own = find_rows(tet, v, from, low, high, out.first, out.count);
    int end = own;
    for (int step = 1; step < 32; step *= 2) {
        const int other = __shfl_up_sync(0xffffffff, end, step);
        if (lane >= step) end += other;
    }
    const int before = lane == 31 ? atomicAdd(num_rows, end) : 0;
    out.place = __shfl_sync(0xffffffff, before, 31) + end - own;
    out.slice = low[2] + v;
    return out;
}

/* Fill the queue with the chunk's rows from `window` on, up to its capacity. */
static __device__ __forceinline__ void fill_queue(const found &own, int window, brick_state &brick)
{
    int place = own.place - window;
#pragma unroll
    for (int n = 0; n < SHARE; n++) {
        int row = ((int)threadIdx.x / 4) << 8 | (own.slice + 4 * n) << 4 | own.first[n];
#pragma unroll 1
        for (int end = place + own.count[n]; place < end; place++, row++)
            if ((unsigned)place < QUEUE) brick.queue[place] = (unsigned short)row;
    }
}

static __device__ __forceinline__ void keep_first(brick_state &brick, unsigned minimum)
{
    for (int half = 16; half > 0; half /= 2) minimum = min(minimum, __shfl_xor_sync(0xffffffff, minimum, half));
    if (threadIdx.x % 32 == 0 && minimum != ~0u) atomicMin(&brick.first, minimum);
}

/* Find the owners of all voxels of a region from the candidates in brick.id, and store them in brick.owner. The lowest
 * index wins, in any order. All threads return together. */
template <bool PARTS>
static __device__ __forceinline__ void find_owners(const gpu_raster &raster, const part &where, int count,
                                                   const int *origin, brick_state &brick)
{
    int chunk = 0;
    if (threadIdx.x == 0) brick.num_rows[0] = 0;
    for (int begin = 0; begin < count; begin += CHUNK, chunk ^= 1) {
        __syncthreads();
        const found own = take_candidate(raster, where, begin, count, origin, brick, &brick.num_rows[chunk]);
        for (int window = 0, left = 1; left > 0; window += QUEUE) {
            fill_queue(own, window, brick);
            if (threadIdx.x == 0) brick.num_doubtful = 0;
            __syncthreads();
            left = brick.num_rows[chunk] - window;
            const int rows = min(left, (int)QUEUE);
            left -= rows;
            if (threadIdx.x == 0) brick.num_rows[chunk ^ 1] = 0;
            keep_first(brick, claim_all<PARTS>(raster, brick, rows, origin, ~0u));
            __syncthreads();
            if (brick.num_doubtful > 0) {
                keep_first(brick, claim_exactly<PARTS>(raster, brick, rows, origin, ~0u));
                __syncthreads();
            }
        }
    }
}

/* Copy the elements of a list that may contain a voxel of the region to brick.id, in the same order. All threads get
 * the count. */
static __device__ int select(const gpu_raster &raster, const part &where, const int *list, int count, const int *origin,
                             brick_state &brick)
{
    const int lane = (int)threadIdx.x % 32, warp = (int)threadIdx.x / 32;
    int selected = 0;
    for (int begin = 0; begin < count; begin += THREADS) {
        const int n = begin + (int)threadIdx.x, id = n < count ? list[n] : 0;
        const gpu_box box = tet_of(raster, id).box;
        bool keep = n < count;
        int low[3], high[3];
        for (int d = 0; d < 3; d++) {
            low[d] = max((int)box.low[d], origin[d] + where.low[d]);
            high[d] = min((int)box.high[d], origin[d] + where.low[d] + where.size - 1);
            keep = keep && low[d] <= high[d];
        }
        for (int v = 0; v < 4 && keep; v++)
            keep = gpu_max_corner(gpu_exact_plane(corners_of(raster), id, v), low, high) >= 0;
        const unsigned kept = __ballot_sync(0xffffffff, keep);
        __syncthreads();
        if (lane == 0) brick.counts[warp] = __popc(kept);
        __syncthreads();
        int place = selected + __popc(kept & ((1u << lane) - 1));
        for (int w = 0; w < WARPS; w++) {
            if (w < warp) place += brick.counts[w];
            selected += brick.counts[w];
        }
        if (keep && place < MAX_CANDIDATES) brick.id[place] = id;
    }
    __syncthreads();
    return selected;
}

/* Same as find_owners for a list of any length. Each voxel tests all elements, which is slow in crowded bricks. Voxels
 * outside the target get no owner. */
template <bool PARTS>
static __device__ void find_owners_by_voxel(const gpu_raster &raster, const int *list, int count, const int *origin,
                                            brick_state &brick)
{
    const int *size = raster.grid.target.size;
    unsigned minimum = ~0u;
    for (int begin = 0; begin < count; begin += CHUNK) {
        const int c = (int)threadIdx.x / 4, v = (int)threadIdx.x % 4, number = min(CHUNK, count - begin);
        __syncthreads();
        if (c < number) {
            const int id = list[begin + c];
            if (v == 0) brick.id[c] = id;
            brick.planes[c][v] = gpu_exact_plane(corners_of(raster), id, v);
        }
        __syncthreads();
        for (int n = (int)threadIdx.x; n < BRICK_VOXELS; n += THREADS) {
            const int i = n % BRICK, row = n / BRICK,
                      at[3] = {origin[0] + i, origin[1] + row % BRICK, origin[2] + row / BRICK};
            if (at[0] >= size[0] || at[1] >= size[1] || at[2] >= size[2]) continue;
            unsigned &owner = brick.owner[ROW_STEP * row + i];
            for (int candidate = 0; candidate < number; candidate++) {
                const unsigned key = (unsigned)brick.id[candidate] << 8 | NO_OWNER;
                bool holds = key < owner;
                for (int p = 0; p < 4 && holds; p++)
                    holds = brick.planes[candidate][p].at(at[0], at[1], at[2]) >= 0;
                if (PARTS && holds && raster.parts.elements[brick.id[candidate]].box >= 0) {
                    const double voxel[3] = {(double)at[0], (double)at[1], (double)at[2]};
                    holds = claim_of(raster, brick.id[candidate], voxel) != PART_OTHERS;
                }
                if (holds) owner = key;
            }
            minimum = min(minimum, owner);
        }
    }
    if (minimum != ~0u) atomicMin(&brick.first, minimum);
    __syncthreads();
}

#endif
