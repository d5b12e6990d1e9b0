/* Cut edges in the surface of a sweep where its borders cross them, so that the swept area consists of whole faces. A
 * border is a polyline: the path of an end of the blade's edge, or the edge at the beginning or end of a stroke. */
#include "cut/subdivide.h"

#include "base/memory.h"
#include "base/vector3.h"

#include <stdlib.h>
#include <string.h>

/* A segment of a border.
 * across: in the sweep's surface, perpendicular to the segment */
typedef struct border_segment {
    const double *from;
    double along[3], across[3];
} border_segment;

/* Find a segment of a border. Return false if the sweep has no area there. */
static bool find_segment(const cut_splitting *work, int border, int32_t index, border_segment *out)
{
    const pliant_cut_sweep *sweep = work->sweep;
    const int32_t row = border == CUT_LAST_SIDE ? sweep->count - 2 : index;
    const double *end[2];
    double motion[3], normal[3] = {0};
    for (int side = 0; side < 2; side++) {
        double edge[3], part[3];
        pliant_subtract3(sweep->to + 3 * (row + side), sweep->from + 3 * (row + side), motion);
        for (int moved = 0; moved < 2; moved++) {
            const double *points = (moved ? sweep->to : sweep->from) + 3 * row;
            pliant_subtract3(points + 3, points, edge);
            pliant_cross3(edge, motion, part);
            for (int d = 0; d < 3; d++) normal[d] += part[d];
        }
    }
    pliant_split_border(work, border, index, end);
    out->from = end[0];
    pliant_subtract3(end[1], end[0], out->along);
    pliant_cross3(normal, out->along, out->across);
    return pliant_dot3(out->across, out->across) > 0;
}

/* Return whether a segment crosses an edge in the sweep's surface, and where. */
static bool crosses(const cut_splitting *work, const border_segment *segment, cut_edge_point *edge)
{
    double u[3], v[3];
    pliant_subtract3(work->positions + 3 * (size_t)edge->end[0], segment->from, u);
    pliant_subtract3(work->positions + 3 * (size_t)edge->end[1], segment->from, v);
    const double from = pliant_dot3(segment->across, u), to = pliant_dot3(segment->across, v);
    if ((from > 0) == (to > 0)) return false;
    edge->fraction = from / (from - to);
    for (int d = 0; d < 3; d++) u[d] += edge->fraction * (v[d] - u[d]);
    const double square = pliant_dot3(segment->along, segment->along), at = pliant_dot3(segment->along, u) / square;
    for (int d = 0; d < 3; d++) u[d] -= at * segment->along[d];
    return at >= 0 && at <= 1 && pliant_length3(u) <= 2 * work->body->subdivision->min_edge;
}

/* List the edges in the sweep's surface. */
static pliant_status list_edges(const cut_splitting *work, cut_edge_points *list)
{
    pliant_status status = PLIANT_OK;
    for (int32_t t = 0; t < work->num_tets; t++)
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < i && status == PLIANT_OK; j++) {
                const int32_t *node = work->corners + 4 * (size_t)t;
                if (work->on[node[i]] & work->on[node[j]] & CUT_ON_SWEEP)
                    status = pliant_split_list_edge(list, node[i], node[j], 0);
            }
    return status;
}

static pliant_status trim(cut_splitting *work, int border)
{
    const double *end[2];
    const int32_t segments = pliant_split_border(work, border, 0, end);
    cut_edge_points list = {0};
    for (int32_t n = 0; n < work->num_nodes; n++) work->on[n] &= (uint8_t)~CUT_ON_BORDER;
    pliant_status status = list_edges(work, &list);
    if (status == PLIANT_OK && list.count > 0) {
        int32_t kept = 0, ends[2] = {-1, -1};
        qsort(list.edges, (size_t)list.count, sizeof *list.edges, pliant_split_by_ends);
        for (int32_t e = 0; e < list.count; e++) {
            cut_edge_point edge = list.edges[e];
            border_segment segment;
            bool is_crossed = false;
            if (memcmp(ends, edge.end, sizeof ends) == 0) continue;
            memcpy(ends, edge.end, sizeof ends);
            for (int32_t i = 0; i < segments && !is_crossed; i++)
                is_crossed = find_segment(work, border, i, &segment) && crosses(work, &segment, &edge);
            edge.bits = CUT_ON_SWEEP | CUT_ON_SURFACE | CUT_PASSED | CUT_ON_BORDER;
            if (is_crossed) list.edges[kept++] = edge;
        }
        list.count = kept;
        status = pliant_split_listed(work, &list, CUT_ON_BORDER);
    }
    pliant_free(list.edges);
    return status;
}

pliant_status pliant_split_trim(cut_splitting *work)
{
    pliant_status status = PLIANT_OK;
    for (int border = 0; border < CUT_NUM_BORDERS && status == PLIANT_OK; border++)
        if (work->has_border[border]) status = trim(work, border);
    return status;
}
