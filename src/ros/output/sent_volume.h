/* Voxel values that subscribers of the deformed volume have received. The class selects the bricks that differ from
 * these values by the scan's noise or more. */
#ifndef PLIANT_ROS_OUTPUT_SENT_VOLUME_H
#define PLIANT_ROS_OUTPUT_SENT_VOLUME_H

#include "pliant/ros/convert.h"

#include <cstdint>
#include <vector>

namespace pliant_ros {

/* If all voxels of a brick have changed by less than a threshold, the brick is sent when the tissue rests. Not
 * thread-safe. */
class SentVolume {
public:
    /* Start a new volume of which nothing was sent.
     * threshold: in values of the scan; 0: every change is sent */
    void start(double threshold, const Box &region);
    /* Select the bricks to send among the changed ones. A brick is selected if a voxel inside the region differs from
     * the sent value by the threshold or more. If the tissue rests, any difference counts. The other bricks wait.
     * bricks: input and output, one byte per brick */
    void select(const pliant_volume &volume, bool rests, std::vector<uint8_t> *bricks);
    /* Return whether bricks wait for the tissue to rest. */
    bool has_unsent_bricks() const { return has_unsent_bricks_; }
    /* Record that this box was sent. */
    void keep(const pliant_volume &volume, const Box &box);

private:
    bool differs(const pliant_volume &volume, const Box &box, double value) const;

    double threshold_ = 0;
    Box region_{};
    std::vector<uint8_t> sent_;  /* voxel values as sent; empty before the first box and without a threshold */
    std::vector<uint8_t> waits_; /* whether a brick waits, one byte per brick */
    bool has_unsent_bricks_ = false;
};

} // namespace pliant_ros

#endif
