/* The rules of the first step after a cut (opened.c), for the CPU and for the GPU's cuda/fem/quasistatic/open.cu. */
#ifndef PLIANT_FEM_QUASISTATIC_OPENED_RULES_H
#define PLIANT_FEM_QUASISTATIC_OPENED_RULES_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

enum {
    PLIANT_OPENED_LEAST = 4,    /* evaluations: the state, a product, what it leads to, and what is left of that */
    PLIANT_OPENED_PRODUCTS = 8, /* at most */
    PLIANT_OPENED_PARTS = 8     /* that the way is gone in at most */
};

/* Of the norm of the residual, of which a hinge has a small part: with 0.05 it is left as it was (NUMERICS 10). */
#define PLIANT_OPENED_ENOUGH 0.01
/* Of the tolerance: a cut whose first step is no longer than this has released nothing. A hinge's is longer than it is made by the carried inverse, a hundred times. */
#define PLIANT_OPENED_SETTLED 0.1
/* Of the first direction: what holds has not moved if it has moved less. */
#define PLIANT_OPENED_HARDLY 0.01
/* Thousandths of the body's length: of the difference that a product is taken by; that are gone at once; from where on each part is looked at; in all:
 * what hangs by little is sent metres away. */
#define PLIANT_OPENED_DIFFERENCE 1e-3
#define PLIANT_OPENED_STRAIGHT 20.0
#define PLIANT_OPENED_DOUBTED 250.0
#define PLIANT_OPENED_FARTHEST 800.0

/* Products that so many evaluations allow. */
static inline int32_t pliant_opened_products(int32_t evaluations) { return evaluations - 2 < PLIANT_OPENED_PRODUCTS ? evaluations - 2 : PLIANT_OPENED_PRODUCTS; }
/* The part of a direction that a product is taken by, of its longest; 0: it is nothing. */
static inline double pliant_opened_difference(double smallest_displacement, double longest)
{
    const double part = PLIANT_OPENED_DIFFERENCE * smallest_displacement / longest;
    return longest > 0 && isfinite(part) ? part : 0;
}
/* Whether the first step [m] says that there is nothing to be found. */
static inline bool pliant_opened_is_settled(double longest, double tolerance) { return longest <= PLIANT_OPENED_SETTLED * tolerance; }
/* Conjugate gradients: whether another direction is worth its product; how much of it is gone, 0: it leads nowhere; of it, in the next one. led: the first, which
 * what holds has led, is gone as it is. */
static inline bool pliant_opened_goes_on(double norm, double first) { return norm > PLIANT_OPENED_ENOUGH * PLIANT_OPENED_ENOUGH * first; }
static inline double pliant_opened_advance(bool led, double norm, double curvature)
{
    const double share = led ? 1 : norm / curvature;
    return curvature > 0 && isfinite(share) ? share : 0;
}
static inline double pliant_opened_turned(bool led, double norm, double before) { return led ? 0 : norm / before; }

/* Of a way of this length [thousandths of the body's]: how much of it is gone, in so many parts. */
static inline double pliant_opened_share(double length) { return fmin(1, PLIANT_OPENED_FARTHEST / length); }
static inline int pliant_opened_parts(double length)
{
    return (int)fmin(fmax(ceil(pliant_opened_share(length) * length / PLIANT_OPENED_STRAIGHT), 1), PLIANT_OPENED_PARTS);
}

/* Whether the slope is looked at where so much of it is gone. */
static inline bool pliant_opened_doubts(double gone, double length) { return gone * length > PLIANT_OPENED_DOUBTED; }

/* How much of a part is to be taken back, to where the potential energy is lowest: its slopes before and after, which is not above zero. */
static inline double pliant_opened_back(double part, double before, double after)
{
    const double lowest = part * after / (after - before);
    return isfinite(lowest) ? lowest : part;
}

#endif
