// Geometry of slices: areas, volumes and order against closed forms.
#include "rviz/side_letters.h"
#include "rviz/visible_depth.h"
#include "rviz/slices.h"
#include "rviz/transfer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

using namespace pliant_rviz;

namespace {

Vector unit(double x, double y, double z)
{
    double length = std::sqrt(x * x + y * y + z * z);
    return {{x / length, y / length, z / length}};
}

double area(const std::vector<Vector> &polygon)
{
    Vector sum{{0, 0, 0}};
    for (size_t n = 2; n < polygon.size(); n++) {
        Vector u, v;
        for (size_t d = 0; d < 3; d++) {
            u[d] = polygon[n - 1][d] - polygon[0][d];
            v[d] = polygon[n][d] - polygon[0][d];
        }
        for (size_t d = 0; d < 3; d++) sum[d] += u[(d + 1) % 3] * v[(d + 2) % 3] - u[(d + 2) % 3] * v[(d + 1) % 3];
    }
    return 0.5 * std::sqrt(dot(sum, sum));
}

const Bounds CUBE{{{0, 0, 0}}, {{1, 1, 1}}};

TEST(Slice, TheMiddleOfACubeIsAHexagon)
{
    std::vector<Vector> polygon = slice(CUBE, {}, unit(1, 1, 1), 1.5 / std::sqrt(3.0));
    EXPECT_EQ(polygon.size(), 6u);
    EXPECT_NEAR(area(polygon), 0.75 * std::sqrt(3.0), 1e-12);
    polygon = slice(CUBE, {}, unit(0, 0, 1), 0.25);
    EXPECT_EQ(polygon.size(), 4u);
    EXPECT_NEAR(area(polygon), 1, 1e-12);
    EXPECT_TRUE(slice(CUBE, {}, unit(0, 0, -1), 0.25).empty());
    EXPECT_TRUE(slice(CUBE, {}, unit(1, 2, 3), 4).empty());
}

TEST(Slice, PlanesCut)
{
    Plane half{unit(1, 0, 0), 0.5};
    EXPECT_NEAR(area(slice(CUBE, {half}, unit(0, 0, 1), 0.5)), 0.5, 1e-12);
    Plane corner{unit(-1, -1, 0), -std::sqrt(0.5) / 1}; // keeps x + y <= 1
    EXPECT_NEAR(area(slice(CUBE, {corner}, unit(0, 0, 1), 0.5)), 0.5, 1e-12);
    EXPECT_NEAR(area(slice(CUBE, {half, corner}, unit(0, 0, 1), 0.5)), 0.125, 1e-12);
}

TEST(Slices, TogetherTheyFillTheBox)
{
    Bounds box{{{-0.3, 0.1, -1}}, {{0.5, 0.4, 0.7}}};
    double whole = 0.8 * 0.3 * 1.7;
    for (Vector direction : {unit(1, 0, 0), unit(0, -1, 0), unit(1, 2, -3), unit(-0.2, 0.1, 1)}) {
        double spacing = 0.002;
        Slices slices = make_slices(box, {}, direction, spacing, 100000);
        double volume = 0, last = 1e9;
        size_t count = 0;
        for (size_t n = 0; n < slices.triangles.size(); n += 3) {
            std::vector<Vector> triangle;
            for (size_t v = 0; v < 3; v++) {
                const float *x = &slices.vertices[3 * slices.triangles[n + v]];
                triangle.push_back({{x[0], x[1], x[2]}});
                for (size_t d = 0; d < 3; d++) {
                    EXPECT_GE(x[d], box.low[d] - 1e-6);
                    EXPECT_LE(x[d], box.high[d] + 1e-6);
                }
            }
            volume += area(triangle) * spacing;
            double depth = dot(direction, triangle[0]);
            EXPECT_LE(depth, last + 1e-6) << "the farthest first";
            if (depth < last - 0.5 * spacing) count++;
            last = depth;
            // on the lattice of slices
            EXPECT_NEAR(depth / spacing, std::round(depth / spacing), 1e-3);
        }
        EXPECT_EQ(count, slices.count);
        EXPECT_NEAR(volume, whole, 0.01 * whole);
    }
}

TEST(Slices, NotTooManyAndNotOfNothing)
{
    EXPECT_LE(make_slices(CUBE, {}, unit(1, 1, 1), 1e-6, 100).count, 100u);
    EXPECT_EQ(make_slices(CUBE, {}, unit(1, 1, 1), 0, 100).count, 0u);
    EXPECT_EQ(make_slices({{{0, 0, 0}}, {{1, 0, 1}}}, {}, unit(1, 1, 1), 0.1, 100).count, 0u);
    EXPECT_EQ(make_slices(CUBE, {{unit(1, 0, 0), 2.0}}, unit(0, 0, 1), 0.1, 100).count, 0u);
}

TEST(ClipRay, BoxAndPlane)
{
    double near = -1, far = -1;
    ASSERT_TRUE(clip_ray(CUBE, {}, {{-2, 0.5, 0.5}}, {{1, 0, 0}}, &near, &far));
    EXPECT_DOUBLE_EQ(near, 2);
    EXPECT_DOUBLE_EQ(far, 3);
    ASSERT_TRUE(clip_ray(CUBE, {}, {{0.5, 0.5, 0.5}}, {{1, 0, 0}}, &near, &far));
    EXPECT_DOUBLE_EQ(near, 0) << "from inside";
    EXPECT_DOUBLE_EQ(far, 0.5);
    EXPECT_FALSE(clip_ray(CUBE, {}, {{2, 0.5, 0.5}}, {{1, 0, 0}}, &near, &far)) << "behind";
    EXPECT_FALSE(clip_ray(CUBE, {}, {{-2, 1.5, 0.5}}, {{1, 0, 0}}, &near, &far));
    ASSERT_TRUE(clip_ray(CUBE, {{unit(1, 0, 0), 0.25}}, {{-2, 0.5, 0.5}}, {{1, 0, 0}}, &near, &far));
    EXPECT_DOUBLE_EQ(near, 2.25);
    EXPECT_FALSE(clip_ray(CUBE, {{unit(0, 1, 0), 0.75}}, {{-2, 0.5, 0.5}}, {{1, 0, 0}}, &near, &far));
}

TEST(ClipRay, OutsideTheClipBox)
{
    const Vector from{{-2, 0.5, 0.5}}, along{{1, 0, 0}};
    const Part whole{2, 3};
    const auto left = [&](const Bounds &box) { return outside(box, from, along, whole); };
    std::vector<Part> parts = left({{{0.25, 0, 0}}, {{0.5, 1, 1}}});
    ASSERT_EQ(parts.size(), 2u);
    EXPECT_DOUBLE_EQ(parts[0].near, 2);
    EXPECT_DOUBLE_EQ(parts[0].far, 2.25);
    EXPECT_DOUBLE_EQ(parts[1].near, 2.5);
    EXPECT_DOUBLE_EQ(parts[1].far, 3);
    parts = left({{{-1, 0, 0}}, {{0.5, 1, 1}}});
    ASSERT_EQ(parts.size(), 1u);
    EXPECT_DOUBLE_EQ(parts[0].near, 2.5);
    EXPECT_TRUE(left({{{-1, 0, 0}}, {{2, 1, 1}}}).empty());
    for (const Bounds &box : {Bounds{{{0.25, 0.6, 0}}, {{0.5, 1, 1}}}, Bounds{{{1.5, 0, 0}}, {{2, 1, 1}}},
                              Bounds{{{0.5, 0.5, 0.5}}, {{0.5, 0.5, 0.5}}}}) {
        parts = left(box);
        ASSERT_EQ(parts.size(), 1u);
        EXPECT_DOUBLE_EQ(parts[0].near, 2);
        EXPECT_DOUBLE_EQ(parts[0].far, 3);
    }
}

// A path in metres through layers of CT values, with the demo's preset.
TEST(VisibleDepth, IsTheLayerWithTheLargestContribution)
{
    const Preset &abdomen = preset("CT abdomen");
    struct Piece {
        double to, value;
    };
    const double step = 0.0004; // a quarter of 1/256 of a diagonal of 0.41 m
    auto look = [&](const std::vector<Piece> &path, const std::vector<Part> &parts, double *at) {
        return find_visible_depth(
            parts, step,
            [&](double t) {
                size_t n = 0;
                while (n + 1 < path.size() && path[n].to < t) n++;
                const double low = abdomen.level - 0.5 * abdomen.window;
                return opacity_over(colour_at(abdomen, (path[n].value - low) / abdomen.window).a, 0.25);
            },
            at);
    };
    /* air, rim of the skin, skin, fat, liver */
    const std::vector<Piece> body = {{0.1, -1000}, {0.1015, -500}, {0.104, -20}, {0.125, -100}, {0.2, 105}};
    double at = 0;
    ASSERT_TRUE(look(body, {{0, 0.2}}, &at));
    EXPECT_GT(at, 0.125) << "not the skin, which is drawn faintly before it";
    EXPECT_LT(at, 0.131) << "near its surface";
    /* without a liver, the skin is visible */
    const std::vector<Piece> fat = {{0.1, -1000}, {0.1015, -500}, {0.104, -20}, {0.2, -100}};
    ASSERT_TRUE(look(fat, {{0, 0.2}}, &at));
    EXPECT_NEAR(at, 0.10075, 0.0005);
    EXPECT_FALSE(look({{0.2, -1000}}, {{0, 0.2}}, &at));
    /* the removed part is invisible; the layer that begins behind it is visible */
    ASSERT_TRUE(look(body, {{0, 0.09}, {0.15, 0.2}}, &at));
    EXPECT_GT(at, 0.15);
    EXPECT_LT(at, 0.156);
    /* two adjacent layers are separate: the brighter one counts, at its beginning */
    const std::vector<Piece> touching = {{0.12, 30}, {0.2, 105}};
    ASSERT_TRUE(look(touching, {{0.1, 0.2}}, &at));
    EXPECT_GT(at, 0.12);
    EXPECT_LT(at, 0.126);
}

TEST(VisibleDepth, TheDepthOfASurfaceIsExact)
{
    double at = 0;
    const ValueAlongRay ball = [](double t) { return 0.01 - std::fabs(t - 0.05); };
    ASSERT_TRUE(find_surface({{0, 0.1}}, 0.003, ball, &at));
    EXPECT_NEAR(at, 0.04, 1e-5);
    ASSERT_TRUE(find_surface({{0.045, 0.1}}, 0.003, ball, &at));
    EXPECT_DOUBLE_EQ(at, 0.045) << "the face of a cut";
    ASSERT_TRUE(find_surface({{0, 0.03}, {0.055, 0.1}}, 0.003, ball, &at));
    EXPECT_DOUBLE_EQ(at, 0.055) << "behind what is cut away";
    EXPECT_FALSE(find_surface({{0, 0.035}}, 0.003, ball, &at));
}

TEST(Patient, SidesHaveDicomsLetters)
{
    EXPECT_EQ(side_letters({{1, 0, 0}}), "L");
    EXPECT_EQ(side_letters({{-2, 0, 0}}), "R");
    EXPECT_EQ(side_letters({{0, -1, 0}}), "A");
    EXPECT_EQ(side_letters({{0, 1, 0.1}}), "P");
    EXPECT_EQ(side_letters({{0, 0, 1}}), "S");
    EXPECT_EQ(side_letters({{0, 0, -1}}), "I");
    EXPECT_EQ(side_letters({{0.4, -0.9, 0.1}}), "AL");
    EXPECT_EQ(side_letters({{-0.5, 0.6, -0.62}}), "IPR");
}

} // namespace
