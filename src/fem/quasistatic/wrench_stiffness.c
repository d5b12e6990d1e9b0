/* Derivative of a tool's wrench. The rows W of a step are three for every spring. A pressing contact point has its
 * normal and, while it sticks, its tangents. The motion of the rows under forces on them is A = c I + W K^-1 W' (c for
 * springs alone), which the step has computed. A motion m of the tool, translation and rotation vector about its tip,
 * moves the rows' targets by G m. The forces change by A^-1 G m, and the wrench by G' A^-1 G m. */
#include "fem/quasistatic/wrench_stiffness.h"

#include "base/fail.h"
#include "base/dense.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

/* Rows of the step's matrix that belong to A, and their G. */
typedef struct active_rows {
    int32_t count;
    int32_t *row;   /* of the whole matrix */
    double *motion; /* G (count x 6) */
} active_rows;

static void add_row(active_rows *rows, int32_t row, const double *motion)
{
    rows->row[rows->count] = row;
    if (motion) memcpy(rows->motion + 6 * (size_t)rows->count, motion, 6 * sizeof *motion);
    rows->count++;
}

/* Compute the motion of a direction at a point of the tool, with an arm from the tip: v . (translation + rotation x
 * arm). */
static void move_with_tool(const double direction[3], const double arm[3], double motion[6])
{
    memcpy(motion, direction, 3 * sizeof *motion);
    for (int d = 0; d < 3; d++)
        motion[3 + d] = arm[(d + 1) % 3] * direction[(d + 2) % 3] - arm[(d + 2) % 3] * direction[(d + 1) % 3];
}

static void list_points(const pliant_contact_problem *contacts, int tool, const double tip[3], active_rows *rows)
{
    for (int32_t c = 0; c < contacts->count; c++) {
        const pliant_contact_point *point = contacts->points->point + contacts->point[c];
        const double *force = contacts->taken.force + 3 * (size_t)c, *frame = contacts->frame + 9 * (size_t)c;
        if (!(force[0] > 0)) continue;
        const bool sticks = hypot(force[1], force[2]) < (1 - 1e-6) * contacts->friction[c] * force[0];
        const bool moves = point->kind == PLIANT_OBSTACLE_TOOL && point->tool == tool;
        double arm[3];
        for (int d = 0; d < 3; d++) arm[d] = point->place[d] - tip[d];
        for (int r = 0; r < (sticks ? 3 : 1); r++) {
            double motion[6];
            move_with_tool(frame + 3 * r, arm, motion);
            add_row(rows, 3 * c + r, moves ? motion : NULL);
        }
    }
}

/* List the rows of a spring, which acts at the tip. */
static void list_spring(bool moves, int32_t row, active_rows *rows)
{
    for (int d = 0; d < 3; d++) {
        const double motion[6] = {d == 0, d == 1, d == 2, 0, 0, 0};
        add_row(rows, row + d, moves ? motion : NULL);
    }
}

/* Compute G' A^-1 G. A small amount is added to A's diagonal, since contact points of one triangle can have dependent
 * rows. */
static bool condense(const active_rows *rows, const double *whole, size_t width, double *matrix, double *right,
                     double stiffness[36])
{
    const size_t count = (size_t)rows->count;
    double trace = 0;
    for (size_t i = 0; i < count; i++) {
        for (size_t j = 0; j < count; j++)
            matrix[count * i + j] = whole[width * (size_t)rows->row[i] + (size_t)rows->row[j]];
        trace += matrix[count * i + i];
    }
    for (size_t i = 0; i < count; i++) matrix[count * i + i] += 1e-9 * trace;
    memcpy(right, rows->motion, 6 * count * sizeof *right);
    if (!pliant_dense_solve(rows->count, matrix, 6, right)) return false;
    for (size_t a = 0; a < 6; a++)
        for (size_t b = 0; b < 6; b++) {
            double sum = 0;
            for (size_t i = 0; i < count; i++)
                sum += rows->motion[6 * i + a] * right[6 * i + b] + rows->motion[6 * i + b] * right[6 * i + a];
            stiffness[6 * a + b] = 0.5 * sum;
        }
    return true;
}

pliant_status pliant_solver_stiffness(const pliant_solver *solver, int tool, const double tip[3], double stiffness[36],
                                      bool *known)
{
    int spring[PLIANT_MAX_TOOLS];
    const int num_springs = pliant_solver_list_springs(solver, spring);
    memset(stiffness, 0, 36 * sizeof *stiffness);
    *known = true;
    for (int s = 0; s < num_springs; s++)
        if (solver->grasps[spring[s]].response_number == 0) *known = false;
    const pliant_contact_problem *contacts =
        pliant_contact_problem_has_points(solver->contacts) ? solver->contacts : NULL;
    const size_t width = 3 * ((size_t)num_springs + (contacts ? (size_t)contacts->count : 0));
    if (!*known || width == 0) return PLIANT_OK;
    active_rows rows = {.row = pliant_calloc(width, sizeof *rows.row),
                      .motion = pliant_calloc(width, 6 * sizeof *rows.motion)};
    double *whole = contacts ? NULL : pliant_calloc(width, width * sizeof *whole);
    double *matrix = pliant_calloc(width, width * sizeof *matrix), *right = pliant_calloc(width, 6 * sizeof *right);
    pliant_status status = rows.row && rows.motion && matrix && right && (whole || contacts)
                               ? PLIANT_OK
                               : pliant_fail_memory("a tool's stiffness");
    if (status == PLIANT_OK) {
        if (contacts) list_points(contacts, tool, tip, &rows);
        else
            pliant_solver_fill_springs(solver, spring, num_springs, width, whole);
        for (int s = 0; s < num_springs; s++)
            list_spring(spring[s] == tool, (int32_t)width - 3 * (num_springs - s), &rows);
        if (rows.count > 0)
            *known = condense(&rows, contacts ? contacts->matrix : whole, width, matrix, right, stiffness);
    }
    PLIANT_FREE(rows.row, rows.motion, whole, matrix, right);
    return status;
}
