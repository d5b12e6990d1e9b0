/* NRRD (.nrrd, .nhdr with its data file) by ITK. */
#include "scan/itk_scope.h"
#include "scan/read.h"

#include <itkNrrdImageIO.h>

#include <algorithm>
#include <cmath>

namespace pliant_read {

namespace {

/* By size and sign, as long and long long are named apart but may be the same. */
component component_of(const std::string &path, const itk::ImageIOBase &io)
{
    std::string name = io.GetComponentTypeAsString(io.GetComponentType());
    bool is_unsigned = name.compare(0, 8, "unsigned") == 0;
    size_t size = io.GetComponentSize();
    if (name == "float") return component::float32;
    if (name == "double") return component::float64;
    if (size == 1) return is_unsigned ? component::uint8 : component::int8;
    if (size == 2) return is_unsigned ? component::uint16 : component::int16;
    if (size == 4) return is_unsigned ? component::uint32 : component::int32;
    if (size == 8) return is_unsigned ? component::uint64 : component::int64;
    fail(PLIANT_ERROR_FORMAT, "%s: voxel type %s is not supported", path.c_str(), name.c_str());
}

/* The text header, for what ITK does not tell: lines up to the first empty one. */
std::string text_header(const std::string &path)
{
    const size_t longest = 1 << 16;
    std::string header = file_start(path, longest);
    size_t end = std::min(header.find("\n\n"), header.find("\n\r\n"));
    if (end != std::string::npos) header.resize(end);
    return header;
}

/* The value of a field; "" when it is missing. */
std::string field(const std::string &header, const std::string &name)
{
    size_t start = header.find("\n" + name + ":");
    if (start == std::string::npos) return "";
    start += name.size() + 2;
    size_t end = header.find('\n', start);
    return trimmed(header.substr(start, end == std::string::npos ? end : end - start));
}

/* ITK takes every length for millimetres. Returns millimetres per unit. */
double unit_in_millimetres(const std::string &path, const std::string &header)
{
    if (field(header, "spacings").empty() && field(header, "space directions").empty())
        pliant_log(PLIANT_LOG_WARNING, "%s: neither spacings nor space directions: a spacing of 1 mm is taken", path.c_str());
    std::string units = field(header, "space units");
    double scale = 0.0;
    for (size_t open = units.find('"'); open != std::string::npos;) {
        size_t close = units.find('"', open + 1);
        if (close == std::string::npos) break;
        std::string unit = units.substr(open + 1, close - open - 1);
        double next = unit == "m" ? 1e3 : unit == "cm" ? 10.0 : unit == "um" ? 1e-3 : unit == "mm" || unit.empty() ? 1.0 : 0.0;
        if (next == 0.0 || (scale != 0.0 && next != scale))
            fail(PLIANT_ERROR_FORMAT, "%s: space units %s are not supported; \"mm\" \"mm\" \"mm\" are", path.c_str(), units.c_str());
        scale = next;
        open = units.find('"', close + 1);
    }
    return scale == 0.0 ? 1.0 : scale;
}

/* Before memory is asked for: the voxels can be in the file. And a data file of its own that is longer than they
 * are has something in front of them that the header forgot. */
void check_data_file(const std::string &path, const std::string &header, const image_header &image)
{
    std::string name = field(header, "data file"), encoding = lower_case(field(header, "encoding"));
    if (name.empty()) name = field(header, "datafile");
    if (name.find_first_of(" %") != std::string::npos || name == "LIST") return; /* several files: teem checks them */
    bool raw = encoding == "raw", zipped = encoding == "gzip" || encoding == "gz", alone = !name.empty();
    std::string data_path = !alone ? path : name[0] == '/' ? name : folder_of(path) + name;
    double bytes = static_cast<double>(file_size(data_path)), voxels = voxel_count(image.geometry);
    double data_bytes = voxels * static_cast<double>(component_size(image.type));
    check_data_fits(data_path, raw || zipped ? data_bytes : voxels, bytes, !raw); /* text: a digit for each, at the least */

    for (const char *skip : {"byte skip", "byteskip", "line skip", "lineskip"})
        if (!field(header, skip).empty()) return;
    if (!alone || !(raw || zipped)) return;
    if (zipped) {
        const double wrap = 4294967296.0; /* gzip tells the length of what went in modulo 2^32 (RFC 1952) */
        unsigned char tail[4] = {0, 0, 0, 0};
        std::ifstream file(data_path, std::ios::binary);
        file.seekg(-4, std::ios::end).read(reinterpret_cast<char *>(tail), 4);
        bytes = tail[0] + 256.0 * tail[1] + 65536.0 * tail[2] + 16777216.0 * tail[3];
        data_bytes = std::fmod(data_bytes, wrap);
    }
    if (bytes != data_bytes)
        fail(PLIANT_ERROR_FORMAT, "%s: %.0f bytes of data in %s, but the header asks for %.0f: truncated, or a byte skip is missing", path.c_str(),
             bytes, name.c_str(), data_bytes);
}

/* teem tells a list of what failed inside what; the last entry is the reason. */
std::string reason(const itk::ExceptionObject &error)
{
    std::string text = itk_reason(error);
    size_t last = text.rfind("[nrrd] ");
    if (last != std::string::npos) text.erase(0, last + 7);
    size_t name = text[0] == '_' ? text.find(": ") : std::string::npos;
    return name == std::string::npos ? text : text.substr(name + 2);
}

class nrrd_source : public image_source {
public:
    nrrd_source(std::string path, itk::NrrdImageIO::Pointer io) : path_(std::move(path)), io_(io) {}
    void read(void *voxels) override
    {
        itk_scope quiet;
        unsigned int dimensions = io_->GetNumberOfDimensions();
        itk::ImageIORegion region(dimensions);
        for (unsigned int d = 0; d < dimensions; d++) region.SetSize(d, io_->GetDimensions(d));
        io_->SetIORegion(region);
        try {
            io_->Read(voxels);
        } catch (const itk::ExceptionObject &error) {
            fail(PLIANT_ERROR_FORMAT, "%s: the voxels cannot be read (truncated or damaged?): %.600s", path_.c_str(), reason(error).c_str());
        }
    }

private:
    std::string path_;
    itk::NrrdImageIO::Pointer io_;
};

} // namespace

std::unique_ptr<image_source> open_nrrd(const std::string &path)
{
    std::string text = text_header(path);
    double unit = unit_in_millimetres(path, text);
    itk_scope quiet;
    itk::NrrdImageIO::Pointer io = itk::NrrdImageIO::New();
    io->SetFileName(path);
    try {
        io->ReadImageInformation();
    } catch (const itk::ExceptionObject &error) {
        fail(PLIANT_ERROR_FORMAT, "%s: not a NRRD file that can be read as one 3-D volume: %.600s", path.c_str(), reason(error).c_str());
    }
    if (io->GetNumberOfComponents() != 1)
        fail(PLIANT_ERROR_FORMAT, "%s: %u values per voxel (colour, vector or complex); one is needed", path.c_str(), io->GetNumberOfComponents());

    grid grid;
    unsigned int dimensions = io->GetNumberOfDimensions();
    for (unsigned int axis = 0; axis < dimensions; axis++) {
        grid.size.push_back(static_cast<int64_t>(io->GetDimensions(axis)));
        if (axis >= 3) continue;
        grid.spacing[axis] = unit * io->GetSpacing(axis);
        grid.origin[axis] = unit * io->GetOrigin(axis);
        for (unsigned int row = 0; row < 3 && row < dimensions; row++) grid.direction[3 * row + axis] = io->GetDirection(axis)[row];
    }
    std::unique_ptr<nrrd_source> source(new nrrd_source(path, io));
    source->header.geometry = checked_geometry(path, grid);
    source->header.type = component_of(path, *io);
    source->header.whole_numbers = component_is_integer(source->header.type);
    check_data_file(path, text, source->header);
    source->header.decoder_bytes = static_cast<double>(component_size(source->header.type));
    return std::unique_ptr<image_source>(source.release());
}

} // namespace pliant_read
