/* Restore the state at the start of a step that fails. */
#include "sim/step/state.h"

#include "backend/backend.h"
#include "base/fail.h"
#include "base/buffer.h"
#include "fem/patch/patch.h"
#include "fem/quasistatic/solver.h"
#include "base/memory.h"

#include <string.h>

/* Arrays of a grasp. A step frees them when the tissue slips out of the grasp. */
typedef struct spare { int32_t *held; double *weight; } spare;

struct pliant_rollback {
    pliant_state state;
    bool is_active;    /* in this step */
    bool is_after_cut; /* the step was the first one after a cut (pliant_solver.is_after_cut) */
    bool has_tissue;   /* the state contains the arrays of the tissue */
    spare spare[PLIANT_MAX_TOOLS];
};

/* Return whether a step may change the host's arrays. A GPU step does not before its end, unless the host moves
 * nodes itself or contact needs their positions. */
static bool may_change(const pliant_data *data)
{
    return data->backend->state_is_on_host || (data->solver && (pliant_host_moves_nodes(data) || data->contact_search));
}

static bool reserve_spares(pliant_rollback *rollback, const pliant_data *data)
{
    for (int t = 0; t < data->num_tools; t++) {
        spare *of = rollback->spare + t;
        const size_t count = (size_t)data->tools[t].num_held;
        if (!pliant_ensure(&of->held, count, sizeof *of->held) ||
            !pliant_ensure(&of->weight, count, sizeof *of->weight))
            return false;
    }
    return true;
}

pliant_status pliant_rollback_begin(const pliant_model *model, pliant_data *data)
{
    if (!data->rollback && !(data->rollback = pliant_calloc(1, sizeof *data->rollback)))
        return pliant_fail_memory("the rollback of a step");
    pliant_rollback *rollback = data->rollback;
    rollback->is_active = false;
    rollback->has_tissue = may_change(data);
    rollback->is_after_cut = data->solver && data->solver->is_after_cut;
    if (!reserve_spares(rollback, data)) return pliant_fail_memory("the rollback of a step");
    const pliant_state_parts parts = {.tissue = rollback->has_tissue};
    const pliant_status status = pliant_state_save_parts(model, data, &parts, &rollback->state);
    rollback->is_active = status == PLIANT_OK;
    return status;
}

static void undo_tool(pliant_rollback *rollback, pliant_data *data, int t)
{
    pliant_tool *tool = data->tools + t;
    const pliant_tool now = *tool;
    *tool = rollback->state.tools[t];
    tool->shape = now.shape;
    tool->blade.edge = now.blade.edge; /* only the cut stage changes it */
    tool->held = now.held;
    tool->weight = now.weight;
    if (now.num_held != tool->num_held) { /* the grasp has slipped off */
        spare *of = rollback->spare + t;
        pliant_free(now.held);
        pliant_free(now.weight);
        tool->held = of->held;
        tool->weight = of->weight;
        *of = (spare){.held = NULL};
    }
    pliant_state_copy_grasp(&rollback->state, t, tool->held, tool->weight);
}

bool pliant_rollback_find_positions(const pliant_data *data, const double **positions, const double **solved)
{
    const pliant_rollback *rollback = data->rollback;
    if (!rollback || !rollback->is_active || !rollback->has_tissue) return false;
    *positions = rollback->state.positions.at;
    *solved = rollback->state.solved.at;
    return true;
}

/* Restore a grasp force. All tools must be restored already. */
static void undo_pull(const pliant_state *state, pliant_data *data, int t)
{
    pliant_grasp_constraint *grasp = pliant_patch_solver(data, t)->grasps + t;
    data->tools[t].attached = data->tools[t].attached && grasp->active; /* otherwise the next step attaches it again */
    memcpy(grasp->force, state->grasp_force[t], sizeof grasp->force);
}

void pliant_rollback_undo(const pliant_model *model, pliant_data *data)
{
    pliant_rollback *rollback = data->rollback;
    if (!rollback || !rollback->is_active) return;
    rollback->is_active = false;
    pliant_state *state = &rollback->state;
    const pliant_state_contact contact = {.points = data->contacts, .search = data->contact_search};
    for (int t = 0; t < data->num_tools; t++) undo_tool(rollback, data, t);
    data->contacts = state->contact[0].points;
    data->contact_search = state->contact[0].search;
    state->contact[0] = contact;
    data->statistics = state->statistics;
    if (rollback->has_tissue) pliant_state_restore_tissue(state, data);
    if (data->solver) {
        data->solver->is_after_cut = rollback->is_after_cut;
        (void)pliant_solver_set_contacts(data->solver, NULL, NULL, NULL);
        for (int t = 0; t < data->num_tools; t++) undo_pull(state, data, t);
        if (rollback->has_tissue && pliant_patch_count_tools(data) > 0) pliant_patch_follow_move(data, data->positions);
    }
    (void)pliant_backend_restart(model, data); /* if this fails, the CPU continues */
}

void pliant_rollback_free(pliant_rollback *rollback)
{
    if (!rollback) return;
    pliant_state_clear(&rollback->state);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        pliant_free(rollback->spare[t].held);
        pliant_free(rollback->spare[t].weight);
    }
    pliant_free(rollback);
}
