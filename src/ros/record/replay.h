/* Compute the deformed volumes of a recording. The node warps every mesh/state that a bag plays, or recomputes every
 * step. */
#ifndef PLIANT_ROS_RECORD_REPLAY_H
#define PLIANT_ROS_RECORD_REPLAY_H

#include "ros/output/mesh_output.h"
#include "ros/record/preceding_messages.h"
#include "ros/record/recorded.h"
#include "ros/record/rerun.h"
#include "ros/sim/session.h"
#include "ros/output/volume_output.h"

#include <tf2_ros/static_transform_broadcaster.h>

#include <deque>
#include <functional>
#include <map>

namespace pliant_ros {

/* Input and mode of a replay. */
struct ReplaySettings {
    /* name of a paused `rosbag play` of these bags, which the node starts; empty: none */
    std::string player;
    std::vector<std::string> bags;
    double start = 0;              /* time at which playback starts [s] */
    bool simulates = false;        /* recompute every step */
    bool described = false;        /* sessions in the bags, if any, define the model; false: the parameters do */
    std::function<bool()> may_continue = [] { return true; }; /* called during long work; return false to stop */
};

/* Subscribe to session, mesh/topology and mesh/state of a bag. Publish volume and its slices with the stamps of the
 * states, and scan_info. Models are built from the bag's sessions, or from the node's parameters if no bag has a
 * session. A topology that does not match the model is refused, together with its states. When steps are recomputed,
 * the node subscribes to `step` instead of mesh/state. */
class Replay {
public:
    /* Load the scan and process the messages before the start time. The player starts after its connections, and the
     * connections of existing volume subscribers, exist, so that no message is lost. Throws std::runtime_error with a
     * message for the user. */
    Replay(ros::NodeHandle handle, ros::NodeHandle private_handle, const ReplaySettings &playing);
    ~Replay();
    /* Print the number of shown states and computed steps without rosconsole, which may already be shut down. */
    void print_summary() const;

private:
    struct WaitingState {
        uint32_t topology; /* revision of the required topology */
        pliant::MeshStateConstPtr state; /* null if `step` is set */
        pliant::StepConstPtr step;
        Clock::time_point arrival;
    };

    struct WaitingSession {
        pliant::SessionConstPtr session;
        Clock::time_point arrival;
    };

    struct KnownBody {
        std::shared_ptr<const LoadedModel> loaded;
        std::shared_ptr<const pliant_body> body; /* empty: the scan or mesh differs */
    };

    void load();
    void install_model(std::shared_ptr<const LoadedModel> loaded);
    pliant_progress make_cancellable_progress();
    void detect_player_restart(ros::Time stamp);
    void process_skipped_messages();
    void recompute_steps(const std::vector<pliant::StepConstPtr> &steps);
    void take_session(const pliant::SessionConstPtr &session);
    bool may_begin(const WaitingSession &next) const;
    /* Return whether a topology belongs to a session that has not begun here. */
    bool is_of_waiting_session(const pliant::MeshTopology &topology) const;
    void begin_session(const Session &session);
    void fit(const pliant::MeshTopology &topology);
    bool waits(const WaitingState &next) const;
    bool has_all_connections() const;
    /* volume: name of the volume topic */
    void start_player(const std::string &name, const std::string &volume);
    void take_topology(const pliant::MeshTopologyConstPtr &topology);
    void take_state(const pliant::MeshStateConstPtr &state);
    void take_step(const pliant::StepConstPtr &step);
    /* Process waiting messages. Messages of different topics arrive out of order: states and steps wait for their
     * topology for a limited time, and a session waits for the states before it. */
    void process_waiting_messages();
    void process_waiting_state(const WaitingState &next);
    void show(const WaitingState &next, const KnownBody &of);

    const Parameters parameters_;
    const ReplaySettings playing_;
    tf2_ros::StaticTransformBroadcaster broadcaster_;
    const bool simulates_;
    Topics topics_;
    ros::Time newest_; /* stamp of the last state or step */
    ros::Subscriber sessions_, topologies_, states_, steps_;
    bool described_ = false; /* whether the bags define the model */
    RecordedScanFinder scan_finder_;
    /* session of the current model; its load number is taken from the last equivalent session */
    Session session_;
    std::shared_ptr<const LoadedModel> loaded_, before_;
    /* last topologies, because a topology can arrive before its session */
    std::deque<pliant::MeshTopologyConstPtr> recent_;
    std::unique_ptr<Rerun> rerun_; /* set after the load if steps are recomputed */
    std::map<uint32_t, KnownBody> bodies_; /* by revision */
    Bodies made_; /* bodies of this load */
    std::deque<WaitingSession> waiting_sessions_;
    std::deque<WaitingState> pending_;
    uint64_t shown_ = 0, dropped_ = 0;
    Snapshots snapshots_{true};
    SettingsServer live_;
    ros::Publisher scan_info_;
    VolumeOutput volume_output_;
};

} // namespace pliant_ros

#endif
