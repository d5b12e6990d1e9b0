/* Register this process again after the ROS master was restarted. A restarted master has no registrations: existing
 * connections work, but new nodes do not find this process. The class checks the master periodically. It registers
 * topics, services, and the private parameters with which the process was started. */
#ifndef PLIANT_ROS_PARAMS_ROS_MASTER_MONITOR_H
#define PLIANT_ROS_PARAMS_ROS_MASTER_MONITOR_H

#include "ros/params/problem.h"

#include <ros/node_handle.h>

#include <atomic>
#include <condition_variable>
#include <functional>
#include <thread>
#include <vector>

namespace pliant_ros {

class RosMasterMonitor {
public:
    /* Create after everything is advertised.
     * on_reregistration: Nullable; called in a separate thread after a re-registration */
    RosMasterMonitor(ros::NodeHandle private_handle, std::function<void()> on_reregistration);
    ~RosMasterMonitor();
    RosMasterMonitor(const RosMasterMonitor &) = delete;

    /* Return a message for the user; empty if the master has this process registered. */
    std::string problem() const { return problem_.get(); }
    unsigned num_reregistrations() const { return num_reregistrations_; } /* number of re-registrations */

private:
    void run();
    void check_master();
    bool register_again(); /* Return false if the master has not accepted all registrations. */

    const std::string private_name_;
    const std::function<void()> on_reregistration_;
    XmlRpc::XmlRpcValue parameters_;
    std::vector<std::string> services_;
    unsigned num_checks_ = 0;
    int master_ =
        0; /* process ID of the master that has this process registered; 0: unknown; NOT_REGISTERED: not registered */
    Problem problem_;
    std::atomic<unsigned> num_reregistrations_{0};
    std::mutex lock_;
    std::condition_variable ends_;
    bool stopping_ = false;
    std::thread thread_;
};

} // namespace pliant_ros

#endif
