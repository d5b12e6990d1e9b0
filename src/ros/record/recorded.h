/* What a bag holds of a session, made volumes again. */
#ifndef PLIANT_ROS_RECORD_RECORDED_H
#define PLIANT_ROS_RECORD_RECORDED_H

#include "ros/sim/snapshot.h"

#include "pliant/ros/convert.h"

namespace pliant_ros {

/* The same scan and mesh, to the bit? If not, *why names what differs and what would be right. */
bool is_same(const Loaded &loaded, const MeshTopology &recorded, std::string *why);

/* Positions of a recorded state. Throws Failure when they are not one finite point a node. */
std::shared_ptr<const Snapshot> snapshot_of(std::shared_ptr<const Loaded> loaded, const MeshState &state);

} // namespace pliant_ros

#endif
