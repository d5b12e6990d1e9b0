/* The settings of a scene by measurement: what is tried on a pull, and which of it is the most accurate within the budget. */
#include "backend/backend.h"
#include "base/fail.h"
#include "fem/patch/patch.h"
#include "pliant/memory.h"
#include "report/sweep.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* What may stand for the scene's method, most accurate first: a line each. */
static const struct choice_method {
    pliant_method method;
    pliant_touch touch;
    double patch; /* model/patch [m] */
} methods[] = {
    {PLIANT_FINE, PLIANT_TOUCH_OVERLAP, 0},
    {PLIANT_AVERAGED, PLIANT_TOUCH_OVERLAP, 0.05},
    {PLIANT_CALIBRATED, PLIANT_TOUCH_OVERLAP, 0},
    {PLIANT_AVERAGED, PLIANT_TOUCH_OVERLAP, 0},
    {PLIANT_COARSE, PLIANT_TOUCH_OVERLAP, 0},
    {PLIANT_LOD, PLIANT_TOUCH_OVERLAP, 0},
    {PLIANT_SCHUR, PLIANT_TOUCH_OVERLAP, 0},
    {PLIANT_SCHUR, PLIANT_TOUCH_FACE, 0},
};
static const int32_t budgets[] = {1, 2, 3, 4, 6, 8, 12, 18, 30};
enum { NUM_METHODS = sizeof methods / sizeof *methods, NUM_BUDGETS = sizeof budgets / sizeof *budgets };
#define COUNT(name, yaml) +1
enum { NUM_MEASURES = 0 PLIANT_MEASURE_LIST(COUNT) };
#undef COUNT
enum { MOST_MESHES = 10, MOST_CANDIDATES = (NUM_METHODS + 1) * MOST_MESHES, VARIANT_TEXT = sizeof((sweep_state *)NULL)->variant };
/* the probe load */
enum { FRAMES = 10, CASES = 1 << CASE_displacement | 1 << CASE_force };
static const double reference_tolerance = 1e-4;
static const double reference_part = 0.5; /* of the time, for a reference of twice the resolution */
static const double alike = 1.05; /* errors within this factor count as equal, and the quicker one is taken */

typedef struct choice_mesh {
    int32_t cells_factor, ratio; /* of the scene's coarse cells */
} choice_mesh;

typedef struct choice_candidate {
    struct choice_method by;
    choice_mesh mesh;
} choice_candidate;

/* What a candidate did with one budget, the worse of the cases. */
typedef struct choice_point {
    choice_candidate candidate;
    int32_t iterations;
    double error[NUM_MEASURES]; /* fraction of the largest displacement */
    double seconds;             /* median step */
} choice_point;

typedef struct choice_state {
    sweep_state sweep;
    pliant_sweep settings;
    pliant_progress progress; /* the caller's */
    double start, end;        /* [s] */
    bool cancelled, late;
    int index, count;         /* of candidates */
    choice_candidate candidates[MOST_CANDIDATES];
    choice_point points[MOST_CANDIDATES * NUM_BUDGETS];
    int num_points, dropped;
} choice_state;

#define NAME(name, yaml) #yaml,
static const char *const method_names[] = {PLIANT_METHOD_LIST(NAME)};
static const char *const touch_names[] = {PLIANT_TOUCH_LIST(NAME)};
static const char *const measure_names[] = {PLIANT_MEASURE_LIST(NAME)};
#undef NAME
#define COLUMN(name, yaml) #yaml "_percent",
static const char *const error_columns[] = {PLIANT_MEASURE_LIST(COLUMN)}; /* of a sweep */
#undef COLUMN

static const char *touch_name(const struct choice_method *by) { return by->method == PLIANT_SCHUR ? touch_names[by->touch] : ""; }

/* ---- what is tried */

static double lattice_tetrahedra(const pliant_scene *scene, int32_t ratio)
{
    double cells = 5;
    for (int d = 0; d < 3; d++) cells *= (double)scene->mesh.coarse_cells[d] * ratio;
    return cells;
}

/* Of the mesh that all are measured against: twice the scene's where the mesh may vary and that is not too large. */
static int32_t reference_ratio(const pliant_scene *scene, double limit)
{
    int32_t twice = 2 * scene->mesh.ratio;
    bool varies = scene->choose.ratio || scene->choose.coarse_cells;
    return varies && twice <= 8 && lattice_tetrahedra(scene, twice) <= limit ? twice : scene->mesh.ratio;
}

/* Cells and ratios that make no finer mesh than the reference's, coarse ones first. */
static int list_meshes(const pliant_scene *scene, int32_t finest, choice_mesh out[MOST_MESHES])
{
    int count = 0;
    for (int32_t part = 8; part >= 1; part /= 2)
        for (int32_t factor = 1; factor <= (scene->choose.coarse_cells ? 2 : 1); factor++) {
            int32_t ratio = finest / part, largest = 0;
            if (!scene->choose.ratio) ratio = scene->mesh.ratio;
            for (int d = 0; d < 3; d++) largest = scene->mesh.coarse_cells[d] > largest ? scene->mesh.coarse_cells[d] : largest;
            bool known = ratio < 1 || factor * ratio > finest || factor * largest > 256;
            for (int m = 0; m < count; m++) known = known || (out[m].cells_factor == factor && out[m].ratio == ratio);
            if (!known && count < MOST_MESHES) out[count++] = (choice_mesh){factor, ratio};
        }
    return count;
}

static bool is_listed(const choice_mesh *meshes, int count, int32_t factor, int32_t ratio)
{
    for (int m = 0; m < count; m++)
        if (meshes[m].cells_factor == factor && meshes[m].ratio == ratio) return true;
    return false;
}

static bool same_method(const struct choice_method *a, const struct choice_method *b)
{
    bool patched = a->method != PLIANT_FINE; /* to which a patch means nothing */
    return a->method == b->method && a->touch == b->touch && (!patched || a->patch == b->patch);
}

/* The scene's own settings first, so that they are known whatever becomes of the others; then its method on other meshes. */
static int list_candidates(const pliant_scene *scene, int32_t finest, choice_candidate *out)
{
    choice_mesh meshes[MOST_MESHES];
    int num_meshes = list_meshes(scene, finest, meshes), count = 0;
    const pliant_method method = scene->model.method;
    const struct choice_method own = {method, method == PLIANT_SCHUR ? scene->model.touch : PLIANT_TOUCH_OVERLAP, scene->model.patch};
    out[count++] = (choice_candidate){own, {1, scene->mesh.ratio}};
    for (int n = -1; n < (scene->choose.method ? NUM_METHODS : 0); n++) {
        const struct choice_method *by = n < 0 ? &own : methods + n;
        if (n >= 0 && same_method(by, &own)) continue;
        for (int m = 0; m < num_meshes; m++) {
            bool fine = by->method == PLIANT_FINE;
            choice_mesh mesh = meshes[m];
            if (n < 0 && mesh.cells_factor == 1 && mesh.ratio == scene->mesh.ratio) continue;
            /* cells mean nothing to the fine method, and a coarse mesh as fine as the fine one means nothing to the others */
            if (fine && mesh.cells_factor > 1 && is_listed(meshes, num_meshes, 1, mesh.cells_factor * mesh.ratio)) continue;
            if (!fine && mesh.ratio == 1 && scene->choose.ratio) continue;
            out[count++] = (choice_candidate){*by, mesh};
        }
    }
    return count;
}

static pliant_status candidate_scene(const pliant_scene *scene, const choice_candidate *candidate, pliant_scene *out)
{
    *out = *scene;
    out->model.method = candidate->by.method;
    out->model.touch = candidate->by.touch;
    out->model.patch = candidate->by.patch;
    out->mesh.ratio = candidate->mesh.ratio;
    for (int d = 0; d < 3; d++) out->mesh.coarse_cells[d] *= candidate->mesh.cells_factor;
    return pliant_scene_check(out);
}

/* ---- trying it */

static bool pass_progress(double fraction, const char *stage, void *user)
{
    choice_state *state = user;
    char text[200];
    (void)fraction;
    state->late = state->late || pliant_seconds() > state->end;
    snprintf(text, sizeof text, "choosing settings, %s", stage);
    /* several threads may ask, and the caller may say it once */
    state->cancelled = state->cancelled || !pliant_report_progress(state->progress, (double)state->index / (state->count + 1), text);
    return !state->cancelled && !state->late;
}

static const char *cell(const pliant_results *table, size_t row, const char *column)
{
    return pliant_results_cell(table, row, pliant_results_column(table, column));
}

/* The options that make the candidate, as --set takes them. */
static const char *describe(const choice_candidate *candidate, const pliant_scene *scene, char out[PLIANT_CHOICE_TEXT])
{
    const struct choice_method *by = &candidate->by;
    const char *touch = touch_name(by);
    int32_t factor = candidate->mesh.cells_factor;
    const int32_t *cells = scene->mesh.coarse_cells;
    snprintf(out, PLIANT_CHOICE_TEXT, "model/method=%s%s%s mesh/coarse_cells=%d,%d,%d mesh/ratio=%d", method_names[by->method],
             touch[0] ? " model/touch=" : "", touch, factor * cells[0], factor * cells[1], factor * cells[2], candidate->mesh.ratio);
    size_t used = strlen(out);
    if (by->patch != scene->model.patch) snprintf(out + used, PLIANT_CHOICE_TEXT - used, " model/patch=%g", by->patch);
    return out;
}

/* The same less method, touch and ratio, which have columns of their own. */
static void name_variant(const choice_candidate *candidate, const pliant_scene *scene, char out[VARIANT_TEXT])
{
    int32_t factor = candidate->mesh.cells_factor;
    const int32_t *cells = scene->mesh.coarse_cells;
    const struct choice_method *by = &candidate->by;
    int used = 0;
    out[0] = '\0';
    if (factor > 1)
        used = snprintf(out, VARIANT_TEXT, "mesh/coarse_cells=%d,%d,%d", factor * cells[0], factor * cells[1], factor * cells[2]);
    if (by->patch != scene->model.patch) snprintf(out + used, (size_t)(VARIANT_TEXT - used), "%smodel/patch=%g", used ? " " : "", by->patch);
}

/* The rows from `first` on are of this candidate: case by case, budgets ascending. A case that converged needs no larger budget. */
static void gather(choice_state *state, size_t first)
{
    const pliant_results *table = state->sweep.ground.tables->sweep;
    const choice_candidate *candidate = state->candidates + state->index;
    bool any = false;
    for (int b = 0; b < state->settings.num_iterations; b++) {
        choice_point point = {.candidate = *candidate, .iterations = state->settings.iterations[b]};
        int cases = 0;
        for (int c = 0; c < state->sweep.ground.num_cases; c++) {
            const char *name = report_case_name(state->sweep.ground.cases[c].kind);
            size_t found = SIZE_MAX;
            for (size_t r = first; r < pliant_results_rows(table); r++) {
                int32_t budget = (int32_t)strtol(cell(table, r, "budget"), NULL, 10);
                bool converged = strcmp(cell(table, r, "status"), "ok") == 0;
                bool counts = budget == point.iterations || (converged && budget < point.iterations);
                if (counts && strcmp(cell(table, r, "case"), name) == 0 && cell(table, r, "max_percent")[0]) found = r;
            }
            if (found == SIZE_MAX) break;
            cases++;
            for (int m = 0; m < NUM_MEASURES; m++)
                point.error[m] = fmax(point.error[m], 0.01 * strtod(cell(table, found, error_columns[m]), NULL));
            point.seconds = fmax(point.seconds, 1e-3 * strtod(cell(table, found, "solver_median_ms"), NULL));
        }
        if (cases < state->sweep.ground.num_cases) continue;
        /* one more iteration that was not needed is no point of its own */
        const choice_point *last = any ? state->points + state->num_points - 1 : NULL;
        if (last && memcmp(last->error, point.error, sizeof point.error) == 0 && last->seconds == point.seconds) continue;
        any = true;
        state->points[state->num_points++] = point;
    }
    state->dropped += !any;
}

static void log_points(const choice_state *state, int from)
{
    char text[PLIANT_CHOICE_TEXT];
    const pliant_scene *scene = state->sweep.ground.input->scene;
    for (int p = from; p < state->num_points; p++) {
        const choice_point *point = state->points + p;
        pliant_log(PLIANT_LOG_INFO, "choose: %8.3f %% %9.3f ms  %s solver/iterations=%d",
                   100 * point->error[scene->choose.measure], 1e3 * point->seconds,
                   describe(&point->candidate, scene, text), (int)point->iterations);
    }
    if (from == state->num_points)
        pliant_log(PLIANT_LOG_WARNING, "choose: dropped %s", describe(state->candidates + state->index, scene, text));
}

static pliant_status try_candidate(choice_state *state)
{
    sweep_ground *ground = &state->sweep.ground;
    const choice_candidate *candidate = state->candidates + state->index;
    size_t first = pliant_results_rows(ground->tables->sweep);
    int from = state->num_points;
    pliant_status status = candidate_scene(ground->input->scene, candidate, &ground->scene);
    if (status < 0) return status;
    /* neither patches nor lod have kernels: where the scene leaves it open, they are tried on the CPU */
    bool on_host = (pliant_patch_asked(&ground->scene) || candidate->by.method == PLIANT_LOD) && ground->scene.solver.backend == PLIANT_AUTO;
    ground->scene.solver.backend = on_host ? PLIANT_CPU : ground->reference.solver.backend;
    name_variant(candidate, ground->input->scene, state->sweep.variant);
    status = sweep_run_model(&state->sweep, candidate->by.method, candidate->by.touch);
    if (status == PLIANT_ERROR_CANCELLED && state->cancelled) return status;
    gather(state, first);
    log_points(state, from);
    return PLIANT_OK; /* what cannot be had is dropped, and what came too late */
}

/* The reference, or one of the scene's own resolution where the finer one cannot be had. */
static pliant_status make_reference(choice_state *state)
{
    sweep_ground *ground = &state->sweep.ground;
    const uint8_t all[MOST_CASES] = {1, 1};
    const pliant_backend *backend;
    char text[PLIANT_BACKEND_TEXT];
    pliant_status status = pliant_backend_choose(ground->input->scene->solver.backend, text, &backend);
    if (status < 0) return status;
    ground->reference = ground->scene = *ground->input->scene;
    ground->reference.solver.backend = backend->on_host ? PLIANT_CPU : PLIANT_CUDA; /* said once, not by every run */
    ground->reference.mesh.ratio = reference_ratio(ground->input->scene, state->settings.twice_limit);
    state->settings.twice_limit = 0; /* it is the only one */
    sweep_list_cases(ground);
    bool twice = ground->reference.mesh.ratio > ground->input->scene->mesh.ratio;
    if (twice) state->end = state->start + reference_part * ground->input->scene->choose.seconds;
    status = sweep_prepare(&state->sweep, all);
    state->end = state->start + ground->input->scene->choose.seconds;
    if (status >= 0 || state->cancelled || !twice) return status;
    pliant_log(PLIANT_LOG_WARNING, "choose: nothing is measured against a mesh of twice the resolution: %s",
               state->late ? "it takes too long" : pliant_last_error());
    state->late = false;
    sweep_free_ground(ground);
    ground->reference.mesh.ratio = ground->input->scene->mesh.ratio;
    sweep_list_cases(ground);
    return sweep_prepare(&state->sweep, all);
}

static pliant_status try_all(choice_state *state)
{
    sweep_ground *ground = &state->sweep.ground;
    pliant_status status = PLIANT_OK;
    state->count = list_candidates(ground->input->scene, ground->reference.mesh.ratio, state->candidates);
    pliant_log(PLIANT_LOG_INFO, "choose: error (%s) and time of a step on a pull at %s, against the fine solution on %d tetrahedra",
               measure_names[ground->input->scene->choose.measure], ground->point_names[0], ground->fine->body->fine.num_tets);
    for (state->index = 0; status >= 0 && !state->late && state->index < state->count; state->index++) status = try_candidate(state);
    if (status >= 0 && state->late)
        pliant_log(PLIANT_LOG_WARNING, "choose: %d of %d candidates were tried in choose/seconds: %g", state->index, state->count,
                   ground->input->scene->choose.seconds);
    return status;
}

/* ---- taking one */

/* NULL: nothing was measured */
static const choice_point *best_point(const choice_state *state, double most_seconds)
{
    const choice_point *best = NULL;
    pliant_measure measure = state->sweep.ground.input->scene->choose.measure;
    double least = INFINITY;
    for (int p = 0; p < state->num_points; p++)
        if (state->points[p].seconds <= most_seconds) least = fmin(least, state->points[p].error[measure]);
    for (int p = 0; p < state->num_points; p++) {
        const choice_point *point = state->points + p;
        if (point->seconds > most_seconds || point->error[measure] > alike * least) continue;
        if (!best || point->seconds < best->seconds) best = point;
    }
    return best;
}

static const choice_point *quickest_point(const choice_state *state)
{
    const choice_point *best = state->points;
    for (int p = 1; p < state->num_points; p++)
        if (state->points[p].seconds < best->seconds) best = state->points + p;
    return state->num_points > 0 ? best : NULL;
}

static pliant_status add_row(const choice_state *state, const choice_point *point, const pliant_choice *choice)
{
    const pliant_scene *scene = state->sweep.ground.input->scene;
    char variant[VARIANT_TEXT];
    report_row row;
    name_variant(&point->candidate, scene, variant);
    row_clear(&row);
    row_text(&row, state->sweep.setup);
    row_integer(&row, point->candidate.mesh.ratio);
    row_text(&row, method_names[point->candidate.by.method]);
    row_text(&row, touch_name(&point->candidate.by));
    row_text(&row, variant);
    row_integer(&row, point->iterations);
    row_text(&row, choice->options);
    row_number(&row, scene->choose.budget_ms);
    if (scene->choose.max_error > 0) row_number(&row, 100 * scene->choose.max_error);
    else row_empty(&row, 1);
    row_text(&row, measure_names[scene->choose.measure]);
    row_number(&row, 100 * choice->max);
    row_number(&row, 100 * choice->p95);
    row_number(&row, 100 * choice->rms);
    row_number(&row, 1e3 * choice->seconds);
    row_text(&row, choice->within_budget ? "yes" : "no");
    row_integer(&row, choice->reference_tetrahedra);
    row_integer(&row, choice->tried);
    row_number(&row, pliant_seconds() - state->start);
    return row_add(&row, state->sweep.ground.tables->choice);
}

static void warn(const pliant_scene *scene, const pliant_choice *choice)
{
    if (!choice->within_budget)
        pliant_log(PLIANT_LOG_WARNING, "choose/budget_ms: nothing that was tried keeps to %g ms; the quickest takes %.3g ms, with an error "
                                       "of %.3g %%",
                   scene->choose.budget_ms, 1e3 * choice->seconds, 100 * choice->error);
    else if (scene->choose.max_error > 0 && choice->error > scene->choose.max_error)
        pliant_log(PLIANT_LOG_WARNING, "choose/max_error: nothing within %g ms is as accurate as %g %%; the best has an error of %.3g %%",
                   scene->choose.budget_ms, 100 * scene->choose.max_error, 100 * choice->error);
}

static pliant_status take(const choice_state *state, pliant_choice *out)
{
    const pliant_scene *scene = state->sweep.ground.input->scene;
    const choice_point *point = best_point(state, 1e-3 * scene->choose.budget_ms);
    pliant_choice choice = {.made = true, .within_budget = point != NULL, .tried = state->index, .dropped = state->dropped,
                            .reference_tetrahedra = state->sweep.ground.fine->body->fine.num_tets};
    if (!point) point = quickest_point(state);
    if (!point) return pliant_fail(PLIANT_ERROR_NUMERIC, "choose: nothing that was tried could be measured");
    pliant_status status = candidate_scene(scene, &point->candidate, &choice.scene);
    if (status < 0) return status;
    choice.scene.solver.iterations = point->iterations;
    choice.error = point->error[scene->choose.measure];
    choice.max = point->error[PLIANT_MEASURE_MAX];
    choice.p95 = point->error[PLIANT_MEASURE_P95];
    choice.rms = point->error[PLIANT_MEASURE_RMS];
    choice.seconds = point->seconds;
    describe(&point->candidate, scene, choice.options);
    size_t used = strlen(choice.options);
    snprintf(choice.options + used, sizeof choice.options - used, " solver/iterations=%d", (int)point->iterations);
    status = add_row(state, point, &choice);
    if (status < 0) return status;
    warn(scene, &choice);
    pliant_log(PLIANT_LOG_INFO, "choose: took %s: error %.3g %% of the largest displacement (%s), %.3g ms a step", choice.options,
               100 * choice.error, measure_names[scene->choose.measure], 1e3 * choice.seconds);
    *out = choice;
    return PLIANT_OK;
}

static pliant_status check(const pliant_scene *scene)
{
    pliant_status status = pliant_scene_check(scene);
    if (status < 0) return status;
    if (scene->solver.kind != PLIANT_COROTATIONAL || scene->mesh.kind != PLIANT_LATTICE)
        return pliant_fail(PLIANT_ERROR_SCENE, "choose/budget_ms: settings are chosen for solver/kind corotational and mesh/kind lattice "
                                               "only; set it to 0");
    return PLIANT_OK;
}

static void prepare(const pliant_report_input *input, pliant_report_tables *tables, pliant_progress progress, choice_state *state)
{
    const pliant_scene *scene = input->scene;
    pliant_sweep *settings = &state->settings;
    pliant_sweep_defaults(scene, settings);
    settings->cases = CASES;
    settings->frames = FRAMES;
    for (int d = 0; d < 3; d++) settings->pull[d] *= (double)FRAMES / 30; /* at the same speed */
    settings->reference_tolerance = fmin(reference_tolerance, 0.1 * scene->solver.tolerance);
    settings->most_ms = scene->choose.budget_ms;
    settings->paced = true;
    settings->warp = false;
    settings->num_iterations = scene->choose.iterations ? NUM_BUDGETS : 1;
    settings->iterations[0] = scene->solver.iterations;
    if (scene->choose.iterations) memcpy(settings->iterations, budgets, sizeof budgets);
    settings->num_points = pliant_pull_points(input, NULL, 0, 1, settings->points);
    state->sweep.ground = (sweep_ground){.input = input, .sweep = settings, .tables = tables};
    state->progress = progress;
    state->sweep.progress = (pliant_progress){pass_progress, state};
    state->start = pliant_seconds();
    state->end = state->start + scene->choose.seconds;
    pliant_report_setup(input, settings, state->sweep.setup);
}

pliant_status pliant_choose(const pliant_report_input *input, pliant_report_tables *tables, pliant_progress progress, pliant_choice *out)
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
        if (state->settings.num_points == 0) status = pliant_fail(PLIANT_ERROR_SCENE, "choose: no soft tissue was found to pull at");
    }
    if (status >= 0) status = make_reference(state);
    if (status >= 0) status = try_all(state);
    if (status >= 0) status = take(state, out);
    if (status < 0 && !state->cancelled) {
        pliant_log(PLIANT_LOG_WARNING, "choose: the scene's own settings stay, with an error that is not known: %s",
                   state->late ? "choose/seconds were over before anything was measured" : pliant_last_error());
        *out = (pliant_choice){.scene = *input->scene};
        status = PLIANT_OK;
    }
    sweep_free_ground(&state->sweep.ground);
    pliant_free(state);
    if (!tables) pliant_report_close(&own);
    return status;
}
