/* How far a homogenized model is from the fine one under a trial load. */
#ifndef PLIANT_ROS_PROBE_H
#define PLIANT_ROS_PROBE_H

#include "loaded.h"

namespace pliant_ros {

struct ProbeError {
    double max, rms; /* over all fine nodes, fraction of the largest displacement of the fine solution */
};

/* The free node farthest from everything fixed is pulled outwards by 2 cm, rigidly, in the model and in a fine one of
   the same mesh, each stepped until it converges. Throws Failure: nothing is free, no convergence, cancelled. */
ProbeError probe(const Loaded &loaded, pliant_progress progress);

} // namespace pliant_ros

#endif
