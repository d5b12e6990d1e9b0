/* Tests of material tables: reading, error messages, and failing allocations. */
#include "material/material.h"
#include "base/memory.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

namespace {

const char good[] = "materials:\n"
                    "  - name: air\n"
                    "    young_modulus: 10\n"
                    "    poisson_ratio: 0\n"
                    "    density: 1.2\n"
                    "    empty: true\n"
                    "    range: [-2000, -500]\n"
                    "  - name: liver\n"
                    "    young_modulus: 6.0e+3\n"
                    "    poisson_ratio: 0.45\n"
                    "    density: 1060\n"
                    "    toughness: 187\n"
                    "    labels: [5, 7]\n"
                    "  - {name: bone, young_modulus: 1e7, poisson_ratio: 0.3, density: 1330, fixed: yes, range: [250, "
                    "4000], labels: [9]}\n";

struct Table : pliant_material_table {
    Table() { materials = nullptr, num_materials = 0; }
    ~Table() { pliant_material_table_free(this); }
    Table(const Table &) = delete;
};

std::string refusal(const std::string &yaml)
{
    Table table;
    EXPECT_EQ(pliant_material_table_parse(yaml.c_str(), "t.yaml", &table), PLIANT_ERROR_FORMAT) << yaml;
    EXPECT_EQ(table.materials, nullptr);
    return pliant_last_error();
}

/* Return the valid table with one replaced part. */
std::string with(const std::string &from, const std::string &to)
{
    std::string yaml = good;
    size_t at = yaml.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return yaml.replace(at, from.size(), to);
}

void expect_words(const std::string &message, std::initializer_list<const char *> words)
{
    for (const char *word : words)
        EXPECT_NE(message.find(word), std::string::npos) << "\"" << word << "\" in: " << message;
}

} // namespace

TEST(table, reads_every_field)
{
    Table t;
    ASSERT_EQ(pliant_material_table_parse(good, "t.yaml", &t), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(t.num_materials, 3u);
    EXPECT_STREQ(t.materials[0].name, "air");
    EXPECT_TRUE(t.materials[0].empty);
    EXPECT_FALSE(t.materials[0].fixed);
    EXPECT_EQ(t.materials[0].num_range, 2u);
    EXPECT_EQ(t.materials[0].range[0], -2000);
    EXPECT_EQ(t.materials[0].range[1], -500);
    EXPECT_EQ(t.materials[0].num_labels, 0u);
    EXPECT_EQ(t.materials[1].young_modulus, 6000);
    EXPECT_EQ(t.materials[1].poisson_ratio, 0.45);
    EXPECT_EQ(t.materials[1].density, 1060);
    EXPECT_EQ(t.materials[1].toughness, 187);
    EXPECT_EQ(t.materials[2].toughness, PLIANT_DEFAULT_TOUGHNESS);
    EXPECT_EQ(t.materials[1].num_range, 0u);
    ASSERT_EQ(t.materials[1].num_labels, 2u);
    EXPECT_EQ(t.materials[1].labels[1], 7u);
    EXPECT_TRUE(t.materials[2].fixed);
    EXPECT_EQ(t.materials[2].labels[0], 9u);
}

TEST(table, errors_name_file_line_field_and_what_is_right)
{
    expect_words(refusal(with("density: 1060", "densiti: 1060")),
                 {"t.yaml", "line 11", "densiti", "density", "poisson_ratio"});
    expect_words(refusal(with("    density: 1060\n", "")), {"t.yaml", "line ", "density"});
    expect_words(refusal(with("6.0e+3", "6 kPa")),
                 {"t.yaml", "line 8", "liver", "young_modulus", "6 kPa", "not a number"});
    expect_words(refusal(with("6.0e+3", "-1")), {"line 8", "liver", "young_modulus", "(0, 1e12]"});
    expect_words(refusal(with("6.0e+3", "nan")), {"line 8", "young_modulus", "nan"});
    expect_words(refusal(with("0.45", "0.5")), {"line 8", "poisson_ratio", "[0, 0.4999]"});
    expect_words(refusal(with("0.45", "0.49991")), {"t.yaml", "line 8", "poisson_ratio: 0.49991", "[0, 0.4999]"});
    expect_words(refusal(with("0.45", "-0.1")), {"line 8", "poisson_ratio: -0.1", "[0, 0.4999]"});
    Table t;
    EXPECT_EQ(pliant_material_table_parse(with("0.45", "0.4999").c_str(), "t.yaml", &t), PLIANT_OK);
    expect_words(refusal(with("1060", "-3")), {"line 8", "density"});
    expect_words(refusal(with("187", "-187")), {"line 8", "toughness: -187 J/m^2 is not in [0, 1e9]"});
    expect_words(refusal(with("187", "tough")), {"line 8", "toughness", "is not a number"});
    expect_words(refusal(with("empty: true", "empty: maybe")), {"line 2", "empty", "maybe", "true"});
    expect_words(refusal(with("empty: true", "empty: true\n    fixed: true")), {"line 2", "fixed and empty"});
    expect_words(refusal(with("[-2000, -500]", "[-500, -2000]")), {"line 2", "air", "range", "less than"});
    expect_words(refusal(with("[-2000, -500]", "[-500]")), {"line 7", "range", "2"});
    expect_words(refusal(with("[-2000, -500]", "[-2000, 251]")), {"line 14", "bone", "overlaps", "air"});
    expect_words(refusal(with("[5, 7]", "[5, 9]")), {"line 14", "labels", "9", "twice", "liver"});
    expect_words(refusal(with("[5, 7]", "[5, 5]")), {"line 8", "labels", "twice"});
    expect_words(refusal(with("[5, 7]", "[0]")), {"line 8", "labels", "'0'", "no label"});
    expect_words(refusal(with("[5, 7]", "[70000]")), {"line 8", "70000", "65535"});
    expect_words(refusal(with("labels: [5, 7]", "segments: [left lobe, Left_Lobe]")),
                 {"line 8", "segments: 'Left_Lobe' is named twice", "'liver'"});
    expect_words(refusal(with("labels: [5, 7]", "segments: [Bone]")),
                 {"bone", "name: it is also the name of a segment of 'liver'"});
    expect_words(refusal(with("labels: [5, 7]", "segments: [AIR]")),
                 {"line 8", "segments: 'AIR' is named twice, also by 'air'"});
    expect_words(refusal(with("labels: [5, 7]", "segments: ['']")), {"line 8", "segments: ''", "1 to 47 characters"});
    expect_words(refusal(with("name: liver", "name: air")), {"name", "another"});
    expect_words(refusal(with("name: liver", "name: " + std::string(60, 'x'))), {"name", "longer than 47"});
    expect_words(refusal(""), {"t.yaml", "empty", "materials"});
    expect_words(refusal("materials: []\n"), {"t.yaml", "line 1", "materials"});
    expect_words(refusal("materials: [\n"), {"t.yaml", "line "});
}

TEST(table, touching_ranges_do_not_overlap)
{
    Table t;
    EXPECT_EQ(pliant_material_table_parse(with("[-2000, -500]", "[-2000, 250]").c_str(), "t.yaml", &t), PLIANT_OK);
}

TEST(table, a_missing_file_is_named)
{
    Table t;
    EXPECT_EQ(pliant_material_table_read("/nowhere/materials.yaml", &t), PLIANT_ERROR_FILE);
    expect_words(pliant_last_error(), {"/nowhere/materials.yaml"});
    EXPECT_EQ(pliant_material_table_read("/", &t), PLIANT_ERROR_FILE);
}

TEST(table, check_catches_tables_made_by_hand)
{
    Table t;
    EXPECT_EQ(pliant_material_table_check(&t), PLIANT_ERROR_FORMAT);
    ASSERT_EQ(pliant_material_table_parse(good, "t.yaml", &t), PLIANT_OK);
    EXPECT_EQ(pliant_material_table_check(&t), PLIANT_OK);
    t.materials[1].num_range = 1;
    EXPECT_EQ(pliant_material_table_check(&t), PLIANT_ERROR_FORMAT);
    t.materials[1].num_range = 0;
    t.materials[1].labels[0] = 70000;
    EXPECT_EQ(pliant_material_table_check(&t), PLIANT_ERROR_FORMAT);
}

TEST(table, a_copy_is_its_own)
{
    Table t, copy;
    ASSERT_EQ(pliant_material_table_parse(good, "t.yaml", &t), PLIANT_OK);
    ASSERT_EQ(pliant_material_table_copy(&t, &copy), PLIANT_OK);
    t.materials[1].young_modulus = 1;
    EXPECT_EQ(copy.num_materials, 3u);
    EXPECT_EQ(copy.materials[1].young_modulus, 6000);
}

TEST(table, the_built_in_one_is_the_file_and_has_no_gaps)
{
    Table built_in, file;
    ASSERT_EQ(pliant_material_table_default(&built_in), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_material_table_read(PLIANT_SOURCE_DIR "/launch/materials/abdomen_ct.yaml", &file), PLIANT_OK);
    ASSERT_EQ(built_in.num_materials, file.num_materials);
    for (uint32_t m = 0; m < file.num_materials; ++m) {
        EXPECT_STREQ(built_in.materials[m].name, file.materials[m].name);
        EXPECT_EQ(built_in.materials[m].young_modulus, file.materials[m].young_modulus);
    }
    for (double hu = -2000; hu < 5000; hu += 0.5) {
        int found = 0;
        for (uint32_t m = 0; m < file.num_materials; ++m)
            found += hu >= file.materials[m].range[0] && hu < file.materials[m].range[1];
        ASSERT_EQ(found, 1) << hu;
    }
}

TEST(table, every_shipped_table_is_valid)
{
    for (const char *name :
         {"abdomen_ct", "phantom", "totalsegmentator", "totalsegmentator_mr", "totalsegmentator_liver_vessels"}) {
        Table t;
        std::string path = std::string(PLIANT_SOURCE_DIR "/launch/materials/") + name + ".yaml";
        ASSERT_EQ(pliant_material_table_read(path.c_str(), &t), PLIANT_OK) << pliant_last_error();
        bool air = false, bone = false;
        for (uint32_t m = 0; m < t.num_materials; ++m) {
            air |= t.materials[m].empty;
            bone |= t.materials[m].fixed;
            EXPECT_LE(t.materials[m].poisson_ratio, 0.49) << name << " " << t.materials[m].name;
        }
        EXPECT_TRUE(air && bone) << name;
    }
}

/* TotalSegmentator's classes by task, in the order of their ids (totalsegmentator/map_to_binary.py). */
static std::vector<std::string> classes_of(const std::string &task)
{
    std::vector<std::string> names;
    auto add = [&](std::initializer_list<const char *> more) { names.insert(names.end(), more.begin(), more.end()); };
    auto both = [&](std::initializer_list<const char *> more, const char *first, const char *second) {
        for (const char *name : more)
            names.insert(names.end(), {std::string(name) + first, std::string(name) + second});
    };
    if (task == "liver_vessels") return {"liver_vessels", "liver_tumor"};
    add({"spleen", "kidney_right", "kidney_left", "gallbladder", "liver", "stomach", "pancreas", "adrenal_gland_right",
         "adrenal_gland_left"});
    if (task == "total_mr") {
        add({"lung_left", "lung_right", "esophagus", "small_bowel", "duodenum", "colon", "urinary_bladder", "prostate",
             "sacrum", "vertebrae", "intervertebral_discs", "spinal_cord", "heart", "aorta", "inferior_vena_cava",
             "portal_vein_and_splenic_vein"});
        both({"iliac_artery", "iliac_vena", "humerus", "scapula", "clavicula", "femur", "hip", "gluteus_maximus",
              "gluteus_medius", "gluteus_minimus", "autochthon", "iliopsoas"},
             "_left", "_right");
        add({"brain"});
        return names;
    }
    add({"lung_upper_lobe_left", "lung_lower_lobe_left", "lung_upper_lobe_right", "lung_middle_lobe_right",
         "lung_lower_lobe_right", "esophagus", "trachea", "thyroid_gland", "small_bowel", "duodenum", "colon",
         "urinary_bladder", "prostate", "kidney_cyst_left", "kidney_cyst_right", "sacrum", "vertebrae_S1"});
    for (int n = 5; n >= 1; n--) names.push_back("vertebrae_L" + std::to_string(n));
    for (int n = 12; n >= 1; n--) names.push_back("vertebrae_T" + std::to_string(n));
    for (int n = 7; n >= 1; n--) names.push_back("vertebrae_C" + std::to_string(n));
    add({"heart", "aorta", "pulmonary_vein", "brachiocephalic_trunk"});
    both({"subclavian_artery", "common_carotid_artery"}, "_right", "_left");
    both({"brachiocephalic_vein"}, "_left", "_right");
    add({"atrial_appendage_left", "superior_vena_cava", "inferior_vena_cava", "portal_vein_and_splenic_vein"});
    both({"iliac_artery", "iliac_vena", "humerus", "scapula", "clavicula", "femur", "hip"}, "_left", "_right");
    add({"spinal_cord"});
    both({"gluteus_maximus", "gluteus_medius", "gluteus_minimus", "autochthon", "iliopsoas"}, "_left", "_right");
    add({"brain", "skull"});
    for (const char *side : {"left", "right"})
        for (int n = 1; n <= 12; n++) names.push_back(std::string("rib_") + side + "_" + std::to_string(n));
    add({"sternum", "costal_cartilages"});
    return names;
}

/* A class has the same material by its id in a label map and by its name in a segmentation. */
TEST(table, classes_of_totalsegmentator_by_id_and_by_name)
{
    const struct {
        const char *task, *file;
        size_t classes;
    } tasks[] = {{"total", "totalsegmentator", 117},
                 {"total_mr", "totalsegmentator_mr", 50},
                 {"liver_vessels", "totalsegmentator_liver_vessels", 2}};
    for (const auto &task : tasks) {
        Table t;
        std::string path = std::string(PLIANT_SOURCE_DIR "/launch/materials/") + task.file + ".yaml";
        ASSERT_EQ(pliant_material_table_read(path.c_str(), &t), PLIANT_OK) << pliant_last_error();
        const std::vector<std::string> names = classes_of(task.task);
        ASSERT_EQ(names.size(), task.classes);
        size_t ids = 0;
        for (uint32_t m = 0; m < t.num_materials; ++m) ids += t.materials[m].num_labels;
        EXPECT_EQ(ids, names.size()) << task.task;
        for (size_t n = 0; n < names.size(); ++n) {
            pliant_label_segment segment = {};
            segment.label = segment.value = uint16_t(n + 1);
            std::snprintf(segment.name, sizeof segment.name, "%s", names[n].c_str());
            const int by_name = pliant_material_of_segment(&t, &segment);
            std::snprintf(segment.name, sizeof segment.name, "Segment_1");
            const int by_id = pliant_material_of_segment(&t, &segment);
            EXPECT_EQ(by_name, by_id) << task.task << " " << names[n];
            EXPECT_GE(by_id, 0) << task.task << " " << names[n];
        }
    }
}

TEST(table, text_of_a_table_reads_back_identically)
{
    Table table, again;
    ASSERT_EQ(pliant_material_table_parse(
                  with("187", "187.00000000000003\n    segments: [left lobe, \"the \\\"caudate\\\" lobe\"]").c_str(),
                  "t.yaml", &table),
              PLIANT_OK)
        << pliant_last_error();
    std::string text(pliant_material_table_text(&table, 0, nullptr), '\0');
    EXPECT_EQ(pliant_material_table_text(&table, text.size() + 1, &text[0]), text.size());
    ASSERT_EQ(pliant_material_table_parse(text.c_str(), "text", &again), PLIANT_OK) << pliant_last_error() << text;
    ASSERT_EQ(again.num_materials, table.num_materials);
    for (uint32_t m = 0; m < table.num_materials; ++m) {
        const pliant_material &a = table.materials[m], &b = again.materials[m];
        EXPECT_STREQ(a.name, b.name);
        EXPECT_EQ(a.young_modulus, b.young_modulus);
        EXPECT_EQ(a.poisson_ratio, b.poisson_ratio);
        EXPECT_EQ(a.density, b.density);
        EXPECT_EQ(a.toughness, b.toughness);
        EXPECT_EQ(a.fixed, b.fixed);
        EXPECT_EQ(a.empty, b.empty);
        ASSERT_EQ(a.num_range, b.num_range);
        EXPECT_TRUE(std::equal(a.range, a.range + a.num_range, b.range));
        ASSERT_EQ(a.num_labels, b.num_labels);
        EXPECT_TRUE(std::equal(a.labels, a.labels + a.num_labels, b.labels));
        ASSERT_EQ(a.num_segments, b.num_segments);
        EXPECT_EQ(a.num_segments, m == 1 ? 2u : 0u);
        for (uint32_t s = 0; s < a.num_segments; ++s) EXPECT_STREQ(a.segments[s], b.segments[s]);
    }
}

TEST(table, failing_allocations_leave_nothing_behind)
{
    size_t before = pliant_memory_in_use();
    for (int64_t n = 0;; ++n) {
        Table t;
        pliant_memory_fail_after(n);
        pliant_status status = pliant_material_table_parse(good, "t.yaml", &t);
        pliant_memory_fail_after(-1);
        if (status == PLIANT_OK) {
            EXPECT_GT(n, 10);
            break;
        }
        ASSERT_EQ(status, PLIANT_ERROR_MEMORY) << n << ": " << pliant_last_error();
        ASSERT_EQ(t.materials, nullptr);
        ASSERT_EQ(pliant_memory_in_use(), before) << n;
    }
    EXPECT_EQ(pliant_memory_in_use(), before);
}
