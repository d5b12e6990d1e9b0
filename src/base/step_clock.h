/* Time limit of a step (solver/budget_ms). The number of evaluations depends on the clock's readings. They are
 * saved, so that a replay makes the same evaluations. */
#ifndef PLIANT_BASE_STEP_CLOCK_H
#define PLIANT_BASE_STEP_CLOCK_H

#include "pliant/status.h"

#include <stdbool.h>
#include <stdint.h>

typedef struct pliant_step_clock {
    double budget;             /* time of a step [s]; 0: unlimited, and the clock is not read */
    double begin;              /* start of the step, on the clock [s] */
    double (*now)(void *user); /* NULL: the machine's clock [s] */
    void *user;
    double *reading;           /* [capacity]: time since the start of the step [s] */
    int32_t count;             /* readings of the last step */
    int32_t prescribed;        /* the first readings of the next step, which it takes instead of the clock's */
    int32_t capacity;
    bool out_of_memory;        /* a reading of this step could not be kept */
} pliant_step_clock;

/* Begin a step. */
void pliant_step_clock_begin(pliant_step_clock *clock);
/* End a step, whose prescribed readings are used up. Errors: MEMORY: the readings are incomplete. */
pliant_status pliant_step_clock_end(pliant_step_clock *clock);
/* Return the time since the start of the step [s]. Nullable: return 0. */
double pliant_step_clock_read(pliant_step_clock *clock);
/* Return whether steps have a time limit. Nullable. */
bool pliant_step_clock_has_limit(const pliant_step_clock *clock);
/* Return whether time is left in this step. Without a limit: true. Nullable. */
bool pliant_step_clock_has_time(pliant_step_clock *clock);
/* Prescribe the first readings of the next step. Without a limit they are ignored. Errors: MEMORY. */
pliant_status pliant_step_clock_prescribe(pliant_step_clock *clock, const double *readings, int32_t count);

#endif
