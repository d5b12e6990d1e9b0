#include "pliant/ros/node.h"

#include "diagnostics.h"
#include "services.h"
#include "volume_output.h"

#include <ros/console.h>
#include <ros/param.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>

#include <mutex>

namespace pliant_ros {

namespace {

/* One line a second of the same text at most: a step that fails, fails fifty times a second. Called one at a time. */
void log_to_rosconsole(pliant_log_level level, const char *message, void *)
{
    static std::string last;
    static double last_time = -1;
    double now = pliant_seconds();
    if (last == message && now - last_time < 1) return;
    last = message;
    last_time = now;
    switch (level) {
    case PLIANT_LOG_DEBUG: ROS_DEBUG("%s", message); break;
    case PLIANT_LOG_INFO: ROS_INFO("%s", message); break;
    case PLIANT_LOG_WARNING: ROS_WARN("%s", message); break;
    case PLIANT_LOG_ERROR: ROS_ERROR("%s", message); break;
    }
}

Parameters parameters_of(const ros::NodeHandle &private_handle)
{
    XmlRpc::XmlRpcValue tree;
    if (!ros::param::get(private_handle.getNamespace(), tree)) tree = XmlRpc::XmlRpcValue();
    Parameters parameters;
    std::string why;
    if (!read_parameters(tree, &parameters, &why)) throw std::runtime_error(why);
    return parameters;
}

geometry_msgs::TransformStamped tissue_transform(const Parameters &parameters)
{
    geometry_msgs::TransformStamped out;
    out.header.stamp = ros::Time::now();
    out.header.frame_id = parameters.parent_frame;
    out.child_frame_id = parameters.tissue_frame;
    out.transform = transform_message(parameters.tissue_pose);
    return out;
}

} // namespace

/* In the order in which they need each other; taken apart from the end. */
struct Node::Parts {
    Parts(ros::NodeHandle handle, ros::NodeHandle private_handle)
        : parameters(parameters_of(private_handle)), frames(std::make_shared<tf2_ros::Buffer>()), listener(*frames),
          state(handle, parameters.tissue_frame), live(private_handle, parameters), tools(handle, parameters, frames),
          mesh_output(handle, parameters, &live, &snapshots), volume_output(handle, parameters, &live, &snapshots),
          simulation(handle, parameters, &state, &live, &tools, &snapshots),
          services(handle, parameters, &state, &live, &simulation, &mesh_output, &volume_output, frames),
          diagnostics(handle, private_handle, parameters, &state, &simulation, &tools)
    {
        if (parameters.parent_frame.empty()) return;
        geometry_msgs::TransformStamped transform = tissue_transform(parameters);
        broadcaster.sendTransform(transform);
        frames->setTransform(transform, "pliant", true); /* for this node, without the way over the network */
    }

    const Parameters parameters;
    Snapshots snapshots;
    std::shared_ptr<tf2_ros::Buffer> frames;
    tf2_ros::TransformListener listener;
    tf2_ros::StaticTransformBroadcaster broadcaster;
    State state;
    Live live;
    Tools tools;
    MeshOutput mesh_output;
    VolumeOutput volume_output;
    Simulation simulation;
    Services services;
    Diagnostics diagnostics;
};

Node::Node(ros::NodeHandle handle, ros::NodeHandle private_handle)
{
    pliant_set_log(log_to_rosconsole, nullptr);
    parts_.reset(new Parts(handle, private_handle));
}

Node::~Node() = default;

} // namespace pliant_ros
