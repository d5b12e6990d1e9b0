/* The CUDA backend of explicit dynamics. */
#include "backend/backend.h"
#include "cuda/base/check.h"
#include "cuda/base/device.h"
#include "cuda/fem/dynamics/tled.h"
#include "cuda/contact/tissue.h"
#include "cuda/warp/warp.h"

static pliant_cuda_tled *state_of(const pliant_data *data)
{
    return static_cast<pliant_cuda_tled *>(data->backend_state);
}

static void destroy(pliant_data *data)
{
    pliant_cuda_tled_free(state_of(data));
    data->backend_state = NULL;
}

static pliant_status create(const pliant_model *, pliant_data *data)
{
    int device;
    pliant_cuda_tled *made;
    CUDA_TRY(pliant_cuda_current_device(&device));
    CUDA_TRY(pliant_cuda_tled_create(data->tled, device, &made));
    data->backend_state = made;
    return PLIANT_OK;
}

static pliant_status restart(const pliant_model *, pliant_data *data)
{
    pliant_cuda_tled_restart(state_of(data));
    return PLIANT_OK;
}

/* The next frame sends the host's state. The warp uses the host's positions at once. */
static pliant_status upload_positions(const pliant_model *, pliant_data *data)
{
    pliant_cuda_tled_restart(state_of(data));
    return pliant_cuda_tled_set_positions(state_of(data), data->positions);
}

static pliant_status solve(const pliant_model *, pliant_data *data)
{
    pliant_cuda_section_begin("solve");
    data->tled->contacts = &data->contacts;
    pliant_status status = pliant_tled_step_by(pliant_cuda_tled_run, state_of(data), data->tled, data->tools,
                                               data->num_tools, &data->statistics);
    pliant_cuda_section_end();
    return status;
}

/* Update the warp from the positions on the GPU, if the warp is on the GPU too. */
static pliant_status draw(const pliant_data *data)
{
    pliant_cuda_warp *on_gpu = data->warp ? static_cast<pliant_cuda_warp *>(pliant_warp_accelerated(data->warp)) : NULL;
    if (!on_gpu) return data->warp ? pliant_warp_update(data->warp, data->positions) : PLIANT_OK;
    const double *d_positions = pliant_cuda_tled_positions(state_of(data));
    cudaStream_t stream = pliant_cuda_tled_stream(state_of(data));
    if (pliant_host_moves_nodes(data)) CUDA_TRY(pliant_cuda_tled_set_positions(state_of(data), data->positions));
    CUDA_TRY(pliant_cuda_warp_enqueue(on_gpu, d_positions, stream));
    CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(stream)));
    return pliant_cuda_warp_finish(on_gpu, d_positions, stream);
}

static pliant_status warp(const pliant_model *, pliant_data *data)
{
    pliant_cuda_section_begin("warp");
    pliant_status status = draw(data);
    pliant_cuda_section_end();
    return status;
}

/* Built by assignment: C++14 has no designated initializers. */
static constexpr pliant_backend table()
{
    pliant_backend made{};
    made.name = "cuda";
    made.host_solver = &pliant_explicit;
    made.solves_on_host = made.handles_contacts = true;
    made.probe = pliant_cuda_text;
    made.searcher = &pliant_cuda_tissue_searcher;
    made.create = create;
    made.free = destroy;
    made.restart = restart;
    made.upload_positions = upload_positions;
    made.interact = pliant_explicit_interact;
    made.solve = solve;
    made.upsample = pliant_tled_upsample;
    made.warp = warp;
    return made;
}
const pliant_backend pliant_cuda_tled_backend = table();
