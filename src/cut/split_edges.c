/* Cut the edges that a blade passes through, one after the other. An edge is bisected in all tetrahedra around it at
 * once, so that neighbours always have the same faces. The cut edges of a tetrahedron determine how it is split
 * (NUMERICS.md). */
#include "cut/subdivide.h"

#include "cut/segment_through_triangle.h"

#include "base/buffer.h"
#include "base/fail.h"
#include "base/memory.h"
#include "base/vector3.h"

#include <stdlib.h>
#include <string.h>

/* the six edges of a tetrahedron */
static const int ends_of[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};

static bool boxes_meet(const double low[3], const double high[3], const double other_low[3], const double other_high[3])
{
    for (int d = 0; d < 3; d++)
        if (!(low[d] <= other_high[d] && high[d] >= other_low[d])) return false;
    return true;
}

static void box_of(const cut_splitting *work, const int32_t *nodes, int count, double low[3], double high[3])
{
    for (int d = 0; d < 3; d++) {
        low[d] = high[d] = work->positions[3 * (size_t)nodes[0] + d];
        for (int v = 1; v < count; v++) {
            low[d] = fmin(low[d], work->positions[3 * (size_t)nodes[v] + d]);
            high[d] = fmax(high[d], work->positions[3 * (size_t)nodes[v] + d]);
        }
        low[d] -= work->slack;
        high[d] += work->slack;
    }
}

/* Return whether a tetrahedron is near the strip. */
static bool is_near(const cut_splitting *work, int32_t tet)
{
    const cut_strip *strip = work->strip;
    double low[3], high[3];
    box_of(work, work->corners + 4 * (size_t)tet, 4, low, high);
    if (!boxes_meet(low, high, strip->low, strip->high)) return false;
    for (int32_t n = 0; n < strip->count; n++)
        if (boxes_meet(low, high, strip->triangles[n].low, strip->triangles[n].high)) return true;
    return false;
}

pliant_status pliant_split_list_edge(cut_edge_points *list, int32_t a, int32_t b, double fraction)
{
    if (!pliant_reserve(&list->edges, &list->capacity, list->count, 256, sizeof *list->edges))
        return pliant_fail_memory("the edges that the blade cuts");
    list->edges[list->count++] = a < b ? (cut_edge_point){.end = {a, b}, .fraction = fraction}
                                       : (cut_edge_point){.end = {b, a}, .fraction = 1 - fraction};
    return PLIANT_OK;
}

/* A tetrahedron that the strip enters. */
typedef struct entered_tet {
    int32_t node[4];
    double distance[4]; /* signed distances of the nodes from the strip in it */
    bool at_border;     /* whether the strip ends in it */
} entered_tet;

typedef struct entered_list {
    int32_t count, capacity;
    entered_tet *tets;
} entered_list;

/* List the edges near the strip with a fraction outside of [0, 1], and the tetrahedra that the strip enters. */
static pliant_status list_near(const cut_splitting *work, cut_edge_points *list, entered_list *entered)
{
    for (int32_t t = 0; t < work->num_tets; t++) {
        const int32_t *nodes = work->corners + 4 * (size_t)t;
        double distance[4];
        bool at_border;
        if (!is_near(work, t)) continue;
        for (int e = 0; e < 6; e++) {
            pliant_status status = pliant_split_list_edge(list, nodes[ends_of[e][0]], nodes[ends_of[e][1]], -1);
            if (status != PLIANT_OK) return status;
        }
        if (!pliant_split_enters(work, t, distance, &at_border)) continue;
        if (!pliant_reserve(&entered->tets, &entered->capacity, entered->count, 64, sizeof *entered->tets))
            return pliant_fail_memory("the tetrahedra that the blade enters");
        entered_tet *one = entered->tets + entered->count++;
        memcpy(one->node, nodes, sizeof one->node);
        memcpy(one->distance, distance, sizeof one->distance);
        one->at_border = at_border;
    }
    return PLIANT_OK;
}

/* Find the nodes on the surface of this sweep: nodes that lie on it, and near nodes on the stroke's surface. */
static void find_nodes_on_sweep(cut_splitting *work, const entered_list *entered)
{
    const double near = 1.5 * work->body->subdivision->min_edge;
    for (int32_t t = 0; t < entered->count; t++)
        for (int v = 0; v < 4; v++) {
            const double away = fabs(entered->tets[t].distance[v]);
            uint8_t *on = work->on + entered->tets[t].node[v];
            if (away <= work->slack || (*on && away <= near)) *on |= CUT_ON_SWEEP | CUT_ON_SURFACE;
        }
}

/* List the edges of tetrahedra at the border whose ends are on different sides of the sweep's surface. */
static pliant_status list_continued(const entered_list *entered, cut_edge_points *list)
{
    pliant_status status = PLIANT_OK;
    for (int32_t t = 0; t < entered->count; t++)
        for (int e = 0; e < 6 && status == PLIANT_OK; e++) {
            const int i = ends_of[e][0], j = ends_of[e][1];
            const double from = entered->tets[t].distance[i], to = entered->tets[t].distance[j];
            if (entered->tets[t].at_border && from * to < 0)
                status = pliant_split_list_edge(list, entered->tets[t].node[i], entered->tets[t].node[j],
                                                from / (from - to));
        }
    return status;
}

int pliant_split_by_ends(const void *a, const void *b)
{
    const cut_edge_point *i = a, *j = b;
    if (i->end[0] != j->end[0]) return i->end[0] < j->end[0] ? -1 : 1;
    if (i->end[1] != j->end[1]) return i->end[1] < j->end[1] ? -1 : 1;
    return i->fraction < j->fraction ? -1 : i->fraction > j->fraction;
}

static int by_length(const void *a, const void *b)
{
    const cut_edge_point *i = a, *j = b;
    return i->length > j->length ? -1 : i->length < j->length ? 1 : pliant_split_by_ends(a, b);
}

/* Find the intersection of the strip and an edge. An even number of crossings leaves both ends on the same side, so the
 * edge is not cut. */
static bool is_crossed(const cut_splitting *work, cut_edge_point *one)
{
    const double *a = work->positions + 3 * (size_t)one->end[0], *b = work->positions + 3 * (size_t)one->end[1];
    double low[3], high[3];
    int passes = 0;
    box_of(work, one->end, 2, low, high);
    for (int32_t n = 0; n < work->strip->count; n++) {
        const cut_triangle *triangle = work->strip->triangles + n;
        if (!boxes_meet(low, high, triangle->low, triangle->high) ||
            !pliant_passes_through(a, b, triangle->corner, triangle->normal, work->slack))
            continue;
        double from = 0, to = 0;
        for (int d = 0; d < 3; d++) {
            from += triangle->normal[d] * (a[d] - triangle->corner[d]);
            to += triangle->normal[d] * (b[d] - triangle->corner[d]);
        }
        const double fraction = fmin(fmax(from / (from - to), 0), 1);
        if (passes++ == 0 || fraction < one->fraction) one->fraction = fraction;
    }
    return passes % 2 == 1;
}

/* Keep one entry of each edge that is cut: where the strip passes through it, or else at the mean of the intersections
 * with the surfaces in the adjacent tetrahedra. */
static void find_crossed(const cut_splitting *work, cut_edge_points *list)
{
    int32_t count = 0;
    qsort(list->edges, (size_t)list->count, sizeof *list->edges, pliant_split_by_ends);
    for (int32_t e = 0, last; e < list->count; e = last) {
        cut_edge_point one = list->edges[e];
        double sum = 0;
        int32_t number = 0;
        for (last = e;
             last < list->count && list->edges[last].end[0] == one.end[0] && list->edges[last].end[1] == one.end[1];
             last++)
            if (list->edges[last].fraction >= 0 && list->edges[last].fraction <= 1) {
                sum += list->edges[last].fraction;
                number++;
            }
        one.bits = CUT_ON_SWEEP | CUT_ON_SURFACE;
        if (is_crossed(work, &one)) one.bits |= CUT_PASSED;
        else if (number > 0) one.fraction = sum / number;
        else continue;
        list->edges[count++] = one; /* the loop does not read this entry again */
    }
    list->count = count;
}

/* Mark ends of edges that the blade passes within half of the minimum length, and move the other intersections by up to
 * half of it, so that both parts of the edge are long enough. */
static void snap(cut_splitting *work, const cut_edge_points *list)
{
    const double minimum = work->body->subdivision->min_edge;
    for (int32_t e = 0; e < list->count; e++) {
        cut_edge_point *one = list->edges + e;
        const int nearer = one->fraction > 0.5;
        const double distance = (nearer ? 1 - one->fraction : one->fraction) * one->length;
        if (distance < 0.5 * minimum || one->length < 2 * minimum) work->on[one->end[nearer]] |= one->bits;
        else if (distance < minimum) one->fraction = nearer ? 1 - minimum / one->length : minimum / one->length;
    }
}

static int corner_of(const cut_splitting *work, int32_t tet, int32_t node)
{
    for (int v = 0; v < 4; v++)
        if (work->corners[4 * (size_t)tet + v] == node) return v;
    return -1;
}

static bool is_large(const cut_splitting *work, const double *corner[4])
{
    const double volume = pliant_split_volume(corner[0], corner[1], corner[2], corner[3]);
    double largest = 0;
    for (int c = 0; c < 4; c++) {
        const double *a = corner[(c + 1) % 4];
        double u[3], v[3], normal[3];
        pliant_subtract3(corner[(c + 2) % 4], a, u);
        pliant_subtract3(corner[(c + 3) % 4], a, v);
        pliant_cross3(u, v, normal);
        largest = fmax(largest, 0.5 * pliant_length3(normal));
    }
    return volume >= work->body->subdivision->min_volume && 3 * volume >= work->min_height * largest;
}

/* Return whether both parts of all tetrahedra around an edge would be large enough.
 * work->around: these tetrahedra */
static bool parts_are_large(const cut_splitting *work, const cut_edge_point *one)
{
    double middle[3];
    for (int d = 0; d < 3; d++) {
        const double *from = work->rest + 3 * (size_t)one->end[0], *to = work->rest + 3 * (size_t)one->end[1];
        middle[d] = from[d] + one->fraction * (to[d] - from[d]);
    }
    for (int32_t i = 0; i < work->num_around; i++)
        for (int end = 0; end < 2; end++) {
            const int32_t *nodes = work->corners + 4 * (size_t)work->around[i];
            const double *corner[4];
            for (int v = 0; v < 4; v++)
                corner[v] = nodes[v] == one->end[end] ? middle : work->rest + 3 * (size_t)nodes[v];
            if (!is_large(work, corner)) return false;
        }
    return true;
}

/* Return whether the parts of an edge would be large enough. On a border, the intersection may move towards the middle
 * of the edge for that, as long as no end is nearer. */
static bool find_place(const cut_splitting *work, cut_edge_point *one)
{
    const double from = one->fraction, end = fmin(from, 1 - from);
    if (parts_are_large(work, one)) return true;
    for (int quarter = 1; quarter <= 4 && one->bits & CUT_ON_BORDER; quarter++) {
        one->fraction = from + 0.25 * quarter * (0.5 - from);
        if (fabs(one->fraction - from) > end) break;
        if (parts_are_large(work, one)) return true;
    }
    return false;
}

static uint8_t fixing_of_middle(uint8_t a, uint8_t b)
{
    return a == PLIANT_MOVES || b == PLIANT_MOVES ? PLIANT_MOVES : a == b ? a : PLIANT_FIXED_AT_POSITION;
}

/* Collect the tetrahedra around an edge in work->around. */
static pliant_status find_around(cut_splitting *work, const cut_edge_point *one)
{
    pliant_status status = pliant_split_around(work, one->end[0]);
    int32_t count = 0;
    for (int32_t i = 0; i < work->num_around && status == PLIANT_OK; i++)
        if (corner_of(work, work->around[i] / 4, one->end[1]) >= 0) work->around[count++] = work->around[i] / 4;
    work->num_around = count;
    return status;
}

pliant_status pliant_split_can_bisect(cut_splitting *work, const cut_edge_point *one, bool *out)
{
    pliant_status status = find_around(work, one);
    *out = status == PLIANT_OK && parts_are_large(work, one);
    return status;
}

/* Bisect an edge. The first part of each tetrahedron keeps its number; the second part is appended. */
static pliant_status bisect(cut_splitting *work, cut_edge_point *one)
{
    const int32_t a = one->end[0], b = one->end[1], nearer = one->fraction > 0.5 ? b : a;
    pliant_status status = find_around(work, one);
    if (status != PLIANT_OK) return status;
    const int32_t count = work->num_around;
    if (!find_place(work, one)) {
        work->on[nearer] |= one->bits;
        return PLIANT_OK;
    }
    const int32_t node = work->num_nodes;
    status = pliant_split_add_node(work, (pliant_between){{a, b}, one->fraction},
                                   fixing_of_middle(work->fixed[a], work->fixed[b]));
    if (status == PLIANT_OK) work->on[node] |= one->bits;
    for (int32_t i = 0; i < count && status == PLIANT_OK; i++) {
        const int32_t tet = work->around[i];
        int32_t second[4];
        memcpy(second, work->corners + 4 * (size_t)tet, sizeof second);
        second[corner_of(work, tet, a)] = node;
        pliant_split_set_corner(work, tet, corner_of(work, tet, b), node);
        status = pliant_split_add_tet(work, second, work->source[tet]);
    }
    return status;
}

pliant_status pliant_split_listed(cut_splitting *work, cut_edge_points *list, uint8_t except)
{
    pliant_status status = PLIANT_OK;
    for (int32_t e = 0; e < list->count; e++) {
        cut_edge_point *one = list->edges + e;
        one->length = pliant_distance3(work->rest + 3 * (size_t)one->end[0], work->rest + 3 * (size_t)one->end[1]);
    }
    qsort(list->edges, (size_t)list->count, sizeof *list->edges, by_length);
    snap(work, list);
    for (int32_t e = 0; e < list->count && status == PLIANT_OK; e++) {
        cut_edge_point *one = list->edges + e;
        /* an edge with a node on the blade is not cut again */
        if (!((work->on[one->end[0]] | work->on[one->end[1]]) & except)) status = bisect(work, one);
    }
    return status;
}

pliant_status pliant_split_edges(cut_splitting *work)
{
    cut_edge_points list = {0};
    entered_list entered = {0};
    pliant_status status = list_near(work, &list, &entered);
    find_nodes_on_sweep(work, &entered);
    if (status == PLIANT_OK) status = list_continued(&entered, &list);
    if (status == PLIANT_OK && list.count > 0) {
        find_crossed(work, &list);
        status = pliant_split_listed(work, &list, CUT_ON_SWEEP);
    }
    for (int32_t n = 0; n < work->num_nodes; n++)
        if ((work->on[n] & (CUT_ON_SWEEP | CUT_PASSED)) == CUT_ON_SWEEP && pliant_split_passes(work, n))
            work->on[n] |= CUT_PASSED;
    pliant_free(list.edges);
    pliant_free(entered.tets);
    return status;
}
