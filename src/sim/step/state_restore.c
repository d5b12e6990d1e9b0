/* Restore the simulation state: create a simulation as at load, set it to the state, and swap the two. So factors
 * and solver history start as after a load, and an error changes nothing. */
#include "sim/step/state.h"

#include "backend/backend.h"
#include "base/fail.h"
#include "contact/detect/part_contacts.h"
#include "fem/quasistatic/solver.h"
#include "base/memory.h"
#include "scene/options.h"
#include "sim/api/data.h"
#include "sim/step/contact.h"
#include "sim/step/accounting.h"
#include "tool/blade.h"
#include "warp/device.h"

#include <string.h>

/* A state refers to meshes, voxels and factors of its model by address, so a second model of the same scene does
 * not fit. */
static pliant_status check_model(const pliant_model *model, const pliant_model *from)
{
    if (from == model) return PLIANT_OK;
    char names[256];
    const bool differ = pliant_scene_differs(&model->scene, &from->scene, names, sizeof names);
    return pliant_fail(PLIANT_ERROR_ARGUMENT,
                       "the state is of another model (%s): build the model once, and create both simulations from it",
                       differ ? names : "of the same options");
}

pliant_status pliant_state_save(const pliant_model *model, pliant_data *data, pliant_state *state)
{
    const pliant_state_parts all = {.tissue = true, .topology = true};
    if (check_model(model, data->model) != PLIANT_OK) return PLIANT_ERROR_ARGUMENT;
    pliant_account *before = pliant_account_use(NULL); /* memory of a state is not accounted to a simulation */
    const pliant_status status = pliant_state_save_parts(model, data, &all, state);
    pliant_account_use(before);
    return status;
}

static pliant_status put_tool(const pliant_state *state, int t, pliant_data *made)
{
    pliant_tool *tool = made->tools + t;
    const int32_t count = state->tools[t].num_held;
    const pliant_edge edge = state->tools[t].blade.edge;
    *tool = state->tools[t];
    made->num_tools = t + 1;
    pliant_tool_shape_retain(&tool->shape);
    tool->num_held = 0; /* until the arrays are allocated */
    tool->blade.edge = (pliant_edge){.count = 0};
    pliant_status status = edge.count > 0 ? pliant_edge_create(edge.count, edge.reach, &tool->blade.edge) : PLIANT_OK;
    if (status != PLIANT_OK || count == 0) return status;
    tool->held = pliant_calloc((size_t)count, sizeof *tool->held);
    tool->weight = pliant_calloc((size_t)count, sizeof *tool->weight);
    if (!tool->held || !tool->weight) return pliant_fail_memory("a tool's hold");
    tool->num_held = count;
    return PLIANT_OK;
}

static pliant_status put_tools(const pliant_state *state, pliant_data *made)
{
    for (int t = 0; t < state->num_tools; t++) {
        pliant_status status = put_tool(state, t, made);
        if (status != PLIANT_OK) return status;
        pliant_tool *tool = made->tools + t;
        pliant_state_copy_grasp(state, t, tool->held, tool->weight);
        pliant_state_copy_edge(state, t, &tool->blade.edge);
        if (!made->solver || !tool->holding || !tool->attached) continue;
        status = pliant_solver_add_grasp(made->solver, t, tool->num_held, tool->held, tool->weight, made->positions);
        if (status != PLIANT_OK) return status;
        pliant_grasp_constraint *grasp = made->solver->grasps + t;
        grasp->by_force = pliant_tool_drive(tool) == PLIANT_DRIVE_FORCE;
        memcpy(grasp->force, state->grasp_force[t], sizeof grasp->force);
    }
    return PLIANT_OK;
}

static pliant_status put_undo(const pliant_state *state, int32_t capacity, pliant_undo *to)
{
    if (state->undo.count == 0) return PLIANT_OK;
    if (!(to->body = pliant_calloc((size_t)capacity, sizeof *to->body)))
        return pliant_fail_memory("the topologies to undo");
    for (size_t b = 0; b < state->undo.count; b++) to->body[b] = pliant_body_retain(state->undo.at[b]);
    to->count = (int32_t)state->undo.count;
    to->tool = state->undo_tool;
    to->stroke = state->undo_stroke;
    to->reported = state->undo_reported;
    return PLIANT_OK;
}

static pliant_status put_all(const pliant_model *model, const pliant_state *state, pliant_data *made)
{
    const pliant_data shell = {.contacts = state->contact[0].points, .contact_search = state->contact[0].search};
    pliant_status status = pliant_data_set_body(model, made, state->body);
    if (status != PLIANT_OK) return status;
    /* only a state from a file can differ */
    if (!pliant_state_arrays((pliant_state *)state, made, true, PLIANT_STATE_COMPARE))
        return pliant_fail(
            PLIANT_ERROR_FORMAT,
            "the simulation state belongs to another solver or mesh: build the model from the scene that it was saved "
            "with");
    pliant_state_restore_tissue(state, made);
    if (made->solver) made->backend->host_solver->limits(made, state->iterations, state->tolerance);
    status = put_tools(state, made);
    if (status == PLIANT_OK) status = put_undo(state, model->scene.cut.undo, &made->undo);
    if (status == PLIANT_OK) status = pliant_contact_copy(&shell, made);
    /* a state from a file has no search data */
    if (status == PLIANT_OK && !shell.contact_search) status = pliant_contacts_copy(&shell.contacts, &made->contacts);
    if (status == PLIANT_OK) status = pliant_backend_restart(model, made);
    made->last_revision = state->last_revision;
    made->background.kind = state->background;
    return status;
}

/* Create a simulation with that state. */
static pliant_status make(const pliant_model *model, const pliant_state *state, pliant_account *account,
                          pliant_data **out)
{
    pliant_data *made = NULL;
    pliant_status status = pliant_data_create_for(model, account, &made);
    if (status != PLIANT_OK) return status;
    pliant_account *before = pliant_accounting_begin(made);
    status = put_all(model, state, made);
    pliant_accounting_end(made, before);
    if (status >= 0) *out = made;
    else pliant_data_free(made);
    return status < 0 ? status : PLIANT_OK;
}

static pliant_status restore(const pliant_model *model, pliant_data *data, const pliant_state *state)
{
    pliant_data *made = NULL;
    pliant_warp_next *warp = NULL;
    pliant_status status = make(model, state, data->account, &made);
    if (status == PLIANT_OK && data->warp) status = pliant_warp_prepare(data->warp, made->discretization->body, &warp);
    if (status == PLIANT_OK) {
        pliant_data old = *data;
        if (warp) pliant_warp_take(old.warp, warp);
        made->warp = old.warp;
        made->rollback = old.rollback; /* its capacity */
        old.warp = NULL;
        old.rollback = NULL;
        if (old.last_revision > made->last_revision) made->last_revision = old.last_revision; /* revisions are unique */
        *data = *made;
        *made = old;
    }
    pliant_warp_next_free(warp);
    pliant_data_free(made);
    return status;
}

pliant_status pliant_state_restore(const pliant_model *model, pliant_data *data, const pliant_state *state)
{
    if (!state->body)
        return pliant_fail(PLIANT_ERROR_ARGUMENT,
                           "the state is empty: save a simulation to it first (pliant_state_save)");
    if (check_model(model, data->model) != PLIANT_OK || check_model(model, state->model) != PLIANT_OK)
        return PLIANT_ERROR_ARGUMENT;
    pliant_account *before = pliant_accounting_begin(data);
    const pliant_status status = restore(model, data, state);
    pliant_accounting_end(data, before);
    return status;
}

/* ---- another simulation */

pliant_status pliant_data_copy(const pliant_model *model, pliant_data *data, pliant_data **out)
{
    pliant_state *state = NULL;
    if (check_model(model, data->model) != PLIANT_OK) return PLIANT_ERROR_ARGUMENT;
    pliant_account *account = pliant_account_open();
    pliant_status status = account ? pliant_state_create(&state) : pliant_fail_memory("the simulation state");
    if (status == PLIANT_OK) status = pliant_state_save(model, data, state);
    if (status == PLIANT_OK) status = make(model, state, account, out);
    pliant_state_free(state);
    pliant_account_close(account);
    return status;
}

pliant_status pliant_data_move(const pliant_model *model, pliant_data *data, pliant_data *from)
{
    pliant_state *state = NULL;
    if (check_model(model, from->model) != PLIANT_OK) return PLIANT_ERROR_ARGUMENT;
    pliant_status status = pliant_state_create(&state);
    if (status == PLIANT_OK) status = pliant_state_save(model, from, state);
    if (status == PLIANT_OK) status = pliant_state_restore(model, data, state);
    pliant_state_free(state);
    return status;
}
