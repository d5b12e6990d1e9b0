/* 3 x 3 matrices, row-major, shared by CPU and kernels. */
#ifndef PLIANT_BASE_MATRIX_H
#define PLIANT_BASE_MATRIX_H

#include "base/inline.h"

PLIANT_INLINE double pliant_determinant(const double m[9])
{
    return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) + m[2] * (m[3] * m[7] - m[4] * m[6]);
}

#endif
