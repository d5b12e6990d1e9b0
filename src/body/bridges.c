/* What joins voxels that no links join, in a mesh that nothing has cut yet: pairs of voxels, built once. */
#include "body/links.h"
#include "body/parts.h"

#include "base/fail.h"
#include "pliant/memory.h"

#include <omp.h>
#include <string.h>

typedef struct bridges {
    pliant_voxels *voxels;
    const double *spacing;
    int32_t count, room;
    int32_t *pair;             /* (count x 2) voxels */
} bridges;

static pliant_status add_bridge(bridges *work, const int32_t pair[2])
{
    if (work->count == work->room) {
        int32_t room = work->room > 0 ? 2 * work->room : 256;
        int32_t *longer = pliant_resize(work->pair, (size_t)room, 2 * sizeof *longer);
        if (!longer) return pliant_fail_memory("the voxels of a body");
        work->pair = longer;
        work->room = room;
    }
    memcpy(work->pair + 2 * work->count++, pair, 2 * sizeof *pair);
    return PLIANT_OK;
}

/* The closest voxels of two tetrahedra, the first such pair; part NULL: all of them; else those of the first part, and of any other */
static void closest(const bridges *work, int32_t tet, int32_t other, const int32_t *part, int32_t pair[2])
{
    const pliant_voxels *voxels = work->voxels;
    double least = -1;
    for (int32_t a = voxels->start[tet]; a < voxels->start[tet + 1]; a++) {
        if (part && part[a - voxels->start[tet]] != 0) continue;
        int32_t from[3], to[3];
        pliant_place_of(voxels, voxels->voxel[a], from);
        for (int32_t b = voxels->start[other]; b < voxels->start[other + 1]; b++) {
            if (part && part[b - voxels->start[other]] == 0) continue;
            double squares = 0;
            pliant_place_of(voxels, voxels->voxel[b], to);
            for (int d = 0; d < 3; d++) squares += (to[d] - from[d]) * (to[d] - from[d]) * work->spacing[d] * work->spacing[d];
            if (least >= 0 && squares >= least) continue;
            least = squares;
            pair[0] = voxels->voxel[a];
            pair[1] = voxels->voxel[b];
        }
    }
}

/* How many parts every tetrahedron has while there are no bridges. part: (threads x most voxels of one) room */
static void count_parts(const pliant_voxels *voxels, int threads, size_t most, int32_t *part, int32_t *parts)
{
#pragma omp parallel for schedule(dynamic, 64) num_threads(threads)
    for (int32_t tet = 0; tet < voxels->num_tets; tet++)
        parts[tet] = pliant_voxels_parts(voxels, NULL, tet, part + most * (size_t)omp_get_thread_num());
}

/* A spanning tree of the parts of every tetrahedron, from its first one (Prim). part: (most voxels of one) room; parts: of count_parts */
static pliant_status bridge_within(bridges *work, const int32_t *parts, int32_t *part)
{
    pliant_voxels *voxels = work->voxels;
    pliant_status status = PLIANT_OK;
    for (int32_t tet = 0; tet < voxels->num_tets && status == PLIANT_OK; tet++) {
        const int32_t count = voxels->start[tet + 1] - voxels->start[tet];
        if (parts[tet] > 1) pliant_voxels_parts(voxels, NULL, tet, part);
        for (int32_t left = parts[tet] - 1; left > 0 && status == PLIANT_OK; left--) {
            int32_t pair[2] = {-1, -1};
            closest(work, tet, tet, part, pair);
            int32_t joined = part[pliant_voxel_in(voxels, tet, pair[1])];
            for (int32_t i = 0; i < count; i++)
                if (part[i] == joined) part[i] = 0;
            status = add_bridge(work, pair);
        }
        voxels->bridge_start[tet + 1] = work->count; /* those of this one are not there yet when it is asked for its fragments */
    }
    return status;
}

/* One for every inner face whose two tetrahedra no link joins. linked: (num_tets x 4), zeroed */
static pliant_status bridge_faces(bridges *work, uint8_t *linked)
{
    const pliant_voxels *voxels = work->voxels;
    const pliant_links links = {.voxels = voxels};
    const int32_t count = (int32_t)pliant_geometry_voxels(&voxels->geometry), *across = voxels->across, *owner = voxels->owner;
    pliant_status status = PLIANT_OK;
    for (int32_t v = 0; v < count; v++) {
        int32_t at[3];
        if (owner[v] >= 0) pliant_place_of(voxels, v, at);
        for (int n = 0; owner[v] >= 0 && n < 9; n++) {
            const int32_t w = pliant_step_to(voxels, v, at, pliant_behind[n]);
            if (w < 0 || owner[w] < 0 || owner[w] == owner[v] || !pliant_joined(&links, v, at, pliant_behind[n])) continue;
            for (int c = 0; c < 4; c++) {
                if (across[4 * owner[v] + c] == owner[w]) linked[4 * owner[v] + c] = 1;
                if (across[4 * owner[w] + c] == owner[v]) linked[4 * owner[w] + c] = 1;
            }
        }
    }
    for (int32_t f = 0; f < 4 * voxels->num_tets && status == PLIANT_OK; f++) {
        int32_t tet = f / 4, other = across[f], pair[2] = {-1, -1};
        if (other <= tet || linked[f] || voxels->start[tet] == voxels->start[tet + 1] || voxels->start[other] == voxels->start[other + 1]) continue;
        closest(work, tet, other, NULL, pair);
        status = add_bridge(work, pair);
    }
    return status;
}

/* Corners around a node, joined by faces with that node. part: (corners around it) */
static void fan_of(const pliant_mesh *fine, const pliant_voxels *voxels, int32_t node, int32_t *part)
{
    const int32_t *corner = voxels->around + voxels->around_start[node];
    const int32_t count = voxels->around_start[node + 1] - voxels->around_start[node];
    for (int32_t i = 0; i < count; i++) part[i] = i;
    for (int32_t i = 0; i < count; i++)
        for (int c = 0; c < 4; c++) {
            const int32_t other = voxels->across[4 * (corner[i] / 4) + c];
            if (c == corner[i] % 4 || other < corner[i] / 4) continue;
            for (int32_t j = i + 1; j < count; j++)
                if (corner[j] / 4 == other && fine->tets[corner[j]] == node) join(part, i, j);
        }
}

/* the voxel of a tetrahedron that is nearest to a point, if it is nearer than another; index: in voxels */
static void nearer(const bridges *work, int32_t tet, const double index[3], double *least, int32_t *voxel)
{
    const pliant_voxels *voxels = work->voxels;
    for (int32_t v = voxels->start[tet]; v < voxels->start[tet + 1]; v++) {
        int32_t at[3];
        double squares = 0;
        pliant_place_of(voxels, voxels->voxel[v], at);
        for (int d = 0; d < 3; d++) squares += (at[d] - index[d]) * (at[d] - index[d]) * work->spacing[d] * work->spacing[d];
        if (*voxel >= 0 && squares >= *least) continue;
        *least = squares;
        *voxel = voxels->voxel[v];
    }
}

/* Where tetrahedra meet at a node or an edge only: their voxels that are nearest to the node, the first fan's with every other one's. */
static pliant_status bridge_hinges(bridges *work, const pliant_mesh *fine, int32_t *part)
{
    const pliant_voxels *voxels = work->voxels;
    pliant_status status = PLIANT_OK;
    for (int32_t node = 0; node < fine->num_nodes && status == PLIANT_OK; node++) {
        const int32_t *corner = voxels->around + voxels->around_start[node];
        const int32_t count = voxels->around_start[node + 1] - voxels->around_start[node];
        int32_t pair[2] = {-1, -1};
        double index[3];
        fan_of(fine, voxels, node, part);
        pliant_geometry_to_index(&voxels->geometry, fine->rest + 3 * node, index);
        for (int32_t i = 0; i < count && status == PLIANT_OK; i++) {
            if (part[i] != i) continue; /* not the first of a fan */
            double least = 0;
            int32_t voxel = -1;
            for (int32_t j = i; j < count; j++)
                if (first_of(part, j) == i) nearer(work, corner[j] / 4, index, &least, &voxel);
            pair[pair[0] >= 0] = voxel;
            if (pair[0] >= 0 && pair[1] >= 0) status = add_bridge(work, pair);
        }
    }
    return status;
}

/* Of every tetrahedron, those to others: twice through the list, to count and to write. */
static pliant_status list_beside(pliant_voxels *voxels)
{
    const int32_t first = voxels->bridge_start[voxels->num_tets], ends = 2 * (voxels->num_bridges - first);
    int32_t *start = voxels->beside_start = pliant_calloc((size_t)voxels->num_tets + 2, sizeof *start);
    voxels->beside = pliant_calloc((size_t)ends + 1, sizeof *voxels->beside);
    if (!start || !voxels->beside) return pliant_fail_memory("the voxels of a body");
    for (int32_t e = 0; e < ends; e++) start[voxels->owner[voxels->bridge[2 * first + e]] + 2]++;
    for (int32_t t = 0; t < voxels->num_tets; t++) start[t + 2] += start[t + 1];
    for (int32_t e = 0; e < ends; e++) voxels->beside[start[voxels->owner[voxels->bridge[2 * first + e]] + 1]++] = first + e / 2;
    return PLIANT_OK;
}

pliant_status pliant_bridges_build(const pliant_mesh *fine, pliant_voxels *voxels)
{
    bridges work = {.voxels = voxels, .spacing = voxels->geometry.spacing};
    size_t most = 1;
    for (int32_t t = 0; t < voxels->num_tets; t++)
        if ((size_t)(voxels->start[t + 1] - voxels->start[t]) > most) most = (size_t)(voxels->start[t + 1] - voxels->start[t]);
    for (int32_t n = 0; n < voxels->num_nodes; n++)
        if ((size_t)(voxels->around_start[n + 1] - voxels->around_start[n]) > most)
            most = (size_t)(voxels->around_start[n + 1] - voxels->around_start[n]);
    const int threads = omp_get_max_threads();
    int32_t *part = pliant_calloc((size_t)threads * most, sizeof *part), *parts = pliant_calloc((size_t)voxels->num_tets + 1, sizeof *parts);
    uint8_t *linked = pliant_calloc((size_t)voxels->num_tets, 4);
    pliant_status status = part && parts && linked ? PLIANT_OK : pliant_fail_memory("the voxels of a body");
    if (status == PLIANT_OK) count_parts(voxels, threads, most, part, parts);
    if (status == PLIANT_OK) status = bridge_within(&work, parts, part);
    if (status == PLIANT_OK) status = bridge_faces(&work, linked);
    if (status == PLIANT_OK) status = bridge_hinges(&work, fine, part);
    pliant_free(part);
    pliant_free(parts);
    pliant_free(linked);
    voxels->bridge = work.pair;
    voxels->num_bridges = work.count;
    return status == PLIANT_OK ? list_beside(voxels) : status;
}
