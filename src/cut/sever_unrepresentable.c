/* Sever links that the mesh cannot represent. Assigned chips may leave a few links between two fragments that have no
 * node in common. These links are severed, so that mesh and voxels have the same connectivity. */
#include "cut/cut_stages.h"

#include "base/buffer.h"
#include "base/fail.h"
#include "base/memory.h"

#include <string.h>

typedef struct unrepresentable {
    cut_work *work;
    int32_t count, *pair;      /* (count x 2) ends of the edges */
    int32_t num_links, num_bridges, link_capacity;
    uint32_t *link;            /* links to sever in addition */
    int32_t *bridge;           /* bridges of touched tetrahedra to sever in addition */
} unrepresentable;

static pliant_status no_memory(void) { return pliant_fail_memory("the fragments that no fixed node holds"); }

static bool have_node_in_common(const cut_work *work, int32_t a, int32_t b)
{
    const int32_t *of_a = cut_corners(work, cut_number(work, a)), *of_b = cut_corners(work, cut_number(work, b));
    for (int v = 0; v < 4; v++)
        for (int w = 0; w < 4; w++)
            if (of_a[v] == of_b[w]) return true;
    return false;
}

/* List the edges whose ends have no common node; there are few or none. */
static pliant_status list_pairs(unrepresentable *all)
{
    const cut_work *work = all->work;
    for (int32_t e = 0; e < work->num_edges; e++) {
        const int32_t a = cut_receiver(work, work->edge[e].end[0]), b = cut_receiver(work, work->edge[e].end[1]);
        if (a == b || have_node_in_common(work, a, b)) continue;
        int32_t *longer = pliant_resize(all->pair, (size_t)all->count + 1, 2 * sizeof *longer);
        if (!longer) return no_memory();
        all->pair = longer;
        all->pair[2 * all->count] = a;
        all->pair[2 * all->count++ + 1] = b;
    }
    return PLIANT_OK;
}

static int32_t joint_node(const cut_work *work, int32_t end)
{
    return cut_corners(work, work->joint[end] / 4)[work->joint[end] % 4];
}

/* Remove the edges whose ends are connected through other tetrahedra or joints. */
static pliant_status remove_connected_pairs(unrepresentable *all)
{
    const cut_work *work = all->work;
    int32_t *part = pliant_calloc((size_t)work->num_nodes, sizeof *part), kept = 0;
    if (!part) return no_memory();
    for (int32_t n = 0; n < work->num_nodes; n++) part[n] = n;
    for (int32_t t = 0; t < work->num_tets; t++) {
        const int32_t *nodes = cut_corners(work, t);
        for (int v = 1; v < 4; v++) pliant_set_join(part, nodes[0], nodes[v]);
    }
    for (int32_t j = 0; j < work->num_joints; j++)
        pliant_set_join(part, joint_node(work, 2 * j), joint_node(work, 2 * j + 1));
    for (int32_t p = 0; p < all->count; p++) {
        const int32_t *pair = all->pair + 2 * p;
        if (pliant_set_root(part, cut_corners(work, cut_number(work, pair[0]))[0]) ==
            pliant_set_root(part, cut_corners(work, cut_number(work, pair[1]))[0]))
            continue;
        memmove(all->pair + 2 * kept++, pair, 2 * sizeof *pair);
    }
    all->count = kept;
    pliant_free(part);
    return PLIANT_OK;
}

static bool is_unrepresentable(const unrepresentable *all, int32_t a, int32_t b)
{
    for (int32_t p = 0; p < all->count; p++)
        if ((all->pair[2 * p] == a && all->pair[2 * p + 1] == b) ||
            (all->pair[2 * p] == b && all->pair[2 * p + 1] == a))
            return true;
    return false;
}

/* Sever the link from a voxel along an axis if it is intact. */
static pliant_status sever_link(unrepresentable *all, int32_t voxel, const int32_t at[3], int axis, int direction)
{
    const pliant_links *links = &all->work->links;
    const int32_t lower = direction > 0 ? voxel : voxel - pliant_stride_of(links->voxels, axis);
    if (!pliant_linked(links, voxel, at, axis, direction)) return PLIANT_OK;
    if (!pliant_reserve(&all->link, &all->link_capacity, all->num_links, 64, sizeof *all->link)) return no_memory();
    all->link[all->num_links++] = 4 * (uint32_t)lower + (uint32_t)axis;
    return PLIANT_OK;
}

/* Sever the links of a voxel. For a diagonal, the first link of both paths is severed. */
static pliant_status sever_around(unrepresentable *all, int32_t i)
{
    const cut_work *work = all->work;
    const pliant_voxels *voxels = work->voxels;
    const int32_t voxel = work->voxel[i], own = cut_receiver(work, work->body->fine.num_tets + work->part[i]);
    int32_t at[3];
    pliant_status status = PLIANT_OK;
    pliant_place_of(voxels, voxel, at);
    for (int n = 0; n < 18 && status == PLIANT_OK; n++) {
        const int8_t *behind = pliant_later_neighbours[n % 9], sign = n < 9 ? 1 : -1;
        const int8_t step[3] = {(int8_t)(sign * behind[0]), (int8_t)(sign * behind[1]), (int8_t)(sign * behind[2])};
        const int32_t other = pliant_step_to(voxels, voxel, at, step);
        if (other < 0 || voxels->owner[other] < 0 ||
            !is_unrepresentable(all, own, cut_receiver(work, pliant_cut_end_of(work, other))))
            continue;
        for (int d = 0; d < 3 && status == PLIANT_OK; d++)
            if (step[d] && voxels->owner[voxel + step[d] * pliant_stride_of(voxels, d)] >= 0)
                status = sever_link(all, voxel, at, d, step[d]);
    }
    return status;
}

static pliant_status sever_bridges(unrepresentable *all)
{
    const cut_work *work = all->work;
    const pliant_voxels *voxels = work->voxels;
    int32_t maximum = 0;
    for (int32_t t = 0; t < work->num_touched; t++)
        maximum += voxels->adjacent_start[work->touched[t] + 1] - voxels->adjacent_start[work->touched[t]];
    if (!(all->bridge = pliant_calloc((size_t)maximum + 1, sizeof *all->bridge))) return no_memory();
    for (int32_t t = 0; t < work->num_touched; t++)
        for (int32_t e = voxels->adjacent_start[work->touched[t]]; e < voxels->adjacent_start[work->touched[t] + 1];
             e++) {
            const int32_t *ends = voxels->bridge + 2 * voxels->adjacent[e];
            if (!pliant_bridge_severed(work->next, voxels->adjacent[e]) &&
                is_unrepresentable(all, cut_receiver(work, pliant_cut_end_of(work, ends[0])),
                                   cut_receiver(work, pliant_cut_end_of(work, ends[1]))))
                all->bridge[all->num_bridges++] = voxels->adjacent[e];
        }
    return PLIANT_OK;
}

/* Append the additional links to the links that the blade severed; they have no area of the sweep. */
static pliant_status add_all(const unrepresentable *all)
{
    cut_work *work = all->work;
    uint32_t *link = pliant_resize(work->link, (size_t)work->num_links + (size_t)all->num_links + 1, sizeof *link);
    if (link) work->link = link;
    double *area = pliant_resize(work->link_area, (size_t)work->num_links + (size_t)all->num_links + 1, sizeof *area);
    if (area) work->link_area = area;
    int32_t *bridge =
        pliant_resize(work->bridge, (size_t)work->num_bridges + (size_t)all->num_bridges + 1, sizeof *bridge);
    if (bridge) work->bridge = bridge;
    if (!link || !area || !bridge) return no_memory();
    for (int32_t i = 0; i < all->num_links; i++) {
        link[work->num_links] = all->link[i];
        area[work->num_links++] = 0;
    }
    for (int32_t i = 0; i < all->num_bridges; i++) bridge[work->num_bridges++] = all->bridge[i];
    work->link_capacity = work->num_links;
    work->bridge_capacity = work->num_bridges;
    return pliant_cut_sort_severed(work);
}

pliant_status pliant_cut_sever_unrepresentable(cut_work *work, bool *changed)
{
    unrepresentable all = {.work = work};
    pliant_status status = list_pairs(&all);
    if (status == PLIANT_OK && all.count > 0) status = remove_connected_pairs(&all);
    if (status == PLIANT_OK && all.count > 0) {
        for (int32_t i = 0; i < work->start[work->num_touched] && status == PLIANT_OK; i++)
            status = sever_around(&all, i);
        if (status == PLIANT_OK) status = sever_bridges(&all);
        if (status == PLIANT_OK) status = add_all(&all);
    }
    *changed = all.num_links + all.num_bridges > 0;
    PLIANT_FREE(all.pair, all.link, all.bridge);
    return status;
}
