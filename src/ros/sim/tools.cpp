/* Tools of the robot: receive their poses and jaws, and publish their forces and contacts. The simulation thread reads
 * the newest pose by Tools::sample. */
#include "ros/sim/tools.h"

#include "ros/sim/operating_state.h"

#include <sensor_msgs/Joy.h>
#include <std_msgs/Bool.h>
#include <std_msgs/String.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace pliant_ros {

namespace {

enum {
    CONTACT_RATE = 30 /* [Hz] */,
    CUT_QUEUE = 256 /* a recorder that is held up misses none */,
    MAX_WAITING = 256 /* poses: a quarter of a second at 1 kHz */
};

const double rest_seconds = 0.5; /* time without motion after which a tool rests */

std::string milliseconds(double seconds) { return std::to_string(std::lround(1e3 * seconds)) + " ms"; }

} // namespace

Tools::Tools(ros::NodeHandle handle, const Parameters &parameters, std::shared_ptr<const tf2_ros::Buffer> frames,
             ros::CallbackQueue *queue)
    : tissue_frame_(parameters.tissue_frame), parent_frame_(parameters.parent_frame), max_age_(parameters.tool_max_age),
      hold_(parameters.tool_hold), max_pause_(parameters.tool_max_pause), jaw_close_(parameters.jaw_close),
      jaw_release_(parameters.jaw_release), frames_(std::move(frames))
{
    ros::TransportHints hints = ros::TransportHints().tcpNoDelay();
    ros::NodeHandle input = handle;
    if (queue) input.setCallbackQueue(queue);
    for (const ToolParameters &each : parameters.tools) {
        tools_.emplace_back(new Tool);
        Tool *tool = tools_.back().get();
        tool->parameters = each;
        tool->last_frame = tissue_frame_;
        tool->filter = PoseFilter(parameters.pose_filter);
        tool->counted_at = ros::WallTime::now();
        /* forces between steps arrive in bursts if the process is delayed */
        const uint32_t queue_size = parameters.wrench_rate > 0 ? 16 : 1;
        tool->force_out = handle.advertise<geometry_msgs::WrenchStamped>(each.name + "/measured_cf", queue_size);
        tool->body_force_out =
            handle.advertise<geometry_msgs::WrenchStamped>(each.name + "/body/measured_cf", queue_size);
        tool->spatial_force_out =
            handle.advertise<geometry_msgs::WrenchStamped>(each.name + "/spatial/measured_cf", queue_size);
        tool->contact_out = handle.advertise<ContactState>(each.name + "/contact", 1);
        tool->marker_out = handle.advertise<visualization_msgs::MarkerArray>(each.name + "/marker", 1);
        tool->pose_in = input.subscribe<topic_tools::ShapeShifter>(
            each.name + "/measured_cp", 8,
            [this, tool](const topic_tools::ShapeShifter::ConstPtr &message) { take_pose(tool, *message); },
            ros::VoidConstPtr(), hints);
        tool->state_in = input.subscribe<OperatingState>(
            each.name + "/operating_state", 1, [tool](const boost::shared_ptr<const OperatingState> &message) {
                std::lock_guard<InheritingMutex> hold(tool->lock);
                tool->idle = message->why_not();
            });
        if (each.has_blade()) listen_for_blade(handle, tool);
        if (each.shape_follows)
            tool->type_in = handle.subscribe<std_msgs::String>(
                each.name + "/tool_type", 1,
                [this, tool](const std_msgs::StringConstPtr &message) { take_type(tool, message->data); });
        if (!each.grasps && !each.has_blade() && each.shape.num_parts == 0 && !each.shape_follows) continue;
        tool->jaw_in = input.subscribe<sensor_msgs::JointState>(
            each.name + "/jaw/measured_js", 1,
            [this, tool](const sensor_msgs::JointStateConstPtr &message) { take_jaw(tool, *message); },
            ros::VoidConstPtr(), hints);
    }
}

/* Set the instrument of a dVRK tool_type message, NAME:MODEL. An unknown instrument has no contact, because the shape
 * of another instrument would be wrong. */
void Tools::take_type(Tool *tool, const std::string &type)
{
    pliant_tool_shape shape{};
    const bool known = pliant_tool_shape_find(type.c_str(), &shape) >= 0;
    std::lock_guard<InheritingMutex> hold(tool->lock);
    if (tool->type == type) return;
    tool->type = type;
    tool->shape = shape;
    tool->exchanged = true;
    if (known)
        ROS_INFO("tool %s: the instrument is %s", tool->parameters.name.c_str(), type.c_str());
    else
        ROS_WARN("tool %s has no shape for contact: %s", tool->parameters.name.c_str(), pliant_last_error());
}

bool Tools::take_exchanged_shape(size_t index, pliant_tool_shape *shape)
{
    Tool &tool = *tools_[index];
    if (!tool.parameters.shape_follows) return false;
    std::lock_guard<InheritingMutex> hold(tool.lock);
    *shape = tool.shape;
    const bool is_news = tool.exchanged;
    tool.exchanged = false;
    return is_news;
}

void Tools::listen_for_blade(ros::NodeHandle handle, Tool *tool)
{
    const std::string &name = tool->parameters.name;
    tool->cut_out = handle.advertise<Cut>(name + "/cut", CUT_QUEUE, true);
    tool->sent.tool = name;
    tool->sent.header.frame_id = tissue_frame_;
    tool->blade_in =
        handle.subscribe<std_msgs::Bool>(name + "/blade", 1, [tool](const std_msgs::BoolConstPtr &message) {
            std::lock_guard<InheritingMutex> hold(tool->lock);
            tool->blade = message->data;
        });
    /* first button of a pedal */
    tool->energy_in =
        handle.subscribe<sensor_msgs::Joy>(name + "/energy", 1, [tool](const sensor_msgs::JoyConstPtr &message) {
            std::lock_guard<InheritingMutex> hold(tool->lock);
            tool->energy = !message->buttons.empty() && message->buttons[0] == 1;
        });
}

void Tools::take_pose(Tool *tool, const topic_tools::ShapeShifter &message)
{
    geometry_msgs::PoseStamped sent;
    Rigid pose;
    std::string why;
    const std::string &own = tool->parameters.frame;
    const bool good = pose_from_any_message(message, own.empty() ? parent_frame_ : own, &sent, &why) &&
                      tool_pose_from_message(sent, &pose, &why);
    std::lock_guard<InheritingMutex> hold(tool->lock);
    ++tool->received;
    tool->arrived = ros::SteadyTime::now();
    tool->has_pose = good;
    tool->refused = why;
    if (!good) {
        tool->waiting.clear();
        tool->filter.forget();
        tool->has_last = false; /* after an invalid pose the tool is absent */
        return;
    }
    tool->stamp = sent.header.stamp;
    tool->waiting.push_back({sent.header.stamp, sent.header.frame_id,
                             tool->filter.next(sent.header.stamp.toSec(), sent.header.frame_id, pose)});
    if (tool->waiting.size() > MAX_WAITING) tool->waiting.pop_front();
}

void Tools::take_jaw(Tool *tool, const sensor_msgs::JointState &message)
{
    double angle = 0;
    std::string why;
    bool good = jaw_from_message(message, &angle, &why, tool->parameters.jaw_setpoint);
    std::lock_guard<InheritingMutex> hold(tool->lock);
    tool->has_jaw = good;
    tool->jaw = angle;
    if (good) tool->last_jaw = angle;
    tool->jaw_stamp = message.header.stamp;
    tool->jaw_arrived = ros::SteadyTime::now();
}

bool Tools::is_fresh(const ros::Time &stamp, const ros::Time &now, bool held) const
{
    const double age = seconds_between(stamp, now);
    return age >= -max_age_ && age <= max_age_ + (held ? hold_ : 0);
}

double Tools::seconds_without_messages(const ros::SteadyTime &arrived) const
{
    return (ros::SteadyTime::now() - std::max(arrived, now_since_)).toSec();
}

/* Transform the most recent waiting pose for which tf has a transform at its stamp, and discard older ones. The lock is
 * released meanwhile, so new poses can arrive. */
void Tools::transform(Tool *tool)
{
    std::unique_lock<InheritingMutex> hold(tool->lock);
    const std::deque<Waiting> waiting = tool->waiting;
    hold.unlock();
    tool->untransformed.clear();
    for (size_t i = waiting.size(); i-- > 0;) {
        const Waiting &candidate = waiting[i];
        const bool newest = i + 1 == waiting.size();
        Rigid tissue_from_frame = identity();
        std::string why;
        bool found = candidate.frame == tissue_frame_;
        if (!found) {
            try {
                const tf2::BufferCore &frames = *frames_;
                found = frames.canTransform(tissue_frame_, candidate.frame, candidate.stamp, newest ? &why : nullptr) &&
                        rigid_from_message(
                            frames.lookupTransform(tissue_frame_, candidate.frame, candidate.stamp).transform,
                            &tissue_from_frame, &why);
            } catch (const std::exception &missing) { /* an exception of tf2, or an invalid stamp */
                why = missing.what();
            }
        }
        if (newest && !found) tool->untransformed = why;
        if (!found) continue;
        hold.lock();
        const auto still = std::find_if(tool->waiting.begin(), tool->waiting.end(), [&](const Waiting &each) {
            return each.stamp == candidate.stamp && each.frame == candidate.frame;
        });
        if (still == tool->waiting.end()) return; /* the tool has become absent in the meantime */
        tool->has_last = true;
        tool->last_stamp = candidate.stamp;
        tool->last_frame = candidate.frame;
        tool->last_in_tissue = multiply(tissue_from_frame, candidate.pose);
        tool->last_tissue_in_frame = inverse(tissue_from_frame);
        tool->waiting.erase(tool->waiting.begin(), still + 1);
        return;
    }
}

void Tools::update_jaw(Tool *tool, const ros::Time &now)
{
    const bool fresh = tool->parameters.jaw_setpoint || (is_fresh(tool->jaw_stamp, now, tool->state == JAW_CLOSED) &&
                                                         seconds_without_messages(tool->jaw_arrived) <= max_pause_);
    if (!tool->has_jaw || !fresh) tool->state = JAW_UNKNOWN;
    else if (tool->jaw < jaw_close_) tool->state = JAW_CLOSED;
    else if (tool->jaw > jaw_release_) tool->state = JAW_OPEN;
}

/* Return why the tool is absent. */
std::string Tools::reason(const Tool &tool, const ros::Time &now) const
{
    if (now.isZero()) return "time stands still: /use_sim_time is true, and nothing has come on /clock";
    if (!tool.idle.empty()) return tool.idle;
    if (!tool.refused.empty()) return tool.refused;
    if (!tool.has_pose) return tool.why;
    const double age = seconds_between(tool.stamp, now);
    if (age < -max_age_) return "its clock is " + milliseconds(-age) + " ahead, more than " + milliseconds(max_age_);
    if (age > max_age_) return "the newest pose is " + milliseconds(age) + " old, more than " + milliseconds(max_age_);
    if (seconds_without_messages(tool.arrived) > max_pause_)
        return "time stands still, and no pose has come for " + milliseconds(seconds_without_messages(tool.arrived)) +
               ": /clock has stopped";
    if (!tool.untransformed.empty()) return "its pose has no transform: " + tool.untransformed;
    return "the newest pose that has a transform is " + milliseconds(seconds_between(tool.last_stamp, now)) +
           " old, more than " + milliseconds(max_age_);
}

ToolSample Tools::sample(size_t index, const ros::Time &now)
{
    Tool *tool = tools_[index].get();
    if (now != now_) {
        now_ = now;
        now_since_ = ros::SteadyTime::now();
    }
    transform(tool);
    std::lock_guard<InheritingMutex> hold(tool->lock);
    update_jaw(tool, now);
    ToolSample out;
    const bool goes_on = seconds_without_messages(tool->arrived) <= max_pause_;
    out.present = tool->present =
        tool->idle.empty() && tool->has_last && goes_on && is_fresh(tool->last_stamp, now, tool->present);
    if (!tool->present) out.why = tool->why = reason(*tool, now);
    else if (tool->state == JAW_UNKNOWN && tool->parameters.grasps)
        out.why = "its jaw sends no valid angle, or none that is new";
    out.in_tissue = out.present ? tool->last_in_tissue : identity();
    out.jaw = tool->state;
    out.angle = tool->last_jaw;
    out.blade = tool->blade;
    out.energy = tool->energy;
    out.frame_from_tissue = tool->has_last ? tool->last_tissue_in_frame : identity();
    out.frame = tool->last_frame;
    return out;
}

void Tools::clear()
{
    for (auto &tool : tools_) {
        std::lock_guard<InheritingMutex> hold(tool->lock);
        tool->has_pose = tool->has_last = tool->has_jaw = tool->present = false;
        tool->waiting.clear();
        tool->filter.forget();
        tool->state = JAW_UNKNOWN;
        tool->why = "no pose since time jumped";
    }
}

void Tools::publish_force(size_t index, const ToolSample &sample, const double force[3], const double torque[3],
                          const ros::Time &stamp)
{
    Tool &tool = *tools_[index];
    geometry_msgs::WrenchStamped message;
    message.header.stamp = stamp;
    /* CRTK: the frame of the poses; the namespace defines the axes and the reference point */
    message.header.frame_id = sample.frame;
    if (tool.force_out.getNumSubscribers() > 0) {
        wrench_message(force, torque, sample.frame_from_tissue.rotation, &message);
        tool.force_out.publish(message);
    }
    if (tool.body_force_out.getNumSubscribers() > 0) {
        wrench_message(force, torque, inverse(sample.in_tissue).rotation, &message);
        tool.body_force_out.publish(message);
    }
    if (tool.spatial_force_out.getNumSubscribers() > 0) {
        double about_origin[3];
        torque_about(inverse(sample.frame_from_tissue).translation, sample.in_tissue.translation, force, torque,
                     about_origin);
        wrench_message(force, about_origin, sample.frame_from_tissue.rotation, &message);
        tool.spatial_force_out.publish(message);
    }
}

void Tools::store_proxy_state(size_t index, const pliant_tool_state &state)
{
    const double still = 1e-4; /* [m] */
    Tool &tool = *tools_[index];
    const auto norm = [](const double v[3]) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); };
    double moved[3];
    for (int d = 0; d < 3; ++d) moved[d] = state.tip[d] - tool.rest_tip[d];
    std::lock_guard<InheritingMutex> hold(tool.lock);
    tool.saturated = state.has_proxy && state.saturated;
    tool.proxy_error = state.has_proxy ? norm(state.proxy_error) : 0;
    tool.jaw_error = state.has_proxy ? state.jaw_error : 0;
    if (state.has_proxy && norm(moved) < still) return;
    std::copy(state.tip, state.tip + 3, tool.rest_tip);
    tool.rests_since = ros::SteadyTime::now();
}

void Tools::publish_contact(size_t index, const pliant_model &model, const pliant_data &data, const ros::Time &now)
{
    Tool &tool = *tools_[index];
    bool contact_due = tool.contact_out.getNumSubscribers() > 0 && tool.contact_rate.due(CONTACT_RATE);
    bool marker_due = tool.marker_out.getNumSubscribers() > 0 && tool.marker_rate.due(CONTACT_RATE);
    if (!contact_due && !marker_due) return;
    double clearance = pliant_tool_clearance(&model, &data, static_cast<int>(index));
    ContactState contact;
    contact.header.stamp = now;
    contact.header.frame_id = tissue_frame_;
    const pliant_tool_state state = tool_state(data, static_cast<int>(index));
    contact_message(state, clearance, tool_contacts(data, static_cast<int>(index)), &contact);
    if (contact_due) publish_with_priority(tool.contact_out, contact);
    if (!marker_due) return;
    visualization_msgs::MarkerArray markers;
    tool_markers_message(state, clearance, contact.header, &markers);
    pliant_tool_shape shape = tool.parameters.shape;
    if (tool.parameters.shape_follows) {
        std::lock_guard<InheritingMutex> hold(tool.lock);
        shape = tool.shape;
    }
    shape_markers_message(state, shape, contact.header, &markers);
    publish_with_priority(tool.marker_out, markers);
}

void Tools::publish_cut(size_t index, const pliant_data &data, uint32_t revision, const ros::Time &now)
{
    Tool &tool = *tools_[index];
    if (!tool.parameters.has_blade()) return;
    const pliant_tool_state state = tool_state(data, static_cast<int>(index));
    Cut &sent = tool.sent;
    const bool same = sent.cutting == state.cutting && sent.engaged == state.engaged && sent.stroke == state.stroke &&
                      sent.severed_area == state.severed_area && sent.revision == revision;
    if (same) return;
    cut_message(state, &sent);
    sent.revision = revision;
    sent.header.stamp = now;
    publish_with_priority(tool.cut_out, sent);
}

std::vector<ToolHealth> Tools::health(const ros::Time &now)
{
    std::vector<ToolHealth> all;
    ros::WallTime wall = ros::WallTime::now();
    for (auto &each : tools_) {
        Tool &tool = *each;
        std::lock_guard<InheritingMutex> hold(tool.lock);
        double elapsed = (wall - tool.counted_at).toSec();
        ToolHealth health;
        health.name = tool.parameters.name;
        health.rate = elapsed > 0 ? (tool.received - tool.counted) / elapsed : 0;
        health.age = tool.has_pose ? seconds_between(tool.stamp, now) : std::numeric_limits<double>::infinity();
        health.present = tool.present;
        health.why = tool.present ? "" : tool.why;
        health.saturated = tool.saturated;
        health.rests = (ros::SteadyTime::now() - tool.rests_since).toSec() > rest_seconds;
        health.proxy_error = tool.proxy_error;
        health.jaw_error = tool.jaw_error;
        tool.counted = tool.received;
        tool.counted_at = wall;
        all.push_back(health);
    }
    return all;
}

} // namespace pliant_ros
