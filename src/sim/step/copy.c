/* Another simulation in the state of one: to go on from there twice, or to go back to. */
#include "backend/backend.h"
#include "base/fail.h"
#include "fem/dynamics/tled.h"
#include "fem/rigid/falling.h"
#include "fem/quasistatic/solver.h"
#include "tool/tool.h"
#include "pliant/memory.h"
#include "scene/options.h"
#include "sim/step/contact.h"
#include "sim/step/cut.h"
#include "sim/step/held.h"
#include "warp/device.h"

#include <string.h>

static void copy_solver(pliant_data *from, pliant_data *to)
{
    const pliant_solver *solver = from->solver;
    memcpy(to->solver->now.x, solver->now.x, 3 * (size_t)solver->system->mesh->num_nodes * sizeof *solver->now.x);
    for (int32_t n = 0; solver->system->mesh == solver->system->fine && n < solver->system->mesh->num_nodes; n++) {
        const double *home = pliant_falling_home(from->falling, n); /* as the rest of the body expects it */
        if (home) memcpy(to->solver->now.x + 3 * (size_t)n, home, 3 * sizeof *home);
    }
    pliant_solver_moved(to->solver);
    to->backend->kind->limits(to, solver->rules.most_evaluations, solver->rules.tolerance);
}

/* tissue: of the same body now */
static pliant_status copy_tissue(const pliant_model *model, pliant_data *from, pliant_data *to)
{
    const pliant_body *body = to->discretization->body;
    memcpy(to->positions, from->positions, 3 * (size_t)body->fine.num_nodes * sizeof *to->positions);
    pliant_body_map map = {0};
    pliant_status status = pliant_body_map_create(from->discretization->body, body, &map);
    pliant_falling *falling = NULL;
    if (status == PLIANT_OK) status = pliant_falling_create(&model->scene, body, to->positions, from->falling, &map, &falling);
    if (status == PLIANT_OK) {
        pliant_falling_free(to->falling);
        to->falling = falling;
        if (to->solver) copy_solver(from, to);
        else pliant_tled_carry(to->tled, from->tled, &map);
        if (to->tled && falling && body->has_inertia && !to->tled->own_inverse_mass) status = pliant_tled_may_stop(to->tled);
    }
    pliant_body_map_free(&map);
    return status;
}

static pliant_status copy_tools(const pliant_data *from, pliant_data *to)
{
    pliant_status status = PLIANT_OK;
    for (int t = 0; t < from->num_tools && status == PLIANT_OK; t++) {
        pliant_tool *tool = to->tools + t;
        to->num_tools = t + 1;
        status = pliant_tool_carry(tool, from->tools + t, from, to->body, to->positions);
        if (status == PLIANT_OK && to->solver && tool->holding && tool->attached)
            status = pliant_solver_carry_hold(to->solver, from->solver, t, tool->num_held, tool->held, tool->weight, to->positions, tool->force);
    }
    return status;
}

static pliant_status copy_undo(const pliant_undo *from, int32_t room, pliant_undo *to)
{
    if (from->count == 0) return PLIANT_OK;
    *to = *from;
    if (!(to->body = pliant_calloc((size_t)room, sizeof *to->body))) {
        to->count = 0;
        return pliant_fail_memory("what a cut can be undone by");
    }
    for (int32_t b = 0; b < from->count; b++) to->body[b] = pliant_body_retain(from->body[b]);
    return PLIANT_OK;
}

/* Meshes, voxels and factors are shared with the model by address: even a model of the same scene has others. */
static pliant_status check_model(const pliant_model *model, const pliant_data *from)
{
    if (from->model == model) return PLIANT_OK;
    char names[256];
    const bool differ = pliant_scene_differs(&model->scene, &from->model->scene, names, sizeof names);
    return pliant_fail(PLIANT_ERROR_ARGUMENT, "the state is of another model (%s): build the model once, and create both simulations from it",
                       differ ? names : "of the same options");
}

static pliant_status copy_for(const pliant_model *model, pliant_data *from, pliant_account *account, pliant_data **out)
{
    pliant_data *to = NULL;
    if (check_model(model, from) != PLIANT_OK) return PLIANT_ERROR_ARGUMENT;
    if (from->backend->download) from->backend->download(model, from);
    pliant_status status = pliant_data_create_for(model, account, &to);
    if (status != PLIANT_OK) return status;
    pliant_account *before = pliant_held_begin(to);
    memcpy(to->gravity, from->gravity, sizeof to->gravity);
    status = pliant_data_set_body(model, to, from->body);
    if (status == PLIANT_OK) status = copy_tissue(model, from, to);
    if (status == PLIANT_OK) status = copy_tools(from, to);
    if (status == PLIANT_OK) status = copy_undo(&from->undo, model->scene.cut.undo, &to->undo);
    if (status == PLIANT_OK) status = pliant_contact_copy(from, to);
    if (status == PLIANT_OK) status = pliant_backend_restart(model, to);
    if (status >= 0) {
        to->last_revision = from->last_revision;
        to->background.kind = from->background.kind;
        to->statistics = from->statistics;
    }
    pliant_held_end(to, before);
    if (status >= 0) *out = to;
    else pliant_data_free(to);
    return status < 0 ? status : PLIANT_OK;
}

pliant_status pliant_data_copy(const pliant_model *model, pliant_data *data, pliant_data **out)
{
    pliant_account *account = pliant_account_open();
    const pliant_status status = account ? copy_for(model, data, account, out) : pliant_fail_memory("the simulation state");
    pliant_account_close(account);
    return status;
}

pliant_status pliant_data_take(const pliant_model *model, pliant_data *data, pliant_data *from)
{
    if (check_model(model, data) != PLIANT_OK) return PLIANT_ERROR_ARGUMENT;
    pliant_data *made = NULL;
    pliant_warp_next *warp = NULL;
    pliant_account *before = pliant_held_begin(data);
    pliant_status status = copy_for(model, from, data->account, &made);
    if (status == PLIANT_OK && data->warp) status = pliant_warp_prepare(data->warp, made->discretization->body, &warp);
    if (status == PLIANT_OK) {
        pliant_data old = *data;
        if (warp) pliant_warp_take(old.warp, warp);
        made->warp = old.warp;
        old.warp = NULL;
        if (old.last_revision > made->last_revision) made->last_revision = old.last_revision; /* no two bodies share one */
        *data = *made;
        *made = old;
    }
    pliant_warp_next_free(warp);
    pliant_data_free(made);
    pliant_held_end(data, before);
    return status;
}
