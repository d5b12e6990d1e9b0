/* Validate with measured bodies: fit on one state, predict the others, and compare marker positions. */
#define _POSIX_C_SOURCE 200809L
#include "report/validation.h"

#include "base/clock.h"
#include "base/fail.h"
#include "base/memory.h"
#include "pliant/pliant.h"
#include "report/rows.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { MIN_MARKERS_FOR_FIELD = 200 /* minimum for the fit of a smooth field */, DEGREE = 4, RIGID = 6 };

/* Remove the least-squares fit by columns from the values, with Gram-Schmidt orthogonalization.
 * @param columns (terms x rows), overwritten
 * @param values (rows) */
static void subtract_fit(int32_t rows, int32_t terms, double *columns, double *values)
{
    for (int32_t t = 0; t < terms; t++) {
        double *column = columns + (size_t)t * (size_t)rows, square = 0, before = 0;
        for (int32_t r = 0; r < rows; r++) before += column[r] * column[r];
        for (int pass = 0; pass < 2; pass++) /* twice, for accuracy up to rounding */
            for (int32_t u = 0; u < t; u++) {
                const double *other = columns + (size_t)u * (size_t)rows;
                double along = 0;
                for (int32_t r = 0; r < rows; r++) along += other[r] * column[r];
                for (int32_t r = 0; r < rows; r++) column[r] -= along * other[r];
            }
        for (int32_t r = 0; r < rows; r++) square += column[r] * column[r];
        const double scale = square > 1e-20 * before ? 1 / sqrt(square) : 0; /* linearly dependent column */
        double along = 0;
        for (int32_t r = 0; r < rows; r++) along += (column[r] *= scale) * values[r];
        for (int32_t r = 0; r < rows; r++) values[r] -= along * column[r];
    }
}

/* Remove small rigid motions from the displacements of one state.
 * @param values (count x 3) */
static pliant_status subtract_rigid_motion(int32_t count, const pliant_marker *const *markers, double *values)
{
    double *columns = pliant_calloc((size_t)count, 3 * RIGID * sizeof *columns);
    if (!columns) return pliant_fail_memory("the markers");
    for (int32_t m = 0; m < count; m++)
        for (int d = 0; d < 3; d++) {
            columns[(size_t)d * 3 * (size_t)count + 3 * (size_t)m + (size_t)d] = 1;
            double *turn = columns + (size_t)(3 + d) * 3 * (size_t)count + 3 * (size_t)m; /* rotation about axis d */
            turn[(d + 1) % 3] = -markers[m]->rest[(d + 2) % 3];
            turn[(d + 2) % 3] = markers[m]->rest[(d + 1) % 3];
        }
    subtract_fit(3 * count, RIGID, columns, values);
    pliant_free(columns);
    return PLIANT_OK;
}

static double root_mean_square(int32_t count, const double *values)
{
    double sum = 0;
    for (int32_t n = 0; n < 3 * count; n++) sum += values[n] * values[n];
    return sqrt(sum / count);
}

/* List the markers of one state, in their order. */
static int32_t markers_of(const measured_body *body, int32_t state, const pliant_marker **out)
{
    int32_t count = 0;
    for (int32_t m = 0; m < body->num_markers; m++)
        if (body->markers[m].load == state) out[count++] = body->markers + m;
    return count;
}

/* ---- accuracy of the measurement */

/* Return the root mean square distance from the mean of the recordings, marker by marker; NAN for a single
 * recording. */
static double spread_of_recordings(const measured_body *body, int32_t count, const pliant_marker *const *markers)
{
    double sum = 0;
    int32_t others = 0;
    const pliant_marker **other = pliant_calloc((size_t)body->num_markers, sizeof *other);
    double *mean = pliant_calloc((size_t)count, 3 * sizeof *mean);
    for (int32_t s = 0; other && mean && s < body->num_states; s++) {
        if (markers_of(body, s, other) != count) continue;
        bool same = true; /* markers are identified by their rest positions, to within a centimetre */
        for (int32_t m = 0; m < count; m++)
            for (int d = 0; d < 3; d++) same = same && fabs(other[m]->rest[d] - markers[m]->rest[d]) < 0.01;
        if (!same) continue;
        others++;
        for (int32_t m = 0; m < count; m++)
            for (int d = 0; d < 3; d++) mean[3 * m + d] += other[m]->moved[d];
    }
    for (int32_t m = 0; mean && others > 1 && m < count; m++)
        for (int d = 0; d < 3; d++) sum += pow(markers[m]->moved[d] - mean[3 * m + d] / others, 2);
    const double spread = other && mean && others > 1 ? sqrt(sum / count * others / (others - 1)) : NAN;
    pliant_free((void *)other);
    pliant_free(mean);
    return spread;
}

/* Return the root mean square distance from a polynomial field. It measures the error of single beads, because the
 * deformation of a body is smooth. */
static double spread_of_field(int32_t count, const pliant_marker *const *markers)
{
    double low[3], high[3], sum = 0;
    int32_t terms = 0;
    for (int d = 0; d < 3; d++) low[d] = INFINITY, high[d] = -INFINITY;
    for (int32_t m = 0; m < count; m++)
        for (int d = 0; d < 3; d++)
            low[d] = fmin(low[d], markers[m]->rest[d]), high[d] = fmax(high[d], markers[m]->rest[d]);
    for (int a = 0; a <= DEGREE; a++)
        for (int b = 0; a + b <= DEGREE; b++) terms += DEGREE - a - b + 1;
    double *columns = pliant_calloc((size_t)count, (size_t)terms * sizeof *columns),
           *values = pliant_calloc((size_t)count, sizeof *values);
    for (int d = 0; columns && values && d < 3; d++) {
        int32_t t = 0;
        for (int a = 0; a <= DEGREE; a++)
            for (int b = 0; a + b <= DEGREE; b++)
                for (int c = 0; a + b + c <= DEGREE; c++, t++)
                    for (int32_t m = 0; m < count; m++) {
                        double x[3];
                        for (int e = 0; e < 3; e++)
                            x[e] = (2 * markers[m]->rest[e] - low[e] - high[e]) / fmax(high[e] - low[e], 1e-12);
                        columns[(size_t)t * (size_t)count + (size_t)m] = pow(x[0], a) * pow(x[1], b) * pow(x[2], c);
                    }
        for (int32_t m = 0; m < count; m++) values[m] = markers[m]->moved[d];
        subtract_fit(count, terms, columns, values);
        for (int32_t m = 0; m < count; m++) sum += values[m] * values[m];
    }
    const double spread = columns && values ? sqrt(sum / (count - terms)) : NAN;
    pliant_free(columns);
    pliant_free(values);
    return spread;
}

/* ---- simulation of a state */

typedef struct state_error {
    int32_t count;
    double moved, rms, max, deviation; /* [m] */
    double spread;                     /* [m]; may be NAN */
} state_error;

static pliant_status compare(const measured_body *body, const pliant_model *model, int32_t state, state_error *out)
{
    const pliant_marker **markers = pliant_calloc((size_t)body->num_markers, sizeof *markers);
    double *moved = pliant_calloc((size_t)body->num_markers, 3 * sizeof *moved),
           *measured = pliant_calloc((size_t)body->num_markers, 3 * sizeof *measured);
    double *difference = pliant_calloc((size_t)body->num_markers, 3 * sizeof *difference);
    *out = (state_error){.spread = NAN};
    pliant_status status = markers && moved && measured && difference ? PLIANT_OK : pliant_fail_memory("the markers");
    if (status >= 0)
        status = report_markers_move(model, body->loaded ? body->load + state : NULL, state, body->num_markers,
                                     body->markers, moved);
    if (status >= 0) {
        out->count = markers_of(body, state, markers);
        for (int32_t m = 0; m < out->count; m++)
            for (int d = 0; d < 3; d++) {
                measured[3 * m + d] = markers[m]->moved[d];
                difference[3 * m + d] = moved[3 * (markers[m] - body->markers) + d] - markers[m]->moved[d];
            }
    }
    if (status >= 0 && body->free_motion) status = subtract_rigid_motion(out->count, markers, measured);
    if (status >= 0 && body->free_motion) status = subtract_rigid_motion(out->count, markers, difference);
    if (status >= 0 && out->count > 0) {
        out->moved = root_mean_square(out->count, measured);
        out->rms = root_mean_square(out->count, difference);
        for (int32_t m = 0; m < out->count; m++) {
            out->max = fmax(out->max,
                            sqrt(difference[3 * m] * difference[3 * m] + difference[3 * m + 1] * difference[3 * m + 1] +
                                 difference[3 * m + 2] * difference[3 * m + 2]));
            out->deviation = fmax(out->deviation, markers[m]->deviation);
        }
        if (body->recordings) out->spread = spread_of_recordings(body, out->count, markers);
        else if (out->count >= MIN_MARKERS_FOR_FIELD) out->spread = spread_of_field(out->count, markers);
    }
    pliant_free((void *)markers);
    pliant_free(moved);
    pliant_free(measured);
    pliant_free(difference);
    return status;
}

static pliant_status build(const measured_body *body, pliant_model **out)
{
    return pliant_model_build(&body->scene, &body->scan, body->labels.voxels ? &body->labels : NULL, &body->materials,
                              (pliant_progress){NULL, NULL}, out);
}

/* ---- fitting */

static pliant_status fit_moduli(measured_body *body, int32_t count, const char *const *names, pliant_progress progress,
                                char text[256])
{
    const char *all[PLIANT_MAX_MODULI];
    int32_t num_markers = 0;
    pliant_moduli found;
    pliant_marker *markers = pliant_calloc((size_t)body->num_markers, sizeof *markers);
    if (!markers) return pliant_fail_memory("the markers");
    for (int32_t m = 0; m < body->num_markers; m++)
        if (body->markers[m].load == body->fitted) {
            markers[num_markers] = body->markers[m];
            markers[num_markers++].load = 0;
        }
    const char *const *wanted = count > 0 ? names : all;
    if (count == 0)
        for (uint32_t m = 0; count < PLIANT_MAX_MODULI && m < body->materials.num_materials; m++)
            if (!body->materials.materials[m].empty && !body->materials.materials[m].fixed)
                all[count++] = body->materials.materials[m].name;
    const pliant_report_input input = {&body->scene, &body->scan, body->labels.voxels ? &body->labels : NULL,
                                       &body->materials};
    const pliant_moduli_data data = {1, body->loaded ? body->load + body->fitted : NULL, num_markers, markers};
    pliant_status status = pliant_moduli_fit(&input, &data, count, wanted, progress, &found);
    size_t used = 0;
    for (int32_t p = 0; status >= 0 && p < found.count; p++) {
        for (uint32_t m = 0; m < body->materials.num_materials; m++)
            if (strcmp(body->materials.materials[m].name, wanted[p]) == 0)
                body->materials.materials[m].young_modulus = found.young[p];
        const int printed = snprintf(text + used, 256 - used, "%sE of %s %.4g kPa (%.4g to %.4g)", p ? ", " : "",
                                     wanted[p], 1e-3 * found.young[p], 1e-3 * found.low[p], 1e-3 * found.high[p]);
        used = used + (size_t)printed < 255 ? used + (size_t)printed : 255;
    }
    pliant_free(markers);
    return status;
}

static pliant_status with_poisson(measured_body *body, double poisson, double *error)
{
    pliant_model *model = NULL;
    state_error now;
    body->materials.materials[0].poisson_ratio = poisson;
    pliant_status status = build(body, &model);
    if (status >= 0) status = compare(body, model, body->fitted, &now);
    pliant_model_free(model);
    if (status >= 0) *error = now.rms;
    return status;
}

/* Fit Poisson's ratio of the first material: minimize the root mean square distance by golden-section search in log(1/2
 * - nu), which resolves nearly incompressible materials. */
static pliant_status fit_poisson(measured_body *body, pliant_progress progress, char text[256])
{
    const double golden = 0.5 * (sqrt(5) - 1), minimum = log(0.0005), maximum = log(0.2);
    double low = minimum, high = maximum, at[2] = {high - golden * (high - low), low + golden * (high - low)},
           error[2] = {0, 0};
    enum { GOLDEN_SECTION_STEPS = 9 };
    pliant_status status = with_poisson(body, 0.5 - exp(at[0]), &error[0]);
    if (status >= 0) status = with_poisson(body, 0.5 - exp(at[1]), &error[1]);
    for (int n = 0; status >= 0 && n < GOLDEN_SECTION_STEPS; n++) {
        const int kept = error[1] < error[0];
        if (!pliant_report_progress(progress, (n + 1.0) / (GOLDEN_SECTION_STEPS + 1), "Poisson's ratio"))
            return pliant_fail(PLIANT_ERROR_CANCELLED, "the fit was stopped");
        if (kept) low = at[0];
        else high = at[1];
        at[!kept] = at[kept];
        error[!kept] = error[kept];
        at[kept] = kept ? low + golden * (high - low) : high - golden * (high - low);
        status = with_poisson(body, 0.5 - exp(at[kept]), &error[kept]);
    }
    const double found = 0.5 - exp(at[error[1] < error[0]]);
    body->materials.materials[0].poisson_ratio = found;
    const char *where = at[0] - minimum < 0.1 ? " or more" : maximum - at[1] < 0.1 ? " or less" : "";
    snprintf(text, 256, "Poisson's ratio %.4f%s", found, where);
    return status;
}

/* ---- rows */

static void write_result_row(const measured_body *body, int32_t state, const char *fitted, const state_error *error,
                             double seconds, report_row *row)
{
    row_text(row, "ok");
    row_text(row, "");
    row_text(row, state == body->fitted ? "fitted" : "predicted");
    row_text(row, fitted);
    row_integer(row, error->count);
    row_number(row, 1e3 * error->moved);
    row_number(row, 1e3 * error->rms);
    row_number(row, 1e3 * error->max);
    row_number(row, 100 * error->rms / error->moved);
    row_number(row, 1e3 * error->spread);
    row_number(row, 1e3 * error->deviation);
    row_number(row, seconds);
}

/* Hash the inputs of rows with the same key, because a changed table is a different measurement. */
static void setup_of(const measured_body *body, int32_t count, const char *const *names, char out[9])
{
    const pliant_report_input input = {&body->scene, &body->scan, body->labels.voxels ? &body->labels : NULL,
                                       &body->materials};
    pliant_report_setup(&input, NULL, out);
    uint64_t hash = report_hash(body->bytes, out, strlen(out));
    for (int32_t n = 0; n < count; n++) hash = report_hash(hash, names[n], strlen(names[n]) + 1);
    snprintf(out, 9, "%08x", (unsigned)(hash ^ hash >> 32));
}

static pliant_status validate(const measured_source *source, int32_t count, const char *const *names,
                              pliant_report_tables *tables, pliant_progress progress)
{
    measured_body body;
    pliant_model *model = NULL;
    char setup[9], fitted[256] = "";
    pliant_status status = measured_body_read(source, &body);
    if (status < 0) return status;
    setup_of(&body, count, names, setup);
    status =
        body.fits_poisson ? fit_poisson(&body, progress, fitted) : fit_moduli(&body, count, names, progress, fitted);
    if (status >= 0) status = build(&body, &model);
    for (int32_t s = 0; status >= 0 && s < body.num_states; s++) {
        report_row row;
        state_error error;
        const double start = pliant_seconds();
        status = compare(&body, model, s, &error);
        if (status < 0) break;
        row_clear(&row);
        row_text(&row, setup);
        row_text(&row, body.name);
        row_text(&row, body.state[s]);
        if (row_is_stored(&row, tables->validation)) continue;
        write_result_row(&body, s, fitted, &error, pliant_seconds() - start, &row);
        status = row_add(&row, tables->validation);
    }
    pliant_model_free(model);
    measured_body_free(&body);
    return status < 0 ? status : PLIANT_OK;
}

pliant_status pliant_validation_run(const char *folder, int32_t count, const char *const *names,
                                    pliant_report_tables *tables, pliant_progress progress)
{
    measured_source *sources;
    int32_t found;
    pliant_status status = measured_bodies_find(folder, &found, &sources);
    for (int32_t n = 0; status >= 0 && n < found; n++) status = validate(sources + n, count, names, tables, progress);
    pliant_free(sources);
    return status;
}
