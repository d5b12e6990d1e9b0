/* Set up tetrahedra for rasterization with the same operations in the same order as src/warp/prepare_tets.c and
 * voxel_owners.h. The results are bitwise identical, so the GPU's volume equals the CPU's. (This file is compiled
 * without fused multiply-adds.)
 *
 * Four threads set up one tetrahedron: thread v handles node v and plane v, and threads 0 to 2 also handle axis v of
 * the map. */
#ifndef PLIANT_CUDA_RASTER_MATH_CUH
#define PLIANT_CUDA_RASTER_MATH_CUH

#include "cuda/warp/rasterize.h"

/* Bounding box: first and last voxel along each axis inside the target, and the number of bounds that are lower
 * bounds. */
struct alignas(16) gpu_box {
    short low[3], high[3];
    unsigned char kind, inner, row_begins, slice_begins;

    /* reference voxel of the bounds */
    __device__ __forceinline__ int middle(int d) const { return (low[d] + high[d]) >> 1; }
};

/* Counterpart of the CPU's raster_tet. The bounds are in floating point. If rounding could change a result, it is
 * computed from the corners (exact_plane).
 *
 * Row (j, k) begins along i at the maximum of at + j step_j + k step_k over the first row_begins planes, and ends at
 * the minimum over the others. Slice k begins along j, seen along i, at the maximum of edge + k edge_step over the
 * first slice_begins edges of the outline, and ends at the minimum over the others. */
struct alignas(16) gpu_tet {
    double at[4], step_j[4], step_k[4];
    float edge[4], edge_step[4];
    gpu_box box;
    double map[3][4];        /* source index along an axis = map[0] i + map[1] j + map[2] k + map[3] */
    unsigned long long bricks;
};

static const float far_away = 1e30f; /* an inactive bound */

/* ---- exchange between the four threads of a tetrahedron */

static __device__ __forceinline__ int of_thread(int value, int v) { return __shfl_sync(0xffffffff, value, v, 4); }
static __device__ __forceinline__ double of_thread(double value, int v) { return __shfl_sync(0xffffffff, value, v, 4); }
static __device__ __forceinline__ long long of_thread(long long value, int v)
{
    return __shfl_sync(0xffffffff, value, v, 4);
}

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

/* ---- pliant_raster_fix, for the thread's own node */

/* Compute a / b from 1 / b rounded to nearest. The second correction makes the quotient equal to a division (Markstein,
 * IBM Journal of Research and Development 34, 1990). Values too large for this are beyond any volume and are divided
 * directly. */
static __device__ __forceinline__ double gpu_divide(double a, double b, double reciprocal)
{
    double q = a * reciprocal;
    if (!(fabs(q) < 1e200)) return a / b;
    q = fma(fma(-q, b, a), reciprocal, q);
    return fma(fma(-q, b, a), reciprocal, q);
}

static __device__ __forceinline__ void gpu_fix(const raster_grid &grid, const double *reciprocal,
                                               const double *position, int *fixed)
{
    double offset[3];
    for (int d = 0; d < 3; d++) offset[d] = position[d] - grid.target.origin[d];
    for (int d = 0; d < 3; d++) {
        const double *axis = grid.target.direction + d;
        double index = gpu_divide(axis[0] * offset[0] + axis[3] * offset[1] + axis[6] * offset[2],
                                  grid.target.spacing[d], reciprocal[d]);
        double inside = index > grid.low[d] ? index : grid.low[d];
        inside = inside < grid.high[d] ? inside : grid.high[d];
        fixed[d] = __double2int_rn(inside * grid.scale);
    }
}

/* ---- pliant_raster_tet */

/* same as six_volumes */
static __device__ __forceinline__ double gpu_six_volumes(const int *edge, const long long *normal)
{
    long long high = 0, low = 0;
    for (int d = 0; d < 3; d++) {
        high += (edge[d] >> 11) * normal[d];
        low += (edge[d] & 2047) * normal[d];
    }
    return (double)(high + (low >> 11)) * 2048 + (double)(low & 2047);
}

/* same as plane_value */
static __device__ __forceinline__ long long gpu_plane_value(int fraction_bits, const long long *normal,
                                                            const int *point)
{
    long long whole = 0, fraction = 0;
    for (int d = 0; d < 3; d++) {
        whole += normal[d] * (point[d] >> fraction_bits);
        fraction += normal[d] * (point[d] & ((1 << fraction_bits) - 1));
    }
    return -whole + (-fraction >> fraction_bits);
}

/* Corners in fixed point, with the parameters of the grid. */
struct gpu_corners { const int *d_fixed; int fraction_bits; bool mirrored; };

static __device__ __forceinline__ gpu_corners corners_of(const gpu_raster &raster)
{
    return {raster.d_fixed, raster.grid.fraction_bits, raster.grid.mirrored};
}

/* Plane of a tetrahedron through the three nodes other than v, recomputed from the corners. */
struct exact_plane {
    long long normal[3], value; /* inward normal, per voxel along i, j, k; value at target voxel (0, 0, 0) */

    __device__ __forceinline__ long long at(int i, int j, int k) const
    {
        return value + normal[0] * i + normal[1] * j + normal[2] * k;
    }
};

static __device__ __forceinline__ exact_plane gpu_exact_plane(const gpu_corners &corners, int id, int v)
{
    const int *fixed = corners.d_fixed + 12 * (size_t)id;
    const int *from = fixed + (v == 0 ? 3 : 0), *one = fixed + (v == 1 ? 6 : v == 3 ? 3 : 9);
    const int *other = fixed + (v == 1 ? 9 : v == 2 ? 3 : 6);
    exact_plane out;
    for (int d = 0; d < 3; d++) {
        const int a = (d + 1) % 3, b = (d + 2) % 3;
        const long long n =
            (long long)(one[a] - from[a]) * (other[b] - from[b]) - (long long)(one[b] - from[b]) * (other[a] - from[a]);
        out.normal[d] = corners.mirrored ? -n : n;
    }
    out.value = gpu_plane_value(corners.fraction_bits, out.normal, from);
    return out;
}

/* same as max_in_brick, over the voxels of a box */
static __device__ __forceinline__ long long gpu_max_corner(const exact_plane &plane, const int *low, const int *high)
{
    long long maximum = plane.value;
    for (int d = 0; d < 3; d++) maximum += plane.normal[d] * (plane.normal[d] > 0 ? high[d] : low[d]);
    return maximum;
}

/* Compute the inward normals, before the sign change for a mirrored target, and the volume. Plane v contains the other
 * three nodes. Its normal is the cross product of edges from node 0; normal 0 is minus the sum of the others. */
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
    for (int d = 0; d < 3; d++)
        own[d] = (long long)p[(d + 1) % 3] * q[(d + 2) % 3] - (long long)p[(d + 2) % 3] * q[(d + 1) % 3];
    double volume = of_thread(gpu_six_volumes(edge[1], own), 1);
    for (int d = 0; d < 3; d++) {
        long long sum = of_thread(own[d], 1) + of_thread(own[d], 2) + of_thread(own[d], 3);
        if (v == 0) own[d] = -sum;
    }
    return volume;
}

/* Return the size of a fixed-point step in voxels. The scale is a power of two, so the multiplication is an exact
 * division. */
static __device__ __forceinline__ double raster_step(const raster_grid &grid)
{
    return ldexp(1.0, -grid.fraction_bits);
}

/* Compute one axis of the map from target to source, before rounding. All threads run it; threads 0 to 2 have an axis.
 * The barycentric coordinate of node n is normal[n] . (scale * voxel - node 0) / volume. */
static __device__ __forceinline__ void gpu_map(const raster_grid &grid, const int fixed[4][3], const double *rest,
                                               const double *normal, double volume, double *map)
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

/* Same as round_map along one axis: return whether the rounded map is within the tolerance. */
static __device__ __forceinline__ bool gpu_is_whole(const raster_grid &grid, int source_size, const int fixed[4][3],
                                                    const double *rest, const double *map, double *rounded)
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

/* same as stays_inside, along one axis */
static __device__ __forceinline__ bool gpu_stays_inside(int source_size, const double *rest, const double *map)
{
    bool inside = source_size <= 1 << 16 && fabs(map[0]) + fabs(map[1]) + fabs(map[2]) <= 64;
    for (int n = 0; n < 4; n++) inside = inside && rest[n] >= 0.5 && rest[n] <= source_size - 2.5;
    return inside;
}

/* ---- bounds */

static __device__ __forceinline__ unsigned ballot_of_four(bool value)
{
    return __ballot_sync(0xffffffff, value) >> (threadIdx.x & 28) & 15;
}

/* Return the position of v when the items with a flag come first. */
static __device__ __forceinline__ int place_among(unsigned flags, int v)
{
    const unsigned before = (1u << v) - 1;
    return flags >> v & 1 ? __popc(flags & before) : __popc(flags) + __popc(~flags & before);
}

static __device__ __forceinline__ int gpu_pick(const int fixed[4][3], int node, int d)
{
    return node == 0 ? fixed[0][d] : node == 1 ? fixed[1][d] : node == 2 ? fixed[2][d] : fixed[3][d];
}

/* Compute the row bound of plane v. A plane parallel to the rows is no bound here and leaves every row in doubt. */
static __device__ __forceinline__ unsigned set_rows(const long long *normal, long long value, const int *middle, int v,
                                                    gpu_tet *out)
{
    const unsigned begins = ballot_of_four(normal[0] > 0);
    if (!out) return begins;
    const int place = place_among(begins, v);
    for (int d = 0; d < 3; d++) value += normal[d] * middle[d];
    const double factor = normal[0] != 0 ? -1 / (double)normal[0] : 0;
    out->at[place] = normal[0] != 0 ? ((double)value + 0.5) * factor : far_away;
    out->step_j[place] = (double)normal[1] * factor;
    out->step_k[place] = (double)normal[2] * factor;
    return begins;
}

/* Compute the slice bound of an edge of the outline. The outline consists of edges between a plane that begins rows and
 * one that ends rows. Thread v combines its own plane with one of the other kind, so every such pair is covered. An
 * edge along j is no bound. */
static __device__ __forceinline__ unsigned set_slices(const raster_grid &grid, const int fixed[4][3], unsigned begins,
                                                      const int *middle, int v, gpu_tet *out)
{
    const unsigned ends = 15 & ~begins;
    const bool own = begins >> v & 1;
    const int first_begin = __ffs((int)begins) - 1, last_begin = 31 - __clz((int)begins);
    const int first_end = __ffs((int)ends) - 1, last_end = 31 - __clz((int)ends);
    const int p = own              ? v
                  : v == first_end ? last_begin
                                   : first_begin,
              q = !own               ? v
                  : v == first_begin ? first_end
                                     : last_end;
    /* nodes of the edge; p and q are invalid if nothing is drawn */
    const unsigned nodes = 15 & ~(1u << (p & 3) | 1u << (q & 3));
    const int one = __ffs((int)nodes) - 1, two = 31 - __clz((int)nodes);
    const int j = gpu_pick(fixed, one, 1), k = gpu_pick(fixed, one, 2), along_j = gpu_pick(fixed, two, 1) - j,
              along_k = gpu_pick(fixed, two, 2) - k;
    /* node q lies on the plane that begins rows, but not on the edge, so it gives the side of the tetrahedron */
    const long long side =
        (long long)(gpu_pick(fixed, q & 3, 1) - j) * along_k - (long long)(gpu_pick(fixed, q & 3, 2) - k) * along_j;
    const bool low = along_k == 0 || (along_k > 0) == (side > 0);
    const unsigned lows = ballot_of_four(low);
    if (!out) return lows;
    const int place = place_among(lows, v);
    const double step = along_k != 0 ? (double)along_j / along_k : 0, unit = raster_step(grid);
    out->edge[place] = along_k != 0 ? (float)((j * unit - middle[1]) - step * (k * unit - middle[2])) : -far_away;
    out->edge_step[place] = (float)step;
    return lows;
}

/* ---- bricks */

static __device__ __forceinline__ bool gpu_in_mask(const short *low, const short *high)
{
    bool in = true;
    for (int d = 0; d < 3; d++) in = in && high[d] / BRICK - low[d] / BRICK < MASK_EDGE;
    return in;
}

/* Same as find_bricks for one plane. Values at the corners of bricks in the mask are exact in double precision.
 * near: value at the first voxel of the first brick */
static __device__ __forceinline__ unsigned long long gpu_find_bricks(const short *low, const short *high,
                                                                     const double *normal, double near)
{
    unsigned long long bricks = 0;
    if (!gpu_in_mask(low, high)) return bricks;
    int count[3];
    double corner = near;
    for (int d = 0; d < 3; d++) {
        count[d] = high[d] / BRICK - low[d] / BRICK + 1;
        corner += normal[d] > 0 ? normal[d] * (BRICK - 1) : 0;
    }
    for (int k = 0; k < count[2]; k++, corner += BRICK * normal[2]) {
        double row = corner;
        for (int j = 0; j < count[1]; j++, row += BRICK * normal[1]) {
            double at = row;
            for (int i = 0; i < count[0]; i++, at += BRICK * normal[0])
                if (at >= 0) bricks |= 1ull << (i + MASK_EDGE * (j + MASK_EDGE * k));
        }
    }
    return bricks;
}

/* ---- inside a brick */

/* same as owner_choose_base, along one axis */
static __device__ __forceinline__ int gpu_base(const gpu_tet &tet, const int *origin, int d, int source_size)
{
    double at = tet.map[d][3];
    for (int c = 0; c < 3; c++) at += tet.map[d][c] * (origin[c] + BRICK / 2);
    int end = source_size - 1;
    return at >= end ? end : at > 0 ? (int)at : 0;
}

/* same as owner_fill_sample, along one axis */
static __device__ __forceinline__ float gpu_slot_origin(const double *map, const int *origin, int base)
{
    return (float)(map[0] * origin[0] + map[1] * origin[1] + map[2] * origin[2] + (map[3] - base));
}

#endif
