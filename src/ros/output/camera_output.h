/* Render the tissue as cameras see it: colour, depth, label images, and points, with their calibration. A separate
 * thread renders only the subscribed topics. */
#ifndef PLIANT_ROS_OUTPUT_CAMERA_OUTPUT_H
#define PLIANT_ROS_OUTPUT_CAMERA_OUTPUT_H

#include "ros/params/params.h"
#include "ros/params/problem.h"
#include "ros/sim/snapshot.h"

#include <ros/node_handle.h>
#include <tf2_ros/buffer.h>

#include <atomic>
#include <memory>
#include <thread>

namespace pliant_ros {

class CameraOutput {
public:
    CameraOutput(ros::NodeHandle handle, const Parameters &parameters, Snapshots *snapshots,
                 std::shared_ptr<const tf2_ros::Buffer> frames);
    ~CameraOutput();

    std::string problem() const { return problem_.get(); }
    /* Return the number of rendered images. */
    uint64_t drawn() const { return drawn_; }
    bool any() const { return !cameras_.empty(); }

private:
    struct View;
    struct Camera;
    void run();
    void render_images(Camera *camera, View *view, const std::shared_ptr<const Snapshot> &newest);

    const std::string tissue_frame_;
    Snapshots *snapshots_;
    const std::shared_ptr<const tf2_ros::Buffer> frames_;
    std::vector<std::unique_ptr<Camera>> cameras_;
    double fastest_ = 0; /* maximum rate of all cameras [Hz] */
    std::atomic<uint64_t> drawn_{0};
    std::atomic<bool> stopping_{false};
    Problem problem_;
    std::thread thread_;
};

} // namespace pliant_ros

#endif
