/* Where the proxies of tools go in a leg. */
#include "sim/step/legs.h"

#include "backend/backend.h"
#include "contact/shapes/tool_shape.h"
#include "fem/dynamics/tled.h"
#include "base/vector3.h"
#include "sim/step/contact.h"
#include "tool/tool.h"

#include <math.h>
#include <string.h>

/* Explicit dynamics: return where a proxy goes, which is behind the target by the missing depth. The force of the
 * previous leg sets this depth. Shorten the motion as if the tissue's force changed with it; otherwise it overshoots
 * where the tissue is stiffer than the missing compliance. */
static pliant_tool_pose pose_behind_target(const pliant_tool *tool, const pliant_leg_tool *leg)
{
    const pliant_missing_depth *missing = &leg->missing;
    const double shift = leg->yields[0] > 0 ? missing->compliance / leg->yields[0] : 0,
                 turn = leg->yields[2] > 0 ? missing->jaw_compliance / leg->yields[2] : 0;
    pliant_tool_pose out = leg->measured;
    for (int d = 0; d < 3; d++) {
        out.tip[d] += missing->compliance * leg->before.wrench[d];
        out.tip[d] = leg->begin.tip[d] + (out.tip[d] - leg->begin.tip[d]) / (1 + shift);
    }
    if (!pliant_tool_shape_has_jaws(&tool->shape)) return out;
    out.jaw += missing->jaw_compliance * leg->before.jaw;
    out.jaw = leg->begin.jaw + (out.jaw - leg->begin.jaw) / (1 + turn);
    return out;
}

/* Change the missing compliance only by a fraction of the change from the previous leg's. */
static void smooth_missing_compliance(double follow, double before, pliant_missing_depth *missing)
{
    if (!(before > 0) || !(missing->compliance > 0)) return;
    const double ratio = follow + (1 - follow) * before / missing->compliance;
    missing->compliance *= ratio;
    missing->jaw_compliance *= ratio;
}

/* Linearize the coupling of a tool for a goal, with the compliances that this leg adds. longest: maximum predicted
 * motion [m] */
static void linearize(const pliant_model *model, const pliant_data *data, int t, const pliant_tool_pose *goal,
                      double longest, pliant_tool_pose *ahead, pliant_contact_body couple[2],
                      pliant_touch_limit limit[3])
{
    const pliant_leg_tool *leg = data->legs->tool + t;
    double added[2] = {leg->piece_compliance[0], leg->piece_compliance[1]};
    if (!data->tled) {
        added[0] += leg->missing.compliance;
        added[1] += leg->missing.jaw_compliance;
    }
    pliant_proxy_linearize(model, data->tools + t, &leg->begin, goal, &leg->before, added, leg->yields, longest, ahead,
                           couple, limit);
}

/* Return the maximum motion of a proxy in a leg [m], which limits proxies with a load: twice the maximum distance. The
 * load of an inaccurate solution can move it much farther. */
double pliant_legs_max_motion(const pliant_data *data, const pliant_proxy_load *load)
{
    const bool is_loaded = pliant_length3(load->wrench) > 0 || load->jaw != 0;
    return is_loaded && !data->tled ? 2 * pliant_contact_leg_distance(data) : INFINITY;
}

/* Save the proxies' poses and loads at the start of a leg. In explicit dynamics, the load is the mean over about one
 * step, because contacts of tissue that vibrates open and close: update_loads filters it within a step. */
pliant_status pliant_legs_begin_leg(const pliant_model *model, pliant_data *data)
{
    pliant_status status = PLIANT_OK;
    for (int t = 0; t < data->num_tools && status == PLIANT_OK; t++) {
        pliant_leg_tool *leg = data->legs->tool + t;
        double joint[3], axis[3];
        leg->begin = pliant_tool_proxy(data->tools + t);
        if (!data->tled)
            leg->before = data->tools[t].proxy.load;
        else if (data->legs->first)
            pliant_proxy_find_load(data, t, &leg->begin, &leg->before);
        pliant_tool_joint(data->tools + t, &leg->begin, joint, axis);
        pliant_proxy_compliance(data, t, true, joint, axis, leg->piece_compliance);
        status =
            pliant_missing_compliance(data, t, &leg->begin, &leg->measured, &data->legs->node_loads, &leg->missing);
        smooth_missing_compliance(model->contact.missing_follow, data->tools[t].proxy.missing.compliance,
                                  &leg->missing);
        data->tools[t].proxy.missing = leg->missing;
        if (data->tled)
            pliant_proxy_estimate_tissue_compliance(data, t, &leg->begin, &leg->before,
                                                    pliant_contact_leg_distance(data), leg->yields);
        leg->behind = data->tled ? pose_behind_target(data->tools + t, leg) : leg->measured;
        leg->from = data->tled ? leg->begin : data->tools[t].proxy.unloaded;
    }
    return status;
}

/* Return the fraction of the tool's remaining motion that keeps its distance in this leg below the maximum.
 * @param expected use the distance that the coupling is predicted to allow, instead of the distance to the target */
static double fraction_of(const pliant_model *model, pliant_data *data, int t, bool expected)
{
    const pliant_tool *tool = data->tools + t;
    const pliant_leg_tool *leg = data->legs->tool + t;
    const double maximum = pliant_contact_leg_distance(data);
    if (!tool->present || tool->shape.num_parts == 0) return 1;
    /* A proxy that its load keeps behind its target stays there. */
    double distance = fmin(pliant_tool_max_motion(tool, &leg->from, &leg->measured),
                           pliant_tool_max_motion(tool, &leg->begin, &leg->measured));
    if (distance > maximum && expected) {
        pliant_contact_body couple[2];
        pliant_touch_limit limit[3];
        pliant_tool_pose ahead;
        linearize(model, data, t, &leg->measured, INFINITY, &ahead, couple, limit);
        distance = pliant_tool_max_motion(tool, &leg->begin, &ahead);
    }
    return distance > maximum && pliant_contact_is_near(data, tool, &leg->begin, &leg->measured) ? maximum / distance
                                                                                                 : 1;
}

/* Return the fraction of the remaining motion for this leg: the smallest of all tools. */
double pliant_legs_choose_fraction(const pliant_model *model, pliant_data *data)
{
    double fraction = 1;
    for (int t = 0; t < data->num_tools; t++) fraction = fmin(fraction, fraction_of(model, data, t, true));
    return fraction;
}

/* Return whether a tool has pressed tissue in the last leg. */
bool pliant_legs_press(const pliant_data *data)
{
    for (int32_t p = 0; p < data->contacts.count; p++)
        if (data->contacts.point[p].kind == PLIANT_OBSTACLE_TOOL && data->contacts.point[p].was_pressed) return true;
    return false;
}

/* Explicit dynamics: choose the sub-step for the motion of tools and tissue in one sub-step [m]. While a tool presses,
 * the sub-step stays, because a change of the sub-step changes the energy of strained tissue. */
void pliant_legs_choose_substep(const pliant_model *model, pliant_data *data, double motion)
{
    if (pliant_legs_press(data)) return;
    if (pliant_tled_choose_substep(data->tled, motion))
        (void)pliant_backend_restart(model, data); /* new increments; if this fails, the CPU continues */
}

/* Explicit dynamics: choose the number of sub-steps that may use one set of contact points. Return their fraction
 * of the remaining ones. */
double pliant_legs_choose_part(const pliant_model *model, pliant_data *data)
{
    pliant_tled *tled = data->tled;
    double motion = 0;
    int32_t left = tled->substeps - tled->substeps_done;
    const double motion_ratio = pliant_contact_max_motion_ratio(model, data, tled->d, left, &motion),
                 depths = model->contact.leg_distance;
    pliant_legs_choose_substep(model, data, motion / left);
    left = tled->substeps - tled->substeps_done;
    tled->part = motion_ratio > depths ? (int32_t)fmax(floor(left * depths / motion_ratio), 1) : left;
    return (double)tled->part / left;
}

/* Explicit dynamics: limit the speed at which a delayed proxy catches up to the maximum tool speed. Return a
 * fraction. */
static double limit_speed(const pliant_model *model, const pliant_data *data, const pliant_tool *tool,
                          const pliant_leg_tool *leg, double fraction)
{
    const double maximum = model->contact.max_tool_speed * model->scene.solver.step * data->fraction;
    const double distance =
        tool->shape.num_parts > 0 ? fraction * pliant_tool_max_motion(tool, &leg->begin, &leg->behind) : 0;
    return distance > maximum ? maximum / distance : 1;
}

/* Hold a proxy in this leg: it stays at its pose with its load, so its coupling has no compliance and no limit. */
static void hold_proxy(pliant_data *data, int t)
{
    pliant_leg_tool *leg = data->legs->tool + t;
    leg->ahead = leg->goal = leg->begin;
    leg->unloaded = leg->from;
    memset(data->legs->proxy + 2 * t, 0, 2 * sizeof *data->legs->proxy);
    for (int k = 0; k < 3; k++) data->legs->limit[3 * t + k] = (pliant_touch_limit){.load = INFINITY};
}

/* Set the goal of a proxy for a fraction of its remaining motion. */
static void set_goal(const pliant_model *model, pliant_data *data, int t, double fraction)
{
    pliant_leg_tool *leg = data->legs->tool + t;
    const double own = pliant_legs_are_dynamic(data)
                           ? fraction * limit_speed(model, data, data->tools + t, leg, fraction)
                           : fmin(fraction, fraction_of(model, data, t, false));
    leg->goal = leg->unloaded = pliant_tool_pose_between(&leg->from, &leg->behind, own);
    for (int k = 0; k < 3; k++) leg->yields[k] *= data->fraction; /* as far in a step, however many legs it has */
    linearize(model, data, t, &leg->goal, pliant_legs_max_motion(data, &leg->before), &leg->ahead,
              data->legs->proxy + 2 * t, data->legs->limit + 3 * t);
    if (data->tled) leg->goal = leg->ahead;
}

/* Set the goals of all proxies for this leg, or hold the proxies. Move the tools to the predicted poses, and the grasp
 * targets along with the goals. */
void pliant_legs_set_goals(const pliant_model *model, pliant_data *data, double fraction)
{
    for (int t = 0; t < data->num_tools; t++) {
        pliant_tool *tool = data->tools + t;
        const pliant_leg_tool *leg = data->legs->tool + t;
        pliant_grasp_constraint *grasp = data->solver ? pliant_legs_grasp(data, t) : NULL;
        if (data->legs->holds_proxies)
            hold_proxy(data, t);
        else
            set_goal(model, data, t, fraction);
        memcpy(tool->tip, leg->ahead.tip, sizeof tool->tip);
        memcpy(tool->rotation, leg->ahead.rotation, sizeof tool->rotation);
        tool->jaw = leg->ahead.jaw;
        const bool follows = grasp && pliant_grasp_is_spring(grasp) && !pliant_tool_drags_at_proxy(tool);
        for (int d = 0; d < 3 && follows; d++)
            grasp->target[d] = leg->target[d] + (leg->goal.tip[d] - leg->measured.tip[d]);
    }
}
