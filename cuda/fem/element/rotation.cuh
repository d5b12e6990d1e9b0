/* The rotation nearest to a deformation gradient (src/fem/element/corotational.h), one thread per element. Matrices are
 * 3 x 3, row-major. */
#ifndef PLIANT_CUDA_ROTATION_CUH
#define PLIANT_CUDA_ROTATION_CUH

#include "fem/element/corotational.h"
#include "fem/element/signed_svd.h"

/* Compute the rotation in any state. It is seldom called, and not inlined because of its size. */
static __device__ __noinline__ void rotation_signed_svd(const double *deformation, double *rotation)
{
    pliant_signed_svd(deformation, rotation);
}

static __device__ __forceinline__ void rotation_of(const double *deformation, double *x)
{
#pragma unroll
    for (int m = 0; m < 9; m++) x[m] = deformation[m];
    if (!(pliant_rotation_regular(x) > 0)) {
        rotation_signed_svd(deformation, x);
        return;
    }
    for (int pass = 0; pass < PLIANT_ROTATION_PASSES; pass++)
        if (!(pliant_rotation_pass(pass, x) > pliant_rotation_moved)) return;
}

#endif
