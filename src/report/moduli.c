/* Fit moduli of materials to measured displacements: Gauss-Newton on their logarithms, with Levenberg-Marquardt
 * damping. */
#include "base/fail.h"
#include "base/memory.h"
#include "material/material.h"
#include "pliant/report.h"
#include "report/validation.h"
#include "model_data/data.h"

#include <math.h>
#include <string.h>

enum {
    MAX_FIT_PASSES = 30,
    MAX_TRIES = 8,
    RAMP = 10 /* steps in which tools reach where a load ends */,
    SETTLING_STEPS = 200,
    SETTLING_ITERATIONS = 100
};

typedef struct fitting {
    const pliant_report_input *input;
    const pliant_moduli_data *data;
    pliant_material_table table;          /* a modified copy */
    int32_t material[PLIANT_MAX_MODULI];  /* indices of the fitted materials */
    int32_t count;
    pliant_progress progress;
    int32_t solves;
} fitting;

/* ---- marker displacements for given moduli */

static pliant_status hold(const pliant_model *model, pliant_data *data, const pliant_path *path)
{
    const double none[3] = {0, 0, 0};
    pliant_status status = PLIANT_OK;
    for (uint32_t t = 0; status >= 0 && t < path->num_tools; t++) {
        const pliant_path_tool *tool = path->tools + t;
        int index;
        status = pliant_tool_add(model, data, tool->name, &index);
        if (status >= 0) status = pliant_tool_set_pose(data, index, tool->grasp, NULL);
        if (status >= 0) status = pliant_tool_grasp(model, data, index, tool->grasp);
        if (status >= 0) status = pliant_tool_set_drive(data, index, tool->drive, none);
        if (status >= 0) status = pliant_tool_set_mass(data, index, tool->mass);
    }
    return status;
}

static pliant_status move_path_tools(pliant_data *data, const pliant_path *path, double time)
{
    double gravity[3];
    pliant_status status =
        pliant_path_gravity(path, time, gravity) ? pliant_data_set_gravity(data, gravity) : PLIANT_OK;
    for (uint32_t t = 0; status >= 0 && t < path->num_tools; t++) {
        const pliant_path_tool *tool = path->tools + t;
        double value[3], tip[3];
        pliant_path_at(tool, time, value);
        for (int d = 0; d < 3; d++) tip[d] = tool->grasp[d] + value[d];
        status = tool->drive == PLIANT_DRIVE_FORCE ? pliant_tool_set_drive(data, (int)t, tool->drive, value)
                                                   : pliant_tool_set_pose(data, (int)t, tip, NULL);
    }
    return status;
}

/* Apply a load from rest, and iterate to equilibrium. */
static pliant_status settle(const pliant_model *model, pliant_data *data, const pliant_path *path)
{
    const double tolerance = data->solver ? 1e-7 : 1e-4; /* explicit dynamics has single precision */
    const int iterations = data->solver ? SETTLING_ITERATIONS : model->scene.tled.relaxation_steps;
    pliant_status status = pliant_data_set_limits(data, iterations, tolerance);
    if (status >= 0 && path) status = hold(model, data, path);
    for (int s = 1; status >= 0 && path && s <= RAMP; s++) {
        status = move_path_tools(data, path, pliant_path_end(path) * s / RAMP);
        if (status >= 0) status = pliant_step(model, data);
    }
    for (int s = 0; status >= 0 && s < SETTLING_STEPS; s++)
        if ((status = pliant_step(model, data)) == PLIANT_OK) break;
    return status;
}

/* Points followed for a marker: its tissue point; at a distance from the tissue, two more, which give the local
 * rotation. */
enum { POINTS_PER_MARKER = 3 };

/* Compute the followed points: the tissue point, a point inwards by the length of the offset, and a third one to a
 * side. */
static void find_followed_points(const pliant_marker *marker, double sign, int axis, double out[3 * POINTS_PER_MARKER])
{
    const double far = sqrt(marker->offset[0] * marker->offset[0] + marker->offset[1] * marker->offset[1] +
                            marker->offset[2] * marker->offset[2]);
    for (int d = 0; d < 3; d++) {
        out[d] = marker->rest[d];
        out[3 + d] = marker->rest[d] - marker->offset[d];
        out[6 + d] = out[3 + d] + (d == axis ? sign * far : 0);
    }
}

/* Choose the followed points. The side is along the axis most perpendicular to the offset, where there is tissue. */
static pliant_status place(const pliant_mesh *mesh, const pliant_marker *marker, double out[3 * POINTS_PER_MARKER])
{
    int axis = 0;
    for (int d = 1; d < 3; d++)
        if (fabs(marker->offset[d]) < fabs(marker->offset[axis])) axis = d;
    for (int side = 0; side < 2; side++) {
        pliant_points trial;
        find_followed_points(marker, side ? -1 : 1, axis, out);
        pliant_status status = pliant_points_create(mesh, POINTS_PER_MARKER, out, &trial);
        if (status < 0) return status;
        const bool all = trial.num_found == POINTS_PER_MARKER;
        pliant_points_free(&trial);
        if (all) break;
    }
    return PLIANT_OK;
}

/* Build a right-handed frame whose first axis is b - a and whose second axis lies in the plane of c. */
static void frame(const double *a, double out[9])
{
    double x[3], y[3], length = 0, along = 0;
    for (int d = 0; d < 3; d++) x[d] = a[3 + d] - a[d], y[d] = a[6 + d] - a[3 + d], length += x[d] * x[d];
    for (int d = 0; d < 3; d++) x[d] /= sqrt(length), along += x[d] * y[d];
    length = 0;
    for (int d = 0; d < 3; d++) y[d] -= along * x[d], length += y[d] * y[d];
    for (int d = 0; d < 3; d++) {
        out[d] = x[d];
        out[3 + d] = y[d] / sqrt(length);
    }
    for (int d = 0; d < 3; d++)
        out[6 + d] = out[(d + 1) % 3] * out[3 + (d + 2) % 3] - out[(d + 2) % 3] * out[3 + (d + 1) % 3];
}

/* Compute the displacement of a marker's centre: the displacement of its tissue point, with the offset rotated like the
 * tissue. */
static void displacement(const pliant_marker *marker, const double rest[3 * POINTS_PER_MARKER],
                         const double now[3 * POINTS_PER_MARKER], double out[3])
{
    double before[9], after[9];
    for (int d = 0; d < 3; d++) out[d] = now[d] - rest[d];
    if (marker->offset[0] == 0 && marker->offset[1] == 0 && marker->offset[2] == 0) return;
    frame(rest, before);
    frame(now, after);
    for (int d = 0; d < 3; d++) {
        out[d] -= marker->offset[d];
        for (int k = 0; k < 3; k++)
            for (int e = 0; e < 3; e++) out[d] += after[3 * k + d] * before[3 * k + e] * marker->offset[e];
    }
}

pliant_status report_markers_move(const pliant_model *model, const pliant_path *load, int32_t state,
                                  int32_t num_markers, const pliant_marker *markers, double *moved)
{
    pliant_data *simulation = NULL;
    pliant_points points = {0};
    const size_t capacity = POINTS_PER_MARKER * 3 * (size_t)num_markers;
    double *rest = pliant_calloc(capacity, sizeof *rest), *now = pliant_calloc(capacity, sizeof *now);
    pliant_status status = rest && now ? pliant_data_create(model, &simulation) : pliant_fail_memory("the markers");
    for (int32_t m = 0; status >= 0 && m < num_markers; m++)
        status = place(&model->body->fine, markers + m, rest + 3 * POINTS_PER_MARKER * m);
    if (status >= 0) status = pliant_points_create(&model->body->fine, POINTS_PER_MARKER * num_markers, rest, &points);
    for (int32_t m = 0; status >= 0 && m < num_markers; m++)
        for (int f = 0; status >= 0 && f < POINTS_PER_MARKER; f++)
            if (!points.found[POINTS_PER_MARKER * m + f]) {
                const double *at = rest + 3 * (POINTS_PER_MARKER * m + f);
                status = pliant_fail(PLIANT_ERROR_ARGUMENT, "marker %d: there is no tissue at (%.4f %.4f %.4f) m",
                                     m + 1, at[0], at[1], at[2]);
            }
    if (status >= 0) status = settle(model, simulation, load);
    if (status == PLIANT_NOT_CONVERGED)
        status = pliant_fail(PLIANT_ERROR_NUMERIC, "load %d does not come to rest", state + 1);
    if (status >= 0) pliant_points_move(&points, simulation->positions, now);
    for (int32_t m = 0; status >= 0 && m < num_markers; m++)
        if (markers[m].load == state)
            displacement(markers + m, rest + 3 * POINTS_PER_MARKER * m, now + 3 * POINTS_PER_MARKER * m, moved + 3 * m);
    pliant_points_free(&points);
    pliant_data_free(simulation);
    pliant_free(rest);
    pliant_free(now);
    return status;
}

/* @param logs (count) logarithms of Young's moduli
 * @param out (3 num_markers) residuals divided by their deviations */
static pliant_status residuals(fitting *fit, const double *logs, double *out)
{
    pliant_model *model = NULL;
    const pliant_moduli_data *data = fit->data;
    if (!pliant_report_progress(fit->progress, 1 - 1 / (1 + 0.05 * fit->solves++), "moduli"))
        return pliant_fail(PLIANT_ERROR_CANCELLED, "the fit was stopped");
    for (int32_t p = 0; p < fit->count; p++) fit->table.materials[fit->material[p]].young_modulus = exp(logs[p]);
    pliant_status status = pliant_model_build(fit->input->scene, fit->input->scan, fit->input->labels, &fit->table,
                                              (pliant_progress){NULL, NULL}, &model);
    if (status >= 0 && fit->solves == 1)
        status = report_markers_check(&pliant_model_get_body(model)->fine, data->num_markers, data->markers);
    for (int32_t load = 0; status >= 0 && load < data->num_loads; load++)
        status = report_markers_move(model, data->loads ? data->loads + load : NULL, load, data->num_markers,
                                     data->markers, out);
    pliant_model_free(model);
    for (int32_t m = 0; status >= 0 && m < data->num_markers; m++)
        for (int d = 0; d < 3; d++)
            out[3 * m + d] = (out[3 * m + d] - data->markers[m].moved[d]) / data->markers[m].deviation;
    return status;
}

/* ---- least squares */

static double square(int32_t count, const double *r)
{
    double sum = 0;
    for (int32_t n = 0; n < count; n++) sum += r[n] * r[n];
    return sum;
}

/* Invert in place by Gauss-Jordan elimination; false: singular. */
static bool invert(int n, double a[PLIANT_MAX_MODULI][PLIANT_MAX_MODULI])
{
    double inverse[PLIANT_MAX_MODULI][PLIANT_MAX_MODULI] = {{0}}, scale[PLIANT_MAX_MODULI];
    for (int i = 0; i < n; i++) {
        inverse[i][i] = 1;
        scale[i] = a[i][i];
    }
    for (int i = 0; i < n; i++) {
        if (!(a[i][i] > 1e-12 * scale[i])) return false;
        const double pivot = 1 / a[i][i];
        for (int k = 0; k < n; k++) a[i][k] *= pivot, inverse[i][k] *= pivot;
        for (int j = 0; j < n; j++) {
            const double factor = j == i ? 0 : a[j][i];
            for (int k = 0; k < n; k++) a[j][k] -= factor * a[i][k], inverse[j][k] -= factor * inverse[i][k];
        }
    }
    memcpy(a, inverse, sizeof inverse);
    return true;
}

static pliant_status jacobian(fitting *fit, const double *logs, const double *r, double *other, double *columns)
{
    const double step = 0.02; /* step of a logarithm for finite differences */
    const int32_t rows = 3 * fit->data->num_markers;
    for (int32_t p = 0; p < fit->count; p++) {
        double changed[PLIANT_MAX_MODULI];
        memcpy(changed, logs, sizeof changed);
        changed[p] += step;
        pliant_status status = residuals(fit, changed, other);
        if (status < 0) return status;
        for (int32_t n = 0; n < rows; n++) columns[(size_t)p * (size_t)rows + (size_t)n] = (other[n] - r[n]) / step;
        if (square(rows, columns + (size_t)p * (size_t)rows) == 0)
            return pliant_fail(
                PLIANT_ERROR_NUMERIC,
                "material %s moves no marker: the measurements do not determine its stiffness; do not fit it, or add "
                "markers",
                fit->table.materials[fit->material[p]].name);
    }
    return PLIANT_OK;
}

/* Compute J'J with damping on its diagonal, and J'r. */
static void normal_equations(const fitting *fit, const double *columns, const double *r, double damping,
                             double a[PLIANT_MAX_MODULI][PLIANT_MAX_MODULI], double *g)
{
    const size_t rows = 3 * (size_t)fit->data->num_markers;
    for (int i = 0; i < fit->count; i++) {
        g[i] = 0;
        for (size_t n = 0; n < rows; n++) g[i] += columns[(size_t)i * rows + n] * r[n];
        for (int j = 0; j < fit->count; j++) {
            a[i][j] = 0;
            for (size_t n = 0; n < rows; n++) a[i][j] += columns[(size_t)i * rows + n] * columns[(size_t)j * rows + n];
        }
    }
    for (int i = 0; i < fit->count; i++) a[i][i] *= 1 + damping;
}

/* Return whether these moduli are in the range of a material table, with a margin for finite differences. */
static bool are_moduli(int count, const double *logs)
{
    const double minimum = 1e-3, maximum = 9e11; /* [Pa] */
    bool good = true;
    for (int p = 0; p < count; p++) good = good && logs[p] >= log(minimum) && logs[p] <= log(maximum);
    return good;
}

/* Take one step that lowers the sum of squares. *done: no further improvement. */
static pliant_status pass(fitting *fit, double *logs, double *r, double *other, double *columns, double *damping,
                          bool *done)
{
    const double longest = 1, enough = 1e-4; /* maximum and minimum change of a logarithm */
    const int32_t rows = 3 * fit->data->num_markers;
    const double before = square(rows, r);
    pliant_status status = jacobian(fit, logs, r, other, columns);
    for (int tries = 0; status >= 0 && tries < MAX_TRIES; tries++, *damping *= 10) {
        double a[PLIANT_MAX_MODULI][PLIANT_MAX_MODULI], g[PLIANT_MAX_MODULI], next[PLIANT_MAX_MODULI] = {0},
                                                                              maximum = 0;
        normal_equations(fit, columns, r, *damping, a, g);
        if (!invert(fit->count, a)) continue;
        for (int i = 0; i < fit->count; i++) {
            double step = 0;
            for (int j = 0; j < fit->count; j++) step -= a[i][j] * g[j];
            next[i] = logs[i] + fmin(fmax(step, -longest), longest);
            maximum = fmax(maximum, fabs(next[i] - logs[i]));
        }
        if (!are_moduli(fit->count, next)) continue;
        status = residuals(fit, next, other);
        if (status < 0 || square(rows, other) > before) continue;
        memcpy(logs, next, sizeof next);
        memcpy(r, other, (size_t)rows * sizeof *r);
        *damping *= 0.1;
        *done = maximum < enough;
        return PLIANT_OK;
    }
    *done = true;
    return status;
}

/* Return the two-sided 95 % quantile of Student's distribution by its expansion in 1 / freedom (Abramowitz and Stegun
 * 26.7.5). */
static double student_quantile(double freedom)
{
    const double x = 1.959964, x3 = x * x * x, x5 = x3 * x * x;
    return x + (x3 + x) / (4 * freedom) + (5 * x5 + 16 * x3 + 3 * x) / (96 * freedom * freedom);
}

static pliant_status write_result_row(const fitting *fit, const double *logs, const double *r, const double *columns,
                                      pliant_moduli *out)
{
    const int32_t rows = 3 * fit->data->num_markers, freedom = rows - fit->count;
    double a[PLIANT_MAX_MODULI][PLIANT_MAX_MODULI], g[PLIANT_MAX_MODULI], sum = 0;
    normal_equations(fit, columns, r, 0, a, g);
    if (!invert(fit->count, a))
        return pliant_fail(
            PLIANT_ERROR_NUMERIC,
            "the measurements do not distinguish the materials: fit fewer materials, or measure at other points or "
            "under other loads");
    out->count = fit->count;
    out->misfit = square(rows, r) / freedom;
    for (int32_t m = 0; m < fit->data->num_markers; m++)
        for (int d = 0; d < 3; d++) sum += pow(r[3 * m + d] * fit->data->markers[m].deviation, 2);
    out->rms = sqrt(sum / fit->data->num_markers);
    for (int32_t p = 0; p < fit->count; p++) {
        const double deviation = sqrt(a[p][p] * fmax(out->misfit, 1)), wide = student_quantile(freedom) * deviation;
        out->young[p] = exp(logs[p]);
        out->low[p] = exp(logs[p] - wide);
        out->high[p] = exp(logs[p] + wide);
        for (int32_t q = 0; q < fit->count; q++) out->correlation[p][q] = a[p][q] / sqrt(a[p][p] * a[q][q]);
    }
    return PLIANT_OK;
}

static pliant_status begin(fitting *fit, int32_t count, const char *const *names, double *logs)
{
    const pliant_moduli_data *data = fit->data;
    if (count < 1 || count > PLIANT_MAX_MODULI)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "%d moduli: 1 to %d can be fitted", count, PLIANT_MAX_MODULI);
    if (data->num_loads < 1 || 3 * data->num_markers <= count)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "%d markers are too few for %d moduli", data->num_markers, count);
    if (fit->input->scene->solver.kind == PLIANT_TLED && !fit->input->scene->tled.quasi_static)
        return pliant_fail(PLIANT_ERROR_SCENE,
                           "markers are measured at rest, but the solver is dynamic: set tled/quasi_static");
    for (int32_t m = 0; m < data->num_markers; m++)
        if (!(data->markers[m].deviation > 0) || data->markers[m].load < 0 || data->markers[m].load >= data->num_loads)
            return pliant_fail(PLIANT_ERROR_ARGUMENT,
                               "marker %d: load %d of %d, deviation %g m: it must be more than 0", m + 1,
                               data->markers[m].load + 1, data->num_loads, data->markers[m].deviation);
    for (int32_t p = 0; p < count; p++) {
        uint32_t m = 0;
        while (m < fit->table.num_materials && strcmp(fit->table.materials[m].name, names[p]) != 0) m++;
        if (m == fit->table.num_materials)
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "there is no material %s in the table", names[p]);
        fit->material[p] = (int32_t)m;
        logs[p] = log(fit->table.materials[m].young_modulus);
    }
    fit->count = count;
    return PLIANT_OK;
}

pliant_status pliant_moduli_fit(const pliant_report_input *input, const pliant_moduli_data *data, int32_t count,
                                const char *const *names, pliant_progress progress, pliant_moduli *out)
{
    fitting fit = {.input = input, .data = data, .progress = progress};
    double logs[PLIANT_MAX_MODULI] = {0}, damping = 1e-3;
    double *r = NULL, *other = NULL, *columns = NULL;
    bool done = false;
    pliant_moduli result = {0};
    pliant_status status = pliant_material_table_copy(input->materials, &fit.table);
    if (status < 0) return status;
    status = begin(&fit, count, names, logs);
    if (status >= 0) {
        const size_t rows = 3 * (size_t)data->num_markers;
        r = pliant_calloc(rows, sizeof *r);
        other = pliant_calloc(rows, sizeof *other);
        columns = pliant_calloc(rows * (size_t)count, sizeof *columns);
        if (!r || !other || !columns) status = pliant_fail_memory("the fit");
    }
    if (status >= 0) status = residuals(&fit, logs, r);
    while (status >= 0 && !done && result.passes < MAX_FIT_PASSES) {
        status = pass(&fit, logs, r, other, columns, &damping, &done);
        result.passes++;
    }
    if (status >= 0) status = jacobian(&fit, logs, r, other, columns);
    if (status >= 0) status = write_result_row(&fit, logs, r, columns, &result);
    pliant_free(r);
    pliant_free(other);
    pliant_free(columns);
    pliant_material_table_free(&fit.table);
    if (status < 0) return status;
    report_markers_warn(data->num_markers, data->markers, &result);
    *out = result;
    return done ? PLIANT_OK : PLIANT_NOT_CONVERGED;
}
