/* P'KP of the fine elements in a coarse cube, and storage of a stiffness as its root. */
#include "fem/coarse/cubes.h"

#include "base/fail.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <string.h>

enum { UNKNOWNS = 24, CORNERS = 8 };

/* Add one fine element's part of P'KP without changes of volume, and of the mean change of volume. */
static void add_galerkin(const double *k, int n, const int32_t *local_of, const double *mean, double volume,
                         const double *weights, double *out, double *change)
{
    double half[UNKNOWNS * UNKNOWNS] = {0};
    for (int a = 0; a < 3 * n; a++)
        for (int b = 0; b < 3 * n; b++)
            for (int v = 0; v < CORNERS; v++)
                half[UNKNOWNS * a + 3 * v + b % 3] += k[3 * n * a + b] * weights[CORNERS * local_of[b / 3] + v];
    for (int a = 0; a < 3 * n; a++)
        for (int v = 0; v < CORNERS; v++) {
            const double weight = weights[CORNERS * local_of[a / 3] + v];
            change[3 * v + a % 3] += volume * mean[a] * weight;
            for (int i = 0; weight != 0 && i < UNKNOWNS; i++)
                out[UNKNOWNS * (3 * v + a % 3) + i] += weight * half[UNKNOWNS * a + i];
        }
}

void pliant_cube_galerkin(const pliant_submesh *submesh, const pliant_cube_buffers *buffers, double *out)
{
    double change[UNKNOWNS] = {0}, whole = 0, bulk = 0, k[UNKNOWNS * UNKNOWNS];
    int32_t local_of[CORNERS];
    memset(out, 0, UNKNOWNS * UNKNOWNS * sizeof *out);
    for (int32_t t = 0; t < submesh->num_tets; t++) {
        const int32_t tet = submesh->tets[t];
        bool alone;
        const pliant_cube *cube = pliant_cube_at(submesh, tet, &alone);
        double volume = 0, gradients[12];
        if (cube) {
            pliant_cube_shape made;
            const pliant_cube_shape *shape = pliant_submesh_shape(submesh, cube, &made);
            bulk += pliant_cube_deviatoric(shape, cube, submesh->material, 0, k);
            for (int slot = 0; slot < 5; slot++) volume += shape->volume[slot];
            for (int v = 0; v < CORNERS; v++) local_of[v] = submesh->local_of[cube->node[v]];
            add_galerkin(k, CORNERS, local_of, shape->mean, volume, buffers->weights, out, change);
        } else if (alone) {
            const pliant_tet_material *material = submesh->material + tet;
            volume = pliant_mesh_gradients(submesh->fine, tet, gradients);
            bulk += volume * (material->lambda + 2.0 / 3 * material->mu);
            pliant_element_stiffness(gradients, -2.0 / 3 * volume * material->mu, volume * material->mu, k);
            for (int v = 0; v < 4; v++) local_of[v] = submesh->local_of[submesh->fine->tets[4 * tet + v]];
            add_galerkin(k, 4, local_of, gradients, volume, buffers->weights, out, change);
        }
        whole += volume;
    }
    for (int i = 0; i < UNKNOWNS; i++)
        for (int j = 0; j < UNKNOWNS; j++) out[UNKNOWNS * i + j] += bulk * change[i] * change[j] / (whole * whole);
}

pliant_status pliant_cube_keep_root(pliant_macros *macros, int32_t element, int32_t unknowns, int32_t rank,
                                    const double *root)
{
    const size_t count = (size_t)rank * (size_t)unknowns;
    macros->rank[element] = rank;
    if (rank == 0) return PLIANT_OK;
    if (!(macros->root[element] = pliant_calloc(count, sizeof **macros->root)))
        return pliant_fail_memory("the coarse hexahedra");
    for (size_t m = 0; m < count; m++) macros->root[element][m] = (float)root[m];
    return PLIANT_OK;
}
