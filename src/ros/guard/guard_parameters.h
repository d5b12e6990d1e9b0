/* Private parameters of force_guard. */
#ifndef PLIANT_ROS_GUARD_GUARD_PARAMETERS_H
#define PLIANT_ROS_GUARD_GUARD_PARAMETERS_H

#include "ros/guard/guard.h"

#include <XmlRpcValue.h>

#include <string>

namespace pliant_ros {

struct GuardParameters {
    std::string tool;
    GuardSettings settings;
    double rate = 200; /* [Hz] */
};

/* Read the tree of private parameters (a struct; invalid without parameters). The tree is not changed. Return false if
 * a parameter is unknown or wrong. Then `why` names the parameter and the accepted values, and `out` has the defaults
 * except settings.enabled. It is true if `haptic` is true or `haptic` itself is wrong, so that zeros are sent. */
bool read_guard_parameters(XmlRpc::XmlRpcValue tree, GuardParameters *out, std::string *why);

} // namespace pliant_ros

#endif
