/* The rules of the first step after a cut (opened.c), for the CPU and for the GPU's cuda/open.cu. */
#ifndef PLIANT_FEM_QUASISTATIC_OPENED_RULES_H
#define PLIANT_FEM_QUASISTATIC_OPENED_RULES_H

#include <math.h>

enum {
    PLIANT_OPENED_LEAST = 4,    /* evaluations: the state, a product, what it leads to, and what is left of that */
    PLIANT_OPENED_PRODUCTS = 8, /* at most */
    PLIANT_OPENED_PARTS = 8     /* that the way is gone in at most */
};

/* Of the norm of the residual, of which a hinge has a small part: with 0.05 it is left as it was (NUMERICS 10). */
#define PLIANT_OPENED_ENOUGH 0.01
/* Of the first direction: what holds has not moved if it has moved less. */
#define PLIANT_OPENED_HARDLY 0.01
/* Thousandths of the body's length: of the difference that a product is taken by; that are gone at once; from where on each part is looked at; in all:
 * what hangs by little is sent metres away. */
#define PLIANT_OPENED_DIFFERENCE 1e-3
#define PLIANT_OPENED_STRAIGHT 20.0
#define PLIANT_OPENED_DOUBTED 250.0
#define PLIANT_OPENED_FARTHEST 800.0

/* Of a way of this length [thousandths of the body's]: how much of it is gone, in so many parts. */
static inline double pliant_opened_share(double length) { return fmin(1, PLIANT_OPENED_FARTHEST / length); }
static inline int pliant_opened_parts(double length)
{
    return (int)fmin(fmax(ceil(pliant_opened_share(length) * length / PLIANT_OPENED_STRAIGHT), 1), PLIANT_OPENED_PARTS);
}

/* How much of a part is to be taken back, to where the potential energy is lowest: its slopes before and after, which is not above zero. */
static inline double pliant_opened_back(double part, double before, double after)
{
    const double lowest = part * after / (after - before);
    return isfinite(lowest) ? lowest : part;
}

#endif
