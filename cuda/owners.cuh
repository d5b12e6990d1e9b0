/* Who owns which voxel of a brick, or of an eighth of one: the tetrahedron of lowest index that holds it (src/warp/owners.h).
 * Rows are found in float; where rounding could decide, in double, which is exact. */
#ifndef PLIANT_CUDA_OWNERS_CUH
#define PLIANT_CUDA_OWNERS_CUH

#include "raster_math.cuh"
#include "rasterize.h"
#include "sample.cuh"

enum {
    THREADS = 256,
    WARPS = THREADS / 32,
    CHUNK = THREADS / 4,  /* tetrahedra whose planes are in shared memory at a time */
    MOST = 254,           /* candidates that a byte can name */
    NOBODY = 255,
    DOUBTFUL = 512,       /* rows kept for the exact way; where there are more, all are looked at again */
    ROW_STEP = BRICK + 1  /* rows of owners lie so far apart that rows of a warp do not share memory banks */
};

/* Along i, row (j, k) is cut by a plane at = at + j step_j + k step_k, with j and k counted from the middle of the brick, or a
 * little before where it begins what is held, a little behind where it ends that. */
struct alignas(16) cut { float at, step_j, step_k, doubt; };
enum { BEGINS = 0, ENDS = 3, CUTS = 6, CUT_STEP = 7 }; /* three that begin a row and three that end it; the step spares banks */

/* of a candidate in the part of the brick: first and last voxel; its planes that cut it */
struct alignas(8) extent { unsigned char low[3], high[3], rising, others; };

/* What is drawn at a time: the brick, or an eighth of it. Voxels are counted from the brick's origin. */
struct part { int low[3], size; };

struct brick_state {
    union {
        struct {
            gpu_plane planes[CHUNK][4]; /* rising ones from the front, others from the back */
            cut cuts[CHUNK][CUT_STEP];  /* their doubt is that of the candidate, in the first */
        };
        slot slots[MOST];
    };
    extent box[CHUNK];
    float2 corner[CHUNK][5];         /* along j and k; the fifth spares banks */
    unsigned short start[CHUNK + 1]; /* slices of the candidates before */
    unsigned short doubtful[DOUBTFUL]; /* rows that only the exact way can tell: 256 place in the chunk + 16 k + j */
    int id[MOST + 2];
    unsigned char copies[MOST + 2];
    alignas(16) unsigned owner[BRICK_ROWS * ROW_STEP]; /* 256 index + place among the candidates: the least wins */
    unsigned first; /* the least of them */
    int counts[WARPS];
    int base[3];
    unsigned base_index;
    limits limit;
    int inner, num_doubtful;
};

static const float far_away = 1e30f;

/* More than the whole brick where a plane is along the rows: only the exact way tells on which side of it they are. */
static const float no_idea = 1e9f;

/* The cut of a plane that may leave part of the brick, and the doubt that is in it. One along the rows is made steep. */
static __device__ __forceinline__ cut cut_of(const gpu_plane &plane, bool rising)
{
    const double half = 0.5 * (BRICK - 1), steep = 1e4 / (BRICK * (fabs(plane.step_j) + fabs(plane.step_k)));
    const bool crosses = plane.factor < BRICK;
    const double factor = (rising ? -1.0 : 1.0) * (crosses ? plane.factor : steep);
    const double middle = plane.value + half * (plane.step_j + plane.step_k);
    cut out = {(float)(factor * middle), (float)(factor * plane.step_j), (float)(factor * plane.step_k), 0};
    /* three numbers and two sums, each rounded by 2^-24 of at most this, once more for what is added here */
    const float doubt = 3e-7f * (fabsf(out.at) + 0.5f * BRICK * (fabsf(out.step_j) + fabsf(out.step_k))) + 2e-6f;
    out.at += (rising ? -1.0f : 1.0f) * (crosses ? doubt : doubt + BRICK);
    out.doubt = crosses ? doubt : no_idea;
    return out;
}

/* Planes of up to CHUNK candidates, four threads each. */
static __device__ __forceinline__ void load_planes(const gpu_raster &raster, const part &where, int first, int count, const int *origin,
                                                   brick_state &brick)
{
    const int c = (int)threadIdx.x / 4, v = (int)threadIdx.x % 4, lane = (int)threadIdx.x % 32;
    const bool there = first + c < count;
    const gpu_tet *tet = static_cast<const gpu_tet *>(raster.d_setup) + brick.id[there ? first + c : 0];
    int low[3], high[3], side = PLANE_EMPTY;
    bool none = !there;
    for (int d = 0; d < 3; d++) {
        low[d] = max(tet->low[d] - origin[d], where.low[d]);
        high[d] = min(tet->high[d] - origin[d], where.low[d] + where.size - 1);
        none = none || low[d] > high[d];
    }
    gpu_plane plane;
    if (!none) side = gpu_find_plane(*tet, v, origin, low, high, plane);
    const unsigned rising = __ballot_sync(0xffffffff, side == PLANE_RISING) >> (lane & ~3) & 15;
    const unsigned others = __ballot_sync(0xffffffff, side == PLANE_OTHER) >> (lane & ~3) & 15;
    const unsigned empty = __ballot_sync(0xffffffff, side == PLANE_EMPTY) >> (lane & ~3) & 15;
    const int num_rising = __popc(rising), num_others = __popc(others);
    float doubt = 0;
    if (there) {
        const int *corner = raster.d_fixed + 12 * (size_t)brick.id[first + c] + 3 * v;
        const float step = 1 / (float)raster.grid.scale; /* a power of two */
        brick.corner[c][v] = make_float2((float)corner[1] * step - (float)origin[1], (float)corner[2] * step - (float)origin[2]);
    }
    if (side == PLANE_RISING || side == PLANE_OTHER) {
        const int before = __popc((side == PLANE_RISING ? rising : others) & ((1u << v) - 1));
        const cut by = cut_of(plane, side == PLANE_RISING);
        brick.planes[c][side == PLANE_RISING ? before : 3 - before] = plane;
        brick.cuts[c][before + (side == PLANE_RISING ? BEGINS : ENDS)] = by;
        doubt = by.doubt;
    }
    if (v < 3 && v >= num_rising) brick.cuts[c][BEGINS + v] = {-far_away, 0, 0, 0};
    if (v < 3 && v >= num_others) brick.cuts[c][ENDS + v] = {far_away, 0, 0, 0};
    doubt = fmaxf(doubt, __shfl_xor_sync(0xffffffff, doubt, 1));
    doubt = fmaxf(doubt, __shfl_xor_sync(0xffffffff, doubt, 2));
    __syncwarp();
    if (v != 0) return;
    brick.cuts[c][0].doubt = doubt;
    extent box;
    for (int d = 0; d < 3; d++) {
        box.low[d] = (unsigned char)(empty ? 1 : low[d]);
        box.high[d] = (unsigned char)(empty ? 0 : high[d]);
    }
    box.rising = (unsigned char)num_rising;
    box.others = (unsigned char)num_others;
    brick.box[c] = box;
}

/* Slices of the candidates of the chunk, numbered through; by one warp. */
static __device__ __forceinline__ void number_slices(brick_state &brick)
{
    const int lane = (int)threadIdx.x;
    int own[2], sum = 0;
    for (int n = 0; n < 2; n++) {
        own[n] = brick.box[2 * lane + n].high[2] - brick.box[2 * lane + n].low[2] + 1;
        sum += own[n];
    }
    int before = sum;
    for (int step = 1; step < 32; step *= 2) {
        int other = __shfl_up_sync(0xffffffff, before, step);
        if (lane >= step) before += other;
    }
    brick.start[2 * lane] = (unsigned short)(before - sum);
    brick.start[2 * lane + 1] = (unsigned short)(before - own[1]);
    if (lane == 31) brick.start[CHUNK] = (unsigned short)before;
}

struct interval { int first, last; }; /* voxels of a row */

/* Voxels of row (j, k) that a candidate holds. Sums are of whole numbers and a half and exact where the plane
 * cuts the brick, fused or not. */
static __device__ __noinline__ interval exact_interval(const brick_state &brick, int c, int j, int k)
{
    const extent box = brick.box[c];
    double rise = -(double)box.low[0], fall = box.high[0];
    for (int p = 0; p < box.rising; p++) {
        const gpu_plane &plane = brick.planes[c][p];
        double t = fma(plane.step_k, (double)k, fma(plane.step_j, (double)j, plane.value)) * plane.factor;
        rise = t < rise ? t : rise;
    }
    for (int p = 3; p > 3 - box.others; p--) {
        const gpu_plane &plane = brick.planes[c][p];
        double t = fma(plane.step_k, (double)k, fma(plane.step_j, (double)j, plane.value)) * plane.factor;
        fall = t < fall ? t : fall;
    }
    return {rise < -BRICK ? BRICK : -__double2int_rd(rise), fall < -1 ? -1 : __double2int_rd(fall)};
}

/* The same in float; in doubt too much, and not sure. */
static __device__ __forceinline__ interval quick_interval(const brick_state &brick, int c, float j, float k, bool *sure)
{
    const float half = 0.5f * (BRICK - 1);
    float at[CUTS], doubt = 0;
#pragma unroll
    for (int p = 0; p < CUTS; p++) {
        const cut by = brick.cuts[c][p];
        at[p] = fmaf(by.step_k, k - half, fmaf(by.step_j, j - half, by.at));
        if (p == 0) doubt = 2 * by.doubt;
    }
    const extent box = brick.box[c];
    const float low = floor_shift + (float)box.low[0], high = floor_shift + (float)box.high[0];
    const float begin = fmaxf(fmaxf(at[0], at[1]), at[2]), end = fminf(fminf(at[3], at[4]), at[5]);
    const float first = fmaxf(__fadd_ru(begin, floor_shift), low), last = fminf(__fadd_rd(end, floor_shift), high);
    *sure = first > last || (first == fmaxf(__fadd_ru(begin + doubt, floor_shift), low) &&
                             last == fminf(__fadd_rd(end - doubt, floor_shift), high));
    if (first > last) return {0, -1};
    return {__float_as_int(first) & 15, __float_as_int(last) & 15};
}

/* Rows of a slice that a tetrahedron may touch: between the points where its edges go through. Never too few. */
static __device__ __forceinline__ void rows_of_slice(const float2 *corner, float k, float *first, float *last)
{
    const float slack = 1e-3f; /* far above rounding */
    float away[4];
    for (int v = 0; v < 4; v++) away[v] = k - corner[v].y;
    *first = far_away;
    *last = -far_away;
#pragma unroll
    for (int a = 0; a < 3; a++)
#pragma unroll
        for (int b = a + 1; b < 4; b++) {
            if (away[a] * away[b] > slack) continue;
            const float at = fmaf(corner[b].x - corner[a].x, __saturatef(__fdividef(away[a], corner[b].y - corner[a].y)), corner[a].x);
            *first = fminf(*first, at);
            *last = fmaxf(*last, at);
        }
    *first -= slack;
    *last += slack;
}

/* The least of the key and what there was, when there is anything to claim. */
static __device__ __forceinline__ unsigned claim(brick_state &brick, int first, int c, int j, int k, const interval &held, unsigned least)
{
    const unsigned key = (unsigned)brick.id[first + c] << 8 | (unsigned)(first + c);
    unsigned *row = brick.owner + ROW_STEP * (BRICK * k + j);
    for (int i = held.first; i <= held.last; i++) atomicMin(row + i, key);
    return held.first <= held.last ? min(least, key) : least;
}

struct slice_rows { int c, k, first, count; };

/* Rows of the chunk's slice number `slice` that its tetrahedron may touch. */
static __device__ __forceinline__ slice_rows rows_of(const brick_state &brick, int slice)
{
    slice_rows out = {0, 0, 0, 0};
#pragma unroll
    for (int half = CHUNK / 2; half > 0; half /= 2)
        if (brick.start[out.c + half] <= slice) out.c += half;
    if (slice >= brick.start[CHUNK]) return out;
    const extent box = brick.box[out.c];
    out.k = box.low[2] + slice - brick.start[out.c];
    float first, last;
    rows_of_slice(brick.corner[out.c], (float)out.k, &first, &last);
    first = fmaxf(ceilf(first), (float)box.low[1]);
    last = fminf(floorf(last), (float)box.high[1]);
    out.first = (int)first;
    out.count = last < first ? 0 : (int)(last - first) + 1;
    return out;
}

/* A warp takes 32 slices at a time, and then their rows, 32 at a time. EXACT: doubtful rows are claimed at once; else they are
 * noted down. The least key of this thread. */
template <bool EXACT> static __device__ __forceinline__ unsigned claim_all(brick_state &brick, int first)
{
    const int lane = (int)threadIdx.x % 32, slices = brick.start[CHUNK];
    unsigned least = ~0u;
    for (int begin = (int)threadIdx.x - lane; begin < slices; begin += THREADS) {
        const slice_rows own = rows_of(brick, begin + lane);
        int end = own.count;
        for (int step = 1; step < 32; step *= 2) {
            const int other = __shfl_up_sync(0xffffffff, end, step);
            if (lane >= step) end += other;
        }
        const int packed = own.c << 8 | own.k << 4 | own.first, before = end - own.count, rows = __shfl_sync(0xffffffff, end, 31);
        for (int row = lane; row - lane < rows; row += 32) {
            int from = 0; /* the lane whose slice has this row */
#pragma unroll
            for (int half = 16; half > 0; half /= 2)
                if (__shfl_sync(0xffffffff, before, from + half) <= row) from += half;
            const int name = __shfl_sync(0xffffffff, packed, from), c = name >> 8, k = name >> 4 & 15;
            const int j = (name & 15) + row - __shfl_sync(0xffffffff, before, from);
            if (row < rows) {
                bool sure;
                interval held = quick_interval(brick, c, (float)j, (float)k, &sure);
                if (EXACT && !sure) held = exact_interval(brick, c, j, k);
                if (EXACT || sure) {
                    least = claim(brick, first, c, j, k, held, least);
                } else {
                    const int place = atomicAdd(&brick.num_doubtful, 1);
                    if (place < DOUBTFUL) brick.doubtful[place] = (unsigned short)(c << 8 | k << 4 | j);
                }
            }
            __syncwarp();
        }
    }
    return least;
}

static __device__ __forceinline__ unsigned claim_doubtful(brick_state &brick, int first)
{
    unsigned least = ~0u;
    if (brick.num_doubtful > DOUBTFUL) return claim_all<true>(brick, first);
    for (int n = (int)threadIdx.x; n < brick.num_doubtful; n += THREADS) {
        const int row = brick.doubtful[n], c = row >> 8, k = row >> 4 & 15, j = row & 15;
        least = claim(brick, first, c, j, k, exact_interval(brick, c, j, k), least);
    }
    return least;
}

/* Owners of all voxels of a part, from the candidates in brick.id, into brick.owner. The lowest index wins, whatever the order. */
static __device__ __forceinline__ void find_owners(const gpu_raster &raster, const part &where, int count, const int *origin,
                                                   brick_state &brick)
{
    unsigned least = ~0u;
    for (int first = 0; first < count; first += CHUNK) {
        __syncthreads();
        load_planes(raster, where, first, count, origin, brick);
        __syncthreads();
        if (threadIdx.x < 32) number_slices(brick);
        if (threadIdx.x == 0) brick.num_doubtful = 0;
        __syncthreads();
        least = min(least, claim_all<false>(brick, first));
        __syncthreads();
        if (brick.num_doubtful > 0) least = min(least, claim_doubtful(brick, first));
    }
    for (int half = 16; half > 0; half /= 2) least = min(least, __shfl_xor_sync(0xffffffff, least, half));
    if (threadIdx.x % 32 == 0 && least != ~0u) atomicMin(&brick.first, least);
}

/* Of a list, those that may hold a voxel of the part, to brick.id in the order of the list. How many; all threads get it. */
static __device__ int select(const gpu_raster &raster, const part &where, const int *list, int count, const int *origin, brick_state &brick)
{
    const int lane = (int)threadIdx.x % 32, warp = (int)threadIdx.x / 32;
    int selected = 0;
    for (int begin = 0; begin < count; begin += THREADS) {
        const int n = begin + (int)threadIdx.x, id = n < count ? list[n] : 0;
        const gpu_tet &tet = static_cast<const gpu_tet *>(raster.d_setup)[id];
        bool keep = n < count;
        int low[3], high[3];
        for (int d = 0; d < 3; d++) {
            low[d] = max(tet.low[d] - origin[d], where.low[d]);
            high[d] = min(tet.high[d] - origin[d], where.low[d] + where.size - 1);
            keep = keep && low[d] <= high[d];
        }
        gpu_plane plane;
        for (int v = 0; v < 4 && keep; v++) keep = gpu_find_plane(tet, v, origin, low, high, plane) != PLANE_EMPTY;
        const unsigned kept = __ballot_sync(0xffffffff, keep);
        __syncthreads();
        if (lane == 0) brick.counts[warp] = __popc(kept);
        __syncthreads();
        int place = selected + __popc(kept & ((1u << lane) - 1));
        for (int w = 0; w < WARPS; w++) {
            if (w < warp) place += brick.counts[w];
            selected += brick.counts[w];
        }
        if (keep && place < MOST) brick.id[place] = id;
    }
    __syncthreads();
    return selected;
}

#endif
