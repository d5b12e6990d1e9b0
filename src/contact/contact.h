/* Contact: where tissue touches instruments, ground, or tissue, and with what force.
 *
 * Who finds contacts (shapes.h: rigid obstacles; tissue.h: tissue that meets tissue) writes them as points; who solves (fem/quasistatic,
 * fem/dynamics) reads these alone. At a point c the gap is
 *     g(x) = n'(sum_k w_k x_k - p),   g >= 0,   l_n >= 0,   g l_n = 0   (Signorini),   |l_t| <= mu l_n   (Coulomb),
 * where w are weights of fine nodes: of a point of the surface (sum 1) and, where tissue meets tissue, minus those of the other side (sum 0).
 * p is a point of the obstacle, which moves with it; n points out of it. */
#ifndef PLIANT_CONTACT_CONTACT_H
#define PLIANT_CONTACT_CONTACT_H

#include "base/inline.h"
#include "pliant/body.h"

#include <math.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_CONTACT_NODES = 16 }; /* of a corner of a surface within cubes and three others, four each (outside.h) */

/* What a point touches. */
typedef enum pliant_obstacle {
    PLIANT_OBSTACLE_TOOL,
    PLIANT_OBSTACLE_GROUND,
    PLIANT_OBSTACLE_TISSUE,
    PLIANT_OBSTACLE_ELEMENT /* none: an element keeps its least volume (contact/advance/volume.h) */
} pliant_obstacle;

typedef struct pliant_contact_point {
    /* INPUT, by who finds it */
    uint64_t feature;       /* of the surface (node, edge, triangle) and of the obstacle: the same from step to step while it is the same contact */
    pliant_obstacle kind;
    int32_t tool, part;     /* of PLIANT_OBSTACLE_TOOL; -1: another */
    int32_t count;          /* of the nodes, all different */
    int32_t node[PLIANT_CONTACT_NODES];   /* fine */
    double weight[PLIANT_CONTACT_NODES];
    double normal[3];       /* unit, out of the obstacle: tissue is pushed along it */
    double place[3];        /* p, where the obstacle is at the end of the step [m] */
    double drift[3];        /* how far p moved in the step, as a point of the obstacle [m] */
    double area;            /* of the surface that it stands for, at rest [m^2] */
    double friction;        /* Coulomb's mu */
    int32_t jaw;            /* of a tool: 1 or -1 on what turns with half of its jaws' angle, or with minus half; 0: neither */
    /* OUTPUT, by who solves; kept from step to step for the same feature */
    double force[3];        /* on the tissue at the weights' point [N] */
    double anchor[3];       /* where it sticks on the obstacle, less p [m] */
    bool begun;             /* false: a new contact; it sticks where the tissue is before the step, moved with the obstacle */
} pliant_contact_point;

/* All points of a step, ascending by feature. */
typedef struct pliant_contacts {
    int32_t count, room;
    pliant_contact_point *point;
} pliant_contacts;

/* How deep tissue is in what it touches as a step ends, of how deep it is as the step begins; 0 or less [m].
 *  @param recovery at most this comes out [m]
 *  @param stays    and at least this share is left: where tissue swings, what puts it out at once gives it energy */
PLIANT_INLINE double pliant_contact_left(double gap, double recovery, double stays) { return fmin(fmin(gap + recovery, gap * stays), 0.0); }

/* Who finds contacts: what a point takes over from that of the same feature in the step before. Its anchor goes with the obstacle, and other
 * weights than before are no slip.  positions: (fine nodes x 3) that the step begins with [m] */
PLIANT_INLINE void pliant_contact_carry(const pliant_contact_point *before, const double *positions, pliant_contact_point *now)
{
    for (int d = 0; d < 3; d++) {
        double moved = before->place[d] + now->drift[d] - now->place[d];
        for (int32_t k = 0; k < now->count; k++) moved += now->weight[k] * positions[3 * now->node[k] + d];
        for (int32_t k = 0; k < before->count; k++) moved -= before->weight[k] * positions[3 * before->node[k] + d];
        now->anchor[d] = before->anchor[d] + moved;
        now->force[d] = before->force[d];
    }
    now->begun = before->begun;
}

#ifdef __cplusplus
}
#endif
#endif
