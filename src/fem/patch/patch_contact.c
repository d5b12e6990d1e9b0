/* Patches and contact. A tool that presses with its shape gets a patch around the pressed nodes, like a tool that
 * holds. Its force distribution at the time of the request replaces a grasp's weights. The patch handles contact points
 * whose nodes it moves freely. All other points act on the coarse model. */
#include "base/fail.h"
#include "contact/detect/part_contacts.h"
#include "fem/patch/patch_job.h"
#include "base/memory.h"
#include "base/vector3.h"

#include <math.h>
#include <string.h>

#define OF_A_PRESS ((uint64_t)1 << 63) /* larger than any number of a tool's hold */

uint64_t patch_hold_of(const pliant_data *data, int tool)
{
    return pliant_tool_grips(data->tools + tool) ? data->tools[tool].hold : data->patch->press[tool].hold;
}

bool patch_still_held(const pliant_data *data, int tool, uint64_t hold)
{
    if (hold == 0 || tool >= data->num_tools) return false;
    if (pliant_tool_grips(data->tools + tool)) return data->tools[tool].hold == hold;
    return data->patch->press[tool].hold == hold || data->patch->press[tool].before == hold;
}

/* Find the rest position at which a tool presses.
 * @return Sum of its contact forces [N]; -1: it is near no tissue. */
static double find_centre(const pliant_data *data, int tool, double centre[3])
{
    double sum = -1;
    memset(centre, 0, 3 * sizeof *centre);
    for (int32_t p = 0; p < data->contacts.count; p++) {
        const pliant_contact_point *point = data->contacts.point + p;
        if (point->kind != PLIANT_OBSTACLE_TOOL || point->tool != tool) continue;
        const double force = pliant_length3(point->force);
        sum = fmax(sum, 0) + force;
        for (int32_t k = 0; k < point->count; k++)
            for (int d = 0; d < 3; d++)
                centre[d] += force * point->weight[k] * data->body->fine.rest[3 * (size_t)point->node[k] + (size_t)d];
    }
    for (int d = 0; d < 3 && sum > 0; d++) centre[d] /= sum;
    return sum;
}

void patch_find_presses(pliant_data *data)
{
    pliant_patch *patch = data->patch;
    const double farther = 0.5; /* fraction of the radius; beyond it, a patch at the new position is requested */
    for (int t = 0; t < data->num_tools; t++) {
        patch_press *press = patch->press + t;
        double centre[3], offset[3];
        const double force = pliant_tool_grips(data->tools + t) ? -1 : find_centre(data, t, centre);
        if (force < 0) memset(press, 0, sizeof *press);
        /* The press has ended before its patch was started. */
        if (force == 0 && !patch->job.running && patch->holds[t].hold != press->hold) {
            press->hold = patch->holds[t].hold == press->before ? press->before : 0;
            press->before = 0;
        }
        if (!(force > 0)) continue;
        for (int d = 0; d < 3; d++) offset[d] = centre[d] - press->centre[d];
        if (press->hold && pliant_length3(offset) < farther * patch->scene->model.patch) continue;
        if (press->hold && patch->job.running) continue; /* one after the other */
        /* Until the patch for the new press is ready. */
        if (patch->is_in_basis[t] && press->hold) press->before = press->hold;
        press->hold = OF_A_PRESS | ++patch->num_presses;
        memcpy(press->centre, centre, sizeof centre);
    }
}

pliant_status patch_press_copy(const pliant_data *data, int tool, patch_hold *out)
{
    const pliant_patch *patch = data->patch;
    pliant_footprint footprint = {.count = 0};
    int32_t capacity = 0;
    double sum = 0;
    for (int32_t p = 0; p < data->contacts.count; p++) capacity += data->contacts.point[p].count;
    footprint.nodes = pliant_calloc((size_t)capacity + 1, sizeof *footprint.nodes);
    footprint.weights = pliant_calloc((size_t)capacity + 1, sizeof *footprint.weights);
    if (!footprint.nodes || !footprint.weights) {
        pliant_free(footprint.nodes);
        pliant_free(footprint.weights);
        return pliant_fail_memory("a patch");
    }
    for (int32_t p = 0; p < data->contacts.count; p++) {
        const pliant_contact_point *point = data->contacts.point + p;
        const double force = pliant_length3(point->force);
        if (point->kind != PLIANT_OBSTACLE_TOOL || point->tool != tool || !(force > 0)) continue;
        for (int32_t k = 0; k < point->count; k++) {
            int32_t h = 0;
            while (h < footprint.count && footprint.nodes[h] != point->node[k]) h++;
            if (h == footprint.count) footprint.nodes[footprint.count++] = point->node[k];
            footprint.weights[h] += force * point->weight[k];
            sum += force * point->weight[k];
        }
    }
    for (int32_t h = 0; h < footprint.count; h++) footprint.weights[h] /= sum;
    memcpy(footprint.centre, patch->press[tool].centre, sizeof footprint.centre);
    *out = (patch_hold){.hold = patch->press[tool].hold, .footprint = footprint};
    return PLIANT_OK;
}

/* ---- Assignment of contact points. */

static pliant_status reserve(pliant_patch *patch, const pliant_data *data)
{
    const int32_t count = data->contacts.count, nodes = data->body->fine.num_nodes;
    pliant_status status = pliant_contacts_reserve(&patch->inside, count);
    if (status == PLIANT_OK) status = pliant_contacts_reserve(&patch->outside, count);
    if (status != PLIANT_OK) return status;
    if (count > patch->point_capacity) {
        int32_t *of = pliant_resize(patch->point_of, 2 * (size_t)count, sizeof *of);
        if (!of) return pliant_fail_memory("a patch");
        patch->point_of = of;
        patch->point_capacity = 2 * count;
    }
    if (!patch->own && !(patch->own = pliant_calloc((size_t)nodes, 1))) return pliant_fail_memory("a patch");
    memset(patch->own, 0, (size_t)nodes);
    const pliant_basis *basis = patch->basis;
    for (int32_t n = 0; n < basis->num_own; n++)
        patch->own[basis->fine_node[basis->system.node_of_free[basis->own[n]]]] = 1;
    return PLIANT_OK;
}

static bool is_inside(const pliant_patch *patch, const pliant_contact_point *point)
{
    for (int32_t k = 0; k < point->count; k++)
        if (!patch->own[point->node[k]]) return false;
    return true;
}

pliant_status pliant_patch_select_coarse_points(pliant_data *data, pliant_contacts **coarse)
{
    pliant_patch *patch = data->patch;
    *coarse = &data->contacts;
    if (!patch) return PLIANT_OK;
    patch->inside.count = patch->outside.count = 0;
    if (!patch->basis || patch->is_suspended || data->contacts.count == 0) return PLIANT_OK;
    pliant_status status = reserve(patch, data);
    if (status != PLIANT_OK) return status;
    for (int32_t p = 0; p < data->contacts.count; p++) {
        const pliant_contact_point *point = data->contacts.point + p;
        const bool inside = is_inside(patch, point);
        pliant_contacts *to = inside ? &patch->inside : &patch->outside;
        patch->point_of[p] = inside ? -1 - to->count : to->count;
        to->point[to->count] = *point;
        for (int32_t k = 0; k < point->count && inside; k++)
            to->point[to->count].node[k] = patch->basis->near_node[point->node[k]];
        to->count++;
    }
    *coarse = &patch->outside;
    return PLIANT_OK;
}

void patch_merge(pliant_data *data)
{
    const pliant_patch *patch = data->patch;
    if (patch->inside.count + patch->outside.count != data->contacts.count) return;
    for (int32_t p = 0; p < data->contacts.count; p++) {
        const int32_t of = patch->point_of[p];
        const pliant_contact_point *from = of < 0 ? patch->inside.point + (-1 - of) : patch->outside.point + of;
        pliant_contact_point *point = data->contacts.point + p;
        memcpy(point->force, from->force, sizeof point->force);
        memcpy(point->anchor, from->anchor, sizeof point->anchor);
        point->was_pressed = from->was_pressed;
    }
}

void patch_contact_free(pliant_patch *patch)
{
    PLIANT_FREE(patch->inside.point, patch->outside.point, patch->point_of, patch->own);
}
