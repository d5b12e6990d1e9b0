/* NRRD (.nrrd, .nhdr with its data file) by ITK. */
#include "scan/itk_scope.h"
#include "scan/read.h"

#include <itkNrrdImageIO.h>

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

/* What ITK does not tell, from the text header: the unit of length, and whether a spacing is given at all.
 * Returns millimetres per unit. */
double unit_in_millimetres(const std::string &path)
{
    const size_t longest = 1 << 16;
    std::string header = file_start(path, longest);
    size_t end = std::min(header.find("\n\n"), header.find("\n\r\n"));
    if (end != std::string::npos) header.resize(end);
    if (header.find("\nspacings:") == std::string::npos && header.find("\nspace directions:") == std::string::npos)
        pliant_log(PLIANT_LOG_WARNING, "%s: neither spacings nor space directions: a spacing of 1 mm is taken", path.c_str());

    size_t units = header.find("\nspace units:");
    if (units == std::string::npos) return 1.0;
    std::string line = header.substr(units + 13, header.find('\n', units + 1) - units - 13);
    double scale = 0.0;
    for (size_t open = line.find('"'); open != std::string::npos;) {
        size_t close = line.find('"', open + 1);
        if (close == std::string::npos) break;
        std::string unit = line.substr(open + 1, close - open - 1);
        double next = unit == "m" ? 1e3 : unit == "cm" ? 10.0 : unit == "um" ? 1e-3 : unit == "mm" || unit.empty() ? 1.0 : 0.0;
        if (next == 0.0 || (scale != 0.0 && next != scale))
            fail(PLIANT_ERROR_FORMAT, "%s: space units%s are not supported; \"mm\" \"mm\" \"mm\" are", path.c_str(), line.c_str());
        scale = next;
        open = line.find('"', close + 1);
    }
    return scale == 0.0 ? 1.0 : scale;
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
            fail(PLIANT_ERROR_FORMAT, "%s: the voxels cannot be read (truncated or damaged?): %.600s", path_.c_str(), itk_reason(error).c_str());
        }
    }

private:
    std::string path_;
    itk::NrrdImageIO::Pointer io_;
};

} // namespace

std::unique_ptr<image_source> open_nrrd(const std::string &path)
{
    double unit = unit_in_millimetres(path);
    itk_scope quiet;
    itk::NrrdImageIO::Pointer io = itk::NrrdImageIO::New();
    io->SetFileName(path);
    try {
        io->ReadImageInformation();
    } catch (const itk::ExceptionObject &error) {
        fail(PLIANT_ERROR_FORMAT, "%s: not a NRRD file that can be read as one 3-D volume: %.600s", path.c_str(), itk_reason(error).c_str());
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
    source->header.decoder_bytes = static_cast<double>(component_size(source->header.type));
    return std::unique_ptr<image_source>(source.release());
}

} // namespace pliant_read
