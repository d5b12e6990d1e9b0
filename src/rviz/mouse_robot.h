// The mouse as a robot's tool: poses and a jaw on CRTK topics at a steady rate, whatever rviz is doing.
#ifndef PLIANT_RVIZ_MOUSE_ROBOT_H
#define PLIANT_RVIZ_MOUSE_ROBOT_H

#include <array>
#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

namespace pliant_rviz {

class MouseRobot {
public:
    MouseRobot() = default;
    ~MouseRobot();
    MouseRobot(const MouseRobot &) = delete;
    MouseRobot &operator=(const MouseRobot &) = delete;

    // Go to a point with the jaw open, close it there, and from then on follow the target.
    // @param tool  name of the tool with its namespace: <tool>/measured_cp, <tool>/jaw/measured_js
    // @param frame of all points
    void grasp(const std::string &tool, const std::string &frame, const std::array<double, 3> &point);
    void move(const std::array<double, 3> &target);
    // The node says that the tool has hold of the tissue: no need to wait longer.
    void held();
    // Open the jaw; soon after, the poses end and the tool is gone.
    void release();
    bool holding() const { return holding_; }

private:
    void run(const std::string &tool, const std::string &frame, const std::array<double, 3> &point);
    void stop();

    std::thread thread_;
    std::mutex lock_;
    std::array<double, 3> target_{{0, 0, 0}};
    std::atomic<bool> holding_{false}, held_{false}, quit_{false};
};

} // namespace pliant_rviz
#endif
