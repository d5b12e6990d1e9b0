/* Which triangles of the surface may touch a part in a leg: boxes first, then balls around them. */
#ifndef PLIANT_CONTACT_BROAD_H
#define PLIANT_CONTACT_BROAD_H

#include "contact/detect/find.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_ball { double middle[3], radius; } pliant_ball;

typedef struct pliant_broad {
    int32_t num_near, room_near;
    int32_t *near;        /* (num_near) triangles that may touch any part, ascending */
    pliant_ball *ball;    /* (num_near) around each of them */
} pliant_broad;

/* Triangles near any of the parts. Errors: MEMORY */
pliant_status pliant_broad_begin(pliant_broad *broad, const pliant_body *body, const double *positions, int32_t count, const pliant_moving_part *parts);
/* Of those, the ones near one part. @param out (num_near) triangles, ascending. @return how many */
int32_t pliant_broad_find(const pliant_broad *broad, const pliant_moving_part *part, int32_t *out);
void pliant_broad_free(pliant_broad *broad);

#ifdef __cplusplus
}
#endif

#endif
