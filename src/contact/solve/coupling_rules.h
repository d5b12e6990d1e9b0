/* Limits of the couplings between proxies and their targets, in a cone problem. The CPU and CUDA blocks share this
 * code.
 *
 * A coupling at its limit has the compliance at which its load is the limit, so it pulls with a constant force.
 * Otherwise it has its own compliance. One coupling changes at a time, because couplings of tools that press against
 * each other have the same load. After each change, the cone problem is solved again. */
#ifndef PLIANT_CONTACT_SOLVE_COUPLING_RULES_H
#define PLIANT_CONTACT_SOLVE_COUPLING_RULES_H

#include "contact/solve/cone_problem.h"

#ifdef __cplusplus
extern "C" {
#endif

/* One coupling with a limit: of a proxy's force, of its torque, or of the torque of its jaws. */
typedef struct pliant_coupling {
    int32_t moving, first, num_columns; /* body; first component of its motion; 3, or 1: jaws, about their axis */
    int32_t has_changed;                /* in this cone problem */
    double axis[3];                     /* of the jaws */
    double limit;                       /* largest load [N] or [N m] */
    double own;                         /* compliance below the limit [m/N] or [rad/(N m)] */
    double compliance;                  /* present compliance; in the step's state, and in the last evaluation */
    double taken, found;
    double tissue;    /* compliance of the tissue against it, estimated in this leg; 0: unknown */
    double load[3];   /* under the forces of the last solution */
    double before[2]; /* load and compliance at the last change */
} pliant_coupling;

/* The couplings of a cone problem. */
typedef struct pliant_couplings {
    int32_t count, points; /* number of couplings; of contact points, which are first in A */
    pliant_coupling *coupling;
    const double *columns; /* (count x points x 9) motion of each point along the columns of each coupling */
    double *matrix, *copy; /* A, and a copy of it for one block; copy: Nullable */
    int32_t passes, max_passes, last;
} pliant_couplings;

/* Start a cone problem. */
PLIANT_INLINE void pliant_couplings_begin(const pliant_team *team, pliant_couplings *on)
{
    on->passes = 0;
    on->max_passes = 4;
    on->last = -1;
    for (int32_t n = team->rank; n < on->count; n += team->size) {
        on->coupling[n].has_changed = 0;
        on->coupling[n].before[0] = on->coupling[n].before[1] = 0;
    }
}

PLIANT_INLINE double pliant_coupling_load(const pliant_coupling *of)
{
    return sqrt(of->load[0] * of->load[0] + of->load[1] * of->load[1] + of->load[2] * of->load[2]);
}

/* Compute the loads of all couplings. A warp takes a coupling. */
PLIANT_INLINE void pliant_couplings_find_loads(const pliant_team *team, const pliant_couplings *on, const double *force)
{
    const int32_t lanes = team->size < 32 ? 1 : 32;
    for (int32_t n = team->rank / lanes; n < on->count; n += team->size / lanes) {
        const double *columns = on->columns + 9 * (size_t)n * (size_t)on->points;
        double load[3] = {0, 0, 0};
        for (int32_t i = team->rank % lanes; i < 3 * on->points; i += lanes)
            for (int k = 0; k < 3; k++) load[k] += columns[3 * (size_t)i + (size_t)k] * force[i];
        for (int k = 0; k < 3; k++) {
            const double sum = pliant_warp_sum(load[k]);
            if (team->rank % lanes == 0) on->coupling[n].load[k] = sum;
        }
    }
    pliant_team_wait(team);
}

/* Return the error of a coupling's load relative to its limit; 0: the coupling is below its limit, with its own
 * compliance. */
PLIANT_INLINE double pliant_coupling_error(const pliant_coupling *of)
{
    const double rounding = 1e-12, error = pliant_coupling_load(of) / of->limit - 1;
    return error > 0 || of->compliance > of->own * (1 + rounding) ? fabs(error) : 0;
}

/* Return the coupling with the largest error; -1: all are small. */
PLIANT_INLINE int32_t pliant_couplings_find_worst(const pliant_couplings *on)
{
    double maximum = 1e-6;
    int32_t worst = -1;
    for (int32_t n = 0; n < on->count; n++) {
        const double error = pliant_coupling_error(on->coupling + n);
        if (error > maximum) worst = n;
        if (error > maximum) maximum = error;
    }
    return worst;
}

/* Add a compliance to a coupling in A and in the motions under the present forces. */
PLIANT_INLINE void pliant_couplings_soften(const pliant_team *team, const pliant_cones *cones,
                                           const pliant_couplings *on, int32_t n, double by)
{
    const double *columns = on->columns + 9 * (size_t)n * (size_t)on->points, *load = on->coupling[n].load;
    const size_t row = 3 * (size_t)cones->count, used = 3 * (size_t)on->points;
    const pliant_team *teams[2] = {cones->all, team};
    double *matrices[2] = {on->matrix, on->copy};
    pliant_team_wait(cones->all); /* until nobody uses A */
    for (int m = 0; m < 2; m++)
        for (size_t i = (size_t)teams[m]->rank; matrices[m] && i < used * used; i += (size_t)teams[m]->size) {
            const double *a = columns + 3 * (i / used), *b = columns + 3 * (i % used);
            matrices[m][i / used * row + i % used] += by * (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]);
        }
    for (size_t i = (size_t)team->rank; i < used; i += (size_t)team->size) {
        const double *a = columns + 3 * i;
        cones->motion[i] += by * (a[0] * load[0] + a[1] * load[1] + a[2] * load[2]);
    }
    pliant_team_wait(cones->all);
}

/* Adapt the compliance of one coupling to its limit, if the solution exceeds a limit. Return whether the cone problem
 * must be solved again. Each coupling that changes allows four more passes.
 *
 * The compliances of coupling and tissue together, times the load, give the distance to the target, which is constant.
 * If the same coupling changes twice in a row, this gives the compliance of the tissue. */
PLIANT_INLINE bool pliant_couplings_adapt(const pliant_team *team, const pliant_cones *cones, pliant_couplings *on)
{
    pliant_couplings_find_loads(team, on, cones->force);
    const int32_t worst = on->passes < on->max_passes ? pliant_couplings_find_worst(on) : -1;
    if (worst < 0) return false;
    pliant_coupling *of = on->coupling + worst;
    const double load = pliant_coupling_load(of),
                 found = (load * of->compliance - of->before[0] * of->before[1]) / (of->before[0] - load),
                 tissue = worst == on->last && isfinite(found) && found > 0 ? found : of->tissue,
                 wanted = fmax(of->own, (of->compliance + tissue) * load / of->limit - tissue),
                 by = isfinite(wanted) ? wanted - of->compliance : 0;
    if (on->passes++ > 0 && !of->has_changed) on->max_passes += 4;
    on->last = worst;
    pliant_team_wait(team); /* until all have read it */
    if (team->rank == 0) {
        of->before[0] = load;
        of->before[1] = of->compliance;
        of->tissue = tissue;
        of->compliance += by;
        of->has_changed = 1;
    }
    pliant_couplings_soften(team, cones, on, worst, by);
    return true;
}

#ifdef __cplusplus
}
#endif
#endif
