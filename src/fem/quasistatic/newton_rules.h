/* Rules of the first step after a cut, shared by the CPU (newton_after_cut.c) and the GPU
 * (cuda/fem/quasistatic/newton_after_cut.cu). */
#ifndef PLIANT_FEM_QUASISTATIC_NEWTON_RULES_H
#define PLIANT_FEM_QUASISTATIC_NEWTON_RULES_H

#include "fem/quasistatic/settings.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

enum {
    PLIANT_NEWTON_MIN_EVALUATIONS = 4
}; /* minimum number of evaluations: state, product, end of the step, remaining residual */

/* Length of the difference for a product, in thousandths of the body's length.
 * Truncation and rounding are both small. */
#define PLIANT_NEWTON_DIFFERENCE 1e-3

/* Return the number of products that fit in so many evaluations. */
static inline int32_t pliant_newton_max_products(int32_t evaluations)
{
    const int32_t maximum = pliant_get_quasistatic_settings().newton_products;
    return evaluations - 2 < maximum ? evaluations - 2 : maximum;
}
/* Return the fraction of a direction for a difference product, from the direction's largest entry. 0: the direction is
 * zero. */
static inline double pliant_newton_difference_length(double smallest_displacement, double longest)
{
    const double part = PLIANT_NEWTON_DIFFERENCE * smallest_displacement / longest;
    return longest > 0 && isfinite(part) ? part : 0;
}
/* Return whether the first step [m] shows that the cut has released no tissue. */
static inline bool pliant_newton_is_negligible(double longest, double tolerance)
{
    return longest <= pliant_get_quasistatic_settings().newton_negligible * tolerance;
}
/* Rules of the conjugate gradients. `continues`: whether another direction is worth its product. `step_length`: along
 * a direction; 0 means no progress. `direction_weight`: weight of the old direction in the next one. prescribed: the
 * first direction, which the held nodes prescribe, is taken with length 1. */
static inline bool pliant_newton_continues(double norm, double first)
{
    const double enough = pliant_get_quasistatic_settings().newton_residual;
    return norm > enough * enough * first;
}
static inline double pliant_newton_step_length(bool prescribed, double norm, double curvature)
{
    const double fraction = prescribed ? 1 : norm / curvature;
    return curvature > 0 && isfinite(fraction) ? fraction : 0;
}
static inline double pliant_newton_direction_weight(bool prescribed, double norm, double before)
{
    return prescribed ? 0 : norm / before;
}

/* Return the fraction of a step of this length [thousandths of the body's length] that is taken, and the number of
 * parts. */
static inline double pliant_newton_step_fraction(double length)
{
    return fmin(1, pliant_get_quasistatic_settings().newton_max_length / length);
}
static inline int pliant_newton_num_parts(double length)
{
    const pliant_quasistatic_settings settings = pliant_get_quasistatic_settings();
    return (int)fmin(fmax(ceil(pliant_newton_step_fraction(length) * length / settings.newton_part_length), 1),
                     settings.newton_parts);
}

/* Return whether the slope is checked after this fraction of the step. */
static inline bool pliant_newton_checks_slope(double completed, double length)
{
    return completed * length > pliant_get_quasistatic_settings().newton_check_length;
}

/* Return the length by which a part is shortened, to the minimum of the potential energy, from its slopes before and
 * after the part. The slope after it is not positive. */
static inline double pliant_newton_backtrack(double part, double before, double after)
{
    const double lowest = part * after / (after - before);
    return isfinite(lowest) ? lowest : part;
}

#endif
