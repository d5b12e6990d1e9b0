#define _POSIX_C_SOURCE 200809L
#include "report/cases.h"

#include "base/clock.h"
#include "base/fail.h"
#include "fem/quasistatic/solver.h"
#include "sim/api/data.h"
#include "model_data/data.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>
#include <time.h>

enum { MAX_ITERATIONS = 100, SETTLING_STEPS = 60, SETTLING_ITERATIONS = 20, MAX_RELAXATION = 20000 };
static const double standard_gravity = 9.80665;
static const double relaxation_tolerance = 1e-4; /* elements in single precision have a residual of one third of it */

const char *report_case_name(report_case_kind kind)
{
    static const char *const names[] = {
#define CASE_NAME(name) #name,
        REPORT_CASE_LIST(CASE_NAME)
#undef CASE_NAME
    };
    return names[kind];
}

size_t report_data_bytes(const pliant_data *data, size_t before)
{
    size_t now = pliant_memory_in_use();
    return (now > before ? now - before : 0) + pliant_data_get_factor_bytes(data);
}

pliant_status report_target(const pliant_model *model, pliant_geometry *out)
{
    const pliant_mesh *mesh = &model->body->fine;
    return pliant_warp_target(&model->scan->geometry, mesh->rest, mesh->num_nodes, model->scene.warp.margin, SIZE_MAX,
                              out);
}

static pliant_status set_limits(pliant_data *data, report_limits limits)
{
    int maximum = data->solver ? MAX_ITERATIONS : MAX_RELAXATION;
    return pliant_data_set_limits(data, limits.iterations > 0 ? limits.iterations : maximum, limits.tolerance);
}

/* part: 0 at the start, 1 at the end */
static pliant_status load_frame(const report_case *load, pliant_data *data, const double from[3], double part)
{
    if (load->kind == CASE_sag) return PLIANT_OK; /* the scene's gravity already acts */
    if (load->kind == CASE_gravity) {
        double angle = part * 3.14159265358979323846;
        double gravity[3] = {0, standard_gravity * cos(angle), standard_gravity * sin(angle)};
        return pliant_data_set_gravity(data, gravity);
    }
    static const pliant_drive drives[] = {[CASE_displacement] = PLIANT_DRIVE_RIGID,
                                          [CASE_force] = PLIANT_DRIVE_FORCE,
                                          [CASE_grasp] = PLIANT_DRIVE_SPRING};
    double tip[3], force[3];
    for (int d = 0; d < 3; d++) {
        tip[d] = from[d] + part * load->pull[d];
        force[d] = part * load->force[d];
    }
    pliant_status status = pliant_tool_set_drive(data, 0, drives[load->kind], force);
    return status < 0 ? status : pliant_tool_set_pose(data, 0, tip, NULL);
}

/* Step until a step ends below the tolerance, with a factor at most one step old: nearly Newton's method. */
static pliant_status settle(const pliant_model *model, pliant_data *data, double tolerance, pliant_progress progress)
{
    pliant_solver *solver = data->solver;
    if (!solver) { /* tled, with dynamic relaxation */
        pliant_status relaxed = pliant_data_set_limits(data, MAX_RELAXATION, fmax(tolerance, relaxation_tolerance));
        return relaxed < 0 ? relaxed : pliant_step(model, data);
    }
    int32_t interval = solver->refresh_interval, delay = solver->refresh_delay;
    pliant_status status = pliant_data_set_limits(data, SETTLING_ITERATIONS, tolerance);
    solver->refresh_interval = solver->refresh_delay = 1;
    for (int s = 0; status >= 0 && s < SETTLING_STEPS; s++) {
        status = pliant_step(model, data);
        if (status == PLIANT_OK) break;
        if (!pliant_report_progress(progress, (double)s / SETTLING_STEPS, "settling"))
            status = pliant_fail(PLIANT_ERROR_CANCELLED, "the run was stopped");
    }
    solver->refresh_interval = interval;
    solver->refresh_delay = delay;
    return status;
}

/* Wait for the patch, which is computed in the background while the tool does not move. */
static pliant_status await_patch(const pliant_model *model, pliant_progress progress, pliant_data *data)
{
    pliant_status status = model->fine_system ? pliant_step(model, data) : PLIANT_OK;
    while (status >= 0 && data->statistics.patch_waiting > 0) {
        if (!pliant_report_progress(progress, 0, "a patch"))
            return pliant_fail(PLIANT_ERROR_CANCELLED, "the run was stopped");
        status = pliant_step(model, data);
    }
    return status;
}

/* Create the initial state of the frames: equilibrium under gravity, with a tool's grasp. */
static pliant_status begin(const pliant_model *model, const report_case *load, report_limits limits, pliant_data *data,
                           double from[3])
{
    pliant_status status = load->kind == CASE_gravity ? load_frame(load, data, from, 0) : PLIANT_OK;
    const double *gravity = data->gravity;
    if (load->kind == CASE_sag) return set_limits(data, limits);
    if (status >= 0 && (gravity[0] != 0 || gravity[1] != 0 || gravity[2] != 0))
        status = settle(model, data, fmin(limits.tolerance, 1e-5), limits.progress);
    if (status >= 0 && report_case_pulls(load->kind)) {
        int tool;
        status = pliant_tool_add(model, data, "report", &tool);
        if (status >= 0) status = pliant_tool_set_pose(data, tool, load->rest, NULL);
        if (status >= 0) status = pliant_tool_grasp(model, data, tool, load->rest);
        if (status >= 0) memcpy(from, data->tools[tool].tip, 3 * sizeof *from);
        if (status >= 0 && !limits.before_patch) status = await_patch(model, limits.progress, data);
    }
    return status < 0 ? status : set_limits(data, limits);
}

/* Compute one frame: one step, or as many steps as it needs to converge. */
static pliant_status step_frame(const pliant_model *model, pliant_data *data, report_limits limits)
{
    pliant_status status = pliant_step(model, data);
    if (!limits.iterates_to_tolerance || status != PLIANT_NOT_CONVERGED) return status;
    status = settle(model, data, limits.tolerance, limits.progress);
    return status < 0 ? status : set_limits(data, limits);
}

static void sleep_until(double end)
{
    double left = end - pliant_seconds();
    if (!(left > 0)) return;
    struct timespec time = {.tv_sec = (time_t)left, .tv_nsec = (long)(1e9 * (left - floor(left)))};
    nanosleep(&time, NULL);
}

/* Return the CPU time of this thread [s]. */
static double thread_seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static pliant_status run_create(int32_t frames, int32_t points, report_run *run)
{
    run->frames = frames;
    run->points = points;
    run->positions = pliant_calloc((size_t)frames * (size_t)points, 3 * sizeof *run->positions);
    run->seconds = pliant_calloc((size_t)frames * PLIANT_NUM_STEP_STAGES, sizeof *run->seconds);
    run->residual = pliant_calloc((size_t)frames, sizeof *run->residual);
    run->iterations = pliant_calloc((size_t)frames, sizeof *run->iterations);
    return run->positions && run->seconds && run->residual && run->iterations
               ? PLIANT_OK
               : pliant_fail_memory("the frames of a run");
}

pliant_status report_case_run(const pliant_model *model, const report_case *load, report_limits limits,
                              const pliant_points *points, const pliant_geometry *target, report_run *out)
{
    report_run run = {0};
    double from[3] = {0, 0, 0}, clocked = 0;
    pliant_status status = run_create(load->frames, points->count, &run);
    size_t before = pliant_memory_in_use();
    if (status >= 0) status = pliant_data_create(model, &run.data);
    if (status >= 0 && target) status = pliant_data_set_warp(model, run.data, target);
    if (status >= 0) status = begin(model, load, limits, run.data, from);
    double start = pliant_seconds();
    for (int32_t f = 0; status >= 0 && f < load->frames;
         f++, start = fmax(start + limits.period, pliant_seconds() - limits.period)) {
        sleep_until(start);
        if (!pliant_report_progress(limits.progress, (double)f / load->frames, report_case_name(load->kind))) {
            status = pliant_fail(PLIANT_ERROR_CANCELLED, "the run was stopped");
            break;
        }
        status = load_frame(load, run.data, from, (f + 1.0) / load->frames);
        double clock = pliant_seconds(), ran = thread_seconds();
        if (status >= 0) status = step_frame(model, run.data, limits);
        if (status < 0) break;
        clock = pliant_seconds() - clock;
        ran = thread_seconds() - ran;
        clocked += clock;
        run.cpu_time_fraction += ran;
        double fraction =
            limits.uses_thread_time && clock > ran && strcmp(pliant_data_get_backend(run.data), "cpu") == 0
                ? ran / clock
                : 1;
        const pliant_statistics *statistics = &run.data->statistics;
        for (int s = 0; s < PLIANT_NUM_STEP_STAGES; s++)
            run.seconds[s * load->frames + f] = fraction * statistics->seconds[s];
        run.residual[f] = statistics->residual;
        run.iterations[f] = statistics->iterations;
        pliant_points_move(points, run.data->positions, run.positions + 3 * (size_t)f * (size_t)points->count);
    }
    if (status < 0) {
        report_run_free(&run);
        return status;
    }
    run.statistics = run.data->statistics;
    run.cpu_time_fraction /= clocked;
    if (report_case_pulls(load->kind)) {
        memcpy(run.force, run.data->tools[0].force, sizeof run.force);
        memcpy(run.held_point, run.data->tools[0].held_point, sizeof run.held_point);
    }
    run.bytes = report_data_bytes(run.data, before);
    *out = run;
    return PLIANT_OK;
}

void report_run_free(report_run *run)
{
    if (!run) return;
    pliant_data_free(run->data);
    pliant_free(run->positions);
    pliant_free(run->seconds);
    pliant_free(run->residual);
    pliant_free(run->iterations);
    memset(run, 0, sizeof *run);
}
