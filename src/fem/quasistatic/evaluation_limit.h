/* Evaluation limits that keep the duration of live steps even. A step has at most twice the median number of
 * evaluations of the recent steps with work. The next step continues the remaining work. Steps after a grasp, after
 * positions were set, or under a sudden load have no such limit (NUMERICS.md). */
#ifndef PLIANT_FEM_QUASISTATIC_EVALUATION_LIMIT_H
#define PLIANT_FEM_QUASISTATIC_EVALUATION_LIMIT_H

#include "base/inline.h"
#include "fem/quasistatic/settings.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

enum { PLIANT_EVALUATION_STEPS = 255 };

typedef struct pliant_evaluation_history {
    uint64_t count;                               /* number of steps since the start */
    double merit;                                 /* initial merit of the steps, smoothed [as in pliant_anderson] */
    uint8_t evaluations[PLIANT_EVALUATION_STEPS]; /* evaluations of the last steps that did work, in a ring buffer */
} pliant_evaluation_history;

/* Limit of a step. */
typedef struct pliant_evaluation_limit {
    int32_t evaluations;
    double sudden; /* above this initial merit the limit does not apply */
} pliant_evaluation_limit;

static inline void pliant_evaluations_clear(pliant_evaluation_history *evaluation_history)
{
    evaluation_history->count = 0;
}

static inline void pliant_evaluations_record(pliant_evaluation_history *evaluation_history, int32_t evaluations,
                                             double first_merit)
{
    /* After a dozen steps, motion that has begun counts as normal. */
    const double weight =
        fmax(pliant_get_quasistatic_settings().limit_merit_weight, 1.0 / (double)(evaluation_history->count + 1));
    if (isfinite(first_merit))
        evaluation_history->merit =
            weight < 1 ? evaluation_history->merit + weight * (first_merit - evaluation_history->merit) : first_merit;
    evaluation_history->evaluations[evaluation_history->count++ % PLIANT_EVALUATION_STEPS] =
        (uint8_t)(evaluations < UINT8_MAX ? evaluations : UINT8_MAX);
}

/* Return the limit of the next step. Without `live` there is no limit. */
static inline pliant_evaluation_limit pliant_evaluations_limit(const pliant_evaluation_history *evaluation_history,
                                                               bool live)
{
    const int32_t known = evaluation_history->count < PLIANT_EVALUATION_STEPS ? (int32_t)evaluation_history->count
                                                                              : PLIANT_EVALUATION_STEPS;
    int32_t median = 0, below = 0;
    pliant_evaluation_limit limit = {INT32_MAX, 0};
    if (!live || known < pliant_get_quasistatic_settings().limit_first_steps) return limit;
    while (2 * below <= known) {
        median++;
        below = 0;
        for (int32_t s = 0; s < known; s++) below += evaluation_history->evaluations[s] <= median;
    }
    limit.evaluations = pliant_get_quasistatic_settings().limit_median_factor * median;
    limit.sudden = pliant_get_quasistatic_settings().limit_sudden_merit * evaluation_history->merit;
    return limit;
}

/* Return the number of evaluations left to a step after `done` evaluations. */
PLIANT_INLINE int32_t pliant_evaluations_left(const pliant_evaluation_limit *limit, int32_t done, double first_merit)
{
    if (first_merit > limit->sudden) return INT32_MAX;
    return limit->evaluations > done ? limit->evaluations - done : 0;
}

#endif
