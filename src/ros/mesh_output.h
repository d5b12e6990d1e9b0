/* The mesh as messages: topology and scan_info on load, states and stock-rviz views while somebody subscribes. */
#ifndef PLIANT_ROS_MESH_OUTPUT_H
#define PLIANT_ROS_MESH_OUTPUT_H

#include "live.h"
#include "snapshot.h"

#include <ros/node_handle.h>

#include <atomic>
#include <thread>

namespace pliant_ros {

class MeshOutput {
public:
    MeshOutput(ros::NodeHandle handle, const Parameters &parameters, Live *live, Snapshots *snapshots);
    ~MeshOutput();

    /* Latched: scan_info and mesh/topology of a model that was just put in. */
    void publish_model(const Loaded &loaded);

private:
    void run();
    bool is_wanted() const;
    void publish(const Snapshot &snapshot);
    std_msgs::Header header(const ros::Time &stamp) const;

    const std::string frame_;
    Live *live_;
    Snapshots *snapshots_;
    ros::Publisher scan_info_, topology_, state_, marker_, points_;
    Rate state_rate_, marker_rate_, points_rate_;
    std::atomic<bool> stopping_{false};
    std::thread thread_;
};

} // namespace pliant_ros

#endif
