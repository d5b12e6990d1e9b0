#include "base/rotate.h"

#include "base/vector3.h"

#include <math.h>
#include <string.h>

static const double min_sine = 1e-9; /* of half an angle: smaller rotations count as none */

/* Compute v + 2 w (q x v) + 2 q x (q x v), divided by the quaternion's squared length. */
void pliant_rotate(const double quaternion[4], const double v[3], double out[3])
{
    const double *q = quaternion, w = q[3], size = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + w * w;
    double a[3] = {q[1] * v[2] - q[2] * v[1], q[2] * v[0] - q[0] * v[2], q[0] * v[1] - q[1] * v[0]};
    double b[3] = {q[1] * a[2] - q[2] * a[1], q[2] * a[0] - q[0] * a[2], q[0] * a[1] - q[1] * a[0]};
    for (int d = 0; d < 3; d++) out[d] = size > 0 ? v[d] + 2 * (w * a[d] + b[d]) / size : v[d];
}

/* Return half the angle. sign: of the shorter way; sizes: squared lengths. */
static double half_angle(const double from[4], const double to[4], double *sign, double sizes[2])
{
    double cosine = 0;
    sizes[0] = sizes[1] = 0;
    for (int d = 0; d < 4; d++) {
        cosine += from[d] * to[d];
        sizes[0] += from[d] * from[d];
        sizes[1] += to[d] * to[d];
    }
    const double size = sqrt(sizes[0] * sizes[1]);
    *sign = cosine < 0 ? -1 : 1;
    return size > 0 ? acos(fmin(fabs(cosine) / size, 1)) : 0;
}

/* Method: Shoemake, Animating rotation with quaternion curves, Computer Graphics 19:245 (1985). */
void pliant_rotation_between(const double from[4], const double to[4], double t, double out[4])
{
    double sign, sizes[2];
    const double angle = half_angle(from, to, &sign, sizes), sine = sin(angle);
    if (t >= 1 || sine < min_sine) {
        memcpy(out, to, 4 * sizeof *out);
        return;
    }
    for (int d = 0; d < 4; d++)
        out[d] = sin((1 - t) * angle) / sine * from[d] / sqrt(sizes[0]) +
                 sign * sin(t * angle) / sine * to[d] / sqrt(sizes[1]);
}

double pliant_rotation_angle(const double from[4], const double to[4])
{
    double sign, sizes[2];
    return 2 * half_angle(from, to, &sign, sizes);
}

void pliant_rotation_vector(const double from[4], const double to[4], double out[3])
{
    double sizes = 0, w = 0, cross[3];
    for (int d = 0; d < 4; d++) w += from[d] * to[d];
    for (int d = 0; d < 4; d++) sizes += from[d] * from[d];
    pliant_cross3(from, to, cross);
    /* vector part of to * conjugate(from) */
    for (int d = 0; d < 3; d++) out[d] = from[3] * to[d] - to[3] * from[d] + cross[d];
    const double sine = pliant_length3(out), half = atan2(sine, fabs(w));
    const double scale = sizes > 0 && half > min_sine ? copysign(2 * half / sine, w) : 0;
    for (int d = 0; d < 3; d++) out[d] *= scale;
}
