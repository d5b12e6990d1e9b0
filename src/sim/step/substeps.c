#include "sim/step/substeps.h"

#include "backend/backend.h"
#include "fem/rigid/falling.h"
#include "fem/patch/patch.h"
#include "fem/quasistatic/solver.h"
#include "pliant/memory.h"
#include "sim/step/contact.h"

#include <math.h>
#include <string.h>

enum { MOST = 16 };

/* Where nodes are, with which points of contact, and what tools pull with. */
typedef struct placed {
    int32_t room_nodes, room_solved;
    double *positions, *solved; /* (nodes x 3), of the fine mesh and of the one that is solved [m] */
    double force[PLIANT_MAX_TOOLS][3], origin[PLIANT_MAX_TOOLS][3]; /* of their handles [N]; of the model's, what they hold that is fixed, or of a piece [m] */
    pliant_contacts points;
    pliant_statistics told;     /* of the solve that has ended there */
} placed;

/* What a step began with, of the stages from contact to upsample. */
struct pliant_step_begin {
    placed part;                     /* as the solve of the step, or of the part that it is at, began */
    placed ended[PLIANT_ENDS];       /* as it has ended */
    const double *positions;         /* of the fine mesh, as the step began [m] */
    placed step;                     /* as the step began, and all that follows, of one that may be taken in parts; without points */
    pliant_contact_kept contact;
    pliant_even even;
    pliant_falling_kept *falling; /* Nullable */
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

/* Of a tool, at the patches or at the model. */
static pliant_handle *handle_of(const pliant_data *data, int tool) { return pliant_patch_solver(data, tool)->handles + tool; }

/* There is room for it. */
static void copy(const pliant_data *data, const placed *from, placed *to)
{
    memcpy(to->force, from->force, sizeof to->force);
    memcpy(to->origin, from->origin, sizeof to->origin);
    memcpy(to->positions, from->positions, 3 * (size_t)data->body->fine.num_nodes * sizeof *to->positions);
    memcpy(to->solved, from->solved, 3 * (size_t)data->solver->system->mesh->num_nodes * sizeof *to->solved);
}

/* The nodes that stand for pieces in a solver of the fine mesh: where it keeps them fixed, which is not where a download has found them. */
static void fix_pieces(const pliant_data *data, double *solved)
{
    const pliant_system *system = data->solver->system;
    if (!data->falling || !data->backend->download || system->mesh != system->fine) return;
    for (int32_t n = 0; n < data->body->fine.num_nodes; n++) {
        const double *home = pliant_falling_home(data->falling, n);
        if (home) memcpy(solved + 3 * (size_t)n, home, 3 * sizeof *home);
    }
}

static void take(const pliant_model *model, pliant_data *data, placed *out)
{
    if (data->backend->download) data->backend->download(model, data);
    placed now = {.positions = data->positions, .solved = data->solver->now.x};
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        memcpy(now.force[t], handle_of(data, t)->force, sizeof now.force[t]);
        memcpy(now.origin[t], data->solver->handles[t].origin, sizeof now.origin[t]);
    }
    copy(data, &now, out);
    fix_pieces(data, out->solved);
}

/* Errors: of a backend that cannot go on from there. */
static pliant_status put(const pliant_model *model, pliant_data *data, const placed *at)
{
    pliant_solver *solver = data->solver;
    const pliant_even even = solver->even;
    placed now = {.positions = data->positions, .solved = solver->now.x};
    copy(data, at, &now);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        memcpy(handle_of(data, t)->force, now.force[t], sizeof now.force[t]);
        memcpy(data->solver->handles[t].origin, now.origin[t], sizeof now.origin[t]);
    }
    pliant_solver_moved(solver);
    (void)pliant_solver_touch(solver, NULL, NULL, NULL); /* those of where it was */
    if (pliant_patch_serves(data) > 0) pliant_patch_moved(data, data->step_begin->positions);
    const pliant_status status = pliant_backend_move(model, data);
    solver->even = even;
    return status;
}

static bool reserve_placed(const pliant_data *data, placed *room)
{
    return reserve(&room->positions, &room->room_nodes, data->body->fine.num_nodes) && reserve(&room->solved, &room->room_solved, data->solver->system->mesh->num_nodes);
}

/* false: there is no memory for it */
static bool keep(const pliant_model *model, pliant_data *data)
{
    if (!data->step_begin && !(data->step_begin = pliant_calloc(1, sizeof *data->step_begin))) return false;
    struct pliant_step_begin *begin = data->step_begin;
    if (!reserve_placed(data, &begin->part)) return false;
    take(model, data, &begin->part);
    begin->positions = begin->part.positions;
    return true;
}

/* All else, too. false: there is no memory for it */
static bool keep_all(pliant_data *data)
{
    struct pliant_step_begin *begin = data->step_begin;
    if (!reserve_placed(data, &begin->step) || pliant_contact_keep(data, &begin->contact) != PLIANT_OK) return false;
    if (data->falling && pliant_falling_keep(data->falling, &begin->falling) != PLIANT_OK) return false;
    copy(data, &begin->part, &begin->step);
    begin->positions = begin->step.positions;
    begin->even = data->solver->even;
    return true;
}

/* But for tools and contacts. Errors: of a backend. */
static pliant_status go_back(const pliant_model *model, pliant_data *data)
{
    const struct pliant_step_begin *begin = data->step_begin;
    data->solver->even = begin->even;
    if (data->falling) pliant_falling_back(begin->falling, data->falling);
    return put(model, data, &begin->step);
}

/* Tools to where they are as the part ends, and what they pull tissue to as far. Those that have jumped are there at once. */
static void go(const pliant_model *model, pliant_data *data, const pliant_substeps *parts)
{
    const double share = (double)parts->at / parts->count;
    data->parts = parts->count;
    data->solver->reserved = parts->left * (1 - share);
    for (int t = 0; t < data->num_tools && parts->most > 1; t++) {
        const pliant_tool *end = data->step_begin->contact.tools + t; /* where it was set to, and from where */
        pliant_tool *tool = data->tools + t;
        pliant_handle *handle = handle_of(data, t);
        pliant_contact_go(model, end, share, tool);
        for (int d = 0; d < 3 && pliant_handle_is_spring(handle); d++) handle->target[d] = parts->target[t][d] + (tool->tip[d] - end->tip[d]);
    }
}

void pliant_substeps_begin(const pliant_model *model, pliant_data *data, pliant_substeps *parts)
{
    *parts = (pliant_substeps){.count = 1, .at = 1, .most = 1, .left = 1};
    data->parts = 1;
    if (!data->solver) return;
    data->solver->spent = data->solver->reserved = 0;
    const bool far = pliant_contact_goes_far(model, data);
    if (!(far || pliant_contact_presses(model, data)) || !keep(model, data)) return;
    parts->kept = true;
    if (!far || !keep_all(data)) return;
    parts->most = MOST;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) memcpy(parts->target[t], handle_of(data, t)->target, sizeof parts->target[t]);
    while (parts->count < parts->most && pliant_contact_turn(model, data) > parts->count) parts->count *= 2;
    if (parts->count > 1) go(model, data, parts);
}

void pliant_substeps_found(pliant_data *data, pliant_substeps *parts)
{
    parts->kept = parts->kept && pliant_contacts_copy(&data->contacts, &data->step_begin->part.points) == PLIANT_OK;
}

bool pliant_substeps_next(const pliant_model *model, pliant_data *data, pliant_substeps *parts)
{
    if (parts->at == parts->count) return false;
    pliant_contact_end(data);
    if (data->falling) (void)pliant_falling_step(data); /* of quasi-static solvers: nothing to take anew */
    parts->at++;
    take(model, data, &data->step_begin->part);
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
    pliant_status status = pliant_contact_again(&data->step_begin->contact, data);
    if (status == PLIANT_OK) status = go_back(model, data);
    if (status < 0) return status;
    copy(data, &data->step_begin->step, &data->step_begin->part);
    parts->at = 1;
    parts->left = solver->budget > 0 ? fmax(1 - solver->spent / solver->budget, 0) : 1;
    go(model, data, parts);
    return PLIANT_OK;
}

pliant_contact_start pliant_substeps_start(pliant_data *data, const pliant_substeps *parts)
{
    if (!parts->kept) return (pliant_contact_start){.positions = data->positions, .points = &data->contacts};
    return (pliant_contact_start){.positions = data->step_begin->part.positions, .points = &data->step_begin->part.points};
}

/* false: there is no memory for it */
static bool reserve_end(const pliant_data *data, placed *end, int32_t points)
{
    return reserve_placed(data, end) && pliant_contacts_reserve(&end->points, points) == PLIANT_OK;
}

bool pliant_substeps_here(const pliant_model *model, pliant_data *data, pliant_substeps_end which)
{
    placed *end = data->step_begin->ended + which;
    if (!reserve_end(data, end, data->contacts.count) || pliant_contacts_copy(&data->contacts, &end->points) != PLIANT_OK) return false;
    take(model, data, end);
    end->told = data->statistics;
    return true;
}

pliant_status pliant_substeps_there(const pliant_model *model, pliant_data *data, pliant_substeps_end which)
{
    const pliant_statistics *told = &data->step_begin->ended[which].told;
    pliant_statistics *statistics = &data->statistics;
    statistics->error = told->error;
    statistics->error_before = told->error_before;
    statistics->residual = told->residual;
    statistics->residual_force = told->residual_force;
    statistics->penetration = told->penetration;
    statistics->contacts = told->contacts;
    statistics->patched = told->patched;
    statistics->patch_iterations = told->patch_iterations;
    statistics->patch_residual = told->patch_residual;
    statistics->patch_moved = told->patch_moved;
    pliant_contacts_exchange(&data->contacts, &data->step_begin->ended[which].points);
    const pliant_status status = put(model, data, data->step_begin->ended + which);
    pliant_pull_report(data); /* what tools feel there */
    return status;
}

bool pliant_substeps_can_go_back(pliant_data *data)
{
    return reserve_end(data, data->step_begin->ended + PLIANT_ENDED_LAST, data->step_begin->part.points.count);
}

pliant_status pliant_substeps_back(const pliant_model *model, pliant_data *data)
{
    struct pliant_step_begin *begin = data->step_begin;
    placed *last = begin->ended + PLIANT_ENDED_LAST;
    take(model, data, last);
    last->told = data->statistics;
    pliant_contacts_exchange(&data->contacts, &last->points);
    (void)pliant_contacts_copy(&begin->part.points, &data->contacts); /* there is room */
    return put(model, data, &begin->part);
}

void pliant_substeps_undo(const pliant_model *model, pliant_data *data, const pliant_substeps *parts)
{
    data->parts = 1;
    if (parts->most <= 1) return;
    pliant_contact_undo(&data->step_begin->contact, data);
    (void)go_back(model, data);
}

static double volume_of(const double *x, const int32_t *node)
{
    double edge[3][3], volume = 0;
    for (int v = 0; v < 3; v++)
        for (int d = 0; d < 3; d++) edge[v][d] = x[3 * (size_t)node[v + 1] + (size_t)d] - x[3 * (size_t)node[0] + (size_t)d];
    for (int d = 0; d < 3; d++) volume += edge[0][d] * (edge[1][(d + 1) % 3] * edge[2][(d + 2) % 3] - edge[1][(d + 2) % 3] * edge[2][(d + 1) % 3]);
    return volume;
}

static int32_t count_turned(const pliant_data *data, const double *before)
{
    const pliant_mesh *mesh = &data->body->fine;
    int32_t count = 0;
    for (int32_t t = 0; t < mesh->num_tets; t++) {
        const int32_t *node = mesh->tets + 4 * (size_t)t;
        count += volume_of(data->positions, node) <= 0 && volume_of(before, node) > 0;
    }
    return count;
}

bool pliant_substeps_turned(const pliant_data *data) { return count_turned(data, data->step_begin->step.positions) > 0; }
int32_t pliant_substeps_turn_over(const pliant_data *data) { return count_turned(data, data->step_begin->part.positions); }

void pliant_substeps_free(pliant_data *data)
{
    if (!data->step_begin) return;
    placed *const all[] = {&data->step_begin->part, &data->step_begin->step, data->step_begin->ended, data->step_begin->ended + 1};
    _Static_assert(PLIANT_ENDS == 2, "all of them are freed");
    pliant_contact_kept_free(&data->step_begin->contact);
    pliant_falling_kept_free(data->step_begin->falling);
    for (size_t n = 0; n < sizeof all / sizeof *all; n++) {
        pliant_free(all[n]->points.point);
        pliant_free(all[n]->positions);
        pliant_free(all[n]->solved);
    }
    pliant_free(data->step_begin);
}
