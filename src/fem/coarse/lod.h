/* Localized orthogonal decomposition with one corrector per cube (NUMERICS.md): the precomputation.
 *
 * P is the linear interpolation of the coarse nodes. For each coarse cube C and the 24 columns of its nodes, the
 * corrector is
 *     Q_C = argmin  a(Q, Q) / 2 - a_C(P, Q)
 * over fields that are zero on fixed fine nodes and outside of the cubes within k of C. Their weighted means sum_i m_i
 * lambda_j(x_i) Q_i vanish for every free coarse node j. The weight m_i is the mass of the fine node, so that gravity
 * does no work on the correctors. Then N = P - sum of Q_C. The macro-element of a cube is K = (N|_C)' K_C (N|_C) on the
 * nodes of the cubes within k.
 *
 * For hexahedra, a limits lambda to 6 mu, the value at a Poisson's ratio of 0.43. The excess kappa' resists the mean
 * change of volume of a whole coarse cube, weighted by itself: (sum of V kappa' div N)^2 / sum of V kappa'. This is
 * mean dilatation, as in element/hexahedra.c. It applies to correctors and macro-elements. Without it, correctors of
 * nearly incompressible tissue would need many layers of cubes.
 *
 * A cube is grounded if it has a fixed fine node whose interpolation includes a free coarse node. Its P is zero on
 * fixed nodes, so N is zero there, and it keeps R = I (NUMERICS.md). In other cubes, the corrector of a grounded cube
 * acts on the displacements of its nodes from rest. */
#ifndef PLIANT_FEM_COARSE_LOD_H
#define PLIANT_FEM_COARSE_LOD_H

#include "fem/system.h"

/* Build system->upsample (P; trilinear for hexahedra) and system->grounded from the coarse tetrahedra. Errors:
 * MEMORY. */
pliant_status pliant_lod_build_upsample(pliant_system *system, bool hexahedra, const uint8_t *fine_fixed,
                                        const uint8_t *coarse_fixed, const int32_t *coarse_of_fine);
/* Build system->macros after pliant_lod_build_upsample. Errors: SCENE (scene limits exceeded), MEMORY, NUMERIC,
 * CANCELLED. */
pliant_status pliant_lod_build_macros(pliant_system *system, const pliant_scene *scene, const uint8_t *fine_fixed,
                                      const uint8_t *coarse_fixed, const pliant_tet_material *material,
                                      pliant_progress progress);

#endif
