/* pliant_deform: a scan, a scene and a tool path in; deformed volumes, node positions and timings out. */
#define _POSIX_C_SOURCE 200809L
#include "choice_output.h"
#include "command_line.h"
#include "console.h"
#include "pliant/fail.h"
#include "deform_arguments.h"
#include "picture.h"
#include "pliant/pliant.h"
#include "timing.h"

#include <errno.h>
#include <math.h>
#include <string.h>

enum { MOST_SETTLING_STEPS = 200 };

typedef struct deform_run {
    const deform_arguments *arguments;
    pliant_volume scan;
    pliant_labels labels;
    pliant_material_table materials;
    pliant_path path;
    pliant_model *model;
    pliant_data *data;
    step_times times;
} deform_run;

static pliant_status write_nodes(const char *path, const pliant_model *model, const double *positions)
{
    FILE *file = fopen(path, "w");
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    fputs("rest_x_m,rest_y_m,rest_z_m,x_m,y_m,z_m\n", file);
    for (int32_t node = 0; node < model->body->fine.num_nodes; ++node) {
        const double *rest = model->body->fine.rest + 3 * node, *now = positions + 3 * node;
        fprintf(file, "%.9g,%.9g,%.9g,%.9g,%.9g,%.9g\n", rest[0], rest[1], rest[2], now[0], now[1], now[2]);
    }
    int failed = ferror(file) | fclose(file);
    return failed ? pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno)) : PLIANT_OK;
}

/* @param step 0: the end, without a number in the names */
static pliant_status write_results(const deform_run *run, long step)
{
    char path[4096], number[32] = "";
    const char *folder = run->arguments->folder;
    if (step > 0) snprintf(number, sizeof number, "_%06ld", step);
    snprintf(path, sizeof path, "%s/nodes%s.csv", folder, number);
    pliant_status status = write_nodes(path, run->model, run->data->positions);
    if (status < 0 || !run->data->warp) return status;
    snprintf(path, sizeof path, "%s/deformed%s.nii.gz", folder, number);
    return pliant_volume_write(path, pliant_warp_volume(run->data->warp));
}

/* The farthest that a tool pulls its point [m]; how far a force pulls is not known before. */
static double farthest_pull(const pliant_path *path)
{
    double farthest = 0.0;
    for (uint32_t n = 0; n < path->num_tools; ++n)
        for (uint32_t k = 0; path->tools[n].drive != PLIANT_DRIVE_FORCE && k < path->tools[n].num_motion; ++k) {
            const double *offset = path->tools[n].motion[k].value;
            farthest = fmax(farthest, sqrt(offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2]));
        }
    return farthest;
}

/* The deformed volume covers the scan, and the tissue at rest with room around it: the scene's margin, or the way that a
 * tool takes it if that is more. */
static pliant_status ask_for_volume(deform_run *run)
{
    const pliant_mesh *mesh = &run->model->body->fine;
    double room = fmax(run->model->scene.warp.margin, farthest_pull(&run->path));
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    pliant_geometry target;
    for (int32_t n = 0; n < 3 * mesh->num_nodes; ++n) {
        low[n % 3] = fmin(low[n % 3], mesh->rest[n] - room);
        high[n % 3] = fmax(high[n % 3], mesh->rest[n] + room);
    }
    pliant_status status = pliant_warp_target(&run->scan.geometry, low, high, SIZE_MAX, &target);
    return status < 0 ? status : pliant_data_warp(run->model, run->data, &target);
}

static pliant_status grasp(deform_run *run)
{
    for (uint32_t n = 0; n < run->path.num_tools; ++n) {
        const pliant_path_tool *tool = &run->path.tools[n];
        const double none[3] = {0.0, 0.0, 0.0};
        int index;
        pliant_status status = pliant_tool_add(run->model, run->data, tool->name, &index);
        if (status >= 0) status = pliant_tool_pose(run->data, index, tool->grasp, NULL);
        if (status >= 0) status = pliant_tool_grasp(run->model, run->data, index, tool->grasp);
        if (status >= 0) status = pliant_tool_drive(run->data, index, tool->drive, tool->drive == PLIANT_DRIVE_FORCE ? none : NULL);
        if (status < 0) return status;
    }
    return PLIANT_OK;
}

/* Tools were added in the order of the path, to a data without any: their indices agree. */
static pliant_status move_tools(deform_run *run, double time)
{
    for (uint32_t n = 0; n < run->path.num_tools; ++n) {
        const pliant_path_tool *tool = &run->path.tools[n];
        double value[3], tip[3];
        pliant_status status;
        if (!pliant_path_at(tool, time, value)) {
            pliant_tool_release(run->data, (int)n);
            continue;
        }
        for (int d = 0; d < 3; ++d) tip[d] = tool->grasp[d] + value[d];
        if (tool->drive == PLIANT_DRIVE_FORCE)
            status = pliant_tool_drive(run->data, (int)n, tool->drive, value);
        else
            status = pliant_tool_pose(run->data, (int)n, tip, NULL);
        if (status < 0) return status;
    }
    return PLIANT_OK;
}

static pliant_status step_through(deform_run *run)
{
    double dt = run->model->scene.solver.step;
    long moving = (long)ceil(pliant_path_end(&run->path) / dt), asked = run->arguments->steps;
    long last = asked ? asked : moving + MOST_SETTLING_STEPS;
    pliant_status stepped = PLIANT_OK;
    for (long step = 1; step <= last && !console_stop_asked(); ++step) {
        double gravity[3];
        pliant_status status = move_tools(run, (double)step * dt);
        if (status >= 0 && pliant_path_gravity(&run->path, (double)step * dt, gravity)) status = pliant_data_gravity(run->data, gravity);
        if (status < 0) return status;
        double start = pliant_seconds();
        stepped = pliant_step(run->model, run->data);
        status = timing_add(&run->times, run->data, stepped, pliant_seconds() - start);
        if (stepped < 0) return stepped;
        if (status < 0) return status;
        if (run->arguments->every && step % run->arguments->every == 0) {
            status = write_results(run, step);
            if (status < 0) return status;
        }
        pliant_report_progress(console_progress(), (double)step / (double)(asked ? asked : moving + 1), "steps");
        if (!asked && step > moving && stepped == PLIANT_OK) break;
    }
    console_progress_end();
    return PLIANT_OK;
}

static pliant_status prepare(deform_run *run)
{
    const deform_arguments *arguments = run->arguments;
    double start = pliant_seconds();
    pliant_choice choice;
    pliant_status status = command_line_folder(arguments->folder);
    if (status >= 0 && arguments->tools) status = pliant_path_read(arguments->tools, &run->path);
    if (status >= 0)
        status = pliant_inputs_read(&arguments->scene, arguments->scan, &run->scan, &run->labels, &run->materials);
    if (status < 0) return status;
    const int32_t *size = run->scan.geometry.size;
    printf("%s: %d x %d x %d voxels, read in %.2f s\n", run->scan.id, (int)size[0], (int)size[1], (int)size[2],
           pliant_seconds() - start);
    pliant_report_input input = {&arguments->scene, &run->scan, run->labels.voxels ? &run->labels : NULL, &run->materials};
    status = choice_output(&input, arguments->folder, arguments->pictures, &choice);
    if (status < 0) return status;
    status = pliant_model_build(&choice.scene, input.scan, input.labels, input.materials, console_progress(), &run->model);
    console_progress_end();
    if (status < 0) return status;
    timing_print_build(run->model, stdout);
    status = timing_write_build(arguments->folder, run->model);
    if (status >= 0) status = pliant_data_create(run->model, &run->data);
    if (status >= 0 && arguments->volume) status = ask_for_volume(run);
    for (uint32_t k = 0; status >= 0 && k < run->path.num_gravity; ++k) {
        const double *gravity = run->path.gravity[k].value;
        if (gravity[0] == 0.0 && gravity[1] == 0.0 && gravity[2] == 0.0) continue;
        pliant_gravity_warning(&run->model->scene, gravity);
        break;
    }
    if (status >= 0) status = grasp(run);
    if (status >= 0) status = timing_start(arguments->folder, &run->times);
    return status;
}

static pliant_status write_pictures(const deform_run *run)
{
    const pliant_geometry *geometry = &run->scan.geometry;
    picture_view view;
    pliant_status status = picture_window(&run->scan, &view.low, &view.high);
    if (status < 0) return status;
    double centre[3];
    for (int d = 0; d < 3; ++d) centre[d] = 0.5 * (geometry->size[d] - 1);
    pliant_geometry_to_world(geometry, centre, view.before_point);
    if (run->path.num_tools > 0) memcpy(view.before_point, run->path.tools[0].grasp, sizeof view.before_point);
    memcpy(view.after_point, view.before_point, sizeof view.after_point);
    if (run->data->num_tools > 0 && run->data->tools[0].holding)
        memcpy(view.after_point, run->data->tools[0].held_point, sizeof view.after_point);
    return picture_write(run->arguments->folder, &run->scan, pliant_warp_volume(run->data->warp), &view);
}

static pliant_status finish(deform_run *run)
{
    pliant_status status = write_results(run, 0);
    if (status >= 0 && run->arguments->pictures) status = write_pictures(run);
    timing_print(&run->times, run->data, stdout);
    timing_print_memory(stdout);
    timing_warn(&run->times, run->model, run->data);
    printf("results in %s\n", run->arguments->folder);
    return status;
}

int main(int argc, char **argv)
{
    deform_arguments arguments;
    int exit_code;
    if (!deform_arguments_read(argc, argv, &arguments, &exit_code)) return exit_code;
    console_start(arguments.quiet ? PLIANT_LOG_WARNING : PLIANT_LOG_INFO);

    deform_run run = {.arguments = &arguments};
    pliant_status status = prepare(&run);
    if (status >= 0) {
        /* a step that broke down leaves the state before it, which is worth having */
        pliant_status stepped = step_through(&run);
        status = finish(&run);
        if (stepped < 0) status = stepped;
    }
    pliant_status written = timing_end(&run.times);
    if (status >= 0) status = written;
    pliant_data_free(run.data);
    pliant_model_free(run.model);
    pliant_path_free(&run.path);
    pliant_material_table_free(&run.materials);
    pliant_labels_free(&run.labels);
    pliant_volume_free(&run.scan);
    if (console_stop_asked()) return EXIT_STOPPED;
    return status < 0 ? EXIT_FAILED : EXIT_OK;
}
