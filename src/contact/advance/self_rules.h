/* Broad phase of the surface against itself: code that the CPU and CUDA kernels share. It finds the pairs of a node and
 * a triangle, and of two edges, that two triangles own and that can come near each other during a leg. */
#ifndef PLIANT_CONTACT_ADVANCE_SELF_RULES_H
#define PLIANT_CONTACT_ADVANCE_SELF_RULES_H

#include "base/vector3.h"
#include "contact/advance/advance_workspace.h"

#include <math.h>

typedef struct pliant_advance_self_search {
    const int32_t *triangles; /* (triangles x 3) nodes */
    const uint8_t *owns;      /* (triangles) as in pliant_advance_tree */
    const double *from, *to;  /* (nodes x 3) positions at both ends of the leg [m] */
    pliant_advance_self self;
    double margin;     /* pairs that stay farther apart are left out [m] */
    uint8_t *crossing; /* Nullable, (nodes): set to 1 for the nodes of edges and triangles that cross */
} pliant_advance_self_search;

/* Pairs that are found. Pairs beyond the capacity are only counted. */
typedef struct pliant_advance_self_list {
    pliant_advance_self_pair *pair;
    int32_t count, capacity;
    int32_t crossings; /* edges that pass through triangles */
} pliant_advance_self_list;

enum { PLIANT_ADVANCE_MAX_SELF = 15 /* pairs of two triangles: six nodes, nine pairs of edges */ };

/* Return whether a pair is left out. The first nodes belong to one side, the other nodes to the other side. */
PLIANT_INLINE bool pliant_advance_is_exempt(const pliant_advance_self *self, int count, const int32_t *node, int first)
{
    const int32_t piece = self->piece ? self->piece[node[0]] : -1;
    bool exempt[2] = {false, false};
    for (int c = 0; self->exempt && c < count; c++) exempt[c >= first] = exempt[c >= first] || self->exempt[node[c]];
    return (exempt[0] && exempt[1]) || (piece >= 0 && piece == self->piece[node[count - 1]]);
}

/* Return the distance of both sides along the direction between their centers: the smaller one of both ends of the leg.
 * It is a lower bound of the distance throughout the leg [m]. */
PLIANT_INLINE double pliant_advance_separation(const double *from, const double *to, const int32_t node[4], int first)
{
    double normal[3], separation = INFINITY;
    for (int d = 0; d < 3; d++) {
        double sums[2] = {0, 0};
        for (int c = 0; c < 4; c++) {
            const size_t at = 3 * (size_t)node[c] + (size_t)d;
            sums[c >= first] += from[at] + to[at];
        }
        normal[d] = sums[0] / first - sums[1] / (4 - first);
    }
    const double size = pliant_length3(normal);
    for (int n = 0; n < 2; n++) {
        double lowest = INFINITY, highest = -INFINITY;
        for (int c = 0; c < 4; c++) {
            const double height = pliant_dot3(normal, (n ? to : from) + 3 * (size_t)node[c]);
            if (c < first) lowest = height < lowest ? height : lowest;
            else highest = height > highest ? height : highest;
        }
        separation = pliant_advance_lower(separation, lowest - highest);
    }
    return size > 0 ? separation / size : -INFINITY;
}

PLIANT_INLINE void pliant_advance_add_self(const pliant_advance_self_search *on, const int32_t node[4], bool is_edges,
                                           int32_t first, int32_t second, pliant_advance_self_list *out)
{
    const int own = is_edges ? 2 : 1;
    const double separation = pliant_advance_separation(on->from, on->to, node, own);
    if (separation > on->margin || pliant_advance_is_exempt(&on->self, 4, node, own)) return;
    if (out->count++ >= out->capacity) return;
    pliant_advance_self_pair *pair = out->pair + out->count - 1;
    for (int c = 0; c < 4; c++) pair->node[c] = node[c];
    pair->feature[0] = first;
    pair->feature[1] = second;
    pair->is_edges = is_edges;
    pair->ends = false;
    pair->iterations = 0;
    pair->t = 0;
    pair->limit = separation;
}

/* Test the nodes that triangle a owns against triangle b. */
PLIANT_INLINE void pliant_advance_try_nodes(const pliant_advance_self_search *on, int32_t a, int32_t b,
                                            const pliant_advance_box *box, pliant_advance_self_list *out)
{
    const int32_t *of = on->triangles + 3 * (size_t)a, *triangle = on->triangles + 3 * (size_t)b;
    const uint8_t owns = on->owns[a];
    for (int k = 0; k < 3; k++) {
        const int32_t node[4] = {of[k], triangle[0], triangle[1], triangle[2]};
        if (!(owns & PLIANT_OWNS_NODE << k) || node[0] == node[1] || node[0] == node[2] || node[0] == node[3]) continue;
        const pliant_advance_box own = pliant_advance_box_of(1, node, on->from, on->to);
        if (!pliant_advance_boxes_separated(&own, box, on->margin)) pliant_advance_add_self(on, node, false, a, b, out);
    }
}

/* Test the edges that triangle a owns against the edges that triangle b owns. */
PLIANT_INLINE void pliant_advance_try_edges(const pliant_advance_self_search *on, int32_t a, int32_t b,
                                            const pliant_advance_box *box, pliant_advance_self_list *out)
{
    const int32_t *of = on->triangles + 3 * (size_t)a, *other = on->triangles + 3 * (size_t)b;
    const uint8_t owns = on->owns[a], other_owns = on->owns[b];
    pliant_advance_box boxes[3]; /* of the edges of b */
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
                pliant_advance_add_self(on, node, true, 3 * a + k, 3 * b + m, out);
        }
    }
}

/* Return the volume of a tetrahedron, times 6. */
PLIANT_INLINE double pliant_advance_volume(const double a[3], const double b[3], const double c[3], const double d[3])
{
    double p[3], q[3], r[3];
    pliant_subtract3(b, a, p);
    pliant_subtract3(c, a, q);
    pliant_subtract3(d, a, r);
    return pliant_triple3(p, q, r);
}

/* Return whether a segment passes through a triangle, by signed volumes. */
PLIANT_INLINE bool pliant_segment_crosses_triangle(const double *const corner[3], const double *const end[2])
{
    const double below = pliant_advance_volume(corner[0], corner[1], corner[2], end[0]),
                 above = pliant_advance_volume(corner[0], corner[1], corner[2], end[1]);
    if (!(below * above < 0)) return false;
    int sides = 0;
    for (int c = 0; c < 3; c++) {
        const double side = pliant_advance_volume(end[0], end[1], corner[c], corner[(c + 1) % 3]);
        sides += side > 0 ? 1 : side < 0 ? -1 : 0;
    }
    return sides == 3 || sides == -3;
}

/* Test the edges that triangle a owns for passing through triangle b. */
PLIANT_INLINE void pliant_advance_try_crossing_edges(const pliant_advance_self_search *on, int32_t a, int32_t b,
                                                     const pliant_advance_box *box, pliant_advance_self_list *out)
{
    const int32_t *of = on->triangles + 3 * (size_t)a, *triangle = on->triangles + 3 * (size_t)b;
    for (int k = 0; k < 3; k++) {
        const int32_t both[5] = {of[k], of[(k + 1) % 3], triangle[0], triangle[1], triangle[2]};
        const double *corner[3], *end[2];
        bool shares_node = false;
        for (int c = 2; c < 5; c++) shares_node = shares_node || both[c] == both[0] || both[c] == both[1];
        if (!(on->owns[a] & PLIANT_OWNS_EDGE << k) || shares_node) continue;
        const pliant_advance_box own = pliant_advance_box_of(2, both, on->from, on->from);
        if (pliant_advance_boxes_separated(&own, box, 0) || pliant_advance_is_exempt(&on->self, 5, both, 2)) continue;
        for (int n = 0; n < 2; n++) end[n] = on->from + 3 * (size_t)both[n];
        for (int c = 0; c < 3; c++) corner[c] = on->from + 3 * (size_t)both[2 + c];
        if (!pliant_segment_crosses_triangle(corner, end)) continue;
        for (int c = 0; on->crossing && c < 5; c++) on->crossing[both[c]] = 1;
        out->crossings++;
    }
}

/* Count the edges of two triangles that pass through the other triangle at the start of the leg, and mark their nodes.
 * boxes: of the triangles throughout the leg */
PLIANT_INLINE void pliant_advance_try_crossings(const pliant_advance_self_search *on, int32_t a, int32_t b,
                                                const pliant_advance_box *const boxes[2],
                                                pliant_advance_self_list *out)
{
    if (pliant_advance_boxes_separated(boxes[0], boxes[1], 0)) return;
    pliant_advance_try_crossing_edges(on, a, b, boxes[1], out);
    pliant_advance_try_crossing_edges(on, b, a, boxes[0], out);
}

/* Find the pairs of nodes and edges that two triangles own. boxes: of the triangles throughout the leg */
PLIANT_INLINE void pliant_advance_try_pairs(const pliant_advance_self_search *on, int32_t a, int32_t b,
                                            const pliant_advance_box *const boxes[2], pliant_advance_self_list *out)
{
    pliant_advance_try_nodes(on, a, b, boxes[1], out);
    pliant_advance_try_nodes(on, b, a, boxes[0], out);
    pliant_advance_try_edges(on, a, b, boxes[1], out);
}

#endif
