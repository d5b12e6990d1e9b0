/* Store the fragments in the next body: which voxels belong to which fragment, and which fragments are joined. */
#include "cut/cut_stages.h"

#include "base/fail.h"
#include "base/pairs.h"
#include "base/memory.h"

#include <stdlib.h>
#include <string.h>

static int32_t count_voxels(const cut_work *work, int32_t tet)
{
    return work->voxels->start[tet + 1] - work->voxels->start[tet];
}

/* Copy the entry of an unchanged tetrahedron from the previous cuts.
 * at: input and output; position of its voxels in another pool */
static void keep_tet(const cut_work *work, int32_t old, pliant_cuts *next, int32_t *at)
{
    const pliant_cuts *cuts = work->cuts;
    const int32_t fragments = cuts->start[old + 1] - cuts->start[old], voxels = count_voxels(work, cuts->tet[old]);
    const int32_t n = next->num_tets++;
    next->tet[n] = cuts->tet[old];
    memcpy(next->fragment + next->start[n], cuts->fragment + cuts->start[old],
           (size_t)fragments * sizeof *next->fragment);
    next->start[n + 1] = next->start[n] + fragments;
    next->voxel_start[n] = cuts->voxel_start[old];
    if (next->pool == cuts->pool) return;
    memcpy(next->voxel_fragment + *at, cuts->voxel_fragment + cuts->voxel_start[old],
           (size_t)voxels * sizeof *next->voxel_fragment);
    next->voxel_start[n] = *at;
    *at += voxels;
}

static void add_tet(const cut_work *work, int32_t touched, pliant_cuts *next, int32_t *first)
{
    const int32_t n = next->num_tets++, tet = work->touched[touched], tets = work->body->fine.num_tets;
    int32_t at = next->start[n];
    next->tet[n] = tet;
    next->fragment[at++] = tet;
    for (int32_t f = work->first[touched]; f < work->first[touched + 1]; f++)
        if (work->fragment[f].receiver < 0 && work->fragment[f].number != tet)
            next->fragment[at++] = work->fragment[f].number;
    next->start[n + 1] = at;
    qsort(next->fragment + next->start[n], (size_t)(at - next->start[n]), sizeof *next->fragment, by_number);
    next->voxel_start[n] = *first;
    *first += work->start[touched + 1] - work->start[touched];
    for (int32_t i = work->start[touched]; i < work->start[touched + 1]; i++)
        next->voxel_fragment[next->voxel_start[n] + i - work->start[touched]] = cut_number(work, tets + work->part[i]);
}

static pliant_status gather_fragments(const cut_work *work, pliant_cuts *next)
{
    const pliant_cuts *cuts = work->cuts;
    const size_t tets = (size_t)work->num_touched + (size_t)(cuts ? cuts->num_tets : 0);
    const size_t fragments = (size_t)work->num_fragments + (size_t)(cuts ? cuts->start[cuts->num_tets] : 0);
    size_t kept = 0;
    int32_t at;
    for (int32_t t = 0; cuts && t < cuts->num_tets; t++)
        kept += cut_state(work, cuts->tet[t]) > 0 ? 0 : (size_t)count_voxels(work, cuts->tet[t]);
    next->tet = pliant_calloc(tets, sizeof *next->tet);
    next->start = pliant_calloc(tets + 1, sizeof *next->start);
    next->fragment = pliant_calloc(fragments, sizeof *next->fragment);
    next->voxel_start = pliant_calloc(tets, sizeof *next->voxel_start);
    if (!next->tet || !next->start || !next->fragment || !next->voxel_start) return pliant_fail_memory("the fragments");
    const pliant_status status = pliant_cuts_reserve(cuts, kept, (size_t)work->start[work->num_touched], next, &at);
    if (status != PLIANT_OK) return status;
    int32_t old = 0;
    for (int32_t t = 0; t < work->num_touched; t++) {
        for (; cuts && old < cuts->num_tets && cuts->tet[old] < work->touched[t]; old++) keep_tet(work, old, next, &at);
        if (cuts && old < cuts->num_tets && cuts->tet[old] == work->touched[t]) old++;
        add_tet(work, t, next, &at);
    }
    for (; cuts && old < cuts->num_tets; old++) keep_tet(work, old, next, &at);
    return PLIANT_OK;
}

static pliant_status gather_chips(const cut_work *work, pliant_cuts *next)
{
    const pliant_cuts *cuts = work->cuts;
    const int32_t tets = work->body->fine.num_tets;
    next->chip =
        pliant_calloc((size_t)work->num_fragments + (size_t)(cuts ? cuts->num_chips : 0) + 1, 2 * sizeof *next->chip);
    if (!next->chip) return pliant_fail_memory("the chips of fragments");
    for (int32_t c = 0; cuts && c < cuts->num_chips; c++)
        if (cut_state(work, cuts->chip[2 * c]) <= 0)
            memcpy(next->chip + 2 * next->num_chips++, cuts->chip + 2 * c, 2 * sizeof *next->chip);
    for (int32_t f = 0; f < work->num_fragments; f++) {
        const int32_t end = cut_receiver(work, tets + f);
        if (cut_tet_of(work, end) == work->fragment[f].tet) continue;
        next->chip[2 * next->num_chips] = work->fragment[f].tet;
        next->chip[2 * next->num_chips++ + 1] = cut_number(work, end);
    }
    next->num_chips = pliant_pairs_sort(next->chip, next->num_chips);
    return PLIANT_OK;
}

/* Merge the previous joins that stay, in order, with the new ones. */
static pliant_status gather_joins(const cut_work *work, pliant_cuts *next)
{
    const pliant_cuts *cuts = work->cuts;
    const int32_t before = cuts ? cuts->num_joins : 0;
    int32_t *made = pliant_calloc((size_t)work->num_edges + 1, 2 * sizeof *made), count = 0;
    next->join = pliant_calloc((size_t)work->num_edges + (size_t)before + 1, 2 * sizeof *next->join);
    if (!next->join || !made) {
        pliant_free(made);
        return pliant_fail_memory("the links between fragments");
    }
    for (int32_t e = 0; e < work->num_edges; e++) {
        const int32_t a = cut_number(work, work->edge[e].end[0]), b = cut_number(work, work->edge[e].end[1]);
        if (a == b) continue;
        made[2 * count] = a < b ? a : b;
        made[2 * count++ + 1] = a < b ? b : a;
    }
    count = pliant_pairs_sort(made, count);
    for (int32_t old = 0, now = 0; old < before || now < count;) {
        const int32_t *join = old < before ? cuts->join + 2 * old : NULL;
        if (join &&
            (cut_state(work, cut_parent(work, join[0])) > 0 || cut_state(work, cut_parent(work, join[1])) > 0)) {
            old++;
            continue;
        }
        const int order = !join ? 1 : now == count ? -1 : pliant_pair_order(join, made + 2 * now);
        memcpy(next->join + 2 * next->num_joins++, order <= 0 ? join : made + 2 * now, 2 * sizeof *made);
        old += order <= 0;
        now += order >= 0;
    }
    pliant_free(made);
    return PLIANT_OK;
}

pliant_status pliant_cut_gather(cut_work *work)
{
    pliant_status status = gather_fragments(work, work->next);
    if (status == PLIANT_OK) status = gather_chips(work, work->next);
    return status == PLIANT_OK ? gather_joins(work, work->next) : status;
}
