/* What a bag holds of a session, made volumes again. */
#ifndef PLIANT_ROS_RECORD_RECORDED_H
#define PLIANT_ROS_RECORD_RECORDED_H

#include "ros/sim/snapshot.h"

#include "pliant/ros/convert.h"

namespace pliant_ros {

/* The bodies of a recording so far. */
struct Bodies {
    std::shared_ptr<const pliant_body> newest; /* which the next may go on from, for speed alone */
    uint64_t last_revision = 0;                /* highest of all: no two share one */
};

/* The body of a recorded topology: that of the same scan and mesh, to the bit, or one that its cuts make of it; the newest from then on. Empty where it
   is neither; then *why names what differs and what would be right. */
std::shared_ptr<const pliant_body> body_of(const Loaded &loaded, const MeshTopology &recorded, Bodies *bodies, std::string *why);

/* Positions of a recorded state, of the body of its topology. Throws Failure when they are not one finite point a node. */
std::shared_ptr<const Snapshot> snapshot_of(std::shared_ptr<const Loaded> loaded, std::shared_ptr<const pliant_body> body,
                                            const MeshState &state);

} // namespace pliant_ros

#endif
