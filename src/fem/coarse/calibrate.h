/* A coarse element's condensed stiffness, brought to what homogeneous material must give.
 *
 * Any symmetric positive semidefinite 12 x 12 whose null space are the rigid motions is V B' C B, with B (6 x 12) from
 * displacements to strain in Mandel notation and C the material that it stands for:  C = B+' K B+ / V,  B+ = B' (B
 * B')^-1. Condensing a submesh of E = 1 on four corners gives C_h, softer than the C_true that it is made of
 * (NUMERICS.md), isotropic: lambda i i' + 2 mu I. The symmetric S with S C_h S = C_true, their geometric mean,
 *     S = C_h^(-1/2) (C_h^(1/2) C_true C_h^(1/2))^(1/2) C_h^(-1/2),
 * corrects what point loads do, and  K' = V B' (S C S) B.  It is exact for homogeneous material of any modulus, since C
 * is then E C_h; and positive semidefinite with K.
 *
 * Of a cube the same in an orthonormal basis Q of what is no rigid motion, of 18 modes: C = Q'K Q, C_true that of the
 * hexahedron. */
#ifndef PLIANT_FEM_COARSE_CALIBRATE_H
#define PLIANT_FEM_COARSE_CALIBRATE_H

#include "pliant/material.h"

#ifdef __cplusplus
extern "C" {
#endif

/* gradients (4 x 3) [1/m] and volume of the coarse tetrahedron; condensed: of its submesh, of_reference: of the same
 * submesh made of the reference; all 12 x 12. False: of_reference has other null modes than the rigid ones. */
bool pliant_calibrate(const double gradients[12], double volume, const pliant_tet_material *reference, const double condensed[144],
                      const double of_reference[144], double out[144]);
/* truth: of a coarse hexahedron of the reference; all 24 x 24. False likewise. */
bool pliant_calibrate_cube(const double truth[576], const double condensed[576], const double of_reference[576], double out[576]);

#ifdef __cplusplus
}
#endif

#endif
