#include "fem/linear/carried_preconditioner.h"

#include "base/fail.h"
#include "base/buffer.h"
#include "base/memory.h"
#include "model_data/discretization.h"

#include <string.h>

void pliant_carried_free(pliant_carried *carried)
{
    if (!carried) return;
    pliant_discretization_release(carried->of);
    pliant_free(carried->source);
    pliant_subdomain_free(carried->near);
    pliant_free(carried->rest);
    pliant_free(carried->all);
    pliant_free(carried->right);
    pliant_free(carried->left);
    pliant_free(carried);
}

/* ---- Opened unknowns. */

/* Return the lattice position of a node; -1: a coarse node. */
static int32_t place_of(const pliant_system *system, int32_t node)
{
    if (system->mesh != system->fine && !system->graded) return -1;
    const int32_t fine = system->graded ? node - system->graded->coarse_nodes : node;
    return fine < 0 ? -1 : system->fine->lattice_of_node[fine];
}

/* Return the cell of the fine lattice that contains an element; -1: a coarse element. whole: out: it is a
 * hexahedron. */
static int32_t cell_of(const pliant_system *system, int32_t element, bool *whole)
{
    const pliant_graded *graded = system->graded;
    const pliant_macros *macros = system->macros;
    *whole = macros->start[element + 1] - macros->start[element] == 8;
    if (!graded) return macros->cell[element];
    const int32_t i = element - graded->num_base;
    if (i < 0 || i >= graded->num_fine) return -1;
    *whole = graded->tet[i] < 0; /* also if its corners follow other nodes */
    return system->fine->lattice_of_tet[*whole ? -1 - graded->tet[i] : graded->tet[i]] / 5;
}

static bool has_fine_cells(const pliant_system *system)
{
    return system->macros && system->macros->cell && (system->graded || system->mesh == system->fine);
}

/* Encode the elements of each cell (zeroed array): up to 3 hexahedra times HEXAHEDRON, and up to 63 tetrahedra. */
enum { HEXAHEDRON = 64 };
static void count_elements(const pliant_system *system, uint8_t *cube)
{
    for (int32_t e = 0; e < system->macros->count; e++) {
        bool whole;
        const int32_t cell = cell_of(system, e, &whole);
        if (cell < 0) continue;
        if (whole && cube[cell] / HEXAHEDRON < 3) cube[cell] = (uint8_t)(cube[cell] + HEXAHEDRON);
        if (!whole && cube[cell] % HEXAHEDRON < HEXAHEDRON - 1) cube[cell]++;
    }
}

void pliant_carried_layout_free(pliant_carried_layout *layout)
{
    pliant_free(layout->place);
    pliant_free(layout->cube);
    memset(layout, 0, sizeof *layout);
}

pliant_status pliant_carried_layout_create(const pliant_system *system, pliant_carried_layout *out)
{
    const int32_t *cells = system->fine->cells;
    const bool cubes = has_fine_cells(system);
    *out = (pliant_carried_layout){.num_free = system->num_free};
    out->place = pliant_malloc((size_t)system->num_free, sizeof *out->place);
    if (cubes) out->cube = pliant_calloc((size_t)cells[0] * (size_t)cells[1] * (size_t)cells[2], 1);
    if (!out->place || (cubes && !out->cube)) return pliant_fail_memory("the preconditioner");
    for (int32_t f = 0; f < system->num_free; f++) out->place[f] = place_of(system, system->node_of_free[f]);
    if (cubes) count_elements(system, out->cube);
    return PLIANT_OK;
}

/* Mark unknowns whose source is shared or missing. lost: out: some unknowns of the base are no source. */
static pliant_status open_copies(int32_t num_free, int32_t base_free, const int32_t *source, uint8_t *opened,
                                 bool *lost)
{
    int32_t *first = pliant_calloc((size_t)base_free, sizeof *first); /* first unknown with this source, + 1 */
    if (!first) return pliant_fail_memory("the preconditioner");
    for (int32_t f = 0; f < num_free; f++) {
        opened[f] = source[f] < 0 || first[source[f]] > 0;
        if (source[f] >= 0 && first[source[f]] > 0) opened[first[source[f]] - 1] = 1;
        else if (source[f] >= 0) first[source[f]] = f + 1;
    }
    for (int32_t b = 0; b < base_free; b++) *lost = *lost || first[b] == 0;
    pliant_free(first);
    return PLIANT_OK;
}

/* Mark unknowns where a copy of the base has gone. The remaining node then also has the copy's elements. */
static pliant_status open_closed(const pliant_system *system, const pliant_carried_layout *base, const int32_t *source,
                                 uint8_t *opened)
{
    const int32_t *cells = system->fine->cells;
    uint8_t *taken = pliant_calloc((size_t)base->num_free, 1);
    uint8_t *closed = pliant_calloc((size_t)(cells[0] + 1) * (size_t)(cells[1] + 1) * (size_t)(cells[2] + 1), 1);
    if (taken && closed) {
        for (int32_t f = 0; f < system->num_free; f++)
            if (source[f] >= 0) taken[source[f]] = 1;
        for (int32_t b = 0; b < base->num_free; b++)
            if (!taken[b] && base->place[b] >= 0) closed[base->place[b]] = 1;
        for (int32_t f = 0; f < system->num_free; f++) {
            const int32_t place = place_of(system, system->node_of_free[f]);
            opened[f] |= place >= 0 && closed[place];
        }
    }
    pliant_status status = taken && closed ? PLIANT_OK : pliant_fail_memory("the preconditioner");
    pliant_free(taken);
    pliant_free(closed);
    return status;
}

/* Mark the corners of elements in cubes whose elements differ from the base's. Tetrahedra count only if the base had a
 * hexahedron there. */
static pliant_status open_divided(const pliant_system *system, const uint8_t *cube, uint8_t *opened)
{
    const pliant_macros *macros = system->macros;
    const int32_t *cells = system->fine->cells;
    if (!cube || !has_fine_cells(system)) return PLIANT_OK;
    uint8_t *now = pliant_calloc((size_t)cells[0] * (size_t)cells[1] * (size_t)cells[2], 1);
    if (!now) return pliant_fail_memory("the preconditioner");
    count_elements(system, now);
    for (int32_t e = 0; e < macros->count; e++) {
        bool whole;
        const int32_t cell = cell_of(system, e, &whole);
        const bool other =
            cell >= 0 && cube[cell] != 0 && cube[cell] != now[cell] && (whole || cube[cell] >= HEXAHEDRON);
        for (int32_t c = macros->start[e]; other && c < macros->start[e + 1]; c++)
            if (system->free_of_node[macros->node[c]] >= 0) opened[system->free_of_node[macros->node[c]]] = 1;
    }
    pliant_free(now);
    return PLIANT_OK;
}

pliant_status pliant_carried_mark_opened(const pliant_system *system, const pliant_carried_layout *base,
                                         const int32_t *source, uint8_t *opened)
{
    bool lost = false;
    pliant_status status = open_copies(system->num_free, base->num_free, source, opened, &lost);
    if (status == PLIANT_OK && lost) status = open_closed(system, base, source, opened);
    if (status == PLIANT_OK) status = open_divided(system, base->cube, opened);
    return status;
}

pliant_status pliant_carried_correct(const pliant_system *system, const double *positions, const double *axes,
                                     pliant_carried *carried)
{
    if (carried->is_corrected) return PLIANT_OK;
    pliant_carried_layout base;
    uint8_t *opened = pliant_calloc((size_t)carried->num_free, 1);
    pliant_status status = pliant_carried_layout_create(carried->system, &base);
    if (status == PLIANT_OK)
        status = opened ? pliant_carried_mark_opened(system, &base, carried->source, opened)
                        : pliant_fail_memory("the preconditioner");
    if (status == PLIANT_OK)
        status = pliant_subdomain_create(system, opened, PLIANT_CARRIED_RINGS, positions, axes, &carried->near);
    pliant_free(opened);
    pliant_carried_layout_free(&base);
    carried->is_corrected = status == PLIANT_OK;
    return status;
}

pliant_status pliant_carried_create(const pliant_system *system, const pliant_discretization *of,
                                    const pliant_system *of_base, int32_t *source, const double *positions,
                                    const double *axes, pliant_carried **out)
{
    pliant_carried *carried = pliant_calloc(1, sizeof *carried);
    if (!carried) {
        pliant_free(source);
        return pliant_fail_memory("the preconditioner");
    }
    carried->of = pliant_discretization_retain(of);
    carried->system = of_base;
    carried->source = source;
    carried->num_free = system->num_free;
    carried->base_free = of_base->num_free;
    carried->rest = pliant_malloc((size_t)carried->num_free, 3 * sizeof *carried->rest); /* written by every solve */
    carried->all = pliant_malloc((size_t)carried->num_free, 3 * sizeof *carried->all);
    carried->right = pliant_malloc((size_t)carried->base_free, 3 * sizeof *carried->right);
    carried->left = pliant_malloc((size_t)carried->base_free, 3 * sizeof *carried->left);
    pliant_status status = PLIANT_OK;
    if (!carried->rest || !carried->all || !carried->right || !carried->left)
        status = pliant_fail_memory("the preconditioner");
    if (status == PLIANT_OK && positions) status = pliant_carried_correct(system, positions, axes, carried);
    if (status != PLIANT_OK) {
        pliant_carried_free(carried);
        return status;
    }
    *out = carried;
    return PLIANT_OK;
}

pliant_status pliant_carried_restrict(pliant_carried *carried, const double *right)
{
    const size_t n = 3 * (size_t)carried->num_free;
    pliant_status status = PLIANT_OK;
    memcpy(carried->rest, right, n * sizeof *right);
    memset(carried->all, 0, n * sizeof *carried->all);
    if (carried->near) status = pliant_subdomain_solve(carried->near, right, carried->all, carried->rest);
    if (status != PLIANT_OK) return status;
    memset(carried->right, 0, 3 * (size_t)carried->base_free * sizeof *carried->right);
    for (int32_t f = 0; f < carried->num_free; f++)
        for (int d = 0; d < 3 && carried->source[f] >= 0; d++)
            carried->right[3 * carried->source[f] + d] += carried->rest[3 * f + d];
    return PLIANT_OK;
}

pliant_status pliant_carried_extend(pliant_carried *carried, double *out)
{
    const size_t n = 3 * (size_t)carried->num_free;
    pliant_status status = PLIANT_OK;
    for (int32_t f = 0; f < carried->num_free; f++)
        for (int d = 0; d < 3; d++)
            carried->rest[3 * f + d] = carried->source[f] >= 0 ? carried->left[3 * carried->source[f] + d] : 0;
    if (carried->near) status = pliant_subdomain_extend(carried->near, carried->rest, carried->all);
    for (size_t i = 0; i < n; i++) out[i] = carried->all[i] + carried->rest[i];
    return status;
}
