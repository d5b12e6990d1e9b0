#include "contact/detect/broad.h"

#include "base/fail.h"
#include "pliant/memory.h"

#include <math.h>
#include <string.h>

/* ---- room, and the list of the surface's nodes */

static pliant_status make_room(pliant_broad *broad, int32_t nodes, int32_t triangles)
{
    if (nodes > broad->room_nodes || !broad->last) {
        double *last = pliant_resize(broad->last, (size_t)nodes + 1, 3 * sizeof *last);
        if (last) broad->last = last;
        uint8_t *side = pliant_resize(broad->side, (size_t)nodes + 1, sizeof *side);
        if (side) broad->side = side;
        int32_t *surface = pliant_resize(broad->surface, (size_t)nodes + 1, sizeof *surface);
        if (surface) broad->surface = surface;
        if (!last || !side || !surface) return pliant_fail_memory("contacts");
        broad->room_nodes = nodes;
    }
    if (triangles > broad->room_near || !broad->near) {
        int32_t *near = pliant_resize(broad->near, (size_t)triangles + 1, sizeof *near);
        if (near) broad->near = near;
        pliant_ball *ball = pliant_resize(broad->ball, (size_t)triangles + 1, sizeof *ball);
        if (ball) broad->ball = ball;
        if (!near || !ball) return pliant_fail_memory("contacts");
        broad->room_near = triangles;
    }
    return PLIANT_OK;
}

/* Nodes that are new to the surface have not moved, as far as is known. */
static void list_surface(pliant_broad *broad, const pliant_body *body, const double *positions)
{
    enum { SEEN = 1, BEFORE = 2 };
    memset(broad->side, 0, (size_t)body->fine.num_nodes);
    for (int32_t s = 0; s < broad->num_surface; s++)
        if (broad->surface[s] < body->fine.num_nodes) broad->side[broad->surface[s]] = BEFORE;
    broad->num_surface = 0;
    for (int32_t c = 0; c < 3 * body->num_triangles; c++) {
        const int32_t node = body->triangles[c];
        if (broad->side[node] & SEEN) continue;
        if (!(broad->side[node] & BEFORE)) memcpy(broad->last + 3 * node, positions + 3 * node, 3 * sizeof *positions);
        broad->side[node] |= SEEN;
        broad->surface[broad->num_surface++] = node;
    }
    broad->num_nodes = body->fine.num_nodes;
    broad->revision = body->revision;
}

/* ---- near any part */

typedef struct box { double low[3], high[3]; } box;

/* around a part all the way, and as far as it looks */
static box box_of(const pliant_moving_part *part)
{
    box around = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    const double grow = part->margin + (part->num_poses > 1 ? part->stride : 0);
    for (int32_t p = 0; p < part->num_poses; p++) {
        double low[3], high[3];
        pliant_part_box(part->part, part->pose + p, low, high);
        for (int d = 0; d < 3; d++) {
            around.low[d] = fmin(around.low[d], low[d] - grow);
            around.high[d] = fmax(around.high[d], high[d] + grow);
        }
    }
    return around;
}

/* a bit for each side of the box beyond which the node is, and stays if it goes on as in the last step */
static uint8_t side_of(const box *around, const double x[3], const double last[3])
{
    uint8_t side = 0;
    for (int d = 0; d < 3; d++) {
        const double next = 2 * x[d] - last[d];
        side |= (uint8_t)((x[d] < around->low[d] && next < around->low[d]) << (2 * d));
        side |= (uint8_t)((x[d] > around->high[d] && next > around->high[d]) << (2 * d + 1));
    }
    return side;
}

double pliant_broad_way(const pliant_broad *broad, const double *positions, int32_t node)
{
    const double *x = positions + 3 * node, *last = broad->last + 3 * node;
    return sqrt(pow(x[0] - last[0], 2) + pow(x[1] - last[1], 2) + pow(x[2] - last[2], 2));
}

static pliant_ball ball_of(const pliant_broad *broad, const double *positions, const int32_t *nodes)
{
    pliant_ball ball = {.radius = 0};
    double way = 0;
    for (int d = 0; d < 3; d++) ball.middle[d] = (positions[3 * nodes[0] + d] + positions[3 * nodes[1] + d] + positions[3 * nodes[2] + d]) / 3;
    for (int v = 0; v < 3; v++) {
        const double *x = positions + 3 * nodes[v];
        ball.radius = fmax(ball.radius, sqrt(pow(x[0] - ball.middle[0], 2) + pow(x[1] - ball.middle[1], 2) + pow(x[2] - ball.middle[2], 2)));
        way = fmax(way, pliant_broad_way(broad, positions, nodes[v]));
    }
    ball.radius += way;
    return ball;
}

pliant_status pliant_broad_begin(pliant_broad *broad, const pliant_body *body, const double *positions, int32_t count, const pliant_moving_part *parts)
{
    pliant_status status = make_room(broad, body->fine.num_nodes, body->num_triangles);
    if (status != PLIANT_OK) return status;
    if (!broad->knows_last) broad->num_surface = 0;
    if (!broad->knows_last || broad->revision != body->revision) list_surface(broad, body, positions);
    broad->knows_last = true;
    box around = box_of(parts);
    for (int32_t p = 1; p < count; p++) {
        const box one = box_of(parts + p);
        for (int d = 0; d < 3; d++) {
            around.low[d] = fmin(around.low[d], one.low[d]);
            around.high[d] = fmax(around.high[d], one.high[d]);
        }
    }
    for (int32_t s = 0; s < broad->num_surface; s++) {
        const int32_t node = broad->surface[s];
        broad->side[node] = side_of(&around, positions + 3 * node, broad->last + 3 * node);
    }
    broad->num_near = 0;
    for (int32_t t = 0; t < body->num_triangles; t++) {
        const int32_t *nodes = body->triangles + 3 * t;
        if (broad->side[nodes[0]] & broad->side[nodes[1]] & broad->side[nodes[2]]) continue;
        broad->near[broad->num_near] = t;
        broad->ball[broad->num_near++] = ball_of(broad, positions, nodes);
    }
    return PLIANT_OK;
}

/* ---- near one part */

/* whether the part comes as near as it looks to any point of the ball */
static bool comes_near(const pliant_moving_part *part, const pliant_ball *ball)
{
    double local[3], normal[3];
    for (int32_t p = part->num_poses > 2 ? 0 : part->num_poses - 1;;) {
        pliant_pose_from(part->pose + p, ball->middle, local);
        const double left = pliant_part_distance(part->part, local, normal) - ball->radius - part->margin;
        if (left <= 0) return true;
        if (p == part->num_poses - 1) return false;
        p += 1 + (int32_t)fmin(left / part->stride, part->num_poses);
        if (p >= part->num_poses) p = part->num_poses - 1;
    }
}

int32_t pliant_broad_find(const pliant_broad *broad, const pliant_moving_part *part, int32_t *out)
{
    const box around = box_of(part);
    int32_t found = 0;
    for (int32_t n = 0; n < broad->num_near; n++) {
        const pliant_ball *ball = broad->ball + n;
        bool apart = false;
        for (int d = 0; d < 3; d++) apart = apart || ball->middle[d] + ball->radius < around.low[d] || ball->middle[d] - ball->radius > around.high[d];
        if (!apart && comes_near(part, ball)) out[found++] = broad->near[n];
    }
    return found;
}

void pliant_broad_end(pliant_broad *broad, const double *positions)
{
    for (int32_t s = 0; s < broad->num_surface; s++) {
        const int32_t node = broad->surface[s];
        memcpy(broad->last + 3 * node, positions + 3 * node, 3 * sizeof *positions);
    }
}

pliant_status pliant_broad_copy(const pliant_broad *from, pliant_broad *to)
{
    pliant_status status = from->knows_last ? make_room(to, from->num_nodes, 0) : PLIANT_OK;
    if (status != PLIANT_OK) return status;
    to->knows_last = from->knows_last;
    to->revision = from->revision;
    to->num_nodes = from->num_nodes;
    to->num_surface = from->num_surface;
    if (!from->knows_last) return PLIANT_OK;
    memcpy(to->surface, from->surface, (size_t)from->num_surface * sizeof *to->surface);
    memcpy(to->last, from->last, 3 * (size_t)from->num_nodes * sizeof *to->last);
    return PLIANT_OK;
}

void pliant_broad_free(pliant_broad *broad)
{
    pliant_free(broad->last);
    pliant_free(broad->side);
    pliant_free(broad->surface);
    pliant_free(broad->near);
    pliant_free(broad->ball);
}
