/* Response of rigid pieces under contact points (contact_bodies.c), shared by CPU and GPU. */
#ifndef PLIANT_FEM_QUASISTATIC_RIGID_BODY_RULES_H
#define PLIANT_FEM_QUASISTATIC_RIGID_BODY_RULES_H

#include "base/inline.h"
#include "contact/solve/coupling_rules.h"

#include <math.h>
#include <stdint.h>

#define PLIANT_SMALL_ANGLE 1e-3 /* [rad]; below it the first term of a series is as accurate */

#ifdef __cplusplus
extern "C" {
#endif

/* A rigid body in contact during a step. It is a detached piece (fem/rigid), linearized around its estimated motion, or
 * the proxy of a tool (sim/step/proxy.h), linearized around its target. Only its coupling moves the proxy. */
typedef struct pliant_contact_body {
    double centre[3];      /* center of mass at the start of the step [m] */
    double free[6];        /* translation, and rotation about the center, without contact [m, rad] */
    double ahead[6];       /* estimated translation and rotation; initially equal to `free` [m, rad] */
    double compliance[36];     /* motion per force and torque about the center [m/N, rad/(N m)] */
    double young, size;    /* Young's modulus of its tissue [Pa], and cube root of its volume [m]: they set the contact
                            * compliance */
    int32_t num_young;     /* number of tetrahedra in the mean of young */
} pliant_contact_body;

/* Relation of a contact point to a rigid body: positions of its nodes relative to the body's center, multiplied by
 * the weights. */
typedef struct pliant_contact_arm {
    int32_t moving; /* index in pliant_contact_problem.moving */
    double weight, arm[3];
} pliant_contact_arm;

/* Compute the motion of the point with the piece along the axes of the point's frame: three rows for translation and
 * rotation. */
PLIANT_INLINE void pliant_arm_rows(const pliant_contact_arm *arm, const double frame[9], double rows[18])
{
    for (int r = 0; r < 3; r++)
        for (int d = 0; d < 3; d++) {
            const int e = (d + 1) % 3, f = (d + 2) % 3;
            rows[6 * r + d] = arm->weight * frame[3 * r + d];
            rows[6 * r + 3 + d] = arm->arm[e] * frame[3 * r + f] - arm->arm[f] * frame[3 * r + e];
        }
}

/* Add the force and torque of a force in the point's frame to load (6). */
PLIANT_INLINE void pliant_arm_load(const pliant_contact_arm *arm, const double frame[9], const double force[3],
                                   double load[6])
{
    double rows[18];
    pliant_arm_rows(arm, frame, rows);
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 6; k++) load[k] += rows[6 * r + k] * force[r];
}

/* Add the motion of the point in its frame to motion (3), for a given motion of the piece. */
PLIANT_INLINE void pliant_arm_move(const pliant_contact_arm *arm, const double frame[9], const double moved[6],
                                   double motion[3])
{
    double rows[18];
    pliant_arm_rows(arm, frame, rows);
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 6; k++) motion[r] += rows[6 * r + k] * moved[k];
}

/* Return component k of the piece's motion under a load, relative to the start of the step. */
PLIANT_INLINE double pliant_body_motion(const pliant_contact_body *piece, const double load[6], int k)
{
    double moved = piece->free[k];
    for (int l = 0; l < 6; l++) moved += piece->compliance[6 * k + l] * load[l];
    return moved;
}

/* Add a compliance to a body along a coupling. */
PLIANT_INLINE void pliant_coupling_soften_body(const pliant_coupling *of, double by, pliant_contact_body *body)
{
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            body->compliance[6 * (of->first + r) + of->first + c] +=
                by * (of->num_columns == 3 ? r == c : of->axis[r] * of->axis[c]);
}

/* Add the nonlinear part of a point's motion under the estimated rotation w: (R(w) - I - [w]) r, by Rodrigues'
 * formula. */
PLIANT_INLINE void pliant_arm_rotation_part(const pliant_contact_arm *arm, const pliant_contact_body *piece,
                                            double out[3])
{
    const double *w = piece->ahead + 3, *r = arm->arm, square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2],
                 angle = sqrt(square);
    const double s = angle > PLIANT_SMALL_ANGLE ? sin(angle) / angle - 1 : -square / 6,
                 c = angle > PLIANT_SMALL_ANGLE ? (1 - cos(angle)) / square : 0.5;
    double once[3];
    for (int d = 0; d < 3; d++) once[d] = w[(d + 1) % 3] * r[(d + 2) % 3] - w[(d + 2) % 3] * r[(d + 1) % 3];
    for (int d = 0; d < 3; d++)
        out[d] += s * once[d] + c * (w[(d + 1) % 3] * once[(d + 2) % 3] - w[(d + 2) % 3] * once[(d + 1) % 3]);
}

/* Add A of two points of one piece to block (9), in the points' frames. */
PLIANT_INLINE void pliant_arms_compliance(const pliant_contact_body *piece, const pliant_contact_arm *a,
                                          const double frame_a[9], const pliant_contact_arm *b, const double frame_b[9],
                                          double block[9])
{
    double mine[18], other[18];
    pliant_arm_rows(a, frame_a, mine);
    pliant_arm_rows(b, frame_b, other);
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < 6; k++) {
            double moved = 0;
            for (int l = 0; l < 6; l++) moved += piece->compliance[6 * k + l] * other[6 * c + l];
            for (int r = 0; r < 3; r++) block[3 * r + c] += mine[6 * r + k] * moved;
        }
}

#ifdef __cplusplus
}
#endif
#endif
