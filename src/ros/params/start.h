/* What every node of Pliant does at its start. */
#ifndef PLIANT_ROS_PARAMS_START_H
#define PLIANT_ROS_PARAMS_START_H

#include "ros/params/params.h"

#include <geometry_msgs/TransformStamped.h>
#include <ros/node_handle.h>

#include <stdexcept>

namespace pliant_ros {

/* A parameter is wrong: starting again would not help. The message is for a person. */
class WrongParameter : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

/* Log lines of the library go to rosconsole; one line a second of the same text at most. */
void log_to_rosconsole();

/* Throws WrongParameter. */
Parameters parameters_of(const ros::NodeHandle &private_handle);

/* The tissue in its parent frame, now. */
geometry_msgs::TransformStamped tissue_transform(const Parameters &parameters);

} // namespace pliant_ros

#endif
