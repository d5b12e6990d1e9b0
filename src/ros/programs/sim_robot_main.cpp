/* Simulate arms with the CRTK interface of a dVRK console, for tests and for users without a robot.
 * Published per arm: /ARM/measured_cp, setpoint_cp, measured_cv and jaw/measured_js at ~rate, operating_state
 * (latched), and tf of the arm bases at half the rate.
 * Subscribed: /ARM/servo_cp, move_cp and jaw/servo_jp, followed with limited speed.
 *
 * Private parameters:
 * - arms ("PSM1"), prefix (""), rate (100) [Hz], frame ("ARM_base", where ARM is replaced by the arm's name), parent
 *   ("world")
 * - base ("0 0 0": position of the arm bases in the parent frame) [m], tip ("0 0 -0.1": initial tip position in the
 *   arm's frame) [m]
 * - speed (0.2) [m/s], jaw (true), shake (0: amplitude of noise in measured poses) [m]
 * - camera ("": none; or the name of the camera arm, such as ECM: poses are then in its frame, as with setup joints,
 *   and local/measured_cp is in ARM_base)
 * - setup ("0 0 0": position of ARM_base in the camera's frame) [m], instrument ("": published on tool_type, latched)
 * - keyboard (false; true: w s a d r f move the first arm by 2 mm, space opens and closes its jaw)
 *
 * /ARM/fault (std_msgs/String) simulates faults: none, silent (no messages), invalid (stamp 0), frozen (old stamps),
 * nan, teleport (by 30 cm), ahead or behind (clock off by 10 s), unknown_frame, disabled, paused, not_homed (operating
 * states). */
#include "ros/sim/operating_state.h"

#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/TwistStamped.h>
#include <ros/ros.h>
#include <sensor_msgs/JointState.h>
#include <std_msgs/String.h>
#include <tf2_ros/transform_broadcaster.h>

#include <Eigen/Geometry>
#include <tf2_eigen/tf2_eigen.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <memory>
#include <random>
#include <sstream>
#include <termios.h>
#include <unistd.h>
#include <vector>

namespace {

struct Settings {
    std::string prefix, frame, parent, camera, instrument;
    Eigen::Vector3d base, tip, setup;
    double rate, speed, shake;
    bool jaw;
};

Eigen::Vector3d three(const ros::NodeHandle &own, const char *name, const char *otherwise)
{
    Eigen::Vector3d out = Eigen::Vector3d::Zero();
    std::istringstream text(own.param<std::string>(name, otherwise));
    if (!(text >> out.x() >> out.y() >> out.z()))
        throw std::runtime_error(std::string("~") + name + " must be three numbers: x y z");
    return out;
}

class Arm {
public:
    Arm(ros::NodeHandle handle, const std::string &name, const Settings &settings)
        : settings_(settings), base_frame_(frame_of(settings.frame, name)),
          frame_(settings.camera.empty() ? base_frame_ : settings.camera), random_(std::hash<std::string>()(name))
    {
        const std::string own = settings.prefix + "/" + name + "/";
        measured_ = handle.advertise<geometry_msgs::PoseStamped>(own + "measured_cp", 1);
        setpoint_ = handle.advertise<geometry_msgs::PoseStamped>(own + "setpoint_cp", 1);
        velocity_ = handle.advertise<geometry_msgs::TwistStamped>(own + "measured_cv", 1);
        if (!settings.camera.empty())
            local_ = handle.advertise<geometry_msgs::PoseStamped>(own + "local/measured_cp", 1);
        if (!settings.instrument.empty()) {
            type_ = handle.advertise<std_msgs::String>(own + "tool_type", 1, true);
            std_msgs::String type;
            type.data = settings.instrument;
            type_.publish(type);
        }
        if (settings.jaw) jaw_out_ = handle.advertise<sensor_msgs::JointState>(own + "jaw/measured_js", 1);
        const auto go = [this](const geometry_msgs::PoseStampedConstPtr &message) { goal_from(*message); };
        servo_in_ = handle.subscribe<geometry_msgs::PoseStamped>(own + "servo_cp", 1, go);
        move_in_ = handle.subscribe<geometry_msgs::PoseStamped>(own + "move_cp", 1, go);
        jaw_in_ = handle.subscribe<sensor_msgs::JointState>(
            own + "jaw/servo_jp", 1, [this](const sensor_msgs::JointStateConstPtr &message) {
                if (!message->position.empty() && std::isfinite(message->position[0])) jaw_goal_ = message->position[0];
            });
        state_ = handle.advertise<pliant_ros::OperatingState>(own + "operating_state", 1, true);
        publish_operating_state();
        fault_in_ =
            handle.subscribe<std_msgs::String>(own + "fault", 1, [this](const std_msgs::StringConstPtr &message) {
                fault_ = message->data;
                publish_operating_state();
            });
        at_ = goal_ = Eigen::Translation3d(settings.tip) * Eigen::Quaterniond::Identity();
    }

    void turn(double elapsed, const ros::Time &now)
    {
        const Eigen::Vector3d before = at_.translation();
        follow(elapsed);
        if (fault_ != "frozen") stamp_ = now;
        if (fault_ == "silent") return;
        geometry_msgs::PoseStamped pose;
        pose.header.stamp = fault_ == "invalid" ? ros::Time()
                                                : stamp_ + ros::Duration(fault_ == "ahead"    ? 10
                                                                         : fault_ == "behind" ? -10
                                                                                              : 0);
        pose.header.frame_id = fault_ == "unknown_frame" ? "nowhere" : frame_;
        pose.pose = tf2::toMsg(at_);
        setpoint_.publish(with(pose, tf2::toMsg(goal_)));
        std::normal_distribution<double> shake(0, settings_.shake);
        if (settings_.shake > 0)
            pose.pose.position.x += shake(random_), pose.pose.position.y += shake(random_),
                pose.pose.position.z += shake(random_);
        if (fault_ == "nan") pose.pose.position.y = std::numeric_limits<double>::quiet_NaN();
        if (fault_ == "teleport") pose.pose.position.x += 0.3;
        measured_.publish(pose);
        if (local_) {
            geometry_msgs::PoseStamped local = pose;
            local.header.frame_id = base_frame_;
            local.pose.position.x -= settings_.setup.x(), local.pose.position.y -= settings_.setup.y(),
                local.pose.position.z -= settings_.setup.z();
            local_.publish(local);
        }
        geometry_msgs::TwistStamped twist;
        twist.header = pose.header;
        const Eigen::Vector3d speed =
            elapsed > 0 ? Eigen::Vector3d((at_.translation() - before) / elapsed) : Eigen::Vector3d::Zero();
        twist.twist.linear.x = speed.x(), twist.twist.linear.y = speed.y(), twist.twist.linear.z = speed.z();
        velocity_.publish(twist);
        if (!settings_.jaw) return;
        sensor_msgs::JointState jaw;
        jaw.header = pose.header;
        jaw.name.push_back("jaw");
        jaw.position.push_back(jaw_);
        jaw_out_.publish(jaw);
    }

    /* Return the transforms to publish on tf. */
    std::vector<geometry_msgs::TransformStamped> frames(const ros::Time &now) const
    {
        std::vector<geometry_msgs::TransformStamped> out{frame(settings_.parent, frame_, settings_.base, now)};
        if (!settings_.camera.empty()) out.push_back(frame(frame_, base_frame_, settings_.setup, now));
        return out;
    }

    void key(char pressed)
    {
        static const char keys[] = "dawsrf"; /* +x -x +y -y +z -z */
        const char *found = std::strchr(keys, pressed);
        if (pressed == ' ') jaw_goal_ = jaw_goal_ > 0.2 ? 0 : 0.5;
        else if (pressed && found) goal_.translation()[(found - keys) / 2] += (found - keys) % 2 ? -0.002 : 0.002;
    }

private:
    static std::string frame_of(std::string frame, const std::string &arm)
    {
        const size_t at = frame.find("ARM");
        return at == std::string::npos ? frame : frame.replace(at, 3, arm);
    }

    void publish_operating_state()
    {
        pliant_ros::OperatingState state;
        state.header.stamp = ros::Time::now();
        state.state = fault_ == "disabled" ? "DISABLED" : fault_ == "paused" ? "PAUSED" : "ENABLED";
        state.is_homed = fault_ != "not_homed";
        state_.publish(state);
    }

    static geometry_msgs::TransformStamped frame(const std::string &in, const std::string &name,
                                                 const Eigen::Vector3d &place, const ros::Time &now)
    {
        geometry_msgs::TransformStamped out = tf2::eigenToTransform(Eigen::Isometry3d(Eigen::Translation3d(place)));
        out.header.stamp = now;
        out.header.frame_id = in;
        out.child_frame_id = name;
        return out;
    }

    static geometry_msgs::PoseStamped with(geometry_msgs::PoseStamped message, const geometry_msgs::Pose &pose)
    {
        message.pose = pose;
        return message;
    }

    void goal_from(const geometry_msgs::PoseStamped &message)
    {
        Eigen::Vector3d place;
        Eigen::Quaterniond turn;
        tf2::fromMsg(message.pose.position, place);
        tf2::fromMsg(message.pose.orientation, turn);
        /* reject the command and stay, as a console does */
        if (!place.allFinite() || !turn.coeffs().allFinite() || std::fabs(turn.norm() - 1) > 0.01) return;
        goal_ = Eigen::Translation3d(place) * turn.normalized();
    }

    void follow(double elapsed)
    {
        const double turn_speed = 3, jaw_speed = 3; /* [rad/s] */
        const Eigen::Vector3d motion = goal_.translation() - at_.translation();
        const double part = motion.norm() > settings_.speed * elapsed ? settings_.speed * elapsed / motion.norm() : 1;
        const Eigen::Quaterniond now(at_.rotation()), then(goal_.rotation());
        const double angle = now.angularDistance(then),
                     fraction = angle > turn_speed * elapsed ? turn_speed * elapsed / angle : 1;
        at_ = Eigen::Translation3d(at_.translation() + part * motion) * now.slerp(fraction, then);
        jaw_ += std::max(-jaw_speed * elapsed, std::min(jaw_speed * elapsed, jaw_goal_ - jaw_));
    }

    const Settings settings_;
    const std::string base_frame_, frame_;
    std::mt19937_64 random_;
    Eigen::Isometry3d at_, goal_;
    double jaw_ = 0.5, jaw_goal_ = 0.5;
    std::string fault_;
    ros::Time stamp_;
    ros::Publisher measured_, setpoint_, velocity_, jaw_out_, local_, type_, state_;
    ros::Subscriber servo_in_, move_in_, jaw_in_, fault_in_;
};

/* Read single key presses if standard input is a terminal. */
class Keyboard {
public:
    explicit Keyboard(bool wanted) : on_(wanted && tcgetattr(STDIN_FILENO, &before_) == 0)
    {
        if (!on_) return;
        termios now = before_;
        now.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
        now.c_cc[VMIN] = now.c_cc[VTIME] = 0;
        tcsetattr(STDIN_FILENO, TCSANOW, &now);
    }
    ~Keyboard()
    {
        if (on_) tcsetattr(STDIN_FILENO, TCSANOW, &before_);
    }
    Keyboard(const Keyboard &) = delete;
    bool next(char *pressed) const { return on_ && read(STDIN_FILENO, pressed, 1) == 1; }

private:
    termios before_;
    const bool on_;
};

} // namespace

int main(int argc, char **argv)
{
    ros::init(argc, argv, "sim_robot");
    ros::NodeHandle handle, own("~");
    std::vector<std::unique_ptr<Arm>> arms;
    Settings settings;
    try {
        settings = {own.param<std::string>("prefix", ""),
                    own.param<std::string>("frame", "ARM_base"),
                    own.param<std::string>("parent", "world"),
                    own.param<std::string>("camera", ""),
                    own.param<std::string>("instrument", ""),
                    three(own, "base", "0 0 0"),
                    three(own, "tip", "0 0 -0.1"),
                    three(own, "setup", "0 0 0"),
                    own.param("rate", 100.0),
                    own.param("speed", 0.2),
                    own.param("shake", 0.0),
                    own.param("jaw", true)};
        std::istringstream names(own.param<std::string>("arms", "PSM1"));
        for (std::string name; names >> name;) arms.emplace_back(new Arm(handle, name, settings));
    } catch (const std::exception &wrong) {
        ROS_FATAL("%s", wrong.what());
        return 1;
    }
    const Keyboard keyboard(own.param("keyboard", false));
    tf2_ros::TransformBroadcaster frames;
    ros::WallRate turn(std::min(std::max(settings.rate, 1.0), 1000.0));
    ros::SteadyTime before = ros::SteadyTime::now();
    for (unsigned long count = 0; ros::ok(); ++count) {
        ros::spinOnce();
        for (char pressed; !arms.empty() && keyboard.next(&pressed);) arms.front()->key(pressed);
        const ros::SteadyTime steady = ros::SteadyTime::now();
        const ros::Time now = ros::Time::now();
        for (auto &arm : arms) arm->turn((steady - before).toSec(), now);
        before = steady;
        std::map<std::string, geometry_msgs::TransformStamped> all; /* arms may share a base frame */
        for (size_t a = 0; a < arms.size() && count % 2 == 0; ++a)
            for (const geometry_msgs::TransformStamped &each : arms[a]->frames(now)) all[each.child_frame_id] = each;
        for (const auto &each : all) frames.sendTransform(each.second);
        turn.sleep();
    }
    return 0;
}
