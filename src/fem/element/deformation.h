/* The deformation gradient of a block of elements, LANES at a time, for files that loop over elements. */
#ifndef PLIANT_FEM_ELEMENT_DEFORMATION_H
#define PLIANT_FEM_ELEMENT_DEFORMATION_H

#include "fem/element/corotational.h"
#include "fem/system.h"

/* Load the corner positions of a block of elements: x (12 x LANES). */
static inline void load_corners(const pliant_system *system, const double *positions, int32_t block,
                                double x[12][LANES])
{
    const pliant_mesh *mesh = system->mesh;
    for (int l = 0; l < LANES; l++) {
        int32_t tet = block * LANES + l;
        if (tet >= mesh->num_tets) tet = mesh->num_tets - 1;
        const int32_t *nodes = mesh->tets + 4 * tet;
        for (int v = 0; v < 4; v++)
            for (int d = 0; d < 3; d++) x[3 * v + d][l] = positions[3 * nodes[v] + d];
    }
}

static inline __attribute__((always_inline)) void deformation_of(double x[12][LANES], double g[12][LANES],
                                                                 double f[9][LANES])
{
    for (int l = 0; l < LANES; l++) {
        double corners[12], gradients[12], one[9];
        for (int m = 0; m < 12; m++) corners[m] = x[m][l], gradients[m] = g[m][l];
        pliant_deformation(corners, gradients, one);
        for (int m = 0; m < 9; m++) f[m][l] = one[m];
    }
}

/* Set R = I for grounded elements. */
static inline void ground(const uint8_t grounded[LANES], double rotations[9][LANES])
{
    for (int l = 0; l < LANES; l++)
        for (int m = 0; grounded[l] && m < 9; m++) rotations[m][l] = m % 4 == 0;
}

static inline const uint8_t *grounded_of(const pliant_system *system, int32_t block)
{
    return system->grounded ? system->grounded + LANES * (size_t)block : NULL;
}

#endif
