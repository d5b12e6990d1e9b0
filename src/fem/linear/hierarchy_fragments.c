/* Levels whose elements are fragments. The elements in one cube of the next level form one element there if moving
 * nodes connect them, and several elements otherwise. Such elements share only corner nodes that interpolate their
 * common nodes (virtual nodes: Molino, Bao, Fedkiw 2004, on every level). Tissue that a cut has separated is therefore
 * separate on all levels. */
#include "fem/linear/hierarchy.h"

#include "base/fail.h"
#include "base/memory.h"
#include "base/union_find.h"

#include <string.h>

enum { CORNERS = 8 };

static pliant_status no_memory(void) { return pliant_fail_memory("the coarser meshes"); }

pliant_status pliant_nested_places(pliant_grid_level *level)
{
    const pliant_system *system = &level->system;
    const pliant_graded *graded = system->graded;
    const pliant_mesh *fine = system->fine, *solved = system->mesh;
    pliant_mesh *mesh = &level->mesh;
    if (!(mesh->lattice_of_node = pliant_calloc((size_t)solved->num_nodes, sizeof *mesh->lattice_of_node)))
        return no_memory();
    memcpy(mesh->cells, fine->cells, sizeof mesh->cells);
    mesh->num_nodes = solved->num_nodes;
    const int32_t *cells = solved->cells, nx = cells[0] + 1, ny = cells[1] + 1;
    for (int32_t n = 0; n < graded->coarse_nodes; n++) {
        const int32_t at = graded->coarse_place[n];
        const int32_t i = at % nx * (fine->cells[0] / cells[0]), j = at / nx % ny * (fine->cells[1] / cells[1]),
                      k = at / nx / ny * (fine->cells[2] / cells[2]);
        mesh->lattice_of_node[n] = i + (fine->cells[0] + 1) * (j + (fine->cells[1] + 1) * k);
    }
    memcpy(mesh->lattice_of_node + graded->coarse_nodes, fine->lattice_of_node,
           (size_t)fine->num_nodes * sizeof *fine->lattice_of_node);
    level->system.mesh = mesh;
    return PLIANT_OK;
}

/* Find connected components of the elements in each cell of the next lattice. parent: in: (elements) cell of each in
 * the next lattice; out: its component, or -1 if none of its nodes moves. */
static int32_t find_components(const pliant_system *fine, int32_t *parent, int32_t *component)
{
    const int32_t elements = pliant_level_elements(fine), *nodes = pliant_element_nodes(fine);
    int32_t count = 0;
    for (int32_t e = 0; e < elements; e++) component[e] = e;
    for (int32_t f = 0; f < fine->num_free; f++)
        for (int32_t c = fine->corner_start[f]; c < fine->corner_end[f]; c++) {
            const int32_t e = pliant_element_of_corner(fine, fine->corner[c]);
            for (int32_t d = fine->corner_start[f]; d < c; d++) {
                const int32_t other = pliant_element_of_corner(fine, fine->corner[d]);
                if (parent[other] != parent[e]) continue;
                pliant_set_join(component, e, other);
                break;
            }
        }
    for (int32_t e = 0; e < elements; e++) {
        bool moves = false;
        for (int32_t c = pliant_element_begin(fine, e); c < pliant_element_begin(fine, e + 1); c++)
            moves = moves || fine->free_of_node[nodes[c]] >= 0;
        const int32_t root = pliant_set_root(component, e);
        if (!moves) parent[e] = -1;
        else parent[e] = root == e ? count++ : parent[root];
    }
    return count;
}

static pliant_status allocate(size_t count, size_t elements, pliant_grid_level *level, pliant_grid_level *next)
{
    pliant_macros *macros = next->system.macros = pliant_calloc(1, sizeof *macros);
    level->child_start = pliant_calloc(count + 2, sizeof *level->child_start);
    level->child = pliant_calloc(elements, sizeof *level->child);
    if (!macros || !level->child_start || !level->child) return no_memory();
    macros->start = pliant_calloc(count + 1, sizeof *macros->start);
    macros->node = pliant_calloc(CORNERS * count, sizeof *macros->node);
    macros->cell = pliant_calloc(count, sizeof *macros->cell);
    macros->count = (int32_t)count;
    next->system.num_blocks = (macros->count + LANES - 1) / LANES;
    return macros->start && macros->node && macros->cell ? PLIANT_OK : no_memory();
}

static void list_children(int32_t elements, pliant_grid_level *level, int32_t count)
{
    for (int32_t e = 0; e < elements; e++)
        if (level->parent[e] >= 0) level->child_start[level->parent[e] + 2]++;
    for (int32_t c = 0; c < count; c++) level->child_start[c + 2] += level->child_start[c + 1];
    for (int32_t e = 0; e < elements; e++)
        if (level->parent[e] >= 0) level->child[level->child_start[level->parent[e] + 1]++] = e;
}

static int32_t place_of(const int32_t cells[3], int32_t cell, int corner)
{
    const int32_t i = cell % cells[0] + (corner & 1), j = cell / cells[0] % cells[1] + (corner >> 1 & 1),
                  k = cell / cells[0] / cells[1] + (corner >> 2);
    return i + (cells[0] + 1) * (j + (cells[1] + 1) * k);
}

/* Join corner nodes of different elements that interpolate the same node. node: (8 per element) the joined node of each
 * corner. */
static void share_corners(const pliant_system *fine, const pliant_grid_level *level, const pliant_grid_level *next,
                          int32_t *node)
{
    const int32_t *cells = next->mesh.cells;
    for (int32_t f = 0; f < fine->num_free; f++) {
        int32_t first = -1;
        for (int32_t c = fine->corner_start[f]; c < fine->corner_end[f]; c++) {
            const int32_t element = level->parent[pliant_element_of_corner(fine, fine->corner[c])];
            double weights[CORNERS];
            if (element == first ||
                !pliant_coarse_weights(fine, &next->system, fine->node_of_free[f], element, weights))
                continue;
            if (first < 0) first = element;
            for (int v = 0; element != first && v < CORNERS; v++)
                for (int u = 0; weights[v] > 0 && u < CORNERS; u++)
                    if (place_of(cells, next->system.macros->cell[element], v) ==
                        place_of(cells, next->system.macros->cell[first], u))
                        pliant_set_join(node, CORNERS * element + v, CORNERS * first + u);
        }
    }
}

static pliant_status number_nodes(int32_t *same, pliant_grid_level *next)
{
    pliant_macros *macros = next->system.macros;
    pliant_mesh *mesh = &next->mesh;
    if (!(mesh->lattice_of_node = pliant_calloc(CORNERS * (size_t)macros->count, sizeof *mesh->lattice_of_node)))
        return no_memory();
    for (int32_t c = 0; c < CORNERS * macros->count; c++) {
        const int32_t root = pliant_set_root(same, c);
        macros->node[c] = root == c ? mesh->num_nodes : macros->node[root];
        if (root == c)
            mesh->lattice_of_node[mesh->num_nodes++] = place_of(mesh->cells, macros->cell[c / CORNERS], c % CORNERS);
    }
    return PLIANT_OK;
}

/* Next to a cut through coarse elements, fine elements have the cell numbers of the coarse lattice. */
static int32_t next_cell_of(const pliant_system *fine, const pliant_mesh *next, int32_t element)
{
    const int32_t cell = fine->macros ? fine->macros->cell[element] : fine->mesh->lattice_of_tet[element] / 5;
    return fine->graded ? cell : pliant_coarse_cell(fine->mesh, next, cell);
}

pliant_status pliant_nested_elements(const pliant_system *fine, const int32_t cells[3], pliant_grid_level *level,
                                     pliant_grid_level *next)
{
    const int32_t from = pliant_level_elements(fine);
    const size_t elements = (size_t)from;
    int32_t *component = pliant_calloc(elements, sizeof *component), *cell = pliant_calloc(elements, sizeof *cell),
            *same = NULL;
    pliant_status status = component && cell ? PLIANT_OK : no_memory();
    if (!(level->parent = pliant_calloc(elements, sizeof *level->parent))) status = no_memory();
    memcpy(next->mesh.cells, cells, sizeof next->mesh.cells);
    if (status == PLIANT_OK) {
        for (int32_t e = 0; e < from; e++) cell[e] = level->parent[e] = next_cell_of(fine, &next->mesh, e);
        status = allocate((size_t)find_components(fine, level->parent, component), elements, level, next);
    }
    if (status == PLIANT_OK) {
        pliant_macros *macros = next->system.macros;
        for (int32_t e = 0; e < from; e++)
            if (level->parent[e] >= 0) macros->cell[level->parent[e]] = cell[e];
        for (int32_t e = 0; e < macros->count; e++) macros->start[e + 1] = CORNERS * (e + 1);
        list_children(from, level, macros->count);
        if (!(same = pliant_calloc(CORNERS * (size_t)macros->count, sizeof *same))) status = no_memory();
        for (int32_t c = 0; same && c < CORNERS * macros->count; c++) same[c] = c;
    }
    if (status == PLIANT_OK) {
        share_corners(fine, level, next, same);
        status = number_nodes(same, next);
    }
    pliant_free(component);
    pliant_free(cell);
    pliant_free(same);
    return status;
}

pliant_status pliant_hierarchy_mark_copies(const pliant_hierarchy *hierarchy, uint8_t *opened)
{
    const pliant_system *system = &hierarchy->level[0].system;
    const pliant_mesh *mesh = system->mesh;
    const size_t places = (size_t)(mesh->cells[0] + 1) * (size_t)(mesh->cells[1] + 1) * (size_t)(mesh->cells[2] + 1);
    int32_t *first = pliant_calloc(places, sizeof *first); /* unknown there, + 1 */
    if (!first) return no_memory();
    for (int32_t f = 0; f < system->num_free; f++) {
        int32_t *here = first + mesh->lattice_of_node[system->node_of_free[f]];
        opened[f] = *here > 0;
        if (*here > 0) opened[*here - 1] = 1;
        else *here = f + 1;
    }
    pliant_free(first);
    return PLIANT_OK;
}
