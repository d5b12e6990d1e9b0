/* What can be asked of the running node. */
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

/* What recompute_homogenization has set so far: a load keeps it. Empty and 0: as the scene says. */
struct Recomputed {
    std::string method;
    int32_t coarse_cells[3] = {0, 0, 0}, ratio = 0;

    void take(const RecomputeHomogenization::Request &request);
    /* Throws Failure for an unknown method. */
    void apply(pliant_scene *scene) const;
};

/* Calls run on a queue of their own, beside the simulation. Of those that take long one runs at a time; a second one is refused. The one
   that builds a model swaps it in at a step boundary, or fails or is cancelled, and leaves everything as it was. */
class Services {
public:
    Services(ros::NodeHandle handle, const Parameters &parameters, State *state, Live *live, Sessions *sessions, Simulation *simulation,
             MeshOutput *mesh_output, VolumeOutput *volume_output, Registration *registration, std::shared_ptr<const tf2_ros::Buffer> frames);
    ~Services();

    /* What a node that goes on after this one needs to know: how it was started, what later loads keep. Any thread may ask. */
    void keep(Checkpoint *out) const;

private:
    void load_first();
    std::string load_given();
    std::string go_on(const Saved &saved);
    bool is_begun_alike(const Checkpoint &rest) const;
    bool load_scan(LoadScan::Request &request, LoadScan::Response &response);
    bool recompute(RecomputeHomogenization::Request &request, RecomputeHomogenization::Response &response);
    bool set_materials(SetMaterials::Request &request, SetMaterials::Response &response);
    bool save_volume(SaveVolume::Request &request, SaveVolume::Response &response);
    bool save_displacement(pliant_displacement_sense sense, SaveVolume::Request &request, SaveVolume::Response &response);
    bool pick(Pick::Request &request, Pick::Response &response);
    bool cut(CutLine::Request &request, CutLine::Response &response);
    bool undo_cut(std_srvs::Trigger::Request &request, std_srvs::Trigger::Response &response);
    Rigid tissue_from(const std_msgs::Header &header) const;
    bool reset(std_srvs::Trigger::Request &request, std_srvs::Trigger::Response &response);
    bool cancel(std_srvs::Trigger::Request &request, std_srvs::Trigger::Response &response);
    bool pause(std_srvs::SetBool::Request &request, std_srvs::SetBool::Response &response);

    std::string allowed(const std::string &path) const;
    void put_in(const std::shared_ptr<Loaded> &next, bool takes_live = false); /* the options that may change while running, too */
    void tell_of(const Loaded &next);
    std::shared_ptr<const Loaded> current() const;

    const Parameters parameters_;
    State *state_;
    Work work_;
    Live *live_;
    Sessions *sessions_;
    Simulation *simulation_;
    MeshOutput *mesh_output_;
    VolumeOutput *volume_output_;
    Registration *registration_;
    std::shared_ptr<const tf2_ros::Buffer> frames_;
    mutable std::mutex lock_; /* of the next two, where they change or another thread reads them */
    Recomputed recomputed_;
    Materials materials_; /* as set_materials set them; empty: as the scene says */
    ros::CallbackQueue queue_;
    std::vector<ros::ServiceServer> servers_;
    std::unique_ptr<ros::AsyncSpinner> spinner_;
    std::thread first_;
};

} // namespace pliant_ros

#endif
