/* Live, no step takes much longer than the others: at most twice as many evaluations as the median of the last steps that had something to do,
 * and what it leaves is the next one's. Where a tool has taken hold, positions were set, or a load comes suddenly, steps are as long as they
 * need. NUMERICS 13 */
#ifndef PLIANT_FEM_QUASISTATIC_EVEN_H
#define PLIANT_FEM_QUASISTATIC_EVEN_H

#include "base/inline.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

enum { PLIANT_EVEN_STEPS = 255, PLIANT_EVEN_FIRST = 31 };

typedef struct pliant_even {
    uint64_t count; /* of steps since the start */
    double merit;   /* that they began with, smoothed [as pliant_anderson] */
    uint8_t evaluations[PLIANT_EVEN_STEPS]; /* of the last ones, round about: those that took time */
} pliant_even;

/* What a step may take. */
typedef struct pliant_even_limit {
    int32_t evaluations;
    double sudden; /* where its first merit is above this, more */
} pliant_even_limit;

static inline void pliant_even_restart(pliant_even *even) { even->count = 0; }

static inline void pliant_even_note(pliant_even *even, int32_t evaluations, double first_merit)
{
    const double weight = fmax(0.02, 1.0 / (double)(even->count + 1)); /* tissue that begins to move is no longer sudden after a dozen steps */
    if (isfinite(first_merit)) even->merit = weight < 1 ? even->merit + weight * (first_merit - even->merit) : first_merit;
    even->evaluations[even->count++ % PLIANT_EVEN_STEPS] = (uint8_t)(evaluations < UINT8_MAX ? evaluations : UINT8_MAX);
}

/* live: unless steps are, there is no limit */
static inline pliant_even_limit pliant_even_next(const pliant_even *even, bool live)
{
    const int32_t known = even->count < PLIANT_EVEN_STEPS ? (int32_t)even->count : PLIANT_EVEN_STEPS;
    int32_t median = 0, below = 0;
    pliant_even_limit limit = {INT32_MAX, 0};
    if (!live || known < PLIANT_EVEN_FIRST) return limit;
    while (2 * below <= known) {
        median++;
        below = 0;
        for (int32_t s = 0; s < known; s++) below += even->evaluations[s] <= median;
    }
    limit.evaluations = 2 * median;
    limit.sudden = 4 * even->merit; /* smooth motion begins a step at most 1.6 times as far as the mean, a jump of 2 cm 30 times and more */
    return limit;
}

/* Evaluations that are left to a step, of which so many are done. */
PLIANT_INLINE int32_t pliant_even_remaining(const pliant_even_limit *limit, int32_t done, double first_merit)
{
    if (first_merit > limit->sudden) return INT32_MAX;
    return limit->evaluations > done ? limit->evaluations - done : 0;
}

#endif
