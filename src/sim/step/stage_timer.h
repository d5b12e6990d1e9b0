/* Stages of a step, each timed by the same code. */
#ifndef PLIANT_SIM_STAGE_TIMER_H
#define PLIANT_SIM_STAGE_TIMER_H

#include "base/clock.h"
#include "base/threads.h"
#include "model_data/data.h"

/* Run a stage and add its time to the statistics. */
static inline pliant_status pliant_run_stage(const pliant_model *model, pliant_data *data, int stage,
                                             pliant_status (*function)(const pliant_model *, pliant_data *))
{
    const double start = pliant_seconds();
    const pliant_status status = function(model, data);
    data->statistics.seconds[stage] += pliant_seconds() - start;
    return status;
}

#endif
