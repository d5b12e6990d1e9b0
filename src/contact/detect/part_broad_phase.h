/* Broad phase: find the triangles of the surface that can touch a part in a leg, first by boxes, then by bounding
 * spheres. */
#ifndef PLIANT_CONTACT_PART_BROAD_PHASE_H
#define PLIANT_CONTACT_PART_BROAD_PHASE_H

#include "contact/advance/near_triangles.h"
#include "contact/detect/part_contacts.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_ball { double middle[3], radius; } pliant_ball;

typedef struct pliant_broad {
    int32_t num_near, near_capacity;
    int32_t *near;        /* (num_near) triangles near any part, ascending */
    pliant_ball *ball;    /* (num_near) their bounding spheres */
    pliant_near_region *region; /* (parts) */
} pliant_broad;

/* Find the triangles near any of the parts. finder: Nullable. Errors: MEMORY. */
pliant_status pliant_broad_find_all(pliant_broad *broad, const pliant_body *body, const double *positions,
                                    int32_t count, const pliant_moving_part *parts, const pliant_near_finder *finder);
/* Select those near one part.
 * @param out (num_near) triangles, ascending
 * @return number of triangles */
int32_t pliant_broad_find(const pliant_broad *broad, const pliant_moving_part *part, int32_t *out);
void pliant_broad_free(pliant_broad *broad);

#ifdef __cplusplus
}
#endif

#endif
