#include "base/step_clock.h"

#include "base/buffer.h"
#include "base/clock.h"
#include "base/fail.h"

#include <string.h>

static double now(const pliant_step_clock *clock) { return clock->now ? clock->now(clock->user) : pliant_seconds(); }

bool pliant_step_clock_has_limit(const pliant_step_clock *clock) { return clock && clock->budget > 0; }

void pliant_step_clock_begin(pliant_step_clock *clock)
{
    clock->count = 0;
    clock->out_of_memory = false;
    if (pliant_step_clock_has_limit(clock)) clock->begin = now(clock);
}

pliant_status pliant_step_clock_end(pliant_step_clock *clock)
{
    clock->prescribed = 0;
    return clock->out_of_memory ? pliant_fail_memory("the clock's readings") : PLIANT_OK;
}

double pliant_step_clock_read(pliant_step_clock *clock)
{
    enum { FIRST = 32 };
    if (!pliant_step_clock_has_limit(clock)) return 0;
    if (clock->count < clock->prescribed) return clock->reading[clock->count++];
    const double time = now(clock) - clock->begin;
    if (pliant_reserve(&clock->reading, &clock->capacity, clock->count, FIRST, sizeof *clock->reading))
        clock->reading[clock->count++] = time;
    else
        clock->out_of_memory = true;
    return time;
}

bool pliant_step_clock_has_time(pliant_step_clock *clock)
{
    return !pliant_step_clock_has_limit(clock) || pliant_step_clock_read(clock) < clock->budget;
}

pliant_status pliant_step_clock_prescribe(pliant_step_clock *clock, const double *readings, int32_t count)
{
    clock->prescribed = 0;
    if (!pliant_step_clock_has_limit(clock) || count == 0) return PLIANT_OK;
    if (count > clock->capacity && !pliant_grow(&clock->reading, (size_t)count, sizeof *clock->reading))
        return pliant_fail_memory("the clock's readings");
    if (count > clock->capacity) clock->capacity = count;
    memcpy(clock->reading, readings, (size_t)count * sizeof *readings);
    clock->prescribed = count;
    return PLIANT_OK;
}
