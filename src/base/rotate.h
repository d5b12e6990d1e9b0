/* Rotations by quaternions x y z w, which need not be of length 1. */
#ifndef PLIANT_BASE_ROTATE_H
#define PLIANT_BASE_ROTATE_H

#ifdef __cplusplus
extern "C" {
#endif

/* v turned by a quaternion; by 0 0 0 0: as it is */
void pliant_rotate(const double quaternion[4], const double v[3], double out[3]);
/* between two, t from 0 to 1, the shorter way round */
void pliant_rotation_between(const double from[4], const double to[4], double t, double out[4]);
/* of the rotation from one to the other, the shorter way round [rad] */
double pliant_rotation_angle(const double from[4], const double to[4]);

#ifdef __cplusplus
}
#endif

#endif
