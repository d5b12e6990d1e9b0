/* The value of a voxel, from the map of its owner: the operations of src/warp/sample_portable.c in their order. (This is
 * compiled without fused multiply-adds; the one that is written down rounds an exact product and sum once, as there.) */
#ifndef PLIANT_CUDA_SAMPLE_CUH
#define PLIANT_CUDA_SAMPLE_CUH

#include "cuda/warp/raster_math.cuh"
#include "cuda/warp/rasterize.h"

/* raster_slot; steps along i: i_x, i_y, i_z */
struct alignas(16) slot { float origin[3], i_x, step_j[3], i_y, step_k[3], i_z; };

struct limits { float low[3], high[3], last[3]; }; /* relative to the brick's base voxel */

/* added to numbers below 2^22 in size, rounded down, it leaves their floor in the low bits */
static const float floor_shift = 12582912.0f;
#define FLOOR_BITS 0x4b400000u

static __device__ __forceinline__ float between(float a, float b, float t) { return a + t * (b - a); }

static __device__ __forceinline__ void source_point(const slot &map, float i, float j, float k, float *at)
{
    at[0] = map.origin[0] + j * map.step_j[0] + k * map.step_k[0] + i * map.i_x;
    at[1] = map.origin[1] + j * map.step_j[1] + k * map.step_k[1] + i * map.i_y;
    at[2] = map.origin[2] + j * map.step_j[2] + k * map.step_k[2] + i * map.i_z;
}

template <bool INNER> static __device__ __forceinline__ float split(float at, const limits &limit, int d, unsigned *bits)
{
    if (!INNER) at = fminf(fmaxf(at, limit.low[d]), limit.high[d]);
    float shifted = __fadd_rd(at, floor_shift);
    if (!INNER) shifted = fminf(shifted, limit.last[d] + floor_shift);
    *bits = (unsigned)__float_as_int(shifted);
    return at - (shifted - floor_shift);
}

/* What lies at a place of d_source, and its value between the voxel there and its right neighbour. 8 and 16 bit voxels are there
 * in pairs; with their 16 bits under the exponent of 2^23 they are floats, and offset takes that and the bias off again. */
template <class Voxel> struct sampler {
    typedef unsigned source;
    static __device__ __forceinline__ float along(unsigned pair, float weight)
    {
        const float offset = sizeof(Voxel) == 2 ? 8421376.0f : 8388608.0f;
        const float left = __int_as_float((int)__byte_perm(pair, 0x4b000000u, 0x7410));
        const float right = __int_as_float((int)__byte_perm(pair, 0x4b000000u, 0x7432));
        return fmaf(right - left, weight, left - offset);
    }
    static __device__ __forceinline__ float weight(float x) { return (x + 768.0f) - 768.0f; } /* to 14 bits, as on the CPU */
    /* its low bits are the nearest whole number */
    static __device__ __forceinline__ Voxel voxel(float value) { return (Voxel)__float_as_int(value + floor_shift); }
    static __device__ __forceinline__ Voxel copied(unsigned) { return 0; }
    static const bool copies = false; /* a sample at a voxel is the voxel */
};

/* each voxel and what its right neighbour has more */
template <> struct sampler<float> {
    typedef float2 source;
    static __device__ __forceinline__ float along(float2 voxel, float weight) { return voxel.x + weight * voxel.y; }
    static __device__ __forceinline__ float weight(float x) { return x; }
    static __device__ __forceinline__ float voxel(float value) { return value; }
    static __device__ __forceinline__ float copied(float2 voxel) { return voxel.x; }
    static const bool copies = true; /* -0.0f and what is not a number stay what they are */
};

/* of a cell whose corner is the base voxel: what lies there, less the bits that split() leaves in its whole numbers */
static __device__ __forceinline__ unsigned first_place(const gpu_raster &raster, unsigned base_index)
{
    return base_index - FLOOR_BITS * (1 + (unsigned)raster.source_step[1] + (unsigned)raster.source_step[2]);
}

/* Plain loads, from a copy of the scan: the filter of texture units has weights of 9 bits, and unfiltered fetches from a texture take
 * longer. 5 M voxels on an H100, with the same maps and the same bits: these loads 0.024 ms, two gathers from layers 0.027, eight
 * fetches from three dimensions 0.051. */

/* The cell that a place of the scan lies in: what is at its corners, and where in it. */
template <class Voxel> struct cell {
    typename sampler<Voxel>::source c00, c10, c01, c11; /* its left corners: (y, z), (y + 1, z), (y, z + 1), (y + 1, z + 1) */
    float x, y, z;
    bool copied; /* c00 is the value */
};

/* base: first_place of the brick's base voxel. copy: the map takes voxels to voxels. */
template <class Voxel, bool INNER>
static __device__ __forceinline__ cell<Voxel> fetch(const gpu_raster &raster, const limits &limit, unsigned base, const float *at, bool copy)
{
    typedef sampler<Voxel> how;
    const unsigned step_j = (unsigned)raster.source_step[1], step_k = (unsigned)raster.source_step[2];
    unsigned i, j, k;
    cell<Voxel> out;
    out.x = split<INNER>(at[0], limit, 0, &i);
    out.y = split<INNER>(at[1], limit, 1, &j);
    out.z = split<INNER>(at[2], limit, 2, &k);
    out.copied = how::copies && copy;
    unsigned place = base + i + j * step_j + k * step_k;
    /* a voxel's centre exactly: beyond the last cell's left corner it is the right one */
    if (out.copied) place += (out.x != 0 ? 1 : 0) + (out.y != 0 ? step_j : 0) + (out.z != 0 ? step_k : 0);
    const typename how::source *source = static_cast<const typename how::source *>(raster.d_source);
    out.c00 = __ldg(source + place);
    if (out.copied) return out;
    out.c10 = __ldg(source + (place + step_j));
    out.c01 = __ldg(source + (place + step_k));
    out.c11 = __ldg(source + (place + step_j + step_k));
    return out;
}

template <class Voxel> static __device__ __forceinline__ Voxel value_in(const cell<Voxel> &from)
{
    typedef sampler<Voxel> how;
    if (from.copied) return how::copied(from.c00);
    const float w = how::weight(from.x);
    const float low = between(how::along(from.c00, w), how::along(from.c10, w), from.y);
    const float high = between(how::along(from.c01, w), how::along(from.c11, w), from.y);
    return how::voxel(between(low, high, from.z));
}

/* A label of 8 bits: the nearest voxel's. */
struct nearest_label {
    uint8_t value;
    __device__ __forceinline__ nearest_label() : value(0) {}
    __device__ __forceinline__ nearest_label(uint8_t of) : value(of) {}
};
template <> struct sampler<nearest_label> {
    typedef unsigned source;
    static const bool copies = false;
};
template <> __device__ __forceinline__ nearest_label value_in<nearest_label>(const cell<nearest_label> &from)
{
    const unsigned low = from.y >= 0.5f ? from.c10 : from.c00, high = from.y >= 0.5f ? from.c11 : from.c01, pair = from.z >= 0.5f ? high : low;
    return nearest_label((uint8_t)(from.x >= 0.5f ? pair >> 16 : pair));
}

static __device__ __forceinline__ nearest_label background_of(const gpu_raster &raster, nearest_label) { return nearest_label(raster.background.background.u8); }
static __device__ __forceinline__ uint8_t background_of(const gpu_raster &raster, uint8_t) { return raster.background.background.u8; }
static __device__ __forceinline__ int16_t background_of(const gpu_raster &raster, int16_t) { return raster.background.background.i16; }
static __device__ __forceinline__ float background_of(const gpu_raster &raster, float) { return raster.background.background.f32; }

#endif
