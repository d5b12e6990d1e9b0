/* Assign mesh nodes to the corners of fragments and tetrahedra after a cut. Around each node, corners whose tetrahedra
 * are still joined by links, diagonals or bridges share one node. The first such part keeps the node; every other part
 * gets a copy. Corners away from touched tetrahedra keep their nodes. */
#include "topology/sorted_numbers.h"
#include "cut/cut_stages.h"

#include "base/buffer.h"
#include "base/fail.h"
#include "base/pairs.h"
#include "base/memory.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* a corner of a fragment or of an untouched tetrahedron */
typedef struct element {
    int32_t end, corner;
} element;

typedef struct splitting {
    cut_work *work;
    int32_t *own;        /* (num_fragments x 4) nodes of the fragments' corners */
    /* (num_moved x 2) 4 tetrahedron + corner, and its new node, for corners of untouched tetrahedra */
    int32_t *moved;
    int32_t num_moved, moved_capacity;
    int32_t copies, copy_capacity;
    element *around;     /* elements around the current node */
    int32_t *part, count, capacity;
    uint8_t *holds;      /* (capacity) per part: whether one of its voxels is adjacent to the node */
    /* (tetrahedra and fragments) connected component, by faces, of the elements around touched tetrahedra; -1: other
     * elements */
    int32_t *region;
    int32_t regions;     /* number of connected components */
} splitting;

static pliant_status no_memory(void) { return pliant_fail_memory("the nodes of fragments"); }

/* ---- which elements are joined */

static bool joined_at_load(const cut_work *work, int32_t s, int32_t t)
{
    const pliant_voxels *voxels = work->voxels;
    if (cut_share_face(work, s, t)) return true;
    for (int32_t e = voxels->adjacent_start[s]; e < voxels->adjacent_start[s + 1]; e++) {
        const int32_t *ends = voxels->bridge + 2 * voxels->adjacent[e];
        if (voxels->owner[ends[0]] == t || voxels->owner[ends[1]] == t) return true;
    }
    return false;
}

static bool is_empty(const cut_work *work, int32_t tet)
{
    return work->voxels->start[tet] == work->voxels->start[tet + 1];
}

/* A tetrahedron smaller than a voxel has no links. Next to a cut, such a tetrahedron stays joined to one neighbour
 * only, so that it does not bridge the cut. */
static bool joined_to_empty(const cut_work *work, int32_t empty, int32_t other)
{
    const int32_t *across = work->voxels->across + 4 * (size_t)empty;
    int32_t host = -1;
    bool beside_cut = false;
    for (int c = 0; c < 4; c++) {
        if (across[c] < 0) continue;
        beside_cut = beside_cut || cut_state(work, across[c]) != 0;
        if (host < 0 && !is_empty(work, across[c])) host = across[c];
    }
    const int32_t tet = cut_tet_of(work, other);
    if (!beside_cut) return joined_at_load(work, empty, tet);
    if (tet != host) return false;
    const int32_t state = cut_state(work, tet);
    if (state > 0) /* the fragment that keeps the tetrahedron's number */
        return other >= work->body->fine.num_tets && work->fragment[other - work->body->fine.num_tets].stays &&
               work->fragment[other - work->body->fine.num_tets].source == tet;
    return other == tet;
}

static bool joined(const cut_work *work, int32_t a, int32_t b)
{
    if (pliant_cut_edge(work, a, b) > 0) return true;
    const int32_t s = cut_tet_of(work, a), t = cut_tet_of(work, b);
    if (s == t) return false;
    if (is_empty(work, s) || is_empty(work, t))
        return is_empty(work, s) ? joined_to_empty(work, s, b) : joined_to_empty(work, t, a);
    if (cut_state(work, s) > 0 || cut_state(work, t) > 0) return false;
    return cut_state(work, s) < 0 || cut_state(work, t) < 0 ? pliant_cuts_join(work->cuts, a, b)
                                                            : joined_at_load(work, s, t);
}

/* ---- elements around a node */

static pliant_status add_element(splitting *split, int32_t end, int32_t corner)
{
    if (split->count == split->capacity) {
        const int32_t capacity = split->capacity > 0 ? 2 * split->capacity : 128;
        if (!pliant_grow(&split->around, (size_t)capacity, sizeof *split->around) ||
            !pliant_grow(&split->part, (size_t)capacity, sizeof *split->part) ||
            !pliant_grow(&split->holds, (size_t)capacity, 1))
            return no_memory();
        split->capacity = capacity;
    }
    split->around[split->count++] = (element){end, corner};
    if (split->region[end] < 0) {
        split->region[end] = end;
        split->regions++;
    }
    return PLIANT_OK;
}

static pliant_status find_around(splitting *split, int32_t node)
{
    const cut_work *work = split->work;
    const pliant_voxels *voxels = work->voxels;
    const int32_t *tets = work->body->fine.tets, load = work->body->node_parent ? work->body->node_parent[node] : node;
    pliant_status status = PLIANT_OK;
    split->count = 0;
    for (int32_t e = voxels->around_start[load]; e < voxels->around_start[load + 1] && status == PLIANT_OK; e++) {
        const int32_t tet = voxels->around[e] / 4, corner = voxels->around[e] % 4, state = cut_state(work, tet);
        if (state == 0) {
            if (tets[4 * (size_t)tet + corner] == node) status = add_element(split, tet, corner);
        } else if (state > 0) {
            for (int32_t f = work->first[state - 1]; f < work->first[state] && status == PLIANT_OK; f++)
                if (work->fragment[f].receiver < 0 && tets[4 * (size_t)work->fragment[f].source + corner] == node)
                    status = add_element(split, work->body->fine.num_tets + f, corner);
        } else {
            for (int32_t f = work->cuts->start[-state - 1]; f < work->cuts->start[-state] && status == PLIANT_OK; f++)
                if (tets[4 * (size_t)work->cuts->fragment[f] + corner] == node)
                    status = add_element(split, work->cuts->fragment[f], corner);
        }
    }
    return status;
}

/* Find the parts with a voxel adjacent to the node. A copy of a fixed node is fixed only for such a part, so that a
 * soft-tissue fragment is not attached to a node inside bone. */
static void find_adjacent_parts(splitting *split, int32_t node)
{
    const cut_work *work = split->work;
    const pliant_geometry *geometry = &work->voxels->geometry;
    double index[3];
    int32_t low[3], high[3];
    memset(split->holds, 0, (size_t)split->count);
    pliant_geometry_to_index(geometry, work->body->fine.rest + 3 * (size_t)node, index);
    for (int d = 0; d < 3; d++) {
        low[d] = (int32_t)fmax(ceil(index[d] - 1 - 1e-6), 0);
        high[d] = (int32_t)fmin(floor(index[d] + 1 + 1e-6), geometry->size[d] - 1);
    }
    for (int32_t k = low[2]; k <= high[2]; k++)
        for (int32_t j = low[1]; j <= high[1]; j++)
            for (int32_t i = low[0]; i <= high[0]; i++) {
                const int32_t voxel = i + geometry->size[0] * (j + geometry->size[1] * k);
                if (work->voxels->owner[voxel] < 0) continue;
                const int32_t end = cut_receiver(work, pliant_cut_end_of(work, voxel));
                for (int32_t e = 0; e < split->count; e++)
                    if (split->around[e].end == end) split->holds[pliant_set_root(split->part, e)] = 1;
            }
}

static pliant_status move_corner(splitting *split, const element *one, int32_t node)
{
    const int32_t tets = split->work->body->fine.num_tets;
    if (one->end >= tets) {
        split->own[4 * (one->end - tets) + one->corner] = node;
        return PLIANT_OK;
    }
    if (!pliant_reserve(&split->moved, &split->moved_capacity, split->num_moved, 128, 2 * sizeof *split->moved))
        return no_memory();
    split->moved[2 * split->num_moved] = 4 * one->end + one->corner;
    split->moved[2 * split->num_moved++ + 1] = node;
    return PLIANT_OK;
}

static pliant_status add_copy(splitting *split, uint8_t fixed)
{
    cut_work *work = split->work;
    if (!pliant_reserve(&work->copy_fixed, &split->copy_capacity, split->copies, 64, 1)) return no_memory();
    work->copy_fixed[split->copies++] = fixed;
    return PLIANT_OK;
}

/* Return the fixing that a node of a detached piece had before the piece detached. */
static uint8_t fixed_of(const pliant_body *body, int32_t node)
{
    for (int32_t j = 0; body->pieces && j < body->pieces->num_joints; j++)
        if (body->pieces->joint[2 * j] == node && body->pieces->joint[2 * j + 1] == node) return PLIANT_FIXED_AT_REST;
    return body->fine_fixed[node];
}

static bool joined_by_face(const cut_work *work, int32_t a, int32_t b)
{
    const int32_t s = cut_tet_of(work, a), t = cut_tet_of(work, b);
    return s == t || cut_share_face(work, s, t);
}

static pliant_status split_node(splitting *split, int32_t node)
{
    const cut_work *work = split->work;
    pliant_status status = find_around(split, node);
    if (status != PLIANT_OK) return status;
    int32_t *part = split->part, parts = split->count;
    for (int32_t i = 0; i < split->count; i++) part[i] = i;
    for (int pass = 0; pass < 2 && parts > 1; pass++) /* first across faces, then across an edge or the node */
        for (int32_t i = 0; i < split->count && parts > 1; i++)
            for (int32_t j = i + 1; j < split->count; j++) {
                const int32_t a = split->around[i].end, b = split->around[j].end;
                if (pliant_set_root(part, i) == pliant_set_root(part, j) || joined_by_face(work, a, b) != (pass == 0) ||
                    !joined(work, a, b))
                    continue;
                pliant_set_join(part, i, j);
                parts--;
                if (pass > 0 || pliant_set_root(split->region, a) == pliant_set_root(split->region, b)) continue;
                pliant_set_join(split->region, a, b);
                split->regions--;
            }
    if (parts <= 1) return PLIANT_OK;
    const uint8_t fixed = fixed_of(work->body, node);
    int32_t keeps_number = 0;
    bool any = false;
    if (fixed == PLIANT_FIXED_AT_REST) {
        find_adjacent_parts(split, node);
        for (int32_t i = 0; i < split->count && !any; i++)
            if (part[i] == i && split->holds[i]) {
                keeps_number = i;
                any = true;
            }
    }
    for (int32_t i = 0; i < split->count && status == PLIANT_OK; i++) {
        if (part[i] != i || i == keeps_number) continue;
        status = add_copy(split, any && !split->holds[i] ? PLIANT_MOVES : fixed);
        for (int32_t j = i; j < split->count && status == PLIANT_OK; j++)
            if (pliant_set_root(part, j) == i)
                status = move_corner(split, split->around + j, work->body->fine.num_nodes + split->copies - 1);
    }
    return status;
}

static pliant_status split_nodes(splitting *split)
{
    const cut_work *work = split->work;
    const int32_t corners = 4 * work->num_fragments;
    int32_t *nodes = pliant_calloc((size_t)corners, sizeof *nodes);
    if (!nodes) return no_memory();
    for (int32_t f = 0; f < work->num_fragments; f++)
        memcpy(split->own + 4 * f, work->body->fine.tets + 4 * (size_t)work->fragment[f].source,
               4 * sizeof *split->own);
    memcpy(nodes, split->own, (size_t)corners * sizeof *nodes);
    qsort(nodes, (size_t)corners, sizeof *nodes, by_number);
    pliant_status status = PLIANT_OK;
    for (int32_t i = 0; i < corners && status == PLIANT_OK; i++)
        if (i == 0 || nodes[i] != nodes[i - 1]) status = split_node(split, nodes[i]);
    pliant_free(nodes);
    return status;
}

/* List the tetrahedra of the body whose voxels or corners change. */
static pliant_status list_changed(splitting *split)
{
    cut_work *work = split->work;
    const int32_t tets = work->body->fine.num_tets;
    int32_t *changed = work->changed =
                pliant_calloc((size_t)work->num_fragments + (size_t)split->num_moved + 1, sizeof *changed),
            count = 0;
    if (!changed) return no_memory();
    for (int32_t f = 0; f < work->num_fragments; f++) {
        const int32_t number = cut_number(work, tets + f);
        if (number < tets) changed[count++] = number;
    }
    for (int32_t m = 0; m < split->num_moved; m++) changed[count++] = split->moved[2 * m] / 4;
    work->num_changed = sort_once(changed, count);
    return PLIANT_OK;
}

/* Number the tetrahedra of the next body. Fragments with the same four nodes stay separate, because a later cut may
 * separate them without severing a link of either. */
static pliant_status number(splitting *split)
{
    cut_work *work = split->work;
    const int32_t tets = work->body->fine.num_tets;
    work->num_tets = tets;
    for (int32_t f = 0; f < work->num_fragments; f++) {
        cut_fragment *one = work->fragment + f;
        if (one->receiver < 0) one->number = one->stays ? one->source : work->num_tets++;
    }
    work->num_nodes = work->body->fine.num_nodes + split->copies;
    pliant_status status = list_changed(split);
    if (status != PLIANT_OK) return status;
    work->corners = pliant_calloc((size_t)(work->num_changed + work->num_tets - tets) + 1, 4 * sizeof *work->corners);
    work->tet_source = pliant_calloc((size_t)(work->num_tets - tets) + 1, sizeof *work->tet_source);
    if (!work->corners || !work->tet_source) return no_memory();
    for (int32_t r = 0; r < work->num_changed; r++)
        memcpy(work->corners + 4 * (size_t)r, work->body->fine.tets + 4 * (size_t)work->changed[r],
               4 * sizeof *work->corners);
    for (int32_t m = 0; m < split->num_moved; m++)
        work->corners[4 * cut_row(work, split->moved[2 * m] / 4) + split->moved[2 * m] % 4] = split->moved[2 * m + 1];
    for (int32_t f = 0; f < work->num_fragments; f++) {
        const cut_fragment *one = work->fragment + f;
        if (one->receiver >= 0) continue;
        memcpy(work->corners + 4 * (size_t)cut_row(work, one->number), split->own + 4 * f, 4 * sizeof *split->own);
        if (one->number >= tets) work->tet_source[one->number - tets] = one->source;
    }
    return PLIANT_OK;
}

/* ---- joints of detached pieces */

static pliant_status add_joint(cut_work *work, const element *own, const element *other)
{
    if (!pliant_reserve(&work->joint, &work->joint_capacity, work->num_joints, 64, 2 * sizeof *work->joint))
        return no_memory();
    work->joint[2 * work->num_joints] = 4 * cut_number(work, own->end) + own->corner;
    work->joint[2 * work->num_joints++ + 1] = 4 * cut_number(work, other->end) + other->corner;
    return PLIANT_OK;
}

/* List the nodes that joints keep together, as pairs (root, node) in ascending order. Return the number of pairs.
 * part: (fine.num_nodes) buffer
 * hung: output, (2 joints x 2) */
static int32_t list_jointed_nodes(const pliant_body *body, int32_t *part, int32_t *hung)
{
    const int32_t *joint = body->pieces->joint, joints = body->pieces->num_joints + body->pieces->num_inner;
    for (int32_t n = 0; n < body->fine.num_nodes; n++) part[n] = n;
    for (int32_t j = 0; j < joints; j++) pliant_set_join(part, joint[2 * j], joint[2 * j + 1]);
    for (int32_t v = 0; v < 2 * joints; v++) {
        hung[2 * v] = pliant_set_root(part, joint[v]);
        hung[2 * v + 1] = joint[v];
    }
    return pliant_pairs_sort(hung, 2 * joints);
}

/* Add joints between corners that are still joined around nodes that joints have kept together. */
static pliant_status keep_nodes_joined(splitting *split, int32_t count, const int32_t *hung)
{
    cut_work *work = split->work;
    pliant_status status = PLIANT_OK;
    for (int32_t i = 0; i < count; i++) {
        status = find_around(split, hung[2 * i + 1]);
        const int32_t own = split->count;
        element *around = status == PLIANT_OK ? pliant_calloc((size_t)own, sizeof *around) : NULL;
        if (!around) return status == PLIANT_OK ? no_memory() : status;
        memcpy(around, split->around, (size_t)own * sizeof *around);
        for (int32_t j = i + 1; j < count && status == PLIANT_OK; j++) {
            status = find_around(split, hung[2 * j + 1]);
            for (int32_t a = 0; a < own; a++)
                for (int32_t b = 0; b < split->count && status == PLIANT_OK; b++)
                    if (joined(work, around[a].end, split->around[b].end))
                        status = add_joint(work, around + a, split->around + b);
        }
        pliant_free(around);
        if (status != PLIANT_OK) return status;
    }
    return PLIANT_OK;
}

/* Add a joint that keeps a fixed node in its position. Only the element that keeps the node number gets it; copies are
 * fixed separately. */
static pliant_status keep_fixed(splitting *split, int32_t node)
{
    const cut_work *work = split->work;
    pliant_status status = find_around(split, node);
    for (int32_t i = 0; i < split->count && status == PLIANT_OK; i++)
        if (cut_corners(work, cut_number(work, split->around[i].end))[split->around[i].corner] == node)
            return add_joint(split->work, split->around + i, split->around + i);
    return status;
}

static pliant_status keep_joints(splitting *split)
{
    const pliant_body *body = split->work->body;
    const pliant_pieces *pieces = body->pieces;
    if (!pieces) return PLIANT_OK;
    const size_t joints = (size_t)pieces->num_joints + (size_t)pieces->num_inner;
    int32_t *part = pliant_calloc((size_t)body->fine.num_nodes, sizeof *part),
            *hung = pliant_calloc(2 * joints + 1, 2 * sizeof *hung);
    /* an empty list also needs memory, because NULL means that joints are unchanged */
    split->work->joint = pliant_calloc(1, 2 * sizeof *split->work->joint);
    pliant_status status = part && hung && split->work->joint ? PLIANT_OK : no_memory();
    const int32_t count = status == PLIANT_OK ? list_jointed_nodes(body, part, hung) : 0;
    for (int32_t i = 0, next; i < count && status == PLIANT_OK; i = next) {
        for (next = i; next < count && hung[2 * next] == hung[2 * i];) next++;
        status = keep_nodes_joined(split, next - i, hung + 2 * i);
    }
    for (int32_t j = 0; j < pieces->num_joints && status == PLIANT_OK; j++)
        if (pieces->joint[2 * j] == pieces->joint[2 * j + 1]) status = keep_fixed(split, pieces->joint[2 * j]);
    pliant_free(part);
    pliant_free(hung);
    return status;
}

pliant_status pliant_cut_corners(cut_work *work)
{
    splitting split = {.work = work};
    const size_t ends = (size_t)work->body->fine.num_tets + (size_t)work->num_fragments;
    split.own = pliant_calloc((size_t)work->num_fragments, 4 * sizeof *split.own);
    split.region = pliant_calloc(ends, sizeof *split.region);
    if (split.region) memset(split.region, 0xff, ends * sizeof *split.region);
    pliant_status status = split.own && split.region ? split_nodes(&split) : no_memory();
    if (status == PLIANT_OK) {
        work->is_still_connected = split.regions == 1;
        status = number(&split);
        if (status == PLIANT_OK) status = keep_joints(&split);
    }
    PLIANT_FREE(split.own, split.region, split.moved, split.around, split.part, split.holds);
    return status;
}
