/* Measure the cost of explicit dynamics on a scene, and its energy conservation. */
#include "base/fail.h"
#include "backend/explicit_statistics.h"
#include "base/clock.h"
#include "base/threads.h"
#include "report/report.h"
#include "model_data/data.h"
#include "base/memory.h"
#include "report/rows.h"

#include <math.h>
#include <string.h>

/* A simulation that is pulled in the first half of its frames, then released. */
typedef struct pulled_run {
    pliant_model *model;
    pliant_data *data;
    int tool;
    double from[3];
} pulled_run;

static void pulled_free(pulled_run *run)
{
    pliant_data_free(run->data);
    pliant_model_free(run->model);
    *run = (pulled_run){0};
}

/* Must also be freed after a failure. */
static pliant_status pulled_create(const pliant_report_input *input, const pliant_scene *scene,
                                   const pliant_sweep *sweep, pliant_progress progress, pulled_run *run)
{
    const double *at = sweep->points[0].rest;
    *run = (pulled_run){0};
    pliant_status status =
        pliant_model_build(scene, input->scan, input->labels, input->materials, progress, &run->model);
    if (status >= 0) status = pliant_data_create(run->model, &run->data);
    if (status >= 0) status = pliant_tool_add(run->model, run->data, "report", &run->tool);
    if (status >= 0) status = pliant_tool_set_pose(run->data, run->tool, at, NULL);
    if (status >= 0) status = pliant_tool_grasp(run->model, run->data, run->tool, at);
    if (status >= 0) status = pliant_tool_set_drive(run->data, run->tool, PLIANT_DRIVE_RIGID, NULL);
    if (status >= 0) memcpy(run->from, run->data->tools[run->tool].tip, sizeof run->from);
    return status;
}

static int32_t frames_of(const pliant_sweep *sweep) { return 2 * sweep->frames; }

/* @param seconds Nullable: output; time of the step */
static pliant_status pulled_frame(pulled_run *run, const pliant_sweep *sweep, int32_t frame, double *seconds,
                                  pliant_progress progress)
{
    double tip[3];
    pliant_status status = PLIANT_OK;
    if (!pliant_report_progress(progress, (double)frame / frames_of(sweep), "explicit dynamics"))
        return pliant_fail(PLIANT_ERROR_CANCELLED, "the report was stopped; finished rows are kept");
    if (frame == sweep->frames) pliant_tool_remove_pose(run->data, run->tool);
    for (int d = 0; d < 3; d++) tip[d] = run->from[d] + sweep->pull[d] * (frame + 1.0) / sweep->frames;
    if (frame < sweep->frames) status = pliant_tool_set_pose(run->data, run->tool, tip, NULL);
    double start = pliant_seconds();
    if (status >= 0) status = pliant_step(run->model, run->data);
    if (seconds) *seconds = pliant_seconds() - start;
    return status;
}

/* Measure the energy drift after the release, in a scene without dissipation and external forces.
 * @param drift output; maximum relative change of the energy [-] */
static pliant_status run_drift(pulled_run *run, const pliant_sweep *sweep, double *drift, pliant_progress progress)
{
    pliant_status status = PLIANT_OK;
    double first = 0;
    *drift = 0;
    for (int32_t f = 0; status >= 0 && f < frames_of(sweep); f++) {
        pliant_dynamics dynamics;
        status = pulled_frame(run, sweep, f, NULL, progress);
        if (status < 0 || f < sweep->frames) continue;
        if ((status = pliant_data_get_dynamics(run->model, run->data, &dynamics)) < 0) break;
        if (f == sweep->frames)
            first = dynamics.kept_energy;
        else
            *drift = fmax(*drift, fabs(dynamics.kept_energy - first) / first);
    }
    return status;
}

/* Measure the drift of the scene without damping, viscosity and gravity. */
static pliant_status measure_drift(const pliant_report_input *input, const pliant_sweep *sweep, double *drift,
                                   pliant_progress progress)
{
    pliant_scene scene = *input->scene;
    pulled_run run;
    scene.tled.quasi_static = scene.tled.nodal_pressure = false;
    scene.tled.damping = 0;
    memset(scene.tled.prony_share, 0, sizeof scene.tled.prony_share);
    memset(scene.model.gravity, 0, sizeof scene.model.gravity);
    pliant_status status = pulled_create(input, &scene, sweep, progress, &run);
    if (status >= 0) status = run_drift(&run, sweep, drift, progress);
    pulled_free(&run);
    return status;
}

/* Time discretization error of central differences, from two simultaneous runs, the second one with half the sub-step.
 * The scheme has second order, so the error of the first run is 4/3 of the difference (Richardson; Hairer, Norsett,
 * Wanner, Solving Ordinary Differential Equations I, II.4). */
typedef struct time_error {
    double error, largest;
} time_error; /* maximum over frames and nodes; maximum displacement [m] */

static void compare(const pulled_run *whole, const pulled_run *half, time_error *out)
{
    const pliant_mesh *mesh = &whole->data->body->fine;
    for (int32_t n = 0; n < mesh->num_nodes; n++) {
        double squares = 0, moved = 0;
        for (int i = 3 * n; i < 3 * n + 3; i++) {
            squares += pow(whole->data->positions[i] - half->data->positions[i], 2);
            moved += pow(half->data->positions[i] - mesh->rest[i], 2);
        }
        out->error = fmax(out->error, 4.0 / 3 * sqrt(squares));
        out->largest = fmax(out->largest, sqrt(moved));
    }
}

static pliant_status measure_time_error(const pliant_report_input *input, const pliant_scene *requested,
                                        const pliant_sweep *sweep, time_error *out, pliant_progress progress)
{
    pliant_scene scene = *requested;
    pulled_run whole, half = {0};
    pliant_dynamics dynamics;
    *out = (time_error){0};
    pliant_status status = pulled_create(input, requested, sweep, progress, &whole);
    if (status >= 0) status = pliant_data_get_dynamics(whole.model, whole.data, &dynamics);
    if (status >= 0) { /* exactly twice the number of sub-steps */
        scene.tled.safety = 0.5 * dynamics.time_step / fmin(dynamics.edge_bound, dynamics.eigenvalue_bound);
        status = pulled_create(input, &scene, sweep, progress, &half);
    }
    for (int32_t f = 0; status >= 0 && f < frames_of(sweep); f++) {
        status = pulled_frame(&whole, sweep, f, NULL, progress);
        if (status >= 0) status = pulled_frame(&half, sweep, f, NULL, progress);
        if (status >= 0) compare(&whole, &half, out);
    }
    pulled_free(&whole);
    pulled_free(&half);
    return status;
}

static pliant_status write_result_row(const pulled_run *run, const pliant_sweep *sweep, double *seconds, double drift,
                                      time_error time, report_row *row)
{
    const pliant_model *model = run->model;
    const pliant_data *data = run->data;
    static const char *const laws[] = {
#define LAW_NAME(name, yaml) #yaml,
        PLIANT_LAW_LIST(LAW_NAME)
#undef LAW_NAME
    };
    pliant_dynamics dynamics;
    pliant_status status = pliant_data_get_dynamics(model, data, &dynamics);
    if (status < 0) return status;
    int32_t frames = frames_of(sweep);
    report_sort(seconds, frames);
    double frame = report_quantile(seconds, frames, 0.5);
    row_text(row, "ok");
    row_text(row, "");
    row_integer(row, model->body->fine.num_tets);
    row_integer(row, model->body->fine.num_nodes);
    row_text(row, laws[model->scene.tled.law]);
    row_text(row, pliant_data_get_backend(data));
    row_integer(row, pliant_threads_or_cores(model->scene.solver.threads));
    row_number(row, 1e6 * dynamics.edge_bound);
    row_number(row, 1e6 * dynamics.eigenvalue_bound);
    row_number(row, 1e6 * dynamics.time_step);
    row_integer(row, dynamics.substeps);
    row_integer(row, frames);
    row_number(row, 1e3 * frame);
    row_number(row, 1e3 * report_quantile(seconds, frames, 0.99));
    row_number(row, 1e3 * frame / dynamics.substeps);
    row_number(row, model->body->fine.num_tets * (double)dynamics.substeps / frame);
    row_number(row, 100 * drift);
    row_number(row, 1e3 * time.error);
    row_number(row, 100 * time.error / time.largest);
    return PLIANT_OK;
}

pliant_status pliant_dynamics_run(const pliant_report_input *input, const pliant_sweep *sweep,
                                  pliant_report_tables *tables, pliant_progress progress)
{
    report_row row;
    char setup[9];
    double drift = NAN, *seconds = NULL;
    pliant_scene scene = *input->scene;
    pulled_run run = {0};
    time_error time;
    if (scene.solver.kind != PLIANT_TLED)
        return pliant_fail(PLIANT_ERROR_SCENE, "figures of explicit dynamics need solver/kind tled, not corotational");
    if (sweep->num_points < 1)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "figures of explicit dynamics need a point to pull at");
    pliant_report_setup(input, sweep, setup);
    row_clear(&row);
    row_text(&row, setup);
    if (row_is_stored(&row, tables->dynamics)) return PLIANT_OK;
    scene.tled.quasi_static = false;
    pliant_status status = pulled_create(input, &scene, sweep, progress, &run);
    if (status >= 0 && !(seconds = pliant_calloc((size_t)frames_of(sweep), sizeof *seconds)))
        status = pliant_fail_memory("the times of the frames");
    for (int32_t f = 0; status >= 0 && f < frames_of(sweep); f++)
        status = pulled_frame(&run, sweep, f, seconds + f, progress);
    if (status >= 0) status = measure_drift(input, sweep, &drift, progress);
    if (status >= 0) status = measure_time_error(input, &scene, sweep, &time, progress);
    if (status >= 0) status = write_result_row(&run, sweep, seconds, drift, time, &row);
    /* the failure is a result, too */
    if (status < 0 && status != PLIANT_ERROR_CANCELLED && status != PLIANT_ERROR_MEMORY) {
        row_text(&row, pliant_status_text(status));
        row_text(&row, pliant_last_error());
        status = PLIANT_OK;
    }
    if (status >= 0) status = row_add(&row, tables->dynamics);
    pliant_free(seconds);
    pulled_free(&run);
    return status;
}
