#include "fem/quasistatic/cones.h"

#include "fem/linear/dense.h"

#include <math.h>
#include <stdbool.h>
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

/* ---- all points at once */

enum { MOST_ROWS = PLIANT_CONE_TOGETHER };

/* What a point does, for now: it is open, it sticks or is held, or it slides along z = f_t - soft v_t, of which the cone keeps a part. */
typedef struct doing { enum { OPEN, STICKS, SLIDES } kind; double along[2], keeps, soft; } doing;

static doing look(const double *matrix, size_t row, double friction, const double v[3], const double f[3])
{
    const double *n = matrix, *t = n + row, *s = t + row;
    doing out = {.kind = STICKS};
    if (friction < 0) return out;
    const double normal = f[0] - v[0] / n[0];
    if (!(normal > 0)) {
        out.kind = OPEN;
        return out;
    }
    const double mean = 0.5 * (t[1] + s[2]), apart = 0.5 * (t[1] - s[2]), stiff = mean + sqrt(apart * apart + t[2] * t[2]);
    const double z[2] = {f[1] - v[1] / stiff, f[2] - v[2] / stiff}, length = sqrt(z[0] * z[0] + z[1] * z[1]);
    if (!(length > friction * normal)) return out;
    out.kind = SLIDES;
    for (int k = 0; k < 2; k++) out.along[k] = z[k] / length;
    out.keeps = friction * normal / length;
    out.soft = 1 / stiff;
    return out;
}

/* Gauss with row exchanges, in place; false: singular. (rows x (rows + 1)) */
static bool eliminate(size_t rows, double *a)
{
    const size_t width = rows + 1;
    for (size_t p = 0; p < rows; p++) {
        size_t best = p;
        for (size_t r = p + 1; r < rows; r++)
            if (fabs(a[r * width + p]) > fabs(a[best * width + p])) best = r;
        if (!(fabs(a[best * width + p]) > 0)) return false;
        for (size_t c = p; c < width && best != p; c++) {
            const double swap = a[best * width + c];
            a[best * width + c] = a[p * width + c];
            a[p * width + c] = swap;
        }
        const double inverse = 1 / a[p * width + p];
        for (size_t r = p + 1; r < rows; r++) {
            const double by = a[r * width + p] * inverse;
            if (by == 0) continue;
            double *to = a + r * width;
            const double *from = a + p * width;
            for (size_t c = p + 1; c < width; c++) to[c] -= by * from[c];
        }
    }
    for (size_t p = rows; p-- > 0;) {
        double sum = a[p * width + rows];
        for (size_t c = p + 1; c < rows; c++) sum -= a[p * width + c] * a[c * width + rows];
        a[p * width + rows] = sum / a[p * width + p];
    }
    return true;
}

/* In place of a point's last two rows of A and what they are to bring:  f_t + df_t = mu (f_n + df_n) along + keeps P (z + dz),  P across along.
 *  @param place of its own columns */
static void set_sliding(const doing *of, double friction, const double v[3], const double f[3], size_t rows, size_t place, double *out, double right[3])
{
    const double *s = of->along, part = of->keeps * of->soft, across[2][2] = {{1 - s[0] * s[0], -s[0] * s[1]}, {-s[0] * s[1], 1 - s[1] * s[1]}};
    double *t = out + rows + 1, *u = t + rows + 1;
    const double moved[2] = {right[1] + v[1], right[2] + v[2]}; /* by open points alone; the motion of now is in z */
    for (size_t c = 0; c < rows; c++) {
        const double a[2] = {t[c], u[c]};
        t[c] = part * (across[0][0] * a[0] + across[0][1] * a[1]);
        u[c] = part * (across[1][0] * a[0] + across[1][1] * a[1]);
    }
    for (int k = 0; k < 2; k++) {
        double *own = (k ? u : t) + place;
        own[0] -= friction * s[k];
        for (int l = 0; l < 2; l++) own[1 + l] += (k == l) - of->keeps * across[k][l];
        right[1 + k] = friction * f[0] * s[k] - f[1 + k] + part * (across[k][0] * moved[0] + across[k][1] * moved[1]);
    }
}

/* The equations of all that are not open, linear around where they are (Alart and Curnier, Comput. Methods Appl. Mech. Engrg. 92:353, 1991). false: there
 * are too many, or no solution; nothing is changed. room: (MOST_ROWS x (MOST_ROWS + 1)) */
static bool step_together(size_t row, const double *matrix, const double *friction, double *motion, double *force, double *change, double *room)
{
    size_t index[MOST_ROWS / 3], points = 0;
    doing doings[MOST_ROWS / 3];
    for (size_t i = 0; i < row; i += 3) {
        const doing one = look(matrix + i * row + i, row, friction[i / 3], motion + i, force + i);
        for (int k = 0; k < 3; k++) change[i + k] = one.kind == OPEN ? -force[i + k] : 0;
        if (one.kind == OPEN) continue;
        if (3 * points == MOST_ROWS) return false;
        index[points] = i;
        doings[points++] = one;
    }
    const size_t rows = 3 * points, width = rows + 1;
    if (rows == 0) return false;
    for (size_t p = 0; p < points; p++) {
        const size_t i = index[p];
        double *out = room + 3 * p * width, right[3];
        for (int r = 0; r < 3; r++) {
            const double *a = matrix + (i + r) * row;
            right[r] = -motion[i + r];
            for (size_t j = 0; j < row; j++) right[r] -= a[j] * change[j];
            for (size_t q = 0; q < points; q++)
                for (int c = 0; c < 3; c++) out[r * width + 3 * q + c] = a[index[q] + c];
        }
        if (doings[p].kind == SLIDES) set_sliding(doings + p, friction[i / 3], motion + i, force + i, rows, 3 * p, out, right);
        for (int r = 0; r < 3; r++) out[r * width + rows] = right[r];
    }
    if (!eliminate(rows, room)) return false;
    for (size_t p = 0; p < points; p++)
        for (int r = 0; r < 3; r++) {
            change[index[p] + r] = room[(3 * p + r) * width + rows];
            if (!isfinite(change[index[p] + r])) return false;
        }
    for (size_t j = 0; j < row; j++) {
        if (change[j] == 0) continue;
        const double *a = matrix + j * row; /* symmetric */
        force[j] += change[j];
        for (size_t i = 0; i < row; i++) motion[i] += a[i] * change[j];
    }
    return true;
}

int32_t pliant_cones_solve(int32_t count, const double *matrix, const double *friction, double *motion, double *force, double *room)
{
    const double enough = 1e-7; /* change by a sweep over the largest */
    const size_t row = 3 * (size_t)count;
    double *begun = room, *change = room + row, *before[3] = {change + row, change + 2 * row, change + 3 * row};
    shown history = {.moved = before[2] + row, .force = before[2] + (HISTORY + 1) * row, .motion = before[2] + (2 * HISTORY + 1) * row};
    double *equations = history.motion + HISTORY * row, largest = 0, last = INFINITY;
    int32_t wait = 2, waits = 8, left = 16; /* sweeps until all points are tried at once, and after that has led astray; how often at most */
    bool together = false, mixes = false;
    for (int32_t made = 1;; made++) {
        memcpy(begun, force, row * sizeof *force);
        const double square = sweep(row, matrix, friction, motion, force);
        if (!together) largest = fmax(largest, square);
        const bool astray = together && !(square < last);
        if (!astray && square <= enough * enough * largest) return made; /* after a sweep all forces are in their cones */
        if (astray) {
            memcpy(force, before[1], row * sizeof *force);
            memcpy(motion, before[2], row * sizeof *motion);
            together = mixes = false;
            wait = waits;
            waits *= 2;
            last = INFINITY;
            history.count = history.next = 0;
        }
        if (made >= MOST_SWEEPS) return made;
        if (astray) continue;
        for (size_t i = 0; i < row; i++) begun[i] = force[i] - begun[i];
        if (--wait > 0 || left <= 0) {
            if (square > 4 * last) history.count = history.next = 0;
            else if (mixes) remember(&history, row, begun, before[0], force, before[1], motion, before[2]);
        }
        last = square;
        memcpy(before[0], begun, row * sizeof *begun);
        memcpy(before[1], force, row * sizeof *force);
        memcpy(before[2], motion, row * sizeof *motion);
        together = wait <= 0 && left-- > 0 && step_together(row, matrix, friction, motion, force, change, equations);
        if (wait <= 0 && !together) left = 0;
        mixes = !together;
        if (mixes && history.count > 0) mix(&history, row, begun, force, motion);
    }
}
