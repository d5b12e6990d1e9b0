/* Save the state at the start of a leg, and apply a fraction of the leg. */
#include "backend/backend.h"
#include "base/buffer.h"
#include "base/fail.h"
#include "contact/volume/volume_bound.h"
#include "fem/dynamics/tled_cubes.h"
#include "fem/dynamics/tled_pressure.h"
#include "fem/patch/patch.h"
#include "fem/quasistatic/solver.h"
#include "base/memory.h"
#include "base/vector3.h"
#include "sim/step/contact.h"
#include "sim/step/legs.h"
#include "sim/step/state.h"

#include <assert.h>
#include <math.h>
#include <string.h>

bool pliant_legs_are_dynamic(const pliant_data *data) { return data->tled && !data->tled->system->quasi_static; }

pliant_grasp_constraint *pliant_legs_grasp(const pliant_data *data, int tool)
{
    return pliant_patch_solver(data, tool)->grasps + tool;
}

/* Copy the positions of the fine mesh and of the solved mesh. Errors: MEMORY. */
static pliant_status save_positions(const pliant_model *model, pliant_data *data)
{
    pliant_legs *legs = data->legs;
    const int32_t nodes = data->body->fine.num_nodes;
    const pliant_solver *solver = data->solver;
    if (!pliant_ensure(&legs->position_buffer, (size_t)nodes, 3 * sizeof *legs->position_buffer) ||
        (solver && !pliant_ensure(&legs->solved_buffer, (size_t)solver->system->mesh->num_nodes,
                                  3 * sizeof *legs->solved_buffer)))
        return pliant_fail_memory("contacts");
    memcpy(legs->position_buffer, data->positions, 3 * (size_t)nodes * sizeof *data->positions);
    legs->positions = legs->position_buffer;
    if (!solver) return PLIANT_OK; /* explicit dynamics saves its own state (tled->start_u) */
    if (data->backend->download) data->backend->download(model, data);
    memcpy(legs->solved_buffer, solver->now.x,
           3 * (size_t)solver->system->mesh->num_nodes * sizeof *legs->solved_buffer);
    pliant_rigid_pieces_set_detachment_positions(data->rigid_pieces, solver->system, legs->solved_buffer);
    legs->solved = legs->solved_buffer;
    return PLIANT_OK;
}

pliant_status pliant_legs_save(const pliant_model *model, pliant_data *data)
{
    pliant_legs *legs = data->legs;
    /* Nothing has moved since the rollback was saved, except nodes of patches. */
    if (!legs->first || data->patch || !pliant_rollback_find_positions(data, &legs->positions, &legs->solved)) {
        const pliant_status status = save_positions(model, data);
        if (status != PLIANT_OK) return status;
    }
    assert(memcmp(legs->positions, data->positions, 3 * (size_t)data->body->fine.num_nodes * sizeof(double)) == 0);
    if (!data->solver) return PLIANT_OK;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        memcpy(legs->force[t], pliant_legs_grasp(data, t)->force, sizeof legs->force[t]);
    return data->rigid_pieces ? pliant_rigid_pieces_save(data->rigid_pieces, &legs->rigid_pieces) : PLIANT_OK;
}

/* to = from + share (to - from) */
static void mix(size_t count, const double *from, double fraction, double *to)
{
    for (size_t i = 0; i < count; i++) to[i] = from[i] + fraction * (to[i] - from[i]);
}

static void mix_point(const pliant_contact_point *from, double fraction, pliant_contact_point *to)
{
    mix(3, from->force, fraction, to->force);
    mix(3, from->anchor, fraction, to->anchor);
    if (!(fraction > 0)) to->was_pressed = from->was_pressed;
}

/* Return the smallest fraction of these nodes. step: distance between nodes in the array. */
static double min_fraction(const double *fraction, int32_t count, const int32_t *node, int step)
{
    double minimum = 1;
    for (int32_t k = 0; k < count; k++) minimum = fmin(minimum, fraction[node[k * step]]);
    return minimum;
}

/* Mix the relaxed stress of elements. node: (num_blocks x corners x LANES) */
static void mix_memory(const pliant_tled *tled, int32_t first_block, int32_t num_blocks, const int32_t *node,
                       int corners, const double *fraction)
{
    for (int32_t b = 0; b < num_blocks; b++)
        for (int l = 0; l < LANES; l++) {
            const float share =
                (float)min_fraction(fraction, corners, node + (size_t)b * (size_t)(corners * LANES) + l, LANES);
            for (int m = 0; m < 6 * PLIANT_PRONY_TERMS && share < 1; m++) {
                const float from = tled->start_memory[first_block + b][m][l];
                float *to = &tled->memory[first_block + b][m][l];
                *to = from + share * (*to - from);
            }
        }
}

/* The increment is scaled with the motion. This removes kinetic energy and never adds any. The distances of held points
 * from their targets stay. */
static void mix_dynamics(const pliant_data *data, const double *fraction)
{
    pliant_tled *tled = data->tled;
    const pliant_tled_system *system = tled->system;
    pliant_tled_shift_targets(tled, data->tools, data->num_tools, fraction);
    for (int32_t n = 0; n < system->mesh->num_nodes; n++) {
        const size_t at = 3 * (size_t)n;
        if (!(fraction[n] < 1)) continue;
        mix(3, tled->start_u + at, fraction[n], tled->u + at);
        for (int d = 0; d < 3; d++) tled->d[at + (size_t)d] *= fraction[n];
    }
    pliant_tled_pressure_mix(tled, fraction);
    if (!tled->memory) return;
    mix_memory(tled, 0, system->num_blocks, &system->nodes[0][0][0], 4, fraction);
    if (system->cubes)
        mix_memory(tled, system->num_blocks, system->cubes->num_blocks, &system->cubes->nodes[0][0][0], 8, fraction);
}

static void mix_solver(pliant_data *data, double fraction)
{
    pliant_legs *legs = data->legs;
    pliant_solver *solver = data->solver;
    const pliant_evaluation_history evaluation_history = solver->evaluation_history;
    if (data->backend->download) data->backend->download(data->model, data);
    pliant_rigid_pieces_set_detachment_positions(data->rigid_pieces, solver->system, solver->now.x);
    mix(3 * (size_t)solver->system->mesh->num_nodes, legs->solved, fraction, solver->now.x);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) mix(3, legs->force[t], fraction, pliant_legs_grasp(data, t)->force);
    (void)pliant_solver_set_contacts(solver, NULL, NULL, NULL);
    pliant_solver_reset_after_move(solver);
    solver->evaluation_history = evaluation_history;
}

static pliant_status end_mix(const pliant_model *model, pliant_data *data)
{
    const pliant_status status = pliant_backend_upload_positions(model, data);
    pliant_report_grasps(data);
    return status;
}

pliant_status pliant_legs_apply_islands(const pliant_model *model, pliant_data *data)
{
    pliant_legs *legs = data->legs;
    mix_dynamics(data, legs->fraction);
    for (int32_t n = 0; n < data->body->fine.num_nodes; n++)
        mix(3, legs->positions + 3 * (size_t)n, legs->fraction[n], data->positions + 3 * (size_t)n);
    for (int32_t p = 0; p < data->contacts.count; p++) {
        pliant_contact_point *point = data->contacts.point + p;
        mix_point(legs->points.point + p, min_fraction(legs->fraction, point->count, point->node, 1), point);
    }
    return end_mix(model, data);
}

bool pliant_legs_turn_nodes(const pliant_data *data)
{
    return data->solver && pliant_upsample_turns(data->solver->system) && pliant_patch_count_tools(data) == 0;
}

pliant_status pliant_legs_apply_fraction(const pliant_model *model, pliant_data *data, double fraction)
{
    pliant_legs *legs = data->legs;
    if (!data->solver) {
        const pliant_status status = pliant_legs_reserve_fractions(data);
        if (status != PLIANT_OK) return status;
        for (int32_t n = 0; n < data->body->fine.num_nodes; n++) legs->fraction[n] = fraction;
        return pliant_legs_apply_islands(model, data);
    }
    mix_solver(data, fraction);
    if (fraction > 0 && pliant_legs_turn_nodes(data))
        pliant_upsample_positions(data->solver->system, data->solver->now.x, data->positions);
    else
        mix(3 * (size_t)data->body->fine.num_nodes, legs->positions, fraction, data->positions);
    if (data->rigid_pieces) {
        pliant_rigid_pieces_interpolate(legs->rigid_pieces, fraction, data->rigid_pieces);
        pliant_rigid_pieces_hold(data->rigid_pieces, data->positions);
    }
    for (int32_t p = 0; p < data->contacts.count; p++)
        mix_point(legs->points.point + p, fraction, data->contacts.point + p);
    if (pliant_patch_count_tools(data) > 0) pliant_patch_follow_move(data, legs->positions);
    return end_mix(model, data);
}

/* No secant explains the lost motion, so it counts as an unexplained step does (fem/quasistatic/anderson.h). */
void pliant_legs_add_truncation_error(pliant_data *data, double lost)
{
    if (!data->solver) return;
    const double error = pliant_anderson_error(pliant_anderson_error_factor(&data->solver->rules) * lost);
    data->statistics.error += error;
    data->solver->rules.reported_error += error; /* the next step reports it as error_before */
}

/* Move the nodes of the solved mesh as the fine nodes. */
static void mix_nodes_of_solver(pliant_data *data)
{
    pliant_legs *legs = data->legs;
    pliant_solver *solver = data->solver;
    const pliant_evaluation_history evaluation_history = solver->evaluation_history;
    for (int32_t n = 0; n < data->body->fine.num_nodes; n++)
        if (legs->fraction[n] < 1)
            mix(3, legs->solved + 3 * (size_t)n, legs->fraction[n], solver->now.x + 3 * (size_t)n);
    (void)pliant_solver_set_contacts(solver, NULL, NULL, NULL);
    pliant_solver_reset_after_move(solver);
    solver->evaluation_history = evaluation_history;
}

double pliant_legs_find_volume_fraction(const pliant_model *model, const pliant_data *data)
{
    return pliant_volume_advance(&model->contact, &data->body->fine, data->legs->positions, data->positions,
                                 pliant_contact_pieces(data), data->discretization->system->num_threads);
}

pliant_status pliant_legs_bound_volumes(const pliant_model *model, pliant_data *data, bool *found)
{
    pliant_legs *legs = data->legs;
    const pliant_mesh *mesh = &data->body->fine;
    const pliant_status status = pliant_legs_reserve_fractions(data);
    if (status != PLIANT_OK) return status;
    const int32_t count =
        pliant_volume_bound_motion(&model->contact, mesh, legs->positions, data->positions, pliant_contact_pieces(data),
                                   data->discretization->system->num_threads, legs->fraction);
    *found = count >= 0;
    if (count <= 0) return PLIANT_OK;
    if (data->backend->download) data->backend->download(data->model, data);
    double farthest = 0;
    for (int32_t n = 0; n < mesh->num_nodes; n++) {
        if (legs->fraction[n] == 1) continue;
        farthest = fmax(farthest, (1 - legs->fraction[n]) * pliant_distance3(legs->positions + 3 * (size_t)n,
                                                                             data->positions + 3 * (size_t)n));
        mix(3, legs->positions + 3 * (size_t)n, legs->fraction[n], data->positions + 3 * (size_t)n);
    }
    if (data->tled) mix_dynamics(data, legs->fraction);
    else mix_nodes_of_solver(data);
    legs->limited_by_elements = true;
    pliant_legs_add_truncation_error(
        data, farthest + pliant_volume_lacking(&model->contact, mesh, data->positions, &data->contacts));
    return pliant_backend_upload_positions(model, data);
}

/* ---- explicit dynamics: contact points of the step, with mean forces */

pliant_status pliant_legs_add_forces(pliant_data *data, double fraction)
{
    pliant_legs *legs = data->legs;
    const pliant_contacts *mean_points = &legs->mean_points, *now = &data->contacts;
    pliant_contacts *out = &legs->merged;
    pliant_status status =
        mean_points->count + now->count > 0 ? pliant_contacts_reserve(out, mean_points->count + now->count) : PLIANT_OK;
    if (status != PLIANT_OK) return status;
    out->count = 0;
    for (int32_t a = 0, b = 0; a < mean_points->count || b < now->count;) {
        const int order = a == mean_points->count  ? 1
                          : b == now->count ? -1
                                            : pliant_contact_compare(mean_points->point + a, now->point + b);
        pliant_contact_point *point = out->point + out->count++;
        *point = order < 0 ? mean_points->point[a] : now->point[b];
        for (int d = 0; d < 3; d++)
            point->force[d] = (order <= 0 ? mean_points->point[a].force[d] : 0) +
                              (order >= 0 ? fraction * now->point[b].force[d] : 0);
        if (order < 0) point->was_pressed = false;
        a += order <= 0;
        b += order >= 0;
    }
    pliant_contacts_swap(&legs->mean_points, &legs->merged);
    return PLIANT_OK;
}

/* A point that has lost contact is placed at its tissue point, so its reported depth is 0. */
static void place_at_tissue(const pliant_data *data, pliant_contact_point *point)
{
    for (int d = 0; d < 3; d++) {
        point->place[d] = 0;
        for (int32_t k = 0; k < point->count; k++)
            point->place[d] += point->weight[k] * data->positions[3 * (size_t)point->node[k] + (size_t)d];
    }
}

void pliant_legs_publish_forces(pliant_data *data)
{
    pliant_legs *legs = data->legs;
    if (!pliant_legs_are_dynamic(data) || data->statistics.legs < 2) return;
    int32_t n = 0;
    pliant_contacts_swap(&data->contacts, &legs->mean_points);
    const pliant_contacts *now = &legs->mean_points;
    data->statistics.contacts = 0;
    for (int32_t p = 0; p < data->contacts.count; p++) {
        pliant_contact_point *point = data->contacts.point + p;
        while (n < now->count && now->point[n].feature < point->feature) n++;
        if (n == now->count || now->point[n].feature != point->feature) place_at_tissue(data, point);
        const bool has_force = point->force[0] != 0 || point->force[1] != 0 || point->force[2] != 0;
        data->statistics.contacts += has_force && point->kind != PLIANT_OBSTACLE_ELEMENT;
    }
}

void pliant_legs_free(pliant_data *data)
{
    pliant_legs *legs = data->legs;
    if (!legs) return;
    pliant_rigid_pieces_saved_free(legs->rigid_pieces);
    PLIANT_FREE(legs->position_buffer, legs->solved_buffer, legs->fraction, legs->island, legs->points.point,
                legs->mean_points.point, legs->merged.point, legs->node_loads.load, legs);
}
