#include "sim/build/discretization.h"

#include "base/count.h"
#include "base/fail.h"
#include "base/buffer.h"
#include "base/threads.h"
#include "fem/coarse/lod.h"
#include "fem/dynamics/tled.h"
#include "fem/element/hexahedra.h"
#include "fem/element/pressures.h"
#include "fem/patch/patch.h"
#include "base/memory.h"
#include "mesh/mesh.h"
#include "model_data/discretization.h"

#include <string.h>

static_assert(PLIANT_COUNT_OF(PLIANT_METHOD_LIST) == 5 && PLIANT_COUNT_OF(PLIANT_ELEMENT_LIST) == 3,
              "a new method or element needs its systems in this file");

static void free_discretization(pliant_discretization *made)
{
    pliant_system_free(made->system);
    pliant_system_free(made->fine_system);
    pliant_system_free(made->coarse_system);
    pliant_tled_system_free(made->tled);
    pliant_discretization_release(made->first);
    pliant_body_release(made->body);
    pliant_free(made->holders);
    pliant_free(made);
}

static bool is_coarse(const pliant_scene *scene) { return scene->model.method != PLIANT_FINE; }

pliant_status pliant_discretizing_begin(const pliant_scene *scene, const pliant_body *body, pliant_progress progress,
                                        pliant_discretizing *out)
{
    *out = (pliant_discretizing){.scene = scene, .progress = progress};
    pliant_discretization *made = pliant_calloc(1, sizeof *made);
    if (!made) return pliant_fail_memory("the equations");
    made->holders = pliant_calloc(1, sizeof *made->holders);
    made->system = pliant_calloc(1, sizeof *made->system);
    size_t coarse_nodes = (size_t)body->coarse.num_nodes;
    if (body->coarse_fixed && (out->solved_fixed = pliant_calloc(coarse_nodes, 1)))
        memcpy(out->solved_fixed, body->coarse_fixed, coarse_nodes);
    if (!made->holders || !made->system || (body->coarse_fixed && !out->solved_fixed)) {
        PLIANT_FREE(made->holders, made->system, made, out->solved_fixed);
        out->solved_fixed = NULL;
        return pliant_fail_memory("the equations");
    }
    atomic_init(&made->holders->count, 1);
    made->holders->free = free_discretization;
    made->system->of = made;
    made->body = pliant_body_retain(body);
    made->system->fine = &body->fine;
    made->system->mesh = is_coarse(scene) ? &body->coarse : &body->fine;
    made->system->num_threads = pliant_threads_or_cores(scene->solver.threads);
    out->made = made;
    return PLIANT_OK;
}

void pliant_discretizing_end(pliant_discretizing *work)
{
    pliant_free(work->solved_fixed);
    pliant_discretization_release(work->made);
    memset(work, 0, sizeof *work);
}

/* Fix the corners of homogenized elements that contain fixed fine nodes. Pieces with fewer than three fixed nodes
 * are fixed at rest, as on the fine mesh. */
static pliant_status hold_homogenized(pliant_discretizing *work)
{
    const pliant_mesh *coarse = &work->made->body->coarse;
    const uint8_t *grounded = work->made->system->grounded;
    uint8_t *held = pliant_calloc((size_t)coarse->num_nodes, 1), *stands = pliant_calloc((size_t)coarse->num_nodes, 1);
    uint8_t *loose = pliant_calloc((size_t)coarse->num_tets, 1);
    int32_t pieces = 0;
    pliant_status status = held && stands && loose ? PLIANT_OK : pliant_fail_memory("the fixed nodes");
    if (status == PLIANT_OK) {
        memcpy(stands, work->solved_fixed, (size_t)coarse->num_nodes);
        for (int32_t v = 0; v < 4 * coarse->num_tets; v++)
            if (grounded[v / 4]) stands[coarse->tets[v]] = 1;
        memcpy(held, stands, (size_t)coarse->num_nodes);
        status = pliant_mesh_fix_loose_pieces(coarse, NULL, PLIANT_FIXED_AT_REST, true, held, loose, &pieces);
    }
    for (int32_t n = 0; status == PLIANT_OK && n < coarse->num_nodes; n++)
        if (held[n] && !stands[n]) work->solved_fixed[n] = 1;
    if (status == PLIANT_OK && pieces > 0)
        pliant_log(
            PLIANT_LOG_WARNING,
            "%d pieces of the coarse mesh are attached to fewer than three fixed nodes; they are fixed at their rest "
            "position",
            pieces);
    PLIANT_FREE(held, stands, loose);
    return status;
}

static pliant_status homogenize_tets(pliant_discretizing *work)
{
    const pliant_body *body = work->made->body;
    pliant_system *system = work->made->system;
    pliant_tet_material *none = pliant_calloc((size_t)body->coarse.num_tets, sizeof *none); /* geometry only */
    if (!none) return pliant_fail_memory("the coarse elements");
    pliant_status status = pliant_system_build_tetrahedra(system, none, NULL, NULL);
    pliant_free(none);
    if (status != PLIANT_OK) return status;
    return pliant_homogenize(system, work->scene, &body->fine, body->fine_fixed, body->fine_material,
                             body->coarse_of_fine, work->progress);
}

/* Hexahedra on the leaves of an octree; hanging nodes in the middle of larger leaves depend on the corners. */
static pliant_status homogenize_octree(pliant_discretizing *work, const pliant_tet_material *material,
                                       const pliant_tet_material *complete)
{
    const pliant_body *body = work->made->body;
    const size_t nodes = (size_t)body->fine.num_nodes;
    if (!(work->solved_fixed = pliant_calloc(nodes, 1))) return pliant_fail_memory("the equations");
    memcpy(work->solved_fixed, body->fine_fixed, nodes);
    const pliant_unchanged_elements *kept = work->kept;
    return pliant_system_octree_hexahedra(work->made->system, material, complete,
                                          kept ? kept->before->system : NULL, kept ? kept->fine : NULL,
                                          work->solved_fixed);
}

/* Discretize the coarse mesh without cuts. */
static pliant_status homogenize_coarse(pliant_discretizing *work)
{
    const pliant_scene *scene = work->scene;
    const pliant_body *body = work->made->body;
    pliant_system *system = work->made->system;
    const bool hexahedra = scene->element.kind == PLIANT_HEXAHEDRA;
    pliant_status status;
    if (scene->model.method == PLIANT_COARSE) {
        status = hexahedra ? pliant_system_build_hexahedra(system, body->coarse_material, NULL, NULL, NULL)
                           : pliant_system_build_tetrahedra(system, body->coarse_material, NULL, NULL);
        if (status != PLIANT_OK) return status;
        status = hexahedra ? pliant_upsample_cubes(system, body->coarse_of_fine)
                           : pliant_upsample_linear(system, body->coarse_of_fine);
        return status == PLIANT_OK && hexahedra ? pliant_soften_held_edges(system, body, work->solved_fixed) : status;
    }
    if (scene->model.method == PLIANT_LOD) {
        status =
            pliant_lod_build_upsample(system, hexahedra, body->fine_fixed, work->solved_fixed, body->coarse_of_fine);
        if (status == PLIANT_OK) status = hold_homogenized(work);
        return status == PLIANT_OK ? pliant_lod_build_macros(system, scene, body->fine_fixed, work->solved_fixed,
                                                             body->fine_material, work->progress)
                                   : status;
    }
    status = hexahedra ? pliant_homogenize_cubes(system, scene, &body->fine, body->fine_fixed, work->solved_fixed,
                                                 body->fine_material, body->coarse_of_fine, work->progress)
                       : homogenize_tets(work);
    if (status == PLIANT_OK && hexahedra && scene->model.method != PLIANT_SCHUR)
        status = pliant_soften_held_edges(system, body, work->solved_fixed);
    return status == PLIANT_OK ? hold_homogenized(work) : status;
}

/* Tissue that is separated at load: discretize the coarse mesh of the topology before the separation. Later
 * topologies use it. */
static pliant_status separate_coarse(pliant_discretizing *work)
{
    pliant_discretization *made = work->made;
    const pliant_body *separated = made->body;
    pliant_system *system = pliant_calloc(1, sizeof *system);
    if (!system) return pliant_fail_memory("the equations");
    *system = *made->system;
    made->body = separated->lender ? separated->lender : separated; /* the separated topology retains it */
    made->system->mesh = &made->body->coarse;
    made->system->fine = &made->body->fine;
    pliant_status status = homogenize_coarse(work);
    if (status == PLIANT_OK) status = pliant_system_number_unknowns(made->system, work->solved_fixed);
    made->body = separated;
    made->coarse_system = made->system;
    made->system = system;
    return status;
}

static pliant_status homogenize_cut(pliant_discretizing *work)
{
    pliant_discretization *made = work->made;
    const pliant_discretization *before = work->kept ? work->kept->before : NULL;
    if (work->scene->model.method == PLIANT_LOD)
        return pliant_fail(
            PLIANT_ERROR_SCENE,
            "model/method: lod interpolates within whole cubes of the lattice, which cannot be divided; take "
            "averaged or another one");
    pliant_status status = before ? PLIANT_OK : separate_coarse(work);
    if (before) made->first = pliant_discretization_retain(before->first ? before->first : before);
    if (status != PLIANT_OK) return status;
    const pliant_discretization *load = before ? made->first : made;
    pliant_free(work->solved_fixed);
    work->solved_fixed = NULL;
    return pliant_system_build_graded(made->system, load->coarse_system ? load->coarse_system : load->system,
                                      made->body, work->kept, work->scene->element.kind == PLIANT_HEXAHEDRA,
                                      &work->solved_fixed);
}

/* Build the elements of the fine mesh. Nearly incompressible ones have pressures in addition. */
static pliant_status discretize_fine(pliant_discretizing *work)
{
    const pliant_scene *scene = work->scene;
    const pliant_body *body = work->made->body;
    const pliant_unchanged_elements *kept = work->kept;
    pliant_system *system = work->made->system;
    const pliant_system *before = kept ? kept->before->system : NULL;
    const uint8_t *same = kept ? kept->fine : NULL;
    const bool hexahedra = scene->element.kind == PLIANT_HEXAHEDRA;
    pliant_tet_material *soft;
    pliant_status status = pliant_soft_materials(body->fine_material, body->fine.num_tets, &soft);
    if (status != PLIANT_OK) return status;
    const pliant_tet_material *material = soft ? soft : body->fine_material;
    const pliant_tet_material *complete = soft ? body->fine_material : NULL;
    system->law = scene->element.law;
    if (!hexahedra) status = pliant_system_build_tetrahedra(system, material, before, same);
    else if (scene->mesh.kind == PLIANT_OCTREE) status = homogenize_octree(work, material, complete);
    else status = pliant_system_build_hexahedra(system, material, complete, before, same);
    pliant_free(soft);
    return status;
}

pliant_status pliant_discretizing_homogenize(pliant_discretizing *work)
{
    const pliant_scene *scene = work->scene;
    const pliant_body *body = work->made->body;
    if (scene->solver.kind == PLIANT_TLED)
        return pliant_tled_system_create(scene, body, work->kept ? work->kept->before->tled : NULL, &work->made->tled);
    const pliant_unchanged_elements *kept = work->kept;
    /* cuts that separate no element need no homogenization */
    const bool graded = pliant_body_is_cut(body) || (kept && scene->model.method != PLIANT_LOD);
    if (is_coarse(scene)) return graded ? homogenize_cut(work) : homogenize_coarse(work);
    return discretize_fine(work);
}

/* Set the mass matrix of a solved node to m I, unless node and mass are unchanged since the previous topology. */
static void own_mass(pliant_discretization *made, const pliant_discretization *before, int32_t f)
{
    pliant_system *system = made->system;
    const pliant_system *was = before->system;
    const int32_t n = system->node_of_free[f];
    const double mass = made->body->node_mass[n];
    if (f < was->num_free && was->node_of_free[f] == n && before->body->node_mass[n] == mass) return;
    for (int m = 0; m < 9; m++) system->gravity_mass[9 * (size_t)f + (size_t)m] = m % 4 == 0 ? mass : 0;
    pliant_mark_written(system->gravity_mass, 9 * (size_t)f, 9, sizeof *system->gravity_mass);
}

/* Set the mass matrices of all free nodes. */
static pliant_status own_masses(pliant_discretization *made, const pliant_discretization *before)
{
    pliant_system *system = made->system;
    const pliant_system *was = before->system;
    const int32_t both = was->num_free < system->num_free ? was->num_free : system->num_free;
    system->gravity_mass = pliant_next_version(was->gravity_mass, (size_t)both * 9, (size_t)system->num_free * 9,
                                               sizeof *system->gravity_mass);
    if (!system->gravity_mass) return pliant_fail_memory("the gravity-mass matrices");
    if (!pliant_has_same_numbers(system, was)) {
        for (int32_t f = 0; f < system->num_free; f++) own_mass(made, before, f);
        return PLIANT_OK;
    }
    const size_t nodes = (size_t)was->mesh->num_nodes;
    for (size_t from = 0, to = 0;
         pliant_next_difference(made->body->node_mass, before->body->node_mass, nodes * sizeof(double), &from, &to);)
        for (size_t n = from / sizeof(double); n < to / sizeof(double); n++)
            if (system->free_of_node[n] >= 0) own_mass(made, before, system->free_of_node[n]);
    for (int32_t f = both; f < system->num_free; f++) own_mass(made, before, f);
    return PLIANT_OK;
}

/* Compute the gravity-mass matrices M_j = sum of m_i N_ij over the fine nodes, [H] 10. For hexahedra, m follows
 * from their own shape functions. kept: Nullable */
static pliant_status gravity_mass(pliant_discretization *made, bool hexahedra, const pliant_unchanged_elements *kept)
{
    const pliant_body *body = made->body;
    const pliant_discretization *before = kept ? kept->before : NULL;
    pliant_system *system = made->system;
    if (before && !hexahedra && !system->upsample && !system->macros && system->mesh == system->fine)
        return own_masses(made, before);
    const size_t count = (size_t)body->fine.num_nodes;
    system->gravity_mass = pliant_calloc((size_t)system->num_free, 9 * sizeof *system->gravity_mass);
    pliant_status status = system->gravity_mass ? PLIANT_OK : pliant_fail_memory("the gravity-mass matrices");
    const double *was = before ? before->system->fine_mass : NULL;
    if (status == PLIANT_OK && hexahedra && was) {
        status = pliant_hexahedra_masses_next(&body->fine, body->fine_material, was, before->body->fine.num_nodes,
                                              kept->fine, &system->fine_mass);
    } else if (status == PLIANT_OK && hexahedra) {
        system->fine_mass = pliant_calloc(count, sizeof *system->fine_mass);
        status = system->fine_mass ? pliant_hexahedra_masses(&body->fine, body->fine_material, system->fine_mass)
                                   : pliant_fail_memory("the gravity-mass matrices");
    }
    return status == PLIANT_OK
               ? pliant_upsample_masses(system, hexahedra ? system->fine_mass : body->node_mass, system->gravity_mass)
               : status;
}

/* Return which tetrahedra of the solved mesh are unchanged, including their nodes. NULL: unknown, because
 * homogenized elements have their own nodes. */
static const uint8_t *kept_of_solved(const pliant_discretizing *work)
{
    return work->kept && !is_coarse(work->scene) ? work->kept->fine : NULL;
}

pliant_status pliant_discretizing_analyze(pliant_discretizing *work)
{
    const pliant_scene *scene = work->scene;
    pliant_system *system = work->made->system;
    if (work->made->tled) return PLIANT_OK; /* explicit: no matrix */
    const bool is_cut = pliant_body_is_cut(work->made->body);
    system->divided = is_cut && scene->cut.kind != PLIANT_CUT_SUBDIVIDE;
    system->is_subdivided = is_cut && scene->cut.kind == PLIANT_CUT_SUBDIVIDE;
    const pliant_unchanged_elements *kept = work->kept;
    pliant_status status =
        pliant_system_number_next(system, work->solved_fixed ? work->solved_fixed : work->made->body->fine_fixed,
                                  kept ? kept->before->system : NULL, kept_of_solved(work));
    if (status == PLIANT_OK)
        status = gravity_mass(work->made, scene->element.kind == PLIANT_HEXAHEDRA && scene->mesh.kind == PLIANT_LATTICE,
                              kept);
    if (status == PLIANT_OK && !work->kept) status = pliant_system_find_pattern(system);
    if (status != PLIANT_OK || work->kept) return status;
    /* multigrid needs meshes that nest by lattice, and elements with nodes of their own cube only */
    bool direct = scene->mesh.file[0] || scene->mesh.kind == PLIANT_OCTREE || scene->model.method == PLIANT_LOD;
    return pliant_preconditioner_create(system, direct ? PLIANT_DIRECT : scene->solver.preconditioner, NULL,
                                        &system->preconditioner);
}

pliant_status pliant_discretizing_factorize(pliant_discretizing *work)
{
    pliant_discretization *made = work->made;
    pliant_system *system = made->system;
    if (made->tled) return PLIANT_OK;
    if (work->kept) {
        pliant_status found =
            pliant_system_find_mean_diagonal(system, work->kept->before->system, kept_of_solved(work));
        if (found != PLIANT_OK) return found;
        if (!pliant_patch_is_enabled(work->scene)) return PLIANT_OK;
        const pliant_discretization *before = work->kept->before;
        if (!made->first) made->first = pliant_discretization_retain(before->first ? before->first : before);
        return pliant_patch_next_system(work->scene, made->body, system->num_threads, work->kept, &made->fine_system);
    }
    pliant_tangent *tangents = pliant_calloc((size_t)system->num_blocks, sizeof *tangents);
    if (!tangents) return pliant_fail_memory("the stiffness matrix");
    pliant_system_tangents(system, system->mesh->rest, PLIANT_TWIST_EXACT, tangents);
    pliant_status status = pliant_system_find_mean_diagonal(system, NULL, NULL);
    if (status == PLIANT_OK) status = pliant_preconditioner_numeric(system->preconditioner, tangents);
    if (status == PLIANT_OK) made->condition_estimate = pliant_preconditioner_condition(system->preconditioner);
    pliant_free(tangents);
    if (status == PLIANT_OK && pliant_patch_is_enabled(work->scene))
        status = pliant_patch_system(work->scene, made->body, system->num_threads, &made->fine_system);
    return status;
}

static pliant_status run_stages(pliant_discretizing *work)
{
    static pliant_status (*const stages[])(pliant_discretizing *) = {
        pliant_discretizing_homogenize, pliant_discretizing_analyze, pliant_discretizing_factorize};
    pliant_status status = PLIANT_OK;
    for (size_t stage = 0; status == PLIANT_OK && stage < sizeof stages / sizeof *stages; stage++)
        status = stages[stage](work);
    return status;
}

pliant_status pliant_discretization_create(const pliant_scene *scene, const pliant_body *body,
                                           const pliant_discretization **out)
{
    pliant_discretizing work;
    pliant_status status = pliant_discretizing_begin(scene, body, (pliant_progress){NULL, NULL}, &work);
    if (status == PLIANT_OK) status = run_stages(&work);
    if (status == PLIANT_OK) {
        *out = work.made;
        work.made = NULL;
    }
    pliant_discretizing_end(&work);
    return status;
}

/* ---- discretization after a cut */

static bool same_holds(const uint8_t *a, const uint8_t *b, int32_t count)
{
    if (memcmp(a, b, (size_t)count) == 0) return true;
    for (int32_t n = 0; n < count; n++)
        if (!a[n] != !b[n]) return false;
    return true;
}

/* Return which tetrahedra are unchanged, from the new topology's list of changes. NULL: out of memory. */
static uint8_t *kept_by_list(const pliant_body *was, const pliant_body *body)
{
    uint8_t *kept = pliant_calloc((size_t)body->fine.num_tets, 1);
    if (kept) memset(kept, 1, (size_t)was->fine.num_tets);
    for (int32_t i = 0; kept && i < body->changes.num_touched; i++) kept[body->changes.touched[i]] = 0;
    return kept;
}

/* Return which tetrahedra have the same number, corners and material in both topologies. NULL: out of memory. */
static uint8_t *find_kept(const pliant_body *before, const pliant_body *body, const int32_t *node)
{
    const pliant_mesh *was = &before->fine, *mesh = &body->fine;
    uint8_t *kept = pliant_calloc((size_t)mesh->num_tets, 1);
    for (int32_t t = 0; kept && t < mesh->num_tets && t < was->num_tets; t++) {
        const int32_t *nodes = mesh->tets + 4 * t;
        bool same = memcmp(was->tets + 4 * t, nodes, 4 * sizeof *nodes) == 0 &&
                    memcmp(before->fine_material + t, body->fine_material + t, sizeof *body->fine_material) == 0;
        for (int v = 0; v < 4 && same; v++)
            same = node[nodes[v]] == nodes[v] && !before->fine_fixed[nodes[v]] == !body->fine_fixed[nodes[v]];
        kept[t] = same;
    }
    return kept;
}

pliant_status pliant_discretization_next(const pliant_scene *scene, const pliant_discretization *before,
                                         const pliant_body *body, const pliant_body_map *map,
                                         const pliant_discretization **out)
{
    const pliant_body *was = before->body;
    pliant_unchanged_elements kept = {.before = before};
    pliant_discretizing work;
    pliant_status status = pliant_discretizing_begin(scene, body, (pliant_progress){NULL, NULL}, &work);
    if (status != PLIANT_OK) return status;
    if (body->changes.since == was->revision && same_holds(was->fine_fixed, body->fine_fixed, was->fine.num_nodes))
        kept.fine = kept_by_list(was, body);
    else
        kept.fine = find_kept(was, body, map->node);
    if (!kept.fine) status = pliant_fail_memory("the equations");
    work.kept = &kept;
    if (status == PLIANT_OK) status = run_stages(&work);
    if (status == PLIANT_OK) {
        *out = work.made;
        work.made = NULL;
    }
    pliant_free(kept.fine);
    pliant_discretizing_end(&work);
    return status;
}
