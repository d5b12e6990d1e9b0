/* Set positions from outside. */
#include "backend/backend.h"
#include "base/fail.h"
#include "fem/rigid/rigid_pieces.h"

#include <math.h>
#include <string.h>

pliant_status pliant_data_set_positions(const pliant_model *model, pliant_data *data, const double *positions)
{
    for (int32_t n = 0; n < 3 * data->body->fine.num_nodes; n++)
        if (!isfinite(positions[n]))
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "the position of node %d is not finite", n / 3);
    data->backend->host_solver->set_positions(model, data, positions);
    if (data->rigid_pieces) pliant_rigid_pieces_set_positions(data->rigid_pieces, positions);
    for (int32_t n = 0; n < data->body->fine.num_nodes; n++)
        if (pliant_rigid_pieces_contain(data->rigid_pieces, n))
            memcpy(data->positions + 3 * n, positions + 3 * n, 3 * sizeof *positions);
    pliant_report_grasps(data);
    return pliant_backend_restart(model, data);
}
