/* Live, no step takes much longer than the others: at most twice as many evaluations as the median of the last steps, and what it leaves
 * is the next one's. Where a tool has taken hold, or positions were set, steps are as long as they need at first. */
#ifndef PLIANT_FEM_QUASISTATIC_EVEN_H
#define PLIANT_FEM_QUASISTATIC_EVEN_H

#include <stdint.h>

enum { PLIANT_EVEN_STEPS = 63 };

typedef struct pliant_even {
    uint64_t count; /* of steps since the start */
    int32_t evaluations[PLIANT_EVEN_STEPS]; /* of the last ones, round about */
} pliant_even;

static inline void pliant_even_restart(pliant_even *even) { even->count = 0; }

static inline void pliant_even_note(pliant_even *even, int32_t evaluations)
{
    even->evaluations[even->count++ % PLIANT_EVEN_STEPS] = evaluations;
}

/* Evaluations that the next step may take, of so many at most. */
static inline int32_t pliant_even_limit(const pliant_even *even, int32_t most)
{
    const int32_t least = 4; /* fewer do not get over a refusal */
    if (even->count < PLIANT_EVEN_STEPS) return most;
    int32_t median = 0, below = 0;
    do {
        median++;
        below = 0;
        for (int32_t s = 0; s < PLIANT_EVEN_STEPS; s++) below += even->evaluations[s] <= median;
    } while (2 * below <= PLIANT_EVEN_STEPS);
    const int32_t limit = 2 * median > least ? 2 * median : least;
    return limit < most ? limit : most;
}

#endif
