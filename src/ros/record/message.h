/* Read messages of a bag, and check their version. */
#ifndef PLIANT_ROS_RECORD_MESSAGE_H
#define PLIANT_ROS_RECORD_MESSAGE_H

#include "ros/sim/loaded_model.h"

#include <pliant/Step.h>
#include <rosbag/message_instance.h>

#include <set>
#include <vector>

namespace pliant_ros {

/* Return a message for the user that explains why a recorded message is refused. */
inline std::string other_version(const rosbag::MessageInstance &recorded, const std::string &type,
                                 const std::string &md5)
{
    const std::string what = recorded.getTopic() + " in the bag is ";
    if (recorded.getDataType() != type) return what + recorded.getDataType() + ", not " + type;
    return what + type + " of another version of Pliant (md5 " + recorded.getMD5Sum() +
           "; Pliant " PLIANT_VERSION " reads " + md5 + "): use the version that recorded it, or record it again";
}

/* Throws Failure. */
template <class Message> boost::shared_ptr<const Message> read_message(const rosbag::MessageInstance &recorded)
{
    const boost::shared_ptr<const Message> out = recorded.instantiate<Message>();
    if (!out)
        throw Failure(PLIANT_ERROR_FORMAT, other_version(recorded, ros::message_traits::datatype<Message>(),
                                                         ros::message_traits::md5sum<Message>()));
    return out;
}

/* Bags of Pliant 0.1.0 until November 2026 contain Step messages without the last field, or without the last three.
 * These become 0, or empty. */
template <>
inline boost::shared_ptr<const pliant::Step> read_message<pliant::Step>(const rosbag::MessageInstance &recorded)
{
    const std::string type = ros::message_traits::datatype<pliant::Step>(),
                      md5 = ros::message_traits::md5sum<pliant::Step>();
    const std::set<std::string> readable = {md5, "7ea001853a4b85c219a652b58dba7739",
                                            "d1f0eb7fcc3149139caa1f19033b8b65"};
    auto out = boost::make_shared<pliant::Step>();
    if (recorded.getDataType() != type || readable.count(recorded.getMD5Sum()) == 0)
        throw Failure(PLIANT_ERROR_FORMAT, other_version(recorded, type, md5));
    const size_t missing = sizeof out->evaluations + sizeof out->legs + sizeof(uint32_t); /* length of `clock` */
    std::vector<uint8_t> bytes(recorded.size() + missing);
    ros::serialization::OStream to(bytes.data(), recorded.size());
    recorded.write(to);
    ros::serialization::IStream from(bytes.data(), static_cast<uint32_t>(bytes.size()));
    ros::serialization::deserialize(from, *out);
    return out;
}

} // namespace pliant_ros

#endif
