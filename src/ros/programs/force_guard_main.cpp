/* The only way from the simulation's forces to a surgeon's hand: a process of its own, without a GPU and without a scan, that passes them on
 * while everything is as it should be and sends zeros where it is not (ros/guard/guard.h has the table). Off unless ~haptic is true.
 *
 * In, in the tissue's namespace: <tool>/measured_cf, <tool>/measured_cp, state, timing; following (std_msgs/Bool of the teleoperation, to be
 * remapped). Out: servo_cf (geometry_msgs/WrenchStamped) and set_cf_orientation_absolute (std_msgs/Bool, latched), to be remapped to the
 * hand controller's; /diagnostics.
 * Private parameters: tool, haptic (false), needs_following (true), gain, max_force [N], max_rate [N/s], cutoff [Hz], ramp [s], tail [s],
 * timeout [s], max_error [m; below 0: any], rate (200) [Hz]. */
#include "pliant/ros/convert.h"
#include "ros/guard/guard.h"
#include "ros/params/master_watch.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/WrenchStamped.h>
#include <pliant/SimState.h>
#include <pliant/StepTiming.h>
#include <ros/ros.h>
#include <ros/xmlrpc_manager.h>
#include <std_msgs/Bool.h>

#include <cmath>
#include <csignal>

namespace {

volatile std::sig_atomic_t stop = 0;
void on_signal(int) { stop = 1; }
/* rosnode kill: zeros go out before the connections end */
void on_shutdown(XmlRpc::XmlRpcValue &parameters, XmlRpc::XmlRpcValue &result)
{
    if (parameters.getType() == XmlRpc::XmlRpcValue::TypeArray && parameters.size() > 1) stop = 1;
    result = ros::xmlrpc::responseInt(1, "", 0);
}

bool positive(const ros::NodeHandle &own, const char *name, double *value)
{
    *value = own.param(name, *value);
    if (std::isfinite(*value) && *value > 0) return true;
    ROS_FATAL("~%s: %g is not a number above 0", name, *value);
    return false;
}

bool read(const ros::NodeHandle &own, pliant_ros::GuardSettings *settings, double *rate)
{
    settings->enabled = own.param("haptic", false);
    settings->needs_following = own.param("needs_following", true);
    const bool good = positive(own, "gain", &settings->gain) && positive(own, "max_force", &settings->largest) && positive(own, "max_rate", &settings->rate) &&
                      positive(own, "cutoff", &settings->cutoff) && positive(own, "ramp", &settings->ramp) && positive(own, "tail", &settings->tail) &&
                      positive(own, "timeout", &settings->timeout) && positive(own, "rate", rate);
    settings->largest_error = own.param("max_error", settings->largest_error);
    if (settings->largest_error < 0) settings->largest_error = INFINITY;
    if (good && settings->largest > 10) ROS_WARN("~max_force: %g N is more than hand controllers are made for", settings->largest);
    return good;
}

double monotonic() { return ros::SteadyTime::now().toSec(); }

} // namespace

int main(int argc, char **argv)
{
    ros::init(argc, argv, "force_guard", ros::init_options::NoSigintHandler);
    std::signal(SIGINT, on_signal);
    std::signal(SIGTERM, on_signal);
    ros::XMLRPCManager::instance()->unbind("shutdown");
    ros::XMLRPCManager::instance()->bind("shutdown", on_shutdown);
    ros::NodeHandle handle, own("~");
    pliant_ros::GuardSettings settings;
    double rate = 200;
    const std::string tool = own.param<std::string>("tool", "");
    if (tool.empty()) ROS_FATAL("~tool: the name of the tool whose forces are to be felt, such as PSM1");
    if (tool.empty() || !read(own, &settings, &rate)) return 1;

    pliant_ros::Guard guard(settings);
    ros::TransportHints hints = ros::TransportHints().tcpNoDelay();
    auto pose = handle.subscribe<topic_tools::ShapeShifter>(tool + "/measured_cp", 1, [&](const topic_tools::ShapeShifter::ConstPtr &message) {
        geometry_msgs::PoseStamped sent;
        pliant_ros::Rigid tip;
        std::string why;
        guard.pose(monotonic(), pliant_ros::pose_from_any_message(*message, "any", &sent, &why) && pliant_ros::tool_pose_from_message(sent, &tip, &why));
    }, ros::VoidConstPtr(), hints);
    std::string frame;
    auto wrench = handle.subscribe<geometry_msgs::WrenchStamped>(tool + "/measured_cf", 1, [&](const geometry_msgs::WrenchStampedConstPtr &message) {
        const double force[3] = {message->wrench.force.x, message->wrench.force.y, message->wrench.force.z};
        frame = message->header.frame_id;
        guard.wrench(monotonic(), force);
    }, ros::VoidConstPtr(), hints);
    auto following = handle.subscribe<std_msgs::Bool>("following", 1, [&](const std_msgs::BoolConstPtr &message) { guard.following(message->data); },
                                                      ros::VoidConstPtr(), hints);
    auto state = handle.subscribe<pliant::SimState>("state", 1, [&](const pliant::SimStateConstPtr &message) {
        guard.simulation(message->state == pliant::SimState::RUNNING);
    }, ros::VoidConstPtr(), hints);
    auto timing = handle.subscribe<pliant::StepTiming>("timing", 1, [&](const pliant::StepTimingConstPtr &message) {
        guard.error(monotonic(), message->error);
    }, ros::VoidConstPtr(), hints);
    /* whoever comes once it is closed feels the last force of a guard before it still; the zeros so far went to others */
    const ros::SubscriberStatusCallback comes = [&](const ros::SingleSubscriberPublisher &hand) {
        const bool moves = guard.state() == pliant_ros::GuardState::RISING || guard.state() == pliant_ros::GuardState::OPEN;
        if (!settings.enabled || moves) return;
        geometry_msgs::WrenchStamped zero;
        zero.header.stamp = ros::Time::now();
        zero.header.frame_id = frame;
        hand.publish(zero);
    };
    ros::Publisher out = handle.advertise<geometry_msgs::WrenchStamped>("servo_cf", 1, comes);
    ros::Publisher absolute = handle.advertise<std_msgs::Bool>("set_cf_orientation_absolute", 1, true);
    if (settings.enabled) {
        std_msgs::Bool yes; /* forces are in the axes of the arm's reference frame, not in those of the hand */
        yes.data = true;
        absolute.publish(yes);
    }
    pliant_ros::MasterWatch master(own, nullptr);
    diagnostic_updater::Updater diagnostics;
    diagnostics.setHardwareID(tool);
    diagnostics.add("force guard", [&](diagnostic_updater::DiagnosticStatusWrapper &status) {
        const std::string why = guard.why(monotonic());
        status.summary(diagnostic_msgs::DiagnosticStatus::OK, why.empty() ? pliant_ros::guard_state_name(guard.state()) : "closed: " + why);
        status.add("state", pliant_ros::guard_state_name(guard.state()));
        if (!master.problem().empty()) status.mergeSummary(diagnostic_msgs::DiagnosticStatus::WARN, master.problem());
        status.add("updates held back by max_force or max_rate", guard.clamped());
    });

    const auto send = [&](const pliant_ros::Guard::Output &output) {
        if (!output.send) return;
        geometry_msgs::WrenchStamped message;
        message.header.stamp = ros::Time::now();
        message.header.frame_id = frame;
        message.wrench.force.x = output.force[0], message.wrench.force.y = output.force[1], message.wrench.force.z = output.force[2];
        out.publish(message);
    };
    bool heard = false; /* by a hand controller: the first it gets are zeros */
    for (ros::WallRate turn(rate); ros::ok() && !stop; turn.sleep()) {
        ros::spinOnce();
        heard = heard || out.getNumSubscribers() > 0;
        if (heard) send(guard.update(monotonic()));
        diagnostics.update();
    }
    if (settings.enabled) send(guard.shut_down());
    ros::WallDuration(0.05).sleep(); /* it is on its way */
    ros::shutdown();
    return 0;
}
