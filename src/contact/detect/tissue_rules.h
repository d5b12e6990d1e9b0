/* Contact of a surface node with triangles (tissue.h): code that the CPU and CUDA kernels share. */
#ifndef PLIANT_CONTACT_TISSUE_RULES_H
#define PLIANT_CONTACT_TISSUE_RULES_H

#include "base/inline.h"
#include "base/vector3.h"
#include "contact/detect/tissue.h"

#include <math.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PLIANT_TISSUE_PARALLEL 1e-4 /* squared sine of the angle below which edges have no closest points */
#define PLIANT_TISSUE_BORDER 1e-6 /* a weight below minus this value is outside the triangle or tetrahedron */
enum { PLIANT_TISSUE_MAX_WALK = 64 /* maximum number of tetrahedra or triangles in a walk to a point */ };

/* Data of struct pliant_tissue and its topology that the search reads. */
typedef struct pliant_tissue_view {
    const double *positions;
    pliant_tissue_rule rule;
    pliant_contact_settings settings;   /* settings of the rule */
    double shortest;
    const int32_t *tets, *across;
    const uint8_t *is_candidate, *fixed; /* fixed: Nullable */
    const int32_t *node_parent, *piece;  /* Nullable; node_parent is NULL also without cuts */
    const pliant_surface_triangle *triangle;
    const int32_t *triangle_start, *node, *around_start, *around, *node_triangle_start, *node_triangles, *last;
    double (*normal)[3];
    int32_t *count;
    pliant_node_contact *node_contacts;
} pliant_tissue_view;

/* View of the host's data. */
pliant_tissue_view pliant_tissue_view_of(pliant_tissue *tissue, const double *positions,
                                         const pliant_tissue_rule *rule);

/* Add the contacts of nodes among the listed pairs (tissue_pairs.c). */
void pliant_tissue_add_listed_nodes(pliant_tissue *tissue, const pliant_tissue_view *view);

PLIANT_INLINE void pliant_tissue_difference(const double *from, const double *to, double out[3])
{
    for (int d = 0; d < 3; d++) out[d] = to[d] - from[d];
}

PLIANT_INLINE const double *pliant_tissue_position(const pliant_tissue_view *on, int32_t node)
{
    return on->positions + 3 * (size_t)node;
}

/* ---- triangles */

/* Compute the triangle's unit normal; 0 if its area is 0. */
PLIANT_INLINE void pliant_tissue_set_normal(const pliant_tissue_view *on, int32_t triangle)
{
    const int32_t *node = on->triangle[triangle].node;
    double a[3], b[3], *normal = on->normal[triangle];
    pliant_tissue_difference(pliant_tissue_position(on, node[0]), pliant_tissue_position(on, node[1]), a);
    pliant_tissue_difference(pliant_tissue_position(on, node[0]), pliant_tissue_position(on, node[2]), b);
    pliant_cross3(a, b, normal);
    const double length = pliant_length3(normal);
    for (int d = 0; d < 3; d++) normal[d] = length > 0 ? normal[d] / length : 0;
}

/* Compute the weights of the corners at the foot of a point, and its height. Return false if the triangle's area is
 * 0. */
PLIANT_INLINE bool pliant_tissue_project(const pliant_tissue_view *on, int32_t triangle, const double point[3],
                                         double weight[3], double *gap)
{
    const int32_t *node = on->triangle[triangle].node;
    const double *normal = on->normal[triangle], *corner = pliant_tissue_position(on, node[0]);
    double a[3], b[3], to[3], side[3];
    pliant_tissue_difference(corner, pliant_tissue_position(on, node[1]), a);
    pliant_tissue_difference(corner, pliant_tissue_position(on, node[2]), b);
    pliant_tissue_difference(corner, point, to);
    pliant_cross3(a, b, side);
    const double whole = pliant_dot3(side, normal);
    if (!(whole > 0)) return false;
    pliant_cross3(to, b, side);
    weight[1] = pliant_dot3(side, normal) / whole;
    pliant_cross3(a, to, side);
    weight[2] = pliant_dot3(side, normal) / whole;
    weight[0] = 1 - weight[1] - weight[2];
    *gap = pliant_dot3(to, normal);
    return true;
}

/* Return the number of an edge, 3 times a triangle plus the edge's first corner, for its triangle with the lower
 * number. */
PLIANT_INLINE uint64_t pliant_tissue_edge_number(const pliant_tissue_view *on, int32_t edge)
{
    const int32_t triangle = edge / 3, corner = edge % 3, adjacent = on->triangle[triangle].adjacent[corner];
    for (int32_t k = 0; k < 3 && adjacent >= 0 && adjacent < triangle; k++)
        if (on->triangle[adjacent].adjacent[k] == triangle &&
            on->triangle[adjacent].node[k] == on->triangle[triangle].node[(corner + 1) % 3])
            return 3 * (uint64_t)adjacent + (uint64_t)k;
    return (uint64_t)edge;
}

/* ---- tetrahedra */

/* Walk from a tetrahedron towards a point. Return the tetrahedron that contains it; -1: outside, or too far. */
PLIANT_INLINE int32_t pliant_tissue_walk(const pliant_tissue_view *on, int32_t tet, const double point[3])
{
    for (int step = 0; step < PLIANT_TISSUE_MAX_WALK; step++) {
        const int32_t *node = on->tets + 4 * (size_t)tet;
        double edge[3][3], to[3], normal[3], weight[4], minimum = 0;
        int out = -1;
        for (int v = 0; v < 3; v++)
            pliant_tissue_difference(pliant_tissue_position(on, node[0]), pliant_tissue_position(on, node[v + 1]),
                                     edge[v]);
        pliant_tissue_difference(pliant_tissue_position(on, node[0]), point, to);
        pliant_cross3(edge[1], edge[2], normal);
        const double volume = pliant_dot3(edge[0], normal);
        if (!(volume > 0)) return -1;
        weight[1] = pliant_dot3(to, normal) / volume;
        pliant_cross3(edge[2], edge[0], normal);
        weight[2] = pliant_dot3(to, normal) / volume;
        pliant_cross3(edge[0], edge[1], normal);
        weight[3] = pliant_dot3(to, normal) / volume;
        weight[0] = 1 - weight[1] - weight[2] - weight[3];
        for (int v = 0; v < 4; v++)
            if (weight[v] < minimum) {
                minimum = weight[v];
                out = v;
            }
        if (!(minimum < -PLIANT_TISSUE_BORDER)) return tet;
        tet = on->across[4 * (size_t)tet + (size_t)out];
        if (tet < 0 || !on->is_candidate[tet]) return -1;
    }
    return -1;
}

/* Return whether two nodes are copies of one node and less than an edge apart. A cut through voxels has made such
 * copies, and the contact of its faces uses their links. */
PLIANT_INLINE bool pliant_tissue_are_copies(const pliant_tissue_view *on, int32_t a, int32_t b)
{
    if (!on->node_parent || on->node_parent[a] != on->node_parent[b]) return false;
    double difference[3];
    pliant_tissue_difference(pliant_tissue_position(on, a), pliant_tissue_position(on, b), difference);
    return pliant_dot3(difference, difference) < on->shortest * on->shortest;
}

/* Return whether a tetrahedron has a node, or a copy of it that a cut has separated. */
PLIANT_INLINE bool pliant_tissue_has_node(const pliant_tissue_view *on, int32_t tet, int32_t node)
{
    const int32_t *of = on->tets + 4 * (size_t)tet;
    for (int v = 0; v < 4; v++)
        if (of[v] == node || pliant_tissue_are_copies(on, of[v], node)) return true;
    return false;
}

/* Return whether a tetrahedron has a surface node or one of its neighbors. */
PLIANT_INLINE bool pliant_tissue_is_near(const pliant_tissue_view *on, int32_t index, int32_t tet)
{
    if (pliant_tissue_has_node(on, tet, on->node[index])) return true;
    for (int32_t a = on->around_start[index]; a < on->around_start[index + 1]; a++)
        if (pliant_tissue_has_node(on, tet, on->around[a])) return true;
    return false;
}

PLIANT_INLINE bool pliant_tissue_is_fixed(const pliant_tissue_view *on, int32_t node)
{
    const uint8_t *fixed = on->fixed;
    return fixed && fixed[node] == PLIANT_FIXED_AT_REST;
}

/* Return the detached piece of a node; -1: none. */
PLIANT_INLINE int32_t pliant_tissue_piece_of(const pliant_tissue_view *on, int32_t node)
{
    return on->piece ? on->piece[node] : -1;
}

/* Return whether a node and a triangle can have contact. A rigid piece has no contact with itself, and fixed tissue
 * has none with fixed tissue. */
PLIANT_INLINE bool pliant_tissue_can_move(const pliant_tissue_view *on, int32_t node, int32_t triangle)
{
    const int32_t *of = on->triangle[triangle].node, piece = pliant_tissue_piece_of(on, node);
    if (piece >= 0 && pliant_tissue_piece_of(on, of[0]) == piece) return false;
    return !(pliant_tissue_is_fixed(on, node) && pliant_tissue_is_fixed(on, of[0]) &&
             pliant_tissue_is_fixed(on, of[1]) && pliant_tissue_is_fixed(on, of[2]));
}

/* Return the search distance of a node and a triangle. */
PLIANT_INLINE double pliant_tissue_margin_of(const pliant_tissue_view *on, int32_t node, int32_t triangle)
{
    const bool piece =
        pliant_tissue_piece_of(on, node) >= 0 || pliant_tissue_piece_of(on, on->triangle[triangle].node[0]) >= 0;
    return piece ? fmax(on->rule.margin, on->rule.max_piece_motion) : on->rule.margin;
}

/* ---- a node */

/* Return whether some triangle around the node faces the given triangle. */
PLIANT_INLINE bool pliant_tissue_faces(const pliant_tissue_view *on, int32_t index, int32_t triangle)
{
    for (int32_t k = on->node_triangle_start[index]; k < on->node_triangle_start[index + 1]; k++)
        if (pliant_dot3(on->normal[on->node_triangles[k]], on->normal[triangle]) < -on->settings.facing_cosine)
            return true;
    return false;
}

PLIANT_INLINE bool pliant_node_contact_before(const pliant_node_contact *a, const pliant_node_contact *b)
{
    return a->depth != b->depth ? a->depth < b->depth : a->triangle < b->triangle;
}

/* Add a contact to the node's list. Inside tissue, keep only the shortest direction out; it replaces all contacts
 * from outside. From outside, keep the nearest contact for each direction. */
PLIANT_INLINE void pliant_tissue_add_contact(const pliant_tissue_view *on, int32_t index, pliant_node_contact *one)
{
    /* walls of one of two blocks in flush contact lie at the border of the other */
    const bool faces_away = !pliant_tissue_faces(on, index, one->triangle);
    pliant_node_contact *list = on->node_contacts + PLIANT_MAX_NODE_CONTACTS * (size_t)index;
    int32_t count = on->count[index], at;
    /* height below which a node counts as inside */
    const double surface = 10 * PLIANT_TISSUE_BORDER * on->shortest;
    const bool inside = count > 0 && list[0].gap < surface;
    one->depth = fabs(one->gap) + (faces_away ? on->rule.margin : 0.0);
    if (faces_away && one->gap >= surface) return;
    if (inside && (one->gap >= surface || !pliant_node_contact_before(one, list))) return;
    if (inside || one->gap < surface) {
        list[0] = *one;
        on->count[index] = 1;
        return;
    }
    for (int32_t n = 0; n < count; n++)
        /* both have the same direction: keep one */
        if (pliant_dot3(on->normal[list[n].triangle], on->normal[one->triangle]) > on->settings.same_cosine) {
            if (pliant_node_contact_before(one, list + n)) list[n] = *one;
            return;
        }
    if (count < PLIANT_MAX_NODE_CONTACTS) on->count[index]++;
    else if (!pliant_node_contact_before(one, list + count - 1)) return;
    for (at = on->count[index] - 1; at > 0 && pliant_node_contact_before(one, list + at - 1); at--)
        list[at] = list[at - 1];
    list[at] = *one;
}

/* Test a node against a triangle. Return whether there is a contact. */
PLIANT_INLINE bool pliant_tissue_test_triangle(const pliant_tissue_view *on, int32_t index, int32_t triangle,
                                               pliant_node_contact *one)
{
    const int32_t node = on->node[index], tet = on->triangle[triangle].tet;
    const double *point = pliant_tissue_position(on, node);
    one->triangle = triangle;
    one->depth = 0;
    if (!pliant_tissue_project(on, triangle, point, one->weight, &one->gap) ||
        !(one->gap <= pliant_tissue_margin_of(on, node, triangle)))
        return false;
    const double minimum = fmin(one->weight[0], fmin(one->weight[1], one->weight[2]));
    /* tolerance for the triangle of the previous contact, so that the contact does not change with every step */
    const double border = on->settings.self_border;
    const bool holds = on->last[index] == triangle && one->gap > -border * on->shortest;
    if (minimum < (holds ? -border : -PLIANT_TISSUE_BORDER)) return false;
    if (pliant_tissue_is_near(on, index, tet) || !pliant_tissue_can_move(on, node, triangle)) return false;
    if (!(one->gap < 0)) return true;
    const int32_t holder = pliant_tissue_walk(on, tet, point);
    return holder < 0 ? minimum < -PLIANT_TISSUE_BORDER : !pliant_tissue_is_near(on, index, holder);
}

/* Test a node against a triangle, and add a contact if there is one. */
PLIANT_INLINE void pliant_tissue_try_triangle(const pliant_tissue_view *on, int32_t index, int32_t triangle)
{
    pliant_node_contact one;
    if (pliant_tissue_test_triangle(on, index, triangle, &one)) pliant_tissue_add_contact(on, index, &one);
}

/* Walk over adjacent triangles to the triangle below a point. */
PLIANT_INLINE int32_t pliant_tissue_walk_triangles(const pliant_tissue_view *on, int32_t triangle,
                                                   const double point[3])
{
    double weight[3], gap;
    for (int step = 0; step < PLIANT_TISSUE_MAX_WALK; step++) {
        int minimum = 0;
        if (!pliant_tissue_project(on, triangle, point, weight, &gap)) return triangle;
        for (int v = 1; v < 3; v++)
            if (weight[v] < weight[minimum]) minimum = v;
        if (!(weight[minimum] < -PLIANT_TISSUE_BORDER)) return triangle;
        const int32_t adjacent =
            on->triangle[triangle].adjacent[(minimum + 1) % 3]; /* across the edge opposite that corner */
        if (adjacent < 0) return triangle;
        triangle = adjacent;
    }
    return triangle;
}

/* Without another contact, try the triangle of the previous step: the node may be deep inside. */
PLIANT_INLINE void pliant_tissue_try_last(const pliant_tissue_view *on, int32_t index)
{
    if (on->last[index] >= 0 && on->count[index] == 0)
        pliant_tissue_try_triangle(
            on, index, pliant_tissue_walk_triangles(on, on->last[index], pliant_tissue_position(on, on->node[index])));
}

PLIANT_INLINE bool pliant_tissue_is_in_box(const double point[3], const double low[3], const double high[3])
{
    return point[0] >= low[0] && point[0] <= high[0] && point[1] >= low[1] && point[1] <= high[1] &&
           point[2] >= low[2] && point[2] <= high[2];
}

#ifdef __cplusplus
}
#endif
#endif
