// The target grid of a warp.
#include "warp_cases.h"

#include <cstdint>
#include <cstring>

namespace {

using namespace warp_cases;

TEST(target, is_the_scan_or_grows_by_whole_voxels)
{
    pliant_geometry scan = box_geometry(20, 30, 40), target = {};
    turn(scan, 0.3, false);
    ASSERT_EQ(pliant_warp_target(&scan, nullptr, 0, 0, 24000, &target), PLIANT_OK);
    EXPECT_EQ(std::memcmp(&scan, &target, sizeof scan), 0);

    scan = box_geometry(20, 30, 40);
    const double tissue[6] = {-0.0205, 0.03 - 0.00075, 0.099, -0.0005, 0.07425, 0.179};
    ASSERT_EQ(pliant_warp_target(&scan, tissue, 2, 0, 24000, &target), PLIANT_OK) << "the scan's own box";
    EXPECT_EQ(std::memcmp(&scan, &target, sizeof scan), 0);

    const double box[6] = {-0.0205, 0.036, 0.0995, -0.002, 0.0748, 0.149};
    ASSERT_EQ(pliant_warp_target(&scan, box, 2, 0.001, 100000, &target), PLIANT_OK);
    EXPECT_EQ(target.size[0], 21);
    EXPECT_EQ(target.size[1], 32);
    EXPECT_EQ(target.size[2], 41);
    const double origin[3] = {-0.021, 0.03, 0.098};
    for (int d = 0; d < 3; d++) EXPECT_NEAR(target.origin[d], origin[d], 1e-12);
}

// A margin grows the scan along its own axes, for any orientation.
TEST(target, grows_an_oblique_scan_as_any_other)
{
    pliant_geometry straight = box_geometry(40, 30, 20), turned = straight, targets[2];
    const double c = std::cos(0.785), s = std::sin(0.785);
    const double about_k[9] = {c, -s, 0, s, c, 0, 0, 0, 1};
    std::memcpy(turned.direction, about_k, sizeof about_k);
    int number = 0;
    for (const pliant_geometry &scan : {straight, turned}) {
        std::vector<double> corners;
        for (int corner = 0; corner < 8; corner++) {
            double index[3], world[3];
            for (int d = 0; d < 3; d++) index[d] = corner >> d & 1 ? scan.size[d] - 0.5 : -0.5;
            pliant_geometry_to_world(&scan, index, world);
            corners.insert(corners.end(), world, world + 3);
        }
        ASSERT_EQ(pliant_warp_target(&scan, corners.data(), 8, 0.0045, SIZE_MAX, &targets[number++]), PLIANT_OK);
    }
    for (int d = 0; d < 3; d++) {
        EXPECT_EQ(targets[1].size[d], targets[0].size[d]);
        EXPECT_EQ(targets[0].size[d], straight.size[d] + 2 * int(std::ceil(0.0045 / straight.spacing[d])));
    }
}

TEST(target, refuses_what_cannot_be)
{
    pliant_geometry scan = box_geometry(20, 30, 40), target = {};
    const double huge[3] = {1e30, 1, 1}, nan[3] = {std::nan(""), 1, 1}, near[3] = {0, 0, 0};
    EXPECT_EQ(pliant_warp_target(&scan, nullptr, 0, 0, 23999, &target), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_warp_target(&scan, huge, 1, 0, SIZE_MAX, &target), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_warp_target(&scan, nan, 1, 0, SIZE_MAX, &target), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_warp_target(&scan, near, 1, -0.1, SIZE_MAX, &target), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_warp_target(&scan, near, 1, std::nan(""), SIZE_MAX, &target), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(target.size[0], 0) << "untouched";
}

} // namespace
