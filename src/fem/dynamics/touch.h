/* A contact point (contact/contact.h) in a sub-step, shared by CPU and kernels. Points are corrected one after the
 * other, after a sub-step without contact. Points without common nodes can be processed in any order. */
#ifndef PLIANT_FEM_DYNAMICS_TOUCH_H
#define PLIANT_FEM_DYNAMICS_TOUCH_H

#include "contact/detect/follow.h"
#include "fem/dynamics/substep.h"

#ifdef __cplusplus
extern "C" {
#endif

/* State of a contact during a frame. */
typedef struct pliant_tled_touch {
    double answer;                          /* sum of squared weights divided by masses [1/kg] */
    /* Penetration depth at the start of the frame; it is removed during the frame [m]. */
    double deep;
    double anchor[3];                       /* present sticking position [m] */
    /* Impulse by which the sub-step before has separated two sides; the next sub-step subtracts it [kg m]. */
    double owed[3];
    /* Sum over the frame; in dynamic relaxation the last force [N]. */
    double force[3];
    bool pressed;                           /* there was contact in the last sub-step */
} pliant_tled_touch;

/* Arrays indexed by the points' node numbers. Each has three numbers per node, except the masses. */
typedef struct pliant_touch_nodes {
    const double *rest, *inverse_mass;
    double *u, *d, *acceleration;
} pliant_touch_nodes;

typedef struct pliant_touch_time {
    double factor;             /* A divided by the inverse mass [s^2] */
    double done, part; /* fraction of this part of the frame: up to the end of this sub-step, and of this sub-step */
    bool still;                /* dynamic relaxation */
    bool first, last;          /* first or last sub-step of the part */
} pliant_touch_time;

/* Return the time data of a sub-step. substeps: in this part of the frame; made: sub-steps before this one. */
PLIANT_INLINE pliant_touch_time pliant_touch_time_of(bool still, double factor, int32_t substeps, int32_t made)
{
    pliant_touch_time time;
    time.factor = factor;
    time.done = still ? 1 : (double)(made + 1) / substeps;
    time.part = still ? 1 : 1.0 / substeps;
    time.still = still;
    time.first = made == 0;
    time.last = made + 1 == substeps;
    return time;
}

PLIANT_INLINE void pliant_touch_weigh(const pliant_contact_point *point, const double *v, double out[3])
{
    for (int d = 0; d < 3; d++) out[d] = 0;
    for (int k = 0; k < point->count; k++)
        for (int d = 0; d < 3; d++) out[d] += point->weight[k] * v[3 * point->node[k] + d];
}

/* Compute the position y of the point. */
PLIANT_INLINE void pliant_touch_place(const pliant_contact_point *point, const double *rest, const double *u,
                                      double out[3])
{
    double moved[3];
    pliant_touch_weigh(point, rest, out);
    pliant_touch_weigh(point, u, moved);
    for (int d = 0; d < 3; d++) out[d] += moved[d];
}

/* For tissue against tissue, update the point to the present opposite position. This change is not slip. Use positions
 * at the start of the sub-step, like the elastic forces: a push along one line then has no moment.
 * @return False if the point has no two facing sides; facing is unchanged. */
PLIANT_INLINE bool pliant_touch_follow(const pliant_touch_nodes *nodes, pliant_contact_point *point,
                                       pliant_tled_touch *touch, pliant_facing *facing)
{
    double x[4][3], before[3], after[3];
    if (point->kind != PLIANT_OBSTACLE_TISSUE || point->count != 4) return false;
    for (int k = 0; k < 4; k++)
        for (int d = 0; d < 3; d++)
            x[k][d] = nodes->rest[3 * point->node[k] + d] + nodes->u[3 * point->node[k] + d] -
                      nodes->d[3 * point->node[k] + d];
    pliant_touch_place(point, nodes->rest, nodes->u, before);
    if (!pliant_contact_follow(x, point, facing)) return false;
    pliant_touch_place(point, nodes->rest, nodes->u, after);
    touch->answer = 0;
    for (int k = 0; k < 4; k++)
        touch->answer += point->weight[k] * point->weight[k] * nodes->inverse_mass[point->node[k]];
    for (int d = 0; d < 3; d++) touch->anchor[d] += after[d] - before[d];
    return true;
}

/* Move a node by its part of a change of position and of increment. */
PLIANT_INLINE void pliant_touch_move(const pliant_touch_nodes *nodes, double factor, int node, double weight,
                                     const double place[3], const double increment[3])
{
    const double share = weight * nodes->inverse_mass[node];
    for (int d = 0; d < 3; d++) {
        nodes->u[3 * node + d] += share * place[d];
        nodes->d[3 * node + d] += share * increment[d];
        nodes->acceleration[3 * node + d] += share * increment[d] / factor;
    }
}

/* Apply an impulse between facing sides, without any moment [kg m]. */
PLIANT_INLINE void pliant_touch_strike(const pliant_touch_nodes *nodes, double factor,
                                       const pliant_contact_point *point, const pliant_facing *facing,
                                       const double impulse[3])
{
    double back[2];
    for (int k = 0; k < point->count; k++)
        pliant_touch_move(nodes, factor, point->node[k], point->weight[k], impulse, impulse);
    pliant_facing_turn_back(facing, point->normal, impulse, back);
    for (int k = 0; k < 2; k++) {
        pliant_touch_move(nodes, factor, point->node[facing->to[k]], back[k], point->normal, point->normal);
        pliant_touch_move(nodes, factor, point->node[facing->from[k]], -back[k], point->normal, point->normal);
    }
}

/* Separate facing sides by an impulse. The next sub-step subtracts the velocity of this impulse. A shift without
 * impulse would change the angular momentum by the shift times the tangential velocity. In the last sub-step, the shift
 * is left to the next frame. */
PLIANT_INLINE void pliant_touch_put_apart(const pliant_touch_nodes *nodes, const pliant_touch_time *time,
                                          const pliant_contact_point *point, const pliant_facing *facing,
                                          const double push[3], const double shift[3], pliant_tled_touch *touch)
{
    double impulse[3];
    for (int d = 0; d < 3; d++) {
        if (!time->last) touch->owed[d] = shift[d] / touch->answer;
        impulse[d] = push[d] / touch->answer + touch->owed[d];
    }
    pliant_touch_strike(nodes, time->factor, point, facing, impulse);
}

/* Apply contact/response paper ([C] 5.2): a force against the node's motion that removes a fraction of the motion.
 * Return its load. */
PLIANT_INLINE double pliant_touch_slow(const pliant_touch_nodes *nodes, const pliant_touch_time *time,
                                       const pliant_contact_point *point, pliant_tled_touch *touch)
{
    const int node = point->node[0];
    double load = 0;
    touch->pressed = true;
    for (int d = 0; d < 3; d++) {
        const double push = -point->friction * nodes->d[3 * node + d], force = push / (time->factor * touch->answer);
        nodes->u[3 * node + d] += push;
        nodes->d[3 * node + d] += push;
        nodes->acceleration[3 * node + d] += push / time->factor;
        touch->force[d] += force;
        load += touch->answer * force * force;
    }
    return load;
}

/* Correct one point after a sub-step. Return its load, as PLIANT_SUM_LOAD. */
PLIANT_INLINE double pliant_touch_press(const pliant_touch_nodes *nodes, const pliant_touch_time *time,
                                        pliant_contact_point *point, pliant_tled_touch *touch)
{
    double y[3], moved[3], slip[3], push[3], shift[3], gap = touch->deep * (1 - time->done), along = 0, load = 0;
    pliant_facing facing = {{0, 0}, {0, 0}, {{0, 0, 0}, {0, 0, 0}}, 0};
    const bool struck = pliant_touch_follow(nodes, point, touch, &facing) && !time->still;
    if (!(touch->answer > 0)) return 0;
    if (pliant_contact_slows(point)) return pliant_touch_slow(nodes, time, point, touch);
    for (int d = 0; d < 3; d++) {
        shift[d] = -touch->owed[d];
        touch->owed[d] = 0;
    }
    if (struck) pliant_touch_strike(nodes, time->factor, point, &facing, shift);
    pliant_touch_place(point, nodes->rest, nodes->u, y);
    pliant_touch_weigh(point, nodes->d, moved);
    for (int d = 0; d < 3; d++) {
        moved[d] -= time->part * point->drift[d] * (time->still ? 0 : 1);
        touch->anchor[d] += time->still && !time->first ? 0 : time->part * point->drift[d];
        gap += point->normal[d] * (y[d] - point->place[d] + (1 - time->done) * point->drift[d]);
        slip[d] = y[d] - touch->anchor[d];
    }
    for (int d = 0; d < 3; d++) along += point->normal[d] * slip[d];
    for (int d = 0; d < 3; d++) slip[d] -= along * point->normal[d];
    touch->pressed = pliant_substep_press(point->normal, point->friction, gap, moved, slip, push, shift);
    for (int d = 0; d < 3; d++) {
        if (time->still) touch->force[d] = 0;
        if (!touch->pressed) touch->anchor[d] = y[d];
    }
    if (!touch->pressed) return 0;
    if (struck) pliant_touch_put_apart(nodes, time, point, &facing, push, shift, touch);
    for (int d = 0; d < 3; d++) {
        if (time->still) { /* in relaxation there is no physical velocity to preserve */
            push[d] += shift[d];
            shift[d] = 0;
        }
        const double force = push[d] / (time->factor * touch->answer);
        touch->force[d] += force;
        touch->anchor[d] += slip[d]; /* the remaining slip */
        load += touch->answer * force * force;
        shift[d] = (push[d] + shift[d]) / touch->answer;
        push[d] /= touch->answer;
    }
    for (int k = 0; !struck && k < point->count; k++)
        pliant_touch_move(nodes, time->factor, point->node[k], point->weight[k], shift, push);
    return load;
}

#ifdef __cplusplus
}
#endif

#endif
