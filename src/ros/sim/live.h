/* What may change while the simulation runs, by dynamic_reconfigure; what was set so is on the parameter server, too, under the options' names. Names, ranges and descriptions come from the
   scene's own list of options, at run time: no second list in a .cfg file can drift from it. */
#ifndef PLIANT_ROS_SIM_LIVE_H
#define PLIANT_ROS_SIM_LIVE_H

#include "ros/params/params.h"

#include <dynamic_reconfigure/Reconfigure.h>
#include <ros/node_handle.h>

#include <condition_variable>
#include <functional>
#include <mutex>
#include <set>
#include <thread>

namespace pliant_ros {

using dynamic_reconfigure::Reconfigure;

struct LiveSettings {
    double gravity[3];            /* LPS [m/s^2] */
    double stiffness, damping;    /* of a grasp [N/m, N s/m] */
    int32_t iterations;
    double tolerance;
    double warp_rate, mesh_rate, slice_rate; /* [Hz] */
    double slice[3];              /* axial, coronal, sagittal: fraction */
    pliant_scalar scalar;         /* on mesh/state */
};

class Live {
public:
    /* handle: private to the node. */
    Live(ros::NodeHandle handle, const Parameters &parameters);
    ~Live();
    Live(const Live &) = delete;

    LiveSettings get() const;
    /* Called with what is set from now on, whenever that changes. */
    void when_changed(std::function<void(const LiveSettings &)> tell);
    /* What another scene says of these; slices stay. */
    void assign(const pliant_scene &scene);
    /* After one that was started with one scene, and had the other's settings in the end: those hold, but what was told otherwise since. */
    void go_on(const pliant_scene &start, const pliant_scene &last);
    /* On the parameter server once more: it may be another one. */
    void store_again();
    /* Into a scene that is to be built. */
    void apply(pliant_scene *scene) const;

private:
    bool serve(Reconfigure::Request &request, Reconfigure::Response &response);
    void publish();
    void keep_stored();

    const std::string name_;
    mutable std::mutex lock_;
    LiveSettings settings_;
    std::set<std::string> set_; /* options that somebody has set while it runs: those are on the parameter server */
    std::function<void(const LiveSettings &)> tell_;
    ros::Publisher descriptions_, updates_;
    ros::ServiceServer service_;
    /* a master that does not answer holds up nobody else */
    std::condition_variable changed_;
    bool unstored_ = true, stopping_ = false;
    std::thread storer_;
};

} // namespace pliant_ros

#endif
