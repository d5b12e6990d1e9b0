/* Signed distance field of a solid on a grid: exact at its points, linear in between. */
#include "contact/shapes/solid.h"

#include "base/fail.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

/* extent of the grid beyond the solid [m], which is more than the search distance of contacts at rest */
static const double around = 0.0015;
static const double finest = 1e-4;    /* minimum cell size by default [m] */
static const double usual_points = 200000, max_points = 16777216; /* 64 MiB */
static const double thinnest = 0.25;  /* required depth of the deepest point, as a fraction of a cell */
static const double rounding = 1.0001; /* factor on distances of grid points in single precision */
static const double enlargement = 1.1; /* of the cell that an error message recommends */
static const double no_way = 0.2;     /* gradients shorter than this have no valid direction */

/* ---- evaluation */

static double field_at(const pliant_solid *solid, const double p[3], double gradient[3])
{
    size_t base = 0, stride[3] = {1, (size_t)solid->size[0], (size_t)solid->size[0] * (size_t)solid->size[1]};
    double fraction[3], value = 0;
    for (int d = 0; d < 3; d++) {
        const double at = (p[d] - solid->origin[d]) / solid->cell, cell = fmin(fmax(floor(at), 0), solid->size[d] - 2);
        fraction[d] = at - cell;
        base += (size_t)cell * stride[d];
        gradient[d] = 0;
    }
    for (int c = 0; c < 8; c++) {
        const double v = solid->value[base + (c & 1) * stride[0] + (c >> 1 & 1) * stride[1] + (c >> 2) * stride[2]];
        const double w[3] = {c & 1 ? fraction[0] : 1 - fraction[0], c >> 1 & 1 ? fraction[1] : 1 - fraction[1],
                             c >> 2 ? fraction[2] : 1 - fraction[2]};
        value += v * w[0] * w[1] * w[2];
        gradient[0] += (c & 1 ? v : -v) * w[1] * w[2];
        gradient[1] += (c >> 1 & 1 ? v : -v) * w[0] * w[2];
        gradient[2] += (c >> 2 ? v : -v) * w[0] * w[1];
    }
    for (int d = 0; d < 3; d++) gradient[d] /= solid->cell;
    return value;
}

static double from_field(const pliant_solid *solid, const double p[3], double normal[3])
{
    double inside[3], square = 0, length = 0;
    for (int d = 0; d < 3; d++) {
        inside[d] = fmin(fmax(p[d], solid->origin[d]), solid->origin[d] + solid->cell * (solid->size[d] - 1));
        square += (p[d] - inside[d]) * (p[d] - inside[d]);
    }
    const double value = field_at(solid, inside, normal);
    /* lower bound: the path into the grid's box and the path from there to the surface enclose an angle of at least
     * 90 degrees */
    for (int d = 0; square > 0 && d < 3; d++) normal[d] = p[d] - inside[d] + value * normal[d];
    for (int d = 0; d < 3; d++) length += normal[d] * normal[d];
    length = sqrt(length);
    const bool nowhere = length < (square > 0 ? 0 : no_way);
    for (int d = 0; d < 3; d++) normal[d] = nowhere ? 0 : normal[d] / length;
    return square > 0 ? sqrt(square + value * value) : value;
}

/* Inside use the nearest plane; outside use the nearest triangle that faces the point. */
static double from_faces(const pliant_solid *solid, const double p[3], double normal[3])
{
    double highest = -INFINITY, minimum = INFINITY, foot[3];
    for (int32_t t = 0; t < solid->num_triangles; t++) {
        const double *plane = solid->plane[t], height = plane[0] * p[0] + plane[1] * p[1] + plane[2] * p[2] - plane[3];
        if (height > highest) {
            highest = height;
            memcpy(normal, plane, 3 * sizeof *normal);
        }
    }
    if (highest <= 0) return highest;
    for (int32_t t = 0; t < solid->num_triangles; t++) {
        const double *plane = solid->plane[t], height = plane[0] * p[0] + plane[1] * p[1] + plane[2] * p[2] - plane[3];
        const int32_t *node = solid->triangles + 3 * (size_t)t;
        if (height <= 0 || height >= minimum) continue;
        pliant_triangle_nearest(solid->points + 3 * (size_t)node[0], solid->points + 3 * (size_t)node[1],
                                solid->points + 3 * (size_t)node[2], p, foot);
        const double offset[3] = {p[0] - foot[0], p[1] - foot[1], p[2] - foot[2]};
        const double far = sqrt(offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2]);
        if (!(far < minimum)) continue;
        minimum = far;
        for (int d = 0; d < 3 && far > 0; d++) normal[d] = offset[d] / far;
    }
    return minimum;
}

double pliant_solid_distance(const pliant_solid *solid, const double p[3], double normal[3])
{
    return solid->convex ? from_faces(solid, p, normal) : from_field(solid, p, normal);
}

/* ---- construction */

static size_t index_of(const pliant_solid *solid, int32_t i, int32_t j, int32_t k)
{
    return (size_t)i + (size_t)solid->size[0] * ((size_t)j + (size_t)solid->size[1] * (size_t)k);
}

static void point_of(const pliant_solid *solid, size_t index, double out[3])
{
    const size_t i = index % (size_t)solid->size[0], rest = index / (size_t)solid->size[0];
    out[0] = solid->origin[0] + solid->cell * (double)i;
    out[1] = solid->origin[1] + solid->cell * (double)(rest % (size_t)solid->size[1]);
    out[2] = solid->origin[2] + solid->cell * (double)(rest / (size_t)solid->size[1]);
}

static pliant_status place_grid(pliant_solid *solid, double resolution, const char *name)
{
    double volume = 1, points = 1, cell = resolution;
    for (int d = 0; d < 3; d++) volume *= solid->high[d] - solid->low[d] + 2 * around;
    if (cell == 0) cell = fmax(cbrt(volume / usual_points), finest);
    for (int d = 0; d < 3; d++) points *= ceil((solid->high[d] - solid->low[d] + 2 * around) / cell) + 1;
    if (!(points <= max_points))
        return pliant_fail(
            PLIANT_ERROR_FORMAT,
            "%s: a distance field with a resolution of %.3g mm needs %.3g MiB; the limit is 64: use a resolution of "
            "%.3g mm",
            name, 1e3 * cell, points * sizeof(float) / (1 << 20), 1e3 * enlargement * cbrt(volume / max_points));
    solid->cell = cell;
    for (int d = 0; d < 3; d++) {
        const double width = solid->high[d] - solid->low[d] + 2 * around;
        solid->size[d] = (int32_t)ceil(width / cell) + 1;
        solid->origin[d] = 0.5 * (solid->low[d] + solid->high[d] - cell * (solid->size[d] - 1));
    }
    return PLIANT_OK;
}

/* The distance of a point is at most its neighbor's distance plus the distance between them. This bounds the
 * search. */
static void find_distances(pliant_solid *solid, const pliant_triangle_tree *tree)
{
    for (int32_t k = 0; k < solid->size[2]; k++)
        for (int32_t j = 0; j < solid->size[1]; j++)
            for (int32_t i = 0; i < solid->size[0]; i++) {
                const size_t at = index_of(solid, i, j, k);
                const size_t before = i > 0   ? at - 1
                                      : j > 0 ? at - (size_t)solid->size[0]
                                              : at - (size_t)solid->size[0] * (size_t)solid->size[1];
                double p[3];
                point_of(solid, at, p);
                solid->value[at] = (float)pliant_triangle_tree_distance(
                    tree, p, at > 0 ? rounding * ((double)solid->value[before] + solid->cell) : INFINITY);
            }
}

/* Determine the signs. Two neighbors are on the same side of the surface if both are farther from it than a segment
 * that crosses it allows. Each connected group needs one winding number. */
static pliant_status find_signs(pliant_solid *solid, const pliant_triangle_tree *tree)
{
    const size_t count = (size_t)solid->size[0] * (size_t)solid->size[1] * (size_t)solid->size[2];
    const size_t stride[3] = {1, (size_t)solid->size[0], (size_t)solid->size[0] * (size_t)solid->size[1]};
    uint8_t *known = pliant_calloc(count, 1);
    uint32_t *queue = pliant_calloc(count, sizeof *queue);
    for (size_t seed = 0; known && queue && seed < count; seed++) {
        double p[3];
        if (known[seed]) continue;
        point_of(solid, seed, p);
        const bool inside = pliant_triangle_tree_winding(tree, p) > 0.5;
        size_t first = 0, last = 0;
        known[seed] = 1;
        for (queue[last++] = (uint32_t)seed; first < last; first++) {
            const size_t at = queue[first],
                         place[3] = {at % stride[1], at / stride[1] % (size_t)solid->size[1], at / stride[2]};
            const double own = fabs((double)solid->value[at]);
            for (int side = 0; side < 6; side++) {
                const int d = side / 2;
                if (side % 2 ? place[d] + 1 == (size_t)solid->size[d] : place[d] == 0) continue;
                const size_t adjacent = side % 2 ? at + stride[d] : at - stride[d];
                if (known[adjacent] || own + fabs((double)solid->value[adjacent]) <= rounding * solid->cell) continue;
                known[adjacent] = 1;
                queue[last++] = (uint32_t)adjacent;
            }
            if (inside) solid->value[at] = -solid->value[at];
        }
    }
    const bool good = known && queue;
    pliant_free(known);
    pliant_free(queue);
    return good ? PLIANT_OK : pliant_fail_memory("a solid");
}

/* Determine the largest depth, and the field's error on the surface. */
static void look_at_field(pliant_solid *solid)
{
    const size_t count = (size_t)solid->size[0] * (size_t)solid->size[1] * (size_t)solid->size[2];
    for (size_t n = 0; n < count; n++) solid->depth = fmax(solid->depth, -(double)solid->value[n]);
    for (int32_t t = 0; t < solid->num_triangles; t++) {
        double middle[3] = {0, 0, 0}, gradient[3];
        for (int k = 0; k < 3; k++) {
            const double *corner = solid->points + 3 * (size_t)solid->triangles[3 * (size_t)t + (size_t)k];
            for (int d = 0; d < 3; d++) middle[d] += corner[d] / 3;
            solid->error = fmax(solid->error, fabs(field_at(solid, corner, gradient)));
        }
        solid->error = fmax(solid->error, fabs(field_at(solid, middle, gradient)));
    }
}

pliant_status pliant_solid_make_field(pliant_solid *solid, double resolution, const char *name)
{
    pliant_triangle_tree *tree = NULL;
    pliant_status status = place_grid(solid, resolution, name);
    if (status != PLIANT_OK) return status;
    solid->value =
        pliant_calloc((size_t)solid->size[0] * (size_t)solid->size[1] * (size_t)solid->size[2], sizeof *solid->value);
    if (!solid->value) return pliant_fail_memory(name);
    status = pliant_triangle_tree_create(solid->points, solid->num_triangles, solid->triangles, &tree);
    if (status != PLIANT_OK) return status;
    find_distances(solid, tree);
    status = find_signs(solid, tree);
    pliant_triangle_tree_free(tree);
    if (status != PLIANT_OK) return status;
    look_at_field(solid);
    if (!(solid->depth > thinnest * solid->cell))
        return pliant_fail(
            PLIANT_ERROR_FORMAT,
            "%s: is too thin for a distance field with a resolution of %.3g mm: use a finer resolution, or a radius "
            "around it",
            name, 1e3 * solid->cell);
    return PLIANT_OK;
}
