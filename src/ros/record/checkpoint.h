/* The file that a node goes on from which was killed: a bag with its session, the topology that its cuts have made, where its nodes
 * were and what its tools held. Whatever reads bags can look at it, pliant_bag among them. */
#ifndef PLIANT_ROS_RECORD_CHECKPOINT_H
#define PLIANT_ROS_RECORD_CHECKPOINT_H

#include "ros/sim/moment.h"
#include "ros/sim/session.h"

#include "pliant/ros/convert.h"

#include <pliant/Checkpoint.h>

namespace pliant_ros {

using pliant::Checkpoint;

struct Saved {
    Session session;
    MeshTopology topology;
    MeshState state;
    Checkpoint rest;
};

/* Of a moment; the session, what later loads keep and where the tissue lies are the caller's. surface: Nullable, the last one that was
 * asked for; kept for the next time. Throws Failure. */
void saved_message(const Moment &moment, const std::string &frame, std::shared_ptr<const pliant_surface> *surface, Saved *out);
/* In place of the file there, at once: of one that is killed meanwhile there is the one or the other, whole. Throws Failure.
 * name: namespace of the topics in it, with a slash at its end */
void write_saved(const std::string &path, const std::string &name, const Saved &saved);
/* Throws Failure: no checkpoint, or one of another version. */
Saved read_saved(const std::string &path);
/* Of the model that its session made. Throws Failure: another mesh. */
Moment moment_of(const Saved &saved, std::shared_ptr<const Loaded> loaded);

} // namespace pliant_ros

#endif
