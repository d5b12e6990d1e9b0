/* Shared functions of the readers of segmentations: numbering segments, and painting them into a label map. */
#ifndef PLIANT_SCAN_READ_SEGMENTS_H
#define PLIANT_SCAN_READ_SEGMENTS_H

#include "scan/read.h"

#include <algorithm>
#include <map>
#include <utility>

namespace pliant_read {

/* Copy text into an array of a segment; longer text is cut before a UTF-8 character. */
void set_text(const std::string &text, char (&out)[64]);

/* Assign a label to every segment: its value, or its position if two segments share a value. */
void number_segments(const std::string &path, std::vector<pliant_label_segment> *segments);

/* Paints segments into a label map, which is zero at first. Where they overlap the later segment of the list wins,
 * independent of the order of the calls. */
class segment_painter {
public:
    segment_painter(const std::vector<pliant_label_segment> &segments, size_t count, uint16_t *voxels)
        : segments_(segments), count_(count), voxels_(voxels)
    {
    }
    void put(size_t voxel, size_t segment)
    {
        const uint16_t next = static_cast<uint16_t>(segment + 1), there = voxels_[voxel];
        if (there != 0 && there != next) overlap(voxel, std::min(there, next) - 1, std::max(there, next) - 1);
        if (next > there) voxels_[voxel] = next;
    }
    /* Change positions to labels; log overlaps. */
    void finish(const std::string &path);

private:
    const std::vector<pliant_label_segment> &segments_;
    size_t count_;
    uint16_t *voxels_; /* position of the segment, from 1 */
    /* Number of voxels that the later segment takes from the earlier one. */
    std::map<std::pair<int, int>, size_t> overlaps_;
    std::vector<bool> is_shared_;                    /* by several segments; empty: no voxel is shared */

    void overlap(size_t voxel, int earlier, int later)
    {
        if (is_shared_.empty()) is_shared_.resize(count_, false);
        is_shared_[voxel] = true;
        overlaps_[{earlier, later}]++;
    }
};

} // namespace pliant_read

#endif
