/* Creation and destruction of a simulation. */
#include "backend/backend.h"
#include "base/fail.h"
#include "base/buffer.h"
#include "fem/patch/patch.h"
#include "fem/dynamics/tled.h"
#include "fem/rigid/rigid_pieces.h"
#include "fem/quasistatic/solver.h"
#include "tool/clearance.h"
#include "tool/tool.h"
#include "base/memory.h"
#include "sim/step/contact.h"
#include "sim/step/cut.h"
#include "sim/build/discretization.h"
#include "sim/step/accounting.h"
#include "sim/step/state.h"
#include "sim/step/legs.h"

#include <string.h>

void pliant_undo_clear(pliant_data *data)
{
    pliant_undo *undo = &data->undo;
    for (int32_t b = 0; b < undo->count; b++) pliant_body_release(undo->body[b]);
    pliant_free(undo->body);
    memset(undo, 0, sizeof *undo);
}

static pliant_status fill(const pliant_model *model, pliant_data *data)
{
    data->model = model;
    data->body = pliant_body_retain(model->body);
    data->discretization = pliant_discretization_retain(model->discretization);
    data->last_revision = data->body->revision;
    if (!(data->clearance = pliant_clearance_create())) return pliant_fail_memory("the simulation state");
    data->fraction = 1;
    data->clock.budget = 1e-3 * model->scene.solver.budget_ms;
    data->positions = pliant_calloc_pages((size_t)data->body->fine.num_nodes, 3 * sizeof *data->positions);
    pliant_status status = data->positions ? pliant_host_solver_of(model)->create(model, data)
                                           : pliant_fail_memory("the simulation state");
    if (status != PLIANT_OK) return status;
    memcpy(data->positions, data->body->fine.rest, 3 * (size_t)data->body->fine.num_nodes * sizeof *data->positions);
    memcpy(data->gravity, model->scene.model.gravity, sizeof data->gravity);
    return pliant_backend_create(model, data);
}

pliant_status pliant_data_create_for(const pliant_model *model, pliant_account *account, pliant_data **out)
{
    pliant_account *before = pliant_account_use(account);
    pliant_data *data = pliant_calloc(1, sizeof *data);
    pliant_status status = data ? PLIANT_OK : pliant_fail_memory("the simulation state");
    if (status == PLIANT_OK) {
        data->account = pliant_account_retain(account);
        status = fill(model, data);
        data->statistics.bytes = pliant_account_bytes(account);
    }
    pliant_account_use(before);
    if (status == PLIANT_OK) *out = data;
    else pliant_data_free(data);
    return status;
}

pliant_status pliant_data_create(const pliant_model *model, pliant_data **out)
{
    pliant_account *account = pliant_account_open();
    const pliant_status status =
        account ? pliant_data_create_for(model, account, out) : pliant_fail_memory("the simulation state");
    pliant_account_close(account);
    return status;
}

void pliant_data_free(pliant_data *data)
{
    if (!data) return;
    pliant_account *account = data->account;
    if (data->backend_state) data->backend->free(data);
    for (int t = 0; t < data->num_tools; t++) pliant_tool_free(data->tools + t);
    pliant_undo_clear(data);
    pliant_patch_free(data->patch);
    pliant_solver_free(data->solver);
    pliant_tled_free(data->tled);
    pliant_rigid_pieces_free(data->rigid_pieces);
    pliant_warp_free(data->warp);
    pliant_discretization_release(data->discretization);
    pliant_body_release(data->body);
    pliant_contact_free(data);
    pliant_rollback_free(data->rollback);
    pliant_clearance_free(data->clearance);
    pliant_legs_free(data);
    pliant_free(data->positions);
    pliant_free(data->clock.reading);
    pliant_memory_change_reserve(-(int64_t)data->reserved_bytes);
    pliant_free(data);
    pliant_account_close(account);
}
