/* MetaImage (.mha, .mhd with its data file): a text header of "Key = value" lines. ITK's reader is not used, since it
 * accepts truncated and damaged data. */
#include "scan/read.h"

#include <cmath>
#include <map>

namespace pliant_read {

namespace {

struct text_header {
    std::string path;
    std::map<std::string, std::string> values; /* by key in lower case */
    uint64_t bytes = 0;                        /* where local data begin */

    /* Return the value of the first existing key; "" if there is no such key. */
    std::string text(std::initializer_list<const char *> keys) const
    {
        for (const char *key : keys) {
            auto found = values.find(lower_case(key));
            if (found != values.end()) return found->second;
        }
        return "";
    }
    bool flag(std::initializer_list<const char *> keys, bool otherwise) const
    {
        std::string value = lower_case(text(keys));
        return value.empty() ? otherwise : value[0] == 't' || value[0] == '1';
    }
    /* Read `count` numbers. Return false if the key is missing. */
    bool numbers(std::initializer_list<const char *> keys, size_t count, std::vector<double> *out) const
    {
        std::string value = text(keys);
        if (value.empty()) return false;
        std::vector<double> found;
        if (!parse_numbers(value, ' ', &found) || found.size() != count)
            fail(PLIANT_ERROR_FORMAT, "%s: %s = %.80s: %zu finite numbers are needed", path.c_str(), *keys.begin(),
                 value.c_str(), count);
        *out = found;
        return true;
    }
    double number(std::initializer_list<const char *> keys, double otherwise) const
    {
        std::vector<double> found;
        return numbers(keys, 1, &found) ? found[0] : otherwise;
    }
};

/* Read up to and including the line ElementDataFile, which ends the header. */
text_header read_header(const std::string &path)
{
    const size_t longest = 1 << 20;
    text_header header;
    header.path = path;
    std::string bytes = file_start(path, longest);
    for (size_t at = mark_of(bytes); at < bytes.size();) {
        size_t end = bytes.find('\n', at);
        if (end == std::string::npos) end = bytes.size();
        std::string line = bytes.substr(at, end - at);
        at = end + 1;
        size_t equals = line.find('=');
        if (equals == std::string::npos) continue;
        std::string key = lower_case(trimmed(line.substr(0, equals)));
        header.values[key] = trimmed(line.substr(equals + 1));
        if (key == "elementdatafile") {
            header.bytes = at;
            return header;
        }
    }
    fail(PLIANT_ERROR_FORMAT, "%s: not a MetaImage file, or its header is truncated (no line ElementDataFile)",
         path.c_str());
}

component component_of(const text_header &header)
{
    static const std::map<std::string, component> names = {
        {"MET_CHAR", component::int8},       {"MET_ASCII_CHAR", component::int8},    {"MET_UCHAR", component::uint8},
        {"MET_SHORT", component::int16},     {"MET_USHORT", component::uint16},      {"MET_INT", component::int32},
        {"MET_UINT", component::uint32},     {"MET_LONG", component::int32},         {"MET_ULONG", component::uint32},
        {"MET_LONG_LONG", component::int64}, {"MET_ULONG_LONG", component::uint64},  {"MET_FLOAT", component::float32},
        {"MET_DOUBLE", component::float64}};
    std::string name = header.text({"ElementType"});
    if (header.number({"ElementNumberOfChannels"}, 1) != 1 || ends_with(name, "_ARRAY"))
        fail(PLIANT_ERROR_FORMAT, "%s: a colour or vector image; one value per voxel is needed", header.path.c_str());
    auto found = names.find(name);
    if (found == names.end())
        fail(PLIANT_ERROR_FORMAT, "%s: ElementType = %.40s is not supported; MET_SHORT, for example, is",
             header.path.c_str(), name.c_str());
    return found->second;
}

grid read_grid(const text_header &header)
{
    grid grid;
    double dimensions = header.number({"NDims"}, 0);
    if (!(dimensions >= 1 && dimensions <= 10 && dimensions == std::floor(dimensions)))
        fail(PLIANT_ERROR_FORMAT, "%s: NDims = %.20s: 3 is needed", header.path.c_str(),
             header.text({"NDims"}).c_str());
    size_t n = static_cast<size_t>(dimensions);
    std::vector<double> values;
    if (!header.numbers({"DimSize"}, n, &values)) fail(PLIANT_ERROR_FORMAT, "%s: no line DimSize", header.path.c_str());
    for (double value : values) {
        if (value != std::floor(value) || std::fabs(value) > 1e15)
            fail(PLIANT_ERROR_FORMAT, "%s: DimSize = %.80s: whole numbers are needed", header.path.c_str(),
                 header.text({"DimSize"}).c_str());
        grid.size.push_back(static_cast<int64_t>(value));
    }
    std::string unit_name = lower_case(header.text({"DistanceUnits"}));
    double unit = unit_name == "um" ? 1e-3 : unit_name == "cm" ? 10.0 : unit_name == "m" ? 1e3 : 1.0;
    if (header.numbers({"ElementSpacing", "ElementSize"}, n, &values))
        for (size_t d = 0; d < 3 && d < n; d++) grid.spacing[d] = unit * values[d];
    else pliant_log(PLIANT_LOG_WARNING, "%s: no line ElementSpacing: a spacing of 1 mm is taken", header.path.c_str());
    if (header.numbers({"Offset", "Position", "Origin"}, n, &values))
        for (size_t d = 0; d < 3 && d < n; d++) grid.origin[d] = unit * values[d];
    /* Row r of the matrix in the file is the direction of axis r. */
    if (header.numbers({"TransformMatrix", "Rotation", "Orientation"}, n * n, &values))
        for (size_t axis = 0; axis < 3 && axis < n; axis++)
            for (size_t row = 0; row < 3 && row < n; row++) grid.direction[3 * row + axis] = values[n * axis + row];
    return grid;
}

class metaimage_source : public image_source {
public:
    std::string data_path;
    uint64_t offset = 0;
    bool compressed = false, swap = false;

    void read(void *voxels) override
    {
        byte_stream stream(data_path, offset, compressed ? byte_stream::packing::deflate : byte_stream::packing::none);
        read_voxels(stream, header, swap, voxels);
    }
};

/* Locate the data: after the header, or in another file. */
void locate_data(const text_header &header, double data_bytes, metaimage_source *source)
{
    std::string name = header.text({"ElementDataFile"});
    bool local = lower_case(name) == "local";
    if (name.compare(0, 4, "LIST") == 0 || name.find('%') != std::string::npos || name.empty())
        fail(PLIANT_ERROR_FORMAT,
             "%s: ElementDataFile = %.80s: a list of files is not supported: write header and voxels into one .mha "
             "file (LOCAL), as SimpleITK does",
             header.path.c_str(), name.c_str());
    source->data_path = local ? header.path : name[0] == '/' ? name : folder_of(header.path) + name;
    if (!local && is_folder(source->data_path))
        fail(PLIANT_ERROR_FILE, "%s: is a folder, a data file is needed", source->data_path.c_str());

    double in_file = static_cast<double>(file_size(source->data_path)), skip = header.number({"HeaderSize"}, 0);
    if (skip == -1 && !source->compressed) source->offset = static_cast<uint64_t>(std::fmax(in_file - data_bytes, 0.0));
    else if (skip > 0 && skip < in_file) source->offset = static_cast<uint64_t>(skip);
    else if (skip == 0) source->offset = local ? header.bytes : 0;
    else
        fail(PLIANT_ERROR_FORMAT, "%s: HeaderSize = %.40s does not fit a data file of %.0f bytes", header.path.c_str(),
             header.text({"HeaderSize"}).c_str(), in_file);

    double behind = in_file - static_cast<double>(source->offset);
    if (source->compressed && header.number({"CompressedDataSize"}, 0) > behind)
        fail(PLIANT_ERROR_FORMAT, "%s: truncated: CompressedDataSize = %.0f, the file has %.0f bytes of data",
             source->data_path.c_str(), header.number({"CompressedDataSize"}, 0), behind);
    check_data_fits(source->data_path, data_bytes, behind, source->compressed);
}

} // namespace

std::unique_ptr<image_source> open_metaimage(const std::string &path)
{
    text_header header = read_header(path);
    std::unique_ptr<metaimage_source> source(new metaimage_source);
    if (!header.text({"ObjectType"}).empty() && lower_case(header.text({"ObjectType"})) != "image")
        fail(PLIANT_ERROR_FORMAT, "%s: ObjectType = %.40s: Image is needed", path.c_str(),
             header.text({"ObjectType"}).c_str());
    if (!header.flag({"BinaryData"}, true))
        fail(PLIANT_ERROR_FORMAT,
             "%s: BinaryData = False: numbers as text are not supported: write it as binary .mha or NIfTI",
             path.c_str());
    source->header.type = component_of(header);
    source->header.whole_numbers = component_is_integer(source->header.type);
    source->header.geometry = checked_geometry(path, read_grid(header));
    source->header.modality = modality_of(header.text({"Modality"}));
    source->header.slope = header.number({"ElementToIntensityFunctionSlope"}, 1.0);
    source->header.intercept = header.number({"ElementToIntensityFunctionOffset"}, 0.0);
    if (!std::isfinite(source->header.slope) || !std::isfinite(source->header.intercept) || source->header.slope == 0.0)
        fail(PLIANT_ERROR_FORMAT, "%s: ElementToIntensityFunction: slope %g, offset %g", path.c_str(),
             source->header.slope, source->header.intercept);
    source->compressed = header.flag({"CompressedData"}, false);
    source->swap = header.flag({"BinaryDataByteOrderMSB", "ElementByteOrderMSB"}, false) != machine_is_big_endian();
    locate_data(header, voxel_count(source->header.geometry) * static_cast<double>(component_size(source->header.type)),
                source.get());
    return std::unique_ptr<image_source>(source.release());
}

} // namespace pliant_read
