/* Start-up functions shared by the nodes. */
#ifndef PLIANT_ROS_PARAMS_START_H
#define PLIANT_ROS_PARAMS_START_H

#include "ros/params/params.h"

#include <geometry_msgs/TransformStamped.h>
#include <ros/node_handle.h>

#include <stdexcept>

namespace pliant_ros {

/* A parameter is wrong, so a restart would fail as well. The message addresses the user. */
class WrongParameter : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

/* Send log messages of the library to rosconsole. The same text appears at most once per second. */
void log_to_rosconsole();

/* Throw WrongParameter. */
Parameters parameters_of(const ros::NodeHandle &private_handle);

/* Return the pose of the tissue in its parent frame, stamped with the current time. */
geometry_msgs::TransformStamped tissue_transform(const Parameters &parameters);

} // namespace pliant_ros

#endif
