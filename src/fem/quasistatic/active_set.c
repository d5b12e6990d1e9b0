#include "fem/quasistatic/active_set.h"

#include "base/fail.h"
#include "base/dense.h"
#include "base/memory.h"

#include <string.h>

enum { MAX_ROWS = 600 }; /* with more rows, a dense factor would take longer than the step */
static const double sticking = 0.999; /* fraction of the friction limit: a point with less friction sticks */

/* Fill A: rows of points in the order of the list, then rows of the tools. */
static void fill_matrix(const pliant_solver *solver, pliant_active_set *active, const double *springs)
{
    const pliant_contact_problem *contacts = solver->contacts;
    const size_t rows = (size_t)active->rows, points = (size_t)active->contact_rows,
                 whole = pliant_contact_problem_has_points(contacts) ? 3 * (size_t)(contacts->count + active->num_tools)
                                                                     : 0;
    double largest = 0;
    for (size_t r = 0; r < rows; r++)
        for (size_t c = 0; c < rows; c++) {
            const size_t from = r < points ? (size_t)active->contact_row[r] : r - points,
                         to = c < points ? (size_t)active->contact_row[c] : c - points;
            const size_t base = whole > 0 ? 3 * (size_t)contacts->count : 0;
            active->factor[r * rows + c] =
                whole > 0 ? contacts->matrix[(r < points ? from : base + from) * whole + (c < points ? to : base + to)]
                          : springs[from * rows + to];
            if (r == c) largest = fmax(largest, active->factor[r * rows + c]);
        }
    const double rounding = 1e-9; /* points with the same nodes have equal rows */
    for (size_t r = 0; r < points; r++) active->factor[r * rows + r] += rounding * largest;
}

/* List the rows of pressing points, and their tangential rows if friction is below its limit. Points on detached pieces
 * are left out: the pieces give way, and such points only push. */
static int32_t list_rows(const pliant_contact_problem *contacts, int32_t *row)
{
    int32_t count = 0;
    for (int32_t c = 0; c < contacts->count; c++) {
        const double *force = contacts->found.force + 3 * (size_t)c,
                     slide = sqrt(force[1] * force[1] + force[2] * force[2]);
        const bool of_piece = contacts->pieces && contacts->arm_start[c + 1] > contacts->arm_start[c];
        if (!(force[0] > 0) || of_piece) continue;
        const int rows = slide < sticking * contacts->friction[c] * force[0] ? 3 : 1;
        for (int k = 0; k < rows; k++) row[count++] = 3 * c + k;
    }
    return count;
}

pliant_status pliant_active_set_create(const pliant_solver *solver, pliant_active_set *active, bool *holds)
{
    const pliant_contact_problem *contacts = solver->contacts;
    double springs[PLIANT_MAX_ROWS * PLIANT_MAX_ROWS];
    memset(active, 0, sizeof *active);
    *holds = true;
    active->num_tools = pliant_solver_list_springs(solver, active->tool);
    pliant_solver_fill_springs(solver, active->tool, active->num_tools, 3 * (size_t)active->num_tools, springs);
    if (pliant_contact_problem_has_points(contacts)) {
        active->contact_row = pliant_calloc((size_t)contacts->count, 3 * sizeof *active->contact_row);
        active->point_force = pliant_calloc((size_t)contacts->count, 3 * sizeof *active->point_force);
        active->pulled = pliant_calloc(pliant_solver_unknowns(solver), sizeof *active->pulled);
        if (!active->contact_row || !active->point_force || !active->pulled) return pliant_fail_memory("the solver");
        active->contact_rows = list_rows(contacts, active->contact_row);
    }
    active->rows = active->contact_rows + 3 * active->num_tools;
    if (active->rows == 0) return PLIANT_OK;
    *holds = active->rows <= MAX_ROWS;
    if (!*holds) return PLIANT_OK;
    const size_t rows = (size_t)active->rows;
    active->factor = pliant_calloc(rows * rows, sizeof *active->factor);
    active->right = pliant_calloc(rows, sizeof *active->right);
    if (!active->factor || !active->right) return pliant_fail_memory("the solver");
    fill_matrix(solver, active, springs);
    *holds = pliant_dense_cholesky(active->rows, active->factor);
    return PLIANT_OK;
}

void pliant_active_set_free(pliant_active_set *active)
{
    PLIANT_FREE(active->contact_row, active->factor, active->right, active->point_force, active->pulled);
}

static void spread(const pliant_active_set *active, const pliant_contact_problem *contacts, const double *row,
                   double fraction)
{
    memset(active->point_force, 0, 3 * (size_t)contacts->count * sizeof *active->point_force);
    for (int32_t r = 0; r < active->contact_rows; r++) active->point_force[active->contact_row[r]] = fraction * row[r];
}

pliant_status pliant_active_set_project(const pliant_solver *solver, const pliant_active_set *active, double *v,
                                        pliant_active_forces *dl)
{
    const size_t n = pliant_solver_unknowns(solver);
    memset(dl->tool, 0, sizeof dl->tool);
    if (active->rows == 0) return PLIANT_OK;
    for (int32_t r = 0; r < active->contact_rows; r++) {
        double moved[3] = {0, 0, 0};
        pliant_contact_problem_apply(solver->contacts, active->contact_row[r] / 3, v, moved);
        active->right[r] = -moved[active->contact_row[r] % 3];
    }
    for (int t = 0; t < active->num_tools; t++) {
        double moved[3] = {0, 0, 0};
        pliant_grasp_apply(solver->grasps + active->tool[t], v, moved);
        for (int d = 0; d < 3; d++) active->right[active->contact_rows + 3 * t + d] = -moved[d];
    }
    pliant_dense_cholesky_solve(active->rows, active->factor, 1, active->right);
    for (int t = 0; t < active->num_tools; t++) {
        double *force = dl->tool + 3 * active->tool[t];
        memcpy(force, active->right + active->contact_rows + 3 * t, 3 * sizeof *force);
        pliant_solver_add_response(solver, active->tool[t], force, v);
    }
    if (active->contact_rows == 0) return PLIANT_OK;
    memcpy(dl->row, active->right, (size_t)active->contact_rows * sizeof *dl->row);
    spread(active, solver->contacts, dl->row, 1);
    memset(active->pulled, 0, n * sizeof *active->pulled);
    pliant_contact_problem_add_forces(solver->contacts, active->point_force, active->pulled);
    pliant_status status = pliant_preconditioner_solve(solver->preconditioner, 1, active->pulled, active->pulled);
    for (size_t i = 0; i < n; i++) v[i] += active->pulled[i];
    return status;
}

void pliant_active_set_add_forces(const pliant_solver *solver, const pliant_active_set *active,
                                  const pliant_active_forces *dl, double fraction, double *v)
{
    for (int t = 0; t < active->num_tools; t++) {
        const double *force = dl->tool + 3 * active->tool[t],
                     part[3] = {fraction * force[0], fraction * force[1], fraction * force[2]};
        pliant_grasp_add_pull(solver->grasps + active->tool[t], part, v);
    }
    if (active->contact_rows == 0) return;
    spread(active, solver->contacts, dl->row, fraction);
    pliant_contact_problem_add_forces(solver->contacts, active->point_force, v);
}
