/* Services of the running node. */
#ifndef PLIANT_ROS_NODE_SERVICES_H
#define PLIANT_ROS_NODE_SERVICES_H

#include "ros/node/registration.h"
#include "ros/node/work.h"
#include "ros/output/mesh_output.h"
#include "ros/record/checkpoint.h"
#include "ros/sim/simulation.h"
#include "ros/output/volume_output.h"

#include <pliant/CutLine.h>
#include <pliant/LoadScan.h>
#include <pliant/Pick.h>
#include <pliant/RecomputeHomogenization.h>
#include <pliant/SaveVolume.h>
#include <pliant/SetMaterials.h>
#include <ros/callback_queue.h>
#include <ros/spinner.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>

namespace pliant_ros {

using pliant::CutLine;
using pliant::LoadScan;
using pliant::RecomputeHomogenization;
using pliant::SaveVolume;
using pliant::SetMaterials;

/* Settings of recompute_homogenization, which later loads keep. Empty or 0: the value of the scene. */
struct Recomputed {
    std::string method;
    int32_t coarse_cells[3] = {0, 0, 0}, ratio = 0;

    void take(const RecomputeHomogenization::Request &request);
    /* Throw Failure for an unknown method. */
    void apply(pliant_scene *scene) const;
};

/* Service calls run on their own queue, in parallel with the simulation. Only one long call runs at a time; a second
 * one is refused. A call that builds a model swaps it in between two steps. If it fails or is cancelled, the state is
 * unchanged. */
class Services {
public:
    Services(ros::NodeHandle handle, const Parameters &parameters, State *state, SettingsServer *live,
             Sessions *sessions, Simulation *simulation, MeshOutput *mesh_output, VolumeOutput *volume_output,
             Registration *registration, std::shared_ptr<const tf2_ros::Buffer> frames);
    ~Services();

    /* Store the start parameters and the settings that later loads keep, for a restarted node. Thread-safe. */
    void keep(Checkpoint *out) const;

private:
    void load_first();
    std::string load_given();
    std::string restore_checkpoint(const CheckpointContents &saved);
    bool has_same_start_scene(const Checkpoint &rest) const;
    bool load_scan(LoadScan::Request &request, LoadScan::Response &response);
    bool recompute(RecomputeHomogenization::Request &request, RecomputeHomogenization::Response &response);
    bool set_materials(SetMaterials::Request &request, SetMaterials::Response &response);
    bool save_volume(SaveVolume::Request &request, SaveVolume::Response &response);
    bool save_displacement(pliant_displacement_sense sense, SaveVolume::Request &request,
                           SaveVolume::Response &response);
    bool pick(Pick::Request &request, Pick::Response &response);
    bool cut(CutLine::Request &request, CutLine::Response &response);
    bool undo_cut(std_srvs::Trigger::Request &request, std_srvs::Trigger::Response &response);
    Rigid tissue_from(const std_msgs::Header &header) const;
    bool reset(std_srvs::Trigger::Request &request, std_srvs::Trigger::Response &response);
    bool cancel(std_srvs::Trigger::Request &request, std_srvs::Trigger::Response &response);
    bool pause(std_srvs::SetBool::Request &request, std_srvs::SetBool::Response &response);

    std::string allowed(const std::string &path) const;
    /* takes_live: also take the options that may change at run time */
    void install_model(const std::shared_ptr<LoadedModel> &next, bool takes_live = false);
    void publish_loaded_model(const LoadedModel &next);
    std::shared_ptr<const LoadedModel> current() const;

    const Parameters parameters_;
    State *state_;
    Work work_;
    SettingsServer *live_;
    Sessions *sessions_;
    Simulation *simulation_;
    MeshOutput *mesh_output_;
    VolumeOutput *volume_output_;
    Registration *registration_;
    std::shared_ptr<const tf2_ros::Buffer> frames_;
    mutable std::mutex lock_; /* guards recomputed_ and materials_ */
    Recomputed recomputed_;
    Materials materials_; /* from set_materials; empty: the scene's materials */
    ros::CallbackQueue queue_;
    std::vector<ros::ServiceServer> servers_;
    std::unique_ptr<ros::AsyncSpinner> spinner_;
    std::thread first_;
};

} // namespace pliant_ros

#endif
