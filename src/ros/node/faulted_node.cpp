#include "ros/node/faulted_node.h"

namespace pliant_ros {

FaultedNode::FaultedNode(ros::NodeHandle handle, ros::NodeHandle private_handle, const std::string &why)
    : state_(handle, private_handle.param<std::string>("tissue_frame", "tissue")),
      updater_(handle, private_handle, private_handle.getNamespace())
{
    state_.set(SimState::FAULT, why);
    updater_.setHardwareID("none");
    updater_.add("parameters", [why](diagnostic_updater::DiagnosticStatusWrapper &status) {
        status.summary(diagnostic_msgs::DiagnosticStatus::ERROR, why);
    });
    timer_ =
        handle.createWallTimer(ros::WallDuration(1), [this](const ros::WallTimerEvent &) { updater_.force_update(); });
}

} // namespace pliant_ros
