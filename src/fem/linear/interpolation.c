/* Relations between a level of a hierarchy and the next coarser one: cells and interpolation weights. */
#include "fem/linear/hierarchy.h"
#include "mesh/mesh.h"

#include <string.h>

int32_t pliant_coarse_cell(const pliant_mesh *fine, const pliant_mesh *coarse, int32_t cell)
{
    int32_t factor = fine->cells[0] / coarse->cells[0], i = cell % fine->cells[0],
            j = cell / fine->cells[0] % fine->cells[1];
    int32_t k = cell / fine->cells[0] / fine->cells[1];
    return i / factor + coarse->cells[0] * (j / factor + coarse->cells[1] * (k / factor));
}

bool pliant_coarse_weights(const pliant_system *fine, const pliant_system *coarse, int32_t node, int32_t element,
                           double *out)
{
    const pliant_mesh *mesh = fine->mesh;
    if (!coarse->macros) {
        pliant_mesh_barycentric(coarse->mesh, element, mesh->rest + 3 * node, out);
        /* A coordinate of a nested node is zero or at least 1 / factor; smaller values are rounding errors. */
        for (int v = 0; v < 4; v++) out[v] = out[v] > 1e-6 ? out[v] : 0;
        return true;
    }
    int32_t at = mesh->lattice_of_node[node], nx = mesh->cells[0] + 1, ny = mesh->cells[1] + 1,
            cell = coarse->macros->cell[element];
    const int32_t place[3] = {at % nx, at / nx % ny, at / nx / ny}, *cells = coarse->mesh->cells;
    const int32_t corner[3] = {cell % cells[0], cell / cells[0] % cells[1], cell / cells[0] / cells[1]};
    double along[3];
    memset(out, 0, 8 * sizeof *out);
    for (int d = 0; d < 3; d++) {
        int32_t factor = mesh->cells[d] / cells[d];
        along[d] = (double)(place[d] - factor * corner[d]) / factor;
        if (along[d] < 0 || along[d] > 1) return false;
    }
    for (int v = 0; v < 8; v++) {
        out[v] = 1;
        for (int d = 0; d < 3; d++) out[v] *= v >> d & 1 ? along[d] : 1 - along[d];
    }
    return true;
}
