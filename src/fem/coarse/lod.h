/* Localized orthogonal decomposition with correctors a cube (NUMERICS.md), what is computed beforehand.
 *
 * P: linear interpolation of the coarse nodes. For each coarse cube C and the 24 columns of its nodes, the corrector
 *     Q_C = argmin  a(Q, Q) / 2 - a_C(P, Q)
 * over fields that are zero on fixed fine nodes and outside of the cubes within k of C, and whose weighted means sum_i
 * m_i lambda_j(x_i) Q_i vanish for every free coarse node j (m_i: mass of the fine node, so that gravity does no work
 * on them). Then N = P - sum of Q_C, and a cube's macro-element is K = (N|_C)' K_C (N|_C) on the nodes of the cubes
 * within k.
 *
 * Of hexahedra, a takes lambda for at most 6 mu, as at a Poisson's ratio of 0.43. What is above that, kappa', resists
 * the change of volume of a coarse cube as one, weighed by itself: (sum of V kappa' div N)^2 / sum of V kappa' (mean
 * dilatation, as in element/hexahedra.c), in correctors as in macro-elements. With all of it in the fine cubes,
 * correctors of tissue that hardly changes its volume would have to reach far.
 *
 * A cube with a fixed fine node that leans on a free coarse one is grounded: its P is zero on fixed nodes, so that N
 * is, and it keeps R = I (NUMERICS.md). Other cubes feel its corrector by how far its nodes have moved from rest. */
#ifndef PLIANT_FEM_COARSE_LOD_H
#define PLIANT_FEM_COARSE_LOD_H

#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

/* system->upsample (P; of hexahedra trilinear), and system->grounded by the tetrahedra of the coarse mesh. Errors:
 * MEMORY. */
pliant_status pliant_lod_ground(pliant_system *system, bool hexahedra, const uint8_t *fine_fixed, const uint8_t *coarse_fixed,
                                const int32_t *coarse_of_fine);
/* After that: system->macros. Errors: SCENE (beyond the scene's limits), MEMORY, NUMERIC, CANCELLED. */
pliant_status pliant_lod(pliant_system *system, const pliant_scene *scene, const uint8_t *fine_fixed, const uint8_t *coarse_fixed,
                         const pliant_tet_material *material, pliant_progress progress);

#ifdef __cplusplus
}
#endif

#endif
