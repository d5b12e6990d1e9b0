#include "sim/discretization.h"

#include "base/fail.h"
#include "base/threads.h"
#include "fem/coarse/lod.h"
#include "fem/dynamics/tled.h"
#include "fem/element/hexahedra.h"
#include "fem/patch/patch.h"
#include "pliant/memory.h"
#include "state/discretization.h"

#include <string.h>

static void free_discretization(pliant_discretization *made)
{
    pliant_system_free(made->system);
    pliant_system_free(made->fine_system);
    pliant_tled_system_free(made->tled);
    pliant_discretization_release(made->first);
    pliant_body_release(made->body);
    pliant_free(made->holders);
    pliant_free(made);
}

static bool is_coarse(const pliant_scene *scene) { return scene->model.method != PLIANT_FINE; }

pliant_status pliant_discretizing_begin(const pliant_scene *scene, const pliant_body *body, pliant_progress progress, pliant_discretizing *out)
{
    *out = (pliant_discretizing){.scene = scene, .progress = progress};
    pliant_discretization *made = pliant_calloc(1, sizeof *made);
    if (!made) return pliant_fail_memory("what is solved");
    made->holders = pliant_calloc(1, sizeof *made->holders);
    made->system = pliant_calloc(1, sizeof *made->system);
    size_t coarse_nodes = (size_t)body->coarse.num_nodes;
    if (body->coarse_fixed && (out->solved_fixed = pliant_calloc(coarse_nodes, 1))) memcpy(out->solved_fixed, body->coarse_fixed, coarse_nodes);
    if (!made->holders || !made->system || (body->coarse_fixed && !out->solved_fixed)) {
        pliant_free(made->holders);
        pliant_free(made->system);
        pliant_free(made);
        pliant_free(out->solved_fixed);
        out->solved_fixed = NULL;
        return pliant_fail_memory("what is solved");
    }
    atomic_init(&made->holders->count, 1);
    made->holders->free = free_discretization;
    made->system->of = made;
    made->body = pliant_body_retain(body);
    made->system->fine = &body->fine;
    made->system->mesh = is_coarse(scene) ? &body->coarse : &body->fine;
    made->system->num_threads = pliant_threads_of(scene->solver.threads);
    out->made = made;
    return PLIANT_OK;
}

void pliant_discretizing_end(pliant_discretizing *work)
{
    pliant_free(work->solved_fixed);
    pliant_discretization_release(work->made);
    memset(work, 0, sizeof *work);
}

static int32_t first_of(const int32_t *one, int32_t node)
{
    while (one[node] != node) node = one[node];
    return node;
}

/* (coarse nodes) the same node for those that ties hold together; false: there are none */
static bool find_tied(const pliant_system *system, int32_t *one)
{
    const pliant_macros *macros = system->macros;
    bool any = false;
    for (int32_t n = 0; n < system->mesh->num_nodes; n++) one[n] = n;
    for (int32_t e = 0; macros && e < macros->count; e++) {
        if (macros->start[e + 1] - macros->start[e] != PLIANT_TIE_CORNERS) continue;
        const int32_t a = first_of(one, macros->node[macros->start[e]]), b = first_of(one, macros->node[macros->start[e] + 1]);
        one[a > b ? a : b] = a > b ? b : a;
        any = true;
    }
    return any;
}

/* pliant_mesh_hold of the coarse mesh, what is tied as one node. */
static pliant_status hold_tied(const pliant_system *system, bool whole, uint8_t *held, uint8_t *loose, int32_t *pieces)
{
    const size_t nodes = (size_t)system->mesh->num_nodes, corners = 4 * (size_t)system->mesh->num_tets;
    pliant_mesh tied = *system->mesh;
    int32_t *one = pliant_calloc(nodes, sizeof *one), *tets = pliant_calloc(corners, sizeof *tets);
    uint8_t *of_all = pliant_calloc(nodes, 1);
    pliant_status status = one && tets && of_all ? PLIANT_OK : pliant_fail_memory("the fixed nodes");
    if (status == PLIANT_OK && !find_tied(system, one)) status = pliant_mesh_hold(system->mesh, PLIANT_FIXED_AT_REST, whole, held, loose, pieces);
    else if (status == PLIANT_OK) {
        for (size_t v = 0; v < corners; v++) tets[v] = first_of(one, tied.tets[v]);
        for (size_t n = 0; n < nodes; n++)
            if (held[n]) of_all[first_of(one, (int32_t)n)] = PLIANT_FIXED_WHERE_IT_WAS;
        tied.tets = tets;
        status = pliant_mesh_hold(&tied, PLIANT_FIXED_AT_REST, whole, of_all, loose, pieces);
        for (size_t n = 0; status == PLIANT_OK && n < nodes; n++)
            if (of_all[first_of(one, (int32_t)n)] == PLIANT_FIXED_AT_REST) held[n] = PLIANT_FIXED_AT_REST;
    }
    pliant_free(one);
    pliant_free(tets);
    pliant_free(of_all);
    return status;
}

/* A homogenized element that holds fixed fine nodes holds its corners. What hangs on fewer than three nodes is held where
 * it is, as on the fine mesh. */
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
        bool whole = work->made->body->changes.since == 0; /* what comes off later stays where it is */
        status = hold_tied(work->made->system, whole, held, loose, &pieces);
    }
    for (int32_t n = 0; status == PLIANT_OK && n < coarse->num_nodes; n++)
        if (held[n] && !stands[n]) work->solved_fixed[n] = 1;
    if (status == PLIANT_OK && pieces > 0)
        pliant_log(PLIANT_LOG_WARNING, "%d pieces of the coarse mesh hang on fewer than three nodes; they are held where they are", pieces);
    pliant_free(held);
    pliant_free(stands);
    pliant_free(loose);
    return status;
}

/* Materials for coarse elements that hold a part of a piece that has come off, and one of what stays: the piece moves on its own, and is not
 * to hold the rest. */
static pliant_status without_pieces(const pliant_body *body, pliant_tet_material **out)
{
    const size_t tets = (size_t)body->fine.num_tets;
    pliant_tet_material *light = *out = pliant_calloc(tets, sizeof *light);
    if (!light) return pliant_fail_memory("the coarse elements");
    memcpy(light, body->fine_material, tets * sizeof *light);
    for (size_t t = 0; t < tets; t++) {
        if (body->fine_fixed[body->fine.tets[4 * t]] != PLIANT_FIXED_WHERE_IT_WAS) continue; /* pieces have their nodes alone */
        light[t].lambda *= PLIANT_LOOSE_STIFFNESS;
        light[t].mu *= PLIANT_LOOSE_STIFFNESS;
    }
    return PLIANT_OK;
}

static pliant_status homogenize_tets(pliant_discretizing *work, const pliant_tet_material *material)
{
    const pliant_body *body = work->made->body;
    const pliant_kept *kept = work->kept;
    pliant_system *system = work->made->system;
    pliant_tet_material *none = pliant_calloc((size_t)body->coarse.num_tets, sizeof *none); /* geometry only */
    if (!none) return pliant_fail_memory("the coarse elements");
    pliant_status status = pliant_system_elements(system, none, kept ? kept->before->system : NULL, kept ? kept->coarse : NULL);
    pliant_free(none);
    if (status != PLIANT_OK) return status;
    return pliant_homogenize(system, work->scene, &body->fine, body->fine_fixed, material, body->coarse_of_fine, kept, work->progress);
}

/* hexahedra on the leaves of an octree; nodes in the middle of larger ones follow */
static pliant_status homogenize_octree(pliant_discretizing *work)
{
    const pliant_body *body = work->made->body;
    const size_t nodes = (size_t)body->fine.num_nodes;
    if (!(work->solved_fixed = pliant_calloc(nodes, 1))) return pliant_fail_memory("what is solved");
    memcpy(work->solved_fixed, body->fine_fixed, nodes);
    const pliant_kept *kept = work->kept;
    return pliant_system_octree_hexahedra(work->made->system, body->fine_material, kept ? kept->before->system : NULL, kept ? kept->fine : NULL, work->solved_fixed);
}

pliant_status pliant_discretizing_homogenize(pliant_discretizing *work)
{
    const pliant_scene *scene = work->scene;
    const pliant_body *body = work->made->body;
    pliant_system *system = work->made->system;
    if (scene->solver.kind == PLIANT_TLED) return pliant_tled_system_create(scene, body, work->kept ? work->kept->before->tled : NULL, &work->made->tled);
    const pliant_kept *kept = work->kept;
    const pliant_system *before = kept ? kept->before->system : NULL;
    if (!is_coarse(scene) && scene->element.kind == PLIANT_HEXAHEDRA && scene->mesh.kind == PLIANT_OCTREE) return homogenize_octree(work);
    if (!is_coarse(scene))
        return scene->element.kind == PLIANT_HEXAHEDRA ? pliant_system_hexahedra(system, body->fine_material, before, kept ? kept->fine : NULL)
                                                       : pliant_system_elements(system, body->fine_material, before, kept ? kept->fine : NULL);
    const bool hexahedra = scene->element.kind == PLIANT_HEXAHEDRA;
    if (scene->model.method == PLIANT_COARSE && hexahedra) {
        pliant_status status = pliant_system_hexahedra(system, body->coarse_material, before, kept ? kept->coarse : NULL);
        if (status == PLIANT_OK) status = pliant_upsample_cubes(system, body->coarse_of_fine);
        return status == PLIANT_OK ? pliant_cubes_tie(system, body) : status;
    }
    if (scene->model.method == PLIANT_COARSE) {
        pliant_status status = pliant_system_elements(system, body->coarse_material, before, kept ? kept->coarse : NULL);
        return status == PLIANT_OK ? pliant_upsample_linear(system, body->coarse_of_fine, kept) : status;
    }
    if (scene->model.method == PLIANT_LOD) {
        if (body->node_parent || body->tet_parent)
            return pliant_fail(PLIANT_ERROR_SCENE, "model/method: lod interpolates within whole cubes of the lattice, which cannot be divided; take "
                                                   "averaged or another one");
        pliant_status status = pliant_lod_ground(system, hexahedra, body->fine_fixed, work->solved_fixed, body->coarse_of_fine);
        if (status == PLIANT_OK) status = hold_homogenized(work);
        if (status != PLIANT_OK) return status;
        return pliant_lod(system, scene, body->fine_fixed, work->solved_fixed, body->fine_material, work->progress);
    }
    pliant_tet_material *light = NULL;
    pliant_status status = body->pieces ? without_pieces(body, &light) : PLIANT_OK;
    const pliant_tet_material *material = light ? light : body->fine_material;
    if (status == PLIANT_OK && hexahedra)
        status = pliant_homogenize_cubes(system, scene, &body->fine, body->fine_fixed, work->solved_fixed, material,
                                         body->coarse_of_fine, kept, work->progress);
    else if (status == PLIANT_OK)
        status = homogenize_tets(work, material);
    pliant_free(light);
    if (status == PLIANT_OK && hexahedra) status = pliant_cubes_tie(system, body);
    return status == PLIANT_OK ? hold_homogenized(work) : status;
}

/* M_j = sum of m_i N_ij over the fine nodes, [H] 10; hexahedra: m by their own shape functions */
static pliant_status gravity_mass(pliant_discretization *made, bool hexahedra)
{
    const pliant_body *body = made->body;
    pliant_system *system = made->system;
    int32_t count = body->fine.num_nodes, *nodes = pliant_calloc((size_t)count, sizeof *nodes);
    system->gravity_mass = pliant_calloc((size_t)system->num_free, 9 * sizeof *system->gravity_mass);
    double *mass = hexahedra ? pliant_calloc((size_t)count, sizeof *mass) : NULL;
    pliant_status status = nodes && system->gravity_mass && (mass || !hexahedra) ? PLIANT_OK : pliant_fail_memory("the gravity-mass matrices");
    if (status == PLIANT_OK && hexahedra) status = pliant_hexahedra_masses(&body->fine, body->fine_material, mass);
    for (int32_t n = 0; status == PLIANT_OK && n < count; n++) nodes[n] = n;
    if (status == PLIANT_OK) pliant_upsample_weights(system, system->mesh->rest, count, nodes, hexahedra ? mass : body->node_mass, system->gravity_mass);
    pliant_free(nodes);
    pliant_free(mass);
    return status;
}

/* tetrahedra of the solved mesh that are kept, with whatever holds them; NULL: unknown, what is homogenized holds nodes of its own */
static const uint8_t *kept_of_solved(const pliant_discretizing *work)
{
    return work->kept && !is_coarse(work->scene) ? work->kept->fine : NULL;
}

pliant_status pliant_discretizing_analyze(pliant_discretizing *work)
{
    const pliant_scene *scene = work->scene;
    pliant_system *system = work->made->system;
    if (work->made->tled) return PLIANT_OK; /* no matrix */
    const pliant_kept *kept = work->kept;
    pliant_status status = pliant_system_number_next(system, work->solved_fixed ? work->solved_fixed : work->made->body->fine_fixed,
                                                     kept ? kept->before->system : NULL, kept_of_solved(work));
    if (status == PLIANT_OK) status = gravity_mass(work->made, scene->element.kind == PLIANT_HEXAHEDRA && scene->mesh.kind == PLIANT_LATTICE);
    if (status == PLIANT_OK && !work->kept) status = pliant_system_find_pattern(system);
    if (status != PLIANT_OK || work->kept) return status;
    /* the V-cycle's meshes nest by lattice, and its elements have nodes of their own cube alone */
    bool direct = scene->mesh.kind == PLIANT_OCTREE || scene->model.method == PLIANT_LOD;
    return pliant_preconditioner_create(system, direct ? PLIANT_DIRECT : scene->solver.preconditioner, NULL, &system->preconditioner);
}

pliant_status pliant_discretizing_factorize(pliant_discretizing *work)
{
    pliant_discretization *made = work->made;
    pliant_system *system = made->system;
    if (made->tled) return PLIANT_OK;
    if (work->kept) {
        pliant_status found = pliant_system_find_mean_diagonal(system, work->kept->before->system, kept_of_solved(work));
        if (found != PLIANT_OK) return found;
        if (!pliant_patch_asked(work->scene)) return PLIANT_OK;
        const pliant_discretization *before = work->kept->before;
        made->first = pliant_discretization_retain(before->first ? before->first : before);
        return pliant_patch_next_system(work->scene, made->body, system->num_threads, work->kept, &made->fine_system);
    }
    pliant_tangent *tangents = pliant_calloc((size_t)system->num_blocks, sizeof *tangents);
    if (!tangents) return pliant_fail_memory("the stiffness matrix");
    pliant_system_tangents(system, system->mesh->rest, PLIANT_TWIST_EXACT, tangents);
    pliant_status status = pliant_system_find_mean_diagonal(system, NULL, NULL);
    if (status == PLIANT_OK) status = pliant_preconditioner_numeric(system->preconditioner, tangents);
    if (status == PLIANT_OK) made->condition_estimate = pliant_preconditioner_condition(system->preconditioner);
    pliant_free(tangents);
    if (status == PLIANT_OK && pliant_patch_asked(work->scene))
        status = pliant_patch_system(work->scene, made->body, system->num_threads, &made->fine_system);
    return status;
}

static pliant_status run_stages(pliant_discretizing *work)
{
    static pliant_status (*const stages[])(pliant_discretizing *) = {pliant_discretizing_homogenize, pliant_discretizing_analyze,
                                                                     pliant_discretizing_factorize};
    pliant_status status = PLIANT_OK;
    for (size_t stage = 0; status == PLIANT_OK && stage < sizeof stages / sizeof *stages; stage++) status = stages[stage](work);
    return status;
}

pliant_status pliant_discretization_create(const pliant_scene *scene, const pliant_body *body, const pliant_discretization **out)
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

/* ---- of the next body */

static bool same_holds(const uint8_t *a, const uint8_t *b, int32_t count)
{
    if (memcmp(a, b, (size_t)count) == 0) return true;
    for (int32_t n = 0; n < count; n++)
        if (!a[n] != !b[n]) return false;
    return true;
}

/* Of the body that comes next: it lists what is not kept. NULL: no memory */
static uint8_t *kept_by_list(const pliant_body *was, const pliant_body *body)
{
    uint8_t *kept = pliant_calloc((size_t)body->fine.num_tets, 1);
    if (kept) memset(kept, 1, (size_t)was->fine.num_tets);
    for (int32_t i = 0; kept && i < body->changes.num_touched; i++) kept[body->changes.touched[i]] = 0;
    return kept;
}

/* Tetrahedra whose number, corners and material are the same as in the body before; material NULL: of any. */
static uint8_t *find_kept(const pliant_mesh *was, const pliant_mesh *mesh, const int32_t *node, const pliant_tet_material *material_was,
                          const pliant_tet_material *material, const uint8_t *fixed_was, const uint8_t *fixed)
{
    uint8_t *kept = pliant_calloc((size_t)mesh->num_tets, 1);
    for (int32_t t = 0; kept && t < mesh->num_tets && t < was->num_tets; t++) {
        const int32_t *nodes = mesh->tets + 4 * t;
        bool same = memcmp(was->tets + 4 * t, nodes, 4 * sizeof *nodes) == 0 &&
                    (!material || memcmp(material_was + t, material + t, sizeof *material) == 0);
        for (int v = 0; v < 4 && same; v++) same = node[nodes[v]] == nodes[v] && !fixed_was[nodes[v]] == !fixed[nodes[v]];
        kept[t] = same;
    }
    return kept;
}

pliant_status pliant_discretization_next(const pliant_scene *scene, const pliant_discretization *before, const pliant_body *body,
                                         const pliant_body_map *map, const pliant_discretization **out)
{
    const pliant_body *was = before->body;
    pliant_kept kept = {.before = before};
    pliant_discretizing work;
    pliant_status status = pliant_discretizing_begin(scene, body, (pliant_progress){NULL, NULL}, &work);
    if (status != PLIANT_OK) return status;
    if (body->changes.since == was->revision && same_holds(was->fine_fixed, body->fine_fixed, was->fine.num_nodes))
        kept.fine = kept_by_list(was, body);
    else
        kept.fine = find_kept(&was->fine, &body->fine, map->node, was->fine_material, body->fine_material, was->fine_fixed, body->fine_fixed);
    if (is_coarse(scene))
        kept.coarse = find_kept(&was->coarse, &body->coarse, map->coarse_node, was->coarse_material, body->coarse_material, was->coarse_fixed, body->coarse_fixed);
    if (!kept.fine || (is_coarse(scene) && !kept.coarse)) status = pliant_fail_memory("what is solved");
    work.kept = &kept;
    if (status == PLIANT_OK) status = run_stages(&work);
    if (status == PLIANT_OK) {
        *out = work.made;
        work.made = NULL;
    }
    pliant_free(kept.fine);
    pliant_free(kept.coarse);
    pliant_discretizing_end(&work);
    return status;
}
