#include "fem/dynamics/tled_cubes.h"

#include "base/fail.h"
#include "pliant/memory.h"

#include <math.h>
#include <string.h>

int32_t pliant_tled_blocks(const pliant_tled_system *system) { return system->num_blocks + (system->cubes ? system->cubes->num_blocks : 0); }

size_t pliant_tled_force_count(const pliant_tled_system *system)
{
    return ((size_t)system->num_blocks * 12 + (system->cubes ? (size_t)system->cubes->num_blocks * 24 : 0)) * LANES;
}

/* k_m over V mu, m > 0 with more than one bit */
static double hourglass_of(const double size[3], int mode)
{
    double sum = 0;
    for (int d = 0; d < 3; d++) sum += mode >> d & 1 ? 1 / (size[d] * size[d]) : 0;
    return (mode == 7 ? 40.0 / 81 : 10.0 / 7) * sum;
}

/* Of the mean gradient: as of a tetrahedron (tled_create.c) with sum of b b' = diag(1 / (2 h^2)); a mode of +-1 has the square 8. */
double pliant_cube_largest_eigenvalue(const double size[3], double lambda, double mu)
{
    double gram[6] = {0}, largest;
    for (int d = 0; d < 3; d++) gram[d] = 0.5 / (size[d] * size[d]);
    largest = pliant_gram_largest_eigenvalue(gram, lambda, mu);
    for (int m = 3; m < 8; m++)
        if (m != 4) largest = fmax(largest, mu * hourglass_of(size, m) / 8);
    return largest;
}

void pliant_tled_cube_size(const pliant_mesh *mesh, const pliant_tled_cubes *cubes, int32_t cube, double size[3])
{
    for (int d = 0; d < 3; d++) size[d] = mesh->cell_size[d] * (cubes->size ? cubes->size[cube] : 1);
}

double pliant_tled_cube_mean(const pliant_mesh *mesh, const pliant_cube *cube, const pliant_tet_material *material, double *lambda, double *mu,
                             double *density)
{
    double volume[5], lambdas[5], mus[5], gradients[12], whole = 0;
    for (int slot = 0; slot < 5; slot++) whole += volume[slot] = pliant_mesh_gradients(mesh, cube->tet[slot], gradients);
    pliant_cube_moduli(cube, volume, material, lambdas, mus);
    *lambda = *mu = *density = 0;
    for (int slot = 0; slot < 5; slot++) {
        *lambda += volume[slot] / whole * lambdas[slot];
        *mu += volume[slot] / whole * mus[slot];
        *density += volume[slot] / whole * material[cube->tet[slot]].density;
    }
    return whole;
}

static pliant_status allocate(const pliant_mesh *mesh, pliant_tled_cubes *cubes)
{
    pliant_status status = mesh->lattice_of_tet ? pliant_cubes_find(mesh, true, &cubes->cube, &cubes->count)
                                                : pliant_octree_cubes_find(mesh, &cubes->cube, &cubes->size, &cubes->count);
    if (status != PLIANT_OK) return status;
    cubes->num_blocks = (cubes->count + LANES - 1) / LANES;
    cubes->num_tets = mesh->num_tets - 5 * cubes->count;
    cubes->nodes = pliant_calloc((size_t)cubes->num_blocks + 1, sizeof *cubes->nodes);
    cubes->moduli = pliant_calloc((size_t)cubes->num_blocks + 1, sizeof *cubes->moduli);
    cubes->finer = pliant_calloc((size_t)cubes->num_blocks + 1, sizeof *cubes->finer);
    cubes->tet = pliant_calloc((size_t)cubes->num_tets + 1, sizeof *cubes->tet);
    cubes->element_of_tet = pliant_calloc((size_t)mesh->num_tets, sizeof *cubes->element_of_tet);
    cubes->node_mass = pliant_calloc((size_t)mesh->num_nodes, sizeof *cubes->node_mass);
    return cubes->nodes && cubes->moduli && cubes->finer && cubes->tet && cubes->element_of_tet && cubes->node_mass ? PLIANT_OK
                                                                                                      : pliant_fail_memory("the hexahedra");
}

static void fill_cube(const pliant_mesh *mesh, const pliant_tet_material *material, pliant_law law, pliant_tled_cubes *cubes, int32_t c)
{
    const pliant_cube *cube = cubes->cube + c;
    double volume[5], lambda[5], mu[5], gradients[12], mass = 0, sum[3] = {0, 0, 0};
    for (int slot = 0; slot < 5; slot++) {
        volume[slot] = pliant_mesh_gradients(mesh, cube->tet[slot], gradients);
        mass += volume[slot] * material[cube->tet[slot]].density;
    }
    pliant_cube_moduli(cube, volume, material, lambda, mu);
    for (int slot = 0; slot < 5; slot++) {
        sum[0] += volume[slot] * mu[slot];
        sum[1] += volume[slot] * pliant_law_modulus(law, lambda[slot], mu[slot]);
        sum[2] += volume[slot];
    }
    for (int m = 0; m < 3; m++) cubes->moduli[c / LANES][m][c % LANES] = (float)sum[m];
    for (int v = 0; v < 8; v++) cubes->node_mass[cube->node[v]] += mass / 8;
}

static void fill(const pliant_mesh *mesh, const pliant_tet_material *material, pliant_law law, double prony, pliant_tled_cubes *cubes)
{
    for (int axis = 0; axis < 3; axis++)
        for (int d = 0; d < 3; d++) cubes->gradient[3 * axis + d] = (float)(mesh->direction[3 * d + axis] / (4 * mesh->cell_size[axis]));
    for (int m = 3; m < 8; m++) cubes->hourglass[m] = m == 4 ? 0 : (float)((1 - prony) * hourglass_of(mesh->cell_size, m) / 64);
    for (int32_t t = 0; t < mesh->num_tets; t++) cubes->element_of_tet[t] = -1;
    int32_t tets = 0, first = (cubes->num_tets + LANES - 1) / LANES * LANES;
    for (int32_t c = 0; c < cubes->num_blocks * LANES; c++) {
        const int32_t cube = c < cubes->count ? c : cubes->count - 1; /* padding: the last one again, without stiffness */
        for (int v = 0; v < 8; v++) cubes->nodes[c / LANES][v][c % LANES] = cubes->cube[cube].node[v];
        cubes->finer[c / LANES][c % LANES] = 1.0f / (float)(cubes->size ? cubes->size[cube] : 1);
        if (cube != c) continue;
        fill_cube(mesh, material, law, cubes, c);
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

pliant_status pliant_tled_cubes_create(const pliant_mesh *mesh, const pliant_tet_material *material, pliant_law law, double prony,
                                       pliant_tled_cubes **out)
{
    pliant_tled_cubes *cubes = pliant_calloc(1, sizeof *cubes);
    if (!cubes) return pliant_fail_memory("the hexahedra");
    pliant_status status = allocate(mesh, cubes);
    if (status != PLIANT_OK) {
        pliant_tled_cubes_free(cubes);
        return status;
    }
    fill(mesh, material, law, prony, cubes);
    *out = cubes;
    return PLIANT_OK;
}

void pliant_tled_cubes_free(pliant_tled_cubes *cubes)
{
    if (!cubes) return;
    void *blocks[] = {cubes->cube, cubes->nodes, cubes->moduli, cubes->finer, cubes->size, cubes->tet, cubes->element_of_tet, cubes->node_mass};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
    pliant_free(cubes);
}
