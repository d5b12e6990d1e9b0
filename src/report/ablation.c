/* Measure that unused features cost nothing: time and memory with all features, without each one, and without all. */
#include "base/fail.h"
#include "base/clock.h"
#include "base/threads.h"
#include "fem/element/scalar.h"
#include "model_data/data.h"
#include "base/memory.h"
#include "report/cases.h"
#include "report/rows.h"

#include <stdio.h>
#include <string.h>

#define PARTS(X) X(gravity) X(tools) X(warp) X(slices) X(scalar) X(refresh)
enum {
#define PART_BIT(name) BIT_##name,
    PARTS(PART_BIT) NUM_PARTS
#undef PART_BIT
};
static const char *const part_names[] = {
#define PART_NAME(name) #name,
    PARTS(PART_NAME)
#undef PART_NAME
};
/* Repetitions over all configurations. Every repetition of a step does the same work, so the minimum time is reported,
 * which excludes most disturbances. */
enum { STEPS = 30, ROUNDS = 3, EVERYTHING = (1 << NUM_PARTS) - 1 };

typedef struct stage_times {
    double stages[PLIANT_NUM_STEP_STAGES][STEPS], step[STEPS], slices[STEPS], scalar[STEPS], frame[STEPS];
    size_t bytes;
    const char *backend;
} stage_times;

static void keep_quickest(const double *other, double *times, int count)
{
    for (int i = 0; i < count; i++)
        if (other[i] < times[i]) times[i] = other[i];
}

static bool has(int parts, int bit) { return parts >> bit & 1; }

static pliant_status take_slices(const pliant_volume *volume, const double at[3])
{
    for (int axis = 0; axis < 3; axis++) {
        int32_t size[2];
        double spacing[2];
        float *values;
        pliant_status status = pliant_volume_plane(volume, axis, at, size, spacing, &values);
        if (status < 0) return status;
        pliant_free(values);
    }
    return PLIANT_OK;
}

/* Pull forward and back, so that every step has something to solve. */
static pliant_status pull(pliant_data *data, const pliant_sweep *sweep, const double from[3], int step)
{
    double part = step < STEPS / 2 ? 2.0 * (step + 1) / STEPS : 2.0 - 2.0 * (step + 1) / STEPS, tip[3];
    for (int d = 0; d < 3; d++) tip[d] = from[d] + part * sweep->pull[d];
    return pliant_tool_set_pose(data, 0, tip, NULL);
}

static pliant_status one_step(const pliant_model *model, pliant_data *data, int parts, const double at[3],
                              float *scalar, int step, stage_times *times)
{
    double start = pliant_seconds();
    pliant_status status = pliant_step(model, data);
    times->step[step] = pliant_seconds() - start;
    for (int s = 0; s < PLIANT_NUM_STEP_STAGES; s++) times->stages[s][step] = data->statistics.seconds[s];
    start = pliant_seconds();
    if (status >= 0 && has(parts, BIT_slices) && data->warp) status = take_slices(pliant_warp_volume(data->warp), at);
    times->slices[step] = pliant_seconds() - start;
    start = pliant_seconds();
    if (status >= 0 && has(parts, BIT_scalar))
        status = pliant_data_scalar(model, data->body, data->positions, PLIANT_SCALAR_VON_MISES, scalar);
    times->scalar[step] = pliant_seconds() - start;
    times->frame[step] = times->step[step] + times->slices[step] + times->scalar[step];
    return status;
}

static pliant_status run_parts(pliant_model *model, const pliant_sweep *sweep, const pliant_geometry *target, int parts,
                               stage_times *times)
{
    static const double down[3] = {0, 9.80665, 0}; /* patient lying on the back */
    double from[3], at[3];
    int tool, interval = model->scene.solver.refresh_interval;
    float *scalar = NULL;
    pliant_data *data = NULL;
    size_t before = pliant_memory_in_use();
    if (!has(parts, BIT_refresh)) model->scene.solver.refresh_interval = 0;
    pliant_status status = pliant_data_create(model, &data);
    model->scene.solver.refresh_interval = interval;
    if (status >= 0 && has(parts, BIT_warp)) status = pliant_data_set_warp(model, data, target);
    if (status >= 0 && has(parts, BIT_gravity)) status = pliant_data_set_gravity(data, down);
    if (status >= 0 && has(parts, BIT_scalar)) {
        scalar = pliant_calloc((size_t)model->body->fine.num_nodes, sizeof *scalar);
        if (!scalar) status = pliant_fail_memory("a number per node");
    }
    memcpy(at, sweep->points[0].rest, sizeof at);
    if (status >= 0 && has(parts, BIT_tools)) {
        status = pliant_tool_add(model, data, "report", &tool);
        if (status >= 0) status = pliant_tool_set_pose(data, tool, at, NULL);
        if (status >= 0) status = pliant_tool_grasp(model, data, tool, at);
        if (status >= 0) memcpy(from, data->tools[tool].tip, sizeof from);
    }
    for (int step = 0; status >= 0 && step < STEPS; step++) {
        if (has(parts, BIT_tools)) status = pull(data, sweep, from, step);
        if (status >= 0) status = one_step(model, data, parts, at, scalar, step, times);
    }
    if (status >= 0) times->bytes = report_data_bytes(data, before);
    if (status >= 0) times->backend = pliant_data_get_backend(data);
    pliant_free(scalar);
    pliant_data_free(data);
    return status;
}

static double median(double values[STEPS])
{
    report_sort(values, STEPS);
    return 1e3 * report_quantile(values, STEPS, 0.5);
}

/* @param whole Nullable: median frame time [ms] and memory [MB] with all features */
static void write_result_row(stage_times *times, const pliant_scene *scene, const double whole[2], double own[2],
                             report_row *row)
{
    row_text(row, "ok");
    row_text(row, "");
    row_integer(row, STEPS);
    row_text(row, times->backend);
    row_integer(row, pliant_threads_or_cores(scene->solver.threads));
    row_number(row, median(times->step));
    row_number(row, 1e3 * report_quantile(times->step, STEPS, 0.99));
    for (int s = 0; s < PLIANT_NUM_STEP_STAGES; s++) row_number(row, median(times->stages[s]));
    row_number(row, median(times->slices));
    row_number(row, median(times->scalar));
    own[0] = median(times->frame);
    own[1] = 1e-6 * (double)times->bytes;
    row_number(row, own[0]);
    row_number(row, own[1]);
    if (whole) {
        row_number(row, whole[0] - own[0]);
        row_number(row, whole[1] - own[1]);
    }
}

/* all features; without each one; without all */
enum { NUM_CONFIGURATIONS = NUM_PARTS + 2 };

static const char *configuration_name(int n)
{
    return n == 0 ? "nothing" : n > NUM_PARTS ? "everything" : part_names[n - 1];
}

static int configuration_parts(int n) { return n == 0 ? EVERYTHING : n > NUM_PARTS ? 0 : EVERYTHING & ~(1 << (n - 1)); }

static void key(const char *setup, int n, report_row *row)
{
    row_clear(row);
    row_text(row, setup);
    row_text(row, configuration_name(n));
}

static pliant_status measure(pliant_model *model, const pliant_sweep *sweep, stage_times best[NUM_CONFIGURATIONS],
                             pliant_progress progress)
{
    pliant_geometry target;
    stage_times *times = pliant_calloc(1, sizeof *times);
    if (!times) return pliant_fail_memory("the times of the stages");
    pliant_status status = report_target(model, &target);
    for (int run = 0; status >= 0 && run < ROUNDS * NUM_CONFIGURATIONS; run++) {
        int n = run % NUM_CONFIGURATIONS;
        char activity[64];
        snprintf(activity, sizeof activity, "runs with parts left out, round %d of %d", run / NUM_CONFIGURATIONS + 1,
                 ROUNDS);
        if (!pliant_report_progress(progress, (double)run / (ROUNDS * NUM_CONFIGURATIONS), activity))
            status = pliant_fail(PLIANT_ERROR_CANCELLED, "the report was stopped; finished rows are kept");
        if (status >= 0) status = run_parts(model, sweep, &target, configuration_parts(n), times);
        if (status >= 0 && run < NUM_CONFIGURATIONS) best[n] = *times;
        else if (status >= 0) {
            for (int s = 0; s < PLIANT_NUM_STEP_STAGES; s++) keep_quickest(times->stages[s], best[n].stages[s], STEPS);
            keep_quickest(times->step, best[n].step, STEPS);
            keep_quickest(times->slices, best[n].slices, STEPS);
            keep_quickest(times->scalar, best[n].scalar, STEPS);
            keep_quickest(times->frame, best[n].frame, STEPS);
        }
    }
    pliant_free(times);
    return status;
}

pliant_status pliant_ablation_run(const pliant_report_input *input, const pliant_sweep *sweep,
                                  pliant_report_tables *tables, pliant_progress progress)
{
    report_row row;
    char setup[9];
    bool missing = false;
    double whole[2], own[2];
    pliant_model *model = NULL;
    if (sweep->num_points < 1) return pliant_fail(PLIANT_ERROR_ARGUMENT, "--ablation needs a point to pull at");
    pliant_report_setup(input, sweep, setup);
    for (int n = 0; n < NUM_CONFIGURATIONS; n++) {
        key(setup, n, &row);
        missing = missing || !row_is_stored(&row, tables->stages);
    }
    if (!missing) return PLIANT_OK;
    stage_times *best = pliant_calloc(NUM_CONFIGURATIONS, sizeof *best);
    pliant_status status = best ? PLIANT_OK : pliant_fail_memory("the times of the stages");
    if (status >= 0)
        status = pliant_model_build(input->scene, input->scan, input->labels, input->materials, progress, &model);
    if (status >= 0) status = measure(model, sweep, best, progress);
    for (int n = 0; status >= 0 && n < NUM_CONFIGURATIONS; n++) {
        key(setup, n, &row);
        bool known = row_is_stored(&row, tables->stages);
        write_result_row(best + n, &model->scene, n ? whole : NULL, n ? own : whole, &row);
        if (!known) status = row_add(&row, tables->stages);
    }
    pliant_model_free(model);
    pliant_free(best);
    return status;
}
