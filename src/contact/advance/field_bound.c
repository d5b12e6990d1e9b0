/* Lower bounds of a distance field in a box. The field lies above a plane that is lowered until no point of the box
 * is below it. The tested points are the grid's points in the box and the intersections of its lines and planes
 * with the box's sides. They suffice because field and plane are trilinear between them. Where the solid is flat,
 * the bound is sharp in all directions, so sliding along it is not slowed. At a minimum where cells of the field meet
 * at an angle, a plane parallel to the triangle is sharp. Elsewhere the triangle and the time are split. Outside the
 * grid the distance is Lipschitz continuous (Piyavskii, USSR Comp. Math. Math. Phys. 12:57, 1972). */
#include "contact/advance/field_bound.h"

#include "contact/advance/advance_rules.h"
#include "contact/shapes/solid.h"

#include <string.h>

enum {
    DEEPEST = 13,
    MAX_HALVINGS = 16,
    MAX_OPEN = 3 * DEEPEST + MAX_HALVINGS + 4,
    MAX_PIECES = 20000,
    MAX_ALONG = 5 /* points along an axis */
};
static const double enough = 0.9;         /* fraction of the lowest distance found */
static const double smallest = 1e-4;      /* fraction of a cell: smaller distances are not resolved */
static const double close_time = 0.02;    /* fraction of the gained time: times that differ by less count as equal */
static const double close_start = 1e-5;   /* additional tolerance, as a fraction of a leg */

/* A piece of the triangle, by the weights of its corners, during a part of the time. */
typedef struct piece {
    double weight[3][3], begin, end;
    int level, halvings;
} piece;

/* The region that a piece covers in the part's frame. */
typedef struct region {
    double at[2][3][3]; /* corners at both ends of the time; in between they leave their chord by at most the bulge */
    double low[3], high[3], bulge;
    double middle[3], radius; /* bounding sphere */
    double size, motion;      /* extent of the triangle; distance of its motion [m] */
} region;

static region region_of(const piece *of, const double begin[3][3], const double end[3][3], double bulge)
{
    region out = {.bulge = bulge, .motion = bulge};
    for (int d = 0; d < 3; d++) {
        double side[2][2] = {{INFINITY, -INFINITY}, {INFINITY, -INFINITY}};
        for (int k = 0; k < 3; k++) {
            for (int n = 0; n < 2; n++) {
                double value = 0;
                for (int c = 0; c < 3; c++) value += of->weight[k][c] * (n == 0 ? begin : end)[c][d];
                out.at[n][k][d] = value;
                side[n][0] = fmin(side[n][0], value);
                side[n][1] = fmax(side[n][1], value);
            }
            out.motion = fmax(out.motion, fabs(out.at[1][k][d] - out.at[0][k][d]));
        }
        out.size = fmax(out.size, fmax(side[0][1] - side[0][0], side[1][1] - side[1][0]));
        out.low[d] = fmin(side[0][0], side[1][0]) - bulge;
        out.high[d] = fmax(side[0][1], side[1][1]) + bulge;
        out.middle[d] = 0.5 * (out.low[d] + out.high[d]);
    }
    for (int n = 0; n < 6; n++) {
        double offset[3];
        for (int d = 0; d < 3; d++) offset[d] = out.at[n / 3][n % 3][d] - out.middle[d];
        out.radius = fmax(out.radius, pliant_length3(offset));
    }
    out.radius += bulge;
    return out;
}

static bool is_inside_grid(const pliant_part *core, const double p[3])
{
    bool inside = true;
    for (int d = 0; d < 3; d++) {
        const double at = (p[d] - core->from[d] - core->solid->origin[d]) / core->solid->cell;
        inside = inside && at >= 0 && at <= core->solid->size[d] - 1;
    }
    return inside;
}

/* Lower bound of the distance in the bounding sphere, from the distance at its center. */
static double look_along_motion(const pliant_part *core, const region *of, double distance)
{
    return distance - (is_inside_grid(core, of->middle) ? PLIANT_FIELD_SLOPE : 1) * of->radius;
}

/* List the coordinates of a box along an axis: its ends and the grid points between them, clipped to the grid.
 * Return 0 if there are too many, or if the box is outside the grid. */
static int list_along(const pliant_part *core, const region *of, int d, double out[MAX_ALONG])
{
    const pliant_solid *solid = core->solid;
    const double origin = solid->origin[d] + core->from[d], last = origin + solid->cell * (solid->size[d] - 1);
    const double low = fmax(of->low[d], origin), high = fmin(of->high[d], last);
    int count = 0;
    if (low > high) return 0;
    out[count++] = low;
    for (double k = floor((low - origin) / solid->cell) + 1; origin + solid->cell * k < high; k++) {
        if (count == MAX_ALONG - 1) return 0;
        out[count++] = origin + solid->cell * k;
    }
    if (high > low) out[count++] = high;
    return count;
}

/* Return the field's value at a point of its grid: the part's distance without its gradient. */
static double value_at(const pliant_part *core, const double p[3])
{
    const pliant_solid *solid = core->solid;
    const size_t stride[3] = {1, (size_t)solid->size[0], (size_t)solid->size[0] * (size_t)solid->size[1]};
    const float *value = solid->value;
    double fraction[3];
    for (int d = 0; d < 3; d++) {
        const double at = (p[d] - core->from[d] - solid->origin[d]) / solid->cell;
        const int32_t last = solid->size[d] - 2, cell = at > 0 ? at < last ? (int32_t)at : last : 0;
        fraction[d] = at - cell;
        value += (size_t)cell * stride[d];
    }
    double plane[2];
    for (int k = 0; k < 2; k++) {
        const float *row = value + (k == 1 ? stride[2] : 0), *next = row + stride[1];
        const double low = (double)row[0] + fraction[0] * ((double)row[1] - (double)row[0]);
        const double high = (double)next[0] + fraction[0] * ((double)next[1] - (double)next[0]);
        plane[k] = low + fraction[1] * (high - low);
    }
    return plane[0] + fraction[2] * (plane[1] - plane[0]) - core->radius;
}

/* Values of the field in a box, and their coordinates along each axis. */
typedef struct samples {
    double along[3][MAX_ALONG], value[MAX_ALONG * MAX_ALONG * MAX_ALONG];
    int count[3];
} samples;

/* A plane below the distance: normal . (p - middle) + height is at most the distance at each p of the box that lies in
 * the grid. */
typedef struct plane { double normal[3], height; } plane;

/* Return false if the box is too large, or not in the grid. */
static bool take_samples(const pliant_part *core, const region *of, samples *out)
{
    double p[3], *value = out->value;
    for (int d = 0; d < 3; d++)
        if ((out->count[d] = list_along(core, of, d, out->along[d])) == 0) return false;
    for (int k = 0; k < out->count[2]; k++)
        for (int j = 0; j < out->count[1]; j++)
            for (int i = 0; i < out->count[0]; i++) {
                p[0] = out->along[0][i];
                p[1] = out->along[1][j];
                p[2] = out->along[2][k];
                *value++ = value_at(core, p);
            }
    return true;
}

/* Set the height of a plane. Return the distance along a direction from the middle to the sample that limits it. */
static double lower_plane(const samples *all, const region *of, const double direction[3], plane *out)
{
    const double *value = all->value;
    double offset[3], at = 0;
    out->height = INFINITY;
    for (int k = 0; k < all->count[2]; k++)
        for (int j = 0; j < all->count[1]; j++)
            for (int i = 0; i < all->count[0]; i++, value++) {
                offset[0] = all->along[0][i] - of->middle[0];
                offset[1] = all->along[1][j] - of->middle[1];
                offset[2] = all->along[2][k] - of->middle[2];
                const double height = *value - pliant_dot3(out->normal, offset);
                if (!(height < out->height)) continue;
                out->height = height;
                at = pliant_dot3(direction, offset);
            }
    return at;
}

static double height_of(const plane *of, const region *around, const double p[3])
{
    const double *n = of->normal, *m = around->middle;
    return of->height + n[0] * (p[0] - m[0]) + n[1] * (p[1] - m[1]) + n[2] * (p[2] - m[2]);
}

/* Find the plane parallel to the piece that bounds the distance best. At the minimum of a convex function on a
 * triangle, some subgradient is normal to the triangle (contact/shapes/nearest_point.c). Therefore this plane is sharp
 * where cells of the field meet at an angle, and the plane by the gradient is not. The bound is concave in the slope of
 * the plane, and piecewise linear. */
static void find_parallel_plane(const samples *all, const region *of, const double gradient[3], plane *out)
{
    enum { MAX_STEPS = 6 };
    double side[2][3], own[3];
    for (int d = 0; d < 3; d++) {
        side[0][d] = of->at[0][1][d] - of->at[0][0][d];
        side[1][d] = of->at[0][2][d] - of->at[0][0][d];
    }
    pliant_cross3(side[0], side[1], own);
    const double size = pliant_length3(own);
    *out = (plane){.height = -INFINITY};
    if (!(size > 0)) return;
    for (int d = 0; d < 3; d++) own[d] /= size;
    const double level = own[0] * (of->at[0][0][0] - of->middle[0]) + own[1] * (of->at[0][0][1] - of->middle[1]) +
                         own[2] * (of->at[0][0][2] - of->middle[2]);
    double slope = pliant_dot3(own, gradient), bound[2], rate[2] = {0, 0}, at[2] = {-1, 1}, best = -INFINITY;
    for (int step = 0; step < MAX_STEPS; step++) {
        plane trial;
        for (int d = 0; d < 3; d++) trial.normal[d] = slope * own[d];
        const double rise = level - lower_plane(all, of, own, &trial), value = trial.height + slope * level;
        if (value > best) best = value, *out = trial;
        const int end = rise < 0;
        bound[end] = value;
        rate[end] = rise;
        at[end] = slope;
        if (rise == 0) return;
        slope = rate[0] == 0 || rate[1] == 0
                    ? at[!end]
                    : (bound[0] - bound[1] - rate[0] * at[0] + rate[1] * at[1]) / (rate[1] - rate[0]);
        if (!(slope > at[0] && slope < at[1]) && rate[0] != 0 && rate[1] != 0) return;
    }
}

/* Find one of two planes: by the gradient, or parallel to the piece. */
static void bound_from_below(const samples *all, const region *of, const double gradient[3], bool is_parallel,
                             plane *out)
{
    if (is_parallel) {
        find_parallel_plane(all, of, gradient, out);
        return;
    }
    memcpy(out->normal, gradient, sizeof out->normal);
    (void)lower_plane(all, of, gradient, out);
}

/* Return the first fraction of the motion at which a height may reach 0. begin and end are its values at both ends;
 * it lies below its chord by at most 4 bulge s (1 - s). */
static double first_zero(double begin, double end, double bulge)
{
    const double slope = end - begin - 4 * bulge, lowest = bulge > 0 ? -slope / (8 * bulge) : -1;
    if (begin <= 0) return 0;
    if (end >= 0 && (!(lowest > 0 && lowest < 1) || begin - slope * slope / (16 * bulge) >= 0)) return 1;
    return slope < 0 ? fmin(begin / -slope, 1) : 1;
}

/* Split a triangle into 4 by the middles of its edges. */
static int split(const piece *of, piece *out)
{
    double middle[3][3];
    for (int k = 0; k < 3; k++)
        for (int c = 0; c < 3; c++) middle[k][c] = 0.5 * (of->weight[k][c] + of->weight[(k + 1) % 3][c]);
    for (int n = 0; n < 4; n++) {
        out[n] = *of;
        out[n].level++;
        for (int k = 0; k < 3; k++) /* corner n stays; the others are the middles of its edges */
            if (n == 3 || k != n)
                memcpy(out[n].weight[k], middle[n == 3 || (k + 1) % 3 == n ? k : n], sizeof middle[0]);
    }
    return 4;
}

/* Halve the time. The first half is visited first. */
static int halve(const piece *of, piece *out)
{
    out[0] = out[1] = *of;
    out[0].begin = out[1].end = 0.5 * (of->begin + of->end);
    out[0].halvings = ++out[1].halvings;
    return 2;
}

static const piece whole = {.weight = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, .begin = 0, .end = 1};

double pliant_field_minimum(const pliant_part *core, const double corner[3][3], double far)
{
    piece stack[MAX_OPEN];
    samples all;
    double lowest = INFINITY, bound = INFINITY;
    int depth = 0, pieces = 0;
    for (stack[depth++] = whole; depth > 0; pieces++) {
        const piece of = stack[--depth];
        const region around = region_of(&of, corner, corner, 0);
        double normal[3], own[3], middle[3];
        for (int d = 0; d < 3; d++) middle[d] = (around.at[0][0][d] + around.at[0][1][d] + around.at[0][2][d]) / 3;
        const double distance = pliant_part_distance(core, around.middle, normal);
        double minimum = look_along_motion(core, &around, distance);
        lowest = fmin(lowest, pliant_part_distance(core, middle, own));
        if (lowest <= 0) return lowest;
        const double wanted = fmin(enough * lowest - smallest * core->solid->cell, far);
        if (minimum < wanted && take_samples(core, &around, &all)) {
            for (int n = 0; n < 2 && minimum < wanted; n++) {
                double by_plane = INFINITY;
                plane below;
                bound_from_below(&all, &around, normal, n == 1, &below);
                for (int k = 0; k < 3; k++) by_plane = fmin(by_plane, height_of(&below, &around, around.at[0][k]));
                minimum = fmax(minimum, by_plane);
            }
        }
        if (minimum >= wanted || of.level == DEEPEST || pieces > MAX_PIECES)
            bound = fmin(bound, minimum);
        else
            depth += split(&of, stack + depth);
    }
    return fmin(bound, lowest);
}

/* ---- motion */

/* Return a bound of a corner's acceleration in the part's frame from a time on. The tool's angular velocity w gives
 * w x (w x z) - 2 w x (x' - tip'), with z from the tip. The jaw's turn adds the same terms, with z from the joint
 * and with the remaining velocity and acceleration. */
static double bend_of(const pliant_advance_motion *motion, const pliant_advance_triangle *triangle, double t)
{
    const double turn = motion->turn, jaw = fabs(motion->jaw), left = 1 - t;
    pliant_advance_state state;
    double bend = 0;
    pliant_advance_motion_at(motion, t, &state);
    for (int c = 0; c < 3 && !motion->still; c++) {
        double rate[3], from_tip[3], from_joint[3];
        for (int d = 0; d < 3; d++) {
            const double at = triangle->from[c][d] + t * triangle->rate[c][d];
            rate[d] = triangle->rate[c][d] - motion->tip_rate[d];
            from_tip[d] = at - state.tip[d];
            from_joint[d] = at - state.joint[d];
        }
        const double fast = pliant_length3(rate), far = pliant_length3(from_tip) + left * fast;
        const double in_tool = turn * far + fast, far_from_joint = pliant_length3(from_joint) + left * in_tool;
        bend = fmax(bend, turn * (turn * far + 2 * fast) + jaw * (jaw * far_from_joint + 2 * in_tool));
    }
    return bend;
}

static void corners_at(const pliant_advance_motion *motion, const pliant_advance_triangle *triangle, double t,
                       double out[3][3])
{
    pliant_advance_state state;
    pliant_advance_motion_at(motion, t, &state);
    for (int c = 0; c < 3; c++) {
        double at[3];
        for (int d = 0; d < 3; d++) at[d] = triangle->from[c][d] + t * triangle->rate[c][d];
        pliant_pose_from(&state.pose, at, out[c]);
    }
}

/* Return the fraction of a piece's time that is certainly free. */
static double look_at(const pliant_part *core, const region *around, double limit)
{
    double normal[3], best = 0;
    samples all;
    const double distance = pliant_part_distance(core, around->middle, normal);
    if (look_along_motion(core, around, distance) >= limit) return 1;
    if (!take_samples(core, around, &all)) return 0;
    for (int n = 0; n < 2 && best < 1; n++) {
        double reached = 1;
        plane below;
        bound_from_below(&all, around, normal, n == 1, &below);
        for (int k = 0; k < 3; k++)
            reached = fmin(reached, first_zero(height_of(&below, around, around->at[0][k]) - limit,
                                               height_of(&below, around, around->at[1][k]) - limit, around->bulge));
        best = fmax(best, reached);
    }
    return best;
}

double pliant_field_free_time(const pliant_advance_motion *motion, const pliant_advance_triangle *triangle, double t,
                              double limit)
{
    const double bend = bend_of(motion, triangle, t);
    piece stack[MAX_OPEN];
    double best = 1, corner[2][3][3], known[2] = {-1, -1};
    int depth = 0, pieces = 0;
    stack[depth] = whole;
    for (stack[depth++].begin = t; depth > 0; pieces++) {
        const piece of = stack[--depth];
        if (of.begin >= best) continue;
        for (int n = 0; n < 2; n++) {
            const double time = n == 0 ? of.begin : of.end;
            if (time != known[n]) corners_at(motion, triangle, time, corner[n]);
            known[n] = time;
        }
        const double duration = of.end - of.begin;
        const region around = region_of(&of, (const double(*)[3])corner[0], (const double(*)[3])corner[1],
                                        bend * duration * duration / 8);
        const double reached = look_at(&motion->core, &around, limit), time = of.begin + reached * duration;
        if (reached >= 1 || time >= best) continue;
        const bool splits = of.level < DEEPEST, halves = of.halvings < MAX_HALVINGS;
        if ((!splits && !halves) || pieces > MAX_PIECES ||
            fmin(of.end, best) - time <= close_time * (time - t) + close_start)
            best = time;
        else
            depth += halves && (!splits || around.motion > around.size) ? halve(&of, stack + depth)
                                                                        : split(&of, stack + depth);
    }
    return best;
}
