/* Publish the topic `state`, the current activity of the node. Thread-safe. */
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

    /* Set the state of the simulation; published if it differs. */
    void set(uint8_t state, const std::string &message);

    /* Begin long work. Return false if other work runs; *message then names it. */
    bool begin(const std::string &work, std::string *message);
    void progress(double fraction, const std::string &stage);
    /* End long work.
     * message: result; the message of a failure is shown while set() has no message, until other work succeeds */
    void end(bool good, const std::string &message);
    /* Set a remark about the last loaded model, which is shown as persistently as a failure. */
    void note(const std::string &message);

    /* Set the automatically selected settings of the last loaded model. */
    void set_choice(const pliant_choice &choice);

    uint8_t state() const;

private:
    void publish();

    mutable std::mutex lock_;
    ros::Publisher publisher_;
    SimState current_;
    std::string work_, persistent_message_;
};

} // namespace pliant_ros

#endif
