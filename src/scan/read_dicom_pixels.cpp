/* The numbers of one DICOM image: as they are in the file, RLE, or decompressed by the GDCM that ITK reads DICOM with. */
#include "scan/read_dicom.h"

#include <gdcmImageReader.h>
#include <gdcmTrace.h>

#include <cstring>
#include <mutex>
#include <sstream>

namespace pliant_read {

component dicom_pixels::type() const
{
    if (bits_allocated == 8) return is_signed ? component::int8 : component::uint8;
    if (bits_allocated == 16) return is_signed ? component::int16 : component::uint16;
    if (bits_allocated == 32) return is_signed ? component::int32 : component::uint32;
    return component::none;
}

namespace {

std::string file_part(const std::string &path, const dicom_file::part &part)
{
    std::string bytes(static_cast<size_t>(part.length), '\0');
    std::ifstream file = open_file(path);
    file.seekg(static_cast<std::streamoff>(part.offset));
    file.read(&bytes[0], static_cast<std::streamsize>(part.length));
    if (!file) fail(PLIANT_ERROR_FILE, "%s: its pixels cannot be read", path.c_str());
    return bytes;
}

/* Bits above the stored ones do not count (overlays lie there in old files). */
template <class Number> void clean_bits(int stored, size_t count, Number *values)
{
    const int above = static_cast<int>(8 * sizeof(Number)) - stored;
    if (above == 0) return;
    const Number scale = static_cast<Number>(Number(1) << above);
    for (size_t n = 0; n < count; n++) {
        typename std::make_unsigned<Number>::type raw;
        std::memcpy(&raw, values + n, sizeof raw);
        raw = static_cast<decltype(raw)>(raw << above);
        std::memcpy(values + n, &raw, sizeof raw);
        values[n] = static_cast<Number>(values[n] / scale); /* exact; takes the sign along */
    }
}

void clean(const dicom_pixels &pixels, void *out)
{
    switch (pixels.type()) {
    case component::uint8: return clean_bits(pixels.bits_stored, pixels.count(), static_cast<uint8_t *>(out));
    case component::int8: return clean_bits(pixels.bits_stored, pixels.count(), static_cast<int8_t *>(out));
    case component::uint16: return clean_bits(pixels.bits_stored, pixels.count(), static_cast<uint16_t *>(out));
    case component::int16: return clean_bits(pixels.bits_stored, pixels.count(), static_cast<int16_t *>(out));
    case component::uint32: return clean_bits(pixels.bits_stored, pixels.count(), static_cast<uint32_t *>(out));
    case component::int32: return clean_bits(pixels.bits_stored, pixels.count(), static_cast<int32_t *>(out));
    default: return;
    }
}

/* GDCM's messages go to the console, and whether is one switch for the process: while one of these lives, they are
 * off, and this thread alone decompresses. */
class quiet_gdcm {
public:
    quiet_gdcm() : lock_(mutex()), debug_(gdcm::Trace::GetDebugFlag()), warning_(gdcm::Trace::GetWarningFlag()), error_(gdcm::Trace::GetErrorFlag())
    {
        set(false, false, false);
    }
    ~quiet_gdcm() { set(debug_, warning_, error_); }
    quiet_gdcm(const quiet_gdcm &) = delete;
    quiet_gdcm &operator=(const quiet_gdcm &) = delete;

private:
    std::lock_guard<std::mutex> lock_;
    bool debug_, warning_, error_;
    static std::mutex &mutex()
    {
        static std::mutex one;
        return one;
    }
    static void set(bool debug, bool warning, bool error)
    {
        gdcm::Trace::SetDebug(debug);
        gdcm::Trace::SetWarning(warning);
        gdcm::Trace::SetError(error);
    }
};

std::string little_endian(uint32_t value, int bytes)
{
    std::string out;
    for (int n = 0; n < bytes; n++) out += static_cast<char>(value >> 8 * n & 0xff);
    return out;
}

std::string element(uint16_t group, uint16_t tag, const char *type, std::string value)
{
    if (value.size() % 2) value += std::strcmp(type, "UI") == 0 ? '\0' : ' ';
    return little_endian(group, 2) + little_endian(tag, 2) + type + little_endian(static_cast<uint32_t>(value.size()), 2) + value;
}

/* A DICOM file with nothing but what decompression needs, so that nothing else in the original can disturb it. */
std::string bare_file(const dicom_pixels &pixels, std::string image)
{
    const char *const ct_image = "1.2.840.10008.5.1.4.1.1.2";
    std::string meta = element(2, 2, "UI", ct_image) + element(2, 3, "UI", "1.2.3") + element(2, 0x10, "UI", pixels.transfer_syntax);
    std::string file = std::string(128, '\0') + "DICM" + element(2, 0, "UL", little_endian(static_cast<uint32_t>(meta.size()), 4)) + meta;
    auto number = [](int value) { return little_endian(static_cast<uint32_t>(value), 2); };
    file += element(8, 0x16, "UI", ct_image) + element(8, 0x18, "UI", "1.2.3") + element(0x28, 2, "US", number(1)) +
            element(0x28, 4, "CS", "MONOCHROME2") + element(0x28, 0x10, "US", number(pixels.rows)) +
            element(0x28, 0x11, "US", number(pixels.columns)) + element(0x28, 0x100, "US", number(pixels.bits_allocated)) +
            element(0x28, 0x101, "US", number(pixels.bits_stored)) + element(0x28, 0x102, "US", number(pixels.bits_stored - 1)) +
            element(0x28, 0x103, "US", number(pixels.is_signed));
    if (image.size() % 2) image += '\0';
    const std::string item("\xfe\xff\x00\xe0", 4);
    return file + little_endian(0x7fe0, 2) + little_endian(0x10, 2) + "OB" + std::string(2, '\0') + "\xff\xff\xff\xff" + item + little_endian(0, 4) +
           item + little_endian(static_cast<uint32_t>(image.size()), 4) + image + std::string("\xfe\xff\xdd\xe0", 4) + little_endian(0, 4);
}

/* A JPEG or JPEG-LS image with no other segments than its data need (ISO 10918-1 annex B), which are checked: GDCM
 * stops the process on headers that it does not expect, comments among them. */
std::string bare_jpeg(const std::string &path, const dicom_pixels &pixels, const std::string &image)
{
    auto byte = [&](size_t at) { return at < image.size() ? static_cast<unsigned char>(image[at]) : 0; };
    auto pair = [&](size_t at) { return byte(at) << 8 | byte(at + 1); };
    const int start = 0xffd8, scan = 0xda, frame_jpeg_ls = 0xf7;
    std::string kept = image.substr(0, 2);
    bool has_frame = false;
    size_t at = 2;
    for (bool going = pair(0) == start; going;) {
        while (byte(at) == 0xff && byte(at + 1) == 0xff) at++; /* fill */
        int marker = byte(at + 1);
        size_t length = static_cast<size_t>(pair(at + 2));
        if (byte(at) != 0xff || length < 2 || at + 2 + length > image.size()) break;
        bool frame = (marker >= 0xc0 && marker <= 0xc3) || marker == frame_jpeg_ls;
        bool table = marker == 0xc4 || marker == 0xdb || marker == 0xdd || marker == 0xf8;
        bool comment = (marker >= 0xe0 && marker <= 0xef) || marker == 0xfe;
        if (frame) {
            if (has_frame || length < 11 || byte(at + 4) < 2 || byte(at + 4) > pixels.bits_allocated || pair(at + 5) != pixels.rows ||
                pair(at + 7) != pixels.columns || byte(at + 9) != 1)
                break;
            has_frame = true;
        } else if (marker == scan) {
            if (has_frame && byte(at + 4) == 1) return kept + image.substr(at);
            break;
        } else if (!table && !comment) {
            break;
        }
        if (!comment) kept += image.substr(at, 2 + length);
        at += 2 + length;
    }
    fail(PLIANT_ERROR_FORMAT, "%s: the compressed pixels are damaged: no JPEG image of %d x %d numbers", path.c_str(), pixels.columns, pixels.rows);
}

bool is_jpeg(const std::string &transfer_syntax)
{
    const std::string jpeg = "1.2.840.10008.1.2.4."; /* .50 to .70: JPEG, .80 and .81: JPEG-LS, from .90: JPEG 2000 and video */
    return transfer_syntax.size() == jpeg.size() + 2 && transfer_syntax.compare(0, jpeg.size(), jpeg) == 0 && transfer_syntax[jpeg.size()] <= '8';
}

/* RLE (PS3.5 annex G): a segment for every byte of a number, the highest first; runs as in PackBits. Not by GDCM, which stops the
 * process when a segment holds too little. */
void decode_run_length(const std::string &path, const dicom_pixels &pixels, const std::string &coded, void *out)
{
    const size_t size = component_size(pixels.type()), head = 64;
    auto word = [&](size_t at) {
        size_t value = 0;
        for (size_t n = 4; n-- > 0;) value = value << 8 | static_cast<unsigned char>(coded[at + n]);
        return value;
    };
    bool good = coded.size() >= head && word(0) == size;
    for (size_t segment = 0; good && segment < size; segment++) {
        size_t at = word(4 + 4 * segment), end = segment + 1 < size ? word(8 + 4 * segment) : coded.size(), done = 0;
        good = at >= head && at <= end && end <= coded.size();
        unsigned char *to = static_cast<unsigned char *>(out) + (machine_is_big_endian() ? segment : size - 1 - segment);
        while (good && done < pixels.count()) {
            good = at + 1 < end;
            if (!good) break;
            const int control = static_cast<signed char>(coded[at++]);
            if (control == -128) continue;
            const bool repeated = control < 0;
            const size_t length = static_cast<size_t>(repeated ? 1 - control : 1 + control);
            good = length <= pixels.count() - done && (repeated || length <= end - at);
            for (size_t n = 0; good && n < length; n++, done++) to[size * done] = static_cast<unsigned char>(coded[repeated ? at : at + n]);
            at += repeated ? 1 : length;
        }
    }
    if (!good) fail(PLIANT_ERROR_FORMAT, "%s: the compressed pixels are damaged: no RLE image of %d x %d numbers", path.c_str(), pixels.columns, pixels.rows);
}

void decompress(const std::string &path, const dicom_pixels &pixels, void *out)
{
    std::string coded;
    for (const dicom_file::part &part : pixels.parts) coded += file_part(path, part);
    if (pixels.transfer_syntax == "1.2.840.10008.1.2.5") return decode_run_length(path, pixels, coded, out);
    quiet_gdcm quiet;
    if (is_jpeg(pixels.transfer_syntax)) coded = bare_jpeg(path, pixels, coded);
    std::istringstream stream(bare_file(pixels, coded));
    gdcm::ImageReader reader;
    reader.SetStream(stream);
    if (!reader.Read())
        fail(PLIANT_ERROR_FORMAT, "%s: the compressed pixels cannot be read (transfer syntax %s)", path.c_str(), pixels.transfer_syntax.c_str());
    const gdcm::Image &image = reader.GetImage();
    const gdcm::PixelFormat &format = image.GetPixelFormat();
    size_t bytes = pixels.count() * component_size(pixels.type());
    if (image.GetBufferLength() != bytes || format.GetBitsAllocated() != pixels.bits_allocated || format.GetSamplesPerPixel() != 1 ||
        format.GetPixelRepresentation() != pixels.is_signed)
        fail(PLIANT_ERROR_FORMAT, "%s: the compressed pixels are not %d x %d numbers of %d bits%s as the header says", path.c_str(),
             pixels.columns, pixels.rows, pixels.bits_allocated, pixels.is_signed ? " with sign" : "");
    if (!image.GetBuffer(static_cast<char *>(out)))
        fail(PLIANT_ERROR_FORMAT, "%s: the compressed pixels are damaged (transfer syntax %s)", path.c_str(), pixels.transfer_syntax.c_str());
}

} // namespace

std::vector<std::vector<dicom_file::part>> parts_of_frames(const std::string &path, const dicom_file &file, size_t frames, size_t frame_bytes)
{
    std::vector<std::vector<dicom_file::part>> parts;
    if (!file.compressed) {
        double needed = static_cast<double>(frames) * static_cast<double>(frame_bytes);
        if (static_cast<double>(file.pixels.length) < needed)
            fail(PLIANT_ERROR_FORMAT, "%s: truncated: the pixels of %zu frame(s) need %.0f bytes, PixelData has %.0f", path.c_str(), frames, needed,
                 static_cast<double>(file.pixels.length));
        for (size_t f = 0; f < frames; f++) parts.push_back({{file.pixels.offset + f * frame_bytes, frame_bytes}});
        return parts;
    }
    if (frames == 1) return {file.fragments};
    if (file.fragments.size() == frames) {
        for (const dicom_file::part &fragment : file.fragments) parts.push_back({fragment});
        return parts;
    }
    if (file.offset_table.length != 4 * frames)
        fail(PLIANT_ERROR_FORMAT, "%s: %zu frames in %zu compressed fragments, and no table of offsets that tells which are whose", path.c_str(), frames,
             file.fragments.size());
    const std::string table = file_part(path, file.offset_table);
    const uint64_t first = file.offset_table.offset + file.offset_table.length, item_head = 8;
    for (const dicom_file::part &fragment : file.fragments) {
        size_t frame = parts.size();
        uint64_t wanted = UINT64_MAX;
        if (frame < frames) {
            wanted = 0;
            for (size_t n = 4; n-- > 0;) wanted = wanted << 8 | static_cast<unsigned char>(table[4 * frame + n]);
        }
        if (fragment.offset - item_head - first == wanted) parts.emplace_back();
        if (parts.empty()) break;
        parts.back().push_back(fragment);
    }
    if (parts.size() != frames)
        fail(PLIANT_ERROR_FORMAT, "%s: the table of offsets of the compressed pixels does not meet %zu frames", path.c_str(), frames);
    return parts;
}

void read_dicom_pixels(const std::string &path, const dicom_pixels &pixels, void *out)
{
    if (pixels.compressed) {
        decompress(path, pixels, out);
    } else {
        byte_stream stream(path, pixels.parts.front().offset, byte_stream::packing::none);
        stream.read_exactly(out, pixels.count() * component_size(pixels.type()), "the pixel data");
    }
    clean(pixels, out);
}

} // namespace pliant_read
