/* Choose the settings of a scene by measurement: try candidates on a probe load, and take the most accurate one within
 * the time budget. */
#include "report/choice.h"

#include "base/clock.h"
#include "base/fail.h"
#include "fem/patch/patch.h"
#include "base/memory.h"
#include "scene/scene.h"
#include "sim/build/model.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* the probe load */
enum { FRAMES = 10, CASES = 1 << CASE_displacement | 1 << CASE_force | 1 << CASE_sag };
enum { REPEATS = 3 }; /* repetitions, because other programs may disturb the measurement */
static const double reference_tolerance = 1e-4;
static const double reference_part = 0.5; /* fraction of the time limit for a reference with twice the resolution */

typedef struct choice_state {
    sweep_state sweep;
    pliant_sweep settings;
    pliant_progress progress; /* the caller's callback */
    double start, end;        /* [s] */
    bool cancelled, is_out_of_time;
    int index, count; /* index and number of the current candidate */
    choice_candidate candidates[CHOICE_CANDIDATES];
    choice_point points[CHOICE_CANDIDATES * CHOICE_BUDGETS];
    int num_points, dropped;
} choice_state;

#define NAME(name, yaml) #yaml,
static const char *const measure_names[NUM_MEASURES] = {PLIANT_MEASURE_LIST(NAME)};
#undef NAME

/* ---- trying candidates */

static bool pass_progress(double fraction, const char *stage, void *user)
{
    choice_state *state = user;
    char text[200];
    (void)fraction;
    state->is_out_of_time = state->is_out_of_time || pliant_seconds() > state->end;
    snprintf(text, sizeof text, "choosing settings, %s", stage);
    /* several threads may call this, and the caller's request is passed on only once */
    state->cancelled =
        state->cancelled || !pliant_report_progress(state->progress, (double)state->index / (state->count + 1), text);
    return !state->cancelled && !state->is_out_of_time;
}

static void log_points(const choice_state *state, int from)
{
    char text[PLIANT_CHOICE_TEXT];
    const pliant_scene *scene = state->sweep.ground.input->scene;
    const pliant_measure measure = scene->choose.measure;
    for (int p = from; p < state->num_points; p++) {
        const choice_point *point = state->points + p;
        pliant_log(PLIANT_LOG_INFO, "choose: %8.3f %% %s (%.3f %% later) %9.3f ms  %s solver/iterations=%d",
                   100 * point->error[measure], choice_phase_text(point->worst[measure]),
                   100 * point->settled_error[measure], 1e3 * point->seconds,
                   choice_describe(&point->candidate, scene, text), (int)point->iterations);
    }
    if (from == state->num_points && !state->is_out_of_time)
        pliant_log(PLIANT_LOG_WARNING, "choose: dropped %s",
                   choice_describe(state->candidates + state->index, scene, text));
}

static pliant_status try_candidate(choice_state *state)
{
    sweep_ground *ground = &state->sweep.ground;
    const choice_candidate *candidate = state->candidates + state->index;
    size_t first = pliant_results_rows(ground->tables->sweep);
    int from = state->num_points;
    pliant_status status = choice_scene(ground->input->scene, candidate, &ground->scene);
    if (status < 0) return status;
    ground->scene.solver.backend = ground->reference.solver.backend;
    choice_name_variant(candidate, ground->input->scene, state->sweep.variant);
    status = sweep_run_model(&state->sweep, candidate->by.method, candidate->by.submesh);
    if (status == PLIANT_ERROR_CANCELLED && state->cancelled) return status;
    state->num_points += choice_collect_points(ground, candidate, first, state->points + from);
    state->dropped += from == state->num_points && !state->is_out_of_time;
    log_points(state, from);
    return PLIANT_OK; /* unavailable candidates, and candidates after the time limit, are dropped */
}

/* Determine the backend of a simulation of the reference's model, once, so that it is logged once. */
static pliant_status find_backend(const pliant_model *model, pliant_backend_choice *out)
{
    pliant_data *data = NULL;
    pliant_status status = pliant_data_create(model, &data);
    if (status >= 0) *out = strcmp(pliant_data_get_backend(data), "cpu") == 0 ? PLIANT_CPU : PLIANT_CUDA;
    pliant_data_free(data);
    return status;
}

/* Compute the reference, or one with the scene's own resolution if the finer one is not available. */
static pliant_status make_reference(choice_state *state)
{
    sweep_ground *ground = &state->sweep.ground;
    const uint8_t all[MAX_CASES] = {1, 1, 1};
    ground->scene = *ground->input->scene;
    ground->scene.element.kind = pliant_scene_element_kind(&ground->scene, NULL);
    ground->reference = ground->scene;
    ground->reference.mesh.ratio = choice_reference_ratio(ground->input->scene, state->settings.max_refined_tets);
    state->settings.max_refined_tets = 0; /* it is the only model */
    sweep_list_cases(ground);
    bool refined = ground->reference.mesh.ratio > ground->input->scene->mesh.ratio;
    if (refined) state->end = state->start + reference_part * ground->input->scene->choose.seconds;
    pliant_status status = sweep_prepare(&state->sweep, all);
    state->end = state->start + ground->input->scene->choose.seconds;
    if (status < 0 && !state->cancelled && refined) {
        pliant_log(PLIANT_LOG_WARNING, "choose: nothing is measured against a mesh of twice the resolution: %s",
                   state->is_out_of_time ? "it takes too long" : pliant_last_error());
        state->is_out_of_time = false;
        sweep_free_ground(ground);
        ground->reference.mesh.ratio = ground->input->scene->mesh.ratio;
        sweep_list_cases(ground);
        status = sweep_prepare(&state->sweep, all);
    }
    return status < 0 ? status : find_backend(ground->fine, &ground->reference.solver.backend);
}

static pliant_status try_all(choice_state *state)
{
    sweep_ground *ground = &state->sweep.ground;
    pliant_status status = PLIANT_OK;
    state->count = choice_list_candidates(ground->input->scene, ground->reference.mesh.ratio, state->candidates);
    pliant_log(PLIANT_LOG_INFO,
               "choose: error (%s) and time of a step on a pull at %s, against the fine solution on %d tetrahedra",
               measure_names[ground->input->scene->choose.measure], ground->point_names[0],
               ground->fine->body->fine.num_tets);
    for (state->index = 0; status >= 0 && state->index < state->count; state->index++) {
        const int known = state->num_points;
        status = try_candidate(state);
        if (!state->is_out_of_time) continue;
        state->index += state->num_points > known; /* the candidate was measured partially */
        break;
    }
    if (status >= 0 && state->is_out_of_time)
        pliant_log(PLIANT_LOG_WARNING, "choose: only %d of %d candidates were measured within choose/seconds (%g)",
                   state->index, state->count, ground->input->scene->choose.seconds);
    return status;
}

/* ---- choosing a candidate */

static bool mesh_is_larger(const pliant_choice *choice)
{
    return choice->mesh > choice->error + choice->reference_error - choice->mesh;
}

static pliant_status write_result_row(const choice_state *state, const choice_point *point, const pliant_choice *choice)
{
    const pliant_scene *scene = state->sweep.ground.input->scene;
    char variant[CHOICE_VARIANT];
    report_row row;
    choice_name_variant(&point->candidate, scene, variant);
    row_clear(&row);
    row_text(&row, state->sweep.setup);
    row_integer(&row, point->candidate.mesh.ratio);
    row_text(&row, choice_method_name(&point->candidate));
    row_text(&row, choice_submesh_name(&point->candidate));
    row_text(&row, variant);
    row_integer(&row, point->iterations);
    row_text(&row, choice->options);
    row_number(&row, scene->choose.budget_ms);
    if (scene->choose.max_error > 0)
        row_number(&row, 100 * scene->choose.max_error);
    else
        row_empty(&row, 1);
    row_text(&row, measure_names[scene->choose.measure]);
    row_number(&row, 100 * choice->max);
    row_number(&row, 100 * choice->p95);
    row_number(&row, 100 * choice->rms);
    row_text(&row, choice_phase_text(point->worst[scene->choose.measure]));
    row_number(&row, 100 * choice->settled_error);
    if (choice->reference_error > 0) {
        row_number(&row, 100 * choice->reference_error);
        row_number(&row, 100 * choice->mesh);
        row_text(&row, mesh_is_larger(choice) ? "mesh" : "solver");
    } else {
        row_empty(&row, 3);
    }
    row_number(&row, 1e3 * choice->seconds);
    row_text(&row, choice->within_budget ? "yes" : "no");
    row_integer(&row, choice->reference_tetrahedra);
    row_integer(&row, choice->tried);
    row_number(&row, pliant_seconds() - state->start);
    return row_add(&row, state->sweep.ground.tables->choice);
}

static void warn(const pliant_scene *scene, const choice_point *point, const pliant_choice *choice)
{
    char settled_error[80] = "";
    if (choice->settled_error < choice->error)
        snprintf(settled_error, sizeof settled_error, "; %.3g %% later on", 100 * choice->settled_error);
    const char *phase = choice_phase_text(point->worst[scene->choose.measure]);
    if (!choice->within_budget)
        pliant_log(PLIANT_LOG_WARNING,
                   "choose/budget_ms: no candidate takes at most %g ms; the quickest takes %.3g ms, with an error "
                   "of %.3g %% (%s%s)",
                   scene->choose.budget_ms, 1e3 * choice->seconds, 100 * choice->error, phase, settled_error);
    else if (scene->choose.max_error > 0 && choice->error > scene->choose.max_error)
        pliant_log(
            PLIANT_LOG_WARNING,
            "choose/max_error: nothing within %g ms is as accurate as %g %%; the best has an error of %.3g %% (%s%s)",
            scene->choose.budget_ms, 100 * scene->choose.max_error, 100 * choice->error, phase, settled_error);
}

static pliant_status take(const choice_state *state, pliant_choice *out)
{
    const pliant_scene *scene = state->sweep.ground.input->scene;
    const pliant_measure measure = scene->choose.measure;
    const int32_t finest = state->sweep.ground.reference.mesh.ratio;
    const double reference_error = choice_reference_error(state->points, state->num_points, finest, measure);
    const choice_point *point =
        choice_best(state->points, state->num_points, measure, reference_error, 1e-3 * scene->choose.budget_ms);
    pliant_choice choice = {.made = true,
                            .within_budget = point != NULL,
                            .tried = state->index,
                            .dropped = state->dropped,
                            .reference_tetrahedra = state->sweep.ground.fine->body->fine.num_tets};
    if (!point) point = choice_fastest(state->points, state->num_points);
    if (!point)
        return pliant_fail(state->is_out_of_time ? PLIANT_ERROR_CANCELLED : PLIANT_ERROR_NUMERIC,
                           "choose: no candidate could be measured");
    pliant_status status = choice_scene(scene, &point->candidate, &choice.scene);
    if (status < 0) return status;
    choice.scene.solver.iterations = point->iterations;
    choice.error = point->error[measure];
    choice.max = point->error[PLIANT_MEASURE_MAX];
    choice.p95 = point->error[PLIANT_MEASURE_P95];
    choice.rms = point->error[PLIANT_MEASURE_RMS];
    choice.settled_error = point->settled_error[measure];
    const choice_mesh *mesh = &point->candidate.mesh;
    const double mesh_error =
        choice_mesh_error(state->points, state->num_points, mesh->cells_factor * mesh->ratio, measure);
    choice.reference_error = reference_error;
    choice.mesh =
        reference_error +
        (isnan(mesh_error) || mesh->cells_factor * mesh->ratio == finest ? 0 : fmin(mesh_error, choice.error));
    choice.seconds = choice_seconds(state->points, state->num_points, point);
    choice_describe(&point->candidate, scene, choice.options);
    size_t used = strlen(choice.options);
    snprintf(choice.options + used, sizeof choice.options - used, " solver/iterations=%d", (int)point->iterations);
    status = write_result_row(state, point, &choice);
    if (status < 0) return status;
    warn(scene, point, &choice);
    pliant_log(PLIANT_LOG_INFO,
               "choose: took %s: error %.3g %% of the largest displacement (%s), %s, %.3g %% later on; %.3g ms a step",
               choice.options, 100 * choice.error, measure_names[measure], choice_phase_text(point->worst[measure]),
               100 * choice.settled_error, 1e3 * choice.seconds);
    if (reference_error > 0)
        pliant_log(
            PLIANT_LOG_INFO, "choose: its mesh is off by some %.3g %%, of which the reference leaves out %.3g %%; %s",
            100 * choice.mesh, 100 * reference_error,
            mesh_is_larger(&choice) ? "a finer one would pay, or another element/kind" : "the solver is off by more");
    *out = choice;
    return PLIANT_OK;
}

static pliant_status check(const pliant_scene *scene)
{
    pliant_status status = pliant_scene_check(scene);
    if (status < 0) return status;
    if (scene->solver.kind != PLIANT_COROTATIONAL || scene->mesh.kind != PLIANT_LATTICE || scene->mesh.file[0])
        return pliant_fail(PLIANT_ERROR_SCENE,
                           "choose/budget_ms: settings are chosen for solver/kind corotational and mesh/kind lattice "
                           "only; set it to 0");
    return PLIANT_OK;
}

static void prepare(const pliant_report_input *input, pliant_report_tables *tables, pliant_progress progress,
                    choice_state *state)
{
    const pliant_scene *scene = input->scene;
    pliant_sweep *settings = &state->settings;
    pliant_sweep_defaults(scene, settings);
    settings->cases = CASES;
    settings->frames = FRAMES;
    double scale = 1;
    /* an error appears again when the model is built */
    (void)pliant_length_scale(input->scan, input->labels, input->materials, &scale);
    for (int d = 0; d < 3; d++) settings->pull[d] *= scale * (double)FRAMES / 30; /* at the same speed */
    settings->reference_tolerance = fmin(reference_tolerance, 0.1 * scene->solver.tolerance);
    settings->max_ms = scene->choose.budget_ms;
    settings->paced = true;
    settings->uses_thread_time = true;
    settings->repeats = REPEATS;
    settings->before_patch = true;
    settings->warp = false;
    settings->num_iterations = scene->choose.iterations ? CHOICE_BUDGETS : 1;
    settings->iterations[0] = scene->solver.iterations;
    if (scene->choose.iterations) memcpy(settings->iterations, choice_budgets, sizeof choice_budgets);
    settings->num_points = pliant_pull_points(input, NULL, 0, 1, settings->points);
    state->sweep.ground = (sweep_ground){.input = input, .sweep = settings, .tables = tables};
    state->progress = progress;
    state->sweep.progress = (pliant_progress){pass_progress, state};
    state->start = pliant_seconds();
    state->end = state->start + scene->choose.seconds;
    pliant_report_setup(input, settings, state->sweep.setup);
}

pliant_status pliant_choose(const pliant_report_input *input, pliant_report_tables *tables, pliant_progress progress,
                            pliant_choice *out)
{
    pliant_report_tables own = {0};
    if (!(input->scene->choose.budget_ms > 0)) {
        *out = (pliant_choice){.scene = *input->scene};
        return PLIANT_OK;
    }
    pliant_status status = check(input->scene);
    if (status < 0) return status;
    choice_state *state = pliant_calloc(1, sizeof *state);
    if (!state) return pliant_fail_memory("choosing settings");
    if (!tables) status = pliant_report_open(NULL, &own);
    if (status >= 0) {
        prepare(input, tables ? tables : &own, progress, state);
        if (state->settings.num_points == 0)
            status = pliant_fail(PLIANT_ERROR_SCENE, "choose: no soft tissue was found to pull at");
    }
    if (status >= 0) status = make_reference(state);
    if (status >= 0) status = try_all(state);
    if (status >= 0) status = take(state, out);
    if (status < 0 && !state->cancelled) {
        pliant_log(PLIANT_LOG_WARNING, "choose: the settings of the scene are used and their error is unknown: %s",
                   state->is_out_of_time ? "choose/seconds ended before the first measurement" : pliant_last_error());
        *out = (pliant_choice){.scene = *input->scene};
        status = PLIANT_OK;
    }
    sweep_free_ground(&state->sweep.ground);
    pliant_free(state);
    if (!tables) pliant_report_close(&own);
    return status;
}
