/* The deformation gradient of a block of elements, LANES at a time: for the files that loop over elements. */
#ifndef PLIANT_FEM_ELEMENT_DEFORMATION_H
#define PLIANT_FEM_ELEMENT_DEFORMATION_H

#include "fem/system.h"

/* corner positions of a block of elements: x (12 x LANES) */
static inline void load_corners(const pliant_system *system, const double *positions, int32_t block, double x[12][LANES])
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

/* F = sum over corners of x_v g_v' (any textbook on finite elements, e.g. Bonet and Wood, 9.2) */
static inline __attribute__((always_inline)) void deformation_of(double x[12][LANES], double g[12][LANES], double f[9][LANES])
{
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            for (int l = 0; l < LANES; l++)
                f[3 * r + c][l] = (x[3 + r][l] - x[r][l]) * g[3 + c][l] + (x[6 + r][l] - x[r][l]) * g[6 + c][l] +
                                  (x[9 + r][l] - x[r][l]) * g[9 + c][l];
}

/* R = I where an element says so */
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
