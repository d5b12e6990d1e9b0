/* What rasterizing needs of each tetrahedron, by the same operations in the same order as src/warp/fixed_point.c and
 * owners.h: the same bits come out, so the GPU's volume equals the CPU's. (This is compiled without fused multiply-adds.)
 *
 * Four threads set up a tetrahedron: thread v has node v and plane v, threads 0 to 2 also axis v of the map. */
#ifndef PLIANT_CUDA_RASTER_MATH_CUH
#define PLIANT_CUDA_RASTER_MATH_CUH

#include "warp/raster.h"

/* raster_tet of the CPU, by thread of the four */
struct alignas(16) gpu_tet {
    struct plane {
        double normal[3];    /* inward, per voxel along i, j, k; integers */
        double near;         /* value at the first voxel of the brick where the tetrahedron's box begins; exact where it is in
                              * the mask of bricks */
    } planes[4];
    double factor[4];        /* 1 / |normal along i|; where that is 0, enough to leave the row on either side */
    long long value[4];      /* of the planes at target voxel (0, 0, 0) */
    double map[3][4];        /* source index along an axis = map[0] i + map[1] j + map[2] k + map[3] */
    unsigned long long bricks;
    short low[3], high[3];
    unsigned char kind, inner;
};

/* ---- the four threads of a tetrahedron */

static __device__ __forceinline__ int of_thread(int value, int v) { return __shfl_sync(0xffffffff, value, v, 4); }
static __device__ __forceinline__ double of_thread(double value, int v) { return __shfl_sync(0xffffffff, value, v, 4); }
static __device__ __forceinline__ long long of_thread(long long value, int v) { return __shfl_sync(0xffffffff, value, v, 4); }

static __device__ __forceinline__ bool all_of_four(bool value)
{
    unsigned lanes = 15u << (threadIdx.x & 28);
    return (__ballot_sync(0xffffffff, value) & lanes) == lanes;
}

static __device__ __forceinline__ unsigned long long and_of_four(unsigned long long value)
{
    value &= __shfl_xor_sync(0xffffffff, value, 1);
    return value & __shfl_xor_sync(0xffffffff, value, 2);
}

/* ---- pliant_raster_fix, its own node */

/* a / b, from 1 / b rounded to nearest: the second correction makes the quotient that of a division (Markstein, IBM Journal of
 * Research and Development 34, 1990), but for numbers so large that no volume has them */
static __device__ __forceinline__ double gpu_divide(double a, double b, double reciprocal)
{
    double q = a * reciprocal;
    if (!(fabs(q) < 1e200)) return a / b;
    q = fma(fma(-q, b, a), reciprocal, q);
    return fma(fma(-q, b, a), reciprocal, q);
}

static __device__ __forceinline__ void gpu_fix(const raster_grid &grid, const double *reciprocal, const double *position, int *fixed)
{
    double offset[3];
    for (int d = 0; d < 3; d++) offset[d] = position[d] - grid.target.origin[d];
    for (int d = 0; d < 3; d++) {
        const double *axis = grid.target.direction + d;
        double index = gpu_divide(axis[0] * offset[0] + axis[3] * offset[1] + axis[6] * offset[2], grid.target.spacing[d], reciprocal[d]);
        double inside = index > grid.low[d] ? index : grid.low[d];
        inside = inside < grid.high[d] ? inside : grid.high[d];
        fixed[d] = __double2int_rn(inside * grid.scale);
    }
}

/* ---- pliant_raster_tet */

/* six_volumes */
static __device__ __forceinline__ double gpu_six_volumes(const int *edge, const long long *normal)
{
    long long high = 0, low = 0;
    for (int d = 0; d < 3; d++) {
        high += (edge[d] >> 11) * normal[d];
        low += (edge[d] & 2047) * normal[d];
    }
    return (double)(high + (low >> 11)) * 2048 + (double)(low & 2047);
}

/* plane_value */
static __device__ __forceinline__ long long gpu_plane_value(const raster_grid &grid, const long long *normal, const int *point)
{
    long long whole = 0, fraction = 0;
    for (int d = 0; d < 3; d++) {
        whole += normal[d] * (point[d] >> grid.fraction_bits);
        fraction += normal[d] * (point[d] & ((1 << grid.fraction_bits) - 1));
    }
    return -whole + (-fraction >> grid.fraction_bits);
}

/* Inward normals, before the mirrored target's turn, and the volume. Plane v is that of the other three nodes; its normal is
 * the cross product of edges from node 0, plane 0's what is missing to zero. */
static __device__ __forceinline__ double gpu_normals(const int fixed[4][3], int v, long long *own)
{
    int edge[4][3];
    for (int n = 1; n < 4; n++)
        for (int d = 0; d < 3; d++) edge[n][d] = fixed[n][d] - fixed[0][d];
    int p[3], q[3];
    for (int d = 0; d < 3; d++) {
        p[d] = v == 1 ? edge[2][d] : v == 2 ? edge[3][d] : edge[1][d];
        q[d] = v == 1 ? edge[3][d] : v == 2 ? edge[1][d] : edge[2][d];
    }
    for (int d = 0; d < 3; d++) own[d] = (long long)p[(d + 1) % 3] * q[(d + 2) % 3] - (long long)p[(d + 2) % 3] * q[(d + 1) % 3];
    double volume = of_thread(gpu_six_volumes(edge[1], own), 1);
    for (int d = 0; d < 3; d++) {
        long long sum = of_thread(own[d], 1) + of_thread(own[d], 2) + of_thread(own[d], 3);
        if (v == 0) own[d] = -sum;
    }
    return volume;
}

/* voxels of one step of the fixed-point grid; scale is a power of two: multiplying by this divides by that, exactly */
static __device__ __forceinline__ double raster_step(const raster_grid &grid) { return ldexp(1.0, -grid.fraction_bits); }

/* One axis of the map from target to source, before rounding; every thread runs it, threads 0 to 2 have an axis.
 * Barycentric coordinate of node n: normal[n] . (scale * voxel - node 0) / volume. */
static __device__ __forceinline__ void gpu_map(const raster_grid &grid, const int fixed[4][3], const double *rest, const double *normal,
                                               double volume, double *map)
{
    const double unit = grid.scale / volume, step = raster_step(grid);
    map[3] = rest[0];
    for (int c = 0; c < 3; c++) {
        double sum = 0;
        for (int n = 1; n < 4; n++) sum += (rest[n] - rest[0]) * of_thread(normal[c], n);
        map[c] = sum * unit;
        map[3] -= map[c] * (fixed[0][c] * step);
    }
}

/* round_map along one axis: whether it stays within the tolerance when rounded */
static __device__ __forceinline__ bool gpu_is_whole(const raster_grid &grid, int source_size, const int fixed[4][3], const double *rest,
                                                    const double *map, double *rounded)
{
    double sum = 0;
    for (int c = 0; c < 4; c++) {
        rounded[c] = rint(map[c]);
        if (c < 3) sum += fabs(rounded[c]);
    }
    const double step = raster_step(grid), tolerance = 1e-4 + 0.5 * sum * step;
    bool whole = true;
    for (int n = 0; n < 4; n++) {
        double at = rounded[3];
        for (int c = 0; c < 3; c++) at += rounded[c] * (fixed[n][c] * step);
        whole = whole && rest[n] > -0.75 && rest[n] < source_size - 0.25 && fabs(at - rest[n]) <= tolerance;
    }
    return whole;
}

/* stays_inside along one axis */
static __device__ __forceinline__ bool gpu_stays_inside(int source_size, const double *rest, const double *map)
{
    bool inside = source_size <= 1 << 16 && fabs(map[0]) + fabs(map[1]) + fabs(map[2]) <= 64;
    for (int n = 0; n < 4; n++) inside = inside && rest[n] >= 0.5 && rest[n] <= source_size - 2.5;
    return inside;
}

/* ---- bricks */

/* pliant_raster_cuts */
static __device__ bool gpu_cuts(const gpu_tet &tet, const int *brick)
{
    bool cuts = true;
    for (int v = 0; v < 4; v++) {
        long long most = tet.value[v];
        for (int d = 0; d < 3; d++) {
            long long n = (long long)tet.planes[v].normal[d];
            most += n * (brick[d] * BRICK) + (n > 0 ? n * (BRICK - 1) : 0);
        }
        cuts = cuts && most >= 0;
    }
    return cuts;
}

static __device__ __forceinline__ bool gpu_in_mask(const short *low, const short *high)
{
    bool in = true;
    for (int d = 0; d < 3; d++) in = in && high[d] / BRICK - low[d] / BRICK < MASK_EDGE;
    return in;
}

/* find_bricks by one plane; values at the corners of bricks in the mask are exact in double */
static __device__ __forceinline__ unsigned long long gpu_find_bricks(const short *low, const short *high, const gpu_tet::plane &plane)
{
    unsigned long long bricks = 0;
    if (!gpu_in_mask(low, high)) return bricks;
    int count[3];
    double corner = plane.near;
    for (int d = 0; d < 3; d++) {
        count[d] = high[d] / BRICK - low[d] / BRICK + 1;
        corner += plane.normal[d] > 0 ? plane.normal[d] * (BRICK - 1) : 0;
    }
    for (int k = 0; k < count[2]; k++, corner += BRICK * plane.normal[2]) {
        double row = corner;
        for (int j = 0; j < count[1]; j++, row += BRICK * plane.normal[1]) {
            double at = row;
            for (int i = 0; i < count[0]; i++, at += BRICK * plane.normal[0])
                if (at >= 0) bricks |= 1ull << (i + MASK_EDGE * (j + MASK_EDGE * k));
        }
    }
    return bricks;
}

/* ---- in a brick */

/* A plane of a tetrahedron relative to a brick: owner_plane. */
struct gpu_plane { double value, step_j, step_k, factor; };
enum { PLANE_EMPTY, PLANE_RISING, PLANE_OTHER, PLANE_WHOLE };

/* Whether it leaves nothing, part or all of a box of voxels in the brick (low to high, from the brick's origin) is found in
 * float; in doubt, part. */
static __device__ __forceinline__ int gpu_find_plane(const gpu_tet &tet, int v, const int *origin, const int *low, const int *high,
                                                     gpu_plane &out)
{
    const gpu_tet::plane plane = tet.planes[v];
    double value = plane.near;
    if (gpu_in_mask(tet.low, tet.high)) {
        for (int d = 0; d < 3; d++) value += plane.normal[d] * (origin[d] - tet.low[d] / BRICK * BRICK);
    } else {
        long long exact = tet.value[v];
        for (int d = 0; d < 3; d++) exact += (long long)plane.normal[d] * origin[d];
        value = (double)exact; /* rounded only where it is far from 0 and its sign is all that counts */
    }
    out = {value + 0.5, plane.normal[1], plane.normal[2], tet.factor[v]};
    float most = (float)value, least = most, size = fabsf(most);
    for (int d = 0; d < 3; d++) {
        const float n = (float)plane.normal[d], first = n * (float)low[d], last = n * (float)high[d];
        most += fmaxf(first, last);
        least += fminf(first, last);
        size += fabsf(n) * BRICK;
    }
    const float doubt = 1e-6f * size;
    return most < -doubt ? PLANE_EMPTY : least > doubt ? PLANE_WHOLE : plane.normal[0] > 0 ? PLANE_RISING : PLANE_OTHER;
}

/* owner_choose_base, along one axis */
static __device__ __forceinline__ int gpu_base(const gpu_tet &tet, const int *origin, int d, int source_size)
{
    double at = tet.map[d][3];
    for (int c = 0; c < 3; c++) at += tet.map[d][c] * (origin[c] + BRICK / 2);
    int end = source_size - 1;
    return at >= end ? end : at > 0 ? (int)at : 0;
}

/* owner_fill_sample, along one axis */
static __device__ __forceinline__ float gpu_slot_origin(const double *map, const int *origin, int base)
{
    return (float)(map[0] * origin[0] + map[1] * origin[1] + map[2] * origin[2] + (map[3] - base));
}

#endif
