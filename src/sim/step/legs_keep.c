/* Save the state at the start of a leg, and apply a fraction of the leg. */
#include "backend/backend.h"
#include "base/fail.h"
#include "contact/volume/volume.h"
#include "fem/dynamics/tled.h"
#include "fem/patch/patch.h"
#include "fem/quasistatic/solver.h"
#include "base/memory.h"
#include "sim/step/contact.h"
#include "sim/step/legs.h"

#include <math.h>
#include <string.h>

static bool reserve(double **room, int32_t *has, int32_t nodes)
{
    if (nodes <= *has) return true;
    double *made = pliant_resize(*room, (size_t)nodes, 3 * sizeof *made);
    if (!made) return false;
    *room = made;
    *has = nodes;
    return true;
}

/* A solver of the fine mesh keeps the nodes of rigid pieces fixed at their home positions. A download overwrites
 * these positions, so they are set again. */
static void fix_pieces(const pliant_data *data, double *solved)
{
    const pliant_system *system = data->solver->system;
    if (!data->falling || !data->backend->download || system->mesh != system->fine) return;
    for (int32_t n = 0; n < data->body->fine.num_nodes; n++) {
        const double *home = pliant_falling_home(data->falling, n);
        if (home) memcpy(solved + 3 * (size_t)n, home, 3 * sizeof *home);
    }
}

/* Return the grasp constraint of a tool, from its patch or from the model. */
static pliant_handle *handle_of(const pliant_data *data, int tool)
{
    return pliant_patch_solver(data, tool)->handles + tool;
}

pliant_status pliant_legs_keep(const pliant_model *model, pliant_data *data)
{
    pliant_legs *legs = data->legs;
    const int32_t nodes = data->body->fine.num_nodes;
    const pliant_solver *solver = data->solver;
    if (!reserve(&legs->positions, &legs->room_nodes, nodes) ||
        (solver && !reserve(&legs->solved, &legs->room_solved, solver->system->mesh->num_nodes)))
        return pliant_fail_memory("contacts");
    memcpy(legs->positions, data->positions, 3 * (size_t)nodes * sizeof *data->positions);
    if (!solver) return PLIANT_OK; /* explicit dynamics saves its own state (tled->kept_u) */
    if (data->backend->download) data->backend->download(model, data);
    memcpy(legs->solved, solver->now.x, 3 * (size_t)solver->system->mesh->num_nodes * sizeof *legs->solved);
    fix_pieces(data, legs->solved);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) memcpy(legs->force[t], handle_of(data, t)->force, sizeof legs->force[t]);
    return data->falling ? pliant_falling_keep(data->falling, &legs->falling) : PLIANT_OK;
}

pliant_status pliant_legs_keep_points(pliant_data *data)
{
    return pliant_contacts_copy(&data->contacts, &data->legs->points);
}

/* to = from + share (to - from) */
static void mix(size_t count, const double *from, double share, double *to)
{
    for (size_t i = 0; i < count; i++) to[i] = from[i] + share * (to[i] - from[i]);
}

static double distance(const double *a, const double *b)
{
    return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2]));
}

static void mix_points(const pliant_contacts *from, double share, pliant_contacts *to)
{
    for (int32_t p = 0; p < to->count; p++) {
        mix(3, from->point[p].force, share, to->point[p].force);
        mix(3, from->point[p].anchor, share, to->point[p].anchor);
        if (!(share > 0)) to->point[p].begun = from->point[p].begun;
    }
}

/* The increment is scaled with the motion. This removes kinetic energy and never adds any. */
static void mix_dynamics(pliant_tled *tled, double share)
{
    const size_t numbers = 3 * (size_t)tled->system->mesh->num_nodes;
    mix(numbers, tled->kept_u, share, tled->u);
    for (size_t i = 0; i < numbers; i++) tled->d[i] *= share;
    if (!tled->memory) return;
    const size_t relaxed = (size_t)pliant_tled_blocks(tled->system) * (sizeof *tled->memory / sizeof(float));
    const float *from = &tled->kept_memory[0][0][0];
    float *to = &tled->memory[0][0][0];
    for (size_t i = 0; i < relaxed; i++) to[i] = from[i] + (float)share * (to[i] - from[i]);
}

static void mix_solver(pliant_data *data, double share)
{
    pliant_legs *legs = data->legs;
    pliant_solver *solver = data->solver;
    const pliant_even even = solver->even;
    if (data->backend->download) data->backend->download(data->model, data);
    fix_pieces(data, solver->now.x);
    mix(3 * (size_t)solver->system->mesh->num_nodes, legs->solved, share, solver->now.x);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) mix(3, legs->force[t], share, handle_of(data, t)->force);
    (void)pliant_solver_touch(solver, NULL, NULL, NULL);
    pliant_solver_moved(solver);
    solver->even = even;
}

pliant_status pliant_legs_go_partway(const pliant_model *model, pliant_data *data, double share)
{
    pliant_legs *legs = data->legs;
    if (data->solver) mix_solver(data, share);
    else mix_dynamics(data->tled, share);
    mix(3 * (size_t)data->body->fine.num_nodes, legs->positions, share, data->positions);
    if (data->solver && data->falling) {
        pliant_falling_partway(legs->falling, share, data->falling);
        pliant_falling_stay(data->falling, data->positions);
    }
    mix_points(&legs->points, share, &data->contacts);
    if (data->solver && pliant_patch_serves(data) > 0) pliant_patch_moved(data, legs->positions);
    const pliant_status status = pliant_backend_move(model, data);
    pliant_pull_report(data);
    return status;
}

/* No secant explains the lost motion, so it counts as an unexplained step does (fem/quasistatic/estimate.c). */
void pliant_legs_add_lost(pliant_data *data, double lost)
{
    if (!data->solver) return;
    const double error = pliant_anderson_error(pliant_anderson_unexplained(&data->solver->rules) * lost);
    data->statistics.error += error;
    data->solver->rules.told += error; /* the next step reports it as error_before */
}

pliant_status pliant_legs_keep_volumes(const pliant_model *model, pliant_data *data)
{
    pliant_legs *legs = data->legs;
    pliant_solver *solver = data->solver;
    const pliant_mesh *mesh = &data->body->fine;
    const pliant_even even = solver->even;
    if (mesh->num_nodes > legs->room_shares) {
        double *share = pliant_resize(legs->share, (size_t)mesh->num_nodes, sizeof *share);
        if (!share) return pliant_fail_memory("contacts");
        legs->share = share;
        legs->room_shares = mesh->num_nodes;
    }
    if (pliant_volume_hold_back(&model->contact, mesh, legs->positions, data->positions, pliant_contact_pieces(data),
                                legs->share) == 0)
        return PLIANT_OK;
    if (data->backend->download) data->backend->download(data->model, data);
    double farthest = 0;
    for (int32_t n = 0; n < mesh->num_nodes; n++) {
        if (legs->share[n] == 1) continue;
        farthest = fmax(farthest, (1 - legs->share[n]) *
                                      distance(legs->positions + 3 * (size_t)n, data->positions + 3 * (size_t)n));
        mix(3, legs->positions + 3 * (size_t)n, legs->share[n], data->positions + 3 * (size_t)n);
        mix(3, legs->solved + 3 * (size_t)n, legs->share[n], solver->now.x + 3 * (size_t)n);
    }
    (void)pliant_solver_touch(solver, NULL, NULL, NULL);
    pliant_solver_moved(solver);
    solver->even = even;
    legs->shortened = true;
    pliant_legs_add_lost(
        data, farthest + pliant_volume_lacking(&model->contact, mesh, data->positions, &data->contacts));
    return pliant_backend_move(model, data);
}

/* ---- explicit dynamics: contact points of the step, with mean forces */

static bool is_dynamic(const pliant_data *data) { return data->tled && !data->tled->system->quasi_static; }

pliant_status pliant_legs_add_forces(pliant_data *data, double share)
{
    pliant_legs *legs = data->legs;
    const pliant_contacts *told = &legs->told, *now = &data->contacts;
    pliant_contacts *out = &legs->merged;
    pliant_status status =
        told->count + now->count > 0 ? pliant_contacts_reserve(out, told->count + now->count) : PLIANT_OK;
    if (status != PLIANT_OK) return status;
    out->count = 0;
    for (int32_t a = 0, b = 0; a < told->count || b < now->count;) {
        const int order = a == told->count  ? 1
                          : b == now->count ? -1
                                            : pliant_contact_compare(told->point + a, now->point + b);
        pliant_contact_point *point = out->point + out->count++;
        *point = order < 0 ? told->point[a] : now->point[b];
        for (int d = 0; d < 3; d++)
            point->force[d] =
                (order <= 0 ? told->point[a].force[d] : 0) + (order >= 0 ? share * now->point[b].force[d] : 0);
        if (order < 0) point->begun = false;
        a += order <= 0;
        b += order >= 0;
    }
    pliant_contacts_exchange(&legs->told, &legs->merged);
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

void pliant_legs_tell_forces(pliant_data *data)
{
    pliant_legs *legs = data->legs;
    if (!is_dynamic(data) || data->statistics.legs < 2) return;
    int32_t n = 0;
    pliant_contacts_exchange(&data->contacts, &legs->told);
    const pliant_contacts *now = &legs->told;
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
    pliant_falling_kept_free(legs->falling);
    pliant_free(legs->positions);
    pliant_free(legs->solved);
    pliant_free(legs->share);
    pliant_free(legs->points.point);
    pliant_free(legs->told.point);
    pliant_free(legs->merged.point);
    pliant_free(legs);
}
