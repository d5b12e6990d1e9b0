/* The broad phase: pairs of triangles and parts that may come near each other during a leg. */
#ifndef PLIANT_CONTACT_ADVANCE_NEAR_H
#define PLIANT_CONTACT_ADVANCE_NEAR_H

#include "contact/advance/pair.h"

/* Around a triangle throughout a leg. */
typedef struct pliant_advance_box { double low[3], high[3]; } pliant_advance_box;

struct pliant_advance {
    pliant_advance_rule rule;
    int32_t num_pairs, max_pairs, max_parts, max_triangles;
    pliant_advance_pair *pair;      /* (max_pairs) in ascending order of parts, then triangles */
    int32_t *order;                 /* (max_pairs) */
    pliant_advance_motion *motion;  /* (max_parts) */
    int32_t *near;                  /* (max_triangles) triangles that are near any part, ascending */
    pliant_advance_box *box;        /* (max_triangles) around those */
};

/* Fill motion and pair with all pairs whose core distance may fall to `margin` or below during the leg; held triangles are left out.
 * @param still parts stay in their first poses. Errors: MEMORY */
pliant_status pliant_advance_near(pliant_advance *room, int32_t num_triangles, const int32_t *triangles, const double *from, const double *to,
                                  int32_t count, const pliant_advance_part *parts, double margin, bool still, int num_threads);

#endif
