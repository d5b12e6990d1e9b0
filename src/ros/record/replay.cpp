#include "ros/record/replay.h"

#include "ros/params/start.h"

#include <ros/master.h>
#include <ros/ros.h>
#include <std_srvs/SetBool.h>

#include <algorithm>
#include <cstdio>
#include <iterator>

namespace pliant_ros {

namespace {

enum {
    PATIENCE_SECONDS = 2 /* for what topics bring in another order */,
    PLAYER_SECONDS = 60,
    CONNECTION_SECONDS = 20 /* the master may know of listeners and publishers that are gone */,
    LOG_SECONDS = 5,
    MAX_RECENT = 16 /* topologies */
};

/* Return whether a topic has subscribers, according to the master. */
bool has_listener(const std::string &topic)
{
    XmlRpc::XmlRpcValue request, answer, state;
    request[0] = ros::this_node::getName();
    if (!ros::master::execute("getSystemState", request, answer, state, false)) return false;
    XmlRpc::XmlRpcValue &subscribed = state[1];
    for (int i = 0; i < subscribed.size(); ++i)
        if (static_cast<const std::string &>(subscribed[i][0]) == topic) return true;
    return false;
}

bool is_late(Clock::time_point arrival)
{
    return Clock::now() - arrival > std::chrono::seconds(PATIENCE_SECONDS);
}

/* Return whether a topology belongs to the load that this session describes, or to a later one. */
bool belongs_to_session(const Session &session, const MeshTopology &topology)
{
    return topology.revision >= session.load && topology.header.stamp >= session.header.stamp;
}

} // namespace

Replay::Replay(ros::NodeHandle handle, ros::NodeHandle private_handle, const ReplaySettings &playing)
    : parameters_(parameters_of(private_handle)), playing_(playing), simulates_(playing.simulates),
      scan_finder_(parameters_.scan, parameters_.scene.material.labels), live_(private_handle, parameters_),
      volume_output_(handle, parameters_, &live_, &snapshots_, nullptr)
{
    log_to_rosconsole();
    topics_ = Topics{handle.resolveName("session"), handle.resolveName("mesh/topology"),
                     simulates_ ? handle.resolveName("step") : std::string()};
    /* Build the first model before the bags are played. */
    const pliant::SessionConstPtr first = playing.described ? first_session(playing.bags, topics_.session) : nullptr;
    described_ = first != nullptr;
    if (simulates_) check_steps(playing.bags, topics_.step);
    if (first) session_ = *first;
    /* Subscribe before the scan is loaded, with unlimited queues, so that no message is lost during the load. */
    if (described_) sessions_ = handle.subscribe("session", 0, &Replay::take_session, this);
    topologies_ = handle.subscribe("mesh/topology", 0, &Replay::take_topology, this);
    if (simulates_) steps_ = handle.subscribe("step", 0, &Replay::take_step, this, ros::TransportHints().tcpNoDelay());
    else states_ = handle.subscribe("mesh/state", 0, &Replay::take_state, this, ros::TransportHints().tcpNoDelay());
    scan_info_ = handle.advertise<ScanInfo>("scan_info", 1, true);
    if (!parameters_.parent_frame.empty()) broadcaster_.sendTransform(tissue_transform(parameters_));
    load();
    if (playing.start > 0) process_skipped_messages();
    if (!playing.player.empty()) start_player(handle.resolveName(playing.player), handle.resolveName("volume"));
}

Replay::~Replay()
{
    sessions_.shutdown();
    topologies_.shutdown();
    states_.shutdown();
    steps_.shutdown();
}

void Replay::print_summary() const
{
    std::printf("replay: %lu states shown, %lu dropped\n", static_cast<unsigned long>(shown_),
                static_cast<unsigned long>(dropped_));
    if (rerun_) std::printf("replay: %s\n", rerun_->summary().c_str());
    std::fflush(stdout); /* the process may be killed at any time */
}

/* Process the messages before the start time, which the player skips. */
void Replay::process_skipped_messages()
{
    const PrecedingMessages earlier =
        read_messages_before(playing_.bags, playing_.start, topics_, playing_.may_continue);
    if (described_ && earlier.session) begin_session(*earlier.session);
    for (const pliant::MeshTopologyConstPtr &topology : earlier.topologies)
        /* the session message may have been repeated in the meantime */
        if (!described_ || topology->revision >= session_.load) fit(*topology);
    if (!simulates_ || earlier.steps.empty() || earlier.steps.front()->sequence != 1) return;
    const auto known = bodies_.find(earlier.steps.front()->load);
    if (known != bodies_.end() && known->second.body) recompute_steps(earlier.steps);
    else
        ROS_ERROR(
            "replay: the steps before the start are not recomputed, because their model is missing; replay continues "
            "at the next reset");
}

void Replay::recompute_steps(const std::vector<pliant::StepConstPtr> &steps)
{
    Clock::time_point last_logged = Clock::now();
    ROS_INFO("replay: the %zu steps before the start are recomputed", steps.size());
    try {
        for (size_t s = 0; s < steps.size() && playing_.may_continue(); ++s) {
            if (!rerun_->take(*steps[s])) return;
            if (Clock::now() - last_logged < std::chrono::seconds(LOG_SECONDS)) continue;
            last_logged = Clock::now();
            ROS_INFO("replay: %zu of %zu", s + 1, steps.size());
        }
        snapshots_.put(rerun_->snapshot());
    } catch (const Failure &broken) {
        ROS_ERROR("replay: %s", broken.what());
    }
}

pliant_progress Replay::make_cancellable_progress()
{
    return pliant_progress{
        [](double, const char *, void *replay) { return static_cast<Replay *>(replay)->playing_.may_continue(); },
        this};
}

/* Detect that a player in a loop has restarted, and process the messages before its start time again. */
void Replay::detect_player_restart(ros::Time stamp)
{
    const bool begins_anew = stamp < newest_;
    newest_ = stamp;
    if (!begins_anew || playing_.start <= 0) return;
    process_waiting_messages();
    try {
        process_skipped_messages();
    } catch (const std::runtime_error &broken) {
        ROS_ERROR("replay: the messages before the start could not be read: %s", broken.what());
    }
}

void Replay::load()
{
    if (described_) {
        install_model(build_session(session_, scan_finder_.find(session_), make_cancellable_progress()));
        return;
    }
    Materials materials;
    std::shared_ptr<const Scan> scan = read_scan(parameters_.scene, parameters_.scan, &materials);
    install_model(build(parameters_.scene, scan, materials.table, make_cancellable_progress()));
}

void Replay::install_model(std::shared_ptr<const LoadedModel> loaded)
{
    before_ = loaded_;
    loaded_ = std::move(loaded);
    made_ = Bodies{};
    /* Topologies that arrived before their session may belong to the previous model; older entries are obsolete. */
    for (auto known = bodies_.begin(); known != bodies_.end();)
        known = known->second.loaded == before_ ? std::next(known) : bodies_.erase(known);
    if (simulates_ && !rerun_) rerun_.reset(new Rerun(loaded_));
    else if (simulates_) rerun_->set_model(loaded_);
    if (described_) {
        pliant_scene live = *pliant_model_get_scene(loaded_->model);
        apply_settings(session_, &live);
        live_.assign(live);
    }
    auto info = boost::make_shared<ScanInfo>();
    info->header.stamp = ros::Time::now();
    info->header.frame_id = parameters_.tissue_frame;
    info->scan_id = loaded_->scan->volume.id;
    scan_info_message(*loaded_->model, loaded_->scan->low, loaded_->scan->high, info.get());
    scan_info_.publish(info);
    ROS_INFO("replay: loaded %s%s: %d nodes, %d tetrahedra", loaded_->scan->path.c_str(),
             described_ ? " as the bag says" : "", pliant_model_get_body(loaded_->model)->fine.num_nodes,
             pliant_model_get_body(loaded_->model)->fine.num_tets);
}

void Replay::take_session(const pliant::SessionConstPtr &session)
{
    waiting_sessions_.push_back(WaitingSession{session, Clock::now()});
    process_waiting_messages();
}

/* Return whether the next session may begin. A different model begins only after all states of the previous one are
 * shown. States arrive in order, so the first state or step of the new load shows that. */
bool Replay::may_begin(const WaitingSession &next) const
{
    const bool same = loaded_ && same_model(session_, *next.session), other_load = next.session->load != session_.load;
    if (same && (!other_load || !simulates_)) return true;
    return (!pending_.empty() && pending_.front().topology >= next.session->load) || is_late(next.arrival);
}

bool Replay::is_of_waiting_session(const MeshTopology &topology) const
{
    return !waiting_sessions_.empty() && belongs_to_session(*waiting_sessions_.front().session, topology);
}

void Replay::begin_session(const Session &session)
{
    const bool same = loaded_ && same_model(session_, session), other_load = session.load != session_.load;
    session_ = session;
    if (same && !other_load) return;
    try {
        if (!same) install_model(build_session(session_, scan_finder_.find(session_), make_cancellable_progress()));
        else if (simulates_) rerun_->set_model(loaded_);
    } catch (const Failure &failed) {
        before_ = loaded_;
        loaded_.reset();
        ROS_ERROR("replay: the model from revision %u on is not shown: %s", session_.load, failed.what());
    }
    for (const pliant::MeshTopologyConstPtr &topology : recent_)
        if (belongs_to_session(session_, *topology) && !is_of_waiting_session(*topology)) fit(*topology);
    /* no message could be processed during the load, so its time does not count */
    for (WaitingState &next : pending_) next.arrival = Clock::now();
    for (WaitingSession &next : waiting_sessions_) next.arrival = Clock::now();
}

/* Return whether every subscription to a published topic has a connection, according to the master. */
bool Replay::has_all_connections() const
{
    ros::master::V_TopicInfo published;
    if (!ros::master::getTopics(published)) return false;
    const auto is_heard = [&published](const ros::Subscriber *own) {
        const auto is_it = [own](const ros::master::TopicInfo &topic) { return topic.name == own->getTopic(); };
        return !*own || own->getNumPublishers() > 0 || std::none_of(published.begin(), published.end(), is_it);
    };
    const ros::Subscriber *const all[] = {&sessions_, &topologies_, &states_, &steps_};
    return std::all_of(std::begin(all), std::end(all), is_heard);
}

/* Start the player when all connections exist, because it does not wait for subscribers and messages sent earlier are
 * lost. The player answers only after it has advertised all topics, so it is first asked to pause, which it already
 * does. The volume topic has no queue for subscribers without a connection either. ros::service::waitForService is not
 * usable: it waits by /clock, which stands still until the player plays. */
void Replay::start_player(const std::string &name, const std::string &volume)
{
    const std::string service = name + "/pause_playback";
    const auto ask_to_pause = [&service](bool pause) {
        std_srvs::SetBool pause_request;
        pause_request.request.data = pause;
        return ros::service::exists(service, false) && ros::service::call(service, pause_request);
    };
    const Clock::time_point begin = Clock::now(), end = begin + std::chrono::seconds(PLAYER_SECONDS);
    bool has_advertised = false;
    while (playing_.may_continue() && Clock::now() < end) {
        has_advertised = has_advertised || ask_to_pause(true);
        const bool is_late = Clock::now() > begin + std::chrono::seconds(CONNECTION_SECONDS),
                   is_heard = snapshots_.wanted() || !has_listener(volume);
        if (has_advertised && (is_late || (is_heard && has_all_connections())) && ask_to_pause(false)) return;
        ros::WallDuration(0.05).sleep();
    }
    if (playing_.may_continue())
        ROS_ERROR("replay: no player at %s after %d s; start the bag by hand", service.c_str(), PLAYER_SECONDS);
}

void Replay::take_topology(const pliant::MeshTopologyConstPtr &topology)
{
    recent_.push_back(topology);
    if (recent_.size() > MAX_RECENT) recent_.pop_front();
    if (!is_of_waiting_session(*topology)) fit(*topology);
    process_waiting_messages();
}

void Replay::fit(const MeshTopology &topology)
{
    std::string why = "its model could not be made";
    std::shared_ptr<const pliant_body> body = loaded_ ? body_of(*loaded_, topology, &made_, &why) : nullptr;
    auto known = bodies_.find(topology.revision);
    /* a bag in a loop repeats the message */
    const bool is_news = known == bodies_.end() || !known->second.body != !body ||
                         (body && !pliant_body_same(body.get(), known->second.body.get()));
    bodies_[topology.revision] = KnownBody{loaded_, body};
    if (is_news && body) ROS_INFO("replay: revision %u of the mesh is available", topology.revision);
    if (is_news && !body) ROS_ERROR("replay: revision %u is not shown: %s", topology.revision, why.c_str());
}

void Replay::take_state(const pliant::MeshStateConstPtr &state)
{
    detect_player_restart(state->header.stamp);
    pending_.push_back(WaitingState{state->revision, state, nullptr, Clock::now()});
    process_waiting_messages();
}

void Replay::take_step(const pliant::StepConstPtr &step)
{
    detect_player_restart(step->header.stamp);
    pending_.push_back(WaitingState{step->load, nullptr, step, Clock::now()});
    process_waiting_messages();
}

/* Return whether a state waits for its topology, or a step for its session. */
bool Replay::waits(const WaitingState &next) const
{
    const auto known = bodies_.find(next.topology);
    if (known == bodies_.end()) return true;
    const bool may_be_of_another = described_ && !known->second.body && session_.load < next.topology;
    return may_be_of_another || (described_ && next.step && next.step->load > session_.load);
}

void Replay::process_waiting_messages()
{
    while (playing_.may_continue()) {
        const bool is_next = !pending_.empty() && (!waits(pending_.front()) ||
                                                   (waiting_sessions_.empty() && is_late(pending_.front().arrival)));
        if (is_next) {
            process_waiting_state(pending_.front());
            pending_.pop_front();
        } else if (!waiting_sessions_.empty() && may_begin(waiting_sessions_.front())) {
            const pliant::SessionConstPtr session = waiting_sessions_.front().session;
            waiting_sessions_.pop_front();
            begin_session(*session);
        } else {
            return;
        }
    }
}

void Replay::process_waiting_state(const WaitingState &next)
{
    const auto known = bodies_.find(next.topology);
    if (known == bodies_.end()) {
        ++dropped_;
        ROS_WARN_THROTTLE(
            5,
            "replay: states of revision %u are dropped: its mesh/topology has not been played; "
            "play the bag from its start",
            next.topology);
    } else if (!known->second.body) {
        ++dropped_;
        ROS_WARN_THROTTLE(5, "replay: %lu states of another scan or mesh are dropped",
                          static_cast<unsigned long>(dropped_));
    } else {
        show(next, known->second);
    }
}

void Replay::show(const WaitingState &next, const KnownBody &of)
{
    try {
        if (next.state) {
            snapshots_.put(snapshot_of(of.loaded, of.body, *next.state));
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
