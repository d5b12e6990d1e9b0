/* Where an edge or a triangle of the tissue is nearest to a rigid part, or deepest in it: local optimization on the signed distance, as
 * M. Macklin, K. Erleben, M. Mueller, N. Chentanez, S. Jeschke, Z. Corse: Local Optimization for Robust Signed Distance Field Collision,
 * Proc. ACM Comput. Graph. Interact. Tech. 3(1), 2020. The distance is convex where the part is; a line's minimum is then where its slope
 * changes sign, which takes fewer evaluations than golden section. Of a solid that is not convex an edge or a triangle is halved first, as long as
 * a part of it may lie lower than what was found: a distance changes by at most what one goes (Piyavskii, USSR Comp. Math. Math. Phys. 12:57, 1972). */
#include "contact/shapes.h"

#include <math.h>
#include <string.h>

static const double exact = 1e-4; /* of an edge's length */

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
static double apart(const double *a, const double *b) { return sqrt(pow(a[0] - b[0], 2) + pow(a[1] - b[1], 2) + pow(a[2] - b[2], 2)); }

typedef struct line {
    const pliant_part *part;
    double from[3], along[3];
} line;

/* distance at a share of the line, its slope there, and the normal */
static double evaluate(const line *on, double share, double *slope, double normal[3])
{
    const double p[3] = {on->from[0] + share * on->along[0], on->from[1] + share * on->along[1], on->from[2] + share * on->along[2]};
    const double distance = pliant_part_distance(on->part, p, normal);
    *slope = dot(normal, on->along);
    return distance;
}

/* Between 0, where the slope is below 0, and `high`, where it is above: false position with Illinois' rule (Dowell and Jarratt, BIT 11:168, 1971),
 * by halves where it has come little further. */
static double find_turn(const line *on, double slope_low, double high, double slope_high, double normal[3], double *at)
{
    enum { MOST_STEPS = 40 };
    double low = 0, distance = 0, weight_low = slope_low, weight_high = slope_high;
    const double end = high;
    int side = 0;
    for (int step = 0; step < MOST_STEPS; step++) {
        double slope, share = step % 4 == 3 ? 0.5 * (low + high) : low - weight_low * (high - low) / (weight_high - weight_low);
        distance = evaluate(on, share, &slope, normal);
        *at = share;
        if (high - low <= exact * end || slope == 0) break;
        if (slope < 0) {
            low = share;
            weight_low = slope;
            weight_high *= side < 0 ? 0.5 : 1;
            side = -1;
        } else {
            high = share;
            weight_high = slope;
            weight_low *= side > 0 ? 0.5 : 1;
            side = 1;
        }
    }
    return distance;
}

static double descend_edge(const pliant_part *part, const double at[2][3], double enough, double weight[2], double normal[3])
{
    line on = {.part = part};
    double normals[2][3], slope[2], distance[2], share = 0;
    for (int d = 0; d < 3; d++) {
        on.from[d] = at[0][d];
        on.along[d] = at[1][d] - at[0][d];
    }
    for (int end = 0; end < 2; end++) distance[end] = evaluate(&on, end, &slope[end], normals[end]);
    const double bound = 0.5 * (distance[0] + distance[1] - apart(at[0], at[1])); /* a distance changes by at most what one goes */
    if (bound > enough) return bound;
    if (slope[0] < 0 && slope[1] > 0) {
        const double least = find_turn(&on, slope[0], 1, slope[1], normal, &share);
        if (least < fmin(distance[0], distance[1])) {
            weight[0] = 1 - share;
            weight[1] = share;
            return least;
        }
    }
    const int end = distance[1] < distance[0];
    weight[0] = !end;
    weight[1] = end;
    memcpy(normal, normals[end], 3 * sizeof *normal);
    return distance[end];
}

static void mix(const double at[3][3], const double weight[3], double out[3])
{
    for (int d = 0; d < 3; d++) out[d] = weight[0] * at[0][d] + weight[1] * at[1][d] + weight[2] * at[2][d];
}

/* least distance on a line beside the first edge, at a share of the way to the third corner */
static double across(const pliant_part *part, const double at[3][3], double share, double weight[3], double normal[3])
{
    double ends[2][3], along[2];
    for (int d = 0; d < 3; d++) {
        ends[0][d] = at[0][d] + share * (at[2][d] - at[0][d]);
        ends[1][d] = at[1][d] + share * (at[2][d] - at[1][d]);
    }
    const double distance = descend_edge(part, (const double(*)[3])ends, INFINITY, along, normal);
    weight[0] = along[0] * (1 - share);
    weight[1] = along[1] * (1 - share);
    weight[2] = share;
    return distance;
}

/* Golden section over those lines, of which the least distance is convex, too: where the distance has ridges inside a part, slopes lead nowhere. */
static double search_lines(const pliant_part *part, const double at[3][3], double weight[3], double normal[3])
{
    const double golden = 0.6180339887498949;
    double low = 0, high = 1, a = 1 - golden, b = golden, of_a = across(part, at, a, weight, normal), of_b = across(part, at, b, weight, normal);
    while (high - low > exact) {
        if (of_a < of_b) {
            high = b;
            b = a;
            of_b = of_a;
            a = high - golden * (high - low);
            of_a = across(part, at, a, weight, normal);
        } else {
            low = a;
            a = b;
            of_a = of_b;
            b = low + golden * (high - low);
            of_b = across(part, at, b, weight, normal);
        }
    }
    return across(part, at, 0.5 * (low + high), weight, normal);
}

/* Frank and Wolfe's method, in pairs: weight goes from the corner that is uphill most to the one that is downhill most (Lacoste-Julien and Jaggi,
 * On the Global Linear Convergence of Frank-Wolfe Optimization Variants, 2015). */
static double descend_face(const pliant_part *part, const double at[3][3], double enough, double weight[3], double normal[3])
{
    enum { MOST_STEPS = 12 };
    line on = {.part = part};
    bool settled = false;
    double share[3] = {1.0 / 3, 1.0 / 3, 1.0 / 3}, here[3], gradient[3];
    mix(at, share, here);
    double distance = pliant_part_distance(part, here, gradient);
    const double size = fmax(fmax(apart(at[0], here), apart(at[1], here)), apart(at[2], here));
    if (distance - size > enough) return distance - size;
    for (int step = 0; step < MOST_STEPS && !settled; step++) {
        double slope[3], mean = 0, end_slope, end_normal[3], taken;
        int best = 0, worst = -1;
        for (int k = 0; k < 3; k++) {
            slope[k] = dot(gradient, at[k]);
            mean += share[k] * slope[k];
            if (slope[k] < slope[best]) best = k;
            if (share[k] > 0 && (worst < 0 || slope[k] > slope[worst])) worst = k;
        }
        settled = mean - slope[best] <= exact * size; /* nowhere it is less by more than that, where the distance is convex */
        if (settled || worst == best) break;
        mix(at, share, on.from);
        for (int d = 0; d < 3; d++) on.along[d] = share[worst] * (at[best][d] - at[worst][d]);
        const double end = evaluate(&on, 1, &end_slope, end_normal);
        if (end_slope <= 0) {
            taken = 1;
            distance = end;
            memcpy(gradient, end_normal, sizeof gradient);
        } else distance = find_turn(&on, share[worst] * (slope[best] - slope[worst]), 1, end_slope, gradient, &taken);
        share[best] += taken * share[worst];
        share[worst] = taken == 1 ? 0 : share[worst] * (1 - taken);
    }
    if (!settled) return search_lines(part, at, weight, normal);
    memcpy(weight, share, sizeof share);
    memcpy(normal, gradient, sizeof gradient);
    return distance;
}

/* ---- parts that are not convex */

enum { DEEPEST = 8 /* halvings */, MOST_PIECES = 4 * DEEPEST };
static const double half = 0.5; /* of the way to the nearest is bound enough */
static const double steepest = 1.7320508; /* of a field between its points: the slope along each axis is at most 1 there */

/* A part of an edge or a triangle, by its corners' weights. */
typedef struct piece {
    double corner[3][3], middle[3], radius;
    double distance, least; /* in its middle, and the lowest that it can be anywhere */
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
        of->radius = fmax(of->radius, apart(corner, place));
    }
    of->distance = pliant_part_distance(part, place, normal);
    of->least = of->distance - steepest * of->radius;
}

/* an edge into 2, a triangle into 4 */
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
            else memcpy(out[n].corner[k], n == 3 ? middle[k] : k == n ? of->corner[n] : middle[(k + 1) % 3 == n ? (n + 2) % 3 : n], sizeof middle[0]);
    }
    return corners == 2 ? 2 : 4;
}

/* That which is lowest in its middle, of the whole and of parts down to the field's cells. Where all of it is above `enough`: in its `least` a bound of
 * half the way at least. */
static piece find_lowest(const pliant_part *part, const double (*at)[3], int corners, double enough)
{
    piece stack[MOST_PIECES], child[4], best = {.corner = {{1, 0, 0}, {0, 1, 0}, {0, 0, corners == 3}}};
    const double grain = pliant_part_grain(part);
    double bound = INFINITY;
    int depth = 0;
    look_at(part, at, corners, &best);
    for (stack[depth++] = best; depth > 0;) {
        const piece of = stack[--depth];
        if (of.least >= best.distance || of.least > fmax(enough, half * best.distance)) {
            bound = fmin(bound, of.least);
            continue;
        }
        const int count = split(&of, corners, child);
        for (int n = 0; n < count; n++) {
            look_at(part, at, corners, child + n);
            if (child[n].distance < best.distance) best = child[n];
            if (child[n].radius > grain && child[n].level < DEEPEST) stack[depth++] = child[n];
            else bound = fmin(bound, fmin(child[n].distance, fmax(child[n].least, enough)));
        }
    }
    best.least = best.distance > enough ? fmin(bound, best.distance) : -INFINITY;
    return best;
}

/* A part with the same middle, of two cells' size. */
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

static double search(const pliant_part *part, const double (*at)[3], int corners, double enough, double *weight, double normal[3])
{
    piece best = find_lowest(part, at, corners, enough);
    double place[3][3] = {{0}}, share[3];
    if (best.least > enough) return best.least;
    resize_to(2 * pliant_part_grain(part), corners, &best);
    for (int k = 0; k < corners; k++) place_at(at, corners, best.corner[k], place[k]);
    const double least = corners == 2 ? descend_edge(part, (const double(*)[3])place, INFINITY, share, normal)
                                      : descend_face(part, (const double(*)[3])place, INFINITY, share, normal);
    memset(weight, 0, (size_t)corners * sizeof *weight);
    for (int k = 0; k < corners; k++)
        for (int v = 0; v < corners; v++) weight[v] += share[k] * best.corner[k][v];
    if (least <= best.distance) return least;
    memcpy(weight, best.middle, (size_t)corners * sizeof *weight);
    place_at(at, corners, best.middle, place[0]);
    return pliant_part_distance(part, place[0], normal);
}

/* ---- all */

double pliant_edge_minimum(const pliant_part *part, const double at[2][3], double enough, double weight[2], double normal[3])
{
    return pliant_part_grain(part) > 0 ? search(part, at, 2, enough, weight, normal) : descend_edge(part, at, enough, weight, normal);
}

double pliant_face_minimum(const pliant_part *part, const double at[3][3], double enough, double weight[3], double normal[3])
{
    return pliant_part_grain(part) > 0 ? search(part, at, 3, enough, weight, normal) : descend_face(part, at, enough, weight, normal);
}
