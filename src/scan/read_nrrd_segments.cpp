/* Segmentations of 3D Slicer (.seg.nrrd, Libs/MRML/Core/vtkMRMLSegmentationStorageNode.h). They are NRRD files with one
 * or several layers of labels. "SegmentN_...:=" lines describe every segment. The space origin is the position of the
 * first cropped voxel. Segmentation_ReferenceImageExtentOffset and SegmentN_Extent are therefore not needed. */
#include "scan/read_nrrd.h"
#include "scan/read_segments.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <unordered_map>

namespace pliant_read {

namespace {

/* Return N of "segmentN_name", or -1. */
long number_of_key(const std::string &key)
{
    const std::string start = "segment";
    const size_t end = key.find('_');
    if (key.compare(0, start.size(), start) != 0 || end == std::string::npos || end <= start.size() || end > 15)
        return -1;
    for (size_t n = start.size(); n < end; n++)
        if (!std::isdigit(static_cast<unsigned char>(key[n]))) return -1;
    return std::stol(key.substr(start.size(), end - start.size()));
}

std::vector<std::string> split(const std::string &text, char separator)
{
    std::vector<std::string> parts(1);
    for (char c : text)
        if (c == separator) parts.emplace_back();
        else parts.back() += c;
    return parts;
}

/* Return the meaning of "scheme^code^meaning". */
std::string meaning_of(const std::vector<std::string> &entry, size_t part)
{
    const std::vector<std::string> words = split(part < entry.size() ? entry[part] : "", '^');
    return words.size() == 3 ? trimmed(words[2]) : "";
}

/* Return "Left Kidney" from modifier and type of "TerminologyEntry:context~category~type~modifier~...". Slicer assigns
 * "Tissue" to every new segment, so it is ignored. */
std::string terminology_of(const std::string &tags)
{
    const std::string start = "TerminologyEntry:";
    for (const std::string &tag : split(tags, '|')) {
        if (tag.compare(0, start.size(), start) != 0) continue;
        const std::vector<std::string> entry = split(tag.substr(start.size()), '~');
        const std::string type = meaning_of(entry, 2), modifier = meaning_of(entry, 3);
        return type == "Tissue" ? "" : modifier.empty() ? type : modifier + " " + type;
    }
    return "";
}

struct described {
    pliant_label_segment segment;
    size_t layer;
};

class descriptions {
public:
    descriptions(const nrrd_header &header, size_t layers) : header_(header), layers_(layers)
    {
        std::map<long, bool> numbers;
        for (const auto &pair : header.pairs)
            if (number_of_key(pair.first) >= 0) numbers[number_of_key(pair.first)] = true;
        for (const auto &one : numbers) all_.push_back(describe(one.first, numbers.size()));
    }
    const std::vector<described> &all() const { return all_; }

private:
    const nrrd_header &header_;
    size_t layers_;
    std::vector<described> all_;

    std::string text(long number, const char *field) const
    {
        return trimmed(header_.pair("segment" + std::to_string(number) + "_" + field));
    }
    size_t whole(long number, const char *field, const char *written, size_t otherwise, size_t low, size_t high) const
    {
        const std::string value = text(number, field);
        std::vector<double> numbers;
        if (value.empty()) return otherwise;
        if (!parse_numbers(value, ' ', &numbers) || numbers.size() != 1 || numbers[0] != std::floor(numbers[0]) ||
            numbers[0] < static_cast<double>(low) || numbers[0] > static_cast<double>(high))
            fail(PLIANT_ERROR_FORMAT, "%s: Segment%ld_%s: %.40s: a whole number from %zu to %zu is needed",
                 header_.path.c_str(), number, written, value.c_str(), low, high);
        return static_cast<size_t>(numbers[0]);
    }
    /* Files of Slicer 4.10 and older have a layer with value 1 for every segment. */
    described describe(long number, size_t count) const
    {
        described out = {};
        const size_t position = all_.size();
        const size_t own = layers_ == count ? position : 0;
        std::vector<double> color;
        out.layer = whole(number, "layer", "Layer", own, 0, layers_ - 1);
        out.segment.value = static_cast<uint16_t>(whole(number, "labelvalue", "LabelValue", 1, 1, UINT16_MAX));
        set_text(text(number, "name"), out.segment.name);
        set_text(text(number, "id"), out.segment.identifier);
        set_text(terminology_of(text(number, "tags")), out.segment.terminology);
        const bool has_color = parse_numbers(text(number, "color"), ' ', &color) && color.size() == 3;
        for (size_t c = 0; c < 3; c++)
            out.segment.color[c] = has_color ? static_cast<float>(std::min(std::max(color[c], 0.0), 1.0)) : -1.0f;
        return out;
    }
};

class nrrd_segments_source : public image_source {
public:
    nrrd_segments_source(const nrrd_header &file, const nrrd_data &data, component type, const nrrd_layers &layers)
        : path_(file.path), data_(data), type_(type), layers_(layers)
    {
        const descriptions found(file, layers.count);
        for (const described &one : found.all()) segments.push_back(one.segment);
        number_segments(path_, &segments);
        for (size_t n = 0; n < segments.size(); n++) {
            const size_t layer = found.all()[n].layer;
            const auto added = of_value_.insert({layer << 16 | segments[n].value, n + 1});
            if (!added.second)
                fail(PLIANT_ERROR_FORMAT,
                     "%s: segments \"%s\" and \"%s\" have the same LabelValue %d in layer %zu. Write the file again "
                     "with 3D Slicer, which gives each segment of a layer its own value",
                     path_.c_str(), segments[added.first->second - 1].name, segments[n].name, segments[n].value, layer);
        }
        header.type = component::uint16;
        header.whole_numbers = true;
    }

    void read(void *voxels) override
    {
        uint16_t *out = static_cast<uint16_t *>(voxels);
        switch (type_) {
        case component::uint8: return paint<uint8_t>(out);
        case component::int8: return paint<int8_t>(out);
        case component::uint16: return paint<uint16_t>(out);
        case component::int16: return paint<int16_t>(out);
        case component::uint32: return paint<uint32_t>(out);
        case component::int32: return paint<int32_t>(out);
        case component::uint64: return paint<uint64_t>(out);
        case component::int64: return paint<int64_t>(out);
        case component::float32: return paint<float>(out);
        case component::float64: return paint<double>(out);
        case component::none: return;
        }
    }

private:
    std::string path_;
    nrrd_data data_;
    component type_;
    nrrd_layers layers_;
    std::unordered_map<uint64_t, size_t> of_value_; /* layer << 16 | value: position of the segment, from 1 */
    uint64_t last_key_ = 0;                         /* neighbours usually have the same one */
    size_t last_segment_ = 0;

    /* Return the position of the segment with this value; 0: none. */
    size_t segment_of(size_t layer, size_t value)
    {
        const uint64_t key = layer << 16 | value;
        if (key == last_key_) return last_segment_;
        const auto found = of_value_.find(key);
        last_key_ = key;
        return last_segment_ = found == of_value_.end() ? 0 : found->second;
    }

    template <class Number> size_t value_of(Number stored, size_t voxel) const
    {
        const double number = static_cast<double>(stored), value = std::round(number);
        if (value >= 0.0 && value <= UINT16_MAX && std::fabs(number - value) <= 1e-3) return static_cast<size_t>(value);
        const size_t nx = static_cast<size_t>(header.geometry.size[0]),
                     ny = static_cast<size_t>(header.geometry.size[1]);
        fail(PLIANT_ERROR_FORMAT,
             "%s: voxel (%zu, %zu, %zu) is %.9g: a segmentation holds whole numbers from 0 to 65535; write the file "
             "again with 3D Slicer",
             path_.c_str(), voxel % nx, voxel / nx % ny, voxel / (nx * ny), number);
    }

    template <class Number> void paint(uint16_t *voxels)
    {
        const size_t count = pliant_geometry_voxels(&header.geometry), total = count * layers_.count;
        const std::unique_ptr<byte_stream> stream = data_.open();
        std::vector<Number> block(std::min<size_t>(total, 1 << 16));
        segment_painter painter(segments, count, voxels);
        size_t nameless = 0, nameless_value = 0;
        for (size_t done = 0; done < total; done += block.size()) {
            block.resize(std::min(block.size(), total - done));
            stream->read_exactly(block.data(), block.size() * sizeof(Number), "the voxel data");
            for (size_t n = 0; n < block.size(); n++) {
                unsigned char *byte = reinterpret_cast<unsigned char *>(&block[n]);
                if (data_.swap) std::reverse(byte, byte + sizeof(Number));
                if (block[n] == 0) continue;
                const size_t at = done + n, layer = at / layers_.below % layers_.count;
                const size_t voxel = at % layers_.below + layers_.below * (at / layers_.below / layers_.count);
                const size_t value = value_of(block[n], voxel), segment = segment_of(layer, value);
                if (segment > 0) painter.put(voxel, segment - 1);
                else if (value > 0 && nameless++ == 0) nameless_value = value;
            }
        }
        stream->finish();
        painter.finish(path_);
        if (nameless > 0)
            pliant_log(PLIANT_LOG_WARNING,
                       "%s: %zu voxels have values that are no segment's (no SegmentN_LabelValue is %zu, for example): "
                       "they have no label",
                       path_.c_str(), nameless, nameless_value);
    }
};

} // namespace

bool has_segments(const nrrd_header &header)
{
    return std::any_of(
        header.pairs.begin(), header.pairs.end(),
        [](const std::pair<const std::string, std::string> &pair) { return number_of_key(pair.first) >= 0; });
}

std::unique_ptr<image_source> open_nrrd_segments(const nrrd_header &header, const nrrd_data &data, component type,
                                                 const pliant_geometry &geometry, const nrrd_layers &layers)
{
    std::unique_ptr<image_source> source(new nrrd_segments_source(header, data, type, layers));
    source->header.geometry = geometry;
    return source;
}

} // namespace pliant_read
