/* Build bridges: pairs of voxels that connect parts of the mesh which no link connects. They are computed once, for the
 * mesh without cuts. */
#include "topology/links.h"

#include "base/buffer.h"
#include "base/fail.h"
#include "base/memory.h"

#include <omp.h>
#include <string.h>

typedef struct bridges {
    pliant_voxels *voxels;
    const double *spacing;
    int32_t count, capacity;
    int32_t *pair;             /* (count x 2) voxels */
    int32_t *place;            /* (maximum number of voxels of a tetrahedron x 3) buffer */
} bridges;

static pliant_status add_bridge(bridges *work, const int32_t pair[2])
{
    if (!pliant_reserve(&work->pair, &work->capacity, work->count, 256, 2 * sizeof *work->pair))
        return pliant_fail_memory("the voxels of the mesh");
    memcpy(work->pair + 2 * work->count++, pair, 2 * sizeof *pair);
    return PLIANT_OK;
}

/* Find the closest pair of voxels of two tetrahedra, the first one at a tie.
 * part: NULL: all voxels; otherwise the first voxel is in part 0 and the second one in any other part */
static void closest(const bridges *work, int32_t tet, int32_t other, const int32_t *part, int32_t pair[2])
{
    const pliant_voxels *voxels = work->voxels;
    const int32_t first = voxels->start[other];
    double minimum = -1;
    for (int32_t b = first; b < voxels->start[other + 1]; b++)
        pliant_place_of(voxels, voxels->voxel[b], work->place + 3 * (b - first));
    for (int32_t a = voxels->start[tet]; a < voxels->start[tet + 1]; a++) {
        if (part && part[a - voxels->start[tet]] != 0) continue;
        int32_t from[3];
        pliant_place_of(voxels, voxels->voxel[a], from);
        for (int32_t b = first; b < voxels->start[other + 1]; b++) {
            if (part && part[b - first] == 0) continue;
            const int32_t *to = work->place + 3 * (b - first);
            double squares = 0;
            for (int d = 0; d < 3; d++)
                squares += (to[d] - from[d]) * (to[d] - from[d]) * work->spacing[d] * work->spacing[d];
            if (minimum >= 0 && squares >= minimum) continue;
            minimum = squares;
            pair[0] = voxels->voxel[a];
            pair[1] = voxels->voxel[b];
        }
    }
}

/* ---- count the parts of a tetrahedron without cuts and bridges, by runs of consecutive voxels along i */

typedef struct run {
    int32_t first, last; /* voxels */
    int32_t i, j, k;     /* of the first */
} run;

/* rows with lower indices to which a run may be joined: offsets in j and k, and the range of diagonals in i */
static const int8_t lower_rows[4][3] = {{1, 0, 1}, {-1, 1, 0}, {0, 1, 1}, {1, 1, 0}};

static int32_t list_runs(const pliant_voxels *voxels, int32_t tet, run *runs)
{
    int32_t count = 0;
    for (int32_t n = voxels->start[tet]; n < voxels->start[tet + 1]; n++) {
        const int32_t voxel = voxels->voxel[n];
        if (count > 0 && voxel == runs[count - 1].last + 1 && voxel % voxels->geometry.size[0] != 0) {
            runs[count - 1].last = voxel;
            continue;
        }
        int32_t at[3];
        pliant_place_of(voxels, voxel, at);
        runs[count++] = (run){voxel, voxel, at[0], at[1], at[2]};
    }
    return count;
}

/* Return whether a run and a run of an adjacent row are joined by a link or a diagonal.
 * to: the first run's position in that row */
static bool runs_joined(const pliant_links *links, const run *one, const run *other, int32_t to, const int8_t row[3])
{
    const bool straight = !row[0] || !row[1];
    const int32_t low = other->first > to ? other->first : to,
                  high = other->last < to + one->last - one->first ? other->last : to + one->last - one->first;
    if (straight && low <= high) return true;
    int32_t at[3] = {0, one->j, one->k};
    for (int32_t w = low; w <= high; w++) { /* across an edge, at the same i */
        at[0] = one->i + w - to;
        if (pliant_joined(links, one->first + w - to, at, (const int8_t[3]){0, row[0], row[1]})) return true;
    }
    if (!straight) return false;
    const bool after = other->first > to;
    at[0] = after ? one->i + one->last - one->first : one->i;
    return pliant_joined(links, after ? one->last : one->first, at, (const int8_t[3]){after ? 1 : -1, row[0], row[1]});
}

/* runs, part: buffers, one entry per voxel of the tetrahedron */
static int32_t count_parts_of(const pliant_voxels *voxels, int32_t tet, run *runs, int32_t *part)
{
    const pliant_links links = {.voxels = voxels};
    const int32_t *size = voxels->geometry.size, count = list_runs(voxels, tet, runs);
    int32_t from[4] = {0}, parts = count;
    for (int32_t r = 0; r < count; r++) part[r] = r;
    for (int32_t r = 0; r < count && parts > 1; r++)
        for (int b = 0; b < 4; b++) {
            const run *one = runs + r;
            const int32_t j = one->j + lower_rows[b][0], k = one->k + lower_rows[b][1], more = lower_rows[b][2];
            if (j < 0 || j >= size[1] || k >= size[2]) continue;
            const int32_t to = one->i + size[0] * (j + size[1] * k), length = one->last - one->first;
            const int32_t low = one->i > 0 ? to - more : to,
                          high = one->i + length + 1 < size[0] ? to + length + more : to + length;
            while (from[b] < count && runs[from[b]].last < low) from[b]++;
            for (int32_t other = from[b]; other < count && runs[other].first <= high; other++) {
                if (pliant_set_root(part, r) == pliant_set_root(part, other) ||
                    !runs_joined(&links, one, runs + other, to, lower_rows[b]))
                    continue;
                pliant_set_join(part, r, other);
                parts--;
            }
        }
    return parts;
}

/* runs, part: buffers (threads x maximum number of voxels of a tetrahedron) */
static void count_parts(const pliant_voxels *voxels, int threads, size_t maximum, run *runs, int32_t *part,
                        int32_t *parts)
{
#pragma omp parallel for schedule(dynamic, 64) num_threads(threads)
    for (int32_t tet = 0; tet < voxels->num_tets; tet++) {
        const size_t capacity = maximum * (size_t)omp_get_thread_num();
        parts[tet] = count_parts_of(voxels, tet, runs + capacity, part + capacity);
    }
}

/* ---- bridges */

/* Connect the parts of each tetrahedron by a minimum spanning tree (Prim).
 * part: buffer (maximum number of voxels of a tetrahedron)
 * parts: result of count_parts */
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
        voxels->bridge_start[tet + 1] = work->count; /* its own bridges are not visible while its parts are computed */
    }
    return status;
}

static int face_towards(const pliant_voxels *voxels, int32_t tet, int32_t other)
{
    for (int c = 0; c < 4; c++)
        if (voxels->across[4 * (size_t)tet + c] == other) return c;
    return -1;
}

/* Mark the faces that a link or a diagonal crosses.
 * linked: (num_tets x 4), zeroed by the caller */
static void find_linked(const pliant_voxels *voxels, int threads, uint8_t *linked)
{
    const pliant_links links = {.voxels = voxels};
    const int32_t *size = voxels->geometry.size, *owner = voxels->owner;
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads)
    for (int32_t k = 0; k < size[2]; k++)
        for (int32_t v = size[0] * size[1] * k; v < size[0] * size[1] * (k + 1); v++) {
            int32_t at[3] = {-1, 0, 0};
            for (int n = 0; n < 9 && owner[v] >= 0; n++) {
                const int8_t *step = pliant_later_neighbours[n];
                const int64_t w = v + step[0] + (int64_t)size[0] * (step[1] + (int64_t)size[1] * step[2]);
                if (w >= (int64_t)size[0] * size[1] * size[2] || owner[w] < 0 || owner[w] == owner[v]) continue;
                const int face = face_towards(voxels, owner[v], owner[w]);
                uint8_t known = 1;
                if (face < 0) continue;
#pragma omp atomic read
                known = linked[4 * (size_t)owner[v] + (size_t)face];
                if (known) continue;
                if (at[0] < 0) pliant_place_of(voxels, v, at);
                if (pliant_step_to(voxels, v, at, step) < 0 || !pliant_joined(&links, v, at, step)) continue;
                const int back = face_towards(voxels, owner[w], owner[v]);
#pragma omp atomic write
                linked[4 * (size_t)owner[v] + (size_t)face] = 1;
                if (back < 0) continue;
#pragma omp atomic write
                linked[4 * (size_t)owner[w] + (size_t)back] = 1;
            }
        }
}

/* Add a bridge for every inner face whose two tetrahedra are not linked.
 * linked: (num_tets x 4), zeroed by the caller */
static pliant_status bridge_faces(bridges *work, int threads, uint8_t *linked)
{
    const pliant_voxels *voxels = work->voxels;
    const int32_t *across = voxels->across;
    pliant_status status = PLIANT_OK;
    find_linked(voxels, threads, linked);
    for (int32_t f = 0; f < 4 * voxels->num_tets && status == PLIANT_OK; f++) {
        int32_t tet = f / 4, other = across[f], pair[2] = {-1, -1};
        if (other <= tet || linked[f] || voxels->start[tet] == voxels->start[tet + 1] ||
            voxels->start[other] == voxels->start[other + 1])
            continue;
        closest(work, tet, other, NULL, pair);
        status = add_bridge(work, pair);
    }
    return status;
}

/* Group the corners around a node that faces with this node connect.
 * part: (corners around the node) */
static void group_corners_around(const pliant_mesh *fine, const pliant_voxels *voxels, int32_t node, int32_t *part)
{
    const int32_t *corner = voxels->around + voxels->around_start[node];
    const int32_t count = voxels->around_start[node + 1] - voxels->around_start[node];
    for (int32_t i = 0; i < count; i++) part[i] = i;
    for (int32_t i = 0; i < count; i++)
        for (int c = 0; c < 4; c++) {
            const int32_t other = voxels->across[4 * (corner[i] / 4) + c];
            if (c == corner[i] % 4 || other < corner[i] / 4) continue;
            for (int32_t j = i + 1; j < count; j++)
                if (corner[j] / 4 == other && fine->tets[corner[j]] == node) pliant_set_join(part, i, j);
        }
}

/* Replace *voxel by the tetrahedron's voxel nearest to a point, if it is nearer than *least.
 * index: point in voxel indices */
static void nearer(const bridges *work, int32_t tet, const double index[3], double *minimum, int32_t *voxel)
{
    const pliant_voxels *voxels = work->voxels;
    for (int32_t v = voxels->start[tet]; v < voxels->start[tet + 1]; v++) {
        int32_t at[3];
        double squares = 0;
        pliant_place_of(voxels, voxels->voxel[v], at);
        for (int d = 0; d < 3; d++)
            squares += (at[d] - index[d]) * (at[d] - index[d]) * work->spacing[d] * work->spacing[d];
        if (*voxel >= 0 && squares >= *minimum) continue;
        *minimum = squares;
        *voxel = voxels->voxel[v];
    }
}

/* Add bridges where tetrahedra meet only at a node or an edge. They connect the voxels nearest to the node: the
 * voxels of the first fan with the voxels of every other fan. */
static pliant_status bridge_hinges(bridges *work, const pliant_mesh *fine, int32_t *part)
{
    const pliant_voxels *voxels = work->voxels;
    pliant_status status = PLIANT_OK;
    for (int32_t node = 0; node < fine->num_nodes && status == PLIANT_OK; node++) {
        const int32_t *corner = voxels->around + voxels->around_start[node];
        const int32_t count = voxels->around_start[node + 1] - voxels->around_start[node];
        int32_t pair[2] = {-1, -1}, fans = 0;
        double index[3];
        group_corners_around(fine, voxels, node, part);
        for (int32_t i = 0; i < count; i++) fans += part[i] == i;
        if (fans < 2) continue;
        pliant_geometry_to_index(&voxels->geometry, fine->rest + 3 * node, index);
        for (int32_t i = 0; i < count && status == PLIANT_OK; i++) {
            if (part[i] != i) continue; /* not the first corner of a fan */
            double minimum = 0;
            int32_t voxel = -1;
            for (int32_t j = i; j < count; j++)
                if (pliant_set_root(part, j) == i) nearer(work, corner[j] / 4, index, &minimum, &voxel);
            pair[pair[0] >= 0] = voxel;
            if (pair[0] >= 0 && pair[1] >= 0) status = add_bridge(work, pair);
        }
    }
    return status;
}

/* List the bridges of each tetrahedron to other tetrahedra, in two passes: count and fill. */
static pliant_status list_beside(pliant_voxels *voxels)
{
    const int32_t first = voxels->bridge_start[voxels->num_tets], ends = 2 * (voxels->num_bridges - first);
    int32_t *start = voxels->adjacent_start = pliant_calloc((size_t)voxels->num_tets + 2, sizeof *start);
    voxels->adjacent = pliant_calloc((size_t)ends + 1, sizeof *voxels->adjacent);
    if (!start || !voxels->adjacent) return pliant_fail_memory("the voxels of the mesh");
    for (int32_t e = 0; e < ends; e++) start[voxels->owner[voxels->bridge[2 * first + e]] + 2]++;
    for (int32_t t = 0; t < voxels->num_tets; t++) start[t + 2] += start[t + 1];
    for (int32_t e = 0; e < ends; e++)
        voxels->adjacent[start[voxels->owner[voxels->bridge[2 * first + e]] + 1]++] = first + e / 2;
    return PLIANT_OK;
}

pliant_status pliant_bridges_build(const pliant_mesh *fine, pliant_voxels *voxels)
{
    bridges work = {.voxels = voxels, .spacing = voxels->geometry.spacing};
    size_t maximum = 1;
    for (int32_t t = 0; t < voxels->num_tets; t++)
        if ((size_t)(voxels->start[t + 1] - voxels->start[t]) > maximum)
            maximum = (size_t)(voxels->start[t + 1] - voxels->start[t]);
    for (int32_t n = 0; n < voxels->num_nodes; n++)
        if ((size_t)(voxels->around_start[n + 1] - voxels->around_start[n]) > maximum)
            maximum = (size_t)(voxels->around_start[n + 1] - voxels->around_start[n]);
    const int threads = omp_get_max_threads();
    int32_t *part = pliant_calloc((size_t)threads * maximum, sizeof *part),
            *parts = pliant_calloc((size_t)voxels->num_tets + 1, sizeof *parts);
    uint8_t *linked = pliant_calloc((size_t)voxels->num_tets, 4);
    run *runs = pliant_calloc((size_t)threads * maximum, sizeof *runs);
    work.place = pliant_calloc(maximum, 3 * sizeof *work.place);
    pliant_status status =
        part && parts && linked && runs && work.place ? PLIANT_OK : pliant_fail_memory("the voxels of the mesh");
    if (status == PLIANT_OK) count_parts(voxels, threads, maximum, runs, part, parts);
    if (status == PLIANT_OK) status = bridge_within(&work, parts, part);
    if (status == PLIANT_OK) status = bridge_faces(&work, threads, linked);
    if (status == PLIANT_OK) status = bridge_hinges(&work, fine, part);
    PLIANT_FREE(part, parts, linked, runs, work.place);
    voxels->bridge = work.pair;
    voxels->num_bridges = work.count;
    return status == PLIANT_OK ? list_beside(voxels) : status;
}
