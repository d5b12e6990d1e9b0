/* Which triangles of the surface may touch a part that moves: boxes first, then balls around them. */
#ifndef PLIANT_CONTACT_BROAD_H
#define PLIANT_CONTACT_BROAD_H

#include "contact/detect/find.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_ball { double middle[3], radius; } pliant_ball;

typedef struct pliant_broad {
    uint64_t revision;    /* of the body that the list of nodes is of; 0: none */
    int32_t num_nodes, room_nodes; /* of the mesh */
    int32_t num_surface;
    int32_t *surface;     /* (num_surface) nodes of triangles */
    bool knows_last;
    double *last;         /* (num_nodes x 3) of the surface's: where they were as the step before began */
    uint8_t *side;        /* (num_nodes) on which sides of the box around all parts */
    int32_t num_near, room_near;
    int32_t *near;        /* (num_near) triangles that may touch any part */
    pliant_ball *ball;    /* (num_near) around each of them, and where it gets if it goes on as in the last step */
} pliant_broad;

/* Triangles near any of the parts. Errors: MEMORY */
pliant_status pliant_broad_begin(pliant_broad *broad, const pliant_body *body, const double *positions, int32_t count, const pliant_moving_part *parts);
/* Of those, the ones near one part. @param out (num_near) triangles, ascending. @return how many */
int32_t pliant_broad_find(const pliant_broad *broad, const pliant_moving_part *part, int32_t *out);
/* How far a node went in the last step [m]. */
double pliant_broad_way(const pliant_broad *broad, const double *positions, int32_t node);
/* What the next step asks for. */
void pliant_broad_end(pliant_broad *broad, const double *positions);
/* What another one knows of the last step, of the same body. Errors: MEMORY (nothing changed) */
pliant_status pliant_broad_copy(const pliant_broad *from, pliant_broad *to);
void pliant_broad_free(pliant_broad *broad);

#ifdef __cplusplus
}
#endif

#endif
