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
    ASSERT_EQ(pliant_warp_target(&scan, nullptr, nullptr, 24000, &target), PLIANT_OK);
    EXPECT_EQ(std::memcmp(&scan, &target, sizeof scan), 0);

    scan = box_geometry(20, 30, 40);
    const double tissue_low[3] = {-0.0205, 0.03 - 0.00075, 0.099}, tissue_high[3] = {-0.0005, 0.07425, 0.179};
    ASSERT_EQ(pliant_warp_target(&scan, tissue_low, tissue_high, 24000, &target), PLIANT_OK) << "the scan's own box";
    EXPECT_EQ(std::memcmp(&scan, &target, sizeof scan), 0);

    const double low[3] = {-0.0215, 0.035, 0.0985}, high[3] = {-0.001, 0.0758, 0.15};
    ASSERT_EQ(pliant_warp_target(&scan, low, high, 100000, &target), PLIANT_OK);
    EXPECT_EQ(target.size[0], 21);
    EXPECT_EQ(target.size[1], 32);
    EXPECT_EQ(target.size[2], 41);
    const double origin[3] = {-0.021, 0.03, 0.098};
    for (int d = 0; d < 3; d++) EXPECT_NEAR(target.origin[d], origin[d], 1e-12);
}

TEST(target, refuses_what_cannot_be)
{
    pliant_geometry scan = box_geometry(20, 30, 40), target = {};
    const double low[3] = {0, 0, 0}, huge[3] = {1e30, 1, 1}, nan[3] = {std::nan(""), 1, 1}, below[3] = {-1, 1, 1};
    EXPECT_EQ(pliant_warp_target(&scan, nullptr, nullptr, 23999, &target), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_warp_target(&scan, low, huge, SIZE_MAX, &target), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_warp_target(&scan, low, nan, SIZE_MAX, &target), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_warp_target(&scan, low, below, SIZE_MAX, &target), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_warp_target(&scan, low, nullptr, SIZE_MAX, &target), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(target.size[0], 0) << "untouched";
}

} // namespace
