// Serialize a message of Pliant, and call a function of the ROS layer and one of the C library.
#include <pliant/ToolInput.h>
#include <pliant/ros/convert.h>

#include <ros/serialization.h>

#include <cstdio>

int main()
{
    pliant::ToolInput sent, received;
    sent.name = "forceps";
    sent.jaw = 0.25;
    ros::SerializedMessage bytes = ros::serialization::serializeMessage(sent);
    ros::serialization::deserializeMessage(bytes, received);
    pliant_ros::Rigid twice = pliant_ros::multiply(pliant_ros::identity(), pliant_ros::identity());
    std::printf("Pliant %s, %s with jaws at %g, rotation %g\n", pliant_version(), received.name.c_str(), received.jaw,
                twice.rotation[3]);
    return received == sent && twice.rotation[3] == 1 ? 0 : 1;
}
