// Volumes, their boxes and slices as messages.
#include "grids.h"
#include "pliant/ros/convert.h"
#include "ros/output/noise.h"
#include "ros/output/sent_volume.h"
#include "scan/volume.h"
#include "model_data/data.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>

using namespace pliant_ros;

namespace {

TEST(Convert, ChangedBricksBecomeBoxes)
{
    const int32_t count[3] = {4, 4, 2}, size[3] = {60, 64, 20}; /* the last bricks are smaller */
    std::vector<uint8_t> changed(32, 0);
    EXPECT_TRUE(changed_boxes(count, changed.data(), size).empty());
    changed[0] = changed[1] = 1;        /* (0..1, 0, 0) */
    changed[3 + 4 * (3 + 4 * 1)] = 1;   /* (3, 3, 1) */
    std::vector<Box> boxes = changed_boxes(count, changed.data(), size);
    ASSERT_EQ(boxes.size(), 2u);
    EXPECT_EQ(boxes[0].size[0], 32u);
    EXPECT_EQ(boxes[0].size[1], 16u);
    EXPECT_EQ(boxes[1].offset[0], 48u);
    EXPECT_EQ(boxes[1].size[0], 12u);
    EXPECT_EQ(boxes[1].size[1], 16u);
    EXPECT_EQ(boxes[1].size[2], 4u);
    std::fill(changed.begin(), changed.end(), 1);
    boxes = changed_boxes(count, changed.data(), size);
    ASSERT_EQ(boxes.size(), 1u);
    for (int d = 0; d < 3; ++d) EXPECT_EQ(boxes[0].size[d], static_cast<uint32_t>(size[d]));
}

/* for any pattern */
TEST(Convert, EveryChangedBrickIsInABox)
{
    const int32_t count[3] = {5, 5, 5}, size[3] = {80, 80, 80};
    uint32_t random = 1;
    for (int round = 0; round < 200; ++round) {
        std::vector<uint8_t> changed(125, 0);
        for (int i = 0; i < round % 12; ++i) changed[((random = random * 1664525 + 1013904223) >> 8) % 125] = 1;
        std::vector<Box> boxes = changed_boxes(count, changed.data(), size);
        for (uint32_t brick = 0; brick < 125; ++brick) {
            if (!changed[brick]) continue;
            const uint32_t at[3] = {brick % 5 * 16, brick / 5 % 5 * 16, brick / 25 * 16};
            bool covered = false;
            for (const Box &box : boxes) {
                bool inside = true;
                for (int d = 0; d < 3; ++d)
                    inside = inside && box.offset[d] <= at[d] && at[d] + 16 <= box.offset[d] + box.size[d];
                covered = covered || inside;
            }
            EXPECT_TRUE(covered) << "brick " << brick;
        }
    }
}

/* 40 x 24 x 33 voxels with changing bricks, and the volume that a viewer assembles from the sent bricks. */
class SentVolumeTest : public ::testing::TestWithParam<pliant_encoding> {
protected:
    void SetUp() override
    {
        volume_.encoding = GetParam();
        volume_.slope = 0.5f;
        for (int d = 0; d < 3; ++d) volume_.geometry.size[d] = size_[d];
        set_all([](size_t v) { return static_cast<double>(v % 100); });
        whole_.offset[0] = whole_.offset[1] = whole_.offset[2] = 0;
        for (int d = 0; d < 3; ++d) whole_.size[d] = static_cast<uint32_t>(size_[d]);
    }

    size_t voxels() const { return 40 * 24 * 33; }

    double stored(const std::vector<float> &of, size_t v) const
    {
        const void *data = of.data();
        if (GetParam() == PLIANT_UINT8) return static_cast<const uint8_t *>(data)[v];
        if (GetParam() == PLIANT_INT16) return static_cast<const int16_t *>(data)[v];
        return of[v];
    }

    template <class Function> void set_all(Function function)
    {
        for (size_t v = 0; v < voxels(); ++v) {
            if (GetParam() == PLIANT_UINT8)
                reinterpret_cast<uint8_t *>(now_.data())[v] = static_cast<uint8_t>(function(v));
            else if (GetParam() == PLIANT_INT16)
                reinterpret_cast<int16_t *>(now_.data())[v] = static_cast<int16_t>(function(v));
            else now_[v] = static_cast<float>(function(v));
        }
        volume_.voxels = now_.data();
    }

    /* Sends the selected bricks to the viewer; returns their number. */
    size_t send(bool rests, std::vector<uint8_t> changed)
    {
        sent_.select(volume_, rests, &changed);
        for (const Box &box : changed_boxes(count_, changed.data(), size_)) {
            const size_t bytes = pliant_encoding_size(GetParam());
            for (uint32_t k = box.offset[2]; k < box.offset[2] + box.size[2]; ++k)
                for (uint32_t j = box.offset[1]; j < box.offset[1] + box.size[1]; ++j) {
                    const size_t at = bytes * (box.offset[0] + 40 * (j + 24 * static_cast<size_t>(k)));
                    std::memcpy(reinterpret_cast<char *>(viewer_.data()) + at,
                                reinterpret_cast<char *>(now_.data()) + at, bytes * box.size[0]);
                }
            sent_.keep(volume_, box);
        }
        return static_cast<size_t>(std::count(changed.begin(), changed.end(), 1));
    }

    double largest_error() const
    {
        double maximum = 0;
        for (size_t v = 0; v < voxels(); ++v)
            maximum = std::max(maximum, 0.5 * std::abs(stored(now_, v) - stored(viewer_, v)));
        return maximum;
    }

    const int32_t size_[3] = {40, 24, 33}, count_[3] = {3, 2, 3};
    pliant_volume volume_{};
    Box whole_{};
    std::vector<float> now_ = std::vector<float>(40 * 24 * 33), viewer_ = now_;
    SentVolume sent_;
};

TEST_P(SentVolumeTest, StaysBelowTheThresholdInMotionAndIsExactAtRest)
{
    const double threshold = 3; // in values, which is 6 stored units
    const std::vector<uint8_t> all(18, 1), none(18, 0);
    sent_.start(threshold, whole_);
    sent_.keep(volume_, whole_);
    viewer_ = now_;
    size_t total = 0;
    for (int round = 1; round <= 30; ++round) {
        // a slow drift everywhere, and a fast one in the first brick
        set_all([&](size_t v) {
            return static_cast<double>(v % 100) + round / 2 +
                   (v % 40 < 16 && v / 40 % 24 < 16 && v / 960 < 16 ? 3 * round : 0);
        });
        total += send(false, all);
        EXPECT_LT(largest_error(), threshold) << round;
    }
    EXPECT_GE(total, 15u + 17 * 2);  // the first brick in every second round, the others in two of them
    EXPECT_LE(total, 30u + 17 * 3);
    EXPECT_TRUE(sent_.has_unsent_bricks());
    EXPECT_GT(largest_error(), 0);
    EXPECT_GT(send(true, none), 0u);
    EXPECT_EQ(largest_error(), 0);
    EXPECT_EQ(send(true, none), 0u);
    EXPECT_FALSE(sent_.has_unsent_bricks());
}

TEST_P(SentVolumeTest, WithoutAThresholdEveryChangeIsSent)
{
    sent_.start(0, whole_);
    sent_.keep(volume_, whole_);
    EXPECT_EQ(send(false, std::vector<uint8_t>(18, 1)), 18u);
    EXPECT_FALSE(sent_.has_unsent_bricks());
}

TEST_P(SentVolumeTest, NothingOutsideTheRegionIsSent)
{
    Box region = whole_;
    region.size[0] = 20;
    sent_.start(3, region);
    sent_.keep(volume_, region);
    set_all([](size_t v) { return static_cast<double>(v % 100) + 50; });
    EXPECT_EQ(send(false, std::vector<uint8_t>(18, 1)), 12u);
    set_all([](size_t v) { return static_cast<double>(v % 100) + 51; });
    EXPECT_EQ(send(false, std::vector<uint8_t>(18, 1)), 0u);
    EXPECT_EQ(send(true, std::vector<uint8_t>(18, 0)), 12u);
}

INSTANTIATE_TEST_SUITE_P(Encodings, SentVolumeTest, ::testing::Values(PLIANT_UINT8, PLIANT_INT16, PLIANT_FLOAT32));

TEST(Noise, OfAScanIsItsStandardDeviation)
{
    pliant_volume scan{};
    std::vector<int16_t> voxels(64 * 64 * 16);
    for (int d = 0; d < 3; ++d) scan.geometry.size[d] = d < 2 ? 64 : 16;
    scan.encoding = PLIANT_INT16;
    scan.slope = 2;
    scan.intercept = -1000;
    scan.voxels = voxels.data();
    EXPECT_EQ(noise_of(scan), 0);
    uint32_t random = 1;
    for (size_t v = 0; v < voxels.size(); ++v) {
        double normal = -6; // sum of 12 uniform numbers
        for (int n = 0; n < 12; ++n)
            normal += static_cast<double>((random = random * 1664525 + 1013904223) >> 8) / 16777216.0;
        const bool air = v % 64 < 20, bone = v % 64 > 50;
        voxels[v] = air ? 0 : static_cast<int16_t>(std::lround((bone ? 1500 : 500) + 10 * normal));
    }
    // 4 of 31 noisy positions lie at an edge: the median is the quantile of 0.574 of the others, at 0.796 standard
    // deviations instead of 0.674
    EXPECT_NEAR(noise_of(scan), 20 * 0.796 / 0.674, 1);
}

class ConvertVolume : public ::testing::Test {
protected:
    void SetUp() override
    {
        pliant_geometry grid = geometry(straight);
        volume.geometry = grid;
        volume.encoding = PLIANT_INT16;
        volume.slope = 2;
        volume.intercept = -1000;
        volume.background = -3;
        stored.resize(4 * 5 * 6);
        for (size_t i = 0; i < stored.size(); ++i) stored[i] = static_cast<int16_t>(10 * i - 300);
        volume.voxels = stored.data();
    }
    static float pixel(const sensor_msgs::Image &image, uint32_t column, uint32_t row)
    {
        float value;
        std::memcpy(&value, &image.data[row * image.step + column * sizeof value], sizeof value);
        return value;
    }
    std::vector<int16_t> stored;
    pliant_volume volume{};
};

TEST_F(ConvertVolume, BoxHoldsItsVoxels)
{
    Volume message;
    volume_message(volume, Box{{0, 0, 0}, {4, 5, 6}}, Box{{1, 2, 3}, {2, 3, 2}}, &message);
    ASSERT_EQ(message.data.size(), 2u * 3 * 2 * 2);
    EXPECT_EQ(message.full_size[2], 6u);
    EXPECT_EQ(message.encoding, Volume::INT16);
    EXPECT_FLOAT_EQ(message.intercept, -1000);
    for (uint32_t k = 0; k < 2; ++k)
        for (uint32_t j = 0; j < 3; ++j)
            for (uint32_t i = 0; i < 2; ++i) {
                int16_t value;
                std::memcpy(&value, &message.data[2 * (i + 2 * (j + 3 * k))], 2);
                EXPECT_EQ(value, stored[(i + 1) + 4 * ((j + 2) + 5 * (k + 3))]);
            }
}

TEST_F(ConvertVolume, ARegionIsAVolumeOfItsOwn)
{
    const Box region{{1, 1, 2}, {3, 3, 4}};
    Volume message, preview;
    volume_message(volume, region, Box{{2, 2, 3}, {1, 1, 1}}, &message);
    int16_t value;
    std::memcpy(&value, message.data.data(), 2);
    EXPECT_EQ(value, stored[2 + 4 * (2 + 5 * 3)]);
    preview_message(volume, region, 2, &preview);
    const double first[3] = {1, 1, 2};
    double world[3];
    pliant_geometry_to_world(&volume.geometry, first, world);
    for (const Volume *each : {&message, &preview}) {
        EXPECT_DOUBLE_EQ(each->origin.position.x, world[0]);
        EXPECT_DOUBLE_EQ(each->origin.position.z, world[2]);
    }
    for (int d = 0; d < 3; ++d) {
        EXPECT_EQ(message.full_size[d], region.size[d]);
        EXPECT_EQ(message.offset[d], 1u);
        EXPECT_EQ(preview.full_size[d], 2u);
        EXPECT_EQ(preview.size[d], 2u);
    }
    EXPECT_DOUBLE_EQ(preview.spacing.y, 2 * volume.geometry.spacing[1]);
    ASSERT_EQ(preview.data.size(), 16u);
    std::memcpy(&value, &preview.data[2 * 7], 2);
    EXPECT_EQ(value, stored[3 + 4 * (3 + 5 * 4)]);
}

TEST_F(ConvertVolume, RegionsHoldTheCentresBetweenTheirCorners)
{
    const double *origin = volume.geometry.origin; /* spacing 1, 2, 3 mm */
    double low[3], high[3];
    for (int d = 0; d < 3; ++d) low[d] = origin[d] + 0.0005, high[d] = origin[d] + 0.006;
    const Box box = region_box(volume.geometry, low, high);
    const uint32_t offset[] = {1, 1, 1}, size[] = {3, 3, 2};
    for (int d = 0; d < 3; ++d) EXPECT_EQ(box.offset[d], offset[d]);
    for (int d = 0; d < 3; ++d) EXPECT_EQ(box.size[d], size[d]);
    for (int d = 0; d < 3; ++d) low[d] = -INFINITY, high[d] = INFINITY;
    const Box all = region_box(volume.geometry, low, high);
    for (int d = 0; d < 3; ++d) EXPECT_EQ(all.size[d], static_cast<uint32_t>(volume.geometry.size[d]));
    for (int d = 0; d < 3; ++d) low[d] = high[d] = 50;
    for (int d = 0; d < 3; ++d) EXPECT_EQ(region_box(volume.geometry, low, high).size[d], 1u) << "outside: the nearest";
}

TEST(Convert, TheNearestBoxesAreMerged)
{
    const std::vector<Box> boxes{{{0, 0, 0}, {4, 4, 4}}, {{90, 0, 0}, {4, 4, 4}}, {{5, 0, 0}, {4, 4, 4}}};
    const std::vector<Box> two = merged_boxes(boxes, 2);
    ASSERT_EQ(two.size(), 2u);
    EXPECT_EQ(two[0].size[0], 9u);
    EXPECT_EQ(two[1].offset[0], 90u);
    EXPECT_EQ(merged_boxes(boxes, 3).size(), 3u);
    const std::vector<Box> one = merged_boxes(std::vector<Box>(1000, boxes[2]), 8);
    ASSERT_EQ(one.size(), 1u);
    EXPECT_EQ(one[0].size[0], 4u);
    EXPECT_EQ(common_box(boxes[0], boxes[2]).size[0], 0u);
    EXPECT_EQ(common_box(two[0], boxes[2]).offset[0], 5u);
}

// The boxes of an update contain every voxel of every changed brick, for any merging.
TEST(Convert, MergedBoxesHoldAllThatChanged)
{
    unsigned seed = 3;
    const auto random = [&seed](uint32_t below) { return (seed = seed * 1664525u + 1013904223u) / 65536u % below; };
    for (int round = 0; round < 200; ++round) {
        std::vector<Box> boxes;
        for (uint32_t count = 1 + random(30); count > 0; --count)
            boxes.push_back(
                {{random(12) * 16, random(9) * 16, random(7) * 16}, {1 + random(16), 1 + random(16), 1 + random(16)}});
        for (size_t maximum : {1u, 8u}) {
            const std::vector<Box> merged = merged_boxes(boxes, maximum);
            ASSERT_LE(merged.size(), maximum);
            for (const Box &box : boxes)
                ASSERT_TRUE(std::any_of(merged.begin(), merged.end(), [&box](const Box &all) {
                    const Box common = common_box(all, box);
                    return std::equal(common.size, common.size + 3, box.size) &&
                           std::equal(common.offset, common.offset + 3, box.offset);
                }));
        }
    }
}

TEST_F(ConvertVolume, APlacedSliceLiesWhereItsVoxelsDo)
{
    sensor_msgs::Image image;
    Volume placed;
    slice_message(volume, CORONAL, 0.5, &image);
    placed_slice_message(volume, CORONAL, 0.5, &placed);
    EXPECT_EQ(placed.data, image.data);
    EXPECT_EQ(placed.encoding, Volume::FLOAT32);
    EXPECT_EQ(placed.size[0], image.width);
    EXPECT_EQ(placed.size[1], image.height);
    EXPECT_EQ(placed.size[2], 1u);
    const uint32_t size[3] = {placed.size[0], placed.size[1], placed.size[2]};
    pliant_geometry grid;
    std::string why;
    ASSERT_TRUE(geometry_from_message(size, placed.origin, placed.flipped, placed.spacing, &grid, &why)) << why;
    const double pixel_at[3] = {3, 17, 0}; /* the last pixel: patient's left, inferior */
    double world[3], index[3];
    pliant_geometry_to_world(&grid, pixel_at, world);
    pliant_geometry_to_index(&volume.geometry, world, index);
    EXPECT_NEAR(index[0], 3, 1e-6);
    EXPECT_NEAR(index[1], 2, 1e-6) << "the middle of five";
    EXPECT_NEAR(index[2], -1.0 / 3, 1e-6) << "1 mm below the first centre";
}

/* spacing 1, 2, 3 mm along x, y, z: pixels of 1 mm */
TEST_F(ConvertVolume, SlicesHaveSquarePixelsAndRadiologicalAxes)
{
    sensor_msgs::Image axial, coronal, sagittal;
    slice_message(volume, AXIAL, 0.5 / 6, &axial); /* through the centres of plane 0 */
    EXPECT_EQ(axial.encoding, "32FC1");
    EXPECT_EQ(axial.width, 4u);
    EXPECT_EQ(axial.height, 10u);
    /* row 0.5 mm inside the first voxel, whose centre is at 1 mm: clamped to it; one row later beyond its centre */
    EXPECT_FLOAT_EQ(pixel(axial, 0, 0), 2.0f * stored[0] - 1000);
    EXPECT_FLOAT_EQ(pixel(axial, 3, 0), 2.0f * stored[3] - 1000);
    EXPECT_NEAR(pixel(axial, 0, 1), 2.0f * (stored[0] + 0.25f * (stored[4] - stored[0])) - 1000, 0.01);
    EXPECT_GT(pixel(axial, 0, 9), pixel(axial, 0, 0)) << "down is posterior: larger y";
    slice_message(volume, CORONAL, 0.5, &coronal);
    EXPECT_EQ(coronal.width, 4u);
    EXPECT_EQ(coronal.height, 18u);
    EXPECT_GT(pixel(coronal, 0, 0), pixel(coronal, 0, 17)) << "up is superior: larger z";
    slice_message(volume, SAGITTAL, 0.5, &sagittal);
    EXPECT_EQ(sagittal.width, 10u);
    EXPECT_EQ(sagittal.height, 18u);
    EXPECT_GT(pixel(sagittal, 9, 5), pixel(sagittal, 0, 5)) << "right is posterior: larger y";
}

/* The same values stored with reversed axes give the same slice. */
TEST_F(ConvertVolume, SlicesDoNotDependOnTheOrderOfStorage)
{
    sensor_msgs::Image before, after;
    slice_message(volume, AXIAL, 0.4, &before);
    pliant_volume turned = volume;
    std::vector<int16_t> reversed(stored.size());
    for (size_t k = 0; k < 6; ++k)
        for (size_t j = 0; j < 5; ++j)
            for (size_t i = 0; i < 4; ++i) reversed[(3 - i) + 4 * ((4 - j) + 5 * k)] = stored[i + 4 * (j + 5 * k)];
    turned.voxels = reversed.data();
    turned.geometry.direction[0] = turned.geometry.direction[4] = -1;
    turned.geometry.origin[0] += 3 * 0.001;
    turned.geometry.origin[1] += 4 * 0.002;
    slice_message(turned, AXIAL, 0.4, &after);
    ASSERT_EQ(before.width, after.width);
    ASSERT_EQ(before.height, after.height);
    for (uint32_t row = 0; row < before.height; ++row)
        for (uint32_t column = 0; column < before.width; ++column)
            EXPECT_NEAR(pixel(before, column, row), pixel(after, column, row), 1e-2);
}

TEST_F(ConvertVolume, OutsideATiltedGridIsBackground)
{
    double direction[9];
    const double axis[3] = {0, 0, 1};
    rodrigues(axis, 0.7, direction);
    std::memcpy(volume.geometry.direction, direction, sizeof direction);
    sensor_msgs::Image image;
    slice_message(volume, AXIAL, 0.5, &image);
    EXPECT_FLOAT_EQ(pixel(image, 0, 0), 2 * -3.0f - 1000);
}

} // namespace
