/* Pieces in contact: prediction of their free motion, and their step. */
#include "fem/rigid/rigid_pieces_data.h"

#include "contact/detect/part_contacts.h"
#include "contact/detect/update_sides.h"
#include "base/dense.h"
#include "base/vector3.h"
#include "topology/sorted_numbers.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- Implicit Euler of a rigid body: (M / h^2 + springs) q = M v / h + forces, with q = translation and rotation. */

/* Add the load of a force at an arm. */
static void add_load(const double arm[3], const double force[3], double load[6])
{
    double torque[3];
    pliant_cross3(arm, force, torque);
    for (int d = 0; d < 3; d++) {
        load[d] += force[d];
        load[3 + d] += torque[d];
    }
}

/* Return the stiffness of a pull as a spring, and its force before the body moves. A rigid pull is a spring with a
 * thousand times the stiffness that corresponds to the body's mass. */
static double stiffness_of(const pliant_rigid_pull *pull, const pliant_rigid *body, double step, double force[3])
{
    const double spring = pull->compliance > 0 ? 1 / pull->compliance : 1e3 * body->mass / (step * step),
                 damper = pull->compliance > 0 ? pull->damping / step : 0;
    for (int d = 0; d < 3; d++)
        force[d] = pull->is_force ? pull->force[d]
                               : spring * (pull->to[d] - body->centre[d] - pull->arm[d]) +
                                     damper * (pull->to[d] - pull->from[d]);
    return pull->is_force ? 0 : spring + damper;
}

/* Add k (t + w x r) at r to the matrix of (t, w). */
static void add_spring(const double arm[3], double stiffness, double matrix[36])
{
    const double turn[3][3] = {{0, arm[2], -arm[1]}, {-arm[2], 0, arm[0]}, {arm[1], -arm[0], 0}}; /* w x r = turn w */
    for (int r = 0; r < 3; r++) {
        matrix[7 * r] += stiffness;
        for (int c = 0; c < 3; c++) {
            matrix[6 * r + 3 + c] += stiffness * turn[r][c];
            matrix[6 * (3 + c) + r] += stiffness * turn[r][c];
            for (int k = 0; k < 3; k++) matrix[6 * (3 + r) + 3 + c] += stiffness * turn[k][r] * turn[k][c];
        }
    }
}

static void predict_motion(const pliant_rigid_pieces *rigid_pieces, const double gravity[3], const pliant_rigid *body,
                           int num_pulls, const pliant_rigid_pull *pulls, pliant_contact_body *out)
{
    const double step = rigid_pieces->step, rate = 1 / (step * step),
                 trace = body->inertia[0] + body->inertia[4] + body->inertia[8];
    double matrix[36] = {0};
    memset(out->free, 0, sizeof out->free);
    memset(out->compliance, 0, sizeof out->compliance);
    memcpy(out->centre, body->centre, sizeof out->centre);
    for (int r = 0; r < 3; r++) {
        matrix[7 * r] = body->mass * rate;
        /* The small term keeps the inertia of a needle regular. */
        for (int c = 0; c < 3; c++)
            matrix[6 * (3 + r) + 3 + c] = rate * (body->inertia[3 * r + c] + (r == c ? 1e-9 * trace : 0));
        out->free[r] = body->mass * (body->velocity[r] / step + gravity[r]);
        out->free[3 + r] = body->momentum[r] / step;
    }
    for (int p = 0; p < num_pulls; p++) {
        double force[3];
        add_spring(pulls[p].arm, stiffness_of(pulls + p, body, step, force), matrix);
        add_load(pulls[p].arm, force, out->free);
    }
    for (int k = 0; k < 6; k++) out->compliance[7 * k] = 1;
    if (!pliant_dense_cholesky(6, matrix)) {
        memset(out->free, 0, sizeof out->free);
        memset(out->compliance, 0, sizeof out->compliance);
        return;
    }
    pliant_dense_cholesky_solve(6, matrix, 6, out->compliance);
    pliant_dense_cholesky_solve(6, matrix, 1, out->free);
}

/* Return the largest motion of a node, for a motion of the centre and a rotation about it. */
static double farthest_of(const pliant_rigid_pieces *rigid_pieces, int32_t p, const double centre[3],
                          const double velocity[3], const double turn[3])
{
    double reach = 0;
    for (int32_t i = rigid_pieces->body->pieces->start[p]; i < rigid_pieces->body->pieces->start[p + 1]; i++) {
        const double *x = rigid_pieces->x + 3 * (size_t)i;
        reach = fmax(reach, pow(x[0] - centre[0], 2) + pow(x[1] - centre[1], 2) + pow(x[2] - centre[2], 2));
    }
    return sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1] + velocity[2] * velocity[2]) +
           sqrt(reach * (turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]));
}

double pliant_rigid_pieces_ball(const pliant_rigid_pieces *rigid_pieces, int32_t p, bool now, double centre[3],
                                double *radius)
{
    const piece *at = rigid_pieces->pieces + p;
    const double still[3] = {0, 0, 0};
    double spin[3];
    pliant_rigid body;
    if (rigid_pieces->body->has_inertia || at->has_left_view || (now && at->is_at_rest)) return 0;
    pliant_rigid_pieces_body(rigid_pieces, p, &body);
    if (!(body.mass > 0)) return 0;
    pliant_rigid_spin(&body, spin);
    const double goes =
        now ? rigid_pieces->whole * farthest_of(rigid_pieces, p, body.centre, body.velocity, spin) : at->max_motion;
    const double turned[3] = {1, 0, 0};
    memcpy(centre, body.centre, sizeof body.centre);
    *radius = farthest_of(rigid_pieces, p, body.centre, still, turned) + goes;
    return goes;
}

void pliant_rigid_pieces_mark(pliant_rigid_pieces *rigid_pieces, int32_t p, bool may_touch_tool)
{
    rigid_pieces->pieces[p].may_touch_tool = may_touch_tool;
}

double pliant_rigid_pieces_predict(pliant_data *data)
{
    pliant_rigid_pieces *rigid_pieces = data->rigid_pieces;
    double farthest = 0;
    if (rigid_pieces->body->has_inertia) return 0;
    pliant_rigid_pieces_set_step(rigid_pieces, data);
    pliant_rigid_pieces_find_grips(rigid_pieces, data);
    for (int32_t p = 0; p < rigid_pieces->body->pieces->count; p++) {
        piece *at = rigid_pieces->pieces + p;
        pliant_contact_body *contact_body = rigid_pieces->contact_body + p;
        pliant_rigid body;
        pliant_rigid_pull pulls[PLIANT_RIGID_PULLS];
        grip *grips[PLIANT_MAX_TOOLS];
        pliant_rigid_pieces_body(rigid_pieces, p, &body);
        at->has_wall_points = at->may_touch_tool = false;
        const int num_grips = pliant_rigid_pieces_grips(rigid_pieces, p, grips);
        if (!(body.mass > 0) || (at->has_left_view && num_grips == 0)) { /* treated as fixed */
            *contact_body = (pliant_contact_body){.young = contact_body->young, .size = contact_body->size};
            at->max_motion = 0;
            continue;
        }
        predict_motion(rigid_pieces, data->gravity, &body,
                       pliant_rigid_pieces_pulls(rigid_pieces, data, p, body.centre, num_grips, grips, pulls), pulls,
                       contact_body);
        memcpy(contact_body->ahead, contact_body->free, sizeof contact_body->ahead);
        at->max_motion = farthest_of(rigid_pieces, p, body.centre, contact_body->free, contact_body->free + 3);
        if (!at->is_at_rest) farthest = fmax(farthest, at->max_motion);
    }
    return farthest;
}

const pliant_contact_bodies *pliant_rigid_pieces_bodies(const pliant_rigid_pieces *rigid_pieces)
{
    return rigid_pieces->body->has_inertia ? NULL : &rigid_pieces->together;
}

/* ---- points */

bool pliant_rigid_pieces_have_contact(pliant_rigid_pieces *rigid_pieces, const pliant_contacts *contacts)
{
    bool any = false;
    for (int32_t p = 0; p < rigid_pieces->body->pieces->count; p++) rigid_pieces->pieces[p].is_near_wall = false;
    for (int32_t c = 0; c < contacts->count; c++)
        for (int32_t k = 0; k < contacts->point[c].count; k++) {
            const int32_t node = contacts->point[c].node[k],
                          p = node < rigid_pieces->body->fine.num_nodes ? rigid_pieces->of_node[node] : -1;
            if (p >= 0) any = rigid_pieces->pieces[p].is_near_wall = true;
        }
    return any && !rigid_pieces->body->has_inertia;
}

static double gap_of(const pliant_wall *wall, const double x[3])
{
    return wall->normal[0] * x[0] + wall->normal[1] * x[1] + wall->normal[2] * x[2] - wall->offset;
}

/* Return the maximum distance by which contact points push or drag a body in the step [m]. A rigid body pushed at one
 * end also rotates, which the factor covers. */
static double farthest_push(const pliant_data *data, const pliant_contacts *contacts)
{
    const double turns = 2;
    double farthest = 0;
    for (int32_t c = 0; c < contacts->count; c++) {
        const pliant_contact_point *point = contacts->point + c;
        const double *n = point->normal, *drift = point->drift;
        double depth = n[0] * point->place[0] + n[1] * point->place[1] + n[2] * point->place[2];
        for (int32_t k = 0; k < point->count; k++) {
            const double *x = data->positions + 3 * (size_t)point->node[k];
            depth -= point->weight[k] * (n[0] * x[0] + n[1] * x[1] + n[2] * x[2]);
        }
        farthest = fmax(farthest, fmax(depth, sqrt(drift[0] * drift[0] + drift[1] * drift[1] + drift[2] * drift[2])));
    }
    return turns * farthest;
}

/* List the nodes of a piece that may touch a wall, ascending. pushed: possible motion in addition to its own. */
static int choose_nodes(const pliant_rigid_pieces *rigid_pieces, int32_t p, const pliant_wall *wall, double pushed,
                        int32_t out[PLIANT_RIGID_DIRECTIONS + 1])
{
    const double margin = 1e-3; /* [m] */
    const pliant_pieces *pieces = rigid_pieces->body->pieces;
    pliant_rigid_choice choice;
    pliant_rigid_choose(wall->normal, &choice);
    for (int32_t i = pieces->start[p]; i < pieces->start[p + 1]; i++) {
        const double *x = rigid_pieces->x + 3 * (size_t)i, gap = gap_of(wall, x);
        double arm[3];
        for (int d = 0; d < 3; d++) arm[d] = x[d] - rigid_pieces->contact_body[p].centre[d];
        if (gap < rigid_pieces->pieces[p].max_motion + pushed + margin) pliant_rigid_consider(&choice, i, arm, gap);
    }
    const int count = pliant_rigid_chosen(&choice, out);
    qsort(out, (size_t)count, sizeof *out, by_number);
    return count;
}

static double cross_length(const double *a, const double *b, const double *c, double out[3])
{
    double u[3], w[3];
    for (int d = 0; d < 3; d++) {
        u[d] = b[d] - a[d];
        w[d] = c[d] - a[d];
    }
    pliant_cross3(u, w, out);
    return sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2]);
}

/* A surface triangle supports the piece if it lies at most 1 mm above the node that is nearest to the wall. Its area at
 * rest counts times the cosine of its angle to the wall. Each node gives a third of this area to the nearest contact
 * point.
 * @param area (count) out [m^2]. */
static void share_areas(const pliant_rigid_pieces *rigid_pieces, int32_t p, const pliant_wall *wall, int count,
                        const int32_t *chosen, double *area)
{
    const double margin = 1e-3; /* [m] */
    const pliant_body *body = rigid_pieces->body;
    const int32_t first = body->pieces->start[p];
    double lowest = INFINITY;
    for (int32_t i = first; i < body->pieces->start[p + 1]; i++) {
        lowest = fmin(lowest, gap_of(wall, rigid_pieces->x + 3 * (size_t)i));
        rigid_pieces->node_area[i - first] = 0;
    }
    for (int32_t k = rigid_pieces->triangle_start[p]; k < rigid_pieces->triangle_start[p + 1]; k++) {
        const int32_t *node = body->triangles + 3 * (size_t)rigid_pieces->triangle[k];
        const double *x[3], *rest[3];
        double highest = -INFINITY, normal[3];
        for (int v = 0; v < 3; v++) {
            rest[v] = body->fine.rest + 3 * (size_t)node[v];
            x[v] = rigid_pieces->x + 3 * (size_t)rigid_pieces->place[node[v]];
            highest = fmax(highest, gap_of(wall, x[v]));
        }
        if (highest > lowest + margin) continue;
        const double twice = cross_length(rest[0], rest[1], rest[2], normal),
                     now = cross_length(x[0], x[1], x[2], normal);
        const double faces =
            now > 0 ? -(normal[0] * wall->normal[0] + normal[1] * wall->normal[1] + normal[2] * wall->normal[2]) / now
                    : 0;
        for (int v = 0; v < 3 && faces > 0; v++)
            rigid_pieces->node_area[rigid_pieces->place[node[v]] - first] += faces * twice / 6;
    }
    memset(area, 0, (size_t)count * sizeof *area);
    for (int32_t i = first; i < body->pieces->start[p + 1]; i++) {
        double nearest = INFINITY;
        int to = 0;
        for (int c = 0; c < count && rigid_pieces->node_area[i - first] > 0; c++) {
            const double *a = rigid_pieces->x + 3 * (size_t)i, *b = rigid_pieces->x + 3 * (size_t)chosen[c];
            const double squared_distance = pow(a[0] - b[0], 2) + pow(a[1] - b[1], 2) + pow(a[2] - b[2], 2);
            if (squared_distance >= nearest) continue;
            nearest = squared_distance;
            to = c;
        }
        area[to] += rigid_pieces->node_area[i - first];
    }
}

pliant_status pliant_rigid_pieces_find_walls(pliant_data *data, pliant_contacts *contacts)
{
    pliant_rigid_pieces *rigid_pieces = data->rigid_pieces;
    const pliant_pieces *pieces = rigid_pieces->body->pieces;
    if (!pliant_rigid_pieces_have_contact(rigid_pieces, contacts)) return PLIANT_OK;
    const double pushed = farthest_push(data, contacts);
    for (int w = 0; w < rigid_pieces->num_walls; w++)
        for (int32_t p = 0; p < pieces->count; p++) {
            const pliant_wall *wall = rigid_pieces->walls + w;
            int32_t chosen[PLIANT_RIGID_DIRECTIONS + 1];
            const int count = rigid_pieces->pieces[p].is_near_wall && !rigid_pieces->pieces[p].has_wall_points
                                  ? choose_nodes(rigid_pieces, p, wall, pushed, chosen)
                                  : 0;
            pliant_status status = count > 0 ? pliant_contacts_reserve(contacts, contacts->count + count) : PLIANT_OK;
            if (status != PLIANT_OK) return status;
            double area[PLIANT_RIGID_DIRECTIONS + 1];
            if (count > 0) share_areas(rigid_pieces, p, wall, count, chosen, area);
            for (int c = 0; c < count; c++) {
                pliant_contact_point *point = contacts->point + contacts->count++;
                const double *x = rigid_pieces->x + 3 * (size_t)chosen[c], gap = gap_of(wall, x);
                *point = (pliant_contact_point){
                    .feature = (uint64_t)PLIANT_PIECE_ON_WALL << 56 | (uint64_t)w << 48 | (uint64_t)chosen[c],
                    .kind = PLIANT_OBSTACLE_GROUND,
                    .tool = -1,
                    .part = -1,
                    .count = 1,
                    .node = {pieces->node[chosen[c]]},
                    .weight = {1},
                    .friction = rigid_pieces->friction,
                    .area = area[c],
                };
                memcpy(point->normal, wall->normal, sizeof point->normal);
                for (int d = 0; d < 3; d++) point->place[d] = x[d] - gap * wall->normal[d];
            }
        }
    for (int32_t p = 0; p < pieces->count; p++)
        rigid_pieces->pieces[p].has_wall_points = rigid_pieces->pieces[p].is_near_wall;
    return PLIANT_OK;
}

/* ---- a step */

/* Compute the load of all contact forces of the present solve on a piece. */
static void contact_load(const pliant_rigid_pieces *rigid_pieces, const pliant_contacts *contacts, int32_t p,
                         double load[6])
{
    memset(load, 0, 6 * sizeof *load);
    for (int32_t c = 0; c < contacts->count; c++)
        for (int32_t k = 0; k < contacts->point[c].count; k++) {
            const pliant_contact_point *point = contacts->point + c;
            if (rigid_pieces->of_node[point->node[k]] != p) continue;
            double arm[3], force[3];
            for (int d = 0; d < 3; d++) {
                arm[d] = rigid_pieces->x[3 * (size_t)rigid_pieces->place[point->node[k]] + (size_t)d] -
                         rigid_pieces->contact_body[p].centre[d];
                force[d] = point->weight[k] * point->force[d];
            }
            add_load(arm, force, load);
        }
}

/* Compute the motion of a piece: of its centre, and its rotation about the centre. */
static void moved_by(const pliant_rigid_pieces *rigid_pieces, const pliant_contacts *contacts, int32_t p,
                     double moved[6])
{
    const pliant_contact_body *contact_body = rigid_pieces->contact_body + p;
    double load[6];
    contact_load(rigid_pieces, contacts, p, load);
    for (int k = 0; k < 6; k++) moved[k] = pliant_body_motion(contact_body, load, k);
}

/* Compute the trapezoidal correction. Implicit Euler moves a body by its velocity at the end of the step, as contact
 * requires (Stewart and Trinkle, Int. J. Numer. Meth. Engng 39:2673, 1996). The trapezoidal rule takes the mean of the
 * velocities at both ends instead, which is exact under constant forces. out: the difference of both motions, projected
 * so that no contact point of the piece comes closer. */
static void trapezoidal_correction(const pliant_rigid_pieces *rigid_pieces, const pliant_contacts *contacts, int32_t p,
                                   const double faster[3], double out[3])
{
    enum { PASSES = 4 };
    const double exact = 1e-9; /* of the correction */
    double size = 0, closer = 0;
    for (int d = 0; d < 3; d++) {
        out[d] = -0.5 * rigid_pieces->step * faster[d];
        size += out[d] * out[d];
    }
    for (int pass = 0; pass <= PASSES && (pass == 0 || closer > 0); pass++) {
        closer = 0;
        for (int32_t c = 0; c < contacts->count; c++) {
            const pliant_contact_point *point = contacts->point + c;
            double weight = 0, approach = 0;
            for (int32_t k = 0; k < point->count; k++)
                weight += rigid_pieces->of_node[point->node[k]] == p ? point->weight[k] : 0;
            for (int d = 0; d < 3; d++) approach -= weight * point->normal[d] * out[d];
            if (weight == 0 || approach <= exact * sqrt(size)) continue;
            closer = fmax(closer, approach);
            for (int d = 0; d < 3; d++) out[d] += approach / weight * point->normal[d];
        }
    }
    if (closer > 0) memset(out, 0, 3 * sizeof *out);
}

void pliant_rigid_pieces_move_in_contact(const pliant_rigid_pieces *rigid_pieces, const pliant_data *data, int32_t p,
                                         pliant_rigid *body, int num_pulls, pliant_rigid_pull *pulls)
{
    const double step = rigid_pieces->step, still[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    double moved[6], faster[3], correction[3] = {0, 0, 0};
    moved_by(rigid_pieces, &data->contacts, p, moved);
    for (int d = 0; d < 3; d++) faster[d] = moved[d] / step - body->velocity[d];
    if (num_pulls == 0) trapezoidal_correction(rigid_pieces, &data->contacts, p, faster, correction);
    for (int g = 0; g < num_pulls; g++) {
        double force[3], turned[3];
        const double stiffness = stiffness_of(pulls + g, body, step, force);
        pliant_cross3(moved + 3, pulls[g].arm, turned);
        for (int d = 0; d < 3; d++) pulls[g].impulse[d] = step * (force[d] - stiffness * (moved[d] + turned[d]));
    }
    pliant_rigid_turn(moved + 3, still, body->rotation);
    for (int d = 0; d < 3; d++) {
        body->centre[d] += moved[d] + correction[d];
        body->velocity[d] = moved[d] / step;
        body->momentum[d] = 0;
        for (int k = 0; k < 3; k++) body->momentum[d] += body->inertia[3 * d + k] * moved[3 + k] / step;
    }
}
