/* The surface against itself: nodes against triangles, and edges against edges. All four nodes of a pair move along
 * straight lines. Therefore a plane that separates the pair bounds its distance by linear functions, without a term
 * for arcs. */
#include "base/buffer.h"
#include "base/fail.h"
#include "base/threads.h"
#include "contact/advance/advance_rules.h"
#include "contact/advance/self_rules.h"
#include "contact/shapes/solid.h"

#include <math.h>
#include <string.h>

enum { FIRST_PAIRS = 1024 };

/* ---- the broad phase */

typedef struct couple {
    int32_t a, b;
} couple;

/* Test two leaves, or a leaf against itself. Return false if out of memory. */
static bool try_leaves(const pliant_advance_self_search *on, const couple *at, bool tests_crossings,
                       pliant_advance *advance, pliant_advance_self_list *out)
{
    const pliant_advance_tree *tree = &advance->tree;
    const pliant_advance_branch *a = tree->branch + at->a, *b = tree->branch + at->b;
    for (int32_t m = a->first; m < a->first + a->count; m++)
        for (int32_t n = at->a == at->b ? m + 1 : b->first; n < b->first + b->count; n++) {
            const pliant_advance_box *const boxes[2] = {tree->box + m, tree->box + n};
            if (pliant_advance_boxes_separated(boxes[0], boxes[1], on->margin)) continue;
            if (!pliant_reserve(&advance->self, &advance->max_self, out->count + PLIANT_ADVANCE_MAX_SELF, FIRST_PAIRS,
                                sizeof *advance->self))
                return false;
            out->pair = advance->self;
            out->capacity = advance->max_self;
            if (tests_crossings) pliant_advance_try_crossings(on, tree->order[m], tree->order[n], boxes, out);
            pliant_advance_try_pairs(on, tree->order[m], tree->order[n], boxes, out);
        }
    return true;
}

/* Visit all pairs of branches whose boxes are near, from the root down. crossings: out; Nullable */
static pliant_status find_pairs(const pliant_advance_self_search *on, pliant_advance *advance, int32_t *crossings)
{
    enum { MAX_OPEN = 512 }; /* three for each level of both branches */
    const pliant_advance_tree *tree = &advance->tree;
    pliant_advance_self_list found = {.count = 0};
    const bool tests_crossings = on->crossing || crossings;
    couple open[MAX_OPEN];
    int depth = 0;
    open[depth++] = (couple){0, 0};
    while (depth > 0) {
        const couple at = open[--depth];
        const pliant_advance_branch *a = tree->branch + at.a, *b = tree->branch + at.b;
        if (at.a != at.b && pliant_advance_boxes_separated(tree->around + at.a, tree->around + at.b, on->margin))
            continue;
        if (a->child < 0 && b->child < 0) {
            if (!try_leaves(on, &at, tests_crossings, advance, &found)) return pliant_fail_memory("contact advance");
        } else if (at.a == at.b) {
            open[depth++] = (couple){a->child, a->child + 1};
            open[depth++] = (couple){a->child + 1, a->child + 1};
            open[depth++] = (couple){a->child, a->child};
        } else if (b->child < 0 || (a->child >= 0 && a->count >= b->count)) {
            open[depth++] = (couple){a->child + 1, at.b};
            open[depth++] = (couple){a->child, at.b};
        } else {
            open[depth++] = (couple){at.a, b->child + 1};
            open[depth++] = (couple){at.a, b->child};
        }
    }
    advance->num_self = found.count;
    if (crossings) *crossings = found.crossings;
    return PLIANT_OK;
}

/* ---- one pair */

typedef struct leg {
    const pliant_advance *advance;
    const double *from, *to;
    const pliant_advance_self *self;
} leg;

static void position_at(const leg *on, int32_t node, double t, double out[3])
{
    for (size_t d = 0; d < 3; d++)
        out[d] = on->from[3 * (size_t)node + d] + t * (on->to[3 * (size_t)node + d] - on->from[3 * (size_t)node + d]);
}

/* Compute the vector from the second side's closest point to the first side's. */
static void shortest_way(const double x[4][3], bool is_edges, double out[3])
{
    if (is_edges) {
        double s, r;
        pliant_advance_closest_on_segments(x, x + 2, &s, &r);
        for (int d = 0; d < 3; d++)
            out[d] = x[0][d] + s * (x[1][d] - x[0][d]) - x[2][d] - r * (x[3][d] - x[2][d]);
    } else {
        double weight[3], foot[3];
        pliant_triangle_nearest_weights(x[1], x[2], x[3], x[0], weight);
        pliant_advance_triangle_point(x + 1, weight, foot);
        for (int d = 0; d < 3; d++) out[d] = x[0][d] - foot[d];
    }
}

double pliant_advance_thickness(const pliant_advance_self *self, const int32_t node[4], bool is_edges)
{
    double x[4][3], way[3];
    if (pliant_advance_is_exempt(self, 4, node, is_edges ? 2 : 1)) return 0;
    if (!self->rest) return self->thickness;
    for (int c = 0; c < 4; c++) memcpy(x[c], self->rest + 3 * (size_t)node[c], sizeof x[c]);
    shortest_way((const double(*)[3])x, is_edges, way);
    const double distance = pliant_length3(way), none = 1e-6; /* fraction of the thickness: rounding */
    return distance > none * self->thickness ? fmin(distance, self->thickness) : 0;
}

/* A pair at one time: positions relative to its first node's start, and the plane between its closest points. */
typedef struct moment {
    double x[4][3], normal[3];
    double height[4]; /* along the plane's normal */
    double distance;  /* sharp lower bound [m] */
} moment;

static void measure_pair(const leg *on, const pliant_advance_self_pair *pair, double t, moment *out)
{
    const int first = pair->is_edges ? 2 : 1;
    const double *origin = on->from + 3 * (size_t)pair->node[0];
    double lowest = INFINITY, highest = -INFINITY;
    for (int c = 0; c < 4; c++) {
        position_at(on, pair->node[c], t, out->x[c]);
        for (int d = 0; d < 3; d++) out->x[c][d] -= origin[d];
    }
    const double(*x)[3] = (const double(*)[3])out->x;
    shortest_way(x, pair->is_edges, out->normal);
    const double size = pliant_length3(out->normal), scale = size > 0 ? 1 / size : 0;
    for (int d = 0; d < 3; d++) out->normal[d] *= scale;
    for (int c = 0; c < 4; c++) {
        out->height[c] = pliant_dot3(out->normal, x[c]);
        if (c < first)
            lowest = pliant_advance_lower(lowest, out->height[c]);
        else
            highest = pliant_advance_upper(highest, out->height[c]);
    }
    out->distance = lowest - highest;
}

/* Return the larger of two safe times: by the separating plane, and by distance over relative speed. */
static double step_of(const leg *on, const pliant_advance_self_pair *pair, const moment *now)
{
    const int first = pair->is_edges ? 2 : 1;
    double rate[4][3], along[4], mean[3], fastest[2] = {0, 0}, plane = INFINITY;
    for (int c = 0; c < 4; c++) {
        for (size_t d = 0; d < 3; d++)
            rate[c][d] = on->to[3 * (size_t)pair->node[c] + d] - on->from[3 * (size_t)pair->node[c] + d];
        along[c] = pliant_dot3(now->normal, rate[c]);
    }
    for (int a = 0; a < first; a++)
        for (int b = first; b < 4; b++) {
            const double gap = now->height[a] - now->height[b] - pair->limit;
            plane = pliant_advance_lower(plane, pliant_advance_time(gap, along[a] - along[b], 0));
        }
    for (int d = 0; d < 3; d++) mean[d] = (rate[0][d] + rate[1][d] + rate[2][d] + rate[3][d]) / 4;
    for (int c = 0; c < 4; c++) {
        double own[3];
        for (int d = 0; d < 3; d++) own[d] = rate[c][d] - mean[d];
        fastest[c >= first] = pliant_advance_upper(fastest[c >= first], pliant_dot3(own, own));
    }
    const double speed = sqrt(fastest[0]) + sqrt(fastest[1]);
    return pliant_advance_upper(plane, speed > 0 ? (now->distance - pair->limit) / speed : INFINITY);
}

/* Make one iteration, as pliant_advance_pair_step. */
static bool step(const leg *on, pliant_advance_self_pair *pair)
{
    const double left = 1 - pair->t;
    moment now;
    measure_pair(on, pair, pair->t, &now);
    if (pair->iterations == 0) {
        const double thickness = pliant_advance_thickness(on->self, pair->node, pair->is_edges);
        if (pliant_advance_starts_together(&on->advance->settings, thickness, now.distance)) {
            pair->t = 1;
            return true;
        }
        pair->limit = pliant_advance_limit(&on->advance->settings, thickness, now.distance);
    }
    if (!(now.distance >= pair->limit)) return true;
    const double ahead = step_of(on, pair, &now);
    if (ahead >= left) {
        pair->t = 1;
        return true;
    }
    pair->t += PLIANT_ADVANCE_SAFETY * ahead;
    pair->iterations++;
    return pliant_advance_is_finished(pair->iterations, ahead, now.distance - pair->limit, pair->limit);
}

/* ---- a leg */

double pliant_advance_relative_motion(int32_t count, const int32_t *node, const double *from, const double *to)
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, square = 0;
    for (int32_t n = 0; n < count; n++)
        for (size_t d = 0; d < 3; d++) {
            const size_t at = 3 * (size_t)(node ? node[n] : n) + d;
            low[d] = pliant_advance_lower(low[d], to[at] - from[at]);
            high[d] = pliant_advance_upper(high[d], to[at] - from[at]);
        }
    for (int d = 0; d < 3 && count > 0; d++) square += (high[d] - low[d]) * (high[d] - low[d]);
    return sqrt(square);
}

double pliant_advance_self_margin(const pliant_contact_settings *settings, double thickness)
{
    return settings->advance_stop * thickness;
}

/* List the pairs that can come near each other during the leg. */
static pliant_status list_leg(pliant_advance *advance, int32_t num_triangles, const int32_t *triangles,
                              const double *from, const double *to, const pliant_advance_self *self, double margin,
                              uint8_t *crossing, int32_t *crossings)
{
    advance->num_self = 0;
    if (crossings) *crossings = 0;
    if (num_triangles == 0) return PLIANT_OK;
    const pliant_status status =
        pliant_advance_tree_update(&advance->tree, num_triangles, triangles, self->rest, from, to);
    if (status != PLIANT_OK) return status;
    const pliant_advance_self_search on = {.triangles = advance->tree.triangles,
                                           .owns = advance->tree.owns,
                                           .from = from,
                                           .to = to,
                                           .self = *self,
                                           .margin = margin,
                                           .crossing = crossing};
    return find_pairs(&on, advance, crossings);
}

/* Make the first iteration of all pairs nearer than a distance, and sort the pairs that may shorten the leg. Return the
 * number of sorted pairs. */
static int32_t begin_pairs(pliant_advance *advance, const leg *on, double distance, int num_threads)
{
    const int threads = pliant_threads_or_cores(num_threads);
    const bool parallel = threads > 1 && advance->num_self > 256;
    int32_t left = 0;
#pragma omp parallel for schedule(static) num_threads(threads) if (parallel)
    for (int32_t n = 0; n < advance->num_self; n++) {
        pliant_advance_self_pair *pair = advance->self + n;
        const bool is_near = pair->limit <= distance;
        pair->iterations = 0;
        pair->t = is_near ? 0 : 1;
        pair->ends = !is_near || step(on, pair);
    }
    for (int32_t n = 0; n < advance->num_self; n++)
        if (advance->self[n].t < 1) advance->pair_time[left++] = (pliant_advance_pair_time){advance->self[n].t, n};
    pliant_advance_sort(left, advance->pair_time);
    return left;
}

pliant_status pliant_advance_find_self(pliant_advance *advance, int32_t num_triangles, const int32_t *triangles,
                                       const double *from, const double *to, const pliant_advance_self *self,
                                       double listed, int num_threads, double *fraction)
{
    const leg on = {.advance = advance, .from = from, .to = to, .self = self};
    const double margin = pliant_advance_self_margin(&advance->settings, self->thickness);
    double smallest = 1;
    pliant_status status =
        listed > 0 ? PLIANT_OK
                   : list_leg(advance, num_triangles, triangles, from, to, self, margin, NULL, NULL);
    if (status == PLIANT_OK) status = pliant_advance_reserve_times(advance, advance->num_self);
    if (status != PLIANT_OK) return status;
    const int32_t left = begin_pairs(advance, &on, listed > 0 ? listed : INFINITY, num_threads);
    for (int32_t n = 0; n < left && advance->pair_time[n].t < smallest; n++) {
        pliant_advance_self_pair *pair = advance->self + advance->pair_time[n].pair;
        while (!pair->ends && pair->t < smallest) pair->ends = step(&on, pair);
        if (!(pair->t >= smallest)) smallest = pair->t;
    }
    *fraction = smallest;
    return PLIANT_OK;
}

double pliant_advance_self_distance(const pliant_advance_self_pair *pair, const double *positions)
{
    const leg on = {.from = positions, .to = positions};
    moment now;
    measure_pair(&on, pair, 0, &now);
    return now.distance;
}

void pliant_advance_self_contact(const pliant_advance_self_pair *pair, const double *from, const double *to,
                                 double weight[4], double normal[3])
{
    const leg on = {.from = from, .to = to};
    moment now;
    measure_pair(&on, pair, pair->t, &now);
    const double(*x)[3] = (const double(*)[3])now.x;
    memcpy(normal, now.normal, sizeof now.normal);
    if (pair->is_edges) {
        double s, r;
        pliant_advance_closest_on_segments(x, x + 2, &s, &r);
        weight[0] = 1 - s;
        weight[1] = s;
        weight[2] = r - 1;
        weight[3] = -r;
    } else {
        pliant_triangle_nearest_weights(x[1], x[2], x[3], x[0], weight + 1);
        weight[0] = 1;
        for (int c = 1; c < 4; c++) weight[c] = -weight[c];
    }
}

double pliant_advance_self_time(pliant_advance *advance, const double *from, const double *to,
                                const pliant_advance_self *self, pliant_advance_self_pair *pair)
{
    const leg on = {.advance = advance, .from = from, .to = to, .self = self};
    pair->iterations = 0;
    pair->t = 0;
    for (pair->ends = false; !pair->ends;) pair->ends = step(&on, pair);
    return pair->t;
}

pliant_status pliant_advance_audit_self(pliant_advance *advance, int32_t num_triangles, const int32_t *triangles,
                                        const double *positions, const pliant_advance_self *self, uint8_t *crossing,
                                        int32_t *crossings)
{
    return list_leg(advance, num_triangles, triangles, positions, positions, self, self->thickness, crossing,
                    crossings);
}
