/* Transfers a solver across a cut. */
#include "base/fail.h"
#include "base/buffer.h"
#include "fem/element/hexahedra.h"
#include "fem/quasistatic/pressure.h"
#include "base/memory.h"

#include <string.h>

static void carry_limits(pliant_solver *solver, const pliant_solver *from)
{
    solver->rules.max_evaluations = from->rules.max_evaluations;
    solver->rules.tolerance = from->rules.tolerance;
    solver->rules.log_contraction = from->rules.log_contraction;
    solver->refresh_delay = from->refresh_delay;
    solver->convert_delay = from->convert_delay;
    solver->evaluation_seconds = from->evaluation_seconds;
    solver->evaluation_history = from->evaluation_history;
}

/* Scale V mu F0 of an element at the preconditioner's state to its present stiffness. */
static float rescale_reference(float before, double was, double now)
{
    return now == was ? before : was > 0 ? (float)(now / was * before) : 0;
}

static void carry_tets_before(const pliant_system *system, const pliant_solver *from, const int32_t *tet,
                              pliant_nodal_rotations *axes)
{
    const pliant_system *before = from->system;
    for (int32_t e = 0; e < LANES * system->num_blocks; e++) {
        const int32_t t = tet[e < system->mesh->num_tets ? e : system->mesh->num_tets - 1];
        const double now = system->lame[e / LANES][1][e % LANES], was = before->lame[t / LANES][1][t % LANES];
        for (int m = 0; m < 9; m++)
            axes->before[e / LANES][m][e % LANES] =
                rescale_reference(from->rotations->before[t / LANES][m][t % LANES], was, now);
    }
}

/* Copy the reference of every hexahedron, and of tetrahedra next to a cut, from the element that contained its
 * tetrahedra before. Errors: MEMORY. */
static pliant_status carry_macros_before(const pliant_system *system, const pliant_solver *from, const int32_t *tet,
                                         pliant_nodal_rotations *axes)
{
    const pliant_system *before = from->system;
    int32_t *now_of = NULL, *was_of = NULL;
    pliant_status status = pliant_hexahedra_of_tets(system->mesh, system->macros, &now_of);
    if (status == PLIANT_OK) status = pliant_hexahedra_of_tets(before->mesh, before->macros, &was_of);
    for (int32_t t = 0; status == PLIANT_OK && t < system->mesh->num_tets; t++) {
        const int32_t e = now_of[t], w = was_of[tet[t]];
        for (int m = 0; m < 9; m++)
            axes->before[e / LANES][m][e % LANES] = rescale_reference(
                from->rotations->before[w / LANES][m][w % LANES], before->macros->shear[w], system->macros->shear[e]);
    }
    pliant_free(now_of);
    pliant_free(was_of);
    return status;
}

/* Next to a cut through coarse elements, copy the reference of every element from the first earlier element of its
 * cube, or from rest. Errors: MEMORY. */
static pliant_status carry_before_by_cell(const pliant_system *system, const pliant_solver *from,
                                          pliant_nodal_rotations *axes)
{
    const pliant_system *before = from->system;
    const int32_t *cells = system->mesh->cells;
    const size_t count = (size_t)cells[0] * (size_t)cells[1] * (size_t)cells[2];
    int32_t *first = pliant_calloc(count, sizeof *first);
    if (!first) return pliant_fail_memory("the solver");
    for (size_t c = 0; c < count; c++) first[c] = -1;
    for (int32_t w = pliant_element_count(before) - 1; w >= 0; w--)
        first[before->macros ? before->macros->cell[w] : before->mesh->lattice_of_tet[w] / 5] = w;
    for (int32_t e = 0; e < pliant_element_count(system); e++) {
        const int32_t w = first[system->macros ? system->macros->cell[e] : system->mesh->lattice_of_tet[e] / 5];
        const double now = system->macros ? system->macros->shear[e] : system->lame[e / LANES][1][e % LANES];
        const double was = w < 0            ? 0
                           : before->macros ? before->macros->shear[w]
                                            : before->lame[w / LANES][1][w % LANES];
        for (int m = 0; m < 9; m++)
            axes->before[e / LANES][m][e % LANES] =
                w < 0 ? (m % 4 == 0) * now
                      : rescale_reference(from->rotations->before[w / LANES][m][w % LANES], was, now);
    }
    pliant_free(first);
    return PLIANT_OK;
}

/* Return the earlier unknown of each unknown: (num_free); -1: none. NULL: out of memory. */
static int32_t *unknowns_before(const pliant_system *system, const pliant_system *before, const int32_t *node)
{
    int32_t *source = pliant_malloc((size_t)system->num_free, sizeof *source);
    for (int32_t f = 0; source && f < system->num_free; f++) {
        const int32_t was = node[system->node_of_free[f]];
        source[f] = was >= 0 ? before->free_of_node[was] : -1;
    }
    return source;
}

/* Carry over the axes and their reference positions. Errors: MEMORY. */
static pliant_status carry_axes(pliant_solver *solver, const pliant_solver *from, const int32_t *node,
                                const int32_t *tet)
{
    const pliant_system *system = solver->system;
    pliant_nodal_rotations *axes = solver->rotations;
    if (!axes) return PLIANT_OK;
    if (!from->rotations) { /* the earlier solver has run no step: use the rest state */
        pliant_nodal_rotations_refer(system, system->mesh->rest, axes);
        return PLIANT_OK;
    }
    int32_t *source = unknowns_before(system, from->system, node);
    if (!source) return pliant_fail_memory("the solver");
    axes->is_rotated = from->rotations->is_rotated;
    for (int32_t f = 0; f < system->num_free; f++)
        for (int m = 0; m < 9; m++)
            axes->rotation[9 * (size_t)f + (size_t)m] =
                source[f] >= 0 ? from->rotations->rotation[9 * (size_t)source[f] + (size_t)m] : m % 4 == 0;
    pliant_free(source);
    if (system->graded || from->system->graded) return carry_before_by_cell(system, from, axes);
    if (system->macros) return carry_macros_before(system, from, tet, axes);
    carry_tets_before(system, from, tet, axes);
    return PLIANT_OK;
}

/* Return, for each unknown, the unknown in the system of the present preconditioner or its base: (num_free). same:
 * nodes that keep their number. */
static int32_t *sources_of(const pliant_system *system, const pliant_solver *from, const int32_t *node, int32_t same)
{
    const pliant_system *before = from->system;
    const int32_t *below;
    pliant_preconditioner_source(from->preconditioner, &below);
    const bool alike =
        system->mesh == system->fine && same == before->mesh->num_nodes && pliant_has_same_numbers(system, before);
    const int32_t known = alike && below ? before->num_free : 0;
    int32_t *source = known > 0 ? pliant_next_version(below, (size_t)known, (size_t)system->num_free, sizeof *source)
                                : pliant_malloc((size_t)system->num_free, sizeof *source);
    for (int32_t f = known; source && f < system->num_free; f++) {
        const int32_t was = node[system->node_of_free[f]], unknown = was >= 0 ? before->free_of_node[was] : -1;
        source[f] = unknown >= 0 && below ? below[unknown] : unknown;
    }
    if (source) pliant_mark_written(source, (size_t)known, (size_t)(system->num_free - known), sizeof *source);
    return source;
}

static pliant_status carry(pliant_solver *solver, const pliant_solver *from, const int32_t *node,
                           const pliant_body_map *map, bool without_step_arrays)
{
    const pliant_system *system = solver->system;
    pliant_status status = carry_axes(solver, from, node, map->tet);
    if (status != PLIANT_OK) return status;
    const int32_t *below;
    const pliant_discretization *of = pliant_preconditioner_source(from->preconditioner, &below);
    if (!of) of = from->system->of;
    int32_t *source = sources_of(system, from, node, map->num_same);
    if (!source) return pliant_fail_memory("the solver");
    const double *axes = solver->rotations && solver->rotations->is_rotated ? solver->rotations->rotation : NULL;
    status = pliant_preconditioner_carry(system, of, of->system, source, without_step_arrays ? NULL : solver->now.x,
                                         axes, &solver->preconditioner);
    return status == PLIANT_OK ? pliant_refresh_carry(solver, from, node) : status;
}

pliant_status pliant_solver_carry_over_cut(const pliant_scene *scene, const pliant_system *system,
                                           const pliant_solver *from, const pliant_body_map *map,
                                           bool without_step_arrays, const double *state, pliant_solver **out)
{
    const int32_t *node = NULL;
    int32_t *own = NULL;
    pliant_solver *solver = NULL;
    pliant_status status = pliant_solver_create_empty(scene, system, without_step_arrays, &solver);
    if (status != PLIANT_OK) return status;
    carry_limits(solver, from);
    status = pliant_solver_carry_load(solver, from);
    if (status == PLIANT_OK) status = pliant_solved_sources(system, from->system, map, &own, &node);
    if (status == PLIANT_OK && state) memcpy(solver->now.x, state, 3 * (size_t)system->mesh->num_nodes * sizeof *state);
    else if (status == PLIANT_OK)
        status = pliant_solved_positions(system, from->system, map, from->now.x, solver->now.x);
    if (status == PLIANT_OK) status = pliant_pressure_carry(solver, from);
    if (status == PLIANT_OK) status = carry(solver, from, node, map, without_step_arrays);
    pliant_free(own);
    solver->is_after_cut = true;
    if (status != PLIANT_OK) {
        pliant_solver_free(solver);
        return status;
    }
    *out = solver;
    return PLIANT_OK;
}

void pliant_solver_take_over(pliant_solver *solver, pliant_solver *from)
{
    if (!pliant_preconditioner_base(solver->preconditioner)) return;
    pliant_preconditioner **base = pliant_preconditioner_base(from->preconditioner);
    pliant_preconditioner_take_base(solver->preconditioner, base ? base : &from->preconditioner);
    pliant_refresh_take(solver, from);
}

pliant_status pliant_solver_carry_grasp(pliant_solver *solver, const pliant_solver *from, int tool, int32_t count,
                                        const int32_t *nodes, const double *weights, const double *fine_positions,
                                        const double force[3])
{
    pliant_status status = pliant_solver_add_grasp(solver, tool, count, nodes, weights, fine_positions);
    if (status != PLIANT_OK) return status;
    pliant_grasp_constraint *grasp = solver->grasps + tool;
    const pliant_grasp_constraint *before = from->grasps + tool;
    grasp->by_force = before->by_force;
    grasp->compliance = before->compliance;
    memcpy(grasp->target, before->target, sizeof grasp->target);
    memcpy(grasp->force, force, sizeof grasp->force);
    return PLIANT_OK;
}
