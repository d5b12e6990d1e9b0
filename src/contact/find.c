#include "contact/find.h"

#include "base/fail.h"
#include "contact/broad.h"
#include "pliant/memory.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* an edge or a triangle counts where it is deeper than what borders it by this part of its size, of the part's depth, and by this much [m] */
static const double sag_of_size = 0.02, sag_of_depth = 0.1, most_sag = 5e-5;
static const double still_deep = 1e-4; /* [m] beyond a point of the last step: it holds on */
static const double turns_away = 0.5; /* cosine of how far a part may turn with tissue before it: beyond, that slips off it */
static const double aslant = -0.7; /* cosine likewise, above which a part that is deepest in the middle of a triangle meets it with an edge or a corner */
static const double behind = 0.25; /* cosine between the part's normal and the tissue's, beyond which the part is behind the surface */

/* A node, an edge or a triangle of the surface, and where a part meets it. */
typedef struct feature {
    uint64_t key;
    int32_t count, node[3];
    double outwards[3];     /* of the tissue; twice the area of its triangles */
    double gap;             /* as the step ends, if the tissue stays where it is [m]; INFINITY: it is left out */
    bool touches;
    double weight[3], normal[3], place[3], drift[3], found[3], area;
} feature;

/* A point of the last step, in the part's frame: what it has not held back yet is still to be held, wherever it is now. */
typedef struct kept_point {
    uint64_t feature;
    int32_t count, node[3];
    double weight[3], normal[3], place[3], area;
    double found[3]; /* its normal when it was found, not in the part's frame */
} kept_point;

/* Which side of a part a node is on: the normal of their last contact, in the part's frame. */
typedef struct side {
    uint64_t key; /* part, node */
    double normal[3];
} side;

struct pliant_finder {
    pliant_broad broad;
    int32_t room_triangles;
    int32_t *triangle;      /* near a part */
    feature *face, *edge, *node;
    int32_t *edge_of;       /* (triangles x 3) */
    uint64_t *order;        /* (3 x triangles) */
    int32_t room_nodes;
    int32_t *slot;          /* (fine nodes) which feature of a part */
    int32_t num_sides, room_sides, num_next, room_next;
    side *sides, *next;     /* ascending by key; of this step */
    int32_t num_kept, room_kept, num_keep, room_keep;
    kept_point *kept, *keep;      /* ascending by feature; of this step */
};

/* A part and the tissue around it, while they are searched. */
typedef struct search {
    pliant_finder *finder;
    const pliant_body *body;
    const double *positions;
    const pliant_moving_part *part;
    uint64_t part_key;
    int32_t triangles, edges, nodes;
} search;

pliant_status pliant_finder_create(pliant_finder **out)
{
    *out = pliant_calloc(1, sizeof **out);
    return *out ? PLIANT_OK : pliant_fail_memory("contacts");
}

void pliant_finder_free(pliant_finder *finder)
{
    if (!finder) return;
    pliant_broad_free(&finder->broad);
    pliant_free(finder->triangle);
    pliant_free(finder->face);
    pliant_free(finder->edge);
    pliant_free(finder->node);
    pliant_free(finder->edge_of);
    pliant_free(finder->order);
    pliant_free(finder->slot);
    pliant_free(finder->sides);
    pliant_free(finder->next);
    pliant_free(finder->kept);
    pliant_free(finder->keep);
    pliant_free(finder);
}

void pliant_finder_forget(pliant_finder *finder)
{
    finder->num_sides = finder->num_kept = 0;
    finder->broad.knows_last = false;
}

/* @param array address of a pointer to what grows */
static bool grow(void *array, size_t count, size_t size)
{
    void *block;
    memcpy(&block, array, sizeof block);
    block = pliant_resize(block, count, size);
    if (block) memcpy(array, &block, sizeof block);
    return block;
}

pliant_status pliant_finder_copy(const pliant_finder *from, pliant_finder *to)
{
    if (from->num_sides > to->room_sides) {
        if (!grow(&to->sides, (size_t)from->num_sides, sizeof *to->sides)) return pliant_fail_memory("contacts");
        to->room_sides = from->num_sides;
    }
    if (from->num_kept > to->room_kept) {
        if (!grow(&to->kept, (size_t)from->num_kept, sizeof *to->kept)) return pliant_fail_memory("contacts");
        to->room_kept = from->num_kept;
    }
    pliant_status status = pliant_broad_copy(&from->broad, &to->broad);
    if (status != PLIANT_OK) return status;
    if (from->num_sides > 0) memcpy(to->sides, from->sides, (size_t)from->num_sides * sizeof *to->sides);
    to->num_sides = from->num_sides;
    if (from->num_kept > 0) memcpy(to->kept, from->kept, (size_t)from->num_kept * sizeof *to->kept);
    to->num_kept = from->num_kept;
    return PLIANT_OK;
}

pliant_status pliant_contacts_reserve(pliant_contacts *contacts, int32_t room)
{
    if (room <= contacts->room) return PLIANT_OK;
    room += room / 2;
    if (!grow(&contacts->point, (size_t)room, sizeof *contacts->point)) return pliant_fail_memory("contacts");
    contacts->room = room;
    return PLIANT_OK;
}

static pliant_status make_room(pliant_finder *finder, const pliant_body *body)
{
    const size_t triangles = (size_t)finder->broad.num_near, nodes = (size_t)body->fine.num_nodes;
    if (body->fine.num_nodes > finder->room_nodes) {
        if (!grow(&finder->slot, nodes, sizeof *finder->slot)) return pliant_fail_memory("contacts");
        finder->room_nodes = body->fine.num_nodes;
    }
    if (finder->broad.num_near <= finder->room_triangles) return PLIANT_OK;
    if (!grow(&finder->triangle, triangles, sizeof *finder->triangle) || !grow(&finder->face, triangles, sizeof *finder->face) ||
        !grow(&finder->edge, 3 * triangles, sizeof *finder->edge) || !grow(&finder->node, 3 * triangles, sizeof *finder->node) ||
        !grow(&finder->edge_of, 3 * triangles, sizeof *finder->edge_of) || !grow(&finder->order, 3 * triangles, sizeof *finder->order))
        return pliant_fail_memory("contacts");
    finder->room_triangles = finder->broad.num_near;
    return PLIANT_OK;
}

/* ---- features of the triangles near a part */

enum { NODE_BITS = 27 };
enum feature_kind { A_NODE, AN_EDGE, A_FACE };

static uint64_t key_of(enum feature_kind kind, uint64_t a, uint64_t b) { return (uint64_t)kind << (2 * NODE_BITS) | a << NODE_BITS | b; }

static int compare_keys(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

static int compare_features(const void *a, const void *b)
{
    const uint64_t x = ((const feature *)a)->key, y = ((const feature *)b)->key;
    return (x > y) - (x < y);
}

/* sort, and leave out what is there twice. @return how many are left */
static int32_t sort_keys(uint64_t *keys, int32_t count)
{
    int32_t left = 0;
    if (count > 0) qsort(keys, (size_t)count, sizeof *keys, compare_keys);
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

static void gather(search *on)
{
    pliant_finder *finder = on->finder;
    uint64_t *order = finder->order;
    for (int32_t t = 0; t < on->triangles; t++)
        for (int v = 0; v < 3; v++) order[3 * t + v] = (uint64_t)on->body->triangles[3 * finder->triangle[t] + v];
    on->nodes = sort_keys(order, 3 * on->triangles);
    for (int32_t n = 0; n < on->nodes; n++) {
        finder->node[n] = (feature){.key = key_of(A_NODE, order[n], 0), .count = 1, .node = {(int32_t)order[n]}, .weight = {1}};
        finder->slot[order[n]] = n;
    }
    for (int32_t t = 0; t < on->triangles; t++) {
        const int32_t *nodes = on->body->triangles + 3 * finder->triangle[t];
        finder->face[t] = (feature){.key = face_key(nodes), .count = 3, .node = {nodes[0], nodes[1], nodes[2]}};
        for (int v = 0; v < 3; v++) order[3 * t + v] = edge_key(nodes[v], nodes[(v + 1) % 3]);
    }
    on->edges = sort_keys(order, 3 * on->triangles);
    for (int32_t e = 0; e < on->edges; e++) {
        const uint64_t mask = ((uint64_t)1 << NODE_BITS) - 1;
        finder->edge[e] = (feature){.key = order[e], .count = 2, .node = {(int32_t)(order[e] >> NODE_BITS & mask), (int32_t)(order[e] & mask)}};
    }
    for (int32_t t = 0; t < on->triangles; t++) {
        feature *face = finder->face + t;
        cross_of(on->positions, face->node, face->outwards);
        for (int v = 0; v < 3; v++) {
            const uint64_t key = edge_key(face->node[v], face->node[(v + 1) % 3]);
            const uint64_t *found = bsearch(&key, order, (size_t)on->edges, sizeof key, compare_keys);
            finder->edge_of[3 * t + v] = (int32_t)(found - order);
            add(finder->node[finder->slot[face->node[v]]].outwards, face->outwards);
            add(finder->edge[found - order].outwards, face->outwards);
        }
    }
}

/* ---- where a part meets a feature */

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

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

/* what neither moves nor is to be moved by this part */
static bool is_left_out(const search *on, const feature *of)
{
    bool held = true, fixed = true;
    for (int32_t k = 0; k < of->count; k++) {
        held = held && is_held(on->part, of->node[k]);
        fixed = fixed && on->body->fine_fixed[of->node[k]] == PLIANT_FIXED_AT_REST;
    }
    return held || fixed;
}

static uint64_t side_key(const search *on, int32_t node) { return on->part_key << NODE_BITS | (uint64_t)node; }

/* on which side of the part the feature's point was; false: that is not known */
static bool remember(const search *on, const feature *of, double normal[3])
{
    const pliant_finder *finder = on->finder;
    memset(normal, 0, 3 * sizeof *normal);
    if (!on->part->remembers || finder->num_sides == 0) return false;
    for (int32_t k = 0; k < of->count; k++) {
        const uint64_t key = side_key(on, of->node[k]);
        const side *found = bsearch(&key, finder->sides, (size_t)finder->num_sides, sizeof *found, compare_keys);
        for (int d = 0; found && d < 3; d++) normal[d] += of->weight[k] * found->normal[d];
    }
    const double size = sqrt(dot(normal, normal));
    for (int d = 0; size > 0 && d < 3; d++) normal[d] /= size;
    return size > 0;
}

/* the feature's least distance in one of the part's poses, or a lower bound above `enough` */
static double distance_in(const search *on, feature *of, const pliant_pose *pose, double enough, double normal[3])
{
    double local[3][3];
    for (int32_t k = 0; k < of->count; k++) pliant_pose_from(pose, on->positions + 3 * of->node[k], local[k]);
    if (of->count == 1) return pliant_part_distance(on->part->part, local[0], normal);
    return of->count == 2 ? pliant_edge_minimum(on->part->part, (const double(*)[3])local, enough, of->weight, normal)
                          : pliant_face_minimum(on->part->part, (const double(*)[3])local, enough, of->weight, normal);
}

/* The part meets the feature in a pose: from there on, the tissue stays on this side. false: the part is behind the surface, or leaves it. */
static bool meet(const search *on, feature *of, int32_t p, double distance, double normal[3])
{
    const pliant_moving_part *part = on->part;
    const pliant_pose *pose = part->pose + p, *end = part->pose + part->num_poses - 1;
    double point[3] = {0, 0, 0}, local[3], place[3], before[3], kept[3], world[3];
    for (int32_t k = 0; k < of->count; k++)
        for (int d = 0; d < 3; d++) point[d] += of->weight[k] * on->positions[3 * of->node[k] + d];
    pliant_pose_from(pose, point, local);
    const double area = sqrt(dot(of->outwards, of->outwards));
    const bool known = remember(on, of, kept);
    pliant_pose_turn(pose, normal, world);
    const bool on_its_way = p < part->num_poses - 1; /* the tissue's own normal counts then */
    const bool sharp = on_its_way && of->count == 3 && distance < 0 && dot(world, of->outwards) > aslant * area;
    const bool nowhere = dot(normal, normal) < 0.5 || sharp;
    if (known && distance < 0 && (nowhere || dot(normal, kept) < 0)) {
        memcpy(normal, kept, sizeof kept);
        pliant_part_leave(part->part, local, normal, place);
    } else if (nowhere) {
        if (area == 0) return false;
        pliant_pose_turn_back(pose, of->outwards, normal);
        for (int d = 0; d < 3; d++) normal[d] /= -area;
        pliant_part_leave(part->part, local, normal, place);
    } else
        for (int d = 0; d < 3; d++) place[d] = local[d] - distance * normal[d];
    pliant_pose_turn(pose, normal, world);
    if (!known && dot(world, of->outwards) > behind * area) return false;
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
    const double waits = fmin(gap_before + part->recovery, 0);
    for (int d = 0; d < 3; d++) of->place[d] += waits * of->normal[d];
    of->gap -= waits;
    return true;
}

/* Conservative advancement: the part goes on by what it cannot reach the feature in, at least one pose. */
static void look(const search *on, feature *of)
{
    const pliant_moving_part *part = on->part;
    const int32_t last = part->num_poses - 1;
    double normal[3], margin = 0;
    of->gap = INFINITY;
    if (is_left_out(on, of)) return;
    for (int32_t k = 0; k < of->count; k++) margin = fmax(margin, pliant_broad_way(&on->finder->broad, on->positions, of->node[k]));
    margin += part->margin;
    for (int32_t p = last > 1 ? 0 : last;;) {
        const double enough = p == last ? margin : 0, distance = distance_in(on, of, part->pose + p, enough, normal);
        if (distance <= enough && meet(on, of, p, distance, normal)) {
            of->touches = true;
            break;
        }
        if (p == last) {
            of->gap = distance > enough ? distance : INFINITY;
            break;
        }
        p += 1 + (int32_t)fmin(fmax(distance, 0) / part->stride, last);
        if (p > last) p = last;
    }
    if (of->count > 1 && !of->touches) of->gap = INFINITY;
}

/* an edge or a triangle touches where it is deeper than what borders it */
static void keep_if_deeper(const search *on, feature *of, double gap, double size)
{
    const double sag = fmin(fmin(sag_of_size * size, sag_of_depth * pliant_part_depth(on->part->part)), most_sag);
    of->touches = of->touches && of->gap < gap - sag;
    if (!of->touches) of->gap = INFINITY;
}

static void look_at_all(search *on)
{
    pliant_finder *finder = on->finder;
    for (int32_t n = 0; n < on->nodes; n++) look(on, finder->node + n);
    for (int32_t e = 0; e < on->edges; e++) {
        feature *edge = finder->edge + e;
        const double *a = on->positions + 3 * edge->node[0], *b = on->positions + 3 * edge->node[1];
        look(on, edge);
        if (edge->touches)
            keep_if_deeper(on, edge, fmin(finder->node[finder->slot[edge->node[0]]].gap, finder->node[finder->slot[edge->node[1]]].gap),
                           sqrt(pow(b[0] - a[0], 2) + pow(b[1] - a[1], 2) + pow(b[2] - a[2], 2)));
    }
    for (int32_t t = 0; t < on->triangles; t++) {
        feature *face = finder->face + t;
        double gap = INFINITY;
        look(on, face);
        if (!face->touches) continue;
        for (int v = 0; v < 3; v++)
            gap = fmin(gap, fmin(finder->node[finder->slot[face->node[v]]].gap, finder->edge[finder->edge_of[3 * t + v]].gap));
        keep_if_deeper(on, face, gap, sqrt(sqrt(dot(face->outwards, face->outwards))));
    }
}

/* A triangle's area goes to its corners, and to its edges and itself where they touch, in equal parts. */
static void share_areas(const search *on)
{
    pliant_finder *finder = on->finder;
    for (int32_t t = 0; t < on->triangles; t++) {
        feature *face = finder->face + t, *of[7] = {face};
        int count = face->touches;
        double cross[3];
        for (int v = 0; v < 3; v++) {
            feature *edge = finder->edge + finder->edge_of[3 * t + v];
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
static bool still_holds(const search *on, const kept_point *last, feature *of)
{
    const pliant_pose *begin = on->part->pose, *end = begin + on->part->num_poses - 1;
    double normal[3], before[3], gap = 0;
    *of = (feature){.key = last->feature & (((uint64_t)1 << 56) - 1), .count = last->count, .area = last->area};
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
    return gap < -still_deep && dot(of->normal, of->found) >= turns_away && !is_left_out(on, of);
}

static void write_point(const search *on, const feature *of, pliant_contact_point *out)
{
    pliant_finder *finder = on->finder;
    const pliant_pose *end = on->part->pose + on->part->num_poses - 1;
    *out = (pliant_contact_point){
        .feature = on->part_key << 56 | of->key, .kind = on->part->kind, .tool = on->part->kind == PLIANT_OBSTACLE_TOOL ? on->part->tool : -1,
        .part = on->part->index, .count = of->count, .area = of->area, .friction = on->part->friction,
    };
    kept_point *keep = finder->keep + finder->num_keep++;
    *keep = (kept_point){.feature = out->feature, .count = of->count, .area = of->area};
    for (int32_t k = 0; k < of->count; k++) {
        out->node[k] = keep->node[k] = of->node[k];
        out->weight[k] = keep->weight[k] = of->weight[k];
        side *next = finder->next + finder->num_next++;
        next->key = side_key(on, of->node[k]);
        pliant_pose_turn_back(end, of->normal, next->normal);
    }
    memcpy(out->normal, of->normal, sizeof of->normal);
    memcpy(out->place, of->place, sizeof of->place);
    memcpy(out->drift, of->drift, sizeof of->drift);
    memcpy(keep->found, of->found, sizeof of->found);
    pliant_pose_turn_back(end, of->normal, keep->normal);
    pliant_pose_from(end, of->place, keep->place);
}

/* touching features in order, of two with one key the deeper. @return how many */
static int32_t compact(feature *features, int32_t count)
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

/* room for so many more points */
static pliant_status reserve(pliant_finder *finder, int32_t points, pliant_contacts *out)
{
    pliant_status status = pliant_contacts_reserve(out, out->count + points);
    const int32_t sides = finder->num_next + 3 * points, keep = finder->num_keep + points;
    if (status != PLIANT_OK) return status;
    if (sides > finder->room_next) {
        if (!grow(&finder->next, (size_t)sides * 2, sizeof *finder->next)) return pliant_fail_memory("contacts");
        finder->room_next = 2 * sides;
    }
    if (keep > finder->room_keep) {
        if (!grow(&finder->keep, (size_t)keep * 2, sizeof *finder->keep)) return pliant_fail_memory("contacts");
        finder->room_keep = 2 * keep;
    }
    return PLIANT_OK;
}

/* those of the last step of this part */
static const kept_point *find_kept(const search *on, int32_t *count)
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
static pliant_status append(search *on, pliant_contacts *out)
{
    pliant_finder *finder = on->finder;
    feature *const kinds[] = {finder->node, finder->edge, finder->face};
    const int32_t counts[] = {compact(finder->node, on->nodes), compact(finder->edge, on->edges), compact(finder->face, on->triangles)};
    int32_t num_kept;
    const kept_point *last = find_kept(on, &num_kept), *const end = last + num_kept;
    const int32_t total = counts[0] + counts[1] + counts[2] + num_kept;
    pliant_status status = total > 0 ? reserve(finder, total, out) : PLIANT_OK;
    if (status != PLIANT_OK) return status;
    feature goes_on;
    for (int kind = 0; kind < 3; kind++)
        for (int32_t n = 0; n < counts[kind]; n++) {
            const feature *of = kinds[kind] + n;
            const uint64_t key = on->part_key << 56 | of->key;
            for (; last < end && last->feature < key; last++)
                if (still_holds(on, last, &goes_on)) write_point(on, &goes_on, out->point + out->count++);
            const bool same = last < end && last->feature == key && still_holds(on, last, &goes_on);
            write_point(on, same ? &goes_on : of, out->point + out->count++);
            if (last < end && last->feature == key) last++;
        }
    for (; last < end; last++)
        if (still_holds(on, last, &goes_on)) write_point(on, &goes_on, out->point + out->count++);
    return PLIANT_OK;
}

/* What the next step asks for: of sides the mean of what was said of a node. */
static void remember_all(pliant_finder *finder)
{
    int32_t left = 0;
    if (finder->num_next > 0) qsort(finder->next, (size_t)finder->num_next, sizeof *finder->next, compare_keys);
    for (int32_t n = 0; n < finder->num_next; n++) {
        if (left > 0 && finder->next[n].key == finder->next[left - 1].key) add(finder->next[left - 1].normal, finder->next[n].normal);
        else finder->next[left++] = finder->next[n];
    }
    side *sides = finder->sides;
    const int32_t room = finder->room_sides;
    finder->sides = finder->next;
    finder->num_sides = left;
    finder->room_sides = finder->room_next;
    finder->next = sides;
    finder->room_next = room;
    kept_point *keep = finder->kept;
    const int32_t room_kept = finder->room_kept;
    finder->kept = finder->keep;
    finder->num_kept = finder->num_keep;
    finder->room_kept = finder->room_keep;
    finder->keep = keep;
    finder->room_keep = room_kept;
}

pliant_status pliant_contact_find(pliant_finder *finder, const pliant_body *body, const double *positions, int32_t count, const pliant_moving_part *parts,
                                  pliant_contacts *out)
{
    if (count == 0) return PLIANT_OK;
    pliant_status status = pliant_broad_begin(&finder->broad, body, positions, count, parts);
    if (status == PLIANT_OK) status = make_room(finder, body);
    finder->num_next = finder->num_keep = 0;
    for (int32_t p = 0; p < count && status == PLIANT_OK; p++) {
        search on = {.finder = finder, .body = body, .positions = positions, .part = parts + p};
        on.part_key = on.part->kind == PLIANT_OBSTACLE_TOOL ? (uint64_t)(PLIANT_MAX_PARTS * on.part->tool + on.part->index) : 128 + (uint64_t)on.part->index;
        on.triangles = pliant_broad_find(&finder->broad, on.part, finder->triangle);
        gather(&on);
        look_at_all(&on);
        share_areas(&on);
        status = append(&on, out);
    }
    if (status != PLIANT_OK) return status;
    remember_all(finder);
    pliant_broad_end(&finder->broad, positions);
    return PLIANT_OK;
}
