/* Geometry of conservative advancement: limits, times at which a bound reaches a limit, closest points. */
#ifndef PLIANT_CONTACT_ADVANCE_RULES_H
#define PLIANT_CONTACT_ADVANCE_RULES_H

#include "base/inline.h"
#include "base/vector3.h"
#include "contact/advance/advance.h"

#include <math.h>

/* Tolerance of distances, so that rounding does not block tissue that moves with a part [m] */
#define PLIANT_ADVANCE_SLACK 1e-12

/* Return the floor: the distance below which pairs hardly approach. A first leg may reach advance_stop. A second leg
 * keeps the fraction advance_keep of it. */
PLIANT_INLINE double pliant_advance_min_distance(const pliant_contact_settings *settings, double guard)
{
    return settings->advance_keep * settings->advance_stop * guard;
}

/* Return the smallest distance that a pair may reach in a leg, from its distance at the start. A pair that stays above
 * this limit does not shorten the leg. A distance below the floor may lose the fraction keep, because contact forces
 * are found within a tolerance. Otherwise the tolerance could stop every leg. No larger value falls below the fraction
 * keep of the floor. */
PLIANT_INLINE double pliant_advance_limit(const pliant_contact_settings *settings, double guard, double distance)
{
    const double keep = settings->advance_keep, floor = pliant_advance_min_distance(settings, guard);
    return fmax(fmin(keep * distance, settings->advance_stop * guard),
                fmin(floor, fmax((1 - keep) * distance, fmin(keep * floor, distance - PLIANT_ADVANCE_SLACK))));
}

/* Return whether two parts of the tissue start nearer than any leg leaves them, or coincide at rest: they were created
 * touching. */
PLIANT_INLINE bool pliant_advance_starts_together(const pliant_contact_settings *settings, double thickness,
                                                  double distance)
{
    const double smallest = settings->advance_keep * pliant_advance_min_distance(settings, thickness);
    return !(thickness > 0.0) || distance < 0.5 * smallest;
}

/* Numerical constants of conservative advancement. Stopping early is safe, so they trade time for the last 2 % of the
 * way. Rounding never leads beyond a bound of which 0.999 is taken. */
enum { PLIANT_ADVANCE_ITERATIONS = 64 };
#define PLIANT_ADVANCE_SAFETY 0.999
#define PLIANT_ADVANCE_MIN_PROGRESS 1e-3 /* fraction of the leg that is little progress */
#define PLIANT_ADVANCE_MIN_STEP 1e-7     /* fraction of the leg that is no progress */
#define PLIANT_ADVANCE_NEAR_LIMIT 0.02   /* fraction of the limit: a pair so little beyond it has reached it */

/* Return whether a pair, which has gained a step and is this distance above its limit, cannot gain more. */
PLIANT_INLINE bool pliant_advance_is_finished(int32_t iterations, double step, double distance, double limit)
{
    return iterations >= PLIANT_ADVANCE_ITERATIONS || step < PLIANT_ADVANCE_MIN_STEP ||
           (distance < PLIANT_ADVANCE_NEAR_LIMIT * limit && step < PLIANT_ADVANCE_MIN_PROGRESS);
}

/* Return the largest s for which distance + rate s - bend s^2 / 2 is not negative anywhere in [0, s]; bend >= 0. */
PLIANT_INLINE double pliant_advance_time(double distance, double rate, double bend)
{
    if (distance < 0.0) return 0.0;
    if (bend <= 0.0) return rate >= 0.0 ? (double)INFINITY : distance / -rate;
    const double root = sqrt(rate * rate + 2.0 * bend * distance);
    if (rate >= 0.0) return (rate + root) / bend;
    return 2.0 * distance / (root - rate);
}

/* Compute the closest points of two segments, as fractions of them (Ericson, Real-Time Collision Detection, 2005,
 * 5.1.9). */
PLIANT_INLINE void pliant_advance_closest_on_segments(const double p[2][3], const double q[2][3], double *s, double *t)
{
    double d[3], e[3], r[3];
    for (int i = 0; i < 3; i++) {
        d[i] = p[1][i] - p[0][i];
        e[i] = q[1][i] - q[0][i];
        r[i] = p[0][i] - q[0][i];
    }
    const double a = pliant_dot3(d, d), b = pliant_dot3(d, e), c = pliant_dot3(d, r);
    const double ee = pliant_dot3(e, e), f = pliant_dot3(e, r), area = a * ee - b * b;
    *s = a > 0.0 ? (area > 1e-12 * a * ee ? fmin(fmax((b * f - c * ee) / area, 0.0), 1.0) : 0.5) : 0.0;
    *t = ee > 0.0 ? (b * *s + f) / ee : 0.0;
    if (ee > 0.0 && *t >= 0.0 && *t <= 1.0) return;
    *t = *t > 1.0 ? 1.0 : 0.0;
    *s = a > 0.0 ? fmin(fmax((b * *t - c) / a, 0.0), 1.0) : 0.0;
}

PLIANT_INLINE void pliant_advance_triangle_point(const double corner[3][3], const double weight[3], double out[3])
{
    for (int i = 0; i < 3; i++) out[i] = weight[0] * corner[0][i] + weight[1] * corner[1][i] + weight[2] * corner[2][i];
}

#endif
