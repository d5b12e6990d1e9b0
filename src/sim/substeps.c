#include "sim/substeps.h"

#include "backend/backend.h"
#include "base/rotate.h"
#include "fem/patch/patch.h"
#include "fem/quasistatic/solver.h"
#include "pliant/memory.h"
#include "sim/contact.h"

#include <math.h>
#include <string.h>

enum { MOST = 16, MOST_LIVE = 4 /* where no step is to take much longer than others */ };

/* What a step began with, of the stages from contact to upsample. */
struct pliant_step_begin {
    int32_t room_nodes, room_solved;
    double *positions, *solved;      /* (nodes x 3), of the fine mesh and of the one that is solved [m] */
    pliant_tool tools[PLIANT_MAX_TOOLS]; /* what they point to is the simulation's */
    double force[PLIANT_MAX_TOOLS][3];   /* of their handles [N] */
    pliant_even even;
    pliant_data contact;             /* points, and what the search knows; nothing else in it */
};

static bool reserve(double **room, int32_t *has, int32_t nodes)
{
    if (nodes <= *has) return true;
    double *made = pliant_resize(*room, (size_t)nodes, 3 * sizeof *made);
    if (!made) return false;
    *room = made;
    *has = nodes;
    return true;
}

/* false: there is no memory for it */
static bool keep(const pliant_model *model, pliant_data *data)
{
    const pliant_solver *solver = data->solver;
    const int32_t nodes = data->body->fine.num_nodes, solved = solver->system->mesh->num_nodes;
    if (!data->step_begin && !(data->step_begin = pliant_calloc(1, sizeof *data->step_begin))) return false;
    struct pliant_step_begin *begin = data->step_begin;
    if (!reserve(&begin->positions, &begin->room_nodes, nodes) || !reserve(&begin->solved, &begin->room_solved, solved)) return false;
    if (pliant_contact_copy(data, &begin->contact) != PLIANT_OK) return false;
    if (data->backend->download) data->backend->download(model, data);
    memcpy(begin->positions, data->positions, 3 * (size_t)nodes * sizeof *data->positions);
    memcpy(begin->solved, solver->now.x, 3 * (size_t)solved * sizeof *solver->now.x);
    memcpy(begin->tools, data->tools, sizeof begin->tools);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) memcpy(begin->force[t], solver->handles[t].force, sizeof begin->force[t]);
    begin->even = solver->even;
    return true;
}

/* Errors: MEMORY, those of a backend. */
static pliant_status go_back(const pliant_model *model, pliant_data *data)
{
    struct pliant_step_begin *begin = data->step_begin;
    pliant_solver *solver = data->solver;
    memcpy(data->positions, begin->positions, 3 * (size_t)data->body->fine.num_nodes * sizeof *data->positions);
    memcpy(solver->now.x, begin->solved, 3 * (size_t)solver->system->mesh->num_nodes * sizeof *solver->now.x);
    memcpy(data->tools, begin->tools, sizeof begin->tools);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) memcpy(solver->handles[t].force, begin->force[t], sizeof begin->force[t]);
    pliant_solver_moved(solver);
    solver->even = begin->even;
    const pliant_status status = pliant_contact_copy(&begin->contact, data), restarted = pliant_backend_restart(model, data);
    return status < 0 ? status : restarted;
}

/* Tools to where they are as the part ends, and what they pull tissue to as far. Those that have jumped are there at once. */
static void go(const pliant_model *model, pliant_data *data, const pliant_substeps *parts)
{
    const double share = (double)parts->at / parts->count;
    data->parts = parts->count;
    data->solver->reserved = parts->left * (1 - share);
    for (int t = 0; t < data->num_tools && parts->most > 1; t++) {
        const pliant_tool *end = data->step_begin->tools + t; /* where it was set to, and from where */
        pliant_tool *tool = data->tools + t;
        pliant_handle *handle = data->solver->handles + t;
        memcpy(tool->tip, end->tip, sizeof tool->tip);
        memcpy(tool->rotation, end->rotation, sizeof tool->rotation);
        tool->jaw = end->jaw;
        if (pliant_handle_is_spring(handle)) memcpy(handle->target, parts->target[t], sizeof handle->target);
        if (parts->at == parts->count || !pliant_contact_goes_on(model, end)) continue;
        for (int d = 0; d < 3; d++) tool->tip[d] = end->last.tip[d] + share * (end->tip[d] - end->last.tip[d]);
        pliant_rotation_between(end->last.rotation, end->rotation, share, tool->rotation);
        tool->jaw = end->last.jaw + share * (end->jaw - end->last.jaw);
        for (int d = 0; d < 3 && pliant_handle_is_spring(handle); d++) handle->target[d] += tool->tip[d] - end->tip[d];
    }
}

void pliant_substeps_begin(const pliant_model *model, pliant_data *data, pliant_substeps *parts)
{
    const bool live = data->background.kind != PLIANT_BACKGROUND_PLANNED;
    *parts = (pliant_substeps){.count = 1, .at = 1, .most = 1, .left = 1};
    data->parts = 1;
    if (!data->solver) return;
    data->solver->spent = data->solver->reserved = 0;
    if (data->falling || pliant_patch_serves(data) > 0 || !pliant_contact_goes_far(model, data) || !keep(model, data)) return;
    parts->most = live ? MOST_LIVE : MOST;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) memcpy(parts->target[t], data->solver->handles[t].target, sizeof parts->target[t]);
}

bool pliant_substeps_next(const pliant_model *model, pliant_data *data, pliant_substeps *parts)
{
    if (parts->at == parts->count) return false;
    pliant_contact_end(data);
    parts->at++;
    go(model, data, parts);
    return true;
}

bool pliant_substeps_can_be_more(const pliant_data *data, const pliant_substeps *parts)
{
    return parts->count < parts->most && pliant_solver_has_time(data->solver);
}

pliant_status pliant_substeps_again(const pliant_model *model, pliant_data *data, pliant_substeps *parts)
{
    const pliant_solver *solver = data->solver;
    parts->count = 2 * parts->count;
    const pliant_status status = go_back(model, data);
    if (status < 0) return status;
    parts->at = 1;
    parts->left = solver->budget > 0 ? fmax(1 - solver->spent / solver->budget, 0) : 1;
    go(model, data, parts);
    return PLIANT_OK;
}

void pliant_substeps_undo(const pliant_model *model, pliant_data *data, const pliant_substeps *parts)
{
    if (parts->count > 1) (void)go_back(model, data);
    data->parts = 1;
}

static double volume_of(const double *x, const int32_t *node)
{
    double edge[3][3], volume = 0;
    for (int v = 0; v < 3; v++)
        for (int d = 0; d < 3; d++) edge[v][d] = x[3 * (size_t)node[v + 1] + (size_t)d] - x[3 * (size_t)node[0] + (size_t)d];
    for (int d = 0; d < 3; d++) volume += edge[0][d] * (edge[1][(d + 1) % 3] * edge[2][(d + 2) % 3] - edge[1][(d + 2) % 3] * edge[2][(d + 1) % 3]);
    return volume;
}

bool pliant_substeps_turned(const pliant_data *data)
{
    const pliant_mesh *mesh = &data->body->fine;
    bool turned = false;
    for (int32_t t = 0; t < mesh->num_tets && !turned; t++) {
        const int32_t *node = mesh->tets + 4 * (size_t)t;
        turned = volume_of(data->positions, node) <= 0 && volume_of(data->step_begin->positions, node) > 0;
    }
    return turned;
}

void pliant_substeps_free(pliant_data *data)
{
    if (!data->step_begin) return;
    pliant_contact_free(&data->step_begin->contact);
    pliant_free(data->step_begin->positions);
    pliant_free(data->step_begin->solved);
    pliant_free(data->step_begin);
}
