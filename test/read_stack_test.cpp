/* Real-world DICOM series: with stray images, rounded positions, padding and missing elements. */
#include "material/material.h"
#include "scan_files.h"

#include <cmath>

namespace
{

std::string place(const char *format, double value)
{
    char text[80];
    std::snprintf(text, sizeof text, format, value);
    return text;
}

void expect_five_slices(const temporary_folder &folder, const std::vector<std::string> &warned)
{
    volume_holder scan;
    log_catcher log;
    ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(scan->geometry.size[2], 5);
    EXPECT_NEAR(scan->geometry.origin[2], 0.030, 1e-12);
    for (int k = 0; k < 5; k++) EXPECT_EQ(scan.at(1, 0, k), k);
    expect_words(log.warnings(), warned);
}

} // namespace

TEST(Stack, OmitsAndNamesOtherImages)
{
    const struct {
        const char *what, *name;
        void (*change)(dicom_file *);
        std::vector<std::string> words;
    } cases[] = {
        {"a colour picture",
         "a.dcm",
         [](dicom_file *f) {
             f->samples = 3;
             f->photometric = "RGB";
             f->position = f->orientation = "";
             f->pixels.resize(36);
         },
         {"/a.dcm", "colour image (RGB)"}},
        {"a colour picture of other size, last",
         "z.dcm",
         [](dicom_file *f) {
             f->samples = 3;
             f->photometric = "YBR_FULL";
             f->rows = 2;
             f->position = "";
         },
         {"/z.dcm", "YBR_FULL"}},
        {"a palette", "z.dcm", [](dicom_file *f) { f->photometric = "PALETTE COLOR"; }, {"/z.dcm", "PALETTE COLOR"}},
        {"a grey picture without a place",
         "a.dcm",
         [](dicom_file *f) { f->position = ""; },
         {"/a.dcm", "no ImagePositionPatient"}},
        {"a film",
         "a.dcm",
         [](dicom_file *f) {
             f->frames = "2";
             f->pixels.resize(24);
         },
         {"/a.dcm", "2 frames"}},
        {"a scout of other orientation",
         "a.dcm",
         [](dicom_file *f) { f->orientation = "0\\1\\0\\0\\0\\-1"; },
         {"/a.dcm", "ImageOrientationPatient differs"}},
        {"a scout of equal orientation",
         "z.dcm",
         [](dicom_file *f) {
             f->rows = 4;
             f->pixels.resize(16);
         },
         {"/z.dcm", "4 x 4 pixels", "4 x 3"}},
        {"a scout of equal size",
         "a.dcm",
         [](dicom_file *f) {
             f->image_type = "ORIGINAL\\PRIMARY\\LOCALIZER";
             f->position = "0\\0\\31";
         },
         {"/a.dcm", "LOCALIZER"}},
        {"other pixels", "a.dcm", [](dicom_file *f) { f->spacing = "1\\1"; }, {"/a.dcm", "PixelSpacing 1 x 1"}}};
    for (const auto &one : cases) {
        SCOPED_TRACE(one.what);
        temporary_folder folder;
        save_series(folder, 5);
        dicom_file stray;
        stray.instance = "1.2.3.99";
        one.change(&stray);
        save(folder / one.name, stray.bytes());
        expect_five_slices(folder, one.words);
    }
}

TEST(Stack, LeavesOutTwoScoutsOfOneOrientationAndAnEmptyFile)
{
    temporary_folder folder;
    save_series(folder, 5);
    dicom_file scout;
    scout.orientation = "0\\1\\0\\0\\0\\-1";
    for (const char *name : {"a1.dcm", "a2.dcm"}) {
        scout.instance += "1";
        save(folder / name, scout.bytes());
    }
    save(folder / "copied.dcm", "");
    expect_five_slices(folder, {"a1.dcm", "a2.dcm", "2 images of the series", "copied.dcm: is empty"});
}

TEST(Stack, WithoutALargerPartIsRefusedByName)
{
    temporary_folder folder;
    save_series(folder, 6, [](int n, dicom_file *f) {
        if (n % 2) f->orientation = "0\\1\\0\\0\\0\\-1";
    });
    expect_refused(folder.path(), PLIANT_ERROR_FORMAT, {"several sizes or orientations", "to another folder", "im7_1"});
    temporary_folder scouts; /* a series of scouts is a valid stack */
    save_series(scouts, 5, [](int, dicom_file *f) { f->image_type = "ORIGINAL\\PRIMARY\\LOCALIZER"; });
    expect_five_slices(scouts, {});
}

/* A missing slice leaves a gap. The refusal names both neighbours. */
TEST(Stack, AGapNamesTheOmittedImages)
{
    temporary_folder folder;
    save_series(folder, 5, [](int n, dicom_file *f) {
        if (n == 2) f->rows = 2;
    });
    expect_refused(folder.path(), PLIANT_ERROR_FORMAT,
                   {"1 slice(s) missing", "left out of the series", "im4_2: 4 x 2 pixels"});
    save(folder / "im4_2", "");
    expect_refused(folder.path(), PLIANT_ERROR_FORMAT, {"1 slice(s) missing"});
}

/* Rounded ImagePositionPatient: at most 5 % of a step or 0.1 mm from a regular position. */
TEST(Stack, PlacesThatAreRounded)
{
    const struct {
        double step;
        const char *format;
    } cases[] = {
        {1.25, "-10\\-20\\%.1f"}, {0.625, "-10\\-20\\%.1f"}, {1.0, "-10\\-20\\%.0f.04"}, {2.7, "-10\\-20\\%.1f"}};
    for (const auto &one : cases) {
        temporary_folder folder;
        save_series(folder, 16, [&](int n, dicom_file *f) {
            f->position = place(one.format, 30 + n * one.step);
            if (one.step == 1.0 && n % 2) f->position = place("-10\\-20\\%.2f", 30 + n - 0.04);
        });
        volume_holder scan;
        log_catcher log;
        ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
        EXPECT_NEAR(scan->geometry.spacing[2], 1e-3 * one.step, 5e-6);
        EXPECT_NEAR(scan->geometry.origin[2], 0.030, 5e-5);
        if (one.step < 2) expect_words(log.warnings(), {folder.path(), "rounded", "mm apart"});
    }
}

TEST(Stack, ObliquePlacesThatAreRounded)
{
    temporary_folder folder;
    save_series(folder, 12, [&](int n, dicom_file *f) {
        f->orientation = "0\\1\\0\\0.6\\0\\0.8"; /* the normal is (0.8, 0, -0.6) */
        f->position = place("%.1f\\5\\", 100 + 1.3 * n * 0.8) + place("%.1f", 50 - 1.3 * n * 0.6);
    });
    volume_holder scan;
    log_catcher log;
    ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    EXPECT_NEAR(scan->geometry.spacing[2], 0.0013, 1e-5);
    expect_words(log.warnings(), {"rounded"});
}

TEST(StackErrors, PlacesThatAreNotEven)
{
    const struct {
        const char *what;
        std::string (*position)(int);
        const char *word;
    } cases[] = {{"0.12 mm of jitter at 1 mm",
                  [](int n) { return place("-10\\-20\\%.3f", 30 + n + (n == 5 ? 0.14 : 0)); }, "not evenly spaced"},
                 {"a slice of rounded ones is missing",
                  [](int n) { return place("-10\\-20\\%.1f", 30 + (n + (n > 5)) * 1.25); }, "missing between"},
                 {"a slice of fine ones is missing",
                  [](int n) { return place("-10\\-20\\%.3f", 30 + (n + (n > 5)) * 0.05); }, "missing between"},
                 {"fine ones, uneven",
                  [](int n) { return place("-10\\-20\\%.3f", 30 + n * 0.05 + (n == 5 ? 0.02 : 0)); },
                  "not evenly spaced"},
                 {"gantry tilt of 2 degrees",
                  [](int n) { return place("-10\\%.3f\\", -20 + n * 0.035) + place("%.1f", 30 + n); }, "sheared"}};
    for (const auto &one : cases) {
        SCOPED_TRACE(one.what);
        temporary_folder folder;
        save_series(folder, 10, [&](int n, dicom_file *f) { f->position = one.position(n); });
        expect_refused(folder.path(), PLIANT_ERROR_FORMAT, {folder.path(), one.word});
    }
}

/* Without TransferSyntaxUID, all elements have types if the first one has a type. */
TEST(Stack, WithoutATransferSyntax)
{
    for (int variant = 0; variant < 8; variant++) {
        SCOPED_TRACE(variant);
        temporary_folder folder;
        save_series(folder, 5, [&](int, dicom_file *f) {
            f->syntax = "";
            f->has_types = variant & 1;
            f->has_preamble = variant & 2;
            f->has_meta = variant & 4;
        });
        expect_five_slices(folder, {});
    }
    temporary_folder folder; /* the file meta group may be present alone */
    save_series(folder, 5, [&](int, dicom_file *f) { f->has_preamble = false; });
    expect_five_slices(folder, {});
}

TEST(Padding, BecomesAir)
{
    const struct {
        const char *what;
        uint16_t stored, value, limit;
        bool is_signed;
        int bits;
    } cases[] = {{"65535", 65535, 65535, 65535, false, 16},
                 {"32767", 32767, 32767, 32767, true, 16},
                 {"32767 unsigned", 32767, 32767, 32767, false, 16},
                 {"-32768", 0x8000, 0x8000, 0x8000, true, 16},
                 {"-2000 as 63536", 63536, 63536, 63536, true, 16},
                 {"63536 unsigned", 63536, 63536, 63536, false, 16},
                 {"a range", 65500, 65000, 65535, false, 16},
                 {"a range, its limit first", 65500, 65535, 65000, false, 16},
                 {"-2000 to -1500", uint16_t(-1700), uint16_t(-2000), uint16_t(-1500), true, 16},
                 {"bits above the stored ones", 65535, 65535, 65535, false, 12},
                 {"the largest of 12 bits", 4095, 4095, 4095, false, 12},
                 {"0, which is -1024 HU", 0, 0, 0, false, 16}};
    for (const auto &one : cases) {
        SCOPED_TRACE(one.what);
        temporary_folder folder;
        save_series(folder, 3, [&](int, dicom_file *f) {
            f->pixels = {one.stored, 24, 1064, one.stored, 24, 1064, 1724, 24, one.stored, 24, 24, one.stored};
            f->is_signed = one.is_signed;
            f->bits_stored = uint16_t(one.bits);
            f->padding = dicom_file::number(one.value);
            if (one.limit != one.value) f->padding_limit = dicom_file::number(one.limit);
        });
        volume_holder scan;
        ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
        for (int corner = 0; corner < 4; corner++) EXPECT_EQ(scan.at(corner % 2 * 3, corner / 2 * 2, 1), -1024);
        EXPECT_EQ(scan.at(1, 0, 1), -1000);
        EXPECT_EQ(scan.at(2, 0, 1), 40);
        EXPECT_EQ(scan.at(2, 1, 1), 700);
        EXPECT_EQ(scan->encoding, PLIANT_INT16);
    }
}

TEST(Padding, ScaledSliceBySlice)
{
    temporary_folder folder;
    save_series(folder, 3, [&](int n, dicom_file *f) {
        f->pixels.assign(12, uint16_t(1064 + n));
        f->pixels[0] = 65535;
        f->intercept = std::to_string(-1024 - n);
        f->padding = dicom_file::number(65535);
    });
    volume_holder scan;
    ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    for (int k = 0; k < 3; k++) {
        EXPECT_EQ(scan.at(0, 0, k), -1024);
        EXPECT_EQ(scan.at(1, 0, k), 40);
    }
}

/* A declared padding value is no padding if it lies between other values and occurs in no corner. */
TEST(Padding, AValueOfTheImageItselfIsLeftAsItIs)
{
    temporary_folder folder;
    save_series(folder, 3, [&](int, dicom_file *f) {
        f->pixels = {24, 24, 24, 24, 24, 1064, 1724, 24, 24, 24, 24, 24};
        f->padding = dicom_file::number(1064);
    });
    volume_holder scan;
    log_catcher log;
    ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(scan.at(1, 1, 1), 40);
    expect_words(log.warnings(), {"PixelPaddingValue", "not changed"});
}

/* Dark padding of an MR keeps its value. Bright padding gets the darkest value. */
TEST(Padding, OfAnMr)
{
    for (uint16_t padding : {0, 4000}) {
        temporary_folder folder;
        save_series(folder, 3, [&](int, dicom_file *f) {
            f->modality = "MR";
            f->intercept = f->slope = "";
            f->pixels.assign(12, 500);
            f->pixels[0] = padding;
            f->pixels[5] = 30;
            f->padding = dicom_file::number(padding);
        });
        volume_holder scan;
        ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(scan.at(0, 0, 1), padding ? 30 : 0);
        EXPECT_EQ(scan.at(1, 0, 1), 500);
    }
}

TEST(Rescale, ACtWithoutItIsWarnedOfAndNoCtForTheBuiltInTable)
{
    temporary_folder folder;
    auto change = [](int n, dicom_file *f) {
        f->pixels = {24, 24, 24, 24, 24, 1064, 1724, 24, 24, 24, 24, 24};
        f->intercept = f->slope = "";
        if (n < 0) f->intercept = "-1024";
    };
    save_series(folder, 3, change);
    volume_holder scan, padded, right;
    {
        log_catcher log;
        ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
        expect_words(log.warnings(), {"RescaleIntercept"});
    }
    EXPECT_EQ(pliant_material_default_check(&scan.volume), PLIANT_ERROR_MATERIAL);
    EXPECT_NE(std::strstr(pliant_last_error(), "RescaleIntercept"), nullptr) << pliant_last_error();

    /* padding far below zero is not air */
    save_series(folder, 3, [&](int n, dicom_file *f) {
        change(n, f);
        f->is_signed = 1;
        f->pixels[0] = 63536;
        f->padding = dicom_file::number(63536);
    });
    ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &padded), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(padded.at(0, 0, 0), 24);
    EXPECT_EQ(pliant_material_default_check(&padded.volume), PLIANT_ERROR_MATERIAL);

    save_series(folder, 3, [&](int n, dicom_file *f) { change(-1 - n, f); });
    ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &right), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(pliant_material_default_check(&right.volume), PLIANT_OK) << pliant_last_error();
    save_series(folder, 3, [&](int n, dicom_file *f) { change(n == 1 ? 1 : -1, f); });
    expect_refused(folder.path(), PLIANT_ERROR_FORMAT, {"some images", "RescaleIntercept", "others have none"});
}

TEST(Objects, AreRefusedByNameWithARemedy)
{
    temporary_folder folder;
    const std::string root = "1.2.840.10008.5.1.4.1.1.";
    dicom_file file;
    file.object = root + "66.4";
    file.bits_allocated = file.bits_stored = 1;
    save(folder / "seg.dcm", file.bytes());
    expect_refused(folder / "seg.dcm", PLIANT_ERROR_FORMAT,
                   {"seg.dcm", "DICOM segmentation (SEG)", "material/labels", "export it as NIfTI"});
    expect_refused(folder.path(), PLIANT_ERROR_FORMAT,
                   {"seg.dcm", "DICOM segmentation (SEG)", "material/labels", "export it as NIfTI"});
    unlink((folder / "seg.dcm").c_str());

    dicom_file contours;
    contours.object = root + "481.3";
    contours.rows = contours.columns = 0;
    contours.pixels.clear();
    save(folder / "rs.dcm", contours.bytes());
    expect_refused(folder / "rs.dcm", PLIANT_ERROR_FORMAT, {"rs.dcm", "RTSTRUCT", "3D Slicer", "plastimatch convert"});
    expect_refused(folder.path(), PLIANT_ERROR_FORMAT, {"rs.dcm", "RTSTRUCT", "3D Slicer", "plastimatch convert"});

    for (uint16_t element : {8, 9}) {
        temporary_folder floats;
        save_series(floats, 3, [&](int, dicom_file *f) { f->pixel_element = element; });
        expect_refused(floats.path(), PLIANT_ERROR_FORMAT,
                       {element == 8 ? "are FloatPixelData" : "are DoubleFloatPixelData", "convert it to NIfTI"});
    }
}

/* Archives keep dose reports and segmentations in separate series. */
TEST(Stack, SeriesOfPicturesNeedNoChoice)
{
    temporary_folder folder;
    save_series(folder, 5);
    dicom_file report, segmentation;
    report.series = "1.2.3.7";
    report.samples = 3;
    report.photometric = "RGB";
    report.pixels.resize(36);
    save(folder / "a.dcm", report.bytes());
    segmentation.series = "1.2.3.8";
    segmentation.object = "1.2.840.10008.5.1.4.1.1.66.4";
    save(folder / "b.dcm", segmentation.bytes());
    expect_five_slices(folder, {folder.path(), "only series that can be a volume", "1.2.3.1", "1.2.3.7", "1.2.3.8"});
    report.samples = 1;
    report.photometric = "MONOCHROME2";
    save(folder / "a.dcm", report.bytes());
    expect_refused(folder.path(), PLIANT_ERROR_FORMAT, {"3 series", "scan/series=UID"});
}
