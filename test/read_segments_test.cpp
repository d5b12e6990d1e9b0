/* Segmentations with names: .seg.nrrd and DICOM SEG. */
#include "scan/volume.h"
#include "segmentation_files.h"

#include <cmath>
#include <random>

namespace {

struct labels_holder {
    pliant_labels labels = {};
    ~labels_holder() { pliant_labels_free(&labels); }
    pliant_labels *operator->() { return &labels; }
    pliant_labels *operator&() { return &labels; }
};

/* Expect that reading labels fails with this status and these words. The output is unchanged, and no memory leaks. */
void expect_no_labels(const std::string &path, const std::string &bytes, const std::vector<std::string> &words)
{
    pliant_labels labels, before;
    std::memset(&labels, 0x5a, sizeof labels);
    std::memcpy(&before, &labels, sizeof labels);
    const size_t in_use = pliant_memory_in_use();
    save(path, bytes);
    EXPECT_EQ(pliant_labels_read(path.c_str(), 0, &labels), PLIANT_ERROR_FORMAT);
    EXPECT_EQ(std::memcmp(&labels, &before, sizeof labels), 0);
    EXPECT_EQ(pliant_memory_in_use(), in_use);
    expect_words(pliant_last_error(), words);
}

seg_nrrd_file three_layers()
{
    seg_nrrd_file file;
    file.layers = 3;
    file.segments = {
        {"Liver", "Segment_1", "1", "0", "0.25 0.5 1", terminology("SCT^10200004^Liver")},
        {"left kidney", "kidney_left", "1", "2", "", terminology("SCT^64033007^Kidney", "SCT^7771000^Left")},
        {"Segment_3", "Segment_3", "2", "1", "", terminology("SCT^85756007^Tissue")},
        {"", "", "7", "1", "", ""}};
    file.set(0, 0, 1);
    file.set(1, 0, 1);
    file.set(1, 2, 1);  /* over the liver */
    file.set(2, 1, 2);
    file.set(2, 2, 1);  /* an earlier segment in a later layer */
    file.set(2, 0, 1);  /* three segments share a voxel */
    file.set(23, 1, 7);
    file.set(22, 0, 9); /* no segment */
    return file;
}

} // namespace

TEST(SegNrrd, LayersAndNames)
{
    temporary_folder folder;
    for (int variant = 0; variant < 4; variant++) {
        seg_nrrd_file file = three_layers();
        file.compressed = variant & 1;
        if (variant & 2) {
            seg_nrrd_file other = file;
            other.layers_first = false;
            for (size_t voxel = 0; voxel < 24; voxel++)
                for (size_t layer = 0; layer < 3; layer++)
                    other.set(voxel, layer, file.voxels[file.at(voxel, layer)[0]]);
            file = other;
        }
        save(folder / "a.seg.nrrd", file.bytes());
        labels_holder map;
        log_catcher log;
        ASSERT_EQ(pliant_labels_read((folder / "a.seg.nrrd").c_str(), 0, &map), PLIANT_OK) << pliant_last_error();
        std::vector<uint16_t> wanted(24, 0);
        wanted[0] = 1;
        wanted[1] = 2;
        wanted[2] = 3;
        wanted[23] = 4;
        EXPECT_EQ(std::vector<uint16_t>(map->voxels, map->voxels + 24), wanted);
        expect_words(log.warnings(),
                     {"the later one wins in 2 voxels", "left kidney over Liver in 1", "Segment_3 over L", " in 1",
                      "1 voxels have values that are no segment's", "LabelValue is 9"});
        ASSERT_EQ(map->num_segments, 4u);
        const struct {
            uint16_t label, value;
            const char *name, *identifier, *terminology;
        } segments[] = {{1, 1, "Liver", "Segment_1", "Liver"}, {2, 1, "left kidney", "kidney_left", "Left Kidney"},
                        {3, 2, "Segment_3", "Segment_3", ""},  {4, 7, "", "", ""}};
        for (size_t n = 0; n < 4; n++) {
            EXPECT_EQ(map->segments[n].label, segments[n].label);
            EXPECT_EQ(map->segments[n].value, segments[n].value);
            EXPECT_STREQ(map->segments[n].name, segments[n].name);
            EXPECT_STREQ(map->segments[n].identifier, segments[n].identifier);
            EXPECT_STREQ(map->segments[n].terminology, segments[n].terminology);
        }
        EXPECT_EQ(map->segments[0].color[2], 1.0f);
        EXPECT_EQ(map->segments[0].color[0], 0.25f);
        EXPECT_LT(map->segments[1].color[0], 0.0f);
        EXPECT_NEAR(map->geometry.spacing[2], 0.002, 1e-12);
    }
}

/* One layer: labels keep their values. Files of Slicer 4.10 have a layer for every segment and neither value nor
 * layer. */
TEST(SegNrrd, ValuesAndOldFiles)
{
    temporary_folder folder;
    seg_nrrd_file file;
    file.segments = {{"a", "", "5", "", "", ""}, {"b", "", "3", "", "", ""}};
    file.set(4, 0, 5);
    file.set(5, 0, 3);
    save(folder / "a.seg.nrrd", file.bytes());
    labels_holder map;
    ASSERT_EQ(pliant_labels_read((folder / "a.seg.nrrd").c_str(), 0, &map), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(map->voxels[4], 5);
    EXPECT_EQ(map->voxels[5], 3);
    EXPECT_EQ(map->segments[1].label, 3);

    seg_nrrd_file old;
    old.layers = 2;
    old.segments = {{"a", "", "", "", "", ""}, {"b", "", "", "", "", ""}};
    old.set(4, 0, 1);
    old.set(5, 1, 1);
    save(folder / "b.seg.nrrd", old.bytes());
    labels_holder two;
    log_catcher log;
    ASSERT_EQ(pliant_labels_read((folder / "b.seg.nrrd").c_str(), 0, &two), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(two->voxels[4], 1);
    EXPECT_EQ(two->voxels[5], 2);
    expect_words(log.warnings(), {});
}

TEST(SegNrrd, ResampledMapsKeepTheirSegments)
{
    temporary_folder folder;
    save(folder / "a.seg.nrrd", three_layers().bytes());
    labels_holder map, small;
    ASSERT_EQ(pliant_labels_read((folder / "a.seg.nrrd").c_str(), 0, &map), PLIANT_OK) << pliant_last_error();
    const int32_t size[3] = {2, 2, 2};
    ASSERT_EQ(pliant_labels_resample(&map.labels, size, &small), PLIANT_OK);
    ASSERT_EQ(small->num_segments, 4u);
    EXPECT_STREQ(small->segments[1].name, "left kidney");
    pliant_geometry grid = map->geometry;
    grid.size[0] = 5;
    ASSERT_EQ(pliant_labels_to_grid(&map, &grid), PLIANT_OK);
    EXPECT_EQ(map->num_segments, 4u);
    EXPECT_EQ(map->voxels[1], 2);
}

TEST(SegNrrdErrors, NamesTheFieldAndTheRemedy)
{
    temporary_folder folder;
    const std::string path = folder / "a.seg.nrrd";
    const seg_nrrd_file good = three_layers();
    auto with = [&](auto change) {
        seg_nrrd_file file = good;
        change(&file);
        return file.bytes();
    };
    expect_no_labels(path, with([](seg_nrrd_file *f) { f->segments[1].layer = "3"; }),
                     {path, "Segment1_Layer: 3", "from 0 to 2"});
    expect_no_labels(path, with([](seg_nrrd_file *f) { f->segments[1].value = "x"; }),
                     {path, "Segment1_LabelValue: x", "from 1 to 65535"});
    expect_no_labels(path, with([](seg_nrrd_file *f) { f->segments[1].value = "70000"; }),
                     {path, "Segment1_LabelValue: 70000"});
    expect_no_labels(path, with([](seg_nrrd_file *f) { f->segments[1].layer = "0"; }),
                     {path, "\"Liver\" and \"left kidney\"", "3D Slicer"});
    expect_no_labels(path, with([](seg_nrrd_file *f) { f->voxels.resize(71); }), {path, "truncated"});
    expect_no_labels(path, with([](seg_nrrd_file *f) { f->segments.clear(); }), {path, "4 dimensions"});
    expect_no_labels(path, with([](seg_nrrd_file *f) { f->type = "signed char", f->voxels[0] = 0xff; }),
                     {path, "voxel (0, 0, 0) is -1", "whole numbers"});
    save(path, good.bytes());
    expect_refused(path, PLIANT_ERROR_FORMAT, {path, "is a segmentation", "material/labels"}); /* as a scan */
}

/* --- DICOM SEG --- */

namespace {

dicom_seg_file two_segments()
{
    dicom_seg_file file;
    file.segments = {{1, "Liver", "Liver", {65535, 32896, 32896}}, {3, "lesion", "Mass", {}}};
    file.add_frame(3, 3, {1, 2});
    file.add_frame(1, 0, {0, 1, 14});
    file.add_frame(1, 3, {2, 3}); /* slices 1 and 2 are empty */
    return file;
}

void expect_two_segments(const std::string &path)
{
    SCOPED_TRACE(path);
    labels_holder map;
    log_catcher log;
    ASSERT_EQ(pliant_labels_read(path.c_str(), 0, &map), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(map->geometry.size[2], 4);
    EXPECT_NEAR(map->geometry.spacing[2], 0.002, 1e-12);
    EXPECT_NEAR(map->geometry.origin[2], 0.030, 1e-12);
    std::vector<uint16_t> wanted(60, 0);
    wanted[0] = wanted[1] = wanted[14] = 1;
    wanted[46] = wanted[47] = 3;
    wanted[48] = 1;
    EXPECT_EQ(std::vector<uint16_t>(map->voxels, map->voxels + 60), wanted);
    expect_words(log.warnings(), {"lesion over Liver in 1"});
    ASSERT_EQ(map->num_segments, 2u);
    EXPECT_STREQ(map->segments[0].name, "Liver");
    EXPECT_STREQ(map->segments[1].name, "lesion");
    EXPECT_STREQ(map->segments[1].terminology, "Mass");
    EXPECT_EQ(map->segments[1].label, 3);
    for (float color : map->segments[0].color) EXPECT_NEAR(color, 1.0f, 0.01f); /* white */
    EXPECT_LT(map->segments[1].color[0], 0.0f);
}

} // namespace

TEST(DicomSeg, FramesOfSegments)
{
    temporary_folder folder;
    for (bool marks : {false, true}) {
        dicom_seg_file file = two_segments();
        file.marks = marks;
        save(folder / "seg.dcm", file.bytes());
        expect_two_segments(folder / "seg.dcm");
    }
    dicom_seg_file packed = two_segments();
    packed.syntax = DEFLATED_SYNTAX;
    save(folder / "seg.dcm", with_deflated_data_set(packed.bytes()));
    expect_two_segments(folder / "seg.dcm");
    expect_two_segments(folder.path()); /* the only segmentation of a folder */
    dicom_seg_file between = two_segments();
    between.between.clear(); /* the thickness remains */
    save(folder / "seg.dcm", between.bytes());
    expect_two_segments(folder / "seg.dcm");
    save(folder / "more.dcm", between.bytes());
    labels_holder map;
    EXPECT_EQ(pliant_labels_read(folder.path().c_str(), 0, &map), PLIANT_ERROR_FORMAT);
    expect_words(pliant_last_error(), {"several DICOM segmentations", "more.dcm", "seg.dcm"});
}

/* Images of one bit, as highdicom stores them, encoded by OpenJPEG 2.5. */
TEST(DicomSeg, BitsAsJpeg2000)
{
    temporary_folder folder;
    dicom_seg_file file = two_segments();
    file.syntax = "1.2.840.10008.1.2.4.90";
    const std::string head =
        "ff4fff510029000000000005000000030000000000000000000000050000000300000000000000000001000101"
        "ff52000c00000001000004040001ff5c00044008ff90000a000000000";
    for (const char *tail : {"0130001ff93d180091162ffd9", "0140001ff93d2000be1a1bfffd9", "0130001ff93d18008e82fffd9"}) {
        file.images.push_back(from_hex(head + tail));
        if (file.images.back().size() % 2) file.images.back() += '\0';
    }
    save(folder / "seg.dcm", file.bytes());
    expect_two_segments(folder / "seg.dcm");
    file.images[1][60] = '\0';
    expect_no_labels(folder / "seg.dcm", file.bytes(), {"seg.dcm", "compressed pixels are damaged"});
}

TEST(DicomSeg, FractionsAndLabelMaps)
{
    temporary_folder folder;
    dicom_seg_file file = two_segments();
    file.kind = "FRACTIONAL";
    file.bits = 8;
    file.maximum = 100;
    for (dicom_seg_file::frame &frame : file.frames)
        for (uint16_t &value : frame.voxels) value = value ? 50 : 49;
    save(folder / "seg.dcm", file.bytes());
    expect_two_segments(folder / "seg.dcm");
    file.syntax = DEFLATED_SYNTAX;
    save(folder / "seg.dcm", with_deflated_data_set(file.bytes()));
    expect_two_segments(folder / "seg.dcm");

    for (uint16_t bits : {8, 16}) {
        dicom_seg_file map = two_segments();
        map.uid += "";
        map.uid.back() = '7';
        map.kind = "LABELMAP";
        map.bits = bits;
        map.frames.clear();
        map.add_frame(0, 0, {0, 1, 14});
        map.add_frame(0, 3, {1, 2}, 3);
        map.frames[1].voxels[3] = 1;
        save(folder / "map.dcm", map.bytes());
        labels_holder labels;
        ASSERT_EQ(pliant_labels_read((folder / "map.dcm").c_str(), 0, &labels), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(labels->voxels[14], 1);
        EXPECT_EQ(labels->voxels[47], 3);
        EXPECT_EQ(labels->voxels[48], 1);
        EXPECT_STREQ(labels->segments[1].name, "lesion");
    }
}

TEST(DicomSeg, OneSlice)
{
    temporary_folder folder;
    dicom_seg_file file = two_segments();
    file.frames.resize(1);
    file.between.clear();
    save(folder / "seg.dcm", file.bytes());
    labels_holder map;
    ASSERT_EQ(pliant_labels_read((folder / "seg.dcm").c_str(), 0, &map), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(map->geometry.size[2], 1);
    EXPECT_NEAR(map->geometry.spacing[2], 0.002, 1e-12);
    EXPECT_NEAR(map->geometry.origin[2], 0.036, 1e-12);
    EXPECT_EQ(map->voxels[1], 3);
    file.thickness = "0";
    expect_no_labels(folder / "seg.dcm", file.bytes(), {"seg.dcm", "one slice without SliceThickness"});
}

TEST(DicomSegErrors, NamesTheFieldAndTheRemedy)
{
    temporary_folder folder;
    const std::string path = folder / "seg.dcm";
    auto with = [&](auto change) {
        dicom_seg_file file = two_segments();
        change(&file);
        return file.bytes();
    };
    const std::string remedy = "export it as NIfTI or NRRD";
    expect_no_labels(path, with([](dicom_seg_file *f) { f->segments.clear(); }),
                     {path, "DICOM segmentation (SEG)", "SegmentSequence (0062,0002)", remedy});
    expect_no_labels(path, with([](dicom_seg_file *f) { f->has_groups = false; }),
                     {path, "DICOM segmentation (SEG)", "(5200,9230)", remedy});
    expect_no_labels(path, with([](dicom_seg_file *f) { f->segments[1].number = 1; }),
                     {path, "two segments have SegmentNumber", remedy});
    expect_no_labels(path, with([](dicom_seg_file *f) { f->frames[2].segment = 2; }),
                     {path, "frame 3: ReferencedSegmentNumber", "is 2", remedy});
    expect_no_labels(path, with([](dicom_seg_file *f) { f->frames[2].position = "10\\20\\30.9"; }),
                     {path, "not evenly spaced", remedy});
    expect_no_labels(path, with([](dicom_seg_file *f) { f->frames[2].position = "11\\20\\36"; }),
                     {path, "lies 1 mm from the grid", remedy});
    expect_no_labels(path, with([](dicom_seg_file *f) { f->kind = "FRACTIONAL"; }),
                     {path, "\"FRACTIONAL\" with 1 bits", remedy});
    expect_no_labels(path, with([](dicom_seg_file *f) { f->rows = 300; }), {path, "truncated"});
    save(path, two_segments().bytes());
    expect_refused(path, PLIANT_ERROR_FORMAT, {path, "DICOM segmentation (SEG)", "material/labels"}); /* as a scan */
    for (const auto &one : std::map<std::string, const char *>{{"1.2.840.10008.1.2.5", "compressed pixels of 1 bit"},
                                                               {"1.2.840.10008.1.2.8.1", "frames that are deflated"}}) {
        const std::string bytes = with([&](dicom_seg_file *f) {
            f->syntax = one.first, f->images = {"ab", "ab", "ab"};
        });
        expect_no_labels(path, bytes, {path, one.second, "gdcmconv --raw", "pydicom"});
    }

    dicom_file contours;
    contours.object = "1.2.840.10008.5.1.4.1.1.481.3";
    contours.rows = contours.columns = 0;
    contours.pixels.clear();
    save(path, contours.bytes());
    labels_holder map;
    EXPECT_EQ(pliant_labels_read(path.c_str(), 0, &map), PLIANT_ERROR_FORMAT);
    expect_words(pliant_last_error(), {path, "RTSTRUCT", "3D Slicer", "plastimatch convert --input"});
}

/* --- masks, one per file --- */

TEST(Masks, OfAFolderAreSegments)
{
    temporary_folder folder;
    auto mask = [&](const std::string &name, std::initializer_list<size_t> set, int16_t value) {
        nifti_file file;
        std::vector<int16_t> values(24, 0);
        for (size_t n : set) values[n] = value;
        file.data = bytes_of(values);
        save(folder / name, file.bytes());
    };
    mask("liver.nii", {1, 2, 3}, 1);
    mask("spleen.nii", {3, 4}, 255);
    mask("stomach.nii", {}, 1);
    save(folder / "statistics.json", "{}");
    {
        labels_holder map;
        log_catcher log;
        ASSERT_EQ(pliant_labels_read(folder.path().c_str(), 0, &map), PLIANT_OK) << pliant_last_error();
        std::vector<uint16_t> wanted(24, 0);
        wanted[1] = wanted[2] = 1;
        wanted[3] = wanted[4] = 2;
        EXPECT_EQ(std::vector<uint16_t>(map->voxels, map->voxels + 24), wanted);
        ASSERT_EQ(map->num_segments, 3u);
        EXPECT_STREQ(map->segments[0].name, "liver");
        EXPECT_STREQ(map->segments[2].name, "stomach");
        expect_words(log.warnings(), {"spleen over liver in 1"});
        for (int call = 0;; call++) { /* each allocation fails once */
            ASSERT_LT(call, 20);
            const size_t in_use = pliant_memory_in_use();
            labels_holder other;
            pliant_memory_fail_after(call);
            const pliant_status status = pliant_labels_read(folder.path().c_str(), 0, &other);
            pliant_memory_fail_after(-1);
            if (status == PLIANT_OK) break;
            EXPECT_EQ(status, PLIANT_ERROR_MEMORY);
            EXPECT_EQ(pliant_memory_in_use(), in_use);
        }
    }
    auto expect_no_map = [&](const std::vector<std::string> &words) {
        labels_holder map;
        const size_t in_use = pliant_memory_in_use();
        EXPECT_EQ(pliant_labels_read(folder.path().c_str(), 0, &map), PLIANT_ERROR_FORMAT);
        EXPECT_EQ(pliant_memory_in_use(), in_use);
        expect_words(pliant_last_error(), words);
    };
    nifti_file labels, other;
    std::vector<int16_t> values(24, 1);
    values[7] = 2;
    labels.data = bytes_of(values);
    save(folder / "labels.nii", labels.bytes());
    expect_no_map({"labels.nii", "it holds 1 and 2", "name this file"});
    unlink((folder / "labels.nii").c_str());
    other.srow[3] = 5;
    save(folder / "zygoma.nii", other.bytes());
    expect_no_map({"zygoma.nii", "another grid than", "liver.nii"});
    unlink((folder / "zygoma.nii").c_str());
    save(folder / "a.seg.nrrd", three_layers().bytes());
    expect_no_map({"a.seg.nrrd", "no mask of one segment", "name this file"});
}

/* Damaged files are read or refused, but they neither crash nor leak memory: every truncation, and 300 files with a few
 * wrong bytes. */
TEST(SegmentationErrors, TruncationsAndMutants)
{
    temporary_folder folder;
    seg_nrrd_file packed = three_layers();
    packed.compressed = true;
    dicom_seg_file marked = two_segments(), deflated = two_segments();
    marked.marks = true;
    deflated.syntax = DEFLATED_SYNTAX;
    const struct {
        const char *name;
        std::string bytes;
    } files[] = {{"a.seg.nrrd", three_layers().bytes()},
                 {"b.seg.nrrd", packed.bytes()},
                 {"c.dcm", two_segments().bytes()},
                 {"d.dcm", marked.bytes()},
                 {"e.dcm", with_deflated_data_set(deflated.bytes())}};
    std::mt19937 random(7);
    const size_t in_use = pliant_memory_in_use();
    size_t refused = 0;
    for (const auto &one : files) {
        auto try_it = [&](const std::string &bytes) {
            save(folder / one.name, bytes);
            labels_holder map;
            const pliant_status status = pliant_labels_read((folder / one.name).c_str(), 1 << 20, &map);
            EXPECT_TRUE(status == PLIANT_OK || status == PLIANT_ERROR_FORMAT || status == PLIANT_ERROR_MEMORY ||
                        status == PLIANT_ERROR_FILE)
                << pliant_last_error();
            if (status != PLIANT_OK) {
                EXPECT_NE(std::string(pliant_last_error()).find(one.name), std::string::npos) << pliant_last_error();
                refused++;
            }
            return status;
        };
        for (size_t length = 0; length < one.bytes.size(); length += 1 + length / 64)
            EXPECT_NE(try_it(one.bytes.substr(0, length)), PLIANT_OK) << length;
        for (int mutant = 0; mutant < 300; mutant++) {
            std::string bytes = one.bytes;
            for (int n = 0; n < 1 + mutant % 5; n++) bytes[random() % bytes.size()] = char(random());
            try_it(bytes);
        }
    }
    EXPECT_GT(refused, 600u);
    EXPECT_EQ(pliant_memory_in_use(), in_use);
}

TEST(SegmentationsMemory, EveryAllocationMayFail)
{
    temporary_folder folder;
    save(folder / "a.seg.nrrd", three_layers().bytes());
    save(folder / "c.dcm", two_segments().bytes());
    for (const char *name : {"a.seg.nrrd", "c.dcm"})
        for (int call = 0;; call++) {
            ASSERT_LT(call, 20);
            const size_t in_use = pliant_memory_in_use();
            labels_holder map;
            pliant_memory_fail_after(call);
            const pliant_status status = pliant_labels_read((folder / name).c_str(), 0, &map);
            pliant_memory_fail_after(-1);
            if (status == PLIANT_OK) break;
            EXPECT_EQ(status, PLIANT_ERROR_MEMORY);
            EXPECT_EQ(pliant_memory_in_use(), in_use);
        }
}
