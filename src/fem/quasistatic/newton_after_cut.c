/* The first step after a cut. The carried preconditioner is accurate except for parts that can rotate freely about the
 * remaining tissue. Anderson's method needs many steps to learn such rotations, since its secants belong to distant
 * states (NUMERICS.md). The step therefore begins with a Newton step. Conjugate gradients (Golub and Van Loan, 11.5)
 * use tangent products from differences of forces. The motion follows arcs, in axes that rotate with the tissue (modal
 * warping: Choi and Ko, IEEE TVCG 11:91, 2005). Along straight lines, rotating parts would be stretched, and the
 * residual would reject the step. The step's first evaluation judges the Newton step like a blind step. */
#include "base/fail.h"
#include "fem/quasistatic/active_set.h"
#include "fem/quasistatic/newton_rules.h"
#include "fem/quasistatic/pressure.h"
#include "base/memory.h"

#include <string.h>

/* The Newton step, (3 num_free) in the nodes' axes, and its constraint forces. */
typedef struct newton_step {
    double *correction, *along; /* the step so far; the present direction */
    pliant_active_forces pulls, pulls_along, pulls_next;
    double energy;       /* residual . correction [J] */
    pliant_active_set active;
} newton_step;

static void free_step(newton_step *found)
{
    PLIANT_FREE(found->correction, found->along, found->pulls.row);
    pliant_active_set_free(&found->active);
}

static double longest(const pliant_solver *solver, const double *v)
{
    double maximum = 0;
    for (int32_t f = 0; f < solver->system->num_free; f++)
        maximum = fmax(maximum, v[3 * f] * v[3 * f] + v[3 * f + 1] * v[3 * f + 1] + v[3 * f + 2] * v[3 * f + 2]);
    return sqrt(maximum);
}

/* Write x + share v to the trial. v: in the nodes' axes. */
static void place_trial(pliant_solver *solver, const double *v, double fraction)
{
    const pliant_system *system = solver->system;
    memcpy(solver->trial.x, solver->now.x, 3 * (size_t)system->mesh->num_nodes * sizeof *solver->trial.x);
    pliant_pressure_copy(solver, solver->now.pressure, solver->trial.pressure);
    for (int32_t f = 0; f < system->num_free; f++) {
        double step[3] = {v[3 * f], v[3 * f + 1], v[3 * f + 2]};
        pliant_from_node_axes(solver->rotations, f, step);
        for (int d = 0; d < 3; d++)
            solver->trial.x[3 * (size_t)system->node_of_free[f] + (size_t)d] += fraction * step[d];
    }
}

/* Compute out = K v, both in the nodes' axes. Return false if v is zero. */
static bool multiply(pliant_solver *solver, const double *v, double *out)
{
    const double fraction = pliant_newton_difference_length(solver->rules.smallest_displacement, longest(solver, v));
    if (!(fraction > 0)) return false;
    place_trial(solver, v, fraction);
    pliant_solver_elastic_forces(solver, &solver->trial);
    for (int32_t f = 0; f < solver->system->num_free; f++) {
        for (int d = 0; d < 3; d++)
            out[3 * f + d] = (solver->trial.elastic[3 * f + d] - solver->now.elastic[3 * f + d]) / fraction;
        pliant_into_node_axes(solver->rotations, f, out + 3 * f);
    }
    return true;
}

/* Add share * other to forces. */
static void add_forces(const pliant_active_set *active, double fraction, const pliant_active_forces *other,
                       pliant_active_forces *forces)
{
    for (int r = 0; r < PLIANT_MAX_ROWS; r++) forces->tool[r] += fraction * other->tool[r];
    for (int32_t r = 0; r < active->contact_rows; r++) forces->row[r] += fraction * other->row[r];
}

static void scale_forces(const pliant_active_set *active, double fraction, pliant_active_forces *forces)
{
    for (int r = 0; r < PLIANT_MAX_ROWS; r++) forces->tool[r] *= fraction;
    for (int32_t r = 0; r < active->contact_rows; r++) forces->row[r] *= fraction;
}

/* Allocate, and compute the first direction from the evaluated state. *goes: the direction is valid. */
static pliant_status begin(const pliant_solver *solver, newton_step *found, bool *is_valid)
{
    const size_t n = pliant_solver_unknowns(solver);
    pliant_status status = pliant_active_set_create(solver, &found->active, is_valid);
    if (status != PLIANT_OK || !*is_valid) return status;
    const size_t rows = (size_t)found->active.contact_rows;
    found->correction = pliant_calloc(n, sizeof *found->correction);
    found->along = pliant_calloc(n, sizeof *found->along);
    found->pulls.row = pliant_calloc(3 * rows + 1, sizeof *found->pulls.row);
    if (!found->correction || !found->along || !found->pulls.row) return pliant_fail_memory("the solver");
    found->pulls_along.row = found->pulls.row + rows;
    found->pulls_next.row = found->pulls_along.row + rows;
    memcpy(found->along, solver->now.step, n * sizeof *found->along);
    memcpy(found->pulls_along.tool, solver->now.step_force, sizeof solver->now.step_force);
    for (size_t r = 0; r < rows; r++)
        found->pulls_along.row[r] = solver->contacts->change[found->active.contact_row[r]];
    return PLIANT_OK;
}

/* Return whether held nodes have moved since the last step. The first direction then includes their motion, and is
 * taken with length 1. */
static bool is_prescribed(const pliant_solver *solver, const newton_step *found)
{
    const double hardly = pliant_get_quasistatic_settings().newton_still * longest(solver, found->along);
    double maximum = 0;
    for (int t = 0; t < found->active.num_tools; t++) {
        double stretch[3];
        pliant_grasp_stretch(solver, found->active.tool[t], &solver->now, stretch);
        for (int d = 0; d < 3; d++) maximum = fmax(maximum, fabs(stretch[d]));
    }
    for (int32_t r = 0; r < found->active.contact_rows; r++) {
        double moved[3] = {0, 0, 0};
        pliant_contact_problem_apply(solver->contacts, found->active.contact_row[r] / 3, found->along, moved);
        maximum = fmax(maximum, fabs(moved[found->active.contact_row[r] % 3]));
    }
    return maximum > hardly;
}

/* Find the step by conjugate gradients from the evaluated state. products: in: maximum number; out: number used. */
static pliant_status find_step(pliant_solver *solver, newton_step *found, int32_t *products)
{
    const size_t n = pliant_solver_unknowns(solver);
    const int32_t maximum = *products;
    double *left = solver->trial.residual, *step = solver->trial.free_step, *pulled = solver->trial.step;
    bool prescribed = is_prescribed(solver, found);
    memcpy(left, solver->now.residual, n * sizeof *left);
    pliant_active_set_add_forces(solver, &found->active, &found->pulls_along, -1, left);
    double norm = pliant_solver_product(solver, left, found->along);
    const double first = norm;
    for (*products = 0;
         *products < maximum && pliant_newton_continues(norm, first) && multiply(solver, found->along, pulled);) {
        const double curvature = pliant_solver_product(solver, found->along, pulled) +
                                 pliant_solver_spring_energy(solver, found->pulls_along.tool, found->pulls_along.tool);
        const double fraction = pliant_newton_step_length(prescribed, norm, curvature);
        ++*products;
        if (!(fraction > 0)) break;
        pliant_active_set_add_forces(solver, &found->active, &found->pulls_along, -1, pulled);
        for (size_t i = 0; i < n; i++) {
            found->correction[i] += fraction * found->along[i];
            left[i] -= fraction * pulled[i];
        }
        add_forces(&found->active, fraction, &found->pulls_along, &found->pulls);
        found->energy += fraction * norm;
        if (*products == maximum) break;
        pliant_status status = pliant_preconditioner_solve(solver->preconditioner, 1, left, step);
        if (status == PLIANT_OK) status = pliant_active_set_project(solver, &found->active, step, &found->pulls_next);
        if (status != PLIANT_OK) return status;
        const double before = norm;
        norm = pliant_solver_product(solver, left, step);
        const double previous_weight = pliant_newton_direction_weight(prescribed, norm, before);
        prescribed = false;
        for (size_t i = 0; i < n; i++) found->along[i] = step[i] + previous_weight * found->along[i];
        scale_forces(&found->active, previous_weight, &found->pulls_along);
        add_forces(&found->active, 1, &found->pulls_next, &found->pulls_along);
    }
    return PLIANT_OK;
}

/* Set the contact forces after a fraction of the step, within their friction cones. */
static void accept_points(pliant_solver *solver, const newton_step *found, double fraction)
{
    pliant_contact_problem *contacts = solver->contacts;
    if (!pliant_contact_problem_has_points(contacts)) return;
    pliant_contact_problem_accept(contacts);
    for (int32_t r = 0; r < found->active.contact_rows; r++) {
        const int32_t row = found->active.contact_row[r];
        contacts->taken.force[row] += fraction * found->pulls.row[r] - contacts->change[row];
    }
    for (int32_t c = 0; c < contacts->count; c++) {
        double *force = contacts->taken.force + 3 * (size_t)c;
        force[0] = fmax(force[0], 0);
        const double slide = sqrt(force[1] * force[1] + force[2] * force[2]),
                     maximum = contacts->friction[c] * force[0];
        for (int k = 1; k < 3 && slide > maximum; k++) force[k] *= maximum / slide;
    }
}

/* Return the decrease of the potential energy along the step at its present end. */
static double slope_at(pliant_solver *solver, const double *correction)
{
    double *left = solver->trial.residual;
    pliant_solver_elastic_forces(solver, &solver->now);
    memcpy(left, solver->load, pliant_solver_unknowns(solver) * sizeof *left);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        if (solver->grasps[t].active)
            pliant_grasp_add_load(solver->grasps + t,
                                  solver->grasps[t].by_force ? solver->grasps[t].force : solver->now.force + 3 * t,
                                  left);
    if (pliant_contact_problem_has_points(solver->contacts)) pliant_contact_problem_add_load(solver->contacts, left);
    for (int32_t f = 0; f < solver->system->num_free; f++) {
        for (int d = 0; d < 3; d++) left[3 * f + d] -= solver->now.elastic[3 * f + d];
        pliant_into_node_axes(solver->rotations, f, left + 3 * f);
    }
    return pliant_solver_product(solver, correction, left);
}

static void apply_fraction(pliant_solver *solver, const newton_step *found, double fraction)
{
    const size_t bytes = 3 * (size_t)solver->system->mesh->num_nodes * sizeof(double);
    place_trial(solver, found->correction, fraction);
    memcpy(solver->now.x, solver->trial.x, bytes);
    for (int r = 0; r < PLIANT_MAX_ROWS; r++) solver->now.force[r] += fraction * found->pulls.tool[r];
    if (solver->rotations) pliant_nodal_rotations_update(solver->system, solver->now.x, solver->rotations);
}

static void update_after_rotation(pliant_solver *solver)
{
    pliant_solver_rotate_grasps(solver);
    pliant_preconditioner_use_rotated(&solver->in_use);
    if (solver->contacts) pliant_compliance_discard(&solver->contacts->blocks);
}

/* Recompute responses after the axes have rotated. After an error, the state before the step and its axes are
 * restored. */
static pliant_status respond_in_axes(pliant_solver *solver)
{
    if (!solver->rotations) return PLIANT_OK;
    update_after_rotation(solver);
    pliant_status status = pliant_solver_find_responses(solver);
    if (status == PLIANT_OK) status = pliant_contact_problem_find_matrix(solver);
    if (status == PLIANT_OK) return PLIANT_OK;
    memcpy(solver->now.x, solver->previous_x, 3 * (size_t)solver->system->mesh->num_nodes * sizeof *solver->now.x);
    memcpy(solver->now.force, solver->previous_force, sizeof solver->now.force);
    pliant_nodal_rotations_update(solver->system, solver->now.x, solver->rotations);
    update_after_rotation(solver);
    solver->newton_axes = false;
    solver->is_after_cut = true;
    return status;
}

/* Take the Newton step and rotate the axes along it. */
static pliant_status take_step(pliant_solver *solver, const newton_step *found)
{
    const double length = longest(solver, found->correction) / solver->rules.smallest_displacement,
                 fraction = pliant_newton_step_fraction(length);
    const int parts = pliant_newton_num_parts(length);
    double completed = 0, slope = found->energy;
    memcpy(solver->previous_x, solver->now.x, 3 * (size_t)solver->system->mesh->num_nodes * sizeof *solver->previous_x);
    memcpy(solver->previous_force, solver->now.force, sizeof solver->previous_force);
    pliant_pressure_copy(solver, solver->now.pressure, solver->previous_pressure);
    solver->rules.follows_blind_step = 1;
    solver->rules.trusted_merit = sqrt(found->energy);
    for (int p = 0; p < parts; p++) {
        const double part = fraction / parts;
        apply_fraction(solver, found, part);
        completed += part;
        if (!pliant_newton_checks_slope(completed, length)) continue;
        const double before = slope;
        slope = slope_at(solver, found->correction);
        if (slope > 0) continue;
        const double back = pliant_newton_backtrack(part, before, slope);
        apply_fraction(solver, found, -back);
        completed -= back;
        break;
    }
    accept_points(solver, found, completed);
    solver->newton_axes = solver->rotations != NULL;
    pliant_status status = respond_in_axes(solver);
    /* Restore the contact forces from before the step. */
    if (status != PLIANT_OK && pliant_contact_problem_has_points(solver->contacts))
        pliant_contact_problem_accept(solver->contacts);
    return status;
}

pliant_status pliant_solver_newton_rollback(pliant_solver *solver)
{
    if (!solver->newton_axes) return PLIANT_OK;
    solver->newton_axes = false;
    pliant_nodal_rotations_update(solver->system, solver->previous_x, solver->rotations);
    return respond_in_axes(solver);
}

int32_t pliant_solver_newton_limit(const pliant_solver *solver, const pliant_evaluation_limit *limit, int32_t part)
{
    const int32_t maximum = solver->rules.max_evaluations, allowed = maximum + (maximum + part - 1) / part;
    return limit->evaluations < allowed ? (limit->evaluations > maximum ? limit->evaluations : maximum) : allowed;
}

/* Return whether the cut has released no tissue. With contact, points change in every evaluation, so the state is
 * unknown. */
static bool is_settled(const pliant_solver *solver)
{
    const double tolerance =
        solver->rules.tolerance * fmax(solver->now.displacement, solver->rules.smallest_displacement);
    return !pliant_contact_problem_has_points(solver->contacts) &&
           pliant_newton_is_negligible(longest(solver, solver->now.step), tolerance);
}

bool pliant_solver_begin_newton(pliant_solver *solver, int32_t maximum)
{
    const bool begins = solver->is_after_cut && !solver->system->basis && maximum >= PLIANT_NEWTON_MIN_EVALUATIONS;
    solver->is_after_cut = solver->newton_axes = false;
    return begins;
}

pliant_status pliant_solver_newton_step(pliant_solver *solver, int32_t maximum, int32_t *evaluations, bool *settled)
{
    if (!isfinite(solver->now.merit) || !(solver->now.merit > 0)) return PLIANT_OK;
    if ((*settled = is_settled(solver))) return PLIANT_OK;
    bool is_valid = true;
    newton_step found = {0};
    int32_t products = pliant_newton_max_products(maximum);
    pliant_status status = begin(solver, &found, &is_valid);
    if (status == PLIANT_OK && is_valid) status = find_step(solver, &found, &products);
    if (status == PLIANT_OK && is_valid && found.energy > 0) status = take_step(solver, &found);
    *evaluations = is_valid ? 1 + products : 1;
    free_step(&found);
    return status;
}
