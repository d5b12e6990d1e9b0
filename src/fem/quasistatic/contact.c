#include "fem/quasistatic/contact.h"

#include "base/buffer.h"
#include "base/fail.h"
#include "base/matrix.h"
#include "contact/volume/volume_bound.h"
#include "contact/solve/cones.h"
#include "fem/quasistatic/solver.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

/* ---- creation and destruction */

void pliant_contact_problem_free(pliant_contact_problem *contacts)
{
    if (!contacts) return;
    PLIANT_FREE(contacts->columns, contacts->point, contacts->frame, contacts->goal, contacts->start,
                contacts->arm_start, contacts->friction, contacts->taken.force, contacts->taken.motion,
                contacts->found.force, contacts->found.motion, contacts->change);
    pliant_compliance_free(&contacts->blocks);
    PLIANT_FREE(contacts->unknown, contacts->arm, contacts->moving, contacts->block, contacts->rotated_block,
                contacts->moved_unknowns, contacts->visited, contacts->matrix, contacts->motion, contacts->force,
                contacts->sweeps, contacts->step, contacts);
}

static pliant_status create(pliant_solver *solver)
{
    const size_t nodes = (size_t)solver->system->num_free;
    pliant_contact_problem *contacts = pliant_calloc(1, sizeof *contacts);
    if (!contacts) return pliant_fail_memory("contact");
    pliant_status status = pliant_compliance_create(solver->system->num_free, &contacts->blocks);
    contacts->moved_unknowns = pliant_calloc(nodes, sizeof *contacts->moved_unknowns);
    contacts->visited = pliant_calloc(nodes, 1);
    contacts->step = pliant_calloc(nodes, 3 * sizeof *contacts->step);
    if (status == PLIANT_OK && !(contacts->moved_unknowns && contacts->visited && contacts->step))
        status = pliant_fail_memory("contact");
    if (status != PLIANT_OK) {
        pliant_contact_problem_free(contacts);
        return status;
    }
    solver->contacts = contacts;
    return PLIANT_OK;
}

static pliant_status reserve_capacity(pliant_contact_problem *contacts, int32_t count)
{
    const int32_t minimum = 32, capacity = 2 * count > minimum ? 2 * count : minimum;
    const size_t size = (size_t)capacity;
    if (count <= contacts->capacity) return PLIANT_OK;
    if (!pliant_grow(&contacts->point, size, sizeof *contacts->point) ||
        !pliant_grow(&contacts->frame, size, 9 * sizeof *contacts->frame) ||
        !pliant_grow(&contacts->goal, size, 3 * sizeof *contacts->goal) ||
        !pliant_grow(&contacts->start, size + 1, sizeof *contacts->start) ||
        !pliant_grow(&contacts->arm_start, size + 1, sizeof *contacts->arm_start) ||
        !pliant_grow(&contacts->friction, size + PLIANT_MAX_TOOLS, sizeof *contacts->friction) ||
        !pliant_grow(&contacts->taken.force, size, 3 * sizeof *contacts->taken.force) ||
        !pliant_grow(&contacts->taken.motion, size, 3 * sizeof *contacts->taken.motion) ||
        !pliant_grow(&contacts->found.force, size, 3 * sizeof *contacts->found.force) ||
        !pliant_grow(&contacts->found.motion, size, 3 * sizeof *contacts->found.motion) ||
        !pliant_grow(&contacts->change, size, 3 * sizeof *contacts->change))
        return pliant_fail_memory("contact");
    contacts->capacity = capacity;
    return PLIANT_OK;
}

/* ---- contact points of a step */

static pliant_status add_weight(pliant_contact_problem *contacts, int32_t unknown, const double block[9])
{
    if (contacts->num_weights == contacts->weight_capacity) {
        const size_t capacity = 2 * (size_t)contacts->weight_capacity + 64;
        if (!pliant_grow(&contacts->unknown, capacity, sizeof *contacts->unknown) ||
            !pliant_grow(&contacts->block, capacity, 9 * sizeof *contacts->block) ||
            !pliant_grow(&contacts->rotated_block, capacity, 9 * sizeof *contacts->rotated_block))
            return pliant_fail_memory("contact");
        contacts->weight_capacity = (int32_t)capacity;
    }
    contacts->unknown[contacts->num_weights] = unknown;
    memcpy(contacts->block + 9 * (size_t)contacts->num_weights++, block, 9 * sizeof *block);
    return PLIANT_OK;
}

/* Add the weights of fine nodes that move with the solved mesh.
 * @param by 3 x 3 matrix that multiplies the blocks from the left; NULL: the identity */
static pliant_status add_upsampled_weights(pliant_solver *solver, int32_t count, const int32_t *node,
                                           const double *weight, const double *by)
{
    pliant_weight_blocks *blocks = &solver->weights;
    pliant_status status = PLIANT_OK;
    pliant_upsample_weights(solver->system, solver->now.x, count, node, weight, blocks);
    pliant_weight_blocks_sort(blocks);
    for (int32_t n = 0; n < blocks->count && status == PLIANT_OK; n++) {
        const double *block = blocks->block + 9 * (size_t)blocks->unknown[n];
        double product[9];
        for (int m = 0; m < 9 && by; m++)
            product[m] = by[m - m % 3] * block[m % 3] + by[m - m % 3 + 1] * block[3 + m % 3] +
                         by[m - m % 3 + 2] * block[6 + m % 3];
        status = add_weight(solver->contacts, blocks->unknown[n], by ? product : block);
    }
    pliant_weight_blocks_clear(blocks);
    return status;
}

/* Add the weights of a point. The gap of an element has the gradient of its volume instead of the weights. */
static pliant_status add_weights(pliant_solver *solver, const pliant_contact_point *point, const double *fine_positions)
{
    const pliant_system *system = solver->system;
    const bool keeps_volume = point->kind == PLIANT_OBSTACLE_ELEMENT, is_fine = pliant_solves_fine(system);
    const double one = 1, *n = point->normal;
    double gradient[4][3];
    pliant_status status = PLIANT_OK;
    if (!keeps_volume && !is_fine) return add_upsampled_weights(solver, point->count, point->node, point->weight, NULL);
    if (keeps_volume) pliant_volume_gradient(point, fine_positions, gradient);
    for (int32_t k = 0; k < point->count && status == PLIANT_OK; k++) {
        const double w = point->weight[k];
        double block[9] = {w, 0, 0, 0, w, 0, 0, 0, w};
        for (int m = 0; m < 9 && keeps_volume; m++) block[m] += n[m / 3] * (gradient[k][m % 3] - w * n[m % 3]);
        const int32_t unknown = is_fine ? system->free_of_node[point->node[k]] : -1;
        if (!is_fine)
            status = add_upsampled_weights(solver, 1, point->node + k, &one, block);
        else if (unknown >= 0 && (w != 0 || keeps_volume))
            status = add_weight(solver->contacts, unknown, block);
    }
    return status;
}

static void set_frame(const double normal[3], double frame[9])
{
    const int minimum = fabs(normal[0]) < fabs(normal[1]) ? (fabs(normal[0]) < fabs(normal[2]) ? 0 : 2)
                                                          : (fabs(normal[1]) < fabs(normal[2]) ? 1 : 2);
    double *n = frame, *t = frame + 3, *s = frame + 6, length = 0;
    memcpy(n, normal, 3 * sizeof *n);
    for (int d = 0; d < 3; d++) {
        t[d] = (d == minimum) - normal[minimum] * normal[d];
        length += t[d] * t[d];
    }
    length = sqrt(length);
    for (int d = 0; d < 3; d++) t[d] /= length;
    for (int d = 0; d < 3; d++) s[d] = n[(d + 1) % 3] * t[(d + 2) % 3] - n[(d + 2) % 3] * t[(d + 1) % 3];
}

/* Compute W x of a point. x: (nodes of the solved mesh x 3) */
static void moved_point(const pliant_system *system, const pliant_contact_problem *contacts, int32_t c, const double *x,
                        double out[3])
{
    memset(out, 0, 3 * sizeof *out);
    for (int32_t w = contacts->start[c]; w < contacts->start[c + 1]; w++)
        pliant_add_product(contacts->block + 9 * (size_t)w, x + 3 * (size_t)system->node_of_free[contacts->unknown[w]],
                           out);
}

static void into_frame(const double frame[9], const double v[3], double out[3])
{
    for (int r = 0; r < 3; r++) out[r] = frame[3 * r] * v[0] + frame[3 * r + 1] * v[1] + frame[3 * r + 2] * v[2];
}

static void from_frame(const double frame[9], const double v[3], double out[3])
{
    for (int r = 0; r < 3; r++) out[r] = frame[r] * v[0] + frame[3 + r] * v[1] + frame[6 + r] * v[2];
}

/* Compute the position at which the point touches and sticks. A force from the previous step stays, limited to the
 * current cone. */
static void set_point(const pliant_solver *solver, pliant_contact_point *point, int32_t c, const double *fine_positions)
{
    pliant_contact_problem *contacts = solver->contacts;
    const double *frame = contacts->frame + 9 * (size_t)c;
    double y[3] = {0, 0, 0}, bend[3] = {0, 0, 0}, moved[3], *force = contacts->taken.force + 3 * (size_t)c;
    for (int32_t k = 0; k < point->count; k++)
        for (int d = 0; d < 3; d++) y[d] += point->weight[k] * fine_positions[3 * (size_t)point->node[k] + (size_t)d];
    for (int d = 0; d < 3 && !point->was_pressed; d++) point->anchor[d] = y[d] + point->drift[d] - point->place[d];
    /* a GPU that solves the fine mesh does not update now.x in every step */
    const double *solved = pliant_solves_fine(solver->system) ? fine_positions : solver->now.x;
    moved_point(solver->system, contacts, c, solved, moved);
    pliant_contact_problem_rotation_part(contacts, c, bend);
    double across = 0;
    for (int d = 0; d < 3; d++) across += frame[d] * point->anchor[d];
    for (int d = 0; d < 3; d++)
        contacts->goal[3 * (size_t)c + (size_t)d] =
            point->place[d] + point->anchor[d] - across * frame[d] - (y[d] + bend[d] - moved[d]);
    into_frame(frame, point->force, force);
    const double slide = sqrt(force[1] * force[1] + force[2] * force[2]), maximum = point->friction * fmax(force[0], 0);
    for (int k = 1; k < 3 && slide > maximum; k++) force[k] *= maximum / slide;
    force[0] = fmax(force[0], 0);
    contacts->friction[c] = point->friction;
    memset(contacts->taken.motion + 3 * (size_t)c, 0, 3 * sizeof *contacts->taken.motion);
}

pliant_status pliant_solver_set_contacts(pliant_solver *solver, pliant_contacts *points,
                                         const pliant_contact_bodies *pieces, const double *fine_positions)
{
    if ((!points || points->count == 0) && !solver->contacts) return PLIANT_OK;
    pliant_status status = solver->contacts ? PLIANT_OK : create(solver);
    if (status != PLIANT_OK) return status;
    pliant_contact_problem *contacts = solver->contacts;
    contacts->points = points;
    contacts->pieces = pieces;
    contacts->count = contacts->num_weights = contacts->num_arms = contacts->num_moving = 0;
    contacts->num_couplings = 0;
    if (!points) return PLIANT_OK;
    status = reserve_capacity(contacts, points->count);
    for (int32_t p = 0; p < points->count && status == PLIANT_OK; p++) {
        const int32_t c = contacts->count;
        contacts->start[c] = contacts->num_weights;
        contacts->arm_start[c] = contacts->num_arms;
        status = add_weights(solver, points->point + p, fine_positions);
        if (status == PLIANT_OK && pieces)
            status = pliant_contact_problem_add_arms(contacts, points->point + p, fine_positions);
        /* fixed */
        if (status != PLIANT_OK ||
            (contacts->num_weights == contacts->start[c] && contacts->num_arms == contacts->arm_start[c]))
            continue;
        contacts->start[c + 1] = contacts->num_weights;
        contacts->arm_start[c + 1] = contacts->num_arms;
        contacts->point[c] = p;
        set_frame(points->point[p].normal, contacts->frame + 9 * (size_t)c);
        set_point(solver, points->point + p, c, fine_positions);
        contacts->count++;
    }
    if (status == PLIANT_OK) status = pliant_contact_problem_list_couplings(contacts);
    if (status != PLIANT_OK) contacts->count = contacts->num_couplings = 0;
    return status;
}

/* ---- compliance */

static void turn(pliant_solver *solver)
{
    pliant_contact_problem *contacts = solver->contacts;
    for (int32_t c = 0; c < contacts->count; c++)
        for (int32_t w = contacts->start[c]; w < contacts->start[c + 1]; w++) {
            const double *frame = contacts->frame + 9 * (size_t)c, *block = contacts->block + 9 * (size_t)w;
            double *rotated_block = contacts->rotated_block + 9 * (size_t)w;
            for (int r = 0; r < 3; r++) {
                for (int d = 0; d < 3; d++)
                    rotated_block[3 * r + d] =
                        frame[3 * r] * block[d] + frame[3 * r + 1] * block[3 + d] + frame[3 * r + 2] * block[6 + d];
                pliant_into_node_axes(solver->rotations, contacts->unknown[w], rotated_block + 3 * r);
            }
        }
}

void pliant_contact_problem_apply(const pliant_contact_problem *contacts, int32_t c, const double *v, double out[3])
{
    for (int32_t w = contacts->start[c]; w < contacts->start[c + 1]; w++)
        pliant_add_product(contacts->rotated_block + 9 * (size_t)w, v + 3 * (size_t)contacts->unknown[w], out);
}

void pliant_contact_problem_add_forces(const pliant_contact_problem *contacts, const double *force, double *v)
{
    for (int32_t c = 0; c < contacts->count; c++)
        for (int32_t w = contacts->start[c]; w < contacts->start[c + 1]; w++)
            pliant_add_transposed_product(contacts->rotated_block + 9 * (size_t)w, force + 3 * (size_t)c,
                                          v + 3 * (size_t)contacts->unknown[w]);
}

/* Compute the block of A of two points. */
static void compliance_of(const pliant_contact_problem *contacts, int32_t a, int32_t b, double out[9])
{
    memset(out, 0, 9 * sizeof *out);
    for (int32_t v = contacts->start[a]; v < contacts->start[a + 1]; v++) {
        double moved[9] = {0}; /* motion of the unknown of v by unit forces at b */
        for (int32_t w = contacts->start[b]; w < contacts->start[b + 1]; w++) {
            const double *compliance =
                             pliant_compliance_block(&contacts->blocks, contacts->unknown[v], contacts->unknown[w]),
                         *block = contacts->rotated_block + 9 * (size_t)w;
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++)
                    moved[3 * r + c] += compliance[3 * r] * block[3 * c] + compliance[3 * r + 1] * block[3 * c + 1] +
                                        compliance[3 * r + 2] * block[3 * c + 2];
        }
        const double *block = contacts->rotated_block + 9 * (size_t)v;
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                out[3 * r + c] +=
                    block[3 * r] * moved[c] + block[3 * r + 1] * moved[3 + c] + block[3 * r + 2] * moved[6 + c];
    }
}

/* Set the blocks of the tools' springs, whose responses are whole vectors. */
static void set_springs(const pliant_solver *solver, const int *tool, int num_tools, size_t row)
{
    pliant_contact_problem *contacts = solver->contacts;
    const size_t n = pliant_solver_unknowns(solver), points = 3 * (size_t)contacts->count;
    for (size_t t = 0; t < (size_t)num_tools; t++)
        for (size_t d = 0; d < 3; d++) {
            const double *response = solver->grasps[tool[t]].response + n * d;
            for (int32_t c = 0; c < contacts->count; c++) {
                double moved[3] = {0, 0, 0};
                pliant_contact_problem_apply(contacts, c, response, moved);
                for (size_t r = 0; r < 3; r++)
                    contacts->matrix[(3 * (size_t)c + r) * row + points + 3 * t + d] =
                        contacts->matrix[(points + 3 * t + d) * row + 3 * (size_t)c + r] = moved[r];
            }
        }
    pliant_solver_fill_springs(solver, tool, num_tools, row, contacts->matrix + points * row + points);
}

pliant_status pliant_contact_problem_size_matrix(pliant_contact_problem *contacts, int num_tools)
{
    const size_t row = 3 * (size_t)(contacts->count + num_tools), capacity = 2 * row;
    for (int t = 0; t < num_tools; t++) contacts->friction[contacts->count + t] = PLIANT_CONE_FIXED;
    if (row <= contacts->matrix_capacity) return PLIANT_OK;
    if (!pliant_grow(&contacts->matrix, capacity, capacity * sizeof *contacts->matrix) ||
        !pliant_grow(&contacts->motion, capacity, sizeof *contacts->motion) ||
        !pliant_grow(&contacts->force, capacity, sizeof *contacts->force) ||
        !pliant_grow(&contacts->sweeps, capacity * PLIANT_CONE_BUFFER + pliant_cone_numbers(capacity),
                     sizeof *contacts->sweeps))
        return pliant_fail_memory("contact");
    contacts->matrix_capacity = capacity;
    return PLIANT_OK;
}

pliant_status pliant_contact_problem_find_matrix(pliant_solver *solver)
{
    pliant_contact_problem *contacts = solver->contacts;
    if (!pliant_contact_problem_has_points(contacts)) return PLIANT_OK;
    pliant_contact_problem_begin_couplings(contacts);
    turn(solver);
    int32_t num_moved_unknowns = 0;
    for (int32_t w = 0; w < contacts->num_weights; w++) {
        if (contacts->visited[contacts->unknown[w]]) continue;
        contacts->visited[contacts->unknown[w]] = 1;
        contacts->moved_unknowns[num_moved_unknowns++] = contacts->unknown[w];
    }
    int tool[PLIANT_MAX_TOOLS];
    const int num_tools = pliant_solver_list_springs(solver, tool);
    const int32_t num_answers = num_moved_unknowns;
    for (int t = 0; t < num_tools; t++)
        for (int32_t h = 0; h < solver->grasps[tool[t]].count; h++) {
            const int32_t unknown = solver->grasps[tool[t]].unknown[h];
            if (!contacts->visited[unknown]) contacts->moved_unknowns[num_moved_unknowns++] = unknown;
            contacts->visited[unknown] = 1;
        }
    for (int32_t i = 0; i < num_moved_unknowns; i++) contacts->visited[contacts->moved_unknowns[i]] = 0;
    bool splits = false;
    pliant_factor *factor = pliant_preconditioner_factor(solver->preconditioner);
    pliant_status status =
        factor ? pliant_factor_reach(factor, num_moved_unknowns, contacts->moved_unknowns, &splits) : PLIANT_OK;
    contacts->factor = status == PLIANT_OK && splits ? factor : NULL;
    contacts->can_split_solve = contacts->factor && num_tools == 0;
    contacts->num_moved_unknowns = num_answers;
    if (status != PLIANT_OK) return status;
    /* a preconditioner that is carried over from the previous topology changes in every step */
    if (contacts->of_factor != solver->factors || pliant_preconditioner_base(solver->preconditioner))
        pliant_compliance_discard(&contacts->blocks);
    contacts->of_factor = solver->factors;
    status = pliant_compliance_compute(&contacts->blocks, solver->preconditioner, contacts->factor, num_answers,
                                       contacts->moved_unknowns);
    if (status != PLIANT_OK) return status;
    const size_t row = 3 * (size_t)(contacts->count + num_tools);
    if ((status = pliant_contact_problem_size_matrix(contacts, num_tools)) != PLIANT_OK) return status;
    for (int32_t a = 0; a < contacts->count; a++)
        for (int32_t b = 0; b <= a; b++) {
            double block[9];
            compliance_of(contacts, a, b, block);
            if (contacts->pieces) pliant_contact_problem_add_bodies(contacts, a, b, block);
            for (size_t r = 0; r < 3; r++)
                for (size_t c = 0; c < 3; c++)
                    contacts->matrix[(3 * (size_t)a + r) * row + 3 * (size_t)b + c] =
                        contacts->matrix[(3 * (size_t)b + c) * row + 3 * (size_t)a + r] = block[3 * r + c];
        }
    set_springs(solver, tool, num_tools, row);
    return PLIANT_OK;
}

/* ---- evaluations */

void pliant_contact_problem_add_load(const pliant_contact_problem *contacts, double *residual)
{
    for (int32_t c = 0; c < contacts->count; c++) {
        double force[3];
        from_frame(contacts->frame + 9 * (size_t)c, contacts->taken.force + 3 * (size_t)c, force);
        for (int32_t w = contacts->start[c]; w < contacts->start[c + 1]; w++)
            pliant_add_transposed_product(contacts->block + 9 * (size_t)w, force,
                                          residual + 3 * (size_t)contacts->unknown[w]);
    }
}

pliant_status pliant_contact_problem_free_step(pliant_solver *solver, pliant_iterate *at)
{
    if (!solver->contacts->factor)
        return pliant_preconditioner_solve(solver->preconditioner, 1, at->residual, at->free_step);
    const pliant_contact_problem *contacts = solver->contacts;
    if (contacts->can_split_solve)
        pliant_factor_begin_half(contacts->factor, at->residual);
    else
        pliant_factor_begin(contacts->factor, at->residual, at->free_step);
    for (int32_t i = 0; i < contacts->num_moved_unknowns && contacts->can_split_solve; i++)
        pliant_factor_half_answer(contacts->factor,
                                  pliant_compliance_half_solve(&contacts->blocks, contacts->moved_unknowns[i]),
                                  at->free_step + 3 * (size_t)contacts->moved_unknowns[i]);
    return PLIANT_OK;
}

bool pliant_contact_problem_solve(pliant_contact_problem *contacts, int num_tools)
{
    const size_t points = 3 * (size_t)contacts->count;
    double resistance = PLIANT_CONE_WEAK_RESISTANCE;
    memcpy(contacts->force, contacts->taken.force, points * sizeof *contacts->force);
    memset(contacts->force + points, 0, 3 * (size_t)num_tools * sizeof *contacts->force);
    pliant_cones_solve(contacts->count + num_tools, contacts->matrix, contacts->friction, contacts->motion,
                       contacts->force, &resistance, contacts->sweeps);
    pliant_contact_problem_apply_limits(contacts, num_tools, &resistance);
    memcpy(contacts->found.force, contacts->force, points * sizeof *contacts->force);
    memcpy(contacts->found.motion, contacts->motion, points * sizeof *contacts->motion);
    bool changed = false;
    for (size_t i = 0; i < points; i++) {
        contacts->change[i] = contacts->force[i] - contacts->taken.force[i];
        changed = changed || contacts->change[i] != 0;
    }
    return changed;
}

pliant_status pliant_contact_problem_step(pliant_solver *solver, pliant_iterate *at)
{
    pliant_contact_problem *contacts = solver->contacts;
    int tool[PLIANT_MAX_TOOLS];
    const int num_tools = pliant_solver_list_springs(solver, tool);
    const size_t points = 3 * (size_t)contacts->count, n = pliant_solver_unknowns(solver);
    for (int32_t c = 0; c < contacts->count; c++) {
        double y[3], *motion = contacts->motion + 3 * (size_t)c;
        moved_point(solver->system, contacts, c, at->x, y);
        for (int d = 0; d < 3; d++) y[d] -= contacts->goal[3 * (size_t)c + (size_t)d];
        into_frame(contacts->frame + 9 * (size_t)c, y, motion);
        pliant_contact_problem_apply(contacts, c, at->free_step, motion);
    }
    if (contacts->pieces) pliant_contact_problem_move_bodies(contacts, contacts->taken.force, false, contacts->motion);
    for (int t = 0; t < num_tools; t++)
        pliant_grasp_gap(solver, tool[t], at, contacts->motion + points + 3 * (size_t)t);
    const bool changed = pliant_contact_problem_solve(contacts, num_tools);
    if (!changed && !contacts->factor) return PLIANT_OK;
    memset(contacts->step, 0, n * sizeof *contacts->step);
    pliant_contact_problem_add_forces(contacts, contacts->change, contacts->step);
    pliant_contact_problem_add_forces(contacts, contacts->change, at->residual);
    for (int32_t i = 0; i < contacts->num_moved_unknowns && contacts->can_split_solve; i++)
        pliant_factor_half_add(contacts->factor,
                               pliant_compliance_half_solve(&contacts->blocks, contacts->moved_unknowns[i]),
                               contacts->step + 3 * (size_t)contacts->moved_unknowns[i]);
    if (contacts->can_split_solve)
        pliant_factor_end_half(contacts->factor, at->step);
    else if (contacts->factor)
        pliant_factor_end(contacts->factor, contacts->step, at->step);
    if (contacts->factor) return PLIANT_OK;
    pliant_status status = pliant_preconditioner_solve(solver->preconditioner, 1, contacts->step, contacts->step);
    for (size_t i = 0; i < n; i++) at->step[i] += contacts->step[i];
    return status;
}

void pliant_contact_problem_accept(pliant_contact_problem *contacts)
{
    const pliant_contact_forces swap = contacts->taken;
    contacts->taken = contacts->found;
    contacts->found = swap;
    for (int32_t n = 0; n < contacts->num_couplings; n++) {
        pliant_coupling *of = contacts->coupling + n;
        const double before = of->taken;
        of->taken = of->found;
        of->found = before;
    }
}

static double depth_of(const pliant_contact_problem *contacts, int32_t c, const double *moved)
{
    const double *frame = contacts->frame + 9 * (size_t)c, *goal = contacts->goal + 3 * (size_t)c;
    return -(frame[0] * (moved[0] - goal[0]) + frame[1] * (moved[1] - goal[1]) + frame[2] * (moved[2] - goal[2]));
}

void pliant_contact_problem_report_motion(pliant_contact_problem *contacts, const double *moved,
                                          pliant_statistics *statistics)
{
    statistics->contacts = 0;
    statistics->penetration = 0;
    for (int32_t p = 0; contacts && contacts->points && p < contacts->points->count; p++) {
        pliant_contact_point *point = contacts->points->point + p;
        memset(point->force, 0, sizeof point->force);
        point->was_pressed = false;
    }
    for (int32_t c = 0; contacts && c < contacts->count; c++) {
        pliant_contact_point *point = contacts->points->point + contacts->point[c];
        const double *frame = contacts->frame + 9 * (size_t)c, *force = contacts->taken.force + 3 * (size_t)c,
                     *motion = contacts->taken.motion + 3 * (size_t)c;
        const bool touches_something = point->kind != PLIANT_OBSTACLE_ELEMENT;
        if (touches_something)
            statistics->penetration = fmax(statistics->penetration, depth_of(contacts, c, moved + 3 * (size_t)c));
        from_frame(frame, force, point->force);
        point->was_pressed = force[0] > 0;
        statistics->contacts += point->was_pressed && touches_something;
        /* this motion is 0 while the point sticks */
        for (int d = 0; d < 3; d++) point->anchor[d] += motion[1] * frame[3 + d] + motion[2] * frame[6 + d];
    }
}

/* Compute W x of all points at the solver's state. */
static void find_moved(const pliant_solver *solver)
{
    pliant_contact_problem *contacts = solver->contacts;
    const int32_t count = contacts->count;
    for (int32_t c = 0; c < count; c++)
        moved_point(solver->system, contacts, c, solver->now.x, contacts->motion + 3 * (size_t)c);
    if (count > 0 && contacts->pieces) {
        memset(contacts->found.motion, 0, 3 * (size_t)count * sizeof(double));
        pliant_contact_problem_move_bodies(contacts, contacts->taken.force, true, contacts->found.motion);
        for (int32_t c = 0; c < count; c++) {
            double by[3];
            from_frame(contacts->frame + 9 * (size_t)c, contacts->found.motion + 3 * (size_t)c, by);
            for (int d = 0; d < 3; d++) contacts->motion[3 * (size_t)c + (size_t)d] += by[d];
        }
    }
}

void pliant_contact_problem_report(pliant_solver *solver, pliant_statistics *statistics)
{
    pliant_contact_problem *contacts = solver->contacts;
    if (contacts) pliant_contact_problem_restore_couplings(contacts);
    if (contacts) find_moved(solver);
    pliant_contact_problem_report_motion(contacts, contacts ? contacts->motion : NULL, statistics);
}
