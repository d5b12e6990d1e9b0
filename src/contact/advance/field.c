/* In a box of the field's cells the field lies above a plane, lowered until no grid point of the box is below it: between grid points the field is
 * trilinear, and so is the plane. Where the solid is flat that bound is sharp in all directions, so sliding along it costs nothing. Where it is not, or
 * the box is large, the triangle is split. Outside the grid the distance changes by at most the way (Piyavskii, USSR Comp. Math. Math. Phys. 12:57, 1972). */
#include "contact/advance/field.h"

#include "contact/advance/advance_rules.h"
#include "contact/shapes/shapes.h"
#include "contact/shapes/solid.h"

#include <string.h>

enum { DEEPEST = 10, MOST_OPEN = 3 * DEEPEST + 4, MOST_PIECES = 20000, MOST_POINTS = 1000, FINE = 4 /* grid points along an axis */ };
static const double steepest = 1.7320508;   /* slope of a field between its points: at most 1 along each axis */
static const double enough = 0.9;           /* of the lowest distance found */
static const double smallest = 1e-4;        /* of a cell: nearer distances are not resolved */

/* A part of the triangle that moves. */
typedef struct piece {
    double from[3][3], to[3][3];
    int level;
} piece;

/* A piece's box in grid points, and its ball. */
typedef struct region {
    int32_t low[3], high[3];
    bool in_grid;             /* the box meets the grid */
    int64_t points, longest;  /* grid points in it, and along its longest axis */
    double middle[3], radius; /* of the ball */
    double size, way;         /* extent of the triangle, of its motion [m] */
} region;

static region region_of(const pliant_part *core, const piece *of, double bulge)
{
    const pliant_solid *solid = core->solid;
    region out = {.in_grid = true, .points = 1};
    for (int d = 0; d < 3; d++) {
        double low = INFINITY, high = -INFINITY, sides[2][2] = {{INFINITY, -INFINITY}, {INFINITY, -INFINITY}};
        for (int k = 0; k < 3; k++) {
            low = fmin(low, fmin(of->from[k][d], of->to[k][d]));
            high = fmax(high, fmax(of->from[k][d], of->to[k][d]));
            sides[0][0] = fmin(sides[0][0], of->from[k][d]);
            sides[0][1] = fmax(sides[0][1], of->from[k][d]);
            sides[1][0] = fmin(sides[1][0], of->to[k][d]);
            sides[1][1] = fmax(sides[1][1], of->to[k][d]);
            out.way = fmax(out.way, fabs(of->to[k][d] - of->from[k][d]));
        }
        out.size = fmax(out.size, fmax(sides[0][1] - sides[0][0], sides[1][1] - sides[1][0]));
        out.middle[d] = 0.5 * (low + high);
        const double origin = solid->origin[d] + core->from[d], last = solid->size[d] - 1;
        const double first = floor((low - bulge - origin) / solid->cell), end = ceil((high + bulge - origin) / solid->cell);
        out.in_grid = out.in_grid && first <= last && end >= 0;
        out.low[d] = (int32_t)fmin(fmax(first, 0), last);
        out.high[d] = (int32_t)fmin(fmax(end, 0), last);
        out.points *= out.high[d] - out.low[d] + 1;
        out.longest = out.high[d] - out.low[d] + 1 > out.longest ? out.high[d] - out.low[d] + 1 : out.longest;
    }
    for (int n = 0; n < 6; n++) {
        double apart[3];
        for (int d = 0; d < 3; d++) apart[d] = (n < 3 ? of->from[n] : of->to[n - 3])[d] - out.middle[d];
        out.radius = fmax(out.radius, pliant_advance_length(apart));
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

/* Lower bound of the distance in the ball: by the way from its middle. */
static double by_way(const pliant_part *core, const region *of, double distance)
{
    return distance - (is_inside_grid(core, of->middle) ? steepest : 1) * of->radius;
}

/* The plane normal . (p - middle) + the result is below the field in the box. */
static double lower_plane(const pliant_part *core, const region *of, const double normal[3])
{
    const pliant_solid *solid = core->solid;
    double least = INFINITY;
    for (int32_t k = of->low[2]; k <= of->high[2]; k++)
        for (int32_t j = of->low[1]; j <= of->high[1]; j++) {
            const float *value = solid->value + ((size_t)k * (size_t)solid->size[1] + (size_t)j) * (size_t)solid->size[0];
            double height = 0;
            const double at[3] = {solid->origin[0], solid->origin[1] + solid->cell * j, solid->origin[2] + solid->cell * k};
            for (int d = 0; d < 3; d++) height += normal[d] * (at[d] + core->from[d] - of->middle[d]);
            for (int32_t i = of->low[0]; i <= of->high[0]; i++) least = fmin(least, (double)value[i] - height - normal[0] * solid->cell * i);
        }
    return least - core->radius;
}

/* The first fraction of a way at which a height falls to 0: it is begin and end at the ends, and lies below its chord by at most 4 bulge s (1 - s). */
static double first_zero(double begin, double end, double bulge)
{
    const double slope = end - begin - 4 * bulge, lowest = bulge > 0 ? -slope / (8 * bulge) : -1;
    if (begin <= 0) return 0;
    if (end >= 0 && (!(lowest > 0 && lowest < 1) || begin - slope * slope / (16 * bulge) >= 0)) return 1;
    return slope < 0 ? fmin(begin / -slope, 1) : 1;
}

static double height_of(const double normal[3], const double p[3], const double middle[3])
{
    return normal[0] * (p[0] - middle[0]) + normal[1] * (p[1] - middle[1]) + normal[2] * (p[2] - middle[2]);
}

/* in 4, by the middles of its edges */
static void split(const piece *of, piece *out)
{
    piece middle;
    for (int k = 0; k < 3; k++)
        for (int d = 0; d < 3; d++) {
            middle.from[k][d] = 0.5 * (of->from[k][d] + of->from[(k + 1) % 3][d]);
            middle.to[k][d] = 0.5 * (of->to[k][d] + of->to[(k + 1) % 3][d]);
        }
    for (int n = 0; n < 4; n++) {
        out[n].level = of->level + 1;
        for (int k = 0; k < 3; k++) { /* corner n stays; the others are the middles of its edges */
            const bool stays = k == n;
            const int edge = n == 3 ? k : (k + 1) % 3 == n ? k : n;
            memcpy(out[n].from[k], stays ? of->from[k] : middle.from[edge], sizeof out[n].from[k]);
            memcpy(out[n].to[k], stays ? of->to[k] : middle.to[edge], sizeof out[n].to[k]);
        }
    }
}

static piece whole(const double from[3][3], const double to[3][3])
{
    piece out = {.level = 0};
    memcpy(out.from, from, sizeof out.from);
    memcpy(out.to, to, sizeof out.to);
    return out;
}

double pliant_field_least(const pliant_part *core, const double corner[3][3], int64_t *distances)
{
    piece stack[MOST_OPEN];
    double lowest = INFINITY, bound = INFINITY;
    int depth = 0, pieces = 0;
    for (stack[depth++] = whole(corner, corner); depth > 0;) {
        const piece of = stack[--depth];
        const region around = region_of(core, &of, 0);
        double normal[3];
        const double distance = pliant_part_distance(core, around.middle, normal);
        double least = by_way(core, &around, distance), middle[3];
        for (int d = 0; d < 3; d++) middle[d] = (of.from[0][d] + of.from[1][d] + of.from[2][d]) / 3;
        *distances += 2;
        pieces++;
        double own[3];
        lowest = fmin(lowest, pliant_part_distance(core, middle, own));
        if (lowest <= 0) return lowest;
        const double wanted = enough * lowest - smallest * core->solid->cell;
        if (least < wanted && around.in_grid && around.points <= MOST_POINTS) {
            const double plane = lower_plane(core, &around, normal);
            double by_plane = INFINITY;
            for (int k = 0; k < 3; k++) by_plane = fmin(by_plane, plane + height_of(normal, of.from[k], around.middle));
            least = fmax(least, by_plane);
        }
        if (least >= wanted || of.level == DEEPEST || pieces > MOST_PIECES) bound = fmin(bound, least);
        else {
            split(&of, stack + depth);
            depth += 4;
        }
    }
    return fmin(bound, lowest);
}

double pliant_field_free(const pliant_part *core, const double from[3][3], const double to[3][3], double bulge, double limit, int64_t *distances)
{
    piece stack[MOST_OPEN];
    double best = 1;
    int depth = 0, pieces = 0;
    for (stack[depth++] = whole(from, to); depth > 0 && best > 0;) {
        const piece of = stack[--depth];
        const region around = region_of(core, &of, bulge);
        double normal[3], reached = 0;
        const double distance = pliant_part_distance(core, around.middle, normal);
        ++*distances;
        pieces++;
        if (by_way(core, &around, distance) >= limit) continue;
        if (around.in_grid && around.points <= MOST_POINTS) {
            const double plane = lower_plane(core, &around, normal);
            reached = 1;
            for (int k = 0; k < 3; k++) {
                const double begin = plane + height_of(normal, of.from[k], around.middle) - limit, end = plane + height_of(normal, of.to[k], around.middle) - limit;
                reached = fmin(reached, first_zero(begin, end, bulge));
            }
        }
        if (reached >= best) continue;
        if (around.size < around.way || around.longest <= FINE || of.level == DEEPEST || pieces > MOST_PIECES) best = reached; /* a shorter way helps, or nothing */
        else {
            split(&of, stack + depth);
            depth += 4;
        }
    }
    return best;
}
