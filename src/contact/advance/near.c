#include "contact/advance/near.h"

#include "base/fail.h"
#include "contact/advance/advance_rules.h"
#include "pliant/memory.h"

#include <math.h>
#include <string.h>

typedef struct box { double low[3], high[3]; } box;

/* ---- buffers */

static bool grow(void *array, int32_t count, size_t size)
{
    void **block = array;
    void *made = *block ? pliant_resize(*block, (size_t)count, size) : pliant_calloc((size_t)count, size);
    if (made) *block = made;
    return made != NULL;
}

static bool reserve(pliant_advance *room, int32_t triangles, int32_t parts)
{
    if (parts > room->max_parts) {
        if (!grow(&room->motion, parts, sizeof *room->motion)) return false;
        room->max_parts = parts;
    }
    if (triangles > room->max_triangles) {
        if (!grow(&room->is_near, triangles, sizeof *room->is_near)) return false;
        if (!grow(&room->near, triangles, sizeof *room->near)) return false;
        room->max_triangles = triangles;
    }
    return true;
}

static bool reserve_pair(pliant_advance *room)
{
    enum { FIRST = 256 };
    if (room->num_pairs < room->max_pairs) return true;
    const int32_t count = room->max_pairs > 0 ? 2 * room->max_pairs : FIRST;
    if (!grow(&room->pair, count, sizeof *room->pair)) return false;
    if (!grow(&room->order, count, sizeof *room->order)) return false;
    room->max_pairs = count;
    return true;
}

/* ---- boxes */

static box box_of(const int32_t node[3], const double *from, const double *to)
{
    box out = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (int c = 0; c < 3; c++)
        for (int d = 0; d < 3; d++) {
            const double a = from[3 * (size_t)node[c] + (size_t)d], b = to[3 * (size_t)node[c] + (size_t)d];
            out.low[d] = fmin(out.low[d], fmin(a, b));
            out.high[d] = fmax(out.high[d], fmax(a, b));
        }
    return out;
}

static bool is_apart(const box *a, const double low[3], const double high[3], double margin)
{
    bool apart = false;
    for (int d = 0; d < 3; d++) apart = apart || a->low[d] > high[d] + margin || a->high[d] < low[d] - margin;
    return apart;
}

/* Half-spaces have no box: a triangle is near if its box is. */
static bool is_above(const box *a, const pliant_part *half_space, double margin)
{
    const double size = pliant_advance_length(half_space->to);
    double height = 0;
    for (int d = 0; d < 3; d++) height += half_space->to[d] / size * ((half_space->to[d] > 0 ? a->low[d] : a->high[d]) - half_space->from[d]);
    return height > margin;
}

static bool is_far(const pliant_advance_motion *motion, const box *a, double margin)
{
    if (motion->core.kind == PLIANT_PART_HALF_SPACE && !motion->leg->shape) return is_above(a, &motion->core, margin);
    return is_apart(a, motion->low, motion->high, margin);
}

/* The whole leg in intervals: a triangle's ball around its middle, against the part at the interval's middle. */
static bool stays_far(const pliant_advance_motion *motion, const int32_t node[3], const double *from, const double *to, double margin)
{
    enum { INTERVALS = 4 };
    const double reach = motion->turn > 0 || motion->jaw != 0 ? motion->turn * motion->reach + fabs(motion->jaw) * motion->jaw_reach : 0;
    pliant_advance_triangle triangle;
    double fastest = 0;
    pliant_advance_triangle_init(node, from, to, &triangle);
    for (int c = 0; c < 3; c++) {
        double rate[3];
        for (int d = 0; d < 3; d++) rate[d] = triangle.rate[c][d] - motion->tip_rate[d];
        fastest = fmax(fastest, pliant_advance_length(rate) + reach);
    }
    const int count = fastest > 0 ? INTERVALS : 1;
    for (int n = 0; n < count; n++) {
        const double t = (n + 0.5) / count;
        double at[3][3], middle[3], local[3], normal[3], radius = 0;
        pliant_advance_state state;
        for (int c = 0; c < 3; c++)
            for (int d = 0; d < 3; d++) at[c][d] = triangle.from[c][d] + t * triangle.rate[c][d];
        for (int d = 0; d < 3; d++) middle[d] = (at[0][d] + at[1][d] + at[2][d]) / 3;
        for (int c = 0; c < 3; c++) {
            double apart[3];
            for (int d = 0; d < 3; d++) apart[d] = at[c][d] - middle[d];
            radius = fmax(radius, pliant_advance_length(apart));
        }
        pliant_advance_motion_at(motion, t, &state);
        pliant_pose_from(&state.pose, middle, local);
        if (pliant_part_distance(&motion->core, local, normal) - radius - 0.5 * fastest / count <= margin) return false;
    }
    return true;
}

static bool is_held(const pliant_advance_part *part, const int32_t node[3])
{
    for (int c = 0; c < 3; c++) {
        int32_t first = 0, last = part->num_held;
        while (first < last) {
            const int32_t middle = first + (last - first) / 2;
            if (part->held[middle] < node[c]) first = middle + 1;
            else last = middle;
        }
        if (first < part->num_held && part->held[first] == node[c]) return true;
    }
    return false;
}

/* ---- all */

/* Triangles that are near one box around all parts, or near a half-space. */
static int32_t list_near(pliant_advance *room, int32_t num_triangles, const int32_t *triangles, const double *from, const double *to, int32_t count, double margin,
                         int num_threads)
{
    box all = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (int32_t p = 0; p < count; p++)
        for (int d = 0; d < 3 && room->motion[p].core.kind != PLIANT_PART_HALF_SPACE; d++) {
            all.low[d] = fmin(all.low[d], room->motion[p].low[d]);
            all.high[d] = fmax(all.high[d], room->motion[p].high[d]);
        }
#pragma omp parallel for schedule(static) num_threads(num_threads)
    for (int32_t t = 0; t < num_triangles; t++) {
        const box own = box_of(triangles + 3 * (size_t)t, from, to);
        bool near = !is_apart(&own, all.low, all.high, margin);
        for (int32_t p = 0; p < count && !near; p++)
            near = room->motion[p].core.kind == PLIANT_PART_HALF_SPACE && !is_far(room->motion + p, &own, margin);
        room->is_near[t] = near;
    }
    int32_t found = 0;
    for (int32_t t = 0; t < num_triangles; t++)
        if (room->is_near[t]) room->near[found++] = t;
    return found;
}

pliant_status pliant_advance_near(pliant_advance *room, int32_t num_triangles, const int32_t *triangles, const double *from, const double *to,
                                  int32_t count, const pliant_advance_part *parts, double margin, bool still, int num_threads)
{
    room->num_pairs = 0;
    if (count == 0 || num_triangles == 0) return PLIANT_OK;
    if (!reserve(room, num_triangles, count)) return pliant_fail_memory("contact advance");
    for (int32_t p = 0; p < count; p++) pliant_advance_motion_init(parts + p, still, room->motion + p);
    const int32_t found = list_near(room, num_triangles, triangles, from, to, count, margin, num_threads);
    for (int32_t p = 0; p < count; p++)
        for (int32_t n = 0; n < found; n++) {
            const int32_t t = room->near[n], *node = triangles + 3 * (size_t)t;
            const box own = box_of(node, from, to);
            if (is_far(room->motion + p, &own, margin) || is_held(parts + p, node) || stays_far(room->motion + p, node, from, to, margin)) continue;
            if (!reserve_pair(room)) return pliant_fail_memory("contact advance");
            room->pair[room->num_pairs++] = (pliant_advance_pair){.part = p, .triangle = t, .weight = {1.0 / 3, 1.0 / 3, 1.0 / 3}};
        }
    return PLIANT_OK;
}
