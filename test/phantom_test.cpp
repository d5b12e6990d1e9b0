/* The built-in scan: the same bits on every machine, and each tissue with the expected size, intensity and position. */
#include "base/memory.h"
#include "scan/volume.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>
#include <cstring>
#include <map>
#include <string>
#include <vector>

namespace {

enum {
    AIR = 0,
#define LABEL_ENUM(id, name) LABEL_##name = id,
    PLIANT_PHANTOM_LIST(LABEL_ENUM)
#undef LABEL_ENUM
    NUM_LABELS
};

struct Phantom {
    pliant_volume scan = {};
    pliant_labels labels = {};
    pliant_status status;

    explicit Phantom(int ni, int nj, int nk, uint32_t seed = 1)
    {
        const int32_t size[3] = {ni, nj, nk};
        status = pliant_phantom(size, seed, &scan, &labels);
        EXPECT_EQ(status, PLIANT_OK) << pliant_last_error();
    }
    ~Phantom()
    {
        pliant_volume_free(&scan);
        pliant_labels_free(&labels);
    }
    Phantom(const Phantom &) = delete;

    size_t voxels() const { return pliant_geometry_voxels(&scan.geometry); }
    const int16_t *values() const { return static_cast<const int16_t *>(scan.voxels); }
    double voxel_volume() const
    {
        return scan.geometry.spacing[0] * scan.geometry.spacing[1] * scan.geometry.spacing[2];
    }

    /* Measure a label, or the whole scan (-1): litres, centre [m], mean and deviation of the inner values, away from
     * edges. */
    struct Measure { double litres, centre[3], mean, deviation; };
    Measure measure(int label) const
    {
        Measure m = {};
        double number = 0, inner = 0, sum = 0, squares = 0;
        const int32_t *size = scan.geometry.size;
        for (int k = 0; k < size[2]; ++k)
            for (int j = 0; j < size[1]; ++j)
                for (int i = 0; i < size[0]; ++i) {
                    if (at(i, j, k) != label) continue;
                    const double index[3] = {double(i), double(j), double(k)};
                    double world[3];
                    pliant_geometry_to_world(&scan.geometry, index, world);
                    for (int d = 0; d < 3; ++d) m.centre[d] += world[d];
                    ++number;
                    bool inside = true;
                    for (int n = 0; n < 27; ++n)
                        inside = inside && at(i + n % 3 - 1, j + n / 3 % 3 - 1, k + n / 9 - 1) == label;
                    if (!inside) continue;
                    double value = values()[i + size[0] * (j + size_t(size[1]) * k)];
                    ++inner, sum += value, squares += value * value;
                }
        for (double &c : m.centre) c /= number;
        m.litres = number * voxel_volume() * 1e3;
        m.mean = inner > 0 ? sum / inner : NAN;
        m.deviation = inner > 0 ? std::sqrt(squares / inner - m.mean * m.mean) : NAN;
        return m;
    }
    int at(int i, int j, int k) const
    {
        const int32_t *size = scan.geometry.size;
        if (i < 0 || j < 0 || k < 0 || i >= size[0] || j >= size[1] || k >= size[2]) return -1;
        return labels.voxels[i + size[0] * (j + size_t(size[1]) * k)];
    }
};

/* FNV-1a */
uint64_t checksum(const void *data, size_t bytes)
{
    uint64_t hash = 14695981039346656037u;
    for (size_t i = 0; i < bytes; ++i) hash = (hash ^ static_cast<const uint8_t *>(data)[i]) * 1099511628211u;
    return hash;
}

bool same_bits(const Phantom &a, const Phantom &b)
{
    return a.voxels() == b.voxels() && memcmp(a.scan.voxels, b.scan.voxels, 2 * a.voxels()) == 0 &&
           memcmp(a.labels.voxels, b.labels.voxels, 2 * a.voxels()) == 0;
}

const Phantom &usual()
{
    static const Phantom phantom(256, 160, 122);
    return phantom;
}

} // namespace

TEST(phantom, same_bits_again_and_with_any_number_of_threads)
{
    const int before = omp_get_max_threads();
    omp_set_num_threads(1);
    Phantom one(70, 61, 52);
    for (int threads : {1, 2, 3}) {
        omp_set_num_threads(threads);
        Phantom again(70, 61, 52);
        EXPECT_TRUE(same_bits(one, again)) << threads << " threads";
    }
    omp_set_num_threads(before);
}

/* The hash is the same on every machine and with every compiler. Change it only for an intended change of the
 * phantom. */
TEST(phantom, same_bits_on_every_machine)
{
    Phantom phantom(64, 48, 40, 7);
    EXPECT_EQ(checksum(phantom.scan.voxels, 2 * phantom.voxels()), 401021355189094006u);
    EXPECT_EQ(checksum(phantom.labels.voxels, 2 * phantom.voxels()), 18026176012485632706u);
}

/* Steps of whole voxels would show as bands in pictures. */
TEST(phantom, the_skin_is_smooth_between_voxels)
{
    const Phantom &p = usual();
    const int32_t *size = p.scan.geometry.size;
    double squares = 0, number = 0, place[3] = {0, 0, 0};
    for (int k = 0; k < size[2]; ++k)
        for (int i = size[0] / 3; i < 2 * size[0] / 3; ++i) {
            const int16_t *front = p.values() + i + size_t(size[0]) * size[1] * k;
            int j = 1;
            while (front[size_t(size[0]) * j] < -477) ++j;
            const double before = front[size_t(size[0]) * (j - 1)], after = front[size_t(size[0]) * j];
            place[0] = place[1], place[1] = place[2], place[2] = j - 1 + (-477 - before) / (after - before);
            if (i < size[0] / 3 + 2) continue;
            double bend = place[0] - 2 * place[1] + place[2];
            ++number, squares += bend * bend;
        }
    EXPECT_LT(std::sqrt(squares / number), 0.1); /* in voxels; whole voxels would give 0.32 */
}

TEST(phantom, the_seed_changes_the_noise_only)
{
    Phantom a(64, 48, 40, 7), b(64, 48, 40, 8);
    EXPECT_EQ(memcmp(a.labels.voxels, b.labels.voxels, 2 * a.voxels()), 0);
    double sum = 0, squares = 0;
    for (size_t v = 0; v < a.voxels(); ++v) {
        if (a.labels.voxels[v] == AIR) continue;
        double difference = a.values()[v] - b.values()[v];
        sum += difference, squares += difference * difference;
    }
    double number = 0;
    for (size_t v = 0; v < a.voxels(); ++v) number += a.labels.voxels[v] != AIR;
    EXPECT_NEAR(sum / number, 0, 0.2);
    EXPECT_NEAR(std::sqrt(squares / number / 2), 11, 1);
}

TEST(phantom, without_a_label_map_the_scan_is_the_same)
{
    Phantom with(40, 30, 20);
    pliant_volume scan = {};
    const int32_t size[3] = {40, 30, 20};
    ASSERT_EQ(pliant_phantom(size, 1, &scan, nullptr), PLIANT_OK);
    EXPECT_EQ(memcmp(scan.voxels, with.scan.voxels, 2 * with.voxels()), 0);
    pliant_volume_free(&scan);
}

TEST(phantom, box_is_centred_and_the_label_map_lies_on_it)
{
    const Phantom &p = usual();
    EXPECT_TRUE(pliant_geometry_equal(&p.scan.geometry, &p.labels.geometry));
    EXPECT_EQ(p.scan.encoding, PLIANT_INT16);
    EXPECT_EQ(p.scan.slope, 1);
    EXPECT_EQ(p.scan.intercept, 0);
    EXPECT_EQ(p.scan.background, -1000);
    const double box[3] = {0.40, 0.29, 0.30};
    for (int d = 0; d < 3; ++d) {
        EXPECT_NEAR(p.scan.geometry.size[d] * p.scan.geometry.spacing[d], box[d], 1e-12);
        EXPECT_NEAR(2 * p.scan.geometry.origin[d] + (p.scan.geometry.size[d] - 1) * p.scan.geometry.spacing[d], 0,
                    1e-12);
    }
}

TEST(phantom, the_body_has_the_size_of_a_body_and_air_around_it)
{
    const Phantom &p = usual();
    const int32_t *size = p.scan.geometry.size;
    int low[2] = {1000, 1000}, high[2] = {0, 0};
    for (int k = 0; k < size[2]; ++k)
        for (int j = 0; j < size[1]; ++j)
            for (int i = 0; i < size[0]; ++i)
                if (p.at(i, j, k) != AIR) {
                    low[0] = std::min(low[0], i), high[0] = std::max(high[0], i);
                    low[1] = std::min(low[1], j), high[1] = std::max(high[1], j);
                }
    EXPECT_NEAR((high[0] - low[0]) * p.scan.geometry.spacing[0], 0.36, 0.015);
    EXPECT_NEAR((high[1] - low[1]) * p.scan.geometry.spacing[1], 0.245, 0.015);
    EXPECT_GT(low[0], 2);
    EXPECT_GT(low[1], 2);
    EXPECT_LT(high[0], size[0] - 3);
    EXPECT_LT(high[1], size[1] - 3);
}

/* Litres, and Hounsfield units away from edges. The ranges come from anatomy and from a CT with contrast agent. */
TEST(phantom, every_tissue_has_its_volume_and_brightness)
{
    struct Expected { double low, high, mean, tolerance; };
    const std::map<int, Expected> expected = {
        {AIR, {12, 16, -998, 4}},
        {LABEL_skin, {0.3, 0.8, NAN, 0}}, /* too thin to have an inside */
        {LABEL_fat, {6, 11, -100, 10}},
        {LABEL_muscle, {5, 9, 53, 8}},
        {LABEL_liver, {1.2, 2.0, 108, 4}},
        {LABEL_tumour, {0.02, 0.05, 62, 12}},
        {LABEL_kidney_left, {0.10, 0.20, 183, 12}},
        {LABEL_kidney_right, {0.10, 0.20, 183, 12}},
        {LABEL_spleen, {0.1, 0.3, 124, 4}},
        {LABEL_aorta, {0.04, 0.09, 184, 5}},
        {LABEL_vessel, {0.1, 0.25, 167, 5}},
        {LABEL_spine, {0.4, 0.8, 200, 60}},
        {LABEL_rib, {0.06, 0.2, 250, 40}},
        {LABEL_hip, {0.1, 0.5, 220, 40}},
        {LABEL_bowel, {1.2, 3, 35, 15}},
        {LABEL_bowel_gas, {0.05, 0.25, -985, 15}},
    };
    ASSERT_EQ(expected.size(), size_t(NUM_LABELS));
    for (const auto &item : expected) {
        Phantom::Measure m = usual().measure(item.first);
        SCOPED_TRACE(std::string("label ") + std::to_string(item.first) + " " + pliant_phantom_label_name(item.first));
        EXPECT_GT(m.litres, item.second.low);
        EXPECT_LT(m.litres, item.second.high);
        if (std::isnan(item.second.mean)) continue;
        EXPECT_NEAR(m.mean, item.second.mean, item.second.tolerance);
    }
    EXPECT_NEAR(usual().measure(LABEL_spleen).deviation, 11, 2.5);
}

/* LPS: x grows to the left, y to the back, z to the head */
TEST(phantom, organs_lie_where_they_belong)
{
    std::map<int, Phantom::Measure> m;
    for (int label = 1; label < NUM_LABELS; ++label) m[label] = usual().measure(label);
    EXPECT_LT(m[LABEL_liver].centre[0], -0.03);
    EXPECT_GT(m[LABEL_spleen].centre[0], 0.08);
    EXPECT_GT(m[LABEL_kidney_left].centre[0], 0.05);
    EXPECT_LT(m[LABEL_kidney_right].centre[0], -0.05);
    EXPECT_GT(m[LABEL_kidney_left].centre[2], m[LABEL_kidney_right].centre[2]);
    EXPECT_GT(m[LABEL_spine].centre[1], m[LABEL_aorta].centre[1]);
    EXPECT_NEAR(m[LABEL_spine].centre[0], 0, 0.005);
    EXPECT_LT(m[LABEL_hip].centre[2], -0.08);
    EXPECT_GT(m[LABEL_rib].centre[2], 0.08);
    EXPECT_LT(m[LABEL_bowel_gas].centre[1], m[LABEL_bowel].centre[1]);
}

TEST(phantom, the_tumour_lies_inside_the_liver)
{
    const Phantom &p = usual();
    const int32_t *size = p.scan.geometry.size;
    size_t outside = 0;
    for (int k = 0; k < size[2]; ++k)
        for (int j = 0; j < size[1]; ++j)
            for (int i = 0; i < size[0]; ++i) {
                if (p.at(i, j, k) != LABEL_tumour) continue;
                const int around[6] = {p.at(i - 1, j, k), p.at(i + 1, j, k), p.at(i, j - 1, k),
                                       p.at(i, j + 1, k), p.at(i, j, k - 1), p.at(i, j, k + 1)};
                for (int label : around)
                    outside += label != LABEL_tumour && label != LABEL_liver && label != LABEL_vessel;
            }
    EXPECT_EQ(outside, 0u);
}

TEST(phantom, the_body_is_the_same_at_another_size)
{
    Phantom other(200, 200, 150);
    for (int label = 0; label < NUM_LABELS; ++label) {
        Phantom::Measure a = usual().measure(label), b = other.measure(label);
        /* tissues that are a few voxels thick have a larger counting error: skin, ribs, flat pockets of gas */
        bool thin = label == LABEL_skin || label == LABEL_rib || label == LABEL_bowel_gas;
        double tolerance = thin ? 0.06 : 0.03;
        EXPECT_NEAR(b.litres / a.litres, 1, tolerance) << pliant_phantom_label_name(label);
        for (int d = 0; d < 3; ++d) EXPECT_NEAR(a.centre[d], b.centre[d], 0.002) << pliant_phantom_label_name(label);
    }
}

TEST(phantom, label_names)
{
    EXPECT_STREQ(pliant_phantom_label_name(4), "liver");
    EXPECT_STREQ(pliant_phantom_label_name(15), "bowel_gas");
    EXPECT_STREQ(pliant_phantom_label_name(0), "");
    EXPECT_STREQ(pliant_phantom_label_name(16), "");
    EXPECT_STREQ(pliant_phantom_label_name(-1), "");
}

TEST(phantom, sizes_from_16_on)
{
    Phantom smallest(16, 16, 16), flat(16, 300, 17);
    EXPECT_GT(smallest.measure(LABEL_liver).litres, 0.5);
    for (int d = 0; d < 3; ++d) {
        int32_t size[3] = {20, 20, 20};
        size[d] = 15;
        pliant_volume scan = {};
        EXPECT_EQ(pliant_phantom(size, 1, &scan, nullptr), PLIANT_ERROR_ARGUMENT);
        EXPECT_NE(std::string(pliant_last_error()).find("at least 16"), std::string::npos);
        EXPECT_EQ(scan.voxels, nullptr);
    }
}

TEST(phantom, failing_allocations_leave_nothing_behind)
{
    size_t before = pliant_memory_in_use();
    const int32_t size[3] = {16, 16, 16};
    for (int64_t n = 0;; ++n) {
        pliant_volume scan = {};
        pliant_labels labels = {};
        pliant_memory_fail_after(n);
        pliant_status status = pliant_phantom(size, 1, &scan, &labels);
        pliant_memory_fail_after(-1);
        if (status == PLIANT_OK) {
            EXPECT_GE(n, 5);
            pliant_volume_free(&scan);
            pliant_labels_free(&labels);
            break;
        }
        ASSERT_EQ(status, PLIANT_ERROR_MEMORY) << n;
        ASSERT_EQ(scan.voxels, nullptr);
        ASSERT_EQ(labels.voxels, nullptr);
        ASSERT_EQ(pliant_memory_in_use(), before) << n;
    }
    EXPECT_EQ(pliant_memory_in_use(), before);
}
