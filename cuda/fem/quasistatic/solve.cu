#include "cuda/fem/quasistatic/anderson.h"
#include "cuda/base/check.h"
#include "base/fail.h"
#include "cuda/fem/element/forces.h"
#include "base/memory.h"
#include "cuda/fem/quasistatic/solver.h"
#include "cuda/fem/coarse/upsample.h"

#include <cmath>
#include <cstddef>
#include <cstring>

/* A hold that the GPU has, without a computed response. */
static const uint64_t no_response = UINT64_MAX;

static pliant_status fill(pliant_cuda_solver *gpu, const pliant_solver *solver)
{
    CUDA_TRY(CUDA_CALL(cudaSetDevice(gpu->device)));
    if (solver->system->of) CUDA_TRY(pliant_system_find_pattern(solver->system->of->system));
    CUDA_TRY(pliant_cuda_system_create(solver->system, gpu->stream, &gpu->system, &gpu->system_capacity));
    CUDA_TRY(pliant_cuda_preconditioner_create(solver->system, solver->system->mesh->rest, gpu->choice, gpu->stream,
                                               &gpu->preconditioner));
    CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(gpu->stream)));
    CUDA_TRY(pliant_cuda_solver_size(gpu, solver));
    CUDA_TRY(pliant_cuda_allocate_host(sizeof(gpu_state), "the solver", &gpu->h_state));
    CUDA_TRY(pliant_cuda_solver_record(gpu));
    if (gpu->system_capacity.grows) {
        CUDA_TRY(pliant_cuda_carried_load_kernels());
        CUDA_TRY(pliant_cuda_newton_load_kernels());
        CUDA_TRY(pliant_cuda_solver_newton_reserve(gpu));
    }
    return pliant_cuda_solver_restart(gpu, solver);
}

pliant_status pliant_cuda_solver_create(const pliant_solver *solver, pliant_preconditioner_choice choice, bool grows,
                                        int device, cudaStream_t stream, pliant_cuda_solver **out)
{
    pliant_cuda_solver *gpu = static_cast<pliant_cuda_solver *>(pliant_calloc(1, sizeof *gpu));
    if (!gpu) return pliant_fail_memory("the solver");
    gpu->device = device;
    gpu->stream = stream;
    gpu->choice = choice;
    gpu->system_capacity.grows = grows;
    pliant_status status = fill(gpu, solver);
    if (status != PLIANT_OK) {
        pliant_cuda_solver_free(gpu);
        return status;
    }
    *out = gpu;
    return PLIANT_OK;
}

void pliant_cuda_solver_free(pliant_cuda_solver *gpu)
{
    if (!gpu) return;
    pliant_cuda_refresh_free(gpu);
    if (gpu->evaluation) cudaGraphExecDestroy(gpu->evaluation);
    if (gpu->free_step_graph) cudaGraphExecDestroy(gpu->free_step_graph);
    if (gpu->contact_graph) cudaGraphExecDestroy(gpu->contact_graph);
    pliant_cuda_contacts_free(&gpu->contacts);
    gpu_iteration *it = &gpu->iteration;
    pliant_cuda_release(it->d_state, it->d_history, it->d_x[0], it->d_x[1], it->d_step[0], it->d_step[1],
                        it->d_residual[0], it->d_residual[1], it->d_free_residual, it->d_past_step, it->d_past_residual,
                        it->d_load, it->d_extra, it->d_contact_force, it->d_secant_x, it->d_secant_step,
                        it->d_secant_residual, it->d_element_force, it->d_rotations, it->d_axes, it->d_right,
                        it->d_left, it->d_sums, gpu->d_fine, gpu->d_solved, gpu->d_between, gpu->d_reference);
    for (gpu_tool_arrays &tool : gpu->tools) pliant_cuda_release(tool.d_unknown, tool.d_block, tool.d_response);
    pliant_cuda_pressures_free(&gpu->iteration.pressures, &gpu->pressure_memory);
    pliant_cuda_release_host(gpu->h_state, gpu->h_solved, gpu->h_newton);
    pliant_cuda_preconditioner_free(&gpu->preconditioner);
    pliant_cuda_preconditioner_free(&gpu->at_rest);
    pliant_cuda_preconditioner_free(&gpu->unused);
    pliant_cuda_system_free(&gpu->system, &gpu->system_capacity);
    pliant_free(gpu);
}

pliant_status pliant_cuda_solver_begin(pliant_cuda_solver *gpu, const pliant_solver *solver)
{
    const size_t bytes = 3 * (size_t)gpu->system.num_nodes * sizeof(double);
    gpu->in_use.number++;
    gpu->in_use.has_inaccurate_rotations =
        gpu->system.d_stiffness || (gpu->system.macros.count > 0 && !gpu->system.macros.d_shear);
    CUDA_TRY(pliant_cuda_send(solver->now.x, bytes, gpu->iteration.d_x[0], gpu->stream));
    CUDA_TRY(CUDA_CALL(
        cudaMemcpyAsync(gpu->iteration.d_x[1], gpu->iteration.d_x[0], bytes, cudaMemcpyDeviceToDevice, gpu->stream)));
    gpu->loaded = false;
    gpu->fresh = true;
    gpu->last_launches = 3;
    return PLIANT_OK;
}

pliant_status pliant_cuda_solver_restart(pliant_cuda_solver *gpu, const pliant_solver *solver)
{
    CUDA_TRY(CUDA_CALL(cudaSetDevice(gpu->device)));
    CUDA_TRY(pliant_cuda_refresh_restart(gpu, solver));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(gpu->iteration.d_state, 0, sizeof(gpu_state), gpu->stream)));
    CUDA_TRY(pliant_cuda_rotate(&gpu->system, &gpu->iteration, true, gpu->stream));
    pliant_preconditioner_use_rotated(&gpu->in_use);
    gpu->in_use.is_rotated = false; /* restored to the rest axes */
    gpu->in_use.rotation_step = 0;
    CUDA_TRY(pliant_cuda_pressures_send(&gpu->iteration.pressures, solver, gpu->stream));
    CUDA_TRY(pliant_cuda_solver_begin(gpu, solver));
    return CUDA_CALL(cudaStreamSynchronize(gpu->stream));
}

pliant_status pliant_cuda_solver_move(pliant_cuda_solver *gpu, const pliant_solver *solver)
{
    CUDA_TRY(CUDA_CALL(cudaSetDevice(gpu->device)));
    gpu->in_use.evaluations =
        pliant_get_quasistatic_settings()
            .rotation_interval; /* as pliant_solver_reset_after_move: the axes rotate in the next step */
    return pliant_cuda_solver_begin(gpu, solver);
}

/* ---- In a step. */

static pliant_status send_load(pliant_cuda_solver *gpu, const pliant_solver *solver, const double gravity[3])
{
    if (gpu->loaded && memcmp(gpu->gravity, gravity, sizeof gpu->gravity) == 0) return PLIANT_OK;
    const size_t bytes = 3 * (size_t)gpu->system.num_free * sizeof(double);
    CUDA_TRY(pliant_cuda_send(solver->load, bytes, gpu->iteration.d_load, gpu->stream));
    memcpy(gpu->gravity, gravity, sizeof gpu->gravity);
    gpu->loaded = true;
    return PLIANT_OK;
}

template <class T> static pliant_status ensure(const pliant_cuda_solver *gpu, size_t count, T **d_out, size_t *capacity)
{
    const T *const before = *d_out;
    CUDA_TRY(pliant_cuda_ensure(count * sizeof(T), gpu->system_capacity.grows, "the solver", d_out, capacity));
    return before == *d_out ? PLIANT_OK : CUDA_CALL(cudaMemsetAsync(*d_out, 0, *capacity, gpu->stream));
}

/* Send W of a tool that has grasped. */
static pliant_status send_hold(pliant_cuda_solver *gpu, const pliant_grasp_constraint *grasp, gpu_tool_arrays *arrays)
{
    const size_t maximum = (size_t)gpu->system.num_free, count = (size_t)grasp->count;
    CUDA_TRY(ensure(gpu, maximum, &arrays->d_unknown, &arrays->unknown_capacity));
    CUDA_TRY(ensure(gpu, 9 * maximum, &arrays->d_block, &arrays->block_capacity));
    CUDA_TRY(ensure(gpu, 9 * maximum, &arrays->d_response, &arrays->response_capacity));
    CUDA_TRY(pliant_cuda_send(grasp->unknown, count * sizeof(int32_t), arrays->d_unknown, gpu->stream));
    return pliant_cuda_send(grasp->block, 9 * count * sizeof(double), arrays->d_block, gpu->stream);
}

/* Send the tools' inputs of this step, and compute responses for new holds and after a change of the preconditioner.
 * responded: out: responses were computed, so the preconditioner's last result is overwritten. */
static pliant_status send_tools(pliant_cuda_solver *gpu, pliant_solver *solver, gpu_step *step, bool *responded)
{
    bool fresh = false;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        pliant_grasp_constraint *grasp = solver->grasps + t;
        gpu_tool_arrays *arrays = gpu->tools + t;
        gpu_tool *tool = step->tools + t;
        memcpy(tool->force, grasp->force, sizeof tool->force);
        if (!grasp->active || grasp->count == 0) continue;
        if (grasp->response_number == 0) {
            CUDA_TRY(send_hold(gpu, grasp, arrays));
            fresh = true;
        }
        tool->active = 1;
        tool->spring = !grasp->by_force;
        tool->count = grasp->count;
        tool->d_unknown = arrays->d_unknown;
        tool->d_block = arrays->d_block;
        tool->d_response = arrays->d_response;
        tool->compliance = grasp->compliance;
        memcpy(tool->target, grasp->target, sizeof tool->target);
        memcpy(tool->origin, grasp->origin, sizeof tool->origin);
        if (grasp->response_number == gpu->in_use.number) continue;
        grasp->response_number = no_response;
        if (!tool->spring) continue;
        CUDA_TRY(pliant_cuda_respond(&gpu->preconditioner, &gpu->iteration, tool, arrays->d_response, gpu->stream));
        *responded = true;
        grasp->response_number = gpu->in_use.number;
    }
    /* Nodes that are not held any more must have no force. */
    if (fresh || !solver->previous.is_comparable)
        CUDA_TRY(CUDA_CALL(cudaMemsetAsync(gpu->iteration.d_extra, 0, 3 * (size_t)gpu->system.num_free * sizeof(double),
                                           gpu->stream)));
    return PLIANT_OK;
}

static pliant_status turn(pliant_cuda_solver *gpu, const pliant_solver *solver, pliant_statistics *statistics,
                          gpu_step *step)
{
    const pliant_axes axes = pliant_solver_choose_axes(solver, &gpu->in_use, statistics->step);
    if (axes == PLIANT_AXES_KEEP) return PLIANT_OK;
    CUDA_TRY(pliant_cuda_rotate(&gpu->system, &gpu->iteration, false, gpu->stream));
    pliant_preconditioner_use_rotated(&gpu->in_use);
    gpu->in_use.rotation_step = statistics->step;
    if (axes == PLIANT_AXES_ROTATE) return PLIANT_OK;
    step->drops_secants = 1;
    statistics->factors++;
    return PLIANT_OK;
}

/* Restore the axes after the Newton step of a cut was rejected. They were used until here. */
static pliant_status turn_back(pliant_cuda_solver *gpu, pliant_solver *solver)
{
    if (gpu->in_use.has_inaccurate_rotations) return PLIANT_OK;
    solver->previous.is_comparable = false;
    pliant_preconditioner_use_rotated(&gpu->in_use);
    return pliant_cuda_rotate(&gpu->system, &gpu->iteration, false, gpu->stream);
}

static pliant_status run(pliant_cuda_solver *gpu, const gpu_step *step)
{
    CUDA_TRY(pliant_cuda_begin(&gpu->iteration, step, gpu->stream));
    CUDA_TRY(pliant_cuda_solver_evaluate_first(gpu, step->known == PLIANT_KNOWN_STEP));
    /* Includes one evaluation each of: the state before a blind step, a descent, the rest state, and the step's end or
     * the trial that replaces it. */
    const int32_t maximum = step->max_evaluations + 4;
    int32_t ahead = gpu->last_launches; /* a step needs about as many as the last one; superfluous launches do
                                         * nothing */
    for (int32_t spent = 1; spent < maximum; ahead = 2) {
        for (int32_t n = 1; n < ahead && spent < maximum; n++, spent++)
            CUDA_TRY(CUDA_CALL(cudaGraphLaunch(gpu->evaluation, gpu->stream)));
        CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(gpu->h_state, gpu->iteration.d_state, offsetof(gpu_state, rows),
                                           cudaMemcpyDeviceToHost, gpu->stream)));
        CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(gpu->stream)));
        if (gpu->h_state->done) return PLIANT_OK;
    }
    return pliant_fail(PLIANT_ERROR_UNAVAILABLE, "the GPU failed: the solver did not finish");
}

/* Set the step's inputs from the host's limits and the known quantities of the first state. newton_evaluations: out:
 * evaluations of the Newton step after a cut. */
static pliant_status prepare(pliant_cuda_solver *gpu, pliant_solver *solver, const double gravity[3],
                             pliant_statistics *statistics, bool renewed, gpu_step *step, int32_t *newton_evaluations)
{
    bool responded = false, start_is_evaluated = false;
    CUDA_TRY(send_load(gpu, solver, gravity));
    CUDA_TRY(turn(gpu, solver, statistics, step));
    step->drops_secants = step->drops_secants || renewed || !solver->previous.is_comparable;
    CUDA_TRY(send_tools(gpu, solver, step, &responded));
    step->limit = pliant_solver_limit(solver);
    CUDA_TRY(pliant_cuda_solver_newton_step(gpu, solver, step, newton_evaluations));
    if (step->after_newton) CUDA_TRY(send_tools(gpu, solver, step, &responded)); /* forces and axes have changed */
    const pliant_anderson *limits = &solver->rules;
    step->max_evaluations =
        *newton_evaluations > 0
            ? pliant_solver_newton_limit(solver, &step->limit,
                                         pliant_get_quasistatic_settings().newton_evaluation_fraction_gpu) -
                  *newton_evaluations
            : limits->max_evaluations;
    step->depth = limits->depth;
    step->capacity = limits->capacity;
    step->tolerance = limits->tolerance;
    step->smallest_displacement = limits->smallest_displacement;
    step->is_cycle = gpu->preconditioner.multigrid != nullptr;
    step->smallest_scale = solver->smallest_scale;
    step->restart = gpu->fresh;
    step->known = pliant_solver_find_known(solver, &gpu->in_use, &start_is_evaluated);
    step->start_is_evaluated = start_is_evaluated;
    if (responded && step->known == PLIANT_KNOWN_STEP) step->known = PLIANT_KNOWN_FORCES;
    step->has_contacts = pliant_contact_problem_has_points(solver->contacts);
    if (step->has_contacts || gpu->had_contacts)
        CUDA_TRY(CUDA_CALL(cudaMemsetAsync(gpu->iteration.d_contact_force, 0,
                                           3 * (size_t)gpu->system.num_free * sizeof(double), gpu->stream)));
    gpu->had_contacts = step->has_contacts;
    if (step->limit.evaluations < INT32_MAX)
        step->limit.evaluations += (step->known == PLIANT_KNOWN_STEP) - *newton_evaluations;
    return PLIANT_OK;
}

/* Report the result of the last step that did work. */
static void report_residuals(const pliant_cuda_solver *gpu, pliant_statistics *statistics)
{
    const gpu_state *state = gpu->h_state;
    statistics->residual = state->rules.merit / state->accepted_scale;
    statistics->residual_force = state->accepted_residual_force;
    statistics->error = state->rules.error;
}

/* Number of evaluations of a step so far, and its first estimate of the previous step's error. */
struct step_so_far {
    int32_t newton_evaluations;            /* of the Newton step after a cut, before the others */
    int32_t solved, iterations;
    double error_before;
};

/* Record the result of evaluations: the tools' forces, and the number of evaluations. */
static void record_evaluations(pliant_cuda_solver *gpu, pliant_solver *solver, const gpu_step *step,
                               pliant_statistics *statistics, step_so_far *so_far)
{
    const gpu_state *state = gpu->h_state;
    const pliant_anderson *rules = &state->rules;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        memcpy(solver->grasps[t].force, state->force[state->now] + 3 * t, sizeof solver->grasps[t].force);
    solver->rules.is_cycle = rules->is_cycle; /* for the error of motion that a leg loses (sim/step/legs_state.c) */
    solver->rules.log_contraction = rules->log_contraction;
    gpu->fresh = false;
    gpu->last_launches = rules->evaluations + state->evaluates_end;
    const int32_t solved = gpu->last_launches - (step->known == PLIANT_KNOWN_STEP);
    if (so_far->iterations == 0) so_far->error_before = rules->error_before;
    so_far->solved += solved;
    so_far->iterations += rules->evaluations - rules->last;
    gpu->in_use.evaluations += solved;
    statistics->rejected += (uint64_t)rules->rejected;
}

static pliant_status take_step(pliant_cuda_solver *gpu, pliant_solver *solver, const double gravity[3],
                               pliant_statistics *statistics)
{
    gpu_step step = {};
    bool renewed = false;
    step_so_far so_far = {};
    CUDA_TRY(CUDA_CALL(cudaSetDevice(gpu->device)));
    CUDA_TRY(pliant_cuda_refresh_step(gpu, solver, statistics, &renewed));
    if (gpu->fresh) pliant_solver_drop_history(solver);
    if (!renewed && pliant_solver_is_idle(solver)) {
        statistics->iterations = 0;
        report_residuals(gpu, statistics);
        statistics->error_before = statistics->error;
        return PLIANT_OK;
    }
    CUDA_TRY(prepare(gpu, solver, gravity, statistics, renewed, &step, &so_far.newton_evaluations));
    CUDA_TRY(step.has_contacts ? pliant_cuda_contacts_run(gpu, solver, &step) : run(gpu, &step));
    record_evaluations(gpu, solver, &step, statistics, &so_far);
    const gpu_state *state = gpu->h_state;
    const pliant_anderson *rules = &state->rules;
    if (!isfinite(rules->merit)) return pliant_fail(PLIANT_ERROR_NUMERIC, PLIANT_LOAD_NOT_FINITE);
    pliant_solver_record_step(solver, &gpu->in_use, state->evaluated, rules, state->step_force[state->now]);
    pliant_evaluations_record(&solver->evaluation_history, so_far.solved + so_far.newton_evaluations,
                              rules->first_merit);
    if (step.after_newton && state->restored_previous) CUDA_TRY(turn_back(gpu, solver));
    gpu->in_use.converged_slowly =
        gpu->in_use.converged_slowly || rules->rate > pliant_get_quasistatic_settings().poor_rate;
    gpu->wants_refresh = gpu->wants_refresh || (step.has_contacts && rules->rejected > 0);
    statistics->iterations = so_far.newton_evaluations + so_far.iterations;
    report_residuals(gpu, statistics);
    statistics->error_before = so_far.error_before;
    pliant_contact_problem_report_motion(solver->contacts, pliant_cuda_contacts_motion(&gpu->contacts), statistics);
    return rules->converged ? PLIANT_OK : PLIANT_NOT_CONVERGED;
}

/* After an error, restore the tools' forces and the flag of the step after a cut. The host continues from the state
 * before. */
pliant_status pliant_cuda_solver_step(pliant_cuda_solver *gpu, pliant_solver *solver, const double gravity[3],
                                      pliant_statistics *statistics)
{
    const bool was_after_cut = solver->is_after_cut;
    double force[PLIANT_MAX_TOOLS][3];
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) memcpy(force[t], solver->grasps[t].force, sizeof force[t]);
    const pliant_status status = take_step(gpu, solver, gravity, statistics);
    if (status == PLIANT_OK || status == PLIANT_NOT_CONVERGED) return status;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) memcpy(solver->grasps[t].force, force[t], sizeof force[t]);
    solver->is_after_cut = was_after_cut;
    return status;
}

pliant_status pliant_cuda_solver_upsample(pliant_cuda_solver *gpu, const double **d_positions)
{
    CUDA_TRY(pliant_cuda_upsample(&gpu->system, &gpu->iteration, gpu->d_fine, gpu->d_solved, gpu->stream));
    *d_positions = gpu->d_fine;
    return PLIANT_OK;
}

pliant_status pliant_cuda_solver_download(pliant_cuda_solver *gpu)
{
    CUDA_TRY(pliant_cuda_pressures_download(&gpu->iteration.pressures, &gpu->pressure_memory, gpu->h_state->now,
                                            gpu->stream));
    if (!gpu->h_solved) return PLIANT_OK;
    const size_t bytes = 3 * (size_t)gpu->system.num_nodes * sizeof(double);
    return CUDA_CALL(cudaMemcpyAsync(gpu->h_solved, gpu->d_solved, bytes, cudaMemcpyDeviceToHost, gpu->stream));
}

void pliant_cuda_solver_take(const pliant_cuda_solver *gpu, pliant_solver *solver)
{
    if (gpu->h_solved) memcpy(solver->now.x, gpu->h_solved, 3 * (size_t)gpu->system.num_nodes * sizeof(double));
    if (gpu->iteration.pressures.count > 0)
        memcpy(solver->now.pressure, gpu->pressure_memory.h_pressure,
               (size_t)gpu->iteration.pressures.count * sizeof(double));
}

pliant_status pliant_cuda_solver_place(pliant_cuda_solver *gpu, const double *h_fine)
{
    const size_t bytes = 3 * (size_t)gpu->system.num_fine * sizeof(double);
    return pliant_cuda_send(h_fine, bytes, gpu->d_fine, gpu->stream);
}
