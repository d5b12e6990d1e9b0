/* Forward the simulation's forces to a surgeon's hand while all gates are open, otherwise send zeros (state table in
 * ros/guard/guard.h). This separate process needs neither a GPU nor a scan, and it is the only path for forces to a
 * hand. It forwards nothing unless ~haptic is true.
 *
 * Subscribed topics, in the tissue's namespace: <tool>/measured_cf, <tool>/measured_cp, state, timing. Remap following
 * (std_msgs/Bool) to the teleoperation's topic.
 * Published topics: servo_cf (geometry_msgs/WrenchStamped) and set_cf_orientation_absolute (std_msgs/Bool, latched), to
 * be remapped to the hand controller's topics; /diagnostics.
 * Private parameters: tool, haptic (false), needs_following (true), gain, max_force [N], max_rate [N/s], cutoff [Hz],
 * ramp [s], tail [s], timeout [s], max_error [m; below 0: no limit], rate (200) [Hz], diagnostic_period (1) [s].
 * With a wrong parameter the node enters FAULT: it ignores its inputs, sends zeros, and reports the error in
 * diagnostics. It does not exit, because it would be restarted endlessly. */
#include "pliant/ros/convert.h"
#include "ros/guard/guard_parameters.h"
#include "ros/params/ros_master_monitor.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/WrenchStamped.h>
#include <pliant/SimState.h>
#include <pliant/StepTiming.h>
#include <ros/ros.h>
#include <ros/xmlrpc_manager.h>
#include <std_msgs/Bool.h>

#include <csignal>
#include <string>
#include <vector>

namespace {

volatile std::sig_atomic_t stop = 0;
void on_signal(int) { stop = 1; }
/* Handle `rosnode kill`: zeros are sent before the connections close. */
void on_shutdown(XmlRpc::XmlRpcValue &parameters, XmlRpc::XmlRpcValue &result)
{
    if (parameters.getType() == XmlRpc::XmlRpcValue::TypeArray && parameters.size() > 1) stop = 1;
    result = ros::xmlrpc::responseInt(1, "", 0);
}

double monotonic() { return ros::SteadyTime::now().toSec(); }

/* Subscribe to the inputs of the gates.
 * frame: set to the frame of the last force */
std::vector<ros::Subscriber> listen(ros::NodeHandle handle, const std::string &tool, pliant_ros::Guard *guard,
                                    std::string *frame)
{
    const ros::TransportHints hints = ros::TransportHints().tcpNoDelay();
    std::vector<ros::Subscriber> all;
    all.push_back(handle.subscribe<topic_tools::ShapeShifter>(
        tool + "/measured_cp", 1,
        [=](const topic_tools::ShapeShifter::ConstPtr &message) {
            geometry_msgs::PoseStamped sent;
            pliant_ros::Rigid tip;
            std::string why;
            guard->pose(monotonic(), pliant_ros::pose_from_any_message(*message, "any", &sent, &why) &&
                                         pliant_ros::tool_pose_from_message(sent, &tip, &why));
        },
        ros::VoidConstPtr(), hints));
    all.push_back(handle.subscribe<geometry_msgs::WrenchStamped>(
        tool + "/measured_cf", 1,
        [=](const geometry_msgs::WrenchStampedConstPtr &message) {
            const double force[3] = {message->wrench.force.x, message->wrench.force.y, message->wrench.force.z};
            *frame = message->header.frame_id;
            guard->wrench(monotonic(), force);
        },
        ros::VoidConstPtr(), hints));
    all.push_back(handle.subscribe<std_msgs::Bool>(
        "following", 1, [=](const std_msgs::BoolConstPtr &message) { guard->following(message->data); },
        ros::VoidConstPtr(), hints));
    all.push_back(handle.subscribe<pliant::SimState>("state", 1, [=](const pliant::SimStateConstPtr &message) {
        guard->simulation(message->state == pliant::SimState::RUNNING);
    }, ros::VoidConstPtr(), hints));
    all.push_back(handle.subscribe<pliant::StepTiming>("timing", 1, [=](const pliant::StepTimingConstPtr &message) {
        guard->error(monotonic(), message->error);
    }, ros::VoidConstPtr(), hints));
    return all;
}

geometry_msgs::WrenchStamped wrench_of(const double force[3], const std::string &frame)
{
    geometry_msgs::WrenchStamped message;
    message.header.stamp = ros::Time::now();
    message.header.frame_id = frame;
    message.wrench.force.x = force[0], message.wrench.force.y = force[1], message.wrench.force.z = force[2];
    return message;
}

pliant_ros::GuardParameters parameters_of(const ros::NodeHandle &own, std::string *why)
{
    XmlRpc::XmlRpcValue tree;
    if (!ros::param::get(own.getNamespace(), tree)) tree = XmlRpc::XmlRpcValue();
    pliant_ros::GuardParameters parameters;
    if (!pliant_ros::read_guard_parameters(tree, &parameters, why))
        ROS_FATAL("%s. No force passes: correct the parameter (rosparam set, or the launch file) and restart this node",
                  why->c_str());
    else {
        if (parameters.settings.largest > 10)
            ROS_WARN("~max_force: %g N exceeds the rated force of common hand controllers; use 10 or less",
                     parameters.settings.largest);
        if (parameters.settings.timeout > 0.05)
            ROS_WARN("~timeout: the last force stays for up to %g s after poses or forces have ended; use 0.05 or less",
                     parameters.settings.timeout);
    }
    return parameters;
}

} // namespace

int main(int argc, char **argv)
{
    ros::init(argc, argv, "force_guard", ros::init_options::NoSigintHandler);
    std::signal(SIGINT, on_signal);
    std::signal(SIGTERM, on_signal);
    ros::XMLRPCManager::instance()->unbind("shutdown");
    ros::XMLRPCManager::instance()->bind("shutdown", on_shutdown);
    ros::NodeHandle handle, own("~");
    std::string wrong, frame;
    const pliant_ros::GuardParameters parameters = parameters_of(own, &wrong);
    const bool enabled = parameters.settings.enabled;

    pliant_ros::Guard guard(parameters.settings);
    std::vector<ros::Subscriber> heard_of;
    if (wrong.empty()) heard_of = listen(handle, parameters.tool, &guard, &frame);
    else guard.fault(wrong);
    /* A hand that connects while the guard is closed may still apply the last force of an earlier guard, and it has
     * missed the zeros sent so far. */
    const ros::SubscriberStatusCallback comes = [&](const ros::SingleSubscriberPublisher &hand) {
        const bool moves =
            guard.state() == pliant_ros::GuardState::RISING || guard.state() == pliant_ros::GuardState::OPEN;
        const double zero[3] = {0, 0, 0};
        if (enabled && !moves) hand.publish(wrench_of(zero, frame));
    };
    ros::Publisher out = handle.advertise<geometry_msgs::WrenchStamped>("servo_cf", 1, comes);
    ros::Publisher absolute = handle.advertise<std_msgs::Bool>("set_cf_orientation_absolute", 1, true);
    if (enabled) {
        std_msgs::Bool yes; /* forces use the axes of the arm's reference frame, not the hand's axes */
        yes.data = true;
        absolute.publish(yes);
    }
    pliant_ros::RosMasterMonitor master(own, nullptr);
    diagnostic_updater::Updater diagnostics;
    diagnostics.setHardwareID(parameters.tool.empty() ? "none" : parameters.tool);
    diagnostics.add("force guard", [&](diagnostic_updater::DiagnosticStatusWrapper &status) {
        const std::string why = guard.why(monotonic());
        status.summary(wrong.empty() ? diagnostic_msgs::DiagnosticStatus::OK : diagnostic_msgs::DiagnosticStatus::ERROR,
                       why.empty() ? pliant_ros::guard_state_name(guard.state()) : "closed: " + why);
        status.add("state", pliant_ros::guard_state_name(guard.state()));
        if (!master.problem().empty()) status.mergeSummary(diagnostic_msgs::DiagnosticStatus::WARN, master.problem());
        status.add("updates held back by max_force or max_rate", guard.clamped());
    });

    bool heard = false; /* whether a hand controller is connected; its first messages are zeros */
    for (ros::WallRate turn(parameters.rate); ros::ok() && !stop; turn.sleep()) {
        ros::spinOnce();
        heard = heard || out.getNumSubscribers() > 0;
        if (heard) {
            const pliant_ros::Guard::Output now = guard.update(monotonic());
            if (now.send) out.publish(wrench_of(now.force, frame));
        }
        diagnostics.update();
    }
    if (enabled) out.publish(wrench_of(guard.shut_down().force, frame));
    ros::WallDuration(0.05).sleep(); /* leave time for the last message to be sent */
    ros::shutdown();
    return 0;
}
