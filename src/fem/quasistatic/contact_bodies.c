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

/* One coupling that has a limit: columns of the proxy's motion that it resists. */
typedef struct coupling {
    int32_t moving, first, columns; /* columns: 1 for jaws, which turn about their axis */
    const double *axis;
    pliant_contact_body *piece;
    double load, compliance, before[2]; /* before: load and compliance at the last change */
} coupling;

/* Compute the motion of a point along the coupling's columns (3 x 3, row by row). */
static void find_columns(const pliant_contact_problem *contacts, int32_t c, const coupling *of, double out[9])
{
    double rows[18];
    memset(out, 0, 9 * sizeof *out);
    for (int32_t a = contacts->arm_start[c]; a < contacts->arm_start[c + 1]; a++) {
        if (contacts->arm[a].moving != of->moving) continue;
        pliant_arm_rows(contacts->arm + a, contacts->frame + 9 * (size_t)c, rows);
        for (int r = 0; r < 3; r++)
            for (int d = 0; d < 3; d++)
                out[3 * r + (of->columns == 3 ? d : 0)] +=
                    rows[6 * r + of->first + d] * (of->columns == 3 ? 1 : of->axis[d]);
    }
}

/* Compute the load of a coupling under the forces of the last cone solve. Return its magnitude. */
static double find_load(const pliant_contact_problem *contacts, const double *columns, double load[3])
{
    memset(load, 0, 3 * sizeof *load);
    for (int32_t c = 0; c < contacts->count; c++)
        for (int i = 0; i < 9; i++) load[i % 3] += columns[9 * (size_t)c + (size_t)i] * contacts->force[3 * c + i / 3];
    return sqrt(load[0] * load[0] + load[1] * load[1] + load[2] * load[2]);
}

static void soften_body(const coupling *of, double by)
{
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            of->piece->compliance[6 * (of->first + r) + of->first + c] +=
                by * (of->columns == 3 ? r == c : of->axis[r] * of->axis[c]);
}

/* Add a compliance to a coupling, to A, and to the motions under the present forces. */
static void soften(pliant_contact_problem *contacts, int num_tools, coupling *of, const double *columns,
                   const double load[3], double by)
{
    const size_t row = 3 * (size_t)(contacts->count + num_tools);
    soften_body(of, by);
    for (size_t a = 0; a < 3 * (size_t)contacts->count; a++) {
        const double *mine = columns + 3 * a;
        contacts->motion[a] += by * (mine[0] * load[0] + mine[1] * load[1] + mine[2] * load[2]);
        for (size_t b = 0; b < 3 * (size_t)contacts->count; b++) {
            const double *other = columns + 3 * b;
            contacts->matrix[a * row + b] += by * (mine[0] * other[0] + mine[1] * other[1] + mine[2] * other[2]);
        }
    }
}

/* Return the error of a coupling's load relative to its limit; 0: the coupling is below its limit, with its own
 * compliance. */
static double measure(const pliant_contact_problem *contacts, const pliant_touch_limit *limit, coupling *of)
{
    const double rounding = 1e-12;
    double *columns = contacts->sweeps, load[3]; /* a buffer of the cone solver */
    for (int32_t c = 0; c < contacts->count; c++) find_columns(contacts, c, of, columns + 9 * (size_t)c);
    of->load = find_load(contacts, columns, load);
    const double error = of->load / limit->load - 1;
    return error > 0 || of->compliance > limit->compliance * (1 + rounding) ? fabs(error) : 0;
}

/* Adapt the compliance of a coupling to its limit. The compliances of coupling and tissue together, times the load,
 * give the distance to the target, which is constant.
 * @param again this coupling alone has changed since its last call */
static void apply_limit(pliant_contact_problem *contacts, int num_tools, const pliant_touch_limit *limit, coupling *of,
                        bool again, double *tissue_compliance)
{
    double *columns = contacts->sweeps, load[3]; /* a buffer of the cone solver */
    for (int32_t c = 0; c < contacts->count; c++) find_columns(contacts, c, of, columns + 9 * (size_t)c);
    of->load = find_load(contacts, columns, load);
    const double found = (of->load * of->compliance - of->before[0] * of->before[1]) / (of->before[0] - of->load);
    if (again && isfinite(found) && found > 0) *tissue_compliance = found;
    const double wanted =
        fmax(limit->compliance, (of->compliance + *tissue_compliance) * of->load / limit->load - *tissue_compliance);
    of->before[0] = of->load;
    of->before[1] = of->compliance;
    if (!isfinite(wanted)) return;
    soften(contacts, num_tools, of, columns, load, wanted - of->compliance);
    of->compliance = wanted;
}

static coupling coupling_of(const pliant_contact_problem *contacts, int32_t moving, int kind,
                            const pliant_touch_limit *limit)
{
    coupling of = {.moving = moving, .first = kind == 0 ? 0 : 3, .columns = kind == 2 ? 1 : 3, .axis = limit->axis};
    of.piece = contacts->pieces->proxy + (-1 - contacts->moving[moving]);
    const double *compliance = of.piece->compliance + 7 * of.first;
    of.compliance = kind == 2 ? compliance[0] + compliance[7] + compliance[14] : compliance[0];
    return of;
}

/* List the couplings of all tools that touch. index: of their limits. Return their number. */
static int list_couplings(const pliant_contact_problem *contacts, coupling *of, int *index)
{
    int count = 0;
    for (int32_t m = 0; contacts->pieces && contacts->pieces->limit && m < contacts->num_moving; m++) {
        const int body = -1 - contacts->moving[m];
        if (body < 0) continue;
        for (int kind = body % 2 ? 2 : 0; kind < (body % 2 ? 3 : 2); kind++) {
            index[count] = 3 * (body / 2) + kind;
            of[count] = coupling_of(contacts, m, kind, contacts->pieces->limit + index[count]);
            count++;
        }
    }
    return count;
}

bool pliant_contact_problem_is_near_limit(const pliant_contact_problem *contacts)
{
    coupling of[3 * PLIANT_MAX_TOOLS];
    int index[3 * PLIANT_MAX_TOOLS];
    const int count = list_couplings(contacts, of, index);
    for (int n = 0; n < count; n++)
        if (contacts->pieces->limit[index[n]].is_near) return true;
    return false;
}

void pliant_contact_problem_restore_couplings(pliant_contact_problem *contacts)
{
    coupling of[3 * PLIANT_MAX_TOOLS];
    int index[3 * PLIANT_MAX_TOOLS];
    const int count = list_couplings(contacts, of, index);
    for (int n = 0; n < count; n++) {
        const double taken = contacts->taken.compliance[index[n]];
        if (taken > 0) soften_body(of + n, taken - of[n].compliance);
    }
}

/* One coupling changes at a time, because couplings of tools that press against each other have the same load. Each
 * coupling that changes allows four more passes. */
void pliant_contact_problem_apply_limits(pliant_contact_problem *contacts, int num_tools, double *resistance)
{
    coupling of[3 * PLIANT_MAX_TOOLS];
    int index[3 * PLIANT_MAX_TOOLS];
    const int count = list_couplings(contacts, of, index);
    bool has_changed[3 * PLIANT_MAX_TOOLS] = {false};
    for (int pass = 0, last = -1, most = 4; pass < most; pass++) {
        const double nearly = 1e-6;
        double maximum = nearly;
        int worst = -1;
        for (int n = 0; n < count; n++) {
            const double error = measure(contacts, contacts->pieces->limit + index[n], of + n);
            if (error > maximum) worst = n;
            if (error > maximum) maximum = error;
        }
        if (worst < 0) break;
        if (pass > 0 && !has_changed[worst]) most += 4;
        has_changed[worst] = true;
        apply_limit(contacts, num_tools, contacts->pieces->limit + index[worst], of + worst, worst == last,
                    contacts->tissue_compliance + index[worst]);
        last = worst;
        pliant_cones_solve(contacts->count + num_tools, contacts->matrix, contacts->friction, contacts->motion,
                           contacts->force, resistance, contacts->sweeps);
    }
    for (int n = 0; n < count; n++) contacts->found.compliance[index[n]] = of[n].compliance;
}
