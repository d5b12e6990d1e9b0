/* A contact point (contact/contact.h) in a sub-step: what the CPU and kernels share. Points are put right one after the other, where a sub-step that
 * knew nothing of them has led; those that have no node in common may come in any order. */
#ifndef PLIANT_FEM_DYNAMICS_TOUCH_H
#define PLIANT_FEM_DYNAMICS_TOUCH_H

#include "contact/detect/follow.h"
#include "fem/dynamics/substep.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A contact in a frame. */
typedef struct pliant_tled_touch {
    double answer;                          /* sum of squared weights over masses [1/kg] */
    double deep;                            /* in what it touches as the frame begins; comes out in its course [m] */
    double anchor[3];                       /* where it sticks now [m] */
    double owed[3];                         /* by which impulse the sub-step before has put two sides apart: the next one takes it back [kg m] */
    double force[3];                        /* summed over the frame; of dynamic relaxation the last one [N] */
    bool pressed;                           /* in the last sub-step */
} pliant_tled_touch;

/* By the numbers that points have of nodes; three numbers a node, but for the masses. */
typedef struct pliant_touch_nodes {
    const double *rest, *inverse_mass;
    double *u, *d, *acceleration;
} pliant_touch_nodes;

typedef struct pliant_touch_time {
    double factor;             /* A over the inverse mass [s^2] */
    double done, part;         /* of this part of the frame: at the end of this sub-step, by it */
    bool still;                /* dynamic relaxation */
    bool first, last;          /* of the part */
} pliant_touch_time;

/* substeps, made: of this part of the frame, and of these before this one */
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

/* y of the point */
PLIANT_INLINE void pliant_touch_place(const pliant_contact_point *point, const double *rest, const double *u, double out[3])
{
    double moved[3];
    pliant_touch_weigh(point, rest, out);
    pliant_touch_weigh(point, u, moved);
    for (int d = 0; d < 3; d++) out[d] += moved[d];
}

/* Tissue on tissue: the sides face each other elsewhere by now, which is no slip. By where the sub-step began, of which elastic forces are: there a push
 * along one line turns nothing. @return whether these are sides that face each other; false: facing is not written */
PLIANT_INLINE bool pliant_touch_follow(const pliant_touch_nodes *nodes, pliant_contact_point *point, pliant_tled_touch *touch, pliant_facing *facing)
{
    double x[4][3], before[3], after[3];
    if (point->kind != PLIANT_OBSTACLE_TISSUE || point->count != 4) return false;
    for (int k = 0; k < 4; k++)
        for (int d = 0; d < 3; d++) x[k][d] = nodes->rest[3 * point->node[k] + d] + nodes->u[3 * point->node[k] + d] - nodes->d[3 * point->node[k] + d];
    pliant_touch_place(point, nodes->rest, nodes->u, before);
    if (!pliant_contact_follow(x, point, facing)) return false;
    pliant_touch_place(point, nodes->rest, nodes->u, after);
    touch->answer = 0;
    for (int k = 0; k < 4; k++) touch->answer += point->weight[k] * point->weight[k] * nodes->inverse_mass[point->node[k]];
    for (int d = 0; d < 3; d++) touch->anchor[d] += after[d] - before[d];
    return true;
}

/* A node, by its share of what moves the place and of what moves the increment. */
PLIANT_INLINE void pliant_touch_move(const pliant_touch_nodes *nodes, double factor, int node, double weight, const double place[3], const double increment[3])
{
    const double share = weight * nodes->inverse_mass[node];
    for (int d = 0; d < 3; d++) {
        nodes->u[3 * node + d] += share * place[d];
        nodes->d[3 * node + d] += share * increment[d];
        nodes->acceleration[3 * node + d] += share * increment[d] / factor;
    }
}

/* An impulse between sides that face each other, which turns neither [kg m]. */
PLIANT_INLINE void pliant_touch_strike(const pliant_touch_nodes *nodes, double factor, const pliant_contact_point *point, const pliant_facing *facing,
                                       const double impulse[3])
{
    double back[2];
    for (int k = 0; k < point->count; k++) pliant_touch_move(nodes, factor, point->node[k], point->weight[k], impulse, impulse);
    pliant_facing_turn_back(facing, point->normal, impulse, back);
    for (int k = 0; k < 2; k++) {
        pliant_touch_move(nodes, factor, point->node[facing->to[k]], back[k], point->normal, point->normal);
        pliant_touch_move(nodes, factor, point->node[facing->from[k]], -back[k], point->normal, point->normal);
    }
}

/* Sides that face each other are put apart by an impulse, and the next sub-step takes back what speed that gave: what is shifted without any has a moment of
 * its own, the shift times the speed across it. As a frame ends, the shift is left to the next one. */
PLIANT_INLINE void pliant_touch_put_apart(const pliant_touch_nodes *nodes, const pliant_touch_time *time, const pliant_contact_point *point, const pliant_facing *facing,
                                          const double push[3], const double shift[3], pliant_tled_touch *touch)
{
    double impulse[3];
    for (int d = 0; d < 3; d++) {
        if (!time->last) touch->owed[d] = shift[d] / touch->answer;
        impulse[d] = push[d] / touch->answer + touch->owed[d];
    }
    pliant_touch_strike(nodes, time->factor, point, facing, impulse);
}

/* contact/response paper: [C] 5.2, a force against the node's own movement, as large as takes a part of that away. Returns its load. */
PLIANT_INLINE double pliant_touch_slow(const pliant_touch_nodes *nodes, const pliant_touch_time *time, const pliant_contact_point *point, pliant_tled_touch *touch)
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

/* One point after a sub-step. Returns its load, as PLIANT_SUM_LOAD. */
PLIANT_INLINE double pliant_touch_press(const pliant_touch_nodes *nodes, const pliant_touch_time *time, pliant_contact_point *point, pliant_tled_touch *touch)
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
        if (time->still) { /* no speed that must not grow, and what moves is not at rest */
            push[d] += shift[d];
            shift[d] = 0;
        }
        const double force = push[d] / (time->factor * touch->answer);
        touch->force[d] += force;
        touch->anchor[d] += slip[d]; /* what is left */
        load += touch->answer * force * force;
        shift[d] = (push[d] + shift[d]) / touch->answer;
        push[d] /= touch->answer;
    }
    for (int k = 0; !struck && k < point->count; k++) pliant_touch_move(nodes, time->factor, point->node[k], point->weight[k], shift, push);
    return load;
}

#ifdef __cplusplus
}
#endif

#endif
