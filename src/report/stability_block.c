#include "report/stability_block.h"

#include <stdio.h>
#include <string.h>

static int hard_core(const int32_t voxel[3], const int32_t size[3])
{
    for (int d = 0; d < 3; d++)
        if (3 * voxel[d] < size[d] || 3 * voxel[d] >= 2 * size[d]) return BLOCK_SOFT;
    return BLOCK_HARD;
}

static void set_material(pliant_material *material, const char *name, int value, double young, double density)
{
    snprintf(material->name, sizeof material->name, "%s", name);
    material->young_modulus = young;
    material->poisson_ratio = 0.45;
    material->density = density;
    material->num_range = 2;
    material->range[0] = value - 0.5;
    material->range[1] = value + 0.5;
}

pliant_status block_create(const int32_t size[3], const double box[3], block_paint paint, block_body *out)
{
    pliant_geometry geometry = {{0}, {0}, {0}, {0}};
    memset(out, 0, sizeof *out);
    for (int d = 0; d < 3; d++) {
        geometry.size[d] = size[d];
        geometry.spacing[d] = box[d] / size[d];
        geometry.origin[d] = 0.5 * geometry.spacing[d];
        geometry.direction[4 * d] = 1;
    }
    pliant_status status = pliant_volume_create(&geometry, PLIANT_UINT8, &out->scan);
    if (status < 0) return status;
    out->scan.slope = 1;
    out->scan.background = BLOCK_AIR;
    uint8_t *value = out->scan.voxels;
    int32_t v[3];
    for (v[2] = 0; v[2] < size[2]; v[2]++)
        for (v[1] = 0; v[1] < size[1]; v[1]++)
            for (v[0] = 0; v[0] < size[0]; v[0]++) *value++ = (uint8_t)(paint ? paint : hard_core)(v, size);
    set_material(out->materials + BLOCK_SOFT, "soft", BLOCK_SOFT, 5e3, 1050);
    set_material(out->materials + BLOCK_HARD, "hard", BLOCK_HARD, 5e5, 1050);
    set_material(out->materials + BLOCK_AIR, "air", BLOCK_AIR, 10, 1.2);
    set_material(out->materials + BLOCK_BONE, "bone", BLOCK_BONE, 1e7, 1330);
    out->materials[BLOCK_AIR].empty = true;
    out->materials[BLOCK_BONE].fixed = true;
    out->table.materials = out->materials;
    out->table.num_materials = 4;
    pliant_scene_defaults(&out->scene);
    /* lengths scaled from a patient, so that blocks of different sizes are comparable */
    out->scene.grasp.radius = 0.006;
    out->scene.cut.drag = 0.003;
    out->scene.warp.margin = 0.03;
    for (int d = 0; d < 3; d++) out->scene.mesh.coarse_cells[d] = 3;
    out->scene.mesh.ratio = 2;
    out->scene.solver.threads = 1; /* threads do not pay off for small bodies */
    out->scene.fixed.num_planes = 1;
    out->scene.fixed.planes[0] = (pliant_fixed_plane){{1e-9, 0, 0}, {1, 0, 0}};
    out->input = (pliant_report_input){&out->scene, &out->scan, NULL, &out->table};
    return PLIANT_OK;
}

static const int32_t default_size[3] = {12, 12, 12};
static const double default_box[3] = {0.1, 0.1, 0.1};

pliant_status block_create_default(block_body *out) { return block_create(default_size, default_box, NULL, out); }

void block_free(block_body *body) { pliant_volume_free(&body->scan); }
