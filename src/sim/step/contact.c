/* The contact stage: gather the parts of tools and obstacles, and find the contact points of a leg. */
#include "backend/backend.h"
#include "base/buffer.h"
#include "base/fail.h"
#include "base/memory.h"
#include "contact/volume/volume_bound.h"
#include "fem/dynamics/tled.h"
#include "fem/patch/patch.h"
#include "fem/rigid/rigid_pieces.h"
#include "sim/step/contact_workspace.h"

#include <math.h>

/* ---- moving parts of this leg */

/* Return the fraction of a penetration depth by which a tool's surface moves out in this leg. The work of this motion
 * is the tool's. Without it, tissue under a resting tool would sink in slowly. A tool that is placed in tissue moves it
 * out in one leg. */
static double pushed_depth_fraction(const pliant_model *model, const pliant_data *data, int t)
{
    if (!data->body->has_inertia) return 0;
    const bool is_placed = data->legs->first && data->legs->tool[t].is_placed;
    return is_placed ? 1 : 1 - pliant_contact_remaining_depth_fraction(model, data);
}

static void add_part(const pliant_model *model, const pliant_data *data, int t, int32_t p)
{
    pliant_contact_search *search = data->contact_search;
    const pliant_tool *tool = data->tools + t;
    const pliant_part *part = tool->shape.part + p;
    const pliant_tool_pose *begin = &data->legs->tool[t].begin, *goal = &data->legs->tool[t].ahead;
    const int32_t num_held = pliant_tool_grips(tool) ? tool->num_held : 0;
    const double max_motion = pliant_part_max_motion(&tool->shape, part, begin, goal);
    pliant_moving_part *moving = search->part + search->num_parts;
    *moving = (pliant_moving_part){
        .part = part,
        .kind = PLIANT_OBSTACLE_TOOL,
        .tool = t,
        .index = p,
        .friction = model->scene.contact.friction,
        .guard = pliant_contact_guard(model, data, part),
        .core_offset = pliant_contact_core_offset(part),
        .margin = model->contact.search_margin + max_motion,
        .shape = &tool->shape,
        .from = *begin,
        .to = *goal,
        .max_motion = max_motion,
        .recovery = pliant_contact_max_recovery(model, data),
        .pushed_depth_fraction = pushed_depth_fraction(model, data, t),
        .num_held = num_held,
        .held = tool->held,
    };
    pliant_part_pose(&tool->shape, part->frame, begin->tip, begin->rotation, begin->jaw, &moving->begin);
    pliant_part_pose(&tool->shape, part->frame, goal->tip, goal->rotation, goal->jaw, &moving->end);
    search->advance_part[search->num_parts++] = (pliant_advance_part){.part = part,
                                                                      .shape = &tool->shape,
                                                                      .from = *begin,
                                                                      .to = *goal,
                                                                      .guard = moving->guard,
                                                                      .released = true,
                                                                      .num_held = num_held,
                                                                      .held = tool->held};
}

static void add_obstacle(const pliant_model *model, const pliant_data *data, const pliant_part *part, int32_t index)
{
    pliant_contact_search *search = data->contact_search;
    const pliant_pose still = {.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    const double guard = pliant_contact_guard(model, data, part);
    search->advance_part[search->num_parts] = (pliant_advance_part){.part = part, .guard = guard, .released = true};
    search->part[search->num_parts++] =
        (pliant_moving_part){.part = part,
                             .kind = PLIANT_OBSTACLE_GROUND,
                             .tool = -1,
                             .index = index,
                             .friction = model->scene.contact.friction,
                             .begin = still,
                             .end = still,
                             .guard = guard,
                             .core_offset = pliant_contact_core_offset(part),
                             .margin = model->contact.search_margin,
                             .recovery = pliant_contact_max_recovery(model, data),
                             .remaining_depth_fraction = pliant_contact_remaining_depth_fraction(model, data)};
}

/* Gather the parts of tools and obstacles for this leg. Released tools and cutting parts of active blades are left
 * out. */
static void gather_parts(const pliant_model *model, pliant_data *data)
{
    pliant_contact_search *search = data->contact_search;
    search->num_parts = 0;
    for (int t = 0; t < data->num_tools; t++) {
        const pliant_tool *tool = data->tools + t;
        for (int32_t p = 0; tool->present && !tool->proxy.released && p < tool->shape.num_parts; p++)
            if (!(tool->shape.part[p].cuts && tool->blade.cutting)) add_part(model, data, t, p);
    }
    const int32_t count = pliant_contact_obstacles(model, search->obstacle);
    for (int32_t n = 0; n < count + model->obstacles.num_parts; n++)
        add_obstacle(model, data, n < count ? search->obstacle + n : model->obstacles.part + (n - count), n);
}

/* ---- the stage */

/* Return whether legs keep elements from inverting in a step without contact: a tool that holds tissue can pull it
 * strongly, and a blade that slips releases tissue in one step. */
static bool keeps_volumes_of_pull(const pliant_data *data)
{
    bool any = false;
    for (int t = 0; t < data->num_tools; t++) {
        const pliant_tool *tool = data->tools + t;
        any = any || (tool->present && (tool->holding || tool->blade.cutting));
    }
    return any;
}

bool pliant_contact_is_idle(const pliant_model *model, const pliant_data *data)
{
    if (pliant_contact_touches_itself(model) || keeps_volumes_of_pull(data)) return false;
    if (model->scene.obstacles.num_boxes + model->scene.obstacles.num_planes > 0 || model->obstacles.num_parts > 0)
        return false;
    for (int t = 0; t < data->num_tools; t++)
        if (data->tools[t].present && data->tools[t].shape.num_parts > 0) return false;
    return true;
}

/* Copy forces and anchors from the previous points with the same features to the points from `first` on. Both lists
 * are sorted by feature. */
static void carry(const pliant_data *data, const pliant_contacts *before, int32_t first, pliant_contacts *now)
{
    int32_t b = 0;
    for (int32_t n = first; n < now->count; n++) {
        while (b < before->count && before->point[b].feature < now->point[n].feature) b++;
        if (b == before->count || before->point[b].feature != now->point[n].feature) continue;
        bool there = true; /* an undone cut may have removed the node */
        for (int32_t k = 0; k < before->point[b].count; k++)
            there = there && before->point[b].node[k] < data->body->fine.num_nodes;
        if (there) pliant_contact_warm_start(before->point + b, data->positions, now->point + n);
    }
}

/* contact/response: paper. Without delay, every node of the surface's tetrahedra gets a point, and each sub-step
 * determines which of them are slowed. */
static pliant_status find_slowed(const pliant_model *model, pliant_data *data, pliant_contacts *out)
{
    pliant_contact_search *search = data->contact_search;
    const pliant_tissue *tissue = &search->tissue;
    const pliant_mesh *mesh = &data->body->fine;
    if (!pliant_ensure(&search->overlaps, (size_t)mesh->num_nodes, 1) ||
        !pliant_ensure(&search->place, (size_t)mesh->num_nodes, 3 * sizeof *search->place))
        return pliant_fail_memory("the self-contacts of the tissue");
    pliant_status status = pliant_tissue_overlapping(&search->tissue, data->positions, search->overlaps);
    for (int32_t t = 0; !model->scene.contact.delay && t < tissue->num_tets; t++)
        for (int v = 0; v < 4; v++) search->overlaps[mesh->tets[4 * (size_t)tissue->tet[t] + (size_t)v]] = 1;
    if (status == PLIANT_OK)
        status = pliant_tissue_find_slowed(tissue, search->overlaps, model->scene.contact.overlap_damping, out);
    if (status == PLIANT_OK && !model->scene.contact.delay)
        data->tled->overlap_damping = (pliant_tled_overlap_damping){
            .tissue = &search->tissue, .overlaps = search->overlaps, .place = search->place};
    return status;
}

/* max_piece_motion: largest motion of detached pieces in this step [m] */
static pliant_status find_tissue(const pliant_model *model, pliant_data *data, double max_piece_motion,
                                 pliant_contacts *out)
{
    pliant_tissue *tissue = &data->contact_search->tissue;
    pliant_impact_zones *zones = &data->contact_search->zones;
    pliant_contact_surface *outside = pliant_contact_is_within_elements(model) ? &data->contact_search->outside : NULL;
    const int threads = data->discretization->system->num_threads;
    pliant_status status = pliant_tissue_set_body(tissue, data->body, outside ? outside->solid : NULL, threads);
    if (status != PLIANT_OK || tissue->num_triangles == 0) return status;
    pliant_tissue_set_searcher(tissue, data->backend->searcher);
    if (model->scene.contact.response == PLIANT_RESPONSE_PAPER) return find_slowed(model, data, out);
    const pliant_tissue_rule rule = pliant_contact_tissue_rule(model, data, max_piece_motion);
    const bool has_zones = data->body->has_inertia && data->backend->state_is_on_host && rule.thickness > 0;
    if (outside && rule.thickness > 0 && !tissue->exempt) {
        const pliant_mesh *mesh = &data->body->fine;
        pliant_contact_surface_corners(outside, mesh->num_nodes, NULL, mesh->rest, threads, outside->positions);
        status = pliant_tissue_set_rest(tissue, outside->positions);
        pliant_contact_surface_corners(outside, mesh->num_nodes, NULL, data->positions, threads, outside->positions);
    }
    if (status == PLIANT_OK)
        status = pliant_tissue_find(tissue, outside ? outside->positions : data->positions, &rule, out);
    if (status == PLIANT_OK && has_zones) status = pliant_impact_zones_set(zones, tissue, outside, &rule);
    if (status == PLIANT_OK && has_zones) data->tled->zones = zones;
    return status;
}

/* Replace the compliance from the previous leg's points by that from this leg's points, if there are any. */
static void add_piece_compliance(pliant_data *data, const pliant_leg_tool *leg, int t)
{
    pliant_contact_body *couple = data->legs->proxy + 2 * t;
    pliant_touch_limit *limit = data->legs->limit + 3 * t;
    const double *axis = limit[2].axis;
    double piece_compliance[2];
    pliant_proxy_compliance(data, t, false, couple[1].centre, axis, piece_compliance);
    if (!(piece_compliance[0] > 0)) return;
    limit[0].compliance += piece_compliance[0] - leg->piece_compliance[0];
    limit[2].compliance += piece_compliance[1] - leg->piece_compliance[1];
    for (int d = 0; d < 3; d++) couple[0].compliance[7 * d] += piece_compliance[0] - leg->piece_compliance[0];
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            couple[1].compliance[6 * (3 + r) + 3 + c] +=
                (piece_compliance[1] - leg->piece_compliance[1]) * axis[r] * axis[c];
}

/* Publish the rigid pieces and proxies that the solver may need. */
static void set_bodies(pliant_data *data)
{
    pliant_legs *legs = data->legs;
    const pliant_contact_bodies *pieces = data->rigid_pieces ? pliant_rigid_pieces_bodies(data->rigid_pieces) : NULL;
    legs->bodies = (pliant_contact_bodies){.proxy = legs->proxy, .limit = legs->limit};
    if (pieces) {
        legs->bodies.of_node = pieces->of_node;
        legs->bodies.piece = pieces->piece;
        for (int t = 0; t < data->num_tools; t++) add_piece_compliance(data, legs->tool + t, t);
    }
    data->bodies = &legs->bodies;
}

/* Find the contact points with tools and obstacles, of tissue on tissue, and of pieces on walls. Errors: MEMORY. */
static pliant_status find_points(const pliant_model *model, pliant_data *data, const pliant_body *body,
                                 double max_piece_motion)
{
    pliant_contact_search *search = data->contact_search;
    pliant_contact_near near = {model, data, false};
    const pliant_near_finder finder = {pliant_contact_find_near, &near};
    pliant_status status = pliant_contact_keep_found(model, data);
    pliant_contact_detector_set_finder(search->detector, &finder);
    if (status == PLIANT_OK)
        status = pliant_contact_find(search->detector, body, search->surface, &data->contacts,
                                     data->legs->use_plane_constraints, search->num_parts, search->part,
                                     data->discretization->system->num_threads, &search->point_buffer);
    pliant_contact_detector_set_finder(search->detector, NULL);
    search->found = search->found && !pliant_contact_has_delayed(search->detector);
    if (status == PLIANT_OK && pliant_contact_touches_itself(model))
        status = find_tissue(model, data, max_piece_motion, &search->point_buffer);
    if (status == PLIANT_OK && body != data->body)
        pliant_contact_surface_map_weights(&search->outside, &search->point_buffer);
    if (status == PLIANT_OK && data->rigid_pieces) status = pliant_rigid_pieces_find_walls(data, &search->point_buffer);
    return status;
}

const int32_t *pliant_contact_pieces(const pliant_data *data)
{
    const pliant_contact_bodies *pieces = data->rigid_pieces ? pliant_rigid_pieces_bodies(data->rigid_pieces) : NULL;
    return pieces ? pieces->of_node : NULL;
}

bool pliant_contact_may_have_small_elements(const pliant_model *model, pliant_data *data, bool in_leg)
{
    return !data->backend->may_have_small_elements || data->backend->may_have_small_elements(model, data, in_leg);
}

/* Find the contact points of elements that are small. */
static pliant_status find_small_elements(const pliant_model *model, pliant_data *data)
{
    if (!pliant_contact_may_have_small_elements(model, data, false)) return PLIANT_OK;
    return pliant_volume_find(&model->contact, &data->body->fine, data->positions, pliant_contact_pieces(data),
                              !data->legs->holds_proxies, data->discretization->system->num_threads,
                              &data->contact_search->point_buffer);
}

pliant_status pliant_contact_find_points(const pliant_model *model, pliant_data *data)
{
    pliant_status status = pliant_contact_search_create(&model->contact, &data->contact_search);
    if (status != PLIANT_OK) return status;
    pliant_contact_search *search = data->contact_search;
    search->point_buffer.count = 0;
    if (data->tled) data->tled->zones = NULL;
    const double max_piece_motion = data->rigid_pieces ? pliant_rigid_pieces_predict(data) : 0;
    const pliant_body *body = NULL;
    if (data->rigid_pieces) pliant_contact_mark_pieces(data);
    gather_parts(model, data);
    status = pliant_contact_begin_surface(model, data, &body);
    bool are_reused = false;
    if (status == PLIANT_OK) status = pliant_contact_reuse(model, data, &are_reused);
    if (status == PLIANT_OK && !are_reused) status = find_points(model, data, body, max_piece_motion);
    if (status != PLIANT_OK) return status;
    const int32_t first = are_reused ? search->point_buffer.count : 0;
    status = find_small_elements(model, data);
    if (status != PLIANT_OK) return status;
    carry(data, &data->contacts, first, &search->point_buffer);
    pliant_contacts_swap(&data->contacts, &search->point_buffer);
    set_bodies(data);
    return PLIANT_OK;
}

/* ---- copies */

static void forget(pliant_contact_search *search)
{
    if (!search) return;
    pliant_tissue_discard(&search->tissue);
    search->found = false;
}

void pliant_contact_discard(pliant_data *data)
{
    data->contacts.count = 0;
    for (int t = 0; t < data->num_tools; t++) data->tools[t].proxy.load = (pliant_proxy_load){.jaw = 0};
    forget(data->contact_search);
}

pliant_status pliant_contact_copy(const pliant_data *from, pliant_data *to)
{
    to->contacts.count = 0;
    forget(to->contact_search);
    if (!from->contact_search) return PLIANT_OK;
    pliant_status status = pliant_contact_search_create(&from->contact_search->settings, &to->contact_search);
    if (status == PLIANT_OK) status = pliant_tissue_copy(&from->contact_search->tissue, &to->contact_search->tissue);
    if (status == PLIANT_OK) status = pliant_contact_copy_found(from->contact_search, to->contact_search);
    if (status == PLIANT_OK) status = pliant_contacts_copy(&from->contacts, &to->contacts);
    return status;
}

void pliant_contact_free(pliant_data *data)
{
    pliant_contact_search *search = data->contact_search;
    pliant_free(data->contacts.point);
    if (!search) return;
    pliant_contact_detector_free(search->detector);
    pliant_tissue_free(&search->tissue);
    pliant_impact_zones_free(&search->zones);
    pliant_contact_surface_free(&search->outside);
    pliant_advance_free(search->advance);
    PLIANT_FREE(search->surface, search->surface_node, search->found_at, search->point_buffer.point, search->overlaps,
                search->place, search);
}
