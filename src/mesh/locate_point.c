/* Finds the tetrahedron that contains a point: at rest by the lattice, in the deformed mesh by a search. */
#include "mesh/mesh.h"

#include <math.h>

/* Barycentric tolerance: rounding must not put a point on a common face outside of both tetrahedra. */
static const double tolerance = 1e-9;
/* In cells: error of a surface position due to single precision in a scan's header. */
static const double face_tolerance = 1e-6;

/* Compute barycentric coordinates. Return false if the tetrahedron is flat or inverted. */
static bool coordinates_in(const pliant_mesh *mesh, const double *positions, int32_t tet, const double world[3],
                           double barycentric[4])
{
    const int32_t *nodes = mesh->tets + 4 * tet;
    const double *x0 = positions + 3 * nodes[0];
    double gradients[12];
    double volume = pliant_tet_gradients(x0, positions + 3 * nodes[1], positions + 3 * nodes[2],
                                         positions + 3 * nodes[3], gradients);
    barycentric[0] = 1;
    for (int v = 1; v < 4; v++) {
        barycentric[v] = 0;
        for (int d = 0; d < 3; d++) barycentric[v] += gradients[3 * v + d] * (world[d] - x0[d]);
        barycentric[0] -= barycentric[v];
    }
    return volume > 0;
}

static bool barycentric_of(const pliant_mesh *mesh, const double *positions, int32_t tet, const double world[3],
                           double barycentric[4])
{
    bool inside = coordinates_in(mesh, positions, tet, world, barycentric);
    for (int v = 0; v < 4; v++) inside = inside && barycentric[v] >= -tolerance;
    return inside;
}

void pliant_mesh_barycentric(const pliant_mesh *mesh, int32_t tet, const double world[3], double barycentric[4])
{
    coordinates_in(mesh, mesh->rest, tet, world, barycentric);
}

static int32_t locate_in_cell(const pliant_mesh *mesh, int32_t cell, const double world[3], double barycentric[4])
{
    if (mesh->num_leaves > 0) {
        int32_t leaf = mesh->leaf_of_cell[cell];
        for (int32_t t = mesh->leaf_start[leaf]; t < mesh->leaf_start[leaf + 1]; t++)
            if (barycentric_of(mesh, mesh->rest, t, world, barycentric)) return t;
        return -1;
    }
    for (int slot = 0; slot < 5; slot++) {
        int32_t tet = mesh->tet_of_lattice[5 * cell + slot];
        if (tet >= 0 && barycentric_of(mesh, mesh->rest, tet, world, barycentric)) return tet;
    }
    return -1;
}

/* Search the neighbouring cells for a point on a cell's face, within rounding of the scan's geometry. It may belong to
 * a tetrahedron there if the tetrahedra in the point's cell are left out. */
static int32_t locate_across_cell_face(const pliant_mesh *mesh, const int32_t cell[3], const double local[3],
                                       const double world[3], double barycentric[4])
{
    int step[3];
    for (int d = 0; d < 3; d++) step[d] = local[d] <= face_tolerance ? -1 : local[d] >= 1 - face_tolerance ? 1 : 0;
    for (int side = 0; side < 8; side++) {
        int32_t at[3];
        bool there = true;
        for (int d = 0; d < 3; d++) {
            at[d] = cell[d] + (side >> d & 1 ? step[d] : 0);
            there = there && !(side >> d & 1 && step[d] == 0) && at[d] >= 0 && at[d] < mesh->cells[d];
        }
        for (int slot = 0; there && slot < 5; slot++) {
            int32_t tet = mesh->tet_of_lattice[5 * (at[0] + mesh->cells[0] * (at[1] + mesh->cells[1] * at[2])) + slot];
            if (tet < 0 || !coordinates_in(mesh, mesh->rest, tet, world, barycentric)) continue;
            double minimum = fmin(fmin(barycentric[0], barycentric[1]), fmin(barycentric[2], barycentric[3]));
            if (minimum >= -4 * face_tolerance) return tet;
        }
    }
    return -1;
}

/* Search the surrounding cells. Tetrahedra with moved nodes extend only into adjacent cells. */
static int32_t locate_in_adjacent_cells(const pliant_mesh *mesh, const int32_t cell[3], const double world[3],
                                        double barycentric[4])
{
    for (int n = 0; n < 27; n++) {
        int32_t at[3] = {cell[0] + n % 3 - 1, cell[1] + n / 3 % 3 - 1, cell[2] + n / 9 - 1};
        if (at[0] < 0 || at[1] < 0 || at[2] < 0 || at[0] >= mesh->cells[0] || at[1] >= mesh->cells[1] ||
            at[2] >= mesh->cells[2])
            continue;
        int32_t tet =
            locate_in_cell(mesh, at[0] + mesh->cells[0] * (at[1] + mesh->cells[1] * at[2]), world, barycentric);
        if (tet >= 0) return tet;
    }
    return -1;
}

int32_t pliant_mesh_locate(const pliant_mesh *mesh, const double world[3], double barycentric[4])
{
    double along[3], local[3];
    int32_t cell[3];
    for (int d = 0; d < 3; d++) {
        along[d] = 0;
        for (int r = 0; r < 3; r++) along[d] += mesh->direction[3 * r + d] * (world[r] - mesh->corner[r]);
        along[d] /= mesh->cell_size[d];
        if (!(along[d] >= -face_tolerance && along[d] <= mesh->cells[d] + face_tolerance)) return -1;
        cell[d] = (int32_t)floor(along[d]);
        if (cell[d] < 0) cell[d] = 0;
        if (cell[d] >= mesh->cells[d]) cell[d] = mesh->cells[d] - 1;
        local[d] = along[d] - cell[d];
    }
    int32_t flat = cell[0] + mesh->cells[0] * (cell[1] + mesh->cells[1] * cell[2]);
    if (mesh->num_moved > 0) {
        int32_t own = locate_in_cell(mesh, flat, world, barycentric);
        return own >= 0 ? own : locate_in_adjacent_cells(mesh, cell, world, barycentric);
    }
    if (mesh->num_leaves > 0) return locate_in_cell(mesh, flat, world, barycentric);
    int slot = pliant_mesh_slot_of((cell[0] + cell[1] + cell[2]) & 1, local);
    int32_t tet = mesh->tet_of_lattice[5 * flat + slot];
    if (tet >= 0) {
        barycentric_of(mesh, mesh->rest, tet, world, barycentric);
        return tet;
    }
    /* The tetrahedron at the point is left out, but the point may be on its face with an existing one. */
    tet = locate_in_cell(mesh, flat, world, barycentric);
    return tet >= 0 ? tet : locate_across_cell_face(mesh, cell, local, world, barycentric);
}

int32_t pliant_mesh_locate_deformed(const pliant_mesh *mesh, const double *positions, const double world[3],
                                    double barycentric[4])
{
    if (!isfinite(world[0]) || !isfinite(world[1]) || !isfinite(world[2])) return -1;
    for (int32_t tet = 0; tet < mesh->num_tets; tet++) {
        const int32_t *nodes = mesh->tets + 4 * tet;
        bool outside = false;
        for (int d = 0; d < 3 && !outside; d++) {
            double low = INFINITY, high = -INFINITY;
            for (int v = 0; v < 4; v++) {
                low = fmin(low, positions[3 * nodes[v] + d]);
                high = fmax(high, positions[3 * nodes[v] + d]);
            }
            double slack = tolerance * (high - low);
            outside = world[d] < low - slack || world[d] > high + slack;
        }
        if (!outside && barycentric_of(mesh, positions, tet, world, barycentric)) return tet;
    }
    return -1;
}
