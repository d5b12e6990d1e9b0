/* What has passed a part in a step, or slid into it: tissue that goes further in a step than the part is thick may get by between the points that were found
 * as the step began. Each node, edge and triangle goes from where it was to where it is, and the part from pose to pose; where the part is met first says which
 * side the tissue is on. Edges and triangles are asked where they are deepest now, which need not be where their point of this step is. */
#include "contact/detect/finder.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double moves = 0.25;     /* of a part's depth: what goes less, as the part sees it, is not where it would have to be followed */
static const double deep_enough = 1e-4, of_depth = 0.2; /* [m], of the part's depth: so far in is left alone */
static const double gets_through = 0.25, jumps = 2; /* of the part's depth, so far in and so far on in a step: tissue that stays below both comes out where it came in */
static const double touching = 1e-6;  /* [m] what is nearer is met */
static const double no_way = 0.5;     /* length of a normal below which it points nowhere */

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void place_of(const pliant_search *on, const pliant_feature *of, double share, double out[3])
{
    memset(out, 0, 3 * sizeof *out);
    for (int32_t k = 0; k < of->count; k++)
        for (int d = 0; d < 3; d++) {
            const double from = on->positions[3 * (size_t)of->node[k] + (size_t)d];
            out[d] += of->weight[k] * (from + share * (on->to[3 * (size_t)of->node[k] + (size_t)d] - from));
        }
}

/* how far nodes go in the part's frame; edges and triangles as far as their nodes. @return the farthest */
static double find_ways(pliant_search *on)
{
    const pliant_moving_part *part = on->part;
    pliant_finder *finder = on->finder;
    double most = 0;
    for (int32_t n = 0; n < on->nodes; n++) {
        pliant_feature *of = finder->node + n;
        double before[3], now[3], at[3];
        for (int32_t p = 0; p < part->num_poses; p++) {
            place_of(on, of, part->num_poses > 1 ? (double)p / (part->num_poses - 1) : 1, at);
            pliant_pose_from(part->pose + p, at, now);
            if (p > 0) of->way += sqrt(pow(now[0] - before[0], 2) + pow(now[1] - before[1], 2) + pow(now[2] - before[2], 2));
            memcpy(before, now, sizeof before);
        }
        most = fmax(most, of->way);
    }
    for (int32_t e = 0; e < on->edges + on->triangles; e++) {
        pliant_feature *of = e < on->edges ? finder->edge + e : finder->face + (e - on->edges);
        for (int32_t k = 0; k < of->count; k++) of->way = fmax(of->way, finder->node[finder->slot[of->node[k]]].way);
    }
    return most;
}

/* Where the part is met first; its normal there, in its own frame. false: nowhere on the way, or the part comes out of the tissue there: *through */
static bool meet(const pliant_search *on, pliant_feature *of, double normal[3], double place[3], bool *through)
{
    const pliant_moving_part *part = on->part;
    const int32_t last = part->num_poses - 1;
    const double depth = pliant_part_depth(part->part), each = of->way / (last > 0 ? last : 1);
    if (!(of->way > moves * depth)) return false;
    for (int32_t p = 0; p < last;) {
        const double share = (double)p / last, distance = pliant_search_distance(on, of, part->pose + p, share, touching, normal);
        double world[3] = {0, 0, 0}, at[3];
        if (distance <= touching) pliant_pose_turn(part->pose + p, normal, world);
        if (distance <= touching && pliant_search_is_flush(of, distance, world)) {
            pliant_pose_turn_back(part->pose + p, of->outwards, normal);
            const double area = sqrt(dot(normal, normal));
            for (int d = 0; d < 3; d++) normal[d] /= -area;
            pliant_pose_turn(part->pose + p, normal, world);
        }
        if (distance <= touching && dot(normal, normal) > no_way) {
            *through = pliant_search_is_behind(of, world);
            if (*through) return false;
            place_of(on, of, share, at);
            pliant_pose_from(part->pose + p, at, place);
            for (int d = 0; d < 3; d++) place[d] -= distance * normal[d];
            return true;
        }
        p += 1 + (int32_t)fmin((fmax(distance, 0) + 0.5 * fmin(depth, 1)) / each, last);
    }
    return false;
}

/* how much of how deep it was is left for the next steps */
static double find_rest(const pliant_search *on, pliant_feature *of)
{
    double normal[3];
    pliant_feature then = *of;
    return pliant_contact_left(pliant_search_distance(on, &then, on->part->pose, 0, 0, normal), on->part->recovery, on->part->stays);
}

static void look(const pliant_search *on, pliant_feature *of)
{
    const pliant_moving_part *part = on->part;
    const pliant_pose *end = part->pose + part->num_poses - 1;
    const double least = fmin(deep_enough, of_depth * pliant_part_depth(part->part));
    double normal[3] = {0, 0, 0}, met[3] = {0, 0, 0}, place[3], point[3], local[3], before[3];
    of->gap = INFINITY;
    if (pliant_search_leaves_out(on, of)) return;
    bool through = false, knows = meet(on, of, met, place, &through);
    if (through) return; /* what it has come in by has its own points */
    const pliant_feature first = *of;
    const double distance = pliant_search_distance(on, of, end, 1, knows ? INFINITY : 0, normal);
    const bool nowhere = dot(normal, normal) < no_way;
    const bool beyond = knows && distance > 0 && dot(normal, met) < 0; /* on the other side by now */
    if (beyond) *of = first;
    if (!beyond && !(distance < -least)) return;
    if (!knows) {
        knows = pliant_search_remembers(on, of, met);
        for (int d = 0; d < 3; d++) place[d] = 0;
    }
    if (!knows || pliant_search_is_stuck(on, of)) return;
    place_of(on, of, 1, point);
    pliant_pose_from(end, point, local);
    if (beyond || nowhere || pliant_search_misleads(on, distance, dot(normal, met))) {
        memcpy(normal, met, sizeof normal);
    }
    if (!beyond) pliant_part_leave(part->part, local, normal, place);
    const double rest = find_rest(on, of);
    pliant_pose_turn(end, normal, of->normal);
    memcpy(of->found, of->normal, sizeof of->found);
    pliant_pose_to(end, place, of->place);
    pliant_pose_to(part->pose, place, before);
    of->gap = 0;
    for (int d = 0; d < 3; d++) {
        of->drift[d] = of->place[d] - before[d];
        of->place[d] += rest * of->normal[d];
        of->gap += of->normal[d] * (point[d] - of->place[d]);
    }
    of->touches = of->gap < -least;
    if (!of->touches) of->gap = INFINITY;
}

static bool any_gets_by(const pliant_search *on)
{
    const pliant_finder *finder = on->finder;
    const double depth = pliant_part_depth(on->part->part);
    const pliant_feature *const kinds[] = {finder->node, finder->edge, finder->face};
    const int32_t counts[] = {on->nodes, on->edges, on->triangles};
    bool any = false;
    for (int kind = 0; kind < 3; kind++)
        for (int32_t n = 0; n < counts[kind] && !any; n++) {
            const pliant_feature *of = kinds[kind] + n;
            any = of->touches && (of->gap < -gets_through * depth || of->way > jumps * depth);
        }
    return any;
}

/* The first of a feature's points that there is none of yet, or the last. */
static void choose_point(const pliant_search *on, pliant_feature *of)
{
    const pliant_finder *finder = on->finder;
    for (int point = 0; point < PLIANT_FEATURE_POINTS - 1; point++, of->key++) {
        const uint64_t key = on->part_key << 56 | of->key;
        if (finder->num_kept == 0 || !bsearch(&key, finder->kept, (size_t)finder->num_kept, sizeof *finder->kept, pliant_compare_keys)) return;
    }
}

static pliant_status append(pliant_search *on, pliant_contacts *out)
{
    pliant_finder *finder = on->finder;
    pliant_feature *const kinds[] = {finder->node, finder->edge, finder->face};
    const int32_t counts[] = {pliant_search_compact(finder->node, on->nodes), pliant_search_compact(finder->edge, on->edges), pliant_search_compact(finder->face, on->triangles)};
    const int32_t total = counts[0] + counts[1] + counts[2];
    pliant_status status = total > 0 ? pliant_finder_reserve(finder, total, out) : PLIANT_OK;
    for (int kind = 0; kind < 3 && status == PLIANT_OK; kind++)
        for (int32_t n = 0; n < counts[kind]; n++) {
            choose_point(on, kinds[kind] + n);
            pliant_search_write(on, kinds[kind] + n, out->point + out->count++);
        }
    return status;
}

double pliant_contact_way(const pliant_finder *finder, const double *positions)
{
    double most = 0;
    for (int32_t s = 0; finder->broad.knows_last && s < finder->broad.num_surface; s++) most = fmax(most, pliant_broad_way(&finder->broad, positions, finder->broad.surface[s]));
    return most;
}

pliant_status pliant_contact_find_passed(pliant_finder *finder, const pliant_body *body, const double *positions, int32_t count,
                                         const pliant_moving_part *parts, pliant_contacts *out)
{
    if (count == 0 || !finder->broad.knows_last) return PLIANT_OK;
    const int32_t before = out->count;
    bool any = false;
    pliant_status status = pliant_broad_begin(&finder->broad, body, positions, count, parts);
    if (status == PLIANT_OK) status = pliant_finder_room(finder, body);
    finder->num_next = finder->num_keep = 0;
    for (int32_t p = 0; p < count && status == PLIANT_OK; p++) {
        pliant_search on = {.finder = finder, .body = body, .positions = finder->broad.last, .to = positions, .part = parts + p, .part_key = pliant_search_key(parts + p)};
        on.triangles = pliant_broad_find(&finder->broad, on.part, finder->triangle);
        pliant_search_gather(&on);
        if (!(find_ways(&on) > moves * pliant_part_depth(on.part->part))) continue;
        for (int32_t n = 0; n < on.nodes; n++) look(&on, finder->node + n);
        for (int32_t e = 0; e < on.edges; e++) look(&on, finder->edge + e);
        for (int32_t t = 0; t < on.triangles; t++) look(&on, finder->face + t);
        pliant_search_keep_deeper(&on);
        pliant_search_share_areas(&on);
        any = any || any_gets_by(&on);
        status = append(&on, out);
    }
    if (!any) out->count = before;
    if (status == PLIANT_OK && out->count > before) status = pliant_finder_remember_more(finder, out);
    return status;
}
