/* Mesh during a subdividing cut: nodes and tetrahedra of the body, followed by the appended ones. */
#include "cut/subdivide.h"

#include "base/fail.h"
#include "base/buffer.h"
#include "base/memory.h"
#include "topology/sorted_numbers.h"

#include <stdlib.h>
#include <string.h>

static pliant_status no_memory(void) { return pliant_fail_memory("the split elements"); }

static bool grow_nodes(cut_splitting *work, int32_t capacity)
{
    const size_t count = (size_t)capacity;
    bool good = pliant_grow(&work->rest, count, 3 * sizeof *work->rest) &&
                pliant_grow(&work->positions, count, 3 * sizeof *work->positions) &&
                pliant_grow(&work->between, count, sizeof *work->between) && pliant_grow(&work->fixed, count, 1) &&
                pliant_grow(&work->on, count, 1) && pliant_grow(&work->first, count, sizeof *work->first);
    if (good) work->node_capacity = capacity;
    return good;
}

static bool grow_tets(cut_splitting *work, int32_t capacity)
{
    const size_t count = (size_t)capacity;
    bool good = pliant_grow(&work->corners, count, 4 * sizeof *work->corners) &&
                pliant_grow(&work->next, count, 4 * sizeof *work->next) &&
                pliant_grow(&work->source, count, sizeof *work->source) &&
                pliant_grow(&work->severed, count, 4 * sizeof *work->severed);
    if (good) work->tet_capacity = capacity;
    return good;
}

pliant_status pliant_split_begin(const pliant_body *body, const double *positions, const pliant_cut_sweep *sweep,
                                 const cut_strip *strip, cut_splitting *out)
{
    const pliant_mesh *fine = &body->fine;
    const size_t nodes = (size_t)fine->num_nodes, tets = (size_t)fine->num_tets;
    *out = (cut_splitting){
        .body = body, .sweep = sweep, .strip = strip, .num_nodes = fine->num_nodes, .num_tets = fine->num_tets};
    out->min_height = body->subdivision->min_height;
    out->slack = 1e-9 * body->subdivision->min_edge;
    if (!grow_nodes(out, fine->num_nodes + fine->num_nodes / 4 + 64) ||
        !grow_tets(out, fine->num_tets + fine->num_tets / 4 + 64))
        return no_memory();
    memcpy(out->rest, fine->rest, 3 * nodes * sizeof *out->rest);
    memcpy(out->positions, positions, 3 * nodes * sizeof *out->positions);
    memcpy(out->fixed, body->fine_fixed, nodes);
    memset(out->on, 0, nodes);
    memset(out->first, 0xff, nodes * sizeof *out->first);
    memset(out->severed, 0, 4 * tets * sizeof *out->severed);
    memcpy(out->corners, fine->tets, 4 * tets * sizeof *out->corners);
    for (int32_t c = 0; c < 4 * fine->num_tets; c++) {
        out->next[c] = out->first[out->corners[c]];
        out->first[out->corners[c]] = c;
        out->source[c / 4] = c / 4;
    }
    return PLIANT_OK;
}

void pliant_split_end(cut_splitting *work)
{
    PLIANT_FREE(work->rest, work->positions, work->between, work->fixed, work->on, work->first, work->corners,
                work->next, work->source, work->severed, work->around);
}

pliant_status pliant_split_add_node(cut_splitting *work, pliant_between between, uint8_t fixed)
{
    const int32_t node = work->num_nodes;
    if (node == work->node_capacity && !grow_nodes(work, 2 * node)) return no_memory();
    double *both[] = {work->rest, work->positions};
    for (int i = 0; i < 2; i++) {
        const double *a = both[i] + 3 * (size_t)between.end[0], *b = both[i] + 3 * (size_t)between.end[1];
        for (int d = 0; d < 3; d++) both[i][3 * (size_t)node + d] = a[d] + between.fraction * (b[d] - a[d]);
    }
    work->between[node] = between;
    work->fixed[node] = fixed;
    work->on[node] = 0;
    work->first[node] = -1;
    work->num_nodes++;
    return PLIANT_OK;
}

static void link_corner(cut_splitting *work, int32_t corner)
{
    int32_t *first = work->first + work->corners[corner];
    work->next[corner] = *first;
    *first = corner;
}

pliant_status pliant_split_add_tet(cut_splitting *work, const int32_t nodes[4], int32_t source)
{
    const int32_t tet = work->num_tets;
    if (tet == work->tet_capacity && !grow_tets(work, 2 * tet)) return no_memory();
    work->source[tet] = source;
    memset(work->severed + 4 * (size_t)tet, 0, 4 * sizeof *work->severed);
    memcpy(work->corners + 4 * (size_t)tet, nodes, 4 * sizeof *nodes);
    for (int v = 0; v < 4; v++) link_corner(work, 4 * tet + v);
    work->num_tets++;
    return PLIANT_OK;
}

void pliant_split_set_corner(cut_splitting *work, int32_t tet, int corner, int32_t node)
{
    const int32_t at = 4 * tet + corner;
    int32_t *from = work->first + work->corners[at];
    while (*from != at) from = work->next + *from;
    *from = work->next[at];
    work->corners[at] = node;
    link_corner(work, at);
}

pliant_status pliant_split_around(cut_splitting *work, int32_t node)
{
    work->num_around = 0;
    for (int32_t at = work->first[node]; at >= 0; at = work->next[at]) {
        if (!pliant_reserve(&work->around, &work->around_capacity, work->num_around, 64, sizeof *work->around))
            return no_memory();
        work->around[work->num_around++] = at;
    }
    qsort(work->around, (size_t)work->num_around, sizeof *work->around, by_number);
    return PLIANT_OK;
}
