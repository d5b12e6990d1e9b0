/* Groups of elements with one pressure (tled_pressure.h): their corners, and the pattern of S. */
#include "base/buffer.h"
#include "base/fail.h"
#include "base/memory.h"
#include "fem/dynamics/tled_cubes.h"
#include "fem/dynamics/tled_pressure.h"
#include "fem/element/pressures.h"
#include "mesh/mesh.h"

#include <math.h>
#include <string.h>

/* ---- Materials. */

bool pliant_tled_has_pressures(const pliant_tled_system *system, const pliant_body *body,
                               const pliant_tled_system *before)
{
    if (before) return before->groups != NULL;
    if (system->quasi_static || system->nodal_pressure || system->law == PLIANT_LAW_SAINT_VENANT_KIRCHHOFF)
        return false;
    for (int32_t t = 0; t < body->fine.num_tets; t++) {
        const pliant_tet_material *material = body->fine_material + t;
        if (material->tissue > 0 && material->lambda > PLIANT_PRESSURE_RATIO * material->mu) return true;
    }
    return false;
}

double pliant_tled_soft_lambda(const pliant_tet_material *material)
{
    return material->tissue > 0 ? fmin(material->lambda, PLIANT_SOFT_RATIO * material->mu) : material->lambda;
}

pliant_status pliant_tled_groups_create(const pliant_body *body, pliant_tled_groups **out)
{
    const int32_t tets = body->fine.num_tets;
    pliant_tled_groups *groups = *out = pliant_calloc(1, sizeof *groups);
    if (!groups) return pliant_fail_memory("the pressures");
    groups->soft = pliant_copy_block(body->fine_material, (size_t)tets, sizeof *groups->soft);
    if (!groups->soft) return pliant_fail_memory("the pressures");
    for (int32_t t = 0; t < tets; t++) groups->soft[t].lambda = pliant_tled_soft_lambda(body->fine_material + t);
    return PLIANT_OK;
}

void pliant_tled_groups_free(pliant_tled_groups *groups)
{
    if (!groups) return;
    PLIANT_FREE(groups->soft, groups->volume, groups->compliance, groups->cell, groups->cube, groups->of_cube,
                groups->tet_start, groups->tet_corner, groups->corner_start, groups->node, groups->group,
                groups->node_start, groups->node_corner, groups->column_start, groups->row, groups);
}

/* ---- Elements of the groups. */

/* A tetrahedron or hexahedron. missing: V lambda' [N m]. */
typedef struct element {
    int32_t group, cell;
    double volume, missing;
} element;

/* Number the groups: hexahedra first, then tetrahedra, which share the group of their whole cell. cell_group: Nullable:
 * (cells) scratch, all -1. */
static void number_groups(const pliant_tled_system *system, const uint8_t *whole, int32_t *cell_group, int32_t count,
                          element *of, pliant_tled_groups *groups)
{
    for (int32_t c = 0; system->cubes && c < system->cubes->count; c++) groups->of_cube[c] = -1;
    for (int32_t e = 0; e < count; e++) {
        const int32_t index = pliant_tled_element(system, e);
        const bool shares = index >= 0 && cell_group && whole[of[e].cell];
        of[e].group = -1;
        if (!(of[e].missing > 0)) continue;
        const int32_t g = shares && cell_group[of[e].cell] >= 0 ? cell_group[of[e].cell] : groups->count++;
        of[e].group = g;
        if (shares) cell_group[of[e].cell] = g;
        groups->cell[g] = of[e].cell;
        groups->cube[g] = index < 0 ? ~index : -1;
        if (index < 0) groups->of_cube[~index] = g;
        groups->volume[g] += of[e].volume;
        groups->compliance[g] += of[e].missing; /* sums of V lambda' */
        groups->tet_start[g + 1] += index >= 0;
    }
    for (int32_t g = 0; g < groups->count; g++) {
        groups->compliance[g] = groups->volume[g] * groups->volume[g] / groups->compliance[g];
        groups->tet_start[g + 1] += groups->tet_start[g];
    }
}

static void measure_element(const pliant_tled_system *system, const pliant_tet_material *material,
                            const pliant_tet_material *soft, int32_t index, element *out)
{
    const pliant_mesh *mesh = system->mesh;
    const int32_t tet = index < 0 ? system->cubes->cube[~index].tet[0] : index;
    const bool has_cells = mesh->lattice_of_tet || (mesh->leaf_of_cell && mesh->lattice_of_node);
    out->cell = has_cells ? pliant_cell_of_tet(mesh, tet) : -1;
    if (index < 0) {
        const pliant_cube *cube = system->cubes->cube + ~index;
        double volume[5], gradients[12];
        for (int slot = 0; slot < 5; slot++) {
            volume[slot] = pliant_mesh_gradients(mesh, cube->tet[slot], gradients);
            out->volume += volume[slot];
        }
        out->missing = out->volume * pliant_cube_missing_lambda(cube, volume, soft, material);
    } else {
        double gradients[12];
        out->volume = pliant_mesh_gradients(mesh, tet, gradients);
        out->missing = out->volume * (material[tet].lambda - soft[tet].lambda);
    }
}

/* List the corners of every group. filled, last: (groups), (num_nodes) scratch, all 0 and all -1. */
static void list_corners(const pliant_tled_system *system, int32_t count, const element *of, int32_t *filled,
                         int32_t *last, pliant_tled_groups *groups)
{
    const pliant_mesh *mesh = system->mesh;
    for (int32_t e = 0; e < count; e++) { /* nodes at first */
        const int32_t g = of[e].group, tet = pliant_tled_element(system, e);
        if (g >= 0 && tet >= 0)
            memcpy(groups->tet_corner + 4 * (size_t)(groups->tet_start[g] + filled[g]++), mesh->tets + 4 * (size_t)tet,
                   4 * sizeof *mesh->tets);
    }
    for (int32_t g = 0; g < groups->count; g++) {
        const int32_t first = groups->corner_start[g] = groups->num_corners;
        for (int v = 0; groups->cube[g] >= 0 && v < 8; v++)
            groups->node[groups->num_corners++] = system->cubes->cube[groups->cube[g]].node[v];
        for (int32_t i = 4 * groups->tet_start[g]; i < 4 * groups->tet_start[g + 1]; i++) {
            const int32_t node = groups->tet_corner[i];
            if (last[node] < first) {
                last[node] = groups->num_corners;
                groups->node[groups->num_corners++] = node;
            }
            groups->tet_corner[i] = last[node] - first;
        }
        for (int32_t c = first; c < groups->num_corners; c++) groups->group[c] = g;
    }
    groups->corner_start[groups->count] = groups->num_corners;
    for (int32_t c = 0; c < groups->num_corners; c++) groups->node_start[groups->node[c] + 1]++;
    for (int32_t n = 0; n < mesh->num_nodes; n++) groups->node_start[n + 1] += groups->node_start[n];
    for (int32_t c = 0; c < groups->num_corners; c++) groups->node_corner[groups->node_start[groups->node[c]]++] = c;
    for (int32_t n = mesh->num_nodes; n > 0; n--) groups->node_start[n] = groups->node_start[n - 1];
    groups->node_start[0] = 0;
}

/* ---- Pattern of S. */

/* List the groups from g on that share a node that can move with it, ascending. seen: (count). Return their number. */
static int32_t find_neighbours(const pliant_tled_system *system, const pliant_tled_groups *groups, int32_t g,
                               int32_t *seen, int *out)
{
    int32_t count = 0;
    seen[g] = g;
    if (out) out[count] = g;
    count++;
    for (int32_t c = groups->corner_start[g]; c < groups->corner_start[g + 1]; c++) {
        const int32_t n = groups->node[c];
        for (int32_t i = groups->node_start[n]; system->inverse_mass[n] > 0 && i < groups->node_start[n + 1]; i++) {
            const int32_t other = groups->group[groups->node_corner[i]];
            if (other <= g || seen[other] == g) continue;
            seen[other] = g;
            int32_t at = count++;
            for (; out && at > 0 && out[at - 1] > other; at--) out[at] = out[at - 1];
            if (out) out[at] = other;
        }
    }
    return count;
}

/* Errors: MEMORY, SCENE. */
static pliant_status find_pattern(const pliant_tled_system *system, pliant_tled_groups *groups)
{
    int32_t *seen = pliant_malloc((size_t)groups->count, sizeof *seen);
    double number = 0;
    groups->column_start = pliant_calloc((size_t)groups->count + 1, sizeof *groups->column_start);
    if (!seen || !groups->column_start) {
        pliant_free(seen);
        return pliant_fail_memory("the pressures");
    }
    for (int32_t g = 0; g < groups->count; g++) seen[g] = -1;
    for (int32_t g = 0; g < groups->count && number < INT32_MAX; g++) {
        number += find_neighbours(system, groups, g, seen, NULL);
        groups->column_start[g + 1] = number < INT32_MAX ? (int)number : 0;
    }
    for (int32_t g = 0; g < groups->count; g++) seen[g] = -1;
    pliant_status status = number < INT32_MAX ? PLIANT_OK
                                              : pliant_fail(PLIANT_ERROR_SCENE,
                                                            "%d elements are too many for tled with Poisson's ratios "
                                                            "above 0.49; use fewer mesh/coarse_cells",
                                                            groups->count);
    if (status == PLIANT_OK && !(groups->row = pliant_malloc((size_t)number, sizeof *groups->row)))
        status = pliant_fail_memory("the pressures");
    for (int32_t g = 0; status == PLIANT_OK && g < groups->count; g++)
        find_neighbours(system, groups, g, seen, groups->row + groups->column_start[g]);
    pliant_free(seen);
    return status;
}

/* ---- Creation. */

static bool allocate(const pliant_tled_system *system, size_t elements, pliant_tled_groups *groups)
{
    const size_t tets = system->cubes ? (size_t)system->cubes->num_tets : elements, cubes = elements - tets,
                 corners = 4 * tets + 8 * cubes + 1;
    return (groups->volume = pliant_calloc(elements, sizeof *groups->volume)) &&
           (groups->compliance = pliant_calloc(elements, sizeof *groups->compliance)) &&
           (groups->cell = pliant_calloc(elements, sizeof *groups->cell)) &&
           (groups->cube = pliant_calloc(elements, sizeof *groups->cube)) &&
           (groups->of_cube = pliant_calloc(cubes + 1, sizeof *groups->of_cube)) &&
           (groups->tet_start = pliant_calloc(elements + 1, sizeof *groups->tet_start)) &&
           (groups->tet_corner = pliant_calloc(4 * tets + 1, sizeof *groups->tet_corner)) &&
           (groups->corner_start = pliant_calloc(elements + 1, sizeof *groups->corner_start)) &&
           (groups->node = pliant_calloc(corners, sizeof *groups->node)) &&
           (groups->group = pliant_calloc(corners, sizeof *groups->group)) &&
           (groups->node_start = pliant_calloc((size_t)system->mesh->num_nodes + 1, sizeof *groups->node_start)) &&
           (groups->node_corner = pliant_calloc(corners, sizeof *groups->node_corner));
}

static int32_t *all_minus_one(size_t count)
{
    int32_t *out = pliant_malloc(count + 1, sizeof *out);
    for (size_t i = 0; out && i < count; i++) out[i] = -1;
    return out;
}

pliant_status pliant_tled_groups_find(const pliant_tled_system *system, const pliant_tet_material *material,
                                      pliant_tled_groups *groups)
{
    const pliant_mesh *mesh = system->mesh;
    const int32_t count = pliant_tled_element_count(system);
    const bool has_cells = mesh->lattice_of_tet || (mesh->leaf_of_cell && mesh->lattice_of_node);
    element *of = pliant_calloc((size_t)count, sizeof *of);
    int32_t *cell_group = has_cells ? all_minus_one(pliant_count_cells(mesh)) : NULL,
            *last = all_minus_one((size_t)mesh->num_nodes), *filled = pliant_calloc((size_t)count, sizeof *filled);
    uint8_t *whole = NULL;
    pliant_status status = of && (cell_group || !has_cells) && last && filled && allocate(system, (size_t)count, groups)
                               ? PLIANT_OK
                               : pliant_fail_memory("the pressures");
    if (status == PLIANT_OK && has_cells) status = pliant_find_whole_cells(mesh, &whole);
    if (status == PLIANT_OK) {
        for (int32_t e = 0; e < count; e++)
            measure_element(system, material, groups->soft, pliant_tled_element(system, e), of + e);
        number_groups(system, whole, cell_group, count, of, groups);
        list_corners(system, count, of, filled, last, groups);
        status = find_pattern(system, groups);
    }
    PLIANT_FREE(of, cell_group, last, filled, whole);
    return status;
}
