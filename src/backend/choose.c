#include "backend/backend.h"
#include "core/fail.h"
#include "fem/solver.h"

#include <stdio.h>

#ifdef PLIANT_WITH_CUDA
extern const pliant_backend pliant_cuda_backend;
static const pliant_backend *const cuda = &pliant_cuda_backend;
#else
static const pliant_backend *const cuda = NULL;
#endif

pliant_status pliant_backend_choose(pliant_backend_choice choice, char text[PLIANT_BACKEND_TEXT], const pliant_backend **out)
{
    snprintf(text, PLIANT_BACKEND_TEXT, "this build has no CUDA backend");
    bool usable = choice != PLIANT_CPU && cuda && cuda->probe(text, PLIANT_BACKEND_TEXT);
    if (!usable && choice == PLIANT_CUDA)
        return pliant_fail(PLIANT_ERROR_UNAVAILABLE, "solver/backend: cuda cannot be used: %s; auto or cpu would run on the CPU", text);
    *out = usable ? cuda : &pliant_cpu_backend;
    return PLIANT_OK;
}

pliant_status pliant_backend_create(const pliant_model *model, pliant_data *data)
{
    const pliant_backend_choice choice = model->scene.solver.backend;
    char text[PLIANT_BACKEND_TEXT];
    if (data->tled) {
        data->backend = &pliant_tled_backend;
        if (choice != PLIANT_CUDA) return PLIANT_OK;
        return pliant_fail(PLIANT_ERROR_UNAVAILABLE, "solver/backend: tled has no kernels for cuda; auto or cpu would run on the CPU");
    }
    pliant_status status = pliant_backend_choose(choice, text, &data->backend);
    if (status != PLIANT_OK) return status;
    status = data->backend->create(model, data);
    if (data->backend == &pliant_cpu_backend) {
        if (choice == PLIANT_AUTO) pliant_log(PLIANT_LOG_INFO, "backend: cpu; no GPU is used: %s", text);
        return status;
    }
    if (status == PLIANT_OK) {
        pliant_log(PLIANT_LOG_INFO, "backend: cuda, %s", text);
    } else if (choice == PLIANT_AUTO) {
        pliant_log(PLIANT_LOG_WARNING, "backend: cpu; %s (%s)", pliant_last_error(), text);
        data->backend = &pliant_cpu_backend;
        status = PLIANT_OK;
    }
    return status;
}

bool pliant_backend_leave(const pliant_model *model, pliant_data *data, pliant_status status)
{
    if (data->backend->on_host || (status != PLIANT_ERROR_UNAVAILABLE && status != PLIANT_ERROR_MEMORY)) return false;
    pliant_log(PLIANT_LOG_WARNING, "backend: %s; the CPU goes on from the last good state", pliant_last_error());
    data->backend->bring(model, data);
    data->backend->free(data);
    data->backend = &pliant_cpu_backend;
    pliant_solver_forget(data->solver);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) data->solver->handles[t].response_of = 0;
    if (data->warp) pliant_warp_leave(data->warp);
    return true;
}

pliant_status pliant_backend_restart(const pliant_model *model, pliant_data *data)
{
    pliant_status status = data->backend->restart(model, data);
    return status < 0 && pliant_backend_leave(model, data, status) ? PLIANT_OK : status;
}

const char *pliant_data_backend(const pliant_data *data) { return data->backend->name; }
