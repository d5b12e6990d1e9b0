/* Contacts (contact/contact.h) in a frame of sub-steps (touch.h). */
#include "fem/dynamics/tled.h"

#include "base/fail.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

void pliant_tled_touch_free(pliant_tled *tled)
{
    pliant_free(tled->touch);
    pliant_free(tled->touched);
}

/* Compute the position y of the point. */
static void place_of(const pliant_tled *tled, const pliant_contact_point *point, double out[3])
{
    pliant_touch_place(point, tled->system->mesh->rest, tled->u, out);
}

/* Use the obstacle's position at the start of the frame. An initial penetration is removed during the frame. */
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
        if (inverse > 0 && !tled->slowing.tissue) tled->touched[point->node[k]] = 1;
    }
}

pliant_status pliant_tled_touch_begin(pliant_tled *tled)
{
    const pliant_contacts *contacts = tled->contacts;
    tled->slowing.status = PLIANT_OK;
    if (!pliant_tled_touches(tled)) return PLIANT_OK;
    if (!tled->touched && !(tled->touched = pliant_calloc((size_t)tled->system->mesh->num_nodes, 1)))
        return pliant_fail_memory("contact");
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

/* Compute the present positions and detect overlaps. */
static void search_overlaps(pliant_tled *tled)
{
    pliant_tled_slowing *slowing = &tled->slowing;
    const double *rest = tled->system->mesh->rest;
    if (!slowing->tissue || slowing->status != PLIANT_OK) return;
    for (int32_t n = 0; n < 3 * tled->system->mesh->num_nodes; n++) slowing->place[n] = rest[n] + tled->u[n];
    slowing->status = pliant_tissue_overlapping(slowing->tissue, slowing->place, slowing->overlaps);
}

/* Return whether a node that can be slowed has no overlap at present. */
static bool is_free(const pliant_tled *tled, const pliant_contact_point *point)
{
    return tled->slowing.tissue && pliant_contact_slows(point) && !tled->slowing.overlaps[point->node[0]];
}

double pliant_tled_touch_all(pliant_tled *tled, double factor, int32_t made)
{
    const pliant_touch_time time =
        pliant_touch_time_of(tled->system->quasi_static, factor, pliant_tled_part_steps(tled), made);
    const pliant_touch_nodes nodes = {.rest = tled->system->mesh->rest,
                                      .inverse_mass = tled->inverse_mass,
                                      .u = tled->u,
                                      .d = tled->d,
                                      .acceleration = tled->acceleration};
    double load = 0;
    search_overlaps(tled);
    for (int32_t p = 0; p < tled->contacts->count; p++) {
        tled->touch[p].pressed = false;
        if (!is_free(tled, tled->contacts->point + p))
            load += pliant_touch_press(&nodes, &time, tled->contacts->point + p, tled->touch + p);
        for (int32_t k = 0; tled->slowing.tissue && tled->touch[p].pressed && k < tled->contacts->point[p].count; k++)
            tled->touched[tled->contacts->point[p].node[k]] = 1;
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
