/* Connectivity of adjacent voxels through links that are not severed and voxels that tetrahedra own. */
#ifndef PLIANT_TOPOLOGY_LINKS_H
#define PLIANT_TOPOLOGY_LINKS_H

#include "topology/body.h"
#include "topology/sorted_numbers.h"

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Severed links, for many queries: a table for the voxels in a box, a binary search for all others. */
typedef struct pliant_links {
    const pliant_voxels *voxels;
    const pliant_cuts *cuts;   /* Nullable */
    int32_t low[3], size[3];   /* box of the table; size 0: none */
    uint8_t *severed;          /* (size[0] x size[1] x size[2]) bit d: link to the next voxel along axis d is severed */
} pliant_links;

/* half of the 18 neighbours of a voxel: those with a higher index */
static const int8_t pliant_later_neighbours[9][3] = {{1, 0, 0},  {-1, 1, 0}, {0, 1, 0}, {1, 1, 0}, {0, -1, 1},
                                           {-1, 0, 1}, {0, 0, 1},  {1, 0, 1}, {0, 1, 1}};

static inline void pliant_place_of(const pliant_voxels *voxels, int32_t voxel, int32_t at[3])
{
    const int32_t *size = voxels->geometry.size;
    at[0] = voxel % size[0];
    at[1] = voxel / size[0] % size[1];
    at[2] = voxel / size[0] / size[1];
}

/* Compute the indices of a voxel in ascending sequences, in which most voxels are adjacent to the previous one.
 * last: input and output; previous voxel, initially -2
 * at: input and output; its indices */
static inline void pliant_place_after(const pliant_voxels *voxels, int32_t voxel, int32_t *last, int32_t at[3])
{
    if (voxel == *last + 1 && at[0] + 1 < voxels->geometry.size[0]) at[0]++;
    else pliant_place_of(voxels, voxel, at);
    *last = voxel;
}

static inline int32_t pliant_stride_of(const pliant_voxels *voxels, int axis)
{
    const int32_t *size = voxels->geometry.size;
    return axis == 0 ? 1 : axis == 1 ? size[0] : size[0] * size[1];
}

/* Return the voxel at an offset; -1: outside the scan. */
static inline int32_t pliant_step_to(const pliant_voxels *voxels, int32_t voxel, const int32_t at[3],
                                     const int8_t step[3])
{
    const int32_t *size = voxels->geometry.size;
    for (int d = 0; d < 3; d++)
        if (at[d] + step[d] < 0 || at[d] + step[d] >= size[d]) return -1;
    return voxel + step[0] + size[0] * (step[1] + size[1] * step[2]);
}

/* Return the index of the first of sorted numbers that is not below `number`. */
static inline int32_t pliant_lower_bound(const uint32_t *sorted, int32_t count, uint32_t number)
{
    int32_t low = 0, high = count;
    while (low < high) {
        int32_t middle = low + (high - low) / 2;
        if (sorted[middle] < number) low = middle + 1;
        else high = middle;
    }
    return low;
}

static inline bool pliant_bridge_severed(const pliant_cuts *cuts, int32_t bridge)
{
    return cuts && place_of(cuts->bridge, cuts->num_bridges, bridge) >= 0;
}

/* Return the number of fragments of an initial tetrahedron, and their list. A tetrahedron that is not cut is its own
 * list. cuts: Nullable */
static inline int32_t pliant_fragments_of(const pliant_cuts *cuts, const int32_t *tet, const int32_t **out)
{
    const int32_t at = cuts ? place_of(cuts->tet, cuts->num_tets, *tet) : -1;
    *out = at < 0 ? tet : cuts->fragment + cuts->start[at];
    return at < 0 ? 1 : cuts->start[at + 1] - cuts->start[at];
}

/* Return whether two fine tetrahedra, one of them cut, are joined. */
static inline bool pliant_cuts_join(const pliant_cuts *cuts, int32_t a, int32_t b)
{
    const int32_t low = a < b ? a : b, high = a < b ? b : a;
    int32_t from = 0, to = cuts->num_joins;
    while (from < to) {
        const int32_t middle = from + (to - from) / 2, *join = cuts->join + 2 * middle;
        if (join[0] < low || (join[0] == low && join[1] < high)) from = middle + 1;
        else to = middle;
    }
    return from < cuts->num_joins && cuts->join[2 * from] == low && cuts->join[2 * from + 1] == high;
}

/* Return whether the link from a voxel to the next one along an axis is severed. */
static inline bool pliant_link_severed(const pliant_links *links, int32_t voxel, const int32_t at[3], int axis)
{
    if (links->severed) {
        const int32_t i = at[0] - links->low[0], j = at[1] - links->low[1], k = at[2] - links->low[2];
        if (i >= 0 && j >= 0 && k >= 0 && i < links->size[0] && j < links->size[1] && k < links->size[2])
            return links->severed[(size_t)i +
                                  (size_t)links->size[0] * ((size_t)j + (size_t)links->size[1] * (size_t)k)] >>
                       axis &
                   1;
    }
    if (!links->cuts) return false;
    const uint32_t link = 4 * (uint32_t)voxel + (uint32_t)axis;
    const int32_t found = pliant_lower_bound(links->cuts->link, links->cuts->num_links, link);
    return found < links->cuts->num_links && links->cuts->link[found] == link;
}

/* Return whether the link in a direction along an axis is intact; both voxels must exist. */
static inline bool pliant_linked(const pliant_links *links, int32_t voxel, const int32_t at[3], int axis, int direction)
{
    if (direction > 0) return !pliant_link_severed(links, voxel, at, axis);
    int32_t lower[3] = {at[0], at[1], at[2]};
    lower[axis]--;
    return !pliant_link_severed(links, voxel - pliant_stride_of(links->voxels, axis), lower, axis);
}

/* Return whether a voxel is joined with one of its 18 neighbours. */
static inline bool pliant_joined(const pliant_links *links, int32_t voxel, const int32_t at[3], const int8_t step[3])
{
    int axis[3] = {0}, count = 0;
    for (int d = 0; d < 3; d++)
        if (step[d]) axis[count++] = d;
    if (count == 1) return pliant_linked(links, voxel, at, axis[0], step[axis[0]]);
    for (int first = 0; first < 2; first++) {
        const int a = axis[first], b = axis[1 - first];
        const int32_t between = voxel + step[a] * pliant_stride_of(links->voxels, a);
        int32_t middle[3] = {at[0], at[1], at[2]};
        middle[a] += step[a];
        if (links->voxels->owner[between] >= 0 && pliant_linked(links, voxel, at, a, step[a]) &&
            pliant_linked(links, between, middle, b, step[b]))
            return true;
    }
    return false;
}

/* Return the index of a voxel in the list of its tetrahedron. */
static inline int32_t pliant_voxel_in(const pliant_voxels *voxels, int32_t tet, int32_t voxel)
{
    const int32_t first = voxels->start[tet];
    return place_of(voxels->voxel + first, voxels->start[tet + 1] - first, voxel);
}

/* ---- cuts.c */

/* Reserve capacity for the fragments of `more` voxels after the fragments of `cuts` (Nullable). The pool of `cuts` is
 * used if next->voxel_fragment stays the same, otherwise a new one with capacity for `kept` further voxels.
 * first: output; index of the reserved range */
pliant_status pliant_cuts_reserve(const pliant_cuts *cuts, size_t kept, size_t more, pliant_cuts *next, int32_t *first);

/* ---- bridges.c */

pliant_status pliant_bridges_build(const pliant_mesh *fine, pliant_voxels *voxels);

#ifdef __cplusplus
}
#endif
#endif
