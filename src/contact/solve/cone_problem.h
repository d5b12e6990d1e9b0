/* A cone problem (cones.h): its data, its residual, and lists of its points. The CPU and a CUDA block share this code;
 * all threads of a problem make the same decisions. */
#ifndef PLIANT_CONTACT_SOLVE_CONE_PROBLEM_H
#define PLIANT_CONTACT_SOLVE_CONE_PROBLEM_H

#include "base/inverse_root.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    PLIANT_CONE_MAX_ROWS = 900 /* maximum number of rows of points in contact for Newton's method */,
    PLIANT_CONE_FEW_ROWS = 192 /* a step with more rows counts as several, unless many blocks share its work */
};
#define PLIANT_CONE_FIXED (-1.0) /* instead of mu: any force, v = 0 */

/* Regularization: a fraction of A's diagonal resists changes of the forces (proximal point method: Rockafellar, SIAM J.
 * Control Optim. 14:877, 1976). It does not alter a solution in which forces do not change any more.
 * Points of one triangle are almost linearly dependent, so their individual forces are not determined. Without the
 * first value, such problems converge only to 4e-6 of the forces. Between jaws there are often more points than the
 * nodes can move, and Newton's method fails. Then the second value holds for the rest of the evaluation. */
#define PLIANT_CONE_WEAK_RESISTANCE 1e-6
#define PLIANT_CONE_STRONG_RESISTANCE 3e-3

/* Threads that solve one problem together; each takes its part of every loop: one block of a GPU, or several. */
typedef struct pliant_team {
    int rank, size;
    /* GPU, one block: (warps) buffer for its sums. NULL: several blocks */
    double *sums;
    /* GPU, several blocks that run at the same time: number of their arrivals. NULL: one block */
    unsigned *arrivals;
} pliant_team;

/* Wait for all threads. */
PLIANT_INLINE void pliant_team_wait(const pliant_team *team)
{
#ifdef __CUDACC__
    __syncthreads();
    if (!team->arrivals) return;
    if (threadIdx.x == 0) {
        __threadfence();
        const unsigned end = (atomicAdd(team->arrivals, 1) / gridDim.x + 1) * gridDim.x;
        while (*(volatile unsigned *)team->arrivals < end) continue;
        __threadfence();
    }
    __syncthreads();
#else
    (void)team;
#endif
}

/* Return the sum over the threads of a warp, to each of them. */
PLIANT_INLINE double pliant_warp_sum(double own)
{
#ifdef __CUDACC__
    for (int half = 16; half > 0; half /= 2) own += __shfl_xor_sync(0xffffffff, own, half);
#endif
    return own;
}

/* Return the sum over all threads of a block, to each of them. All threads have waited then. */
PLIANT_INLINE double pliant_team_sum(const pliant_team *team, double own)
{
#ifdef __CUDACC__
    own = pliant_warp_sum(own);
    if (team->rank % 32 == 0) team->sums[team->rank / 32] = own;
    __syncthreads();
    own = 0;
    for (int w = 0; w < team->size / 32; w++) own += team->sums[w];
    __syncthreads();
#else
    (void)team;
#endif
    return own;
}

enum { PLIANT_CONE_OPEN, PLIANT_CONE_STICKS /* or is held */, PLIANT_CONE_SLIDES };

/* State of a point in a Newton step. A sliding point moves along z = f_t - soft v_t, and the cone keeps a fraction
 * of z. */
typedef struct pliant_cone_point {
    int32_t kind, unused;
    double soft[2]; /* along the normal and along both tangents: force per motion of the single point [N/m] */
    double along[2], cone_fraction;
    double size; /* magnitude of the block of equations, to detect a singular one */
} pliant_cone_point;

typedef struct pliant_cones {
    int32_t count;
    const double *matrix;   /* A, (3 count x 3 count) */
    const double *friction; /* (count) mu, or PLIANT_CONE_FIXED */
    double *motion, *force; /* (3 count) */
    /* BUFFERS */
    pliant_cone_point *point;    /* (count) */
    int32_t *list, *changing;    /* (count) points that are not open; points whose force a step changes */
    double *change, *moved;      /* (3 count) changes of the forces in a step, and the motions that they cause */
    double *before;              /* (3 count) forces at the start of the round; unused for held points */
    double *resistance;          /* fraction of A's diagonal, in and out; all threads share it */
    double *equations;           /* up to fast_rows: (fast_rows x (fast_rows + 1)) */
    double *large_equations;     /* more: pliant_cone_numbers(3 count); not read if fast_rows is PLIANT_CONE_MAX_ROWS */
    int32_t fast_rows, few_rows; /* few_rows: a step with more rows counts as several */
    const pliant_team *all; /* solves more than fast_rows equations: all blocks, or the team itself */
} pliant_cones;

/* Return the maximum size of the equations' array. rows: 3 for each point */
static inline size_t pliant_cone_numbers(size_t rows)
{
    const size_t most = PLIANT_CONE_MAX_ROWS, used = rows < most ? rows : most;
    return used * (used + 1);
}

/* s divided by the point's stiffness. A value of 10 finds a reducing step far more often than 1, which sweeps use
 * (src/contact/NUMERICS.md). */
#define PLIANT_CONE_STEP_FACTOR 10.0
/* Relative change of the forces at which sweeps and useless steps end; limit of their number. */
#define PLIANT_CONE_TOLERANCE 1e-7
enum { PLIANT_CONE_SWEEPS = 200 };
#define PLIANT_CONE_EXACT 1e-9        /* relative residual at which the solution is found */
#define PLIANT_CONE_FAR 1e-3          /* relative residual above which sweeps come before Newton's method */
#define PLIANT_CONE_MIN_STEP 0.01     /* shortest fraction of a Newton step */
#define PLIANT_CONE_MIN_DECREASE 0.9  /* of the squared residual, in a step */
#define PLIANT_CONE_WEAK_DAMPING 1e-3 /* Levenberg's, in successive trials of a step */
#define PLIANT_CONE_STRONG_DAMPING 3e-2

/* Return the resistance against changes of a force, which is 0 for held points. i: row [m/N] */
PLIANT_INLINE double pliant_cone_resistance(const pliant_cones *on, size_t i)
{
    const double own = on->matrix[i * (3 * (size_t)on->count + 1)];
    return on->friction[i / 3] < 0 ? 0.0 : *on->resistance * own;
}

/* Compute each point's own stiffness along the normal and the tangents. */
PLIANT_INLINE void pliant_cones_begin(const pliant_team *team, const pliant_cones *on)
{
    const size_t row = 3 * (size_t)on->count;
    for (int32_t p = team->rank; p < on->count; p += team->size) {
        const double *n = on->matrix + 3 * (size_t)p * (row + 1), *t = n + row, *s = t + row;
        const double mean = 0.5 * (t[1] + s[2]), half_difference = 0.5 * (t[1] - s[2]),
                     stiff = mean + sqrt(half_difference * half_difference + t[2] * t[2]);
        on->point[p].soft[0] = n[0] > 0 ? 1 / n[0] : 0;
        on->point[p].soft[1] = stiff > 0 ? 1 / stiff : 0;
    }
    pliant_team_wait(team);
}

/* Compute f - times v of a point before the projection. Return the normal part. z: tangential part */
PLIANT_INLINE double pliant_cone_unprojected(const pliant_cone_point *point, double times, const double v[3],
                                             const double f[3], double z[2])
{
    for (int k = 0; k < 2; k++) z[k] = f[1 + k] - times * point->soft[1] * v[1 + k];
    return f[0] - times * point->soft[0] * v[0];
}

/* Return the factor that shortens a vector to a maximum length. */
PLIANT_INLINE double pliant_cone_part(const double z[2], double maximum)
{
    const double square = z[0] * z[0] + z[1] * z[1];
    return square > maximum * maximum ? maximum * pliant_inverse_root(square) : 1.0;
}

/* Compute the change of f by the projection: P(f - times v) - f. */
PLIANT_INLINE void pliant_cone_projection_change(const pliant_cone_point *point, double friction, double times,
                                                 const double v[3], const double f[3], double out[3])
{
    double z[2];
    const double normal = fmax(pliant_cone_unprojected(point, times, v, f, z), 0.0),
                 part = pliant_cone_part(z, friction * normal);
    out[0] = normal - f[0];
    for (int k = 0; k < 2; k++) out[1 + k] = part * z[k] - f[1 + k];
}

/* Return the squared residual after this fraction of the step. */
PLIANT_INLINE double pliant_cones_residual(const pliant_team *team, const pliant_cones *on, double length)
{
    double sum = 0;
    for (int32_t p = team->rank; p < on->count; p += team->size) {
        double v[3], f[3], out[3];
        for (int k = 0; k < 3; k++) {
            const size_t i = 3 * (size_t)p + (size_t)k;
            v[k] = on->motion[i];
            f[k] = on->force[i];
            if (length == 0) continue;
            v[k] += length * on->moved[i];
            f[k] += length * on->change[i];
        }
        if (on->friction[p] < 0)
            for (int k = 0; k < 3; k++) out[k] = v[k] * on->point[p].soft[k > 0];
        else
            pliant_cone_projection_change(on->point + p, on->friction[p], PLIANT_CONE_STEP_FACTOR, v, f, out);
        sum += out[0] * out[0] + out[1] * out[1] + out[2] * out[2];
    }
    return pliant_team_sum(team, sum);
}

/* ---- lists of points */

/* Return whether a step changes the force of a point. */
PLIANT_INLINE bool pliant_cone_changes(const pliant_cones *on, int32_t p)
{
    const double *by = on->change + 3 * (size_t)p;
    return by[0] != 0 || by[1] != 0 || by[2] != 0;
}

/* Return whether the last classification found a point in contact, with or without friction. */
PLIANT_INLINE bool pliant_cone_presses(const pliant_cones *on, int32_t p)
{
    return on->point[p].kind != PLIANT_CONE_OPEN;
}
PLIANT_INLINE bool pliant_cone_rubs(const pliant_cones *on, int32_t p)
{
    return pliant_cone_presses(on, p) && on->friction[p] != 0;
}
PLIANT_INLINE bool pliant_cone_only_presses(const pliant_cones *on, int32_t p)
{
    return pliant_cone_presses(on, p) && on->friction[p] == 0;
}

/* List the points that have a property, ascending. Return their number. */
PLIANT_INLINE int32_t pliant_cones_list(const pliant_team *team, const pliant_cones *on,
                                        bool (*has)(const pliant_cones *, int32_t), int32_t *list)
{
    int32_t count = 0;
#ifdef __CUDACC__
    /* each warp counts, and the first one writes the list */
    for (int32_t first = 0; first < on->count; first += 32) {
        const int32_t lane = team->rank % 32, p = first + lane;
        const bool is_listed = p < on->count && has(on, p);
        const unsigned listed = __ballot_sync(0xffffffff, is_listed);
        if (is_listed && team->rank < 32) list[count + __popc(listed & ((1u << lane) - 1))] = p;
        count += __popc(listed);
    }
#else
    (void)team;
    for (int32_t p = 0; p < on->count; p++)
        if (has(on, p)) list[count++] = p;
#endif
    pliant_team_wait(team);
    return count;
}

/* Compute moved = A change, where A's diagonal includes the resistance. */
PLIANT_INLINE void pliant_cones_find_motion(const pliant_team *team, const pliant_cones *on)
{
    const size_t row = 3 * (size_t)on->count;
    const int32_t count = pliant_cones_list(team, on, pliant_cone_changes, on->changing);
#ifdef __CUDACC__
    for (size_t i = (size_t)team->rank; i < row; i += (size_t)team->size) {
        double sum = pliant_cone_resistance(on, i) * on->change[i];
#pragma unroll 8
        for (int32_t n = 0; n < count; n++) {
            /* A is symmetric */
            const size_t p = 3 * (size_t)on->changing[n];
            const double *by = on->change + p, *a = on->matrix + p * row + i;
            sum += a[0] * by[0] + a[row] * by[1] + a[2 * row] * by[2];
        }
        on->moved[i] = sum;
    }
#else
    for (size_t i = 0; i < row; i++) on->moved[i] = pliant_cone_resistance(on, i) * on->change[i];
    for (int32_t n = 0; n < count; n++) {
        const size_t p = 3 * (size_t)on->changing[n];
        const double *by = on->change + p, *a = on->matrix + p * row, *b = a + row, *c = b + row;
        /* loops over rows vectorize */
        for (size_t i = 0; i < row; i++) on->moved[i] += a[i] * by[0] + b[i] * by[1] + c[i] * by[2];
    }
#endif
    pliant_team_wait(team);
}

#ifdef __cplusplus
}
#endif
#endif
