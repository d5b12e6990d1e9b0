#include "deform_compare.h"

#include "pliant/fail.h"
#include "command_line.h"
#include "console.h"
#include "deform_output.h"
#include "picture.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

/* The nodes of one run against those of the reference, where their places at rest are the same; meshes may differ by what they leave out. */
typedef struct node_errors {
    double largest, rms;           /* [m] */
    double largest_displacement;   /* of the reference [m] */
} node_errors;

static double length_of(const double v[3]) { return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

static node_errors errors_of(const deform_run *run, const deform_run *reference)
{
    const pliant_mesh *mesh = &pliant_data_get_body(run->data)->fine, *other = &pliant_data_get_body(reference->data)->fine;
    const double *positions = pliant_data_get_positions(run->data, NULL), *others = pliant_data_get_positions(reference->data, NULL);
    node_errors errors = {0.0, 0.0, 0.0};
    double sum = 0.0;
    int32_t count = 0;
    for (int32_t n = 0; n < other->num_nodes; ++n) {
        const double *rest = other->rest + 3 * n, *to = others + 3 * n;
        double weights[4], apart[3], moved[3];
        int32_t tet = pliant_mesh_locate(mesh, rest, weights);
        if (tet < 0) continue;
        for (int d = 0; d < 3; ++d) {
            apart[d] = -to[d];
            moved[d] = to[d] - rest[d];
            for (int v = 0; v < 4; ++v) apart[d] += weights[v] * positions[3 * mesh->tets[4 * tet + v] + d];
        }
        double error = length_of(apart);
        errors.largest = fmax(errors.largest, error);
        errors.largest_displacement = fmax(errors.largest_displacement, length_of(moved));
        sum += error * error;
        ++count;
    }
    errors.rms = count > 0 ? sqrt(sum / count) : 0.0;
    return errors;
}

static pliant_status write_table(const deform_arguments *arguments, const deform_run *runs)
{
    const deform_run *reference = &runs[arguments->num_compared - 1];
    const char *reference_name = deform_method_name(reference->scene.model.method);
    char path[4096];
    snprintf(path, sizeof path, "%s/compare.csv", arguments->folder);
    FILE *file = fopen(path, "w");
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    fputs("method,step_median_ms,largest_error_mm,rms_error_mm,largest_displacement_mm,largest_error_percent\n", file);
    printf("\n%-12s %14s %18s %14s %10s   against %s\n", "method", "step [ms]", "largest error [mm]", "rms [mm]", "[%]", reference_name);
    for (int m = 0; m < arguments->num_compared; ++m) {
        const char *name = deform_method_name(runs[m].scene.model.method);
        node_errors errors = errors_of(&runs[m], reference);
        double median = 1e3 * runs[m].times.median, part = errors.largest_displacement > 0.0 ? 100.0 * errors.largest / errors.largest_displacement : 0.0;
        fprintf(file, "%s,%.6g,%.6g,%.6g,%.6g,%.6g\n", name, median, 1e3 * errors.largest, 1e3 * errors.rms, 1e3 * errors.largest_displacement, part);
        printf("%-12s %14.2f %18.3f %14.3f %10.2f\n", name, median, 1e3 * errors.largest, 1e3 * errors.rms, part);
    }
    int failed = ferror(file) | fclose(file);
    return failed ? pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno)) : PLIANT_OK;
}

static pliant_status write_row(const deform_arguments *arguments, const deform_inputs *inputs, const deform_run *runs)
{
    picture_row row = {.num_volumes = 1 + arguments->num_compared};
    pliant_status status = picture_window(&inputs->scan, &row.low, &row.high);
    if (status < 0) return status;
    deform_picture_point(&runs[0], row.point);
    row.volumes[0] = &inputs->scan;
    memcpy(row.marks[0], row.point, sizeof row.point);
    for (int m = 0; m < arguments->num_compared; ++m) {
        const pliant_data *data = runs[m].data;
        row.volumes[1 + m] = pliant_warp_volume(pliant_data_get_warp(data));
        pliant_tool_state tool;
        const bool any = pliant_data_get_num_tools(data) > 0 && pliant_tool_get(data, 0, &tool) >= 0;
        memcpy(row.marks[1 + m], any ? tool.held_point : row.point, sizeof row.point);
    }
    return picture_write_row(arguments->folder, &row);
}

pliant_status deform_compare(const deform_arguments *arguments, const deform_inputs *inputs)
{
    deform_run runs[PLIANT_NUM_METHODS];
    char folders[PLIANT_NUM_METHODS][4096];
    pliant_status status = PLIANT_OK;
    uint32_t methods = 0;
    const char *why;
    int done = 0;
    for (int m = 0; m < arguments->num_compared; ++m) methods |= 1u << arguments->compared[m];
    const pliant_element_kind elements = pliant_scene_element_kind_of_methods(&arguments->scene, methods, &why);
    if (why) pliant_log(PLIANT_LOG_INFO, "element/kind: auto is linear for all that is compared; %s", why);
    for (; status >= 0 && done < arguments->num_compared && !console_stop_asked(); ++done) {
        deform_run *run = &runs[done];
        *run = (deform_run){.arguments = arguments, .inputs = inputs, .scene = arguments->scene, .folder = folders[done]};
        run->scene.model.method = arguments->compared[done];
        run->scene.element.kind = elements;
        run->scene.choose.budget_ms = 0.0;
        snprintf(folders[done], sizeof folders[done], "%s/%s", arguments->folder, deform_method_name(arguments->compared[done]));
        printf("\n%s\n", deform_method_name(arguments->compared[done]));
        status = deform_run_do(run);
    }
    if (status >= 0 && !console_stop_asked()) status = write_table(arguments, runs);
    if (status >= 0 && !console_stop_asked() && arguments->pictures) status = write_row(arguments, inputs, runs);
    while (done-- > 0) deform_run_free(&runs[done]);
    return status;
}
