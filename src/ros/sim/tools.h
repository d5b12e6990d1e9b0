/* The tools as they come in from ROS, and what goes back to them. */
#ifndef PLIANT_ROS_SIM_TOOLS_H
#define PLIANT_ROS_SIM_TOOLS_H

#include "ros/params/params.h"
#include "ros/sim/pose_filter.h"
#include "ros/sim/snapshot.h"
#include "ros/sim/urgent.h"

#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/time.h>
#include <tf2_ros/buffer.h>
#include <topic_tools/shape_shifter.h>

#include <deque>
#include <memory>
#include <mutex>

namespace pliant_ros {

enum Jaw { JAW_UNKNOWN, JAW_OPEN, JAW_CLOSED };

/* [s] Unlike a difference of ros::Time, for any two stamps: those of messages are whatever the sender wrote. */
inline double seconds_between(const ros::Time &early, const ros::Time &late)
{
    int64_t whole = static_cast<int64_t>(late.sec) - early.sec, nanoseconds = static_cast<int64_t>(late.nsec) - early.nsec;
    return static_cast<double>(whole) + 1e-9 * static_cast<double>(nanoseconds);
}

/* A tool at the time of a step. */
struct ToolSample {
    bool present;
    Rigid in_tissue;             /* pose of the tip in the tissue frame */
    Jaw jaw;                     /* with hysteresis; unknown for a probe, and when no valid and fresh jaw is there */
    double angle;                /* of the jaw, the last valid one [rad]; 0 before that */
    bool blade, energy;          /* as they were switched last; off before that */
    Rigid frame_from_tissue;     /* into the frame that the pose came in */
    std::string frame;           /* of the pose; the tissue frame before the first one */
    std::string why;             /* not present, or a jaw of which nothing is known: the reason */
};

/* For diagnostics. */
struct ToolHealth {
    std::string name;
    double rate;     /* poses a second, over the time since the last call */
    double age;      /* of the newest pose [s]; infinite: none yet */
    bool present;
    std::string why; /* not present: the reason */
    bool saturated;  /* its coupling pulls with the force limit */
    bool rests;      /* its measured tip has moved by less than 0.1 mm for 0.5 s */
    double proxy_error; /* distance from the measured tip to the proxy's tip [m] */
    double jaw_error;   /* measured angle minus the proxy's [rad] */
};

class Tools {
public:
    /* queue: for poses and jaws; Nullable: the global one */
    Tools(ros::NodeHandle handle, const Parameters &parameters, std::shared_ptr<const tf2_ros::Buffer> frames, ros::CallbackQueue *queue);

    size_t size() const { return tools_.size(); }
    const std::string &name(size_t tool) const { return tools_[tool]->parameters.name; }
    const ToolParameters &parameters(size_t tool) const { return tools_[tool]->parameters; }

    /* The tool now, by the newest of its poses that has a transform into the tissue frame. Absent when the last pose is invalid, none
       has a transform, its arm says that it is not enabled and homed, or its stamp is more than tool_max_age from now; one that is there stays where it was
       for tool_hold longer. Where time stands still: when no pose has come for tool_max_pause.
       Called by the simulation only. */
    ToolSample sample(size_t tool, const ros::Time &now);
    /* True when another instrument has been put on since the last call, of this shape. Called by the simulation only. */
    bool exchanged(size_t tool, pliant_tool_shape *shape);
    /* Forget all poses and jaws: time jumped. */
    void clear();

    /* In all three of CRTK's frames, where somebody subscribes. Any thread.
       force, torque: on the tissue, about the tip, in tissue axes [N, N m] */
    void publish_force(size_t tool, const ToolSample &sample, const double force[3], const double torque[3], const ros::Time &stamp);
    /* Note the proxy after a step, for diagnostics. */
    void watch_proxy(size_t tool, const pliant_tool_state &state);
    /* Contact and markers, at most 30 a second. */
    void publish_contact(size_t tool, const pliant_model &model, const pliant_data &data, const ros::Time &now);

    /* What its blade does, where that differs from what was sent last. */
    void publish_cut(size_t tool, const pliant_data &data, uint32_t revision, const ros::Time &now);

    std::vector<ToolHealth> health(const ros::Time &now);

private:
    struct Waiting {
        ros::Time stamp;
        std::string frame;
        Rigid pose;
    };
    struct Tool {
        ToolParameters parameters;
        ros::Publisher force_out, body_force_out, spatial_force_out, contact_out, marker_out, cut_out;
        Rate contact_rate, marker_rate;

        InheritingMutex lock;
        /* written by callbacks */
        bool has_pose = false;
        ros::Time stamp;          /* of the newest */
        PoseFilter filter;
        std::deque<Waiting> waiting; /* newer than the one in use, newest last: tf may be behind them */
        bool has_jaw = false;
        ros::Time jaw_stamp;
        double jaw = 0, last_jaw = 0; /* last: that was valid */
        bool blade = false, energy = false;
        std::string idle;         /* why its arm does not work, as operating_state says; empty: it does, or says nothing */
        std::string type;         /* of the instrument, where the shape follows that */
        bool exchanged = false;
        pliant_tool_shape shape{};
        uint64_t received = 0;
        ros::SteadyTime arrived, jaw_arrived; /* of the newest pose and jaw, by a clock that goes on whatever /clock does */
        std::string refused; /* why the last pose was */
        /* written by sample */
        bool has_last = false, present = false;
        std::string untransformed; /* why the newest pose is */
        std::string why = "no pose yet";
        Jaw state = JAW_UNKNOWN;
        ros::Time last_stamp;
        Rigid last_in_tissue, last_tissue_in_frame;
        std::string last_frame;
        /* written by watch_proxy, under the lock */
        bool saturated = false;
        double proxy_error = 0, jaw_error = 0, rest_tip[3] = {0, 0, 0};
        ros::SteadyTime rests_since;
        /* written by publish_cut */
        Cut sent;
        /* written by health */
        uint64_t counted = 0;
        ros::WallTime counted_at;
        /* last: they go first, and with them the callbacks that write the above */
        ros::Subscriber pose_in, jaw_in, blade_in, energy_in, type_in, state_in;
    };

    void take_pose(Tool *tool, const topic_tools::ShapeShifter &message);
    void take_jaw(Tool *tool, const sensor_msgs::JointState &message);
    void take_type(Tool *tool, const std::string &type);
    void listen_for_blade(ros::NodeHandle handle, Tool *tool);
    void transform(Tool *tool);
    void update_jaw(Tool *tool, const ros::Time &now);
    /* held: it may be older by tool_hold */
    bool is_fresh(const ros::Time &stamp, const ros::Time &now, bool held) const;
    /* [s] that neither a message has come (the last at `arrived`) nor time gone on: no stamp grows old where /clock has stopped. 0 as long as time goes on. */
    double stood_still(const ros::SteadyTime &arrived) const;
    std::string reason(const Tool &tool, const ros::Time &now) const;

    const std::string tissue_frame_, parent_frame_;
    const double max_age_, hold_, max_pause_, jaw_close_, jaw_release_;
    /* of the last call of sample */
    ros::Time now_;
    ros::SteadyTime now_since_;
    std::shared_ptr<const tf2_ros::Buffer> frames_;
    std::vector<std::unique_ptr<Tool>> tools_;
};

} // namespace pliant_ros

#endif
