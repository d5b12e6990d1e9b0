/* Find the fragment at a point of the deformed body. */
#include "topology/links.h"
#include "cut/cut_stages.h"
#include "mesh/mesh.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

/* A point on a face is inside both tetrahedra. The tolerance prevents rounding from placing it outside both. */
static const double tolerance = 1e-9;

/* Return the trilinear weight at a point of the voxels that belong to a fragment or to fragments joined with it. */
static double weight_of(const pliant_body *body, int32_t fragment, const double index[3])
{
    const pliant_voxels *voxels = body->voxels;
    double sum = 0;
    for (int corner = 0; corner < 8; corner++) {
        int32_t at[3];
        double weight = 1;
        for (int d = 0; d < 3; d++) {
            const double low = floor(index[d]);
            at[d] = (int32_t)low + (corner >> d & 1);
            weight *= corner >> d & 1 ? index[d] - low : 1 - (index[d] - low);
        }
        if (at[0] < 0 || at[1] < 0 || at[2] < 0 || at[0] >= voxels->geometry.size[0] ||
            at[1] >= voxels->geometry.size[1] || at[2] >= voxels->geometry.size[2])
            continue;
        const int32_t with = pliant_voxels_fragment(
            voxels, body->cuts, at[0] + voxels->geometry.size[0] * (at[1] + voxels->geometry.size[1] * at[2]));
        if (with >= 0 && (with == fragment || pliant_cuts_join(body->cuts, fragment, with))) sum += weight;
    }
    return sum;
}

/* Return whether a fragment occupies a rest point: it has the maximum weight of all fragments of its tetrahedron, the
 * first one at a tie. */
static bool is_there(const pliant_body *body, int32_t fragment, const double barycentric[4])
{
    const pliant_cuts *cuts = body->cuts;
    const int32_t tet = body->tet_parent ? body->tet_parent[fragment] : fragment;
    const int32_t *list, count = pliant_fragments_of(cuts, &tet, &list);
    if (count == 1) return true;
    double rest[3] = {0}, index[3], maximum = -1;
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++)
            rest[d] += barycentric[v] * body->fine.rest[3 * (size_t)body->fine.tets[4 * (size_t)fragment + v] + d];
    pliant_geometry_to_index(&body->voxels->geometry, rest, index);
    int32_t first = -1;
    for (int32_t f = 0; f < count; f++) {
        const double weight = weight_of(body, list[f], index);
        if (weight <= maximum) continue;
        maximum = weight;
        first = list[f];
    }
    return first == fragment;
}

static bool inside(const pliant_mesh *mesh, const double *positions, int32_t tet, const double point[3],
                   double barycentric[4])
{
    const int32_t *nodes = mesh->tets + 4 * (size_t)tet;
    const double *x0 = positions + 3 * (size_t)nodes[0];
    double gradients[12];
    const double volume = pliant_tet_gradients(x0, positions + 3 * (size_t)nodes[1], positions + 3 * (size_t)nodes[2],
                                               positions + 3 * (size_t)nodes[3], gradients);
    bool in = volume > 0;
    barycentric[0] = 1;
    for (int v = 1; v < 4; v++) {
        barycentric[v] = 0;
        for (int d = 0; d < 3; d++) barycentric[v] += gradients[3 * v + d] * (point[d] - x0[d]);
        barycentric[0] -= barycentric[v];
    }
    for (int v = 0; v < 4; v++) in = in && barycentric[v] >= -tolerance;
    return in;
}

/* Compute the bounding box of a tetrahedron. Return false if it does not overlap the box from least to most. The test
 * of the first axis comes first because it rejects most tetrahedra. */
static bool is_between(const pliant_mesh *mesh, const double *positions, int32_t tet, const double minimum[3],
                       const double maximum[3], double low[3], double high[3])
{
    const int32_t *nodes = mesh->tets + 4 * (size_t)tet;
    for (int d = 0; d < 3; d++) {
        low[d] = high[d] = positions[3 * (size_t)nodes[0] + d];
        for (int v = 1; v < 4; v++) {
            const double x = positions[3 * (size_t)nodes[v] + d];
            low[d] = x < low[d] ? x : low[d];
            high[d] = x > high[d] ? x : high[d];
        }
        const double slack = tolerance * (high[d] - low[d]);
        low[d] -= slack;
        high[d] += slack;
        if (!(low[d] <= maximum[d] && high[d] >= minimum[d])) return false;
    }
    return true;
}

/* Return an array (fine tetrahedra) that is 1 for those which may overlap a box; NULL if there is no lattice or no
 * memory, and then all may. */
static uint8_t *find_near(const pliant_body *body, const double *positions, const double low[3], const double high[3])
{
    cut_strip box = {.count = 0};
    uint8_t *near = NULL;
    if (!body->voxels || !body->fine.tet_of_lattice || !body->fine.lattice_of_node) return NULL;
    memcpy(box.low, low, sizeof box.low);
    memcpy(box.high, high, sizeof box.high);
    if (pliant_cut_find_near_tets(body, positions, &box, tolerance, 0, &near) == PLIANT_OK) return near;
    pliant_free(near);
    return NULL;
}

static int32_t next_near(const uint8_t *near, int32_t from, int32_t count)
{
    const uint8_t *found = near && from < count ? memchr(near + from, 1, (size_t)(count - from)) : NULL;
    return !near ? from : found ? (int32_t)(found - near) : count;
}

/* test all tetrahedra in ascending order against the points without a result, after a test of their common box */
void pliant_body_locate_points(const pliant_body *body, const double *positions, int32_t count, const double *points,
                               int32_t *tet, double *barycentric)
{
    const pliant_mesh *mesh = &body->fine;
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, from[3], to[3],
           weights[4];
    for (int32_t p = 0; p < count; p++) {
        tet[p] = -1;
        for (int d = 0; d < 3; d++) {
            if (points[3 * p + d] < low[d]) low[d] = points[3 * p + d];
            if (points[3 * p + d] > high[d]) high[d] = points[3 * p + d];
        }
    }
    uint8_t *near = find_near(body, positions, low, high);
    for (int32_t t = next_near(near, 0, mesh->num_tets); t < mesh->num_tets;
         t = next_near(near, t + 1, mesh->num_tets)) {
        if (!is_between(mesh, positions, t, low, high, from, to)) continue;
        for (int32_t p = 0; p < count; p++) {
            const double *point = points + 3 * p;
            if (tet[p] >= 0 || !(point[0] >= from[0] && point[0] <= to[0] && point[1] >= from[1] && point[1] <= to[1] &&
                                 point[2] >= from[2] && point[2] <= to[2]))
                continue;
            if (!inside(mesh, positions, t, point, weights) || !is_there(body, t, weights)) continue;
            tet[p] = t;
            memcpy(barycentric + 4 * p, weights, sizeof weights);
        }
    }
    pliant_free(near);
}

bool pliant_body_locate(const pliant_body *body, const double *positions, const double point[3], int32_t *tet,
                        double barycentric[4])
{
    int32_t found;
    double weights[4];
    pliant_body_locate_points(body, positions, 1, point, &found, weights);
    if (found < 0) return false;
    *tet = found;
    memcpy(barycentric, weights, sizeof weights);
    return true;
}
