/* Compare two bodies, and map the elements of one to the other. */
#include "base/fail.h"
#include "base/buffer.h"
#include "topology/body.h"
#include "base/memory.h"

#include <string.h>

static bool equal(const void *a, const void *b, size_t count, size_t size)
{
    if (!a || !b) return !a && !b;
    return a == b || memcmp(a, b, count * size) == 0;
}

static bool same_mesh(const pliant_mesh *a, const pliant_mesh *b)
{
    if (a->num_nodes != b->num_nodes || a->num_tets != b->num_tets || memcmp(a->cells, b->cells, sizeof a->cells) != 0)
        return false;
    size_t nodes = (size_t)a->num_nodes, tets = (size_t)a->num_tets;
    return equal(a->rest, b->rest, nodes, 3 * sizeof *a->rest) && equal(a->tets, b->tets, tets, 4 * sizeof *a->tets) &&
           equal(a->lattice_of_node, b->lattice_of_node, nodes, sizeof *a->lattice_of_node) &&
           equal(a->lattice_of_tet, b->lattice_of_tet, tets, sizeof *a->lattice_of_tet);
}

static bool same_fragments(const pliant_voxels *voxels, const pliant_cuts *a, const pliant_cuts *b)
{
    for (int32_t t = 0; t < a->num_tets; t++) {
        const int32_t tet = a->tet[t], count = voxels->start[tet + 1] - voxels->start[tet];
        if (!equal(a->voxel_fragment + a->voxel_start[t], b->voxel_fragment + b->voxel_start[t], (size_t)count,
                   sizeof *a->voxel_fragment))
            return false;
    }
    return true;
}

static bool same_cuts(const pliant_voxels *voxels, const pliant_cuts *a, const pliant_cuts *b)
{
    if (!a || !b || a == b) return a == b;
    return a->num_links == b->num_links && a->num_bridges == b->num_bridges &&
           equal(a->link, b->link, (size_t)a->num_links, sizeof *a->link) &&
           equal(a->bridge, b->bridge, (size_t)a->num_bridges, sizeof *a->bridge) && a->num_tets == b->num_tets &&
           equal(a->tet, b->tet, (size_t)a->num_tets, sizeof *a->tet) && same_fragments(voxels, a, b);
}

bool pliant_body_same(const pliant_body *a, const pliant_body *b)
{
    if (a == b) return true;
    /* cuts differ most often, so they are compared first */
    if (a->voxels != b->voxels || !same_cuts(a->voxels, a->cuts, b->cuts)) return false;
    if (!same_mesh(&a->fine, &b->fine) || !same_mesh(&a->coarse, &b->coarse) || a->num_triangles != b->num_triangles)
        return false;
    size_t nodes = (size_t)a->fine.num_nodes, tets = (size_t)a->fine.num_tets;
    size_t coarse_nodes = (size_t)a->coarse.num_nodes, coarse_tets = (size_t)a->coarse.num_tets;
    return equal(a->coarse_of_fine, b->coarse_of_fine, tets, sizeof *a->coarse_of_fine) &&
           equal(a->fine_of_coarse, b->fine_of_coarse, coarse_nodes, sizeof *a->fine_of_coarse) &&
           equal(a->triangles, b->triangles, (size_t)a->num_triangles, 3 * sizeof *a->triangles) &&
           equal(a->fine_material, b->fine_material, tets, sizeof *a->fine_material) &&
           equal(a->coarse_material, b->coarse_material, coarse_tets, sizeof *a->coarse_material) &&
           equal(a->node_mass, b->node_mass, nodes, sizeof *a->node_mass) &&
           equal(a->fine_fixed, b->fine_fixed, nodes, sizeof *a->fine_fixed) &&
           equal(a->coarse_fixed, b->coarse_fixed, coarse_nodes, sizeof *a->coarse_fixed);
}

/* Return the number in the initial mesh. NULL parents: the index itself. */
static int32_t parent_of(const int32_t *parent, int32_t index) { return parent ? parent[index] : index; }

/* Map elements of `from` to elements of `to`. Numbers stay, and all elements of `from` exist in its next body. An
 * appended element corresponds to its source if `to` is the next body of `from`, otherwise to its element of the
 * initial mesh.
 * rest_before, rest: for nodes, whose number is kept only if the rest position is equal; otherwise NULL */
static pliant_status list_sources(int32_t count, int32_t before, const int32_t *from_parent, const int32_t *to_parent,
                                  const int32_t *source, const double *rest_before, const double *rest, bool next,
                                  int32_t **out)
{
    int32_t *list = *out = pliant_malloc((size_t)count, sizeof *list);
    if (!list) return pliant_fail_memory("the map from the previous mesh topology");
    const int32_t known = next ? before : 0;
    for (int32_t i = 0; i < known; i++) list[i] = i;
    for (int32_t i = known; i < count; i++) {
        bool kept = i < before && parent_of(from_parent, i) == parent_of(to_parent, i) &&
                    (!rest || memcmp(rest_before + 3 * (size_t)i, rest + 3 * (size_t)i, 3 * sizeof *rest) == 0);
        list[i] = kept ? i : source && i >= before ? source[i - before] : parent_of(to_parent, i);
        if (list[i] < 0 || list[i] >= before)
            return pliant_fail(PLIANT_ERROR_ARGUMENT,
                               "the two bodies have different meshes: pass two topologies of the same model");
    }
    return PLIANT_OK;
}

/* List the nodes on edges that `from` does not have. */
static pliant_status list_between(const pliant_body *from, const pliant_body *to, pliant_body_map *map)
{
    const int32_t load = to->subdivision->load_nodes;
    if (!(map->between = pliant_calloc((size_t)to->fine.num_nodes, sizeof *map->between)))
        return pliant_fail_memory("the map from the previous mesh topology");
    for (int32_t n = 0; n < to->fine.num_nodes; n++) {
        const bool kept = n < load || (n < from->fine.num_nodes && map->node[n] == n);
        map->between[n] = kept ? (pliant_between){.end = {-1, -1}} : to->subdivision->between[n - load];
    }
    return PLIANT_OK;
}

void pliant_body_map_vectors(const pliant_body_map *map, const double *from, double *out)
{
    if (map->num_same > 0 && out != from) memcpy(out, from, 3 * (size_t)map->num_same * sizeof *out);
    for (int32_t n = map->num_same; n < map->num_nodes; n++) {
        const pliant_between *between = map->between && map->between[n].end[0] >= 0 ? map->between + n : NULL;
        for (int d = 0; d < 3; d++) {
            if (!between) {
                out[3 * (size_t)n + d] = from[3 * (size_t)map->node[n] + d];
                continue;
            }
            const double a = out[3 * (size_t)between->end[0] + d], b = out[3 * (size_t)between->end[1] + d];
            out[3 * (size_t)n + d] = a + between->fraction * (b - a);
        }
    }
}

pliant_status pliant_body_map_create(const pliant_body *from, const pliant_body *to, pliant_body_map *out)
{
    const pliant_body_changes *changes = &to->changes;
    bool next = changes->since == from->revision;
    pliant_body_map map = {0};
    pliant_status status =
        list_sources(to->fine.num_nodes, from->fine.num_nodes, from->node_parent, to->node_parent,
                     next ? changes->node_source : NULL, from->fine.rest, to->fine.rest, next, &map.node);
    if (status == PLIANT_OK)
        status = list_sources(to->fine.num_tets, from->fine.num_tets, from->tet_parent, to->tet_parent,
                              next ? changes->tet_source : NULL, NULL, NULL, next, &map.tet);
    map.num_nodes = to->fine.num_nodes;
    map.num_same = next ? from->fine.num_nodes : 0;
    if (status == PLIANT_OK && to->subdivision && to->fine.num_nodes > to->subdivision->load_nodes)
        status = list_between(from, to, &map);
    if (status != PLIANT_OK) {
        pliant_body_map_free(&map);
        return status;
    }
    *out = map;
    return PLIANT_OK;
}

void pliant_body_map_free(pliant_body_map *map)
{
    PLIANT_FREE(map->node, map->tet, map->between);
    memset(map, 0, sizeof *map);
}
