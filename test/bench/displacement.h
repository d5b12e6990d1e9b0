// Displacement field of a warp's body in benchmarks.
#ifndef PLIANT_BENCH_DISPLACEMENT_H
#define PLIANT_BENCH_DISPLACEMENT_H

#include <cmath>

// Smooth, up to 3 cm, over a box of the given extent; amount in [0, 1].
inline void displacement(const double x[3], const double extent[3], double amount, double out[3])
{
    const double pi = 3.14159265358979;
    double a = pi * x[0] / extent[0], b = pi * x[1] / extent[1], c = pi * x[2] / extent[2];
    out[0] = 0.02 * amount * std::sin(b + 0.3) * std::cos(0.5 * c);
    out[1] = 0.02 * amount * std::sin(a) * std::cos(c - 0.2);
    out[2] = 0.015 * amount * std::cos(a + 0.1) * std::sin(b);
}

#endif
