/* Limits of a step, and the size of its factors. */
#include "backend/backend.h"
#include "base/fail.h"
#include "fem/quasistatic/solver.h"
#include "sim/api/data.h"

#include <math.h>

pliant_status pliant_data_set_limits(pliant_data *data, int iterations, double tolerance)
{
    if (iterations < 1)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "a step needs at least 1 iteration, not %d", iterations);
    if (!(tolerance > 0) || !isfinite(tolerance))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "the tolerance of a step must be above 0, not %g", tolerance);
    data->backend->host_solver->limits(data, iterations, tolerance);
    return PLIANT_OK;
}

size_t pliant_data_get_factor_bytes(const pliant_data *data)
{
    return data->solver ? pliant_preconditioner_bytes(data->solver->preconditioner) + pliant_refresh_bytes(data->solver)
                        : 0;
}

pliant_status pliant_data_set_background(pliant_data *data, pliant_background_kind kind, uint32_t prescribed)
{
    const uint32_t known = PLIANT_RESULT_FACTOR | PLIANT_RESULT_HISTORY | PLIANT_RESULT_PATCH |
                           PLIANT_RESULT_PATCH_END | PLIANT_RESULT_PATCH_FACTOR | PLIANT_RESULT_PATCH_HISTORY;
    if (kind != PLIANT_BACKGROUND_PLANNED && kind != PLIANT_BACKGROUND_LIVE && kind != PLIANT_BACKGROUND_PRESCRIBED)
        return pliant_fail(PLIANT_ERROR_ARGUMENT,
                           "the kind of background results is %d; use planned, live or prescribed (0, 1, 2)",
                           (int)kind);
    if ((prescribed & ~known) || (prescribed && kind != PLIANT_BACKGROUND_PRESCRIBED))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "%u is not a set of background results%s", (unsigned)prescribed,
                           kind == PLIANT_BACKGROUND_PRESCRIBED ? "" : ": only PLIANT_BACKGROUND_PRESCRIBED uses it");
    data->background.kind = kind;
    data->background.prescribed = prescribed;
    return PLIANT_OK;
}

uint32_t pliant_data_get_background_taken(const pliant_data *data) { return data->background.taken; }

const double *pliant_data_get_clock(const pliant_data *data, int32_t *count)
{
    *count = data->clock.count;
    return data->clock.reading;
}

pliant_status pliant_data_prescribe_clock(pliant_data *data, const double *readings, int32_t count)
{
    return pliant_step_clock_prescribe(&data->clock, readings, count);
}
