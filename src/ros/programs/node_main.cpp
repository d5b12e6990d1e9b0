#include "pliant/ros/node.h"

#include <ros/ros.h>

int main(int argc, char **argv)
{
    ros::init(argc, argv, "sim");
    ros::NodeHandle handle, own("~"); /* without one, ROS shuts down, and its console with it */
    try {
        pliant_ros::Node node(handle, own);
        ros::MultiThreadedSpinner(2).spin();
    } catch (const std::exception &wrong) {
        ROS_FATAL("%s", wrong.what());
        return 1;
    }
    return 0;
}
