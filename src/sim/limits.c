/* Limits of a step, and what its factors hold. */
#include "backend/backend.h"
#include "base/fail.h"
#include "fem/quasistatic/solver.h"

#include <math.h>

pliant_status pliant_data_limits(pliant_data *data, int iterations, double tolerance)
{
    if (iterations < 1) return pliant_fail(PLIANT_ERROR_ARGUMENT, "a step needs at least 1 iteration, not %d", iterations);
    if (!(tolerance > 0) || !isfinite(tolerance))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "the tolerance of a step must be above 0, not %g", tolerance);
    data->backend->kind->limits(data, iterations, tolerance);
    return PLIANT_OK;
}

size_t pliant_data_factor_bytes(const pliant_data *data)
{
    return data->solver ? pliant_preconditioner_bytes(data->solver->preconditioner) + pliant_refresh_bytes(data->solver) : 0;
}
