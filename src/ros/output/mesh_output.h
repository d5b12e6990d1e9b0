/* The mesh as messages: scan_info on load, topology on load and where the body changes, states and stock-rviz views while somebody
   subscribes. */
#ifndef PLIANT_ROS_OUTPUT_MESH_OUTPUT_H
#define PLIANT_ROS_OUTPUT_MESH_OUTPUT_H

#include "ros/sim/live.h"
#include "ros/params/problem.h"
#include "ros/sim/snapshot.h"

#include <ros/node_handle.h>

#include <atomic>
#include <mutex>
#include <thread>

namespace pliant_ros {

class MeshOutput {
public:
    MeshOutput(ros::NodeHandle handle, const Parameters &parameters, Live *live, Snapshots *snapshots);
    ~MeshOutput();

    /* Latched: scan_info and mesh/topology of a model that was just put in. */
    void publish_model(const Loaded &loaded);
    /* The state of this very step, whatever its rate: its volume is about to be shown, and whoever records states must
       be able to make the same one. Once a step; any thread. false: the state of a later step is sent already, and who
       records them wants them in order: that one is to be shown */
    bool publish_state(const Snapshot &snapshot);
    std::string problem() const { return problem_.get(); }

private:
    void run();
    bool is_wanted() const;
    void publish(const Snapshot &snapshot);
    bool is_published(const Snapshot &snapshot) const;
    bool is_late(const Snapshot &snapshot) const;
    void publish_topology(const Loaded &loaded, const pliant_body &body, uint32_t revision, const ros::Time &stamp);
    /* of this snapshot, unless it is there; before its state */
    void follow_topology(const Snapshot &snapshot);
    void send_state(const Snapshot &snapshot, const boost::shared_ptr<MeshState> &state);
    boost::shared_ptr<MeshState> state_of(const Snapshot &snapshot) const;
    std_msgs::Header header(const ros::Time &stamp) const;

    const std::string frame_;
    Live *live_;
    Snapshots *snapshots_;
    ros::Publisher scan_info_, topology_, state_, marker_, points_;
    std::mutex lock_; /* of the states and the topology */
    const Loaded *shown_ = nullptr; /* that the latched topology is of, and its revision there */
    uint32_t topology_revision_ = 0;
    std::shared_ptr<const pliant_surface> surface_; /* the newest that was asked for */
    const Loaded *state_loaded_ = nullptr; /* of the last state that was sent */
    ros::Time state_stamp_;
    uint64_t state_step_ = 0;
    Rate state_rate_, topology_rate_, marker_rate_, points_rate_;
    std::atomic<bool> stopping_{false};
    Problem problem_;
    std::thread thread_;
};

} // namespace pliant_ros

#endif
