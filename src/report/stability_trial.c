#include "report/stability_trial.h"

#include "backend/explicit_statistics.h"
#include "base/clock.h"
#include "base/fail.h"
#include "fem/element/scalar.h"
#include "model_data/data.h"
#include "base/memory.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define METHOD_NAME(name, yaml) #yaml,
static const char *const method_names[] = {PLIANT_METHOD_LIST(METHOD_NAME)};
#undef METHOD_NAME
enum { NUM_METHODS = sizeof method_names / sizeof *method_names };

const char *pliant_verdict_name(pliant_verdict verdict)
{
    static const char *const names[] = {"converged", "refused", "degraded", "broken"};
    static_assert(sizeof names / sizeof *names == PLIANT_VERDICT_BROKEN + 1, "each verdict has a name");
    return names[verdict];
}

/* ---- one step with checks */

static bool finite_positions(const stability_trial *trial)
{
    for (int32_t i = 0; i < 3 * trial->model->body->fine.num_nodes; i++)
        if (!isfinite(trial->data->positions[i])) return false;
    return true;
}

/* maximum distance from rest [m] */
static double max_distance_from_rest(const stability_trial *trial)
{
    const pliant_mesh *fine = &trial->model->body->fine;
    double maximum = 0;
    for (int32_t n = 0; n < fine->num_nodes; n++) {
        double squares = 0;
        for (int i = 3 * n; i < 3 * n + 3; i++) squares += pow(trial->data->positions[i] - fine->rest[i], 2);
        maximum = fmax(maximum, squares);
    }
    return sqrt(maximum);
}

static void set_trial_message(stability_trial *trial, const char *message)
{
    if (!trial->message[0]) snprintf(trial->message, sizeof trial->message, "%s", message);
}

pliant_status trial_check_status(stability_trial *trial, pliant_status status)
{
    trial->last = status;
    if (status < 0) {
        trial->refused++;
        set_trial_message(trial, pliant_last_error());
    }
    return status;
}

static bool check_progress(stability_trial *trial)
{
    stability_context *context = trial->context;
    if (!pliant_report_progress(context->progress, (double)context->index / context->count, trial->activity))
        trial->cancelled = true;
    return !trial->cancelled;
}

pliant_status trial_step(stability_trial *trial)
{
    if (trial->steps % 32 == 0 && !check_progress(trial)) return PLIANT_ERROR_CANCELLED;
    size_t size = 3 * (size_t)trial->model->body->fine.num_nodes * sizeof *trial->kept;
    memcpy(trial->kept, trial->data->positions, size);
    pliant_status status = trial_check_status(trial, pliant_step(trial->model, trial->data));
    trial->steps++;
    trial->iterations += trial->data->statistics.iterations;
    if (!finite_positions(trial)) {
        trial->broken = true;
        snprintf(trial->message, sizeof trial->message, "positions are not finite after step %lld",
                 (long long)trial->steps);
        return PLIANT_ERROR_NUMERIC;
    }
    if (status < 0 && memcmp(trial->kept, trial->data->positions, size) != 0) {
        trial->broken = true;
        snprintf(trial->message, sizeof trial->message, "the state before step %lld was not kept",
                 (long long)trial->steps);
    }
    int32_t inverted = pliant_mesh_inverted(&trial->model->body->fine, trial->data->positions);
    if (inverted > trial->max_inverted_elements) trial->max_inverted_elements = inverted;
    trial->largest = fmax(trial->largest, max_distance_from_rest(trial));
    return status;
}

static bool has_inertia(const pliant_scene *scene)
{
    return scene->solver.kind == PLIANT_TLED && !scene->tled.quasi_static;
}

/* Return whether the body is at rest: the kinetic energy stays nearly zero for some frames. At a turning point it is
 * zero only briefly. */
static bool has_come_to_rest(stability_trial *trial)
{
    enum { STEPS = 3 };
    const double moving = 1e-7;
    pliant_dynamics dynamics;
    if (trial_check_status(trial, pliant_data_get_dynamics(trial->model, trial->data, &dynamics)) < 0) return false;
    trial->energy = fmax(trial->energy, dynamics.kinetic_energy + dynamics.strain_energy);
    trial->still = dynamics.kinetic_energy <= moving * trial->energy ? trial->still + 1 : 0;
    return trial->still >= STEPS;
}

int32_t trial_settle(stability_trial *trial)
{
    char text[128];
    const bool swings = has_inertia(&trial->model->scene);
    const int32_t maximum = trial->context->options->settle_steps;
    trial->still = 0;
    for (int32_t step = 1; step <= maximum; step++) {
        pliant_status status = trial_step(trial);
        if (status < 0) return -1;
        if (swings ? has_come_to_rest(trial) : status == PLIANT_OK) return step;
    }
    trial->is_unsettled = true;
    if (swings) snprintf(text, sizeof text, "did not come to rest in %d steps", (int)maximum);
    else
        snprintf(text, sizeof text, "did not settle in %d steps, residual %.2g", (int)maximum,
                 trial->data->statistics.residual);
    set_trial_message(trial, text);
    return -1;
}

pliant_status trial_release_tools(stability_trial *trial)
{
    static const double none[3] = {0, 0, 0};
    for (int t = 0; t < trial->data->num_tools; t++) pliant_tool_remove_pose(trial->data, t);
    pliant_status status = trial_check_status(trial, pliant_data_set_gravity(trial->data, none));
    if (status < 0) return status;
    trial->steps_to_rest = trial_settle(trial);
    if (trial->steps_to_rest >= 0 && max_distance_from_rest(trial) > 0.01 * trial->size) trial->has_wrong_rest = true;
    return trial->last;
}

pliant_status trial_grasp(stability_trial *trial, pliant_drive drive, double from[3])
{
    const pliant_model *model = trial->model;
    const pliant_mesh *fine = &model->body->fine;
    double centre[3] = {0, 0, 0}, farthest = -1, weight = 0;
    int32_t best = -1;
    int tool;
    for (int32_t n = 0; n < fine->num_nodes; n++) {
        if (!model->body->fine_fixed[n]) continue;
        for (int d = 0; d < 3; d++) centre[d] += fine->rest[3 * n + d];
        weight++;
    }
    for (int d = 0; d < 3; d++) centre[d] /= fmax(weight, 1);
    for (int32_t n = 0; n < fine->num_nodes; n++) {
        double squares = 0;
        for (int d = 0; d < 3; d++) squares += pow(fine->rest[3 * n + d] - centre[d], 2);
        if (model->body->fine_fixed[n] || squares <= farthest) continue;
        farthest = squares;
        best = n;
    }
    if (best < 0)
        return trial_check_status(trial,
                                  pliant_fail(PLIANT_ERROR_SCENE, "all nodes are fixed: there is no node to grasp"));
    const double *rest = fine->rest + 3 * best;
    pliant_status status = pliant_tool_add(model, trial->data, "trial", &tool);
    if (status >= 0) status = pliant_tool_set_pose(trial->data, tool, rest, NULL);
    if (status >= 0) status = pliant_tool_grasp(model, trial->data, tool, rest);
    if (status >= 0) status = pliant_tool_set_drive(trial->data, tool, drive, NULL);
    if (status >= 0) memcpy(from, trial->data->tools[tool].tip, 3 * sizeof *from);
    return trial_check_status(trial, status);
}

pliant_status trial_sag_and_pull(stability_trial *trial, const void *argument)
{
    static const double down[3] = {0, -9.80665, 0};
    double from[3], tip[3];
    (void)argument;
    pliant_status status = trial_check_status(trial, pliant_data_set_gravity(trial->data, down));
    if (status >= 0) trial_settle(trial);
    double sag = 1e3 * max_distance_from_rest(trial);
    if (trial->last >= 0) status = trial_grasp(trial, PLIANT_DRIVE_RIGID, from);
    for (int step = 1; trial->last >= 0 && step <= 10; step++) {
        for (int d = 0; d < 3; d++) tip[d] = from[d] + 0.1 * trial->size * step / 10 * (d == 1 ? 0.8 : 0.4242640687);
        status = trial_check_status(trial, pliant_tool_set_pose(trial->data, 0, tip, NULL));
        if (status >= 0) status = trial_step(trial);
    }
    if (trial->last >= 0) trial_settle(trial);
    if (trial->last >= 0) status = trial_release_tools(trial);
    snprintf(trial->figure, sizeof trial->figure, "sags %.4g mm under 1 g", sag);
    return status;
}

/* ---- rows of trials */

static pliant_verdict judge(stability_trial *trial, int64_t growth)
{
    char text[256];
    if (growth != 0 && !trial->broken) {
        snprintf(trial->message, sizeof trial->message, "%lld bytes were not freed", (long long)growth);
        trial->broken = true;
    }
    if (trial->broken) return PLIANT_VERDICT_BROKEN;
    if (trial->last < 0) return PLIANT_VERDICT_REFUSED;
    int32_t inverted = trial->data ? pliant_mesh_inverted(&trial->model->body->fine, trial->data->positions) : 0;
    if (trial->is_unsettled || trial->last > 0) {
        snprintf(text, sizeof text, "%s; residual %.2g after %lld steps, %d inverted",
                 pliant_status_text(PLIANT_NOT_CONVERGED), trial->data->statistics.residual, (long long)trial->steps,
                 inverted);
        set_trial_message(trial, text);
        return PLIANT_VERDICT_DEGRADED;
    }
    if (trial->has_wrong_rest) {
        snprintf(text, sizeof text, "in equilibrium, but %.3g mm off rest with %d tetrahedra inverted",
                 1e3 * max_distance_from_rest(trial), inverted);
        set_trial_message(trial, text);
        return PLIANT_VERDICT_DEGRADED;
    }
    return trial->refused > 0 ? PLIANT_VERDICT_REFUSED : PLIANT_VERDICT_CONVERGED;
}

static void free_trial(stability_trial *trial)
{
    pliant_data_free(trial->data);
    pliant_model_free(trial->model);
    pliant_free(trial->kept);
    trial->data = NULL;
    trial->model = NULL;
    trial->kept = NULL;
}

static pliant_status write_result_row(stability_trial *trial)
{
    report_row *row = &trial->row;
    const pliant_data *data = trial->data;
    bool ran = data && trial->steps > 0;
    double residual = ran ? data->statistics.residual : NAN, off = data ? 1e3 * max_distance_from_rest(trial) : NAN;
    int32_t inverted = data ? pliant_mesh_inverted(&trial->model->body->fine, data->positions) : 0;
    int64_t unconverged = data ? (int64_t)data->statistics.not_converged : 0;
    pliant_verdict verdict = judge(trial, 0);
    free_trial(trial);
    int64_t growth = (int64_t)pliant_memory_in_use() - (int64_t)trial->bytes_before;
    if (growth != 0) verdict = judge(trial, growth);
    row_text(row, pliant_verdict_name(verdict));
    row_text(row, trial->message);
    row_integer(row, trial->steps);
    if (trial->steps_to_rest > -2) row_integer(row, trial->steps_to_rest);
    else row_empty(row, 1);
    row_integer(row, trial->iterations);
    row_number(row, pliant_seconds() - trial->start);
    row_number(row, residual);
    row_number(row, data ? 1e3 * trial->largest : NAN);
    row_number(row, off);
    row_integer(row, trial->max_inverted_elements);
    row_integer(row, inverted);
    row_integer(row, unconverged);
    row_integer(row, trial->refused);
    row_integer(row, growth);
    row_text(row, trial->figure);
    return row_add(row, trial->context->tables->stability);
}

void trial_use_requested_tled(const stability_context *context, pliant_scene *scene)
{
    const pliant_scene *requested = context->options->scene;
    if (!requested || requested->solver.kind != PLIANT_TLED || context->dynamic) return;
    scene->solver.kind = PLIANT_TLED;
    scene->tled = requested->tled;
    scene->tled.quasi_static = true;
}

static pliant_status try_method(stability_trial *trial, stability_treatment treatment, const void *argument)
{
    const pliant_report_input *input = trial->input;
    pliant_scene scene = *input->scene;
    scene.model.method = trial->method;
    trial_use_requested_tled(trial->context, &scene);
    trial->start = pliant_seconds();
    trial->bytes_before = pliant_memory_in_use();
    trial->steps_to_rest = -2;
    pliant_progress silent = {NULL, NULL};
    pliant_status status = trial_check_status(
        trial, pliant_model_build(&scene, input->scan, input->labels, input->materials, silent, &trial->model));
    if (status < 0) return write_result_row(trial);
    const pliant_mesh *fine = &trial->model->body->fine;
    for (int d = 0; d < 3; d++) {
        double low = INFINITY, high = -INFINITY;
        for (int32_t n = 0; n < fine->num_nodes; n++) {
            low = fmin(low, fine->rest[3 * n + d]);
            high = fmax(high, fine->rest[3 * n + d]);
        }
        trial->size = fmax(trial->size, high - low);
    }
    status = trial_check_status(trial, pliant_data_create(trial->model, &trial->data));
    trial->kept = pliant_calloc((size_t)fine->num_nodes, 3 * sizeof *trial->kept);
    if (status >= 0 && !trial->kept) status = trial_check_status(trial, pliant_fail_memory("the state before a step"));
    if (status >= 0) treatment(trial, argument);
    if (!trial->cancelled) return write_result_row(trial);
    free_trial(trial);
    return pliant_fail(PLIANT_ERROR_CANCELLED, "the report was stopped; finished rows are kept");
}

pliant_status stability_try(stability_context *context, const char *parameter, const pliant_report_input *input,
                            stability_treatment treatment, const void *argument)
{
    for (int m = 0; m < NUM_METHODS; m++) {
        bool tled =
            context->dynamic || (context->options->scene && context->options->scene->solver.kind == PLIANT_TLED);
        if (!(context->options->methods >> m & 1) || (tled && m != PLIANT_FINE)) continue;
        stability_trial *trial = pliant_calloc(1, sizeof *trial);
        if (!trial) return pliant_fail_memory("a trial");
        pliant_status status = PLIANT_OK;
        trial->context = context;
        trial->input = input;
        trial->method = (pliant_method)m;
        row_text(&trial->row, context->setup);
        row_text(&trial->row, context->name);
        row_text(&trial->row, parameter);
        row_text(&trial->row, method_names[m]);
        snprintf(trial->activity, sizeof trial->activity, "stability: %s %s, %s", context->name, parameter,
                 method_names[m]);
        if (!row_is_stored(&trial->row, context->tables->stability)) status = try_method(trial, treatment, argument);
        pliant_free(trial);
        if (status < 0) return status;
    }
    return PLIANT_OK;
}
