/* The surface that contact uses, and the largest fraction of a leg that is free of penetration. */
#include "backend/backend.h"
#include "base/buffer.h"
#include "base/fail.h"
#include "fem/dynamics/tled.h"
#include "contact/advance/advance_rules.h"
#include "contact/advance/pair.h"
#include "sim/step/contact_workspace.h"
#include "tool/clearance.h"

#include <math.h>
#include <string.h>

/* List the nodes of the surface's triangles. Errors: MEMORY. */
static pliant_status list_surface_nodes(pliant_contact_search *search, const pliant_body *body)
{
    const int32_t nodes = body->fine.num_nodes;
    if (search->surface_revision == body->revision) return PLIANT_OK;
    search->surface_revision = 0;
    if (!pliant_grow(&search->surface_node, (size_t)nodes + 1, sizeof *search->surface_node))
        return pliant_fail_memory("contacts");
    int32_t *node = search->surface_node;
    memset(node, 0, ((size_t)nodes + 1) * sizeof *node);
    for (int32_t c = 0; c < 3 * body->num_triangles; c++) node[body->triangles[c]] = 1;
    search->num_surface_nodes = 0;
    for (int32_t n = 0; n < nodes; n++)
        if (node[n]) node[search->num_surface_nodes++] = n; /* at most n entries before n */
    search->surface_revision = body->revision;
    return PLIANT_OK;
}

/* Set the topology of the surface. outside: out: its corners; NULL: the corners are the nodes. Errors: MEMORY. */
static pliant_status choose_surface(const pliant_model *model, pliant_data *data, const pliant_body **body,
                                    pliant_contact_surface **outside)
{
    pliant_contact_search *search = data->contact_search;
    *body = data->body;
    *outside = NULL;
    if (!pliant_contact_is_within_elements(model)) return list_surface_nodes(search, data->body);
    const pliant_contact_surface_voxels voxels = {.load = model->body,
                                                  .geometry = &model->scan->geometry,
                                                  .material_of_voxel = model->material_of_voxel,
                                                  .materials = &model->materials,
                                                  .min_cube_tissue = model->scene.element.kind == PLIANT_HEXAHEDRA
                                                                         ? model->contact.min_cube_tissue
                                                                         : 0,
                                                  .has_self_contact = pliant_contact_touches_itself(model),
                                                  .threads = data->discretization->system->num_threads};
    const pliant_status status = pliant_contact_surface_set_body(&search->outside, &voxels, data->body);
    *outside = &search->outside;
    *body = &search->outside.view;
    return status == PLIANT_OK ? list_surface_nodes(search, *body) : status;
}

/* Compute the corners of the surface. Contact of tissue on tissue needs all nodes, since its tetrahedra have other
 * nodes than the surface. */
static void find_corners(const pliant_model *model, pliant_data *data, const double *positions, double *out)
{
    const pliant_contact_search *search = data->contact_search;
    const bool all = pliant_contact_touches_itself(model);
    pliant_contact_surface_corners(pliant_contact_is_within_elements(model) ? &search->outside : NULL,
                                   all ? data->body->fine.num_nodes : search->num_surface_nodes,
                                   all ? NULL : search->surface_node, positions,
                                   data->discretization->system->num_threads, out);
}

pliant_status pliant_contact_find_surface(const pliant_model *model, pliant_data *data, const pliant_body **body,
                                          const double **positions)
{
    pliant_contact_surface *outside = NULL;
    const pliant_status status = choose_surface(model, data, body, &outside);
    *positions = outside ? outside->positions : data->positions;
    if (status == PLIANT_OK && outside) find_corners(model, data, data->positions, outside->positions);
    return status;
}

pliant_status pliant_contact_begin_surface(const pliant_model *model, pliant_data *data, const pliant_body **body)
{
    pliant_contact_search *search = data->contact_search;
    const int32_t nodes = data->body->fine.num_nodes;
    pliant_contact_surface *outside = NULL;
    search->has_surface = search->has_box = false;
    const pliant_status status = choose_surface(model, data, body, &outside);
    if (status != PLIANT_OK) return status;
    if (!pliant_ensure(&search->surface, (size_t)nodes, 3 * sizeof *search->surface))
        return pliant_fail_memory("contacts");
    if (!pliant_contact_touches_itself(model)) return PLIANT_OK;
    pliant_contact_complete_surface(model, data, data->positions);
    if (outside) memcpy(outside->positions, search->surface, 3 * (size_t)nodes * sizeof *search->surface);
    return PLIANT_OK;
}

void pliant_contact_complete_surface(const pliant_model *model, pliant_data *data, const double *positions)
{
    pliant_contact_search *search = data->contact_search;
    if (!search->has_surface) find_corners(model, data, positions, search->surface);
    search->has_surface = true;
}

/* Compute the corners of the listed triangles at the start of the leg, and in a leg also at its end. */
static void find_listed_corners(const pliant_contact_near *on, const pliant_near_surface *surface,
                                const pliant_triangle_list *list)
{
    const pliant_data *data = on->data;
    pliant_contact_search *search = data->contact_search;
    const double *start = on->in_leg ? data->legs->positions : data->positions;
    for (int32_t n = 0; n < 3 * list->count; n++) {
        const int32_t node = surface->body->triangles[3 * (size_t)list->triangle[n / 3] + (size_t)(n % 3)];
        const size_t at = 3 * (size_t)node;
        if (!search->has_surface) pliant_contact_surface_corner(surface->corners, node, start, search->surface + at);
        if (on->in_leg && surface->corners)
            pliant_contact_surface_corner(surface->corners, node, data->positions, search->outside.positions + at);
    }
}

bool pliant_contact_find_near(void *context, int32_t count, const pliant_near_region *regions,
                              pliant_triangle_list *out)
{
    const pliant_contact_near *on = context;
    pliant_data *data = on->data;
    pliant_contact_surface *outside =
        pliant_contact_is_within_elements(on->model) ? &data->contact_search->outside : NULL;
    const pliant_near_surface surface = {outside ? &outside->view : data->body, outside};
    if (data->backend->find_near && data->backend->find_near(data, &surface, on->in_leg, count, regions, out)) {
        find_listed_corners(on, &surface, out);
        return true;
    }
    pliant_contact_complete_surface(on->model, data, on->in_leg ? data->legs->positions : data->positions);
    if (on->in_leg && outside) find_corners(on->model, data, data->positions, outside->positions);
    return false;
}

/* ---- largest free fraction of a leg */

static pliant_status reserve_search(pliant_contact_search *search)
{
    return search->advance ? PLIANT_OK : pliant_advance_create(&search->settings, &search->advance);
}

double pliant_contact_advance_cuts(const pliant_model *model, const pliant_data *data)
{
    const pliant_contact_search *search = data->contact_search;
    if (!search->tissue.has_slid || !pliant_contact_touches_itself(model)) return 1;
    const double thickness = pliant_contact_tissue_rule(model, data, 0).thickness;
    return pliant_cut_advance(data->body, search->tissue.num_faces, search->tissue.face, search->tissue.has_slid,
                              search->tissue.piece, data->legs->positions, data->positions,
                              pliant_advance_min_distance(&model->contact, thickness));
}

pliant_status pliant_contact_advance_tissue(const pliant_model *model, pliant_data *data, double *fraction)
{
    pliant_contact_search *search = data->contact_search;
    const pliant_tissue_rule rule = pliant_contact_tissue_rule(model, data, 0);
    const pliant_body *body = NULL;
    const double *positions = NULL;
    *fraction = 1;
    if (!(rule.thickness > 0) || !search->tissue.exempt || !pliant_contact_touches_itself(model)) return PLIANT_OK;
    const pliant_status status = pliant_contact_find_surface(model, data, &body, &positions);
    return status == PLIANT_OK ? pliant_tissue_advance(&search->tissue, search->surface, positions, &rule, fraction)
                               : status;
}

/* Return the tool of a part of the search. NULL: an obstacle. */
static const pliant_leg_tool *leg_of_part(const pliant_data *data, int32_t part)
{
    const pliant_moving_part *of = data->contact_search->part + part;
    return of->kind == PLIANT_OBSTACLE_TOOL ? data->legs->tool + of->tool : NULL;
}

pliant_status pliant_contact_advance(const pliant_model *model, pliant_data *data, double fraction, bool find_islands,
                                     double *out)
{
    pliant_contact_search *search = data->contact_search;
    pliant_contact_near near = {model, data, true};
    const pliant_near_finder finder = {pliant_contact_find_near, &near};
    const pliant_body *body = NULL;
    pliant_contact_surface *outside = NULL;
    pliant_status status = reserve_search(search);
    for (int t = 0; t < data->num_tools; t++) data->legs->tool[t].free_fraction = 1;
    for (int32_t p = 0; p < search->num_parts; p++) {
        const pliant_leg_tool *leg = leg_of_part(data, p);
        if (leg)
            search->advance_part[p].to =
                fraction < 1 ? pliant_tool_pose_between(&leg->begin, &leg->goal, fraction) : leg->goal;
    }
    if (status == PLIANT_OK) status = choose_surface(model, data, &body, &outside);
    if (status != PLIANT_OK) return status;
    pliant_advance_set_finder(search->advance, &finder);
    status = pliant_advance_find(search->advance, body->num_triangles, body->triangles, search->surface,
                                 outside ? outside->positions : data->positions, search->num_parts,
                                 search->advance_part, data->discretization->system->num_threads, find_islands, out);
    pliant_advance_set_finder(search->advance, NULL);
    return status == PLIANT_OK && find_islands && *out < 1 ? pliant_contact_find_islands(model, data, body) : status;
}

bool pliant_contact_is_outside_cores(const pliant_model *model, pliant_data *data)
{
    pliant_contact_search *search = data->contact_search;
    const pliant_body *body = NULL;
    const double *positions = NULL;
    const pliant_advance_pair *pair = NULL;
    pliant_advance_audit_result found;
    for (int32_t n = pliant_advance_get_pairs(search->advance, &pair); n > 0; n--)
        if (pair[n - 1].exempt) return true;
    if (pliant_contact_find_surface(model, data, &body, &positions) != PLIANT_OK) return true;
    for (int32_t p = 0; p < search->num_parts; p++) {
        search->advance_part[p].released = false;
        if (leg_of_part(data, p))
            search->advance_part[p].from = search->advance_part[p].to =
                pliant_tool_proxy(data->tools + search->part[p].tool);
    }
    return pliant_advance_audit(search->advance, body->num_triangles, body->triangles, positions, search->num_parts,
                                search->advance_part, data->discretization->system->num_threads, &found) != PLIANT_OK ||
           (found.minimum > 0 && found.crossings == 0);
}

static const pliant_moving_part *find_part(const pliant_contact_search *search, const pliant_contact_point *point)
{
    for (int32_t p = 0; p < search->num_parts; p++)
        if (search->part[p].kind == PLIANT_OBSTACLE_TOOL && search->part[p].tool == point->tool &&
            search->part[p].index == point->part)
            return search->part + p;
    return NULL;
}

void pliant_contact_follow_proxies(pliant_data *data)
{
    for (int32_t n = 0; n < data->contacts.count; n++) {
        pliant_contact_point *point = data->contacts.point + n;
        const pliant_moving_part *part =
            point->kind == PLIANT_OBSTACLE_TOOL ? find_part(data->contact_search, point) : NULL;
        if (!part) continue;
        const pliant_tool *tool = data->tools + point->tool;
        const pliant_tool_pose proxy = pliant_tool_proxy(tool);
        pliant_pose now;
        double local[3];
        pliant_part_pose(&tool->shape, part->part->frame, proxy.tip, proxy.rotation, proxy.jaw, &now);
        pliant_pose_from(&part->end, point->place, local);
        pliant_pose_to(&now, local, point->place); /* the normal stays: the force lies in the cone around it */
    }
}

/* Return whether the whole tool is inside tissue. Tested are the centers of its parts and the ends of capsules. */
static bool is_inside_at(const pliant_model *model, const pliant_data *data, const pliant_tool *tool,
                         const pliant_tool_pose *at)
{
    bool inside = true;
    for (int32_t p = 0; p < tool->shape.num_parts && inside; p++) {
        const pliant_part *part = tool->shape.part + p;
        double local[3][3], x[3];
        pliant_pose pose;
        pliant_part_pose(&tool->shape, part->frame, at->tip, at->rotation, at->jaw, &pose);
        pliant_part_centre(part, local[0]);
        memcpy(local[1], part->from, sizeof local[1]);
        memcpy(local[2], part->to, sizeof local[2]);
        for (int n = 0; n < (part->kind == PLIANT_PART_CAPSULE ? 3 : 1) && inside; n++) {
            pliant_pose_to(&pose, local[n], x);
            inside = pliant_clearance_of(model, data, x) < 0;
        }
    }
    return inside;
}

pliant_status pliant_contact_is_free(const pliant_model *model, pliant_data *data, int index,
                                     const pliant_tool_pose *pose, bool *is_free, bool *is_inside)
{
    pliant_status status = pliant_contact_search_create(&model->contact, &data->contact_search);
    if (status != PLIANT_OK) return status;
    pliant_contact_search *search = data->contact_search;
    const pliant_tool *tool = data->tools + index;
    const pliant_body *body = NULL;
    const double *positions = NULL;
    pliant_advance_part part[PLIANT_MAX_PARTS];
    int32_t count = 0;
    for (int32_t p = 0; p < tool->shape.num_parts; p++)
        part[count++] = (pliant_advance_part){.part = tool->shape.part + p,
                                              .shape = &tool->shape,
                                              .from = *pose,
                                              .to = *pose,
                                              .guard = pliant_contact_guard(model, data, tool->shape.part + p),
                                              .num_held = pliant_tool_grips(tool) ? tool->num_held : 0,
                                              .held = tool->held};
    pliant_advance_audit_result found;
    status = reserve_search(search);
    if (status == PLIANT_OK) status = pliant_contact_find_surface(model, data, &body, &positions);
    if (status == PLIANT_OK)
        status = pliant_advance_audit(search->advance, body->num_triangles, body->triangles, positions, count, part,
                                      data->discretization->system->num_threads, &found);
    if (status != PLIANT_OK) return status;
    *is_free = found.minimum > 0;
    *is_inside = is_inside_at(model, data, tool, pose);
    return PLIANT_OK;
}

/* Compute the bounding box of the surface, unless the leg has it already. Return false if out of memory. */
static bool find_box(pliant_data *data)
{
    pliant_contact_search *search = data->contact_search;
    const pliant_body *body = NULL;
    const double *positions = NULL;
    if (search->has_box) return true;
    if (pliant_contact_find_surface(data->model, data, &body, &positions) != PLIANT_OK) return false;
    for (int d = 0; d < 3; d++) {
        search->low[d] = INFINITY;
        search->high[d] = -INFINITY;
    }
    for (int32_t n = 0; n < search->num_surface_nodes; n++)
        for (int d = 0; d < 3; d++) {
            const double x = positions[3 * (size_t)search->surface_node[n] + (size_t)d];
            search->low[d] = x < search->low[d] ? x : search->low[d]; /* several times faster than fmin here */
            search->high[d] = x > search->high[d] ? x : search->high[d];
        }
    search->has_box = true;
    return true;
}

/* Return whether the tool pressed on tissue at the end of the last leg. */
static bool presses(const pliant_data *data, const pliant_tool *tool)
{
    bool any = false;
    for (int32_t n = 0; n < data->contacts.count && !any; n++) {
        const pliant_contact_point *point = data->contacts.point + n;
        any = point->kind == PLIANT_OBSTACLE_TOOL && data->tools + point->tool == tool && point->was_pressed;
    }
    return any;
}

bool pliant_contact_is_near(pliant_data *data, const pliant_tool *tool, const pliant_tool_pose *from,
                            const pliant_tool_pose *to)
{
    const pliant_contact_search *search = data->contact_search;
    bool near = false;
    if (search && (presses(data, tool) || !find_box(data))) return true;
    for (int32_t p = 0; search && p < tool->shape.num_parts && !near; p++) {
        const pliant_part *part = tool->shape.part + p;
        const double reach = pliant_part_max_motion(&tool->shape, part, from, to) + data->model->contact.search_margin;
        double low[3], high[3];
        pliant_pose pose;
        pliant_part_pose(&tool->shape, part->frame, from->tip, from->rotation, from->jaw, &pose);
        pliant_part_box(part, &pose, low, high);
        near = true;
        for (int d = 0; d < 3; d++)
            near = near && low[d] - reach <= search->high[d] && high[d] + reach >= search->low[d];
    }
    return near;
}
