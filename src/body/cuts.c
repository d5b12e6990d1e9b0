/* What has been severed, and the fragments that it leaves: a body's own copy. */
#include "base/fail.h"
#include "pliant/body.h"
#include "pliant/memory.h"

#include <string.h>

void pliant_cuts_free(pliant_cuts *cuts)
{
    if (!cuts) return;
    pliant_free(cuts->link);
    pliant_free(cuts->bridge);
    pliant_free(cuts->tet);
    pliant_free(cuts->start);
    pliant_free(cuts->fragment);
    pliant_free(cuts->voxel_start);
    pliant_free(cuts->voxel_fragment);
    pliant_free(cuts->chip);
    pliant_free(cuts->join);
    pliant_free(cuts->cut_end);
    pliant_free(cuts->severed);
    pliant_free(cuts);
}

static bool copy(const void *from, size_t count, size_t size, void *to)
{
    void *made = pliant_calloc(count > 0 ? count : 1, size);
    if (!made) return false;
    if (count > 0) memcpy(made, from, count * size);
    memcpy(to, &made, sizeof made);
    return true;
}

pliant_status pliant_cuts_copy(const pliant_cuts *from, pliant_cuts **out)
{
    pliant_cuts *to = pliant_calloc(1, sizeof *to);
    if (!to) return pliant_fail_memory("the cuts of a body");
    to->num_links = from->num_links;
    to->num_bridges = from->num_bridges;
    to->num_tets = from->num_tets;
    to->num_chips = from->num_chips;
    to->num_joins = from->num_joins;
    to->num_cuts = from->num_cuts;
    const size_t severed = from->num_cuts > 0 ? (size_t)from->cut_end[from->num_cuts - 1] : 0;
    to->num_pieces = from->num_pieces;
    const size_t tets = (size_t)from->num_tets, one = sizeof(int32_t);
    if (!copy(from->link, (size_t)from->num_links, sizeof *to->link, &to->link) || !copy(from->bridge, (size_t)from->num_bridges, one, &to->bridge) ||
        !copy(from->tet, tets, one, &to->tet) || !copy(from->start, tets + 1, one, &to->start) ||
        !copy(from->fragment, (size_t)from->start[tets], one, &to->fragment) || !copy(from->voxel_start, tets + 1, one, &to->voxel_start) ||
        !copy(from->voxel_fragment, (size_t)from->voxel_start[tets], one, &to->voxel_fragment) ||
        !copy(from->cut_end, (size_t)from->num_cuts, one, &to->cut_end) || !copy(from->severed, severed, sizeof *to->severed, &to->severed) ||
        !copy(from->chip, (size_t)from->num_chips, 2 * one, &to->chip) || !copy(from->join, (size_t)from->num_joins, 2 * one, &to->join)) {
        pliant_cuts_free(to);
        return pliant_fail_memory("the cuts of a body");
    }
    *out = to;
    return PLIANT_OK;
}
