/* Contact forces in cones (cones.h): code that the CPU and a CUDA block share.
 *
 * Forces solve the problem if f = P(f - s v). P is the projection onto the point's cone, and s is a multiple of the
 * point's stiffness. Newton's method reduces the residual of this equation (Alart and Curnier, Comput. Methods
 * Appl. Mech. Engrg. 92:353, 1991). If no Newton step reduces it, sweeps of projected Gauss-Seidel do. All threads
 * of a problem make the same decisions. */
#ifndef PLIANT_CONTACT_SOLVE_CONE_RULES_H
#define PLIANT_CONTACT_SOLVE_CONE_RULES_H

#include "contact/solve/cone_equations.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- a step of Newton's method */

/* Classify a point as open, sticking or sliding. */
PLIANT_INLINE void pliant_cone_classify(const pliant_cones *on, int32_t p)
{
    pliant_cone_point *point = on->point + p;
    const double *v = on->motion + 3 * (size_t)p, *f = on->force + 3 * (size_t)p, friction = on->friction[p];
    double z[2];
    point->kind = PLIANT_CONE_STICKS;
    if (friction < 0) return;
    const double normal = pliant_cone_unprojected(point, PLIANT_CONE_STEP_FACTOR, v, f, z),
                 length = sqrt(z[0] * z[0] + z[1] * z[1]);
    if (!(normal > 0)) point->kind = PLIANT_CONE_OPEN;
    if (!(normal > 0) || !(length > friction * normal)) return;
    point->kind = PLIANT_CONE_SLIDES;
    for (int k = 0; k < 2; k++) point->along[k] = z[k] / length;
    point->cone_fraction = friction * normal / length;
}

/* Classify all points. Open points lose their force, and points without friction its tangential part. List all others,
 * first those with friction. */
PLIANT_INLINE pliant_cone_blocks pliant_cones_classify(const pliant_team *team, const pliant_cones *on)
{
    for (int32_t p = team->rank; p < on->count; p += team->size) {
        pliant_cone_classify(on, p);
        for (int k = 0; k < 3; k++) {
            const size_t i = 3 * (size_t)p + (size_t)k;
            const bool ends = !pliant_cone_presses(on, p) || (k > 0 && on->friction[p] == 0);
            on->change[i] = ends ? -on->force[i] : 0;
        }
    }
    pliant_team_wait(team);
    pliant_cone_blocks blocks;
    blocks.rubbing = pliant_cones_list(team, on, pliant_cone_rubs, on->list);
    const int32_t others = pliant_cones_list(team, on, pliant_cone_only_presses, on->list + blocks.rubbing);
    blocks.listed = blocks.rubbing + others;
    blocks.count = blocks.rubbing + (others + 2) / 3;
    return blocks;
}

/* Solve the linearized equations of all points that are not open, and compute change and moved. Return the number of
 * rows; -1: there are too many points. */
PLIANT_INLINE int32_t pliant_cones_newton(const pliant_team *team, const pliant_cones *on, double damping)
{
    const pliant_cone_blocks blocks = pliant_cones_classify(team, on);
    const bool is_large = 3 * blocks.count > on->fast_rows;
    const pliant_team *solves = is_large ? on->all : team;
    if (3 * blocks.count > PLIANT_CONE_MAX_ROWS) return -1;
    pliant_cones with = *on;
    if (is_large) with.equations = on->large_equations;
    pliant_cones_find_motion(team, on); /* of the points that open */
    pliant_cones_find_sizes(team, on, &blocks, damping);
    pliant_cones_set_equations(solves, &with, &blocks, damping);
    pliant_cones_reduce(team, solves, &with, &blocks);
    pliant_cones_take_changes(team, &with, &blocks);
    pliant_team_wait(solves);
    pliant_cones_find_motion(team, on);
    return 3 * blocks.count;
}

/* Return the number of steps that a step counts as. So the total work grows with the square of the rows, as in
 * sweeps. */
PLIANT_INLINE int32_t pliant_cone_step_count(const pliant_cones *on, int32_t rows)
{
    return rows > on->few_rows ? (rows + on->few_rows - 1) / on->few_rows : 1;
}

/* Take a step: add `length` times change and moved to forces and motions. */
PLIANT_INLINE void pliant_cones_apply_step(const pliant_team *team, const pliant_cones *on, double length)
{
    for (size_t i = (size_t)team->rank; i < 3 * (size_t)on->count; i += (size_t)team->size) {
        on->force[i] += length * on->change[i];
        on->motion[i] += length * on->moved[i];
    }
    pliant_team_wait(team);
}

/* Line search: take the first step length that reduces the squared residual to half, or else the best one. Return
 * false, and take no step, if there is no sufficient reduction. left: squared residual, in and out */
PLIANT_INLINE bool pliant_cones_line_search(const pliant_team *team, const pliant_cones *on, double *left)
{
    double best = INFINITY, of = 0;
    for (double length = 1; length > PLIANT_CONE_MIN_STEP && !(best < 0.5 * *left); length *= 0.5) {
        const double square = pliant_cones_residual(team, on, length);
        if (!(square < best)) continue;
        best = square;
        of = length;
    }
    if (!(best < PLIANT_CONE_MIN_DECREASE * *left)) return false;
    pliant_cones_apply_step(team, on, of);
    *left = best;
    return true;
}

/* ---- sweeps */

/* Compute the change of a point's force in a sweep. */
PLIANT_INLINE void pliant_cone_sweep_point(const pliant_cones *on, int32_t p, double change[3])
{
    const size_t row = 3 * (size_t)on->count;
    const pliant_cone_point *point = on->point + p;
    const double *n = on->matrix + 3 * (size_t)p * (row + 1), *v = on->motion + 3 * (size_t)p,
                 *f = on->force + 3 * (size_t)p;
    const double normal = fmax(f[0] - v[0] * point->soft[0], 0.0), maximum = on->friction[p] * normal;
    double along[2];
    change[0] = normal - f[0];
    for (int k = 0; k < 2; k++) along[k] = f[1 + k] - (v[1 + k] + n[1 + k] * change[0]) * point->soft[1];
    const double part = pliant_cone_part(along, maximum);
    for (int k = 0; k < 2; k++) change[1 + k] = part * along[k] - f[1 + k];
}

/* Compute the change of a held point's force, for v = 0. */
PLIANT_INLINE void pliant_cone_sweep_fixed_point(const pliant_cones *on, int32_t p, double change[3])
{
    const size_t row = 3 * (size_t)on->count;
    const double *v = on->motion + 3 * (size_t)p;
    double inverse[9];
    pliant_cone_invert(on->matrix + 3 * (size_t)p * (row + 1), row, 0.0, inverse);
    for (int k = 0; k < 3; k++)
        change[k] = -(inverse[3 * k] * v[0] + inverse[3 * k + 1] * v[1] + inverse[3 * k + 2] * v[2]);
}

/* Return whether a sweep changes nothing at a point. */
PLIANT_INLINE bool pliant_cone_is_open(const pliant_cones *on, int32_t p)
{
    const double *f = on->force + 3 * (size_t)p;
    return on->friction[p] >= 0 && f[0] == 0 && f[1] == 0 && f[2] == 0 && on->motion[3 * (size_t)p] >= 0;
}

/* Return the first point from p on that is not open, or the number of points. */
PLIANT_INLINE int32_t pliant_cones_next(const pliant_team *team, const pliant_cones *on, int32_t p)
{
#ifdef __CUDACC__
    for (; p < on->count; p += 32) {
        const int32_t own = p + team->rank % 32;
        const unsigned points = __ballot_sync(0xffffffff, own < on->count && !pliant_cone_is_open(on, own));
        if (points != 0) return p + __ffs((int)points) - 1;
    }
    return on->count;
#else
    (void)team;
    while (p < on->count && pliant_cone_is_open(on, p)) p++;
    return p;
#endif
}

/* Sweep over all points. Return the sum of the squared changes. */
PLIANT_INLINE double pliant_cones_sweep(const pliant_team *team, const pliant_cones *on)
{
    const size_t row = 3 * (size_t)on->count, own = (size_t)team->rank, step = (size_t)team->size;
    double sum = 0;
    for (int32_t p = 0; (p = pliant_cones_next(team, on, p)) < on->count; p++) {
        double change[3], *f = on->force + 3 * (size_t)p;
        const double *a = on->matrix + 3 * (size_t)p * row, *b = a + row, *c = b + row;
        /* loaded early: a GPU waits long for them */
        const double first[3] = {own < row ? a[own] : 0, own < row ? b[own] : 0, own < row ? c[own] : 0};
        if (on->friction[p] < 0)
            pliant_cone_sweep_fixed_point(on, p, change);
        else
            pliant_cone_sweep_point(on, p, change);
        const double square = change[0] * change[0] + change[1] * change[1] + change[2] * change[2];
        if (square == 0) continue;
        sum += square;
        pliant_team_wait(team);
        for (size_t k = own; k < 3; k += step) f[k] += change[k];
        if (own < row) on->motion[own] += first[0] * change[0] + first[1] * change[1] + first[2] * change[2];
        for (size_t j = own + step; j < row; j += step)
            on->motion[j] += a[j] * change[0] + b[j] * change[1] + c[j] * change[2];
        for (size_t k = 0, j = 3 * (size_t)p; k < 3; k++, j++)
            if (j % step == own) on->motion[j] += pliant_cone_resistance(on, j) * change[k];
        pliant_team_wait(team);
    }
    return sum;
}

/* ---- solver */

/* Project all forces onto their cones. At convergence this changes them only slightly. */
PLIANT_INLINE void pliant_cones_project(const pliant_team *team, const pliant_cones *on)
{
    for (int32_t p = team->rank; p < on->count; p += team->size) {
        const size_t i = 3 * (size_t)p;
        for (int k = 0; k < 3; k++) on->change[i + (size_t)k] = 0;
        if (on->friction[p] >= 0)
            pliant_cone_projection_change(on->point + p, on->friction[p], 1.0, on->motion + i, on->force + i,
                                          on->change + i);
    }
    pliant_team_wait(team);
    pliant_cones_find_motion(team, on);
    pliant_cones_apply_step(team, on, 1.0);
}

/* Make a Newton step. If it does not reduce the residual, repeat it with more and more damping (Levenberg, Quart.
 * Appl. Math. 2:164, 1944), because points of one triangle are almost linearly dependent. Return the number of rows;
 * -1: there are too many points.
 * @param left squared residual, in and out; @param steps number of steps, in and out; @param leads out: the
 *   residual was reduced */
PLIANT_INLINE int32_t pliant_cones_step(const pliant_team *team, const pliant_cones *on, double *left, int32_t *steps,
                                        bool *leads)
{
    const double damping[] = {0, PLIANT_CONE_WEAK_DAMPING, PLIANT_CONE_STRONG_DAMPING};
    int32_t rows = 0;
    *leads = false;
    for (int d = 0; d < 3 && !*leads; d++) {
        if ((rows = pliant_cones_newton(team, on, damping[d])) < 0) return rows;
        *steps += pliant_cone_step_count(on, rows);
        *leads = pliant_cones_line_search(team, on, left);
    }
    return rows;
}

/* Return f'f. */
PLIANT_INLINE double pliant_cones_squared_force(const pliant_team *team, const pliant_cones *on)
{
    double own = 0;
    for (size_t i = (size_t)team->rank; i < 3 * (size_t)on->count; i += (size_t)team->size)
        own += on->force[i] * on->force[i];
    return pliant_team_sum(team, own);
}

typedef enum pliant_cone_result {
    PLIANT_CONES_SOLVED,
    PLIANT_CONES_UNSOLVED,
    PLIANT_CONES_TOO_MANY /* for Newton's method */
} pliant_cone_result;

/* Make a round with one resistance. Far from the solution, sweeps come first, because a full Newton step often selects
 * wrong open points there. made: number of steps and sweeps, in and out */
PLIANT_INLINE pliant_cone_result pliant_cones_make_round(const pliant_team *team, const pliant_cones *on, int32_t *made)
{
    const bool is_last = *on->resistance >= PLIANT_CONE_STRONG_RESISTANCE;
    const int32_t max_steps = is_last ? 60 : 30, max_sweeps = is_last ? PLIANT_CONE_SWEEPS : 64, max_at_once = 32,
                  first_sweeps = 3;
    int32_t steps = 0, sweeps = 0, at_once = 1, rows = 0;
    pliant_cone_result result = PLIANT_CONES_UNSOLVED;
    pliant_cones_begin(team, on);
    double left = pliant_cones_residual(team, on, 0.0);
    if (left > PLIANT_CONE_FAR * PLIANT_CONE_FAR * pliant_cones_squared_force(team, on)) {
        for (; sweeps < first_sweeps; sweeps++) pliant_cones_sweep(team, on);
        left = pliant_cones_residual(team, on, 0.0);
    }
    for (;;) {
        const double size = pliant_cones_squared_force(team, on);
        bool ends = left <= PLIANT_CONE_EXACT * PLIANT_CONE_EXACT * size;
        const bool is_last_step = steps >= max_steps || sweeps >= max_sweeps;
        if (!ends && is_last_step && rows > on->few_rows) result = PLIANT_CONES_TOO_MANY;
        if (!ends && is_last_step) break;
        if (!ends) {
            bool leads;
            rows = pliant_cones_step(team, on, &left, &steps, &leads);
            if (rows < 0) {
                result = PLIANT_CONES_TOO_MANY;
                break;
            }
            if (leads) continue;
            /* no step reduces it further */
            ends = left <= PLIANT_CONE_TOLERANCE * PLIANT_CONE_TOLERANCE * size;
        }
        if (ends) {
            pliant_cones_project(team, on);
            result = PLIANT_CONES_SOLVED;
            break;
        }
        if (at_once < max_at_once) at_once *= 2;
        for (int32_t n = 0; n < at_once; n++, sweeps++) pliant_cones_sweep(team, on);
        left = pliant_cones_residual(team, on, 0.0);
    }
    if (result == PLIANT_CONES_UNSOLVED) {
        pliant_cones_sweep(team, on); /* its result is in the cones */
        sweeps++;
    }
    *made += steps + sweeps;
    return result;
}

/* Store the forces at the start of a round. */
PLIANT_INLINE void pliant_cones_begin_round(const pliant_team *team, const pliant_cones *on)
{
    for (size_t i = (size_t)team->rank; i < 3 * (size_t)on->count; i += (size_t)team->size)
        if (on->friction[i / 3] >= 0) on->before[i] = on->force[i];
}

/* Remove the part of the motions that the resistance causes. */
PLIANT_INLINE void pliant_cones_end_round(const pliant_team *team, const pliant_cones *on)
{
    for (size_t i = (size_t)team->rank; i < 3 * (size_t)on->count; i += (size_t)team->size)
        if (on->friction[i / 3] >= 0) on->motion[i] -= pliant_cone_resistance(on, i) * (on->force[i] - on->before[i]);
    pliant_team_wait(team);
}

/* Solve from given forces and motions. Return the number of steps and sweeps. A negative result means too many points
 * for Newton's method: minus the number of sweeps, minus 1. */
PLIANT_INLINE int32_t pliant_cones_run(const pliant_team *team, const pliant_cones *on)
{
    int32_t made = 0;
    for (;;) {
        pliant_cones_begin_round(team, on);
        const pliant_cone_result result = pliant_cones_make_round(team, on, &made);
        pliant_cones_end_round(team, on);
        if (result == PLIANT_CONES_TOO_MANY) return -made - 1;
        if (result == PLIANT_CONES_SOLVED || *on->resistance >= PLIANT_CONE_STRONG_RESISTANCE) return made;
        pliant_team_wait(team);
        if (team->rank == 0) *on->resistance = PLIANT_CONE_STRONG_RESISTANCE;
        pliant_team_wait(team);
    }
}

#ifdef __cplusplus
}
#endif
#endif
