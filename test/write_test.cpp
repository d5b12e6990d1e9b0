#include "scan/volume.h"
#include "scan_files.h"

#include <csignal>
#include <cmath>
#include <sys/resource.h>

namespace {

const char *const NAMES[] = {"scan.nii", "scan.nii.gz", "scan.nrrd", "scan.mha", "SCAN.NII.GZ"};

pliant_geometry geometry_with(const double direction[9])
{
    pliant_geometry geometry = {{9, 7, 5}, {-0.123456, 0.25, -1.4345}, {0.00068, 0.00075, 0.0025}, {}};
    std::memcpy(geometry.direction, direction, sizeof geometry.direction);
    return geometry;
}

/* three rotations about different axes, then columns swapped or flipped */
const double CASES[][9] = {{1, 0, 0, 0, 1, 0, 0, 0, 1},
                           {-1, 0, 0, 0, -1, 0, 0, 0, 1},
                           {1, 0, 0, 0, -1, 0, 0, 0, 1},
                           {0, 0, 1, 1, 0, 0, 0, 1, 0},
                           {0, 0, -1, 1, 0, 0, 0, 1, 0},
                           {0.6, -0.8, 0, 0.8, 0.6, 0, 0, 0, 1},
                           {0.6, 0, 0.8, 0.48, -0.8, -0.36, 0.64, 0.6, -0.48}};

void fill(pliant_volume *volume)
{
    for (size_t n = 0; n < pliant_geometry_voxels(&volume->geometry); n++) {
        if (volume->encoding == PLIANT_UINT8) static_cast<uint8_t *>(volume->voxels)[n] = uint8_t(n * 31);
        if (volume->encoding == PLIANT_INT16) static_cast<int16_t *>(volume->voxels)[n] = int16_t(int(n * 197) - 32768);
        if (volume->encoding == PLIANT_FLOAT32) static_cast<float *>(volume->voxels)[n] = std::sin(float(n)) * 1000.0f;
    }
}

} // namespace

TEST(Write, RoundTripOfEveryFormatEncodingAndDirection)
{
    temporary_folder folder;
    for (const double *direction : CASES)
        for (pliant_encoding encoding : {PLIANT_UINT8, PLIANT_INT16, PLIANT_FLOAT32}) {
            pliant_geometry geometry = geometry_with(direction);
            volume_holder volume;
            ASSERT_EQ(pliant_volume_create(&geometry, encoding, &volume), PLIANT_OK) << pliant_last_error();
            fill(&volume);
            for (const char *name : NAMES) {
                SCOPED_TRACE(testing::Message() << name << " encoding " << encoding);
                volume_holder back;
                ASSERT_EQ(pliant_volume_write((folder / name).c_str(), &volume), PLIANT_OK) << pliant_last_error();
                ASSERT_EQ(pliant_volume_read((folder / name).c_str(), nullptr, 0, &back), PLIANT_OK)
                    << pliant_last_error();
                EXPECT_TRUE(pliant_geometry_equal(&volume->geometry, &back->geometry));
                ASSERT_EQ(back->encoding, encoding);
                EXPECT_EQ(std::memcmp(volume->voxels, back->voxels, 315 * pliant_encoding_size(encoding)), 0);
            }
        }
    EXPECT_EQ(folder.names().size(), 5u) << "no temporary file is left";
}

TEST(Write, AppliesSlopeAndIntercept)
{
    temporary_folder folder;
    pliant_geometry geometry = geometry_with(CASES[0]);
    volume_holder volume;
    ASSERT_EQ(pliant_volume_create(&geometry, PLIANT_INT16, &volume), PLIANT_OK);
    fill(&volume);
    volume->slope = 0.5f;
    volume->intercept = -1000.0f;
    for (const char *name : NAMES) {
        volume_holder back;
        ASSERT_EQ(pliant_volume_write((folder / name).c_str(), &volume), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_volume_read((folder / name).c_str(), nullptr, 0, &back), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(back->encoding, PLIANT_FLOAT32);
        for (size_t n = 0; n < 315; n++)
            EXPECT_EQ(pliant_volume_value(&back.volume, n), pliant_volume_value(&volume.volume, n));
    }
}

TEST(Write, Labels)
{
    temporary_folder folder;
    pliant_geometry geometry = geometry_with(CASES[6]);
    pliant_labels labels, back;
    ASSERT_EQ(pliant_labels_create(&geometry, &labels), PLIANT_OK);
    for (size_t n = 0; n < 315; n++) labels.voxels[n] = uint16_t(n * 208);
    for (const char *name : NAMES) {
        ASSERT_EQ(pliant_labels_write((folder / name).c_str(), &labels), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_labels_read((folder / name).c_str(), 0, &back), PLIANT_OK) << pliant_last_error();
        EXPECT_TRUE(pliant_geometry_equal(&labels.geometry, &back.geometry));
        EXPECT_EQ(std::memcmp(labels.voxels, back.voxels, 630), 0);
        pliant_labels_free(&back);
    }
    pliant_labels_free(&labels);
}

TEST(Write, HeadersFollowTheFormats)
{
    temporary_folder folder;
    pliant_geometry geometry = geometry_with(CASES[0]);
    volume_holder volume;
    ASSERT_EQ(pliant_volume_create(&geometry, PLIANT_INT16, &volume), PLIANT_OK);
    ASSERT_EQ(pliant_volume_write((folder / "scan.nii").c_str(), &volume), PLIANT_OK) << pliant_last_error();
    std::string bytes = load(folder / "scan.nii");
    ASSERT_EQ(bytes.size(), 352u + 630u);
    int16_t type;
    float spacing[4], row_x[4];
    std::memcpy(&type, &bytes[70], 2);
    std::memcpy(spacing, &bytes[76], 16);
    std::memcpy(row_x, &bytes[280], 16);
    EXPECT_EQ(type, 4);
    EXPECT_EQ(bytes[123] & 7, 2) << "millimetres";
    EXPECT_FLOAT_EQ(spacing[3], 2.5f);
    EXPECT_FLOAT_EQ(row_x[0], -0.68f) << "RAS";
    EXPECT_FLOAT_EQ(row_x[3], 123.456f);
    ASSERT_EQ(pliant_volume_write((folder / "scan.nii.gz").c_str(), &volume), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(load(folder / "scan.nii.gz").substr(0, 2), "\x1f\x8b");
}

TEST(Write, RefusesWithoutLeavingAFile)
{
    temporary_folder folder;
    pliant_geometry geometry = geometry_with(CASES[0]);
    volume_holder volume;
    pliant_volume empty = {};
    ASSERT_EQ(pliant_volume_create(&geometry, PLIANT_INT16, &volume), PLIANT_OK);
    struct { std::string path; pliant_status status; const char *word;
    } cases[] = {{folder / "scan.jpg", PLIANT_ERROR_ARGUMENT, ".nii.gz"},
                 {folder / ".nii", PLIANT_ERROR_ARGUMENT, "extension"},
                 {folder / "none/scan.nii", PLIANT_ERROR_FILE, "No such file or directory"},
                 {"/proc/scan.nrrd", PLIANT_ERROR_FILE, "/proc/scan.nrrd"},
                 {"", PLIANT_ERROR_ARGUMENT, "no path"}};
    for (const auto &one : cases) {
        EXPECT_EQ(pliant_volume_write(one.path.c_str(), &volume), one.status);
        EXPECT_NE(std::strstr(pliant_last_error(), one.word), nullptr) << pliant_last_error();
    }
    mkdir((folder / "folder.nii").c_str(), 0777);
    EXPECT_EQ(pliant_volume_write((folder / "folder.nii").c_str(), &volume), PLIANT_ERROR_FILE);
    EXPECT_EQ(pliant_volume_write((folder / "scan.nii").c_str(), &empty), PLIANT_ERROR_ARGUMENT);
    volume->slope = 2;
    pliant_memory_fail_after(0);
    EXPECT_EQ(pliant_volume_write((folder / "scan.nii").c_str(), &volume), PLIANT_ERROR_MEMORY);
    pliant_memory_fail_after(-1);
    EXPECT_EQ(folder.names(), std::vector<std::string>{"folder.nii"});
}

TEST(Write, NiftiHoldsAtMost32767AlongAnAxis)
{
    temporary_folder folder;
    pliant_geometry geometry = geometry_with(CASES[0]);
    volume_holder volume, back;
    geometry.size[0] = 40000;
    geometry.size[1] = geometry.size[2] = 2;
    ASSERT_EQ(pliant_volume_create(&geometry, PLIANT_UINT8, &volume), PLIANT_OK);
    EXPECT_EQ(pliant_volume_write((folder / "scan.nii").c_str(), &volume), PLIANT_ERROR_FORMAT);
    ASSERT_EQ(pliant_volume_write((folder / "scan.nrrd").c_str(), &volume), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_volume_read((folder / "scan.nrrd").c_str(), nullptr, 0, &back), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(back->geometry.size[0], 40000);
}

TEST(Write, AFullDiskKeepsTheOldFile)
{
    temporary_folder folder;
    pliant_geometry geometry = {{64, 64, 64}, {0, 0, 0}, {0.001, 0.001, 0.001}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    volume_holder volume;
    ASSERT_EQ(pliant_volume_create(&geometry, PLIANT_INT16, &volume), PLIANT_OK);
    uint32_t random = 1;
    for (size_t n = 0; n < 64 * 64 * 64; n++)
        static_cast<int16_t *>(volume->voxels)[n] = int16_t((random = random * 1664525 + 1013904223) >> 16);
    for (const char *name : {"scan.nii", "scan.nii.gz", "scan.nrrd", "scan.mha"}) save(folder / name, "old");

    /* a limit on the file size fails like a full disk */
    struct rlimit before, small;
    ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
    small = before;
    small.rlim_cur = 100000;
    void (*handler)(int) = std::signal(SIGXFSZ, SIG_IGN);
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
    for (const char *name : {"scan.nii", "scan.nii.gz", "scan.nrrd", "scan.mha"}) {
        EXPECT_EQ(pliant_volume_write((folder / name).c_str(), &volume), PLIANT_ERROR_FILE) << name;
        EXPECT_NE(std::strstr(pliant_last_error(), name), nullptr) << pliant_last_error();
    }
    setrlimit(RLIMIT_FSIZE, &before);
    std::signal(SIGXFSZ, handler);
    for (const char *name : {"scan.nii", "scan.nii.gz", "scan.nrrd", "scan.mha"}) EXPECT_EQ(load(folder / name), "old");
    EXPECT_EQ(folder.names().size(), 4u);
}
