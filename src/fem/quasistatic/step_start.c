/* Rules for the start of a step, for all backends: whether there is work to do, whether the axes of the nodes rotate
 * with the tissue, and which quantities of the first state are known. */
#include "fem/quasistatic/solver.h"

#include <string.h>

static bool has_same_grasp_input(const pliant_previous_step *previous, const pliant_grasp_constraint *grasp, int tool)
{
    return memcmp(previous->force + 3 * tool, grasp->force, sizeof grasp->force) == 0 &&
           previous->compliance[tool] == grasp->compliance &&
           memcmp(previous->target + 3 * tool, grasp->target, sizeof grasp->target) == 0;
}

void pliant_solver_drop_history(pliant_solver *solver)
{
    pliant_anderson_drop_secants(&solver->rules);
    solver->previous.is_comparable = false;
    solver->history_was_dropped = true;
}

bool pliant_solver_is_idle(const pliant_solver *solver)
{
    const pliant_previous_step *previous = &solver->previous;
    /* Around a patch, more inputs change than these. */
    bool same = !solver->system->basis && previous->is_comparable && previous->evaluated && previous->converged &&
                !previous->had_contacts && !pliant_contact_problem_has_points(solver->contacts) &&
                memcmp(previous->gravity, solver->gravity, sizeof previous->gravity) == 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS && same; t++)
        if (solver->grasps[t].active) same = has_same_grasp_input(previous, solver->grasps + t, t);
    return same;
}

/* Decide whether the axes rotate. Responses to springs are valid in the axes in which they were computed, and
 * homogenized elements have inaccurate rotations. In both cases the axes wait for the next preconditioner. They rotate
 * only if the present one converges slowly and no new one is due. Secants based on such responses are dropped then. */
pliant_axes pliant_solver_choose_axes(const pliant_solver *solver, const pliant_preconditioner_use *in_use,
                                      uint64_t step)
{
    const uint64_t interval = (uint64_t)solver->refresh_interval;
    bool waits = in_use->has_inaccurate_rotations;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        waits = waits ||
                (pliant_grasp_is_spring(solver->grasps + t) && solver->grasps[t].response_number == in_use->number);
    if (!waits)
        return !in_use->is_rotated || in_use->evaluations >= pliant_get_quasistatic_settings().rotation_interval
                   ? PLIANT_AXES_ROTATE
                   : PLIANT_AXES_KEEP;
    const bool follows = !in_use->is_renewed_when_slow && in_use->converged_slowly && interval > 0 &&
                         step >= in_use->rotation_step + interval;
    return follows ? PLIANT_AXES_ROTATE_AND_DROP_HISTORY : PLIANT_AXES_KEEP;
}

void pliant_preconditioner_use_rotated(pliant_preconditioner_use *in_use)
{
    in_use->number++;
    in_use->is_rotated = true;
    in_use->converged_slowly = false;
    in_use->evaluations = 0;
}

pliant_known pliant_solver_find_known(pliant_solver *solver, const pliant_preconditioner_use *in_use,
                                      bool *start_is_evaluated)
{
    pliant_previous_step *previous = &solver->previous;
    const bool known = previous->is_comparable && previous->evaluated;
    previous->is_comparable = false; /* until this step has ended */
    *start_is_evaluated = known && previous->number == in_use->number;
    if (!known) return PLIANT_KNOWN_NOTHING;
    /* Contact points change it in every step. */
    bool same = *start_is_evaluated && !previous->had_contacts &&
                !pliant_contact_problem_has_points(solver->contacts) &&
                memcmp(previous->gravity, solver->gravity, sizeof previous->gravity) == 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        same = same && memcmp(previous->force + 3 * t, solver->grasps[t].force, 3 * sizeof(double)) == 0;
    return same ? PLIANT_KNOWN_STEP : PLIANT_KNOWN_FORCES;
}

/* If the step ends with its first state, add dl to the springs' forces, as that state requires. For a spring with zero
 * force at rest, no node needs to move. The step is the same with these forces, but the input of the preconditioner
 * differs.
 * @return Whether a force has changed. */
static bool take_forces(pliant_solver *solver, const pliant_anderson *rules, const double *step_force)
{
    bool other = false;
    for (int t = 0; t < PLIANT_MAX_TOOLS && rules->converged && rules->evaluations == 1; t++)
        for (int d = 0; d < 3 && pliant_grasp_is_spring(solver->grasps + t); d++) {
            other = other || step_force[3 * t + d] != 0;
            solver->grasps[t].force[d] += step_force[3 * t + d];
        }
    return other;
}

void pliant_solver_record_step(pliant_solver *solver, const pliant_preconditioner_use *in_use, bool evaluated,
                               const pliant_anderson *rules, const double *step_force)
{
    pliant_previous_step *previous = &solver->previous;
    previous->is_comparable = true;
    previous->evaluated = evaluated;
    previous->converged = rules->converged;
    previous->had_contacts = pliant_contact_problem_has_points(solver->contacts);
    previous->number = take_forces(solver, rules, step_force) ? 0 : in_use->number;
    memcpy(previous->gravity, solver->gravity, sizeof previous->gravity);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        const pliant_grasp_constraint *grasp = solver->grasps + t;
        previous->compliance[t] = grasp->compliance;
        memcpy(previous->force + 3 * t, grasp->force, sizeof grasp->force);
        memcpy(previous->target + 3 * t, grasp->target, sizeof grasp->target);
    }
}
