/* Rules for the start of a step, for all backends: whether there is work to do, whether the axes of the nodes rotate
 * with the tissue, and which quantities of the first state are known. */
#include "fem/quasistatic/solver.h"

#include <string.h>

static bool tool_asks_the_same(const pliant_asked *asked, const pliant_handle *handle, int tool)
{
    return memcmp(asked->force + 3 * tool, handle->force, sizeof handle->force) == 0 &&
           asked->compliance[tool] == handle->compliance &&
           memcmp(asked->target + 3 * tool, handle->target, sizeof handle->target) == 0;
}

void pliant_solver_forget(pliant_solver *solver)
{
    pliant_anderson_forget(&solver->rules);
    solver->asked.kept = false;
    solver->forgotten = true;
}

bool pliant_solver_rests(const pliant_solver *solver)
{
    const pliant_asked *asked = &solver->asked;
    /* Around a patch, more inputs change than these. */
    bool same = !solver->system->basis && asked->kept && asked->evaluated && asked->converged && !asked->touched &&
                !pliant_touches_any(solver->touches) &&
                memcmp(asked->gravity, solver->gravity, sizeof asked->gravity) == 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS && same; t++)
        if (solver->handles[t].active) same = tool_asks_the_same(asked, solver->handles + t, t);
    return same;
}

/* Decide whether the axes rotate. Responses to springs are valid in the axes in which they were computed, and
 * homogenized elements have inaccurate rotations. In both cases the axes wait for the next preconditioner. They rotate
 * only if the present one converges slowly and no new one is due. Secants based on such responses are dropped then. */
pliant_axes pliant_solver_axes(const pliant_solver *solver, const pliant_in_use *in_use, uint64_t step)
{
    const uint64_t interval = (uint64_t)solver->refresh_interval;
    bool waits = in_use->rough;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        waits =
            waits || (pliant_handle_is_spring(solver->handles + t) && solver->handles[t].response_of == in_use->number);
    if (!waits)
        return !in_use->turned || in_use->evaluations >= pliant_quasistatic().rotation_interval ? PLIANT_AXES_TURN
                                                                                                : PLIANT_AXES_STAY;
    const bool follows =
        !in_use->renews && in_use->served_badly && interval > 0 && step >= in_use->turned_at + interval;
    return follows ? PLIANT_AXES_TURN_AND_FORGET : PLIANT_AXES_STAY;
}

void pliant_in_use_turned(pliant_in_use *in_use)
{
    in_use->number++;
    in_use->turned = true;
    in_use->served_badly = false;
    in_use->evaluations = 0;
}

pliant_known pliant_solver_known(pliant_solver *solver, const pliant_in_use *in_use, bool *seen)
{
    pliant_asked *asked = &solver->asked;
    const bool known = asked->kept && asked->evaluated;
    asked->kept = false; /* until this step has ended */
    *seen = known && asked->number == in_use->number;
    if (!known) return PLIANT_KNOWN_NOTHING;
    /* Contact points change it in every step. */
    bool same = *seen && !asked->touched && !pliant_touches_any(solver->touches) &&
                memcmp(asked->gravity, solver->gravity, sizeof asked->gravity) == 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        same = same && memcmp(asked->force + 3 * t, solver->handles[t].force, 3 * sizeof(double)) == 0;
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
        for (int d = 0; d < 3 && pliant_handle_is_spring(solver->handles + t); d++) {
            other = other || step_force[3 * t + d] != 0;
            solver->handles[t].force[d] += step_force[3 * t + d];
        }
    return other;
}

void pliant_solver_ended(pliant_solver *solver, const pliant_in_use *in_use, bool evaluated,
                         const pliant_anderson *rules, const double *step_force)
{
    pliant_asked *asked = &solver->asked;
    asked->kept = true;
    asked->evaluated = evaluated;
    asked->converged = rules->converged;
    asked->touched = pliant_touches_any(solver->touches);
    asked->number = take_forces(solver, rules, step_force) ? 0 : in_use->number;
    memcpy(asked->gravity, solver->gravity, sizeof asked->gravity);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        const pliant_handle *handle = solver->handles + t;
        asked->compliance[t] = handle->compliance;
        memcpy(asked->force + 3 * t, handle->force, sizeof handle->force);
        memcpy(asked->target + 3 * t, handle->target, sizeof handle->target);
    }
}
