/* Tests of the classification of voxels against a plain reading of the rule: the label if there is one, else the
 * range. */
#include "pliant/material.h"
#include "base/memory.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <string>
#include <vector>

namespace {

enum { AIR, FAT, SOFT, BONE };

pliant_material material(const char *name, double low, double high, std::vector<uint32_t> labels)
{
    pliant_material m = {};
    snprintf(m.name, sizeof m.name, "%s", name);
    m.young_modulus = 1000, m.poisson_ratio = 0.4, m.density = 1000;
    if (low < high) m.range[0] = low, m.range[1] = high, m.num_range = 2;
    m.num_labels = static_cast<uint32_t>(labels.size());
    std::copy(labels.begin(), labels.end(), m.labels);
    return m;
}

struct Classify : testing::Test {
    /* not in ascending order, on purpose */
    std::vector<pliant_material> materials = {material("air", -3000, -500, {}), material("fat", -500, -20, {2, 40000}),
                                              material("soft", -20, 250, {3}), material("bone", 250, 5000, {7})};
    pliant_volume scan = {};
    pliant_labels labels = {};

    pliant_material_table table() { return {materials.data(), static_cast<uint32_t>(materials.size())}; }

    void make(pliant_encoding encoding, int size = 40)
    {
        pliant_geometry geometry = {
            {size, size + 1, size + 2}, {0, 0, 0}, {1e-3, 1e-3, 1e-3}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
        ASSERT_EQ(pliant_volume_create(&geometry, encoding, &scan), PLIANT_OK);
        ASSERT_EQ(pliant_labels_create(&geometry, &labels), PLIANT_OK);
        if (scan.slope == 0) scan.slope = 1;
    }
    size_t voxels() { return pliant_geometry_voxels(&scan.geometry); }

    int expected(size_t v, bool labelled)
    {
        if (labelled && labels.voxels[v])
            for (size_t m = 0; m < materials.size(); ++m)
                for (uint32_t i = 0; i < materials[m].num_labels; ++i)
                    if (materials[m].labels[i] == labels.voxels[v]) return static_cast<int>(m);
        double value = pliant_volume_value(&scan, v);
        for (size_t m = 0; m < materials.size(); ++m)
            if (materials[m].num_range && value >= materials[m].range[0] && value < materials[m].range[1])
                return static_cast<int>(m);
        return -1;
    }

    void expect_rule(bool labelled)
    {
        pliant_material_table t = table();
        std::vector<uint8_t> out(voxels(), 99);
        ASSERT_EQ(pliant_material_classify(&t, &scan, labelled ? &labels : nullptr, out.data()), PLIANT_OK)
            << pliant_last_error();
        for (size_t v = 0; v < voxels(); ++v) ASSERT_EQ(out[v], expected(v, labelled)) << v;
    }

    std::string refusal(bool labelled)
    {
        pliant_material_table t = table();
        std::vector<uint8_t> out(voxels(), 99);
        EXPECT_EQ(pliant_material_classify(&t, &scan, labelled ? &labels : nullptr, out.data()), PLIANT_ERROR_MATERIAL);
        EXPECT_EQ(out, std::vector<uint8_t>(voxels(), 99)) << "output written on failure";
        return pliant_last_error();
    }

    void TearDown() override
    {
        pliant_volume_free(&scan);
        pliant_labels_free(&labels);
    }
};

void expect_words(const std::string &message, std::initializer_list<const char *> words)
{
    for (const char *word : words)
        EXPECT_NE(message.find(word), std::string::npos) << "\"" << word << "\" in: " << message;
}

} // namespace

TEST_F(Classify, int16_by_range_and_label)
{
    make(PLIANT_INT16);
    for (size_t v = 0; v < voxels(); ++v) {
        static_cast<int16_t *>(scan.voxels)[v] = static_cast<int16_t>(static_cast<int>(v * 7919 % 8000) - 3000);
        labels.voxels[v] = v % 5 ? 0 : v % 3 ? 7 : 40000;
    }
    expect_rule(false);
    expect_rule(true);
    scan.slope = 0.5f, scan.intercept = 100;
    expect_rule(true);
}

TEST_F(Classify, uint8_with_slope_and_intercept)
{
    make(PLIANT_UINT8);
    scan.slope = 20, scan.intercept = -1000;
    for (size_t v = 0; v < voxels(); ++v) static_cast<uint8_t *>(scan.voxels)[v] = static_cast<uint8_t>(v * 31);
    expect_rule(false);
}

TEST_F(Classify, float_at_the_very_ends_of_ranges)
{
    make(PLIANT_FLOAT32);
    const float values[] = {-3000, -500,   std::nextafterf(-500, -1000), -20, std::nextafterf(-20, -21), 249.9999f,
                            250,   4999.5f};
    for (size_t v = 0; v < voxels(); ++v) static_cast<float *>(scan.voxels)[v] = values[v % 8];
    expect_rule(false);
}

TEST_F(Classify, lists_labels_without_a_material)
{
    make(PLIANT_INT16);
    labels.voxels[3] = labels.voxels[77] = 11;
    labels.voxels[5] = 65535;
    labels.voxels[6] = 7;
    expect_words(refusal(true), {"labels", "11: 2 voxels", "65535: 1 voxels"});
}

TEST_F(Classify, a_label_map_needs_a_table_with_labels)
{
    make(PLIANT_INT16);
    for (pliant_material &m : materials) m.num_labels = 0;
    labels.voxels[3] = 11;
    expect_words(refusal(true), {"11: 1 voxels", "names no labels"});
}

TEST_F(Classify, lists_intensities_without_a_material)
{
    make(PLIANT_INT16);
    int16_t *voxel = static_cast<int16_t *>(scan.voxels);
    materials[FAT].num_range = 0;
    voxel[0] = -3001, voxel[1] = -100, voxel[2] = -21, voxel[3] = 5000, voxel[4] = 6000, voxel[5] = 6001;
    labels.voxels[4] = 7; /* a voxel with a label: its intensity has no effect */
    std::string message = refusal(true);
    expect_words(message, {"below -3000: 1 voxels", "[-500, -20): 2 voxels", "from 5000: 2 voxels"});
    EXPECT_EQ(message.find("labels"), std::string::npos) << message;
}

TEST_F(Classify, nan_is_no_material)
{
    make(PLIANT_FLOAT32);
    static_cast<float *>(scan.voxels)[17] = std::numeric_limits<float>::quiet_NaN();
    static_cast<float *>(scan.voxels)[18] = std::numeric_limits<float>::infinity();
    expect_words(refusal(false), {"not a number: 1 voxels", "from 5000: 1 voxels"});
}

TEST_F(Classify, a_label_map_on_another_grid_is_refused)
{
    make(PLIANT_INT16);
    labels.geometry.spacing[1] *= 1.01;
    pliant_material_table t = table();
    std::vector<uint8_t> out(voxels());
    EXPECT_EQ(pliant_material_classify(&t, &scan, &labels, out.data()), PLIANT_ERROR_FORMAT);
}

TEST_F(Classify, labels_without_voxels_are_none)
{
    make(PLIANT_INT16);
    const pliant_labels none = {};
    pliant_material_table t = table();
    std::vector<uint8_t> without(voxels()), empty(voxels());
    ASSERT_EQ(pliant_material_classify(&t, &scan, nullptr, without.data()), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(pliant_material_classify(&t, &scan, &none, empty.data()), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(without, empty);
}

/* Return the fraction of voxels of each material, for a whole table and a whole scan. */
static std::vector<double> fractions(const char *table_file, const pliant_volume &scan, const pliant_labels *labels,
                                     std::vector<std::string> *names)
{
    pliant_material_table table = {};
    std::string path = std::string(PLIANT_SOURCE_DIR "/launch/materials/") + table_file;
    EXPECT_EQ(pliant_material_table_read(path.c_str(), &table), PLIANT_OK) << pliant_last_error();
    std::vector<uint8_t> material(pliant_geometry_voxels(&scan.geometry));
    EXPECT_EQ(pliant_material_classify(&table, &scan, labels, material.data()), PLIANT_OK) << pliant_last_error();
    std::vector<double> fraction(table.num_materials);
    for (uint8_t m : material) fraction.at(m) += 1.0 / static_cast<double>(material.size());
    for (uint32_t m = 0; m < table.num_materials; ++m) names->push_back(table.materials[m].name);
    pliant_material_table_free(&table);
    return fraction;
}

static double share_of(const char *name, const std::vector<double> &fraction, const std::vector<std::string> &names)
{
    for (size_t m = 0; m < fraction.size(); ++m)
        if (names[m] == name) return fraction[m];
    ADD_FAILURE() << name;
    return 0;
}

TEST(classify, an_abdomen_ct_with_and_without_its_labels)
{
    pliant_volume scan = {};
    pliant_labels labels = {};
    const std::string folder = PLIANT_TEST_DATA "/abdomen/";
    if (!std::ifstream(folder + "ct.nii.gz")) GTEST_SKIP() << folder << " is not here";
    ASSERT_EQ(pliant_volume_read((folder + "ct.nii.gz").c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_labels_read((folder + "labels_totalseg_fast.nii.gz").c_str(), 0, &labels), PLIANT_OK)
        << pliant_last_error();

    std::vector<std::string> names;
    std::vector<double> by_label = fractions("totalsegmentator.yaml", scan, &labels, &names);
    const double voxels = static_cast<double>(pliant_geometry_voxels(&scan.geometry));
    /* The expected fractions come from the label map: liver 5, spleen 1, lungs 10, 11 and 14. Hips 77 and 78 are
     * bones. */
    EXPECT_NEAR(share_of("liver", by_label, names), 41692 / voxels, 1e-9);
    EXPECT_NEAR(share_of("spleen", by_label, names), 9668 / voxels, 1e-9);
    EXPECT_GT(share_of("bone", by_label, names), (13166 + 13048) / voxels);
    EXPECT_LT(share_of("bone", by_label, names), 0.06);
    EXPECT_GT(share_of("air", by_label, names), 0.25);
    EXPECT_GT(share_of("fat", by_label, names), 0.15);

    names.clear();
    std::vector<double> by_range = fractions("abdomen_ct.yaml", scan, nullptr, &names);
    EXPECT_GT(share_of("bone", by_range, names), 0.005);
    EXPECT_LT(share_of("bone", by_range, names), 0.06);
    EXPECT_GT(share_of("fat", by_range, names), 0.15);
    EXPECT_GT(share_of("soft_tissue", by_range, names), 0.2);
    pliant_volume_free(&scan);
    pliant_labels_free(&labels);
}

TEST(classify, the_phantom_with_and_without_its_labels)
{
    pliant_volume scan = {};
    pliant_labels labels = {};
    const int32_t size[3] = {100, 80, 60};
    ASSERT_EQ(pliant_phantom(size, 1, &scan, &labels), PLIANT_OK);
    std::vector<std::string> names;
    std::vector<double> by_label = fractions("phantom.yaml", scan, &labels, &names);
    std::vector<double> by_range = fractions("phantom.yaml", scan, nullptr, &names);
    EXPECT_NEAR(share_of("air", by_label, names), share_of("air", by_range, names), 0.02);
    EXPECT_NEAR(share_of("fat", by_label, names), share_of("fat", by_range, names), 0.05);
    /* discs and marrow are darker than the range of bone */
    EXPECT_GT(share_of("bone", by_label, names), share_of("bone", by_range, names));
    pliant_volume_free(&scan);
    pliant_labels_free(&labels);
}

TEST_F(Classify, failing_allocations)
{
    make(PLIANT_INT16);
    static_cast<int16_t *>(scan.voxels)[0] = 6000;
    pliant_material_table t = table();
    std::vector<uint8_t> out(voxels());
    size_t before = pliant_memory_in_use();
    for (int64_t n = 0; n < 2; ++n) {
        pliant_memory_fail_after(n);
        EXPECT_EQ(pliant_material_classify(&t, &scan, nullptr, out.data()), PLIANT_ERROR_MEMORY);
        pliant_memory_fail_after(-1);
        EXPECT_EQ(pliant_memory_in_use(), before);
    }
}
