/* Lattice mesh with five tetrahedra per cube and alternating parity. Corners of a cube are numbered by bits: 1 along i,
 * 2 along j, 4 along k. The central tetrahedron has the corners with an even number of bits in a cube of parity 0, and
 * with an odd number in a cube of parity 1. The diagonals of shared faces therefore coincide. A grid refined by any
 * integer factor from the same corner nests exactly (fem/coarse/NUMERICS.md). */
#include "mesh/mesh.h"

#include "base/fail.h"
#include "base/matrix.h"
#include "base/memory.h"

#include <string.h>

static const int even_corners[4] = {0, 3, 5, 6}, odd_corners[4] = {1, 2, 4, 7};

void pliant_mesh_slot_corners(int parity, int slot, int corners[4])
{
    const int *central = parity ? odd_corners : even_corners, *tips = parity ? even_corners : odd_corners;
    if (slot == 0) {
        memcpy(corners, central, 4 * sizeof *corners);
        return;
    }
    int tip = tips[slot - 1];
    corners[0] = tip;
    for (int d = 0; d < 3; d++) corners[d + 1] = tip ^ (1 << d);
}

int pliant_mesh_slot_of(int parity, const double local[3])
{
    const int *tips = parity ? even_corners : odd_corners;
    for (int slot = 1; slot < 5; slot++) {
        double sum = 0;
        for (int d = 0; d < 3; d++) sum += (tips[slot - 1] >> d & 1) ? 1 - local[d] : local[d];
        if (sum < 1) return slot;
    }
    return 0;
}

int32_t pliant_mesh_lattice_in(const pliant_mesh *fine, const pliant_mesh *coarse, int32_t node)
{
    int32_t at = coarse->lattice_of_node[node], nx = coarse->cells[0] + 1, ny = coarse->cells[1] + 1;
    int32_t ratio = fine->cells[0] / coarse->cells[0], i = at % nx * ratio, j = at / nx % ny * ratio,
            k = at / nx / ny * ratio;
    return i + (fine->cells[0] + 1) * (j + (fine->cells[1] + 1) * k);
}

int32_t pliant_mesh_node_in(const pliant_mesh *fine, const pliant_mesh *coarse, int32_t node)
{
    return fine->node_of_lattice[pliant_mesh_lattice_in(fine, coarse, node)];
}

/* Find the coarse tetrahedron by the centroid. */
int32_t pliant_lattice_coarse_of(const int32_t cells[3], int32_t ratio, int32_t lattice_tet)
{
    int32_t fine_cell = lattice_tet / 5, nx = cells[0] * ratio, ny = cells[1] * ratio;
    int32_t at[3] = {fine_cell % nx, fine_cell / nx % ny, fine_cell / nx / ny}, coarse[3];
    int corners[4];
    pliant_mesh_slot_corners((at[0] + at[1] + at[2]) & 1, lattice_tet % 5, corners);
    double local[3];
    for (int d = 0; d < 3; d++) {
        coarse[d] = at[d] / ratio;
        local[d] = at[d] - coarse[d] * ratio;
        for (int v = 0; v < 4; v++) local[d] += 0.25 * (corners[v] >> d & 1);
        local[d] /= ratio;
    }
    return 5 * (coarse[0] + cells[0] * (coarse[1] + cells[1] * coarse[2])) +
           pliant_mesh_slot_of((coarse[0] + coarse[1] + coarse[2]) & 1, local);
}

double pliant_tet_gradients(const double *x0, const double *x1, const double *x2, const double *x3,
                            double gradients[12])
{
    double a[3], b[3], c[3];
    for (int d = 0; d < 3; d++) {
        a[d] = x1[d] - x0[d];
        b[d] = x2[d] - x0[d];
        c[d] = x3[d] - x0[d];
    }
    double bc[3] = {b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]};
    double ca[3] = {c[1] * a[2] - c[2] * a[1], c[2] * a[0] - c[0] * a[2], c[0] * a[1] - c[1] * a[0]};
    double ab[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    double determinant = a[0] * bc[0] + a[1] * bc[1] + a[2] * bc[2];
    for (int d = 0; d < 3; d++) {
        gradients[3 + d] = bc[d] / determinant;
        gradients[6 + d] = ca[d] / determinant;
        gradients[9 + d] = ab[d] / determinant;
        gradients[d] = -(gradients[3 + d] + gradients[6 + d] + gradients[9 + d]);
    }
    return determinant / 6;
}

double pliant_mesh_gradients(const pliant_mesh *mesh, int32_t tet, double gradients[12])
{
    const int32_t *nodes = mesh->tets + 4 * (size_t)tet;
    const double *rest = mesh->rest;
    return pliant_tet_gradients(rest + 3 * nodes[0], rest + 3 * nodes[1], rest + 3 * nodes[2], rest + 3 * nodes[3],
                                gradients);
}

static void node_position(const pliant_mesh *mesh, const int32_t at[3], double world[3])
{
    double along[3];
    for (int d = 0; d < 3; d++) along[d] = at[d] * mesh->cell_size[d];
    for (int r = 0; r < 3; r++)
        world[r] = mesh->corner[r] + mesh->direction[3 * r] * along[0] + mesh->direction[3 * r + 1] * along[1] +
                   mesh->direction[3 * r + 2] * along[2];
}

/* List the nodes of a lattice tetrahedron in the order of positive volume. The sign follows from the corner bits, in
 * integers. A left-handed scan inverts it. */
static void oriented_nodes(const pliant_mesh *mesh, int32_t lattice_tet, bool flipped, int32_t nodes[4])
{
    int32_t cell = lattice_tet / 5, nx = mesh->cells[0], ny = mesh->cells[1];
    int32_t a = cell % nx, b = cell / nx % ny, c = cell / nx / ny;
    int corners[4];
    pliant_mesh_slot_corners((a + b + c) & 1, lattice_tet % 5, corners);
    double edges[9];
    for (int e = 0; e < 3; e++)
        for (int d = 0; d < 3; d++) edges[3 * e + d] = (corners[e + 1] >> d & 1) - (corners[0] >> d & 1);
    if ((pliant_determinant(edges) < 0) != flipped) {
        int swap = corners[2];
        corners[2] = corners[3];
        corners[3] = swap;
    }
    for (int v = 0; v < 4; v++) {
        int32_t i = a + (corners[v] & 1), j = b + (corners[v] >> 1 & 1), k = c + (corners[v] >> 2 & 1);
        nodes[v] = i + (nx + 1) * (j + (ny + 1) * k);
    }
}

static pliant_status number_tets(pliant_mesh *mesh, const uint8_t *keep, int32_t lattice_tets)
{
    int32_t count = 0;
    for (int32_t t = 0; t < lattice_tets; t++) mesh->tet_of_lattice[t] = !keep || keep[t] ? count++ : -1;
    if (count == 0)
        return pliant_fail(PLIANT_ERROR_SCENE,
                           "the mesh has no tetrahedra: no voxel of the scan has a tissue of these materials");
    mesh->num_tets = count;
    mesh->tets = pliant_calloc((size_t)count, 4 * sizeof *mesh->tets);
    mesh->lattice_of_tet = pliant_calloc((size_t)count, sizeof *mesh->lattice_of_tet);
    return mesh->tets && mesh->lattice_of_tet ? PLIANT_OK : pliant_fail_memory("the tetrahedra");
}

/* Number the nodes in lattice order, independent of the order of the kept tetrahedra. */
static pliant_status number_nodes(pliant_mesh *mesh, int32_t lattice_tets, int32_t lattice_nodes)
{
    bool flipped = pliant_determinant(mesh->direction) < 0;
    for (int32_t t = 0; t < lattice_tets; t++) {
        int32_t tet = mesh->tet_of_lattice[t];
        if (tet < 0) continue;
        mesh->lattice_of_tet[tet] = t;
        oriented_nodes(mesh, t, flipped, mesh->tets + 4 * tet);
        for (int v = 0; v < 4; v++) mesh->node_of_lattice[mesh->tets[4 * tet + v]] = 1;
    }
    int32_t count = 0;
    for (int32_t n = 0; n < lattice_nodes; n++) mesh->node_of_lattice[n] = mesh->node_of_lattice[n] ? count++ : -1;
    for (int32_t v = 0; v < 4 * mesh->num_tets; v++) mesh->tets[v] = mesh->node_of_lattice[mesh->tets[v]];
    mesh->num_nodes = count;
    mesh->rest = pliant_calloc((size_t)count, 3 * sizeof *mesh->rest);
    mesh->lattice_of_node = pliant_calloc((size_t)count, sizeof *mesh->lattice_of_node);
    if (!mesh->rest || !mesh->lattice_of_node) return pliant_fail_memory("the nodes");
    int32_t nx = mesh->cells[0] + 1, ny = mesh->cells[1] + 1;
    for (int32_t n = 0; n < lattice_nodes; n++) {
        int32_t node = mesh->node_of_lattice[n];
        if (node < 0) continue;
        mesh->lattice_of_node[node] = n;
        node_position(mesh, (int32_t[3]){n % nx, n / nx % ny, n / nx / ny}, mesh->rest + 3 * node);
    }
    return PLIANT_OK;
}

pliant_status pliant_mesh_grid(const pliant_geometry *geometry, const int32_t cells[3], const uint8_t *keep,
                               pliant_mesh *out)
{
    pliant_mesh mesh = {0};
    double lattice = 5;
    for (int d = 0; d < 3; d++) {
        if (cells[d] < 1)
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "a mesh needs at least one cell along each axis, not %d",
                               cells[d]);
        mesh.cells[d] = cells[d];
        mesh.cell_size[d] = geometry->size[d] * geometry->spacing[d] / cells[d];
        lattice *= cells[d] + 1.0;
    }
    if (lattice > 1e9)
        return pliant_fail(PLIANT_ERROR_SCENE, "%d x %d x %d cells are more than a mesh can hold: at most 2e8",
                           cells[0], cells[1], cells[2]);
    memcpy(mesh.direction, geometry->direction, sizeof mesh.direction);
    pliant_geometry_to_world(geometry, (const double[3]){-0.5, -0.5, -0.5}, mesh.corner);
    int32_t lattice_tets = 5 * cells[0] * cells[1] * cells[2];
    int32_t lattice_nodes = (cells[0] + 1) * (cells[1] + 1) * (cells[2] + 1);
    pliant_status status = PLIANT_ERROR_MEMORY;
    mesh.tet_of_lattice = pliant_calloc((size_t)lattice_tets, sizeof *mesh.tet_of_lattice);
    mesh.node_of_lattice = pliant_calloc((size_t)lattice_nodes, sizeof *mesh.node_of_lattice);
    if (!mesh.tet_of_lattice || !mesh.node_of_lattice) {
        status = pliant_fail_memory("the lattice");
        goto failed;
    }
    if ((status = number_tets(&mesh, keep, lattice_tets)) != PLIANT_OK) goto failed;
    if ((status = number_nodes(&mesh, lattice_tets, lattice_nodes)) != PLIANT_OK) goto failed;
    *out = mesh;
    return PLIANT_OK;
failed:
    pliant_mesh_free(&mesh);
    return status;
}

void pliant_mesh_free(pliant_mesh *mesh)
{
    PLIANT_FREE(mesh->rest, mesh->tets, mesh->lattice_of_node, mesh->lattice_of_tet, mesh->tet_of_lattice,
                mesh->node_of_lattice, mesh->leaf_of_cell, mesh->leaf_start, mesh->place_of_node);
    memset(mesh, 0, sizeof *mesh);
}
