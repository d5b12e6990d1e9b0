/* Lower bounds of the signed distance from a triangle to a solid that is not convex, by its field. */
#ifndef PLIANT_CONTACT_ADVANCE_FIELD_BOUND_H
#define PLIANT_CONTACT_ADVANCE_FIELD_BOUND_H

#include "contact/advance/motion.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Positions of a triangle's corners during a leg. */
typedef struct pliant_advance_triangle {
    double from[3][3], rate[3][3];
} pliant_advance_triangle;

/* Return a lower bound of the field's smallest value on a triangle in the part's frame [m]. It is at most 0 if the
 * triangle enters the part. Otherwise it is at least `far`, or nine tenths of the distance minus a ten thousandth
 * of a cell. */
double pliant_field_minimum(const pliant_part *core, const double corner[3][3], double far);

/* Return a time, starting from t, up to which the distance stays at least `limit`. */
double pliant_field_free_time(const pliant_advance_motion *motion, const pliant_advance_triangle *triangle, double t,
                              double limit);

#ifdef __cplusplus
}
#endif

#endif
