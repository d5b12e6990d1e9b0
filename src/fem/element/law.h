/* Strain energies of isotropic tissue behind one interface: how stiff an element answers to its deformation gradient F.
 *
 * With H = F - I, J = det F, C = F'F, I1 = tr C and cof F = J F^-T, the first Piola-Kirchhoff stress of each law is
 * written as
 *     P = a (F - cof F) + b cof F        or, where c is asked for,        P = F S
 * with a, b functions of I1 - 3 and J - 1. F - cof F = H + H' - tr(H) I - cof H and J - 1 = tr H + tr(cof H) + det H
 * lose no digits near rest, which matters in single precision.
 *
 * neo_hookean: W = mu/2 (I1 - 3) - mu ln J + lambda/2 (J - 1)^2, so S = mu (I - C^-1) + lambda J (J - 1) C^-1. This is
 * equation 10 of
 *     [C], with its product J (J - 1) read as such.
 * compressible: W = mu/2 (J^(-2/3) I1 - 3) + kappa/4 (J^2 - 1 - 2 ln J), kappa = lambda + 2/3 mu (Miehe 1994; Holzapfel
 * 2000, 6.5). saint_venant_kirchhoff: S = lambda tr(E) I + 2 mu E, E = (C - I) / 2.
 *
 * 1/J, and with it ln J and J^(-2/3), has no value for elements that are flat or inverted. Below J = 0.3 they go on as
 * straight lines (the energy as a parabola), so that an element is pushed back through the flat state; above, the laws
 * are as written. */
#ifndef PLIANT_FEM_ELEMENT_LAW_H
#define PLIANT_FEM_ELEMENT_LAW_H

#include "base/inline.h"
#include "pliant/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

#define PLIANT_SMALLEST_RATIO 0.3

/* For a floating type: the terms of the stress. `shear` is b without what resists a change of volume, `volume` what
 * does, so b = shear + volume; volume is linear in the modulus that pliant_law_modulus names, for pressures at
 * nodes. */
#define PLIANT_DEFINE_LAW_TERMS(real, name)                                                                                      \
    PLIANT_INLINE real name##_reciprocal(real ratio)                                                                             \
    {                                                                                                                            \
        const real least = (real)PLIANT_SMALLEST_RATIO;                                                                          \
        real below = (2 * least - ratio) / (least * least), kept = ratio > least ? ratio : least;                                \
        return ratio > least ? 1 / kept : below;                                                                                 \
    }                                                                                                                            \
    /* J^(-1/3) by Newton's method from below: from the tangents of its inverse at 1 and at 8 */                                 \
    PLIANT_INLINE real name##_root(real ratio)                                                                                   \
    {                                                                                                                            \
        real y = 3 / (2 + ratio), far = 12 / (16 + ratio);                                                                       \
        y = y > far ? y : far;                                                                                                   \
        for (int pass = 0; pass < 6; pass++) y *= (4 - ratio * y * y * y) * (real)(1.0 / 3);                                     \
        return y;                                                                                                                \
    }                                                                                                                            \
    /* J^(-2/3) and its derivative */                                                                                            \
    PLIANT_INLINE void name##_power(real ratio, real *power, real *slope)                                                        \
    {                                                                                                                            \
        const real least = (real)PLIANT_SMALLEST_RATIO;                                                                          \
        real kept = ratio > least ? ratio : least, root = name##_root(kept);                                                     \
        *slope = -(real)(2.0 / 3) * root * root / kept;                                                                          \
        *power = root * root + (ratio > least ? 0 : *slope * (ratio - least));                                                   \
    }                                                                                                                            \
    /* what resists a change of volume, for a modulus of 1 */                                                                    \
    PLIANT_INLINE real name##_volume(pliant_law law, real change)                                                                \
    {                                                                                                                            \
        if (law != PLIANT_LAW_COMPRESSIBLE) return change;                                                                       \
        return (real)0.5 * (1 + change - name##_reciprocal(1 + change));                                                         \
    }                                                                                                                            \
    /* trace: I1 - 3; change: J - 1 */                                                                                           \
    PLIANT_INLINE void name##_terms(pliant_law law, real mu, real trace, real change, real *a,                                   \
                                                                   real *shear)                                                  \
    {                                                                                                                            \
        const real least = (real)PLIANT_SMALLEST_RATIO;                                                                          \
        real ratio = 1 + change, inverse = name##_reciprocal(ratio);                                                             \
        if (law == PLIANT_LAW_COMPRESSIBLE) {                                                                                    \
            real power, slope;                                                                                                   \
            name##_power(ratio, &power, &slope);                                                                                 \
            *a = mu * power;                                                                                                     \
            real near = power * (change - trace * (real)(1.0 / 3)) * inverse;                                                    \
            real below = power + (real)0.5 * slope * (3 + trace);                                                                \
            *shear = mu * (ratio > least ? near : below);                                                                        \
        } else {                                                                                                                 \
            *a = mu;                                                                                                             \
            *shear = mu * (ratio > least ? change * inverse : 1 - inverse);                                                      \
        }                                                                                                                        \
    }
PLIANT_DEFINE_LAW_TERMS(double, pliant_law_double)
PLIANT_DEFINE_LAW_TERMS(float, pliant_law_float)

/* what multiplies the volume term: lambda, or kappa */
static inline double pliant_law_modulus(pliant_law law, double lambda, double mu)
{
    return law == PLIANT_LAW_COMPRESSIBLE ? lambda + mu * (2.0 / 3) : lambda;
}

/* Energy density [J/m^3] of a deformation gradient (9, row-major) and, Nullable, its first Piola-Kirchhoff stress
 * [Pa]. */
double pliant_law_response(pliant_law law, double lambda, double mu, const double deformation[9], double stress[9]);

/* Cauchy stress P F' / J [Pa], symmetric: xx yy zz xy xz yz. false: the element is flat or inverted and has none. */
bool pliant_law_cauchy(pliant_law law, double lambda, double mu, const double deformation[9], double stress[6]);

/* Eigenvalues of a symmetric matrix (xx yy zz xy xz yz), largest last. */
void pliant_symmetric_eigenvalues(const double m[6], double out[3]);

#ifdef __cplusplus
}
#endif

#endif
