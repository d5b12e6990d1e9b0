/* A contact point (contact/contact.h) in a sub-step, shared by CPU and kernels. Points are corrected one after the
 * other, after a sub-step without contact. Points without common nodes can be processed in any order. */
#ifndef PLIANT_FEM_DYNAMICS_SUBSTEP_CONTACT_H
#define PLIANT_FEM_DYNAMICS_SUBSTEP_CONTACT_H

#include "contact/detect/update_sides.h"
#include "fem/dynamics/substep.h"

#ifdef __cplusplus
extern "C" {
#endif

/* State of a contact during a frame. */
typedef struct pliant_tled_contact {
    double weighted_inverse_mass;                          /* sum of squared weights divided by masses [1/kg] */
    /* Penetration depth at the start of the frame; it is removed during the frame [m]. */
    double deep;
    double anchor[3];                       /* present sticking position [m] */
    /* Impulse by which the sub-step before has separated two sides; the next sub-step subtracts it [kg m]. */
    double owed[3];
    /* Sum over the frame; in dynamic relaxation the last force [N]. */
    double force[3];
    bool pressed;                           /* there was contact in the last sub-step */
} pliant_tled_contact;

/* Arrays indexed by the points' node numbers. Each has three numbers per node, except the masses. */
typedef struct pliant_tled_contact_nodes {
    const double *rest, *inverse_mass;
    double *u, *d, *acceleration;
} pliant_tled_contact_nodes;

typedef struct pliant_tled_contact_timing {
    double factor;             /* A divided by the inverse mass [s^2] */
    double done, part; /* fraction of this part of the frame: up to the end of this sub-step, and of this sub-step */
    bool still;                /* dynamic relaxation */
    bool first, last;          /* first or last sub-step of the part */
} pliant_tled_contact_timing;

/* Return the time data of a sub-step. substeps: in this part of the frame; made: sub-steps before this one. */
PLIANT_INLINE pliant_tled_contact_timing pliant_tled_contact_time(bool still, double factor, int32_t substeps,
                                                                  int32_t made)
{
    pliant_tled_contact_timing time;
    time.factor = factor;
    time.done = still ? 1 : (double)(made + 1) / substeps;
    time.part = still ? 1 : 1.0 / substeps;
    time.still = still;
    time.first = made == 0;
    time.last = made + 1 == substeps;
    return time;
}

PLIANT_INLINE void pliant_tled_contact_weighted_sum(const pliant_contact_point *point, const double *v, double out[3])
{
    for (int d = 0; d < 3; d++) out[d] = 0;
    for (int k = 0; k < point->count; k++)
        for (int d = 0; d < 3; d++) out[d] += point->weight[k] * v[3 * point->node[k] + d];
}

/* Compute the position y of the point. */
PLIANT_INLINE void pliant_tled_contact_position(const pliant_contact_point *point, const double *rest, const double *u,
                                                double out[3])
{
    double moved[3];
    pliant_tled_contact_weighted_sum(point, rest, out);
    pliant_tled_contact_weighted_sum(point, u, moved);
    for (int d = 0; d < 3; d++) out[d] += moved[d];
}

/* For tissue against tissue, update the point to the present opposite position. This change is not slip. Use positions
 * at the start of the sub-step, like the elastic forces: a push along one line then has no moment.
 * @return False if the point has no two facing sides; facing is unchanged. */
PLIANT_INLINE bool pliant_tled_contact_update_sides(const pliant_tled_contact_nodes *nodes, pliant_contact_point *point,
                                                    pliant_tled_contact *contact, pliant_facing *facing)
{
    double x[4][3], before[3], after[3];
    if (point->kind != PLIANT_OBSTACLE_TISSUE || point->count != 4) return false;
    for (int k = 0; k < 4; k++)
        for (int d = 0; d < 3; d++)
            x[k][d] = nodes->rest[3 * point->node[k] + d] + nodes->u[3 * point->node[k] + d] -
                      nodes->d[3 * point->node[k] + d];
    pliant_tled_contact_position(point, nodes->rest, nodes->u, before);
    if (!pliant_contact_update_sides(x, point, facing)) return false;
    pliant_tled_contact_position(point, nodes->rest, nodes->u, after);
    contact->weighted_inverse_mass = 0;
    for (int k = 0; k < 4; k++)
        contact->weighted_inverse_mass += point->weight[k] * point->weight[k] * nodes->inverse_mass[point->node[k]];
    for (int d = 0; d < 3; d++) contact->anchor[d] += after[d] - before[d];
    return true;
}

/* Move a node by its part of a change of position and of increment. */
PLIANT_INLINE void pliant_tled_contact_move_node(const pliant_tled_contact_nodes *nodes, double factor, int node,
                                                 double weight, const double place[3], const double increment[3])
{
    const double fraction = weight * nodes->inverse_mass[node];
    for (int d = 0; d < 3; d++) {
        nodes->u[3 * node + d] += fraction * place[d];
        nodes->d[3 * node + d] += fraction * increment[d];
        nodes->acceleration[3 * node + d] += fraction * increment[d] / factor;
    }
}

/* Apply an impulse between facing sides, without any moment [kg m]. */
PLIANT_INLINE void pliant_tled_contact_apply_impulse(const pliant_tled_contact_nodes *nodes, double factor,
                                                     const pliant_contact_point *point, const pliant_facing *facing,
                                                     const double impulse[3])
{
    double back[2];
    for (int k = 0; k < point->count; k++)
        pliant_tled_contact_move_node(nodes, factor, point->node[k], point->weight[k], impulse, impulse);
    pliant_facing_balance_torque(facing, point->normal, impulse, back);
    for (int k = 0; k < 2; k++) {
        pliant_tled_contact_move_node(nodes, factor, point->node[facing->to[k]], back[k], point->normal, point->normal);
        pliant_tled_contact_move_node(nodes, factor, point->node[facing->from[k]], -back[k], point->normal,
                                      point->normal);
    }
}

/* Separate facing sides by an impulse. The next sub-step subtracts the velocity of this impulse. A shift without
 * impulse would change the angular momentum by the shift times the tangential velocity. In the last sub-step, the shift
 * is left to the next frame. */
PLIANT_INLINE void pliant_tled_contact_separate(const pliant_tled_contact_nodes *nodes,
                                                const pliant_tled_contact_timing *time,
                                                const pliant_contact_point *point, const pliant_facing *facing,
                                                const double push[3], const double shift[3],
                                                pliant_tled_contact *contact)
{
    double impulse[3];
    for (int d = 0; d < 3; d++) {
        if (!time->last) contact->owed[d] = shift[d] / contact->weighted_inverse_mass;
        impulse[d] = push[d] / contact->weighted_inverse_mass + contact->owed[d];
    }
    pliant_tled_contact_apply_impulse(nodes, time->factor, point, facing, impulse);
}

/* Apply contact/response paper ([C] 5.2): a force against the node's motion that removes a fraction of the motion.
 * Return its load. */
PLIANT_INLINE double pliant_tled_contact_slow_down(const pliant_tled_contact_nodes *nodes,
                                                   const pliant_tled_contact_timing *time,
                                                   const pliant_contact_point *point, pliant_tled_contact *contact)
{
    const int node = point->node[0];
    double load = 0;
    contact->pressed = true;
    for (int d = 0; d < 3; d++) {
        const double push = -point->friction * nodes->d[3 * node + d],
                     force = push / (time->factor * contact->weighted_inverse_mass);
        nodes->u[3 * node + d] += push;
        nodes->d[3 * node + d] += push;
        nodes->acceleration[3 * node + d] += push / time->factor;
        contact->force[d] += force;
        load += contact->weighted_inverse_mass * force * force;
    }
    return load;
}

/* Correct one point after a sub-step. Return its load, as PLIANT_SUM_LOAD. */
PLIANT_INLINE double pliant_tled_contact_correct(const pliant_tled_contact_nodes *nodes,
                                                 const pliant_tled_contact_timing *time, pliant_contact_point *point,
                                                 pliant_tled_contact *contact)
{
    double y[3], moved[3], slip[3], push[3], shift[3], gap = contact->deep * (1 - time->done), along = 0, load = 0;
    pliant_facing facing = {{0, 0}, {0, 0}, {{0, 0, 0}, {0, 0, 0}}, 0};
    const bool struck = pliant_tled_contact_update_sides(nodes, point, contact, &facing) && !time->still;
    if (!(contact->weighted_inverse_mass > 0)) return 0;
    if (pliant_contact_slows(point)) return pliant_tled_contact_slow_down(nodes, time, point, contact);
    for (int d = 0; d < 3; d++) {
        shift[d] = -contact->owed[d];
        contact->owed[d] = 0;
    }
    if (struck) pliant_tled_contact_apply_impulse(nodes, time->factor, point, &facing, shift);
    pliant_tled_contact_position(point, nodes->rest, nodes->u, y);
    pliant_tled_contact_weighted_sum(point, nodes->d, moved);
    for (int d = 0; d < 3; d++) {
        moved[d] -= time->part * point->drift[d] * (time->still ? 0 : 1);
        contact->anchor[d] += time->still && !time->first ? 0 : time->part * point->drift[d];
        gap += point->normal[d] * (y[d] - point->place[d] + (1 - time->done) * point->drift[d]);
        slip[d] = y[d] - contact->anchor[d];
    }
    for (int d = 0; d < 3; d++) along += point->normal[d] * slip[d];
    for (int d = 0; d < 3; d++) slip[d] -= along * point->normal[d];
    contact->pressed = pliant_substep_press(point->normal, point->friction, gap, moved, slip, push, shift);
    for (int d = 0; d < 3; d++) {
        if (time->still) contact->force[d] = 0;
        if (!contact->pressed) contact->anchor[d] = y[d];
    }
    if (!contact->pressed) return 0;
    if (struck) pliant_tled_contact_separate(nodes, time, point, &facing, push, shift, contact);
    for (int d = 0; d < 3; d++) {
        if (time->still) { /* in relaxation there is no physical velocity to preserve */
            push[d] += shift[d];
            shift[d] = 0;
        }
        const double force = push[d] / (time->factor * contact->weighted_inverse_mass);
        contact->force[d] += force;
        contact->anchor[d] += slip[d]; /* the remaining slip */
        load += contact->weighted_inverse_mass * force * force;
        shift[d] = (push[d] + shift[d]) / contact->weighted_inverse_mass;
        push[d] /= contact->weighted_inverse_mass;
    }
    for (int k = 0; !struck && k < point->count; k++)
        pliant_tled_contact_move_node(nodes, time->factor, point->node[k], point->weight[k], shift, push);
    return load;
}

#ifdef __cplusplus
}
#endif

#endif
