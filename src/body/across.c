/* Who is across each face of the next body: across a face at load, or a fragment of that one. Only where corners changed is it looked for. */
#include "body/divide.h"

#include "base/fail.h"
#include "base/room.h"
#include "pliant/memory.h"

#include <string.h>

/* fragments of a tetrahedron at load, ascending; tet: room for itself */
static int32_t fragments_of(const pliant_cuts *cuts, const int32_t *tet, const int32_t **out)
{
    int32_t low = 0, high = cuts->num_tets;
    while (low < high) {
        const int32_t middle = low + (high - low) / 2;
        if (cuts->tet[middle] < *tet) low = middle + 1;
        else high = middle;
    }
    const bool cut = low < cuts->num_tets && cuts->tet[low] == *tet;
    *out = cut ? cuts->fragment + cuts->start[low] : tet;
    return cut ? cuts->start[low + 1] - cuts->start[low] : 1;
}

static void find_one(const pliant_body *next, const pliant_cuts *cuts, int32_t tet, int corner, int32_t beyond)
{
    const int32_t *nodes = next->fine.tets + 4 * (size_t)tet, *list;
    const int32_t count = fragments_of(cuts, &beyond, &list);
    int32_t found = -1;
    for (int32_t f = 0; f < count && found < 0; f++) {
        const int32_t *other = next->fine.tets + 4 * (size_t)list[f];
        int common = 0;
        for (int v = 0; v < 4; v++)
            for (int w = 0; w < 4; w++) common += v != corner && nodes[v] == other[w];
        if (common == 3) found = list[f];
    }
    next->across[4 * (size_t)tet + corner] = found;
}

static void find_around(const pliant_body *next, const pliant_cuts *cuts, int32_t tet)
{
    const int32_t parent = next->tet_parent ? next->tet_parent[tet] : tet, *load = next->voxels->across;
    for (int c = 0; c < 4; c++) {
        const int32_t beyond = load[4 * (size_t)parent + c], *list;
        next->across[4 * (size_t)tet + c] = -1;
        if (beyond < 0) continue;
        find_one(next, cuts, tet, c, beyond);
        const int32_t count = fragments_of(cuts, &beyond, &list);
        for (int back = 0; back < 4; back++)
            for (int32_t f = 0; f < count && load[4 * (size_t)beyond + back] == parent; f++) find_one(next, cuts, list[f], back, parent);
    }
}

pliant_status pliant_body_find_across(const pliant_body *before, const pliant_cuts *cuts, pliant_body *next)
{
    const size_t tets = (size_t)next->fine.num_tets, old = (size_t)before->fine.num_tets;
    const int32_t *known = before->across ? before->across : before->voxels && before->revision == 1 ? before->voxels->across : NULL;
    if (!(next->across = pliant_room(tets, 4 * sizeof *next->across))) return pliant_fail_memory("the next body");
    if (!cuts || !known) return pliant_mesh_neighbours(&next->fine, next->across);
    memcpy(next->across, known, 4 * old * sizeof *known);
    for (int32_t i = 0; i < next->changes.num_touched; i++) {
        const size_t t = (size_t)next->changes.touched[i];
        if (memcmp(before->fine.tets + 4 * t, next->fine.tets + 4 * t, 4 * sizeof *next->fine.tets) != 0) find_around(next, cuts, (int32_t)t);
    }
    for (size_t t = old; t < tets; t++) find_around(next, cuts, (int32_t)t);
    return PLIANT_OK;
}
