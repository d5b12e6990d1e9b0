/* Contact forces in cones (cones.h): code that the CPU and a CUDA block share.
 *
 * Forces solve the problem if f = P(f - s v). P is the projection onto the point's cone, and s is a multiple of the
 * point's stiffness. Newton's method reduces the residual of this equation (Alart and Curnier, Comput. Methods
 * Appl. Mech. Engrg. 92:353, 1991). If no Newton step reduces it, sweeps of projected Gauss-Seidel do. All threads
 * of a problem make the same decisions. */
#ifndef PLIANT_CONTACT_SOLVE_CONE_RULES_H
#define PLIANT_CONTACT_SOLVE_CONE_RULES_H

#include "contact/solve/cone_problem.h"

#ifdef __cplusplus
extern "C" {
#endif

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

/* Blocks of three equations: a point with friction, or the normals of three points without. */
typedef struct pliant_cone_blocks {
    int32_t rubbing, listed, count; /* points in the list with friction; all points in the list; blocks */
} pliant_cone_blocks;

/* Return the row of A of equation k of a block, or -1 if the equation is unused. */
PLIANT_INLINE int32_t pliant_cone_row(const pliant_cones *on, const pliant_cone_blocks *blocks, int32_t block,
                                      int32_t k)
{
    const int32_t first = blocks->rubbing;
    if (block < first) return 3 * on->list[block] + k;
    const int32_t n = first + 3 * (block - first) + k;
    return n < blocks->listed ? 3 * on->list[n] : -1;
}

/* Return the first point of a block. */
PLIANT_INLINE pliant_cone_point *pliant_cone_first(const pliant_cones *on, const pliant_cone_blocks *blocks,
                                                   int32_t block)
{
    return on->point + pliant_cone_row(on, blocks, block, 0) / 3;
}

/* Classify all points. Open points lose their force, and points without friction its tangential part. List all others,
 * first those with friction. */
PLIANT_INLINE pliant_cone_blocks pliant_cones_classify(const pliant_team *team, const pliant_cones *on)
{
    for (int32_t p = team->rank; p < on->count; p += team->size) {
        pliant_cone_classify(on, p);
        for (int k = 0; k < 3; k++) {
            const size_t i = 3 * (size_t)p + (size_t)k;
            const bool ends = !pliant_cone_presses(on, p) || (k > 0 && on->friction[p] == 0);
            on->change[i] = ends ? -on->force[i] : 0;
        }
    }
    pliant_team_wait();
    pliant_cone_blocks blocks;
    blocks.rubbing = pliant_cones_list(team, on, pliant_cone_rubs, on->list);
    const int32_t others = pliant_cones_list(team, on, pliant_cone_only_presses, on->list + blocks.rubbing);
    blocks.listed = blocks.rubbing + others;
    blocks.count = blocks.rubbing + (others + 2) / 3;
    return blocks;
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

/* Compute the right side of a block, including the motion by the changes of open points. */
PLIANT_INLINE void pliant_cone_right_side(const pliant_cones *on, const pliant_cone_blocks *blocks, int32_t block,
                                          double right[3])
{
    for (int k = 0; k < 3; k++) {
        const int32_t row = pliant_cone_row(on, blocks, block, k);
        right[k] = row < 0 ? 0.0 : -on->motion[row] - on->moved[row];
    }
    const int32_t p = pliant_cone_row(on, blocks, block, 0) / 3;
    const pliant_cone_point *of = on->point + p;
    if (on->friction[p] == 0 || of->kind != PLIANT_CONE_SLIDES) return;
    const double *f = on->force + 3 * (size_t)p, *moved = on->moved + 3 * (size_t)p, *s = of->along;
    const double part = of->cone_fraction * PLIANT_CONE_STEP_FACTOR * of->soft[1];
    const double across[2][2] = {{1 - s[0] * s[0], -s[0] * s[1]}, {-s[0] * s[1], 1 - s[1] * s[1]}};
    for (int k = 0; k < 2; k++)
        right[1 + k] =
            on->friction[p] * f[0] * s[k] - f[1 + k] - part * (across[k][0] * moved[1] + across[k][1] * moved[2]);
}

/* Copy a block of A, with resistance and damping on its diagonal. Unused equations have a 1 on the diagonal. */
PLIANT_INLINE void pliant_cone_get_block(const pliant_cones *on, const pliant_cone_blocks *blocks, int32_t i, int32_t j,
                                         double damping, double block[9])
{
    const size_t row = 3 * (size_t)on->count;
    for (int r = 0; r < 3; r++) {
        const int32_t a = pliant_cone_row(on, blocks, i, r);
        for (int c = 0; c < 3; c++) {
            const int32_t b = pliant_cone_row(on, blocks, j, c);
            block[3 * r + c] = a < 0 || b < 0 ? (a < 0 && i == j && r == c) : on->matrix[(size_t)a * row + (size_t)b];
        }
        if (i == j && a >= 0) block[4 * r] = block[4 * r] * (1 + damping) + pliant_cone_resistance(on, (size_t)a);
    }
}

/* Set up the equations, (3 blocks x (3 blocks + 1)). damping: fraction that is added to A's diagonal */
PLIANT_INLINE void pliant_cones_set_equations(const pliant_team *team, const pliant_cones *on,
                                              const pliant_cone_blocks *blocks, double damping)
{
    const int32_t count = blocks->count;
    const size_t width = 3 * (size_t)count + 1;
    for (int32_t e = team->rank; e < count * count; e += team->size) {
        const int32_t i = e / count, j = e % count;
        pliant_cone_point *point = pliant_cone_first(on, blocks, i);
        double block[9], *out = on->equations + 3 * (size_t)i * width + 3 * (size_t)j;
        pliant_cone_get_block(on, blocks, i, j, damping, block);
        if (i < blocks->rubbing && point->kind == PLIANT_CONE_SLIDES)
            pliant_cone_slide_rows(point, on->friction[on->list[i]], i == j, block);
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) out[(size_t)r * width + (size_t)c] = block[3 * r + c];
        if (i != j) continue;
        double right[3];
        point->size = 1;
        for (int r = 0; r < 3; r++)
            point->size *= fmax(fmax(fabs(block[3 * r]), fabs(block[3 * r + 1])), fabs(block[3 * r + 2]));
        pliant_cone_right_side(on, blocks, i, right);
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

/* Invert a block of three points' normals. Three points can depend on others or on each other, so the determinant can
 * be as small as the cube of the resistance. Gauss-Jordan elimination keeps its digits: no pivot is below the
 * resistance, because A has no negative eigenvalue. */
PLIANT_INLINE void pliant_cone_invert_normals(const double *m, size_t width, double out[9])
{
    PLIANT_UNROLL
    for (int i = 0; i < 9; i++) out[i] = m[(size_t)(i / 3) * width + (size_t)(i % 3)];
    PLIANT_UNROLL
    for (int p = 0; p < 3; p++) {
        const double by = out[4 * p] != 0 ? 1 / out[4 * p] : 0.0;
        PLIANT_UNROLL
        for (int c = 0; c < 3; c++) out[3 * p + c] = c == p ? by : by * out[3 * p + c];
        PLIANT_UNROLL
        for (int r = 0; r < 3; r++) {
            const double of = out[3 * r + p];
            PLIANT_UNROLL
            for (int c = 0; c < 3 && r != p; c++) out[3 * r + c] = (c == p ? 0 : out[3 * r + c]) - of * out[3 * p + c];
        }
    }
}

/* Divide a pivot's rows by its block, from the next column on. */
PLIANT_INLINE void pliant_cone_scale_pivot(const pliant_team *team, const pliant_cones *on,
                                           const pliant_cone_blocks *blocks, int32_t p, int32_t width, double *pivot)
{
    const int32_t column = 3 * p, first = column + 3 + team->rank;
    double inverse[9], *second = pivot + width, *third = second + width;
    if (first < width && p < blocks->rubbing)
        pliant_cone_invert(pivot + column, (size_t)width, pliant_cone_first(on, blocks, p)->size, inverse);
    else if (first < width)
        pliant_cone_invert_normals(pivot + column, (size_t)width, inverse);
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
    PLIANT_INDEPENDENT
    for (int32_t k = first; k < width; k += step) {
        const double a = pivot[k], b = second[k], c = third[k], x = to[k], y = next[k], z = last[k];
        to[k] = x - (by[0] * a + by[1] * b + by[2] * c);
        next[k] = y - (by[3] * a + by[4] * b + by[5] * c);
        last[k] = z - (by[6] * a + by[7] * b + by[8] * c);
    }
}

#ifdef __CUDACC__
/* Eliminate above and below the diagonal, with one warp for each block, because threads can share this work. */
PLIANT_INLINE void pliant_cones_reduce(const pliant_team *team, const pliant_cones *on,
                                       const pliant_cone_blocks *blocks)
{
    const int32_t count = blocks->count, width = 3 * count + 1;
    double *const all = on->equations;
    for (int32_t p = 0; p < count; p++) {
        double *const pivot = all + 3 * (size_t)p * (size_t)width;
        pliant_cone_scale_pivot(team, on, blocks, p, width, pivot);
        for (int32_t i = team->rank / 32; i < count; i += team->size / 32)
            if (i != p)
                pliant_cone_eliminate_rows(pivot, 3 * p, width, 3 * p + 3 + team->rank % 32, 32,
                                           all + 3 * (size_t)i * (size_t)width);
        pliant_team_wait();
    }
}
#else
/* Eliminate below the diagonal, and substitute back. A tile of rows stays in the cache while all pivots above pass. */
PLIANT_INLINE void pliant_cones_reduce(const pliant_team *team, const pliant_cones *on,
                                       const pliant_cone_blocks *blocks)
{
    const int32_t count = blocks->count, width = 3 * count + 1, tile = 4;
    double *const all = on->equations;
    for (int32_t first = 0; first < count; first += tile) {
        const int32_t end = first + tile < count ? first + tile : count;
        for (int32_t p = 0; p < end; p++) {
            double *const pivot = all + 3 * (size_t)p * (size_t)width;
            if (p >= first) pliant_cone_scale_pivot(team, on, blocks, p, width, pivot);
            for (int32_t i = p < first ? first : p + 1; i < end; i++)
                pliant_cone_eliminate_rows(pivot, 3 * p, width, 3 * p + 3, 1, all + 3 * (size_t)i * (size_t)width);
        }
    }
    for (int32_t r = 3 * count - 4; r >= 0; r--) {
        double *own = all + (size_t)r * (size_t)width, sum = 0;
        for (int32_t k = 3 * (r / 3) + 3; k < width - 1; k++) sum += own[k] * all[(size_t)(k + 1) * (size_t)width - 1];
        own[width - 1] -= sum;
    }
}
#endif

/* Solve by elimination with blocks of three. The last column becomes the changes. */
PLIANT_INLINE void pliant_cones_eliminate(const pliant_team *team, const pliant_cones *on,
                                          const pliant_cone_blocks *blocks)
{
    const int32_t rows = 3 * blocks->count, width = rows + 1;
    double *const all = on->equations;
    pliant_cones_reduce(team, on, blocks);
    for (int32_t r = team->rank; r < rows; r += team->size) {
        const int32_t row = pliant_cone_row(on, blocks, r / 3, r % 3);
        if (row >= 0) on->change[row] = all[(size_t)(r + 1) * (size_t)width - 1];
    }
    pliant_team_wait();
}

/* Solve the linearized equations of all points that are not open, and compute change and moved. Return the number of
 * rows; -1: there are too many points. */
PLIANT_INLINE int32_t pliant_cones_newton(const pliant_team *team, const pliant_cones *on, double damping)
{
    const pliant_cone_blocks blocks = pliant_cones_classify(team, on);
    if (3 * blocks.count > PLIANT_CONE_MAX_ROWS) return -1;
    pliant_cones with = *on;
    if (3 * blocks.count > on->fast_rows) with.equations = on->large_equations;
    pliant_cones_find_motion(team, on); /* of the points that open */
    pliant_cones_set_equations(team, &with, &blocks, damping);
    pliant_cones_eliminate(team, &with, &blocks);
    pliant_cones_find_motion(team, on);
    return 3 * blocks.count;
}

/* Return the number of steps that a step counts as. So the total work grows with the square of the rows, as in
 * sweeps. */
PLIANT_INLINE int32_t pliant_cone_step_count(int32_t rows)
{
    return rows > PLIANT_CONE_FEW_ROWS ? (rows + PLIANT_CONE_FEW_ROWS - 1) / PLIANT_CONE_FEW_ROWS : 1;
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
        for (size_t k = (size_t)team->rank; k < 3; k += (size_t)team->size)
            on->motion[3 * (size_t)p + k] += pliant_cone_resistance(on, 3 * (size_t)p + k) * change[k];
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
 * Appl. Math. 2:164, 1944), because points of one triangle are almost linearly dependent. Return the number of rows;
 * -1: there are too many points.
 * @param left squared residual, in and out; @param steps number of steps, in and out; @param leads out: the
 *   residual was reduced */
PLIANT_INLINE int32_t pliant_cones_step(const pliant_team *team, const pliant_cones *on, double *left, int32_t *steps,
                                     bool *leads)
{
    const double damping[] = {0, PLIANT_CONE_WEAK_DAMPING, PLIANT_CONE_STRONG_DAMPING};
    int32_t rows = 0;
    *leads = false;
    for (int d = 0; d < 3 && !*leads; d++) {
        if ((rows = pliant_cones_newton(team, on, damping[d])) < 0) return rows;
        *steps += pliant_cone_step_count(rows);
        *leads = pliant_cones_line_search(team, on, left);
    }
    return rows;
}

/* Return f'f. */
PLIANT_INLINE double pliant_cones_squared_force(const pliant_team *team, const pliant_cones *on)
{
    double own = 0;
    for (size_t i = (size_t)team->rank; i < 3 * (size_t)on->count; i += (size_t)team->size)
        own += on->force[i] * on->force[i];
    return pliant_team_sum(team, own);
}

typedef enum pliant_cone_result {
    PLIANT_CONES_SOLVED,
    PLIANT_CONES_UNSOLVED,
    PLIANT_CONES_TOO_MANY /* for Newton's method */
} pliant_cone_result;

/* Make a round with one resistance. Far from the solution, sweeps come first, because a full Newton step often selects
 * wrong open points there. made: number of steps and sweeps, in and out */
PLIANT_INLINE pliant_cone_result pliant_cones_make_round(const pliant_team *team, const pliant_cones *on, int32_t *made)
{
    const bool is_last = *on->resistance >= PLIANT_CONE_STRONG_RESISTANCE;
    const int32_t max_steps = is_last ? 60 : 30, max_sweeps = is_last ? PLIANT_CONE_SWEEPS : 64, max_at_once = 32,
                  first_sweeps = 3;
    int32_t steps = 0, sweeps = 0, at_once = 1, rows = 0;
    pliant_cone_result result = PLIANT_CONES_UNSOLVED;
    pliant_cones_begin(team, on);
    double left = pliant_cones_residual(team, on, 0.0);
    if (left > PLIANT_CONE_FAR * PLIANT_CONE_FAR * pliant_cones_squared_force(team, on)) {
        for (; sweeps < first_sweeps; sweeps++) pliant_cones_sweep(team, on);
        left = pliant_cones_residual(team, on, 0.0);
    }
    for (;;) {
        const double size = pliant_cones_squared_force(team, on);
        bool ends = left <= PLIANT_CONE_EXACT * PLIANT_CONE_EXACT * size;
        const bool is_last_step = steps >= max_steps || sweeps >= max_sweeps;
        if (!ends && is_last_step && rows > PLIANT_CONE_FEW_ROWS) result = PLIANT_CONES_TOO_MANY;
        if (!ends && is_last_step) break;
        if (!ends) {
            bool leads;
            rows = pliant_cones_step(team, on, &left, &steps, &leads);
            if (rows < 0) {
                result = PLIANT_CONES_TOO_MANY;
                break;
            }
            if (leads) continue;
            /* no step reduces it further */
            ends = left <= PLIANT_CONE_TOLERANCE * PLIANT_CONE_TOLERANCE * size;
        }
        if (ends) {
            pliant_cones_project(team, on);
            result = PLIANT_CONES_SOLVED;
            break;
        }
        if (at_once < max_at_once) at_once *= 2;
        for (int32_t n = 0; n < at_once; n++, sweeps++) pliant_cones_sweep(team, on);
        left = pliant_cones_residual(team, on, 0.0);
    }
    if (result == PLIANT_CONES_UNSOLVED) {
        pliant_cones_sweep(team, on); /* its result is in the cones */
        sweeps++;
    }
    *made += steps + sweeps;
    return result;
}

/* Store the forces at the start of a round. */
PLIANT_INLINE void pliant_cones_begin_round(const pliant_team *team, const pliant_cones *on)
{
    for (size_t i = (size_t)team->rank; i < 3 * (size_t)on->count; i += (size_t)team->size)
        if (on->friction[i / 3] >= 0) on->before[i] = on->force[i];
}

/* Remove the part of the motions that the resistance causes. */
PLIANT_INLINE void pliant_cones_end_round(const pliant_team *team, const pliant_cones *on)
{
    for (size_t i = (size_t)team->rank; i < 3 * (size_t)on->count; i += (size_t)team->size)
        if (on->friction[i / 3] >= 0)
            on->motion[i] -= pliant_cone_resistance(on, i) * (on->force[i] - on->before[i]);
    pliant_team_wait();
}

/* Solve from given forces and motions. Return the number of steps and sweeps. A negative result means too many points
 * for Newton's method: minus the number of sweeps, minus 1. */
PLIANT_INLINE int32_t pliant_cones_run(const pliant_team *team, const pliant_cones *on)
{
    int32_t made = 0;
    for (;;) {
        pliant_cones_begin_round(team, on);
        const pliant_cone_result result = pliant_cones_make_round(team, on, &made);
        pliant_cones_end_round(team, on);
        if (result == PLIANT_CONES_TOO_MANY) return -made - 1;
        if (result == PLIANT_CONES_SOLVED || *on->resistance >= PLIANT_CONE_STRONG_RESISTANCE) return made;
        pliant_team_wait();
        if (team->rank == 0) *on->resistance = PLIANT_CONE_STRONG_RESISTANCE;
        pliant_team_wait();
    }
}

#ifdef __cplusplus
}
#endif
#endif
