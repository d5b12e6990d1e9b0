/* The rotation nearest to a deformation gradient, as src/fem/element/rotation.h finds it. Row-major 3 x 3. */
#ifndef PLIANT_CUDA_ROTATION_CUH
#define PLIANT_CUDA_ROTATION_CUH

#include "base/matrix.h"
#include "fem/element/signed_svd.h"

/* Any state; seldom called, and too large to be anywhere else than by itself. */
static __device__ __noinline__ void rotation_signed_svd(const double *deformation, double *rotation) { pliant_signed_svd(deformation, rotation); }

/* Newton's iteration with determinant scaling (Higham 1986); the signed decomposition where it is flat or inverted. */
static __device__ __forceinline__ void rotation_of(const double *deformation, double *x)
{
    double norm = 0;
#pragma unroll
    for (int m = 0; m < 9; m++) {
        x[m] = deformation[m];
        norm += x[m] * x[m];
    }
    if (!(pliant_determinant(x) - 1e-4 * norm * sqrt(norm) > 0)) {
        rotation_signed_svd(deformation, x);
        return;
    }
    for (int pass = 0; pass < 12; pass++) {
        double cofactor[9] = {x[4] * x[8] - x[5] * x[7], x[5] * x[6] - x[3] * x[8], x[3] * x[7] - x[4] * x[6],
                              x[2] * x[7] - x[1] * x[8], x[0] * x[8] - x[2] * x[6], x[1] * x[6] - x[0] * x[7],
                              x[1] * x[5] - x[2] * x[4], x[2] * x[3] - x[0] * x[5], x[0] * x[4] - x[1] * x[3]};
        double determinant = x[0] * cofactor[0] + x[1] * cofactor[1] + x[2] * cofactor[2], scale = 1, moved = 0;
        if (pass < 2) {
            double size = 0, cofactors = 0;
#pragma unroll
            for (int m = 0; m < 9; m++) {
                size += x[m] * x[m];
                cofactors += cofactor[m] * cofactor[m];
            }
            scale = sqrt(sqrt(cofactors / (size * determinant * determinant)));
        }
        double a = 0.5 * scale, b = 0.5 / (scale * determinant);
#pragma unroll
        for (int m = 0; m < 9; m++) {
            double next = a * x[m] + b * cofactor[m];
            moved += (next - x[m]) * (next - x[m]);
            x[m] = next;
        }
        if (!(moved > 1e-20)) return;
    }
}

#endif
