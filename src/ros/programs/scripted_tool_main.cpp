/* Plays a recorded tool path (pliant/path.h) as a robot would send it: measured_cp and jaw/measured_js of every tool in
 * it. No robot and no display needed.
 *
 * Private parameters: path (file), frame (of the path's points, default tissue), rate [Hz, 200], loop (true): begin
 * anew after the end. Around the path: lead [s, 1], open jaw at the grasped point; hold [s, 2], where the path ends;
 * rest [s, 2], open jaw there. */
#include "ros/programs/tool_sender.h"

#include "pliant/path.h"

#include <pliant/SimState.h>
#include <ros/ros.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

namespace {

using pliant_ros::ToolSender;

struct Player {
    pliant_path path{};
    std::vector<std::unique_ptr<ToolSender>> senders;
    double lead, hold, rest;
    bool loop, running = false;

    ~Player() { pliant_path_free(&path); }

    /* time: since the simulation began to run [s] */
    void play(double time)
    {
        double end = lead + pliant_path_end(&path) + hold;
        double at = loop ? std::fmod(time, end + rest) : std::min(time, end + rest);
        ros::Time now = ros::Time::now();
        for (size_t i = 0; i < senders.size(); ++i) {
            const pliant_path_tool &tool = path.tools[i];
            double offset[3], on_path = std::min(std::max(at - lead, 0.0), pliant_path_end(&path));
            bool holds = pliant_path_at(&tool, on_path, offset);
            geometry_msgs::Pose tip;
            tip.position.x = tool.grasp[0] + offset[0];
            tip.position.y = tool.grasp[1] + offset[1];
            tip.position.z = tool.grasp[2] + offset[2];
            tip.orientation.w = 1;
            senders[i]->send(tip, holds && at >= lead && at < end, now);
        }
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
            ROS_FATAL("~path: %s: tool %s has drive: force, but a robot's tool sends poses: give it offsets (drive: rigid or spring)", file.c_str(),
                      player->path.tools[n].name);
            return false;
        }
    for (uint32_t i = 0; i < player->path.num_tools; ++i) {
        const pliant_path_tool &tool = player->path.tools[i];
        if (tool.drive == PLIANT_DRIVE_FORCE) {
            ROS_FATAL("%s: tool %s is driven by force, which poses cannot play", file.c_str(), tool.name);
            return false;
        }
        player->senders.emplace_back(new ToolSender(handle, tool.name, frame));
    }
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
