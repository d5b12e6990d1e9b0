#include "contact/detect/contact_surface.h"

#include "base/fail.h"
#include "contact/detect/update_sides.h"
#include "contact/detect/tissue.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <math.h>
#include <string.h>

static const double farthest = 1;   /* maximum motion of a corner, times the shortest edge of a cube */
static const double almost_none = 1e-5; /* tolerance of the fraction of tissue in an element */
static const double half = 0.5;     /* threshold of the fraction of tissue */

static pliant_status no_memory(void) { return pliant_fail_memory("contacts"); }

static void free_body(pliant_contact_surface *surface)
{
    PLIANT_FREE(surface->solid, surface->tet, surface->triangles, surface->positions);
    surface->solid = NULL;
    surface->tet = surface->triangles = NULL;
    surface->positions = NULL;
    surface->revision = 0;
}

static void free_load(pliant_contact_surface *surface)
{
    PLIANT_FREE(surface->tet_at_load, surface->weights, surface->solid_at_load);
    surface->tet_at_load = NULL;
    surface->weights = NULL;
    surface->solid_at_load = NULL;
}

void pliant_contact_surface_free(pliant_contact_surface *surface)
{
    free_body(surface);
    free_load(surface);
    memset(surface, 0, sizeof *surface);
}

/* ---- topology at load */

static pliant_status find_solid(pliant_contact_surface *surface, const pliant_body *load)
{
    const pliant_mesh *mesh = &load->fine;
    uint8_t *full = pliant_calloc((size_t)mesh->num_nodes, 1);
    surface->solid_at_load = pliant_calloc((size_t)mesh->num_tets, 1);
    const bool good = full && surface->solid_at_load;
    for (int32_t v = 0; good && v < 4 * mesh->num_tets; v++)
        if (load->fine_material[v / 4].tissue >= half) full[mesh->tets[v]] = 1;
    for (int32_t t = 0; good && t < mesh->num_tets; t++) {
        const int32_t *node = mesh->tets + 4 * (size_t)t;
        const bool adjacent = full[node[0]] || full[node[1]] || full[node[2]] || full[node[3]];
        surface->solid_at_load[t] =
            load->fine_material[t].tissue >= half || (load->fine_material[t].tissue > 0 && !adjacent);
    }
    pliant_free(full);
    return good ? PLIANT_OK : no_memory();
}

/* Return the fraction of tissue at a point, interpolated linearly between voxels. origin: center of the first voxel
 * [m] */
static double tissue_at(const pliant_contact_surface_voxels *voxels, const double origin[3], const double at[3])
{
    const pliant_geometry *geometry = voxels->geometry;
    double index[3], sum = 0;
    int64_t low[3];
    for (int axis = 0; axis < 3; axis++) {
        index[axis] = 0;
        for (int d = 0; d < 3; d++)
            index[axis] += geometry->direction[3 * d + axis] * (at[d] - origin[d]) / geometry->spacing[axis];
        low[axis] = (int64_t)floor(index[axis]);
    }
    for (int n = 0; n < 8; n++) {
        double weight = 1;
        int64_t flat = 0;
        bool within = true;
        for (int axis = 2; axis >= 0; axis--) {
            const int64_t i = low[axis] + (n >> axis & 1);
            weight *= n >> axis & 1 ? index[axis] - (double)low[axis] : 1 - (index[axis] - (double)low[axis]);
            within = within && i >= 0 && i < (int64_t)geometry->size[axis];
            flat = flat * (int64_t)geometry->size[axis] + i;
        }
        if (within && !voxels->materials->materials[voxels->material_of_voxel[flat]].empty) sum += weight;
    }
    return sum;
}

/* Return the signed distance along the normal at which tissue begins, searched from outside to inside [m]; 0: none. */
static double distance_to_tissue(const pliant_contact_surface_voxels *voxels, const double at[3],
                                 const double normal[3], double reach)
{
    const double *spacing = voxels->geometry->spacing, stride = fmin(spacing[0], fmin(spacing[1], spacing[2])) / 4;
    double before = 0, origin[3];
    pliant_geometry_to_world(voxels->geometry, (const double[3]){0, 0, 0}, origin);
    for (double distance = reach; distance >= -reach; distance -= stride) {
        double there[3];
        for (int d = 0; d < 3; d++) there[d] = at[d] + distance * normal[d];
        const double tissue = tissue_at(voxels, origin, there);
        if (tissue >= half) return distance == reach ? reach : distance + stride * (tissue - half) / (tissue - before);
        before = tissue;
    }
    return 0;
}

/* Return which nodes are in an element that is partly filled. Where all elements are full or empty, the tissue ends
 * at their faces. NULL: out of memory. */
static uint8_t *find_partly_filled_nodes(const pliant_body *load)
{
    const pliant_mesh *mesh = &load->fine;
    uint8_t *partly_filled = pliant_calloc((size_t)mesh->num_nodes, 1);
    for (int32_t v = 0; partly_filled && v < 4 * mesh->num_tets; v++) {
        const double tissue = load->fine_material[v / 4].tissue;
        if (tissue > almost_none && tissue < 1 - almost_none) partly_filled[mesh->tets[v]] = 1;
    }
    return partly_filled;
}

/* Return (nodes x 3) area-weighted normals of the surface at its nodes, 0 elsewhere; NULL: out of memory. */
static double *normals_of(const pliant_mesh *mesh, int32_t count, const int32_t *triangles)
{
    double *normal = pliant_calloc(3 * (size_t)mesh->num_nodes, sizeof *normal);
    for (int32_t t = 0; normal && t < count; t++) {
        double a[3], b[3];
        for (int d = 0; d < 3; d++) {
            a[d] = mesh->rest[3 * triangles[3 * t + 1] + d] - mesh->rest[3 * triangles[3 * t] + d];
            b[d] = mesh->rest[3 * triangles[3 * t + 2] + d] - mesh->rest[3 * triangles[3 * t] + d];
        }
        for (int v = 0; v < 3; v++)
            for (int d = 0; d < 3; d++)
                normal[3 * triangles[3 * t + v] + d] +=
                    a[(d + 1) % 3] * b[(d + 2) % 3] - a[(d + 2) % 3] * b[(d + 1) % 3];
    }
    return normal;
}

/* The tissue's boundary, relative to each node along a normal. */
typedef struct ends {
    double (*unit)[3]; /* (nodes) unit normal */
    double *offset;    /* (nodes) [m]; 0: the node itself */
} ends;

static void free_ends(ends *found)
{
    pliant_free(found->unit);
    pliant_free(found->offset);
}

/* Find the boundary. triangles: (count x 3) of the topology at load. The caller frees the result, also after an
 * error. */
static pliant_status find_ends(const pliant_contact_surface_voxels *voxels, int32_t count, const int32_t *triangles,
                               ends *found)
{
    const pliant_mesh *mesh = &voxels->load->fine;
    const double reach = farthest * fmin(mesh->cell_size[0], fmin(mesh->cell_size[1], mesh->cell_size[2]));
    double *normal = normals_of(mesh, count, triangles);
    uint8_t *partly_filled = normal ? find_partly_filled_nodes(voxels->load) : NULL;
    found->unit = pliant_calloc((size_t)mesh->num_nodes, sizeof *found->unit);
    found->offset = pliant_calloc((size_t)mesh->num_nodes, sizeof *found->offset);
    const bool good = partly_filled && found->unit && found->offset;
    for (int32_t n = 0; good && n < mesh->num_nodes; n++) {
        const double *x = normal + 3 * (size_t)n, length = sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
        if (!partly_filled[n] || !(length > 0)) continue;
        for (int d = 0; d < 3; d++) found->unit[n][d] = x[d] / length;
        found->offset[n] = distance_to_tissue(voxels, mesh->rest + 3 * n, found->unit[n], reach);
    }
    pliant_free(partly_filled);
    pliant_free(normal);
    return good ? PLIANT_OK : no_memory();
}

/* ---- corners */

/* The cubes at each node. All zero: the elements are tetrahedra. */
typedef struct cubes {
    double min_tissue;       /* fraction of tissue above which a cube carries corners */
    double *tissue;          /* (tetrahedra) fraction of tissue in the tetrahedron's cube */
    int32_t *start, *around; /* (nodes + 1) offsets, and the tetrahedra of each node */
} cubes;

static void free_cubes(cubes *at_nodes) { PLIANT_FREE(at_nodes->tissue, at_nodes->start, at_nodes->around); }

/* Return the end of the range of tetrahedra that share a cube with the first one. leaf: in and out */
static int32_t end_of_cube(const pliant_mesh *mesh, int32_t first, int32_t *leaf)
{
    int32_t end = first + 1;
    if (mesh->lattice_of_tet) {
        while (end < mesh->num_tets && mesh->lattice_of_tet[end] / 5 == mesh->lattice_of_tet[first] / 5) end++;
        return end;
    }
    while (mesh->leaf_start[*leaf + 1] <= first) ++*leaf;
    return mesh->leaf_start[*leaf + 1];
}

static void find_tissue_of_cubes(const pliant_body *load, double *out)
{
    const pliant_mesh *mesh = &load->fine;
    int32_t leaf = 0;
    for (int32_t first = 0, end; first < mesh->num_tets; first = end) {
        double whole = 0, tissue = 0, gradients[12];
        end = end_of_cube(mesh, first, &leaf);
        for (int32_t t = first; t < end; t++) {
            const int32_t *node = mesh->tets + 4 * (size_t)t;
            const double volume = pliant_tet_gradients(mesh->rest + 3 * node[0], mesh->rest + 3 * node[1],
                                                       mesh->rest + 3 * node[2], mesh->rest + 3 * node[3], gradients);
            whole += volume;
            tissue += volume * load->fine_material[t].tissue;
        }
        for (int32_t t = first; t < end; t++) out[t] = tissue / whole;
    }
}

/* Find the cubes of the topology at load. The caller frees the result, also after an error. */
static pliant_status find_cubes(const pliant_contact_surface_voxels *voxels, cubes *out)
{
    const pliant_mesh *mesh = &voxels->load->fine;
    const int32_t corners = 4 * mesh->num_tets;
    if (!(voxels->min_cube_tissue > 0)) return PLIANT_OK;
    out->min_tissue = voxels->min_cube_tissue;
    out->tissue = pliant_calloc((size_t)mesh->num_tets, sizeof *out->tissue);
    out->start = pliant_calloc((size_t)mesh->num_nodes + 1, sizeof *out->start);
    out->around = pliant_calloc((size_t)corners, sizeof *out->around);
    if (!out->tissue || !out->start || !out->around) return no_memory();
    find_tissue_of_cubes(voxels->load, out->tissue);
    for (int32_t v = 0; v < corners; v++) out->start[mesh->tets[v]]++;
    for (int32_t n = 0; n < mesh->num_nodes; n++) out->start[n + 1] += out->start[n];
    for (int32_t v = corners; v-- > 0;) out->around[--out->start[mesh->tets[v]]] = v / 4;
    return PLIANT_OK;
}

/* If a corner lies outside of the mesh or in a cube with little tissue, embed it in a fuller cube of its node instead.
 * Use the tetrahedron with the shortest extrapolation. at: the corner at rest */
static void embed_in_fuller_cube(pliant_contact_surface *surface, const pliant_mesh *mesh, const cubes *at_nodes,
                                 int32_t n, const double at[3])
{
    const int32_t tet = surface->tet_at_load[n];
    const double own = tet >= 0 ? at_nodes->tissue[tet] : 0;
    double most = 0, best = -INFINITY, weights[4];
    for (int32_t i = at_nodes->start[n]; i < at_nodes->start[n + 1]; i++)
        most = fmax(most, at_nodes->tissue[at_nodes->around[i]]);
    const double enough = fmin(most, at_nodes->min_tissue);
    if (own >= enough) return;
    for (int32_t i = at_nodes->start[n]; i < at_nodes->start[n + 1]; i++) {
        const int32_t t = at_nodes->around[i];
        if (at_nodes->tissue[t] < enough) continue;
        pliant_mesh_barycentric(mesh, t, at, weights);
        const double minimum = fmin(fmin(weights[0], weights[1]), fmin(weights[2], weights[3]));
        if (minimum <= best) continue;
        best = minimum;
        surface->tet_at_load[n] = t;
        memcpy(surface->weights[n], weights, sizeof weights);
    }
}

static void set_corner(pliant_contact_surface *surface, const pliant_mesh *mesh, const cubes *at_nodes,
                       const ends *found, int32_t n)
{
    double at[3];
    for (int d = 0; d < 3; d++) at[d] = mesh->rest[3 * n + d] + found->offset[n] * found->unit[n][d];
    surface->tet_at_load[n] = found->offset[n] != 0 ? pliant_mesh_locate(mesh, at, surface->weights[n]) : -1;
    if (found->offset[n] != 0 && at_nodes->tissue) embed_in_fuller_cube(surface, mesh, at_nodes, n, at);
}

/* Find the nodes whose corners at rest take part in a self-intersection, and set their flag in out.
 * @param any out: whether one of these corners differs from its node */
static pliant_status find_overlaps(const pliant_contact_surface *surface, const pliant_contact_surface_voxels *voxels,
                                   const ends *found, pliant_tissue *tissue, double *positions, uint8_t *out, bool *any)
{
    const pliant_mesh *mesh = &voxels->load->fine;
    const pliant_tissue_rule rule = {.margin = 0};
    pliant_contacts points = {.count = 0};
    for (int32_t n = 0; n < mesh->num_nodes; n++)
        for (int d = 0; d < 3; d++)
            positions[3 * (size_t)n + (size_t)d] =
                mesh->rest[3 * n + d] + (surface->tet_at_load[n] >= 0 ? found->offset[n] * found->unit[n][d] : 0);
    pliant_tissue_discard(tissue);
    const pliant_status status = pliant_tissue_find(tissue, positions, &rule, &points);
    for (int32_t p = 0; status == PLIANT_OK && p < points.count; p++) {
        const pliant_contact_point *point = points.point + p;
        for (int32_t k = 0; pliant_contact_is_of_corners(point) && k < point->count; k++) {
            *any = *any || surface->tet_at_load[point->node[k]] >= 0;
            out[point->node[k]] = 1;
        }
    }
    pliant_free(points.point);
    return status;
}

/* Halve the motion of corners where the surface intersects itself at rest, until it does not. After some rounds use
 * the nodes themselves; the mesh's own faces never intersect. */
static pliant_status avoid_overlaps(pliant_contact_surface *surface, const pliant_contact_surface_voxels *voxels,
                                    const cubes *at_nodes, ends *found)
{
    enum { ROUNDS = 8, HALVED = 3 }; /* after this many halvings the corner is the node itself */
    const pliant_mesh *mesh = &voxels->load->fine;
    pliant_tissue tissue = {.body = NULL};
    double *positions = pliant_calloc(3 * (size_t)mesh->num_nodes, sizeof *positions);
    uint8_t *overlaps = pliant_calloc((size_t)mesh->num_nodes, 1);
    pliant_status status = positions && overlaps
                               ? pliant_tissue_set_body(&tissue, voxels->load, surface->solid_at_load, voxels->threads)
                               : no_memory();
    bool any = status == PLIANT_OK && tissue.num_triangles > 0;
    for (int round = 0; any && round < ROUNDS; round++) {
        any = false;
        status = find_overlaps(surface, voxels, found, &tissue, positions, overlaps, &any);
        any = any && status == PLIANT_OK;
        for (int32_t n = 0; any && n < mesh->num_nodes; n++) {
            if (!overlaps[n] || surface->tet_at_load[n] < 0) continue;
            found->offset[n] = round < HALVED ? found->offset[n] / 2 : 0;
            set_corner(surface, mesh, at_nodes, found, n);
            overlaps[n] = 0;
        }
    }
    pliant_tissue_free(&tissue);
    pliant_free(overlaps);
    pliant_free(positions);
    return status;
}

/* Find all corners. triangles: (count x 3) of the topology at load */
static pliant_status find_corners(pliant_contact_surface *surface, const pliant_contact_surface_voxels *voxels,
                                  int32_t count, const int32_t *triangles)
{
    const pliant_mesh *mesh = &voxels->load->fine;
    ends found = {NULL, NULL};
    cubes at_nodes = {.tissue = NULL};
    surface->tet_at_load = pliant_calloc((size_t)mesh->num_nodes, sizeof *surface->tet_at_load);
    surface->weights = pliant_calloc((size_t)mesh->num_nodes, sizeof *surface->weights);
    pliant_status status =
        surface->tet_at_load && surface->weights ? find_ends(voxels, count, triangles, &found) : no_memory();
    if (status == PLIANT_OK) status = find_cubes(voxels, &at_nodes);
    for (int32_t n = 0; status == PLIANT_OK && n < mesh->num_nodes; n++)
        set_corner(surface, mesh, &at_nodes, &found, n);
    if (status == PLIANT_OK && voxels->has_self_contact) status = avoid_overlaps(surface, voxels, &at_nodes, &found);
    free_cubes(&at_nodes);
    free_ends(&found);
    return status;
}

/* ---- current topology */

/* Find the tetrahedron of each surface node's corner. If there are several fragments, use a fragment that has the
 * node. */
static void find_tets(pliant_contact_surface *surface, const pliant_body *body)
{
    const pliant_mesh *mesh = &body->fine;
    for (int32_t n = 0; n < mesh->num_nodes; n++)
        surface->tet[n] = surface->tet_at_load[body->node_parent ? body->node_parent[n] : n];
    for (int32_t v = 0; body->tet_parent && v < 4 * mesh->num_tets; v++)
        if (surface->tet[mesh->tets[v]] == body->tet_parent[v / 4]) surface->tet[mesh->tets[v]] = v / 4;
}

/* Compute the data that all topologies share. out: (count x 3) triangles at load, Nullable */
static pliant_status find_load(pliant_contact_surface *surface, const pliant_contact_surface_voxels *voxels,
                               int32_t *count, int32_t **out)
{
    pliant_status status = find_solid(surface, voxels->load);
    if (status == PLIANT_OK)
        status = pliant_mesh_surface(&voxels->load->fine, voxels->load->across, surface->solid_at_load, out, count);
    if (status == PLIANT_OK) status = find_corners(surface, voxels, *count, *out);
    if (status == PLIANT_OK) return PLIANT_OK;
    free_load(surface);
    pliant_free(*out);
    return status;
}

pliant_status pliant_contact_surface_set_body(pliant_contact_surface *surface,
                                              const pliant_contact_surface_voxels *voxels, const pliant_body *body)
{
    pliant_status status = PLIANT_OK;
    int32_t count = 0, *triangles = NULL;
    if (surface->revision == body->revision) return PLIANT_OK;
    if (!surface->weights && (status = find_load(surface, voxels, &count, &triangles)) != PLIANT_OK) return status;
    if (body->revision != voxels->load->revision) {
        pliant_free(triangles);
        triangles = NULL;
    }
    free_body(surface);
    surface->view = *body;
    surface->view.num_triangles = 0;
    surface->solid = pliant_calloc((size_t)body->fine.num_tets, 1);
    surface->tet = pliant_calloc((size_t)body->fine.num_nodes, sizeof *surface->tet);
    surface->positions = pliant_calloc(3 * (size_t)body->fine.num_nodes, sizeof *surface->positions);
    if (!surface->solid || !surface->tet || !surface->positions) status = no_memory();
    for (int32_t t = 0; status == PLIANT_OK && t < body->fine.num_tets; t++)
        surface->solid[t] = surface->solid_at_load[body->tet_parent ? body->tet_parent[t] : t];
    if (status == PLIANT_OK && !triangles)
        status = pliant_mesh_surface(&body->fine, body->across, surface->solid, &triangles, &count);
    surface->triangles = triangles;
    if (status != PLIANT_OK) {
        free_body(surface);
        return status;
    }
    find_tets(surface, body);
    surface->view.triangles = triangles;
    surface->view.num_triangles = count;
    surface->revision = body->revision;
    return PLIANT_OK;
}

/* ---- positions of a step */

static const double *weights_of(const pliant_contact_surface *surface, int32_t node)
{
    return surface->weights[surface->view.node_parent ? surface->view.node_parent[node] : node];
}

void pliant_contact_surface_corner(const pliant_contact_surface *surface, int32_t node, const double *positions,
                                   double out[3])
{
    const int32_t tet = surface ? surface->tet[node] : -1;
    memcpy(out, positions + 3 * (size_t)node, 3 * sizeof *out);
    if (tet < 0) return;
    const int32_t *corner = surface->view.fine.tets + 4 * (size_t)tet;
    const double *weights = weights_of(surface, node);
    memset(out, 0, 3 * sizeof *out);
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++) out[d] += weights[v] * positions[3 * (size_t)corner[v] + (size_t)d];
}

int pliant_contact_surface_support(const pliant_contact_surface *surface, int32_t node, int32_t support[4],
                                   double weights[4])
{
    const int32_t tet = surface->tet[node];
    support[0] = node;
    weights[0] = 1;
    if (tet < 0) return 1;
    memcpy(support, surface->view.fine.tets + 4 * (size_t)tet, 4 * sizeof *support);
    memcpy(weights, weights_of(surface, node), 4 * sizeof *weights);
    return 4;
}

void pliant_contact_surface_corners(const pliant_contact_surface *surface, int32_t count, const int32_t *nodes,
                                    const double *positions, int num_threads, double *out)
{
    const int32_t several = 4096; /* fewer are faster on one thread */
#pragma omp parallel for schedule(static) num_threads(num_threads) if (count > several)
    for (int32_t n = 0; n < count; n++) {
        const size_t node = (size_t)(nodes ? nodes[n] : n);
        pliant_contact_surface_corner(surface, (int32_t)node, positions, out + 3 * node);
    }
}

/* Points of cut faces belong to fragments, and slowed points to nodes. Neither has corners. */
static bool has_corner(const pliant_contact_surface *surface, const pliant_contact_point *point)
{
    bool any = false;
    if (point->kind == PLIANT_OBSTACLE_TISSUE && !pliant_contact_is_of_corners(point)) return false;
    for (int32_t k = 0; k < point->count; k++) any = any || surface->tet[point->node[k]] >= 0;
    return any;
}

void pliant_contact_surface_map_weights(const pliant_contact_surface *surface, pliant_contacts *contacts)
{
    for (int32_t p = 0; p < contacts->count; p++) {
        pliant_contact_point *point = contacts->point + p;
        const pliant_contact_point was = *point;
        if (!has_corner(surface, point)) continue;
        point->count = 0;
        for (int32_t k = 0; k < was.count; k++) {
            int32_t support[4];
            double weights[4];
            const int supports = pliant_contact_surface_support(surface, was.node[k], support, weights);
            for (int v = 0; v < supports; v++)
                if (was.weight[k] * weights[v] != 0)
                    pliant_contact_add_weight(&point->count, point->node, point->weight, support[v],
                                              was.weight[k] * weights[v]);
        }
    }
}
