/* The first step after a cut. What is carried over from the body before is nearly the inverse of the stiffness but for how easily parts turn about
 * what the cut has left, and Anderson's method, whose secants are of states far apart, takes long to find that out (NUMERICS 10). So the step begins
 * with Newton's: tangent products, by differences of forces, in conjugate gradients (Golub and Van Loan, 11.5). It is gone along arcs, in axes that turn
 * with the tissue (modal warping: Choi and Ko, IEEE TVCG 11:91, 2005): on straight lines, what turns is stretched, and no measure of the residual would
 * take it. Whether it is good, the step's first evaluation tells, as of a blind step. */
#include "base/fail.h"
#include "fem/quasistatic/solver.h"
#include "pliant/memory.h"

#include <string.h>

enum { MOST_PRODUCTS = 8 };

/* in the nodes' own axes, (3 num_free) */
typedef struct newton_step {
    double *way, *along; /* as far as it is found; the direction of now */
    double energy;       /* of it: residual . way [J] */
} newton_step;

static double longest(const pliant_solver *solver, const double *v)
{
    double most = 0;
    for (int32_t f = 0; f < solver->system->num_free; f++) most = fmax(most, v[3 * f] * v[3 * f] + v[3 * f + 1] * v[3 * f + 1] + v[3 * f + 2] * v[3 * f + 2]);
    return sqrt(most);
}

/* x + share v, v in the nodes' own axes, to the trial */
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

/* out = K v, both in the nodes' own axes; false: v is nothing */
static bool multiply(pliant_solver *solver, const double *v, double *out)
{
    const double length = longest(solver, v), share = 1e-3 * solver->rules.smallest_displacement / length;
    if (!(length > 0) || !isfinite(share)) return false;
    place_trial(solver, v, share);
    pliant_solver_elastic_forces(solver, &solver->trial);
    for (int32_t f = 0; f < solver->system->num_free; f++) {
        for (int d = 0; d < 3; d++) out[3 * f + d] = (solver->trial.elastic[3 * f + d] - solver->now.elastic[3 * f + d]) / share;
        pliant_into_node_axes(solver->rotations, f, out + 3 * f);
    }
    return true;
}

/* By conjugate gradients from what was evaluated. Returns in *products, at most so many on entry, how many it took. */
static pliant_status find_step(pliant_solver *solver, newton_step *found, int32_t *products)
{
    const size_t n = pliant_solver_unknowns(solver);
    const double enough = 0.01; /* of the norm of the residual, of which a hinge has a small part: with 0.05 it is left as it was (NUMERICS 10) */
    const int32_t most = *products;
    double *left = solver->trial.residual, *step = solver->trial.free_step, *pulled = solver->trial.step;
    memcpy(left, solver->now.residual, n * sizeof *left);
    memcpy(step, solver->now.free_step, n * sizeof *step);
    memcpy(found->along, step, n * sizeof *step);
    double norm = pliant_solver_product(solver, left, step);
    const double first = norm;
    for (*products = 0; *products < most && norm > enough * enough * first && multiply(solver, found->along, pulled);) {
        const double curvature = pliant_solver_product(solver, found->along, pulled), share = norm / curvature;
        ++*products;
        if (!(curvature > 0) || !isfinite(share)) break;
        for (size_t i = 0; i < n; i++) {
            found->way[i] += share * found->along[i];
            left[i] -= share * pulled[i];
        }
        found->energy += share * norm;
        if (*products == most) break;
        pliant_status status = pliant_preconditioner_solve(solver->preconditioner, 1, left, step);
        if (status != PLIANT_OK) return status;
        const double before = norm;
        norm = pliant_solver_product(solver, left, step);
        for (size_t i = 0; i < n; i++) found->along[i] = step[i] + norm / before * found->along[i];
    }
    return PLIANT_OK;
}

/* The state is Newton's, and the axes are of it. */
static void take_step(pliant_solver *solver, const newton_step *found)
{
    const double straight = 20, farthest = 250; /* thousandths of the body's length that are gone at once; in all: what hangs by little is sent metres away */
    const double length = longest(solver, found->way) / solver->rules.smallest_displacement, share = fmin(1, farthest / length);
    const int most = 8, parts = (int)fmin(fmax(ceil(share * length / straight), 1), most);
    const size_t bytes = 3 * (size_t)solver->system->mesh->num_nodes * sizeof(double);
    memcpy(solver->previous_x, solver->now.x, bytes);
    memcpy(solver->previous_force, solver->now.force, sizeof solver->previous_force);
    solver->rules.blind = 1;
    solver->rules.sound_merit = sqrt(found->energy);
    for (int p = 0; p < parts; p++) {
        place_trial(solver, found->way, share / parts);
        memcpy(solver->now.x, solver->trial.x, bytes);
        if (solver->rotations) pliant_nodal_rotations_update(solver->system, solver->now.x, solver->rotations);
    }
    if (!solver->rotations) return;
    pliant_solver_turned(solver);
    pliant_in_use_turned(&solver->in_use);
}

/* Springs and contacts have a part in steps that products of the stiffness know nothing of; time is not counted here. */
static bool is_for(const pliant_solver *solver)
{
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        if (pliant_handle_is_spring(solver->handles + t)) return false;
    const int32_t least = 4; /* evaluations: the state, a product, what it leads to, and what is left of that */
    return solver->opened && !(solver->budget > 0) && !solver->system->basis && !pliant_touches_any(solver->touches) && solver->rules.most_evaluations >= least;
}

pliant_status pliant_solver_open(pliant_solver *solver, int32_t *evaluations)
{
    const bool goes = is_for(solver);
    *evaluations = 0;
    solver->opened = false;
    if (!goes) return PLIANT_OK;
    pliant_status status = pliant_solver_evaluate(solver, &solver->now);
    if (status != PLIANT_OK || !isfinite(solver->now.merit) || !(solver->now.merit > 0)) return status;
    const size_t n = pliant_solver_unknowns(solver);
    newton_step found = {.way = pliant_calloc(n, sizeof *found.way), .along = pliant_calloc(n, sizeof *found.along)};
    int32_t products = solver->rules.most_evaluations - 2 < MOST_PRODUCTS ? solver->rules.most_evaluations - 2 : MOST_PRODUCTS;
    status = found.way && found.along ? find_step(solver, &found, &products) : pliant_fail_memory("the solver");
    if (status == PLIANT_OK && found.energy > 0) take_step(solver, &found);
    *evaluations = 1 + products;
    pliant_free(found.way);
    pliant_free(found.along);
    return status;
}
