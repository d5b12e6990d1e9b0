/* The surface against itself: nodes against triangles, and edges against edges. All four nodes of a pair move along
 * straight lines. Therefore a plane that separates the pair bounds its distance by linear functions, without a term
 * for arcs. */
#include "base/buffer.h"
#include "base/fail.h"
#include "base/threads.h"
#include "contact/advance/advance_rules.h"
#include "contact/advance/advance_workspace.h"
#include "contact/shapes/solid.h"

#include <math.h>
#include <string.h>

enum { FIRST_PAIRS = 1024, FIRST_OPEN = 256 };

/* ---- the broad phase */

typedef struct search {
    pliant_advance *advance;
    const double *from, *to;
    const pliant_advance_self *self;
    double margin;
    bool tests_crossings; /* test edges against triangles, too */
    int32_t crossings;
    uint8_t *crossing; /* Nullable */
    bool failed;       /* out of memory */
} search;

bool pliant_advance_is_exempt(const pliant_advance_self *self, int count, const int32_t *node, int first)
{
    const int32_t piece = self->piece ? self->piece[node[0]] : -1;
    bool exempt[2] = {false, false};
    for (int c = 0; self->exempt && c < count; c++) exempt[c >= first] = exempt[c >= first] || self->exempt[node[c]];
    return (exempt[0] && exempt[1]) || (piece >= 0 && piece == self->piece[node[count - 1]]);
}

static void position_at(const search *on, int32_t node, double t, double out[3])
{
    for (size_t d = 0; d < 3; d++)
        out[d] = on->from[3 * (size_t)node + d] + t * (on->to[3 * (size_t)node + d] - on->from[3 * (size_t)node + d]);
}

/* Return the distance of both sides along the direction between their centers: the smaller one of both ends of the leg.
 * It is a lower bound of the distance throughout the leg [m]. */
static double separation_of(const search *on, const int32_t node[4], int first)
{
    double x[2][4][3], normal[3];
    for (int c = 0; c < 4; c++) {
        memcpy(x[0][c], on->from + 3 * (size_t)node[c], sizeof x[0][c]);
        memcpy(x[1][c], on->to + 3 * (size_t)node[c], sizeof x[1][c]);
    }
    for (int d = 0; d < 3; d++) {
        double sums[2] = {0, 0};
        for (int c = 0; c < 4; c++) sums[c >= first] += x[0][c][d] + x[1][c][d];
        normal[d] = sums[0] / first - sums[1] / (4 - first);
    }
    const double size = pliant_length3(normal);
    double separation = INFINITY;
    for (int n = 0; n < 2; n++) {
        double lowest = INFINITY, highest = -INFINITY;
        for (int c = 0; c < 4; c++) {
            const double height = pliant_dot3(normal, x[n][c]);
            if (c < first)
                lowest = height < lowest ? height : lowest;
            else
                highest = height > highest ? height : highest;
        }
        separation = pliant_advance_lower(separation, lowest - highest);
    }
    return size > 0 ? separation / size : -INFINITY;
}

static void add(search *on, const int32_t node[4], bool edges, int32_t first, int32_t second)
{
    pliant_advance *advance = on->advance;
    const double separation = separation_of(on, node, edges ? 2 : 1);
    if (separation > on->margin || pliant_advance_is_exempt(on->self, 4, node, edges ? 2 : 1)) return;
    if (!pliant_reserve(&advance->self, &advance->max_self, advance->num_self, FIRST_PAIRS, sizeof *advance->self)) {
        on->failed = true;
        return;
    }
    pliant_advance_self_pair *pair = advance->self + advance->num_self++;
    *pair = (pliant_advance_self_pair){.is_edges = edges, .feature = {first, second}, .limit = separation};
    memcpy(pair->node, node, sizeof pair->node);
}

/* Test the nodes that triangle a owns against triangle b. */
static void try_nodes(search *on, int32_t a, int32_t b, const pliant_advance_box *box)
{
    const pliant_advance_tree *tree = &on->advance->tree;
    const int32_t *of = tree->triangles + 3 * (size_t)a, *triangle = tree->triangles + 3 * (size_t)b;
    const uint8_t owns = tree->owns[a];
    for (int k = 0; k < 3; k++) {
        const int32_t node[4] = {of[k], triangle[0], triangle[1], triangle[2]};
        if (!(owns & PLIANT_OWNS_NODE << k) || node[0] == node[1] || node[0] == node[2] || node[0] == node[3]) continue;
        const pliant_advance_box own = pliant_advance_box_of(1, node, on->from, on->to);
        if (!pliant_advance_boxes_separated(&own, box, on->margin)) add(on, node, false, a, b);
    }
}

static void try_edges(search *on, int32_t a, int32_t b, const pliant_advance_box *box)
{
    const pliant_advance_tree *tree = &on->advance->tree;
    const int32_t *of = tree->triangles + 3 * (size_t)a, *other = tree->triangles + 3 * (size_t)b;
    const uint8_t owns = tree->owns[a], other_owns = tree->owns[b];
    pliant_advance_box boxes[3];
    bool has_boxes = false;
    for (int k = 0; k < 3; k++) {
        const int32_t edge[2] = {of[k], of[(k + 1) % 3]};
        if (!(owns & PLIANT_OWNS_EDGE << k)) continue;
        const pliant_advance_box own = pliant_advance_box_of(2, edge, on->from, on->to);
        if (pliant_advance_boxes_separated(&own, box, on->margin)) continue;
        for (int m = 0; m < 3 && !has_boxes; m++) {
            const int32_t ends[2] = {other[m], other[(m + 1) % 3]};
            if (other_owns & PLIANT_OWNS_EDGE << m) boxes[m] = pliant_advance_box_of(2, ends, on->from, on->to);
        }
        has_boxes = true;
        for (int m = 0; m < 3; m++) {
            const int32_t node[4] = {edge[0], edge[1], other[m], other[(m + 1) % 3]};
            if (!(other_owns & PLIANT_OWNS_EDGE << m) || node[0] == node[2] || node[0] == node[3] ||
                node[1] == node[2] || node[1] == node[3])
                continue;
            if (!pliant_advance_boxes_separated(&own, boxes + m, on->margin))
                add(on, node, true, 3 * a + k, 3 * b + m);
        }
    }
}

static double volume(const double a[3], const double b[3], const double c[3], const double d[3])
{
    double p[3], q[3], r[3];
    for (int i = 0; i < 3; i++) {
        p[i] = b[i] - a[i];
        q[i] = c[i] - a[i];
        r[i] = d[i] - a[i];
    }
    return pliant_triple3(p, q, r);
}

bool pliant_segment_crosses_triangle(const double corner[3][3], const double end[2][3])
{
    const double below = volume(corner[0], corner[1], corner[2], end[0]),
                 above = volume(corner[0], corner[1], corner[2], end[1]);
    if (!(below * above < 0)) return false;
    int sides = 0;
    for (int c = 0; c < 3; c++) {
        const double side = volume(end[0], end[1], corner[c], corner[(c + 1) % 3]);
        sides += side > 0 ? 1 : side < 0 ? -1 : 0;
    }
    return sides == 3 || sides == -3;
}

static void try_crossing(search *on, const int32_t *of, uint8_t owns, const int32_t *triangle,
                         const pliant_advance_box *box)
{
    double corner[3][3], end[2][3];
    for (int k = 0; k < 3; k++) {
        const int32_t edge[2] = {of[k], of[(k + 1) % 3]};
        const int32_t both[5] = {edge[0], edge[1], triangle[0], triangle[1], triangle[2]};
        bool shares_node = false;
        for (int c = 0; c < 3; c++) shares_node = shares_node || triangle[c] == edge[0] || triangle[c] == edge[1];
        if (!(owns & PLIANT_OWNS_EDGE << k) || shares_node) continue;
        const pliant_advance_box own = pliant_advance_box_of(2, edge, on->from, on->from);
        if (pliant_advance_boxes_separated(&own, box, 0) || pliant_advance_is_exempt(on->self, 5, both, 2)) continue;
        for (int n = 0; n < 2; n++) position_at(on, edge[n], 0, end[n]);
        for (int c = 0; c < 3; c++) position_at(on, triangle[c], 0, corner[c]);
        if (!pliant_segment_crosses_triangle((const double(*)[3])corner, (const double(*)[3])end)) continue;
        for (int c = 0; on->crossing && c < 5; c++) on->crossing[both[c]] = 1;
        on->crossings++;
    }
}

/* Test the nodes and edges that two triangles own against each other. */
static void try_triangles(search *on, int32_t m, int32_t n)
{
    const pliant_advance_tree *tree = &on->advance->tree;
    const int32_t a = tree->order[m], b = tree->order[n], *one = tree->triangles + 3 * (size_t)a,
                  *other = tree->triangles + 3 * (size_t)b;
    const pliant_advance_box *boxes[2] = {tree->box + m, tree->box + n};
    if (pliant_advance_boxes_separated(boxes[0], boxes[1], on->margin)) return;
    if (on->tests_crossings && !pliant_advance_boxes_separated(boxes[0], boxes[1], 0)) {
        try_crossing(on, one, tree->owns[a], other, boxes[1]);
        try_crossing(on, other, tree->owns[b], one, boxes[0]);
    }
    try_nodes(on, a, b, boxes[1]);
    try_nodes(on, b, a, boxes[0]);
    try_edges(on, a, b, boxes[1]);
}

typedef struct couple {
    int32_t a, b;
} couple;

static void try_leaves(search *on, const couple *at)
{
    const pliant_advance_branch *a = on->advance->tree.branch + at->a, *b = on->advance->tree.branch + at->b;
    for (int32_t m = a->first; m < a->first + a->count; m++)
        for (int32_t n = at->a == at->b ? m + 1 : b->first; n < b->first + b->count; n++)
            try_triangles(on, m, n);
}

/* Visit all pairs of branches whose boxes are near, from the root down. */
static pliant_status find_pairs(search *on)
{
    enum { MAX_OPEN = 512 }; /* three for each level of both branches */
    const pliant_advance_tree *tree = &on->advance->tree;
    couple open[MAX_OPEN];
    int depth = 0;
    on->advance->num_self = 0;
    open[depth++] = (couple){0, 0};
    while (depth > 0 && !on->failed) {
        const couple at = open[--depth];
        const pliant_advance_branch *a = tree->branch + at.a, *b = tree->branch + at.b;
        if (at.a != at.b && pliant_advance_boxes_separated(tree->around + at.a, tree->around + at.b, on->margin))
            continue;
        if (a->child < 0 && b->child < 0)
            try_leaves(on, &at);
        else if (at.a == at.b) {
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
    return on->failed ? pliant_fail_memory("contact advance") : PLIANT_OK;
}

/* ---- one pair */

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

static void measure_pair(const search *on, const pliant_advance_self_pair *pair, double t, moment *out)
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
static double step_of(const search *on, const pliant_advance_self_pair *pair, const moment *now)
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
static bool step(const search *on, pliant_advance_self_pair *pair)
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

pliant_status pliant_advance_find_self(pliant_advance *advance, int32_t num_triangles, const int32_t *triangles,
                                       const double *from, const double *to, const pliant_advance_self *self,
                                       int num_threads, double *fraction)
{
    search on = {.advance = advance,
                 .from = from,
                 .to = to,
                 .self = self,
                 .margin = advance->settings.advance_stop * self->thickness};
    const int threads = pliant_threads_or_cores(num_threads);
    double smallest = 1;
    advance->num_self = 0;
    pliant_status status =
        num_triangles > 0
            ? pliant_advance_tree_update(&advance->tree, num_triangles, triangles, self->rest, from, to)
            : PLIANT_OK;
    if (status == PLIANT_OK && num_triangles > 0) status = find_pairs(&on);
    if (status == PLIANT_OK) status = pliant_advance_reserve_times(advance, advance->num_self);
    if (status != PLIANT_OK) return status;
    const bool parallel = threads > 1 && advance->num_self > 256;
#pragma omp parallel for schedule(static) num_threads(threads) if (parallel)
    for (int32_t n = 0; n < advance->num_self; n++) advance->self[n].ends = step(&on, advance->self + n);
    int32_t left = 0;
    for (int32_t n = 0; n < advance->num_self; n++)
        if (advance->self[n].t < 1) advance->pair_time[left++] = (pliant_advance_pair_time){advance->self[n].t, n};
    pliant_advance_sort(left, advance->pair_time);
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
    const search on = {.from = positions, .to = positions};
    moment now;
    measure_pair(&on, pair, 0, &now);
    return now.distance;
}

void pliant_advance_self_contact(const pliant_advance_self_pair *pair, const double *from, const double *to,
                                 double weight[4], double normal[3])
{
    const search on = {.from = from, .to = to};
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
    const search on = {.advance = advance, .from = from, .to = to, .self = self};
    pair->iterations = 0;
    pair->t = 0;
    for (pair->ends = false; !pair->ends;) pair->ends = step(&on, pair);
    return pair->t;
}

pliant_status pliant_advance_audit_self(pliant_advance *advance, int32_t num_triangles, const int32_t *triangles,
                                        const double *positions, const pliant_advance_self *self, uint8_t *crossing,
                                        int32_t *crossings)
{
    search on = {.advance = advance,
                 .from = positions,
                 .to = positions,
                 .self = self,
                 .margin = self->thickness,
                 .tests_crossings = crossing || crossings,
                 .crossing = crossing};
    advance->num_self = 0;
    pliant_status status =
        num_triangles > 0
            ? pliant_advance_tree_update(&advance->tree, num_triangles, triangles, self->rest, positions, positions)
            : PLIANT_OK;
    if (status == PLIANT_OK && num_triangles > 0) status = find_pairs(&on);
    if (status != PLIANT_OK) return status;
    if (crossings) *crossings = on.crossings;
    return PLIANT_OK;
}
