/* Largest stable time steps at rest. If the tissue can be cut, the bounds cover all fragments that cuts can make.
 * Stiffness and density of a fragment are sums over its voxels, so its ratio of stiffness to mass is at most the
 * largest ratio of a single voxel. Each tetrahedron is therefore bounded with every material in it and in its
 * neighbours, whose detached voxels can move with it. No cut can break this bound. */
#include "base/fail.h"
#include "fem/dynamics/tled_cubes.h"
#include "fem/dynamics/tled_pressure.h"
#include "fem/element/pressures.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <math.h>
#include <string.h>

double pliant_tled_shortest_edge(const pliant_mesh *mesh, const int32_t *nodes)
{
    double minimum = INFINITY;
    for (int a = 0; a < 4; a++)
        for (int b = 0; b < a; b++) {
            double sum = 0;
            for (int d = 0; d < 3; d++) sum += pow(mesh->rest[3 * nodes[a] + d] - mesh->rest[3 * nodes[b] + d], 2);
            minimum = fmin(minimum, sqrt(sum));
        }
    return minimum;
}

/* Return the stable step. An oscillation of frequency w, with the shear part w_s damped by b w_s^2 times the velocity
 * of the last sub-step, follows
 *     x+ - 2 x + x- = - dt^2 w^2 x - dt b w_s^2 (x - x-)
 * Its roots stay in the unit circle while  dt^2 w^2 + 2 dt b w_s^2 <= 4  (Jury). w^2 is at most 4 largest / density,
 * with a mass of rho V / 4 at each corner. Without damping the bound is 2 / w. */
static double stable_step(double density, double largest, double largest_shear, double damping)
{
    const double slow = damping * largest_shear;
    return density / (slow + sqrt(slow * slow + largest * density));
}

static void take(pliant_tled_system *system, const double gradients[12], double edge, double lambda,
                 const pliant_tet_material *material)
{
    const double mu = material->mu * system->stiffening, density = material->density;
    if (!(density > 0)) return;
    /* [C] 1 with rho c^2 = E (1 - nu) / ((1 + nu) (1 - 2 nu)) = lambda + 2 mu */
    system->edge_bound = fmin(system->edge_bound, edge * sqrt(density / (lambda + 2 * mu)));
    system->eigenvalue_bound =
        fmin(system->eigenvalue_bound,
             stable_step(density, pliant_element_largest_eigenvalue(gradients, lambda, mu),
                         pliant_element_largest_eigenvalue(gradients, 0, mu), system->stiffness_damping));
}

/* Return bit sets (num_tets x 4) of the materials at load time, in each tetrahedron's voxels and in adjacent
 * tetrahedra. */
static uint64_t *materials_around(const pliant_voxels *voxels)
{
    uint64_t *of_tet = pliant_calloc((size_t)voxels->num_tets, 4 * sizeof *of_tet),
             *around = pliant_calloc((size_t)voxels->num_tets, 4 * sizeof *around);
    for (int32_t t = 0; of_tet && around && t < voxels->num_tets; t++)
        for (int32_t v = voxels->start[t]; v < voxels->start[t + 1]; v++)
            of_tet[4 * t + voxels->material[v] / 64] |= UINT64_C(1) << voxels->material[v] % 64;
    for (int32_t n = 0; of_tet && around && n < voxels->num_nodes; n++) {
        uint64_t all[4] = {0, 0, 0, 0};
        const int32_t *corner = voxels->around + voxels->around_start[n],
                      count = voxels->around_start[n + 1] - voxels->around_start[n];
        for (int32_t c = 0; c < count; c++)
            for (int w = 0; w < 4; w++) all[w] |= of_tet[4 * (corner[c] / 4) + w];
        for (int32_t c = 0; c < count; c++)
            for (int w = 0; w < 4; w++) around[4 * (corner[c] / 4) + w] |= all[w];
    }
    pliant_free(of_tet);
    return around;
}

/* Include the hexahedra: an eighth of their mass is at each corner. */
static void take_cubes(const pliant_body *body, pliant_tled_system *system)
{
    const pliant_tet_material *material = system->groups ? system->groups->soft : body->fine_material;
    for (int32_t c = 0; c < system->cubes->count; c++) {
        const pliant_cube *cube = system->cubes->cube + c;
        double size[3], lambda, mu, density;
        bool moves = false;
        pliant_tled_cube_size(system->mesh, system->cubes, c, size);
        const double edge = fmin(size[0], fmin(size[1], size[2]));
        pliant_tled_cube_mean(system->mesh, cube, material, &lambda, &mu, &density);
        mu *= system->stiffening;
        for (int v = 0; v < 8; v++) moves = moves || !body->fine_fixed[cube->node[v]];
        if (!moves || !(density > 0)) continue;
        system->edge_bound = fmin(system->edge_bound, edge * sqrt(density / (lambda + 2 * mu)));
        system->eigenvalue_bound =
            fmin(system->eigenvalue_bound,
                 stable_step(0.5 * density, pliant_cube_largest_eigenvalue(size, lambda, mu),
                             pliant_cube_largest_eigenvalue(size, 0, mu), system->stiffness_damping));
    }
}

/* Return the lambda of a fragment's stiffness, from one of its materials. Pressures leave it at most PLIANT_SOFT_RATIO
 * times the mean mu, which can be more than the mean of the voxels' own values. */
static double fragment_lambda(const pliant_tled_system *system, const pliant_tet_material *material)
{
    return system->groups && material->tissue > 0 ? PLIANT_SOFT_RATIO * material->mu : material->lambda;
}

pliant_status pliant_tled_find_bounds(const pliant_body *body, pliant_tled_system *system)
{
    const pliant_mesh *mesh = system->mesh;
    const pliant_voxels *voxels = body->voxels;
    const pliant_tet_material *material = system->groups ? system->groups->soft : body->fine_material;
    uint64_t *around = NULL;
    if (voxels && !(around = materials_around(voxels))) return pliant_fail_memory("the bounds of the time step");
    system->edge_bound = system->eigenvalue_bound = INFINITY;
    for (int32_t t = 0; t < mesh->num_tets; t++) {
        const int32_t *nodes = mesh->tets + 4 * t;
        double gradients[12];
        if (system->cubes && !voxels && system->cubes->element_of_tet[t] >= system->num_blocks * LANES) continue;
        if (body->fine_fixed[nodes[0]] && body->fine_fixed[nodes[1]] && body->fine_fixed[nodes[2]] &&
            body->fine_fixed[nodes[3]])
            continue;
        const double edge = pliant_tled_shortest_edge(mesh, nodes);
        pliant_mesh_gradients(mesh, t, gradients);
        take(system, gradients, edge, material[t].lambda, material + t);
        for (int32_t m = 0; voxels && t < voxels->num_tets && m < voxels->num_materials; m++) {
            const pliant_tet_material *part = voxels->of_material + m;
            if (around[4 * t + m / 64] >> m % 64 & 1)
                take(system, gradients, edge, fragment_lambda(system, part), part);
        }
    }
    if (system->cubes) take_cubes(body, system);
    pliant_free(around);
    return PLIANT_OK;
}
