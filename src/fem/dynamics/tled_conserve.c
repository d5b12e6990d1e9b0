/* Conserves momentum and energy over a cut in explicit dynamics.
 *
 * A hexahedron has an eighth of its mass at each corner. The tetrahedra that remain after a cut have a fourth of their
 * mass at each corner, and they are stiffer. A cut alone would therefore change momentum and add energy. Both are
 * corrected region by region. A region is a connected set of nodes of cells touched by the cut. Regions share no
 * element. For a component without fixed nodes the region is the whole component, so that its center of mass can be
 * corrected as well. All other components stay bitwise unchanged.
 * - Center of mass of a free component: the component is translated back. Otherwise the moved mass would make it spin.
 * - Momentum and angular momentum: the missing rigid motion is added to the velocities, which is the smallest change
 *   (Gauss).
 * - Strain energy: nodes of touched cells move along their elastic forces divided by their masses, until the strain
 *   energy has its earlier value. Velocities stay. If the region moves freely, this motion has no rigid part.
 * - Kinetic energy: the added energy is removed from the region's velocities relative to its rigid motion. If they do
 *   not suffice, the component's velocities are reduced. */
#include "base/dense.h"
#include "base/fail.h"
#include "base/vector3.h"
#include "topology/sorted_numbers.h"
#include "fem/dynamics/tled_regions.h"

#include <math.h>
#include <string.h>

enum { MAX_CORNERS = 8, MAX_RELEASES = 40, MAX_PASSES = 4 };
static const double rounding = 1e-12;

/* ---- Motion of the nodes of a region. */

typedef struct motion {
    double mass, centre[3], momentum[3], spin[3] /* about the centre */, inertia[9], kinetic,
        size[2] /* of the terms of momentum and spin */;
} motion;

/* The rigid motion a + w x r about a point. */
typedef struct rigid_motion { double centre[3], a[3], w[3]; } rigid_motion;

static void arm_of(const pliant_tled *tled, int32_t node, const double centre[3], double r[3])
{
    for (int d = 0; d < 3; d++)
        r[d] = tled->system->mesh->rest[3 * (size_t)node + d] + tled->u[3 * (size_t)node + d] - centre[d];
}

static void find_centre(const pliant_cut_regions *work, int32_t region, double centre[3])
{
    const pliant_tled *tled = work->now.tled;
    const double origin[3] = {0, 0, 0};
    double mass = 0;
    memset(centre, 0, 3 * sizeof *centre);
    for (int32_t i = work->node_start[region]; i < work->node_start[region + 1]; i++) {
        const int32_t n = work->node[i];
        double x[3];
        if (!pliant_cut_node_is_free(tled, n)) continue;
        arm_of(tled, n, origin, x);
        mass += tled->system->node_mass[n];
        for (int d = 0; d < 3; d++) centre[d] += tled->system->node_mass[n] * x[d];
    }
    for (int d = 0; d < 3 && mass > 0; d++) centre[d] /= mass;
}

/* Compute the motion with velocities scale times vector, (nodes x 3). */
static motion find_motion(const pliant_cut_regions *work, int32_t region, const pliant_tled *tled, const double *vector,
                          double scale, const double centre[3])
{
    motion out = {.centre = {centre[0], centre[1], centre[2]}};
    for (int32_t i = work->node_start[region]; i < work->node_start[region + 1]; i++) {
        const int32_t n = work->node[i];
        double r[3], v[3], square = 0, far = 0;
        if (!pliant_cut_node_is_free(tled, n)) continue;
        const double m = tled->system->node_mass[n];
        arm_of(tled, n, centre, r);
        for (int d = 0; d < 3; d++) {
            v[d] = scale * vector[3 * (size_t)n + d];
            square += v[d] * v[d];
            far += r[d] * r[d];
            out.momentum[d] += m * v[d];
        }
        for (int d = 0; d < 3; d++) {
            out.spin[d] += m * (r[(d + 1) % 3] * v[(d + 2) % 3] - r[(d + 2) % 3] * v[(d + 1) % 3]);
            for (int k = 0; k < 3; k++) out.inertia[3 * d + k] += m * ((d == k ? far : 0) - r[d] * r[k]);
        }
        out.mass += m;
        out.kinetic += 0.5 * m * square;
        out.size[0] += m * sqrt(square);
        out.size[1] += m * sqrt(square * far);
    }
    return out;
}

static motion motion_of(const pliant_cut_regions *work, int32_t region, const pliant_cut_side *of,
                        const double centre[3])
{
    return find_motion(work, region, of->tled, of->tled->d, 1 / of->tled->time_step, centre);
}

/* Solve inertia w = spin. The component about an axis through all nodes is 0. */
static void spin_of(const double inertia[9], const double spin[3], double w[3])
{
    double a[9], values[3], axes[9], largest = 0;
    memcpy(a, inertia, sizeof a);
    pliant_dense_symmetric_eigen(3, a, values, axes);
    for (int m = 0; m < 3; m++) largest = fmax(largest, values[m]);
    memset(w, 0, 3 * sizeof *w);
    for (int m = 0; m < 3; m++) {
        if (!(values[m] > rounding * largest)) continue;
        const double part = (axes[m] * spin[0] + axes[3 + m] * spin[1] + axes[6 + m] * spin[2]) / values[m];
        for (int d = 0; d < 3; d++) w[d] += part * axes[3 * d + m];
    }
}

static rigid_motion rigid_of(const motion *of)
{
    rigid_motion out;
    memcpy(out.centre, of->centre, sizeof out.centre);
    for (int d = 0; d < 3; d++) out.a[d] = of->mass > 0 ? of->momentum[d] / of->mass : 0;
    spin_of(of->inertia, of->spin, out.w);
    return out;
}

/* Replace vectors v by kept v + share (a + w x r). */
static void change(const pliant_cut_regions *work, int32_t region, double *vector, const rigid_motion *rigid,
                   double kept, double fraction)
{
    for (int32_t i = work->node_start[region]; i < work->node_start[region + 1]; i++) {
        const int32_t n = work->node[i];
        const double *w = rigid->w;
        double r[3];
        if (!pliant_cut_node_is_free(work->now.tled, n)) continue;
        arm_of(work->now.tled, n, rigid->centre, r);
        for (int d = 0; d < 3; d++) {
            const double at = rigid->a[d] + w[(d + 1) % 3] * r[(d + 2) % 3] - w[(d + 2) % 3] * r[(d + 1) % 3];
            vector[3 * (size_t)n + d] = kept * vector[3 * (size_t)n + d] + fraction * at;
        }
    }
}

/* Add sign times the strain energy of every touched cell to its region. */
static void add_strain(pliant_cut_regions *work, const pliant_cut_side *of, double sign)
{
    const pliant_tled_system *system = of->tled->system;
    for (int32_t i = 0; i < pliant_tled_element_count(system); i++) {
        int corners;
        const int32_t element = pliant_tled_element(system, i),
                      *node = pliant_tled_element_nodes(system, element, &corners);
        const int32_t tet = element < 0 ? system->cubes->cube[~element].tet[0] : element;
        if (!work->cell[pliant_cell_of_tet(system->mesh, tet)]) continue;
        const double energy = pliant_tled_element_energy(of->tled, of->material, element, NULL);
        work->gained[work->part[node[0]]] += sign * energy;
        if (sign < 0) work->scale[work->part[node[0]]] += energy;
    }
}

/* ---- Corrections of a region. */

/* Restore the center of mass of a free component from before the cut. */
static void keep_center(const pliant_cut_regions *work, int32_t region)
{
    double mass = 0, missing[3] = {0, 0, 0};
    for (int32_t i = work->node_start[region]; i < work->node_start[region + 1]; i++) {
        const int32_t n = work->node[i];
        const double now = work->now.tled->system->node_mass[n],
                     *rest = work->now.tled->system->mesh->rest + 3 * (size_t)n;
        const bool before = n < work->was.tled->system->mesh->num_nodes;
        mass += now;
        for (int d = 0; d < 3; d++) {
            if (before)
                missing[d] += work->was.tled->system->node_mass[n] * (rest[d] + work->was.tled->u[3 * (size_t)n + d]);
            missing[d] -= now * (rest[d] + work->now.tled->u[3 * (size_t)n + d]);
        }
    }
    for (int32_t i = work->node_start[region]; i < work->node_start[region + 1]; i++)
        for (int d = 0; d < 3; d++) work->tled->u[3 * (size_t)work->node[i] + d] += missing[d] / mass;
}

/* Restore momentum and angular momentum from before the cut. Return the rise of kinetic energy [J]. */
static double keep_momentum(const pliant_cut_regions *work, int32_t region)
{
    double centre[3];
    find_centre(work, region, centre);
    const motion before = motion_of(work, region, &work->was, centre);
    motion after = motion_of(work, region, &work->now, centre), missing = after;
    for (int d = 0; d < 3; d++) {
        missing.momentum[d] = before.momentum[d] - after.momentum[d];
        missing.spin[d] = before.spin[d] - after.spin[d];
    }
    if (pliant_length3(missing.momentum) > 0.1 * rounding * before.size[0] ||
        pliant_length3(missing.spin) > 0.1 * rounding * before.size[1]) {
        const rigid_motion rigid = rigid_of(&missing);
        change(work, region, work->tled->d, &rigid, 1, work->tled->time_step);
        after = motion_of(work, region, &work->now, centre);
    }
    return after.kinetic - before.kinetic;
}

/* Remove kinetic energy [J] from velocities relative to the rigid motion, limited to their energy. Return the removed
 * energy. */
static double take_kinetic(const pliant_cut_regions *work, int32_t region, double energy)
{
    double centre[3];
    find_centre(work, region, centre);
    const motion whole = motion_of(work, region, &work->now, centre);
    const rigid_motion rigid = rigid_of(&whole);
    double inner = whole.kinetic;
    for (int d = 0; d < 3; d++) inner -= 0.5 * (rigid.a[d] * whole.momentum[d] + rigid.w[d] * whole.spin[d]);
    const double kept = inner > energy ? sqrt(1 - energy / inner) : 0;
    change(work, region, work->tled->d, &rigid, kept, (1 - kept) * work->tled->time_step);
    return fmin(fmax(inner, 0), energy);
}

/* Return the strain energy of the region's elements [J]. forces: also add their forces on the region's nodes. */
static double strain_of(const pliant_cut_regions *work, int32_t region, bool forces)
{
    double sum = 0, force[MAX_CORNERS][3];
    for (int32_t i = work->node_start[region]; forces && i < work->node_start[region + 1]; i++)
        memset(work->force + 3 * (size_t)work->node[i], 0, 3 * sizeof *work->force);
    for (int32_t i = work->element_start[region]; i < work->element_start[region + 1]; i++) {
        int corners;
        const int32_t *node = pliant_tled_element_nodes(work->now.tled->system, work->element[i], &corners);
        sum += pliant_tled_element_energy(work->now.tled, work->now.material, work->element[i], forces ? force : NULL);
        for (int v = 0; v < corners && forces; v++)
            for (int d = 0; d < 3; d++) work->force[3 * (size_t)node[v] + d] += force[v][d];
    }
    return sum;
}

/* Compute work->step from work->force. Return the slope by which the strain energy falls along it [J/s^2]. */
static double find_step(const pliant_cut_regions *work, int32_t region)
{
    const pliant_tled *tled = work->now.tled;
    bool free = true;
    double slope = 0;
    for (int32_t i = work->node_start[region]; i < work->node_start[region + 1]; i++) {
        const int32_t n = work->node[i];
        free = free && pliant_cut_node_is_free(tled, n);
        for (int d = 0; d < 3; d++)
            work->step[3 * (size_t)n + d] = work->near[n] && pliant_cut_node_is_free(tled, n)
                                                ? work->force[3 * (size_t)n + d] / tled->system->node_mass[n]
                                                : 0;
    }
    if (free) {
        double centre[3];
        find_centre(work, region, centre);
        const motion whole = find_motion(work, region, tled, work->step, 1, centre);
        const rigid_motion rigid = rigid_of(&whole);
        change(work, region, work->step, &rigid, 1, -1);
    }
    for (int32_t i = work->node_start[region]; i < work->node_start[region + 1]; i++)
        for (int d = 0; d < 3; d++)
            slope += work->step[3 * (size_t)work->node[i] + d] * work->force[3 * (size_t)work->node[i] + d];
    return slope;
}

static void move(const pliant_cut_regions *work, int32_t region, double time)
{
    for (int32_t i = work->node_start[region]; i < work->node_start[region + 1]; i++)
        for (int d = 0; d < 3; d++)
            work->tled->u[3 * (size_t)work->node[i] + d] += time * work->step[3 * (size_t)work->node[i] + d];
}

/* Return the smallest t at which energy - slope t + curve t^2 / 2 has fallen by `fall`, or the t of its minimum. */
static double solve_parabola(double slope, double curve, double fall)
{
    const double square = slope * slope - 2 * curve * fall;
    return square > 0 ? 2 * fall / (slope + sqrt(square)) : slope / curve;
}

/* Move nodes along their elastic forces until the strain energy has fallen by the given amount [J]. Return its fall. */
static double release_strain(const pliant_cut_regions *work, int32_t region, double energy)
{
    const double longest = work->now.tled->time_step * work->now.tled->time_step;
    double released = 0;
    for (int pass = 0; pass < MAX_RELEASES && energy - released > rounding * energy; pass++) {
        const double before = strain_of(work, region, true), slope = find_step(work, region), left = energy - released;
        if (!(slope > 0)) break;
        const double trial = fmin(left / slope, longest);
        move(work, region, trial);
        double after = strain_of(work, region, false);
        const double curve = 2 * (after - before + slope * trial) / (trial * trial),
                     time = fmin(solve_parabola(slope, curve, left), 4 * longest);
        move(work, region, time - trial);
        after = strain_of(work, region, false);
        if (!(after < before)) {
            move(work, region, -time);
            break;
        }
        released += before - after;
    }
    return released;
}

/* Remove gained strain energy from the strain and the rest from velocities. If their energy does not suffice, reduce
 * the strain again. Return the remaining energy [J]. */
static double conserve(const pliant_cut_regions *work, int32_t region)
{
    const bool elastic = !work->now.tled->system->nodal_pressure;
    double strain = elastic ? work->gained[region] : 0, left = 0;
    for (int pass = 0; pass < MAX_PASSES; pass++) {
        left = strain + keep_momentum(work, region);
        if (!(left > rounding * work->scale[region])) return 0;
        if (pass % 2 == 1) left -= take_kinetic(work, region, left);
        else if (elastic) strain -= release_strain(work, region, pass > 0 ? left : fmin(left, strain));
    }
    return left;
}

/* Replace the region by the complete component of a node. */
static void grow_region(pliant_cut_regions *work, int32_t node)
{
    const pliant_tled_system *system = work->now.tled->system;
    for (int32_t n = 0; n < system->mesh->num_nodes; n++) work->part[n] = n;
    pliant_cut_join_elements(work->part, system);
    const int32_t first = pliant_set_root(work->part, node);
    work->node_start[0] = work->node_start[1] = 0;
    for (int32_t n = 0; n < system->mesh->num_nodes; n++)
        if (pliant_set_root(work->part, n) == first) work->node[work->node_start[1]++] = n;
}

/* Remove energy from the velocities of the whole component. Moved mass changes the inertia of a region, and with it the
 * energy of its rigid motion. The region's own velocities may not suffice. A component in rigid motion has no such
 * energy. */
static void take_from_component(pliant_cut_regions *work, int32_t node, double energy)
{
    pliant_cut_regions whole = *work;
    int32_t start[2];
    whole.node_start = start;
    whole.node = (int32_t *)(void *)work->step; /* unused here: has space for 6 numbers per node */
    grow_region(&whole, node);
    take_kinetic(&whole, 0, energy);
}

pliant_status pliant_tled_conserve(pliant_tled *tled, const pliant_tled *from, const pliant_body *before,
                                   const pliant_body *body)
{
    if (tled->system->quasi_static || body->changes.since != before->revision) return PLIANT_OK;
    pliant_cut_regions work = {.was = {from, before->fine_material}, .now = {tled, body->fine_material}, .tled = tled};
    const pliant_status status = pliant_cut_regions_find(&work, before, body);
    if (status == PLIANT_OK) {
        add_strain(&work, &work.was, -1);
        add_strain(&work, &work.now, 1);
        for (int32_t region = 0; region < work.count; region++) {
            if (work.free[region]) keep_center(&work, region);
            const double left = conserve(&work, region);
            if (left > rounding * work.scale[region] && !work.free[region])
                take_from_component(&work, work.node[work.node_start[region]], left);
        }
    }
    pliant_cut_regions_free(&work);
    return status;
}
