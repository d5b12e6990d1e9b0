/* Compute the triangles of one initial tetrahedron: between its fragments, and on its faces without neighbour. */
#include "topology/surface.h"
#include "mesh/faces.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

enum { OUTSIDE, CUT };

/* One of the small tetrahedra of a host: lattice coordinates and fragments of its corners, and crossings of its
 * edges. */
typedef struct small_tet {
    int32_t at[4][4], label[4];
    double along[4][4];        /* fraction from the first of the two corners; < 0: not crossed */
} small_tet;

/* A line on a face, seen from outside, with one corner on its left and another one on its right. */
typedef struct parting { surface_point from, to; int left, right; } parting;

/* ---- points */

static void mean_of(const surface_point *const *points, int count, surface_point *out)
{
    memset(out->fraction, 0, sizeof out->fraction);
    for (int n = 0; n < count; n++)
        for (int v = 0; v < 4; v++) out->fraction[v] += points[n]->fraction[v] / count;
}

static surface_point corner_point(const surface_maker *maker, const int32_t at[4])
{
    surface_point out;
    for (int v = 0; v < 4; v++) {
        out.weight[v] = SURFACE_WEIGHT_DIVISOR * at[v];
        out.fraction[v] = (double)at[v] / maker->parts;
    }
    return out;
}

static surface_point crossing_point(const surface_maker *maker, const int32_t a[4], const int32_t b[4], double along)
{
    surface_point out;
    for (int v = 0; v < 4; v++) {
        out.weight[v] = SURFACE_WEIGHT_DIVISOR / 2 * (a[v] + b[v]);
        out.fraction[v] = (a[v] + along * (b[v] - a[v])) / maker->parts;
    }
    return out;
}

static surface_point crossing_of(const surface_maker *maker, const small_tet *tet, int a, int b)
{
    return crossing_point(maker, tet->at[a], tet->at[b], tet->along[a][b]);
}

/* Return the centre of a face with three crossed edges. */
static surface_point middle_of_face(const surface_maker *maker, const small_tet *tet, const int corner[3])
{
    surface_point edge[3], out;
    for (int e = 0; e < 3; e++) edge[e] = crossing_of(maker, tet, corner[e], corner[(e + 1) % 3]);
    mean_of((const surface_point *[]){edge, edge + 1, edge + 2}, 3, &out);
    for (int v = 0; v < 4; v++)
        out.weight[v] =
            SURFACE_WEIGHT_DIVISOR / 3 * (tet->at[corner[0]][v] + tet->at[corner[1]][v] + tet->at[corner[2]][v]);
    return out;
}

static surface_point middle_of_tet(const surface_maker *maker, const small_tet *tet)
{
    surface_point edge[6], out;
    const surface_point *crossed[6];
    int count = 0;
    for (int a = 0; a < 4; a++)
        for (int b = a + 1; b < 4; b++) {
            if (tet->along[a][b] < 0) continue;
            edge[count] = crossing_of(maker, tet, a, b);
            crossed[count] = edge + count;
            count++;
        }
    mean_of(crossed, count, &out);
    for (int v = 0; v < 4; v++)
        out.weight[v] = SURFACE_WEIGHT_DIVISOR / 4 * (tet->at[0][v] + tet->at[1][v] + tet->at[2][v] + tet->at[3][v]);
    return out;
}

/* ---- triangles */

/* Add a point that moves with a fragment of a host; -1: out of memory. */
static int32_t add_vertex(surface_maker *maker, int32_t host, int32_t fragment, const surface_point *point)
{
    surface_vertex vertex;
    pliant_surface_key_of(maker->body->fine.tets + 4 * (size_t)fragment, point->weight, &vertex.key);
    const int32_t number = pliant_surface_number(&maker->vertices, &vertex.key);
    if (number < 0 || (size_t)number < maker->made.count) return number;
    surface_vertex *added = pliant_surface_add(&maker->made);
    if (!added) return -1;
    vertex.tet = fragment;
    memcpy(vertex.weight, point->fraction, sizeof vertex.weight);
    /* a node may belong to several materials, so it has none */
    vertex.material = vertex.key.weight[1] == 0 ? 0 : pliant_surface_material(maker, host, fragment, point->fraction);
    *added = vertex;
    return number;
}

static bool add_triangle(surface_maker *maker, int list, int32_t host, int32_t fragment, const surface_point *a,
                         const surface_point *b, const surface_point *c)
{
    const int32_t vertex[3] = {add_vertex(maker, host, fragment, a), add_vertex(maker, host, fragment, b),
                               add_vertex(maker, host, fragment, c)};
    if (vertex[0] < 0 || vertex[1] < 0 || vertex[2] < 0) return false;
    if (vertex[0] == vertex[1] || vertex[1] == vertex[2] || vertex[2] == vertex[0]) return true;
    int32_t *added = pliant_surface_add(&maker->triangles[list]);
    if (added) memcpy(added, vertex, sizeof vertex);
    return added != NULL;
}

/* Add a polygon as a fan around its first point. */
static bool add_polygon(surface_maker *maker, int list, int32_t host, int32_t fragment, const surface_point *point,
                        int count, bool turned)
{
    bool good = true;
    for (int n = 1; good && n + 1 < count; n++)
        good = add_triangle(maker, list, host, fragment, point, point + (turned ? n + 1 : n),
                            point + (turned ? n : n + 1));
    return good;
}

/* ---- between fragments */

/* Find the lines between the crossed edges of a face. With three crossings, each is connected to the centre; with two,
 * they are connected directly. Return whether there are three. */
static bool find_partings(const surface_maker *maker, const small_tet *tet, const int corner[3], parting *out,
                          int *count)
{
    bool crossed[3];
    int times = 0;
    for (int e = 0; e < 3; e++) times += crossed[e] = !(tet->along[corner[e]][corner[(e + 1) % 3]] < 0);
    for (int e = 0; e < 3; e++) {
        const int p = corner[e], q = corner[(e + 1) % 3], r = corner[(e + 2) % 3];
        if (times < 2 || (times == 2 && crossed[(e + 1) % 3])) continue;
        const surface_point to = times == 3 ? middle_of_face(maker, tet, corner) : crossing_of(maker, tet, r, p);
        out[(*count)++] = (parting){crossing_of(maker, tet, p, q), to, p, q};
    }
    return times == 3;
}

/* Add the surface within a small tetrahedron. It connects the lines on the faces to the centre, or to one point of the
 * ring if the lines form one flat ring. */
static bool add_cut(surface_maker *maker, int32_t host, const small_tet *tet)
{
    parting lines[12];
    int count = 0;
    bool branches = false, good = true;
    for (int f = 0; f < 4; f++) branches |= find_partings(maker, tet, pliant_face_corners[f], lines, &count);
    if (count == 0) return true;
    const surface_point middle = branches ? middle_of_tet(maker, tet) : lines[0].from;
    for (int n = 0; good && n < count; n++) {
        const int32_t left = tet->label[lines[n].left], right = tet->label[lines[n].right];
        if (left == right) continue;
        good = add_triangle(maker, CUT, host, left, &lines[n].to, &lines[n].from, &middle) &&
               add_triangle(maker, CUT, host, right, &lines[n].from, &lines[n].to, &middle);
    }
    return good;
}

/* ---- faces of the host */

/* A face of a host and the neighbour across it. It maps points of the host to the neighbour's corners. */
typedef struct host_face {
    int32_t host, other;       /* other -1: no neighbour */
    int opposite, corner[4];   /* corner[v]: the neighbour's corner for corner v of the host; for v == opposite: -1 */
} host_face;

static void find_face(const surface_maker *maker, int32_t host, int opposite, host_face *out)
{
    int32_t own[4], others[4] = {-1, -1, -1, -1};
    *out = (host_face){host, maker->voxels->across[4 * (size_t)host + (size_t)opposite], opposite, {-1, -1, -1, -1}};
    if (out->other < 0) return;
    pliant_surface_corners(maker, host, own);
    pliant_surface_corners(maker, out->other, others);
    for (int v = 0; v < 4; v++)
        for (int w = 0; v != opposite && w < 4; w++)
            if (own[v] == others[w]) out->corner[v] = w;
}

static const surface_block *split_block(const surface_maker *maker, int32_t host)
{
    return maker->block[host] && maker->block[host]->split ? maker->block[host] : NULL;
}

/* Return whether two fragments have the same nodes on a face. */
static bool have_same_face_nodes(const surface_maker *maker, const host_face *face, int32_t own, int32_t other)
{
    const int32_t *tets = maker->body->fine.tets;
    for (int v = 0; v < 4; v++)
        if (v != face->opposite &&
            tets[4 * (size_t)own + (size_t)v] != tets[4 * (size_t)other + (size_t)face->corner[v]])
            return false;
    return true;
}

/* Add a polygon of a host's face that belongs to a fragment. If the neighbour's fragment is not connected there, the
 * polygon is surface. A neighbour that is not refined does not add its own side, so both sides are added.
 * at: a lattice point of the polygon */
static bool add_piece(surface_maker *maker, const host_face *face, int32_t fragment, const int32_t at[4],
                      const surface_point *point, int count)
{
    if (face->other < 0) return add_polygon(maker, OUTSIDE, face->host, fragment, point, count, false);
    const surface_block *other = split_block(maker, face->other);
    int32_t there[4] = {0, 0, 0, 0};
    for (int v = 0; v < 4; v++)
        if (v != face->opposite) there[face->corner[v]] = at[v];
    const int32_t across = other ? other->label[pliant_surface_place(there)] : face->other;
    if (have_same_face_nodes(maker, face, fragment, across)) return true;
    if (!add_polygon(maker, CUT, face->host, fragment, point, count, false)) return false;
    if (other) return true;
    surface_point turned[4];
    for (int n = 0; n < count; n++) {
        turned[n] = (surface_point){{0}, {0}};
        for (int v = 0; v < 4; v++) {
            if (v == face->opposite) continue;
            turned[n].weight[face->corner[v]] = point[n].weight[v];
            turned[n].fraction[face->corner[v]] = point[n].fraction[v];
        }
    }
    return add_polygon(maker, CUT, face->other, face->other, turned, count, true);
}

/* Add the face of a small tetrahedron that lies on a face of the host, divided at its crossed edges. */
static bool add_small_face(surface_maker *maker, const host_face *face, const small_tet *tet, const int corner[3])
{
    const int32_t(*at)[4] = tet->at, *label = tet->label;
    int times = 0, first = 0;
    bool crossed[3], good = true;
    for (int e = 0; e < 3; e++) times += crossed[e] = !(tet->along[corner[e]][corner[(e + 1) % 3]] < 0);
    /* p: common end of two crossed edges, or the first end of one */
    for (int e = 0; e < 3; e++)
        if ((times == 1 && crossed[e]) || (times == 2 && !crossed[(e + 1) % 3])) first = e;
    const int p = corner[first], q = corner[(first + 1) % 3], r = corner[(first + 2) % 3];
    const surface_point own[3] = {corner_point(maker, at[p]), corner_point(maker, at[q]), corner_point(maker, at[r])};
    if (times == 0) return add_piece(maker, face, label[p], at[p], own, 3);
    const surface_point pq = crossing_of(maker, tet, p, q);
    if (times == 1) return add_piece(maker, face, label[p], at[p], (surface_point[]){own[2], own[0], pq, own[1]}, 4);
    const surface_point rp = crossing_of(maker, tet, r, p);
    if (times == 2)
        return add_piece(maker, face, label[p], at[p], (surface_point[]){own[0], pq, rp}, 3) &&
               add_piece(maker, face, label[q], at[q], (surface_point[]){pq, own[1], own[2], rp}, 4);
    const surface_point middle = middle_of_face(maker, tet, corner), edge[3] = {pq, crossing_of(maker, tet, q, r), rp};
    const int all[3] = {p, q, r};
    for (int e = 0; good && e < 3; e++)
        good = add_piece(maker, face, label[all[e]], at[all[e]],
                         (surface_point[]){own[e], edge[e], middle, edge[(e + 2) % 3]}, 4);
    return good;
}

/* ---- refined hosts */

static bool add_small(surface_maker *maker, int32_t host, const host_face face[4], small_tet *tet)
{
    bool any = false, good = true;
    for (int a = 0; a < 4; a++)
        for (int b = a + 1; b < 4; b++) {
            tet->along[a][b] = pliant_surface_crossing(maker, host, tet->at[a], tet->at[b]);
            if (isnan(tet->along[a][b])) return false;
            tet->along[b][a] = tet->along[a][b] < 0 ? -1 : 1 - tet->along[a][b];
            any |= tet->label[a] != tet->label[b];
        }
    if (any) good = add_cut(maker, host, tet);
    for (int f = 0; good && f < 4; f++)
        for (int v = 0; good && v < 4; v++) {
            const int *corner = pliant_face_corners[f];
            if (tet->at[corner[0]][v] + tet->at[corner[1]][v] + tet->at[corner[2]][v] == 0)
                good = add_small_face(maker, face + v, tet, corner);
        }
    return good;
}

/* Compute the small tetrahedra: in every cube of the lattice x1 >= x2 >= x3, the paths along its edges from the lowest
 * to the highest corner. */
static bool fill_split(surface_maker *maker, const surface_block *block)
{
    /* the last three have the opposite orientation */
    static const int paths[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
    const int parts = maker->parts;
    host_face face[4];
    for (int v = 0; v < 4; v++) find_face(maker, block->host, v, face + v);
    for (int cube = 0; cube < parts * parts * parts; cube++)
        for (int path = 0; path < 6; path++) {
            int32_t x[3] = {cube % parts, cube / parts % parts, cube / parts / parts};
            small_tet tet;
            bool inside = true;
            for (int c = 0; c < 4; c++) {
                const int to = path < 3 || c < 2 ? c : 5 - c;
                if (c > 0) x[paths[path][c - 1]]++;
                inside = inside && x[0] <= parts && x[0] >= x[1] && x[1] >= x[2];
                if (!inside) break;
                memcpy(tet.at[to], (int32_t[4]){parts - x[0], x[0] - x[1], x[1] - x[2], x[2]}, sizeof tet.at[to]);
                tet.label[to] = block->label[pliant_surface_place(tet.at[to])];
            }
            if (inside && !add_small(maker, block->host, face, &tet)) return false;
        }
    return true;
}

/* ---- other hosts */

/* Collect the points on an edge of a refined neighbour, from corner a (included) to corner b (excluded). Return their
 * number; -1: out of memory. */
static int points_along(surface_maker *maker, int32_t host, int a, int b, surface_point *out)
{
    int32_t corner[4];
    int count = 0;
    pliant_surface_corners(maker, host, corner);
    const bool refined = pliant_surface_is_refined(maker, corner[a], corner[b]);
    for (int n = 0; n < (refined ? maker->parts : 1); n++) {
        int32_t at[4] = {0, 0, 0, 0}, next[4] = {0, 0, 0, 0};
        at[a] = maker->parts - n;
        at[b] = n;
        next[a] = at[a] - 1;
        next[b] = n + 1;
        out[count++] = corner_point(maker, at);
        const double along = refined ? pliant_surface_crossing(maker, host, at, next) : -1;
        if (isnan(along)) return -1;
        if (!(along < 0)) out[count++] = crossing_point(maker, at, next, along);
    }
    return count;
}

static bool fill_whole(surface_maker *maker, const surface_block *block)
{
    for (int v = 0; v < 4; v++) {
        surface_point around[6 * SURFACE_MAX_PARTS + 1], middle = {{0}, {0}};
        host_face face;
        int count = 0;
        find_face(maker, block->host, v, &face);
        if (face.other >= 0 &&
            (split_block(maker, face.other) || have_same_face_nodes(maker, &face, block->host, face.other)))
            continue;
        const int list = face.other < 0 ? OUTSIDE : CUT;
        for (int e = 0; e < 3; e++) {
            const int more = points_along(maker, block->host, pliant_face_corners[v][e],
                                          pliant_face_corners[v][(e + 1) % 3], around + count);
            if (more < 0) return false;
            count += more;
            middle.weight[pliant_face_corners[v][e]] = SURFACE_WEIGHT_DIVISOR / 3 * maker->parts;
            middle.fraction[pliant_face_corners[v][e]] = 1.0 / 3;
        }
        around[count] = around[0];
        if (count == 3 && !add_polygon(maker, list, block->host, block->host, around, 3, false)) return false;
        for (int n = 0; count > 3 && n < count; n++)
            if (!add_triangle(maker, list, block->host, block->host, around + n, around + n + 1, &middle)) return false;
    }
    return true;
}

pliant_status pliant_surface_fill(surface_maker *maker, surface_block *block)
{
    pliant_surface_map_clear(&maker->vertices);
    maker->made.count = maker->triangles[OUTSIDE].count = maker->triangles[CUT].count = 0;
    if (!(block->split ? fill_split(maker, block) : fill_whole(maker, block))) return pliant_surface_no_memory();
    const size_t outer = maker->triangles[OUTSIDE].count, cut = maker->triangles[CUT].count;
    if (outer + cut == 0) return PLIANT_OK;
    block->vertex = pliant_calloc(maker->made.count, sizeof *block->vertex);
    block->triangle = pliant_calloc(outer + cut, 3 * sizeof *block->triangle);
    if (!block->vertex || !block->triangle) return pliant_surface_no_memory();
    memcpy(block->vertex, maker->made.at, maker->made.count * sizeof *block->vertex);
    if (outer > 0) memcpy(block->triangle, maker->triangles[OUTSIDE].at, 3 * outer * sizeof *block->triangle);
    if (cut > 0) memcpy(block->triangle + 3 * outer, maker->triangles[CUT].at, 3 * cut * sizeof *block->triangle);
    block->num_vertices = (int32_t)maker->made.count;
    block->num_outer = (int32_t)outer;
    block->num_cut = (int32_t)cut;
    return PLIANT_OK;
}
