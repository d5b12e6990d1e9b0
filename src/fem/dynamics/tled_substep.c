/* Duration of the sub-step: halved before a fast tool meets tissue, and doubled again afterwards. */
#include "base/vector3.h"
#include "fem/dynamics/tled.h"

#include <math.h>

enum { MAX_HALVINGS = 3 /* of the duration that is stable at rest */ };

/* ---- change of the duration */

/* Scale the duration of a sub-step by 1 / 2 or 2. The velocities stay the same. */
static void scale(pliant_tled *tled, bool down)
{
    const double factor = down ? 0.5 : 2;
    tled->substeps = down ? 2 * tled->substeps : tled->substeps / 2;
    tled->substeps_done *= down ? 2 : 1;
    tled->part *= down ? 2 : 1;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) tled->substeps_after_part[t] *= down ? 2 : 1;
    tled->time_step *= factor;
    tled->halvings += down ? 1 : -1;
    for (int32_t n = 0; n < 3 * tled->system->mesh->num_nodes; n++) tled->d[n] *= factor;
}

void pliant_tled_halve(pliant_tled *tled) { scale(tled, true); }

/* Increments belong to the middle of a sub-step. Move the velocities from the middle of a sub-step of another duration
 * to the middle of the present one, by gravity. */
static void shift_velocities(pliant_tled *tled, double other)
{
    const double h = tled->time_step;
    for (int32_t i = 0; i < 3 * tled->system->mesh->num_nodes; i++)
        if (tled->inverse_mass[i / 3] > 0) tled->d[i] += 0.5 * h * (other - h) * tled->gravity[i % 3];
}

/* ---- choice of the duration */

/* Limit of the motion of a tool and tissue in a sub-step, divided by the shortest edge. The wave of such an impact
 * strains elements by about twice this ratio. Also the limit of the change of an edge in a sub-step, divided by the
 * shortest adjacent edge. */
static const double max_motion = 0.1;
/* Fraction of this limit below which the duration is doubled. The motion is then below 0.8 of the limit, so the
 * duration is not halved at once. */
static const double doubling = 0.4;

/* Return the largest change of an edge in the last sub-step, divided by the shortest edge at its nodes. */
static double largest_strain(const pliant_tled *tled)
{
    const pliant_mesh *mesh = tled->system->mesh;
    double largest = 0;
    for (int32_t t = 0; t < mesh->num_tets; t++)
        for (int a = 0; a < 4; a++)
            for (int b = 0; b < a; b++) {
                const int32_t from = mesh->tets[4 * t + a], to = mesh->tets[4 * t + b];
                const double change = pliant_distance3(tled->d + 3 * (size_t)to, tled->d + 3 * (size_t)from);
                largest = fmax(largest, change * change / fmin(tled->limit[from], tled->limit[to]));
            }
    return 0.5 * sqrt(largest); /* the limit is half an edge */
}

/* Compute the heights of a tetrahedron above its faces. Heights of an inverted one are negative. */
static void heights_of(const double *const corner[4], double height[4])
{
    double edge[3][3], face[4][3] = {{0}};
    for (int v = 0; v < 3; v++)
        for (int d = 0; d < 3; d++) edge[v][d] = corner[v + 1][d] - corner[0][d];
    for (int v = 0; v < 3; v++) {
        pliant_cross3(edge[(v + 1) % 3], edge[(v + 2) % 3], face[v + 1]);
        for (int d = 0; d < 3; d++) face[0][d] -= face[v + 1][d];
    }
    for (int v = 0; v < 4; v++) height[v] = pliant_dot3(edge[0], face[1]) / pliant_length3(face[v]);
}

/* Return the smallest height of a tetrahedron, divided by its height at rest. The highest frequency of a flat element
 * is about proportional to the inverse of this ratio. */
static double smallest_height(const pliant_tled *tled)
{
    const pliant_mesh *mesh = tled->system->mesh;
    double smallest = INFINITY;
    for (int32_t t = 0; t < mesh->num_tets; t++) {
        double place[4][3], now[4], rest[4];
        const double *at_rest[4], *at[4];
        for (int v = 0; v < 4; v++) {
            const size_t node = 3 * (size_t)mesh->tets[4 * (size_t)t + v];
            at_rest[v] = mesh->rest + node;
            at[v] = place[v];
            for (size_t d = 0; d < 3; d++) place[v][d] = mesh->rest[node + d] + tled->u[node + d];
        }
        heights_of(at_rest, rest);
        heights_of(at, now);
        for (int v = 0; v < 4; v++) smallest = fmin(smallest, now[v] / rest[v]);
    }
    return smallest;
}

bool pliant_tled_choose_substep(pliant_tled *tled, double motion)
{
    const double before = tled->time_step, maximum = max_motion * tled->shortest_edge;
    if (tled->system->quasi_static) return false;
    for (double left = motion; left > maximum && tled->halvings < MAX_HALVINGS; left *= 0.5) scale(tled, true);
    if (tled->time_step == before && tled->halvings > 0 && tled->substeps_done == 0 && motion < doubling * maximum &&
        largest_strain(tled) < doubling * max_motion &&
        smallest_height(tled) > ldexp(tled->system->safety, 1 - tled->halvings))
        scale(tled, false);
    if (tled->time_step == before) return false;
    shift_velocities(tled, before);
    return true;
}
