/* Contact of rigid bodies in the quasi-static solve: detached pieces and proxies of tools. */
#include "fem/quasistatic/contact.h"

#include "base/fail.h"
#include "base/memory.h"

#include <math.h>
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
