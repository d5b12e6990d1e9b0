/* Points of tissue on tissue while nodes move. */
#ifndef PLIANT_CONTACT_FOLLOW_H
#define PLIANT_CONTACT_FOLLOW_H

#include "contact/contact.h"

#ifdef __cplusplus
extern "C" {
#endif

/* kinds of points: the top byte of their features */
enum { PLIANT_TISSUE_NODE = 240, PLIANT_TISSUE_EDGE = 241, PLIANT_TISSUE_CUT = 242, PLIANT_TISSUE_SLID = 243 /* sides of a cut that were not one */,
       PLIANT_TISSUE_SLOWED = 244 /* contact/response: paper */, PLIANT_PIECE_ON_WALL = 245 /* quasi-static (fem/falling) */ };

/* A point moves to where its two sides face each other now, along its normal, at the positions of its four nodes: a node over a triangle, or two edges.
 * The force then acts along one line on both, and turns neither. Sides of a cut stay as they were found. @return whether it is another one now */
PLIANT_INLINE bool pliant_contact_follow(double x[4][3], pliant_contact_point *point)
{
    const int kind = (int)(point->feature >> 56);
    const bool edges = kind == PLIANT_TISSUE_EDGE;
    double u[3], w[3], to[3], whole = 0, s = 0, t = 0;
    const double least = 0.02; /* of an edge: what rests stays as it is */
    if (point->kind != PLIANT_OBSTACLE_TISSUE || point->count != 4 || (kind != PLIANT_TISSUE_NODE && !edges)) return false;
    for (int d = 0; d < 3; d++) { /* edges: 0 to 1 and 2 to 3; a node: 1 to 2 and 1 to 3 */
        u[d] = edges ? x[1][d] - x[0][d] : x[2][d] - x[1][d];
        w[d] = x[3][d] - (edges ? x[2][d] : x[1][d]);
        to[d] = x[0][d] - (edges ? x[2][d] : x[1][d]);
    }
    for (int d = 0; d < 3; d++) {
        const int a = (d + 1) % 3, b = (d + 2) % 3;
        whole += point->normal[d] * (u[a] * w[b] - u[b] * w[a]);
        s += point->normal[d] * (to[a] * w[b] - to[b] * w[a]);
        t += point->normal[d] * (u[a] * to[b] - u[b] * to[a]);
    }
    if (whole == 0) return false;
    s /= whole;
    t /= whole;
    const double off_s = edges ? -s - point->weight[1] : -s - point->weight[2], off_t = -t - point->weight[3];
    if (off_s * off_s + off_t * off_t < least * least) return false;
    if (edges) {
        point->weight[0] = 1 + s;
        point->weight[1] = -s;
        point->weight[2] = -(1 - t);
    } else {
        point->weight[1] = -(1 - s - t);
        point->weight[2] = -s;
    }
    point->weight[3] = -t;
    return true;
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
