/* Contact points of tissue on tissue: outer surfaces. */
#include "contact/detect/tissue.h"

#include "base/buffer.h"
#include "base/fail.h"
#include "contact/detect/update_sides.h"
#include "contact/detect/tissue_rules.h"
#include "topology/sorted_numbers.h"

#include <stdlib.h>
#include <string.h>

typedef struct finding {
    pliant_tissue *tissue;
    pliant_tissue_view view;
} finding;

static void search_node(const finding *on, int32_t index)
{
    pliant_tissue *tissue = on->tissue;
    const pliant_grid *grid = &tissue->grid;
    const double *point = pliant_tissue_position(&on->view, tissue->node[index]);
    const int64_t cell = pliant_grid_cell(grid, point);
    tissue->count[index] = 0;
    for (int32_t k = cell < 0 ? 0 : grid->start[cell]; cell >= 0 && k < grid->start[cell + 1]; k++) {
        const int32_t i = grid->item[k];
        const pliant_grid_box *box = grid->box + i;
        if (!pliant_tissue_is_in_box(point, box->low, box->high)) continue;
        for (int32_t s = tissue->triangle_start[i]; s < tissue->triangle_start[i + 1]; s++)
            pliant_tissue_try_triangle(&on->view, index, s);
    }
    pliant_tissue_try_last(&on->view, index);
}

/* ---- nodes deep inside tissue */

/* Test whether a walk from a tetrahedron ends in a tetrahedron that contains the node. If so, search all triangles
 * for the shortest direction out, and add it as a contact. */
static void try_deep(const finding *on, int32_t index, int32_t tet)
{
    const pliant_tissue *tissue = on->tissue;
    const double *point = pliant_tissue_position(&on->view, tissue->node[index]);
    const int32_t holder = pliant_tissue_walk(&on->view, tet, point);
    if (holder < 0 || pliant_tissue_is_near(&on->view, index, holder)) return;
    pliant_node_contact best = {.triangle = -1, .gap = -INFINITY};
    for (int32_t s = 0; s < tissue->num_triangles; s++) {
        pliant_node_contact one = {.triangle = s};
        if (!pliant_tissue_project(&on->view, s, point, one.weight, &one.gap) || !(one.gap < 0 && one.gap > best.gap))
            continue;
        if (one.weight[0] < -PLIANT_TISSUE_BORDER || one.weight[1] < -PLIANT_TISSUE_BORDER ||
            one.weight[2] < -PLIANT_TISSUE_BORDER)
            continue;
        if (pliant_tissue_can_move(&on->view, tissue->node[index], s) &&
            pliant_tissue_walk(&on->view, tissue->triangle[s].tet, point) == holder)
            best = one;
    }
    if (best.triangle >= 0) pliant_tissue_add_contact(&on->view, index, &best);
}

static void try_pair(const finding *on, int32_t of, int32_t in)
{
    const pliant_tissue *tissue = on->tissue;
    for (int v = 0; v < 4; v++) {
        const int32_t index = tissue->index_of[tissue->body->fine.tets[4 * (size_t)of + (size_t)v]];
        if (index >= 0 && tissue->count[index] == 0) try_deep(on, index, in);
    }
}

/* Find nodes that are inside together with all of their surroundings, starting from adjacent nodes that are inside.
 * Repeat in the order of their numbers until no node is added. */
static void spread(const finding *on)
{
    const pliant_tissue *tissue = on->tissue;
    for (bool more = true; more;) {
        more = false;
        for (int32_t n = 0; n < tissue->num_nodes; n++) {
            if (tissue->count[n] > 0) continue;
            for (int32_t a = tissue->around_start[n]; a < tissue->around_start[n + 1] && tissue->count[n] == 0; a++) {
                const int32_t adjacent = tissue->index_of[tissue->around[a]];
                const pliant_node_contact *one = tissue->node_contacts + PLIANT_MAX_NODE_CONTACTS * (size_t)adjacent;
                if (tissue->count[adjacent] > 0 && one->gap < -2 * on->view.settings.self_margin * tissue->shortest)
                    try_deep(on, n, tissue->triangle[one->triangle].tet);
            }
            more = more || tissue->count[n] > 0;
        }
    }
}

/* ---- points */

static pliant_contact_point *append(pliant_contacts *out)
{
    if (!pliant_reserve(&out->point, &out->capacity, out->count, 64, sizeof *out->point)) return NULL;
    pliant_contact_point *point = out->point + out->count++;
    *point = (pliant_contact_point){.kind = PLIANT_OBSTACLE_TISSUE, .tool = -1, .part = -1};
    return point;
}

static pliant_status append_node_points(const finding *on, pliant_contacts *out)
{
    pliant_tissue *tissue = on->tissue;
    for (int32_t n = 0; n < tissue->num_nodes; n++) {
        const pliant_node_contact *list = tissue->node_contacts + PLIANT_MAX_NODE_CONTACTS * (size_t)n;
        tissue->last[n] = tissue->count[n] > 0 ? list[0].triangle : -1;
        for (int32_t k = 0; k < tissue->count[n]; k++) {
            const pliant_surface_triangle *triangle = tissue->triangle + list[k].triangle;
            pliant_contact_point *point = append(out);
            if (!point) return pliant_fail_memory("the self-contacts of the tissue");
            point->feature = (uint64_t)PLIANT_TISSUE_NODE << 56 | (uint64_t)tissue->node[n] << 2 | (uint64_t)k;
            point->node[0] = tissue->node[n];
            point->weight[0] = 1;
            point->count = 1;
            for (int v = 0; v < 3; v++) {
                point->node[point->count] = triangle->node[v];
                point->weight[point->count++] = -list[k].weight[v];
            }
            memcpy(point->normal, tissue->normal[list[k].triangle], sizeof point->normal);
            point->area = tissue->area[n];
            point->friction = on->view.rule.friction;
            pliant_tissue_set_place(point, list[k].gap,
                                    pliant_tissue_node_thickness(tissue, &on->view.rule, tissue->node[n], triangle),
                                    &on->view.rule);
        }
    }
    return PLIANT_OK;
}

/* ---- edges that cross: exempt pairs */

/* Return whether a node of the tetrahedron is inside tissue. */
static bool touches_any(const finding *on, int32_t tet)
{
    const pliant_tissue *tissue = on->tissue;
    for (int v = 0; v < 4; v++) {
        const int32_t index = tissue->index_of[tissue->body->fine.tets[4 * (size_t)tet + (size_t)v]];
        if (index >= 0 && tissue->count[index] > 0 &&
            tissue->node_contacts[PLIANT_MAX_NODE_CONTACTS * (size_t)index].gap < 0)
            return true;
    }
    return false;
}

/* Compute the mean normal of an edge's two triangles. Return false if the triangles are almost coplanar. */
static bool edge_normal(const finding *on, int32_t triangle, int edge, double out[3])
{
    const pliant_tissue *tissue = on->tissue;
    const int32_t adjacent = tissue->triangle[triangle].adjacent[edge];
    for (int d = 0; d < 3; d++)
        out[d] = tissue->normal[triangle][d] + (adjacent >= 0 ? tissue->normal[adjacent][d] : 0);
    return adjacent < 0 ||
           pliant_dot3(tissue->normal[triangle], tissue->normal[adjacent]) < on->view.settings.flat_cosine;
}

/* Return whether a point, relative to the edge, is below both triangles. */
static bool is_below(const pliant_tissue *tissue, int32_t triangle, int edge, const double to[3])
{
    const int32_t adjacent = tissue->triangle[triangle].adjacent[edge];
    return pliant_dot3(to, tissue->normal[triangle]) < 0 &&
           (adjacent < 0 || pliant_dot3(to, tissue->normal[adjacent]) < 0);
}

static pliant_status cross_edges(const finding *on, int32_t a, int i, int32_t b, int j, pliant_contacts *out)
{
    const pliant_tissue *tissue = on->tissue;
    const int32_t *mine = tissue->triangle[a].node, *other = tissue->triangle[b].node;
    const int32_t node[4] = {mine[i], mine[(i + 1) % 3], other[j], other[(j + 1) % 3]};
    double u[3], w[3], to[3], normal[3], side[3], outwards[2][3];
    pliant_tissue_difference(pliant_tissue_position(&on->view, node[0]), pliant_tissue_position(&on->view, node[1]), u);
    pliant_tissue_difference(pliant_tissue_position(&on->view, node[2]), pliant_tissue_position(&on->view, node[3]), w);
    pliant_tissue_difference(pliant_tissue_position(&on->view, node[2]), pliant_tissue_position(&on->view, node[0]),
                             to);
    pliant_cross3(u, w, normal);
    const double square = pliant_dot3(normal, normal);
    if (!(square > PLIANT_TISSUE_PARALLEL * pliant_dot3(u, u) * pliant_dot3(w, w))) return PLIANT_OK;
    pliant_cross3(w, to, side);
    /* fraction of each edge at its nearest point to the other one */
    const double s = pliant_dot3(side, normal) / square;
    pliant_cross3(u, to, side);
    const double t = pliant_dot3(side, normal) / square;
    if (!(s > 0 && s < 1 && t > 0 && t < 1)) return PLIANT_OK;
    if (!edge_normal(on, a, i, outwards[0]) || !edge_normal(on, b, j, outwards[1])) return PLIANT_OK;
    const double sign = pliant_dot3(normal, outwards[1]) > 0 ? 1 : -1;
    for (int d = 0; d < 3; d++) normal[d] *= sign / sqrt(square);
    const double gap = pliant_dot3(to, normal);
    double across[2][3];
    for (int d = 0; d < 3; d++) {
        across[0][d] =
            pliant_tissue_position(&on->view, node[0])[d] + s * u[d] - pliant_tissue_position(&on->view, node[2])[d];
        across[1][d] =
            pliant_tissue_position(&on->view, node[2])[d] + t * w[d] - pliant_tissue_position(&on->view, node[0])[d];
    }
    if (!is_below(tissue, b, j, across[0]) || !is_below(tissue, a, i, across[1])) return PLIANT_OK;
    if (!(gap < 0 && gap > -2 * on->view.settings.self_margin * tissue->shortest) ||
        !(pliant_dot3(normal, outwards[0]) < 0) || !(pliant_dot3(normal, outwards[1]) > 0))
        return PLIANT_OK;
    if (pliant_tissue_piece_of(&on->view, node[0]) >= 0 &&
        pliant_tissue_piece_of(&on->view, node[0]) == pliant_tissue_piece_of(&on->view, node[2]))
        return PLIANT_OK;
    if (pliant_tissue_is_fixed(&on->view, node[0]) && pliant_tissue_is_fixed(&on->view, node[1]) &&
        pliant_tissue_is_fixed(&on->view, node[2]) && pliant_tissue_is_fixed(&on->view, node[3]))
        return PLIANT_OK;
    const uint64_t edge[2] = {pliant_tissue_edge_number(&on->view, 3 * a + i),
                              pliant_tissue_edge_number(&on->view, 3 * b + j)};
    return pliant_tissue_append_edge_point(&on->view.rule, edge, node, (const double[2]){s, t}, normal, gap, 0,
                                           sqrt(pliant_dot3(u, u) * pliant_dot3(w, w)) / 4, out);
}

static pliant_status append_crossing_edges(const finding *on, pliant_contacts *out)
{
    const pliant_tissue *tissue = on->tissue;
    for (int c = 0; c < PLIANT_GRID_CHUNKS; c++) {
        const pliant_grid_pairs *found = tissue->grid.found + c;
        for (int32_t p = 0; p < found->count; p++) {
            const int32_t *pair = found->pair + 2 * (size_t)p;
            if (touches_any(on, pair[0]) || touches_any(on, pair[1])) continue;
            const int32_t a = place_of(tissue->tet, tissue->num_tets, pair[0]),
                          b = place_of(tissue->tet, tissue->num_tets, pair[1]);
            for (int32_t i = 3 * tissue->triangle_start[a]; i < 3 * tissue->triangle_start[a + 1]; i++)
                for (int32_t j = 3 * tissue->triangle_start[b]; j < 3 * tissue->triangle_start[b + 1]; j++) {
                    pliant_status status = cross_edges(on, i / 3, i % 3, j / 3, j % 3, out);
                    if (status != PLIANT_OK) return status;
                }
        }
    }
    return PLIANT_OK;
}

static int compare_points(const void *a, const void *b)
{
    const uint64_t x = ((const pliant_contact_point *)a)->feature, y = ((const pliant_contact_point *)b)->feature;
    return (x > y) - (x < y);
}

/* Sort the points from `first` on, and keep one of each feature. */
static void sort_edges(int32_t first, pliant_contacts *out)
{
    if (out->count == first) return;
    qsort(out->point + first, (size_t)(out->count - first), sizeof *out->point, compare_points);
    int32_t kept = first;
    for (int32_t n = first; n < out->count; n++)
        if (n == first || out->point[n].feature != out->point[kept - 1].feature) out->point[kept++] = out->point[n];
    out->count = kept;
}

/* ---- all contact points */

static pliant_status append_face_points(const finding *on, pliant_contacts *out)
{
    const pliant_tissue *tissue = on->tissue;
    const pliant_tissue_rule *rule = &on->view.rule;
    const double *nodes = rule->nodes ? rule->nodes : on->view.positions;
    bool any = false;
    for (int32_t f = 0; f < tissue->num_faces; f++) {
        const int32_t *tets = tissue->body->fine.tets, *tet = tissue->face[f].tet,
                      piece = pliant_tissue_piece_of(&on->view, tets[4 * (size_t)tet[0]]);
        bool has_slid = false;
        tissue->has_slid[f] = 0;
        if (piece >= 0 && piece == pliant_tissue_piece_of(&on->view, tets[4 * (size_t)tet[1]])) continue;
        pliant_contact_point *point = append(out);
        if (!point) return pliant_fail_memory("the self-contacts of the tissue");
        point->feature = (uint64_t)PLIANT_TISSUE_CUT << 56 | (uint64_t)tissue->face[f].tet[0] << 28 |
                         (uint64_t)tissue->face[f].tet[1];
        point->friction = rule->friction;
        if (!pliant_cut_face_point(tissue->body, tissue->face + f, nodes, rule, &has_slid, point)) out->count--;
        tissue->has_slid[f] = has_slid;
        any = any || has_slid;
    }
    if (!any) return PLIANT_OK;
    return pliant_cut_slid_points(tissue->body, tissue->num_faces, tissue->face, tissue->has_slid, tissue->piece, nodes,
                                  rule, out);
}

/* Return the search distance: nodes can approach each other in a step by about as much as in the previous one.
 * Otherwise a step could end deep inside tissue. The limit is the shortest edge. */
static double find_margin(const pliant_tissue *tissue, const double *positions, double margin, double limit)
{
    double mean[3] = {0, 0, 0}, maximum = 0;
    if (!tissue->has_place) return margin;
    for (int pass = 0; pass < 2; pass++)
        for (int32_t n = 0; n < tissue->num_nodes; n++) {
            double square = 0;
            for (int d = 0; d < 3; d++) {
                const double motion =
                    positions[3 * (size_t)tissue->node[n] + (size_t)d] - tissue->place[3 * (size_t)n + (size_t)d];
                if (!pass) mean[d] += motion / tissue->num_nodes;
                else square += (motion - mean[d]) * (motion - mean[d]);
            }
            maximum = fmax(maximum, square);
        }
    return fmin(margin + 2 * sqrt(maximum), fmax(margin, limit > 0 ? limit : tissue->shortest));
}

static void store_positions(pliant_tissue *tissue, const double *positions)
{
    for (int32_t n = 0; n < tissue->num_nodes; n++)
        memcpy(tissue->place + 3 * (size_t)n, positions + 3 * (size_t)tissue->node[n], 3 * sizeof *positions);
    tissue->has_place = true;
}

/* Search on the CPU: overlapping pairs of tetrahedra, normals, and the contacts of every node. */
static pliant_status search(const finding *on)
{
    pliant_tissue *tissue = on->tissue;
    const pliant_mesh *mesh = &tissue->body->fine;
    const pliant_tissue_rule *rule = &on->view.rule;
    pliant_status status =
        pliant_grid_fill(&tissue->grid, tissue->num_tets, tissue->tet, mesh->tets, on->view.positions,
                         fmax(rule->margin, rule->max_piece_motion), tissue->threads);
    if (status == PLIANT_OK)
        status =
            pliant_grid_overlaps(&tissue->grid, mesh->tets, on->view.positions, tissue->threads, &tissue->num_overlaps);
    if (status != PLIANT_OK) return status;
#pragma omp parallel for schedule(static) num_threads(tissue->threads)
    for (int32_t s = 0; s < tissue->num_triangles; s++) pliant_tissue_set_normal(&on->view, s);
#pragma omp parallel for schedule(dynamic, 64) num_threads(tissue->threads)
    for (int32_t n = 0; n < tissue->num_nodes; n++) search_node(on, n);
    return PLIANT_OK;
}

/* Return whether no node is inside tissue, no edge crosses a triangle, and there are no fragments. */
static bool is_apart(const pliant_tissue *tissue)
{
    bool apart = tissue->num_overlaps == 0;
    for (int32_t n = 0; n < tissue->body->fine.num_nodes && apart; n++) apart = tissue->exempt[n] == 0;
    return apart;
}

/* Explicit dynamics: sub-steps keep tissue out of tissue, so all contacts of nodes are among the listed pairs. Search
 * them if the surface was apart in the last search and still is. */
static pliant_status search_listed(const finding *on, bool *out)
{
    pliant_tissue *tissue = on->tissue;
    const pliant_tissue_rule *rule = &on->view.rule;
    *out = false;
    if (!(rule->max_margin > 0) || !tissue->is_apart || tissue->searcher) return PLIANT_OK;
    for (int32_t s = 0; s < tissue->num_triangles; s++) pliant_tissue_set_normal(&on->view, s);
    memset(tissue->count, 0, (size_t)tissue->num_nodes * sizeof *tissue->count);
    for (int c = 0; c < PLIANT_GRID_CHUNKS; c++) tissue->grid.found[c].count = 0;
    const pliant_status status = pliant_tissue_find_pairs(tissue, on->view.positions, rule);
    *out = status == PLIANT_OK && is_apart(tissue);
    if (*out) pliant_tissue_add_listed_nodes(tissue, &on->view);
    return status;
}

/* Search the whole surface. */
static pliant_status search_all(const finding *on)
{
    pliant_tissue *tissue = on->tissue;
    const pliant_tissue_rule *rule = &on->view.rule;
    pliant_status status =
        pliant_tissue_search_on_device(tissue, on->view.positions, rule) ? PLIANT_OK : search(on);
    if (status != PLIANT_OK) return status;
    for (int c = 0; c < PLIANT_GRID_CHUNKS; c++)
        for (int32_t p = 0; p < tissue->grid.found[c].count; p++) {
            const int32_t *pair = tissue->grid.found[c].pair + 2 * (size_t)p;
            try_pair(on, pair[0], pair[1]);
            try_pair(on, pair[1], pair[0]);
        }
    if (tissue->num_overlaps > 0) spread(on);
    if (rule->thickness > 0) status = pliant_tissue_find_pairs(tissue, on->view.positions, rule);
    tissue->is_apart = status == PLIANT_OK && rule->thickness > 0 && is_apart(tissue);
    return status;
}

pliant_status pliant_tissue_find(pliant_tissue *tissue, const double *positions, const pliant_tissue_rule *given,
                                 pliant_contacts *out)
{
    const pliant_contact_settings defaults = pliant_contact_settings_default();
    pliant_tissue_rule moving = *given;
    moving.margin = find_margin(tissue, positions, given->margin, given->max_margin);
    if (!moving.settings) moving.settings = &defaults;
    const finding on = {.tissue = tissue, .view = pliant_tissue_view_of(tissue, positions, &moving)};
    const int32_t before_all = out->count;
    bool is_found = false;
    pliant_status status = search_listed(&on, &is_found);
    if (status == PLIANT_OK && !is_found) status = search_all(&on);
    if (status == PLIANT_OK) status = append_node_points(&on, out);
    const int32_t first = out->count;
    if (status == PLIANT_OK) status = append_crossing_edges(&on, out);
    if (status == PLIANT_OK) status = pliant_tissue_append_edges(tissue, positions, &moving, out);
    sort_edges(first, out);
    if (status == PLIANT_OK) status = append_face_points(&on, out);
    if (status == PLIANT_OK) store_positions(tissue, positions);
    else out->count = before_all;
    return status;
}
