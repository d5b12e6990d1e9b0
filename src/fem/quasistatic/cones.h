/* Contact with friction at some points at once: forces f in cones, |f_t| <= mu f_n, and motions v = v0 + A (f - f0) that they lead to with
 *     v_n >= 0,  f_n >= 0,  v_n f_n = 0,     v_t = 0 in the cone,  v_t against f_t on its boundary
 * by projected Gauss-Seidel (nonsmooth contact dynamics: Jean, Comput. Methods Appl. Mech. Engrg. 177:235, 1999, without time: motions in
 * place of speeds). Three rows a point: normal, and two tangents. */
#ifndef PLIANT_FEM_QUASISTATIC_CONES_H
#define PLIANT_FEM_QUASISTATIC_CONES_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_CONE_HISTORY = 8, PLIANT_CONE_ROOM = 5 + 3 * PLIANT_CONE_HISTORY };
enum { PLIANT_CONE_TOGETHER = 192 /* rows of all that touch, at most, for Newton's method */, PLIANT_CONE_EQUATIONS = PLIANT_CONE_TOGETHER * (PLIANT_CONE_TOGETHER + 1) };
#define PLIANT_CONE_HELD (-1.0) /* in place of mu: any force, v = 0 */

/* After two sweeps a step of Newton's method takes all points at once: where none begins or ceases to slide, they are done. As long as sweeps after it change
 * more than those before, it waits, and Anderson's method (anderson.h) mixes the sweeps: a block between two jaws takes 200 and does not get there without it.
 * matrix: A, symmetric positive definite, (3 count x 3 count); friction (count): mu; motion, force (3 count): v0, f0 in, v, f out;
 * room: (PLIANT_CONE_ROOM x 3 count + PLIANT_CONE_EQUATIONS). Returns the sweeps that it took. */
int32_t pliant_cones_solve(int32_t count, const double *matrix, const double *friction, double *motion, double *force, double *room);

#ifdef __cplusplus
}
#endif
#endif
