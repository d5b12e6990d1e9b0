#include "sim/step/proxy.h"

#include "base/rotate.h"
#include "base/vector3.h"
#include "contact/shapes/tool_shape.h"
#include "fem/rigid/rigid_pieces.h"

#include <math.h>
#include <string.h>

static const double min_lever = 1e-3; /* shortest lever of a tool's torque limit [m]: a ball at its tip has none */

/* ---- motion between poses */

double pliant_part_max_motion(const pliant_tool_shape *shape, const pliant_part *part, const pliant_tool_pose *from,
                              const pliant_tool_pose *to)
{
    const double origin[3] = {0, 0, 0}, turn = part->frame == PLIANT_FRAME_TIP ? 0 : 0.5 * fabs(to->jaw - from->jaw);
    return pliant_distance3(to->tip, from->tip) + turn * pliant_part_reach(part, shape->joint) +
           pliant_rotation_angle(from->rotation, to->rotation) * pliant_part_reach(part, origin);
}

double pliant_tool_max_motion(const pliant_tool *tool, const pliant_tool_pose *from, const pliant_tool_pose *to)
{
    double motion = pliant_distance3(to->tip, from->tip);
    for (int32_t p = 0; p < tool->shape.num_parts; p++)
        motion = fmax(motion, pliant_part_max_motion(&tool->shape, tool->shape.part + p, from, to));
    return motion;
}

/* ---- the coupling */

void pliant_tool_joint(const pliant_tool *tool, const pliant_tool_pose *pose, double joint[3], double axis[3])
{
    const double size = pliant_length3(tool->shape.axis);
    pliant_rotate(pose->rotation, tool->shape.joint, joint);
    pliant_rotate(pose->rotation, tool->shape.axis, axis);
    for (int d = 0; d < 3; d++) {
        joint[d] += pose->tip[d];
        axis[d] /= size > 0 ? size : 1;
    }
}

void pliant_proxy_find_load(const pliant_data *data, int index, const pliant_tool_pose *pose, pliant_proxy_load *out)
{
    const pliant_tool *tool = data->tools + index;
    double joint[3], axis[3];
    memset(out, 0, sizeof *out);
    pliant_tool_joint(tool, pose, joint, axis);
    for (int32_t p = 0; p < data->contacts.count; p++) {
        const pliant_contact_point *point = data->contacts.point + p;
        if (point->kind != PLIANT_OBSTACLE_TOOL || point->tool != index) continue;
        for (int d = 0; d < 3; d++) {
            const int e = (d + 1) % 3, f = (d + 2) % 3;
            out->wrench[d] -= point->force[d];
            out->wrench[3 + d] -=
                (point->place[e] - pose->tip[e]) * point->force[f] - (point->place[f] - pose->tip[f]) * point->force[e];
            out->jaw -=
                0.5 * point->jaw * axis[d] *
                ((point->place[e] - joint[e]) * point->force[f] - (point->place[f] - joint[f]) * point->force[e]);
        }
    }
}

void pliant_proxy_estimate_tissue_compliance(const pliant_data *data, int index, const pliant_tool_pose *pose,
                                             const pliant_proxy_load *load, double farthest, double out[3])
{
    const double loads[3] = {pliant_length3(load->wrench), pliant_length3(load->wrench + 3), fabs(load->jaw)};
    double moved = 0, force = 0, levers[2] = {0, 0}, joint[3], axis[3];
    pliant_tool_joint(data->tools + index, pose, joint, axis);
    for (int32_t p = 0; p < data->contacts.count; p++) {
        const pliant_contact_point *point = data->contacts.point + p;
        if (point->kind != PLIANT_OBSTACLE_TOOL || point->tool != index) continue;
        const double own = pliant_length3(point->force);
        force += own;
        levers[0] += own * pliant_distance3(point->place, pose->tip);
        levers[1] += own * 0.5 * pliant_distance3(point->place, joint); /* a jaw makes half of the jaws' motion */
        double u[3] = {0, 0, 0};
        for (int32_t k = 0; k < point->count; k++)
            for (int d = 0; d < 3; d++) {
                const size_t at = 3 * (size_t)point->node[k] + (size_t)d;
                u[d] += point->weight[k] * (data->positions[at] - data->body->fine.rest[at]);
            }
        moved += own * pliant_length3(u);
    }
    const double distance = force > 0 ? fmin(moved / force, farthest) : 0;
    for (int k = 0; k < 3; k++) {
        const double lever = k == 0 ? 1 : levers[k - 1] / force;
        out[k] = distance > 0 && loads[k] > 0 && lever > 0 ? distance / lever / loads[k] : 0;
    }
}

/* Quaternion product: rotate by b, then by a. */
static void multiply(const double a[4], const double b[4], double out[4])
{
    out[3] = a[3] * b[3] - pliant_dot3(a, b);
    for (int d = 0; d < 3; d++)
        out[d] = a[3] * b[d] + b[3] * a[d] + a[(d + 1) % 3] * b[(d + 2) % 3] - a[(d + 2) % 3] * b[(d + 1) % 3];
}

pliant_tool_pose pliant_proxy_pose_under_load(const pliant_tool *tool, const pliant_tool_pose *from,
                                              const pliant_contact_body couple[2], const pliant_proxy_load *load)
{
    pliant_tool_pose out = *from;
    double moved[6], turn[4], jaw[6], torque[6] = {0}, joint[3], axis[3];
    pliant_tool_joint(tool, from, joint, axis);
    for (int d = 0; d < 3; d++) torque[3 + d] = axis[d] * load->jaw;
    for (int k = 0; k < 6; k++) {
        moved[k] = pliant_body_motion(couple, load->wrench, k);
        jaw[k] = pliant_body_motion(couple + 1, torque, k);
    }
    for (int d = 0; d < 3; d++) out.tip[d] += moved[d];
    const double angle = pliant_length3(moved + 3);
    for (int d = 0; d < 3; d++) turn[d] = moved[3 + d] * (angle > 0 ? sin(0.5 * angle) / angle : 0.5);
    turn[3] = cos(0.5 * angle);
    if (angle > 0 && pliant_dot3(from->rotation, from->rotation) + from->rotation[3] * from->rotation[3] > 0)
        multiply(turn, from->rotation, out.rotation);
    if (pliant_tool_shape_has_jaws(&tool->shape)) out.jaw += pliant_dot3(axis, jaw + 3);
    return out;
}

/* Return the compliance of a coupling for this distance between proxy and goal. It is `least` for small loads. Near the
 * force limit the compliance increases, so that the load stays below the limit. If the compliance of the tissue is
 * known, `yield_fraction` of it predicts the load, and the proxy moves until this prediction is the limit. So the load
 * stays below the limit if the tissue becomes stiffer by up to 1 / `yield_fraction`. */
static double coupling_compliance(const pliant_contact_settings *settings, double least, double error, double load,
                                  double limit, double yields)
{
    const double slope = 1 / settings->soft_width, careful = settings->yield_fraction * yields,
                 softens = fmin(fmax(slope * load / limit - slope * settings->soft_begin, 0), 1);
    if (yields > 0) return fmax(least, (error + careful * (load - limit)) / load);
    return fmax(least, softens * error / limit);
}

static double reach_of(const pliant_tool *tool)
{
    const double origin[3] = {0, 0, 0};
    double reach = 0;
    for (int32_t p = 0; p < tool->shape.num_parts; p++)
        reach = fmax(reach, pliant_part_reach(tool->shape.part + p, origin));
    return reach;
}

/* Compute the rotation vector from one rotation to another [rad]. */
static void turn_between(const double from[4], const double to[4], double turn[3])
{
    const double back[4] = {-from[0], -from[1], -from[2], from[3]};
    double q[4];
    multiply(to, back, q);
    const double sine = pliant_length3(q), sign = q[3] < 0 ? -1 : 1, angle = 2 * atan2(sine, sign * q[3]);
    for (int d = 0; d < 3; d++) turn[d] = sine > 0 ? sign * q[d] * angle / sine : 0;
}

void pliant_proxy_linearize(const pliant_model *model, const pliant_tool *tool, const pliant_tool_pose *begin,
                            const pliant_tool_pose *goal, const pliant_proxy_load *before, const double added[2],
                            const double yields[3], double longest, pliant_tool_pose *ahead,
                            pliant_contact_body out[2], pliant_touch_limit limit[3])
{
    const pliant_scene *scene = &model->scene;
    const double maximum = scene->contact.max_force, lever = maximum * fmax(reach_of(tool), min_lever),
                 turn_stiffness = scene->contact.coupling_stiffness_rotational;
    static const double none[3] = {0, 0, 0};
    const double *wrench = before->wrench, *pulls = yields[0] > 0 ? none : tool->proxy.coupling_load;
    const double loads[3] = {fmax(pliant_length3(wrench), pulls[0]), fmax(pliant_length3(wrench + 3), pulls[1]),
                             fmax(fabs(before->jaw), pulls[2])};
    const double least[3] = {1 / scene->contact.coupling_stiffness + added[0], 1 / turn_stiffness,
                             1 / turn_stiffness + added[1]};
    const double shift = coupling_compliance(&model->contact, least[0], pliant_distance3(begin->tip, goal->tip),
                                             loads[0], maximum, yields[0]);
    const double turn = coupling_compliance(
        &model->contact, least[1], pliant_rotation_angle(begin->rotation, goal->rotation), loads[1], lever, yields[1]);
    const double jaw = coupling_compliance(&model->contact, least[2], fabs(goal->jaw - begin->jaw), loads[2],
                                           scene->contact.grip_torque, yields[2]);
    double *axis = limit[2].axis;
    limit[0] = (pliant_touch_limit){.load = maximum, .compliance = least[0]};
    limit[1] = (pliant_touch_limit){.load = lever, .compliance = least[1]};
    limit[2] = (pliant_touch_limit){.load = scene->contact.grip_torque, .compliance = least[2]};
    memset(out, 0, 2 * sizeof *out);
    for (int k = 0; k < 6; k++) out[0].compliance[7 * k] = k < 3 ? shift : turn;
    pliant_tool_joint(tool, goal, out[1].centre, axis);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) out[1].compliance[6 * (3 + r) + 3 + c] = jaw * axis[r] * axis[c];
    *ahead = pliant_proxy_pose_under_load(tool, goal, out, before);
    const double motion = pliant_tool_max_motion(tool, begin, ahead);
    if (motion > longest) *ahead = pliant_tool_pose_between(begin, ahead, longest / motion);
    memcpy(out[0].centre, ahead->tip, sizeof out[0].centre);
    for (int d = 0; d < 3; d++) out[0].free[d] = goal->tip[d] - ahead->tip[d];
    turn_between(ahead->rotation, goal->rotation, out[0].free + 3);
    pliant_tool_joint(tool, ahead, out[1].centre, axis);
    for (int d = 0; d < 3; d++) out[1].free[3 + d] = axis[d] * (goal->jaw - ahead->jaw);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) out[1].compliance[6 * (3 + r) + 3 + c] = jaw * axis[r] * axis[c];
}

/* Return the fraction of the change from a to b at which the limit is reached, or 1. Beyond the limit, b may not be
 * larger than a. */
static double fraction_at_limit(double a, double b, double limit)
{
    return b > limit && b > a ? fmax(limit - a, 0) / (b - a) : 1;
}

double pliant_proxy_fraction_to_limit(const pliant_model *model, pliant_tool *tool, const pliant_proxy_load *before,
                                      const pliant_proxy_load *after)
{
    const double over = model->contact.force_overshoot, nearly = model->contact.soft_begin + model->contact.soft_width;
    const double force = pliant_length3(after->wrench), maximum = model->scene.contact.max_force,
                 torque = fabs(after->jaw), grip = model->scene.contact.grip_torque;
    tool->proxy.coupling_load[0] = force;
    tool->proxy.coupling_load[1] = pliant_length3(after->wrench + 3);
    tool->proxy.coupling_load[2] = torque;
    tool->proxy.saturated = force > nearly * maximum || torque > nearly * grip;
    return fmin(fraction_at_limit(pliant_length3(before->wrench), force, over * maximum),
                fraction_at_limit(fabs(before->jaw), torque, over * grip));
}

/* ---- compliance of pieces under a tool */

/* Return whether the gap of a point is closed. */
static bool overlaps(const pliant_data *data, const pliant_contact_point *point)
{
    double gap = 0;
    for (int d = 0; d < 3; d++) {
        double x = 0;
        for (int32_t k = 0; k < point->count; k++)
            x += point->weight[k] * data->positions[3 * (size_t)point->node[k] + (size_t)d];
        gap += point->normal[d] * (x - point->place[d]);
    }
    return gap <= 0;
}

void pliant_proxy_compliance(const pliant_data *data, int t, bool pressing, const double joint[3],
                             const double axis[3], double out[2])
{
    const pliant_contact_bodies *pieces = data->rigid_pieces ? pliant_rigid_pieces_bodies(data->rigid_pieces) : NULL;
    double sum = 0, levers = 0;
    int32_t count = 0;
    out[0] = out[1] = 0;
    for (int32_t n = 0; pieces && n < data->contacts.count; n++) {
        const pliant_contact_point *point = data->contacts.point + n;
        if (point->kind != PLIANT_OBSTACLE_TOOL || point->tool != t || pieces->of_node[point->node[0]] < 0 ||
            !(pressing ? point->was_pressed : overlaps(data, point)))
            continue;
        double along = 0, square = 0;
        for (int d = 0; d < 3; d++) {
            square += (point->place[d] - joint[d]) * (point->place[d] - joint[d]);
            along += (point->place[d] - joint[d]) * axis[d];
        }
        const pliant_contact_body *piece = pieces->piece + pieces->of_node[point->node[0]];
        if (!(piece->young * piece->size > 0)) continue;
        count++;
        sum += 1 / (piece->young * piece->size);
        if (point->jaw) levers += (square - along * along) / 4;
    }
    if (count == 0) return;
    out[0] = sum / count;
    if (levers > 0) out[1] = sum / levers;
}
