/* What a body before has, and a cut has not changed. */
#include "pliant/memory.h"
#include "warp/parts_maker.h"

/* Differences are told by cubes of so many voxels along each axis. */
enum { REGION = 4 };

enum { OTHER_VOXELS = 1, OTHER_NODES = 2 };

/* marks the regions of a box, if there is something to mark; whether one of them has a mark that is asked for */
static bool over_regions(part_maker *work, const part_box *box, uint8_t mark, uint8_t asked)
{
    int32_t at[3];
    for (at[2] = box->low[2] / REGION; at[2] <= (box->low[2] + box->size[2] - 1) / REGION; at[2]++)
        for (at[1] = box->low[1] / REGION; at[1] <= (box->low[1] + box->size[1] - 1) / REGION; at[1]++)
            for (at[0] = box->low[0] / REGION; at[0] <= (box->low[0] + box->size[0] - 1) / REGION; at[0]++) {
                uint8_t *other = &work->other[part_index_of(work->regions, at)];
                if (*other & asked) return true;
                *other |= mark;
            }
    return false;
}

static void mark_tet(part_maker *work, int32_t tet, uint8_t mark)
{
    part_shape at;
    part_box box;
    pliant_parts_shape(work, tet, &at);
    pliant_parts_box(work, &at, &box);
    over_regions(work, &box, mark, 0);
}

static void mark_link(part_maker *work, uint32_t link)
{
    part_box box = {{0}, {1, 1, 1}, 0};
    pliant_place_of(work->voxels, (int32_t)(link / 4), box.low);
    box.size[link % 4]++;
    over_regions(work, &box, OTHER_VOXELS, 0);
}

static void mark_links(part_maker *work)
{
    const pliant_cuts *old = work->body_before->cuts, *now = work->cuts;
    int32_t o = 0, n = 0;
    while (o < old->num_links || n < now->num_links) {
        const bool both = o < old->num_links && n < now->num_links && old->link[o] == now->link[n];
        if (!both) mark_link(work, n == now->num_links || (o < old->num_links && old->link[o] < now->link[n]) ? old->link[o] : now->link[n]);
        const bool ahead = both || n == now->num_links || (o < old->num_links && old->link[o] < now->link[n]);
        if (both || !ahead) n++;
        if (both || ahead) o++;
    }
}

/* Tetrahedra at load whose fragments or carriers differ. */
static void mark_carriers(part_maker *work)
{
    const pliant_cuts *old = work->body_before->cuts, *now = work->cuts;
    int32_t o = 0, n = 0;
    while (o < old->num_tets || n < now->num_tets) {
        const bool in_old = o < old->num_tets && (n == now->num_tets || old->tet[o] <= now->tet[n]);
        const bool in_now = n < now->num_tets && (o == old->num_tets || now->tet[n] <= old->tet[o]);
        if (!(in_old && in_now) ||
            !part_same_list(old->fragment + old->start[o], old->start[o + 1] - old->start[o], now->fragment + now->start[n], now->start[n + 1] - now->start[n]) ||
            !part_same_list(old->voxel_fragment + old->voxel_start[o], old->voxel_start[o + 1] - old->voxel_start[o],
                       now->voxel_fragment + now->voxel_start[n], now->voxel_start[n + 1] - now->voxel_start[n]))
            mark_tet(work, in_old ? old->tet[o] : now->tet[n], OTHER_VOXELS);
        o += in_old;
        n += in_now;
    }
}

static void mark_nodes(part_maker *work)
{
    const pliant_mesh *old = &work->body_before->fine, *now = &work->body->fine;
    for (int32_t t = 0; t < old->num_tets || t < now->num_tets; t++) {
        const pliant_body *of = t < now->num_tets ? work->body : work->body_before;
        if (t < old->num_tets && t < now->num_tets && memcmp(old->tets + 4 * (size_t)t, now->tets + 4 * (size_t)t, 4 * sizeof *now->tets) == 0) continue;
        mark_tet(work, of->tet_parent ? of->tet_parent[t] : t, OTHER_NODES);
    }
}

pliant_status pliant_parts_compare(part_maker *work, const pliant_body *body_before, const pliant_parts *before)
{
    if (!before || !body_before || body_before->voxels != work->voxels) return PLIANT_OK;
    for (int d = 0; d < 3; d++) work->regions[d] = (work->voxels->geometry.size[d] - 1) / REGION + 1;
    if (!(work->other = pliant_calloc((size_t)work->regions[0] * (size_t)work->regions[1] * (size_t)work->regions[2], 1))) return pliant_parts_no_memory();
    if (!pliant_parts_grow(&work->labels, (size_t)before->num_labels)) return pliant_parts_no_memory();
    work->labels.count = 0;
    work->body_before = body_before;
    work->before = before;
    mark_links(work);
    mark_carriers(work);
    mark_nodes(work);
    return PLIANT_OK;
}

/* The box of a tetrahedron as it was before, or that it had none; false: it may be another one now. */
bool pliant_parts_take_before(part_maker *work, int32_t tet, pliant_status *status)
{
    const pliant_parts *from = work->before;
    if (!from) return false;
    pliant_parts_shape(work, tet, &work->at);
    pliant_parts_box(work, &work->at, &work->box);
    const int32_t old = from->view.elements[tet].box;
    if (over_regions(work, &work->box, 0, OTHER_VOXELS | (old >= 0 && from->by_node[old] ? OTHER_NODES : 0))) return false;
    if (old < 0) return true;
    const part_box *box = &from->view.boxes[old];
    const size_t count = (size_t)box->size[0] * (size_t)box->size[1] * (size_t)box->size[2];
    const int32_t carriers = from->carrier_start[old + 1] - from->carrier_start[old];
    work->first_carrier = (int32_t)work->carriers.count;
    int32_t *carrier = pliant_parts_grow(&work->carriers, (size_t)carriers);
    uint16_t *labels = carrier ? pliant_parts_add_box(work, tet, box, count, from->by_node[old], old) : NULL;
    bool good = labels != NULL;
    if (good) {
        memcpy(carrier, from->carrier + from->carrier_start[old], (size_t)carriers * sizeof *carrier);
        memcpy(labels, from->view.labels + box->first, count * sizeof *labels);
    }
    while (work->guest_before < from->num_guests && from->guests[work->guest_before].host < tet) work->guest_before++;
    for (int32_t g = work->guest_before; good && g < from->num_guests && from->guests[g].host == tet; g++) {
        part_guest *guest = pliant_parts_grow(&work->guests, 1);
        good = guest != NULL;
        if (good) *guest = from->guests[g];
    }
    *status = good ? PLIANT_OK : pliant_parts_no_memory();
    return true;
}
