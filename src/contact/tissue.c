/* Where tissue touches tissue in a step: outer surfaces. */
#include "contact/tissue.h"

#include "base/fail.h"
#include "contact/follow.h"
#include "pliant/memory.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double border = 1e-6;    /* weights that far below 0 are of points beside a triangle or a tetrahedron */
static const double alike = 0.7;      /* cosine between normals of triangles that push one way: a node needs one of them */
static const double facing = 0.1;     /* cosine between normals that face each other, and more */
static const double blunt = 0.95;     /* cosine between normals on both sides of an edge, beyond which it is none */
static const double farthest = 0.5;   /* of the shortest edge: edges that cross are no deeper */
enum { MOST_WAY = 64 /* tetrahedra or triangles from one to a point */ };

typedef struct finding {
    pliant_tissue *tissue;
    const double *positions;
    const pliant_tissue_rule *rule;
} finding;

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross(const double a[3], const double b[3], double out[3])
{
    for (int d = 0; d < 3; d++) out[d] = a[(d + 1) % 3] * b[(d + 2) % 3] - a[(d + 2) % 3] * b[(d + 1) % 3];
}

static void between(const double *from, const double *to, double out[3])
{
    for (int d = 0; d < 3; d++) out[d] = to[d] - from[d];
}

static const double *place_of(const finding *on, int32_t node) { return on->positions + 3 * (size_t)node; }

/* ---- triangles */

static void find_normals(const finding *on)
{
    pliant_tissue *tissue = on->tissue;
#pragma omp parallel for schedule(static) num_threads(tissue->threads)
    for (int32_t s = 0; s < tissue->num_skins; s++) {
        const int32_t *node = tissue->skin[s].node;
        double a[3], b[3], *normal = tissue->normal[s];
        between(place_of(on, node[0]), place_of(on, node[1]), a);
        between(place_of(on, node[0]), place_of(on, node[2]), b);
        cross(a, b, normal);
        const double length = sqrt(dot(normal, normal));
        for (int d = 0; d < 3; d++) normal[d] = length > 0 ? normal[d] / length : 0;
    }
}

/* Weights of the corners at the foot of a point, and how high it is. false: the triangle has no area. */
static bool look_down(const finding *on, int32_t skin, const double point[3], double weight[3], double *gap)
{
    const int32_t *node = on->tissue->skin[skin].node;
    const double *normal = on->tissue->normal[skin], *corner = place_of(on, node[0]);
    double a[3], b[3], to[3], side[3];
    between(corner, place_of(on, node[1]), a);
    between(corner, place_of(on, node[2]), b);
    between(corner, point, to);
    cross(a, b, side);
    const double whole = dot(side, normal);
    if (!(whole > 0)) return false;
    cross(to, b, side);
    weight[1] = dot(side, normal) / whole;
    cross(a, to, side);
    weight[2] = dot(side, normal) / whole;
    weight[0] = 1 - weight[1] - weight[2];
    *gap = dot(to, normal);
    return true;
}

/* ---- tetrahedra */

/* From a tetrahedron towards a point; the one that holds it, or -1: it is outside, or too far. */
static int32_t walk(const finding *on, int32_t tet, const double point[3])
{
    const pliant_tissue *tissue = on->tissue;
    for (int way = 0; way < MOST_WAY; way++) {
        const int32_t *node = tissue->body->fine.tets + 4 * (size_t)tet;
        double edge[3][3], to[3], normal[3], weight[4], least = 0;
        int out = -1;
        for (int v = 0; v < 3; v++) between(place_of(on, node[0]), place_of(on, node[v + 1]), edge[v]);
        between(place_of(on, node[0]), point, to);
        cross(edge[1], edge[2], normal);
        const double volume = dot(edge[0], normal);
        if (!(volume > 0)) return -1;
        weight[1] = dot(to, normal) / volume;
        cross(edge[2], edge[0], normal);
        weight[2] = dot(to, normal) / volume;
        cross(edge[0], edge[1], normal);
        weight[3] = dot(to, normal) / volume;
        weight[0] = 1 - weight[1] - weight[2] - weight[3];
        for (int v = 0; v < 4; v++)
            if (weight[v] < least) {
                least = weight[v];
                out = v;
            }
        if (!(least < -border)) return tet;
        tet = tissue->across[4 * (size_t)tet + (size_t)out];
        if (tet < 0 || !tissue->apart[tet]) return -1;
    }
    return -1;
}

/* Whether nodes are copies of one, less than an edge apart: a cut through voxels has parted them, and its faces touch by their links. */
static bool were_one(const finding *on, int32_t a, int32_t b)
{
    const pliant_body *body = on->tissue->body;
    if (!body->cuts || !body->node_parent || body->node_parent[a] != body->node_parent[b]) return false;
    double apart[3];
    between(place_of(on, a), place_of(on, b), apart);
    return dot(apart, apart) < on->tissue->shortest * on->tissue->shortest;
}

static bool has_node(const finding *on, int32_t tet, int32_t node)
{
    const int32_t *of = on->tissue->body->fine.tets + 4 * (size_t)tet;
    for (int v = 0; v < 4; v++)
        if (of[v] == node || were_one(on, of[v], node)) return true;
    return false;
}

/* whether a tetrahedron has a node of the surface, or one beside it */
static bool is_near(const finding *on, int32_t index, int32_t tet)
{
    const pliant_tissue *tissue = on->tissue;
    if (has_node(on, tet, tissue->node[index])) return true;
    for (int32_t a = tissue->around_start[index]; a < tissue->around_start[index + 1]; a++)
        if (has_node(on, tet, tissue->around[a])) return true;
    return false;
}

static bool is_fixed(const finding *on, int32_t node)
{
    const uint8_t *fixed = on->tissue->body->fine_fixed;
    return fixed && fixed[node] == PLIANT_FIXED_AT_REST;
}

/* which piece that has come off a node is of; -1: none */
static int32_t piece_of(const finding *on, int32_t node) { return on->tissue->piece ? on->tissue->piece[node] : -1; }

/* what is rigid does not touch itself */
static bool can_move(const finding *on, int32_t node, int32_t skin)
{
    const int32_t *of = on->tissue->skin[skin].node, piece = piece_of(on, node);
    if (piece >= 0 && piece_of(on, of[0]) == piece) return false;
    return !(is_fixed(on, node) && is_fixed(on, of[0]) && is_fixed(on, of[1]) && is_fixed(on, of[2]));
}

/* how far away they are looked for */
static double margin_of(const finding *on, int32_t node, int32_t skin)
{
    const bool piece = piece_of(on, node) >= 0 || piece_of(on, on->tissue->skin[skin].node[0]) >= 0;
    return piece ? fmax(on->rule->margin, on->rule->pieces_go) : on->rule->margin;
}

/* ---- a node */

/* whether some of the surface around a node faces a triangle */
static bool faces(const finding *on, int32_t index, int32_t skin)
{
    const pliant_tissue *tissue = on->tissue;
    for (int32_t k = tissue->fan_start[index]; k < tissue->fan_start[index + 1]; k++)
        if (dot(tissue->normal[tissue->fan[k]], tissue->normal[skin]) < -facing) return true;
    return false;
}

static bool before(const pliant_touching *a, const pliant_touching *b) { return a->deep != b->deep ? a->deep < b->deep : a->skin < b->skin; }

/* From inside the shortest way out alone, and that before any other; from outside what bounds the node's way, each direction once. */
static void keep(const finding *on, int32_t index, pliant_touching *one)
{
    pliant_tissue *tissue = on->tissue;
    const bool beside = !faces(on, index, one->skin); /* of blocks that lie flush, the walls of one are at the border of the other */
    pliant_touching *list = tissue->touching + PLIANT_TOUCHINGS * (size_t)index;
    int32_t count = tissue->count[index], at;
    const double surface = 10 * border * tissue->shortest; /* what lies in it is inside, with no way to go */
    const bool inside = count > 0 && list[0].gap < surface;
    one->deep = fabs(one->gap) + (beside ? on->rule->margin : 0);
    if (beside && one->gap >= surface) return;
    if (inside && (one->gap >= surface || !before(one, list))) return;
    if (inside || one->gap < surface) {
        list[0] = *one;
        tissue->count[index] = 1;
        return;
    }
    for (int32_t n = 0; n < count; n++)
        if (dot(tissue->normal[list[n].skin], tissue->normal[one->skin]) > alike) {
            if (before(one, list + n)) list[n] = *one;
            return;
        }
    if (count < PLIANT_TOUCHINGS) tissue->count[index]++;
    else if (!before(one, list + count - 1)) return;
    for (at = tissue->count[index] - 1; at > 0 && before(one, list + at - 1); at--) list[at] = list[at - 1];
    list[at] = *one;
}

static void try_skin(const finding *on, int32_t index, int32_t skin)
{
    const pliant_tissue *tissue = on->tissue;
    const int32_t node = tissue->node[index], tet = tissue->skin[skin].tet;
    const double *point = place_of(on, node);
    pliant_touching one = {.skin = skin};
    if (!look_down(on, skin, point, one.weight, &one.gap) || !(one.gap <= margin_of(on, node, skin))) return;
    if (one.weight[0] < -border || one.weight[1] < -border || one.weight[2] < -border) return;
    if (is_near(on, index, tet) || !can_move(on, node, skin)) return;
    if (one.gap < 0) {
        const int32_t holder = walk(on, tet, point);
        if (holder < 0 || is_near(on, index, holder)) return;
    }
    keep(on, index, &one);
}

/* The triangle under a point, from one near it over its neighbours. */
static int32_t slide(const finding *on, int32_t skin, const double point[3])
{
    double weight[3], gap;
    for (int way = 0; way < MOST_WAY; way++) {
        int least = 0;
        if (!look_down(on, skin, point, weight, &gap)) return skin;
        for (int v = 1; v < 3; v++)
            if (weight[v] < weight[least]) least = v;
        if (!(weight[least] < -border)) return skin;
        const int32_t beside = on->tissue->skin[skin].beside[(least + 1) % 3]; /* the edge opposite that corner */
        if (beside < 0) return skin;
        skin = beside;
    }
    return skin;
}

static void search_node(const finding *on, int32_t index)
{
    pliant_tissue *tissue = on->tissue;
    const pliant_grid *grid = &tissue->grid;
    const double *point = place_of(on, tissue->node[index]);
    const int64_t cell = pliant_grid_cell(grid, point);
    tissue->count[index] = 0;
    for (int32_t k = cell < 0 ? 0 : grid->start[cell]; cell >= 0 && k < grid->start[cell + 1]; k++) {
        const int32_t i = grid->item[k];
        const pliant_grid_box *box = grid->box + i;
        if (!(point[0] >= box->low[0] && point[0] <= box->high[0] && point[1] >= box->low[1] && point[1] <= box->high[1] && point[2] >= box->low[2] &&
              point[2] <= box->high[2]))
            continue;
        for (int32_t s = tissue->skin_start[i]; s < tissue->skin_start[i + 1]; s++) try_skin(on, index, s);
    }
    if (tissue->last[index] >= 0 && tissue->count[index] == 0) try_skin(on, index, slide(on, tissue->last[index], point)); /* deep inside */
}

/* ---- what lay deep inside before it was seen */

static int32_t index_of(const pliant_tissue *tissue, int32_t node)
{
    int32_t low = 0, high = tissue->num_nodes;
    while (low < high) {
        const int32_t middle = low + (high - low) / 2;
        if (tissue->node[middle] < node) low = middle + 1;
        else high = middle;
    }
    return low < tissue->num_nodes && tissue->node[low] == node ? low : -1;
}

/* A node that lies in the tetrahedra that a walk from one leads to: the shortest way out of them, over all triangles. It is kept up from then on. */
static void try_deep(const finding *on, int32_t index, int32_t tet)
{
    const pliant_tissue *tissue = on->tissue;
    const double *point = place_of(on, tissue->node[index]);
    const int32_t holder = walk(on, tet, point);
    if (holder < 0 || is_near(on, index, holder)) return;
    pliant_touching best = {.skin = -1, .gap = -INFINITY};
    for (int32_t s = 0; s < tissue->num_skins; s++) {
        pliant_touching one = {.skin = s};
        if (!look_down(on, s, point, one.weight, &one.gap) || !(one.gap < 0 && one.gap > best.gap)) continue;
        if (one.weight[0] < -border || one.weight[1] < -border || one.weight[2] < -border) continue;
        if (can_move(on, tissue->node[index], s) && walk(on, tissue->skin[s].tet, point) == holder) best = one;
    }
    if (best.skin >= 0) keep(on, index, &best);
}

static int32_t grid_index(const pliant_tissue *tissue, int32_t tet)
{
    int32_t low = 0, high = tissue->num_tets - 1;
    while (low < high) {
        const int32_t middle = low + (high - low) / 2;
        if (tissue->tet[middle] < tet) low = middle + 1;
        else high = middle;
    }
    return low;
}

static void try_pair(const finding *on, int32_t of, int32_t in)
{
    const pliant_tissue *tissue = on->tissue;
    for (int v = 0; v < 4; v++) {
        const int32_t index = index_of(tissue, tissue->body->fine.tets[4 * (size_t)of + (size_t)v]);
        if (index >= 0 && tissue->count[index] == 0) try_deep(on, index, in);
    }
}

/* Nodes all around which is inside, from those beside them that are; in the order of their numbers, until there are no more. */
static void spread(const finding *on)
{
    const pliant_tissue *tissue = on->tissue;
    for (bool more = true; more;) {
        more = false;
        for (int32_t n = 0; n < tissue->num_nodes; n++) {
            if (tissue->count[n] > 0) continue;
            for (int32_t a = tissue->around_start[n]; a < tissue->around_start[n + 1] && tissue->count[n] == 0; a++) {
                const int32_t beside = index_of(tissue, tissue->around[a]);
                const pliant_touching *one = tissue->touching + PLIANT_TOUCHINGS * (size_t)beside;
                if (tissue->count[beside] > 0 && one->gap < -farthest * tissue->shortest) try_deep(on, n, tissue->skin[one->skin].tet);
            }
            more = more || tissue->count[n] > 0;
        }
    }
}

/* ---- points */

static pliant_contact_point *append(pliant_contacts *out)
{
    if (out->count == out->room) {
        const int32_t room = 2 * out->room + 64;
        pliant_contact_point *more = pliant_resize(out->point, (size_t)room, sizeof *more);
        if (!more) return NULL;
        out->point = more;
        out->room = room;
    }
    pliant_contact_point *point = out->point + out->count++;
    *point = (pliant_contact_point){.kind = PLIANT_OBSTACLE_TISSUE, .tool = -1, .part = -1};
    return point;
}

/* As far out as a step may bring it. */
static void set_place(pliant_contact_point *point, double gap, const pliant_tissue_rule *rule)
{
    const double left = fmin(gap + rule->recovery, 0);
    for (int d = 0; d < 3; d++) point->place[d] = left * point->normal[d];
}

static pliant_status tell_nodes(const finding *on, pliant_contacts *out)
{
    pliant_tissue *tissue = on->tissue;
    for (int32_t n = 0; n < tissue->num_nodes; n++) {
        const pliant_touching *list = tissue->touching + PLIANT_TOUCHINGS * (size_t)n;
        tissue->last[n] = tissue->count[n] > 0 ? list[0].skin : -1;
        for (int32_t k = 0; k < tissue->count[n]; k++) {
            const pliant_skin *skin = tissue->skin + list[k].skin;
            pliant_contact_point *point = append(out);
            if (!point) return pliant_fail_memory("contacts of tissue with tissue");
            point->feature = (uint64_t)PLIANT_TISSUE_NODE << 56 | (uint64_t)tissue->node[n] << 2 | (uint64_t)k;
            point->node[0] = tissue->node[n];
            point->weight[0] = 1;
            point->count = 1;
            for (int v = 0; v < 3; v++) {
                const double weight = fmax(list[k].weight[v], 0) / (fmax(list[k].weight[0], 0) + fmax(list[k].weight[1], 0) + fmax(list[k].weight[2], 0));
                point->node[point->count] = skin->node[v];
                point->weight[point->count++] = -weight;
            }
            memcpy(point->normal, tissue->normal[list[k].skin], sizeof point->normal);
            point->area = tissue->area[n];
            point->friction = on->rule->friction;
            set_place(point, list[k].gap, on->rule);
        }
    }
    return PLIANT_OK;
}

/* ---- edges that cross */

/* whether a node of it is in what it touches */
static bool touches_any(const finding *on, int32_t tet)
{
    const pliant_tissue *tissue = on->tissue;
    for (int v = 0; v < 4; v++) {
        const int32_t index = index_of(tissue, tissue->body->fine.tets[4 * (size_t)tet + (size_t)v]);
        if (index >= 0 && tissue->count[index] > 0 && tissue->touching[PLIANT_TOUCHINGS * (size_t)index].gap < 0) return true;
    }
    return false;
}

/* The mean of the normals on both sides. false: there is no edge to speak of */
static bool edge_normal(const pliant_tissue *tissue, int32_t skin, int edge, double out[3])
{
    const int32_t beside = tissue->skin[skin].beside[edge];
    for (int d = 0; d < 3; d++) out[d] = tissue->normal[skin][d] + (beside >= 0 ? tissue->normal[beside][d] : 0);
    return beside < 0 || dot(tissue->normal[skin], tissue->normal[beside]) < blunt;
}

/* whether a point, seen from the edge, is below both triangles */
static bool is_below(const pliant_tissue *tissue, int32_t skin, int edge, const double to[3])
{
    const int32_t beside = tissue->skin[skin].beside[edge];
    return dot(to, tissue->normal[skin]) < 0 && (beside < 0 || dot(to, tissue->normal[beside]) < 0);
}

/* the lower of an edge's two triangles, and which of its edges it is */
static uint64_t edge_number(const pliant_tissue *tissue, int32_t skin, int edge)
{
    const int32_t beside = tissue->skin[skin].beside[edge];
    if (beside < 0 || beside > skin) return 3 * (uint64_t)skin + (uint64_t)edge;
    for (int k = 0; k < 3; k++)
        if (tissue->skin[beside].beside[k] == skin && tissue->skin[beside].node[k] == tissue->skin[skin].node[(edge + 1) % 3])
            return 3 * (uint64_t)beside + (uint64_t)k;
    return 3 * (uint64_t)skin + (uint64_t)edge;
}

static pliant_status cross_edges(const finding *on, int32_t a, int i, int32_t b, int j, pliant_contacts *out)
{
    const pliant_tissue *tissue = on->tissue;
    const int32_t *mine = tissue->skin[a].node, *other = tissue->skin[b].node;
    const int32_t node[4] = {mine[i], mine[(i + 1) % 3], other[j], other[(j + 1) % 3]};
    double u[3], w[3], to[3], normal[3], side[3], outwards[2][3];
    between(place_of(on, node[0]), place_of(on, node[1]), u);
    between(place_of(on, node[2]), place_of(on, node[3]), w);
    between(place_of(on, node[2]), place_of(on, node[0]), to);
    cross(u, w, normal);
    const double square = dot(normal, normal);
    if (!(square > 1e-4 * dot(u, u) * dot(w, w))) return PLIANT_OK;
    cross(w, to, side);
    const double s = dot(side, normal) / square; /* of the way along each, where they are nearest */
    cross(u, to, side);
    const double t = dot(side, normal) / square;
    if (!(s > 0 && s < 1 && t > 0 && t < 1)) return PLIANT_OK;
    if (!edge_normal(tissue, a, i, outwards[0]) || !edge_normal(tissue, b, j, outwards[1])) return PLIANT_OK;
    const double sign = dot(normal, outwards[1]) > 0 ? 1 : -1;
    for (int d = 0; d < 3; d++) normal[d] *= sign / sqrt(square);
    const double gap = dot(to, normal);
    double across[2][3];
    for (int d = 0; d < 3; d++) {
        across[0][d] = place_of(on, node[0])[d] + s * u[d] - place_of(on, node[2])[d];
        across[1][d] = place_of(on, node[2])[d] + t * w[d] - place_of(on, node[0])[d];
    }
    if (!is_below(tissue, b, j, across[0]) || !is_below(tissue, a, i, across[1])) return PLIANT_OK;
    if (!(gap < 0 && gap > -farthest * tissue->shortest) || !(dot(normal, outwards[0]) < 0) || !(dot(normal, outwards[1]) > 0)) return PLIANT_OK;
    if (piece_of(on, node[0]) >= 0 && piece_of(on, node[0]) == piece_of(on, node[2])) return PLIANT_OK;
    if (is_fixed(on, node[0]) && is_fixed(on, node[1]) && is_fixed(on, node[2]) && is_fixed(on, node[3])) return PLIANT_OK;
    pliant_contact_point *point = append(out);
    if (!point) return pliant_fail_memory("contacts of tissue with tissue");
    const double weight[4] = {1 - s, s, t - 1, -t};
    const uint64_t first = edge_number(tissue, a, i), second = edge_number(tissue, b, j);
    const bool turned = first > second; /* the lower one is pushed, whoever was found first */
    point->feature = (uint64_t)PLIANT_TISSUE_EDGE << 56 | (turned ? second : first) << 28 | (turned ? first : second);
    point->count = 4;
    for (int v = 0; v < 4; v++) {
        point->node[v] = node[turned ? (v + 2) % 4 : v];
        point->weight[v] = turned ? -weight[(v + 2) % 4] : weight[v];
    }
    for (int d = 0; d < 3; d++) point->normal[d] = turned ? -normal[d] : normal[d];
    point->area = 0.25 * (sqrt(dot(u, u) * dot(w, w)));
    point->friction = on->rule->friction;
    set_place(point, gap, on->rule);
    return PLIANT_OK;
}

static int compare_points(const void *a, const void *b)
{
    const uint64_t x = ((const pliant_contact_point *)a)->feature, y = ((const pliant_contact_point *)b)->feature;
    return (x > y) - (x < y);
}

static pliant_status tell_edges(const finding *on, pliant_contacts *out)
{
    const pliant_tissue *tissue = on->tissue;
    const int32_t first = out->count;
    for (int c = 0; c < PLIANT_GRID_CHUNKS; c++) {
        const pliant_grid_pairs *found = tissue->grid.found + c;
        for (int32_t p = 0; p < found->count; p++) {
            const int32_t *pair = found->pair + 2 * (size_t)p;
            if (touches_any(on, pair[0]) || touches_any(on, pair[1])) continue;
            const int32_t a = grid_index(tissue, pair[0]), b = grid_index(tissue, pair[1]);
            for (int32_t i = 3 * tissue->skin_start[a]; i < 3 * tissue->skin_start[a + 1]; i++)
                for (int32_t j = 3 * tissue->skin_start[b]; j < 3 * tissue->skin_start[b + 1]; j++) {
                    pliant_status status = cross_edges(on, i / 3, i % 3, j / 3, j % 3, out);
                    if (status != PLIANT_OK) return status;
                }
        }
    }
    if (out->count == first) return PLIANT_OK;
    qsort(out->point + first, (size_t)(out->count - first), sizeof *out->point, compare_points);
    int32_t kept = first;
    for (int32_t n = first; n < out->count; n++)
        if (n == first || out->point[n].feature != out->point[kept - 1].feature) out->point[kept++] = out->point[n];
    out->count = kept;
    return PLIANT_OK;
}

/* ---- all of them */

static pliant_status tell_faces(const finding *on, pliant_contacts *out)
{
    const pliant_tissue *tissue = on->tissue;
    for (int32_t f = 0; f < tissue->num_faces; f++) {
        const int32_t *tets = tissue->body->fine.tets, *tet = tissue->face[f].tet, piece = piece_of(on, tets[4 * (size_t)tet[0]]);
        if (piece >= 0 && piece == piece_of(on, tets[4 * (size_t)tet[1]])) continue;
        pliant_contact_point *point = append(out);
        if (!point) return pliant_fail_memory("contacts of tissue with tissue");
        point->feature = (uint64_t)PLIANT_TISSUE_CUT << 56 | (uint64_t)tissue->face[f].tet[0] << 28 | (uint64_t)tissue->face[f].tet[1];
        point->friction = on->rule->friction;
        if (!pliant_cut_face_point(tissue->body, tissue->face + f, on->positions, on->rule, point)) out->count--;
    }
    return PLIANT_OK;
}

/* What two nodes may come nearer in a step, by the one before: a step that begins apart must not end deep inside. At most the shortest edge. */
static double find_margin(const pliant_tissue *tissue, const double *positions, double margin)
{
    double mean[3] = {0, 0, 0}, most = 0;
    if (!tissue->has_place) return margin;
    for (int pass = 0; pass < 2; pass++)
        for (int32_t n = 0; n < tissue->num_nodes; n++) {
            double square = 0;
            for (int d = 0; d < 3; d++) {
                const double way = positions[3 * (size_t)tissue->node[n] + (size_t)d] - tissue->place[3 * (size_t)n + (size_t)d];
                if (!pass) mean[d] += way / tissue->num_nodes;
                else square += (way - mean[d]) * (way - mean[d]);
            }
            most = fmax(most, square);
        }
    return fmin(margin + 2 * sqrt(most), fmax(margin, tissue->shortest));
}

static void keep_places(pliant_tissue *tissue, const double *positions)
{
    for (int32_t n = 0; n < tissue->num_nodes; n++) memcpy(tissue->place + 3 * (size_t)n, positions + 3 * (size_t)tissue->node[n], 3 * sizeof *positions);
    tissue->has_place = true;
}

pliant_status pliant_tissue_find(pliant_tissue *tissue, const double *positions, const pliant_tissue_rule *given, pliant_contacts *out)
{
    const pliant_tissue_rule moving = {find_margin(tissue, positions, given->margin), given->recovery, given->friction, given->pieces_go},
                             *rule = &moving;
    const finding on = {.tissue = tissue, .positions = positions, .rule = rule};
    const pliant_mesh *mesh = &tissue->body->fine;
    const int32_t before_all = out->count;
    pliant_status status = pliant_grid_fill(&tissue->grid, tissue->num_tets, tissue->tet, mesh->tets, positions, fmax(rule->margin, rule->pieces_go), tissue->threads);
    if (status == PLIANT_OK) status = pliant_grid_overlaps(&tissue->grid, mesh->tets, positions, tissue->threads, &tissue->num_overlaps);
    if (status != PLIANT_OK) return status;
    find_normals(&on);
#pragma omp parallel for schedule(dynamic, 64) num_threads(tissue->threads)
    for (int32_t n = 0; n < tissue->num_nodes; n++) search_node(&on, n);
    for (int c = 0; c < PLIANT_GRID_CHUNKS; c++)
        for (int32_t p = 0; p < tissue->grid.found[c].count; p++) {
            const int32_t *pair = tissue->grid.found[c].pair + 2 * (size_t)p;
            try_pair(&on, pair[0], pair[1]);
            try_pair(&on, pair[1], pair[0]);
        }
    if (tissue->num_overlaps > 0) spread(&on);
    status = tell_nodes(&on, out);
    if (status == PLIANT_OK) status = tell_edges(&on, out);
    if (status == PLIANT_OK) status = tell_faces(&on, out);
    if (status == PLIANT_OK) keep_places(tissue, positions);
    else out->count = before_all;
    return status;
}
