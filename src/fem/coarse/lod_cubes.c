#include "fem/coarse/lod_cubes.h"

#include "base/fail.h"
#include "fem/element/hexahedra.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <math.h>
#include <string.h>

static void place_of(const int32_t cells[3], int32_t cell, int32_t out[3])
{
    out[0] = cell % cells[0];
    out[1] = cell / cells[0] % cells[1];
    out[2] = cell / cells[0] / cells[1];
}

void lod_patch(const lod_builder *lod, int32_t cube, int32_t low[3], int32_t high[3])
{
    const int32_t *cells = lod->system->mesh->cells;
    int32_t at[3];
    place_of(cells, lod->cell[cube], at);
    for (int d = 0; d < 3; d++) {
        low[d] = at[d] > lod->layers ? at[d] - lod->layers : 0;
        high[d] = at[d] + lod->layers < cells[d] ? at[d] + lod->layers : cells[d] - 1;
    }
}

int lod_near(const lod_builder *lod, int32_t cube, int32_t near[PLIANT_MAX_NEAR])
{
    const int32_t *cells = lod->system->mesh->cells;
    int32_t low[3], high[3];
    int count = 0;
    lod_patch(lod, cube, low, high);
    for (int32_t k = low[2]; k <= high[2]; k++)
        for (int32_t j = low[1]; j <= high[1]; j++)
            for (int32_t i = low[0]; i <= high[0]; i++) {
                int32_t other = lod->cube_of_cell[i + cells[0] * (j + cells[1] * k)];
                if (other >= 0) near[count++] = other;
            }
    return count;
}

int lod_interpolation(const lod_builder *lod, int32_t fine_node, int32_t nodes[LOD_MAX_WEIGHTS],
                      double weights[LOD_MAX_WEIGHTS])
{
    const pliant_upsample *upsample = lod->system->upsample;
    const size_t first = (size_t)upsample->corners * (size_t)fine_node;
    int count = 0;
    for (size_t v = first; v < first + (size_t)upsample->corners; v++) {
        double weight = upsample->weights[v];
        if (fabs(weight) < 1e-9) continue; /* nested weights are zero or at least 1 / ratio (cubed in cubes) */
        nodes[count] = upsample->node[v];
        weights[count++] = weight;
    }
    return count;
}

int lod_corner(const lod_builder *lod, int32_t cube, int32_t node)
{
    for (int v = 0; v < 8; v++)
        if (lod->own[8 * cube + v] == node) return v;
    return -1;
}

pliant_status lod_buffers_create(const lod_builder *lod, lod_buffers *out)
{
    size_t fine = (size_t)lod->system->fine->num_nodes, coarse = 2 * (size_t)lod->system->mesh->num_nodes;
    out->local = pliant_calloc(fine, sizeof *out->local);
    out->slot = pliant_calloc(coarse, sizeof *out->slot);
    if (!out->local || !out->slot) return pliant_fail_memory("the correctors");
    memset(out->local, 0xff, fine * sizeof *out->local);
    memset(out->slot, 0xff, coarse * sizeof *out->slot);
    return PLIANT_OK;
}

void lod_buffers_free(lod_buffers *buffers)
{
    pliant_free(buffers->local);
    pliant_free(buffers->slot);
}

int lod_element(const lod_builder *lod, int32_t element, const int32_t **nodes,
                double stiffness[PLIANT_ELEMENT_UNKNOWNS * PLIANT_ELEMENT_UNKNOWNS])
{
    const pliant_system *whole = &lod->whole;
    const int32_t begin = pliant_element_begin(whole, element);
    *nodes = pliant_element_nodes(whole) + begin;
    if (stiffness) pliant_system_element(whole, lod->at_rest, element, stiffness);
    return pliant_element_begin(whole, element + 1) - begin;
}

/* ---- Cubes and the fine mesh. */

/* Return the coarse cell that contains a fine element. */
static int32_t cell_of(const lod_builder *lod, int32_t element)
{
    const pliant_mesh *fine = lod->system->fine, *coarse = lod->system->mesh;
    int32_t cell = lod->whole.macros ? lod->whole.macros->cell[element] : fine->lattice_of_tet[element] / 5,
            r = lod->ratio;
    int32_t i = cell % fine->cells[0] / r, j = cell / fine->cells[0] % fine->cells[1] / r,
            k = cell / fine->cells[0] / fine->cells[1] / r;
    return i + coarse->cells[0] * (j + coarse->cells[1] * k);
}

static void find_own(lod_builder *lod)
{
    const pliant_mesh *coarse = lod->system->mesh;
    int32_t nx = coarse->cells[0] + 1, ny = coarse->cells[1] + 1;
    memset(lod->own, 0xff, 8 * (size_t)lod->count * sizeof *lod->own);
    for (int32_t v = 0; v < 4 * coarse->num_tets; v++) {
        int32_t cell = coarse->lattice_of_tet[v / 4] / 5, node = coarse->tets[v], at = coarse->lattice_of_node[node];
        int32_t cube = lod->cube_of_cell[cell], of_cell[3];
        place_of(coarse->cells, cell, of_cell);
        int32_t i = at % nx - of_cell[0], j = at / nx % ny - of_cell[1], k = at / nx / ny - of_cell[2];
        lod->own[8 * cube + i + 2 * j + 4 * k] = node;
        lod->grounded[cube] |= lod->system->grounded[v / 4];
    }
}

pliant_status lod_list_cubes(lod_builder *lod)
{
    const pliant_mesh *coarse = lod->system->mesh;
    const int32_t cells = coarse->cells[0] * coarse->cells[1] * coarse->cells[2],
                  elements = pliant_element_count(&lod->whole);
    lod->cube_of_cell = pliant_calloc((size_t)cells, sizeof *lod->cube_of_cell);
    lod->elements = pliant_calloc((size_t)elements, sizeof *lod->elements);
    if (!lod->cube_of_cell || !lod->elements) return pliant_fail_memory("the coarse cubes");
    for (int32_t e = 0; e < elements; e++) lod->cube_of_cell[cell_of(lod, e)]++;
    for (int32_t c = 0; c < cells; c++) lod->count += lod->cube_of_cell[c] > 0;
    size_t count = (size_t)lod->count;
    bool good = (lod->cell = pliant_calloc(count, sizeof *lod->cell)) &&
                (lod->element_start = pliant_calloc(count + 2, sizeof *lod->element_start)) &&
                (lod->own = pliant_calloc(count, 8 * sizeof *lod->own)) &&
                (lod->grounded = pliant_calloc(count, sizeof *lod->grounded)) &&
                (lod->patch_nodes = pliant_calloc(count, sizeof *lod->patch_nodes)) &&
                (lod->patch_means = pliant_calloc(count, sizeof *lod->patch_means)) &&
                (lod->correctors = pliant_calloc(count, sizeof *lod->correctors));
    if (!good) return pliant_fail_memory("the coarse cubes");
    int32_t cube = 0;
    for (int32_t c = 0; c < cells; c++) {
        int32_t here = lod->cube_of_cell[c];
        lod->cube_of_cell[c] = here > 0 ? cube : -1;
        if (here == 0) continue;
        lod->element_start[cube + 2] = lod->element_start[cube + 1] + here;
        lod->cell[cube++] = c;
    }
    for (int32_t e = 0; e < elements; e++)
        lod->elements[lod->element_start[lod->cube_of_cell[cell_of(lod, e)] + 1]++] = e;
    find_own(lod);
    return PLIANT_OK;
}

pliant_status lod_measure_fine(lod_builder *lod)
{
    const pliant_mesh *fine = lod->system->fine, *coarse = lod->system->mesh;
    const double massless = 1e-3; /* density of elements without mass [kg/m^3] */
    size_t count = (size_t)fine->num_nodes;
    lod->mass = pliant_calloc(count, sizeof *lod->mass);
    lod->reach = pliant_calloc(count, 6 * sizeof *lod->reach);
    if (!lod->mass || !lod->reach) return pliant_fail_memory("the fine nodes");
    for (size_t n = 0; n < count; n++) memset(lod->reach + 6 * n, 0xff, 3);
    if (lod->whole.macros) {
        pliant_status status = pliant_hexahedra_masses(fine, lod->material, lod->mass);
        if (status != PLIANT_OK) return status;
    }
    for (int32_t t = 0; t < fine->num_tets; t++) {
        double gradients[12], volume = pliant_mesh_gradients(fine, t, gradients),
                              density = massless + (lod->whole.macros ? 0 : lod->material[t].density);
        for (int v = 0; v < 4; v++) lod->mass[fine->tets[4 * t + v]] += 0.25 * volume * density;
    }
    for (int32_t e = 0; e < pliant_element_count(&lod->whole); e++) {
        const int32_t *nodes;
        int32_t at[3];
        place_of(coarse->cells, cell_of(lod, e), at);
        const int corners = lod_element(lod, e, &nodes, NULL);
        for (int v = 0; v < corners; v++) {
            uint8_t *reach = lod->reach + 6 * (size_t)nodes[v];
            for (int d = 0; d < 3; d++) { /* at most 256 cells along an axis */
                if (at[d] < reach[d]) reach[d] = (uint8_t)at[d];
                if (at[d] > reach[3 + d]) reach[3 + d] = (uint8_t)at[d];
            }
        }
    }
    return PLIANT_OK;
}
