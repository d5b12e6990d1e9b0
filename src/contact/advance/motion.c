#include "contact/advance/motion.h"

#include "base/rotate.h"
#include "contact/advance/advance_rules.h"
#include "contact/shapes/solid.h"

#include <math.h>
#include <string.h>

static const double box_interval = 0.25; /* turn between two boxes whose hull contains a motion [rad] */

pliant_tool_pose pliant_tool_pose_between(const pliant_tool_pose *from, const pliant_tool_pose *to, double t)
{
    if (t <= 0 || t >= 1) return t <= 0 ? *from : *to;
    pliant_tool_pose out;
    for (int d = 0; d < 3; d++) out.tip[d] = from->tip[d] + t * (to->tip[d] - from->tip[d]);
    pliant_rotation_between(from->rotation, to->rotation, t, out.rotation);
    out.jaw = from->jaw + t * (to->jaw - from->jaw);
    return out;
}

double pliant_advance_guard(const pliant_contact_settings *settings, const pliant_part *part, double smallest_cell)
{
    return fmin(settings->guard_depth,
                fmin(settings->guard_of_part * pliant_part_depth(part), settings->guard_of_cell * smallest_cell));
}

/* Compute the box around the motion, from boxes at equal intervals. Between two of them a point leaves its chord by
 * at most bend / 8 times the square of the interval. */
static void find_box(pliant_advance_motion *motion)
{
    const int count = !motion->still ? 1 + (int)ceil((motion->turn + fabs(motion->jaw)) / box_interval) : 0;
    for (int n = 0; n <= count; n++) {
        pliant_advance_state state;
        double low[3], high[3];
        pliant_advance_motion_at(motion, count > 0 ? (double)n / count : 0, &state);
        pliant_part_box(&motion->core, &state.pose, low, high);
        for (int d = 0; d < 3; d++) {
            motion->low[d] = n == 0 ? low[d] : fmin(motion->low[d], low[d]);
            motion->high[d] = n == 0 ? high[d] : fmax(motion->high[d], high[d]);
        }
    }
    for (int d = 0; count > 0 && d < 3; d++) {
        motion->low[d] -= motion->bend / 8 / count / count;
        motion->high[d] += motion->bend / 8 / count / count;
    }
}

void pliant_advance_motion_init(const pliant_advance_part *leg, bool still, pliant_advance_motion *out)
{
    static const double origin[3] = {0, 0, 0};
    *out = (pliant_advance_motion){
        .leg = leg, .still = still || !leg->shape, .core = pliant_part_core(leg->part, leg->guard)};
    /* The core's signed distance is at most the part's distance plus the guard depth. */
    if (leg->part->kind == PLIANT_PART_SOLID && !leg->part->solid->convex) out->core.radius += leg->part->solid->error;
    if (!out->still) {
        const double size = pliant_length3(leg->shape->axis);
        const double sign = leg->part->frame == PLIANT_FRAME_TIP || !(size > 0) ? 0
                            : leg->part->frame == PLIANT_FRAME_JAW_PLUS         ? 0.5
                                                                                : -0.5;
        for (int d = 0; d < 3; d++) {
            out->tip_rate[d] = leg->to.tip[d] - leg->from.tip[d];
            out->axis[d] = size > 0 ? leg->shape->axis[d] / size : 0;
        }
        pliant_rotation_vector(leg->from.rotation, leg->to.rotation, out->turn_rate);
        out->turn = pliant_length3(out->turn_rate);
        out->jaw = sign * (leg->to.jaw - leg->from.jaw);
        out->jaw_reach = pliant_part_reach(&out->core, leg->shape->joint);
        out->reach = sign == 0 ? pliant_part_reach(&out->core, origin)
                               : pliant_length3(leg->shape->joint) + out->jaw_reach;
        out->bend =
            out->turn * out->turn * out->reach + fabs(out->jaw) * (2 * out->turn + fabs(out->jaw)) * out->jaw_reach;
    }
    out->speed = out->still ? 0 : out->turn * out->reach + fabs(out->jaw) * out->jaw_reach;
    for (int n = 0; n <= PLIANT_ADVANCE_INTERVALS; n++)
        pliant_advance_motion_at(out, n == 0 ? 0.5 : (n - 0.5) / PLIANT_ADVANCE_INTERVALS, out->at + n);
    find_box(out);
}

void pliant_advance_motion_at(const pliant_advance_motion *motion, double t, pliant_advance_state *out)
{
    static const double identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    const pliant_tool_shape *shape = motion->leg->shape;
    *out = (pliant_advance_state){.pose = {.place = {0}}};
    memcpy(out->pose.rotation, identity, sizeof identity);
    if (!shape) return;
    const pliant_tool_pose pose = pliant_tool_pose_between(
        &motion->leg->from, motion->still ? &motion->leg->from : &motion->leg->to, t);
    pliant_part_pose(shape, motion->leg->part->frame, pose.tip, pose.rotation, pose.jaw, &out->pose);
    memcpy(out->tip, pose.tip, sizeof out->tip);
    pliant_rotate(pose.rotation, shape->joint, out->joint);
    pliant_rotate(pose.rotation, motion->axis, out->axis);
    for (int d = 0; d < 3; d++) out->joint[d] += out->tip[d];
}

void pliant_advance_motion_velocity(const pliant_advance_motion *motion, const pliant_advance_state *state,
                                    const double x[3], double out[3])
{
    double from_tip[3], from_joint[3], by_tool[3], by_jaw[3];
    for (int d = 0; d < 3; d++) {
        from_tip[d] = x[d] - state->tip[d];
        from_joint[d] = x[d] - state->joint[d];
    }
    pliant_cross3(motion->turn_rate, from_tip, by_tool);
    pliant_cross3(state->axis, from_joint, by_jaw);
    for (int d = 0; d < 3; d++) out[d] = motion->tip_rate[d] + by_tool[d] + motion->jaw * by_jaw[d];
}

/* The acceleration is the sum of w x (w x r), 2 w x (j x q) and j x (j x q). The angular velocity is w for the tool
 * and j for the jaw. The vector r starts at the tip and q at the joint. The jaw moves r by at most |j| |q|. */
double pliant_advance_motion_max_acceleration(const pliant_advance_motion *motion, const pliant_advance_state *state,
                                              const double x[3])
{
    const double jaw = fabs(motion->jaw);
    double from_tip[3], from_joint[3], side[3];
    for (int d = 0; d < 3; d++) {
        from_tip[d] = x[d] - state->tip[d];
        from_joint[d] = x[d] - state->joint[d];
    }
    pliant_cross3(motion->turn_rate, from_tip, side);
    const double turn = motion->turn, joint = jaw > 0 ? pliant_length3(from_joint) : 0;
    return turn * (pliant_length3(side) + turn * jaw * joint) + jaw * (2 * turn + jaw) * joint;
}

void pliant_advance_motion_angular_velocity(const pliant_advance_motion *motion, const pliant_advance_state *state,
                                            double out[3])
{
    for (int d = 0; d < 3; d++) out[d] = motion->turn_rate[d] + motion->jaw * state->axis[d];
}
