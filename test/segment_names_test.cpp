/* Segments select materials by name: matches, unknown names, and log messages. */
#include "material/names.h"
#include "base/memory.h"
#include "material/material.h"
#include "scan_files.h"

namespace {

const char TABLE[] =
    "materials:\n"
    "  - {name: air, young_modulus: 10, poisson_ratio: 0, density: 1, empty: true, range: [-2000, 2000]}\n"
    "  - {name: liver, young_modulus: 5500, poisson_ratio: 0.45, density: 1060, labels: [1, 5]}\n"
    "  - {name: Kidney, young_modulus: 9000, poisson_ratio: 0.45, density: 1050, labels: [2], "
    "segments: [kidney_left, kidney_right]}\n"
    "  - {name: soft_tissue, young_modulus: 9000, poisson_ratio: 0.45, density: 1050}\n"
    "  - {name: LIVER, young_modulus: 1000, poisson_ratio: 0.45, density: 1050}\n";

struct table_holder {
    pliant_material_table table = {};
    table_holder()
    {
        EXPECT_EQ(pliant_material_table_parse(TABLE, "t.yaml", &table), PLIANT_OK) << pliant_last_error();
    }
    ~table_holder() { pliant_material_table_free(&table); }
};

pliant_label_segment segment_of(const std::string &name, const std::string &identifier = "",
                                const std::string &terminology = "", uint16_t label = 9, uint16_t value = 9)
{
    pliant_label_segment out = {};
    out.label = label;
    out.value = value;
    std::snprintf(out.name, sizeof out.name, "%s", name.c_str());
    std::snprintf(out.identifier, sizeof out.identifier, "%s", identifier.c_str());
    std::snprintf(out.terminology, sizeof out.terminology, "%s", terminology.c_str());
    return out;
}

/* A scan of four voxels. The first n voxels have the labels of n segments. */
struct segmented {
    pliant_volume scan = {};
    pliant_labels labels = {};
    explicit segmented(const std::vector<pliant_label_segment> &segments)
    {
        const pliant_geometry geometry = {{4, 2, 2}, {0, 0, 0}, {1e-3, 1e-3, 1e-3}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
        EXPECT_EQ(pliant_volume_create(&geometry, PLIANT_INT16, &scan), PLIANT_OK);
        EXPECT_EQ(pliant_labels_create(&geometry, &labels), PLIANT_OK);
        labels.segments = static_cast<pliant_label_segment *>(pliant_calloc(segments.size(), sizeof segments[0]));
        labels.num_segments = uint32_t(segments.size());
        for (size_t n = 0; n < segments.size(); n++) {
            labels.segments[n] = segments[n];
            labels.voxels[n] = segments[n].label;
        }
    }
    ~segmented()
    {
        pliant_volume_free(&scan);
        pliant_labels_free(&labels);
    }
};

std::string &logged()
{
    static std::string text;
    return text;
}

} // namespace

TEST(SegmentNames, CaseBlanksAndOrderOfWords)
{
    for (const char *same :
         {"kidney_left", "Kidney Left", "left kidney", "  LEFT-KIDNEY ", "kidneyleft", "Kidney, left"})
        EXPECT_TRUE(pliant_same_name("kidney_left", same)) << same;
    for (const char *other : {"kidney", "kidney_right", "kidney_left_2", "", "leftkidney"})
        EXPECT_FALSE(pliant_same_name("kidney_left", other)) << other;
    EXPECT_TRUE(pliant_same_name("L\xc3\xa4" "ppchen 1", "l\xc3\xa4" "ppchen1"));
    EXPECT_FALSE(pliant_same_name("", "_"));
}

TEST(SegmentNames, PrecedenceOfNames)
{
    table_holder held;
    const struct {
        pliant_label_segment segment;
        int material;
        pliant_segment_match match;
    } cases[] = {{segment_of("liver"), 1, PLIANT_SEGMENT_BY_NAME},
                 {segment_of("LIVER"), 4, PLIANT_SEGMENT_BY_NAME}, /* the exact spelling has priority */
                 {segment_of("Liver"), 1, PLIANT_SEGMENT_BY_NAME},
                 {segment_of("kidney"), 2, PLIANT_SEGMENT_BY_NAME},
                 {segment_of("Right Kidney"), 2, PLIANT_SEGMENT_BY_NAME},
                 {segment_of("Soft tissue"), 3, PLIANT_SEGMENT_BY_NAME},
                 {segment_of("kidney, right", "liver", "soft tissue"), 2, PLIANT_SEGMENT_BY_NAME},
                 {segment_of("right", "kidney_right", "Liver"), 2, PLIANT_SEGMENT_BY_IDENTIFIER},
                 {segment_of("Leber", "Segment_1", "Liver"), 1, PLIANT_SEGMENT_BY_TERMINOLOGY},
                 {segment_of("Segment_2", "Segment_2", "", 2, 2), 2, PLIANT_SEGMENT_BY_VALUE},
                 {segment_of("", "", "", 5, 5), 1, PLIANT_SEGMENT_BY_VALUE},
                 /* several layers reuse the same values */
                 {segment_of("Segment_2", "Segment_2", "", 2, 1), -1, PLIANT_SEGMENT_UNKNOWN},
                 /* with a name, the value is ignored */
                 {segment_of("lesion", "", "", 2, 2), -1, PLIANT_SEGMENT_UNKNOWN},
                 {segment_of("liver_tumor", "Segment_3", ""), -1, PLIANT_SEGMENT_UNKNOWN}};
    for (const auto &one : cases) {
        pliant_segment_match match;
        EXPECT_EQ(pliant_segment_match_of(&held.table, &one.segment, &match), one.material) << one.segment.name;
        EXPECT_EQ(match, one.match) << one.segment.name;
        EXPECT_EQ(pliant_material_of_segment(&held.table, &one.segment), one.material);
    }
}

TEST(SegmentNames, MaterialsByName)
{
    table_holder held;
    segmented map({segment_of("Left Kidney", "", "", 1, 1), segment_of("LIVER", "", "", 2, 1),
                   segment_of("empty", "", "", 5, 5)});
    map.labels.voxels[2] = 0;
    std::vector<uint8_t> material(16, 99);
    ASSERT_EQ(pliant_material_classify(&held.table, &map.scan, &map.labels, material.data()), PLIANT_OK)
        << pliant_last_error();
    EXPECT_EQ(material[0], 2);
    EXPECT_EQ(material[1], 4);
    EXPECT_EQ(material[2], 0);
    pliant_set_log([](pliant_log_level, const char *message, void *) { logged() += std::string(message) + "\n"; },
                   nullptr);
    logged().clear();
    EXPECT_EQ(pliant_material_log_usage(&held.table, &map.scan, &map.labels, material.data()), PLIANT_OK);
    pliant_set_log(nullptr, nullptr);
    expect_words(logged(),
                 {"material Kidney: 1 voxels, 0.001 ml: segment \"Left Kidney\" 1\n", "material LIVER: 1 voxels",
                  "material air: 14 voxels, 0.014 ml: by intensity 14", "segments without a voxel in the scan: empty"});
}

TEST(SegmentNames, UnknownOnesAreListedWithTheNearest)
{
    table_holder held;
    segmented map({segment_of("livr", "", "", 1, 1), segment_of("Kindey left", "", "", 2, 2),
                   segment_of("liver_tumor", "", "", 3, 3), segment_of("liver", "", "", 4, 4)});
    std::vector<uint8_t> material(16, 99);
    EXPECT_EQ(pliant_material_classify(&held.table, &map.scan, &map.labels, material.data()), PLIANT_ERROR_MATERIAL);
    expect_words(pliant_last_error(),
                 {"no material for segments \"livr\" (nearest names: liver",
                  "): 1 voxels, \"Kindey left\" (nearest names: kidney_left", "\"liver_tumor\" (nearest names: liver",
                  "rename the segments", "\"segments\" of a material"});
    EXPECT_EQ(std::string(pliant_last_error()).find("\"liver\" ("), std::string::npos);
    EXPECT_EQ(material[0], 99);

    std::vector<pliant_label_segment> many;
    for (uint16_t n = 1; n <= 16; n++) many.push_back(segment_of(std::string(60, char('a' + n)), "", "", n, n));
    segmented all(many);
    EXPECT_EQ(pliant_material_classify(&held.table, &all.scan, &all.labels, material.data()), PLIANT_ERROR_MATERIAL);
    expect_words(pliant_last_error(), {"more; rename the segments"});
}

/* The class ids decide. The names warn of a table for another task. */
TEST(SegmentNames, ClassesGoByTheirIds)
{
    table_holder held;
    pliant_label_segment kidney = segment_of("kidney_left", "", "", 2, 2),
                         other = segment_of("kidney_right", "", "", 5, 5), unknown = segment_of("liver", "", "", 7, 7);
    kidney.is_class = other.is_class = unknown.is_class = 1;
    segmented map({kidney, other});
    map.labels.voxels[2] = 1; /* an id without a name in the file */
    std::vector<uint8_t> material(16, 99);
    ASSERT_EQ(pliant_material_classify(&held.table, &map.scan, &map.labels, material.data()), PLIANT_OK)
        << pliant_last_error();
    EXPECT_EQ(material[0], 2);
    EXPECT_EQ(material[1], 1);
    EXPECT_EQ(material[2], 1);
    pliant_set_log([](pliant_log_level, const char *message, void *) { logged() += std::string(message) + "\n"; },
                   nullptr);
    logged().clear();
    EXPECT_EQ(pliant_material_log_usage(&held.table, &map.scan, &map.labels, material.data()), PLIANT_OK);
    pliant_set_log(nullptr, nullptr);
    expect_words(
        logged(),
        {"material Kidney: 1 voxels, 0.001 ml: label 2 \"kidney_left\" 1\n",
         "material liver: 2 voxels, 0.002 ml: label 5 \"kidney_right\" 1, label 1 1\n",
         "disagree (is it the table of this task?): label 5 is \"kidney_right\", but has material liver, "
         "not Kidney\n"});
    segmented missing({unknown});
    EXPECT_EQ(pliant_material_classify(&held.table, &missing.scan, &missing.labels, material.data()),
              PLIANT_ERROR_MATERIAL);
    expect_words(pliant_last_error(), {"no material for labels 7 (liver): 1 voxels"});
}
