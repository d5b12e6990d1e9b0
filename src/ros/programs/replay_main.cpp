/* replay [PLAYER [simulate] [BAG ...]]: the node of replay.h; PLAYER names a paused rosbag play that is to begin once the scan is loaded; the
 * bags say what the models are. */
#include "ros/record/replay.h"

#include <ros/callback_queue.h>
#include <ros/ros.h>

#include <algorithm>
#include <csignal>

namespace {

volatile std::sig_atomic_t is_over = 0;
void end(int) { is_over = 1; }

} // namespace

int main(int argc, char **argv)
{
    ros::init(argc, argv, "replay", ros::init_options::NoSigintHandler);
    std::signal(SIGINT, end);
    std::signal(SIGTERM, end);
    try {
        const bool simulates = argc > 2 && std::string(argv[2]) == "simulate";
        const std::vector<std::string> bags(argv + std::min(argc, simulates ? 3 : 2), argv + argc);
        pliant_ros::Replay replay(ros::NodeHandle(), ros::NodeHandle("~"), argc > 1 ? argv[1] : "", simulates, bags);
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
