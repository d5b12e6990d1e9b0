/* The topic displacement: tissue displacements on a coarse grid, published while there are subscribers. */
#ifndef PLIANT_ROS_OUTPUT_DISPLACEMENT_OUTPUT_H
#define PLIANT_ROS_OUTPUT_DISPLACEMENT_OUTPUT_H

#include "ros/params/params.h"
#include "ros/params/problem.h"
#include "ros/sim/snapshot.h"

#include <ros/node_handle.h>

#include <atomic>
#include <thread>

namespace pliant_ros {

class DisplacementOutput {
public:
    DisplacementOutput(ros::NodeHandle handle, const Parameters &parameters, Snapshots *snapshots);
    ~DisplacementOutput();
    std::string problem() const { return problem_.get(); }

private:
    void run();
    void publish(const Snapshot &snapshot);

    const std::string frame_;
    Snapshots *snapshots_;
    ros::Publisher publisher_;
    Rate rate_;
    std::atomic<bool> stopping_{false};
    Problem problem_;
    std::thread thread_;
};

} // namespace pliant_ros

#endif
