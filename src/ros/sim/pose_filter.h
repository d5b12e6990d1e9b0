/* Measured poses, smoothed where somebody asks for it (~pose_filter): a first-order low-pass over position and orientation, by the poses' own
 * stamps. What it takes of the jitter it gives back as delay, 1 / (2 pi cutoff) of it. No ROS. */
#ifndef PLIANT_ROS_SIM_POSE_FILTER_H
#define PLIANT_ROS_SIM_POSE_FILTER_H

#include "pliant/ros/convert.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace pliant_ros {

class PoseFilter {
public:
    /* cutoff [Hz]; 0: poses stay as they come */
    explicit PoseFilter(double cutoff = 0) : cutoff_(cutoff) {}

    /* The next one, by its stamp [s]. After a gap, or in another frame, it begins anew; one that is no newer changes nothing. */
    Rigid next(double stamp, const std::string &frame, const Rigid &pose)
    {
        const double gap = 0.1, elapsed = stamp - stamp_; /* [s] */
        if (cutoff_ > 0 && elapsed <= 0 && elapsed > -gap && frame == frame_) return last_;
        const bool goes_on = cutoff_ > 0 && elapsed > 0 && elapsed < gap && frame == frame_;
        const double share = goes_on ? 1 - std::exp(-2 * M_PI * cutoff_ * elapsed) : 1;
        double dot = 0, square = 0;
        for (int i = 0; i < 4; ++i) dot += last_.rotation[i] * pose.rotation[i];
        for (int d = 0; d < 3; ++d) last_.translation[d] += share * (pose.translation[d] - last_.translation[d]);
        for (int i = 0; i < 4; ++i) {
            last_.rotation[i] += share * ((dot < 0 ? -1 : 1) * pose.rotation[i] - last_.rotation[i]); /* neighbours: a straight line will do */
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
