/* Synthetic multi-frame DICOM files (enhanced CT and MR, legacy converted), and MONOCHROME1. */
#include "scan/volume.h"
#include "scan_files.h"

#include <algorithm>
#include <cmath>

namespace {

const char *const EXPLICIT = "1.2.840.10008.1.2.1", *const IMPLICIT = "1.2.840.10008.1.2",
                  *const RLE = "1.2.840.10008.1.2.5";
const char *const ENHANCED_CT = "1.2.840.10008.5.1.4.1.1.2.1", *const ENHANCED_MR = "1.2.840.10008.5.1.4.1.1.4.1",
                  *const LEGACY_CT = "1.2.840.10008.5.1.4.1.1.2.2";

std::string words(std::initializer_list<uint32_t> values) { return bytes_of(std::vector<uint32_t>(values)); }

struct frame {
    std::string position, orientation, slope, intercept; /* "": in the shared group, or missing */
    std::vector<uint16_t> pixels = std::vector<uint16_t>(12, 0);
};

/* A multi-frame file. Its sequences have lengths or end delimiters. */
struct enhanced_file {
    std::string syntax = EXPLICIT, uid = ENHANCED_CT, modality = "CT", series = "1.2.3.1", instance = "1.2.3.4.1";
    std::string photometric = "MONOCHROME2", number_of_frames;
    std::string orientation = "1\\0\\0\\0\\1\\0", spacing = "0.5\\0.75", slope, intercept;
    /* end delimiters instead of lengths; groups of type UN, as from programs that do not know these groups */
    bool marks = false, unknown = false;
    int fragments = 1;                   /* RLE: fragments per frame */
    bool offsets = false;                /* RLE: with an offset table */
    std::vector<frame> frames;
    std::vector<std::string> images;     /* images from another encoder, one per frame */
    uint16_t rows = 3, columns = 4, bits_stored = 16, is_signed = 0;

    std::string element(uint32_t tag, const std::string &type, std::string value, bool implicit) const
    {
        if (value.size() % 2) value += type == "UI" ? '\0' : ' ';
        std::string head = bytes_of(std::vector<uint16_t>{uint16_t(tag >> 16), uint16_t(tag)});
        if (implicit) return head + words({uint32_t(value.size())}) + value;
        bool is_long = type == "SQ" || type == "UN" || type == "OW" || type == "OB";
        if (is_long) return head + type + std::string(2, '\0') + words({uint32_t(value.size())}) + value;
        return head + type + bytes_of(std::vector<uint16_t>{uint16_t(value.size())}) + value;
    }
    static std::string item(const std::string &value, bool marks)
    {
        const std::string start("\xfe\xff\x00\xe0", 4), end("\xfe\xff\x0d\xe0", 4);
        return marks ? start + words({0xffffffff}) + value + end + words({0})
                     : start + words({uint32_t(value.size())}) + value;
    }
    std::string sequence(uint32_t tag, const std::string &items, bool implicit) const
    {
        const std::string end("\xfe\xff\xdd\xe0", 4),
            head = bytes_of(std::vector<uint16_t>{uint16_t(tag >> 16), uint16_t(tag)});
        if (unknown || !marks) return element(tag, unknown && !implicit ? "UN" : "SQ", items, implicit);
        return head + (implicit ? "" : std::string("SQ\0\0", 4)) + words({0xffffffff}) + items + end + words({0});
    }
    std::string group(const frame &of, bool shared) const
    {
        const bool implicit = syntax == IMPLICIT || unknown;
        auto one = [&](uint32_t tag, const std::string &inside) {
            return inside.empty() ? "" : sequence(tag, item(inside, marks), implicit);
        };
        auto text = [&](uint32_t tag, const std::string &value) {
            return value.empty() ? "" : element(tag, "DS", value, implicit);
        };
        std::string out = one(0x00209111, element(0x00209056, "SH", "1", implicit)) +
                          one(0x00209113, text(0x00200032, of.position)) +
                          one(0x00209116, text(0x00200037, of.orientation));
        if (shared) out += one(0x00289110, text(0x00180050, "7") + text(0x00280030, spacing));
        return item(out + one(0x00289145, text(0x00281052, of.intercept) + text(0x00281053, of.slope)), marks);
    }
    static std::string run_length(const std::string &plane)
    {
        std::string out("\x80", 1); /* a no-op in RLE */
        for (size_t at = 0; at < plane.size();) {
            size_t count = std::min(plane.find_first_not_of(plane[at], at), plane.size()) - at;
            if (count > 1) out += {char(257 - count), plane[at]}; /* a repeated byte */
            else out += {char(0), plane[at]};                     /* a literal byte */
            at += count;
        }
        return out.size() % 2 ? out + '\0' : out;
    }
    static std::string compressed(const std::vector<uint16_t> &pixels)
    {
        std::string high, low;
        for (uint16_t value : pixels) high += char(value >> 8), low += char(value & 0xff);
        high = run_length(high);
        low = run_length(low);
        std::string head = words({2, 64, uint32_t(64 + high.size())});
        return head + std::string(64 - head.size(), '\0') + high + low;
    }
    std::string pixel_data() const
    {
        std::string all, table;
        if (images.empty() && syntax != RLE) {
            for (const frame &one : frames) all += bytes_of(one.pixels);
            return element(0x7fe00010, "OW", all, syntax == IMPLICIT);
        }
        for (size_t f = 0; f < frames.size(); f++) {
            std::string image = images.empty() ? compressed(frames[f].pixels) : images[f];
            if (offsets) table += words({uint32_t(all.size())});
            for (int part = 0; part < fragments; part++) {
                size_t from = image.size() * size_t(part) / size_t(fragments) / 2 * 2,
                       to = image.size() * size_t(part + 1) / size_t(fragments) / 2 * 2;
                all += item(image.substr(from, to - from), false);
            }
        }
        return bytes_of(std::vector<uint16_t>{0x7fe0, 0x10}) + std::string("OB\0\0", 4) + words({0xffffffff}) +
               item(table, false) + all + std::string("\xfe\xff\xdd\xe0", 4) + words({0});
    }
    std::string bytes() const
    {
        const bool implicit = syntax == IMPLICIT;
        auto number = [](uint16_t value) { return bytes_of(std::vector<uint16_t>{value}); };
        auto one = [&](uint32_t tag, const char *type, const std::string &value) {
            return element(tag, type, value, implicit);
        };
        std::string meta = element(0x00020002, "UI", uid, false) + element(0x00020010, "UI", syntax, false);
        std::string out =
            std::string(128, '\0') + "DICM" + element(0x00020000, "UL", words({uint32_t(meta.size())}), false) + meta;
        out += one(0x00080016, "UI", uid) + one(0x00080018, "UI", instance) + one(0x00080060, "CS", modality) +
               one(0x0020000e, "UI", series) + one(0x00280002, "US", number(1)) + one(0x00280004, "CS", photometric) +
               one(0x00280008, "IS", number_of_frames.empty() ? std::to_string(frames.size()) : number_of_frames) +
               one(0x00280010, "US", number(rows)) + one(0x00280011, "US", number(columns)) +
               one(0x00280100, "US", number(16)) + one(0x00280101, "US", number(bits_stored)) +
               one(0x00280102, "US", number(uint16_t(bits_stored - 1))) + one(0x00280103, "US", number(is_signed));
        frame all;
        all.orientation = orientation;
        all.slope = slope;
        all.intercept = intercept;
        std::string groups;
        for (const frame &of : frames) groups += group(of, false);
        out += sequence(0x52009229, group(all, true), implicit);
        if (!frames.empty()) out += sequence(0x52009230, groups, implicit);
        return out + pixel_data();
    }
};

/* Frames 2 mm apart along z, in the order 2 0 3 1 in the file. The frame at position n holds 100 n, and 1024 + n in its
 * second pixel. */
enhanced_file four_frames()
{
    enhanced_file file;
    file.intercept = "-1024";
    file.slope = "1";
    for (int n : {2, 0, 3, 1}) {
        frame one;
        one.position = "-10\\-20\\" + std::to_string(30 + 2 * n);
        std::fill(one.pixels.begin(), one.pixels.end(), uint16_t(100 * n));
        one.pixels[1] = uint16_t(1024 + n);
        file.frames.push_back(one);
    }
    return file;
}

void expect_four_frames(const std::string &path)
{
    SCOPED_TRACE(path);
    volume_holder scan;
    ASSERT_EQ(pliant_volume_read(path.c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    const int32_t size[3] = {4, 3, 4};
    const double spacing[3] = {0.00075, 0.0005, 0.002}, origin[3] = {-0.010, -0.020, 0.030};
    for (int d = 0; d < 3; d++) {
        EXPECT_EQ(scan->geometry.size[d], size[d]);
        EXPECT_NEAR(scan->geometry.spacing[d], spacing[d], 1e-12);
        EXPECT_NEAR(scan->geometry.origin[d], origin[d], 1e-12);
    }
    EXPECT_EQ(scan->encoding, PLIANT_INT16);
    EXPECT_EQ(scan->modality, PLIANT_MODALITY_CT);
    for (int k = 0; k < 4; k++) {
        EXPECT_EQ(scan.at(0, 0, k), 100 * k - 1024);
        EXPECT_EQ(scan.at(1, 0, k), k);
        EXPECT_EQ(scan.at(3, 2, k), 100 * k - 1024);
    }
}

} // namespace

TEST(Enhanced, FramesAreSortedByTheirPlaces)
{
    for (const char *syntax : {EXPLICIT, IMPLICIT, RLE})
        for (bool marks : {false, true}) {
            SCOPED_TRACE(std::string(syntax) + (marks ? " marks" : " lengths"));
            temporary_folder folder;
            enhanced_file file = four_frames();
            file.syntax = syntax;
            file.marks = marks;
            save(folder / "scan.dcm", file.bytes());
            expect_four_frames(folder / "scan.dcm");
            expect_four_frames(folder.path());
        }
}

TEST(Enhanced, LegacyConvertedAndGroupsOfUnknownType)
{
    temporary_folder folder;
    enhanced_file file = four_frames();
    file.uid = LEGACY_CT;
    file.unknown = true;
    save(folder / "scan.dcm", file.bytes());
    expect_four_frames(folder.path());
}

TEST(Enhanced, FrameAttributesPrecedeSharedOnes)
{
    temporary_folder folder;
    enhanced_file file = four_frames();
    file.uid = ENHANCED_MR;
    file.modality = "MR";
    file.orientation = "0\\1\\0\\1\\0\\0";
    for (size_t f = 0; f < 4; f++) {
        file.frames[f].orientation = "1\\0\\0\\0\\1\\0";
        file.frames[f].slope = std::to_string(f + 1) + ".5";
        file.frames[f].intercept = std::to_string(10 * f);
    }
    save(folder / "scan.dcm", file.bytes());
    volume_holder scan;
    ASSERT_EQ(pliant_volume_read((folder / "scan.dcm").c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(scan->modality, PLIANT_MODALITY_MR);
    EXPECT_EQ(scan->encoding, PLIANT_FLOAT32);
    const int place[4] = {2, 0, 3, 1};
    for (int f = 0; f < 4; f++) EXPECT_EQ(scan.at(0, 0, place[f]), (f + 1.5f) * 100 * place[f] + 10 * f);
}

TEST(Enhanced, OneVolumeInSeveralFiles)
{
    temporary_folder folder;
    for (int half = 0; half < 2; half++) { /* a concatenation; a file of one frame also has functional groups */
        enhanced_file file = four_frames();
        file.instance += std::to_string(half);
        if (half) file.frames = {file.frames[3]};
        else file.frames.pop_back();
        save(folder / ("part" + std::to_string(half)), file.bytes());
    }
    expect_four_frames(folder.path());
}

TEST(Enhanced, CompressedFramesOfSeveralFragments)
{
    temporary_folder folder;
    enhanced_file file = four_frames();
    file.syntax = RLE;
    file.fragments = 3;
    file.offsets = true;
    std::string bytes = file.bytes();
    save(folder / "scan.dcm", bytes);
    expect_four_frames(folder / "scan.dcm");
    size_t table = bytes.find(std::string("\xfe\xff\x00\xe0\x10\x00\x00\x00", 8)) + 8;
    for (uint32_t wrong : {0u, 2u, 0xfffffff0u}) {
        std::string broken = bytes;
        broken.replace(table + 4, 4, words({wrong}));
        save(folder / "scan.dcm", broken);
        expect_refused(folder / "scan.dcm", PLIANT_ERROR_FORMAT, {"scan.dcm", "table of offsets"});
    }
    file.offsets = false;
    save(folder / "scan.dcm", file.bytes());
    expect_refused(folder / "scan.dcm", PLIANT_ERROR_FORMAT, {"scan.dcm", "4 frames in 12 compressed fragments"});
}

TEST(EnhancedErrors, FilesWithoutAVolume)
{
    struct { const char *what; void (*change)(enhanced_file *); std::vector<std::string> words;
    } cases[] = {
        {"more frames than groups",
         [](enhanced_file *f) { f->number_of_frames = "5"; },
         {"NumberOfFrames is 5", "4 items"}},
        {"fewer", [](enhanced_file *f) { f->number_of_frames = "3"; }, {"NumberOfFrames is 3", "4 items"}},
        {"a thousand million", [](enhanced_file *f) { f->number_of_frames = "1000000000"; }, {"1000000000"}},
        {"none", [](enhanced_file *f) { f->number_of_frames = "0"; }, {"NumberOfFrames is 0"}},
        {"fewer than none", [](enhanced_file *f) { f->number_of_frames = "-4"; }, {"NumberOfFrames is -4"}},
        {"a part of one", [](enhanced_file *f) { f->number_of_frames = "4.5"; }, {"NumberOfFrames is 4.5"}},
        {"words", [](enhanced_file *f) { f->number_of_frames = "many"; }, {"NumberOfFrames", "many"}},
        {"no groups",
         [](enhanced_file *f) {
             f->frames.clear();
             f->number_of_frames = "4";
         },
         {"4 frames", "no functional groups"}},
        {"a frame without a place",
         [](enhanced_file *f) { f->frames[2].position = ""; },
         {"scan.dcm frame 3", "no ImagePositionPatient"}},
        {"no orientation",
         [](enhanced_file *f) { f->orientation = ""; },
         {"scan.dcm frame 1", "no ImageOrientationPatient"}},
        {"no spacing", [](enhanced_file *f) { f->spacing = ""; }, {"scan.dcm frame 1", "no PixelSpacing"}},
        {"two at one place",
         [](enhanced_file *f) { f->frames[2].position = f->frames[1].position; },
         {"frame 2", "frame 3", "same position", "time points"}},
        {"another stack",
         [](enhanced_file *f) { f->frames[1].orientation = "0\\1\\0\\1\\0\\0"; },
         {"frame 2", "ImageOrientationPatient differs"}},
        {"a frame is missing", [](enhanced_file *f) { f->frames.erase(f->frames.begin()); }, {"1 slice(s) missing"}},
        {"slope 0", [](enhanced_file *f) { f->frames[3].slope = "0"; }, {"scan.dcm frame 4", "RescaleSlope is 0"}},
        {"pixels of three",
         [](enhanced_file *f) { f->frames[3].pixels.clear(); },
         {"truncated", "4 frame(s) need 96 bytes", "has 72"}}};
    for (const auto &one : cases) {
        SCOPED_TRACE(one.what);
        temporary_folder folder;
        enhanced_file file = four_frames();
        one.change(&file);
        save(folder / "scan.dcm", file.bytes());
        std::vector<std::string> words_wanted = one.words;
        words_wanted.push_back(folder.path());
        expect_refused(folder.path(), PLIANT_ERROR_FORMAT, words_wanted);
        expect_refused(folder / "scan.dcm", PLIANT_ERROR_FORMAT, words_wanted);
    }
}

TEST(EnhancedErrors, EveryTruncation)
{
    for (const char *syntax : {EXPLICIT, RLE}) {
        temporary_folder folder;
        enhanced_file file = four_frames();
        file.syntax = syntax;
        file.marks = std::string(syntax) == RLE;
        const std::string bytes = file.bytes();
        for (size_t length = 132; length < bytes.size(); length++) {
            save(folder / "z.dcm", bytes.substr(0, length));
            expect_refused(folder / "z.dcm", PLIANT_ERROR_FORMAT, {folder / "z.dcm"});
        }
    }
}

/* For any wrong byte of the header, the file is read or refused, and no memory leaks. */
TEST(EnhancedErrors, EveryBrokenByte)
{
    for (const char *syntax : {EXPLICIT, IMPLICIT, RLE}) {
        temporary_folder folder;
        enhanced_file file = four_frames();
        file.syntax = syntax;
        file.marks = std::string(syntax) == RLE;
        const std::string bytes = file.bytes();
        const size_t in_use = pliant_memory_in_use();
        pliant_memory_reset_peak();
        for (size_t at = 132; at < bytes.size(); at++)
            for (char wrong : {'\xff', '\0', '\x7f'}) {
                std::string broken = bytes;
                if (broken[at] == wrong) continue;
                broken[at] = wrong;
                save(folder / "z.dcm", broken);
                volume_holder scan;
                pliant_status status = pliant_volume_read((folder / "z.dcm").c_str(), nullptr, 0, &scan);
                EXPECT_TRUE(status == PLIANT_OK || status == PLIANT_ERROR_FORMAT || status == PLIANT_ERROR_MEMORY ||
                            status == PLIANT_ERROR_FILE)
                    << at << ": " << pliant_last_error();
            }
        EXPECT_EQ(pliant_memory_in_use(), in_use);
        EXPECT_LT(pliant_memory_peak(), 8u << 20) << "65535 rows are possible where pixels are compressed";
    }
}

/* MONOCHROME1 is about the display: Hounsfield units stay unchanged, but intensities of an MR are inverted. */
TEST(Monochrome1, TurnsIntensitiesRoundAndNoHounsfieldUnits)
{
    temporary_folder folder;
    enhanced_file file = four_frames();
    file.photometric = "MONOCHROME1";
    save(folder / "scan.dcm", file.bytes());
    expect_four_frames(folder / "scan.dcm");
    file.modality = "MR";
    for (bool alike : {true, false}) {
        if (!alike) file.frames[0].intercept = "-1023";
        save(folder / "scan.dcm", file.bytes());
        volume_holder scan;
        ASSERT_EQ(pliant_volume_read((folder / "scan.dcm").c_str(), nullptr, 0, &scan), PLIANT_OK)
            << pliant_last_error();
        const float smallest = -1024, largest = 3;
        for (int k = 0; k < 4; k++)
            EXPECT_EQ(scan.at(0, 0, k), smallest + largest - (100 * k - 1024 + (k == 2 && !alike))) << k;
        EXPECT_EQ(scan->background, smallest);
    }
    file.photometric = "MONOCHROME2";
    file.series = "1.2.3.1";
    file.instance = "1.2.3.9";
    for (frame &one : file.frames) one.position += "0";
    save(folder / "other.dcm", file.bytes());
    expect_refused(folder.path(), PLIANT_ERROR_FORMAT, {"MONOCHROME1", "MONOCHROME2"});
}

/* Slices of a JPEG 2000 series as frames of one file give the same voxels. */
TEST(EnhancedSharedData, Jpeg2000FramesAreThoseOfTheSeries)
{
    const std::string series =
        PLIANT_TEST_DATA "/loader/dicom_jpeg2000_abdomen/CT.1.3.12.2.1107.5.1.4.60064.300000221208081134280000165";
    temporary_folder folder, single;
    enhanced_file file;
    file.syntax = "1.2.840.10008.1.2.4.90";
    file.rows = file.columns = 512;
    file.spacing = "0.9765625\\0.9765625";
    file.slope = "1";
    file.intercept = "-1024";
    for (int n = 73; n < 76; n++) {
        std::string bytes = load(series + std::to_string(n));
        if (bytes.empty()) GTEST_SKIP() << "the shared test data is not at " PLIANT_TEST_DATA;
        save(single / std::to_string(n), bytes);
        auto value = [&](const std::string &tag) {
            size_t at = bytes.find(tag);
            size_t length = static_cast<unsigned char>(bytes[at + 6]);
            return bytes.substr(at + 8, length);
        };
        frame one;
        one.position = value(std::string("\x20\0\x32\0DS", 6));
        file.orientation = value(std::string("\x20\0\x37\0DS", 6));
        file.bits_stored = static_cast<unsigned char>(value(std::string("\x28\0\x01\x01US", 6))[0]);
        file.is_signed = static_cast<unsigned char>(value(std::string("\x28\0\x03\x01US", 6))[0]);
        size_t pixels = bytes.find(std::string("\xe0\x7f\x10\0OB", 6)), at = pixels + 12, length;
        ASSERT_NE(pixels, std::string::npos);
        std::string image;
        for (bool table = true; bytes.compare(at, 4, "\xfe\xff\xdd\xe0") != 0; table = false, at += 8 + length) {
            uint32_t told;
            std::memcpy(&told, &bytes[at + 4], 4);
            length = told;
            if (!table) image += bytes.substr(at + 8, length);
        }
        file.images.push_back(image);
        file.frames.push_back(one);
    }
    save(folder / "scan.dcm", file.bytes());
    volume_holder frames, slices;
    ASSERT_EQ(pliant_volume_read((folder / "scan.dcm").c_str(), nullptr, 0, &frames), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_volume_read(single.path().c_str(), nullptr, 0, &slices), PLIANT_OK) << pliant_last_error();
    EXPECT_TRUE(pliant_geometry_equal(&frames->geometry, &slices->geometry));
    ASSERT_EQ(frames->encoding, PLIANT_INT16);
    EXPECT_EQ(std::memcmp(frames->voxels, slices->voxels, 2 * pliant_geometry_voxels(&slices->geometry)), 0);
}
