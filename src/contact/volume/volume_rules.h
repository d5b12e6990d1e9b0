/* Tests of the volume bound (volume_bound.h) that CPU and GPU share. A tetrahedron is one lane of a block. */
#ifndef PLIANT_CONTACT_VOLUME_VOLUME_RULES_H
#define PLIANT_CONTACT_VOLUME_VOLUME_RULES_H

#include "base/inline.h"
#include "base/lanes.h"

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

#endif
