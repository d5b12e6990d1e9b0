/* Stages of the quasi-static solver on the CPU, and the parts that other backends leave to the host: grasp constraints,
 * their targets and their forces ([H] 3.2). */
#include "backend/backend.h"
#include "fem/patch/patch.h"
#include "model_data/coincident_grasps.h"
#include "tool/tool.h"

#include <stdio.h>
#include <string.h>

bool pliant_cpu_probe(char *text, size_t size)
{
    snprintf(text, size, "cpu");
    return true;
}

pliant_status pliant_cpu_skip_stage(const pliant_model *model, pliant_data *data)
{
    (void)model, (void)data;
    return PLIANT_OK;
}

pliant_status pliant_set_contact_points(pliant_data *data)
{
    pliant_contacts *points;
    pliant_status status = pliant_patch_select_coarse_points(data, &points);
    if (status != PLIANT_OK) return status;
    return pliant_solver_set_contacts(data->solver, points, data->bodies, data->positions);
}

/* ---- Rigid tools at one point (model_data/coincident_grasps.h). */

static bool hold_same_point(const pliant_data *data, int a, int b)
{
    return pliant_holds_coincide(&data->body->fine, data->tools + a, data->tools + b) &&
           pliant_patch_solver(data, a) == pliant_patch_solver(data, b);
}

int pliant_grasp_leader(const pliant_data *data, int index)
{
    for (int t = 0; t < index; t++)
        if (hold_same_point(data, t, index) && pliant_grasp_leader(data, t) == t) return t;
    return index;
}

int pliant_grasp_members(const pliant_data *data, int leader, int member[PLIANT_MAX_TOOLS])
{
    int count = 0;
    for (int t = leader; t < data->num_tools; t++)
        if (pliant_grasp_leader(data, t) == leader) member[count++] = t;
    return count;
}

/* Set the leader's target to the mean of all members' targets, each relative to its own held point. */
static void share_target(const pliant_data *data, int leader, double target[3])
{
    int member[PLIANT_MAX_TOOLS];
    const int count = pliant_grasp_members(data, leader, member);
    const double *held = data->tools[leader].held_point,
                 own[3] = {target[0] - held[0], target[1] - held[1], target[2] - held[2]};
    for (int m = 1; m < count; m++) {
        const pliant_tool *tool = data->tools + member[m];
        for (int d = 0; d < 3; d++) target[d] += (pliant_tool_target(tool, d) - tool->held_point[d] - own[d]) / count;
    }
}

/* ---- Targets. */

/* Set the target of a spring k and a parallel damper b over a step h. The law k (p - y) + b ((p - p0) - (y - y0)) / h =
 * l is a spring of stiffness k + b / h towards (k p + b (p - p0 + y0) / h) / (k + b / h). The weight of the tool's mass
 * shifts the target. */
static void set_spring_target(const pliant_tool *tool, double step, const double gravity[3],
                              pliant_grasp_constraint *grasp)
{
    double damper = pliant_tool_drive(tool) == PLIANT_DRIVE_SPRING ? pliant_tool_damping(tool) / step : 0;
    double stiffness = pliant_tool_stiffness(tool), whole = stiffness + damper;
    for (int d = 0; d < 3; d++) {
        double p = pliant_tool_target(tool, d);
        grasp->target[d] = (stiffness * p + damper * (p - tool->last_target[d] + tool->held_point[d])) / whole;
        if (pliant_tool_drive(tool) == PLIANT_DRIVE_SPRING)
            grasp->target[d] += pliant_tool_mass(tool) * gravity[d] / whole;
    }
    grasp->compliance = pliant_tool_drive(tool) == PLIANT_DRIVE_RIGID ? 0 : 1 / whole;
}

pliant_status pliant_set_grasp_constraint(const pliant_model *model, pliant_data *data, int index)
{
    pliant_tool *tool = data->tools + index;
    pliant_solver *solver = pliant_patch_solver(data, index);
    pliant_grasp_constraint *grasp = solver->grasps + index;
    const int leader = pliant_grasp_leader(data, index);
    if (!tool->holding || leader != index) {
        if (grasp->active) pliant_solver_remove_grasp(solver, index);
        for (int d = 0; d < 3; d++) tool->last_target[d] = pliant_tool_target(tool, d);
        tool->attached = tool->holding;
        return PLIANT_OK;
    }
    /* Weights through homogenized shape functions rotate with the elements, so they are recomputed in every step. */
    bool turning = solver == data->solver && pliant_upsample_turns(solver->system);
    if (!tool->attached && grasp->active) pliant_solver_remove_grasp(solver, index); /* a new hold */
    if (!tool->attached || !grasp->active || turning) {
        pliant_status status = pliant_patch_hold(data, index);
        if (status != PLIANT_OK) return status;
        /* 0, unless the grasp was restored */
        if (!tool->attached) memcpy(grasp->force, tool->force, sizeof grasp->force);
        tool->attached = true;
    }
    bool by_force = pliant_tool_drive(tool) == PLIANT_DRIVE_FORCE;
    if (grasp->by_force != by_force) pliant_solver_drop_history(solver);
    grasp->by_force = by_force;
    for (int d = 0; by_force && d < 3; d++) grasp->force[d] = tool->driving_force[d] + tool->mass * data->gravity[d];
    if (!by_force) set_spring_target(tool, model->scene.solver.step, data->gravity, grasp);
    if (pliant_tool_drive(tool) == PLIANT_DRIVE_RIGID) share_target(data, index, grasp->target);
    for (int d = 0; d < 3; d++) tool->last_target[d] = pliant_tool_target(tool, d);
    return PLIANT_OK;
}

void pliant_report_grasps(pliant_data *data)
{
    for (int t = 0; t < data->num_tools; t++) {
        int member[PLIANT_MAX_TOOLS];
        const int leader = pliant_grasp_leader(data, t), count = pliant_grasp_members(data, leader, member);
        double force[3];
        for (int d = 0; data->solver && d < 3; d++)
            force[d] = pliant_patch_solver(data, leader)->grasps[leader].force[d] / count;
        pliant_tool_report(data, t, data->solver ? force : NULL);
    }
}

/* ---- Stages. */

pliant_status pliant_corotational_interact(const pliant_model *model, pliant_data *data)
{
    pliant_status status = data->patch ? pliant_patch_begin(data) : PLIANT_OK;
    if (status != PLIANT_OK) return status;
    pliant_solver_set_gravity(data->solver, data->gravity);
    for (int t = 0; t < data->num_tools; t++) {
        bool begins = data->tools[t].holding && !data->tools[t].attached; /* starts from the present state */
        if (begins && data->backend->download) data->backend->download(model, data);
        if ((status = pliant_set_grasp_constraint(model, data, t)) != PLIANT_OK) return status;
    }
    return PLIANT_OK;
}

static pliant_status solve(const pliant_model *model, pliant_data *data)
{
    (void)model;
    data->solver->background = &data->background;
    pliant_status status = pliant_set_contact_points(data);
    if (status != PLIANT_OK) return status;
    return pliant_solver_step(data->solver, &data->statistics);
}

static pliant_status upsample(const pliant_model *model, pliant_data *data)
{
    (void)model;
    pliant_upsample_positions(data->solver->system, data->solver->now.x, data->positions);
    pliant_report_grasps(data);
    return PLIANT_OK;
}

pliant_status pliant_cpu_warp(const pliant_model *model, pliant_data *data)
{
    (void)model;
    return data->warp ? pliant_warp_update(data->warp, data->positions) : PLIANT_OK;
}

static pliant_status create(const pliant_model *model, pliant_data *data)
{
    const pliant_discretization *discretization = data->discretization;
    pliant_status status = pliant_solver_create(&model->scene, discretization->system, &data->solver);
    return status == PLIANT_OK && discretization->fine_system
               ? pliant_patch_create(&model->scene, discretization, &data->patch)
               : status;
}

bool pliant_positions_are_state(const pliant_data *data)
{
    return data->solver && !data->backend->state_is_on_host && !data->rigid_pieces &&
           data->solver->system->mesh == data->solver->system->fine;
}

static pliant_status carry_over_cut(const pliant_model *model, const pliant_data *data, const pliant_body_map *map,
                                    pliant_data *next)
{
    const pliant_discretization *discretization = next->discretization;
    const double *state = pliant_positions_are_state(data) ? next->positions : NULL;
    pliant_status status = pliant_solver_carry_over_cut(&model->scene, discretization->system, data->solver, map,
                                                        !data->backend->state_is_on_host, state, &next->solver);
    return status == PLIANT_OK && discretization->fine_system
               ? pliant_patch_create(&model->scene, discretization, &next->patch)
               : status;
}

static pliant_status reset(pliant_data *data)
{
    pliant_status status = pliant_solver_reset(data->solver);
    if (status == PLIANT_OK && data->patch) pliant_patch_reset(data->patch);
    return status;
}

static void set_positions(const pliant_model *model, pliant_data *data, const double *positions)
{
    (void)model;
    pliant_solver *solver = data->solver;
    const pliant_system *system = solver->system;
    for (int32_t f = 0; f < system->num_free; f++) {
        const int32_t node = system->node_of_free[f], fine = pliant_fine_of_solved(system, data->body, node);
        if (fine >= 0) memcpy(solver->now.x + 3 * node, positions + 3 * fine, 3 * sizeof *positions);
    }
    pliant_solver_reset_after_move(solver);
    pliant_upsample_positions(system, solver->now.x, data->positions);
    if (data->patch) pliant_patch_clear_displacement(data->patch);
}

static void limits(pliant_data *data, int iterations, double tolerance)
{
    data->solver->rules.max_evaluations = iterations;
    data->solver->rules.tolerance = tolerance;
    data->solver->previous.converged = false; /* it may not have converged with the new limits */
}

static void discard_results(pliant_data *data)
{
    pliant_solver_drop_history(data->solver);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) data->solver->grasps[t].response_number = 0;
}

const pliant_host_solver pliant_corotational = {
    .create = create,
    .carry_over_cut = carry_over_cut,
    .reset = reset,
    .set_positions = set_positions,
    .limits = limits,
    .discard_results = discard_results,
    .cpu = &pliant_cpu_backend,
    .cuda = PLIANT_ON_GPU(pliant_cuda_backend),
};

const pliant_backend pliant_cpu_backend = {
    .name = "cpu",
    .host_solver = &pliant_corotational,
    .state_is_on_host = true,
    .probe = pliant_cpu_probe,
    .create = pliant_cpu_skip_stage,
    .restart = pliant_cpu_skip_stage,
    .interact = pliant_corotational_interact,
    .solve = solve,
    .upsample = upsample,
    .warp = pliant_cpu_warp,
};
