/* The outer surface of a topology, and the adjacency on it. */
#include "contact/detect/tissue.h"

#include "base/fail.h"
#include "base/memory.h"
#include "base/pairs.h"
#include "contact/advance/advance.h"
#include "contact/detect/tissue_rules.h"
#include "mesh/faces.h"
#include "mesh/mesh.h"
#include "topology/body.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void free_surface(pliant_tissue *tissue)
{
    PLIANT_FREE(tissue->own_across, tissue->inside, tissue->is_candidate, tissue->triangle, tissue->tet,
                tissue->triangle_start, tissue->node, tissue->index_of, tissue->around_start, tissue->around,
                tissue->node_triangle_start, tissue->node_triangles, tissue->area, tissue->face, tissue->normal,
                tissue->count, tissue->node_contacts, tissue->last, tissue->place, tissue->piece, tissue->has_slid,
                tissue->triangles, tissue->rest, tissue->seam, tissue->exempt);
}

void pliant_tissue_free(pliant_tissue *tissue)
{
    free_surface(tissue);
    pliant_grid_free(&tissue->grid);
    pliant_advance_free(tissue->advance);
    pliant_tissue_set_searcher(tissue, NULL);
    pliant_body_release(tissue->body);
    memset(tissue, 0, sizeof *tissue);
}

void pliant_tissue_set_searcher(pliant_tissue *tissue, const pliant_tissue_searcher *searcher)
{
    if (tissue->searcher == searcher || (searcher && tissue->failed == searcher)) return;
    if (tissue->searcher) tissue->searcher->free(tissue->searcher_state);
    tissue->searcher = searcher;
    tissue->searcher_state = NULL;
}

/* Continue on the CPU if a status of the device is an error. */
static bool succeeds(pliant_tissue *tissue, pliant_status status)
{
    if (status == PLIANT_OK) return true;
    pliant_log(PLIANT_LOG_WARNING, "collision detection between tissue and tissue continues on the CPU: %s",
               pliant_last_error());
    const pliant_tissue_searcher *failed = tissue->searcher;
    pliant_tissue_set_searcher(tissue, NULL);
    tissue->failed = failed;
    return false;
}

bool pliant_tissue_search_on_device(pliant_tissue *tissue, const double *positions, const pliant_tissue_rule *rule)
{
    return tissue->searcher &&
           succeeds(tissue, tissue->searcher->search(&tissue->searcher_state, tissue, positions, rule));
}

bool pliant_tissue_list_on_device(pliant_tissue *tissue, const pliant_advance_self *self)
{
    return tissue->searcher && succeeds(tissue, tissue->searcher->list_pairs(tissue->searcher_state, tissue, self));
}

void pliant_tissue_discard(pliant_tissue *tissue)
{
    for (int32_t n = 0; n < tissue->num_nodes; n++) tissue->last[n] = -1;
    tissue->has_place = false;
    tissue->is_apart = false;
}

static pliant_status no_memory(void) { return pliant_fail_memory("the self-contacts of the tissue"); }

/* ---- tetrahedra that take part */

static pliant_status find_members(pliant_tissue *tissue, const uint8_t *solid)
{
    const pliant_body *body = tissue->body;
    const size_t tets = (size_t)body->fine.num_tets;
    if (!(tissue->inside = pliant_calloc(tets, 1)) || !(tissue->is_candidate = pliant_calloc(tets, 1)))
        return no_memory();
    for (size_t t = 0; t < tets; t++)
        tissue->is_candidate[t] = tissue->inside[t] =
            solid ? solid[t] : !body->fine_material || body->fine_material[t].tissue > 0;
    if (body->pieces && !body->has_inertia) {
        if (!(tissue->piece = pliant_calloc((size_t)body->fine.num_nodes, sizeof *tissue->piece))) return no_memory();
        memset(tissue->piece, 0xff, (size_t)body->fine.num_nodes * sizeof *tissue->piece);
        for (int32_t p = 0; p < body->pieces->count; p++)
            for (int32_t i = body->pieces->start[p]; i < body->pieces->start[p + 1]; i++)
                tissue->piece[body->pieces->node[i]] = p;
    }
    const pliant_cuts *cuts = body->cuts;
    for (int32_t c = 0; cuts && c < cuts->num_tets; c++)
        if (cuts->start[c + 1] - cuts->start[c] > 1)
            for (int32_t f = cuts->start[c]; f < cuts->start[c + 1]; f++) tissue->is_candidate[cuts->fragment[f]] = 0;
    tissue->across = body->across;
    if (tissue->across) return PLIANT_OK;
    if (!(tissue->own_across = pliant_calloc(4 * tets, sizeof *tissue->own_across))) return no_memory();
    tissue->across = tissue->own_across;
    return pliant_mesh_neighbours(&body->fine, tissue->own_across);
}

/* Return whether a face borders air or tetrahedra without tissue. A face to a fragment is not on the surface. */
static bool is_outer(const pliant_tissue *tissue, int32_t tet, int corner)
{
    const int32_t across = tissue->across[4 * (size_t)tet + (size_t)corner];
    return across < 0 || !tissue->inside[across];
}

static pliant_status find_surface_triangles(pliant_tissue *tissue)
{
    const pliant_mesh *mesh = &tissue->body->fine;
    for (int pass = 0; pass < 2; pass++) {
        tissue->num_triangles = tissue->num_tets = 0;
        for (int32_t t = 0; t < mesh->num_tets; t++) {
            const int32_t before = tissue->num_triangles;
            for (int c = 0; c < 4 && tissue->is_candidate[t]; c++) {
                if (!is_outer(tissue, t, c)) continue;
                if (pass) {
                    pliant_surface_triangle *triangle = tissue->triangle + tissue->num_triangles;
                    *triangle = (pliant_surface_triangle){.tet = t, .adjacent = {-1, -1, -1}};
                    pliant_face_triangle(mesh, 4 * t + c, triangle->node);
                }
                tissue->num_triangles++;
            }
            if (tissue->num_triangles == before) continue;
            if (pass) {
                tissue->tet[tissue->num_tets] = t;
                tissue->triangle_start[tissue->num_tets] = before;
            }
            tissue->num_tets++;
        }
        if (pass) tissue->triangle_start[tissue->num_tets] = tissue->num_triangles;
        if (pass || tissue->num_triangles == 0) break;
        tissue->triangle = pliant_calloc((size_t)tissue->num_triangles, sizeof *tissue->triangle);
        tissue->normal = pliant_calloc((size_t)tissue->num_triangles, sizeof *tissue->normal);
        tissue->tet = pliant_calloc((size_t)tissue->num_tets, sizeof *tissue->tet);
        tissue->triangle_start = pliant_calloc((size_t)tissue->num_tets + 1, sizeof *tissue->triangle_start);
        if (!tissue->triangle || !tissue->normal || !tissue->tet || !tissue->triangle_start) return no_memory();
    }
    return PLIANT_OK;
}

/* ---- adjacency */

typedef struct half_edge { int32_t low, high, triangle; } half_edge; /* 3 times the triangle's number plus the edge */

static pliant_status find_nodes(pliant_tissue *tissue)
{
    const size_t corners = 3 * (size_t)tissue->num_triangles;
    const int32_t all = tissue->body->fine.num_nodes;
    if (!(tissue->node = pliant_calloc(corners, sizeof *tissue->node)) ||
        !(tissue->index_of = pliant_calloc((size_t)all, sizeof *tissue->index_of)))
        return no_memory();
    for (size_t i = 0; i < corners; i++) tissue->index_of[tissue->triangle[i / 3].node[i % 3]] = 1;
    for (int32_t n = 0; n < all; n++) {
        const bool on_surface = tissue->index_of[n];
        tissue->index_of[n] = on_surface ? tissue->num_nodes : -1;
        if (on_surface) tissue->node[tissue->num_nodes++] = n;
    }
    const size_t nodes = (size_t)tissue->num_nodes;
    tissue->around_start = pliant_calloc(nodes + 1, sizeof *tissue->around_start);
    tissue->node_triangle_start = pliant_calloc(nodes + 1, sizeof *tissue->node_triangle_start);
    tissue->node_triangles = pliant_calloc(corners, sizeof *tissue->node_triangles);
    tissue->area = pliant_calloc(nodes, sizeof *tissue->area);
    tissue->count = pliant_calloc(nodes, sizeof *tissue->count);
    tissue->last = pliant_calloc(nodes, sizeof *tissue->last);
    tissue->place = pliant_calloc(nodes, 3 * sizeof *tissue->place);
    tissue->node_contacts = pliant_calloc(PLIANT_MAX_NODE_CONTACTS * nodes, sizeof *tissue->node_contacts);
    if (!tissue->around_start || !tissue->node_triangle_start || !tissue->node_triangles || !tissue->area ||
        !tissue->count || !tissue->last || !tissue->place || !tissue->node_contacts)
        return no_memory();
    pliant_tissue_discard(tissue);
    for (size_t i = 0; i < corners; i++)
        tissue->node_triangle_start[tissue->index_of[tissue->triangle[i / 3].node[i % 3]]]++;
    for (size_t n = 1; n <= nodes; n++) tissue->node_triangle_start[n] += tissue->node_triangle_start[n - 1];
    for (size_t i = corners; i-- > 0;)
        tissue->node_triangles[--tissue->node_triangle_start[tissue->index_of[tissue->triangle[i / 3].node[i % 3]]]] =
            (int32_t)(i / 3);
    return PLIANT_OK;
}

static void measure(pliant_tissue *tissue)
{
    const double *rest = tissue->body->fine.rest;
    tissue->shortest = INFINITY;
    for (int32_t s = 0; s < tissue->num_triangles; s++) {
        const int32_t *node = tissue->triangle[s].node;
        double a[3], b[3], square = 0;
        for (int d = 0; d < 3; d++) {
            a[d] = rest[3 * (size_t)node[1] + (size_t)d] - rest[3 * (size_t)node[0] + (size_t)d];
            b[d] = rest[3 * (size_t)node[2] + (size_t)d] - rest[3 * (size_t)node[0] + (size_t)d];
        }
        for (int d = 0; d < 3; d++) square += pow(a[(d + 1) % 3] * b[(d + 2) % 3] - a[(d + 2) % 3] * b[(d + 1) % 3], 2);
        for (int v = 0; v < 3; v++) tissue->area[tissue->index_of[node[v]]] += sqrt(square) / 6;
        tissue->shortest =
            fmin(tissue->shortest,
                 sqrt(fmin(a[0] * a[0] + a[1] * a[1] + a[2] * a[2], b[0] * b[0] + b[1] * b[1] + b[2] * b[2])));
    }
}

static pliant_status find_sides(pliant_tissue *tissue)
{
    const size_t count = 3 * (size_t)tissue->num_triangles;
    half_edge *edge = pliant_calloc(count, sizeof *edge);
    tissue->around = pliant_calloc(2 * count, sizeof *tissue->around);
    if (!edge || !tissue->around) {
        pliant_free(edge);
        return no_memory();
    }
    for (size_t i = 0; i < count; i++) {
        const int32_t a = tissue->triangle[i / 3].node[i % 3], b = tissue->triangle[i / 3].node[(i + 1) % 3];
        edge[i] = (half_edge){a < b ? a : b, a < b ? b : a, (int32_t)i};
    }
    qsort(edge, count, sizeof *edge, pliant_triple_order);
    for (int pass = 0; pass < 2; pass++) {
        for (size_t i = 0; i < count; i++) {
            const bool again = i > 0 && edge[i].low == edge[i - 1].low && edge[i].high == edge[i - 1].high;
            if (again && !pass) {
                int32_t *mine = tissue->triangle[edge[i].triangle / 3].adjacent + edge[i].triangle % 3,
                        *other = tissue->triangle[edge[i - 1].triangle / 3].adjacent + edge[i - 1].triangle % 3;
                if (*other < 0) {
                    *mine = edge[i - 1].triangle / 3;
                    *other = edge[i].triangle / 3;
                }
            }
            if (again) continue;
            const int32_t low = tissue->index_of[edge[i].low], high = tissue->index_of[edge[i].high];
            if (pass) {
                tissue->around[--tissue->around_start[low]] = edge[i].high;
                tissue->around[--tissue->around_start[high]] = edge[i].low;
            } else {
                tissue->around_start[low]++;
                tissue->around_start[high]++;
            }
        }
        for (int32_t n = 1; n <= tissue->num_nodes && !pass; n++)
            tissue->around_start[n] += tissue->around_start[n - 1];
    }
    pliant_free(edge);
    return PLIANT_OK;
}

pliant_status pliant_tissue_set_body(pliant_tissue *tissue, const pliant_body *body, const uint8_t *solid, int threads)
{
    if (tissue->revision == body->revision && tissue->body == body) return PLIANT_OK;
    pliant_tissue next = {.body = body, .revision = body->revision, .threads = threads};
    pliant_status status = find_members(&next, solid);
    if (status == PLIANT_OK) status = find_surface_triangles(&next);
    if (status == PLIANT_OK && next.num_triangles > 0) {
        status = find_nodes(&next);
        if (status == PLIANT_OK) status = find_sides(&next);
        if (status == PLIANT_OK) measure(&next);
    }
    if (status == PLIANT_OK) status = pliant_cut_faces(body, &next.face, &next.num_faces);
    if (status == PLIANT_OK && next.num_faces > 0 && !(next.has_slid = pliant_calloc((size_t)next.num_faces, 1)))
        status = pliant_fail_memory("the self-contacts of the tissue");
    if (status != PLIANT_OK) {
        free_surface(&next);
        return status;
    }
    next.grid = tissue->grid;
    next.advance = tissue->advance;
    next.searcher = tissue->searcher;
    next.searcher_state = tissue->searcher_state;
    pliant_body_retain(body);
    free_surface(tissue);
    pliant_body_release(tissue->body);
    *tissue = next;
    return PLIANT_OK;
}

pliant_status pliant_tissue_copy(const pliant_tissue *from, pliant_tissue *to)
{
    if (!from->body) {
        pliant_tissue_discard(to);
        return PLIANT_OK;
    }
    pliant_status status = pliant_tissue_set_body(to, from->body, from->inside, from->threads);
    if (status != PLIANT_OK || from->num_nodes == 0) return status;
    memcpy(to->last, from->last, (size_t)from->num_nodes * sizeof *to->last);
    memcpy(to->place, from->place, 3 * (size_t)from->num_nodes * sizeof *to->place);
    to->has_place = from->has_place;
    to->is_apart = from->is_apart;
    to->num_overlaps = from->num_overlaps;
    return PLIANT_OK;
}

pliant_tissue_view pliant_tissue_view_of(pliant_tissue *tissue, const double *positions, const pliant_tissue_rule *rule)
{
    const pliant_body *body = tissue->body;
    return (pliant_tissue_view){
        .positions = positions,
        .rule = *rule,
        .settings = rule->settings ? *rule->settings : pliant_contact_settings_default(),
        .shortest = tissue->shortest,
        .tets = body->fine.tets,
        .across = tissue->across,
        .is_candidate = tissue->is_candidate,
        .fixed = body->fine_fixed,
        .node_parent = body->cuts ? body->node_parent : NULL,
        .piece = tissue->piece,
        .triangle = tissue->triangle,
        .triangle_start = tissue->triangle_start,
        .node = tissue->node,
        .around_start = tissue->around_start,
        .around = tissue->around,
        .node_triangle_start = tissue->node_triangle_start,
        .node_triangles = tissue->node_triangles,
        .last = tissue->last,
        .normal = tissue->normal,
        .count = tissue->count,
        .node_contacts = tissue->node_contacts,
    };
}
