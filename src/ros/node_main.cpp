#include "pliant/ros/node.h"

#include <ros/ros.h>

int main(int argc, char **argv)
{
    ros::init(argc, argv, "sim");
    try {
        pliant_ros::Node node(ros::NodeHandle(), ros::NodeHandle("~"));
        ros::MultiThreadedSpinner(2).spin();
    } catch (const std::exception &wrong) {
        ROS_FATAL("%s", wrong.what());
        return 1;
    }
    return 0;
}
