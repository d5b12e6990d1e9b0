/* A contact point (contact/contact.h) in a sub-step, shared by CPU and kernels. Points are corrected after a sub-step
 * without contact. Points without common nodes can be processed in any order.
 *
 * Projected Gauss-Seidel solves for the impulses p of all points together (Moreau, Comput. Methods Appl. Mech. Eng.
 * 177:329, 1999). Central differences change their conserved energy by the sum of p (d + d-) / 2 h^2, with the
 * increments d- and d before and after the impulses. An obstacle that moves by v in the sub-step does the work
 * p v / h^2. The remaining terms are p (d + d- - 2 v) / 2 h^2. An impulse stops a point at its gap, or returns it to
 * the depth of the sub-step before, so at convergence no term is positive. A penetration is then removed by a shift of
 * positions. It costs the energy shift times resistance, which contacts must have dissipated before. Contact therefore
 * adds no energy except the work of tools. In dynamic relaxation, points are corrected one after the other. */
#ifndef PLIANT_FEM_DYNAMICS_SUBSTEP_CONTACT_H
#define PLIANT_FEM_DYNAMICS_SUBSTEP_CONTACT_H

#include "contact/detect/update_sides.h"
#include "contact/volume/volume_rules.h"
#include "fem/dynamics/substep.h"

#ifdef __cplusplus
extern "C" {
#endif

/* State of a contact during a frame. */
typedef struct pliant_tled_contact {
    double weighted_inverse_mass;                          /* sum of squared weights divided by masses [1/kg] */
    /* Penetration depth at the start of the frame; it is removed during the frame [m]. */
    double initial_depth;
    double anchor[3];                       /* present sticking position [m] */
    /* Impulse by which the sub-step before has separated two sides; the next sub-step subtracts it [kg m]. */
    double separation_impulse[3];
    /* Sum over the frame; in dynamic relaxation the last force [N]. */
    double force[3];
    /* Points that are solved together: */
    double impulse[3];                      /* of the last sub-step [kg m] */
    double before[3];                       /* increment of the sub-step before, relative to the obstacle [m] */
    double inward;                          /* largest allowed normal increment towards the obstacle [m] */
    double resistance;                      /* force of the tissue against a shift along the normal [N] */
    double tolerance;                       /* smallest change of the impulse that needs another pass [kg m] */
    double energy;                          /* available for shifts [J] */
    pliant_facing facing;
    bool has_sides;  /* facing is valid */
    bool is_pressed; /* there was contact in the last sub-step */
} pliant_tled_contact;

/* Maximum number of passes over all points. Without tools, impulses of the last sub-step are the start of the next one,
 * so the error at rest vanishes. */
enum { PLIANT_TLED_CONTACT_PASSES = 32 };

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

/* Update the point of an element to the present height over its face. back: 1: at the start of the sub-step; 0: at its
 * end */
PLIANT_INLINE void pliant_tled_contact_update_height(const pliant_tled_contact_nodes *nodes, double back,
                                                     pliant_contact_point *point, pliant_tled_contact *contact)
{
    double x[4][3];
    if (point->kind != PLIANT_OBSTACLE_ELEMENT) return;
    for (int k = 0; k < 4; k++)
        for (int d = 0; d < 3; d++) {
            const int at = 3 * point->node[k] + d;
            x[k][d] = nodes->rest[at] + nodes->u[at] - back * nodes->d[at];
        }
    if (!pliant_volume_set_height(x, point)) return;
    contact->weighted_inverse_mass = 0;
    for (int k = 0; k < 4; k++)
        contact->weighted_inverse_mass += point->weight[k] * point->weight[k] * nodes->inverse_mass[point->node[k]];
}

/* Move a node by its part of a change of position and of increment. */
PLIANT_INLINE void pliant_tled_contact_move_node(const pliant_tled_contact_nodes *nodes, double factor, int node,
                                                 double weight, const double place[3], const double increment[3])
{
    const double fraction = weight * nodes->inverse_mass[node], accelerated = fraction / factor;
    for (int d = 0; d < 3; d++) {
        nodes->u[3 * node + d] += fraction * place[d];
        nodes->d[3 * node + d] += fraction * increment[d];
        nodes->acceleration[3 * node + d] += accelerated * increment[d];
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

/* Apply an impulse to a point. factor: INFINITY leaves the acceleration as it is. */
PLIANT_INLINE void pliant_tled_contact_apply(const pliant_tled_contact_nodes *nodes, double factor,
                                             const pliant_contact_point *point, const pliant_tled_contact *contact,
                                             const double impulse[3])
{
    if (contact->has_sides) pliant_tled_contact_apply_impulse(nodes, factor, point, &contact->facing, impulse);
    for (int k = 0; !contact->has_sides && k < point->count; k++)
        pliant_tled_contact_move_node(nodes, factor, point->node[k], point->weight[k], impulse, impulse);
}

/* Apply contact/response paper ([C] 5.2): a force against the node's motion that removes a fraction of the motion.
 * Return its load. */
PLIANT_INLINE double pliant_tled_contact_slow_down(const pliant_tled_contact_nodes *nodes,
                                                   const pliant_tled_contact_timing *time,
                                                   const pliant_contact_point *point, pliant_tled_contact *contact)
{
    const int node = point->node[0];
    double load = 0;
    contact->is_pressed = true;
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

/* Compute the position y of a point, and its increment relative to the obstacle. Return its gap [m]. */
PLIANT_INLINE double pliant_tled_contact_gap(const pliant_tled_contact_nodes *nodes,
                                             const pliant_tled_contact_timing *time, const pliant_contact_point *point,
                                             const pliant_tled_contact *contact, double y[3], double moved[3])
{
    double gap = contact->initial_depth * (1 - time->done);
    pliant_tled_contact_position(point, nodes->rest, nodes->u, y);
    pliant_tled_contact_weighted_sum(point, nodes->d, moved);
    for (int d = 0; d < 3; d++) {
        moved[d] -= time->part * point->drift[d] * (time->still ? 0 : 1);
        gap += point->normal[d] * (y[d] - point->place[d] + (1 - time->done) * point->drift[d]);
    }
    return gap;
}

/* Return the tangential distance of a point from its sticking position. */
PLIANT_INLINE void pliant_tled_contact_slip(const pliant_contact_point *point, const pliant_tled_contact *contact,
                                            const double y[3], double slip[3])
{
    double along = 0;
    for (int d = 0; d < 3; d++) along += point->normal[d] * (y[d] - contact->anchor[d]);
    for (int d = 0; d < 3; d++) slip[d] = y[d] - contact->anchor[d] - along * point->normal[d];
}

/* Move the sticking position with the obstacle. */
PLIANT_INLINE void pliant_tled_contact_move_anchor(const pliant_tled_contact_timing *time,
                                                   const pliant_contact_point *point, pliant_tled_contact *contact)
{
    for (int d = 0; d < 3; d++)
        contact->anchor[d] += time->still && !time->first ? 0 : time->part * point->drift[d];
}

/* Return whether a point is solved together with others. */
PLIANT_INLINE bool pliant_tled_contact_is_coupled(bool still, const pliant_contact_point *point)
{
    return !still && !pliant_contact_slows(point);
}

/* ---- Points that are corrected one after the other: dynamic relaxation, and contact/response paper. */

/* Correct one point after a sub-step. Return its load, as PLIANT_SUM_LOAD. */
PLIANT_INLINE double pliant_tled_contact_correct(const pliant_tled_contact_nodes *nodes,
                                                 const pliant_tled_contact_timing *time, pliant_contact_point *point,
                                                 pliant_tled_contact *contact)
{
    double y[3], moved[3], slip[3], push[3], load = 0;
    pliant_facing facing;
    pliant_tled_contact_update_sides(nodes, point, contact, &facing);
    pliant_tled_contact_update_height(nodes, 0, point, contact);
    if (!(contact->weighted_inverse_mass > 0)) return 0;
    if (pliant_contact_slows(point)) return pliant_tled_contact_slow_down(nodes, time, point, contact);
    const double gap = pliant_tled_contact_gap(nodes, time, point, contact, y, moved);
    pliant_tled_contact_move_anchor(time, point, contact);
    pliant_tled_contact_slip(point, contact, y, slip);
    contact->is_pressed = pliant_substep_press(point->normal, point->friction, gap, moved, slip, push);
    for (int d = 0; d < 3; d++) {
        contact->force[d] = 0;
        if (!contact->is_pressed) contact->anchor[d] = y[d];
    }
    if (!contact->is_pressed) return 0;
    for (int d = 0; d < 3; d++) {
        contact->force[d] = push[d] / (time->factor * contact->weighted_inverse_mass);
        contact->anchor[d] += slip[d]; /* the remaining slip */
        load += contact->weighted_inverse_mass * contact->force[d] * contact->force[d];
        push[d] /= contact->weighted_inverse_mass;
    }
    for (int k = 0; k < point->count; k++)
        pliant_tled_contact_move_node(nodes, time->factor, point->node[k], point->weight[k], push, push);
    return load;
}

/* ---- Points that are solved together. For all points: prepare, then start, then push until no impulse changes, then
 * finish. */

/* Update the sides, and subtract the impulse that has separated them. */
PLIANT_INLINE void pliant_tled_contact_prepare(const pliant_tled_contact_nodes *nodes,
                                               const pliant_tled_contact_timing *time, pliant_contact_point *point,
                                               pliant_tled_contact *contact)
{
    double back[3], acceleration[3];
    contact->has_sides = pliant_tled_contact_update_sides(nodes, point, contact, &contact->facing);
    pliant_tled_contact_update_height(nodes, 1, point, contact);
    if (!(contact->weighted_inverse_mass > 0)) return;
    pliant_tled_contact_weighted_sum(point, nodes->acceleration, acceleration);
    contact->resistance = 0;
    for (int d = 0; d < 3; d++) {
        back[d] = -contact->separation_impulse[d];
        contact->separation_impulse[d] = 0;
        contact->resistance -= point->normal[d] * acceleration[d] / contact->weighted_inverse_mass;
    }
    pliant_tled_contact_move_anchor(time, point, contact);
    if (back[0] != 0 || back[1] != 0 || back[2] != 0)
        pliant_tled_contact_apply(nodes, INFINITY, point, contact, back);
}

/* Find the allowed increment, and start with the impulse of the previous sub-step. Points of tools start without one:
 * between two tools that press from opposite sides, impulses have no solution and would grow in each sub-step. */
PLIANT_INLINE void pliant_tled_contact_start(const pliant_tled_contact_nodes *nodes,
                                             const pliant_tled_contact_timing *time, const pliant_contact_point *point,
                                             pliant_tled_contact *contact)
{
    const double exact = 1e-2, w = contact->weighted_inverse_mass;
    double *impulse = contact->impulse;
    double y[3], moved[3], acceleration[3], outward = 0, before = 0;
    if (!(w > 0)) return;
    const double gap = pliant_tled_contact_gap(nodes, time, point, contact, y, moved);
    pliant_tled_contact_weighted_sum(point, nodes->acceleration, acceleration);
    for (int d = 0; d < 3; d++) {
        contact->before[d] = moved[d] - time->factor * acceleration[d];
        outward += point->normal[d] * moved[d];
        before += point->normal[d] * contact->before[d];
    }
    contact->inward = fmax(fmax(gap - outward, before), 0.0);
    contact->tolerance = exact * (fabs(before) / w + time->factor * fabs(contact->resistance));
    for (int d = 0; d < 3 && point->kind == PLIANT_OBSTACLE_TOOL; d++) impulse[d] = 0;
    if (impulse[0] != 0 || impulse[1] != 0 || impulse[2] != 0)
        pliant_tled_contact_apply(nodes, time->factor, point, contact, impulse);
}

/* Correct the impulse of a point: the normal part limits the increment towards the obstacle, and the tangential part
 * stops the point within the friction cone. Return whether another pass is needed. */
PLIANT_INLINE bool pliant_tled_contact_push(const pliant_tled_contact_nodes *nodes,
                                            const pliant_tled_contact_timing *time, const pliant_contact_point *point,
                                            pliant_tled_contact *contact)
{
    const double w = contact->weighted_inverse_mass;
    double moved[3], along[3], change[3], pressure = 0, outward = 0, slide = 0, changed = 0;
    if (!(w > 0)) return false;
    pliant_tled_contact_weighted_sum(point, nodes->d, moved);
    for (int d = 0; d < 3; d++) {
        moved[d] -= time->part * point->drift[d];
        pressure += point->normal[d] * contact->impulse[d];
        outward += point->normal[d] * moved[d];
    }
    const double next = fmax(pressure - (contact->inward + outward) / w, 0.0), maximum = point->friction * next;
    if (!(next > 0) && !(pressure > 0)) return false;
    for (int d = 0; d < 3; d++) {
        along[d] = contact->impulse[d] - moved[d] / w - (pressure - outward / w) * point->normal[d];
        slide += along[d] * along[d];
    }
    const double kept = slide > maximum * maximum ? maximum / sqrt(slide) : 1;
    for (int d = 0; d < 3; d++) {
        const double impulse = next * point->normal[d] + kept * along[d];
        change[d] = impulse - contact->impulse[d];
        contact->impulse[d] = impulse;
        changed += change[d] * change[d];
    }
    if (!(changed > 0)) return false;
    pliant_tled_contact_apply(nodes, time->factor, point, contact, change);
    return changed > contact->tolerance * contact->tolerance;
}

/* Add the energy that the impulse dissipates, and pay for the shift out of a penetration. Half of the dissipated energy
 * is lost, so that repeated shifts and impacts come to rest. Work against motion beyond the allowed increment is
 * available as a whole: this motion is an error of the solution. Return the shift [m]. */
PLIANT_INLINE double pliant_tled_contact_affordable_shift(const pliant_tled_contact_timing *time,
                                                          const double normal[3], double depth, const double moved[3],
                                                          pliant_tled_contact *contact)
{
    const double reused = 0.5, cost = contact->resistance * depth;
    double work = 0, pressure = 0, outward = 0;
    for (int d = 0; d < 3; d++) {
        work -= 0.5 * contact->impulse[d] * (moved[d] + contact->before[d]);
        pressure += normal[d] * contact->impulse[d];
        outward += normal[d] * moved[d];
    }
    const double error = pressure * fmax(-outward - contact->inward, 0.0);
    contact->energy += (reused * work + (1 - reused) * error) / time->factor;
    if (!(cost > 0)) return depth;
    const double paid = fmin(cost, fmax(contact->energy, 0.0));
    contact->energy -= paid;
    return depth * paid / cost;
}

/* Shift a point without a change of its velocity. Between two sides, an impulse shifts them, and the next sub-step
 * subtracts it. A shift without impulse would change the angular momentum, if the sides have a tangential velocity.
 * In the last sub-step, such a shift is left to the next frame. */
PLIANT_INLINE void pliant_tled_contact_shift(const pliant_tled_contact_nodes *nodes,
                                             const pliant_tled_contact_timing *time, const pliant_contact_point *point,
                                             const double shift[3], pliant_tled_contact *contact)
{
    const double none[3] = {0, 0, 0};
    double impulse[3];
    if (contact->has_sides && time->last) return;
    for (int d = 0; d < 3; d++) {
        impulse[d] = shift[d] / contact->weighted_inverse_mass;
        if (contact->has_sides) contact->separation_impulse[d] = impulse[d];
    }
    if (contact->has_sides) pliant_tled_contact_apply(nodes, INFINITY, point, contact, impulse);
    for (int k = 0; !contact->has_sides && k < point->count; k++)
        pliant_tled_contact_move_node(nodes, INFINITY, point->node[k], point->weight[k], impulse, none);
}

/* End a sub-step of a point: remove the part of the penetration depth that is due, and move the point back towards its
 * sticking position, limited by friction. Return its load, as PLIANT_SUM_LOAD. */
PLIANT_INLINE double pliant_tled_contact_finish(const pliant_tled_contact_nodes *nodes,
                                                const pliant_tled_contact_timing *time, pliant_contact_point *point,
                                                pliant_tled_contact *contact)
{
    const double w = contact->weighted_inverse_mass;
    double y[3], moved[3], slip[3], shift[3], apart = 0, pressure = 0, square = 0, far = 0, load = 0;
    if (!(w > 0)) return 0;
    const double gap = pliant_tled_contact_gap(nodes, time, point, contact, y, moved);
    pliant_tled_contact_slip(point, contact, y, slip);
    for (int d = 0; d < 3; d++) {
        pressure += point->normal[d] * contact->impulse[d];
        square += contact->impulse[d] * contact->impulse[d];
        far += slip[d] * slip[d];
        apart += point->normal[d] * y[d];
    }
    /* Sides that began the frame apart have slid off each other. Then the gap between their planes is no depth. */
    const bool are_beside = contact->has_sides && !(contact->initial_depth > 0) && apart < 0;
    contact->is_pressed = pressure > 0 || gap < 0;
    for (int d = 0; d < 3 && !contact->is_pressed; d++) contact->anchor[d] = y[d];
    if (!contact->is_pressed) return 0;
    const double friction = point->friction * pressure - sqrt(fmax(square - pressure * pressure, 0.0)),
                 left = fmax(friction, 0.0) * w, back = far > left * left ? left / sqrt(far) : 1,
                 depth = are_beside ? 0.0 : fmax(-gap, 0.0),
                 out = pliant_tled_contact_affordable_shift(time, point->normal, depth, moved, contact);
    for (int d = 0; d < 3; d++) {
        const double force = contact->impulse[d] / time->factor;
        contact->force[d] += force;
        load += w * force * force;
        contact->anchor[d] += (1 - back) * slip[d]; /* the remaining slip */
        shift[d] = out * point->normal[d] - back * slip[d];
    }
    pliant_tled_contact_shift(nodes, time, point, shift, contact);
    return load;
}

#ifdef __cplusplus
}
#endif

#endif
