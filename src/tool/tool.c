/* Tools: their poses, grasps and forces. A force at a point is distributed to the nodes with the weights that
 * interpolate its displacement ([H] 3.2, equation 11). A grasped blob is a set of such points. */
#include "base/fail.h"
#include "contact/shapes/shapes.h"
#include "cut/cut.h"
#include "fem/element/hexahedra.h"
#include "mesh/mesh.h"
#include "topology/sorted_numbers.h"
#include "tool/blade.h"
#include "tool/tool.h"
#include "base/memory.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static bool finite3(const double *v) { return isfinite(v[0]) && isfinite(v[1]) && isfinite(v[2]); }

static pliant_status check_tool(const pliant_data *data, int tool)
{
    if (tool >= 0 && tool < data->num_tools) return PLIANT_OK;
    return pliant_fail(PLIANT_ERROR_ARGUMENT, "there is no tool %d: %d were added", tool, data->num_tools);
}

pliant_status pliant_tool_add(const pliant_model *model, pliant_data *data, const char *name, int *index)
{
    for (int t = 0; t < data->num_tools; t++)
        if (strcmp(data->tools[t].name, name) == 0) {
            *index = t;
            return PLIANT_OK;
        }
    if (strlen(name) >= sizeof data->tools->name)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "tool %.20s...: its name has %zu characters; use at most %zu", name,
                           strlen(name), sizeof data->tools->name - 1);
    if (data->num_tools == PLIANT_MAX_TOOLS)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "tool %s cannot be added: the maximum is %d tools", name,
                           PLIANT_MAX_TOOLS);
    pliant_tool *tool = data->tools + data->num_tools;
    memset(tool, 0, sizeof *tool);
    snprintf(tool->name, sizeof tool->name, "%s", name);
    tool->rotation[3] = 1;
    tool->stiffness = model->scene.grasp.stiffness;
    tool->damping = model->scene.grasp.damping;
    tool->radius = model->scene.grasp.radius;
    *index = data->num_tools++;
    return PLIANT_OK;
}

pliant_status pliant_tool_set_pose(pliant_data *data, int tool, const double tip[3], const double rotation[4])
{
    pliant_status status = check_tool(data, tool);
    if (status != PLIANT_OK) return status;
    static const double identity[4] = {0, 0, 0, 1};
    if (!rotation) rotation = identity;
    if (!finite3(tip) || !finite3(rotation) || !isfinite(rotation[3]))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "the pose of tool %s is not finite", data->tools[tool].name);
    double size = 0;
    for (int d = 0; d < 4; d++) size += rotation[d] * rotation[d];
    if (!(size > 0) || !isfinite(size))
        return pliant_fail(
            PLIANT_ERROR_ARGUMENT,
            "the rotation of tool %s is (%g %g %g %g), not a rotation quaternion x y z w; the identity is (0 0 0 1)",
            data->tools[tool].name, rotation[0], rotation[1], rotation[2], rotation[3]);
    memcpy(data->tools[tool].tip, tip, sizeof data->tools[tool].tip);
    memcpy(data->tools[tool].rotation, rotation, sizeof data->tools[tool].rotation);
    data->tools[tool].present = true;
    return PLIANT_OK;
}

/* Return the largest radius that a contact of a part can have [m]: its own, or the second largest of the half sizes. */
static double widest_contact(const pliant_part *part)
{
    const pliant_pose identity = {.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    double low[3], high[3], half[3];
    if (part->kind == PLIANT_PART_SPHERE || part->kind == PLIANT_PART_CAPSULE) return part->radius;
    pliant_part_box(part, &identity, low, high);
    for (int d = 0; d < 3; d++) half[d] = 0.5 * (high[d] - low[d]);
    return fmax(fmin(half[0], half[1]), fmin(fmax(half[0], half[1]), half[2]));
}

/* Log a warning if no contact of the shape can have a radius of two cells. */
static void warn_of_cells(const pliant_data *data, const pliant_tool *tool)
{
    const bool is_coarse = data->body->coarse.num_nodes > 0 && !(data->model->scene.model.patch > 0);
    const double *size = (is_coarse ? &data->body->coarse : &data->body->fine)->cell_size,
                 cell = cbrt(size[0] * size[1] * size[2]);
    double radius = 0;
    for (int32_t p = 0; p < tool->shape.num_parts; p++) radius = fmax(radius, widest_contact(tool->shape.part + p));
    if (!(radius > 0) || radius >= PLIANT_RESOLVED_CELLS * cell) return;
    pliant_log(
        PLIANT_LOG_WARNING,
        "tool %s: its contacts have a radius of at most %.3g mm, below two cells of %.3g mm, so its contact forces are "
        "inaccurate; use contact_force_error, smaller cells (mesh/coarse_cells, mesh/ratio) or model/patch",
        tool->name, 1e3 * radius, 1e3 * cell);
}

pliant_status pliant_tool_set_shape(pliant_data *data, int index, const pliant_tool_shape *shape)
{
    char reason[160];
    bool turns = false;
    pliant_status status = check_tool(data, index);
    if (status != PLIANT_OK) return status;
    pliant_tool *tool = data->tools + index;
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
    tool->warned_of_cells = false;
    warn_of_cells(data, tool);
    return PLIANT_OK;
}

pliant_status pliant_tool_set_jaw(pliant_data *data, int index, double angle)
{
    pliant_status status = check_tool(data, index);
    if (status != PLIANT_OK) return status;
    pliant_tool *tool = data->tools + index;
    if (!isfinite(angle))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "tool %s: the angle of its jaw is not finite", tool->name);
    tool->jaw = angle;
    return PLIANT_OK;
}

void pliant_tool_reset_grasp(pliant_tool *tool)
{
    pliant_tool_remove_grasp(tool);
    memset(tool->driving_force, 0, sizeof tool->driving_force);
    tool->drive = PLIANT_DRIVE_SPRING;
}

void pliant_tool_free(pliant_tool *tool)
{
    pliant_blade_end_stroke(tool);
    pliant_tool_remove_grasp(tool);
    pliant_tool_shape_free(&tool->shape);
}

void pliant_tool_release(pliant_data *data, int tool)
{
    if (check_tool(data, tool) != PLIANT_OK) return;
    pliant_tool_reset_grasp(data->tools + tool);
}

void pliant_tool_remove_pose(pliant_data *data, int tool)
{
    if (check_tool(data, tool) != PLIANT_OK) return;
    pliant_tool_reset_grasp(data->tools + tool);
    pliant_blade_end_stroke(data->tools + tool);
    data->tools[tool].present = false;
}

pliant_status pliant_tool_set_drive(pliant_data *data, int tool, pliant_drive drive, const double force[3])
{
    pliant_status status = check_tool(data, tool);
    if (status != PLIANT_OK) return status;
    if (drive != PLIANT_DRIVE_SPRING && drive != PLIANT_DRIVE_RIGID && drive != PLIANT_DRIVE_FORCE)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "tool %s: drive %d; use spring (%d), rigid (%d) or force (%d)",
                           data->tools[tool].name, (int)drive, PLIANT_DRIVE_SPRING, PLIANT_DRIVE_RIGID,
                           PLIANT_DRIVE_FORCE);
    if (drive == PLIANT_DRIVE_FORCE && (!force || !finite3(force)))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "tool %s: driving by force needs a finite force",
                           data->tools[tool].name);
    data->tools[tool].drive = drive;
    if (drive == PLIANT_DRIVE_FORCE)
        memcpy(data->tools[tool].driving_force, force, sizeof data->tools[tool].driving_force);
    return PLIANT_OK;
}

pliant_status pliant_tool_set_mass(pliant_data *data, int tool, double mass)
{
    pliant_status status = check_tool(data, tool);
    if (status != PLIANT_OK) return status;
    if (!(mass >= 0) || !isfinite(mass))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "tool %s: a mass of %g kg", data->tools[tool].name, mass);
    data->tools[tool].mass = mass;
    return PLIANT_OK;
}

/* ---- grasp */

/* points along the diameter of the blob, and in its bounding box */
enum { BLOB_POINTS = 9, MAX_POINTS = BLOB_POINTS * BLOB_POINTS * BLOB_POINTS };

/* Return whether an initial tetrahedron has fragments or has given voxels to another one. */
static bool is_cut(const pliant_cuts *cuts, int32_t tet)
{
    return cuts && place_of(cuts->tet, cuts->num_tets, tet) >= 0;
}

/* tetrahedra and weights of rest points */
typedef struct rest_points {
    int32_t count;
    double at[3 * MAX_POINTS], weight[4 * MAX_POINTS];
    int32_t tet[MAX_POINTS];   /* -1: no tissue at the point */
} rest_points;

/* Find the tetrahedra at rest points. In cut tetrahedra, the fragments are searched in the whole mesh, once for all
 * points. */
static void find_tets(const pliant_body *body, rest_points *points)
{
    rest_points open = {0};
    int32_t place[MAX_POINTS];
    for (int32_t p = 0; p < points->count; p++) {
        int32_t tet = points->tet[p] = pliant_mesh_locate(&body->fine, points->at + 3 * p, points->weight + 4 * p);
        /* possibly in an appended tetrahedron */
        const bool elsewhere = tet < 0 && body->subdivision && body->tet_parent;
        if (!elsewhere && (tet < 0 || !is_cut(body->cuts, tet))) continue;
        memcpy(open.at + 3 * open.count, points->at + 3 * p, 3 * sizeof *open.at);
        place[open.count++] = p;
    }
    if (open.count > 0) pliant_body_locate_points(body, body->fine.rest, open.count, open.at, open.tet, open.weight);
    for (int32_t o = 0; o < open.count; o++) {
        points->tet[place[o]] = open.tet[o];
        memcpy(points->weight + 4 * place[o], open.weight + 4 * o, 4 * sizeof *open.weight);
    }
}

/* Return whether trilinear weights hold a ball. A ball below an edge of a cube would be too stiff with them
 * (fem/element/NUMERICS.md). */
static bool is_held_by_cubes(const pliant_scene *scene, const pliant_mesh *mesh, double radius)
{
    const double *size = mesh->cell_size;
    return scene->element.kind == PLIANT_HEXAHEDRA && radius >= cbrt(size[0] * size[1] * size[2]);
}

/* Add the trilinear weights of the eight corners at a point of a whole cube. Return false for other tetrahedra. */
static bool add_in_cube(const pliant_mesh *mesh, int32_t tet, const double at[3], double *weights)
{
    pliant_cube cube;
    if (!mesh->lattice_of_tet || !pliant_cube_of(mesh, tet, &cube) || !pliant_cube_is_box(mesh, &cube, 1)) return false;
    const double *corner = mesh->rest + 3 * cube.node[0];
    double local[3];
    for (int axis = 0; axis < 3; axis++) {
        local[axis] = 0;
        for (int d = 0; d < 3; d++)
            local[axis] += (at[d] - corner[d]) * mesh->direction[3 * d + axis] / mesh->cell_size[axis];
    }
    for (int v = 0; v < 8; v++) {
        double weight = 1;
        for (int axis = 0; axis < 3; axis++) weight *= v >> axis & 1 ? local[axis] : 1 - local[axis];
        weights[cube.node[v]] += weight;
    }
    return true;
}

/* Sum the weights of the fine nodes over the rest points. by_cubes: use trilinear weights where possible. Return the
 * number of points in tissue. */
static int32_t add_points(const pliant_body *body, bool by_cubes, rest_points *points, double *weights)
{
    int32_t inside = 0;
    find_tets(body, points);
    for (int32_t p = 0; p < points->count; p++) {
        if (points->tet[p] < 0) continue;
        inside++;
        if (by_cubes && add_in_cube(&body->fine, points->tet[p], points->at + 3 * p, weights)) continue;
        for (int v = 0; v < 4; v++) weights[body->fine.tets[4 * points->tet[p] + v]] += points->weight[4 * p + v];
    }
    return inside;
}

/* List the points of a grid in a sphere; for radius 0, its centre. */
static void list_points(const double centre[3], double radius, rest_points *out)
{
    out->count = radius > 0 ? 0 : 1;
    memcpy(out->at, centre, 3 * sizeof *centre);
    for (int n = 0; radius > 0 && n < MAX_POINTS; n++) {
        const int at[3] = {n % BLOB_POINTS, n / BLOB_POINTS % BLOB_POINTS, n / BLOB_POINTS / BLOB_POINTS};
        double unit[3];
        for (int d = 0; d < 3; d++) unit[d] = 2.0 * at[d] / (BLOB_POINTS - 1) - 1;
        if (unit[0] * unit[0] + unit[1] * unit[1] + unit[2] * unit[2] > 1 + 1e-9) continue;
        for (int d = 0; d < 3; d++) out->at[3 * out->count + d] = centre[d] + radius * unit[d];
        out->count++;
    }
}

/* Fail because there is no tissue at a point. The message contains the extent of the tissue, and a hint if the unit is
 * probably millimetres. */
static pliant_status fail_no_tissue(const pliant_mesh *mesh, const char *name, const double at[3])
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (int32_t n = 0; n < 3 * mesh->num_nodes; n++) {
        low[n % 3] = fmin(low[n % 3], mesh->rest[n]);
        high[n % 3] = fmax(high[n % 3], mesh->rest[n]);
    }
    bool far = false, inside_as_mm = true;
    for (int d = 0; d < 3; d++) {
        far = far || fabs(at[d]) >= 1;
        inside_as_mm = inside_as_mm && 1e-3 * at[d] >= low[d] && 1e-3 * at[d] <= high[d];
    }
    return pliant_fail(
        PLIANT_ERROR_ARGUMENT,
        "tool %s: there is no tissue at (%.4f %.4f %.4f) m; at rest it lies between (%.4f %.4f %.4f) and "
        "(%.4f %.4f %.4f) m%s",
        name, at[0], at[1], at[2], low[0], low[1], low[2], high[0], high[1], high[2],
        far && inside_as_mm ? ": the point seems to be in millimetres, metres are needed" : "");
}

/* List the nodes of a blob, ascending, with their weights. */
static pliant_status list_held(const pliant_scene *scene, const pliant_body *body, const pliant_tool *tool,
                               const double centre[3], double radius, int32_t *num_held, int32_t **nodes,
                               double **fractions)
{
    const pliant_mesh *mesh = &body->fine;
    double *weights = pliant_calloc((size_t)mesh->num_nodes, sizeof *weights), total = 0;
    if (!weights) return pliant_fail_memory("a tool's hold");
    int32_t count = 0, *held = NULL;
    double *weight = NULL;
    rest_points points;
    list_points(centre, radius, &points);
    const int32_t inside = add_points(body, is_held_by_cubes(scene, mesh, radius), &points, weights);
    pliant_status status = inside > 0 ? PLIANT_OK : fail_no_tissue(mesh, tool->name, centre);
    for (int32_t n = 0; n < mesh->num_nodes; n++) {
        count += weights[n] != 0;
        total += weights[n];
    }
    if (status == PLIANT_OK) {
        held = pliant_calloc((size_t)count, sizeof *held);
        weight = pliant_calloc((size_t)count, sizeof *weight);
        if (!held || !weight) status = pliant_fail_memory("a tool's hold");
    }
    if (status == PLIANT_OK) {
        *num_held = 0;
        for (int32_t n = 0; n < mesh->num_nodes; n++) {
            if (weights[n] == 0) continue;
            held[*num_held] = n;
            weight[(*num_held)++] = weights[n] / total;
        }
        *nodes = held;
        *fractions = weight;
    } else {
        pliant_free(held);
        pliant_free(weight);
    }
    pliant_free(weights);
    return status;
}

pliant_status pliant_tool_transfer(const pliant_scene *scene, pliant_tool *tool, const pliant_tool *from,
                                   const pliant_data *data, const pliant_body *next, const double *positions)
{
    *tool = *from;
    pliant_tool_shape_retain(&tool->shape);
    tool->held = NULL;
    tool->weight = NULL;
    tool->num_held = 0;
    tool->holding = tool->attached = false;
    pliant_status status = pliant_blade_transfer(&tool->blade, &from->blade, data, next, positions);
    if (status != PLIANT_OK || !from->holding) return status;
    if (!from->blade.is_dragging)
        status = list_held(scene, next, from, from->grasped, from->grasped_radius, &tool->num_held, &tool->held,
                           &tool->weight);
    else if (pliant_blade_num_inside(&tool->blade.edge) > 0) status = pliant_blade_hold(next, tool);
    else pliant_blade_release(tool);
    tool->holding = tool->num_held > 0;
    tool->attached = tool->holding && from->attached;
    memcpy(tool->force, from->force, sizeof tool->force);
    return status;
}

static void find_held_point(const pliant_data *data, pliant_tool *tool)
{
    memset(tool->held_point, 0, sizeof tool->held_point);
    for (int32_t h = 0; h < tool->num_held; h++)
        for (int d = 0; d < 3; d++) tool->held_point[d] += tool->weight[h] * data->positions[3 * tool->held[h] + d];
}

/* Warn if fixed tissue is grasped, because it cannot move and the force grows without bound. */
static void log_fixed_regions(const pliant_data *data, const pliant_tool *tool)
{
    double fixed = 0;
    for (int32_t h = 0; h < tool->num_held; h++)
        if (data->body->fine_fixed[tool->held[h]]) fixed += tool->weight[h];
    if (fixed < 0.25) return;
    const double *at = tool->held_point;
    pliant_log(
        PLIANT_LOG_WARNING,
        "tool %s: %.0f %% of the grasped tissue at (%.4f %.4f %.4f) m is fixed (bone, or a region of fixed:) and does "
        "not move; grasp soft tissue, or set material/deformable_bone",
        tool->name, 100 * fixed, at[0], at[1], at[2]);
}

pliant_status pliant_tool_grasp(const pliant_model *model, pliant_data *data, int index, const double rest[3])
{
    pliant_status status = check_tool(data, index);
    if (status != PLIANT_OK) return status;
    pliant_tool *tool = data->tools + index;
    const pliant_mesh *mesh = &data->body->fine;
    double centre[3], barycentric[4];
    if (rest) {
        if (!finite3(rest))
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "tool %s: the point to grasp is not finite", tool->name);
        memcpy(centre, rest, sizeof centre);
    } else {
        if (!tool->present)
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "tool %s has no pose: it cannot grasp", tool->name);
        int32_t tet = -1;
        if (!data->body->cuts) tet = pliant_mesh_locate_deformed(mesh, data->positions, tool->tip, barycentric);
        else if (!pliant_body_locate(data->body, data->positions, tool->tip, &tet, barycentric)) tet = -1;
        if (tet < 0) return fail_no_tissue(mesh, tool->name, tool->tip);
        memset(centre, 0, sizeof centre);
        for (int v = 0; v < 4; v++)
            for (int d = 0; d < 3; d++) centre[d] += barycentric[v] * mesh->rest[3 * mesh->tets[4 * tet + v] + d];
    }
    int32_t *held = NULL, count;
    double *weight = NULL;
    pliant_account *before = pliant_account_use(data->account);
    status = list_held(&model->scene, data->body, tool, centre, tool->radius, &count, &held, &weight);
    pliant_account_use(before);
    if (status != PLIANT_OK) return status;
    pliant_tool_reset_grasp(tool);
    tool->num_held = count;
    tool->held = held;
    tool->weight = weight;
    memcpy(tool->grasped, centre, sizeof tool->grasped);
    tool->grasped_radius = tool->radius;
    find_held_point(data, tool);
    if (!tool->present) {
        memcpy(tool->tip, tool->held_point, sizeof tool->tip);
        tool->present = true;
    }
    for (int d = 0; d < 3; d++) tool->tip_offset[d] = tool->tip[d] - tool->held_point[d];
    memcpy(tool->last_target, tool->held_point, sizeof tool->last_target);
    tool->holding = true;
    tool->slipped = 0;
    tool->hold++;
    log_fixed_regions(data, tool);
    return PLIANT_OK;
}

/* ---- during a step */

/* Limit the force of a spring drive before a step. The tip has moved, but the tissue has not moved yet, so the sum of
 * spring and damper is the maximum force of the step. */
void pliant_tool_slip(const pliant_scene *scene, pliant_data *data, int index)
{
    pliant_tool *tool = data->tools + index;
    if (!(scene->grasp.slip > 0) || !pliant_tool_grips(tool) || tool->drive != PLIANT_DRIVE_SPRING) return;
    const double maximum = scene->grasp.slip / (tool->stiffness + tool->damping / scene->solver.step);
    double stretch[3], length = 0;
    for (int d = 0; d < 3; d++) {
        stretch[d] = pliant_tool_target(tool, d) - tool->held_point[d];
        length += stretch[d] * stretch[d];
    }
    length = sqrt(length);
    if (length <= maximum) return;
    if (tool->slipped == 0)
        pliant_log(PLIANT_LOG_INFO, "tool %s: its grasp slips at %g N (grasp/slip)", tool->name, scene->grasp.slip);
    tool->slipped += length - maximum;
    for (int d = 0; d < 3; d++) tool->tip_offset[d] += (1 - maximum / length) * stretch[d];
    if (tool->slipped <= 2 * tool->grasped_radius) return;
    pliant_log(PLIANT_LOG_WARNING, "tool %s: the tissue has slipped out of its grasp (grasp/slip)", tool->name);
    pliant_tool_reset_grasp(tool);
}

void pliant_tool_report(pliant_data *data, int index, const double *force)
{
    pliant_tool *tool = data->tools + index;
    if (!tool->holding) {
        if (tool->blade.has_slipped) memcpy(tool->force, tool->blade.free_tissue_force, sizeof tool->force);
        return;
    }
    find_held_point(data, tool);
    if (force) memcpy(tool->force, force, sizeof tool->force);
    pliant_blade_update_force(tool);
}
