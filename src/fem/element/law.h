/* Strain energies of isotropic tissue, as functions of an element's deformation gradient F.
 *
 * With H = F - I, J = det F, C = F'F, I1 = tr C and cof F = J F^-T, the first Piola-Kirchhoff stress has the form
 *     P = a (F - cof F) + b cof F        or, for a law in terms of C,        P = F S
 * where a and b are functions of I1 - 3 and J - 1. The forms F - cof F = H + H' - tr(H) I - cof H and J - 1 = tr H +
 * tr(cof H) + det H avoid cancellation near rest, which matters in single precision.
 * - neo_hookean: W = mu/2 (I1 - 3) - mu ln J + lambda/2 (J - 1)^2, so S = mu (I - C^-1) + lambda J (J - 1) C^-1. This
 *   is equation 10 of [C], with J (J - 1) read as a product.
 * - compressible: W = mu/2 (J^(-2/3) I1 - 3) + kappa/4 (J^2 - 1 - 2 ln J), kappa = lambda + 2/3 mu (Miehe 1994;
 *   Holzapfel 2000, 6.5).
 * - saint_venant_kirchhoff: S = lambda tr(E) I + 2 mu E, E = (C - I) / 2.
 *
 * 1/J, ln J and J^(-2/3) are undefined for flat or inverted elements. Below J = 0.3, 1/J and J^(-2/3) continue as
 * straight lines and the energy as a parabola. An inverted element is therefore pushed back through the flat state. */
#ifndef PLIANT_FEM_ELEMENT_LAW_H
#define PLIANT_FEM_ELEMENT_LAW_H

#include "base/count.h"
#include "base/inline.h"
#include "pliant/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

#define PLIANT_SMALLEST_RATIO 0.3

static_assert(
    PLIANT_COUNT_OF(PLIANT_LAW_LIST) == 3,
    "a new law needs its terms in law.h and law.c, its functions in tled_elements.c, its kernel in tled_step.cu");

/* Define the terms of the stress for a floating type. b = shear + volume: `volume` resists a change of volume, `shear`
 * is the rest. `volume` is linear in the modulus that pliant_law_modulus returns, as needed for nodal pressures. */
#define PLIANT_DEFINE_LAW_TERMS(real, name) \
    PLIANT_INLINE real name##_reciprocal(real ratio) \
    { \
        const real minimum = (real)PLIANT_SMALLEST_RATIO; \
        real below = (2 * minimum - ratio) / (minimum * minimum), kept = ratio > minimum ? ratio : minimum; \
        return ratio > minimum ? 1 / kept : below; \
    } \
    /* J^(-1/3) by Newton's method from below, starting at the larger tangent of its inverse at 1 and 8 */ \
    PLIANT_INLINE real name##_root(real ratio) \
    { \
        real y = 3 / (2 + ratio), far = 12 / (16 + ratio); \
        y = y > far ? y : far; \
        for (int pass = 0; pass < 6; pass++) y *= (4 - ratio * y * y * y) * (real)(1.0 / 3); \
        return y; \
    } \
    /* J^(-2/3) and its derivative */ \
    PLIANT_INLINE void name##_power(real ratio, real *power, real *slope) \
    { \
        const real minimum = (real)PLIANT_SMALLEST_RATIO; \
        real kept = ratio > minimum ? ratio : minimum, root = name##_root(kept); \
        *slope = -(real)(2.0 / 3) * root * root / kept; \
        *power = root * root + (ratio > minimum ? 0 : *slope * (ratio - minimum)); \
    } \
    /* volume term for a modulus of 1 */ \
    PLIANT_INLINE real name##_volume(pliant_law law, real change) \
    { \
        if (law != PLIANT_LAW_COMPRESSIBLE) return change; \
        return (real)0.5 * (1 + change - name##_reciprocal(1 + change)); \
    } \
    /* trace: I1 - 3; change: J - 1 */ \
    PLIANT_INLINE void name##_terms(pliant_law law, real mu, real trace, real change, real *a, real *shear) \
    { \
        const real minimum = (real)PLIANT_SMALLEST_RATIO; \
        real ratio = 1 + change, inverse = name##_reciprocal(ratio); \
        if (law == PLIANT_LAW_COMPRESSIBLE) { \
            real power, slope; \
            name##_power(ratio, &power, &slope); \
            *a = mu * power; \
            real near = power * (change - trace * (real)(1.0 / 3)) * inverse; \
            real below = power + (real)0.5 * slope * (3 + trace); \
            *shear = mu * (ratio > minimum ? near : below); \
        } else { \
            *a = mu; \
            *shear = mu * (ratio > minimum ? change * inverse : 1 - inverse); \
        } \
    }
PLIANT_DEFINE_LAW_TERMS(double, pliant_law_double)
PLIANT_DEFINE_LAW_TERMS(float, pliant_law_float)

/* Return the modulus of the volume term: lambda or kappa. */
static inline double pliant_law_modulus(pliant_law law, double lambda, double mu)
{
    return law == PLIANT_LAW_COMPRESSIBLE ? lambda + mu * (2.0 / 3) : lambda;
}

/* Return the energy density [J/m^3] of a deformation gradient (9, row-major). stress: Nullable: out: first
 * Piola-Kirchhoff stress (9) [Pa]. */
double pliant_law_response(pliant_law law, double lambda, double mu, const double deformation[9], double stress[9]);

/* Compute the Cauchy stress P F' / J [Pa], symmetric: xx yy zz xy xz yz. Return false if the element is flat or
 * inverted. */
bool pliant_law_cauchy(pliant_law law, double lambda, double mu, const double deformation[9], double stress[6]);

/* Compute the eigenvalues of a symmetric matrix (xx yy zz xy xz yz), in ascending order. */
void pliant_symmetric_eigenvalues(const double m[6], double out[3]);

#ifdef __cplusplus
}
#endif

#endif
