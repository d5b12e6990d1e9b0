/* The deformed volumes of a recording: every mesh/state that a bag plays is warped again, none left out; or every step is made again. */
#ifndef PLIANT_ROS_RECORD_REPLAY_H
#define PLIANT_ROS_RECORD_REPLAY_H

#include "ros/output/mesh_output.h"
#include "ros/record/earlier.h"
#include "ros/record/recorded.h"
#include "ros/record/rerun.h"
#include "ros/sim/session.h"
#include "ros/output/volume_output.h"

#include <tf2_ros/static_transform_broadcaster.h>

#include <deque>
#include <functional>
#include <map>

namespace pliant_ros {

/* What is played, and how. */
struct Playing {
    std::string player;            /* node name of a `rosbag play --pause` of these bags, which is set going; empty: none */
    std::vector<std::string> bags;
    double start = 0;              /* played from there on [s] */
    bool simulates = false;        /* every step is made again */
    bool described = false;        /* the bags say what the model is, where they do; otherwise the parameters do */
    std::function<bool()> goes_on = [] { return true; }; /* asked during long work; false: it is left */
};

/* Takes session, mesh/topology and mesh/state as a bag plays them, publishes volume and its slices with the stamps of the
   states, and scan_info of the scan here. Models are made as the bag's sessions say, or, where no bag has any, as the parameters do, which are
   the node's. A topology that is not the model's is refused, and so are the states of its revision. What simulates takes `step` in place of
   the states. */
class Replay {
public:
    /* Loads the scan, takes what the bags hold from before the start, and returns when that is done. Throws std::runtime_error with a message for a person.
       The player begins once there are connections to it, and from who listens to the volume already, so that neither misses anything. */
    Replay(ros::NodeHandle handle, ros::NodeHandle private_handle, const Playing &playing);
    ~Replay();
    /* Print how many states were shown and steps computed, without rosconsole, which may be down. */
    void tell() const;

private:
    struct Pending {
        uint32_t topology; /* revision of the one that it needs */
        pliant::MeshStateConstPtr state; /* or */
        pliant::StepConstPtr step;
        Clock::time_point arrival;
    };

    struct Coming {
        pliant::SessionConstPtr session;
        Clock::time_point arrival;
    };

    struct Known {
        std::shared_ptr<const Loaded> loaded;
        std::shared_ptr<const pliant_body> body; /* empty: another scan or mesh */
    };

    void load();
    void put_in(std::shared_ptr<const Loaded> loaded);
    pliant_progress while_it_goes_on();
    void watch_for_the_loop(ros::Time stamp);
    void catch_up();
    void make_again(const std::vector<pliant::StepConstPtr> &steps);
    void take_session(const pliant::SessionConstPtr &session);
    bool may_begin(const Coming &next) const;
    bool is_to_come(const pliant::MeshTopology &topology) const; /* of a session that has not begun here */
    void begin_session(const Session &session);
    void fit(const pliant::MeshTopology &topology);
    bool waits(const Pending &next) const;
    bool hears_all() const;
    /* volume: the topic */
    void start_player(const std::string &name, const std::string &volume);
    void take_topology(const pliant::MeshTopologyConstPtr &topology);
    void take_state(const pliant::MeshStateConstPtr &state);
    void take_step(const pliant::StepConstPtr &step);
    /* Topics overtake each other: states and steps wait for their topology, for a while, and a session for the states before it. */
    void work_off();
    void take_pending(const Pending &next);
    void show(const Pending &next, const Known &of);

    const Parameters parameters_;
    const Playing playing_;
    tf2_ros::StaticTransformBroadcaster broadcaster_;
    const bool simulates_;
    Topics topics_;
    ros::Time newest_; /* of the states or steps */
    ros::Subscriber sessions_, topologies_, states_, steps_;
    bool described_ = false; /* by the bags */
    Shelf shelf_;
    Session session_;        /* that the model was made of; load is that of the newest like it */
    std::shared_ptr<const Loaded> loaded_, before_;
    std::deque<pliant::MeshTopologyConstPtr> recent_; /* topics overtake each other: one may be of a session that comes after it */
    std::unique_ptr<Rerun> rerun_; /* where it simulates, once loaded */
    std::map<uint32_t, Known> bodies_; /* by revision */
    Bodies made_; /* of this load */
    std::deque<Coming> coming_;
    std::deque<Pending> pending_;
    uint64_t shown_ = 0, dropped_ = 0;
    Snapshots snapshots_{true};
    Live live_;
    ros::Publisher scan_info_;
    VolumeOutput volume_output_;
};

} // namespace pliant_ros

#endif
