/* Save the simulation state. */
#include "sim/step/state.h"

#include "backend/backend.h"
#include "base/fail.h"
#include "base/memory.h"
#include "sim/step/contact.h"
#include "tool/tool.h"

#include <string.h>

pliant_status pliant_state_create(pliant_state **out)
{
    pliant_state *state = pliant_calloc(1, sizeof *state);
    if (!state) return pliant_fail_memory("the simulation state");
    *out = state;
    return PLIANT_OK;
}

static void free_contact(pliant_state_contact *contact)
{
    pliant_data shell = {.contacts = contact->points, .contact_search = contact->search};
    pliant_contact_free(&shell);
}

/* Release topologies and shapes. */
static void release(pliant_state *state)
{
    for (int t = 0; t < state->num_tools; t++) pliant_tool_shape_free(&state->tools[t].shape);
    for (size_t b = 0; b < state->undo.count; b++) pliant_body_release(state->undo.at[b]);
    if (state->body) pliant_body_release(state->body);
    state->body = NULL;
    state->num_tools = 0;
    state->undo.count = 0;
}

void pliant_state_clear(pliant_state *state)
{
    release(state);
    for (int c = 0; c < 2; c++) free_contact(state->contact + c);
#define FREE_ARRAY(type, name) pliant_free((void *)state->name.at);
    PLIANT_STATE_ARRAYS(FREE_ARRAY)
#undef FREE_ARRAY
    memset(state, 0, sizeof *state);
}

void pliant_state_free(pliant_state *state)
{
    if (state) pliant_state_clear(state);
    pliant_free(state);
}

/* Copy the contacts to the second contact section. Errors: MEMORY. */
static pliant_status copy_contact(const pliant_data *data, pliant_state *state)
{
    pliant_state_contact *next = state->contact + 1;
    pliant_data shell = {.contacts = next->points, .contact_search = next->search};
    const pliant_status status = pliant_contact_copy(data, &shell);
    next->points = shell.contacts;
    next->search = shell.contact_search;
    return status;
}

static void swap_contact(pliant_state *state)
{
    const pliant_state_contact contact = state->contact[0];
    state->contact[0] = state->contact[1];
    state->contact[1] = contact;
}

/* Copy the tools' scalars; their arrays are in the state's arrays. */
static void copy_tools(const pliant_data *data, pliant_state *state)
{
    state->num_tools = data->num_tools;
    for (int t = 0; t < data->num_tools; t++) {
        pliant_tool *tool = state->tools + t;
        pliant_edge *edge = &tool->blade.edge;
        *tool = data->tools[t];
        pliant_tool_shape_retain(&tool->shape);
        tool->held = NULL;
        tool->weight = NULL;
        *edge = (pliant_edge){.count = edge->count, .reach = edge->reach};
    }
}

static void copy_undo(const pliant_undo *from, pliant_state *state)
{
    state->undo.count = (size_t)from->count;
    for (int32_t b = 0; b < from->count; b++) state->undo.at[b] = pliant_body_retain(from->body[b]);
    state->undo_tool = from->tool;
    state->undo_stroke = from->stroke;
    state->undo_reported = from->reported;
}

static bool reserve(pliant_state *state, pliant_data *data, const pliant_state_parts *parts)
{
    if (parts->topology && !pliant_state_reserve_undo(state, (size_t)data->undo.count)) return false;
    return pliant_state_arrays(state, data, parts->tissue, PLIANT_STATE_RESERVE);
}

pliant_status pliant_state_save_parts(const pliant_model *model, pliant_data *data, const pliant_state_parts *parts,
                                      pliant_state *state)
{
    if (parts->tissue && data->backend->download) data->backend->download(model, data);
    if (!reserve(state, data, parts)) return pliant_fail_memory("the simulation state");
    const pliant_status status = copy_contact(data, state);
    if (status != PLIANT_OK) return status;
    const pliant_body *body = parts->topology ? pliant_body_retain(data->body) : NULL;
    release(state);
    swap_contact(state);
    state->model = data->model;
    state->body = body;
    state->last_revision = data->last_revision;
    (void)pliant_state_arrays(state, data, parts->tissue, PLIANT_STATE_SAVE);
    copy_tools(data, state);
    if (parts->topology) copy_undo(&data->undo, state);
    pliant_state_save_scalars(data, parts->tissue, state);
    return PLIANT_OK;
}
