#include "tool/blade.h"

#include "base/fail.h"
#include "base/rotate.h"
#include "cut/cut.h"
#include "tool/tool.h"
#include "base/memory.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_POINTS = 4096 };

/* ---- named blades, with common sizes of endoscopic instruments */

static const struct { const char *name; double from[3], to[3]; } blades[] = {
    {"scalpel", {0, 0, -0.02}, {0, 0, 0}},  /* along the instrument */
    {"scissors", {0, 0, -0.01}, {0, 0, 0}}, /* where the two blades meet */
    {"hook", {0, 0.004, 0}, {0, 0, 0}},     /* across the instrument */
};

pliant_status pliant_blade_find(const char *name, double from[3], double to[3])
{
    for (size_t n = 0; n < sizeof blades / sizeof *blades; n++) {
        if (strcmp(blades[n].name, name) != 0) continue;
        memcpy(from, blades[n].from, sizeof blades[n].from);
        memcpy(to, blades[n].to, sizeof blades[n].to);
        return PLIANT_OK;
    }
    return pliant_fail(PLIANT_ERROR_ARGUMENT, "there is no blade '%.48s': scalpel, scissors and hook are known", name);
}

/* ---- settings of a blade */

double pliant_blade_length(const pliant_blade *blade)
{
    return sqrt(pow(blade->to[0] - blade->from[0], 2) + pow(blade->to[1] - blade->from[1], 2) +
                pow(blade->to[2] - blade->from[2], 2));
}

bool pliant_blade_has_pose(const pliant_blade *blade)
{
    const double *q = blade->rotation;
    return q[0] != 0 || q[1] != 0 || q[2] != 0 || q[3] != 0;
}

static pliant_status find_tool(pliant_data *data, int index, pliant_tool **out)
{
    if (index < 0 || index >= data->num_tools)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "there is no tool %d: %d were added", index, data->num_tools);
    *out = data->tools + index;
    return PLIANT_OK;
}

pliant_status pliant_tool_set_blade(pliant_data *data, int index, const double from[3], const double to[3])
{
    pliant_tool *tool = NULL;
    pliant_status status = find_tool(data, index, &tool);
    if (status != PLIANT_OK) return status;
    pliant_blade wanted = {.from = {from[0], from[1], from[2]}, .to = {to[0], to[1], to[2]}};
    const double length = pliant_blade_length(&wanted);
    if (!(length <= 1))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "tool %s: its blade is %g m long; up to 1 m are possible", tool->name,
                           length);
    pliant_blade_end_stroke(tool);
    memcpy(tool->blade.from, wanted.from, sizeof wanted.from);
    memcpy(tool->blade.to, wanted.to, sizeof wanted.to);
    if (length == 0) tool->blade.cutting = false;
    return PLIANT_OK;
}

pliant_tool_pose pliant_blade_pose(const pliant_tool *tool)
{
    return tool->shape.num_parts > 0 && tool->proxy.known ? pliant_tool_proxy(tool) : pliant_tool_measured(tool);
}

static void set_pose(pliant_blade *blade, const pliant_tool_pose *pose)
{
    memcpy(blade->tip, pose->tip, sizeof blade->tip);
    memcpy(blade->rotation, pose->rotation, sizeof blade->rotation);
}

/* Subdivided elements separate by whole faces. The next step therefore cuts the faces in which the stroke ends. */
static void switch_off(const pliant_data *data, pliant_tool *tool)
{
    pliant_blade *blade = &tool->blade;
    if (!data->body->subdivision || !blade->is_in_stroke) {
        pliant_blade_end_stroke(tool);
        return;
    }
    pliant_blade_release(tool);
    blade->is_ending = true;
    blade->engaged_length = 0;
}

pliant_status pliant_tool_set_cutting(pliant_data *data, int index, bool on)
{
    pliant_tool *tool = NULL;
    pliant_status status = find_tool(data, index, &tool);
    if (status != PLIANT_OK) return status;
    if (on && !pliant_body_is_cuttable(data->body))
        return pliant_fail(PLIANT_ERROR_ARGUMENT,
                           "tool %s: this scene does not cut: set cut/kind to sever and build the model again",
                           tool->name);
    if (on && memcmp(tool->blade.from, tool->blade.to, sizeof tool->blade.from) == 0)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "tool %s has no blade (pliant_tool_set_blade)", tool->name);
    if (!on) switch_off(data, tool);
    else if (tool->blade.is_ending) pliant_blade_end_stroke(tool);
    const pliant_tool_pose pose = pliant_blade_pose(tool);
    if (on && !tool->blade.cutting && tool->present) set_pose(&tool->blade, &pose);
    tool->blade.cutting = on;
    return PLIANT_OK;
}

/* ---- a stroke */

static void free_edge(pliant_edge *edge)
{
    PLIANT_FREE(edge->place, edge->tet, edge->weight, edge->carrier, edge->carrier_offset, edge->now, edge->swept);
    memset(edge, 0, sizeof *edge);
}

pliant_status pliant_edge_create(int32_t count, double reach, pliant_edge *edge)
{
    const size_t points = (size_t)count;
    edge->count = count;
    edge->reach = reach;
    edge->place = pliant_calloc(points, 3 * sizeof *edge->place);
    edge->tet = pliant_calloc(points, sizeof *edge->tet);
    edge->weight = pliant_calloc(points, 4 * sizeof *edge->weight);
    edge->carrier = pliant_calloc(points, sizeof *edge->carrier);
    edge->carrier_offset = pliant_calloc(points, 3 * sizeof *edge->carrier_offset);
    edge->now = pliant_calloc(points, 3 * sizeof *edge->now);
    edge->swept = pliant_calloc(points, 3 * sizeof *edge->swept);
    if (edge->place && edge->tet && edge->weight && edge->carrier && edge->carrier_offset && edge->now && edge->swept)
        return PLIANT_OK;
    free_edge(edge);
    return pliant_fail_memory("the edge of a blade");
}

void pliant_blade_points(const pliant_blade *blade, const double tip[3], const double rotation[4], double *out)
{
    double from[3], to[3];
    pliant_rotate(rotation, blade->from, from);
    pliant_rotate(rotation, blade->to, to);
    for (int32_t p = 0; p < blade->edge.count; p++) {
        double part = (double)p / (blade->edge.count - 1);
        for (int d = 0; d < 3; d++) out[3 * p + d] = tip[d] + (1 - part) * from[d] + part * to[d];
    }
}

/* Compute for each point of the edge the squared distance to the nearest point of the edge in tissue, at most the
 * squared reach. Return whether a point is outside tissue. */
static bool measure_along(const pliant_edge *edge, double spacing, double *squares)
{
    bool any = false;
    for (int direction = -1; direction <= 1; direction += 2) {
        double far = edge->reach;
        for (int32_t n = 0; n < edge->count; n++) {
            const int32_t p = direction > 0 ? n : edge->count - 1 - n;
            far = edge->tet[p] >= 0 ? 0 : fmin(far + spacing, edge->reach);
            any = any || edge->tet[p] < 0;
            squares[p] = direction > 0 ? fmin(squares[p], far * far) : far * far;
        }
    }
    return any;
}

/* For each edge point outside tissue, find the nearest mesh node, unless an edge point in tissue is nearer. The point
 * moves with that node, so that tissue cannot move past it undetected. */
static void find_carrier_nodes(const pliant_data *data, pliant_edge *edge)
{
    const double *first = edge->now, *last = edge->now + 3 * (edge->count - 1);
    /* used as a buffer until the offsets are written below */
    double along[3], low[3], high[3], spacing = 0, *squares = edge->carrier_offset;
    for (int d = 0; d < 3; d++) {
        along[d] = (last[d] - first[d]) / (edge->count - 1);
        spacing += along[d] * along[d];
        low[d] = fmin(first[d], last[d]) - edge->reach;
        high[d] = fmax(first[d], last[d]) + edge->reach;
    }
    spacing = sqrt(spacing);
    for (int32_t p = 0; p < edge->count; p++) edge->carrier[p] = -1;
    if (!measure_along(edge, spacing, squares)) return;
    for (int32_t n = 0; n < data->body->fine.num_nodes; n++) {
        const double *x = data->positions + 3 * (size_t)n;
        if (!(x[0] >= low[0] && x[0] <= high[0] && x[1] >= low[1] && x[1] <= high[1] && x[2] >= low[2] &&
              x[2] <= high[2]))
            continue;
        const double from[3] = {x[0] - first[0], x[1] - first[1], x[2] - first[2]};
        const double at = (from[0] * along[0] + from[1] * along[1] + from[2] * along[2]) / (spacing * spacing);
        double aside = 0;
        for (int d = 0; d < 3; d++) aside += pow(from[d] - at * along[d], 2);
        const double half = sqrt(fmax(edge->reach * edge->reach - aside, 0)) / spacing;
        for (int32_t p = (int32_t)fmax(ceil(at - half), 0); p <= (int32_t)fmin(floor(at + half), edge->count - 1);
             p++) {
            const double square = aside + pow((p - at) * spacing, 2);
            if (edge->tet[p] >= 0 || square >= squares[p]) continue;
            squares[p] = square;
            edge->carrier[p] = n;
        }
    }
    for (int32_t p = 0; p < edge->count; p++)
        for (int d = 0; d < 3 && edge->carrier[p] >= 0; d++)
            edge->carrier_offset[3 * p + d] = edge->place[3 * p + d] - data->positions[3 * edge->carrier[p] + d];
}

void pliant_blade_set_edge(const pliant_data *data, pliant_edge *edge)
{
    memcpy(edge->place, edge->now, 3 * (size_t)edge->count * sizeof *edge->place);
    pliant_body_locate_points(data->body, data->positions, edge->count, edge->place, edge->tet, edge->weight);
    find_carrier_nodes(data, edge);
}

pliant_status pliant_blade_begin_stroke(pliant_data *data, int index, double spacing, double reach)
{
    pliant_tool *tool = data->tools + index;
    pliant_blade *blade = &tool->blade;
    pliant_status status = pliant_edge_create(
        (int32_t)fmin(fmax(ceil(pliant_blade_length(blade) / spacing), 1), MAX_POINTS - 1) + 1, reach, &blade->edge);
    if (status != PLIANT_OK) return status;
    const pliant_tool_pose pose = pliant_blade_pose(tool);
    pliant_blade_points(blade, pose.tip, pose.rotation, blade->edge.now);
    pliant_blade_set_edge(data, &blade->edge);
    set_pose(blade, &pose);
    blade->is_in_stroke = true;
    blade->pending = 0;
    blade->stroke++;
    return PLIANT_OK;
}

void pliant_blade_end_stroke(pliant_tool *tool)
{
    pliant_blade *blade = &tool->blade;
    pliant_blade_release(tool);
    free_edge(&blade->edge);
    blade->is_in_stroke = blade->failed = blade->is_ending = false;
    memset(blade->rotation, 0, sizeof blade->rotation); /* the blade has no previous pose */
    memset(blade->direction, 0, sizeof blade->direction);
    blade->engaged_length = blade->pending = 0;
}

void pliant_blade_reset(pliant_tool *tool)
{
    pliant_blade_end_stroke(tool);
    tool->blade.stroke = 0;
    tool->blade.severed_area = 0;
    tool->blade.pieces = 0;
}

static void place_of(const pliant_mesh *mesh, const double *positions, const pliant_edge *edge, int32_t point,
                     double out[3])
{
    const int32_t *node = mesh->tets + 4 * edge->tet[point];
    for (int d = 0; d < 3; d++) {
        out[d] = 0;
        for (int v = 0; v < 4; v++) out[d] += edge->weight[4 * point + v] * positions[3 * node[v] + d];
    }
}

/* Move edge points outside tissue with their nearest edge point in tissue, so that no surface edge or link passes
 * between the two. */
static void move_with_carrier(const pliant_edge *edge, int32_t p, const double from[3])
{
    const double *to = edge->place + 3 * p;
    for (int direction = -1; direction <= 1; direction += 2) {
        int32_t end = p + direction, last = end;
        while (last >= 0 && last < edge->count && edge->tet[last] < 0) last += direction;
        const bool up_to_next = last >= 0 && last < edge->count;
        for (; end != last; end += direction) {
            /* the next point in tissue is nearer, or as near */
            if (up_to_next && (last - end) * direction < (end - p) * direction + (direction > 0)) break;
            if (edge->carrier[end] >= 0) continue;
            for (int d = 0; d < 3; d++) edge->place[3 * end + d] += to[d] - from[d];
        }
    }
}

void pliant_blade_move_with_tissue(const pliant_data *data, pliant_edge *edge)
{
    for (int32_t p = 0; p < edge->count; p++) {
        double from[3];
        for (int d = 0; d < 3 && edge->tet[p] < 0 && edge->carrier[p] >= 0; d++)
            edge->place[3 * p + d] = data->positions[3 * edge->carrier[p] + d] + edge->carrier_offset[3 * p + d];
        if (edge->tet[p] < 0) continue;
        memcpy(from, edge->place + 3 * p, sizeof from);
        place_of(&data->body->fine, data->positions, edge, p, edge->place + 3 * p);
        move_with_carrier(edge, p, from);
    }
}

pliant_status pliant_blade_transfer(pliant_blade *blade, const pliant_blade *from, const pliant_data *data,
                                    const pliant_body *next, const double *positions)
{
    *blade = *from;
    memset(&blade->edge, 0, sizeof blade->edge);
    if (!from->is_in_stroke) return PLIANT_OK;
    pliant_edge *edge = &blade->edge;
    pliant_status status = pliant_edge_create(from->edge.count, from->edge.reach, edge);
    if (status != PLIANT_OK) {
        blade->is_in_stroke = blade->is_dragging = false;
        return status;
    }
    memcpy(edge->place, from->edge.place, 3 * (size_t)edge->count * sizeof *edge->place);
    memcpy(edge->now, from->edge.now, 3 * (size_t)edge->count * sizeof *edge->now);
    for (int32_t p = 0; p < edge->count; p++)
        if (from->edge.tet[p] >= 0) place_of(&data->body->fine, data->positions, &from->edge, p, edge->place + 3 * p);
    pliant_body_locate_points(next, positions, edge->count, edge->place, edge->tet, edge->weight);
    memcpy(edge->carrier_offset, from->edge.carrier_offset, 3 * (size_t)edge->count * sizeof *edge->carrier_offset);
    for (int32_t p = 0; p < edge->count; p++) {
        if (from->edge.tet[p] < 0) edge->tet[p] = -1;
        edge->carrier[p] = from->edge.carrier[p] < next->fine.num_nodes ? from->edge.carrier[p] : -1;
    }
    return PLIANT_OK;
}

void pliant_blade_move_to_tissue(const pliant_data *data, pliant_edge *edge, double spacing)
{
    for (int32_t p = 0; p < edge->count; p++) {
        double *place = edge->place + 3 * p, from[3], motion[3];
        memcpy(from, place, sizeof from);
        for (int d = 0; d < 3; d++) motion[d] = edge->now[3 * p + d] - from[d];
        const double length = sqrt(motion[0] * motion[0] + motion[1] * motion[1] + motion[2] * motion[2]);
        const int32_t parts = (int32_t)ceil(length / spacing);
        for (int32_t k = 1; k <= parts && edge->tet[p] < 0; k++) {
            int32_t tet;
            for (int d = 0; d < 3; d++) place[d] = from[d] + motion[d] * k / parts;
            if (pliant_body_locate(data->body, data->positions, place, &tet, edge->weight + 4 * p)) edge->tet[p] = tet;
        }
    }
    find_carrier_nodes(data, edge);
}

int32_t pliant_blade_num_inside(const pliant_edge *edge)
{
    int32_t count = 0;
    for (int32_t p = 0; p < edge->count; p++) count += edge->tet[p] >= 0;
    return count;
}

void pliant_blade_middle(const pliant_edge *edge, const double *points, double out[3])
{
    for (int d = 0; d < 3; d++) out[d] = 0.5 * (points[d] + points[3 * (edge->count - 1) + d]);
}

/* ---- constraint between blade and tissue */

typedef struct held_node { int32_t node; double weight; } held_node;

static int by_node(const void *a, const void *b)
{
    int32_t x = ((const held_node *)a)->node, y = ((const held_node *)b)->node;
    return (x > y) - (x < y);
}

pliant_status pliant_blade_hold(const pliant_body *body, pliant_tool *tool)
{
    const pliant_edge *edge = &tool->blade.edge;
    const int32_t inside = pliant_blade_num_inside(edge);
    held_node *all = pliant_calloc(4 * (size_t)inside, sizeof *all);
    int32_t *held = pliant_calloc(4 * (size_t)inside, sizeof *held), count = 0, nodes = 0;
    double *weight = pliant_calloc(4 * (size_t)inside, sizeof *weight);
    if (!all || !held || !weight) {
        PLIANT_FREE(all, held, weight);
        return pliant_fail_memory("the nodes that the blade drags");
    }
    for (int32_t p = 0; p < edge->count; p++)
        for (int v = 0; v < 4 && edge->tet[p] >= 0; v++)
            all[count++] = (held_node){body->fine.tets[4 * edge->tet[p] + v], edge->weight[4 * p + v] / inside};
    qsort(all, (size_t)count, sizeof *all, by_node);
    for (int32_t n = 0; n < count; n++) {
        if (n == 0 || all[n].node != held[nodes - 1]) held[nodes++] = all[n].node;
        weight[nodes - 1] += all[n].weight;
    }
    pliant_free(all);
    pliant_tool_remove_grasp(tool);
    tool->held = held;
    tool->weight = weight;
    tool->num_held = nodes;
    tool->holding = tool->blade.is_dragging = true;
    return PLIANT_OK;
}

void pliant_blade_release(pliant_tool *tool)
{
    pliant_blade *blade = &tool->blade;
    if (blade->is_dragging) pliant_tool_remove_grasp(tool);
    else if (!tool->holding) memset(tool->force, 0, sizeof tool->force);
    blade->has_slipped = false;
    blade->work = 0;
    memset(blade->free_tissue_force, 0, sizeof blade->free_tissue_force);
    memset(blade->drag_displacement, 0, sizeof blade->drag_displacement);
    memset(blade->moved, 0, sizeof blade->moved);
    memset(blade->force, 0, sizeof blade->force);
}

void pliant_blade_update_force(pliant_tool *tool)
{
    const pliant_blade *blade = &tool->blade;
    const double *drag_displacement = blade->drag_displacement,
                 size = sqrt(drag_displacement[0] * drag_displacement[0] + drag_displacement[1] * drag_displacement[1] +
                             drag_displacement[2] * drag_displacement[2]);
    if (!blade->is_dragging || size == 0) return;
    double along = 0;
    for (int d = 0; d < 3; d++) along += tool->force[d] * drag_displacement[d] / size;
    const double missing = fmax(blade->stiffness * size - along, 0);
    for (int d = 0; d < 3; d++) tool->force[d] += missing * drag_displacement[d] / size;
}
