/* Finds the tetrahedra of a lattice that form hexahedra: the five tetrahedra of a cube that meet at eight nodes, or
 * five fragments next to a cut that do so. */
#include "base/fail.h"
#include "base/buffer.h"
#include "fem/element/hexahedra.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

enum { CORNERS = 8 };

int pliant_cell_parity(const pliant_mesh *mesh, int32_t cell)
{
    int32_t nx = mesh->cells[0], ny = mesh->cells[1];
    return (cell % nx + cell / nx % ny + cell / nx / ny) & 1;
}

int32_t pliant_cell_of_tet(const pliant_mesh *mesh, int32_t tet)
{
    if (mesh->lattice_of_tet) return mesh->lattice_of_tet[tet] / 5;
    const int32_t nx = mesh->cells[0] + 1, ny = mesh->cells[1] + 1;
    /* The middle is in a smallest cell of its leaf, or between such cells. */
    int32_t sum[3] = {0, 0, 0};
    for (int v = 0; v < 4; v++) {
        const int32_t at = mesh->lattice_of_node[mesh->tets[4 * tet + v]];
        sum[0] += at % nx, sum[1] += at / nx % ny, sum[2] += at / nx / ny;
    }
    return mesh->leaf_of_cell[sum[0] / 4 + mesh->cells[0] * (sum[1] / 4 + mesh->cells[1] * (sum[2] / 4))];
}

size_t pliant_count_cells(const pliant_mesh *mesh)
{
    return mesh->lattice_of_tet ? (size_t)mesh->cells[0] * (size_t)mesh->cells[1] * (size_t)mesh->cells[2]
                                : (size_t)mesh->num_leaves;
}

/* List tetrahedra by cell.
 * @param among  Nullable: (tets) tetrahedra to list, ascending; NULL: the first `tets` ones.
 * @param first  (cells) first tetrahedron of each cell, -1: none.
 * @param next   (num_tets) next tetrahedron of the same cell.
 * @param count  (cells) number of tetrahedra. */
static void list_tets(const pliant_mesh *mesh, const int32_t *among, int32_t tets, int32_t cells, int32_t *first,
                      int32_t *next, int32_t *count)
{
    for (int32_t cell = 0; cell < cells; cell++) first[cell] = -1;
    for (int32_t i = tets - 1; i >= 0; i--) {
        const int32_t t = among ? among[i] : i, cell = mesh->lattice_of_tet[t] / 5;
        next[t] = first[cell];
        first[cell] = t;
        count[cell]++;
    }
}

/* Add a tetrahedron to a cube, which initially has -1 everywhere. Return false if its slot is occupied, or if a corner
 * has another node. */
static bool add_to_cube(const pliant_mesh *mesh, int32_t cell, int32_t tet, pliant_cube *out)
{
    const int32_t base[3] = {cell % mesh->cells[0], cell / mesh->cells[0] % mesh->cells[1],
                             cell / mesh->cells[0] / mesh->cells[1]};
    const int32_t nx = mesh->cells[0] + 1, ny = mesh->cells[1] + 1, slot = mesh->lattice_of_tet[tet] % 5;
    if (out->tet[slot] >= 0) return false;
    out->tet[slot] = tet;
    for (int v = 0; v < 4; v++) { /* the node order may have been swapped to a positive orientation */
        int32_t node = mesh->tets[4 * tet + v], at = mesh->lattice_of_node[node];
        int corner = (at % nx - base[0]) | (at / nx % ny - base[1]) << 1 | (at / nx / ny - base[2]) << 2;
        if (out->node[corner] >= 0 && out->node[corner] != node) return false;
        out->node[corner] = node;
    }
    return true;
}

static const pliant_cube no_cube = {.tet = {-1, -1, -1, -1, -1}, .node = {-1, -1, -1, -1, -1, -1, -1, -1}};

/* Return whether a cell has five tetrahedra, one per slot, that meet at eight nodes. */
static bool is_whole(const pliant_mesh *mesh, int32_t cell, int32_t first, const int32_t *next, pliant_cube *out)
{
    *out = no_cube;
    for (int32_t t = first; t >= 0; t = next[t])
        if (!add_to_cube(mesh, cell, t, out)) return false;
    return true;
}

static int shared_nodes(const pliant_mesh *mesh, int32_t a, int32_t b)
{
    int count = 0;
    for (int v = 0; v < 16; v++) count += mesh->tets[4 * (size_t)a + v / 4] == mesh->tets[4 * (size_t)b + v % 4];
    return count;
}

/* Return whether the fragments on one side of a cut form a part of a cube: a fragment of the middle tetrahedron, and
 * adjacent fragments that share its faces. They move like the cube, with their part of its stiffness and mass. count:
 * parts of the cell found so far; the new part is appended. */
static bool is_part(const pliant_cell_lists *lists, int32_t cell, int32_t middle, int32_t count)
{
    const pliant_mesh *mesh = lists->mesh;
    pliant_cube cube = no_cube;
    int fragments = 1;
    cube.part = true;
    if (mesh->lattice_of_tet[middle] % 5 != 0 || !add_to_cube(mesh, cell, middle, &cube)) return false;
    for (int32_t t = lists->first[cell]; t >= 0; t = lists->next[t]) {
        const bool adjacent = mesh->lattice_of_tet[t] % 5 != 0 && shared_nodes(mesh, middle, t) == 3;
        fragments += adjacent && pliant_cube_among(lists, count, t) < 0 && add_to_cube(mesh, cell, t, &cube);
    }
    if (fragments == 5) lists->cube[count] = cube;
    return fragments == 5;
}

void pliant_cell_lists_free(pliant_cell_lists *lists)
{
    void *blocks[] = {lists->first, lists->next, lists->count, lists->cube};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
}

pliant_status pliant_cell_lists_make(const pliant_mesh *mesh, const int32_t *among, int32_t tets,
                                     pliant_cell_lists *out)
{
    const size_t cells = pliant_count_cells(mesh);
    int32_t maximum = 0;
    *out = (pliant_cell_lists){.mesh = mesh, .cells = (int32_t)cells};
    out->first = pliant_calloc(cells, sizeof *out->first);
    out->count = pliant_calloc(cells, sizeof *out->count);
    out->next = pliant_malloc((size_t)mesh->num_tets, sizeof *out->next);
    if (!out->first || !out->next || !out->count) return pliant_fail_memory("the hexahedra");
    list_tets(mesh, among, tets, out->cells, out->first, out->next, out->count);
    for (int32_t cell = 0; cell < out->cells; cell++) maximum = out->count[cell] > maximum ? out->count[cell] : maximum;
    out->cube = pliant_calloc((size_t)maximum / 5 + 1, sizeof *out->cube);
    return out->cube ? PLIANT_OK : pliant_fail_memory("the hexahedra");
}

int32_t pliant_cubes_of_cell(const pliant_cell_lists *lists, int32_t cell)
{
    const int32_t tets = lists->count[cell];
    int32_t count = tets == 5 && is_whole(lists->mesh, cell, lists->first[cell], lists->next, lists->cube);
    for (int32_t t = lists->first[cell]; tets > 5 && t >= 0; t = lists->next[t])
        count += is_part(lists, cell, t, count);
    return count;
}

int32_t pliant_cube_among(const pliant_cell_lists *lists, int32_t count, int32_t tet)
{
    const int32_t slot = lists->mesh->lattice_of_tet[tet] % 5;
    for (int32_t c = 0; c < count; c++)
        if (lists->cube[c].tet[slot] == tet) return c;
    return -1;
}

bool pliant_cube_of(const pliant_mesh *mesh, int32_t tet, pliant_cube *out)
{
    const int32_t cell = mesh->lattice_of_tet[tet] / 5, *tets = mesh->tet_of_lattice + 5 * (size_t)cell;
    *out = no_cube;
    for (int slot = 0; slot < 5; slot++)
        if (tets[slot] < 0 || !add_to_cube(mesh, cell, tets[slot], out)) return false;
    return out->tet[mesh->lattice_of_tet[tet] % 5] == tet;
}

bool pliant_cube_is_box(const pliant_mesh *mesh, const pliant_cube *cube, int32_t size)
{
    for (int v = 1; v < CORNERS; v++)
        for (int d = 0; d < 3; d++) {
            double offset = mesh->rest[3 * cube->node[v] + d] - mesh->rest[3 * cube->node[0] + d];
            for (int axis = 0; axis < 3; axis++)
                if (v >> axis & 1) offset -= mesh->direction[3 * d + axis] * mesh->cell_size[axis] * size;
            if (fabs(offset) > 1e-6 * mesh->cell_size[0]) return false;
        }
    return true;
}

/* Do the same for listed tetrahedra. among: as in list_tets. */
static pliant_status find_cubes(const pliant_mesh *mesh, const int32_t *among, int32_t tets, bool boxes,
                                pliant_cube **out, int32_t *count)
{
    pliant_cell_lists lists;
    pliant_status status = pliant_cell_lists_make(mesh, among, tets, &lists);
    *count = 0;
    *out = pliant_calloc((size_t)tets / 5 + 1, sizeof **out);
    if (status == PLIANT_OK && !*out) status = pliant_fail_memory("the hexahedra");
    for (int32_t cell = 0; status == PLIANT_OK && cell < lists.cells; cell++) {
        const int32_t here = pliant_cubes_of_cell(&lists, cell);
        if (here == 0 || (boxes && !pliant_cube_is_box(mesh, lists.cube, 1))) continue;
        memcpy(*out + *count, lists.cube, (size_t)here * sizeof **out);
        *count += here;
    }
    pliant_cell_lists_free(&lists);
    if (status == PLIANT_OK) return PLIANT_OK;
    pliant_free(*out);
    *out = NULL;
    return status;
}

pliant_status pliant_cubes_find(const pliant_mesh *mesh, bool boxes, pliant_cube **out, int32_t *count)
{
    return find_cubes(mesh, NULL, mesh->num_tets, boxes, out, count);
}

pliant_status pliant_cubes_find_among(const pliant_mesh *mesh, const int32_t *tet, int32_t tets, pliant_cube **out,
                                      int32_t *count)
{
    return find_cubes(mesh, tet, tets, false, out, count);
}
