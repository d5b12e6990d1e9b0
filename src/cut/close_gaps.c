/* Close the gaps between the sweeps of one stroke. Each sweep is tested against the tissue at its own step. A link is
 * straight, but the tissue around it bends and moves between two steps. Where one sweep ends and the next begins, both
 * can miss a link between voxels on opposite sides. Such a link is recognized by the severed links adjacent to it. */
#include "cut/cut_stages.h"

typedef struct seam {
    cut_work *work;
    pliant_links before;  /* severed links before this sweep */
    int32_t num_links;    /* number of links that the sweep itself has severed */
} seam;

static bool is_owned(const pliant_voxels *voxels, int32_t voxel, const int32_t at[3], int axis, int direction)
{
    if (at[axis] + direction < 0 || at[axis] + direction >= voxels->geometry.size[axis]) return false;
    return voxels->owner[voxel + direction * pliant_stride_of(voxels, axis)] >= 0;
}

static uint32_t link_from(const pliant_voxels *voxels, int32_t voxel, int axis, int direction)
{
    return 4 * (uint32_t)(direction > 0 ? voxel : voxel - pliant_stride_of(voxels, axis)) + (uint32_t)axis;
}

static bool is_new(const seam *all, uint32_t link)
{
    const int32_t found = pliant_lower_bound(all->work->link, all->num_links, link);
    return found < all->num_links && all->work->link[found] == link;
}

/* Return whether the link from a voxel along an axis exists and is severed. */
static bool is_severed(const seam *all, int32_t voxel, const int32_t at[3], int axis, int direction)
{
    if (!is_owned(all->work->voxels, voxel, at, axis, direction)) return false;
    return !pliant_linked(&all->before, voxel, at, axis, direction) ||
           is_new(all, link_from(all->work->voxels, voxel, axis, direction));
}

static bool is_severed_by_cut(const pliant_cuts *cuts, int32_t cut, uint32_t link)
{
    const int32_t begin = cut > 0 ? cuts->cut_end[cut - 1] : 0;
    int32_t links = cuts->cut_end[cut] - begin;
    while (links > 0 && cuts->severed[begin + links - 1] % 4 == 3) links--; /* skip the bridges */
    const int32_t found = pliant_lower_bound(cuts->severed + begin, links, link);
    return found < links && cuts->severed[begin + found] == link;
}

/* Return whether an earlier sweep of this stroke severed a link. Other blades may have cut in between. */
static bool is_severed_by_stroke(const seam *all, uint32_t link)
{
    const pliant_cuts *cuts = all->work->cuts;
    const uint32_t *now = all->work->stroke;
    for (int32_t i = cuts ? cuts->num_cuts - 1 : -1; i >= 0; i--) {
        const uint32_t *then = cuts->stroke + 2 * i;
        if (then[0] == now[0] && then[1] == now[1] && is_severed_by_cut(cuts, i, link)) return true;
        /* an earlier stroke of the same blade */
        if (then[0] == now[0] && then[1] > 0 && then[1] < now[1]) return false;
    }
    return false;
}

/* Sever missed links around a voxel. This sweep has severed the voxel's link in direction `beyond`, and its link in the
 * opposite direction is intact. Consider an adjacent voxel perpendicular to the axis. The two voxels
 * lie on opposite sides under two conditions: an earlier sweep of the stroke has severed its link in the opposite
 * direction, and its link in direction `beyond` is intact. The link between the two voxels is then severed. */
static pliant_status sever_missed_links(const seam *all, int32_t voxel, const int32_t at[3], int axis, int beyond)
{
    const pliant_voxels *voxels = all->work->voxels;
    pliant_status status = PLIANT_OK;
    if (is_severed(all, voxel, at, axis, -beyond)) return PLIANT_OK;
    for (int n = 2; n < 6 && status == PLIANT_OK; n++) {
        const int across = (axis + n / 2) % 3, direction = n % 2 ? 1 : -1;
        const int32_t other = voxel + direction * pliant_stride_of(voxels, across);
        int32_t there[3] = {at[0], at[1], at[2]};
        there[across] += direction;
        if (!is_owned(voxels, voxel, at, across, direction) || is_severed(all, voxel, at, across, direction)) continue;
        if (!is_owned(voxels, other, there, axis, -beyond) || is_severed(all, other, there, axis, beyond)) continue;
        if (!is_severed(all, other, there, axis, -beyond) ||
            !is_severed_by_stroke(all, link_from(voxels, other, axis, -beyond)))
            continue;
        status = pliant_cut_add_link(all->work, link_from(voxels, voxel, across, direction), 0);
    }
    return status;
}

pliant_status pliant_cut_close_seam(cut_work *work)
{
    const seam all = {
        .work = work, .before = {.voxels = work->voxels, .cuts = work->cuts}, .num_links = work->num_links};
    pliant_status status = PLIANT_OK;
    for (int32_t i = 0; i < all.num_links && status == PLIANT_OK; i++) {
        const int axis = (int)(work->link[i] % 4);
        const int32_t voxel = (int32_t)(work->link[i] / 4);
        int32_t at[3];
        pliant_place_of(work->voxels, voxel, at);
        status = sever_missed_links(&all, voxel, at, axis, 1);
        at[axis]++;
        if (status == PLIANT_OK)
            status = sever_missed_links(&all, voxel + pliant_stride_of(work->voxels, axis), at, axis, -1);
    }
    return status == PLIANT_OK && work->num_links > all.num_links ? pliant_cut_sort_severed(work) : status;
}
