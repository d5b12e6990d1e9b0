/* One macro-element (fem/system.h) in one state, shared by the CPU (macro.c) and kernels
 * (cuda/fem/element/macro.cu). */
#ifndef PLIANT_FEM_ELEMENT_MACRO_ELEMENT_H
#define PLIANT_FEM_ELEMENT_MACRO_ELEMENT_H

#include "base/inline.h"

#include <stdbool.h>
#include <stdint.h>

typedef struct pliant_macro_frame { double rotation[9], centre[3], rest_centre[3]; } pliant_macro_frame;

/* Compute the frame without its rotation. f: out: sum of x_v g_v', from which the caller computes the rotation.
 * @param own       (8) nodes of the cube, or -1.
 * @param gradient  (8 x 3) g.
 * @param x, rest   Positions of all nodes. */
PLIANT_INLINE void pliant_macro_find_frame(const int32_t *own, const double *gradient, const double *x,
                                           const double *rest, double f[9], pliant_macro_frame *out)
{
    int count = 0;
    for (int m = 0; m < 9; m++) f[m] = 0;
    for (int d = 0; d < 3; d++) out->centre[d] = out->rest_centre[d] = 0;
    for (int v = 0; v < 8; v++)
        for (int r = 0; r < 3 && own[v] >= 0; r++) {
            count += r == 0;
            out->centre[r] += x[3 * own[v] + r];
            out->rest_centre[r] += rest[3 * own[v] + r];
        }
    const double fraction = 1.0 / count;
    for (int d = 0; d < 3; d++) out->centre[d] *= fraction, out->rest_centre[d] *= fraction;
    for (int v = 0; v < 8; v++)
        for (int r = 0; r < 3 && own[v] >= 0; r++)
            for (int c = 0; c < 3; c++) f[3 * r + c] += (x[3 * own[v] + r] - out->centre[r]) * gradient[3 * v + c];
}

/* Compute q of a corner at x with rest position X. */
PLIANT_INLINE void pliant_macro_corner(const pliant_macro_frame *frame, bool held, const double *x, const double *rest,
                                       double q[3])
{
    const double *r = frame->rotation;
    double y[3];
    for (int d = 0; d < 3; d++) y[d] = x[d] - (held ? rest[d] : frame->centre[d]);
    for (int d = 0; d < 3; d++)
        q[d] = r[d] * y[0] + r[3 + d] * y[1] + r[6 + d] * y[2] - (held ? 0 : rest[d] - frame->rest_centre[d]);
}

/* Rotate w with the cube: R w. */
PLIANT_INLINE void pliant_macro_turn(const double r[9], const double w[3], double out[3])
{
    for (int d = 0; d < 3; d++) out[d] = r[3 * d] * w[0] + r[3 * d + 1] * w[1] + r[3 * d + 2] * w[2];
}

/* Compute N q of a fine node from the entries [begin, end) of its cube. */
PLIANT_INLINE void pliant_macro_shaped(int32_t begin, int32_t end, const uint16_t *entry_corner,
                                       const float *entry_shape, const double *q, double out[3])
{
    for (int d = 0; d < 3; d++) out[d] = 0;
    for (int32_t e = begin; e < end; e++) {
        const float *n = entry_shape + 9 * (int64_t)e;
        const double *at = q + 3 * entry_corner[e];
        for (int d = 0; d < 3; d++) out[d] += n[3 * d] * at[0] + n[3 * d + 1] * at[1] + n[3 * d + 2] * at[2];
    }
}

/* Compute the same for an element with so many corners. shape: N, 3 x 3 corners, row-major. */
PLIANT_INLINE void pliant_macro_shaped_by_all(int corners, const double *shape, const double *q, double out[3])
{
    for (int d = 0; d < 3; d++) {
        out[d] = 0;
        for (int m = 0; m < 3 * corners; m++) out[d] += shape[3 * corners * d + m] * q[m];
    }
}

/* Move a fine node from its rest position x, with w = N q. The sum of displacements is exact at rest: (c - C) + (R -
 * I)(X - C) + R w, or w alone if the cube is grounded. */
PLIANT_INLINE void pliant_macro_follow(const pliant_macro_frame *frame, bool grounded, const double w[3], double x[3])
{
    const double *r = frame->rotation;
    double u[3], y[3];
    for (int d = 0; d < 3; d++) y[d] = x[d] - frame->rest_centre[d];
    pliant_macro_turn(r, w, u);
    for (int d = 0; d < 3; d++) {
        if (!grounded)
            u[d] += frame->centre[d] - frame->rest_centre[d] +
                    (r[3 * d] * y[0] + r[3 * d + 1] * y[1] + r[3 * d + 2] * y[2] - y[d]);
        x[d] += u[d];
    }
}

#endif
