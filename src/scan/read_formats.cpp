/* Detects image files other than DICOM, by content and extension. */
#include "scan/read.h"

namespace pliant_read {

std::unique_ptr<image_source> open_image_file(const std::string &path)
{
    const std::string name = lower_case(path), start = file_start(path, 8);
    if (start.compare(0, 4, "NRRD") == 0 || ends_with(name, ".nrrd") || ends_with(name, ".nhdr"))
        return open_nrrd(path);
    if (ends_with(name, ".mha") || ends_with(name, ".mhd")) return open_metaimage(path);
    if (is_nifti(path)) return open_nifti(path);
    return nullptr;
}

} // namespace pliant_read
