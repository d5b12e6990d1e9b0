#include "pliant/memory.h"
#include "pliant/scan.h"

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

/* the linear function of position that trilinear interpolation must reproduce */
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

/* every order and direction of the axes, an oblique grid: each voxel keeps its place in the world and its value */
TEST(Reorder, LabelsFollowTheAxesOfTheScan)
{
    const double c = std::cos(0.3), s = std::sin(0.3);
    const pliant_geometry grid = {{6, 5, 8}, {0.1, -0.2, 0.3}, {0.001, 0.002, 0.003}, {c, -s, 0, s, c, 0, 0, 0, 1}};
    const int orders[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    for (const int *order : orders)
        for (int flips = 0; flips < 8; flips++) {
            pliant_geometry turned = grid;
            double corner[3] = {0, 0, 0};
            for (int a = 0; a < 3; a++) {
                int sign = flips >> a & 1 ? -1 : 1, d = order[a];
                turned.size[a] = grid.size[d];
                turned.spacing[a] = grid.spacing[d];
                for (int row = 0; row < 3; row++) turned.direction[3 * row + a] = sign * grid.direction[3 * row + d];
                if (sign < 0) corner[d] = grid.size[d] - 1;
            }
            pliant_geometry_to_world(&grid, corner, turned.origin);
            pliant_labels labels;
            ASSERT_EQ(pliant_labels_create(&turned, &labels), PLIANT_OK);
            auto place = [&](const pliant_geometry &geometry, size_t n) { /* the voxel's number in the grid of the scan */
                size_t w = size_t(geometry.size[0]), h = size_t(geometry.size[1]);
                const double index[3] = {double(n % w), double(n / w % h), double(n / w / h)};
                double point[3], at[3];
                pliant_geometry_to_world(&geometry, index, point);
                pliant_geometry_to_index(&grid, point, at);
                return uint16_t(std::lround(at[0]) + 6 * (std::lround(at[1]) + 5 * std::lround(at[2])));
            };
            for (size_t n = 0; n < 240; n++) labels.voxels[n] = place(turned, n);
            ASSERT_EQ(pliant_labels_reorder(&labels, &grid), PLIANT_OK) << pliant_last_error();
            EXPECT_TRUE(pliant_geometry_equal(&labels.geometry, &grid));
            for (size_t n = 0; n < 240; n++) ASSERT_EQ(labels.voxels[n], n);
            pliant_labels_free(&labels);
        }
}

TEST(Reorder, OtherGridsAndMissingMemoryChangeNothing)
{
    pliant_geometry grid = flipped(), turned = grid, other = grid;
    other.origin[1] += 0.5 * grid.spacing[1];
    pliant_geometry_to_world(&grid, std::array<double, 3>{grid.size[0] - 1.0, 0, 0}.data(), turned.origin);
    for (int row = 0; row < 3; row++) turned.direction[3 * row] *= -1;
    pliant_labels labels;
    ASSERT_EQ(pliant_labels_create(&turned, &labels), PLIANT_OK);
    EXPECT_EQ(pliant_labels_reorder(&labels, &other), PLIANT_ERROR_ARGUMENT);
    const std::string message = pliant_last_error();
    for (const char *word : {"spacing differs by 0 %", "voxels from voxels of the scan", "nearest neighbour"})
        EXPECT_NE(message.find(word), std::string::npos) << message;
    size_t in_use = pliant_memory_in_use();
    pliant_memory_fail_after(0);
    EXPECT_EQ(pliant_labels_reorder(&labels, &grid), PLIANT_ERROR_MEMORY);
    pliant_memory_fail_after(-1);
    EXPECT_EQ(pliant_memory_in_use(), in_use);
    EXPECT_TRUE(pliant_geometry_equal(&labels.geometry, &turned));
    pliant_labels_free(&labels);
}

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

/* Formats write origins and axes with few digits: labels made from a scan lie on it all the same. */
TEST(Reorder, RoundedOriginsAndAxes)
{
    const pliant_geometry grid = {
        {40, 30, 20}, {0.01, -0.02, 0.03}, {0.001, 0.001, 0.002}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    const struct {
        double angle, shift, stretch;
        bool same;
    } cases[] = {{1.3e-4, 0, 0, true}, {2e-4, 0, 0, true},       {0, 3e-6, 0, true},
                 {0, 0, 2e-4, true},   {2e-4, 3e-6, 1e-4, true}, {0, 2e-4, 0, true},
                 {0, 3e-4, 0, false},  {1e-2, 0, 0, false},      {0, 0, 1e-2, false}};
    for (const auto &one : cases) {
        pliant_geometry off = grid;
        off.direction[0] = off.direction[4] = std::cos(one.angle);
        off.direction[1] = -std::sin(one.angle);
        off.direction[3] = std::sin(one.angle);
        for (int d = 0; d < 3; d++) {
            off.origin[d] += one.shift;
            off.spacing[d] *= 1 + one.stretch;
        }
        pliant_labels labels;
        ASSERT_EQ(pliant_labels_create(&off, &labels), PLIANT_OK);
        const size_t voxels = pliant_geometry_voxels(&grid);
        for (size_t n = 0; n < voxels; n++) labels.voxels[n] = uint16_t(n);
        static std::string said;
        said.clear();
        pliant_set_log([](pliant_log_level, const char *message, void *) { said += message; }, nullptr);
        const pliant_status status = pliant_labels_reorder(&labels, &grid);
        pliant_set_log(nullptr, nullptr);
        EXPECT_EQ(said.find("nearest voxel") != std::string::npos, one.shift == 2e-4) << said;
        EXPECT_EQ(status, one.same ? PLIANT_OK : PLIANT_ERROR_ARGUMENT)
            << one.angle << " " << one.shift << " " << one.stretch;
        if (one.same) {
            EXPECT_TRUE(pliant_geometry_equal(&labels.geometry, &grid));
            for (size_t n = 0; n < voxels; n++) ASSERT_EQ(labels.voxels[n], uint16_t(n));
        } else {
            const std::string message = pliant_last_error();
            for (const char *word : {"do not lie on the scan's grid", "degrees", "resample the labels"})
                EXPECT_NE(message.find(word), std::string::npos) << message;
        }
        pliant_labels_free(&labels);
    }
}

/* Cropped labels, and labels that reach beyond the scan. */
TEST(Reorder, CroppedLabels)
{
    const pliant_geometry grid = {{8, 7, 6}, {0, 0, 0}, {0.001, 0.002, 0.003}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    for (int begin : {2, -1, 7, 8, -9}) {
        pliant_geometry part = grid;
        part.size[0] = 4;
        part.origin[0] = begin * grid.spacing[0];
        part.origin[1] = 6 * grid.spacing[1]; /* turned around along j, and a third of it */
        part.direction[4] = -1;
        part.size[2] = 2;
        part.origin[2] = 3 * grid.spacing[2];
        pliant_labels labels;
        ASSERT_EQ(pliant_labels_create(&part, &labels), PLIANT_OK);
        for (size_t n = 0; n < 56; n++) labels.voxels[n] = uint16_t(n + 1);
        static std::string said;
        said.clear();
        pliant_set_log(
            [](pliant_log_level level, const char *message, void *) {
                if (level == PLIANT_LOG_WARNING) said += message;
            },
            nullptr);
        const pliant_status status = pliant_labels_reorder(&labels, &grid);
        pliant_set_log(nullptr, nullptr);
        EXPECT_EQ(status, begin > 7 || begin < -3 ? PLIANT_ERROR_ARGUMENT : PLIANT_OK) << begin;
        if (status == PLIANT_OK) {
            EXPECT_NE(said.find("there is no label in the rest"), std::string::npos) << said;
            EXPECT_NE(said.find(begin == 2  ? "; 0 voxels"
                                : begin < 0 ? "; 14 voxels"
                                            : "; 42 voxels"),
                      std::string::npos)
                << said;
            for (int k = 0, n = 0; k < 6; k++)
                for (int j = 0; j < 7; j++)
                    for (int i = 0; i < 8; i++, n++) {
                        const bool inside = k >= 3 && k < 5 && i >= begin && i < begin + 4;
                        ASSERT_EQ(labels.voxels[n], inside ? 1 + (i - begin) + 4 * ((6 - j) + 7 * (k - 3)) : 0)
                            << i << " " << j << " " << k;
                    }
        }
        pliant_labels_free(&labels);
    }
}
