/* Opens a DICOM folder or a multi-frame file: finds the images and their frames, sorts them by series, and chooses a
 * series. */
#include "scan/read_dicom.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>

namespace pliant_read {

namespace {

/* Tags: group << 16 | element (PS3.6). */
enum : uint32_t {
    MEDIA_CLASS = 0x00020002,
    IMAGE_TYPE = 0x00080008,
    CLASS = 0x00080016,
    INSTANCE = 0x00080018,
    MODALITY = 0x00080060,
    SERIES_DESCRIPTION = 0x0008103e,
    SERIES = 0x0020000e,
    POSITION = 0x00200032,
    ORIENTATION = 0x00200037,
    SAMPLES = 0x00280002,
    PHOTOMETRIC = 0x00280004,
    FRAMES = 0x00280008,
    ROWS = 0x00280010,
    COLUMNS = 0x00280011,
    PIXEL_SPACING = 0x00280030,
    BITS_ALLOCATED = 0x00280100,
    BITS_STORED = 0x00280101,
    HIGH_BIT = 0x00280102,
    PIXEL_REPRESENTATION = 0x00280103,
    PADDING = 0x00280120,
    PADDING_LIMIT = 0x00280121,
    INTERCEPT = 0x00281052,
    SLOPE = 0x00281053,
    RESCALE_TYPE = 0x00281054,
    MODALITY_TABLE = 0x00283000,
    FLOAT_PIXELS = 0x7fe00008,
    DOUBLE_PIXELS = 0x7fe00009
};

double number_of(const std::string &name, const dicom_file &file, size_t frame, uint32_t tag, const char *what,
                 double otherwise)
{
    std::vector<double> numbers = numbers_of_frame(name, file, frame, tag, 1, what);
    return numbers.empty() ? otherwise : numbers[0];
}

bool is_colour(const dicom_file &file)
{
    const std::string colours = file.text(PHOTOMETRIC);
    return file.whole(SAMPLES, 1) != 1 || (!colours.empty() && colours.compare(0, 10, "MONOCHROME") != 0);
}

/* Fail with the remedy if the file contains no readable pixels. */
void check_readable(const std::string &path, const dicom_file &file)
{
    const std::string object = unsupported_object(file.text(CLASS));
    if (!object.empty()) fail(PLIANT_ERROR_FORMAT, "%s: is %s", path.c_str(), object.c_str());
    if (!file.has_pixels)
        fail(PLIANT_ERROR_FORMAT,
             "%s: its pixels are %s, which are not supported: store whole numbers with RescaleSlope and "
             "RescaleIntercept, or convert it to NIfTI",
             path.c_str(), file.has(FLOAT_PIXELS) ? "FloatPixelData (7fe0,0008)" : "DoubleFloatPixelData (7fe0,0009)");
    const std::string compression = file.compressed ? unsupported_compression(file.transfer_syntax) : "";
    if (!compression.empty()) fail(PLIANT_ERROR_FORMAT, "%s: %s", path.c_str(), compression.c_str());
    if (is_colour(file))
        fail(PLIANT_ERROR_FORMAT, "%s: a colour image (%s); one value per voxel is needed: take it out of the folder",
             path.c_str(), file.text(PHOTOMETRIC).c_str());
}

/* Read PixelPaddingValue, or the range to PixelPaddingRangeLimit, with the sign of the pixels. */
void read_padding(const dicom_file &file, dicom_pixels *pixels)
{
    auto number = [&](uint32_t tag, int otherwise) {
        const int value = file.whole(tag, otherwise);
        return pixels->is_signed ? static_cast<int>(static_cast<int16_t>(value)) : value & 0xffff;
    };
    pixels->has_padding = file.has(PADDING) && file.values.at(PADDING).size() >= 2;
    if (!pixels->has_padding) return;
    const int value = number(PADDING, 0), limit = number(PADDING_LIMIT, value);
    pixels->padding_low = std::min(value, limit);
    pixels->padding_high = std::max(value, limit);
}

/* Return the storage of the pixels, which is the same for all frames. Fails for unusable images. */
dicom_pixels stored_pixels(const std::string &path, const dicom_file &file)
{
    dicom_pixels pixels;
    pixels.transfer_syntax = file.transfer_syntax;
    pixels.deflated_from = file.deflated_from;
    pixels.compressed = file.compressed;
    pixels.rows = file.whole(ROWS, 0);
    pixels.columns = file.whole(COLUMNS, 0);
    pixels.bits_allocated = file.whole(BITS_ALLOCATED, 16);
    pixels.bits_stored = file.whole(BITS_STORED, pixels.bits_allocated);
    pixels.is_signed = file.whole(PIXEL_REPRESENTATION, 0) != 0;
    check_readable(path, file);
    if (pixels.rows < 1 || pixels.columns < 1)
        fail(PLIANT_ERROR_FORMAT, "%s: Rows and Columns are missing or 0", path.c_str());
    if (pixels.type() == component::none || pixels.bits_stored < 1 || pixels.bits_stored > pixels.bits_allocated ||
        file.whole(HIGH_BIT, pixels.bits_stored - 1) != pixels.bits_stored - 1)
        fail(PLIANT_ERROR_FORMAT,
             "%s: %d bits stored in %d with HighBit %d is not supported; 8, 16 or 32 with HighBit one less are: "
             "convert it to NIfTI",
             path.c_str(), pixels.bits_stored, pixels.bits_allocated, file.whole(HIGH_BIT, pixels.bits_stored - 1));
    if (file.has(MODALITY_TABLE) && !file.has(SLOPE))
        fail(PLIANT_ERROR_FORMAT,
             "%s: values by a ModalityLUTSequence are not supported; RescaleSlope and RescaleIntercept are",
             path.c_str());
    read_padding(file, &pixels);
    return pixels;
}

/* Return whether the values must be inverted. With MONOCHROME1 low values are displayed bright. Values with a unit
 * (Hounsfield, activity, counts) keep their meaning. Other values are intensities, which are expected to be large where
 * bright. */
bool has_inverted_values(const dicom_file &file, size_t frame)
{
    std::string modality = file.text(MODALITY), unit = file.text_of_frame(frame, RESCALE_TYPE);
    return file.text(PHOTOMETRIC) == "MONOCHROME1" && modality != "CT" && modality != "PT" && modality != "NM" &&
           unit != "HU";
}

/* Return whether the class of an object requires pixels. */
bool is_image_class(const std::string &uid)
{
    /* CT, MR, nuclear medicine, PET. */
    for (const char *one : {"2", "2.1", "2.2", "4", "4.1", "4.4", "20", "128", "128.1", "130"})
        if (uid == std::string("1.2.840.10008.5.1.4.1.1.") + one) return true;
    return false;
}

/* Set the frame's own properties: position, meaning of its numbers, and their location in the file. */
void fill_slice(const dicom_file &file, size_t frame, const std::vector<dicom_file::part> &parts, dicom_slice *slice)
{
    const std::string place = folder_of(slice->path) + slice->name;
    dicom_pixels &pixels = slice->pixels;
    pixels.parts = parts;
    pixels.slope = number_of(place, file, frame, SLOPE, "RescaleSlope", 1.0);
    pixels.intercept = number_of(place, file, frame, INTERCEPT, "RescaleIntercept", 0.0);
    pixels.has_rescale = !file.text_of_frame(frame, INTERCEPT).empty();
    if (pixels.slope == 0.0) fail(PLIANT_ERROR_FORMAT, "%s: RescaleSlope is 0", place.c_str());
    slice->inverted = has_inverted_values(file, frame);
    slice->position = numbers_of_frame(place, file, frame, POSITION, 3, "ImagePositionPatient");
    slice->orientation = numbers_of_frame(place, file, frame, ORIENTATION, 6, "ImageOrientationPatient");
    slice->spacing = numbers_of_frame(place, file, frame, PIXEL_SPACING, 2, "PixelSpacing");
}

/* Return whether a file cannot be a slice of a stack: a colour image, a film without positions, a segmentation. */
bool is_picture(const dicom_file &file)
{
    const std::string frames = file.text(FRAMES);
    const bool is_film = file.frames.empty() && !frames.empty() && frames != "1";
    return !unsupported_object(file.text(CLASS)).empty() || (file.has_pixels && (is_colour(file) || is_film));
}

/* Append the image of a file, or its frames, to slices. Return false if the file is no DICOM image (a report, an index,
 * a text file); then *object is its description, or empty. */
bool read_slices(const std::string &path, std::vector<dicom_slice> *slices, std::string *object)
{
    const char *const index_class = "1.2.840.10008.1.3.10"; /* DICOMDIR */
    dicom_file file;
    if (!read_dicom_file(path, &file) || file.text(MEDIA_CLASS) == index_class) return false;
    if (!file.has_pixels && !file.has(FLOAT_PIXELS) && !file.has(DOUBLE_PIXELS)) {
        *object = unsupported_object(file.text(CLASS));
        if (object->empty() && (!file.has(CLASS) || file.has(ROWS) || is_image_class(file.text(CLASS))))
            fail(PLIANT_ERROR_FORMAT, "%s: truncated DICOM file: an image without PixelData", path.c_str());
        return false;
    }
    dicom_slice slice;
    slice.path = path;
    slice.name = path.substr(folder_of(path).size());
    slice.series = file.text(SERIES);
    slice.description = file.text(SERIES_DESCRIPTION);
    slice.instance = file.text(INSTANCE);
    slice.modality = modality_of(file.text(MODALITY));
    slice.is_scout = file.text(IMAGE_TYPE).find("LOCALIZER") != std::string::npos;
    const size_t before = slices->size();
    try {
        slice.pixels = stored_pixels(path, file);
        const size_t frames = frames_of(path, file);
        auto parts = parts_of_frames(path, file, frames, slice.pixels.count() * component_size(slice.pixels.type()));
        for (size_t frame = 0; frame < frames; frame++) {
            slices->push_back(slice);
            dicom_slice &one = slices->back();
            if (frames > 1) {
                one.name += " frame " + std::to_string(frame + 1);
                one.instance += " frame " + std::to_string(frame + 1);
            }
            fill_slice(file, frame, parts[frame], &one);
        }
    } catch (const failure &failure) {
        slices->resize(before);
        slice.problem = failure.text;
        slice.is_picture = is_picture(file);
        slices->push_back(slice);
    }
    return true;
}

std::vector<std::string> files_in(const std::string &folder, bool *has_folders)
{
    std::vector<std::string> files;
    *has_folders = false;
    for (const std::string &name : names_in(folder)) {
        std::string path = folder + (ends_with(folder, "/") ? "" : "/") + name;
        if (is_folder(path)) *has_folders = true;
        else files.push_back(path);
    }
    return files;
}

using series_map = std::map<std::string, std::vector<dicom_slice>>;

series_map read_folder(const std::string &folder)
{
    bool has_folders;
    std::vector<std::string> files = files_in(folder, &has_folders);
    series_map series;
    size_t ignored = 0;
    std::string other;
    for (const std::string &path : files) {
        std::vector<dicom_slice> slices;
        std::string object;
        if (file_size(path) == 0)
            pliant_log(PLIANT_LOG_WARNING, "%s: is empty and was ignored: if it was a slice, copy it again",
                       path.c_str());
        else if (!read_slices(path, &slices, &object))
            ignored++;
        if (!object.empty()) other = "; " + path + " is " + object;
        for (dicom_slice &slice : slices) series[slice.series].push_back(std::move(slice));
    }
    if (series.empty())
        fail(PLIANT_ERROR_FORMAT, "%s: no DICOM image in this folder (%zu files, none of them one)%s%s", folder.c_str(),
             files.size(), has_folders ? "; its subfolders are not searched" : "", other.c_str());
    if (ignored)
        pliant_log(PLIANT_LOG_INFO, "%s: %zu files are not DICOM images and were ignored", folder.c_str(), ignored);
    return series;
}

std::string listed(const series_map &series)
{
    std::string text;
    for (const auto &one : series) {
        const dicom_slice &first = one.second.front();
        text += "\n  " + one.first + "  \"" + first.description + "\"  " + std::to_string(one.second.size()) +
                " images of " + std::to_string(first.pixels.columns) + " x " + std::to_string(first.pixels.rows);
    }
    return text;
}

/* Return the series that contain more than pictures and other objects. */
series_map volumes_of(const std::string &folder, const series_map &series)
{
    series_map volumes;
    for (const auto &one : series)
        if (!std::all_of(one.second.begin(), one.second.end(),
                         [](const dicom_slice &slice) { return slice.is_picture; }))
            volumes.insert(one);
    if (volumes.size() == 1 && series.size() > 1)
        pliant_log(PLIANT_LOG_WARNING, "%s: the only series that can be a volume is taken of:%s", folder.c_str(),
                   listed(series).c_str());
    return volumes;
}

/* Choose a series by its UID, or by a unique ending of its UID. */
std::vector<dicom_slice> chosen(const std::string &folder, const series_map &series, const char *wanted)
{
    if (!wanted || !*wanted) {
        const series_map volumes = volumes_of(folder, series);
        if (volumes.size() == 1) return volumes.begin()->second;
        if (series.size() > 1)
            fail(
                PLIANT_ERROR_FORMAT,
                "%s: holds %zu series; name one in the scene as scan/series (--set scan/series=UID), "
                "by its UID or the end of it:%s",
                folder.c_str(), series.size(), listed(series).c_str());
        return series.begin()->second;
    }
    auto exact = series.find(wanted);
    if (exact != series.end()) return exact->second;
    const std::vector<dicom_slice> *found = nullptr;
    size_t matches = 0;
    for (const auto &one : series)
        if (ends_with(one.first, wanted)) {
            found = &one.second;
            matches++;
        }
    if (matches != 1)
        fail(PLIANT_ERROR_FORMAT, "%s: scan/series: %s series ends with \"%.100s\"; there are:%s", folder.c_str(),
             matches ? "more than one" : "no", wanted, listed(series).c_str());
    return *found;
}

} // namespace

bool is_dicom_file(const std::string &path)
{
    std::string start = file_start(path, 132);
    return start.size() == 132 && start.compare(128, 4, "DICM") == 0;
}

std::unique_ptr<image_source> open_dicom_file(const std::string &path)
{
    std::vector<dicom_slice> slices;
    std::string object;
    if (!read_slices(path, &slices, &object))
        fail(PLIANT_ERROR_FORMAT, "%s: %s", path.c_str(), object.empty() ? "no DICOM image" : ("is " + object).c_str());
    if (!slices.front().problem.empty()) fail(PLIANT_ERROR_FORMAT, "%s", slices.front().problem.c_str());
    if (slices.size() == 1)
        fail(PLIANT_ERROR_FORMAT, "%s: one DICOM slice is a 2-D image: name the folder that holds its series",
             path.c_str());
    return open_series(path, std::move(slices));
}

std::unique_ptr<image_source> open_dicom_label_file(const std::string &path)
{
    dicom_file file;
    if (!read_dicom_file(path, &file) || !is_segmentation_object(file.text(CLASS))) return open_dicom_file(path);
    return open_dicom_segments(path, file);
}

/* Open the only segmentation in a folder. Otherwise the folder contains the slices of a label map. */
std::unique_ptr<image_source> open_dicom_label_folder(const std::string &folder)
{
    bool has_folders;
    std::string found, several;
    for (const std::string &path : files_in(folder, &has_folders)) {
        dicom_file file;
        if (file_size(path) == 0 || !read_dicom_file(path, &file) || !is_segmentation_object(file.text(CLASS)))
            continue;
        several += (several.empty() ? "" : ", ") + path;
        if (!found.empty())
            fail(PLIANT_ERROR_FORMAT, "%s: holds several DICOM segmentations (%s): name the file of one",
                 folder.c_str(), several.c_str());
        found = path;
    }
    return found.empty() ? open_dicom_folder(folder, nullptr) : open_dicom_label_file(found);
}

std::unique_ptr<image_source> open_dicom_folder(const std::string &path, const char *series)
{
    series_map all = read_folder(path);
    return open_series(path, chosen(path, all, series));
}

} // namespace pliant_read
