/* Find the differences between a body and the previous one; parts elsewhere are reused. */
#include "base/memory.h"
#include "warp/parts_maker.h"

enum { OTHER_VOXELS = 1, OTHER_NODES = 2 };

typedef struct comparison {
    const part_maker *work;
    const pliant_body *before;
    const part_hosts *hosts;
    part_changes *out;
} comparison;

static void mark_box(const comparison *both, const part_box *box, uint8_t mark)
{
    part_changes *out = both->out;
    int32_t at[3], low[3], high[3];
    for (int d = 0; d < 3; d++) {
        low[d] = box->low[d] / PART_REGION;
        high[d] = (box->low[d] + box->size[d] - 1) / PART_REGION;
        if (low[d] < out->low[d]) out->low[d] = low[d];
        if (high[d] > out->high[d]) out->high[d] = high[d];
    }
    for (at[2] = low[2]; at[2] <= high[2]; at[2]++)
        for (at[1] = low[1]; at[1] <= high[1]; at[1]++)
            for (at[0] = low[0]; at[0] <= high[0]; at[0]++) out->other[part_index_of(out->regions, at)] |= mark;
}

static void mark_voxel(const comparison *both, int32_t voxel)
{
    part_box box = {{0}, {1, 1, 1}, 0};
    pliant_place_of(both->work->voxels, voxel, box.low);
    mark_box(both, &box, OTHER_VOXELS);
}

static void mark_link(const comparison *both, uint32_t link)
{
    part_box box = {{0}, {1, 1, 1}, 0};
    pliant_place_of(both->work->voxels, (int32_t)(link / 4), box.low);
    box.size[link % 4]++;
    mark_box(both, &box, OTHER_VOXELS);
}

static void mark_links(const comparison *both)
{
    const pliant_cuts *old = both->before->cuts, *now = both->work->cuts;
    int32_t o = 0, n = 0;
    while (o < old->num_links || n < now->num_links) {
        const bool both_have = o < old->num_links && n < now->num_links && old->link[o] == now->link[n];
        const bool ahead = both_have || n == now->num_links || (o < old->num_links && old->link[o] < now->link[n]);
        if (!both_have) mark_link(both, ahead ? old->link[o] : now->link[n]);
        if (both_have || !ahead) n++;
        if (both_have || ahead) o++;
    }
}

/* Mark the voxels of an initial tetrahedron that move with another tetrahedron than before.
 * o, n: index in the previous and the current cuts; -1: not cut */
static void mark_carriers_of(const comparison *both, int32_t tet, int32_t o, int32_t n)
{
    const pliant_voxels *voxels = both->work->voxels;
    const pliant_cuts *old = both->before->cuts, *now = both->work->cuts;
    const int32_t *was = o < 0 ? NULL : old->voxel_fragment + old->voxel_start[o],
                  *is = n < 0 ? NULL : now->voxel_fragment + now->voxel_start[n];
    if (o < 0 || n < 0 ||
        !part_same_list(old->fragment + old->start[o], old->start[o + 1] - old->start[o], now->fragment + now->start[n],
                        now->start[n + 1] - now->start[n]))
        both->out->listed[both->out->num_listed++] = tet;
    if (was == is) return;
    for (int32_t v = voxels->start[tet]; v < voxels->start[tet + 1]; v++) {
        const int32_t in = v - voxels->start[tet];
        if ((was ? was[in] : tet) != (is ? is[in] : tet)) mark_voxel(both, voxels->voxel[v]);
    }
}

static void mark_carriers(const comparison *both)
{
    const pliant_cuts *old = both->before->cuts, *now = both->work->cuts;
    int32_t o = 0, n = 0;
    while (o < old->num_tets || n < now->num_tets) {
        const bool in_old = o < old->num_tets && (n == now->num_tets || old->tet[o] <= now->tet[n]);
        const bool in_now = n < now->num_tets && (o == old->num_tets || now->tet[n] <= old->tet[o]);
        mark_carriers_of(both, in_old ? old->tet[o] : now->tet[n], in_old ? o : -1, in_now ? n : -1);
        o += in_old;
        n += in_now;
    }
}

static bool has_other_nodes(const comparison *both, int32_t tet)
{
    const pliant_mesh *old = &both->before->fine, *now = &both->work->body->fine;
    return tet >= old->num_tets || tet >= now->num_tets ||
           memcmp(old->tets + 4 * (size_t)tet, now->tets + 4 * (size_t)tet, 4 * sizeof *now->tets) != 0;
}

static void mark_nodes_of(const comparison *both, int32_t tet)
{
    const pliant_body *of = tet < both->work->body->fine.num_tets ? both->work->body : both->before;
    if (has_other_nodes(both, tet))
        mark_box(both, both->hosts->box + (of->tet_parent ? of->tet_parent[tet] : tet), OTHER_NODES);
}

/* Mark the regions where the carriers of voxels have other nodes: their own tetrahedra, and the ones whose chips they
 * carry. */
static void mark_nodes(const comparison *both)
{
    const pliant_body *old = both->before, *now = both->work->body;
    const bool listed = now->changes.since == old->revision;
    for (int32_t i = 0; listed && i < now->changes.num_touched; i++) mark_nodes_of(both, now->changes.touched[i]);
    for (int32_t t = listed ? old->fine.num_tets : 0; t < old->fine.num_tets || t < now->fine.num_tets; t++)
        mark_nodes_of(both, t);
    for (int32_t c = 0; c < now->cuts->num_chips; c++)
        if (has_other_nodes(both, now->cuts->chip[2 * c + 1]))
            mark_box(both, both->hosts->box + now->cuts->chip[2 * c], OTHER_NODES);
}

pliant_status pliant_parts_compare(const part_maker *work, const pliant_body *body_before, const part_hosts *hosts,
                                   part_changes *out)
{
    const comparison both = {.work = work, .before = body_before, .hosts = hosts, .out = out};
    size_t regions = 1;
    for (int d = 0; d < 3; d++) {
        out->regions[d] = (work->voxels->geometry.size[d] - 1) / PART_REGION + 1;
        regions *= (size_t)out->regions[d];
        out->low[d] = out->regions[d];
        out->high[d] = -1;
    }
    out->other = pliant_calloc(regions, 1);
    out->listed =
        pliant_calloc((size_t)body_before->cuts->num_tets + (size_t)work->cuts->num_tets + 1, sizeof *out->listed);
    if (!out->other || !out->listed) return pliant_parts_no_memory();
    mark_links(&both);
    mark_carriers(&both);
    mark_nodes(&both);
    return PLIANT_OK;
}

void pliant_part_changes_free(part_changes *changes)
{
    pliant_free(changes->other);
    pliant_free(changes->listed);
}

bool pliant_parts_differ(const part_changes *changes, const part_box *box, bool by_node)
{
    const uint8_t mask = by_node ? OTHER_VOXELS | OTHER_NODES : OTHER_VOXELS;
    int32_t at[3], low[3], high[3];
    for (int d = 0; d < 3; d++) {
        low[d] = box->low[d] / PART_REGION;
        high[d] = (box->low[d] + box->size[d] - 1) / PART_REGION;
        if (low[d] > changes->high[d] || high[d] < changes->low[d]) return false;
    }
    for (at[2] = low[2]; at[2] <= high[2]; at[2]++)
        for (at[1] = low[1]; at[1] <= high[1]; at[1]++)
            for (at[0] = low[0]; at[0] <= high[0]; at[0]++)
                if (changes->other[part_index_of(changes->regions, at)] & mask) return true;
    return false;
}

bool pliant_parts_differ_in(const part_changes *changes, const int32_t cube[3])
{
    enum { IN_CUBE = PART_CUBE / PART_REGION };
    int32_t at[3], high[3];
    for (int d = 0; d < 3; d++)
        high[d] = IN_CUBE * (cube[d] + 1) < changes->regions[d] ? IN_CUBE * (cube[d] + 1) : changes->regions[d];
    for (at[2] = IN_CUBE * cube[2]; at[2] < high[2]; at[2]++)
        for (at[1] = IN_CUBE * cube[1]; at[1] < high[1]; at[1]++)
            for (at[0] = IN_CUBE * cube[0]; at[0] < high[0]; at[0]++)
                if (changes->other[part_index_of(changes->regions, at)]) return true;
    return false;
}
