#include "sim/build/build_stages.h"

#include "base/fail.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <math.h>

static const double unnoticed_offset = 0.05; /* of a plane from the nodes that it holds [cell] */

/* A node is in a material if at least half of the eight voxels around it are. */
static bool in_fixed_material(const pliant_model *model, const double world[3])
{
    const pliant_geometry *geometry = &model->scan->geometry;
    double index[3];
    pliant_geometry_to_index(geometry, world, index);
    int count = 0;
    for (int corner = 0; corner < 8; corner++) {
        size_t at[3];
        for (int d = 0; d < 3; d++) {
            double i = floor(index[d] + 1e-6) + (corner >> d & 1);
            at[d] = (size_t)fmin(fmax(i, 0), geometry->size[d] - 1);
        }
        uint8_t material =
            model->material_of_voxel[at[0] + (size_t)geometry->size[0] * (at[1] + (size_t)geometry->size[1] * at[2])];
        count += model->materials.materials[material].fixed;
    }
    return count >= 4;
}

static bool in_fixed_region(const pliant_scene *scene, const double x[3])
{
    for (uint32_t b = 0; b < scene->fixed.num_boxes; b++) {
        const pliant_fixed_box *box = scene->fixed.boxes + b;
        if (x[0] >= box->low[0] && x[1] >= box->low[1] && x[2] >= box->low[2] && x[0] <= box->high[0] &&
            x[1] <= box->high[1] && x[2] <= box->high[2])
            return true;
    }
    for (uint32_t p = 0; p < scene->fixed.num_planes; p++) {
        const pliant_fixed_plane *plane = scene->fixed.planes + p;
        double side = 0;
        for (int d = 0; d < 3; d++) side += plane->normal[d] * (x[d] - plane->point[d]);
        if (side <= 0) return true;
    }
    return false;
}

bool pliant_fixed_node(const pliant_model *model, int32_t node)
{
    const double *x = model->body->fine.rest + 3 * node;
    if (model->body->fine.place_of_node)
        return model->body->fine.place_of_node[node] != PLIANT_BONE_OUTSIDE || in_fixed_region(&model->scene, x);
    return (!model->scene.material.deformable_bone && in_fixed_material(model, x)) || in_fixed_region(&model->scene, x);
}

/* A plane between nodes clamps tissue at the last nodes behind it, so warn about the distance. */
static bool log_plane(const pliant_mesh *mesh, const pliant_fixed_plane *plane, int number)
{
    double length = 0, last = -INFINITY, first = INFINITY, cell = 0, unit[3], behind[3], before[3];
    for (int d = 0; d < 3; d++) length += plane->normal[d] * plane->normal[d];
    for (int d = 0; d < 3; d++) unit[d] = plane->normal[d] / sqrt(length);
    for (int axis = 0; axis < 3; axis++) {
        double along = 0;
        for (int d = 0; d < 3; d++) along += mesh->direction[3 * d + axis] * unit[d];
        cell += fabs(along) * mesh->cell_size[axis];
    }
    for (int32_t n = 0; n < mesh->num_nodes; n++) {
        double side = 0;
        for (int d = 0; d < 3; d++) side += unit[d] * (mesh->rest[3 * n + d] - plane->point[d]);
        if (side <= 0) last = fmax(last, side);
        else first = fmin(first, side);
    }
    for (int d = 0; d < 3; d++) {
        behind[d] = plane->point[d] + last * unit[d];
        before[d] = plane->point[d] + first * unit[d];
    }
    if (last == -INFINITY) {
        pliant_log(
            PLIANT_LOG_WARNING,
            "fixed/planes: number %d holds no node: the first lies %.3g mm in front of it; with the point "
            "(%.5f %.5f %.5f) or beyond it would hold some",
            number, 1e3 * first, before[0], before[1], before[2]);
        return false;
    }
    if (first < INFINITY && -last > unnoticed_offset * cell)
        pliant_log(
            PLIANT_LOG_WARNING,
            "fixed/planes: number %d lies between nodes: tissue is held %.3g mm behind it, at (%.5f %.5f %.5f); the "
            "next nodes lie %.3g mm in front of it, at (%.5f %.5f %.5f). Choose one of these points, "
            "or other mesh/coarse_cells",
            number, -1e3 * last, behind[0], behind[1], behind[2], 1e3 * first, before[0], before[1], before[2]);
    return true;
}

int pliant_fixed_planes_log(const pliant_model *model)
{
    int none = 0;
    for (uint32_t p = 0; p < model->scene.fixed.num_planes && !model->body->fine.place_of_node; p++)
        if (!log_plane(&model->body->fine, model->scene.fixed.planes + p, (int)p + 1) && none == 0) none = (int)p + 1;
    return none;
}

pliant_status pliant_fixed_surface(pliant_model *model)
{
    const pliant_geometry *geometry = &model->scan->geometry;
    const size_t voxels = pliant_geometry_voxels(geometry), columns = (size_t)geometry->size[0],
                 rows = (size_t)geometry->size[1];
    bool by_material = !model->scene.material.deformable_bone,
         by_region = model->scene.fixed.num_boxes + model->scene.fixed.num_planes > 0;
    uint8_t *fixed = pliant_calloc(voxels, 1);
    if (!fixed) return pliant_fail_memory("the surface of the fixed tissue");
#pragma omp parallel for schedule(static)
    for (size_t v = 0; v < voxels; v++) {
        double world[3], index[3] = {(double)(v % columns), (double)(v / columns % rows), (double)(v / columns / rows)};
        fixed[v] = by_material && model->materials.materials[model->material_of_voxel[v]].fixed;
        if (!by_region || fixed[v]) continue;
        pliant_geometry_to_world(geometry, index, world);
        fixed[v] = in_fixed_region(&model->scene, world);
    }
    pliant_status status = pliant_mesh_bone(geometry, fixed, &model->body->fine);
    pliant_free(fixed);
    return status;
}
