#include "pliant/ros/node.h"
#include "ros/node/faulted_node.h"
#include "ros/params/start.h"

#include "programs/stop.h"

#include <ros/ros.h>

#ifdef __GLIBC__
#include <malloc.h>
#endif

int main(int argc, char **argv)
{
    ros::init(argc, argv, "sim", ros::init_options::NoSigintHandler);
    /* works during a load and during a step of a large model, too */
    stop_on_signals([](int) { ros::requestShutdown(); });
#ifdef __GLIBC__
    /* Return freed volumes to the system instead of fragmenting the heap of every thread. */
    mallopt(M_MMAP_THRESHOLD, 1 << 20);
#endif
    ros::NodeHandle handle, own("~"); /* without a node handle, ROS shuts down together with its console */
    try {
        pliant_ros::Node node(handle, own);
        ros::MultiThreadedSpinner(2).spin();
    } catch (const pliant_ros::WrongParameter &wrong) {
        ROS_FATAL("%s", wrong.what());
        if (!own.param("respawn", false)) return 1;
        const pliant_ros::FaultedNode refused(handle, own, wrong.what());
        ros::spin();
    } catch (const std::exception &failed) { /* for example a missing file, which may exist at the next start */
        ROS_FATAL("%s", failed.what());
        if (own.param("respawn", false)) ros::WallDuration(1).sleep();
        return 1;
    }
    return 0;
}
