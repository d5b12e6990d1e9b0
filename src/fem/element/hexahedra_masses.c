/* Consistent masses of hexahedra and of the adjacent tetrahedra. */
#include "base/fail.h"
#include "base/buffer.h"
#include "fem/element/hexahedra.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <string.h>

typedef struct masses {
    const pliant_mesh *mesh;
    const pliant_tet_material *material;
    const uint8_t *rebuilt; /* Nullable: (nodes) nonzero: compute this node; NULL: all nodes */
    int32_t *tet, count;    /* all tetrahedra of the cubes around these nodes, ascending */
    double *mass;
} masses;

static pliant_status no_memory(void) { return pliant_fail_memory("the masses"); }

/* Mark the corners of cubes with a changed tetrahedron, which may be incomplete after the cut, and all new nodes.
 * `rebuilt`: (num_nodes). Errors: MEMORY. */
static pliant_status mark_changed(const pliant_mesh *mesh, int32_t nodes_before, const uint8_t *kept, uint8_t *rebuilt)
{
    const int32_t *cells = mesh->cells, nx = cells[0] + 1, ny = cells[1] + 1;
    uint8_t *place = pliant_calloc((size_t)nx * (size_t)ny * ((size_t)cells[2] + 1), 1);
    if (!place) return no_memory();
    for (int32_t t = pliant_next_changed(kept, mesh->num_tets, 0); t < mesh->num_tets;
         t = pliant_next_changed(kept, mesh->num_tets, t + 1)) {
        const int32_t cell = mesh->lattice_of_tet[t] / 5,
                      at[3] = {cell % cells[0], cell / cells[0] % cells[1], cell / cells[0] / cells[1]};
        for (int v = 0; v < 8; v++) place[at[0] + (v & 1) + nx * (at[1] + (v >> 1 & 1) + ny * (at[2] + (v >> 2)))] = 1;
    }
    for (int32_t n = 0; n < mesh->num_nodes; n++) rebuilt[n] = n >= nodes_before || place[mesh->lattice_of_node[n]];
    pliant_free(place);
    return PLIANT_OK;
}

/* List the tetrahedra of cubes with a corner at a marked node's lattice position. near: (cells) zeroed. `rebuilt` NULL:
 * all. */
static void list_tets(const pliant_mesh *mesh, const uint8_t *rebuilt, uint8_t *near, masses *work)
{
    const int32_t *cells = mesh->cells, nx = cells[0] + 1, ny = cells[1] + 1;
    for (int32_t n = 0; rebuilt && n < mesh->num_nodes; n++) {
        if (!rebuilt[n]) continue;
        const int32_t place = mesh->lattice_of_node[n], at[3] = {place % nx, place / nx % ny, place / nx / ny};
        for (int side = 0; side < 8; side++) {
            const int32_t i = at[0] - (side & 1), j = at[1] - (side >> 1 & 1), k = at[2] - (side >> 2);
            if (i >= 0 && j >= 0 && k >= 0 && i < cells[0] && j < cells[1] && k < cells[2])
                near[i + cells[0] * (j + cells[1] * k)] = 1;
        }
    }
    for (int32_t t = 0; t < mesh->num_tets; t++)
        if (!rebuilt || near[mesh->lattice_of_tet[t] / 5]) work->tet[work->count++] = t;
}

static void add(masses *work, int32_t node, double mass)
{
    if (!work->rebuilt || work->rebuilt[node]) work->mass[node] += mass;
}

static void add_cube(masses *work, const pliant_cube *cube, const pliant_cube_shape *shape, uint8_t *inside)
{
    for (int slot = 0; slot < 5; slot++) {
        inside[cube->tet[slot]] = 1;
        for (int v = 0; v < 8; v++)
            add(work, cube->node[v], shape->load[slot][v] * work->material[cube->tet[slot]].density);
    }
}

static void add_tet(masses *work, int32_t tet)
{
    double gradients[12];
    const double fourth = 0.25 * pliant_mesh_gradients(work->mesh, tet, gradients) * work->material[tet].density;
    for (int v = 0; v < 4; v++) add(work, work->mesh->tets[4 * (size_t)tet + (size_t)v], fourth);
}

/* Add cubes first and then tetrahedra, so that the order of the sums does not depend on the kept nodes. */
static pliant_status add_all(masses *work)
{
    const pliant_mesh *mesh = work->mesh;
    pliant_cube_shape *shape = pliant_calloc(2, sizeof *shape);
    pliant_cube *cubes = NULL;
    uint8_t *inside = pliant_calloc((size_t)mesh->num_tets, 1);
    bool known[2] = {false, false};
    int32_t count = 0;
    pliant_status status =
        shape && inside ? pliant_cubes_find_among(mesh, work->tet, work->count, &cubes, &count) : no_memory();
    for (int32_t c = 0; c < count; c++) {
        const int parity = pliant_cell_parity(mesh, mesh->lattice_of_tet[cubes[c].tet[0]] / 5);
        if (!known[parity] || mesh->num_moved > 0) pliant_cube_integrate(mesh, cubes + c, parity, shape + parity);
        known[parity] = true;
        add_cube(work, cubes + c, shape + parity, inside);
    }
    for (int32_t i = 0; status == PLIANT_OK && i < work->count; i++)
        if (!inside[work->tet[i]]) add_tet(work, work->tet[i]);
    pliant_free(shape);
    pliant_free(cubes);
    pliant_free(inside);
    return status;
}

static void clear(masses *work)
{
    for (int32_t n = 0; n < work->mesh->num_nodes; n++) {
        if (!work->rebuilt[n]) continue;
        work->mass[n] = 0;
        pliant_mark_written(work->mass, (size_t)n, 1, sizeof *work->mass);
    }
}

/* Compute the marked masses. The caller sets `rebuilt` and mass. */
static pliant_status find(masses *work)
{
    const pliant_mesh *mesh = work->mesh;
    uint8_t *near = pliant_calloc((size_t)mesh->cells[0] * (size_t)mesh->cells[1] * (size_t)mesh->cells[2], 1);
    work->tet = pliant_malloc((size_t)mesh->num_tets, sizeof *work->tet);
    pliant_status status = near && work->tet ? PLIANT_OK : no_memory();
    if (status == PLIANT_OK) {
        list_tets(mesh, work->rebuilt, near, work);
        status = add_all(work);
    }
    pliant_free(near);
    pliant_free(work->tet);
    return status;
}

pliant_status pliant_hexahedra_masses(const pliant_mesh *mesh, const pliant_tet_material *material, double *mass)
{
    masses work = {.mesh = mesh, .material = material, .mass = mass};
    memset(mass, 0, (size_t)mesh->num_nodes * sizeof *mass);
    return find(&work);
}

pliant_status pliant_hexahedra_masses_next(const pliant_mesh *mesh, const pliant_tet_material *material,
                                           const double *before, int32_t nodes_before, const uint8_t *kept,
                                           double **mass)
{
    const size_t nodes = (size_t)mesh->num_nodes, both = nodes_before < mesh->num_nodes ? (size_t)nodes_before : nodes;
    uint8_t *rebuilt = pliant_calloc(nodes, 1);
    masses work = {.mesh = mesh,
                   .material = material,
                   .rebuilt = rebuilt,
                   .mass = *mass = pliant_next_version(before, both, nodes, sizeof *before)};
    pliant_status status = rebuilt && work.mass ? mark_changed(mesh, nodes_before, kept, rebuilt) : no_memory();
    if (status == PLIANT_OK) {
        clear(&work);
        status = find(&work);
    }
    pliant_free(rebuilt);
    return status;
}
