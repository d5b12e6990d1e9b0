/* Contact points of tissue on tissue while the nodes move. */
#ifndef PLIANT_CONTACT_UPDATE_SIDES_H
#define PLIANT_CONTACT_UPDATE_SIDES_H

#include "contact/contact.h"

#include <math.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Kinds of points: the top byte of their features. Points are listed in this order. */
enum {
    PLIANT_TISSUE_NODE = 240,
    PLIANT_TISSUE_EDGE = 241,
    PLIANT_TISSUE_CORNER = 242 /* without inertia: node and node, or node and edge */,
    PLIANT_TISSUE_CUT = 243,
    PLIANT_TISSUE_SLID = 244 /* sides of a cut that have slid along each other */,
    PLIANT_TISSUE_SLOWED = 245 /* contact/response: paper */,
    PLIANT_PIECE_ON_WALL = 246 /* quasi-static (fem/rigid) */,
    PLIANT_ELEMENT_VOLUME = 247 /* volume bound of an element (contact/volume/volume_bound.h) */
};

/* How the two sides of a point face each other: two directions in their common plane, and the gap along its normal. */
typedef struct pliant_facing {
    int32_t from[2], to[2];    /* indices into the point's nodes: ends of the directions */
    double along[2][3], gap;   /* [m] */
} pliant_facing;

/* Return whether a point's nodes are corners of the surface. The nodes of cut faces belong to fragments. */
PLIANT_INLINE bool pliant_contact_is_of_corners(const pliant_contact_point *point)
{
    const int kind = (int)(point->feature >> 56);
    return kind == PLIANT_TISSUE_NODE || kind == PLIANT_TISSUE_EDGE || kind == PLIANT_TISSUE_CORNER;
}

/* Update a point to the nearest points of its two sides at the given positions of its four nodes. The sides are a
 * node and a triangle, or two edges. The normal is the triangle's normal, or the common normal of the edges. Then
 * normal times weights is the gradient of the gap. A force along it applies no torque to either side, and sliding
 * adds no energy. Points of cut faces stay unchanged.
 * @return whether the point is of such a kind; false: the point is unchanged */
PLIANT_INLINE bool pliant_contact_update_sides(double x[4][3], pliant_contact_point *point, pliant_facing *out)
{
    const int kind = (int)(point->feature >> 56);
    const bool edges = kind == PLIANT_TISSUE_EDGE;
    double normal[3], to[3], square = 0, sign = 0, out_of = 0, fraction[2] = {0, 0};
    if (point->kind != PLIANT_OBSTACLE_TISSUE || point->count != 4 || (kind != PLIANT_TISSUE_NODE && !edges))
        return false;
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
        fraction[0] += normal[d] * (to[a] * w[b] - to[b] * w[a]) / square;
        fraction[1] += normal[d] * (u[a] * to[b] - u[b] * to[a]) / square;
    }
    for (int d = 0; d < 3; d++) {
        point->normal[d] = normal[d] * (sign < 0 ? -1 : 1) / sqrt(square);
        point->place[d] = out_of * point->normal[d];
        out->gap += to[d] * point->normal[d];
    }
    point->weight[0] = edges ? 1 + fraction[0] : 1;
    point->weight[1] = edges ? -fraction[0] : fraction[0] + fraction[1] - 1;
    point->weight[2] = edges ? fraction[1] - 1 : -fraction[0];
    point->weight[3] = -fraction[1];
    return true;
}

/* Compute the normal forces that balance the torque of a tangential force. A tangential force acts on the first
 * side and its opposite on the second, with the gap as lever. The result is a force along the normal at both ends
 * of each direction. */
PLIANT_INLINE void pliant_facing_balance_torque(const pliant_facing *facing, const double normal[3],
                                                const double force[3], double out[2])
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

/* Return whether a point belongs to contact/response: paper: a node of an overlapping tetrahedron. It has one node
 * and no normal. Its friction is the fraction of the node's motion that is removed in each sub-step. */
PLIANT_INLINE bool pliant_contact_slows(const pliant_contact_point *point)
{
    return point->kind == PLIANT_OBSTACLE_TISSUE && (int)(point->feature >> 56) == PLIANT_TISSUE_SLOWED;
}

#ifdef __cplusplus
}
#endif
#endif
