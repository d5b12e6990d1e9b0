/* Read the fine mesh from a file. */
#include "sim/build/build_stages.h"

#include "base/fail.h"
#include "material/material.h"
#include "material/names.h"
#include "mesh/mesh.h"
#include "mesh/mesh_file.h"
#include "base/memory.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { MAX_REGIONS = 4096 };

pliant_status pliant_external_check(const pliant_scene *scene)
{
    const char *other = NULL;
    if (!scene->mesh.file[0]) return PLIANT_OK;
    if (scene->mesh.kind != PLIANT_LATTICE) other = "mesh/kind: octree; set lattice";
    else if (scene->model.method != PLIANT_FINE)
        other = "model/method: the mesh of a file has no coarse mesh; set fine";
    else if (scene->solver.kind != PLIANT_TLED && scene->solver.preconditioner == PLIANT_MULTIGRID)
        other = "solver/preconditioner: multigrid needs a lattice; set auto or direct";
    else if (scene->mesh.bone_surface) other = "mesh/bone_surface: the nodes of a file stay where they are; set false";
    else if (scene->cut.kind != PLIANT_CUT_NONE) other = "cut/kind: cuts need a lattice; set none";
    return other ? pliant_fail(PLIANT_ERROR_SCENE, "mesh/file conflicts with %s, or leave mesh/file empty", other)
                 : PLIANT_OK;
}

/* Return the material of a region, by its name, otherwise by its number as a label. -1: none */
static int material_of(const pliant_material_table *table, const mesh_file *file, int64_t number, const char **name)
{
    pliant_label_segment segment = {0};
    *name = "";
    if (file->regions == MESH_REGIONS_MATERIALS) return number >= 0 && number < table->num_materials ? (int)number : -1;
    for (int32_t n = 0; n < file->num_names; n++)
        if (file->name[n].number == number) *name = file->name[n].name;
    snprintf(segment.name, sizeof segment.name, "%s", *name);
    if (number >= 0 && number <= UINT16_MAX) segment.label = segment.value = (uint16_t)number;
    return pliant_material_of_segment(table, &segment);
}

/* Assign materials by regions; each region is looked up once. Errors: MATERIAL, with all regions that have no
 * material. */
static pliant_status by_regions(const char *path, const pliant_material_table *table, const mesh_file *file,
                                uint8_t *material)
{
    static const size_t capacity = 1024;
    struct { int64_t number; int material; } known[MAX_REGIONS];
    char missing[1024] = "", nearest[256];
    int count = 0;
    for (int32_t t = 0; t < file->num_tets; t++) {
        int n = 0;
        while (n < count && known[n].number != file->region[t]) n++;
        if (n == MAX_REGIONS)
            return pliant_fail(PLIANT_ERROR_FORMAT, "%s: has more than %d regions; merge regions of one material", path,
                               MAX_REGIONS);
        if (n == count) {
            const char *name;
            known[count].number = file->region[t];
            known[count].material = material_of(table, file, file->region[t], &name);
            if (known[count++].material < 0 && strlen(missing) < capacity - 400) {
                const size_t at = strlen(missing);
                pliant_nearest_names(table, name, nearest, sizeof nearest);
                if (name[0])
                    snprintf(missing + at, capacity - at, "; %lld '%s' (nearest: %s)", (long long)file->region[t], name,
                             nearest);
                else snprintf(missing + at, capacity - at, "; %lld", (long long)file->region[t]);
            }
        }
        material[t] = (uint8_t)(known[n].material < 0 ? 0 : known[n].material);
    }
    if (!missing[0]) return PLIANT_OK;
    return pliant_fail(
        PLIANT_ERROR_MATERIAL,
        "mesh/file: %s has regions without a material%s. Name them as materials of the table, "
        "or add their numbers to the labels of a material",
        path, missing);
}

/* Assign materials by the scan: the most frequent material at the center and halfway to the corners. */
static void by_scan(const pliant_model *model, const mesh_file *file, uint8_t *material)
{
    const pliant_geometry *scan = &model->scan->geometry;
    for (int32_t t = 0; t < file->num_tets; t++) {
        double centre[3] = {0, 0, 0}, point[3], index[3];
        int found[5], votes[5] = {0}, best = 0;
        for (int v = 0; v < 4; v++)
            for (int d = 0; d < 3; d++)
                centre[d] += file->nodes[3 * (size_t)file->tets[4 * (size_t)t + (size_t)v] + (size_t)d] / 4;
        for (int n = 0; n < 5; n++) {
            size_t at[3];
            for (int d = 0; d < 3; d++)
                point[d] = n == 0
                               ? centre[d]
                               : 0.5 * (centre[d] +
                                        file->nodes[3 * (size_t)file->tets[4 * (size_t)t + (size_t)n - 1] + (size_t)d]);
            pliant_geometry_to_index(scan, point, index);
            for (int d = 0; d < 3; d++) at[d] = (size_t)fmin(fmax(floor(index[d] + 0.5), 0), scan->size[d] - 1);
            found[n] =
                model->material_of_voxel[at[0] + (size_t)scan->size[0] * (at[1] + (size_t)scan->size[1] * at[2])];
        }
        for (int a = 0; a < 5; a++)
            for (int b = 0; b < 5; b++) votes[a] += found[a] == found[b];
        for (int a = 1; a < 5; a++)
            if (votes[a] > votes[best]) best = a;
        material[t] = (uint8_t)found[best];
    }
}

/* Regions replace the scan: all nodes of a fixed region are fixed, and the scan's bone fixes no nodes. */
static pliant_status place_nodes(const pliant_model *model, pliant_mesh *mesh, const pliant_tet_material *materials)
{
    mesh->place_of_node = pliant_calloc((size_t)mesh->num_nodes, 1); /* PLIANT_BONE_OUTSIDE */
    if (!mesh->place_of_node) return pliant_fail_memory("the fixed nodes");
    for (int32_t t = 0; t < mesh->num_tets && !model->scene.material.deformable_bone; t++)
        for (int v = 0; v < 4 && model->materials.materials[materials[t].material].fixed; v++)
            mesh->place_of_node[mesh->tets[4 * (size_t)t + (size_t)v]] = PLIANT_BONE_SURFACE;
    return PLIANT_OK;
}

pliant_status pliant_external_mesh(pliant_model *model)
{
    const pliant_scene *scene = &model->scene;
    pliant_body *body = model->body;
    mesh_file file;
    pliant_status status = pliant_mesh_file_read(scene->mesh.file, scene->mesh.unit, &file);
    if (status != PLIANT_OK) return status;
    uint8_t *material = pliant_calloc((size_t)file.num_tets, 1);
    if (!material) status = pliant_fail_memory("the materials of the mesh");
    else if (file.regions == MESH_REGIONS_NONE) by_scan(model, &file, material);
    else status = by_regions(scene->mesh.file, &model->materials, &file, material);
    if (status == PLIANT_OK)
        status = pliant_mesh_of_file(scene->mesh.file, &file, &model->scan->geometry, material, scene->mesh.keep_air,
                                     &model->materials, &body->fine, &body->fine_material);
    if (status == PLIANT_OK && file.regions != MESH_REGIONS_NONE)
        status = place_nodes(model, &body->fine, body->fine_material);
    if (status == PLIANT_OK)
        pliant_log(PLIANT_LOG_INFO, "mesh/file: %s: %d nodes, %d tetrahedra; materials by %s", scene->mesh.file,
                   body->fine.num_nodes, body->fine.num_tets,
                   file.regions == MESH_REGIONS_NONE ? "the scan" : "its regions");
    pliant_free(material);
    pliant_mesh_file_free(&file);
    return status;
}
