/* A state given from outside. */
#include "backend/backend.h"
#include "core/fail.h"
#include "fem/solver.h"
#include "fem/tled.h"
#include "interact/tool.h"

#include <math.h>
#include <string.h>

/* the fine node at the place of a node of the solved mesh, or -1: the lattices nest */
static int32_t fine_node_of(const pliant_model *model, int32_t node)
{
    const pliant_mesh *solved = model->system->mesh, *fine = &model->fine;
    if (solved == fine) return node;
    int32_t at = solved->lattice_of_node[node], nx = solved->cells[0] + 1, ny = solved->cells[1] + 1;
    int32_t ratio = fine->cells[0] / solved->cells[0], place[3] = {at % nx * ratio, at / nx % ny * ratio, at / nx / ny * ratio};
    return fine->node_of_lattice[place[0] + (fine->cells[0] + 1) * (place[1] + (fine->cells[1] + 1) * place[2])];
}

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
        int32_t node = system->node_of_free[f], fine = fine_node_of(model, node);
        if (fine >= 0) memcpy(solver->now.x + 3 * node, positions + 3 * fine, 3 * sizeof *positions);
    }
    pliant_solver_forget(solver);
    solver->ahead = false;
    solver->refused = solver->slow = 0;
    pliant_upsample_positions(system, solver->now.x, data->positions);
    for (int t = 0; t < data->num_tools; t++) pliant_tool_report(data, t);
    return pliant_backend_restart(model, data);
}
