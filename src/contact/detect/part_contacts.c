/* Nearest points of rigid parts to nodes, edges and triangles of the tissue's surface. No tissue is in a part's
 * core at the start of a leg. Therefore the nearest point of the core determines the side on which the tissue is,
 * without memory of previous legs. */
#include "contact/advance/advance_rules.h"
#include "contact/detect/detector.h"
#include "base/threads.h"
#include "base/vector3.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A part and the tissue around it, while they are searched. */
typedef struct search {
    pliant_contact_detector *detector;
    const pliant_body *body;
    const double *positions;
    const pliant_contacts *before;
    bool blocked;
    int num_threads;
    const pliant_moving_part *part;
    pliant_part core;
    uint64_t part_key;
    int32_t triangles, edges, nodes;
} search;

/* ---- features of the triangles near a part */

enum { NODE_BITS = 26 /* bits per number in a key */ };
enum feature_kind { A_NODE, AN_EDGE, A_FACE, A_PLANE };

static uint64_t key_of(enum feature_kind kind, uint64_t a, uint64_t b)
{
    return (uint64_t)kind << (2 * NODE_BITS) | a << NODE_BITS | b;
}

static int compare_features(const void *a, const void *b)
{
    const uint64_t x = ((const pliant_feature *)a)->key, y = ((const pliant_feature *)b)->key;
    return (x > y) - (x < y);
}

static uint64_t face_key(int32_t triangle) { return key_of(A_FACE, (uint64_t)triangle, 0); }

static void add(double sum[3], const double v[3])
{
    for (int d = 0; d < 3; d++) sum[d] += v[d];
}

/* Compute the triangle's normal times twice its area. */
static void cross_of(const double *at, const int32_t *nodes, double out[3])
{
    double a[3], b[3];
    for (int d = 0; d < 3; d++) {
        a[d] = at[3 * nodes[1] + d] - at[3 * nodes[0] + d];
        b[d] = at[3 * nodes[2] + d] - at[3 * nodes[0] + d];
    }
    for (int d = 0; d < 3; d++) out[d] = a[(d + 1) % 3] * b[(d + 2) % 3] - a[(d + 2) % 3] * b[(d + 1) % 3];
}

/* Return the index of a node's feature, which is added if it is new. Its slot then has any value (sparse set: Briggs
 * and Torczon, ACM LOPLAS 2:59, 1993). */
static int32_t node_at(search *on, int32_t node)
{
    pliant_contact_detector *detector = on->detector;
    int32_t *slot = detector->slot + node;
    if (*slot < on->nodes && detector->node[*slot].node[0] == node) return *slot;
    detector->node[on->nodes] = (pliant_feature){
        .key = key_of(A_NODE, (uint64_t)node, 0), .count = 1, .node = {node}, .weight = {1}, .next_edge = -1};
    return *slot = on->nodes++;
}

/* Return the index of the edge between two nodes, which is added if it is new. Each node lists its edges to higher
 * nodes. */
static int32_t edge_between(search *on, int32_t a, int32_t b)
{
    pliant_contact_detector *detector = on->detector;
    const int32_t low = a < b ? a : b, high = a < b ? b : a;
    int32_t *first = &detector->node[node_at(on, low)].next_edge;
    for (int32_t e = *first; e >= 0; e = detector->edge[e].next_edge)
        if (detector->edge[e].node[1] == high) return e;
    detector->edge[on->edges] = (pliant_feature){
        .key = key_of(AN_EDGE, (uint64_t)low, (uint64_t)high), .count = 2, .node = {low, high}, .next_edge = *first};
    return *first = on->edges++;
}

/* List the nodes, edges and triangles near the part, with their normals. */
static void gather(search *on)
{
    pliant_contact_detector *detector = on->detector;
    on->nodes = on->edges = 0;
    for (int32_t t = 0; t < on->triangles; t++) {
        const int32_t *nodes = on->body->triangles + 3 * (size_t)detector->triangle[t];
        pliant_feature *face = detector->face + t;
        *face = (pliant_feature){
            .key = face_key(detector->triangle[t]), .count = 3, .node = {nodes[0], nodes[1], nodes[2]}};
        cross_of(on->positions, nodes, face->outwards);
        for (int v = 0; v < 3; v++) {
            const int32_t edge = edge_between(on, nodes[v], nodes[(v + 1) % 3]);
            detector->edge_of[3 * t + v] = edge;
            add(detector->edge[edge].outwards, face->outwards);
            add(detector->node[node_at(on, nodes[v])].outwards, face->outwards);
        }
    }
}

/* ---- nearest point of a part to a feature */

static bool is_held(const pliant_moving_part *part, int32_t node)
{
    int32_t low = 0, high = part->num_held;
    while (low < high) {
        const int32_t middle = (low + high) / 2;
        if (part->held[middle] < node) low = middle + 1;
        else high = middle;
    }
    return low < part->num_held && part->held[low] == node;
}

/* Held features, and fixed tissue against fixed obstacles, have no contact. */
static bool is_excluded(const search *on, const pliant_feature *of)
{
    bool held = true, fixed = on->part->kind != PLIANT_OBSTACLE_TOOL;
    for (int32_t k = 0; k < of->count; k++) {
        held = held && is_held(on->part, of->node[k]);
        fixed = fixed && on->body->fine_fixed[of->node[k]] == PLIANT_FIXED_AT_REST;
    }
    return held || fixed;
}

/* Return the distance of a feature from the part's surface at a pose. normal: out of the core, in the part's frame */
static double distance_of(const search *on, const pliant_pose *pose, pliant_feature *of, double enough,
                          double normal[3])
{
    double local[3][3];
    const double beyond = enough + on->part->guard;
    for (int32_t k = 0; k < of->count; k++) pliant_pose_from(pose, on->positions + 3 * (size_t)of->node[k], local[k]);
    const double distance = of->count == 1 ? pliant_part_distance(&on->core, local[0], normal)
                            : of->count == 2
                                ? pliant_edge_minimum(&on->core, (const double(*)[3])local, beyond, of->weight, normal)
                                : pliant_face_minimum(&on->core, (const double(*)[3])local, beyond, of->weight, normal);
    return distance - on->part->guard;
}

static void point_of(const search *on, const pliant_feature *of, double out[3])
{
    for (int d = 0; d < 3; d++) {
        out[d] = 0;
        for (int32_t k = 0; k < of->count; k++)
            out[d] += of->weight[k] * on->positions[3 * (size_t)of->node[k] + (size_t)d];
    }
}

static void pose_at(const pliant_moving_part *part, double fraction, pliant_pose *out)
{
    *out = fraction > 0 ? part->end : part->begin;
    if (!(fraction > 0 && fraction < 1)) return;
    const pliant_tool_pose between = pliant_tool_pose_between(&part->from, &part->to, fraction);
    pliant_part_pose(part->shape, part->part->frame, between.tip, between.rotation, between.jaw, out);
}

/* Find the first pose on the part's motion at which it meets the feature, by conservative advancement. The feature
 * stays at its position. If they do not meet, use the end of the leg. Return the distance there, or more than the
 * margin. */
static double find_first_contact(const search *on, pliant_feature *of, pliant_pose *pose, double normal[3])
{
    enum { MAX_STEPS = 64 };
    const pliant_moving_part *part = on->part;
    const double met = pliant_advance_min_distance(&on->detector->settings, part->guard);
    double fraction = part->max_motion > 0 ? 0 : 1;
    for (int step = 0;; step++) {
        if (step == MAX_STEPS) fraction = 1;
        pose_at(part, fraction, pose);
        const double distance = distance_of(on, pose, of, fraction < 1 ? met : part->margin, normal);
        if (distance <= met || fraction >= 1) return distance;
        fraction = fmin(fraction + distance / part->max_motion, 1);
    }
}

/* A part that slides along a feature or presses on it is on the same side of it at the end of the leg. Then use its
 * nearest point at the end. */
static void advance_to_end(const search *on, pliant_feature *of, pliant_pose *pose, double normal[3], double *distance)
{
    const pliant_moving_part *part = on->part;
    pliant_feature there = *of;
    double turned[3], first[3], last[3];
    const double end_distance = distance_of(on, &part->end, &there, part->margin, turned);
    pliant_pose_turn(pose, normal, first);
    pliant_pose_turn(&part->end, turned, last);
    if (!(end_distance <= part->margin) || !(pliant_dot3(first, last) > on->detector->settings.same_cosine)) return;
    *of = there;
    *pose = part->end;
    memcpy(normal, turned, 3 * sizeof *normal);
    *distance = end_distance;
}

/* Move the part's nearest point and normal with the part to the end of the leg. A penetration depth at the start of
 * the leg is reduced gradually, in part by a motion of the part's surface. */
static void carry_to_end(const search *on, pliant_feature *of, const double point[3], const double normal[3],
                         const double place[3])
{
    const pliant_moving_part *part = on->part;
    double before[3], world[3], gap = 0;
    pliant_pose_turn(&part->end, normal, of->normal);
    pliant_pose_to(&part->end, place, of->place);
    pliant_pose_turn(&part->begin, normal, world);
    pliant_pose_to(&part->begin, place, before);
    for (int d = 0; d < 3; d++) gap += world[d] * (point[d] - before[d]);
    const double waits = pliant_contact_permitted_gap(gap, part->recovery, part->remaining_depth_fraction);
    of->gap = 0;
    for (int d = 0; d < 3; d++) {
        of->drift[d] = of->place[d] - before[d];
        of->drift[d] += part->pushed_depth_fraction * (waits - fmin(gap, 0)) * of->normal[d];
        of->place[d] += waits * of->normal[d];
        of->gap += of->normal[d] * (point[d] - of->place[d]);
    }
    of->is_in_contact = true;
}

/* Tissue at the center of a core has no distance gradient. Use the tissue's own normal as the direction out of the
 * part. Return false if the normal is 0. */
static bool orient_outwards(const search *on, const pliant_pose *pose, const pliant_feature *of, const double local[3],
                            double normal[3], double place[3])
{
    const double area = pliant_length3(of->outwards);
    if (!(area > 0)) return false;
    pliant_pose_turn_back(pose, of->outwards, normal);
    for (int d = 0; d < 3; d++) normal[d] /= -area;
    pliant_part_exit_point(on->part->part, local, normal, place);
    return true;
}

static void measure_feature(const search *on, pliant_feature *of)
{
    const pliant_moving_part *part = on->part;
    double normal[3], world[3], point[3], local[3], place[3];
    pliant_pose pose;
    of->gap = INFINITY;
    if (is_excluded(on, of)) return;
    double distance = find_first_contact(on, of, &pose, normal);
    if (!(distance <= part->margin)) {
        if (of->count == 1) of->gap = distance;
        return;
    }
    if (part->max_motion > 0) advance_to_end(on, of, &pose, normal, &distance);
    point_of(on, of, point);
    pliant_pose_from(&pose, point, local);
    const bool nowhere = pliant_dot3(normal, normal) < 0.5;
    pliant_pose_turn(&pose, normal, world);
    if (!nowhere &&
        pliant_dot3(world, of->outwards) > on->detector->settings.facing_cosine * pliant_length3(of->outwards))
        return;
    for (int d = 0; d < 3; d++) place[d] = local[d] - distance * normal[d];
    if (nowhere && !orient_outwards(on, &pose, of, local, normal, place)) return;
    carry_to_end(on, of, point, normal, place);
}

/* ---- features that get contact points */

/* Return the contact point of the feature in the previous leg, if it had a force; otherwise NULL. */
static const pliant_contact_point *pressed_before(const search *on, const pliant_feature *of)
{
    const uint64_t key = on->part_key << 56 | of->key;
    const pliant_contacts *before = on->before;
    int32_t low = 0, high = before ? before->count : 0;
    while (low < high) {
        const int32_t middle = (low + high) / 2;
        if (before->point[middle].feature < key) low = middle + 1;
        else high = middle;
    }
    return before && low < before->count && before->point[low].feature == key && before->point[low].was_pressed
               ? before->point + low
               : NULL;
}

/* Return the gap of an adjacent feature if its normal is nearly the same. Otherwise return INFINITY, because its
 * contact point cannot replace this one. */
static double gap_of(const search *on, const pliant_feature *border, const pliant_feature *of)
{
    return border->is_in_contact && pliant_dot3(border->normal, of->normal) > on->detector->settings.same_cosine
               ? border->gap
               : INFINITY;
}

/* Return the difference of depths below which a point does not replace another one. */
static double sag_of(const search *on)
{
    const pliant_contact_settings *settings = &on->detector->settings;
    return fmin(settings->max_sag, settings->hysteresis * (on->part->guard - on->part->core_offset));
}

/* An edge or triangle gets a point if it is deeper than its adjacent features by `sag`. An existing point stays
 * until it is higher than these by `sag`. */
static void keep_if_deeper(const search *on, pliant_feature *of, double gap)
{
    const double sag = sag_of(on);
    of->is_in_contact = of->is_in_contact && of->gap < gap + (pressed_before(on, of) ? sag : -sag);
    if (!of->is_in_contact) of->gap = INFINITY;
}

static void keep_deeper(const search *on)
{
    pliant_contact_detector *detector = on->detector;
    for (int32_t e = 0; e < on->edges; e++) {
        pliant_feature *edge = detector->edge + e;
        const pliant_feature *ends[2] = {detector->node + detector->slot[edge->node[0]],
                                         detector->node + detector->slot[edge->node[1]]};
        if (edge->is_in_contact) keep_if_deeper(on, edge, fmin(gap_of(on, ends[0], edge), gap_of(on, ends[1], edge)));
    }
    for (int32_t t = 0; t < on->triangles; t++) {
        pliant_feature *face = detector->face + t;
        double gap = INFINITY;
        if (!face->is_in_contact) continue;
        for (int v = 0; v < 3; v++)
            gap = fmin(gap, fmin(gap_of(on, detector->node + detector->slot[face->node[v]], face),
                                 gap_of(on, detector->edge + detector->edge_of[3 * t + v], face)));
        keep_if_deeper(on, face, gap);
    }
}

/* Return the distance of a point of a feature from the core at the end of the leg. */
static double core_distance(const search *on, const pliant_feature *of, const double *weight)
{
    pliant_feature there = *of;
    double point[3], local[3], normal[3];
    for (int32_t k = 0; k < of->count; k++) there.weight[k] = weight[k];
    point_of(on, &there, point);
    pliant_pose_from(&on->part->end, point, local);
    return pliant_part_distance(&on->core, local, normal);
}

/* Delay the motion of a pressed point along its edge or triangle. On coarse cells, the triangle turns about the point
 * under its force. The part's nearest point then overshoots, and alternates between two places in successive legs. So a
 * point stays until the nearest one is deeper by the fraction `hysteresis` of the sag. If points stay within the whole
 * sag, the force of a ball of 20 mm on hexahedra of 10 mm is 5 % too small (bench_force).
 * A point below a moving part lags by the motion over the fraction `follow`, so shorter ways have no delay, and none in
 * tissue with inertia. The plane of the nearest point stays, and is parallel to the feature there. */
static void delay_point(const search *on, pliant_feature *of)
{
    const double follow = on->detector->settings.point_follow, fast = on->part->max_motion / follow;
    const pliant_contact_point *before = of->is_in_contact && !on->body->has_inertia ? pressed_before(on, of) : NULL;
    double shift[3] = {0, 0, 0}, local[3], at_begin[3];
    if (!before || before->on_feature[0] + before->on_feature[1] + before->on_feature[2] == 0) return;
    for (int32_t k = 0; k < of->count; k++)
        for (int d = 0; d < 3; d++)
            shift[d] += (before->on_feature[k] - of->weight[k]) * on->positions[3 * (size_t)of->node[k] + (size_t)d];
    const double way = pliant_length3(shift), across = pliant_dot3(shift, of->normal);
    if (!(way > fast)) return;
    const double higher = core_distance(on, of, before->on_feature) - core_distance(on, of, of->weight);
    const bool stays = higher < on->detector->settings.hysteresis * sag_of(on);
    const double fraction = (stays ? 1 : 1 - follow) * (1 - fast / way);
    if (fraction * way > on->detector->settings.hysteresis * on->part->guard) on->detector->has_delayed = true;
    for (int32_t k = 0; k < of->count; k++) of->weight[k] += fraction * (before->on_feature[k] - of->weight[k]);
    for (int d = 0; d < 3; d++) shift[d] = fraction * (shift[d] - across * of->normal[d]);
    pliant_pose_turn_back(&on->part->end, shift, local);
    pliant_pose_turn(&on->part->begin, local, at_begin);
    for (int d = 0; d < 3; d++) {
        of->place[d] += shift[d];
        of->drift[d] += shift[d] - at_begin[d];
    }
}

/* Divide each triangle's area equally among its corners, and its edges and itself if they have contact. */
static void share_areas(const search *on)
{
    pliant_contact_detector *detector = on->detector;
    for (int32_t t = 0; t < on->triangles; t++) {
        pliant_feature *face = detector->face + t, *of[7] = {face};
        int count = face->is_in_contact;
        double cross[3];
        for (int v = 0; v < 3; v++) {
            pliant_feature *edge = detector->edge + detector->edge_of[3 * t + v];
            of[count] = edge;
            count += edge->is_in_contact;
        }
        for (int v = 0; v < 3; v++) of[count++] = detector->node + detector->slot[face->node[v]];
        cross_of(on->body->fine.rest, face->node, cross);
        for (int n = 0; n < count; n++) of[n]->area += 0.5 * pliant_length3(cross) / count;
    }
}

/* ---- output */

static int32_t jaw_of(const pliant_moving_part *part)
{
    const pliant_part_frame frame = part->part->frame;
    return part->kind != PLIANT_OBSTACLE_TOOL ? 0
           : frame == PLIANT_FRAME_JAW_PLUS   ? 1
           : frame == PLIANT_FRAME_JAW_MINUS  ? -1
                                              : 0;
}

static void write(const search *on, const pliant_feature *of, pliant_contact_point *out)
{
    *out = (pliant_contact_point){
        .feature = on->part_key << 56 | of->key,
        .kind = on->part->kind,
        .tool = on->part->kind == PLIANT_OBSTACLE_TOOL ? on->part->tool : -1,
        .part = on->part->index,
        .count = of->count,
        .area = of->area,
        .friction = on->part->friction,
        .jaw = jaw_of(on->part),
    };
    for (int32_t k = 0; k < of->count; k++) {
        out->node[k] = of->node[k];
        out->weight[k] = out->on_feature[k] = of->weight[k];
    }
    memcpy(out->normal, of->normal, sizeof of->normal);
    memcpy(out->place, of->place, sizeof of->place);
    memcpy(out->drift, of->drift, sizeof of->drift);
}

/* Keep and sort the features with contact. Return their number. */
static int32_t compact(pliant_feature *features, int32_t count)
{
    int32_t left = 0;
    for (int32_t n = 0; n < count; n++)
        if (features[n].is_in_contact) features[left++] = features[n];
    if (left > 0) qsort(features, (size_t)left, sizeof *features, compare_features);
    return left;
}

/* Add a plane constraint: all corners of a triangle stay beyond the plane that separates it from the core. Such
 * planes are a convex inner approximation of the free states, so the next leg passes the pair that blocked the last
 * one. Far from the core the plane is slightly nearer to the core than the triangle. Near the core it is slightly
 * farther if depths are reduced in this leg, so that it pushes the triangle out. */
static void write_plane(const search *on, const pliant_feature *face, double distance, int32_t triangle,
                        const double normal[3], pliant_contacts *out)
{
    const pliant_moving_part *part = on->part;
    const double step = on->detector->settings.advance_keep, left = part->guard - part->core_offset,
                 core = distance + left, minimum = 0.5 * on->detector->settings.plane_distance * left;
    /* offset of the plane from the triangle's nearest point */
    const double away = core < minimum ? (part->recovery > 0 ? step * left : 0) : -step * core;
    double point[3], local[3], place[3], before[3];
    point_of(on, face, point);
    pliant_pose_from(&part->begin, point, local);
    for (int d = 0; d < 3; d++) place[d] = local[d] + away * normal[d];
    pliant_pose_to(&part->begin, place, before);
    for (int v = 0; v < 3; v++) {
        pliant_contact_point *to = out->point + out->count++;
        *to = (pliant_contact_point){.feature = on->part_key << 56 | key_of(A_PLANE, (uint64_t)triangle, (uint64_t)v),
                                     .kind = part->kind,
                                     .tool = part->kind == PLIANT_OBSTACLE_TOOL ? part->tool : -1,
                                     .part = part->index,
                                     .count = 1,
                                     .node = {face->node[v]},
                                     .weight = {1},
                                     .jaw = jaw_of(part)};
        pliant_pose_turn(&part->end, normal, to->normal);
        pliant_pose_to(&part->end, place, to->place);
        for (int d = 0; d < 3; d++) to->drift[d] = to->place[d] - before[d];
    }
}

static void add_planes(const search *on, pliant_contacts *out)
{
    pliant_contact_detector *detector = on->detector;
    for (int32_t t = 0; t < on->triangles; t++) {
        const int32_t triangle = detector->triangle[t], *nodes = on->body->triangles + 3 * (size_t)triangle;
        pliant_feature face = {.count = 3, .node = {nodes[0], nodes[1], nodes[2]}};
        double normal[3];
        if (is_excluded(on, &face)) continue;
        const double left = on->part->guard - on->part->core_offset,
                     distance = distance_of(on, &on->part->begin, &face, 0, normal), core = distance + left;
        if (core > detector->settings.plane_distance * left || !(core > 0) || pliant_dot3(normal, normal) < 0.5)
            continue;
        write_plane(on, &face, distance, triangle, normal, out);
    }
}

/* Append the points of a part, sorted by feature. Planes are last because their kind is the highest. */
static pliant_status append(search *on, pliant_contacts *out)
{
    pliant_contact_detector *detector = on->detector;
    pliant_feature *const kinds[] = {detector->node, detector->edge, detector->face};
    const int32_t counts[] = {compact(detector->node, on->nodes), compact(detector->edge, on->edges),
                              compact(detector->face, on->triangles)};
    const int32_t total = counts[0] + counts[1] + counts[2] + 3 * on->triangles;
    pliant_status status = total > 0 ? pliant_contacts_reserve(out, out->count + total) : PLIANT_OK;
    for (int kind = 0; kind < 3 && status == PLIANT_OK; kind++)
        for (int32_t n = 0; n < counts[kind]; n++) write(on, kinds[kind] + n, out->point + out->count++);
    if (status == PLIANT_OK && on->blocked) add_planes(on, out);
    return status;
}

/* Return a feature by its number: nodes first, then edges and triangles. */
static pliant_feature *feature_at(const search *on, int32_t n)
{
    const int32_t edge = n - on->nodes, face = edge - on->edges;
    return edge < 0 ? on->detector->node + n : face < 0 ? on->detector->edge + edge : on->detector->face + face;
}

static void measure_all(search *on)
{
    const int32_t several = 256; /* fewer are faster on one thread */
    const int32_t count = on->nodes + on->edges + on->triangles;
    pliant_contact_detector *detector = on->detector;
#pragma omp parallel for schedule(dynamic, 16) num_threads(on->num_threads) if (count > several)
    for (int32_t n = 0; n < count; n++) measure_feature(on, feature_at(on, n));
    keep_deeper(on);
    for (int32_t e = 0; e < on->edges; e++) delay_point(on, detector->edge + e);
    for (int32_t t = 0; t < on->triangles; t++) delay_point(on, detector->face + t);
    share_areas(on);
}

static uint64_t part_key_of(const pliant_moving_part *part)
{
    return part->kind == PLIANT_OBSTACLE_TOOL ? (uint64_t)(PLIANT_MAX_PARTS * part->tool + part->index)
                                              : 128 + (uint64_t)part->index;
}

bool pliant_contact_has_delayed(const pliant_contact_detector *detector) { return detector->has_delayed; }

pliant_status pliant_contact_find(pliant_contact_detector *detector, const pliant_body *body, const double *positions,
                                  const pliant_contacts *before, bool blocked, int32_t count,
                                  const pliant_moving_part *parts, int num_threads, pliant_contacts *out)
{
    detector->has_delayed = false;
    if (count == 0) return PLIANT_OK;
    pliant_status status = pliant_broad_find_all(&detector->broad, body, positions, count, parts, detector->finder);
    if (status == PLIANT_OK) status = pliant_contact_detector_reserve(detector, body);
    for (int32_t p = 0; p < count && status == PLIANT_OK; p++) {
        search on = {.detector = detector,
                     .body = body,
                     .positions = positions,
                     .before = before,
                     .blocked = blocked,
                     .num_threads = pliant_threads_or_cores(num_threads),
                     .part = parts + p,
                     .part_key = part_key_of(parts + p)};
        on.core = pliant_part_core(on.part->part, on.part->guard);
        on.triangles = pliant_broad_find(&detector->broad, on.part, detector->triangle);
        gather(&on);
        measure_all(&on);
        status = append(&on, out);
    }
    return status;
}
