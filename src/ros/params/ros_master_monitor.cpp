#include "ros/params/ros_master_monitor.h"

#include <ros/connection_manager.h>
#include <ros/master.h>
#include <ros/network.h>
#include <ros/param.h>
#include <ros/publication.h>
#include <ros/this_node.h>
#include <ros/topic_manager.h>
#include <ros/xmlrpc_manager.h>

#include <chrono>
#include <set>

namespace pliant_ros {

namespace {

using XmlRpc::XmlRpcValue;

const std::chrono::seconds period(1);
enum { CHECKS_PER_LIST = 16 /* checks between updates of the advertised names */, NOT_REGISTERED = -1 };

/* Call the master. Return false if it does not answer or refuses. */
bool call_master(const char *what, const std::vector<std::string> &words, XmlRpcValue *payload)
{
    XmlRpcValue request, response;
    request[0] = ros::this_node::getName();
    for (size_t i = 0; i < words.size(); ++i) request[static_cast<int>(i) + 1] = words[i];
    return ros::master::execute(what, request, response, *payload, false);
}

/* Return the services of this process that the master has registered. */
std::vector<std::string> registered_services()
{
    XmlRpcValue state;
    std::vector<std::string> out;
    if (!call_master("getSystemState", {}, &state)) return out;
    for (int i = 0; i < state[2].size(); ++i)
        for (int k = 0; k < state[2][i][1].size(); ++k)
            if (static_cast<std::string>(state[2][i][1][k]) == ros::this_node::getName()) out.push_back(state[2][i][0]);
    return out;
}

/* Call this process's own slave API as the master does. */
bool call_own(const char *what, const XmlRpcValue &request, XmlRpcValue *payload)
{
    std::string host;
    uint32_t port;
    XmlRpcValue response;
    if (!ros::network::splitURI(ros::XMLRPCManager::instance()->getServerURI(), host, port)) return false;
    XmlRpc::XmlRpcClient client(host.c_str(), static_cast<int>(port), "/");
    return client.execute(what, request, response) &&
           ros::XMLRPCManager::instance()->validateXmlrpcResponse(what, response, *payload);
}

/* Update the publishers of a topic: the reported ones and the connected ones. A restarted master does not have all of
 * them. */
void update_publishers(const std::string &topic, XmlRpcValue known)
{
    std::set<std::string> all;
    for (int i = 0; i < known.size(); ++i) all.insert(known[i]);
    XmlRpcValue request, links, ignored;
    request[0] = ros::this_node::getName();
    if (all.empty() || !call_own("getBusInfo", request, &links)) return;
    for (int i = 0; i < links.size(); ++i)
        if (static_cast<std::string>(links[i][2]) == "i" && static_cast<std::string>(links[i][4]) == topic)
            all.insert(links[i][1]);
    request[1] = topic;
    int count = 0;
    for (const std::string &uri : all) request[2][count++] = uri;
    call_own("publisherUpdate", request, &ignored);
}

} // namespace

RosMasterMonitor::RosMasterMonitor(ros::NodeHandle private_handle, std::function<void()> on_reregistration)
    : private_name_(private_handle.getNamespace()), on_reregistration_(std::move(on_reregistration))
{
    if (!ros::param::get(private_name_, parameters_)) parameters_ = XmlRpcValue();
    thread_ = std::thread(&RosMasterMonitor::run, this);
}

RosMasterMonitor::~RosMasterMonitor()
{
    {
        std::lock_guard<std::mutex> hold(lock_);
        stopping_ = true;
    }
    ends_.notify_all();
    thread_.join();
}

void RosMasterMonitor::run()
{
    std::unique_lock<std::mutex> hold(lock_);
    while (!stopping_) {
        hold.unlock();
        try {
            check_master();
        } catch (const XmlRpc::XmlRpcException &) { /* the master did not answer; try again at the next period */
        }
        hold.lock();
        ends_.wait_for(hold, period, [this] { return stopping_; });
    }
}

void RosMasterMonitor::check_master()
{
    XmlRpcValue process, address;
    if (!call_master("getPid", {}, &process)) {
        if (problem_.get().empty())
            ROS_WARN("the master does not answer: existing connections continue, new nodes are not found");
        problem_.set("the master does not answer: existing connections continue, new nodes are not found");
        return;
    }
    const int now = process; /* in a container, a restarted master often has the same process ID */
    if (master_ != 0 && (now != master_ || !call_master("lookupNode", {ros::this_node::getName()}, &address))) {
        if (ros::isShuttingDown()) return; /* the node has unregistered itself */
        master_ = NOT_REGISTERED;
        if (!register_again()) {
            problem_.set(
                "the master was restarted and has not yet registered all topics, services and parameters of this node");
            return;
        }
        ++num_reregistrations_;
        ROS_WARN("the master was restarted: topics, services and parameters of this node are registered again");
        if (on_reregistration_) on_reregistration_();
    } else if (num_checks_++ % CHECKS_PER_LIST == 0) {
        const std::vector<std::string> services = registered_services();
        if (!services.empty()) services_ = services;
    }
    master_ = now;
    problem_.set("");
}

bool RosMasterMonitor::register_again()
{
    bool good = true;
    XmlRpcValue request, response, ignored;
    request[0] = ros::this_node::getName();
    request[1] = private_name_;
    request[2] = parameters_;
    if (parameters_.valid()) good = ros::master::execute("setParam", request, response, ignored, false);
    const std::string own = ros::XMLRPCManager::instance()->getServerURI();
    const std::string services =
        "rosrpc://" + ros::network::getHost() + ":" + std::to_string(ros::ConnectionManager::instance()->getTCPPort());
    for (const std::string &service : services_)
        good = call_master("registerService", {service, services, own}, &ignored) && good;
    std::vector<std::string> topics, subscribed;
    ros::TopicManager::instance()->getAdvertisedTopics(topics);
    for (const std::string &topic : topics)
        if (ros::PublicationPtr publication = ros::TopicManager::instance()->lookupPublication(topic))
            good = call_master("registerPublisher", {topic, publication->getDataType(), own}, &ignored) && good;
    ros::TopicManager::instance()->getSubscribedTopics(subscribed);
    for (const std::string &topic : subscribed) {
        XmlRpcValue publishers;
        if (call_master("registerSubscriber", {topic, "*", own}, &publishers)) update_publishers(topic, publishers);
        else good = false;
    }
    return good;
}

} // namespace pliant_ros
