/* The neo-Hookean law (law.h) in double precision. Loops of the CPU (elements.c, macro.c) and kernels
 * (cuda/fem/element) share this code. Matrices have 9 numbers, row-major. With moduli times volume, stresses are
 * multiplied by the volume as well.
 *     P = mu (F - cof F / J) + lambda (J - 1) cof F            first Piola-Kirchhoff stress */
#ifndef PLIANT_FEM_ELEMENT_NEO_HOOKEAN_H
#define PLIANT_FEM_ELEMENT_NEO_HOOKEAN_H

#include "base/matrix.h"
#include "fem/element/law.h"

#include <stdbool.h>

/* Compute P. */
PLIANT_INLINE void pliant_neo_hookean_piola(const double f[9], double lambda, double mu, double p[9])
{
    double cofactor[9];
    const double ratio = pliant_cofactor(f, cofactor);
    const double factor = lambda * (ratio - 1) - mu * pliant_law_double_reciprocal(ratio);
    PLIANT_UNROLL
    for (int m = 0; m < 9; m++) p[m] = mu * f[m] + factor * cofactor[m];
}

/* Compute the corner forces of a tetrahedron (4 x 3). is_linear: it only fills empty space, and its force is linear. */
PLIANT_INLINE void pliant_neo_hookean_force(const double f[9], bool is_linear, double lambda, double mu,
                                            const double gradients[12], double out[12])
{
    double p[9];
    const double trace = lambda * (f[0] + f[4] + f[8] - 3);
    pliant_neo_hookean_piola(f, lambda, mu, p);
    PLIANT_UNROLL
    for (int m = 0; m < 9; m++) {
        const double identity = m % 4 == 0;
        const double linear = trace * identity + mu * (f[m] + f[m / 3 + m % 3 * 3] - 2 * identity);
        p[m] = is_linear ? linear : p[m];
    }
    PLIANT_UNROLL
    for (int v = 0; v < 4; v++)
        PLIANT_UNROLL
        for (int d = 0; d < 3; d++)
            out[3 * v + d] =
                p[3 * d] * gradients[3 * v] + p[3 * d + 1] * gradients[3 * v + 1] + p[3 * d + 2] * gradients[3 * v + 2];
}

/* Compute the difference between the stresses of the neo-Hookean and the corotational law, which is added to the
 * corotational force of a hexahedron (NUMERICS.md). r: the rotation nearest to F. */
PLIANT_INLINE void pliant_neo_hookean_addition(const double f[9], const double r[9], double lambda, double mu,
                                               double p[9])
{
    double turned[9], trace = -3; /* F'R, and tr(R'F) - 3 */
    PLIANT_UNROLL
    for (int a = 0; a < 3; a++)
        PLIANT_UNROLL
        for (int b = 0; b < 3; b++) turned[3 * a + b] = f[a] * r[b] + f[3 + a] * r[3 + b] + f[6 + a] * r[6 + b];
    PLIANT_UNROLL
    for (int m = 0; m < 9; m++) trace += r[m] * f[m];
    pliant_neo_hookean_piola(f, lambda, mu, p);
    PLIANT_UNROLL
    for (int a = 0; a < 3; a++)
        PLIANT_UNROLL
        for (int b = 0; b < 3; b++) {
            const int m = 3 * a + b;
            const double back = r[3 * a] * turned[b] + r[3 * a + 1] * turned[3 + b] + r[3 * a + 2] * turned[6 + b];
            /* R (2 mu e + lambda tr(e) I), with 2 R e = F + R F'R - 2 R */
            p[m] -= mu * (f[m] + back - 2 * r[m]) + lambda * trace * r[m];
        }
}

#endif
