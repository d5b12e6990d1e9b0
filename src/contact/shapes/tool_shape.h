/* Shapes of tools: functions for the library and nodes. */
#ifndef PLIANT_CONTACT_TOOL_SHAPE_H
#define PLIANT_CONTACT_TOOL_SHAPE_H

#include "base/export.h"
#include "pliant/contact.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Return whether a part of the shape moves with the jaws. */
PLIANT_INTERNAL bool pliant_tool_shape_has_jaws(const pliant_tool_shape *shape);

/* Return whether a tool of this shape grasps by contact only (grasp/kind). Closing jaws then need no pliant_tool_grasp. */
PLIANT_INTERNAL bool pliant_tool_shape_holds(const pliant_scene *scene, const pliant_tool_shape *shape);

/* Add a reference to a solid. Return solid, which is Nullable. */
const pliant_solid *pliant_solid_retain(const pliant_solid *solid);

typedef struct pliant_solid_surface {
    int32_t num_points, num_triangles;
    const double *points;     /* (num_points x 3) rotated to the tool's axes, without duplicates [m] */
    const int32_t *triangles; /* (num_triangles x 3) counter-clockwise seen from outside */
    bool convex;
    double resolution;        /* grid spacing of the distance field [m]; 0: convex, with exact distances */
    double error;             /* largest distance of the field from 0 at corners and centres of triangles [m] */
    double volume;            /* [m^3] */
    size_t bytes;
} pliant_solid_surface;

/* Return the surface of a solid. Its pointers are valid as long as the solid. */
PLIANT_INTERNAL void pliant_solid_get_surface(const pliant_solid *solid, pliant_solid_surface *out);

#ifdef __cplusplus
}
#endif
#endif
