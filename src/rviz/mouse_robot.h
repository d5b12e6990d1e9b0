// The mouse as a robot's tool: poses and a jaw on CRTK topics at a steady rate, whatever rviz is doing.
#ifndef PLIANT_RVIZ_MOUSE_ROBOT_H
#define PLIANT_RVIZ_MOUSE_ROBOT_H

#include <array>
#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

namespace pliant_ros {
class ToolSender;
}

namespace pliant_rviz {

class MouseRobot {
public:
    MouseRobot();
    ~MouseRobot();
    MouseRobot(const MouseRobot &) = delete;
    MouseRobot &operator=(const MouseRobot &) = delete;

    // The topics <tool>/measured_cp and <tool>/jaw/measured_js; before the first grasp, so that the node is connected by then.
    // @param tool  its name with its namespace
    // @param frame of all points
    void connect(const std::string &tool, const std::string &frame);
    // Go to a point with the jaw open, close it there, and from then on follow the target.
    void grasp(const std::array<double, 3> &point);
    void move(const std::array<double, 3> &target);
    // What the node says: it sees the tool, the tool has hold of the tissue. Without word from it the robot goes on by time.
    void hear(bool present, bool grasped);
    // Open the jaw; soon after, the poses end and the tool is gone.
    void release();
    bool holding() const { return holding_; }

private:
    void run(const std::array<double, 3> &point);
    void stop();

    std::unique_ptr<pliant_ros::ToolSender> sender_;
    std::string tool_, frame_;
    std::thread thread_;
    std::mutex lock_;
    std::array<double, 3> target_{{0, 0, 0}};
    std::atomic<bool> holding_{false}, present_{false}, grasped_{false}, quit_{false};
};

} // namespace pliant_rviz
#endif
