/* What the parts of one body after another share: labels, of which most stay the same, and the boxes of tetrahedra. */
#include "pliant/memory.h"
#include "warp/parts_maker.h"

/* More room than is asked for: an eighth of it, and so many labels. */
enum { SPARE_LABELS = 1 << 18 };

void pliant_part_pool_release(part_pool *pool)
{
    if (!pool || --pool->holders > 0) return;
    pliant_free(pool->at);
    pliant_free(pool);
}

void pliant_part_hosts_release(part_hosts *hosts)
{
    if (!hosts || --hosts->holders > 0) return;
    pliant_free(hosts->box);
    pliant_free(hosts);
}

pliant_status pliant_part_hosts_find(const part_maker *work, const pliant_parts *before, part_hosts **out)
{
    if (before) {
        before->hosts->holders++;
        *out = before->hosts;
        return PLIANT_OK;
    }
    part_hosts *made = pliant_calloc(1, sizeof *made);
    if (!made || !(made->box = pliant_calloc((size_t)work->voxels->num_tets, sizeof *made->box))) {
        pliant_free(made);
        return pliant_parts_no_memory();
    }
    made->holders = 1;
    for (int32_t t = 0; t < work->voxels->num_tets; t++) pliant_parts_box(work, t, made->box + t);
    *out = made;
    return PLIANT_OK;
}

pliant_status pliant_part_pool_find(const pliant_parts *before, size_t live, size_t more, part_pool **out)
{
    if (before && before->pool->used + more <= before->pool->room) {
        before->pool->holders++;
        *out = before->pool;
        return PLIANT_OK;
    }
    part_pool *made = pliant_calloc(1, sizeof *made);
    if (!made) return pliant_parts_no_memory();
    made->room = live + more + (live + more) / 8 + SPARE_LABELS;
    made->holders = 1;
    if (made->room <= INT32_MAX && (made->at = pliant_calloc(made->room, sizeof *made->at))) {
        *out = made;
        return PLIANT_OK;
    }
    pliant_free(made);
    return pliant_parts_no_memory();
}
