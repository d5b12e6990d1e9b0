// Publish the mouse as a robot's tool: poses and a jaw on CRTK topics at a constant rate, independent of rviz's
// rendering.
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

    // Advertise the topics <tool>/measured_cp and <tool>/jaw/measured_js. Call before the first grasp, so that the node
    // can connect.
    // @param tool name with namespace
    // @param frame frame of all points
    void connect(const std::string &tool, const std::string &frame);
    // Move to a point with the jaw open, close the jaw, then follow the target.
    void grasp(const std::array<double, 3> &point);
    void move(const std::array<double, 3> &target);
    // Set the node's report: it sees the tool; the tool has grasped tissue. Without a report the robot proceeds by
    // time.
    void set_tool_state(bool present, bool grasped);
    // Open the jaw. Shortly after, the poses end and the tool becomes absent.
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
