/* Reuse of contact points while little moves. */
#include "base/buffer.h"
#include "base/fail.h"
#include "fem/patch/patch.h"
#include "sim/step/contact_workspace.h"

#include <math.h>
#include <string.h>

static const double on_surface = 1e-3; /* fraction of the guard depth: a point so near is on the part's surface */

/* Identify a part and the number of nodes that its tool holds, because held nodes have no contact points. */
static uint64_t key_of(const pliant_moving_part *part)
{
    return (uint64_t)part->num_held << 32 | (uint64_t)part->kind << 24 | (uint64_t)(part->tool + 1) << 16 |
           (uint64_t)part->index;
}

/* Return whether points can be reused: only in quasi-static steps without plane constraints, detached pieces,
 * contact of tissue on tissue, or patches. */
static bool is_simple(const pliant_model *model, const pliant_data *data)
{
    return data->solver && !data->legs->use_plane_constraints && !data->rigid_pieces &&
           !pliant_contact_touches_itself(model) && pliant_patch_count_tools(data) == 0;
}

pliant_status pliant_contact_copy_found(const pliant_contact_search *from, pliant_contact_search *to)
{
    if (!from->found) return PLIANT_OK;
    if (!pliant_ensure(&to->found_at, (size_t)from->found_nodes, 3 * sizeof *to->found_at))
        return pliant_fail_memory("contacts");
    to->found_nodes = from->found_nodes;
    memcpy(to->found_at, from->found_at, 3 * (size_t)from->found_nodes * sizeof *to->found_at);
    memcpy(to->found_key, from->found_key, sizeof to->found_key);
    memcpy(to->found_pose, from->found_pose, sizeof to->found_pose);
    to->found_revision = from->found_revision;
    to->found_parts = from->found_parts;
    to->found = true;
    return PLIANT_OK;
}

/* Return the largest motion of parts and tissue while points are reused [m]. */
static double max_motion_of(const pliant_model *model, const pliant_contact_search *search)
{
    double maximum = model->contact.search_margin;
    for (int32_t p = 0; p < search->num_parts; p++)
        maximum = fmin(maximum, model->contact.hysteresis * search->part[p].guard);
    return maximum;
}

pliant_status pliant_contact_keep_found(const pliant_model *model, pliant_data *data)
{
    pliant_contact_search *search = data->contact_search;
    const int32_t nodes = search->num_surface_nodes;
    const double maximum = max_motion_of(model, search);
    search->found = false;
    if (!is_simple(model, data)) return PLIANT_OK;
    for (int32_t p = 0; p < search->num_parts; p++)
        if (search->part[p].max_motion > maximum) return PLIANT_OK;
    pliant_contact_complete_surface(model, data, data->positions);
    if (!pliant_ensure(&search->found_at, (size_t)nodes, 3 * sizeof *search->found_at))
        return pliant_fail_memory("contacts");
    search->found_nodes = nodes;
    search->found = true;
    for (int32_t n = 0; n < nodes; n++)
        memcpy(search->found_at + 3 * (size_t)n, search->surface + 3 * (size_t)search->surface_node[n],
               3 * sizeof *search->surface);
    search->found_revision = data->body->revision;
    search->found_parts = search->num_parts;
    for (int32_t p = 0; p < search->num_parts; p++) search->found_key[p] = key_of(search->part + p);
    for (int t = 0; t < data->num_tools; t++) search->found_pose[t] = data->legs->tool[t].ahead;
    return PLIANT_OK;
}

/* Move a point that lies on its part's surface with the part. Return false if it lies deeper: recovery moves such
 * points out gradually, so they are found again. */
static bool move_point(const pliant_contact_search *search, pliant_contact_point *point)
{
    for (int32_t p = 0; p < search->num_parts; p++) {
        const pliant_moving_part *part = search->part + p;
        double local[3], normal[3], end[3], outwards[3];
        if (part->kind != point->kind || part->index != point->part ||
            (part->kind == PLIANT_OBSTACLE_TOOL && part->tool != point->tool))
            continue;
        pliant_pose_from(&part->begin, point->place, local);
        const pliant_part core = pliant_part_core(part->part, part->guard);
        if (fabs(pliant_part_distance(&core, local, outwards) - part->guard) > on_surface * part->guard) return false;
        pliant_pose_turn_back(&part->begin, point->normal, normal);
        pliant_pose_turn(&part->end, normal, point->normal);
        pliant_pose_to(&part->end, local, end);
        for (int d = 0; d < 3; d++) {
            point->drift[d] = end[d] - point->place[d];
            point->place[d] = end[d];
        }
        return true;
    }
    return false;
}

pliant_status pliant_contact_reuse(const pliant_model *model, pliant_data *data, bool *are_reused)
{
    pliant_contact_search *search = data->contact_search;
    const double maximum = max_motion_of(model, search);
    *are_reused = search->found && is_simple(model, data) && search->found_revision == data->body->revision &&
                  search->found_parts == search->num_parts;
    for (int32_t p = 0; p < search->num_parts && *are_reused; p++)
        *are_reused = search->found_key[p] == key_of(search->part + p);
    for (int32_t p = 0; p < search->num_parts && *are_reused; p++) {
        const pliant_moving_part *part = search->part + p;
        if (part->kind == PLIANT_OBSTACLE_TOOL)
            *are_reused =
                pliant_part_max_motion(part->shape, part->part, search->found_pose + part->tool, &part->to) <= maximum;
    }
    if (*are_reused) pliant_contact_complete_surface(model, data, data->positions);
    for (int32_t n = 0; n < search->num_surface_nodes && *are_reused; n++) {
        const double *a = search->found_at + 3 * (size_t)n, *b = search->surface + 3 * (size_t)search->surface_node[n];
        *are_reused = (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2]) <=
                      maximum * maximum;
    }
    pliant_status status = *are_reused ? pliant_contacts_copy(&data->contacts, &search->point_buffer) : PLIANT_OK;
    while (*are_reused && search->point_buffer.count > 0 &&
           search->point_buffer.point[search->point_buffer.count - 1].kind == PLIANT_OBSTACLE_ELEMENT)
        search->point_buffer.count--; /* points of the volume bound are found again in every leg */
    for (int32_t n = 0; n < search->point_buffer.count && *are_reused && status == PLIANT_OK; n++)
        *are_reused = move_point(search, search->point_buffer.point + n);
    if (!*are_reused) search->point_buffer.count = 0;
    return status;
}
