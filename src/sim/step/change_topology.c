/* Adapt a simulation to another topology. The table at the end lists all data that depend on the topology. First,
 * every entry prepares its data in a second pliant_data that nothing reads. Then the two are swapped, which cannot
 * fail, and the old data are freed. If all nodes stay, the new positions are appended to the old array. Growing it
 * may move the array in memory, also when the cut fails later. */
#include "backend/backend.h"
#include "base/fail.h"
#include "base/buffer.h"
#include "fem/dynamics/tled.h"
#include "fem/rigid/rigid_pieces.h"
#include "fem/patch/patch.h"
#include "fem/quasistatic/solver.h"
#include "sim/api/data.h"
#include "tool/tool.h"
#include "base/memory.h"
#include "sim/build/discretization.h"
#include "sim/step/accounting.h"
#include "warp/device.h"

#include <string.h>

typedef struct adaptation {
    const pliant_model *model;
    pliant_data *data, *made;
    pliant_body_map map;
    pliant_warp_next **warp;
} adaptation;

/* ---- discretization */

static pliant_status prepare_discretization(const adaptation *work)
{
    const pliant_discretization *load = work->model->discretization;
    if (!pliant_body_same(work->made->body, load->body))
        return pliant_discretization_next(&work->model->scene, work->data->discretization, work->made->body, &work->map,
                                          &work->made->discretization);
    work->made->discretization = pliant_discretization_retain(load);
    return PLIANT_OK;
}

static void swap_discretization(const adaptation *work)
{
    const pliant_discretization *old = work->data->discretization;
    work->data->discretization = work->made->discretization;
    work->made->discretization = old;
}

/* ---- positions and detached pieces. Nodes that leave a piece return to their home positions, where the rest of the
 * topology expects them. */

static pliant_status prepare_positions(const adaptation *work)
{
    pliant_data *data = work->data, *made = work->made;
    const int32_t nodes = made->body->fine.num_nodes;
    /* positions of added nodes are appended to the array */
    const bool stay = work->map.num_same == data->discretization->body->fine.num_nodes && !data->rigid_pieces;
    if (stay && !pliant_grow(&data->positions, (size_t)nodes, 3 * sizeof *data->positions))
        return pliant_fail_memory("the simulation state");
    double *positions = made->positions = stay ? data->positions : pliant_calloc((size_t)nodes, 3 * sizeof *positions);
    if (!positions) return pliant_fail_memory("the simulation state");
    pliant_body_map_vectors(&work->map, data->positions, positions);
    pliant_status status = pliant_rigid_pieces_create(&work->model->scene, made->discretization->body, positions,
                                                      data->rigid_pieces, &work->map, &made->rigid_pieces);
    for (int32_t n = 0; status == PLIANT_OK && data->rigid_pieces && n < nodes; n++) {
        const double *home = pliant_rigid_pieces_contain(made->rigid_pieces, n)
                                 ? NULL
                                 : pliant_rigid_pieces_detachment_position(data->rigid_pieces, work->map.node[n]);
        if (home) memcpy(positions + 3 * n, home, 3 * sizeof *positions);
    }
    return status;
}

static void swap_positions(const adaptation *work)
{
    double *positions = work->data->positions;
    pliant_rigid_pieces *rigid_pieces = work->data->rigid_pieces;
    work->data->positions = work->made->positions;
    work->data->rigid_pieces = work->made->rigid_pieces;
    work->made->positions = positions != work->data->positions ? positions : NULL;
    work->made->rigid_pieces = rigid_pieces;
}

/* After an error, shrink the array of positions to its previous size. */
static void restore_positions_capacity(const adaptation *work)
{
    if (!work->made->positions || work->made->positions != work->data->positions) return;
    work->made->positions = NULL;
    pliant_grow(&work->data->positions, (size_t)work->data->body->fine.num_nodes, 3 * sizeof *work->data->positions);
}

/* ---- state of the solver, explicit dynamics and patches; patches start again */

static pliant_status prepare_state(const adaptation *work)
{
    pliant_data *data = work->data, *made = work->made;
    if (data->backend->download && !pliant_positions_are_state(data)) data->backend->download(work->model, data);
    if (data->solver)
        pliant_rigid_pieces_set_detachment_positions(data->rigid_pieces, data->solver->system, data->solver->now.x);
    pliant_status status = data->backend->host_solver->carry_over_cut(work->model, data, &work->map, made);
    for (int32_t n = 0; status == PLIANT_OK && made->tled && n < made->body->fine.num_nodes; n++) {
        const double *home = pliant_rigid_pieces_contain(made->rigid_pieces, n)
                                 ? NULL
                                 : pliant_rigid_pieces_detachment_position(data->rigid_pieces, work->map.node[n]);
        if (home) pliant_tled_set_node_position(made->tled, n, home);
    }
    return status == PLIANT_OK && made->tled && made->rigid_pieces && made->body->has_inertia
               ? pliant_tled_allow_stop(made->tled)
               : status;
}

static void swap_state(const adaptation *work)
{
    pliant_data *data = work->data, *made = work->made;
    pliant_solver *solver = data->solver;
    pliant_tled *tled = data->tled;
    pliant_patch *patch = data->patch;
    data->solver = made->solver;
    data->tled = made->tled;
    data->patch = made->patch;
    made->solver = solver;
    made->tled = tled;
    made->patch = patch;
    if (solver) pliant_solver_take_over(data->solver, solver);
    if (!data->patch || !patch) return;
    pliant_patch_replace(data->patch, patch);
    made->patch = NULL;
}

/* ---- grasps */

static pliant_status prepare_tools(const adaptation *work)
{
    pliant_data *data = work->data, *made = work->made;
    pliant_status status = PLIANT_OK;
    for (int t = 0; t < data->num_tools && status == PLIANT_OK; t++) {
        pliant_tool *tool = made->tools + t;
        made->num_tools = t + 1; /* on an error this many tools are freed */
        status = pliant_tool_transfer(&work->model->scene, tool, data->tools + t, data, made->body, made->positions);
        if (status == PLIANT_OK && made->solver && tool->holding && tool->attached)
            status = pliant_solver_carry_grasp(made->solver, data->solver, t, tool->num_held, tool->held, tool->weight,
                                               made->positions, tool->force);
    }
    return status;
}

static void swap_tools(const adaptation *work)
{
    for (int t = 0; t < work->data->num_tools; t++) {
        pliant_tool tool = work->data->tools[t];
        work->data->tools[t] = work->made->tools[t];
        work->made->tools[t] = tool;
    }
}

/* ---- deformed volume: unchanged until the next update, which draws the differences */

static pliant_status prepare_warp(const adaptation *work)
{
    return work->data->warp ? pliant_warp_prepare(work->data->warp, work->made->discretization->body, work->warp)
                            : PLIANT_OK;
}

static void swap_warp(const adaptation *work)
{
    if (*work->warp) pliant_warp_take(work->data->warp, *work->warp);
}

/* ---- the table */

typedef struct adapter {
    pliant_status (*prepare)(const adaptation *work); /* write to made, read from data, whose state stays */
    void (*swap)(const adaptation *work);             /* exchange data and made */
} adapter;

/* sorted by dependency */
static const adapter adapters[] = {
    {prepare_discretization, swap_discretization}, {prepare_positions, swap_positions}, {prepare_state, swap_state},
    {prepare_tools, swap_tools},                   {prepare_warp, swap_warp},
};
enum { NUM_ADAPTERS = sizeof adapters / sizeof *adapters };

static void take_body(pliant_data *data, const pliant_body *body)
{
    const pliant_body *old = data->body;
    data->body = pliant_body_retain(body);
    pliant_body_release(old);
    if (body->revision > data->last_revision) data->last_revision = body->revision;
}

/* Triangles have new numbers, so contact points are not on the features that their keys name. */
static void forget_features(pliant_data *data)
{
    for (int32_t p = 0; p < data->contacts.count; p++)
        memset(data->contacts.point[p].on_feature, 0, sizeof data->contacts.point[p].on_feature);
}

static pliant_status prepare(adaptation *work)
{
    pliant_status status = pliant_body_map_create(work->data->discretization->body, work->made->body, &work->map);
    for (int a = 0; a < NUM_ADAPTERS && status == PLIANT_OK; a++) status = adapters[a].prepare(work);
    return status;
}

/* Keep memory for the next topology, and as much again for the time when the old one is not yet freed. */
static void reserve_memory(pliant_data *data, int64_t taken)
{
    const size_t bytes = taken > 0 ? (size_t)taken : 0;
    if (2 * bytes <= data->reserved_bytes) return;
    pliant_memory_change_reserve((int64_t)(2 * bytes - data->reserved_bytes));
    data->reserved_bytes = 2 * bytes;
}

pliant_status pliant_data_set_body(const pliant_model *model, pliant_data *data, const pliant_body *body)
{
    /* derived data point to the arrays of an equal topology, which they retain */
    if (pliant_body_same(body, data->discretization->body)) {
        take_body(data, body);
        return PLIANT_OK;
    }
    const int64_t taken = pliant_memory_thread_bytes(); /* other threads allocate and free at the same time */
    pliant_account *before = pliant_accounting_begin(data);
    pliant_data *made = pliant_calloc(1, sizeof *made);
    if (!made) {
        pliant_account_use(before);
        return pliant_fail_memory("the simulation state");
    }
    pliant_warp_next *warp = NULL;
    adaptation work = {.model = model, .data = data, .made = made, .warp = &warp};
    made->backend = data->backend;
    made->body = pliant_body_retain(body);
    pliant_status status = prepare(&work);
    if (status == PLIANT_OK) {
        reserve_memory(data, pliant_memory_thread_bytes() - taken);
        for (int a = 0; a < NUM_ADAPTERS; a++) adapters[a].swap(&work);
        take_body(data, body);
        forget_features(data);
        pliant_warp_next_free(warp); /* it belongs to the warp, which may continue without its device */
        warp = NULL;
        pliant_backend_carry_over_cut(model, data, made, &work.map);
    }
    pliant_body_map_free(&work.map);
    pliant_warp_next_free(warp);
    restore_positions_capacity(&work);
    pliant_data_free(made);
    pliant_accounting_end(data, before);
    return status;
}
