/* CRTK operating state of an arm. Debian's ROS has no package with crtk_msgs/operating_state, so this struct defines
 * the same wire format. */
#ifndef PLIANT_ROS_SIM_OPERATING_STATE_H
#define PLIANT_ROS_SIM_OPERATING_STATE_H

#include <ros/message_traits.h>
#include <ros/serialization.h>
#include <std_msgs/Header.h>

#include <string>

namespace pliant_ros {

struct OperatingState {
    std_msgs::Header header;
    std::string state = "DISABLED"; /* DISABLED, ENABLED, PAUSED or FAULT */
    uint8_t is_homed = 0, is_busy = 0;

    /* Return why the arm's pose is not valid; empty if it is. A PAUSED arm keeps its pose. */
    std::string why_not() const
    {
        return state != "ENABLED" && state != "PAUSED" ? "the arm is " + state : is_homed ? "" : "the arm is not homed";
    }
};

} // namespace pliant_ros

namespace ros {
namespace message_traits {

template <> struct MD5Sum<pliant_ros::OperatingState> {
    static const char *value() { return "b1bd4021639d9d9c5fbfff78d6ff3158"; }
    static const char *value(const pliant_ros::OperatingState &) { return value(); }
};
template <> struct DataType<pliant_ros::OperatingState> {
    static const char *value() { return "crtk_msgs/operating_state"; }
    static const char *value(const pliant_ros::OperatingState &) { return value(); }
};
template <> struct Definition<pliant_ros::OperatingState> {
    static const char *value()
    {
        return "std_msgs/Header header\nstring state\nbool is_homed\nbool is_busy\n"
               "================================================================================\n"
               "MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n";
    }
    static const char *value(const pliant_ros::OperatingState &) { return value(); }
};
template <> struct IsMessage<pliant_ros::OperatingState> : TrueType {};
template <> struct HasHeader<pliant_ros::OperatingState> : TrueType {};

} // namespace message_traits

namespace serialization {

template <> struct Serializer<pliant_ros::OperatingState> {
    template <typename Stream, typename T> inline static void allInOne(Stream &stream, T m)
    {
        stream.next(m.header);
        stream.next(m.state);
        stream.next(m.is_homed);
        stream.next(m.is_busy);
    }
    ROS_DECLARE_ALLINONE_SERIALIZER
};

} // namespace serialization
} // namespace ros

#endif
