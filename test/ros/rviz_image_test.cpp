// Volumes for upload to the graphics card: checks, conversion, ranges, boxes, subsampling.
#include "rviz/volume_image.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

using namespace pliant_rviz;

namespace {

template <class Stored> struct Source {
    std::vector<Stored> voxels;
    VolumeView view;

    Source(Size size, uint8_t encoding) : voxels(size_t(size[0]) * size[1] * size[2])
    {
        view.scan_id = "scan";
        view.full_size = view.box.size = size;
        view.position = {{0, 0, 0}};
        view.orientation = {{0, 0, 0, 1}};
        view.flipped = false;
        view.spacing = {{0.001, 0.001, 0.001}};
        view.encoding = encoding;
        view.slope = 1;
        view.intercept = 0;
        attach();
    }
    void attach()
    {
        view.data = reinterpret_cast<const uint8_t *>(voxels.data());
        view.bytes = voxels.size() * sizeof(Stored);
    }
};

// a texel of the image as a value
double value(const VolumeImage &image, uint32_t i, uint32_t j, uint32_t k)
{
    std::vector<uint8_t> bytes;
    image.copy({{{i, j, k}}, {{1, 1, 1}}}, bytes);
    if (image.bits() == 8) return image.value_offset() + image.value_scale() * bytes[0] / 255.0;
    uint16_t texel;
    std::memcpy(&texel, bytes.data(), 2);
    return image.value_offset() + image.value_scale() * texel / 65535.0;
}

TEST(VolumeCheck, NamesTheProblem)
{
    Source<int16_t> good({{4, 3, 2}}, INT16);
    EXPECT_EQ(check(good.view), "");
    auto broken = [&](void (*breaks)(VolumeView &), const char *word) {
        VolumeView view = good.view;
        breaks(view);
        EXPECT_NE(check(view).find(word), std::string::npos) << word << ": " << check(view);
    };
    broken([](VolumeView &v) { v.bytes--; }, "does not match the data");
    broken([](VolumeView &v) { v.bytes = 0; }, "does not match the data");
    broken([](VolumeView &v) { v.encoding = UINT8; }, "does not match the data");
    broken([](VolumeView &v) { v.encoding = 7; }, "unknown encoding 7");
    broken([](VolumeView &v) { v.encoding = 0; }, "unknown encoding 0");
    broken([](VolumeView &v) { v.box.size[1] = 0; }, "empty");
    broken([](VolumeView &v) { v.full_size[2] = 0; }, "empty");
    broken([](VolumeView &v) { v.box.offset[0] = 1; }, "leaves the volume");
    broken([](VolumeView &v) { v.box.offset[0] = 0xffffffff; }, "leaves the volume");
    broken(
        [](VolumeView &v) {
            v.full_size = v.box.size = {{0xffffffff, 0xffffffff, 0xffffffff}};
        },
        "does not match the data");
    // 2^32 x 2^31 x 2 voxels would be 0 in 64 bits
    broken(
        [](VolumeView &v) {
            v.full_size = v.box.size = {{0x80000000u, 0x80000000u, 4}};
            v.bytes = 0;
        },
        "does not match the data");
    broken([](VolumeView &v) { v.spacing[1] = 0; }, "spacing");
    broken([](VolumeView &v) { v.spacing[1] = -0.001; }, "spacing");
    broken([](VolumeView &v) { v.spacing[2] = std::numeric_limits<double>::quiet_NaN(); }, "spacing");
    broken([](VolumeView &v) { v.spacing[2] = std::numeric_limits<double>::infinity(); }, "spacing");
    broken([](VolumeView &v) { v.position[0] = std::numeric_limits<double>::quiet_NaN(); }, "pose");
    broken([](VolumeView &v) { v.orientation[3] = std::numeric_limits<double>::quiet_NaN(); }, "pose");
    broken([](VolumeView &v) { v.orientation[3] = 0; }, "unit quaternion");
    broken([](VolumeView &v) { v.slope = 0; }, "slope");
    broken([](VolumeView &v) { v.intercept = std::numeric_limits<float>::quiet_NaN(); }, "slope");
}

TEST(VolumeImage, EightAndSixteenBitsAreExact)
{
    Source<uint8_t> bytes({{16, 16, 1}}, UINT8);
    bytes.view.slope = 2;
    bytes.view.intercept = -100;
    for (size_t n = 0; n < 256; n++) bytes.voxels[n] = uint8_t(n);
    VolumeImage image;
    ASSERT_EQ(image.put(bytes.view, TextureLimits()), VolumeImage::WHOLE);
    EXPECT_EQ(image.bits(), 8);
    for (uint32_t n = 0; n < 256; n++) EXPECT_NEAR(value(image, n % 16, n / 16, 0), 2.0 * n - 100, 1e-9);
    EXPECT_EQ(image.low(), -100);
    EXPECT_EQ(image.high(), 410);

    Source<int16_t> shorts({{5, 1, 1}}, INT16);
    const int16_t extremes[5] = {-32768, -1000, 0, 1, 32767};
    std::copy(extremes, extremes + 5, shorts.voxels.begin());
    ASSERT_EQ(image.put(shorts.view, TextureLimits()), VolumeImage::WHOLE) << "another encoding starts anew";
    EXPECT_EQ(image.bits(), 16);
    for (uint32_t n = 0; n < 5; n++) EXPECT_NEAR(value(image, n, 0, 0), extremes[n], 1e-8);
    EXPECT_EQ(image.low(), -32768);
    EXPECT_EQ(image.high(), 32767);
}

TEST(VolumeImage, FloatsKeepSixteenBitsOfTheirRange)
{
    Source<float> floats({{64, 4, 4}}, FLOAT32);
    for (size_t n = 0; n < floats.voxels.size(); n++) floats.voxels[n] = float(std::sin(0.1 * double(n)) * 3);
    floats.voxels[7] = std::numeric_limits<float>::quiet_NaN();
    floats.voxels[8] = -std::numeric_limits<float>::infinity();
    VolumeImage image;
    ASSERT_EQ(image.put(floats.view, TextureLimits()), VolumeImage::WHOLE);
    EXPECT_EQ(image.not_numbers(), 2u);
    double step = image.value_scale() / 65535;
    EXPECT_NEAR(step, 6.0 / 65535, 1e-6);
    for (uint32_t n = 9; n < 64; n++) EXPECT_NEAR(value(image, n, 0, 0), floats.voxels[n], 0.5001 * step);
    EXPECT_NEAR(value(image, 7, 0, 0), image.low(), step);

    // a box with values outside the range: existing values are preserved, to one step of the wider range
    Source<float> box({{64, 4, 4}}, FLOAT32);
    box.view.box.offset = {{2, 1, 1}};
    box.view.box.size = {{3, 2, 1}};
    box.voxels.assign(6, 50.0f);
    box.voxels[1] = -20.0f;
    box.attach();
    ASSERT_EQ(image.put(box.view, TextureLimits()), VolumeImage::PART);
    step = image.value_scale() / 65535;
    EXPECT_NEAR(value(image, 2, 1, 1), 50, step);
    EXPECT_NEAR(value(image, 3, 1, 1), -20, step);
    EXPECT_NEAR(value(image, 2, 2, 1), 50, step);
    for (uint32_t n = 9; n < 64; n++) EXPECT_NEAR(value(image, n, 0, 0), floats.voxels[n], 1.01 * step);
    EXPECT_EQ(image.high(), 50);
    EXPECT_EQ(image.low(), -20);
}

TEST(VolumeImage, FloatsOfAnyRange)
{
    VolumeImage image;
    Source<float> even({{8, 8, 8}}, FLOAT32);
    even.voxels.assign(512, 3.5f);
    ASSERT_EQ(image.put(even.view, TextureLimits()), VolumeImage::WHOLE);
    EXPECT_NEAR(value(image, 3, 3, 3), 3.5, 1e-9) << "one value only";
    Source<float> none({{8, 8, 8}}, FLOAT32);
    none.view.scan_id = "other";
    none.voxels.assign(512, std::numeric_limits<float>::quiet_NaN());
    ASSERT_EQ(image.put(none.view, TextureLimits()), VolumeImage::WHOLE);
    EXPECT_EQ(image.not_numbers(), 512u);
    Source<float> wide({{8, 8, 8}}, FLOAT32);
    wide.voxels[0] = std::numeric_limits<float>::max();
    wide.voxels[1] = std::numeric_limits<float>::lowest();
    wide.view.scan_id = "third";
    ASSERT_EQ(image.put(wide.view, TextureLimits()), VolumeImage::WHOLE);
    EXPECT_GT(value(image, 0, 0, 0), 0.99 * double(std::numeric_limits<float>::max()));
    EXPECT_TRUE(std::isfinite(value(image, 5, 5, 5)));
}

TEST(VolumeImage, ABoxChangesOnlyItself)
{
    Source<int16_t> whole({{40, 30, 20}}, INT16);
    for (size_t n = 0; n < whole.voxels.size(); n++) whole.voxels[n] = int16_t(n % 1000);
    VolumeImage image;
    image.put(whole.view, TextureLimits());
    Box change;
    ASSERT_TRUE(image.next_change(size_t(1) << 30, change));
    EXPECT_EQ(change.size, whole.view.full_size);
    EXPECT_FALSE(image.next_change(size_t(1) << 30, change));

    Source<int16_t> box({{40, 30, 20}}, INT16);
    box.view.box.offset = {{16, 16, 0}};
    box.view.box.size = {{16, 14, 16}};
    box.voxels.assign(16 * 14 * 16, -7);
    box.attach();
    ASSERT_EQ(image.put(box.view, TextureLimits()), VolumeImage::PART);
    for (uint32_t k = 0; k < 20; k++)
        for (uint32_t j = 0; j < 30; j++)
            for (uint32_t i = 0; i < 40; i++) {
                bool inside = i >= 16 && i < 32 && j >= 16 && k < 16;
                ASSERT_NEAR(value(image, i, j, k), inside ? -7 : double((i + 40 * (j + 30 * k)) % 1000), 1e-8)
                    << i << " " << j << " " << k;
            }
    ASSERT_TRUE(image.next_change(size_t(1) << 30, change));
    EXPECT_EQ(change.offset, box.view.box.offset);
    EXPECT_EQ(change.size, box.view.box.size);
}

TEST(VolumeImage, BoxesWaitForAWholeVolume)
{
    Source<uint8_t> box({{40, 30, 20}}, UINT8);
    box.view.box.size = {{2, 2, 2}};
    box.voxels.assign(8, 1);
    box.attach();
    VolumeImage image;
    EXPECT_EQ(image.put(box.view, TextureLimits()), VolumeImage::WAITS);
    EXPECT_TRUE(image.empty());
    Source<uint8_t> whole({{40, 30, 20}}, UINT8);
    EXPECT_EQ(image.put(whole.view, TextureLimits()), VolumeImage::WHOLE);
    EXPECT_EQ(image.put(box.view, TextureLimits()), VolumeImage::PART);
    box.view.scan_id = "another scan";
    EXPECT_EQ(image.put(box.view, TextureLimits()), VolumeImage::WAITS);
    EXPECT_NEAR(value(image, 0, 0, 0), 1, 1e-9) << "what was shown stays";
}

TEST(VolumeImage, UploadsInPiecesCoverEverythingOnce)
{
    for (size_t maximum : {size_t(1), size_t(100), size_t(512), size_t(5000), size_t(1) << 20}) {
        Source<int16_t> whole({{17, 9, 5}}, INT16);
        VolumeImage image;
        image.put(whole.view, TextureLimits());
        std::vector<int> seen(17 * 9 * 5);
        Box box;
        size_t rounds = 0;
        while (image.next_change(maximum, box)) {
            ASSERT_LE(2 * box.voxels(), std::max(maximum, size_t(2 * 17)));
            ASSERT_LT(rounds++, 1000u);
            for (uint32_t k = 0; k < box.size[2]; k++)
                for (uint32_t j = 0; j < box.size[1]; j++)
                    for (uint32_t i = 0; i < box.size[0]; i++)
                        seen[box.offset[0] + i + 17 * (box.offset[1] + j + 9 * (box.offset[2] + k))]++;
        }
        for (int count : seen) ASSERT_EQ(count, 1) << maximum;
    }
}

TEST(VolumeImage, TooLargeIsSubsampledInPlace)
{
    Source<int16_t> whole({{50, 20, 10}}, INT16);
    for (int n = 0; n < 10000; n++) whole.voxels[size_t(n)] = int16_t(n);
    TextureLimits limits;
    limits.edge = 20;
    VolumeImage image;
    image.put(whole.view, limits);
    EXPECT_EQ(image.stride(), 3u);
    EXPECT_EQ(image.size(), (Size{{17, 7, 4}}));
    EXPECT_NE(image.precision().find("every 3. voxel"), std::string::npos);
    for (uint32_t k = 0; k < 4; k++)
        for (uint32_t j = 0; j < 7; j++)
            for (uint32_t i = 0; i < 17; i++)
                ASSERT_NEAR(value(image, i, j, k), 3 * i + 50 * (3 * j + 20 * 3 * k), 1e-8);
    // a box changes the texels whose voxels it contains
    Source<int16_t> box({{50, 20, 10}}, INT16);
    box.view.box.offset = {{4, 4, 4}};
    box.view.box.size = {{6, 5, 4}};
    box.voxels.assign(120, -5);
    box.attach();
    image.put(box.view, limits);
    for (uint32_t k = 0; k < 4; k++)
        for (uint32_t j = 0; j < 7; j++)
            for (uint32_t i = 0; i < 17; i++) {
                bool inside = (i == 2 || i == 3) && j == 2 && k == 2;
                ASSERT_NEAR(value(image, i, j, k), inside ? -5 : double(3 * i + 50 * (3 * j + 60 * k)), 1e-8);
            }
    // limited by memory
    limits = TextureLimits();
    limits.bytes = 2 * 1000;
    VolumeImage small;
    small.put(whole.view, limits);
    EXPECT_LE(2 * size_t(small.size()[0]) * small.size()[1] * small.size()[2], limits.bytes);
}

TEST(VolumeImage, TheVisibleBoxHoldsEverythingVisible)
{
    Source<uint8_t> whole({{100, 80, 60}}, UINT8);
    whole.voxels[37 + 100 * (50 + 80 * 33)] = 200;
    VolumeImage image;
    image.put(whole.view, TextureLimits());
    std::vector<bool> visible(256, false);
    for (size_t n = 100; n < 256; n++) visible[n] = true;
    Box box = image.visible_box(visible);
    const uint32_t at[3] = {37, 50, 33};
    for (size_t d = 0; d < 3; d++) {
        EXPECT_LT(box.offset[d], at[d]);
        EXPECT_GT(box.offset[d] + box.size[d], at[d] + 1);
        EXPECT_LE(box.size[d], 33u);
    }
    for (size_t n = 0; n < 256; n++) visible[n] = n > 200;
    EXPECT_EQ(image.visible_box(visible).voxels(), 0u);
    visible.assign(256, true);
    EXPECT_EQ(image.visible_box(visible).size, whole.view.full_size);
    // on the layer between two bricks: visible from both sides
    whole.voxels.assign(whole.voxels.size(), 0);
    whole.voxels[16 + 100 * (16 + 80 * 16)] = 200;
    image.put(whole.view, TextureLimits());
    for (size_t n = 0; n < 256; n++) visible[n] = n >= 100;
    box = image.visible_box(visible);
    for (size_t d = 0; d < 3; d++) {
        EXPECT_LE(box.offset[d], 15u);
        EXPECT_GE(box.offset[d] + box.size[d], 18u);
    }
}

TEST(VolumeImage, QuantilesIgnoreTheLowestValue)
{
    Source<uint8_t> whole({{100, 10, 10}}, UINT8);
    for (size_t n = 0; n < 10000; n++) whole.voxels[n] = n < 5000 ? 0 : uint8_t(1 + (n - 5000) % 200);
    VolumeImage image;
    image.put(whole.view, TextureLimits());
    EXPECT_NEAR(image.quantile(0.5), 100, 2);
    EXPECT_NEAR(image.quantile(0.995), 199, 2);
}

TEST(VolumeImage, IsInterpolatedAsItsTexture)
{
    Source<int16_t> source({{3, 2, 2}}, INT16);
    source.view.slope = 2;
    source.view.intercept = -1000;
    for (size_t n = 0; n < source.voxels.size(); n++) source.voxels[n] = int16_t(n * n);
    VolumeImage image;
    image.put(source.view, TextureLimits());
    EXPECT_NEAR(image.value({{2, 1, 1}}), 2 * 121 - 1000, 1e-6);
    EXPECT_NEAR(image.value({{0.5, 0, 0}}), 2 * 0.5 - 1000, 1e-6);
    EXPECT_NEAR(image.value({{1, 0.25, 0.5}}),
                2 * (0.5 * (0.75 * 1 + 0.25 * 16) + 0.5 * (0.75 * 49 + 0.25 * 100)) - 1000, 1e-6);
    EXPECT_NEAR(image.value({{-5, 0, 0}}), -1000, 1e-6) << "beyond the outermost theirs go on";
    EXPECT_NEAR(image.value({{9, 9, 9}}), 2 * 121 - 1000, 1e-6);
}

TEST(VolumeImage, HistogramsAreOfTheWindow)
{
    Source<uint8_t> source({{10, 10, 1}}, UINT8);
    for (size_t n = 0; n < 100; n++) source.voxels[n] = n < 64 ? 60 : n < 80 ? 170 : 250;
    VolumeImage image;
    image.put(source.view, TextureLimits());
    const std::vector<double> counted = image.histogram(0, 200, 4);
    ASSERT_EQ(counted.size(), 4u);
    EXPECT_DOUBLE_EQ(counted[1], 1);
    EXPECT_DOUBLE_EQ(counted[0], 0);
    EXPECT_NEAR(counted[3], std::sqrt(16.0 / 64), 1e-12) << "250 is beyond";
}

} // namespace
