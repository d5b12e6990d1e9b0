#include "contact/detect/part_broad_phase.h"

#include "base/buffer.h"
#include "base/fail.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

static pliant_status reserve_triangles(pliant_broad *broad, int32_t triangles)
{
    if (triangles <= broad->near_capacity && broad->near) return PLIANT_OK;
    if (!pliant_grow(&broad->near, (size_t)triangles + 1, sizeof *broad->near) ||
        !pliant_grow(&broad->ball, (size_t)triangles + 1, sizeof *broad->ball))
        return pliant_fail_memory("contacts");
    broad->near_capacity = triangles;
    return PLIANT_OK;
}

typedef struct box { double low[3], high[3]; } box;

/* Return the box around a part's motion in the leg and its margin. */
static box box_of(const pliant_moving_part *part)
{
    box around;
    pliant_part_box(part->part, &part->begin, around.low, around.high);
    for (int d = 0; d < 3; d++) {
        around.low[d] -= part->margin + part->max_motion;
        around.high[d] += part->margin + part->max_motion;
    }
    return around;
}

/* A half-space of an obstacle has an infinite box. */
static pliant_near_region region_of(const pliant_moving_part *part)
{
    const box around = box_of(part);
    pliant_near_region region = {.offset = INFINITY};
    memcpy(region.low, around.low, sizeof region.low);
    memcpy(region.high, around.high, sizeof region.high);
    if (part->part->kind == PLIANT_PART_HALF_SPACE && !part->shape)
        pliant_near_limit_to_half_space(part->part, part->margin + part->max_motion, &region);
    return region;
}

static pliant_ball ball_of(const double *positions, const int32_t *nodes)
{
    pliant_ball ball = {.radius = 0};
    for (int d = 0; d < 3; d++)
        ball.middle[d] = (positions[3 * (size_t)nodes[0] + (size_t)d] + positions[3 * (size_t)nodes[1] + (size_t)d] +
                          positions[3 * (size_t)nodes[2] + (size_t)d]) /
                         3;
    for (int v = 0; v < 3; v++) {
        const double *x = positions + 3 * (size_t)nodes[v];
        double square = 0;
        for (int d = 0; d < 3; d++) square += (x[d] - ball.middle[d]) * (x[d] - ball.middle[d]);
        ball.radius = fmax(ball.radius, sqrt(square));
    }
    return ball;
}

static bool is_apart(const box *around, const double *positions, const int32_t *nodes)
{
    for (int d = 0; d < 3; d++) {
        const double a = positions[3 * (size_t)nodes[0] + (size_t)d], b = positions[3 * (size_t)nodes[1] + (size_t)d],
                     c = positions[3 * (size_t)nodes[2] + (size_t)d];
        if ((a < around->low[d] && b < around->low[d] && c < around->low[d]) ||
            (a > around->high[d] && b > around->high[d] && c > around->high[d]))
            return true;
    }
    return false;
}

pliant_status pliant_broad_find_all(pliant_broad *broad, const pliant_body *body, const double *positions,
                                    int32_t count, const pliant_moving_part *parts, const pliant_near_finder *finder)
{
    if (!pliant_ensure(&broad->region, (size_t)count, sizeof *broad->region)) return pliant_fail_memory("contacts");
    for (int32_t p = 0; p < count; p++) broad->region[p] = region_of(parts + p);
    const pliant_triangle_list list = pliant_near_find(finder, body->num_triangles, count, broad->region);
    const pliant_status status = reserve_triangles(broad, list.count);
    if (status != PLIANT_OK) return status;
    box around = box_of(parts);
    for (int32_t p = 1; p < count; p++) {
        const box one = box_of(parts + p);
        for (int d = 0; d < 3; d++) {
            around.low[d] = fmin(around.low[d], one.low[d]);
            around.high[d] = fmax(around.high[d], one.high[d]);
        }
    }
    broad->num_near = 0;
    for (int32_t n = 0; n < list.count; n++) {
        const int32_t t = pliant_triangle_at(&list, n), *nodes = body->triangles + 3 * (size_t)t;
        if (is_apart(&around, positions, nodes)) continue;
        broad->near[broad->num_near] = t;
        broad->ball[broad->num_near++] = ball_of(positions, nodes);
    }
    return PLIANT_OK;
}

int32_t pliant_broad_find(const pliant_broad *broad, const pliant_moving_part *part, int32_t *out)
{
    const box around = box_of(part);
    int32_t found = 0;
    for (int32_t n = 0; n < broad->num_near; n++) {
        const pliant_ball *ball = broad->ball + n;
        double local[3], normal[3];
        bool separated = false;
        for (int d = 0; d < 3; d++)
            separated = separated || ball->middle[d] + ball->radius < around.low[d] ||
                    ball->middle[d] - ball->radius > around.high[d];
        if (separated) continue;
        pliant_pose_from(&part->begin, ball->middle, local);
        if (pliant_part_distance(part->part, local, normal) <= ball->radius + part->margin + part->max_motion)
            out[found++] = broad->near[n];
    }
    return found;
}

void pliant_broad_free(pliant_broad *broad)
{
    pliant_free(broad->near);
    pliant_free(broad->ball);
    pliant_free(broad->region);
}
