/* Internal functions of tool shapes, in addition to pliant/contact.h and pliant/solid.h. */
#ifndef PLIANT_CONTACT_TOOL_SHAPE_H
#define PLIANT_CONTACT_TOOL_SHAPE_H

#include "base/export.h"
#include "pliant/contact.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Return whether a part of the shape moves with the jaw angle. */
PLIANT_INTERNAL bool pliant_tool_shape_has_jaws(const pliant_tool_shape *shape);

/* Return whether a tool of this shape grasps by contact alone (grasp/kind). Such a tool needs no call of
 * pliant_tool_grasp. */
PLIANT_INTERNAL bool pliant_tool_shape_holds(const pliant_scene *scene, const pliant_tool_shape *shape);

/* Nullable. Return the argument. */
const pliant_solid *pliant_solid_retain(const pliant_solid *solid);

typedef struct pliant_solid_surface {
    int32_t num_points, num_triangles;
    const double *points;     /* (num_points x 3) rotated, with duplicate corners merged [m] */
    const int32_t *triangles; /* (num_triangles x 3) counter-clockwise from outside */
    bool convex;
    double resolution;        /* cell size of its field; 0: it is convex and exact [m] */
    double error; /* maximum absolute value of its field on the surface, at corners and centers of triangles [m] */
    double volume;            /* [m^3] */
    size_t bytes;
} pliant_solid_surface;

/* Get the surface of a solid. Pointers are valid as long as the solid. */
PLIANT_INTERNAL void pliant_solid_get_surface(const pliant_solid *solid, pliant_solid_surface *out);

#ifdef __cplusplus
}
#endif
#endif
