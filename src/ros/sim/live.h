/* What may change while the simulation runs, by dynamic_reconfigure. Names, ranges and descriptions come from the
   scene's own list of options, at run time: no second list in a .cfg file can drift from it. */
#ifndef PLIANT_ROS_SIM_LIVE_H
#define PLIANT_ROS_SIM_LIVE_H

#include "ros/params/params.h"

#include <dynamic_reconfigure/Reconfigure.h>
#include <ros/node_handle.h>

#include <functional>
#include <mutex>

namespace pliant_ros {

using dynamic_reconfigure::Reconfigure;

struct LiveSettings {
    double gravity[3];            /* LPS [m/s^2] */
    double stiffness, damping;    /* of a grasp [N/m, N s/m] */
    int32_t iterations;
    double tolerance;
    double warp_rate, mesh_rate, slice_rate; /* [Hz] */
    double slice[3];              /* axial, coronal, sagittal: fraction */
};

class Live {
public:
    /* handle: private to the node. */
    Live(ros::NodeHandle handle, const Parameters &parameters);

    LiveSettings get() const;
    /* Called with what is set from now on, whenever that changes. */
    void when_changed(std::function<void(const LiveSettings &)> tell);
    /* What another scene says of these; slices stay. */
    void assign(const pliant_scene &scene);
    /* Into a scene that is to be built. */
    void apply(pliant_scene *scene) const;

private:
    bool serve(Reconfigure::Request &request, Reconfigure::Response &response);
    void publish();

    mutable std::mutex lock_;
    LiveSettings settings_;
    std::function<void(const LiveSettings &)> tell_;
    ros::Publisher descriptions_, updates_;
    ros::ServiceServer service_;
};

} // namespace pliant_ros

#endif
