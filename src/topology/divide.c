/* Build the next body from the result of a cut of the fine mesh. */
#include "topology/divide.h"
#include "topology/links.h"

#include "base/fail.h"
#include "base/buffer.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <string.h>

void pliant_body_masses(const pliant_body *body, double *mass)
{
    const pliant_mesh *fine = &body->fine;
    memset(mass, 0, (size_t)fine->num_nodes * sizeof *mass);
    for (int32_t t = 0; t < fine->num_tets; t++) {
        const int32_t *nodes = fine->tets + 4 * t;
        double gradients[12];
        double volume = pliant_mesh_gradients(fine, t, gradients);
        for (int v = 0; v < 4; v++) mass[nodes[v]] += 0.25 * volume * body->fine_material[t].density;
    }
}

static int32_t source_of_tet(const pliant_body *body, const pliant_division *division, int32_t tet)
{
    return tet < body->fine.num_tets ? tet : division->tet_source[tet - body->fine.num_tets];
}

/* Return the number of tetrahedra that a division lists. */
static int32_t count_rows(const pliant_body *body, const pliant_division *division)
{
    return division->changed ? division->num_changed + division->num_tets - body->fine.num_tets : division->num_tets;
}

static int32_t tet_of_row(const pliant_body *body, const pliant_division *division, int32_t row)
{
    if (!division->changed) return row;
    return row < division->num_changed ? division->changed[row] : body->fine.num_tets + row - division->num_changed;
}

/* Return the number of nodes of the next body; 0 after an error. */
static int32_t count_nodes(const pliant_body *body, const pliant_division *division)
{
    int32_t tets = body->fine.num_tets, nodes = body->fine.num_nodes;
    if (division->num_tets < tets || (division->num_tets > tets && (!division->tet_source || !division->material))) {
        pliant_fail(PLIANT_ERROR_ARGUMENT,
                    "a division of %d tetrahedra into %d: fragments need their sources and materials", tets,
                    division->num_tets);
        return 0;
    }
    for (int32_t t = tets; t < division->num_tets; t++)
        if (source_of_tet(body, division, t) < 0 || source_of_tet(body, division, t) >= tets) {
            pliant_fail(PLIANT_ERROR_ARGUMENT, "fragment %d is of tetrahedron %d of %d", t,
                        source_of_tet(body, division, t), tets);
            return 0;
        }
    for (int32_t c = 0; c < division->num_changed; c++)
        if (division->changed[c] < 0 || division->changed[c] >= tets ||
            (c > 0 && division->changed[c] <= division->changed[c - 1])) {
            pliant_fail(PLIANT_ERROR_ARGUMENT, "tetrahedra that a division changes must ascend, within %d: %d does not",
                        tets, division->changed[c]);
            return 0;
        }
    for (int32_t v = 0; v < 4 * count_rows(body, division); v++) {
        if (division->corners[v] < 0 || division->corners[v] >= body->fine.num_nodes + 4 * division->num_tets) {
            pliant_fail(PLIANT_ERROR_ARGUMENT, "tetrahedron %d of a division names node %d",
                        tet_of_row(body, division, v / 4), division->corners[v]);
            return 0;
        }
        if (division->corners[v] >= nodes) nodes = division->corners[v] + 1;
    }
    return nodes;
}

/* Find the nearer end of the edge of each appended node. */
static pliant_status find_nearest(const pliant_body *body, const pliant_division *division, int32_t nodes,
                                  int32_t *source)
{
    for (int32_t v = 0; v < 4 * division->num_tets; v++) source[division->corners[v]] = division->corners[v];
    for (int32_t n = body->fine.num_nodes; n < nodes; n++) {
        const pliant_between *between = division->between + (n - body->fine.num_nodes);
        bool good = source[n] >= 0 && between->fraction >= 0 && between->fraction <= 1;
        for (int end = 0; end < 2; end++) good = good && between->end[end] >= 0 && between->end[end] < n;
        if (!good)
            return pliant_fail(PLIANT_ERROR_ARGUMENT,
                               "node %d of a division lies between none that are there, or has no corner", n);
        source[n] = between->end[between->fraction > 0.5];
    }
    return PLIANT_OK;
}

/* Find the source node of each node. The node of every corner is the previous node or a copy of it, and every node has
 * a corner.
 * source: output, (nodes of the next body) */
static pliant_status find_sources(const pliant_body *body, const pliant_division *division, int32_t nodes,
                                  int32_t *source)
{
    memset(source, 0xff, (size_t)nodes * sizeof *source);
    if (division->between) return find_nearest(body, division, nodes, source);
    for (int32_t v = 0; v < 4 * count_rows(body, division); v++) {
        int32_t node = division->corners[v],
                was = body->fine.tets[4 * source_of_tet(body, division, tet_of_row(body, division, v / 4)) + v % 4];
        if ((source[node] >= 0 && source[node] != was) || (node < body->fine.num_nodes && node != was))
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "node %d of a division is at the corners of two nodes, %d and %d",
                               node, was, node < body->fine.num_nodes ? node : source[node]);
        source[node] = was;
    }
    /* tetrahedra that are not listed keep their nodes */
    for (int32_t n = division->changed ? body->fine.num_nodes : 0; n < nodes; n++)
        if (source[n] < 0) return pliant_fail(PLIANT_ERROR_ARGUMENT, "node %d of a division has no corner", n);
    return PLIANT_OK;
}

static pliant_status append_tets(pliant_body *next, const pliant_division *division)
{
    pliant_mesh *fine = &next->fine;
    int32_t before = fine->num_tets, appended = division->num_tets - before;
    const int32_t *of = division->tet_source;
    pliant_status status = pliant_body_append_parents(&next->tet_parent, before, appended, of);
    if (status == PLIANT_OK) status = pliant_body_append(&fine->tets, 4 * sizeof *fine->tets, before, appended, of);
    if (status == PLIANT_OK)
        status = pliant_body_append(&fine->lattice_of_tet, sizeof *fine->lattice_of_tet, before, appended, of);
    if (status == PLIANT_OK)
        status = pliant_body_append(&next->fine_material, sizeof *next->fine_material, before, appended, of);
    if (status == PLIANT_OK)
        status = pliant_body_append(&next->coarse_of_fine, sizeof *next->coarse_of_fine, before, appended, of);
    if (status != PLIANT_OK || appended == 0) return status;
    fine->num_tets = division->num_tets;
    if (!(next->changes.tet_source = pliant_calloc((size_t)appended, sizeof *of)))
        return pliant_fail_memory("the next body");
    memcpy(next->changes.tet_source, of, (size_t)appended * sizeof *of);
    return PLIANT_OK;
}

static bool differs(const pliant_body *body, const pliant_body *next, int32_t tet)
{
    return memcmp(body->fine.tets + 4 * (size_t)tet, next->fine.tets + 4 * (size_t)tet, 4 * sizeof *body->fine.tets) !=
               0 ||
           memcmp(body->fine_material + tet, next->fine_material + tet, sizeof *body->fine_material) != 0;
}

/* List the tetrahedra of the previous body that have other corners, another material or other voxels.
 * all: consider every tetrahedron; false: only the tetrahedra in the division's list */
static pliant_status list_touched(const pliant_body *body, const pliant_division *division, bool all, pliant_body *next)
{
    const int32_t tets = body->fine.num_tets, maximum = division->num_touched + (all ? tets : division->num_changed);
    int32_t *touched = pliant_calloc((size_t)maximum + 1, sizeof *touched), count = 0;
    if (!touched) return pliant_fail_memory("the next body");
    for (int32_t i = 0; i < division->num_touched; i++) touched[count++] = division->touched[i];
    for (int32_t i = 0; i < maximum - division->num_touched; i++) {
        const int32_t tet = all ? i : division->changed[i];
        if (differs(body, next, tet)) touched[count++] = tet;
    }
    count = sort_once(touched, count);
    if (count > 0 && !(next->changes.touched = pliant_copy_block(touched, (size_t)count, sizeof *touched))) {
        pliant_free(touched);
        return pliant_fail_memory("the next body");
    }
    next->changes.num_touched = count;
    pliant_free(touched);
    return PLIANT_OK;
}

/* ---- recompute the masses of nodes of changed tetrahedra; the order of each sum is the same as for the whole body */

static double share_of_mass(const pliant_body *body, int32_t tet)
{
    double gradients[12];
    return 0.25 * pliant_mesh_gradients(&body->fine, tet, gradients) * body->fine_material[tet].density;
}

/* List the nodes of touched tetrahedra before and after the cut, ascending. Return their number; -1: out of memory. */
static int32_t list_nodes(const pliant_body *body, const pliant_body *next, int32_t **list)
{
    const pliant_body_changes *changes = &next->changes;
    const int32_t appended = next->fine.num_tets - body->fine.num_tets;
    int32_t *nodes = *list = pliant_calloc(8 * ((size_t)changes->num_touched + (size_t)appended) + 1, sizeof *nodes),
            count = 0;
    for (int32_t i = 0; nodes && i < changes->num_touched + appended; i++) {
        const int32_t t =
            i < changes->num_touched ? changes->touched[i] : body->fine.num_tets + i - changes->num_touched;
        for (int v = 0; v < 4; v++) {
            nodes[count++] = next->fine.tets[4 * (size_t)t + v];
            if (t < body->fine.num_tets) nodes[count++] = body->fine.tets[4 * (size_t)t + v];
        }
    }
    return nodes ? sort_once(nodes, count) : -1;
}

/* Recompute the mass of a node from the fragments of voxels around it. The initial tetrahedra around the node give the
 * candidates. */
static pliant_status renew_mass(const pliant_body *next, const pliant_cuts *cuts, int32_t node, int32_t **buffer,
                                int32_t *buffer_size)
{
    const pliant_voxels *voxels = next->voxels;
    const int32_t load = next->node_parent ? next->node_parent[node] : node;
    int32_t count = 0;
    for (int32_t a = voxels->around_start[load]; a < voxels->around_start[load + 1]; a++) {
        const int32_t tet = voxels->around[a] / 4, corner = voxels->around[a] % 4;
        const int32_t *fragment, fragments = pliant_fragments_of(cuts, &tet, &fragment);
        if (count + fragments > *buffer_size) {
            int32_t *longer = pliant_resize(*buffer, 2 * (size_t)(count + fragments), sizeof *longer);
            if (!longer) return pliant_fail_memory("the next body");
            *buffer = longer;
            *buffer_size = 2 * (count + fragments);
        }
        for (int32_t f = 0; f < fragments; f++)
            if (next->fine.tets[4 * (size_t)fragment[f] + corner] == node) (*buffer)[count++] = fragment[f];
    }
    count = sort_once(*buffer, count);
    next->node_mass[node] = 0;
    for (int32_t i = 0; i < count; i++) next->node_mass[node] += share_of_mass(next, (*buffer)[i]);
    pliant_mark_written(next->node_mass, (size_t)node, 1, sizeof *next->node_mass);
    return PLIANT_OK;
}

static pliant_status renew_masses(const pliant_body *body, const pliant_cuts *cuts, pliant_body *next)
{
    const pliant_mesh *fine = &next->fine;
    int32_t *nodes, *buffer = NULL, buffer_size = 0;
    const int32_t count = list_nodes(body, next, &nodes);
    pliant_status status = count < 0 ? pliant_fail_memory("the next body") : PLIANT_OK;
    if (cuts && next->voxels) {
        for (int32_t i = 0; i < count && status == PLIANT_OK; i++)
            status = renew_mass(next, cuts, nodes[i], &buffer, &buffer_size);
    } else if (count > 0) {
        uint8_t *changed = pliant_calloc((size_t)fine->num_nodes, 1);
        if (!changed) status = pliant_fail_memory("the next body");
        for (int32_t i = 0; changed && i < count; i++) {
            changed[nodes[i]] = 1;
            next->node_mass[nodes[i]] = 0;
            pliant_mark_written(next->node_mass, (size_t)nodes[i], 1, sizeof *next->node_mass);
        }
        for (int32_t v = 0; changed && v < 4 * fine->num_tets; v++)
            if (changed[fine->tets[v]]) next->node_mass[fine->tets[v]] += share_of_mass(next, v / 4);
        pliant_free(changed);
    }
    pliant_free(nodes);
    pliant_free(buffer);
    return status;
}

/* Set the rest positions of appended nodes on their edges. */
static void place_nodes(const pliant_division *division, int32_t before, pliant_body *next)
{
    double *rest = next->fine.rest;
    for (int32_t n = before; n < next->fine.num_nodes; n++) {
        const pliant_between *between = next->subdivision->between + (n - next->subdivision->load_nodes);
        next->subdivision->between[n - next->subdivision->load_nodes] = division->between[n - before];
        const double *a = rest + 3 * (size_t)between->end[0], *b = rest + 3 * (size_t)between->end[1];
        for (int d = 0; d < 3; d++) rest[3 * (size_t)n + (size_t)d] = a[d] + between->fraction * (b[d] - a[d]);
    }
}

static pliant_status divide(const pliant_body *body, const pliant_division *division, int32_t nodes,
                            const int32_t *source, pliant_body *next)
{
    const int32_t before = next->fine.num_nodes;
    pliant_status status = pliant_body_append_nodes(next, nodes - before, source + before);
    if (status == PLIANT_OK && division->copy_fixed && nodes > before)
        memcpy(next->fine_fixed + before, division->copy_fixed, (size_t)(nodes - before));
    if (status == PLIANT_OK) status = append_tets(next, division);
    if (status != PLIANT_OK) return status;
    if (division->between) place_nodes(division, before, next);
    for (int32_t r = 0; r < count_rows(body, division); r++) {
        const int32_t tet = tet_of_row(body, division, r);
        memcpy(next->fine.tets + 4 * (size_t)tet, division->corners + 4 * (size_t)r, 4 * sizeof *division->corners);
        pliant_mark_written(next->fine.tets, 4 * (size_t)tet, 4, sizeof *division->corners);
        if (!division->material) continue;
        next->fine_material[tet] = division->material[r];
        pliant_mark_written(next->fine_material, (size_t)tet, 1, sizeof *division->material);
    }
    body_faces other = {false, 0, 0, NULL};
    const bool pieces = body->pieces || !division->same_pieces;
    bool copies = false; /* whether detached pieces may have received copies of nodes */
    status = list_touched(body, division, !division->changed, next);
    if (status == PLIANT_OK) status = pliant_body_find_across(body, division->cuts, next, &other);
    if (status == PLIANT_OK && pieces) status = pliant_body_find_pieces(next, division, &copies);
    if (status == PLIANT_OK && copies) {
        pliant_free(next->changes.touched);
        next->changes.touched = NULL;
        status = list_touched(body, division, true, next);
    }
    if (status == PLIANT_OK) status = renew_masses(body, division->cuts, next);
    if (status == PLIANT_OK) status = pliant_body_find_surface(body, next, &other);
    pliant_free(other.face);
    return status;
}

pliant_status pliant_body_divide(const pliant_body *body, uint64_t revision, const pliant_division *division,
                                 pliant_body **out)
{
    pliant_body *next = NULL;
    int32_t nodes = count_nodes(body, division), *source = NULL;
    if (nodes == 0) return PLIANT_ERROR_ARGUMENT;
    if (!(source = pliant_calloc((size_t)nodes, sizeof *source))) return pliant_fail_memory("the next body");
    pliant_status status = find_sources(body, division, nodes, source);
    if (status == PLIANT_OK) status = pliant_body_begin(body, revision, !division->cuts, &next);
    if (status == PLIANT_OK) status = divide(body, division, nodes, source, next);
    pliant_free(source);
    if (status != PLIANT_OK) {
        pliant_body_release(next);
        return status;
    }
    if (division->cuts) next->cuts = division->cuts;
    *out = next;
    return PLIANT_OK;
}
