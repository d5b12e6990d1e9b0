/* Compute the surface of a cut body, reusing the surface of an earlier body. */
#include "topology/surface.h"

#include "mesh/faces.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

/* minimum number of voxels per part of an edge; limits the refinement */
static const double voxels_of_part = 4;

/* Data that the surfaces of one loaded mesh reuse. */
struct pliant_surface_kept {
    int32_t num_outside, *outside; /* faces of the initial mesh without neighbour: 4 tetrahedron + opposite corner */
    int32_t num_blocks;
    surface_block **block;         /* by host */
};

typedef struct surface_work {
    const pliant_body *body;
    const pliant_surface *before;  /* Nullable; surface to reuse */
    int32_t *cut_of;               /* (initial tetrahedra) index in the cuts; -1: not cut */
    /* (initial nodes) whether a tetrahedron of the node differs from before; whether one is split or has copied
     * nodes */
    uint8_t *near_changed, *near_split;
    surface_block **block;         /* (initial tetrahedra) */
    uint8_t *is_new;               /* (initial tetrahedra) whether the block is new */
    surface_maker maker;
} surface_work;

/* ---- blocks */

static void release_block(surface_block *block)
{
    if (!block || atomic_fetch_sub_explicit(&block->holders, 1, memory_order_acq_rel) != 1) return;
    PLIANT_FREE(block->label, block->vertex, block->triangle, block);
}

static surface_block *find_block(const pliant_surface *surface, int32_t host)
{
    int32_t low = 0, high = surface->kept->num_blocks;
    while (low < high) {
        const int32_t middle = low + (high - low) / 2;
        if (surface->kept->block[middle]->host < host) low = middle + 1;
        else high = middle;
    }
    return low < surface->kept->num_blocks && surface->kept->block[low]->host == host ? surface->kept->block[low]
                                                                                      : NULL;
}

static void mark_nodes(const surface_work *work, int32_t host, uint8_t *of_node)
{
    int32_t corner[4];
    pliant_surface_corners(&work->maker, host, corner);
    for (int v = 0; v < 4; v++) of_node[corner[v]] = 1;
}

static bool has_marked(const surface_work *work, int32_t host, const uint8_t *of_node)
{
    int32_t corner[4];
    pliant_surface_corners(&work->maker, host, corner);
    return of_node[corner[0]] | of_node[corner[1]] | of_node[corner[2]] | of_node[corner[3]];
}

/* Return whether a host has other fragments, voxels of fragments, or nodes.
 * o, n: index in the previous and the current cuts; -1: not cut */
static bool differs(const pliant_body *old, const pliant_body *now, int32_t host, int32_t o, int32_t n)
{
    if (o < 0 || n < 0) return true;
    const pliant_cuts *was = old->cuts, *is = now->cuts;
    const int32_t count = is->start[n + 1] - is->start[n], *fragment = is->fragment + is->start[n];
    const int32_t *carriers = was->voxel_fragment + was->voxel_start[o],
                  *new_carriers = is->voxel_fragment + is->voxel_start[n];
    const size_t voxels = (size_t)(now->voxels->start[host + 1] - now->voxels->start[host]);
    if (was->start[o + 1] - was->start[o] != count ||
        memcmp(was->fragment + was->start[o], fragment, (size_t)count * sizeof *fragment) != 0)
        return true;
    for (int32_t f = 0; f < count; f++)
        if (memcmp(old->fine.tets + 4 * (size_t)fragment[f], now->fine.tets + 4 * (size_t)fragment[f],
                   4 * sizeof(int32_t)) != 0)
            return true;
    return carriers != new_carriers && memcmp(carriers, new_carriers, voxels * sizeof *carriers) != 0;
}

/* Mark tetrahedra without cuts that have copied nodes. */
static void mark_by_copies(const surface_work *work, const pliant_body *with)
{
    const pliant_voxels *voxels = work->body->voxels;
    const int32_t *old = work->before->body->fine.tets, *now = work->body->fine.tets;
    for (int32_t n = voxels->num_nodes; n < with->fine.num_nodes; n++) {
        const int32_t parent = with->node_parent[n];
        for (int32_t a = voxels->around_start[parent]; a < voxels->around_start[parent + 1]; a++) {
            const size_t first = 4 * (size_t)(voxels->around[a] / 4);
            if (memcmp(old + first, now + first, 4 * sizeof *now) != 0)
                mark_nodes(work, voxels->around[a] / 4, work->near_changed);
        }
    }
}

/* Mark the nodes of tetrahedra that differ from before. */
static void mark_changed_nodes(const surface_work *work)
{
    const pliant_body *old = work->before->body, *now = work->body;
    const int32_t olds = old->cuts ? old->cuts->num_tets : 0;
    for (int32_t o = 0, n = 0; o < olds || n < now->cuts->num_tets;) {
        const bool in_old = o < olds && (n == now->cuts->num_tets || old->cuts->tet[o] <= now->cuts->tet[n]);
        const bool in_now = n < now->cuts->num_tets && (o == olds || now->cuts->tet[n] <= old->cuts->tet[o]);
        const int32_t host = in_old ? old->cuts->tet[o] : now->cuts->tet[n];
        if (differs(old, now, host, in_old ? o : -1, in_now ? n : -1)) mark_nodes(work, host, work->near_changed);
        o += in_old;
        n += in_now;
    }
    mark_by_copies(work, old);
    mark_by_copies(work, now);
}

static pliant_status add_block(surface_work *work, int32_t host)
{
    surface_block *block = pliant_calloc(1, sizeof *block);
    if (!block) return pliant_surface_no_memory();
    work->block[host] = block;
    work->is_new[host] = 1;
    atomic_init(&block->holders, 1);
    block->host = host;
    block->split = pliant_surface_is_split(&work->maker, host);
    if (!block->split) return PLIANT_OK;
    if (!(block->label = pliant_calloc(SURFACE_LATTICE, sizeof *block->label))) return pliant_surface_no_memory();
    pliant_surface_find_labels(&work->maker, host, block->label);
    return PLIANT_OK;
}

/* Reuse or create the blocks of all hosts with a node of a split host or a copied node. */
static pliant_status find_blocks(surface_work *work, int32_t *count)
{
    const pliant_voxels *voxels = work->body->voxels;
    const pliant_cuts *cuts = work->body->cuts;
    pliant_status status = PLIANT_OK;
    if (work->before) mark_changed_nodes(work);
    for (int32_t n = 0; n < cuts->num_tets; n++)
        if (pliant_surface_is_split(&work->maker, cuts->tet[n])) mark_nodes(work, cuts->tet[n], work->near_split);
    for (int32_t n = voxels->num_nodes; n < work->body->fine.num_nodes; n++)
        work->near_split[work->body->node_parent[n]] = 1;
    for (int32_t t = 0; t < voxels->num_tets && status == PLIANT_OK; t++) {
        if (!has_marked(work, t, work->near_split)) continue;
        surface_block *kept =
            work->before && !has_marked(work, t, work->near_changed) ? find_block(work->before, t) : NULL;
        (*count)++;
        if (kept) {
            atomic_fetch_add_explicit(&kept->holders, 1, memory_order_relaxed);
            work->block[t] = kept;
        } else {
            status = add_block(work, t);
        }
    }
    return status;
}

static pliant_status fill_blocks(surface_work *work)
{
    pliant_status status = PLIANT_OK;
    for (int32_t t = 0; t < work->body->voxels->num_tets && status == PLIANT_OK; t++)
        if (work->is_new[t]) status = pliant_surface_fill(&work->maker, work->block[t]);
    return status;
}

/* ---- assemble */

static pliant_status find_outside(const surface_work *work, struct pliant_surface_kept *out)
{
    const pliant_voxels *voxels = work->body->voxels;
    const struct pliant_surface_kept *from = work->before ? work->before->kept : NULL;
    for (int32_t f = 0; !from && f < 4 * voxels->num_tets; f++) out->num_outside += voxels->across[f] < 0;
    if (from) out->num_outside = from->num_outside;
    if (!(out->outside = pliant_calloc((size_t)out->num_outside + 1, sizeof *out->outside)))
        return pliant_surface_no_memory();
    if (from) memcpy(out->outside, from->outside, (size_t)out->num_outside * sizeof *out->outside);
    for (int32_t f = 0, n = 0; !from && f < 4 * voxels->num_tets; f++)
        if (voxels->across[f] < 0) out->outside[n++] = f;
    return PLIANT_OK;
}

/* Return the number of a block's vertex in the whole surface: a node or an additional vertex; -1: out of memory. */
static int32_t number_of(surface_map *all, const surface_vertex *vertex, uint8_t *is_lattice, pliant_surface *surface)
{
    if (vertex->key.weight[1] == 0) return vertex->key.node[0];
    const int32_t number = pliant_surface_number(all, &vertex->key);
    if (number < 0) return -1;
    if (number == surface->num_vertices) {
        surface->tet[number] = vertex->tet;
        surface->material[number] = vertex->material;
        memcpy(surface->weight + 4 * (size_t)number, vertex->weight, sizeof vertex->weight);
        is_lattice[number] = 1;
        for (int v = 0; v < 4; v++) is_lattice[number] &= vertex->key.weight[v] % SURFACE_WEIGHT_DIVISOR == 0;
        surface->num_vertices++;
    }
    return surface->body->fine.num_nodes + number;
}

static bool add_triangles(surface_map *all, const surface_block *block, bool cut, uint8_t *is_lattice,
                          pliant_surface *surface)
{
    const int32_t *from = block->triangle + (cut ? 3 * (size_t)block->num_outer : 0),
                  count = cut ? block->num_cut : block->num_outer;
    for (int32_t v = 0; v < 3 * count; v++) {
        const int32_t number = number_of(all, block->vertex + from[v], is_lattice, surface);
        if (number < 0) return false;
        surface->triangle[3 * (size_t)surface->num_triangles + (size_t)v] = number;
    }
    surface->num_triangles += count;
    return true;
}

/* Collect the outer faces without a block, then the outer triangles of the blocks in the order of their hosts, then the
 * faces of cuts. */
static pliant_status gather(const surface_work *work, pliant_surface *surface)
{
    const struct pliant_surface_kept *kept = surface->kept;
    const int32_t *tets = work->body->fine.tets;
    size_t vertices = 1, triangles = (size_t)kept->num_outside + 1;
    for (int32_t b = 0; b < kept->num_blocks; b++) {
        vertices += (size_t)kept->block[b]->num_vertices;
        triangles += (size_t)(kept->block[b]->num_outer + kept->block[b]->num_cut);
    }
    surface->tet = pliant_calloc(vertices, sizeof *surface->tet);
    surface->weight = pliant_calloc(vertices, 4 * sizeof *surface->weight);
    surface->material = pliant_calloc(vertices, sizeof *surface->material);
    surface->triangle = pliant_calloc(triangles, 3 * sizeof *surface->triangle);
    uint8_t *is_lattice = pliant_calloc(vertices, 1);
    if (!surface->tet || !surface->weight || !surface->material || !surface->triangle || !is_lattice) {
        pliant_free(is_lattice);
        return pliant_surface_no_memory();
    }
    for (int32_t f = 0; f < kept->num_outside; f++) {
        const int32_t host = kept->outside[f] / 4;
        if (work->block[host]) continue;
        for (int v = 0; v < 3; v++)
            surface->triangle[3 * (size_t)surface->num_triangles + (size_t)v] =
                tets[4 * (size_t)host + (size_t)pliant_face_corners[kept->outside[f] % 4][v]];
        surface->num_triangles++;
    }
    surface_map all = {0};
    bool good = true;
    for (int cut = 0; cut < 2; cut++) {
        surface->first_cut = surface->num_triangles;
        for (int32_t b = 0; good && b < kept->num_blocks; b++)
            good = add_triangles(&all, kept->block[b], cut, is_lattice, surface);
    }
    const pliant_status status =
        good ? pliant_surface_flatten(&work->maker, is_lattice, surface) : pliant_surface_no_memory();
    pliant_surface_map_free(&all);
    pliant_free(is_lattice);
    return status;
}

static pliant_status keep_blocks(surface_work *work, int32_t count, struct pliant_surface_kept *out)
{
    if (!(out->block = pliant_calloc((size_t)count + 1, sizeof(surface_block *)))) return pliant_surface_no_memory();
    for (int32_t t = 0; t < work->body->voxels->num_tets; t++) {
        if (!work->block[t]) continue;
        out->block[out->num_blocks++] = work->block[t];
        atomic_fetch_add_explicit(&work->block[t]->holders, 1, memory_order_relaxed);
    }
    return PLIANT_OK;
}

static pliant_status create_cut(surface_work *work, pliant_surface *surface)
{
    const pliant_voxels *voxels = work->body->voxels;
    const pliant_mesh *mesh = &work->body->fine;
    int32_t count = 0;
    double maximum = INFINITY;
    for (int d = 0; d < 3; d++)
        maximum = fmin(maximum, mesh->cell_size[d] / voxels->geometry.spacing[d] / voxels_of_part);
    work->maker = (surface_maker){.body = work->body,
                                  .voxels = voxels,
                                  .cuts = work->body->cuts,
                                  .cut_of = work->cut_of,
                                  .block = work->block,
                                  .parts = (int)fmin(fmax(maximum, 1), SURFACE_MAX_PARTS),
                                  .where.size = sizeof(double),
                                  .near.size = sizeof(surface_sample),
                                  .made.size = sizeof(surface_vertex),
                                  .triangles = {{.size = 3 * sizeof(int32_t)}, {.size = 3 * sizeof(int32_t)}}};
    for (int32_t t = 0; t < voxels->num_tets; t++) work->cut_of[t] = -1;
    for (int32_t n = 0; n < work->body->cuts->num_tets; n++) work->cut_of[work->body->cuts->tet[n]] = n;
    pliant_status status = find_outside(work, surface->kept);
    if (status == PLIANT_OK) status = find_blocks(work, &count);
    if (status == PLIANT_OK) status = fill_blocks(work);
    if (status == PLIANT_OK) status = keep_blocks(work, count, surface->kept);
    return status == PLIANT_OK ? gather(work, surface) : status;
}

static void free_work(surface_work *work)
{
    for (int32_t t = 0; work->block && t < work->body->voxels->num_tets; t++) release_block(work->block[t]);
    pliant_surface_map_free(&work->maker.crossings);
    pliant_surface_map_free(&work->maker.vertices);
    PLIANT_FREE(work->cut_of, work->near_changed, work->near_split, work->block, work->is_new, work->maker.where.at,
                work->maker.near.at, work->maker.made.at, work->maker.triangles[0].at, work->maker.triangles[1].at);
}

/* Copy the triangles of the mesh. */
static pliant_status copy_triangles(pliant_surface *surface)
{
    const pliant_body *body = surface->body;
    surface->triangle = pliant_calloc((size_t)body->num_triangles + 1, 3 * sizeof *surface->triangle);
    if (!surface->triangle) return pliant_surface_no_memory();
    if (body->num_triangles > 0)
        memcpy(surface->triangle, body->triangles, 3 * (size_t)body->num_triangles * sizeof *body->triangles);
    surface->num_triangles = surface->first_cut = body->num_triangles;
    return body->subdivision && body->subdivision->between ? pliant_surface_part_subdivided(surface) : PLIANT_OK;
}

pliant_status pliant_surface_create(const pliant_body *body, const pliant_surface *before, pliant_surface **out)
{
    *out = NULL;
    pliant_surface *surface = pliant_calloc(1, sizeof *surface);
    if (!surface) return pliant_surface_no_memory();
    surface->body = pliant_body_retain(body);
    pliant_status status = PLIANT_OK;
    if (!body->cuts || !body->voxels) {
        status = copy_triangles(surface);
    } else {
        const size_t tets = (size_t)body->voxels->num_tets, nodes = (size_t)body->voxels->num_nodes;
        const bool follows = before && before->kept && before->body->voxels == body->voxels;
        surface_work work = {.body = body, .before = follows ? before : NULL};
        work.cut_of = pliant_calloc(tets, sizeof *work.cut_of);
        work.near_changed = pliant_calloc(nodes, 1);
        work.near_split = pliant_calloc(nodes, 1);
        work.block = pliant_calloc(tets, sizeof(surface_block *));
        work.is_new = pliant_calloc(tets, 1);
        surface->kept = pliant_calloc(1, sizeof *surface->kept);
        status = work.cut_of && work.near_changed && work.near_split && work.block && work.is_new && surface->kept
                     ? create_cut(&work, surface)
                     : pliant_surface_no_memory();
        free_work(&work);
    }
    if (status != PLIANT_OK) {
        pliant_surface_free(surface);
        return status;
    }
    *out = surface;
    return PLIANT_OK;
}

void pliant_surface_free(pliant_surface *surface)
{
    if (!surface) return;
    pliant_body_release(surface->body);
    for (int32_t b = 0; surface->kept && b < surface->kept->num_blocks; b++) release_block(surface->kept->block[b]);
    if (surface->kept) {
        pliant_free(surface->kept->outside);
        pliant_free(surface->kept->block);
    }
    PLIANT_FREE(surface->kept, surface->tet, surface->weight, surface->material, surface->triangle, surface);
}

void pliant_surface_at_vertices(const pliant_surface *surface, int size, const double *nodes, double *out)
{
    for (int32_t n = 0; n < surface->num_vertices; n++) {
        const int32_t *node = surface->body->fine.tets + 4 * (size_t)surface->tet[n];
        const double *weight = surface->weight + 4 * (size_t)n;
        for (int d = 0; d < size; d++) {
            double sum = 0;
            for (int v = 0; v < 4; v++) sum += weight[v] * nodes[(size_t)size * (size_t)node[v] + (size_t)d];
            out[(size_t)size * (size_t)n + (size_t)d] = sum;
        }
    }
}
