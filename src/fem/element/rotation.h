/* The rotation nearest to a deformation gradient: R = U V' of the signed singular value decomposition. It is a proper
 * rotation in flat and inverted states as well (NUMERICS.md). */
#ifndef PLIANT_FEM_ELEMENT_ROTATION_H
#define PLIANT_FEM_ELEMENT_ROTATION_H

#include "fem/element/corotational.h"
#include "base/lanes.h"

#ifdef __cplusplus
extern "C" {
#endif
/* Compute eigenvalues, and eigenvectors in columns, of a symmetric matrix. */
void pliant_symmetric_eigen(const double matrix[9], double values[3], double vectors[9]);
/* Compute the rotation of one matrix in any state. deformation, rotation: 9, row-major. */
void pliant_rotation_signed_svd(const double deformation[9], double rotation[9]);
#ifdef __cplusplus
}
#endif

/* Compute the rotations of LANES matrices by Newton's iteration (corotational.h), and by the signed SVD for flat or
 * inverted lanes. */
static inline __attribute__((always_inline)) void pliant_rotations(double deformation[9][LANES],
                                                                   double rotation[9][LANES])
{
    double x[9][LANES], regular[LANES], change = 1;
    for (int l = 0; l < LANES; l++) {
        double one[9];
        for (int m = 0; m < 9; m++) one[m] = x[m][l] = deformation[m][l];
        regular[l] = pliant_rotation_regular(one);
    }
    for (int pass = 0; pass < PLIANT_ROTATION_PASSES && change > pliant_rotation_moved; pass++) {
        double moved[LANES];
        for (int l = 0; l < LANES; l++) {
            double one[9];
            for (int m = 0; m < 9; m++) one[m] = x[m][l];
            double step = pliant_rotation_pass(pass, one);
            moved[l] = regular[l] > 0 ? step : 0;
            for (int m = 0; m < 9; m++) x[m][l] = one[m];
        }
        change = 0;
        for (int l = 0; l < LANES; l++) change = moved[l] > change ? moved[l] : change;
    }
    for (int m = 0; m < 9; m++)
        for (int l = 0; l < LANES; l++) rotation[m][l] = x[m][l];
    for (int l = 0; l < LANES; l++) {
        if (regular[l] > 0) continue;
        double one[9], out[9];
        for (int m = 0; m < 9; m++) one[m] = deformation[m][l];
        pliant_rotation_signed_svd(one, out);
        for (int m = 0; m < 9; m++) rotation[m][l] = out[m];
    }
}

#endif
