/* Solids of triangles: a convex one by its faces, any other by a field of signed distances on a grid. */
#ifndef PLIANT_CONTACT_SOLID_H
#define PLIANT_CONTACT_SOLID_H

#include "pliant/solid.h"

#include <stdatomic.h>

struct pliant_solid {
    atomic_int holders;
    int32_t num_points, num_triangles;
    double *points;      /* (num_points x 3) [m] */
    int32_t *triangles;  /* (num_triangles x 3) outwards */
    bool convex;
    double low[3], high[3], volume;
    double depth;        /* of a point of its inside, as deep as is known [m] */
    double (*plane)[4];  /* convex: (num_triangles) outward unit normal, and where along it [m] */
    int32_t size[3];     /* field: points along x, y, z; x fastest */
    double origin[3], cell, error;
    float *value;        /* [m] */
};

/* Signed distance [m], below 0 inside. Exact where it is convex. Otherwise of the field, linear in between; from outside of the field's box a lower bound.
 * @param normal outwards, unit: its gradient; 0 0 0 where there is none */
double pliant_solid_distance(const pliant_solid *solid, const double p[3], double normal[3]);

/* ---- stl.c */
typedef struct pliant_triangle_soup { int32_t num_triangles; double *points; /* (num_triangles x 3 corners x 3) */ } pliant_triangle_soup;
/* Free points with pliant_free. Errors name the file: FILE, FORMAT, MEMORY. */
pliant_status pliant_stl_read(const char *path, pliant_triangle_soup *out);

/* ---- nearest.c: a tree of boxes around triangles */
typedef struct pliant_triangle_tree pliant_triangle_tree;
pliant_status pliant_triangle_tree_create(const double *points, int32_t count, const int32_t *triangles, pliant_triangle_tree **out); /* Errors: MEMORY */
void pliant_triangle_tree_free(pliant_triangle_tree *tree); /* Nullable */
/* Distance of a point from the nearest triangle that is no further than that; otherwise `most`. */
double pliant_triangle_tree_distance(const pliant_triangle_tree *tree, const double p[3], double most);
/* How many times the surface goes round a point: 1 inside, 0 outside. */
double pliant_triangle_tree_winding(const pliant_triangle_tree *tree, const double p[3]);
/* The point of a triangle that is nearest to p. */
void pliant_triangle_nearest_weights(const double a[3], const double b[3], const double c[3], const double p[3], double out[3]); /* of its corners */
void pliant_triangle_nearest(const double a[3], const double b[3], const double c[3], const double p[3], double out[3]);

/* ---- hull.c */
/* Triangles of the convex hull, outwards; of points that lie in a plane none. Free with pliant_free.
 * Errors: FORMAT (flat, or more than PLIANT_HULL_TRIANGLES; name is for the message), MEMORY. */
pliant_status pliant_hull_find(int32_t num_points, const double *points, const char *name, int32_t *num_triangles, int32_t **triangles);

/* ---- field.c */
/* The field of a solid whose surface is there; writes size, origin, cell, error, value, depth. Errors: FORMAT, MEMORY. */
pliant_status pliant_solid_make_field(pliant_solid *solid, double resolution, const char *name);

#endif
