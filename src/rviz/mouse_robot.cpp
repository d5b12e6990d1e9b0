#include "rviz/mouse_robot.h"

#include "ros/programs/tool_sender.h"

#include <ros/ros.h>

namespace pliant_rviz {

// Times [s]; poses are sent every 10 ms, a simulation step takes 20 ms.
static const double PERIOD = 0.01, OPEN_FOR = 0.1, WAIT_FOR_SIGHT = 1.0, CLOSED_FOR = 0.06, WAIT_FOR_HOLD = 0.5,
                    OPEN_AFTER = 0.2;

MouseRobot::MouseRobot() = default;

MouseRobot::~MouseRobot() { stop(); }

void MouseRobot::stop()
{
    quit_ = true;
    if (thread_.joinable()) thread_.join();
    quit_ = holding_ = false;
}

void MouseRobot::connect(const std::string &tool, const std::string &frame)
{
    if (sender_ && tool == tool_ && frame == frame_) return;
    stop();
    tool_ = tool;
    frame_ = frame;
    sender_.reset(new pliant_ros::ToolSender(ros::NodeHandle(), tool, frame));
}

void MouseRobot::grasp(const std::array<double, 3> &point)
{
    stop();
    target_ = point;
    present_ = grasped_ = false;
    holding_ = true;
    thread_ = std::thread(&MouseRobot::run, this, point);
}

void MouseRobot::move(const std::array<double, 3> &target)
{
    std::lock_guard<std::mutex> guard(lock_);
    target_ = target;
}

void MouseRobot::set_tool_state(bool present, bool grasped)
{
    present_ = present;
    grasped_ = grasped;
}

void MouseRobot::release() { holding_ = false; }

void MouseRobot::run(const std::array<double, 3> &point)
{
    geometry_msgs::Pose tip;
    tip.orientation.w = 1;
    double closed_at = -1, released_at = -1;
    bool follows = false;
    ros::WallTime start = ros::WallTime::now();
    while (!quit_ && ros::ok()) {
        double now = (ros::WallTime::now() - start).toSec();
        if (holding_ && closed_at < 0 && now > (present_ ? OPEN_FOR : WAIT_FOR_SIGHT)) closed_at = now;
        bool closed = holding_ && closed_at >= 0;
        // the tip stays until the tissue is grasped
        follows = follows || (closed && now - closed_at > (grasped_ ? CLOSED_FOR : WAIT_FOR_HOLD));
        std::array<double, 3> to = point;
        if (follows) {
            std::lock_guard<std::mutex> guard(lock_);
            to = target_;
        }
        tip.position.x = to[0];
        tip.position.y = to[1];
        tip.position.z = to[2];
        sender_->send(tip, closed, ros::Time::now());
        if (!holding_) {
            if (released_at < 0) released_at = now;
            if (now - released_at > OPEN_AFTER) break;
        }
        ros::WallDuration(PERIOD).sleep();
    }
}

} // namespace pliant_rviz
