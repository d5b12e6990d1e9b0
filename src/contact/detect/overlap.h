/* Test whether two tetrahedra overlap, by separating planes (Ganovelli, Ponchio, Rocchini, A fast
 * tetrahedron-tetrahedron overlap algorithm, Journal of Graphics Tools 7(2), 2002). If a separating plane exists,
 * one exists along a face of either tetrahedron or through an edge of the first. The inside of the first at an edge
 * between the faces f and g is where the heights over both faces are negative. A plane through that edge separates
 * unless the second reaches into this wedge.
 *
 * Tetrahedra overlap if their interiors have a common point. Tetrahedra that only touch, and flat ones, do not. The
 * test is exact for integer coordinates below 128 times a common power of two, and otherwise within rounding in
 * double precision. Either tetrahedron may be inverted. */
#ifndef PLIANT_CONTACT_OVERLAP_H
#define PLIANT_CONTACT_OVERLAP_H

#include "base/inline.h"

/* Compute the heights of b's corners over a's faces times twice the face's area. Face f is opposite corner f, and
 * outwards is positive. Return whether no face separates them. */
PLIANT_INLINE int pliant_overlap_faces(double a[3][4], double b[3][4], double height[4][4])
{
    double edge[3][3], normal[4][3];
    for (int v = 0; v < 3; v++)
        for (int d = 0; d < 3; d++) edge[v][d] = a[d][v + 1] - a[d][0];
    PLIANT_UNROLL
    for (int f = 1; f < 4; f++) { /* through corner 0; points inwards unless the tetrahedron is inverted */
        const double *u = edge[f % 3], *w = edge[(f + 1) % 3];
        normal[f][0] = u[1] * w[2] - u[2] * w[1];
        normal[f][1] = u[2] * w[0] - u[0] * w[2];
        normal[f][2] = u[0] * w[1] - u[1] * w[0];
    }
    const double volume = normal[1][0] * edge[0][0] + normal[1][1] * edge[0][1] + normal[1][2] * edge[0][2];
    if (volume == 0) return 0;
    const double sign = volume > 0 ? -1.0 : 1.0;
    PLIANT_UNROLL
    for (int d = 0; d < 3; d++) {
        for (int f = 1; f < 4; f++) normal[f][d] *= sign;
        normal[0][d] = -(normal[1][d] + normal[2][d] + normal[3][d]);
    }
    PLIANT_UNROLL
    for (int f = 3; f >= 0; f--) {
        const int through = f == 0;
        for (int v = 0; v < 4; v++)
            height[f][v] = normal[f][0] * (b[0][v] - a[0][through]) + normal[f][1] * (b[1][v] - a[1][through]) +
                           normal[f][2] * (b[2][v] - a[2][through]);
        if (!((height[f][0] < 0) | (height[f][1] < 0) | (height[f][2] < 0) | (height[f][3] < 0))) return 0;
    }
    return 1;
}

/* Set a bit for each corner below each face. */
PLIANT_INLINE void pliant_overlap_below(double height[4][4], int below[4])
{
    PLIANT_UNROLL
    for (int f = 0; f < 4; f++)
        below[f] = (height[f][0] < 0) | (height[f][1] < 0) << 1 | (height[f][2] < 0) << 2 | (height[f][3] < 0) << 3;
}

/* Return whether a plane through an edge separates a and b, from the heights over its two faces. */
PLIANT_INLINE int pliant_overlap_edge(const double f[4], const double g[4], int below_f, int below_g)
{
    int reaches = below_f & below_g;
    if (reaches) return 0;
    for (int p = 0; p < 4; p++) {
        if (!(below_f >> p & 1)) continue;
        /* a segment from below f only to below g only passes through the wedge or around it */
        for (int q = 0; q < 4; q++)
            reaches |= (below_g >> q & 1) & (g[p] * f[q] < f[p] * g[q]);
    }
    return !reaches;
}

/* Return whether two tetrahedra overlap. a, b: x, y, z of the four corners */
PLIANT_INLINE int pliant_tets_overlap(double a[3][4], double b[3][4])
{
    double height[4][4], back[4][4];
    int below[4], below_back[4];
    if (!pliant_overlap_faces(a, b, height) || !pliant_overlap_faces(b, a, back)) return 0;
    pliant_overlap_below(height, below);
    pliant_overlap_below(back, below_back);
    if ((below[0] & below[1] & below[2] & below[3]) || (below_back[0] & below_back[1] & below_back[2] & below_back[3]))
        return 1;
    PLIANT_UNROLL
    for (int f = 0; f < 3; f++) {
        PLIANT_UNROLL
        for (int g = f + 1; g < 4; g++)
            if (pliant_overlap_edge(height[f], height[g], below[f], below[g])) return 0;
    }
    return 1;
}

#endif
