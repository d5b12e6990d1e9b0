/* Read the messages of bags before the time at which a player starts. */
#ifndef PLIANT_ROS_RECORD_PRECEDING_MESSAGES_H
#define PLIANT_ROS_RECORD_PRECEDING_MESSAGES_H

#include <pliant/MeshTopology.h>
#include <pliant/Session.h>
#include <pliant/Step.h>

#include <functional>
#include <string>
#include <vector>

namespace pliant_ros {

struct Topics {
    std::string session, topology, step; /* topic names; step is empty if no steps are recomputed */
};

struct PrecedingMessages {
    pliant::SessionConstPtr session; /* last session; empty: none */
    /* topologies that later states and steps can refer to: the initial one of the load and the last two */
    std::vector<pliant::MeshTopologyConstPtr> topologies;
    std::vector<pliant::StepConstPtr> steps; /* all steps since the last load or reset */
};

/* Read the messages before `start`.
 * start: seconds after the first message of the bags, as for `rosbag play --start`
 * may_continue: called between messages; return false to stop reading, which returns the messages read so far
 * Throws std::runtime_error with a message for the user if a bag cannot be read or has another version of the
 * messages. */
PrecedingMessages read_messages_before(const std::vector<std::string> &bags, double start, const Topics &topics,
                                       const std::function<bool()> &may_continue);

/* Throw Failure if these bags contain steps of another message version, because no node of this version could subscribe
 * to them. */
void check_steps(const std::vector<std::string> &bags, const std::string &topic);

/* Return the first session in the bags; empty without a session. Throws as read_messages_before. */
pliant::SessionConstPtr first_session(const std::vector<std::string> &bags, const std::string &topic);

} // namespace pliant_ros

#endif
