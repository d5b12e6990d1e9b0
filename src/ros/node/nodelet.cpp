#include "pliant/ros/node.h"

#include "ros/node/faulted_node.h"

#include <nodelet/nodelet.h>
#include <pluginlib/class_list_macros.hpp>

namespace pliant_ros {

class TissueNodelet : public nodelet::Nodelet {
    void onInit() override
    {
        try {
            node_.reset(new Node(getMTNodeHandle(), getMTPrivateNodeHandle()));
        } catch (const std::exception &wrong) {
            NODELET_FATAL("%s", wrong.what());
            faulted_node_.reset(new FaultedNode(getMTNodeHandle(), getMTPrivateNodeHandle(), wrong.what()));
        }
    }

    std::unique_ptr<Node> node_;
    std::unique_ptr<FaultedNode> faulted_node_;
};

} // namespace pliant_ros

PLUGINLIB_EXPORT_CLASS(pliant_ros::TissueNodelet, nodelet::Nodelet)
