/* Reads a scan or a label map: format detection, memory check, voxels, conversion. Contains the C boundary. */
#include "scan/read.h"

#include "base/free_memory.h"
#include "base/memory.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <new>

namespace {

using namespace pliant_read;

void check_memory(const std::string &path, const image_header &header, bool labels, size_t memory_limit)
{
    double per_voxel = static_cast<double>(component_size(header.type));
    double needed = voxel_count(header.geometry) * (per_voxel + conversion_bytes(header, labels));
    double maximum = memory_limit ? static_cast<double>(memory_limit) : pliant_free_memory();
    if (needed > maximum || needed > static_cast<double>(SIZE_MAX / 2))
        fail(PLIANT_ERROR_MEMORY,
             "%s: %d x %d x %d voxels need %.0f MB to be read, %s %.0f MB: resample or crop it first", path.c_str(),
             header.geometry.size[0], header.geometry.size[1], header.geometry.size[2], needed / 1e6,
             memory_limit ? "the limit is" : "the machine has free", maximum / 1e6);
}

std::unique_ptr<image_source> open_source(const std::string &path, const char *series, bool labels)
{
    if (path.empty())
        fail(PLIANT_ERROR_FILE,
             "no scan named: a DICOM folder, or a multi-frame DICOM, NIfTI, NRRD or MetaImage file is needed");
    uint64_t bytes = file_size(path); /* fails if the file is missing */
    if (is_folder(path) && labels)
        if (std::unique_ptr<image_source> masks = open_masks(path)) return masks;
    if (is_folder(path)) return labels ? open_dicom_label_folder(path) : open_dicom_folder(path, series);
    if (bytes == 0) fail(PLIANT_ERROR_FORMAT, "%s: is empty", path.c_str());

    if (std::unique_ptr<image_source> source = open_image_file(path)) return source;
    if (is_dicom_file(path) || ends_with(lower_case(path), ".dcm"))
        return labels ? open_dicom_label_file(path) : open_dicom_file(path);
    fail(
        PLIANT_ERROR_FORMAT,
        "%s: not a scan: a folder with DICOM files, or a multi-frame DICOM (.dcm), NIfTI (.nii, .nii.gz, .hdr), NRRD "
        "(.nrrd, .nhdr) or MetaImage (.mha, .mhd) file is needed",
        path.c_str());
}

/* The voxels in the file's type; freed here unless the conversion took ownership. */
struct raw_voxels {
    void *voxels;
    raw_voxels(const image_header &header)
        : voxels(pliant_calloc(pliant_geometry_voxels(&header.geometry), component_size(header.type)))
    {
        if (!voxels) fail(PLIANT_ERROR_MEMORY, "out of memory for the voxels of a scan");
    }
    ~raw_voxels() { pliant_free(voxels); }
    raw_voxels(const raw_voxels &) = delete;
    raw_voxels &operator=(const raw_voxels &) = delete;
};

/* Set the id to the name of the file or folder. */
void set_id(const std::string &path, char *id, size_t size)
{
    size_t end = path.find_last_not_of('/');
    std::string name = end == std::string::npos ? path : path.substr(0, end + 1);
    name.erase(0, folder_of(name).size());
    std::memset(id, 0, size);
    std::memcpy(id, name.data(), std::min(name.size(), size - 1));
}

/* Check the size of a scan. Labels may have a single slice, but a scan of one slice has no tetrahedra. */
void check_scan(const std::string &path, const image_source &source)
{
    const int32_t *size = source.header.geometry.size;
    if (!source.segments.empty())
        fail(PLIANT_ERROR_FORMAT,
             "%s: is a segmentation, not a scan: give it as material/labels, with the scan on which it was drawn",
             path.c_str());
    if (size[0] < 2 || size[1] < 2 || size[2] < 2)
        fail(PLIANT_ERROR_FORMAT, "%s: a 2-D image (%d x %d x %d), a 3-D volume is needed", path.c_str(), size[0],
             size[1], size[2]);
}

pliant_volume read_volume(const std::string &path, const char *series, size_t memory_limit)
{
    std::unique_ptr<image_source> source = open_source(path, series, false);
    check_scan(path, *source);
    check_memory(path, source->header, false, memory_limit);
    raw_voxels raw(source->header);
    source->read(raw.voxels);
    converted converted = convert_values(path, source->header, &raw.voxels);

    pliant_volume volume = {};
    volume.geometry = source->header.geometry;
    volume.encoding = converted.encoding;
    volume.slope = 1.0f;
    volume.background = converted.background;
    volume.modality = source->header.modality;
    volume.voxels = converted.voxels;
    set_id(path, volume.id, sizeof volume.id);
    return volume;
}

pliant_labels read_labels(const std::string &path, size_t memory_limit)
{
    std::unique_ptr<image_source> source = open_source(path, nullptr, true);
    check_memory(path, source->header, true, memory_limit);
    raw_voxels raw(source->header);
    source->read(raw.voxels);
    source->read_names();

    pliant_labels labels = {};
    labels.geometry = source->header.geometry;
    const std::vector<pliant_label_segment> &segments = source->segments;
    std::unique_ptr<pliant_label_segment, void (*)(void *)> copy(nullptr, pliant_free);
    if (!segments.empty()) {
        copy.reset(static_cast<pliant_label_segment *>(pliant_calloc(segments.size(), sizeof segments[0])));
        if (!copy) fail(PLIANT_ERROR_MEMORY, "%s: out of memory for its segments", path.c_str());
        std::copy(segments.begin(), segments.end(), copy.get());
    }
    labels.voxels = convert_labels(path, source->header, &raw.voxels);
    if (segments.empty() && std::all_of(labels.voxels, labels.voxels + pliant_geometry_voxels(&labels.geometry),
                                        [](uint16_t label) { return label == 0; }))
        pliant_log(PLIANT_LOG_WARNING, "%s: an empty label map: all its %zu voxels are 0, which is no label",
                   path.c_str(), pliant_geometry_voxels(&labels.geometry));
    labels.segments = copy.release();
    labels.num_segments = static_cast<uint32_t>(segments.size());
    return labels;
}

/* No exception crosses the C boundary. */
template <class Action> pliant_status catch_exceptions(const char *path, Action action)
{
    if (!path) return pliant_fail(PLIANT_ERROR_ARGUMENT, "reading a scan: no path given");
    try {
        action();
        return PLIANT_OK;
    } catch (const failure &failure) {
        return pliant_fail(failure.status, "%s", failure.text.c_str());
    } catch (const std::bad_alloc &) {
        return pliant_fail(PLIANT_ERROR_MEMORY, "%s: out of memory while reading it", path);
    } catch (const std::exception &error) {
        return pliant_fail(PLIANT_ERROR_FORMAT, "%s: cannot be read: %.600s", path, error.what());
    } catch (...) {
        return pliant_fail(PLIANT_ERROR_FORMAT, "%s: cannot be read", path);
    }
}

} // namespace

pliant_status pliant_volume_read(const char *path, const char *series, size_t memory_limit, pliant_volume *out)
{
    return catch_exceptions(path, [&] { *out = read_volume(path, series, memory_limit); });
}

pliant_status pliant_labels_read(const char *path, size_t memory_limit, pliant_labels *out)
{
    return catch_exceptions(path, [&] { *out = read_labels(path, memory_limit); });
}
