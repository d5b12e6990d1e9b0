#include "deform_compare.h"

#include "base/fail.h"
#include "pliant/report.h"
#include "command_line.h"
#include "console.h"
#include "deform_output.h"
#include "picture.h"
#include "scene/scene.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

/* Errors over the voxels with tissue and a value of at least --min-value: distance from the tissue's position in the
 * reference, and displacement in the reference ([H] figure 2). */
typedef struct run_errors {
    pliant_error difference, moved; /* [m] */
} run_errors;

static pliant_status summarize(const deform_run *run, const deform_run *other, const double *positions,
                               pliant_error *out)
{
    const pliant_volume *shown = run->arguments->volume ? pliant_warp_volume(pliant_data_get_warp(run->data)) : NULL;
    const pliant_geometry *target = shown ? &shown->geometry : &run->inputs->scan.geometry;
    pliant_volume voxels;
    uint64_t count;
    pliant_status status = pliant_error_voxels(run->model, pliant_data_get_positions(run->data, NULL),
                                               &pliant_data_get_body(other->data)->fine, positions, target, &voxels);
    if (status < 0) return status;
    const size_t size = pliant_geometry_voxels(target);
    for (size_t v = 0; shown && v < size; ++v)
        /* excluded like a voxel without tissue */
        if (pliant_volume_value(shown, v) < run->arguments->min_value) ((float *)voxels.voxels)[v] = -1;
    status = pliant_error_histogram(&voxels, 1, 1.0, &count, out);
    pliant_volume_free(&voxels);
    return status;
}

static pliant_status errors_of(const deform_run *run, const deform_run *reference, run_errors *out)
{
    pliant_status status =
        summarize(run, reference, pliant_data_get_positions(reference->data, NULL), &out->difference);
    return status < 0 ? status
                      : summarize(reference, reference, pliant_data_get_body(reference->data)->fine.rest, &out->moved);
}

static pliant_status write_table(const deform_arguments *arguments, const deform_run *runs)
{
    const deform_run *reference = &runs[arguments->num_compared - 1];
    const char *reference_name = deform_method_name(reference->scene.model.method);
    char path[4096];
    snprintf(path, sizeof path, "%s/compare.csv", arguments->folder);
    FILE *file = fopen(path, "w");
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    fputs(
        "method,step_median_ms,largest_error_mm,rms_error_mm,largest_displacement_mm,largest_error_percent,"
        "p95_error_mm\n",
        file);
    printf("\n%-12s %14s %18s %14s %10s   of voxels with tissue, against %s\n", "method", "step [ms]",
           "largest error [mm]", "rms [mm]", "[%]", reference_name);
    pliant_status status = PLIANT_OK;
    for (int m = 0; status >= 0 && m < arguments->num_compared; ++m) {
        const char *name = deform_method_name(runs[m].scene.model.method);
        run_errors errors;
        if ((status = errors_of(&runs[m], reference, &errors)) < 0) break;
        const pliant_error *difference = &errors.difference;
        double median = 1e3 * runs[m].times.median,
               part = errors.moved.max > 0.0 ? 100.0 * difference->max / errors.moved.max : 0.0;
        fprintf(file, "%s,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n", name, median, 1e3 * difference->max, 1e3 * difference->rms,
                1e3 * errors.moved.max, part, 1e3 * difference->p95);
        printf("%-12s %14.2f %18.3f %14.3f %10.2f\n", name, median, 1e3 * difference->max, 1e3 * difference->rms, part);
    }
    int failed = ferror(file) | fclose(file);
    return status < 0 ? status : failed ? pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno)) : PLIANT_OK;
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
    const char *why;
    int done = 0;
    const pliant_element_kind elements = pliant_scene_element_kind(&arguments->scene, &why);
    if (why) pliant_log(PLIANT_LOG_INFO, "element/kind: auto is linear for all that is compared; %s", why);
    for (; status >= 0 && done < arguments->num_compared && !console_stop_requested(); ++done) {
        deform_run *run = &runs[done];
        *run =
            (deform_run){.arguments = arguments, .inputs = inputs, .scene = arguments->scene, .folder = folders[done]};
        run->scene.model.method = arguments->compared[done];
        run->scene.element.kind = elements;
        run->scene.choose.budget_ms = 0.0;
        snprintf(folders[done], sizeof folders[done], "%s/%s", arguments->folder,
                 deform_method_name(arguments->compared[done]));
        printf("\n%s\n", deform_method_name(arguments->compared[done]));
        status = deform_run_execute(run);
    }
    if (status >= 0 && !console_stop_requested()) status = write_table(arguments, runs);
    if (status >= 0 && !console_stop_requested() && arguments->pictures) status = write_row(arguments, inputs, runs);
    while (done-- > 0) deform_run_free(&runs[done]);
    return status;
}
