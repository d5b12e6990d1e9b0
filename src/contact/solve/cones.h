/* Contact with friction at some points at once: forces f in cones, |f_t| <= mu f_n, and motions v = v0 + A (f - f0) that they lead to with
 *     v_n >= 0,  f_n >= 0,  v_n f_n = 0,     v_t = 0 in the cone,  v_t against f_t on its boundary
 * (nonsmooth contact dynamics: Jean, Comput. Methods Appl. Mech. Engrg. 177:235, 1999, without time: motions in place of speeds). Three rows a
 * point: normal, and two tangents. */
#ifndef PLIANT_FEM_QUASISTATIC_CONES_H
#define PLIANT_FEM_QUASISTATIC_CONES_H

#include "contact/solve/cone_rules.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_CONE_HISTORY = 8, PLIANT_CONE_ROOM = 10 + 3 * PLIANT_CONE_HISTORY };

/* By cone_rules.h. More points than Newton's method takes are swept, and Anderson's method (anderson.h) mixes the sweeps: a block between two jaws takes 200
 * and does not get there without it.
 * matrix: A, symmetric positive definite, (3 count x 3 count); friction (count): mu; motion, force (3 count): v0, f0 in, v, f out;
 * room: (PLIANT_CONE_ROOM x 3 count + PLIANT_CONE_EQUATIONS). Returns the steps and sweeps that it took. */
int32_t pliant_cones_solve(int32_t count, const double *matrix, const double *friction, double *motion, double *force, double *room);

#ifdef __cplusplus
}
#endif
#endif
