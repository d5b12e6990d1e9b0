/* Contact forces in cones (cones.h): code that the CPU and a CUDA block share.
 *
 * Forces solve the problem if f = P(f - s v). P is the projection onto the point's cone, and s is a multiple of the
 * point's stiffness. Newton's method reduces the residual of this equation (Alart and Curnier, Comput. Methods
 * Appl. Mech. Engrg. 92:353, 1991). If no Newton step reduces it, sweeps of projected Gauss-Seidel do. All threads
 * of a problem make the same decisions. */
#ifndef PLIANT_FEM_QUASISTATIC_CONE_RULES_H
#define PLIANT_FEM_QUASISTATIC_CONE_RULES_H

#include "base/inverse_root.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    PLIANT_CONE_MAX_ROWS = 192 /* maximum number of rows of points in contact */,
    PLIANT_CONE_EQUATIONS = PLIANT_CONE_MAX_ROWS * (PLIANT_CONE_MAX_ROWS + 1)
};
#define PLIANT_CONE_FIXED (-1.0) /* instead of mu: any force, v = 0 */

/* Regularization: this fraction is added to a point's own block of A for changes of the forces. Points of one
 * triangle are almost linearly dependent, so their individual forces are not determined. Without the term, such
 * problems converge only to 4e-6 of the forces. The term acts on changes only, so it does not alter a converged
 * solution (proximal point method: Rockafellar, SIAM J. Control Optim. 14:877, 1976). */
#define PLIANT_CONE_REGULARIZATION 1e-6

/* Threads that solve one problem together; each takes its part of every loop. */
typedef struct pliant_team { int rank, size; double *sums; } pliant_team; /* sums: (warps) buffer of the GPU */

/* Wait for all threads. */
PLIANT_INLINE void pliant_team_wait(void)
{
#ifdef __CUDACC__
    __syncthreads();
#endif
}

/* Return the sum over all threads, to each of them. All threads have waited then. */
PLIANT_INLINE double pliant_team_sum(const pliant_team *team, double own)
{
#ifdef __CUDACC__
    for (int half = 16; half > 0; half /= 2) own += __shfl_xor_sync(0xffffffff, own, half);
    if (team->rank % 32 == 0) team->sums[team->rank / 32] = own;
    __syncthreads();
    own = 0;
    for (int w = 0; w < team->size / 32; w++) own += team->sums[w];
    __syncthreads();
#else
    (void)team;
#endif
    return own;
}

enum { PLIANT_CONE_OPEN, PLIANT_CONE_STICKS /* or is held */, PLIANT_CONE_SLIDES };

/* State of a point in a Newton step. A sliding point moves along z = f_t - soft v_t, and the cone keeps a fraction
 * of z. */
typedef struct pliant_cone_point {
    int32_t kind, unused;
    double soft[2]; /* along the normal and along both tangents: force per motion of the single point [N/m] */
    double along[2], cone_fraction;
    double size;               /* magnitude of the block of equations, to detect a singular one */
} pliant_cone_point;

typedef struct pliant_cones {
    int32_t count;
    const double *matrix;      /* A, (3 count x 3 count) */
    const double *friction;    /* (count) mu, or PLIANT_CONE_FIXED */
    double *motion, *force;    /* (3 count) */
    /* BUFFERS */
    pliant_cone_point *point;  /* (count) */
    int32_t *list, *changing;  /* (count) points that are not open; points whose force a step changes */
    double *change, *moved;    /* (3 count) changes of the forces in a step, and the motions that they cause */
    double *equations;         /* up to fast_rows: (fast_rows x (fast_rows + 1)) */
    double *large_equations;   /* more: PLIANT_CONE_EQUATIONS; not read if fast_rows is PLIANT_CONE_MAX_ROWS */
    int32_t fast_rows;
} pliant_cones;

/* s divided by the point's stiffness. A value of 10 finds a reducing step far more often than 1, which sweeps use
 * (src/contact/NUMERICS.md). */
#define PLIANT_CONE_STEP_FACTOR 10.0
/* Relative change of the forces at which sweeps and useless steps end; limit of their number. */
#define PLIANT_CONE_TOLERANCE 1e-7
enum { PLIANT_CONE_SWEEPS = 200 };
#define PLIANT_CONE_EXACT 1e-9       /* relative residual at which the solution is found */
#define PLIANT_CONE_FAR 1e-3         /* relative residual above which sweeps come before Newton's method */
#define PLIANT_CONE_MIN_STEP 0.01    /* shortest fraction of a Newton step */
#define PLIANT_CONE_MIN_DECREASE 0.9 /* of the squared residual, in a step */
#define PLIANT_CONE_WEAK_DAMPING 1e-3 /* Levenberg's, in successive trials of a step */
#define PLIANT_CONE_STRONG_DAMPING 3e-2

/* Compute each point's own stiffness along the normal and the tangents. */
PLIANT_INLINE void pliant_cones_begin(const pliant_team *team, const pliant_cones *on)
{
    const size_t row = 3 * (size_t)on->count;
    for (int32_t p = team->rank; p < on->count; p += team->size) {
        const double *n = on->matrix + 3 * (size_t)p * (row + 1), *t = n + row, *s = t + row;
        const double mean = 0.5 * (t[1] + s[2]), half_difference = 0.5 * (t[1] - s[2]),
                     stiff = mean + sqrt(half_difference * half_difference + t[2] * t[2]);
        on->point[p].soft[0] = n[0] > 0 ? 1 / n[0] : 0;
        on->point[p].soft[1] = stiff > 0 ? 1 / stiff : 0;
    }
    pliant_team_wait();
}

/* Compute f - times v of a point before the projection. Return the normal part. z: tangential part */
PLIANT_INLINE double pliant_cone_unprojected(const pliant_cone_point *point, double times, const double v[3],
                                             const double f[3], double z[2])
{
    for (int k = 0; k < 2; k++) z[k] = f[1 + k] - times * point->soft[1] * v[1 + k];
    return f[0] - times * point->soft[0] * v[0];
}

/* Return the factor that shortens a vector to a maximum length. */
PLIANT_INLINE double pliant_cone_part(const double z[2], double maximum)
{
    const double square = z[0] * z[0] + z[1] * z[1];
    return square > maximum * maximum ? maximum * pliant_inverse_root(square) : 1.0;
}

/* Compute the change of f by the projection: P(f - times v) - f. */
PLIANT_INLINE void pliant_cone_projection_change(const pliant_cone_point *point, double friction, double times,
                                                 const double v[3], const double f[3], double out[3])
{
    double z[2];
    const double normal = fmax(pliant_cone_unprojected(point, times, v, f, z), 0.0),
                 part = pliant_cone_part(z, friction * normal);
    out[0] = normal - f[0];
    for (int k = 0; k < 2; k++) out[1 + k] = part * z[k] - f[1 + k];
}

/* Return the squared residual after this fraction of the step. */
PLIANT_INLINE double pliant_cones_residual(const pliant_team *team, const pliant_cones *on, double length)
{
    double sum = 0;
    for (int32_t p = team->rank; p < on->count; p += team->size) {
        double v[3], f[3], out[3];
        for (int k = 0; k < 3; k++) {
            const size_t i = 3 * (size_t)p + (size_t)k;
            v[k] = on->motion[i];
            f[k] = on->force[i];
            if (length == 0) continue;
            v[k] += length * on->moved[i];
            f[k] += length * on->change[i];
        }
        if (on->friction[p] < 0)
            for (int k = 0; k < 3; k++) out[k] = v[k] * on->point[p].soft[k > 0];
        else
            pliant_cone_projection_change(on->point + p, on->friction[p], PLIANT_CONE_STEP_FACTOR, v, f, out);
        sum += out[0] * out[0] + out[1] * out[1] + out[2] * out[2];
    }
    return pliant_team_sum(team, sum);
}

/* ---- lists of points */

/* Return whether a step changes the force of a point. */
PLIANT_INLINE bool pliant_cone_changes(const pliant_cones *on, int32_t p)
{
    const double *by = on->change + 3 * (size_t)p;
    return by[0] != 0 || by[1] != 0 || by[2] != 0;
}

/* Return whether the last classification found a point in contact. */
PLIANT_INLINE bool pliant_cone_presses(const pliant_cones *on, int32_t p)
{
    return on->point[p].kind != PLIANT_CONE_OPEN;
}

/* List the points that have a property, ascending. Return their number. */
PLIANT_INLINE int32_t pliant_cones_list(const pliant_team *team, const pliant_cones *on,
                                        bool (*has)(const pliant_cones *, int32_t), int32_t *list)
{
    int32_t count = 0;
#ifdef __CUDACC__
    /* each warp counts, and the first one writes the list */
    for (int32_t first = 0; first < on->count; first += 32) {
        const int32_t lane = team->rank % 32, p = first + lane;
        const bool is_listed = p < on->count && has(on, p);
        const unsigned listed = __ballot_sync(0xffffffff, is_listed);
        if (is_listed && team->rank < 32) list[count + __popc(listed & ((1u << lane) - 1))] = p;
        count += __popc(listed);
    }
#else
    (void)team;
    for (int32_t p = 0; p < on->count; p++)
        if (has(on, p)) list[count++] = p;
#endif
    pliant_team_wait();
    return count;
}

/* Compute moved = A change. */
PLIANT_INLINE void pliant_cones_find_motion(const pliant_team *team, const pliant_cones *on)
{
    const size_t row = 3 * (size_t)on->count;
    const int32_t count = pliant_cones_list(team, on, pliant_cone_changes, on->changing);
#ifdef __CUDACC__
    for (size_t i = (size_t)team->rank; i < row; i += (size_t)team->size) {
        double sum = 0;
#pragma unroll 4
        for (int32_t n = 0; n < count; n++) {
            /* A is symmetric */
            const size_t p = 3 * (size_t)on->changing[n];
            const double *by = on->change + p, *a = on->matrix + p * row + i;
            sum += a[0] * by[0] + a[row] * by[1] + a[2 * row] * by[2];
        }
        on->moved[i] = sum;
    }
#else
    for (size_t i = 0; i < row; i++) on->moved[i] = 0;
    for (int32_t n = 0; n < count; n++) {
        const size_t p = 3 * (size_t)on->changing[n];
        const double *by = on->change + p, *a = on->matrix + p * row, *b = a + row, *c = b + row;
        /* loops over rows vectorize */
        for (size_t i = 0; i < row; i++) on->moved[i] += a[i] * by[0] + b[i] * by[1] + c[i] * by[2];
    }
#endif
    pliant_team_wait();
}

/* ---- a step of Newton's method */

/* Classify a point as open, sticking or sliding. */
PLIANT_INLINE void pliant_cone_classify(const pliant_cones *on, int32_t p)
{
    pliant_cone_point *point = on->point + p;
    const double *v = on->motion + 3 * (size_t)p, *f = on->force + 3 * (size_t)p, friction = on->friction[p];
    double z[2];
    point->kind = PLIANT_CONE_STICKS;
    if (friction < 0) return;
    const double normal = pliant_cone_unprojected(point, PLIANT_CONE_STEP_FACTOR, v, f, z),
                 length = sqrt(z[0] * z[0] + z[1] * z[1]);
    if (!(normal > 0)) point->kind = PLIANT_CONE_OPEN;
    if (!(normal > 0) || !(length > friction * normal)) return;
    point->kind = PLIANT_CONE_SLIDES;
    for (int k = 0; k < 2; k++) point->along[k] = z[k] / length;
    point->cone_fraction = friction * normal / length;
}

/* Classify all points. Open points lose their force. List all others and return their number. */
PLIANT_INLINE int32_t pliant_cones_classify(const pliant_team *team, const pliant_cones *on)
{
    for (int32_t p = team->rank; p < on->count; p += team->size) {
        pliant_cone_classify(on, p);
        for (size_t i = 3 * (size_t)p; i < 3 * (size_t)p + 3; i++)
            on->change[i] = pliant_cone_presses(on, p) ? 0 : -on->force[i];
    }
    pliant_team_wait();
    return pliant_cones_list(team, on, pliant_cone_presses, on->list);
}

/* Turn the last two rows of a block of A into the equations of sliding,  f_t + df_t = mu (f_n + df_n) along +
 * cone_fraction Q (z + dz).  Q projects across `along`.
 * @param own the block is on the diagonal */
PLIANT_INLINE void pliant_cone_slide_rows(const pliant_cone_point *of, double friction, bool own, double block[9])
{
    const double *s = of->along, part = of->cone_fraction * PLIANT_CONE_STEP_FACTOR * of->soft[1];
    const double across[2][2] = {{1 - s[0] * s[0], -s[0] * s[1]}, {-s[0] * s[1], 1 - s[1] * s[1]}};
    for (int c = 0; c < 3; c++) {
        const double a[2] = {block[3 + c], block[6 + c]};
        for (int k = 0; k < 2; k++) block[3 + 3 * k + c] = part * (across[k][0] * a[0] + across[k][1] * a[1]);
    }
    for (int k = 0; k < 2 && own; k++) {
        block[3 + 3 * k] -= friction * s[k];
        for (int l = 0; l < 2; l++) block[4 + 3 * k + l] += (k == l) - of->cone_fraction * across[k][l];
    }
}

/* Compute the right side of a point's rows, including the motion by the changes of open points. */
PLIANT_INLINE void pliant_cone_right_side(const pliant_cones *on, int32_t p, double right[3])
{
    const pliant_cone_point *of = on->point + p;
    const double *v = on->motion + 3 * (size_t)p, *f = on->force + 3 * (size_t)p, *moved = on->moved + 3 * (size_t)p,
                 *s = of->along;
    const double part = of->cone_fraction * PLIANT_CONE_STEP_FACTOR * of->soft[1];
    for (int k = 0; k < 3; k++) right[k] = -v[k] - moved[k];
    if (of->kind != PLIANT_CONE_SLIDES) return;
    const double across[2][2] = {{1 - s[0] * s[0], -s[0] * s[1]}, {-s[0] * s[1], 1 - s[1] * s[1]}};
    for (int k = 0; k < 2; k++)
        right[1 + k] =
            on->friction[p] * f[0] * s[k] - f[1 + k] - part * (across[k][0] * moved[1] + across[k][1] * moved[2]);
}

/* Set up the equations, (3 points x (3 points + 1)). damping: fraction that is added to A's diagonal */
PLIANT_INLINE void pliant_cones_set_equations(const pliant_team *team, const pliant_cones *on, int32_t points,
                                              double damping)
{
    const size_t row = 3 * (size_t)on->count, width = 3 * (size_t)points + 1;
    for (int32_t e = team->rank; e < points * points; e += team->size) {
        const int32_t i = e / points, j = e % points, p = on->list[i], q = on->list[j];
        pliant_cone_point *point = on->point + p;
        double block[9], *out = on->equations + 3 * (size_t)i * width + 3 * (size_t)j;
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                block[3 * r + c] = on->matrix[(3 * (size_t)p + (size_t)r) * row + 3 * (size_t)q + (size_t)c];
        for (int r = 0; r < 3 && i == j; r++) block[4 * r] *= 1 + damping;
        if (point->kind == PLIANT_CONE_SLIDES) pliant_cone_slide_rows(point, on->friction[p], i == j, block);
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) out[(size_t)r * width + (size_t)c] = block[3 * r + c];
        if (i != j) continue;
        double right[3];
        point->size = 1;
        for (int r = 0; r < 3; r++)
            point->size *= fmax(fmax(fabs(block[3 * r]), fabs(block[3 * r + 1])), fabs(block[3 * r + 2]));
        pliant_cone_right_side(on, p, right);
        for (int r = 0; r < 3; r++) on->equations[(3 * (size_t)i + (size_t)r) * width + width - 1] = right[r];
    }
    pliant_team_wait();
}

/* Invert a 3 x 3 block by Cramer's rule. The result is 0 if the block depends on previous points; then the point's
 * force stays. */
PLIANT_INLINE void pliant_cone_invert(const double *m, size_t width, double size, double out[9])
{
    const double minimum = 1e-13, *a = m, *b = a + width, *c = b + width;
    out[0] = b[1] * c[2] - b[2] * c[1];
    out[1] = a[2] * c[1] - a[1] * c[2];
    out[2] = a[1] * b[2] - a[2] * b[1];
    out[3] = b[2] * c[0] - b[0] * c[2];
    out[4] = a[0] * c[2] - a[2] * c[0];
    out[5] = a[2] * b[0] - a[0] * b[2];
    out[6] = b[0] * c[1] - b[1] * c[0];
    out[7] = a[1] * c[0] - a[0] * c[1];
    out[8] = a[0] * b[1] - a[1] * b[0];
    const double whole = a[0] * out[0] + a[1] * out[3] + a[2] * out[6],
                 by = fabs(whole) > minimum * size ? 1 / whole : 0.0;
    for (int i = 0; i < 9; i++) out[i] *= by;
}

/* Divide a pivot's rows by its block, from the next column on. */
PLIANT_INLINE void pliant_cone_scale_pivot(const pliant_team *team, double size, int32_t column, int32_t width,
                                           double *pivot)
{
    const int32_t first = column + 3 + team->rank;
    double inverse[9], *second = pivot + width, *third = second + width;
    if (first < width) pliant_cone_invert(pivot + column, (size_t)width, size, inverse);
    for (int32_t k = first; k < width; k += team->size) {
        const double a = pivot[k], b = second[k], c = third[k];
        pivot[k] = inverse[0] * a + inverse[1] * b + inverse[2] * c;
        second[k] = inverse[3] * a + inverse[4] * b + inverse[5] * c;
        third[k] = inverse[6] * a + inverse[7] * b + inverse[8] * c;
    }
    pliant_team_wait();
}

/* Eliminate a pivot from the three rows of another point. pivot, to: rows; column: of the pivot; first, step: this
 * thread's columns */
PLIANT_INLINE void pliant_cone_eliminate_rows(const double *pivot, int32_t column, int32_t width, int32_t first,
                                              int32_t step, double *to)
{
    const double *second = pivot + width, *third = second + width;
    double by[9], *next = to + width, *last = next + width;
    for (int c = 0; c < 3; c++) {
        by[c] = to[column + c];
        by[3 + c] = next[column + c];
        by[6 + c] = last[column + c];
    }
    for (int32_t k = first; k < width; k += step) {
        const double a = pivot[k], b = second[k], c = third[k], x = to[k], y = next[k], z = last[k];
        to[k] = x - (by[0] * a + by[1] * b + by[2] * c);
        next[k] = y - (by[3] * a + by[4] * b + by[5] * c);
        last[k] = z - (by[6] * a + by[7] * b + by[8] * c);
    }
}

/* Solve by Gauss-Jordan elimination with blocks of three. The last column becomes the changes. */
PLIANT_INLINE void pliant_cones_eliminate(const pliant_team *team, const pliant_cones *on, int32_t points)
{
    const int32_t rows = 3 * points, width = rows + 1;
    double *const all = on->equations;
#ifdef __CUDACC__
    /* one warp for each point */
    const int32_t first = team->rank / 32, step = team->size / 32, lane = team->rank % 32, lanes = 32;
#else
    const int32_t first = 0, step = 1, lane = 0, lanes = 1;
#endif
    for (int32_t p = 0; p < points; p++) {
        double *const pivot = all + 3 * (size_t)p * (size_t)width;
        pliant_cone_scale_pivot(team, on->point[on->list[p]].size, 3 * p, width, pivot);
        for (int32_t i = first; i < points; i += step)
            if (i != p)
                pliant_cone_eliminate_rows(pivot, 3 * p, width, 3 * p + 3 + lane, lanes,
                                           all + 3 * (size_t)i * (size_t)width);
        pliant_team_wait();
    }
    for (int32_t r = team->rank; r < rows; r += team->size)
        on->change[3 * on->list[r / 3] + r % 3] = all[(size_t)(r + 1) * (size_t)width - 1];
    pliant_team_wait();
}

/* Solve the linearized equations of all points that are not open, and compute change and moved. Return false if
 * there are too many points. */
PLIANT_INLINE bool pliant_cones_newton(const pliant_team *team, const pliant_cones *on, double damping)
{
    const int32_t points = pliant_cones_classify(team, on);
    if (3 * points > PLIANT_CONE_MAX_ROWS) return false;
    pliant_cones with = *on;
    if (3 * points > on->fast_rows) with.equations = on->large_equations;
    pliant_cones_find_motion(team, on); /* of the points that open */
    pliant_cones_set_equations(team, &with, points, damping);
    pliant_cones_eliminate(team, &with, points);
    pliant_cones_find_motion(team, on);
    return true;
}

/* Take a step: add `length` times change and moved to forces and motions. */
PLIANT_INLINE void pliant_cones_apply_step(const pliant_team *team, const pliant_cones *on, double length)
{
    for (size_t i = (size_t)team->rank; i < 3 * (size_t)on->count; i += (size_t)team->size) {
        on->force[i] += length * on->change[i];
        on->motion[i] += length * on->moved[i];
    }
    pliant_team_wait();
}

/* Line search: take the first step length that reduces the squared residual to half, or else the best one. Return
 * false, and take no step, if there is no sufficient reduction. left: squared residual, in and out */
PLIANT_INLINE bool pliant_cones_line_search(const pliant_team *team, const pliant_cones *on, double *left)
{
    double best = INFINITY, of = 0;
    for (double length = 1; length > PLIANT_CONE_MIN_STEP && !(best < 0.5 * *left); length *= 0.5) {
        const double square = pliant_cones_residual(team, on, length);
        if (!(square < best)) continue;
        best = square;
        of = length;
    }
    if (!(best < PLIANT_CONE_MIN_DECREASE * *left)) return false;
    pliant_cones_apply_step(team, on, of);
    *left = best;
    return true;
}

/* ---- sweeps */

/* Compute the change of a point's force in a sweep. */
PLIANT_INLINE void pliant_cone_sweep_point(const pliant_cones *on, int32_t p, double change[3])
{
    const size_t row = 3 * (size_t)on->count;
    const pliant_cone_point *point = on->point + p;
    const double *n = on->matrix + 3 * (size_t)p * (row + 1), *v = on->motion + 3 * (size_t)p,
                 *f = on->force + 3 * (size_t)p;
    const double normal = fmax(f[0] - v[0] * point->soft[0], 0.0), maximum = on->friction[p] * normal;
    double along[2];
    change[0] = normal - f[0];
    for (int k = 0; k < 2; k++) along[k] = f[1 + k] - (v[1 + k] + n[1 + k] * change[0]) * point->soft[1];
    const double part = pliant_cone_part(along, maximum);
    for (int k = 0; k < 2; k++) change[1 + k] = part * along[k] - f[1 + k];
}

/* Compute the change of a held point's force, for v = 0. */
PLIANT_INLINE void pliant_cone_sweep_fixed_point(const pliant_cones *on, int32_t p, double change[3])
{
    const size_t row = 3 * (size_t)on->count;
    const double *v = on->motion + 3 * (size_t)p;
    double inverse[9];
    pliant_cone_invert(on->matrix + 3 * (size_t)p * (row + 1), row, 0.0, inverse);
    for (int k = 0; k < 3; k++)
        change[k] = -(inverse[3 * k] * v[0] + inverse[3 * k + 1] * v[1] + inverse[3 * k + 2] * v[2]);
}

/* Return whether a sweep changes nothing at a point. */
PLIANT_INLINE bool pliant_cone_is_open(const pliant_cones *on, int32_t p)
{
    const double *f = on->force + 3 * (size_t)p;
    return on->friction[p] >= 0 && f[0] == 0 && f[1] == 0 && f[2] == 0 && on->motion[3 * (size_t)p] >= 0;
}

/* Return the first point from p on that is not open, or the number of points. */
PLIANT_INLINE int32_t pliant_cones_next(const pliant_team *team, const pliant_cones *on, int32_t p)
{
#ifdef __CUDACC__
    for (; p < on->count; p += 32) {
        const int32_t own = p + team->rank % 32;
        const unsigned points = __ballot_sync(0xffffffff, own < on->count && !pliant_cone_is_open(on, own));
        if (points != 0) return p + __ffs((int)points) - 1;
    }
    return on->count;
#else
    (void)team;
    while (p < on->count && pliant_cone_is_open(on, p)) p++;
    return p;
#endif
}

/* Sweep over all points. Return the sum of the squared changes. */
PLIANT_INLINE double pliant_cones_sweep(const pliant_team *team, const pliant_cones *on)
{
    const size_t row = 3 * (size_t)on->count;
    double sum = 0;
    for (int32_t p = 0; (p = pliant_cones_next(team, on, p)) < on->count; p++) {
        double change[3], *f = on->force + 3 * (size_t)p;
        const double *a = on->matrix + 3 * (size_t)p * row, *b = a + row, *c = b + row;
        if (on->friction[p] < 0) pliant_cone_sweep_fixed_point(on, p, change);
        else pliant_cone_sweep_point(on, p, change);
        const double square = change[0] * change[0] + change[1] * change[1] + change[2] * change[2];
        if (square == 0) continue;
        sum += square;
        pliant_team_wait();
        for (int k = team->rank; k < 3; k += team->size) f[k] += change[k];
        for (size_t j = (size_t)team->rank; j < row; j += (size_t)team->size)
            on->motion[j] += a[j] * change[0] + b[j] * change[1] + c[j] * change[2];
        pliant_team_wait();
    }
    return sum;
}

/* ---- solver */

/* Project all forces onto their cones. At convergence this changes them only slightly. */
PLIANT_INLINE void pliant_cones_project(const pliant_team *team, const pliant_cones *on)
{
    for (int32_t p = team->rank; p < on->count; p += team->size) {
        const size_t i = 3 * (size_t)p;
        for (int k = 0; k < 3; k++) on->change[i + (size_t)k] = 0;
        if (on->friction[p] >= 0)
            pliant_cone_projection_change(on->point + p, on->friction[p], 1.0, on->motion + i, on->force + i,
                                          on->change + i);
    }
    pliant_team_wait();
    pliant_cones_find_motion(team, on);
    pliant_cones_apply_step(team, on, 1.0);
}

/* Make a Newton step. If it does not reduce the residual, repeat it with more and more damping (Levenberg, Quart.
 * Appl. Math. 2:164, 1944), because points of one triangle are almost linearly dependent. Return false if there are
 * too many points.
 * @param left squared residual, in and out; @param steps number of steps, in and out; @param leads out: the
 *   residual was reduced */
PLIANT_INLINE bool pliant_cones_step(const pliant_team *team, const pliant_cones *on, double *left, int32_t *steps,
                                     bool *leads)
{
    const double damping[] = {0, PLIANT_CONE_WEAK_DAMPING, PLIANT_CONE_STRONG_DAMPING};
    *leads = false;
    for (int d = 0; d < 3 && !*leads; d++) {
        if (!pliant_cones_newton(team, on, damping[d])) return false;
        ++*steps;
        *leads = pliant_cones_line_search(team, on, left);
    }
    return true;
}

/* Return f'f. */
PLIANT_INLINE double pliant_cones_squared_force(const pliant_team *team, const pliant_cones *on)
{
    double own = 0;
    for (size_t i = (size_t)team->rank; i < 3 * (size_t)on->count; i += (size_t)team->size)
        own += on->force[i] * on->force[i];
    return pliant_team_sum(team, own);
}

/* Solve from given forces and motions. Far from the solution, sweeps come first, because a full Newton step often
 * selects wrong open points there. Return the number of steps and sweeps. A negative result means too many points
 * for Newton's method: minus the number of sweeps, minus 1. */
PLIANT_INLINE int32_t pliant_cones_run(const pliant_team *team, const pliant_cones *on)
{
    const int32_t max_steps = 60, max_sweeps = PLIANT_CONE_SWEEPS, max_at_once = 32, first_sweeps = 3;
    int32_t steps = 0, sweeps = 0, at_once = 1;
    pliant_cones_begin(team, on);
    double left = pliant_cones_residual(team, on, 0.0);
    if (left > PLIANT_CONE_FAR * PLIANT_CONE_FAR * pliant_cones_squared_force(team, on)) {
        for (; sweeps < first_sweeps; sweeps++) pliant_cones_sweep(team, on);
        left = pliant_cones_residual(team, on, 0.0);
    }
    while (steps < max_steps && sweeps < max_sweeps) {
        const double size = pliant_cones_squared_force(team, on);
        bool ends = left <= PLIANT_CONE_EXACT * PLIANT_CONE_EXACT * size;
        if (!ends) {
            bool leads;
            if (!pliant_cones_step(team, on, &left, &steps, &leads)) return -sweeps - 1;
            if (leads) continue;
            /* no step reduces it further */
            ends = left <= PLIANT_CONE_TOLERANCE * PLIANT_CONE_TOLERANCE * size;
        }
        if (ends) {
            pliant_cones_project(team, on);
            return steps + sweeps;
        }
        if (at_once < max_at_once) at_once *= 2;
        for (int32_t n = 0; n < at_once; n++, sweeps++) pliant_cones_sweep(team, on);
        left = pliant_cones_residual(team, on, 0.0);
    }
    pliant_cones_sweep(team, on); /* its result is in the cones */
    return steps + sweeps + 1;
}

#ifdef __cplusplus
}
#endif
#endif
