#include "scan/read_segments.h"

#include <algorithm>
#include <cstring>

namespace pliant_read {

void set_text(const std::string &text, char (&out)[64])
{
    size_t length = std::min(text.size(), sizeof out - 1);
    while (length < text.size() && length > 0 && (static_cast<unsigned char>(text[length]) & 0xc0) == 0x80) length--;
    std::memset(out, 0, sizeof out);
    for (size_t n = 0; n < length; n++) out[n] = static_cast<unsigned char>(text[n]) < ' ' ? ' ' : text[n];
}

void number_segments(const std::string &path, std::vector<pliant_label_segment> *segments)
{
    if (segments->size() > UINT16_MAX)
        fail(PLIANT_ERROR_FORMAT, "%s: %zu segments; a label map holds at most 65535", path.c_str(), segments->size());
    std::vector<bool> used(UINT16_MAX + 1, false);
    bool unique = true;
    for (const pliant_label_segment &one : *segments) {
        unique = unique && !used[one.value];
        used[one.value] = true;
    }
    for (size_t n = 0; n < segments->size(); n++)
        (*segments)[n].label = unique ? (*segments)[n].value : static_cast<uint16_t>(n + 1);
}

void segment_painter::finish(const std::string &path)
{
    std::vector<uint16_t> label(segments_.size() + 1, 0);
    for (size_t n = 0; n < segments_.size(); n++) label[n + 1] = segments_[n].label;
    size_t labelled = 0;
    for (size_t v = 0; v < count_; v++) {
        labelled += voxels_[v] != 0;
        voxels_[v] = label[voxels_[v]];
    }
    if (labelled == 0)
        pliant_log(PLIANT_LOG_WARNING, "%s: an empty segmentation: none of its %zu segments has a voxel", path.c_str(),
                   segments_.size());
    const size_t voxels = static_cast<size_t>(std::count(is_shared_.begin(), is_shared_.end(), true));
    size_t listed = 0;
    std::string pairs;
    for (const auto &one : overlaps_) {
        if (listed++ < 8)
            pairs += std::string(pairs.empty() ? "" : ", ") + segments_[static_cast<size_t>(one.first.second)].name +
                     " over " + segments_[static_cast<size_t>(one.first.first)].name + " in " +
                     std::to_string(one.second);
    }
    if (listed > 8) pairs += " and " + std::to_string(listed - 8) + " more pairs";
    if (voxels > 0)
        pliant_log(PLIANT_LOG_WARNING, "%s: segments overlap; the later one wins in %zu voxels: %s", path.c_str(),
                   voxels, pairs.c_str());
}

} // namespace pliant_read
