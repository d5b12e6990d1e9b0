#include "base/memory.h"
#include "scan/volume.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

namespace {

/* oblique, left-handed, anisotropic */
pliant_geometry oblique()
{
    pliant_geometry geometry = {{5, 6, 7}, {-0.1, 0.2, -1.5}, {0.0007, 0.0008, 0.0025}, {}};
    const double c = std::cos(0.3), s = std::sin(0.3);
    const double direction[9] = {c, -s, 0, s, c, 0, 0, 0, -1};
    std::memcpy(geometry.direction, direction, sizeof direction);
    return geometry;
}

} // namespace

TEST(Geometry, WorldOfCornersByHand)
{
    pliant_geometry geometry = oblique();
    const double index[3] = {2, 1, 4};
    double world[3];
    pliant_geometry_to_world(&geometry, index, world);
    const double c = std::cos(0.3), s = std::sin(0.3);
    EXPECT_NEAR(world[0], -0.1 + c * 0.0014 - s * 0.0008, 1e-15);
    EXPECT_NEAR(world[1], 0.2 + s * 0.0014 + c * 0.0008, 1e-15);
    EXPECT_NEAR(world[2], -1.5 - 0.01, 1e-15);
}

TEST(Geometry, IndexInvertsWorldAlsoInPlace)
{
    pliant_geometry geometry = oblique();
    const double index[3] = {-1.25, 17.5, 3.125};
    double point[3];
    pliant_geometry_to_world(&geometry, index, point);
    pliant_geometry_to_index(&geometry, point, point);
    for (int d = 0; d < 3; d++) EXPECT_NEAR(point[d], index[d], 1e-9);
}

TEST(Geometry, CountsVoxelsAndDetectsOverflow)
{
    pliant_geometry geometry = oblique();
    EXPECT_EQ(pliant_geometry_voxels(&geometry), 210u);
    for (int32_t &n : geometry.size) n = std::numeric_limits<int32_t>::max();
    EXPECT_EQ(pliant_geometry_voxels(&geometry), 0u);
    geometry.size[1] = -3;
    EXPECT_EQ(pliant_geometry_voxels(&geometry), 0u);
}

TEST(Geometry, EqualUpToRounding)
{
    pliant_geometry a = oblique(), b = a;
    for (double &x : b.origin) x = static_cast<float>(x);
    for (double &x : b.spacing) x = static_cast<float>(x);
    for (double &x : b.direction) x = static_cast<float>(x);
    EXPECT_TRUE(pliant_geometry_equal(&a, &b));

    b = a;
    b.origin[2] += 0.001 * a.spacing[0];
    EXPECT_FALSE(pliant_geometry_equal(&a, &b));
    b = a;
    b.spacing[1] *= 1.001;
    EXPECT_FALSE(pliant_geometry_equal(&a, &b));
    b = a;
    b.direction[8] = 1;
    EXPECT_FALSE(pliant_geometry_equal(&a, &b));
    b = a;
    b.size[0]++;
    EXPECT_FALSE(pliant_geometry_equal(&a, &b));
    b = a;
    b.origin[0] = std::nan("");
    EXPECT_FALSE(pliant_geometry_equal(&a, &b));
}

TEST(Volume, IsZeroedAndUnscaled)
{
    pliant_geometry geometry = oblique();
    for (pliant_encoding encoding : {PLIANT_UINT8, PLIANT_INT16, PLIANT_FLOAT32}) {
        pliant_volume volume;
        ASSERT_EQ(pliant_volume_create(&geometry, encoding, &volume), PLIANT_OK);
        EXPECT_EQ(volume.encoding, encoding);
        EXPECT_EQ(volume.slope, 1.0f);
        EXPECT_EQ(volume.intercept, 0.0f);
        for (size_t n = 0; n < 210; n++) EXPECT_EQ(pliant_volume_value(&volume, n), 0.0f);
        pliant_volume_free(&volume);
        EXPECT_EQ(volume.voxels, nullptr);
    }
    pliant_volume_free(nullptr);
    pliant_labels_free(nullptr);
}

TEST(Volume, ValueAppliesSlopeAndIntercept)
{
    pliant_geometry geometry = oblique();
    pliant_volume volume;
    ASSERT_EQ(pliant_volume_create(&geometry, PLIANT_INT16, &volume), PLIANT_OK);
    static_cast<int16_t *>(volume.voxels)[209] = -300;
    volume.slope = 0.5f;
    volume.intercept = -1024.0f;
    EXPECT_EQ(pliant_volume_value(&volume, 209), -1174.0f);
    pliant_volume_free(&volume);
}

TEST(Volume, RefusesWhatIsNoGrid)
{
    const double bad_spacing[] = {0.0, -0.001, std::nan(""), std::numeric_limits<double>::infinity()};
    for (double spacing : bad_spacing) {
        pliant_geometry geometry = oblique();
        geometry.spacing[1] = spacing;
        pliant_volume volume = {};
        EXPECT_EQ(pliant_volume_create(&geometry, PLIANT_INT16, &volume), PLIANT_ERROR_ARGUMENT);
        EXPECT_NE(std::strstr(pliant_last_error(), "spacing along j"), nullptr);
        EXPECT_EQ(volume.voxels, nullptr);
    }
    pliant_geometry geometry = oblique();
    pliant_volume volume = {};
    pliant_labels labels = {};
    geometry.direction[1] += 0.01;
    EXPECT_EQ(pliant_volume_create(&geometry, PLIANT_UINT8, &volume), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_labels_create(&geometry, &labels), PLIANT_ERROR_ARGUMENT);
    geometry = oblique();
    geometry.size[2] = 0;
    EXPECT_EQ(pliant_volume_create(&geometry, PLIANT_UINT8, &volume), PLIANT_ERROR_ARGUMENT);
    for (int32_t &n : geometry.size) n = std::numeric_limits<int32_t>::max();
    EXPECT_EQ(pliant_volume_create(&geometry, PLIANT_UINT8, &volume), PLIANT_ERROR_ARGUMENT);
    geometry = oblique();
    EXPECT_EQ(pliant_volume_create(&geometry, static_cast<pliant_encoding>(9), &volume), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(volume.voxels, nullptr);
}

TEST(Volume, OutOfMemoryLeavesTheOutput)
{
    pliant_geometry geometry = oblique();
    pliant_volume volume = {};
    pliant_labels labels = {};
    volume.slope = 7.0f;
    pliant_memory_fail_after(0);
    EXPECT_EQ(pliant_volume_create(&geometry, PLIANT_INT16, &volume), PLIANT_ERROR_MEMORY);
    pliant_memory_fail_after(0);
    EXPECT_EQ(pliant_labels_create(&geometry, &labels), PLIANT_ERROR_MEMORY);
    pliant_memory_fail_after(-1);
    EXPECT_EQ(volume.slope, 7.0f);
    EXPECT_EQ(volume.voxels, nullptr);
    EXPECT_EQ(labels.voxels, nullptr);
}
