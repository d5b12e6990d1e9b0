#include "contact/detect/finder.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* an edge or a triangle counts where it is deeper than what borders it by this part of its size, of the part's depth, and by this much [m] */
static const double sag_of_size = 0.02, sag_of_depth = 0.1, most_sag = 5e-5;
static const double still_deep = 1e-4; /* [m] beyond a point of the last step: it holds on */
static const double turns_away = 0.5; /* cosine of how far a part may turn with tissue before it: beyond, that slips off it */
static const double comes_by = 0.3; /* cosine of how far the nearest normal of a part may turn in a step by which it does not meet tissue: beyond, it has gone past it */
static const double aslant = -0.7; /* cosine likewise, above which a part that is deepest in the middle of a triangle meets it with an edge or a corner */
static const double deep = 0.3, same_way = 0.7; /* of a part's depth, below which another side may be nearer than that which tissue came in by; cosine between the two */
static const double behind = 0.25; /* cosine between the part's normal and the tissue's, beyond which the part is behind the surface */
static const double skew = 0.1; /* cosine between the part's normal and the tissue's, of a flat surface over -1, from which on a part comes by at its side */

/* ---- features of the triangles near a part */

enum { NODE_BITS = PLIANT_NODE_BITS, POINT_BITS = 2 /* of a feature there may be more than one point */ };
enum feature_kind { A_NODE, AN_EDGE, A_FACE };

static uint64_t key_of(enum feature_kind kind, uint64_t a, uint64_t b) { return (uint64_t)kind << (2 * NODE_BITS) | a << NODE_BITS | b; }

static int compare_features(const void *a, const void *b)
{
    const uint64_t x = ((const pliant_feature *)a)->key, y = ((const pliant_feature *)b)->key;
    return (x > y) - (x < y);
}

/* sort, and leave out what is there twice. @return how many are left */
static int32_t sort_keys(uint64_t *keys, int32_t count)
{
    int32_t left = 0;
    if (count > 0) qsort(keys, (size_t)count, sizeof *keys, pliant_compare_keys);
    for (int32_t k = 0; k < count; k++)
        if (k == 0 || keys[k] != keys[k - 1]) keys[left++] = keys[k];
    return left;
}

static uint64_t edge_key(int32_t a, int32_t b) { return a < b ? key_of(AN_EDGE, (uint64_t)a, (uint64_t)b) : key_of(AN_EDGE, (uint64_t)b, (uint64_t)a); }

/* by its two lowest nodes, and whether they follow each other outwards: the other triangle of their edge has them the other way round */
static uint64_t face_key(const int32_t *nodes)
{
    int first = 0, last = 0;
    for (int v = 1; v < 3; v++) {
        if (nodes[v] < nodes[first]) first = v;
        if (nodes[v] > nodes[last]) last = v;
    }
    const int second = 3 - first - last;
    return key_of(A_FACE, (uint64_t)nodes[first], (uint64_t)nodes[second]) + ((uint64_t)(second != (first + 1) % 3) << (2 * NODE_BITS));
}

static void add(double sum[3], const double v[3])
{
    for (int d = 0; d < 3; d++) sum[d] += v[d];
}

/* the triangle's normal, as long as twice its area */
static void cross_of(const double *at, const int32_t *nodes, double out[3])
{
    double a[3], b[3];
    for (int d = 0; d < 3; d++) {
        a[d] = at[3 * nodes[1] + d] - at[3 * nodes[0] + d];
        b[d] = at[3 * nodes[2] + d] - at[3 * nodes[0] + d];
    }
    for (int d = 0; d < 3; d++) out[d] = a[(d + 1) % 3] * b[(d + 2) % 3] - a[(d + 2) % 3] * b[(d + 1) % 3];
}

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* of triangles: 1 */
static void find_flatness(const pliant_search *on)
{
    pliant_finder *finder = on->finder;
    for (int32_t t = 0; t < on->triangles; t++) {
        pliant_feature *face = finder->face + t;
        const double area = sqrt(dot(face->outwards, face->outwards));
        face->flat = 1;
        for (int v = 0; v < 3; v++) {
            finder->node[finder->slot[face->node[v]]].flat += area;
            finder->edge[finder->edge_of[3 * t + v]].flat += area;
        }
    }
    for (int32_t n = 0; n < on->nodes + on->edges; n++) {
        pliant_feature *of = n < on->nodes ? finder->node + n : finder->edge + (n - on->nodes);
        of->flat = of->flat > 0 ? sqrt(dot(of->outwards, of->outwards)) / of->flat : 0;
    }
}

void pliant_search_gather(pliant_search *on)
{
    pliant_finder *finder = on->finder;
    uint64_t *order = finder->order;
    for (int32_t t = 0; t < on->triangles; t++)
        for (int v = 0; v < 3; v++) order[3 * t + v] = (uint64_t)on->body->triangles[3 * finder->triangle[t] + v];
    on->nodes = sort_keys(order, 3 * on->triangles);
    for (int32_t n = 0; n < on->nodes; n++) {
        finder->node[n] = (pliant_feature){.key = key_of(A_NODE, order[n], 0) << POINT_BITS, .count = 1, .node = {(int32_t)order[n]}, .weight = {1}};
        finder->slot[order[n]] = n;
    }
    for (int32_t t = 0; t < on->triangles; t++) {
        const int32_t *nodes = on->body->triangles + 3 * finder->triangle[t];
        finder->face[t] = (pliant_feature){.key = face_key(nodes) << POINT_BITS, .count = 3, .node = {nodes[0], nodes[1], nodes[2]}};
        for (int v = 0; v < 3; v++) order[3 * t + v] = edge_key(nodes[v], nodes[(v + 1) % 3]);
    }
    on->edges = sort_keys(order, 3 * on->triangles);
    for (int32_t e = 0; e < on->edges; e++) {
        const uint64_t mask = ((uint64_t)1 << NODE_BITS) - 1;
        finder->edge[e] = (pliant_feature){.key = order[e] << POINT_BITS, .count = 2, .node = {(int32_t)(order[e] >> NODE_BITS & mask), (int32_t)(order[e] & mask)}};
    }
    for (int32_t t = 0; t < on->triangles; t++) {
        pliant_feature *face = finder->face + t;
        cross_of(on->positions, face->node, face->outwards);
        for (int v = 0; v < 3; v++) {
            const uint64_t key = edge_key(face->node[v], face->node[(v + 1) % 3]);
            const uint64_t *found = bsearch(&key, order, (size_t)on->edges, sizeof key, pliant_compare_keys);
            finder->edge_of[3 * t + v] = (int32_t)(found - order);
            add(finder->node[finder->slot[face->node[v]]].outwards, face->outwards);
            add(finder->edge[found - order].outwards, face->outwards);
        }
    }
    if (on->part->briefly) find_flatness(on);
}

/* ---- where a part meets a feature */

uint64_t pliant_search_key(const pliant_moving_part *part)
{
    return part->kind == PLIANT_OBSTACLE_TOOL ? (uint64_t)(PLIANT_MAX_PARTS * part->tool + part->index) : 128 + (uint64_t)part->index;
}

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

bool pliant_search_leaves_out(const pliant_search *on, const pliant_feature *of)
{
    bool held = true, fixed = true;
    for (int32_t k = 0; k < of->count; k++) {
        held = held && is_held(on->part, of->node[k]);
        fixed = fixed && on->body->fine_fixed[of->node[k]] == PLIANT_FIXED_AT_REST;
    }
    return held || fixed;
}

bool pliant_search_remembers(const pliant_search *on, const pliant_feature *of, double normal[3])
{
    const pliant_finder *finder = on->finder;
    memset(normal, 0, 3 * sizeof *normal);
    if (!on->part->remembers || finder->num_sides == 0) return false;
    for (int32_t k = 0; k < of->count; k++) {
        const uint64_t key = pliant_side_key(on->part_key, of->node[k]);
        const pliant_side *found = bsearch(&key, finder->sides, (size_t)finder->num_sides, sizeof *found, pliant_compare_keys);
        for (int d = 0; found && d < 3; d++) normal[d] += of->weight[k] * found->normal[d];
    }
    const double size = sqrt(dot(normal, normal));
    for (int d = 0; size > 0 && d < 3; d++) normal[d] /= size;
    return size > 0;
}

double pliant_search_distance(const pliant_search *on, pliant_feature *of, const pliant_pose *pose, double share, double enough, double normal[3])
{
    double local[3][3];
    for (int32_t k = 0; k < of->count; k++) {
        const double *from = on->positions + 3 * (size_t)of->node[k], *to = on->to ? on->to + 3 * (size_t)of->node[k] : from;
        double at[3];
        for (int d = 0; d < 3; d++) at[d] = from[d] + share * (to[d] - from[d]);
        pliant_pose_from(pose, at, local[k]);
    }
    if (of->count == 1) return pliant_part_distance(on->part->part, local[0], normal);
    return of->count == 2 ? pliant_edge_minimum(on->part->part, (const double(*)[3])local, enough, of->weight, normal)
                          : pliant_face_minimum(on->part->part, (const double(*)[3])local, enough, of->weight, normal);
}

/* Whether a triangle is nearest in its inside. On its border an edge or a node is what is met, of which the triangle's own normal says nothing. */
static bool is_inside(const pliant_feature *of)
{
    const double border = 1e-3;
    return of->count == 3 && of->weight[0] > border && of->weight[1] > border && of->weight[2] > border;
}

bool pliant_search_is_flush(const pliant_feature *of, double distance, const double world[3])
{
    const double flush = 1e-5; /* [m] */
    return is_inside(of) && fabs(distance) < flush && dot(world, of->outwards) > aslant * sqrt(dot(of->outwards, of->outwards));
}

bool pliant_search_is_stuck(const pliant_search *on, const pliant_feature *of)
{
    const double least = 0.1;
    double moves = 0;
    for (int32_t k = 0; k < of->count; k++)
        if (on->body->fine_fixed[of->node[k]] != PLIANT_FIXED_AT_REST) moves += of->weight[k];
    return moves < least;
}

bool pliant_search_misleads(const pliant_search *on, double distance, double cosine)
{
    return cosine < 0 || (cosine < same_way && -distance > deep * pliant_part_depth(on->part->part));
}

bool pliant_search_is_behind(const pliant_feature *of, const double world[3])
{
    return dot(world, of->outwards) > behind * sqrt(dot(of->outwards, of->outwards));
}

/* Whether the part has the feature at its side, and not before it, by a normal of the part there. Where steps are taken in parts it has come no further than that, and the tissue's own
 * normal says which way is out; the more of an edge or a corner a feature is, the further round parts may meet it. */
static bool comes_aside(const pliant_search *on, const pliant_feature *of, const double world[3])
{
    const double area = sqrt(dot(of->outwards, of->outwards));
    return on->part->briefly && area > 0 && dot(world, of->outwards) > (skew - of->flat) * area;
}

/* The part meets the feature in a pose: from there on, the tissue stays on this side. false: the part leaves it, or is behind the surface: *through. */
static bool meet(const pliant_search *on, pliant_feature *of, int32_t p, double distance, double normal[3], bool *through)
{
    const pliant_moving_part *part = on->part;
    const pliant_pose *pose = part->pose + p, *end = part->pose + part->num_poses - 1;
    double point[3] = {0, 0, 0}, local[3], place[3], before[3], kept[3], world[3];
    if (pliant_search_is_stuck(on, of)) return false;
    for (int32_t k = 0; k < of->count; k++)
        for (int d = 0; d < 3; d++) point[d] += of->weight[k] * on->positions[3 * of->node[k] + d];
    pliant_pose_from(pose, point, local);
    const double area = sqrt(dot(of->outwards, of->outwards));
    const bool known = pliant_search_remembers(on, of, kept);
    pliant_pose_turn(pose, normal, world);
    const bool on_its_way = p < part->num_poses - 1; /* the tissue's own normal counts then */
    const bool sharp = on_its_way && is_inside(of) && distance < 0 && dot(world, of->outwards) > aslant * area;
    const bool nowhere = dot(normal, normal) < 0.5 || sharp || pliant_search_is_flush(of, distance, world);
    const bool aside = comes_aside(on, of, world);
    if (aside && distance > 0 && of->count < 3) return false;
    const bool astray = aside && distance < 0 && (known || !pliant_search_is_behind(of, world));
    if (!astray && known && distance < 0 && (nowhere || pliant_search_misleads(on, distance, dot(normal, kept)))) {
        memcpy(normal, kept, sizeof kept);
        pliant_part_leave(part->part, local, normal, place);
    } else if (astray || nowhere) {
        if (area == 0) return false;
        pliant_pose_turn_back(pose, of->outwards, normal);
        for (int d = 0; d < 3; d++) normal[d] /= -area;
        pliant_part_leave(part->part, local, normal, place);
    } else if (distance < 0) {
        pliant_part_leave(part->part, local, normal, place);
    } else
        for (int d = 0; d < 3; d++) place[d] = local[d] - distance * normal[d];
    pliant_pose_turn(pose, normal, world);
    *through = (!known || (distance > 0 && dot(normal, kept) < 0)) && pliant_search_is_behind(of, world);
    if (*through) return false;
    pliant_pose_turn(end, normal, of->normal);
    if (on_its_way && dot(world, of->normal) < turns_away) return false;
    memcpy(of->found, of->normal, sizeof of->found);
    pliant_pose_to(end, place, of->place);
    pliant_pose_to(part->pose, place, before);
    of->gap = 0;
    double gap_before = 0;
    pliant_pose_turn(part->pose, normal, world);
    for (int d = 0; d < 3; d++) {
        of->gap += of->normal[d] * (point[d] - of->place[d]);
        gap_before += world[d] * (point[d] - before[d]);
        of->drift[d] = of->place[d] - before[d];
    }
    if (on_its_way && of->gap > 0) return false;
    /* what was deep in it already comes out little by little */
    const double waits = pliant_contact_left(gap_before, part->recovery, part->stays);
    for (int d = 0; d < 3; d++) of->place[d] += waits * of->normal[d];
    of->gap -= waits;
    return true;
}

/* Whether the part was on another side of the feature as the step began, by more than 70 degrees, and has come by without meeting it: what it pushes it will
 * take along, and where it is then is for what follows both (passed.c). */
static bool has_come_by(const pliant_search *on, const pliant_feature *of, const double normal[3])
{
    const pliant_pose *begin = on->part->pose, *end = begin + on->part->num_poses - 1;
    pliant_feature then = *of;
    double before[3] = {0, 0, 0}, world[2][3];
    pliant_search_distance(on, &then, begin, 0, INFINITY, before);
    pliant_pose_turn(begin, before, world[0]);
    pliant_pose_turn(end, normal, world[1]);
    return dot(world[0], world[1]) < comes_by;
}

/* Conservative advancement: the part goes on by what it cannot reach the feature in, at least one pose. */
static void look(const pliant_search *on, pliant_feature *of)
{
    const pliant_moving_part *part = on->part;
    const int32_t last = part->num_poses - 1;
    double normal[3], margin = 0;
    bool through = false;
    of->gap = INFINITY;
    if (pliant_search_leaves_out(on, of)) return;
    for (int32_t k = 0; k < of->count; k++) margin = fmax(margin, pliant_broad_way(&on->finder->broad, on->positions, of->node[k]));
    margin += part->margin;
    for (int32_t p = last > 1 ? 0 : last;;) {
        const double enough = p == last ? margin : 0, distance = pliant_search_distance(on, of, part->pose + p, 0, enough, normal);
        if (distance > 0 && distance <= enough && last > 1 && has_come_by(on, of, normal)) return;
        if (distance <= enough && meet(on, of, p, distance, normal, &through)) {
            of->touches = true;
            break;
        }
        if (through && p < last) return; /* it would come out here, if what it pushes stayed where it is */
        if (p == last) {
            of->gap = distance > enough ? distance : INFINITY;
            break;
        }
        p += 1 + (int32_t)fmin(fmax(distance, 0) / part->stride, last);
        if (p > last) p = last;
    }
    if (of->count > 1 && !of->touches) of->gap = INFINITY;
}

/* Whether one of its points pushed in the last step */
static bool has_pressed(const pliant_search *on, const pliant_feature *of)
{
    const pliant_finder *finder = on->finder;
    uint64_t key = on->part_key << 56 | of->key;
    for (int n = 0; on->part->remembers && n < PLIANT_FEATURE_POINTS && finder->num_kept > 0; n++, key++) {
        const pliant_kept_point *found = bsearch(&key, finder->kept, (size_t)finder->num_kept, sizeof *finder->kept, pliant_compare_keys);
        if (found && found->pressed) return true;
    }
    return false;
}

/* An edge or a triangle touches where it is deeper than what borders it; one that has pushed goes on until it is higher. */
static void keep_if_deeper(const pliant_search *on, pliant_feature *of, double gap, double size)
{
    const double sag = fmin(fmin(sag_of_size * size, sag_of_depth * pliant_part_depth(on->part->part)), most_sag);
    of->touches = of->touches && of->gap < gap + (has_pressed(on, of) ? sag : -sag);
    if (!of->touches) of->gap = INFINITY;
}

void pliant_search_keep_deeper(const pliant_search *on)
{
    pliant_finder *finder = on->finder;
    for (int32_t e = 0; e < on->edges; e++) {
        pliant_feature *edge = finder->edge + e;
        const double *a = on->positions + 3 * edge->node[0], *b = on->positions + 3 * edge->node[1];
        if (edge->touches)
            keep_if_deeper(on, edge, fmin(finder->node[finder->slot[edge->node[0]]].gap, finder->node[finder->slot[edge->node[1]]].gap),
                           sqrt(pow(b[0] - a[0], 2) + pow(b[1] - a[1], 2) + pow(b[2] - a[2], 2)));
    }
    for (int32_t t = 0; t < on->triangles; t++) {
        pliant_feature *face = finder->face + t;
        double gap = INFINITY;
        if (!face->touches) continue;
        for (int v = 0; v < 3; v++)
            gap = fmin(gap, fmin(finder->node[finder->slot[face->node[v]]].gap, finder->edge[finder->edge_of[3 * t + v]].gap));
        keep_if_deeper(on, face, gap, sqrt(sqrt(dot(face->outwards, face->outwards))));
    }
}

static void look_at_all(pliant_search *on)
{
    pliant_finder *finder = on->finder;
    for (int32_t n = 0; n < on->nodes; n++) look(on, finder->node + n);
    for (int32_t e = 0; e < on->edges; e++) look(on, finder->edge + e);
    for (int32_t t = 0; t < on->triangles; t++) look(on, finder->face + t);
    pliant_search_keep_deeper(on);
}

void pliant_search_share_areas(const pliant_search *on)
{
    pliant_finder *finder = on->finder;
    for (int32_t t = 0; t < on->triangles; t++) {
        pliant_feature *face = finder->face + t, *of[7] = {face};
        int count = face->touches;
        double cross[3];
        for (int v = 0; v < 3; v++) {
            pliant_feature *edge = finder->edge + finder->edge_of[3 * t + v];
            of[count] = edge;
            count += edge->touches;
        }
        for (int v = 0; v < 3; v++) of[count++] = finder->node + finder->slot[face->node[v]];
        cross_of(on->body->fine.rest, face->node, cross);
        for (int n = 0; n < count; n++) of[n]->area += 0.5 * sqrt(dot(cross, cross)) / count;
    }
}

/* ---- what comes of it */

/* What a point of the last step has not held back, where the part is at the end of this one. false: it has, or its nodes are no more. */
static bool still_holds(const pliant_search *on, const pliant_kept_point *last, pliant_feature *of)
{
    const pliant_pose *begin = on->part->pose, *end = begin + on->part->num_poses - 1;
    double normal[3], before[3], gap = 0;
    *of = (pliant_feature){.key = last->feature & (((uint64_t)1 << 56) - 1), .count = last->count, .area = last->area};
    pliant_pose_turn(begin, last->normal, normal);
    pliant_pose_to(begin, last->place, before);
    for (int32_t k = 0; k < last->count; k++) {
        of->node[k] = last->node[k];
        of->weight[k] = last->weight[k];
        if (last->node[k] >= on->body->fine.num_nodes) return false;
        for (int d = 0; d < 3; d++) gap += last->weight[k] * normal[d] * (on->positions[3 * last->node[k] + d] - before[d]);
    }
    pliant_pose_turn(end, last->normal, of->normal);
    pliant_pose_to(end, last->place, of->place);
    for (int d = 0; d < 3; d++) of->drift[d] = of->place[d] - before[d];
    memcpy(of->found, last->found, sizeof of->found);
    if (last->feature % PLIANT_FEATURE_POINTS > 0) return false; /* the one that is found now says where the feature is deepest */
    return gap < -still_deep && dot(of->normal, of->found) >= turns_away && !pliant_search_leaves_out(on, of);
}

void pliant_search_write(const pliant_search *on, const pliant_feature *of, pliant_contact_point *out)
{
    pliant_finder *finder = on->finder;
    const pliant_pose *end = on->part->pose + on->part->num_poses - 1;
    *out = (pliant_contact_point){
        .feature = on->part_key << 56 | of->key, .kind = on->part->kind, .tool = on->part->kind == PLIANT_OBSTACLE_TOOL ? on->part->tool : -1,
        .part = on->part->index, .count = of->count, .area = of->area, .friction = on->part->friction,
    };
    pliant_kept_point *keep = finder->keep + finder->num_keep++;
    *keep = (pliant_kept_point){.feature = out->feature, .count = of->count, .area = of->area};
    for (int32_t k = 0; k < of->count; k++) {
        out->node[k] = keep->node[k] = of->node[k];
        out->weight[k] = keep->weight[k] = of->weight[k];
        if (on->part->briefly && of->gap > still_deep) continue; /* it does not touch yet */
        pliant_side *next = finder->next + finder->num_next++;
        next->pressed = false;
        next->key = pliant_side_key(on->part_key, of->node[k]);
        pliant_pose_turn_back(end, of->normal, next->normal);
    }
    memcpy(out->normal, of->normal, sizeof of->normal);
    memcpy(out->place, of->place, sizeof of->place);
    memcpy(out->drift, of->drift, sizeof of->drift);
    memcpy(keep->found, of->found, sizeof of->found);
    pliant_pose_turn_back(end, of->normal, keep->normal);
    pliant_pose_from(end, of->place, keep->place);
}

int32_t pliant_search_compact(pliant_feature *features, int32_t count)
{
    int32_t left = 0;
    for (int32_t n = 0; n < count; n++)
        if (features[n].touches) features[left++] = features[n];
    if (left > 0) qsort(features, (size_t)left, sizeof *features, compare_features);
    count = left;
    left = 0;
    for (int32_t n = 0; n < count; n++) {
        if (left == 0 || features[n].key != features[left - 1].key) features[left++] = features[n];
        else if (features[n].gap < features[left - 1].gap) features[left - 1] = features[n];
    }
    return left;
}

/* those of the last step of this part */
static const pliant_kept_point *find_kept(const pliant_search *on, int32_t *count)
{
    const pliant_finder *finder = on->finder;
    int32_t low = 0, high = on->part->remembers ? finder->num_kept : 0;
    *count = 0;
    while (low < high) {
        const int32_t middle = (low + high) / 2;
        if (finder->kept[middle].feature >> 56 < on->part_key) low = middle + 1;
        else high = middle;
    }
    while (on->part->remembers && low + *count < finder->num_kept && finder->kept[low + *count].feature >> 56 == on->part_key) ++*count;
    return finder->kept + low;
}

/* Points found and points that go on, of one feature the latter, ascending. */
static pliant_status append(pliant_search *on, pliant_contacts *out)
{
    pliant_finder *finder = on->finder;
    pliant_feature *const kinds[] = {finder->node, finder->edge, finder->face};
    const int32_t counts[] = {pliant_search_compact(finder->node, on->nodes), pliant_search_compact(finder->edge, on->edges), pliant_search_compact(finder->face, on->triangles)};
    int32_t num_kept;
    const pliant_kept_point *last = find_kept(on, &num_kept), *const end = last + num_kept;
    const int32_t total = counts[0] + counts[1] + counts[2] + num_kept;
    pliant_status status = total > 0 ? pliant_finder_reserve(finder, total, out) : PLIANT_OK;
    if (status != PLIANT_OK) return status;
    pliant_feature goes_on;
    for (int kind = 0; kind < 3; kind++)
        for (int32_t n = 0; n < counts[kind]; n++) {
            const pliant_feature *of = kinds[kind] + n;
            const uint64_t key = on->part_key << 56 | of->key;
            for (; last < end && last->feature < key; last++)
                if (still_holds(on, last, &goes_on)) pliant_search_write(on, &goes_on, out->point + out->count++);
            const bool same = last < end && last->feature == key && still_holds(on, last, &goes_on);
            pliant_search_write(on, same ? &goes_on : of, out->point + out->count++);
            if (last < end && last->feature == key) last++;
        }
    for (; last < end; last++)
        if (still_holds(on, last, &goes_on)) pliant_search_write(on, &goes_on, out->point + out->count++);
    return PLIANT_OK;
}

pliant_status pliant_contact_find(pliant_finder *finder, const pliant_body *body, const double *positions, int32_t count, const pliant_moving_part *parts,
                                  pliant_contacts *out)
{
    if (count == 0) return PLIANT_OK;
    pliant_status status = pliant_broad_begin(&finder->broad, body, positions, count, parts);
    if (status == PLIANT_OK) status = pliant_finder_room(finder, body);
    finder->num_next = finder->num_keep = 0;
    finder->more = false;
    for (int32_t p = 0; p < count && status == PLIANT_OK; p++) {
        pliant_search on = {.finder = finder, .body = body, .positions = positions, .part = parts + p};
        on.part_key = pliant_search_key(on.part);
        on.triangles = pliant_broad_find(&finder->broad, on.part, finder->triangle);
        pliant_search_gather(&on);
        look_at_all(&on);
        pliant_search_share_areas(&on);
        status = append(&on, out);
    }
    if (status != PLIANT_OK) return status;
    pliant_finder_remember(finder);
    pliant_broad_end(&finder->broad, positions);
    return PLIANT_OK;
}
