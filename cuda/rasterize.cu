#include "check.h"
#include "raster_math.cuh"
#include "rasterize.h"

/* ---- set up tetrahedra, list them by brick */

template <class Visit> static __device__ void visit_bricks(const gpu_raster &raster, const gpu_tet &tet, Visit visit)
{
    if (tet.kind == RASTER_NOTHING) return;
    int low[3], high[3], at[3];
    for (int d = 0; d < 3; d++) {
        low[d] = tet.low[d] / BRICK;
        high[d] = tet.high[d] / BRICK;
    }
    const int across = raster.grid.bricks[0], down = raster.grid.bricks[1];
    if (gpu_in_mask(tet)) {
        for (unsigned long long left = tet.bricks; left; left &= left - 1) {
            int bit = __ffsll((long long)left) - 1;
            visit(low[0] + (bit & 3) + across * (low[1] + (bit >> 2 & 3) + down * (low[2] + (bit >> 4))));
        }
        return;
    }
    for (at[2] = low[2]; at[2] <= high[2]; at[2]++)
        for (at[1] = low[1]; at[1] <= high[1]; at[1]++)
            for (at[0] = low[0]; at[0] <= high[0]; at[0]++)
                if (gpu_cuts(tet, at)) visit(at[0] + across * (at[1] + down * at[2]));
}

/* Every tetrahedron is listed in every brick that it touches, since one that stays may share a brick with one that moves;
 * bricks are dirty where one that moves was or is. */
static __global__ void __launch_bounds__(128) cull_kernel(gpu_raster raster, const double *__restrict__ d_positions, bool all)
{
    int t = (int)(blockIdx.x * blockDim.x + threadIdx.x);
    if (t >= raster.num_tets) return;
    int4 nodes = reinterpret_cast<const int4 *>(raster.d_tets)[t];
    int fixed[4][3];
    gpu_fix(raster.grid, d_positions + 3 * (size_t)nodes.x, fixed[0]);
    gpu_fix(raster.grid, d_positions + 3 * (size_t)nodes.y, fixed[1]);
    gpu_fix(raster.grid, d_positions + 3 * (size_t)nodes.z, fixed[2]);
    gpu_fix(raster.grid, d_positions + 3 * (size_t)nodes.w, fixed[3]);
    int *last = raster.d_fixed + 12 * (size_t)t;
    bool moved = all;
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++) moved = moved || last[3 * v + d] != fixed[v][d];
    gpu_tet *stored = static_cast<gpu_tet *>(raster.d_setup) + t;
    auto add = [&](int brick) {
        int place = atomicAdd(raster.d_count + brick, 1); /* any order: the lowest index wins all the same */
        if (place < raster.capacity) raster.d_list[(size_t)brick * raster.capacity + place] = t;
    };
    if (!moved) {
        visit_bricks(raster, *stored, add);
        return;
    }
    if (!all) visit_bricks(raster, *stored, [&](int brick) { raster.d_dirty[brick] = 1; });
    double rest[4][3];
    const int node[4] = {nodes.x, nodes.y, nodes.z, nodes.w};
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++) {
            rest[v][d] = raster.d_rest[3 * (size_t)node[v] + d];
            last[3 * v + d] = fixed[v][d];
        }
    gpu_tet tet;
    gpu_make_tet(raster.grid, raster.source_size, fixed, rest, tet);
    *stored = tet;
    visit_bricks(raster, tet, [&](int brick) {
        raster.d_dirty[brick] = 1;
        add(brick);
    });
}

/* ---- voxels */

enum {
    THREADS = 256,
    CHUNK = THREADS / 4,  /* tetrahedra whose planes are in shared memory at a time */
    MOST = 254,           /* candidates that a byte can name */
    NOBODY = 255
};

struct slot { float origin[3], step_i[3], step_j[3], step_k[3]; };

struct limits { /* relative to the brick's base voxel */
    float low[3], high[3], last[3];
};

struct brick_state {
    union {
        gpu_plane planes[CHUNK][4]; /* rising ones from the front, others from the back */
        slot slots[MOST];
    };
    unsigned char rising[CHUNK], others[CHUNK], low[CHUNK][3], high[CHUNK][3];
    int id[MOST];
    unsigned char used[MOST + 2], copies[MOST + 2];
    alignas(16) unsigned char owner[BRICK_VOXELS];
    int first;      /* lowest index among the owners */
    int base[3];
    long long base_index;
    limits limit;
    int inner;
};

/* floor of a number below 2^22 in size, as a float and as an integer, without the slow conversions */
static __device__ __forceinline__ float floor_small(float value, int *whole)
{
    const float shift = 12582912.0f;
    float shifted = __fadd_rd(value, shift);
    *whole = __float_as_int(shifted) - __float_as_int(shift);
    return shifted - shift;
}

template <bool INNER> static __device__ __forceinline__ float split(float at, const limits &limit, int d, int *whole)
{
    if (INNER) return at - floor_small(at, whole);
    at = at > limit.low[d] ? at : limit.low[d];
    at = at < limit.high[d] ? at : limit.high[d];
    float below = floor_small(at, whole);
    if (below > limit.last[d]) {
        below = limit.last[d];
        *whole = (int)below;
    }
    return at - below;
}

static __device__ __forceinline__ float between(float a, float b, float t) { return a + t * (b - a); }

/* whole numbers along x, as on the CPU (src/warp/sample.h) */
static __device__ __forceinline__ float weigh(unsigned pair, int weight)
{
    int left = (short)(pair & 0xffff), right = (int)pair >> 16;
    return (float)((left << 14) + (right - left) * weight);
}

template <class Voxel> struct sampler {
    template <bool INNER>
    static __device__ __forceinline__ Voxel sample(const gpu_raster &raster, const limits &limit, long long base, const float *at, bool)
    {
        int i, j, k;
        float x = split<INNER>(at[0], limit, 0, &i), y = split<INNER>(at[1], limit, 1, &j), z = split<INNER>(at[2], limit, 2, &k);
        const unsigned *corner = static_cast<const unsigned *>(raster.d_source) + base + (i + j * raster.source_step[1] + k * raster.source_step[2]);
        unsigned p00 = __ldg(corner), p10 = __ldg(corner + raster.source_step[1]);
        corner += raster.source_step[2];
        unsigned p01 = __ldg(corner), p11 = __ldg(corner + raster.source_step[1]);
        int weight = __float2int_rn(x * 16384.0f);
        float low = between(weigh(p00, weight), weigh(p10, weight), y), high = between(weigh(p01, weight), weigh(p11, weight), y);
        return (Voxel)__float2int_rn(between(low, high, z) * (1.0f / 16384.0f));
    }
};

template <> struct sampler<float> {
    template <bool INNER>
    static __device__ __forceinline__ float sample(const gpu_raster &raster, const limits &limit, long long base, const float *at, bool copy)
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

/* Planes of up to CHUNK candidates, four threads each. */
static __device__ void load_planes(const gpu_raster &raster, const int *list, int first, int count, const int *origin, brick_state &brick)
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
    if (side == PLANE_RISING) brick.planes[c][__popc(rising & ((1u << v) - 1))] = plane;
    if (side == PLANE_OTHER) brick.planes[c][3 - __popc(others & ((1u << v) - 1))] = plane;
    if (v < 3) { /* a tetrahedron that has no voxel here gets a box without any */
        int low = tet->low[v] - origin[v], high = tet->high[v] - origin[v];
        brick.low[c][v] = (unsigned char)(empty ? BRICK : low > 0 ? low : 0);
        brick.high[c][v] = (unsigned char)(high < BRICK - 1 ? high : BRICK - 1);
    } else {
        brick.rising[c] = (unsigned char)__popc(rising);
        brick.others[c] = (unsigned char)__popc(others);
        brick.id[first + c] = id;
    }
}

/* Whether a candidate may own a voxel in rows [j, j + 8) x [k, k + 4): by its box, and by each plane where it is largest. */
static __device__ bool may_own(const brick_state &brick, int c, int j, int k)
{
    if (brick.low[c][0] > brick.high[c][0] || brick.low[c][1] > j + 7 || brick.high[c][1] < j || brick.low[c][2] > k + 3 || brick.high[c][2] < k)
        return false;
    bool may = true;
    for (int p = 0; p < 4; p++) {
        bool rising = p < brick.rising[c];
        if (!rising && p < 4 - brick.others[c]) continue;
        const gpu_plane &plane = brick.planes[c][p];
        double most = plane.value + plane.step_j * (plane.step_j > 0 ? j + 7 : j) + plane.step_k * (plane.step_k > 0 ? k + 3 : k);
        may = may && most * plane.factor >= (rising ? -(BRICK - 1) : 0);
    }
    return may;
}

/* Voxels of row (j, k) that a candidate holds, a bit each. */
static __device__ __forceinline__ unsigned row_mask(const brick_state &brick, int c, int j, int k)
{
    if (j < brick.low[c][1] || j > brick.high[c][1] || k < brick.low[c][2] || k > brick.high[c][2]) return 0;
    double rise = -(double)brick.low[c][0], fall = brick.high[c][0];
    for (int p = 0; p < brick.rising[c]; p++) {
        const gpu_plane &plane = brick.planes[c][p];
        double t = (plane.value + plane.step_j * j + plane.step_k * k) * plane.factor;
        rise = t < rise ? t : rise;
    }
    for (int p = 3; p > 3 - brick.others[c]; p--) {
        const gpu_plane &plane = brick.planes[c][p];
        double t = (plane.value + plane.step_j * j + plane.step_k * k) * plane.factor;
        fall = t < fall ? t : fall;
    }
    int first = rise < -BRICK ? BRICK : -__double2int_rd(rise), last = fall < -1 ? -1 : __double2int_rd(fall);
    return (0xffffu << first) & (0xffffu >> (BRICK - 1 - last));
}

/* four bytes of all ones or zeros from four bits */
static __device__ __forceinline__ unsigned spread(unsigned bits) { return ((bits & 15) * 0x00204081u & 0x01010101u) * 255u; }

/* Owners of all voxels, into brick.owner: one thread a row, a warp 8 x 4 rows. The lowest index wins, whatever the order. */
static __device__ void find_owners(const gpu_raster &raster, const int *list, int count, const int *origin, brick_state &brick)
{
    const int warp = (int)threadIdx.x / 32, lane = (int)threadIdx.x % 32;
    const int warp_j = warp % 2 * 8, warp_k = warp / 2 * 4, j = warp_j + lane % 8, k = warp_k + lane / 8;
    unsigned owner[4] = {~0u, ~0u, ~0u, ~0u}, owned = 0;
    for (int first = 0; first < count; first += CHUNK) {
        __syncthreads();
        load_planes(raster, list, first, count, origin, brick);
        __syncthreads();
        int here = count - first < CHUNK ? count - first : CHUNK;
        for (int part = 0; part < here; part += 32) {
            unsigned left = __ballot_sync(0xffffffff, part + lane < here && may_own(brick, part + lane, warp_j, warp_k));
            for (; left; left &= left - 1) {
                int c = part + __ffs((int)left) - 1, name = first + c;
                unsigned mask = row_mask(brick, c, j, k), fresh = mask & ~owned;
                for (unsigned clash = mask & owned; clash; clash &= clash - 1) { /* on a shared face, or folded over */
                    int i = __ffs((int)clash) - 1;
                    if (brick.id[name] < brick.id[owner[i / 4] >> 8 * (i % 4) & 255]) fresh |= 1u << i;
                }
                if (!fresh) continue;
                owned |= fresh;
                brick.used[name] = 1;
                for (int w = 0; w < 4; w++) {
                    unsigned bytes = spread(fresh >> 4 * w);
                    owner[w] = (owner[w] & ~bytes) | (bytes & (unsigned)name * 0x01010101u);
                }
            }
        }
    }
    *reinterpret_cast<uint4 *>(brick.owner + BRICK * (BRICK * k + j)) = make_uint4(owner[0], owner[1], owner[2], owner[3]);
}

/* The source voxel that maps are relative to: where the first owner has the middle of the brick. */
static __device__ void choose_base(const gpu_raster &raster, const gpu_tet &tet, const int *origin, brick_state &brick)
{
    brick.base_index = 0;
    for (int d = 0; d < 3; d++) {
        int size = raster.source_size[d], base = gpu_base(tet, origin, d, size), end = size - 1;
        brick.base[d] = base;
        brick.limit.low[d] = (float)-base;
        brick.limit.high[d] = (float)(end - base);
        brick.limit.last[d] = (float)((end > 0 ? end - 1 : 0) - base);
        brick.base_index += (long long)base * raster.source_step[d];
    }
}

static __device__ void fill_slot(const gpu_tet &tet, const int *origin, const int *base, slot &out)
{
    for (int d = 0; d < 3; d++) {
        out.origin[d] = gpu_slot_origin(tet, origin, d, base[d]);
        out.step_i[d] = (float)tet.map[0][d];
        out.step_j[d] = (float)tet.map[1][d];
        out.step_k[d] = (float)tet.map[2][d];
    }
}

static __device__ __forceinline__ void source_point(const slot &map, float i, float j, float k, float *at)
{
    for (int d = 0; d < 3; d++) at[d] = map.origin[d] + j * map.step_j[d] + k * map.step_k[d] + i * map.step_i[d];
}

/* Two rows a warp and slice, 16 slices. */
template <class Voxel, bool INNER> static __device__ void write_brick(const gpu_raster &raster, const int *origin, const brick_state &brick)
{
    const int *size = raster.grid.target.size;
    const int i = (int)threadIdx.x % BRICK, j = (int)threadIdx.x / BRICK;
    if (origin[0] + i >= size[0] || origin[1] + j >= size[1]) return;
    int slices = size[2] - origin[2] < BRICK ? size[2] - origin[2] : BRICK;
    size_t slice_step = (size_t)size[0] * (size_t)size[1];
    Voxel *out = static_cast<Voxel *>(raster.d_volume) + (origin[0] + i) + (size_t)size[0] * (size_t)(origin[1] + j) + slice_step * (size_t)origin[2];
    const long long base = brick.base_index;
#pragma unroll 4
    for (int k = 0; k < slices; k++) {
        int name = brick.owner[BRICK * (BRICK * k + j) + i];
        Voxel value = background_of(raster, Voxel());
        if (name != NOBODY) {
            float at[3];
            source_point(brick.slots[name], (float)i, (float)j, (float)k, at);
            value = sampler<Voxel>::template sample<INNER>(raster, brick.limit, base, at, brick.copies[name] != 0);
        }
        out[slice_step * (size_t)k] = value;
    }
}

static __device__ bool holds(const gpu_tet &tet, const int *at)
{
    for (int d = 0; d < 3; d++)
        if (at[d] < tet.low[d] || at[d] > tet.high[d]) return false;
    for (int v = 0; v < 4; v++) {
        long long value = tet.value[v];
        for (int d = 0; d < 3; d++) value += (long long)tet.normal[d][v] * at[d];
        if (value < 0) return false;
    }
    return true;
}

static __device__ int find_owner(const gpu_raster &raster, const int *list, int count, const int *at)
{
    int owner = INT32_MAX;
    for (int c = 0; c < count; c++) {
        int id = list[c];
        if (id < owner && holds(static_cast<const gpu_tet *>(raster.d_setup)[id], at)) owner = id;
    }
    return owner;
}

/* A brick with more candidates than a byte can name: far smaller tetrahedra than bricks, or many pressed together. Each
 * voxel asks them all, first for the base and then for its value: slow and rare. */
template <class Voxel> static __device__ void crowded_brick(const gpu_raster &raster, const int *list, int count, const int *origin, brick_state &brick)
{
    const gpu_tet *tets = static_cast<const gpu_tet *>(raster.d_setup);
    const int *size = raster.grid.target.size;
    for (int pass = 0; pass < 2; pass++) {
        for (int n = (int)threadIdx.x; n < BRICK_VOXELS; n += THREADS) {
            int local[3] = {n % BRICK, n / BRICK % BRICK, n / BRICK_ROWS}, at[3];
            for (int d = 0; d < 3; d++) at[d] = origin[d] + local[d];
            if (at[0] >= size[0] || at[1] >= size[1] || at[2] >= size[2]) continue;
            int owner = find_owner(raster, list, count, at);
            if (pass == 0) {
                if (owner != INT32_MAX) atomicMin(&brick.first, owner);
                continue;
            }
            Voxel value = background_of(raster, Voxel());
            if (owner != INT32_MAX) {
                slot map;
                float point[3];
                fill_slot(tets[owner], origin, brick.base, map);
                source_point(map, (float)local[0], (float)local[1], (float)local[2], point);
                value = sampler<Voxel>::template sample<false>(raster, brick.limit, brick.base_index, point, tets[owner].kind == RASTER_COPY);
            }
            static_cast<Voxel *>(raster.d_volume)[at[0] + (size_t)size[0] * ((size_t)at[1] + (size_t)size[1] * (size_t)at[2])] = value;
        }
        __syncthreads();
        if (pass == 0 && threadIdx.x == 0 && brick.first != INT32_MAX) choose_base(raster, tets[brick.first], origin, brick);
        __syncthreads();
    }
}

/* One block a brick. */
template <class Voxel> static __global__ void __launch_bounds__(THREADS, 4) raster_kernel(gpu_raster raster)
{
    __shared__ brick_state brick;
    const int b = (int)blockIdx.x, thread = (int)threadIdx.x;
    const int dirty = raster.d_dirty[b], count = raster.d_count[b];
    __syncthreads(); /* all have read them */
    if (thread == 0) {
        raster.d_changed[b] = (uint8_t)dirty;
        raster.d_dirty[b] = 0;
        raster.d_count[b] = 0;
        if (count > *raster.d_longest) atomicMax(raster.d_longest, count);
        brick.first = INT32_MAX;
        brick.inner = 1;
    }
    if (!dirty || count > raster.capacity) return;
    const int across = raster.grid.bricks[0], down = raster.grid.bricks[1];
    const int origin[3] = {b % across * BRICK, b / across % down * BRICK, b / across / down * BRICK};
    const int *list = raster.d_list + (size_t)b * raster.capacity;
    const gpu_tet *tets = static_cast<const gpu_tet *>(raster.d_setup);
    if (count > MOST) {
        __syncthreads();
        crowded_brick<Voxel>(raster, list, count, origin, brick);
        return;
    }
    if (thread < MOST) brick.used[thread] = 0;
    find_owners(raster, list, count, origin, brick);
    __syncthreads();
    const bool owns = thread < count && brick.used[thread];
    if (owns) atomicMin(&brick.first, brick.id[thread]);
    __syncthreads();
    if (owns && brick.first == brick.id[thread]) choose_base(raster, tets[brick.first], origin, brick);
    __syncthreads();
    if (owns) {
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
    d_pairs[n] = (unsigned)(unsigned short)(short)d_voxels[n] | (unsigned)(unsigned short)(short)d_voxels[right] << 16;
}

template <class Voxel> static __global__ void clear_kernel(gpu_raster raster, long long count)
{
    for (long long n = (long long)blockIdx.x * blockDim.x + threadIdx.x; n < count; n += (long long)gridDim.x * blockDim.x)
        static_cast<Voxel *>(raster.d_volume)[n] = background_of(raster, Voxel());
}

extern "C" size_t pliant_cuda_setup_bytes(void) { return sizeof(gpu_tet); }

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

extern "C" pliant_status pliant_cuda_cull(const gpu_raster *raster, const double *d_positions, bool all, cudaStream_t stream)
{
    if (all) CUDA_TRY(CUDA_CALL(cudaMemsetAsync(raster->d_dirty, 1, (size_t)raster->num_bricks, stream)));
    cull_kernel<<<(unsigned)((raster->num_tets + 127) / 128), 128, 0, stream>>>(*raster, d_positions, all);
    return CUDA_LAUNCHED("cull_kernel");
}

extern "C" pliant_status pliant_cuda_rasterize(const gpu_raster *raster, cudaStream_t stream)
{
    unsigned blocks = (unsigned)raster->num_bricks;
    switch (raster->encoding) {
    case PLIANT_UINT8: raster_kernel<uint8_t><<<blocks, THREADS, 0, stream>>>(*raster); break;
    case PLIANT_INT16: raster_kernel<int16_t><<<blocks, THREADS, 0, stream>>>(*raster); break;
    case PLIANT_FLOAT32: raster_kernel<float><<<blocks, THREADS, 0, stream>>>(*raster); break;
    }
    return CUDA_LAUNCHED("raster_kernel");
}
