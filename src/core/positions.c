/* A state given from outside. */
#include "backend/backend.h"
#include "core/fail.h"
#include "fem/solver.h"
#include "fem/tled.h"
#include "interact/tool.h"

#include <math.h>
#include <string.h>

pliant_status pliant_data_set_positions(const pliant_model *model, pliant_data *data, const double *positions)
{
    const pliant_system *system = model->system;
    pliant_solver *solver = data->solver;
    for (int32_t n = 0; n < 3 * model->fine.num_nodes; n++)
        if (!isfinite(positions[n])) return pliant_fail(PLIANT_ERROR_ARGUMENT, "the position of node %d is not finite", n / 3);
    if (data->tled) {
        pliant_tled_set_positions(data->tled, positions);
        memcpy(data->positions, positions, 3 * (size_t)model->fine.num_nodes * sizeof *positions);
        for (int t = 0; t < data->num_tools; t++) pliant_tool_report(data, t);
        return pliant_backend_restart(model, data);
    }
    for (int32_t f = 0; f < system->num_free; f++) {
        int32_t node = system->node_of_free[f], fine = pliant_mesh_node_in(&model->fine, system->mesh, node);
        if (fine >= 0) memcpy(solver->now.x + 3 * node, positions + 3 * fine, 3 * sizeof *positions);
    }
    pliant_solver_forget(solver);
    solver->ahead = false;
    solver->refused = solver->slow = 0;
    pliant_upsample_positions(system, solver->now.x, data->positions);
    for (int t = 0; t < data->num_tools; t++) pliant_tool_report(data, t);
    return pliant_backend_restart(model, data);
}
