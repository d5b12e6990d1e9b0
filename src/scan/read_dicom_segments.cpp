/* DICOM segmentations (PS3.3 A.51, C.8.20). Every segment has a frame of bits or fractions for every slice that it
 * occupies. In a label map the voxels contain segment numbers. */
#include "scan/read_dicom.h"
#include "scan/read_segments.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace pliant_read {

namespace {

enum : uint32_t {
    CODE_MEANING = 0x00080104,
    THICKNESS = 0x00180050,
    SLICE_SPACING = 0x00180088,
    POSITION = 0x00200032,
    ORIENTATION = 0x00200037,
    ROWS = 0x00280010,
    COLUMNS = 0x00280011,
    PIXEL_SPACING = 0x00280030,
    BITS_ALLOCATED = 0x00280100,
    BITS_STORED = 0x00280101,
    SEGMENTATION_TYPE = 0x00620001,
    SEGMENT_NUMBER = 0x00620004,
    SEGMENT_LABEL = 0x00620005,
    REFERENCED_SEGMENT = 0x0062000b,
    SEGMENT_COLOR = 0x0062000d,
    MAXIMUM_FRACTION = 0x0062000e
};

const char *const EXPORT = "export it as NIfTI or NRRD on the grid of its scan (3D Slicer does, for example)";

/* Return an unsigned number of 16 bits; -1 if missing. */
int number_in(const dicom_file::elements &elements, uint32_t tag, size_t at = 0)
{
    const auto found = elements.find(tag);
    if (found == elements.end() || found->second.size() < at + 2) return -1;
    return static_cast<unsigned char>(found->second[at]) | static_cast<unsigned char>(found->second[at + 1]) << 8;
}

std::string text_in(const dicom_file::elements &elements, uint32_t tag)
{
    const auto found = elements.find(tag);
    return found == elements.end() ? "" : trimmed(found->second);
}

/* Convert a color from DICOM's CIELab (PS3.3 C.10.7.1.1, white D50) to sRGB. */
void set_color(const dicom_file::elements &item, float out[3])
{
    double lab[3];
    for (size_t c = 0; c < 3; c++) {
        const int stored = number_in(item, SEGMENT_COLOR, 2 * c);
        out[c] = -1.0f;
        if (stored < 0) return;
        lab[c] = c == 0 ? stored * 100.0 / 65535.0 : stored * 255.0 / 65535.0 - 128.0;
    }
    const double white[3] = {0.9642, 1.0, 0.8251}, y = (lab[0] + 16.0) / 116.0;
    const double root[3] = {y + lab[1] / 500.0, y, y - lab[2] / 200.0};
    const double rgb_of_xyz[9] = {3.1339, -1.6169, -0.4906, -0.9788, 1.9161, 0.0335, 0.0719, -0.2290, 1.4052};
    double xyz[3];
    for (int c = 0; c < 3; c++)
        xyz[c] =
            white[c] * (root[c] > 6.0 / 29.0 ? root[c] * root[c] * root[c] : (root[c] - 4.0 / 29.0) * 108.0 / 841.0);
    for (int c = 0; c < 3; c++) {
        const double *row = rgb_of_xyz + 3 * c;
        const double linear = std::min(std::max(row[0] * xyz[0] + row[1] * xyz[1] + row[2] * xyz[2], 0.0), 1.0);
        out[c] = static_cast<float>(linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1.0 / 2.4) - 0.055);
    }
}

std::vector<pliant_label_segment> segments_of(const std::string &path, const dicom_file &file)
{
    std::vector<pliant_label_segment> segments;
    for (const dicom_file::elements &item : file.segments) {
        pliant_label_segment one = {};
        const int number = number_in(item, SEGMENT_NUMBER);
        if (number < 0)
            fail(PLIANT_ERROR_FORMAT, "%s: item %zu of SegmentSequence has no SegmentNumber (0062,0004): %s",
                 path.c_str(), segments.size() + 1, EXPORT);
        if (number == 0) continue; /* the background of a label map */
        one.value = static_cast<uint16_t>(number);
        set_text(text_in(item, SEGMENT_LABEL), one.name);
        set_text(text_in(item, CODE_MEANING) == "Tissue" ? "" : text_in(item, CODE_MEANING), one.terminology);
        set_color(item, one.color);
        segments.push_back(one);
    }
    std::vector<int> position(UINT16_MAX + 1, 0);
    for (const pliant_label_segment &one : segments)
        if (position[one.value]++ > 0)
            fail(PLIANT_ERROR_FORMAT, "%s: two segments have SegmentNumber (0062,0004) %d: %s", path.c_str(), one.value,
                 EXPORT);
    if (segments.empty())
        fail(PLIANT_ERROR_FORMAT,
             "%s: is a DICOM segmentation (SEG) without segments (SegmentSequence (0062,0002)): %s", path.c_str(),
             EXPORT);
    return segments;
}

double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* The grid of all frames, and the slice of each frame. The file contains no slices without segments. */
struct frame_grid {
    grid whole;
    std::vector<size_t> slice;

    frame_grid(const std::string &path, const dicom_file &file, size_t frames) : path_(path), slice(frames, 0)
    {
        std::vector<double> spacing, thickness, between;
        for (size_t f = 0; f < frames; f++) {
            positions_.push_back(numbers(file, f, POSITION, 3, "ImagePositionPatient"));
            const std::vector<double> orientation = numbers(file, f, ORIENTATION, 6, "ImageOrientationPatient");
            spacing = numbers(file, f, PIXEL_SPACING, 2, "PixelSpacing");
            between = numbers_of_frame(path, file, f, SLICE_SPACING, 1, "SpacingBetweenSlices");
            thickness = numbers_of_frame(path, file, f, THICKNESS, 1, "SliceThickness");
            for (size_t n = 0; n < 6; n++)
                if (f > 0 && std::fabs(orientation[n] - orientation_[n]) > 1e-4)
                    fail(PLIANT_ERROR_FORMAT, "%s: ImageOrientationPatient of frames 1 and %zu differ: %s",
                         path.c_str(), f + 1, EXPORT);
            orientation_ = orientation;
        }
        set_axes(spacing);
        place(step_of(between, thickness), file);
    }

private:
    const std::string &path_;
    std::vector<std::vector<double>> positions_;
    std::vector<double> orientation_, along_;
    double normal_[3];

    std::vector<double> numbers(const dicom_file &file, size_t frame, uint32_t tag, size_t count,
                                const char *what) const
    {
        std::vector<double> found = numbers_of_frame(path_, file, frame, tag, count, what);
        if (found.empty())
            fail(PLIANT_ERROR_FORMAT, "%s: frame %zu of a DICOM segmentation (SEG) has no %s: %s", path_.c_str(),
                 frame + 1, what, EXPORT);
        return found;
    }

    void set_axes(const std::vector<double> &spacing)
    {
        const double *row = orientation_.data(), *column = row + 3;
        for (int d = 0; d < 3; d++)
            normal_[d] = row[(d + 1) % 3] * column[(d + 2) % 3] - row[(d + 2) % 3] * column[(d + 1) % 3];
        const double length = std::sqrt(dot(normal_, normal_));
        if (!(std::fabs(length - 1.0) <= 2e-3))
            fail(PLIANT_ERROR_FORMAT, "%s: ImageOrientationPatient is not two unit vectors at right angles",
                 path_.c_str());
        for (int d = 0; d < 3; d++) {
            normal_[d] /= length;
            whole.direction[3 * d] = row[d];
            whole.direction[3 * d + 1] = column[d];
            whole.direction[3 * d + 2] = normal_[d];
        }
        whole.spacing[0] = spacing[1]; /* PixelSpacing: between rows first */
        whole.spacing[1] = spacing[0];
        for (const std::vector<double> &position : positions_) along_.push_back(dot(position.data(), normal_));
    }

    /* Return whether all frames are an integer number of steps from the first one, within 5 %. */
    bool is_step(double step) const
    {
        const double first = *std::min_element(along_.begin(), along_.end());
        return step > 0.0 && std::all_of(along_.begin(), along_.end(), [&](double along) {
                   return std::fabs((along - first) / step - std::round((along - first) / step)) <= 0.05;
               });
    }

    double step_of(const std::vector<double> &between, const std::vector<double> &thickness) const
    {
        std::vector<double> sorted = along_;
        std::sort(sorted.begin(), sorted.end());
        double smallest = 0.0;
        for (size_t n = 1; n < sorted.size(); n++) {
            const double step = sorted[n] - sorted[n - 1];
            if (step > 1e-3 && (smallest == 0.0 || step < smallest)) smallest = step;
        }
        const double declared = between.empty() ? 0.0 : std::fabs(between[0]),
                     thick = thickness.empty() ? 0.0 : thickness[0];
        /* The file contains no slices without segments. */
        const double step = is_step(declared) ? declared : is_step(thick) ? thick : smallest;
        if (smallest == 0.0 && step == 0.0)
            fail(PLIANT_ERROR_FORMAT,
                 "%s: a DICOM segmentation (SEG) of one slice without SliceThickness and SpacingBetweenSlices: %s",
                 path_.c_str(), EXPORT);
        if (!is_step(step))
            fail(
                PLIANT_ERROR_FORMAT,
                "%s: the slices of the DICOM segmentation (SEG) are not evenly spaced (SpacingBetweenSlices %g mm, "
                "smallest distance of slices %g mm): %s",
                path_.c_str(), declared, smallest, EXPORT);
        const double length = sorted.back() - sorted.front(), steps = std::round(length / step);
        return steps > 0.0 ? length / steps : step;
    }

    void place(double step, const dicom_file &file)
    {
        const double max_slices = 100000;
        const size_t lowest = static_cast<size_t>(std::min_element(along_.begin(), along_.end()) - along_.begin());
        double last = 0.0;
        whole.spacing[2] = step;
        for (int d = 0; d < 3; d++) whole.origin[d] = positions_[lowest][static_cast<size_t>(d)];
        for (size_t f = 0; f < slice.size(); f++) {
            const double k = std::round((along_[f] - along_[lowest]) / step);
            double aside = 0.0;
            for (int d = 0; d < 3; d++)
                aside = std::max(
                    aside, std::fabs(positions_[f][static_cast<size_t>(d)] - whole.origin[d] - k * step * normal_[d]));
            if (!(aside <= 0.1 * std::min(step, std::min(whole.spacing[0], whole.spacing[1]))) || !(k < max_slices))
                fail(
                    PLIANT_ERROR_FORMAT,
                    "%s: frame %zu of the DICOM segmentation (SEG) lies %g mm from the grid of the others "
                    "(ImagePositionPatient): %s",
                    path_.c_str(), f + 1, aside, EXPORT);
            slice[f] = static_cast<size_t>(k);
            last = std::max(last, k);
        }
        whole.size = {file.whole(COLUMNS, 0), file.whole(ROWS, 0), static_cast<int64_t>(last) + 1};
    }
};

class dicom_segments_source : public image_source {
public:
    dicom_segments_source(const std::string &path, const dicom_file &file) : path_(path), file_(file)
    {
        segments = segments_of(path, file);
        number_segments(path, &segments);
        position_.assign(UINT16_MAX + 1, 0);
        for (size_t n = 0; n < segments.size(); n++) position_[segments[n].value] = static_cast<uint16_t>(n + 1);
        if (file.frames.empty())
            fail(PLIANT_ERROR_FORMAT,
                 "%s: is a DICOM segmentation (SEG) without PerFrameFunctionalGroupsSequence (5200,9230): %s",
                 path.c_str(), EXPORT);
        if (!file.has_pixels)
            fail(PLIANT_ERROR_FORMAT, "%s: truncated DICOM segmentation (SEG): no PixelData", path.c_str());
        const size_t frames = frames_of(path, file);
        set_type();
        set_segments(frames);
        frame_grid grid(path, file, frames);
        slice_ = std::move(grid.slice);
        header.geometry = checked_geometry(path, grid.whole);
        header.type = component::uint16;
        header.whole_numbers = true;
        set_pixels(frames);
    }

    void read(void *voxels) override
    {
        segment_painter painter(segments, pliant_geometry_voxels(&header.geometry), static_cast<uint16_t *>(voxels));
        if (is_bits_) read_bits(&painter);
        else read_numbers(&painter);
        painter.finish(path_);
    }

private:
    std::string path_;
    dicom_file file_;
    bool is_bits_ = false, is_label_map_ = false;
    int threshold_ = 1;              /* fractions: at least half of the maximum */
    std::vector<uint16_t> position_; /* position of a SegmentNumber in segments, from 1 */
    std::vector<size_t> slice_, segment_of_frame_;
    dicom_pixels pixels_;
    std::vector<std::vector<dicom_file::part>> parts_;

    bool is_jpeg_2000() const
    {
        return file_.compressed && file_.transfer_syntax.compare(0, 21, "1.2.840.10008.1.2.4.9") == 0;
    }

    void set_type()
    {
        const std::string type = file_.text(SEGMENTATION_TYPE);
        const int bits = file_.whole(BITS_ALLOCATED, 1);
        is_label_map_ = type == "LABELMAP";
        is_bits_ = bits == 1 && !is_jpeg_2000(); /* JPEG 2000 stores a number per voxel */
        const bool good = type == "BINARY" || type.empty() ? bits == 1 || bits == 8
                          : type == "FRACTIONAL"           ? bits == 8
                                                           : is_label_map_ && (bits == 8 || bits == 16);
        if (!good)
            fail(PLIANT_ERROR_FORMAT, "%s: SegmentationType (0062,0001) \"%.20s\" with %d bits is not supported: %s",
                 path_.c_str(), type.c_str(), bits, EXPORT);
        if (type != "FRACTIONAL") return;
        const int largest = file_.whole(MAXIMUM_FRACTION, 255);
        threshold_ = std::max(1, (largest + 1) / 2);
        pliant_log(PLIANT_LOG_INFO,
                   "%s: fractions (SegmentationType FRACTIONAL): a segment has the voxels of at least half of %d",
                   path_.c_str(), largest);
    }

    void set_segments(size_t frames)
    {
        for (size_t f = 0; f < frames && !is_label_map_; f++) {
            int number = number_in(file_.frames[f], REFERENCED_SEGMENT);
            if (number < 0) number = number_in(file_.shared, REFERENCED_SEGMENT);
            if (number < 1 || position_[static_cast<size_t>(number)] == 0)
                fail(PLIANT_ERROR_FORMAT,
                     "%s: frame %zu: ReferencedSegmentNumber (0062,000b) is %d, which is not in SegmentSequence: %s",
                     path_.c_str(), f + 1, number, EXPORT);
            segment_of_frame_.push_back(position_[static_cast<size_t>(number)] - 1u);
        }
    }

    void set_pixels(size_t frames)
    {
        pixels_.rows = file_.whole(ROWS, 0);
        pixels_.columns = file_.whole(COLUMNS, 0);
        pixels_.transfer_syntax = file_.transfer_syntax;
        pixels_.compressed = file_.compressed;
        const int bits = file_.whole(BITS_ALLOCATED, 1);
        pixels_.bits_allocated = bits == 1 ? 8 : bits;
        pixels_.bits_stored = bits == 1 ? 8 : file_.whole(BITS_STORED, bits);
        if (pixels_.bits_stored < 1 || pixels_.bits_stored > pixels_.bits_allocated)
            fail(PLIANT_ERROR_FORMAT, "%s: %d bits stored in %d", path_.c_str(), pixels_.bits_stored,
                 pixels_.bits_allocated);
        const std::string compression = file_.compressed ? unsupported_compression(file_.transfer_syntax) : "";
        if (!compression.empty()) fail(PLIANT_ERROR_FORMAT, "%s: %s", path_.c_str(), compression.c_str());
        if (is_bits_ && file_.compressed)
            fail(PLIANT_ERROR_FORMAT,
                 "%s: compressed pixels of 1 bit are not supported: decompress it (gdcmconv --raw, pydicom), or %s",
                 path_.c_str(), EXPORT);
        if (!is_bits_) {
            parts_ = parts_of_frames(path_, file_, frames, pixels_.count() * component_size(pixels_.type()));
            return;
        }
        const double needed = std::ceil(static_cast<double>(frames) * static_cast<double>(pixels_.count()) / 8.0);
        if (static_cast<double>(file_.pixels.length) < needed)
            fail(PLIANT_ERROR_FORMAT, "%s: truncated: the pixels of %zu frame(s) need %.0f bytes, PixelData has %.0f",
                 path_.c_str(), frames, needed, static_cast<double>(file_.pixels.length));
    }

    /* Frames follow each other without a gap, also within a byte (PS3.5 8.1.1). */
    void read_bits(segment_painter *painter)
    {
        dicom_bytes stream(path_, file_.deflated_from);
        const size_t count = pixels_.count(), total = slice_.size() * count;
        std::vector<unsigned char> block(1 << 16);
        for (size_t bit = 0; bit < total;) {
            const size_t bytes = std::min(block.size(), (total - bit + 7) / 8);
            stream.read(file_.pixels.offset + bit / 8, block.data(), bytes, "the pixel data");
            for (size_t n = 0; n < bytes; n++, bit += 8)
                for (size_t b = 0; block[n] >> b; b++)
                    if (block[n] >> b & 1 && bit + b < total) {
                        const size_t frame = (bit + b) / count;
                        painter->put(slice_[frame] * count + (bit + b) % count, segment_of_frame_[frame]);
                    }
        }
    }

    void read_numbers(segment_painter *painter)
    {
        const size_t count = pixels_.count(), size = component_size(pixels_.type());
        std::vector<unsigned char> image(count * size);
        std::vector<bool> padded;
        dicom_bytes bytes(path_, file_.deflated_from);
        for (size_t frame = 0; frame < slice_.size(); frame++) {
            dicom_pixels pixels = pixels_;
            pixels.parts = parts_[frame];
            read_dicom_pixels(&bytes, pixels, image.data(), &padded);
            for (size_t n = 0; n < count; n++) {
                uint16_t value = image[n];
                if (size == 2) std::memcpy(&value, &image[2 * n], sizeof value);
                if (is_label_map_ ? value == 0 : value < threshold_) continue;
                const size_t segment = is_label_map_ ? position_[value] : segment_of_frame_[frame] + 1u;
                if (segment == 0)
                    fail(PLIANT_ERROR_FORMAT, "%s: frame %zu holds label %d, which is not in SegmentSequence: %s",
                         path_.c_str(), frame + 1, value, EXPORT);
                painter->put(slice_[frame] * count + n, segment - 1);
            }
        }
    }
};

} // namespace

std::unique_ptr<image_source> open_dicom_segments(const std::string &path, const dicom_file &file)
{
    return std::unique_ptr<image_source>(new dicom_segments_source(path, file));
}

} // namespace pliant_read
