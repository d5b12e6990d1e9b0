/* Contact of rigid bodies in the quasi-static solve: detached pieces and proxies of tools. */
#include "fem/quasistatic/contact.h"

#include "base/buffer.h"
#include "base/fail.h"
#include "contact/solve/cones.h"

#include <math.h>
#include <string.h>

/* Regularization: compliance of a point on a piece, divided by the compliance of a flat punch, 1 / (E sqrt(area)). */
static const double point_compliance = 1e-3;

/* Return the index of a body in contacts->moving. < 0: out of memory */
static int32_t find_moving(pliant_contact_problem *contacts, int32_t piece)
{
    for (int32_t m = 0; m < contacts->num_moving; m++)
        if (contacts->moving[m] == piece) return m;
    if (!pliant_reserve(&contacts->moving, &contacts->moving_capacity, contacts->num_moving, 16,
                        sizeof *contacts->moving))
        return -1;
    contacts->moving[contacts->num_moving] = piece;
    return contacts->num_moving++;
}

static pliant_contact_arm *find_arm(pliant_contact_problem *contacts, int32_t piece)
{
    const int32_t moving = find_moving(contacts, piece);
    if (moving < 0) return NULL;
    for (int32_t a = contacts->arm_start[contacts->count]; a < contacts->num_arms; a++)
        if (contacts->arm[a].moving == moving) return contacts->arm + a;
    if (!pliant_reserve(&contacts->arm, &contacts->arm_capacity, contacts->num_arms, 64, sizeof *contacts->arm))
        return NULL;
    contacts->arm[contacts->num_arms] = (pliant_contact_arm){.moving = moving};
    return contacts->arm + contacts->num_arms++;
}

/* Add the relation of a tool's point to its proxy. The proxy's motion reduces the gap, hence the signs. Each jaw
 * turns by half of the jaw angle about the joint. */
static pliant_status add_proxy(pliant_contact_problem *contacts, const pliant_contact_point *point)
{
    const int32_t first = 2 * point->tool;
    for (int32_t body = first; body < first + (point->jaw ? 2 : 1); body++) {
        pliant_contact_arm *arm = find_arm(contacts, -1 - body);
        if (!arm) return pliant_fail_memory("contact");
        arm->weight = body == first ? -1 : 0;
        for (int d = 0; d < 3; d++)
            arm->arm[d] =
                -(body == first ? 1 : 0.5 * point->jaw) * (point->place[d] - contacts->pieces->proxy[body].centre[d]);
    }
    return PLIANT_OK;
}

pliant_status pliant_contact_problem_add_arms(pliant_contact_problem *contacts, const pliant_contact_point *point,
                                              const double *fine_positions)
{
    if (contacts->pieces->proxy && point->kind == PLIANT_OBSTACLE_TOOL) {
        pliant_status status = add_proxy(contacts, point);
        if (status != PLIANT_OK) return status;
    }
    for (int32_t k = 0; k < point->count && contacts->pieces->of_node; k++) {
        const int32_t piece = contacts->pieces->of_node[point->node[k]];
        if (piece < 0 || point->weight[k] == 0) continue;
        pliant_contact_arm *arm = find_arm(contacts, piece);
        if (!arm) return pliant_fail_memory("contact");
        arm->weight += point->weight[k];
        for (int d = 0; d < 3; d++)
            arm->arm[d] += point->weight[k] * (fine_positions[3 * (size_t)point->node[k] + (size_t)d] -
                                               contacts->pieces->piece[piece].centre[d]);
    }
    return PLIANT_OK;
}

const pliant_contact_body *pliant_contact_problem_body(const pliant_contact_problem *contacts, int32_t moving)
{
    const int32_t body = contacts->moving[moving];
    return body >= 0 ? contacts->pieces->piece + body : contacts->pieces->proxy + (-1 - body);
}

void pliant_contact_problem_rotation_part(const pliant_contact_problem *contacts, int32_t c, double out[3])
{
    for (int32_t a = contacts->arm_start[c]; a < contacts->arm_start[c + 1]; a++)
        pliant_arm_rotation_part(contacts->arm + a, pliant_contact_problem_body(contacts, contacts->arm[a].moving),
                                 out);
}

/* Rigid bodies do not determine the forces of several points that carry a load together. A small compliance of each
 * point does. */
double pliant_contact_problem_compliance(const pliant_contact_problem *contacts, int32_t c)
{
    const pliant_contact_point *point = contacts->points->point + contacts->point[c];
    const double area = point->area;
    double sum = 0;
    for (int32_t a = contacts->arm_start[c]; a < contacts->arm_start[c + 1] && area > 0; a++) {
        const double young = pliant_contact_problem_body(contacts, contacts->arm[a].moving)->young;
        if (young > 0) sum += point_compliance / (young * sqrt(area));
    }
    return sum;
}

void pliant_contact_problem_add_bodies(const pliant_contact_problem *contacts, int32_t a, int32_t b, double out[9])
{
    for (int32_t i = contacts->arm_start[a]; i < contacts->arm_start[a + 1]; i++)
        for (int32_t j = contacts->arm_start[b]; j < contacts->arm_start[b + 1]; j++) {
            const pliant_contact_arm *mine = contacts->arm + i, *other = contacts->arm + j;
            if (mine->moving != other->moving) continue;
            pliant_arms_compliance(pliant_contact_problem_body(contacts, mine->moving), mine,
                                   contacts->frame + 9 * (size_t)a, other, contacts->frame + 9 * (size_t)b, out);
        }
    const double itself = a == b ? pliant_contact_problem_compliance(contacts, a) : 0;
    for (int d = 0; d < 3; d++) out[4 * d] += itself;
}

void pliant_contact_problem_move_bodies(const pliant_contact_problem *contacts, const double *force, bool bare,
                                        double *motion)
{
    for (int32_t m = 0; m < contacts->num_moving; m++) {
        double load[6] = {0}, moved[6];
        for (int pass = 0; pass < 2; pass++) { /* first sum the load of all points, then compute their motion */
            for (int k = 0; k < 6 && pass == 1; k++)
                moved[k] = pliant_body_motion(pliant_contact_problem_body(contacts, m), load, k);
            for (int32_t c = 0; c < contacts->count; c++)
                for (int32_t a = contacts->arm_start[c]; a < contacts->arm_start[c + 1]; a++) {
                    if (contacts->arm[a].moving != m) continue;
                    if (pass == 0)
                        pliant_arm_load(contacts->arm + a, contacts->frame + 9 * (size_t)c, force + 3 * (size_t)c,
                                        load);
                    else
                        pliant_arm_move(contacts->arm + a, contacts->frame + 9 * (size_t)c, moved,
                                        motion + 3 * (size_t)c);
                }
        }
    }
    for (int32_t c = 0; c < contacts->count && !bare; c++) {
        const double itself = pliant_contact_problem_compliance(contacts, c);
        for (int r = 0; r < 3; r++) motion[3 * (size_t)c + (size_t)r] += itself * force[3 * (size_t)c + (size_t)r];
    }
}

/* ---- limits of couplings */

static pliant_contact_body *body_of(const pliant_contact_problem *contacts, const pliant_coupling *of)
{
    return contacts->pieces->proxy + (-1 - contacts->moving[of->moving]);
}

/* Return the compliance of a coupling's body along the coupling. */
static double compliance_along(const pliant_contact_problem *contacts, const pliant_coupling *of)
{
    const double *compliance = body_of(contacts, of)->compliance + 7 * of->first;
    return of->num_columns == 1 ? compliance[0] + compliance[7] + compliance[14] : compliance[0];
}

static void set_compliance(const pliant_contact_problem *contacts, const pliant_coupling *of, double wanted)
{
    pliant_coupling_soften_body(of, wanted - compliance_along(contacts, of), body_of(contacts, of));
}

/* Compute the motion of a point along the coupling's columns (3 x 3, row by row). */
static void find_columns(const pliant_contact_problem *contacts, int32_t c, const pliant_coupling *of, double out[9])
{
    double rows[18];
    memset(out, 0, 9 * sizeof *out);
    for (int32_t a = contacts->arm_start[c]; a < contacts->arm_start[c + 1]; a++) {
        if (contacts->arm[a].moving != of->moving) continue;
        pliant_arm_rows(contacts->arm + a, contacts->frame + 9 * (size_t)c, rows);
        for (int r = 0; r < 3; r++)
            for (int d = 0; d < 3; d++)
                out[3 * r + (of->num_columns == 3 ? d : 0)] +=
                    rows[6 * r + of->first + d] * (of->num_columns == 3 ? 1 : of->axis[d]);
    }
}

/* Add one coupling of a moving body. kind: 0: force; 1: torque; 2: torque of the jaws */
static void add_coupling(pliant_contact_problem *contacts, int32_t moving, int kind, const pliant_touch_limit *limit)
{
    pliant_coupling *of = contacts->coupling + contacts->num_couplings++;
    *of = (pliant_coupling){.moving = moving,
                            .first = kind == 0 ? 0 : 3,
                            .num_columns = kind == 2 ? 1 : 3,
                            .limit = limit->load,
                            .own = limit->compliance};
    memcpy(of->axis, limit->axis, sizeof of->axis);
}

pliant_status pliant_contact_problem_list_couplings(pliant_contact_problem *contacts)
{
    const pliant_contact_bodies *pieces = contacts->pieces;
    contacts->num_couplings = 0;
    for (int32_t m = 0; pieces && pieces->limit && m < contacts->num_moving; m++) {
        const int body = -1 - contacts->moving[m];
        for (int kind = body % 2 ? 2 : 0; body >= 0 && kind < (body % 2 ? 3 : 2); kind++)
            if (pieces->limit[3 * (body / 2) + kind].load < INFINITY)
                add_coupling(contacts, m, kind, pieces->limit + 3 * (body / 2) + kind);
    }
    const size_t points = (size_t)contacts->count, numbers = 9 * points * (size_t)contacts->num_couplings;
    if (numbers > contacts->columns_capacity) {
        if (!pliant_grow(&contacts->columns, 2 * numbers, sizeof *contacts->columns))
            return pliant_fail_memory("contact");
        contacts->columns_capacity = 2 * numbers;
    }
    for (size_t i = 0; i < points * (size_t)contacts->num_couplings; i++)
        find_columns(contacts, (int32_t)(i % points), contacts->coupling + i / points, contacts->columns + 9 * i);
    return PLIANT_OK;
}

void pliant_contact_problem_begin_couplings(pliant_contact_problem *contacts)
{
    for (int32_t n = 0; n < contacts->num_couplings; n++) {
        pliant_coupling *of = contacts->coupling + n;
        of->compliance = of->taken = of->found = compliance_along(contacts, of);
    }
}

void pliant_contact_problem_set_couplings(pliant_contact_problem *contacts)
{
    for (int32_t n = 0; n < contacts->num_couplings; n++)
        set_compliance(contacts, contacts->coupling + n, contacts->coupling[n].compliance);
}

void pliant_contact_problem_restore_couplings(pliant_contact_problem *contacts)
{
    for (int32_t n = 0; n < contacts->num_couplings; n++)
        contacts->coupling[n].compliance = contacts->coupling[n].taken;
    pliant_contact_problem_set_couplings(contacts);
}

void pliant_contact_problem_apply_limits(pliant_contact_problem *contacts, int num_tools, double *resistance)
{
    const pliant_team team = {.size = 1};
    const pliant_cones cones = {
        .count = contacts->count + num_tools, .motion = contacts->motion, .force = contacts->force, .all = &team};
    pliant_couplings limits = {.count = contacts->num_couplings,
                               .points = contacts->count,
                               .coupling = contacts->coupling,
                               .columns = contacts->columns,
                               .matrix = contacts->matrix};
    pliant_couplings_begin(&team, &limits);
    while (pliant_couplings_adapt(&team, &cones, &limits))
        pliant_cones_solve(contacts->count + num_tools, contacts->matrix, contacts->friction, contacts->motion,
                           contacts->force, resistance, contacts->sweeps);
    for (int32_t n = 0; n < contacts->num_couplings; n++)
        contacts->coupling[n].found = contacts->coupling[n].compliance;
    pliant_contact_problem_set_couplings(contacts);
}
