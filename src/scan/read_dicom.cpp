/* A DICOM folder: which files are images, to which series they belong, which series is meant. */
#include "scan/read_dicom.h"

#include "scan/itk_scope.h"

#include <gdcmAttribute.h>
#include <gdcmReader.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <dirent.h>
#include <map>

namespace pliant_read {

namespace {

/* A file that notices when somebody wants more bytes than are left; 4 is the next tag at the regular end. */
class watched_file : public std::filebuf {
public:
    bool ended_early = false;

protected:
    std::streamsize xsgetn(char *to, std::streamsize wanted) override
    {
        std::streamsize got = std::filebuf::xsgetn(to, wanted);
        if (got < wanted && wanted > 4) ended_early = true;
        return got;
    }
};

std::string text_of(const gdcm::DataSet &data, uint16_t group, uint16_t element)
{
    gdcm::Tag tag(group, element);
    if (!data.FindDataElement(tag)) return "";
    const gdcm::ByteValue *value = data.GetDataElement(tag).GetByteValue();
    return value ? trimmed(std::string(value->GetPointer(), value->GetLength())) : "";
}

std::vector<double> numbers_of(const std::string &path, const gdcm::DataSet &data, uint16_t group, uint16_t element, size_t count,
                               const char *name)
{
    std::string text = text_of(data, group, element);
    std::vector<double> numbers;
    if (text.empty()) return numbers;
    if (!parse_numbers(text, '\\', &numbers) || numbers.size() != count)
        fail(PLIANT_ERROR_FORMAT, "%s: %s is \"%.80s\", %zu numbers are needed", path.c_str(), name, text.c_str(), count);
    return numbers;
}

template <uint16_t Group, uint16_t Element> int integer_of(const gdcm::DataSet &data, int otherwise)
{
    if (!data.FindDataElement(gdcm::Tag(Group, Element)) || data.GetDataElement(gdcm::Tag(Group, Element)).IsEmpty()) return otherwise;
    gdcm::Attribute<Group, Element> attribute = {};
    attribute.SetFromDataSet(data);
    return static_cast<int>(attribute.GetValue());
}

bool is_whole(const std::string &number)
{
    std::vector<double> values;
    return number.empty() || (parse_numbers(number, '\\', &values) && values.size() == 1 && values[0] == std::floor(values[0]));
}

/* Colour, inverted and otherwise unusable images. */
void check_pixels(const std::string &path, const gdcm::DataSet &data, const dicom_slice &slice, bool compressed)
{
    std::string colours = text_of(data, 0x0028, 0x0004);
    int samples = integer_of<0x0028, 0x0002>(data, 1), bits = integer_of<0x0028, 0x0100>(data, 16);
    if (samples != 1 || (!colours.empty() && colours.compare(0, 10, "MONOCHROME") != 0))
        fail(PLIANT_ERROR_FORMAT, "%s: a colour image (%s); one value per voxel is needed", path.c_str(), colours.c_str());
    if (colours == "MONOCHROME1")
        fail(PLIANT_ERROR_FORMAT, "%s: MONOCHROME1 (large values are dark) is not supported; MONOCHROME2 is", path.c_str());
    if (slice.frames > 1) return; /* refused later, with a message of its own */

    const gdcm::DataElement &pixels = data.GetDataElement(gdcm::Tag(0x7fe0, 0x0010));
    const gdcm::ByteValue *value = pixels.GetByteValue();
    double needed = std::ceil(static_cast<double>(slice.rows) * slice.columns * bits / 8.0);
    if (!compressed && (!value || static_cast<double>(value->GetLength()) < needed))
        fail(PLIANT_ERROR_FORMAT, "%s: truncated: %d x %d pixels of %d bits need %.0f bytes, PixelData has %.0f", path.c_str(), slice.columns,
             slice.rows, bits, needed, value ? static_cast<double>(value->GetLength()) : 0.0);
}

bool has_magic(const std::string &path)
{
    std::string start = file_start(path, 132);
    return start.size() == 132 && start.compare(128, 4, "DICM") == 0;
}

/* Without the 128 bytes in front: old files that begin with group 2 or 8. */
bool may_lack_magic(const std::string &path)
{
    std::string start = file_start(path, 4);
    return start.size() == 4 && (start[0] == 2 || start[0] == 8) && start[1] == 0 && start[3] == 0;
}

/* False when the file is no DICOM image (a report, an index, a text file). */
bool read_slice(const std::string &path, dicom_slice *slice)
{
    bool magic = has_magic(path);
    if (!magic && !may_lack_magic(path)) return false;
    watched_file file;
    if (!file.open(path, std::ios::in | std::ios::binary)) fail(PLIANT_ERROR_FILE, "%s: cannot be opened: %s", path.c_str(), strerror(errno));
    std::istream stream(&file);
    gdcm::Reader reader;
    reader.SetStream(stream);
    bool read = reader.ReadUpToTag(gdcm::Tag(0x7fe0, 0x0010));
    if (!read && !magic) return false;
    if (file.ended_early) fail(PLIANT_ERROR_FORMAT, "%s: truncated DICOM file", path.c_str());
    if (!read) fail(PLIANT_ERROR_FORMAT, "%s: damaged DICOM file", path.c_str());

    const gdcm::DataSet &data = reader.GetFile().GetDataSet();
    if (!data.FindDataElement(gdcm::Tag(0x7fe0, 0x0010))) return false;
    slice->path = path;
    slice->name = path.substr(folder_of(path).size());
    slice->series = text_of(data, 0x0020, 0x000e);
    slice->description = text_of(data, 0x0008, 0x103e);
    slice->instance = text_of(data, 0x0008, 0x0018);
    slice->rows = integer_of<0x0028, 0x0010>(data, 0);
    slice->columns = integer_of<0x0028, 0x0011>(data, 0);
    slice->frames = integer_of<0x0028, 0x0008>(data, 1);
    std::string slope = text_of(data, 0x0028, 0x1053), intercept = text_of(data, 0x0028, 0x1052);
    slice->integer_rescale = is_whole(slope) && is_whole(intercept);
    slice->storage = slope + " " + intercept + " " + std::to_string(integer_of<0x0028, 0x0100>(data, 0)) + " " +
                     std::to_string(integer_of<0x0028, 0x0101>(data, 0)) + " " + std::to_string(integer_of<0x0028, 0x0103>(data, 0));
    bool compressed = data.GetDataElement(gdcm::Tag(0x7fe0, 0x0010)).GetSequenceOfFragments() != nullptr;
    try {
        slice->position = numbers_of(path, data, 0x0020, 0x0032, 3, "ImagePositionPatient");
        slice->orientation = numbers_of(path, data, 0x0020, 0x0037, 6, "ImageOrientationPatient");
        slice->spacing = numbers_of(path, data, 0x0028, 0x0030, 2, "PixelSpacing");
        check_pixels(path, data, *slice, compressed);
    } catch (const failure &failure) {
        slice->problem = failure.text;
    }
    return true;
}

std::vector<std::string> files_in(const std::string &folder, bool *has_folders)
{
    DIR *directory = opendir(folder.c_str());
    if (!directory) fail(PLIANT_ERROR_FILE, "%s: the folder cannot be read: %s", folder.c_str(), strerror(errno));
    std::vector<std::string> files;
    *has_folders = false;
    while (const dirent *entry = readdir(directory)) {
        if (entry->d_name[0] == '.') continue;
        std::string path = folder + (ends_with(folder, "/") ? "" : "/") + entry->d_name;
        if (is_folder(path)) *has_folders = true;
        else files.push_back(path);
    }
    closedir(directory);
    std::sort(files.begin(), files.end()); /* the order of a folder differs between machines */
    return files;
}

using series_map = std::map<std::string, std::vector<dicom_slice>>;

series_map read_folder(const std::string &folder)
{
    bool has_folders;
    std::vector<std::string> files = files_in(folder, &has_folders);
    series_map series;
    size_t ignored = 0;
    for (const std::string &path : files) {
        dicom_slice slice;
        if (file_size(path) == 0) fail(PLIANT_ERROR_FORMAT, "%s: is empty", path.c_str());
        if (read_slice(path, &slice)) series[slice.series].push_back(slice);
        else ignored++;
    }
    if (series.empty())
        fail(PLIANT_ERROR_FORMAT, "%s: no DICOM image in this folder (%zu files, none of them one)%s", folder.c_str(), files.size(),
             has_folders ? "; its subfolders are not searched" : "");
    if (ignored) pliant_log(PLIANT_LOG_INFO, "%s: %zu files are no DICOM images and were left out", folder.c_str(), ignored);
    return series;
}

std::string listed(const series_map &series)
{
    std::string text;
    for (const auto &one : series) {
        const dicom_slice &first = one.second.front();
        text += "\n  " + one.first + "  \"" + first.description + "\"  " + std::to_string(one.second.size()) + " images of " +
                std::to_string(first.columns) + " x " + std::to_string(first.rows);
    }
    return text;
}

/* By its UID or an ending of it that no other series has. */
const std::vector<dicom_slice> &chosen(const std::string &folder, const series_map &series, const char *wanted)
{
    if (!wanted || !*wanted) {
        if (series.size() > 1)
            fail(PLIANT_ERROR_FORMAT, "%s: holds %zu series; name one by its UID or the end of it:%s", folder.c_str(), series.size(),
                 listed(series).c_str());
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
        fail(PLIANT_ERROR_FORMAT, "%s: %s series ends with \"%.100s\"; there are:%s", folder.c_str(), matches ? "more than one" : "no", wanted,
             listed(series).c_str());
    return *found;
}

} // namespace

bool is_dicom_file(const std::string &path) { return has_magic(path); }

void refuse_dicom_file(const std::string &path)
{
    dicom_slice slice;
    bool image;
    {
        itk_scope quiet;
        image = read_slice(path, &slice);
    }
    if (!image) fail(PLIANT_ERROR_FORMAT, "%s: no DICOM image", path.c_str());
    if (!slice.problem.empty()) fail(PLIANT_ERROR_FORMAT, "%s", slice.problem.c_str());
    if (slice.frames > 1)
        fail(PLIANT_ERROR_FORMAT, "%s: %d frames in one DICOM file are not supported: export it as a series of single images, or as NIfTI",
             path.c_str(), slice.frames);
    fail(PLIANT_ERROR_FORMAT, "%s: one DICOM slice is a 2-D image: name the folder that holds its series", path.c_str());
}

std::unique_ptr<image_source> open_dicom_folder(const std::string &path, const char *series)
{
    series_map all;
    {
        itk_scope quiet;
        all = read_folder(path);
    }
    return open_series(path, chosen(path, all, series));
}

} // namespace pliant_read
