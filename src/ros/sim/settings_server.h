/* Settings that may change while the simulation runs, through dynamic_reconfigure. Changed settings are also stored on
 * the parameter server under the options' names. Names, ranges and descriptions come from the scene's list of options
 * at run time, so no .cfg file can contradict them. */
#ifndef PLIANT_ROS_SIM_SETTINGS_SERVER_H
#define PLIANT_ROS_SIM_SETTINGS_SERVER_H

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

struct RuntimeSettings {
    double gravity[3];            /* LPS [m/s^2] */
    double stiffness, damping;    /* of a grasp constraint [N/m, N s/m] */
    int32_t iterations;
    double tolerance;
    double warp_rate, mesh_rate, slice_rate; /* [Hz] */
    double slice[3];              /* axial, coronal, sagittal: fraction of the volume's box */
    pliant_scalar scalar;         /* scalar field on mesh/state */
};

class SettingsServer {
public:
    /* handle: private to the node */
    SettingsServer(ros::NodeHandle handle, const Parameters &parameters);
    ~SettingsServer();
    SettingsServer(const SettingsServer &) = delete;

    RuntimeSettings get() const;
    /* Call a function with the new settings after each change. */
    void set_change_callback(std::function<void(const RuntimeSettings &)> print_summary);
    /* Set the settings from another scene; slice positions stay. */
    void assign(const pliant_scene &scene);
    /* Restore the settings of an earlier process, which was started with the scene `start` and ended with `last`.
     * Settings changed in this process stay. */
    void restore_settings(const pliant_scene &start, const pliant_scene &last);
    /* Store all changed settings again on a restarted parameter server. */
    void store_all_settings();
    /* Copy the settings to a scene before a model is built. */
    void apply(pliant_scene *scene) const;

private:
    bool serve(Reconfigure::Request &request, Reconfigure::Response &response);
    void publish();
    void store_settings();

    const std::string name_;
    mutable std::mutex lock_;
    RuntimeSettings settings_;
    std::set<std::string> set_; /* options changed at run time, which are stored on the parameter server */
    std::function<void(const RuntimeSettings &)> change_callback_;
    ros::Publisher descriptions_, updates_;
    ros::ServiceServer service_;
    /* a separate thread stores parameters, so that an unresponsive master blocks no other thread */
    std::condition_variable changed_;
    bool has_unstored_settings_ = true, stopping_ = false;
    std::thread storer_;
};

} // namespace pliant_ros

#endif
