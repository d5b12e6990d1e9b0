/* Regions of a cut: connected nodes of the touched cells, or whole components without fixed nodes. */
#include "fem/dynamics/tled_regions.h"

#include "base/fail.h"
#include "topology/sorted_numbers.h"
#include "base/memory.h"

#include <math.h>

static const double rounding = 1e-12; /* relative, of masses with equal summands */

static void mark_nodes(pliant_cut_regions *work, const pliant_mesh *mesh)
{
    for (int32_t t = 0; t < mesh->num_tets; t++)
        for (int v = 0; v < 4 && work->cell[pliant_cell_of_tet(mesh, t)]; v++)
            work->near[mesh->tets[4 * (size_t)t + v]] = 1;
}

/* Join the marked nodes with the region of `first`, which may be -1. Return a node of the region. */
static int32_t join_marked(int32_t *part, const int32_t *node, int count, int32_t first)
{
    for (int v = 0; v < count; v++) {
        if (part[node[v]] < 0) continue;
        if (first >= 0) pliant_set_join(part, first, node[v]);
        first = node[v];
    }
    return first;
}

void pliant_cut_join_elements(int32_t *part, const pliant_tled_system *system)
{
    for (int32_t i = 0; i < pliant_tled_element_count(system); i++) {
        int corners;
        const int32_t *node = pliant_tled_element_nodes(system, pliant_tled_element(system, i), &corners);
        join_marked(part, node, corners, -1);
    }
}

/* Join the corners of fragments with the corners of their original tetrahedra. */
static void join_fragments(int32_t *part, const pliant_body *before, const pliant_body *body)
{
    const pliant_body_changes *changes = &body->changes;
    for (int32_t i = 0; i < changes->num_touched + body->fine.num_tets - changes->tets_before; i++) {
        const int32_t more = i - changes->num_touched;
        const int32_t tet = more < 0 ? changes->touched[i] : changes->tets_before + more,
                      source = more < 0 ? tet : changes->tet_source[more];
        const int32_t first = join_marked(part, before->fine.tets + 4 * (size_t)source, 4, -1);
        join_marked(part, body->fine.tets + 4 * (size_t)tet, 4, first);
    }
}

static bool has_chip(const pliant_cuts *cuts, const int32_t chip[2])
{
    for (int32_t c = 0; cuts && c < cuts->num_chips; c++)
        if (cuts->chip[2 * c] == chip[0] && cuts->chip[2 * c + 1] == chip[1]) return true;
    return false;
}

/* Store the change of each region's mass in force, and its mass in step, at the region's first node. */
static void find_masses(pliant_cut_regions *work)
{
    for (int32_t n = 0; n < work->now.tled->system->mesh->num_nodes; n++) {
        if (work->part[n] < 0) continue;
        const int32_t first = pliant_set_root(work->part, n);
        const double now = work->now.tled->system->node_mass[n];
        work->force[first] +=
            now - (n < work->was.tled->system->mesh->num_nodes ? work->was.tled->system->node_mass[n] : 0);
        work->step[first] += now;
    }
}

/* Return a node of the region of a tetrahedron whose mass has changed, or -1. */
static int32_t changed_region(const pliant_cut_regions *work, const int32_t *node)
{
    for (int v = 0; v < 4; v++) {
        if (work->part[node[v]] < 0) continue;
        const int32_t first = pliant_set_root(work->part, node[v]);
        if (fabs(work->force[first]) > rounding * work->step[first]) return first;
    }
    return -1;
}

/* Join regions with changed masses. Detached voxels that the cut assigns to another tetrahedron move their mass to
 * it. */
static void join_chips(pliant_cut_regions *work, const pliant_cuts *cuts, const pliant_cuts *other,
                       const pliant_mesh *mesh)
{
    for (int32_t c = 0; cuts && c < cuts->num_chips; c++) {
        const int32_t *chip = cuts->chip + 2 * (size_t)c;
        if (has_chip(other, chip)) continue;
        const int32_t source = changed_region(work, mesh->tets + 4 * (size_t)chip[0]),
                      carrier = changed_region(work, mesh->tets + 4 * (size_t)chip[1]);
        if (source >= 0 && carrier >= 0) pliant_set_join(work->part, source, carrier);
    }
}

/* Return whether free components are possible. */
static bool may_be_free(const pliant_body *before, const pliant_body *body)
{
    bool held = false;
    for (int32_t n = 0; n < body->fine.num_nodes && !held; n++) held = body->fine_fixed[n] != PLIANT_MOVES;
    return !held || before->pieces || body->pieces || body->falls || body->num_held_pieces > 0;
}

/* Join the nodes of each free component to one region. held: (nodes after the cut) zeroed. */
static void join_free(pliant_cut_regions *work, uint8_t *held)
{
    const int32_t nodes = work->now.tled->system->mesh->num_nodes;
    for (int32_t n = 0; n < nodes; n++) {
        work->component[n] = pliant_set_root(work->component, n);
        if (!pliant_cut_node_is_free(work->now.tled, n)) held[work->component[n]] |= 1;
        if (work->near[n]) held[work->component[n]] |= 2;
    }
    for (int32_t n = 0; n < nodes; n++) {
        if (held[work->component[n]] != 2) continue;
        if (work->part[n] < 0) work->part[n] = n;
        pliant_set_join(work->part, work->component[n], n); /* the first node was visited before */
    }
}

static void number_regions(pliant_cut_regions *work)
{
    /* Roots are first nodes, so they are numbered before the others. */
    for (int32_t n = 0; n < work->now.tled->system->mesh->num_nodes; n++)
        if (work->part[n] >= 0) work->part[n] = pliant_set_root(work->part, n);
    for (int32_t n = work->now.tled->system->mesh->num_nodes - 1; n >= 0; n--)
        if (work->part[n] == n) work->count++;
    int32_t number = 0;
    for (int32_t n = 0; n < work->now.tled->system->mesh->num_nodes; n++)
        if (work->part[n] >= 0) work->part[n] = work->part[n] == n ? number++ : work->part[work->part[n]];
}

/* Return the region of an element with a node of a touched cell. */
static int32_t region_of_element(const pliant_cut_regions *work, const pliant_tled_system *system, int32_t index)
{
    int corners;
    const int32_t *node = pliant_tled_element_nodes(system, pliant_tled_element(system, index), &corners);
    for (int v = 0; v < corners; v++)
        if (work->near[node[v]]) return work->part[node[v]];
    return -1;
}

/* Convert counts at [region + 2] to starts at [region + 1], which filling increments to the ends. start: (count +
 * 1). */
static void sum_starts(int32_t *start, int32_t count)
{
    for (int32_t r = 0; r < count; r++) start[r + 2] += start[r + 1];
}

static pliant_status list_regions(pliant_cut_regions *work)
{
    const pliant_tled_system *system = work->now.tled->system;
    const int32_t nodes = system->mesh->num_nodes, elements = pliant_tled_element_count(system);
    const size_t count = (size_t)work->count;
    work->node_start = pliant_calloc(count + 2, sizeof *work->node_start);
    work->element_start = pliant_calloc(count + 2, sizeof *work->element_start);
    work->gained = pliant_calloc(count + 1, sizeof *work->gained);
    work->scale = pliant_calloc(count + 1, sizeof *work->scale);
    work->free = pliant_calloc(count + 1, 1);
    if (!work->node_start || !work->element_start || !work->gained || !work->scale || !work->free)
        return pliant_fail_memory("the elements that a cut does not change");
    for (int32_t n = 0; n < nodes; n++)
        if (work->part[n] >= 0) work->node_start[work->part[n] + 2]++;
    for (int32_t i = 0; i < elements; i++) {
        const int32_t region = region_of_element(work, system, i);
        if (region >= 0) work->element_start[region + 2]++;
    }
    sum_starts(work->node_start, work->count);
    sum_starts(work->element_start, work->count);
    work->node = pliant_calloc((size_t)work->node_start[work->count + 1] + 1, sizeof *work->node);
    work->element = pliant_calloc((size_t)work->element_start[work->count + 1] + 1, sizeof *work->element);
    if (!work->node || !work->element) return pliant_fail_memory("the elements that a cut does not change");
    for (int32_t n = 0; n < nodes; n++)
        if (work->part[n] >= 0) work->node[work->node_start[work->part[n] + 1]++] = n;
    for (int32_t i = 0; i < elements; i++) {
        const int32_t region = region_of_element(work, system, i);
        if (region >= 0) work->element[work->element_start[region + 1]++] = pliant_tled_element(system, i);
    }
    return PLIANT_OK;
}

static pliant_status allocate(pliant_cut_regions *work, const pliant_body *body)
{
    const size_t nodes = (size_t)body->fine.num_nodes;
    work->cell = pliant_calloc(pliant_count_cells(&body->fine), 1);
    work->near = pliant_calloc(nodes, 1);
    work->part = pliant_calloc(nodes, sizeof *work->part);
    work->component = pliant_calloc(nodes, sizeof *work->component);
    work->force = pliant_calloc(nodes, 3 * sizeof *work->force);
    work->step = pliant_calloc(nodes, 3 * sizeof *work->step);
    return work->cell && work->near && work->part && work->component && work->force && work->step
               ? PLIANT_OK
               : pliant_fail_memory("the elements that a cut does not change");
}

pliant_status pliant_cut_regions_find(pliant_cut_regions *work, const pliant_body *before, const pliant_body *body)
{
    const pliant_body_changes *changes = &body->changes;
    const int32_t nodes = body->fine.num_nodes;
    pliant_status status = allocate(work, body);
    uint8_t *held = status == PLIANT_OK ? pliant_calloc((size_t)nodes, 1) : NULL;
    if (status == PLIANT_OK && !held) status = pliant_fail_memory("the elements that a cut does not change");
    if (status != PLIANT_OK) return status;
    for (int32_t i = 0; i < changes->num_touched; i++)
        work->cell[pliant_cell_of_tet(&body->fine, changes->touched[i])] = 1;
    for (int32_t t = changes->tets_before; t < body->fine.num_tets; t++)
        work->cell[pliant_cell_of_tet(&body->fine, t)] = 1;
    mark_nodes(work, &before->fine);
    mark_nodes(work, &body->fine);
    for (int32_t n = 0; n < nodes; n++) {
        work->part[n] = work->near[n] ? n : -1;
        work->component[n] = n;
    }
    const bool may_fall = may_be_free(before, body);
    for (int k = 0; k < (may_fall ? 2 : 1); k++) {
        int32_t *part = k ? work->component : work->part;
        pliant_cut_join_elements(part, work->was.tled->system);
        pliant_cut_join_elements(part, work->now.tled->system);
        join_fragments(part, before, body);
    }
    find_masses(work);
    join_chips(work, before->cuts, body->cuts, &body->fine);
    join_chips(work, body->cuts, before->cuts, &body->fine);
    if (may_fall) join_free(work, held);
    number_regions(work);
    status = list_regions(work);
    for (int32_t n = 0; status == PLIANT_OK && n < nodes; n++)
        if (work->part[n] >= 0 && held[work->component[n]] == 2) work->free[work->part[n]] = 1;
    pliant_free(held);
    return status;
}

void pliant_cut_regions_free(pliant_cut_regions *work)
{
    void *blocks[] = {work->cell,  work->near,          work->part,    work->component, work->node_start,
                      work->node,  work->element_start, work->element, work->free,      work->gained,
                      work->scale, work->force,         work->step};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
}
