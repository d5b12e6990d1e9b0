/* The topic `state`: what the node is doing. Any thread may tell it. */
#ifndef PLIANT_ROS_SIM_STATE_H
#define PLIANT_ROS_SIM_STATE_H

#include "pliant/report.h"

#include <pliant/SimState.h>
#include <ros/node_handle.h>

#include <mutex>
#include <string>

namespace pliant_ros {

using pliant::SimState;

class State {
public:
    State(ros::NodeHandle handle, const std::string &frame);

    /* What the simulation does now; published when it differs. */
    void set(uint8_t state, const std::string &message);

    /* Long work beside it: false when some runs already, and then *message says which. */
    bool begin(const std::string &work, std::string *message);
    void progress(double fraction, const std::string &stage);
    /* Message: how it ended. That of a failure stays, wherever set() has nothing to say, until some work succeeds. */
    void end(bool good, const std::string &message);
    /* Stays likewise: what else everybody should know of what was put in last. */
    void note(const std::string &message);

    /* What was chosen for the model that was put in last. */
    void chose(const pliant_choice &choice);

    uint8_t state() const;

private:
    void publish();

    mutable std::mutex lock_;
    ros::Publisher publisher_;
    SimState current_;
    std::string work_, stays_;
};

} // namespace pliant_ros

#endif
