/* The stages on the CPU. */
#include "backend/backend.h"
#include "fem/solver.h"
#include "interact/tool.h"

#include <stdio.h>

bool pliant_cpu_probe(char *text, size_t size)
{
    snprintf(text, size, "cpu");
    return true;
}

pliant_status pliant_cpu_nothing(const pliant_model *model, pliant_data *data)
{
    (void)model, (void)data;
    return PLIANT_OK;
}

static pliant_status solve(const pliant_model *model, pliant_data *data)
{
    (void)model;
    return pliant_solver_step(data->solver, &data->statistics);
}

static pliant_status upsample(const pliant_model *model, pliant_data *data)
{
    pliant_upsample_positions(model->system, data->solver->now.x, data->positions);
    for (int t = 0; t < data->num_tools; t++) pliant_tool_report(data, t);
    return PLIANT_OK;
}

pliant_status pliant_cpu_warp(const pliant_model *model, pliant_data *data)
{
    (void)model;
    return data->warp ? pliant_warp_update(data->warp, data->positions) : PLIANT_OK;
}

const pliant_backend pliant_cpu_backend = {
    .name = "cpu", .on_host = true, .probe = pliant_cpu_probe, .create = pliant_cpu_nothing, .restart = pliant_cpu_nothing,
    .solve = solve, .upsample = upsample, .warp = pliant_cpu_warp,
};
