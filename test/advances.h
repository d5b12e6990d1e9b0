// Legs for tests of the contact advancement.
#pragma once

#include "contact/advance/advance.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>

using Vector = std::array<double, 3>;
using Corners = std::array<Vector, 3>;

static const pliant_contact_settings settings = pliant_contact_settings_default();

struct Advance {
    pliant_advance *advance = nullptr;
    Advance() { EXPECT_EQ(pliant_advance_create(nullptr, &advance), PLIANT_OK); }
    ~Advance() { pliant_advance_free(advance); }
    Advance(const Advance &) = delete;
    Advance &operator=(const Advance &) = delete;
};

struct Random {
    std::mt19937_64 engine;
    explicit Random(uint64_t seed) : engine(seed) {}
    double operator()(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine); }
    double wide(double low, double high) { return std::exp((*this)(std::log(low), std::log(high))); }
    bool happens(double probability) { return (*this)(0, 1) < probability; }
    Vector direction()
    {
        for (;;) {
            const Vector v = {(*this)(-1, 1), (*this)(-1, 1), (*this)(-1, 1)};
            const double size = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
            if (size > 0.1 && size < 1) return {v[0] / size, v[1] / size, v[2] / size};
        }
    }
};

inline void turn(const Vector &axis, double angle, double out[4])
{
    for (int d = 0; d < 3; d++) out[d] = std::sin(0.5 * angle) * axis[d];
    out[3] = std::cos(0.5 * angle);
}

inline void multiply(const double a[4], const double b[4], double out[4])
{
    const double q[4] = {
        a[3] * b[0] + b[3] * a[0] + a[1] * b[2] - a[2] * b[1], a[3] * b[1] + b[3] * a[1] + a[2] * b[0] - a[0] * b[2],
        a[3] * b[2] + b[3] * a[2] + a[0] * b[1] - a[1] * b[0], a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2]};
    std::copy(q, q + 4, out);
}
