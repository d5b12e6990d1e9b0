/* Builds a regular grid from the slices of a DICOM series. The slice spacing comes from ImagePositionPatient.
 * SliceThickness, SpacingBetweenSlices, and the order of files or instance numbers are ignored (DICOM PS3.3
 * C.7.6.2). */
#include "scan/read_dicom.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <set>
#include <type_traits>

namespace pliant_read {

namespace {

const double PI = 3.14159265358979323846;

double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

void cross(const double *a, const double *b, double *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

const size_t MAX_NAMES = 8; /* in a message */

std::string place_of(const dicom_slice &slice) { return folder_of(slice.path) + slice.name; }

/* Return the name of a missing property that a slice needs; "" if all exist. */
std::string missing_property(const dicom_slice &slice)
{
    if (!slice.problem.empty()) return slice.problem;
    if (slice.position.empty())
        return place_of(slice) + ": no ImagePositionPatient: the place of the slice is not known";
    if (slice.orientation.empty()) return place_of(slice) + ": no ImageOrientationPatient";
    if (slice.spacing.empty()) return place_of(slice) + ": no PixelSpacing";
    return "";
}

/* Return why two complete slices cannot be in one stack; "" if they can. */
std::string difference(const dicom_slice &slice, const dicom_slice &other)
{
    char text[400] = "";
    const char *const name = other.name.c_str();
    if (slice.pixels.rows != other.pixels.rows || slice.pixels.columns != other.pixels.columns)
        snprintf(text, sizeof text, "%d x %d pixels, but %.200s of the same series has %d x %d", slice.pixels.columns,
                 slice.pixels.rows, name, other.pixels.columns, other.pixels.rows);
    for (size_t d = 0; d < 6 && !*text; d++)
        if (std::fabs(slice.orientation[d] - other.orientation[d]) > 1e-3)
            snprintf(text, sizeof text, "ImageOrientationPatient differs from %.200s of the same series", name);
    for (size_t d = 0; d < 2 && !*text; d++)
        if (std::fabs(slice.spacing[d] - other.spacing[d]) > 1e-3 * std::fabs(other.spacing[d]))
            snprintf(text, sizeof text, "PixelSpacing %g x %g mm, but %.200s of the same series has %g x %g",
                     slice.spacing[0], slice.spacing[1], name, other.spacing[0], other.spacing[1]);
    return text;
}

/* Group the slices that can be in one stack, by index. */
std::vector<std::vector<size_t>> groups_of(const std::vector<dicom_slice> &slices,
                                           const std::vector<size_t> &candidates)
{
    std::vector<std::vector<size_t>> groups;
    for (size_t n : candidates) {
        auto group = std::find_if(groups.begin(), groups.end(), [&](const std::vector<size_t> &one) {
            return difference(slices[n], slices[one.front()]).empty();
        });
        if (group == groups.end())
            groups.push_back({n});
        else
            group->push_back(n);
    }
    return groups;
}

std::string reason_to_omit(const dicom_slice &slice, const dicom_slice &kept)
{
    const std::string lack = missing_property(slice);
    if (!lack.empty()) return lack;
    return place_of(slice) + ": " + (slice.is_scout ? "a scout (ImageType says LOCALIZER)" : difference(slice, kept));
}

/* Keep the stack of a series that also contains scouts, pictures or other views. Return why each other image was left
 * out, for messages. */
std::string keep_stack(const std::string &folder, std::vector<dicom_slice> *slices)
{
    std::vector<size_t> placed, candidates;
    for (size_t n = 0; n < slices->size(); n++) {
        const dicom_slice &slice = (*slices)[n];
        if (!slice.problem.empty() && !slice.is_picture) fail(PLIANT_ERROR_FORMAT, "%s", slice.problem.c_str());
        if (missing_property(slice).empty()) placed.push_back(n);
    }
    if (placed.empty()) fail(PLIANT_ERROR_FORMAT, "%s", missing_property(slices->front()).c_str());
    for (size_t n : placed)
        if (!(*slices)[n].is_scout) candidates.push_back(n);
    if (candidates.empty()) candidates = placed;
    std::vector<std::vector<size_t>> groups = groups_of(*slices, candidates);
    const std::vector<size_t> stack =
        *std::max_element(groups.begin(), groups.end(), [](const std::vector<size_t> &a, const std::vector<size_t> &b) {
            return a.size() < b.size();
        });
    std::string text;
    size_t num_left_out = slices->size() - stack.size(), named = 0;
    std::vector<bool> is_kept(slices->size(), false);
    std::vector<dicom_slice> kept;
    std::set<std::string> files;
    for (size_t n : stack) {
        is_kept[n] = true;
        files.insert((*slices)[n].path);
        kept.push_back((*slices)[n]);
    }
    for (size_t n = 0; n < slices->size(); n++) {
        if (is_kept[n]) continue;
        const std::string why = reason_to_omit((*slices)[n], kept.front());
        if (files.count((*slices)[n].path))
            fail(PLIANT_ERROR_FORMAT, "%s", why.c_str()); /* its file also contains slices of the stack */
        if (named++ < MAX_NAMES) text += (text.empty() ? "" : "; ") + why;
    }
    if (named > MAX_NAMES) text += "; and " + std::to_string(named - MAX_NAMES) + " more";
    if (2 * stack.size() <= candidates.size())
        fail(PLIANT_ERROR_FORMAT,
             "%s: images of several sizes or orientations, and none is the majority. Move the images of other scans to "
             "another folder: %s",
             folder.c_str(), text.c_str());
    if (num_left_out)
        pliant_log(PLIANT_LOG_WARNING,
                   "%s: %zu images of the series do not fit the stack of the other %zu and were ignored: %s",
                   folder.c_str(), num_left_out, stack.size(), text.c_str());
    *slices = std::move(kept);
    return text;
}

/* Fail if the values of the slices have different meanings. */
void check_alike(const std::vector<dicom_slice> &slices)
{
    const dicom_slice &first = slices.front();
    for (const dicom_slice &slice : slices) {
        if (slice.inverted != first.inverted)
            fail(PLIANT_ERROR_FORMAT, "%s: some images of the series are MONOCHROME1, others MONOCHROME2",
                 slice.path.c_str());
        if (slice.pixels.has_rescale != first.pixels.has_rescale)
            fail(PLIANT_ERROR_FORMAT,
                 "%s: some images of the series have a RescaleIntercept, others have none: add it to all, as their "
                 "scanner wrote it",
                 slice.path.c_str());
    }
}

/* Check that no image occurs twice, and no two images have the same position. */
void check_duplicates(const std::string &folder, const std::vector<dicom_slice> &sorted)
{
    for (size_t n = 1; n < sorted.size(); n++) {
        const dicom_slice &a = sorted[n - 1], &b = sorted[n];
        if (b.along - a.along > 1e-3) continue;
        if (!a.instance.empty() && a.instance == b.instance)
            fail(PLIANT_ERROR_FORMAT, "%s: %s and %s are the same image twice", folder.c_str(), a.name.c_str(),
                 b.name.c_str());
        fail(PLIANT_ERROR_FORMAT,
             "%s: %s and %s are at the same position (%g mm along the stack): several time points, echoes or a "
             "duplicate; one 3-D volume is needed",
             folder.c_str(), a.name.c_str(), b.name.c_str(), a.along);
    }
}

/* Positions on a line with constant distance. */
struct regular {
    double step, first[3]; /* along the normal; position of the first slice [mm] */
};

/* Fit regular positions to the slices (least squares). */
regular fit_line(const std::vector<dicom_slice> &sorted, const double normal[3])
{
    const double count = static_cast<double>(sorted.size()), middle = 0.5 * (count - 1.0);
    regular line = {0.0, {0.0, 0.0, 0.0}};
    double weight = 0.0;
    for (size_t n = 0; n < sorted.size(); n++) {
        const double from_middle = static_cast<double>(n) - middle;
        line.step += from_middle * sorted[n].along;
        weight += from_middle * from_middle;
        for (size_t d = 0; d < 3; d++) line.first[d] += sorted[n].position[d] / count;
    }
    line.step /= weight;
    for (size_t d = 0; d < 3; d++) line.first[d] -= middle * line.step * normal[d];
    return line;
}

/* Fail if a gap is a multiple of the usual gap. */
void check_missing(const std::string &folder, const std::vector<dicom_slice> &sorted, const std::vector<double> &gaps,
                   double usual)
{
    for (size_t g = 0; g < gaps.size(); g++) {
        const double missing = std::round(gaps[g] / usual) - 1.0;
        if (missing >= 1.0 && std::fabs(gaps[g] - (missing + 1.0) * usual) < 0.1 * (missing + 1.0) * usual)
            fail(PLIANT_ERROR_FORMAT, "%s: %.0f slice(s) missing between %s and %s: %g mm apart, others are %g mm",
                 folder.c_str(), missing, sorted[g].name.c_str(), sorted[g + 1].name.c_str(), gaps[g], usual);
    }
}

/* Return the distance of a slice from the line through `from` along the normal [mm]. */
double distance_from_line(const dicom_slice &slice, const double from[3], const double normal[3])
{
    double offset[3], square = 0.0;
    for (size_t d = 0; d < 3; d++) offset[d] = slice.position[d] - from[d];
    const double along = dot(offset, normal);
    for (size_t d = 0; d < 3; d++) square += std::pow(offset[d] - along * normal[d], 2);
    return std::sqrt(square);
}

/* Return the regular positions of slices that are one step apart along a line. Deviations up to a fiftieth of a step,
 * or a tenth of a pixel sideways, are rounding. Positions rounded to 0.1 mm, or off by a twentieth of a step, cause a
 * warning. */
regular check_steps(const std::string &folder, const std::vector<dicom_slice> &sorted, const double normal[3])
{
    const dicom_slice &first = sorted.front(), &last = sorted.back();
    regular line = {(last.along - first.along) / static_cast<double>(sorted.size() - 1),
                    {first.position[0], first.position[1], first.position[2]}};
    const regular fitted = fit_line(sorted, normal);
    const double fitted_along = dot(fitted.first, normal), pixel = std::min(first.spacing[0], first.spacing[1]);
    const double slack = 1.0 + 1e-6, rounding = 0.1 * slack; /* [mm]; less for small voxels */
    std::vector<double> gaps;
    for (size_t n = 1; n < sorted.size(); n++) gaps.push_back(sorted[n].along - sorted[n - 1].along);
    std::vector<double> ordered = gaps;
    std::sort(ordered.begin(), ordered.end());
    double usual = ordered[(ordered.size() - 1) / 2], off = 0.0, max_from_line = 0.0;
    bool irregular = false;

    for (size_t n = 0; n < sorted.size(); n++) {
        irregular = irregular ||
                    std::fabs(sorted[n].along - first.along - static_cast<double>(n) * line.step) > 0.02 * line.step;
        off = std::max(off, std::fabs(sorted[n].along - fitted_along - static_cast<double>(n) * fitted.step));
    }
    if (irregular) check_missing(folder, sorted, gaps, usual);
    if (irregular && off > std::max(0.05 * fitted.step * slack, std::min(rounding, 0.25 * fitted.step)))
        fail(PLIANT_ERROR_FORMAT,
             "%s: the slices are not evenly spaced: %g to %g mm apart, up to %.3g mm from even places; resample them "
             "to one spacing first",
             folder.c_str(), ordered.front(), ordered.back(), off);
    for (const dicom_slice &slice : sorted) {
        const double from_first = distance_from_line(slice, first.position.data(), normal),
                     from_line = distance_from_line(slice, fitted.first, normal);
        if (from_first <= 0.1 * pixel) continue;
        if (from_line > std::min(rounding, 0.25 * pixel))
            fail(PLIANT_ERROR_FORMAT,
                 "%s: sheared stack: %s lies %.3g mm sideways of %s (gantry tilt of %.1f degrees?); resample it to a "
                 "grid "
                 "with right angles first",
                 folder.c_str(), slice.name.c_str(), from_first, first.name.c_str(),
                 std::atan2(from_first, std::fabs(slice.along - first.along)) * 180.0 / PI);
        max_from_line = std::max(max_from_line, from_line);
    }
    if (!irregular && max_from_line == 0.0) return line;
    pliant_log(
        PLIANT_LOG_WARNING,
        "%s: the positions of slices are rounded: up to %.3g mm from a regular grid along the stack, %.3g mm sideways; "
        "taken as %.6g mm apart",
        folder.c_str(), off, max_from_line, fitted.step);
    return fitted;
}

grid stack_grid(const std::string &folder, std::vector<dicom_slice> &slices)
{
    check_alike(slices);
    if (slices.size() < 2)
        fail(PLIANT_ERROR_FORMAT, "%s: one slice (%s) is a 2-D image, a 3-D volume is needed", folder.c_str(),
             slices[0].name.c_str());
    const std::vector<double> orientation = slices[0].orientation;
    const double *row = orientation.data(), *column = row + 3;
    double normal[3];
    cross(row, column, normal);
    double length = std::sqrt(dot(normal, normal));
    if (!(std::fabs(length - 1.0) <= 2e-3) || !(std::fabs(dot(row, row) - 1.0) <= 2e-3))
        fail(PLIANT_ERROR_FORMAT, "%s: ImageOrientationPatient is not two unit vectors at right angles",
             slices[0].path.c_str());
    for (double &value : normal) value /= length;
    for (dicom_slice &slice : slices) slice.along = dot(slice.position.data(), normal);
    std::sort(slices.begin(), slices.end(),
              [](const dicom_slice &a, const dicom_slice &b) { return a.along < b.along; });
    check_duplicates(folder, slices);

    const dicom_slice &first = slices.front();
    const regular line = check_steps(folder, slices, normal);
    grid grid;
    grid.size = {first.pixels.columns, first.pixels.rows, static_cast<int64_t>(slices.size())};
    grid.spacing[0] = first.spacing[1]; /* PixelSpacing: between rows first */
    grid.spacing[1] = first.spacing[0];
    grid.spacing[2] = line.step;
    for (size_t d = 0; d < 3; d++) {
        grid.origin[d] = line.first[d];
        grid.direction[3 * d] = row[d];
        grid.direction[3 * d + 1] = column[d];
        grid.direction[3 * d + 2] = normal[d];
    }
    return grid;
}

grid grid_of(const std::string &folder, std::vector<dicom_slice> &slices)
{
    const std::string left_out = keep_stack(folder, &slices);
    try {
        return stack_grid(folder, slices);
    } catch (failure &failure) {
        if (!left_out.empty()) failure.text += "; left out of the series: " + left_out;
        throw;
    }
}

template <class From> void rescale(const void *from, const dicom_pixels &pixels, double *to)
{
    for (size_t n = 0; n < pixels.count(); n++)
        to[n] = pixels.slope * static_cast<double>(static_cast<const From *>(from)[n]) + pixels.intercept;
}

void rescale_any(const void *from, const dicom_pixels &pixels, double *to)
{
    switch (pixels.type()) {
    case component::uint8: return rescale<uint8_t>(from, pixels, to);
    case component::int8: return rescale<int8_t>(from, pixels, to);
    case component::uint16: return rescale<uint16_t>(from, pixels, to);
    case component::int16: return rescale<int16_t>(from, pixels, to);
    case component::uint32: return rescale<uint32_t>(from, pixels, to);
    case component::int32: return rescale<int32_t>(from, pixels, to);
    default: return;
    }
}

/* The voxels whose values are padding; empty if no image declares padding. */
struct padding {
    std::vector<bool> is_padded;
    bool at_corner = false; /* at a corner of an image, as around a circular field of view */

    void add(const std::vector<bool> &image, size_t begin, size_t columns, size_t voxels)
    {
        if (image.empty()) return;
        is_padded.resize(voxels, false);
        std::copy(image.begin(), image.end(), is_padded.begin() + static_cast<std::ptrdiff_t>(begin));
        at_corner = at_corner || image.front() || image.back() || image[columns - 1] || image[image.size() - columns];
    }
};

/* Assign a value to padding that is no tissue: the smallest of the image, in a CT at most `darkest`. Return false if
 * the declared value is an ordinary one, which lies between other values and occurs at no corner of an image. */
template <class Number>
bool fill_padding(const image_header &header, const padding &padding, double darkest, void *values)
{
    Number *v = static_cast<Number *>(values);
    auto value = [&](Number stored) { return header.slope * static_cast<double>(stored) + header.intercept; };
    double low = HUGE_VAL, high = -HUGE_VAL; /* of voxels other than padding */
    bool ordinary = false;
    for (size_t n = 0; n < padding.is_padded.size(); n++) {
        if (padding.is_padded[n]) continue;
        low = std::min(low, value(v[n]));
        high = std::max(high, value(v[n]));
    }
    for (size_t n = 0; n < padding.is_padded.size(); n++)
        ordinary = ordinary || (padding.is_padded[n] && value(v[n]) > low && value(v[n]) < high);
    if (ordinary && !padding.at_corner) return false;
    const double dark = std::min(low, darkest);
    if (!std::isfinite(dark)) return true; /* all is padding */
    const double exact = (dark - header.intercept) / header.slope,
                 stored = std::is_integral<Number>::value ? std::round(exact) : exact;
    const double minimum = static_cast<double>(std::numeric_limits<Number>::lowest());
    const Number fill = static_cast<Number>(
        std::min(std::max(stored, minimum), static_cast<double>(std::numeric_limits<Number>::max())));
    for (size_t n = 0; n < padding.is_padded.size(); n++)
        if (padding.is_padded[n] && (header.modality == PLIANT_MODALITY_CT || value(v[n]) > dark)) v[n] = fill;
    return true;
}

bool fill_padding_any(const image_header &header, const padding &padding, double darkest, void *values)
{
    switch (header.type) {
    case component::uint8: return fill_padding<uint8_t>(header, padding, darkest, values);
    case component::int8: return fill_padding<int8_t>(header, padding, darkest, values);
    case component::uint16: return fill_padding<uint16_t>(header, padding, darkest, values);
    case component::int16: return fill_padding<int16_t>(header, padding, darkest, values);
    case component::uint32: return fill_padding<uint32_t>(header, padding, darkest, values);
    case component::int32: return fill_padding<int32_t>(header, padding, darkest, values);
    default: return fill_padding<double>(header, padding, darkest, values);
    }
}

/* Replace value by smallest + largest - value: bright and dark are exchanged, the range stays. */
template <class Number> void invert_values(void *values, size_t count)
{
    Number *v = static_cast<Number *>(values);
    using wide = typename std::conditional<std::is_integral<Number>::value, int64_t, double>::type;
    wide ends = static_cast<wide>(*std::min_element(v, v + count)) + static_cast<wide>(*std::max_element(v, v + count));
    for (size_t n = 0; n < count; n++) v[n] = static_cast<Number>(ends - static_cast<wide>(v[n]));
}

void invert_values_any(component type, void *values, size_t count)
{
    switch (type) {
    case component::uint8: return invert_values<uint8_t>(values, count);
    case component::int8: return invert_values<int8_t>(values, count);
    case component::uint16: return invert_values<uint16_t>(values, count);
    case component::int16: return invert_values<int16_t>(values, count);
    case component::uint32: return invert_values<uint32_t>(values, count);
    case component::int32: return invert_values<int32_t>(values, count);
    case component::float64: return invert_values<double>(values, count);
    default: return;
    }
}

/* Slices of one type and scale are kept as stored. Others (PET, some MRI) are rescaled one by one as double. */
class series_source : public image_source {
public:
    explicit series_source(std::vector<dicom_slice> slices) : slices_(std::move(slices))
    {
        const dicom_pixels &first = slices_.front().pixels;
        header.type = first.type();
        header.slope = first.slope;
        header.intercept = first.intercept;
        header.whole_numbers = true;
        header.modality = slices_.front().modality;
        for (const dicom_slice &slice : slices_) {
            const dicom_pixels &one = slice.pixels;
            if (one.type() != first.type() || one.slope != first.slope || one.intercept != first.intercept)
                slices_match_ = false;
            if (one.slope != std::floor(one.slope) || one.intercept != std::floor(one.intercept))
                header.whole_numbers = false;
        }
        if (header.modality == PLIANT_MODALITY_CT && !first.has_rescale)
            pliant_log(PLIANT_LOG_WARNING,
                       "%s: a CT without RescaleIntercept (0028,1052): its values may not be Hounsfield units (its "
                       "scanner wrote -1024, as a rule)",
                       slices_.front().path.c_str());
        if (slices_match_) return;
        header.type = component::float64;
        header.slope = 1.0;
        header.intercept = 0.0;
    }

    void read(void *voxels) override
    {
        char *to = static_cast<char *>(voxels);
        std::vector<char> stored;
        std::vector<bool> of_slice;
        padding padding;
        size_t done = 0;
        std::unique_ptr<dicom_bytes> bytes; /* of one file at a time, which may have many frames */
        for (const dicom_slice &slice : slices_) {
            const dicom_pixels &pixels = slice.pixels;
            if (!bytes || bytes->path() != slice.path) bytes.reset(new dicom_bytes(slice.path, pixels.deflated_from));
            if (slices_match_) {
                read_dicom_pixels(bytes.get(), pixels, to, &of_slice);
            } else {
                stored.resize(pixels.count() * component_size(pixels.type()));
                read_dicom_pixels(bytes.get(), pixels, stored.data(), &of_slice);
                rescale_any(stored.data(), pixels, reinterpret_cast<double *>(to));
            }
            padding.add(of_slice, done, static_cast<size_t>(pixels.columns), slices_.size() * pixels.count());
            to += pixels.count() * component_size(header.type);
            done += pixels.count();
        }
        fill(padding, voxels);
        if (!slices_.front().inverted) return;
        invert_values_any(header.type, voxels, pliant_geometry_voxels(&header.geometry));
        fill(padding, voxels);
        pliant_log(
            PLIANT_LOG_INFO,
            "%s: MONOCHROME1, intensities without a unit: inverted (smallest + largest - value), so that bright voxels "
            "have large values",
            slices_.front().path.c_str());
    }

private:
    std::vector<dicom_slice> slices_;
    bool slices_match_ = true;

    bool is_hounsfield() const { return header.modality == PLIANT_MODALITY_CT && slices_.front().pixels.has_rescale; }

    void fill(const padding &padding, void *voxels) const
    {
        const size_t count = static_cast<size_t>(std::count(padding.is_padded.begin(), padding.is_padded.end(), true));
        if (count == 0) return;
        const double air = -1024.0;
        if (fill_padding_any(header, padding, is_hounsfield() ? air : HUGE_VAL, voxels))
            pliant_log(
                PLIANT_LOG_INFO,
                "%s: PixelPaddingValue: %zu voxels outside the image are treated as air, or as the smallest value that "
                "is not padding",
                slices_.front().path.c_str(), count);
        else
            pliant_log(
                PLIANT_LOG_WARNING,
                "%s: PixelPaddingValue is also a value of the image: %zu voxels have it, but no corner; they are not "
                "changed",
                slices_.front().path.c_str(), count);
    }
};

} // namespace

std::unique_ptr<image_source> open_series(const std::string &folder, std::vector<dicom_slice> slices)
{
    pliant_geometry geometry = checked_geometry(folder, grid_of(folder, slices));
    std::unique_ptr<image_source> source(new series_source(std::move(slices)));
    source->header.geometry = geometry;
    return source;
}

} // namespace pliant_read
