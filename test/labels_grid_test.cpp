/* Label maps on another grid than their scan. */
#include "scan/volume.h"
#include "scan_files.h"

#include <array>
#include <cmath>

namespace {

const pliant_geometry SCAN = {{40, 30, 20}, {0.01, -0.02, 0.03}, {0.001, 0.001, 0.002}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};

struct labels_holder {
    pliant_labels labels = {};
    explicit labels_holder(const pliant_geometry &geometry)
    {
        EXPECT_EQ(pliant_labels_create(&geometry, &labels), PLIANT_OK);
    }
    ~labels_holder() { pliant_labels_free(&labels); }
};

/* Return the voxel of `from` that holds the centre of voxel n of `to`; -1: none. */
long nearest(const pliant_geometry &from, const pliant_geometry &to, size_t n)
{
    const size_t w = size_t(to.size[0]), h = size_t(to.size[1]);
    const double index[3] = {double(n % w), double(n / w % h), double(n / w / h)};
    double point[3], at[3];
    pliant_geometry_to_world(&to, index, point);
    pliant_geometry_to_index(&from, point, at);
    long voxel = 0;
    for (int d = 2; d >= 0; d--) {
        const long i = std::lround(at[d]);
        if (i < 0 || i >= from.size[d]) return -1;
        voxel = voxel * from.size[d] + i;
    }
    return voxel;
}

pliant_geometry turned(double angle, double shift, double stretch)
{
    pliant_geometry off = SCAN;
    off.direction[0] = off.direction[4] = std::cos(angle);
    off.direction[1] = -std::sin(angle);
    off.direction[3] = std::sin(angle);
    for (int d = 0; d < 3; d++) {
        off.origin[d] += shift;
        off.spacing[d] *= 1 + stretch;
    }
    return off;
}

} // namespace

TEST(LabelsToGrid, FollowTheAxesOfTheScan)
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
            /* the voxel's index in the grid of the scan */
            auto place = [&](const pliant_geometry &geometry, size_t n) {
                size_t w = size_t(geometry.size[0]), h = size_t(geometry.size[1]);
                const double index[3] = {double(n % w), double(n / w % h), double(n / w / h)};
                double point[3], at[3];
                pliant_geometry_to_world(&geometry, index, point);
                pliant_geometry_to_index(&grid, point, at);
                return uint16_t(std::lround(at[0]) + 6 * (std::lround(at[1]) + 5 * std::lround(at[2])));
            };
            for (size_t n = 0; n < 240; n++) labels.voxels[n] = place(turned, n);
            ASSERT_EQ(pliant_labels_to_grid(&labels, &grid), PLIANT_OK) << pliant_last_error();
            EXPECT_TRUE(pliant_geometry_equal(&labels.geometry, &grid));
            for (size_t n = 0; n < 240; n++) ASSERT_EQ(labels.voxels[n], n);
            pliant_labels_free(&labels);
        }
}

/* File formats write origins and axes with few digits. Labels that were made from a scan still match its grid. */
TEST(LabelsToGrid, AcceptRoundedOriginsAndAxes)
{
    const struct {
        double angle, shift, stretch;
    } cases[] = {{1.3e-4, 0, 0}, {2e-4, 0, 0}, {0, 3e-6, 0}, {0, 0, 2e-4}, {2e-4, 3e-6, 1e-4}, {0, 4.9e-5, 0}};
    for (const auto &one : cases) {
        labels_holder held(turned(one.angle, one.shift, one.stretch));
        const size_t voxels = pliant_geometry_voxels(&SCAN);
        for (size_t n = 0; n < voxels; n++) held.labels.voxels[n] = uint16_t(n);
        log_catcher log;
        ASSERT_EQ(pliant_labels_to_grid(&held.labels, &SCAN), PLIANT_OK) << pliant_last_error();
        expect_words(log.warnings(), {});
        EXPECT_TRUE(pliant_geometry_equal(&held.labels.geometry, &SCAN));
        for (size_t n = 0; n < voxels; n++) ASSERT_EQ(held.labels.voxels[n], uint16_t(n));
    }
}

/* Every voxel takes the nearest label, and a warning reports the difference of the grids. */
TEST(LabelsToGrid, ResampleOtherGridsWithAWarning)
{
    pliant_geometry coarse = SCAN, shifted = turned(0, 3e-4, 0), fine = SCAN;
    for (int d = 0; d < 3; d++) {
        coarse.size[d] /= 2;
        coarse.spacing[d] *= 2; /* its corners are voxels of the scan */
        fine.size[d] *= 2;
        fine.spacing[d] *= 0.5;
        fine.origin[d] -= 0.1 * fine.spacing[d];
    }
    const struct {
        pliant_geometry geometry;
        std::vector<std::string> words;
    } cases[] = {{coarse, {"spacing differs by 100 %", "axes by 0 degrees"}},
                 {shifted, {"spacing differs by 0 %", "by up to 0.3 voxels"}},
                 {turned(0, 6e-5, 0), {"by up to 0.06 voxels"}},
                 {turned(0.2, 0, 0), {"axes by 11.5 degrees"}},
                 {turned(0, 0, 1e-2), {"spacing differs by 1 %"}},
                 {fine, {"spacing differs by 50 %"}}};
    for (const auto &one : cases) {
        labels_holder held(one.geometry);
        const size_t from = pliant_geometry_voxels(&one.geometry), voxels = pliant_geometry_voxels(&SCAN);
        for (size_t n = 0; n < from; n++) held.labels.voxels[n] = uint16_t(n % 60000 + 1);
        log_catcher log;
        ASSERT_EQ(pliant_labels_to_grid(&held.labels, &SCAN), PLIANT_OK) << pliant_last_error();
        expect_words(log.warnings(), {"another grid", "nearest label", one.words[0], one.words.back()});
        if (one.geometry.size[0] == 20) continue; /* half of the voxels lie in the middle between two labels */
        size_t wrong = 0;
        for (size_t n = 0; n < voxels; n++) {
            const long at = nearest(one.geometry, SCAN, n);
            wrong += held.labels.voxels[n] != (at < 0 ? 0 : uint16_t(at % 60000 + 1));
        }
        EXPECT_EQ(wrong, 0u) << one.words[0];
    }
}

/* A voxel in the middle between two labels takes the lower one, with any rounding errors. */
TEST(LabelsToGrid, HalfWayTakesTheLowerLabel)
{
    pliant_geometry half = SCAN;
    half.origin[0] += 0.5 * SCAN.spacing[0];
    labels_holder held(half);
    for (size_t n = 0; n < pliant_geometry_voxels(&half); n++) held.labels.voxels[n] = uint16_t(n % 40 + 1);
    ASSERT_EQ(pliant_labels_to_grid(&held.labels, &SCAN), PLIANT_OK);
    for (size_t n = 0; n < pliant_geometry_voxels(&SCAN); n++) ASSERT_EQ(held.labels.voxels[n], n % 40);
}

/* Cropped labels, and labels that reach beyond the scan. */
TEST(LabelsToGrid, CroppedMaps)
{
    const pliant_geometry grid = {{8, 7, 6}, {0, 0, 0}, {0.001, 0.002, 0.003}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    for (int begin : {2, -1, 7, 8, -9}) {
        pliant_geometry part = grid;
        part.size[0] = 4;
        part.origin[0] = begin * grid.spacing[0];
        part.origin[1] = 6 * grid.spacing[1]; /* reversed along j, and a third of the size */
        part.direction[4] = -1;
        part.size[2] = 2;
        part.origin[2] = 3 * grid.spacing[2];
        labels_holder held(part);
        for (size_t n = 0; n < 56; n++) held.labels.voxels[n] = uint16_t(n + 1);
        log_catcher log;
        const pliant_status status = pliant_labels_to_grid(&held.labels, &grid);
        EXPECT_EQ(status, begin > 7 || begin < -3 ? PLIANT_ERROR_ARGUMENT : PLIANT_OK) << begin;
        if (status != PLIANT_OK) {
            expect_words(pliant_last_error(),
                         {"misses the scan", "do not overlap", "the scan from (-0.5, -1.0, -1.5) to", "resample"});
            continue;
        }
        if (begin == 2) expect_words(log.warnings(), {});
        else
            expect_words(log.warnings(),
                         {begin < 0 ? "14 of its 56 voxels" : "42 of its 56 voxels", "outside the scan"});
        for (int k = 0, n = 0; k < 6; k++)
            for (int j = 0; j < 7; j++)
                for (int i = 0; i < 8; i++, n++) {
                    const bool inside = k >= 3 && k < 5 && i >= begin && i < begin + 4;
                    ASSERT_EQ(held.labels.voxels[n], inside ? 1 + (i - begin) + 4 * ((6 - j) + 7 * (k - 3)) : 0)
                        << i << " " << j << " " << k;
                }
    }
}

/* A map may be cropped to one slice. */
TEST(LabelsToGrid, OneSlice)
{
    pliant_geometry slice = SCAN;
    slice.size[2] = 1;
    slice.origin[2] += 7 * SCAN.spacing[2];
    labels_holder held(slice);
    for (size_t n = 0; n < 1200; n++) held.labels.voxels[n] = 5;
    log_catcher log;
    ASSERT_EQ(pliant_labels_to_grid(&held.labels, &SCAN), PLIANT_OK);
    expect_words(log.warnings(), {});
    for (size_t n = 0; n < 24000; n++) ASSERT_EQ(held.labels.voxels[n], n / 1200 == 7 ? 5 : 0);
}

/* An error leaves the label map and its segments unchanged. */
TEST(LabelsToGrid, ErrorsChangeNothing)
{
    pliant_geometry far = turned(0.5, 0.003, 0);
    labels_holder held(far);
    held.labels.voxels[0] = 3; /* in the corner outside of the scan */
    held.labels.segments = static_cast<pliant_label_segment *>(pliant_calloc(1, sizeof *held.labels.segments));
    held.labels.num_segments = 1;
    pliant_geometry grid = SCAN;
    grid.origin[0] += 0.005;
    const size_t in_use = pliant_memory_in_use();
    EXPECT_EQ(pliant_labels_to_grid(&held.labels, &grid), PLIANT_ERROR_ARGUMENT);
    expect_words(pliant_last_error(), {"misses the scan", "no voxel of the scan gets a label"});
    pliant_memory_fail_after(0);
    EXPECT_EQ(pliant_labels_to_grid(&held.labels, &SCAN), PLIANT_ERROR_MEMORY);
    pliant_memory_fail_after(-1);
    EXPECT_EQ(pliant_memory_in_use(), in_use);
    EXPECT_TRUE(pliant_geometry_equal(&held.labels.geometry, &far));
    EXPECT_EQ(held.labels.voxels[0], 3);
    EXPECT_EQ(held.labels.num_segments, 1u);
}
