/* replay [PLAYER [simulate] [described] [start=SECONDS] [BAG ...]]: the node of replay.h; PLAYER names a paused rosbag play that is to begin once the
 * scan is loaded, and plays these bags from so many seconds on; described: they say what the models are. */
#include "ros/record/replay.h"

#include <ros/callback_queue.h>
#include <ros/ros.h>

#include <csignal>
#include <cstdlib>

namespace {

volatile std::sig_atomic_t is_over = 0;
void end(int) { is_over = 1; }

pliant_ros::Playing playing_of(int argc, char **argv)
{
    const std::string start = "start=";
    pliant_ros::Playing out;
    if (argc > 1) out.player = argv[1];
    for (int a = 2; a < argc; ++a) {
        const std::string word = argv[a];
        if (word == "simulate") out.simulates = true;
        else if (word == "described") out.described = true;
        else if (word.compare(0, start.size(), start) == 0) out.start = std::strtod(word.c_str() + start.size(), nullptr);
        else out.bags.push_back(word);
    }
    return out;
}

} // namespace

int main(int argc, char **argv)
{
    ros::init(argc, argv, "replay", ros::init_options::NoSigintHandler);
    std::signal(SIGINT, end);
    std::signal(SIGTERM, end);
    try {
        pliant_ros::Replay replay(ros::NodeHandle(), ros::NodeHandle("~"), playing_of(argc, argv));
        while (ros::ok() && !is_over) ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.1));
        /* whoever comes next on this master would wait for a clock that nobody sends any more */
        if (ros::ok() && ros::Time::isSimTime()) ros::param::set("/use_sim_time", false);
        ros::shutdown();
    } catch (const std::exception &wrong) {
        ROS_FATAL("%s", wrong.what());
        return 1;
    }
    return 0;
}
