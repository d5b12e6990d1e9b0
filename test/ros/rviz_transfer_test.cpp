// Transfer functions: valid presets, opacity independent of the number of slices.
#include "rviz/transfer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <clocale>
#include <cmath>
#include <locale>
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

// The visibility through a slab does not depend on the number of slices.
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
    // a narrow window between coarse steps is not lost
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

TEST(Points, AsTextAndBack)
{
    for (const Preset &one : presets()) {
        std::vector<ControlPoint> read;
        ASSERT_EQ(points_from_text(points_text(one.points), &read), "") << one.name;
        ASSERT_EQ(read.size(), one.points.size());
        for (size_t n = 0; n < read.size(); n++) {
            EXPECT_DOUBLE_EQ(read[n].at, one.points[n].at);
            EXPECT_DOUBLE_EQ(read[n].colour.a, one.points[n].colour.a);
            EXPECT_DOUBLE_EQ(read[n].colour.g, one.points[n].colour.g);
        }
    }
    std::vector<ControlPoint> kept = presets().front().points;
    const size_t count = kept.size();
    for (const char *wrong : {"", "0.1, 0, 0, 0, 0", "0.1, 0, 0, 0; 0.2, 0, 0, 0, 1",
                              "0.2, 0, 0, 0, 0; 0.1, 0, 0, 0, 1", "0.1, 0, 0, 0, 0; 0.2, 0, 0, 2, 1",
                              "0.1, 0, 0, 0, 0; 0.2, 0, 0, 0, 1 more", "0.1, 0, 0, 0, 0; nan, 0, 0, 0, 1"})
        EXPECT_NE(points_from_text(wrong, &kept), "") << wrong;
    EXPECT_EQ(kept.size(), count) << "they stay as they were";
}

TEST(Points, StayInOrderWhileDragged)
{
    std::vector<ControlPoint> points = {{0.2, {0, 0, 0, 0}}, {0.4, {0, 0, 0, 0.5}}, {0.8, {1, 1, 1, 1}}};
    move_point(&points, 1, 0.1, 2);
    EXPECT_GT(points[1].at, 0.2);
    EXPECT_LT(points[1].at, 0.21);
    EXPECT_EQ(points[1].colour.a, 1);
    move_point(&points, 2, 7, -1);
    EXPECT_EQ(points[2].at, 1);
    EXPECT_EQ(points[2].colour.a, 0);
    points = {{0.2, {0, 0, 0, 0}}, {0.8, {1, 1, 1, 1}}};
    EXPECT_EQ(add_point(&points, 0.5), 1);
    EXPECT_NEAR(points[1].colour.r, 0.5, 1e-12);
    EXPECT_NEAR(points[1].colour.a, 0.5, 1e-12);
    EXPECT_EQ(add_point(&points, 0.9), 3);
    EXPECT_TRUE(remove_point(&points, 0));
    EXPECT_TRUE(remove_point(&points, 0));
    EXPECT_FALSE(remove_point(&points, 0)) << "two are left";
    EXPECT_EQ(points.size(), 2u);
}

TEST(Points, APointIsAddedOnlyIfItFits)
{
    std::vector<ControlPoint> points = {{0, {0, 0, 0, 0}},
                                        {0.4, {0, 0, 0, 0.5}},
                                        {0.4015, {0, 0, 0, 1}},
                                        {1, {1, 1, 1, 1}}},
                              read;
    for (double at : {0.0, 0.401, 1.0, 0.9995, 0.4}) {
        add_point(&points, at);
        ASSERT_EQ(points_from_text(points_text(points), &read), "") << at;
    }
    EXPECT_EQ(add_point(&points, 0), -1);
    EXPECT_EQ(add_point(&points, 0.401), -1);
    points = {{0, {0, 0, 0, 0}}, {1, {1, 1, 1, 1}}};
    EXPECT_EQ(add_point(&points, 0.0001), 1) << "moved to where it may be";
    EXPECT_EQ(points_from_text(points_text(points), &read), "");
}

struct Comma : std::numpunct<char> {
    char do_decimal_point() const override { return ','; }
};

// Qt uses the desktop's language, which may write 0,5.
TEST(Points, AreTextOfNoLanguage)
{
    const std::vector<ControlPoint> points = {{0.25, {0.5, 0, 0, 0}}, {0.75, {1, 1, 1, 0.5}}};
    const std::locale before = std::locale::global(std::locale(std::locale::classic(), new Comma));
    const std::string numbers = std::setlocale(LC_NUMERIC, nullptr);
    for (const char *name : {"de_DE.UTF-8", "de_DE.utf8", "fr_FR.UTF-8", "nl_NL.UTF-8"}) // if one is installed
        if (std::setlocale(LC_NUMERIC, name)) break;
    std::vector<ControlPoint> read;
    const std::string text = points_text(points),
                      wrong = points_from_text("0.25, 0.5, 0, 0, 0; 0.75 ,1 ,1 ,1 ,0.5", &read);
    std::setlocale(LC_NUMERIC, numbers.c_str());
    std::locale::global(before);
    EXPECT_EQ(text, "0.25, 0.5, 0, 0, 0; 0.75, 1, 1, 1, 0.5");
    EXPECT_EQ(wrong, "");
    ASSERT_EQ(read.size(), 2u);
    EXPECT_EQ(read[1].at, 0.75);
    EXPECT_EQ(read[1].colour.a, 0.5);
}

} // namespace
