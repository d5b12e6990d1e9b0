/* Estimate the discretization error of a mesh relative to the continuum, in addition to the solver's error on the
 * mesh. */
#include "base/fail.h"
#include "base/memory.h"
#include "report/sweep.h"
#include "scene/scene.h"
#include "model_data/data.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { LEVELS = 3, RAMP = 4 /* frames in which the load grows */ };
static const char *const law_names[] = {
#define LAW_NAME(value, name) #name,
    PLIANT_ELASTICITY_LIST(LAW_NAME)
#undef LAW_NAME
};
static const double theory = 2; /* order of displacements for linear elements and smooth solutions */

/* Three meshes of one scene, each with twice the resolution of the previous one. */
typedef struct ladder {
    pliant_model *model[LEVELS];
    pliant_points points[LEVELS];
    double *at[LEVELS];          /* (count x 3) positions of the points */
    double scale[LEVELS];        /* resolution relative to the scene's */
    int own;                     /* index of the scene's own mesh */
    int32_t count;
    double *rest;                /* (count x 3) nodes of the scene's own mesh with tissue */
    uint8_t *use;                /* (count) whether every mesh contains the point */
} ladder;

static double mean_square(int32_t count, const uint8_t *use, const double *a, const double *b)
{
    double sum = 0;
    for (int32_t n = 0; n < 3 * count; n++)
        if (!use || use[n / 3]) sum += (a[n] - b[n]) * (a[n] - b[n]);
    return sum;
}

/* Extrapolate to infinite resolution: u - u_h decreases by 2^-p from mesh to mesh. The observed order of the last two
 * differences is below the theoretical one on coarse meshes and approaches it. The remainder of the series is summed
 * with the mean of both orders. */
double pliant_extrapolate(int32_t count, const uint8_t *use, const double *coarse, const double *middle,
                          const double *fine, double *out)
{
    const double minimum = 0.2, maximum = 2 * theory;
    const double before = mean_square(count, use, middle, coarse), last = mean_square(count, use, fine, middle);
    const double observed_order = last > 0 && before > 0 ? 0.5 * log2(before / last) : theory;
    const double order = 0.5 * (fmin(fmax(observed_order, minimum), maximum) + theory), part = 1 / (exp2(order) - 1);
    for (int32_t n = 0; n < 3 * count; n++) out[n] = fine[n] + part * (fine[n] - middle[n]);
    return observed_order;
}

static void ladder_free(ladder *all)
{
    for (int l = 0; l < LEVELS; l++) {
        pliant_points_free(&all->points[l]);
        pliant_model_free(all->model[l]);
        pliant_free(all->at[l]);
    }
    pliant_free(all->rest);
    pliant_free(all->use);
}

/* Scale the scene's fine mesh; false: the number of cells is not whole, or too large. */
static bool scaled(const pliant_scene *scene, double scale, pliant_scene *out)
{
    *out = *scene;
    out->element.kind = pliant_scene_element_kind(scene, NULL); /* elements of the requested method */
    for (int d = 0; d < 3; d++) {
        const double cells = scene->mesh.coarse_cells[d] * scene->mesh.ratio * scale;
        if (cells < 1 || cells != floor(cells)) return false;
        out->mesh.coarse_cells[d] = (int32_t)cells;
    }
    out->mesh.ratio = 1;
    out->model.method = PLIANT_FINE;
    out->solver.backend = PLIANT_CPU;
    out->solver.budget_ms = 0;
    for (int d = 0; d < 3; d++)
        if (out->mesh.coarse_cells[d] > 256) return false;
    return true;
}

static pliant_status build(const pliant_report_input *input, const pliant_scene *scene, pliant_progress progress,
                           pliant_model **out)
{
    return pliant_model_build(scene, input->scan, input->labels, input->materials, progress, out);
}

/* Choose the position of the scene's own mesh among the three: as fine as the limit of tetrahedra permits. */
static pliant_status choose_levels(const pliant_report_input *input, double limit, int32_t tets, ladder *all)
{
    pliant_scene trial;
    for (all->own = 0; all->own < LEVELS; all->own++) {
        bool good = true;
        for (int l = 0; l < LEVELS; l++) {
            all->scale[l] = exp2(l - all->own);
            good = good && scaled(input->scene, all->scale[l], &trial) &&
                   (l <= all->own || pow(all->scale[l], 3) * tets <= limit);
        }
        if (good) return PLIANT_OK;
    }
    return pliant_fail(
        PLIANT_ERROR_SCENE,
        "the error of the mesh needs three resolutions. Half the resolution needs an even mesh/coarse_cells times "
        "mesh/ratio; twice the resolution needs a limit above %.0f tetrahedra (--refined)",
        limit);
}

static pliant_status ladder_create(const pliant_report_input *input, const pliant_sweep *sweep,
                                   pliant_progress progress, ladder *all)
{
    pliant_scene scene;
    pliant_model *own = NULL;
    scaled(input->scene, 1, &scene);
    pliant_status status = build(input, &scene, progress, &own);
    if (status >= 0) status = choose_levels(input, sweep->max_refined_tets, own->body->fine.num_tets, all);
    if (status < 0) {
        pliant_model_free(own);
        return status;
    }
    all->model[all->own] = own;
    status = pliant_body_points(own, &all->count, &all->rest);
    for (int l = 0; status >= 0 && l < LEVELS; l++) {
        if (l == all->own || !scaled(input->scene, all->scale[l], &scene)) continue;
        status = build(input, &scene, progress, &all->model[l]);
    }
    all->use = status >= 0 ? pliant_calloc((size_t)all->count, 1) : NULL;
    if (status >= 0 && !all->use) status = pliant_fail_memory("the points of the mesh");
    for (int l = 0; status >= 0 && l < LEVELS; l++) {
        status = pliant_points_create(&all->model[l]->body->fine, all->count, all->rest, &all->points[l]);
        if (status >= 0 && !(all->at[l] = pliant_calloc((size_t)all->count, 3 * sizeof **all->at)))
            status = pliant_fail_memory("the points of the mesh");
    }
    for (int32_t p = 0; status >= 0 && p < all->count; p++)
        all->use[p] = all->points[0].found[p] && all->points[1].found[p] && all->points[2].found[p];
    return status;
}

/* @param force Nullable: output; force on the tool at the end */
static pliant_status solve(const pliant_model *model, const report_case *load, report_limits limits,
                           const pliant_points *points, double *at, double *force)
{
    report_run run;
    pliant_status status = report_case_run(model, load, limits, points, NULL, &run);
    if (status < 0) return status;
    memcpy(at, run.positions + 3 * (size_t)(run.frames - 1) * (size_t)points->count,
           (size_t)points->count * 3 * sizeof *at);
    if (force) memcpy(force, run.force, sizeof run.force);
    report_run_free(&run);
    return PLIANT_OK;
}

static double percent(double part, double whole) { return whole > 0 ? 100 * part / whole : 0; }

/* The simulations of one law: three meshes, and the requested method and iterations. */
typedef struct law_run {
    pliant_scene scene;
    ladder all;
    pliant_model *requested;
    pliant_points points; /* points of the requested model */
    double *now;          /* (count x 3) */
} law_run;

/* Extrapolated positions of each case: (count x 3). */
typedef struct law_result { double *at[MAX_CASES]; } law_result;

static void law_run_free(law_run *run)
{
    pliant_free(run->now);
    pliant_points_free(&run->points);
    pliant_model_free(run->requested);
    ladder_free(&run->all);
}

static pliant_status law_run_create(const sweep_ground *ground, pliant_elasticity law, pliant_progress progress,
                                    law_run *run, law_result *result)
{
    pliant_report_input input = *ground->input;
    run->scene = *input.scene;
    run->scene.element.law = law;
    input.scene = &run->scene;
    pliant_status status = ladder_create(&input, ground->sweep, progress, &run->all);
    const size_t count = (size_t)run->all.count;
    if (status >= 0) status = build(&input, &run->scene, progress, &run->requested);
    if (status >= 0)
        status = pliant_points_create(&run->requested->body->fine, run->all.count, run->all.rest, &run->points);
    bool is_complete = status < 0 || (run->now = pliant_calloc(count, 3 * sizeof *run->now));
    for (int c = 0; status >= 0 && is_complete && c < ground->num_cases; c++)
        is_complete = (result->at[c] = pliant_calloc(count, 3 * sizeof **result->at)) != NULL;
    return is_complete ? status : pliant_fail_memory("the error of the mesh");
}

/* List the laws that a scene's elements can have, the scene's own law first. Return their number. */
static int list_laws(const pliant_scene *scene, pliant_elasticity law[2])
{
    law[0] = scene->element.law;
    law[1] = law[0] == PLIANT_ELASTICITY_COROTATIONAL ? PLIANT_ELASTICITY_NEO_HOOKEAN : PLIANT_ELASTICITY_COROTATIONAL;
    return scene->model.method == PLIANT_FINE ? 2 : 1;
}

/* Append the results of a case after its key. is_other: of the law that is not the scene's */
static void write_result_row(const ladder *all, const pliant_truth *truth, bool is_other, report_row *row)
{
    char tets[96];
    const double mesh = percent(truth->mesh.p95, truth->mesh.largest),
                 solver = percent(truth->solver.p95, truth->mesh.largest);
    const double halved = mesh / exp2(0.5 * (fmin(fmax(truth->order, 0.2), 2 * theory) + theory));
    snprintf(tets, sizeof tets, "%d %d %d", all->model[0]->body->fine.num_tets, all->model[1]->body->fine.num_tets,
             all->model[2]->body->fine.num_tets);
    row_text(row, "ok");
    row_text(row, "");
    row_integer(row, all->model[all->own]->body->fine.num_tets);
    row_text(row, tets);
    row_number(row, truth->order);
    row_number(row, 1e3 * truth->mesh.largest);
    row_number(row, 1e3 * truth->mesh.max);
    row_number(row, 1e3 * truth->mesh.rms);
    row_number(row, 1e3 * truth->mesh.p95);
    row_number(row, mesh);
    row_number(row, 1e3 * truth->solver.max);
    row_number(row, 1e3 * truth->solver.rms);
    row_number(row, 1e3 * truth->solver.p95);
    row_number(row, solver);
    row_text(row, mesh >= solver ? "mesh" : "solver");
    row_number(row, halved);
    row_number(row, is_other ? 1e3 * truth->laws.max : NAN);
    row_number(row, is_other ? 1e3 * truth->laws.p95 : NAN);
    row_number(row, is_other ? percent(truth->laws.p95, truth->laws.largest) : NAN);
    row_text(row,
             mesh < solver
                 ? "model/method and solver/iterations pay: the mesh is finer than they use"
                 : "mesh/coarse_cells or mesh/ratio pay, or another element/kind: the solver is better than its mesh");
}

/* Measure the errors of the mesh and of the solver in one case.
 * @param converged out: (count x 3)
 * @param is_first the law whose force on the tool is the load of the case that pulls by a force */
static pliant_status measure_case(sweep_ground *ground, int c, bool is_first, int32_t frames, pliant_progress progress,
                                  law_run *run, double *converged, pliant_truth *out)
{
    const pliant_scene *scene = ground->input->scene;
    const double tolerance = ground->sweep->reference_tolerance;
    ladder *all = &run->all;
    report_case load = ground->cases[c];
    pliant_status status = PLIANT_OK;
    const report_limits iterates_to_tolerance = {
        .tolerance = tolerance, .iterates_to_tolerance = true, .progress = progress};
    const report_limits own = {
        .iterations = scene->solver.iterations, .tolerance = scene->solver.tolerance, .progress = progress};
    for (int n = 0; status >= 0 && n < LEVELS; n++) { /* its own mesh first, which determines the forces */
        const int l = n == 0 ? all->own : n <= all->own ? n - 1 : n;
        const bool measures = is_first && l == all->own && load.kind == CASE_displacement && c + 1 < ground->num_cases;
        status = solve(all->model[l], &load, iterates_to_tolerance, &all->points[l], all->at[l],
                       measures ? ground->cases[c + 1].force : NULL);
    }
    load.frames = frames;
    if (status >= 0) status = solve(run->requested, &load, own, &run->points, run->now, NULL);
    if (status < 0) return status;
    out->order = pliant_extrapolate(all->count, all->use, all->at[0], all->at[1], all->at[2], converged);
    status = pliant_error_between(all->count, all->use, all->rest, converged, all->at[all->own], &out->mesh);
    return status < 0
               ? status
               : pliant_error_between(all->count, all->use, all->rest, all->at[all->own], run->now, &out->solver);
}

static bool is_larger(const pliant_error *a, const pliant_error *b)
{
    return a->p95 / fmax(a->largest, 1e-12) >= b->p95 / fmax(b->largest, 1e-12);
}

/* Measure all cases of a law, and write their rows.
 * @param first Nullable: the result of the scene's own law, which this law is compared with */
static pliant_status measure_law(sweep_ground *ground, const char *setup, int32_t frames, pliant_progress progress,
                                 law_run *run, const law_result *first, law_result *result, pliant_truth *worst)
{
    pliant_status status = PLIANT_OK;
    pliant_report_tables *tables = ground->tables;
    for (int c = 0; status >= 0 && c < ground->num_cases; c++) {
        report_row row;
        pliant_truth truth = {.order = 0};
        status = measure_case(ground, c, !first, frames, progress, run, result->at[c], &truth);
        if (status >= 0 && first)
            status = pliant_error_between(run->all.count, run->all.use, run->all.rest, first->at[c], result->at[c],
                                          &truth.laws);
        if (status < 0) break;
        row_clear(&row);
        row_text(&row, setup);
        row_text(&row, report_case_name(ground->cases[c].kind));
        row_text(&row, ground->point_names[c]);
        row_text(&row, law_names[run->scene.element.law]);
        const bool known = tables && row_is_stored(&row, tables->truth);
        write_result_row(&run->all, &truth, first, &row);
        if (tables && !known) status = row_add(&row, tables->truth);
        if (first && is_larger(&truth.laws, &worst->laws)) worst->laws = truth.laws;
        if (!first && is_larger(&truth.mesh, &worst->mesh)) *worst = truth;
    }
    return status;
}

pliant_status pliant_truth_run(const pliant_report_input *input, const pliant_sweep *sweep,
                               pliant_report_tables *tables, pliant_progress progress, pliant_truth *worst)
{
    char setup[9];
    pliant_sweep ours = *sweep;
    pliant_elasticity law[2];
    law_result result[2] = {{.at = {NULL}}};
    sweep_ground *ground = pliant_calloc(1, sizeof *ground);
    *worst = (pliant_truth){.order = 0};
    if (!ground) return pliant_fail_memory("the error of the mesh");
    pliant_status status =
        input->scene->solver.kind == PLIANT_COROTATIONAL && input->scene->mesh.kind == PLIANT_LATTICE &&
                !input->scene->mesh.file[0]
            ? PLIANT_OK
            : pliant_fail(PLIANT_ERROR_SCENE,
                          "the error of the mesh is estimated only for solver/kind corotational and mesh/kind lattice");
    ours.cases &= 1u << CASE_displacement | 1u << CASE_force | 1u << CASE_sag;
    ours.frames = RAMP;
    ground->input = input;
    ground->sweep = &ours;
    ground->tables = tables;
    sweep_list_cases(ground);
    pliant_report_setup(input, sweep, setup);
    const int num_laws = list_laws(input->scene, law);
    for (int l = 0; status >= 0 && l < num_laws; l++) {
        law_run run = {.now = NULL};
        status = law_run_create(ground, law[l], progress, &run, result + l);
        if (status >= 0)
            status =
                measure_law(ground, setup, sweep->frames, progress, &run, l > 0 ? result : NULL, result + l, worst);
        law_run_free(&run);
    }
    for (int l = 0; l < num_laws; l++)
        for (int c = 0; c < MAX_CASES; c++) pliant_free(result[l].at[c]);
    pliant_free(ground);
    return status;
}
