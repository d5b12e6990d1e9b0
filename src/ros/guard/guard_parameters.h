/* What force_guard is told by its private parameters. */
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

/* From the tree of private parameters (a struct, or invalid for none). False where one is unknown or wrong: `why` names it and what would be
   right, and `out` has the defaults, but for settings.enabled, by which zeros still go out: it is
   true where `haptic` itself is wrong. The tree is not changed. */
bool read_guard_parameters(XmlRpc::XmlRpcValue tree, GuardParameters *out, std::string *why);

} // namespace pliant_ros

#endif
