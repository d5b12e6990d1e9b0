/* One corotational tetrahedron. Loops of the CPU (elements.c, rotation.h, scalar.c) and kernels
 * (cuda/fem/element/forces.cu) share this code. Matrices have 9 numbers, row-major. Corners, gradients and forces are 4
 * x 3.
 *
 * F = sum over corners of x_v g_v' (e.g. Bonet and Wood, 9.2), and R is the rotation nearest to F. With the strain e =
 * sym(R'F) - I, isotropic tissue has the stress T = 2 mu e + lambda tr(e) I in the frame of the element. The corner
 * forces are f_v = V R T g_v. They equal R K (R'x - X) (Mueller and Gross 2004), without storing K. */
#ifndef PLIANT_FEM_ELEMENT_COROTATIONAL_H
#define PLIANT_FEM_ELEMENT_COROTATIONAL_H

#include "base/matrix.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>

PLIANT_INLINE void pliant_deformation(const double x[12], const double gradients[12], double f[9])
{
    PLIANT_UNROLL
    for (int r = 0; r < 3; r++)
        PLIANT_UNROLL
        for (int c = 0; c < 3; c++)
            f[3 * r + c] = (x[3 + r] - x[r]) * gradients[3 + c] + (x[6 + r] - x[r]) * gradients[6 + c] +
                           (x[9 + r] - x[r]) * gradients[9 + c];
}

/* ---- R: Newton's iteration X <- (s X + X^-T / s) / 2 from F (Higham 1986). */

enum { PLIANT_ROTATION_PASSES = 12 };
/* Stop at this sum of squared changes. Newton's method doubles the number of digits, so the pass after it would change
 * nothing. */
static const double pliant_rotation_moved = 1e-15;

/* Return a positive value if the element is neither flat nor inverted. The iteration then finds R; otherwise use the
 * signed decomposition (signed_svd.h). */
PLIANT_INLINE double pliant_rotation_regular(const double f[9])
{
    double norm = 0;
    PLIANT_UNROLL
    for (int m = 0; m < 9; m++) norm += f[m] * f[m];
    return pliant_determinant(f) - 1e-4 * norm * sqrt(norm);
}

/* Run one pass and return the sum of its squared changes. The scaling s^2 = |X^-1| / |X| (Frobenius) is used in the
 * first passes only. Near a rotation it is 1. */
PLIANT_INLINE double pliant_rotation_pass(int pass, double x[9])
{
    const double cofactor[9] = {x[4] * x[8] - x[5] * x[7], x[5] * x[6] - x[3] * x[8], x[3] * x[7] - x[4] * x[6],
                                x[2] * x[7] - x[1] * x[8], x[0] * x[8] - x[2] * x[6], x[1] * x[6] - x[0] * x[7],
                                x[1] * x[5] - x[2] * x[4], x[2] * x[3] - x[0] * x[5], x[0] * x[4] - x[1] * x[3]};
    const double determinant = x[0] * cofactor[0] + x[1] * cofactor[1] + x[2] * cofactor[2];
    double scale = 1, moved = 0;
    if (pass < 2) {
        double norm = 0, cofactors = 0;
        PLIANT_UNROLL
        for (int m = 0; m < 9; m++) norm += x[m] * x[m];
        cofactors = cofactor[0] * cofactor[0] + cofactor[1] * cofactor[1] + cofactor[2] * cofactor[2] +
                    cofactor[3] * cofactor[3] + cofactor[4] * cofactor[4] + cofactor[5] * cofactor[5] +
                    cofactor[6] * cofactor[6] + cofactor[7] * cofactor[7] + cofactor[8] * cofactor[8];
        scale = sqrt(sqrt(cofactors / (norm * determinant * determinant)));
    }
    const double a = 0.5 * scale, b = 0.5 / (scale * determinant);
    PLIANT_UNROLL
    for (int m = 0; m < 9; m++) {
        const double next = a * x[m] + b * cofactor[m];
        moved += (next - x[m]) * (next - x[m]);
        x[m] = next;
    }
    return moved;
}

/* ---- Isotropic tissue. */

/* Return row r, column c of the block of two corners in K, from the gradients of their shape functions. lambda, mu:
 * multiplied by the volume. */
PLIANT_INLINE double pliant_isotropic_entry(const double a[3], const double b[3], double lambda, double mu, int r,
                                            int c)
{
    const double dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    return lambda * a[r] * b[c] + mu * (a[c] * b[r] + (r == c ? dot : 0));
}

/* Compute the strain e: xx yy zz xy xz yz. */
PLIANT_INLINE void pliant_corotational_strain(const double f[9], const double r[9], double e[6])
{
    double s[9];
    PLIANT_UNROLL
    for (int a = 0; a < 3; a++)
        PLIANT_UNROLL
        for (int b = 0; b < 3; b++) s[3 * a + b] = r[a] * f[b] + r[3 + a] * f[3 + b] + r[6 + a] * f[6 + b];
    e[0] = s[0] - 1;
    e[1] = s[4] - 1;
    e[2] = s[8] - 1;
    e[3] = 0.5 * (s[1] + s[3]);
    e[4] = 0.5 * (s[2] + s[6]);
    e[5] = 0.5 * (s[5] + s[7]);
}

/* Compute the stress T in the same order. With moduli times volume, it is multiplied by the volume as well. */
PLIANT_INLINE void pliant_corotational_stress(const double e[6], double lambda, double mu, double stress[6])
{
    const double pressure = lambda * (e[0] + e[1] + e[2]), twice = 2 * mu;
    PLIANT_UNROLL
    for (int m = 0; m < 3; m++) {
        stress[m] = twice * e[m] + pressure;
        stress[3 + m] = twice * e[3 + m];
    }
}

PLIANT_INLINE void pliant_corotational_force(const double f[9], const double r[9], double lambda, double mu,
                                             const double gradients[12], double out[12])
{
    double e[6], s[6], p[9];
    pliant_corotational_strain(f, r, e);
    pliant_corotational_stress(e, lambda, mu, s);
    const double t[9] = {s[0], s[3], s[4], s[3], s[1], s[5], s[4], s[5], s[2]};
    PLIANT_UNROLL
    for (int a = 0; a < 3; a++)
        PLIANT_UNROLL
        for (int b = 0; b < 3; b++) p[3 * a + b] = r[3 * a] * t[b] + r[3 * a + 1] * t[3 + b] + r[3 * a + 2] * t[6 + b];
    PLIANT_UNROLL
    for (int v = 0; v < 4; v++)
        PLIANT_UNROLL
        for (int a = 0; a < 3; a++)
            out[3 * v + a] =
                p[3 * a] * gradients[3 * v] + p[3 * a + 1] * gradients[3 * v + 1] + p[3 * a + 2] * gradients[3 * v + 2];
}

/* ---- Homogenized elements: f = R K (R'x - X), [H] 2.2. */

/* Compute the forces of a homogenized element. K's entry (a, b) is at stride (12 a + b). Positions are relative to
 * corner 0, which avoids cancellation under a large translation. A grounded element (R = I) uses absolute positions,
 * since it resists translation. */
PLIANT_INLINE void pliant_homogenized_force(const double *stiffness, size_t stride, const double x[12],
                                            const double rest[12], const double r[9], bool grounded, double out[12])
{
    double u[12], f[12];
    PLIANT_UNROLL
    for (int v = 0; v < 4; v++) {
        double y[3];
        PLIANT_UNROLL
        for (int d = 0; d < 3; d++) y[d] = grounded ? x[3 * v + d] : x[3 * v + d] - x[d];
        PLIANT_UNROLL
        for (int d = 0; d < 3; d++)
            u[3 * v + d] = r[d] * y[0] + r[3 + d] * y[1] + r[6 + d] * y[2] -
                           (grounded ? rest[3 * v + d] : rest[3 * v + d] - rest[d]);
    }
    PLIANT_UNROLL
    for (int a = 0; a < 12; a++) {
        f[a] = 0;
        PLIANT_UNROLL
        for (int b = 0; b < 12; b++) f[a] += stiffness[(size_t)(12 * a + b) * stride] * u[b];
    }
    PLIANT_UNROLL
    for (int v = 0; v < 4; v++)
        PLIANT_UNROLL
    for (int d = 0; d < 3; d++)
        out[3 * v + d] = r[3 * d] * f[3 * v] + r[3 * d + 1] * f[3 * v + 1] + r[3 * d + 2] * f[3 * v + 2];
}

#endif
