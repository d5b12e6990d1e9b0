/* The levels of a multigrid: nested lattices, and the transfer of values between them. */
#include "base/fail.h"
#include "fem/linear/hierarchy.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <string.h>

/* Return the box of a mesh as a geometry whose voxels are the mesh's cells. */
static pliant_geometry box_of(const pliant_mesh *mesh)
{
    pliant_geometry geometry;
    memcpy(geometry.size, mesh->cells, sizeof geometry.size);
    memcpy(geometry.spacing, mesh->cell_size, sizeof geometry.spacing);
    memcpy(geometry.direction, mesh->direction, sizeof geometry.direction);
    for (int r = 0; r < 3; r++) {
        geometry.origin[r] = mesh->corner[r];
        for (int d = 0; d < 3; d++) geometry.origin[r] += 0.5 * mesh->direction[3 * r + d] * mesh->cell_size[d];
    }
    return geometry;
}

/* Return the smallest factor that divides the cells along all axes; 0: none up to 8. */
static int32_t factor_of(const int32_t cells[3])
{
    for (int32_t factor = 2; factor <= 8; factor++)
        if (cells[0] % factor == 0 && cells[1] % factor == 0 && cells[2] % factor == 0) return factor;
    return 0;
}

/* Build the coarse elements that are not empty: tetrahedra, or complete cubes for hexahedra. */
static pliant_status coarser_mesh(const pliant_system *fine, int32_t factor, pliant_mesh *out)
{
    const pliant_mesh *mesh = fine->mesh;
    int32_t cells[3] = {mesh->cells[0] / factor, mesh->cells[1] / factor, mesh->cells[2] / factor};
    pliant_geometry geometry = box_of(mesh);
    uint8_t *keep = pliant_calloc(5 * (size_t)cells[0] * cells[1] * cells[2], 1);
    if (!keep) return pliant_fail_memory("the coarser meshes");
    for (int32_t t = 0; t < mesh->num_tets; t++) {
        int32_t at = pliant_lattice_coarse_of(cells, factor, mesh->lattice_of_tet[t]);
        if (fine->macros) memset(keep + 5 * (at / 5), 1, 5);
        else keep[at] = 1;
    }
    pliant_status status = pliant_mesh_grid(&geometry, cells, keep, out);
    pliant_free(keep);
    return status;
}

static pliant_status link_elements(const pliant_system *fine, int32_t factor, pliant_grid_level *level,
                                   const pliant_system *next)
{
    const pliant_macros *macros = fine->macros;
    const pliant_mesh *coarse = next->mesh;
    int32_t count = pliant_level_elements(fine), coarse_count = pliant_level_elements(next);
    int32_t *cube_of_cell =
        macros ? pliant_calloc((size_t)coarse->cells[0] * coarse->cells[1] * coarse->cells[2], sizeof *cube_of_cell)
               : NULL;
    level->parent = pliant_calloc((size_t)count, sizeof *level->parent);
    level->child_start = pliant_calloc((size_t)coarse_count + 2, sizeof *level->child_start);
    level->child = pliant_calloc((size_t)count, sizeof *level->child);
    if (!level->parent || !level->child_start || !level->child || (macros && !cube_of_cell)) {
        pliant_free(cube_of_cell);
        return pliant_fail_memory("the coarser meshes");
    }
    for (int32_t c = 0; macros && c < coarse_count; c++) cube_of_cell[next->macros->cell[c]] = c;
    for (int32_t e = 0; e < count; e++) {
        level->parent[e] =
            macros
                ? cube_of_cell[pliant_coarse_cell(fine->mesh, coarse, macros->cell[e])]
                : coarse
                      ->tet_of_lattice[pliant_lattice_coarse_of(coarse->cells, factor, fine->mesh->lattice_of_tet[e])];
        level->child_start[level->parent[e] + 2]++;
    }
    for (int32_t c = 0; c < coarse_count; c++) level->child_start[c + 2] += level->child_start[c + 1];
    for (int32_t e = 0; e < count; e++) level->child[level->child_start[level->parent[e] + 1]++] = e;
    pliant_free(cube_of_cell);
    return PLIANT_OK;
}

static int32_t corner_of(const pliant_system *system, int32_t element, int corner)
{
    return system->macros ? system->macros->node[system->macros->start[element] + corner]
                          : system->mesh->tets[4 * element + corner];
}

/* Find a coarse element that contains each node: (nodes). */
static void find_holders(const pliant_system *fine, const pliant_grid_level *level, const pliant_system *next,
                         int32_t *holder)
{
    double weights[8];
    for (int32_t e = 0; e < pliant_level_elements(fine); e++) {
        int here = fine->macros ? fine->macros->start[e + 1] - fine->macros->start[e] : 4;
        for (int v = 0; v < here; v++) {
            const int32_t node = corner_of(fine, e, v);
            /* Next to a cut, an element's corners may belong to an adjacent cube. */
            if (fine->graded &&
                (level->parent[e] < 0 || !pliant_coarse_weights(fine, next, node, level->parent[e], weights)))
                continue;
            holder[node] = level->parent[e];
        }
    }
}

/* Map the free nodes of the finer level to nodes of the coarser level. Coarse nodes without a dependent free node are
 * left out. */
static pliant_status transfer(const pliant_system *fine, pliant_grid_level *level, pliant_grid_level *next)
{
    size_t count = (size_t)fine->num_free, corners = (size_t)level->corners;
    int32_t *holder = pliant_calloc((size_t)fine->mesh->num_nodes, sizeof *holder);
    uint8_t *unused = pliant_calloc((size_t)next->mesh.num_nodes, 1);
    level->to = pliant_calloc(count, corners * sizeof *level->to);
    level->weight = pliant_calloc(count, corners * sizeof *level->weight);
    pliant_status status = PLIANT_OK;
    if (!holder || !unused || !level->to || !level->weight) {
        status = pliant_fail_memory("the transfer between meshes");
        goto done;
    }
    find_holders(fine, level, &next->system, holder);
    memset(unused, 1, (size_t)next->mesh.num_nodes);
    for (size_t f = 0; f < count; f++) {
        int32_t node = fine->node_of_free[f];
        double weights[8];
        pliant_coarse_weights(fine, &next->system, node, holder[node], weights);
        for (int v = 0; v < level->corners; v++) {
            size_t at = corners * f + (size_t)v;
            level->to[at] = corner_of(&next->system, holder[node], v);
            level->weight[at] = (float)weights[v];
            if (weights[v] > 0) unused[level->to[at]] = 0;
        }
    }
    status = pliant_system_unknowns(&next->system, unused);
    for (size_t v = 0; status == PLIANT_OK && v < corners * count; v++)
        level->to[v] = next->system.free_of_node[level->to[v]];
done:
    pliant_free(holder);
    pliant_free(unused);
    return status;
}

/* Build the inverse lists: the fine unknowns that contribute to a coarse unknown. */
static pliant_status transpose(pliant_grid_level *level, int32_t num_fine, int32_t num_coarse)
{
    const int32_t entries = level->corners * num_fine;
    level->from_start = pliant_calloc((size_t)num_coarse + 2, sizeof *level->from_start);
    level->from = pliant_calloc((size_t)entries, sizeof *level->from);
    if (!level->from_start || !level->from) return pliant_fail_memory("the transfer between meshes");
    for (int32_t v = 0; v < entries; v++)
        if (level->weight[v] > 0) level->from_start[level->to[v] + 2]++;
    for (int32_t c = 0; c < num_coarse; c++) level->from_start[c + 2] += level->from_start[c + 1];
    for (int32_t v = 0; v < entries; v++)
        if (level->weight[v] > 0) level->from[level->from_start[level->to[v] + 1]++] = v;
    return PLIANT_OK;
}

/* Build complete rows from both triangles, for products with a vector. */
static pliant_status full_rows(const pliant_system *system, pliant_grid_level *level)
{
    const pliant_pattern *pattern = &system->pattern;
    int32_t entries = 2 * pattern->num_blocks - pattern->num_columns;
    level->row_start = pliant_calloc((size_t)system->num_free + 2, sizeof *level->row_start);
    level->column = pliant_calloc((size_t)entries, sizeof *level->column);
    level->place = pliant_calloc((size_t)pattern->num_blocks, 2 * sizeof *level->place);
    if (!level->row_start || !level->column || !level->place) return pliant_fail_memory("the rows of the matrix");
    for (int32_t column = 0; column < pattern->num_columns; column++)
        for (int32_t b = pattern->start[column]; b < pattern->start[column + 1]; b++) {
            level->row_start[pattern->row[b] + 2]++;
            if (pattern->row[b] != column) level->row_start[column + 2]++;
        }
    for (int32_t r = 0; r < system->num_free; r++) level->row_start[r + 2] += level->row_start[r + 1];
    for (int32_t column = 0; column < pattern->num_columns; column++)
        for (int32_t b = pattern->start[column]; b < pattern->start[column + 1]; b++) {
            int32_t row = pattern->row[b];
            level->place[2 * b] = level->row_start[row + 1]++;
            level->column[level->place[2 * b]] = column;
            level->place[2 * b + 1] = row == column ? -1 : level->row_start[column + 1]++;
            if (row != column) level->column[level->place[2 * b + 1]] = row;
        }
    return PLIANT_OK;
}

static void level_free(pliant_grid_level *level)
{
    pliant_free(level->parent);
    pliant_free(level->child_start);
    pliant_free(level->child);
    pliant_free(level->to);
    pliant_free(level->weight);
    pliant_free(level->from_start);
    pliant_free(level->from);
    pliant_free(level->row_start);
    pliant_free(level->column);
    pliant_free(level->place);
    pliant_system_clear(&level->system);
    pliant_mesh_free(&level->mesh);
}

pliant_hierarchy *pliant_hierarchy_retain(pliant_hierarchy *hierarchy)
{
    __atomic_add_fetch(&hierarchy->holders, 1, __ATOMIC_RELAXED);
    return hierarchy;
}

void pliant_hierarchy_free(pliant_hierarchy *hierarchy)
{
    if (!hierarchy || __atomic_sub_fetch(&hierarchy->holders, 1, __ATOMIC_ACQ_REL) > 0) return;
    /* The finest system belongs to the model. */
    memset(&hierarchy->level[0].system, 0, sizeof hierarchy->level[0].system);
    for (int l = 0; l < hierarchy->num_levels; l++) level_free(hierarchy->level + l);
    pliant_factor_free(hierarchy->factor);
    pliant_free(hierarchy);
}

static pliant_status next_of_lattice(const pliant_system *fine, int32_t factor, pliant_grid_level *level,
                                     pliant_grid_level *next)
{
    pliant_status status = coarser_mesh(fine, factor, &next->mesh);
    if (status != PLIANT_OK) return status;
    next->system.num_blocks = (next->mesh.num_tets + LANES - 1) / LANES;
    if (fine->macros) status = pliant_system_cubes(&next->system);
    return status == PLIANT_OK ? link_elements(fine, factor, level, &next->system) : status;
}

/* Build the level above a graded system, in the coarse lattice. */
static pliant_status next_of_fragments(const pliant_system *finest, int32_t factor, pliant_grid_level *level,
                                       pliant_grid_level *next)
{
    int32_t cells[3];
    pliant_status status = PLIANT_OK;
    for (int d = 0; d < 3; d++)
        cells[d] = level->system.graded ? finest->mesh->cells[d] : level->system.mesh->cells[d] / factor;
    if (level->system.graded) status = pliant_nested_places(level);
    return status == PLIANT_OK ? pliant_nested_elements(&level->system, cells, level, next) : status;
}

pliant_status pliant_hierarchy_create(const pliant_system *system, bool fragments, int32_t largest_direct,
                                      pliant_hierarchy **out)
{
    pliant_hierarchy *hierarchy = pliant_calloc(1, sizeof *hierarchy);
    if (!hierarchy) return pliant_fail_memory("the coarser meshes");
    pliant_status status = PLIANT_OK;
    int32_t factor;
    hierarchy->holders = hierarchy->num_levels = 1;
    hierarchy->level[0].system = *system;
    fragments = fragments && (system->graded || system->divided);
    while (status == PLIANT_OK && hierarchy->num_levels < PLIANT_MAX_LEVELS) {
        pliant_grid_level *level = hierarchy->level + hierarchy->num_levels - 1, *next = level + 1;
        const pliant_system *fine = &level->system;
        if (hierarchy->num_levels > 1 && fine->num_free <= largest_direct) break;
        factor = factor_of(fine->mesh->cells);
        if (!factor && !(fine->graded && fragments)) break;
        hierarchy->num_levels++;
        level->corners = system->macros || fragments ? 8 : 4;
        next->system.mesh = next->system.fine = &next->mesh;
        next->system.num_threads = system->num_threads;
        status =
            fragments ? next_of_fragments(system, factor, level, next) : next_of_lattice(fine, factor, level, next);
        if (status == PLIANT_OK) status = transfer(fine, level, next);
        if (status == PLIANT_OK) status = transpose(level, fine->num_free, next->system.num_free);
        if (status == PLIANT_OK) status = full_rows(fine, level);
    }
    bool layered = hierarchy->num_levels > 1;
    if (status == PLIANT_OK && layered)
        status = pliant_factor_analyze(&hierarchy->level[hierarchy->num_levels - 1].system.pattern, &hierarchy->factor);
    if (status != PLIANT_OK || !layered) {
        pliant_hierarchy_free(hierarchy);
        *out = NULL;
        return status;
    }
    *out = hierarchy;
    return PLIANT_OK;
}

double pliant_hierarchy_operations(const pliant_hierarchy *hierarchy)
{
    /* Galerkin products of 16 pairs of blocks per element (for hexahedra twice 216, and their stiffness from its root);
     * a dozen products with the matrix for its largest eigenvalue. */
    double sum = pliant_factor_operations(hierarchy->factor);
    for (int l = 0; l + 1 < hierarchy->num_levels; l++) {
        const pliant_system *system = &hierarchy->level[l].system;
        sum += (system->macros ? 3e4 : 6e3) * pliant_level_elements(system) +
               12.0 * 18 * hierarchy->level[l].row_start[system->num_free];
    }
    return sum;
}
