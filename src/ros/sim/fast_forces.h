/* Publish wrenches at the rate of a hand controller. A separate thread answers every pose immediately, and publishes at
 * ~wrench_rate if no pose arrives. The wrenches come from the linearization of the last step (wrench_predictor.h).
 * Without
 * ~wrench_rate the thread does not exist. */
#ifndef PLIANT_ROS_SIM_FAST_FORCES_H
#define PLIANT_ROS_SIM_FAST_FORCES_H

#include "ros/sim/wrench_predictor.h"
#include "ros/sim/tools.h"

#include <ros/callback_queue.h>

#include <boost/signals2/connection.hpp>

#include <atomic>
#include <thread>

namespace pliant_ros {

class FastForces {
public:
    /* queue: callback queue of this thread, which also receives the tools' poses and jaws so that no thread of lower
     * priority locks it */
    FastForces(ros::NodeHandle handle, const Parameters &parameters, Tools *tools, ros::CallbackQueue *queue);
    ~FastForces();
    bool is_on() const { return rate_ > 0; }

    /* Set the linearization of a tool; called by the simulation after a step.
     * acts: false makes the forces decay to zero */
    void frame(size_t tool, const pliant_data &data, const ToolSample &sample, bool acts);
    /* Make the forces decay to zero until the next frame; called after a failed step. */
    void stop(size_t tool);

private:
    struct Arm {
        size_t index;
        std::string own_frame; /* frame of poses without a frame */
        pliant_tool_linear linear{}; /* used only by the simulation thread */
        InheritingMutex lock; /* guards the members below */
        WrenchPredictor between;
        PoseFilter filter;
        ToolSample sample{}; /* tool at the last step, with its most recent pose */
        Rigid tissue_from_frame;
        bool has_pose = false;
        Clock::time_point pose_at{}, frame_at{}, answered_at{};
        ros::Subscriber pose_in; /* declared last, so that it is destroyed first */
        explicit Arm(double maximum) : between(maximum) {}
    };

    void run();
    void take_pose(Arm *arm, const topic_tools::ShapeShifter &message);
    /* call with the arm locked */
    void answer(Arm *arm, const ros::Time &stamp);
    bool is_stale(const Arm &arm, Clock::time_point now) const;

    const double rate_, hold_;
    Tools *tools_;
    ros::CallbackQueue *queue_;
    std::vector<std::unique_ptr<Arm>> arms_;
    std::atomic<bool> stopping_{false}, is_networking_raised_{false};
    boost::signals2::connection networking_;
    std::thread thread_;
};

} // namespace pliant_ros

#endif
