/* Grasps: rows of W, and the body's response to them. */
#include "base/fail.h"
#include "base/buffer.h"
#include "base/matrix.h"
#include "base/pairs.h"
#include "fem/quasistatic/solver.h"
#include "base/memory.h"

#include <stdlib.h>
#include <string.h>

void pliant_grasp_apply(const pliant_grasp_constraint *grasp, const double *v, double out[3])
{
    for (int32_t h = 0; h < grasp->count; h++)
        pliant_add_product(grasp->rotated_block + 9 * h, v + 3 * grasp->unknown[h], out);
}

void pliant_grasp_add_pull(const pliant_grasp_constraint *grasp, const double force[3], double *v)
{
    for (int32_t h = 0; h < grasp->count; h++)
        pliant_add_transposed_product(grasp->rotated_block + 9 * h, force, v + 3 * grasp->unknown[h]);
}

void pliant_grasp_add_load(const pliant_grasp_constraint *grasp, const double force[3], double *v)
{
    for (int32_t h = 0; h < grasp->count; h++)
        pliant_add_transposed_product(grasp->block + 9 * h, force, v + 3 * grasp->unknown[h]);
}

/* Compute y = origin + W x. x: all nodes of the solved mesh. */
static void held_point(const pliant_solver *solver, const pliant_grasp_constraint *grasp, const double *x,
                       double out[3])
{
    memcpy(out, grasp->origin, 3 * sizeof *out);
    for (int32_t h = 0; h < grasp->count; h++)
        pliant_add_product(grasp->block + 9 * h, x + 3 * solver->system->node_of_free[grasp->unknown[h]], out);
}

static void free_arrays(pliant_grasp_constraint *grasp)
{
    PLIANT_FREE(grasp->unknown, grasp->block, grasp->rotated_block, grasp->response);
}

/* Allocate the weights of a grasp; the response is allocated on demand. */
static pliant_status allocate(pliant_grasp_constraint *grasp)
{
    grasp->unknown = pliant_calloc((size_t)grasp->count, sizeof *grasp->unknown);
    grasp->block = pliant_calloc((size_t)grasp->count, 9 * sizeof *grasp->block);
    grasp->rotated_block = pliant_calloc((size_t)grasp->count, 9 * sizeof *grasp->rotated_block);
    grasp->response = NULL;
    if (grasp->unknown && grasp->block && grasp->rotated_block) return PLIANT_OK;
    free_arrays(grasp);
    return pliant_fail_memory("a tool's hold");
}

void pliant_grasp_free(pliant_grasp_constraint *grasp)
{
    free_arrays(grasp);
    memset(grasp, 0, sizeof *grasp);
}

pliant_status pliant_grasp_copy(const pliant_grasp_constraint *grasp, pliant_grasp_constraint *out)
{
    pliant_grasp_free(out);
    pliant_grasp_constraint copy = *grasp;
    pliant_status status = allocate(&copy);
    if (status != PLIANT_OK) return status;
    memcpy(copy.unknown, grasp->unknown, (size_t)grasp->count * sizeof *copy.unknown);
    memcpy(copy.block, grasp->block, 9 * (size_t)grasp->count * sizeof *copy.block);
    *out = copy;
    return PLIANT_OK;
}

bool pliant_grasp_is_same(const pliant_grasp_constraint *a, const pliant_grasp_constraint *b)
{
    return a->count == b->count && memcmp(a->unknown, b->unknown, (size_t)a->count * sizeof *a->unknown) == 0 &&
           memcmp(a->block, b->block, 9 * (size_t)a->count * sizeof *a->block) == 0;
}

void pliant_solver_remove_grasp(pliant_solver *solver, int tool)
{
    pliant_grasp_free(solver->grasps + tool);
    pliant_solver_drop_history(solver);
}

void pliant_grasp_rotate(pliant_grasp_constraint *grasp, const pliant_nodal_rotations *rotations)
{
    if (grasp->count == 0) return;
    memcpy(grasp->rotated_block, grasp->block, 9 * (size_t)grasp->count * sizeof *grasp->block);
    for (int32_t row = 0; row < 3 * grasp->count; row++)
        pliant_into_node_axes(rotations, grasp->unknown[row / 3], grasp->rotated_block + 3 * row);
}

void pliant_solver_rotate_grasps(pliant_solver *solver)
{
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) pliant_grasp_rotate(solver->grasps + t, solver->rotations);
}

/* A held unknown, if the fine mesh is the solved mesh. Its weight is a multiple of the unit matrix. */
typedef struct held_unknown {
    int32_t unknown, order;
    double weight;
} held_unknown;

static pliant_status hold_nodes(const pliant_system *system, int32_t count, const int32_t *nodes, const double *weights,
                                pliant_grasp_constraint *grasp)
{
    int32_t listed = 0, kept = 0;
    held_unknown *list = pliant_calloc((size_t)count + 1, sizeof *list);
    if (!list) return pliant_fail_memory("a tool's hold");
    for (int32_t h = 0; h < count; h++)
        if (system->free_of_node[nodes[h]] >= 0)
            list[listed++] = (held_unknown){system->free_of_node[nodes[h]], h, weights[h]};
    qsort(list, (size_t)listed, sizeof *list, pliant_pair_order);
    for (int32_t i = 0; i < listed;) {
        held_unknown one = {list[i].unknown, 0, 0};
        for (; i < listed && list[i].unknown == one.unknown; i++) one.weight += list[i].weight;
        if (one.weight != 0) list[kept++] = one;
    }
    grasp->count = kept;
    pliant_status status = kept > 0 ? allocate(grasp) : PLIANT_OK;
    for (int32_t i = 0; i < kept && status == PLIANT_OK; i++) {
        grasp->unknown[i] = list[i].unknown;
        for (int d = 0; d < 3; d++) grasp->block[9 * (size_t)i + 4 * (size_t)d] = list[i].weight;
    }
    pliant_free(list);
    return status;
}

/* Compute W for fine nodes that follow solved nodes. */
static pliant_status hold_followers(pliant_solver *solver, int32_t count, const int32_t *nodes, const double *weights,
                                    pliant_grasp_constraint *grasp)
{
    pliant_weight_blocks *blocks = &solver->weights;
    pliant_upsample_weights(solver->system, solver->now.x, count, nodes, weights, blocks);
    pliant_weight_blocks_sort(blocks);
    grasp->count = blocks->count;
    const pliant_status status = grasp->count > 0 ? allocate(grasp) : PLIANT_OK;
    for (int32_t n = 0; n < blocks->count && status == PLIANT_OK; n++) {
        grasp->unknown[n] = blocks->unknown[n];
        memcpy(grasp->block + 9 * (size_t)n, blocks->block + 9 * (size_t)blocks->unknown[n], 9 * sizeof *blocks->block);
    }
    pliant_weight_blocks_clear(blocks);
    return status;
}

pliant_status pliant_solver_add_grasp(pliant_solver *solver, int tool, int32_t count, const int32_t *nodes,
                                      const double *weights, const double *fine_positions)
{
    pliant_grasp_constraint *old = solver->grasps + tool, grasp = *old;
    grasp.unknown = NULL;
    grasp.block = grasp.rotated_block = grasp.response = NULL;
    pliant_status status = pliant_solves_fine(solver->system)
                               ? hold_nodes(solver->system, count, nodes, weights, &grasp)
                               : hold_followers(solver, count, nodes, weights, &grasp);
    if (status != PLIANT_OK) return status;
    bool was_active = old->active;
    free_arrays(old);
    *old = grasp;
    old->active = true;
    old->response_number = 0;
    if (!was_active) {
        memset(old->force, 0, sizeof old->force);
        pliant_evaluations_clear(&solver->evaluation_history);
    }
    double y[3] = {0, 0, 0}, moved[3];
    for (int32_t h = 0; h < count; h++)
        for (int d = 0; d < 3; d++) y[d] += weights[h] * fine_positions[3 * nodes[h] + d];
    memset(old->origin, 0, sizeof old->origin);
    held_point(solver, old, solver->now.x, moved);
    for (int d = 0; d < 3; d++) old->origin[d] = y[d] - moved[d];
    pliant_solver_rotate_grasps(solver);
    pliant_solver_drop_history(solver);
    return PLIANT_OK;
}

pliant_status pliant_grasp_find_response(pliant_grasp_constraint *grasp, size_t unknowns,
                                         pliant_preconditioner *preconditioner)
{
    if (!grasp->response && !(grasp->response = pliant_malloc(3 * unknowns, sizeof *grasp->response)))
        return pliant_fail_memory("a tool's hold");
    memset(grasp->response, 0, 3 * unknowns * sizeof *grasp->response);
    for (int d = 0; d < 3; d++) {
        double unit[3] = {d == 0, d == 1, d == 2};
        pliant_grasp_add_pull(grasp, unit, grasp->response + unknowns * (size_t)d);
    }
    return pliant_preconditioner_solve(preconditioner, 3, grasp->response, grasp->response);
}

pliant_status pliant_solver_find_responses(pliant_solver *solver)
{
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        pliant_grasp_constraint *grasp = solver->grasps + t;
        if (!pliant_grasp_is_spring(grasp) || grasp->response_number == solver->in_use.number) continue;
        pliant_status status =
            pliant_grasp_find_response(grasp, pliant_solver_unknowns(solver), solver->preconditioner);
        if (status != PLIANT_OK) return status;
        grasp->response_number = solver->in_use.number;
    }
    return PLIANT_OK;
}

void pliant_grasp_stretch(const pliant_solver *solver, int tool, const pliant_iterate *at, double out[3])
{
    const pliant_grasp_constraint *grasp = solver->grasps + tool;
    double y[3];
    held_point(solver, grasp, at->x, y);
    for (int d = 0; d < 3; d++) out[d] = grasp->target[d] - y[d] - grasp->compliance * at->force[3 * tool + d];
}

void pliant_grasp_gap(const pliant_solver *solver, int tool, const pliant_iterate *at, double out[3])
{
    pliant_grasp_stretch(solver, tool, at, out);
    for (int d = 0; d < 3; d++) out[d] = -out[d];
    pliant_grasp_apply(solver->grasps + tool, at->free_step, out);
}

int pliant_solver_list_springs(const pliant_solver *solver, int index[PLIANT_MAX_TOOLS])
{
    int count = 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        if (pliant_grasp_is_spring(solver->grasps + t)) index[count++] = t;
    return count;
}

void pliant_solver_fill_springs(const pliant_solver *solver, const int *index, int count, size_t row, double *matrix)
{
    const size_t n = pliant_solver_unknowns(solver);
    for (size_t a = 0; a < (size_t)count; a++)
        for (size_t b = 0; b < (size_t)count; b++)
            for (size_t d = 0; d < 3; d++) {
                double column[3] = {0, 0, 0};
                pliant_grasp_apply(solver->grasps + index[a], solver->grasps[index[b]].response + n * d, column);
                for (size_t r = 0; r < 3; r++)
                    matrix[(3 * a + r) * row + 3 * b + d] =
                        column[r] + (a == b && r == d ? solver->grasps[index[a]].compliance : 0);
            }
}

void pliant_solver_add_response(const pliant_solver *solver, int tool, const double force[3], double *step)
{
    const size_t n = pliant_solver_unknowns(solver);
    for (int d = 0; d < 3; d++) {
        const double *z = solver->grasps[tool].response + n * (size_t)d;
        for (size_t i = 0; i < n; i++) step[i] += force[d] * z[i];
    }
}

double pliant_solver_spring_energy(const pliant_solver *solver, const double *a, const double *b)
{
    double sum = 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        if (pliant_grasp_is_spring(solver->grasps + t))
            for (int d = 0; d < 3; d++) sum += solver->grasps[t].compliance * a[3 * t + d] * b[3 * t + d];
    return sum;
}
