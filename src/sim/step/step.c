/* pliant_step: its stages in their order. Also reset, and the inputs between two steps. */
#include "backend/backend.h"
#include "base/fail.h"
#include "fem/patch/patch.h"
#include "fem/dynamics/tled.h"
#include "fem/rigid/rigid_pieces.h"
#include "fem/quasistatic/solver.h"
#include "sim/api/data.h"
#include "tool/blade.h"
#include "tool/tool.h"
#include "sim/step/contact.h"
#include "sim/step/cut.h"
#include "sim/step/accounting.h"
#include "sim/step/legs.h"
#include "sim/step/stage_timer.h"
#include "sim/step/state.h"
#include "warp/device.h"
#include "warp/warp.h"

#include <math.h>
#include <string.h>

const char *pliant_step_stage_name(int stage)
{
    static const char *const names[] = {
#define STAGE_NAME(name) #name,
        PLIANT_STEP_STAGE_LIST(STAGE_NAME)
#undef STAGE_NAME
    };
    return stage >= 0 && stage < PLIANT_NUM_STEP_STAGES ? names[stage] : "";
}

const char *pliant_step_end_text(int32_t end)
{
#define END_TEXT(name, text) text,
    static const char *const texts[] = {PLIANT_STEP_END_LIST(END_TEXT)};
#undef END_TEXT
    return end >= 0 && end < PLIANT_NUM_STEP_ENDS ? texts[end] : "";
}

static pliant_status reset(const pliant_model *model, pliant_data *data)
{
    /* the solver is rebuilt for another topology, and then needs no reset */
    pliant_status status = pliant_body_same(data->discretization->body, model->body)
                               ? PLIANT_OK
                               : pliant_data_set_body(model, data, model->body);
    if (status == PLIANT_OK) status = data->backend->host_solver->reset(data);
    if (status == PLIANT_OK) status = pliant_data_set_body(model, data, model->body);
    if (status != PLIANT_OK) return status;
    for (int t = 0; t < data->num_tools; t++) {
        pliant_tool_reset_grasp(data->tools + t);
        pliant_blade_reset(data->tools + t);
        data->tools[t].proxy.known = false;
        data->tools[t].proxy.missing = (pliant_missing_depth){.fraction = 1};
    }
    pliant_undo_clear(data);
    pliant_contact_discard(data);
    memcpy(data->positions, data->body->fine.rest, 3 * (size_t)data->body->fine.num_nodes * sizeof *data->positions);
    memcpy(data->gravity, model->scene.model.gravity, sizeof data->gravity);
    size_t bytes = data->statistics.bytes;
    memset(&data->statistics, 0, sizeof data->statistics);
    data->statistics.bytes = bytes;
    return pliant_backend_restart(model, data);
}

pliant_status pliant_data_reset(const pliant_model *model, pliant_data *data)
{
    pliant_account *before = pliant_accounting_begin(data);
    const pliant_status status = reset(model, data);
    pliant_accounting_end(data, before);
    return status;
}

static pliant_status set_warp(const pliant_model *model, pliant_data *data, const pliant_geometry *target)
{
    pliant_warp *warp = NULL;
    if (target) {
        pliant_status status = pliant_warp_create(model->drawn, &data->discretization->body->fine, target,
                                                  data->discretization->system->num_threads, &warp);
        if (status == PLIANT_OK && data->discretization->body->cuts)
            status = pliant_warp_set_body(warp, data->discretization->body);
        if (status == PLIANT_OK && model->scene.cut.kind != PLIANT_CUT_NONE)
            status = pliant_warp_expect_cuts(warp, data->discretization->body);
        if (status == PLIANT_OK && model->scene.warp.kind == PLIANT_FIT)
            status = pliant_warp_fit(warp, PLIANT_FIT_STEP);
        /* the stages exchange data on the GPU */
        if (status == PLIANT_OK && !data->backend->state_is_on_host)
            status = pliant_warp_backend(warp, model->scene.solver.backend);
        if (status != PLIANT_OK) {
            pliant_warp_free(warp);
            return status;
        }
    }
    pliant_warp_free(data->warp);
    data->warp = warp;
    /* GPU steps are so short that the first cut would cause a visible delay */
    if (warp && pliant_warp_accelerated(warp)) pliant_warm_up_cut(model, data);
    return PLIANT_OK;
}

pliant_status pliant_data_set_warp(const pliant_model *model, pliant_data *data, const pliant_geometry *target)
{
    pliant_account *before = pliant_accounting_begin(data);
    const pliant_status status = set_warp(model, data, target);
    pliant_accounting_end(data, before);
    return status;
}

pliant_status pliant_data_set_gravity(pliant_data *data, const double gravity[3])
{
    for (int d = 0; d < 3; d++)
        if (!isfinite(gravity[d])) return pliant_fail(PLIANT_ERROR_ARGUMENT, "gravity must be finite");
    memcpy(data->gravity, gravity, sizeof data->gravity);
    return PLIANT_OK;
}

static pliant_status interact(const pliant_model *model, pliant_data *data)
{
    for (int t = 0; t < data->num_tools; t++) pliant_tool_slip(&model->scene, data, t);
    return data->backend->interact(model, data);
}

/* contact/response: paper without delay detects overlaps in every sub-step */
static bool searches_in_substeps(const pliant_model *model)
{
    return model->scene.contact.response == PLIANT_RESPONSE_PAPER && !model->scene.contact.delay;
}

/* Run the solve stage. A GPU backend that cannot handle contact fails, and then the CPU continues. */
static pliant_status solve(const pliant_model *model, pliant_data *data)
{
    const pliant_backend *backend = data->backend;
    if (data->contacts.count > 0 && !backend->state_is_on_host &&
        (!backend->handles_contacts || searches_in_substeps(model)))
        return pliant_fail(PLIANT_ERROR_UNAVAILABLE, "tissue is near a contact surface, which only the CPU handles");
    return backend->solve(model, data);
}

/* Upsample the solution. A GPU also copies the positions to the host if contact, pieces or patches need them. */
static pliant_status upsample(const pliant_model *model, pliant_data *data)
{
    pliant_status status = data->backend->upsample(model, data);
    const bool brings = !pliant_contact_is_idle(model, data) || pliant_host_moves_nodes(data);
    return status >= 0 && brings && data->backend->copy_result_to_host ? data->backend->copy_result_to_host(model, data)
                                                                       : status;
}

/* Patches and detached pieces: the CPU computes them with every backend. */
static pliant_status run_patch_stage(const pliant_model *model, pliant_data *data)
{
    pliant_status status = PLIANT_OK;
    if (data->patch) {
        status = pliant_patch_step(data);
        pliant_report_grasps(data);
        if (status < 0) return status;
    }
    if (data->rigid_pieces && data->fraction > 0) {
        const bool rebuilt = pliant_rigid_pieces_step(data);
        for (int t = 0; t < data->num_tools; t++) pliant_tool_report(data, t, NULL);
        if (rebuilt && (status = pliant_backend_restart(model, data)) < 0) return status;
    } else if (data->rigid_pieces) /* the upsampling has set the pieces' nodes to their home positions */
        pliant_rigid_pieces_hold(data->rigid_pieces, data->positions);
    return status;
}

/* Run the stages solve, upsample and patch. */
static pliant_status run_stages(const pliant_model *model, pliant_data *data, pliant_status *warning)
{
    pliant_status (*const functions[])(const pliant_model *, pliant_data *) = {solve, upsample, run_patch_stage};
    *warning = PLIANT_OK;
    for (int n = 0; n < 3; n++) {
        const pliant_status status = pliant_run_stage(model, data, PLIANT_STEP_solve + n, functions[n]);
        if (status < 0) return status;
        if (status > 0) *warning = status;
    }
    return PLIANT_OK;
}

/* A backend that fails leaves the host's state unchanged, so the CPU can repeat the stages. */
static pliant_status run_stages_or_fall_back(const pliant_model *model, pliant_data *data, pliant_status *warning)
{
    const pliant_status status = run_stages(model, data, warning);
    return status < 0 && pliant_backend_fall_back(model, data, status) ? run_stages(model, data, warning) : status;
}

/* Run the stages from contact to patch: once, or with contact once for each leg. */
static pliant_status run_legs(const pliant_model *model, pliant_data *data, pliant_status *warning)
{
    pliant_statistics *statistics = &data->statistics;
    const double completed = statistics->step > 0 ? statistics->advanced : 1;
    statistics->legs = 0;
    statistics->advanced = 1;
    statistics->proxy_error = 0;
    statistics->ended = PLIANT_STEP_END_NONE;
    data->fraction = 1;
    if (data->solver) data->solver->clock = &data->clock;
    pliant_step_clock_begin(&data->clock);
    if (!pliant_contact_is_idle(model, data))
        return pliant_legs_run(model, data, completed, run_stages_or_fall_back, warning);
    pliant_legs_skip(model, data);
    return run_stages_or_fall_back(model, data, warning);
}

/* Run the solve stage and the warp. If the GPU fails in the warp and the host's state is unchanged, the CPU repeats
 * both. */
static pliant_status solve_and_draw(const pliant_model *model, pliant_data *data, pliant_status *warning)
{
    pliant_status status = run_legs(model, data, warning);
    if (status >= 0) status = pliant_run_stage(model, data, PLIANT_STEP_warp, data->backend->warp);
    return status;
}

static pliant_status step(const pliant_model *model, pliant_data *data, pliant_status *warning)
{
    memset(data->statistics.seconds, 0, sizeof data->statistics.seconds);
    data->background.taken = 0;
    pliant_status status = pliant_run_stage(model, data, PLIANT_STEP_cut, pliant_cut_stage);
    if (status >= 0) status = pliant_rollback_begin(model, data);
    if (status >= 0) status = pliant_run_stage(model, data, PLIANT_STEP_interact, interact);
    if (status < 0) return status;
    status = solve_and_draw(model, data, warning);
    if (status < 0 && pliant_backend_fall_back(model, data, status)) {
        const bool solve_is_done = pliant_host_moves_nodes(data) || !pliant_contact_is_idle(model, data) || data->tled;
        status = solve_is_done ? pliant_run_stage(model, data, PLIANT_STEP_warp, data->backend->warp)
                               : solve_and_draw(model, data, warning);
    }
    return status < 0 ? status : pliant_step_clock_end(&data->clock);
}

static void log_missing(const pliant_data *data)
{
    const uint32_t missing = data->background.prescribed & ~data->background.taken;
    if (missing)
        pliant_log(PLIANT_LOG_WARNING,
                   "step %llu: the prescribed background results (pliant_data_set_background: %u) are missing: the run "
                   "differs from the recorded run",
                   (unsigned long long)data->statistics.step, (unsigned)missing);
}

pliant_status pliant_step(const pliant_model *model, pliant_data *data)
{
    pliant_account *before = pliant_accounting_begin(data);
    pliant_status warning = PLIANT_OK;
    const pliant_status status = step(model, data, &warning);
    if (status < 0) {
        pliant_rollback_undo(model, data);
        data->statistics.failed++;
    } else {
        log_missing(data);
        data->background.prescribed = 0;
        data->statistics.step++;
        data->statistics.not_converged += warning == PLIANT_NOT_CONVERGED;
    }
    pliant_accounting_end(data, before);
    return status < 0 ? status : warning;
}
