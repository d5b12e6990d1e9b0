/* Compressed pixels of DICOM: numbers of few bits stored in many, damaged images, unsupported codecs. OpenJPEG, CharLS
 * and libjpeg encoded the images: 4 x 3 numbers of 8 bits, or of 5. */
#include "scan_files.h"

#include <cmath>

namespace
{

const int NUMBERS[12] = {7, 200, 3, 0, 255, 128, 127, 1, 90, 91, 92, 9};

const std::string JPEG_2000_HEAD =
    "ff4fff51002900000000000400000003000000000000000000000004000000030000000000000000000107";
const std::string JPEG_2000_TAIL =
    "0101ff52000c00000001000004040001ff5c00044040ff90000a0000000000200001ff93df80781d176497069007eb42eb49fcbcff7fffd9";

struct codec {
    const char *name, *syntax;
    int bits;
    std::string image;
};

std::vector<codec> codecs()
{
    return {{"JPEG 2000", "1.2.840.10008.1.2.4.90", 8, from_hex(JPEG_2000_HEAD + JPEG_2000_TAIL)},
            {"JPEG-LS", "1.2.840.10008.1.2.4.80", 8,
             from_hex("ffd8fff7000b080003000401011100ffda00080101000000000a000002fa000002e8c3800000fe800000fb000000faad"
                      "ed1cffd9")},
            {"JPEG", "1.2.840.10008.1.2.4.70", 8,
             from_hex("ffd8ffc4001800010101010100000000000000000000000806050207ffc3000b080003000401001100ffda0008010000"
                      "060000f06608eb87c0ed41045aae"
                      "cfdaffd9")},
            {"JPEG of 5 bits", "1.2.840.10008.1.2.4.70", 5,
             from_hex("ffd8ffc400190001010100030000000000000000000000050300010208ffc3000b080003000401001100ffda00080100"
                      "00060000f3fb2367c75205d7"
                      "8ee0ffd9")}};
}

void save_coded(const temporary_folder &folder, const codec &codec, int allocated, int stored, bool is_signed)
{
    save_series(folder, 2, [&](int, dicom_file *file) {
        file->syntax = codec.syntax;
        file->code = codec.image;
        file->bits_allocated = uint16_t(allocated);
        file->bits_stored = uint16_t(stored);
        file->is_signed = is_signed;
        file->intercept = "0";
    });
}

} // namespace

/* The header may store numbers in more bits than they have. The highest stored bit is the sign. */
TEST(Codecs, FewBitsStoredInMany)
{
    for (const codec &codec : codecs())
        for (int allocated : {8, 16, 32})
            for (int stored : {5, 8, 12, 16, 32})
                for (bool is_signed : {false, true}) {
                    if (stored > allocated || stored < codec.bits) continue;
                    SCOPED_TRACE(testing::Message()
                                 << codec.name << " " << stored << " in " << allocated << (is_signed ? " signed" : ""));
                    temporary_folder folder;
                    save_coded(folder, codec, allocated, stored, is_signed);
                    volume_holder scan;
                    ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &scan), PLIANT_OK)
                        << pliant_last_error();
                    for (int n = 0; n < 12; n++) {
                        const int number = NUMBERS[n] >> (8 - codec.bits),
                                  above = is_signed && stored == codec.bits && number >> (stored - 1) ? 1 << stored : 0;
                        EXPECT_EQ(scan.at(n % 4, n / 4, 1), float(number - above));
                    }
                }
}

TEST(Codecs, Jpeg2000WithASignOfItsOwn)
{
    codec codec = codecs()[0];
    codec.image[42] = '\x87'; /* numbers from -128 to 127 */
    temporary_folder folder;
    save_coded(folder, codec, 16, 16, true);
    volume_holder scan;
    ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &scan), PLIANT_OK) << pliant_last_error();
    for (int n = 0; n < 12; n++) EXPECT_EQ(scan.at(n % 4, n / 4, 1), float(NUMBERS[n] - 128));
}

/* Writers also produce JP2 files with boxes, comments, and padding at the end. */
TEST(Codecs, BytesAroundAnImage)
{
    for (codec codec : codecs()) {
        if (std::string(codec.name) == "JPEG 2000")
            codec.image = std::string("\0\0\0\x0cjP  \r\n\x87\n", 12) + codec.image;
        else
            codec.image.insert(2, std::string("\xff\xfe\0\x06made", 8));
        codec.image += std::string(3, '\0');
        temporary_folder folder;
        save_coded(folder, codec, 16, 8, false);
        volume_holder scan;
        ASSERT_EQ(pliant_volume_read(folder.path().c_str(), nullptr, 0, &scan), PLIANT_OK)
            << codec.name << pliant_last_error();
        EXPECT_EQ(scan.at(1, 0, 0), float(NUMBERS[1] >> (8 - codec.bits)));
    }
}

class DamagedImages : public testing::TestWithParam<codec>
{
};

/* GDCM ends its process on some of these. So the test runs it in a child process. */
TEST_P(DamagedImages, EveryTruncationAndBrokenByte)
{
    const codec &whole = GetParam();
    for (size_t length = 1; length < whole.image.size(); length++) {
        codec cut = whole;
        cut.image.resize(length);
        temporary_folder folder;
        save_coded(folder, cut, 16, 16, false);
        expect_refused(folder.path(), PLIANT_ERROR_FORMAT, {folder.path(), "damaged"});
    }
    for (size_t at = 0; at < whole.image.size(); at++)
        for (char wrong : {'\0', '\xff', '\x41'}) {
            codec broken = whole;
            broken.image[at] = wrong;
            temporary_folder folder;
            save_coded(folder, broken, 16, 16, false);
            volume_holder scan;
            testing::internal::CaptureStderr();
            const pliant_status status = pliant_volume_read(folder.path().c_str(), nullptr, 0, &scan);
            EXPECT_EQ(testing::internal::GetCapturedStderr(), "") << at;
            EXPECT_TRUE(status == PLIANT_OK || status == PLIANT_ERROR_FORMAT) << at << pliant_last_error();
        }
}

INSTANTIATE_TEST_SUITE_P(Codecs, DamagedImages, testing::ValuesIn(codecs()),
                         [](const testing::TestParamInfo<codec> &info) {
                             std::string name;
                             for (const char letter : std::string(info.param.name))
                                 if (std::isalnum(static_cast<unsigned char>(letter))) name += letter;
                             return name;
                         });

TEST(CodecErrors, ImagesThatAreNotWhatTheHeaderSays)
{
    for (const codec &codec : codecs())
        for (int wrong = 0; wrong < 3; wrong++) {
            temporary_folder folder;
            save_series(folder, 2, [&](int, dicom_file *file) {
                file->syntax = codec.syntax;
                file->code = codec.image;
                if (wrong == 0) file->rows = 4;
                if (wrong == 1) file->columns = 5;
                if (wrong == 2) file->code = "no image";
            });
            expect_refused(folder.path(), PLIANT_ERROR_FORMAT, {folder.path(), "damaged"});
        }
}

TEST(CodecErrors, ByNameAndWithARemedy)
{
    const struct {
        const char *syntax;
        std::vector<std::string> words;
    } cases[] = {{"1.2.840.10008.1.2.4.201", {"HTJ2K", "high-throughput JPEG 2000", "gdcmconv --raw", "NIfTI"}},
                 {"1.2.840.10008.1.2.4.203", {"HTJ2K"}},
                 {"1.2.840.10008.1.2.4.100", {"MPEG-2", "NIfTI"}},
                 {"1.2.840.10008.1.2.4.102", {"MPEG-4", "NIfTI"}},
                 {"1.2.840.10008.1.2.4.107", {"HEVC"}},
                 {"1.2.840.10008.1.2.4.110", {"JPEG XL"}},
                 {"1.2.840.10008.1.2.4.94", {"JPIP"}},
                 {"1.2.840.10008.1.2.1", {"no known compression", "TransferSyntaxUID"}},
                 {"1.2.840.10008.1.2.2", {"big-endian", "dcmconv"}},
                 {"1.2.3.4", {"transfer syntax \"1.2.3.4\"", "gdcmconv"}}};
    for (const auto &one : cases) {
        codec codec = codecs()[0];
        codec.syntax = one.syntax;
        temporary_folder folder;
        save_coded(folder, codec, 16, 8, false);
        std::vector<std::string> words = one.words;
        words.push_back("not supported");
        expect_refused(folder.path(), PLIANT_ERROR_FORMAT, words);
    }
}
