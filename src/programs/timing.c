#define _POSIX_C_SOURCE 200809L
#include "timing.h"

#include "base/fail.h"
#include "base/memory.h"
#include "sim/api/data.h"
#include "sim/build/model.h"
#include "warp/warp.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

enum { CULL = PLIANT_NUM_STEP_STAGES, RASTERIZE, WHOLE, COLUMNS };

static pliant_status open_table(const char *folder, const char *name, FILE **out)
{
    char path[4096];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    *out = fopen(path, "w");
    return *out ? PLIANT_OK : pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
}

static pliant_status close_table(FILE *file, const char *name)
{
    int failed = ferror(file) | fclose(file);
    return failed ? pliant_fail(PLIANT_ERROR_FILE, "%s could not be written completely: %s", name, strerror(errno))
                  : PLIANT_OK;
}

pliant_status timing_start(const char *folder, step_times *out)
{
    step_times times = {0};
    pliant_status status = open_table(folder, "steps.csv", &times.steps);
    if (status >= 0) status = open_table(folder, "tools.csv", &times.tools);
    if (status < 0) {
        if (times.steps) fclose(times.steps);
        return status;
    }
    fputs("step,status,iterations,residual,residual_force_n", times.steps);
    for (int stage = 0; stage < PLIANT_NUM_STEP_STAGES; ++stage)
        fprintf(times.steps, ",%s_s", pliant_step_stage_name(stage));
    fputs(",cull_s,rasterize_s,step_s,inverted,legs,advanced,proxy_error_m,ended\n", times.steps);
    fputs("step,tool,force_x_n,force_y_n,force_z_n,held_x_m,held_y_m,held_z_m,contact_x_n,contact_y_n,contact_z_n,"
          "contact_torque_x_nm,contact_torque_y_nm,contact_torque_z_nm,contact_force_error_n\n",
          times.tools);
    *out = times;
    return PLIANT_OK;
}

static bool reserve_capacity(step_times *times)
{
    if (times->num_steps < times->capacity) return true;
    size_t capacity = times->capacity ? 2 * times->capacity : 256;
    double *larger = realloc(times->seconds, capacity * COLUMNS * sizeof *larger);
    if (!larger) return false;
    times->seconds = larger;
    times->capacity = capacity;
    return true;
}

/* Keep the largest contact force of a tool, with its error. */
static void note_contact(step_times *times, int tool, const pliant_tool_state *state)
{
    const double *f = state->contact_force, size = sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
    contact_peak *peak = times->contact + tool;
    if (size > peak->force)
        *peak = (contact_peak){.force = size, .error = state->contact_force_error, .step = times->num_steps};
}

pliant_status timing_add(step_times *times, const pliant_data *data, pliant_status status, double seconds)
{
    const pliant_statistics *statistics = pliant_data_get_statistics(data);
    const int32_t inverted = pliant_data_get_inverted(data);
    if (!reserve_capacity(times)) return pliant_fail_memory("the times of the steps");
    double *row = times->seconds + COLUMNS * times->num_steps++;
    memcpy(row, statistics->seconds, sizeof statistics->seconds);
    row[CULL] = row[RASTERIZE] = 0.0;
    const pliant_warp *warp = pliant_data_get_warp(data);
    if (warp) pliant_warp_seconds(warp, &row[CULL], &row[RASTERIZE]);
    row[WHOLE] = seconds;
    times->iterations += (uint64_t)statistics->iterations;
    times->last_converged = status != PLIANT_NOT_CONVERGED;
    if (status == PLIANT_NOT_CONVERGED && statistics->error > times->worst_error)
        times->worst_error = statistics->error;
    times->inverted_steps += inverted > 0;
    if (inverted > times->max_inverted) times->max_inverted = inverted;

    fprintf(times->steps, "%zu,%d,%d,%.6g,%.6g", times->num_steps, (int)status, (int)statistics->iterations,
            statistics->residual, statistics->residual_force);
    for (int column = 0; column < COLUMNS; ++column) fprintf(times->steps, ",%.6g", row[column]);
    fprintf(times->steps, ",%d,%d,%g,%g,%d\n", (int)inverted, (int)statistics->legs, statistics->advanced,
            statistics->proxy_error, (int)statistics->ended);
    for (int n = 0; n < pliant_data_get_num_tools(data); ++n) {
        pliant_tool_state tool;
        if (pliant_tool_get(data, n, &tool) < 0) continue;
        const double *contact = tool.contact_force, *torque = tool.contact_torque;
        if (!tool.holding && !tool.cutting && contact[0] == 0 && contact[1] == 0 && contact[2] == 0) continue;
        note_contact(times, n, &tool);
        const double *at = tool.holding ? tool.held_point : tool.tip;
        fprintf(times->tools, "%zu,%s,%.6g,%.6g,%.6g,%.7g,%.7g,%.7g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.4g\n",
                times->num_steps, tool.name, tool.force[0], tool.force[1], tool.force[2], at[0], at[1], at[2],
                contact[0], contact[1], contact[2], torque[0], torque[1], torque[2], tool.contact_force_error);
    }
    return PLIANT_OK;
}

static int compare(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Sort a column into a buffer and return the mean. */
static double sort_column(const step_times *times, int column, double *sorted)
{
    double sum = 0.0;
    for (size_t n = 0; n < times->num_steps; ++n) sum += sorted[n] = times->seconds[COLUMNS * n + (size_t)column];
    qsort(sorted, times->num_steps, sizeof *sorted, compare);
    return sum / (double)times->num_steps;
}

pliant_status timing_end(step_times *times)
{
    pliant_status steps = times->steps ? close_table(times->steps, "steps.csv") : PLIANT_OK;
    pliant_status tools = times->tools ? close_table(times->tools, "tools.csv") : PLIANT_OK;
    double median = 0.0, *sorted = times->num_steps ? malloc(times->num_steps * sizeof *sorted) : NULL;
    if (sorted) {
        sort_column(times, WHOLE, sorted);
        median = sorted[times->num_steps / 2];
    }
    free(sorted);
    free(times->seconds);
    memset(times, 0, sizeof *times);
    times->median = median;
    return steps < 0 ? steps : tools;
}

/* @param whole mean time of the whole step [s] */
static void print_row(FILE *file, const char *name, const step_times *times, int column, double whole, double *sorted)
{
    double mean = sort_column(times, column, sorted);
    fprintf(file, "%-12s %10.2f %10.2f %10.2f %8.0f\n", name, 1e3 * mean, 1e3 * sorted[times->num_steps / 2],
            1e3 * sorted[times->num_steps - 1], whole > 0.0 ? 100.0 * mean / whole : 0.0);
}

void timing_print(const step_times *times, const pliant_model *model, const pliant_data *data, FILE *file)
{
    const pliant_statistics *statistics = pliant_data_get_statistics(data);
    double *sorted = times->num_steps ? malloc(times->num_steps * sizeof *sorted) : NULL;
    if (!sorted) return;
    bool fit = pliant_model_get_scene(model)->warp.kind == PLIANT_FIT;
    double whole = sort_column(times, WHOLE, sorted);
    fprintf(file, "\n%-12s %10s %10s %10s %8s   [ms], %zu steps\n", "stage", "mean", "median", "worst", "share %",
            times->num_steps);
    for (int stage = 0; stage < PLIANT_NUM_STEP_STAGES; ++stage)
        print_row(file, pliant_step_stage_name(stage), times, stage, whole, sorted);
    if (pliant_data_get_warp(data)) {
        print_row(file, fit ? "  map" : "  cull", times, CULL, whole, sorted);
        print_row(file, fit ? "  voxels" : "  rasterize", times, RASTERIZE, whole, sorted);
    }
    print_row(file, "whole step", times, WHOLE, whole, sorted);
    free(sorted);
    fprintf(file, "iterations a step %.1f, last residual %.2g, not converged %llu, failed %llu, inverted now %d\n",
            (double)times->iterations / (double)times->num_steps, statistics->residual,
            (unsigned long long)statistics->not_converged, (unsigned long long)statistics->failed,
            (int)pliant_data_get_inverted(data));
    if (statistics->patched > 0)
        fprintf(file, "patch: %d tools, %d iterations, residual %.2g, moves nodes by up to %.3g mm\n",
                (int)statistics->patched, (int)statistics->patch_iterations, statistics->patch_residual,
                1e3 * statistics->patch_moved);
    for (int n = 0; n < pliant_data_get_num_tools(data); ++n) {
        const contact_peak *peak = times->contact + n;
        pliant_tool_state tool;
        if (peak->force > 0.0 && pliant_tool_get(data, n, &tool) == PLIANT_OK)
            fprintf(file, "tool %s: largest contact force %.3g N in step %zu, standard error %.2g N\n", tool.name,
                    peak->force, peak->step, peak->error);
    }
}

void timing_warn(const step_times *times, const pliant_model *model, const pliant_data *data)
{
    const pliant_statistics *statistics = pliant_data_get_statistics(data);
    const pliant_scene *scene = pliant_model_get_scene(model);
    bool schur = scene->model.method == PLIANT_SCHUR;
    if (statistics->not_converged > 0)
        pliant_log(PLIANT_LOG_WARNING,
                   "%llu of %zu steps did not converge%s: nodes may be up to %.2g mm off, "
                   "solver/tolerance is %.2g of the displacement; %s",
                   (unsigned long long)statistics->not_converged, times->num_steps,
                   times->last_converged ? " (the last one did)" : ", nor did the last one", 1e3 * times->worst_error,
                   scene->solver.tolerance,
                   schur ? "schur may be too soft for the load: use averaged"
                         : "increase solver/iterations or reduce solver/step");
    if (times->max_inverted > 0)
        pliant_log(
            PLIANT_LOG_WARNING,
            "elements were inverted in %zu of %zu steps, up to %d of %d at once, %d at the end. Do not rely on the "
            "result there; %s",
            times->inverted_steps, times->num_steps, (int)times->max_inverted,
            (int)pliant_data_get_body(data)->fine.num_tets, (int)pliant_data_get_inverted(data),
            schur ? "schur may be too soft for the load: use averaged"
                  : "the load may be too large, or needs more steps");
}

void timing_print_build(const pliant_model *model, FILE *file)
{
    pliant_build_statistics statistics;
    double seconds = 0.0, mebibytes = 0.0;
    pliant_model_get_statistics(model, &statistics);
    fprintf(file, "\n%-12s %10s %10s\n", "build", "[s]", "[MiB]");
    for (int stage = 0; stage < PLIANT_NUM_BUILD_STAGES; ++stage) {
        double held = (double)statistics.bytes[stage] / 1048576.0;
        fprintf(file, "%-12s %10.3f %10.1f\n", pliant_build_stage_name(stage), statistics.seconds[stage], held);
        seconds += statistics.seconds[stage];
        mebibytes += held;
    }
    fprintf(file, "%-12s %10.3f %10.1f\n", "all", seconds, mebibytes);
    const pliant_body *body = pliant_model_get_body(model);
    fprintf(file, "%d fine tetrahedra, %d nodes; %d coarse tetrahedra\n", (int)body->fine.num_tets,
            (int)body->fine.num_nodes, (int)body->coarse.num_tets);
}

void timing_print_memory(FILE *file)
{
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    fprintf(file, "peak memory: %.0f MiB by the library, %.0f MiB by the whole process\n",
            (double)pliant_memory_peak() / 1048576.0, (double)usage.ru_maxrss / 1024.0);
}

pliant_status timing_write_build(const char *folder, const pliant_model *model)
{
    FILE *file;
    pliant_build_statistics statistics;
    pliant_status status = open_table(folder, "build.csv", &file);
    if (status < 0) return status;
    pliant_model_get_statistics(model, &statistics);
    fputs("stage,seconds,bytes\n", file);
    for (int stage = 0; stage < PLIANT_NUM_BUILD_STAGES; ++stage)
        fprintf(file, "%s,%.6g,%zu\n", pliant_build_stage_name(stage), statistics.seconds[stage],
                statistics.bytes[stage]);
    return close_table(file, "build.csv");
}
