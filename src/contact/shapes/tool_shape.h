/* Shapes of tools: what the library needs beyond pliant/contact.h and pliant/solid.h. */
#ifndef PLIANT_CONTACT_TOOL_SHAPE_H
#define PLIANT_CONTACT_TOOL_SHAPE_H

#include "base/export.h"
#include "pliant/contact.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Whether a part of it moves with the jaws' angle. */
PLIANT_INTERNAL bool pliant_tool_shape_has_jaws(const pliant_tool_shape *shape);

/* Whether a tool of this shape takes hold by contact alone (grasp/kind): who closes its jaws then calls no pliant_tool_grasp. */
PLIANT_INTERNAL bool pliant_tool_shape_holds(const pliant_scene *scene, const pliant_tool_shape *shape);

const pliant_solid *pliant_solid_retain(const pliant_solid *solid); /* Nullable. @return the same */

typedef struct pliant_solid_surface {
    int32_t num_points, num_triangles;
    const double *points;     /* (num_points x 3), turned, corners that were one joined [m] */
    const int32_t *triangles; /* (num_triangles x 3) outwards counter-clockwise */
    bool convex;
    double resolution;        /* of its field; 0: it is convex, and exact [m] */
    double error;             /* how far its field is from 0 on the surface, at most: at corners and middles of triangles [m] */
    double volume;            /* [m^3] */
    size_t bytes;
} pliant_solid_surface;

/* What it is made of. Pointers live as long as it does. */
PLIANT_INTERNAL void pliant_solid_get_surface(const pliant_solid *solid, pliant_solid_surface *out);

#ifdef __cplusplus
}
#endif
#endif
