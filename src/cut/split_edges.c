/* Cut the edges that a blade passes through, one after the other. An edge is bisected in all tetrahedra around it at
 * once, so that neighbours always have the same faces. The cut edges of a tetrahedron determine how it is split
 * (NUMERICS.md). */
#include "cut/subdivide.h"

#include "cut/segment_through_triangle.h"

#include "base/buffer.h"
#include "base/fail.h"
#include "base/memory.h"

#include <stdlib.h>
#include <string.h>

/* the six edges of a tetrahedron */
static const int ends_of[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};

typedef struct edge {
    int32_t end[2];  /* node numbers, ascending */
    double fraction; /* position of the intersection as a fraction of the edge */
    double length;   /* rest length [m] */
} edge;

typedef struct edge_list {
    int32_t count, capacity;
    edge *edges;
} edge_list;

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

/* List the edges of tetrahedra near the strip; an edge may occur several times. */
static pliant_status list_near(const cut_splitting *work, edge_list *list)
{
    const cut_strip *strip = work->strip;
    for (int32_t t = 0; t < work->num_tets; t++) {
        const int32_t *nodes = work->corners + 4 * (size_t)t;
        double low[3], high[3];
        bool near = false;
        box_of(work, nodes, 4, low, high);
        if (!boxes_meet(low, high, strip->low, strip->high)) continue;
        for (int32_t n = 0; n < strip->count && !near; n++)
            near = boxes_meet(low, high, strip->triangles[n].low, strip->triangles[n].high);
        if (!near) continue;
        if (!pliant_reserve(&list->edges, &list->capacity, list->count + 5, 256, sizeof *list->edges))
            return pliant_fail_memory("the edges that the blade cuts");
        for (int e = 0; e < 6; e++) {
            const int32_t a = nodes[ends_of[e][0]], b = nodes[ends_of[e][1]];
            list->edges[list->count++] = (edge){.end = {a < b ? a : b, a < b ? b : a}};
        }
    }
    return PLIANT_OK;
}

static int by_ends(const void *a, const void *b)
{
    const edge *i = a, *j = b;
    if (i->end[0] != j->end[0]) return i->end[0] < j->end[0] ? -1 : 1;
    return i->end[1] < j->end[1] ? -1 : i->end[1] > j->end[1];
}

static int by_length(const void *a, const void *b)
{
    const edge *i = a, *j = b;
    return i->length > j->length ? -1 : i->length < j->length ? 1 : by_ends(a, b);
}

/* Find the intersection of the strip and an edge. An even number of crossings leaves both ends on the same side, so the
 * edge is not cut. */
static bool is_crossed(const cut_splitting *work, edge *one)
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

static void find_crossed(const cut_splitting *work, edge_list *list)
{
    int32_t count = 0;
    qsort(list->edges, (size_t)list->count, sizeof *list->edges, by_ends);
    for (int32_t e = 0; e < list->count; e++) {
        edge one = list->edges[e];
        if ((e > 0 && by_ends(&one, list->edges + e - 1) == 0) || !is_crossed(work, &one)) continue;
        double squares = 0;
        for (int d = 0; d < 3; d++) {
            const double difference = work->rest[3 * (size_t)one.end[1] + d] - work->rest[3 * (size_t)one.end[0] + d];
            squares += difference * difference;
        }
        one.length = sqrt(squares);
        /* count is at most e, so the comparison reads only entries that are not overwritten yet */
        list->edges[count++] = one;
    }
    list->count = count;
    qsort(list->edges, (size_t)count, sizeof *list->edges, by_length);
}

/* Mark ends of edges that the blade passes within a tolerance as nodes on the blade. */
static void snap(cut_splitting *work, const edge_list *list)
{
    const double minimum = work->body->subdivision->min_edge;
    for (int32_t e = 0; e < list->count; e++) {
        const edge *one = list->edges + e;
        const int nearer = one->fraction > 0.5;
        if ((nearer ? 1 - one->fraction : one->fraction) * one->length < minimum) work->on[one->end[nearer]] = 1;
    }
}

static int corner_of(const cut_splitting *work, int32_t tet, int32_t node)
{
    for (int v = 0; v < 4; v++)
        if (work->corners[4 * (size_t)tet + v] == node) return v;
    return -1;
}

/* Return whether both parts of all tetrahedra around an edge would be large enough.
 * work->around: these tetrahedra */
static bool parts_are_large(const cut_splitting *work, const edge *one, const double middle[3])
{
    for (int32_t i = 0; i < work->num_around; i++)
        for (int end = 0; end < 2; end++) {
            const int32_t *nodes = work->corners + 4 * (size_t)work->around[i];
            const double *corner[4];
            for (int v = 0; v < 4; v++)
                corner[v] = nodes[v] == one->end[end] ? middle : work->rest + 3 * (size_t)nodes[v];
            if (!(pliant_split_volume(corner[0], corner[1], corner[2], corner[3]) >=
                  work->body->subdivision->min_volume))
                return false;
        }
    return true;
}

static uint8_t fixing_of_middle(uint8_t a, uint8_t b)
{
    return a == PLIANT_MOVES || b == PLIANT_MOVES ? PLIANT_MOVES : a == b ? a : PLIANT_FIXED_AT_POSITION;
}

/* Bisect an edge. The first part of each tetrahedron keeps its number; the second part is appended. */
static pliant_status bisect(cut_splitting *work, const edge *one)
{
    const int32_t a = one->end[0], b = one->end[1];
    double middle[3];
    for (int d = 0; d < 3; d++) {
        const double *from = work->rest + 3 * (size_t)a, *to = work->rest + 3 * (size_t)b;
        middle[d] = from[d] + one->fraction * (to[d] - from[d]);
    }
    pliant_status status = pliant_split_around(work, a);
    if (status != PLIANT_OK) return status;
    int32_t count = 0;
    for (int32_t i = 0; i < work->num_around; i++)
        if (corner_of(work, work->around[i] / 4, b) >= 0) work->around[count++] = work->around[i] / 4;
    work->num_around = count;
    if (!parts_are_large(work, one, middle)) {
        work->on[one->end[one->fraction > 0.5]] = 1;
        return PLIANT_OK;
    }
    const int32_t node = work->num_nodes;
    status = pliant_split_add_node(work, (pliant_between){{a, b}, one->fraction},
                                   fixing_of_middle(work->fixed[a], work->fixed[b]));
    if (status == PLIANT_OK) work->on[node] = 1;
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

pliant_status pliant_split_edges(cut_splitting *work)
{
    edge_list list = {0};
    pliant_status status = list_near(work, &list);
    if (status == PLIANT_OK && list.count > 0) {
        find_crossed(work, &list);
        snap(work, &list);
        /* an edge with a node on the blade is not cut again */
        for (int32_t e = 0; e < list.count && status == PLIANT_OK; e++) {
            const edge *one = list.edges + e;
            if (!work->on[one->end[0]] && !work->on[one->end[1]]) status = bisect(work, one);
        }
    }
    pliant_free(list.edges);
    return status;
}
