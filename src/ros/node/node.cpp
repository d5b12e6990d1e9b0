#include "pliant/ros/node.h"

#include "ros/node/diagnostics.h"
#include "ros/node/checkpoint_writer.h"
#include "ros/node/registration.h"
#include "ros/node/services.h"
#include "ros/params/ros_master_monitor.h"
#include "ros/params/start.h"
#include "ros/output/camera_output.h"
#include "ros/output/volume_output.h"

#include <tf2_ros/transform_listener.h>

namespace pliant_ros {

/* Members are declared in the order of their dependencies and destroyed in reverse order. */
struct Node::Parts {
    Parts(ros::NodeHandle handle, ros::NodeHandle private_handle)
        : parameters(parameters_of(private_handle)), frames(std::make_shared<tf2_ros::Buffer>()), listener(*frames),
          registration(handle, parameters, frames), state(handle, parameters.tissue_frame),
          sessions(handle, parameters.tissue_frame), live(private_handle, parameters),
          tools(handle, parameters, frames, parameters.wrench_rate > 0 ? &hands : nullptr),
          fast_forces(handle, parameters, &tools, &hands), mesh_output(handle, parameters, &live, &snapshots),
          volume_output(handle, parameters, &live, &snapshots, &mesh_output),
          camera_output(handle, parameters, &snapshots, frames), displacement_output(handle, parameters, &snapshots),
          simulation(handle, parameters, &state, &live, &tools, &fast_forces, &snapshots),
          services(handle, parameters, &state, &live, &sessions, &simulation, &mesh_output, &volume_output,
                   &registration, frames),
          checkpoint_writer(handle, parameters, &simulation, &sessions, &services, &registration),
          master(private_handle, [this] { live.store_all_settings(); }),
          diagnostics(handle, private_handle, &state, &simulation, &tools, &mesh_output, &volume_output, &camera_output,
                      &displacement_output, &checkpoint_writer, &master)
    {
        live.set_change_callback([this](const RuntimeSettings &settings) { sessions.set(settings); });
    }

    const Parameters parameters;
    Snapshots snapshots;
    std::shared_ptr<tf2_ros::Buffer> frames;
    tf2_ros::TransformListener listener;
    Registration registration;
    State state;
    Sessions sessions;
    SettingsServer live;
    ros::CallbackQueue hands;
    Tools tools;
    FastForces fast_forces;
    MeshOutput mesh_output;
    VolumeOutput volume_output;
    CameraOutput camera_output;
    DisplacementOutput displacement_output;
    Simulation simulation;
    Services services;
    CheckpointWriter checkpoint_writer;
    RosMasterMonitor master;
    Diagnostics diagnostics;
};

Node::Node(ros::NodeHandle handle, ros::NodeHandle private_handle)
{
    log_to_rosconsole();
    parts_.reset(new Parts(handle, private_handle));
}

Node::~Node() = default;

} // namespace pliant_ros
