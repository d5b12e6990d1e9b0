/* A step of the quasi-static solver: iterate until the residual of the node positions is small. */
#include "fem/quasistatic/pressure.h"

#include "base/dense.h"
#include "base/fail.h"

#include <string.h>

/* ---- An evaluation. */

/* Compute the change dl = S^-1 (e - W g0) of the tools' forces that brings the held points to their targets, and the
 * step with it: g = g0 + Z dl, K0 g = r + W' dl. e is the distance to the target (pliant_grasp_stretch). Return false
 * if S is singular. */
static bool step_tools(const pliant_solver *solver, pliant_iterate *at)
{
    int index[PLIANT_MAX_TOOLS];
    double s[PLIANT_MAX_ROWS * PLIANT_MAX_ROWS] = {0}, right[PLIANT_MAX_ROWS];
    memset(at->step_force, 0, sizeof at->step_force);
    const int count = pliant_solver_list_springs(solver, index);
    if (count == 0) return true;
    pliant_solver_fill_springs(solver, index, count, 3 * (size_t)count, s);
    for (int a = 0; a < count; a++) {
        double w[3] = {0, 0, 0};
        pliant_grasp_stretch(solver, index[a], at, right + 3 * a);
        pliant_grasp_apply(solver->grasps + index[a], at->step, w);
        for (int d = 0; d < 3; d++) right[3 * a + d] -= w[d];
    }
    if (!pliant_dense_solve(3 * count, s, 1, right)) return false;
    for (int a = 0; a < count; a++) {
        memcpy(at->step_force + 3 * index[a], right + 3 * a, 3 * sizeof *right);
        pliant_grasp_add_pull(solver->grasps + index[a], right + 3 * a, at->residual);
        pliant_solver_add_response(solver, index[a], right + 3 * a, at->step);
    }
    return true;
}

/* Evaluate a state: compute its residual, which contains the tools' forces, its preconditioned step, and its merit.
 * known: quantities that are already computed. Errors: MEMORY. */
static pliant_status evaluate(pliant_solver *solver, pliant_known known, pliant_iterate *at)
{
    const size_t bytes = pliant_solver_unknowns(solver) * sizeof *at->residual;
    solver->in_use.evaluations += known != PLIANT_KNOWN_STEP;
    if (known == PLIANT_KNOWN_NOTHING) pliant_solver_elastic_forces(solver, at);
    if (known == PLIANT_KNOWN_FORCES) pliant_pressure_find(solver, at);
    memcpy(at->residual, solver->load, bytes);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        if (solver->grasps[t].active)
            pliant_grasp_add_load(solver->grasps + t,
                                  solver->grasps[t].by_force ? solver->grasps[t].force : at->force + 3 * t,
                                  at->residual);
    if (pliant_contact_problem_has_points(solver->contacts))
        pliant_contact_problem_add_load(solver->contacts, at->residual);
    pliant_solver_find_residual(solver, at);
    at->merit = INFINITY;
    const bool sensible =
        isfinite(at->scale) &&
        at->displacement <= pliant_get_quasistatic_settings().max_displacement * solver->rules.smallest_displacement;
    if (!sensible) return PLIANT_OK; /* an invalid state is never accepted */
    const bool contacts = pliant_contact_problem_has_points(solver->contacts);
    pliant_status status = known == PLIANT_KNOWN_STEP ? PLIANT_OK
                           : contacts
                               ? pliant_contact_problem_free_step(solver, at)
                               : pliant_preconditioner_solve(solver->preconditioner, 1, at->residual, at->free_step);
    if (status != PLIANT_OK) return status;
    memcpy(at->step, at->free_step, bytes);
    if (contacts && (status = pliant_contact_problem_step(solver, at)) != PLIANT_OK) return status;
    if (!step_tools(solver, at)) return PLIANT_OK;
    if (known != PLIANT_KNOWN_STEP) pliant_pressure_step(solver, at);
    const double energy = pliant_solver_product(solver, at->step, at->residual) +
                          pliant_solver_spring_energy(solver, at->step_force, at->step_force) +
                          pliant_pressure_energy(solver, at->pressure_step, at->pressure_step);
    at->merit = pliant_anderson_merit(energy, at->scale);
    return PLIANT_OK;
}

/* ---- A step by the rules of anderson.h. */

static void swap_iterates(pliant_solver *solver)
{
    pliant_iterate swap = solver->now;
    solver->now = solver->trial;
    solver->trial = swap;
}

/* Time limits of a step, and the duration of its evaluations. */
typedef struct step_time {
    double evaluation_start; /* start of the first complete evaluation [s] */
    int32_t whole;                  /* evaluations that included the forces */
    int32_t solved;                 /* evaluations that applied the preconditioner */
    pliant_evaluation_limit limit;
} step_time;

/* Return the number of further evaluations that fit in the budget, or in the limit of even steps. */
static int32_t affordable(const pliant_solver *solver, const step_time *time, double first_merit)
{
    if (!pliant_step_clock_has_limit(solver->clock))
        return pliant_evaluations_left(&time->limit, time->solved, first_merit);
    const double now = pliant_step_clock_read(solver->clock), left = solver->clock->budget - now,
                 each = time->whole > 0 ? (now - time->evaluation_start) / time->whole : solver->evaluation_seconds;
    return each > 0 && left < 1e6 * each ? (int32_t)fmax(left / each, 0) : INT32_MAX;
}

/* Return the slope of the potential energy along the trial's step, at its end. Return 0 with springs or contacts, which
 * are not part of the potential energy. */
static double slope_of(const pliant_solver *solver)
{
    if (pliant_contact_problem_has_points(solver->contacts)) return 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        if (pliant_grasp_is_spring(solver->grasps + t)) return 0;
    return pliant_solver_product(solver, solver->now.step, solver->trial.residual);
}

/* Set the state; fixed nodes keep their positions. force, pressure: NULL: zero. */
static void set_state(const pliant_solver *solver, pliant_iterate *at, const double *x,
                      const double force[PLIANT_MAX_ROWS], const double *pressure)
{
    const pliant_system *system = solver->system;
    for (int32_t f = 0; f < system->num_free; f++)
        memcpy(at->x + 3 * (size_t)system->node_of_free[f], x + 3 * (size_t)system->node_of_free[f], 3 * sizeof *x);
    if (force) memcpy(at->force, force, sizeof at->force);
    else memset(at->force, 0, sizeof at->force);
    if (pressure) pliant_pressure_copy(solver, pressure, at->pressure);
    else if (solver->pressures) memset(at->pressure, 0, (size_t)solver->pressures->count * sizeof *at->pressure);
}

static void swap_pressures(pliant_solver *solver)
{
    double *swap = solver->now.pressure;
    solver->now.pressure = solver->trial.pressure;
    solver->trial.pressure = swap;
}

/* Take a step without evaluation. The state before it is kept until the next step has judged it. */
static void take_blind_step(pliant_solver *solver)
{
    memcpy(solver->previous_x, solver->now.x, 3 * (size_t)solver->system->mesh->num_nodes * sizeof *solver->previous_x);
    memcpy(solver->previous_force, solver->now.force, sizeof solver->previous_force);
    double *swap = solver->now.x;
    solver->now.x = solver->trial.x;
    solver->trial.x = swap;
    memcpy(solver->now.force, solver->trial.force, sizeof solver->now.force);
    pliant_pressure_copy(solver, solver->now.pressure, solver->previous_pressure);
    swap_pressures(solver);
}

/* Set the trial to the next state. */
static void prepare_next(pliant_solver *solver)
{
    pliant_anderson *rules = &solver->rules;
    double left, made;
    if (rules->next == PLIANT_NEXT_PREVIOUS) {
        set_state(solver, &solver->trial, solver->previous_x, solver->previous_force, solver->previous_pressure);
    } else if (rules->next == PLIANT_NEXT_REST) {
        set_state(solver, &solver->trial, solver->system->mesh->rest, NULL, NULL);
    } else {
        const bool mixed = pliant_solver_propose(solver, &left, &made);
        if (rules->next != PLIANT_NEXT_DESCENT)
            pliant_anderson_finish_proposal(rules, mixed, left, made, solver->now.displacement);
    }
    if (rules->drops_secants) pliant_solver_drop_history(solver);
    if (rules->next == PLIANT_NEXT_BLIND) take_blind_step(solver);
}

static pliant_status iterate(pliant_solver *solver, pliant_known known, step_time *time)
{
    pliant_anderson *rules = &solver->rules;
    pliant_anderson_begin(rules);
    do {
        const bool first = rules->next == PLIANT_NEXT_FIRST;
        pliant_iterate *at = first ? &solver->now : &solver->trial;
        pliant_status status = evaluate(solver, first ? known : PLIANT_KNOWN_NOTHING, at);
        if (status != PLIANT_OK) return status;
        time->solved += !first || known != PLIANT_KNOWN_STEP;
        if (!first || known == PLIANT_KNOWN_NOTHING) time->whole++;
        else time->evaluation_start = pliant_step_clock_read(solver->clock);
        const bool plain =
            !rules->uses_secants && (rules->next == PLIANT_NEXT_TRIAL || rules->next == PLIANT_NEXT_DESCENT);
        const double slope =
            plain && !(at->merit < solver->now.merit && rules->next == PLIANT_NEXT_TRIAL) ? slope_of(solver) : 0;
        pliant_anderson_judge(rules, at->merit, slope,
                              affordable(solver, time, first ? at->merit : rules->first_merit));
        if (rules->secant_slot >= 0)
            pliant_solver_store_secant(solver, rules->secant_slot, &solver->now, &solver->trial);
        if (rules->accepts_state) swap_iterates(solver);
        if (pliant_contact_problem_has_points(solver->contacts) && (first || rules->accepts_state))
            pliant_contact_problem_accept(solver->contacts);
        if (rules->drops_secants) pliant_solver_drop_history(solver);
        if (rules->next == PLIANT_NEXT_PREVIOUS && (status = pliant_solver_newton_rollback(solver)) != PLIANT_OK)
            return status;
        prepare_next(solver);
    } while (rules->next != PLIANT_NEXT_DONE && rules->next != PLIANT_NEXT_BLIND);
    return PLIANT_OK;
}

/* Evaluate the end of a blind step as a trial from its start. The contact forces do not change: they have moved tissue
 * and proxies to this end. The new ones belong to a step that is not taken. */
static bool evaluate_end(pliant_solver *solver)
{
    double *x = solver->now.x;
    solver->now.x = solver->trial.x;
    solver->trial.x = x;
    memcpy(solver->trial.force, solver->now.force, sizeof solver->now.force);
    memcpy(solver->now.force, solver->previous_force, sizeof solver->now.force);
    swap_pressures(solver);
    bool good = evaluate(solver, PLIANT_KNOWN_NOTHING, &solver->trial) == PLIANT_OK;
    good = pliant_anderson_judge_end(&solver->rules, good ? solver->trial.merit : INFINITY);
    if (solver->rules.secant_slot >= 0)
        pliant_solver_store_secant(solver, solver->rules.secant_slot, &solver->now, &solver->trial);
    swap_iterates(solver);
    if (good) solver->rules.error = pliant_anderson_error(pliant_secants_error(solver, &solver->now));
    return good;
}

/* Store the evaluated quantities of the step's final state. */
static void store_final_state(pliant_solver *solver)
{
    pliant_iterate *at = &solver->final_state.at;
    const size_t bytes = pliant_solver_unknowns(solver) * sizeof(double);
    memcpy(at->step, solver->now.step, bytes);
    memcpy(at->residual, solver->now.residual, bytes);
    pliant_pressure_copy(solver, solver->now.pressure_step, at->pressure_step);
    memcpy(at->step_force, solver->now.step_force, sizeof at->step_force);
}

/* Evaluate the final state of the step, and report the error of the step before. A step usually ends blindly. The
 * next step starts there with other loads. The elastic forces stay valid. The preconditioned step stays valid if only
 * the tools' targets have changed. Around a patch, more inputs than the loads change, so the next step cannot use this
 * evaluation. */
static void evaluate_final_state(pliant_solver *solver, step_time *time)
{
    const bool blind = solver->rules.next == PLIANT_NEXT_BLIND,
               start_is_evaluated = solver->final_state.start_is_evaluated;
    const bool evaluates = blind && affordable(solver, time, solver->rules.first_merit) > 0;
    const bool evaluated = evaluates ? evaluate_end(solver) : !blind;
    time->whole += evaluates;
    time->solved += evaluates;
    if (pliant_step_clock_has_limit(solver->clock) && time->whole > 0)
        solver->evaluation_seconds = (pliant_step_clock_read(solver->clock) - time->evaluation_start) / time->whole;
    pliant_anderson_report_error(&solver->rules, start_is_evaluated,
                                 start_is_evaluated ? pliant_secants_error(solver, &solver->final_state.at) : 0);
    const bool keeps_final_state = evaluated && !solver->system->basis;
    pliant_solver_record_step(solver, &solver->in_use, keeps_final_state, &solver->rules, solver->now.step_force);
    if (keeps_final_state) store_final_state(solver);
}

/* Rotate the axes before a step. If the preconditioner converges slowly, a new one follows or none; the secants are
 * therefore kept. */
static void rotate_axes(pliant_solver *solver, uint64_t step)
{
    if (!solver->rotations) return;
    solver->in_use.is_rotated = solver->rotations->is_rotated;
    solver->in_use.is_renewed_when_slow = true;
    if (pliant_solver_choose_axes(solver, &solver->in_use, step) == PLIANT_AXES_KEEP) return;
    pliant_nodal_rotations_update(solver->system, solver->now.x, solver->rotations);
    pliant_solver_rotate_grasps(solver);
    pliant_preconditioner_use_rotated(&solver->in_use);
}

/* Allocate the arrays of a solver that takes over from another backend. */
static pliant_status begin(pliant_solver *solver)
{
    if (solver->has_step_arrays) return PLIANT_OK;
    pliant_status status = pliant_solver_allocate_step(solver);
    if (status == PLIANT_OK)
        pliant_nodal_rotations_refer(solver->system, solver->system->mesh->rest, solver->rotations);
    return status;
}

pliant_evaluation_limit pliant_solver_limit(const pliant_solver *solver)
{
    return pliant_evaluations_limit(&solver->evaluation_history, pliant_background_is_live(solver->background));
}

/* Return the evaluation limit of the first step after a cut, within the time budget. */
static int32_t first_evaluations(const pliant_solver *solver, const step_time *time)
{
    const pliant_evaluation_limit none = {INT32_MAX, 0};
    const int32_t part = pliant_get_quasistatic_settings().newton_evaluation_fraction;
    if (!pliant_step_clock_has_limit(solver->clock))
        return pliant_solver_newton_limit(solver, &time->limit, part);
    const int32_t possible = affordable(solver, time, INFINITY),
                  allowed = pliant_solver_newton_limit(solver, &none, part);
    return possible < allowed ? possible : allowed;
}

static pliant_status iterate_from_newton(pliant_solver *solver, step_time *time, int32_t *evaluations)
{
    const int32_t maximum = solver->rules.max_evaluations, allowed = first_evaluations(solver, time);
    bool settled = false;
    pliant_status status = PLIANT_OK;
    *evaluations = 0;
    if (pliant_solver_begin_newton(solver, allowed)) {
        status = evaluate(solver, PLIANT_KNOWN_NOTHING, &solver->now);
        if (status == PLIANT_OK) status = pliant_solver_newton_step(solver, allowed, evaluations, &settled);
        solver->is_after_cut = status != PLIANT_OK;
    }
    if (*evaluations > 0) solver->rules.max_evaluations = allowed - *evaluations;
    time->solved += *evaluations + settled;
    time->whole += *evaluations;
    const pliant_known known =
        pliant_solver_find_known(solver, &solver->in_use, &solver->final_state.start_is_evaluated);
    if (status == PLIANT_OK) status = iterate(solver, settled ? PLIANT_KNOWN_STEP : known, time);
    solver->rules.max_evaluations = maximum;
    *evaluations += solver->rules.evaluations - solver->rules.last;
    return status;
}

/* Report the residual of the last judged state. A step without work reports the residual of the previous step, since a
 * patch may have reported its own residual in between. */
static void report_residual(const pliant_solver *solver, pliant_statistics *statistics)
{
    statistics->residual = solver->rules.merit / solver->now.scale;
    statistics->residual_force = 0;
    for (int32_t f = 0; f < solver->system->num_free; f++) {
        const double *r = solver->now.residual + 3 * f;
        statistics->residual_force = fmax(statistics->residual_force, sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2]));
    }
}

pliant_status pliant_solver_step(pliant_solver *solver, pliant_statistics *statistics)
{
    pliant_status status = begin(solver);
    if (status == PLIANT_OK) status = pliant_refresh_step(solver, statistics);
    if (status == PLIANT_OK && pliant_solver_is_idle(solver)) {
        statistics->iterations = 0;
        report_residual(solver, statistics);
        statistics->error = statistics->error_before = solver->rules.error;
        return PLIANT_OK;
    }
    if (status == PLIANT_OK) rotate_axes(solver, statistics->step);
    if (status == PLIANT_OK)
        status = pliant_preconditioner_correct(
            solver->preconditioner, solver->now.x,
            solver->rotations && solver->rotations->is_rotated ? solver->rotations->rotation : NULL);
    /* The corrected preconditioner gives other steps. */
    if (pliant_preconditioner_base(solver->preconditioner)) solver->previous.number = 0;
    if (status == PLIANT_OK) status = pliant_solver_find_responses(solver);
    if (status == PLIANT_OK) status = pliant_contact_problem_find_matrix(solver);
    if (status != PLIANT_OK) return status;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        pliant_grasp_constraint *grasp = solver->grasps + t;
        /* All its nodes are fixed. */
        if (!grasp->by_force && grasp->count == 0) memset(grasp->force, 0, sizeof grasp->force);
        memcpy(solver->now.force + 3 * t, grasp->force, 3 * sizeof(double));
    }
    step_time time = {.evaluation_start = pliant_step_clock_read(solver->clock), .limit = pliant_solver_limit(solver)};
    solver->rules.is_bounded = pliant_contact_problem_has_points(solver->contacts);
    solver->rules.is_cycle = !pliant_preconditioner_can_fail(solver->preconditioner);
    status = iterate_from_newton(solver, &time, &statistics->iterations);
    statistics->rejected += (uint64_t)solver->rules.rejected;
    if (status != PLIANT_OK) return status;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        memcpy(solver->grasps[t].force, solver->now.force + 3 * t, 3 * sizeof(double));
    if (!isfinite(solver->rules.merit)) return pliant_fail(PLIANT_ERROR_NUMERIC, PLIANT_LOAD_NOT_FINITE);
    report_residual(solver, statistics);
    evaluate_final_state(solver, &time);
    pliant_evaluations_record(&solver->evaluation_history, time.solved, solver->rules.first_merit);
    pliant_contact_problem_report(solver, statistics);
    statistics->error = solver->rules.error;
    statistics->error_before = solver->rules.error_before;
    return solver->rules.converged ? PLIANT_OK : PLIANT_NOT_CONVERGED;
}
