/* Rules of the first step after a cut, shared by the CPU (opened.c) and the GPU (cuda/fem/quasistatic/open.cu). */
#ifndef PLIANT_FEM_QUASISTATIC_OPENED_RULES_H
#define PLIANT_FEM_QUASISTATIC_OPENED_RULES_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

enum {
    PLIANT_OPENED_LEAST = 4,    /* minimum number of evaluations: state, product, end of the step, remaining residual */
    PLIANT_OPENED_PRODUCTS = 8, /* maximum number of products */
    PLIANT_OPENED_PARTS = 8     /* maximum number of parts of the step */
};

/* Stop at this fraction of the residual's norm. A hinge has a small part of the residual: with 0.05 it does not open
 * (NUMERICS.md). */
#define PLIANT_OPENED_ENOUGH 0.01
/* Fraction of the tolerance: a cut whose first step is shorter has released no tissue. The carried inverse makes a
 * hinge's first step too short, up to a hundred times. */
#define PLIANT_OPENED_SETTLED 0.1
/* Fraction of the first direction: below it, the held nodes have not moved. */
#define PLIANT_OPENED_HARDLY 0.01
/* Lengths in thousandths of the body's length: the difference for a product, the length of one part, the length above
 * which each part is checked, and the maximum length. Newton steps of weakly attached tissue can be metres long. */
#define PLIANT_OPENED_DIFFERENCE 1e-3
#define PLIANT_OPENED_STRAIGHT 20.0
#define PLIANT_OPENED_DOUBTED 250.0
#define PLIANT_OPENED_FARTHEST 800.0

/* Return the number of products that fit in so many evaluations. */
static inline int32_t pliant_opened_products(int32_t evaluations) { return evaluations - 2 < PLIANT_OPENED_PRODUCTS ? evaluations - 2 : PLIANT_OPENED_PRODUCTS; }
/* Return the fraction of a direction for a difference product, from the direction's largest entry. 0: the direction is
 * zero. */
static inline double pliant_opened_difference(double smallest_displacement, double longest)
{
    const double part = PLIANT_OPENED_DIFFERENCE * smallest_displacement / longest;
    return longest > 0 && isfinite(part) ? part : 0;
}
/* Return whether the first step [m] shows that the cut has released no tissue. */
static inline bool pliant_opened_is_settled(double longest, double tolerance) { return longest <= PLIANT_OPENED_SETTLED * tolerance; }
/* Rules of the conjugate gradients. `goes_on`: whether another direction is worth its product. `advance`: step length
 * along a direction; 0 means no progress. `turned`: weight of the old direction in the next one. led: the first
 * direction, which the held nodes prescribe, is taken with length 1. */
static inline bool pliant_opened_goes_on(double norm, double first) { return norm > PLIANT_OPENED_ENOUGH * PLIANT_OPENED_ENOUGH * first; }
static inline double pliant_opened_advance(bool led, double norm, double curvature)
{
    const double share = led ? 1 : norm / curvature;
    return curvature > 0 && isfinite(share) ? share : 0;
}
static inline double pliant_opened_turned(bool led, double norm, double before) { return led ? 0 : norm / before; }

/* Return the fraction of a step of this length [thousandths of the body's length] that is taken, and the number of
 * parts. */
static inline double pliant_opened_share(double length) { return fmin(1, PLIANT_OPENED_FARTHEST / length); }
static inline int pliant_opened_parts(double length)
{
    return (int)fmin(fmax(ceil(pliant_opened_share(length) * length / PLIANT_OPENED_STRAIGHT), 1), PLIANT_OPENED_PARTS);
}

/* Return whether the slope is checked after this fraction of the step. */
static inline bool pliant_opened_doubts(double gone, double length) { return gone * length > PLIANT_OPENED_DOUBTED; }

/* Return the length by which a part is shortened, to the minimum of the potential energy, from its slopes before and
 * after the part. The slope after it is not positive. */
static inline double pliant_opened_back(double part, double before, double after)
{
    const double lowest = part * after / (after - before);
    return isfinite(lowest) ? lowest : part;
}

#endif
