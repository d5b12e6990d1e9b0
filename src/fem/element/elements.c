#include "base/fail.h"
#include "base/buffer.h"
#include "fem/element/deformation.h"
#include "fem/element/neo_hookean.h"
#include "fem/element/rotation.h"
#include "fem/system.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <math.h>
#include <string.h>

bool pliant_tet_fills(const pliant_tet_material *material) { return !(material->tissue > 0) && material->mu > 0; }

/* Elements that fill empty space are easily squeezed flat and inverted. With rotations they have many equilibria, and
 * iterations do not converge. With R = I there is one equilibrium. */
static pliant_status fill(pliant_system *system, const pliant_tet_material *material)
{
    int32_t count = 0;
    for (int32_t t = 0; t < system->mesh->num_tets; t++) count += pliant_tet_fills(material + t);
    if (count == 0) return PLIANT_OK;
    system->grounded = pliant_calloc((size_t)system->num_blocks * LANES, sizeof *system->grounded);
    if (!system->grounded) return pliant_fail_memory("the elements");
    for (int32_t t = 0; t < system->mesh->num_tets; t++) system->grounded[t] = pliant_tet_fills(material + t);
    return PLIANT_OK;
}

/* Set one element. Padding repeats the last element without stiffness. */
static void make_element(pliant_system *system, const pliant_tet_material *material, int32_t e)
{
    const int32_t block = e / LANES, lane = e % LANES, tets = system->mesh->num_tets, tet = e < tets ? e : tets - 1;
    double gradients[12];
    const double volume = pliant_mesh_gradients(system->mesh, tet, gradients);
    for (int m = 0; m < 12; m++) system->gradients[block][m][lane] = gradients[m];
    system->lame[block][0][lane] = tet == e ? volume * material[tet].lambda : 0;
    system->lame[block][1][lane] = tet == e ? volume * material[tet].mu : 0;
}

/* Copy kept elements of another system. Per-block data is copied for complete blocks. */
static pliant_status make_next(pliant_system *system, const pliant_tet_material *material, const pliant_system *before,
                               const uint8_t *kept)
{
    const int32_t tets = system->mesh->num_tets,
                  blocks = before->num_blocks < system->num_blocks ? before->num_blocks : system->num_blocks;
    const size_t count = (size_t)system->num_blocks, same = (size_t)blocks;
    system->gradients = pliant_next_version(before->gradients, same, count, sizeof *system->gradients);
    system->lame = pliant_next_version(before->lame, same, count, sizeof *system->lame);
    /* For homogenized elements it has another meaning. */
    const bool fill_before = before->grounded && !before->stiffness;
    if (fill_before)
        system->grounded = pliant_next_version(before->grounded, same * LANES, count * LANES, sizeof *system->grounded);
    if (!system->gradients || !system->lame || (fill_before && !system->grounded))
        return pliant_fail_memory("the elements");
    bool any = false;
    for (int32_t e = pliant_next_changed(kept, tets, 0), last = -1; e < LANES * system->num_blocks;
         e = e < tets ? pliant_next_changed(kept, tets, e + 1) : e + 1) {
        if (e / LANES > last) {
            last = e / LANES;
            pliant_mark_written(system->gradients, (size_t)last, 1, sizeof *system->gradients);
            pliant_mark_written(system->lame, (size_t)last, 1, sizeof *system->lame);
            if (system->grounded)
                pliant_mark_written(system->grounded, (size_t)e / LANES * LANES, LANES, sizeof *system->grounded);
        }
        make_element(system, material, e);
        if (system->grounded) system->grounded[e] = e < tets && pliant_tet_fills(material + e);
        else any = any || (e < tets && pliant_tet_fills(material + e));
    }
    return any ? fill(system, material) : PLIANT_OK;
}

int32_t pliant_next_changed(const uint8_t *kept, int32_t count, int32_t from)
{
    const uint8_t *found = from < count ? memchr(kept + from, 0, (size_t)(count - from)) : NULL;
    return found ? (int32_t)(found - kept) : count;
}

pliant_status pliant_system_build_tetrahedra(pliant_system *system, const pliant_tet_material *material,
                                             const pliant_system *before, const uint8_t *kept)
{
    const pliant_mesh *mesh = system->mesh;
    system->num_blocks = (mesh->num_tets + LANES - 1) / LANES;
    if (kept) return make_next(system, material, before, kept);
    system->gradients = pliant_malloc((size_t)system->num_blocks, sizeof *system->gradients);
    system->lame = pliant_malloc((size_t)system->num_blocks, sizeof *system->lame);
    if (!system->gradients || !system->lame) return pliant_fail_memory("the elements");
    pliant_status status = fill(system, material);
    if (status != PLIANT_OK) return status;
#pragma omp parallel for num_threads(system->num_threads)
    for (int32_t e = 0; e < system->num_blocks * LANES; e++) make_element(system, material, e);
    return PLIANT_OK;
}

void pliant_element_stiffness(const double g[12], double volume_lambda, double volume_mu, double stiffness[144])
{
    for (int a = 0; a < 4; a++)
        for (int b = 0; b < 4; b++)
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++)
                    stiffness[12 * (3 * a + r) + 3 * b + c] =
                        pliant_isotropic_entry(g + 3 * a, g + 3 * b, volume_lambda, volume_mu, r, c);
}

void pliant_tet_stiffness(const pliant_mesh *mesh, int32_t tet, const pliant_tet_material *material,
                          double stiffness[144])
{
    double gradients[12];
    double volume = pliant_mesh_gradients(mesh, tet, gradients);
    pliant_element_stiffness(gradients, volume * material->lambda, volume * material->mu, stiffness);
}

/* Compute the forces that hold the elements in this state. The elements exert the opposite forces. */
PLIANT_VECTORIZED static void isotropic_forces(double x[12][LANES], double g[12][LANES], double lame[2][LANES],
                                               const uint8_t *grounded, double out[12][LANES])
{
    /* A local array, since possible aliasing with the inputs would prevent vectorization. */
    double f[9][LANES], r[9][LANES], forces[12][LANES];
    deformation_of(x, g, f);
    pliant_rotations(f, r);
    if (grounded) ground(grounded, r);
    for (int l = 0; l < LANES; l++) {
        double deformation[9], rotation[9], gradients[12], force[12];
        for (int m = 0; m < 9; m++) deformation[m] = f[m][l], rotation[m] = r[m][l];
        for (int m = 0; m < 12; m++) gradients[m] = g[m][l];
        pliant_corotational_force(deformation, rotation, lame[0][l], lame[1][l], gradients, force);
        for (int m = 0; m < 12; m++) forces[m][l] = force[m];
    }
    memcpy(out, forces, sizeof forces);
}

/* Compute the forces of neo-Hookean elements. Elements that only fill empty space stay linear. */
PLIANT_VECTORIZED static void neo_hookean_forces(double x[12][LANES], double g[12][LANES], double lame[2][LANES],
                                                 const uint8_t *grounded, double out[12][LANES])
{
    double f[9][LANES], forces[12][LANES];
    deformation_of(x, g, f);
    for (int l = 0; l < LANES; l++) {
        double deformation[9], gradients[12], force[12];
        for (int m = 0; m < 9; m++) deformation[m] = f[m][l];
        for (int m = 0; m < 12; m++) gradients[m] = g[m][l];
        pliant_neo_hookean_force(deformation, grounded && grounded[l], lame[0][l], lame[1][l], gradients, force);
        for (int m = 0; m < 12; m++) forces[m][l] = force[m];
    }
    memcpy(out, forces, sizeof forces);
}

PLIANT_VECTORIZED static void block_rotations(double x[12][LANES], double g[12][LANES], double out[9][LANES])
{
    double f[9][LANES];
    deformation_of(x, g, f);
    pliant_rotations(f, out);
}

static void homogenized_forces(const pliant_system *system, int32_t block, double x[12][LANES],
                               double rotations[9][LANES], double out[12][LANES])
{
    for (int l = 0; l < LANES; l++) {
        int32_t tet = block * LANES + l;
        if (tet >= system->mesh->num_tets) {
            for (int m = 0; m < 12; m++) out[m][l] = 0;
            continue;
        }
        const int32_t *nodes = system->mesh->tets + 4 * tet;
        double r[9], corners[12], rest[12], f[12];
        for (int m = 0; m < 9; m++) r[m] = rotations[m][l];
        for (int m = 0; m < 12; m++) corners[m] = x[m][l], rest[m] = system->mesh->rest[3 * nodes[m / 3] + m % 3];
        pliant_homogenized_force(system->stiffness + 144 * (size_t)tet, 1, corners, rest, r,
                                 system->grounded && system->grounded[tet], f);
        for (int m = 0; m < 12; m++) out[m][l] = f[m];
    }
}

void pliant_system_element_forces(const pliant_system *system, const double *positions, double (*forces)[12][LANES])
{
    if (system->macros) {
        pliant_macro_forces(system, positions, (double *)forces);
        return;
    }
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t block = 0; block < system->num_blocks; block++) {
        double x[12][LANES];
        const uint8_t *grounded = grounded_of(system, block);
        load_corners(system, positions, block, x);
        if (!system->stiffness) {
            (system->law == PLIANT_ELASTICITY_NEO_HOOKEAN ? neo_hookean_forces : isotropic_forces)(
                x, system->gradients[block], system->lame[block], grounded, forces[block]);
            continue;
        }
        double rotations[9][LANES];
        block_rotations(x, system->gradients[block], rotations);
        if (grounded) ground(grounded, rotations);
        homogenized_forces(system, block, x, rotations, forces[block]);
    }
}

/* Compute the twist stiffness from the isotropic energy mu |F - R|^2 + lambda / 2 tr(R'F - I)^2, whose gradient is the
 * force. A pressure adds to lambda tr(S - I). Rotating an element by a small w relative to R, at constant stretch
 * S = R'F, costs the energy w' D w with
 *     D = R (2 mu I + 2 (lambda tr(S - I) - 2 mu) (tr(S) I - S)^-1) R'
 * in addition to the warped stiffness R K R' (twist modes of Smith, de Goes, Kim 2019, Analytic eigensystems, 4.2). */
static void twist_of(const double f[9], const double r[9], double lambda, double mu, double pressure,
                     pliant_twist part, double out[6])
{
    const double minimum =
        0.2; /* lower bound for eigenvalues of tr(S) I - S, which are sums of two stretches; only flat
                               * elements are below it */
    double s[9], m[6], values[3], vectors[9], d[6], trace, norm = 0;
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) s[3 * a + b] = r[a] * f[b] + r[3 + a] * f[3 + b] + r[6 + a] * f[6 + b];
    trace = s[0] + s[4] + s[8];
    m[0] = trace - s[0], m[1] = trace - s[4], m[2] = trace - s[8];
    m[3] = -0.5 * (s[5] + s[7]), m[4] = -0.5 * (s[2] + s[6]), m[5] = -0.5 * (s[1] + s[3]);
    double factor = 2 * (lambda * (trace - 3) + pressure - 2 * mu);
    double cofactor[6] = {m[1] * m[2] - m[3] * m[3], m[0] * m[2] - m[4] * m[4], m[0] * m[1] - m[5] * m[5],
                          m[4] * m[5] - m[0] * m[3], m[3] * m[5] - m[1] * m[4], m[3] * m[4] - m[2] * m[5]};
    double determinant = m[0] * cofactor[0] + m[5] * cofactor[5] + m[4] * cofactor[4];
    for (int k = 0; k < 6; k++) norm += (k < 3 ? 1 : 2) * cofactor[k] * cofactor[k];
    bool regular =
        trace > 0 && cofactor[0] > 0 && determinant > 0 && norm * minimum * minimum < determinant * determinant;
    if (regular && part == PLIANT_TWIST_EXACT) {
        for (int k = 0; k < 6; k++) d[k] = (k < 3 ? 2 * mu : 0) + factor * cofactor[k] / determinant;
    } else {
        const double full[9] = {m[0], m[5], m[4], m[5], m[1], m[3], m[4], m[3], m[2]};
        pliant_symmetric_eigen(full, values, vectors);
        memset(d, 0, sizeof d);
        for (int k = 0; k < 3; k++) {
            double c = 2 * mu + factor / fmax(values[k], minimum);
            if (part == PLIANT_TWIST_POSITIVE) c = fmax(c, 0);
            const double v[3] = {vectors[k], vectors[3 + k], vectors[6 + k]};
            d[0] += c * v[0] * v[0], d[1] += c * v[1] * v[1], d[2] += c * v[2] * v[2];
            d[3] += c * v[1] * v[2], d[4] += c * v[0] * v[2], d[5] += c * v[0] * v[1];
        }
    }
    /* R D R' */
    static const int row[6] = {0, 1, 2, 1, 0, 0}, column[6] = {0, 1, 2, 2, 2, 1};
    for (int k = 0; k < 6; k++) {
        const double *p = r + 3 * row[k], *q = r + 3 * column[k];
        out[k] = p[0] * (d[0] * q[0] + d[5] * q[1] + d[4] * q[2]) + p[1] * (d[5] * q[0] + d[1] * q[1] + d[3] * q[2]) +
                 p[2] * (d[4] * q[0] + d[3] * q[1] + d[2] * q[2]);
    }
}

void pliant_system_tangents(const pliant_system *system, const double *positions, pliant_twist twist,
                            pliant_tangent *tangents)
{
    if (system->macros) {
        pliant_macro_tangents(system, positions, tangents);
        return;
    }
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t block = 0; block < system->num_blocks; block++) {
        pliant_tangent *out = tangents + block;
        double x[12][LANES], f[9][LANES];
        load_corners(system, positions, block, x);
        block_rotations(x, system->gradients[block], out->rotation);
        const uint8_t *grounded = grounded_of(system, block);
        if (grounded) ground(grounded, out->rotation);
        memset(out->twist, 0, sizeof out->twist);
        if (system->stiffness) continue;
        deformation_of(x, system->gradients[block], f);
        for (int l = 0; l < LANES; l++) {
            double one[9], r[9], d[6];
            for (int m = 0; m < 9; m++) {
                one[m] = f[m][l];
                r[m] = out->rotation[m][l];
            }
            const int32_t e = block * LANES + l;
            const bool has_pressure = system->volume_pressure && e < system->mesh->num_tets;
            const double pressure = has_pressure ? system->volume_pressure[e] : 0;
            twist_of(one, r, system->lame[block][0][l], system->lame[block][1][l], pressure, twist, d);
            for (int m = 0; m < 6; m++) out->twist[m][l] = grounded && grounded[l] ? 0 : d[m];
        }
    }
}

void pliant_system_gather(const pliant_system *system, double (*forces)[12][LANES], double *out)
{
    if (system->macros) {
        pliant_macro_gather(system, (const double *)forces, out);
        return;
    }
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t n = 0; n < system->num_free; n++) {
        double sum[3] = {0, 0, 0};
        for (int32_t c = system->corner_start[n]; c < system->corner_end[n]; c++) {
            int32_t element = system->corner[c] / 4, corner = system->corner[c] % 4;
            for (int d = 0; d < 3; d++) sum[d] += forces[element / LANES][3 * corner + d][element % LANES];
        }
        memcpy(out + 3 * n, sum, sizeof sum);
    }
}

static void free_upsample(pliant_upsample *upsample)
{
    if (!upsample) return;
    pliant_free(upsample->node);
    pliant_free(upsample->weights);
    pliant_free(upsample->start);
    pliant_free(upsample->entry_element);
    pliant_free(upsample->entry_weight);
    pliant_free(upsample->entry_shape);
    pliant_free(upsample);
}

static void release_base(pliant_graded_base *base)
{
    if (!base || __atomic_sub_fetch(&base->holders, 1, __ATOMIC_ACQ_REL) > 0) return;
    pliant_macros_free(base->made);
    pliant_free(base->trace);
    pliant_free(base->element_of_tet);
    pliant_free(base);
}

static void free_graded(pliant_graded *graded)
{
    if (!graded) return;
    release_base(graded->base);
    pliant_mesh_free(&graded->mesh);
    void *blocks[] = {graded->used,       graded->refined, graded->tet, graded->unrefined_neighbour,
                      graded->in_refined, graded};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
}

void pliant_system_clear(pliant_system *system)
{
    pliant_free(system->gradients);
    pliant_free(system->lame);
    pliant_free(system->stiffness);
    pliant_free(system->raw_diagonal);
    pliant_free(system->grounded);
    pliant_free(system->free_of_node);
    pliant_free(system->node_of_free);
    pliant_free(system->corner_start);
    pliant_free(system->corner_end);
    pliant_free(system->corner);
    pliant_free(system->trace);
    pliant_free(system->pattern.start);
    pliant_free(system->pattern.row);
    pliant_free(system->pattern.term_start);
    pliant_free(system->pattern.term);
    pliant_free(system->gravity_mass);
    pliant_free(system->fine_mass);
    pliant_macros_free(system->macros);
    free_upsample(system->upsample);
    free_graded(system->graded);
    memset(system, 0, sizeof *system);
}
