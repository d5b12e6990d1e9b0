// The rules of Anderson's method that both backends follow.
#include "fem/quasistatic/anderson.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace {

TEST(Anderson, EnergyBelowZeroIsNoMerit)
{
    EXPECT_DOUBLE_EQ(pliant_anderson_merit(4, 10), 2);
    EXPECT_EQ(pliant_anderson_merit(0, 10), 0);
    EXPECT_EQ(pliant_anderson_merit(-1e-12 * 100, 10), 0) << "rounding";
    EXPECT_EQ(pliant_anderson_merit(-1e-6, 10), INFINITY);
    EXPECT_EQ(pliant_anderson_merit(-4, 10), INFINITY);
    for (double bad : {std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN()}) {
        EXPECT_EQ(pliant_anderson_merit(bad, 10), INFINITY);
        EXPECT_EQ(pliant_anderson_merit(4, bad), INFINITY);
    }
}

} // namespace
