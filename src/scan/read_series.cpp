/* The slices of a DICOM series as one regular grid. Slice spacing comes from ImagePositionPatient; SliceThickness,
 * SpacingBetweenSlices and the order of files or instance numbers are not looked at (DICOM PS3.3 C.7.6.2). */
#include "scan/read_dicom.h"

#include <algorithm>
#include <cmath>
#include <cstring>
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

/* Every slice has what a grid needs, and it is the same for all. */
void check_alike(const std::vector<dicom_slice> &slices)
{
    const dicom_slice &first = slices.front();
    for (const dicom_slice &slice : slices) {
        if (slice.inverted != first.inverted)
            fail(PLIANT_ERROR_FORMAT, "%s: some images of the series are MONOCHROME1, others MONOCHROME2", slice.path.c_str());
        const std::string place = folder_of(slice.path) + slice.name;
        const char *path = place.c_str();
        if (!slice.problem.empty()) fail(PLIANT_ERROR_FORMAT, "%s", slice.problem.c_str());
        if (slice.position.empty()) fail(PLIANT_ERROR_FORMAT, "%s: no ImagePositionPatient: the place of the slice is not known", path);
        if (slice.orientation.empty()) fail(PLIANT_ERROR_FORMAT, "%s: no ImageOrientationPatient", path);
        if (slice.spacing.empty()) fail(PLIANT_ERROR_FORMAT, "%s: no PixelSpacing", path);
        if (slice.pixels.rows != first.pixels.rows || slice.pixels.columns != first.pixels.columns)
            fail(PLIANT_ERROR_FORMAT, "%s: %d x %d pixels, but %s of the same series has %d x %d", path, slice.pixels.columns,
                 slice.pixels.rows, first.name.c_str(), first.pixels.columns, first.pixels.rows);
        for (size_t d = 0; d < 6; d++)
            if (std::fabs(slice.orientation[d] - first.orientation[d]) > 1e-3)
                fail(PLIANT_ERROR_FORMAT, "%s: ImageOrientationPatient differs from that of %s of the same series", path, first.name.c_str());
        for (size_t d = 0; d < 2; d++)
            if (std::fabs(slice.spacing[d] - first.spacing[d]) > 1e-3 * std::fabs(first.spacing[d]))
                fail(PLIANT_ERROR_FORMAT, "%s: PixelSpacing %g x %g mm, but %s of the same series has %g x %g", path, slice.spacing[0],
                     slice.spacing[1], first.name.c_str(), first.spacing[0], first.spacing[1]);
    }
}

/* No image twice, no two at the same place. */
void check_duplicates(const std::string &folder, const std::vector<dicom_slice> &sorted)
{
    for (size_t n = 1; n < sorted.size(); n++) {
        const dicom_slice &a = sorted[n - 1], &b = sorted[n];
        if (b.along - a.along > 1e-3) continue;
        if (!a.instance.empty() && a.instance == b.instance)
            fail(PLIANT_ERROR_FORMAT, "%s: %s and %s are the same image twice", folder.c_str(), a.name.c_str(), b.name.c_str());
        fail(PLIANT_ERROR_FORMAT, "%s: %s and %s are at the same place (%g mm along the stack): several time points, echoes or a duplicate; one 3-D volume is needed",
             folder.c_str(), a.name.c_str(), b.name.c_str(), a.along);
    }
}

/* The slices stand one step apart along a line. A fiftieth of a step, a tenth of a pixel sideways are rounding.
 * Returns the step along the normal [mm]. */
double check_steps(const std::string &folder, const std::vector<dicom_slice> &sorted, const double normal[3])
{
    const dicom_slice &first = sorted.front(), &last = sorted.back();
    double step = (last.along - first.along) / static_cast<double>(sorted.size() - 1);
    std::vector<double> gaps;
    for (size_t n = 1; n < sorted.size(); n++) gaps.push_back(sorted[n].along - sorted[n - 1].along);
    std::vector<double> ordered = gaps;
    std::sort(ordered.begin(), ordered.end());
    double usual = ordered[(ordered.size() - 1) / 2];

    for (size_t n = 0; n < sorted.size(); n++)
        if (std::fabs(sorted[n].along - first.along - static_cast<double>(n) * step) > 0.02 * step) {
            for (size_t g = 0; g < gaps.size(); g++) {
                double missing = std::round(gaps[g] / usual) - 1.0;
                if (missing >= 1.0 && std::fabs(gaps[g] - (missing + 1.0) * usual) < 0.1 * usual)
                    fail(PLIANT_ERROR_FORMAT, "%s: %.0f slice(s) missing between %s and %s: %g mm apart, others are %g mm", folder.c_str(),
                         missing, sorted[g].name.c_str(), sorted[g + 1].name.c_str(), gaps[g], usual);
            }
            fail(PLIANT_ERROR_FORMAT, "%s: the slices are not evenly spaced: %g to %g mm apart; resample them to one spacing first", folder.c_str(),
                 ordered.front(), ordered.back());
        }

    double pixel = std::min(first.spacing[0], first.spacing[1]);
    for (const dicom_slice &slice : sorted) {
        double offset[3], sideways = 0.0;
        for (size_t d = 0; d < 3; d++) offset[d] = slice.position[d] - first.position[d];
        double along = dot(offset, normal);
        for (size_t d = 0; d < 3; d++) sideways += std::pow(offset[d] - along * normal[d], 2);
        sideways = std::sqrt(sideways);
        if (sideways > 0.1 * pixel)
            fail(PLIANT_ERROR_FORMAT, "%s: sheared stack: %s lies %.3g mm sideways of %s (gantry tilt of %.1f degrees?); resample it to a grid "
                 "with right angles first", folder.c_str(), slice.name.c_str(), sideways, first.name.c_str(),
                 std::atan2(sideways, std::fabs(along)) * 180.0 / PI);
    }
    return step;
}

grid grid_of(const std::string &folder, std::vector<dicom_slice> &slices)
{
    check_alike(slices);
    if (slices.size() < 2)
        fail(PLIANT_ERROR_FORMAT, "%s: one slice (%s) is a 2-D image, a 3-D volume is needed", folder.c_str(), slices[0].name.c_str());
    const std::vector<double> orientation = slices[0].orientation;
    const double *row = orientation.data(), *column = row + 3;
    double normal[3];
    cross(row, column, normal);
    double length = std::sqrt(dot(normal, normal));
    if (!(std::fabs(length - 1.0) <= 2e-3) || !(std::fabs(dot(row, row) - 1.0) <= 2e-3))
        fail(PLIANT_ERROR_FORMAT, "%s: ImageOrientationPatient is not two unit vectors at right angles", slices[0].path.c_str());
    for (double &value : normal) value /= length;
    for (dicom_slice &slice : slices) slice.along = dot(slice.position.data(), normal);
    std::sort(slices.begin(), slices.end(), [](const dicom_slice &a, const dicom_slice &b) { return a.along < b.along; });
    check_duplicates(folder, slices);

    const dicom_slice &first = slices.front();
    grid grid;
    grid.size = {first.pixels.columns, first.pixels.rows, static_cast<int64_t>(slices.size())};
    grid.spacing[0] = first.spacing[1]; /* PixelSpacing: between rows first */
    grid.spacing[1] = first.spacing[0];
    grid.spacing[2] = check_steps(folder, slices, normal);
    for (size_t d = 0; d < 3; d++) {
        grid.origin[d] = first.position[d];
        grid.direction[3 * d] = row[d];
        grid.direction[3 * d + 1] = column[d];
        grid.direction[3 * d + 2] = normal[d];
    }
    return grid;
}

template <class From> void rescale(const void *from, const dicom_pixels &pixels, double *to)
{
    for (size_t n = 0; n < pixels.count(); n++) to[n] = pixels.slope * static_cast<double>(static_cast<const From *>(from)[n]) + pixels.intercept;
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

/* value -> smallest + largest - value: bright and dark change places, the range stays. */
template <class Number> void turn_round(void *values, size_t count)
{
    Number *v = static_cast<Number *>(values);
    using wide = typename std::conditional<std::is_integral<Number>::value, int64_t, double>::type;
    wide ends = static_cast<wide>(*std::min_element(v, v + count)) + static_cast<wide>(*std::max_element(v, v + count));
    for (size_t n = 0; n < count; n++) v[n] = static_cast<Number>(ends - static_cast<wide>(v[n]));
}

void turn_round_any(component type, void *values, size_t count)
{
    switch (type) {
    case component::uint8: return turn_round<uint8_t>(values, count);
    case component::int8: return turn_round<int8_t>(values, count);
    case component::uint16: return turn_round<uint16_t>(values, count);
    case component::int16: return turn_round<int16_t>(values, count);
    case component::uint32: return turn_round<uint32_t>(values, count);
    case component::int32: return turn_round<int32_t>(values, count);
    case component::float64: return turn_round<double>(values, count);
    default: return;
    }
}

/* Slices of one type and scale are kept as stored; others (PET, some MRI) are rescaled one by one as double. */
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
            if (one.type() != first.type() || one.slope != first.slope || one.intercept != first.intercept) alike_ = false;
            if (one.slope != std::floor(one.slope) || one.intercept != std::floor(one.intercept)) header.whole_numbers = false;
        }
        if (alike_) return;
        header.type = component::float64;
        header.slope = 1.0;
        header.intercept = 0.0;
    }

    void read(void *voxels) override
    {
        char *to = static_cast<char *>(voxels);
        std::vector<char> stored;
        for (const dicom_slice &slice : slices_) {
            const dicom_pixels &pixels = slice.pixels;
            if (alike_) {
                read_dicom_pixels(slice.path, pixels, to);
            } else {
                stored.resize(pixels.count() * component_size(pixels.type()));
                read_dicom_pixels(slice.path, pixels, stored.data());
                rescale_any(stored.data(), pixels, reinterpret_cast<double *>(to));
            }
            to += pixels.count() * component_size(header.type);
        }
        if (!slices_.front().inverted) return;
        turn_round_any(header.type, voxels, pliant_geometry_voxels(&header.geometry));
        pliant_log(PLIANT_LOG_INFO, "%s: MONOCHROME1, intensities without a unit: inverted (smallest + largest - value), so that what is shown bright has large values",
                   slices_.front().path.c_str());
    }

private:
    std::vector<dicom_slice> slices_;
    bool alike_ = true;
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
