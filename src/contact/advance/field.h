/* Lower bounds of the signed distance from a triangle to a solid that is not convex, by its field. */
#ifndef PLIANT_CONTACT_ADVANCE_FIELD_H
#define PLIANT_CONTACT_ADVANCE_FIELD_H

#include "pliant/contact.h"

/* Lower bound of the field's smallest value on a triangle in the part's frame [m]. It is at most 0 if the triangle enters the part. Otherwise it is at
 * least nine tenths of the distance, if that is above a thousandth of a cell. Adds the field's evaluations to *distances. */
double pliant_field_least(const pliant_part *core, const double corner[3][3], int64_t *distances);

/* A triangle moves from one place to another. Each corner leaves its chord by at most 4 bulge s (1 - s) at a fraction s of the way.
 * @return a fraction of the way in which the distance is at least `limit` */
double pliant_field_free(const pliant_part *core, const double from[3][3], const double to[3][3], double bulge, double limit, int64_t *distances);

#endif
