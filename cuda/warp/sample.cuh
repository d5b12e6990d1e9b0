/* Compute the value of a voxel from its owner's map, with the same operations in the same order as
 * src/warp/sample_portable.c. (This file is compiled without fused multiply-adds. The explicit one rounds an exact
 * product and sum once, as the CPU does.) */
#ifndef PLIANT_CUDA_SAMPLE_CUH
#define PLIANT_CUDA_SAMPLE_CUH

#include "cuda/warp/raster_math.cuh"
#include "cuda/warp/rasterize.h"

/* Same as raster_slot; the steps along i are i_x, i_y, i_z. */
struct alignas(16) slot { float origin[3], i_x, step_j[3], i_y, step_k[3], i_z; };

struct limits { float low[3], high[3], last[3]; }; /* relative to the brick's base voxel */

/* Adding this constant to a number below 2^22 and rounding down leaves the floor in the low bits. */
static const float floor_shift = 12582912.0f;
#define FLOOR_BITS 0x4b400000u

static __device__ __forceinline__ float between(float a, float b, float t) { return a + t * (b - a); }

static __device__ __forceinline__ void source_point(const slot &map, float i, float j, float k, float *at)
{
    at[0] = map.origin[0] + j * map.step_j[0] + k * map.step_k[0] + i * map.i_x;
    at[1] = map.origin[1] + j * map.step_j[1] + k * map.step_k[1] + i * map.i_y;
    at[2] = map.origin[2] + j * map.step_j[2] + k * map.step_k[2] + i * map.i_z;
}

template <bool INNER>
static __device__ __forceinline__ float split(float at, const limits &limit, int d, unsigned *bits)
{
    if (!INNER) at = fminf(fmaxf(at, limit.low[d]), limit.high[d]);
    float shifted = __fadd_rd(at, floor_shift);
    if (!INNER) shifted = fminf(shifted, limit.last[d] + floor_shift);
    *bits = (unsigned)__float_as_int(shifted);
    return at - (shifted - floor_shift);
}

/* Element of d_source, and interpolation between a voxel and its right neighbour. 8 and 16 bit voxels are stored in
 * pairs. With their 16 bits under the exponent of 2^23 they are floats; offset removes that and the bias. */
template <class Voxel> struct sampler {
    typedef unsigned source;
    static __device__ __forceinline__ float along(unsigned pair, float weight)
    {
        const float offset = sizeof(Voxel) == 2 ? 8421376.0f : 8388608.0f;
        const float left = __int_as_float((int)__byte_perm(pair, 0x4b000000u, 0x7410));
        const float right = __int_as_float((int)__byte_perm(pair, 0x4b000000u, 0x7432));
        return fmaf(right - left, weight, left - offset);
    }
    /* rounded to 14 bits, as on the CPU */
    static __device__ __forceinline__ float weight(float x) { return (x + 768.0f) - 768.0f; }
    /* the low bits contain the nearest integer */
    static __device__ __forceinline__ Voxel voxel(float value) { return (Voxel)__float_as_int(value + floor_shift); }
    static __device__ __forceinline__ Voxel copied(unsigned) { return 0; }
    static const bool copies = false; /* a sample at a voxel equals the voxel */
};

/* Stored as the voxel and the difference to its right neighbour. */
template <> struct sampler<float> {
    typedef float2 source;
    static __device__ __forceinline__ float along(float2 voxel, float weight) { return voxel.x + weight * voxel.y; }
    static __device__ __forceinline__ float weight(float x) { return x; }
    static __device__ __forceinline__ float voxel(float value) { return value; }
    static __device__ __forceinline__ float copied(float2 voxel) { return voxel.x; }
    static const bool copies = true; /* copying preserves -0.0f and NaN */
};

/* Return the index of the base voxel, corrected for the bits that split() leaves in its integers. */
static __device__ __forceinline__ unsigned first_place(const gpu_raster &raster, unsigned base_index)
{
    return base_index - FLOOR_BITS * (1 + (unsigned)raster.source_step[1] + (unsigned)raster.source_step[2]);
}

/* Plain loads from a copy of the scan. The filter of texture units has only 9 bit weights, and unfiltered texture
 * fetches are slower. Drawing 5 M voxels on an H100 with the same result takes 0.024 ms with these loads. It takes
 * 0.027 ms with two gathers from layered textures, and 0.051 ms with eight 3D texture fetches. */

/* Cell of the scan that contains a point: the values at its corners and the position inside. */
template <class Voxel> struct cell {
    /* left corners: (y, z), (y + 1, z), (y, z + 1), (y + 1, z + 1) */
    typename sampler<Voxel>::source c00, c10, c01, c11;
    float x, y, z;
    bool copied; /* whether c00 is the value */
};

/* base: first_place of the brick's base voxel
 * copy: the map takes voxels to voxels */
template <class Voxel, bool INNER>
static __device__ __forceinline__ cell<Voxel> fetch(const gpu_raster &raster, const limits &limit, unsigned base,
                                                    const float *at, bool copy)
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
    /* exactly a voxel's centre; in the last cell it may be the right corner */
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

/* An 8 bit label, taken from the nearest voxel. */
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
    const unsigned low = from.y >= 0.5f ? from.c10 : from.c00, high = from.y >= 0.5f ? from.c11 : from.c01,
                   pair = from.z >= 0.5f ? high : low;
    return nearest_label((uint8_t)(from.x >= 0.5f ? pair >> 16 : pair));
}

static __device__ __forceinline__ nearest_label background_of(const gpu_raster &raster, nearest_label)
{
    return nearest_label(raster.background.background.u8);
}
static __device__ __forceinline__ uint8_t background_of(const gpu_raster &raster, uint8_t)
{
    return raster.background.background.u8;
}
static __device__ __forceinline__ int16_t background_of(const gpu_raster &raster, int16_t)
{
    return raster.background.background.i16;
}
static __device__ __forceinline__ float background_of(const gpu_raster &raster, float)
{
    return raster.background.background.f32;
}

#endif
