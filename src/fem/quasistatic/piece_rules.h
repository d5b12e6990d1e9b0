/* What rigid pieces under points of contact answer (contact_pieces.c), as the CPU and the GPU have it. */
#ifndef PLIANT_FEM_QUASISTATIC_PIECE_RULES_H
#define PLIANT_FEM_QUASISTATIC_PIECE_RULES_H

#include "base/inline.h"

#include <math.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A rigid body while it touches something, through a step: a piece that has come off (fem/rigid), to first order around how far it has been seen to go;
 * or the proxy of a tool (sim/step/proxy.h), which gives way by its coupling alone, around where it shall go. */
typedef struct pliant_touch_piece {
    double centre[3];      /* of mass, as the step begins [m] */
    double free[6];        /* how far it goes, and turns about its centre, if nothing touches it [m, rad] */
    double ahead[6];       /* how far it has been seen to go, and turn: at first as far as `free` [m, rad] */
    double answer[36];     /* what a force and a torque about its centre add to that [m/N, rad/(N m)] */
    double young, size;    /* of its tissue [Pa], and the cube root of its volume [m]: by them what presses it gives way */
    int32_t num_young;     /* tetrahedra that this is the mean of */
} pliant_touch_piece;

/* What a point has of a piece: where its weights' nodes are, times the weights, from the piece's centre. */
typedef struct pliant_touch_arm {
    int32_t moving; /* which of the pieces that points are of */
    double weight, arm[3];
} pliant_touch_arm;

/* How far the point goes with the piece, along the axes of its frame: rows of a force and of a torque that turns it. */
PLIANT_INLINE void pliant_arm_rows(const pliant_touch_arm *arm, const double frame[9], double rows[18])
{
    for (int r = 0; r < 3; r++)
        for (int d = 0; d < 3; d++) {
            const int e = (d + 1) % 3, f = (d + 2) % 3;
            rows[6 * r + d] = arm->weight * frame[3 * r + d];
            rows[6 * r + 3 + d] = arm->arm[e] * frame[3 * r + f] - arm->arm[f] * frame[3 * r + e];
        }
}

/* load (6) += of a force in the point's frame on the piece */
PLIANT_INLINE void pliant_arm_load(const pliant_touch_arm *arm, const double frame[9], const double force[3], double load[6])
{
    double rows[18];
    pliant_arm_rows(arm, frame, rows);
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 6; k++) load[k] += rows[6 * r + k] * force[r];
}

/* motion (3) += of the point, in its frame, where the piece has moved so */
PLIANT_INLINE void pliant_arm_move(const pliant_touch_arm *arm, const double frame[9], const double moved[6], double motion[3])
{
    double rows[18];
    pliant_arm_rows(arm, frame, rows);
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 6; k++) motion[r] += rows[6 * r + k] * moved[k];
}

/* How a piece moves under a load, from where the step begins: its own k'th number. */
PLIANT_INLINE double pliant_piece_moves(const pliant_touch_piece *piece, const double load[6], int k)
{
    double moved = piece->free[k];
    for (int l = 0; l < 6; l++) moved += piece->answer[6 * k + l] * load[l];
    return moved;
}

/* out += what the piece's turn ahead takes a point of it beyond w x r: (R(w) - I - [w]) r, by Rodrigues' formula */
PLIANT_INLINE void pliant_arm_bend(const pliant_touch_arm *arm, const pliant_touch_piece *piece, double out[3])
{
    const double *w = piece->ahead + 3, *r = arm->arm, square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2], angle = sqrt(square);
    const double s = angle > 1e-3 ? sin(angle) / angle - 1 : -square / 6, c = angle > 1e-3 ? (1 - cos(angle)) / square : 0.5;
    double once[3];
    for (int d = 0; d < 3; d++) once[d] = w[(d + 1) % 3] * r[(d + 2) % 3] - w[(d + 2) % 3] * r[(d + 1) % 3];
    for (int d = 0; d < 3; d++) out[d] += s * once[d] + c * (w[(d + 1) % 3] * once[(d + 2) % 3] - w[(d + 2) % 3] * once[(d + 1) % 3]);
}

/* block (9) += of A of two points of one piece, in their frames */
PLIANT_INLINE void pliant_arms_answer(const pliant_touch_piece *piece, const pliant_touch_arm *a, const double frame_a[9], const pliant_touch_arm *b, const double frame_b[9],
                                      double block[9])
{
    double mine[18], other[18];
    pliant_arm_rows(a, frame_a, mine);
    pliant_arm_rows(b, frame_b, other);
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < 6; k++) {
            double moved = 0;
            for (int l = 0; l < 6; l++) moved += piece->answer[6 * k + l] * other[6 * c + l];
            for (int r = 0; r < 3; r++) block[3 * r + c] += mine[6 * r + k] * moved;
        }
}

#ifdef __cplusplus
}
#endif
#endif
