/* One element's stress from H = F - I, in single precision. Matrices have 9 numbers, row-major. mu and the moduli are
 * multiplied by the rest volume. "Stress" here means rest volume times first Piola-Kirchhoff stress [N m]. */
#ifndef PLIANT_FEM_ELEMENT_STRESS_H
#define PLIANT_FEM_ELEMENT_STRESS_H

#include "fem/element/law.h"

/* Compute the cofactors of H, and return J - 1 without the cancellation of det F - 1. */
PLIANT_INLINE float pliant_change_of(const float h[9], float cofactor[9])
{
    cofactor[0] = h[4] * h[8] - h[5] * h[7];
    cofactor[1] = h[5] * h[6] - h[3] * h[8];
    cofactor[2] = h[3] * h[7] - h[4] * h[6];
    cofactor[3] = h[2] * h[7] - h[1] * h[8];
    cofactor[4] = h[0] * h[8] - h[2] * h[6];
    cofactor[5] = h[1] * h[6] - h[0] * h[7];
    cofactor[6] = h[1] * h[5] - h[2] * h[4];
    cofactor[7] = h[2] * h[3] - h[0] * h[5];
    cofactor[8] = h[0] * h[4] - h[1] * h[3];
    float third = h[0] * cofactor[0] + h[1] * cofactor[1] + h[2] * cofactor[2];
    return h[0] + h[4] + h[8] + (cofactor[0] + cofactor[4] + cofactor[8]) + third;
}

/* Return J - 1 in double precision. In rotated tissue it is a small difference of large numbers. Rounding in single
 * precision causes pressures of 1 Pa in nearly incompressible tissue. */
PLIANT_INLINE double pliant_exact_change_of(const double h[9])
{
    const double x = h[4] * h[8] - h[5] * h[7], y = h[5] * h[6] - h[3] * h[8], z = h[3] * h[7] - h[4] * h[6];
    const double second = x + (h[0] * h[8] - h[2] * h[6]) + (h[0] * h[4] - h[1] * h[3]);
    return h[0] + h[4] + h[8] + second + (h[0] * x + h[1] * y + h[2] * z);
}

/* Sum the differences of one displacement component over the four edges along each axis of a cube. u: relative to the
 * first corner. */
PLIANT_INLINE void pliant_cube_differences(const double u[8], double along[3])
{
    const double xy = u[3] - u[4], xz = u[5] - u[2], yz = u[6] - u[1]; /* diagonals */
    along[0] = u[7] + xy + xz - yz;
    along[1] = u[7] + xy + yz - xz;
    along[2] = u[7] + xz + yz - xy;
}

/* Compute the shear part of the stress in p, and cof F in cofactor. Return the volume part's factor of cof F. The rest
 * volume is included. */
PLIANT_INLINE float pliant_neo_hookean_stress(pliant_law law, const float h[9], float mu, float modulus,
                                              float cofactor[9], float p[9])
{
    float squares = 0, trace = h[0] + h[4] + h[8], change = pliant_change_of(h, cofactor), a, shear;
    for (int m = 0; m < 9; m++) squares += h[m] * h[m];
    pliant_law_float_terms(law, mu, 2 * trace + squares, change, &a, &shear);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            /* F - cof F = H + H' - tr(H) I - cof H, and cof F = (1 + tr H) I - H' + cof H */
            float transposed = h[3 * c + r], one = r == c ? trace : 0, of_h = cofactor[3 * r + c];
            cofactor[3 * r + c] = (r == c) + one - transposed + of_h;
            p[3 * r + c] = a * (h[3 * r + c] + transposed - one - of_h) + shear * cofactor[3 * r + c];
        }
    return modulus * pliant_law_float_volume(law, change);
}

PLIANT_INLINE void pliant_saint_venant_kirchhoff_stress(const float h[9], float mu, float lambda, float p[9],
                                                        float volume[9])
{
    float e[9];
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            /* Twice E. */
            e[3 * r + c] = h[3 * r + c] + h[3 * c + r] + h[r] * h[c] + h[3 + r] * h[3 + c] + h[6 + r] * h[6 + c];
    float trace = 0.5f * lambda * (e[0] + e[4] + e[8]);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            p[3 * r + c] = mu * (e[3 * r + c] + h[3 * r] * e[c] + h[3 * r + 1] * e[3 + c] + h[3 * r + 2] * e[6 + c]);
            volume[3 * r + c] = trace * ((r == c) + h[3 * r + c]);
        }
}

/* Return the relaxed fraction of a Prony term in one implicit step (Taylor et al. 2009). The relaxed stress Y_i
 * approaches its share of the instantaneous stress:
 *     Y_i+ = (tau_i Y_i + dt share_i S) / (tau_i + dt) = Y_i + part (share_i S - Y_i)
 * The acting stress is S minus the sum of all Y_i. S is the shear part. */
PLIANT_INLINE float pliant_prony_relaxed_fraction(float dt, float tau) { return dt / (tau + dt); }

/* Compute S = F^-1 P: xx yy zz xy xz yz. */
PLIANT_INLINE void pliant_stress_at_rest(const float h[9], const float cofactor[9], const float p[9], float s[6])
{
    const float inverse =
        pliant_law_float_reciprocal((1 + h[0]) * cofactor[0] + h[1] * cofactor[1] + h[2] * cofactor[2]);
    s[0] = (cofactor[0] * p[0] + cofactor[3] * p[3] + cofactor[6] * p[6]) * inverse;
    s[1] = (cofactor[1] * p[1] + cofactor[4] * p[4] + cofactor[7] * p[7]) * inverse;
    s[2] = (cofactor[2] * p[2] + cofactor[5] * p[5] + cofactor[8] * p[8]) * inverse;
    s[3] = (cofactor[0] * p[1] + cofactor[3] * p[4] + cofactor[6] * p[7]) * inverse;
    s[4] = (cofactor[0] * p[2] + cofactor[3] * p[5] + cofactor[6] * p[8]) * inverse;
    s[5] = (cofactor[1] * p[2] + cofactor[4] * p[5] + cofactor[7] * p[8]) * inverse;
}

/* Add Kelvin-Voigt damping to P: F dS with the second Piola-Kirchhoff stress dS = 2 factor mu dE. dE is the change of
 * Green's strain by dF = change in the last sub-step. factor: damping time divided by the duration of a sub-step. */
PLIANT_INLINE void pliant_add_viscous(const float h[9], const float change[9], float mu, float factor, float p[9])
{
    float s[9];
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            const float rc = change[3 * r + c] + h[r] * change[c] + h[3 + r] * change[3 + c] + h[6 + r] * change[6 + c];
            const float cr = change[3 * c + r] + h[c] * change[r] + h[3 + c] * change[3 + r] + h[6 + c] * change[6 + r];
            s[3 * r + c] = factor * mu * (rc + cr);
        }
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            p[3 * r + c] += s[3 * r + c] + h[3 * r] * s[c] + h[3 * r + 1] * s[3 + c] + h[3 * r + 2] * s[6 + c];
}

/* Subtract F times the relaxed stress from P. */
PLIANT_INLINE void pliant_subtract_relaxed(const float h[9], const float relaxed[6], float p[9])
{
    const float y[9] = {relaxed[0], relaxed[3], relaxed[4], relaxed[3], relaxed[1],
                        relaxed[5], relaxed[4], relaxed[5], relaxed[2]};
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            p[3 * r + c] -= y[3 * r + c] + h[3 * r] * y[c] + h[3 * r + 1] * y[3 + c] + h[3 * r + 2] * y[6 + c];
}

#endif
