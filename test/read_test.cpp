/* Synthetic NIfTI, MetaImage and NRRD files. Files of other programs: read_data_test.cpp. DICOM:
 * read_dicom_test.cpp. */
#include "scan/volume.h"
#include "scan_files.h"

#include <cmath>
#include <limits>

namespace {

const float NOT_A_NUMBER = std::numeric_limits<float>::quiet_NaN();

std::vector<int16_t> counting(size_t count, int first)
{
    std::vector<int16_t> values(count);
    for (size_t n = 0; n < count; n++) values[n] = int16_t(first + int(n));
    return values;
}

std::string metaimage(const std::string &more = "", const std::string &size = "4 3 2",
                      const std::string &type = "MET_SHORT", const std::string &spacing = "1 2 3",
                      const std::string &data = std::string(48, '\1'))
{
    return "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n" + more +
           "ElementSpacing = " + spacing + "\nDimSize = " + size + "\nElementType = " + type +
           "\nElementDataFile = LOCAL\n" + data;
}

std::string nrrd(const std::string &sizes = "4 3 2", const std::string &directions = "(1,0,0) (0,2,0) (0,0,3)",
                 const std::string &more = "", const std::string &type = "short",
                 const std::string &data = std::string(48, '\1'))
{
    return "NRRD0004\ntype: " + type + "\ndimension: 3\nspace: left-posterior-superior\nsizes: " + sizes +
           "\nspace directions: " + directions +
           "\nkinds: domain domain domain\nendian: little\nencoding: raw\nspace origin: (-5,6,7)\n" + more + "\n" +
           data;
}

} // namespace

/* --- files that must be read --- */

TEST(Modality, IsWhatTheHeaderTells)
{
    temporary_folder folder;
    const struct { const char *descrip; pliant_modality modality;
    } niftis[] = {{"", PLIANT_MODALITY_UNKNOWN},
                  {"FSL5.0", PLIANT_MODALITY_UNKNOWN},
                  {"TE=30;Time=121230.000;phase=1", PLIANT_MODALITY_MR},
                  {"TE=0;Time=121230.000", PLIANT_MODALITY_UNKNOWN},
                  {"3T 3D GR TR=2300ms/TE=2.98ms/FA=9deg", PLIANT_MODALITY_MR},
                  {"TE=", PLIANT_MODALITY_UNKNOWN}};
    for (const auto &one : niftis) {
        nifti_file file;
        file.descrip = one.descrip;
        save(folder / "scan.nii", file.bytes());
        volume_holder scan;
        ASSERT_EQ(pliant_volume_read((folder / "scan.nii").c_str(), nullptr, 0, &scan), PLIANT_OK)
            << pliant_last_error();
        EXPECT_EQ(scan->modality, one.modality) << one.descrip;
    }
    const struct { const char *name; std::string bytes; pliant_modality modality;
    } texts[] = {{"a.mha", metaimage("Modality = MET_MOD_MR\n"), PLIANT_MODALITY_MR},
                 {"b.mha", metaimage("Modality = MET_MOD_CT\n"), PLIANT_MODALITY_CT},
                 {"c.mha", metaimage("Modality = MET_MOD_OTHER\n"), PLIANT_MODALITY_UNKNOWN},
                 {"d.mha", metaimage("Modality = MET_MOD_US\n"), PLIANT_MODALITY_OTHER},
                 {"e.mha", metaimage(), PLIANT_MODALITY_UNKNOWN},
                 {"a.nrrd", nrrd(), PLIANT_MODALITY_UNKNOWN},
                 {"b.nrrd", nrrd("4 3 2", "(1,0,0) (0,2,0) (0,0,3)", "modality:=DWMRI\n"), PLIANT_MODALITY_MR},
                 {"c.nrrd", nrrd("4 3 2", "(1,0,0) (0,2,0) (0,0,3)", "DICOM_0008_0060:=CT\n"), PLIANT_MODALITY_CT}};
    for (const auto &one : texts) {
        save(folder / one.name, one.bytes);
        volume_holder scan, smaller;
        ASSERT_EQ(pliant_volume_read((folder / one.name).c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(scan->modality, one.modality) << one.name;
        const int32_t size[3] = {2, 2, 2};
        ASSERT_EQ(pliant_volume_resample(&scan.volume, size, &smaller), PLIANT_OK);
        EXPECT_EQ(smaller->modality, one.modality) << one.name;
    }
}

TEST(Nifti, ConvertsRasMillimetresToLpsMetres)
{
    temporary_folder folder;
    nifti_file file;
    file.pixdim = {1, 0.5f, 0.75f, 2, 1, 1, 1, 1};
    file.srow = {0, 0.75f, 0, 10, -0.5f, 0, 0, 20, 0, 0, 2, 30};
    file.data = bytes_of(counting(24, -1024));
    save(folder / "scan.nii", file.bytes());
    volume_holder scan;
    ASSERT_EQ(pliant_volume_read((folder / "scan.nii").c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(scan->encoding, PLIANT_INT16);
    EXPECT_EQ(scan->slope, 1.0f);
    EXPECT_EQ(scan->background, -1024.0f);
    EXPECT_STREQ(scan->id, "scan.nii");
    const double direction[9] = {0, -1, 0, 1, 0, 0, 0, 0, 1}, origin[3] = {-0.010, -0.020, 0.030},
                 spacing[3] = {0.0005, 0.00075, 0.002};
    for (int d = 0; d < 9; d++) EXPECT_EQ(scan->geometry.direction[d], direction[d]) << d;
    for (int d = 0; d < 3; d++) EXPECT_NEAR(scan->geometry.origin[d], origin[d], 1e-12);
    for (int d = 0; d < 3; d++) EXPECT_NEAR(scan->geometry.spacing[d], spacing[d], 1e-12);
    EXPECT_EQ(scan.at(3, 2, 1), -1024 + 23);
}

TEST(Nifti, TakesEveryUnitOfLengthAlsoForTheOrigin)
{
    temporary_folder folder;
    struct { char code; float per_metre; } units[] = {{1, 1.0f}, {2, 1e3f}, {3, 1e6f}, {0, 1e3f}};
    for (auto unit : units) {
        nifti_file file;
        float s = unit.per_metre;
        file.units = unit.code;
        file.pixdim = {1, 0.001f * s, 0.002f * s, 0.003f * s, 1, 1, 1, 1};
        file.srow = {0.001f * s, 0, 0, 0.1f * s, 0, 0.002f * s, 0, 0.2f * s, 0, 0, 0.003f * s, 0.3f * s};
        save(folder / "scan.nii", file.bytes());
        volume_holder scan;
        ASSERT_EQ(pliant_volume_read((folder / "scan.nii").c_str(), nullptr, 0, &scan), PLIANT_OK)
            << pliant_last_error();
        EXPECT_NEAR(scan->geometry.spacing[2], 0.003, 1e-9);
        EXPECT_NEAR(scan->geometry.origin[0], -0.1, 1e-8);
        EXPECT_NEAR(scan->geometry.origin[2], 0.3, 1e-7);
    }
}

/* xyzt_units also holds the unit of time, in the bits above the unit of length. Sform and qform use the same unit. */
TEST(Nifti, UnitsOfTimeDoNotHideUnitsOfLength)
{
    temporary_folder folder;
    struct { char code; float per_metre; } units[] = {{1 | 8, 1.0f}, {2 | 8, 1e3f}, {3 | 16, 1e6f}, {24, 1e3f}};
    for (auto unit : units)
        for (bool qform : {false, true}) {
            nifti_file file;
            float s = unit.per_metre;
            file.units = unit.code;
            file.sform_code = !qform;
            file.qform_code = qform;
            file.pixdim = {1, 0.001f * s, 0.002f * s, 0.003f * s, 1, 1, 1, 1};
            file.quatern_and_offset = {0, 0, 0, 0.1f * s, 0.2f * s, 0.3f * s};
            file.srow = {0.001f * s, 0, 0, 0.1f * s, 0, 0.002f * s, 0, 0.2f * s, 0, 0, 0.003f * s, 0.3f * s};
            save(folder / "scan.nii", file.bytes());
            volume_holder scan;
            const pliant_status status = pliant_volume_read((folder / "scan.nii").c_str(), nullptr, 0, &scan);
            ASSERT_EQ(status, PLIANT_OK) << pliant_last_error();
            const double origin[3] = {-0.1, -0.2, 0.3};
            for (int d = 0; d < 3; d++) {
                EXPECT_NEAR(scan->geometry.spacing[d], 0.001 * (d + 1), 1e-9) << int(unit.code) << qform;
                EXPECT_NEAR(scan->geometry.origin[d], origin[d], 1e-7) << int(unit.code) << qform;
            }
        }
}

/* A gzip file is a series of members (RFC 1952 2.2). */
TEST(Nifti, GzipFilesMayHaveSeveralMembers)
{
    temporary_folder folder;
    auto member = [](const std::string &bytes) { /* stored, not compressed */
        uint32_t crc = 0xffffffffu;
        for (unsigned char c : bytes) {
            crc ^= c;
            for (int bit = 0; bit < 8; bit++) crc = crc >> 1 ^ (crc & 1 ? 0xedb88320u : 0);
        }
        const uint16_t length = uint16_t(bytes.size());
        const std::string block = std::string(1, '\1') + bytes_of(std::vector<uint16_t>{length, uint16_t(~length)});
        const std::string end = bytes_of(std::vector<uint32_t>{~crc, uint32_t(bytes.size())});
        return std::string("\x1f\x8b\x08\0\0\0\0\0\0\3", 10) + block + bytes + end;
    };
    nifti_file file;
    file.data = bytes_of(counting(24, 100));
    const std::string all = file.bytes();
    save(folder / "scan.nii.gz", member(all.substr(0, 100)) + member(all.substr(100, 270)) + member(all.substr(370)));
    volume_holder scan;
    const std::string path = folder / "scan.nii.gz";
    ASSERT_EQ(pliant_volume_read(path.c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    for (int n = 0; n < 24; n++) EXPECT_EQ(scan.at(n % 4, n / 4 % 3, n / 12), 100 + n);
    save(folder / "scan.nii.gz", member(all.substr(0, 370)));
    expect_refused(folder / "scan.nii.gz", PLIANT_ERROR_FORMAT, {"truncated"});
}

TEST(Nifti, QuaternionWithFlippedThirdAxis)
{
    temporary_folder folder;
    nifti_file file;
    file.sform_code = 0;
    file.qform_code = 1;
    const float angle = 0.6f; /* about z: b = c = 0 */
    file.quatern_and_offset = {0, 0, std::sin(angle / 2), 10, 20, 30};
    file.pixdim = {-1, 1, 2, 3, 1, 1, 1, 1};
    save(folder / "scan.nii", file.bytes());
    volume_holder scan;
    ASSERT_EQ(pliant_volume_read((folder / "scan.nii").c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    const double c = std::cos(0.6), s = std::sin(0.6), expected[9] = {-c, s, 0, -s, -c, 0, 0, 0, -1};
    for (int d = 0; d < 9; d++) EXPECT_NEAR(scan->geometry.direction[d], expected[d], 1e-6) << d;
    EXPECT_NEAR(scan->geometry.spacing[2], 0.003, 1e-9);
    EXPECT_NEAR(scan->geometry.origin[1], -0.020, 1e-9);
}

TEST(Nifti, ShearedSformFallsBackToTheQform)
{
    temporary_folder folder;
    nifti_file file;
    file.qform_code = 1;
    file.srow = {1, 0.2f, 0, 5, 0, 1, 0, 5, 0, 0, 1, 5};
    save(folder / "scan.nii", file.bytes());
    volume_holder scan;
    ASSERT_EQ(pliant_volume_read((folder / "scan.nii").c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(scan->geometry.direction[0], -1);
    EXPECT_EQ(scan->geometry.origin[0], 0);
    file.qform_code = 0;
    save(folder / "sheared.nii", file.bytes());
    expect_refused(folder / "sheared.nii", PLIANT_ERROR_FORMAT, {"sheared.nii", "orthonormal"});
}

TEST(Nifti, AnUnusableSformIsLogged)
{
    temporary_folder folder;
    static std::string logged;
    pliant_set_log(
        [](pliant_log_level level, const char *message, void *) {
            if (level == PLIANT_LOG_WARNING) logged = message;
        },
        nullptr);
    const struct { std::vector<float> srow; const char *word; } cases[] = {
        {{1, 0.2f, 0, 5, 0, 1, 0, 5, 0, 0, 1, 5}, "sheared"},
        {{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}, "singular"},
        {{1, 0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0}, "singular"},
        {{1, 0, 0, 0, 0, NOT_A_NUMBER, 0, 0, 0, 0, 1, 0}, "singular"},
        {{1, 0, 0, 0, 0, 1, 0, NOT_A_NUMBER, 0, 0, 1, 0}, "singular"},
        {{1, 0, 0, 5, 0, 1, 0, 5, 0, 0, 1, 5}, ""}};
    for (const auto &one : cases) {
        nifti_file file;
        file.qform_code = 1;
        file.srow = one.srow;
        save(folder / "scan.nii", file.bytes());
        volume_holder scan;
        logged.clear();
        ASSERT_EQ(pliant_volume_read((folder / "scan.nii").c_str(), nullptr, 0, &scan), PLIANT_OK)
            << pliant_last_error();
        EXPECT_EQ(scan->geometry.origin[0], *one.word ? 0 : -0.005) << "of the qform, or of the sform";
        EXPECT_EQ(logged.empty(), !*one.word) << logged;
        for (const char *word : {one.word, *one.word ? "qform is taken" : "", *one.word ? "scan.nii" : ""})
            EXPECT_NE(logged.find(word), std::string::npos) << logged;
        if (std::string(one.word) != "singular") continue;
        file.qform_code = 0;
        save(folder / "alone.nii", file.bytes());
        expect_refused(folder / "alone.nii", PLIANT_ERROR_FORMAT, {"alone.nii", "sform", "singular"});
    }
    pliant_set_log(nullptr, nullptr);
}

TEST(Nifti, FarFromTheOriginIsAValidSform)
{
    /* ITK 5 refuses this file: "No orthonormal definition found" */
    temporary_folder folder;
    nifti_file file;
    const float c = std::cos(0.1f), s = std::sin(0.1f);
    file.srow = {c, -s, 0, -755.33f, s, c, 0, 1203.7f, 0, 0, 1, -1755.1f};
    save(folder / "scan.nii", file.bytes());
    volume_holder scan;
    ASSERT_EQ(pliant_volume_read((folder / "scan.nii").c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    EXPECT_NEAR(scan->geometry.direction[0], -std::cos(0.1), 1e-7);
}

TEST(Nifti, RescalesAndChoosesTheSmallestExactEncoding)
{
    temporary_folder folder;
    struct { float slope, intercept; int first; pliant_encoding encoding; float background; } cases[] = {
        {1, 0, 0, PLIANT_UINT8, 0},        {1, 0, 232, PLIANT_UINT8, 232},   {1, 0, 233, PLIANT_INT16, 233},
        {1, 0, -1, PLIANT_INT16, -1},      {1, -1024, 0, PLIANT_INT16, -1024}, {2, -3000, 0, PLIANT_INT16, -1024},
        {0, 99, 7, PLIANT_UINT8, 7},       {NOT_A_NUMBER, 0, 7, PLIANT_UINT8, 7}, {0.5f, 0, 7, PLIANT_FLOAT32, 3.5f},
        {-1, 0, 1, PLIANT_INT16, -24},     {10000, 0, 1, PLIANT_FLOAT32, 10000}, {1, 0.5f, 0, PLIANT_FLOAT32, 0.5f}};
    for (const auto &one : cases) {
        SCOPED_TRACE(testing::Message() << one.slope << " " << one.intercept << " " << one.first);
        nifti_file file;
        file.slope = one.slope;
        file.intercept = one.intercept;
        file.data = bytes_of(counting(24, one.first));
        save(folder / "scan.nii", file.bytes());
        volume_holder scan;
        ASSERT_EQ(pliant_volume_read((folder / "scan.nii").c_str(), nullptr, 0, &scan), PLIANT_OK)
            << pliant_last_error();
        EXPECT_EQ(scan->encoding, one.encoding);
        EXPECT_EQ(scan->background, one.background);
        bool scales = one.slope != 0 && std::isfinite(one.slope);
        float slope = scales ? one.slope : 1, intercept = scales ? one.intercept : 0;
        for (size_t n = 0; n < 24; n++)
            EXPECT_EQ(pliant_volume_value(&scan.volume, n), slope * float(one.first + int(n)) + intercept);
        EXPECT_EQ(scan->slope, 1.0f);
        EXPECT_EQ(scan->intercept, 0.0f);
    }
}

TEST(Nifti, FourDimensionsWithOneTimePoint)
{
    temporary_folder folder;
    nifti_file file;
    file.dim = {4, 4, 3, 2, 1};
    save(folder / "one.nii", file.bytes());
    volume_holder scan;
    EXPECT_EQ(pliant_volume_read((folder / "one.nii").c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    file.dim = {4, 4, 3, 2, 2};
    file.data += file.data;
    save(folder / "two.nii", file.bytes());
    expect_refused(folder / "two.nii", PLIANT_ERROR_FORMAT, {"two.nii", "4 dimensions", "4 x 3 x 2 x 2"});
}

TEST(MetaImage, AxesAreTheRowsOfTheMatrix)
{
    temporary_folder folder;
    std::vector<int16_t> values = counting(24, -5);
    save(folder / "scan.mha", metaimage("TransformMatrix = 0 1 0 0 0 -1 -1 0 0\nOffset = 1 2 3\n", "4 3 2", "MET_SHORT",
                                        "0.5 1 2", bytes_of(values)));
    volume_holder scan;
    ASSERT_EQ(pliant_volume_read((folder / "scan.mha").c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    const double direction[9] = {0, 0, -1, 1, 0, 0, 0, -1, 0};
    for (int d = 0; d < 9; d++) EXPECT_EQ(scan->geometry.direction[d], direction[d]) << d;
    EXPECT_DOUBLE_EQ(scan->geometry.spacing[0], 0.0005);
    EXPECT_DOUBLE_EQ(scan->geometry.origin[2], 0.003);
    EXPECT_EQ(scan.at(1, 0, 0), -4);
    EXPECT_EQ(scan.at(0, 0, 1), 7);
}

TEST(TextHeaders, MayBeginWithAByteOrderMark)
{
    temporary_folder folder;
    const std::string mark = "\xEF\xBB\xBF";
    save(folder / "scan.mha", mark + "Offset = 1 2 3\n" + metaimage());
    save(folder / "scan.nrrd", mark + nrrd());
    volume_holder image, other;
    ASSERT_EQ(pliant_volume_read((folder / "scan.mha").c_str(), nullptr, 0, &image), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(image.at(3, 2, 1), 257) << "its data begin where they did";
    EXPECT_NEAR(image->geometry.origin[2], 0.003, 1e-12) << "the first line counts";
    ASSERT_EQ(pliant_volume_read((folder / "scan.nrrd").c_str(), nullptr, 0, &other), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(other.at(3, 2, 1), 257);
}

TEST(MetaImage, DataInAFileOfTheirOwnBigEndianBehindAHeader)
{
    temporary_folder folder;
    std::string data = "xyz";
    for (int n = 0; n < 24; n++) data += {char(1), char(n)};
    save(folder / "scan.raw", data);
    std::string header = metaimage("BinaryDataByteOrderMSB = True\nHeaderSize = 3\n");
    header = header.substr(0, header.find("LOCAL")) + "scan.raw\n";
    save(folder / "scan.mhd", header);
    volume_holder scan;
    ASSERT_EQ(pliant_volume_read((folder / "scan.mhd").c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(scan.at(3, 2, 1), 256 + 23);
    save(folder / "scan.raw", data.substr(0, 40));
    expect_refused(folder / "scan.mhd", PLIANT_ERROR_FORMAT, {"scan.raw", "truncated", "48 bytes"});
    unlink((folder / "scan.raw").c_str());
    expect_refused(folder / "scan.mhd", PLIANT_ERROR_FILE, {"scan.raw", "No such file"});
}

TEST(Nrrd, ObliqueRightHandedAndInMetres)
{
    temporary_folder folder;
    save(folder / "scan.nrrd",
         nrrd("4 3 2", "(0.003,0.004,0) (-0.004,0.003,0) (0,0,-0.002)", "space units: \"m\" \"m\" \"m\"\n"));
    volume_holder scan;
    ASSERT_EQ(pliant_volume_read((folder / "scan.nrrd").c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    const double direction[9] = {0.6, -0.8, 0, 0.8, 0.6, 0, 0, 0, -1};
    for (int d = 0; d < 9; d++) EXPECT_NEAR(scan->geometry.direction[d], direction[d], 1e-12) << d;
    EXPECT_NEAR(scan->geometry.spacing[0], 0.005, 1e-12);
    EXPECT_NEAR(scan->geometry.origin[0], -5, 1e-12);
    EXPECT_EQ(scan.at(0, 0, 0), 257);
}

TEST(Nrrd, DataFileWithLinesAndBytesInFront)
{
    temporary_folder folder;
    std::string header =
        nrrd("4 3 2", "(-1,0,0) (0,-1,0) (0,0,1)", "line skip: 2\nbyte skip: 3\ndata file: scan.raw\n", "short", "");
    header.replace(header.find("left-posterior"), 14, "right-anterior");
    save(folder / "scan.nhdr", header);
    save(folder / "scan.raw", "one\ntwo\nxyz" + bytes_of(counting(24, 300)));
    volume_holder scan;
    ASSERT_EQ(pliant_volume_read((folder / "scan.nhdr").c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(scan.at(0, 0, 0), 300);
    EXPECT_EQ(scan.at(3, 2, 1), 323);
    for (int d = 0; d < 9; d++) EXPECT_EQ(scan->geometry.direction[d], d % 4 == 0) << "two flips, and RAS to LPS";
    EXPECT_NEAR(scan->geometry.origin[0], 0.005, 1e-12);
    save(folder / "scan.raw", "one");
    expect_refused(folder / "scan.nhdr", PLIANT_ERROR_FORMAT, {"scan.raw", "line skip"});
    save(folder / "scan.raw", "one\ntwo\nxyz" + bytes_of(counting(23, 300)));
    expect_refused(folder / "scan.nhdr", PLIANT_ERROR_FORMAT, {"scan.raw", "truncated"});
}

TEST(Labels, WholeNumbersUpTo65535)
{
    temporary_folder folder;
    std::vector<uint16_t> values(24, 65535);
    values[3] = 7;
    save(folder / "labels.mha", metaimage("", "4 3 2", "MET_USHORT", "1 1 1", bytes_of(values)));
    pliant_labels labels = {};
    ASSERT_EQ(pliant_labels_read((folder / "labels.mha").c_str(), 0, &labels), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(std::memcmp(labels.voxels, values.data(), 48), 0);
    pliant_labels_free(&labels);

    std::vector<float> reals(24, 3.0f);
    save(folder / "reals.mha", metaimage("", "4 3 2", "MET_FLOAT", "1 1 1", bytes_of(reals)));
    ASSERT_EQ(pliant_labels_read((folder / "reals.mha").c_str(), 0, &labels), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(labels.voxels[23], 3);
    pliant_labels_free(&labels);
    reals[5] = 2.5f;
    save(folder / "half.mha", metaimage("", "4 3 2", "MET_FLOAT", "1 1 1", bytes_of(reals)));
    EXPECT_EQ(pliant_labels_read((folder / "half.mha").c_str(), 0, &labels), PLIANT_ERROR_FORMAT);
    EXPECT_NE(std::strstr(pliant_last_error(), "voxel (1, 1, 0) is 2.5, not a whole number"), nullptr)
        << pliant_last_error();
    save(folder / "negative.mha", metaimage("", "4 3 2", "MET_SHORT", "1 1 1", bytes_of(counting(24, -1))));
    EXPECT_EQ(pliant_labels_read((folder / "negative.mha").c_str(), 0, &labels), PLIANT_ERROR_FORMAT);
    EXPECT_EQ(labels.voxels, nullptr);
}

/* --- files that must be refused --- */

TEST(ReadErrors, MissingEmptyAndUnknown)
{
    temporary_folder folder;
    save(folder / "empty.nii", "");
    save(folder / "text.txt", "hello, I am no scan");
    save(folder / "text.nii.gz", "hello, I am no scan either, whatever my name says");
    save(folder / "short.hdr", std::string(100, '\0'));
    expect_refused("", PLIANT_ERROR_FILE, {"no scan"});
    expect_refused(folder / "nothing.nii", PLIANT_ERROR_FILE, {"nothing.nii", "No such file"});
    expect_refused(folder / "empty.nii", PLIANT_ERROR_FORMAT, {"empty.nii", "is empty"});
    expect_refused(folder / "text.txt", PLIANT_ERROR_FORMAT, {"text.txt", "not a scan"});
    expect_refused(folder / "text.nii.gz", PLIANT_ERROR_FORMAT, {"text.nii.gz", "not a NIfTI file"});
    expect_refused(folder / "short.hdr", PLIANT_ERROR_FORMAT, {"short.hdr", "truncated (100 bytes)"});
    pliant_volume volume;
    EXPECT_EQ(pliant_volume_read(nullptr, nullptr, 0, &volume), PLIANT_ERROR_ARGUMENT);
}

TEST(ReadErrors, EveryTruncation)
{
    temporary_folder folder;
    std::vector<int16_t> values = counting(24, 1000);
    nifti_file file;
    file.data = bytes_of(values);
    struct { const char *name; std::string bytes; } whole[] = {
        {"cut.nii", file.bytes()}, {"cut.mha", metaimage("", "4 3 2", "MET_SHORT", "1 2 3", file.data)},
        {"cut.nrrd", nrrd("4 3 2", "(1,0,0) (0,1,0) (0,0,1)", "", "short", file.data)}};
    for (const auto &one : whole) {
        volume_holder scan;
        save(folder / one.name, one.bytes);
        ASSERT_EQ(pliant_volume_read((folder / one.name).c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
        for (size_t length = 0; length < one.bytes.size(); length++) {
            save(folder / one.name, one.bytes.substr(0, length));
            /* a header truncated within "LOCAL" names another data file */
            bool other_file = length > one.bytes.find("LOCAL") && length < one.bytes.find("LOCAL") + 5;
            if (other_file) expect_refused(folder / one.name, PLIANT_ERROR_FILE, {"No such file"});
            else expect_refused(folder / one.name, PLIANT_ERROR_FORMAT, {one.name});
        }
    }
}

TEST(ReadErrors, EveryTruncationOfCompressedData)
{
    temporary_folder folder;
    pliant_geometry geometry = {{9, 8, 7}, {0, 0, 0}, {0.001, 0.001, 0.001}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    pliant_volume volume;
    ASSERT_EQ(pliant_volume_create(&geometry, PLIANT_INT16, &volume), PLIANT_OK);
    for (int n = 0; n < 504; n++) static_cast<int16_t *>(volume.voxels)[n] = int16_t(n * n);
    ASSERT_EQ(pliant_volume_write((folder / "cut.nii.gz").c_str(), &volume), PLIANT_OK) << pliant_last_error();
    std::string bytes = load(folder / "cut.nii.gz");
    for (size_t length = 1; length < bytes.size(); length++) {
        save(folder / "cut.nii.gz", bytes.substr(0, length));
        expect_refused(folder / "cut.nii.gz", PLIANT_ERROR_FORMAT, {"cut.nii.gz"});
    }
    /* The checksum detects one wrong byte in the data. */
    std::string damaged = bytes;
    damaged[bytes.size() / 2] = char(damaged[bytes.size() / 2] ^ 0x10);
    save(folder / "damaged.nii.gz", damaged);
    expect_refused(folder / "damaged.nii.gz", PLIANT_ERROR_FORMAT, {"damaged.nii.gz"});
    pliant_volume_free(&volume);
}

TEST(ReadErrors, HeadersLargerThanTheFile)
{
    temporary_folder folder;
    pliant_memory_reset_peak();
    size_t before = pliant_memory_peak();
    nifti_file file;
    file.dim = {3, 32767, 32767, 32767};
    save(folder / "huge.nii", file.bytes());
    expect_refused(folder / "huge.nii", PLIANT_ERROR_FORMAT, {"huge.nii", "truncated"});
    save(folder / "huge.mha", metaimage("", "60000 60000 60000"));
    expect_refused(folder / "huge.mha", PLIANT_ERROR_FORMAT, {"huge.mha", "432000000000000 bytes"});
    save(folder / "huge.nrrd", nrrd("60000 60000 60000"));
    expect_refused(folder / "huge.nrrd", PLIANT_ERROR_FORMAT, {"huge.nrrd"});
    save(folder / "wrap.mha", metaimage("", "2147483647 2147483647 2147483647"));
    expect_refused(folder / "wrap.mha", PLIANT_ERROR_FORMAT, {"wrap.mha"});
    save(folder / "beyond.mha", metaimage("", "4294967300 3 2"));
    expect_refused(folder / "beyond.mha", PLIANT_ERROR_FORMAT, {"beyond.mha", "at most"});
    EXPECT_EQ(pliant_memory_peak(), before);
}

TEST(ReadErrors, LargerThanTheMemory)
{
    temporary_folder folder;
    /* The sparse file has the length of its header. 60000 x 60000 x 60000 voxels would be too long. */
    std::string header = metaimage("", "60000 60000 30000", "MET_UCHAR", "1 1 1", "");
    save(folder / "sparse.mha", header);
    if (truncate((folder / "sparse.mha").c_str(), off_t(108000000000000 + header.size())) == 0)
        expect_refused(folder / "sparse.mha", PLIANT_ERROR_MEMORY,
                       {"sparse.mha", "60000 x 60000 x 30000", "the machine has free"});

    pliant_memory_reset_peak();
    size_t before = pliant_memory_peak();
    nifti_file file;
    file.dim = {3, 40, 30, 20};
    file.data = std::string(40 * 30 * 20 * 2, '\1');
    save(folder / "scan.nii", file.bytes());
    expect_refused(folder / "scan.nii", PLIANT_ERROR_MEMORY, {"scan.nii", "40 x 30 x 20", "the limit is"}, nullptr,
                   40000);
    EXPECT_EQ(pliant_memory_peak(), before);
    volume_holder scan;
    EXPECT_EQ(pliant_volume_read((folder / "scan.nii").c_str(), nullptr, 100000, &scan), PLIANT_OK)
        << pliant_last_error();
    EXPECT_LE(pliant_memory_peak() - before, 100000u);
}

TEST(ReadErrors, InvalidSizes)
{
    temporary_folder folder;
    const std::vector<std::vector<int16_t>> sizes = {{2, 4, 3},     {3, 4, 3, 1}, {3, 1, 3, 2}, {3, 4, 3, 0},
                                                     {3, -4, 3, 2}, {0},          {9, 1, 1, 1}};
    for (const std::vector<int16_t> &dim : sizes) {
        nifti_file file;
        file.dim = dim;
        save(folder / "scan.nii", file.bytes());
        expect_refused(folder / "scan.nii", PLIANT_ERROR_FORMAT, {"scan.nii"});
    }
    save(folder / "flat.mha", metaimage("", "4 3 1"));
    expect_refused(folder / "flat.mha", PLIANT_ERROR_FORMAT, {"flat.mha", "2-D", "4 x 3 x 1"});
    save(folder / "negative.mha", metaimage("", "-4 3 2"));
    expect_refused(folder / "negative.mha", PLIANT_ERROR_FORMAT, {"negative.mha", "at least 1"});
    save(folder / "half.mha", metaimage("", "4.5 3 2"));
    expect_refused(folder / "half.mha", PLIANT_ERROR_FORMAT, {"half.mha", "DimSize"});
    save(folder / "few.mha", metaimage("", "4 3"));
    expect_refused(folder / "few.mha", PLIANT_ERROR_FORMAT, {"few.mha", "DimSize = 4 3", "3 finite numbers"});
    save(folder / "flat.nrrd", nrrd("4 6 1"));
    expect_refused(folder / "flat.nrrd", PLIANT_ERROR_FORMAT, {"flat.nrrd", "2-D"});
}

TEST(ReadErrors, InvalidSpacing)
{
    temporary_folder folder;
    for (float spacing : {0.0f, -1.0f, NOT_A_NUMBER, std::numeric_limits<float>::infinity()}) {
        nifti_file file;
        file.pixdim[2] = spacing;
        file.sform_code = 0;
        save(folder / "scan.nii", file.bytes());
        expect_refused(folder / "scan.nii", PLIANT_ERROR_FORMAT, {"scan.nii", "spacing", "pixdim[2]"});
    }
    nifti_file file;
    file.srow[0] = 3;
    save(folder / "scan.nii", file.bytes());
    expect_refused(folder / "scan.nii", PLIANT_ERROR_FORMAT, {"scan.nii", "contradicts itself", "1 mm", "3 mm"});
    for (const char *spacing : {"1 0 1", "1 -2 1", "1 nan 1", "1 inf 1", "1 1", "a b c"}) {
        save(folder / "scan.mha", metaimage("", "4 3 2", "MET_SHORT", spacing));
        expect_refused(folder / "scan.mha", PLIANT_ERROR_FORMAT, {"scan.mha", "pacing"});
    }
    save(folder / "zero.nrrd", nrrd("4 3 2", "(1,0,0) (0,0,0) (0,0,1)"));
    expect_refused(folder / "zero.nrrd", PLIANT_ERROR_FORMAT, {"zero.nrrd"});
    save(folder / "parsec.nrrd", nrrd("4 3 2", "(1,0,0) (0,1,0) (0,0,1)", "space units: \"pc\" \"pc\" \"pc\"\n"));
    expect_refused(folder / "parsec.nrrd", PLIANT_ERROR_FORMAT, {"parsec.nrrd", "space units"});
}

TEST(ReadErrors, DirectionsThatAreNotOrthonormal)
{
    temporary_folder folder;
    for (const char *matrix : {"1 0.1 0 0 1 0 0 0 1", "2 0 0 0 1 0 0 0 1", "0 0 0 0 0 0 0 0 0", "1 0 0 1 0 0 0 0 1"}) {
        save(folder / "scan.mha", metaimage(std::string("TransformMatrix = ") + matrix + "\n"));
        expect_refused(folder / "scan.mha", PLIANT_ERROR_FORMAT, {"scan.mha", "not orthonormal"});
    }
    save(folder / "scan.nrrd", nrrd("4 3 2", "(1,0,0) (0.1,1,0) (0,0,1)"));
    expect_refused(folder / "scan.nrrd", PLIANT_ERROR_FORMAT, {"scan.nrrd", "not orthonormal"});

    /* rounding to four digits is repaired */
    save(folder / "rounded.mha", metaimage("TransformMatrix = 0.8660 0.5 0 -0.5 0.8660 0 0 0 1\n"));
    volume_holder scan;
    ASSERT_EQ(pliant_volume_read((folder / "rounded.mha").c_str(), nullptr, 0, &scan), PLIANT_OK)
        << pliant_last_error();
    EXPECT_NEAR(scan->geometry.direction[0], std::sqrt(0.75), 1e-4);
    pliant_volume again;
    EXPECT_EQ(pliant_volume_create(&scan->geometry, PLIANT_UINT8, &again), PLIANT_OK) << pliant_last_error();
    pliant_volume_free(&again);
}

TEST(ReadErrors, NonFiniteVoxels)
{
    temporary_folder folder;
    for (float bad : {NOT_A_NUMBER, std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity()})
        for (size_t at : {0, 6, 23}) {
            std::vector<float> values(24, 1.5f);
            values[at] = bad;
            nifti_file file;
            file.datatype = 16;
            file.bitpix = 32;
            file.data = bytes_of(values);
            save(folder / "scan.nii", file.bytes());
            expect_refused(folder / "scan.nii", PLIANT_ERROR_FORMAT, {"scan.nii", "not a finite number"});
            save(folder / "scan.mha", metaimage("", "4 3 2", "MET_FLOAT", "1 1 1", file.data));
            expect_refused(folder / "scan.mha", PLIANT_ERROR_FORMAT, {"scan.mha", "not a finite number"});
            save(folder / "scan.nrrd", nrrd("4 3 2", "(1,0,0) (0,1,0) (0,0,1)", "", "float", file.data));
            expect_refused(folder / "scan.nrrd", PLIANT_ERROR_FORMAT, {"scan.nrrd", "not a finite number"});
        }
    save(folder / "large.mha", metaimage("", "4 3 2", "MET_DOUBLE", "1 1 1", bytes_of(std::vector<double>(24, 1e300))));
    expect_refused(folder / "large.mha", PLIANT_ERROR_FORMAT, {"large.mha", "single precision"});
    struct {
        int16_t type, bits;
        const char *word;
    } types[] = {{32, 64, "complex"},  {1792, 128, "complex"},       {128, 24, "colour"},
                 {2304, 32, "colour"}, {1536, 128, "datatype 1536"}, {1, 1, "datatype 1"}};
    for (auto type : types) {
        nifti_file file;
        file.datatype = type.type;
        file.bitpix = type.bits;
        save(folder / "scan.nii", file.bytes());
        expect_refused(folder / "scan.nii", PLIANT_ERROR_FORMAT, {"scan.nii", type.word});
    }
    save(folder / "vector.mha", metaimage("ElementNumberOfChannels = 3\n"));
    expect_refused(folder / "vector.mha", PLIANT_ERROR_FORMAT, {"vector.mha", "colour or vector"});
    save(folder / "list.mha", metaimage("").replace(metaimage("").find("LOCAL"), 5, "LIST "));
    expect_refused(folder / "list.mha", PLIANT_ERROR_FORMAT, {"list.mha", "ElementDataFile"});
    std::string rgb = nrrd("3 4 3 2", "none (1,0,0) (0,1,0) (0,0,1)", "", "uchar", std::string(72, '\1'));
    rgb.replace(rgb.find("dimension: 3"), 12, "dimension: 4")
        .replace(rgb.find("kinds: domain"), 13, "kinds: RGB-color domain");
    save(folder / "rgb.nrrd", rgb);
    expect_refused(folder / "rgb.nrrd", PLIANT_ERROR_FORMAT, {"rgb.nrrd", "3 values per voxel"});
}

/* --- memory --- */

TEST(Memory, EveryAllocationMayFail)
{
    temporary_folder folder;
    nifti_file file;
    file.slope = 0.5f;
    save(folder / "scan.nii", file.bytes());
    save(folder / "scan.nrrd", nrrd());
    struct { const char *name; int allocations; } cases[] = {{"scan.nii", 2}, {"scan.nrrd", 1}};
    for (auto one : cases) {
        int failed = 0;
        for (int call = 0;; call++) {
            size_t in_use = pliant_memory_in_use();
            pliant_volume volume = {};
            pliant_memory_fail_after(call);
            pliant_status status = pliant_volume_read((folder / one.name).c_str(), nullptr, 0, &volume);
            pliant_memory_fail_after(-1);
            if (status == PLIANT_OK) {
                pliant_volume_free(&volume);
                break;
            }
            failed++;
            EXPECT_EQ(status, PLIANT_ERROR_MEMORY) << pliant_last_error();
            EXPECT_EQ(volume.voxels, nullptr);
            EXPECT_EQ(pliant_memory_in_use(), in_use);
        }
        EXPECT_EQ(failed, one.allocations) << "voxels of the file, and converted where they must be: " << one.name;
    }
}
