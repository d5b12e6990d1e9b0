/* Find the voxels near cut faces. */
#include "warp/near_cut.h"

#include "base/fail.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

/* Maximum distance along each axis between the sample points of a triangle [voxels]. */
static const double sample_distance = 0.5;

static void mark_around(const double index[3], double distance, const int32_t size[3], uint8_t *mask, uint8_t value)
{
    int32_t low[3], high[3];
    for (int d = 0; d < 3; d++) {
        const double before = ceil(index[d] - distance), behind = floor(index[d] + distance);
        if (before > size[d] - 1 || behind < 0) return;
        low[d] = before > 0 ? (int32_t)before : 0;
        high[d] = behind < size[d] - 1 ? (int32_t)behind : size[d] - 1;
    }
    for (int32_t k = low[2]; k <= high[2]; k++)
        for (int32_t j = low[1]; j <= high[1]; j++)
            memset(mask + (size_t)low[0] + (size_t)size[0] * ((size_t)j + (size_t)size[1] * (size_t)k), value,
                   (size_t)(high[0] - low[0] + 1));
}

/* corner: index in the grid */
static void mark_triangle(double corner[3][3], double distance, const int32_t size[3], uint8_t *mask, uint8_t value)
{
    double longest = 0;
    for (int v = 0; v < 3; v++)
        for (int d = 0; d < 3; d++) longest = fmax(longest, fabs(corner[v][d] - corner[(v + 1) % 3][d]));
    /* a triangle outside the grid marks nothing */
    for (int d = 0; d < 3; d++) {
        const double minimum = fmin(corner[0][d], fmin(corner[1][d], corner[2][d])),
                     maximum = fmax(corner[0][d], fmax(corner[1][d], corner[2][d]));
        if (!(maximum >= -distance && minimum <= size[d] - 1 + distance)) return;
    }
    const int parts = (int)fmin(ceil(longest / sample_distance), 4096) + 1;
    for (int a = 0; a <= parts; a++)
        for (int b = 0; a + b <= parts; b++) {
            double index[3];
            for (int d = 0; d < 3; d++)
                index[d] =
                    corner[0][d] + (a * (corner[1][d] - corner[0][d]) + b * (corner[2][d] - corner[0][d])) / parts;
            mark_around(index, distance + 0.5 * sample_distance, size, mask, value);
        }
}

pliant_status pliant_near_cut_mark(const pliant_surface *surface, const double *positions, const pliant_geometry *grid,
                                   double distance, uint8_t *mask, uint8_t value)
{
    const int32_t nodes = surface->body->fine.num_nodes;
    double *vertices = pliant_calloc((size_t)surface->num_vertices + 1, 3 * sizeof *vertices);
    if (!vertices) return pliant_fail_memory("the mask of the displacement field");
    pliant_surface_at_vertices(surface, 3, positions, vertices);
    for (int32_t t = surface->first_cut; t < surface->num_triangles; t++) {
        double corner[3][3];
        for (int v = 0; v < 3; v++) {
            const int32_t point = surface->triangle[3 * (size_t)t + (size_t)v];
            pliant_geometry_to_index(
                grid, point < nodes ? positions + 3 * (size_t)point : vertices + 3 * (size_t)(point - nodes),
                corner[v]);
        }
        mark_triangle(corner, distance, grid->size, mask, value);
    }
    pliant_free(vertices);
    return PLIANT_OK;
}
