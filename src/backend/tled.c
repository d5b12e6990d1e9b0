/* Stages of explicit dynamics on the CPU, and the parts that other backends leave to the host. */
#include "fem/dynamics/tled_pressure.h"

#include "backend/backend.h"
#include "backend/explicit_statistics.h"
#include "base/fail.h"

#include <string.h>

static pliant_status solve(const pliant_model *model, pliant_data *data)
{
    (void)model;
    data->tled->contacts = &data->contacts;
    return pliant_tled_step(data->tled, data->tools, data->num_tools, &data->statistics);
}

pliant_status pliant_tled_upsample(const pliant_model *model, pliant_data *data)
{
    (void)model;
    for (int32_t n = 0; n < 3 * data->body->fine.num_nodes; n++)
        data->positions[n] = data->body->fine.rest[n] + data->tled->u[n];
    pliant_report_grasps(data);
    return PLIANT_OK;
}

static pliant_status create(const pliant_model *model, pliant_data *data)
{
    return pliant_tled_create(&model->scene, data->discretization->tled, &data->tled);
}

static pliant_status carry_over_cut(const pliant_model *model, const pliant_data *data, const pliant_body_map *map,
                                    pliant_data *next)
{
    pliant_status status = create(model, next);
    if (status != PLIANT_OK) return status;
    pliant_tled_carry(next->tled, data->tled, map);
    status = pliant_tled_conserve(next->tled, data->tled, data->discretization->body, next->discretization->body);
    return status == PLIANT_OK ? pliant_tled_pressure_carry(next->tled, data->tled) : status;
}

static pliant_status reset(pliant_data *data)
{
    pliant_tled_reset(data->tled);
    return PLIANT_OK;
}

pliant_status pliant_explicit_interact(const pliant_model *model, pliant_data *data)
{
    (void)model;
    pliant_tled_interact(data->tled, data->gravity, data->tools, data->num_tools);
    return PLIANT_OK;
}

static void set_positions(const pliant_model *model, pliant_data *data, const double *positions)
{
    pliant_tled_set_positions(data->tled, positions);
    (void)model;
    memcpy(data->positions, positions, 3 * (size_t)data->body->fine.num_nodes * sizeof *positions);
}

static void limits(pliant_data *data, int iterations, double tolerance)
{
    pliant_tled_set_limits(data->tled, iterations, tolerance);
}

const pliant_host_solver pliant_explicit = {
    .create = create,
    .carry_over_cut = carry_over_cut,
    .reset = reset,
    .set_positions = set_positions,
    .limits = limits,
    .cpu = &pliant_tled_backend,
    .cuda = PLIANT_ON_GPU(pliant_cuda_tled_backend),
};

const pliant_backend pliant_tled_backend = {
    .name = "cpu",
    .host_solver = &pliant_explicit,
    .state_is_on_host = true,
    .probe = pliant_cpu_probe,
    .create = pliant_cpu_skip_stage,
    .restart = pliant_cpu_skip_stage,
    .interact = pliant_explicit_interact,
    .solve = solve,
    .upsample = pliant_tled_upsample,
    .warp = pliant_cpu_warp,
};

pliant_status pliant_data_get_dynamics(const pliant_model *model, const pliant_data *data, pliant_dynamics *out)
{
    (void)model;
    if (!data->tled)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "there is no explicit dynamics: solver/kind is not tled");
    const pliant_tled_system *system = data->tled->system;
    pliant_dynamics dynamics = {.edge_bound = system->edge_bound, .eigenvalue_bound = system->eigenvalue_bound,
                            .time_step = data->tled->time_step, .substeps = data->tled->substeps,
                            .tool_work = data->tled->tool_work};
    pliant_tled_energies(data->tled, data->body->fine_material, &dynamics.kinetic_energy, &dynamics.strain_energy,
                         &dynamics.kept_energy);
    if (system->quasi_static) {
        dynamics.kinetic_energy = 0;
        dynamics.kept_energy = dynamics.strain_energy;
    }
    *out = dynamics;
    return PLIANT_OK;
}
