/** @file solid.h
 *  Rigid solids from a closed surface of triangles: a tool or an obstacle, from an STL file or from arrays. A solid is
 *  constant, reference-counted, and may be shared between threads.
 */
#ifndef PLIANT_SOLID_H
#define PLIANT_SOLID_H

#include "pliant/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_solid pliant_solid; /**< opaque */

enum {
    PLIANT_SOLID_TRIANGLES = 1000000, /**< maximum number of triangles */
    PLIANT_HULL_TRIANGLES = 1000      /**< maximum number of triangles of a convex hull */
};

/** How a solid is made from its surface. */
typedef struct pliant_solid_options {
    double unit;       /**< unit of lengths in the file [m], such as 0.001 for millimetres; 0: 1 m */
    double turn[3];    /**< roll, pitch, yaw of its axes in the tool's frame [rad], about fixed x, then y, then z as in
                        *   URDF */
    bool convex;       /**< true: its convex hull, with exact distances; false: a signed distance field of the
                        *   surface */
    double resolution; /**< grid spacing of the distance field [m]; 0: about 200,000 grid points */
} pliant_solid_options;

/** Read a solid from an STL file, ASCII or binary. Corners closer than 1e-6 of the solid's size are merged.
 *  @param path    The file.
 *  @param options The options.
 *  @param out     Out: release with pliant_solid_release.
 *  @return Errors, with the file's name: FILE, MEMORY, ARGUMENT, FORMAT (not STL; truncated; a number is not finite;
 *          without triangles; open, with the number and position of open edges; partly inside out; field over 64 MiB,
 *          or too coarse for a thin part). */
PLIANT_API pliant_status pliant_solid_read(const char *path, const pliant_solid_options *options, pliant_solid **out);

/** Create a solid from arrays.
 *  @param num_points    Number of points.
 *  @param points        (num_points x 3) Corners [m], or in options->unit; copied.
 *  @param num_triangles Number of triangles; 0 for a convex solid.
 *  @param triangles     (num_triangles x 3) Corners, counter-clockwise seen from outside; Nullable for a convex solid.
 *  @param options       The options.
 *  @param name          Name in error messages.
 *  @param out           Out: release with pliant_solid_release.
 *  @return Errors: as of pliant_solid_read, except FILE. */
PLIANT_API pliant_status pliant_solid_create(int32_t num_points, const double *points, int32_t num_triangles,
                                             const int32_t *triangles, const pliant_solid_options *options,
                                             const char *name, pliant_solid **out);

/** Remove a reference from a solid. The last call frees it. Tools with a shape of it hold their own references.
 *  @param solid Nullable. */
PLIANT_API void pliant_solid_release(const pliant_solid *solid);

#ifdef __cplusplus
}
#endif
#endif
