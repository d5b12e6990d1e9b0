/* Draw the voxels of a brick with one block: find the owner of each voxel, then its value. */
#include "cuda/base/check.h"
#include "cuda/warp/voxel_owners.cuh"

#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ < 800
enum { BLOCKS = 4 }; /* minimum number of resident blocks per multiprocessor: full occupancy with few register spills */
#else
enum { BLOCKS = 5 };
#endif

/* Choose the source voxel relative to which maps are stored: the first owner's source position of the brick's centre.
 * One thread per axis. */
static __device__ void choose_base(const gpu_raster &raster, const gpu_tet &tet, const int *origin, int d,
                                   brick_state &brick)
{
    const int size = raster.source_size[d], base = gpu_base(tet, origin, d, size), end = size - 1;
    brick.base[d] = base;
    brick.limit.low[d] = (float)-base;
    brick.limit.high[d] = (float)(end - base);
    brick.limit.last[d] = (float)((end > 0 ? end - 1 : 0) - base);
    atomicAdd(&brick.base_index, (unsigned)base * (unsigned)raster.source_step[d]);
}

static __device__ __forceinline__ void fill_slot(const double (*map)[4], const int *origin, const int *base, slot &out)
{
    for (int d = 0; d < 3; d++) {
        out.origin[d] = gpu_slot_origin(map[d], origin, base[d]);
        out.step_j[d] = (float)map[d][1];
        out.step_k[d] = (float)map[d][2];
    }
    out.i_x = (float)map[0][0];
    out.i_y = (float)map[1][0];
    out.i_z = (float)map[2][0];
}

/* Voxels without owner fetch the scan's first voxel, so that all threads follow the same path. */
static __device__ __forceinline__ void fill_without_owner(const limits &limit, slot &out)
{
    for (int d = 0; d < 3; d++) {
        out.origin[d] = limit.low[d];
        out.step_j[d] = out.step_k[d] = 0;
    }
    out.i_x = out.i_y = out.i_z = 0;
}

static __device__ __forceinline__ double stored(unsigned pair, uint8_t) { return (double)(pair & 0xffff); }
static __device__ __forceinline__ double stored(unsigned pair, int16_t)
{
    return (double)((int)(pair & 0xffff) - 0x8000);
}
static __device__ __forceinline__ double stored(float2 voxel, float) { return (double)voxel.x; }
static __device__ __forceinline__ double stored(unsigned pair, nearest_label) { return (double)(pair & 0xffff); }
static __device__ __forceinline__ nearest_label rounded(double value, nearest_label)
{
    return nearest_label((uint8_t)__double2int_rn(value));
}
static __device__ __forceinline__ uint8_t rounded(double value, uint8_t) { return (uint8_t)__double2int_rn(value); }
static __device__ __forceinline__ int16_t rounded(double value, int16_t) { return (int16_t)__double2int_rn(value); }
static __device__ __forceinline__ float rounded(double value, float) { return (float)value; }

/* Interpolate the voxels of the element's own part. */
template <class Voxel>
static __device__ __forceinline__ double own_value(const gpu_raster &raster, int id, const part_cell &cell,
                                                   const double *values, Voxel)
{
    return part_value(&raster.parts, raster.parts.elements[id], &cell, values);
}
static __device__ __forceinline__ double own_value(const gpu_raster &raster, int id, const part_cell &cell,
                                                   const double *values, nearest_label)
{
    return part_nearest(&raster.parts, raster.parts.elements[id], &cell, values);
}

/* Draw a voxel of an element at a cut from the element's own voxels. Return false if all surrounding voxels belong to
 * the element, so that no masking is needed. Not for elements that copy voxels. */
template <class Voxel>
static __device__ __noinline__ bool draw_masked(const gpu_raster &raster, int id, int i, int j, int k, Voxel *out)
{
    typedef typename sampler<Voxel>::source source;
    const double voxel[3] = {(double)i, (double)j, (double)k};
    const gpu_tet &tet = tet_of(raster, id);
    if (claim_of(raster, id, voxel) != PART_MASKED) return false;
    const double index[3] = {gpu_index(tet, 0, voxel), gpu_index(tet, 1, voxel), gpu_index(tet, 2, voxel)};
    const int32_t *step = raster.source_step;
    part_cell cell;
    double values[8];
    part_find_cell(raster.parts.scan_size, index, &cell);
    const source *from = static_cast<const source *>(raster.d_source) +
                         (cell.low[0] * step[0] + cell.low[1] * step[1] + cell.low[2] * step[2]);
    for (int c = 0; c < 8; c++)
        values[c] = stored(from[(c & 1 ? step[0] : 0) + (c & 2 ? step[1] : 0) + (c & 4 ? step[2] : 0)], Voxel());
    *out = rounded(own_value(raster, id, cell, values, Voxel()), Voxel());
    return true;
}

enum { COPIES = 1, HAS_PARTS = 2 }; /* flags of a candidate */

/* Write the voxels of a region. Adjacent threads write adjacent voxels along i, several loads in flight per thread. */
template <class Voxel, bool INNER, int SIZE, bool PARTS>
static __device__ __forceinline__ void write_voxels(const gpu_raster &raster, const part &where, const int *origin,
                                                    const brick_state &brick)
{
    /* slices per iteration of all threads; voxels in flight per thread */
    enum { SLICES = THREADS / (SIZE * SIZE), AT_ONCE = 2 };
    const int *size = raster.grid.target.size;
    const int i = where.low[0] + (int)threadIdx.x % SIZE, j = where.low[1] + (int)threadIdx.x / SIZE % SIZE;
    if (origin[0] + i >= size[0] || origin[1] + j >= size[1]) return;
    int k = where.low[2] + (int)threadIdx.x / (SIZE * SIZE);
    const int end = min(where.low[2] + SIZE, size[2] - origin[2]);
    const size_t slice_step = SLICES * (size_t)size[0] * (size_t)size[1];
    Voxel *out = static_cast<Voxel *>(raster.d_volume) + (origin[0] + i) +
                 (size_t)size[0] * ((size_t)(origin[1] + j) + (size_t)size[1] * (size_t)(origin[2] + k));
    const unsigned *owner = brick.owner + ROW_STEP * j + i, place = first_place(raster, brick.base_index);
#pragma unroll 1
    for (; k < end; k += AT_ONCE * SLICES, out += AT_ONCE * slice_step) {
        int name[AT_ONCE];
        cell<Voxel> cells[AT_ONCE];
#pragma unroll
        for (int n = 0; n < AT_ONCE; n++) {
            float at[3];
            name[n] = (int)(owner[ROW_STEP * BRICK * (k + n * SLICES)] & 255);
            source_point(brick.slots[name[n]], (float)i, (float)j, (float)(k + n * SLICES), at);
            cells[n] = fetch<Voxel, INNER>(raster, brick.limit, place, at,
                                           sampler<Voxel>::copies &&
                                               (PARTS ? brick.copies[name[n]] & COPIES : brick.copies[name[n]]) != 0);
        }
#pragma unroll
        for (int n = 0; n < AT_ONCE; n++) {
            Voxel value = name[n] != NO_OWNER ? value_in(cells[n]) : background_of(raster, Voxel());
            if (PARTS && k + n * SLICES < end && brick.copies[name[n]] == HAS_PARTS)
                draw_masked(raster, brick.id[name[n]], origin[0] + i, origin[1] + j, origin[2] + k + n * SLICES,
                            &value);
            if (k + n * SLICES < end) out[n * slice_step] = value;
        }
    }
}

/* Write the background to a region without owners. */
template <class Voxel, int SIZE>
static __device__ __forceinline__ void clear_voxels(const gpu_raster &raster, const part &where, const int *origin)
{
    const int *size = raster.grid.target.size;
    for (int n = (int)threadIdx.x; n < SIZE * SIZE * SIZE; n += THREADS) {
        const int i = origin[0] + where.low[0] + n % SIZE, j = origin[1] + where.low[1] + n / SIZE % SIZE;
        const int k = origin[2] + where.low[2] + n / (SIZE * SIZE);
        if (i >= size[0] || j >= size[1] || k >= size[2]) continue;
        static_cast<Voxel *>(raster.d_volume)[i + (size_t)size[0] * ((size_t)j + (size_t)size[1] * (size_t)k)] =
            background_of(raster, Voxel());
    }
}

/* Write the values of a region whose owners are known, starting with all threads together.
 * choose: the base voxel must be chosen; brick.inner is 1 */
template <class Voxel, int SIZE, bool PARTS>
static __device__ __forceinline__ void write_part(const gpu_raster &raster, const part &where, int count, bool choose,
                                                  const int *origin, brick_state &brick)
{
    const int thread = (int)threadIdx.x;
    if (brick.first == ~0u) {
        clear_voxels<Voxel, SIZE>(raster, where, origin);
        return;
    }
    const bool own = thread < count;
    double map[3][4]; /* loads in flight while the base is chosen */
    if (own)
        for (int m = 0; m < 12; m++) map[m / 4][m % 4] = tet_of(raster, brick.id[thread]).map[m / 4][m % 4];
    if (choose && thread < 3) choose_base(raster, tet_of(raster, (int)(brick.first >> 8)), origin, thread, brick);
    __syncthreads();
    if (own) {
        const gpu_box box = tet_of(raster, brick.id[thread]).box;
        fill_slot(map, origin, brick.base, brick.slots[thread]);
        brick.copies[thread] = box.kind == RASTER_COPY ? COPIES : 0;
        if (PARTS && raster.parts.elements[brick.id[thread]].box >= 0) brick.copies[thread] |= HAS_PARTS;
        if (!box.inner) brick.inner = 0;
    } else if (thread == NO_OWNER) {
        fill_without_owner(brick.limit, brick.slots[NO_OWNER]);
        brick.copies[NO_OWNER] = 0;
    }
    __syncthreads();
    if (brick.inner) write_voxels<Voxel, true, SIZE, PARTS>(raster, where, origin, brick);
    else write_voxels<Voxel, false, SIZE, PARTS>(raster, where, origin, brick);
}

/* ---- bricks with more candidates than a byte can index are divided into eighths, and those again into voxels */

/* Draw each voxel separately: its owner from a list of any length, then its value. */
template <class Voxel, bool PARTS>
static __device__ __forceinline__ void draw_by_voxel(const gpu_raster &raster, const int *list, int count,
                                                     const int *origin, brick_state &brick)
{
    const int *size = raster.grid.target.size;
    find_owners_by_voxel<PARTS>(raster, list, count, origin, brick);
    if (threadIdx.x < 3 && brick.first != ~0u)
        choose_base(raster, tet_of(raster, (int)(brick.first >> 8)), origin, (int)threadIdx.x, brick);
    __syncthreads();
    for (int n = (int)threadIdx.x; n < BRICK_VOXELS; n += THREADS) {
        const int local[3] = {n % BRICK, n / BRICK % BRICK, n / BRICK_ROWS};
        int at[3];
        for (int d = 0; d < 3; d++) at[d] = origin[d] + local[d];
        if (at[0] >= size[0] || at[1] >= size[1] || at[2] >= size[2]) continue;
        const unsigned owner = brick.owner[ROW_STEP * (n / BRICK) + local[0]];
        Voxel value = background_of(raster, Voxel());
        if (owner != ~0u) {
            const gpu_tet &tet = tet_of(raster, (int)(owner >> 8));
            slot map;
            float point[3];
            fill_slot(tet.map, origin, brick.base, map);
            source_point(map, (float)local[0], (float)local[1], (float)local[2], point);
            value = value_in(fetch<Voxel, false>(raster, brick.limit, first_place(raster, brick.base_index), point,
                                                 tet.box.kind == RASTER_COPY));
            if (PARTS && tet.box.kind != RASTER_COPY && raster.parts.elements[owner >> 8].box >= 0)
                draw_masked(raster, (int)(owner >> 8), at[0], at[1], at[2], &value);
        }
        static_cast<Voxel *>(
            raster.d_volume)[at[0] + (size_t)size[0] * ((size_t)at[1] + (size_t)size[1] * (size_t)at[2])] = value;
    }
}

static __device__ __forceinline__ part eighth(int n)
{
    return {{(n & 1) * (BRICK / 2), (n >> 1 & 1) * (BRICK / 2), (n >> 2) * (BRICK / 2)}, BRICK / 2};
}

/* Draw a brick in eighths. Return false if an eighth has too many candidates. */
template <class Voxel, bool PARTS>
static __device__ __forceinline__ bool draw_eighths(const gpu_raster &raster, const int *list, int count,
                                                    const int *origin, brick_state &brick)
{
    for (int n = 0; n < 8; n++) {
        const int selected = select(raster, eighth(n), list, count, origin, brick);
        if (selected > MAX_CANDIDATES) return false;
        find_owners<PARTS>(raster, eighth(n), selected, origin, brick);
    }
    for (int n = 0; n < 8; n++) {
        if (threadIdx.x == 0) brick.inner = 1;
        const int selected = select(raster, eighth(n), list, count, origin, brick);
        write_part<Voxel, BRICK / 2, PARTS>(raster, eighth(n), selected, n == 0, origin, brick);
        __syncthreads();
    }
    return true;
}

static __device__ __forceinline__ void clear_brick(brick_state &brick)
{
    if (threadIdx.x == 0) {
        brick.first = ~0u;
        brick.base_index = 0;
        brick.inner = 1;
    }
    for (int n = (int)threadIdx.x; n < BRICK_ROWS * ROW_STEP / 4; n += THREADS)
        reinterpret_cast<uint4 *>(brick.owner)[n] = make_uint4(~0u, ~0u, ~0u, ~0u);
}

/* Bricks that a kernel draws: all if there is no cut; otherwise first the bricks without elements at a cut, then the
 * others. */
enum bricks { ALL_BRICKS, WHOLE_BRICKS, BRICKS_WITH_PARTS };

/* Draw with one block per brick.
 * leave: bricks with more candidates than a byte can index keep their count, for crowded_kernel */
template <class Voxel, bricks WHICH>
static __global__ void __launch_bounds__(THREADS, BLOCKS) raster_kernel(gpu_raster raster, bool leave)
{
    enum { PARTS = WHICH == BRICKS_WITH_PARTS };
    __shared__ brick_state brick;
    const int origin[3] = {(int)blockIdx.x * BRICK, (int)blockIdx.y * BRICK, (int)blockIdx.z * BRICK};
    const int b = (int)(blockIdx.x + gridDim.x * (blockIdx.y + gridDim.y * blockIdx.z)), thread = (int)threadIdx.x;
    const int *list = raster.d_list + (size_t)b * raster.capacity;
    if (WHICH != ALL_BRICKS && (raster.d_has_parts[b] != 0) != (WHICH == BRICKS_WITH_PARTS)) return;
    const int dirty = raster.d_dirty[b], count = raster.d_count[b], id = thread < raster.capacity ? list[thread] : 0;
    const bool drawn = dirty && count <= MAX_CANDIDATES,
               left = leave && dirty && count > MAX_CANDIDATES && count <= raster.capacity;
    const part whole = {{0, 0, 0}, BRICK};
    if (drawn && count > 0) {
        clear_brick(brick);
        if (thread < count) brick.id[thread] = id;
        find_owners<PARTS>(raster, whole, count, origin, brick);
    } else {
        __syncthreads(); /* all threads have read them */
    }
    if (thread == 0) {
        raster.d_changed[b] = (uint8_t)dirty;
        raster.d_dirty[b] = 0;
        if (WHICH == BRICKS_WITH_PARTS) raster.d_has_parts[b] = 0;
        if (!left) raster.d_count[b] = 0;
        if (count > *raster.d_longest) atomicMax(raster.d_longest, count);
    }
    if (!drawn) return;
    if (count > 0) write_part<Voxel, BRICK, PARTS>(raster, whole, count, true, origin, brick);
    else clear_voxels<Voxel, BRICK>(raster, whole, origin);
}

/* Draw the bricks that still have a count after raster_kernel. */
template <class Voxel, bool PARTS> static __global__ void __launch_bounds__(THREADS) crowded_kernel(gpu_raster raster)
{
    __shared__ brick_state brick;
    const int origin[3] = {(int)blockIdx.x * BRICK, (int)blockIdx.y * BRICK, (int)blockIdx.z * BRICK};
    const int b = (int)(blockIdx.x + gridDim.x * (blockIdx.y + gridDim.y * blockIdx.z)), count = raster.d_count[b];
    if (count == 0) return;
    __syncthreads();
    if (threadIdx.x == 0) raster.d_count[b] = 0;
    clear_brick(brick);
    __syncthreads();
    const int *list = raster.d_list + (size_t)b * raster.capacity;
    if (draw_eighths<Voxel, PARTS>(raster, list, count, origin, brick)) return;
    __syncthreads();
    clear_brick(brick);
    __syncthreads();
    draw_by_voxel<Voxel, PARTS>(raster, list, count, origin, brick);
}

/* ---- owners without values */

/* One block per brick. Bricks whose lists overflowed are redone later and get no owners here. */
static __global__ void __launch_bounds__(THREADS) owners_kernel(gpu_raster raster, int32_t *d_owner)
{
    __shared__ brick_state brick;
    const int origin[3] = {(int)blockIdx.x * BRICK, (int)blockIdx.y * BRICK, (int)blockIdx.z * BRICK},
              *size = raster.grid.target.size;
    const int b = (int)(blockIdx.x + gridDim.x * (blockIdx.y + gridDim.y * blockIdx.z)), thread = (int)threadIdx.x;
    const int *list = raster.d_list + (size_t)b * raster.capacity, count = raster.d_count[b];
    const part whole = {{0, 0, 0}, BRICK};
    const bool any = count > 0 && count <= raster.capacity;
    __syncthreads(); /* all threads have read it */
    if (thread == 0) {
        raster.d_count[b] = 0;
        raster.d_dirty[b] = raster.d_has_parts[b] = 0;
        if (count > *raster.d_longest) atomicMax(raster.d_longest, count);
    }
    if (any) {
        clear_brick(brick);
        if (count <= MAX_CANDIDATES && thread < count) brick.id[thread] = list[thread];
        if (count <= MAX_CANDIDATES) find_owners<true>(raster, whole, count, origin, brick);
        else find_owners_by_voxel<true>(raster, list, count, origin, brick);
        __syncthreads();
    }
    for (int n = thread; n < BRICK_VOXELS; n += THREADS) {
        const int i = origin[0] + n % BRICK, j = origin[1] + n / BRICK % BRICK, k = origin[2] + n / BRICK_ROWS;
        if (i >= size[0] || j >= size[1] || k >= size[2]) continue;
        const unsigned owner = any ? brick.owner[ROW_STEP * (n / BRICK) + n % BRICK] : ~0u;
        d_owner[(size_t)i + (size_t)size[0] * ((size_t)j + (size_t)size[1] * (size_t)k)] =
            owner == ~0u ? -1 : (int32_t)(owner >> 8);
    }
}

pliant_status pliant_cuda_find_owners(const gpu_raster *raster, int32_t *d_owner, cudaStream_t stream)
{
    const dim3 blocks((unsigned)raster->grid.bricks[0], (unsigned)raster->grid.bricks[1],
                      (unsigned)raster->grid.bricks[2]);
    owners_kernel<<<blocks, THREADS, 0, stream>>>(*raster, d_owner);
    return CUDA_LAUNCHED("owners_kernel");
}

/* ---- source and volume */

static __device__ __forceinline__ float2 in_source(float voxel, float right)
{
    return make_float2(voxel, right - voxel);
}
static __device__ __forceinline__ unsigned in_source(uint8_t voxel, uint8_t right)
{
    return (unsigned)voxel | (unsigned)right << 16;
}
static __device__ __forceinline__ unsigned in_source(int16_t voxel, int16_t right)
{
    return (((unsigned)voxel + 0x8000) & 0xffff) | ((unsigned)right + 0x8000) << 16;
}

template <class Voxel>
static __global__ void source_kernel(const Voxel *__restrict__ d_voxels,
                                     typename sampler<Voxel>::source *__restrict__ d_source, long long count,
                                     int across)
{
    long long n = (long long)blockIdx.x * blockDim.x + threadIdx.x;
    if (n >= count) return;
    const long long right = across > 1 && n + 1 < count ? n + 1 : n;
    d_source[n] = in_source(d_voxels[n], d_voxels[right]);
}

template <class Voxel> static __global__ void clear_kernel(gpu_raster raster, long long count)
{
    for (long long n = (long long)blockIdx.x * blockDim.x + threadIdx.x; n < count;
         n += (long long)gridDim.x * blockDim.x)
        static_cast<Voxel *>(raster.d_volume)[n] = background_of(raster, Voxel());
}

template <class Voxel>
static void prepare(const gpu_raster &raster, const void *d_voxels, void *d_source, long long count,
                    cudaStream_t stream)
{
    source_kernel<Voxel><<<(unsigned)((count + 255) / 256), 256, 0, stream>>>(
        static_cast<const Voxel *>(d_voxels), static_cast<typename sampler<Voxel>::source *>(d_source), count,
        raster.source_size[0]);
}

size_t pliant_cuda_source_bytes(pliant_encoding encoding)
{
    return encoding == PLIANT_FLOAT32 ? sizeof(sampler<float>::source) : sizeof(sampler<int16_t>::source);
}

pliant_status pliant_cuda_prepare_source(const gpu_raster *raster, const void *d_voxels, void *d_source, int64_t count,
                                         cudaStream_t stream)
{
    switch (raster->encoding) {
    case PLIANT_UINT8: prepare<uint8_t>(*raster, d_voxels, d_source, count, stream); break;
    case PLIANT_INT16: prepare<int16_t>(*raster, d_voxels, d_source, count, stream); break;
    case PLIANT_FLOAT32: prepare<float>(*raster, d_voxels, d_source, count, stream); break;
    }
    return CUDA_LAUNCHED("source_kernel");
}

pliant_status pliant_cuda_clear_volume(const gpu_raster *raster, cudaStream_t stream)
{
    long long count = (long long)pliant_geometry_voxels(&raster->grid.target);
    switch (raster->encoding) {
    case PLIANT_UINT8: clear_kernel<uint8_t><<<1024, 256, 0, stream>>>(*raster, count); break;
    case PLIANT_INT16: clear_kernel<int16_t><<<1024, 256, 0, stream>>>(*raster, count); break;
    case PLIANT_FLOAT32: clear_kernel<float><<<1024, 256, 0, stream>>>(*raster, count); break;
    }
    return CUDA_LAUNCHED("clear_kernel");
}

template <class Voxel> static pliant_status draw(const gpu_raster &raster, bool crowded, cudaStream_t stream)
{
    const dim3 blocks((unsigned)raster.grid.bricks[0], (unsigned)raster.grid.bricks[1],
                      (unsigned)raster.grid.bricks[2]);
    const bool parts = raster.parts.elements != NULL;
    if (parts) {
        raster_kernel<Voxel, WHOLE_BRICKS><<<blocks, THREADS, 0, stream>>>(raster, crowded);
        CUDA_TRY(CUDA_LAUNCHED("raster_kernel"));
        raster_kernel<Voxel, BRICKS_WITH_PARTS><<<blocks, THREADS, 0, stream>>>(raster, crowded);
    } else {
        raster_kernel<Voxel, ALL_BRICKS><<<blocks, THREADS, 0, stream>>>(raster, crowded);
    }
    CUDA_TRY(CUDA_LAUNCHED("raster_kernel"));
    if (!crowded) return PLIANT_OK;
    if (parts) crowded_kernel<Voxel, true><<<blocks, THREADS, 0, stream>>>(raster);
    else crowded_kernel<Voxel, false><<<blocks, THREADS, 0, stream>>>(raster);
    return CUDA_LAUNCHED("crowded_kernel");
}

int32_t pliant_cuda_longest_usual(void) { return MAX_CANDIDATES; }

pliant_status pliant_cuda_rasterize(const gpu_raster *raster, bool crowded, cudaStream_t stream)
{
    switch (raster->encoding) {
    case PLIANT_UINT8:
        return raster->background.nearest ? draw<nearest_label>(*raster, crowded, stream)
                                          : draw<uint8_t>(*raster, crowded, stream);
    case PLIANT_INT16: return draw<int16_t>(*raster, crowded, stream);
    default: return draw<float>(*raster, crowded, stream);
    }
}
