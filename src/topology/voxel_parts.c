/* Find the connected parts of a tetrahedron's voxels, without cuts and with cuts. */
#include "topology/links.h"

int32_t pliant_voxels_parts(const pliant_voxels *voxels, const pliant_cuts *cuts, int32_t tet, int32_t *part)
{
    const pliant_links links = {.voxels = voxels, .cuts = cuts};
    const int32_t *list = voxels->voxel + voxels->start[tet], count = voxels->start[tet + 1] - voxels->start[tet];
    int32_t parts = 0, at[3];
    for (int32_t i = 0; i < count; i++) part[i] = i;
    for (int32_t i = 0; i < count; i++) {
        pliant_place_of(voxels, list[i], at);
        for (int n = 0; n < 9; n++) {
            int32_t other = pliant_step_to(voxels, list[i], at, pliant_later_neighbours[n]);
            if (other < 0 || voxels->owner[other] != tet ||
                !pliant_joined(&links, list[i], at, pliant_later_neighbours[n]))
                continue;
            pliant_set_join(part, i, pliant_voxel_in(voxels, tet, other));
        }
    }
    for (int32_t b = voxels->bridge_start[tet]; b < voxels->bridge_start[tet + 1]; b++)
        if (!pliant_bridge_severed(cuts, b))
            pliant_set_join(part, pliant_voxel_in(voxels, tet, voxels->bridge[2 * b]),
                 pliant_voxel_in(voxels, tet, voxels->bridge[2 * b + 1]));
    for (int32_t i = 0; i < count; i++) part[i] = pliant_set_root(part, i);
    for (int32_t i = 0; i < count; i++) part[i] = part[i] == i ? parts++ : part[part[i]];
    return parts;
}

int32_t pliant_voxels_fragment(const pliant_voxels *voxels, const pliant_cuts *cuts, int32_t voxel)
{
    const int32_t tet = voxels->owner[voxel];
    const int32_t at = cuts && tet >= 0 ? place_of(cuts->tet, cuts->num_tets, tet) : -1;
    return at < 0 ? tet : cuts->voxel_fragment[cuts->voxel_start[at] + pliant_voxel_in(voxels, tet, voxel)];
}
