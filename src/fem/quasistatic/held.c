#include "fem/quasistatic/held.h"

#include "base/fail.h"
#include "base/dense.h"
#include "base/memory.h"

#include <string.h>

enum { MOST_ROWS = 600 }; /* with more rows, a dense factor would take longer than the step */

/* Fill A: rows of points in the order of the list, then rows of the tools. */
static void fill_matrix(const pliant_solver *solver, pliant_held *held, const double *springs)
{
    const pliant_touches *touches = solver->touches;
    const size_t rows = (size_t)held->rows, points = (size_t)held->contact_rows,
                 whole = pliant_touches_any(touches) ? 3 * (size_t)(touches->count + held->num_tools) : 0;
    double largest = 0;
    for (size_t r = 0; r < rows; r++)
        for (size_t c = 0; c < rows; c++) {
            const size_t from = r < points ? (size_t)held->contact_row[r] : r - points,
                         to = c < points ? (size_t)held->contact_row[c] : c - points;
            const size_t base = whole > 0 ? 3 * (size_t)touches->count : 0;
            held->factor[r * rows + c] =
                whole > 0 ? touches->matrix[(r < points ? from : base + from) * whole + (c < points ? to : base + to)]
                          : springs[from * rows + to];
            if (r == c) largest = fmax(largest, held->factor[r * rows + c]);
        }
    const double rounding = 1e-9; /* points with the same nodes have equal rows */
    for (size_t r = 0; r < points; r++) held->factor[r * rows + r] += rounding * largest;
}

/* List the rows of pressing points, and their tangential rows if friction is below its limit. Points on detached pieces
 * are left out: the pieces give way, and such points only push. */
static int32_t list_rows(const pliant_touches *touches, int32_t *row)
{
    const double sticks = 0.999;
    int32_t count = 0;
    for (int32_t c = 0; c < touches->count; c++) {
        const double *force = touches->found.force + 3 * (size_t)c,
                     slide = sqrt(force[1] * force[1] + force[2] * force[2]);
        const bool of_piece = touches->pieces && touches->arm_start[c + 1] > touches->arm_start[c];
        if (!(force[0] > 0) || of_piece) continue;
        const int rows = slide < sticks * touches->friction[c] * force[0] ? 3 : 1;
        for (int k = 0; k < rows; k++) row[count++] = 3 * c + k;
    }
    return count;
}

pliant_status pliant_held_create(const pliant_solver *solver, pliant_held *held, bool *holds)
{
    const pliant_touches *touches = solver->touches;
    double springs[PLIANT_MAX_ROWS * PLIANT_MAX_ROWS];
    memset(held, 0, sizeof *held);
    *holds = true;
    held->num_tools = pliant_solver_springs(solver, held->tool, springs);
    if (pliant_touches_any(touches)) {
        held->contact_row = pliant_calloc((size_t)touches->count, 3 * sizeof *held->contact_row);
        held->point_force = pliant_calloc((size_t)touches->count, 3 * sizeof *held->point_force);
        held->pulled = pliant_calloc(pliant_solver_unknowns(solver), sizeof *held->pulled);
        if (!held->contact_row || !held->point_force || !held->pulled) return pliant_fail_memory("the solver");
        held->contact_rows = list_rows(touches, held->contact_row);
    }
    held->rows = held->contact_rows + 3 * held->num_tools;
    if (held->rows == 0) return PLIANT_OK;
    *holds = held->rows <= MOST_ROWS;
    if (!*holds) return PLIANT_OK;
    const size_t rows = (size_t)held->rows;
    held->factor = pliant_calloc(rows * rows, sizeof *held->factor);
    held->right = pliant_calloc(rows, sizeof *held->right);
    if (!held->factor || !held->right) return pliant_fail_memory("the solver");
    fill_matrix(solver, held, springs);
    *holds = pliant_dense_cholesky(held->rows, held->factor);
    return PLIANT_OK;
}

void pliant_held_free(pliant_held *held)
{
    pliant_free(held->contact_row);
    pliant_free(held->factor);
    pliant_free(held->right);
    pliant_free(held->point_force);
    pliant_free(held->pulled);
}

static void spread(const pliant_held *held, const pliant_touches *touches, const double *row, double share)
{
    memset(held->point_force, 0, 3 * (size_t)touches->count * sizeof *held->point_force);
    for (int32_t r = 0; r < held->contact_rows; r++) held->point_force[held->contact_row[r]] = share * row[r];
}

pliant_status pliant_held_keep(const pliant_solver *solver, const pliant_held *held, double *v, pliant_held_forces *dl)
{
    const size_t n = pliant_solver_unknowns(solver);
    memset(dl->tool, 0, sizeof dl->tool);
    if (held->rows == 0) return PLIANT_OK;
    for (int32_t r = 0; r < held->contact_rows; r++) {
        double moved[3] = {0, 0, 0};
        pliant_touches_apply(solver->touches, held->contact_row[r] / 3, v, moved);
        held->right[r] = -moved[held->contact_row[r] % 3];
    }
    for (int t = 0; t < held->num_tools; t++) {
        double moved[3] = {0, 0, 0};
        pliant_handle_apply(solver->handles + held->tool[t], v, moved);
        for (int d = 0; d < 3; d++) held->right[held->contact_rows + 3 * t + d] = -moved[d];
    }
    pliant_dense_cholesky_solve(held->rows, held->factor, 1, held->right);
    for (int t = 0; t < held->num_tools; t++) {
        double *force = dl->tool + 3 * held->tool[t];
        memcpy(force, held->right + held->contact_rows + 3 * t, 3 * sizeof *force);
        pliant_solver_respond_to(solver, held->tool[t], force, v);
    }
    if (held->contact_rows == 0) return PLIANT_OK;
    memcpy(dl->row, held->right, (size_t)held->contact_rows * sizeof *dl->row);
    spread(held, solver->touches, dl->row, 1);
    memset(held->pulled, 0, n * sizeof *held->pulled);
    pliant_touches_pull(solver->touches, held->point_force, held->pulled);
    pliant_status status = pliant_preconditioner_solve(solver->preconditioner, 1, held->pulled, held->pulled);
    for (size_t i = 0; i < n; i++) v[i] += held->pulled[i];
    return status;
}

void pliant_held_pull(const pliant_solver *solver, const pliant_held *held, const pliant_held_forces *dl, double share,
                      double *v)
{
    for (int t = 0; t < held->num_tools; t++) {
        const double *force = dl->tool + 3 * held->tool[t],
                     part[3] = {share * force[0], share * force[1], share * force[2]};
        pliant_handle_pull(solver->handles + held->tool[t], part, v);
    }
    if (held->contact_rows == 0) return;
    spread(held, solver->touches, dl->row, share);
    pliant_touches_pull(solver->touches, held->point_force, v);
}
