/* How the coarse mesh follows when the fine one is divided. Its tetrahedra fall into fragments: the fine tetrahedra of one that no longer hang
 * together by faces within it. Their corners stay one node where fragments still hang together by fine faces. What did not hang together
 * before stays as it was: no cut changes nothing. The first part of everything keeps its number, the others are appended as copies. */
#include "body/parts.h"
#include "body/divide.h"

#include "base/fail.h"
#include "pliant/memory.h"

#include <stdlib.h>
#include <string.h>

enum { ENDS = 1, FRAGMENT = 2 }; /* a cut ends in it; it is not all that the tetrahedron at load was */

typedef struct nesting {
    const pliant_body *before;
    pliant_body *next;
    const int32_t *across[2]; /* (fine tetrahedra x 4) neighbours before and after */
    int32_t *at_load;       /* of a body that does not know them */
    int32_t *part[2];       /* (fine tetrahedra) that hang together within their coarse one, before and after */
    int32_t *corner[2];     /* (coarse tetrahedra x 4, with copies) that are one node by fine faces, before and after */
    int32_t *own[2];        /* (coarse tetrahedra x 4, with copies) the fine node at a corner, among a fragment's own; -1: none */
    uint8_t *cut[2];        /* (coarse tetrahedra, with copies) ENDS, FRAGMENT */
    uint8_t *touched;       /* (coarse tetrahedra before) */
    int32_t *tet_source, *node_source; /* (copies) */
    int32_t num_tets, num_nodes;       /* with copies */
} nesting;

static const pliant_mesh *fine_of(const nesting *work, int when) { return when ? &work->next->fine : &work->before->fine; }

/* what a fine tetrahedron is a fragment of, in the body before */
static int32_t source_of(const nesting *work, int32_t tet)
{
    int32_t before = work->before->fine.num_tets;
    return tet < before ? tet : work->next->changes.tet_source[tet - before];
}

static void mark(nesting *work)
{
    const pliant_body_changes *changes = &work->next->changes;
    for (int32_t i = 0; i < changes->num_touched; i++) work->touched[work->before->coarse_of_fine[changes->touched[i]]] = 1;
    for (int32_t t = work->before->fine.num_tets; t < work->next->fine.num_tets; t++)
        work->touched[work->before->coarse_of_fine[source_of(work, t)]] = 1;
}

static void find_parts(nesting *work, int when)
{
    const int32_t *coarse = work->next->coarse_of_fine; /* as before, still */
    int32_t *part = work->part[when], tets = fine_of(work, when)->num_tets;
    for (int32_t t = 0; t < tets; t++) part[t] = t;
    for (int32_t f = 0; f < 4 * tets; f++) {
        int32_t other = work->across[when][f];
        if (other >= 0 && coarse[other] == coarse[f / 4]) join(part, f / 4, other);
    }
    for (int32_t t = 0; t < tets; t++) part[t] = first_of(part, t);
}

/* Fragments: of every part before, the part after with its first tetrahedron stays, others are copies. keeper, copy: (fine tetrahedra) room */
static void divide_tets(nesting *work, int32_t *keeper, int32_t *copy)
{
    pliant_body *next = work->next;
    int32_t tets = next->fine.num_tets, coarse = next->coarse.num_tets;
    memset(keeper, 0xff, (size_t)tets * sizeof *keeper);
    memset(copy, 0xff, (size_t)tets * sizeof *copy);
    work->num_tets = coarse;
    for (int32_t t = 0; t < tets; t++) {
        int32_t was = work->part[0][source_of(work, t)], is = work->part[1][t], owner = next->coarse_of_fine[t];
        if (!work->touched[owner]) continue;
        if (keeper[was] < 0) keeper[was] = is;
        if (keeper[was] == is) continue;
        if (copy[is] < 0) {
            work->tet_source[work->num_tets - coarse] = owner;
            copy[is] = work->num_tets++;
        }
    }
    for (int32_t t = 0; t < tets; t++)
        if (copy[work->part[1][t]] >= 0) next->coarse_of_fine[t] = copy[work->part[1][t]];
}

/* the coarse tetrahedron that one was before */
static int32_t coarse_source(const nesting *work, int32_t tet)
{
    return tet < work->before->coarse.num_tets ? tet : work->tet_source[tet - work->before->coarse.num_tets];
}

/* A fine node with copies, in a coarse tetrahedron. */
typedef struct copied {
    int32_t tet, at, node;
} copied;

static int by_place(const void *a, const void *b)
{
    const copied *i = a, *j = b;
    if (i->tet != j->tet) return i->tet < j->tet ? -1 : 1;
    if (i->at != j->at) return i->at < j->at ? -1 : 1;
    return i->node < j->node ? -1 : i->node > j->node;
}

static const int32_t *owners_of(const nesting *work, int when) { return when ? work->next->coarse_of_fine : work->before->coarse_of_fine; }

static int32_t count_tets(const nesting *work, int when) { return when ? work->num_tets : work->before->coarse.num_tets; }

/* The fine node at each corner: where a tetrahedron has two of them, the one with more voxels around. */
static void find_own(nesting *work, int when, double *around)
{
    const pliant_mesh *fine = fine_of(work, when), *coarse = &work->before->coarse;
    const pliant_tet_material *material = when ? work->next->fine_material : work->before->fine_material;
    for (int32_t v = 0; v < 4 * fine->num_tets; v++) around[fine->tets[v]] += material[v / 4].num_voxels;
    for (int32_t v = 0; v < 4 * fine->num_tets; v++) {
        const int32_t node = fine->tets[v], owner = owners_of(work, when)[v / 4], *corners = coarse->tets + 4 * coarse_source(work, owner);
        for (int c = 0; c < 4; c++) {
            int32_t *own = work->own[when] + 4 * owner + c;
            if (fine->lattice_of_node[node] != pliant_mesh_lattice_in(fine, coarse, corners[c])) continue;
            if (*own < 0 || around[node] > around[*own] || (around[node] == around[*own] && node < *own)) *own = node;
        }
    }
}

/* A cut ends in tetrahedra that hold two nodes at one place. nodes_at: (places of the fine lattice) 0; list: (corners of fine tetrahedra) room */
static void find_ends(nesting *work, int when, int32_t *nodes_at, copied *list)
{
    const pliant_mesh *fine = fine_of(work, when);
    int32_t count = 0;
    for (int32_t n = 0; n < fine->num_nodes; n++)
        if (fine->lattice_of_node[n] >= 0) nodes_at[fine->lattice_of_node[n]]++;
    for (int32_t v = 0; v < 4 * fine->num_tets; v++) {
        const int32_t at = fine->lattice_of_node[fine->tets[v]];
        if (at >= 0 && nodes_at[at] > 1) list[count++] = (copied){owners_of(work, when)[v / 4], at, fine->tets[v]};
    }
    qsort(list, (size_t)count, sizeof *list, by_place);
    for (int32_t i = 1; i < count; i++)
        if (list[i].tet == list[i - 1].tet && list[i].at == list[i - 1].at && list[i].node != list[i - 1].node) work->cut[when][list[i].tet] |= ENDS;
}

static int32_t at_load(const nesting *work, int32_t tet)
{
    const int32_t source = coarse_source(work, tet), *parent = work->before->coarse_tet_parent;
    return parent ? parent[source] : source;
}

/* family: (coarse tetrahedra) 0 */
static void find_fragments(nesting *work, int when, int32_t *family)
{
    for (int32_t c = 0; c < count_tets(work, when); c++) family[at_load(work, c)]++;
    for (int32_t c = 0; c < count_tets(work, when); c++)
        if (family[at_load(work, c)] > 1) work->cut[when][c] |= FRAGMENT;
}

static pliant_status find_cut(nesting *work, int when)
{
    const pliant_mesh *fine = fine_of(work, when);
    if (work->next->cuts_open == PLIANT_CUTS_CLOSED) return PLIANT_OK;
    const size_t places = ((size_t)fine->cells[0] + 1) * ((size_t)fine->cells[1] + 1) * ((size_t)fine->cells[2] + 1);
    int32_t *nodes_at = pliant_calloc(places, sizeof *nodes_at), *family = pliant_calloc((size_t)work->num_tets, sizeof *family);
    double *around = pliant_calloc((size_t)fine->num_nodes, sizeof *around);
    copied *list = pliant_calloc(4 * (size_t)fine->num_tets, sizeof *list);
    const bool good = nodes_at && family && around && list;
    if (good) {
        find_own(work, when, around);
        find_ends(work, when, nodes_at, list);
        find_fragments(work, when, family);
    }
    pliant_free(nodes_at);
    pliant_free(family);
    pliant_free(around);
    pliant_free(list);
    return good ? PLIANT_OK : pliant_fail_memory("the next body");
}

/* where two tetrahedra have a corner of the lattice together */
static bool same_corner(const nesting *work, int32_t a, int v, int32_t b, int w)
{
    const pliant_mesh *coarse = &work->before->coarse;
    const int32_t *tets = coarse->tets, *at = coarse->lattice_of_node;
    return at[tets[4 * coarse_source(work, a) + v]] == at[tets[4 * coarse_source(work, b) + w]];
}

/* Two tetrahedra with a fine face between them: all corners that they have together, or only those where both have one fine node. Returns how many
 * are one then. */
static int join_two(nesting *work, int when, int32_t a, int32_t b, bool all)
{
    int32_t *corner = work->corner[when], *own = work->own[when];
    int common = 0;
    for (int v = 0; v < 4; v++)
        for (int w = 0; w < 4; w++) {
            if (!same_corner(work, a, v, b, w)) continue;
            if (all || (own[4 * a + v] >= 0 && own[4 * a + v] == own[4 * b + w])) join(corner, 4 * a + v, 4 * b + w);
            common += first_of(corner, 4 * a + v) == first_of(corner, 4 * b + w);
        }
    return common;
}

/* a corner of the lattice that both have, with fine nodes of their own */
static bool parts_at_corner(const nesting *work, int when, int32_t a, int32_t b)
{
    const int32_t *own = work->own[when];
    for (int v = 0; work->next->cuts_open == PLIANT_CUTS_TIED && v < 4; v++)
        for (int w = 0; w < 4; w++)
            if (same_corner(work, a, v, b, w) && own[4 * a + v] >= 0 && own[4 * b + w] >= 0 && own[4 * a + v] != own[4 * b + w]) return true;
    return false;
}

/* Corners of coarse tetrahedra that fine faces make one. In front of a cut's end a fragment has some beyond the cut: they hang on fragments of its own
 * side alone, so that the tetrahedra in which the cut ends may open. What would hang by an edge then is joined as a whole. part: (coarse
 * tetrahedra) room */
static void join_corners(nesting *work, int when, int32_t *part)
{
    const int32_t *coarse = owners_of(work, when), count = count_tets(work, when);
    const uint8_t *cut = work->cut[when];
    for (int32_t v = 0; v < 4 * count; v++) work->corner[when][v] = v;
    for (int32_t c = 0; c < count; c++) part[c] = c;
    const int passes = work->next->cuts_open == PLIANT_CUTS_TIED ? 1 : 3; /* ties hold what hangs by less (fem/coarse/ties.c) */
    for (int pass = 0; pass < passes; pass++) /* beside the cut's end: as they are, which hang by a face, the others as a whole */
        for (int32_t f = 0; f < 4 * fine_of(work, when)->num_tets; f++) {
            const int32_t other = work->across[when][f], a = coarse[f / 4];
            if (other < 0 || coarse[other] <= a) continue; /* from one side is enough */
            const int32_t b = coarse[other];
            const bool open = ((cut[a] | cut[b]) & ENDS) || (cut[a] & FRAGMENT) != (cut[b] & FRAGMENT) || parts_at_corner(work, when, a, b);
            if (pass > 0 && (!open || first_of(part, a) == first_of(part, b))) continue;
            if (join_two(work, when, a, b, !open || pass == 2) > 2 && (!open || pass > 0)) join(part, a, b);
        }
    for (int32_t v = 0; v < 4 * count; v++) work->corner[when][v] = first_of(work->corner[when], v);
}

/* The same for nodes: of the corners that were one before, those with the first one keep the node; corners of tetrahedra that a cut ended in come
 * last, since they may go to another one. keeper, node: (coarse corners) room */
static void divide_nodes(nesting *work, int32_t *keeper, int32_t *node, int32_t *corners)
{
    const pliant_mesh *coarse = &work->before->coarse;
    memset(keeper, 0xff, 4 * (size_t)work->num_tets * sizeof *keeper);
    memset(node, 0xff, 4 * (size_t)work->num_tets * sizeof *node);
    work->num_nodes = coarse->num_nodes;
    for (int ended = 0; ended <= ENDS; ended += ENDS)
        for (int32_t v = 0; v < 4 * work->num_tets; v++) {
            const int32_t tet = coarse_source(work, v / 4), old = 4 * tet + v % 4, was = work->corner[0][old], is = work->corner[1][v];
            if ((work->cut[0][tet] & ENDS) != ended || keeper[was] >= 0 || node[is] >= 0) continue;
            keeper[was] = is;
            node[is] = coarse->tets[old];
        }
    for (int32_t v = 0; v < 4 * work->num_tets; v++) {
        const int32_t old = 4 * coarse_source(work, v / 4) + v % 4, is = work->corner[1][v];
        if (node[is] < 0) {
            work->node_source[work->num_nodes - coarse->num_nodes] = coarse->tets[old];
            node[is] = work->num_nodes++;
        }
        corners[v] = node[is];
    }
}

static pliant_status keep_sources(const int32_t *source, int32_t count, int32_t **out)
{
    if (count == 0) return PLIANT_OK;
    if (!(*out = pliant_calloc((size_t)count, sizeof **out))) return pliant_fail_memory("the next body");
    memcpy(*out, source, (size_t)count * sizeof **out);
    return PLIANT_OK;
}

static pliant_status append(nesting *work, const int32_t *corners)
{
    pliant_body *next = work->next;
    pliant_mesh *coarse = &next->coarse;
    int32_t nodes = coarse->num_nodes, tets = coarse->num_tets, new_nodes = work->num_nodes - nodes, new_tets = work->num_tets - tets;
    pliant_status status = pliant_body_append_parents(&next->coarse_node_parent, nodes, new_nodes, work->node_source);
    if (status == PLIANT_OK) status = pliant_body_append_parents(&next->coarse_tet_parent, tets, new_tets, work->tet_source);
    if (status == PLIANT_OK) status = pliant_body_append(&coarse->rest, 3 * sizeof *coarse->rest, nodes, new_nodes, work->node_source);
    if (status == PLIANT_OK)
        status = pliant_body_append(&coarse->lattice_of_node, sizeof *coarse->lattice_of_node, nodes, new_nodes, work->node_source);
    if (status == PLIANT_OK) status = pliant_body_append(&next->coarse_fixed, sizeof *next->coarse_fixed, nodes, new_nodes, work->node_source);
    if (status == PLIANT_OK) status = pliant_body_append(&next->fine_of_coarse, sizeof *next->fine_of_coarse, nodes, new_nodes, work->node_source);
    if (status == PLIANT_OK) status = pliant_body_append(&coarse->tets, 4 * sizeof *coarse->tets, tets, new_tets, work->tet_source);
    if (status == PLIANT_OK) status = pliant_body_append(&coarse->lattice_of_tet, sizeof *coarse->lattice_of_tet, tets, new_tets, work->tet_source);
    if (status == PLIANT_OK) status = pliant_body_append(&next->coarse_material, sizeof *next->coarse_material, tets, new_tets, work->tet_source);
    if (status == PLIANT_OK) status = keep_sources(work->node_source, new_nodes, &next->changes.coarse_node_source);
    if (status == PLIANT_OK) status = keep_sources(work->tet_source, new_tets, &next->changes.coarse_tet_source);
    if (status != PLIANT_OK) return status;
    coarse->num_nodes = work->num_nodes;
    coarse->num_tets = work->num_tets;
    memcpy(coarse->tets, corners, 4 * (size_t)work->num_tets * sizeof *corners);
    return PLIANT_OK;
}

/* The fine node at the place of every coarse one, of those within its own tetrahedra; the first of them. */
static void place_nodes(pliant_body *next)
{
    const pliant_mesh *fine = &next->fine, *coarse = &next->coarse;
    memset(next->fine_of_coarse, 0xff, (size_t)coarse->num_nodes * sizeof *next->fine_of_coarse);
    for (int32_t v = 0; v < 4 * fine->num_tets; v++) {
        const int32_t *corners = coarse->tets + 4 * next->coarse_of_fine[v / 4];
        int32_t node = fine->tets[v], at = fine->lattice_of_node[node];
        for (int c = 0; c < 4; c++) {
            if (at != pliant_mesh_lattice_in(fine, coarse, corners[c])) continue;
            int32_t *first = next->fine_of_coarse + corners[c];
            if (*first < 0 || node < *first) *first = node;
        }
    }
}

/* A coarse node of which every fine tetrahedron around it was held where it is stays there, too. */
static pliant_status hold_copies(pliant_body *next)
{
    uint8_t *moves = pliant_calloc((size_t)next->coarse.num_nodes, 1), *held = pliant_calloc((size_t)next->coarse.num_nodes, 1);
    bool good = moves && held;
    for (int32_t n = 0; good && n < next->coarse.num_nodes; n++) held[n] = 1; /* no tetrahedron has it any more */
    for (int32_t v = 0; good && v < 4 * next->coarse.num_tets; v++) held[next->coarse.tets[v]] = 0;
    for (int32_t t = 0; good && t < next->fine.num_tets; t++) {
        const int32_t *nodes = next->fine.tets + 4 * t, *corners = next->coarse.tets + 4 * next->coarse_of_fine[t];
        bool fixed = true, came_off = false;
        for (int v = 0; v < 4; v++) {
            fixed = fixed && next->fine_fixed[nodes[v]] != PLIANT_MOVES;
            came_off = came_off || next->fine_fixed[nodes[v]] == PLIANT_FIXED_WHERE_IT_WAS;
        }
        for (int v = 0; v < 4; v++) {
            if (!fixed) moves[corners[v]] = 1;
            if (came_off) held[corners[v]] = 1;
        }
    }
    for (int32_t n = 0; good && n < next->coarse.num_nodes; n++)
        if (held[n] && !moves[n]) next->coarse_fixed[n] = PLIANT_FIXED_WHERE_IT_WAS;
    pliant_free(moves);
    pliant_free(held);
    return good ? PLIANT_OK : pliant_fail_memory("the next body");
}

/* Stiffness and mass of a fragment are of its share of the voxels (the coarse method). before: the tetrahedron's own material */
static pliant_status share_material(const nesting *work)
{
    pliant_body *next = work->next;
    if (!next->coarse_material) return PLIANT_OK;
    double *own = pliant_calloc((size_t)work->num_tets, sizeof *own), *all = pliant_calloc((size_t)work->before->coarse.num_tets, sizeof *all);
    bool good = own && all;
    for (int32_t t = 0; good && t < work->before->fine.num_tets; t++)
        all[work->before->coarse_of_fine[t]] += work->before->fine_material[t].num_voxels;
    for (int32_t t = 0; good && t < next->fine.num_tets; t++) own[next->coarse_of_fine[t]] += next->fine_material[t].num_voxels;
    for (int32_t t = 0; good && t < work->num_tets; t++) {
        double whole = all[coarse_source(work, t)];
        if (own[t] == whole || !(whole > 0)) continue;
        next->coarse_material[t].lambda *= own[t] / whole;
        next->coarse_material[t].mu *= own[t] / whole;
        next->coarse_material[t].density *= own[t] / whole;
    }
    pliant_free(own);
    pliant_free(all);
    return good ? PLIANT_OK : pliant_fail_memory("the next body");
}

static pliant_status list_touched(const nesting *work)
{
    pliant_body_changes *changes = &work->next->changes;
    int32_t count = 0;
    for (int32_t t = 0; t < work->before->coarse.num_tets; t++) count += work->touched[t];
    if (count == 0) return PLIANT_OK;
    if (!(changes->touched_coarse = pliant_calloc((size_t)count, sizeof *changes->touched_coarse))) return pliant_fail_memory("the next body");
    for (int32_t t = 0; t < work->before->coarse.num_tets; t++)
        if (work->touched[t]) changes->touched_coarse[changes->num_touched_coarse++] = t;
    return PLIANT_OK;
}

static pliant_status nest(nesting *work, int32_t *room[3])
{
    pliant_status status = PLIANT_OK;
    if (!work->before->across) {
        if (!(work->at_load = pliant_calloc((size_t)work->before->fine.num_tets, 4 * sizeof *work->at_load))) return pliant_fail_memory("the next body");
        status = pliant_mesh_neighbours(&work->before->fine, work->at_load);
    }
    if (status != PLIANT_OK) return status;
    work->across[0] = work->before->across ? work->before->across : work->at_load;
    work->across[1] = work->next->across;
    mark(work);
    for (int when = 0; when < 2; when++) find_parts(work, when);
    divide_tets(work, room[0], room[1]);
    for (int when = 0; when < 2 && status == PLIANT_OK; when++) status = find_cut(work, when);
    if (status != PLIANT_OK) return status;
    for (int when = 0; when < 2; when++) join_corners(work, when, room[0]);
    divide_nodes(work, room[0], room[1], room[2]);
    status = append(work, room[2]);
    if (status == PLIANT_OK) status = share_material(work);
    if (status == PLIANT_OK) status = list_touched(work);
    if (status != PLIANT_OK) return status;
    place_nodes(work->next);
    return hold_copies(work->next);
}

pliant_status pliant_body_nest(const pliant_body *before, pliant_body *next)
{
    nesting work = {.before = before, .next = next};
    /* no more copies than fine tetrahedra */
    size_t fine = (size_t)next->fine.num_tets, coarse = (size_t)before->coarse.num_tets, corners = 4 * (coarse + fine);
    int32_t *room[3] = {NULL};
    bool good = (work.touched = pliant_calloc(coarse, 1)) && (work.tet_source = pliant_calloc(fine, sizeof *work.tet_source)) &&
                (work.node_source = pliant_calloc(corners, sizeof *work.node_source));
    for (int when = 0; when < 2; when++)
        good = good && (work.part[when] = pliant_calloc(fine, sizeof *work.part[when])) &&
               (work.corner[when] = pliant_calloc(corners, sizeof *work.corner[when])) && (work.own[when] = pliant_calloc(corners, sizeof *work.own[when])) &&
               (work.cut[when] = pliant_calloc(coarse + fine, 1));
    for (int when = 0; good && when < 2; when++) memset(work.own[when], 0xff, corners * sizeof *work.own[when]);
    for (int r = 0; r < 3; r++) good = good && (room[r] = pliant_calloc(corners, sizeof *room[r]));
    pliant_status status = good ? nest(&work, room) : pliant_fail_memory("the next body");
    void *blocks[] = {work.touched, work.tet_source, work.node_source, work.at_load, work.part[0], work.part[1],
                      work.corner[0], work.corner[1], work.own[0], work.own[1], work.cut[0], work.cut[1], room[0], room[1], room[2]};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
    return status;
}
