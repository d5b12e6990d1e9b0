/* Inverse square root, shared by CPU and GPU. */
#ifndef PLIANT_BASE_INVERSE_ROOT_H
#define PLIANT_BASE_INVERSE_ROOT_H

#include "base/inline.h"

#include <math.h>

/* Return 1 / sqrt(x). A GPU computes it faster than a root and a division. */
PLIANT_INLINE double pliant_inverse_root(double x)
{
#ifdef __CUDACC__
    return rsqrt(x);
#else
    return 1 / sqrt(x);
#endif
}

#endif
