/* replay [PLAYER [simulate]]: the node of replay.h; PLAYER names a paused rosbag play that is to begin once the scan is loaded. */
#include "ros/record/replay.h"

#include <ros/ros.h>

int main(int argc, char **argv)
{
    ros::init(argc, argv, "replay");
    try {
        pliant_ros::Replay replay(ros::NodeHandle(), ros::NodeHandle("~"), argc > 1 ? argv[1] : "",
                                   argc > 2 && std::string(argv[2]) == "simulate");
        ros::spin();
    } catch (const std::exception &wrong) {
        ROS_FATAL("%s", wrong.what());
        return 1;
    }
    return 0;
}
