/* Points of tissue on tissue while nodes move. */
#ifndef PLIANT_CONTACT_FOLLOW_H
#define PLIANT_CONTACT_FOLLOW_H

#include "contact/contact.h"

#include <math.h>

#ifdef __cplusplus
extern "C" {
#endif

/* kinds of points: the top byte of their features */
enum { PLIANT_TISSUE_NODE = 240, PLIANT_TISSUE_EDGE = 241, PLIANT_TISSUE_CUT = 242, PLIANT_TISSUE_SLID = 243 /* sides of a cut that were not one */,
       PLIANT_TISSUE_SLOWED = 244 /* contact/response: paper */, PLIANT_PIECE_ON_WALL = 245 /* quasi-static (fem/rigid) */,
       PLIANT_ELEMENT_VOLUME = 246 /* an element that is small (contact/advance/volume.h) */ };

/* Where the two sides of a point face each other: directions in the face that they have in common, and how far apart they are along its normal. */
typedef struct pliant_facing {
    int32_t from[2], to[2];    /* ends of the directions, of the point's nodes */
    double along[2][3], gap;   /* [m] */
} pliant_facing;

/* A point moves to where its two sides face each other now, at the positions of its four nodes: a node over a triangle, along the normal of that, or two
 * edges, along what is normal to both. The gap's gradient is the normal then, times the weights, and a force along it turns neither side and is given no
 * energy by their sliding. Sides of a cut stay as they were found. @return whether the point is of that kind; false: the point stays as it was */
PLIANT_INLINE bool pliant_contact_follow(double x[4][3], pliant_contact_point *point, pliant_facing *out)
{
    const int kind = (int)(point->feature >> 56);
    const bool edges = kind == PLIANT_TISSUE_EDGE;
    double normal[3], to[3], square = 0, sign = 0, out_of = 0, share[2] = {0, 0};
    if (point->kind != PLIANT_OBSTACLE_TISSUE || point->count != 4 || (kind != PLIANT_TISSUE_NODE && !edges)) return false;
    out->from[0] = edges ? 0 : 1;
    out->from[1] = edges ? 2 : 1;
    out->to[0] = edges ? 1 : 2;
    out->to[1] = 3;
    out->gap = 0;
    for (int d = 0; d < 3; d++) {
        for (int k = 0; k < 2; k++) out->along[k][d] = x[out->to[k]][d] - x[out->from[k]][d];
        to[d] = x[0][d] - x[out->from[1]][d];
    }
    const double *u = out->along[0], *w = out->along[1];
    for (int d = 0; d < 3; d++) {
        normal[d] = u[(d + 1) % 3] * w[(d + 2) % 3] - u[(d + 2) % 3] * w[(d + 1) % 3];
        square += normal[d] * normal[d];
        sign += normal[d] * point->normal[d];
        out_of += point->place[d] * point->normal[d];
    }
    if (!(square > 0)) return false;
    for (int d = 0; d < 3; d++) {
        const int a = (d + 1) % 3, b = (d + 2) % 3;
        share[0] += normal[d] * (to[a] * w[b] - to[b] * w[a]) / square;
        share[1] += normal[d] * (u[a] * to[b] - u[b] * to[a]) / square;
    }
    for (int d = 0; d < 3; d++) {
        point->normal[d] = normal[d] * (sign < 0 ? -1 : 1) / sqrt(square);
        point->place[d] = out_of * point->normal[d];
        out->gap += to[d] * point->normal[d];
    }
    point->weight[0] = edges ? 1 + share[0] : 1;
    point->weight[1] = edges ? -share[0] : share[0] + share[1] - 1;
    point->weight[2] = edges ? share[1] - 1 : -share[0];
    point->weight[3] = -share[1];
    return true;
}

/* A force t across the normal at the first side, and against it at the second, turns both, by how far apart they are. What turns them back, along the
 * normal: from the ends of each direction, as much as this. It is what t does at the second side's point, raised along the normal to the first side's. */
PLIANT_INLINE void pliant_facing_turn_back(const pliant_facing *facing, const double normal[3], const double force[3], double out[2])
{
    const double *u = facing->along[0], *w = facing->along[1];
    double whole = 0;
    out[0] = out[1] = 0;
    for (int d = 0; d < 3; d++) {
        const int a = (d + 1) % 3, b = (d + 2) % 3;
        whole += normal[d] * (u[a] * w[b] - u[b] * w[a]);
        out[0] += normal[d] * (force[a] * w[b] - force[b] * w[a]);
        out[1] += normal[d] * (u[a] * force[b] - u[b] * force[a]);
    }
    for (int k = 0; k < 2; k++) out[k] *= facing->gap / whole;
}

/* Whether a point is a node of a tetrahedron that overlaps, by the paper's rule: it has one node, no normal, and in place of friction the part of its way
 * in a sub-step that is taken away. */
PLIANT_INLINE bool pliant_contact_slows(const pliant_contact_point *point)
{
    return point->kind == PLIANT_OBSTACLE_TISSUE && (int)(point->feature >> 56) == PLIANT_TISSUE_SLOWED;
}

#ifdef __cplusplus
}
#endif
#endif
