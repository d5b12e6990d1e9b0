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

/* Compute the coordinates of a point from a segment's start, as fractions of `along` and `across`, and return its
 * distance from their plane [m]. */
static double project(const border_segment *segment, const double *point, double out[2])
{
    double u[3];
    pliant_subtract3(point, segment->from, u);
    out[0] = pliant_dot3(segment->along, u) / pliant_dot3(segment->along, segment->along);
    out[1] = pliant_dot3(segment->across, u) / pliant_dot3(segment->across, segment->across);
    for (int d = 0; d < 3; d++) u[d] -= out[0] * segment->along[d] + out[1] * segment->across[d];
    return pliant_length3(u);
}

/* Find where the line of a segment crosses an edge in the sweep's surface.
 * at: out: the intersection as a fraction of the segment; outside of [0, 1] on its continuation
 * Return false if it does not cross the edge. */
static bool crosses(const cut_splitting *work, const border_segment *segment, cut_edge_point *edge, double *at)
{
    double u[3], v[3];
    pliant_subtract3(work->positions + 3 * (size_t)edge->end[0], segment->from, u);
    pliant_subtract3(work->positions + 3 * (size_t)edge->end[1], segment->from, v);
    const double from = pliant_dot3(segment->across, u), to = pliant_dot3(segment->across, v);
    if ((from > 0) == (to > 0)) return false;
    edge->fraction = from / (from - to);
    for (int d = 0; d < 3; d++) u[d] += edge->fraction * (v[d] - u[d]);
    const double square = pliant_dot3(segment->along, segment->along);
    *at = pliant_dot3(segment->along, u) / square;
    for (int d = 0; d < 3; d++) u[d] -= *at * segment->along[d];
    return pliant_length3(u) <= 2 * work->body->subdivision->min_edge;
}

/* Bits of the ends of a border beyond which it continues up to the edges of the triangle that contains this end. */
enum { BEFORE_FIRST = 1, BEYOND_LAST = 2 };

/* A border of the sweep.
 * corners: the ends that are corners of the swept surface: BEFORE_FIRST, BEYOND_LAST */
typedef struct border_line {
    int border;
    int32_t segments;
    uint8_t corners;
} border_line;

static border_line find_line(const cut_splitting *work, int border)
{
    const double *end[2];
    border_line line = {.border = border, .corners = BEFORE_FIRST | BEYOND_LAST};
    line.segments = pliant_split_border(work, border, 0, end);
    if (border == CUT_FIRST_SIDE || border == CUT_LAST_SIDE)
        line.corners =
            (work->has_border[CUT_BEGINNING] ? BEFORE_FIRST : 0) | (work->has_border[CUT_END] ? BEYOND_LAST : 0);
    return line;
}

/* Return whether a triangle of nodes contains an end of a segment. */
static bool contains_end(const cut_splitting *work, const int32_t *node[3], const border_segment *segment, double end)
{
    double corner[3][2];
    bool is_left = false, is_right = false;
    for (int c = 0; c < 3; c++)
        if (project(segment, work->positions + 3 * (size_t)*node[c], corner[c]) > 2 * work->body->subdivision->min_edge)
            return false;
    for (int c = 0; c < 3; c++) {
        const double *a = corner[c], *b = corner[(c + 1) % 3];
        const double turn = (a[0] - end) * b[1] - (b[0] - end) * a[1];
        is_left = is_left || turn > 0;
        is_right = is_right || turn < 0;
    }
    return !(is_left && is_right);
}

/* Return the corners of the swept surface that a face contains. */
static uint8_t corners_in(const cut_splitting *work, const border_line *line, const int32_t *node[3])
{
    uint8_t bits = 0;
    border_segment segment;
    if (line->corners & BEFORE_FIRST && find_segment(work, line->border, 0, &segment) &&
        contains_end(work, node, &segment, 0))
        bits |= BEFORE_FIRST;
    if (line->corners & BEYOND_LAST && find_segment(work, line->border, line->segments - 1, &segment) &&
        contains_end(work, node, &segment, 1))
        bits |= BEYOND_LAST;
    return bits;
}

/* List the edges of the faces in the sweep's surface, with the corners that these faces contain as bits. */
static pliant_status list_edges(const cut_splitting *work, const border_line *line, cut_edge_points *list)
{
    pliant_status status = PLIANT_OK;
    for (int32_t t = 0; t < work->num_tets; t++)
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < i && status == PLIANT_OK; j++) {
                const int32_t *node = work->corners + 4 * (size_t)t;
                uint8_t bits = 0;
                if (!(work->on[node[i]] & work->on[node[j]] & CUT_ON_SWEEP)) continue;
                for (int k = 0; k < 4; k++) {
                    const int32_t *face[3] = {node + i, node + j, node + k};
                    if (k != i && k != j && work->on[node[k]] & CUT_ON_SWEEP) bits |= corners_in(work, line, face);
                }
                status = pliant_split_list_edge(list, node[i], node[j], 0);
                if (status == PLIANT_OK) list->edges[list->count - 1].bits = bits;
            }
    return status;
}

/* Find where a border crosses an edge, or else where its continuation does. Set the bits of the node there. */
static bool find_crossing(const cut_splitting *work, const border_line *line, cut_edge_point *edge)
{
    const uint8_t corners = edge->bits;
    border_segment segment;
    double at;
    edge->bits = CUT_ON_SWEEP | CUT_ON_SURFACE | CUT_PASSED | CUT_ON_BORDER;
    for (int32_t i = 0; i < line->segments; i++)
        if (find_segment(work, line->border, i, &segment) && crosses(work, &segment, edge, &at) && at >= 0 && at <= 1)
            return true;
    edge->bits = CUT_ON_SWEEP | CUT_ON_SURFACE | CUT_ON_BORDER;
    return (corners & BEFORE_FIRST && find_segment(work, line->border, 0, &segment) &&
            crosses(work, &segment, edge, &at) && at < 0) ||
           (corners & BEYOND_LAST && find_segment(work, line->border, line->segments - 1, &segment) &&
            crosses(work, &segment, edge, &at) && at > 1);
}

static pliant_status trim(cut_splitting *work, int border)
{
    const border_line line = find_line(work, border);
    cut_edge_points list = {0};
    for (int32_t n = 0; n < work->num_nodes; n++) work->on[n] &= (uint8_t)~CUT_ON_BORDER;
    pliant_status status = list_edges(work, &line, &list);
    if (status == PLIANT_OK && list.count > 0) {
        int32_t kept = 0;
        qsort(list.edges, (size_t)list.count, sizeof *list.edges, pliant_split_by_ends);
        for (int32_t e = 0, last; e < list.count; e = last) {
            cut_edge_point edge = list.edges[e];
            for (last = e; last < list.count && memcmp(list.edges[last].end, edge.end, sizeof edge.end) == 0; last++)
                edge.bits |= list.edges[last].bits;
            /* the loop does not read this entry again */
            if (find_crossing(work, &line, &edge)) list.edges[kept++] = edge;
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
