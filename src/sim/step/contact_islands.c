/* Islands of contact: one fraction of a leg for each group of nodes and tools that contact joins. */
#include "base/fail.h"
#include "base/memory.h"
#include "base/union_find.h"
#include "contact/advance/pair.h"
#include "sim/step/contact_workspace.h"

#include <math.h>

pliant_status pliant_legs_reserve_fractions(const pliant_data *data)
{
    pliant_legs *legs = data->legs;
    const int32_t nodes = data->body->fine.num_nodes;
    if (nodes <= legs->fraction_capacity) return PLIANT_OK;
    double *fraction = pliant_resize(legs->fraction, (size_t)nodes, sizeof *fraction);
    if (fraction) legs->fraction = fraction;
    int32_t *island = pliant_resize(legs->island, (size_t)nodes + PLIANT_MAX_TOOLS, sizeof *island);
    if (island) legs->island = island;
    if (!fraction || !island) return pliant_fail_memory("contacts");
    legs->fraction_capacity = nodes;
    return PLIANT_OK;
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

pliant_status pliant_contact_find_islands(const pliant_model *model, pliant_data *data, const pliant_body *surface)
{
    const pliant_contact_search *search = data->contact_search;
    const pliant_contact_surface *outside = pliant_contact_is_within_elements(model) ? &search->outside : NULL;
    const int32_t nodes = data->body->fine.num_nodes;
    const pliant_advance_pair *pair = NULL;
    const int32_t num_pairs = pliant_advance_get_pairs(search->advance, &pair);
    pliant_status status = pliant_legs_reserve_fractions(data);
    if (status != PLIANT_OK) return status;
    int32_t *island = data->legs->island;
    double *fraction = data->legs->fraction, obstacles = 1;
    for (int32_t n = 0; n < nodes + PLIANT_MAX_TOOLS; n++) island[n] = n;
    for (int32_t n = 0; n < nodes; n++) fraction[n] = 1;
    for (int32_t p = 0; p < num_pairs; p++) {
        const pliant_moving_part *part = search->part + pair[p].part;
        const int32_t first = join_triangle(outside, surface->triangles + 3 * (size_t)pair[p].triangle, island);
        if (part->kind == PLIANT_OBSTACLE_TOOL) pliant_set_join(island, first, nodes + part->tool);
        else obstacles = fmin(obstacles, pair[p].t);
    }
    for (int32_t p = 0; p < num_pairs; p++) {
        const int32_t *corner = surface->triangles + 3 * (size_t)pair[p].triangle;
        const int32_t root = pliant_set_root(island, join_triangle(outside, corner, island));
        fraction[root] = fmin(fraction[root], pair[p].t);
    }
    for (int32_t n = 0; n < nodes; n++) /* a root comes first */
        fraction[n] = fmin(fraction[pliant_set_root(island, n)], obstacles);
    for (int t = 0; t < data->num_tools; t++) {
        const int32_t root = pliant_set_root(island, nodes + t);
        data->legs->tool[t].free_fraction = root < nodes ? fraction[root] : 1;
    }
    return PLIANT_OK;
}
