/* Arithmetic of a sub-step of explicit dynamics, shared by CPU and kernels: damping of relaxation, tools, contact and
 * walls. */
#ifndef PLIANT_FEM_DYNAMICS_SUBSTEP_H
#define PLIANT_FEM_DYNAMICS_SUBSTEP_H

#include "base/inline.h"
#include "model_data/data.h"

#include <math.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Half-space of the tissue: normal . x >= offset. */
typedef struct pliant_wall { double normal[3], offset; } pliant_wall;
enum { PLIANT_MAX_WALLS = 7 };

/* ---- Sums over the nodes. */

/* Return the ratio of residual to load, from sums of squares. Without a load, the smallest load replaces it. */
PLIANT_INLINE double pliant_substep_relative(double smallest_load, double residual, double load)
{
    const double noise = 1e-8; /* noise of a tool that holds without pulling */
    load = load > 0 ? fmax(load, noise * smallest_load) : smallest_load;
    return load > 0 ? sqrt(residual / load) : 0;
}

/* Return the damping f of dynamic relaxation, d+ = (a + (1 - f) d) / (1 + f).
 *
 * Critical damping of the lowest active frequency follows from Rayleigh's quotient of the last increments (Underwood
 * 1983). Averaging over several increments removes rounding errors of the forces, which have either sign. If stiff and
 * soft motions differ strongly, the remaining stiff motion hides the soft motion in this quotient. The damping is
 * therefore at most 3 / (2 k + 1), k sub-steps after the last restart. This is Nesterov's accelerated descent, which
 * needs no frequency. It restarts when the increments begin to shrink (Su, Boyd and Candes, A differential equation for
 * modeling Nesterov's accelerated gradient method, JMLR 17, 2016: speed restarting).
 * @param pace  State: sums of stiffness and inertia, k, inertia of the last increment. */
PLIANT_INLINE double pliant_substep_frequency(double pace[4], double stiffness, double inertia)
{
    const double forget = 0.95, maximum = 1.8 /* of the critical 2 */, shortest = 10;
    pace[0] = forget * pace[0] + stiffness;
    pace[1] = forget * pace[1] + inertia;
    const double square = pace[1] > 0 ? pace[0] / pace[1] : 0,
                 frequency = sqrt(fmin(fmax(square, 0.0), maximum * maximum));
    pace[2] = pace[2] >= shortest && inertia < pace[3] ? 1 : pace[2] + 1;
    pace[3] = inertia;
    return fmin(frequency, 3 / (2 * pace[2] + 1));
}

/* ---- Error of time integration. */

/* Return a node's error of central differences at the end of a frame T. It follows from the last two accelerations and
 * the increment between them.
 *
 * With the jerk j = |a+ - a| / h, each step of h has the error h^3 j / 6 (Zienkiewicz and Xie, Earthquake Eng. Struct.
 * Dyn. 20:871, 1991). In a frame shorter than the oscillation period these errors add up to h^2 T j / 6. In a longer
 * frame only the shift of the frequency w remains, w^3 h^2 / 24 (Hughes, The Finite Element Method, 9.3), which gives
 * h^2 T j / 24. The formula blends both cases by (w T)^2, with w^2 = j / |v|.
 * @param change     |a+ - a| [m/s^2].
 * @param increment  Increment of the step between the accelerations [m].
 * @return Error [m]. */
PLIANT_INLINE double pliant_substep_error(double frame, double step, double change, double increment)
{
    if (!(change > 0)) return 0;
    return step * frame * change / 24 * (1 + 3 * increment / (increment + change * frame * frame));
}

/* Return whether a node touches a wall. Accelerations jump there, so such nodes are excluded from the error, as are
 * held nodes. */
PLIANT_INLINE bool pliant_substep_touches(const pliant_wall *walls, int num_walls, const double rest[3],
                                          const double u[3])
{
    const double rounding = 1e-12; /* [m] */
    for (int w = 0; w < num_walls; w++) {
        double height = -walls[w].offset;
        for (int k = 0; k < 3; k++) height += walls[w].normal[k] * (rest[k] + u[k]);
        if (height <= rounding) return true;
    }
    return false;
}

/* ---- Tools. */

/* Move the target towards the goal: by one of `parts` equal parts of the distance, but at most by the length that
 * elements can follow. */
PLIANT_INLINE void pliant_substep_approach(double target[3], const double goal[3], int32_t parts, double longest)
{
    double difference[3], length = 0;
    for (int k = 0; k < 3; k++) {
        difference[k] = goal[k] - target[k];
        length += difference[k] * difference[k];
    }
    length = sqrt(length) / parts;
    const double part = (length > longest ? longest / length : 1) / parts;
    for (int k = 0; k < 3; k++) target[k] += part * difference[k];
}

/* Return the compliance c of a held point, and the gap to its target, for c l = target - y+. Here y+ is the position at
 * the end of the sub-step: y+ = y + sum of the responses. This implicit rule is stable for any stiffness.
 *
 * A damper b parallel to the spring is a stiffer spring towards another target over a step h, as in the corotational
 * solver. A mass m at the point acts in the same way. Its central difference m (y+ - 2 y + y-) / h^2 is a spring of
 * stiffness m / h^2 towards 2 y - y-. Without spring, damper and mass the hold is rigid.
 * @param damper   B / h [N/m].
 * @param inertia  M / h^2 [N/m].
 * @param old      Target before this sub-step.
 * @param now      Position of the held point.
 * @param before   Position before this sub-step.
 * @param ahead    2 y - y- of the mass.
 * @param pushed   Forces on the mass or the spring's end [N].
 * @param gap      Out: target - y.
 * @return C [m/N]. */
PLIANT_INLINE double pliant_substep_gap(double stiffness, double damper, double inertia, const double target[3],
                                        const double old[3], const double now[3], const double before[3],
                                        const double ahead[3], const double pushed[3], double gap[3])
{
    const double whole = stiffness + damper + inertia;
    for (int k = 0; k < 3; k++) {
        const double towards =
            stiffness * target[k] + damper * (target[k] - old[k] + before[k]) + inertia * ahead[k] + pushed[k];
        gap[k] = (whole > 0 ? towards / whole : target[k]) - now[k];
    }
    return whole > 0 ? 1 / whole : 0;
}

/* Average a spring's force over time, so that it has no first-order error and conserves energy.
 *
 * The forces of a sub-step h belong to its start. A spring force from the gap target - y at the end is early by h,
 * which is an error of first order. A mean of the gaps at the end, at the start and at the start before has no such
 * error. It adds no energy for any stiffness (Newmark's average acceleration). Springs that are too stiff for h would
 * oscillate undamped, so the end gets a higher weight p, up to 1 for a rigid spring:
 *     force = k (p m+ + (1 - p) m) + b (m+ - m) / h
 *     m+ = p gap+ + (1 - p) gap,   m = p gap + (1 - p) gap-,   1/2 <= p <= 1
 * The known terms are added to pushed. Stiffness and damper (b / h) are scaled to the factors of gap+, for
 * pliant_substep_gap.
 * @param answer  Response of the held point to a force in this sub-step [m/N].
 * @param since   h divided by the duration of the sub-step before.
 * @param gap     Gap at the start of this sub-step [m].
 * @param older   Gap at the start of the sub-step before [m]. */
PLIANT_INLINE void pliant_substep_center(double answer, double since, const double gap[3], const double older[3],
                                         double *stiffness, double *damper, double pushed[3])
{
    const double limit = 4; /* stability limit of (w h)^2 for central differences */
    const double p = 1 - 0.5 * limit / (limit + answer * (*stiffness + *damper));
    for (int k = 0; k < 3; k++) {
        const double change = since * (gap[k] - older[k]);
        pushed[k] += (1 - p) * (*stiffness * ((1 + p) * gap[k] - (1 - p) * change) + *damper * change);
    }
    *stiffness *= p * p;
    *damper *= p;
}

/* Solve for the tools' forces by Cholesky, overwriting the input, from the lower triangle. A tool gets no force if all
 * its nodes are fixed. */
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

/* ---- Contact. */

/* Dynamic relaxation: move a penetrating point back to the surface, and reduce its tangential motion by Coulomb
 * friction with the present pressure.
 * @param gap    Distance along the normal from the allowed position [m].
 * @param moved  Increment relative to the obstacle [m].
 * @param slip   In: tangential distance from the sticking position; out: the remaining distance after sliding [m].
 * @param push   Out: correction of position and increment [m].
 * @return False if the point does not touch. */
PLIANT_INLINE bool pliant_substep_press(const double normal[3], double friction, double gap, const double moved[3],
                                        double slip[3], double push[3])
{
    double into = 0, speed = 0, left = 0, along[3];
    if (gap >= 0) return false;
    for (int k = 0; k < 3; k++) into -= normal[k] * moved[k];
    const double stop = fmin(fmax(into, 0.0), -gap), maximum = friction * stop;
    for (int k = 0; k < 3; k++) {
        along[k] = moved[k] + into * normal[k];
        speed += along[k] * along[k];
    }
    speed = sqrt(speed);
    const double kept = speed > maximum ? maximum / speed : 1;
    for (int k = 0; k < 3; k++) {
        push[k] = -gap * normal[k] - kept * along[k];
        slip[k] -= kept * along[k];
        left += slip[k] * slip[k];
    }
    left = sqrt(left);
    const double allowed = fmax(maximum - kept * speed, 0.0), back = left > allowed ? allowed / left : 1;
    for (int k = 0; k < 3; k++) {
        push[k] -= back * slip[k];
        slip[k] -= back * slip[k];
    }
    return true;
}

/* ---- Walls and limits. */

/* Move a node behind a wall back to the wall. Coulomb friction reduces its tangential motion in proportion to the
 * penetration depth. Restitution reverses a part of the normal velocity. factor: A divided by the inverse mass
 * [s^2]. */
PLIANT_INLINE void pliant_substep_collide(const pliant_wall *walls, int num_walls, double friction, double restitution,
                                          const double rest[3], double factor, double u[3], double d[3],
                                          double acceleration[3])
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

/* Shorten an increment of dynamic relaxation to a stable length. Pseudo-time has no physical velocity to conserve.
 * limit: squared. */
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
