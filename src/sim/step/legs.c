#include "sim/step/legs.h"

#include "backend/backend.h"
#include "base/fail.h"
#include "contact/advance/advance_rules.h"
#include "fem/dynamics/tled.h"
#include "fem/patch/patch.h"
#include "fem/quasistatic/solver.h"
#include "base/memory.h"
#include "base/vector3.h"
#include "sim/step/contact.h"
#include "sim/step/stage_timer.h"
#include "tool/tool.h"

#include <assert.h>
#include <math.h>
#include <string.h>

enum {
    MAX_LEGS = 32,          /* legs of a step that solver/iterations does not end first */
    MAX_BLOCKED = 4,        /* legs in a row without progress */
    MAX_SHORTENED = 2,      /* shortened legs in a row before the proxies are held */
    MAX_CHECKED_TRIALS = 4, /* fractions of a leg of rigid pieces */
    MAX_HOLD_TRIALS = 3     /* fractions of the motion of tools that block a dynamic leg */
};
/* fraction of a leg that is free: the rest is shorter than the distance that all pairs keep */
static const double nearly_all = 1 - 1e-6;

/* ---- start of the step: target poses, and proxies of tools that are new or have jumped */

/* Return whether the target moves too fast, or is too far from the proxy, to be followed. The missing depth does not
 * count. */
static bool has_jumped(const pliant_model *model, const pliant_tool *tool)
{
    const double missing = tool->proxy.missing.compliance * tool->proxy.coupling_load[0];
    return pliant_distance3(tool->tip, tool->proxy.target) > model->contact.max_tool_speed * model->scene.solver.step ||
           pliant_distance3(tool->tip, tool->proxy.tip) - missing > model->scene.contact.max_proxy_error;
}

/* Set the proxy to a pose at which its coupling has no load. */
static void set_free_proxy(pliant_tool *tool, const pliant_tool_pose *pose)
{
    pliant_tool_set_proxy(tool, pose);
    tool->proxy.unloaded = *pose;
    tool->proxy.load = (pliant_proxy_load){.jaw = 0};
}

/* Set the proxy of a new tool to its target. If it is then inside tissue, it is released: it has no contact until
 * it is outside again. If the target has jumped, set the proxy to it only when no tissue is there; otherwise the
 * proxy stays. */
static pliant_status place_proxy(const pliant_model *model, pliant_data *data, int t)
{
    pliant_tool *tool = data->tools + t;
    const pliant_tool_pose measured = pliant_tool_measured(tool);
    const bool comes = !tool->present || !tool->proxy.known;
    bool is_free = true, is_inside = false;
    data->legs->tool[t].is_placed = tool->proxy.has_jumped = false;
    if (!comes && !tool->proxy.released && !has_jumped(model, tool)) return PLIANT_OK;
    if (tool->present && tool->shape.num_parts > 0) {
        pliant_status status = pliant_contact_is_free(model, data, t, &measured, &is_free, &is_inside);
        if (status != PLIANT_OK) return status;
    }
    if (comes || tool->proxy.released)
        tool->proxy.released = is_inside || (tool->proxy.released && !is_free);
    else if (!is_free || is_inside)
        return PLIANT_OK;
    else
        tool->proxy.has_jumped = true;
    data->legs->tool[t].is_placed = true;
    set_free_proxy(tool, &measured);
    memset(tool->proxy.coupling_load, 0, sizeof tool->proxy.coupling_load);
    for (int32_t p = 0; p < data->contacts.count; p++) { /* forces at the pose that the proxy has left */
        pliant_contact_point *point = data->contacts.point + p;
        if (point->kind == PLIANT_OBSTACLE_TOOL && point->tool == t) {
            memset(point->force, 0, sizeof point->force);
            point->was_pressed = false;
        }
    }
    return PLIANT_OK;
}

/* Read the target poses, and place the proxies of new tools. */
static pliant_status begin_step(const pliant_model *model, pliant_data *data)
{
    data->legs->mean_points.count = 0;
    data->legs->use_plane_constraints = false;
    for (int t = 0; t < data->num_tools; t++) data->legs->tool[t].measured = pliant_tool_measured(data->tools + t);
    for (int t = 0; t < data->num_tools; t++) {
        pliant_leg_tool *leg = data->legs->tool + t;
        const pliant_grasp_constraint *grasp = data->solver ? pliant_legs_grasp(data, t) : NULL;
        pliant_status status = place_proxy(model, data, t);
        if (status != PLIANT_OK) return status;
        if (grasp) memcpy(leg->target, grasp->target, sizeof leg->target);
    }
    return PLIANT_OK;
}

/* The next step judges the motion of the target from here. */
static void set_followed(pliant_tool *tool)
{
    tool->proxy.known = tool->present;
    memcpy(tool->proxy.target, tool->tip, sizeof tool->proxy.target);
}

/* Restore the target poses. Tools without a shape have no coupling, so their proxy is at the target. */
static void end_step(pliant_data *data)
{
    pliant_statistics *statistics = &data->statistics;
    for (int t = 0; t < data->num_tools; t++) {
        pliant_tool *tool = data->tools + t;
        const pliant_tool_pose *measured = &data->legs->tool[t].measured;
        memcpy(tool->tip, measured->tip, sizeof tool->tip);
        memcpy(tool->rotation, measured->rotation, sizeof tool->rotation);
        tool->jaw = measured->jaw;
        if (tool->shape.num_parts == 0) set_free_proxy(tool, measured);
        set_followed(tool);
        if (tool->present)
            statistics->proxy_error = fmax(statistics->proxy_error, pliant_distance3(tool->tip, tool->proxy.tip));
    }
    data->fraction = 1;
}

/* ---- a leg */

/* After the first leg, accept no further background results, except in mode PLANNED. A replay prescribes the results
 * of a step as one set, so they must all be taken in its first leg. */
static void freeze_background(pliant_data *data)
{
    if (data->background.kind != PLIANT_BACKGROUND_PLANNED)
        data->background = (pliant_background){.kind = PLIANT_BACKGROUND_PRESCRIBED, .taken = data->background.taken};
}

/* Return the fraction of the leg at which a loaded proxy has made its maximum motion. */
static double fraction_of_yield(const pliant_data *data, int t, const pliant_proxy_load *load)
{
    const pliant_leg_tool *leg = data->legs->tool + t;
    const double maximum = pliant_legs_max_motion(data, load),
                 motion = pliant_tool_max_motion(data->tools + t, &leg->begin, &leg->goal);
    return motion > maximum ? maximum / motion : 1;
}

/* Move a load towards another one by this fraction. */
static void mix_load(const pliant_proxy_load *to, double fraction, pliant_proxy_load *load)
{
    for (int k = 0; k < 6; k++) load->wrench[k] += fraction * (to->wrench[k] - load->wrench[k]);
    load->jaw += fraction * (to->jaw - load->jaw);
}

/* Update the loads on all proxies. With TLED, return 1. Otherwise move the goals to where the couplings yield to the
 * new loads, and return the fraction of the leg at which the first coupling reaches its force limit. */
static double update_loads(const pliant_model *model, pliant_data *data)
{
    double fraction = 1;
    for (int t = 0; t < data->num_tools; t++) {
        pliant_tool *tool = data->tools + t;
        pliant_leg_tool *leg = data->legs->tool + t;
        if (data->legs->holds_proxies) leg->after = leg->before;
        if (!tool->present || tool->shape.num_parts == 0 || data->legs->holds_proxies) continue;
        pliant_proxy_find_load(data, t, &leg->ahead, &leg->after);
        if (data->tled) {
            mix_load(&leg->after, data->fraction, &leg->before);
            leg->after = leg->before;
        }
        const double limit = pliant_proxy_fraction_to_limit(model, tool, &leg->before, &leg->after);
        if (data->tled) continue;
        leg->goal = pliant_proxy_pose_under_load(tool, &leg->ahead, data->legs->proxy + 2 * t, &leg->after);
        fraction = fmin(fraction, fmin(limit, fraction_of_yield(data, t, &leg->after)));
    }
    return fraction;
}

static bool is_of_piece(const pliant_data *data, int32_t node)
{
    return data->rigid_pieces && pliant_rigid_pieces_detachment_position(data->rigid_pieces, node);
}

/* Return the largest distance of a node in this leg [m]. */
static double farthest_of(const pliant_data *data)
{
    double square = 0;
#pragma omp parallel for schedule(static) num_threads(data->discretization->system->num_threads) reduction(max : square)
    for (int32_t n = 0; n < data->body->fine.num_nodes; n++) {
        double moved[3];
        pliant_subtract3(data->positions + 3 * (size_t)n, data->legs->positions + 3 * (size_t)n, moved);
        const double own = pliant_dot3(moved, moved);
        if (own > square && !is_of_piece(data, n)) square = own;
    }
    return sqrt(square);
}

/* Return the fraction of the leg at which the farthest node has moved by twice the maximum distance of a tool. After
 * a blocked leg the solver makes a linear step. Its result can be inaccurate for large motions, so the motion is
 * scaled. */
static double bound_motion(const pliant_data *data)
{
    const double maximum = 2 * pliant_contact_leg_distance(data);
    bool any = false;
    for (int32_t p = 0; p < data->contacts.count && !any; p++)
        any = !is_of_piece(data, data->contacts.point[p].node[0]);
    const double farthest = any ? farthest_of(data) : 0;
    return farthest > maximum ? maximum / farthest : 1;
}

/* Find the largest fraction of a quasi-static leg that is free of penetration. */
static pliant_status find_free_fraction(const pliant_model *model, pliant_data *data, double made, double *fraction)
{
    double of_parts = 1;
    pliant_status status = pliant_contact_advance(model, data, made, false, &of_parts);
    if (status == PLIANT_OK) status = pliant_contact_advance_tissue(model, data, fraction);
    if (status == PLIANT_OK) *fraction = fmin(*fraction, fmin(of_parts, pliant_contact_advance_cuts(model, data)));
    return status;
}

/* Rigid pieces and nodes that turn with coarse elements move on arcs. At a fraction of the leg they are not on the
 * checked straight lines. Check the state that was reached. If it is not free, halve the fraction up to three times,
 * and then use 0. */
static pliant_status apply_checked_fraction(const pliant_model *model, pliant_data *data, double *fraction)
{
    pliant_status status = pliant_legs_apply_fraction(model, data, *fraction);
    const bool is_curved = data->rigid_pieces || pliant_legs_turn_nodes(data);
    for (int again = 0; again < MAX_CHECKED_TRIALS && is_curved && *fraction > 0 && status >= 0; again++) {
        double found = 1;
        status = find_free_fraction(model, data, *fraction, &found);
        if (pliant_legs_turn_nodes(data)) found = fmin(found, pliant_legs_find_volume_fraction(model, data));
        if (status < 0 || found >= nearly_all) break;
        const double less = again + 1 < MAX_CHECKED_TRIALS ? 0.5 : 0;
        *fraction *= less;
        status = pliant_legs_apply_fraction(model, data, less);
    }
    return status;
}

/* Return whether the method moves each node of the fine mesh by itself. With coarse methods and patches, nodes move
 * together. */
static bool moves_single_nodes(const pliant_data *data)
{
    return data->tled || (pliant_solves_fine(data->solver->system) && pliant_patch_count_tools(data) == 0);
}

/* Apply the volume bound: shorten the motion of the nodes of small elements. Shorten the motion of all nodes alike
 * where nodes move together, or if no motion of single nodes is found. Do the same after a blocked quasi-static leg,
 * because the linear model that made it holds for small motions only. */
static pliant_status keep_volumes(const pliant_model *model, pliant_data *data, double *fraction)
{
    bool found = false;
    data->legs->limited_by_elements = false;
    if (!pliant_contact_may_have_small_elements(model, data, true)) return PLIANT_OK;
    const bool bounds_nodes = moves_single_nodes(data) && !(data->solver && data->legs->blocked);
    const pliant_status status = bounds_nodes ? pliant_legs_bound_volumes(model, data, &found) : PLIANT_OK;
    if (found || status != PLIANT_OK) return status;
    *fraction = pliant_legs_find_volume_fraction(model, data);
    /* Arcs to the same end can keep volumes that straight lines do not keep. The state that is reached is checked. */
    if (*fraction < 1 && pliant_legs_turn_nodes(data)) *fraction = fmax(*fraction, 0.5);
    return PLIANT_OK;
}

/* Move tissue to the largest permitted fraction of a quasi-static leg. Then no surface is in a core. */
static pliant_status apply_quasi_static(const pliant_model *model, pliant_data *data, double *fraction)
{
    double volumes = 1, is_free = 1;
    *fraction = fmin(update_loads(model, data), data->solver && data->legs->blocked ? bound_motion(data) : 1);
    pliant_status status = keep_volumes(model, data, &volumes);
    if (status == PLIANT_OK) status = find_free_fraction(model, data, 1, &is_free);
    if (status < 0) return status;
    *fraction = fmin(*fraction, is_free);
    data->legs->limited_by_elements = data->legs->limited_by_elements || volumes < *fraction;
    *fraction = fmin(*fraction, volumes);
    const double farthest = *fraction < 1 ? farthest_of(data) : 0;
    if (*fraction < 1) status = apply_checked_fraction(model, data, fraction);
    pliant_legs_add_truncation_error(data, (1 - *fraction) * farthest);
    return status;
}

/* Explicit dynamics: a leg is mostly blocked by a tool that pushes tissue faster than the tissue can move away.
 * Shorten the motion of the tools of blocked islands, so that the tissue keeps its momentum. */
static pliant_status hold_tools(const pliant_model *model, pliant_data *data, double *fraction_of_parts)
{
    pliant_status status = PLIANT_OK;
    for (int again = 0; again < MAX_HOLD_TRIALS && *fraction_of_parts < 1 && status == PLIANT_OK; again++) {
        for (int t = 0; t < data->num_tools; t++) {
            pliant_leg_tool *leg = data->legs->tool + t;
            const double fraction = again + 1 < MAX_HOLD_TRIALS ? PLIANT_ADVANCE_SAFETY * leg->free_fraction : 0;
            if (leg->free_fraction < 1) leg->goal = pliant_tool_pose_between(&leg->begin, &leg->goal, fraction);
        }
        status = pliant_contact_advance(model, data, 1, true, fraction_of_parts);
    }
    return status;
}

/* Explicit dynamics: move each island of tissue and tools by its largest permitted fraction. Sub-steps have kept tissue
 * apart from tissue (zones); shortened nodes are placed on straight lines, which is checked again.
 * @param factor   out: factor for the fractions of all islands
 * @param smallest out: smallest fraction of an island, with this factor */
static pliant_status apply_dynamic(const pliant_model *model, pliant_data *data, double *factor, double *smallest)
{
    double of_parts = 1, volumes = 1;
    update_loads(model, data);
    *factor = 1;
    pliant_status status = keep_volumes(model, data, &volumes);
    if (status == PLIANT_OK) status = pliant_contact_advance(model, data, 1, true, &of_parts);
    if (status == PLIANT_OK) status = hold_tools(model, data, &of_parts);
    const bool is_blocked = of_parts < 1;
    if (status == PLIANT_OK && is_blocked) status = pliant_legs_apply_islands(model, data);
    if (status == PLIANT_OK && (is_blocked || data->legs->limited_by_elements || !data->tled->zones))
        status = pliant_contact_advance_tissue(model, data, factor);
    *factor = fmin(*factor, fmin(volumes, pliant_contact_advance_cuts(model, data)));
    *smallest = *factor * of_parts;
    return status == PLIANT_OK && *factor < 1 ? pliant_legs_apply_fraction(model, data, *factor) : status;
}

/* Move tissue and proxies to the largest permitted fraction of the leg. Then no surface is in a core. */
static pliant_status apply_leg(const pliant_model *model, pliant_data *data)
{
    double factor = 1, *smallest = &data->legs->completed;
    const pliant_status status = pliant_legs_are_dynamic(data) ? apply_dynamic(model, data, &factor, smallest)
                                                               : apply_quasi_static(model, data, &factor);
    if (!pliant_legs_are_dynamic(data)) *smallest = factor;
    for (int t = 0; t < data->num_tools && status >= 0; t++) {
        pliant_leg_tool *leg = data->legs->tool + t;
        const double fraction = factor * leg->free_fraction;
        const pliant_tool_pose end = pliant_tool_pose_between(&leg->begin, &leg->goal, fraction);
        pliant_tool *tool = data->tools + t;
        pliant_tool_set_proxy(tool, &end);
        tool->proxy.unloaded = pliant_tool_pose_between(&leg->from, &leg->unloaded, fraction);
        mix_load(&leg->before, 1 - fraction, &leg->after);
        tool->proxy.load = leg->after;
    }
    if (status >= 0) pliant_contact_follow_proxies(data);
    assert(status < 0 || pliant_contact_is_outside_cores(model, data));
    return status;
}

/* Save the state at the start of the leg, and find its contact points. */
static pliant_status find_points(const pliant_model *model, pliant_data *data)
{
    pliant_status status = pliant_legs_save(model, data);
    if (status == PLIANT_OK) status = pliant_contact_find_points(model, data);
    return status == PLIANT_OK ? pliant_contacts_copy(&data->contacts, &data->legs->points) : status;
}

/* ---- the step */

/* The part of the step that remains for further legs. */
typedef struct leg_budget {
    int32_t evaluations, /* limit for the step */
        spent /* at least 1 in each leg */, iterations;
    double left, completed; /* fraction of the step that remains; fraction that the last leg made */
    int blocked;            /* number of successive legs that made almost no progress */
    int shortened;          /* number of successive legs that fell short; the last leg of the previous step counts */
    bool held;              /* the last leg of this step held the proxies */
    bool linear;            /* the last leg of this step was a linear step */
    bool first;
} leg_budget;

/* Return the number of evaluations for this leg, in addition to the first one. After a blocked leg return 0: one
 * linear step adds the plane constraints. If most of it was made, the leg after it checks the result. Jammed tissue
 * gets away by many linear steps. */
static int32_t choose_evaluations(const leg_budget *budget, double fraction)
{
    return budget->linear ? 0 : (int32_t)fmax(1, round(fraction * (budget->evaluations - budget->spent)));
}

/* Make one leg: choose its length, find contact points, solve, and apply the free fraction. Then decide whether the
 * step is done. */
static pliant_status run_leg(const pliant_model *model, pliant_data *data, leg_budget *budget,
                             pliant_solve_stages *solve, pliant_status *warning, bool *done)
{
    pliant_statistics *statistics = &data->statistics;
    const int32_t limit = data->solver ? data->solver->rules.max_evaluations : 0;
    data->legs->first = budget->first;
    pliant_status status = pliant_run_stage(model, data, PLIANT_STEP_contact, pliant_legs_begin_leg);
    if (status != PLIANT_OK) return status;
    const double fraction =
        pliant_legs_are_dynamic(data) ? pliant_legs_choose_part(model, data) : pliant_legs_choose_fraction(model, data);
    /* After a leg without progress, or two shortened legs of pressed tissue, the tissue alone moves. The parts are at
     * rest then, so planes keep it out of them exactly. Where nodes move together, tissue seldom gets away alone. Every
     * second leg is free, so that proxies can always retreat. */
    const bool holds = !pliant_legs_are_dynamic(data) && !budget->held &&
                       (budget->completed < PLIANT_ADVANCE_MIN_PROGRESS ||
                        (budget->shortened >= MAX_SHORTENED && moves_single_nodes(data) && pliant_legs_press(data)));
    data->legs->holds_proxies = holds;
    data->fraction = fraction * budget->left;
    if (!budget->first) freeze_background(data);
    pliant_legs_set_goals(model, data, fraction);
    data->legs->blocked = budget->completed < 1;
    data->legs->use_plane_constraints = data->legs->use_plane_constraints || data->legs->blocked;
    pliant_patch_suspend(data, data->legs->blocked);
    status = pliant_run_stage(model, data, PLIANT_STEP_contact, find_points);
    if (status != PLIANT_OK) return status;
    budget->linear = data->legs->blocked && !(budget->linear && budget->completed > 0.5);
    if (data->solver) data->solver->rules.max_evaluations = choose_evaluations(budget, fraction);
    status = solve(model, data, warning);
    if (data->solver) data->solver->rules.max_evaluations = limit;
    if (status >= 0) status = pliant_run_stage(model, data, PLIANT_STEP_contact, apply_leg);
    if (status < 0) return status;
    const double completed = data->legs->completed;
    budget->first = false;
    budget->spent += (int32_t)fmax(statistics->iterations, 1);
    budget->iterations += statistics->iterations;
    budget->completed = completed;
    budget->blocked = completed < PLIANT_ADVANCE_MIN_PROGRESS ? budget->blocked + 1 : 0;
    budget->shortened = completed < 1 && !holds ? budget->shortened + 1 : 0;
    budget->held = holds;
    statistics->legs++;
    statistics->advanced = completed;
    const bool is_limited = data->legs->limited_by_elements;
    /* A step does not end with a linear step, whose result is not checked. A leg that the volume bound shortened is
     * followed by a leg whose contact points hold the small elements open. With tetrahedra the next step suffices: jaws
     * on a liver need 2.3 times the evaluations with one more leg. */
    *done = !holds && fraction == 1 && completed == 1 && !budget->linear &&
            !(is_limited && model->scene.element.kind == PLIANT_HEXAHEDRA);
    if (pliant_legs_are_dynamic(data)) { /* time passes also in a blocked leg */
        budget->left = 1 - (double)data->tled->substeps_done / data->tled->substeps;
        *done = data->tled->substeps_done == 0;
        return pliant_legs_add_forces(data, data->fraction);
    }
    if (!holds) budget->left *= 1 - fraction * completed;
    /* A leg needs two evaluations if it goes back to the state before it. */
    if (!*done && budget->spent > budget->evaluations - 2)
        statistics->ended = PLIANT_STEP_END_BUDGET;
    else if (!*done && !pliant_step_clock_has_time(&data->clock))
        statistics->ended = PLIANT_STEP_END_TIME;
    else if (budget->blocked == MAX_BLOCKED || statistics->legs == MAX_LEGS || (*done && is_limited))
        statistics->ended = is_limited ? PLIANT_STEP_END_ELEMENTS : PLIANT_STEP_END_BLOCKED;
    *done = *done || statistics->ended != PLIANT_STEP_END_NONE;
    return PLIANT_OK;
}

pliant_status pliant_legs_run(const pliant_model *model, pliant_data *data, double completed,
                              pliant_solve_stages *solve, pliant_status *warning)
{
    leg_budget budget = {.evaluations = data->solver ? data->solver->rules.max_evaluations : 0,
                         .left = 1,
                         .completed = completed,
                         .shortened = completed < 1,
                         .first = true};
    const pliant_background background = data->background;
    bool done = false;
    if (!data->legs && !(data->legs = pliant_calloc(1, sizeof *data->legs))) return pliant_fail_memory("contacts");
    pliant_status status = begin_step(model, data);
    if (data->tled) data->tled->substeps_done = data->tled->part = 0;
    while (status >= 0 && !done) status = run_leg(model, data, &budget, solve, warning, &done);
    data->background = (pliant_background){
        .kind = background.kind, .prescribed = background.prescribed, .taken = data->background.taken};
    if (status >= 0) {
        pliant_legs_publish_forces(data);
        pliant_contact_warn_of_cells(data);
    }
    data->statistics.iterations = budget.iterations;
    bool saturated = false;
    for (int t = 0; t < data->num_tools; t++)
        saturated = saturated || (data->tools[t].present && data->tools[t].proxy.saturated);
    if (saturated && data->statistics.ended == PLIANT_STEP_END_NONE)
        data->statistics.ended = PLIANT_STEP_END_FORCE_LIMIT;
    end_step(data);
    return status;
}

pliant_status pliant_legs_find(const pliant_model *model, pliant_data *data, bool holds_proxies)
{
    if (!data->legs && !(data->legs = pliant_calloc(1, sizeof *data->legs))) return pliant_fail_memory("contacts");
    pliant_status status = begin_step(model, data);
    data->legs->first = true;
    data->legs->holds_proxies = data->legs->use_plane_constraints = holds_proxies;
    if (status == PLIANT_OK) status = pliant_legs_begin_leg(model, data);
    if (status != PLIANT_OK) return status;
    pliant_legs_set_goals(model, data, 1);
    return pliant_contact_find_points(model, data);
}

void pliant_legs_set_goals_reached(pliant_data *data)
{
    for (int t = 0; t < data->num_tools; t++) set_free_proxy(data->tools + t, &data->legs->tool[t].goal);
    end_step(data);
}

void pliant_legs_skip(const pliant_model *model, pliant_data *data)
{
    pliant_contact_discard(data);
    data->bodies = NULL;
    if (data->tled) {
        data->tled->substeps_done = data->tled->part = 0;
        pliant_legs_choose_substep(model, data, 0);
    }
    data->statistics.legs = 1;
    for (int t = 0; t < data->num_tools; t++) {
        const pliant_tool_pose measured = pliant_tool_measured(data->tools + t);
        set_free_proxy(data->tools + t, &measured);
        data->tools[t].proxy.has_jumped = false;
        set_followed(data->tools + t);
        data->tools[t].proxy.missing = (pliant_missing_depth){.fraction = 1};
    }
}
