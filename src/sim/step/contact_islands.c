/* Islands of contact: one fraction of a leg for each group of nodes and tools that contact joins. */
#include "base/buffer.h"
#include "base/fail.h"
#include "base/union_find.h"
#include "contact/advance/pair.h"
#include "contact/volume/volume_bound.h"
#include "sim/step/contact_workspace.h"

#include <math.h>

pliant_status pliant_legs_reserve_fractions(const pliant_data *data)
{
    pliant_legs *legs = data->legs;
    const size_t nodes = (size_t)data->body->fine.num_nodes;
    return pliant_ensure(&legs->fraction, nodes, sizeof *legs->fraction) &&
                   pliant_ensure(&legs->island, nodes + PLIANT_MAX_TOOLS, sizeof *legs->island)
               ? PLIANT_OK
               : pliant_fail_memory("contacts");
}

/* Join all nodes that move a triangle. Return one of them. */
static int32_t join_triangle(const pliant_contact_surface *outside, const int32_t corner[3], int32_t *island)
{
    int32_t support[4], first = -1;
    double weights[4];
    for (int c = 0; c < 3; c++) {
        const int count = outside ? pliant_contact_surface_support(outside, corner[c], support, weights) : 1;
        if (!outside) support[0] = corner[c];
        if (first < 0) first = support[0];
        for (int k = 0; k < count; k++) pliant_set_join(island, first, support[k]);
    }
    return first;
}

/* Join the triangles of all pairs, and their tools. Reduce the fraction of one node of each triangle.
 * Return the smallest fraction of pairs with obstacles. */
static double join_pairs(const pliant_contact_search *search, const pliant_contact_surface *outside,
                         const pliant_body *surface, pliant_legs *legs)
{
    const pliant_advance_pair *pair = NULL;
    const int32_t num_pairs = pliant_advance_get_pairs(search->advance, &pair), nodes = surface->fine.num_nodes;
    double obstacles = 1;
    for (int32_t p = 0; p < num_pairs; p++) {
        const pliant_moving_part *part = search->part + pair[p].part;
        const int32_t first = join_triangle(outside, surface->triangles + 3 * (size_t)pair[p].triangle, legs->island);
        legs->fraction[first] = fmin(legs->fraction[first], pair[p].t);
        if (part->kind == PLIANT_OBSTACLE_TOOL)
            pliant_set_join(legs->island, first, nodes + part->tool);
        else
            obstacles = fmin(obstacles, pair[p].t);
    }
    return obstacles;
}

/* Give each node the smallest fraction in its island. A root comes before the other nodes. */
static void spread_fractions(int32_t nodes, pliant_legs *legs)
{
    for (int32_t n = 0; n < nodes; n++) {
        double *root = legs->fraction + pliant_set_root(legs->island, n);
        *root = fmin(*root, legs->fraction[n]);
    }
    for (int32_t n = 0; n < nodes; n++) legs->fraction[n] = legs->fraction[pliant_set_root(legs->island, n)];
}

/* Join the nodes of elements that different fractions would make too small. Return whether there is one. */
static bool join_elements(const pliant_model *model, pliant_data *data)
{
    const pliant_mesh *mesh = &data->body->fine;
    pliant_legs *legs = data->legs;
    bool found = false;
    for (int32_t t = 0; t < mesh->num_tets; t++) {
        const int32_t *node = mesh->tets + 4 * (size_t)t;
        const double first = legs->fraction[node[0]];
        bool differ = false;
        for (int k = 1; k < 4; k++) differ = differ || legs->fraction[node[k]] != first;
        if (!differ ||
            pliant_volume_is_kept(&model->contact, mesh, t, legs->positions, data->positions, legs->fraction))
            continue;
        for (int k = 1; k < 4; k++) pliant_set_join(legs->island, node[0], node[k]);
        found = true;
    }
    return found;
}

pliant_status pliant_contact_find_islands(const pliant_model *model, pliant_data *data, const pliant_body *surface)
{
    pliant_contact_search *search = data->contact_search;
    const int32_t nodes = data->body->fine.num_nodes;
    pliant_legs *legs = data->legs;
    const pliant_status status = pliant_legs_reserve_fractions(data);
    if (status != PLIANT_OK) return status;
    for (int32_t n = 0; n < nodes + PLIANT_MAX_TOOLS; n++) legs->island[n] = n;
    for (int32_t n = 0; n < nodes; n++) legs->fraction[n] = 1;
    const double obstacles =
        join_pairs(search, pliant_contact_is_within_elements(model) ? &search->outside : NULL, surface, legs);
    do spread_fractions(nodes, legs);
    while (join_elements(model, data)); /* ends, because each pass joins islands */
    for (int32_t n = 0; n < nodes; n++) legs->fraction[n] = fmin(legs->fraction[n], obstacles);
    for (int t = 0; t < data->num_tools; t++) {
        const int32_t root = pliant_set_root(legs->island, nodes + t);
        legs->tool[t].free_fraction = root < nodes ? legs->fraction[root] : 1;
    }
    return PLIANT_OK;
}
