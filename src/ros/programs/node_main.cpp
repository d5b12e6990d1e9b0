#include "pliant/ros/node.h"
#include "ros/node/refused.h"
#include "ros/params/start.h"

#include "programs/stop.h"

#include <ros/ros.h>

#ifdef __GLIBC__
#include <malloc.h>
#endif

int main(int argc, char **argv)
{
    ros::init(argc, argv, "sim", ros::init_options::NoSigintHandler);
    stop_on_signals([](int) { ros::requestShutdown(); }); /* also during a load, or a step of a large model */
#ifdef __GLIBC__
    mallopt(M_MMAP_THRESHOLD, 1 << 20); /* volumes come and go: what is freed goes back to the system, in place of holes in the heap of every thread */
#endif
    ros::NodeHandle handle, own("~"); /* without one, ROS shuts down, and its console with it */
    try {
        pliant_ros::Node node(handle, own);
        ros::MultiThreadedSpinner(2).spin();
    } catch (const pliant_ros::WrongParameter &wrong) {
        ROS_FATAL("%s", wrong.what());
        if (!own.param("respawn", false)) return 1;
        const pliant_ros::Refused refused(handle, own, wrong.what());
        ros::spin();
    } catch (const std::exception &failed) { /* such as a file that is not there yet: the next start may find it */
        ROS_FATAL("%s", failed.what());
        if (own.param("respawn", false)) ros::WallDuration(1).sleep();
        return 1;
    }
    return 0;
}
