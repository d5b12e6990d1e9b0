/* Explicit dynamics that goes on in the next body: what of the state goes over, and what a cut must not change.
 *
 * A hexahedron has an eighth of its mass at each corner. What it falls into, tetrahedra, and chips that go with another tetrahedron, have their mass
 * elsewhere, and tetrahedra are stiffer than the hexahedron was: momentum would change, and energy rise. So
 *  - near the cut the velocities get what is missing of momentum and angular momentum by the least change there is (Gauss), a rigid motion:
 *    sum of m |change|^2 is least under the two sums where  change = a + w x r;
 *  - what energy was won is taken from the velocities. The least change, that against their own direction, takes the same part of all; what is
 *    left of them when mean velocity and spin of the whole are taken off, so that momentum stays. There is no more than that to take. */
#include "base/dense.h"
#include "base/fail.h"
#include "fem/dynamics/tled_cubes.h"
#include "pliant/memory.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

/* lane of the element that a tetrahedron is, or is in */
static int32_t place_of(const pliant_tled_system *system, int32_t tet) { return system->cubes ? system->cubes->element_of_tet[tet] : tet; }
static float shear_at(const pliant_tled_system *system, int32_t place)
{
    const int32_t block = place / LANES - system->num_blocks;
    return block < 0 ? system->moduli[place / LANES][0][place % LANES] : system->cubes->moduli[block][0][place % LANES];
}

void pliant_tled_carry(pliant_tled *tled, const pliant_tled *from, const pliant_body_map *map)
{
    const pliant_tled_system *system = tled->system;
    tled->tolerance = from->tolerance;
    tled->halvings = from->halvings;
    if (system->quasi_static) {
        tled->substeps = from->substeps;
    } else {
        tled->substeps <<= tled->halvings;
        tled->time_step = ldexp(tled->time_step, -tled->halvings);
    }
    memcpy(tled->target, from->target, sizeof tled->target);
    memcpy(tled->passed, from->passed, sizeof tled->passed);
    memcpy(tled->passed_target, from->passed_target, sizeof tled->passed_target);
    tled->passed_step = from->passed_step;
    const double faster = tled->time_step / from->time_step; /* increments are of a sub-step; those of relaxation are of none */
    pliant_body_map_vectors(map, from->u, tled->u);
    pliant_body_map_vectors(map, from->d, tled->d);
    for (int32_t n = 0; n < system->mesh->num_nodes; n++) {
        const bool moves = tled->inverse_mass[n] > 0 && !system->quasi_static;
        for (int d = 0; d < 3; d++) tled->d[3 * n + d] *= moves ? faster : 0;
    }
    for (int32_t t = 0; tled->memory && t < system->mesh->num_tets; t++) {
        int32_t to = place_of(system, t), source = place_of(from->system, map->tet[t]);
        /* of a fragment as much as it has of the stiffness */
        const float now = shear_at(system, to), was = shear_at(from->system, source), share = now == was || !(was > 0) ? 1 : now / was;
        for (int m = 0; m < 6 * PLIANT_PRONY_TERMS; m++)
            tled->memory[to / LANES][m][to % LANES] = share * from->memory[source / LANES][m][source % LANES];
    }
}

/* ---- what a cut must not change */

/* one of two bodies, and nodes of it */
typedef struct side {
    const pliant_tled *tled;
    uint8_t *node;              /* (num_nodes) a corner in a cell that a cut has touched */
    double strain;              /* energy in such cells [J] */
} side;

/* of some nodes that move */
typedef struct motion {
    double mass, centre[3], momentum[3], spin[3] /* about the centre */, inertia[9], kinetic, size[2] /* of the terms of momentum and spin */;
} motion;

static bool moves(const side *of, bool all, int32_t node) { return of->tled->inverse_mass[node] > 0 && (all || of->node[node]); }

static void arm_of(const pliant_tled *tled, int32_t node, const double centre[3], double r[3])
{
    for (int d = 0; d < 3; d++) r[d] = tled->system->mesh->rest[3 * (size_t)node + d] + tled->u[3 * (size_t)node + d] - centre[d];
}

static void find_centre(const side *of, bool all, motion *out)
{
    const double origin[3] = {0, 0, 0};
    *out = (motion){0};
    for (int32_t n = 0; n < of->tled->system->mesh->num_nodes; n++) {
        if (!moves(of, all, n)) continue;
        double x[3];
        arm_of(of->tled, n, origin, x);
        out->mass += of->tled->system->node_mass[n];
        for (int d = 0; d < 3; d++) out->centre[d] += of->tled->system->node_mass[n] * x[d];
    }
    for (int d = 0; d < 3 && out->mass > 0; d++) out->centre[d] /= out->mass;
}

/* all but mass and centre, which is given */
static void find_motion(const side *of, bool all, motion *out)
{
    const pliant_tled *tled = of->tled;
    for (int32_t n = 0; n < tled->system->mesh->num_nodes; n++) {
        if (!moves(of, all, n)) continue;
        const double m = tled->system->node_mass[n];
        double r[3], v[3], square = 0, far = 0;
        arm_of(tled, n, out->centre, r);
        for (int d = 0; d < 3; d++) {
            v[d] = tled->d[3 * (size_t)n + d] / tled->time_step;
            square += v[d] * v[d];
            far += r[d] * r[d];
            out->momentum[d] += m * v[d];
        }
        for (int d = 0; d < 3; d++) {
            out->spin[d] += m * (r[(d + 1) % 3] * v[(d + 2) % 3] - r[(d + 2) % 3] * v[(d + 1) % 3]);
            for (int k = 0; k < 3; k++) out->inertia[3 * d + k] += m * ((d == k ? far : 0) - r[d] * r[k]);
        }
        out->kinetic += 0.5 * m * square;
        out->size[0] += m * sqrt(square);
        out->size[1] += m * sqrt(square * far);
    }
}

/* w of inertia w = spin; none about an axis that all nodes lie on */
static void spin_of(const double inertia[9], const double spin[3], double w[3])
{
    const double rounding = 1e-12;
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

static double norm_of(const double v[3]) { return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

/* velocities v become  kept v + (1 - kept) (a + w x r) + added (a + w x r) */
static void change(pliant_tled *tled, const side *of, bool all, const double centre[3], const double a[3], const double w[3], double kept, double added)
{
    for (int32_t n = 0; n < tled->system->mesh->num_nodes; n++) {
        if (!moves(of, all, n)) continue;
        double r[3];
        arm_of(tled, n, centre, r);
        for (int d = 0; d < 3; d++) {
            const double rigid = tled->time_step * (a[d] + w[(d + 1) % 3] * r[(d + 2) % 3] - w[(d + 2) % 3] * r[(d + 1) % 3]);
            double *at = tled->d + 3 * (size_t)n + d;
            *at = kept * *at + (1 - kept + added) * rigid;
        }
    }
}

/* Momentum and angular momentum near the cut as before it. Returns by how much kinetic energy has risen [J]. */
static double keep_momentum(pliant_tled *tled, const side *was, const side *now)
{
    const double rounding = 1e-13;
    motion before = {0}, after;
    double a[3], spin[3], w[3];
    find_centre(now, false, &after);
    memcpy(before.centre, after.centre, sizeof before.centre);
    find_motion(was, false, &before);
    find_motion(now, false, &after);
    if (!(after.mass > 0)) return 0;
    for (int d = 0; d < 3; d++) {
        a[d] = (before.momentum[d] - after.momentum[d]) / after.mass;
        spin[d] = before.spin[d] - after.spin[d];
    }
    if (after.mass * norm_of(a) <= rounding * before.size[0] && norm_of(spin) <= rounding * before.size[1]) return after.kinetic - before.kinetic;
    spin_of(after.inertia, spin, w);
    change(tled, now, false, after.centre, a, w, 1, 1);
    after = (motion){.mass = after.mass, .centre = {after.centre[0], after.centre[1], after.centre[2]}};
    find_motion(now, false, &after);
    return after.kinetic - before.kinetic;
}

/* takes so much from what the nodes move against one another [J] */
static void take_energy(pliant_tled *tled, const side *now, double energy)
{
    motion whole;
    double a[3], w[3], rigid = 0;
    find_centre(now, true, &whole);
    find_motion(now, true, &whole);
    if (!(whole.mass > 0)) return;
    spin_of(whole.inertia, whole.spin, w);
    for (int d = 0; d < 3; d++) {
        a[d] = whole.momentum[d] / whole.mass;
        rigid += 0.5 * (a[d] * whole.momentum[d] + w[d] * whole.spin[d]);
    }
    const double inner = whole.kinetic - rigid;
    change(tled, now, true, whole.centre, a, w, inner > energy ? sqrt(1 - energy / inner) : 0, 0);
}

/* cell: (cells) those that a cut has touched */
static pliant_status look_at(const pliant_tled *tled, const pliant_tet_material *material, const uint8_t *cell, side *out)
{
    const pliant_mesh *mesh = tled->system->mesh;
    *out = (side){.tled = tled, .node = pliant_calloc((size_t)mesh->num_nodes, 1)};
    if (!out->node) return pliant_fail_memory("what a cut leaves as it is");
    for (int32_t t = 0; t < mesh->num_tets; t++)
        for (int v = 0; v < 4 && cell[pliant_cell_of_tet(mesh, t)]; v++) out->node[mesh->tets[4 * (size_t)t + v]] = 1;
    out->strain = pliant_tled_strain_energy(tled, material, cell);
    return PLIANT_OK;
}

pliant_status pliant_tled_conserve(pliant_tled *tled, const pliant_tled *from, const pliant_body *before, const pliant_body *body)
{
    const double rounding = 1e-12;
    const pliant_body_changes *changes = &body->changes;
    if (tled->system->quasi_static || changes->since != before->revision) return PLIANT_OK;
    uint8_t *cell = pliant_calloc(pliant_count_cells(&body->fine), 1);
    side was = {0}, now = {0};
    pliant_status status = cell ? PLIANT_OK : pliant_fail_memory("what a cut leaves as it is");
    for (int32_t i = 0; cell && i < changes->num_touched; i++) cell[pliant_cell_of_tet(&body->fine, changes->touched[i])] = 1;
    for (int32_t t = changes->tets_before; cell && t < body->fine.num_tets; t++) cell[pliant_cell_of_tet(&body->fine, t)] = 1;
    if (status == PLIANT_OK) status = look_at(from, before->fine_material, cell, &was);
    if (status == PLIANT_OK) status = look_at(tled, body->fine_material, cell, &now);
    for (int32_t n = 0; status == PLIANT_OK && n < changes->nodes_before; n++) was.node[n] = now.node[n] = was.node[n] || now.node[n]; /* copies took mass of them */
    if (status == PLIANT_OK) {
        const double strain = tled->system->nodal_pressure ? 0 : now.strain - was.strain, gained = strain + keep_momentum(tled, &was, &now);
        if (gained > rounding * was.strain) take_energy(tled, &now, gained);
    }
    pliant_free(cell);
    pliant_free(was.node);
    pliant_free(now.node);
    return status;
}
