#include "ros/record/replay.h"

#include "ros/node/start.h"

#include <ros/ros.h>
#include <std_srvs/SetBool.h>

#include <cstdio>

namespace pliant_ros {

namespace {

enum { PATIENCE_SECONDS = 2 /* for a topology that comes after its states */, PLAYER_SECONDS = 60 };

} // namespace

Replay::Replay(ros::NodeHandle handle, ros::NodeHandle private_handle, const std::string &player, bool simulates)
    : parameters_(parameters_of(private_handle)), simulates_(simulates), live_(private_handle, parameters_),
      volume_output_(handle, parameters_, &live_, &snapshots_, nullptr)
{
    log_to_rosconsole();
    /* before the scan is loaded, and with all the room that there is: nothing is lost meanwhile */
    topologies_ = handle.subscribe("mesh/topology", 0, &Replay::take_topology, this);
    if (simulates_) steps_ = handle.subscribe("step", 0, &Replay::take_step, this, ros::TransportHints().tcpNoDelay());
    else states_ = handle.subscribe("mesh/state", 0, &Replay::take_state, this, ros::TransportHints().tcpNoDelay());
    scan_info_ = handle.advertise<ScanInfo>("scan_info", 1, true);
    if (!parameters_.parent_frame.empty()) broadcaster_.sendTransform(tissue_transform(parameters_));
    load();
    if (!player.empty()) start_player(handle.resolveName(player));
}

Replay::~Replay()
{
    topologies_.shutdown();
    states_.shutdown();
    steps_.shutdown();
    /* rosconsole is down by now */
    std::printf("replay: %lu states shown, %lu dropped\n", static_cast<unsigned long>(shown_), static_cast<unsigned long>(dropped_));
    if (rerun_) std::printf("replay: %s\n", rerun_->summary().c_str());
}

void Replay::load()
{
    Materials materials;
    std::shared_ptr<const Scan> scan = read_scan(parameters_.scene, parameters_.scan, &materials);
    pliant_progress progress{[](double, const char *, void *) { return ros::ok(); }, nullptr};
    loaded_ = build(parameters_.scene, scan, materials.table, progress);
    if (simulates_) rerun_.reset(new Rerun(loaded_));
    auto info = boost::make_shared<ScanInfo>();
    info->header.stamp = ros::Time::now();
    info->header.frame_id = parameters_.tissue_frame;
    info->scan_id = scan->volume.id;
    scan_info_message(*loaded_->model, scan->low, scan->high, info.get());
    scan_info_.publish(info);
    ROS_INFO("replay: loaded %s: %d nodes, %d tetrahedra", parameters_.scan.c_str(), pliant_model_get_body(loaded_->model)->fine.num_nodes,
             pliant_model_get_body(loaded_->model)->fine.num_tets);
}

/* ros::service::waitForService would wait by a clock that stands still until the player plays. */
void Replay::start_player(const std::string &name)
{
    const std::string service = name + "/pause_playback";
    Clock::time_point end = Clock::now() + std::chrono::seconds(PLAYER_SECONDS);
    std_srvs::SetBool go;
    go.request.data = false;
    while (ros::ok() && Clock::now() < end) {
        if (ros::service::exists(service, false) && ros::service::call(service, go)) return;
        ros::WallDuration(0.05).sleep();
    }
    if (ros::ok())
        ROS_ERROR("replay: no player at %s after %d s; start the bag by hand", service.c_str(), PLAYER_SECONDS);
}

void Replay::take_topology(const pliant::MeshTopologyConstPtr &topology)
{
    std::string why;
    std::shared_ptr<const pliant_body> body = body_of(*loaded_, *topology, newest_, &why);
    if (body) newest_ = body;
    auto known = bodies_.find(topology->revision);
    /* a bag in a loop says it again and again */
    bool is_news = known == bodies_.end() || !known->second != !body || (body && !pliant_body_same(body.get(), known->second.get()));
    if (is_news) bodies_[topology->revision] = body;
    if (is_news && body) ROS_INFO("replay: revision %u of the mesh is known here", topology->revision);
    if (is_news && !body) ROS_ERROR("replay: revision %u is not shown: %s", topology->revision, why.c_str());
    work_off();
}

void Replay::take_state(const pliant::MeshStateConstPtr &state)
{
    pending_.push_back(Pending{state->revision, state, nullptr, Clock::now()});
    work_off();
}

void Replay::take_step(const pliant::StepConstPtr &step)
{
    pending_.push_back(Pending{step->load, nullptr, step, Clock::now()});
    work_off();
}

void Replay::work_off()
{
    while (!pending_.empty()) {
        const Pending &next = pending_.front();
        auto known = bodies_.find(next.topology);
        bool is_late = Clock::now() - next.arrival > std::chrono::seconds(PATIENCE_SECONDS);
        if (known == bodies_.end() && !is_late) return;
        if (known == bodies_.end()) {
            ++dropped_;
            ROS_WARN_THROTTLE(5, "replay: states of revision %u are dropped: its mesh/topology has not been played; "
                              "play the bag from its start", next.topology);
        } else if (!known->second) {
            ++dropped_;
            ROS_WARN_THROTTLE(5, "replay: %lu states of another scan or mesh are dropped",
                              static_cast<unsigned long>(dropped_));
        } else {
            show(next, known->second);
        }
        pending_.pop_front();
    }
}

void Replay::show(const Pending &next, std::shared_ptr<const pliant_body> body)
{
    try {
        if (next.state) {
            snapshots_.put(snapshot_of(loaded_, std::move(body), *next.state));
        } else if (rerun_->take(*next.step)) {
            snapshots_.put(rerun_->snapshot());
        } else {
            ++dropped_;
            ROS_WARN_THROTTLE(5, "replay: steps are dropped until a load or a reset: play the bag from its start");
            return;
        }
        ++shown_;
    } catch (const Failure &broken) {
        ++dropped_;
        ROS_ERROR_THROTTLE(5, "replay: %s", broken.what());
    }
}

} // namespace pliant_ros
