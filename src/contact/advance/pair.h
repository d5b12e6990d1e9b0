/* One triangle and one part during a leg. */
#ifndef PLIANT_CONTACT_ADVANCE_PAIR_H
#define PLIANT_CONTACT_ADVANCE_PAIR_H

#include "contact/advance/field_bound.h"

typedef struct pliant_advance_pair {
    int32_t part, triangle;
    bool exempt; /* it overlaps a released part */
    bool ends;   /* t can increase no further */
    int32_t iterations;
    double t;         /* fraction that is certainly free */
    double limit;     /* smallest permitted distance [m] */
    double weight[3]; /* weights of the triangle's corners at which the search for the smallest distance starts */
} pliant_advance_pair;

/* Return the number of pairs of the last leg, and the pairs. */
int32_t pliant_advance_get_pairs(const pliant_advance *advance, const pliant_advance_pair **pairs);
/* Set the motion of a triangle. from, to: (nodes x 3) positions at both ends of the leg [m] */
void pliant_advance_triangle_init(const int32_t node[3], const double *from, const double *to,
                                  pliant_advance_triangle *out);
/* Return a lower bound of the core distance at a fraction of the leg [m]. */
double pliant_advance_pair_distance(const pliant_advance_motion *motion, const pliant_advance_triangle *triangle,
                                    double t, double weight[3]);
/* Increase pair->t by one iteration. Return true if it reached 1, or if it cannot increase further. */
bool pliant_advance_pair_step(const pliant_contact_settings *settings, const pliant_advance_motion *motion,
                              const pliant_advance_triangle *triangle, pliant_advance_pair *pair);

#endif
