#include "fem/dynamics/tled_cubes.h"

#include "base/fail.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <math.h>
#include <string.h>

int32_t pliant_tled_blocks(const pliant_tled_system *system)
{
    return system->num_blocks + (system->cubes ? system->cubes->num_blocks : 0);
}

size_t pliant_tled_force_count(const pliant_tled_system *system)
{
    return ((size_t)system->num_blocks * 12 + (system->cubes ? (size_t)system->cubes->num_blocks * 24 : 0)) * LANES;
}

/* Constants of cube_bending.h. */
static const double contraction = 0.75, square_bar = 0.1406 * 6;

/* Compute the eigenvalues of gamma, divided by 1 / h of both axes, for the three modes. The matrix is symmetric with
 * zero diagonal. */
static void torsion_values(const double size[3], double out[3])
{
    const double gamma[6] = {0, 0, 0, 1 / size[2], 1 / size[1], 1 / size[0]};
    pliant_symmetric_eigenvalues(gamma, out);
    for (int d = 0; d < 3; d++) out[d] *= square_bar * out[d] * 4 / 3;
}

/* Return the stiffness of the mode of all axes, divided by V mu. */
static double twist_of(const double size[3])
{
    double sum = 0;
    for (int d = 0; d < 3; d++) sum += 1 / (size[d] * size[d]);
    return 40.0 / 81 * sum;
}

static double contraction_of(double lambda, double mu) { return contraction * lambda / (lambda + 2 * mu); }

/* Fill the bending stiffness. prony: sum of the shares. */
static void fill_bending(const pliant_mesh *mesh, double prony, pliant_cube_bending *out)
{
    const double left = (1 - prony) / 64;
    double torsion[3];
    torsion_values(mesh->cell_size, torsion);
    for (int axis = 0; axis < 3; axis++) {
        for (int d = 0; d < 3; d++) out->direction[3 * axis + d] = (float)mesh->direction[3 * d + axis];
        out->edge[axis] = (float)(1 / mesh->cell_size[axis]);
    }
    out->bending = (float)(left * 8 / 3);
    out->torsion = (float)(left * square_bar * 4 / 3);
    out->minimum = (float)(left * fmin(torsion[0], fmin(torsion[1], torsion[2])));
    out->twist = (float)(left * twist_of(mesh->cell_size));
}

/* Return the largest eigenvalue of the mean gradient and of the hourglass modes. The mean gradient is treated as for a
 * tetrahedron (tled_create.c), with sum of b b' = diag(1 / (2 h^2)). A mode of +-1 has the square 8. */
double pliant_cube_largest_eigenvalue(const double size[3], double lambda, double mu)
{
    const double c = contraction_of(lambda, mu);
    double gram[6] = {0}, torsion[3], largest;
    for (int d = 0; d < 3; d++) gram[d] = 0.5 / (size[d] * size[d]);
    torsion_values(size, torsion);
    largest = fmax(pliant_gram_largest_eigenvalue(gram, lambda, mu), mu / 8 * twist_of(size));
    for (int d = 0; d < 3; d++) {
        const double a = 1 / (size[d] * size[d]), b = 1 / (size[(d + 1) % 3] * size[(d + 1) % 3]);
        const double bending = (1 + c) * (a + b) + sqrt((1 + c) * (1 + c) * (a - b) * (a - b) + 4 * c * c * a * b);
        largest = fmax(largest, mu / 8 * fmax(torsion[d], 4.0 / 3 * bending));
    }
    return largest;
}

void pliant_tled_cube_size(const pliant_mesh *mesh, const pliant_tled_cubes *cubes, int32_t cube, double size[3])
{
    for (int d = 0; d < 3; d++) size[d] = mesh->cell_size[d] * (cubes->size ? cubes->size[cube] : 1);
}

double pliant_tled_cube_mean(const pliant_mesh *mesh, const pliant_cube *cube, const pliant_tet_material *material,
                             double *lambda, double *mu, double *density)
{
    double volume[5], lambdas[5], mus[5], gradients[12], whole = 0;
    for (int slot = 0; slot < 5; slot++)
        whole += volume[slot] = pliant_mesh_gradients(mesh, cube->tet[slot], gradients);
    pliant_cube_moduli(cube, volume, material, lambdas, mus);
    *lambda = *mu = *density = 0;
    for (int slot = 0; slot < 5; slot++) {
        *lambda += volume[slot] / whole * lambdas[slot];
        *mu += volume[slot] / whole * mus[slot];
        *density += volume[slot] / whole * material[cube->tet[slot]].density;
    }
    return whole;
}

/* Leave fragments as tetrahedra for laws with a second rest state inside out. Hexahedra would be softer, and inverted
 * there where a fallen end was put back (src/fem/element/NUMERICS.md). */
static void leave_parts(pliant_tled_cubes *cubes)
{
    const int32_t count = cubes->count;
    cubes->count = 0;
    for (int32_t c = 0; c < count; c++)
        if (!cubes->cube[c].part) cubes->cube[cubes->count++] = cubes->cube[c];
}

static pliant_status allocate(const pliant_mesh *mesh, pliant_law law, pliant_tled_cubes *cubes)
{
    pliant_status status = mesh->lattice_of_tet
                               ? pliant_cubes_find(mesh, true, &cubes->cube, &cubes->count)
                               : pliant_octree_cubes_find(mesh, &cubes->cube, &cubes->size, &cubes->count);
    if (status != PLIANT_OK) return status;
    if (law == PLIANT_LAW_SAINT_VENANT_KIRCHHOFF) leave_parts(cubes);
    cubes->num_blocks = (cubes->count + LANES - 1) / LANES;
    cubes->num_tets = mesh->num_tets - 5 * cubes->count;
    cubes->nodes = pliant_calloc((size_t)cubes->num_blocks + 1, sizeof *cubes->nodes);
    cubes->moduli = pliant_calloc((size_t)cubes->num_blocks + 1, sizeof *cubes->moduli);
    cubes->finer = pliant_calloc((size_t)cubes->num_blocks + 1, sizeof *cubes->finer);
    cubes->tet = pliant_calloc((size_t)cubes->num_tets + 1, sizeof *cubes->tet);
    cubes->element_of_tet = pliant_calloc((size_t)mesh->num_tets, sizeof *cubes->element_of_tet);
    cubes->node_mass = pliant_calloc((size_t)mesh->num_nodes, sizeof *cubes->node_mass);
    return cubes->nodes && cubes->moduli && cubes->finer && cubes->tet && cubes->element_of_tet && cubes->node_mass
               ? PLIANT_OK
               : pliant_fail_memory("the hexahedra");
}

/* The bending stiffness includes the complete lambda. */
static void fill_cube(const pliant_mesh *mesh, const pliant_tet_material *material,
                      const pliant_tet_material *complete, pliant_law law, double prony, double stiffening,
                      pliant_tled_cubes *cubes, int32_t c)
{
    const pliant_cube *cube = cubes->cube + c;
    double volume[5], lambda[5], mu[5], all[5], gradients[12], mass = 0, sum[3] = {0, 0, 0};
    float (*moduli)[LANES] = cubes->moduli[c / LANES];
    for (int slot = 0; slot < 5; slot++) {
        volume[slot] = pliant_mesh_gradients(mesh, cube->tet[slot], gradients);
        mass += volume[slot] * material[cube->tet[slot]].density;
    }
    pliant_cube_moduli(cube, volume, complete, all, mu);
    pliant_cube_moduli(cube, volume, material, lambda, mu);
    for (int slot = 0; slot < 5; slot++) {
        sum[0] += volume[slot] * mu[slot] * stiffening;
        sum[1] += volume[slot] * pliant_law_modulus(law, lambda[slot], mu[slot]);
        sum[2] += volume[slot] * all[slot];
    }
    moduli[0][c % LANES] = (float)sum[0];
    moduli[1][c % LANES] = (float)sum[1];
    moduli[2][c % LANES] = (float)contraction_of(sum[2], (1 - prony) * sum[0]);
    for (int v = 0; v < 8; v++) cubes->node_mass[cube->node[v]] += mass / 8;
}

static void fill(const pliant_mesh *mesh, const pliant_tet_material *material, const pliant_tet_material *complete,
                 pliant_law law, double prony, double stiffening, pliant_tled_cubes *cubes)
{
    for (int axis = 0; axis < 3; axis++)
        for (int d = 0; d < 3; d++)
            cubes->gradient[3 * axis + d] = (float)(mesh->direction[3 * d + axis] / (4 * mesh->cell_size[axis]));
    fill_bending(mesh, prony, &cubes->bending);
    for (int32_t t = 0; t < mesh->num_tets; t++) cubes->element_of_tet[t] = -1;
    int32_t tets = 0, first = (cubes->num_tets + LANES - 1) / LANES * LANES;
    for (int32_t c = 0; c < cubes->num_blocks * LANES; c++) {
        /* Padding repeats the last cube without stiffness. */
        const int32_t cube = c < cubes->count ? c : cubes->count - 1;
        for (int v = 0; v < 8; v++) cubes->nodes[c / LANES][v][c % LANES] = cubes->cube[cube].node[v];
        cubes->finer[c / LANES][c % LANES] = 1.0f / (float)(cubes->size ? cubes->size[cube] : 1);
        if (cube != c) continue;
        fill_cube(mesh, material, complete, law, prony, stiffening, cubes, c);
        for (int slot = 0; slot < 5; slot++) cubes->element_of_tet[cubes->cube[c].tet[slot]] = first + c;
    }
    for (int32_t t = 0; t < mesh->num_tets; t++) {
        if (cubes->element_of_tet[t] >= 0) continue;
        double gradients[12], mass = pliant_mesh_gradients(mesh, t, gradients) * material[t].density;
        for (int v = 0; v < 4; v++) cubes->node_mass[mesh->tets[4 * t + v]] += mass / 4;
        cubes->element_of_tet[t] = tets;
        cubes->tet[tets++] = t;
    }
}

pliant_status pliant_tled_cubes_create(const pliant_mesh *mesh, const pliant_tet_material *material,
                                       const pliant_tet_material *complete, pliant_law law, double prony,
                                       double stiffening, pliant_tled_cubes **out)
{
    pliant_tled_cubes *cubes = pliant_calloc(1, sizeof *cubes);
    if (!cubes) return pliant_fail_memory("the hexahedra");
    pliant_status status = allocate(mesh, law, cubes);
    if (status != PLIANT_OK) {
        pliant_tled_cubes_free(cubes);
        return status;
    }
    fill(mesh, material, complete, law, prony, stiffening, cubes);
    *out = cubes;
    return PLIANT_OK;
}

void pliant_tled_cubes_free(pliant_tled_cubes *cubes)
{
    if (!cubes) return;
    void *blocks[] = {cubes->cube, cubes->nodes, cubes->moduli,         cubes->finer,
                      cubes->size, cubes->tet,   cubes->element_of_tet, cubes->node_mass};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
    pliant_free(cubes);
}
