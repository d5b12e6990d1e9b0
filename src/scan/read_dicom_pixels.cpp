/* Reads the pixels of one DICOM image, uncompressed or RLE; read_dicom_codecs.cpp handles the JPEG family. */
#include "scan/read_dicom.h"

#include <cstring>

namespace pliant_read {

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

/* Clear the bits above the stored ones, where old files have overlays. */
template <class Number> void clean_bits(int stored, size_t count, Number *values)
{
    const int above = static_cast<int>(8 * sizeof(Number)) - stored;
    if (above == 0) return;
    for (size_t n = 0; n < count; n++) {
        typename std::make_unsigned<Number>::type raw;
        std::memcpy(&raw, values + n, sizeof raw);
        raw = static_cast<decltype(raw)>(raw << above);
        std::memcpy(values + n, &raw, sizeof raw);
        values[n] = static_cast<Number>(values[n] >> above); /* takes the sign along */
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

/* Decode RLE (PS3.5 annex G): one segment for every byte of a number, the highest first, with PackBits runs. */
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
        unsigned char *to =
            static_cast<unsigned char *>(out) + (machine_is_big_endian() ? segment : size - 1 - segment);
        while (good && done < pixels.count()) {
            good = at + 1 < end;
            if (!good) break;
            const int control = static_cast<signed char>(coded[at++]);
            if (control == -128) continue;
            const bool repeated = control < 0;
            const size_t length = static_cast<size_t>(repeated ? 1 - control : 1 + control);
            good = length <= pixels.count() - done && (repeated || length <= end - at);
            for (size_t n = 0; good && n < length; n++, done++)
                to[size * done] = static_cast<unsigned char>(coded[repeated ? at : at + n]);
            at += repeated ? 1 : length;
        }
    }
    if (!good)
        fail(PLIANT_ERROR_FORMAT, "%s: the compressed pixels are damaged: no RLE image of %d x %d numbers",
             path.c_str(), pixels.columns, pixels.rows);
}

void decompress(const std::string &path, const dicom_pixels &pixels, void *out)
{
    std::string coded;
    for (const dicom_file::part &part : pixels.parts) coded += file_part(path, part);
    if (pixels.transfer_syntax == "1.2.840.10008.1.2.5")
        decode_run_length(path, pixels, coded, out);
    else
        decompress_jpeg(path, pixels, coded, out);
}

} // namespace

std::vector<std::vector<dicom_file::part>> parts_of_frames(const std::string &path, const dicom_file &file,
                                                           size_t frames, size_t frame_bytes)
{
    std::vector<std::vector<dicom_file::part>> parts;
    if (!file.compressed) {
        double needed = static_cast<double>(frames) * static_cast<double>(frame_bytes);
        if (static_cast<double>(file.pixels.length) < needed)
            fail(PLIANT_ERROR_FORMAT, "%s: truncated: the pixels of %zu frame(s) need %.0f bytes, PixelData has %.0f",
                 path.c_str(), frames, needed, static_cast<double>(file.pixels.length));
        for (size_t f = 0; f < frames; f++) parts.push_back({{file.pixels.offset + f * frame_bytes, frame_bytes}});
        return parts;
    }
    if (frames == 1) return {file.fragments};
    if (file.fragments.size() == frames) {
        for (const dicom_file::part &fragment : file.fragments) parts.push_back({fragment});
        return parts;
    }
    if (file.offset_table.length != 4 * frames)
        fail(PLIANT_ERROR_FORMAT,
             "%s: %zu frames in %zu compressed fragments, but no table of offsets, so the fragments of a frame are "
             "unknown",
             path.c_str(), frames, file.fragments.size());
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
        fail(PLIANT_ERROR_FORMAT, "%s: the table of offsets of the compressed pixels does not match %zu frames",
             path.c_str(), frames);
    return parts;
}

namespace
{

/* Mark padding. PixelPaddingValue has 16 bits, with the sign of the pixels. */
template <class Number> void mark(const dicom_pixels &pixels, const void *values, std::vector<bool> *padded)
{
    const Number *v = static_cast<const Number *>(values);
    for (size_t n = 0; n < pixels.count(); n++)
        if (v[n] >= pixels.padding_low && v[n] <= pixels.padding_high) (*padded)[n] = true;
}

void mark_padding(const dicom_pixels &pixels, const void *values, std::vector<bool> *padded)
{
    switch (pixels.type()) {
    case component::uint8: return mark<uint8_t>(pixels, values, padded);
    case component::int8: return mark<int8_t>(pixels, values, padded);
    case component::uint16: return mark<uint16_t>(pixels, values, padded);
    case component::int16: return mark<int16_t>(pixels, values, padded);
    case component::uint32: return mark<uint32_t>(pixels, values, padded);
    case component::int32: return mark<int32_t>(pixels, values, padded);
    default: return;
    }
}

} // namespace

void read_dicom_pixels(dicom_bytes *bytes, const dicom_pixels &pixels, void *out, std::vector<bool> *padded)
{
    if (pixels.compressed) decompress(bytes->path(), pixels, out);
    else
        bytes->read(pixels.parts.front().offset, out, pixels.count() * component_size(pixels.type()), "the pixel data");
    padded->assign(pixels.has_padding ? pixels.count() : 0, false);
    if (pixels.has_padding) mark_padding(pixels, out, padded); /* padding may use bits above the stored ones */
    clean(pixels, out);
    if (pixels.has_padding) mark_padding(pixels, out, padded);
}

} // namespace pliant_read
