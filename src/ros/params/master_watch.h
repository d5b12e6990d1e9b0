/* Register this process again after the ROS master was restarted. A restarted master has no registrations: existing
 * connections work, but new nodes do not find this process. The class checks the master periodically. It registers
 * topics, services, and the private parameters with which the process was started. */
#ifndef PLIANT_ROS_PARAMS_MASTER_WATCH_H
#define PLIANT_ROS_PARAMS_MASTER_WATCH_H

#include "ros/params/problem.h"

#include <ros/node_handle.h>

#include <atomic>
#include <condition_variable>
#include <functional>
#include <thread>
#include <vector>

namespace pliant_ros {

class MasterWatch {
public:
    /* Create after everything is advertised.
     * came_back: Nullable; called in a separate thread after a re-registration */
    MasterWatch(ros::NodeHandle private_handle, std::function<void()> came_back);
    ~MasterWatch();
    MasterWatch(const MasterWatch &) = delete;

    /* Return a message for the user; empty if the master has this process registered. */
    std::string problem() const { return problem_.get(); }
    unsigned returns() const { return returns_; } /* number of re-registrations */

private:
    void run();
    void look();
    bool register_again(); /* Return false if the master has not accepted all registrations. */

    const std::string private_name_;
    const std::function<void()> came_back_;
    XmlRpc::XmlRpcValue parameters_;
    std::vector<std::string> services_;
    unsigned looks_ = 0;
    int master_ = 0; /* process ID of the master that has this process registered; 0: unknown; NOBODY: not registered */
    Problem problem_;
    std::atomic<unsigned> returns_{0};
    std::mutex lock_;
    std::condition_variable ends_;
    bool stopping_ = false;
    std::thread thread_;
};

} // namespace pliant_ros

#endif
