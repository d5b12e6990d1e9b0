/* NRRD (.nrrd, .nhdr with its data file): a text header of "field: value" lines up to an empty line
 * (http://teem.sourceforge.net/nrrd/format.html). Raw and gzip data. ITK is not used: it reads metres as millimetres
 * and leaks memory if a file is broken. */
#include "scan/read_nrrd.h"

#include <cmath>
#include <limits>

namespace pliant_read {

namespace {

component component_of(const nrrd_header &header)
{
    static const std::map<std::string, component> names = {{"signed char", component::int8},
                                                           {"int8", component::int8},
                                                           {"int8_t", component::int8},
                                                           {"uchar", component::uint8},
                                                           {"unsigned char", component::uint8},
                                                           {"uint8", component::uint8},
                                                           {"uint8_t", component::uint8},
                                                           {"short", component::int16},
                                                           {"short int", component::int16},
                                                           {"signed short", component::int16},
                                                           {"signed short int", component::int16},
                                                           {"int16", component::int16},
                                                           {"int16_t", component::int16},
                                                           {"ushort", component::uint16},
                                                           {"unsigned short", component::uint16},
                                                           {"unsigned short int", component::uint16},
                                                           {"uint16", component::uint16},
                                                           {"uint16_t", component::uint16},
                                                           {"int", component::int32},
                                                           {"signed int", component::int32},
                                                           {"int32", component::int32},
                                                           {"int32_t", component::int32},
                                                           {"uint", component::uint32},
                                                           {"unsigned int", component::uint32},
                                                           {"uint32", component::uint32},
                                                           {"uint32_t", component::uint32},
                                                           {"longlong", component::int64},
                                                           {"long long", component::int64},
                                                           {"long long int", component::int64},
                                                           {"signed long long", component::int64},
                                                           {"signed long long int", component::int64},
                                                           {"int64", component::int64},
                                                           {"int64_t", component::int64},
                                                           {"ulonglong", component::uint64},
                                                           {"unsigned long long", component::uint64},
                                                           {"unsigned long long int", component::uint64},
                                                           {"uint64", component::uint64},
                                                           {"uint64_t", component::uint64},
                                                           {"float", component::float32},
                                                           {"double", component::float64}};
    auto found = names.find(lower_case(header.text("type")));
    if (found == names.end())
        fail(PLIANT_ERROR_FORMAT, "%s: type: %.40s is not supported; short, for example, is", header.path.c_str(),
             header.text("type").c_str());
    return found->second;
}

/* Return millimetres per unit of the space. */
double unit_in_millimetres(const nrrd_header &header)
{
    std::string units = header.text("spaceunits");
    double scale = 0.0;
    for (size_t open = units.find('"'); open != std::string::npos;) {
        size_t close = units.find('"', open + 1);
        if (close == std::string::npos) break;
        std::string unit = units.substr(open + 1, close - open - 1);
        double next = unit == "m"                    ? 1e3
                      : unit == "cm"                 ? 10.0
                      : unit == "um"                 ? 1e-3
                      : unit == "mm" || unit.empty() ? 1.0
                                                     : 0.0;
        if (next == 0.0 || (scale != 0.0 && next != scale))
            fail(PLIANT_ERROR_FORMAT, "%s: space units: %.80s are not supported; \"mm\" \"mm\" \"mm\" are",
                 header.path.c_str(), units.c_str());
        scale = next;
        open = units.find('"', close + 1);
    }
    return scale == 0.0 ? 1.0 : scale;
}

/* Parse "(1,0,0)". Return false for "none". */
bool parse_vector(const nrrd_header &header, const std::string &word, double out[3])
{
    std::vector<double> numbers;
    if (lower_case(word) == "none") return false;
    if (word.size() < 2 || word[0] != '(' || word.back() != ')' ||
        !parse_numbers(word.substr(1, word.size() - 2), ',', &numbers) || numbers.size() != 3)
        fail(PLIANT_ERROR_FORMAT, "%s: %.60s is not a vector of three finite numbers", header.path.c_str(),
             word.c_str());
    std::copy(numbers.begin(), numbers.end(), out);
    return true;
}

/* Split vectors, which may contain blanks: "(1, 0, 0)". */
std::vector<std::string> vector_words(const std::string &text)
{
    std::vector<std::string> words(1);
    int depth = 0;
    for (char c : text) {
        depth += (c == '(') - (c == ')');
        if (c != ' ' && c != '\t') words.back() += c;
        else if (depth == 0 && !words.back().empty()) words.emplace_back();
    }
    if (words.back().empty()) words.pop_back();
    return words;
}

/* Compute the signs that convert the space to LPS. */
void space_signs(const nrrd_header &header, double sign[3])
{
    std::string space = lower_case(header.text("space"));
    sign[0] = sign[1] = sign[2] = 1.0;
    if (space == "right-anterior-superior" || space == "ras") sign[0] = sign[1] = -1.0;
    else if (space == "left-anterior-superior" || space == "las") sign[1] = -1.0;
    else if (space != "left-posterior-superior" && space != "lps")
        pliant_log(PLIANT_LOG_WARNING, "%s: space: \"%s\" is no patient space; left-posterior-superior is taken",
                   header.path.c_str(), space.c_str());
}

[[noreturn]] void refuse_channels(const nrrd_header &header, double count, const std::string &kind)
{
    if (kind.empty() || kind == "domain" || kind == "space" || kind == "time" || kind == "list")
        fail(PLIANT_ERROR_FORMAT,
             "%s: 4 dimensions (sizes: %.80s), one 3-D volume is needed: write one time point or channel to a separate "
             "file",
             header.path.c_str(), header.text("sizes").c_str());
    fail(PLIANT_ERROR_FORMAT, "%s: %.0f values per voxel (%.40s); one is needed", header.path.c_str(), count,
         kind.c_str());
}

/* Axis positions in a header without an orientation; empty if they are missing. */
struct scalar_axes {
    std::vector<double> spacings, mins, maxs;
    std::vector<std::string> centers;
};

scalar_axes read_scalar_axes(const nrrd_header &header, size_t n)
{
    scalar_axes axes;
    if (header.has("spacings")) axes.spacings = header.numbers("spacings", n);
    if (header.has("axismins")) axes.mins = header.numbers("axismins", n);
    if (header.has("axismaxs")) axes.maxs = header.numbers("axismaxs", n);
    axes.centers = vector_words(lower_case(header.text(header.has("centers") ? "centers" : "centerings")));
    return axes;
}

/* Set spacing, direction and the centre of the first voxel along axis d. The minimum is the edge of the first voxel, or
 * its centre if voxels are centred at nodes; cells are the default. An axis of negative spacing is reversed. */
void place_axis(const scalar_axes &axes, size_t axis, double size, double unit, size_t d, grid *grid)
{
    const bool node = axis < axes.centers.size() && axes.centers[axis] == "node";
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const double min = axes.mins.empty() ? nan : axes.mins[axis], max = axes.maxs.empty() ? nan : axes.maxs[axis];
    double spacing = axes.spacings.empty() ? nan : axes.spacings[axis];
    if (std::isnan(spacing) && std::isfinite(max - min)) spacing = (max - min) / (node ? size - 1.0 : size);
    if (axes.spacings.empty() && std::isnan(spacing)) spacing = 1.0;
    grid->spacing[d] = unit * std::fabs(spacing);
    if (spacing < 0.0) grid->direction[4 * d] = -1.0;
    if (std::isfinite(min)) grid->origin[d] = unit * (node ? min : min + 0.5 * spacing);
}

/* Return the spatial axes. Other axes must have size 1, except for the layers of a segmentation.
 * @param layers  Nullable: no segmentation. */
grid read_grid(const nrrd_header &header, nrrd_layers *layers)
{
    double dimensions = header.whole("dimension", 0);
    if (!(dimensions >= 1 && dimensions <= 16))
        fail(PLIANT_ERROR_FORMAT, "%s: dimension: %.20s: 3 is needed", header.path.c_str(),
             header.text("dimension").c_str());
    size_t n = static_cast<size_t>(dimensions);
    std::vector<double> sizes = header.numbers("sizes", n);
    std::vector<std::string> directions = vector_words(header.text("spacedirections")),
                             kinds = vector_words(lower_case(header.text("kinds")));
    if (header.has("spacedirections") && directions.size() != n)
        fail(PLIANT_ERROR_FORMAT, "%s: space directions: %.100s: %zu are needed", header.path.c_str(),
             header.text("spacedirections").c_str(), n);
    const scalar_axes scalars = read_scalar_axes(header, n);
    if (directions.empty() && scalars.spacings.empty())
        pliant_log(PLIANT_LOG_WARNING, "%s: neither spacings nor space directions: %s taken", header.path.c_str(),
                   scalars.mins.empty() || scalars.maxs.empty() ? "a spacing of 1 mm is"
                                                                : "those by axis mins and axis maxs are");

    grid grid;
    double unit = unit_in_millimetres(header), sign[3] = {1.0, 1.0, 1.0};
    if (!directions.empty()) space_signs(header, sign);
    for (size_t axis = 0; axis < n; axis++) {
        if (!(sizes[axis] == std::floor(sizes[axis]) && std::fabs(sizes[axis]) < 1e15))
            fail(PLIANT_ERROR_FORMAT, "%s: sizes: %.80s: whole numbers are needed", header.path.c_str(),
                 header.text("sizes").c_str());
        std::string kind = axis < kinds.size() ? kinds[axis] : "";
        double vector[3] = {0.0, 0.0, 0.0};
        bool in_space = directions.empty() ? kind.empty() || kind == "domain" || kind == "space"
                                           : parse_vector(header, directions[axis], vector);
        if (layers && (kind == "list" || kind == "vector")) in_space = false;
        if (!in_space && sizes[axis] == 1.0) continue;
        if (!in_space && layers && layers->count == 1 && sizes[axis] > 0.0) {
            layers->count = static_cast<size_t>(sizes[axis]);
            for (size_t before = 0; before < axis; before++)
                layers->below *= static_cast<size_t>(std::fmax(sizes[before], 0.0));
            continue;
        }
        if (!in_space) refuse_channels(header, sizes[axis], kind);
        size_t d = grid.size.size();
        grid.size.push_back(static_cast<int64_t>(sizes[axis]));
        if (d >= 3) continue;
        if (directions.empty()) {
            place_axis(scalars, axis, sizes[axis], unit, d, &grid);
            continue;
        }
        double length = std::sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
        grid.spacing[d] = unit * length;
        for (size_t row = 0; row < 3; row++)
            grid.direction[3 * row + d] = length > 0.0 ? sign[row] * vector[row] / length : 0.0;
    }
    double origin[3];
    if (header.has("spaceorigin") && parse_vector(header, vector_words(header.text("spaceorigin"))[0], origin))
        for (size_t row = 0; row < 3; row++) grid.origin[row] = unit * sign[row] * origin[row];
    return grid;
}

class nrrd_source : public image_source {
public:
    nrrd_data data;

    void read(void *voxels) override { read_voxels(*data.open(), header, data.swap, voxels); }
};

/* Return the uncompressed length of a gzip file modulo 2^32: its last four bytes (RFC 1952). */
double gzip_length(const std::string &path, double file_bytes)
{
    std::string tail(4, '\0');
    std::ifstream file = open_file(path);
    if (file_bytes < 18 || !file.seekg(-4, std::ios::end).read(&tail[0], 4)) return 0.0;
    double length = 0.0;
    for (size_t n = 4; n-- > 0;) length = 256.0 * length + static_cast<unsigned char>(tail[n]);
    return length;
}

uint64_t after_lines(const std::string &path, uint64_t offset, double lines)
{
    std::ifstream file = open_file(path);
    file.seekg(static_cast<std::streamoff>(offset));
    for (; lines > 0 && file; lines--) file.ignore(std::numeric_limits<std::streamsize>::max(), '\n');
    if (!file.good()) fail(PLIANT_ERROR_FORMAT, "%s: truncated: fewer lines than line skip says", path.c_str());
    return static_cast<uint64_t>(file.tellg());
}

/* Locate the voxels. */
void locate_data(const nrrd_header &header, double data_bytes, nrrd_data *data)
{
    const char *path = header.path.c_str();
    std::string name = header.text("datafile"), encoding = lower_case(header.text("encoding"));
    data->compressed = encoding == "gzip" || encoding == "gz";
    if (encoding != "raw" && !data->compressed)
        fail(PLIANT_ERROR_FORMAT,
             "%s: encoding: %.40s is not supported; raw and gzip are: write the file again, for example with unu save "
             "-e gzip",
             path, encoding.c_str());
    if (name.compare(0, 4, "LIST") == 0 || name.find('%') != std::string::npos)
        fail(PLIANT_ERROR_FORMAT,
             "%s: data file: %.80s: a list of files is not supported: write header and voxels into one .nrrd file "
             "(SimpleITK and unu save do)",
             path, name.c_str());
    bool alone = !name.empty();
    data->path = !alone ? header.path : name[0] == '/' ? name : folder_of(header.path) + name;
    if (is_folder(data->path)) fail(PLIANT_ERROR_FILE, "%s: is a folder, a data file is needed", data->path.c_str());

    double bytes = static_cast<double>(file_size(data->path)), lines = header.whole("lineskip", 0),
           skip = header.whole("byteskip", 0);
    data->offset = after_lines(data->path, alone ? 0 : header.bytes, lines);
    double behind = bytes - static_cast<double>(data->offset);
    double inside = data->compressed ? gzip_length(data->path, bytes) : behind;
    if (skip < -1 || lines < 0)
        fail(PLIANT_ERROR_FORMAT, "%s: byte skip %g, line skip %g: at least -1 and 0 are needed", path, skip, lines);
    check_data_fits(data->path, data_bytes + std::fmax(skip, 0.0), behind, data->compressed);
    if (skip == -1) skip = inside - data_bytes;
    if (skip < 0)
        fail(PLIANT_ERROR_FORMAT, "%s: truncated: %.0f bytes of data in %s, the header asks for %.0f", path, inside,
             data->path.c_str(), data_bytes);
    data->skip = static_cast<uint64_t>(skip);
    /* If a data file is longer than the voxels, it has additional data before them that the header does not mention. */
    if (alone && !header.has("byteskip") && lines == 0 &&
        inside != std::fmod(data_bytes, data->compressed ? 4294967296.0 : HUGE_VAL))
        fail(PLIANT_ERROR_FORMAT,
             "%s: %.0f bytes of data in %s, but the header asks for %.0f: truncated, or a byte skip is missing", path,
             inside, name.c_str(), data_bytes);
}

} // namespace

std::unique_ptr<image_source> open_nrrd(const std::string &path)
{
    nrrd_header header = read_nrrd_header(path);
    nrrd_layers layers;
    nrrd_data data;
    const bool segments = has_segments(header);
    const component type = component_of(header);
    const pliant_geometry geometry = checked_geometry(path, read_grid(header, segments ? &layers : nullptr));
    const size_t size = component_size(type);
    std::string endian = lower_case(header.text("endian"));
    if (size > 1 && endian != "little" && endian != "big")
        fail(PLIANT_ERROR_FORMAT, "%s: endian: %.20s: little or big is needed", path.c_str(), endian.c_str());
    data.swap = (endian == "big") != machine_is_big_endian();
    locate_data(header, voxel_count(geometry) * static_cast<double>(size) * static_cast<double>(layers.count), &data);
    if (segments) return open_nrrd_segments(header, data, type, geometry, layers);

    std::unique_ptr<nrrd_source> source(new nrrd_source);
    source->data = data;
    source->header.geometry = geometry;
    source->header.type = type;
    source->header.whole_numbers = component_is_integer(type);
    source->header.modality =
        modality_of(header.pair(header.pair("modality").empty() ? "dicom_0008_0060" : "modality"));
    return std::unique_ptr<image_source>(source.release());
}

} // namespace pliant_read
