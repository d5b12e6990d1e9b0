/* 3 x 3 matrices, row-major, shared by CPU and kernels. */
#ifndef PLIANT_BASE_MATRIX_H
#define PLIANT_BASE_MATRIX_H

#include "base/inline.h"

PLIANT_INLINE double pliant_determinant(const double m[9])
{
    return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) + m[2] * (m[3] * m[7] - m[4] * m[6]);
}

/* Compute the cofactors of M, and return its determinant. */
PLIANT_INLINE double pliant_cofactor(const double m[9], double out[9])
{
    out[0] = m[4] * m[8] - m[5] * m[7];
    out[1] = m[5] * m[6] - m[3] * m[8];
    out[2] = m[3] * m[7] - m[4] * m[6];
    out[3] = m[2] * m[7] - m[1] * m[8];
    out[4] = m[0] * m[8] - m[2] * m[6];
    out[5] = m[1] * m[6] - m[0] * m[7];
    out[6] = m[1] * m[5] - m[2] * m[4];
    out[7] = m[2] * m[3] - m[0] * m[5];
    out[8] = m[0] * m[4] - m[1] * m[3];
    return m[0] * out[0] + m[1] * out[1] + m[2] * out[2];
}

/* Add M v to out. */
PLIANT_INLINE void pliant_add_product(const double m[9], const double *v, double *out)
{
    for (int r = 0; r < 3; r++) out[r] += m[3 * r] * v[0] + m[3 * r + 1] * v[1] + m[3 * r + 2] * v[2];
}

/* Add M' v, with the transposed matrix, to out. */
PLIANT_INLINE void pliant_add_transposed_product(const double m[9], const double *v, double *out)
{
    for (int c = 0; c < 3; c++) out[c] += m[c] * v[0] + m[3 + c] * v[1] + m[6 + c] * v[2];
}

#endif
