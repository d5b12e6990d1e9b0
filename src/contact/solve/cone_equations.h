/* The linear equations of a step of Newton's method (cone_rules.h), and their elimination. The CPU and CUDA blocks
 * share this code. */
#ifndef PLIANT_CONTACT_SOLVE_CONE_EQUATIONS_H
#define PLIANT_CONTACT_SOLVE_CONE_EQUATIONS_H

#include "contact/solve/cone_problem.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- equations */

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

/* Compute a block of the equations. damping: fraction that is added to A's diagonal */
PLIANT_INLINE void pliant_cone_equations(const pliant_cones *on, const pliant_cone_blocks *blocks, int32_t i, int32_t j,
                                         double damping, double block[9])
{
    const pliant_cone_point *point = pliant_cone_first(on, blocks, i);
    pliant_cone_get_block(on, blocks, i, j, damping, block);
    if (i < blocks->rubbing && point->kind == PLIANT_CONE_SLIDES)
        pliant_cone_slide_rows(point, on->friction[on->list[i]], i == j, block);
}

/* Compute the magnitude of the blocks on the diagonal. */
PLIANT_INLINE void pliant_cones_find_sizes(const pliant_team *team, const pliant_cones *on,
                                           const pliant_cone_blocks *blocks, double damping)
{
    for (int32_t i = team->rank; i < blocks->rubbing; i += team->size) {
        double block[9], size = 1;
        pliant_cone_equations(on, blocks, i, i, damping, block);
        for (int r = 0; r < 3; r++)
            size *= fmax(fmax(fabs(block[3 * r]), fabs(block[3 * r + 1])), fabs(block[3 * r + 2]));
        pliant_cone_first(on, blocks, i)->size = size;
    }
    pliant_team_wait(team);
}

/* Set up the equations, (3 blocks x (3 blocks + 1)). */
PLIANT_INLINE void pliant_cones_set_equations(const pliant_team *team, const pliant_cones *on,
                                              const pliant_cone_blocks *blocks, double damping)
{
    const int32_t count = blocks->count;
    const size_t width = 3 * (size_t)count + 1;
    for (int32_t e = team->rank; e < count * count; e += team->size) {
        const int32_t i = e / count, j = e % count;
        double block[9], right[3], *out = on->equations + 3 * (size_t)i * width;
        pliant_cone_equations(on, blocks, i, j, damping, block);
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) out[(size_t)r * width + 3 * (size_t)j + (size_t)c] = block[3 * r + c];
        if (i != j) continue;
        pliant_cone_right_side(on, blocks, i, right);
        for (int r = 0; r < 3; r++) out[(size_t)(r + 1) * width - 1] = right[r];
    }
    pliant_team_wait(team);
}

/* ---- elimination */

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

/* Invert a pivot block. m: its first row, at its first column */
PLIANT_INLINE void pliant_cone_invert_pivot(const pliant_cones *on, const pliant_cone_blocks *blocks, int32_t p,
                                            const double *m, size_t width, double out[9])
{
    if (p < blocks->rubbing)
        pliant_cone_invert(m, width, pliant_cone_first(on, blocks, p)->size, out);
    else
        pliant_cone_invert_normals(m, width, out);
}

/* Multiply three rows by a block, from a column on. */
PLIANT_INLINE void pliant_cone_scale_rows(const double by[9], int32_t first, int32_t width, double *rows)
{
    double *second = rows + width, *third = second + width;
    for (int32_t k = first; k < width; k++) {
        const double a = rows[k], b = second[k], c = third[k];
        rows[k] = by[0] * a + by[1] * b + by[2] * c;
        second[k] = by[3] * a + by[4] * b + by[5] * c;
        third[k] = by[6] * a + by[7] * b + by[8] * c;
    }
}

/* Subtract a block times a pivot's rows from the three rows of another point, from a column on. */
PLIANT_INLINE void pliant_cone_eliminate_rows(const double *pivot, const double by[9], int32_t first, int32_t width,
                                              double *to)
{
    const double *second = pivot + width, *third = second + width;
    double *next = to + width, *last = next + width;
    PLIANT_INDEPENDENT
    for (int32_t k = first; k < width; k++) {
        const double a = pivot[k], b = second[k], c = third[k], x = to[k], y = next[k], z = last[k];
        to[k] = x - (by[0] * a + by[1] * b + by[2] * c);
        next[k] = y - (by[3] * a + by[4] * b + by[5] * c);
        last[k] = z - (by[6] * a + by[7] * b + by[8] * c);
    }
}

/* Copy a block of three rows. */
PLIANT_INLINE void pliant_cone_copy_block(const double *m, size_t width, double out[9])
{
    for (int i = 0; i < 9; i++) out[i] = m[(size_t)(i / 3) * width + (size_t)(i % 3)];
}

#ifdef __CUDACC__
/* Replace a block by its product with an inverse. */
PLIANT_INLINE void pliant_cone_multiply(double *m, size_t width, const double inverse[9])
{
    double own[9];
    pliant_cone_copy_block(m, width, own);
    PLIANT_UNROLL
    for (int k = 0; k < 9; k++)
        m[(size_t)(k / 3) * width + (size_t)(k % 3)] = own[k / 3 * 3] * inverse[k % 3] +
                                                       own[k / 3 * 3 + 1] * inverse[3 + k % 3] +
                                                       own[k / 3 * 3 + 2] * inverse[6 + k % 3];
}

/* Eliminate a pivot from the rows of this CUDA block: number `owned`, from `first` with a step. Each warp takes 32
 * columns of some rows. */
PLIANT_INLINE void pliant_cones_eliminate_pivot(const pliant_team *team, const pliant_cones *on, int32_t width,
                                                int32_t p, int32_t first, int32_t step, int32_t owned)
{
    const int32_t warps = team->size / 32, warp = team->rank / 32, parts = (width - 3 * p + 28) / 32,
                  groups = parts < warps ? warps / parts : 1, group = warp / parts < groups ? warp / parts : owned;
    const size_t row = 3 * (size_t)width, next = (size_t)width, last = 2 * (size_t)width;
    for (int32_t part = warp % parts; part < parts; part += warps) {
        const int32_t column = 3 * p + 3 + 32 * part + team->rank % 32;
        if (column >= width) continue;
        const double *const pivot = on->equations + (size_t)p * row + (size_t)column;
        const double a = pivot[0], b = pivot[next], c = pivot[last];
        for (int32_t n = parts < warps ? group : 0; n < owned; n += groups) {
            const int32_t i = first + n * step;
            double *const to = on->equations + (size_t)i * row, *const own = to + column;
            const double *const by = to + 3 * p, *const second = by + next, *const third = by + last;
            if (i == p) continue;
            own[0] -= by[0] * a + by[1] * b + by[2] * c;
            own[next] -= second[0] * a + second[1] * b + second[2] * c;
            own[last] -= third[0] * a + third[1] * b + third[2] * c;
        }
    }
}

/* Eliminate above and below the diagonal, because threads can share this work. all: the team, or several CUDA blocks
 * with one team each. A CUDA block owns some rows. Pivots are not divided by their blocks until the end, so all CUDA
 * blocks wait only once for each of them. */
PLIANT_INLINE void pliant_cones_reduce(const pliant_team *team, const pliant_team *all, const pliant_cones *on,
                                       const pliant_cone_blocks *blocks)
{
    const int32_t count = blocks->count, width = 3 * count + 1, step = all->size / team->size,
                  first = (all->rank - team->rank) / team->size, owned = (count - first + step - 1) / step;
    const size_t row = 3 * (size_t)width;
    double inverse[9];
    for (int32_t p = 0; p < count; p++) {
        for (int32_t n = team->rank; n < owned; n += team->size) {
            pliant_cone_invert_pivot(on, blocks, p, on->equations + (size_t)p * row + 3 * p, (size_t)width, inverse);
            if (first + n * step != p)
                pliant_cone_multiply(on->equations + (size_t)(first + n * step) * row + 3 * p, (size_t)width, inverse);
        }
        pliant_team_wait(team);
        pliant_cones_eliminate_pivot(team, on, width, p, first, step, owned);
        pliant_team_wait(all);
    }
    for (int32_t p = all->rank; p < count; p += all->size) {
        pliant_cone_invert_pivot(on, blocks, p, on->equations + (size_t)p * row + 3 * p, (size_t)width, inverse);
        pliant_cone_scale_rows(inverse, width - 1, width, on->equations + (size_t)p * row);
    }
    pliant_team_wait(all);
}
#else
/* Eliminate below the diagonal, and substitute back. A tile of rows stays in the cache while all pivots above pass. */
PLIANT_INLINE void pliant_cones_reduce(const pliant_team *team, const pliant_team *all, const pliant_cones *on,
                                       const pliant_cone_blocks *blocks)
{
    (void)team, (void)all;
    const int32_t count = blocks->count, width = 3 * count + 1, tile = 4;
    double *const rows = on->equations, by[9];
    for (int32_t first = 0; first < count; first += tile) {
        const int32_t end = first + tile < count ? first + tile : count;
        for (int32_t p = 0; p < end; p++) {
            double *const pivot = rows + 3 * (size_t)p * (size_t)width;
            if (p >= first) {
                pliant_cone_invert_pivot(on, blocks, p, pivot + 3 * p, (size_t)width, by);
                pliant_cone_scale_rows(by, 3 * p + 3, width, pivot);
            }
            for (int32_t i = p < first ? first : p + 1; i < end; i++) {
                double *const to = rows + 3 * (size_t)i * (size_t)width;
                pliant_cone_copy_block(to + 3 * p, (size_t)width, by);
                pliant_cone_eliminate_rows(pivot, by, 3 * p + 3, width, to);
            }
        }
    }
    for (int32_t r = 3 * count - 4; r >= 0; r--) {
        double *own = rows + (size_t)r * (size_t)width, sum = 0;
        for (int32_t k = 3 * (r / 3) + 3; k < width - 1; k++) sum += own[k] * rows[(size_t)(k + 1) * (size_t)width - 1];
        own[width - 1] -= sum;
    }
}
#endif

/* Take the changes from the last column of the solved equations. */
PLIANT_INLINE void pliant_cones_take_changes(const pliant_team *team, const pliant_cones *on,
                                             const pliant_cone_blocks *blocks)
{
    const int32_t rows = 3 * blocks->count, width = rows + 1;
    for (int32_t r = team->rank; r < rows; r += team->size) {
        const int32_t row = pliant_cone_row(on, blocks, r / 3, r % 3);
        if (row >= 0) on->change[row] = on->equations[(size_t)(r + 1) * (size_t)width - 1];
    }
}

#ifdef __cplusplus
}
#endif
#endif
