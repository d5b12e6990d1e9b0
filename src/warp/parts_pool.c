/* Data that the parts of successive bodies share: labels, most of which stay the same, and the boxes of tetrahedra. */
#include "base/memory.h"
#include "warp/parts_maker.h"

/* A pool is larger than requested, by an eighth and this number of labels. */
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
    PLIANT_FREE(hosts->box, hosts->cube_start, hosts->of_cube, hosts);
}

/* Count, or list, the cubes of each box.
 * start: (cubes + 2) */
static void visit_cubes(part_hosts *hosts, const pliant_voxels *voxels, bool lists)
{
    int32_t at[3], low[3], high[3], *start = hosts->cube_start;
    for (int32_t t = 0; t < voxels->num_tets; t++) {
        const part_box *box = hosts->box + t;
        for (int d = 0; d < 3; d++) {
            low[d] = box->low[d] / PART_CUBE;
            high[d] = (box->low[d] + box->size[d] - 1) / PART_CUBE;
        }
        for (at[2] = low[2]; at[2] <= high[2]; at[2]++)
            for (at[1] = low[1]; at[1] <= high[1]; at[1]++)
                for (at[0] = low[0]; at[0] <= high[0]; at[0]++) {
                    const int32_t cube = part_index_of(hosts->cubes, at);
                    if (lists) hosts->of_cube[start[cube + 1]++] = t;
                    else start[cube + 2]++;
                }
    }
}

static bool fill_cubes(part_hosts *hosts, const pliant_voxels *voxels)
{
    size_t cubes = 1;
    for (int d = 0; d < 3; d++) {
        hosts->cubes[d] = (voxels->geometry.size[d] - 1) / PART_CUBE + 1;
        cubes *= (size_t)hosts->cubes[d];
    }
    if (!(hosts->cube_start = pliant_calloc(cubes + 2, sizeof *hosts->cube_start))) return false;
    visit_cubes(hosts, voxels, false);
    for (size_t c = 0; c < cubes; c++) hosts->cube_start[c + 2] += hosts->cube_start[c + 1];
    if (!(hosts->of_cube = pliant_calloc((size_t)hosts->cube_start[cubes + 1] + 1, sizeof *hosts->of_cube)))
        return false;
    visit_cubes(hosts, voxels, true);
    return true;
}

pliant_status pliant_part_hosts_create(const pliant_body *body, const pliant_geometry *scan, part_hosts **out)
{
    const part_maker work = {.body = body, .voxels = body->voxels, .scan = scan};
    part_hosts *made = pliant_calloc(1, sizeof *made);
    if (!made || !(made->box = pliant_calloc((size_t)work.voxels->num_tets, sizeof *made->box))) {
        pliant_free(made);
        return pliant_parts_no_memory();
    }
    made->holders = 1;
    for (int32_t t = 0; t < work.voxels->num_tets; t++) pliant_parts_box(&work, t, made->box + t);
    if (!fill_cubes(made, work.voxels)) {
        pliant_part_hosts_release(made);
        return pliant_parts_no_memory();
    }
    *out = made;
    return PLIANT_OK;
}

pliant_status pliant_part_pool_find(const pliant_parts *before, size_t live, size_t more, part_pool **out)
{
    if (before && before->pool->used + more <= before->pool->capacity) {
        before->pool->holders++;
        *out = before->pool;
        return PLIANT_OK;
    }
    part_pool *made = pliant_calloc(1, sizeof *made);
    if (!made) return pliant_parts_no_memory();
    made->capacity = live + more + (live + more) / 8 + SPARE_LABELS;
    made->holders = 1;
    if (made->capacity <= INT32_MAX && (made->at = pliant_calloc(made->capacity, sizeof *made->at))) {
        *out = made;
        return PLIANT_OK;
    }
    pliant_free(made);
    return pliant_parts_no_memory();
}
