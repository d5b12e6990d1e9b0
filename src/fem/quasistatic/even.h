/* Evaluation limits that keep the duration of live steps even. A step has at most twice the median number of
 * evaluations of the recent steps with work. The next step continues the remaining work. Without this limit are steps
 * after a grasp, after positions were set, or under a sudden load (NUMERICS.md). */
#ifndef PLIANT_FEM_QUASISTATIC_EVEN_H
#define PLIANT_FEM_QUASISTATIC_EVEN_H

#include "base/inline.h"
#include "fem/quasistatic/settings.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

enum { PLIANT_EVEN_STEPS = 255 };

typedef struct pliant_even {
    uint64_t count; /* number of steps since the start */
    double merit;   /* initial merit of the steps, smoothed [as in pliant_anderson] */
    uint8_t evaluations[PLIANT_EVEN_STEPS]; /* evaluations of the last steps that did work, in a ring buffer */
} pliant_even;

/* Limit of a step. */
typedef struct pliant_even_limit {
    int32_t evaluations;
    double sudden; /* above this initial merit the limit does not apply */
} pliant_even_limit;

static inline void pliant_even_restart(pliant_even *even) { even->count = 0; }

static inline void pliant_even_note(pliant_even *even, int32_t evaluations, double first_merit)
{
    /* After a dozen steps, motion that has begun counts as normal. */
    const double weight = fmax(pliant_quasistatic().even_weight, 1.0 / (double)(even->count + 1));
    if (isfinite(first_merit))
        even->merit = weight < 1 ? even->merit + weight * (first_merit - even->merit) : first_merit;
    even->evaluations[even->count++ % PLIANT_EVEN_STEPS] = (uint8_t)(evaluations < UINT8_MAX ? evaluations : UINT8_MAX);
}

/* Return the limit of the next step. Without `live` there is no limit. */
static inline pliant_even_limit pliant_even_next(const pliant_even *even, bool live)
{
    const int32_t known = even->count < PLIANT_EVEN_STEPS ? (int32_t)even->count : PLIANT_EVEN_STEPS;
    int32_t median = 0, below = 0;
    pliant_even_limit limit = {INT32_MAX, 0};
    if (!live || known < pliant_quasistatic().even_first) return limit;
    while (2 * below <= known) {
        median++;
        below = 0;
        for (int32_t s = 0; s < known; s++) below += even->evaluations[s] <= median;
    }
    limit.evaluations = pliant_quasistatic().even_limit * median;
    limit.sudden = pliant_quasistatic().even_sudden * even->merit;
    return limit;
}

/* Return the number of evaluations left to a step after `done` evaluations. */
PLIANT_INLINE int32_t pliant_even_remaining(const pliant_even_limit *limit, int32_t done, double first_merit)
{
    if (first_merit > limit->sudden) return INT32_MAX;
    return limit->evaluations > done ? limit->evaluations - done : 0;
}

#endif
