/* The rotation of a deformation gradient, the one nearest to it: R = U V' of the signed singular value decomposition, so
 * that it is a rotation through flat and inverted states as well (NUMERICS 5).
 *
 * Elements are taken LANES at a time, lane innermost, so that the compiler makes vector code of plain loops. */
#ifndef PLIANT_FEM_ELEMENT_ROTATION_H
#define PLIANT_FEM_ELEMENT_ROTATION_H

#include <math.h>

enum { LANES = 8 };

/* Vector code for the machine at hand, chosen when the program starts. Machines that fuse products and sums round otherwise. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
#define PLIANT_VECTORIZED __attribute__((target_clones("avx512f", "avx2", "default"), optimize("O3")))
#else
#define PLIANT_VECTORIZED
#endif

#ifdef __cplusplus
extern "C" {
#endif
/* Eigenvalues, and eigenvectors in columns, of a symmetric matrix. */
void pliant_symmetric_eigen(const double matrix[9], double values[3], double vectors[9]);
/* One matrix, any state. deformation, rotation: 9, row-major. */
void pliant_rotation_signed_svd(const double deformation[9], double rotation[9]);
#ifdef __cplusplus
}
#endif

/* LANES matrices: Newton's iteration X <- (s X + X^-T / s) / 2 (Higham 1986) with determinant scaling, and the signed
 * SVD for lanes that are flat or inverted. */
static inline __attribute__((always_inline)) void pliant_rotations(double deformation[9][LANES], double rotation[9][LANES])
{
    double x[9][LANES], regular[LANES];
    for (int l = 0; l < LANES; l++) {
        double norm = 0;
        for (int m = 0; m < 9; m++) {
            x[m][l] = deformation[m][l];
            norm += x[m][l] * x[m][l];
        }
        double determinant = x[0][l] * (x[4][l] * x[8][l] - x[5][l] * x[7][l]) - x[1][l] * (x[3][l] * x[8][l] - x[5][l] * x[6][l]) +
                             x[2][l] * (x[3][l] * x[7][l] - x[4][l] * x[6][l]);
        regular[l] = determinant - 1e-4 * norm * sqrt(norm);
    }
    double change = 1;
    for (int pass = 0; pass < 12 && change > 1e-15; pass++) {
        double step[LANES];
        for (int l = 0; l < LANES; l++) {
            double c0 = x[4][l] * x[8][l] - x[5][l] * x[7][l], c1 = x[5][l] * x[6][l] - x[3][l] * x[8][l];
            double c2 = x[3][l] * x[7][l] - x[4][l] * x[6][l], c3 = x[2][l] * x[7][l] - x[1][l] * x[8][l];
            double c4 = x[0][l] * x[8][l] - x[2][l] * x[6][l], c5 = x[1][l] * x[6][l] - x[0][l] * x[7][l];
            double c6 = x[1][l] * x[5][l] - x[2][l] * x[4][l], c7 = x[2][l] * x[3][l] - x[0][l] * x[5][l];
            double c8 = x[0][l] * x[4][l] - x[1][l] * x[3][l];
            double determinant = x[0][l] * c0 + x[1][l] * c1 + x[2][l] * c2;
            double scale = 1;
            if (pass < 2) { /* only far from a rotation; near it, it is one anyway. s^2 = |X^-1| / |X| (Frobenius) */
                double norm = 0, cofactor = 0;
                for (int m = 0; m < 9; m++) norm += x[m][l] * x[m][l];
                cofactor = c0 * c0 + c1 * c1 + c2 * c2 + c3 * c3 + c4 * c4 + c5 * c5 + c6 * c6 + c7 * c7 + c8 * c8;
                scale = sqrt(sqrt(cofactor / (norm * determinant * determinant)));
            }
            double a = 0.5 * scale, b = 0.5 / (scale * determinant), moved = 0;
            double next[9] = {a * x[0][l] + b * c0, a * x[1][l] + b * c1, a * x[2][l] + b * c2,
                              a * x[3][l] + b * c3, a * x[4][l] + b * c4, a * x[5][l] + b * c5,
                              a * x[6][l] + b * c6, a * x[7][l] + b * c7, a * x[8][l] + b * c8};
            for (int m = 0; m < 9; m++) {
                moved += (next[m] - x[m][l]) * (next[m] - x[m][l]);
                x[m][l] = next[m];
            }
            step[l] = regular[l] > 0 ? moved : 0;
        }
        change = 0;
        for (int l = 0; l < LANES; l++) change = step[l] > change ? step[l] : change;
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
