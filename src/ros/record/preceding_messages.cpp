#include "ros/record/preceding_messages.h"

#include "ros/record/message.h"

#include <rosbag/bag.h>
#include <rosbag/view.h>

#include <algorithm>
#include <list>
#include <stdexcept>

namespace pliant_ros {

namespace {

/* Keep this topology. Each message contains a whole mesh, so of the older ones only the initial topology of the load
 * and the last two are kept. */
void keep(const pliant::MeshTopologyConstPtr &topology, uint32_t load, std::vector<pliant::MeshTopologyConstPtr> *kept)
{
    kept->push_back(topology);
    const auto is_over = [load](const pliant::MeshTopologyConstPtr &older) { return older->revision != load; };
    if (kept->size() > 2) kept->erase(std::remove_if(kept->begin(), kept->end() - 2, is_over), kept->end() - 2);
}

} // namespace

PrecedingMessages read_messages_before(const std::vector<std::string> &bags, double start, const Topics &topics,
                                       const std::function<bool()> &may_continue)
{
    PrecedingMessages out;
    std::list<rosbag::Bag> opened;
    rosbag::View all;
    for (const std::string &path : bags) {
        opened.emplace_back(path, rosbag::bagmode::Read);
        all.addQuery(opened.back());
    }
    if (opened.empty()) return out;
    /* rosbag play converts the start time to float, too, so no message is read twice */
    const ros::Time end = all.getBeginTime() + ros::Duration(static_cast<float>(start));
    const std::vector<std::string> wanted{topics.session, topics.topology, topics.step};
    rosbag::View before;
    for (const rosbag::Bag &bag : opened)
        before.addQuery(bag, rosbag::TopicQuery(wanted), ros::TIME_MIN, end - ros::Duration(0, 1));
    uint32_t load = 0;
    for (const rosbag::MessageInstance &recorded : before) {
        if (!may_continue()) return out;
        if (recorded.getTopic() == topics.session) {
            out.session = read_message<pliant::Session>(recorded);
            load = out.session->load;
        } else if (recorded.getTopic() == topics.topology) {
            keep(read_message<pliant::MeshTopology>(recorded), load, &out.topologies);
        } else {
            const pliant::StepConstPtr step = read_message<pliant::Step>(recorded);
            if (step->sequence == 1) out.steps.clear();
            out.steps.push_back(step);
            load = step->load;
        }
    }
    return out;
}

void check_steps(const std::vector<std::string> &bags, const std::string &topic)
{
    for (const std::string &path : bags) {
        rosbag::Bag bag(path, rosbag::bagmode::Read);
        rosbag::View view(bag, rosbag::TopicQuery(topic));
        for (const rosbag::ConnectionInfo *each : view.getConnections())
            if (each->md5sum != ros::message_traits::md5sum<pliant::Step>())
                throw Failure(
                    PLIANT_ERROR_FORMAT,
                    path +
                        ": another version of Pliant recorded its steps: replay it without simulate, or recompute it "
                        "with pliant_bag --simulate");
    }
}

pliant::SessionConstPtr first_session(const std::vector<std::string> &bags, const std::string &topic)
{
    for (const std::string &path : bags) {
        rosbag::Bag bag(path, rosbag::bagmode::Read);
        rosbag::View view(bag, rosbag::TopicQuery(topic));
        if (view.begin() != view.end()) return read_message<pliant::Session>(*view.begin());
    }
    return nullptr;
}

} // namespace pliant_ros
