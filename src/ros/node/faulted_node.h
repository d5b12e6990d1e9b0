/* Replacement for a node whose parameters are wrong. It publishes `state` as FAULT and reports the error in diagnostics
 * until it is stopped. A process that exits would be restarted endlessly. */
#ifndef PLIANT_ROS_NODE_FAULTED_NODE_H
#define PLIANT_ROS_NODE_FAULTED_NODE_H

#include "ros/sim/state.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/node_handle.h>

#include <string>

namespace pliant_ros {

class FaultedNode {
public:
    FaultedNode(ros::NodeHandle handle, ros::NodeHandle private_handle, const std::string &why);

private:
    State state_;
    diagnostic_updater::Updater updater_;
    ros::WallTimer timer_;
};

} // namespace pliant_ros

#endif
