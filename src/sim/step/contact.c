#include "sim/step/contact.h"

#include "backend/backend.h"
#include "base/fail.h"
#include "base/rotate.h"
#include "contact/detect/find.h"
#include "contact/detect/finder.h"
#include "contact/detect/outside.h"
#include "contact/detect/tissue.h"
#include "fem/dynamics/tled.h"
#include "fem/rigid/falling.h"
#include "fem/patch/patch.h"
#include "fem/system.h"
#include "pliant/memory.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double self_margin = 0.25; /* of the surface's shortest edge at rest: tissue that is nearer to tissue is looked at */
static const double recovery = 0.1;   /* [m/s] at which tissue comes out of what it was deep in */
static const double emerging = 0.15;  /* [s] in which its depth is down to 1 / e, where tissue swings: what is pushed out faster is given energy */
enum { MOST_POSES = 4096, MOST_PARTS = PLIANT_MAX_TOOLS * PLIANT_MAX_PARTS + 2 * PLIANT_MAX_FIXED + PLIANT_MAX_PARTS };

struct pliant_contact_search {
    pliant_finder *finder;
    pliant_tissue tissue;      /* contact/self */
    pliant_outside outside;
    pliant_contacts made;      /* room: those of the step before, once this one has its own */
    int32_t num_poses, room_poses;
    pliant_pose *pose;
    int32_t num_parts;
    pliant_moving_part part[MOST_PARTS];
    int32_t first[MOST_PARTS]; /* of its poses */
    pliant_part obstacle[2 * PLIANT_MAX_FIXED];
    double passed;             /* of what was last seen to pass tools, how deep the deepest is, over their depth */
    int32_t room_nodes;        /* contact/response: paper */
    uint8_t *overlaps;         /* (room_nodes) */
    double *place;             /* (room_nodes x 3) */
};

/* ---- what a tool is told */

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
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "tool %s: its shape has %d parts; up to %d are possible", tool->name, shape->num_parts, PLIANT_MAX_PARTS);
    for (int32_t p = 0; p < shape->num_parts; p++) {
        turns = turns || shape->part[p].frame != PLIANT_FRAME_TIP;
        if (pliant_part_check(shape->part + p, true, reason, sizeof reason))
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "tool %s: part %d of its shape: %s", tool->name, p + 1, reason);
    }
    double axis = 0;
    for (int d = 0; d < 3; d++) axis += shape->axis[d] * shape->axis[d] + 0 * shape->joint[d];
    if (turns && !(axis > 0 && isfinite(axis)))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "tool %s: the joint of its jaws needs a point and an axis that is not 0", tool->name);
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
    if (!isfinite(angle)) return pliant_fail(PLIANT_ERROR_ARGUMENT, "tool %s: the angle of its jaw is not finite", tool->name);
    tool->jaw = angle;
    return PLIANT_OK;
}

/* ---- parts as they move in this step */

static pliant_status reserve_poses(pliant_contact_search *search, int32_t more)
{
    const int32_t room = search->num_poses + more;
    if (room <= search->room_poses) return PLIANT_OK;
    pliant_pose *pose = pliant_resize(search->pose, 2 * (size_t)room, sizeof *pose);
    if (!pose) return pliant_fail_memory("contacts");
    search->pose = pose;
    search->room_poses = 2 * room;
    return PLIANT_OK;
}

/* in this step, or in this part of it [m] */
static double recovered(const pliant_model *model, const pliant_data *data) { return recovery * model->scene.solver.step / data->parts; }

static double stays(const pliant_model *model, const pliant_data *data) { return data->body->has_inertia ? exp(-model->scene.solver.step / data->parts / emerging) : 0; }

/* No further from one pose to the next than half of how deep the part is: what it has passed through it has been seen in.
 * tissue_way: how far the tissue goes at the same time */
static pliant_status add_part(const pliant_model *model, const pliant_data *data, int t, int32_t p, double tissue_way)
{
    pliant_contact_search *search = data->contact_search;
    const pliant_tool *tool = data->tools + t;
    const pliant_part *part = tool->shape.part + p;
    const bool goes_on = pliant_contact_goes_on(model, tool);
    double way = tissue_way;
    if (goes_on) way += pliant_contact_way_of(tool, part);
    const double steps = ceil(way / (0.5 * pliant_part_depth(part)));
    const int32_t poses = way > 0 ? 1 + (int32_t)fmin(fmax(steps, 1), MOST_POSES) : 1;
    pliant_status status = reserve_poses(search, poses);
    if (status != PLIANT_OK) return status;
    pliant_pose *pose = search->pose + search->num_poses;
    for (int32_t n = 0; n < poses; n++) {
        const double share = poses > 1 ? (double)n / (poses - 1) : 1;
        double tip[3], rotation[4], jaw;
        pliant_contact_pose(tool, goes_on ? share : 1, tip, rotation, &jaw);
        pliant_part_pose(&tool->shape, part->frame, tip, rotation, jaw, pose + n);
    }
    search->first[search->num_parts] = search->num_poses;
    search->part[search->num_parts++] = (pliant_moving_part){
        .part = part, .kind = PLIANT_OBSTACLE_TOOL, .tool = t, .index = p, .friction = model->scene.contact.friction, .num_poses = poses,
        .stride = poses > 1 ? way / (poses - 1) : 0, .margin = PLIANT_CONTACT_MARGIN + way, .recovery = recovered(model, data), .briefly = data->tled && pliant_tled_in_parts(data->tled),
        .remembers = goes_on || tissue_way > 0,
        .num_held = pliant_tool_grips(tool) ? tool->num_held : 0, .held = tool->held,
    };
    search->num_poses += poses;
    return PLIANT_OK;
}

/* What stands still. */
static pliant_status add_obstacle(const pliant_model *model, const pliant_data *data, const pliant_part *part, int32_t index, double tissue_way)
{
    pliant_contact_search *search = data->contact_search;
    const int32_t poses = tissue_way > 0 ? 1 + (int32_t)fmin(fmax(ceil(tissue_way / (0.5 * pliant_part_depth(part))), 1), MOST_POSES) : 1;
    pliant_status status = reserve_poses(search, poses);
    if (status != PLIANT_OK) return status;
    search->first[search->num_parts] = search->num_poses;
    for (int32_t n = 0; n < poses; n++) search->pose[search->num_poses++] = (pliant_pose){.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    search->part[search->num_parts++] = (pliant_moving_part){
        .part = part, .kind = PLIANT_OBSTACLE_GROUND, .tool = -1, .index = index, .friction = model->scene.contact.friction, .num_poses = poses,
        .stride = poses > 1 ? tissue_way / (poses - 1) : 0, .margin = PLIANT_CONTACT_MARGIN + tissue_way, .recovery = recovered(model, data), .stays = stays(model, data),
        .briefly = data->tled && pliant_tled_in_parts(data->tled), .remembers = true,
    };
    return PLIANT_OK;
}

static pliant_status add_obstacles(const pliant_model *model, const pliant_data *data, double tissue_way)
{
    pliant_contact_search *search = data->contact_search;
    const int32_t count = pliant_contact_obstacles(model, search->obstacle);
    pliant_status status = PLIANT_OK;
    for (int32_t n = 0; n < count + model->obstacles.num_parts && status == PLIANT_OK; n++)
        status = add_obstacle(model, data, n < count ? search->obstacle + n : model->obstacles.part + (n - count), n, tissue_way);
    return status;
}

/* tissue_way: how far the tissue has gone in the step, which is over [m]; 0: it begins */
static pliant_status gather_parts(const pliant_model *model, pliant_data *data, double tissue_way)
{
    pliant_contact_search *search = data->contact_search;
    pliant_status status = PLIANT_OK;
    search->num_parts = search->num_poses = 0;
    for (int t = 0; t < data->num_tools; t++) {
        const pliant_tool *tool = data->tools + t;
        for (int32_t p = 0; tool->present && p < tool->shape.num_parts && status == PLIANT_OK; p++)
            if (!(tool->shape.part[p].cuts && tool->blade.cutting)) status = add_part(model, data, t, p, tissue_way);
    }
    if (status == PLIANT_OK) status = add_obstacles(model, data, tissue_way);
    for (int32_t p = 0; p < search->num_parts; p++) search->part[p].pose = search->pose + search->first[p];
    return status;
}

/* ---- the stage */

static bool touches_itself(const pliant_model *model) { return model->scene.contact.self || model->scene.material.slides[0]; }

static bool has_nothing_to_touch(const pliant_model *model, const pliant_data *data)
{
    if (touches_itself(model)) return false;
    if (model->scene.obstacles.num_boxes + model->scene.obstacles.num_planes > 0 || model->obstacles.num_parts > 0) return false;
    for (int t = 0; t < data->num_tools; t++)
        if (data->tools[t].present && data->tools[t].shape.num_parts > 0) return false;
    return true;
}

/* What touches goes on where it was in touch before; both are ascending. */
static void carry(const pliant_data *data, const pliant_contacts *before, pliant_contacts *now)
{
    int32_t b = 0;
    for (int32_t n = 0; n < now->count; n++) {
        while (b < before->count && before->point[b].feature < now->point[n].feature) b++;
        if (b == before->count || before->point[b].feature != now->point[n].feature) continue;
        bool there = true; /* not of a body that an undone cut has taken back */
        for (int32_t k = 0; k < before->point[b].count; k++) there = there && before->point[b].node[k] < data->body->fine.num_nodes;
        if (there) pliant_contact_carry(before->point + b, data->positions, now->point + n);
    }
}

static pliant_status begin(pliant_contact_search **out)
{
    if (*out) return PLIANT_OK;
    pliant_contact_search *search = pliant_calloc(1, sizeof *search);
    if (!search) return pliant_fail_memory("contacts");
    pliant_status status = pliant_finder_create(&search->finder);
    if (status == PLIANT_OK) *out = search;
    else pliant_free(search);
    return status;
}

/* Elements touch where their tissue ends. Those that cuts subdivide touch with their own faces, since a cut's faces are where it went. */
static bool touches_within_elements(const pliant_model *model) { return model->scene.cut.kind != PLIANT_CUT_SUBDIVIDE; }

/* contact/response: paper. Without a delay every node of the surface's tetrahedra has a point, and the sub-steps know which of them are slowed. */
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
    if (status == PLIANT_OK) status = pliant_tissue_find_slowed(tissue, search->overlaps, model->scene.contact.punishment, out);
    if (status == PLIANT_OK && !model->scene.contact.delay)
        data->tled->slowing = (pliant_tled_slowing){.tissue = &search->tissue, .overlaps = search->overlaps, .place = search->place};
    return status;
}

/* pieces_go: how far in this step, of those that have come off [m] */
static pliant_status find_tissue(const pliant_model *model, pliant_data *data, double pieces_go, pliant_contacts *out)
{
    pliant_tissue *tissue = &data->contact_search->tissue;
    const pliant_outside *outside = touches_within_elements(model) ? &data->contact_search->outside : NULL;
    pliant_status status = pliant_tissue_set_body(tissue, data->body, outside ? outside->solid : NULL, data->discretization->system->num_threads);
    const pliant_tissue_rule rule = {.margin = self_margin * tissue->shortest, .recovery = recovered(model, data),
                                     .friction = model->scene.contact.friction, .pieces_go = pieces_go, .nodes = data->positions,
                                     .stays = stays(model, data)};
    if (status != PLIANT_OK || tissue->num_skins == 0) return status;
    pliant_tissue_set_searcher(tissue, data->backend->searcher);
    if (model->scene.contact.response == PLIANT_RESPONSE_PAPER) return find_slowed(model, data, out);
    return pliant_tissue_find(tissue, outside ? outside->positions : data->positions, &rule, out);
}

/* *body, *positions: of the surface that is searched. Errors: MEMORY. */
static pliant_status choose_surface(const pliant_model *model, pliant_data *data, const pliant_body **body, const double **positions)
{
    pliant_outside *outside = &data->contact_search->outside;
    *body = data->body;
    *positions = data->positions;
    if (!touches_within_elements(model)) return PLIANT_OK;
    const pliant_outside_voxels voxels = {.load = model->body, .geometry = &model->scan->geometry, .material_of_voxel = model->material_of_voxel, .materials = &model->materials,
                                          .touches_itself = touches_itself(model), .threads = data->discretization->system->num_threads};
    pliant_status status = pliant_outside_set_body(outside, &voxels, data->body);
    if (status != PLIANT_OK) return status;
    pliant_outside_place(outside, data->positions);
    *body = &outside->view;
    *positions = outside->positions;
    return PLIANT_OK;
}

pliant_status pliant_contact_stage(const pliant_model *model, pliant_data *data)
{
    if (has_nothing_to_touch(model, data)) {
        pliant_contact_forget(data);
        return PLIANT_OK;
    }
    pliant_status status = begin(&data->contact_search);
    if (status != PLIANT_OK) return status;
    pliant_contact_search *search = data->contact_search;
    search->made.count = 0;
    const double pieces_go = data->falling ? pliant_falling_foresee(data) : 0;
    const pliant_body *body = NULL;
    const double *positions = NULL;
    if (data->falling) pliant_contact_mark_pieces(model, data);
    status = gather_parts(model, data, 0);
    if (status == PLIANT_OK) status = choose_surface(model, data, &body, &positions);
    pliant_finder_tell(search->finder, &data->contacts);
    if (status == PLIANT_OK) status = pliant_contact_find(search->finder, body, positions, search->num_parts, search->part, &search->made);
    if (status == PLIANT_OK && touches_itself(model)) status = find_tissue(model, data, pieces_go, &search->made);
    if (status == PLIANT_OK && body != data->body) pliant_outside_spread(&search->outside, &search->made);
    if (status == PLIANT_OK && data->falling) status = pliant_falling_find_walls(data, &search->made);
    if (status != PLIANT_OK) return status;
    carry(data, &data->contacts, &search->made);
    pliant_contacts_exchange(&data->contacts, &search->made);
    return PLIANT_OK;
}

/* ---- once a step is solved */

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static double gap_of(const pliant_contact_point *point, const double *positions)
{
    double gap = 0;
    for (int d = 0; d < 3; d++) {
        double at = -point->place[d];
        for (int32_t k = 0; k < point->count; k++) at += point->weight[k] * positions[3 * (size_t)point->node[k] + (size_t)d];
        gap += point->normal[d] * at;
    }
    return gap;
}

/* As it has been solved. */
static bool presses(const pliant_data *data, const pliant_contact_point *point)
{
    const pliant_contacts *now = &data->contacts;
    const pliant_contact_point *found = now->count > 0 ? bsearch(point, now->point, (size_t)now->count, sizeof *point, pliant_contact_compare) : NULL;
    return found && dot(found->force, found->normal) > 0;
}

/* the deepest of a feature's points so far; INFINITY: there is none; -INFINITY: one of them presses from the other side, and both cannot be right. same: that which the point takes the place of, or NULL;
 * of one on the other side that does not press it does. The point is as firm as the firmest of them. */
static double gap_so_far(const pliant_data *data, const pliant_contacts *all, int32_t count, pliant_contact_point *point, pliant_contact_point **same)
{
    double gap = INFINITY;
    *same = NULL;
    pliant_contact_point one = {.feature = point->feature & ~(uint64_t)(PLIANT_FEATURE_POINTS - 1)};
    for (int n = 0; n < PLIANT_FEATURE_POINTS; n++, one.feature++) {
        pliant_contact_point *found = count > 0 ? bsearch(&one, all->point, (size_t)count, sizeof one, pliant_contact_compare) : NULL;
        const bool beyond = found && dot(found->normal, point->normal) < 0;
        if (beyond && !presses(data, found)) point->feature = found->feature;
        else if (found) gap = fmin(gap, beyond ? -INFINITY : gap_of(found, data->positions));
        if (found) point->firm = fmax(point->firm, found->firm);
        if (found && found->feature == point->feature) *same = found;
    }
    return gap;
}

/* Points that are deeper than those of their features, to those that it is solved again with. @return how many */
static int32_t take_in(const pliant_data *data, const pliant_contact_start *start, const pliant_contacts *found)
{
    const double deeper = 1e-4; /* [m] */
    pliant_contacts *all = start->points;
    const int32_t count = all->count;
    int32_t taken = 0;
    for (int32_t n = 0; n < found->count; n++) {
        pliant_contact_point *point = found->point + n, *same;
        const double before = gap_so_far(data, all, count, point, &same);
        if (!(gap_of(point, data->positions) < fmin(before, 0) - deeper)) continue;
        if (same) pliant_contact_carry(same, start->positions, point);
        for (int d = 0; d < 3 && same; d++) point->anchor[d] -= point->drift[d]; /* both are where the step ends */
        if (same) *same = *point;
        else all->point[all->count++] = *point;
        taken++;
    }
    if (all->count > count) qsort(all->point, (size_t)all->count, sizeof *all->point, pliant_contact_compare);
    return taken;
}

static const double spins = 1; /* [rad] in a step: further, a part does not hold what is before it (find.c) */

double pliant_contact_turn(const pliant_model *model, const pliant_data *data)
{
    double most = 0;
    for (int t = 0; t < data->num_tools; t++) {
        const pliant_tool *tool = data->tools + t;
        if (tool->shape.num_parts > 0 && pliant_contact_goes_on(model, tool)) most = fmax(most, pliant_rotation_angle(tool->last.rotation, tool->rotation) / spins);
    }
    return most;
}

/* INFINITY: of half-spaces alone, or of none */
static double thinnest_of(const pliant_contact_search *search)
{
    double thinnest = INFINITY;
    for (int32_t p = 0; p < search->num_parts; p++) thinnest = fmin(thinnest, pliant_part_depth(search->part[p].part));
    return thinnest;
}

static bool may_pass(const pliant_model *model, const pliant_data *data)
{
    return data->contact_search && thinnest_of(data->contact_search) < INFINITY && pliant_contact_turn(model, data) <= 1;
}

bool pliant_contact_may_pass(const pliant_model *model, const pliant_data *data) { return data->solver && may_pass(model, data); }

/* how deep a point is in a tool, over how deep that is there; 0: it is of something else */
static double deep_in_tool(const pliant_data *data, const pliant_contact_point *point)
{
    if (point->kind != PLIANT_OBSTACLE_TOOL) return 0;
    return -gap_of(point, data->positions) / pliant_part_depth(data->tools[point->tool].shape.part + point->part);
}

double pliant_contact_deepest(const pliant_data *data, const pliant_contacts *points, const double *positions, bool began)
{
    double most = 0;
    for (int32_t n = 0; n < points->count; n++) {
        const pliant_contact_point *point = points->point + n;
        if (point->kind != PLIANT_OBSTACLE_TOOL) continue;
        const double gap = gap_of(point, positions) + (began ? dot(point->normal, point->drift) : 0);
        most = fmax(most, -gap / pliant_part_depth(data->tools[point->tool].shape.part + point->part));
    }
    return most;
}

/* A piece that has been touched only now may get to the ground, too. */
static void add_walls(pliant_data *data, pliant_contacts *points)
{
    const int32_t before = points->count;
    if (!data->falling) return;
    if (pliant_falling_find_walls(data, points) != PLIANT_OK) points->count = before;
    if (points->count > before) qsort(points->point, (size_t)points->count, sizeof *points->point, pliant_contact_compare);
}

bool pliant_contact_passed(const pliant_model *model, pliant_data *data, const pliant_contact_start *start)
{
    pliant_contact_search *search = data->contact_search;
    const pliant_body *body = NULL;
    const double *positions = NULL;
    if (search) search->passed = 0;
    if (!may_pass(model, data) || choose_surface(model, data, &body, &positions) != PLIANT_OK) return false;
    const double way = pliant_contact_way(search->finder, positions);
    if (!(way > 0.25 * thinnest_of(search))) return false; /* it is where points were looked for */
    search->made.count = 0;
    pliant_status status = gather_parts(model, data, way);
    if (status == PLIANT_OK) status = pliant_contact_find_passed(search->finder, body, positions, search->num_parts, search->part, &search->made);
    if (status == PLIANT_OK && search->made.count > 0) status = pliant_contacts_reserve(start->points, start->points->count + search->made.count);
    if (status != PLIANT_OK || search->made.count == 0) return false;
    if (body != data->body) pliant_outside_spread(&search->outside, &search->made);
    for (int32_t n = 0; n < search->made.count; n++) search->passed = fmax(search->passed, deep_in_tool(data, search->made.point + n));
    if (take_in(data, start, &search->made) == 0) return false;
    add_walls(data, start->points);
    return true;
}

void pliant_contact_forget_passed(pliant_data *data)
{
    if (data->contact_search) pliant_finder_forget_more(data->contact_search->finder);
}

double pliant_contact_passed_by(const pliant_data *data) { return data->contact_search ? data->contact_search->passed : 0; }

double pliant_contact_deep_beside_patch(const pliant_data *data)
{
    const pliant_touch_pieces *pieces = data->falling ? pliant_falling_touch_pieces(data->falling) : NULL;
    double most = 0;
    for (int32_t n = 0; n < data->contacts.count; n++) {
        const pliant_contact_point *point = data->contacts.point + n;
        if (!pliant_patch_holds(data, n) && !(pieces && pieces->of_node[point->node[0]] >= 0)) most = fmax(most, deep_in_tool(data, point));
    }
    return most;
}

/* Whether something else presses the point's piece against the tool's part, with more than half of what that presses it with: there is no way out then. */
static bool is_squeezed(const pliant_data *data, const int32_t *piece, const pliant_contact_point *point)
{
    const double share = 0.5;
    double against = 0, with = 0;
    for (int32_t n = 0; n < data->contacts.count; n++) {
        const pliant_contact_point *other = data->contacts.point + n;
        const bool same = other->kind == point->kind && other->tool == point->tool && other->part == point->part;
        double weight = 0;
        for (int32_t k = 0; k < other->count; k++) weight += piece[other->node[k]] == piece[point->node[0]] ? other->weight[k] : 0;
        const double pushes = weight * dot(other->force, point->normal);
        if (same) with += pushes;
        else against -= fmin(pushes, 0);
    }
    return against > 0 && against > share * with;
}

bool pliant_contact_piece_is_deep(pliant_data *data, const pliant_contact_start *start)
{
    const double share = 0.1, firmer = 16, firmest = 65535;
    const pliant_touch_pieces *pieces = pliant_falling_touch_pieces(data->falling);
    bool any = false;
    for (int32_t n = 0; n < data->contacts.count && pieces; n++) {
        const pliant_contact_point *point = data->contacts.point + n;
        const int32_t piece = pieces->of_node[point->node[0]];
        if (piece < 0 || !(point->area > 0 && pieces->piece[piece].young > 0) || !pliant_falling_lies_free(data->falling, piece)) continue;
        if (!(deep_in_tool(data, point) > share) || is_squeezed(data, pieces->of_node, point)) continue;
        pliant_contact_point *begun = bsearch(point, start->points->point, (size_t)start->points->count, sizeof *point, pliant_contact_compare);
        if (!begun || !(begun->firm < firmest)) continue;
        begun->firm = firmer * (1 + begun->firm) - 1;
        any = true;
    }
    return any;
}

void pliant_contact_goes_on_from_here(pliant_data *data)
{
    const pliant_touch_pieces *pieces = data->falling ? pliant_falling_touch_pieces(data->falling) : NULL; /* which have not gone yet */
    for (int32_t n = 0; n < data->contacts.count; n++) {
        pliant_contact_point *point = data->contacts.point + n;
        if (!point->begun && !(pieces && pieces->of_node[point->node[0]] >= 0)) memset(point->drift, 0, sizeof point->drift);
    }
}

void pliant_contact_end(pliant_data *data)
{
    for (int t = 0; t < data->num_tools; t++) {
        pliant_tool *tool = data->tools + t;
        tool->last.known = tool->present;
        memcpy(tool->last.tip, tool->tip, sizeof tool->tip);
        memcpy(tool->last.rotation, tool->rotation, sizeof tool->rotation);
        tool->last.jaw = tool->jaw;
    }
}

static void forget(pliant_contact_search *search)
{
    if (!search) return;
    pliant_finder_forget(search->finder);
    pliant_tissue_forget(&search->tissue);
}

void pliant_contact_forget(pliant_data *data)
{
    data->contacts.count = 0;
    forget(data->contact_search);
}

/* ---- to go on from there twice, and to go back to */

/* Errors: MEMORY (there are no points then) */
static pliant_status copy_known(const pliant_contact_search *from, const pliant_contacts *points, pliant_contact_search **to, pliant_contacts *out)
{
    out->count = 0;
    if (!from) {
        forget(*to);
        return PLIANT_OK;
    }
    pliant_status status = begin(to);
    if (status == PLIANT_OK) status = pliant_finder_copy(from->finder, (*to)->finder);
    if (status == PLIANT_OK) status = pliant_tissue_copy(&from->tissue, &(*to)->tissue);
    if (status == PLIANT_OK) status = pliant_contacts_copy(points, out);
    return status;
}

pliant_status pliant_contact_copy(const pliant_data *from, pliant_data *to)
{
    return copy_known(from->contact_search, &from->contacts, &to->contact_search, &to->contacts);
}

pliant_status pliant_contact_keep(const pliant_data *data, pliant_contact_kept *kept)
{
    memcpy(kept->tools, data->tools, sizeof kept->tools);
    return copy_known(data->contact_search, &data->contacts, &kept->search, &kept->points);
}

pliant_status pliant_contact_again(const pliant_contact_kept *kept, pliant_data *data)
{
    memcpy(data->tools, kept->tools, sizeof kept->tools);
    return copy_known(kept->search, &kept->points, &data->contact_search, &data->contacts);
}

void pliant_contact_undo(pliant_contact_kept *kept, pliant_data *data)
{
    memcpy(data->tools, kept->tools, sizeof kept->tools);
    pliant_contacts_exchange(&kept->points, &data->contacts);
    if (!kept->search || !data->contact_search) {
        pliant_contact_forget(data);
        return;
    }
    pliant_finder *const finder = data->contact_search->finder;
    const pliant_tissue tissue = data->contact_search->tissue;
    data->contact_search->finder = kept->search->finder;
    data->contact_search->tissue = kept->search->tissue;
    kept->search->finder = finder;
    kept->search->tissue = tissue;
}

static void free_known(pliant_contact_search *search, pliant_contacts *points)
{
    pliant_free(points->point);
    if (!search) return;
    pliant_finder_free(search->finder);
    pliant_tissue_free(&search->tissue);
    pliant_outside_free(&search->outside);
    pliant_free(search->made.point);
    pliant_free(search->pose);
    pliant_free(search->overlaps);
    pliant_free(search->place);
    pliant_free(search);
}

void pliant_contact_kept_free(pliant_contact_kept *kept) { free_known(kept->search, &kept->points); }
void pliant_contact_free(pliant_data *data) { free_known(data->contact_search, &data->contacts); }
