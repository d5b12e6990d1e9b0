/* Contacts (contact/contact.h) in sub-steps: points are put right one after the other, where a sub-step that knew nothing of them has led. */
#include "fem/dynamics/tled.h"

#include "base/fail.h"
#include "contact/follow.h"
#include "pliant/memory.h"

#include <math.h>
#include <string.h>

void pliant_tled_touch_free(pliant_tled *tled)
{
    pliant_free(tled->touch);
    pliant_free(tled->touched);
}

static void apply_weights(const pliant_contact_point *point, const double *v, double out[3])
{
    memset(out, 0, 3 * sizeof *out);
    for (int32_t k = 0; k < point->count; k++)
        for (int d = 0; d < 3; d++) out[d] += point->weight[k] * v[3 * (size_t)point->node[k] + (size_t)d];
}

/* y of the point */
static void place_of(const pliant_tled *tled, const pliant_contact_point *point, double out[3])
{
    double moved[3];
    apply_weights(point, tled->system->mesh->rest, out);
    apply_weights(point, tled->u, moved);
    for (int d = 0; d < 3; d++) out[d] += moved[d];
}

/* Where the obstacle was as the frame began; what is in it then may come out over the frame. */
static void begin_point(const pliant_tled *tled, const pliant_contact_point *point, pliant_tled_touch *touch)
{
    double y[3], gap = 0;
    place_of(tled, point, y);
    memset(touch, 0, sizeof *touch);
    for (int d = 0; d < 3; d++) {
        const double from = point->place[d] - point->drift[d];
        gap += point->normal[d] * (y[d] - from);
        touch->anchor[d] = (point->begun ? point->anchor[d] + point->place[d] - point->drift[d] : y[d]);
    }
    touch->deep = fmax(0, -gap);
    touch->pressed = point->begun;
    for (int32_t k = 0; k < point->count; k++) {
        const double inverse = tled->inverse_mass[point->node[k]];
        touch->answer += point->weight[k] * point->weight[k] * inverse;
        if (inverse > 0) tled->touched[point->node[k]] = 1;
    }
}

pliant_status pliant_tled_touch_begin(pliant_tled *tled)
{
    const pliant_contacts *contacts = tled->contacts;
    if (!pliant_tled_touches(tled)) return PLIANT_OK;
    if (!tled->touched && !(tled->touched = pliant_calloc((size_t)tled->system->mesh->num_nodes, 1))) return pliant_fail_memory("contact");
    if (contacts->count > tled->room_touch) {
        const size_t room = 2 * (size_t)contacts->count;
        pliant_tled_touch *touch = pliant_resize(tled->touch, room, sizeof *touch);
        if (!touch) return pliant_fail_memory("contact");
        tled->touch = touch;
        tled->room_touch = (int32_t)room;
    }
    memset(tled->touched, 0, (size_t)tled->system->mesh->num_nodes);
    for (int32_t p = 0; p < contacts->count; p++) begin_point(tled, contacts->point + p, tled->touch + p);
    return PLIANT_OK;
}

static void move(pliant_tled *tled, const pliant_contact_point *point, double factor, double answer, const double push[3], const double shift[3])
{
    for (int32_t k = 0; k < point->count; k++) {
        const size_t node = (size_t)point->node[k];
        const double share = point->weight[k] * tled->inverse_mass[node] / answer;
        for (size_t d = 0; d < 3; d++) {
            tled->u[3 * node + d] += share * (push[d] + shift[d]);
            tled->d[3 * node + d] += share * push[d];
            tled->acceleration[3 * node + d] += share * push[d] / factor;
        }
    }
}

/* Tissue on tissue: the sides face each other elsewhere by now, which is no slip. */
static void follow(pliant_tled *tled, pliant_contact_point *point, pliant_tled_touch *touch)
{
    double x[4][3], before[3], after[3];
    if (point->kind != PLIANT_OBSTACLE_TISSUE || point->count != 4) return;
    for (int k = 0; k < 4; k++)
        for (int d = 0; d < 3; d++) {
            const size_t at = 3 * (size_t)point->node[k] + (size_t)d;
            x[k][d] = tled->system->mesh->rest[at] + tled->u[at];
        }
    place_of(tled, point, before);
    if (!pliant_contact_follow(x, point)) return;
    place_of(tled, point, after);
    touch->answer = 0;
    for (int k = 0; k < 4; k++) touch->answer += point->weight[k] * point->weight[k] * tled->inverse_mass[point->node[k]];
    for (int d = 0; d < 3; d++) touch->anchor[d] += after[d] - before[d];
}

double pliant_tled_touch_all(pliant_tled *tled, double factor, int32_t made)
{
    const bool still = tled->system->quasi_static;
    const double done = still ? 1 : (double)(made + 1) / tled->substeps, part = still ? 1 : 1.0 / tled->substeps;
    double load = 0;
    for (int32_t p = 0; p < tled->contacts->count; p++) {
        pliant_contact_point *point = tled->contacts->point + p;
        pliant_tled_touch *touch = tled->touch + p;
        double y[3], moved[3], slip[3], push[3], shift[3], gap = touch->deep * (1 - done), along = 0;
        follow(tled, point, touch);
        if (!(touch->answer > 0)) continue;
        place_of(tled, point, y);
        apply_weights(point, tled->d, moved);
        for (int d = 0; d < 3; d++) {
            moved[d] -= part * point->drift[d] * (still ? 0 : 1);
            touch->anchor[d] += still && made > 0 ? 0 : part * point->drift[d];
            gap += point->normal[d] * (y[d] - point->place[d] + (1 - done) * point->drift[d]);
            slip[d] = y[d] - touch->anchor[d];
        }
        for (int d = 0; d < 3; d++) along += point->normal[d] * slip[d];
        for (int d = 0; d < 3; d++) slip[d] -= along * point->normal[d];
        touch->pressed = pliant_substep_press(point->normal, point->friction, gap, moved, slip, push, shift);
        if (still) memset(touch->force, 0, sizeof touch->force);
        if (!touch->pressed) {
            memcpy(touch->anchor, y, sizeof touch->anchor);
            continue;
        }
        for (int d = 0; d < 3 && still; d++) { /* no speed that must not grow, and what moves is not at rest */
            push[d] += shift[d];
            shift[d] = 0;
        }
        move(tled, point, factor, touch->answer, push, shift);
        for (int d = 0; d < 3; d++) {
            const double force = push[d] / (factor * touch->answer);
            touch->force[d] += force;
            touch->anchor[d] += slip[d]; /* what is left */
            load += touch->answer * force * force;
        }
    }
    return load;
}

void pliant_tled_touch_end(pliant_tled *tled, int32_t steps, pliant_statistics *statistics)
{
    statistics->contacts = 0;
    statistics->penetration = 0;
    for (int32_t p = 0; pliant_tled_touches(tled) && p < tled->contacts->count; p++) {
        pliant_contact_point *point = tled->contacts->point + p;
        const pliant_tled_touch *touch = tled->touch + p;
        double y[3], depth = 0;
        place_of(tled, point, y);
        point->begun = touch->pressed;
        for (int d = 0; d < 3; d++) {
            depth -= point->normal[d] * (y[d] - point->place[d]);
            point->force[d] = touch->force[d] / (tled->system->quasi_static ? 1 : steps);
            point->anchor[d] = touch->anchor[d] - point->place[d];
        }
        statistics->contacts += point->force[0] != 0 || point->force[1] != 0 || point->force[2] != 0;
        if (touch->answer > 0) statistics->penetration = fmax(statistics->penetration, depth);
    }
}
