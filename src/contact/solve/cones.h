/* Solver for contact points with friction. Forces f lie in Coulomb cones, |f_t| <= mu f_n. They cause the motions v
 * = v0 + A (f - f0). The conditions are
 *     v_n >= 0,  f_n >= 0,  v_n f_n = 0,     v_t = 0 in the cone,  v_t against f_t on its boundary.
 * This is nonsmooth contact dynamics (Jean, Comput. Methods Appl. Mech. Engrg. 177:235, 1999) with motions instead
 * of velocities. Each point has three rows: the normal and two tangents. */
#ifndef PLIANT_FEM_QUASISTATIC_CONES_H
#define PLIANT_FEM_QUASISTATIC_CONES_H

#include "contact/solve/cone_rules.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_CONE_HISTORY = 8, PLIANT_CONE_BUFFER = 11 + 3 * PLIANT_CONE_HISTORY };

/* Solve by cone_rules.h. If there are more points than Newton's method allows, use sweeps of projected Gauss-Seidel
 * with Anderson acceleration (anderson.h).
 * @param matrix (3 count x 3 count): A, symmetric positive definite
 * @param friction (count): mu, or PLIANT_CONE_FIXED
 * @param motion, force (3 count): in: v0 and f0; out: v and f
 * @param resistance regularization, in and out: PLIANT_CONE_WEAK_RESISTANCE at first
 * @param buffer (PLIANT_CONE_BUFFER x 3 count + pliant_cone_numbers(3 count)): work array
 * @return number of steps and sweeps */
int32_t pliant_cones_solve(int32_t count, const double *matrix, const double *friction, double *motion, double *force,
                           double *resistance, double *buffer);

#ifdef __cplusplus
}
#endif
#endif
