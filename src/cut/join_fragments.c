/* Count the links, diagonals and bridges that join fragments and tetrahedra, and assign each chip to the fragment with
 * which it shares most of them. */
#include "cut/cut_stages.h"

#include "base/fail.h"
#include "base/memory.h"

#include <string.h>

static pliant_status no_memory(void) { return pliant_fail_memory("the links between fragments"); }

/* ---- hash table of edges */

static uint32_t hash_of(int32_t a, int32_t b, int32_t size)
{
    const uint64_t mixed = ((uint64_t)(uint32_t)a << 32 | (uint32_t)b) * 0x9e3779b97f4a7c15u;
    return (uint32_t)(mixed >> 32) & (uint32_t)(size - 1);
}

/* Return the slot of an edge in the table, or the free slot where it belongs. */
static int32_t slot_of(const cut_work *work, int32_t a, int32_t b)
{
    uint32_t slot = hash_of(a, b, work->table_size);
    while (work->table[slot]) {
        const cut_edge *edge = work->edge + work->table[slot] - 1;
        if (edge->end[0] == a && edge->end[1] == b) break;
        slot = (slot + 1) & (uint32_t)(work->table_size - 1);
    }
    return (int32_t)slot;
}

int32_t pliant_cut_edge(const cut_work *work, int32_t a, int32_t b)
{
    if (work->num_edges == 0) return 0;
    const int32_t found = work->table[a < b ? slot_of(work, a, b) : slot_of(work, b, a)];
    return found ? work->edge[found - 1].weight : 0;
}

static pliant_status grow(cut_work *work)
{
    const int32_t size = work->table_size > 0 ? 2 * work->table_size : 1024;
    int32_t *table = pliant_calloc((size_t)size, sizeof *table);
    if (!table) return no_memory();
    cut_edge *edge = pliant_resize(work->edge, (size_t)size / 2, sizeof *edge);
    if (!edge) {
        pliant_free(table);
        return no_memory();
    }
    pliant_free(work->table);
    work->table = table;
    work->table_size = size;
    work->edge = edge;
    work->edge_capacity = size / 2;
    for (int32_t e = 0; e < work->num_edges; e++)
        work->table[slot_of(work, work->edge[e].end[0], work->edge[e].end[1])] = e + 1;
    return PLIANT_OK;
}

static pliant_status add_edge(cut_work *work, int32_t a, int32_t b, int32_t weight)
{
    if (a == b) return PLIANT_OK;
    if (work->num_edges == work->edge_capacity) {
        pliant_status status = grow(work);
        if (status != PLIANT_OK) return status;
    }
    const int32_t low = a < b ? a : b, high = a < b ? b : a, slot = slot_of(work, low, high);
    if (!work->table[slot]) {
        work->edge[work->num_edges] = (cut_edge){{low, high}, 0};
        work->table[slot] = ++work->num_edges;
    }
    work->edge[work->table[slot] - 1].weight += weight;
    return PLIANT_OK;
}

int32_t pliant_cut_end_of(const cut_work *work, int32_t voxel)
{
    const pliant_voxels *voxels = work->voxels;
    const int32_t tet = voxels->owner[voxel], state = cut_state(work, tet);
    if (state == 0) return tet;
    const int32_t place = pliant_voxel_in(voxels, tet, voxel);
    if (state > 0) return work->body->fine.num_tets + work->part[work->start[state - 1] + place];
    return work->cuts->voxel_fragment[work->cuts->voxel_start[-state - 1] + place];
}

/* One of the 18 neighbours of a voxel: its offset in the box and among all voxels, and the same offsets of the two
 * voxels through which a diagonal may pass. */
typedef struct neighbour {
    int8_t step[3];
    bool is_diagonal;
    ptrdiff_t place, via_place[2];
    int32_t voxel, via_voxel[2];
} neighbour;

static void find_neighbours(const cut_work *work, neighbour out[18])
{
    const int32_t *box = work->links.size, *all = work->voxels->geometry.size;
    const ptrdiff_t stride[3] = {1, box[0], (ptrdiff_t)box[0] * box[1]};
    const int32_t voxels[3] = {1, all[0], all[0] * all[1]};
    for (int n = 0; n < 18; n++) {
        neighbour *one = out + n;
        int ways = 0;
        *one = (neighbour){.voxel = 0};
        for (int d = 0; d < 3; d++) {
            const int step = n < 9 ? pliant_later_neighbours[n][d] : -pliant_later_neighbours[n - 9][d];
            one->step[d] = (int8_t)step;
            one->place += step * stride[d];
            one->voxel += step * voxels[d];
            if (step == 0) continue;
            one->via_place[ways] = step * stride[d];
            one->via_voxel[ways++] = step * voxels[d];
        }
        one->is_diagonal = ways == 2;
    }
}

/* Return pliant_joined for an existing neighbour.
 * is_near_severed_link: whether links near the voxel may be severed */
static bool is_joined(const cut_work *work, const neighbour *to, const int32_t *place, int32_t voxel,
                      const int32_t at[3], bool is_near_severed_link)
{
    if (is_near_severed_link) return pliant_joined(&work->links, voxel, at, to->step);
    if (!to->is_diagonal) return true;
    for (int via = 0; via < 2; via++)
        if (place[to->via_place[via]] || work->voxels->owner[voxel + to->via_voxel[via]] >= 0) return true;
    return false;
}

static pliant_status add_edges_of(cut_work *work, const neighbour around[18], int32_t i, const int32_t at[3])
{
    const pliant_voxels *voxels = work->voxels;
    const pliant_links *links = &work->links;
    const int32_t voxel = work->voxel[i], part = work->part[i], tets = work->body->fine.num_tets,
                  *size = voxels->geometry.size;
    const size_t here = (size_t)(at[0] - links->low[0]) +
                        (size_t)links->size[0] * ((size_t)(at[1] - links->low[1]) +
                                                  (size_t)links->size[1] * (size_t)(at[2] - links->low[2]));
    const int32_t *place = work->place + here;
    const bool is_near_severed_link = work->is_near_severed_link[here];
    bool inside = true;
    pliant_status status = PLIANT_OK;
    for (int d = 0; d < 3; d++) inside = inside && at[d] > 0 && at[d] + 1 < size[d];
    for (int n = 0; n < 18 && status == PLIANT_OK; n++) {
        const neighbour *to = around + n;
        const int32_t touched = place[to->place];
        if (touched && (n >= 9 || work->part[touched - 1] == part)) continue;
        const int32_t other = inside ? voxel + to->voxel : pliant_step_to(voxels, voxel, at, to->step);
        if (other < 0 || (!touched && voxels->owner[other] < 0) ||
            !is_joined(work, to, place, voxel, at, is_near_severed_link))
            continue;
        status =
            add_edge(work, tets + part, touched ? tets + work->part[touched - 1] : pliant_cut_end_of(work, other), 1);
    }
    return status;
}

pliant_status pliant_cut_find_edges(cut_work *work)
{
    const pliant_voxels *voxels = work->voxels;
    neighbour around[18];
    int32_t at[3] = {0}, last = -2;
    pliant_status status = grow(work);
    find_neighbours(work, around);
    for (int32_t i = 0; i < work->start[work->num_touched] && status == PLIANT_OK; i++) {
        pliant_place_after(voxels, work->voxel[i], &last, at);
        status = add_edges_of(work, around, i, at);
    }
    for (int32_t t = 0; t < work->num_touched; t++) {
        const int32_t tet = work->touched[t];
        for (int32_t e = voxels->adjacent_start[tet]; e < voxels->adjacent_start[tet + 1] && status == PLIANT_OK; e++) {
            const int32_t bridge = voxels->adjacent[e], *ends = voxels->bridge + 2 * bridge;
            const int32_t other = voxels->owner[ends[voxels->owner[ends[0]] == tet]];
            if ((cut_state(work, other) > 0 && other < tet) || pliant_bridge_severed(work->next, bridge)) continue;
            status = add_edge(work, pliant_cut_end_of(work, ends[0]), pliant_cut_end_of(work, ends[1]), 1);
        }
    }
    return status;
}

/* ---- chips */

typedef struct chips {
    cut_work *work;
    /* (fragments + 1) component connected by faces; the last entry represents all untouched tetrahedra */
    int32_t *group;
    int32_t *voxels;   /* (fragments + 1) voxels per component */
    int32_t *best, *weight; /* (fragments) element outside the component with the heaviest edge, and its weight */
} chips;

/* Return whether an edge connects elements mechanically: they have a common face, or are parts of one tetrahedron. */
static bool holds(const cut_work *work, int32_t a, int32_t b)
{
    const int32_t s = cut_tet_of(work, a), t = cut_tet_of(work, b);
    return s == t || cut_share_face(work, s, t);
}

static int32_t group_of(const chips *all, int32_t end)
{
    const int32_t tets = all->work->body->fine.num_tets;
    return pliant_set_root(all->group, end < tets ? 0 : end - tets + 1);
}

/* Find the connected components, and the heaviest edge of each fragment that leaves its component. */
static void find_groups(chips *all)
{
    const cut_work *work = all->work;
    const int32_t tets = work->body->fine.num_tets;
    for (int32_t g = 0; g <= work->num_fragments; g++) {
        all->group[g] = g;
        all->voxels[g] = 0;
    }
    for (int32_t e = 0; e < work->num_edges; e++) {
        const int32_t a = cut_receiver(work, work->edge[e].end[0]), b = cut_receiver(work, work->edge[e].end[1]);
        if (a != b && holds(work, a, b))
            pliant_set_join(all->group, a < tets ? 0 : a - tets + 1, b < tets ? 0 : b - tets + 1);
    }
    for (int32_t f = 0; f < work->num_fragments; f++) {
        if (work->fragment[f].receiver < 0) all->voxels[group_of(all, tets + f)] += work->fragment[f].voxels;
        all->best[f] = -1;
        all->weight[f] = 0;
    }
    for (int32_t e = 0; e < work->num_edges; e++) {
        const int32_t ends[2] = {cut_receiver(work, work->edge[e].end[0]), cut_receiver(work, work->edge[e].end[1])};
        if (ends[0] == ends[1] || group_of(all, ends[0]) == group_of(all, ends[1])) continue;
        for (int v = 0; v < 2; v++) {
            const int32_t f = ends[v] - tets, other = ends[1 - v], weight = work->edge[e].weight;
            if (f < 0 || weight < all->weight[f] || (weight == all->weight[f] && other > all->best[f])) continue;
            all->best[f] = other;
            all->weight[f] = weight;
        }
    }
}

/* Assign the fragments of components smaller than a tetrahedron that no face, but links connect to another component.
 * The smallest components come first. */
static pliant_status assign_component_chips(chips *all)
{
    cut_work *work = all->work;
    const int32_t tets = work->body->fine.num_tets;
    for (;;) {
        int32_t chosen = -1;
        find_groups(all);
        for (int32_t f = 0; f < work->num_fragments; f++) {
            const cut_fragment *one = work->fragment + f;
            const int32_t group = group_of(all, tets + f);
            if (one->receiver >= 0 || one->stays || all->best[f] < 0 || group == 0) continue;
            const int32_t to = group_of(all, all->best[f]);
            if (all->voxels[group] > work->voxels->start[one->tet + 1] - work->voxels->start[one->tet]) continue;
            /* the other component is smaller and goes first */
            if (to != 0 && all->voxels[to] < all->voxels[group]) continue;
            if (chosen >= 0) {
                const int32_t minimum = all->voxels[group_of(all, tets + chosen)];
                if (all->voxels[group] > minimum ||
                    (all->voxels[group] == minimum && one->voxels >= work->fragment[chosen].voxels))
                    continue;
            }
            chosen = f;
        }
        if (chosen < 0) return PLIANT_OK;
        work->fragment[chosen].receiver = all->best[chosen];
    }
}

/* Assign fragments of few voxels to their heaviest neighbour if all their other neighbours are connected to it as
 * well. */
static void assign_small_fragments(chips *all)
{
    cut_work *work = all->work;
    const int32_t tets = work->body->fine.num_tets;
    for (int32_t f = 0; f < work->num_fragments; f++) {
        cut_fragment *one = work->fragment + f;
        const int32_t whole = work->voxels->start[one->tet + 1] - work->voxels->start[one->tet];
        if (one->receiver >= 0 || one->stays || one->voxels >= CUT_MIN_FRACTION * whole) continue;
        int32_t best = -1, maximum = 0;
        for (int32_t e = 0; e < work->num_edges; e++) {
            const int32_t a = cut_receiver(work, work->edge[e].end[0]), b = cut_receiver(work, work->edge[e].end[1]);
            if (a == b || (a != tets + f && b != tets + f)) continue;
            const int32_t other = a == tets + f ? b : a;
            if (work->edge[e].weight < maximum || (work->edge[e].weight == maximum && other > best)) continue;
            best = other;
            maximum = work->edge[e].weight;
        }
        bool needed = best < 0;
        for (int32_t e = 0; e < work->num_edges && !needed; e++) {
            const int32_t a = cut_receiver(work, work->edge[e].end[0]), b = cut_receiver(work, work->edge[e].end[1]);
            if (a == b || (a != tets + f && b != tets + f)) continue;
            const int32_t other = a == tets + f ? b : a;
            needed = other != best && !(pliant_cut_edge(work, best, other) && holds(work, best, other));
        }
        if (!needed) one->receiver = best;
    }
}

/* Return the element that shares the heaviest edge with a chip; -1: none.
 * on_chips: also consider other chips that moved with fragments of other tetrahedra
 * host: consider only elements that moved with the same fragment before the cut */
static int32_t find_heaviest_neighbour(const cut_work *work, int32_t f, bool on_chips, bool host)
{
    const int32_t tets = work->body->fine.num_tets;
    int32_t best = -1, maximum = 0;
    for (int32_t e = 0; e < work->num_edges; e++) {
        const int32_t *end = work->edge[e].end;
        if (end[0] != tets + f && end[1] != tets + f) continue;
        const int32_t other = cut_receiver(work, end[0] == tets + f ? end[1] : end[0]), weight = work->edge[e].weight;
        const bool chip = other >= tets && work->fragment[other - tets].was_chip;
        if (other == tets + f || (chip && !on_chips) || weight < maximum || (weight == maximum && other > best))
            continue;
        if (host && (other < tets ? other : work->fragment[other - tets].host) != work->fragment[f].host) continue;
        best = other;
        maximum = weight;
    }
    return best;
}

/* Assign the chips of earlier cuts again. A chip stays with its previous fragment if they are still joined, even
 * through other chips, because the nodes of its tetrahedron may be far away. */
static void reassign_chips(cut_work *work)
{
    static const struct { bool chips, host; } passes[3] = {{false, true}, {false, false}, {true, false}};
    for (int pass = 0; pass < 3; pass++)
        for (bool more = true; more;) {
            more = false;
            for (int32_t f = 0; f < work->num_fragments; f++) {
                cut_fragment *one = work->fragment + f;
                const int32_t to = one->was_chip && one->receiver < 0
                                       ? find_heaviest_neighbour(work, f, passes[pass].chips, passes[pass].host)
                                       : -1;
                if (to < 0) continue;
                one->receiver = to;
                more = true;
            }
        }
}

/* Add the edges of each assigned chip to the element that received it. */
static pliant_status transfer_edges(cut_work *work)
{
    const int32_t count = work->num_edges;
    pliant_status status = PLIANT_OK;
    for (int32_t e = 0; e < count && status == PLIANT_OK; e++) {
        const int32_t *end = work->edge[e].end, a = cut_receiver(work, end[0]), b = cut_receiver(work, end[1]);
        if (a != end[0] || b != end[1]) status = add_edge(work, a, b, work->edge[e].weight);
    }
    return status;
}

pliant_status pliant_cut_assign_chips(cut_work *work)
{
    chips all = {.work = work};
    const size_t count = (size_t)work->num_fragments + 1;
    all.group = pliant_calloc(count, sizeof *all.group);
    all.voxels = pliant_calloc(count, sizeof *all.voxels);
    all.best = pliant_calloc(count, sizeof *all.best);
    all.weight = pliant_calloc(count, sizeof *all.weight);
    reassign_chips(work);
    pliant_status status =
        all.group && all.voxels && all.best && all.weight ? assign_component_chips(&all) : no_memory();
    if (status == PLIANT_OK) {
        assign_small_fragments(&all);
        status = transfer_edges(work);
    }
    PLIANT_FREE(all.group, all.voxels, all.best, all.weight);
    return status;
}
