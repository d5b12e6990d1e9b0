/* Publish /diagnostics once per second: the solver, each tool, the backend, and the published topics. */
#ifndef PLIANT_ROS_NODE_DIAGNOSTICS_H
#define PLIANT_ROS_NODE_DIAGNOSTICS_H

#include "ros/node/checkpoint_writer.h"
#include "ros/sim/simulation.h"
#include "ros/output/camera_output.h"
#include "ros/output/displacement_output.h"
#include "ros/output/volume_output.h"
#include "ros/params/ros_master_monitor.h"

#include <diagnostic_updater/diagnostic_updater.h>

namespace pliant_ros {

class Diagnostics {
public:
    Diagnostics(ros::NodeHandle handle, ros::NodeHandle private_handle, State *state, Simulation *simulation,
                Tools *tools, const MeshOutput *mesh_output, const VolumeOutput *volume_output,
                const CameraOutput *camera_output, const DisplacementOutput *displacement_output,
                const CheckpointWriter *checkpoint_writer, const RosMasterMonitor *master);

private:
    void update();
    void solver(diagnostic_updater::DiagnosticStatusWrapper &status);
    void tool(size_t index, diagnostic_updater::DiagnosticStatusWrapper &status);
    void backend(diagnostic_updater::DiagnosticStatusWrapper &status);

    void master(diagnostic_updater::DiagnosticStatusWrapper &status);
    void output(diagnostic_updater::DiagnosticStatusWrapper &status);

    State *state_;
    Simulation *simulation_;
    Tools *tools_;
    const MeshOutput *mesh_output_;
    const VolumeOutput *volume_output_;
    const CameraOutput *camera_output_;
    const DisplacementOutput *displacement_output_;
    const CheckpointWriter *checkpoint_writer_;
    const RosMasterMonitor *master_;
    diagnostic_updater::Updater updater_;
    std::vector<ToolHealth> tool_health_;
    uint64_t missed_before_ = 0, slow_before_ = 0, ended_before_ = 0;
    ros::WallTimer timer_;
};

} // namespace pliant_ros

#endif
