#include "contact/solve/cones.h"

#include "base/dense.h"
#include "base/lanes.h"

#include <string.h>

enum { HISTORY = PLIANT_CONE_HISTORY };

/* History of the sweeps: differences of successive ones. */
typedef struct sweep_history {
    /* (HISTORY x rows): of the change by a sweep, and of the forces and motions after it */
    double *moved, *force, *motion;
    double gram[HISTORY][HISTORY];
    int32_t count, next;
} sweep_history;

static void remember(sweep_history *history, size_t row, const double *change, const double *change_before,
                     const double *force, const double *force_before, const double *motion, const double *motion_before)
{
    const size_t at = row * (size_t)history->next;
    for (size_t i = 0; i < row; i++) {
        history->moved[at + i] = change[i] - change_before[i];
        history->force[at + i] = force[i] - force_before[i];
        history->motion[at + i] = motion[i] - motion_before[i];
    }
    if (history->count < HISTORY) history->count++;
    for (int32_t h = 0; h < history->count; h++)
        history->gram[history->next][h] = history->gram[h][history->next] =
            pliant_dot(row, history->moved + at, history->moved + row * (size_t)h);
    history->next = (history->next + 1) % HISTORY;
}

/* Apply Anderson acceleration (anderson.h). Motions are linear in the forces, so they are mixed with the same
 * weights. */
static void mix(const sweep_history *history, size_t row, const double *change, double *force, double *motion)
{
    const double noise = 1e-10;
    double equations[HISTORY * HISTORY], weight[HISTORY];
    const int32_t m = history->count;
    for (int32_t a = 0; a < m; a++) {
        weight[a] = pliant_dot(row, history->moved + row * (size_t)a, change);
        for (int32_t b = 0; b < m; b++) equations[a * m + b] = history->gram[a][b] * (a == b ? 1 + noise : 1);
    }
    if (!pliant_dense_cholesky(m, equations)) return;
    pliant_dense_cholesky_solve(m, equations, 1, weight);
    for (int32_t a = 0; a < m; a++)
        for (size_t i = 0; i < row; i++) {
            force[i] -= weight[a] * history->force[row * (size_t)a + i];
            motion[i] -= weight[a] * history->motion[row * (size_t)a + i];
        }
}

/* Sweep with acceleration. The last operation is a sweep, so all forces are in their cones.
 * @param buffer (4 + 3 HISTORY) x rows: work array */
static int32_t sweep_mixed(const pliant_team *team, const pliant_cones *on, double *buffer)
{
    const double enough = PLIANT_CONE_TOLERANCE; /* change by a sweep divided by the largest one */
    const size_t row = 3 * (size_t)on->count;
    double *change = buffer, *before[3] = {buffer + row, buffer + 2 * row, buffer + 3 * row}, largest = 0,
           last = INFINITY;
    sweep_history history = {
        .moved = buffer + 4 * row, .force = buffer + (4 + HISTORY) * row, .motion = buffer + (4 + 2 * HISTORY) * row};
    for (int32_t made = 1;; made++) {
        memcpy(change, on->force, row * sizeof *change);
        const double square = pliant_cones_sweep(team, on);
        largest = fmax(largest, square);
        if (square <= enough * enough * largest || made >= PLIANT_CONE_SWEEPS) return made;
        for (size_t i = 0; i < row; i++) change[i] = on->force[i] - change[i];
        if (square > 4 * last) history.count = history.next = 0;
        else if (made > 1) remember(&history, row, change, before[0], on->force, before[1], on->motion, before[2]);
        last = square;
        memcpy(before[0], change, row * sizeof *change);
        memcpy(before[1], on->force, row * sizeof *change);
        memcpy(before[2], on->motion, row * sizeof *change);
        if (history.count > 0) mix(&history, row, change, on->force, on->motion);
    }
}

PLIANT_VECTORIZED static int32_t solve(int32_t count, const double *matrix, const double *friction, double *motion,
                                       double *force, double *resistance, double *buffer)
{
    const size_t row = 3 * (size_t)count;
    const pliant_team team = {.size = 1};
    _Static_assert(sizeof(pliant_cone_point) <= 9 * sizeof(double), "three rows of room a point");
    double *rest = buffer + 7 * row;
    pliant_cones on = {.count = count,
                       .matrix = matrix,
                       .friction = friction,
                       .motion = motion,
                       .force = force,
                       .resistance = resistance,
                       .change = buffer,
                       .moved = buffer + row,
                       .before = buffer + 6 * row,
                       .equations = rest + (PLIANT_CONE_BUFFER - 7) * row,
                       .fast_rows = PLIANT_CONE_MAX_ROWS,
                       .few_rows = PLIANT_CONE_FEW_ROWS,
                       .all = &team};
    void *points = buffer + 2 * row, *lists = buffer + 5 * row;
    on.point = points;
    on.list = lists;
    on.changing = on.list + count;
    const int32_t found = pliant_cones_run(&team, &on);
    if (found >= 0) return found;
    pliant_cones_begin_round(&team, &on);
    const int32_t swept = sweep_mixed(&team, &on, rest);
    pliant_cones_end_round(&team, &on);
    return swept - found - 1;
}

int32_t pliant_cones_solve(int32_t count, const double *matrix, const double *friction, double *motion, double *force,
                           double *resistance, double *buffer)
{
    return solve(count, matrix, friction, motion, force, resistance, buffer);
}
