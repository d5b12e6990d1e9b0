/* Parses the elements of a DICOM file (PS3.5 section 7, PS3.10 section 7), checked against the file's size. GDCM ends
 * the process for some damaged files, so it reads only files whose structure was checked here. */
#include "scan/read_dicom.h"

#include <cerrno>
#include <cmath>
#include <cstring>

namespace pliant_read {

namespace {

enum : uint32_t {
    UNDEFINED = 0xffffffff,
    ITEM = 0xfffee000,
    ITEM_END = 0xfffee00d,
    SEQUENCE_END = 0xfffee0dd,
    TRANSFER_SYNTAX = 0x00020010,
    SHARED_GROUPS = 0x52009229,
    FRAME_GROUPS = 0x52009230,
    SEGMENTS = 0x00620002,
    NUMBER_OF_FRAMES = 0x00280008,
    PIXEL_DATA = 0x7fe00010
};

/* Return whether a sequence in a functional group or segment contains relevant values. */
bool is_kept_group(uint32_t tag)
{
    switch (tag) {
    case 0x00209113: /* Plane Position */
    case 0x00209116: /* Plane Orientation */
    case 0x00289110: /* Pixel Measures */
    case 0x00289145: /* Pixel Value Transformation */
    case 0x0062000a: /* Segment Identification */
    case 0x0062000f: /* Segmented Property Type Code */ return true;
    default: return false;
    }
}
/* Return whether the value of an element is relevant. */
bool is_kept_value(uint32_t tag)
{
    switch (tag) {
    case 0x00080104: /* CodeMeaning */
    case 0x00180050: /* SliceThickness */
    case 0x00180088: /* SpacingBetweenSlices */
    case 0x00200032: /* ImagePositionPatient */
    case 0x00200037: /* ImageOrientationPatient */
    case 0x00280030: /* PixelSpacing */
    case 0x00281052: /* RescaleIntercept */
    case 0x00281053: /* RescaleSlope */
    case 0x00281054: /* RescaleType */
    case 0x00620004: /* SegmentNumber */
    case 0x00620005: /* SegmentLabel */
    case 0x0062000b: /* ReferencedSegmentNumber */
    case 0x0062000d: /* RecommendedDisplayCIELabValue */ return true;
    default: return false;
    }
}

const char *const DEFLATED = "1.2.840.10008.1.2.1.99";

struct element {
    uint32_t tag, length;
    char type[3]; /* "" in implicit VR and for items */
};

class walker {
public:
    walker(const std::string &path, dicom_file *out) : path_(path), bytes_(path, 0), size_(file_size(path)), out_(out)
    {
        if (!open_file(path)) fail(PLIANT_ERROR_FILE, "%s: cannot be opened: %s", path.c_str(), strerror(errno));
    }

    /* Parse the file. Return false if it is no DICOM file. */
    bool walk()
    {
        std::string start = bytes(0, std::min<uint64_t>(size_, 132));
        bool magic = start.size() == 132 && start.compare(128, 4, "DICM") == 0;
        if (!magic && !looks_like_data_set(start)) return false;
        at_ = magic ? 132 : 0;
        explicit_ = true;
        while (at_ < size_ && (peek_tag() >> 16) == 2) { /* the file meta group is always explicit */
            element e = next_element();
            store(e, &out_->values);
            skip(e.length);
        }
        out_->transfer_syntax = out_->text(TRANSFER_SYNTAX);
        if (at_ >= size_) truncated();
        if (out_->transfer_syntax.empty()) out_->transfer_syntax = guessed_transfer_syntax();
        check_transfer_syntax();
        if (out_->transfer_syntax == DEFLATED) begin_deflated();
        explicit_ = out_->transfer_syntax != "1.2.840.10008.1.2";
        while (at_ < size_ && !out_->has_pixels) {
            element e = next_element();
            bool with_type = explicit_ && std::strcmp(e.type, "UN") != 0; /* an unknown sequence is implicit inside */
            if (e.tag == PIXEL_DATA) pixels(e);
            else if (e.tag == FRAME_GROUPS) functional_groups(e, with_type, &out_->frames);
            else if (e.tag == SEGMENTS) functional_groups(e, with_type, &out_->segments);
            else if (e.tag == SHARED_GROUPS) {
                std::vector<dicom_file::elements> groups;
                functional_groups(e, with_type, &groups);
                if (!groups.empty()) out_->shared = groups.front();
            } else if (e.length == UNDEFINED) sequence(1, with_type);
            else {
                store(e, &out_->values);
                skip(e.length);
            }
        }
        return true;
    }

private:
    std::string path_;
    dicom_bytes bytes_;
    uint64_t size_, at_ = 0;
    dicom_file *out_;
    bool explicit_ = true;
    std::string window_; /* last read bytes: headers are small and many */
    uint64_t window_at_ = 0;

    [[noreturn]] void truncated() { fail(PLIANT_ERROR_FORMAT, "%s: truncated DICOM file", path_.c_str()); }
    [[noreturn]] void damaged(const char *what)
    {
        fail(PLIANT_ERROR_FORMAT, "%s: damaged DICOM file: %s at byte %llu", path_.c_str(), what,
             static_cast<unsigned long long>(at_));
    }

    std::string bytes(uint64_t offset, uint64_t count)
    {
        const uint64_t maximum = 1 << 16; /* maximum length of a request */
        if (count > size_ || offset > size_ - count) truncated();
        if (offset < window_at_ || offset + count > window_at_ + window_.size()) {
            window_.erase(0, static_cast<size_t>(std::min<uint64_t>(offset - window_at_, window_.size())));
            const size_t kept = window_.size(); /* a second read would inflate again from the start */
            window_at_ = offset;
            window_.resize(static_cast<size_t>(std::min(maximum, size_ - offset)));
            bytes_.read(offset + kept, &window_[kept], window_.size() - kept, "the header");
        }
        return window_.substr(static_cast<size_t>(offset - window_at_), static_cast<size_t>(count));
    }
    static uint32_t number(const std::string &raw, size_t at, int count)
    {
        uint32_t value = 0;
        for (int n = count - 1; n >= 0; n--)
            value = value << 8 | static_cast<unsigned char>(raw[at + static_cast<size_t>(n)]);
        return value;
    }
    static uint32_t tag_of(const std::string &raw) { return number(raw, 0, 2) << 16 | number(raw, 2, 2); }
    uint32_t peek_tag() { return tag_of(bytes(at_, 4)); }

    static bool has_type(const std::string &head)
    { return std::isupper(static_cast<unsigned char>(head[4])) && std::isupper(static_cast<unsigned char>(head[5])); }

    /* Return whether the data begins like a data set. Old files lack the 128 bytes at the start. They begin with a
     * plausible element of group 8, or with the file meta group. */
    static bool looks_like_data_set(const std::string &start)
    {
        if (start.size() < 132) return false;
        if (number(start, 0, 2) == 2) return has_type(start) && number(start, 2, 2) <= 0x16;
        return number(start, 0, 2) == 8 && number(start, 2, 2) <= 0x18 &&
               (has_type(start) || number(start, 4, 4) <= 64);
    }

    /* Return the transfer syntax of a file that specifies none. Its first element has a type, or no type, which is
     * DICOM's default. */
    std::string guessed_transfer_syntax()
    {
        const std::string head = bytes(at_, 8);
        if (head[0] == 0 && head[1] != 0) return "1.2.840.10008.1.2.2"; /* group 8 with its high byte first */
        return has_type(head) ? "1.2.840.10008.1.2.1" : "1.2.840.10008.1.2";
    }

    /* Begin reading a deflated data set after the file meta group: find its length, and read inflated bytes from
     * here. */
    void begin_deflated()
    {
        const uint64_t maximum = uint64_t(16) << 30;
        byte_stream stream(path_, at_, byte_stream::packing::raw_deflate);
        std::vector<char> block(1 << 18);
        uint64_t length = 0;
        for (size_t got = block.size(); got == block.size() && length <= maximum; length += got)
            got = stream.read(block.data(), block.size());
        if (length > maximum) damaged("more than 16 GiB of deflated data");
        stream.finish();
        out_->deflated_from = at_;
        size_ = at_ + length;
        window_.clear();
        bytes_ = dicom_bytes(path_, at_);
    }

    void check_transfer_syntax()
    {
        const std::string &syntax = out_->transfer_syntax;
        const char *const remedy = "convert it with gdcmconv --raw, dcmconv +te, or to NIfTI";
        if (syntax == "1.2.840.10008.1.2.2")
            fail(PLIANT_ERROR_FORMAT, "%s: big-endian DICOM files are not supported; %s", path_.c_str(), remedy);
        if (syntax.compare(0, 17, "1.2.840.10008.1.2") != 0)
            fail(PLIANT_ERROR_FORMAT, "%s: transfer syntax \"%.64s\" is not supported; %s", path_.c_str(),
                 syntax.c_str(), remedy);
    }

    element next_element(bool with_type)
    {
        static const char *const long_types[] = {"OB", "OD", "OF", "OL", "OV", "OW", "SQ",
                                                 "SV", "UC", "UN", "UR", "UT", "UV"};
        std::string head = bytes(at_, 8);
        element e = {tag_of(head), number(head, 4, 4), ""};
        at_ += 8;
        if (!with_type || (e.tag >> 16) == 0xfffe) return e;
        e.type[0] = head[4];
        e.type[1] = head[5];
        if (!std::isupper(static_cast<unsigned char>(e.type[0])) ||
            !std::isupper(static_cast<unsigned char>(e.type[1])))
            damaged("an element without a type");
        e.length = number(head, 6, 2);
        for (const char *type : long_types)
            if (std::strcmp(type, e.type) == 0) {
                e.length = number(bytes(at_, 4), 0, 4);
                at_ += 4;
            }
        return e;
    }
    element next_element() { return next_element(explicit_); }

    void skip(uint64_t length)
    {
        if (length > size_ - at_) truncated();
        at_ += length;
    }

    void store(const element &e, dicom_file::elements *out)
    {
        const uint32_t longest = 4096; /* longer values are not relevant */
        if (e.length > size_ - at_) truncated();
        (*out)[e.tag] = e.length <= longest ? bytes(at_, e.length) : "";
    }

    /* Read the items of a sequence with undefined length. */
    void sequence(int depth, bool with_type)
    {
        if (depth > 32) damaged("sequences nested more than 32 deep");
        for (;;) {
            element item = next_element(with_type);
            if (item.tag == SEQUENCE_END) return;
            if (item.tag != ITEM) damaged("something else than an item in a sequence");
            if (item.length != UNDEFINED) {
                skip(item.length);
                continue;
            }
            for (element e = next_element(with_type); e.tag != ITEM_END; e = next_element(with_type)) {
                if (e.length == UNDEFINED) sequence(depth + 1, with_type && std::strcmp(e.type, "UN") != 0);
                else skip(e.length);
            }
        }
    }

    /* Skip the value of an element whose head has been read. */
    void pass(const element &e, int depth, bool with_type)
    {
        if (e.length == UNDEFINED) sequence(depth + 1, with_type && std::strcmp(e.type, "UN") != 0);
        else skip(e.length);
    }

    /* Return the end of a value; the end of the file if a delimiter marks it. */
    uint64_t end_of(const element &e, uint64_t outer)
    {
        if (e.length == UNDEFINED) return outer;
        if (e.length > outer - at_) damaged("an item that is longer than its sequence");
        return at_ + e.length;
    }

    /* Visit every item of a sequence and each of its elements; visit skips the value. */
    template <class Item, class Visit>
    void each(const element &sequence, uint64_t outer, bool with_type, Item begin_item, Visit visit)
    {
        const uint64_t end = end_of(sequence, outer);
        while (at_ < end) {
            element item = next_element(with_type);
            if (item.tag == SEQUENCE_END && sequence.length == UNDEFINED) return;
            if (item.tag != ITEM) damaged("something else than an item in a sequence");
            const uint64_t item_end = end_of(item, end);
            begin_item();
            while (at_ < item_end) {
                element e = next_element(with_type);
                if (e.tag == ITEM_END && item.length == UNDEFINED) break;
                visit(e, item_end);
                if (at_ > item_end) damaged("an element that is longer than its item");
            }
        }
        if (sequence.length == UNDEFINED) truncated();
    }

    void functional_groups(const element &e, bool with_type, std::vector<dicom_file::elements> *out)
    {
        const size_t max_frames = 100000;
        auto another = [&] {
            if (out->size() == max_frames) damaged("more than 100000 frames or segments");
            out->emplace_back();
        };
        auto value = [&](const element &one, uint64_t) {
            if (one.length != UNDEFINED && is_kept_value(one.tag)) store(one, &out->back());
            pass(one, 2, with_type);
        };
        auto group = [&](const element &one, uint64_t end) {
            if (is_kept_group(one.tag)) each(one, end, with_type && std::strcmp(one.type, "UN") != 0, [] {}, value);
            else if (one.length != UNDEFINED && is_kept_value(one.tag)) value(one, end);
            else pass(one, 1, with_type);
        };
        each(e, size_, with_type, another, group);
    }

    void pixels(const element &e)
    {
        out_->has_pixels = true;
        out_->compressed = e.length == UNDEFINED;
        out_->pixels = {at_, e.length};
        if (!out_->compressed) return skip(e.length);
        out_->pixels.length = 0;
        for (bool table = true;; table = false) {
            element item = next_element(false);
            if (item.tag == SEQUENCE_END) return;
            if (item.tag != ITEM || item.length == UNDEFINED)
                damaged("something else than a fragment in compressed pixels");
            if (table) out_->offset_table = {at_, item.length};
            else out_->fragments.push_back({at_, item.length});
            skip(item.length);
        }
    }
};

} // namespace

void dicom_bytes::read(uint64_t offset, void *out, size_t count, const char *what)
{
    if (!stream_ || offset < at_ || (deflated_from_ == 0 && offset != at_)) {
        at_ = deflated_from_ ? deflated_from_ : offset;
        const auto packing = deflated_from_ ? byte_stream::packing::raw_deflate : byte_stream::packing::none;
        stream_.reset(new byte_stream(path_, at_, packing));
    }
    stream_->skip(offset - at_, what);
    stream_->read_exactly(out, count, what);
    at_ = offset + count;
}

std::string dicom_file::text(uint32_t tag) const
{
    auto found = values.find(tag);
    return found == values.end() ? "" : trimmed(found->second);
}

int dicom_file::whole(uint32_t tag, int otherwise) const
{
    auto found = values.find(tag);
    if (found == values.end() || found->second.size() < 2) return otherwise;
    return static_cast<unsigned char>(found->second[0]) | static_cast<unsigned char>(found->second[1]) << 8;
}

std::string dicom_file::text_of_frame(size_t frame, uint32_t tag) const
{
    if (frame < frames.size()) {
        auto own = frames[frame].find(tag);
        if (own != frames[frame].end()) return trimmed(own->second);
    }
    auto all = shared.find(tag);
    return all == shared.end() ? text(tag) : trimmed(all->second);
}

std::vector<double> numbers_of_frame(const std::string &name, const dicom_file &file, size_t frame, uint32_t tag,
                                     size_t count, const char *what)
{
    std::string text = file.text_of_frame(frame, tag);
    std::vector<double> numbers;
    if (text.empty()) return numbers;
    if (!parse_numbers(text, '\\', &numbers) || numbers.size() != count)
        fail(PLIANT_ERROR_FORMAT, "%s: %s is \"%.80s\", %zu numbers are needed", name.c_str(), what, text.c_str(),
             count);
    return numbers;
}

size_t frames_of(const std::string &path, const dicom_file &file)
{
    const std::vector<double> number = numbers_of_frame(path, file, SIZE_MAX, NUMBER_OF_FRAMES, 1, "NumberOfFrames");
    const double declared = number.empty() ? 1.0 : number[0];
    size_t grouped = file.frames.size();
    if (!(declared >= 1.0) || declared != std::floor(declared))
        fail(PLIANT_ERROR_FORMAT, "%s: NumberOfFrames is %g", path.c_str(), declared);
    if (grouped == 0 && declared > 1.0)
        fail(PLIANT_ERROR_FORMAT,
             "%s: %.0f frames in one DICOM file, but no functional groups with their positions. Export it as enhanced "
             "CT or MR, as single images, or as NIfTI",
             path.c_str(), declared);
    if (grouped > 0 && declared != static_cast<double>(grouped))
        fail(PLIANT_ERROR_FORMAT, "%s: NumberOfFrames is %.0f, but its PerFrameFunctionalGroupsSequence has %zu items",
             path.c_str(), declared, grouped);
    return static_cast<size_t>(declared);
}

bool read_dicom_file(const std::string &path, dicom_file *out)
{
    return walker(path, out).walk();
}

} // namespace pliant_read
