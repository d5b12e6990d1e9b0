/* Find the detached pieces of the next body, which nothing fixed holds. */
#include "topology/divide.h"
#include "topology/sorted_numbers.h"

#include "base/fail.h"
#include "base/pairs.h"
#include "base/buffer.h"
#include "mesh/mesh.h"
#include "base/memory.h"

#include <string.h>

typedef struct search {
    pliant_body *next;
    /* (num_joints x 2) joints of the previous body's pieces, as corners (4 tetrahedron + corner) of next */
    int32_t num_joints, *joint;
    /* (nodes) fixing without earlier pieces; (tetrahedra) whether it belongs to a piece */
    uint8_t *fixed, *loose;
    uint8_t *in_loose_tet, *in_held_tet;   /* (nodes) whether a loose, and a held tetrahedron has the node */
    int32_t *copy;                 /* (nodes) copy for the piece of a node that it shares with other tissue; -1: none */
    int32_t num_hinges, *hinge;    /* shared nodes */
} search;

void pliant_pieces_free(pliant_pieces *pieces)
{
    if (!pieces) return;
    PLIANT_FREE(pieces->start, pieces->node, pieces->joint, pieces);
}

static pliant_status create(int32_t count, int32_t nodes, int32_t joints, pliant_pieces **out)
{
    pliant_pieces *made = pliant_calloc(1, sizeof *made);
    if (!made) return pliant_fail_memory("the pieces of the mesh");
    made->start = pliant_calloc((size_t)count + 1, sizeof *made->start);
    made->node = pliant_calloc((size_t)nodes, sizeof *made->node);
    made->joint = pliant_calloc((size_t)joints + 1, 2 * sizeof *made->joint);
    if (!made->start || !made->node || !made->joint) {
        pliant_pieces_free(made);
        return pliant_fail_memory("the pieces of the mesh");
    }
    made->count = count;
    *out = made;
    return PLIANT_OK;
}

pliant_status pliant_pieces_copy(const pliant_pieces *pieces, pliant_pieces **out)
{
    const int32_t nodes = pieces->start[pieces->count], joints = pieces->num_joints + pieces->num_inner;
    pliant_status status = create(pieces->count, nodes, joints, out);
    if (status != PLIANT_OK) return status;
    memcpy((*out)->start, pieces->start, ((size_t)pieces->count + 1) * sizeof *pieces->start);
    memcpy((*out)->node, pieces->node, (size_t)nodes * sizeof *pieces->node);
    memcpy((*out)->joint, pieces->joint, 2 * (size_t)joints * sizeof *pieces->joint);
    (*out)->num_joints = pieces->num_joints;
    (*out)->num_inner = pieces->num_inner;
    return PLIANT_OK;
}

/* Take the previous body's joints: the division's remaining joints, or all joints. */
static pliant_status take_joints(search *work, const pliant_division *division)
{
    const pliant_pieces *before = work->next->pieces;
    const int32_t joints = !before           ? 0
                           : division->joint ? division->num_joints
                                             : before->num_joints + before->num_inner;
    work->joint = pliant_calloc((size_t)joints + 1, 2 * sizeof *work->joint);
    if (!work->joint) return pliant_fail_memory("the pieces of the mesh");
    work->num_joints = joints;
    for (int32_t v = 0; v < 2 * joints && division->joint; v++) work->joint[v] = division->joint[v];
    for (int32_t v = 0; v < 2 * joints && !division->joint; v++)
        while (work->next->fine.tets[work->joint[v]] != before->joint[v]) work->joint[v]++;
    return PLIANT_OK;
}

static int32_t node_of(const search *work, int32_t joint, int end)
{
    return work->next->fine.tets[work->joint[2 * joint + end]];
}

/* Release earlier pieces, so that they are found again together with parts that have detached from them. */
static void release_previous_pieces(const search *work)
{
    const pliant_body *next = work->next;
    for (int32_t n = 0; n < next->fine.num_nodes; n++)
        work->fixed[n] = next->fine_fixed[n] == PLIANT_FIXED_AT_POSITION ? PLIANT_MOVES : next->fine_fixed[n];
    for (int32_t j = 0; j < work->num_joints; j++)
        if (node_of(work, j, 0) == node_of(work, j, 1)) work->fixed[node_of(work, j, 0)] = PLIANT_FIXED_AT_REST;
}

static void mark_nodes(const search *work)
{
    const pliant_mesh *fine = &work->next->fine;
    for (int32_t v = 0; v < 4 * fine->num_tets; v++)
        (work->loose[v / 4] ? work->in_loose_tet : work->in_held_tet)[fine->tets[v]] = 1;
}

/* Copy the nodes between a piece and other tissue. The other tissue keeps the nodes; the piece gets the copies. */
static pliant_status part_hinges(search *work)
{
    pliant_mesh *fine = &work->next->fine;
    const int32_t nodes = fine->num_nodes;
    for (int32_t n = 0; n < nodes; n++) {
        work->copy[n] = -1;
        if (!work->in_loose_tet[n] || !work->in_held_tet[n]) continue;
        work->copy[n] = nodes + work->num_hinges;
        work->hinge[work->num_hinges++] = n;
    }
    pliant_status status = pliant_body_append_nodes(work->next, work->num_hinges, work->hinge);
    for (int32_t v = 0; status == PLIANT_OK && v < 4 * fine->num_tets; v++)
        if (work->loose[v / 4] && work->copy[fine->tets[v]] >= 0) {
            fine->tets[v] = work->copy[fine->tets[v]];
            pliant_mark_written(fine->tets, (size_t)v, 1, sizeof *fine->tets);
        }
    return status;
}

/* Return whether a node moves with its piece alone. In explicit dynamics nodes are not copied, so it may not. */
static bool is_own(const search *work, int32_t node)
{
    return !work->next->has_inertia || (!work->in_held_tet[node] && work->fixed[node] != PLIANT_FIXED_AT_REST);
}

/* Group the nodes of pieces; pieces that touch each other form one group.
 * part: (nodes) root of the group; -1: not in a piece */
static void join_nodes(const search *work, int32_t *part)
{
    const pliant_mesh *fine = &work->next->fine;
    for (int32_t n = 0; n < fine->num_nodes; n++) part[n] = -1;
    for (int32_t t = 0; t < fine->num_tets; t++) {
        int32_t first = -1;
        for (int v = 0; work->loose[t] && v < 4; v++) {
            const int32_t node = fine->tets[4 * t + v];
            if (!is_own(work, node)) continue;
            if (part[node] < 0) part[node] = node;
            if (first >= 0) pliant_set_join(part, node, first);
            first = node;
        }
    }
    for (int32_t j = 0; j < work->num_joints; j++)
        if (part[node_of(work, j, 0)] >= 0 && part[node_of(work, j, 1)] >= 0)
            pliant_set_join(part, node_of(work, j, 0), node_of(work, j, 1));
    for (int32_t n = 0; n < fine->num_nodes; n++)
        if (part[n] >= 0) part[n] = pliant_set_root(part, n);
}

/* List the previous joints between pieces and other tissue, or within pieces. Return their number. */
static int32_t list_old(const search *work, const int32_t *part, bool within, int32_t *joint)
{
    int32_t count = 0;
    for (int32_t j = 0; j < work->num_joints; j++) {
        int32_t own = node_of(work, j, 0), other = node_of(work, j, 1);
        if (part[own] < 0) {
            own = other;
            other = node_of(work, j, 0);
        }
        if (own == other || part[own] < 0 || (part[other] >= 0) != within) continue;
        joint[2 * count] = own;
        joint[2 * count++ + 1] = other;
    }
    return count;
}

static void list_joints(const search *work, const int32_t *part, pliant_pieces *pieces)
{
    int32_t *joint = pieces->joint, count = list_old(work, part, false, joint);
    for (int32_t h = 0; h < work->num_hinges; h++) {
        joint[2 * count] = work->copy[work->hinge[h]];
        joint[2 * count++ + 1] = work->hinge[h];
    }
    for (int32_t n = 0; n < work->next->fine.num_nodes - work->num_hinges; n++) {
        if (part[n] < 0 || work->fixed[n] != PLIANT_FIXED_AT_REST) continue;
        joint[2 * count] = n;
        joint[2 * count++ + 1] = n;
    }
    pieces->num_joints = pliant_pairs_sort(joint, count);
    joint += 2 * pieces->num_joints;
    pieces->num_inner = pliant_pairs_sort(joint, list_old(work, part, true, joint));
}

/* part: input: as from join_nodes; output: number of the piece */
static pliant_status list_pieces(const search *work, int32_t *part)
{
    pliant_body *next = work->next;
    const int32_t nodes = next->fine.num_nodes;
    int32_t count = 0, listed = 0;
    for (int32_t n = 0; n < nodes; n++) {
        listed += part[n] >= 0;
        if (part[n] >= 0) part[n] = part[n] == n ? count++ : part[part[n]];
    }
    pliant_pieces *made;
    pliant_status status = create(count, listed, nodes + work->num_joints, &made);
    if (status != PLIANT_OK) return status;
    for (int32_t n = 0; n < nodes; n++)
        if (part[n] >= 0) made->start[part[n] + 1]++;
    for (int32_t p = 0; p < count; p++) made->start[p + 1] += made->start[p];
    for (int32_t n = 0; n < nodes; n++)
        if (part[n] >= 0) made->node[made->start[part[n]]++] = n;
    for (int32_t p = count; p > 0; p--) made->start[p] = made->start[p - 1];
    made->start[0] = 0;
    if (!next->has_inertia) list_joints(work, part, made);
    if (count > (next->pieces ? next->pieces->count : 0))
        pliant_log(PLIANT_LOG_INFO, "revision %llu: %d pieces are detached and fall",
                   (unsigned long long)next->revision, count);
    pliant_pieces_free(next->pieces);
    next->pieces = made;
    return PLIANT_OK;
}

/* Fix the nodes of pieces for the solver. A solver needs at least one unknown, so if nothing else moves, one node stays
 * free. It is the node with the minimum mass, because a tool is unlikely to hold it; its position follows from its
 * piece. */
static void fix_nodes(pliant_body *next, const int32_t *part)
{
    const int32_t nodes = next->fine.num_nodes;
    int32_t lightest = -1;
    bool moves = false;
    for (int32_t n = 0; n < nodes; n++) {
        if (part[n] >= 0) next->fine_fixed[n] = PLIANT_FIXED_AT_POSITION;
        moves = moves || next->fine_fixed[n] == PLIANT_MOVES;
        if (part[n] >= 0 && (lightest < 0 || next->node_mass[n] < next->node_mass[lightest])) lightest = n;
    }
    if (!moves && lightest >= 0) next->fine_fixed[lightest] = PLIANT_MOVES;
}

/* Return whether the pieces keep their nodes. The cut may not touch any of their nodes.
 * of: as from find_previous_pieces */
static bool pieces_keep_nodes(const search *work, const pliant_division *division, const int32_t *of)
{
    const pliant_body *next = work->next;
    const pliant_body_changes *changes = &next->changes;
    const int32_t listed = changes->num_touched, tets = next->fine.num_tets;
    for (int32_t i = 0; i < listed + tets - changes->tets_before; i++) {
        const int32_t tet = i < listed ? changes->touched[i] : changes->tets_before + i - listed;
        for (int v = 0; v < 4; v++) {
            const int32_t node = next->fine.tets[4 * (size_t)tet + (size_t)v];
            if (of[node < changes->nodes_before ? node : changes->node_source[node - changes->nodes_before]] >= 0)
                return false;
        }
    }
    return division->same_pieces;
}

/* Find the piece of each node from the previous pieces, which share no node with other tissue.
 * of: output, (nodes) first node of the node's piece; -1: none */
static void find_previous_pieces(const pliant_body *next, int32_t *of)
{
    const pliant_pieces *pieces = next->pieces;
    memset(of, 0xff, (size_t)next->fine.num_nodes * sizeof *of);
    for (int32_t p = 0; p < pieces->count; p++)
        for (int32_t i = pieces->start[p]; i < pieces->start[p + 1]; i++)
            of[pieces->node[i]] = pieces->node[pieces->start[p]];
}

/* Update the pieces after a cut that has touched none of them.
 * done: output; false if the cut may have touched a piece, and then nothing has changed */
static pliant_status find_again(search *work, const pliant_division *division, bool *done)
{
    pliant_body *next = work->next;
    *done = false;
    if (!next->pieces || next->has_inertia || !division->same_pieces) return PLIANT_OK;
    int32_t *part = pliant_malloc((size_t)next->fine.num_nodes, sizeof *part);
    if (!part) return pliant_fail_memory("the pieces of the mesh");
    pliant_status status = PLIANT_OK;
    find_previous_pieces(next, part);
    if ((*done = pieces_keep_nodes(work, division, part))) {
        release_previous_pieces(work);
        status = list_pieces(work, part);
        if (status == PLIANT_OK) fix_nodes(next, part);
    }
    pliant_free(part);
    return status;
}

static pliant_status find(search *work)
{
    pliant_body *next = work->next;
    int32_t pieces = 0;
    release_previous_pieces(work);
    pliant_status status = pliant_mesh_fix_loose_pieces(&next->fine, next->across, PLIANT_FIXED_AT_POSITION, false,
                                                        work->fixed, work->loose, &pieces);
    if (status != PLIANT_OK || pieces == 0) return status;
    mark_nodes(work);
    if (!next->has_inertia) status = part_hinges(work);
    if (status != PLIANT_OK) return status;
    int32_t nodes = next->fine.num_nodes, *part = pliant_calloc((size_t)nodes, sizeof *part);
    if (!part) return pliant_fail_memory("the pieces of the mesh");
    join_nodes(work, part);
    status = list_pieces(work, part);
    if (status == PLIANT_OK && !next->has_inertia) fix_nodes(next, part);
    pliant_free(part);
    return status;
}

static pliant_status find_all_pieces(search *work)
{
    const size_t nodes = (size_t)work->next->fine.num_nodes, tets = (size_t)work->next->fine.num_tets;
    work->loose = pliant_calloc(tets, 1);
    work->in_loose_tet = pliant_calloc(nodes, 1);
    work->in_held_tet = pliant_calloc(nodes, 1);
    work->copy = pliant_calloc(nodes, sizeof *work->copy);
    work->hinge = pliant_calloc(nodes, sizeof *work->hinge);
    const bool good = work->loose && work->in_loose_tet && work->in_held_tet && work->copy && work->hinge;
    return good ? find(work) : pliant_fail_memory("the pieces of the mesh");
}

pliant_status pliant_body_find_pieces(pliant_body *next, const pliant_division *division, bool *rebuilt)
{
    search work = {.next = next, .fixed = pliant_calloc((size_t)next->fine.num_nodes, 1)};
    bool done = false;
    pliant_status status = work.fixed ? take_joints(&work, division) : pliant_fail_memory("the pieces of the mesh");
    if (status == PLIANT_OK) status = find_again(&work, division, &done);
    if (status == PLIANT_OK && !done) status = find_all_pieces(&work);
    *rebuilt = !done;
    PLIANT_FREE(work.joint, work.fixed, work.loose, work.in_loose_tet, work.in_held_tet, work.copy, work.hinge);
    return status;
}
