/* Contact of pieces that have come off, in the quasi-static solve. */
#include "fem/quasistatic/contact.h"

#include "base/fail.h"
#include "pliant/memory.h"

#include <math.h>
#include <string.h>

static void cross(const double a[3], const double b[3], double out[3])
{
    for (int d = 0; d < 3; d++) out[d] = a[(d + 1) % 3] * b[(d + 2) % 3] - a[(d + 2) % 3] * b[(d + 1) % 3];
}

static pliant_touch_arm *find_arm(pliant_touches *touches, int32_t piece)
{
    for (int32_t a = touches->arm_start[touches->count]; a < touches->num_arms; a++)
        if (touches->arm[a].piece == piece) return touches->arm + a;
    if (touches->num_arms == touches->room_arms) {
        const int32_t room = 2 * touches->room_arms + 64;
        pliant_touch_arm *more = pliant_resize(touches->arm, (size_t)room, sizeof *more);
        if (!more) return NULL;
        touches->arm = more;
        touches->room_arms = room;
    }
    touches->arm[touches->num_arms] = (pliant_touch_arm){.piece = piece};
    return touches->arm + touches->num_arms++;
}

pliant_status pliant_touches_add_arms(pliant_touches *touches, const pliant_contact_point *point, const double *fine_positions)
{
    for (int32_t k = 0; k < point->count; k++) {
        const int32_t piece = touches->pieces->of_node[point->node[k]];
        if (piece < 0 || point->weight[k] == 0) continue;
        pliant_touch_arm *arm = find_arm(touches, piece);
        if (!arm) return pliant_fail_memory("contact");
        arm->weight += point->weight[k];
        for (int d = 0; d < 3; d++)
            arm->arm[d] += point->weight[k] * (fine_positions[3 * (size_t)point->node[k] + (size_t)d] - touches->pieces->piece[piece].centre[d]);
    }
    return PLIANT_OK;
}

/* How far a point goes with its piece, along the axes of its frame: rows of a force and of a torque that turns it. */
static void rows_of(const pliant_touch_arm *arm, const double frame[9], double rows[3][6])
{
    for (int r = 0; r < 3; r++) {
        for (int d = 0; d < 3; d++) rows[r][d] = arm->weight * frame[3 * r + d];
        cross(arm->arm, frame + 3 * r, rows[r] + 3);
    }
}

/* of a point by itself [m/N] */
static double gives_way(const pliant_touches *touches, int32_t c)
{
    const double area = touches->points->point[touches->point[c]].area;
    double sum = 0;
    for (int32_t a = touches->arm_start[c]; a < touches->arm_start[c + 1] && area > 0; a++) {
        const double young = touches->pieces->piece[touches->arm[a].piece].young;
        if (young > 0) sum += 1 / (young * sqrt(area));
    }
    return sum;
}

void pliant_touches_answer_pieces(const pliant_touches *touches, int32_t a, int32_t b, double out[9])
{
    for (int32_t i = touches->arm_start[a]; i < touches->arm_start[a + 1]; i++)
        for (int32_t j = touches->arm_start[b]; j < touches->arm_start[b + 1]; j++) {
            if (touches->arm[i].piece != touches->arm[j].piece) continue;
            const double *answer = touches->pieces->piece[touches->arm[i].piece].answer;
            double mine[3][6], other[3][6], moved[6];
            rows_of(touches->arm + i, touches->frame + 9 * (size_t)a, mine);
            rows_of(touches->arm + j, touches->frame + 9 * (size_t)b, other);
            for (int c = 0; c < 3; c++) {
                for (int k = 0; k < 6; k++) {
                    moved[k] = 0;
                    for (int l = 0; l < 6; l++) moved[k] += answer[6 * k + l] * other[c][l];
                }
                for (int r = 0; r < 3; r++)
                    for (int k = 0; k < 6; k++) out[3 * r + c] += mine[r][k] * moved[k];
            }
        }
    const double itself = a == b ? gives_way(touches, a) : 0;
    for (int d = 0; d < 3; d++) out[4 * d] += itself;
}

/* the force and torque of all points on a piece */
static void load_of(const pliant_touches *touches, int32_t piece, const double *force, double load[6])
{
    memset(load, 0, 6 * sizeof *load);
    for (int32_t c = 0; c < touches->count; c++)
        for (int32_t a = touches->arm_start[c]; a < touches->arm_start[c + 1]; a++) {
            double rows[3][6];
            if (touches->arm[a].piece != piece) continue;
            rows_of(touches->arm + a, touches->frame + 9 * (size_t)c, rows);
            for (int r = 0; r < 3; r++)
                for (int k = 0; k < 6; k++) load[k] += rows[r][k] * force[3 * (size_t)c + (size_t)r];
        }
}

static void move_with(const pliant_touches *touches, int32_t piece, const double moved[6], double *motion)
{
    for (int32_t c = 0; c < touches->count; c++)
        for (int32_t a = touches->arm_start[c]; a < touches->arm_start[c + 1]; a++) {
            double rows[3][6];
            if (touches->arm[a].piece != piece) continue;
            rows_of(touches->arm + a, touches->frame + 9 * (size_t)c, rows);
            for (int r = 0; r < 3; r++)
                for (int k = 0; k < 6; k++) motion[3 * (size_t)c + (size_t)r] += rows[r][k] * moved[k];
        }
}

void pliant_touches_move_pieces(const pliant_touches *touches, const double *force, bool bare, double *motion)
{
    int32_t last = -1;
    for (int32_t next = 0; next >= 0; last = next) { /* pieces that are touched, ascending */
        next = -1;
        for (int32_t a = 0; a < touches->num_arms; a++)
            if (touches->arm[a].piece > last && (next < 0 || touches->arm[a].piece < next)) next = touches->arm[a].piece;
        if (next < 0) break;
        const pliant_touch_piece *piece = touches->pieces->piece + next;
        double load[6], moved[6];
        load_of(touches, next, force, load);
        for (int k = 0; k < 6; k++) {
            moved[k] = piece->free[k];
            for (int l = 0; l < 6; l++) moved[k] += piece->answer[6 * k + l] * load[l];
        }
        move_with(touches, next, moved, motion);
    }
    for (int32_t c = 0; c < touches->count && !bare; c++) {
        const double itself = gives_way(touches, c);
        for (int r = 0; r < 3; r++) motion[3 * (size_t)c + (size_t)r] += itself * force[3 * (size_t)c + (size_t)r];
    }
}
