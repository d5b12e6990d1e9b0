#include "contact/advance/advance_workspace.h"

#include "base/buffer.h"
#include "base/fail.h"
#include "contact/advance/advance_rules.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

typedef pliant_advance_box box;

/* ---- buffers */

static bool reserve_parts(pliant_advance *advance, int32_t parts)
{
    if (parts > advance->max_parts) {
        if (!pliant_grow(&advance->motion, (size_t)parts, sizeof *advance->motion)) return false;
        if (!pliant_grow(&advance->region, (size_t)parts, sizeof *advance->region)) return false;
        advance->max_parts = parts;
    }
    return true;
}

static bool reserve_triangles(pliant_advance *advance, int32_t triangles)
{
    if (triangles > advance->max_triangles) {
        if (!pliant_grow(&advance->box, (size_t)triangles, sizeof *advance->box)) return false;
        if (!pliant_grow(&advance->near, (size_t)triangles, sizeof *advance->near)) return false;
        if (!pliant_grow(&advance->group, (size_t)triangles, sizeof *advance->group)) return false;
        advance->max_triangles = triangles;
    }
    return true;
}

static bool reserve_pair(pliant_advance *advance)
{
    return pliant_reserve(&advance->pair, &advance->max_pairs, advance->num_pairs, 256, sizeof *advance->pair);
}

pliant_status pliant_advance_reserve_times(pliant_advance *advance, int32_t count)
{
    if (count <= advance->max_pair_times) return PLIANT_OK;
    if (!pliant_grow(&advance->pair_time, (size_t)count, sizeof *advance->pair_time))
        return pliant_fail_memory("contact advance");
    advance->max_pair_times = count;
    return PLIANT_OK;
}

static bool comes_before(const pliant_advance_pair_time *a, const pliant_advance_pair_time *b)
{
    return a->t != b->t ? a->t < b->t : a->pair < b->pair;
}

/* Shell sort (Shell, A high-speed sorting procedure, Commun. ACM 2(7), 1959). */
void pliant_advance_sort(int32_t count, pliant_advance_pair_time *times)
{
    for (int32_t gap = count / 2; gap > 0; gap /= 2)
        for (int32_t i = gap; i < count; i++) {
            const pliant_advance_pair_time one = times[i];
            int32_t j = i;
            for (; j >= gap && comes_before(&one, times + j - gap); j -= gap) times[j] = times[j - gap];
            times[j] = one;
        }
}

/* ---- boxes */

static bool is_apart(const box *a, const double low[3], const double high[3], double margin)
{
    bool separated = false;
    for (int d = 0; d < 3; d++) separated = separated || a->low[d] > high[d] + margin || a->high[d] < low[d] - margin;
    return separated;
}

/* Half-spaces have no box; a triangle is near if its box is near the plane. */
static bool is_above(const box *a, const pliant_part *half_space, double margin)
{
    const double size = pliant_length3(half_space->to);
    double height = 0;
    for (int d = 0; d < 3; d++)
        height += half_space->to[d] / size * ((half_space->to[d] > 0 ? a->low[d] : a->high[d]) - half_space->from[d]);
    return height > margin;
}

static bool is_far(const pliant_advance_motion *motion, const box *a, double margin)
{
    if (motion->core.kind == PLIANT_PART_HALF_SPACE && !motion->leg->shape) return is_above(a, &motion->core, margin);
    return is_apart(a, motion->low, motion->high, margin);
}

/* Test a triangle's bounding sphere at the middle of an interval against the part there.
 * @param max_motion motion of both during half of the interval [m] */
static bool is_far_at(const pliant_advance_motion *motion, const pliant_advance_triangle *triangle, int at, double t,
                      double max_motion, double margin)
{
    double corner[3][3], middle[3], local[3], normal[3], square = 0;
    for (int c = 0; c < 3; c++)
        for (int d = 0; d < 3; d++) corner[c][d] = triangle->from[c][d] + t * triangle->rate[c][d];
    for (int d = 0; d < 3; d++) middle[d] = (corner[0][d] + corner[1][d] + corner[2][d]) / 3;
    for (int c = 0; c < 3; c++) {
        double offset[3];
        for (int d = 0; d < 3; d++) offset[d] = corner[c][d] - middle[d];
        square = pliant_advance_upper(square, pliant_dot3(offset, offset));
    }
    pliant_pose_from(&motion->at[at].pose, middle, local);
    return pliant_part_distance(&motion->core, local, normal) - sqrt(square) - max_motion > margin;
}

/* Test the whole leg at once, then in intervals. */
static bool stays_far(const pliant_advance_motion *motion, const int32_t node[3], const double *from, const double *to,
                      double margin)
{
    enum { INTERVALS = PLIANT_ADVANCE_INTERVALS };
    pliant_advance_triangle triangle;
    double square = 0;
    pliant_advance_triangle_init(node, from, to, &triangle);
    for (int c = 0; c < 3; c++) {
        double rate[3];
        for (int d = 0; d < 3; d++) rate[d] = triangle.rate[c][d] - motion->tip_rate[d];
        square = pliant_advance_upper(square, pliant_dot3(rate, rate));
    }
    const double speed = sqrt(square) + motion->speed;
    if (is_far_at(motion, &triangle, 0, 0.5, 0.5 * speed, margin)) return true;
    bool far = speed > 0;
    for (int n = 1; n <= INTERVALS && far; n++)
        far = is_far_at(motion, &triangle, n, (n - 0.5) / INTERVALS, 0.5 * speed / INTERVALS, margin);
    return far;
}

static bool is_held(const pliant_advance_part *part, const int32_t node[3])
{
    for (int c = 0; c < 3; c++) {
        int32_t first = 0, last = part->num_held;
        while (first < last) {
            const int32_t middle = first + (last - first) / 2;
            if (part->held[middle] < node[c])
                first = middle + 1;
            else
                last = middle;
        }
        if (first < part->num_held && part->held[first] == node[c]) return true;
    }
    return false;
}

/* ---- all */

enum { CHUNK = 1024 };

/* Filter for triangles: one box around all parts that have boxes, with its most selective axis first, and the
 * half-spaces. */
typedef struct reach {
    const pliant_advance *advance;
    box all;
    int axis[3];
    int32_t count;
    double margin;
} reach;

/* Return the box around all parts except half-spaces, enlarged by the margin. */
static box box_around(const pliant_advance *advance, int32_t first, int32_t end, double margin)
{
    box out = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (int32_t p = first; p < end; p++)
        for (int d = 0; d < 3 && advance->motion[p].core.kind != PLIANT_PART_HALF_SPACE; d++) {
            out.low[d] = pliant_advance_lower(out.low[d], advance->motion[p].low[d] - margin);
            out.high[d] = pliant_advance_upper(out.high[d], advance->motion[p].high[d] + margin);
        }
    return out;
}

static reach reach_of(const pliant_advance *advance, int32_t count, double margin)
{
    reach out = {.advance = advance,
                 .all = box_around(advance, 0, count, margin),
                 .axis = {0, 1, 2},
                 .count = count,
                 .margin = margin};
    for (int n = 0; n < 2; n++)
        for (int k = 0; k < 2; k++) {
            const int a = out.axis[k], b = out.axis[k + 1];
            if (out.all.high[a] - out.all.low[a] <= out.all.high[b] - out.all.low[b]) continue;
            out.axis[k] = b;
            out.axis[k + 1] = a;
        }
    return out;
}

/* Return whether all positions of a triangle are above or below the box on one axis. */
static bool is_outside_along(const reach *of, const int32_t node[3], const double *from, const double *to, int d)
{
    const double a = from[3 * (size_t)node[0] + (size_t)d], b = from[3 * (size_t)node[1] + (size_t)d],
                 c = from[3 * (size_t)node[2] + (size_t)d];
    const double e = to[3 * (size_t)node[0] + (size_t)d], f = to[3 * (size_t)node[1] + (size_t)d],
                 g = to[3 * (size_t)node[2] + (size_t)d];
    const double low = of->all.low[d], high = of->all.high[d];
    return ((a < low) & (b < low) & (c < low) & (e < low) & (f < low) & (g < low)) |
           ((a > high) & (b > high) & (c > high) & (e > high) & (f > high) & (g > high));
}

static bool is_near(const reach *of, const int32_t node[3], const double *from, const double *to, box *own)
{
    const bool separated = is_outside_along(of, node, from, to, of->axis[0]) ||
                           is_outside_along(of, node, from, to, of->axis[1]) ||
                           is_outside_along(of, node, from, to, of->axis[2]);
    bool near = !separated;
    if (near) *own = pliant_advance_box_of(3, node, from, to);
    for (int32_t p = 0; p < of->count && !near; p++) {
        if (of->advance->motion[p].core.kind != PLIANT_PART_HALF_SPACE) continue;
        *own = pliant_advance_box_of(3, node, from, to);
        near = !is_far(of->advance->motion + p, own, of->margin);
    }
    return near;
}

void pliant_near_limit_to_half_space(const pliant_part *half_space, double margin, pliant_near_region *region)
{
    const double size = pliant_length3(half_space->to);
    for (int d = 0; d < 3; d++) region->normal[d] = half_space->to[d] / size;
    region->offset = pliant_dot3(region->normal, half_space->from) + margin;
}

/* Return where the core of a part can touch triangles. */
static pliant_near_region region_of(const pliant_advance_motion *motion, double margin)
{
    pliant_near_region region = {.offset = INFINITY};
    for (int d = 0; d < 3; d++) {
        region.low[d] = motion->low[d] - margin;
        region.high[d] = motion->high[d] + margin;
    }
    if (motion->core.kind == PLIANT_PART_HALF_SPACE && !motion->leg->shape)
        pliant_near_limit_to_half_space(&motion->core, margin, &region);
    return region;
}

/* List the triangles that are near any part, ascending, with their boxes. */
static int32_t list_near(pliant_advance *advance, const pliant_triangle_list *list, const int32_t *triangles,
                         const double *from, const double *to, int32_t count, double margin, int num_threads)
{
    const reach of = reach_of(advance, count, margin);
    const int32_t chunks = (list->count + CHUNK - 1) / CHUNK;
#pragma omp parallel for schedule(static) num_threads(num_threads) if (num_threads > 1 && chunks > 4)
    for (int32_t chunk = 0; chunk < chunks; chunk++) {
        int32_t put = chunk * CHUNK;
        const int32_t end = put + CHUNK < list->count ? put + CHUNK : list->count;
        for (int32_t n = put; n < end; n++) {
            const int32_t t = pliant_triangle_at(list, n);
            if (is_near(&of, triangles + 3 * (size_t)t, from, to, advance->box + put)) advance->near[put++] = t;
        }
        if (put < end) advance->near[put] = -1;
    }
    int32_t found = 0;
    for (int32_t chunk = 0; chunk < chunks; chunk++)
        for (int32_t n = chunk * CHUNK; n < list->count && n < (chunk + 1) * CHUNK && advance->near[n] >= 0; n++) {
            advance->box[found] = advance->box[n];
            advance->near[found++] = advance->near[n];
        }
    return found;
}

/* List the triangles near the parts from first to end, which are parts of one tool. Return their number. */
static int32_t list_group(pliant_advance *advance, int32_t found, int32_t first, int32_t end, double margin)
{
    const box around = box_around(advance, first, end, margin);
    const bool all = advance->motion[first].core.kind == PLIANT_PART_HALF_SPACE;
    int32_t count = 0;
    for (int32_t n = 0; n < found; n++)
        if (all || !is_apart(advance->box + n, around.low, around.high, 0)) advance->group[count++] = n;
    return count;
}

pliant_status pliant_advance_broad_phase(pliant_advance *advance, int32_t num_triangles, const int32_t *triangles,
                                         const double *from, const double *to, int32_t count,
                                         const pliant_advance_part *parts, double margin, bool still, int num_threads,
                                         const pliant_near_finder *finder)
{
    int32_t end = 0, grouped = 0;
    advance->num_pairs = 0;
    if (count == 0 || num_triangles == 0) return PLIANT_OK;
    if (!reserve_parts(advance, count)) return pliant_fail_memory("contact advance");
    for (int32_t p = 0; p < count; p++) {
        pliant_advance_motion_init(parts + p, still, advance->motion + p);
        advance->region[p] = region_of(advance->motion + p, margin);
    }
    const pliant_triangle_list list = pliant_near_find(finder, num_triangles, count, advance->region);
    if (!reserve_triangles(advance, list.count)) return pliant_fail_memory("contact advance");
    const int32_t found = list_near(advance, &list, triangles, from, to, count, margin, num_threads);
    for (int32_t p = 0; p < count; p++) {
        if (p == end) {
            for (end = p + 1; end < count && parts[p].shape && parts[end].shape == parts[p].shape; end++) {}
            grouped = list_group(advance, found, p, end, margin);
        }
        for (int32_t k = 0; k < grouped; k++) {
            const int32_t n = advance->group[k], t = advance->near[n], *node = triangles + 3 * (size_t)t;
            if (is_far(advance->motion + p, advance->box + n, margin) || is_held(parts + p, node) ||
                stays_far(advance->motion + p, node, from, to, margin))
                continue;
            if (!reserve_pair(advance)) return pliant_fail_memory("contact advance");
            advance->pair[advance->num_pairs++] =
                (pliant_advance_pair){.part = p, .triangle = t, .weight = {1.0 / 3, 1.0 / 3, 1.0 / 3}};
        }
    }
    return PLIANT_OK;
}
