#include "base/cubic.h"

#include "base/vector3.h"

#include <math.h>

/* The coefficients are values of the polar form (Farin, Curves and Surfaces for CAGD, 5th ed., 2002, ch. 5). */
void pliant_cubic_coefficients(const double a[3][3], const double b[3][3], double out[4])
{
    out[0] = pliant_triple3(a[0], a[1], a[2]);
    out[1] =
        (pliant_triple3(b[0], a[1], a[2]) + pliant_triple3(a[0], b[1], a[2]) + pliant_triple3(a[0], a[1], b[2])) / 3;
    out[2] =
        (pliant_triple3(b[0], b[1], a[2]) + pliant_triple3(b[0], a[1], b[2]) + pliant_triple3(a[0], b[1], b[2])) / 3;
    out[3] = pliant_triple3(b[0], b[1], b[2]);
}

enum { LEVELS = 20 };

/* Compute the fraction by bisection from the left. The error is at most 2^-levels. */
static double find_time(const double b[4], double limit, int levels)
{
    if (fmin(fmin(b[0], b[1]), fmin(b[2], b[3])) >= limit) return 1;
    if (levels == 0) return 0;
    /* de Casteljau's algorithm gives both halves */
    const double low = 0.5 * (b[0] + b[1]), middle = 0.5 * (b[1] + b[2]), high = 0.5 * (b[2] + b[3]);
    const double left[4] = {b[0], low, 0.5 * (low + middle), (low + 2 * middle + high) / 4};
    const double right[4] = {left[3], 0.5 * (middle + high), high, b[3]};
    const double time = find_time(left, limit, levels - 1);
    return time < 1 ? 0.5 * time : 0.5 + 0.5 * find_time(right, limit, levels - 1);
}

double pliant_cubic_time(const double coefficient[4], double limit) { return find_time(coefficient, limit, LEVELS); }
