#include "backend/backend.h"
#include "base/fail.h"

#include <math.h>

pliant_status pliant_data_limits(pliant_data *data, int iterations, double tolerance)
{
    if (iterations < 1) return pliant_fail(PLIANT_ERROR_ARGUMENT, "a step needs at least 1 iteration, not %d", iterations);
    if (!(tolerance > 0) || !isfinite(tolerance))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "the tolerance of a step must be above 0, not %g", tolerance);
    data->backend->kind->limits(data, iterations, tolerance);
    return PLIANT_OK;
}
