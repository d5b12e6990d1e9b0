/* Results of cuts, cuts without a tool, and undo. */
#include "base/fail.h"
#include "sim/api/data.h"
#include "tool/blade.h"
#include "base/memory.h"
#include "sim/step/cut.h"
#include "sim/step/accounting.h"

#include <math.h>
#include <string.h>

static pliant_status reserve_capacity(pliant_data *data, int32_t maximum)
{
    pliant_undo *undo = &data->undo;
    if (maximum == 0 || undo->body || (undo->body = pliant_calloc((size_t)maximum, sizeof *undo->body)))
        return PLIANT_OK;
    return pliant_fail_memory("the topologies for undoing cuts");
}

/* Keep a topology from before a stroke, or release it if there is already one for this stroke. */
static void keep(pliant_data *data, int32_t maximum, const pliant_body *body, int tool, uint64_t stroke)
{
    pliant_undo *undo = &data->undo;
    if (maximum == 0 || (undo->count > 0 && tool >= 0 && undo->tool == tool && undo->stroke == stroke)) {
        pliant_body_release(body);
        return;
    }
    if (undo->count == maximum) {
        if (!undo->reported)
            pliant_log(PLIANT_LOG_INFO, "only the last %d cuts can be undone; raise cut/undo for more", (int)maximum);
        undo->reported = true;
        pliant_body_release(undo->body[0]);
        memmove(undo->body, undo->body + 1, (size_t)--undo->count * sizeof *undo->body);
    }
    undo->body[undo->count++] = body;
    undo->tool = tool;
    undo->stroke = stroke;
}

static pliant_status sever(const pliant_model *model, pliant_data *data, int tool, const pliant_cut_sweep *sweep,
                           pliant_cut_report *report)
{
    pliant_body *next = NULL;
    pliant_status status = pliant_body_cut(data->body, data->last_revision + 1, data->positions, sweep, &next, report);
    if (status != PLIANT_OK || !next) return status;
    const int32_t maximum = model->scene.cut.undo;
    const pliant_body *before = pliant_body_retain(data->body);
    status = reserve_capacity(data, maximum);
    if (status == PLIANT_OK) status = pliant_data_set_body(model, data, next);
    if (status == PLIANT_OK) keep(data, maximum, before, tool, tool < 0 ? 0 : data->tools[tool].blade.stroke);
    else pliant_body_release(before);
    if (data->undo.count == 0) pliant_undo_clear(data);
    pliant_body_release(next);
    return status;
}

pliant_status pliant_data_cut_along_sweep(const pliant_model *model, pliant_data *data, int tool,
                                          const pliant_cut_sweep *sweep, pliant_cut_report *report)
{
    pliant_account *before = pliant_accounting_begin(data);
    const pliant_status status = sever(model, data, tool, sweep, report);
    pliant_accounting_end(data, before);
    return status;
}

/* ---- cuts without a tool */

/* Sample a polyline with at most `spacing` between points. Return the number of points.
 * @param out Nullable: (points x 3), each moved by `by` */
static int32_t sample_line(int32_t count, const double *points, double spacing, const double by[3], double *out)
{
    int32_t made = 0;
    for (int32_t p = 0; p < count; p++) {
        const double *from = points + 3 * (p > 0 ? p - 1 : 0), *to = points + 3 * p;
        double length = sqrt(pow(to[0] - from[0], 2) + pow(to[1] - from[1], 2) + pow(to[2] - from[2], 2));
        int32_t parts = p > 0 ? (int32_t)fmax(ceil(fmin(length / spacing, 1e6)), 1) : 1;
        for (int32_t k = 1; k <= parts; k++, made++)
            for (int d = 0; out && d < 3; d++) out[3 * made + d] = from[d] + (to[d] - from[d]) * k / parts + by[d];
    }
    return made;
}

/* Return whether the depth and some segment of the polyline span an area. */
static bool spans_area(int32_t count, const double *points, const double depth[3])
{
    for (int32_t p = 1; p < count; p++) {
        double along[3], across[3], squares[3] = {0, 0, 0};
        for (int d = 0; d < 3; d++) along[d] = points[3 * p + d] - points[3 * (p - 1) + d];
        for (int d = 0; d < 3; d++)
            across[d] = along[(d + 1) % 3] * depth[(d + 2) % 3] - along[(d + 2) % 3] * depth[(d + 1) % 3];
        for (int d = 0; d < 3; d++)
            squares[0] += along[d] * along[d], squares[1] += depth[d] * depth[d], squares[2] += across[d] * across[d];
        if (squares[2] > 1e-18 * squares[0] * squares[1]) return true;
    }
    return false;
}

pliant_status pliant_data_cut(const pliant_model *model, pliant_data *data, int32_t count, const double *points,
                              const double depth[3], pliant_cut_report *report)
{
    if (!pliant_body_is_cuttable(data->body))
        return pliant_fail(PLIANT_ERROR_SCENE,
                           "this scene does not cut: set cut/kind to sever and build the model again");
    bool good = count >= 2 && isfinite(depth[0]) && isfinite(depth[1]) && isfinite(depth[2]);
    for (int32_t n = 0; good && n < 3 * count; n++) good = isfinite(points[n]) && fabs(points[n]) < 1e3;
    if (!good)
        return pliant_fail(PLIANT_ERROR_ARGUMENT,
                           "a cut needs two points or more, within 1000 m, and a direction, all of them finite");
    if (!spans_area(count, points, depth))
        return pliant_fail(
            PLIANT_ERROR_ARGUMENT,
            "a cut has no area: its depth is (%g, %g, %g) m; use a depth that is not 0 and not along the line",
            depth[0], depth[1], depth[2]);
    const double *size = model->scan->geometry.spacing, spacing = 0.5 * fmin(size[0], fmin(size[1], size[2])),
                 none[3] = {0, 0, 0};
    const int32_t samples = sample_line(count, points, spacing, none, NULL);
    double *from = pliant_calloc((size_t)samples, 3 * sizeof *from),
           *to = pliant_calloc((size_t)samples, 3 * sizeof *to);
    pliant_cut_report reported = {0};
    pliant_status status = from && to ? PLIANT_OK : pliant_fail_memory("a cut");
    if (status == PLIANT_OK) {
        sample_line(count, points, spacing, none, from);
        sample_line(count, points, spacing, depth, to);
        pliant_cut_sweep sweep = {
            .count = samples, .from = from, .to = to, .material_of_voxel = model->material_of_voxel};
        status = pliant_data_cut_along_sweep(model, data, -1, &sweep, &reported);
    }
    pliant_free(from);
    pliant_free(to);
    if (status == PLIANT_OK && report) *report = reported;
    return status;
}

pliant_status pliant_data_undo_cut(const pliant_model *model, pliant_data *data)
{
    pliant_undo *undo = &data->undo;
    if (undo->count == 0) return pliant_fail(PLIANT_ERROR_ARGUMENT, "there is no cut to undo");
    const pliant_body *before = undo->body[undo->count - 1];
    pliant_status status = pliant_data_set_body(model, data, before);
    if (status != PLIANT_OK) return status;
    for (int t = 0; t < data->num_tools; t++) pliant_blade_end_stroke(data->tools + t);
    pliant_body_release(before);
    data->statistics.bytes = pliant_account_bytes(data->account);
    undo->count--;
    undo->tool = -1;
    return PLIANT_OK;
}
