/* Linear lower bounds of the signed distance to a convex part. */
#ifndef PLIANT_CONTACT_ADVANCE_CONVEX_BOUND_H
#define PLIANT_CONTACT_ADVANCE_CONVEX_BOUND_H

#include "pliant/contact.h"

/* A lower bound: in the part's frame the signed distance at any y is at least offset + normal . (y - point). */
typedef struct pliant_distance_bound {
    double normal[3], point[3], offset; /* length of normal: at most 1 */
    double at[3];                       /* that bound at the triangle's corners [m] */
    double minimum; /* smallest of them: a lower bound of the triangle's distance; at most 0 if the part overlaps it */
} pliant_distance_bound;

/* Find the cut with the largest `minimum`. If the triangle's distance is above 0, `minimum` is within a thousandth of
 * it.
 * @param corner in the part's frame
 * @param weight in: start of the search; out: the closest point of the triangle */
void pliant_distance_bound_find(const pliant_part *core, const double corner[3][3], double weight[3],
                                pliant_distance_bound *out);

#endif
