/* In the place of a node whose parameters are wrong, where one that ends would be started again without end: `state` is FAULT, and
 * diagnostics say what is wrong, until somebody ends it. */
#ifndef PLIANT_ROS_NODE_REFUSED_H
#define PLIANT_ROS_NODE_REFUSED_H

#include "ros/sim/state.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/node_handle.h>

#include <string>

namespace pliant_ros {

class Refused {
public:
    Refused(ros::NodeHandle handle, ros::NodeHandle private_handle, const std::string &why);

private:
    State state_;
    diagnostic_updater::Updater updater_;
    ros::WallTimer timer_;
};

} // namespace pliant_ros

#endif
