/* What bags hold from before the point that a player begins at. */
#ifndef PLIANT_ROS_RECORD_EARLIER_H
#define PLIANT_ROS_RECORD_EARLIER_H

#include <pliant/MeshTopology.h>
#include <pliant/Session.h>
#include <pliant/Step.h>

#include <functional>
#include <string>
#include <vector>

namespace pliant_ros {

struct Topics {
    std::string session, topology, step; /* step: empty where none are made again */
};

struct Earlier {
    pliant::SessionConstPtr session; /* the last one; empty: none */
    std::vector<pliant::MeshTopologyConstPtr> topologies; /* those that states and steps from then on can need: of its load, and the last two */
    std::vector<pliant::StepConstPtr> steps; /* from the last load or reset on */
};

/* start: [s] after the first message of the bags, as `rosbag play --start` takes it. goes_on: asked between messages; false: what has been read
   until then. Throws std::runtime_error with a message for a person where a bag cannot be read or is of another version of the messages. */
Earlier read_earlier(const std::vector<std::string> &bags, double start, const Topics &topics, const std::function<bool()> &goes_on);

/* Throw a Failure if a player of these bags would publish steps of another version, to which no node of this version connects. */
void check_steps(const std::vector<std::string> &bags, const std::string &topic);

/* The first session in the bags; empty: they have none. Throws as above. */
pliant::SessionConstPtr first_session(const std::vector<std::string> &bags, const std::string &topic);

} // namespace pliant_ros

#endif
