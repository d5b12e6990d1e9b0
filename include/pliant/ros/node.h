/** @file node.h
 *  The whole node: one object, made by the program and by the nodelet alike.
 *
 *  Threads: callbacks of tools, of subscribers coming and going and of dynamic_reconfigure run on the handle's queue;
 *  the simulation, the mesh messages, the deformed volume and the services each have threads of their own.
 */
#ifndef PLIANT_ROS_NODE_H
#define PLIANT_ROS_NODE_H

#include <ros/node_handle.h>

#include <memory>

namespace pliant_ros {

class Node {
public:
    /** @param handle         namespace of the topics and services
     *  @param private_handle namespace of the parameters
     *  Returns at once. A thread loads the scan. Throws std::runtime_error with a message for a person when a
     *  parameter is wrong. A scan that cannot be loaded is no error: the topic `state` says so, and load_scan may try
     *  again. */
    Node(ros::NodeHandle handle, ros::NodeHandle private_handle);
    ~Node();

private:
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

} // namespace pliant_ros

#endif
