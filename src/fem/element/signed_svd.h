/* The rotation of any deformation gradient, shared by the CPU (rotation.c) and kernels (cuda/fem/element/rotation.cuh).
 * Indices are compile-time constants, so that matrices stay in registers. Matrices are 3 x 3, row-major. */
#ifndef PLIANT_FEM_ELEMENT_SIGNED_SVD_H
#define PLIANT_FEM_ELEMENT_SIGNED_SVD_H

#include "base/inline.h"
#include "base/vector3.h"

#include <math.h>

/* Apply one Jacobi rotation to rows and columns p, q of a symmetric matrix. After all rotations the columns of v are
 * its eigenvectors. */
PLIANT_INLINE void pliant_jacobi_rotate(const int p, const int q, double *a, double *v)
{
    const double apq = a[3 * p + q];
    if (apq == 0) return;
    const double theta = (a[4 * q] - a[4 * p]) / (2 * apq);
    const double t = (theta >= 0 ? 1 : -1) / (fabs(theta) + sqrt(theta * theta + 1));
    const double c = 1 / sqrt(t * t + 1), s = t * c;
    PLIANT_UNROLL
    for (int r = 0; r < 3; r++) {
        const double left = a[3 * r + p], right = a[3 * r + q];
        a[3 * r + p] = c * left - s * right;
        a[3 * r + q] = s * left + c * right;
    }
    PLIANT_UNROLL
    for (int r = 0; r < 3; r++) {
        double left = a[3 * p + r], right = a[3 * q + r];
        a[3 * p + r] = c * left - s * right;
        a[3 * q + r] = s * left + c * right;
        left = v[3 * r + p], right = v[3 * r + q];
        v[3 * r + p] = c * left - s * right;
        v[3 * r + q] = s * left + c * right;
    }
}

/* Compute eigenvalues on the diagonal and eigenvectors in the columns, by cyclic Jacobi rotations (Golub and Van Loan,
 * 8.5). */
PLIANT_INLINE void pliant_jacobi(double *a, double *v)
{
    for (int m = 0; m < 9; m++) v[m] = m % 4 == 0;
    for (int sweep = 0; sweep < 12; sweep++) {
        const double off = a[1] * a[1] + a[2] * a[2] + a[5] * a[5], on = a[0] * a[0] + a[4] * a[4] + a[8] * a[8];
        if (off <= 1e-30 * on) return;
        pliant_jacobi_rotate(0, 1, a, v);
        pliant_jacobi_rotate(0, 2, a, v);
        pliant_jacobi_rotate(1, 2, a, v);
    }
}

/* Move the larger of columns p and q to p, by the sizes on the diagonal. */
PLIANT_INLINE void pliant_sort_columns(const int p, const int q, double *size, double *v)
{
    if (size[p] >= size[q]) return;
    double swap = size[p];
    size[p] = size[q];
    size[q] = swap;
    PLIANT_UNROLL
    for (int r = 0; r < 3; r++) {
        swap = v[3 * r + p];
        v[3 * r + p] = v[3 * r + q];
        v[3 * r + q] = swap;
    }
}

PLIANT_INLINE void pliant_orthogonal_to(const double *v, double *out)
{
    const double x = fabs(v[0]), y = fabs(v[1]), z = fabs(v[2]);
    const double axis[3] = {x <= y && x <= z ? 1.0 : 0.0, y < x && y <= z ? 1.0 : 0.0, z < x && z < y ? 1.0 : 0.0};
    pliant_cross3(v, axis, out);
    pliant_normalize3(out);
}

/* Compute R = U V' from F = U S V', with rotations U and V and the sign of det F on the smallest singular value (Irving
 * et al. 2004). The two larger directions are mapped by F, the third is their cross product. This avoids a division by
 * a small singular value. */
PLIANT_INLINE void pliant_signed_svd(const double *deformation, double *rotation)
{
    double largest = 0, f[9], gram[9], v[9];
    for (int m = 0; m < 9; m++) largest = fmax(largest, fabs(deformation[m]));
    if (!(largest > 0) || !isfinite(largest)) { /* collapsed to a point, or not finite: no rotation is nearest */
        for (int m = 0; m < 9; m++) rotation[m] = m % 4 == 0;
        return;
    }
    for (int m = 0; m < 9; m++) f[m] = deformation[m] / largest;
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) gram[3 * r + c] = f[r] * f[c] + f[3 + r] * f[3 + c] + f[6 + r] * f[6 + c];
    pliant_jacobi(gram, v);
    double size[3] = {gram[0], gram[4], gram[8]};
    pliant_sort_columns(0, 1, size, v);
    pliant_sort_columns(1, 2, size, v);
    pliant_sort_columns(0, 1, size, v);
    const double v0[3] = {v[0], v[3], v[6]}, v1[3] = {v[1], v[4], v[7]};
    double v2[3], u0[3], u1[3], u2[3];
    pliant_cross3(v0, v1, v2);
    for (int r = 0; r < 3; r++) {
        u0[r] = f[3 * r] * v0[0] + f[3 * r + 1] * v0[1] + f[3 * r + 2] * v0[2];
        u1[r] = f[3 * r] * v1[0] + f[3 * r + 1] * v1[1] + f[3 * r + 2] * v1[2];
    }
    const double stretch = pliant_normalize3(u0), along = u0[0] * u1[0] + u0[1] * u1[1] + u0[2] * u1[2];
    for (int d = 0; d < 3; d++) u1[d] -= along * u0[d];
    if (pliant_normalize3(u1) <= 1e-12 * stretch) pliant_orthogonal_to(u0, u1); /* collapsed to a line */
    pliant_cross3(u0, u1, u2);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) rotation[3 * r + c] = u0[r] * v0[c] + u1[r] * v1[c] + u2[r] * v2[c];
}

#endif
