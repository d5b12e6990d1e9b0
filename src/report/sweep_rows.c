/* Convert runs to table rows. */
#include "base/fail.h"
#include "base/threads.h"
#include "fem/system.h"
#include "base/memory.h"
#include "report/sweep.h"

#include <math.h>
#include <string.h>

static const double mm = 1e3, ms = 1e3, mb = 1e-6, percent = 100;

/* Maximum over the frames, and the last frame. */
typedef struct worst_frames {
    pliant_error worst, last;
    double own_max, own_rms, own_p95; /* relative to the frame's maximum displacement, maximum over the frames */
} worst_frames;

static double ratio_of(double part, double whole) { return whole > 0 ? part / whole : NAN; }

static pliant_status compare_frame(const sweep_result *result, const sweep_reference *reference, const uint8_t *use,
                                   int32_t frame, pliant_error *out)
{
    size_t at = 3 * (size_t)frame * (size_t)result->run->points;
    return pliant_error_between(result->run->points, use, result->ground->rest, reference->run.positions + at,
                                result->run->positions + at, out);
}

static pliant_status compare_frames(const sweep_result *result, const sweep_reference *reference, const uint8_t *use,
                                    worst_frames *out)
{
    memset(out, 0, sizeof *out);
    for (int32_t f = 0; f < result->run->frames; f++) {
        pliant_error *last = &out->last, *worst = &out->worst;
        pliant_status status = compare_frame(result, reference, use, f, last);
        if (status < 0) return status;
        worst->max = fmax(worst->max, last->max);
        worst->rms = fmax(worst->rms, last->rms);
        worst->p95 = fmax(worst->p95, last->p95);
        worst->largest = fmax(worst->largest, last->largest);
        out->own_max = fmax(out->own_max, ratio_of(last->max, last->largest));
        out->own_rms = fmax(out->own_rms, ratio_of(last->rms, last->largest));
        out->own_p95 = fmax(out->own_p95, ratio_of(last->p95, last->largest));
    }
    return PLIANT_OK;
}

static pliant_status write_frame_rows(const sweep_result *result, const sweep_reference *reference, report_row *key)
{
    const report_run *run = result->run;
    for (int32_t f = 0; f < run->frames; f++) {
        pliant_error error;
        pliant_status status = compare_frame(result, reference, result->points->found, f, &error);
        if (status < 0) return status;
        row_integer(key, f + 1);
        bool known = row_is_stored(key, result->ground->tables->frames);
        row_integer(key, run->iterations[f]);
        row_number(key, run->residual[f]);
        row_number(key, mm * error.largest);
        row_number(key, mm * error.max);
        row_number(key, mm * error.rms);
        row_number(key, mm * error.p95);
        row_number(key, percent * ratio_of(error.max, error.largest));
        for (int s = 0; s < PLIANT_NUM_STEP_STAGES; s++) row_number(key, ms * run->seconds[s * run->frames + f]);
        if (!known) status = row_add(key, result->ground->tables->frames);
        row_truncate(key, RUN_KEYS);
        if (status < 0) return status;
    }
    return PLIANT_OK;
}

static void median_and_p99(double *values, int32_t count, report_row *row)
{
    report_sort(values, count);
    row_number(row, ms * report_quantile(values, count, 0.5));
    row_number(row, ms * report_quantile(values, count, 0.99));
}

/* Append the frame times without and with the deformed volume, then the time of every stage. */
static pliant_status add_times(const report_run *run, report_row *row)
{
    int32_t frames = run->frames;
    double *values = pliant_calloc((size_t)frames, sizeof *values);
    if (!values) return pliant_fail_memory("the times of the frames");
    for (int part = -2; part < PLIANT_NUM_STEP_STAGES; part++) {
        for (int32_t f = 0; f < frames; f++) {
            values[f] = 0;
            for (int s = 0; s < PLIANT_NUM_STEP_STAGES; s++)
                if (s == part || part == -1 || (part == -2 && s != PLIANT_STEP_warp))
                    values[f] += run->seconds[s * frames + f];
        }
        median_and_p99(values, frames, row);
    }
    pliant_free(values);
    return PLIANT_OK;
}

static void add_run(const report_run *run, report_row *row)
{
    double iterations = 0, residual = 0, force = 0;
    for (int32_t f = 0; f < run->frames; f++) {
        iterations += (double)run->iterations[f] / run->frames;
        residual = fmax(residual, run->residual[f]);
    }
    for (int d = 0; d < 3; d++) force += run->force[d] * run->force[d];
    row_number(row, iterations);
    row_number(row, residual);
    row_integer(row, (int64_t)run->statistics.not_converged);
    row_integer(row, (int64_t)run->statistics.rejected);
    row_integer(row, (int64_t)run->statistics.factors);
    row_number(row, sqrt(force));
}

static void add_errors(const worst_frames *frames, report_row *row)
{
    const pliant_error *worst = &frames->worst;
    row_integer(row, frames->last.count);
    row_number(row, mm * worst->largest);
    row_number(row, mm * worst->max);
    row_number(row, mm * worst->rms);
    row_number(row, mm * worst->p95);
    row_number(row, percent * ratio_of(worst->max, worst->largest));
    row_number(row, percent * ratio_of(worst->rms, worst->largest));
    row_number(row, percent * ratio_of(worst->p95, worst->largest));
}

static pliant_status add_refined(const sweep_result *result, report_row *row)
{
    const sweep_ground *ground = result->ground;
    const sweep_reference *refined = ground->refined + result->index;
    if (!refined->there) {
        row_empty(row, 9);
        return PLIANT_OK;
    }
    uint8_t *use = pliant_calloc((size_t)ground->count, 1);
    if (!use) return pliant_fail_memory("the points that two meshes share");
    for (int32_t p = 0; p < ground->count; p++) use[p] = ground->refined_points.found[p] && result->points->found[p];
    worst_frames frames;
    pliant_status status = compare_frames(result, refined, use, &frames);
    pliant_free(use);
    row_integer(row, ground->refined_tets);
    add_errors(&frames, row);
    return status;
}

static double sum_build_bytes(const pliant_model *model, double *seconds)
{
    double bytes = 0;
    *seconds = 0;
    for (int s = 0; s < PLIANT_NUM_BUILD_STAGES; s++) {
        bytes += (double)model->build_bytes[s];
        *seconds += model->build_seconds[s];
    }
    return bytes;
}

pliant_status sweep_write_rows(const sweep_result *result, report_row *row)
{
    const sweep_ground *ground = result->ground;
    const sweep_reference *same = ground->same + result->index;
    const report_run *run = result->run;
    worst_frames frames;
    pliant_error voxels = {.worst = -1};
    pliant_status status = compare_frames(result, same, result->points->found, &frames);
    if (status >= 0) status = write_frame_rows(result, same, row);
    if (status >= 0 && result->voxels) status = sweep_write_voxel_rows(result, row, &voxels);
    if (status < 0) return status;
    double seconds, held = sum_build_bytes(result->model, &seconds);
    row_text(row, run->statistics.not_converged > 0 ? "not converged" : "ok");
    row_text(row, "");
    row_integer(row, run->frames);
    row_integer(row, result->model->body->fine.num_tets);
    row_integer(row, result->model->system->mesh->num_tets);
    row_text(row, pliant_data_get_backend(run->data));
    row_integer(row, pliant_threads_or_cores(ground->scene.solver.threads));
    row_number(row, seconds);
    row_number(row, mb * held);
    row_number(row, mb * (double)run->bytes);
    status = add_times(run, row);
    if (status < 0) return status;
    add_run(run, row);
    add_errors(&frames, row);
    row_number(row, percent * frames.own_max);
    row_number(row, percent * frames.own_rms);
    row_number(row, percent * frames.own_p95);
    row_number(row, mm * frames.last.max);
    row_number(row, mm * frames.last.rms);
    row_number(row, mm * frames.last.p95);
    status = add_refined(result, row);
    if (status < 0) return status;
    if (voxels.count > 0) {
        row_integer(row, voxels.count);
        row_number(row, mm * voxels.max);
        row_number(row, mm * voxels.rms);
        row_number(row, mm * voxels.p95);
    }
    return row_add(row, ground->tables->sweep);
}

pliant_status sweep_write_build_row(const pliant_model *model, const char *message, size_t peak, report_row *row,
                                    pliant_results *builds)
{
    if (row_is_stored(row, builds)) return PLIANT_OK;
    row_text(row, message ? "refused" : "ok");
    row_text(row, message ? message : "");
    if (!message) {
        double seconds, held = sum_build_bytes(model, &seconds);
        row_integer(row, model->body->fine.num_tets);
        row_integer(row, model->body->fine.num_nodes);
        row_integer(row, model->body->coarse.num_tets);
        row_integer(row, model->body->num_held_pieces);
        row_number(row, model->condition_estimate);
        row_integer(row, pliant_threads_or_cores(model->scene.solver.threads));
        row_number(row, seconds);
        row_number(row, mb * held);
        row_number(row, mb * (double)peak);
        for (int s = 0; s < PLIANT_NUM_BUILD_STAGES; s++) {
            row_number(row, model->build_seconds[s]);
            row_number(row, mb * (double)model->build_bytes[s]);
        }
    }
    pliant_status status = row_add(row, builds);
    row_truncate(row, MODEL_KEYS);
    return status;
}
