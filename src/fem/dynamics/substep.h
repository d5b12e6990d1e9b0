/* Arithmetic of a sub-step of explicit dynamics that the CPU and kernels share: what damps relaxation, what tools and walls do. */
#ifndef PLIANT_FEM_DYNAMICS_SUBSTEP_H
#define PLIANT_FEM_DYNAMICS_SUBSTEP_H

#include "base/inline.h"
#include "state/data.h"

#include <math.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The tissue stays where normal . x >= offset. */
typedef struct pliant_wall { double normal[3], offset; } pliant_wall;
enum { PLIANT_MAX_WALLS = 7 };

/* ---- sums over the nodes */

/* The residual over the load, from sums of squares; without a load over the smallest one. */
PLIANT_INLINE double pliant_substep_relative(double smallest_load, double residual, double load)
{
    const double noise = 1e-8; /* of a tool that holds without pulling */
    load = load > 0 ? fmax(load, noise * smallest_load) : smallest_load;
    return load > 0 ? sqrt(residual / load) : 0;
}

/* Dynamic relaxation, d+ = (a + (1 - f) d) / (1 + f). The lowest frequency that still takes part, by Rayleigh's quotient of the last increments,
 * is damped critically (Underwood 1983); over some of them, so that what rounding does to the forces, of either sign, falls out. Where stiff and soft
 * motions are far apart, what is left of the stiff ones hides the soft ones from it. f is no more, therefore, than 3 / (2 k + 1), k sub-steps after the
 * last start: Nesterov's accelerated descent, which needs to know no frequency and starts anew where increments begin to shrink (Su, Boyd and Candes,
 * A differential equation for modeling Nesterov's accelerated gradient method, JMLR 17, 2016: speed restarting).
 *  @param pace  sums of stiffness and inertia, k, the last increments' inertia */
PLIANT_INLINE double pliant_substep_frequency(double pace[4], double stiffness, double inertia)
{
    const double forget = 0.95, most = 1.8 /* of the critical 2 */, shortest = 10;
    pace[0] = forget * pace[0] + stiffness;
    pace[1] = forget * pace[1] + inertia;
    const double square = pace[1] > 0 ? pace[0] / pace[1] : 0, seen = sqrt(fmin(fmax(square, 0.0), most * most));
    pace[2] = pace[2] >= shortest && inertia < pace[3] ? 1 : pace[2] + 1;
    pace[3] = inertia;
    return fmin(seen, 3 / (2 * pace[2] + 1));
}

/* ---- error of time integration */

/* What central differences are off by at a node at the end of a frame T, from the last two accelerations and the increment between them. With the jerk
 * j = |a+ - a| / h each step of h leaves h^3 j / 6 (Zienkiewicz and Xie, Earthquake Eng. Struct. Dyn. 20:871, 1991), and steps of a frame that is short
 * against the swing add up to h^2 T j / 6; of a longer one only the shift of its frequency w is left, w^3 h^2 / 24 (Hughes, The Finite Element Method, 9.3),
 * which is h^2 T j / 24. Between them goes (w T)^2, with w^2 = j / |v|.
 *  @param change     |a+ - a| [m/s^2]
 *  @param increment  of the step between [m]
 *  @return [m] */
PLIANT_INLINE double pliant_substep_error(double frame, double step, double change, double increment)
{
    if (!(change > 0)) return 0;
    return step * frame * change / 24 * (1 + 3 * increment / (increment + change * frame * frame));
}

/* Whether a node is on a wall, where accelerations jump: it is left out of the error, as are those that tools hold. */
PLIANT_INLINE bool pliant_substep_touches(const pliant_wall *walls, int num_walls, const double rest[3], const double u[3])
{
    const double rounding = 1e-12; /* [m] */
    for (int w = 0; w < num_walls; w++) {
        double height = -walls[w].offset;
        for (int k = 0; k < 3; k++) height += walls[w].normal[k] * (rest[k] + u[k]);
        if (height <= rounding) return true;
    }
    return false;
}

/* ---- tools */

/* One of so many parts of the way to the tip, or as much of it as elements can follow. */
PLIANT_INLINE void pliant_substep_approach(double target[3], const double goal[3], int32_t parts, double longest)
{
    double apart[3], length = 0;
    for (int k = 0; k < 3; k++) {
        apart[k] = goal[k] - target[k];
        length += apart[k] * apart[k];
    }
    length = sqrt(length) / parts;
    const double part = (length > longest ? longest / length : 1) / parts;
    for (int k = 0; k < 3; k++) target[k] += part * apart[k];
}

/* A spring of compliance c pulls with  c l = target - y+  at where the point will be, y+ = y + sum of the answers: stable for any stiffness. A
 * damper b beside it over a step h is a stiffer spring towards another target, as in the corotational solver; so is a mass m at the point, whose
 * central difference m (y+ - 2 y + y-) / h^2 is one of stiffness m / h^2 towards 2 y - y-. Without any of them the hold is rigid.
 *  @param damper   b / h [N/m]; inertia: m / h^2 [N/m]
 *  @param old      the target before this sub-step
 *  @param now      the held point; before: where it was before this sub-step
 *  @param ahead    2 y - y- of the mass
 *  @param pushed   forces on the mass or the spring's end [N]
 *  @param gap      out: target - y
 *  @return c [m/N] */
PLIANT_INLINE double pliant_substep_gap(double stiffness, double damper, double inertia, const double target[3], const double old[3], const double now[3],
                                        const double before[3], const double ahead[3], const double pushed[3], double gap[3])
{
    const double whole = stiffness + damper + inertia;
    for (int k = 0; k < 3; k++) {
        const double towards = stiffness * target[k] + damper * (target[k] - old[k] + before[k]) + inertia * ahead[k] + pushed[k];
        gap[k] = (whole > 0 ? towards / whole : target[k]) - now[k];
    }
    return whole > 0 ? 1 / whole : 0;
}

/* Forces of a sub-step h are those at its start; a spring's from its gap, target - y, at the end are early by h: an error of first order. A mean of the
 * gaps at end, start and the start before has none, and gives no energy whatever the stiffness (Newmark's average acceleration); but what is stiffer than
 * h can follow would swing to and fro undamped. There the end counts for more, up to all, where the spring is rigid:
 *     force = k (p m+ + (1 - p) m) + b (m+ - m) / h,   m+ = p gap+ + (1 - p) gap,   m = p gap + (1 - p) gap-,   1/2 <= p <= 1
 * What of it is known goes to pushed; stiffness and damper (b / h) keep what gap+ takes, for pliant_substep_gap.
 *  @param answer  of the held point to a force in this sub-step [m/N]
 *  @param since   h over that of the sub-step before
 *  @param gap     at the start of this sub-step; older: of the one before [m] */
PLIANT_INLINE void pliant_substep_center(double answer, double since, const double gap[3], const double older[3], double *stiffness, double *damper,
                                         double pushed[3])
{
    const double limit = 4; /* of (w h)^2, that of central differences */
    const double p = 1 - 0.5 * limit / (limit + answer * (*stiffness + *damper));
    for (int k = 0; k < 3; k++) {
        const double change = since * (gap[k] - older[k]);
        pushed[k] += (1 - p) * (*stiffness * ((1 + p) * gap[k] - (1 - p) * change) + *damper * change);
    }
    *stiffness *= p * p;
    *damper *= p;
}

/* Solve for the tools' forces by Cholesky, in place, from the lower triangle; a tool that cannot move anything (all it holds is fixed)
 * gets none. */
PLIANT_INLINE void pliant_substep_forces(int count, double (*matrix)[PLIANT_MAX_TOOLS], double (*force)[3])
{
    double largest = 0;
    for (int i = 0; i < count; i++) largest = fmax(largest, matrix[i][i]);
    for (int i = 0; i < count; i++) {
        for (int j = 0; j <= i; j++) {
            double sum = matrix[i][j];
            for (int k = 0; k < j; k++) sum -= matrix[i][k] * matrix[j][k];
            if (j < i) matrix[i][j] = matrix[j][j] > 0 ? sum / matrix[j][j] : 0;
            else matrix[i][i] = sum > 1e-12 * largest ? sqrt(sum) : 0;
        }
    }
    for (int d = 0; d < 3; d++) {
        for (int i = 0; i < count; i++) {
            for (int k = 0; k < i; k++) force[i][d] -= matrix[i][k] * force[k][d];
            force[i][d] = matrix[i][i] > 0 ? force[i][d] / matrix[i][i] : 0;
        }
        for (int i = count - 1; i >= 0; i--) {
            for (int k = i + 1; k < count; k++) force[i][d] -= matrix[k][i] * force[k][d];
            force[i][d] = matrix[i][i] > 0 ? force[i][d] / matrix[i][i] : 0;
        }
    }
}

/* ---- contact */

/* A point that a sub-step has led into what it touches is put back on it, and its way along it is cut short by friction, as far as the pressure of now
 * allows (Coulomb). As much as it was going in is taken from its speed, and along the surface no more than all of it; the rest moves it without
 * any, so that no contact ever adds to what swings.
 *  @param gap    along the normal, from where it may be [m]
 *  @param moved  increment of now, against the obstacle's [m]
 *  @param slip   across the normal, from where it sticks; out: what is left of it, once it slides [m]
 *  @param push   out: to be added to place and increment [m]; shift: to the place alone
 *  @return false: it does not touch */
PLIANT_INLINE bool pliant_substep_press(const double normal[3], double friction, double gap, const double moved[3], double slip[3], double push[3],
                                        double shift[3])
{
    double into = 0, speed = 0, left = 0, along[3];
    if (gap >= 0) return false;
    for (int k = 0; k < 3; k++) into -= normal[k] * moved[k];
    const double stop = fmin(fmax(into, 0.0), -gap), most = friction * stop;
    for (int k = 0; k < 3; k++) {
        along[k] = moved[k] + into * normal[k];
        speed += along[k] * along[k];
    }
    speed = sqrt(speed);
    const double kept = speed > most ? most / speed : 1;
    for (int k = 0; k < 3; k++) {
        push[k] = stop * normal[k] - kept * along[k];
        slip[k] -= kept * along[k];
        left += slip[k] * slip[k];
    }
    left = sqrt(left);
    const double room = fmax(most - kept * speed, 0.0), back = left > room ? room / left : 1;
    for (int k = 0; k < 3; k++) {
        shift[k] = (-gap - stop) * normal[k] - back * slip[k];
        slip[k] -= back * slip[k];
    }
    return true;
}

/* ---- walls and limits */

/* A node behind a wall is put back on it; its way along the wall is cut short by friction, in proportion to how far it was pushed
 * (Coulomb), and its normal speed is turned around in part. factor: A over the inverse mass [s^2] */
PLIANT_INLINE void pliant_substep_collide(const pliant_wall *walls, int num_walls, double friction, double restitution,
                                          const double rest[3], double factor, double u[3], double d[3], double acceleration[3])
{
    for (int w = 0; w < num_walls; w++) {
        const pliant_wall *wall = walls + w;
        double depth = wall->offset, normal = 0, slide = 0, along[3];
        for (int k = 0; k < 3; k++) {
            depth -= wall->normal[k] * (rest[k] + u[k]);
            normal += wall->normal[k] * d[k];
        }
        if (depth <= 0) continue;
        for (int k = 0; k < 3; k++) {
            along[k] = d[k] - normal * wall->normal[k];
            slide += along[k] * along[k];
        }
        slide = sqrt(slide);
        const double kept = slide > 0 ? fmax(0.0, 1 - friction * depth / slide) : 0;
        const double back = normal < 0 ? -restitution * normal : normal;
        for (int k = 0; k < 3; k++) {
            const double moved = depth * wall->normal[k] - (1 - kept) * along[k];
            u[k] += moved;
            acceleration[k] += moved / factor;
            d[k] = kept * along[k] + back * wall->normal[k];
        }
    }
}

/* Dynamic relaxation: a pseudo-time has no speed that must be kept, so that an increment is cut to what is sound; limit: squared. */
PLIANT_INLINE void pliant_substep_shorten(double limit, double square, double u[3], double d[3])
{
    const double part = sqrt(limit / square);
    for (int k = 0; k < 3; k++) {
        u[k] -= (1 - part) * d[k];
        d[k] *= part;
    }
}

#ifdef __cplusplus
}
#endif

#endif
