/* Stages of the corotational solver on the CPU, and the parts that other backends leave to the host. */
#include "backend/backend.h"
#include "base/fail.h"
#include "fem/rigid/rigid_pieces.h"
#include "fem/patch/patch.h"

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

static pliant_status interact(const pliant_model *model, pliant_data *data)
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
    .interact = interact,
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
    .solve = solve,
    .upsample = upsample,
    .warp = pliant_cpu_warp,
};
