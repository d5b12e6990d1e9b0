/* Solids of triangles. A convex solid uses its planes; any other solid uses a signed distance field on a grid. */
#ifndef PLIANT_CONTACT_SOLID_H
#define PLIANT_CONTACT_SOLID_H

#include "pliant/solid.h"

#include <stdatomic.h>

/* Largest slope of a field between its grid points: at most 1 along each axis, so the square root of 3. */
#define PLIANT_FIELD_SLOPE 1.7320508

struct pliant_solid {
    atomic_int holders;
    int32_t num_points, num_triangles;
    double *points;      /* (num_points x 3) [m] */
    int32_t *triangles;  /* (num_triangles x 3) oriented outwards */
    bool convex;
    double low[3], high[3], volume;
    double depth;        /* largest known depth of an inner point [m] */
    double (*plane)[4];  /* convex: (num_triangles) outward unit normal, and offset along it [m] */
    int32_t size[3];     /* field: number of points along x, y, z; x fastest */
    double origin[3], cell, error;
    float *value;        /* [m] */
};

/* Return the signed distance [m], negative inside. It is exact for a convex solid. Otherwise it is interpolated
 * linearly in the field; outside the field's box it is a lower bound.
 * @param normal out: unit gradient; 0 0 0 where the gradient is not defined */
double pliant_solid_distance(const pliant_solid *solid, const double p[3], double normal[3]);

/* ---- stl.c */
typedef struct pliant_triangle_soup {
    int32_t num_triangles;
    double *points; /* (num_triangles x 3 corners x 3) */
} pliant_triangle_soup;
/* Read an STL file. The caller frees points with pliant_free. Errors name the file: FILE, FORMAT, MEMORY. */
pliant_status pliant_stl_read(const char *path, pliant_triangle_soup *out);

/* ---- triangle_tree.c: tree of boxes around triangles */
typedef struct pliant_triangle_tree pliant_triangle_tree;
/* Build the tree; it borrows points and triangles. Errors: MEMORY. */
pliant_status pliant_triangle_tree_create(const double *points, int32_t count, const int32_t *triangles,
                                          pliant_triangle_tree **out);
void pliant_triangle_tree_free(pliant_triangle_tree *tree); /* Nullable */
/* Return the distance of a point from the nearest triangle, or `maximum` if it is larger. */
double pliant_triangle_tree_distance(const pliant_triangle_tree *tree, const double p[3], double maximum);
/* Return the winding number of the surface around a point: 1 inside, 0 outside. */
double pliant_triangle_tree_winding(const pliant_triangle_tree *tree, const double p[3]);
/* Compute the point of a triangle nearest to p, as weights of its corners and as a point. The first weight may be
 * negative by rounding. For a triangle without area, the point is near the closest one. */
void pliant_triangle_nearest_weights(const double a[3], const double b[3], const double c[3], const double p[3],
                                     double out[3]);
void pliant_triangle_nearest(const double a[3], const double b[3], const double c[3], const double p[3], double out[3]);

/* ---- hull.c */
/* Compute the triangles of the convex hull, oriented outwards. Points within a face belong to no triangle. The
 * caller frees the triangles with pliant_free. Errors: FORMAT (flat, or more than PLIANT_HULL_TRIANGLES; name is
 * for the message), MEMORY. */
pliant_status pliant_hull_find(int32_t num_points, const double *points, const char *name, int32_t *num_triangles,
                               int32_t **triangles);

/* ---- field.c */
/* Compute the field of a solid from its surface: size, origin, cell, error, value, depth. Errors: FORMAT, MEMORY. */
pliant_status pliant_solid_make_field(pliant_solid *solid, double resolution, const char *name);

#endif
