/* Cases about explicit dynamics: its time step, and the energy that it should keep. */
#include "base/fail.h"
#include "fem/dynamics/tled.h"
#include "pliant/memory.h"
#include "report/stability.h"

#include <math.h>
#include <stdio.h>

static int all_soft(const int32_t voxel[3], const int32_t size[3])
{
    (void)voxel;
    (void)size;
    return 0;
}

/* A block of one tissue without damping, by true dynamics. Of one tissue, because the bound is that of the stiffest element alone: where
 * its neighbours are softer, what they add in mass lets it take longer steps. */
static pliant_status dynamic_block(block_body *body)
{
    static const int32_t size[3] = {12, 12, 12};
    static const double box[3] = {0.1, 0.1, 0.1};
    pliant_status status = block_create(size, box, all_soft, body);
    body->scene.solver.kind = PLIANT_TLED;
    body->scene.tled.damping = 0;
    return status;
}

/* The time step is `part` of the largest stable one: sub-steps of a frame are whole, so the frame is made of so many of them. */
static pliant_status set_time_step(block_body *body, double part, int substeps)
{
    pliant_model *model = NULL;
    pliant_status status = pliant_model_build(&body->scene, &body->scan, NULL, &body->table, (pliant_progress){NULL, NULL}, &model);
    if (status < 0) return status;
    body->scene.tled.safety = part;
    body->scene.solver.step = substeps * part * fmin(model->tled->edge_bound, model->tled->eigenvalue_bound);
    pliant_model_free(model);
    return PLIANT_OK;
}

/* ---- time_step: at 0.99 of the bound it swings, at 1.5 the first frames are refused and the state before them is kept */

static pliant_status swing(stability_trial *trial, const void *argument)
{
    static const double aside[3] = {0, -2, 0};
    const bool stable = *(const double *)argument < 1;
    const int64_t most = stable ? 100 : 3;
    pliant_dynamics dynamics;
    pliant_status status = trial_called(trial, pliant_data_gravity(trial->data, aside));
    if (status >= 0) status = trial_called(trial, pliant_data_dynamics(trial->model, trial->data, &dynamics));
    while (status >= 0 && trial->steps < most) status = trial_step(trial);
    if (status == PLIANT_ERROR_CANCELLED) return status;
    snprintf(trial->figure, sizeof trial->figure, "bounds %.4g us (edge) and %.4g us (eigenvalue), step %.4g us; %s after %lld sub-steps",
             1e6 * dynamics.edge_bound, 1e6 * dynamics.eigenvalue_bound, 1e6 * dynamics.time_step, status < 0 ? "diverged" : "swings",
             (long long)trial->iterations);
    if (stable == (status >= 0) && trial->largest < trial->size) return status;
    trial->broken = true;
    if (!trial->message[0])
        snprintf(trial->message, sizeof trial->message, stable ? "it grows without end" : "a step above the bound was not caught");
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

/* ---- energy: bent and let go, undamped */

static pliant_status keep_energy(stability_trial *trial, const void *argument)
{
    const double most_drift = 1e-3;
    const pliant_mesh *fine = &trial->model->body->fine;
    pliant_dynamics dynamics;
    double first = 0, drift = 0, *positions = pliant_calloc((size_t)fine->num_nodes, 3 * sizeof *positions);
    (void)argument;
    if (!positions) return trial_called(trial, pliant_fail_memory("a bent state"));
    for (int32_t i = 0; i < 3 * fine->num_nodes; i++) positions[i] = fine->rest[i];
    for (int32_t n = 0; n < fine->num_nodes; n++) positions[3 * n + 1] += 0.05 * fine->rest[3 * n] * fine->rest[3 * n] / trial->size;
    pliant_status status = trial_called(trial, pliant_data_set_positions(trial->model, trial->data, positions));
    pliant_free(positions);
    while (status >= 0 && trial->iterations < trial->context->options->long_steps) {
        status = trial_step(trial);
        if (status >= 0) status = pliant_data_dynamics(trial->model, trial->data, &dynamics);
        if (status < 0) return status;
        if (first == 0) first = dynamics.kept_energy;
        drift = fmax(drift, fabs(dynamics.kept_energy - first) / first);
    }
    snprintf(trial->figure, sizeof trial->figure, "%.3g J, drift %.2g %% over %lld sub-steps", first, 100 * drift, (long long)trial->iterations);
    if (status >= 0 && !(drift < most_drift)) {
        trial->unsettled = true;
        snprintf(trial->message, sizeof trial->message, "its energy drifts by %.2g %%; %g is wanted", 100 * drift, 100 * most_drift);
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
