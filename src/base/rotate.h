/* Rotations by quaternions x y z w of any length. */
#ifndef PLIANT_BASE_ROTATE_H
#define PLIANT_BASE_ROTATE_H

#ifdef __cplusplus
extern "C" {
#endif

/* Rotate v by a quaternion; 0 0 0 0 leaves it unchanged. */
void pliant_rotate(const double quaternion[4], const double v[3], double out[3]);
/* Interpolate between two rotations along the shorter way, t from 0 to 1. */
void pliant_rotation_between(const double from[4], const double to[4], double t, double out[4]);
/* Return the angle between two rotations along the shorter way [rad]. */
double pliant_rotation_angle(const double from[4], const double to[4]);
/* Compute the rotation vector from one rotation to another along the shorter way [rad]. */
void pliant_rotation_vector(const double from[4], const double to[4], double out[3]);

#ifdef __cplusplus
}
#endif

#endif
