/* Places nodes on the surface of fixed tissue ([H] 4.2, figure 6: regularly sampled nodes together with nodes on the
 * surface of segmented bones).
 *
 * The surface consists of the faces between fixed voxels and others. An edge may cross it. A node of such an edge is
 * moved to its nearest surface point, if every adjacent tetrahedron stays at least as good as PLIANT_BONE_QUALITY. The
 * nearest nodes come first. Nodes, tetrahedra and connectivity stay the same. Labelle and Shewchuk 2007 fill space with
 * a lattice in the same way, and then cut the remaining crossing edges; here these edges are only counted. Nodes on the
 * scan's box slide along its sides. Nodes next to left-out tetrahedra stay.
 *
 * All lengths are in units of cells along the scan's axes, where the lattice consists of unit cubes. */
#include "base/fail.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Maximum motion of a node: half the longest edge of a unit cube's tetrahedra. One end of every crossing edge is then
 * close enough. */
static const double reach = 0.70710678118654752;
static const double on_surface = 1e-9;

typedef struct bone_work {
    const pliant_geometry *geometry;
    const uint8_t *fixed_voxel;
    pliant_mesh *mesh;
    double voxels[3];          /* per cell, along each axis */
    int32_t *start, *around;   /* tetrahedra of every node */
    double (*at)[3], (*target)[3];
    double *squared_distance; /* (nodes) squared distance to the target; INFINITY: the node stays */
    uint8_t *held;            /* (nodes) nonzero: next to a left-out tetrahedron */
    uint8_t *place;           /* (nodes) pliant_bone_side */
    struct candidate { double squared_distance; int32_t node; } *candidates;
} bone_work;

static bool is_fixed(const bone_work *work, const int32_t v[3])
{
    const int32_t *size = work->geometry->size;
    return work->fixed_voxel[(size_t)v[0] + (size_t)size[0] * ((size_t)v[1] + (size_t)size[1] * (size_t)v[2])];
}

static bool fixed_at(const bone_work *work, const double at[3])
{
    int32_t v[3];
    for (int d = 0; d < 3; d++) {
        double voxel = floor(at[d] * work->voxels[d]);
        v[d] = (int32_t)fmin(fmax(voxel, 0), work->geometry->size[d] - 1);
    }
    return is_fixed(work, v);
}

/* Test the nearest point of a rectangle of the surface, between voxel v and the next one along an axis. */
static void try_face(const bone_work *work, int32_t node, const int32_t v[3], int axis)
{
    double point[3], squared_distance = 0;
    for (int d = 0; d < 3; d++) {
        double at = work->at[node][d], low = v[d] / work->voxels[d], high = (v[d] + 1) / work->voxels[d];
        point[d] = d == axis ? high : fmin(fmax(at, low), high);
        bool side = at == 0 || at == work->mesh->cells[d];
        if (side && fabs(point[d] - at) > on_surface) return; /* would leave the side of the box */
        squared_distance += (point[d] - at) * (point[d] - at);
    }
    if (squared_distance >= work->squared_distance[node]) return;
    work->squared_distance[node] = squared_distance;
    memcpy(work->target[node], point, sizeof point);
}

static void find_target(const bone_work *work, int32_t node)
{
    int32_t low[3], high[3], v[3];
    for (int d = 0; d < 3; d++) {
        low[d] = (int32_t)fmax(floor((work->at[node][d] - reach) * work->voxels[d]) - 1, 0);
        high[d] = (int32_t)fmin(ceil((work->at[node][d] + reach) * work->voxels[d]), work->geometry->size[d] - 1);
    }
    work->squared_distance[node] = INFINITY;
    for (v[2] = low[2]; v[2] <= high[2]; v[2]++)
        for (v[1] = low[1]; v[1] <= high[1]; v[1]++)
            for (v[0] = low[0]; v[0] <= high[0]; v[0]++)
                for (int d = 0; d < 3; d++) {
                    int32_t next[3] = {v[0] + (d == 0), v[1] + (d == 1), v[2] + (d == 2)};
                    if (next[d] > high[d] || is_fixed(work, v) == is_fixed(work, next)) continue;
                    try_face(work, node, v, d);
                }
    if (work->squared_distance[node] > reach * reach) work->squared_distance[node] = INFINITY;
    if (work->held[node] && work->squared_distance[node] > on_surface * on_surface)
        work->squared_distance[node] = INFINITY;
}

/* Return the quality: 1 for a regular tetrahedron, 0 for a flat one. It is 6 sqrt(2) V divided by the cubed root mean
 * square of the edges (Parthasarathy et al. 1994). */
static double quality_of(const bone_work *work, const int32_t nodes[4])
{
    double edges[3][3], sum = 0;
    for (int a = 0; a < 4; a++)
        for (int b = a + 1; b < 4; b++)
            for (int d = 0; d < 3; d++) {
                double length = work->at[nodes[b]][d] - work->at[nodes[a]][d];
                sum += length * length;
                if (a == 0) edges[b - 1][d] = length;
            }
    double determinant = 0;
    for (int d = 0; d < 3; d++)
        determinant += edges[0][d] *
                       (edges[1][(d + 1) % 3] * edges[2][(d + 2) % 3] - edges[1][(d + 2) % 3] * edges[2][(d + 1) % 3]);
    return sqrt(2) * determinant / pow(sum / 6, 1.5);
}

/* Return the sign of a lattice tetrahedron's volume: positive in a right-handed scan. */
static double sign_of(const pliant_mesh *mesh)
{
    const double *m = mesh->direction;
    double handed =
        m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) + m[2] * (m[3] * m[7] - m[4] * m[6]);
    return handed < 0 ? -1 : 1;
}

static bool try_move(const bone_work *work, int32_t node)
{
    double before[3], sign = sign_of(work->mesh);
    memcpy(before, work->at[node], sizeof before);
    memcpy(work->at[node], work->target[node], sizeof before);
    for (int32_t e = work->start[node]; e < work->start[node + 1]; e++) {
        if (sign * quality_of(work, work->mesh->tets + 4 * work->around[e]) >= PLIANT_BONE_QUALITY) continue;
        memcpy(work->at[node], before, sizeof before);
        return false;
    }
    work->place[node] = PLIANT_BONE_SURFACE;
    return true;
}

/* Return whether an edge crosses the surface: its ends are on different sides, or fixed tissue is between two free
 * ends. */
static bool crosses(const bone_work *work, int32_t a, int32_t b)
{
    if (work->place[a] == PLIANT_BONE_SURFACE || work->place[b] == PLIANT_BONE_SURFACE) return false;
    if (work->place[a] != work->place[b]) return true;
    if (work->place[a] == PLIANT_BONE_INSIDE) return false;
    double longest = 0;
    for (int d = 0; d < 3; d++) longest = fmax(longest, fabs(work->at[b][d] - work->at[a][d]) * work->voxels[d]);
    int samples = (int)ceil(2 * longest);
    for (int s = 1; s < samples; s++) {
        double point[3];
        for (int d = 0; d < 3; d++) point[d] = work->at[a][d] + (work->at[b][d] - work->at[a][d]) * s / samples;
        if (fixed_at(work, point)) return true;
    }
    return false;
}

static bool any_crosses(const bone_work *work, int32_t node)
{
    for (int32_t e = work->start[node]; e < work->start[node + 1]; e++)
        for (int v = 0; v < 4; v++) {
            int32_t other = work->mesh->tets[4 * work->around[e] + v];
            if (other != node && crosses(work, node, other)) return true;
        }
    return false;
}

static pliant_status prepare(bone_work *work)
{
    const pliant_mesh *mesh = work->mesh;
    size_t nodes = (size_t)mesh->num_nodes;
    int32_t *triangles = NULL, count = 0, nx = mesh->cells[0] + 1, ny = mesh->cells[1] + 1;
    work->start = pliant_calloc(nodes + 2, sizeof *work->start);
    work->around = pliant_calloc((size_t)mesh->num_tets, 4 * sizeof *work->around);
    work->at = pliant_calloc(nodes, sizeof *work->at);
    work->target = pliant_calloc(nodes, sizeof *work->target);
    work->squared_distance = pliant_calloc(nodes, sizeof *work->squared_distance);
    work->held = pliant_calloc(nodes, 1);
    work->place = pliant_calloc(nodes, 1);
    work->candidates = pliant_calloc(nodes, sizeof *work->candidates);
    if (!work->start || !work->around || !work->at || !work->target || !work->squared_distance || !work->held ||
        !work->place || !work->candidates)
        return pliant_fail_memory("the nodes on bone");
    for (int d = 0; d < 3; d++) work->voxels[d] = (double)work->geometry->size[d] / mesh->cells[d];
    for (int32_t v = 0; v < 4 * mesh->num_tets; v++) work->start[mesh->tets[v] + 2]++;
    for (size_t n = 0; n < nodes; n++) work->start[n + 2] += work->start[n + 1];
    for (int32_t v = 0; v < 4 * mesh->num_tets; v++) work->around[work->start[mesh->tets[v] + 1]++] = v / 4;
    for (size_t n = 0; n < nodes; n++) {
        int32_t lattice = mesh->lattice_of_node[n];
        work->at[n][0] = lattice % nx;
        work->at[n][1] = lattice / nx % ny;
        work->at[n][2] = lattice / nx / ny;
    }
    pliant_status status = pliant_mesh_surface(mesh, NULL, NULL, &triangles, &count);
    for (int32_t t = 0; status == PLIANT_OK && t < count; t++) {
        const int32_t *corners = triangles + 3 * t;
        bool on_box = false;
        for (int d = 0; d < 3; d++) {
            double at = work->at[corners[0]][d];
            on_box = on_box || ((at == 0 || at == mesh->cells[d]) && work->at[corners[1]][d] == at &&
                                work->at[corners[2]][d] == at);
        }
        for (int v = 0; v < 3 && !on_box; v++) work->held[corners[v]] = 1;
    }
    pliant_free(triangles);
    return status;
}

static int nearest_first(const void *a, const void *b)
{
    const struct candidate *i = a, *j = b;
    if (i->squared_distance != j->squared_distance) return i->squared_distance < j->squared_distance ? -1 : 1;
    return i->node < j->node ? -1 : i->node > j->node;
}

static int32_t move_nodes(bone_work *work)
{
    pliant_mesh *mesh = work->mesh;
    int32_t count = 0, moved = 0;
#pragma omp parallel for schedule(dynamic, 64)
    for (int32_t n = 0; n < mesh->num_nodes; n++) {
        find_target(work, n);
        work->place[n] = work->squared_distance[n] <= on_surface * on_surface ? PLIANT_BONE_SURFACE
                         : fixed_at(work, work->at[n])             ? PLIANT_BONE_INSIDE
                                                                   : PLIANT_BONE_OUTSIDE;
    }
    for (int32_t n = 0; n < mesh->num_nodes; n++)
        if (work->place[n] != PLIANT_BONE_SURFACE && work->squared_distance[n] < INFINITY)
            work->candidates[count++] = (struct candidate){work->squared_distance[n], n};
    qsort(work->candidates, (size_t)count, sizeof *work->candidates, nearest_first);
    for (int pass = 0; pass < 2; pass++) /* nodes that could not move may move after others */
        for (int32_t c = 0; c < count; c++) {
            int32_t node = work->candidates[c].node;
            if (work->place[node] != PLIANT_BONE_SURFACE && any_crosses(work, node)) moved += try_move(work, node);
        }
    return moved;
}

static void place_nodes(const bone_work *work)
{
    pliant_mesh *mesh = work->mesh;
    for (int32_t n = 0; n < mesh->num_nodes; n++) {
        if (work->place[n] != PLIANT_BONE_SURFACE || work->squared_distance[n] <= on_surface * on_surface) continue;
        for (int r = 0; r < 3; r++) {
            mesh->rest[3 * n + r] = mesh->corner[r];
            for (int d = 0; d < 3; d++)
                mesh->rest[3 * n + r] += mesh->direction[3 * r + d] * work->at[n][d] * mesh->cell_size[d];
        }
    }
}

pliant_status pliant_mesh_bone(const pliant_geometry *geometry, const uint8_t *fixed_voxel, pliant_mesh *mesh)
{
    bone_work work = {.geometry = geometry, .fixed_voxel = fixed_voxel, .mesh = mesh};
    pliant_status status = prepare(&work);
    if (status == PLIANT_OK) {
        int32_t moved = move_nodes(&work), crossing = 0;
        place_nodes(&work);
        for (int32_t n = 0; n < mesh->num_nodes; n++) crossing += any_crosses(&work, n);
        pliant_log(
            PLIANT_LOG_INFO,
            "mesh: %d nodes were moved onto the surface of the fixed tissue; %d nodes have edges that still cross it",
            moved, crossing);
        mesh->num_moved = moved;
        mesh->place_of_node = work.place;
        work.place = NULL;
    }
    PLIANT_FREE(work.start, work.around, work.at, work.target, work.squared_distance, work.held, work.place,
                work.candidates);
    return status;
}
