/* Unusual descriptions of grids in NIfTI, NRRD and MetaImage headers, and the values of label maps. */
#include "scan_files.h"

#include <cmath>
#include <limits>
#include <random>

namespace
{

std::string nrrd(const std::string &more, const std::string &data = std::string(48, '\1'))
{ return "NRRD0004\ntype: short\ndimension: 3\nsizes: 4 3 2\nendian: little\nencoding: raw\n" + more + "\n" + data; }

std::string metaimage(const std::string &more, const std::string &type, const std::string &data,
                      const std::string &where = "LOCAL")
{
    return "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n" + more +
           "DimSize = 4 3 2\nElementType = " + type + "\nElementDataFile = " + where + "\n" + data;
}

std::string labels_of(const std::string &path, std::vector<uint16_t> *out)
{
    pliant_labels labels = {};
    if (pliant_labels_read(path.c_str(), 0, &labels) != PLIANT_OK) return pliant_last_error();
    out->assign(labels.voxels, labels.voxels + pliant_geometry_voxels(&labels.geometry));
    pliant_labels_free(&labels);
    return "";
}

} // namespace

/* A valid sform has the spacing of the grid. The sign of pixdim has no meaning, and pixdim may be no length. */
TEST(NiftiGrid, TakesTheSpacingOfAGoodSform)
{
    temporary_folder folder;
    const float infinite = std::numeric_limits<float>::infinity();
    for (float pixdim : {2.5f, -2.5f, 0.0f, std::nanf(""), infinite}) {
        nifti_file file;
        file.pixdim = {1, 2, pixdim, 3, 1, 1, 1, 1};
        file.srow = {-2, 0, 0, 23, 0, -2.5f, 0, 24, 0, 0, 3, -12};
        save(folder / "scan.nii", file.bytes());
        volume_holder scan;
        log_catcher log;
        ASSERT_EQ(pliant_volume_read((folder / "scan.nii").c_str(), nullptr, 0, &scan), PLIANT_OK)
            << pliant_last_error();
        const double spacing[3] = {0.002, 0.0025, 0.003}, origin[3] = {-0.023, -0.024, -0.012};
        for (int d = 0; d < 3; d++) {
            EXPECT_NEAR(scan->geometry.spacing[d], spacing[d], 1e-12);
            EXPECT_NEAR(scan->geometry.origin[d], origin[d], 1e-12);
            EXPECT_EQ(scan->geometry.direction[4 * d], 1);
        }
        if (pixdim == 2.5f)
            expect_words(log.warnings(), {});
        else
            expect_words(log.warnings(), {"scan.nii", "pixdim[2]", "2.5 mm of the sform"});

        file.sform_code = 0;
        for (int16_t qform_code : {0, 1}) {
            file.qform_code = qform_code;
            save(folder / "other.nii", file.bytes());
            if (pixdim == 2.5f) continue;
            expect_refused(folder / "other.nii", PLIANT_ERROR_FORMAT, {"other.nii", "pixdim[2]", "above 0"});
        }
    }
    nifti_file file;
    file.pixdim = {1, 2, -4, 3, 1, 1, 1, 1};
    file.srow = {2, 0, 0, 0, 0, 2.5f, 0, 0, 0, 0, 3, 0};
    save(folder / "scan.nii", file.bytes());
    expect_refused(folder / "scan.nii", PLIANT_ERROR_FORMAT,
                   {"contradicts itself", "-4 mm in pixdim[2]", "2.5 mm in the sform"});
}

TEST(NrrdGrid, AxisMinsPlaceTheFirstVoxel)
{
    const struct {
        const char *more;
        double origin[3], spacing[3], flip[3];
    } cases[] = {{"spacings: 2 2.5 3\naxis mins: -40 -44 -36\ncenters: cell cell cell\n",
                  {-39, -42.75, -34.5},
                  {2, 2.5, 3},
                  {1, 1, 1}},
                 {"spacings: 2 2.5 3\naxis mins: -40 -44 -36\n", {-39, -42.75, -34.5}, {2, 2.5, 3}, {1, 1, 1}},
                 {"spacings: 2 2.5 3\naxis mins: -40 -44 -36\ncenters: node node node\n",
                  {-40, -44, -36},
                  {2, 2.5, 3},
                  {1, 1, 1}},
                 {"spacings: 2 2.5 3\naxis mins: -40 -44 -36\ncenterings: node cell ???\n",
                  {-40, -42.75, -34.5},
                  {2, 2.5, 3},
                  {1, 1, 1}},
                 {"spacings: -2 2.5 3\naxis mins: -40 -44 -36\n", {-41, -42.75, -34.5}, {2, 2.5, 3}, {-1, 1, 1}},
                 {"spacings: -2 2.5 -3\naxis mins: -40 -44 -36\ncenters: node node node\n",
                  {-40, -44, -36},
                  {2, 2.5, 3},
                  {-1, 1, -1}},
                 {"axis mins: -40 -44 -36\naxis maxs: -32 -38 -34\n", {-39, -43, -35.5}, {2, 2, 1}, {1, 1, 1}},
                 {"axis mins: -40 -44 -36\naxis maxs: -34 -40 -35\ncenters: node node node\n",
                  {-40, -44, -36},
                  {2, 2, 1},
                  {1, 1, 1}},
                 {"axis mins: -32 -44 -36\naxis maxs: -40 -38 -34\n", {-33, -43, -35.5}, {2, 2, 1}, {-1, 1, 1}},
                 {"spacings: 2 2.5 3\naxis mins: -40 nan -36\n", {-39, 0, -34.5}, {2, 2.5, 3}, {1, 1, 1}},
                 {"spacings: 2 2.5 3\n", {0, 0, 0}, {2, 2.5, 3}, {1, 1, 1}}};
    temporary_folder folder;
    for (const auto &one : cases) {
        SCOPED_TRACE(one.more);
        save(folder / "scan.nrrd", nrrd(one.more));
        volume_holder scan;
        log_catcher log;
        ASSERT_EQ(pliant_volume_read((folder / "scan.nrrd").c_str(), nullptr, 0, &scan), PLIANT_OK)
            << pliant_last_error();
        for (int d = 0; d < 3; d++) {
            EXPECT_NEAR(scan->geometry.origin[d], 1e-3 * one.origin[d], 1e-12);
            EXPECT_NEAR(scan->geometry.spacing[d], 1e-3 * one.spacing[d], 1e-12);
            EXPECT_EQ(scan->geometry.direction[4 * d], one.flip[d]);
        }
        if (std::strstr(one.more, "spacings")) expect_words(log.warnings(), {});
        else expect_words(log.warnings(), {"scan.nrrd", "neither spacings", "axis maxs"});
    }
    save(folder / "scan.nrrd", nrrd("spacings: 2 0 3\naxis mins: 0 0 0\n"));
    expect_refused(folder / "scan.nrrd", PLIANT_ERROR_FORMAT, {"spacing"});
    save(folder / "scan.nrrd", nrrd("spacings: 2 1 3\naxis mins: 0 0\n"));
    expect_refused(folder / "scan.nrrd", PLIANT_ERROR_FORMAT, {"axismins", "3 numbers"});
}

/* The unit applies to all lengths: spacing and offset. */
TEST(MetaImageGrid, DistanceUnitsHoldForTheOffsetToo)
{
    temporary_folder folder;
    const struct {
        const char *unit;
        double millimetres;
    } units[] = {{"um", 1e-3}, {"mm", 1}, {"cm", 10}, {"m", 1e3}, {"", 1}};
    for (const auto &one : units)
        for (const char *name : {"Offset", "Position", "Origin"}) {
            const std::string unit = *one.unit ? std::string("DistanceUnits = ") + one.unit + "\n" : "";
            save(folder / "scan.mha",
                 metaimage(unit + name + " = 10 -20 40\nElementSpacing = 1 2 3\n", "MET_SHORT", std::string(48, '\1')));
            volume_holder scan;
            ASSERT_EQ(pliant_volume_read((folder / "scan.mha").c_str(), nullptr, 0, &scan), PLIANT_OK)
                << pliant_last_error();
            const double origin[3] = {10, -20, 40}, spacing[3] = {1, 2, 3};
            for (int d = 0; d < 3; d++) {
                EXPECT_DOUBLE_EQ(scan->geometry.origin[d], 1e-3 * one.millimetres * origin[d]) << one.unit << name;
                EXPECT_DOUBLE_EQ(scan->geometry.spacing[d], 1e-3 * one.millimetres * spacing[d]) << one.unit;
            }
        }
}

TEST(FilesOfManyParts, AreRefusedWithARemedy)
{
    temporary_folder folder;
    const std::string spacing = "ElementSpacing = 1 2 3\n", data(48, '\1');
    for (const char *list : {"LIST", "LIST 2", "slice%03d.raw 1 2 1"}) {
        save(folder / "list.mhd", metaimage(spacing, "MET_SHORT", "a.raw\nb.raw\n", list));
        expect_refused(folder / "list.mhd", PLIANT_ERROR_FORMAT, {"list.mhd", list, "list of files", "one .mha file"});
        save(folder / "list.nhdr", nrrd(std::string("spacings: 1 2 3\ndata file: ") + list + "\na.raw\nb.raw\n", ""));
        expect_refused(folder / "list.nhdr", PLIANT_ERROR_FORMAT,
                       {"list.nhdr", list, "list of files", "one .nrrd file"});
    }
    std::string text = nrrd("spacings: 1 2 3\n");
    save(folder / "text.nrrd", text.replace(text.find("raw"), 3, "ascii"));
    expect_refused(folder / "text.nrrd", PLIANT_ERROR_FORMAT, {"encoding: ascii", "raw and gzip are", "unu save"});
}

/* Labels that were stored with a slope are whole numbers, up to rounding. */
TEST(LabelNumbers, WithinAThousandthOfAWholeNumber)
{
    temporary_folder folder;
    std::vector<float> reals = {0, 1, 2, 3, 1.0000113f, 0.99998f, 2.0009f, -0.0001f, 65535.0f, 3, 3, 3,
                                3, 3, 3, 3, 3,          3,        3,       3,        3,        3, 3, 3};
    std::vector<uint16_t> labels, wanted = {0, 1, 2, 3, 1, 1, 2, 0, 65535, 3};
    save(folder / "labels.mha", metaimage("ElementSpacing = 1 1 1\n", "MET_FLOAT", bytes_of(reals)));
    ASSERT_EQ(labels_of(folder / "labels.mha", &labels), "");
    for (size_t n = 0; n < wanted.size(); n++) EXPECT_EQ(labels[n], wanted[n]) << n;

    nifti_file file; /* as nibabel scales labels 0 to 3 into 16 bits */
    file.slope = 4.5777764e-05f;
    file.intercept = 1.5f;
    std::vector<int16_t> stored(24, -32767);
    for (size_t n = 0; n < 4; n++) stored[n] = int16_t(std::lround((double(n) - 1.5) / file.slope));
    file.data = bytes_of(stored);
    save(folder / "labels.nii", file.bytes());
    ASSERT_EQ(labels_of(folder / "labels.nii", &labels), "");
    for (size_t n = 0; n < 4; n++) EXPECT_EQ(labels[n], n);

    for (float wrong : {2.5f, 1.002f, 0.25f}) {
        reals[6] = wrong;
        save(folder / "labels.mha", metaimage("ElementSpacing = 1 1 1\n", "MET_FLOAT", bytes_of(reals)));
        char value[40];
        std::snprintf(value, sizeof value, "voxel (2, 1, 0) is %.9g, not a whole number", double(wrong));
        expect_words(labels_of(folder / "labels.mha", &labels), {"labels.mha", value, "nearest neighbour"});
    }
}

TEST(LabelNumbers, AnEmptyMapIsWarnedOf)
{
    temporary_folder folder;
    std::vector<uint16_t> values(24, 0), labels;
    for (uint16_t one : {0, 1}) {
        values[7] = one;
        save(folder / "labels.mha", metaimage("ElementSpacing = 1 1 1\n", "MET_USHORT", bytes_of(values)));
        log_catcher log;
        EXPECT_EQ(labels_of(folder / "labels.mha", &labels), "");
        if (one)
            expect_words(log.warnings(), {});
        else
            expect_words(log.warnings(), {"labels.mha", "empty label map", "24 voxels"});
    }
}

/* TotalSegmentator names its labels in an extension of the header. */
TEST(LabelNumbers, NamesOfClassesInNifti)
{
    temporary_folder folder;
    nifti_file file;
    std::vector<int16_t> values(24, 0);
    values[3] = 5;
    file.data = bytes_of(values);
    std::string bytes = file.bytes();
    const std::string table =
        "<?xml version=\"1.0\"?> <CaretExtension><LabelTable>\n<Label Key=\"0\"><![CDATA[???]]></Label>\n"
        "<Label Key=\"5\" Red=\"1.0\" Alpha=\"1\"><![CDATA[liver]]></Label>\n"
        "<Label Red=\"0\" Key=\"6\"> stomach </Label><Label Key=\"5\">again</Label><Label Key=\"70000\">far</Label>";
    std::string extension = bytes_of(std::vector<int32_t>{int32_t(table.size() + 8), 0}) + table;
    extension.resize((extension.size() + 15) / 16 * 16, ' ');
    bytes.insert(352, extension);
    nifti_file::put(&bytes, 108, std::vector<float>{float(352 + extension.size())});
    bytes[348] = 1;
    for (size_t cut : {size_t(0), size_t(1)}) { /* the second label has no end */
        std::string shown = bytes;
        if (cut) shown[shown.find("</Label><Label Key=\"5\"")] = '[';
        save(folder / "labels.nii", shown);
        pliant_labels labels = {};
        ASSERT_EQ(pliant_labels_read((folder / "labels.nii").c_str(), 0, &labels), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(labels.voxels[3], 5);
        ASSERT_EQ(labels.num_segments, 2u);
        EXPECT_EQ(labels.segments[0].value, 5);
        EXPECT_EQ(labels.segments[0].is_class, 1u);
        EXPECT_STREQ(labels.segments[0].name, "liver");
        if (!cut) EXPECT_STREQ(labels.segments[1].name, "stomach");
        pliant_labels_free(&labels);
        volume_holder scan; /* a scan may also have such an extension */
        EXPECT_EQ(pliant_volume_read((folder / "labels.nii").c_str(), nullptr, 0, &scan), PLIANT_OK)
            << pliant_last_error();
    }
    std::mt19937 random(3);
    const size_t in_use = pliant_memory_in_use();
    for (int mutant = 0; mutant < 300; mutant++) { /* damaged names are read or refused, and no memory leaks */
        std::string broken = bytes;
        for (int n = 0; n < 1 + mutant % 5; n++) broken[348 + random() % (broken.size() - 348)] = char(random());
        save(folder / "labels.nii", broken);
        pliant_labels labels = {};
        const pliant_status status = pliant_labels_read((folder / "labels.nii").c_str(), 1 << 20, &labels);
        EXPECT_TRUE(status == PLIANT_OK || status == PLIANT_ERROR_FORMAT) << pliant_last_error();
        pliant_labels_free(&labels);
    }
    EXPECT_EQ(pliant_memory_in_use(), in_use);
}
