/* Convert nodes to the target's fixed-point grid, and set up tetrahedra for rasterization (raster.h explains the
 * integers). */
#include "base/matrix.h"
#include "warp/raster.h"

#include <math.h>
#include <string.h>

/* Maximum deviation from whole voxels at which a map copies voxels [voxels]. It is far below a visible difference, and
 * far above the rounding of positions in metres (about 1e-12 voxel). */
static const double copy_tolerance = 1e-4;

/* Find the longest rest edge of the mesh along each axis [target voxels]. */
static void longest_edges(const pliant_geometry *target, const pliant_mesh *mesh, double longest[3])
{
    memset(longest, 0, 3 * sizeof *longest);
    for (int32_t t = 0; t < mesh->num_tets; t++) {
        double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
        for (int v = 0; v < 4; v++) {
            double index[3];
            pliant_geometry_to_index(target, mesh->rest + 3 * mesh->tets[4 * t + v], index);
            for (int d = 0; d < 3; d++) {
                low[d] = fmin(low[d], index[d]);
                high[d] = fmax(high[d], index[d]);
            }
        }
        for (int d = 0; d < 3; d++) longest[d] = fmax(longest[d], high[d] - low[d]);
    }
}

bool pliant_raster_grid(const pliant_geometry *target, const pliant_mesh *mesh, raster_grid *out)
{
    raster_grid grid = {.target = *target, .mirrored = pliant_determinant(target->direction) < 0};
    double longest[3], span = 0;
    longest_edges(target, mesh, longest);
    for (int d = 0; d < 3; d++) {
        /* A tetrahedron inside the target keeps its shape if it is stretched less than fourfold. */
        double margin = 1 + fmax(0.25 * target->size[d], 4 * longest[d]);
        grid.low[d] = -margin;
        grid.high[d] = target->size[d] - 1 + margin;
        grid.bricks[d] = (target->size[d] - 1) / BRICK + 1;
        span = fmax(span, grid.high[d] - grid.low[d]);
    }
    if (!(span < ldexp(1, SPAN_BITS - FRACTION_BITS_MIN) - 1)) return false;
    grid.fraction_bits = FRACTION_BITS_MAX;
    while (ldexp(span + 1, grid.fraction_bits) > ldexp(1, SPAN_BITS)) grid.fraction_bits--;
    grid.scale = ldexp(1, grid.fraction_bits);
    *out = grid;
    return true;
}

void pliant_raster_fix(const raster_grid *grid, const double position[3], int32_t fixed[3])
{
    double index[3];
    pliant_geometry_to_index(&grid->target, position, index);
    for (int d = 0; d < 3; d++) {
        /* this form converts an overflow to NaN to the lower limit */
        double inside = index[d] > grid->low[d] ? index[d] : grid->low[d];
        inside = inside < grid->high[d] ? inside : grid->high[d];
        fixed[d] = (int32_t)lrint(inside * grid->scale);
    }
}

static void cross(const int64_t a[3], const int64_t b[3], int64_t out[3])
{
    for (int d = 0; d < 3; d++) out[d] = a[(d + 1) % 3] * b[(d + 2) % 3] - a[(d + 2) % 3] * b[(d + 1) % 3];
}

/* Return six times the volume. The dot product has up to 69 bits; the high part and the sign are exact. */
static double six_volumes(const int64_t edge[3], const int64_t normal[3])
{
    enum { LOW_BITS = 11, LOW = (1 << LOW_BITS) - 1 };
    int64_t high = 0, low = 0;
    for (int d = 0; d < 3; d++) {
        high += (edge[d] >> LOW_BITS) * normal[d];
        low += (edge[d] & LOW) * normal[d];
    }
    return (double)(high + (low >> LOW_BITS)) * (LOW + 1) + (double)(low & LOW);
}

/* Return the plane's value at voxel (0, 0, 0), from a point on it: floor(normal . (0 - point) / scale). */
static int64_t plane_value(const raster_grid *grid, const int64_t normal[3], const int32_t point[3])
{
    int64_t whole = 0, fraction = 0;
    for (int d = 0; d < 3; d++) {
        whole += normal[d] * (point[d] >> grid->fraction_bits);
        fraction += normal[d] * (point[d] & ((1 << grid->fraction_bits) - 1));
    }
    return -whole + (-fraction >> grid->fraction_bits);
}

/* If the map takes voxel centres to voxel centres of the scan up to rounding, round it to do so exactly. */
static bool round_map(const raster_grid *grid, const raster_source *source, const int32_t *const fixed[4],
                      const double *const rest[4], double map[4][4])
{
    double rounded[4][4] = {{0}};
    for (int d = 0; d < 3; d++) {
        double sum = 0;
        for (int c = 0; c < 4; c++) {
            rounded[c][d] = rint(map[c][d]);
            if (c < 3) sum += fabs(rounded[c][d]);
        }
        /* fixed-point nodes have an error of half a step along each axis */
        double tolerance = copy_tolerance + 0.5 * sum / grid->scale;
        for (int v = 0; v < 4; v++) {
            double at = rounded[3][d];
            for (int c = 0; c < 3; c++) at += rounded[c][d] * (fixed[v][c] / grid->scale);
            bool inside = rest[v][d] > -0.75 && rest[v][d] < source->size[d] - 0.25;
            if (!inside || !(fabs(at - rest[v][d]) <= tolerance)) return false;
        }
    }
    memcpy(map, rounded, sizeof rounded);
    return true;
}

/* Return the maximum of a plane's value in a brick. */
static int64_t max_in_brick(const raster_tet *tet, int plane, const int32_t brick[3])
{
    int64_t maximum = tet->value[plane];
    for (int d = 0; d < 3; d++) {
        int64_t n = (int64_t)tet->normal[d][plane];
        maximum += n * (brick[d] * BRICK) + (n > 0 ? n * (BRICK - 1) : 0);
    }
    return maximum;
}

bool pliant_raster_cuts(const raster_tet *tet, const int32_t brick[3])
{
    for (int plane = 0; plane < 4; plane++)
        if (max_in_brick(tet, plane, brick) < 0) return false;
    return true;
}

static void find_bricks(raster_tet *tet)
{
    int32_t low[3], high[3], at[3];
    if (!raster_range(tet, low, high)) return;
    int64_t first[4], step[3][4]; /* maximum in the first brick, and its change from brick to brick */
    for (int plane = 0; plane < 4; plane++) {
        first[plane] = max_in_brick(tet, plane, low);
        for (int d = 0; d < 3; d++) step[d][plane] = BRICK * (int64_t)tet->normal[d][plane];
    }
    for (at[2] = 0; at[2] <= high[2] - low[2]; at[2]++)
        for (at[1] = 0; at[1] <= high[1] - low[1]; at[1]++) {
            int64_t maximum[4];
            for (int p = 0; p < 4; p++) maximum[p] = first[p] + at[1] * step[1][p] + at[2] * step[2][p];
            for (at[0] = 0; at[0] <= high[0] - low[0]; at[0]++) {
                if ((maximum[0] | maximum[1] | maximum[2] | maximum[3]) >= 0) /* all are non-negative */
                    tet->bricks |= (uint64_t)1 << (at[0] + MASK_EDGE * (at[1] + MASK_EDGE * at[2]));
                for (int p = 0; p < 4; p++) maximum[p] += step[0][p];
            }
        }
}

/* Return whether the map stays far enough inside the scan that rounding to float cannot move an index out of it.
 * Coordinates relative to a brick are then below 2^17, with an error below 2^-6 voxel. */
static bool stays_inside(const raster_source *source, const double *const rest[4], double map[4][4])
{
    for (int d = 0; d < 3; d++) {
        if (source->size[d] > 1 << 16 || fabs(map[0][d]) + fabs(map[1][d]) + fabs(map[2][d]) > 64) return false;
        for (int v = 0; v < 4; v++)
            if (!(rest[v][d] >= 0.5 && rest[v][d] <= source->size[d] - 2.5)) return false;
    }
    return true;
}

/* Compute the bounding box in voxels inside the target; false if it is empty. */
static bool find_box(const raster_grid *grid, const int32_t *const fixed[4], raster_tet *tet)
{
    for (int d = 0; d < 3; d++) {
        int32_t low = fixed[0][d], high = low;
        for (int v = 1; v < 4; v++) {
            low = fixed[v][d] < low ? fixed[v][d] : low;
            high = fixed[v][d] > high ? fixed[v][d] : high;
        }
        low = -(-low >> grid->fraction_bits); /* rounded up */
        high = high >> grid->fraction_bits;
        tet->low[d] = (int16_t)(low > 0 ? low : 0);
        tet->high[d] = (int16_t)(high < grid->target.size[d] - 1 ? high : grid->target.size[d] - 1);
        if (tet->low[d] > tet->high[d]) return false;
    }
    return true;
}

void pliant_raster_tet(const raster_grid *grid, const raster_source *source, const int32_t *const fixed[4],
                       const double *const rest[4], raster_tet *out)
{
    memset(out, 0, sizeof *out);
    int64_t edge[4][3], normal[4][3];
    for (int v = 1; v < 4; v++)
        for (int d = 0; d < 3; d++) edge[v][d] = (int64_t)fixed[v][d] - fixed[0][d];
    cross(edge[2], edge[3], normal[1]);
    cross(edge[3], edge[1], normal[2]);
    cross(edge[1], edge[2], normal[3]);
    double volume = six_volumes(edge[1], normal[1]);
    if (grid->mirrored ? volume >= 0 : volume <= 0) return;
    if (!find_box(grid, fixed, out)) return;

    /* barycentric coordinate of node v: normal[v] . (scale * voxel - node 0) / volume; the map is linear in these */
    double unit = grid->scale / volume, step = 1 / grid->scale;
    for (int d = 0; d < 3; d++) {
        out->map[3][d] = rest[0][d];
        for (int c = 0; c < 3; c++) {
            double sum = 0;
            for (int v = 1; v < 4; v++) sum += (rest[v][d] - rest[0][d]) * (double)normal[v][c];
            out->map[c][d] = sum * unit;
            out->map[3][d] -= out->map[c][d] * (fixed[0][c] * step);
        }
    }
    out->kind = round_map(grid, source, fixed, rest, out->map) ? RASTER_COPY : RASTER_SAMPLE;
    out->inner = stays_inside(source, rest, out->map);

    for (int d = 0; d < 3; d++) normal[0][d] = -(normal[1][d] + normal[2][d] + normal[3][d]);
    for (int v = 0; v < 4; v++) {
        if (grid->mirrored)
            for (int d = 0; d < 3; d++) normal[v][d] = -normal[v][d];
        for (int d = 0; d < 3; d++) out->normal[d][v] = (double)normal[v][d];
        out->value[v] = plane_value(grid, normal[v], fixed[v == 0]);
        out->factor[v] = normal[v][0] ? 1 / fabs((double)normal[v][0]) : 8 * BRICK;
    }
    out->small = true;
    for (int v = 0; v < 4; v++) {
        double maximum = fabs((double)out->value[v]);
        for (int d = 0; d < 3; d++) maximum += fabs(out->normal[d][v]) * grid->target.size[d];
        out->small &= maximum < 0x1p51;
    }
    find_bricks(out);
}
