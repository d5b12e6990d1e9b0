// Error measures against synthetic fields.
#include "base/memory.h"
#include "pipeline/body.h"
#include "report/report.h"

#include <algorithm>

namespace {

TEST(Error, MaxRmsAndPercentileOfKnownDistances)
{
    // Point p of 100 has an error of p micrometres. Its reference displacement is 2 p micrometres.
    std::vector<double> rest(300), reference(300), other(300);
    for (int p = 0; p < 100; p++) {
        rest[3 * p] = reference[3 * p] = other[3 * p] = 0.01 * p;
        reference[3 * p + 1] = 2e-6 * p;
        other[3 * p + 1] = 2e-6 * p;
        other[3 * p + 2] = 1e-6 * p;
    }
    pliant_error error;
    ASSERT_EQ(pliant_error_between(100, nullptr, rest.data(), reference.data(), other.data(), &error), PLIANT_OK);
    EXPECT_EQ(error.count, 100);
    EXPECT_EQ(error.worst, 99);
    EXPECT_NEAR(error.max, 99e-6, 1e-18);
    EXPECT_NEAR(error.largest, 198e-6, 1e-18);
    EXPECT_NEAR(error.p95, 94e-6, 1e-18); // 95 of 100 points are at or below it
    EXPECT_NEAR(error.rms, 1e-6 * std::sqrt(99 * 100 * 199 / 6 / 100.0), 1e-12);

    std::vector<uint8_t> use(100, 0);
    use[10] = use[20] = 1;
    ASSERT_EQ(pliant_error_between(100, use.data(), rest.data(), reference.data(), other.data(), &error), PLIANT_OK);
    EXPECT_EQ(error.count, 2);
    EXPECT_EQ(error.worst, 20);
    EXPECT_NEAR(error.max, 20e-6, 1e-18);
    EXPECT_NEAR(error.rms, 1e-6 * std::sqrt((100 + 400) / 2.0), 1e-15);
    EXPECT_NEAR(error.largest, 40e-6, 1e-18);

    std::fill(use.begin(), use.end(), 0);
    ASSERT_EQ(pliant_error_between(100, use.data(), rest.data(), reference.data(), other.data(), &error), PLIANT_OK);
    EXPECT_EQ(error.count, 0);
    EXPECT_EQ(error.worst, -1);
    EXPECT_EQ(error.max, 0);
}

TEST(Error, RefusesWhatIsNotANumberAndKeepsTheOutput)
{
    const double rest[6] = {0, 0, 0, 1, 0, 0}, bad[6] = {0, 0, 0, NAN, 0, 0};
    pliant_error error = {};
    error.count = 77;
    EXPECT_EQ(pliant_error_between(2, nullptr, rest, rest, bad, &error), PLIANT_ERROR_NUMERIC);
    EXPECT_EQ(error.count, 77);
    const uint8_t first[2] = {1, 0};
    EXPECT_EQ(pliant_error_between(2, first, rest, rest, bad, &error), PLIANT_OK);
}

TEST(Error, HistogramCountsEveryVoxelOfTissueOnce)
{
    pliant_geometry geometry{};
    for (int d = 0; d < 3; d++) {
        geometry.size[d] = 2;
        geometry.spacing[d] = geometry.direction[4 * d] = 1;
    }
    pliant_volume volume{};
    ASSERT_EQ(pliant_volume_create(&geometry, PLIANT_FLOAT32, &volume), PLIANT_OK);
    const float values[8] = {-1, -1, 0, 0.4f, 0.6f, 1.2f, 5, 100};
    std::copy(values, values + 8, static_cast<float *>(volume.voxels));
    uint64_t counts[4];
    pliant_error summary;
    ASSERT_EQ(pliant_error_histogram(&volume, 4, 0.5, counts, &summary), PLIANT_OK);
    EXPECT_EQ(counts[0], 2u); // 0, 0.4
    EXPECT_EQ(counts[1], 1u); // 0.6
    EXPECT_EQ(counts[2], 1u); // 1.2
    EXPECT_EQ(counts[3], 2u); // 5, 100
    EXPECT_EQ(summary.count, 6);
    EXPECT_EQ(summary.max, 100);
    EXPECT_EQ(summary.p95, 100);
    EXPECT_NEAR(summary.rms, std::sqrt((0.16 + 0.36 + 1.44 + 25 + 10000) / 6), 1e-5);
    EXPECT_EQ(pliant_error_histogram(&volume, 4, 0, counts, nullptr), PLIANT_ERROR_ARGUMENT);
    pliant_volume_free(&volume);
}

const int size[3] = {12, 12, 12};
const double box[3] = {0.12, 0.12, 0.12};
const std::vector<Material> soft = {{5e3, 0.45, 1000, false}, {10, 0, 1, true}};

TEST(VoxelError, ShiftBetweenTwoSolutionsIsTheErrorOfEveryVoxelOfTissue)
{
    // One corner is air: its voxels show no tissue.
    Body body(size, box, soft, [](int i, int j, int) { return i >= 8 && j >= 8 ? 1 : 0; });
    body.cells(3, 3, 3, 2);
    body.fix_plane(1e-9, 0, 0, 1, 0, 0);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const double unit[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, none[3] = {0, 0, 0}, shift[3] = {0.003, -0.004, 0.012};
    auto here = affine(body.model->body->fine, unit, none), there = affine(body.model->body->fine, unit, shift);
    pliant_volume error{};
    ASSERT_EQ(pliant_error_voxels(body.model, here.data(), &body.model->body->fine, there.data(), &body.scan.geometry,
                                  &error),
              PLIANT_OK);
    auto *voxels = static_cast<float *>(error.voxels);
    auto *stored = static_cast<uint8_t *>(body.scan.voxels);
    for (int v = 0; v < 12 * 12 * 12; v++) {
        if (stored[v]) EXPECT_EQ(voxels[v], -1) << v;
        else EXPECT_NEAR(voxels[v], 0.013, 1e-7) << v;
    }
    pliant_volume_free(&error);
}

TEST(VoxelError, IsTakenAtTheTissueThatAVoxelShows)
{
    // The volume is moved by two voxels along x. The reference is stretched along y. So the error of a voxel grows with
    // its y alone, in addition to the constant shift.
    Body body(size, box, soft);
    body.cells(3, 3, 3, 1);
    body.fix_plane(1e-9, 0, 0, 1, 0, 0);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const double unit[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, stretch[9] = {1, 0, 0, 0, 1.1, 0, 0, 0, 1}, none[3] = {0, 0, 0},
                 shift[3] = {0.02, 0, 0};
    auto here = affine(body.model->body->fine, unit, shift), there = affine(body.model->body->fine, stretch, none);
    pliant_volume error{};
    ASSERT_EQ(pliant_error_voxels(body.model, here.data(), &body.model->body->fine, there.data(), &body.scan.geometry,
                                  &error),
              PLIANT_OK);
    auto *voxels = static_cast<float *>(error.voxels);
    for (int j = 0; j < 12; j++) {
        double y = 0.01 * (j + 0.5);
        EXPECT_EQ(voxels[1 + 12 * j], -1);                                       // no tissue after the shift
        EXPECT_NEAR(voxels[5 + 12 * (j + 12 * 6)], std::hypot(0.02, 0.1 * y), 1e-7);
    }
    pliant_volume_free(&error);
}

TEST(Slice, IsTurnedAsItIsLookedAt)
{
    // stored with x running right to left of the patient and z downwards: value = 100 i + 10 j + k
    pliant_geometry geometry{};
    const int32_t voxels[3] = {3, 2, 4};
    for (int d = 0; d < 3; d++) {
        geometry.size[d] = voxels[d];
        geometry.spacing[d] = 0.001 * (d + 1);
        geometry.direction[4 * d] = d == 1 ? 1 : -1;
    }
    pliant_volume volume{};
    ASSERT_EQ(pliant_volume_create(&geometry, PLIANT_FLOAT32, &volume), PLIANT_OK);
    volume.slope = 1;
    for (int v = 0; v < 24; v++)
        static_cast<float *>(volume.voxels)[v] = static_cast<float>(100 * (v % 3) + 10 * (v / 3 % 2) + v / 6);
    const double index[3] = {1, 1, 2};
    double world[3], spacing[2];
    pliant_geometry_to_world(&geometry, index, world);
    int32_t columns_rows[2];
    float *values = nullptr;
    ASSERT_EQ(pliant_volume_plane(&volume, 2, world, columns_rows, spacing, &values), PLIANT_OK);
    EXPECT_EQ(columns_rows[0], 3);
    EXPECT_EQ(columns_rows[1], 2);
    EXPECT_DOUBLE_EQ(spacing[1], 0.002);
    EXPECT_EQ(values[0], 202); // patient right, anterior
    EXPECT_EQ(values[5], 12);  // patient left, posterior
    pliant_free(values);
    ASSERT_EQ(pliant_volume_plane(&volume, 1, world, columns_rows, spacing, &values), PLIANT_OK);
    EXPECT_EQ(columns_rows[1], 4);
    EXPECT_EQ(values[0], 210); // superior is up: k = 0, because z runs down
    EXPECT_EQ(values[9], 213);
    pliant_free(values);
    const double outside[3] = {0, 0, 1};
    EXPECT_EQ(pliant_volume_plane(&volume, 2, outside, columns_rows, spacing, &values), PLIANT_ERROR_ARGUMENT);
    pliant_volume_free(&volume);
}

} // namespace
