/* pliant_report: measure accuracy against run time on the user's scan, stability, and the cost of each stage. */
#define _POSIX_C_SOURCE 200809L
#include "choice_output.h"
#include "base/clock.h"
#include "command_line.h"
#include "console.h"
#include "base/fail.h"
#include "pliant/pliant.h"
#include "report_arguments.h"
#include "report_plot.h"
#include "sim/build/model.h"

#include <stdio.h>
#include <string.h>


typedef struct report_program {
    report_arguments *arguments;
    pliant_volume scan;
    pliant_labels labels;
    pliant_material_table materials;
    pliant_report_input input;
    pliant_report_tables tables;
    char setup[9], stability_setup[9];
    pliant_verdict worst;
} report_program;

/* Hundreds of models and runs write log lines, so only warnings and errors are printed. */
static void print_warning(pliant_log_level level, const char *message, void *user)
{
    (void)user;
    if (level < PLIANT_LOG_WARNING) return;
    console_progress_end();
    fprintf(stderr, "%s: %s\n", level == PLIANT_LOG_WARNING ? "warning" : "error", message);
}

static pliant_status read_inputs(report_program *program)
{
    report_arguments *arguments = program->arguments;
    pliant_sweep *sweep = &arguments->sweep;
    double start = pliant_seconds();
    if (!arguments->scan) return PLIANT_OK;
    pliant_status status =
        pliant_inputs_read(&arguments->scene, arguments->scan, &program->scan, &program->labels, &program->materials);
    if (status < 0) return status;
    program->input = (pliant_report_input){&arguments->scene, &program->scan,
                                           program->labels.voxels ? &program->labels : NULL, &program->materials};
    const int32_t *size = program->scan.geometry.size;
    printf("%s: %d x %d x %d voxels, read in %.2f s\n", program->scan.id, (int)size[0], (int)size[1], (int)size[2],
           pliant_seconds() - start);
    double scale;
    status = pliant_length_scale(&program->scan, program->input.labels, &program->materials, &scale);
    if (status < 0) return status;
    for (int d = 0; d < 3 && !arguments->pull_given; d++) sweep->pull[d] *= scale;
    if (sweep->num_points == 0)
        sweep->num_points =
            pliant_pull_points(&program->input, arguments->labels, arguments->num_labels,
                               arguments->num_labels ? arguments->num_labels : arguments->num_points, sweep->points);
    if (sweep->num_points == 0)
        return pliant_fail(
            PLIANT_ERROR_SCENE,
            "no soft tissue was found to pull at: give a point with --at X,Y,Z, or labels that occur with --labels");
    for (int p = 0; p < sweep->num_points; p++) {
        const double *at = sweep->points[p].rest;
        printf("pull at %s: (%.4f %.4f %.4f) m\n", sweep->points[p].name, at[0], at[1], at[2]);
    }
    pliant_report_setup(&program->input, sweep, program->setup);
    return PLIANT_OK;
}

static pliant_status run_stability(report_program *program)
{
    report_arguments *arguments = program->arguments;
    const pliant_report_input *input = arguments->scan && arguments->stability_on_scan ? &program->input : NULL;
    /* The tests provoke errors, which are written to the table instead of the screen. */
    pliant_set_log(NULL, NULL);
    arguments->stability.scene = &arguments->scene;
    pliant_status status =
        pliant_stability_run(input, &arguments->stability, &program->tables, console_progress(), &program->worst);
    pliant_set_log(print_warning, NULL);
    console_progress_end();
    if (status < 0 && status != PLIANT_ERROR_CANCELLED) pliant_log(PLIANT_LOG_ERROR, "%s", pliant_last_error());
    return status;
}

/* @param alone whether an impossible estimate is an error; next to other reports it is a warning */
static pliant_status run_truth(report_program *program, bool alone)
{
    pliant_truth worst;
    if (!alone) pliant_set_log(NULL, NULL);
    pliant_status status =
        pliant_truth_run(&program->input, &program->arguments->sweep, &program->tables, console_progress(), &worst);
    console_progress_end();
    pliant_set_log(print_warning, NULL);
    if (alone || status != PLIANT_ERROR_SCENE) return status;
    pliant_log(PLIANT_LOG_WARNING, "%s", pliant_last_error());
    return PLIANT_OK;
}

/* ---- summary */

static const char *cell(const pliant_results *table, size_t row, const char *name)
{
    return pliant_results_cell(table, row, pliant_results_column(table, name));
}

static void print_sweep(const pliant_results *table, const char *setup)
{
    printf("\n%-10s %-5s %-22s %-10s %-12s %-12s %9s %9s %9s %9s\n", "method", "ratio", "submesh, variant", "budget",
           "case", "point", "solver ms", "max %", "rms %", "max mm");
    for (size_t r = 0; r < pliant_results_rows(table); r++) {
        if (strcmp(pliant_results_cell(table, r, 0), setup) != 0) continue;
        printf("%-10s %-5s %-10s %-11s %-10s %-12s %-12s %9s %9s %9s %9s %s\n", cell(table, r, "method"),
               cell(table, r, "ratio"), cell(table, r, "submesh"), cell(table, r, "variant"), cell(table, r, "budget"),
               cell(table, r, "case"), cell(table, r, "point"), cell(table, r, "solver_median_ms"),
               cell(table, r, "max_percent"), cell(table, r, "rms_percent"), cell(table, r, "max_mm"),
               cell(table, r, "message"));
    }
}

static void print_truth(const pliant_results *table, const char *setup)
{
    bool any = false;
    for (size_t r = 0; r < pliant_results_rows(table); r++) {
        if (strcmp(pliant_results_cell(table, r, 0), setup) != 0) continue;
        if (!any)
            printf("\n%-12s %-12s %-12s %12s %14s %14s %14s %14s   95th percentiles, of the largest displacement\n",
                   "case", "point", "law", "largest mm", "mesh off by %", "at twice %", "solver off by %",
                   "laws apart %");
        any = true;
        printf("%-12s %-12s %-12s %12s %14s %14s %14s %14s   %s\n", cell(table, r, "case"), cell(table, r, "point"),
               cell(table, r, "law"), cell(table, r, "largest_mm"), cell(table, r, "mesh_p95_percent"),
               cell(table, r, "mesh_p95_percent_refined"), cell(table, r, "solver_p95_percent"),
               cell(table, r, "law_distance_p95_percent"), cell(table, r, "advice"));
    }
}

static void print_validation(const pliant_results *table)
{
    printf("\n%-16s %-22s %-10s %8s %14s %14s %10s %8s %12s %14s   distances of markers, root mean square\n", "body",
           "state", "role", "markers", "moved mm", "off by mm", "most mm", "off by %", "spread mm", "deviation mm");
    for (size_t r = 0; r < pliant_results_rows(table); r++)
        printf("%-16s %-22s %-10s %8s %14s %14s %10s %8s %12s %14s   %s\n", cell(table, r, "body"),
               cell(table, r, "state"), cell(table, r, "role"), cell(table, r, "markers"),
               cell(table, r, "moved_rms_mm"), cell(table, r, "rms_mm"), cell(table, r, "max_mm"),
               cell(table, r, "percent"), cell(table, r, "spread_mm"), cell(table, r, "deviation_mm"),
               cell(table, r, "fitted"));
}

static void print_stages(const pliant_results *table, const char *setup)
{
    printf("\n%-12s %14s %10s %10s %10s\n", "omitted", "frame [ms]", "saved", "held [MB]", "saved");
    for (size_t r = 0; r < pliant_results_rows(table); r++)
        if (strcmp(pliant_results_cell(table, r, 0), setup) == 0)
            printf("%-12s %14s %10s %10s %10s\n", cell(table, r, "omitted"), cell(table, r, "frame_median_ms"),
                   cell(table, r, "saved_ms"), cell(table, r, "held_mb"), cell(table, r, "saved_mb"));
}

static void print_dynamics(const pliant_results *table, const char *setup)
{
    static const char *const names[] = {
        "message",       "fine_tetrahedra",   "edge_bound_us",   "eigenvalue_bound_us",    "time_step_us",
        "steps_a_frame", "step_median_ms",    "frame_median_ms", "tetrahedra_steps_per_s", "energy_drift_percent",
        "time_error_mm", "time_error_percent"};
    for (size_t r = 0; r < pliant_results_rows(table); r++) {
        if (strcmp(pliant_results_cell(table, r, 0), setup) != 0) continue;
        printf("\nexplicit dynamics\n");
        for (size_t n = 0; n < sizeof names / sizeof *names; n++)
            if (cell(table, r, names[n])[0]) printf("  %-24s %s\n", names[n], cell(table, r, names[n]));
    }
}

static void print_stability(const pliant_results *table)
{
    int counts[PLIANT_VERDICT_BROKEN + 1] = {0};
    for (size_t r = 0; r < pliant_results_rows(table); r++) {
        const char *verdict = cell(table, r, "verdict");
        for (int v = 0; v <= PLIANT_VERDICT_BROKEN; v++)
            counts[v] += strcmp(verdict, pliant_verdict_name((pliant_verdict)v)) == 0;
        if (strcmp(verdict, "converged") == 0) continue;
        printf("%-18s %-34s %-10s %-9s %s\n", cell(table, r, "case"), cell(table, r, "parameter"),
               cell(table, r, "method"), verdict, cell(table, r, "message"));
    }
    printf("stability: %d converged, %d refused, %d degraded, %d broken\n", counts[0], counts[1], counts[2], counts[3]);
}

static pliant_status run(report_program *program)
{
    report_arguments *arguments = program->arguments;
    pliant_status status = command_line_folder(arguments->folder);
    if (status >= 0) status = pliant_report_open(arguments->folder, &program->tables);
    if (status >= 0) status = read_inputs(program);
    if (status < 0) return status;
    for (int m = 0; status >= 0 && m < arguments->num_parts; m++)
        status = pliant_report_merge(arguments->parts[m], arguments->folder, &program->tables);
    if (status < 0) return status;
    const size_t merged = pliant_results_rows(program->tables.sweep);
    if (arguments->num_parts && !arguments->scan && merged > 0) /* the last rows are printed */
        snprintf(program->setup, sizeof program->setup, "%s",
                 pliant_results_cell(program->tables.sweep, merged - 1, 0));
    bool choosable = arguments->sweep.shard <= 1 && arguments->scene.solver.kind == PLIANT_COROTATIONAL &&
                     arguments->scene.mesh.kind == PLIANT_LATTICE && !arguments->scene.mesh.file[0];
    if (arguments->do_sweep && choosable) { /* record the settings that a load of this scene would choose */
        pliant_choice choice;
        status = choice_output(&program->input, arguments->folder, arguments->pictures, &choice);
    }
    if (status >= 0 && arguments->do_sweep)
        status = pliant_sweep_run(&program->input, &arguments->sweep, arguments->folder, &program->tables,
                                  console_progress());
    if (status >= 0 && arguments->do_truth)
        status = run_truth(program, !arguments->do_sweep && !arguments->do_ablation);
    /* a scene that cannot be swept (tled on a ground plane) can still have the other reports */
    pliant_status swept = status;
    if (status == PLIANT_ERROR_SCENE) status = PLIANT_OK;
    if (status >= 0 && arguments->do_ablation)
        status = pliant_ablation_run(&program->input, &arguments->sweep, &program->tables, console_progress());
    if (status >= 0 && arguments->scene.solver.kind == PLIANT_TLED && (arguments->do_sweep || arguments->do_ablation))
        status = pliant_dynamics_run(&program->input, &arguments->sweep, &program->tables, console_progress());
    for (int m = 0; status >= 0 && m < arguments->num_measured; m++)
        status = pliant_validation_run(arguments->measured[m], arguments->num_names, arguments->names, &program->tables,
                                       console_progress());
    console_progress_end();
    if (status >= 0 && arguments->do_stability) status = run_stability(program);
    return status < 0 ? status : swept;
}

static pliant_status finish(report_program *program)
{
    report_arguments *arguments = program->arguments;
    bool drawn = false;
    if ((arguments->do_sweep && arguments->scan) || arguments->num_parts)
        print_sweep(program->tables.sweep, program->setup);
    if (arguments->do_truth && arguments->scan) print_truth(program->tables.truth, program->setup);
    if (arguments->num_measured) print_validation(program->tables.validation);
    if (arguments->do_ablation && arguments->scan) print_stages(program->tables.stages, program->setup);
    if (arguments->scan) print_dynamics(program->tables.dynamics, program->setup);
    if (arguments->do_stability) print_stability(program->tables.stability);
    pliant_status status = pliant_report_json(arguments->folder, program->setup, &arguments->scene, &program->tables);
    fflush(stdout);
    if (status >= 0 && arguments->pictures) status = report_plot(arguments->folder, program->setup, &drawn);
    printf("results in %s\n", arguments->folder);
    return status;
}

int main(int argc, char **argv)
{
    report_arguments arguments;
    report_program program = {.arguments = &arguments};
    int exit_code;
    if (!report_arguments_read(argc, argv, &arguments, &exit_code)) return exit_code;
    console_start(arguments.quiet ? PLIANT_LOG_WARNING : PLIANT_LOG_INFO);
    pliant_set_log(print_warning, NULL);
    pliant_status status = run(&program);
    bool stopped = console_stop_requested();
    if (program.tables.sweep && (status >= 0 || status == PLIANT_ERROR_SCENE || stopped)) {
        pliant_status finished = finish(&program);
        if (status >= 0) status = finished;
    }
    pliant_report_close(&program.tables);
    pliant_material_table_free(&program.materials);
    pliant_labels_free(&program.labels);
    pliant_volume_free(&program.scan);
    if (stopped) return EXIT_STOPPED;
    return status < 0 || program.worst == PLIANT_VERDICT_BROKEN ? EXIT_FAILED : EXIT_OK;
}
