/* Barrier against inversion of isotropic elements, shared by CPU loops (macro.c, elements.c) and kernels
 * (cuda/fem/element). Its energy per volume depends on the volume ratio J of a tetrahedron:
 *     W = k mu b(J),    b(J) = -(J - J0)^2 ln(J / J0) for J < J0,    b = 0 for J >= J0
 * b is the barrier of Li et al., Incremental Potential Contact, ACM Trans. Graph. 39(4), 2020, equation 6, for a
 * distance. It has two continuous derivatives, so small strains do not change. Below J1, b continues as a parabola. An
 * iterate that is inverted is therefore pushed back.
 *
 * A hexahedron has ten such tetrahedra, five of each division of a cube. The eight corner tetrahedra each have a
 * twelfth of the volume, the two middle ones a sixth. The mean volume of both divisions is the trilinear
 * hexahedron's volume. */
#ifndef PLIANT_FEM_ELEMENT_VOLUME_BARRIER_H
#define PLIANT_FEM_ELEMENT_VOLUME_BARRIER_H

#include "base/inline.h"
#include "base/vector3.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

/* J0: far below the volume changes of living tissue. The barrier's stress is 3 % of the corotational law's pressure at
 * J = 0.6, and 15 % at J = 0.5 (nu 0.45). */
#define PLIANT_BARRIER_LIMIT 0.7
#define PLIANT_BARRIER_LIMIT_ROOT 0.8879040 /* its cubic root */
/* J1: contact keeps this volume, too (volume_stop, contact/settings.h). */
#define PLIANT_BARRIER_PARABOLA 0.1
/* k: at J1, an element pressed flat between two plates has 1.8 times the stress of the corotational law for nu 0.45 in
 * addition. With half of k, the pull of 3 cm stalls on cells of 10 mm. */
#define PLIANT_BARRIER_STRENGTH 3.0

/* Values of k b at a volume ratio. */
typedef struct pliant_barrier { double energy, slope, stiffness; } pliant_barrier;

/* Compute k b(J) and its first two derivatives. */
PLIANT_INLINE pliant_barrier pliant_barrier_at(double ratio)
{
    const double limit = PLIANT_BARRIER_LIMIT, smallest = PLIANT_BARRIER_PARABOLA, strength = PLIANT_BARRIER_STRENGTH;
    pliant_barrier out = {0, 0, 0};
    if (ratio >= limit) return out;
    const double j = ratio > smallest ? ratio : smallest, beyond = ratio - j, below = limit - j,
                 depth = log(limit / j), part = below / j, slope = -below * (2 * depth + part);
    const double stiffness = 2 * depth + part * (4 + part);
    out.energy = strength * (below * below * depth + beyond * (slope + 0.5 * stiffness * beyond));
    out.slope = strength * (slope + stiffness * beyond);
    out.stiffness = strength * stiffness;
    return out;
}

/* ---- a tetrahedron with the deformation gradient F */

/* Compute cof F, the gradient of J. */
PLIANT_INLINE void pliant_barrier_cofactor(const double f[9], double out[9])
{
    PLIANT_UNROLL
    for (int r = 0; r < 3; r++) pliant_cross3(f + 3 * ((r + 1) % 3), f + 3 * ((r + 2) % 3), out + 3 * r);
}

/* Add the force of the barrier to the corners of a tetrahedron. As in the law, it is the force that holds the element.
 * @param shear volume times mu [N m] */
PLIANT_INLINE void pliant_barrier_add_tet_force(const double f[9], double shear, const double gradients[12],
                                                double out[12])
{
    double cofactor[9];
    pliant_barrier_cofactor(f, cofactor);
    const double factor = shear * pliant_barrier_at(pliant_dot3(f, cofactor)).slope;
    PLIANT_UNROLL
    for (int v = 0; v < 4; v++)
        PLIANT_UNROLL
        for (int d = 0; d < 3; d++) out[3 * v + d] += factor * pliant_dot3(cofactor + 3 * d, gradients + 3 * v);
}

/* ---- macro-elements on 8 corners, numbered by the bits of their position, or on 4 */

enum { PLIANT_BARRIER_TETS = 5 }; /* tetrahedra of a hexahedron at one of its corners; the last is a middle one */

/* Return corner k of a tetrahedron at a corner of the element. Its corner 0 is this corner. */
PLIANT_INLINE int pliant_barrier_corner(int corners, int corner, int tet, int k)
{
    if (corners == 4) return (corner + k) % 4;
    if (k == 0) return corner;
    const int across = 1 << (k - 1);
    if (tet == 0) return corner ^ across;
    if (tet == 4) return corner ^ 7 ^ across;
    return corner ^ 1 << (tet - 1) ^ (k == tet ? 0 : across);
}

/* Return its fraction of the element's volume. */
PLIANT_INLINE double pliant_barrier_fraction(int corners, int tet)
{
    return corners == 4 ? 1 : tet == 4 ? 1.0 / 6 : 1.0 / 12;
}

/* Return the number of different tetrahedra of an element. The tetrahedron `n` is at corner n % 8. */
PLIANT_INLINE int pliant_barrier_count(int corners) { return corners == 8 ? 10 : corners == 4; }
PLIANT_INLINE int pliant_barrier_tet(int n) { return n < 8 ? 0 : 4; }

/* Return J of a tetrahedron and its gradient with respect to corner `of`. If the tetrahedron is flat at rest or has a
 * node at two corners, J = 1.
 * @param x, rest (4 x 3) corners [m] */
PLIANT_INLINE double pliant_barrier_ratio(double x[4][3], double rest[4][3], int of, double gradient[3])
{
    const double flat = 1e-3;
    const int a = (of + 1) % 4, b = (of + 2) % 4, c = (of + 3) % 4;
    double e[3][3], r[3][3], normal[3], whole[3];
    pliant_subtract3(x[b], x[a], e[0]);
    pliant_subtract3(x[c], x[a], e[1]);
    pliant_subtract3(x[of], x[a], e[2]);
    pliant_subtract3(rest[b], rest[a], r[0]);
    pliant_subtract3(rest[c], rest[a], r[1]);
    pliant_subtract3(rest[of], rest[a], r[2]);
    pliant_cross3(e[0], e[1], normal);
    pliant_cross3(r[0], r[1], whole);
    const double volume = pliant_dot3(whole, r[2]);
    const bool is_flat = fabs(volume) <= flat * pliant_length3(r[0]) * pliant_length3(r[1]) * pliant_length3(r[2]);
    for (int d = 0; d < 3; d++) gradient[d] = is_flat ? 0 : normal[d] / volume;
    return is_flat ? 1 : pliant_dot3(normal, e[2]) / volume;
}

/* Return the same for a tetrahedron of an element, with respect to its corner 0. node: of the corners */
PLIANT_INLINE double pliant_barrier_ratio_at(int corners, const int32_t *node, int corner, int tet, const double *x,
                                             const double *rest, double gradient[3])
{
    double at[4][3], rest_at[4][3];
    for (int k = 0; k < 4; k++)
        for (int d = 0; d < 3; d++) {
            const int64_t i = 3 * (int64_t)node[pliant_barrier_corner(corners, corner, tet, k)] + d;
            at[k][d] = x[i];
            rest_at[k][d] = rest[i];
        }
    return pliant_barrier_ratio(at, rest_at, 0, gradient);
}

/* Add the force of the barrier at one corner of an element. shear: as above */
PLIANT_INLINE void pliant_barrier_add_force(int corners, const int32_t *node, int corner, double shear,
                                            const double *x, const double *rest, double out[3])
{
    for (int tet = 0; tet < (corners == 8 ? PLIANT_BARRIER_TETS : 1); tet++) {
        double gradient[3];
        const double ratio = pliant_barrier_ratio_at(corners, node, corner, tet, x, rest, gradient);
        const double factor = shear * pliant_barrier_fraction(corners, tet) * pliant_barrier_at(ratio).slope;
        for (int d = 0; d < 3; d++) out[d] += factor * gradient[d];
    }
}

#endif
