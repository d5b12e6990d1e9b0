// Tests of segmentation: the mixture model, the neighbourhood term, connected pieces, specks, and the agreement with
// organs of the phantom and of a CT.
#include "base/memory.h"
#include "pliant/pliant.h"
#include "scan/segment.h"
#include "scan/volume.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <random>
#include <vector>

namespace {

pliant_segment_options usual() { return {0, 12, 1.0, 0, 2}; }

struct Scan {
    pliant_volume volume{};
    Scan(int a, int b, int c, pliant_encoding encoding = PLIANT_FLOAT32)
    {
        pliant_geometry g{{a, b, c}, {0, 0, 0}, {0.001, 0.002, 0.003}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
        EXPECT_EQ(pliant_volume_create(&g, encoding, &volume), PLIANT_OK);
        volume.slope = 1;
    }
    ~Scan() { pliant_volume_free(&volume); }
    float *at() { return static_cast<float *>(volume.voxels); }
};

struct Found : pliant_segmentation {
    Found() : pliant_segmentation{} {}
    ~Found() { pliant_segmentation_free(this); }
};

// Three boxes along i, with values 0, 100 and 300 and noise.
void fill(Scan &scan, double noise)
{
    std::mt19937 random(7);
    std::normal_distribution<float> shake(0, static_cast<float>(noise));
    const int32_t *size = scan.volume.geometry.size;
    for (int v = 0; v < size[0] * size[1] * size[2]; v++) {
        int i = v % size[0];
        scan.at()[v] = (i < size[0] / 2 ? 0.f : i < 3 * size[0] / 4 ? 100.f : 300.f) + shake(random);
    }
}

TEST(Segment, FindsTheMixtureThatWasMixed)
{
    Scan scan(64, 32, 32);
    fill(scan, 8);
    for (int classes : {0, 3}) {
        pliant_segment_options options = usual();
        options.classes = classes;
        Found found;
        ASSERT_EQ(pliant_segment(&scan.volume, &options, &found), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(found.num_classes, 3);
        const double mean[] = {0, 100, 300}, weight[] = {0.5, 0.25, 0.25};
        for (int k = 0; k < 3; k++) {
            EXPECT_NEAR(found.classes[k].mean, mean[k], 1);
            EXPECT_NEAR(found.classes[k].weight, weight[k], 0.02);
        }
        ASSERT_EQ(found.num_pieces, 3);
        EXPECT_NEAR(found.pieces[0].volume, 0.5 * 0.064 * 0.064 * 0.096, 1e-12);
        EXPECT_NEAR(found.pieces[0].mean, 0, 0.5);
        EXPECT_NEAR(found.pieces[0].centre[0], 0.0155, 1e-9);
        for (int v = 0; v < 64 * 32 * 32; v++) ASSERT_EQ(found.labels.voxels[v], v % 64 < 32 ? 1 : v % 64 < 48 ? 2 : 3);
    }
}

// BIC of k Gaussians on n samples of 64 voxels each, with the mean log likelihood L: -2 n L + (3 k - 1) ln n. 6400
// voxels are 100 samples.
TEST(Segment, TheCriterionIsBic)
{
    segment_histogram histogram{};
    histogram.total = 6400;
    segment_fits fits{};
    fits.likelihood[0] = -3;
    const double by_hand = 600 + 2 * std::log(100.0); // 609.21
    const double penalty = 3 * std::log(100.0) / 200; // an additional class must raise L by this value
    for (double gain : {0.99 * penalty, 1.01 * penalty}) {
        fits.likelihood[1] = -3 + gain;
        pliant_segment_options options = usual();
        options.max_classes = 2;
        pliant_segment_class classes[PLIANT_MAX_CLASSES];
        double criterion = 0;
        EXPECT_EQ(segment_choose_mixture(&histogram, &options, &fits, classes, &criterion), gain > penalty ? 2 : 1);
        EXPECT_NEAR(criterion, gain > penalty ? 600 - 200 * gain + 5 * std::log(100.0) : by_hand, 1e-9);
    }
}

TEST(Segment, NeighboursOvercomeNoise)
{
    Scan scan(48, 24, 24);
    fill(scan, 60); // a fifth of the voxels in the first two boxes have the value of the other box
    double wrong[2];
    for (int coherent = 0; coherent < 2; coherent++) {
        pliant_segment_options options = usual();
        options.classes = 3;
        options.coherence = coherent ? 1.5 : 0;
        Found found;
        ASSERT_EQ(pliant_segment(&scan.volume, &options, &found), PLIANT_OK);
        int count = 0;
        for (int v = 0; v < 48 * 24 * 24; v++) {
            int c = found.pieces[found.labels.voxels[v] - 1].class_index;
            count += c != (v % 48 < 24 ? 0 : v % 48 < 36 ? 1 : 2);
        }
        wrong[coherent] = count / (48.0 * 24 * 24);
    }
    EXPECT_LT(wrong[1], 0.5 * wrong[0]) << wrong[0];
    EXPECT_LT(wrong[1], 0.05);
}

TEST(Segment, SameResultWhateverTheNumberOfThreads)
{
    const int32_t size[3] = {48, 36, 40};
    pliant_volume scan{};
    ASSERT_EQ(pliant_phantom(size, 1, &scan, nullptr), PLIANT_OK);
    Found one, more;
    pliant_segment_options options = usual();
    options.num_threads = 1;
    ASSERT_EQ(pliant_segment(&scan, &options, &one), PLIANT_OK);
    options.num_threads = 3;
    ASSERT_EQ(pliant_segment(&scan, &options, &more), PLIANT_OK);
    ASSERT_EQ(one.num_pieces, more.num_pieces);
    EXPECT_EQ(one.criterion, more.criterion);
    EXPECT_TRUE(std::equal(one.labels.voxels, one.labels.voxels + 48 * 36 * 40, more.labels.voxels));
    pliant_volume_free(&scan);
}

TEST(Segment, PiecesAreThoseOfASearch)
{
    std::mt19937 random(3);
    const int32_t size[3] = {13, 9, 11};
    const int voxels = 13 * 9 * 11;
    for (int round = 0; round < 20; round++) {
        std::vector<uint8_t> classes(voxels);
        for (auto &c : classes) c = static_cast<uint8_t>(random() % (2 + round % 3));
        std::vector<int32_t> piece(voxels);
        int32_t count;
        ASSERT_EQ(segment_connect(size, classes.data(), piece.data(), &count), PLIANT_OK);
        std::vector<int32_t> expected(voxels, -1), stack;
        int32_t next = 0;
        for (int first = 0; first < voxels; first++) {
            if (expected[first] >= 0) continue;
            stack.push_back(first);
            expected[first] = next;
            while (!stack.empty()) {
                int v = stack.back(), at[3] = {v % 13, v / 13 % 9, v / 117}, step[3] = {1, 13, 117};
                stack.pop_back();
                for (int side = 0; side < 6; side++) {
                    int d = side / 2, to = at[d] + (side & 1 ? 1 : -1), n = v + (side & 1 ? step[d] : -step[d]);
                    if (to < 0 || to >= size[d] || expected[n] >= 0 || classes[n] != classes[v]) continue;
                    expected[n] = next;
                    stack.push_back(n);
                }
            }
            next++;
        }
        EXPECT_EQ(count, next);
        EXPECT_EQ(piece, expected);
    }
}

TEST(Segment, SpecksJoinTheirNeighbours)
{
    Scan scan(30, 30, 30);
    for (int v = 0; v < 27000; v++) scan.at()[v] = v % 30 < 15 ? 0.f : 200.f;
    for (int k = 10; k < 12; k++)
        for (int j = 10; j < 12; j++)
            for (int i = 4; i < 6; i++) scan.at()[i + 30 * (j + 30 * k)] = 200;
    pliant_segment_options options = usual();
    options.classes = 2;
    options.coherence = 0;
    Found kept, gone;
    ASSERT_EQ(pliant_segment(&scan.volume, &options, &kept), PLIANT_OK);
    EXPECT_EQ(kept.num_pieces, 3);
    options.min_volume = 9 * 6e-9; // nine voxels
    ASSERT_EQ(pliant_segment(&scan.volume, &options, &gone), PLIANT_OK);
    EXPECT_EQ(gone.num_pieces, 2);
    for (int v = 0; v < 27000; v++) ASSERT_EQ(gone.labels.voxels[v], v % 30 < 15 ? 1 : 2);
}

// An image with two values has two pieces, for any values: masks of 0 and 1, adjacent integers, floats, also in small
// scans.
TEST(Segment, APictureOfTwoValuesHasTwoPieces)
{
    const struct { pliant_encoding encoding; float low, high; double spacing;
    } pictures[] = {{PLIANT_UINT8, 0, 1, 0.002},       {PLIANT_UINT8, 0, 255, 0.002},
                    {PLIANT_INT16, -1000, 40, 0.002},  {PLIANT_INT16, 40, 41, 0.002},
                    {PLIANT_INT16, 0, 3, 0.002},       {PLIANT_FLOAT32, 0.2f, 0.7f, 0.002},
                    {PLIANT_INT16, -1000, 40, 0.0005}, {PLIANT_UINT8, 0, 1, 3e-5}};
    for (const auto &one : pictures)
        for (const double radius : {3.0, 7.0, 12.0}) {
            pliant_geometry geometry{
                {40, 36, 30}, {0, 0, 0}, {one.spacing, one.spacing, one.spacing}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
            pliant_volume scan{};
            ASSERT_EQ(pliant_volume_create(&geometry, one.encoding, &scan), PLIANT_OK);
            scan.slope = 1;
            size_t v = 0, inside = 0;
            for (int k = 0; k < 30; k++)
                for (int j = 0; j < 36; j++)
                    for (int i = 0; i < 40; i++, v++) {
                        const bool in =
                            (i - 20) * (i - 20) + (j - 18) * (j - 18) + (k - 15) * (k - 15) < radius * radius;
                        const float value = in ? one.high : one.low;
                        inside += in;
                        if (one.encoding == PLIANT_UINT8) static_cast<uint8_t *>(scan.voxels)[v] = uint8_t(value);
                        else if (one.encoding == PLIANT_INT16) static_cast<int16_t *>(scan.voxels)[v] = int16_t(value);
                        else static_cast<float *>(scan.voxels)[v] = value;
                    }
            const double voxel = std::pow(one.spacing, 3);
            pliant_scene scene;
            pliant_segment_options options;
            pliant_segmentation found{};
            pliant_scene_defaults(&scene);
            scene.solver.backend = PLIANT_CPU;
            pliant_segment_options_from(&scene, &geometry, &options);
            ASSERT_EQ(pliant_segment(&scan, &options, &found), PLIANT_OK) << pliant_last_error();
            EXPECT_EQ(found.num_pieces, 2)
                << one.low << " " << one.high << ", radius " << radius << ", spacing " << one.spacing;
            if (found.num_pieces == 2)
                EXPECT_NEAR(found.pieces[1].volume, double(inside) * voxel, 1e-6 * double(inside) * voxel);
            pliant_segmentation_free(&found);
            pliant_volume_free(&scan);
        }
}

TEST(Segment, TheSmallestPieceOfAPatientIsAMillilitre)
{
    pliant_scene scene;
    pliant_segment_options options;
    pliant_scene_defaults(&scene);
    const pliant_geometry patient{{120, 100, 110}, {0, 0, 0}, {0.003, 0.003, 0.003}, {1, 0, 0, 0, 1, 0, 0, 0, 1}},
        mouse{{300, 300, 1000}, {0, 0, 0}, {1e-4, 1e-4, 1e-4}, {}};
    pliant_segment_options_from(&scene, &patient, &options);
    EXPECT_EQ(options.min_volume, 1e-6);
    pliant_segment_options_from(&scene, &mouse, &options);
    EXPECT_NEAR(options.min_volume, 4.5e-8, 1e-12);
    scene.segment.min_volume = 2e-6;
    pliant_segment_options_from(&scene, &mouse, &options);
    EXPECT_EQ(options.min_volume, 2e-6);
}

TEST(Segment, OddVolumesAndWrongOptions)
{
    Scan even(8, 8, 8), tiny(1, 1, 1);
    Found found, one;
    pliant_segment_options options = usual();
    ASSERT_EQ(pliant_segment(&even.volume, &options, &found), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(found.num_pieces, 1);
    ASSERT_EQ(pliant_segment(&tiny.volume, &options, &one), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(one.num_pieces, 1);
    Found none;
    options.classes = 17;
    EXPECT_EQ(pliant_segment(&even.volume, &options, &none), PLIANT_ERROR_ARGUMENT);
    options = usual();
    options.coherence = -1;
    EXPECT_EQ(pliant_segment(&even.volume, &options, &none), PLIANT_ERROR_ARGUMENT);
    options = usual();
    even.at()[5] = NAN;
    EXPECT_EQ(pliant_segment(&even.volume, &options, &none), PLIANT_ERROR_ARGUMENT);
    even.at()[5] = 0;
    size_t held = pliant_memory_in_use();
    for (int calls = 0;; calls++) {
        ASSERT_LT(calls, 40);
        pliant_memory_fail_after(calls);
        pliant_status status = pliant_segment(&even.volume, &options, &none);
        pliant_memory_fail_after(-1);
        if (status == PLIANT_OK) break;
        EXPECT_EQ(status, PLIANT_ERROR_MEMORY);
        EXPECT_EQ(pliant_memory_in_use(), held) << calls;
    }
}

// Return the best Dice score of a label with one piece.
double dice(const pliant_segmentation &found, const uint16_t *truth, int label)
{
    size_t voxels = pliant_geometry_voxels(&found.labels.geometry), count = 0;
    std::vector<size_t> size(static_cast<size_t>(found.num_pieces)), both(size.size());
    for (size_t v = 0; v < voxels; v++) {
        size_t p = found.labels.voxels[v] - 1u;
        size[p]++;
        both[p] += truth[v] == label;
        count += truth[v] == label;
    }
    double best = 0;
    for (size_t p = 0; p < size.size(); p++)
        best = std::fmax(best, 2.0 * static_cast<double>(both[p]) / static_cast<double>(count + size[p]));
    return best;
}

TEST(Segment, OrgansOfThePhantom)
{
    const int32_t size[3] = {128, 80, 64};
    pliant_volume scan{};
    pliant_labels truth{};
    ASSERT_EQ(pliant_phantom(size, 1, &scan, &truth), PLIANT_OK);
    pliant_segment_options options = usual();
    options.min_volume = 1e-6;
    Found found;
    ASSERT_EQ(pliant_segment(&scan, &options, &found), PLIANT_OK);
    const std::map<int, double> minimum{{0, 0.95}, {2, 0.85}, {3, 0.7}, {4, 0.9}};
    for (auto &entry : minimum)
        EXPECT_GT(dice(found, truth.voxels, entry.first), entry.second) << pliant_phantom_label_name(entry.first);
    pliant_volume_free(&scan);
    pliant_labels_free(&truth);
}

TEST(Segment, OrgansOfACt)
{
    const char *path = PLIANT_TEST_DATA "/abdomen/ct.nii.gz";
    if (!std::ifstream(path)) GTEST_SKIP() << path << " is not there";
    pliant_volume scan{};
    pliant_labels truth{};
    ASSERT_EQ(pliant_volume_read(path, nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_labels_read(PLIANT_TEST_DATA "/abdomen/labels_totalseg_fast.nii.gz", 0, &truth), PLIANT_OK)
        << pliant_last_error();
    pliant_segment_options options = usual();
    options.min_volume = 1e-6;
    Found found;
    ASSERT_EQ(pliant_segment(&scan, &options, &found), PLIANT_OK);
    double liver = dice(found, truth.voxels, 5), spleen = dice(found, truth.voxels, 1),
           lung = dice(found, truth.voxels, 14);
    std::printf("Dice with one piece: liver %.2f, spleen %.2f, right middle lobe %.2f\n", liver, spleen, lung);
    EXPECT_GT(liver, 0.5); // without contrast agent, liver, muscle and kidney lie within 20 HU
    pliant_volume_free(&scan);
    pliant_labels_free(&truth);
}

} // namespace
