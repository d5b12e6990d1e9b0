/* Set positions from outside. */
#include "backend/backend.h"
#include "base/fail.h"
#include "fem/rigid/falling.h"

#include <math.h>
#include <string.h>

pliant_status pliant_data_set_positions(const pliant_model *model, pliant_data *data, const double *positions)
{
    for (int32_t n = 0; n < 3 * data->body->fine.num_nodes; n++)
        if (!isfinite(positions[n]))
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "the position of node %d is not finite", n / 3);
    data->backend->kind->set_positions(model, data, positions);
    if (data->falling) pliant_falling_set_positions(data->falling, positions);
    for (int32_t n = 0; n < data->body->fine.num_nodes; n++)
        if (pliant_falling_has(data->falling, n))
            memcpy(data->positions + 3 * n, positions + 3 * n, 3 * sizeof *positions);
    pliant_pull_report(data);
    return pliant_backend_restart(model, data);
}
