/* Which voxels of a tetrahedron hang together. */
#include "body/parts.h"
#include "base/fail.h"
#include "pliant/body.h"
#include "pliant/memory.h"

#include <string.h>

void pliant_voxels_free(pliant_voxels *voxels)
{
    if (!voxels) return;
    void *blocks[] = {voxels->owner, voxels->start, voxels->voxel, voxels->bridge, voxels->bridge_start, voxels->severed, voxels->bridge_severed};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
    pliant_free(voxels);
}

static size_t count_of(const pliant_voxels *voxels) { return (size_t)voxels->size[0] * (size_t)voxels->size[1] * (size_t)voxels->size[2]; }

static bool copy(const void *from, size_t bytes, void *to)
{
    void *made = pliant_calloc(bytes > 0 ? bytes : 1, 1);
    if (!made) return false;
    if (bytes > 0) memcpy(made, from, bytes); /* without bridges there is nothing to copy from */
    memcpy(to, &made, sizeof made);
    return true;
}

pliant_status pliant_voxels_copy(const pliant_voxels *from, pliant_voxels **out)
{
    pliant_voxels *to = pliant_calloc(1, sizeof *to);
    if (!to) return pliant_fail_memory("the voxels of a body");
    memcpy(to->size, from->size, sizeof to->size);
    to->num_tets = from->num_tets;
    to->num_bridges = from->num_bridges;
    const size_t voxels = count_of(from), tets = (size_t)from->num_tets, bridges = (size_t)from->num_bridges, one = sizeof(int32_t);
    if (!copy(from->owner, voxels * one, &to->owner) || !copy(from->start, (tets + 1) * one, &to->start) ||
        !copy(from->voxel, (size_t)from->start[tets] * one, &to->voxel) || !copy(from->bridge, 2 * bridges * one, &to->bridge) ||
        !copy(from->bridge_start, (tets + 1) * one, &to->bridge_start) || !copy(from->severed, voxels, &to->severed) ||
        !copy(from->bridge_severed, bridges, &to->bridge_severed)) {
        pliant_voxels_free(to);
        return pliant_fail_memory("the voxels of a body");
    }
    *out = to;
    return PLIANT_OK;
}

/* ---- links */

static void place_of(const pliant_voxels *voxels, int32_t voxel, int32_t at[3])
{
    at[0] = voxel % voxels->size[0];
    at[1] = voxel / voxels->size[0] % voxels->size[1];
    at[2] = voxel / voxels->size[0] / voxels->size[1];
}

static int32_t stride_of(const pliant_voxels *voxels, int axis) { return axis == 0 ? 1 : axis == 1 ? voxels->size[0] : voxels->size[0] * voxels->size[1]; }

/* from a voxel one along an axis, forward or back; the voxel is there */
static bool is_linked(const pliant_voxels *voxels, int32_t voxel, int axis, int way)
{
    return !(voxels->severed[way > 0 ? voxel : voxel - stride_of(voxels, axis)] >> axis & 1);
}

bool pliant_voxels_joined(const pliant_voxels *voxels, int32_t a, int32_t b)
{
    int32_t from[3], to[3];
    int axis[3], way[3], count = 0;
    place_of(voxels, a, from);
    place_of(voxels, b, to);
    for (int d = 0; d < 3; d++) {
        if (to[d] == from[d]) continue;
        if (to[d] - from[d] > 1 || from[d] - to[d] > 1) return false;
        axis[count] = d;
        way[count++] = to[d] - from[d];
    }
    if (count == 1) return is_linked(voxels, a, axis[0], way[0]);
    if (count != 2) return false;
    for (int first = 0; first < 2; first++) {
        int32_t between = a + way[first] * stride_of(voxels, axis[first]);
        if (is_linked(voxels, a, axis[first], way[first]) && is_linked(voxels, between, axis[1 - first], way[1 - first])) return true;
    }
    return false;
}

/* ---- fragments */

/* place of a voxel in the list of its tetrahedron */
static int32_t find(const pliant_voxels *voxels, int32_t tet, int32_t voxel)
{
    int32_t low = voxels->start[tet], high = voxels->start[tet + 1] - 1;
    while (low < high) {
        int32_t middle = low + (high - low) / 2;
        if (voxels->voxel[middle] < voxel) low = middle + 1;
        else high = middle;
    }
    return low - voxels->start[tet];
}

/* half of the eighteen neighbours of a voxel: those behind it in memory */
static const int8_t behind[9][3] = {{1, 0, 0}, {-1, 1, 0}, {0, 1, 0}, {1, 1, 0}, {0, -1, 1}, {-1, 0, 1}, {0, 0, 1}, {1, 0, 1}, {0, 1, 1}};

/* the n-th of them, or -1 where the scan ends */
static int32_t behind_of(const pliant_voxels *voxels, int32_t voxel, int n)
{
    int32_t at[3], other = voxel;
    place_of(voxels, voxel, at);
    for (int d = 0; d < 3; d++) {
        if (at[d] + behind[n][d] < 0 || at[d] + behind[n][d] >= voxels->size[d]) return -1;
        other += behind[n][d] * stride_of(voxels, d);
    }
    return other;
}

int32_t pliant_voxels_fragments(const pliant_voxels *voxels, int32_t tet, int32_t *part)
{
    const int32_t *list = voxels->voxel + voxels->start[tet], count = voxels->start[tet + 1] - voxels->start[tet];
    int32_t fragments = 0;
    for (int32_t i = 0; i < count; i++) part[i] = i;
    for (int32_t i = 0; i < count; i++)
        for (int n = 0; n < 9; n++) {
            int32_t other = behind_of(voxels, list[i], n);
            if (other < 0 || voxels->owner[other] != tet || !pliant_voxels_joined(voxels, list[i], other)) continue;
            join(part, i, find(voxels, tet, other));
        }
    for (int32_t b = voxels->bridge_start[tet]; b < voxels->bridge_start[tet + 1]; b++)
        if (!voxels->bridge_severed[b]) join(part, find(voxels, tet, voxels->bridge[2 * b]), find(voxels, tet, voxels->bridge[2 * b + 1]));
    for (int32_t i = 0; i < count; i++) part[i] = first_of(part, i);
    for (int32_t i = 0; i < count; i++) part[i] = part[i] == i ? fragments++ : part[part[i]];
    return fragments;
}

/* ---- making them */

/* by the lattice, with its rule for ties; where nodes were moved, and in an octree, by the tetrahedra themselves */
static pliant_status find_owners(const pliant_mesh *fine, const pliant_geometry *geometry, pliant_voxels *voxels)
{
    const int64_t count = (int64_t)count_of(voxels);
    if (fine->num_moved == 0 && fine->num_leaves == 0) {
        pliant_status status = pliant_lattice_owners(geometry, fine->cells, voxels->owner);
        for (int64_t v = 0; status == PLIANT_OK && v < count; v++) voxels->owner[v] = fine->tet_of_lattice[voxels->owner[v]];
        return status;
    }
#pragma omp parallel for schedule(static)
    for (int64_t v = 0; v < count; v++) {
        int32_t at[3];
        double world[3], barycentric[4];
        place_of(voxels, (int32_t)v, at);
        pliant_geometry_to_world(geometry, (const double[3]){at[0], at[1], at[2]}, world);
        voxels->owner[v] = pliant_mesh_locate(fine, world, barycentric);
    }
    return PLIANT_OK;
}

static pliant_status list_owned(pliant_voxels *voxels)
{
    const int32_t count = (int32_t)count_of(voxels);
    int32_t *start = voxels->start, owned = 0;
    for (int32_t v = 0; v < count; v++)
        if (voxels->owner[v] >= 0) {
            start[voxels->owner[v] + 1]++;
            owned++;
        }
    for (int32_t t = 0; t < voxels->num_tets; t++) start[t + 1] += start[t];
    if (!(voxels->voxel = pliant_calloc((size_t)owned + 1, sizeof *voxels->voxel))) return pliant_fail_memory("the voxels of a body");
    for (int32_t v = count - 1; v >= 0; v--) /* from the back: starts end where they belong, one further */
        if (voxels->owner[v] >= 0) voxels->voxel[--start[voxels->owner[v] + 1]] = v;
    for (int32_t t = 0; t < voxels->num_tets; t++) start[t] = start[t + 1];
    start[voxels->num_tets] = owned;
    return PLIANT_OK;
}

typedef struct bridges {
    pliant_voxels *voxels;
    const double *spacing;
    int32_t count, room;
    int32_t *pair;
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
        place_of(voxels, voxels->voxel[a], from);
        for (int32_t b = voxels->start[other]; b < voxels->start[other + 1]; b++) {
            if (part && part[b - voxels->start[other]] == 0) continue;
            double squares = 0;
            place_of(voxels, voxels->voxel[b], to);
            for (int d = 0; d < 3; d++) squares += (to[d] - from[d]) * (to[d] - from[d]) * work->spacing[d] * work->spacing[d];
            if (least >= 0 && squares >= least) continue;
            least = squares;
            pair[0] = voxels->voxel[a];
            pair[1] = voxels->voxel[b];
        }
    }
}

/* A spanning tree of the parts of every tetrahedron, from its first one (Prim). part: (most voxels of one) room */
static pliant_status bridge_within(bridges *work, int32_t *part)
{
    pliant_voxels *voxels = work->voxels;
    pliant_status status = PLIANT_OK;
    for (int32_t tet = 0; tet < voxels->num_tets && status == PLIANT_OK; tet++) {
        const int32_t count = voxels->start[tet + 1] - voxels->start[tet];
        for (int32_t left = pliant_voxels_fragments(voxels, tet, part) - 1; left > 0 && status == PLIANT_OK; left--) {
            int32_t pair[2] = {-1, -1};
            closest(work, tet, tet, part, pair);
            int32_t joined = part[find(voxels, tet, pair[1])];
            for (int32_t i = 0; i < count; i++)
                if (part[i] == joined) part[i] = 0;
            status = add_bridge(work, pair);
        }
        voxels->bridge_start[tet + 1] = work->count; /* those of this one are not there yet when it is asked for its fragments */
    }
    return status;
}

/* One for every inner face whose two tetrahedra no link joins. across: (num_tets x 4) neighbours; linked: likewise, zeroed */
static pliant_status bridge_faces(bridges *work, const int32_t *across, uint8_t *linked)
{
    const pliant_voxels *voxels = work->voxels;
    const int32_t count = (int32_t)count_of(voxels);
    pliant_status status = PLIANT_OK;
    for (int32_t v = 0; v < count; v++)
        for (int n = 0; voxels->owner[v] >= 0 && n < 9; n++) {
            int32_t w = behind_of(voxels, v, n);
            if (w < 0 || voxels->owner[w] < 0) continue;
            for (int c = 0; c < 4; c++) {
                if (across[4 * voxels->owner[v] + c] == voxels->owner[w]) linked[4 * voxels->owner[v] + c] = 1;
                if (across[4 * voxels->owner[w] + c] == voxels->owner[v]) linked[4 * voxels->owner[w] + c] = 1;
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

static pliant_status build_bridges(const pliant_mesh *fine, const pliant_geometry *geometry, pliant_voxels *voxels)
{
    bridges work = {.voxels = voxels, .spacing = geometry->spacing};
    size_t most = 1;
    for (int32_t t = 0; t < voxels->num_tets; t++)
        if ((size_t)(voxels->start[t + 1] - voxels->start[t]) > most) most = (size_t)(voxels->start[t + 1] - voxels->start[t]);
    int32_t *part = pliant_calloc(most, sizeof *part), *across = pliant_calloc((size_t)voxels->num_tets, 4 * sizeof *across);
    uint8_t *linked = pliant_calloc((size_t)voxels->num_tets, 4);
    pliant_status status = part && across && linked ? pliant_mesh_neighbours(fine, across) : pliant_fail_memory("the voxels of a body");
    if (status == PLIANT_OK) status = bridge_within(&work, part);
    if (status == PLIANT_OK) status = bridge_faces(&work, across, linked);
    pliant_free(part);
    pliant_free(across);
    pliant_free(linked);
    voxels->bridge = work.pair;
    voxels->num_bridges = work.count;
    if (status == PLIANT_OK && !(voxels->bridge_severed = pliant_calloc((size_t)work.count + 1, 1))) status = pliant_fail_memory("the voxels of a body");
    return status;
}

pliant_status pliant_voxels_create(const pliant_mesh *fine, const pliant_geometry *geometry, pliant_voxels **out)
{
    if (pliant_geometry_voxels(geometry) > INT32_MAX)
        return pliant_fail(PLIANT_ERROR_SCENE, "a scan of %zu voxels is too large to be cut; resample it", pliant_geometry_voxels(geometry));
    pliant_voxels *voxels = pliant_calloc(1, sizeof *voxels);
    if (!voxels) return pliant_fail_memory("the voxels of a body");
    memcpy(voxels->size, geometry->size, sizeof voxels->size);
    voxels->num_tets = fine->num_tets;
    voxels->owner = pliant_calloc(count_of(voxels), sizeof *voxels->owner);
    voxels->severed = pliant_calloc(count_of(voxels), 1);
    voxels->start = pliant_calloc((size_t)fine->num_tets + 1, sizeof *voxels->start);
    voxels->bridge_start = pliant_calloc((size_t)fine->num_tets + 1, sizeof *voxels->bridge_start);
    bool good = voxels->owner && voxels->severed && voxels->start && voxels->bridge_start;
    pliant_status status = good ? find_owners(fine, geometry, voxels) : pliant_fail_memory("the voxels of a body");
    if (status == PLIANT_OK) status = list_owned(voxels);
    if (status == PLIANT_OK) status = build_bridges(fine, geometry, voxels);
    if (status != PLIANT_OK) {
        pliant_voxels_free(voxels);
        return status;
    }
    *out = voxels;
    return PLIANT_OK;
}
