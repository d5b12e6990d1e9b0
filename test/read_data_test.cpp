/* Files of other programs, if the shared test data are available. DICOM: read_dicom_test.cpp. */
#include "scan/volume.h"
#include "scan_files.h"

#include <algorithm>
#include <cmath>

namespace {

bool have_shared_data()
{
    struct stat status;
    return stat(PLIANT_TEST_DATA "/SOURCES.md", &status) == 0;
}
#define NEEDS_SHARED_DATA() \
    if (!have_shared_data()) GTEST_SKIP() << "the shared test data is not at " PLIANT_TEST_DATA

const std::string DATA = PLIANT_TEST_DATA "/";

} // namespace

TEST(SharedData, AbdomenAndThorax)
{
    NEEDS_SHARED_DATA();
    volume_holder abdomen, thorax;
    pliant_labels labels = {};
    ASSERT_EQ(pliant_volume_read((DATA + "abdomen/ct.nii.gz").c_str(), nullptr, 0, &abdomen), PLIANT_OK)
        << pliant_last_error();
    ASSERT_EQ(pliant_labels_read((DATA + "abdomen/labels_totalseg_fast.nii.gz").c_str(), 0, &labels), PLIANT_OK)
        << pliant_last_error();
    ASSERT_EQ(pliant_volume_read((DATA + "thorax/ct.mha").c_str(), nullptr, 0, &thorax), PLIANT_OK)
        << pliant_last_error();
    EXPECT_EQ(abdomen->encoding, PLIANT_INT16) << "int32 on disk, Hounsfield units";
    EXPECT_EQ(abdomen->background, -1024.0f);
    EXPECT_TRUE(pliant_geometry_equal(&abdomen->geometry, &labels.geometry));
    struct {
        pliant_volume *volume;
        int32_t size[3];
        double spacing[3], origin[3];
        float low, high;
        double mean;
    } expected[] = {
        {&abdomen.volume, {122, 101, 112}, {3, 3, 3}, {177.95633, -11.319, 94.30176}, -1207, 3382, -360.0203852864795},
        {&thorax.volume,
         {115, 157, 129},
         {1.366, 1.366, 2.5},
         {-153.827, -150.352, -1434.5},
         -1255,
         1474,
         -351.72059190372227}};
    for (const auto &one : expected) {
        double sum = 0;
        float low = 1e9f, high = -1e9f;
        size_t count = pliant_geometry_voxels(&one.volume->geometry);
        for (size_t n = 0; n < count; n++) {
            float value = pliant_volume_value(one.volume, n);
            sum += value;
            low = std::fmin(low, value);
            high = std::fmax(high, value);
        }
        EXPECT_EQ(low, one.low);
        EXPECT_EQ(high, one.high);
        EXPECT_NEAR(sum / double(count), one.mean, 1e-9) << "mean by an independent reader";
        for (int d = 0; d < 3; d++) {
            EXPECT_EQ(one.volume->geometry.size[d], one.size[d]);
            EXPECT_NEAR(one.volume->geometry.spacing[d], 1e-3 * one.spacing[d], 1e-9);
            EXPECT_NEAR(one.volume->geometry.origin[d], 1e-3 * one.origin[d], 1e-8);
        }
    }
    uint16_t maximum = 0;
    for (size_t n = 0; n < pliant_geometry_voxels(&labels.geometry); n++) maximum = std::max(maximum, labels.voxels[n]);
    EXPECT_EQ(maximum, 117);
    pliant_labels_free(&labels);
}

TEST(SharedData, EveryScalarTypeHoldsTheSameNumbers)
{
    NEEDS_SHARED_DATA();
    for (const char *type :
         {"int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64"}) {
        volume_holder scan;
        ASSERT_EQ(pliant_volume_read((DATA + "loader/nifti_variants/27/" + type + ".nii").c_str(), nullptr, 0, &scan),
                  PLIANT_OK)
            << pliant_last_error();
        EXPECT_EQ(scan->encoding, type[0] == 'f' ? PLIANT_FLOAT32 : PLIANT_UINT8) << type;
        for (int n = 0; n < 27; n++) EXPECT_EQ(scan.at(n / 9, n / 3 % 3, n % 3), float(n)) << type;
    }
}

TEST(SharedData, VariantsThatHoldOneVolume)
{
    NEEDS_SHARED_DATA();
    struct {
        const char *name;
        int32_t size[3];
        double spacing[3];
        pliant_encoding encoding;
        float low, high;
    } files[] = {
        {"nifti_variants/CT_AVM.nii.gz", {256, 242, 154}, {0.719943, 0.720914, 1}, PLIANT_FLOAT32, 0, 563.2f},
        {"nifti_variants/avg152T1_LR_bigendian.nii", {91, 109, 91}, {2, 2, 2}, PLIANT_UINT8, 0, 255},
        {"nifti_variants/minimal.hdr", {64, 64, 10}, {3, 3, 3}, PLIANT_UINT8, 0, 63},
        {"nifti_variants/minimal.hdr.gz", {64, 64, 10}, {3, 3, 3}, PLIANT_UINT8, 0, 63},
        {"nifti_variants/minimal2.hdr", {64, 64, 10}, {3, 3, 3}, PLIANT_UINT8, 0, 63},
        {"nifti_variants/minimal.nii.gz", {64, 64, 10}, {3, 3, 3}, PLIANT_UINT8, 0, 63},
        {"nifti_variants/nibabel_anatomical.nii", {33, 41, 25}, {2, 2, 2}, PLIANT_INT16, -610, 30393},
        {"nifti_variants/mha.mha", {64, 64, 37}, {3.4375, 3.4375, 3.8}, PLIANT_INT16, 0, 6690},
        {"nrrd_variants/BallBinary30x30x30.nhdr", {30, 30, 30}, {1, 1, 1}, PLIANT_INT16, 0, 257},
        {"nrrd_variants/BallBinary30x30x30.nrrd", {30, 30, 30}, {1, 1, 1}, PLIANT_INT16, 0, 257},
        {"nrrd_variants/BallBinary30x30x30.nii.gz", {30, 30, 30}, {1, 1, 1}, PLIANT_INT16, 0, 257},
        {"nrrd_variants/BallBinary30x30x30_gz.nrrd", {30, 30, 30}, {1, 1, 1}, PLIANT_INT16, 0, 257},
        {"nrrd_variants/BallBinary30x30x30_gz_lineskip.nrrd", {30, 30, 30}, {1, 1, 1}, PLIANT_INT16, 0, 257},
        {"nrrd_variants/BallBinary30x30x30_gz_byteskip_minus_one.nrrd", {30, 30, 30}, {1, 1, 1}, PLIANT_INT16, 0, 257},
        {"nrrd_variants/BallBinary30x30x30_byteskip_minus_one_nifti.nhdr",
         {30, 30, 30},
         {1, 1, 1},
         PLIANT_INT16,
         0,
         257},
        {"nrrd_variants/breast1_image.nrrd", {45, 120, 21}, {0.664062, 0.664062, 2.1}, PLIANT_UINT8, 6, 248}};
    for (const auto &file : files) {
        SCOPED_TRACE(file.name);
        volume_holder scan;
        ASSERT_EQ(pliant_volume_read((DATA + "loader/" + file.name).c_str(), nullptr, 0, &scan), PLIANT_OK)
            << pliant_last_error();
        EXPECT_EQ(scan->encoding, file.encoding);
        float low = 1e9f, high = -1e9f;
        for (size_t n = 0; n < pliant_geometry_voxels(&scan->geometry); n++) {
            low = std::fmin(low, pliant_volume_value(&scan.volume, n));
            high = std::fmax(high, pliant_volume_value(&scan.volume, n));
        }
        EXPECT_FLOAT_EQ(low, file.low);
        EXPECT_FLOAT_EQ(high, file.high);
        for (int d = 0; d < 3; d++) EXPECT_EQ(scan->geometry.size[d], file.size[d]);
        for (int d = 0; d < 3; d++) EXPECT_NEAR(scan->geometry.spacing[d], 1e-3 * file.spacing[d], 1e-9);
    }
}

TEST(SharedData, VariantsThatAreRefused)
{
    NEEDS_SHARED_DATA();
    const std::map<std::string, std::vector<std::string>> files = {
        {"nifti_variants/complex/complex32.nii", {"complex"}},
        {"nifti_variants/complex/complex64.nii", {"complex"}},
        {"nifti_variants/rgb/3D.nii", {"colour"}},
        {"nifti_variants/rgb/4D.nii", {"colour"}},
        {"nifti_variants/rgba/4D.nii", {"colour"}},
        {"nifti_variants/ct_perfusion.nii.gz", {"colour"}},
        {"nifti_variants/nibabel_example4d.nii.gz", {"4 dimensions (128 x 96 x 24 x 2)"}},
        {"nifti_variants/example_nifti2.nii.gz", {"4 dimensions (32 x 20 x 12 x 2)"}},
        {"nifti_variants/minimal_extended_hdr.nii", {"2-D"}},
        {"nifti_variants/minimal.img", {"not a scan"}},
        {"nrrd_variants/test1d_ascii.nrrd", {"2-D"}},
        {"nrrd_variants/test2d_ascii.nrrd", {"2-D"}},
        {"nrrd_variants/test_simple4d_raw.nrrd", {"2-D image (1 x 1 x 1)"}},
        {"nrrd_variants/BallBinary30x30x30_bz2.nrrd", {"encoding: bz"}},
        {"nrrd_variants/BallBinary30x30x30_nifti.nhdr", {"byte skip is missing"}},
        {"nrrd_variants/BallBinary30x30x30_byteskip_minus_five.nhdr", {}}};
    for (const auto &file : files) {
        std::vector<std::string> words = file.second;
        words.push_back(file.first);
        expect_refused(DATA + "loader/" + file.first, PLIANT_ERROR_FORMAT, words);
    }
}

TEST(SharedData, MalformedFiles)
{
    NEEDS_SHARED_DATA();
    const std::map<std::string, std::string> files = {{"MR_truncated.dcm", "truncated"},
                                                      {"UN_sequence.dcm", "without PixelData"},
                                                      {"badVR.dcm", "NumberOfFrames is \"1A\""},
                                                      {"bad_sequence.dcm", "2-D"},
                                                      {"no_meta.dcm", "no DICOM image"},
                                                      {"fuzz-1.nii", "not a NIfTI"},
                                                      {"fuzz-2.nii", "truncated"}};
    for (const auto &file : files)
        expect_refused(DATA + "malformed/" + file.first, PLIANT_ERROR_FORMAT, {file.first, file.second});
    expect_refused(DATA + "malformed", PLIANT_ERROR_FORMAT, {"MR_truncated.dcm", "truncated"});
}
