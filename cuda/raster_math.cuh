/* What rasterizing needs of each tetrahedron, by the same operations in the same order as src/warp/fixed_point.c and
 * owners.h: the same bits come out, so the GPU's volume equals the CPU's. (This is compiled without fused multiply-adds.) */
#ifndef PLIANT_CUDA_RASTER_MATH_CUH
#define PLIANT_CUDA_RASTER_MATH_CUH

#include "warp/raster.h"

#include <math.h>

#define RASTER_BOTH __host__ __device__ __forceinline__

/* raster_tet of the CPU, in whole 16 bytes for the GPU's loads */
struct alignas(16) gpu_tet {
    double normal[3][4]; /* of plane 0 to 3, inward, per voxel along i, j, k; integers */
    long long value[4];  /* of the planes at target voxel (0, 0, 0) */
    double map[4][3];    /* source index = map[0] i + map[1] j + map[2] k + map[3] */
    unsigned long long bricks;
    short low[3], high[3];
    unsigned char kind, inner;
};

RASTER_BOTH int raster_round(double value)
{
#ifdef __CUDA_ARCH__
    return __double2int_rn(value);
#else
    return (int)lrint(value);
#endif
}

/* pliant_raster_fix */
RASTER_BOTH void gpu_fix(const raster_grid &grid, const double *position, int *fixed)
{
    double offset[3];
    for (int d = 0; d < 3; d++) offset[d] = position[d] - grid.target.origin[d];
    for (int d = 0; d < 3; d++) {
        const double *axis = grid.target.direction + d;
        double index = (axis[0] * offset[0] + axis[3] * offset[1] + axis[6] * offset[2]) / grid.target.spacing[d];
        double inside = index > grid.low[d] ? index : grid.low[d];
        inside = inside < grid.high[d] ? inside : grid.high[d];
        fixed[d] = raster_round(inside * grid.scale);
    }
}

RASTER_BOTH void gpu_cross(const int *a, const int *b, long long *out)
{
    out[0] = (long long)a[1] * b[2] - (long long)a[2] * b[1];
    out[1] = (long long)a[2] * b[0] - (long long)a[0] * b[2];
    out[2] = (long long)a[0] * b[1] - (long long)a[1] * b[0];
}

/* six_volumes */
RASTER_BOTH double gpu_six_volumes(const int *edge, const long long *normal)
{
    long long high = 0, low = 0;
    for (int d = 0; d < 3; d++) {
        high += (edge[d] >> 11) * normal[d];
        low += (edge[d] & 2047) * normal[d];
    }
    return (double)(high + (low >> 11)) * 2048 + (double)(low & 2047);
}

/* plane_value */
RASTER_BOTH long long gpu_plane_value(const raster_grid &grid, const long long *normal, const int *point)
{
    long long whole = 0, fraction = 0;
    for (int d = 0; d < 3; d++) {
        whole += normal[d] * (point[d] >> grid.fraction_bits);
        fraction += normal[d] * (point[d] & ((1 << grid.fraction_bits) - 1));
    }
    return -whole + (-fraction >> grid.fraction_bits);
}

/* round_map */
RASTER_BOTH bool gpu_round_map(const raster_grid &grid, const int *source_size, const int fixed[4][3], const double rest[4][3],
                               double map[4][3])
{
    double rounded[4][3];
    bool whole = true;
    for (int d = 0; d < 3; d++) {
        double sum = 0;
        for (int c = 0; c < 4; c++) {
            rounded[c][d] = rint(map[c][d]);
            if (c < 3) sum += fabs(rounded[c][d]);
        }
        double tolerance = 1e-4 + 0.5 * sum / grid.scale;
        for (int v = 0; v < 4; v++) {
            double at = rounded[3][d];
            for (int c = 0; c < 3; c++) at += rounded[c][d] * (fixed[v][c] / grid.scale);
            bool inside = rest[v][d] > -0.75 && rest[v][d] < source_size[d] - 0.25;
            whole = whole && inside && fabs(at - rest[v][d]) <= tolerance;
        }
    }
    for (int c = 0; c < 4 && whole; c++)
        for (int d = 0; d < 3; d++) map[c][d] = rounded[c][d];
    return whole;
}

/* stays_inside */
RASTER_BOTH bool gpu_stays_inside(const int *source_size, const double rest[4][3], const double map[4][3])
{
    bool inside = true;
    for (int d = 0; d < 3; d++) {
        inside = inside && source_size[d] <= 1 << 16 && fabs(map[0][d]) + fabs(map[1][d]) + fabs(map[2][d]) <= 64;
        for (int v = 0; v < 4; v++) inside = inside && rest[v][d] >= 0.5 && rest[v][d] <= source_size[d] - 2.5;
    }
    return inside;
}

/* pliant_raster_cuts */
RASTER_BOTH bool gpu_cuts(const gpu_tet &tet, const int *brick)
{
    bool cuts = true;
    for (int v = 0; v < 4; v++) {
        long long most = tet.value[v];
        for (int d = 0; d < 3; d++) {
            long long n = (long long)tet.normal[d][v];
            most += n * (brick[d] * BRICK) + (n > 0 ? n * (BRICK - 1) : 0);
        }
        cuts = cuts && most >= 0;
    }
    return cuts;
}

RASTER_BOTH bool gpu_in_mask(const gpu_tet &tet)
{
    for (int d = 0; d < 3; d++)
        if (tet.high[d] / BRICK - tet.low[d] / BRICK >= MASK_EDGE) return false;
    return true;
}

RASTER_BOTH void gpu_find_bricks(gpu_tet &tet)
{
    tet.bricks = 0;
    if (!gpu_in_mask(tet)) return;
    int low[3], high[3], b[3];
    for (int d = 0; d < 3; d++) {
        low[d] = tet.low[d] / BRICK;
        high[d] = tet.high[d] / BRICK;
    }
    for (b[2] = low[2]; b[2] <= high[2]; b[2]++)
        for (b[1] = low[1]; b[1] <= high[1]; b[1]++)
            for (b[0] = low[0]; b[0] <= high[0]; b[0]++) {
                int bit = b[0] - low[0] + MASK_EDGE * (b[1] - low[1] + MASK_EDGE * (b[2] - low[2]));
                if (gpu_cuts(tet, b)) tet.bricks |= 1ull << bit;
            }
}

/* pliant_raster_tet */
RASTER_BOTH void gpu_make_tet(const raster_grid &grid, const int *source_size, const int fixed[4][3], const double rest[4][3],
                              gpu_tet &out)
{
    out.kind = RASTER_NOTHING;
    int edge[4][3];
    for (int v = 1; v < 4; v++)
        for (int d = 0; d < 3; d++) edge[v][d] = fixed[v][d] - fixed[0][d];
    long long normal[4][3];
    gpu_cross(edge[2], edge[3], normal[1]);
    gpu_cross(edge[3], edge[1], normal[2]);
    gpu_cross(edge[1], edge[2], normal[3]);
    double volume = gpu_six_volumes(edge[1], normal[1]);
    if (grid.mirrored ? volume >= 0 : volume <= 0) return;
    for (int d = 0; d < 3; d++) {
        int low = fixed[0][d], high = low;
        for (int v = 1; v < 4; v++) {
            low = fixed[v][d] < low ? fixed[v][d] : low;
            high = fixed[v][d] > high ? fixed[v][d] : high;
        }
        low = -(-low >> grid.fraction_bits);
        high = high >> grid.fraction_bits;
        low = low > 0 ? low : 0;
        high = high < grid.target.size[d] - 1 ? high : grid.target.size[d] - 1;
        if (low > high) return;
        out.low[d] = (short)low;
        out.high[d] = (short)high;
    }
    double unit = grid.scale / volume, step = 1 / grid.scale;
    for (int d = 0; d < 3; d++) {
        out.map[3][d] = rest[0][d];
        for (int c = 0; c < 3; c++) {
            double sum = 0;
            for (int v = 1; v < 4; v++) sum += (rest[v][d] - rest[0][d]) * (double)normal[v][c];
            out.map[c][d] = sum * unit;
            out.map[3][d] -= out.map[c][d] * (fixed[0][c] * step);
        }
    }
    out.kind = gpu_round_map(grid, source_size, fixed, rest, out.map) ? RASTER_COPY : RASTER_SAMPLE;
    out.inner = gpu_stays_inside(source_size, rest, out.map);
    for (int d = 0; d < 3; d++) normal[0][d] = -(normal[1][d] + normal[2][d] + normal[3][d]);
    for (int v = 0; v < 4; v++) {
        if (grid.mirrored)
            for (int d = 0; d < 3; d++) normal[v][d] = -normal[v][d];
        for (int d = 0; d < 3; d++) out.normal[d][v] = (double)normal[v][d];
        out.value[v] = gpu_plane_value(grid, normal[v], fixed[v == 0]);
    }
    gpu_find_bricks(out);
}

/* One plane of a tetrahedron, relative to a brick: owner_plane. side: it leaves nothing, part, or all of the brick. */
struct gpu_plane {
    double value, step_j, step_k, factor;
};
enum { PLANE_EMPTY, PLANE_RISING, PLANE_OTHER, PLANE_WHOLE };

RASTER_BOTH int gpu_find_plane(const gpu_tet &tet, int v, const int *origin, gpu_plane &out)
{
    long long exact = tet.value[v];
    double normal[3], most, least;
    for (int d = 0; d < 3; d++) {
        normal[d] = tet.normal[d][v];
        exact += (long long)normal[d] * origin[d];
    }
    most = least = (double)exact;
    for (int d = 0; d < 3; d++) {
        double n = normal[d] * (BRICK - 1);
        most += n > 0 ? n : 0;
        least += n < 0 ? n : 0;
    }
    out.value = (double)exact + 0.5;
    out.step_j = normal[1];
    out.step_k = normal[2];
    out.factor = normal[0] != 0 ? 1 / fabs(normal[0]) : 4 * BRICK;
    return most < 0 ? PLANE_EMPTY : least >= 0 ? PLANE_WHOLE : normal[0] > 0 ? PLANE_RISING : PLANE_OTHER;
}

/* owner_choose_base, along one axis */
RASTER_BOTH int gpu_base(const gpu_tet &tet, const int *origin, int d, int source_size)
{
    double at = tet.map[3][d];
    for (int c = 0; c < 3; c++) at += tet.map[c][d] * (origin[c] + BRICK / 2);
    int end = source_size - 1;
    return at >= end ? end : at > 0 ? (int)at : 0;
}

/* owner_fill_sample, along one axis */
RASTER_BOTH float gpu_slot_origin(const gpu_tet &tet, const int *origin, int d, int base)
{
    return (float)(tet.map[0][d] * origin[0] + tet.map[1][d] * origin[1] + tet.map[2][d] * origin[2] + (tet.map[3][d] - base));
}

#endif
