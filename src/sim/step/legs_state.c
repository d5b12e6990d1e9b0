/* Save the state at the start of a leg, and apply a fraction of the leg. */
#include "backend/backend.h"
#include "base/fail.h"
#include "contact/volume/volume_bound.h"
#include "fem/dynamics/tled.h"
#include "fem/patch/patch.h"
#include "fem/quasistatic/solver.h"
#include "base/memory.h"
#include "base/vector3.h"
#include "sim/step/contact.h"
#include "sim/step/legs.h"

#include <math.h>
#include <string.h>

static bool reserve(double **array, int32_t *has, int32_t nodes)
{
    if (nodes <= *has) return true;
    double *made = pliant_resize(*array, (size_t)nodes, 3 * sizeof *made);
    if (!made) return false;
    *array = made;
    *has = nodes;
    return true;
}

/* A solver of the fine mesh keeps the nodes of rigid pieces fixed at their home positions. A download overwrites
 * these positions, so they are set again. */
static void fix_pieces(const pliant_data *data, double *solved)
{
    const pliant_system *system = data->solver->system;
    if (!data->rigid_pieces || !data->backend->download || system->mesh != system->fine) return;
    for (int32_t n = 0; n < data->body->fine.num_nodes; n++) {
        const double *home = pliant_rigid_pieces_detachment_position(data->rigid_pieces, n);
        if (home) memcpy(solved + 3 * (size_t)n, home, 3 * sizeof *home);
    }
}

/* Return the grasp constraint of a tool, from its patch or from the model. */
static pliant_grasp_constraint *grasp_constraint_of(const pliant_data *data, int tool)
{
    return pliant_patch_solver(data, tool)->grasps + tool;
}

pliant_status pliant_legs_save(const pliant_model *model, pliant_data *data)
{
    pliant_legs *legs = data->legs;
    const int32_t nodes = data->body->fine.num_nodes;
    const pliant_solver *solver = data->solver;
    if (!reserve(&legs->positions, &legs->node_capacity, nodes) ||
        (solver && !reserve(&legs->solved, &legs->solved_capacity, solver->system->mesh->num_nodes)))
        return pliant_fail_memory("contacts");
    memcpy(legs->positions, data->positions, 3 * (size_t)nodes * sizeof *data->positions);
    if (!solver) return PLIANT_OK; /* explicit dynamics saves its own state (tled->start_u) */
    if (data->backend->download) data->backend->download(model, data);
    memcpy(legs->solved, solver->now.x, 3 * (size_t)solver->system->mesh->num_nodes * sizeof *legs->solved);
    fix_pieces(data, legs->solved);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        memcpy(legs->force[t], grasp_constraint_of(data, t)->force, sizeof legs->force[t]);
    return data->rigid_pieces ? pliant_rigid_pieces_save(data->rigid_pieces, &legs->rigid_pieces) : PLIANT_OK;
}

pliant_status pliant_legs_save_points(pliant_data *data)
{
    return pliant_contacts_copy(&data->contacts, &data->legs->points);
}

/* to = from + share (to - from) */
static void mix(size_t count, const double *from, double fraction, double *to)
{
    for (size_t i = 0; i < count; i++) to[i] = from[i] + fraction * (to[i] - from[i]);
}

static void mix_points(const pliant_contacts *from, double fraction, pliant_contacts *to)
{
    for (int32_t p = 0; p < to->count; p++) {
        mix(3, from->point[p].force, fraction, to->point[p].force);
        mix(3, from->point[p].anchor, fraction, to->point[p].anchor);
        if (!(fraction > 0)) to->point[p].was_pressed = from->point[p].was_pressed;
    }
}

/* The increment is scaled with the motion. This removes kinetic energy and never adds any. */
static void mix_dynamics(pliant_tled *tled, double fraction)
{
    const size_t numbers = 3 * (size_t)tled->system->mesh->num_nodes;
    mix(numbers, tled->start_u, fraction, tled->u);
    for (size_t i = 0; i < numbers; i++) tled->d[i] *= fraction;
    if (!tled->memory) return;
    const size_t relaxed = (size_t)pliant_tled_blocks(tled->system) * (sizeof *tled->memory / sizeof(float));
    const float *from = &tled->start_memory[0][0][0];
    float *to = &tled->memory[0][0][0];
    for (size_t i = 0; i < relaxed; i++) to[i] = from[i] + (float)fraction * (to[i] - from[i]);
}

static void mix_solver(pliant_data *data, double fraction)
{
    pliant_legs *legs = data->legs;
    pliant_solver *solver = data->solver;
    const pliant_evaluation_history evaluation_history = solver->evaluation_history;
    if (data->backend->download) data->backend->download(data->model, data);
    fix_pieces(data, solver->now.x);
    mix(3 * (size_t)solver->system->mesh->num_nodes, legs->solved, fraction, solver->now.x);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) mix(3, legs->force[t], fraction, grasp_constraint_of(data, t)->force);
    (void)pliant_solver_set_contacts(solver, NULL, NULL, NULL);
    pliant_solver_reset_after_move(solver);
    solver->evaluation_history = evaluation_history;
}

pliant_status pliant_legs_apply_fraction(const pliant_model *model, pliant_data *data, double fraction)
{
    pliant_legs *legs = data->legs;
    if (data->solver) mix_solver(data, fraction);
    else mix_dynamics(data->tled, fraction);
    mix(3 * (size_t)data->body->fine.num_nodes, legs->positions, fraction, data->positions);
    if (data->solver && data->rigid_pieces) {
        pliant_rigid_pieces_interpolate(legs->rigid_pieces, fraction, data->rigid_pieces);
        pliant_rigid_pieces_hold(data->rigid_pieces, data->positions);
    }
    mix_points(&legs->points, fraction, &data->contacts);
    if (data->solver && pliant_patch_count_tools(data) > 0) pliant_patch_follow_move(data, legs->positions);
    const pliant_status status = pliant_backend_upload_positions(model, data);
    pliant_report_grasps(data);
    return status;
}

/* No secant explains the lost motion, so it counts as an unexplained step does (fem/quasistatic/final_state.c). */
void pliant_legs_add_truncation_error(pliant_data *data, double lost)
{
    if (!data->solver) return;
    const double error = pliant_anderson_error(pliant_anderson_error_factor(&data->solver->rules) * lost);
    data->statistics.error += error;
    data->solver->rules.reported_error += error; /* the next step reports it as error_before */
}

pliant_status pliant_legs_bound_volumes(const pliant_model *model, pliant_data *data, bool *found)
{
    pliant_legs *legs = data->legs;
    pliant_solver *solver = data->solver;
    const pliant_mesh *mesh = &data->body->fine;
    const pliant_evaluation_history evaluation_history = solver->evaluation_history;
    if (mesh->num_nodes > legs->fraction_capacity) {
        double *fraction = pliant_resize(legs->fraction, (size_t)mesh->num_nodes, sizeof *fraction);
        if (!fraction) return pliant_fail_memory("contacts");
        legs->fraction = fraction;
        legs->fraction_capacity = mesh->num_nodes;
    }
    const int32_t count = pliant_volume_bound_motion(&model->contact, mesh, legs->positions, data->positions,
                                                     pliant_contact_pieces(data), legs->fraction);
    *found = count >= 0;
    if (count <= 0) return PLIANT_OK;
    if (data->backend->download) data->backend->download(data->model, data);
    double farthest = 0;
    for (int32_t n = 0; n < mesh->num_nodes; n++) {
        if (legs->fraction[n] == 1) continue;
        farthest = fmax(farthest, (1 - legs->fraction[n]) * pliant_distance3(legs->positions + 3 * (size_t)n,
                                                                             data->positions + 3 * (size_t)n));
        mix(3, legs->positions + 3 * (size_t)n, legs->fraction[n], data->positions + 3 * (size_t)n);
        mix(3, legs->solved + 3 * (size_t)n, legs->fraction[n], solver->now.x + 3 * (size_t)n);
    }
    (void)pliant_solver_set_contacts(solver, NULL, NULL, NULL);
    pliant_solver_reset_after_move(solver);
    solver->evaluation_history = evaluation_history;
    legs->limited_by_elements = true;
    pliant_legs_add_truncation_error(
        data, farthest + pliant_volume_lacking(&model->contact, mesh, data->positions, &data->contacts));
    return pliant_backend_upload_positions(model, data);
}

/* ---- explicit dynamics: contact points of the step, with mean forces */

static bool is_dynamic(const pliant_data *data) { return data->tled && !data->tled->system->quasi_static; }

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
    if (!is_dynamic(data) || data->statistics.legs < 2) return;
    int32_t n = 0;
    pliant_contacts_swap(&data->contacts, &legs->mean_points);
    const pliant_contacts *now = &legs->mean_points;
    data->statistics.contacts = 0;
    for (int32_t p = 0; p < data->contacts.count; p++) {
        pliant_contact_point *point = data->contacts.point + p;
        while (n < now->count && now->point[n].feature < point->feature) n++;
        if (n == now->count || now->point[n].feature != point->feature) place_at_tissue(data, point);
        data->statistics.contacts += point->force[0] != 0 || point->force[1] != 0 || point->force[2] != 0;
    }
}

void pliant_legs_free(pliant_data *data)
{
    pliant_legs *legs = data->legs;
    if (!legs) return;
    pliant_rigid_pieces_saved_free(legs->rigid_pieces);
    pliant_free(legs->positions);
    pliant_free(legs->solved);
    pliant_free(legs->fraction);
    pliant_free(legs->points.point);
    pliant_free(legs->mean_points.point);
    pliant_free(legs->merged.point);
    pliant_free(legs);
}
