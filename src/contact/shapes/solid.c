#include "contact/shapes/solid.h"

#include "base/fail.h"
#include "base/memory.h"
#include "base/pairs.h"
#include "contact/shapes/tool_shape.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double one_point = 1e-6;         /* relative to the size: corners within this distance are merged */
static const double largest = 10, smallest = 1e-4; /* limits of the size [m] */

/* Points and triangles before they become a solid, in the file's units. */
typedef struct surface {
    const char *name;
    int32_t num_points, num_triangles;
    double *points;
    int32_t *triangles;
} surface;

static void free_solid(pliant_solid *solid)
{
    PLIANT_FREE(solid->points, solid->triangles, solid->plane, solid->value, solid);
}

const pliant_solid *pliant_solid_retain(const pliant_solid *solid)
{
    if (solid) atomic_fetch_add_explicit(&((pliant_solid *)solid)->holders, 1, memory_order_relaxed);
    return solid;
}

void pliant_solid_release(const pliant_solid *solid)
{
    pliant_solid *own = (pliant_solid *)solid;
    if (own && atomic_fetch_sub_explicit(&own->holders, 1, memory_order_acq_rel) == 1) free_solid(own);
}

/* ---- merging of corners */

typedef struct weld {
    const surface *of;
    double low[3], minimum;
    int32_t *head, *next, *same; /* hash table of cells, lists of points; the first point that each is merged with */
    uint32_t mask;
} weld;

static uint32_t cell_key(const int64_t cell[3], uint32_t mask)
{
    const uint64_t mixed = (uint64_t)cell[0] * 0x9E3779B97F4A7C15u ^ (uint64_t)cell[1] * 0xC2B2AE3D27D4EB4Fu ^
                           (uint64_t)cell[2] * 0x165667B19E3779F9u;
    return (uint32_t)(mixed >> 32 ^ mixed) & mask;
}

static int32_t find_same(const weld *on, int32_t point)
{
    const double *p = on->of->points + 3 * (size_t)point;
    int64_t low[3], high[3], cell[3];
    int32_t best = point;
    for (int d = 0; d < 3; d++) { /* cells of four times the distance */
        low[d] = (int64_t)floor((p[d] - on->low[d] - on->minimum) / (4 * on->minimum));
        high[d] = (int64_t)floor((p[d] - on->low[d] + on->minimum) / (4 * on->minimum));
    }
    for (cell[0] = low[0]; cell[0] <= high[0]; cell[0]++)
        for (cell[1] = low[1]; cell[1] <= high[1]; cell[1]++)
            for (cell[2] = low[2]; cell[2] <= high[2]; cell[2]++)
                for (int32_t other = on->head[cell_key(cell, on->mask)]; other >= 0; other = on->next[other]) {
                    const double *q = on->of->points + 3 * (size_t)other;
                    if (other < best && fabs(p[0] - q[0]) <= on->minimum && fabs(p[1] - q[1]) <= on->minimum &&
                        fabs(p[2] - q[2]) <= on->minimum)
                        best = other;
                }
    return best;
}

static void keep_point(weld *on, int32_t point)
{
    int64_t cell[3];
    for (int d = 0; d < 3; d++)
        cell[d] = (int64_t)floor((on->of->points[3 * (size_t)point + (size_t)d] - on->low[d]) / (4 * on->minimum));
    int32_t *head = on->head + cell_key(cell, on->mask);
    on->next[point] = *head;
    *head = point;
}

/* Give merged points one number, and remove degenerate triangles. */
static void join(surface *of, const int32_t *same)
{
    int32_t *number = of->triangles, left = 0; /* numbers of the remaining points */
    for (int32_t t = 0; t < of->num_triangles; t++) {
        const int32_t a = same[number[3 * (size_t)t]], b = same[number[3 * (size_t)t + 1]],
                      c = same[number[3 * (size_t)t + 2]];
        if (a == b || b == c || c == a) continue;
        number[3 * (size_t)left] = a;
        number[3 * (size_t)left + 1] = b;
        number[3 * (size_t)left + 2] = c;
        left++;
    }
    of->num_triangles = left;
}

static pliant_status join_points(surface *of, double size, const double low[3])
{
    weld on = {.of = of, .minimum = one_point * size};
    uint32_t slots = 16;
    while (slots < 2 * (uint32_t)of->num_points) slots *= 2;
    on.mask = slots - 1;
    memcpy(on.low, low, sizeof on.low);
    on.head = pliant_calloc(slots, sizeof *on.head);
    on.next = pliant_calloc((size_t)of->num_points, sizeof *on.next);
    on.same = pliant_calloc((size_t)of->num_points, sizeof *on.same);
    const bool good = on.head && on.next && on.same;
    for (uint32_t s = 0; good && s < slots; s++) on.head[s] = -1;
    for (int32_t p = 0; good && p < of->num_points; p++) {
        on.same[p] = find_same(&on, p);
        if (on.same[p] == p) keep_point(&on, p);
    }
    if (good) join(of, on.same);
    PLIANT_FREE(on.head, on.next, on.same);
    return good ? PLIANT_OK : pliant_fail_memory(of->name);
}

/* Remove points that no triangle uses. */
static pliant_status leave_points_out(surface *of)
{
    int32_t *number = pliant_calloc((size_t)of->num_points, sizeof *number), count = 0;
    if (!number) return pliant_fail_memory(of->name);
    for (int32_t c = 0; c < 3 * of->num_triangles; c++) number[of->triangles[c]] = 1;
    for (int32_t p = 0; p < of->num_points; p++) {
        if (!number[p]) continue;
        memmove(of->points + 3 * (size_t)count, of->points + 3 * (size_t)p, 3 * sizeof *of->points);
        number[p] = count++;
    }
    for (int32_t c = 0; c < 3 * of->num_triangles; c++) of->triangles[c] = number[of->triangles[c]];
    of->num_points = count;
    pliant_free(number);
    return PLIANT_OK;
}

/* ---- closed and consistently oriented */

/* An edge of one triangle: lower node, higher node, and its direction. */
typedef struct half_edge { int32_t low, high, up; } half_edge;

static pliant_status complain(const surface *of, const half_edge *edge, int32_t bad, int32_t edges, bool open)
{
    const double *a = of->points + 3 * (size_t)edge->low, *b = of->points + 3 * (size_t)edge->high;
    if (open)
        return pliant_fail(
            PLIANT_ERROR_FORMAT,
            "%s: is not closed: %d of its %d edges have only one triangle, the first from (%.6g, %.6g, %.6g) to (%.6g, "
            "%.6g, %.6g); fill its holes, or take its convex hull (kind: convex)",
            of->name, bad, edges, a[0], a[1], a[2], b[0], b[1], b[2]);
    return pliant_fail(
        PLIANT_ERROR_FORMAT,
        "%s: %d of its %d edges have triangles with opposite orientation, the first from (%.6g, %.6g, %.6g) to (%.6g, "
        "%.6g, %.6g); corners must go round counter-clockwise as seen from outside, everywhere",
        of->name, bad, edges, a[0], a[1], a[2], b[0], b[1], b[2]);
}

/* Check that each edge has as many triangles in one direction as in the other. */
static pliant_status check_closed(const surface *of)
{
    const size_t count = 3 * (size_t)of->num_triangles;
    half_edge *edge = pliant_calloc(count, sizeof *edge), first = {0, 0, 0};
    int32_t edges = 0, bad = 0, open = 0;
    if (!edge) return pliant_fail_memory(of->name);
    for (size_t c = 0; c < count; c++) {
        const int32_t a = of->triangles[c], b = of->triangles[c % 3 == 2 ? c - 2 : c + 1];
        edge[c] = a < b ? (half_edge){a, b, 1} : (half_edge){b, a, -1};
    }
    qsort(edge, count, sizeof *edge, pliant_pair_order);
    for (size_t c = 0, end; c < count; c = end, edges++) {
        int32_t sum = 0;
        for (end = c; end < count && pliant_pair_order(edge + c, edge + end) == 0; end++) sum += edge[end].up;
        if (sum == 0) continue;
        const bool is_open = (end - c) % 2;
        if (bad == 0 || (is_open && open == 0)) first = edge[c];
        bad++;
        open += is_open;
    }
    pliant_free(edge);
    return bad == 0 ? PLIANT_OK : complain(of, &first, open > 0 ? open : bad, edges, open > 0);
}

/* ---- the solid */

/* Rotate about the fixed axes x, y and z, in this order. */
static void turn(const double angle[3], const double v[3], double out[3])
{
    const double cx = cos(angle[0]), sx = sin(angle[0]), cy = cos(angle[1]), sy = sin(angle[1]), cz = cos(angle[2]),
                 sz = sin(angle[2]);
    const double y = cx * v[1] - sx * v[2], z = sx * v[1] + cx * v[2];
    const double x = cy * v[0] + sy * z;
    out[0] = cz * x - sz * y;
    out[1] = sz * x + cz * y;
    out[2] = -sy * v[0] + cy * z;
}

/* Compute the bounding box in meters, and check its size. */
static pliant_status take_measure(pliant_solid *solid, const char *name)
{
    double size = 0;
    for (int d = 0; d < 3; d++) {
        solid->low[d] = INFINITY;
        solid->high[d] = -INFINITY;
        for (int32_t p = 0; p < solid->num_points; p++) {
            solid->low[d] = fmin(solid->low[d], solid->points[3 * (size_t)p + (size_t)d]);
            solid->high[d] = fmax(solid->high[d], solid->points[3 * (size_t)p + (size_t)d]);
        }
        size = fmax(size, solid->high[d] - solid->low[d]);
    }
    if (size > largest)
        return pliant_fail(PLIANT_ERROR_FORMAT, "%s: is %.6g m large; is it in millimetres (unit: mm)?", name, size);
    if (size < smallest)
        return pliant_fail(PLIANT_ERROR_FORMAT, "%s: is %.6g m large; is it in metres (unit: m)?", name, size);
    return PLIANT_OK;
}

/* Compute the volume by tetrahedra to one common point. Turn the triangles of an inverted surface. */
static pliant_status find_volume(pliant_solid *solid, const char *name)
{
    double sum = 0;
    for (int32_t t = 0; t < solid->num_triangles; t++) {
        double to[3][3];
        for (int k = 0; k < 3; k++)
            for (int d = 0; d < 3; d++)
                to[k][d] = solid->points[3 * (size_t)solid->triangles[3 * t + k] + (size_t)d] - solid->low[d];
        for (int d = 0; d < 3; d++)
            sum += to[0][d] * (to[1][(d + 1) % 3] * to[2][(d + 2) % 3] - to[1][(d + 2) % 3] * to[2][(d + 1) % 3]) / 6;
    }
    for (int32_t t = 0; sum < 0 && t < solid->num_triangles; t++) {
        const int32_t other = solid->triangles[3 * t + 1];
        solid->triangles[3 * t + 1] = solid->triangles[3 * t + 2];
        solid->triangles[3 * t + 2] = other;
    }
    solid->volume = fabs(sum);
    return solid->volume > 0 ? PLIANT_OK : pliant_fail(PLIANT_ERROR_FORMAT, "%s: holds no volume", name);
}

static pliant_status make_faces(pliant_solid *solid, const char *name)
{
    double middle[3] = {0, 0, 0}, normal[3];
    if (!(solid->plane = pliant_calloc((size_t)solid->num_triangles, sizeof *solid->plane)))
        return pliant_fail_memory(name);
    for (int32_t t = 0; t < solid->num_triangles; t++) {
        const double *a = solid->points + 3 * solid->triangles[3 * t],
                     *b = solid->points + 3 * solid->triangles[3 * t + 1];
        const double *c = solid->points + 3 * solid->triangles[3 * t + 2];
        double *plane = solid->plane[t], size = 0;
        for (int d = 0; d < 3; d++) {
            const int e = (d + 1) % 3, f = (d + 2) % 3;
            plane[d] = (b[e] - a[e]) * (c[f] - a[f]) - (b[f] - a[f]) * (c[e] - a[e]);
            size += plane[d] * plane[d];
        }
        for (int d = 0; d < 3; d++) plane[d] /= sqrt(size);
        for (int d = 0; d < 3; d++) plane[3] += plane[d] * a[d];
    }
    for (int32_t p = 0; p < solid->num_points; p++)
        for (int d = 0; d < 3; d++) middle[d] += solid->points[3 * p + d] / solid->num_points;
    solid->depth = -pliant_solid_distance(solid, middle, normal);
    return PLIANT_OK;
}

/* Make the solid. It takes over the surface's arrays. */
static pliant_status finish(surface *of, const pliant_solid_options *options, pliant_solid **out)
{
    pliant_solid *solid = pliant_calloc(1, sizeof *solid);
    if (!solid) return pliant_fail_memory(of->name);
    const double unit = options->unit > 0 ? options->unit : 1;
    atomic_init(&solid->holders, 1);
    solid->convex = options->convex;
    solid->num_points = of->num_points;
    solid->num_triangles = of->num_triangles;
    solid->points = of->points;
    solid->triangles = of->triangles;
    of->points = NULL;
    of->triangles = NULL;
    for (int32_t p = 0; p < solid->num_points; p++) {
        double *at = solid->points + 3 * (size_t)p;
        const double scaled[3] = {unit * at[0], unit * at[1], unit * at[2]};
        turn(options->turn, scaled, at);
    }
    pliant_status status = take_measure(solid, of->name);
    if (status == PLIANT_OK) status = find_volume(solid, of->name);
    if (status == PLIANT_OK)
        status =
            solid->convex ? make_faces(solid, of->name) : pliant_solid_make_field(solid, options->resolution, of->name);
    if (status == PLIANT_OK) *out = solid;
    else free_solid(solid);
    return status;
}

static pliant_status check_options(const pliant_solid_options *options, const char *name)
{
    bool good =
        options->unit >= 0 && isfinite(options->unit) && options->resolution >= 0 && isfinite(options->resolution);
    for (int d = 0; d < 3; d++) good = good && isfinite(options->turn[d]);
    return good ? PLIANT_OK
                : pliant_fail(PLIANT_ERROR_ARGUMENT,
                              "%s: unit and resolution must be finite and not below 0, its turn finite", name);
}

static pliant_status make(surface *of, const pliant_solid_options *options, pliant_solid **out)
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, size = 0;
    for (int32_t p = 0; p < of->num_points; p++)
        for (int d = 0; d < 3; d++) {
            const double v = of->points[3 * (size_t)p + (size_t)d];
            if (!isfinite(v)) return pliant_fail(PLIANT_ERROR_FORMAT, "%s: point %d is not finite", of->name, p + 1);
            low[d] = fmin(low[d], v);
            high[d] = fmax(high[d], v);
        }
    for (int d = 0; d < 3; d++) size = fmax(size, high[d] - low[d]);
    pliant_status status =
        size > 0 && isfinite(size) ? PLIANT_OK : pliant_fail(PLIANT_ERROR_FORMAT, "%s: has no size", of->name);
    if (status == PLIANT_OK && options->convex) {
        pliant_free(of->triangles);
        of->triangles = NULL;
        status = pliant_hull_find(of->num_points, of->points, of->name, &of->num_triangles, &of->triangles);
    } else if (status == PLIANT_OK) {
        status = join_points(of, size, low);
        if (status == PLIANT_OK && of->num_triangles == 0)
            status = pliant_fail(PLIANT_ERROR_FORMAT, "%s: none of its triangles has an area", of->name);
        if (status == PLIANT_OK) status = check_closed(of);
    }
    if (status == PLIANT_OK) status = leave_points_out(of);
    return status == PLIANT_OK ? finish(of, options, out) : status;
}

pliant_status pliant_solid_create(int32_t num_points, const double *points, int32_t num_triangles,
                                  const int32_t *triangles, const pliant_solid_options *options, const char *name,
                                  pliant_solid **out)
{
    pliant_status status = check_options(options, name);
    if (status != PLIANT_OK) return status;
    if (num_points < 4 || num_points > 3 * PLIANT_SOLID_TRIANGLES || num_triangles > PLIANT_SOLID_TRIANGLES ||
        (num_triangles < 4 && !options->convex))
        return pliant_fail(
            PLIANT_ERROR_ARGUMENT,
            "%s: %d points and %d triangles are not a solid: use at least 4 points and at most %d triangles", name,
            num_points, num_triangles, PLIANT_SOLID_TRIANGLES);
    if (options->convex) num_triangles = 0;
    for (int32_t c = 0; c < 3 * num_triangles; c++)
        if (triangles[c] < 0 || triangles[c] >= num_points)
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "%s: triangle %d has corner %d; there are %d points", name,
                               c / 3 + 1, triangles[c], num_points);
    surface of = {.name = name, .num_points = num_points, .num_triangles = num_triangles};
    of.points = pliant_calloc((size_t)num_points, 3 * sizeof *of.points);
    of.triangles = num_triangles > 0 ? pliant_calloc((size_t)num_triangles, 3 * sizeof *of.triangles) : NULL;
    if (!of.points || (num_triangles > 0 && !of.triangles)) status = pliant_fail_memory(name);
    if (status == PLIANT_OK) {
        memcpy(of.points, points, 3 * (size_t)num_points * sizeof *points);
        if (num_triangles > 0) memcpy(of.triangles, triangles, 3 * (size_t)num_triangles * sizeof *triangles);
        status = make(&of, options, out);
    }
    pliant_free(of.points);
    pliant_free(of.triangles);
    return status;
}

pliant_status pliant_solid_read(const char *path, const pliant_solid_options *options, pliant_solid **out)
{
    pliant_triangle_soup soup = {0, NULL};
    pliant_status status = check_options(options, path);
    if (status == PLIANT_OK) status = pliant_stl_read(path, &soup);
    if (status != PLIANT_OK) return status;
    surface of = {
        .name = path, .num_points = 3 * soup.num_triangles, .num_triangles = soup.num_triangles, .points = soup.points};
    of.triangles = pliant_calloc((size_t)of.num_points, sizeof *of.triangles);
    if (!of.triangles) status = pliant_fail_memory(path);
    for (int32_t c = 0; of.triangles && c < of.num_points; c++) of.triangles[c] = c;
    if (status == PLIANT_OK) status = make(&of, options, out);
    pliant_free(of.points);
    pliant_free(of.triangles);
    return status;
}

void pliant_solid_get_surface(const pliant_solid *solid, pliant_solid_surface *out)
{
    const size_t field =
        solid->value ? (size_t)solid->size[0] * (size_t)solid->size[1] * (size_t)solid->size[2] * sizeof *solid->value
                     : 0;
    *out = (pliant_solid_surface){
        .num_points = solid->num_points,
        .num_triangles = solid->num_triangles,
        .points = solid->points,
        .triangles = solid->triangles,
        .convex = solid->convex,
        .resolution = solid->convex ? 0 : solid->cell,
        .error = solid->error,
        .volume = solid->volume,
        .bytes = sizeof *solid + 3 * (size_t)solid->num_points * sizeof *solid->points +
                 3 * (size_t)solid->num_triangles * sizeof *solid->triangles +
                 (solid->plane ? (size_t)solid->num_triangles * sizeof *solid->plane : 0) + field,
    };
}
