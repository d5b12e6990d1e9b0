/* Checkpoint file from which a restarted node restores the simulation. It is a bag with the session, the mesh topology
 * including cuts, the node positions, and the state of the tools. Programs that read bags, such as pliant_bag, can read
 * it. */
#ifndef PLIANT_ROS_RECORD_CHECKPOINT_H
#define PLIANT_ROS_RECORD_CHECKPOINT_H

#include "ros/sim/resumable_state.h"
#include "ros/sim/session.h"

#include "pliant/ros/convert.h"

#include <pliant/Checkpoint.h>

namespace pliant_ros {

using pliant::Checkpoint;

struct CheckpointContents {
    Session session;
    MeshTopology topology;
    MeshState state;
    Checkpoint rest;
};

/* Fill *out from a moment, except the session, the settings that later loads keep, and the tissue pose, which the
 * caller sets.
 * surface: input and output; last computed surface, which is reused
 * Throws Failure. */
void make_checkpoint_contents(const ResumableState &moment, const std::string &frame,
                              std::shared_ptr<const pliant_surface> *surface, CheckpointContents *out);
/* Replace the file atomically: if the process is killed, either the old or the new file exists completely.
 * name: namespace of the topics in the file, with a trailing slash
 * Throws Failure. */
void write_checkpoint_file(const std::string &path, const std::string &name, const CheckpointContents &saved);
/* Throws Failure if the file is no checkpoint or has another version. */
CheckpointContents read_checkpoint_file(const std::string &path);
/* Return the moment for the model that was built from the saved session. Throws Failure if the mesh differs. */
ResumableState resumable_state_of(const CheckpointContents &saved, std::shared_ptr<const LoadedModel> loaded);

} // namespace pliant_ros

#endif
