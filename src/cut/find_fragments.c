/* Find the touched tetrahedra, which have a severed link, and the fragments into which their voxels fall. All other
 * tetrahedra are skipped, so a cut has only local effects. */
#include "topology/sorted_numbers.h"
#include "cut/cut_stages.h"

#include "base/buffer.h"
#include "base/fail.h"
#include "base/memory.h"

#include <string.h>

static pliant_status no_memory(void) { return pliant_fail_memory("the elements near the blade"); }

/* ---- severed links */

static pliant_status merge_severed(cut_work *work)
{
    const pliant_cuts *cuts = work->cuts;
    pliant_cuts *next = work->next;
    const int32_t links = cuts ? cuts->num_links : 0, bridges = cuts ? cuts->num_bridges : 0;
    next->link = pliant_calloc((size_t)links + (size_t)work->num_links + 1, sizeof *next->link);
    next->bridge = pliant_calloc((size_t)bridges + (size_t)work->num_bridges + 1, sizeof *next->bridge);
    if (!next->link || !next->bridge) return no_memory();
    for (int32_t old = 0, made = 0; old < links || made < work->num_links;) {
        bool first = made == work->num_links || (old < links && cuts->link[old] < work->link[made]);
        next->link[next->num_links++] = first ? cuts->link[old++] : work->link[made++];
    }
    for (int32_t old = 0, made = 0; old < bridges || made < work->num_bridges;) {
        bool first = made == work->num_bridges || (old < bridges && cuts->bridge[old] < work->bridge[made]);
        next->bridge[next->num_bridges++] = first ? cuts->bridge[old++] : work->bridge[made++];
    }
    return PLIANT_OK;
}

/* ---- tetrahedra */

/* Append a tetrahedron to the touched ones and set its state above 0. Errors: MEMORY. */
static pliant_status mark(cut_work *work, int32_t tet)
{
    if (cut_state(work, tet) > 0) return PLIANT_OK;
    if (!pliant_reserve(&work->touched, &work->touched_capacity, work->num_touched, 64, sizeof *work->touched) ||
        !cut_sparse_set(&work->state, tet, 1))
        return no_memory();
    work->touched[work->num_touched++] = tet;
    return PLIANT_OK;
}

/* Chips are assigned again. Mark the tetrahedron that owns a chip if the tetrahedron that received it is touched, and
 * vice versa. */
static pliant_status mark_chips(cut_work *work)
{
    const pliant_cuts *cuts = work->cuts;
    pliant_status status = PLIANT_OK;
    for (int32_t before = -1; cuts && before < work->num_touched && status == PLIANT_OK;) {
        before = work->num_touched;
        for (int32_t c = 0; c < cuts->num_chips && status == PLIANT_OK; c++) {
            const int32_t from = cuts->chip[2 * c], to = cut_parent(work, cuts->chip[2 * c + 1]);
            if (cut_state(work, from) > 0) status = mark(work, to);
            if (status == PLIANT_OK && cut_state(work, to) > 0) status = mark(work, from);
        }
    }
    return status;
}

static pliant_status list_touched(cut_work *work)
{
    const pliant_voxels *voxels = work->voxels;
    pliant_status status = PLIANT_OK;
    for (int32_t i = 0; i < work->num_links && status == PLIANT_OK; i++) {
        const int32_t voxel = (int32_t)(work->link[i] / 4);
        status = mark(work, voxels->owner[voxel]);
        if (status == PLIANT_OK)
            status = mark(work, voxels->owner[voxel + pliant_stride_of(voxels, work->link[i] % 4)]);
    }
    for (int32_t i = 0; i < 2 * work->num_bridges && status == PLIANT_OK; i++)
        status = mark(work, voxels->owner[voxels->bridge[2 * work->bridge[i / 2] + i % 2]]);
    if (status == PLIANT_OK) status = mark_chips(work);
    if (status != PLIANT_OK) return status;
    if (!(work->start = pliant_calloc((size_t)work->num_touched + 1, sizeof *work->start))) return no_memory();
    work->num_touched = sort_once(work->touched, work->num_touched);
    for (int32_t i = 0; i < work->num_touched; i++) {
        const int32_t t = work->touched[i];
        work->start[i + 1] = work->start[i] + voxels->start[t + 1] - voxels->start[t];
        cut_sparse_set(&work->state, t, i + 1); /* cannot fail, because the run is allocated */
    }
    return PLIANT_OK;
}

/* ---- tables around the voxels of touched tetrahedra */

/* Mark the voxels around a severed link as doubtful, within the box. */
static void mark_doubtful(cut_work *work, int32_t i, int32_t j, int32_t k)
{
    const int32_t *size = work->links.size;
    for (int32_t c = k > 0 ? k - 1 : 0; c <= k + 1 && c < size[2]; c++)
        for (int32_t b = j > 0 ? j - 1 : 0; b <= j + 1 && b < size[1]; b++)
            for (int32_t a = i > 0 ? i - 1 : 0; a <= i + 1 && a < size[0]; a++)
                work->is_near_severed_link[(size_t)a + (size_t)size[0] * ((size_t)b + (size_t)size[1] * (size_t)c)] = 1;
}

static pliant_status make_tables(cut_work *work)
{
    const pliant_voxels *voxels = work->voxels;
    const int32_t count = work->start[work->num_touched];
    pliant_links *links = &work->links;
    int32_t high[3] = {0}, at[3] = {0}, before = -2;
    work->voxel = pliant_calloc((size_t)count, sizeof *work->voxel);
    work->part = pliant_calloc((size_t)count, sizeof *work->part);
    if (!work->voxel || !work->part) return no_memory();
    for (int32_t t = 0; t < work->num_touched; t++)
        memcpy(work->voxel + work->start[t], voxels->voxel + voxels->start[work->touched[t]],
               (size_t)(work->start[t + 1] - work->start[t]) * sizeof *work->voxel);
    for (int32_t i = 0; i < count; i++) {
        pliant_place_after(voxels, work->voxel[i], &before, at);
        for (int d = 0; d < 3; d++) {
            if (i == 0 || at[d] < links->low[d]) links->low[d] = at[d];
            if (i == 0 || at[d] > high[d]) high[d] = at[d];
        }
    }
    /* two more voxels: a link is stored at its lower end, and a diagonal passes through a third voxel */
    for (int d = 0; d < 3; d++) {
        links->low[d] -= 2;
        links->size[d] = high[d] + 3 - links->low[d];
    }
    const size_t row = (size_t)links->size[0], slice = row * (size_t)links->size[1],
                 all = slice * (size_t)links->size[2];
    links->voxels = voxels;
    links->cuts = work->next;
    links->severed = pliant_calloc(all, 1);
    work->place = pliant_calloc(all, sizeof *work->place);
    work->is_near_severed_link = pliant_calloc(all, 1);
    if (!links->severed || !work->place || !work->is_near_severed_link) return no_memory();
    before = -2;
    for (int32_t i = 0; i < count; i++) {
        pliant_place_after(voxels, work->voxel[i], &before, at);
        work->place[(size_t)(at[0] - links->low[0]) + row * (size_t)(at[1] - links->low[1]) +
                    slice * (size_t)(at[2] - links->low[2])] = i + 1;
    }
    const int32_t *size = voxels->geometry.size;
    for (int32_t k = 0; k < links->size[2]; k++) { /* the links of a slice are consecutive */
        const int64_t first =
            (int64_t)(links->low[2] + k) * size[0] * size[1] + (int64_t)links->low[1] * size[0] + links->low[0];
        const int64_t last = first + (int64_t)(links->size[1] - 1) * size[0] + links->size[0];
        if (last <= 0) continue;
        for (int32_t l =
                 pliant_lower_bound(work->next->link, work->next->num_links, first > 0 ? 4 * (uint32_t)first : 0);
             l < work->next->num_links; l++) {
            const int32_t voxel = (int32_t)(work->next->link[l] / 4);
            if (voxel >= last) break;
            pliant_place_of(voxels, voxel, at);
            const int32_t i = at[0] - links->low[0], j = at[1] - links->low[1];
            if (at[2] - links->low[2] != k || i < 0 || j < 0 || i >= links->size[0] || j >= links->size[1]) continue;
            links->severed[(size_t)i + row * (size_t)j + slice * (size_t)k] |= (uint8_t)(1 << work->next->link[l] % 4);
            mark_doubtful(work, i, j, k);
        }
    }
    return PLIANT_OK;
}

/* ---- fragments */

/* Return the index of a voxel that a touched tetrahedron owns. */
static int32_t index_of(const cut_work *work, int32_t voxel)
{
    const int32_t tet = work->voxels->owner[voxel];
    return work->start[cut_state(work, tet) - 1] + pliant_voxel_in(work->voxels, tet, voxel);
}

static void find_parts(cut_work *work)
{
    const pliant_voxels *voxels = work->voxels;
    const pliant_links *links = &work->links;
    const int32_t row = links->size[0], slice = row * links->size[1];
    ptrdiff_t behind[9];
    for (int n = 0; n < 9; n++)
        behind[n] = pliant_later_neighbours[n][0] + row * pliant_later_neighbours[n][1] +
                    (ptrdiff_t)slice * pliant_later_neighbours[n][2];
    for (int32_t t = 0; t < work->num_touched; t++) {
        for (int32_t i = work->start[t]; i < work->start[t + 1]; i++) work->part[i] = i;
        int32_t at[3] = {0}, before = -2;
        for (int32_t i = work->start[t]; i < work->start[t + 1]; i++) {
            pliant_place_after(voxels, work->voxel[i], &before, at);
            const size_t place = (size_t)(at[0] - links->low[0]) + (size_t)row * (size_t)(at[1] - links->low[1]) +
                                 (size_t)slice * (size_t)(at[2] - links->low[2]);
            int32_t own = pliant_set_root(work->part, i);
            for (int n = 0; n < 9; n++) {
                const int32_t other = work->place[(ptrdiff_t)place + behind[n]] - 1;
                if (other < work->start[t] || other >= work->start[t + 1]) continue;
                const int32_t its = pliant_set_root(work->part, other);
                if (own == its || !pliant_joined(links, work->voxel[i], at, pliant_later_neighbours[n])) continue;
                pliant_set_join(work->part, own, its);
                own = pliant_set_root(work->part, own);
            }
        }
        const int32_t tet = work->touched[t];
        for (int32_t b = voxels->bridge_start[tet]; b < voxels->bridge_start[tet + 1]; b++)
            if (!pliant_bridge_severed(work->next, b))
                pliant_set_join(work->part, index_of(work, voxels->bridge[2 * b]),
                                index_of(work, voxels->bridge[2 * b + 1]));
        for (int32_t i = work->start[t]; i < work->start[t + 1]; i++) work->part[i] = pliant_set_root(work->part, i);
    }
}

/* Choose the largest fragment of each fine tetrahedron, which keeps the tetrahedron's number. */
static void choose_kept_fragments(cut_work *work, int32_t first)
{
    for (int32_t f = first; f < work->num_fragments; f++) {
        cut_fragment *one = work->fragment + f;
        one->stays = !one->was_chip;
        for (int32_t g = first; g < work->num_fragments && one->stays; g++) {
            const cut_fragment *other = work->fragment + g;
            if (g == f || other->was_chip || other->source != one->source) continue;
            one->stays = other->voxels < one->voxels || (other->voxels == one->voxels && f < g);
        }
    }
}

static pliant_status list_fragments(cut_work *work)
{
    const int32_t count = work->start[work->num_touched];
    int32_t fragments = 0;
    for (int32_t i = 0; i < count; i++) fragments += work->part[i] == i;
    work->fragment = pliant_calloc((size_t)fragments, sizeof *work->fragment);
    work->first = pliant_calloc((size_t)work->num_touched + 1, sizeof *work->first);
    if (!work->fragment || !work->first) return no_memory();
    for (int32_t t = 0; t < work->num_touched; t++) {
        const int32_t tet = work->touched[t], first = work->num_fragments;
        for (int32_t i = work->start[t]; i < work->start[t + 1]; i++) {
            if (work->part[i] != i) {
                work->part[i] = work->part[work->part[i]];
            } else {
                const int32_t was = pliant_voxels_fragment(work->voxels, work->cuts, work->voxel[i]);
                const bool own = cut_parent(work, was) == tet;
                work->fragment[work->num_fragments] = (cut_fragment){
                    .tet = tet, .source = own ? was : tet, .host = was, .was_chip = !own, .receiver = -1};
                work->part[i] = work->num_fragments++;
            }
            work->fragment[work->part[i]].voxels++;
        }
        choose_kept_fragments(work, first);
        work->first[t + 1] = work->num_fragments;
    }
    return PLIANT_OK;
}

pliant_status pliant_cut_find_touched(cut_work *work)
{
    work->next = pliant_calloc(1, sizeof *work->next);
    pliant_status status = work->next ? merge_severed(work) : no_memory();
    if (status == PLIANT_OK) status = list_touched(work);
    if (status == PLIANT_OK) status = make_tables(work);
    if (status != PLIANT_OK) return status;
    find_parts(work);
    return list_fragments(work);
}
