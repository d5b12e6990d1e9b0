/* Stiffness of a hexahedron in explicit dynamics against hourglass modes (tled_cubes.h), shared by CPU and kernels. It
 * resists the linear part of the strain in bending and torsion, which the mean gradient does not contain.
 *
 * With f_a = dx/dX_a of the mean gradient and w_k the mode +-+- without axis k, y_ka = f_a . w_k is independent of
 * rotations. By Green's strain
 *     e_aa = s_b y_ka / 4 h_a   and   e_kk = s_b y_ak / 4 h_k
 *     gamma_ak = s_b (y_kk / 4 h_a + y_aa / 4 h_k)
 * where a, b, k are all axes, and s_b runs from -1 to 1 along b.
 *
 * Incompatible modes (Simo and Rifai, Int. J. Numer. Meth. Engng 29:1595, 1990; with one integration point, Belytschko
 * and Bindeman, Comput. Meth. Appl. Mech. Engng 105:225, 1993) remove the shear energy of bending, and the stress along
 * b:
 *     W = V/3 sum over b of  mu (e_aa^2 + e_kk^2) + c mu (e_aa + e_kk)^2 + 1/2 t mu gamma_ak^2
 *     c = lambda / (lambda + 2 mu),   t = 1
 *
 * The implementation uses three fourths of this c (NUMERICS.md). Its t matches the torsion of a square bar one cube
 * thin, 0.1406 instead of 1/6 h^4 (Timoshenko and Goodier, Theory of Elasticity, 109). The isotropic part of W depends
 * on |w_k|^2 alone, so that a flattened cube keeps this stiffness. */
#ifndef PLIANT_FEM_DYNAMICS_CUBE_BENDING_H
#define PLIANT_FEM_DYNAMICS_CUBE_BENDING_H

#include "base/inline.h"

/* Values of a smallest cell. Fully relaxed Prony shares are subtracted. */
typedef struct pliant_cube_bending {
    float direction[9]; /* unit vectors along the axes */
    float edge[3];      /* 1 / h_a [1/m] */
    float bending;      /* 8/3 / 64 */
    float torsion;      /* t 4/3 / 64 */
    float minimum;      /* factor of |w_k|^2 / 2, divided by V mu [1/m^2] */
    float twist;        /* factor of |w|^2 / 2 of the mode xyz [1/m^2] */
} pliant_cube_bending;

/* Compute q = d/dy of (W - minimum sum |w_k|^2 / 2) / (V mu). y and q: index 3 k + a, y = f_a . w_k. contraction: c. */
#define PLIANT_DEFINE_CUBE_BENDING(real, name) \
    PLIANT_INLINE void name(const pliant_cube_bending *cube, real contraction, const real y[9], real q[9]) \
    { \
        for (int m = 0; m < 9; m++) q[m] = -(real)cube->minimum * y[m]; \
        PLIANT_UNROLL for (int b = 0; b < 3; b++) \
        { \
            const int a = (b + 1) % 3, k = (b + 2) % 3; \
            const real by_a = (real)cube->edge[a], by_k = (real)cube->edge[k]; \
            const real first = by_a * y[3 * k + a], second = by_k * y[3 * a + k], \
                       both = contraction * (first + second); \
            const real twisted = (real)cube->torsion * (by_a * y[4 * k] + by_k * y[4 * a]); \
            q[3 * k + a] += (real)cube->bending * by_a * (first + both); \
            q[3 * a + k] += (real)cube->bending * by_k * (second + both); \
            q[4 * k] += by_a * twisted; \
            q[4 * a] += by_k * twisted; \
        } \
    }
PLIANT_DEFINE_CUBE_BENDING(double, pliant_cube_bending_double)
PLIANT_DEFINE_CUBE_BENDING(float, pliant_cube_bending_float)


/* The modes of a cube, or forces on them: `along` holds w_k along axis k, `across` holds w_k of the mode of the two
 * other axes. Index 3 k + r. */
typedef struct pliant_cube_modes { float along[9], across[9]; } pliant_cube_modes;

/* Compute d/dw of W, times V mu.
 * @param finer   1 divided by the cube's edge in smallest cells.
 * @param shear   V mu finer^2.
 * @param change  Nullable: change of w in the last sub-step.
 * @param damped  Factor of the change in the damping. */
PLIANT_INLINE void pliant_cube_bend(const pliant_cube_bending *cube, float finer, float shear, float contraction,
                                    const pliant_cube_modes *w, const pliant_cube_modes *change, float damped,
                                    pliant_cube_modes *out)
{
    float y[9], q[9], f[9];
    for (int m = 0; m < 9; m++) f[m] = cube->direction[m] + 0.25f * cube->edge[m / 3] * finer * w->along[m];
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++) {
            const float *at = w->across + 3 * k;
            y[3 * k + a] = f[3 * a] * at[0] + f[3 * a + 1] * at[1] + f[3 * a + 2] * at[2];
        }
    for (int k = 0; change && k < 3; k++)
        for (int a = 0; a < 3; a++)
            for (int r = 0; r < 3; r++) {
                const float turned = 0.25f * cube->edge[a] * finer * change->along[3 * a + r],
                            moved = change->across[3 * k + r];
                y[3 * k + a] += damped * (f[3 * a + r] * moved + turned * (w->across[3 * k + r] - moved));
            }
    pliant_cube_bending_float(cube, contraction, y, q);
    for (int k = 0; k < 3; k++)
        for (int r = 0; r < 3; r++) {
            const float kept = w->across[3 * k + r] + (change ? damped * change->across[3 * k + r] : 0);
            out->across[3 * k + r] =
                shear * (cube->minimum * kept + q[3 * k] * f[r] + q[3 * k + 1] * f[3 + r] + q[3 * k + 2] * f[6 + r]);
            out->along[3 * k + r] = shear * (0.25f * cube->edge[k] * finer) *
                                    (q[k] * w->across[r] + q[3 + k] * w->across[3 + r] + q[6 + k] * w->across[6 + r]);
        }
}

#endif
