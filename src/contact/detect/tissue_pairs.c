/* Pairs of a node and a triangle, and of two edges, that keep a distance: contact points of edges, and the fraction of
 * a leg in which the surface does not pass through itself. */
#include "base/buffer.h"
#include "base/fail.h"
#include "base/memory.h"
#include "contact/advance/advance_rules.h"
#include "contact/advance/advance_workspace.h"
#include "contact/detect/tissue_rules.h"
#include "contact/detect/update_sides.h"
#include "contact/shapes/solid.h"
#include "topology/body.h"

#include <math.h>
#include <string.h>

enum { SEAM = 1, NEAR_SEAM = 2 };

/* Mark the nodes at fragments and their neighbors. Fragments are whole tetrahedra, so the surfaces next to them overlap
 * at rest, by less than one tetrahedron. */
static void mark_seams(pliant_tissue *tissue)
{
    const pliant_body *body = tissue->body;
    for (int32_t t = 0; t < body->fine.num_tets; t++)
        for (int v = 0; v < 4 && tissue->inside[t] && !tissue->is_candidate[t]; v++)
            tissue->seam[body->fine.tets[4 * (size_t)t + (size_t)v]] = SEAM;
    for (int32_t n = 0; n < tissue->num_nodes; n++)
        for (int32_t a = tissue->around_start[n]; a < tissue->around_start[n + 1]; a++)
            if (tissue->seam[tissue->node[n]] == SEAM && tissue->seam[tissue->around[a]] == 0)
                tissue->seam[tissue->around[a]] = NEAR_SEAM;
}

pliant_status pliant_tissue_set_rest(pliant_tissue *tissue, const double *rest)
{
    const size_t nodes = (size_t)tissue->body->fine.num_nodes, triangles = (size_t)tissue->num_triangles;
    if (tissue->exempt) return PLIANT_OK;
    tissue->triangles = pliant_calloc(3 * triangles, sizeof *tissue->triangles);
    tissue->rest = pliant_calloc(3 * nodes, sizeof *tissue->rest);
    tissue->seam = pliant_calloc(nodes, 1);
    if (!tissue->triangles || !tissue->rest || !tissue->seam || !(tissue->exempt = pliant_calloc(nodes, 1))) {
        PLIANT_FREE(tissue->triangles, tissue->rest, tissue->seam);
        tissue->triangles = NULL;
        tissue->rest = NULL;
        tissue->seam = NULL;
        return pliant_fail_memory("the self-contacts of the tissue");
    }
    for (size_t s = 0; s < triangles; s++)
        memcpy(tissue->triangles + 3 * s, tissue->triangle[s].node, 3 * sizeof *tissue->triangles);
    memcpy(tissue->rest, rest, 3 * nodes * sizeof *tissue->rest);
    mark_seams(tissue);
    return PLIANT_OK;
}

static pliant_advance_self self_of(const pliant_tissue *tissue, const uint8_t *exempt, double thickness)
{
    return (pliant_advance_self){
        .thickness = thickness, .rest = tissue->rest, .exempt = exempt, .piece = tissue->piece};
}

/* Mark nodes inside tissue, and the triangles that push them out. */
static void mark_inside(pliant_tissue *tissue)
{
    for (int32_t n = 0; n < tissue->num_nodes; n++) {
        const pliant_node_contact *one = tissue->node_contacts + PLIANT_MAX_NODE_CONTACTS * (size_t)n;
        if (tissue->count[n] == 0 || !(one->gap < -PLIANT_TISSUE_BORDER * tissue->shortest)) continue;
        tissue->exempt[tissue->node[n]] = 1;
        for (int v = 0; v < 3; v++) tissue->exempt[tissue->triangle[one->triangle].node[v]] = 1;
    }
}

/* Return whether a cut has split nodes. Its sides have common neighbors in the mesh, and can close onto each other. */
static bool has_cut(const pliant_tissue *tissue)
{
    const pliant_subdivision *subdivision = tissue->body->subdivision;
    return subdivision && subdivision->between;
}

/* Explicit dynamics: return whether a pair has come so near that sub-steps may stop it. It then needs a force, also if
 * its sides are near each other in the mesh, or meet at their borders. */
static bool is_close(const pliant_tissue_rule *rule, double distance, double thickness)
{
    return rule->max_margin > 0 && distance < 2 * thickness;
}

/* Add contacts from outside that the search by tetrahedra leaves out: of nodes with triangles that are near them in the
 * mesh (pliant_tissue_is_near), at the front of a cut, and of close pairs. */
static void add_near_nodes(pliant_tissue *tissue, const double *positions, const pliant_tissue_rule *rule)
{
    const pliant_tissue_view view = pliant_tissue_view_of(tissue, positions, rule);
    const pliant_advance_self self = self_of(tissue, tissue->exempt, rule->thickness);
    const bool cut = has_cut(tissue);
    for (int32_t n = 0; n < tissue->advance->num_self; n++) {
        const pliant_advance_self_pair *pair = tissue->advance->self + n;
        const int32_t node = pair->node[0], triangle = pair->feature[1];
        pliant_node_contact one = {.triangle = triangle};
        if (pair->is_edges || (!cut && pair->limit > 2 * rule->thickness)) continue;
        const double thickness = pliant_advance_thickness(&self, pair->node, false);
        const bool close = is_close(rule, pliant_advance_self_distance(pair, positions), thickness),
                   near = cut && pliant_tissue_is_near(&view, tissue->index_of[node], tissue->triangle[triangle].tet);
        if ((!close && !near) || !(thickness > 0) || !pliant_tissue_can_move(&view, node, triangle) ||
            !pliant_tissue_project(&view, triangle, positions + 3 * (size_t)node, one.weight, &one.gap) ||
            !(one.gap > 0 && one.gap <= pliant_tissue_margin_of(&view, node, triangle)) ||
            !(fmin(one.weight[0], fmin(one.weight[1], one.weight[2])) >=
              -(close ? rule->thickness / tissue->shortest : PLIANT_TISSUE_BORDER)))
            continue;
        pliant_tissue_add_contact(&view, tissue->index_of[node], &one);
    }
}

void pliant_tissue_add_listed_nodes(pliant_tissue *tissue, const pliant_tissue_view *view)
{
    for (int32_t n = 0; n < tissue->advance->num_self; n++) {
        const pliant_advance_self_pair *pair = tissue->advance->self + n;
        if (!pair->is_edges) pliant_tissue_try_triangle(view, tissue->index_of[pair->node[0]], pair->feature[1]);
    }
}

pliant_status pliant_tissue_list_pairs(pliant_tissue *tissue, const double *positions, double distance)
{
    const pliant_advance_self self = self_of(tissue, tissue->seam, distance);
    tissue->listed = distance;
    tissue->is_listed_at_start = false;
    return pliant_advance_audit_self(tissue->advance, tissue->num_triangles, tissue->triangles, positions, &self, NULL,
                                     NULL);
}

pliant_status pliant_tissue_find_pairs(pliant_tissue *tissue, const double *positions, const pliant_tissue_rule *rule)
{
    pliant_status status = tissue->advance ? PLIANT_OK : pliant_advance_create(rule->settings, &tissue->advance);
    if (status == PLIANT_OK) status = pliant_tissue_set_rest(tissue, tissue->body->fine.rest);
    if (status != PLIANT_OK) return status;
    memcpy(tissue->exempt, tissue->seam, (size_t)tissue->body->fine.num_nodes);
    tissue->listed = fmax(rule->margin, rule->max_piece_motion);
    const pliant_advance_self self = self_of(tissue, tissue->seam, tissue->listed);
    if (!pliant_tissue_list_on_device(tissue, &self))
        status = pliant_advance_audit_self(tissue->advance, tissue->num_triangles, tissue->triangles, positions, &self,
                                           tissue->exempt, NULL);
    tissue->is_listed_at_start = status == PLIANT_OK;
    mark_inside(tissue);
    if (status == PLIANT_OK && (has_cut(tissue) || rule->max_margin > 0)) add_near_nodes(tissue, positions, rule);
    return status;
}

double pliant_tissue_node_thickness(const pliant_tissue *tissue, const pliant_tissue_rule *rule, int32_t node,
                                    const pliant_surface_triangle *triangle)
{
    const pliant_advance_self self = self_of(tissue, tissue->seam, rule->thickness);
    const int32_t pair[4] = {node, triangle->node[0], triangle->node[1], triangle->node[2]};
    return pliant_advance_thickness(&self, pair, false);
}

/* ---- contact points of edges */

/* Return whether a direction leads out of the surface at an edge. False: it leads along one of the edge's triangles, so
 * a node or another edge is nearer.
 * @param along vector of the edge, in the direction of its first triangle; sign: 1, or -1 for minus the direction */
static bool leads_out(const pliant_tissue_view *view, int32_t edge, const double along[3], const double direction[3],
                      double sign)
{
    const int32_t triangle[2] = {edge / 3, view->triangle[edge / 3].adjacent[edge % 3]};
    const double tilt = sqrt(1 - view->settings.flat_cosine * view->settings.flat_cosine);
    double height = 0, inwards[3];
    for (int k = 0; k < 2; k++) {
        if (triangle[k] < 0) continue;
        height += sign * pliant_dot3(view->normal[triangle[k]], direction);
        pliant_cross3(view->normal[triangle[k]], along, inwards);
        if ((k ? -sign : sign) * pliant_dot3(inwards, direction) >
            tilt * pliant_length3(along) * pliant_length3(direction))
            return false;
    }
    return height > 0;
}

static bool is_flat(const pliant_tissue_view *view, int32_t edge)
{
    const int32_t adjacent = view->triangle[edge / 3].adjacent[edge % 3];
    return adjacent >= 0 &&
           pliant_dot3(view->normal[edge / 3], view->normal[adjacent]) >= view->settings.flat_cosine;
}

/* Return whether two edges can have contact: not if all nodes are fixed. Without a cut, also not if the tetrahedron of
 * one edge has a node of the other edge. */
static bool can_touch(const pliant_tissue_view *view, const pliant_advance_self_pair *pair, bool cut)
{
    bool fixed = true;
    for (int c = 0; c < 4; c++) {
        fixed = fixed && pliant_tissue_is_fixed(view, pair->node[c]);
        if (!cut && pliant_tissue_has_node(view, view->triangle[pair->feature[c < 2] / 3].tet, pair->node[c]))
            return false;
    }
    return !fixed;
}

pliant_status pliant_tissue_append_edge_point(const pliant_tissue_rule *rule, const uint64_t edge[2],
                                              const int32_t node[4], const double at[2], const double normal[3],
                                              double gap, double thickness, double area, pliant_contacts *out)
{
    if (!pliant_reserve(&out->point, &out->capacity, out->count, 64, sizeof *out->point))
        return pliant_fail_memory("the self-contacts of the tissue");
    pliant_contact_point *point = out->point + out->count++;
    *point = (pliant_contact_point){.kind = PLIANT_OBSTACLE_TISSUE, .tool = -1, .part = -1, .count = 4};
    const double weight[4] = {1 - at[0], at[0], at[1] - 1, -at[1]};
    const bool turned = edge[0] > edge[1];
    point->feature = (uint64_t)PLIANT_TISSUE_EDGE << 56 | edge[turned] << 28 | edge[!turned];
    for (int v = 0; v < 4; v++) {
        point->node[v] = node[turned ? (v + 2) % 4 : v];
        point->weight[v] = turned ? -weight[(v + 2) % 4] : weight[v];
    }
    for (int d = 0; d < 3; d++) point->normal[d] = turned ? -normal[d] : normal[d];
    point->area = area;
    point->friction = rule->friction;
    pliant_tissue_set_place(point, gap, thickness, rule);
    return PLIANT_OK;
}

static pliant_status append_pair(const pliant_tissue_view *view, const pliant_advance_self *self, bool cut,
                                 const pliant_advance_self_pair *pair, pliant_contacts *out)
{
    double x[4][3], s, t, normal[3], u[3], w[3], side[3];
    /* nodes touch parallel edges, and flat edges before they are as near as this */
    const double near = view->settings.advance_stop * view->rule.thickness;
    if (pair->limit >= near && (is_flat(view, pair->feature[0]) || is_flat(view, pair->feature[1]))) return PLIANT_OK;
    for (int c = 0; c < 4; c++) memcpy(x[c], pliant_tissue_position(view, pair->node[c]), sizeof x[c]);
    pliant_advance_closest_on_segments((const double(*)[3])x, (const double(*)[3])(x + 2), &s, &t);
    if (!(s > 0 && s < 1 && t > 0 && t < 1)) return PLIANT_OK;
    for (int d = 0; d < 3; d++) {
        u[d] = x[1][d] - x[0][d];
        w[d] = x[3][d] - x[2][d];
        normal[d] = x[0][d] + s * u[d] - x[2][d] - t * w[d];
    }
    pliant_cross3(u, w, side);
    const double gap = pliant_length3(normal), thickness = pliant_advance_thickness(self, pair->node, true);
    if (!(thickness > 0)) return PLIANT_OK;
    const bool is_near = gap < view->settings.advance_stop * thickness;
    if (!can_touch(view, pair, cut || is_close(&view->rule, gap, thickness))) return PLIANT_OK;
    if (!(gap > 0) || !(pliant_dot3(side, side) > PLIANT_TISSUE_PARALLEL * pliant_dot3(u, u) * pliant_dot3(w, w)))
        return PLIANT_OK;
    if (!is_near && (is_flat(view, pair->feature[0]) || is_flat(view, pair->feature[1]) ||
                     !leads_out(view, pair->feature[0], u, normal, -1) ||
                     !leads_out(view, pair->feature[1], w, normal, 1)))
        return PLIANT_OK;
    for (int d = 0; d < 3; d++) normal[d] /= gap;
    const uint64_t edge[2] = {(uint64_t)pair->feature[0], (uint64_t)pair->feature[1]};
    return pliant_tissue_append_edge_point(&view->rule, edge, pair->node, (const double[2]){s, t}, normal, gap,
                                           thickness, pliant_length3(u) * pliant_length3(w) / 4, out);
}

/* ---- contact points of corners: a node with a node, or with the inside of an edge */

/* Return whether another point is outside of the surface at a node, and no edge of the node leads nearer to it. */
static bool is_nearest_corner(const pliant_tissue_view *view, int32_t index, const double to[3])
{
    const double tilt = sqrt(1 - view->settings.flat_cosine * view->settings.flat_cosine);
    double height = 0;
    for (int32_t k = view->node_triangle_start[index]; k < view->node_triangle_start[index + 1]; k++)
        height += pliant_dot3(view->normal[view->node_triangles[k]], to);
    if (!(height > 0)) return false;
    for (int32_t a = view->around_start[index]; a < view->around_start[index + 1]; a++) {
        double edge[3];
        pliant_tissue_difference(pliant_tissue_position(view, view->node[index]),
                                 pliant_tissue_position(view, view->around[a]), edge);
        if (pliant_dot3(edge, to) > tilt * pliant_length3(edge) * pliant_length3(to)) return false;
    }
    return true;
}

/* The nearest point of one side of a pair: at a node, inside an edge (3 times its triangle plus its first corner), or
 * neither. */
typedef struct nearest_place {
    int32_t node, edge; /* -1: none */
    double at;          /* fraction of the edge */
} nearest_place;

static nearest_place place_on_edge(const pliant_tissue_view *view, int32_t edge, double at)
{
    const int32_t *node = view->triangle[edge / 3].node;
    if (at > 0 && at < 1) return (nearest_place){-1, edge, at};
    return (nearest_place){node[(edge + (at > 0)) % 3], -1, 0};
}

static nearest_place place_on_triangle(const pliant_tissue_view *view, int32_t triangle, const double weight[3])
{
    const double rounding = 1e-12;
    int32_t zero = -1, zeros = 0;
    for (int v = 0; v < 3; v++) {
        if (weight[v] > rounding) continue;
        zero = v;
        zeros++;
    }
    if (zeros == 0) return (nearest_place){-1, -1, 0};
    if (zeros == 1) return place_on_edge(view, 3 * triangle + (zero + 1) % 3, weight[(zero + 2) % 3]);
    for (int v = 0; v < 3; v++)
        if (weight[v] > rounding) zero = v;
    return (nearest_place){view->triangle[triangle].node[zero], -1, 0};
}

/* Find the nearest places of both sides of a pair. */
static void find_places(const pliant_tissue_view *view, const pliant_advance_self_pair *pair, nearest_place out[2])
{
    double x[4][3], weight[3], s, t;
    for (int c = 0; c < 4; c++) memcpy(x[c], pliant_tissue_position(view, pair->node[c]), sizeof x[c]);
    if (pair->is_edges) {
        pliant_advance_closest_on_segments((const double(*)[3])x, (const double(*)[3])(x + 2), &s, &t);
        out[0] = place_on_edge(view, pair->feature[0], s);
        out[1] = place_on_edge(view, pair->feature[1], t);
    } else {
        pliant_triangle_nearest_weights(x[1], x[2], x[3], x[0], weight);
        out[0] = (nearest_place){pair->node[0], -1, 0};
        out[1] = place_on_triangle(view, pair->feature[1], weight);
    }
}

/* Append a point for a pair whose nearest points are two nodes, or a node and a point inside an edge. Nodes find only
 * the triangles above or below them, so two corners that meet would have no point, and their leg would be blocked. */
static pliant_status append_corner(const pliant_tissue *tissue, const pliant_tissue_view *view,
                                   const pliant_advance_self *self, const pliant_advance_self_pair *pair,
                                   pliant_contacts *out)
{
    nearest_place place[2];
    const double near = view->settings.advance_stop;
    bool fixed = true;
    for (int c = 0; c < 4; c++) fixed = fixed && pliant_tissue_is_fixed(view, pair->node[c]);
    if (fixed || pair->limit >= near * view->rule.thickness) return PLIANT_OK;
    if (!(pliant_advance_thickness(self, pair->node, pair->is_edges) > 0)) return PLIANT_OK;
    find_places(view, pair, place);
    if (place[0].node < 0 || (place[1].node >= 0 && place[1].node < place[0].node)) {
        const nearest_place first = place[0];
        place[0] = place[1];
        place[1] = first;
    }
    if (place[0].node < 0 || (place[1].node < 0 && place[1].edge < 0)) return PLIANT_OK;
    const uint64_t edge = place[1].node < 0 ? pliant_tissue_edge_number(view, place[1].edge) : 0;
    const int32_t *of = view->triangle[edge / 3].node, v = place[0].node;
    const bool is_edge = place[1].node < 0;
    const int32_t node[4] = {v, v, is_edge ? of[edge % 3] : place[1].node,
                             is_edge ? of[(edge + 1) % 3] : place[1].node};
    double x[4][3], s, at, way[3], back[3], along[3];
    for (int c = 0; c < 4; c++) memcpy(x[c], pliant_tissue_position(view, node[c]), sizeof x[c]);
    pliant_advance_closest_on_segments((const double(*)[3])x, (const double(*)[3])(x + 2), &s, &at);
    pliant_tissue_difference(x[2], x[3], along);
    for (int d = 0; d < 3; d++) way[d] = x[0][d] - x[2][d] - at * along[d];
    for (int d = 0; d < 3; d++) back[d] = -way[d];
    const double gap = pliant_length3(way), thickness = pliant_advance_thickness(self, node, true);
    if (!(thickness > 0) || !(gap > 0) || !(gap < near * thickness)) return PLIANT_OK;
    if (!is_nearest_corner(view, tissue->index_of[v], back) ||
        !(is_edge ? leads_out(view, (int32_t)edge, along, way, 1)
                  : is_nearest_corner(view, tissue->index_of[node[2]], way)))
        return PLIANT_OK;
    if (!pliant_reserve(&out->point, &out->capacity, out->count, 64, sizeof *out->point))
        return pliant_fail_memory("the self-contacts of the tissue");
    pliant_contact_point *point = out->point + out->count++;
    *point = (pliant_contact_point){.kind = PLIANT_OBSTACLE_TISSUE,
                                    .tool = -1,
                                    .part = -1,
                                    .count = is_edge ? 3 : 2,
                                    .node = {v, node[2], node[3]},
                                    .weight = {1, at - 1, is_edge ? -at : 0},
                                    .area = tissue->area[tissue->index_of[v]],
                                    .friction = view->rule.friction};
    point->feature = (uint64_t)PLIANT_TISSUE_CORNER << 56 | (uint64_t)is_edge << 55 | (uint64_t)v << 28 |
                     (is_edge ? edge : (uint64_t)node[2]);
    if (!is_edge) point->weight[1] = -1;
    for (int d = 0; d < 3; d++) point->normal[d] = way[d] / gap;
    pliant_tissue_set_place(point, gap, thickness, &view->rule);
    return PLIANT_OK;
}

pliant_status pliant_tissue_append_edges(pliant_tissue *tissue, const double *positions,
                                         const pliant_tissue_rule *rule, pliant_contacts *out)
{
    const pliant_tissue_view view = pliant_tissue_view_of(tissue, positions, rule);
    const pliant_advance_self self = self_of(tissue, tissue->exempt, rule->thickness);
    const pliant_advance *advance = tissue->advance;
    pliant_status status = PLIANT_OK;
    for (int32_t n = 0; rule->thickness > 0 && n < advance->num_self && status == PLIANT_OK; n++) {
        if (advance->self[n].is_edges)
            status = append_pair(&view, &self, has_cut(tissue), advance->self + n, out);
        if (status == PLIANT_OK && !(rule->max_margin > 0))
            status = append_corner(tissue, &view, &self, advance->self + n, out);
    }
    return status;
}

/* ---- a leg */

pliant_status pliant_tissue_advance(pliant_tissue *tissue, const double *from, const double *to,
                                    const pliant_tissue_rule *rule, double *out)
{
    const pliant_advance_self self = self_of(tissue, tissue->exempt, rule->thickness);
    /* Mostly all pairs that can come near each other in the leg have been listed at its start. */
    const double reach = pliant_advance_relative_motion(tissue->num_nodes, tissue->node, from, to) +
                         pliant_advance_self_margin(rule->settings, rule->thickness);
    tissue->is_listed_at_start = tissue->is_listed_at_start && reach <= tissue->listed;
    return pliant_advance_find_self(tissue->advance, tissue->num_triangles, tissue->triangles, from, to, &self,
                                    tissue->is_listed_at_start ? reach : 0, tissue->threads, out);
}

double pliant_tissue_pair_thickness(const pliant_tissue *tissue, const pliant_tissue_rule *rule,
                                    const struct pliant_advance_self_pair *pair)
{
    const pliant_advance_self self = self_of(tissue, tissue->exempt, rule->thickness);
    return pliant_advance_thickness(&self, pair->node, pair->is_edges);
}

double pliant_tissue_advance_pair(pliant_tissue *tissue, const double *from, const double *to,
                                  const pliant_tissue_rule *rule, struct pliant_advance_self_pair *pair)
{
    const pliant_advance_self self = self_of(tissue, tissue->exempt, rule->thickness);
    return pliant_advance_self_time(tissue->advance, from, to, &self, pair);
}
