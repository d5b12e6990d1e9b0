/* Build the constant model from a scan and a scene, stage by stage. */
#include "base/fail.h"
#include "base/clock.h"
#include "base/buffer.h"
#include "base/threads.h"
#include "fem/dynamics/tled.h"
#include "fem/system.h"
#include "material/material.h"
#include "material/names.h"
#include "base/memory.h"
#include "mesh/mesh.h"
#include "scene/scene.h"
#include "sim/build/discretization.h"
#include "sim/build/build_stages.h"
#include "scene/elements.h"
#include "scene/options.h"
#include "sim/build/model.h"
#include "warp/hide_materials.h"

#include <string.h>

static const double max_cells = 4e7; /* of the fine lattice: node numbers fit into 32 bits */

const char *pliant_build_stage_name(int stage)
{
    static const char *const names[] = {
#define STAGE_NAME(name) #name,
        PLIANT_BUILD_STAGE_LIST(STAGE_NAME)
#undef STAGE_NAME
    };
    return stage >= 0 && stage < PLIANT_NUM_BUILD_STAGES ? names[stage] : "";
}

/* Data that only the building needs. */
typedef struct builder {
    pliant_model *model;
    const pliant_labels *labels;
    pliant_progress progress;
    pliant_tet_material *lattice_material; /* (5 * fine cells) */
    uint8_t *loose;                        /* (fine.num_tets) */
    pliant_discretizing discretizing;
} builder;

/* Return whether elements are condensed on the corners of every coarse tetrahedron, so that all corners must exist. */
static bool needs_corners(const pliant_model *model)
{
    return model->scene.model.method == PLIANT_SCHUR;
}

static bool is_coarse(const pliant_model *model) { return model->scene.model.method != PLIANT_FINE; }

static pliant_status hide_empty(pliant_model *model)
{
    bool empty[256] = {false};
    for (uint32_t m = 0; m < model->materials.num_materials; m++) empty[m] = model->materials.materials[m].empty;
    model->drawn = &model->visible_scan;
    return pliant_volume_hide(model->scan, model->material_of_voxel, empty, &model->visible_scan);
}

static pliant_status classify(builder *build)
{
    pliant_model *model = build->model;
    model->material_of_voxel = pliant_calloc(pliant_geometry_voxels(&model->scan->geometry), 1);
    if (!model->material_of_voxel) return pliant_fail_memory("the material of every voxel");
    pliant_status status =
        pliant_material_classify(&model->materials, model->scan, build->labels, model->material_of_voxel);
    if (status == PLIANT_OK)
        status = pliant_material_log_usage(&model->materials, model->scan, build->labels, model->material_of_voxel);
    return status == PLIANT_OK && model->scene.warp.hide_empty ? hide_empty(model) : status;
}

/* Keep fine tetrahedra with tissue. The paper's condensation needs every corner of a coarse tetrahedron in its
 * submesh. It therefore keeps all fine tetrahedra in a coarse tetrahedron with tissue. */
static pliant_status cut_at_load(builder *build)
{
    pliant_model *model = build->model;
    pliant_body *body = model->body;
    const pliant_geometry *geometry = &model->scan->geometry;
    const int32_t *coarse_cells = model->scene.mesh.coarse_cells;
    int32_t ratio = model->scene.mesh.ratio,
            cells[3] = {coarse_cells[0] * ratio, coarse_cells[1] * ratio, coarse_cells[2] * ratio};
    if (model->scene.mesh.file[0]) return pliant_external_mesh(model);
    if (model->scene.mesh.kind == PLIANT_OCTREE) {
        return pliant_mesh_octree(geometry, coarse_cells, model->scene.mesh.depth, model->scene.mesh.purity,
                                  model->scene.mesh.keep_air, model->scene.element.kind == PLIANT_HEXAHEDRA,
                                  model->material_of_voxel, &model->materials, &body->fine, &body->fine_material);
    }
    if ((double)cells[0] * cells[1] * cells[2] > max_cells)
        return pliant_fail(PLIANT_ERROR_SCENE,
                           "mesh/coarse_cells times mesh/ratio make %d x %d x %d fine cells: at most 4e7", cells[0],
                           cells[1], cells[2]);
    size_t fine_count = 5 * (size_t)cells[0] * cells[1] * cells[2],
           coarse_count = fine_count / ((size_t)ratio * ratio * ratio);
    uint8_t *keep = pliant_calloc(fine_count, 1), *keep_coarse = pliant_calloc(coarse_count, 1);
    build->lattice_material = pliant_calloc(fine_count, sizeof *build->lattice_material);
    pliant_status status = PLIANT_OK;
    if (!keep || !keep_coarse || !build->lattice_material) {
        status = pliant_fail_memory("the lattice");
        goto done;
    }
    status =
        pliant_lattice_integrate(geometry, cells, model->material_of_voxel, &model->materials, build->lattice_material);
    if (status != PLIANT_OK) goto done;
    for (size_t t = 0; t < fine_count; t++) {
        keep[t] = model->scene.mesh.keep_air || build->lattice_material[t].tissue > 0;
        if (keep[t]) keep_coarse[pliant_lattice_coarse_of(coarse_cells, ratio, (int32_t)t)] = 1;
    }
    /* a cube with tissue is kept as a whole */
    for (size_t t = 0; model->scene.element.kind == PLIANT_HEXAHEDRA && t < fine_count; t += 5) {
        uint8_t any = keep[t] | keep[t + 1] | keep[t + 2] | keep[t + 3] | keep[t + 4];
        memset(keep + t, any, 5);
    }
    /* a coarse cube too */
    for (size_t c = 0; model->scene.element.kind == PLIANT_HEXAHEDRA && c < coarse_count; c += 5) {
        uint8_t any =
            keep_coarse[c] | keep_coarse[c + 1] | keep_coarse[c + 2] | keep_coarse[c + 3] | keep_coarse[c + 4];
        memset(keep_coarse + c, any, 5);
    }
    if (needs_corners(model))
        for (size_t t = 0; t < fine_count; t++)
            keep[t] = keep_coarse[pliant_lattice_coarse_of(coarse_cells, ratio, (int32_t)t)];
    status = pliant_mesh_grid(geometry, cells, keep, &body->fine);
    if (status == PLIANT_OK && is_coarse(model))
        status = pliant_mesh_grid(geometry, coarse_cells, keep_coarse, &body->coarse);
done:
    pliant_free(keep);
    pliant_free(keep_coarse);
    return status;
}

static pliant_status mesh(builder *build)
{
    pliant_model *model = build->model;
    pliant_body *body = model->body;
    pliant_status status = cut_at_load(build);
    if (status == PLIANT_OK && model->scene.mesh.bone_surface) status = pliant_fixed_surface(model);
    if (status == PLIANT_OK) pliant_model_set_lengths(model);
    return status == PLIANT_OK
               ? pliant_mesh_surface(&body->fine, NULL, NULL, &body->triangles, &body->num_triangles)
               : status;
}

/* Compute materials of the kept tetrahedra and nodal masses ([H] 2.1: a fourth of the mass to each node). */
static pliant_status integrate(builder *build)
{
    pliant_model *model = build->model;
    pliant_body *body = model->body;
    const pliant_mesh *fine = &body->fine;
    const bool file = model->scene.mesh.file[0];
    bool octree = file || model->scene.mesh.kind == PLIANT_OCTREE; /* leaves of an octree have materials already */
    if (!octree) body->fine_material = pliant_calloc((size_t)fine->num_tets, sizeof *body->fine_material);
    body->node_mass = pliant_calloc((size_t)fine->num_nodes, sizeof *body->node_mass);
    if (!body->fine_material || !body->node_mass) return pliant_fail_memory("the materials of the mesh");
    for (int32_t t = 0; !octree && t < fine->num_tets; t++)
        body->fine_material[t] = build->lattice_material[fine->lattice_of_tet[t]];
    if (fine->num_moved > 0 && !file) {
        pliant_status status =
            pliant_mesh_integrate_moved(fine, &model->scan->geometry, model->material_of_voxel,
                                        !model->scene.material.deformable_bone, &model->materials, body->fine_material);
        if (status != PLIANT_OK) return status;
    }
    pliant_body_masses(body, body->node_mass);
    if (!is_coarse(model)) return PLIANT_OK;
    const pliant_mesh *coarse = &body->coarse;
    body->coarse_of_fine = pliant_calloc((size_t)fine->num_tets, sizeof *body->coarse_of_fine);
    if (!body->coarse_of_fine) return pliant_fail_memory("the nesting of the meshes");
    for (int32_t t = 0; t < fine->num_tets; t++)
        body->coarse_of_fine[t] = coarse->tet_of_lattice[pliant_lattice_coarse_of(
            coarse->cells, model->scene.mesh.ratio, fine->lattice_of_tet[t])];
    if (model->scene.model.method != PLIANT_COARSE) return PLIANT_OK;
    size_t lattice = 5 * (size_t)coarse->cells[0] * coarse->cells[1] * coarse->cells[2];
    pliant_tet_material *all = pliant_calloc(lattice, sizeof *all);
    body->coarse_material = pliant_calloc((size_t)coarse->num_tets, sizeof *body->coarse_material);
    pliant_status status =
        all && body->coarse_material ? PLIANT_OK : pliant_fail_memory("the materials of the coarse mesh");
    if (status == PLIANT_OK)
        status = pliant_lattice_integrate(&model->scan->geometry, coarse->cells, model->material_of_voxel,
                                          &model->materials, all);
    for (int32_t t = 0; status == PLIANT_OK && t < coarse->num_tets; t++)
        body->coarse_material[t] = all[coarse->lattice_of_tet[t]];
    pliant_free(all);
    return status;
}

/* Fix nodes of the coarse mesh for standard FEM. If too few coarse nodes lie in fixed material, use the nodes
 * nearest to fixed fine nodes. */
static pliant_status hold_coarse(builder *build)
{
    const pliant_model *model = build->model;
    pliant_body *body = model->body;
    const pliant_mesh *fine = &body->fine, *coarse = &body->coarse;
    uint8_t *loose = pliant_calloc((size_t)coarse->num_tets, 1);
    int32_t pieces = 0, ratio = model->scene.mesh.ratio;
    if (!loose) return pliant_fail_memory("the fixed nodes");
    pliant_fail_quietly(true); /* the error is handled below */
    pliant_status status =
        pliant_mesh_fix_loose_pieces(coarse, NULL, PLIANT_FIXED_AT_REST, true, body->coarse_fixed, loose, &pieces);
    pliant_fail_quietly(false);
    if (status == PLIANT_ERROR_SCENE) {
        for (int32_t n = 0; n < fine->num_nodes; n++) {
            if (!body->fine_fixed[n]) continue;
            int32_t at = fine->lattice_of_node[n], nx = fine->cells[0] + 1, ny = fine->cells[1] + 1;
            int32_t i = (at % nx + ratio / 2) / ratio, j = (at / nx % ny + ratio / 2) / ratio,
                    k = (at / nx / ny + ratio / 2) / ratio;
            int32_t node = coarse->node_of_lattice[i + (coarse->cells[0] + 1) * (j + (coarse->cells[1] + 1) * k)];
            if (node >= 0) body->coarse_fixed[node] = 1;
        }
        pliant_log(PLIANT_LOG_WARNING,
                   "coarse: fewer than three coarse nodes lie in fixed tissue; the nearest nodes are fixed instead");
        status =
            pliant_mesh_fix_loose_pieces(coarse, NULL, PLIANT_FIXED_AT_REST, true, body->coarse_fixed, loose, &pieces);
    }
    pliant_free(loose);
    return status;
}

/* Fix the coarse nodes that are fixed fine nodes, including those of loose pieces. Homogenized elements handle
 * fixed nodes inside them (discretization.c); other elements do not. */
static pliant_status fix_coarse(builder *build)
{
    const pliant_model *model = build->model;
    pliant_body *body = model->body;
    const pliant_mesh *fine = &body->fine, *coarse = &body->coarse;
    body->coarse_fixed = pliant_calloc((size_t)coarse->num_nodes, 1);
    body->fine_of_coarse = pliant_calloc((size_t)coarse->num_nodes, sizeof *body->fine_of_coarse);
    if (!body->coarse_fixed || !body->fine_of_coarse) return pliant_fail_memory("the fixed nodes");
    for (int32_t n = 0; n < coarse->num_nodes; n++) {
        int32_t node = body->fine_of_coarse[n] = pliant_mesh_node_in(fine, coarse, n);
        body->coarse_fixed[n] = node >= 0 && body->fine_fixed[node];
    }
    return model->scene.model.method == PLIANT_COARSE ? hold_coarse(build) : PLIANT_OK;
}

/* Release a loose piece, found by its faces, from being fixed. stack: (tetrahedra) buffer */
static void release(builder *build, const uint8_t *fixed_before, const int32_t *neighbours, int32_t tet, int32_t *stack)
{
    pliant_body *body = build->model->body;
    int32_t count = 1;
    stack[0] = tet;
    build->loose[tet] = 0;
    while (count > 0) {
        const int32_t t = stack[--count];
        for (int v = 0; v < 4; v++) {
            const int32_t node = body->fine.tets[4 * t + v], other = neighbours[4 * t + v];
            body->fine_fixed[node] = fixed_before[node];
            if (other < 0 || !build->loose[other]) continue;
            build->loose[other] = 0;
            stack[count++] = other;
        }
    }
    body->num_held_pieces--;
}

/* Explicit dynamics: release pieces that are attached to the rest by a node or an edge, because inertia determines
 * their motion. Fixed at rest, the moving rest would invert them.
 * @param fixed_before (nodes) before pliant_mesh_fix_loose_pieces */
static pliant_status release_hanging(builder *build, const uint8_t *fixed_before)
{
    pliant_body *body = build->model->body;
    const size_t tets = (size_t)body->fine.num_tets;
    if (body->num_held_pieces == 0) return PLIANT_OK;
    int32_t *neighbours = pliant_calloc(tets, 4 * sizeof *neighbours), *stack = pliant_calloc(tets, sizeof *stack);
    pliant_status status =
        neighbours && stack ? pliant_mesh_neighbours(&body->fine, neighbours) : pliant_fail_memory("the fixed nodes");
    for (bool changed = status == PLIANT_OK; changed;) {
        changed = false;
        for (int32_t v = 0; v < 4 * body->fine.num_tets; v++) {
            if (!build->loose[v / 4] || body->fine_fixed[body->fine.tets[v]]) continue;
            release(build, fixed_before, neighbours, v / 4, stack);
            changed = true;
        }
    }
    pliant_free(neighbours);
    pliant_free(stack);
    return status;
}

static pliant_status fix(builder *build)
{
    pliant_model *model = build->model;
    pliant_body *body = model->body;
    const pliant_mesh *fine = &body->fine;
    body->fine_fixed = pliant_calloc((size_t)fine->num_nodes, 1);
    build->loose = pliant_calloc((size_t)fine->num_tets, 1);
    if (!body->fine_fixed || !build->loose) return pliant_fail_memory("the fixed nodes");
    for (int32_t n = 0; n < fine->num_nodes; n++) body->fine_fixed[n] = pliant_fixed_node(model, n);
    const int holds_none = pliant_fixed_planes_log(model);
    body->has_inertia = model->scene.solver.kind == PLIANT_TLED && !model->scene.tled.quasi_static;
    pliant_wall walls[PLIANT_MAX_WALLS];
    /* a wall ends the fall */
    body->falls = model->scene.solver.kind == PLIANT_TLED && pliant_tled_walls(&model->scene, walls) > 0;
    if (body->falls) return PLIANT_OK;
    uint8_t *fixed_before = pliant_copy_block(body->fine_fixed, (size_t)fine->num_nodes, 1);
    if (!fixed_before) return pliant_fail_memory("the fixed nodes");
    pliant_status status = pliant_mesh_fix_loose_pieces(fine, NULL, PLIANT_FIXED_AT_REST, true, body->fine_fixed,
                                                        build->loose, &body->num_held_pieces);
    if (status == PLIANT_OK && body->has_inertia) status = release_hanging(build, fixed_before);
    pliant_free(fixed_before);
    if (status == PLIANT_ERROR_SCENE && holds_none > 0)
        return pliant_fail(
            status, "fixed/planes: number %d holds no node, it lies in front of them all or between two layers; and %s",
            holds_none, pliant_last_error());
    if (status != PLIANT_OK) return status;
    if (body->num_held_pieces > 0) {
        int32_t count = 0;
        for (int32_t t = 0; t < fine->num_tets; t++) {
            count += build->loose[t];
            if (!build->loose[t]) continue;
            body->fine_material[t].lambda *= PLIANT_LOOSE_STIFFNESS;
            body->fine_material[t].mu *= PLIANT_LOOSE_STIFFNESS;
        }
        pliant_log(
            PLIANT_LOG_WARNING,
            "%d pieces (%d of %d tetrahedra) are not attached to fixed nodes; they are fixed at their rest position",
            body->num_held_pieces, count, fine->num_tets);
    }
    return is_coarse(model) ? fix_coarse(build) : PLIANT_OK;
}

/* Find the links between voxels that blades may cut. */
static pliant_status link_voxels(builder *build)
{
    pliant_model *model = build->model;
    if (model->scene.cut.kind == PLIANT_CUT_SUBDIVIDE)
        return pliant_subdivision_create(&model->body->fine, model->scene.contact.self, &model->scan->geometry,
                                         &model->materials, &model->body->subdivision);
    if (model->scene.cut.kind != PLIANT_CUT_SEVER) return PLIANT_OK;
    pliant_status status = pliant_voxels_create(model->body, &model->scan->geometry, model->material_of_voxel,
                                                &model->materials, &model->body->voxels);
    return status == PLIANT_OK ? pliant_model_part_slides(model) : status;
}

/* Report the stage's progress as a fraction of all stages. */
static bool homogenized(double fraction, const char *stage, void *user)
{
    const builder *build = user;
    return pliant_report_progress(build->progress, (PLIANT_BUILD_homogenize + fraction) / PLIANT_NUM_BUILD_STAGES,
                                  stage);
}

static pliant_status homogenize(builder *build)
{
    const pliant_progress progress = {homogenized, build};
    pliant_status status =
        pliant_discretizing_begin(&build->model->scene, build->model->body, progress, &build->discretizing);
    return status == PLIANT_OK ? pliant_discretizing_homogenize(&build->discretizing) : status;
}
static pliant_status analyze(builder *build) { return pliant_discretizing_analyze(&build->discretizing); }
static pliant_status factorize(builder *build) { return pliant_discretizing_factorize(&build->discretizing); }

/* Return the size of the factor, which the memory account does not include [bytes]. */
static size_t factor_bytes(const builder *build)
{
    const pliant_discretization *made = build->discretizing.made;
    return made && made->system ? pliant_preconditioner_bytes(made->system->preconditioner) : 0;
}

static void transfer_ownership(builder *build)
{
    pliant_model *model = build->model;
    const pliant_discretization *made = model->discretization = build->discretizing.made;
    build->discretizing.made = NULL;
    model->system = made->system;
    model->fine_system = made->fine_system;
    model->tled = made->tled;
    model->condition_estimate = made->condition_estimate;
}

static pliant_status run_stages(builder *build)
{
    static pliant_status (*const stages[])(builder *) = {classify,    mesh,       integrate, fix,
                                                         link_voxels, homogenize, analyze,   factorize};
    _Static_assert(sizeof stages / sizeof *stages == PLIANT_NUM_BUILD_STAGES, "one function a stage, in order");
    pliant_model *model = build->model;
    for (int stage = 0; stage < PLIANT_NUM_BUILD_STAGES; stage++) {
        if (!pliant_report_progress(build->progress, (double)stage / PLIANT_NUM_BUILD_STAGES,
                                    pliant_build_stage_name(stage)))
            return pliant_fail(PLIANT_ERROR_CANCELLED, "building the model was cancelled");
        double start = pliant_seconds();
        size_t before = pliant_memory_in_use() + factor_bytes(build);
        pliant_status status = stages[stage](build);
        if (status != PLIANT_OK) return status;
        size_t after = pliant_memory_in_use() + factor_bytes(build);
        model->build_seconds[stage] = pliant_seconds() - start;
        model->build_bytes[stage] = after > before ? after - before : 0;
    }
    transfer_ownership(build);
    pliant_report_progress(build->progress, 1, "ready");
    return PLIANT_OK;
}

void pliant_gravity_warning(const pliant_scene *scene, const double gravity[3])
{
#define METHOD_NAME(name, yaml) #yaml,
    static const char *const methods[] = {PLIANT_METHOD_LIST(METHOD_NAME)};
#undef METHOD_NAME
    const pliant_method method = scene->model.method;
    if (method == PLIANT_FINE || (gravity[0] == 0 && gravity[1] == 0 && gravity[2] == 0)) return;
    if (method == PLIANT_SCHUR)
        pliant_log(
            PLIANT_LOG_WARNING,
            "model/method: schur is far too soft for model/gravity. Tissue sags 10 to 15 times more than on the fine "
            "mesh, elements invert, and steps do not converge; use averaged");
    else
        pliant_log(
            PLIANT_LOG_WARNING,
            "model/method: under model/gravity, the displacement of %s has an error of tens of percent, "
            "and %s; fine has no such error",
            methods[method],
            scene->model.patch > 0 ? "model/patch corrects it only near a grasp" : "nothing corrects it");
}

/* Warn about options that the scene's solver ignores. */
static void warn_of_unused(const pliant_scene *scene)
{
    char names[512];
    if (scene->solver.kind == PLIANT_TLED) return;
    if (pliant_scene_changed(scene, (const char *const[]){"tled", NULL}, names, sizeof names))
        pliant_log(PLIANT_LOG_WARNING, "%s: used only by solver/kind: tled; the corotational solver ignores them",
                   names);
    if (scene->cut.kind == PLIANT_CUT_NONE &&
        pliant_scene_changed(scene, (const char *const[]){"ground", NULL}, names, sizeof names))
        pliant_log(
            PLIANT_LOG_WARNING,
            "%s: with solver/kind: corotational, only detached pieces touch the ground, and cut/kind: none detaches "
            "no piece; use obstacles",
            names);
}

/* Resolve element/kind: auto. */
static void choose_elements(pliant_scene *scene)
{
    const char *why;
    const pliant_element_kind kind = pliant_scene_element_kind(scene, &why);
    if (why) pliant_log(PLIANT_LOG_INFO, "element/kind: auto is linear here; %s", why);
    else if (scene->element.kind == PLIANT_ELEMENT_AUTO)
        pliant_log(PLIANT_LOG_INFO, "element/kind: auto is hexahedra here");
    scene->element.kind = kind;
}

/* Refuse options that conflict. */
static pliant_status check(const pliant_scene *scene, const pliant_material_table *materials)
{
    const bool is_fine = scene->model.method == PLIANT_FINE, is_lod = scene->model.method == PLIANT_LOD,
               is_tled = scene->solver.kind == PLIANT_TLED, is_octree = scene->mesh.kind == PLIANT_OCTREE,
               has_cycle = scene->solver.preconditioner == PLIANT_MULTIGRID,
               is_neo_hookean = scene->element.law == PLIANT_ELASTICITY_NEO_HOOKEAN,
               subdivides = scene->cut.kind == PLIANT_CUT_SUBDIVIDE;
    const struct { bool applies; const char *text;
    } conflicts[] = {
        {is_tled && !is_fine, "solver/kind: tled works on the fine mesh; set model/method to fine"},
        {is_octree && (!is_fine || has_cycle),
         "mesh/kind: an octree has no coarse mesh: set model/method to fine and solver/preconditioner to auto or "
         "direct"},
        {is_lod && has_cycle, "solver/preconditioner: lod's matrix is factored; set auto or direct"},
        {is_lod && scene->mesh.bone_surface,
         "mesh/bone_surface: lod interpolates within the cubes of the lattice, which no node may leave; set it to "
         "false, or model/method to another one"},
        {is_lod && scene->cut.kind != PLIANT_CUT_NONE,
         "cut/kind: lod interpolates within whole cubes of the lattice, which cannot be divided; set model/method to "
         "averaged or another one, or cut/kind to none"},
        {scene->material.slides[0] && scene->cut.kind != PLIANT_CUT_SEVER,
         "material/slides separates voxels of the scan: set cut/kind to sever"},
        {is_neo_hookean && is_tled,
         "element/law: neo_hookean conflicts with solver/kind: tled, whose law is tled/law; set corotational, or "
         "element/law to corotational"},
        {is_neo_hookean && !is_fine,
         "element/law: neo_hookean conflicts with model/method: homogenized elements are linear; set fine, or "
         "element/law to corotational"},
        {subdivides && !is_fine,
         "cut/kind: subdivide conflicts with model/method: coarse elements hold whole tetrahedra; set fine, or "
         "cut/kind to sever"},
        {subdivides && scene->mesh.kind != PLIANT_LATTICE,
         "cut/kind: subdivide conflicts with mesh/kind: octree; set lattice, or cut/kind to sever"},
    };
    pliant_status status = pliant_scene_check(scene);
    for (size_t c = 0; status == PLIANT_OK && c < sizeof conflicts / sizeof *conflicts; c++)
        if (conflicts[c].applies) status = pliant_fail(PLIANT_ERROR_SCENE, "%s", conflicts[c].text);
    if (status == PLIANT_OK) status = pliant_external_check(scene);
    if (status == PLIANT_OK) status = pliant_scene_check_elements(scene);
    if (status == PLIANT_OK) status = pliant_material_table_check(materials);
    return status == PLIANT_OK ? pliant_material_table_check_scene(materials, scene, "material table") : status;
}

pliant_status pliant_model_build(const pliant_scene *scene, const pliant_volume *scan, const pliant_labels *labels,
                                 const pliant_material_table *materials, pliant_progress progress, pliant_model **out)
{
    pliant_status status = check(scene, materials);
    if (status != PLIANT_OK) return status;
    pliant_gravity_warning(scene, scene->model.gravity);
    warn_of_unused(scene);
    pliant_model *model = pliant_calloc(1, sizeof *model);
    if (!model) return pliant_fail_memory("the model");
    builder build = {.model = model, .labels = labels, .progress = progress};
    model->scene = *scene;
    model->contact = pliant_contact_settings_of(scene);
    choose_elements(&model->scene);
    model->scan = model->drawn = scan;
    status = pliant_body_create(1, &model->body);
    if (status == PLIANT_OK && scene->contact.obstacles[0])
        status = pliant_tool_shape_read(scene->contact.obstacles, &model->obstacles);
    if (status == PLIANT_OK) status = pliant_material_table_copy(materials, &model->materials);
    int threads = pliant_threads_begin(scene->solver.threads);
    if (status == PLIANT_OK) status = run_stages(&build);
    pliant_threads_end(threads);
    pliant_free(build.lattice_material);
    pliant_free(build.loose);
    pliant_discretizing_end(&build.discretizing);
    if (status != PLIANT_OK) {
        pliant_model_free(model);
        return status;
    }
    *out = model;
    return PLIANT_OK;
}

void pliant_model_free(pliant_model *model)
{
    if (!model) return;
    pliant_discretization_release(model->discretization);
    pliant_material_table_free(&model->materials);
    pliant_tool_shape_free(&model->obstacles);
    pliant_free(model->material_of_voxel);
    pliant_volume_free(&model->visible_scan);
    pliant_body_release(model->body);
    pliant_free(model);
}
