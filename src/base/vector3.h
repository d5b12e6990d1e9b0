/* Vectors of three numbers, shared by CPU and kernels. `out` must not be an input of the same call, except in
 * pliant_subtract3. */
#ifndef PLIANT_BASE_VECTOR3_H
#define PLIANT_BASE_VECTOR3_H

#include "base/inline.h"

#include <math.h>

PLIANT_INLINE double pliant_dot3(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

PLIANT_INLINE double pliant_length3(const double *a) { return sqrt(pliant_dot3(a, a)); }

PLIANT_INLINE void pliant_subtract3(const double *a, const double *b, double *out)
{
    out[0] = a[0] - b[0];
    out[1] = a[1] - b[1];
    out[2] = a[2] - b[2];
}

PLIANT_INLINE double pliant_distance3(const double *a, const double *b)
{
    double difference[3];
    pliant_subtract3(a, b, difference);
    return pliant_length3(difference);
}

PLIANT_INLINE void pliant_cross3(const double *a, const double *b, double *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* Return the triple product (a x b) . c. */
PLIANT_INLINE double pliant_triple3(const double *a, const double *b, const double *c)
{
    double normal[3];
    pliant_cross3(a, b, normal);
    return pliant_dot3(normal, c);
}

/* Divide a vector by its length unless it is zero. Return the length. */
PLIANT_INLINE double pliant_normalize3(double *v)
{
    const double length = pliant_length3(v);
    if (length > 0) {
        v[0] /= length;
        v[1] /= length;
        v[2] /= length;
    }
    return length;
}

#endif
