#include "fem/quasistatic/cones.h"

#include "fem/linear/dense.h"

#include <math.h>
#include <string.h>

enum { MOST_SWEEPS = 200, HISTORY = PLIANT_CONE_HISTORY };

/* new - old force of a point in a cone, at its motion v */
static void slide(const double *matrix, size_t row, double friction, const double v[3], const double f[3], double change[3])
{
    const double *n = matrix, *t = n + row, *s = t + row;
    const double normal = fmax(0, f[0] - (n[0] > 0 ? v[0] / n[0] : 0));
    change[0] = normal - f[0];
    const double mean = 0.5 * (t[1] + s[2]), apart = 0.5 * (t[1] - s[2]), stiff = mean + sqrt(apart * apart + t[2] * t[2]);
    double along[2];
    for (int k = 0; k < 2; k++) along[k] = f[1 + k] - (stiff > 0 ? (v[1 + k] + n[1 + k] * change[0]) / stiff : 0);
    const double length = sqrt(along[0] * along[0] + along[1] * along[1]), most = friction * normal;
    const double part = length > most ? most / length : 1;
    for (int k = 0; k < 2; k++) change[1 + k] = part * along[k] - f[1 + k];
}

/* v = 0: by Cramer's rule */
static void hold(const double *matrix, size_t row, const double v[3], double change[3])
{
    const double *a = matrix, *b = a + row, *c = b + row;
    const double minor[3] = {b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]};
    const double whole = a[0] * minor[0] + a[1] * minor[1] + a[2] * minor[2];
    const double across[3] = {a[2] * c[1] - a[1] * c[2], a[0] * c[2] - a[2] * c[0], a[1] * c[0] - a[0] * c[1]};
    const double over[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    for (int k = 0; k < 3; k++) change[k] = whole > 0 ? -(minor[k] * v[0] + across[k] * v[1] + over[k] * v[2]) / whole : 0;
}

/* Every point in turn; returns the sum of the squares of the changes. */
static double sweep(size_t row, const double *matrix, const double *friction, double *motion, double *force)
{
    double sum = 0;
    for (size_t i = 0; i < row; i += 3) {
        double change[3], *f = force + i;
        if (friction[i / 3] < 0) hold(matrix + i * row + i, row, motion + i, change);
        else if (f[0] == 0 && f[1] == 0 && f[2] == 0 && motion[i] >= 0) continue; /* open */
        else slide(matrix + i * row + i, row, friction[i / 3], motion + i, f, change);
        const double square = change[0] * change[0] + change[1] * change[1] + change[2] * change[2];
        if (square == 0) continue;
        sum += square;
        for (int k = 0; k < 3; k++) f[k] += change[k];
        const double *a = matrix + i * row, *b = a + row, *c = b + row;
        for (size_t j = 0; j < row; j++) motion[j] += a[j] * change[0] + b[j] * change[1] + c[j] * change[2];
    }
    return sum;
}

/* What sweeps have shown: differences of two in a row. */
typedef struct shown {
    double *moved, *force, *motion; /* (HISTORY x rows) of the change by a sweep; of forces and motions after it */
    double gram[HISTORY][HISTORY];
    int32_t count, next;
} shown;

static void remember(shown *history, size_t row, const double *change, const double *change_before, const double *force, const double *force_before,
                     const double *motion, const double *motion_before)
{
    const size_t at = row * (size_t)history->next;
    for (size_t i = 0; i < row; i++) {
        history->moved[at + i] = change[i] - change_before[i];
        history->force[at + i] = force[i] - force_before[i];
        history->motion[at + i] = motion[i] - motion_before[i];
    }
    if (history->count < HISTORY) history->count++;
    for (int32_t h = 0; h < history->count; h++)
        history->gram[history->next][h] = history->gram[h][history->next] = pliant_dot(row, history->moved + at, history->moved + row * (size_t)h);
    history->next = (history->next + 1) % HISTORY;
}

/* Anderson's method (anderson.h) on the sweeps; motions follow forces linearly, and are mixed as they are. */
static void mix(const shown *history, size_t row, const double *change, double *force, double *motion)
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

int32_t pliant_cones_solve(int32_t count, const double *matrix, const double *friction, double *motion, double *force, double *room)
{
    const double enough = 1e-7; /* change by a sweep over the largest */
    const size_t row = 3 * (size_t)count;
    double *begun = room, *change = room + row, *before[3] = {change + row, change + 2 * row, change + 3 * row};
    shown history = {.moved = before[2] + row, .force = before[2] + (HISTORY + 1) * row, .motion = before[2] + (2 * HISTORY + 1) * row};
    double largest = 0, last = INFINITY;
    for (int32_t made = 1;; made++) {
        memcpy(begun, force, row * sizeof *force);
        const double square = sweep(row, matrix, friction, motion, force);
        largest = fmax(largest, square);
        if (square <= enough * enough * largest || made == MOST_SWEEPS) return made; /* after a sweep all forces are in their cones */
        for (size_t i = 0; i < row; i++) change[i] = force[i] - begun[i];
        if (square > 4 * last) history.count = history.next = 0;
        else if (made > 1) remember(&history, row, change, before[0], force, before[1], motion, before[2]);
        last = square;
        memcpy(before[0], change, row * sizeof *change);
        memcpy(before[1], force, row * sizeof *force);
        memcpy(before[2], motion, row * sizeof *motion);
        if (history.count > 0) mix(&history, row, change, force, motion);
    }
}
