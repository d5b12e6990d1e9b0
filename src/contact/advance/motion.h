/* The motion of a part's core during a leg, and bounds of it. */
#ifndef PLIANT_CONTACT_ADVANCE_MOTION_H
#define PLIANT_CONTACT_ADVANCE_MOTION_H

#include "contact/advance/advance.h"
#include "contact/shapes/shapes.h"

/* The part's state at one time. */
typedef struct pliant_advance_state {
    pliant_pose pose;
    double tip[3], joint[3], axis[3];
} pliant_advance_state;

enum { PLIANT_ADVANCE_INTERVALS = 4 };

/* Vectors are in the scan's axes unless noted; rates are per leg. */
typedef struct pliant_advance_motion {
    const pliant_advance_part *leg;
    bool still;              /* the part stays at its first pose */
    pliant_part core;        /* the part, reduced by the guard depth */
    double tip_rate[3];      /* of the tip [m] */
    double turn_rate[3];     /* rotation vector of the tool [rad] */
    double turn, jaw;        /* length of turn_rate; rate of the part's frame about the joint, with its sign [rad] */
    double axis[3];          /* of the joint, unit, in the tool's frame */
    double reach, jaw_reach; /* largest distance of a point of the core from the tip, from the joint [m] */
    double bend;             /* largest acceleration of a point of the core [m] */
    double low[3], high[3];  /* box around the core throughout the leg */
    double speed;            /* largest speed of a point of the core relative to the tip [m] */
    pliant_advance_state at[1 + PLIANT_ADVANCE_INTERVALS]; /* states at 1/2, and at the middles of equal intervals */
} pliant_advance_motion;

/* Initialize the motion. still: the part stays at its first pose */
void pliant_advance_motion_init(const pliant_advance_part *leg, bool still, pliant_advance_motion *out);
/* Compute the part's state at a fraction t of the leg. */
void pliant_advance_motion_at(const pliant_advance_motion *motion, double t, pliant_advance_state *out);
/* Compute the velocity of the part's point at x. */
void pliant_advance_motion_velocity(const pliant_advance_motion *motion, const pliant_advance_state *state,
                                    const double x[3], double out[3]);
/* Return a bound of the acceleration of the part's point at x, from this time on. */
double pliant_advance_motion_max_acceleration(const pliant_advance_motion *motion, const pliant_advance_state *state,
                                              const double x[3]);
/* Compute the angular velocity of the part. */
void pliant_advance_motion_angular_velocity(const pliant_advance_motion *motion, const pliant_advance_state *state,
                                            double out[3]);

#endif
