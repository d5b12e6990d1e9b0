/* Publish the mesh: scan_info when a scan is loaded, the topology when it changes, and states and rviz markers while
 * there are subscribers. */
#ifndef PLIANT_ROS_OUTPUT_MESH_OUTPUT_H
#define PLIANT_ROS_OUTPUT_MESH_OUTPUT_H

#include "ros/sim/settings_server.h"
#include "ros/params/problem.h"
#include "ros/sim/snapshot.h"

#include <ros/node_handle.h>

#include <atomic>
#include <mutex>
#include <thread>

namespace pliant_ros {

class MeshOutput {
public:
    MeshOutput(ros::NodeHandle handle, const Parameters &parameters, SettingsServer *live, Snapshots *snapshots);
    ~MeshOutput();

    /* Publish scan_info and mesh/topology (both latched) of a newly loaded model. */
    void publish_model(const LoadedModel &loaded);
    /* Publish the state of this step regardless of the rate, because the volume of this step is about to be published.
     * A recorder needs the state to reproduce that volume. Call once per step. Thread-safe. Return false if the state
     * of a later step is already published. The caller then publishes the volume of the later step, so that recorded
     * states stay in order. */
    bool publish_state(const Snapshot &snapshot);
    std::string problem() const { return problem_.get(); }

private:
    void run();
    bool is_wanted() const;
    void publish(const Snapshot &snapshot);
    bool is_published(const Snapshot &snapshot) const;
    bool is_late(const Snapshot &snapshot) const;
    void publish_topology(const LoadedModel &loaded, const pliant_body &body, uint32_t revision,
                          const ros::Time &stamp);
    /* Publish the topology of this snapshot if subscribers do not have it; call before its state is published. */
    void follow_topology(const Snapshot &snapshot);
    void send_state(const Snapshot &snapshot, const boost::shared_ptr<MeshState> &state);
    boost::shared_ptr<MeshState> state_of(const Snapshot &snapshot) const;
    std_msgs::Header header(const ros::Time &stamp) const;

    const std::string frame_;
    SettingsServer *live_;
    Snapshots *snapshots_;
    ros::Publisher scan_info_, topology_, state_, marker_, points_;
    std::mutex lock_;                    /* guards states and topology */
    const LoadedModel *shown_ = nullptr; /* model and revision of the latched topology */
    uint32_t topology_revision_ = 0;
    std::shared_ptr<const pliant_surface> surface_; /* most recent requested surface */
    const LoadedModel *state_loaded_ = nullptr;     /* model of the last published state */
    ros::Time state_stamp_;
    uint64_t state_step_ = 0;
    Rate state_rate_, topology_rate_, marker_rate_, points_rate_;
    std::atomic<bool> stopping_{false};
    Problem problem_;
    std::thread thread_;
};

} // namespace pliant_ros

#endif
