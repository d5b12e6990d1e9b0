/* Contacts (contact/contact.h) in a frame of sub-steps (substep_contact.h). */
#include "fem/dynamics/tled.h"

#include "base/fail.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

void pliant_tled_contacts_free(pliant_tled *tled)
{
    pliant_free(tled->contact);
    pliant_free(tled->in_contact);
}

/* Compute the position y of the point. */
static void place_of(const pliant_tled *tled, const pliant_contact_point *point, double out[3])
{
    pliant_tled_contact_position(point, tled->system->mesh->rest, tled->u, out);
}

/* Use the obstacle's position at the start of the frame. An initial penetration is removed during the frame. */
static void begin_point(const pliant_tled *tled, const pliant_contact_point *point, pliant_tled_contact *contact)
{
    double y[3], gap = 0;
    place_of(tled, point, y);
    memset(contact, 0, sizeof *contact);
    for (int d = 0; d < 3; d++) {
        const double from = point->place[d] - point->drift[d];
        gap += point->normal[d] * (y[d] - from);
        contact->anchor[d] = (point->was_pressed ? point->anchor[d] + point->place[d] - point->drift[d] : y[d]);
    }
    contact->initial_depth = fmax(0, -gap);
    contact->is_pressed = point->was_pressed;
    for (int32_t k = 0; k < point->count; k++) {
        const double inverse = tled->inverse_mass[point->node[k]];
        contact->weighted_inverse_mass += point->weight[k] * point->weight[k] * inverse;
        if (inverse > 0 && !tled->overlap_damping.tissue) tled->in_contact[point->node[k]] = 1;
    }
}

static bool is_coupled(const pliant_tled *tled, int32_t p)
{
    return pliant_tled_contact_is_coupled(tled->system->quasi_static, tled->contacts->point + p);
}

/* Share the energy for shifts in proportion to the depths. */
static void share_energy(pliant_tled *tled)
{
    double initial_depth = 0;
    for (int32_t p = 0; p < tled->contacts->count; p++)
        initial_depth += is_coupled(tled, p) ? tled->contact[p].initial_depth : 0;
    for (int32_t p = 0; initial_depth > 0 && p < tled->contacts->count; p++)
        if (is_coupled(tled, p))
            tled->contact[p].energy = tled->contact_energy * tled->contact[p].initial_depth / initial_depth;
}

pliant_status pliant_tled_contacts_begin(pliant_tled *tled)
{
    const pliant_contacts *contacts = tled->contacts;
    tled->overlap_damping.status = PLIANT_OK;
    if (!pliant_tled_touches(tled)) return PLIANT_OK;
    if (!tled->in_contact && !(tled->in_contact = pliant_calloc((size_t)tled->system->mesh->num_nodes, 1)))
        return pliant_fail_memory("contact");
    if (contacts->count > tled->contact_capacity) {
        const size_t capacity = 2 * (size_t)contacts->count;
        pliant_tled_contact *contact = pliant_resize(tled->contact, capacity, sizeof *contact);
        if (!contact) return pliant_fail_memory("contact");
        tled->contact = contact;
        tled->contact_capacity = (int32_t)capacity;
    }
    memset(tled->in_contact, 0, (size_t)tled->system->mesh->num_nodes);
    for (int32_t p = 0; p < contacts->count; p++) begin_point(tled, contacts->point + p, tled->contact + p);
    share_energy(tled);
    return PLIANT_OK;
}

/* Compute the present positions and detect overlaps. */
static void search_overlaps(pliant_tled *tled)
{
    pliant_tled_overlap_damping *overlap_damping = &tled->overlap_damping;
    const double *rest = tled->system->mesh->rest;
    if (!overlap_damping->tissue || overlap_damping->status != PLIANT_OK) return;
    for (int32_t n = 0; n < 3 * tled->system->mesh->num_nodes; n++) overlap_damping->place[n] = rest[n] + tled->u[n];
    overlap_damping->status =
        pliant_tissue_overlapping(overlap_damping->tissue, overlap_damping->place, overlap_damping->overlaps);
}

/* Return whether a node that can be slowed has no overlap at present. */
static bool is_free(const pliant_tled *tled, const pliant_contact_point *point)
{
    return tled->overlap_damping.tissue && pliant_contact_slows(point) &&
           !tled->overlap_damping.overlaps[point->node[0]];
}

/* Solve for the impulses of the points that are solved together. Return their load. */
static double solve_coupled(pliant_tled *tled, const pliant_tled_contact_nodes *nodes,
                            const pliant_tled_contact_timing *time)
{
    const int32_t count = tled->contacts->count;
    pliant_contact_point *point = tled->contacts->point;
    pliant_tled_contact *contact = tled->contact;
    bool changes = true;
    double load = 0;
    for (int32_t p = 0; p < count; p++)
        if (is_coupled(tled, p)) pliant_tled_contact_prepare(nodes, time, point + p, contact + p);
    for (int32_t p = 0; p < count; p++)
        if (is_coupled(tled, p)) pliant_tled_contact_start(nodes, time, point + p, contact + p);
    for (int pass = 0; pass < PLIANT_TLED_CONTACT_PASSES && changes; pass++) {
        changes = false;
        for (int32_t p = 0; p < count; p++)
            if (is_coupled(tled, p) && pliant_tled_contact_push(nodes, time, point + p, contact + p)) changes = true;
    }
    for (int32_t p = 0; p < count; p++)
        if (is_coupled(tled, p)) load += pliant_tled_contact_finish(nodes, time, point + p, contact + p);
    return load;
}

double pliant_tled_contacts_correct(pliant_tled *tled, double factor, int32_t made)
{
    const pliant_tled_contact_timing time =
        pliant_tled_contact_time(tled->system->quasi_static, factor, pliant_tled_part_substeps(tled), made);
    const pliant_tled_contact_nodes nodes = {.rest = tled->system->mesh->rest,
                                      .inverse_mass = tled->inverse_mass,
                                      .u = tled->u,
                                      .d = tled->d,
                                      .acceleration = tled->acceleration};
    double load = 0;
    search_overlaps(tled);
    for (int32_t p = 0; p < tled->contacts->count; p++) {
        tled->contact[p].is_pressed = false;
        if (!is_coupled(tled, p) && !is_free(tled, tled->contacts->point + p))
            load += pliant_tled_contact_correct(&nodes, &time, tled->contacts->point + p, tled->contact + p);
    }
    load += solve_coupled(tled, &nodes, &time);
    for (int32_t p = 0; tled->overlap_damping.tissue && p < tled->contacts->count; p++)
        for (int32_t k = 0; tled->contact[p].is_pressed && k < tled->contacts->point[p].count; k++)
            tled->in_contact[tled->contacts->point[p].node[k]] = 1;
    return load;
}

void pliant_tled_contacts_end(pliant_tled *tled, int32_t steps, pliant_statistics *statistics)
{
    double initial_depth = 0, energy = 0;
    statistics->contacts = 0;
    statistics->penetration = 0;
    if (tled->substeps_done == 0) tled->tool_work = 0;
    for (int32_t p = 0; pliant_tled_touches(tled) && p < tled->contacts->count; p++) {
        pliant_contact_point *point = tled->contacts->point + p;
        const pliant_tled_contact *contact = tled->contact + p;
        double y[3], depth = 0;
        place_of(tled, point, y);
        point->was_pressed = contact->is_pressed;
        energy += contact->energy;
        initial_depth += is_coupled(tled, p) ? contact->initial_depth : 0;
        for (int d = 0; d < 3; d++) {
            depth -= point->normal[d] * (y[d] - point->place[d]);
            point->force[d] = contact->force[d] / (tled->system->quasi_static ? 1 : steps);
            point->anchor[d] = contact->anchor[d] - point->place[d];
            if (point->kind == PLIANT_OBSTACLE_TOOL) tled->tool_work += point->force[d] * point->drift[d];
        }
        if (point->kind == PLIANT_OBSTACLE_ELEMENT) continue; /* it touches nothing */
        statistics->contacts += point->force[0] != 0 || point->force[1] != 0 || point->force[2] != 0;
        if (contact->weighted_inverse_mass > 0) statistics->penetration = fmax(statistics->penetration, depth);
    }
    tled->contact_energy =
        energy + (initial_depth > 0 ? 0 : tled->contact_energy); /* without depths, none was shared */
}
