#include "deform_run.h"

#include "base/clock.h"
#include "base/fail.h"
#include "choice_output.h"
#include "command_line.h"
#include "console.h"
#include "deform_output.h"
#include "pliant/report.h"
#include "sim/build/model.h"

#include <math.h>

enum { MAX_SETTLING_STEPS = 200 };

pliant_status deform_inputs_read(const deform_arguments *arguments, deform_inputs *out)
{
    double start = pliant_seconds();
    deform_inputs inputs = {.path = {.tools = NULL}};
    pliant_status status = arguments->tools ? pliant_path_read(arguments->tools, &inputs.path) : PLIANT_OK;
    if (status >= 0)
        status =
            pliant_inputs_read(&arguments->scene, arguments->scan, &inputs.scan, &inputs.labels, &inputs.materials);
    if (status < 0) {
        deform_inputs_free(&inputs);
        return status;
    }
    const int32_t *size = inputs.scan.geometry.size;
    printf("%s: %d x %d x %d voxels, read in %.2f s\n", inputs.scan.id, (int)size[0], (int)size[1], (int)size[2],
           pliant_seconds() - start);
    *out = inputs;
    return PLIANT_OK;
}

void deform_inputs_free(deform_inputs *inputs)
{
    pliant_path_free(&inputs->path);
    pliant_material_table_free(&inputs->materials);
    pliant_labels_free(&inputs->labels);
    pliant_volume_free(&inputs->scan);
}

/* Return the maximum distance by which a tool pulls its point [m]. Force-driven tools are skipped, because their
 * displacement is unknown. */
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

/* Create the deformed volume, which covers the scan and the tissue at rest with the scene's margin. */
static pliant_status create_deformed_volume(deform_run *run)
{
    const pliant_mesh *mesh = &pliant_data_get_body(run->data)->fine;
    const double margin = pliant_model_get_scene(run->model)->warp.margin, pull = farthest_pull(&run->inputs->path);
    pliant_geometry target;
    if (pull > margin)
        pliant_log(
            PLIANT_LOG_WARNING,
            "a tool pulls by %g m, but the margin around the tissue at rest is %g m: tissue outside the deformed "
            "volume is cut off; increase warp/margin",
            pull, margin);
    pliant_status status =
        pliant_warp_target(&run->inputs->scan.geometry, mesh->rest, mesh->num_nodes, margin, SIZE_MAX, &target);
    return status < 0 ? status : pliant_data_set_warp(run->model, run->data, &target);
}

static pliant_status step_through(deform_run *run)
{
    const deform_arguments *arguments = run->arguments;
    const pliant_path *path = &run->inputs->path;
    double dt = run->scene.solver.step;
    long moving = (long)ceil(pliant_path_end(path) / dt), requested = arguments->steps;
    long last = requested ? requested : moving + MAX_SETTLING_STEPS;
    for (long step = 1; step <= last && !console_stop_requested(); ++step) {
        double gravity[3];
        pliant_status status = deform_tools_move(&run->tools, run->model, run->data, step, (double)step * dt);
        if (status >= 0 && pliant_path_gravity(path, (double)step * dt, gravity))
            status = pliant_data_set_gravity(run->data, gravity);
        if (status < 0) return status;
        double start = pliant_seconds();
        pliant_status stepped = pliant_step(run->model, run->data);
        status = timing_add(&run->times, run->data, stepped, pliant_seconds() - start);
        if (status >= 0) status = deform_probes_add(&run->probes, path, run->data, (double)step * dt);
        if (stepped < 0) return stepped;
        if (status < 0) return status;
        deform_tools_report(&run->tools, run->data, step, (double)step * dt);
        if (arguments->every && step % arguments->every == 0) {
            status = deform_write(run, step);
            if (status < 0) return status;
        }
        const bool settling = !requested && step > moving;
        pliant_report_progress(console_progress(),
                               settling ? 1.0 : (double)step / (double)(requested ? requested : moving + 1),
                               settling ? "settling" : "steps");
        if (!requested && step > moving && stepped == PLIANT_OK) break;
    }
    console_progress_end();
    return PLIANT_OK;
}

static void warn_of_gravity(const deform_run *run)
{
    const pliant_path *path = &run->inputs->path;
    for (uint32_t k = 0; k < path->num_gravity; ++k) {
        const double *gravity = path->gravity[k].value;
        if (gravity[0] == 0.0 && gravity[1] == 0.0 && gravity[2] == 0.0) continue;
        pliant_gravity_warning(&run->scene, gravity);
        return;
    }
}

/* Print position, mass and fixed part of the tissue. These numbers reveal a wrong unit or a missed region. */
static void print_tissue_summary(const pliant_model *model)
{
    const pliant_body *body = pliant_model_get_body(model);
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, mass = 0.0;
    int fixed = 0;
    for (int32_t n = 0; n < body->fine.num_nodes; ++n) {
        for (int d = 0; d < 3; ++d) {
            low[d] = fmin(low[d], body->fine.rest[3 * n + d]);
            high[d] = fmax(high[d], body->fine.rest[3 * n + d]);
        }
        mass += body->node_mass[n];
        fixed += body->fine_fixed[n] != 0;
    }
    printf("tissue from (%.4f %.4f %.4f) to (%.4f %.4f %.4f) m, %.4g kg; %d of %d nodes are fixed\n", low[0], low[1],
           low[2], high[0], high[1], high[2], mass, fixed, (int)body->fine.num_nodes);
}

static pliant_status prepare(deform_run *run)
{
    const deform_arguments *arguments = run->arguments;
    const deform_inputs *inputs = run->inputs;
    pliant_choice choice;
    for (uint32_t t = 0; t < inputs->path.num_tools; t++)
        if (inputs->path.tools[t].shape.num_parts > 0) pliant_scene_for_shapes(&run->scene);
    pliant_report_input input = {&run->scene, &inputs->scan, inputs->labels.voxels ? &inputs->labels : NULL,
                                 &inputs->materials};
    pliant_status status = command_line_folder(run->folder);
    if (status >= 0) status = choice_output(&input, run->folder, arguments->pictures, &choice);
    if (status < 0) return status;
    run->scene = choice.scene;
    status =
        pliant_model_build(&run->scene, input.scan, input.labels, input.materials, console_progress(), &run->model);
    console_progress_end();
    if (status < 0) return status;
    print_tissue_summary(run->model);
    timing_print_build(run->model, stdout);
    status = timing_write_build(run->folder, run->model);
    if (status >= 0) status = pliant_data_create(run->model, &run->data);
    if (status >= 0 && arguments->volume) status = create_deformed_volume(run);
    warn_of_gravity(run);
    if (status >= 0) status = deform_tools_begin(&inputs->path, run->folder, run->model, run->data, &run->tools);
    if (status >= 0) status = timing_start(run->folder, &run->times);
    if (status >= 0) status = deform_probes_start(run->folder, &inputs->path, run->data, &run->probes);
    return status;
}

pliant_status deform_run_execute(deform_run *run)
{
    pliant_status status = prepare(run);
    if (status >= 0) {
        /* a failed step leaves the previous state, which is worth writing */
        pliant_status stepped = step_through(run);
        status = deform_write(run, 0);
        timing_print(&run->times, run->model, run->data, stdout);
        timing_print_memory(stdout);
        timing_warn(&run->times, run->model, run->data);
        printf("results in %s\n", run->folder);
        if (stepped < 0) status = stepped;
    }
    pliant_status written = timing_end(&run->times), probed = deform_probes_end(&run->probes);
    if (written >= 0) written = probed;
    pliant_status cut = deform_tools_end(&run->tools, run->data, pliant_path_end(&run->inputs->path));
    if (written >= 0) written = cut;
    return status >= 0 ? written : status;
}

void deform_run_free(deform_run *run)
{
    pliant_data_free(run->data);
    pliant_model_free(run->model);
    run->data = NULL;
    run->model = NULL;
}
