/* Low-pass filter for measured poses (~pose_filter). It filters position and orientation to first order, with the time
 * stamps of the poses, and adds a delay of 1 / (2 pi cutoff). This class does not use ROS. */
#ifndef PLIANT_ROS_SIM_POSE_FILTER_H
#define PLIANT_ROS_SIM_POSE_FILTER_H

#include "pliant/ros/convert.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace pliant_ros {

class PoseFilter {
public:
    /* cutoff: frequency [Hz]; 0 disables the filter */
    explicit PoseFilter(double cutoff = 0) : cutoff_(cutoff) {}

    /* Filter the next pose. A gap of 0.1 s or another frame restarts the filter; a pose that is not newer has no
     * effect.
     * stamp: [s] */
    Rigid next(double stamp, const std::string &frame, const Rigid &pose)
    {
        const double gap = 0.1, elapsed = stamp - stamp_; /* [s] */
        if (cutoff_ > 0 && elapsed <= 0 && elapsed > -gap && frame == frame_) return last_;
        const bool goes_on = cutoff_ > 0 && elapsed > 0 && elapsed < gap && frame == frame_;
        const double fraction = goes_on ? 1 - std::exp(-2 * M_PI * cutoff_ * elapsed) : 1;
        double dot = 0, square = 0;
        for (int i = 0; i < 4; ++i) dot += last_.rotation[i] * pose.rotation[i];
        for (int d = 0; d < 3; ++d) last_.translation[d] += fraction * (pose.translation[d] - last_.translation[d]);
        for (int i = 0; i < 4; ++i) {
            /* consecutive orientations are close, so linear interpolation suffices */
            last_.rotation[i] += fraction * ((dot < 0 ? -1 : 1) * pose.rotation[i] - last_.rotation[i]);
            square += last_.rotation[i] * last_.rotation[i];
        }
        for (double &q : last_.rotation) q /= std::sqrt(square);
        if (!goes_on) last_ = pose;
        stamp_ = stamp;
        frame_ = frame;
        return last_;
    }
    void forget() { frame_.clear(); }

private:
    double cutoff_, stamp_ = -1e9;
    std::string frame_;
    Rigid last_ = identity();
};

} // namespace pliant_ros

#endif
