/* Weights of the secants (Walker and Ni 2011, 2.1): choice of the used secants, normal equations, and solution. The CPU
 * runs this code with one lane, the GPU with a warp. The lanes divide the rows, and the order of operations is the same
 * for any number of lanes. */
#ifndef PLIANT_FEM_QUASISTATIC_SECANT_EQUATIONS_H
#define PLIANT_FEM_QUASISTATIC_SECANT_EQUATIONS_H

#include "base/dot.h"
#include "base/inverse_root.h"
#include "fem/quasistatic/anderson.h"

#ifdef __CUDACC__
#define PLIANT_LANES_SYNC() __syncwarp()
#else
#define PLIANT_LANES_SYNC() ((void)0)
#endif

enum { PLIANT_EQUATIONS_ROW = PLIANT_MAX_HISTORY + 1 }; /* an odd number avoids bank conflicts on the GPU */

/* Work arrays, shared by the lanes. */
typedef struct pliant_secant_equations {
    int32_t used[PLIANT_MAX_HISTORY];
    double scale[PLIANT_MAX_HISTORY], inverse[PLIANT_MAX_HISTORY], weight[PLIANT_MAX_HISTORY];
    /* its lower triangle; the row after the last one is the right side */
    double matrix[PLIANT_MAX_HISTORY + 1][PLIANT_EQUATIONS_ROW];
} pliant_secant_equations;

/* List the slots of the used secants and return their number. The sizes of secants differ by orders of magnitude, so
 * they are scaled to a unit diagonal. */
PLIANT_INLINE int32_t pliant_secant_choose(int32_t lane, int32_t lanes, const pliant_anderson *rules,
                                           const double *gram, double largest, pliant_secant_equations *equations)
{
    int32_t count = 0;
    for (int32_t h = lane; h < PLIANT_MAX_HISTORY; h += lanes)
        equations->scale[h] =
            rules->number[h] > 0 ? pliant_anderson_scale(gram[h * PLIANT_MAX_HISTORY + h], largest) : 0.0;
    PLIANT_LANES_SYNC();
    for (int32_t h = 0; h < PLIANT_MAX_HISTORY; h++) {
        if (equations->scale[h] > 0 && h % lanes == lane) equations->used[count] = h;
        count += equations->scale[h] > 0;
    }
    PLIANT_LANES_SYNC();
    return count;
}

/* Fill the equations of the used secants. A small regularization represents the error of the secants. */
PLIANT_INLINE void pliant_secant_fill(int32_t lane, int32_t lanes, const pliant_anderson *rules, const double *gram,
                                      const double *along, bool estimates, int32_t count,
                                      pliant_secant_equations *equations)
{
    for (int32_t n = lane; n < count * count; n += lanes) {
        const int32_t a = n / count, b = n % count, first = equations->used[a], second = equations->used[b];
        const double noise =
            estimates ? pliant_anderson_noise(rules, first) : pliant_get_quasistatic_settings().trial_noise;
        if (a == b) equations->matrix[count][a] = along[first] * equations->scale[first];
        equations->matrix[a][b] =
            a == b ? 1 + noise * noise
                   : gram[first * PLIANT_MAX_HISTORY + second] * equations->scale[first] * equations->scale[second];
    }
    PLIANT_LANES_SYNC();
}

/* Solve by Cholesky, column by column (Golub and Van Loan, 4.2). The right side is one more row of the factor, so it is
 * substituted forward in the same loop. `inverse` is the inverse diagonal of the factor. Return false if rounding has
 * made the matrix indefinite. */
PLIANT_INLINE bool pliant_secant_solve(int32_t lane, int32_t lanes, int32_t count, pliant_secant_equations *equations)
{
    double(*matrix)[PLIANT_EQUATIONS_ROW] = equations->matrix, *right = equations->matrix[count];
    for (int32_t c = 0; c < count; c++) {
        const double pivot = matrix[c][c] - pliant_dot((size_t)c, matrix[c], matrix[c]); /* the same for all lanes */
        if (!(pivot > 1e-14 * matrix[c][c])) return false;
        const double inverse = pliant_inverse_root(pivot);
        for (int32_t r = lane; r <= count; r += lanes)
            if (r > c) matrix[r][c] = inverse * (matrix[r][c] - pliant_dot((size_t)c, matrix[r], matrix[c]));
        if (c % lanes == lane) equations->inverse[c] = inverse;
        PLIANT_LANES_SYNC();
    }
    for (int32_t c = count - 1; c >= 0; c--) {
        const double weight = right[c] * equations->inverse[c];
        for (int32_t r = lane; r < c; r += lanes) right[r] -= matrix[c][r] * weight;
        if (c % lanes == lane) equations->weight[c] = weight;
        PLIANT_LANES_SYNC();
    }
    return true;
}

/* Compute the weights that minimize a step in the energy norm: min |dx - sum w_i (secant of dx)_i|_K0. Return false,
 * with zero weights, if there is no solution.
 * @param gram       (PLIANT_MAX_HISTORY squared) products of the secants' steps with their residuals, and of the
 *     springs.
 * @param along      (PLIANT_MAX_HISTORY) the same products with the residual of the state.
 * @param estimates  True: for an error estimate; false: for a trial. */
PLIANT_INLINE bool pliant_secant_weights(int32_t lane, int32_t lanes, const pliant_anderson *rules, const double *gram,
                                         const double *along, bool estimates, pliant_secant_equations *equations,
                                         double *weights)
{
    for (int32_t h = lane; h < PLIANT_MAX_HISTORY; h += lanes) weights[h] = 0;
    const int32_t count =
        pliant_secant_choose(lane, lanes, rules, gram, estimates ? INFINITY : rules->largest_secant, equations);
    if (count == 0) return false;
    pliant_secant_fill(lane, lanes, rules, gram, along, estimates, count, equations);
    if (!pliant_secant_solve(lane, lanes, count, equations)) return false;
    for (int32_t a = lane; a < count; a += lanes)
        weights[equations->used[a]] = equations->weight[a] * equations->scale[equations->used[a]];
    return true;
}

#endif
