/* Stability cases with unusual loads, on the user's scan if there is one. */
#include "base/fail.h"
#include "fem/element/scalar.h"
#include "model_data/data.h"
#include "base/memory.h"
#include "report/stability_cases.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* pseudo-random number in [0, 1), identical on all machines */
static double next_random(uint64_t *state)
{
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 11) / 9007199254740992.0;
}

static pliant_status move_to(stability_trial *trial, const double from[3], const double direction[3], double distance)
{
    double tip[3];
    for (int d = 0; d < 3; d++) tip[d] = from[d] + distance * direction[d];
    pliant_status status = trial_check_status(trial, pliant_tool_set_pose(trial->data, 0, tip, NULL));
    return status < 0 ? status : trial_step(trial);
}

/* apply a treatment with each of these numbers */
static pliant_status try_each(stability_context *context, const double *numbers, size_t count, const char *unit,
                              stability_treatment treatment)
{
    pliant_status status = PLIANT_OK;
    for (size_t n = 0; status >= 0 && n < count; n++) {
        char text[32];
        snprintf(text, sizeof text, "%g %s", numbers[n], unit);
        status = stability_try(context, text, context->input, treatment, numbers + n);
    }
    return status;
}

/* ---- pull: to a multiple of the body's size in 30 steps, then release */

typedef struct pull_argument { double sizes; pliant_drive drive; } pull_argument;
static const double oblique_direction[3] = {0.48, -0.8, 0.36};

static pliant_status pull(stability_trial *trial, const void *argument)
{
    const pull_argument *pull = argument;
    double from[3];
    pliant_status status = trial_grasp(trial, pull->drive, from);
    for (int step = 1; status >= 0 && step <= 30; step++)
        status = move_to(trial, from, oblique_direction, pull->sizes * trial->size * step / 30);
    if (status < 0) return status;
    int32_t settled = trial_settle(trial);
    double force = 0;
    for (int d = 0; d < 3; d++) force += pow(trial->data->tools[0].force[d], 2);
    snprintf(trial->figure, sizeof trial->figure, "%s in %d steps more at the end of the pull, %.4g N",
             settled < 0 ? "not settled" : "settled", settled < 0 ? trial->context->options->settle_steps : settled,
             sqrt(force));
    return trial->last < 0 ? trial->last : trial_release_tools(trial);
}

pliant_status stability_pull(stability_context *context)
{
    static const double sizes[] = {0.1, 1, 10};
    pliant_status status = PLIANT_OK;
    for (size_t s = 0; status >= 0 && s < 2 * sizeof sizes / sizeof *sizes; s++) {
        pull_argument argument = {sizes[s / 2], s % 2 ? PLIANT_DRIVE_SPRING : PLIANT_DRIVE_RIGID};
        char text[48];
        snprintf(text, sizeof text, "%g x the body, %s", argument.sizes, s % 2 ? "spring" : "rigid");
        status = stability_try(context, text, context->input, pull, &argument);
    }
    return status;
}

/* ---- teleport: the grasped point moves to a different position in every step */

pliant_status trial_teleport(stability_trial *trial, const void *argument)
{
    const pliant_drive *drive = argument;
    uint64_t random = 7;
    double from[3];
    pliant_status status = trial_grasp(trial, *drive, from);
    for (int step = 1; status >= 0 && step <= 20; step++) {
        double direction[3];
        for (int d = 0; d < 3; d++) direction[d] = 2 * next_random(&random) - 1;
        status = move_to(trial, from, direction, trial->size);
    }
    return status < 0 ? status : trial_release_tools(trial);
}

pliant_status stability_teleport(stability_context *context)
{
    static const pliant_drive drives[] = {PLIANT_DRIVE_RIGID, PLIANT_DRIVE_SPRING};
    pliant_status status = stability_try(context, "rigid", context->input, trial_teleport, drives);
    return status < 0 ? status : stability_try(context, "spring", context->input, trial_teleport, drives + 1);
}

/* ---- full gravity in one step */

static pliant_status heavy(stability_trial *trial, const void *argument)
{
    double gravity[3] = {0, -9.80665 * *(const double *)argument, 0};
    pliant_status status = trial_check_status(trial, pliant_data_set_gravity(trial->data, gravity));
    if (status < 0) return status;
    int32_t settled = trial_settle(trial);
    snprintf(trial->figure, sizeof trial->figure, "%s in %d steps, %.4g mm", settled < 0 ? "not settled" : "settled",
             settled < 0 ? trial->context->options->settle_steps : settled, 1e3 * trial->largest);
    return trial->last < 0 ? trial->last : trial_release_tools(trial);
}

pliant_status stability_gravity(stability_context *context)
{
    static const double sizes[] = {1, 10, 100};
    return try_each(context, sizes, sizeof sizes / sizeof *sizes, "g", heavy);
}

/* ---- springs of any stiffness, moved by a tenth of the body's size in one step */

pliant_status trial_spring(stability_trial *trial, const void *argument)
{
    double from[3];
    pliant_status status = trial_grasp(trial, PLIANT_DRIVE_SPRING, from);
    if (status < 0) return status;
    trial->data->tools[0].stiffness = *(const double *)argument;
    status = move_to(trial, from, oblique_direction, 0.1 * trial->size);
    if (status >= 0) trial_settle(trial);
    double follows = 0;
    for (int d = 0; d < 3; d++) follows += oblique_direction[d] * (trial->data->tools[0].held_point[d] - from[d]);
    snprintf(trial->figure, sizeof trial->figure, "the held point follows by %.4g of the motion",
             follows / (0.1 * trial->size));
    return trial->last < 0 ? trial->last : trial_release_tools(trial);
}

pliant_status stability_spring(stability_context *context)
{
    static const double stiffness[] = {1e-3, 1, 1e3, 1e6, 1e9};
    return try_each(context, stiffness, sizeof stiffness / sizeof *stiffness, "N/m", trial_spring);
}

/* ---- the free end rotated by 180 degrees in one step by three tools */

static pliant_status twist(stability_trial *trial, const void *argument)
{
    const pliant_mesh *fine = &trial->model->body->fine;
    double middle[3] = {0, 0, 0}, low[3], high[3];
    (void)argument;
    for (int d = 0; d < 3; d++) {
        low[d] = INFINITY, high[d] = -INFINITY;
        for (int32_t n = 0; n < fine->num_nodes; n++) {
            low[d] = fmin(low[d], fine->rest[3 * n + d]);
            high[d] = fmax(high[d], fine->rest[3 * n + d]);
        }
        middle[d] = 0.5 * (low[d] + high[d]);
    }
    pliant_status status = PLIANT_OK;
    for (int t = 0; status >= 0 && t < 3; t++) {
        double point[3] = {high[0] - 1e-6,
                           t == 0 ? low[1] + 0.01 * (high[1] - low[1]) : high[1] - 0.01 * (high[1] - low[1]),
                           t == 2 ? low[2] + 0.01 * (high[2] - low[2]) : high[2] - 0.01 * (high[2] - low[2])};
        char name[16];
        int tool;
        snprintf(name, sizeof name, "finger %d", t);
        status = pliant_tool_add(trial->model, trial->data, name, &tool);
        if (status >= 0) status = pliant_tool_set_pose(trial->data, tool, point, NULL);
        if (status >= 0) status = pliant_tool_grasp(trial->model, trial->data, tool, point);
        if (status >= 0) status = pliant_tool_set_drive(trial->data, tool, PLIANT_DRIVE_RIGID, NULL);
        point[1] = 2 * middle[1] - point[1];
        point[2] = 2 * middle[2] - point[2];
        if (status >= 0) status = pliant_tool_set_pose(trial->data, tool, point, NULL);
    }
    if (trial_check_status(trial, status) < 0) return status;
    int32_t settled = trial_settle(trial);
    snprintf(trial->figure, sizeof trial->figure, "%s in %d steps, %d inverted",
             settled < 0 ? "not settled" : "settled", settled < 0 ? trial->context->options->settle_steps : settled,
             pliant_mesh_inverted(fine, trial->data->positions));
    return trial->last < 0 ? trial->last : trial_release_tools(trial);
}

/* rotate all free nodes about the body's axis by 180 degrees, then release */
static pliant_status turned(stability_trial *trial, const void *argument)
{
    const pliant_mesh *fine = &trial->model->body->fine;
    double *positions = pliant_calloc((size_t)fine->num_nodes, 3 * sizeof *positions), middle[3] = {0, 0, 0};
    (void)argument;
    if (!positions) return trial_check_status(trial, pliant_fail_memory("a turned state"));
    for (int32_t i = 0; i < 3 * fine->num_nodes; i++) middle[i % 3] += fine->rest[i] / fine->num_nodes;
    for (int32_t i = 0; i < 3 * fine->num_nodes; i++)
        positions[i] = i % 3 ? 2 * middle[i % 3] - fine->rest[i] : fine->rest[i];
    pliant_status status = trial_check_status(trial, pliant_data_set_positions(trial->model, trial->data, positions));
    pliant_free(positions);
    return status < 0 ? status : trial_release_tools(trial);
}

pliant_status stability_half_turn(stability_context *context)
{
    block_body body;
    pliant_status status = block_create_default(&body);
    if (status >= 0) status = stability_try(context, "the free end, held by three tools", &body.input, twist, NULL);
    if (status >= 0) status = stability_try(context, "the whole body", &body.input, turned, NULL);
    block_free(&body);
    return status;
}

/* ---- values that are not finite are rejected without any effect */

pliant_status trial_not_finite(stability_trial *trial, const void *argument)
{
    static const double nothing[3] = {0, 0, 0};
    const double bad[2][3] = {{NAN, 0, 0}, {0, INFINITY, 0}};
    double from[3];
    int refused = 0;
    (void)argument;
    pliant_status status = trial_grasp(trial, PLIANT_DRIVE_RIGID, from);
    if (status < 0) return status;
    for (int b = 0; b < 2; b++) {
        refused += trial_check_status(trial, pliant_tool_set_pose(trial->data, 0, bad[b], NULL)) < 0;
        refused += trial_check_status(trial, pliant_tool_grasp(trial->model, trial->data, 0, bad[b])) < 0;
        refused += trial_check_status(trial, pliant_tool_set_drive(trial->data, 0, PLIANT_DRIVE_FORCE, bad[b])) < 0;
        refused += trial_check_status(trial, pliant_data_set_gravity(trial->data, bad[b])) < 0;
        refused += trial_check_status(
                       trial, pliant_data_set_positions(trial->model, trial->data, (const double[3]){NAN, 0, 0})) < 0;
        trial_step(trial);
    }
    /* finite, but the square overflows in double precision */
    const double huge[3] = {1e200, 0, 0};
    if (trial_check_status(trial, pliant_tool_set_pose(trial->data, 0, huge, NULL)) >= 0) trial_step(trial);
    trial_check_status(trial, pliant_tool_set_pose(trial->data, 0, from, NULL));
    trial_check_status(trial, pliant_tool_set_drive(trial->data, 0, PLIANT_DRIVE_FORCE, nothing));
    snprintf(trial->figure, sizeof trial->figure, "%d of 10 calls refused", refused);
    return trial_release_tools(trial);
}

pliant_status stability_not_finite(stability_context *context)
{
    return stability_try(context, "NaN, infinity, 1e200", context->input, trial_not_finite, NULL);
}
