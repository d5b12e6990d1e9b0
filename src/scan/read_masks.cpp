/* Reads a folder with one mask per segment, as written by TotalSegmentator without --ml: liver.nii.gz, spleen.nii.gz,
 * ... */
#include "scan/read_segments.h"

#include "base/free_memory.h"
#include "base/memory.h"
#include "scan/volume.h"

#include <algorithm>

namespace pliant_read {

namespace {

/* Return the name of a mask without its extension; "" for other files. */
std::string mask_name(const std::string &file)
{
    for (const char *ending : {".nii.gz", ".nii", ".nrrd", ".mha", ".mhd"})
        if (ends_with(lower_case(file), ending)) return file.substr(0, file.size() - std::string(ending).size());
    return "";
}

/* Owner of voxels. */
struct voxels_holder {
    void *voxels = nullptr;
    ~voxels_holder() { pliant_free(voxels); }
};

class masks_source : public image_source {
public:
    masks_source(const std::string &folder, const std::vector<std::string> &files) : folder_(folder), files_(files)
    {
        for (const std::string &file : files_) {
            const std::unique_ptr<image_source> mask = open(file);
            if (segments.empty()) header.geometry = mask->header.geometry;
            if (!pliant_geometry_equal(&header.geometry, &mask->header.geometry))
                fail(PLIANT_ERROR_FORMAT, "%s: lies on another grid than %s: masks of a folder must have one grid",
                     file.c_str(), files_[0].c_str());
            pliant_label_segment one = {};
            one.value = static_cast<uint16_t>(segments.size() + 1);
            std::fill(one.color, one.color + 3, -1.0f);
            set_text(mask_name(file.substr(folder_of(file).size())), one.name);
            segments.push_back(one);
        }
        number_segments(folder, &segments);
        header.type = component::uint16;
        header.whole_numbers = true;
    }

    void read(void *voxels) override
    {
        const size_t count = pliant_geometry_voxels(&header.geometry);
        segment_painter painter(segments, count, static_cast<uint16_t *>(voxels));
        for (size_t n = 0; n < files_.size(); n++) {
            voxels_holder raw, mask;
            const std::unique_ptr<image_source> source = open(files_[n]);
            const size_t bytes = component_size(source->header.type) + sizeof(uint16_t);
            if (pliant_memory_check(static_cast<double>(count * bytes), "a mask") != PLIANT_OK ||
                !(raw.voxels = pliant_calloc(count, component_size(source->header.type))))
                fail(PLIANT_ERROR_MEMORY, "%s: out of memory for a mask", files_[n].c_str());
            source->read(raw.voxels);
            mask.voxels = convert_labels(files_[n], source->header, &raw.voxels);
            paint(n, static_cast<const uint16_t *>(mask.voxels), count, &painter);
        }
        painter.finish(folder_);
    }

private:
    std::string folder_;
    std::vector<std::string> files_;

    static std::unique_ptr<image_source> open(const std::string &file)
    {
        std::unique_ptr<image_source> source = open_image_file(file);
        if (!source || !source->segments.empty())
            fail(PLIANT_ERROR_FORMAT, "%s: is no mask of one segment; name this file instead of its folder",
                 file.c_str());
        return source;
    }

    void paint(size_t n, const uint16_t *mask, size_t count, segment_painter *painter) const
    {
        uint16_t inside = 0;
        for (size_t v = 0; v < count; v++) {
            if (mask[v] == 0) continue;
            if (inside == 0) inside = mask[v];
            if (mask[v] != inside)
                fail(PLIANT_ERROR_FORMAT,
                     "%s: is no mask: it holds %d and %d; if it is a label map, name this file instead of its folder",
                     files_[n].c_str(), inside, mask[v]);
            painter->put(v, n);
        }
    }
};

} // namespace

std::unique_ptr<image_source> open_masks(const std::string &folder)
{
    std::vector<std::string> files;
    for (const std::string &name : names_in(folder))
        if (!mask_name(name).empty()) files.push_back(folder + (ends_with(folder, "/") ? "" : "/") + name);
    if (files.empty()) return nullptr;
    return std::unique_ptr<image_source>(new masks_source(folder, files));
}

} // namespace pliant_read
