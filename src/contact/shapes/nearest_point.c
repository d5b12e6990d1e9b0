/* Nearest or deepest point of an edge or triangle of the tissue relative to a rigid part. The method is local
 * optimization on the signed distance (M. Macklin, K. Erleben, M. Mueller, N. Chentanez, S. Jeschke, Z. Corse:
 * Local Optimization for Robust Signed Distance Field Collision, Proc. ACM Comput. Graph. Interact. Tech. 3(1),
 * 2020).
 * The distance to a convex part is a convex function. Its minimum on a line is where the slope changes sign;
 * finding that needs fewer evaluations than golden section search. For a solid that is not convex, edges and
 * triangles are first subdivided while a piece may contain a smaller distance. The bound for that is the Lipschitz
 * constant of the distance (Piyavskii, USSR Comp. Math. Math. Phys. 12:57, 1972). For a ball the minimum is the
 * point nearest to its center. */
#include "contact/shapes/shapes.h"
#include "base/vector3.h"
#include "contact/shapes/solid.h"

#include <math.h>
#include <string.h>

static const double shortest_normal = 0.1; /* shorter gradients have no valid direction */
static const double edge_bend = 1e-4;      /* quadratic term, relative to an edge's length */
static const double exact = 1e-4;          /* relative to an edge's length; also of a weight */

static double distance_between(const double *a, const double *b)
{
    return sqrt(pow(a[0] - b[0], 2) + pow(a[1] - b[1], 2) + pow(a[2] - b[2], 2));
}

/* Sample of a convex function on a line: position from 0 to 1, value, slope, and the part's normal there. */
typedef struct sample { double position, value, slope, normal[3]; } sample;

/* Bracket of the minimum: the slope is negative at low and positive at high. */
typedef struct bracket {
    sample low, high;
    double weight[2]; /* slopes, as modified by the Illinois rule */
    double tolerance; /* tolerance of the minimum [m] */
    int side, step;
} bracket;

static bracket bracket_between(const sample *low, const sample *high, double tolerance)
{
    return (bracket){.low = *low, .high = *high, .weight = {low->slope, high->slope}, .tolerance = tolerance};
}

/* Choose the next position. Even steps use the intersection of the two tangents, which finds an edge of the part at
 * once. Odd steps use false position with the Illinois rule (Dowell and Jarratt, BIT 11:168, 1971), which suits
 * smooth parts. Return false if the tangents prove that no value is smaller by more than the tolerance. */
static bool bracket_next_position(bracket *of, double *position)
{
    enum { MAX_STEPS = 40 };
    const sample *low = &of->low, *high = &of->high;
    const double span = high->position - low->position,
                 meet = (high->value - low->value - high->slope * span) / (low->slope - high->slope);
    if (of->step == MAX_STEPS || fmin(low->value, high->value) - (low->value + low->slope * meet) <= of->tolerance)
        return false;
    const double put = of->step++ % 2 ? -of->weight[0] * span / (of->weight[1] - of->weight[0]) : meet;
    *position = low->position + (put > 0 && put < span ? put : 0.5 * span);
    return *position > low->position && *position < high->position;
}

static void bracket_update(bracket *of, const sample *one)
{
    const int side = one->slope > 0;
    *(side ? &of->high : &of->low) = *one;
    of->weight[side] = one->slope;
    if (of->side == (side ? 1 : -1)) of->weight[!side] *= 0.5;
    of->side = side ? 1 : -1;
}

/* Return the lower end of the bracket. Its normal is the combination of both ends' normals that has no slope along
 * the line. It is shorter than 1 where the part has an edge. */
static sample bracket_end(const bracket *of)
{
    sample out = of->low.value <= of->high.value ? of->low : of->high;
    for (int d = 0; d < 3; d++)
        out.normal[d] = (of->high.slope * of->low.normal[d] - of->low.slope * of->high.normal[d]) /
                        (of->high.slope - of->low.slope);
    return out;
}

/* A line for the search. A small quadratic term makes the minimum unique: where the distance is constant along the
 * line, its middle is the minimum. Otherwise rounding would select the position on flat parts. */
typedef struct line {
    const pliant_part *part;
    double from[3], along[3];
    double bend, middle; /* value: the distance plus bend times the squared distance from the middle position [m] */
} line;

static sample sample_at(const line *on, double position)
{
    const double p[3] = {on->from[0] + position * on->along[0], on->from[1] + position * on->along[1],
                         on->from[2] + position * on->along[2]},
                 off = position - on->middle;
    sample out = {.position = position};
    out.value = pliant_part_distance(on->part, p, out.normal) + on->bend * off * off;
    out.slope = pliant_dot3(out.normal, on->along) + 2 * on->bend * off;
    return out;
}

static sample minimize_on_line(const line *on, const sample *low, const sample *high, double tolerance)
{
    bracket between = bracket_between(low, high, tolerance);
    double position;
    while (bracket_next_position(&between, &position)) {
        const sample one = sample_at(on, position);
        bracket_update(&between, &one);
    }
    return bracket_end(&between);
}

/* Normalize a vector; a short one has no valid direction and becomes 0. */
static void finish(double normal[3])
{
    const double length = pliant_length3(normal);
    for (int d = 0; d < 3; d++) normal[d] = length > shortest_normal ? normal[d] / length : 0;
}

static double bend_of(double length) { return edge_bend * length; }

static double tolerance_of(double length)
{
    /* relative to the length; where the part is smooth, the position's relative error is about 1e-5 */
    const double tolerance = 1e-10;
    return tolerance * length;
}

/* Find the minimum on an edge, including its ends.
 * @param bend quadratic term [m]
 * @param enough return only a lower bound if it is above this value [m] */
static sample descend(const pliant_part *part, const double at[2][3], double bend, double enough)
{
    line on = {.part = part, .bend = bend, .middle = 0.5};
    const double length = distance_between(at[0], at[1]);
    for (int d = 0; d < 3; d++) {
        on.from[d] = at[0][d];
        on.along[d] = at[1][d] - at[0][d];
    }
    const sample low = sample_at(&on, 0), high = sample_at(&on, 1);
    /* the distance is Lipschitz continuous with constant 1 */
    sample bound = {.position = -1, .value = 0.5 * (low.value + high.value - length) - bend};
    if (bound.value > enough) return bound;
    if (low.slope < 0 && high.slope > 0) {
        const sample minimum = minimize_on_line(&on, &low, &high, tolerance_of(length));
        if (minimum.position > 0 && minimum.position < 1 && minimum.value <= fmin(low.value, high.value))
            return minimum;
    }
    return high.value < low.value ? high : low;
}

static double descend_edge(const pliant_part *part, const double at[2][3], double enough, double weight[2],
                           double normal[3])
{
    const double bend = bend_of(distance_between(at[0], at[1]));
    const sample minimum = descend(part, at, bend, enough);
    if (minimum.position < 0) return minimum.value;
    weight[0] = 1 - minimum.position;
    weight[1] = minimum.position;
    memcpy(normal, minimum.normal, sizeof minimum.normal);
    if (minimum.position > 0 && minimum.position < 1) finish(normal);
    return minimum.value - bend * (minimum.position - 0.5) * (minimum.position - 0.5);
}

static void mix(const double at[3][3], const double weight[3], double out[3])
{
    for (int d = 0; d < 3; d++) out[d] = weight[0] * at[0][d] + weight[1] * at[1][d] + weight[2] * at[2][d];
}

/* A triangle as a set of lines parallel to its first edge. Each has a position from 0 at that edge to 1 at the
 * third corner. */
typedef struct lines {
    const pliant_part *part;
    const double (*at)[3];
    double bend; /* quadratic term for the first edge */
} lines;

/* Find the minimum on one of the lines. Its slope across the lines follows from the envelope theorem: it is the
 * slope at the minimum.
 * @param share_along out: position on the line */
static sample across(const lines *on, double position, double *share_along)
{
    const double third = 1.0 / 3;
    double ends[2][3];
    for (int d = 0; d < 3; d++) {
        ends[0][d] = on->at[0][d] + position * (on->at[2][d] - on->at[0][d]);
        ends[1][d] = on->at[1][d] + position * (on->at[2][d] - on->at[1][d]);
    }
    sample out = descend(on->part, (const double(*)[3])ends, on->bend, INFINITY);
    double towards[2] = {0, 0}, slope;
    for (int k = 0; k < 2; k++)
        for (int d = 0; d < 3; d++) towards[k] += out.normal[d] * (on->at[2][d] - on->at[k][d]);
    slope = position < 1 ? (1 - out.position) * towards[0] + out.position * towards[1] : fmax(towards[0], towards[1]);
    *share_along = out.position;
    out.position = position;
    out.value += on->bend * (position - third) * (position - third);
    out.slope = slope + 2 * on->bend * (position - third);
    return out;
}

/* Find the minimum on a triangle. The minimum on a line is a convex function of the line's position. This also
 * works for distances with edges inside the part, where descent along the gradient stops too early. */
static double search_lines(const pliant_part *part, const double at[3][3], double weight[3], double normal[3])
{
    const double length = distance_between(at[0], at[1]);
    const lines on = {.part = part, .at = at, .bend = bend_of(length)};
    double along[2], position, place[3], own[3];
    const sample low = across(&on, 0, along), high = across(&on, 1, along + 1);
    sample minimum = low.slope >= 0 ? low : high;
    if (low.slope < 0 && high.slope > 0) {
        bracket between = bracket_between(&low, &high, tolerance_of(length));
        while (bracket_next_position(&between, &position)) {
            double here;
            const sample one = across(&on, position, &here);
            along[one.slope > 0] = here;
            bracket_update(&between, &one);
        }
        minimum = bracket_end(&between);
        along[0] = between.low.value <= between.high.value ? along[0] : along[1];
    } else if (low.slope < 0) along[0] = along[1];
    weight[0] = (1 - along[0]) * (1 - minimum.position);
    weight[1] = along[0] * (1 - minimum.position);
    weight[2] = minimum.position;
    memcpy(normal, minimum.normal, sizeof minimum.normal);
    mix(at, weight, place);
    return pliant_part_distance(part, place, own);
}

/* Inside a triangle the direction out is the triangle's normal. At the minimum of a convex function over a set,
 * some subgradient is normal to the set (Rockafellar, Convex Analysis, 1970, theorem 27.4). The normal of a single
 * face at a part's corner is not such a subgradient. */
static void turn_to_triangle(const double at[3][3], const double weight[3], double normal[3])
{
    double a[3], b[3], own[3];
    if (!(weight[0] > exact && weight[1] > exact && weight[2] > exact)) {
        finish(normal);
        return;
    }
    for (int d = 0; d < 3; d++) {
        a[d] = at[1][d] - at[0][d];
        b[d] = at[2][d] - at[0][d];
    }
    for (int d = 0; d < 3; d++) own[d] = a[(d + 1) % 3] * b[(d + 2) % 3] - a[(d + 2) % 3] * b[(d + 1) % 3];
    const double size = pliant_length3(own), along = size > 0 ? pliant_dot3(own, normal) / size : 0;
    for (int d = 0; d < 3; d++) normal[d] = size > 0 ? along * own[d] / size : normal[d];
    finish(normal);
}

/* Return whether the distance inside the part has edges, where the gradient gives no direction of descent. */
static bool has_edges(const pliant_part *part)
{
    return part->kind == PLIANT_PART_BOX || (part->kind == PLIANT_PART_SOLID && pliant_part_cell_size(part) == 0);
}

/* Find the minimum on a triangle by the pairwise Frank-Wolfe method. Weight moves from the corner with the highest
 * slope to the corner with the lowest one (Lacoste-Julien and Jaggi, On the Global Linear Convergence of
 * Frank-Wolfe Optimization Variants, 2015). */
static double descend_face(const pliant_part *part, const double at[3][3], double enough, double weight[3],
                           double normal[3])
{
    enum { MAX_STEPS = 12 };
    line on = {.part = part};
    bool settled = false;
    double position[3] = {1.0 / 3, 1.0 / 3, 1.0 / 3}, here[3], gradient[3];
    mix(at, position, here);
    double distance = pliant_part_distance(part, here, gradient);
    const double size =
        fmax(fmax(distance_between(at[0], here), distance_between(at[1], here)), distance_between(at[2], here));
    if (distance - size > enough) return distance - size;
    for (int step = 0; step < MAX_STEPS && !settled && !has_edges(part); step++) {
        double slope[3], mean = 0;
        int best = 0, worst = -1;
        for (int k = 0; k < 3; k++) {
            slope[k] = pliant_dot3(gradient, at[k]);
            mean += position[k] * slope[k];
            if (slope[k] < slope[best]) best = k;
            if (position[k] > 0 && (worst < 0 || slope[k] > slope[worst])) worst = k;
        }
        settled = mean - slope[best] <= exact * size; /* for a convex distance, no value is smaller by more than this */
        if (settled || worst == best) break;
        mix(at, position, on.from);
        for (int d = 0; d < 3; d++) on.along[d] = position[worst] * (at[best][d] - at[worst][d]);
        sample one = sample_at(&on, 1),
               begin = {.value = distance, .slope = position[worst] * (slope[best] - slope[worst])};
        memcpy(begin.normal, gradient, sizeof gradient);
        if (one.slope > 0) one = minimize_on_line(&on, &begin, &one, tolerance_of(size));
        distance = one.value;
        memcpy(gradient, one.normal, sizeof gradient);
        position[best] += one.position * position[worst];
        position[worst] = one.position == 1 ? 0 : position[worst] * (1 - one.position);
    }
    if (!settled) distance = search_lines(part, at, position, gradient);
    memcpy(weight, position, sizeof position);
    memcpy(normal, gradient, sizeof gradient);
    turn_to_triangle(at, position, normal);
    return distance;
}

/* ---- parts that are not convex */

enum { DEEPEST = 8 /* maximum number of subdivisions */, MAX_PIECES = 4 * DEEPEST };
static const double half = 0.5; /* stop when the lower bound is this fraction of the distance */

/* A piece of an edge or triangle, by the weights of its corners. */
typedef struct piece {
    double corner[3][3], middle[3], radius;
    double distance, minimum; /* distance at its center, and lower bound in the piece */
    int level;
} piece;

static void place_at(const double (*at)[3], int corners, const double weight[3], double out[3])
{
    for (int d = 0; d < 3; d++) {
        out[d] = 0;
        for (int v = 0; v < corners; v++) out[d] += weight[v] * at[v][d];
    }
}

static void look_at(const pliant_part *part, const double (*at)[3], int corners, piece *of)
{
    double place[3], corner[3], normal[3];
    memset(of->middle, 0, sizeof of->middle);
    of->radius = 0;
    for (int k = 0; k < corners; k++)
        for (int v = 0; v < corners; v++) of->middle[v] += of->corner[k][v] / corners;
    place_at(at, corners, of->middle, place);
    for (int k = 0; k < corners; k++) {
        place_at(at, corners, of->corner[k], corner);
        of->radius = fmax(of->radius, distance_between(corner, place));
    }
    of->distance = pliant_part_distance(part, place, normal);
    of->minimum = of->distance - PLIANT_FIELD_SLOPE * of->radius;
}

/* Split an edge into 2 pieces, or a triangle into 4. */
static int split(const piece *of, int corners, piece *out)
{
    double middle[3][3];
    for (int k = 0; k < corners; k++)
        for (int v = 0; v < 3; v++) middle[k][v] = 0.5 * (of->corner[k][v] + of->corner[(k + 1) % corners][v]);
    for (int n = 0; n < (corners == 2 ? 2 : 4); n++) {
        out[n] = *of;
        out[n].level++;
        for (int k = 0; k < corners; k++)
            if (corners == 2) memcpy(out[n].corner[k], k == n ? of->corner[n] : middle[0], sizeof middle[0]);
            else
                memcpy(out[n].corner[k],
                       n == 3   ? middle[k]
                       : k == n ? of->corner[n]
                                : middle[(k + 1) % 3 == n ? (n + 2) % 3 : n],
                       sizeof middle[0]);
    }
    return corners == 2 ? 2 : 4;
}

/* Find the piece with the smallest distance at its center. Subdivide down to the field's cells. If the distance is
 * above `enough` everywhere, best.minimum is a lower bound of at least half the distance. */
static piece find_lowest(const pliant_part *part, const double (*at)[3], int corners, double enough)
{
    piece stack[MAX_PIECES], child[4], best = {.corner = {{1, 0, 0}, {0, 1, 0}, {0, 0, corners == 3}}};
    const double grain = pliant_part_cell_size(part);
    double bound = INFINITY;
    int depth = 0;
    look_at(part, at, corners, &best);
    for (stack[depth++] = best; depth > 0;) {
        const piece of = stack[--depth];
        if (of.minimum >= best.distance || of.minimum > fmax(enough, half * best.distance)) {
            bound = fmin(bound, of.minimum);
            continue;
        }
        const int count = split(&of, corners, child);
        for (int n = 0; n < count; n++) {
            look_at(part, at, corners, child + n);
            if (child[n].distance < best.distance) best = child[n];
            if (child[n].radius > grain && child[n].level < DEEPEST) stack[depth++] = child[n];
            else bound = fmin(bound, fmin(child[n].distance, fmax(child[n].minimum, enough)));
        }
    }
    best.minimum = best.distance > enough ? fmin(bound, best.distance) : -INFINITY;
    return best;
}

/* Scale a piece about its center to this radius. */
static void resize_to(double size, int corners, piece *of)
{
    const double scale = of->radius > 0 ? size / of->radius : 1;
    for (int k = 0; k < corners; k++) {
        double sum = 0;
        for (int v = 0; v < corners; v++) {
            of->corner[k][v] = fmax(of->middle[v] + scale * (of->corner[k][v] - of->middle[v]), 0);
            sum += of->corner[k][v];
        }
        for (int v = 0; v < corners; v++) of->corner[k][v] /= sum;
    }
}

static double search(const pliant_part *part, const double (*at)[3], int corners, double enough, double *weight,
                     double normal[3])
{
    piece best = find_lowest(part, at, corners, enough);
    double place[3][3] = {{0}}, position[3];
    if (best.minimum > enough) return best.minimum;
    resize_to(2 * pliant_part_cell_size(part), corners, &best);
    for (int k = 0; k < corners; k++) place_at(at, corners, best.corner[k], place[k]);
    const double minimum = corners == 2 ? descend_edge(part, (const double(*)[3])place, INFINITY, position, normal)
                                      : descend_face(part, (const double(*)[3])place, INFINITY, position, normal);
    memset(weight, 0, (size_t)corners * sizeof *weight);
    for (int k = 0; k < corners; k++)
        for (int v = 0; v < corners; v++) weight[v] += position[k] * best.corner[k][v];
    if (minimum <= best.distance) return minimum;
    memcpy(weight, best.middle, (size_t)corners * sizeof *weight);
    place_at(at, corners, best.middle, place[0]);
    return pliant_part_distance(part, place[0], normal);
}

/* ---- balls */

static double nearest_on_edge(const pliant_part *ball, const double at[2][3], double weight[2], double normal[3])
{
    double along[3], to[3], place[3];
    for (int d = 0; d < 3; d++) {
        along[d] = at[1][d] - at[0][d];
        to[d] = ball->from[d] - at[0][d];
    }
    const double size = pliant_dot3(along, along), position = size > 0 ? pliant_dot3(to, along) / size : 0;
    weight[1] = position > 0 ? (position < 1 ? position : 1) : 0;
    weight[0] = 1 - weight[1];
    for (int d = 0; d < 3; d++) place[d] = weight[0] * at[0][d] + weight[1] * at[1][d];
    return pliant_part_distance(ball, place, normal);
}

static double nearest_on_face(const pliant_part *ball, const double at[3][3], double weight[3], double normal[3])
{
    double place[3];
    pliant_triangle_nearest_weights(at[0], at[1], at[2], ball->from, weight);
    weight[0] = fmax(weight[0], 0);
    mix(at, weight, place);
    return pliant_part_distance(ball, place, normal);
}

/* ---- all */

double pliant_edge_minimum(const pliant_part *part, const double at[2][3], double enough, double weight[2],
                           double normal[3])
{
    if (part->kind == PLIANT_PART_SPHERE) return nearest_on_edge(part, at, weight, normal);
    return pliant_part_cell_size(part) > 0 ? search(part, at, 2, enough, weight, normal)
                                       : descend_edge(part, at, enough, weight, normal);
}

double pliant_face_minimum(const pliant_part *part, const double at[3][3], double enough, double weight[3],
                           double normal[3])
{
    if (part->kind == PLIANT_PART_SPHERE) return nearest_on_face(part, at, weight, normal);
    return pliant_part_cell_size(part) > 0 ? search(part, at, 3, enough, weight, normal)
                                       : descend_face(part, at, enough, weight, normal);
}
