/* Rules of the volume bound (volume_bound.h) that CPU and GPU share. In the tests, a tetrahedron is one lane of a
 * block. */
#ifndef PLIANT_CONTACT_VOLUME_VOLUME_RULES_H
#define PLIANT_CONTACT_VOLUME_VOLUME_RULES_H

#include "base/inline.h"
#include "base/lanes.h"
#include "base/vector3.h"
#include "contact/contact.h"

#include <math.h>

/* Edges from node 0 to the other nodes: edges, coordinates, lanes [m]. */
typedef double pliant_volume_edges[3][3][LANES];

/* Return the triple product of three edges of a lane. */
PLIANT_INLINE double pliant_volume_triple(double (*a)[LANES], double (*b)[LANES], double (*c)[LANES], int l)
{
    return a[0][l] * (b[1][l] * c[2][l] - b[2][l] * c[1][l]) + a[1][l] * (b[2][l] * c[0][l] - b[0][l] * c[2][l]) +
           a[2][l] * (b[0][l] * c[1][l] - b[1][l] * c[0][l]);
}

/* Return whether the volume is below a fraction of its rest volume. */
PLIANT_INLINE bool pliant_volume_is_below(double fraction, pliant_volume_edges now, pliant_volume_edges rest, int l)
{
    return pliant_volume_triple(now[0], now[1], now[2], l) <
           fraction * pliant_volume_triple(rest[0], rest[1], rest[2], l);
}

/* Return whether the volume may fall below its limit during a leg from a to b. The Bernstein coefficients of the volume
 * bound it (volume_bound.c). keep, stop: settings advance_keep and volume_stop */
PLIANT_INLINE bool pliant_volume_may_be_small(double keep, double stop, pliant_volume_edges a, pliant_volume_edges b,
                                              pliant_volume_edges rest, int l)
{
    const double relaxed = stop * pliant_volume_triple(rest[0], rest[1], rest[2], l),
                 v0 = pliant_volume_triple(a[0], a[1], a[2], l),
                 v1 = (pliant_volume_triple(b[0], a[1], a[2], l) + pliant_volume_triple(a[0], b[1], a[2], l) +
                       pliant_volume_triple(a[0], a[1], b[2], l)) /
                      3,
                 v2 = (pliant_volume_triple(b[0], b[1], a[2], l) + pliant_volume_triple(b[0], a[1], b[2], l) +
                       pliant_volume_triple(a[0], b[1], b[2], l)) /
                      3,
                 v3 = pliant_volume_triple(b[0], b[1], b[2], l);
    const double kept = keep * v0 < relaxed ? keep * v0 : relaxed, half = 0.5 * relaxed < v0 ? 0.5 * relaxed : v0,
                 limit = kept > half ? kept : half;
    return (v1 < limit) | (v2 < limit) | (v3 < limit);
}

/* Set normal, weights and p (contact.h) of an element's point for these positions of its four nodes. Node 0 is the top,
 * and the others are the opposite face. The foot of the height has the weights of the face, so a force has no moment.
 * Return false if the face has no area; the point is then unchanged. */
PLIANT_INLINE bool pliant_volume_set_height(double x[4][3], pliant_contact_point *point)
{
    double u[3], w[3], to[3], face[3], part[3], fraction[2];
    pliant_subtract3(x[2], x[1], u);
    pliant_subtract3(x[3], x[1], w);
    pliant_subtract3(x[0], x[1], to);
    pliant_cross3(u, w, face);
    const double square = pliant_dot3(face, face), length = sqrt(square); /* length: twice the area of the face */
    if (!(square > 0)) return false;
    pliant_cross3(to, w, part);
    fraction[0] = pliant_dot3(face, part) / square;
    pliant_cross3(u, to, part);
    fraction[1] = pliant_dot3(face, part) / square;
    point->weight[0] = 1;
    point->weight[1] = fraction[0] + fraction[1] - 1;
    point->weight[2] = -fraction[0];
    point->weight[3] = -fraction[1];
    for (int d = 0; d < 3; d++) {
        point->normal[d] = face[d] / length;
        point->place[d] = point->normal[d] * point->least_volume / length;
    }
    return true;
}

#endif
