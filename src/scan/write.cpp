/* Writing volumes and label maps by ITK: into a file beside the target, checked, then renamed. */
#include "pliant/scan.h"

#include "core/fail.h"
#include "pliant/memory.h"
#include "scan/itk_scope.h"

#include <itkMetaImageIO.h>
#include <itkNiftiImageIO.h>
#include <itkNrrdImageIO.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fcntl.h>
#include <fstream>
#include <new>
#include <sys/stat.h>
#include <unistd.h>

namespace {

/* Thrown inside, told by pliant_fail at the boundary. */
struct failure {
    pliant_status status;
    std::string text;
};

[[noreturn]] void fail(pliant_status status, const std::string &text) { throw failure{status, text}; }

const char *const ENDINGS[] = {".nii.gz", ".nii", ".nrrd", ".mha"};

/* The known ending of a path, as it is written there. */
std::string ending_of(const std::string &path)
{
    std::string lower = path;
    std::transform(lower.begin(), lower.end(), lower.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    for (const char *ending : ENDINGS) {
        size_t length = std::strlen(ending);
        if (lower.size() > length && lower.compare(lower.size() - length, length, ending) == 0) return ending;
    }
    fail(PLIANT_ERROR_ARGUMENT, path + ": its ending tells no format; .nii, .nii.gz, .nrrd and .mha are known");
}

/* An empty file beside the target that nobody else uses; removed unless renamed. */
class temporary_file {
public:
    temporary_file(const std::string &target, const std::string &ending) : target_(target)
    {
        static std::atomic<unsigned> counter{0};
        size_t slash = target.rfind('/');
        std::string folder = slash == std::string::npos ? "" : target.substr(0, slash + 1);
        for (int attempt = 0; attempt < 100; attempt++) {
            path_ = folder + ".pliant-" + std::to_string(getpid()) + "-" + std::to_string(counter++) + ending;
            int file = open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
            if (file >= 0) {
                close(file);
                return;
            }
            if (errno != EEXIST) break;
        }
        int reason = errno;
        path_.clear();
        fail(PLIANT_ERROR_FILE, target + ": cannot be written: no file can be made in folder \"" + (folder.empty() ? "." : folder) +
                                    "\": " + std::strerror(reason));
    }
    ~temporary_file()
    {
        if (!path_.empty()) unlink(path_.c_str());
    }
    temporary_file(const temporary_file &) = delete;
    temporary_file &operator=(const temporary_file &) = delete;
    const std::string &path() const { return path_; }
    void rename_to_target()
    {
        if (rename(path_.c_str(), target_.c_str()) != 0)
            fail(PLIANT_ERROR_FILE, target_ + ": cannot be written: " + std::strerror(errno));
        path_.clear();
    }

private:
    std::string target_, path_;
};

itk::ImageIOBase::Pointer writer_for(const std::string &ending)
{
    if (ending == ".nrrd") return itk::NrrdImageIO::New().GetPointer();
    if (ending == ".mha") return itk::MetaImageIO::New().GetPointer();
    return itk::NiftiImageIO::New().GetPointer();
}

void describe(const pliant_geometry &geometry, itk::ImageIOBase *io)
{
    const double millimetres_per_metre = 1e3;
    itk::ImageIORegion region(3);
    io->SetNumberOfDimensions(3);
    for (unsigned int axis = 0; axis < 3; axis++) {
        std::vector<double> direction(3);
        for (unsigned int row = 0; row < 3; row++) direction[row] = geometry.direction[3 * row + axis];
        io->SetDimensions(axis, static_cast<unsigned int>(geometry.size[axis]));
        io->SetSpacing(axis, geometry.spacing[axis] * millimetres_per_metre);
        io->SetOrigin(axis, geometry.origin[axis] * millimetres_per_metre);
        io->SetDirection(axis, direction);
        region.SetSize(axis, static_cast<itk::SizeValueType>(geometry.size[axis]));
    }
    io->SetIORegion(region);
}

/* The libraries below ITK do not tell when a disk is full: everything must be in the file. For gzip, its last four
 * bytes are the length of what went in (RFC 1952), which no cut-off file ends with but by rare chance. */
void check_complete(const std::string &target, const std::string &path, const std::string &ending, size_t data_bytes)
{
    std::ifstream file(path, std::ios::binary | std::ios::ate);
    std::streamoff size = file ? static_cast<std::streamoff>(file.tellg()) : 0;
    bool complete;
    if (ending == ".nii.gz") {
        const uint32_t nifti_header = 352;
        unsigned char tail[4] = {0, 0, 0, 0};
        if (size > 18) file.seekg(size - 4).read(reinterpret_cast<char *>(tail), 4);
        uint32_t length = tail[0] | static_cast<uint32_t>(tail[1]) << 8 | static_cast<uint32_t>(tail[2]) << 16 | static_cast<uint32_t>(tail[3]) << 24;
        complete = file.good() && length == static_cast<uint32_t>(nifti_header + data_bytes);
    } else {
        complete = size > static_cast<std::streamoff>(data_bytes);
    }
    if (!complete) fail(PLIANT_ERROR_FILE, target + ": cannot be written completely: is the disk full?");
}

/* @param type, size: of the numbers in voxels */
void write_image(const std::string &target, const pliant_geometry &geometry, itk::ImageIOBase::IOComponentType type, size_t size, const void *voxels)
{
    std::string ending = ending_of(target);
    bool nifti = ending == ".nii" || ending == ".nii.gz";
    for (int d = 0; d < 3; d++)
        if (nifti && geometry.size[d] > INT16_MAX)
            fail(PLIANT_ERROR_FORMAT, target + ": " + std::to_string(geometry.size[d]) + " voxels along an axis: NIfTI holds 32767; use .nrrd or .mha");
    struct stat status;
    if (stat(target.c_str(), &status) == 0 && S_ISDIR(status.st_mode)) fail(PLIANT_ERROR_FILE, target + ": cannot be written: is a folder");

    temporary_file file(target, ending);
    {
        pliant_read::itk_scope quiet;
        itk::ImageIOBase::Pointer io = writer_for(ending);
        io->SetFileName(file.path());
        io->SetPixelType(itk::ImageIOBase::SCALAR);
        io->SetNumberOfComponents(1);
        io->SetComponentType(type);
        io->SetUseCompression(ending == ".nii.gz");
        describe(geometry, io);
        try {
            io->WriteImageInformation();
            io->Write(voxels);
        } catch (const itk::ExceptionObject &error) {
            fail(PLIANT_ERROR_FILE, target + ": cannot be written: " + pliant_read::itk_reason(error));
        }
    }
    check_complete(target, file.path(), ending, pliant_geometry_voxels(&geometry) * size);
    file.rename_to_target();
}

void write_volume(const std::string &path, const pliant_volume &volume)
{
    const bool scaled = volume.slope != 1.0f || volume.intercept != 0.0f;
    if (!scaled && volume.encoding == PLIANT_UINT8)
        return write_image(path, volume.geometry, itk::ImageIOBase::UCHAR, 1, volume.voxels);
    if (!scaled && volume.encoding == PLIANT_INT16)
        return write_image(path, volume.geometry, itk::ImageIOBase::SHORT, 2, volume.voxels);
    if (!scaled) return write_image(path, volume.geometry, itk::ImageIOBase::FLOAT, 4, volume.voxels);

    ending_of(path); /* before the work */
    size_t count = pliant_geometry_voxels(&volume.geometry);
    struct block {
        float *values;
        ~block() { pliant_free(values); }
    } block = {static_cast<float *>(pliant_calloc(count, sizeof(float)))};
    if (!block.values) fail(PLIANT_ERROR_MEMORY, path + ": out of memory for its values");
    for (size_t n = 0; n < count; n++) block.values[n] = pliant_volume_value(&volume, n);
    write_image(path, volume.geometry, itk::ImageIOBase::FLOAT, 4, block.values);
}

/* No exception leaves. */
template <class Action> pliant_status guarded(const char *path, const void *voxels, Action action)
{
    if (!path || !*path) return pliant_fail(PLIANT_ERROR_ARGUMENT, "writing a volume: no path given");
    if (!voxels) return pliant_fail(PLIANT_ERROR_ARGUMENT, "%s: the volume to write has no voxels", path);
    try {
        action();
        return PLIANT_OK;
    } catch (const failure &failure) {
        return pliant_fail(failure.status, "%s", failure.text.c_str());
    } catch (const std::bad_alloc &) {
        return pliant_fail(PLIANT_ERROR_MEMORY, "%s: out of memory while writing it", path);
    } catch (const std::exception &error) {
        return pliant_fail(PLIANT_ERROR_FILE, "%s: cannot be written: %.600s", path, error.what());
    } catch (...) {
        return pliant_fail(PLIANT_ERROR_FILE, "%s: cannot be written", path);
    }
}

} // namespace

pliant_status pliant_volume_write(const char *path, const pliant_volume *volume)
{
    return guarded(path, volume->voxels, [&] { write_volume(path, *volume); });
}

pliant_status pliant_labels_write(const char *path, const pliant_labels *labels)
{
    return guarded(path, labels->voxels, [&] { write_image(path, labels->geometry, itk::ImageIOBase::USHORT, 2, labels->voxels); });
}
