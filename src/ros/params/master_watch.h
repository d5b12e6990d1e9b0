/* A master that is started anew knows nobody: links that were made go on, but whoever comes then does not find this process. This looks
 * for that, and makes it known again: its topics, its services and the private parameters that it was started with. */
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
    /* To be made once everything is advertised. came_back: Nullable; called by a thread of its own. */
    MasterWatch(ros::NodeHandle private_handle, std::function<void()> came_back);
    ~MasterWatch();
    MasterWatch(const MasterWatch &) = delete;

    /* For a person; empty: the master knows this process. */
    std::string problem() const { return problem_.get(); }
    unsigned returns() const { return returns_; } /* so often it was made known again */

private:
    void run();
    void look();
    bool register_again(); /* false: the master has not taken all of it */

    const std::string private_name_;
    const std::function<void()> came_back_;
    XmlRpc::XmlRpcValue parameters_;
    std::vector<std::string> services_;
    unsigned looks_ = 0;
    int master_ = 0; /* process of the one that knows this one; 0: not known yet, NOBODY: the one that answers does not */
    Problem problem_;
    std::atomic<unsigned> returns_{0};
    std::mutex lock_;
    std::condition_variable ends_;
    bool stopping_ = false;
    std::thread thread_;
};

} // namespace pliant_ros

#endif
