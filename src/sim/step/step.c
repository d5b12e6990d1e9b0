/* The step, and what is set between two. */
#include "backend/backend.h"
#include "base/fail.h"
#include "fem/patch/patch.h"
#include "fem/dynamics/tled.h"
#include "fem/rigid/falling.h"
#include "fem/quasistatic/solver.h"
#include "tool/blade.h"
#include "tool/tool.h"
#include "pliant/memory.h"
#include "sim/step/contact.h"
#include "sim/step/cut.h"
#include "sim/step/frame_parts.h"
#include "sim/step/held.h"
#include "sim/step/state.h"
#include "sim/step/substeps.h"
#include "warp/device.h"

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

static pliant_status reset(const pliant_model *model, pliant_data *data)
{
    /* of another topology the solver is made anew, and has nothing left to make */
    pliant_status status = pliant_body_same(data->discretization->body, model->body) ? PLIANT_OK : pliant_data_set_body(model, data, model->body);
    if (status == PLIANT_OK) status = data->backend->kind->reset(data);
    if (status == PLIANT_OK) status = pliant_data_set_body(model, data, model->body);
    if (status != PLIANT_OK) return status;
    for (int t = 0; t < data->num_tools; t++) {
        pliant_tool_forget(data->tools + t);
        pliant_blade_reset(data->tools + t);
        data->tools[t].last.known = false;
    }
    pliant_undo_clear(data);
    pliant_contact_forget(data);
    memcpy(data->positions, data->body->fine.rest, 3 * (size_t)data->body->fine.num_nodes * sizeof *data->positions);
    memcpy(data->gravity, model->scene.model.gravity, sizeof data->gravity);
    size_t bytes = data->statistics.bytes;
    memset(&data->statistics, 0, sizeof data->statistics);
    data->statistics.bytes = bytes;
    return pliant_backend_restart(model, data);
}

pliant_status pliant_data_reset(const pliant_model *model, pliant_data *data)
{
    pliant_account *before = pliant_held_begin(data);
    const pliant_status status = reset(model, data);
    pliant_held_end(data, before);
    return status;
}

static pliant_status set_warp(const pliant_model *model, pliant_data *data, const pliant_geometry *target)
{
    pliant_warp *warp = NULL;
    if (target) {
        pliant_status status = pliant_warp_create(model->drawn, &data->discretization->body->fine, target, data->discretization->system->num_threads, &warp);
        if (status == PLIANT_OK && data->discretization->body->cuts) status = pliant_warp_set_body(warp, data->discretization->body);
        if (status == PLIANT_OK && model->scene.cut.kind != PLIANT_CUT_NONE) status = pliant_warp_expect_cuts(warp, data->discretization->body);
        if (status == PLIANT_OK && model->scene.warp.kind == PLIANT_FIT) status = pliant_warp_fit(warp, model->scene.warp.fit_step);
        /* a step's stages hand over on the GPU */
        if (status == PLIANT_OK && !data->backend->on_host) status = pliant_warp_backend(warp, model->scene.solver.backend);
        if (status != PLIANT_OK) {
            pliant_warp_free(warp);
            return status;
        }
    }
    pliant_warp_free(data->warp);
    data->warp = warp;
    if (warp && pliant_warp_accelerated(warp)) pliant_rehearse_cut(model, data); /* steps are short enough there for it to be felt */
    return PLIANT_OK;
}

pliant_status pliant_data_set_warp(const pliant_model *model, pliant_data *data, const pliant_geometry *target)
{
    pliant_account *before = pliant_held_begin(data);
    const pliant_status status = set_warp(model, data, target);
    pliant_held_end(data, before);
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
    return data->backend->kind->interact(model, data);
}

static pliant_status move_patch(const pliant_model *model, pliant_data *data)
{
    if (!data->patch) return PLIANT_OK;
    pliant_status status = pliant_patch_step(data);
    pliant_pull_report(data);
    if (status < 0 && !data->backend->on_host) pliant_backend_restart(model, data);
    return status;
}

static pliant_status move_pieces(const pliant_model *model, pliant_data *data)
{
    if (!data->falling) return PLIANT_OK;
    const bool anew = pliant_falling_step(data);
    for (int t = 0; t < data->num_tools; t++) pliant_tool_report(data, t, NULL);
    return anew ? pliant_backend_restart(model, data) : PLIANT_OK;
}

/* By the CPU, whoever runs the other stages. Where it fails, the step is undone: another backend goes on from before it, too. */
static pliant_status patch(const pliant_model *model, pliant_data *data)
{
    const pliant_status status = move_patch(model, data), moved = status < 0 ? PLIANT_OK : move_pieces(model, data);
    return moved < 0 ? moved : status;
}

/* contact/response paper without its delay looks for what overlaps in every sub-step */
static bool searches_on_the_way(const pliant_model *model) { return model->scene.contact.response == PLIANT_RESPONSE_PAPER && !model->scene.contact.delay; }

/* By whichever backend, and how long it took of the budget that a step has. */
static pliant_status solve(const pliant_model *model, pliant_data *data)
{
    pliant_solver *solver = data->solver;
    const double start = solver ? solver->clock(solver->clock_user) : 0;
    const pliant_status status = data->backend->solve(model, data);
    if (solver) solver->spent += solver->clock(solver->clock_user) - start;
    return status;
}

/* Of a step that has been solved before. */
static pliant_status solve_more(const pliant_model *model, pliant_data *data)
{
    const double start = pliant_seconds();
    const int32_t iterations = data->statistics.iterations;
    const pliant_status status = solve(model, data);
    data->statistics.iterations += iterations;
    data->statistics.seconds[PLIANT_STEP_solve] += pliant_seconds() - start;
    return status;
}

/* What patches make of where the solve led to. */
static pliant_status add_patch(const pliant_model *model, pliant_data *data)
{
    pliant_solver *solver = data->solver;
    const double begun = pliant_seconds(), clock = solver->clock(solver->clock_user);
    const pliant_status status = move_patch(model, data);
    solver->spent += solver->clock(solver->clock_user) - clock;
    data->statistics.seconds[PLIANT_STEP_patch] += pliant_seconds() - begun;
    return status;
}

/* The host's positions are those that a solve led to; pieces stay where they were. */
static pliant_status bring(const pliant_model *model, pliant_data *data, bool upsamples)
{
    const double start = pliant_seconds();
    pliant_status status = upsamples ? data->backend->upsample(model, data) : PLIANT_OK;
    if (status >= 0 && data->backend->bring) status = data->backend->bring(model, data);
    data->statistics.seconds[PLIANT_STEP_upsample] += pliant_seconds() - start;
    if (status >= 0 && pliant_patch_serves(data) > 0) status = add_patch(model, data);
    if (data->falling) pliant_falling_stay(data->falling, data->positions);
    return status;
}

/* From here on only what is planned for this step of what is made in the background may come in: a step that waits for nothing tells what it took as a whole. */
static void take_no_more(pliant_data *data)
{
    if (data->background.kind != PLIANT_BACKGROUND_PLANNED) data->background = (pliant_background){.kind = PLIANT_BACKGROUND_PRESCRIBED, .taken = data->background.taken};
}

/* Points that the coarse model holds are moved by the patch after that: where one is deep in a tool then, both take turns (alternating Schwarz method), from where they are, as long as
 * that helps, and so often in a step. Where a turn fails, all is as it was before. */
static pliant_status take_turns(const pliant_model *model, pliant_data *data, pliant_substeps *parts, pliant_status status)
{
    const double deep = 0.1, helps = 0.9;
    const int32_t most = data->solver->budget > 0 ? 2 : 64;
    double now = pliant_contact_deep_beside_patch(data), before = INFINITY;
    for (; parts->turns < most && now > deep && now < helps * before && pliant_solver_has_time(data->solver) && pliant_substeps_here(model, data, PLIANT_ENDED_LAST); parts->turns++) {
        take_no_more(data);
        pliant_contact_goes_on_from_here(data);
        const pliant_status solved = solve_more(model, data), placed = solved >= 0 ? bring(model, data, true) : solved;
        const bool failed = placed == PLIANT_ERROR_MEMORY || placed == PLIANT_ERROR_NUMERIC;
        if (placed < 0 && !failed) return placed;
        before = now;
        now = failed ? INFINITY : pliant_contact_deep_beside_patch(data);
        if (now < before) status = placed == PLIANT_OK ? solved : placed;
        else if (pliant_substeps_there(model, data, PLIANT_ENDED_LAST) < 0) return PLIANT_ERROR_UNAVAILABLE;
    }
    return status;
}

/* Where a solve has led to, with what a patch makes of it. solved: what came of it */
static pliant_status place(const pliant_model *model, pliant_data *data, pliant_substeps *parts, bool upsamples, pliant_status solved)
{
    const pliant_status placed = bring(model, data, upsamples), status = placed == PLIANT_OK ? solved : placed;
    return status >= 0 && parts->kept && pliant_patch_serves(data) > 0 ? take_turns(model, data, parts, status) : status;
}

/* Whether tissue has gone by a tool: there are points of it now. */
static bool passes(const pliant_model *model, pliant_data *data, const pliant_contact_start *begun)
{
    if (data->falling) (void)pliant_falling_ahead(data->falling, &data->contacts, data->positions);
    const bool passed = pliant_contact_passed(model, data, begun);
    if (data->falling) pliant_falling_stay(data->falling, data->positions); /* until the step places them */
    return passed;
}

/* Or a piece has let one in that goes far, or has turned by more than it was solved for: there is more to solve it with now. */
static bool gets_by(const pliant_model *model, pliant_data *data, const pliant_substeps *parts, const pliant_contact_start *begun)
{
    const double as_foreseen = 1e-4; /* [m] */
    if (!data->falling || parts->most == 1) return passes(model, data, begun);
    const double bent = pliant_falling_ahead(data->falling, &data->contacts, data->positions);
    const bool passed = pliant_contact_passed(model, data, begun), deep = pliant_contact_piece_is_deep(data, begun);
    pliant_falling_stay(data->falling, data->positions);
    return passed || deep || bent > as_foreseen;
}

/* Whether what a step was solved again to is no good, and it can be taken in more parts than it is. */
static bool goes_wrong(const pliant_model *model, pliant_data *data, const pliant_substeps *parts)
{
    if (!pliant_substeps_can_be_more(data, parts)) return false;
    const pliant_contact_start start = pliant_substeps_start(data, parts);
    return pliant_substeps_turned(data) || gets_by(model, data, parts, &start);
}

/* Of where a part of a step that tissue gets by in was solved to: an element that it has turned inside out is as bad as tissue by a whole depth of a tool in it. INFINITY: it is through. */
static double badness(const pliant_data *data)
{
    const double through = 2, by = pliant_contact_passed_by(data); /* depths: the other side of a part */
    return by < through ? by + pliant_substeps_turn_over(data) : INFINITY;
}

/* The solve and upsample of a step, or of a part of it, once more, with the points of what has passed a tool, from where it began if that is kept: where
 * tissue has got by, it has gone astray. One with a budget takes no more of them than there is time for. Where solving again fails, the step stays as it was solved.
 * *wrong: tissue still gets by, or is inside out. Errors: UNAVAILABLE. */
static pliant_status solve_again(const pliant_model *model, pliant_data *data, pliant_substeps *parts, pliant_status first, bool *wrong)
{
    enum { MOST = 12 };
    const bool kept = parts->kept;
    const pliant_contact_start begun = pliant_substeps_start(data, parts);
    int again = 0;
    double least = INFINITY; /* of how bad it was where PLIANT_ENDED_WELL is; INFINITY: it is nowhere */
    const bool may_pass = pliant_contact_may_pass(model, data);
    parts->patched = false;
    if (!may_pass && parts->at == parts->count) return first;
    pliant_status status = place(model, data, parts, false, first); /* the next part begins there, too */
    if (status < 0) return status;
    parts->patched = pliant_patch_serves(data) > 0;
    if (!may_pass) return status;
    take_no_more(data);
    for (; again < MOST && status >= 0 && pliant_solver_has_time(data->solver) && gets_by(model, data, parts, &begun); again++) {
        if (kept && !pliant_substeps_can_go_back(data)) break;
        const double bad = kept && status == PLIANT_OK ? badness(data) : INFINITY;
        if (bad < INFINITY && bad <= least && pliant_substeps_here(model, data, PLIANT_ENDED_WELL)) least = bad;
        const pliant_status ended = status;
        if (!kept) pliant_contact_goes_on_from_here(data);
        else if ((status = pliant_substeps_back(model, data)) < 0) break;
        status = solve_more(model, data);
        if (status >= 0) status = place(model, data, parts, true, status);
        if (status == PLIANT_ERROR_MEMORY || status == PLIANT_ERROR_NUMERIC) {
            const pliant_status there = kept ? pliant_substeps_there(model, data, PLIANT_ENDED_LAST) : PLIANT_OK;
            status = there < 0 ? there : ended;
            break;
        }
    }
    const bool far_off = status == PLIANT_NOT_CONVERGED && data->statistics.error > data->body->fine.cell_size[0];
    *wrong = status >= 0 && (again > 0 || far_off) && goes_wrong(model, data, parts);
    /* gone astray for good: of what it was solved to, all of which lets tissue in, the least bad */
    if (least < INFINITY && status >= 0 && !*wrong && passes(model, data, &begun) && badness(data) > least) status = pliant_substeps_there(model, data, PLIANT_ENDED_WELL);
    return status;
}

/* One stage, timed. goes_on: it was run in this step before; patched: so was the patches' part of theirs */
static pliant_status run_stage(const pliant_model *model, pliant_data *data, int stage, bool goes_on, bool patched)
{
    const pliant_backend *backend = data->backend;
    pliant_status (*const stages[])(const pliant_model *, pliant_data *) = {pliant_cut_stage, interact, pliant_contact_stage, solve, backend->upsample, patched ? move_pieces : patch, backend->warp};
    _Static_assert(sizeof stages / sizeof *stages == PLIANT_NUM_STEP_STAGES, "one function a stage, in order");
    const double start = pliant_seconds();
    const bool beyond = stage == PLIANT_STEP_solve && data->contacts.count > 0 && !backend->on_host && (!backend->touches || searches_on_the_way(model));
    const int32_t iterations = data->statistics.iterations;
    const pliant_status status = beyond ? pliant_fail(PLIANT_ERROR_UNAVAILABLE, "tissue is near something, and that contact is the CPU's") : stages[stage](model, data);
    data->statistics.seconds[stage] = pliant_seconds() - start + (goes_on || (patched && stage == PLIANT_STEP_patch) ? data->statistics.seconds[stage] : 0);
    if (stage == PLIANT_STEP_solve && goes_on) data->statistics.iterations += iterations;
    return status;
}

/* The stages in their order; contact, solve and upsample once for each part that the step is taken in. */
static pliant_status run_stages(const pliant_model *model, pliant_data *data, pliant_substeps *parts, pliant_status *caveat)
{
    const pliant_background background = data->background;
    bool whole = true;
    for (int stage = 0; stage < PLIANT_NUM_STEP_STAGES; stage++) {
        const pliant_backend *backend = data->backend;
        if (stage == PLIANT_STEP_contact && parts->at == 0) pliant_substeps_begin(model, data, parts);
        if (stage == PLIANT_STEP_contact) pliant_frame_part_begin(model, data);
        bool wrong = false, more = false, again = false;
        const bool goes_on = !whole && stage >= PLIANT_STEP_contact && stage <= PLIANT_STEP_upsample;
        if (goes_on) take_no_more(data);
        if (stage == PLIANT_STEP_contact && whole) data->statistics.seconds[PLIANT_STEP_patch] = 0;
        const pliant_status begun = stage == PLIANT_STEP_interact ? pliant_rollback_begin(model, data) : PLIANT_OK;
        pliant_status status = begun < 0 ? begun : run_stage(model, data, stage, goes_on, parts->patched);
        if (stage == PLIANT_STEP_solve && status == PLIANT_ERROR_NUMERIC && pliant_frame_part_stays(model, data)) status = PLIANT_OK;
        if (stage == PLIANT_STEP_upsample && status >= 0 && (status = solve_again(model, data, parts, *caveat, &wrong)) >= 0) *caveat = status;
        data->background = (pliant_background){.kind = background.kind, .prescribed = background.prescribed, .taken = data->background.taken};
        /* the first stages are the host's own */
        if (status < 0 && stage > PLIANT_STEP_contact && pliant_backend_fall_back(model, data, status)) {
            bool on_host = backend->solves_on_host || (stage == PLIANT_STEP_warp && (pliant_host_moves(data) || pliant_contact_may_pass(model, data))); /* only this stage is done again */
            stage = on_host ? stage - 1 : PLIANT_STEP_solve - 1; /* again, by the CPU */
            continue;
        }
        if (status < 0) return status;
        if (status > 0) *caveat = status;
        if (stage == PLIANT_STEP_contact) {
            pliant_substeps_found(data, parts);
            pliant_frame_part_found(data);
        }
        if (stage != PLIANT_STEP_upsample) continue;
        if ((status = pliant_frame_part_gets_by(model, data, &again)) < 0) return status;
        if (again) {
            whole = false;
            *caveat = PLIANT_OK;
            stage = PLIANT_STEP_solve - 1;
            continue;
        }
        if ((status = pliant_frame_part_end(data, &more)) < 0) return status;
        if (wrong && (status = pliant_substeps_again(model, data, parts)) < 0) return status;
        if (wrong || more || pliant_substeps_next(model, data, parts)) {
            whole = false;
            *caveat = PLIANT_OK; /* that of the last part counts */
            stage = PLIANT_STEP_contact - 1;
        }
    }
    return PLIANT_OK;
}

static pliant_status step(const pliant_model *model, pliant_data *data)
{
    pliant_status caveat = PLIANT_OK;
    pliant_substeps parts = {.at = 0};
    data->background.taken = 0;
    const pliant_status status = run_stages(model, data, &parts, &caveat);
    if (status < 0) {
        pliant_substeps_undo(model, data, &parts);
        if (parts.at > 0) pliant_frame_undo(model, data);
        pliant_rollback_undo(model, data);
        data->statistics.failed++;
        return status;
    }
    const uint32_t missing = data->background.prescribed & ~data->background.taken;
    if (missing)
        pliant_log(PLIANT_LOG_WARNING, "step %llu: what it was to take (pliant_data_set_background: %u) was not under way: another run than the recorded one",
                   (unsigned long long)data->statistics.step, (unsigned)missing);
    data->background.prescribed = 0;
    pliant_contact_end(data);
    data->statistics.step++;
    data->statistics.not_converged += caveat == PLIANT_NOT_CONVERGED;
    return caveat;
}

pliant_status pliant_step(const pliant_model *model, pliant_data *data)
{
    pliant_account *before = pliant_held_begin(data);
    const pliant_status status = step(model, data);
    pliant_held_end(data, before);
    return status;
}
