/* Evaluate the measured candidates, and choose one. */
#include "report/choice.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double equal_max_error_ratio = 2; /* factor within which maximum errors count as equal */
static const double equal_settled_error_ratio = 1.05;       /* factor within which later errors count as equal */

#define COLUMN(name, yaml) #yaml "_percent",
static const char *const error_columns[NUM_MEASURES] = {PLIANT_MEASURE_LIST(COLUMN)}; /* columns of a sweep */
#undef COLUMN
#define COLUMN(name, yaml) "final_" #yaml "_mm",
static const char *const final_columns[NUM_MEASURES] = {PLIANT_MEASURE_LIST(COLUMN)};
#undef COLUMN

const char *choice_phase_text(choice_phase phase)
{
    static const char *const texts[] = {
#define PHASE_TEXT(name, text) text,
        CHOICE_PHASE_LIST(PHASE_TEXT)
#undef PHASE_TEXT
    };
    return texts[phase];
}

/* ---- reading rows */

static const char *cell(const pliant_results *table, size_t row, const char *column)
{
    return pliant_results_cell(table, row, pliant_results_column(table, column));
}

static double number(const pliant_results *table, size_t row, const char *column)
{
    return strtod(cell(table, row, column), NULL);
}

static bool is_before_patch(const pliant_results *table, size_t row)
{
    return strstr(cell(table, row, "variant"), SWEEP_BEFORE_PATCH) != NULL;
}

/* Find the last row of a case with this budget, or with a smaller budget that converged; SIZE_MAX: none. */
static size_t find_row(const pliant_results *table, size_t first, const char *name, bool before_patch,
                       int32_t iterations)
{
    size_t found = SIZE_MAX;
    for (size_t r = first; r < pliant_results_rows(table); r++) {
        int32_t budget = (int32_t)strtol(cell(table, r, "budget"), NULL, 10);
        bool converged = strcmp(cell(table, r, "status"), "ok") == 0;
        if (budget != iterations && !(converged && budget < iterations)) continue;
        if (is_before_patch(table, r) == before_patch && strcmp(cell(table, r, "case"), name) == 0 &&
            cell(table, r, "max_percent")[0])
            found = r;
    }
    return found;
}

static void add_row(const pliant_results *table, size_t row, choice_phase phase, choice_point *point)
{
    for (int m = 0; m < NUM_MEASURES; m++) {
        double worst = 0.01 * number(table, row, error_columns[m]), settled_error = worst;
        if (phase == CHOICE_PHASE_sag)
            settled_error = number(table, row, final_columns[m]) / number(table, row, "largest_mm");
        if (phase != CHOICE_PHASE_hold) point->settled_error[m] = fmax(point->settled_error[m], settled_error);
        if (worst > point->error[m]) point->worst[m] = phase;
        point->error[m] = fmax(point->error[m], worst);
    }
    if (phase == CHOICE_PHASE_hold) return; /* the time limit applies to steps with a patch */
    point->seconds = fmax(point->seconds, 1e-3 * number(table, row, "solver_median_ms"));
    point->evaluations = fmax(point->evaluations, number(table, row, "iterations_mean"));
    point->solved_tetrahedra = (int32_t)number(table, row, "solved_tetrahedra");
    point->fine_tetrahedra = (int32_t)number(table, row, "fine_tetrahedra");
    point->on_host = strcmp(cell(table, row, "backend"), "cpu") == 0;
}

/* Return false if a case is missing. */
static bool gather_point(const sweep_ground *ground, size_t first, choice_point *point)
{
    const pliant_results *table = ground->tables->sweep;
    for (int c = 0; c < ground->num_cases; c++) {
        report_case_kind kind = ground->cases[c].kind;
        bool patched = sweep_runs_before_patch(ground, kind);
        for (int before = 0; before <= patched; before++) {
            size_t row = find_row(table, first, report_case_name(kind), before, point->iterations);
            if (row == SIZE_MAX) return false;
            add_row(table, row,
                    before             ? CHOICE_PHASE_hold
                    : kind == CASE_sag ? CHOICE_PHASE_sag
                                       : CHOICE_PHASE_pull,
                    point);
        }
    }
    return true;
}

int choice_collect_points(const sweep_ground *ground, const choice_candidate *candidate, size_t first,
                          choice_point out[CHOICE_BUDGETS])
{
    int count = 0;
    for (int b = 0; b < ground->sweep->num_iterations; b++) {
        choice_point point = {.candidate = *candidate, .iterations = ground->sweep->iterations[b]};
        if (!gather_point(ground, first, &point)) continue;
        /* an additional iteration that changed nothing gives no separate point */
        const choice_point *last = count > 0 ? out + count - 1 : NULL;
        if (last && memcmp(last->error, point.error, sizeof point.error) == 0 && last->seconds == point.seconds)
            continue;
        out[count++] = point;
    }
    return count;
}

/* ---- choosing a point */

static bool is_patched(const choice_point *point)
{
    return point->candidate.by.patch > 0 && point->candidate.by.method != PLIANT_FINE;
}

/* Return whether a does at least the work of b per step: as many evaluations, meshes at least as large, and no patch or
 * lod elements that only b has. */
static bool needs_at_least_work_of(const choice_point *a, const choice_point *b)
{
    bool lod = b->candidate.by.method == PLIANT_LOD && a->candidate.by.method != PLIANT_LOD;
    bool patch = is_patched(b) && !is_patched(a);
    return !lod && !patch && a->on_host == b->on_host && a->evaluations >= b->evaluations &&
           a->solved_tetrahedra >= b->solved_tetrahedra && a->fine_tetrahedra >= b->fine_tetrahedra;
}

double choice_seconds(const choice_point *points, int count, const choice_point *of)
{
    double minimum = of->seconds;
    for (int p = 0; p < count; p++)
        if (needs_at_least_work_of(points + p, of)) minimum = fmin(minimum, points[p].seconds);
    return minimum;
}

double choice_mesh_error(const choice_point *points, int count, int32_t resolution, pliant_measure measure)
{
    double minimum = NAN;
    for (int p = 0; p < count; p++) {
        const choice_candidate *by = &points[p].candidate;
        if (by->by.method == PLIANT_FINE && by->mesh.cells_factor * by->mesh.ratio == resolution)
            minimum = fmin(minimum, points[p].error[measure]);
    }
    return minimum;
}

double choice_reference_error(const choice_point *points, int count, int32_t resolution, pliant_measure measure)
{
    const double half = choice_mesh_error(points, count, resolution / 2, measure),
                 quarter = choice_mesh_error(points, count, resolution / 4, measure);
    const double theory = 2, minimum = 0.2; /* orders of convergence */
    if (resolution % 4 != 0 || !(half > 0) || !(quarter > 0)) return 0;
    const double observed_order = quarter > half ? log2(quarter / half - 1) : minimum;
    return half / (exp2(0.5 * (fmin(fmax(observed_order, minimum), theory) + theory)) - 1);
}

const choice_point *choice_best(const choice_point *points, int count, pliant_measure measure, double reference_error,
                                double max_seconds)
{
    const choice_point *best = NULL;
    double minimum = INFINITY, min_settled_error = INFINITY, best_seconds = INFINITY;
    for (int p = 0; p < count; p++)
        if (choice_seconds(points, count, points + p) <= max_seconds) minimum = fmin(minimum, points[p].error[measure]);
    for (int pass = 0; pass < 2; pass++)
        for (int p = 0; p < count; p++) {
            const choice_point *point = points + p;
            double seconds = choice_seconds(points, count, point), settled_error = point->settled_error[measure];
            if (seconds > max_seconds ||
                point->error[measure] + reference_error > equal_max_error_ratio * (minimum + reference_error))
                continue;
            if (pass == 0)
                min_settled_error = fmin(min_settled_error, settled_error);
            else if (settled_error + reference_error >
                     equal_settled_error_ratio * (min_settled_error + reference_error))
                continue;
            else if (seconds < best_seconds ||
                     (seconds == best_seconds && point->error[measure] < best->error[measure])) {
                best = point;
                best_seconds = seconds;
            }
        }
    return best;
}

const choice_point *choice_fastest(const choice_point *points, int count)
{
    const choice_point *best = count > 0 ? points : NULL;
    for (int p = 1; p < count; p++)
        if (choice_seconds(points, count, points + p) < choice_seconds(points, count, best)) best = points + p;
    return best;
}
