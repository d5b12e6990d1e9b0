/* Play a recorded tool path (src/tool/path.h) as a robot would publish it. No robot and no display is needed. Each tool
 * publishes measured_cp and jaw/measured_js; a cutting tool publishes blade (its edge is the node's parameter
 * ~tool/<name>/blade). Instant cuts use the service.
 *
 * Private parameters: path (file), frame (frame of the path's points, default tissue), rate [Hz, 200], loop (true):
 * repeat the path, and reset the tissue before each repetition if the path cuts. Times around the path: lead [s, 1],
 * open jaw at the grasped point; hold [s, 2] at the end of the path; rest [s, 2], open jaw there. */
#include "ros/programs/tool_sender.h"

#include "tool/path.h"

#include <pliant/CutLine.h>
#include <pliant/SimState.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

namespace {

using pliant_ros::ToolSender;

struct Player {
    pliant_path path{};
    std::string frame;
    std::vector<std::unique_ptr<ToolSender>> senders;
    ros::ServiceClient cut, reset;
    double lead, hold, rest;
    bool loop, running = false;
    uint32_t cuts_made = 0;
    double rounds = 0;

    ~Player() { pliant_path_free(&path); }

    bool cuts_anything() const
    {
        return path.num_cuts > 0 || std::any_of(path.tools, path.tools + path.num_tools,
                                                [](const pliant_path_tool &tool) { return tool.num_cut > 0; });
    }

    /* time: since the start of the simulation [s] */
    void play(double time)
    {
        double end = lead + pliant_path_end(&path) + hold, round = loop ? std::floor(time / (end + rest)) : 0;
        double at = loop ? std::fmod(time, end + rest) : std::min(time, end + rest);
        if (round > rounds && cuts_anything()) heal();
        rounds = round;
        double on_path = std::min(std::max(at - lead, 0.0), pliant_path_end(&path));
        for (size_t i = 0; i < senders.size(); ++i)
            play_tool(path.tools[i], on_path, at >= lead && at < end, senders[i].get());
        for (; at >= lead && cuts_made < path.num_cuts && path.cuts[cuts_made].time <= on_path; ++cuts_made)
            make_cut(path.cuts[cuts_made]);
    }

    void play_tool(const pliant_path_tool &tool, double on_path, bool plays, ToolSender *sender) const
    {
        double position[3], rotation[4] = {0, 0, 0, 1};
        bool holds = false;
        if (!pliant_path_pose_at(&tool, on_path, position, rotation)) {
            holds = pliant_path_at(&tool, on_path, position);
            for (int d = 0; d < 3; ++d) position[d] += tool.grasp[d];
        }
        geometry_msgs::Pose tip;
        tip.position.x = position[0], tip.position.y = position[1], tip.position.z = position[2];
        tip.orientation.x = rotation[0], tip.orientation.y = rotation[1], tip.orientation.z = rotation[2],
        tip.orientation.w = rotation[3];
        if (tool.num_cut > 0) sender->send_blade(plays && pliant_path_cuts(&tool, on_path));
        sender->send(tip, holds && plays, ros::Time::now());
    }

    void make_cut(const pliant_path_cut &line)
    {
        pliant::CutLine call;
        call.request.header.frame_id = frame;
        for (uint32_t p = 0; p < line.num_points; ++p) {
            geometry_msgs::Point point;
            point.x = line.points[3 * p], point.y = line.points[3 * p + 1], point.z = line.points[3 * p + 2];
            call.request.points.push_back(point);
        }
        call.request.depth.x = line.depth[0], call.request.depth.y = line.depth[1],
        call.request.depth.z = line.depth[2];
        if (!cut.call(call) || !call.response.success)
            ROS_ERROR("cut at %g s: %s", line.time, call.response.message.c_str());
    }

    void heal()
    {
        std_srvs::Trigger call;
        if (!reset.call(call) || !call.response.success) ROS_ERROR("reset: %s", call.response.message.c_str());
        cuts_made = 0;
    }
};

bool read(ros::NodeHandle handle, const ros::NodeHandle &own, Player *player)
{
    std::string file = own.param<std::string>("path", ""), frame = own.param<std::string>("frame", "tissue");
    player->lead = std::max(0.1, own.param("lead", 1.0));
    player->hold = std::max(0.0, own.param("hold", 2.0));
    player->rest = std::max(0.1, own.param("rest", 2.0));
    player->loop = own.param("loop", true);
    if (pliant_path_read(file.c_str(), &player->path) < 0) {
        ROS_FATAL("~path: %s", pliant_last_error());
        return false;
    }
    for (uint32_t n = 0; n < player->path.num_tools; ++n)
        if (player->path.tools[n].drive == PLIANT_DRIVE_FORCE) {
            ROS_FATAL(
                "~path: %s: tool %s has drive: force, but a robot's tool sends poses: give it offsets (drive: "
                "rigid or spring)",
                file.c_str(), player->path.tools[n].name);
            return false;
        }
    for (uint32_t i = 0; i < player->path.num_tools; ++i)
        player->senders.emplace_back(new ToolSender(handle, player->path.tools[i].name, frame));
    player->frame = frame;
    player->cut = handle.serviceClient<pliant::CutLine>("cut");
    player->reset = handle.serviceClient<std_srvs::Trigger>("reset");
    return true;
}

} // namespace

int main(int argc, char **argv)
{
    ros::init(argc, argv, "scripted_tool");
    ros::NodeHandle handle, own("~");
    Player player;
    if (!read(handle, own, &player)) return 1;
    ros::Subscriber state = handle.subscribe<pliant::SimState>(
        "state", 1, [&player](const pliant::SimStateConstPtr &message) {
            if (message->state == pliant::SimState::RUNNING) player.running = true;
        });
    ros::WallRate rate(std::min(std::max(own.param("rate", 200.0), 1.0), 1000.0));
    ros::WallTime start;
    while (ros::ok()) {
        ros::spinOnce();
        if (!player.running) start = ros::WallTime::now();
        player.play((ros::WallTime::now() - start).toSec());
        rate.sleep();
    }
    return 0;
}
