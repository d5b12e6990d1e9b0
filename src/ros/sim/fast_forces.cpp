#include "ros/sim/fast_forces.h"

#include <ros/poll_manager.h>

#include <algorithm>

namespace pliant_ros {

namespace {

const double longest_step = 0.5; /* maximum age of a linearization [s] */

double seconds(Clock::time_point time) { return std::chrono::duration<double>(time.time_since_epoch()).count(); }

} // namespace

FastForces::FastForces(ros::NodeHandle handle, const Parameters &parameters, Tools *tools, ros::CallbackQueue *queue)
    : rate_(parameters.wrench_rate), hold_(parameters.tool_max_age + parameters.tool_hold), tools_(tools), queue_(queue)
{
    if (!is_on()) return;
    handle.setCallbackQueue(queue_);
    for (size_t i = 0; i < tools->size(); ++i) {
        const ToolParameters &tool = parameters.tools[i];
        arms_.emplace_back(new Arm(parameters.wrench_bound));
        Arm *arm = arms_.back().get();
        arm->index = i;
        arm->own_frame = tool.frame.empty() ? parameters.parent_frame : tool.frame;
        arm->tissue_from_frame = identity();
        arm->filter = PoseFilter(parameters.pose_filter);
        arm->pose_in = handle.subscribe<topic_tools::ShapeShifter>(
            tool.name + "/measured_cp", 1,
            [this, arm](const topic_tools::ShapeShifter::ConstPtr &message) { take_pose(arm, *message); },
            ros::VoidConstPtr(), ros::TransportHints().tcpNoDelay());
    }
    thread_ = std::thread(&FastForces::run, this);
    if (!set_realtime_priority(thread_.native_handle())) {
        ROS_INFO(
            "~wrench_rate: forces may be late, because this user may not start real-time threads (limits.conf: "
            "rtprio)");
        return;
    }
    computes_hand_forces() = true;
    /* raise the priority of roscpp's network thread as well; the call must come from that thread */
    networking_ = ros::PollManager::instance()->addPollThreadListener([this] {
        if (!is_networking_raised_.exchange(true)) set_realtime_priority(pthread_self());
    });
}

FastForces::~FastForces()
{
    stopping_ = true;
    if (networking_.connected()) ros::PollManager::instance()->removePollThreadListener(networking_);
    if (thread_.joinable()) thread_.join();
}

void FastForces::run()
{
    const auto period = std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1 / rate_));
    while (!stopping_) {
        queue_->callAvailable(ros::WallDuration(std::min(1 / rate_, 0.1)));
        const Clock::time_point now = Clock::now();
        for (auto &arm : arms_) {
            std::lock_guard<InheritingMutex> hold(arm->lock);
            if (arm->has_pose && now - arm->answered_at >= period) answer(arm.get(), ros::Time::now());
        }
    }
}

void FastForces::take_pose(Arm *arm, const topic_tools::ShapeShifter &message)
{
    geometry_msgs::PoseStamped sent;
    Rigid pose;
    std::string why;
    /* an invalid pose counts as no pose */
    if (!pose_from_any_message(message, arm->own_frame, &sent, &why) || !tool_pose_from_message(sent, &pose, &why))
        return;
    std::lock_guard<InheritingMutex> hold(arm->lock);
    if (sent.header.frame_id != arm->sample.frame) return; /* the step computes the transform of a new frame */
    pose = arm->filter.next(sent.header.stamp.toSec(), sent.header.frame_id, pose);
    arm->sample.in_tissue = multiply(arm->tissue_from_frame, pose);
    arm->has_pose = true;
    arm->pose_at = Clock::now();
    answer(arm, sent.header.stamp);
}

bool FastForces::is_stale(const Arm &arm, Clock::time_point now) const
{
    return seconds(now) - seconds(arm.pose_at) > hold_ || seconds(now) - seconds(arm.frame_at) > longest_step;
}

void FastForces::answer(Arm *arm, const ros::Time &stamp)
{
    const Clock::time_point now = Clock::now();
    double wrench[6];
    if (is_stale(*arm, now)) arm->between.stop();
    arm->between.answer(seconds(now), arm->sample.in_tissue.translation, arm->sample.in_tissue.rotation, wrench);
    arm->answered_at = now;
    tools_->publish_force(arm->index, arm->sample, wrench, wrench + 3, stamp);
}

void FastForces::frame(size_t tool, const pliant_data &data, const ToolSample &sample, bool acts)
{
    Arm &arm = *arms_[tool];
    check(pliant_tool_linearize(&data, static_cast<int>(tool), &arm.linear));
    std::lock_guard<InheritingMutex> hold(arm.lock);
    const Clock::time_point now = Clock::now();
    const bool known = arm.has_pose && arm.sample.frame == sample.frame;
    const Rigid in_tissue = known ? arm.sample.in_tissue : sample.in_tissue;
    /* for an absent tool, the decaying force stays at the tool's last position */
    if (sample.present || !arm.sample.present) {
        arm.sample = sample;
        arm.sample.in_tissue = in_tissue; /* most recent pose instead of the step's pose */
        arm.tissue_from_frame = inverse(sample.frame_from_tissue);
    }
    arm.frame_at = now;
    if (!known && sample.present) {
        arm.has_pose = true;
        arm.pose_at = now;
    }
    arm.between.frame(seconds(now), arm.linear, acts && sample.present);
}

void FastForces::stop(size_t tool)
{
    std::lock_guard<InheritingMutex> hold(arms_[tool]->lock);
    arms_[tool]->between.stop();
}

} // namespace pliant_ros
