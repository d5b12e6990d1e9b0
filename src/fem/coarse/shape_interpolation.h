/* Position of a fine node that follows one coarse tetrahedron by homogenized shape functions N. The CPU (upsample.c)
 * and kernels (cuda/fem/coarse/upsample.cu) share this code. Corners are 4 x 3, row-major.
 *
 * In the frame of the tetrahedron ([H] 4, 5 and 7):
 *     x_f = R (N u_c + X_f - C) + c,  u_c = R'(x_c - c) - (X_c - C)
 * with c and C the means of its corners in the present and rest state. This form requires that N reproduces rigid
 * motions. After fixed fine nodes have been removed from the submesh ([H] 4.2) it does not, since N then describes
 * displacements relative to fixed nodes. There R = I and c = C = 0, so that  x_f = X_f + N (x_c - X_c), as in the
 * tetrahedron's forces (elements.c). */
#ifndef PLIANT_FEM_COARSE_SHAPE_INTERPOLATION_H
#define PLIANT_FEM_COARSE_SHAPE_INTERPOLATION_H

#include "base/inline.h"

typedef struct pliant_shaped_frame { double rotation[9], centre[3], rest_centre[3]; } pliant_shaped_frame;

/* Compute the frame without its rotation. f: out: F = sum of x_v g_v', from which the caller computes the rotation. */
PLIANT_INLINE void pliant_shaped_find_frame(const double x[12], const double rest[12], const double gradients[12],
                                            double f[9], pliant_shaped_frame *out)
{
    for (int d = 0; d < 3; d++) out->centre[d] = out->rest_centre[d] = 0;
    for (int m = 0; m < 9; m++) f[m] = 0;
    for (int v = 0; v < 4; v++)
        for (int r = 0; r < 3; r++) {
            out->centre[r] += 0.25 * x[3 * v + r];
            out->rest_centre[r] += 0.25 * rest[3 * v + r];
            for (int c = 0; c < 3; c++) f[3 * r + c] += (x[3 * v + r] - x[r]) * gradients[3 * v + c];
        }
}

/* Set the frame of a tetrahedron whose submesh has fixed nodes. */
PLIANT_INLINE void pliant_shaped_ground(pliant_shaped_frame *out)
{
    for (int m = 0; m < 9; m++) out->rotation[m] = m % 4 == 0;
    for (int d = 0; d < 3; d++) out->centre[d] = out->rest_centre[d] = 0;
}

/* Compute the position of a fine node. shape: N, 3 x 12; node: X_f. */
PLIANT_INLINE void pliant_shaped_position(const pliant_shaped_frame *frame, const double x[12], const double rest[12],
                                          const double *shape, const double *node, double out[3])
{
    const double *rotation = frame->rotation;
    double u[12], local[3];
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++) {
            u[3 * v + d] = -(rest[3 * v + d] - frame->rest_centre[d]);
            for (int r = 0; r < 3; r++) u[3 * v + d] += rotation[3 * r + d] * (x[3 * v + r] - frame->centre[r]);
        }
    for (int d = 0; d < 3; d++) {
        local[d] = node[d] - frame->rest_centre[d];
        for (int m = 0; m < 12; m++) local[d] += shape[12 * d + m] * u[m];
    }
    for (int d = 0; d < 3; d++)
        out[d] = rotation[3 * d] * local[0] + rotation[3 * d + 1] * local[1] + rotation[3 * d + 2] * local[2] +
                 frame->centre[d];
}

/* Compute dx_f / dx_v of one of the corners with constant rotation ([H] 9 and 11): R N_v R', 3 x 3. */
PLIANT_INLINE void pliant_shaped_weight(const double rotation[9], const double *shape, int corners, int v,
                                        double out[9])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            out[3 * i + j] = 0;
            for (int k = 0; k < 3; k++)
                for (int l = 0; l < 3; l++)
                    out[3 * i + j] += rotation[3 * i + k] * shape[3 * corners * k + 3 * v + l] * rotation[3 * j + l];
        }
}

#endif
