/* DICOM folders: synthetic ones, and folders of the shared test data. */
#include "scan/volume.h"
#include "scan_files.h"

#include <algorithm>
#include <cmath>

TEST(Dicom, SortsByPositionAndTakesSpacingFromIt)
{
    temporary_folder folder;
    save_series(folder, 5);
    save(folder / "notes.txt", "not DICOM");
    save(folder / ".hidden", "");
    volume_holder scan;
    ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    const int32_t size[3] = {4, 3, 5};
    const double spacing[3] = {0.00075, 0.0005, 0.002}, origin[3] = {-0.010, -0.020, 0.030};
    for (int d = 0; d < 3; d++) {
        EXPECT_EQ(scan->geometry.size[d], size[d]);
        EXPECT_NEAR(scan->geometry.spacing[d], spacing[d], 1e-12) << "SliceThickness says 7 mm";
        EXPECT_NEAR(scan->geometry.origin[d], origin[d], 1e-12);
    }
    for (int d = 0; d < 9; d++) EXPECT_EQ(scan->geometry.direction[d], d % 4 == 0);
    EXPECT_EQ(scan->encoding, PLIANT_INT16);
    EXPECT_EQ(scan->background, -1024.0f);
    for (int k = 0; k < 5; k++) {
        EXPECT_EQ(scan.at(0, 0, k), 100 * k - 1024);
        EXPECT_EQ(scan.at(1, 0, k), k);
    }
    EXPECT_EQ(folder.path().substr(folder.path().size() - std::strlen(scan->id)), scan->id);
}

TEST(Dicom, ObliqueStackWithDescendingPositions)
{
    temporary_folder folder;
    save_series(folder, 4, [](int n, dicom_file *file) {
        /* Rows along +y, columns along (0.6, 0, 0.8): the normal is (0.8, 0, -0.6). */
        file->orientation = "0\\1\\0\\0.6\\0\\0.8";
        char position[80];
        std::snprintf(position, sizeof position, "%.6f\\5\\%.6f", 100 - 3 * n * 0.8, 50 + 3 * n * 0.6);
        file->position = position;
    });
    volume_holder scan;
    ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    const double direction[9] = {0, 0.6, 0.8, 1, 0, 0, 0, 0.8, -0.6};
    for (int d = 0; d < 9; d++) EXPECT_NEAR(scan->geometry.direction[d], direction[d], 1e-9) << d;
    EXPECT_NEAR(scan->geometry.spacing[2], 0.003, 1e-8);
    EXPECT_NEAR(scan->geometry.origin[0], 0.100 - 0.009 * 0.8, 1e-8);
    EXPECT_EQ(scan.at(0, 0, 0), 300 - 1024) << "the last image is the first along the normal";
}

TEST(Dicom, DeflatedDataSets)
{
    temporary_folder plain, packed;
    volume_holder scan, same;
    save_series(plain, 5);
    ASSERT_EQ(pliant_volume_read(plain.path().c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    save_series(packed, 5, [](int, dicom_file *file) { file->syntax = DEFLATED_SYNTAX; });
    for (const std::string &name : packed.names()) save(packed / name, with_deflated_data_set(load(packed / name)));
    ASSERT_EQ(pliant_volume_read(packed.path().c_str(), nullptr, 0, &same), PLIANT_OK) << pliant_last_error();
    ASSERT_TRUE(pliant_geometry_equal(&scan->geometry, &same->geometry));
    EXPECT_EQ(std::memcmp(scan->voxels, same->voxels, 60 * sizeof(int16_t)), 0);
    save(packed / packed.names()[2], dicom_file{DEFLATED_SYNTAX}.bytes()); /* the data set is not deflated */
    expect_refused(packed.path(), PLIANT_ERROR_FORMAT, {packed.names()[2], "compressed data are damaged"});
}

TEST(Dicom, SlopeAndIntercept)
{
    temporary_folder folder;
    volume_holder fractional, apart;
    save_series(folder, 3, [](int, dicom_file *file) { file->slope = "0.25"; });
    ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &fractional), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(fractional->encoding, PLIANT_FLOAT32);
    EXPECT_EQ(fractional.at(1, 0, 2), 0.25f * 1026 - 1024);

    save_series(folder, 3, [](int n, dicom_file *file) {
        file->slope = std::to_string(n + 1);
        file->intercept = std::to_string(-10 * n);
    });
    ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &apart), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(apart->encoding, PLIANT_INT16);
    for (int n = 0; n < 3; n++) EXPECT_EQ(apart.at(1, 0, n), (n + 1) * (1024 + n) - 10 * n);

    volume_holder shifted; /* only the intercept differs */
    save_series(folder, 3, [](int n, dicom_file *file) { file->intercept = std::to_string(-10 * n); });
    ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &shifted), PLIANT_OK) << pliant_last_error();
    for (int n = 0; n < 3; n++) EXPECT_EQ(shifted.at(1, 0, n), 1024 + n - 10 * n);
    volume_holder scaled;
    save_series(folder, 3, [](int n, dicom_file *file) { file->slope = std::to_string(n + 1); });
    ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &scaled), PLIANT_OK) << pliant_last_error();
    for (int n = 0; n < 3; n++) EXPECT_EQ(scaled.at(1, 0, n), (n + 1) * (1024 + n) - 1024);
}

TEST(Dicom, TellsTheModality)
{
    const struct { const char *word; pliant_modality modality;
    } cases[] = {{"CT", PLIANT_MODALITY_CT},
                 {"MR", PLIANT_MODALITY_MR},
                 {"PT", PLIANT_MODALITY_OTHER},
                 {"OT", PLIANT_MODALITY_UNKNOWN},
                 {"", PLIANT_MODALITY_UNKNOWN}};
    for (const auto &one : cases) {
        temporary_folder folder;
        save_series(folder, 2, [&](int, dicom_file *file) { file->modality = one.word; });
        volume_holder scan;
        ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(scan->modality, one.modality) << one.word;
    }
}

TEST(Dicom, SeveralSeriesAreListedAndOneMayBeNamed)
{
    temporary_folder folder;
    save_series(folder, 6, [](int n, dicom_file *file) {
        if (n < 4) return;
        file->series = "1.2.3.22";
        file->description = "thorax";
        file->intercept = "0";
    });
    expect_refused(folder.path(), PLIANT_ERROR_FORMAT,
                   {folder.path(), "2 series", "scan/series=UID", "1.2.3.1  \"abdomen\"  4 images of 4 x 3",
                    "1.2.3.22  \"thorax\"  2 images"});
    expect_refused(folder.path(), PLIANT_ERROR_FORMAT, {"scan/series: no series ends with \"9.9\"", "1.2.3.22"}, "9.9");
    for (const char *name : {"1.2.3.22", ".22", "3.22"}) {
        volume_holder scan;
        ASSERT_EQ(pliant_volume_read(folder.path().c_str(), name, 0, &scan), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(scan->geometry.size[2], 2);
        EXPECT_EQ(scan.at(1, 0, 0), 1028);
    }
    save_series(folder, 1, [](int, dicom_file *file) { file->series = "9.2.3.22"; });
    expect_refused(folder.path(), PLIANT_ERROR_FORMAT, {"more than one series ends with \".22\""}, ".22");
}

TEST(Dicom, ColourInAnotherSeriesDoesNotMatter)
{
    temporary_folder folder;
    save_series(folder, 4, [](int n, dicom_file *file) {
        if (n < 3) return;
        file->series = "1.2.3.5";
        file->samples = 3;
        file->photometric = "RGB";
    });
    volume_holder scan;
    EXPECT_EQ(pliant_volume_read(folder.path().c_str(), "1.2.3.1", 0, &scan), PLIANT_OK) << pliant_last_error();
    expect_refused(folder.path(), PLIANT_ERROR_FORMAT, {"colour image (RGB)"}, "1.2.3.5");
}

TEST(DicomErrors, StacksThatAreNoRegularGrid)
{
    struct { const char *what; void (*change)(int, dicom_file *); std::vector<std::string> words;
    } cases[] = {{"a slice is missing",
                  [](int n, dicom_file *f) {
                      if (n > 2) f->position = "-10\\-20\\" + std::to_string(32 + 2 * n);
                  },
                  {"1 slice(s) missing between", "4 mm apart, others are 2 mm"}},
                 {"spacing changes",
                  [](int n, dicom_file *f) {
                      if (n > 2) f->position = "-10\\-20\\" + std::to_string(30 + 3 * n);
                  },
                  {"not evenly spaced"}},
                 {"a slice is off by a tenth",
                  [](int n, dicom_file *f) {
                      if (n == 2) f->position = "-10\\-20\\34.2";
                  },
                  {"not evenly spaced", "mm from even places"}},
                 {"gantry tilt",
                  [](int n, dicom_file *f) {
                      f->position = "-10\\" + std::to_string(-20 + n) + "\\" + std::to_string(30 + 2 * n);
                  },
                  {"sheared", "gantry tilt of 26.6 degrees"}},
                 {"two at one place",
                  [](int n, dicom_file *f) {
                      if (n == 3) f->position = "-10\\-20\\34";
                  },
                  {"at the same position", "time points"}},
                 {"an image twice",
                  [](int n, dicom_file *f) {
                      if (n == 3) {
                          f->position = "-10\\-20\\34";
                          f->instance = "1.2.3.4.3";
                      }
                  },
                  {"same image twice"}},
                 {"no position",
                  [](int n, dicom_file *f) {
                      if (n == 1) f->position = "";
                  },
                  {"no ImagePositionPatient"}},
                 {"two numbers for a position",
                  [](int n, dicom_file *f) {
                      if (n == 1) f->position = "1\\2";
                  },
                  {"ImagePositionPatient", "3 numbers"}},
                 {"position is text",
                  [](int n, dicom_file *f) {
                      if (n == 1) f->position = "1\\2\\x";
                  },
                  {"ImagePositionPatient"}},
                 {"another size",
                  [](int n, dicom_file *f) {
                      if (n == 1) {
                          f->rows = 4;
                          f->pixels.resize(16);
                      }
                  },
                  {"4 x 4 pixels", "4 x 3"}},
                 {"another orientation",
                  [](int n, dicom_file *f) {
                      if (n == 1) f->orientation = "0\\1\\0\\1\\0\\0";
                  },
                  {"ImageOrientationPatient differs"}},
                 {"another pixel spacing",
                  [](int n, dicom_file *f) {
                      if (n == 1) f->spacing = "0.6\\0.6";
                  },
                  {"PixelSpacing 0.6 x 0.6"}},
                 {"no orientation at all",
                  [](int, dicom_file *f) { f->orientation = "1\\0\\0\\1\\0\\0"; },
                  {"ImageOrientationPatient"}},
                 {"spacing zero", [](int, dicom_file *f) { f->spacing = "0\\0"; }, {""}},
                 {"colour",
                  [](int, dicom_file *f) {
                      f->samples = 3;
                      f->photometric = "RGB";
                      f->pixels.resize(36);
                  },
                  {"colour"}},
                 {"frames",
                  [](int, dicom_file *f) {
                      f->frames = "2";
                      f->pixels.resize(24);
                  },
                  {"2 frames"}},
                 {"too few pixels",
                  [](int n, dicom_file *f) {
                      if (n == 1) f->pixels.resize(11);
                  },
                  {"truncated", "24 bytes"}}};
    for (const auto &one : cases) {
        SCOPED_TRACE(one.what);
        temporary_folder folder;
        save_series(folder, 5, one.change);
        std::vector<std::string> words = one.words;
        words.push_back(folder.path());
        expect_refused(folder.path(), PLIANT_ERROR_FORMAT, words);
    }
}

TEST(DicomErrors, FoldersAndFiles)
{
    temporary_folder folder;
    expect_refused(folder.path(), PLIANT_ERROR_FORMAT, {folder.path(), "no DICOM image in this folder"});
    save(folder / "readme.txt", "hello");
    mkdir((folder / "sub").c_str(), 0777);
    expect_refused(folder.path(), PLIANT_ERROR_FORMAT, {"no DICOM image", "subfolders are not searched"});
    save(folder / "one.dcm", dicom_file().bytes());
    expect_refused(folder / "one.dcm", PLIANT_ERROR_FORMAT, {"one.dcm", "2-D", "folder"});
    expect_refused(folder.path(), PLIANT_ERROR_FORMAT, {"one slice (one.dcm)", "2-D"});
    save(folder / "empty.dcm", "");
    expect_refused(folder / "empty.dcm", PLIANT_ERROR_FORMAT, {"empty.dcm", "is empty"});
}

TEST(DicomErrors, EveryTruncationOfASlice)
{
    temporary_folder folder;
    save_series(folder, 3);
    dicom_file last;
    last.position = "-10\\-20\\36";
    last.instance = "1.2.3.4.9";
    std::string bytes = last.bytes();
    save(folder / "z", bytes);
    volume_holder scan;
    ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(scan->geometry.size[2], 4);
    for (size_t length = 132; length < bytes.size(); length++) {
        save(folder / "z", bytes.substr(0, length));
        expect_refused(folder.path(), PLIANT_ERROR_FORMAT, {folder / "z", "truncated"});
    }
}

TEST(DicomErrors, MoreThanTheLimit)
{
    temporary_folder folder;
    save_series(folder, 5);
    expect_refused(folder.path(), PLIANT_ERROR_MEMORY, {folder.path(), "4 x 3 x 5", "the limit"}, nullptr, 50);
}

TEST(DicomMemory, EveryAllocationMayFail)
{
    temporary_folder folder;
    save_series(folder, 3, [](int, dicom_file *file) { file->slope = "0.5"; });
    int failed = 0;
    for (int call = 0;; call++) {
        size_t in_use = pliant_memory_in_use();
        pliant_volume volume = {};
        pliant_memory_fail_after(call);
        pliant_status status = pliant_volume_read(folder.path().c_str(), nullptr, 0, &volume);
        pliant_memory_fail_after(-1);
        if (status == PLIANT_OK) {
            pliant_volume_free(&volume);
            break;
        }
        failed++;
        EXPECT_EQ(status, PLIANT_ERROR_MEMORY);
        EXPECT_EQ(volume.voxels, nullptr);
        EXPECT_EQ(pliant_memory_in_use(), in_use);
    }
    EXPECT_EQ(failed, 2) << "pixels of the files, voxels of the volume";
}

TEST(DicomSharedData, Jpeg2000Abdomen)
{
    const std::string path = PLIANT_TEST_DATA "/loader/dicom_jpeg2000_abdomen";
    struct stat status;
    if (stat(path.c_str(), &status) != 0) GTEST_SKIP() << "the shared test data is not at " PLIANT_TEST_DATA;
    volume_holder scan;
    testing::internal::CaptureStderr();
    testing::internal::CaptureStdout();
    pliant_status read = pliant_volume_read(path.c_str(), nullptr, 0, &scan);
    EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
    ASSERT_EQ(read, PLIANT_OK) << pliant_last_error();
    const int32_t size[3] = {512, 512, 20};
    const double spacing[3] = {0.9765625, 0.9765625, 2.0}, origin[3] = {-249.51171875, -437.51171875, -804.5};
    for (int d = 0; d < 3; d++) {
        EXPECT_EQ(scan->geometry.size[d], size[d]);
        EXPECT_NEAR(scan->geometry.spacing[d], 1e-3 * spacing[d], 1e-9) << "SliceThickness says 3.0 mm";
        EXPECT_NEAR(scan->geometry.origin[d], 1e-3 * origin[d], 1e-9);
    }
    EXPECT_EQ(scan->encoding, PLIANT_INT16);
    int16_t low = INT16_MAX, high = INT16_MIN;
    for (size_t n = 0; n < pliant_geometry_voxels(&scan->geometry); n++) {
        low = std::min(low, static_cast<int16_t *>(scan->voxels)[n]);
        high = std::max(high, static_cast<int16_t *>(scan->voxels)[n]);
    }
    EXPECT_EQ(low, -1024);
    EXPECT_EQ(high, 1839);

    /* The labels were drawn on the same scan. They lie on its grid, seen from the other end of y. Liver (5) is soft
     * tissue there. */
    pliant_labels labels = {};
    ASSERT_EQ(pliant_labels_read((path + "_labels.nii.gz").c_str(), 0, &labels), PLIANT_OK) << pliant_last_error();
    EXPECT_FALSE(pliant_geometry_equal(&labels.geometry, &scan->geometry));
    ASSERT_EQ(pliant_labels_to_grid(&labels, &scan->geometry), PLIANT_OK) << pliant_last_error();
    double sum = 0, count = 0;
    for (size_t n = 0; n < pliant_geometry_voxels(&scan->geometry); n++) {
        if (labels.voxels[n] != 5) continue;
        sum += static_cast<int16_t *>(scan->voxels)[n];
        count++;
    }
    pliant_labels_free(&labels);
    ASSERT_GT(count, 10000);
    EXPECT_GT(sum / count, 30) << "liver [HU]";
    EXPECT_LT(sum / count, 180);
}

TEST(DicomSharedData, TruncatedJpeg2000)
{
    const std::string path =
        PLIANT_TEST_DATA "/loader/dicom_jpeg2000_abdomen/CT.1.3.12.2.1107.5.1.4.60064.300000221208081134280000165";
    temporary_folder folder;
    std::string first = load(path + "73"), second = load(path + "74");
    if (first.empty()) GTEST_SKIP() << "the shared test data is not at " PLIANT_TEST_DATA;
    save(folder / "a", first);
    for (size_t missing : {1000, 100000, 156000}) {
        save(folder / "b", second.substr(0, second.size() - missing));
        expect_refused(folder.path(), PLIANT_ERROR_FORMAT, {folder / "b", "truncated"});
    }
}

TEST(DicomSharedData, GantryTiltAndVariableSpacing)
{
    const std::string archive = PLIANT_TEST_DATA "/loader/dicom_gantrytilt_GE_head_variable-spacing.tar.gz";
    struct stat status;
    if (stat(archive.c_str(), &status) != 0) GTEST_SKIP() << "the shared test data is not at " PLIANT_TEST_DATA;
    temporary_folder folder;
    ASSERT_EQ(std::system(("tar xzf '" + archive + "' -C " + folder.path()).c_str()), 0);
    expect_refused(folder / "dicom_gantrytilt_GE_head_variable-spacing", PLIANT_ERROR_FORMAT,
                   {"not evenly spaced: 1.08109 to 6.99863 mm"});
}
