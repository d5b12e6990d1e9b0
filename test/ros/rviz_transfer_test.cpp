// Transfer functions: sound presets, opacity that does not depend on the number of slices.
#include "rviz/transfer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

using namespace pliant_rviz;

namespace {

TEST(Presets, AreSound)
{
    std::set<std::string> names;
    for (const Preset &one : presets()) {
        EXPECT_TRUE(names.insert(one.name).second) << one.name;
        EXPECT_GT(one.window, 0);
        ASSERT_GE(one.points.size(), 2u);
        double last = -1;
        for (const ControlPoint &point : one.points) {
            EXPECT_GT(point.at, last) << one.name;
            EXPECT_LE(point.at, 1);
            last = point.at;
            for (double x : {point.colour.r, point.colour.g, point.colour.b, point.colour.a}) {
                EXPECT_GE(x, 0);
                EXPECT_LE(x, 1);
            }
        }
        EXPECT_EQ(one.points.front().colour.a, 0) << one.name << ": air must not be seen";
    }
    for (const char *name : {"CT soft tissue", "CT bone", "CT skin", "CT lung", "CT vessels", "MR"})
        EXPECT_EQ(preset(name).name, name);
}

TEST(Colour, IsLinearBetweenPointsAndFlatOutside)
{
    Preset two;
    two.points = {{0.2, {0, 0.5, 1, 0}}, {0.6, {1, 0.5, 0, 0.8}}};
    EXPECT_DOUBLE_EQ(colour_at(two, 0.3).r, 0.25);
    EXPECT_DOUBLE_EQ(colour_at(two, 0.3).a, 0.2);
    EXPECT_DOUBLE_EQ(colour_at(two, -5).b, 1);
    EXPECT_DOUBLE_EQ(colour_at(two, 5).a, 0.8);
    EXPECT_DOUBLE_EQ(colour_at(two, std::nan("")).a, 0);
}

// what is seen through a slab does not depend on how many slices it is cut into
TEST(Table, OpacityIsCorrectedForTheDistance)
{
    Preset two;
    two.points = {{0, {1, 1, 1, 0}}, {1, {1, 1, 1, 0.5}}};
    for (int slices : {16, 64, 128, 256}) {
        Table table = make_table(two, 1, 64.0 / slices);
        for (size_t n : {30u, 256u, 511u}) {
            double through = 1;
            for (int s = 0; s < slices; s++) through *= 1 - table[4 * n + 3] / 65535.0;
            double expected = std::pow(1 - 0.5 * double(n) / 511, 64);
            EXPECT_NEAR(through, expected, 0.003) << slices << " " << n;
            EXPECT_EQ(table[4 * n], table[4 * n + 3]) << "premultiplied white";
        }
    }
    Table invisible = make_table(two, 0, 1);
    for (uint16_t channel : invisible) EXPECT_EQ(channel, 0);
}

TEST(DrawnValues, AreThoseOfTheWindow)
{
    Preset two;
    two.points = {{0.5, {1, 1, 1, 0}}, {1, {1, 1, 1, 1}}};
    // window 0 to 100: drawn above 50; texels from -1000 to 3095: one unit each
    std::vector<bool> drawn = drawn_values(two, 0, 100, -1000, 3095);
    ASSERT_EQ(drawn.size(), 4096u);
    EXPECT_FALSE(drawn[1000]);
    EXPECT_FALSE(drawn[1049]);
    EXPECT_TRUE(drawn[1051]);
    EXPECT_TRUE(drawn[4000]) << "above the window too";
    // a narrow window among coarse steps is not lost
    two.points = {{0, {1, 1, 1, 0}}, {0.5, {1, 1, 1, 1}}, {1, {1, 1, 1, 0}}};
    drawn = drawn_values(two, 10.2, 10.4, -32768, 32767);
    EXPECT_TRUE(std::any_of(drawn.begin(), drawn.end(), [](bool x) { return x; }));
}

TEST(TransparentUpTo, IsWhereTheOpacityBegins)
{
    Preset one;
    one.points = {{0.1, {1, 1, 1, 0}}, {0.3, {1, 1, 1, 0}}, {0.6, {1, 1, 1, 0.5}}, {1, {1, 1, 1, 0}}};
    EXPECT_EQ(transparent_up_to(one), 0.3);
    EXPECT_GT(colour_at(one, 0.301).a, 0);
    one.points = {{0.1, {1, 1, 1, 0.1}}, {1, {1, 1, 1, 1}}};
    EXPECT_LT(transparent_up_to(one), 0);
}

TEST(SeenFrom, IsInsideTheWindow)
{
    for (const Preset &one : presets()) {
        double low = one.level - 0.5 * one.window, high = one.level + 0.5 * one.window, seen = seen_from(one, low, high, 1);
        EXPECT_GT(seen, low) << one.name;
        EXPECT_LT(seen, high) << one.name;
        EXPECT_GE(colour_at(one, (seen - low) / one.window).a, 0.049) << one.name;
        EXPECT_GE(seen_from(one, low, high, 0.5), seen) << one.name << ": what is fainter is seen later";
    }
    // muscle and organs, not fat, and not bone only
    const Preset &soft = preset("CT soft tissue");
    double seen = seen_from(soft, soft.level - 0.5 * soft.window, soft.level + 0.5 * soft.window, 1);
    EXPECT_GT(seen, -20);
    EXPECT_LT(seen, 60);
}

} // namespace
