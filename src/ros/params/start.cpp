#include "ros/params/start.h"
#include "base/clock.h"

#include <ros/console.h>
#include <ros/param.h>

namespace pliant_ros {

namespace {

/* Log a message of the library. Messages are throttled because a failing step fails at every step. Not called
 * concurrently. */
void log_line(pliant_log_level level, const char *message, void *)
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

} // namespace

void log_to_rosconsole() { pliant_set_log(log_line, nullptr); }

Parameters parameters_of(const ros::NodeHandle &private_handle)
{
    XmlRpc::XmlRpcValue tree;
    if (!ros::param::get(private_handle.getNamespace(), tree)) tree = XmlRpc::XmlRpcValue();
    Parameters parameters;
    std::string why;
    if (!read_parameters(tree, &parameters, &why)) throw WrongParameter(why);
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

} // namespace pliant_ros
