/* What subscribers of the deformed volume have, and which bricks differ from that by the scan's noise or more. */
#ifndef PLIANT_ROS_OUTPUT_SENT_VOLUME_H
#define PLIANT_ROS_OUTPUT_SENT_VOLUME_H

#include "pliant/ros/convert.h"

#include <cstdint>
#include <vector>

namespace pliant_ros {

/* Bricks in which all voxels have changed by less than a threshold wait until the tissue rests. Not thread-safe. */
class SentVolume {
public:
    /* Begin with another volume, of which nothing was sent. threshold: in values of the scan; 0: every change is sent. */
    void start(double threshold, const Box &region);
    /* Of the bricks that changed, keep those to be sent: a voxel inside the region differs from the one sent by the threshold or more, or
     * by anything if the tissue rests. The other ones wait. *bricks: one byte per brick. */
    void select(const pliant_volume &volume, bool rests, std::vector<uint8_t> *bricks);
    /* Whether bricks wait for the tissue to rest. */
    bool owes() const { return owes_; }
    /* This box was sent. */
    void keep(const pliant_volume &volume, const Box &box);

private:
    bool differs(const pliant_volume &volume, const Box &box, double value) const;

    double threshold_ = 0;
    Box region_{};
    std::vector<uint8_t> sent_;  /* voxels as they were sent; empty before the first box, and without a threshold */
    std::vector<uint8_t> waits_; /* bricks */
    bool owes_ = false;
};

} // namespace pliant_ros

#endif
