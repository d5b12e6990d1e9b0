#include "rviz/mouse_robot.h"

#include "ros/tool_sender.h"

#include <ros/ros.h>

namespace pliant_rviz {

// [s]; poses come every 10 ms, a step of the simulation takes 20 ms
static const double PERIOD = 0.01, OPEN_FOR = 0.1, CLOSED_FOR = 0.06, WAIT_FOR_HOLD = 0.5, OPEN_AFTER = 0.2;

MouseRobot::~MouseRobot() { stop(); }

void MouseRobot::stop()
{
    quit_ = true;
    if (thread_.joinable()) thread_.join();
    quit_ = holding_ = held_ = false;
}

void MouseRobot::grasp(const std::string &tool, const std::string &frame, const std::array<double, 3> &point)
{
    stop();
    target_ = point;
    holding_ = true;
    thread_ = std::thread(&MouseRobot::run, this, tool, frame, point);
}

void MouseRobot::move(const std::array<double, 3> &target)
{
    std::lock_guard<std::mutex> guard(lock_);
    target_ = target;
}

void MouseRobot::held() { held_ = true; }

void MouseRobot::release() { holding_ = false; }

void MouseRobot::run(const std::string &tool, const std::string &frame, const std::array<double, 3> &point)
{
    ros::NodeHandle handle;
    pliant_ros::ToolSender sender(handle, tool, frame);
    geometry_msgs::Pose tip;
    tip.orientation.w = 1;
    ros::WallTime start = ros::WallTime::now(), released;
    double closed_at = -1;
    bool follows = false;
    held_ = false;
    while (!quit_ && ros::ok()) {
        double now = (ros::WallTime::now() - start).toSec();
        bool closed = holding_ && now > OPEN_FOR;
        if (closed && closed_at < 0) {
            closed_at = now;
            held_ = false; // what was heard before concerns an earlier grasp
        }
        // the tip stays until the tissue is in hand
        follows = follows || (closed && now - closed_at > CLOSED_FOR && (held_ || now - closed_at > WAIT_FOR_HOLD));
        std::array<double, 3> to = point;
        if (follows) {
            std::lock_guard<std::mutex> guard(lock_);
            to = target_;
        }
        tip.position.x = to[0];
        tip.position.y = to[1];
        tip.position.z = to[2];
        sender.send(tip, closed, ros::Time::now());
        if (!holding_) {
            if (released.isZero()) released = ros::WallTime::now();
            if ((ros::WallTime::now() - released).toSec() > OPEN_AFTER) break;
        }
        ros::WallDuration(PERIOD).sleep();
    }
}

} // namespace pliant_rviz
