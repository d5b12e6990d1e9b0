#include "contact/volume/volume_bound.h"

#include "base/cubic.h"
#include "base/vector3.h"
#include "contact/detect/part_contacts.h"
#include "contact/detect/update_sides.h"
#include "contact/volume/volume_rules.h"

#include <string.h>

static void find_edges(const int32_t tet[4], const double *positions, double out[3][3])
{
    for (int k = 0; k < 3; k++)
        pliant_subtract3(positions + 3 * (size_t)tet[k + 1], positions + 3 * (size_t)tet[0], out[k]);
}

/* Return six times the volume. */
static double volume_of(const int32_t tet[4], const double *positions)
{
    double edge[3][3];
    find_edges(tet, positions, edge);
    return pliant_triple3(edge[0], edge[1], edge[2]);
}

static bool is_of_piece(const int32_t tet[4], const int32_t *piece_of_node)
{
    for (int k = 0; piece_of_node && k < 4; k++)
        if (piece_of_node[tet[k]] >= 0) return true;
    return false;
}

/* ---- elements in blocks: most have and keep enough volume */

PLIANT_INLINE void find_nodes(const pliant_mesh *mesh, int32_t first, int64_t at[4][LANES])
{
    for (int l = 0; l < LANES; l++)
        for (int k = 0; k < 4; k++)
            at[k][l] =
                3 * (int64_t)mesh->tets[4 * (size_t)(first + l < mesh->num_tets ? first + l : first) + (size_t)k];
}

PLIANT_INLINE void load_edges(int64_t at[4][LANES], const double *positions, pliant_volume_edges out)
{
    for (int d = 0; d < 3; d++) {
        double origin[LANES];
        for (int l = 0; l < LANES; l++) origin[l] = positions[at[0][l] + d];
        for (int k = 0; k < 3; k++)
            for (int l = 0; l < LANES; l++) out[k][d][l] = positions[at[k + 1][l] + d] - origin[l];
    }
}

/* Return whether an element of the block is below this fraction of its rest volume. */
PLIANT_VECTORIZED static bool has_near(double fraction, const pliant_mesh *mesh, int32_t first, const double *positions)
{
    pliant_volume_edges now, rest;
    int64_t at[4][LANES];
    int near = 0;
    find_nodes(mesh, first, at);
    load_edges(at, positions, now);
    load_edges(at, mesh->rest, rest);
    for (int l = 0; l < LANES; l++) near |= pliant_volume_is_below(fraction, now, rest, l);
    return near != 0;
}

/* Return whether an element of the block may become too small during the leg. */
PLIANT_VECTORIZED static bool has_small(const pliant_contact_settings *settings, const pliant_mesh *mesh, int32_t first,
                                        const double *from, const double *to)
{
    const double keep = settings->advance_keep, stop = settings->volume_stop;
    pliant_volume_edges a, b, rest;
    int64_t at[4][LANES];
    int small = 0;
    find_nodes(mesh, first, at);
    load_edges(at, from, a);
    load_edges(at, to, b);
    load_edges(at, mesh->rest, rest);
    for (int l = 0; l < LANES; l++) small |= pliant_volume_may_be_small(keep, stop, a, b, rest, l);
    return small != 0;
}

/* ---- contact points */

/* Make the contact point of the node with the smallest height over the opposite face. stop: six times the volume to
 * keep */
static void set_point(int32_t element, const int32_t tet[4], const double *positions, double stop,
                      pliant_contact_point *out)
{
    static const int face[4][3] = {{1, 3, 2}, {0, 2, 3}, {0, 3, 1}, {0, 1, 2}};
    double x[4][3], largest = -1;
    int top = 0;
    for (int v = 0; v < 4; v++) {
        double u[3], w[3], normal[3];
        const double *origin = positions + 3 * (size_t)tet[face[v][0]];
        pliant_subtract3(positions + 3 * (size_t)tet[face[v][1]], origin, u);
        pliant_subtract3(positions + 3 * (size_t)tet[face[v][2]], origin, w);
        pliant_cross3(u, w, normal);
        const double square = pliant_dot3(normal, normal);
        if (!(square > largest)) continue;
        largest = square;
        top = v;
    }
    *out = (pliant_contact_point){
        .kind = PLIANT_OBSTACLE_ELEMENT, .tool = -1, .part = -1, .count = 4, .least_volume = stop};
    out->feature = (uint64_t)PLIANT_ELEMENT_VOLUME << 56 | (uint64_t)(uint32_t)element << 2 | (uint64_t)top;
    for (int k = 0; k < 4; k++) {
        out->node[k] = tet[k == 0 ? top : face[top][k - 1]];
        memcpy(x[k], positions + 3 * (size_t)out->node[k], sizeof x[k]);
    }
    (void)pliant_volume_set_height(x, out);
}

void pliant_volume_gradient(const pliant_contact_point *point, const double *positions, double out[4][3])
{
    double to[3], u[3], w[3];
    const double *origin = positions + 3 * (size_t)point->node[1];
    pliant_subtract3(positions + 3 * (size_t)point->node[0], origin, to);
    pliant_subtract3(positions + 3 * (size_t)point->node[2], origin, u);
    pliant_subtract3(positions + 3 * (size_t)point->node[3], origin, w);
    pliant_cross3(u, w, out[0]);
    pliant_cross3(w, to, out[2]);
    pliant_cross3(to, u, out[3]);
    const double length = pliant_length3(out[0]);
    for (int d = 0; d < 3; d++) {
        out[0][d] /= length;
        out[2][d] /= length;
        out[3][d] /= length;
        out[1][d] = -(out[0][d] + out[2][d] + out[3][d]);
    }
}

static bool has_any_near(double fraction, const pliant_mesh *mesh, const double *positions, int num_threads)
{
    bool any = false;
#pragma omp parallel for schedule(static) num_threads(num_threads) reduction(|| : any)
    for (int32_t first = 0; first < mesh->num_tets; first += LANES)
        any = any || has_near(fraction, mesh, first, positions);
    return any;
}

pliant_status pliant_volume_find(const pliant_contact_settings *settings, const pliant_mesh *mesh,
                                 const double *positions, const int32_t *piece_of_node, bool opens, int num_threads,
                                 pliant_contacts *out)
{
    if (!has_any_near(settings->volume_near, mesh, positions, num_threads)) return PLIANT_OK;
    for (int32_t t = 0; t < mesh->num_tets; t++) {
        const int32_t *tet = mesh->tets + 4 * (size_t)t;
        const double rest = volume_of(tet, mesh->rest), now = volume_of(tet, positions),
                     stop = settings->volume_stop * rest;
        if (now >= settings->volume_near * rest || is_of_piece(tet, piece_of_node)) continue;
        pliant_status status = pliant_contacts_reserve(out, out->count + 1);
        if (status != PLIANT_OK) return status;
        set_point(t, tet, positions, opens ? stop : fmin(stop, now), out->point + out->count);
        out->count++;
    }
    return PLIANT_OK;
}

double pliant_volume_lacking(const pliant_contact_settings *settings, const pliant_mesh *mesh, const double *positions,
                             const pliant_contacts *points)
{
    double maximum = 0;
    for (int32_t p = 0; p < points->count; p++) {
        if (points->point[p].kind != PLIANT_OBSTACLE_ELEMENT) continue;
        const int32_t element = (int32_t)(points->point[p].feature >> 2);
        const int32_t *tet = mesh->tets + 4 * (size_t)element;
        const double stop = settings->volume_stop * volume_of(tet, mesh->rest);
        pliant_contact_point now;
        set_point(element, tet, positions, stop, &now);
        maximum = fmax(maximum, pliant_dot3(now.normal, now.place) * (1 - volume_of(tet, positions) / stop));
    }
    return maximum;
}

/* ---- bound */

/* Compute the coefficients of an element's volume along a leg. */
static void find_coefficients(const int32_t tet[4], const double *from, const double *to, double out[4])
{
    double edges[2][3][3];
    find_edges(tet, from, edges[0]);
    find_edges(tet, to, edges[1]);
    pliant_cubic_coefficients((const double(*)[3])edges[0], (const double(*)[3])edges[1], out);
}

static double limit_of(const pliant_contact_settings *settings, double rest, double from)
{
    const double stop = settings->volume_stop;
    return fmax(fmin(settings->advance_keep * from, stop * rest), fmin(0.5 * stop * rest, from));
}

/* Return the largest fraction of a leg in which an element keeps its volume. An element that is inverted at the start
 * is exempt. */
static double fraction_of(const pliant_contact_settings *settings, const int32_t tet[4], const double *rest,
                          const double *from, const double *to)
{
    double coefficient[4];
    find_coefficients(tet, from, to, coefficient);
    if (!(coefficient[0] > 0)) return 1;
    return pliant_cubic_time(coefficient, limit_of(settings, volume_of(tet, rest), coefficient[0]));
}

double pliant_volume_advance(const pliant_contact_settings *settings, const pliant_mesh *mesh, const double *from,
                             const double *to, const int32_t *piece_of_node, int num_threads)
{
    double minimum = 1;
#pragma omp parallel for schedule(static) num_threads(num_threads) reduction(min : minimum)
    for (int32_t first = 0; first < mesh->num_tets; first += LANES) {
        if (!has_small(settings, mesh, first, from, to)) continue;
        for (int32_t t = first; t < mesh->num_tets && t < first + LANES; t++) {
            const int32_t *tet = mesh->tets + 4 * (size_t)t;
            if (!is_of_piece(tet, piece_of_node))
                minimum = fmin(minimum, fraction_of(settings, tet, mesh->rest, from, to));
        }
    }
    return minimum;
}

/* Compute the positions of an element's nodes after their fractions of the leg. */
static void place(const int32_t tet[4], const double *from, const double *to, const double *fraction, double out[4][3])
{
    for (int k = 0; k < 4; k++)
        for (int d = 0; d < 3; d++) {
            const size_t i = 3 * (size_t)tet[k] + (size_t)d;
            out[k][d] = from[i] + fraction[tet[k]] * (to[i] - from[i]);
        }
}

/* Return the fraction of the leg in which an element keeps its volume, if each node makes its own fraction of it. */
static double fraction_of_mixed(const pliant_contact_settings *settings, const int32_t tet[4], const double *rest,
                                const double *from, const double *to, const double *fraction)
{
    static const int32_t own[4] = {0, 1, 2, 3};
    double begin[4][3], end[4][3], relaxed[4][3];
    for (int k = 0; k < 4; k++) {
        memcpy(begin[k], from + 3 * (size_t)tet[k], sizeof begin[k]);
        memcpy(relaxed[k], rest + 3 * (size_t)tet[k], sizeof relaxed[k]);
    }
    place(tet, from, to, fraction, end);
    return fraction_of(settings, own, &relaxed[0][0], &begin[0][0], &end[0][0]);
}

bool pliant_volume_is_kept(const pliant_contact_settings *settings, const pliant_mesh *mesh, int32_t element,
                           const double *from, const double *to, const double *fraction)
{
    return fraction_of_mixed(settings, mesh->tets + 4 * (size_t)element, mesh->rest, from, to, fraction) == 1;
}

/* Shorten the motion of an element's nodes until it keeps its volume. Return whether it was too small. */
static bool hold_back(const pliant_contact_settings *settings, const int32_t tet[4], const double *rest,
                      const double *from, const double *to, double *fraction)
{
    const double time = fraction_of_mixed(settings, tet, rest, from, to, fraction);
    for (int k = 0; k < 4; k++) fraction[tet[k]] *= time;
    return time < 1;
}

int32_t pliant_volume_bound_motion(const pliant_contact_settings *settings, const pliant_mesh *mesh, const double *from,
                                   const double *to, const int32_t *piece_of_node, int num_threads, double *fraction)
{
    enum { MAX_PASSES = 16 };
    for (int32_t n = 0; n < mesh->num_nodes; n++) fraction[n] = 1;
    if (pliant_volume_advance(settings, mesh, from, to, piece_of_node, num_threads) == 1) return 0;
    int32_t first = 0, count = 1;
    for (int pass = 0; pass < MAX_PASSES && count > 0; pass++) {
        count = 0;
        for (int32_t t = 0; t < mesh->num_tets; t++) {
            const int32_t *tet = mesh->tets + 4 * (size_t)t;
            if (!is_of_piece(tet, piece_of_node)) count += hold_back(settings, tet, mesh->rest, from, to, fraction);
        }
        if (pass == 0) first = count;
    }
    return count > 0 ? -1 : first;
}
