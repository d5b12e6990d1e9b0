/* Receive tool poses and jaws from ROS, and publish forces and contacts. */
#ifndef PLIANT_ROS_SIM_TOOLS_H
#define PLIANT_ROS_SIM_TOOLS_H

#include "ros/params/params.h"
#include "ros/sim/pose_filter.h"
#include "ros/sim/snapshot.h"
#include "ros/sim/realtime_priority.h"

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

/* Return the difference [s] of any two stamps. ros::Time arithmetic throws for arbitrary stamps in messages. */
inline double seconds_between(const ros::Time &early, const ros::Time &late)
{
    int64_t whole = static_cast<int64_t>(late.sec) - early.sec,
            nanoseconds = static_cast<int64_t>(late.nsec) - early.nsec;
    return static_cast<double>(whole) + 1e-9 * static_cast<double>(nanoseconds);
}

/* Input from one tool at the time of a step. */
struct ToolSample {
    bool present;
    Rigid in_tissue;             /* pose of the tip in the tissue frame */
    Jaw jaw;                     /* with hysteresis; unknown for a probe, and without a valid and recent jaw message */
    double angle;                /* last valid jaw angle [rad]; initially 0 */
    bool blade, energy;          /* last received switches; initially off */
    Rigid frame_from_tissue;     /* transform to the frame of the pose message */
    std::string frame;           /* frame of the pose message; the tissue frame before the first message */
    std::string why;             /* reason why the tool is absent or its jaw unknown */
};

/* Statistics for diagnostics. */
struct ToolHealth {
    std::string name;
    double rate;     /* rate of poses since the last call [Hz] */
    double age;      /* age of the last pose [s]; infinite: none yet */
    bool present;
    std::string why; /* reason if not present */
    bool saturated;  /* the coupling force is at its limit */
    bool rests;      /* the measured tip has moved by less than 0.1 mm in 0.5 s */
    double proxy_error; /* distance from the measured tip to the proxy's tip [m] */
    double jaw_error;   /* measured angle minus the proxy's [rad] */
};

class Tools {
public:
    /* queue: callback queue for poses and jaws; Nullable: the global queue */
    Tools(ros::NodeHandle handle, const Parameters &parameters, std::shared_ptr<const tf2_ros::Buffer> frames,
          ros::CallbackQueue *queue);

    size_t size() const { return tools_.size(); }
    const std::string &name(size_t tool) const { return tools_[tool]->parameters.name; }
    const ToolParameters &parameters(size_t tool) const { return tools_[tool]->parameters; }

    /* Return the tool at its most recent pose with a transform to the tissue frame. The tool is absent if its last pose
     * is invalid, if no pose has a transform, or if its arm is not enabled and homed. It is also absent if its stamp
     * differs from now by more than tool_max_age. A present tool keeps its pose for tool_hold longer. If /clock stands
     * still, the tool becomes absent after tool_max_pause without a pose. Called only by the simulation. */
    ToolSample sample(size_t tool, const ros::Time &now);
    /* Return true and the shape if another instrument was attached since the last call. Called only by the
     * simulation. */
    bool take_exchanged_shape(size_t tool, pliant_tool_shape *shape);
    /* Discard all poses and jaws after a time jump. */
    void clear();

    /* Publish a wrench in the three frames that CRTK defines, if there are subscribers. Thread-safe.
     * force, torque: of the tool on the tissue, about the tip, in tissue axes [N, N m] */
    void publish_force(size_t tool, const ToolSample &sample, const double force[3], const double torque[3],
                       const ros::Time &stamp);
    /* Store the proxy's state after a step, for diagnostics. */
    void store_proxy_state(size_t tool, const pliant_tool_state &state);
    /* Publish contact and markers, at most 30 times per second. */
    void publish_contact(size_t tool, const pliant_model &model, const pliant_data &data, const ros::Time &now);

    /* Publish the state of the blade if it differs from the last message. */
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
        /* set by callbacks */
        bool has_pose = false;
        ros::Time stamp;          /* of the last pose */
        PoseFilter filter;
        /* poses newer than the used pose, in ascending order, because tf may lag behind them */
        std::deque<Waiting> waiting;
        bool has_jaw = false;
        ros::Time jaw_stamp;
        double jaw = 0, last_jaw = 0; /* last_jaw: last valid angle */
        bool blade = false, energy = false;
        /* why the arm does not work according to operating_state; empty: it works, or there is no such message */
        std::string idle;
        std::string type;         /* instrument type, if the shape follows it */
        bool exchanged = false;
        pliant_tool_shape shape{};
        uint64_t received = 0;
        /* arrival of the last pose and jaw, on a clock that is independent of /clock */
        ros::SteadyTime arrived, jaw_arrived;
        std::string refused; /* why the last pose was rejected */
        /* set by sample */
        bool has_last = false, present = false;
        std::string untransformed; /* why the last pose has no transform */
        std::string why = "no pose yet";
        Jaw state = JAW_UNKNOWN;
        ros::Time last_stamp;
        Rigid last_in_tissue, last_tissue_in_frame;
        std::string last_frame;
        /* set by store_proxy_state, under the lock */
        bool saturated = false;
        double proxy_error = 0, jaw_error = 0, rest_tip[3] = {0, 0, 0};
        ros::SteadyTime rests_since;
        /* set by publish_cut */
        Cut sent;
        /* set by health */
        uint64_t counted = 0;
        ros::WallTime counted_at;
        /* declared last, so that the callbacks stop before the members that they set are destroyed */
        ros::Subscriber pose_in, jaw_in, blade_in, energy_in, type_in, state_in;
    };

    void take_pose(Tool *tool, const topic_tools::ShapeShifter &message);
    void take_jaw(Tool *tool, const sensor_msgs::JointState &message);
    void take_type(Tool *tool, const std::string &type);
    void listen_for_blade(ros::NodeHandle handle, Tool *tool);
    void transform(Tool *tool);
    void update_jaw(Tool *tool, const ros::Time &now);
    /* held: accept an additional age of tool_hold */
    bool is_fresh(const ros::Time &stamp, const ros::Time &now, bool held) const;
    /* Return the time for which neither a message has arrived nor /clock has advanced [s]; 0 while /clock advances.
     * Without /clock no stamp becomes too old. */
    double seconds_without_messages(const ros::SteadyTime &arrived) const;
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
