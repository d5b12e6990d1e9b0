#include "base/memory.h"
#include "scan/volume.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <vector>

namespace {

pliant_geometry flipped()
{
    return {{6, 5, 8}, {0.1, -0.2, 0.3}, {0.001, 0.002, 0.003}, {-1, 0, 0, 0, 0, 1, 0, 1, 0}};
}

/* The linear function of position that trilinear interpolation must reproduce. */
double ramp(const double p[3]) { return 100000.0 * p[0] - 50000.0 * p[1] + 20000.0 * p[2] - 700.0; }

void fill_ramp(pliant_volume *volume)
{
    const int32_t *n = volume->geometry.size;
    for (int k = 0; k < n[2]; k++)
        for (int j = 0; j < n[1]; j++)
            for (int i = 0; i < n[0]; i++) {
                const double index[3] = {double(i), double(j), double(k)};
                double p[3];
                pliant_geometry_to_world(&volume->geometry, index, p);
                static_cast<float *>(volume->voxels)[i + n[0] * (j + n[1] * k)] = float(ramp(p));
            }
}

} // namespace

TEST(Resample, SameSizeIsTheSameBits)
{
    pliant_geometry geometry = flipped();
    const size_t count = pliant_geometry_voxels(&geometry);
    for (pliant_encoding encoding : {PLIANT_UINT8, PLIANT_INT16, PLIANT_FLOAT32}) {
        pliant_volume volume, same;
        ASSERT_EQ(pliant_volume_create(&geometry, encoding, &volume), PLIANT_OK);
        for (size_t n = 0; n < count; n++) {
            if (encoding == PLIANT_UINT8) static_cast<uint8_t *>(volume.voxels)[n] = uint8_t(n * 37);
            if (encoding == PLIANT_INT16) static_cast<int16_t *>(volume.voxels)[n] = int16_t(n * 7919 - 32768);
            if (encoding == PLIANT_FLOAT32) static_cast<float *>(volume.voxels)[n] = std::sin(float(n)) * 1e5f;
        }
        volume.slope = 0.25f;
        volume.intercept = -3.0f;
        volume.background = -1024.0f;
        std::strcpy(volume.id, "a scan");
        ASSERT_EQ(pliant_volume_resample(&volume, geometry.size, &same), PLIANT_OK);
        EXPECT_EQ(std::memcmp(volume.voxels, same.voxels, count * pliant_encoding_size(encoding)), 0);
        EXPECT_TRUE(pliant_geometry_equal(&volume.geometry, &same.geometry));
        EXPECT_EQ(same.slope, 0.25f);
        EXPECT_EQ(same.intercept, -3.0f);
        EXPECT_EQ(same.background, -1024.0f);
        EXPECT_STREQ(same.id, "a scan");
        pliant_volume_free(&volume);
        pliant_volume_free(&same);
    }
}

TEST(Resample, CoversTheSameBoxEdgeToEdge)
{
    pliant_geometry geometry = flipped();
    pliant_volume volume, other;
    ASSERT_EQ(pliant_volume_create(&geometry, PLIANT_UINT8, &volume), PLIANT_OK);
    const int32_t size[3] = {13, 2, 5};
    ASSERT_EQ(pliant_volume_resample(&volume, size, &other), PLIANT_OK);
    for (int corner = 0; corner < 8; corner++) {
        double old_edge[3], new_edge[3], a[3], b[3];
        for (int d = 0; d < 3; d++) {
            old_edge[d] = corner >> d & 1 ? geometry.size[d] - 0.5 : -0.5;
            new_edge[d] = corner >> d & 1 ? size[d] - 0.5 : -0.5;
        }
        pliant_geometry_to_world(&geometry, old_edge, a);
        pliant_geometry_to_world(&other.geometry, new_edge, b);
        for (int d = 0; d < 3; d++) EXPECT_NEAR(a[d], b[d], 1e-15);
    }
    pliant_volume_free(&volume);
    pliant_volume_free(&other);
}

TEST(Resample, ReproducesALinearFunctionInside)
{
    pliant_geometry geometry = flipped();
    pliant_volume volume, fine;
    ASSERT_EQ(pliant_volume_create(&geometry, PLIANT_FLOAT32, &volume), PLIANT_OK);
    fill_ramp(&volume);
    const int32_t size[3] = {17, 11, 23};
    ASSERT_EQ(pliant_volume_resample(&volume, size, &fine), PLIANT_OK);
    int checked = 0;
    for (int k = 0; k < size[2]; k++)
        for (int j = 0; j < size[1]; j++)
            for (int i = 0; i < size[0]; i++) {
                const double index[3] = {double(i), double(j), double(k)};
                double p[3], old[3];
                pliant_geometry_to_world(&fine.geometry, index, p);
                pliant_geometry_to_index(&geometry, p, old);
                bool inside = true;
                for (int d = 0; d < 3; d++) inside = inside && old[d] >= 0 && old[d] <= geometry.size[d] - 1;
                if (!inside) continue;
                checked++;
                EXPECT_NEAR(pliant_volume_value(&fine, size_t(i + size[0] * (j + size[1] * k))), ramp(p), 0.01);
            }
    EXPECT_GT(checked, 1000);
    pliant_volume_free(&volume);
    pliant_volume_free(&fine);
}

TEST(Resample, RoundsToNearestAlsoBelowZero)
{
    pliant_geometry geometry = {{2, 2, 2}, {0, 0, 0}, {1, 1, 1}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    pliant_volume volume, fine;
    ASSERT_EQ(pliant_volume_create(&geometry, PLIANT_INT16, &volume), PLIANT_OK);
    for (int n = 0; n < 8; n++) static_cast<int16_t *>(volume.voxels)[n] = n % 2 ? -1003 : -1000;
    const int32_t size[3] = {4, 2, 2};
    ASSERT_EQ(pliant_volume_resample(&volume, size, &fine), PLIANT_OK);
    /* old indices -0.25, 0.25, 0.75, 1.25: values -1000, -1000.75, -1002.25, -1003 */
    const int16_t expected[4] = {-1000, -1001, -1002, -1003};
    EXPECT_EQ(std::memcmp(fine.voxels, expected, sizeof expected), 0);
    pliant_volume_free(&volume);
    pliant_volume_free(&fine);
}

TEST(Resample, LabelsStayLabels)
{
    pliant_geometry geometry = flipped();
    pliant_labels labels, coarse, fine;
    ASSERT_EQ(pliant_labels_create(&geometry, &labels), PLIANT_OK);
    for (size_t n = 0; n < pliant_geometry_voxels(&geometry); n++) labels.voxels[n] = uint16_t(n * 257);
    const int32_t triple[3] = {18, 15, 24};
    ASSERT_EQ(pliant_labels_resample(&labels, triple, &fine), PLIANT_OK);
    for (int k = 0; k < 24; k++)
        for (int j = 0; j < 15; j++)
            for (int i = 0; i < 18; i++)
                ASSERT_EQ(fine.voxels[i + 18 * (j + 15 * k)], labels.voxels[i / 3 + 6 * (j / 3 + 5 * (k / 3))]);
    ASSERT_EQ(pliant_labels_resample(&fine, geometry.size, &coarse), PLIANT_OK);
    EXPECT_EQ(std::memcmp(coarse.voxels, labels.voxels, 2 * pliant_geometry_voxels(&geometry)), 0);
    EXPECT_TRUE(pliant_geometry_equal(&coarse.geometry, &labels.geometry));
    pliant_labels_free(&labels);
    pliant_labels_free(&coarse);
    pliant_labels_free(&fine);
}

/* Every order and direction of the axes, and an oblique grid: each voxel keeps its position in the world and its
 * value. */

TEST(Resample, RefusesEmptySizesAndSurvivesMissingMemory)
{
    pliant_geometry geometry = flipped();
    pliant_volume volume, out = {};
    pliant_labels labels, labels_out = {};
    ASSERT_EQ(pliant_volume_create(&geometry, PLIANT_INT16, &volume), PLIANT_OK);
    ASSERT_EQ(pliant_labels_create(&geometry, &labels), PLIANT_OK);
    const int32_t empty[3] = {4, 0, 4}, size[3] = {4, 4, 4};
    EXPECT_EQ(pliant_volume_resample(&volume, empty, &out), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_labels_resample(&labels, empty, &labels_out), PLIANT_ERROR_ARGUMENT);
    size_t in_use = pliant_memory_in_use();
    for (int call = 0; call < 2; call++) {
        pliant_memory_fail_after(call);
        EXPECT_EQ(pliant_volume_resample(&volume, size, &out), PLIANT_ERROR_MEMORY);
        pliant_memory_fail_after(call);
        EXPECT_EQ(pliant_labels_resample(&labels, size, &labels_out), PLIANT_ERROR_MEMORY);
        EXPECT_EQ(pliant_memory_in_use(), in_use);
        EXPECT_EQ(out.voxels, nullptr);
        EXPECT_EQ(labels_out.voxels, nullptr);
    }
    pliant_memory_fail_after(-1);
    pliant_volume_free(&volume);
    pliant_labels_free(&labels);
}
