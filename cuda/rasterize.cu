/* The voxels of a brick, by one block: who owns each, then its value. */
#include "check.h"
#include "raster_math.cuh"
#include "rasterize.h"

enum {
    THREADS = 256,
    WARPS = THREADS / 32,
    CHUNK = THREADS / 4,  /* tetrahedra whose planes are in shared memory at a time */
    MOST = 254,           /* candidates that a byte can name */
    NOBODY = 255,
    ROW_STEP = BRICK + 1, /* rows of owners lie so far apart that rows of a warp do not share memory banks */
    QUEUE = BRICK_ROWS + 32
};

struct alignas(16) slot { float origin[3], i_x, step_j[3], i_y, step_k[3], i_z; }; /* steps along i: i_x, i_y, i_z */

struct limits { /* relative to the brick's base voxel */
    float low[3], high[3], last[3];
};

struct bound { float at, step_j, step_k; }; /* of a row's voxels, by one plane; a little too wide */

struct brick_state {
    union {
        struct {
            gpu_plane planes[CHUNK][4]; /* rising ones from the front, others from the back */
            bound bounds[CHUNK][4];
        };
        slot slots[MOST];
    };
    unsigned char rising[CHUNK], others[CHUNK], low[CHUNK][3], high[CHUNK][3];
    unsigned short reciprocal[CHUNK]; /* of the rows of a box along j, in parts of 4096, rounded up */
    unsigned short queue[WARPS][QUEUE]; /* rows that a candidate may hold voxels of: 256 place in the chunk + 16 k + j */
    int id[MOST];
    unsigned char copies[MOST + 2];
    alignas(16) unsigned owner[BRICK_ROWS * ROW_STEP]; /* 256 index + place among the candidates: the least wins */
    unsigned first; /* the least of them */
    int next;       /* candidate to be taken by a warp */
    int base[3];
    unsigned base_index;
    limits limit;
    int inner;
};

/* ---- values */

/* added to numbers below 2^22 in size, rounded down, it leaves their floor in the low bits */
static const float floor_shift = 12582912.0f;
#define FLOOR_BITS 0x4b400000u

template <bool INNER> static __device__ __forceinline__ float split(float at, const limits &limit, int d, unsigned *bits)
{
    if (!INNER) {
        at = at > limit.low[d] ? at : limit.low[d];
        at = at < limit.high[d] ? at : limit.high[d];
    }
    float shifted = __fadd_rd(at, floor_shift), below = shifted - floor_shift;
    if (!INNER && below > limit.last[d]) {
        below = limit.last[d];
        shifted = below + floor_shift;
    }
    *bits = (unsigned)__float_as_int(shifted);
    return at - below;
}

static __device__ __forceinline__ float between(float a, float b, float t) { return a + t * (b - a); }

/* Along x between the two voxels of a pair, with a weight of 14 bits: on the CPU whole numbers in parts of 2^14
 * (src/warp/sample.h) are rounded to float once, which is what a fused multiply-add does. 16 bits under the exponent of 2^23
 * are a float; offset takes that and the bias off again. */
static __device__ __forceinline__ float weigh(unsigned pair, float weight, float offset)
{
    float left = __int_as_float((int)__byte_perm(pair, 0x4b000000u, 0x7410)), right = __int_as_float((int)__byte_perm(pair, 0x4b000000u, 0x7432));
    return fmaf(right - left, weight, left - offset);
}

template <class Voxel> struct sampler {
    /* base: index of the base voxel, less what FLOOR_BITS add to the index */
    static __device__ __forceinline__ unsigned base_of(const gpu_raster &raster, unsigned base_index)
    {
        return base_index - FLOOR_BITS * (1 + (unsigned)raster.source_step[1] + (unsigned)raster.source_step[2]);
    }

    template <bool INNER>
    static __device__ __forceinline__ Voxel sample(const gpu_raster &raster, const limits &limit, unsigned base, const float *at, bool)
    {
        const float offset = sizeof(Voxel) == 2 ? 8421376.0f : 8388608.0f;
        const unsigned step_j = (unsigned)raster.source_step[1], step_k = (unsigned)raster.source_step[2];
        unsigned i, j, k;
        float x = split<INNER>(at[0], limit, 0, &i), y = split<INNER>(at[1], limit, 1, &j), z = split<INNER>(at[2], limit, 2, &k);
        const unsigned place = base + i + j * step_j + k * step_k;
        const unsigned *source = static_cast<const unsigned *>(raster.d_source);
        unsigned p00 = __ldg(source + place), p10 = __ldg(source + step_j + place);
        unsigned p01 = __ldg(source + step_k + place), p11 = __ldg(source + step_j + step_k + place);
        float weight = (x + 768.0f) - 768.0f; /* to 14 bits */
        float low = between(weigh(p00, weight, offset), weigh(p10, weight, offset), y);
        float high = between(weigh(p01, weight, offset), weigh(p11, weight, offset), y);
        return (Voxel)__float_as_int(between(low, high, z) + floor_shift); /* the low bits are the nearest whole number */
    }
};

template <> struct sampler<float> {
    static __device__ __forceinline__ unsigned base_of(const gpu_raster &, unsigned base_index) { return base_index; }

    template <bool INNER>
    static __device__ __forceinline__ float sample(const gpu_raster &raster, const limits &limit, unsigned base, const float *at, bool copy)
    {
        const float *source = static_cast<const float *>(raster.d_source) + base;
        const int *step = raster.source_step;
        if (copy) return __ldg(source + ((int)at[0] * step[0] + (int)at[1] * step[1] + (int)at[2] * step[2]));
        float part[3];
        int whole[3];
        for (int d = 0; d < 3; d++) {
            float inside = at[d];
            inside = inside > limit.low[d] ? inside : limit.low[d];
            inside = inside < limit.high[d] ? inside : limit.high[d];
            float below = floorf(inside);
            below = below < limit.last[d] ? below : limit.last[d];
            whole[d] = (int)below;
            part[d] = inside - below;
        }
        const float *corner = source + (whole[0] * step[0] + whole[1] * step[1] + whole[2] * step[2]);
        float along[4];
        for (int c = 0; c < 4; c++) {
            const float *left = corner + (c & 1) * step[1] + (c >> 1) * step[2];
            along[c] = between(__ldg(left), __ldg(left + step[0]), part[0]);
        }
        return between(between(along[0], along[1], part[1]), between(along[2], along[3], part[1]), part[2]);
    }
};

static __device__ __forceinline__ uint8_t background_of(const gpu_raster &raster, uint8_t) { return raster.background.background.u8; }
static __device__ __forceinline__ int16_t background_of(const gpu_raster &raster, int16_t) { return raster.background.background.i16; }
static __device__ __forceinline__ float background_of(const gpu_raster &raster, float) { return raster.background.background.f32; }

/* ---- owners */

/* Planes of up to CHUNK candidates, four threads each. */
static __device__ __forceinline__ void load_planes(const gpu_raster &raster, const int *list, int first, int count, const int *origin,
                                                   brick_state &brick)
{
    int c = (int)threadIdx.x / 4, v = (int)threadIdx.x % 4, lane = (int)threadIdx.x % 32;
    bool there = first + c < count;
    int id = there ? list[first + c] : 0, side = PLANE_EMPTY;
    const gpu_tet *tet = static_cast<const gpu_tet *>(raster.d_setup) + id;
    gpu_plane plane;
    if (there) side = gpu_find_plane(*tet, v, origin, plane);
    unsigned rising = __ballot_sync(0xffffffff, side == PLANE_RISING) >> (lane & ~3) & 15;
    unsigned others = __ballot_sync(0xffffffff, side == PLANE_OTHER) >> (lane & ~3) & 15;
    unsigned empty = __ballot_sync(0xffffffff, side == PLANE_EMPTY) >> (lane & ~3) & 15;
    if (!there) return;
    if (side == PLANE_RISING || side == PLANE_OTHER) {
        const int place = side == PLANE_RISING ? __popc(rising & ((1u << v) - 1)) : 3 - __popc(others & ((1u << v) - 1));
        const float sign = side == PLANE_RISING ? -1 : 1, factor = sign * (float)plane.factor;
        bound wide = {factor * (float)plane.value, factor * (float)plane.step_j, factor * (float)plane.step_k};
        wide.at += sign * 1e-6f * (fabsf(wide.at) + BRICK * (fabsf(wide.step_j) + fabsf(wide.step_k)));
        brick.planes[c][place] = plane;
        brick.bounds[c][place] = wide;
    }
    if (v < 3) { /* a tetrahedron that has no voxel here gets a box without any */
        int low = max(tet->low[v] - origin[v], 0), high = min(tet->high[v] - origin[v], BRICK - 1);
        bool none = empty || low > high;
        brick.low[c][v] = (unsigned char)(none ? 1 : low);
        brick.high[c][v] = (unsigned char)(none ? 0 : high);
        if (v == 1) brick.reciprocal[c] = (unsigned short)(none ? 0 : __float2int_rz(4096.0f / (float)(high - low + 1)) + 1);
    } else {
        brick.rising[c] = (unsigned char)__popc(rising);
        brick.others[c] = (unsigned char)__popc(others);
        brick.id[first + c] = id;
    }
}

/* Voxels of row (j, k) that a candidate holds, first to last. Sums are of whole numbers and a half and exact where the plane
 * cuts the brick, fused or not. */
static __device__ __forceinline__ void row_interval(const brick_state &brick, int c, int j, int k, int *first, int *last)
{
    double rise = -(double)brick.low[c][0], fall = brick.high[c][0];
    const int rising = brick.rising[c], others = brick.others[c];
#pragma unroll 1
    for (int p = 0; p < rising; p++) {
        const gpu_plane &plane = brick.planes[c][p];
        double t = fma(plane.step_k, (double)k, fma(plane.step_j, (double)j, plane.value)) * plane.factor;
        rise = t < rise ? t : rise;
    }
#pragma unroll 1
    for (int p = 3; p > 3 - others; p--) {
        const gpu_plane &plane = brick.planes[c][p];
        double t = fma(plane.step_k, (double)k, fma(plane.step_j, (double)j, plane.value)) * plane.factor;
        fall = t < fall ? t : fall;
    }
    *first = rise < -BRICK ? BRICK : -__double2int_rd(rise);
    *last = fall < -1 ? -1 : __double2int_rd(fall);
}

/* Whether a candidate may hold a voxel of row (j, k): in float, and in doubt, yes. */
static __device__ __forceinline__ bool may_hold(const brick_state &brick, int c, int j, int k)
{
    float low = brick.low[c][0], high = brick.high[c][0];
    const int rising = brick.rising[c], others = brick.others[c];
#pragma unroll 1
    for (int p = 0; p < rising; p++) {
        const bound &by = brick.bounds[c][p];
        low = fmaxf(low, fmaf(by.step_k, (float)k, fmaf(by.step_j, (float)j, by.at)));
    }
#pragma unroll 1
    for (int p = 3; p > 3 - others; p--) {
        const bound &by = brick.bounds[c][p];
        high = fminf(high, fmaf(by.step_k, (float)k, fmaf(by.step_j, (float)j, by.at)));
    }
    return floorf(high) >= low;
}

/* A row of the queue: its voxels, exactly. The least key of this thread. */
static __device__ __forceinline__ unsigned claim(brick_state &brick, int first, unsigned row, unsigned least)
{
    const int c = (int)(row >> 8), k = (int)(row >> 4 & 15), j = (int)(row & 15);
    const unsigned key = (unsigned)brick.id[first + c] << 8 | (unsigned)(first + c);
    int i, last;
    row_interval(brick, c, j, k, &i, &last);
    if (i <= last) least = min(least, key);
    unsigned *owner = brick.owner + ROW_STEP * (BRICK * k + j);
    for (; i <= last; i++) atomicMin(owner + i, key);
    return least;
}

/* Warps take candidates; rows of their boxes that hold voxels in all likelihood are looked at 32 at a time. */
static __device__ __forceinline__ unsigned claim_all(brick_state &brick, int first, int here)
{
    const int lane = (int)threadIdx.x % 32;
    unsigned short *queue = brick.queue[threadIdx.x / 32];
    unsigned least = ~0u;
    int waiting = 0;
    for (;;) {
        int c = 0;
        if (lane == 0) c = atomicAdd(&brick.next, 1);
        c = __shfl_sync(0xffffffff, c, 0);
        if (c >= here) break;
        const int low_j = brick.low[c][1], low_k = brick.low[c][2], across = brick.high[c][1] - low_j + 1, down = brick.high[c][2] - low_k + 1;
        const int rows = brick.low[c][0] <= brick.high[c][0] ? across * down : 0, reciprocal = brick.reciprocal[c]; /* across may be 0 */
        for (int begin = 0; begin < rows; begin += 32) {
            const int row = begin + lane, down_row = row * reciprocal >> 12; /* row / across, below 256 */
            const int k = low_k + down_row, j = low_j + row - down_row * across;
            const bool keep = row < rows && may_hold(brick, c, j, k);
            const unsigned kept = __ballot_sync(0xffffffff, keep);
            if (keep) queue[waiting + __popc(kept & ((1u << lane) - 1))] = (unsigned short)(c << 8 | k << 4 | j);
            waiting += __popc(kept);
        }
        __syncwarp();
        for (; waiting >= 32; waiting -= 32) least = claim(brick, first, queue[waiting - 32 + lane], least);
        __syncwarp();
    }
    if (lane < waiting) least = claim(brick, first, queue[lane], least);
    return least;
}

/* Owners of all voxels, into brick.owner. The lowest index wins, whatever the order. */
static __device__ __forceinline__ void find_owners(const gpu_raster &raster, const int *list, int count, const int *origin, brick_state &brick)
{
    unsigned least = ~0u;
    for (int n = (int)threadIdx.x; n < BRICK_ROWS * ROW_STEP / 4; n += THREADS) reinterpret_cast<uint4 *>(brick.owner)[n] = make_uint4(~0u, ~0u, ~0u, ~0u);
    for (int first = 0; first < count; first += CHUNK) {
        __syncthreads();
        load_planes(raster, list, first, count, origin, brick);
        if (threadIdx.x == 0) brick.next = 0;
        __syncthreads();
        least = min(least, claim_all(brick, first, count - first < CHUNK ? count - first : CHUNK));
    }
    for (int half = 16; half > 0; half /= 2) least = min(least, __shfl_xor_sync(0xffffffff, least, half));
    if (threadIdx.x % 32 == 0 && least != ~0u) atomicMin(&brick.first, least);
}

/* The source voxel that maps are relative to: where the first owner has the middle of the brick. One thread an axis. */
static __device__ void choose_base(const gpu_raster &raster, const gpu_tet &tet, const int *origin, int d, brick_state &brick)
{
    const int size = raster.source_size[d], base = gpu_base(tet, origin, d, size), end = size - 1;
    brick.base[d] = base;
    brick.limit.low[d] = (float)-base;
    brick.limit.high[d] = (float)(end - base);
    brick.limit.last[d] = (float)((end > 0 ? end - 1 : 0) - base);
    atomicAdd(&brick.base_index, (unsigned)base * (unsigned)raster.source_step[d]);
}

static __device__ __forceinline__ void fill_slot(const gpu_tet &tet, const int *origin, const int *base, slot &out)
{
    for (int d = 0; d < 3; d++) {
        out.origin[d] = gpu_slot_origin(tet.map[d], origin, base[d]);
        out.step_j[d] = (float)tet.map[d][1];
        out.step_k[d] = (float)tet.map[d][2];
    }
    out.i_x = (float)tet.map[0][0];
    out.i_y = (float)tet.map[1][0];
    out.i_z = (float)tet.map[2][0];
}

static __device__ __forceinline__ void source_point(const slot &map, float i, float j, float k, float *at)
{
    at[0] = map.origin[0] + j * map.step_j[0] + k * map.step_k[0] + i * map.i_x;
    at[1] = map.origin[1] + j * map.step_j[1] + k * map.step_k[1] + i * map.i_y;
    at[2] = map.origin[2] + j * map.step_j[2] + k * map.step_k[2] + i * map.i_z;
}

/* Two rows a warp and slice, 16 slices. */
template <class Voxel, bool INNER> static __device__ __forceinline__ void write_brick(const gpu_raster &raster, const int *origin, const brick_state &brick)
{
    const int *size = raster.grid.target.size;
    const int i = (int)threadIdx.x % BRICK, j = (int)threadIdx.x / BRICK;
    if (origin[0] + i >= size[0] || origin[1] + j >= size[1]) return;
    const int slices = size[2] - origin[2] < BRICK ? size[2] - origin[2] : BRICK;
    const size_t slice_step = (size_t)size[0] * (size_t)size[1];
    Voxel *out = static_cast<Voxel *>(raster.d_volume) + (origin[0] + i) + (size_t)size[0] * (size_t)(origin[1] + j) + slice_step * (size_t)origin[2];
    const unsigned *owner = brick.owner + ROW_STEP * j + i;
    const unsigned base = sampler<Voxel>::base_of(raster, brick.base_index);
#pragma unroll 2
    for (int k = 0; k < slices; k++) {
        const int name = (int)(owner[ROW_STEP * BRICK * k] & 255);
        Voxel value = background_of(raster, Voxel());
        if (name != NOBODY) {
            float at[3];
            source_point(brick.slots[name], (float)i, (float)j, (float)k, at);
            value = sampler<Voxel>::template sample<INNER>(raster, brick.limit, base, at, sizeof(Voxel) == 4 && brick.copies[name] != 0);
        }
        *out = value;
        out += slice_step;
    }
}

/* ---- a brick with more candidates than a byte can name: far smaller tetrahedra than bricks, or many pressed together. Each
 * voxel asks them all, first for the base and then for its value: slow and rare. */

static __device__ bool holds(const gpu_tet &tet, const int *at)
{
    for (int d = 0; d < 3; d++)
        if (at[d] < tet.low[d] || at[d] > tet.high[d]) return false;
    for (int v = 0; v < 4; v++) {
        long long value = tet.value[v];
        for (int d = 0; d < 3; d++) value += (long long)tet.planes[v].normal[d] * at[d];
        if (value < 0) return false;
    }
    return true;
}

static __device__ unsigned find_owner(const gpu_raster &raster, const int *list, int count, const int *at)
{
    unsigned owner = ~0u;
    for (int c = 0; c < count; c++) {
        unsigned id = (unsigned)list[c];
        if (id < owner && holds(static_cast<const gpu_tet *>(raster.d_setup)[id], at)) owner = id;
    }
    return owner;
}

template <class Voxel>
static __device__ __forceinline__ void crowded_brick(const gpu_raster &raster, const int *list, int count, const int *origin, brick_state &brick)
{
    const gpu_tet *tets = static_cast<const gpu_tet *>(raster.d_setup);
    const int *size = raster.grid.target.size;
    for (int pass = 0; pass < 2; pass++) {
        for (int n = (int)threadIdx.x; n < BRICK_VOXELS; n += THREADS) {
            int local[3] = {n % BRICK, n / BRICK % BRICK, n / BRICK_ROWS}, at[3];
            for (int d = 0; d < 3; d++) at[d] = origin[d] + local[d];
            if (at[0] >= size[0] || at[1] >= size[1] || at[2] >= size[2]) continue;
            unsigned owner = find_owner(raster, list, count, at);
            if (pass == 0) {
                if (owner != ~0u) atomicMin(&brick.first, owner);
                continue;
            }
            Voxel value = background_of(raster, Voxel());
            if (owner != ~0u) {
                slot map;
                float point[3];
                fill_slot(tets[owner], origin, brick.base, map);
                source_point(map, (float)local[0], (float)local[1], (float)local[2], point);
                value = sampler<Voxel>::template sample<false>(raster, brick.limit, sampler<Voxel>::base_of(raster, brick.base_index), point,
                                                               tets[owner].kind == RASTER_COPY);
            }
            static_cast<Voxel *>(raster.d_volume)[at[0] + (size_t)size[0] * ((size_t)at[1] + (size_t)size[1] * (size_t)at[2])] = value;
        }
        __syncthreads();
        if (pass == 0 && threadIdx.x < 3 && brick.first != ~0u) choose_base(raster, tets[brick.first], origin, (int)threadIdx.x, brick);
        __syncthreads();
    }
}

/* One block a brick. */
template <class Voxel> static __global__ void __launch_bounds__(THREADS, 5) raster_kernel(gpu_raster raster)
{
    __shared__ brick_state brick;
    const int origin[3] = {(int)blockIdx.x * BRICK, (int)blockIdx.y * BRICK, (int)blockIdx.z * BRICK};
    const int b = (int)(blockIdx.x + gridDim.x * (blockIdx.y + gridDim.y * blockIdx.z)), thread = (int)threadIdx.x;
    const int dirty = raster.d_dirty[b], count = raster.d_count[b];
    __syncthreads(); /* all have read them */
    if (thread == 0) {
        raster.d_changed[b] = (uint8_t)dirty;
        raster.d_dirty[b] = 0;
        raster.d_count[b] = 0;
        if (count > *raster.d_longest) atomicMax(raster.d_longest, count);
        brick.first = ~0u;
        brick.base_index = 0;
        brick.inner = 1;
    }
    if (!dirty || count > raster.capacity) return;
    const int *list = raster.d_list + (size_t)b * raster.capacity;
    const gpu_tet *tets = static_cast<const gpu_tet *>(raster.d_setup);
    if (count > MOST) {
        __syncthreads();
        crowded_brick<Voxel>(raster, list, count, origin, brick);
        return;
    }
    find_owners(raster, list, count, origin, brick);
    __syncthreads();
    if (thread < 3 && brick.first != ~0u) choose_base(raster, tets[brick.first >> 8], origin, thread, brick);
    __syncthreads();
    if (thread < count && brick.first != ~0u) {
        const gpu_tet &tet = tets[brick.id[thread]];
        fill_slot(tet, origin, brick.base, brick.slots[thread]);
        brick.copies[thread] = tet.kind == RASTER_COPY;
        if (!tet.inner) brick.inner = 0;
    }
    __syncthreads();
    if (brick.inner) write_brick<Voxel, true>(raster, origin, brick);
    else write_brick<Voxel, false>(raster, origin, brick);
}

/* ---- source and volume */

template <class Voxel>
static __global__ void pair_kernel(const Voxel *__restrict__ d_voxels, unsigned *__restrict__ d_pairs, long long count, int across)
{
    long long n = (long long)blockIdx.x * blockDim.x + threadIdx.x;
    if (n >= count) return;
    long long right = across > 1 && n + 1 < count ? n + 1 : n;
    const unsigned bias = sizeof(Voxel) == 2 ? 0x8000 : 0; /* none is negative then */
    d_pairs[n] = (((unsigned)d_voxels[n] + bias) & 0xffff) | ((unsigned)d_voxels[right] + bias) << 16;
}

template <class Voxel> static __global__ void clear_kernel(gpu_raster raster, long long count)
{
    for (long long n = (long long)blockIdx.x * blockDim.x + threadIdx.x; n < count; n += (long long)gridDim.x * blockDim.x)
        static_cast<Voxel *>(raster.d_volume)[n] = background_of(raster, Voxel());
}

extern "C" pliant_status pliant_cuda_prepare_source(const gpu_raster *raster, const void *d_voxels, void *d_source, int64_t count, cudaStream_t stream)
{
    unsigned blocks = (unsigned)((count + 255) / 256);
    switch (raster->encoding) {
    case PLIANT_UINT8:
        pair_kernel<<<blocks, 256, 0, stream>>>(static_cast<const uint8_t *>(d_voxels), static_cast<unsigned *>(d_source), count, raster->source_size[0]);
        break;
    case PLIANT_INT16:
        pair_kernel<<<blocks, 256, 0, stream>>>(static_cast<const int16_t *>(d_voxels), static_cast<unsigned *>(d_source), count, raster->source_size[0]);
        break;
    case PLIANT_FLOAT32:
        return CUDA_CALL(cudaMemcpyAsync(d_source, d_voxels, (size_t)count * sizeof(float), cudaMemcpyDeviceToDevice, stream));
    }
    return CUDA_LAUNCHED("pair_kernel");
}

extern "C" pliant_status pliant_cuda_clear_volume(const gpu_raster *raster, cudaStream_t stream)
{
    long long count = (long long)pliant_geometry_voxels(&raster->grid.target);
    switch (raster->encoding) {
    case PLIANT_UINT8: clear_kernel<uint8_t><<<1024, 256, 0, stream>>>(*raster, count); break;
    case PLIANT_INT16: clear_kernel<int16_t><<<1024, 256, 0, stream>>>(*raster, count); break;
    case PLIANT_FLOAT32: clear_kernel<float><<<1024, 256, 0, stream>>>(*raster, count); break;
    }
    return CUDA_LAUNCHED("clear_kernel");
}

extern "C" pliant_status pliant_cuda_rasterize(const gpu_raster *raster, cudaStream_t stream)
{
    const dim3 blocks((unsigned)raster->grid.bricks[0], (unsigned)raster->grid.bricks[1], (unsigned)raster->grid.bricks[2]);
    switch (raster->encoding) {
    case PLIANT_UINT8: raster_kernel<uint8_t><<<blocks, THREADS, 0, stream>>>(*raster); break;
    case PLIANT_INT16: raster_kernel<int16_t><<<blocks, THREADS, 0, stream>>>(*raster); break;
    case PLIANT_FLOAT32: raster_kernel<float><<<blocks, THREADS, 0, stream>>>(*raster); break;
    }
    return CUDA_LAUNCHED("raster_kernel");
}
