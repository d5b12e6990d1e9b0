/* Stability cases with unusual bodies. */
#include "report/stability_cases.h"
#include "mesh/mesh.h"

#include <stdio.h>

static const int32_t default_size[3] = {12, 12, 12};
static const double default_box[3] = {0.1, 0.1, 0.1};

pliant_status stability_contrast(stability_context *context)
{
    static const double contrasts[] = {1, 1e3, 1e6, 1e9};
    block_body body;
    pliant_status status = block_create_default(&body);
    for (size_t c = 0; status >= 0 && c < sizeof contrasts / sizeof *contrasts; c++) {
        char text[32];
        snprintf(text, sizeof text, "%g", contrasts[c]);
        /* So soft that a billion times stiffer is still in the range of materials, and so light that it supports its
         * weight. */
        body.materials[BLOCK_SOFT].young_modulus = 500;
        body.materials[BLOCK_SOFT].density = body.materials[BLOCK_HARD].density = 100;
        body.materials[BLOCK_HARD].young_modulus = contrasts[c] * body.materials[BLOCK_SOFT].young_modulus;
        status = stability_try(context, text, &body.input, trial_sag_and_pull, NULL);
    }
    block_free(&body);
    return status;
}

pliant_status stability_poisson(stability_context *context)
{
    static const double ratios[] = {0.3, 0.45, 0.49, 0.499, 0.4999};
    block_body body;
    pliant_status status = block_create_default(&body);
    for (size_t r = 0; status >= 0 && r < sizeof ratios / sizeof *ratios; r++) {
        char text[32];
        snprintf(text, sizeof text, "%g", ratios[r]);
        body.materials[BLOCK_SOFT].poisson_ratio = body.materials[BLOCK_HARD].poisson_ratio = ratios[r];
        status = stability_try(context, text, &body.input, trial_sag_and_pull, NULL);
    }
    block_free(&body);
    return status;
}

pliant_status stability_anisotropic(stability_context *context)
{
    static const struct { const char *name; double box[3];
    } boxes[] = {{"20:1 along z", {0.024, 0.024, 0.48}},
                 {"20:1 along x, fixed at its end", {0.48, 0.024, 0.024}},
                 {"1:20 across x", {0.024, 0.48, 0.48}}};
    pliant_status status = PLIANT_OK;
    for (size_t b = 0; status >= 0 && b < sizeof boxes / sizeof *boxes; b++) {
        block_body body;
        status = block_create(default_size, boxes[b].box, NULL, &body);
        if (status >= 0) status = stability_try(context, boxes[b].name, &body.input, trial_sag_and_pull, NULL);
        block_free(&body);
    }
    return status;
}

pliant_status stability_thin(stability_context *context)
{
    static const int32_t size[3] = {24, 24, 1};
    static const double box[3] = {0.12, 0.12, 0.005};
    block_body body;
    pliant_status status = block_create(size, box, NULL, &body);
    if (status < 0) return status;
    status = stability_try(context, "one voxel, six cells", &body.input, trial_sag_and_pull, NULL);
    body.scene.mesh.coarse_cells[2] = 1;
    body.scene.mesh.ratio = 1;
    if (status >= 0) status = stability_try(context, "one voxel, one cell", &body.input, trial_sag_and_pull, NULL);
    block_free(&body);
    return status;
}

static int all_air(const int32_t voxel[3], const int32_t size[3]) { return (void)voxel, (void)size, BLOCK_AIR; }
static int all_bone(const int32_t voxel[3], const int32_t size[3]) { return (void)voxel, (void)size, BLOCK_BONE; }
static int no_material(const int32_t voxel[3], const int32_t size[3]) { return (void)voxel, (void)size, 200; }

pliant_status stability_empty(stability_context *context)
{
    static const struct { const char *name; block_paint paint; bool keep_air, deformable; } scans[] = {
        {"all air", all_air, false, false},
        {"all air, kept", all_air, true, false},
        {"all bone", all_bone, false, false},
        {"all bone, deformable", all_bone, false, true},
        {"a value without material", no_material, false, false}};
    pliant_status status = PLIANT_OK;
    for (size_t s = 0; status >= 0 && s < sizeof scans / sizeof *scans; s++) {
        block_body body;
        status = block_create(default_size, default_box, scans[s].paint, &body);
        body.scene.mesh.keep_air = scans[s].keep_air;
        body.scene.material.deformable_bone = scans[s].deformable;
        if (status >= 0) status = stability_try(context, scans[s].name, &body.input, trial_sag_and_pull, NULL);
        block_free(&body);
    }
    return status;
}

/* voxels of one corner tetrahedron of a single cell */
static int one_corner(const int32_t voxel[3], const int32_t size[3])
{
    double local[3];
    for (int d = 0; d < 3; d++) local[d] = (voxel[d] + 0.5) / size[d];
    return pliant_mesh_slot_of(0, local) == 1 ? BLOCK_SOFT : BLOCK_AIR;
}

pliant_status stability_single_tetrahedron(stability_context *context)
{
    static const int32_t size[3] = {16, 16, 16};
    block_body body;
    pliant_status status = block_create(size, default_box, one_corner, &body);
    if (status < 0) return status;
    for (int d = 0; d < 3; d++) body.scene.mesh.coarse_cells[d] = 1;
    body.scene.mesh.ratio = 1;
    /* its corner and two adjacent corners lie in one face of the cell across z */
    int corners[4], up = 0;
    pliant_mesh_slot_corners(0, 1, corners);
    for (int v = 0; v < 4; v++) up += corners[v] >> 2 & 1;
    body.scene.fixed.planes[0] =
        (pliant_fixed_plane){{0, 0, up > 1 ? default_box[2] - 1e-9 : 1e-9}, {0, 0, up > 1 ? -1 : 1}};
    status = stability_try(context, "one face fixed", &body.input, trial_sag_and_pull, NULL);
    body.scene.fixed.num_planes = 0;
    if (status >= 0) status = stability_try(context, "nothing fixed", &body.input, trial_sag_and_pull, NULL);
    block_free(&body);
    return status;
}

/* two slabs with air in between; the second one is not fixed */
static int two_slabs(const int32_t voxel[3], const int32_t size[3])
{
    int32_t sixth = 6 * voxel[0] / size[0];
    return sixth < 2 || sixth > 3 ? BLOCK_SOFT : BLOCK_AIR;
}

/* two bars that share only an edge of the lattice; the second one can rotate about it */
static int two_bars(const int32_t voxel[3], const int32_t size[3])
{
    bool far_x = 2 * voxel[0] >= size[0], far_y = 2 * voxel[1] >= size[1];
    return far_x == far_y ? BLOCK_SOFT : BLOCK_AIR;
}

pliant_status stability_pieces(stability_context *context)
{
    block_body body;
    pliant_status status = block_create(default_size, default_box, two_slabs, &body);
    if (status >= 0) status = stability_try(context, "one of two floats", &body.input, trial_sag_and_pull, NULL);
    body.scene.fixed.num_planes = 0;
    if (status >= 0) status = stability_try(context, "nothing fixed", &body.input, trial_sag_and_pull, NULL);
    block_free(&body);
    if (status < 0) return status;
    status = block_create(default_size, default_box, two_bars, &body);
    if (status >= 0) status = stability_try(context, "joined by an edge", &body.input, trial_sag_and_pull, NULL);
    body.scene.fixed.boxes[0] = (pliant_fixed_box){{-1, -1, -1}, {1e-9, 1e-9, 1e-9}};
    body.scene.fixed.num_planes = 0;
    body.scene.fixed.num_boxes = 1;
    if (status >= 0) status = stability_try(context, "one node fixed", &body.input, trial_sag_and_pull, NULL);
    block_free(&body);
    return status;
}
