/* The smallest distance of a triangle from a convex part, by cutting planes (Kelley, The cutting-plane method for
 * solving convex programs, J. SIAM 8:703, 1960). The signed distance is convex, so it lies above its tangent at
 * each point. The best bound from a few tangents over the triangle is a matrix game with three columns, the
 * corners. Its solution is a mixture of tangents, which is a plane, and a point of the triangle. The next tangent
 * is taken at that point. Each mixture is a valid bound, at every stage of the search. Spheres, capsules and
 * half-spaces need one tangent. */
#include "contact/advance/convex_bound.h"

#include "contact/advance/advance_rules.h"
#include "contact/shapes/shapes.h"
#include "contact/shapes/solid.h"

#include <string.h>

enum { MAX_TANGENTS = 4, MAX_STEPS = 32 };
static const double exact = 1e-3; /* of the distance */
static const double tiny = 1e-13; /* [m] */

typedef struct tangent {
    double normal[3], point[3], value; /* value: at the point */
    double at[3];                      /* at the corners */
} tangent;

/* Solution of the game. The weights of the tangents maximize the bound at the lowest corner. The weights of the
 * corners minimize the highest tangent. Both are found independently, because several mixtures of tangents may be
 * equally good. */
typedef struct mixture {
    double tangent[MAX_TANGENTS], corner[3], lowest, highest;
} mixture;

static void try_mixture(const tangent *of, int count, const mixture *trial, mixture *best)
{
    double lowest = INFINITY, highest = -INFINITY;
    for (int c = 0; c < 3; c++) {
        double sum = 0;
        for (int k = 0; k < count; k++) sum += trial->tangent[k] * of[k].at[c];
        lowest = sum < lowest ? sum : lowest;
    }
    for (int k = 0; k < count; k++) {
        const double sum = pliant_dot3(trial->corner, of[k].at);
        highest = sum > highest ? sum : highest;
    }
    if (lowest > best->lowest) {
        best->lowest = lowest;
        memcpy(best->tangent, trial->tangent, sizeof best->tangent);
    }
    if (highest < best->highest) {
        best->highest = highest;
        memcpy(best->corner, trial->corner, sizeof best->corner);
    }
}

static void try_one(const tangent *of, int count, int i, mixture *best)
{
    mixture trial = {.tangent = {0}};
    int lowest = 0;
    for (int c = 1; c < 3; c++)
        if (of[i].at[c] < of[i].at[lowest]) lowest = c;
    trial.tangent[i] = trial.corner[lowest] = 1;
    try_mixture(of, count, &trial, best);
}

/* Mix two tangents that have equal values at two corners. */
static void try_two(const tangent *of, int count, int i, int j, mixture *best)
{
    for (int a = 0; a < 3; a++) {
        const int b = (a + 1) % 3;
        const double rise = of[i].at[b] - of[i].at[a], fall = of[j].at[a] - of[j].at[b],
                     over = of[i].at[a] - of[j].at[a], under = of[j].at[b] - of[i].at[b];
        mixture trial = {.tangent = {0}};
        if (!(rise * fall > 0 && over * under > 0)) continue; /* otherwise a single tangent is better */
        trial.tangent[i] = fall / (rise + fall);
        trial.tangent[j] = rise / (rise + fall);
        trial.corner[a] = under / (over + under);
        trial.corner[b] = over / (over + under);
        try_mixture(of, count, &trial, best);
    }
}

/* Normalize weights of equal sign to the sum 1. */
static bool normalize(double weight[3])
{
    const double sum = weight[0] + weight[1] + weight[2];
    bool good = sum != 0;
    for (int d = 0; d < 3 && good; d++) {
        weight[d] /= sum;
        good = weight[d] >= 0;
    }
    return good;
}

static void try_three(const tangent *of, int count, const int row[3], mixture *best)
{
    double columns[2][3], rows[2][3], tangents[3], corners[3];
    mixture trial = {.tangent = {0}};
    for (int n = 0; n < 2; n++)
        for (int d = 0; d < 3; d++) {
            columns[n][d] = of[row[d]].at[n + 1] - of[row[d]].at[0];
            rows[n][d] = of[row[n + 1]].at[d] - of[row[0]].at[d];
        }
    pliant_cross3(columns[0], columns[1], tangents);
    pliant_cross3(rows[0], rows[1], corners);
    if (!normalize(tangents) || !normalize(corners)) return;
    for (int d = 0; d < 3; d++) {
        trial.tangent[row[d]] = tangents[d];
        trial.corner[d] = corners[d];
    }
    try_mixture(of, count, &trial, best);
}

static mixture mix_best(const tangent *of, int count)
{
    mixture best = {.lowest = -INFINITY, .highest = INFINITY};
    for (int i = 0; i < count; i++) {
        try_one(of, count, i, &best);
        for (int j = i + 1; j < count; j++) {
            try_two(of, count, i, j, &best);
            for (int k = j + 1; k < count; k++) {
                const int row[3] = {i, j, k};
                try_three(of, count, row, &best);
            }
        }
    }
    return best;
}

static tangent tangent_at(const pliant_part *core, const double corner[3][3], const double weight[3])
{
    tangent out;
    pliant_advance_triangle_point(corner, weight, out.point);
    out.value = pliant_part_distance(core, out.point, out.normal);
    for (int c = 0; c < 3; c++) {
        double difference[3];
        for (int d = 0; d < 3; d++) difference[d] = corner[c][d] - out.point[d];
        out.at[c] = out.value + pliant_dot3(out.normal, difference);
    }
    return out;
}

/* Compute the weights of the point of a triangle closest to a segment that does not pass through the triangle. */
static void nearest_to_segment(const double corner[3][3], const double end[2][3], double weight[3])
{
    double best = INFINITY;
    for (int k = 0; k < 5; k++) {
        double trial[3] = {0, 0, 0}, place[3], difference[3], s, t;
        if (k < 3) {
            const int next = (k + 1) % 3;
            double edge[2][3];
            for (int i = 0; i < 3; i++) {
                edge[0][i] = corner[k][i];
                edge[1][i] = corner[next][i];
            }
            pliant_advance_closest_on_segments((const double(*)[3])edge, end, &s, &t);
            trial[k] = 1 - s;
            trial[next] = s;
        } else {
            t = (double)(k - 3);
            pliant_triangle_nearest_weights(corner[0], corner[1], corner[2], end[k - 3], trial);
        }
        pliant_advance_triangle_point(corner, trial, place);
        for (int i = 0; i < 3; i++) difference[i] = place[i] - end[0][i] - t * (end[1][i] - end[0][i]);
        const double square = pliant_dot3(difference, difference);
        if (!(square < best)) continue;
        best = square;
        for (int i = 0; i < 3; i++) weight[i] = trial[i];
    }
}

/* For a few rounds, start from the triangle's point nearest to the part's closest point. */
static void begin_at(const pliant_part *core, const double corner[3][3], double weight[3])
{
    enum { ROUNDS = 2 };
    const double ends[2][3] = {{core->from[0], core->from[1], core->from[2]}, {core->to[0], core->to[1], core->to[2]}};
    if (core->kind == PLIANT_PART_SPHERE)
        pliant_triangle_nearest_weights(corner[0], corner[1], corner[2], core->from, weight);
    if (core->kind == PLIANT_PART_CAPSULE) nearest_to_segment(corner, ends, weight);
    if (core->kind != PLIANT_PART_BOX && core->kind != PLIANT_PART_SOLID) return;
    for (int round = 0; round < ROUNDS; round++) {
        double point[3], normal[3];
        pliant_advance_triangle_point(corner, weight, point);
        const double distance = pliant_part_distance(core, point, normal) + core->radius;
        for (int d = 0; d < 3; d++) point[d] -= distance * normal[d];
        if (distance <= 0) return;
        pliant_triangle_nearest_weights(corner[0], corner[1], corner[2], point, weight);
    }
}

/* Make the cut's normal a unit vector. This is valid if all corners are outside of the body without the radius,
 * because that body lies behind the plane. */
static void tighten_bound(double radius, pliant_distance_bound *out)
{
    const double length = pliant_length3(out->normal);
    if (!(out->minimum + radius > 0 && length > 0)) return;
    out->offset = (out->offset + radius) / length - radius;
    out->minimum = (out->minimum + radius) / length - radius;
    for (int d = 0; d < 3; d++) {
        out->normal[d] /= length;
        out->at[d] = (out->at[d] + radius) / length - radius;
    }
}

static void mix_tangents(const tangent *of, int count, const double corner[3][3], const double weight[MAX_TANGENTS],
                         double radius, pliant_distance_bound *out)
{
    int main_one = 0;
    for (int k = 1; k < count; k++)
        if (weight[k] > weight[main_one]) main_one = k;
    *out = (pliant_distance_bound){.minimum = INFINITY};
    memcpy(out->point, of[main_one].point, sizeof out->point);
    for (int k = 0; k < count; k++) {
        double difference[3];
        for (int d = 0; d < 3; d++) {
            difference[d] = out->point[d] - of[k].point[d];
            out->normal[d] += weight[k] * of[k].normal[d];
        }
        out->offset += weight[k] * (of[k].value + pliant_dot3(of[k].normal, difference));
    }
    for (int c = 0; c < 3; c++) {
        double difference[3];
        for (int d = 0; d < 3; d++) difference[d] = corner[c][d] - out->point[d];
        out->at[c] = out->offset + pliant_dot3(out->normal, difference);
        out->minimum = fmin(out->minimum, out->at[c]);
    }
    tighten_bound(radius, out);
}

void pliant_distance_bound_find(const pliant_part *core, const double corner[3][3], double weight[3],
                                pliant_distance_bound *out)
{
    tangent of[MAX_TANGENTS];
    mixture best = {.lowest = -INFINITY, .highest = INFINITY};
    double lowest = INFINITY, trial[3];
    int count = 0;
    begin_at(core, corner, weight);
    memcpy(trial, weight, sizeof trial);
    for (int step = 0; step < MAX_STEPS; step++) {
        const tangent one = tangent_at(core, corner, trial);
        if (one.value < lowest) {
            lowest = one.value;
            memcpy(weight, trial, sizeof trial);
        }
        if (count == MAX_TANGENTS) /* the last mixture has at most three tangents, so one can be removed */
            for (int k = count = 0; k < MAX_TANGENTS; k++)
                if (best.tangent[k] > 0 && count < MAX_TANGENTS - 1) of[count++] = of[k];
        of[count++] = one;
        best = mix_best(of, count);
        mix_tangents(of, count, corner, best.tangent, core->radius, out);
        if (lowest <= 0 || lowest - out->minimum <= exact * lowest + tiny ||
            memcmp(trial, best.corner, sizeof trial) == 0)
            break;
        memcpy(trial, best.corner, sizeof trial);
    }
    out->minimum = fmin(out->minimum, lowest);
}
