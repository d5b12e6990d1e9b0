/* Test whether the segment between two points passes through a triangle swept by a blade. CPU and GPU share these
 * functions. */
#ifndef PLIANT_CUT_SEGMENT_THROUGH_TRIANGLE_H
#define PLIANT_CUT_SEGMENT_THROUGH_TRIANGLE_H

#include "base/inline.h"

#include <math.h>

/* Return on which side of a triangle a point lies. Points within slack are in front.
 * normal: of any length */
PLIANT_INLINE bool pliant_in_front(const double normal[3], const double corner[3], const double point[3], double slack)
{
    const double length = sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    return normal[0] * (point[0] - corner[0]) + normal[1] * (point[1] - corner[1]) +
               normal[2] * (point[2] - corner[2]) >
           -slack * length;
}

/* Return the direction in which the edge from p to q turns around the origin. The input is in single precision, so that
 * the products are exact in double precision. If the edge passes through the origin, the origin is shifted
 * infinitesimally along the first axis, and less along the second. Exactly one of the triangles that surround the
 * origin then contains it, also at a shared edge or corner (Edelsbrunner and Muecke 1990, simulation of simplicity). */
PLIANT_INLINE bool pliant_turns_left(const float p[2], const float q[2])
{
    const double turn = (double)p[0] * q[1] - (double)p[1] * q[0];
    if (turn > 0.0 || turn < 0.0) return turn > 0.0;
    if (p[1] > q[1] || p[1] < q[1]) return p[1] > q[1];
    return q[0] > p[0];
}

/* Project a point along the segment from a to b, which becomes the origin (Woop, Benthin and Wald 2013). */
PLIANT_INLINE void pliant_see_along(const double a[3], const double b[3], const double point[3], float out[2])
{
    const double direction[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
    int z = fabs(direction[0]) > fabs(direction[1]) ? 0 : 1;
    if (fabs(direction[2]) > fabs(direction[z])) z = 2;
    const int x = (z + 1) % 3, y = (z + 2) % 3;
    const double along = (point[z] - a[z]) / direction[z];
    out[0] = (float)(point[x] - a[x] - along * direction[x]);
    out[1] = (float)(point[y] - a[y] - along * direction[y]);
}

/* Return whether the segment from a to b passes through a triangle.
 * corner: (3 x 3) corners of the triangle
 * normal: of any length */
PLIANT_INLINE bool pliant_passes_through(const double a[3], const double b[3], const double corner[9],
                                         const double normal[3], double slack)
{
    if (pliant_in_front(normal, corner, a, slack) == pliant_in_front(normal, corner, b, slack)) return false;
    float projected[3][2];
    for (int v = 0; v < 3; v++) pliant_see_along(a, b, corner + 3 * v, projected[v]);
    const bool left = pliant_turns_left(projected[0], projected[1]);
    return left == pliant_turns_left(projected[1], projected[2]) &&
           left == pliant_turns_left(projected[2], projected[0]);
}

#endif
