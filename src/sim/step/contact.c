#include "sim/step/contact.h"

#include "backend/backend.h"
#include "base/fail.h"
#include "contact/volume/volume.h"
#include "contact/detect/outside.h"
#include "contact/detect/tissue.h"
#include "contact/shapes/solid.h"
#include "fem/dynamics/tled.h"
#include "fem/patch/patch.h"
#include "fem/quasistatic/solver.h"
#include "fem/rigid/falling.h"
#include "base/memory.h"
#include "sim/step/legs.h"
#include "tool/clearance.h"

#include <math.h>
#include <string.h>

enum { MOST_PARTS = PLIANT_MAX_TOOLS * PLIANT_MAX_PARTS + 2 * PLIANT_MAX_FIXED + PLIANT_MAX_PARTS };

struct pliant_contact_search {
    pliant_contact_settings settings;
    pliant_finder *finder;
    pliant_tissue tissue;      /* contact/self: tissue on tissue */
    pliant_outside outside;
    pliant_contacts made;      /* buffer: the points of the previous leg while this leg's points are in use */
    int32_t num_parts;
    pliant_moving_part part[MOST_PARTS];
    pliant_advance_part advance_part[MOST_PARTS];
    pliant_part obstacle[2 * PLIANT_MAX_FIXED];
    pliant_advance *advance;   /* Nullable buffer */
    int32_t room_surface;
    double *surface;           /* (room_surface x 3) positions of the surface's nodes at the start of the leg [m] */
    double low[3], high[3];    /* bounding box of the surface [m] */
    /* REUSE OF POINTS: the configuration in which the points were found */
    bool found;
    uint64_t found_revision;   /* of the topology */
    int32_t found_parts, found_nodes, room_found;
    uint64_t found_key[MOST_PARTS];
    pliant_tool_pose found_pose[PLIANT_MAX_TOOLS];
    double *found_at;          /* (room_found x 3) positions of the surface's nodes [m] */
    int32_t room_nodes;        /* for contact/response: paper */
    uint8_t *overlaps;         /* (room_nodes) */
    double *place;             /* (room_nodes x 3) */
};

/* ---- inputs of tools */

static pliant_status find_tool(pliant_data *data, int index, pliant_tool **out)
{
    if (index < 0 || index >= data->num_tools)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "there is no tool %d: %d were added", index, data->num_tools);
    *out = data->tools + index;
    return PLIANT_OK;
}

pliant_status pliant_tool_set_shape(pliant_data *data, int index, const pliant_tool_shape *shape)
{
    pliant_tool *tool = NULL;
    char reason[160];
    bool turns = false;
    pliant_status status = find_tool(data, index, &tool);
    if (status != PLIANT_OK) return status;
    if (shape->num_parts < 0 || shape->num_parts > PLIANT_MAX_PARTS)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "tool %s: its shape has %d parts; up to %d are possible", tool->name,
                           shape->num_parts, PLIANT_MAX_PARTS);
    for (int32_t p = 0; p < shape->num_parts; p++) {
        turns = turns || shape->part[p].frame != PLIANT_FRAME_TIP;
        if (pliant_part_check(shape->part + p, true, reason, sizeof reason))
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "tool %s: part %d of its shape: %s", tool->name, p + 1, reason);
    }
    double axis = 0;
    for (int d = 0; d < 3; d++) axis += shape->axis[d] * shape->axis[d] + 0 * shape->joint[d];
    if (turns && !(axis > 0 && isfinite(axis)))
        return pliant_fail(PLIANT_ERROR_ARGUMENT,
                           "tool %s: the joint of its jaws needs a point and an axis that is not 0", tool->name);
    pliant_tool_shape_retain(shape);
    pliant_tool_shape_free(&tool->shape);
    tool->shape = *shape;
    return PLIANT_OK;
}

pliant_status pliant_tool_set_jaw(pliant_data *data, int index, double angle)
{
    pliant_tool *tool = NULL;
    pliant_status status = find_tool(data, index, &tool);
    if (status != PLIANT_OK) return status;
    if (!isfinite(angle))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "tool %s: the angle of its jaw is not finite", tool->name);
    tool->jaw = angle;
    return PLIANT_OK;
}

/* ---- moving parts of this leg */

static double seconds_of(const pliant_model *model, const pliant_data *data)
{
    return model->scene.solver.step * data->share;
}

static double recovered(const pliant_model *model, const pliant_data *data)
{
    return model->contact.recovery_speed * seconds_of(model, data);
}

static double stays(const pliant_model *model, const pliant_data *data)
{
    return data->body->has_inertia ? exp(-seconds_of(model, data) / model->contact.recovery_time) : 0;
}

/* The core of a distance field is enlarged by the field's error (contact/advance). */
static double off_of(const pliant_part *part)
{
    return part->kind == PLIANT_PART_SOLID && !part->solid->convex ? part->solid->error : 0;
}

/* Return the guard depth of a part. A distance field's error reduces the guard zone, so the guard depth is increased
 * until a fraction of the zone remains (settings.guard_left). */
static double guard_of(const pliant_model *model, const pliant_data *data, const pliant_part *part)
{
    const double *cell = data->body->fine.cell_size,
                 guard = pliant_advance_guard(&model->contact, part, fmin(fmin(cell[0], cell[1]), cell[2]));
    return fmax(guard, off_of(part) + (1 - model->contact.advance_stop) * guard);
}

static void add_part(const pliant_model *model, const pliant_data *data, int t, int32_t p)
{
    pliant_contact_search *search = data->contact_search;
    const pliant_tool *tool = data->tools + t;
    const pliant_part *part = tool->shape.part + p;
    const pliant_tool_pose *begin = &data->legs->tool[t].begin, *goal = &data->legs->tool[t].ahead;
    const int32_t num_held = pliant_tool_grips(tool) ? tool->num_held : 0;
    const double way = pliant_part_way(&tool->shape, part, begin, goal);
    pliant_moving_part *moving = search->part + search->num_parts;
    *moving = (pliant_moving_part){
        .part = part,
        .kind = PLIANT_OBSTACLE_TOOL,
        .tool = t,
        .index = p,
        .friction = model->scene.contact.friction,
        .guard = guard_of(model, data, part),
        .off = off_of(part),
        .margin = model->contact.search_margin + way,
        .shape = &tool->shape,
        .from = *begin,
        .to = *goal,
        .way = way,
        .recovery = recovered(model, data),
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
    const double guard = guard_of(model, data, part);
    search->advance_part[search->num_parts] = (pliant_advance_part){.part = part, .guard = guard, .released = true};
    search->part[search->num_parts++] = (pliant_moving_part){.part = part,
                                                             .kind = PLIANT_OBSTACLE_GROUND,
                                                             .tool = -1,
                                                             .index = index,
                                                             .friction = model->scene.contact.friction,
                                                             .begin = still,
                                                             .end = still,
                                                             .guard = guard,
                                                             .off = off_of(part),
                                                             .margin = model->contact.search_margin,
                                                             .recovery = recovered(model, data),
                                                             .stays = stays(model, data)};
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

static bool touches_itself(const pliant_model *model)
{
    return model->scene.contact.self || model->scene.material.slides[0];
}

bool pliant_contact_is_idle(const pliant_model *model, const pliant_data *data)
{
    if (touches_itself(model)) return false;
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
        if (there) pliant_contact_carry(before->point + b, data->positions, now->point + n);
    }
}

static pliant_status begin(const pliant_contact_settings *settings, pliant_contact_search **out)
{
    if (*out) return PLIANT_OK;
    pliant_contact_search *search = pliant_calloc(1, sizeof *search);
    if (!search) return pliant_fail_memory("contacts");
    search->settings = *settings;
    pliant_status status = pliant_finder_create(settings, &search->finder);
    if (status == PLIANT_OK) *out = search;
    else pliant_free(search);
    return status;
}

/* Contact happens at the boundary of the tissue within the elements. When cuts subdivide elements, the elements'
 * faces are that boundary. */
static bool touches_within_elements(const pliant_model *model) { return model->scene.cut.kind != PLIANT_CUT_SUBDIVIDE; }

/* contact/response: paper. Without delay, every node of the surface's tetrahedra gets a point, and each sub-step
 * determines which of them are slowed. */
static pliant_status find_slowed(const pliant_model *model, pliant_data *data, pliant_contacts *out)
{
    pliant_contact_search *search = data->contact_search;
    const pliant_tissue *tissue = &search->tissue;
    const pliant_mesh *mesh = &data->body->fine;
    if (mesh->num_nodes > search->room_nodes) {
        uint8_t *overlaps = pliant_resize(search->overlaps, (size_t)mesh->num_nodes, 1);
        if (overlaps) search->overlaps = overlaps;
        double *place = pliant_resize(search->place, (size_t)mesh->num_nodes, 3 * sizeof *place);
        if (place) search->place = place;
        if (!overlaps || !place) return pliant_fail_memory("contacts of tissue with tissue");
        search->room_nodes = mesh->num_nodes;
    }
    pliant_status status = pliant_tissue_overlapping(&search->tissue, data->positions, search->overlaps);
    for (int32_t t = 0; !model->scene.contact.delay && t < tissue->num_tets; t++)
        for (int v = 0; v < 4; v++) search->overlaps[mesh->tets[4 * (size_t)tissue->tet[t] + (size_t)v]] = 1;
    if (status == PLIANT_OK)
        status = pliant_tissue_find_slowed(tissue, search->overlaps, model->scene.contact.punishment, out);
    if (status == PLIANT_OK && !model->scene.contact.delay)
        data->tled->slowing =
            (pliant_tled_slowing){.tissue = &search->tissue, .overlaps = search->overlaps, .place = search->place};
    return status;
}

/* pieces_go: largest motion of detached pieces in this step [m] */
static pliant_status find_tissue(const pliant_model *model, pliant_data *data, double pieces_go, pliant_contacts *out)
{
    pliant_tissue *tissue = &data->contact_search->tissue;
    const pliant_outside *outside = touches_within_elements(model) ? &data->contact_search->outside : NULL;
    pliant_status status = pliant_tissue_set_body(tissue, data->body, outside ? outside->solid : NULL,
                                                  data->discretization->system->num_threads);
    const pliant_tissue_rule rule = {.margin = model->contact.self_margin * tissue->shortest,
                                     .recovery = recovered(model, data),
                                     .friction = model->scene.contact.friction,
                                     .pieces_go = pieces_go,
                                     .nodes = data->positions,
                                     .stays = stays(model, data),
                                     .settings = &model->contact};
    if (status != PLIANT_OK || tissue->num_skins == 0) return status;
    pliant_tissue_set_searcher(tissue, data->backend->searcher);
    if (model->scene.contact.response == PLIANT_RESPONSE_PAPER) return find_slowed(model, data, out);
    return pliant_tissue_find(tissue, outside ? outside->positions : data->positions, &rule, out);
}

/* Choose the surface for collision detection. Errors: MEMORY.
 * @param body, positions out: its topology and its positions */
static pliant_status choose_surface(const pliant_model *model, pliant_data *data, const pliant_body **body,
                                    const double **positions)
{
    pliant_outside *outside = &data->contact_search->outside;
    *body = data->body;
    *positions = data->positions;
    if (!touches_within_elements(model)) return PLIANT_OK;
    const pliant_outside_voxels voxels = {.load = model->body,
                                          .geometry = &model->scan->geometry,
                                          .material_of_voxel = model->material_of_voxel,
                                          .materials = &model->materials,
                                          .touches_itself = touches_itself(model),
                                          .threads = data->discretization->system->num_threads};
    pliant_status status = pliant_outside_set_body(outside, &voxels, data->body);
    if (status != PLIANT_OK) return status;
    pliant_outside_place(outside, data->positions);
    *body = &outside->view;
    *positions = outside->positions;
    return PLIANT_OK;
}

/* Save the surface at the start of the leg, and compute its bounding box. Errors: MEMORY. */
static pliant_status keep_surface(pliant_contact_search *search, const pliant_body *body, const double *positions)
{
    const int32_t nodes = body->fine.num_nodes;
    if (nodes > search->room_surface) {
        double *surface = pliant_resize(search->surface, (size_t)nodes, 3 * sizeof *surface);
        if (!surface) return pliant_fail_memory("contacts");
        search->surface = surface;
        search->room_surface = nodes;
    }
    memcpy(search->surface, positions, 3 * (size_t)nodes * sizeof *positions);
    for (int d = 0; d < 3; d++) {
        search->low[d] = INFINITY;
        search->high[d] = -INFINITY;
    }
    for (int32_t c = 0; c < 3 * body->num_triangles; c++)
        for (int d = 0; d < 3; d++) {
            const double x = positions[3 * (size_t)body->triangles[c] + (size_t)d];
            search->low[d] = fmin(search->low[d], x);
            search->high[d] = fmax(search->high[d], x);
        }
    return PLIANT_OK;
}

/* Return whether the gap of a point is closed. */
static bool overlaps(const pliant_data *data, const pliant_contact_point *point)
{
    double gap = 0;
    for (int d = 0; d < 3; d++) {
        double x = 0;
        for (int32_t k = 0; k < point->count; k++)
            x += point->weight[k] * data->positions[3 * (size_t)point->node[k] + (size_t)d];
        gap += point->normal[d] * (x - point->place[d]);
    }
    return gap <= 0;
}

void pliant_contact_gives(const pliant_data *data, int t, bool pressing, const double joint[3], const double axis[3],
                          double out[2])
{
    const pliant_touch_pieces *pieces = data->falling ? pliant_falling_touch_pieces(data->falling) : NULL;
    double sum = 0, levers = 0;
    int32_t count = 0;
    out[0] = out[1] = 0;
    for (int32_t n = 0; pieces && n < data->contacts.count; n++) {
        const pliant_contact_point *point = data->contacts.point + n;
        if (point->kind != PLIANT_OBSTACLE_TOOL || point->tool != t || pieces->of_node[point->node[0]] < 0 ||
            !(pressing ? point->begun : overlaps(data, point)))
            continue;
        double along = 0, square = 0;
        for (int d = 0; d < 3; d++) {
            square += (point->place[d] - joint[d]) * (point->place[d] - joint[d]);
            along += (point->place[d] - joint[d]) * axis[d];
        }
        const pliant_touch_piece *piece = pieces->piece + pieces->of_node[point->node[0]];
        if (!(piece->young * piece->size > 0)) continue;
        count++;
        sum += 1 / (piece->young * piece->size);
        if (point->jaw) levers += 0.25 * (square - along * along);
    }
    if (count == 0) return;
    out[0] = sum / count;
    if (levers > 0) out[1] = sum / levers;
}

/* Replace the compliance from the previous leg's points by that from this leg's points, if there are any. */
static void soften_by_pieces(pliant_data *data, const pliant_leg_tool *leg, int t)
{
    pliant_touch_piece *couple = data->legs->proxy + 2 * t;
    double gives[2];
    pliant_contact_gives(data, t, false, couple[1].centre, leg->axis, gives);
    if (!(gives[0] > 0)) return;
    for (int d = 0; d < 3; d++) couple[0].answer[7 * d] += gives[0] - leg->gives[0];
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            couple[1].answer[6 * (3 + r) + 3 + c] += (gives[1] - leg->gives[1]) * leg->axis[r] * leg->axis[c];
}

/* ---- reuse of points */

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
    return data->solver && !data->legs->planes && !data->falling && !touches_itself(model) &&
           pliant_patch_serves(data) == 0;
}

static bool reserve_found(pliant_contact_search *search, int32_t nodes)
{
    if (nodes > search->room_found) {
        double *at = pliant_resize(search->found_at, (size_t)nodes, 3 * sizeof *at);
        if (!at) return false;
        search->found_at = at;
        search->room_found = nodes;
    }
    search->found_nodes = nodes;
    return true;
}

static pliant_status copy_found(const pliant_contact_search *from, pliant_contact_search *to)
{
    if (!from->found) return PLIANT_OK;
    if (!reserve_found(to, from->found_nodes)) return pliant_fail_memory("contacts");
    memcpy(to->found_at, from->found_at, 3 * (size_t)from->found_nodes * sizeof *to->found_at);
    memcpy(to->found_key, from->found_key, sizeof to->found_key);
    memcpy(to->found_pose, from->found_pose, sizeof to->found_pose);
    to->found_revision = from->found_revision;
    to->found_parts = from->found_parts;
    to->found = true;
    return PLIANT_OK;
}

/* Save the configuration in which the points are found. Errors: MEMORY. */
static pliant_status keep_found(const pliant_model *model, pliant_data *data, const pliant_body *body)
{
    pliant_contact_search *search = data->contact_search;
    const int32_t nodes = body->fine.num_nodes;
    search->found = is_simple(model, data);
    if (!search->found) return PLIANT_OK;
    search->found = false;
    if (!reserve_found(search, nodes)) return pliant_fail_memory("contacts");
    search->found = true;
    memcpy(search->found_at, search->surface, 3 * (size_t)nodes * sizeof *search->surface);
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
    const double exact = 1e-3; /* of the guard depth */
    for (int32_t p = 0; p < search->num_parts; p++) {
        const pliant_moving_part *part = search->part + p;
        double local[3], normal[3], end[3], outwards[3];
        if (part->kind != point->kind || part->index != point->part ||
            (part->kind == PLIANT_OBSTACLE_TOOL && part->tool != point->tool))
            continue;
        pliant_pose_from(&part->begin, point->place, local);
        const pliant_part core = pliant_part_core(part->part, part->guard);
        if (fabs(pliant_part_distance(&core, local, outwards) - part->guard) > exact * part->guard) return false;
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

/* Reuse the points of the previous search if nothing has moved farther than settings.reuse_motion since then, and no
 * tool is to. They are written to search->made. Errors: MEMORY.
 * @param stays out: whether the points are reused */
static pliant_status stay(const pliant_model *model, pliant_data *data, const pliant_body *body, bool *stays)
{
    pliant_contact_search *search = data->contact_search;
    double most = model->contact.search_margin;
    *stays = search->found && is_simple(model, data) && search->found_revision == data->body->revision &&
             search->found_parts == search->num_parts;
    for (int32_t p = 0; p < search->num_parts && *stays; p++) {
        const pliant_moving_part *part = search->part + p;
        *stays = search->found_key[p] == key_of(part);
        most = fmin(most, model->contact.reuse_motion * part->guard);
    }
    for (int32_t p = 0; p < search->num_parts && *stays; p++) {
        const pliant_moving_part *part = search->part + p;
        if (part->kind == PLIANT_OBSTACLE_TOOL)
            *stays = pliant_part_way(part->shape, part->part, search->found_pose + part->tool, &part->to) <= most;
    }
    for (int32_t n = 0; n < body->fine.num_nodes && *stays; n++) {
        const double *a = search->found_at + 3 * (size_t)n, *b = search->surface + 3 * (size_t)n;
        *stays = (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2]) <=
                 most * most;
    }
    pliant_status status = *stays ? pliant_contacts_copy(&data->contacts, &search->made) : PLIANT_OK;
    while (*stays && search->made.count > 0 &&
           search->made.point[search->made.count - 1].kind == PLIANT_OBSTACLE_ELEMENT)
        search->made.count--; /* points of the volume bound are found again in every leg */
    for (int32_t n = 0; n < search->made.count && *stays && status == PLIANT_OK; n++)
        *stays = move_point(search, search->made.point + n);
    if (!*stays) search->made.count = 0;
    return status;
}

/* Publish the rigid pieces and proxies that the solver may need. */
static void set_bodies(pliant_data *data)
{
    pliant_legs *legs = data->legs;
    const pliant_touch_pieces *pieces = data->falling ? pliant_falling_touch_pieces(data->falling) : NULL;
    legs->bodies = (pliant_touch_pieces){.proxy = legs->proxy};
    if (pieces) {
        legs->bodies.of_node = pieces->of_node;
        legs->bodies.piece = pieces->piece;
        for (int t = 0; t < data->num_tools; t++) soften_by_pieces(data, legs->tool + t, t);
    }
    data->bodies = &legs->bodies;
}

/* Find the contact points with tools and obstacles, of tissue on tissue, and of pieces on walls. Errors: MEMORY. */
static pliant_status find_points(const pliant_model *model, pliant_data *data, const pliant_body *body,
                                 const double *positions, double pieces_go)
{
    pliant_contact_search *search = data->contact_search;
    pliant_status status = keep_found(model, data, body);
    if (status == PLIANT_OK)
        status = pliant_contact_find(search->finder, body, positions, &data->contacts, data->legs->planes,
                                     search->num_parts, search->part, &search->made);
    if (status == PLIANT_OK && touches_itself(model)) status = find_tissue(model, data, pieces_go, &search->made);
    if (status == PLIANT_OK && body != data->body) pliant_outside_spread(&search->outside, &search->made);
    if (status == PLIANT_OK && data->falling) status = pliant_falling_find_walls(data, &search->made);
    return status;
}

const int32_t *pliant_contact_pieces(const pliant_data *data)
{
    return data->falling ? pliant_falling_touch_pieces(data->falling)->of_node : NULL;
}

bool pliant_contact_keeps_volumes(const pliant_data *data)
{
    const bool is_linear = data->model->scene.element.kind != PLIANT_HEXAHEDRA;
    return data->solver && is_linear && pliant_solves_fine(data->solver->system) && pliant_patch_serves(data) == 0;
}

pliant_status pliant_contact_stage(const pliant_model *model, pliant_data *data)
{
    pliant_status status = begin(&model->contact, &data->contact_search);
    if (status != PLIANT_OK) return status;
    pliant_contact_search *search = data->contact_search;
    search->made.count = 0;
    const double pieces_go = data->falling ? pliant_falling_foresee(data) : 0;
    const pliant_body *body = NULL;
    const double *positions = NULL;
    if (data->falling) pliant_contact_mark_pieces(data);
    gather_parts(model, data);
    status = choose_surface(model, data, &body, &positions);
    if (status == PLIANT_OK) status = keep_surface(search, body, positions);
    bool stays = false;
    if (status == PLIANT_OK) status = stay(model, data, body, &stays);
    if (status == PLIANT_OK && !stays) status = find_points(model, data, body, positions, pieces_go);
    if (status != PLIANT_OK) return status;
    const int32_t first = stays ? search->made.count : 0;
    if (pliant_contact_keeps_volumes(data))
        status = pliant_volume_find(&model->contact, &data->body->fine, data->positions, pliant_contact_pieces(data),
                                    &search->made);
    if (status != PLIANT_OK) return status;
    carry(data, &data->contacts, first, &search->made);
    pliant_contacts_exchange(&data->contacts, &search->made);
    set_bodies(data);
    return PLIANT_OK;
}

/* ---- largest free fraction of a leg */

static pliant_status find_room(pliant_contact_search *search)
{
    return search->advance ? PLIANT_OK : pliant_advance_create(&search->settings, &search->advance);
}

pliant_status pliant_contact_advance(const pliant_model *model, pliant_data *data, double share,
                                     pliant_advance_result *out)
{
    pliant_contact_search *search = data->contact_search;
    const pliant_body *body = NULL;
    const double *positions = NULL;
    pliant_status status = find_room(search);
    for (int32_t p = 0; p < search->num_parts; p++) {
        const pliant_leg_tool *leg =
            search->part[p].kind == PLIANT_OBSTACLE_TOOL ? data->legs->tool + search->part[p].tool : NULL;
        if (leg)
            search->advance_part[p].to = share < 1 ? pliant_pose_partway(&leg->begin, &leg->goal, share) : leg->goal;
    }
    if (status == PLIANT_OK) status = choose_surface(model, data, &body, &positions);
    if (status != PLIANT_OK) return status;
    return pliant_advance_find(search->advance, body->num_triangles, body->triangles, search->surface, positions,
                               search->num_parts, search->advance_part, data->discretization->system->num_threads, out);
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
    pliant_status status = begin(&model->contact, &data->contact_search);
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
                                              .guard = guard_of(model, data, tool->shape.part + p),
                                              .num_held = pliant_tool_grips(tool) ? tool->num_held : 0,
                                              .held = tool->held};
    pliant_advance_audit_result found;
    status = find_room(search);
    if (status == PLIANT_OK) status = choose_surface(model, data, &body, &positions);
    if (status == PLIANT_OK)
        status = pliant_advance_audit(search->advance, body->num_triangles, body->triangles, positions, count, part,
                                      data->discretization->system->num_threads, &found);
    if (status != PLIANT_OK) return status;
    *is_free = found.least > 0;
    *is_inside = is_inside_at(model, data, tool, pose);
    return PLIANT_OK;
}

bool pliant_contact_comes_near(pliant_data *data, const pliant_tool *tool, const pliant_tool_pose *from,
                               const pliant_tool_pose *to)
{
    const pliant_contact_search *search = data->contact_search;
    bool near = false;
    for (int32_t p = 0; search && p < tool->shape.num_parts && !near; p++) {
        const pliant_part *part = tool->shape.part + p;
        const double way = pliant_part_way(&tool->shape, part, from, to) + data->model->contact.search_margin;
        double low[3], high[3];
        pliant_pose pose;
        pliant_part_pose(&tool->shape, part->frame, from->tip, from->rotation, from->jaw, &pose);
        pliant_part_box(part, &pose, low, high);
        near = true;
        for (int d = 0; d < 3; d++) near = near && low[d] - way <= search->high[d] && high[d] + way >= search->low[d];
    }
    return near;
}

static void forget(pliant_contact_search *search)
{
    if (!search) return;
    pliant_tissue_forget(&search->tissue);
    search->found = false;
}

void pliant_contact_forget(pliant_data *data)
{
    data->contacts.count = 0;
    forget(data->contact_search);
}

pliant_status pliant_contact_copy(const pliant_data *from, pliant_data *to)
{
    to->contacts.count = 0;
    forget(to->contact_search);
    if (!from->contact_search) return PLIANT_OK;
    pliant_status status = begin(&from->contact_search->settings, &to->contact_search);
    if (status == PLIANT_OK) status = pliant_tissue_copy(&from->contact_search->tissue, &to->contact_search->tissue);
    if (status == PLIANT_OK) status = copy_found(from->contact_search, to->contact_search);
    if (status == PLIANT_OK) status = pliant_contacts_copy(&from->contacts, &to->contacts);
    return status;
}

void pliant_contact_free(pliant_data *data)
{
    pliant_contact_search *search = data->contact_search;
    pliant_free(data->contacts.point);
    if (!search) return;
    pliant_finder_free(search->finder);
    pliant_tissue_free(&search->tissue);
    pliant_outside_free(&search->outside);
    pliant_advance_free(search->advance);
    pliant_free(search->surface);
    pliant_free(search->found_at);
    pliant_free(search->made.point);
    pliant_free(search->overlaps);
    pliant_free(search->place);
    pliant_free(search);
}
