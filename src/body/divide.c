/* The next body, of what a cut makes of the fine mesh. */
#include "body/divide.h"

#include "base/fail.h"
#include "mesh/faces.h"
#include "pliant/memory.h"

#include <string.h>

pliant_status pliant_body_append(void *list, size_t size, int32_t count, int32_t appended, const int32_t *source)
{
    char *old;
    memcpy(&old, list, sizeof old);
    if (!old || appended == 0) return PLIANT_OK;
    char *made = pliant_resize(old, (size_t)count + (size_t)appended, size);
    if (!made) return pliant_fail_memory("the next body");
    for (int32_t i = 0; i < appended; i++) memcpy(made + size * (size_t)(count + i), made + size * (size_t)source[i], size);
    memcpy(list, &made, sizeof made);
    return PLIANT_OK;
}

pliant_status pliant_body_append_parents(int32_t **parent, int32_t count, int32_t appended, const int32_t *source)
{
    if (appended == 0) return PLIANT_OK;
    if (!*parent) {
        if (!(*parent = pliant_calloc((size_t)count, sizeof **parent))) return pliant_fail_memory("the next body");
        for (int32_t i = 0; i < count; i++) (*parent)[i] = i;
    }
    return pliant_body_append(parent, sizeof **parent, count, appended, source);
}

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

/* how many nodes there are afterwards; 0: something is wrong, and said */
static int32_t count_nodes(const pliant_body *body, const pliant_division *division)
{
    int32_t tets = body->fine.num_tets, nodes = body->fine.num_nodes;
    if (division->num_tets < tets || (division->num_tets > tets && (!division->tet_source || !division->material))) {
        pliant_fail(PLIANT_ERROR_ARGUMENT, "a division of %d tetrahedra into %d: fragments need their sources and materials", tets,
                    division->num_tets);
        return 0;
    }
    for (int32_t t = tets; t < division->num_tets; t++)
        if (source_of_tet(body, division, t) < 0 || source_of_tet(body, division, t) >= tets) {
            pliant_fail(PLIANT_ERROR_ARGUMENT, "fragment %d is of tetrahedron %d of %d", t, source_of_tet(body, division, t), tets);
            return 0;
        }
    for (int32_t v = 0; v < 4 * division->num_tets; v++) {
        if (division->corners[v] < 0 || division->corners[v] >= body->fine.num_nodes + 4 * division->num_tets) {
            pliant_fail(PLIANT_ERROR_ARGUMENT, "tetrahedron %d of a division names node %d", v / 4, division->corners[v]);
            return 0;
        }
        if (division->corners[v] >= nodes) nodes = division->corners[v] + 1;
    }
    return nodes;
}

/* of nodes on edges, the nearer end */
static pliant_status find_nearest(const pliant_body *body, const pliant_division *division, int32_t nodes, int32_t *source)
{
    for (int32_t v = 0; v < 4 * division->num_tets; v++) source[division->corners[v]] = division->corners[v];
    for (int32_t n = body->fine.num_nodes; n < nodes; n++) {
        const pliant_between *between = division->between + (n - body->fine.num_nodes);
        bool good = source[n] >= 0 && between->share >= 0 && between->share <= 1;
        for (int end = 0; end < 2; end++) good = good && between->end[end] >= 0 && between->end[end] < n;
        if (!good) return pliant_fail(PLIANT_ERROR_ARGUMENT, "node %d of a division lies between none that are there, or has no corner", n);
        source[n] = between->end[between->share > 0.5];
    }
    return PLIANT_OK;
}

/* source: (nodes afterwards) zeroed room. Every corner's node is the one that was there or a copy of it; none is left out. */
static pliant_status find_sources(const pliant_body *body, const pliant_division *division, int32_t nodes, int32_t *source)
{
    memset(source, 0xff, (size_t)nodes * sizeof *source);
    if (division->between) return find_nearest(body, division, nodes, source);
    for (int32_t v = 0; v < 4 * division->num_tets; v++) {
        int32_t node = division->corners[v], was = body->fine.tets[4 * source_of_tet(body, division, v / 4) + v % 4];
        if ((source[node] >= 0 && source[node] != was) || (node < body->fine.num_nodes && node != was))
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "node %d of a division is at the corners of two nodes, %d and %d", node, was,
                               node < body->fine.num_nodes ? node : source[node]);
        source[node] = was;
    }
    for (int32_t n = 0; n < nodes; n++)
        if (source[n] < 0) return pliant_fail(PLIANT_ERROR_ARGUMENT, "node %d of a division has no corner", n);
    return PLIANT_OK;
}

pliant_status pliant_body_append_nodes(pliant_body *next, int32_t appended, const int32_t *source)
{
    pliant_mesh *fine = &next->fine;
    pliant_body_changes *changes = &next->changes;
    int32_t before = fine->num_nodes, *sources = NULL;
    pliant_status status = pliant_body_append_parents(&next->node_parent, before, appended, source);
    if (status == PLIANT_OK) status = pliant_body_append(&fine->rest, 3 * sizeof *fine->rest, before, appended, source);
    if (status == PLIANT_OK) status = pliant_body_append(&fine->lattice_of_node, sizeof *fine->lattice_of_node, before, appended, source);
    if (status == PLIANT_OK) status = pliant_body_append(&fine->place_of_node, sizeof *fine->place_of_node, before, appended, source);
    if (status == PLIANT_OK) status = pliant_body_append(&next->fine_fixed, sizeof *next->fine_fixed, before, appended, source);
    if (status == PLIANT_OK) status = pliant_body_append(&next->node_mass, sizeof *next->node_mass, before, appended, source);
    if (status == PLIANT_OK && next->subdivision) status = pliant_subdivision_append(next->subdivision, before, appended, source);
    if (status != PLIANT_OK || appended == 0) return status;
    const int32_t already = before - changes->nodes_before;
    if (!(sources = pliant_resize(changes->node_source, (size_t)(already + appended), sizeof *sources))) return pliant_fail_memory("the next body");
    changes->node_source = sources;
    for (int32_t n = 0; n < appended; n++) sources[already + n] = source[n] < changes->nodes_before ? source[n] : sources[source[n] - changes->nodes_before];
    fine->num_nodes = before + appended;
    return PLIANT_OK;
}

static pliant_status append_tets(pliant_body *next, const pliant_division *division)
{
    pliant_mesh *fine = &next->fine;
    int32_t before = fine->num_tets, appended = division->num_tets - before;
    const int32_t *of = division->tet_source;
    pliant_status status = pliant_body_append_parents(&next->tet_parent, before, appended, of);
    if (status == PLIANT_OK) status = pliant_body_append(&fine->tets, 4 * sizeof *fine->tets, before, appended, of);
    if (status == PLIANT_OK) status = pliant_body_append(&fine->lattice_of_tet, sizeof *fine->lattice_of_tet, before, appended, of);
    if (status == PLIANT_OK) status = pliant_body_append(&next->fine_material, sizeof *next->fine_material, before, appended, of);
    if (status == PLIANT_OK) status = pliant_body_append(&next->coarse_of_fine, sizeof *next->coarse_of_fine, before, appended, of);
    if (status != PLIANT_OK || appended == 0) return status;
    fine->num_tets = division->num_tets;
    if (!(next->changes.tet_source = pliant_calloc((size_t)appended, sizeof *of))) return pliant_fail_memory("the next body");
    memcpy(next->changes.tet_source, of, (size_t)appended * sizeof *of);
    return PLIANT_OK;
}

/* tetrahedra of the body before that have other corners or another material, or other voxels */
static pliant_status list_touched(const pliant_body *body, const pliant_division *division, pliant_body *next)
{
    int32_t tets = body->fine.num_tets, count = 0;
    uint8_t *touched = pliant_calloc((size_t)tets, 1);
    if (!touched) return pliant_fail_memory("the next body");
    for (int32_t i = 0; i < division->num_touched; i++) touched[division->touched[i]] = 1;
    for (int32_t t = 0; t < tets; t++) {
        touched[t] = touched[t] || memcmp(body->fine.tets + 4 * t, next->fine.tets + 4 * t, 4 * sizeof *body->fine.tets) != 0 ||
                     memcmp(body->fine_material + t, next->fine_material + t, sizeof *body->fine_material) != 0;
        count += touched[t];
    }
    if (count > 0) next->changes.touched = pliant_calloc((size_t)count, sizeof *next->changes.touched);
    bool good = count == 0 || next->changes.touched;
    for (int32_t t = 0; good && t < tets; t++)
        if (touched[t]) next->changes.touched[next->changes.num_touched++] = t;
    pliant_free(touched);
    return good ? PLIANT_OK : pliant_fail_memory("the next body");
}

/* Masses at the nodes of what changed, anew; each the sum in the same order as if all were. */
static pliant_status renew_masses(const pliant_body *body, pliant_body *next)
{
    const pliant_mesh *fine = &next->fine;
    uint8_t *changed = pliant_calloc((size_t)fine->num_nodes, 1);
    if (!changed) return pliant_fail_memory("the next body");
    for (int32_t i = 0; i < next->changes.num_touched + fine->num_tets - body->fine.num_tets; i++) {
        const int32_t t = i < next->changes.num_touched ? next->changes.touched[i] : body->fine.num_tets + i - next->changes.num_touched;
        for (int v = 0; v < 4; v++) {
            changed[fine->tets[4 * (size_t)t + v]] = 1;
            if (t < body->fine.num_tets) changed[body->fine.tets[4 * (size_t)t + v]] = 1;
        }
    }
    for (int32_t n = 0; n < fine->num_nodes; n++)
        if (changed[n]) next->node_mass[n] = 0;
    for (int32_t t = 0; t < fine->num_tets; t++) {
        const int32_t *nodes = fine->tets + 4 * (size_t)t;
        if (!(changed[nodes[0]] | changed[nodes[1]] | changed[nodes[2]] | changed[nodes[3]])) continue;
        double gradients[12];
        const double volume = pliant_mesh_gradients(fine, t, gradients);
        for (int v = 0; v < 4; v++)
            if (changed[nodes[v]]) next->node_mass[nodes[v]] += 0.25 * volume * next->fine_material[t].density;
    }
    pliant_free(changed);
    return PLIANT_OK;
}

/* appended nodes to where they lie on their edges */
static void place_nodes(const pliant_division *division, int32_t before, pliant_body *next)
{
    double *rest = next->fine.rest;
    for (int32_t n = before; n < next->fine.num_nodes; n++) {
        const pliant_between *between = next->subdivision->between + (n - next->subdivision->load_nodes);
        next->subdivision->between[n - next->subdivision->load_nodes] = division->between[n - before];
        const double *a = rest + 3 * (size_t)between->end[0], *b = rest + 3 * (size_t)between->end[1];
        for (int d = 0; d < 3; d++) rest[3 * (size_t)n + (size_t)d] = a[d] + between->share * (b[d] - a[d]);
    }
}

static pliant_status divide(const pliant_body *body, const pliant_division *division, int32_t nodes, const int32_t *source, pliant_body *next)
{
    const int32_t before = next->fine.num_nodes;
    pliant_status status = pliant_body_append_nodes(next, nodes - before, source + before);
    if (status == PLIANT_OK && division->copy_fixed && nodes > before) memcpy(next->fine_fixed + before, division->copy_fixed, (size_t)(nodes - before));
    if (status == PLIANT_OK) status = append_tets(next, division);
    if (status != PLIANT_OK) return status;
    if (division->between) place_nodes(division, before, next);
    memcpy(next->fine.tets, division->corners, 4 * (size_t)division->num_tets * sizeof *division->corners);
    if (division->material) memcpy(next->fine_material, division->material, (size_t)division->num_tets * sizeof *division->material);
    status = pliant_body_find_across(body, division->cuts, next);
    if (status == PLIANT_OK && !(division->same_pieces && !body->pieces)) status = pliant_body_find_pieces(next, division);
    if (status == PLIANT_OK) status = list_touched(body, division, next);
    if (status == PLIANT_OK) status = renew_masses(body, next);
    if (status != PLIANT_OK) return status;
    status = pliant_mesh_surface_of(&next->fine, next->across, &next->triangles, &next->num_triangles);
    return status == PLIANT_OK && next->coarse.num_tets > 0 ? pliant_body_nest(body, next) : status;
}

pliant_status pliant_body_divide(const pliant_body *body, uint64_t revision, const pliant_division *division, pliant_body **out)
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
