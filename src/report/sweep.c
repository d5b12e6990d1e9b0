/* Measure error against run time: every method, ratio, variant and budget with the same load cases. */
#include "base/fail.h"
#include "fem/patch/patch.h"
#include "scene/scene.h"
#include "base/memory.h"
#include "report/sweep.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define NAME(name, yaml) #yaml,
static const char *const method_names[] = {PLIANT_METHOD_LIST(NAME)};
static const char *const submesh_names[] = {PLIANT_SUBMESH_EXTENT_LIST(NAME)};
#undef NAME
enum {
    NUM_METHODS = sizeof method_names / sizeof *method_names,
    NUM_SUBMESHES = sizeof submesh_names / sizeof *submesh_names
};

/* Return the methods that support the scene's elements. */
static uint32_t with_elements(const pliant_scene *scene)
{
    const bool linear = pliant_scene_element_kind(scene, NULL) == PLIANT_LINEAR;
    uint32_t methods = 0;
    pliant_scene other = *scene;
    other.element.kind = PLIANT_ELEMENT_AUTO;
    for (int m = 0; m < NUM_METHODS; m++) {
        other.model.method = (pliant_method)m;
        if (linear || pliant_scene_element_kind(&other, NULL) == PLIANT_HEXAHEDRA) methods |= 1u << m;
    }
    return methods;
}

void pliant_sweep_defaults(const pliant_scene *scene, pliant_sweep *out)
{
    static const int32_t iterations[] = {1, 2, 4, 0}, relaxation[] = {30, 100, 300, 0};
    const bool tled = scene->solver.kind == PLIANT_TLED;
    const int32_t *budgets = tled ? relaxation : iterations;
    memset(out, 0, sizeof *out);
    out->methods =
        tled || scene->mesh.kind == PLIANT_OCTREE || scene->mesh.file[0] ? 1u << PLIANT_FINE : with_elements(scene);
    out->ratios[out->num_ratios++] = scene->mesh.ratio;
    for (size_t b = 0; b < sizeof iterations / sizeof *iterations; b++)
        out->iterations[out->num_iterations++] = budgets[b];
    const double pull[3] = {0.004, -0.029, 0.006}; /* 3 cm, mainly forward with components along all axes */
    /* strains so small that all material laws agree with Hooke's law */
    for (int d = 0; d < 3; d++) out->pull[d] = tled ? 0.01 * pull[d] : pull[d];
    out->cases = (1u << NUM_CASES) - 1;
    out->frames = 30;
    out->repeats = 1;
    out->reference_tolerance = 1e-6;
    out->max_refined_tets = 1.5e5;
    out->warp = true;
}

static pliant_status check(const pliant_sweep *sweep)
{
    if (!sweep->methods || sweep->num_ratios < 1 || sweep->num_iterations < 1 || sweep->frames < 1)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "a sweep needs a method, a ratio, a budget and a frame");
    if (sweep->cases >> CASE_force & 1 && !(sweep->cases >> CASE_displacement & 1))
        return pliant_fail(PLIANT_ERROR_ARGUMENT,
                           "a sweep of forces also needs a displacement, from which it computes the force");
    for (int r = 0; r < sweep->num_ratios; r++)
        if (sweep->ratios[r] < 1 || sweep->ratios[r] > 8)
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "ratio is %d; use 1 to 8", sweep->ratios[r]);
    for (int b = 0; b < sweep->num_iterations; b++)
        if (sweep->iterations[b] < 0)
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "the budget is %d iterations; use 0 or more",
                               sweep->iterations[b]);
    if (sweep->shards != 0 && (sweep->shard < 1 || sweep->shard > sweep->shards))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "part is %d of %d; use 1 to %d", sweep->shard, sweep->shards,
                           sweep->shards);
    return PLIANT_OK;
}

/* ---- keys */

static void model_key(const sweep_state *state, int method, int submesh, bool before_patch, report_row *row)
{
    char variant[sizeof state->variant + sizeof SWEEP_BEFORE_PATCH + 1];
    snprintf(variant, sizeof variant, "%s%s%s", state->variant, before_patch && state->variant[0] ? " " : "",
             before_patch ? SWEEP_BEFORE_PATCH : "");
    row_clear(row);
    row_text(row, state->setup);
    row_integer(row, state->ground.scene.mesh.ratio);
    row_text(row, method_names[method]);
    row_text(row, method == PLIANT_SCHUR ? submesh_names[submesh] : "");
    row_text(row, variant);
}

/* @param row with MODEL_KEYS cells */
static void run_key(const sweep_ground *ground, int index, int budget, report_row *row)
{
    row_truncate(row, MODEL_KEYS);
    if (ground->sweep->iterations[budget] > 0) row_integer(row, ground->sweep->iterations[budget]);
    else row_text(row, "converged");
    row_text(row, report_case_name(ground->cases[index].kind));
    row_text(row, ground->point_names[index]);
}

static int num_submeshes(int method) { return method == PLIANT_SCHUR ? NUM_SUBMESHES : 1; }

/* Return whether a model belongs to this shard. Models are distributed cyclically in the order of their runs. */
static bool in_shard(const sweep_state *state, int method, int submesh)
{
    const pliant_sweep *sweep = state->ground.sweep;
    int models = 0, before = 0;
    for (int m = 0; m < NUM_METHODS; m++)
        for (int t = 0; (sweep->methods >> m & 1) && t < num_submeshes(m); t++, models++)
            before += m < method || (m == method && t < submesh);
    return sweep->shards == 0 || (state->grounds * models + before) % sweep->shards == sweep->shard - 1;
}

/* Count the runs of a model that are not in the table yet.
 * missing: Nullable, (cases) set to 1 for missing runs */
static int count_missing(const sweep_state *state, int method, int submesh, uint8_t *missing)
{
    const sweep_ground *ground = &state->ground;
    report_row row;
    int count = 0;
    if (!in_shard(state, method, submesh)) return 0;
    model_key(state, method, submesh, false, &row);
    size_t rows = pliant_results_rows(ground->tables->builds);
    int status = pliant_results_column(ground->tables->builds, "status");
    bool built = row_is_stored(&row, ground->tables->builds);
    for (size_t r = 0; built && r < rows; r++) { /* a rejected model has no runs */
        int same = 0;
        while (same < MODEL_KEYS &&
               strcmp(pliant_results_cell(ground->tables->builds, r, same), row.text + row.start[same]) == 0)
            same++;
        if (same == MODEL_KEYS && strcmp(pliant_results_cell(ground->tables->builds, r, status), "refused") == 0)
            return 0;
    }
    for (int c = 0; c < ground->num_cases; c++)
        for (int b = 0; b < ground->sweep->num_iterations; b++) {
            run_key(ground, c, b, &row);
            if (row_is_stored(&row, ground->tables->sweep)) continue;
            count++;
            if (missing) missing[c] = 1;
        }
    return count;
}

static int each_missing(const sweep_state *state, uint8_t *missing)
{
    int count = 0;
    for (int m = 0; m < NUM_METHODS; m++)
        for (int t = 0; (state->ground.sweep->methods >> m & 1) && t < num_submeshes(m); t++)
            count += count_missing(state, m, t, missing);
    return count;
}

/* Forward the progress. The current run may be cancelled at any time; the text of the run stays the same. */
static bool pass_progress(double fraction, const char *stage, void *user)
{
    const sweep_state *state = user;
    double done = state->total > 0 ? (double)state->done / state->total : 0;
    (void)fraction;
    (void)stage;
    return pliant_report_progress(state->progress, fmin(done, 1), state->activity);
}

static pliant_status begin(sweep_state *state, const char *format, ...) PLIANT_PRINTF(2, 3);
static pliant_status begin(sweep_state *state, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(state->activity, sizeof state->activity, format, arguments);
    va_end(arguments);
    return pass_progress(0, "", state)
               ? PLIANT_OK
               : pliant_fail(PLIANT_ERROR_CANCELLED, "the report was stopped; finished rows are kept");
}

static pliant_status build(sweep_state *state, const pliant_scene *scene, pliant_model **out, size_t *peak)
{
    const pliant_report_input *input = state->ground.input;
    pliant_progress progress = {pass_progress, state};
    size_t before = pliant_memory_in_use();
    pliant_memory_reset_peak();
    pliant_status status = pliant_model_build(scene, input->scan, input->labels, input->materials, progress, out);
    *peak = pliant_memory_peak() - before;
    return status;
}

/* ---- reference solutions */

void sweep_list_cases(sweep_ground *ground)
{
    const pliant_sweep *sweep = ground->sweep;
    ground->num_cases = 0;
    for (int p = 0; p < sweep->num_points; p++)
        for (int kind = 0; report_case_pulls((report_case_kind)kind); kind++) {
            if (!(sweep->cases >> kind & 1)) continue;
            report_case *load = ground->cases + ground->num_cases;
            *load = (report_case){.kind = (report_case_kind)kind, .frames = sweep->frames};
            memcpy(load->rest, sweep->points[p].rest, sizeof load->rest);
            memcpy(load->pull, sweep->pull, sizeof load->pull);
            ground->point_names[ground->num_cases++] = sweep->points[p].name;
        }
    const double *gravity = ground->input->scene->model.gravity;
    const bool wanted[NUM_CASES] = {
        [CASE_gravity] = true, [CASE_sag] = gravity[0] != 0 || gravity[1] != 0 || gravity[2] != 0};
    for (int kind = CASE_gravity; kind < NUM_CASES; kind++) {
        if (!wanted[kind] || !(sweep->cases >> kind & 1)) continue;
        ground->cases[ground->num_cases] =
            (report_case){.kind = (report_case_kind)kind, .frames = (kind == CASE_gravity ? 2 : 1) * sweep->frames};
        ground->point_names[ground->num_cases++] = "";
    }
}

static pliant_status run_reference(sweep_state *state, pliant_model *model, const pliant_points *points, int index,
                                   double tolerance, bool keep_last, sweep_reference *out)
{
    pliant_backend_choice backend = model->scene.solver.backend;
    report_limits limits = {.tolerance = tolerance, .iterates_to_tolerance = true, .progress = {pass_progress, state}};
    model->scene.solver.backend = PLIANT_CPU; /* the reference for all backends */
    pliant_status status = report_case_run(model, state->ground.cases + index, limits, points, NULL, &out->run);
    model->scene.solver.backend = backend;
    if (status < 0) return status;
    size_t nodes = 3 * (size_t)model->body->fine.num_nodes;
    if (keep_last) out->last = pliant_calloc(nodes, sizeof *out->last);
    if (keep_last && !out->last) return pliant_fail_memory("a reference solution");
    if (keep_last) memcpy(out->last, out->run.data->positions, nodes * sizeof *out->last);
    pliant_data_free(out->run.data);
    out->run.data = NULL;
    out->there = true;
    return PLIANT_OK;
}

/* Read a reference solution from the folder, or compute and store it.
 * @param activity text for the progress */
static pliant_status find_reference(sweep_state *state, pliant_model *model, const pliant_points *points, int index,
                                    double tolerance, bool keep_last, const char *activity, sweep_reference *out)
{
    const sweep_ground *ground = &state->ground;
    const sweep_reference_key kept = {index, model->body->fine.num_nodes, points->count, tolerance, keep_last};
    pliant_status status = sweep_reference_read(state, &kept, out);
    if (status >= 0 && !out->there) {
        status = begin(state, "ratio %d: %s, %s %s", model->scene.mesh.ratio, activity,
                       report_case_name(ground->cases[index].kind), ground->point_names[index]);
        if (status >= 0) status = run_reference(state, model, points, index, tolerance, keep_last, out);
        if (status >= 0) status = sweep_reference_write(state, &kept, out);
    }
    for (int32_t f = 0; status >= 0 && f < out->run.frames; f++) {
        pliant_error error;
        const double *at = out->run.positions + 3 * (size_t)f * (size_t)points->count;
        status = pliant_error_between(points->count, points->found, ground->rest, at, at, &error);
        if (status >= 0) out->largest = fmax(out->largest, error.largest);
    }
    return status;
}

/* Compute the references on the same mesh. A force case uses the force of the displacement case at the same point. */
static pliant_status solve_same(sweep_state *state, const uint8_t *missing)
{
    sweep_ground *ground = &state->ground;
    pliant_points points = {0};
    pliant_status status = pliant_points_create(&ground->fine->body->fine, ground->count, ground->rest, &points);
    for (int c = 0; status >= 0 && c < ground->num_cases; c++) {
        report_case *load = ground->cases + c;
        bool needed = missing[c] || (load->kind == CASE_displacement && missing[c + 1]);
        if (!needed) continue;
        if (load->kind == CASE_force) memcpy(load->force, ground->same[c - 1].run.force, sizeof load->force);
        status = find_reference(state, ground->fine, &points, c, ground->sweep->reference_tolerance, true, "reference",
                                ground->same + c);
    }
    pliant_points_free(&points);
    return status;
}

static pliant_status solve_refined(sweep_state *state, const uint8_t *missing)
{
    sweep_ground *ground = &state->ground;
    pliant_scene scene = ground->scene;
    pliant_model *model = NULL;
    size_t peak;
    /* one level deeper, also where the octree is homogeneous */
    for (int d = 0; scene.mesh.kind == PLIANT_OCTREE && d < 3; d++) scene.mesh.coarse_cells[d] *= 2;
    if (scene.mesh.kind == PLIANT_LATTICE) scene.mesh.ratio *= 2;
    scene.model.method = PLIANT_FINE;
    scene.solver.kind = PLIANT_COROTATIONAL;
    if (scene.mesh.file[0] || 8.0 * ground->fine->body->fine.num_tets > ground->sweep->max_refined_tets ||
        pliant_scene_check(&scene) < 0)
        return PLIANT_OK;
    pliant_status status =
        begin(state, "ratio %d: building the mesh of twice the resolution", ground->scene.mesh.ratio);
    if (status >= 0) status = build(state, &scene, &model, &peak);
    if (status >= 0)
        status = pliant_points_create(&model->body->fine, ground->count, ground->rest, &ground->refined_points);
    if (status >= 0) ground->refined_tets = model->body->fine.num_tets;
    for (int c = 0; status >= 0 && c < ground->num_cases; c++) {
        if (!missing[c]) continue;
        status = find_reference(state, model, &ground->refined_points, c, 10 * ground->sweep->reference_tolerance,
                                false, "twice the resolution", ground->refined + c);
    }
    pliant_model_free(model);
    return status;
}

pliant_status sweep_prepare(sweep_state *state, const uint8_t *missing)
{
    sweep_ground *ground = &state->ground;
    pliant_scene scene = ground->reference;
    scene.model.method = PLIANT_FINE;
    pliant_status status = begin(state, "ratio %d: building the reference", scene.mesh.ratio);
    if (status >= 0) status = build(state, &scene, &ground->fine, &ground->fine_peak);
    if (status >= 0) status = pliant_body_points(ground->fine, &ground->count, &ground->rest);
    if (status < 0) return status;
    status = report_target(ground->fine, &ground->target);
    if (status >= 0) status = solve_same(state, missing);
    if (status >= 0) status = solve_refined(state, missing);
    return status;
}

void sweep_free_ground(sweep_ground *ground)
{
    for (int c = 0; c < MAX_CASES; c++) {
        report_run_free(&ground->same[c].run);
        report_run_free(&ground->refined[c].run);
        pliant_free(ground->same[c].last);
        ground->same[c] = ground->refined[c] = (sweep_reference){0};
    }
    pliant_points_free(&ground->refined_points);
    pliant_free(ground->rest);
    pliant_model_free(ground->fine);
    ground->rest = NULL;
    ground->fine = NULL;
    ground->refined_tets = 0;
}

/* ---- runs */

/* Return the budget for per-voxel errors: the most accurate one. */
static int best_budget(const pliant_sweep *sweep)
{
    int best = 0;
    for (int b = 1; b < sweep->num_iterations; b++)
        if (sweep->iterations[best] != 0 &&
            (sweep->iterations[b] == 0 || sweep->iterations[b] > sweep->iterations[best]))
            best = b;
    return best;
}

/* Repeat a run; only lower times replace the first ones. */
static pliant_status repeat(const pliant_model *model, const report_case *load, report_limits limits,
                            const pliant_points *points, const pliant_geometry *target, report_run *run)
{
    report_run again = {0};
    pliant_status status = report_case_run(model, load, limits, points, target, &again);
    for (int32_t f = 0; status >= 0 && f < PLIANT_NUM_STEP_STAGES * run->frames; f++)
        run->seconds[f] = fmin(run->seconds[f], again.seconds[f]);
    report_run_free(&again);
    return status;
}

/* Minimum fraction of the time in which a thread runs; below it, the machine does other work. */
static const double quiet = 0.8;

static pliant_status run_one(sweep_state *state, const pliant_model *model, const pliant_points *points, int index,
                             int budget, bool before_patch, report_row *row)
{
    const sweep_ground *ground = &state->ground;
    const pliant_sweep *sweep = ground->sweep;
    report_limits limits = {.iterations = sweep->iterations[budget],
                            .tolerance = ground->scene.solver.tolerance,
                            .period = sweep->paced ? ground->scene.solver.step : 0,
                            .before_patch = before_patch,
                            .uses_thread_time = sweep->uses_thread_time,
                            .progress = {pass_progress, state}};
    report_run run = {0};
    const pliant_geometry *target = sweep->warp ? &ground->target : NULL;
    pliant_status status = report_case_run(model, ground->cases + index, limits, points, target, &run);
    /* other programs affect the caches even if the CPU time is measured */
    bool again = !sweep->uses_thread_time || run.cpu_time_fraction < quiet;
    for (int32_t n = 1; status >= 0 && again && n < sweep->repeats; n++)
        status = repeat(model, ground->cases + index, limits, points, target, &run);
    if (status < 0) report_run_free(&run);
    if (status == PLIANT_ERROR_CANCELLED) return status;
    if (status < 0) { /* only this run has failed */
        row_text(row, pliant_status_text(status));
        row_text(row, pliant_last_error());
        return row_add(row, ground->tables->sweep);
    }
    /* voxel errors are defined for rasterized volumes only */
    bool voxels = sweep->warp && ground->scene.warp.kind == PLIANT_RASTERIZE && budget == best_budget(sweep);
    sweep_result result = {ground, model, points, index, &run, voxels};
    status = sweep_write_rows(&result, row);
    report_run_free(&run);
    return status;
}

static bool same_mesh(const pliant_scene *a, const pliant_scene *b)
{
    /* padding is zero, because pliant_scene_defaults creates scenes */
    return memcmp(&a->mesh, &b->mesh, sizeof a->mesh) == 0;
}

/* Return whether more iterations are useless: the last run exceeded the time limit, or every frame met the
 * tolerance. */
static bool enough(const sweep_ground *ground)
{
    const pliant_results *table = ground->tables->sweep;
    size_t row = pliant_results_rows(table) - 1;
    if (!(ground->sweep->max_ms > 0)) return false;
    const char *status = pliant_results_cell(table, row, pliant_results_column(table, "status"));
    const char *time = pliant_results_cell(table, row, pliant_results_column(table, "solver_median_ms"));
    return strcmp(status, "ok") == 0 || !time[0] || strtod(time, NULL) > ground->sweep->max_ms;
}

bool sweep_runs_before_patch(const sweep_ground *ground, report_case_kind kind)
{
    return ground->sweep->before_patch && pliant_patch_is_enabled(&ground->scene) && report_case_pulls(kind);
}

/* Run every case and budget that is not in the table. */
static pliant_status run_cases(sweep_state *state, const pliant_model *model, const pliant_points *points, int method,
                               int submesh, bool before_patch)
{
    const sweep_ground *ground = &state->ground;
    const char *submesh_name = method == PLIANT_SCHUR ? submesh_names[submesh] : "";
    pliant_status status = PLIANT_OK;
    report_row row;
    model_key(state, method, submesh, before_patch, &row);
    for (int c = 0; status >= 0 && c < ground->num_cases; c++) {
        if (before_patch && !sweep_runs_before_patch(ground, ground->cases[c].kind)) continue;
        for (int b = 0; status >= 0 && b < ground->sweep->num_iterations; b++) {
            run_key(ground, c, b, &row);
            if (row_is_stored(&row, ground->tables->sweep)) continue;
            status = begin(state, "ratio %d: %s %s, %s %s, budget %s", ground->scene.mesh.ratio, method_names[method],
                           submesh_name, report_case_name(ground->cases[c].kind), ground->point_names[c],
                           row.text + row.start[MODEL_KEYS]);
            if (status >= 0) status = run_one(state, model, points, c, b, before_patch, &row);
            state->done++;
            if (status >= 0 && enough(ground)) break;
        }
    }
    return status;
}

pliant_status sweep_run_model(sweep_state *state, int method, int submesh)
{
    sweep_ground *ground = &state->ground;
    report_row row;
    pliant_model *model = NULL;
    pliant_points points = {0};
    size_t peak = ground->fine_peak;
    if (count_missing(state, method, submesh, NULL) == 0) return PLIANT_OK;
    ground->scene.model.method = (pliant_method)method;
    ground->scene.model.submesh = (pliant_submesh_extent)submesh;
    const pliant_scene scene = ground->scene;
    const char *submesh_name = method == PLIANT_SCHUR ? submesh_names[submesh] : "";
    pliant_status status =
        begin(state, "ratio %d: building %s %s", scene.mesh.ratio, method_names[method], submesh_name);
    if (status < 0) return status;
    bool own = method != PLIANT_FINE || scene.solver.kind != ground->reference.solver.kind ||
               !same_mesh(&scene, &ground->reference);
    if (own) status = build(state, &scene, &model, &peak);
    const pliant_model *used = own ? model : ground->fine;
    model_key(state, method, submesh, false, &row);
    if (status == PLIANT_ERROR_CANCELLED) return status;
    if (status < 0) { /* this method is not available here */
        state->done += ground->num_cases * ground->sweep->num_iterations;
        return sweep_write_build_row(NULL, pliant_last_error(), 0, &row, ground->tables->builds);
    }
    status = sweep_write_build_row(used, NULL, peak, &row, ground->tables->builds);
    if (status >= 0) status = pliant_points_create(&used->body->fine, ground->count, ground->rest, &points);
    if (status >= 0) status = run_cases(state, used, &points, method, submesh, false);
    if (status >= 0) status = run_cases(state, used, &points, method, submesh, true);
    pliant_points_free(&points);
    pliant_model_free(model);
    return status;
}

/* Run one ratio and variant. */
static pliant_status run_ground(sweep_state *state)
{
    uint8_t missing[MAX_CASES] = {0};
    sweep_list_cases(&state->ground);
    if (each_missing(state, missing) == 0) return PLIANT_OK;
    pliant_status status = sweep_prepare(state, missing);
    for (int m = 0; status >= 0 && m < NUM_METHODS; m++)
        for (int t = 0; status >= 0 && (state->ground.sweep->methods >> m & 1) && t < num_submeshes(m); t++)
            status = sweep_run_model(state, m, t);
    sweep_free_ground(&state->ground);
    return status;
}

/* Return whether the group `ground` has a plane or a box. */
static bool has_walls(const pliant_scene *scene)
{
    pliant_scene plain;
    pliant_scene_defaults(&plain);
    return memcmp(scene->ground.normal, plain.ground.normal, sizeof plain.ground.normal) != 0 ||
           memcmp(scene->ground.box_low, plain.ground.box_low, sizeof plain.ground.box_low) != 0 ||
           memcmp(scene->ground.box_high, plain.ground.box_high, sizeof plain.ground.box_high) != 0;
}

/* Choose the reference solver. Explicit dynamics uses dynamic relaxation, which has the same solution. Its reference is
 * the corotational solver on the same mesh; both agree for small strains. */
static pliant_status choose_reference(sweep_ground *ground)
{
    ground->reference = ground->scene;
    if (ground->scene.solver.kind == PLIANT_COROTATIONAL) return PLIANT_OK;
    if (has_walls(&ground->scene))
        return pliant_fail(PLIANT_ERROR_SCENE,
                           "ground: tled is measured against the corotational solver, which knows no plane or box; "
                           "leave them out of the scene to sweep it");
    ground->scene.tled.quasi_static = true;
    ground->reference.solver.kind = PLIANT_COROTATIONAL;
    return PLIANT_OK;
}

/* Use the same elements for all compared methods. */
static void choose_elements(sweep_state *state, bool counting)
{
    pliant_scene *scene = &state->ground.scene;
    const char *why;
    const pliant_element_kind kind = pliant_scene_element_kind(scene, &why);
    if (why && !counting) pliant_log(PLIANT_LOG_INFO, "element/kind: auto is linear for all that is compared; %s", why);
    scene->element.kind = kind;
}

/* counting: count the runs; otherwise compute them */
static pliant_status each_ground(sweep_state *state, bool counting)
{
    const pliant_sweep *sweep = state->ground.sweep;
    int variants = sweep->option[0] && sweep->num_values > 0 ? sweep->num_values : 1;
    pliant_status status = PLIANT_OK;
    for (int v = 0; status >= 0 && v < variants; v++)
        for (int r = 0; status >= 0 && r < sweep->num_ratios; r++) {
            state->grounds = v * sweep->num_ratios + r;
            state->ground.scene = *state->ground.input->scene;
            state->ground.scene.mesh.ratio = sweep->ratios[r];
            if (sweep->option[0] && sweep->num_values > 0) {
                snprintf(state->variant, sizeof state->variant, "%s=%s", sweep->option, sweep->values[v]);
                status = pliant_scene_set(&state->ground.scene, sweep->option, sweep->values[v]);
                if (status < 0) break;
            }
            choose_elements(state, counting);
            if ((status = choose_reference(&state->ground)) < 0) break;
            if (counting) {
                sweep_list_cases(&state->ground);
                state->total += each_missing(state, NULL);
            } else status = run_ground(state);
        }
    return status;
}

pliant_status pliant_sweep_run(const pliant_report_input *input, const pliant_sweep *sweep, const char *folder,
                               pliant_report_tables *tables, pliant_progress progress)
{
    pliant_status status = check(sweep);
    if (status < 0) return status;
    sweep_state *state = pliant_calloc(1, sizeof *state);
    if (!state) return pliant_fail_memory("a sweep");
    state->ground.input = input;
    state->ground.sweep = sweep;
    state->ground.folder = folder;
    state->ground.tables = tables;
    state->progress = progress;
    pliant_report_setup(input, sweep, state->setup);
    status = each_ground(state, true);
    if (status >= 0) status = each_ground(state, false);
    pliant_free(state);
    return status;
}
