/* Correction of a coarse element's condensed stiffness to the exact stiffness for homogeneous material.
 *
 * Any symmetric positive semidefinite 12 x 12 matrix whose null space is the rigid motions has the form V B' C B. B (6
 * x 12) maps displacements to strain in Mandel notation, and C is the equivalent material:  C = B+' K B+ / V,  B+ = B'
 * (B B')^-1. Condensing a submesh of E = 1 on four corners gives C_h, which is softer than the true material C_true
 * (NUMERICS.md). C_true is isotropic: lambda i i' + 2 mu I. The symmetric S with S C_h S = C_true is their geometric
 * mean,
 *     S = C_h^(-1/2) (C_h^(1/2) C_true C_h^(1/2))^(1/2) C_h^(-1/2).
 * It corrects the effect of point loads in  K' = V B' (S C S) B. The result is exact for homogeneous material of any
 * modulus, since C is then E C_h. It is positive semidefinite if K is.
 *
 * For a cube, an orthonormal basis Q of the 18 modes that are no rigid motions replaces B: C = Q'K Q, with C_true of
 * the hexahedron. */
#ifndef PLIANT_FEM_COARSE_CALIBRATE_H
#define PLIANT_FEM_COARSE_CALIBRATE_H

#include "pliant/material.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Calibrate the stiffness of a coarse tetrahedron.
 * @param gradients     (4 x 3) [1/m].
 * @param volume        Volume of the coarse tetrahedron [m^3].
 * @param condensed     (12 x 12) condensed stiffness of the submesh.
 * @param of_reference  (12 x 12) condensed stiffness of the submesh with the reference material.
 * @return False if of_reference has null modes that are not rigid motions. */
bool pliant_calibrate(const double gradients[12], double volume, const pliant_tet_material *reference,
                      const double condensed[144], const double of_reference[144], double out[144]);
/* Calibrate the stiffness of a coarse hexahedron, as above. truth: hexahedron of the reference material. All matrices
 * are 24 x 24. */
bool pliant_calibrate_cube(const double truth[576], const double condensed[576], const double of_reference[576],
                           double out[576]);

#ifdef __cplusplus
}
#endif

#endif
