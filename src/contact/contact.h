/* Contact points of tissue with instruments, ground and tissue.
 *
 * Collision detection (part_contacts.h: rigid parts; tissue.h: tissue on tissue) writes contact points. The solvers
 * (fem/quasistatic, fem/dynamics) read only these points. The conditions at a contact point are:
 *     g(x) = n'(sum_k w_k x_k - p),   g >= 0,   l_n >= 0,   g l_n = 0   (Signorini),   |l_t| <= mu l_n   (Coulomb)
 * g is the gap. The weights w belong to fine nodes. They describe a point of the surface (sum 1). For tissue on
 * tissue the weights of the other side are subtracted (sum 0). p is a point of the obstacle and moves with it. The
 * normal n points out of the obstacle. */
#ifndef PLIANT_CONTACT_CONTACT_H
#define PLIANT_CONTACT_CONTACT_H

#include "base/inline.h"
#include "pliant/body.h"

#include <math.h>

#ifdef __cplusplus
extern "C" {
#endif

/* worst case: a corner of a surface inside cubes and three others, four nodes each (contact_surface.h) */
enum { PLIANT_CONTACT_NODES = 16 };

/* The obstacle of a contact point. */
typedef enum pliant_obstacle {
    PLIANT_OBSTACLE_TOOL,
    PLIANT_OBSTACLE_GROUND,
    PLIANT_OBSTACLE_TISSUE,
    PLIANT_OBSTACLE_ELEMENT /* no obstacle: the volume bound of an element (contact/volume/volume_bound.h) */
} pliant_obstacle;

typedef struct pliant_contact_point {
    /* INPUT, written by collision detection */
    /* identifies the feature of the surface (node, edge, triangle) and the obstacle; constant while the contact
     * lasts */
    uint64_t feature;
    pliant_obstacle kind;
    int32_t tool, part;     /* for PLIANT_OBSTACLE_TOOL; otherwise -1 */
    int32_t count;          /* number of nodes, all different */
    int32_t node[PLIANT_CONTACT_NODES];   /* of the fine mesh */
    double weight[PLIANT_CONTACT_NODES];
    double on_feature[3];   /* weights of the corners of the feature, for a rigid part; 0: unknown */
    double normal[3];       /* unit vector out of the obstacle; the contact force on the tissue points along it */
    double place[3];        /* p at the end of the step [m] */
    double drift[3];        /* motion of p in the step, as a point of the obstacle [m] */
    double area;            /* area of the surface that the point represents, at rest [m^2] */
    double least_volume;    /* for PLIANT_OBSTACLE_ELEMENT: six times the volume that the element keeps [m^3] */
    double friction;        /* coefficient of friction mu */
    int32_t jaw; /* for a tool: 1 or -1 on a jaw that turns by plus or minus half the jaw angle; otherwise 0 */
    /* OUTPUT, written by the solver; kept from step to step for the same feature */
    double force[3];  /* on the tissue, at the weighted point [N] */
    double anchor[3]; /* sticking position on the obstacle, relative to p [m] */
    bool was_pressed; /* false: sticks at the tissue's position before the step, moved with the obstacle */
} pliant_contact_point;

/* All contact points of a step, sorted by feature. */
typedef struct pliant_contacts {
    int32_t count, capacity;
    pliant_contact_point *point;
} pliant_contacts;

/* Add a weight to a node of a point. A new node is appended. */
PLIANT_INLINE void pliant_contact_add_weight(int32_t *count, int32_t *nodes, double *weights, int32_t node,
                                             double weight)
{
    int32_t k = 0;
    while (k < *count && nodes[k] != node) k++;
    if (k == *count) {
        nodes[k] = node;
        weights[k] = 0.0;
        ++*count;
    }
    weights[k] += weight;
}

/* Return the permitted gap at the end of a step, which is 0 or less [m].
 * @param gap at the start of the step, negative inside the obstacle [m]
 * @param recovery maximum reduction of the penetration depth in the step [m]
 * @param remaining_depth_fraction fraction of the penetration depth that remains at least; with inertia, a sudden
 *   removal would add energy */
PLIANT_INLINE double pliant_contact_permitted_gap(double gap, double recovery, double remaining_depth_fraction)
{
    return fmin(fmin(gap + recovery, gap * remaining_depth_fraction), 0.0);
}

/* Copy force and anchor from the previous point of the same feature. The anchor moves with the obstacle. A change
 * of the weights is not counted as slip.
 * @param positions (fine nodes x 3) at the start of the step [m] */
PLIANT_INLINE void pliant_contact_warm_start(const pliant_contact_point *before, const double *positions,
                                             pliant_contact_point *now)
{
    for (int d = 0; d < 3; d++) {
        double moved = before->place[d] + now->drift[d] - now->place[d];
        for (int32_t k = 0; k < now->count; k++) moved += now->weight[k] * positions[3 * now->node[k] + d];
        for (int32_t k = 0; k < before->count; k++) moved -= before->weight[k] * positions[3 * before->node[k] + d];
        now->anchor[d] = before->anchor[d] + moved;
        now->force[d] = before->force[d];
    }
    now->was_pressed = before->was_pressed;
}

#ifdef __cplusplus
}
#endif
#endif
