/* Conservative advancement of one pair. Three lower bounds of the distance are computed, and the bound that permits
 * the longest time is used:
 * - A plane that turns with the part. The part stays behind it, so only the triangle's corners move through it. It
 *   suits a part that turns far from its tip, and tissue that turns with the part.
 * - A plane with constant direction. The corners stay in front of it, and the part's own points behind it. It suits
 *   a part that turns about the contact point, or rolls.
 * - The distance divided by the largest relative speed.
 * Points of the part move on arcs. Over a time s an arc leaves its tangent by at most bend s^2 / 2, where bend is
 * its largest acceleration. */
#include "contact/advance/pair.h"

#include "contact/advance/advance_rules.h"
#include "contact/advance/convex_bound.h"
#include "contact/shapes/solid.h"

#include <math.h>
#include <string.h>

/* A pair at one time. */
typedef struct moment {
    const pliant_advance_motion *motion;
    const pliant_advance_triangle *triangle;
    pliant_advance_state state;
    pliant_distance_bound cut;
    double left; /* of the leg */
    double limit;
    double at[3][3];    /* corners */
    double normal[3];   /* of the cut */
    double point[3];    /* of the cut, as a point of the part */
    double velocity[3]; /* velocity of the point */
} moment;

void pliant_advance_triangle_init(const int32_t node[3], const double *from, const double *to,
                                  pliant_advance_triangle *out)
{
    for (int c = 0; c < 3; c++)
        for (int d = 0; d < 3; d++) {
            out->from[c][d] = from[3 * (size_t)node[c] + (size_t)d];
            out->rate[c][d] = to[3 * (size_t)node[c] + (size_t)d] - out->from[c][d];
        }
}

static void look(moment *now, double t, double weight[3])
{
    double local[3][3];
    now->left = 1 - t;
    pliant_advance_motion_at(now->motion, t, &now->state);
    for (int c = 0; c < 3; c++) {
        for (int d = 0; d < 3; d++) now->at[c][d] = now->triangle->from[c][d] + t * now->triangle->rate[c][d];
        pliant_pose_from(&now->state.pose, now->at[c], local[c]);
    }
    if (pliant_part_cell_size(&now->motion->core) > 0) {
        const double far = 10 * now->motion->leg->guard; /* beyond this distance the limit is nearly constant */
        now->cut = (pliant_distance_bound){
            .minimum = pliant_field_minimum(&now->motion->core, (const double(*)[3])local, far)};
        return;
    }
    pliant_distance_bound_find(&now->motion->core, (const double(*)[3])local, weight, &now->cut);
    pliant_pose_turn(&now->state.pose, now->cut.normal, now->normal);
    pliant_pose_to(&now->state.pose, now->cut.point, now->point);
    pliant_advance_motion_velocity(now->motion, &now->state, now->point, now->velocity);
}

/* ---- bounds */

/* A capsule is symmetric about its axis, so its plane need not follow the roll. */
static void find_turn(const moment *now, double out[3], double *speed, double *bend)
{
    const pliant_advance_motion *motion = now->motion;
    const double turn = motion->turn, jaw = fabs(motion->jaw);
    double local[3], axis[3], side[3];
    pliant_advance_motion_angular_velocity(motion, &now->state, out);
    *speed = turn + jaw;
    *bend = *speed * *speed;
    if (motion->core.kind != PLIANT_PART_CAPSULE) return;
    for (int d = 0; d < 3; d++) local[d] = motion->core.to[d] - motion->core.from[d];
    const double length = pliant_length3(local);
    if (!(length > 0)) return;
    for (int d = 0; d < 3; d++) local[d] /= length;
    pliant_pose_turn(&now->state.pose, local, axis);
    const double roll = pliant_dot3(out, axis);
    pliant_cross3(out, axis, side);
    for (int d = 0; d < 3; d++) out[d] -= roll * axis[d];
    if (jaw > 0) { /* the roll is not constant: its rate, and the rate of the sum, are at most turn jaw */
        *bend = 2 * turn * jaw + 2 * *speed * *speed;
        return;
    }
    *speed = pliant_length3(side);
    *bend = *speed * (fabs(roll) + *speed);
}

/* Return the free time by the turning plane. The height of a corner is h = normal . (x - point) + offset. Its
 * second derivative is normal''. (x - point) + 2 normal'. (x - point)' + normal . (x - point)''. */
static double turning_plane(const moment *now)
{
    const double accelerated = pliant_advance_motion_max_acceleration(now->motion, &now->state, now->point);
    double turn[3], normal_rate[3], speed, bend, step = now->left;
    find_turn(now, turn, &speed, &bend);
    pliant_cross3(turn, now->normal, normal_rate);
    for (int c = 0; c < 3; c++) {
        double offset[3], rate[3];
        for (int d = 0; d < 3; d++) {
            offset[d] = now->at[c][d] - now->point[d];
            rate[d] = now->triangle->rate[c][d] - now->velocity[d];
        }
        const double slope = pliant_dot3(normal_rate, offset) + pliant_dot3(now->normal, rate);
        const double length = pliant_length3(offset), fast = pliant_length3(rate);
        double within = now->left, reached = 0;
        for (int round = 0; round < 3 && reached < within && within > 0;
             round++) { /* the bound is sharper over a shorter time */
            const double fastest = fast + accelerated * within;
            const double curve = bend * (length + fastest * within) + 2 * speed * fastest + accelerated;
            reached = fmax(reached, fmin(within, pliant_advance_time(now->cut.at[c] - now->limit, slope, curve)));
            within = fmin(now->left, 2 * reached);
        }
        step = fmin(step, reached);
    }
    return step;
}

/* Return the number of points whose convex hull, enlarged by the core's radius, contains the core. */
static int32_t count_points(const pliant_part *core)
{
    if (core->kind == PLIANT_PART_SPHERE) return 1;
    if (core->kind == PLIANT_PART_CAPSULE) return 2;
    return core->kind == PLIANT_PART_BOX                            ? 8
           : core->kind == PLIANT_PART_SOLID && core->solid->convex ? core->solid->num_points
                                                                    : 0;
}

static void get_point(const pliant_part *core, int32_t k, double out[3])
{
    for (int d = 0; d < 3; d++) {
        if (core->kind == PLIANT_PART_SOLID)
            out[d] = core->from[d] + core->solid->points[3 * (size_t)k + (size_t)d];
        else
            out[d] = (core->kind == PLIANT_PART_CAPSULE ? k
                      : core->kind == PLIANT_PART_BOX   ? k >> d & 1
                                                        : 0)
                         ? core->to[d]
                         : core->from[d];
    }
}

static double fixed_plane(const moment *now)
{
    const pliant_part *core = &now->motion->core;
    const double size = pliant_length3(now->normal);
    const int32_t count = size > 0 ? count_points(core) : 0;
    double normal[3], height[3], rate[3], step = count > 0 ? now->left : 0;
    for (int d = 0; d < 3 && count > 0; d++) normal[d] = now->normal[d] / size;
    for (int c = 0; c < 3 && count > 0; c++) {
        double offset[3];
        for (int d = 0; d < 3; d++) offset[d] = now->at[c][d] - now->point[d];
        height[c] = pliant_dot3(normal, offset) - core->radius - now->limit;
        rate[c] = pliant_dot3(normal, now->triangle->rate[c]);
    }
    for (int32_t k = 0; k < count && step > 0; k++) {
        double local[3], place[3], offset[3], velocity[3];
        get_point(core, k, local);
        pliant_pose_to(&now->state.pose, local, place);
        pliant_advance_motion_velocity(now->motion, &now->state, place, velocity);
        for (int d = 0; d < 3; d++) offset[d] = place[d] - now->point[d];
        const double own = pliant_dot3(normal, offset), own_rate = pliant_dot3(normal, velocity);
        const double bend = pliant_advance_motion_max_acceleration(now->motion, &now->state, place);
        for (int c = 0; c < 3; c++) step = fmin(step, pliant_advance_time(height[c] - own, rate[c] - own_rate, bend));
    }
    return step;
}

static double by_speed(const moment *now)
{
    const pliant_advance_motion *motion = now->motion;
    double fastest = 0;
    for (int c = 0; c < 3; c++) {
        double rate[3];
        for (int d = 0; d < 3; d++) rate[d] = now->triangle->rate[c][d] - motion->tip_rate[d];
        fastest = fmax(fastest, pliant_length3(rate));
    }
    fastest += motion->speed;
    if (pliant_part_cell_size(&motion->core) > 0) fastest *= PLIANT_FIELD_SLOPE;
    return fastest > 0 ? fmin(now->left, (now->cut.minimum - now->limit) / fastest) : now->left;
}

/* ---- a leg */

double pliant_advance_pair_distance(const pliant_advance_motion *motion, const pliant_advance_triangle *triangle,
                                    double t, double weight[3])
{
    moment now = {.motion = motion, .triangle = triangle};
    look(&now, t, weight);
    return now.cut.minimum;
}

bool pliant_advance_pair_step(const pliant_contact_settings *settings, const pliant_advance_motion *motion,
                              const pliant_advance_triangle *triangle, pliant_advance_pair *pair)
{
    moment now = {.motion = motion, .triangle = triangle};
    look(&now, pair->t, pair->weight);
    if (pair->iterations == 0) {
        if (!(now.cut.minimum > 0)) {
            pair->exempt = motion->leg->released;
            pair->t = pair->exempt ? 1 : 0;
            return true;
        }
        pair->limit = pliant_advance_limit(settings, motion->leg->guard, now.cut.minimum);
    }
    now.limit = pair->limit;
    const double distance = now.cut.minimum - now.limit;
    if (distance < 0) return true;
    double step = by_speed(&now);
    if (step < now.left && pliant_part_cell_size(&motion->core) > 0) {
        const double before = pair->t;
        pair->t = pliant_field_free_time(motion, triangle, before, now.limit);
        pair->iterations++;
        return pair->t >= 1 || pair->iterations >= PLIANT_ADVANCE_ITERATIONS ||
               pair->t - before < PLIANT_ADVANCE_MIN_PROGRESS;
    }
    if (step < now.left) step = fmax(step, turning_plane(&now));
    if (step < now.left) step = fmax(step, fixed_plane(&now));
    if (step >= now.left) {
        pair->t = 1;
        return true;
    }
    pair->t += PLIANT_ADVANCE_SAFETY * step;
    pair->iterations++;
    return pliant_advance_is_finished(pair->iterations, step, distance, now.limit);
}
