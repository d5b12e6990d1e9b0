// A ray through the deformed volume to its isosurface, against exact spheres and planes.
#include "mesh/mesh.h"
#include "pipeline/body.h"
#include "tool/pick.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

namespace {

// A ball in a box of `size` voxels: value = 100 * (1 - distance / radius) around its centre, so 0 at its surface.
struct Ball {
    pliant_volume volume{};
    pliant_mesh mesh{};
    double centre[3], radius;

    Ball(const double direction[9], const double spacing[3], double radius_) : radius(radius_)
    {
        pliant_geometry geometry{};
        for (int d = 0; d < 3; d++) {
            geometry.size[d] = 40 + 4 * d;
            geometry.spacing[d] = spacing[d];
            geometry.origin[d] = 0.1 * d - 0.2;
        }
        for (int n = 0; n < 9; n++) geometry.direction[n] = direction[n];
        EXPECT_EQ(pliant_volume_create(&geometry, PLIANT_FLOAT32, &volume), PLIANT_OK) << pliant_last_error();
        const double middle[3] = {20.3, 21.7, 24.1};
        pliant_geometry_to_world(&geometry, middle, centre);
        fill();
        const int32_t cells[3] = {5, 5, 5};
        EXPECT_EQ(pliant_mesh_grid(&geometry, cells, nullptr, &mesh), PLIANT_OK) << pliant_last_error();
    }
    ~Ball()
    {
        pliant_volume_free(&volume);
        pliant_mesh_free(&mesh);
    }

    void fill()
    {
        volume.slope = 1;
        float *voxels = static_cast<float *>(volume.voxels);
        const int32_t *size = volume.geometry.size;
        for (int k = 0; k < size[2]; k++)
            for (int j = 0; j < size[1]; j++)
                for (int i = 0; i < size[0]; i++) {
                    const double index[3] = {double(i), double(j), double(k)};
                    double x[3];
                    pliant_geometry_to_world(&volume.geometry, index, x);
                    double distance = std::sqrt(std::pow(x[0] - centre[0], 2) + std::pow(x[1] - centre[1], 2) +
                                                std::pow(x[2] - centre[2], 2));
                    *voxels++ = float(100 * (1 - distance / radius));
                }
    }

    pliant_ray ray_from(double x, double y, double z, const double to[3]) const
    {
        pliant_ray ray{};
        const double from[3] = {centre[0] + x, centre[1] + y, centre[2] + z};
        for (int d = 0; d < 3; d++) {
            ray.origin[d] = from[d];
            ray.direction[d] = to[d] - from[d];
        }
        return ray;
    }

    double from_centre(const double x[3]) const
    {
        return std::sqrt(std::pow(x[0] - centre[0], 2) + std::pow(x[1] - centre[1], 2) + std::pow(x[2] - centre[2], 2));
    }
};

const double STRAIGHT[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
// Rotated by 30 degrees around z and 40 around x.
const double OBLIQUE[9] = {0.8660254037844387, -0.38302222155948895, 0.3213938048432697,
                           0.5,                0.6634139481689384,   -0.5566703992264194,
                           0.0,                0.6427876096865393,   0.766044443118978};
const double FLIPPED[9] = {1, 0, 0, 0, 1, 0, 0, 0, -1};
const double EVEN[3] = {0.003, 0.003, 0.003};
const double UNEVEN[3] = {0.002, 0.003, 0.0035};

class PickBall : public testing::TestWithParam<int> {
protected:
    static const double *direction() { return GetParam() == 0 ? STRAIGHT : GetParam() == 1 ? OBLIQUE : FLIPPED; }
    static const double *spacing() { return GetParam() == 0 ? EVEN : UNEVEN; }
};

TEST_P(PickBall, RaysMeetTheSphere)
{
    Ball ball(direction(), spacing(), 0.025);
    for (int n = 0; n < 60; n++) {
        double a = 0.7 * n, b = -1.4 + 0.045 * n;
        // from 0.5 m away towards points around the centre
        const double aim[3] = {ball.centre[0] + 0.01 * std::sin(1.3 * n), ball.centre[1] + 0.01 * std::cos(2.1 * n),
                               ball.centre[2]};
        pliant_ray ray =
            ball.ray_from(0.5 * std::cos(a) * std::cos(b), 0.5 * std::sin(a) * std::cos(b), 0.5 * std::sin(b), aim);
        pliant_picked picked{};
        ASSERT_EQ(pliant_pick(&ball.volume, &ball.mesh, ball.mesh.rest, &ray, 0.0, &picked), PLIANT_OK)
            << pliant_last_error();
        ASSERT_TRUE(picked.hit) << n;
        // The values of a sphere are curved between voxels. So trilinear interpolation puts its surface slightly
        // inside.
        EXPECT_NEAR(ball.from_centre(picked.point), ball.radius, 1e-4) << n;
        EXPECT_NEAR(picked.intensity, 0, 0.02) << n;
        // the near side
        double towards = 0, length = 0;
        for (int d = 0; d < 3; d++) {
            towards += (picked.point[d] - ball.centre[d]) * ray.direction[d];
            length += ray.direction[d] * ray.direction[d];
        }
        EXPECT_LT(towards, 0) << n;
        for (int d = 0; d < 3; d++) {
            EXPECT_NEAR(picked.point[d], ray.origin[d] + picked.distance * ray.direction[d] / std::sqrt(length), 1e-9);
            EXPECT_NEAR(picked.rest[d], picked.point[d], 1e-9) << "the mesh is at rest";
        }
        double sum = 0, back[3] = {0, 0, 0};
        for (int v = 0; v < 4; v++) {
            sum += picked.barycentric[v];
            for (int d = 0; d < 3; d++)
                back[d] += picked.barycentric[v] * ball.mesh.rest[3 * ball.mesh.tets[4 * picked.tetrahedron + v] + d];
        }
        EXPECT_NEAR(sum, 1, 1e-12);
        for (int d = 0; d < 3; d++) EXPECT_NEAR(back[d], picked.point[d], 1e-9);
    }
}

TEST_P(PickBall, RaysThatMissHitNothing)
{
    Ball ball(direction(), spacing(), 0.025);
    for (double past : {0.0262, 0.04, 0.3}) {
        // a ray that passes the centre at distance `past`
        pliant_ray ray{};
        for (int d = 0; d < 3; d++) ray.origin[d] = ball.centre[d];
        ray.origin[0] -= 0.4;
        ray.origin[1] += past;
        ray.direction[0] = 3;
        pliant_picked picked{};
        picked.hit = true;
        ASSERT_EQ(pliant_pick(&ball.volume, &ball.mesh, ball.mesh.rest, &ray, 0.0, &picked), PLIANT_OK);
        EXPECT_FALSE(picked.hit) << past;
    }
    // a ray that points away from it
    const double aim[3] = {ball.centre[0] + 2, ball.centre[1], ball.centre[2]};
    pliant_ray away = ball.ray_from(1, 0, 0, aim);
    pliant_picked picked{};
    ASSERT_EQ(pliant_pick(&ball.volume, &ball.mesh, ball.mesh.rest, &away, 0.0, &picked), PLIANT_OK);
    EXPECT_FALSE(picked.hit);
}

INSTANTIATE_TEST_SUITE_P(Pick, PickBall, testing::Values(0, 1, 2));

TEST(Pick, ARayThatStartsInsideHitsWhereItStarts)
{
    Ball ball(OBLIQUE, UNEVEN, 0.025);
    const double aim[3] = {ball.centre[0], ball.centre[1], ball.centre[2] + 1};
    pliant_ray ray = ball.ray_from(0.012, 0.009, 0, aim); // 15 mm from the centre
    pliant_picked picked{};
    ASSERT_EQ(pliant_pick(&ball.volume, &ball.mesh, ball.mesh.rest, &ray, 0.0, &picked), PLIANT_OK);
    ASSERT_TRUE(picked.hit);
    EXPECT_EQ(picked.distance, 0);
    // Linear interpolation of the distance has an error of at most (sum of squared spacings) / 8 / 15 mm = 0.18 mm, or
    // 0.72 in value.
    EXPECT_NEAR(picked.intensity, 40, 0.72);
}

TEST(Pick, OnlyThePartBetweenNearAndFarCounts)
{
    Ball ball(STRAIGHT, EVEN, 0.025);
    pliant_ray ray = ball.ray_from(-0.3, 0, 0, ball.centre);
    pliant_picked picked{};
    ray.far = 0.27; // the sphere begins at 0.275
    ASSERT_EQ(pliant_pick(&ball.volume, &ball.mesh, ball.mesh.rest, &ray, 0.0, &picked), PLIANT_OK);
    EXPECT_FALSE(picked.hit);
    ray.far = 0.28;
    ASSERT_EQ(pliant_pick(&ball.volume, &ball.mesh, ball.mesh.rest, &ray, 0.0, &picked), PLIANT_OK);
    ASSERT_TRUE(picked.hit);
    EXPECT_NEAR(picked.distance, 0.275, 1e-4);
    ray.near = 0.29; // the near plane cuts the sphere
    ray.far = 0;
    ASSERT_EQ(pliant_pick(&ball.volume, &ball.mesh, ball.mesh.rest, &ray, 0.0, &picked), PLIANT_OK);
    ASSERT_TRUE(picked.hit);
    EXPECT_DOUBLE_EQ(picked.distance, 0.29);
    EXPECT_NEAR(picked.intensity, 60, 1);
}

TEST(Pick, TheRestPositionFollowsTheDeformation)
{
    Ball ball(OBLIQUE, EVEN, 0.025);
    // The same volume with another mesh: positions = A rest + b, so rest = A^-1 (x - b).
    std::vector<double> positions(3 * size_t(ball.mesh.num_nodes)),
        rest(ball.mesh.rest, ball.mesh.rest + 3 * ball.mesh.num_nodes);
    for (int32_t n = 0; n < ball.mesh.num_nodes; n++) {
        const double *x = &rest[3 * size_t(n)];
        for (int d = 0; d < 3; d++)
            positions[3 * size_t(n) + size_t(d)] =
                ball.centre[d] + 1.5 * (x[d] - ball.centre[d]) + (d == 0 ? 0.2 * (x[1] - ball.centre[1]) : 0);
    }
    pliant_ray ray = ball.ray_from(0.1, -0.3, 0.2, ball.centre);
    pliant_picked picked{};
    ASSERT_EQ(pliant_pick(&ball.volume, &ball.mesh, positions.data(), &ray, 0.0, &picked), PLIANT_OK);
    ASSERT_TRUE(picked.hit);
    double r[3];
    for (int d = 0; d < 3; d++) r[d] = picked.rest[d] - ball.centre[d];
    const double x[3] = {1.5 * r[0] + 0.2 * r[1], 1.5 * r[1], 1.5 * r[2]};
    for (int d = 0; d < 3; d++) EXPECT_NEAR(picked.point[d] - ball.centre[d], x[d], 1e-9);
}

TEST(Pick, RaysPassThroughVoxelsWithoutTissue)
{
    Ball ball(STRAIGHT, EVEN, 0.025);
    pliant_mesh_free(&ball.mesh);
    // tissue only in the half with larger i
    const int32_t cells[3] = {6, 5, 5};
    std::vector<uint8_t> keep(5 * 150);
    for (size_t n = 0; n < keep.size(); n++) keep[n] = n / 5 % 6 >= 3;
    ASSERT_EQ(pliant_mesh_grid(&ball.volume.geometry, cells, keep.data(), &ball.mesh), PLIANT_OK);
    // The ray runs along j at small i: the volume shows the ball, but there is no tissue.
    const double aim[3] = {ball.centre[0] - 0.02, ball.centre[1], ball.centre[2]};
    pliant_ray ray = ball.ray_from(-0.02, -0.3, 0, aim);
    pliant_picked picked{};
    ASSERT_EQ(pliant_pick(&ball.volume, &ball.mesh, ball.mesh.rest, &ray, 0.0, &picked), PLIANT_OK);
    EXPECT_FALSE(picked.hit);
    const double other[3] = {ball.centre[0] + 0.02, ball.centre[1], ball.centre[2]};
    ray = ball.ray_from(0.02, -0.3, 0, other);
    ASSERT_EQ(pliant_pick(&ball.volume, &ball.mesh, ball.mesh.rest, &ray, 0.0, &picked), PLIANT_OK);
    ASSERT_TRUE(picked.hit);
    EXPECT_NEAR(picked.point[1], ball.centre[1] - 0.015, 1e-4);
}

// The result is on the tissue's surface, not on the volume's box.
TEST(Pick, AThresholdBelowAllValuesFindsTheFirstTissue)
{
    Ball ball(STRAIGHT, EVEN, 0.025);
    pliant_mesh_free(&ball.mesh);
    const int32_t cells[3] = {6, 5, 5};
    std::vector<uint8_t> keep(5 * 150);
    for (size_t n = 0; n < keep.size(); n++) keep[n] = n / 5 % 6 >= 3;
    ASSERT_EQ(pliant_mesh_grid(&ball.volume.geometry, cells, keep.data(), &ball.mesh), PLIANT_OK);
    const double border = ball.mesh.corner[0] + 3 * ball.mesh.cell_size[0];
    pliant_picked picked{};
    for (double from : {-0.3, -0.03}) { // outside of the volume; inside of it but in front of the tissue
        pliant_ray ray = ball.ray_from(from, 0.003, 0.002, ball.centre);
        ASSERT_EQ(pliant_pick(&ball.volume, &ball.mesh, ball.mesh.rest, &ray, -1e6, &picked), PLIANT_OK);
        ASSERT_TRUE(picked.hit) << picked.reason;
        EXPECT_STREQ(picked.reason, "");
        EXPECT_NEAR(picked.point[0], border, 1e-6) << from;
        EXPECT_NEAR(picked.rest[0], border, 1e-6) << from;
        double length = 0;
        for (int d = 0; d < 3; d++) length += std::pow(picked.point[d] - ray.origin[d], 2);
        EXPECT_NEAR(picked.distance, std::sqrt(length), 1e-9);
        EXPECT_NEAR(picked.intensity, 100 * (1 - ball.from_centre(picked.point) / ball.radius), 3)
            << "interpolated near the middle";
    }
    // tissue before the near plane is skipped
    pliant_ray ray = ball.ray_from(-0.3, 0.003, 0.002, ball.centre);
    ray.near = 0.32;
    ASSERT_EQ(pliant_pick(&ball.volume, &ball.mesh, ball.mesh.rest, &ray, -1e6, &picked), PLIANT_OK);
    ASSERT_TRUE(picked.hit);
    EXPECT_DOUBLE_EQ(picked.distance, 0.32);
}

// Elements at the border also contain air.
TEST(Pick, TheFirstTissueIsNoAirInsideAnElement)
{
    const int size[3] = {20, 16, 16}, first = 7; // voxels of 2 mm, with air before `first`; cells of 5 voxels
    const double box[3] = {0.04, 0.032, 0.032};
    Body body(size, box, {{1, 0, 1, true}, {10e3, 0.4, 1000, false}}, [=](int i, int, int) { return i >= first; });
    body.cells(4, 4, 4, 1);
    body.fix_plane(0.038, 0, 0, -1, 0, 0);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    pliant_warp *warp = nullptr;
    const pliant_mesh *mesh = &body.model->body->fine;
    ASSERT_EQ(pliant_warp_create(&body.scan, mesh, &body.scan.geometry, 1, &warp), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_warp_update(warp, body.data->positions), PLIANT_OK);
    const pliant_ray ray{{-0.2, 0.0163, 0.0158}, {1, 0, 0}, 0, 0};
    pliant_picked element{}, tissue{}, surface{};
    ASSERT_EQ(pliant_pick_warped(warp, body.data->positions, &ray, -1e6, &element), PLIANT_OK);
    ASSERT_EQ(pliant_pick_tissue(body.model, warp, body.data->positions, &ray, -1e6, &tissue), PLIANT_OK);
    ASSERT_EQ(pliant_pick_tissue(body.model, warp, body.data->positions, &ray, 0.5, &surface), PLIANT_OK);
    ASSERT_TRUE(element.hit && tissue.hit && surface.hit) << tissue.reason;
    EXPECT_NEAR(element.point[0], 0.01, 1e-9);
    EXPECT_NEAR(tissue.point[0], 0.014 + 0.0005, 0.0005) << "within half a voxel behind its border";
    EXPECT_NEAR(surface.point[0], 0.014, 1e-6) << "an isosurface is where it is";
    pliant_warp_free(warp);
}

TEST(Pick, MissesHaveAReason)
{
    Ball ball(STRAIGHT, EVEN, 0.025);
    const double aim[3] = {ball.centre[0], ball.centre[1] + 0.5, ball.centre[2]};
    pliant_ray past = ball.ray_from(-0.3, 0.5, 0, aim), through = ball.ray_from(-0.3, 0, 0, ball.centre);
    pliant_picked picked{};
    ASSERT_EQ(pliant_pick(&ball.volume, &ball.mesh, ball.mesh.rest, &past, 0, &picked), PLIANT_OK);
    EXPECT_FALSE(picked.hit);
    EXPECT_STREQ(picked.reason, "the ray does not meet the deformed volume between near and far");
    ASSERT_EQ(pliant_pick(&ball.volume, &ball.mesh, ball.mesh.rest, &through, 1e6, &picked), PLIANT_OK);
    EXPECT_FALSE(picked.hit);
    EXPECT_STREQ(picked.reason, "no value along the ray reaches the threshold");
    std::vector<double> elsewhere(ball.mesh.rest, ball.mesh.rest + 3 * size_t(ball.mesh.num_nodes));
    for (double &x : elsewhere) x += 5;
    for (double threshold : {0.0, -1e6}) {
        ASSERT_EQ(pliant_pick(&ball.volume, &ball.mesh, elsewhere.data(), &through, threshold, &picked), PLIANT_OK);
        EXPECT_FALSE(picked.hit);
        EXPECT_STREQ(picked.reason, "where values along the ray reach the threshold there is no tissue");
    }
}

TEST(Pick, NotANumberIsRefusedAndLeavesTheOutputAlone)
{
    Ball ball(STRAIGHT, EVEN, 0.025);
    pliant_ray good = ball.ray_from(-0.3, 0, 0, ball.centre);
    const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
    pliant_picked picked{};
    picked.distance = 42;
    for (double bad : {nan, infinity}) {
        for (int field = 0; field < 5; field++) {
            pliant_ray ray = good;
            double threshold = 0;
            if (field == 0) ray.origin[1] = bad;
            if (field == 1) ray.direction[2] = bad;
            if (field == 2) ray.near = bad;
            if (field == 3) ray.far = bad;
            if (field == 4) threshold = bad;
            EXPECT_EQ(pliant_pick(&ball.volume, &ball.mesh, ball.mesh.rest, &ray, threshold, &picked),
                      PLIANT_ERROR_ARGUMENT)
                << field;
        }
    }
    pliant_ray still = good;
    for (double &x : still.direction) x = 0;
    EXPECT_EQ(pliant_pick(&ball.volume, &ball.mesh, ball.mesh.rest, &still, 0, &picked), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(picked.distance, 42);
    EXPECT_FALSE(picked.hit);
}

TEST(Pick, VoxelsThatAreNotNumbersAreNoSurface)
{
    Ball ball(STRAIGHT, EVEN, 0.025);
    float *voxels = static_cast<float *>(ball.volume.voxels);
    const int32_t *size = ball.volume.geometry.size;
    // NaN in front of the ball
    for (int k = 0; k < size[2]; k++)
        for (int j = 0; j < size[1]; j++)
            for (int i = 0; i < 6; i++)
                voxels[i + size[0] * (j + size[1] * k)] = std::numeric_limits<float>::quiet_NaN();
    pliant_ray ray = ball.ray_from(-0.3, 0, 0, ball.centre);
    pliant_picked picked{};
    ASSERT_EQ(pliant_pick(&ball.volume, &ball.mesh, ball.mesh.rest, &ray, 0.0, &picked), PLIANT_OK);
    ASSERT_TRUE(picked.hit);
    EXPECT_NEAR(picked.distance, 0.275, 1e-4);
}

TEST(Pick, FarAwayRaysEnd)
{
    Ball ball(STRAIGHT, EVEN, 0.025);
    pliant_picked picked{};
    for (double away : {1e6, 1e12, 1e30, 1e150}) {
        pliant_ray ray = ball.ray_from(-away, 0, 0, ball.centre);
        EXPECT_EQ(pliant_pick(&ball.volume, &ball.mesh, ball.mesh.rest, &ray, 0.0, &picked), PLIANT_OK) << away;
    }
}

// A pick in a warp gives the same result as a pick in its volume.
TEST(Pick, InAWarpAsInItsVolume)
{
    Ball ball(STRAIGHT, EVEN, 0.025);
    pliant_warp *warp = nullptr;
    ASSERT_EQ(pliant_warp_create(&ball.volume, &ball.mesh, &ball.volume.geometry, 2, &warp), PLIANT_OK)
        << pliant_last_error();
    std::vector<double> positions(ball.mesh.rest, ball.mesh.rest + 3 * ball.mesh.num_nodes);
    for (size_t n = 0; n < positions.size(); n++) positions[n] += 0.002 * std::sin(40 * positions[n] + double(n % 3));
    ASSERT_EQ(pliant_warp_update(warp, positions.data()), PLIANT_OK);
    int hits = 0;
    for (int n = 0; n < 40; n++) {
        const double aim[3] = {ball.centre[0] + 0.04 * std::sin(1.3 * n), ball.centre[1], ball.centre[2]};
        const pliant_ray ray = ball.ray_from(0.3 * std::cos(n), 0.3 * std::sin(n), 0.1, aim);
        pliant_picked there{}, here{};
        ASSERT_EQ(pliant_pick_warped(warp, positions.data(), &ray, 0.0, &there), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_pick(pliant_warp_volume(warp), &ball.mesh, positions.data(), &ray, 0.0, &here), PLIANT_OK);
        EXPECT_EQ(there.hit, here.hit);
        EXPECT_EQ(there.distance, here.distance);
        EXPECT_EQ(there.tetrahedron, here.tetrahedron);
        hits += there.hit;
    }
    EXPECT_GT(hits, 10);
    EXPECT_LT(hits, 40);
    const pliant_ray still{};
    pliant_picked picked{};
    EXPECT_EQ(pliant_pick_warped(warp, positions.data(), &still, 0.0, &picked), PLIANT_ERROR_ARGUMENT);
    pliant_warp_free(warp);
}

} // namespace
