/* Restore bodies and states from recorded messages. */
#ifndef PLIANT_ROS_RECORD_RECORDED_H
#define PLIANT_ROS_RECORD_RECORDED_H

#include "ros/sim/snapshot.h"

#include "pliant/ros/convert.h"

namespace pliant_ros {

/* Bodies restored from a recording. */
struct Bodies {
    std::shared_ptr<const pliant_body> newest; /* most recent body, from which the next may be derived faster */
    uint64_t last_revision = 0;                /* highest revision; each body has a unique one */
};

/* Return the body of a recorded topology. It is derived from the loaded model's body by the recorded cuts, and becomes
 * bodies->newest. Return empty if the mesh is not bitwise identical; then *why names the difference and the remedy. */
std::shared_ptr<const pliant_body> body_of(const LoadedModel &loaded, const MeshTopology &recorded, Bodies *bodies,
                                           std::string *why);

/* Return the positions of a recorded state as a snapshot. Throws Failure if there is not one finite point per node. */
std::shared_ptr<const Snapshot> snapshot_of(std::shared_ptr<const LoadedModel> loaded,
                                            std::shared_ptr<const pliant_body> body, const MeshState &state);

} // namespace pliant_ros

#endif
