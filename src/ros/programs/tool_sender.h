/* Publish the CRTK topics of one tool: measured_cp and jaw/measured_js, and blade, which switches cutting. */
#ifndef PLIANT_ROS_PROGRAMS_TOOL_SENDER_H
#define PLIANT_ROS_PROGRAMS_TOOL_SENDER_H

#include <geometry_msgs/PoseStamped.h>
#include <ros/node_handle.h>
#include <sensor_msgs/JointState.h>
#include <std_msgs/Bool.h>

#include <string>

namespace pliant_ros {

class ToolSender {
public:
    ToolSender(ros::NodeHandle handle, const std::string &tool, const std::string &frame)
        : handle_(handle), tool_(tool), frame_(frame)
    {
        pose_ = handle.advertise<geometry_msgs::PoseStamped>(tool + "/measured_cp", 1);
        jaw_ = handle.advertise<sensor_msgs::JointState>(tool + "/jaw/measured_js", 1);
    }

    /* Latched, so it is sent only on a change. */
    void send_blade(bool on)
    {
        if (!blade_) blade_ = handle_.advertise<std_msgs::Bool>(tool_ + "/blade", 1, true);
        if (sent_ == static_cast<int>(on)) return;
        sent_ = on;
        std_msgs::Bool message;
        message.data = on;
        blade_.publish(message);
    }

    void send(const geometry_msgs::Pose &tip, bool closed, const ros::Time &stamp)
    {
        geometry_msgs::PoseStamped pose;
        pose.header.stamp = stamp;
        pose.header.frame_id = frame_;
        pose.pose = tip;
        pose_.publish(pose);
        sensor_msgs::JointState jaw;
        jaw.header = pose.header;
        jaw.name.push_back("jaw");
        jaw.position.push_back(closed ? 0.0 : 0.5); /* [rad] */
        jaw_.publish(jaw);
    }

private:
    ros::NodeHandle handle_;
    std::string tool_, frame_;
    int sent_ = -1; /* last published blade state; -1: none */
    ros::Publisher pose_, jaw_, blade_;
};

} // namespace pliant_ros

#endif
