// Whether a link joins two neighbouring voxels with owners, along an axis or across an edge. cuts: may be null
#pragma once

#include "topology/links.h"

#include <cstdlib>

inline bool voxels_joined(const pliant_voxels *voxels, const pliant_cuts *cuts, int32_t a, int32_t b)
{
    pliant_links links{};
    links.voxels = voxels;
    links.cuts = cuts;
    int32_t from[3], to[3];
    int8_t step[3];
    int count = 0;
    pliant_place_of(voxels, a, from);
    pliant_place_of(voxels, b, to);
    for (int d = 0; d < 3; d++) {
        if (std::abs(to[d] - from[d]) > 1) return false;
        step[d] = static_cast<int8_t>(to[d] - from[d]);
        count += step[d] != 0;
    }
    return (count == 1 || count == 2) && pliant_joined(&links, a, from, step);
}
