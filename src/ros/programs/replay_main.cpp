/* replay [PLAYER [simulate]]: the node of replay.h; PLAYER names a paused rosbag play that is to begin once the scan is loaded. */
#include "ros/record/replay.h"

#include <ros/callback_queue.h>
#include <ros/ros.h>

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
        pliant_ros::Replay replay(ros::NodeHandle(), ros::NodeHandle("~"), argc > 1 ? argv[1] : "",
                                   argc > 2 && std::string(argv[2]) == "simulate");
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
