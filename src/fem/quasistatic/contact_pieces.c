/* Contact of rigid bodies in the quasi-static solve: detached pieces and proxies of tools. */
#include "fem/quasistatic/contact.h"

#include "base/fail.h"
#include "base/memory.h"
#include "contact/solve/cones.h"

#include <math.h>
#include <string.h>
#include <string.h>

/* Return the index of a body in touches->moving. < 0: out of memory */
static int32_t find_moving(pliant_touches *touches, int32_t piece)
{
    for (int32_t m = 0; m < touches->num_moving; m++)
        if (touches->moving[m] == piece) return m;
    if (touches->num_moving == touches->room_moving) {
        const int32_t room = 2 * touches->room_moving + 16;
        int32_t *more = pliant_resize(touches->moving, (size_t)room, sizeof *more);
        if (!more) return -1;
        touches->moving = more;
        touches->room_moving = room;
    }
    touches->moving[touches->num_moving] = piece;
    return touches->num_moving++;
}

static pliant_touch_arm *find_arm(pliant_touches *touches, int32_t piece)
{
    const int32_t moving = find_moving(touches, piece);
    if (moving < 0) return NULL;
    for (int32_t a = touches->arm_start[touches->count]; a < touches->num_arms; a++)
        if (touches->arm[a].moving == moving) return touches->arm + a;
    if (touches->num_arms == touches->room_arms) {
        const int32_t room = 2 * touches->room_arms + 64;
        pliant_touch_arm *more = pliant_resize(touches->arm, (size_t)room, sizeof *more);
        if (!more) return NULL;
        touches->arm = more;
        touches->room_arms = room;
    }
    touches->arm[touches->num_arms] = (pliant_touch_arm){.moving = moving};
    return touches->arm + touches->num_arms++;
}

/* Add the relation of a tool's point to its proxy. The proxy's motion reduces the gap, hence the signs. Each jaw
 * turns by half of the jaw angle about the joint. */
static pliant_status add_proxy(pliant_touches *touches, const pliant_contact_point *point)
{
    const int32_t first = 2 * point->tool;
    for (int32_t body = first; body < first + (point->jaw ? 2 : 1); body++) {
        pliant_touch_arm *arm = find_arm(touches, -1 - body);
        if (!arm) return pliant_fail_memory("contact");
        arm->weight = body == first ? -1 : 0;
        for (int d = 0; d < 3; d++)
            arm->arm[d] =
                -(body == first ? 1 : 0.5 * point->jaw) * (point->place[d] - touches->pieces->proxy[body].centre[d]);
    }
    return PLIANT_OK;
}

pliant_status pliant_touches_add_arms(pliant_touches *touches, const pliant_contact_point *point,
                                      const double *fine_positions)
{
    if (touches->pieces->proxy && point->kind == PLIANT_OBSTACLE_TOOL) {
        pliant_status status = add_proxy(touches, point);
        if (status != PLIANT_OK) return status;
    }
    for (int32_t k = 0; k < point->count && touches->pieces->of_node; k++) {
        const int32_t piece = touches->pieces->of_node[point->node[k]];
        if (piece < 0 || point->weight[k] == 0) continue;
        pliant_touch_arm *arm = find_arm(touches, piece);
        if (!arm) return pliant_fail_memory("contact");
        arm->weight += point->weight[k];
        for (int d = 0; d < 3; d++)
            arm->arm[d] += point->weight[k] * (fine_positions[3 * (size_t)point->node[k] + (size_t)d] -
                                               touches->pieces->piece[piece].centre[d]);
    }
    return PLIANT_OK;
}

const pliant_touch_piece *pliant_touches_moving(const pliant_touches *touches, int32_t moving)
{
    const int32_t body = touches->moving[moving];
    return body >= 0 ? touches->pieces->piece + body : touches->pieces->proxy + (-1 - body);
}

void pliant_touches_bend(const pliant_touches *touches, int32_t c, double out[3])
{
    for (int32_t a = touches->arm_start[c]; a < touches->arm_start[c + 1]; a++)
        pliant_arm_bend(touches->arm + a, pliant_touches_moving(touches, touches->arm[a].moving), out);
}

/* Rigid bodies do not determine the forces of several points that carry a load together. A small compliance of each
 * point does (a thousandth of a flat punch's on their tissue, 1 / (E sqrt(area))). */
double pliant_touches_give_way(const pliant_touches *touches, int32_t c)
{
    const pliant_contact_point *point = touches->points->point + touches->point[c];
    const double area = point->area, share = 1e-3;
    double sum = 0;
    for (int32_t a = touches->arm_start[c]; a < touches->arm_start[c + 1] && area > 0; a++) {
        const double young = pliant_touches_moving(touches, touches->arm[a].moving)->young;
        if (young > 0) sum += share / (young * sqrt(area));
    }
    return sum;
}

void pliant_touches_answer_pieces(const pliant_touches *touches, int32_t a, int32_t b, double out[9])
{
    for (int32_t i = touches->arm_start[a]; i < touches->arm_start[a + 1]; i++)
        for (int32_t j = touches->arm_start[b]; j < touches->arm_start[b + 1]; j++) {
            const pliant_touch_arm *mine = touches->arm + i, *other = touches->arm + j;
            if (mine->moving != other->moving) continue;
            pliant_arms_answer(pliant_touches_moving(touches, mine->moving), mine, touches->frame + 9 * (size_t)a,
                               other, touches->frame + 9 * (size_t)b, out);
        }
    const double itself = a == b ? pliant_touches_give_way(touches, a) : 0;
    for (int d = 0; d < 3; d++) out[4 * d] += itself;
}

void pliant_touches_move_pieces(const pliant_touches *touches, const double *force, bool bare, double *motion)
{
    for (int32_t m = 0; m < touches->num_moving; m++) {
        double load[6] = {0}, moved[6];
        for (int pass = 0; pass < 2; pass++) { /* first sum the load of all points, then compute their motion */
            for (int k = 0; k < 6 && pass == 1; k++)
                moved[k] = pliant_piece_moves(pliant_touches_moving(touches, m), load, k);
            for (int32_t c = 0; c < touches->count; c++)
                for (int32_t a = touches->arm_start[c]; a < touches->arm_start[c + 1]; a++) {
                    if (touches->arm[a].moving != m) continue;
                    if (pass == 0)
                        pliant_arm_load(touches->arm + a, touches->frame + 9 * (size_t)c, force + 3 * (size_t)c, load);
                    else
                        pliant_arm_move(touches->arm + a, touches->frame + 9 * (size_t)c, moved,
                                        motion + 3 * (size_t)c);
                }
        }
    }
    for (int32_t c = 0; c < touches->count && !bare; c++) {
        const double itself = pliant_touches_give_way(touches, c);
        for (int r = 0; r < 3; r++) motion[3 * (size_t)c + (size_t)r] += itself * force[3 * (size_t)c + (size_t)r];
    }
}

/* ---- limits of couplings */

/* One coupling that has a limit: columns of the proxy's motion that it resists. */
typedef struct coupling {
    int32_t moving, first, columns; /* columns: 1 for jaws, which turn about their axis */
    const double *axis;
    pliant_touch_piece *piece;
    double load, compliance, before[2]; /* before: load and compliance at the last change */
} coupling;

/* Compute the motion of a point along the coupling's columns (3 x 3, row by row). */
static void find_columns(const pliant_touches *touches, int32_t c, const coupling *of, double out[9])
{
    double rows[18];
    memset(out, 0, 9 * sizeof *out);
    for (int32_t a = touches->arm_start[c]; a < touches->arm_start[c + 1]; a++) {
        if (touches->arm[a].moving != of->moving) continue;
        pliant_arm_rows(touches->arm + a, touches->frame + 9 * (size_t)c, rows);
        for (int r = 0; r < 3; r++)
            for (int d = 0; d < 3; d++)
                out[3 * r + (of->columns == 3 ? d : 0)] +=
                    rows[6 * r + of->first + d] * (of->columns == 3 ? 1 : of->axis[d]);
    }
}

/* Compute the load of a coupling under the forces of the last cone solve. Return its magnitude. */
static double find_load(const pliant_touches *touches, const double *columns, double load[3])
{
    memset(load, 0, 3 * sizeof *load);
    for (int32_t c = 0; c < touches->count; c++)
        for (int i = 0; i < 9; i++) load[i % 3] += columns[9 * (size_t)c + (size_t)i] * touches->force[3 * c + i / 3];
    return sqrt(load[0] * load[0] + load[1] * load[1] + load[2] * load[2]);
}

/* Add a compliance to a coupling, to A, and to the motions under the present forces. */
static void soften(pliant_touches *touches, int num_tools, coupling *of, const double *columns, const double load[3],
                   double by)
{
    const size_t row = 3 * (size_t)(touches->count + num_tools);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            of->piece->answer[6 * (of->first + r) + of->first + c] +=
                by * (of->columns == 3 ? r == c : of->axis[r] * of->axis[c]);
    for (size_t a = 0; a < 3 * (size_t)touches->count; a++) {
        const double *mine = columns + 3 * a;
        touches->motion[a] += by * (mine[0] * load[0] + mine[1] * load[1] + mine[2] * load[2]);
        for (size_t b = 0; b < 3 * (size_t)touches->count; b++) {
            const double *other = columns + 3 * b;
            touches->matrix[a * row + b] += by * (mine[0] * other[0] + mine[1] * other[1] + mine[2] * other[2]);
        }
    }
}

/* Return the error of a coupling's load relative to its limit; 0: the coupling is below its limit, with its own
 * compliance. */
static double measure(const pliant_touches *touches, const pliant_touch_limit *limit, coupling *of)
{
    const double rounding = 1e-12;
    double *columns = touches->sweeps, load[3]; /* a buffer of the cone solver */
    for (int32_t c = 0; c < touches->count; c++) find_columns(touches, c, of, columns + 9 * (size_t)c);
    of->load = find_load(touches, columns, load);
    const double error = of->load / limit->load - 1;
    return error > 0 || of->compliance > limit->compliance * (1 + rounding) ? fabs(error) : 0;
}

/* Adapt the compliance of a coupling to its limit. The compliances of coupling and tissue together, times the load,
 * give the distance to the target, which is constant.
 * @param again this coupling alone has changed since its last call */
static void keep_limit(pliant_touches *touches, int num_tools, const pliant_touch_limit *limit, coupling *of,
                       bool again, double *yields)
{
    double *columns = touches->sweeps, load[3]; /* a buffer of the cone solver */
    for (int32_t c = 0; c < touches->count; c++) find_columns(touches, c, of, columns + 9 * (size_t)c);
    of->load = find_load(touches, columns, load);
    const double found = (of->load * of->compliance - of->before[0] * of->before[1]) / (of->before[0] - of->load);
    if (again && isfinite(found) && found > 0) *yields = found;
    const double wanted = fmax(limit->compliance, (of->compliance + *yields) * of->load / limit->load - *yields);
    of->before[0] = of->load;
    of->before[1] = of->compliance;
    if (!isfinite(wanted)) return;
    soften(touches, num_tools, of, columns, load, wanted - of->compliance);
    of->compliance = wanted;
}

static coupling coupling_of(const pliant_touches *touches, int32_t moving, int kind, const pliant_touch_limit *limit)
{
    coupling of = {.moving = moving, .first = kind == 0 ? 0 : 3, .columns = kind == 2 ? 1 : 3, .axis = limit->axis};
    of.piece = touches->pieces->proxy + (-1 - touches->moving[moving]);
    const double *answer = of.piece->answer + 7 * of.first;
    of.compliance = kind == 2 ? answer[0] + answer[7] + answer[14] : answer[0];
    return of;
}

/* One coupling changes at a time, because couplings of tools that press against each other have the same load. */
void pliant_touches_keep_limits(pliant_touches *touches, int num_tools)
{
    enum { MOST = 8 };
    coupling of[3 * PLIANT_MAX_TOOLS];
    int index[3 * PLIANT_MAX_TOOLS], count = 0;
    for (int32_t m = 0; touches->pieces && touches->pieces->limit && m < touches->num_moving; m++) {
        const int body = -1 - touches->moving[m];
        if (body < 0) continue;
        for (int kind = body % 2 ? 2 : 0; kind < (body % 2 ? 3 : 2); kind++) {
            index[count] = 3 * (body / 2) + kind;
            of[count] = coupling_of(touches, m, kind, touches->pieces->limit + index[count]);
            count++;
        }
    }
    for (int pass = 0, last = -1; pass < MOST; pass++) {
        const double nearly = 1e-6;
        double most = nearly;
        int worst = -1;
        for (int n = 0; n < count; n++) {
            const double error = measure(touches, touches->pieces->limit + index[n], of + n);
            if (error > most) worst = n;
            if (error > most) most = error;
        }
        if (worst < 0) return;
        keep_limit(touches, num_tools, touches->pieces->limit + index[worst], of + worst, worst == last,
                   touches->yields + index[worst]);
        last = worst;
        pliant_cones_solve(touches->count + num_tools, touches->matrix, touches->friction, touches->motion,
                           touches->force, touches->sweeps);
    }
}
