/* The CUDA backend: the host's side of each stage. */
#include "backend/backend.h"
#include "cuda/base/check.h"
#include "base/fail.h"
#include "base/buffer.h"
#include "cuda/base/device.h"
#include "fem/quasistatic/solver.h"
#include "base/memory.h"
#include "cuda/fem/quasistatic/solve.h"
#include "cuda/contact/near_triangles.h"
#include "cuda/contact/tissue.h"
#include "cuda/contact/volume_bound.h"
#include "cuda/warp/warp.h"

#include <cstdio>
#include <cstring>

struct cuda_data {
    int device;
    cudaStream_t stream;
    pliant_cuda_solver *solver;
    const double *d_positions;   /* (fine nodes x 3) of this step */
    double *next_positions;      /* (fine nodes x 3) buffer of the host; swapped with data->positions when complete */
    double *page_locked[2];      /* these two arrays, page-locked if possible; they may be swapped */
    /* replaces them if cuts are possible: page-locked, with capacity for more nodes; its contents are copied */
    double *pinned_positions;
    size_t pinned_capacity; /* [bytes] */
    bool is_on_host;        /* the host has this step's positions already */
    bool moved;             /* the host has changed its positions after the device */
    gpu_volume_bound volume;
    gpu_near near;
    pliant_status contact_status; /* of the tests of contact since the last solve, which report it */
};

static double *target_of(const cuda_data *state)
{
    return state->pinned_positions ? state->pinned_positions : state->next_positions;
}

static cuda_data *state_of(const pliant_data *data) { return static_cast<cuda_data *>(data->backend_state); }

static void destroy(pliant_data *data)
{
    cuda_data *state = state_of(data);
    if (!state) return;
    cudaSetDevice(state->device);
    if (state->stream) cudaStreamSynchronize(state->stream);
    pliant_cuda_solver_free(state->solver);
    pliant_cuda_release_host(state->pinned_positions);
    pliant_cuda_volume_free(&state->volume);
    pliant_cuda_near_free(&state->near);
    for (double *block : state->page_locked)
        if (block) pliant_cuda_unlock_pages(block);
    if (state->stream) cudaStreamDestroy(state->stream);
    cudaGetLastError();
    pliant_free(state->next_positions);
    pliant_free(state);
    data->backend_state = NULL;
}

static pliant_status allocate_pinned_positions(const pliant_data *data, cuda_data *state)
{
    const size_t bytes = 3 * (size_t)data->body->fine.num_nodes * sizeof *state->pinned_positions;
    if (state->pinned_positions && bytes <= state->pinned_capacity) return PLIANT_OK;
    pliant_cuda_release_host(state->pinned_positions);
    state->pinned_positions = nullptr;
    state->pinned_capacity = bytes + bytes / 4;
    return pliant_cuda_allocate_host(state->pinned_capacity, "the simulation state",
                                     reinterpret_cast<void **>(&state->pinned_positions));
}

static pliant_status lock_positions(const pliant_data *data, cuda_data *state)
{
    const size_t count = 3 * (size_t)data->body->fine.num_nodes;
    state->next_positions = static_cast<double *>(pliant_calloc_pages(count, sizeof *state->next_positions));
    if (!state->next_positions) return pliant_fail_memory("the simulation state");
    double *const blocks[2] = {state->next_positions, data->positions};
    for (int b = 0; b < 2; b++)
        if (pliant_cuda_lock_pages(blocks[b], count * sizeof(double))) state->page_locked[b] = blocks[b];
    return PLIANT_OK;
}

static pliant_status fill(const pliant_model *model, const pliant_data *data, cuda_data *state)
{
    const bool grows = model->scene.cut.kind != PLIANT_CUT_NONE;
    int lowest = 0, highest = 0;
    CUDA_TRY(pliant_cuda_current_device(&state->device));
    CUDA_TRY(CUDA_CALL(cudaDeviceGetStreamPriorityRange(&lowest, &highest)));
    CUDA_TRY(CUDA_CALL(cudaStreamCreateWithPriority(&state->stream, cudaStreamNonBlocking, highest)));
    CUDA_TRY(grows ? allocate_pinned_positions(data, state) : lock_positions(data, state));
    return pliant_cuda_solver_create(data->solver, model->scene.solver.preconditioner, grows, state->device,
                                     state->stream, &state->solver);
}

static pliant_status create(const pliant_model *model, pliant_data *data)
{
    cuda_data *state = static_cast<cuda_data *>(pliant_calloc(1, sizeof *state));
    if (!state) return pliant_fail_memory("the simulation state");
    data->backend_state = state;
    pliant_status status = fill(model, data, state);
    if (status != PLIANT_OK) destroy(data);
    return status;
}

/* A simulation that returns to the topology at load must be identical to a new one, so it is rebuilt. */
static pliant_status carry_over_cut(const pliant_model *model, pliant_data *data, const pliant_data *before,
                                    const pliant_body_map *map, bool *possible)
{
    cuda_data *state = state_of(data);
    *possible = state->pinned_positions && data->discretization != model->discretization;
    if (!*possible) return PLIANT_OK;
    CUDA_TRY(allocate_pinned_positions(data, state));
    state->moved = true;
    const int32_t *node;
    int32_t *own;
    pliant_status status = pliant_solved_sources(data->solver->system, before->solver->system, map, &own, &node);
    if (status == PLIANT_OK)
        status = pliant_cuda_solver_carry_over_cut(state->solver, data->solver, before->solver, node, possible);
    pliant_free(own);
    return status;
}

static pliant_status restart(const pliant_model *model, pliant_data *data)
{
    (void)model;
    state_of(data)->moved = true;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) data->solver->grasps[t].response_number = 0;
    return pliant_cuda_solver_restart(state_of(data)->solver, data->solver);
}

/* Send the moved nodes of the solved mesh and of the fine mesh. */
static pliant_status move(const pliant_model *, pliant_data *data)
{
    cuda_data *state = state_of(data);
    state->moved = true;
    state->volume.has_near = state->volume.is_enqueued = false;
    CUDA_TRY(pliant_cuda_solver_move(state->solver, data->solver));
    if (!state->d_positions || pliant_host_moves_nodes(data)) return PLIANT_OK;
    CUDA_TRY(pliant_cuda_solver_place(state->solver, data->positions));
    state->moved = false;
    return PLIANT_OK;
}

/* positions of a coarse mesh were downloaded at the end of the step */
static void download(const pliant_model *model, pliant_data *data)
{
    (void)model;
    if (data->solver->system->mesh == data->solver->system->fine)
        memcpy(data->solver->now.x, data->positions, 3 * (size_t)data->body->fine.num_nodes * sizeof *data->positions);
}

/* Return whether d_positions are the host's positions. */
static bool has_positions(const pliant_data *data)
{
    const cuda_data *state = state_of(data);
    return state->d_positions && !state->moved && !pliant_host_moves_nodes(data);
}

/* Keep the positions at the start of a leg, once the volume bound has been used. */
static pliant_status begin_leg(pliant_data *data)
{
    cuda_data *state = state_of(data);
    gpu_volume_bound *volume = &state->volume;
    volume->has_from = volume->has_near = volume->is_enqueued = false;
    return volume->revision == data->body->revision && has_positions(data)
               ? pliant_cuda_volume_begin_leg(volume, state->d_positions, (size_t)data->body->fine.num_nodes,
                                              state->stream)
               : PLIANT_OK;
}

/* Keep an error of a test for the next solve. Meanwhile the host makes the test. */
static bool succeeds(pliant_data *data, pliant_status status)
{
    if (status != PLIANT_OK) state_of(data)->contact_status = status;
    return status == PLIANT_OK;
}

static pliant_status test_elements(const pliant_model *model, pliant_data *data, bool in_leg, bool *may_be_small)
{
    cuda_data *state = state_of(data);
    gpu_volume_bound *volume = &state->volume;
    bool is_any = true;
    *may_be_small = true;
    CUDA_TRY(CUDA_CALL(cudaSetDevice(state->device)));
    CUDA_TRY(pliant_cuda_volume_set_body(volume, data->body, state->stream));
    if (!has_positions(data) || (in_leg && !volume->has_from)) return PLIANT_OK;
    if (in_leg ? !volume->is_enqueued : !volume->has_near)
        CUDA_TRY(
            pliant_cuda_volume_enqueue(volume, &model->contact, !in_leg, state->d_positions, state->stream));
    if (in_leg || !volume->has_near) CUDA_TRY(pliant_cuda_volume_finish(volume, state->stream, &is_any));
    *may_be_small = in_leg ? is_any : volume->is_near;
    return PLIANT_OK;
}

static bool may_have_small_elements(const pliant_model *model, pliant_data *data, bool in_leg)
{
    bool may_be_small = true;
    return pliant_host_moves_nodes(data) || !succeeds(data, test_elements(model, data, in_leg, &may_be_small)) ||
           may_be_small;
}

static pliant_status list_near(pliant_data *data, const pliant_near_surface *surface, bool in_leg, int32_t count,
                               const pliant_near_region *regions, pliant_triangle_list *out)
{
    cuda_data *state = state_of(data);
    const void *d_from = in_leg ? state->volume.d_from : state->d_positions;
    CUDA_TRY(CUDA_CALL(cudaSetDevice(state->device)));
    CUDA_TRY(pliant_cuda_near_set_surface(&state->near, surface, state->stream));
    return pliant_cuda_near_find(&state->near, static_cast<const double *>(d_from), state->d_positions, count, regions,
                                 state->stream, out);
}

static bool find_near(pliant_data *data, const pliant_near_surface *surface, bool in_leg, int32_t count,
                      const pliant_near_region *regions, pliant_triangle_list *out)
{
    return has_positions(data) && (!in_leg || state_of(data)->volume.has_from) &&
           succeeds(data, list_near(data, surface, in_leg, count, regions, out));
}

static pliant_status take_contact_status(pliant_data *data)
{
    const pliant_status status = state_of(data)->contact_status;
    state_of(data)->contact_status = PLIANT_OK;
    return status == PLIANT_OK ? status : pliant_fail(status, "the GPU failed: tests of contact");
}

static pliant_status solve(const pliant_model *model, pliant_data *data)
{
    data->solver->background = &data->background;
    pliant_cuda_section_begin("solve");
    pliant_status status = take_contact_status(data);
    if (status == PLIANT_OK) status = pliant_set_contact_points(data);
    if (status == PLIANT_OK) status = begin_leg(data);
    if (status == PLIANT_OK)
        status = pliant_cuda_solver_step(state_of(data)->solver, data->solver, data->gravity, &data->statistics);
    pliant_cuda_section_end();
    return status;
}

/* Enqueue the upsampling, and the test of the elements that follows a leg. */
static pliant_status enqueue_upsample(const pliant_model *model, const pliant_data *data)
{
    cuda_data *state = state_of(data);
    state->is_on_host = state->moved = false;
    CUDA_TRY(pliant_cuda_solver_upsample(state->solver, &state->d_positions));
    if (state->volume.has_from)
        CUDA_TRY(pliant_cuda_volume_enqueue(&state->volume, &model->contact, false, state->d_positions, state->stream));
    const size_t bytes = 3 * (size_t)data->body->fine.num_nodes * sizeof *state->next_positions;
    return CUDA_CALL(
        cudaMemcpyAsync(target_of(state), state->d_positions, bytes, cudaMemcpyDeviceToHost, state->stream));
}

/* Make the downloaded state the host's state. */
static void take(pliant_data *data)
{
    cuda_data *state = state_of(data);
    if (state->pinned_positions) {
        memcpy(data->positions, state->pinned_positions,
               3 * (size_t)data->body->fine.num_nodes * sizeof *data->positions);
    } else {
        double *arrived = state->next_positions;
        state->next_positions = data->positions;
        data->positions = arrived;
    }
    pliant_cuda_solver_take(state->solver, data->solver);
    pliant_report_grasps(data);
}

static pliant_status copy_result_to_host(const pliant_model *, pliant_data *data)
{
    cuda_data *state = state_of(data);
    if (state->is_on_host) return PLIANT_OK;
    CUDA_TRY(pliant_cuda_solver_download(state->solver));
    CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(state->stream)));
    take(data);
    state->is_on_host = true;
    return PLIANT_OK;
}

/* Upsample. The host solves patches and moves detached pieces, so it then needs the fine nodes' positions. */
static pliant_status transfer_ownership(const pliant_model *model, pliant_data *data)
{
    CUDA_TRY(enqueue_upsample(model, data));
    return pliant_host_moves_nodes(data) ? copy_result_to_host(model, data) : PLIANT_OK;
}

static pliant_status upsample(const pliant_model *model, pliant_data *data)
{
    pliant_cuda_section_begin("upsample");
    pliant_status status = transfer_ownership(model, data);
    pliant_cuda_section_end();
    return status;
}

/* Run the warp and end the step: all requested data have arrived. */
static pliant_status finish(pliant_data *data)
{
    cuda_data *state = state_of(data);
    pliant_cuda_warp *warp = data->warp ? static_cast<pliant_cuda_warp *>(pliant_warp_accelerated(data->warp)) : NULL;
    if (!state->is_on_host) CUDA_TRY(pliant_cuda_solver_download(state->solver));
    else if (warp && (state->moved || data->rigid_pieces || data->statistics.patched > 0))
        CUDA_TRY(pliant_cuda_solver_place(state->solver, data->positions));
    if (warp) CUDA_TRY(pliant_cuda_warp_enqueue(warp, state->d_positions, state->stream));
    CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(state->stream)));
    if (warp) CUDA_TRY(pliant_cuda_warp_finish(warp, state->d_positions, state->stream));
    if (!state->is_on_host) take(data);
    return data->warp && !warp ? pliant_warp_update(data->warp, data->positions) : PLIANT_OK;
}

static pliant_status warp(const pliant_model *model, pliant_data *data)
{
    pliant_cuda_section_begin("warp");
    (void)model;
    pliant_status status = finish(data);
    pliant_cuda_section_end();
    return status;
}

/* Built by assignment: C++14 has no designated initializers. */
static constexpr pliant_backend table()
{
    pliant_backend made{};
    made.name = "cuda";
    made.host_solver = &pliant_corotational;
    made.handles_contacts = true;
    made.probe = pliant_cuda_text;
    made.searcher = &pliant_cuda_tissue_searcher;
    made.create = create;
    made.free = destroy;
    made.carry_over_cut = carry_over_cut;
    made.restart = restart;
    made.upload_positions = move;
    made.download = download;
    made.interact = pliant_corotational_interact;
    made.solve = solve;
    made.upsample = upsample;
    made.copy_result_to_host = copy_result_to_host;
    made.may_have_small_elements = may_have_small_elements;
    made.find_near = find_near;
    made.warp = warp;
    return made;
}
const pliant_backend pliant_cuda_backend = table();
