/* What explicit dynamics costs on a scene, and how well it keeps energy. */
#include "base/fail.h"
#include "base/threads.h"
#include "pliant/memory.h"
#include "report/rows.h"

#include <math.h>
#include <string.h>

/* Pulled in the first half of the frames, then let go.
 * @param seconds (frames) Nullable
 * @param drift   out, Nullable: largest change of the kept energy after letting go, over the energy [-] */
static pliant_status pull_and_let_go(const pliant_model *model, const pliant_sweep *sweep, pliant_data *data, double *seconds, double *drift,
                                     pliant_progress progress)
{
    const double *at = sweep->points[0].rest;
    double from[3], tip[3], first = 0;
    int tool;
    pliant_status status = pliant_tool_add(model, data, "report", &tool);
    if (status >= 0) status = pliant_tool_pose(data, tool, at, NULL);
    if (status >= 0) status = pliant_tool_grasp(model, data, tool, at);
    if (status >= 0) status = pliant_tool_drive(data, tool, PLIANT_DRIVE_RIGID, NULL);
    if (status >= 0) memcpy(from, data->tools[tool].tip, sizeof from);
    if (drift) *drift = 0;
    for (int32_t f = 0; status >= 0 && f < 2 * sweep->frames; f++) {
        if (!pliant_report_progress(progress, 0.5 * f / sweep->frames, "explicit dynamics"))
            return pliant_fail(PLIANT_ERROR_CANCELLED, "the report was stopped; what is done is kept");
        if (f == sweep->frames) pliant_tool_lost(data, tool);
        for (int d = 0; d < 3; d++) tip[d] = from[d] + sweep->pull[d] * (f + 1.0) / sweep->frames;
        if (f < sweep->frames) status = pliant_tool_pose(data, tool, tip, NULL);
        double start = pliant_seconds();
        if (status >= 0) status = pliant_step(model, data);
        if (seconds) seconds[f] = pliant_seconds() - start;
        if (status < 0 || !drift || f < sweep->frames) continue;
        pliant_dynamics dynamics;
        if ((status = pliant_data_dynamics(model, data, &dynamics)) < 0) break;
        if (f == sweep->frames) first = dynamics.kept_energy;
        else *drift = fmax(*drift, fabs(dynamics.kept_energy - first) / first);
    }
    return status;
}

/* The scene without whatever takes or gives energy. */
static pliant_status measure_drift(const pliant_report_input *input, const pliant_sweep *sweep, double *drift, pliant_progress progress)
{
    pliant_scene scene = *input->scene;
    pliant_model *model = NULL;
    pliant_data *data = NULL;
    scene.tled.quasi_static = scene.tled.nodal_pressure = false;
    scene.tled.damping = 0;
    memset(scene.tled.prony_share, 0, sizeof scene.tled.prony_share);
    memset(scene.model.gravity, 0, sizeof scene.model.gravity);
    pliant_status status = pliant_model_build(&scene, input->scan, input->labels, input->materials, progress, &model);
    if (status >= 0) status = pliant_data_create(model, &data);
    if (status >= 0) status = pull_and_let_go(model, sweep, data, NULL, drift, progress);
    pliant_data_free(data);
    pliant_model_free(model);
    return status;
}

static pliant_status tell(const pliant_model *model, const pliant_data *data, const pliant_sweep *sweep, double *seconds, double drift,
                          report_row *row)
{
    static const char *const laws[] = {
#define LAW_NAME(name, yaml) #yaml,
        PLIANT_LAW_LIST(LAW_NAME)
#undef LAW_NAME
    };
    pliant_dynamics dynamics;
    pliant_status status = pliant_data_dynamics(model, data, &dynamics);
    if (status < 0) return status;
    int32_t frames = 2 * sweep->frames;
    report_sort(seconds, frames);
    double frame = report_quantile(seconds, frames, 0.5);
    row_text(row, "ok");
    row_text(row, "");
    row_integer(row, model->body->fine.num_tets);
    row_integer(row, model->body->fine.num_nodes);
    row_text(row, laws[model->scene.tled.law]);
    row_text(row, pliant_data_backend(data));
    row_integer(row, pliant_threads_of(model->scene.solver.threads));
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
    return PLIANT_OK;
}

pliant_status pliant_dynamics_run(const pliant_report_input *input, const pliant_sweep *sweep, pliant_report_tables *tables,
                                  pliant_progress progress)
{
    report_row row;
    char setup[9];
    double drift = NAN, *seconds = NULL;
    pliant_scene scene = *input->scene;
    pliant_model *model = NULL;
    pliant_data *data = NULL;
    if (scene.solver.kind != PLIANT_TLED)
        return pliant_fail(PLIANT_ERROR_SCENE, "solver/kind: figures of explicit dynamics are those of tled, not of the corotational solver");
    if (sweep->num_points < 1) return pliant_fail(PLIANT_ERROR_ARGUMENT, "figures of explicit dynamics need a point to pull at");
    pliant_report_setup(input, sweep, setup);
    row_clear(&row);
    row_text(&row, setup);
    if (row_known(&row, tables->dynamics)) return PLIANT_OK;
    scene.tled.quasi_static = false;
    pliant_status status = pliant_model_build(&scene, input->scan, input->labels, input->materials, progress, &model);
    if (status >= 0) status = pliant_data_create(model, &data);
    if (status >= 0 && !(seconds = pliant_calloc(2 * (size_t)sweep->frames, sizeof *seconds))) status = pliant_fail_memory("the times of the frames");
    if (status >= 0) status = pull_and_let_go(model, sweep, data, seconds, NULL, progress);
    if (status >= 0) status = measure_drift(input, sweep, &drift, progress);
    if (status >= 0) status = tell(model, data, sweep, seconds, drift, &row);
    if (status < 0 && status != PLIANT_ERROR_CANCELLED && status != PLIANT_ERROR_MEMORY) { /* a figure too: it cannot be had */
        row_text(&row, pliant_status_text(status));
        row_text(&row, pliant_last_error());
        status = PLIANT_OK;
    }
    if (status >= 0) status = row_add(&row, tables->dynamics);
    pliant_free(seconds);
    pliant_data_free(data);
    pliant_model_free(model);
    return status;
}
