// Directions and grids for the tests of conversions.
#ifndef PLIANT_TEST_ROS_GRIDS_H
#define PLIANT_TEST_ROS_GRIDS_H

#include "pliant/scan.h"

#include <cmath>
#include <cstring>
#include <limits>

const double nan_value = std::numeric_limits<double>::quiet_NaN();

/* a rotation by Rodrigues' formula instead of quaternions */
inline void rodrigues(const double axis[3], double angle, double m[9])
{
    double c = std::cos(angle), s = std::sin(angle);
    double k[9] = {0, -axis[2], axis[1], axis[2], 0, -axis[0], -axis[1], axis[0], 0};
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) m[3 * i + j] = (i == j) * c + s * k[3 * i + j] + (1 - c) * axis[i] * axis[j];
}

inline pliant_geometry geometry(const double direction[9])
{
    pliant_geometry out{};
    for (int d = 0; d < 3; ++d) {
        out.size[d] = 4 + d;
        out.origin[d] = 0.1 * d - 0.2;
        out.spacing[d] = 0.001 * (d + 1);
    }
    std::memcpy(out.direction, direction, sizeof out.direction);
    return out;
}

const double straight[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};

#endif
