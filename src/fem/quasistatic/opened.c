/* The first step after a cut. The carried preconditioner is accurate except for parts that can rotate freely about the
 * remaining tissue. Anderson's method needs many steps to learn such rotations, since its secants belong to distant
 * states (NUMERICS.md). The step therefore begins with a Newton step. Conjugate gradients (Golub and Van Loan, 11.5)
 * use tangent products from differences of forces. The motion follows arcs, in axes that rotate with the tissue (modal
 * warping: Choi and Ko, IEEE TVCG 11:91, 2005). Along straight lines, rotating parts would be stretched, and the
 * residual would reject the step. The step's first evaluation judges the Newton step like a blind step. */
#include "base/fail.h"
#include "fem/quasistatic/held.h"
#include "fem/quasistatic/opened_rules.h"
#include "base/memory.h"

#include <string.h>

/* The Newton step, (3 num_free) in the nodes' axes, and its constraint forces. */
typedef struct newton_step {
    double *way, *along; /* the step so far; the present direction */
    pliant_held_forces pulls, pulls_along, pulls_next;
    double energy;       /* residual . way [J] */
    pliant_held held;
} newton_step;

static void free_step(newton_step *found)
{
    pliant_free(found->way);
    pliant_free(found->along);
    pliant_free(found->pulls.row);
    pliant_held_free(&found->held);
}

static double longest(const pliant_solver *solver, const double *v)
{
    double most = 0;
    for (int32_t f = 0; f < solver->system->num_free; f++)
        most = fmax(most, v[3 * f] * v[3 * f] + v[3 * f + 1] * v[3 * f + 1] + v[3 * f + 2] * v[3 * f + 2]);
    return sqrt(most);
}

/* Write x + share v to the trial. v: in the nodes' axes. */
static void place_trial(pliant_solver *solver, const double *v, double share)
{
    const pliant_system *system = solver->system;
    memcpy(solver->trial.x, solver->now.x, 3 * (size_t)system->mesh->num_nodes * sizeof *solver->trial.x);
    for (int32_t f = 0; f < system->num_free; f++) {
        double step[3] = {v[3 * f], v[3 * f + 1], v[3 * f + 2]};
        pliant_from_node_axes(solver->rotations, f, step);
        for (int d = 0; d < 3; d++) solver->trial.x[3 * (size_t)system->node_of_free[f] + (size_t)d] += share * step[d];
    }
}

/* Compute out = K v, both in the nodes' axes. Return false if v is zero. */
static bool multiply(pliant_solver *solver, const double *v, double *out)
{
    const double share = pliant_opened_difference(solver->rules.smallest_displacement, longest(solver, v));
    if (!(share > 0)) return false;
    place_trial(solver, v, share);
    pliant_solver_elastic_forces(solver, &solver->trial);
    for (int32_t f = 0; f < solver->system->num_free; f++) {
        for (int d = 0; d < 3; d++)
            out[3 * f + d] = (solver->trial.elastic[3 * f + d] - solver->now.elastic[3 * f + d]) / share;
        pliant_into_node_axes(solver->rotations, f, out + 3 * f);
    }
    return true;
}

/* Add share * other to forces. */
static void add_forces(const pliant_held *held, double share, const pliant_held_forces *other,
                       pliant_held_forces *forces)
{
    for (int r = 0; r < PLIANT_MAX_ROWS; r++) forces->tool[r] += share * other->tool[r];
    for (int32_t r = 0; r < held->contact_rows; r++) forces->row[r] += share * other->row[r];
}

static void scale_forces(const pliant_held *held, double share, pliant_held_forces *forces)
{
    for (int r = 0; r < PLIANT_MAX_ROWS; r++) forces->tool[r] *= share;
    for (int32_t r = 0; r < held->contact_rows; r++) forces->row[r] *= share;
}

/* Allocate, and compute the first direction from the evaluated state. *goes: the direction is valid. */
static pliant_status begin(const pliant_solver *solver, newton_step *found, bool *goes)
{
    const size_t n = pliant_solver_unknowns(solver);
    pliant_status status = pliant_held_create(solver, &found->held, goes);
    if (status != PLIANT_OK || !*goes) return status;
    const size_t rows = (size_t)found->held.contact_rows;
    found->way = pliant_calloc(n, sizeof *found->way);
    found->along = pliant_calloc(n, sizeof *found->along);
    found->pulls.row = pliant_calloc(3 * rows + 1, sizeof *found->pulls.row);
    if (!found->way || !found->along || !found->pulls.row) return pliant_fail_memory("the solver");
    found->pulls_along.row = found->pulls.row + rows;
    found->pulls_next.row = found->pulls_along.row + rows;
    memcpy(found->along, solver->now.step, n * sizeof *found->along);
    memcpy(found->pulls_along.tool, solver->now.step_force, sizeof solver->now.step_force);
    for (size_t r = 0; r < rows; r++) found->pulls_along.row[r] = solver->touches->change[found->held.contact_row[r]];
    return PLIANT_OK;
}

/* Return whether held nodes have moved since the last step. The first direction then includes their motion, and is
 * taken with length 1. */
static bool is_led(const pliant_solver *solver, const newton_step *found)
{
    const double hardly = pliant_quasistatic().opened_still * longest(solver, found->along);
    double most = 0;
    for (int t = 0; t < found->held.num_tools; t++) {
        double stretch[3];
        pliant_handle_stretch(solver, found->held.tool[t], &solver->now, stretch);
        for (int d = 0; d < 3; d++) most = fmax(most, fabs(stretch[d]));
    }
    for (int32_t r = 0; r < found->held.contact_rows; r++) {
        double moved[3] = {0, 0, 0};
        pliant_touches_apply(solver->touches, found->held.contact_row[r] / 3, found->along, moved);
        most = fmax(most, fabs(moved[found->held.contact_row[r] % 3]));
    }
    return most > hardly;
}

/* Find the step by conjugate gradients from the evaluated state. products: in: maximum number; out: number used. */
static pliant_status find_step(pliant_solver *solver, newton_step *found, int32_t *products)
{
    const size_t n = pliant_solver_unknowns(solver);
    const int32_t most = *products;
    double *left = solver->trial.residual, *step = solver->trial.free_step, *pulled = solver->trial.step;
    bool led = is_led(solver, found);
    memcpy(left, solver->now.residual, n * sizeof *left);
    pliant_held_pull(solver, &found->held, &found->pulls_along, -1, left);
    double norm = pliant_solver_product(solver, left, found->along);
    const double first = norm;
    for (*products = 0;
         *products < most && pliant_opened_goes_on(norm, first) && multiply(solver, found->along, pulled);) {
        const double curvature = pliant_solver_product(solver, found->along, pulled) +
                                 pliant_solver_spring_energy(solver, found->pulls_along.tool, found->pulls_along.tool);
        const double share = pliant_opened_advance(led, norm, curvature);
        ++*products;
        if (!(share > 0)) break;
        pliant_held_pull(solver, &found->held, &found->pulls_along, -1, pulled);
        for (size_t i = 0; i < n; i++) {
            found->way[i] += share * found->along[i];
            left[i] -= share * pulled[i];
        }
        add_forces(&found->held, share, &found->pulls_along, &found->pulls);
        found->energy += share * norm;
        if (*products == most) break;
        pliant_status status = pliant_preconditioner_solve(solver->preconditioner, 1, left, step);
        if (status == PLIANT_OK) status = pliant_held_keep(solver, &found->held, step, &found->pulls_next);
        if (status != PLIANT_OK) return status;
        const double before = norm;
        norm = pliant_solver_product(solver, left, step);
        const double turned = pliant_opened_turned(led, norm, before);
        led = false;
        for (size_t i = 0; i < n; i++) found->along[i] = step[i] + turned * found->along[i];
        scale_forces(&found->held, turned, &found->pulls_along);
        add_forces(&found->held, 1, &found->pulls_next, &found->pulls_along);
    }
    return PLIANT_OK;
}

/* Set the contact forces after a fraction of the step, within their friction cones. */
static void take_points(pliant_solver *solver, const newton_step *found, double share)
{
    pliant_touches *touches = solver->touches;
    if (!pliant_touches_any(touches)) return;
    pliant_touches_take(touches);
    for (int32_t r = 0; r < found->held.contact_rows; r++) {
        const int32_t row = found->held.contact_row[r];
        touches->taken.force[row] += share * found->pulls.row[r] - touches->change[row];
    }
    for (int32_t c = 0; c < touches->count; c++) {
        double *force = touches->taken.force + 3 * (size_t)c;
        force[0] = fmax(force[0], 0);
        const double slide = sqrt(force[1] * force[1] + force[2] * force[2]), most = touches->friction[c] * force[0];
        for (int k = 1; k < 3 && slide > most; k++) force[k] *= most / slide;
    }
}

/* Return the decrease of the potential energy along the step at its present end. */
static double slope_at(pliant_solver *solver, const double *way)
{
    double *left = solver->trial.residual;
    pliant_solver_elastic_forces(solver, &solver->now);
    memcpy(left, solver->load, pliant_solver_unknowns(solver) * sizeof *left);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        if (solver->handles[t].active)
            pliant_handle_load(solver->handles + t,
                               solver->handles[t].by_force ? solver->handles[t].force : solver->now.force + 3 * t,
                               left);
    if (pliant_touches_any(solver->touches)) pliant_touches_load(solver->touches, left);
    for (int32_t f = 0; f < solver->system->num_free; f++) {
        for (int d = 0; d < 3; d++) left[3 * f + d] -= solver->now.elastic[3 * f + d];
        pliant_into_node_axes(solver->rotations, f, left + 3 * f);
    }
    return pliant_solver_product(solver, way, left);
}

static void go(pliant_solver *solver, const newton_step *found, double share)
{
    const size_t bytes = 3 * (size_t)solver->system->mesh->num_nodes * sizeof(double);
    place_trial(solver, found->way, share);
    memcpy(solver->now.x, solver->trial.x, bytes);
    for (int r = 0; r < PLIANT_MAX_ROWS; r++) solver->now.force[r] += share * found->pulls.tool[r];
    if (solver->rotations) pliant_nodal_rotations_update(solver->system, solver->now.x, solver->rotations);
}

static void turned(pliant_solver *solver)
{
    pliant_solver_turned(solver);
    pliant_in_use_turned(&solver->in_use);
    if (solver->touches) pliant_answers_forget(&solver->touches->answers);
}

/* Recompute responses after the axes have rotated. After an error, the state before the step and its axes are
 * restored. */
static pliant_status respond_in_axes(pliant_solver *solver)
{
    if (!solver->rotations) return PLIANT_OK;
    turned(solver);
    pliant_status status = pliant_solver_respond(solver);
    if (status == PLIANT_OK) status = pliant_touches_respond(solver);
    if (status == PLIANT_OK) return PLIANT_OK;
    memcpy(solver->now.x, solver->previous_x, 3 * (size_t)solver->system->mesh->num_nodes * sizeof *solver->now.x);
    memcpy(solver->now.force, solver->previous_force, sizeof solver->now.force);
    pliant_nodal_rotations_update(solver->system, solver->now.x, solver->rotations);
    turned(solver);
    solver->opened_axes = false;
    solver->opened = true;
    return status;
}

/* Take the Newton step and rotate the axes along it. */
static pliant_status take_step(pliant_solver *solver, const newton_step *found)
{
    const double length = longest(solver, found->way) / solver->rules.smallest_displacement,
                 share = pliant_opened_share(length);
    const int parts = pliant_opened_parts(length);
    double gone = 0, slope = found->energy;
    memcpy(solver->previous_x, solver->now.x, 3 * (size_t)solver->system->mesh->num_nodes * sizeof *solver->previous_x);
    memcpy(solver->previous_force, solver->now.force, sizeof solver->previous_force);
    solver->rules.blind = 1;
    solver->rules.sound_merit = sqrt(found->energy);
    for (int p = 0; p < parts; p++) {
        const double part = share / parts;
        go(solver, found, part);
        gone += part;
        if (!pliant_opened_doubts(gone, length)) continue;
        const double before = slope;
        slope = slope_at(solver, found->way);
        if (slope > 0) continue;
        const double back = pliant_opened_back(part, before, slope);
        go(solver, found, -back);
        gone -= back;
        break;
    }
    take_points(solver, found, gone);
    solver->opened_axes = solver->rotations != NULL;
    pliant_status status = respond_in_axes(solver);
    /* Restore the contact forces from before the step. */
    if (status != PLIANT_OK && pliant_touches_any(solver->touches)) pliant_touches_take(solver->touches);
    return status;
}

pliant_status pliant_solver_open_back(pliant_solver *solver)
{
    if (!solver->opened_axes) return PLIANT_OK;
    solver->opened_axes = false;
    pliant_nodal_rotations_update(solver->system, solver->previous_x, solver->rotations);
    return respond_in_axes(solver);
}

int32_t pliant_solver_open_evaluations(const pliant_solver *solver, const pliant_even_limit *limit, int32_t part)
{
    const int32_t most = solver->rules.most_evaluations, allowed = most + (most + part - 1) / part;
    return limit->evaluations < allowed ? (limit->evaluations > most ? limit->evaluations : most) : allowed;
}

/* Return whether the cut has released no tissue. With contact, points change in every evaluation, so the state is
 * unknown. */
static bool is_settled(const pliant_solver *solver)
{
    const double tolerance =
        solver->rules.tolerance * fmax(solver->now.displacement, solver->rules.smallest_displacement);
    return !pliant_touches_any(solver->touches) &&
           pliant_opened_is_settled(longest(solver, solver->now.step), tolerance);
}

pliant_status pliant_solver_open(pliant_solver *solver, int32_t most, int32_t *evaluations, bool *settled)
{
    bool goes = solver->opened && !solver->system->basis && most >= PLIANT_OPENED_LEAST;
    *evaluations = 0;
    *settled = false;
    solver->opened = solver->opened_axes = false;
    if (!goes) return PLIANT_OK;
    pliant_status status = pliant_solver_evaluate(solver, PLIANT_KNOWN_NOTHING, &solver->now);
    solver->opened = status != PLIANT_OK;
    if (status != PLIANT_OK || !isfinite(solver->now.merit) || !(solver->now.merit > 0)) return status;
    if ((*settled = is_settled(solver))) return PLIANT_OK;
    newton_step found = {0};
    int32_t products = pliant_opened_products(most);
    status = begin(solver, &found, &goes);
    if (status == PLIANT_OK && goes) status = find_step(solver, &found, &products);
    if (status == PLIANT_OK && goes && found.energy > 0) status = take_step(solver, &found);
    *evaluations = goes ? 1 + products : 1;
    free_step(&found);
    solver->opened = status != PLIANT_OK;
    return status;
}
