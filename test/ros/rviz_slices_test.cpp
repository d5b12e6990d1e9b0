// Geometry of slices: areas, volumes and order against what is known in closed form.
#include "rviz/slices.h"

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

TEST(ClipRay, OutsideOfWhatIsCutAway)
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
    for (const Bounds &box : {Bounds{{{0.25, 0.6, 0}}, {{0.5, 1, 1}}}, Bounds{{{1.5, 0, 0}}, {{2, 1, 1}}}, Bounds{{{0.5, 0.5, 0.5}}, {{0.5, 0.5, 0.5}}}}) {
        parts = left(box);
        ASSERT_EQ(parts.size(), 1u);
        EXPECT_DOUBLE_EQ(parts[0].near, 2);
        EXPECT_DOUBLE_EQ(parts[0].far, 3);
    }
}

} // namespace
