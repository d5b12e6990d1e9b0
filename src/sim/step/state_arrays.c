#include "sim/step/state.h"

#include "backend/backend.h"
#include "base/buffer.h"
#include "fem/dynamics/tled_pressure.h"
#include "fem/patch/patch.h"
#include "fem/quasistatic/solver.h"

#include <string.h>

typedef struct transfer {
    pliant_state_transfer operation;
    bool succeeds;
    int num_threads;
} transfer;

/* Copy with several threads if there are many bytes. */
static void copy(const transfer *work, void *to, const void *from, size_t bytes)
{
    const size_t part = (size_t)1 << 18; /* bytes that one thread copies */
    const int32_t parts = (int32_t)((bytes + part - 1) / part);
#pragma omp parallel for schedule(static) num_threads(work->num_threads) if (parts > 1)
    for (int32_t p = 0; p < parts; p++) {
        const size_t at = part * (size_t)p;
        memcpy((char *)to + at, (const char *)from + at, bytes - at < part ? bytes - at : part);
    }
}

/* @param at, count, capacity the state's array, its size and its capacity; @param elements, number the simulation's
 *   array and its size */
static void move(transfer *work, void *at, size_t *count, size_t *capacity, size_t size, void *elements, size_t number)
{
    void *array; /* `at` points to a pointer of any type */
    memcpy(&array, at, sizeof array);
    switch (work->operation) {
    case PLIANT_STATE_RESERVE:
        if (number <= *capacity || !work->succeeds) return;
        work->succeeds = pliant_grow(at, number, size);
        if (work->succeeds) *capacity = number;
        return;
    case PLIANT_STATE_SAVE:
        *count = number;
        if (number > 0 && elements) copy(work, array, elements, number * size);
        return;
    case PLIANT_STATE_COMPARE:
        work->succeeds = work->succeeds && *count == number;
        return;
    case PLIANT_STATE_RESTORE:
        if (number > 0 && elements) copy(work, elements, array, number * size);
        return;
    }
}
#define MOVE(name, elements, number) \
    move(work, &state->name.at, &state->name.count, &state->name.capacity, sizeof *state->name.at, elements, \
         (size_t)(number))

static void move_dynamics(transfer *work, pliant_state *state, pliant_data *data)
{
    pliant_tled *tled = data->tled;
    const int32_t nodes = tled ? 3 * data->body->fine.num_nodes : 0;
    const size_t blocks = tled && tled->memory ? (size_t)pliant_tled_blocks(tled->system) : 0;
    MOVE(displacement, tled ? tled->u : NULL, nodes);
    MOVE(increment, tled ? tled->d : NULL, nodes);
    MOVE(relaxed, blocks > 0 ? &tled->memory[0][0][0] : NULL, blocks * 6 * PLIANT_PRONY_TERMS * LANES);
}

static void move_pieces(transfer *work, pliant_state *state, pliant_data *data)
{
    pliant_rigid_pieces *rigid_pieces = data->rigid_pieces;
    const pliant_pieces *pieces = rigid_pieces ? rigid_pieces->body->pieces : NULL;
    const int32_t nodes = pieces ? 3 * pieces->start[pieces->count] : 0;
    MOVE(pieces, rigid_pieces ? rigid_pieces->pieces : NULL, pieces ? pieces->count : 0);
    MOVE(piece_positions, rigid_pieces ? rigid_pieces->x : NULL, nodes);
    MOVE(piece_home, rigid_pieces ? rigid_pieces->detachment_positions : NULL, nodes);
    MOVE(joints, rigid_pieces && pieces->num_joints > 0 ? rigid_pieces->joint_at[0] : NULL,
         pieces ? 3 * pieces->num_joints : 0);
    if (work->operation == PLIANT_STATE_RESERVE || work->operation == PLIANT_STATE_SAVE)
        MOVE(grips, rigid_pieces ? rigid_pieces->grips : NULL, rigid_pieces ? rigid_pieces->num_grips : 0);
    else if (rigid_pieces && state->grips.count <= MAX_GRIPS) MOVE(grips, rigid_pieces->grips, state->grips.count);
    else work->succeeds = work->succeeds && state->grips.count == 0;
}

/* Gather the arrays of all tools, one tool after the other. */
static void gather_tools(pliant_state *state, const pliant_data *data)
{
    size_t h = 0, p = 0;
    for (int t = 0; t < data->num_tools; t++) {
        const pliant_tool *tool = data->tools + t;
        const pliant_edge *edge = &tool->blade.edge;
        const size_t held = (size_t)tool->num_held, points = (size_t)edge->count;
        if (held > 0) {
            memcpy(state->held.at + h, tool->held, held * sizeof *tool->held);
            memcpy(state->held_weight.at + h, tool->weight, held * sizeof *tool->weight);
        }
        if (points > 0) {
            memcpy(state->edge_place.at + 3 * p, edge->place, 3 * points * sizeof *edge->place);
            memcpy(state->edge_now.at + 3 * p, edge->now, 3 * points * sizeof *edge->now);
            memcpy(state->edge_tet.at + p, edge->tet, points * sizeof *edge->tet);
            memcpy(state->edge_weight.at + 4 * p, edge->weight, 4 * points * sizeof *edge->weight);
            memcpy(state->edge_carrier.at + p, edge->carrier, points * sizeof *edge->carrier);
            memcpy(state->edge_carrier_offset.at + 3 * p, edge->carrier_offset,
                   3 * points * sizeof *edge->carrier_offset);
        }
        h += held;
        p += points;
    }
    state->held.count = state->held_weight.count = h;
    state->edge_tet.count = state->edge_carrier.count = p;
    state->edge_place.count = state->edge_now.count = state->edge_carrier_offset.count = 3 * p;
    state->edge_weight.count = 4 * p;
}

static void reserve_tools(transfer *work, pliant_state *state, const pliant_data *data)
{
    size_t held = 0, points = 0;
    for (int t = 0; t < data->num_tools; t++) {
        held += (size_t)data->tools[t].num_held;
        points += (size_t)data->tools[t].blade.edge.count;
    }
    MOVE(held, NULL, held);
    MOVE(held_weight, NULL, held);
    MOVE(edge_place, NULL, 3 * points);
    MOVE(edge_now, NULL, 3 * points);
    MOVE(edge_tet, NULL, points);
    MOVE(edge_weight, NULL, 4 * points);
    MOVE(edge_carrier, NULL, points);
    MOVE(edge_carrier_offset, NULL, 3 * points);
}

static void move_tissue(transfer *work, pliant_state *state, pliant_data *data)
{
    MOVE(positions, data->positions, 3 * data->body->fine.num_nodes);
    MOVE(solved, data->solver ? data->solver->now.x : NULL,
         data->solver ? 3 * data->solver->system->mesh->num_nodes : 0);
    const pliant_pressures *pressures = data->solver ? data->solver->pressures : NULL;
    const pliant_tled_pressure *dynamic = data->tled ? data->tled->pressure_of_groups : NULL;
    MOVE(pressure, pressures ? data->solver->now.pressure : dynamic ? dynamic->state : NULL,
         pressures ? pressures->count : dynamic ? 2 * dynamic->groups->count : 0);
    move_dynamics(work, state, data);
    move_pieces(work, state, data);
}

bool pliant_state_arrays(pliant_state *state, pliant_data *data, bool tissue, pliant_state_transfer operation)
{
    transfer only = {.operation = operation,
                     .succeeds = true,
                     .num_threads = data->discretization->system->num_threads},
             *work = &only;
    if (tissue) move_tissue(work, state, data);
    if (operation == PLIANT_STATE_RESERVE) reserve_tools(work, state, data);
    if (operation == PLIANT_STATE_SAVE) gather_tools(state, data);
    return only.succeeds;
}

bool pliant_state_reserve_undo(pliant_state *state, size_t count)
{
    transfer only = {.operation = PLIANT_STATE_RESERVE, .succeeds = true}, *work = &only;
    MOVE(undo, NULL, count);
    return only.succeeds;
}

void pliant_state_copy_grasp(const pliant_state *state, int tool, int32_t *held, double *weight)
{
    size_t h = 0;
    const size_t count = (size_t)state->tools[tool].num_held;
    for (int t = 0; t < tool; t++) h += (size_t)state->tools[t].num_held;
    if (count == 0) return;
    memcpy(held, state->held.at + h, count * sizeof *held);
    memcpy(weight, state->held_weight.at + h, count * sizeof *weight);
}

void pliant_state_copy_edge(const pliant_state *state, int tool, pliant_edge *edge)
{
    size_t p = 0;
    const size_t count = (size_t)state->tools[tool].blade.edge.count;
    for (int t = 0; t < tool; t++) p += (size_t)state->tools[t].blade.edge.count;
    if (count == 0) return;
    memcpy(edge->place, state->edge_place.at + 3 * p, 3 * count * sizeof *edge->place);
    memcpy(edge->now, state->edge_now.at + 3 * p, 3 * count * sizeof *edge->now);
    memcpy(edge->tet, state->edge_tet.at + p, count * sizeof *edge->tet);
    memcpy(edge->weight, state->edge_weight.at + 4 * p, 4 * count * sizeof *edge->weight);
    memcpy(edge->carrier, state->edge_carrier.at + p, count * sizeof *edge->carrier);
    memcpy(edge->carrier_offset, state->edge_carrier_offset.at + 3 * p, 3 * count * sizeof *edge->carrier_offset);
}

/* ---- scalars */

void pliant_state_save_scalars(const pliant_data *data, bool tissue, pliant_state *state)
{
    const pliant_tled *tled = data->tled;
    memcpy(state->gravity, data->gravity, sizeof state->gravity);
    state->background = data->background.kind;
    state->statistics = data->statistics;
    for (int t = 0; data->solver && t < PLIANT_MAX_TOOLS; t++)
        memcpy(state->grasp_force[t], pliant_patch_solver(data, t)->grasps[t].force, sizeof state->grasp_force[t]);
    if (data->solver) {
        state->iterations = data->solver->rules.max_evaluations;
        state->tolerance = data->solver->rules.tolerance;
        if (tissue)
            pliant_rigid_pieces_set_detachment_positions(data->rigid_pieces, data->solver->system, state->solved.at);
    }
    if (tled) {
        pliant_state_dynamics *out = &state->dynamics;
        state->iterations = tled->substeps;
        state->tolerance = tled->tolerance;
        out->substeps = tled->substeps;
        out->halvings = tled->halvings;
        out->time_step = tled->time_step;
        out->previous_time_step = tled->previous_time_step;
        memcpy(out->target, tled->target, sizeof out->target);
        memcpy(out->previous_point, tled->previous_point, sizeof out->previous_point);
        memcpy(out->previous_target, tled->previous_target, sizeof out->previous_target);
        memcpy(out->quotient, tled->quotient, sizeof out->quotient);
        out->contact_energy = tled->contact_energy;
        out->tool_work = tled->tool_work;
    }
    if (data->rigid_pieces) {
        memcpy(state->pieces_gravity, data->rigid_pieces->gravity, sizeof state->pieces_gravity);
        state->pieces_reported = data->rigid_pieces->reported;
    }
}

static void put_dynamics(const pliant_state *state, pliant_tled *tled)
{
    const pliant_state_dynamics *from = &state->dynamics;
    tled->substeps = from->substeps;
    tled->halvings = from->halvings;
    tled->time_step = from->time_step;
    tled->tolerance = state->tolerance;
    tled->previous_time_step = from->previous_time_step;
    memcpy(tled->target, from->target, sizeof tled->target);
    memcpy(tled->previous_point, from->previous_point, sizeof tled->previous_point);
    memcpy(tled->previous_target, from->previous_target, sizeof tled->previous_target);
    memcpy(tled->quotient, from->quotient, sizeof tled->quotient);
    tled->contact_energy = from->contact_energy;
    tled->tool_work = from->tool_work;
}

/* Stop the nodes of pieces that have left the volume. */
static void stop_pieces(const pliant_state *state, pliant_data *data)
{
    const pliant_pieces *pieces = data->rigid_pieces ? data->rigid_pieces->body->pieces : NULL;
    for (int32_t p = 0; pieces && data->tled->own_inverse_mass && p < pieces->count; p++)
        if (state->pieces.at[p].has_left_view)
            pliant_tled_fix_nodes(data->tled, pieces->start[p + 1] - pieces->start[p], pieces->node + pieces->start[p]);
}

void pliant_state_restore_tissue(const pliant_state *state, pliant_data *data)
{
    if (data->tled) stop_pieces(state, data);
    /* RESTORE does not write to the state */
    (void)pliant_state_arrays((pliant_state *)state, data, true, PLIANT_STATE_RESTORE);
    memcpy(data->gravity, state->gravity, sizeof data->gravity);
    data->statistics = state->statistics;
    if (data->tled) put_dynamics(state, data->tled);
    if (data->solver) pliant_solver_reset_after_move(data->solver);
    if (!data->rigid_pieces) return;
    memcpy(data->rigid_pieces->gravity, state->pieces_gravity, sizeof data->rigid_pieces->gravity);
    data->rigid_pieces->num_grips = (int)state->grips.count;
    data->rigid_pieces->reported = state->pieces_reported;
}
