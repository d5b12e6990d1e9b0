/* Flatten the tips of a cut surface. Where a cut passes next to a corner of a tetrahedron without voxels beyond the
 * corner, the corner stays attached. It forms a tip on one side of the cut and a pit on the other side. */
#include "topology/surface.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <math.h>

/* Sum of the neighbours of a tip along faces of cuts. */
typedef struct tip { double sum[3]; int32_t count; bool alone; } tip;

static void find_rest(const pliant_surface *surface, int32_t point, double out[3])
{
    const pliant_mesh *mesh = &surface->body->fine;
    const int32_t own = point - mesh->num_nodes, *node = own < 0 ? &point : mesh->tets + 4 * (size_t)surface->tet[own];
    for (int d = 0; d < 3; d++) out[d] = 0;
    for (int v = 0; v < (own < 0 ? 1 : 4); v++)
        for (int d = 0; d < 3; d++)
            out[d] += (own < 0 ? 1 : surface->weight[4 * (size_t)own + (size_t)v]) *
                      mesh->rest[3 * (size_t)node[v] + (size_t)d];
}

/* Return whether a point is a corner of small tetrahedra. Only corners can be tips; between fragments the surface has
 * only crossings. */
static bool is_corner(const pliant_surface *surface, const uint8_t *is_lattice, int32_t point)
{
    return point < surface->body->fine.num_nodes || is_lattice[point - surface->body->fine.num_nodes];
}

/* instead: (nodes) -1: on the outer surface, so it is not moved */
static bool find_tips(const pliant_surface *surface, const uint8_t *is_lattice, const int32_t *instead,
                      surface_map *tips, surface_list *found)
{
    for (int32_t c = 3 * surface->first_cut; c < 3 * surface->num_triangles; c++) {
        const int32_t first = c - c % 3, point = surface->triangle[c];
        if (!is_corner(surface, is_lattice, point) || (point < surface->body->fine.num_nodes && instead[point] < 0))
            continue;
        const surface_key key = {{point}, {1}};
        const int32_t number = pliant_surface_number(tips, &key);
        tip *at = number < 0                      ? NULL
                  : (size_t)number < found->count ? (tip *)found->at + number
                                                  : pliant_surface_add(found);
        if (!at) return false;
        if (at->count == 0) *at = (tip){.alone = true};
        for (int v = 1; v < 3; v++) {
            const int32_t end = surface->triangle[first + (c % 3 + v) % 3];
            double rest[3];
            find_rest(surface, end, rest);
            for (int d = 0; d < 3; d++) at->sum[d] += rest[d];
            at->alone = at->alone && !is_corner(surface, is_lattice, end);
            at->count++;
        }
    }
    return true;
}

static double min_of(const double weight[4]) { return fmin(fmin(weight[0], weight[1]), fmin(weight[2], weight[3])); }

/* Return the fragment with a node that contains a point, or the nearest one. */
static int32_t find_holder(const surface_maker *maker, int32_t node, const double place[3])
{
    const int32_t parent = pliant_surface_load_node(maker, node);
    int32_t best = -1;
    double maximum = -INFINITY, weight[4];
    for (int32_t a = maker->voxels->around_start[parent]; a < maker->voxels->around_start[parent + 1]; a++) {
        const int32_t host = maker->voxels->around[a] / 4, corner = maker->voxels->around[a] % 4,
                      cut = maker->cut_of[host];
        const int32_t count = cut < 0 ? 1 : maker->cuts->start[cut + 1] - maker->cuts->start[cut];
        for (int32_t f = 0; f < count; f++) {
            const int32_t tet = cut < 0 ? host : maker->cuts->fragment[maker->cuts->start[cut] + f];
            if (maker->body->fine.tets[4 * (size_t)tet + (size_t)corner] != node) continue;
            pliant_mesh_barycentric(&maker->body->fine, tet, place, weight);
            if (!(min_of(weight) > maximum)) continue;
            maximum = min_of(weight);
            best = tet;
        }
    }
    return best;
}

/* Move a vertex to the mean of its neighbours, or as near to it as its tetrahedron extends. */
static void flatten(const pliant_surface *surface, const double middle[3], int32_t vertex)
{
    double weight[4], sum = 0;
    pliant_mesh_barycentric(&surface->body->fine, surface->tet[vertex], middle, weight);
    for (int v = 0; v < 4; v++) sum += weight[v] = fmax(weight[v], 0);
    for (int v = 0; v < 4; v++) surface->weight[4 * (size_t)vertex + (size_t)v] = weight[v] / sum;
}

/* Flatten all tips. A tip at a node is replaced by a vertex.
 * instead: output, (nodes) 1 + the vertex */
static void flatten_all(const surface_maker *maker, const surface_map *tips, const surface_list *found,
                        int32_t *instead, pliant_surface *surface)
{
    const int32_t nodes = surface->body->fine.num_nodes;
    for (int32_t n = 0; n < tips->count; n++) {
        const tip *at = (const tip *)found->at + n;
        const int32_t point = tips->key[n].node[0];
        int32_t vertex = point - nodes;
        double middle[3];
        if (!at->alone) continue;
        for (int d = 0; d < 3; d++) middle[d] = at->sum[d] / at->count;
        if (vertex < 0) {
            vertex = surface->num_vertices++;
            instead[point] = vertex + 1;
            surface->tet[vertex] = find_holder(maker, point, middle);
            surface->material[vertex] = surface->body->fine_material[surface->tet[vertex]].material;
        }
        flatten(surface, middle, vertex);
    }
    for (int32_t c = 0; c < 3 * surface->num_triangles; c++)
        if (surface->triangle[c] < nodes && instead[surface->triangle[c]] > 0)
            surface->triangle[c] = nodes + instead[surface->triangle[c]] - 1;
}

pliant_status pliant_surface_flatten(const surface_maker *maker, const uint8_t *is_lattice, pliant_surface *surface)
{
    surface_map tips = {0};
    surface_list found = {.size = sizeof(tip)};
    int32_t *instead = pliant_calloc((size_t)surface->body->fine.num_nodes, sizeof *instead);
    for (int32_t c = 0; instead && c < 3 * surface->first_cut; c++)
        if (surface->triangle[c] < surface->body->fine.num_nodes) instead[surface->triangle[c]] = -1;
    const bool good = instead && find_tips(surface, is_lattice, instead, &tips, &found);
    if (good) flatten_all(maker, &tips, &found, instead, surface);
    pliant_surface_map_free(&tips);
    pliant_free(found.at);
    pliant_free(instead);
    return good ? PLIANT_OK : pliant_surface_no_memory();
}
