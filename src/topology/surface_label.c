/* Find the fragments of a refined tetrahedron's lattice points, and the crossings on its edges, from the voxels. */
#include "base/matrix.h"
#include "topology/surface.h"

#include <math.h>
#include <string.h>

/* Maximum search distance around a point [voxels]. If no voxel is found, all voxels of the tetrahedron are searched. */
enum { MAX_DISTANCE = 3 };
/* Number of sample points on an edge, and number of plane fits. The plane separates the voxels within this distance
 * [voxels]. */
enum { PLACES = 8, FITS = 2 };
static const double around = 2.5;
/* minimum distance of a crossing from an end, as a fraction of the edge */
static const double min_share = 0.05;

/* Voxels of a search: in all tetrahedra with `count` given initial nodes, or in a host's fragments with given current
 * nodes. */
typedef struct surface_search {
    int32_t host;              /* -1: any tetrahedron with the nodes */
    int count;
    int32_t node[4];
    int corner[4];             /* corners of the host */
    int32_t fragment;          /* only this fragment of the host; -1: any with the nodes */
} surface_search;

void pliant_surface_corners(const surface_maker *maker, int32_t host, int32_t out[4])
{
    for (int v = 0; v < 4; v++)
        out[v] = pliant_surface_load_node(maker, maker->body->fine.tets[4 * (size_t)host + (size_t)v]);
}

static const int32_t *nodes_of(const surface_maker *maker, int32_t tet)
{
    return maker->body->fine.tets + 4 * (size_t)tet;
}

static bool same_nodes(const surface_maker *maker, int32_t a, int32_t b)
{
    return memcmp(nodes_of(maker, a), nodes_of(maker, b), 4 * sizeof(int32_t)) == 0;
}

bool pliant_surface_is_split(const surface_maker *maker, int32_t host)
{
    const int32_t cut = maker->cut_of[host];
    for (int32_t f = cut < 0 ? 0 : maker->cuts->start[cut] + 1; cut >= 0 && f < maker->cuts->start[cut + 1]; f++)
        if (!same_nodes(maker, maker->cuts->fragment[f], host)) return true;
    return false;
}

/* Return the first fragment of a host that has the same nodes as a given one, because no cut separates such
 * fragments. */
static int32_t first_alike(const surface_maker *maker, int32_t host, int32_t fragment)
{
    const int32_t cut = maker->cut_of[host];
    for (int32_t f = cut < 0 ? 0 : maker->cuts->start[cut]; cut >= 0 && f < maker->cuts->start[cut + 1]; f++)
        if (same_nodes(maker, maker->cuts->fragment[f], fragment)) return maker->cuts->fragment[f];
    return host;
}

/* Return the corner of a host at an initial node; -1: none. */
static int corner_with(const surface_maker *maker, int32_t host, int32_t node)
{
    for (int v = 0; v < 4; v++)
        if (pliant_surface_load_node(maker, nodes_of(maker, host)[v]) == node) return v;
    return -1;
}

static bool has_all(const surface_maker *maker, int32_t host, const int32_t *node, int count)
{
    for (int n = 0; n < count; n++)
        if (corner_with(maker, host, node[n]) < 0) return false;
    return true;
}

/* Return the fragment with which a voxel moves, if it belongs to the voxel's own tetrahedron; -1: it does not. */
static int32_t fragment_of(const surface_maker *maker, int32_t voxel)
{
    const int32_t host = maker->voxels->owner[voxel], cut = host < 0 ? -1 : maker->cut_of[host];
    if (cut < 0) return host;
    const int32_t fragment =
        maker->cuts->voxel_fragment[maker->cuts->voxel_start[cut] + pliant_voxel_in(maker->voxels, host, voxel)];
    return (maker->body->tet_parent ? maker->body->tet_parent[fragment] : fragment) == host ? fragment : -1;
}

static bool is_in_search(const surface_maker *maker, const surface_search *question, int32_t voxel)
{
    const int32_t host = maker->voxels->owner[voxel];
    if (host < 0 ||
        (question->host >= 0 ? host != question->host : !has_all(maker, host, question->node, question->count)))
        return false;
    const int32_t fragment = fragment_of(maker, voxel);
    if (fragment < 0 || question->host < 0) return fragment >= 0;
    if (question->fragment >= 0) return same_nodes(maker, fragment, question->fragment);
    for (int n = 0; n < question->count; n++)
        if (nodes_of(maker, fragment)[question->corner[n]] != question->node[n]) return false;
    return true;
}

static double squared_distance_to(const surface_maker *maker, const int32_t at[3], const double index[3])
{
    double sum = 0;
    for (int d = 0; d < 3; d++) {
        const double difference = (at[d] - index[d]) * maker->voxels->geometry.spacing[d];
        sum += difference * difference;
    }
    return sum;
}

/* Return the nearest voxel of the search around a point, the first one at a tie; -1: none within the distance. */
static int32_t nearest_around(const surface_maker *maker, const surface_search *question, const double index[3])
{
    const pliant_geometry *geometry = &maker->voxels->geometry;
    const double minimum = fmin(fmin(geometry->spacing[0], geometry->spacing[1]), geometry->spacing[2]);
    int32_t best = -1, middle[3], at[3];
    double square = INFINITY;
    for (int d = 0; d < 3; d++) middle[d] = (int32_t)fmin(fmax(floor(index[d] + 0.5), 0), geometry->size[d] - 1);
    for (int away = 1; away <= MAX_DISTANCE && !(square <= away * away * minimum * minimum); away++) {
        int32_t low[3], high[3];
        for (int d = 0; d < 3; d++) {
            low[d] = middle[d] > away ? middle[d] - away : 0;
            high[d] = middle[d] + away < geometry->size[d] ? middle[d] + away : geometry->size[d] - 1;
        }
        for (at[2] = low[2]; at[2] <= high[2]; at[2]++)
            for (at[1] = low[1]; at[1] <= high[1]; at[1]++)
                for (at[0] = low[0]; at[0] <= high[0]; at[0]++) {
                    const double here = squared_distance_to(maker, at, index);
                    const int32_t voxel = at[0] + geometry->size[0] * (at[1] + geometry->size[1] * at[2]);
                    if ((here > square || (here == square && voxel >= best)) && best >= 0) continue;
                    if (!is_in_search(maker, question, voxel)) continue;
                    best = voxel;
                    square = here;
                }
    }
    return best;
}

/* Return the nearest voxel of the search among all voxels of a host. */
static int32_t nearest_of_host(const surface_maker *maker, const surface_search *question, const double index[3])
{
    int32_t best = nearest_around(maker, question, index);
    double square = INFINITY;
    if (best >= 0) return best;
    for (int32_t v = maker->voxels->start[question->host]; v < maker->voxels->start[question->host + 1]; v++) {
        int32_t at[3];
        pliant_place_of(maker->voxels, maker->voxels->voxel[v], at);
        const double here = squared_distance_to(maker, at, index);
        if (!(here < square) || !is_in_search(maker, question, maker->voxels->voxel[v])) continue;
        square = here;
        best = maker->voxels->voxel[v];
    }
    return best;
}

/* Compute the scan index of a lattice point. The sum over its nodes has a fixed order, so that every host gets the same
 * result. */
static void find_place(const surface_maker *maker, const surface_key *key, double index[3])
{
    double world[3] = {0, 0, 0};
    const double whole = SURFACE_WEIGHT_DIVISOR * maker->parts;
    for (int v = 0; v < 4 && key->weight[v] > 0; v++)
        for (int d = 0; d < 3; d++)
            world[d] += key->weight[v] / whole * maker->body->fine.rest[3 * (size_t)key->node[v] + (size_t)d];
    pliant_geometry_to_index(&maker->voxels->geometry, world, index);
}

/* ---- points */

/* Return the fragment of a lattice point. For a point on a face, an edge or a corner, the nearest voxel of all
 * tetrahedra there decides which nodes it moves with. The result is a fragment of the host with these nodes. */
static int32_t label_of(const surface_maker *maker, int32_t host, const surface_key *key)
{
    double index[3];
    surface_search question = {.host = -1, .fragment = -1};
    for (; question.count < 4 && key->weight[question.count] > 0; question.count++)
        question.node[question.count] = key->node[question.count];
    find_place(maker, key, index);
    int32_t voxel = -1;
    if (question.count < 4 && (voxel = nearest_around(maker, &question, index)) >= 0) {
        const int32_t other = maker->voxels->owner[voxel], fragment = fragment_of(maker, voxel);
        if (other == host) return first_alike(maker, host, fragment);
        for (int n = 0; n < question.count; n++) {
            question.corner[n] = corner_with(maker, host, question.node[n]);
            question.node[n] = nodes_of(maker, fragment)[corner_with(maker, other, question.node[n])];
        }
        question.host = host;
        voxel = nearest_of_host(maker, &question, index);
    }
    if (voxel < 0) { /* no fragment has these nodes */
        question = (surface_search){.host = host, .fragment = -1};
        voxel = nearest_of_host(maker, &question, index);
    }
    return voxel < 0 ? host : first_alike(maker, host, fragment_of(maker, voxel));
}

void pliant_surface_find_labels(const surface_maker *maker, int32_t host, int32_t *out)
{
    const int parts = maker->parts;
    int32_t corner[4], x[3];
    pliant_surface_corners(maker, host, corner);
    for (x[0] = 0; x[0] <= parts; x[0]++)
        for (x[1] = 0; x[1] <= x[0]; x[1]++)
            for (x[2] = 0; x[2] <= x[1]; x[2]++) {
                const int32_t at[4] = {parts - x[0], x[0] - x[1], x[1] - x[2], x[2]};
                const int32_t weight[4] = {SURFACE_WEIGHT_DIVISOR * at[0], SURFACE_WEIGHT_DIVISOR * at[1],
                                           SURFACE_WEIGHT_DIVISOR * at[2], SURFACE_WEIGHT_DIVISOR * at[3]};
                surface_key key;
                pliant_surface_key_of(corner, weight, &key);
                out[pliant_surface_place(at)] = label_of(maker, host, &key);
            }
}

/* ---- edges */

/* Collect the voxels of a host on both sides of an edge. Return false if memory is exhausted.
 * from, to: [m] along the scan's axes */
static bool add_samples(surface_maker *maker, int32_t host, const int32_t label[2], const double from[3],
                        const double to[3], double reach)
{
    const pliant_voxels *voxels = maker->voxels;
    const int32_t cut = maker->cut_of[host], *fragment = maker->cuts->voxel_fragment + maker->cuts->voxel_start[cut];
    for (int32_t v = voxels->start[host]; v < voxels->start[host + 1]; v++) {
        surface_sample sample;
        int32_t at[3];
        bool is_near = true;
        pliant_place_of(voxels, voxels->voxel[v], at);
        for (int d = 0; d < 3; d++) {
            sample.at[d] = at[d] * voxels->geometry.spacing[d];
            is_near =
                is_near && sample.at[d] > fmin(from[d], to[d]) - reach && sample.at[d] < fmax(from[d], to[d]) + reach;
        }
        if (!is_near) continue;
        const int32_t of = fragment[v - voxels->start[host]];
        const bool first = same_nodes(maker, of, label[0]);
        if (!first && !same_nodes(maker, of, label[1])) continue;
        sample.side = first ? 1 : -1;
        surface_sample *added = pliant_surface_add(&maker->near);
        if (!added) return false;
        *added = sample;
    }
    return true;
}

/* Return the initial estimate of the crossing: the fraction of sample points whose nearest voxel is on the first
 * side. */
static double estimate_crossing(const surface_list *near, const double from[3], const double to[3])
{
    const surface_sample *sample = near->at;
    double first = 0;
    for (int n = 0; n < PLACES; n++) {
        const double t = (n + 0.5) / PLACES;
        double minimum = INFINITY, side = 0;
        for (size_t s = 0; s < near->count; s++) {
            double square = 0;
            for (int d = 0; d < 3; d++) {
                const double difference = sample[s].at[d] - from[d] - t * (to[d] - from[d]);
                square += difference * difference;
            }
            if (!(square < minimum)) continue;
            minimum = square;
            side = sample[s].side;
        }
        first += (side == 0 ? 0.5 : side > 0) / PLACES;
    }
    return first;
}

/* Fit the side of the voxels around a point on an edge as a linear function of their position, by least squares. Return
 * where it is zero on the edge; NAN: it does not decrease along the edge. */
static double fit(const surface_list *near, const double from[3], const double to[3], double t, double reach)
{
    const surface_sample *sample = near->at;
    double weights = 0, side = 0, middle[3] = {0, 0, 0}, place[3], square[9] = {0}, product[3] = {0, 0, 0};
    for (int d = 0; d < 3; d++) place[d] = from[d] + t * (to[d] - from[d]);
    for (int pass = 0; pass < 2; pass++) {
        for (size_t s = 0; s < near->count; s++) {
            double difference[3], far = 0;
            for (int d = 0; d < 3; d++) {
                difference[d] = sample[s].at[d] - place[d];
                far += difference[d] * difference[d];
            }
            const double weight = 1 - far / (reach * reach);
            if (!(weight > 0)) continue;
            if (pass == 0) {
                weights += weight;
                side += weight * sample[s].side;
                for (int d = 0; d < 3; d++) middle[d] += weight * difference[d];
                continue;
            }
            for (int d = 0; d < 3; d++) {
                product[d] += weight * (difference[d] - middle[d]) * (sample[s].side - side);
                for (int e = 0; e < 3; e++)
                    square[3 * d + e] += weight * (difference[d] - middle[d]) * (difference[e] - middle[e]);
            }
        }
        if (!(weights > 0)) return NAN;
        if (pass > 0) break;
        side /= weights;
        for (int d = 0; d < 3; d++) middle[d] /= weights;
    }
    const double all = pliant_determinant(square);
    if (!(all > 1e-6 * pow((square[0] + square[4] + square[8]) / 3, 3))) return NAN;
    double along = 0, here = side;
    for (int d = 0; d < 3; d++) { /* Cramer's rule */
        double other[9];
        memcpy(other, square, sizeof other);
        for (int e = 0; e < 3; e++) other[3 * e + d] = product[e];
        const double slope = pliant_determinant(other) / all;
        along += slope * (to[d] - from[d]);
        here -= slope * middle[d];
    }
    return along < 0 ? t - here / along : NAN;
}

static double find_crossing(surface_maker *maker, const surface_key end[2])
{
    const pliant_voxels *voxels = maker->voxels;
    const double *spacing = voxels->geometry.spacing, reach = around * fmax(fmax(spacing[0], spacing[1]), spacing[2]);
    int32_t node[4];
    int count = 0;
    for (int e = 0; e < 2; e++)
        for (int v = 0; v < 4 && end[e].weight[v] > 0; v++) {
            bool is_new = true;
            for (int n = 0; n < count; n++) is_new = is_new && node[n] != end[e].node[v];
            if (is_new) node[count++] = end[e].node[v];
        }
    double place[2][3], length = 0;
    for (int e = 0; e < 2; e++) {
        find_place(maker, end + e, place[e]);
        for (int d = 0; d < 3; d++) place[e][d] *= spacing[d];
    }
    for (int d = 0; d < 3; d++) length += (place[1][d] - place[0][d]) * (place[1][d] - place[0][d]);
    bool crossed = false;
    maker->near.count = 0;
    for (int32_t a = voxels->around_start[node[0]]; a < voxels->around_start[node[0] + 1]; a++) {
        const int32_t host = voxels->around[a] / 4;
        if (!maker->block[host] || !maker->block[host]->split || !has_all(maker, host, node, count)) continue;
        int32_t label[2];
        for (int e = 0; e < 2; e++) {
            int32_t at[4] = {0, 0, 0, 0};
            for (int v = 0; v < 4 && end[e].weight[v] > 0; v++)
                at[corner_with(maker, host, end[e].node[v])] = end[e].weight[v] / SURFACE_WEIGHT_DIVISOR;
            label[e] = maker->block[host]->label[pliant_surface_place(at)];
        }
        if (label[0] == label[1]) continue;
        crossed = true;
        if (!add_samples(maker, host, label, place[0], place[1], reach)) return NAN;
    }
    if (!crossed) return -1;
    double t = estimate_crossing(&maker->near, place[0], place[1]);
    const double maximum = reach / sqrt(length);
    for (int n = 0; n < FITS; n++) {
        const double better = fit(&maker->near, place[0], place[1], t, reach);
        if (fabs(better - t) <= maximum) t = better;
    }
    return fmin(fmax(t, min_share), 1 - min_share);
}

double pliant_surface_crossing(surface_maker *maker, int32_t host, const int32_t a[4], const int32_t b[4])
{
    int32_t corner[4], weight[3][4];
    surface_key key, end[2];
    pliant_surface_corners(maker, host, corner);
    for (int v = 0; v < 4; v++) {
        weight[0][v] = SURFACE_WEIGHT_DIVISOR * a[v];
        weight[1][v] = SURFACE_WEIGHT_DIVISOR * b[v];
        weight[2][v] = SURFACE_WEIGHT_DIVISOR / 2 * (a[v] + b[v]);
    }
    pliant_surface_key_of(corner, weight[2], &key);
    pliant_surface_key_of(corner, weight[0], end);
    pliant_surface_key_of(corner, weight[1], end + 1);
    const bool turned = memcmp(end, end + 1, sizeof *end) > 0;
    const int32_t number = pliant_surface_number(&maker->crossings, &key);
    if (number < 0) return NAN;
    if ((size_t)number == maker->where.count) {
        const surface_key ordered[2] = {end[turned], end[!turned]};
        double *added = pliant_surface_add(&maker->where);
        if (!added) return NAN;
        *added = find_crossing(maker, ordered);
    }
    const double where = ((const double *)maker->where.at)[number];
    return where < 0 || !turned ? where : 1 - where;
}

bool pliant_surface_is_refined(const surface_maker *maker, int32_t a, int32_t b)
{
    for (int32_t n = maker->voxels->around_start[a]; n < maker->voxels->around_start[a + 1]; n++) {
        const int32_t host = maker->voxels->around[n] / 4;
        if (maker->block[host] && maker->block[host]->split && corner_with(maker, host, b) >= 0) return true;
    }
    return false;
}

uint16_t pliant_surface_material(const surface_maker *maker, int32_t host, int32_t fragment, const double fraction[4])
{
    const surface_search question = {.host = host, .fragment = fragment};
    double world[3] = {0, 0, 0}, index[3];
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++)
            world[d] += fraction[v] * maker->body->fine.rest[3 * (size_t)nodes_of(maker, fragment)[v] + (size_t)d];
    pliant_geometry_to_index(&maker->voxels->geometry, world, index);
    const int32_t voxel = nearest_around(maker, &question, index);
    if (voxel < 0) return maker->body->fine_material[fragment].material;
    return maker->voxels
        ->of_material[maker->voxels->material[maker->voxels->start[host] + pliant_voxel_in(maker->voxels, host, voxel)]]
        .material;
}
