#include "backend/backend.h"
#include "base/count.h"
#include "base/fail.h"
#include "warp/device.h"

static_assert(PLIANT_COUNT_OF(PLIANT_SOLVER_LIST) == 2, "a new solver needs its functions here");

const pliant_host_solver *pliant_host_solver_of(const pliant_model *model)
{
    return model->tled ? &pliant_explicit : &pliant_corotational;
}

static pliant_status choose(const pliant_host_solver *host_solver, pliant_backend_choice choice,
                            char text[PLIANT_BACKEND_TEXT], const pliant_backend **out)
{
    bool use;
    pliant_status status = pliant_gpu_choose(choice, host_solver->cuda ? host_solver->cuda->probe : NULL, text, &use);
    if (status == PLIANT_OK) *out = use ? host_solver->cuda : host_solver->cpu;
    return status;
}

pliant_status pliant_backend_create(const pliant_model *model, pliant_data *data)
{
    const pliant_host_solver *host_solver = pliant_host_solver_of(model);
    char text[PLIANT_BACKEND_TEXT];
    const pliant_backend_choice choice = model->scene.solver.backend;
    pliant_status status = choose(host_solver, choice, text, &data->backend);
    if (status != PLIANT_OK) return status;
    status = data->backend->create(model, data);
    if (data->backend == host_solver->cpu) {
        if (choice == PLIANT_AUTO) pliant_log(PLIANT_LOG_INFO, "backend: cpu; no GPU is used: %s", text);
        return status;
    }
    if (status == PLIANT_OK) {
        pliant_log(PLIANT_LOG_INFO, "backend: cuda, %s", text);
    } else if (choice == PLIANT_AUTO) {
        pliant_log(PLIANT_LOG_WARNING, "backend: cpu; %s (%s)", pliant_last_error(), text);
        data->backend = host_solver->cpu;
        status = PLIANT_OK;
    }
    return status;
}

bool pliant_backend_fall_back(const pliant_model *model, pliant_data *data, pliant_status status)
{
    if (data->backend->state_is_on_host || (status != PLIANT_ERROR_UNAVAILABLE && status != PLIANT_ERROR_MEMORY))
        return false;
    pliant_log(PLIANT_LOG_WARNING, "backend: %s; the CPU continues from the last good state", pliant_last_error());
    const pliant_host_solver *host_solver = data->backend->host_solver;
    if (data->backend->download) data->backend->download(model, data);
    data->backend->free(data);
    data->backend = host_solver->cpu;
    if (host_solver->discard_results) host_solver->discard_results(data);
    if (data->warp) pliant_warp_fall_back(data->warp);
    return true;
}

void pliant_backend_carry_over_cut(const pliant_model *model, pliant_data *data, const pliant_data *before,
                                   const pliant_body_map *map)
{
    const pliant_backend *backend = data->backend;
    bool possible = false;
    if (backend->state_is_on_host) return;
    if (backend->carry_over_cut && backend->carry_over_cut(model, data, before, map, &possible) == PLIANT_OK &&
        possible)
        return;
    backend->free(data);
    if (backend->create(model, data) == PLIANT_OK) return;
    pliant_log(PLIANT_LOG_WARNING, "backend: %s; the CPU continues with the new mesh topology", pliant_last_error());
    data->backend = backend->host_solver->cpu;
    if (data->warp) pliant_warp_fall_back(data->warp);
}

static pliant_status fall_back_to_cpu(const pliant_model *model, pliant_data *data, pliant_status status)
{
    return status < 0 && pliant_backend_fall_back(model, data, status) ? PLIANT_OK : status;
}

pliant_status pliant_backend_restart(const pliant_model *model, pliant_data *data)
{
    return fall_back_to_cpu(model, data, data->backend->restart(model, data));
}

pliant_status pliant_backend_upload_positions(const pliant_model *model, pliant_data *data)
{
    const pliant_backend *backend = data->backend;
    return fall_back_to_cpu(model, data,
                            backend->upload_positions ? backend->upload_positions(model, data)
                                                      : backend->restart(model, data));
}

const char *pliant_data_get_backend(const pliant_data *data) { return data->backend->name; }
