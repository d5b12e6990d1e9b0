/* Stability cases for explicit dynamics: time step, energy conservation, and loads and bodies with inertia. */
#include "base/fail.h"
#include "backend/explicit_statistics.h"
#include "fem/dynamics/tled.h"
#include "model_data/data.h"
#include "base/memory.h"
#include "report/stability_cases.h"

#include <math.h>
#include <stdio.h>

static int all_soft(const int32_t voxel[3], const int32_t size[3])
{
    (void)voxel;
    (void)size;
    return 0;
}

/* Create a block of one material without damping for explicit dynamics. The bound of the time step is determined by the
 * stiffest element alone. Softer adjacent elements add mass and permit longer steps, so there is only one material. */
static pliant_status dynamic_block(block_body *body)
{
    static const int32_t size[3] = {12, 12, 12};
    static const double box[3] = {0.1, 0.1, 0.1};
    pliant_status status = block_create(size, box, all_soft, body);
    body->scene.solver.kind = PLIANT_TLED;
    body->scene.tled.damping = 0;
    return status;
}

/* Set the time step to `part` of the maximum stable one. A frame has a whole number of sub-steps, so its length is
 * adjusted. */
static pliant_status set_time_step(block_body *body, double part, int substeps)
{
    pliant_model *model = NULL;
    pliant_status status =
        pliant_model_build(&body->scene, &body->scan, NULL, &body->table, (pliant_progress){NULL, NULL}, &model);
    if (status < 0) return status;
    body->scene.tled.safety = part;
    body->scene.solver.step = substeps * part * fmin(model->tled->edge_bound, model->tled->eigenvalue_bound);
    pliant_model_free(model);
    return PLIANT_OK;
}

/* ---- time_step: with 0.99 of the bound it oscillates; with 1.5 the first frames are rejected and the previous state
 * is kept */

static pliant_status swing(stability_trial *trial, const void *argument)
{
    static const double aside[3] = {0, -2, 0};
    const bool stable = *(const double *)argument < 1;
    const int64_t maximum = stable ? 100 : 3;
    pliant_dynamics dynamics;
    pliant_status status = trial_check_status(trial, pliant_data_set_gravity(trial->data, aside));
    if (status >= 0) status = trial_check_status(trial, pliant_data_get_dynamics(trial->model, trial->data, &dynamics));
    while (status >= 0 && trial->steps < maximum) status = trial_step(trial);
    if (status == PLIANT_ERROR_CANCELLED) return status;
    snprintf(trial->figure, sizeof trial->figure,
             "bounds %.4g us (edge) and %.4g us (eigenvalue), step %.4g us; %s after %lld sub-steps",
             1e6 * dynamics.edge_bound, 1e6 * dynamics.eigenvalue_bound, 1e6 * dynamics.time_step,
             status < 0 ? "diverged" : "swings", (long long)trial->iterations);
    if (stable == (status >= 0) && trial->largest < trial->size) return status;
    trial->broken = true;
    if (!trial->message[0])
        snprintf(trial->message, sizeof trial->message,
                 stable ? "it grows without end" : "a step above the bound was not caught");
    return status;
}

pliant_status stability_time_step(stability_context *context)
{
    static const double parts[] = {0.99, 1.5};
    pliant_status status = PLIANT_OK;
    context->dynamic = true;
    for (size_t p = 0; status >= 0 && p < sizeof parts / sizeof *parts; p++) {
        block_body body;
        char text[32];
        snprintf(text, sizeof text, "%g of the bound", parts[p]);
        status = dynamic_block(&body);
        if (status >= 0) status = set_time_step(&body, parts[p], 40);
        if (status >= 0) status = stability_try(context, text, &body.input, swing, parts + p);
        block_free(&body);
    }
    context->dynamic = false;
    return status;
}

/* ---- energy: bent and released, undamped */

static pliant_status keep_energy(stability_trial *trial, const void *argument)
{
    const double max_drift = 1e-3;
    const pliant_mesh *fine = &trial->model->body->fine;
    pliant_dynamics dynamics;
    double first = 0, drift = 0, *positions = pliant_calloc((size_t)fine->num_nodes, 3 * sizeof *positions);
    (void)argument;
    if (!positions) return trial_check_status(trial, pliant_fail_memory("a bent state"));
    for (int32_t i = 0; i < 3 * fine->num_nodes; i++) positions[i] = fine->rest[i];
    for (int32_t n = 0; n < fine->num_nodes; n++)
        positions[3 * n + 1] += 0.05 * fine->rest[3 * n] * fine->rest[3 * n] / trial->size;
    pliant_status status = trial_check_status(trial, pliant_data_set_positions(trial->model, trial->data, positions));
    pliant_free(positions);
    while (status >= 0 && trial->iterations < trial->context->options->long_steps) {
        status = trial_step(trial);
        if (status >= 0) status = pliant_data_get_dynamics(trial->model, trial->data, &dynamics);
        if (status < 0) return status;
        if (first == 0) first = dynamics.kept_energy;
        drift = fmax(drift, fabs(dynamics.kept_energy - first) / first);
    }
    snprintf(trial->figure, sizeof trial->figure, "%.3g J, drift %.2g %% over %lld sub-steps", first, 100 * drift,
             (long long)trial->iterations);
    if (status >= 0 && !(drift < max_drift)) {
        trial->is_unsettled = true;
        snprintf(trial->message, sizeof trial->message, "its energy drifts by %.2g %%; the limit is %g %%", 100 * drift,
                 100 * max_drift);
    }
    return status;
}

pliant_status stability_energy(stability_context *context)
{
    block_body body;
    pliant_status status = dynamic_block(&body);
    context->dynamic = true;
    if (status >= 0) status = set_time_step(&body, 0.25, 20);
    if (status >= 0) status = stability_try(context, "bent and let go", &body.input, keep_energy, NULL);
    context->dynamic = false;
    block_free(&body);
    return status;
}

/* ---- loads and bodies with inertia: all return to rest */

/* Create a body with a hard core and the scene's bounds, damped so that the slowest oscillation decays within two
 * seconds. */
static void damp(block_body *body)
{
    body->scene.solver.kind = PLIANT_TLED;
    body->scene.tled.damping = 20;
}

/* Apply one treatment to a block with each of the arguments. */
static pliant_status try_block(stability_context *context, const char *const *names, size_t count, size_t size,
                               const void *arguments, stability_treatment treatment)
{
    block_body body;
    pliant_status status = block_create_default(&body);
    damp(&body);
    context->dynamic = true;
    for (size_t n = 0; status >= 0 && n < count; n++)
        status = stability_try(context, names[n], &body.input, treatment, (const char *)arguments + n * size);
    context->dynamic = false;
    block_free(&body);
    return status;
}

pliant_status stability_dynamic_teleport(stability_context *context)
{
    static const char *const names[] = {"rigid", "spring"};
    static const pliant_drive drives[] = {PLIANT_DRIVE_RIGID, PLIANT_DRIVE_SPRING};
    return try_block(context, names, 2, sizeof *drives, drives, trial_teleport);
}

pliant_status stability_dynamic_not_finite(stability_context *context)
{
    static const char *const names[] = {"NaN, infinity, 1e200"};
    return try_block(context, names, 1, 0, names, trial_not_finite);
}

pliant_status stability_dynamic_spring(stability_context *context)
{
    static const char *const names[] = {"0.001 N/m", "1000 N/m", "1e+09 N/m"};
    static const double stiffness[] = {1e-3, 1e3, 1e9};
    return try_block(context, names, 3, sizeof *stiffness, stiffness, trial_spring);
}

static pliant_status try_body(stability_context *context, const char *name, block_body *body,
                              stability_treatment treatment)
{
    damp(body);
    context->dynamic = true;
    pliant_status status = stability_try(context, name, &body->input, treatment, NULL);
    context->dynamic = false;
    return status;
}

pliant_status stability_dynamic_octree(stability_context *context)
{
    block_body body;
    pliant_status status = block_create_default(&body);
    body.scene.mesh.kind = PLIANT_OCTREE;
    body.scene.mesh.depth = 2;
    if (status >= 0) status = try_body(context, "cells of three sizes", &body, trial_sag_and_pull);
    block_free(&body);
    return status;
}

/* a sphere of bone whose surface intersects cells arbitrarily */
static int bone_ball(const int32_t voxel[3], const int32_t size[3])
{
    double squares = 0;
    for (int d = 0; d < 3; d++) squares += pow((voxel[d] + 0.5) / size[d] - 0.45, 2);
    return squares < 0.04 ? BLOCK_BONE : BLOCK_SOFT;
}

pliant_status stability_dynamic_bone_surface(stability_context *context)
{
    static const int32_t size[3] = {12, 12, 12};
    static const double box[3] = {0.1, 0.1, 0.1};
    block_body body;
    pliant_status status = block_create(size, box, bone_ball, &body);
    body.scene.mesh.bone_surface = true;
    if (status >= 0) status = try_body(context, "around a ball of bone", &body, trial_sag_and_pull);
    block_free(&body);
    return status;
}

/* Check that the deformed volume comes from a smooth map in every frame, and equals the scan at rest. */
static pliant_status show(stability_trial *trial, const void *argument)
{
    const double max_wrong = 0.01;
    const pliant_volume *scan = trial->input->scan;
    pliant_status status = trial_check_status(trial, pliant_data_set_warp(trial->model, trial->data, &scan->geometry));
    if (status >= 0) status = trial_sag_and_pull(trial, argument);
    if (status < 0 || trial->cancelled) return status;
    const pliant_volume *shown = pliant_warp_volume(trial->data->warp);
    size_t wrong = 0, count = pliant_geometry_voxels(&scan->geometry);
    for (size_t v = 0; v < count; v++)
        wrong += ((const uint8_t *)scan->voxels)[v] != ((const uint8_t *)shown->voxels)[v];
    snprintf(trial->figure, sizeof trial->figure, "%zu of %zu voxels differ from the scan at rest", wrong, count);
    if ((double)wrong > max_wrong * (double)count) trial->has_wrong_rest = true;
    return status;
}

pliant_status stability_dynamic_fit(stability_context *context)
{
    block_body body;
    pliant_status status = block_create_default(&body);
    body.scene.warp.kind = PLIANT_FIT;
    if (status >= 0) status = try_body(context, "a volume in every frame", &body, show);
    block_free(&body);
    return status;
}
