/* Avoid fragments of a few voxels that a cut would leave without any connection: they keep their links to one side. */
#include "cut/cut_stages.h"

#include "base/fail.h"
#include "base/memory.h"

#include <string.h>

typedef struct dust {
    cut_work *work;
    int32_t *group;  /* (fragments + 1) connected component; the first entry represents all untouched tetrahedra */
    int32_t *voxels; /* (fragments + 1) voxels per component */
    /* (fragments + 1) minimum number of voxels; a smaller component is dust, and so is a single voxel */
    int32_t *minimum;
    int32_t *lost;   /* (fragments + 1) newly severed links to each other component */
} dust;

static int32_t group_of(const dust *all, int32_t end)
{
    const int32_t tets = all->work->body->fine.num_tets;
    return pliant_set_root(all->group, end < tets ? 0 : end - tets + 1);
}

static void find_groups(const dust *all)
{
    const cut_work *work = all->work;
    const int32_t tets = work->body->fine.num_tets;
    for (int32_t g = 0; g <= work->num_fragments; g++) all->group[g] = g;
    for (int32_t e = 0; e < work->num_edges; e++) {
        const int32_t *end = work->edge[e].end;
        pliant_set_join(all->group, end[0] < tets ? 0 : end[0] - tets + 1, end[1] < tets ? 0 : end[1] - tets + 1);
    }
    for (int32_t f = 0; f < work->num_fragments; f++) {
        const int32_t group = group_of(all, tets + f), tet = work->fragment[f].tet;
        const int32_t minimum =
            (int32_t)(CUT_MIN_FRACTION * (work->voxels->start[tet + 1] - work->voxels->start[tet])) + 2;
        all->voxels[group] += work->fragment[f].voxels;
        if (minimum > all->minimum[group]) all->minimum[group] = minimum;
    }
}

/* Return the components of both ends of a newly severed link. */
static void ends_of(const dust *all, int32_t link, int32_t group[2])
{
    const cut_work *work = all->work;
    const int32_t voxel = (int32_t)(work->link[link] / 4),
                  next = voxel + pliant_stride_of(work->voxels, work->link[link] % 4);
    group[0] = group_of(all, pliant_cut_end_of(work, voxel));
    group[1] = group_of(all, pliant_cut_end_of(work, next));
}

/* Return the component to which the most links are newly severed; -1: none. */
static int32_t find_most_severed_component(const dust *all, int32_t group)
{
    int32_t maximum = -1, ends[2];
    memset(all->lost, 0, ((size_t)all->work->num_fragments + 1) * sizeof *all->lost);
    for (int32_t l = 0; l < all->work->num_links; l++) {
        ends_of(all, l, ends);
        if (ends[0] == ends[1] || (ends[0] != group && ends[1] != group)) continue;
        const int32_t other = ends[0] == group ? ends[1] : ends[0];
        all->lost[other]++;
        if (maximum < 0 || all->lost[other] > all->lost[maximum]) maximum = other;
    }
    return maximum;
}

/* Restore the links between a component and the component to which it has lost the most links. Return whether there
 * were any. */
static bool restore_links(const dust *all, int32_t group)
{
    cut_work *work = all->work;
    const int32_t to = find_most_severed_component(all, group);
    int32_t kept = 0, ends[2];
    if (to < 0) return false;
    for (int32_t l = 0; l < work->num_links; l++) {
        ends_of(all, l, ends);
        if ((ends[0] == group && ends[1] == to) || (ends[1] == group && ends[0] == to)) continue;
        work->link[kept] = work->link[l];
        work->link_area[kept++] = work->link_area[l];
    }
    work->num_links = kept;
    return true;
}

pliant_status pliant_cut_restore_small_components(cut_work *work, bool *changed)
{
    dust all = {.work = work};
    const size_t count = (size_t)work->num_fragments + 1;
    *changed = false;
    all.group = pliant_calloc(count, sizeof *all.group);
    all.voxels = pliant_calloc(count, sizeof *all.voxels);
    all.minimum = pliant_calloc(count, sizeof *all.minimum);
    all.lost = pliant_calloc(count, sizeof *all.lost);
    const bool good = all.group && all.voxels && all.minimum && all.lost;
    if (good) find_groups(&all);
    for (int32_t g = 1; good && g <= work->num_fragments; g++)
        if (all.group[g] == g && all.voxels[g] < all.minimum[g] && restore_links(&all, g)) *changed = true;
    PLIANT_FREE(all.group, all.voxels, all.minimum, all.lost);
    return good ? PLIANT_OK : pliant_fail_memory("the small fragments of a cut");
}
