// Solids from triangles and STL files: distances against known shapes, and refused surfaces.
#include "solids.h"

#include "contact/shapes/shapes.h"
#include "base/memory.h"
#include "contact/shapes/tool_shape.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <random>

namespace {

using Solid = std::unique_ptr<pliant_solid, void (*)(pliant_solid *)>;
void release(pliant_solid *solid) { pliant_solid_release(solid); }

Solid make(const Surface &surface, double resolution = 0, bool convex = false)
{
    pliant_solid *solid = nullptr;
    pliant_solid_options options{};
    options.resolution = resolution;
    options.convex = convex;
    EXPECT_EQ(surface.make(options, &solid), PLIANT_OK) << pliant_last_error();
    return Solid(solid, release);
}

pliant_solid_surface surface_of(const Solid &solid)
{
    pliant_solid_surface out{};
    if (solid) pliant_solid_get_surface(solid.get(), &out);
    return out;
}

pliant_part part_of(const Solid &solid, double radius = 0)
{
    pliant_part part{};
    part.kind = PLIANT_PART_SOLID;
    part.solid = solid.get();
    part.radius = radius;
    return part;
}

struct Random {
    std::mt19937 engine{3};
    double operator()(double low, double high)
    {
        return low + (high - low) * std::uniform_real_distribution<double>()(engine);
    }
    std::vector<double> point(double low, double high)
    {
        return {(*this)(low, high), (*this)(low, high), (*this)(low, high)};
    }
};

double ring_distance(const double p[3], double radius, double tube)
{
    return std::hypot(std::hypot(p[0], p[1]) - radius, p[2]) - tube;
}

const double low[3] = {-0.01, -0.02, 0.005}, high[3] = {0.015, -0.005, 0.025};

pliant_part box_part(double radius)
{
    pliant_part part{};
    part.kind = PLIANT_PART_BOX;
    std::copy(low, low + 3, part.from);
    std::copy(high, high + 3, part.to);
    part.radius = radius;
    return part;
}

TEST(Solid, AConvexOneHasTheDistancesOfItsBox)
{
    Surface points = block(low, high);
    points.triangles.clear();
    Random random;
    // inside, so not on the hull
    for (int n = 0; n < 200; n++) points.add(random(low[0], high[0]), random(low[1], high[1]), random(low[2], high[2]));
    const Solid solid = make(points, 0, true);
    EXPECT_EQ(surface_of(solid).num_triangles, 12);
    EXPECT_EQ(surface_of(solid).num_points, 8);
    EXPECT_NEAR(surface_of(solid).volume, 0.025 * 0.015 * 0.02, 1e-15);
    const pliant_part part = part_of(solid, 0.001), box = box_part(0.001);
    for (int n = 0; n < 2000; n++) {
        const auto p = random.point(-0.05, 0.05);
        double normal[3], expected[3];
        ASSERT_NEAR(pliant_part_distance(&part, p.data(), normal), pliant_part_distance(&box, p.data(), expected),
                    1e-14);
        for (int d = 0; d < 3; d++) ASSERT_NEAR(normal[d], expected[d], 1e-9);
    }
    const double origin[3] = {0, 0, 0};
    EXPECT_DOUBLE_EQ(pliant_part_reach(&part, origin), pliant_part_reach(&box, origin));
}

// Spheres and solids have one reference point only.
TEST(Solid, ThePartsMiddleIsTheirOwn)
{
    const Solid solid = make(block(low, high), 0, true);
    pliant_part sphere{}, capsule{}, part = part_of(solid), box = box_part(0);
    sphere.kind = PLIANT_PART_SPHERE;
    capsule.kind = PLIANT_PART_CAPSULE;
    double centre[3], expected[3];
    for (int d = 0; d < 3; d++) {
        sphere.from[d] = capsule.from[d] = 0.1 + d;
        sphere.to[d] = part.to[d] = 9; // not used
        capsule.to[d] = 0.3 + d;
    }
    pliant_part_centre(&sphere, centre);
    for (int d = 0; d < 3; d++) EXPECT_DOUBLE_EQ(centre[d], 0.1 + d);
    pliant_part_centre(&capsule, centre);
    for (int d = 0; d < 3; d++) EXPECT_DOUBLE_EQ(centre[d], 0.2 + d);
    pliant_part_centre(&part, centre);
    pliant_part_centre(&box, expected);
    for (int d = 0; d < 3; d++) EXPECT_NEAR(centre[d], expected[d], 1e-15);
}

TEST(Solid, AHullHoldsItsPoints)
{
    Random random;
    Surface cloud;
    for (int n = 0; n < 300; n++) {
        const auto p = random.point(-1, 1);
        const double size = std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
        cloud.add(0.01 * p[0] / size, 0.01 * p[1] / size, 0.01 * p[2] / size);
    }
    const Solid solid = make(cloud, 0, true);
    EXPECT_EQ(surface_of(solid).num_triangles, 2 * 300 - 4) << "Euler";
    const pliant_part part = part_of(solid);
    double normal[3], worst = 0;
    for (int n = 0; n < 300; n++)
        worst = std::max(worst, std::fabs(pliant_part_distance(&part, cloud.points.data() + 3 * n, normal)));
    EXPECT_LT(worst, 1e-12);
}

// More than 1000 hull triangles exist only before eight outer points enclose the ball. The final hull is valid. Without
// the outer points, the error message gives the limit.
TEST(Solid, AHullHasTooManyTrianglesAtTheEndAlone)
{
    Random random;
    Surface ball;
    for (int n = 0; n < 3000; n++) {
        const auto p = random.point(-1, 1);
        const double size = std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
        ball.add(0.01 * p[0] / size, 0.01 * p[1] / size, 0.01 * p[2] / size);
    }
    pliant_solid *none = nullptr;
    pliant_solid_options options{};
    options.convex = true;
    EXPECT_EQ(ball.make(options, &none), PLIANT_ERROR_FORMAT);
    EXPECT_STREQ(pliant_last_error(),
                 "solid: its convex hull has more than 1000 triangles; as a mesh it may have 1000000");
    const double from[3] = {-0.0101, -0.0101, -0.0101}, to[3] = {0.0101, 0.0101, 0.0101};
    const Surface around = block(from, to);
    ball.points.insert(ball.points.end(), around.points.begin(), around.points.end());
    const Solid solid = make(ball, 0, true);
    EXPECT_EQ(surface_of(solid).num_triangles, 12);
    EXPECT_NEAR(surface_of(solid).volume, std::pow(0.0202, 3), 1e-15);
}

// Points in the faces and on the edges of a box, off by rounding errors or 1e-9 of its size. No triangle is too thin
// for a normal.
TEST(Solid, AHullHasNoSlivers)
{
    for (const double off : {0.0, 1e-17, 1e-11}) {
        Random random;
        Surface points;
        for (int n = 0; n < 6 * 15 * 15; n++) {
            const int axis = n / 450, side = n / 225 % 2;
            double p[3];
            p[axis] = side ? high[axis] : low[axis];
            p[(axis + 1) % 3] = low[(axis + 1) % 3] + (high[(axis + 1) % 3] - low[(axis + 1) % 3]) * (n % 15) / 14.0;
            p[(axis + 2) % 3] =
                low[(axis + 2) % 3] + (high[(axis + 2) % 3] - low[(axis + 2) % 3]) * (n / 15 % 15) / 14.0;
            for (double &v : p) v += random(-off, off);
            points.add(p[0], p[1], p[2]);
        }
        const Solid solid = make(points, 0, true);
        EXPECT_NEAR(surface_of(solid).volume, 0.025 * 0.015 * 0.02, 1e-12) << off;
        const pliant_part part = part_of(solid), box = box_part(0);
        for (int n = 0; n < 1000; n++) {
            const auto p = random.point(-0.05, 0.05);
            double normal[3], expected[3];
            ASSERT_NEAR(pliant_part_distance(&part, p.data(), normal), pliant_part_distance(&box, p.data(), expected),
                        1e-8)
                << off;
        }
    }
}

// The resolution of the field does not change the thickness of a solid.
TEST(Solid, AFineFieldIsNotThin)
{
    const double from[3] = {0, 0, 0}, to[3] = {0.0004, 0.0004, 0.0004};
    const Solid solid = make(block(from, to), 2e-5);
    pliant_part part = part_of(solid);
    char reason[160];
    EXPECT_EQ(pliant_part_check(&part, true, reason, sizeof reason), nullptr) << reason;
    EXPECT_GT(pliant_part_depth(&part), 0);
}

// A field is exact at its points, and between them within its stated error.
TEST(Solid, AFieldHasTheDistancesOfItsShape)
{
    Random random;
    const Solid solid = make(ring(0.012, 0.004), 4e-4);
    const pliant_part part = part_of(solid);
    const double faceted = 0.016 * (1 - std::cos(M_PI / 48)) + 0.004 * (1 - std::cos(M_PI / 24)),
                 error = surface_of(solid).error;
    EXPECT_LT(error, 5e-5) << "of what is smooth";
    int inside = 0;
    for (int n = 0; n < 20000; n++) {
        const double p[3] = {random(-0.018, 0.018), random(-0.018, 0.018), random(-0.006, 0.006)},
                     known = ring_distance(p, 0.012, 0.004);
        double normal[3];
        const double found = pliant_part_distance(&part, p, normal);
        inside += found < 0;
        if (known < 0.0014 && known > -0.003) ASSERT_NEAR(found, known, faceted + 3e-5);
        else if (known > 0) ASSERT_LT(found, known + faceted + 3e-5) << "a lower bound";
        if (known > -0.003) {
            double foot[3];
            for (int d = 0; d < 3; d++) foot[d] = p[d] - found * normal[d];
            if (known < 0.0014) ASSERT_NEAR(ring_distance(foot, 0.012, 0.004), 0, faceted + 5e-5);
        }
    }
    EXPECT_NEAR(inside / 20000.0, 2 * M_PI * M_PI * 0.012 * 0.004 * 0.004 / (0.036 * 0.036 * 0.012), 0.01);
    EXPECT_NEAR(surface_of(solid).volume, 2 * M_PI * M_PI * 0.012 * 0.004 * 0.004, 0.02 * 4e-6);
    EXPECT_EQ(surface_of(solid).num_triangles, 2 * 48 * 24);
}

TEST(Solid, AFieldRoundsEdgesByAsMuchAsItSays)
{
    Random random;
    const Solid solid = make(block(low, high), 5e-4);
    const pliant_part part = part_of(solid), box = box_part(0);
    const double error = surface_of(solid).error;
    EXPECT_LT(error, 5e-4);
    for (int n = 0; n < 20000; n++) {
        const auto p = random.point(-0.0215, 0.0265);
        double normal[3], expected[3];
        const double known = pliant_part_distance(&box, p.data(), expected);
        if (known < 0.0014) ASSERT_NEAR(pliant_part_distance(&part, p.data(), normal), known, std::max(error, 2.5e-4));
    }
}

// Overlapping shells form one solid, even if a point's nearest triangle is inside another shell.
TEST(Solid, ShellsMayOverlap)
{
    const double from[3] = {0, 0, 0}, to[3] = {0.01, 0.01, 0.01}, middle[3] = {0.005, 0.002, 0.002},
                 end[3] = {0.02, 0.008, 0.008};
    Surface both = block(from, to);
    const Surface second = block(middle, end);
    const int32_t shift = static_cast<int32_t>(both.points.size() / 3);
    both.points.insert(both.points.end(), second.points.begin(), second.points.end());
    for (const int32_t corner : second.triangles) both.triangles.push_back(corner + shift);
    const Solid solid = make(both, 4e-4);
    const pliant_part part = part_of(solid);
    Random random;
    for (int n = 0; n < 3000; n++) {
        const auto p = random.point(-0.001, 0.021);
        auto within = [&](const double *a, const double *b, double by) {
            return p[0] > a[0] - by && p[0] < b[0] + by && p[1] > a[1] - by && p[1] < b[1] + by && p[2] > a[2] - by &&
                   p[2] < b[2] + by;
        };
        double normal[3];
        const double found = pliant_part_distance(&part, p.data(), normal);
        // inner shells have the value 0 in the field
        if (within(from, to, -5e-4) || within(middle, end, -5e-4)) ASSERT_LT(found, 4e-4);
        if (!within(from, to, 4e-4) && !within(middle, end, 4e-4)) ASSERT_GT(found, 0);
    }
}

// With a solid that is not convex, the distance along an edge or triangle has several local minima.
TEST(Solid, TheNearestPointsAreThoseOfManySamples)
{
    Random random;
    for (const Solid &solid : {make(corner(), 3e-4), make(ring(0.012, 0.004), 4e-4)}) {
        const pliant_part part = part_of(solid, 2e-4);
        double worst_edge = 0, worst_face = 0;
        for (int n = 0; n < 150; n++) {
            double at[3][3], weight[3], normal[3], there[3], min_edge = INFINITY, min_face = INFINITY;
            for (auto &p : at)
                for (double &v : p) v = random(-0.01, 0.025);
            for (int s = 0; s <= 60; s++)
                for (int t = 0; s + t <= 60; t++) {
                    double p[3];
                    for (int d = 0; d < 3; d++) p[d] = ((60 - s - t) * at[0][d] + s * at[1][d] + t * at[2][d]) / 60;
                    const double distance = pliant_part_distance(&part, p, there);
                    min_face = std::min(min_face, distance);
                    if (t == 0) min_edge = std::min(min_edge, distance);
                }
            const double edge = pliant_edge_minimum(&part, at, 1, weight, normal);
            ASSERT_NEAR(weight[0] + weight[1], 1, 1e-12);
            const double face = pliant_face_minimum(&part, at, 1, weight, normal);
            ASSERT_NEAR(weight[0] + weight[1] + weight[2], 1, 1e-12);
            ASSERT_GE(std::min({weight[0], weight[1], weight[2]}), 0);
            double p[3];
            for (int d = 0; d < 3; d++) p[d] = weight[0] * at[0][d] + weight[1] * at[1][d] + weight[2] * at[2][d];
            ASSERT_NEAR(pliant_part_distance(&part, p, there), face, 1e-12);
            worst_edge = std::max(worst_edge, edge - min_edge);
            worst_face = std::max(worst_face, face - min_face);
            const double bound = pliant_face_minimum(&part, at, 0.001, weight, normal);
            ASSERT_LE(bound, face + 1e-12);
        }
        EXPECT_LT(worst_edge, 1e-4);
        EXPECT_LT(worst_face, 1e-4);
    }
}

// ---- files

class SolidFile : public ::testing::Test {
protected:
    void TearDown() override { std::remove(name_.c_str()); }
    pliant_status read(const std::string &bytes, double unit = 1, bool convex = false)
    {
        FILE *file = std::fopen(name_.c_str(), "wb");
        std::fwrite(bytes.data(), 1, bytes.size(), file);
        std::fclose(file);
        pliant_solid *solid = nullptr;
        pliant_solid_options options{};
        options.unit = unit;
        options.convex = convex;
        options.resolution = 6e-4;
        const pliant_status status = pliant_solid_read(name_.c_str(), &options, &solid);
        if (status == PLIANT_OK) solid_.reset(solid);
        return status;
    }
    void refuses(const std::string &bytes, const std::string &what, double unit = 1)
    {
        EXPECT_EQ(read(bytes, unit), PLIANT_ERROR_FORMAT) << what;
        EXPECT_EQ(std::string(pliant_last_error()).find(name_ + ": " + what), 0u) << pliant_last_error();
    }
    const std::string name_ = ::testing::TempDir() + "solid_test.stl";
    Solid solid_{nullptr, release};
};

TEST_F(SolidFile, BothFormatsAndUnitsAreTheSameSolid)
{
    const Surface shape = corner();
    ASSERT_EQ(read(binary_stl(shape, 0.001), 0.001), PLIANT_OK) << pliant_last_error();
    const pliant_solid_surface first = surface_of(solid_);
    EXPECT_EQ(first.num_points, 12);
    EXPECT_EQ(first.num_triangles, 20);
    EXPECT_NEAR(first.volume, (0.02 * 0.006 + 0.014 * 0.006) * 0.008, 1e-12);
    EXPECT_FALSE(first.convex);
    EXPECT_LT(first.bytes, 4u * 41 * 41 * 21 + 4000);
    const Solid kept = std::move(solid_);
    const pliant_part part = part_of(kept);
    for (const std::string &bytes : {ascii_stl(shape, 1), "solid" + binary_stl(shape, 1).substr(5)}) {
        ASSERT_EQ(read(bytes), PLIANT_OK) << pliant_last_error();
        const pliant_part other = part_of(solid_);
        Random random;
        for (int n = 0; n < 200; n++) {
            const auto p = random.point(-0.001, 0.021);
            double normal[3];
            ASSERT_NEAR(pliant_part_distance(&part, p.data(), normal), pliant_part_distance(&other, p.data(), normal),
                        1e-7);
        }
    }
    ASSERT_EQ(read(binary_stl(shape, 0.001), 0.001, true), PLIANT_OK) << pliant_last_error();
    EXPECT_TRUE(surface_of(solid_).convex);
    EXPECT_NEAR(surface_of(solid_).volume, (0.02 * 0.02 - 0.5 * 0.014 * 0.014) * 0.008, 1e-12);
}

TEST_F(SolidFile, AnInsideOutSolidIsTurned)
{
    Surface shape = corner();
    for (size_t c = 0; c < shape.triangles.size(); c += 3) std::swap(shape.triangles[c], shape.triangles[c + 1]);
    ASSERT_EQ(read(binary_stl(shape, 1)), PLIANT_OK) << pliant_last_error();
    const pliant_part part = part_of(solid_);
    const double inside[3] = {0.003, 0.003, 0.004};
    double normal[3];
    EXPECT_NEAR(pliant_part_distance(&part, inside, normal), -0.003, 5e-4);
}

TEST_F(SolidFile, RollPitchAndYawTurnIt)
{
    const Surface shape = corner();
    pliant_solid *solid = nullptr;
    pliant_solid_options options{};
    options.resolution = 6e-4;
    options.turn[0] = M_PI / 2; // y becomes z, z becomes -y
    options.turn[2] = M_PI / 2; // then x becomes y, y becomes -x
    ASSERT_EQ(shape.make(options, &solid), PLIANT_OK);
    pliant_solid_surface of;
    pliant_solid_get_surface(solid, &of);
    double maximum[3] = {-1, -1, -1};
    for (int c = 0; c < 3 * of.num_points; c++) maximum[c % 3] = std::max(maximum[c % 3], of.points[c]);
    EXPECT_NEAR(maximum[0], 0.008, 1e-15) << "z, that is -y, and so x";
    EXPECT_NEAR(maximum[1], 0.02, 1e-15);
    EXPECT_NEAR(maximum[2], 0.02, 1e-15);
    pliant_solid_release(solid);
}

TEST_F(SolidFile, OpenMeshesAreRefusedWithThePlace)
{
    Surface shape = corner();
    shape.triangles.resize(shape.triangles.size() - 3);
    refuses(binary_stl(shape, 0.001),
            "is not closed: 3 of its 30 edges have only one triangle, the first from (0, 0, 8) to (6, 20, 8); "
            "fill its holes",
            0.001);
    ASSERT_EQ(read(binary_stl(shape, 0.001), 0.001, true), PLIANT_OK) << "its hull";
    shape = corner();
    std::swap(shape.triangles[0], shape.triangles[1]);
    refuses(binary_stl(shape, 1), "3 of its 30 edges have triangles with opposite orientation, the first from (");
}

TEST_F(SolidFile, OtherFilesAreRefused)
{
    const std::string good = binary_stl(corner(), 1), text = ascii_stl(corner(), 1);
    refuses("", "is empty");
    refuses("solid", "is not STL: neither 'solid' and facets, nor as long as");
    refuses(good.substr(0, 40), "is not STL");
    refuses(good.substr(0, good.size() - 1),
            "as binary STL it says that it has 20 triangles, which take 1084 bytes, and has 1083: it is truncated");
    std::string bad = good;
    std::memset(&bad[80], 0xff, 4);
    refuses(bad, "as binary STL it says that it has 4294967295 triangles, which take 214748364834 bytes");
    refuses(good.substr(0, 80) + std::string(4, '\0'), "has no triangle");
    bad = good;
    const float nan = NAN;
    std::memcpy(&bad[84 + 50 + 12], &nan, 4);
    refuses(bad, "triangle 2 has a corner that is not finite");
    refuses(text.substr(0, text.size() - 30), "ends at line 140 without 'endsolid': it is truncated");
    refuses(text.substr(0, text.find("vertex") + 20), "line 4: 'vertex' needs three numbers");
    bad = text;
    bad.replace(bad.find("vertex") + 7, 1, "x");
    refuses(bad, "line 4: 'vertex' needs three numbers; 'x");
    bad = text;
    bad.erase(bad.find("   vertex"), bad.find("\n", bad.find("   vertex")) - bad.find("   vertex"));
    refuses(bad, "line 8: a facet needs 3 corners");
    EXPECT_EQ(solid_, nullptr);
}

TEST_F(SolidFile, FlatSolidsAreRefused)
{
    refuses(binary_stl(corner(), 0.001), "is 20 m large; is it in millimetres (unit: mm)?");
    refuses(binary_stl(corner(), 1), "is 2e-05 m large; is it in metres (unit: m)?", 0.001);
    const double from[3] = {0, 0, 0}, thin[3] = {0.02, 0.02, 0.0001};
    refuses(binary_stl(block(from, thin), 1), "is too thin for a distance field with a resolution of 0.6 mm");
    Surface flat;
    for (int n = 0; n < 4; n++) flat.add(0.01 * (n & 1), 0.01 * (n >> 1), 0);
    flat.triangles = {0, 1, 2, 1, 3, 2, 0, 2, 1, 1, 2, 3};
    refuses(binary_stl(flat, 1), "holds no volume");
    flat.triangles = {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1};
    refuses(binary_stl(flat, 1), "none of its triangles has an area");
    pliant_solid *solid = nullptr;
    pliant_solid_options options{};
    options.resolution = 1e-5;
    EXPECT_EQ(corner().make(options, &solid), PLIANT_ERROR_FORMAT);
    EXPECT_NE(std::string(pliant_last_error()).find("solid: a distance field with a resolution of 0.01 mm needs"),
              std::string::npos)
        << pliant_last_error();
    options.convex = true;
    EXPECT_EQ(flat.make(options, &solid), PLIANT_ERROR_FORMAT);
    EXPECT_STREQ(pliant_last_error(),
                 "solid: its points lie in a plane: a solid needs four points that are not coplanar");
}

TEST_F(SolidFile, EveryAllocationMayFail)
{
    const std::string bytes = ascii_stl(corner(), 1);
    for (const bool convex : {false, true}) {
        solid_.reset();
        const size_t before = pliant_memory_in_use();
        int failures = 0;
        for (pliant_status status = PLIANT_ERROR_MEMORY; status != PLIANT_OK; failures++) {
            pliant_memory_fail_after(failures);
            status = read(bytes, 1, convex);
            pliant_memory_fail_after(-1);
            if (status != PLIANT_OK) ASSERT_EQ(status, PLIANT_ERROR_MEMORY) << failures << ": " << pliant_last_error();
            if (status != PLIANT_OK) ASSERT_EQ(pliant_memory_in_use(), before);
        }
        EXPECT_GT(failures, 7);
    }
}

} // namespace
