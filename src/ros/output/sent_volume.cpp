#include "ros/output/sent_volume.h"
#include "scan/volume.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace pliant_ros {

namespace {

size_t voxel_at(const int32_t size[3], uint32_t i, uint32_t j, uint32_t k)
{
    return i + static_cast<size_t>(size[0]) * (j + static_cast<size_t>(size[1]) * k);
}

template <class Voxel>
bool differs_by(const void *a, const void *b, const int32_t size[3], const Box &box, double stored)
{
    const Voxel *x = static_cast<const Voxel *>(a), *y = static_cast<const Voxel *>(b);
    for (uint32_t k = box.offset[2]; k < box.offset[2] + box.size[2]; ++k)
        for (uint32_t j = box.offset[1]; j < box.offset[1] + box.size[1]; ++j) {
            const size_t row = voxel_at(size, box.offset[0], j, k);
            for (size_t at = row; at < row + box.size[0]; ++at)
                if (!(std::abs(static_cast<double>(x[at]) - y[at]) < stored)) return true;
        }
    return false;
}

/* Return the voxels of a brick that lie inside a region. */
Box box_of_brick(const int32_t size[3], size_t brick, const Box &region)
{
    size_t count[2];
    for (int d = 0; d < 2; ++d) count[d] = (static_cast<size_t>(size[d]) + PLIANT_BRICK_SIZE - 1) / PLIANT_BRICK_SIZE;
    const size_t at[3] = {brick % count[0], brick / count[0] % count[1], brick / count[0] / count[1]};
    Box box;
    for (int d = 0; d < 3; ++d) {
        box.offset[d] = static_cast<uint32_t>(at[d]) * PLIANT_BRICK_SIZE;
        box.size[d] = std::min<uint32_t>(PLIANT_BRICK_SIZE, static_cast<uint32_t>(size[d]) - box.offset[d]);
    }
    return common_box(box, region);
}

} // namespace

void SentVolume::start(double threshold, const Box &region)
{
    threshold_ = threshold;
    region_ = region;
    std::vector<uint8_t>().swap(sent_);
    waits_.clear();
    has_unsent_bricks_ = false;
}

void SentVolume::select(const pliant_volume &volume, bool rests, std::vector<uint8_t> *bricks)
{
    if (sent_.empty()) return;
    waits_.resize(bricks->size());
    has_unsent_bricks_ = false;
    for (size_t brick = 0; brick < bricks->size(); ++brick) {
        if (rests && waits_[brick]) (*bricks)[brick] = 1;
        if ((*bricks)[brick]) {
            const Box box = box_of_brick(volume.geometry.size, brick, region_);
            const bool inside = box.size[0] && box.size[1] && box.size[2];
            (*bricks)[brick] = inside && differs(volume, box, rests ? 0 : threshold_);
            waits_[brick] = inside && !rests && !(*bricks)[brick];
        }
        has_unsent_bricks_ = has_unsent_bricks_ || waits_[brick];
    }
}

bool SentVolume::differs(const pliant_volume &volume, const Box &box, double value) const
{
    const double stored = std::max(value / std::abs(volume.slope), std::numeric_limits<double>::min());
    const int32_t *size = volume.geometry.size;
    if (volume.encoding == PLIANT_UINT8) return differs_by<uint8_t>(volume.voxels, sent_.data(), size, box, stored);
    if (volume.encoding == PLIANT_INT16) return differs_by<int16_t>(volume.voxels, sent_.data(), size, box, stored);
    return differs_by<float>(volume.voxels, sent_.data(), size, box, stored);
}

void SentVolume::keep(const pliant_volume &volume, const Box &box)
{
    if (!(threshold_ > 0)) return;
    const int32_t *size = volume.geometry.size;
    const size_t bytes = pliant_encoding_size(volume.encoding);
    sent_.resize(bytes * static_cast<size_t>(size[0]) * size[1] * size[2]);
    const uint8_t *voxels = static_cast<const uint8_t *>(volume.voxels);
    for (uint32_t k = box.offset[2]; k < box.offset[2] + box.size[2]; ++k)
        for (uint32_t j = box.offset[1]; j < box.offset[1] + box.size[1]; ++j) {
            const size_t row = bytes * voxel_at(size, box.offset[0], j, k);
            std::memcpy(&sent_[row], voxels + row, bytes * box.size[0]);
        }
}

} // namespace pliant_ros
