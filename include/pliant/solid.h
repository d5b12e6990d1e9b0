/** @file solid.h
 *  Rigid solids by their closed surface of triangles: a tool or an obstacle of the user's, from an STL file or from points of its own.
 *  Whoever holds one counts: constant once made, and shared between threads.
 */
#ifndef PLIANT_SOLID_H
#define PLIANT_SOLID_H

#include "pliant/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_solid pliant_solid;

enum { PLIANT_SOLID_TRIANGLES = 1000000, PLIANT_HULL_TRIANGLES = 1000 /**< at most */ };

typedef struct pliant_solid_options {
    double unit;       /**< length of what the file calls 1 [m]; 0.001: it is in millimetres. 0: 1 */
    double turn[3];    /**< its axes in the tool's frame: roll, pitch, yaw [rad], as a URDF has them (about fixed x, then y, then z) */
    bool convex;       /**< its convex hull, with exact distances; else a signed distance field of the surface as it is */
    double resolution; /**< between points of that field [m]; 0: by the size of the solid, for some 200,000 of them */
} pliant_solid_options;

/** An STL file, ASCII or binary; corners that are nearer to each other than 1e-6 of its size are one.
 *  Errors name the file: FILE; FORMAT (not STL, truncated, a number that is none, no triangle; open: how many edges have no second triangle, and
 *  where; turned inside out in part; too fine a field for 64 MiB, or too coarse for how thin it is); MEMORY. */
PLIANT_API pliant_status pliant_solid_read(const char *path, const pliant_solid_options *options, pliant_solid **out);
/** The same from memory. @param points (num_points x 3) @param triangles (num_triangles x 3) corners, outwards counter-clockwise; of a convex one
 *  none are needed @param name of it, for messages */
PLIANT_API pliant_status pliant_solid_create(int32_t num_points, const double *points, int32_t num_triangles, const int32_t *triangles,
                                             const pliant_solid_options *options, const char *name, pliant_solid **out);
PLIANT_API void pliant_solid_release(const pliant_solid *solid);               /**< Nullable */

#ifdef __cplusplus
}
#endif
#endif
