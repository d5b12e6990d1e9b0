/* Whether two tetrahedra overlap, by separating planes (Ganovelli, Ponchio, Rocchini, A fast tetrahedron-tetrahedron overlap algorithm, Journal of
 * Graphics Tools 7(2), 2002). If there is a plane between them, there is one along a face of either, or through an edge of the first. Where an edge
 * of the first lies between the faces f and g, its inside is where both heights over them are negative: such a plane is there unless the second
 * reaches into that wedge.
 *
 * They overlap where their insides have a point in common: what touches, and what is flat, does not. Exact where coordinates are whole numbers
 * below 128, or such times a power of two; otherwise as rounding in double precision leaves it. Either may be turned inside out. */
#ifndef PLIANT_CONTACT_OVERLAP_H
#define PLIANT_CONTACT_OVERLAP_H

#include "base/inline.h"

/* Heights of the corners of b over the faces of a, face f opposite its corner f, outwards positive, times twice the area of the face.
 * inside: a bit for each corner that lies below. Returns whether none of the faces separates them. */
PLIANT_INLINE int pliant_overlap_faces(const double *a, const double *b, double height[4][4], int inside[4])
{
    double edge[3][3], normal[4][3], volume;
    for (int v = 0; v < 3; v++)
        for (int d = 0; d < 3; d++) edge[v][d] = a[3 * v + 3 + d] - a[d];
    PLIANT_UNROLL
    for (int f = 1; f < 4; f++) { /* through corner 0, inwards: of unturned ones positive at corner f */
        const double *u = edge[f % 3], *w = edge[(f + 1) % 3];
        normal[f][0] = u[1] * w[2] - u[2] * w[1];
        normal[f][1] = u[2] * w[0] - u[0] * w[2];
        normal[f][2] = u[0] * w[1] - u[1] * w[0];
    }
    volume = normal[1][0] * edge[0][0] + normal[1][1] * edge[0][1] + normal[1][2] * edge[0][2];
    if (volume == 0) return 0;
    const double sign = volume > 0 ? -1.0 : 1.0;
    PLIANT_UNROLL
    for (int d = 0; d < 3; d++) {
        for (int f = 1; f < 4; f++) normal[f][d] *= sign;
        normal[0][d] = -(normal[1][d] + normal[2][d] + normal[3][d]);
    }
    PLIANT_UNROLL
    for (int f = 3; f >= 0; f--) {
        const double *through = f > 0 ? a : a + 3;
        inside[f] = 0;
        for (int v = 0; v < 4; v++) {
            height[f][v] = normal[f][0] * (b[3 * v] - through[0]) + normal[f][1] * (b[3 * v + 1] - through[1]) + normal[f][2] * (b[3 * v + 2] - through[2]);
            inside[f] |= (height[f][v] < 0) << v;
        }
        if (inside[f] == 0) return 0;
    }
    return 1;
}

/* Whether there is a plane through an edge that has a on one side and b on the other, from heights over the faces beside it. */
PLIANT_INLINE int pliant_overlap_edge(const double f[4], const double g[4], int below_f, int below_g)
{
    if (below_f & below_g) return 0;
    for (int p = 0; p < 4; p++)
        for (int q = 0; q < 4; q++) /* from below f alone to below g alone: through the wedge, or around it */
            if ((below_f >> p & 1) && (below_g >> q & 1) && g[p] * f[q] < f[p] * g[q]) return 0;
    return 1;
}

/* @param a, b four corners each */
PLIANT_INLINE int pliant_tets_overlap(const double *a, const double *b)
{
    double height[4][4], back[4][4];
    int inside[4], back_inside[4];
    if (!pliant_overlap_faces(a, b, height, inside) || !pliant_overlap_faces(b, a, back, back_inside)) return 0;
    if ((inside[0] & inside[1] & inside[2] & inside[3]) || (back_inside[0] & back_inside[1] & back_inside[2] & back_inside[3])) return 1;
    PLIANT_UNROLL
    for (int f = 0; f < 3; f++) {
        PLIANT_UNROLL
        for (int g = f + 1; g < 4; g++)
            if (pliant_overlap_edge(height[f], height[g], inside[f], inside[g])) return 0;
    }
    return 1;
}

#endif
