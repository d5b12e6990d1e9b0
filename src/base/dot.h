/* Dot products, shared by CPU and GPU. */
#ifndef PLIANT_BASE_DOT_H
#define PLIANT_BASE_DOT_H

#include "base/inline.h"

#include <stddef.h>

/* Return a . b in a fixed order, with four partial sums. */
PLIANT_INLINE double pliant_dot(size_t n, const double *a, const double *b)
{
    double sum[4] = {0, 0, 0, 0};
    size_t i = 0;
    for (; i + 4 <= n; i += 4)
        for (size_t l = 0; l < 4; l++) sum[l] += a[i + l] * b[i + l];
    for (; i < n; i++) sum[0] += a[i] * b[i];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

#endif
