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
    ROW_STEP = BRICK + 1, /* rows of owners lie so far apart that rows of a warp do not share memory banks */
    QUEUE = 64,
    HALVES = 2            /* a thread takes every second row of a slice */
};

/* Along i, row (j, k) is cut by a plane at = at + j step_j + k step_k, or a little before where it begins what is held, a
 * little behind where it ends that. */
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
    unsigned short start[CHUNK + 1]; /* slices of the candidates before */
    unsigned queue[WARPS][QUEUE];    /* rows that a candidate may hold voxels of */
    int id[MOST + 2];
    unsigned char copies[MOST + 2];
    alignas(16) unsigned owner[BRICK_ROWS * ROW_STEP]; /* 256 index + place among the candidates: the least wins */
    unsigned first; /* the least of them */
    int counts[WARPS];
    int base[3];
    unsigned base_index;
    limits limit;
    int inner;
};

static const float far_away = 1e30f;

/* More than the whole brick where a plane is along the rows: only the exact way tells on which side of it they are. */
static const float no_idea = 1e9f;

/* The cut of a plane that may leave part of the brick, and the doubt that is in it. One along the rows is made steep. */
static __device__ __forceinline__ cut cut_of(const gpu_plane &plane, bool rising)
{
    const float size = BRICK * (fabsf((float)plane.step_j) + fabsf((float)plane.step_k)), steep = 1e4f / size;
    const bool crosses = plane.factor < BRICK;
    const float factor = (rising ? -1.0f : 1.0f) * (crosses ? (float)plane.factor : steep);
    cut out = {factor * (float)plane.value, factor * (float)plane.step_j, factor * (float)plane.step_k, 0};
    const float doubt = 2e-6f * (fabsf(out.at) + BRICK * (fabsf(out.step_j) + fabsf(out.step_k)));
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

/* ---- the queue: place in the chunk << 17 | k << 13 | j << 9 | first << 5 | last << 1 | whether only the exact way can tell */

/* The least key of this thread. */
static __device__ __forceinline__ unsigned claim(brick_state &brick, int first, unsigned row, unsigned least)
{
    const int c = (int)(row >> 17), k = (int)(row >> 13 & 15), j = (int)(row >> 9 & 15);
    const unsigned key = (unsigned)brick.id[first + c] << 8 | (unsigned)(first + c);
    interval held = {(int)(row >> 5 & 15), (int)(row >> 1 & 15)};
    if (row & 1) held = exact_interval(brick, c, j, k);
    if (held.first <= held.last) least = min(least, key);
    unsigned *owner = brick.owner + ROW_STEP * (BRICK * k + j);
    for (int i = held.first; i <= held.last; i++) atomicMin(owner + i, key);
    return least;
}

/* Where cuts begin and end the rows of one slice. */
struct slice_cuts { float at[CUTS], step[CUTS], twice_doubt, low, high; };

static __device__ __forceinline__ slice_cuts cuts_of_slice(const brick_state &brick, int c, int k, const extent &box)
{
    slice_cuts out;
#pragma unroll
    for (int p = 0; p < CUTS; p++) {
        const cut by = brick.cuts[c][p];
        out.at[p] = fmaf(by.step_k, (float)k, by.at);
        out.step[p] = by.step_j;
        if (p == 0) out.twice_doubt = 2 * by.doubt;
    }
    out.low = floor_shift + (float)box.low[0];
    out.high = floor_shift + (float)box.high[0];
    return out;
}

/* What row j may hold, in doubt too much, as an entry of the queue; false: nothing. */
static __device__ __forceinline__ bool look_at(const slice_cuts &by, float j, unsigned *entry)
{
    float at[CUTS];
#pragma unroll
    for (int p = 0; p < CUTS; p++) at[p] = fmaf(by.step[p], j, by.at[p]);
    const float begin = fmaxf(fmaxf(at[0], at[1]), at[2]), end = fminf(fminf(at[3], at[4]), at[5]);
    const float first = fmaxf(__fadd_ru(begin, floor_shift), by.low), last = fminf(__fadd_rd(end, floor_shift), by.high);
    const bool sure = first == fmaxf(__fadd_ru(begin + by.twice_doubt, floor_shift), by.low) &&
                      last == fminf(__fadd_rd(end - by.twice_doubt, floor_shift), by.high);
    *entry = ((unsigned)__float_as_int(first) & 15) << 5 | ((unsigned)__float_as_int(last) & 15) << 1 | !sure;
    return first <= last;
}

/* Threads take slices of candidates and look at their rows; those that hold voxels in all likelihood are claimed 32 at a time. */
static __device__ __forceinline__ unsigned claim_all(brick_state &brick, int first)
{
    const int lane = (int)threadIdx.x % 32, slices = HALVES * brick.start[CHUNK];
    unsigned *queue = brick.queue[threadIdx.x / 32];
    unsigned least = ~0u;
    int waiting = 0;
    for (int begin = (int)threadIdx.x - lane; begin < slices; begin += THREADS) {
        const int slice = (begin + lane) / HALVES;
        int c = 0;
#pragma unroll
        for (int half = CHUNK / 2; half > 0; half /= 2)
            if (brick.start[c + half] <= slice) c += half;
        const extent box = brick.box[c];
        const int k = box.low[2] + slice - brick.start[c];
        const slice_cuts by = cuts_of_slice(brick, c, k, box);
        const int last = begin + lane < slices ? box.high[1] : -1;
        for (int j = box.low[1] + lane % HALVES; __any_sync(0xffffffff, j <= last); j += HALVES) {
            unsigned entry;
            const bool keep = look_at(by, (float)j, &entry) && j <= last;
            const unsigned kept = __ballot_sync(0xffffffff, keep);
            if (keep) queue[waiting + __popc(kept & ((1u << lane) - 1))] = (unsigned)(c << 17 | k << 13 | j << 9) | entry;
            waiting += __popc(kept);
            if (waiting < 32) continue;
            __syncwarp();
            waiting -= 32;
            const unsigned row = queue[waiting + lane];
            __syncwarp();
            least = claim(brick, first, row, least);
        }
    }
    __syncwarp();
    if (lane < waiting) least = claim(brick, first, queue[lane], least);
    return least;
}

/* Owners of all voxels of a part, from the candidates in brick.id, into brick.owner. The lowest index wins, whatever the order. */
static __device__ __forceinline__ void find_owners(const gpu_raster &raster, const part &where, int count, const int *origin, brick_state &brick)
{
    unsigned least = ~0u;
    for (int first = 0; first < count; first += CHUNK) {
        __syncthreads();
        load_planes(raster, where, first, count, origin, brick);
        __syncthreads();
        if (threadIdx.x < 32) number_slices(brick);
        __syncthreads();
        least = min(least, claim_all(brick, first));
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
