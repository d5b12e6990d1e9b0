/* Wrenches at the rate of a hand controller: a thread of its own that answers every pose as it comes, and at ~wrench_rate where none comes,
 * from the linearization of the last step (between.h). Not there unless ~wrench_rate is set. */
#ifndef PLIANT_ROS_SIM_FAST_FORCES_H
#define PLIANT_ROS_SIM_FAST_FORCES_H

#include "ros/sim/between.h"
#include "ros/sim/tools.h"

#include <ros/callback_queue.h>

#include <boost/signals2/connection.hpp>

#include <atomic>
#include <thread>

namespace pliant_ros {

class FastForces {
public:
    /* queue: what the thread works off; the tools' poses and jaws come there, too, so that no ordinary thread holds it */
    FastForces(ros::NodeHandle handle, const Parameters &parameters, Tools *tools, ros::CallbackQueue *queue);
    ~FastForces();
    bool is_on() const { return rate_ > 0; }

    /* After a step, by the simulation. acts false: forces are zero. */
    void frame(size_t tool, const pliant_data &data, const ToolSample &sample, bool acts);
    /* After one that broke off: forces fall to zero, until frame says otherwise. */
    void stop(size_t tool);

private:
    struct Arm {
        size_t index;
        std::string own_frame; /* of poses that name none */
        pliant_tool_linear linear{}; /* the simulation's own */
        InheritingMutex lock; /* of what follows */
        Between between;
        PoseFilter filter;
        ToolSample sample{}; /* of the last step, at the last pose */
        Rigid tissue_from_frame;
        bool has_pose = false;
        Clock::time_point pose_at{}, frame_at{}, answered_at{};
        ros::Subscriber pose_in; /* last: it goes first */
        explicit Arm(double most) : between(most) {}
    };

    void run();
    void take_pose(Arm *arm, const topic_tools::ShapeShifter &message);
    /* locked */
    void answer(Arm *arm, const ros::Time &stamp);
    bool is_stale(const Arm &arm, Clock::time_point now) const;

    const double rate_, hold_;
    Tools *tools_;
    ros::CallbackQueue *queue_;
    std::vector<std::unique_ptr<Arm>> arms_;
    std::atomic<bool> stopping_{false}, networking_raised_{false};
    boost::signals2::connection networking_;
    std::thread thread_;
};

} // namespace pliant_ros

#endif
