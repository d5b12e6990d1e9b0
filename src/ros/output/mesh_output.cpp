#include "ros/output/mesh_output.h"

#include "ros/sim/realtime_priority.h"

namespace pliant_ros {

namespace {

enum {
    VIEW_RATE = 10 /* marker and points [Hz] */,
    STATE_QUEUE = 64 /* a recorder that stalls for one second loses no state */
};

} // namespace

MeshOutput::MeshOutput(ros::NodeHandle handle, const Parameters &parameters, SettingsServer *live, Snapshots *snapshots)
    : frame_(parameters.tissue_frame), live_(live), snapshots_(snapshots)
{
    scan_info_ = handle.advertise<ScanInfo>("scan_info", 1, true);
    topology_ = handle.advertise<MeshTopology>("mesh/topology", 1, true);
    state_ = handle.advertise<MeshState>("mesh/state", STATE_QUEUE);
    marker_ = handle.advertise<visualization_msgs::Marker>("mesh/marker", 1);
    points_ = handle.advertise<sensor_msgs::PointCloud2>("mesh/points", 1);
    thread_ = std::thread(&MeshOutput::run, this);
}

MeshOutput::~MeshOutput()
{
    stopping_ = true;
    thread_.join();
}

std_msgs::Header MeshOutput::header(const ros::Time &stamp) const
{
    std_msgs::Header out;
    out.stamp = stamp;
    out.frame_id = frame_;
    return out;
}

void MeshOutput::publish_model(const LoadedModel &loaded)
{
    std_msgs::Header now = header(ros::Time::now());
    auto info = boost::make_shared<ScanInfo>();
    info->header = now;
    info->scan_id = loaded.scan->volume.id;
    scan_info_message(*loaded.model, loaded.scan->low, loaded.scan->high, info.get());
    scan_info_.publish(info);
    std::lock_guard<std::mutex> hold(lock_);
    shown_ = &loaded;
    publish_topology(loaded, *pliant_model_get_body(loaded.model), loaded.revision, now.stamp);
}

void MeshOutput::publish_topology(const LoadedModel &loaded, const pliant_body &body, uint32_t revision,
                                  const ros::Time &stamp)
{
    auto topology = boost::make_shared<MeshTopology>();
    topology->header = header(stamp);
    topology->scan_id = loaded.scan->volume.id;
    topology->scan_checksum = loaded.scan->checksum;
    topology->revision = topology_revision_ = revision;
    surface_ = surface_of(body, surface_);
    topology_message(*surface_, topology.get());
    topology_.publish(topology);
}

void MeshOutput::follow_topology(const Snapshot &snapshot)
{
    /* A snapshot of a model that is not displayed is skipped; snapshots of the displayed model follow. */
    if (snapshot.loaded.get() == shown_ && snapshot.revision != topology_revision_)
        publish_topology(*snapshot.loaded, *snapshot.body, snapshot.revision, snapshot.stamp);
}

bool MeshOutput::is_wanted() const
{
    return state_.getNumSubscribers() > 0 || marker_.getNumSubscribers() > 0 || points_.getNumSubscribers() > 0 ||
           topology_.getNumSubscribers() > 0;
}

void MeshOutput::run()
{
    Snapshots::Reader reader(snapshots_);
    while (!stopping_) {
        bool wanted = is_wanted();
        reader.want(wanted);
        if (!wanted) {
            problem_.set("");
            std::this_thread::sleep_for(poll_period);
            continue;
        }
        std::shared_ptr<const Snapshot> snapshot = reader.wait(poll_period);
        if (!snapshot) continue;
        try {
            publish(*snapshot);
            problem_.set("");
        } catch (const std::exception &failed) {
            problem_.set(std::string("no mesh: ") + failed.what());
            ROS_ERROR_THROTTLE(5, "no mesh: %s", failed.what());
        }
    }
}

boost::shared_ptr<MeshState> MeshOutput::state_of(const Snapshot &snapshot) const
{
    auto state = boost::make_shared<MeshState>();
    state->header = header(snapshot.stamp);
    state->revision = snapshot.revision;
    state->step = snapshot.step;
    mesh_state_message(*snapshot.loaded->model, *snapshot.body, snapshot.positions.data(), snapshot.scalar,
                       snapshot.contact_force, state.get());
    return state;
}

bool MeshOutput::is_published(const Snapshot &snapshot) const
{
    return state_stamp_ == snapshot.stamp && state_step_ == snapshot.step;
}

/* Return whether the state of a later step is already published. The step number alone decides nothing, because it
 * restarts at a reset; neither does the time stamp, because a clock can be set back. */
bool MeshOutput::is_late(const Snapshot &snapshot) const
{
    return state_loaded_ == snapshot.loaded.get() && snapshot.stamp < state_stamp_ && snapshot.step < state_step_;
}

void MeshOutput::send_state(const Snapshot &snapshot, const boost::shared_ptr<MeshState> &state)
{
    state_loaded_ = snapshot.loaded.get();
    state_stamp_ = snapshot.stamp;
    state_step_ = snapshot.step;
    publish_with_priority(state_, state);
}

bool MeshOutput::publish_state(const Snapshot &snapshot)
{
    if (state_.getNumSubscribers() == 0) return true;
    std::lock_guard<std::mutex> hold(lock_);
    if (is_published(snapshot)) return true;
    if (is_late(snapshot)) return false;
    follow_topology(snapshot);
    state_rate_.spend(live_->get().mesh_rate);
    send_state(snapshot, state_of(snapshot));
    return true;
}

void MeshOutput::publish(const Snapshot &snapshot)
{
    bool marker_due = marker_.getNumSubscribers() > 0 && marker_rate_.due(VIEW_RATE);
    bool points_due = points_.getNumSubscribers() > 0 && points_rate_.due(VIEW_RATE);
    std::unique_lock<std::mutex> hold(lock_);
    const double rate = live_->get().mesh_rate;
    bool state_due =
        state_.getNumSubscribers() > 0 && !is_published(snapshot) && !is_late(snapshot) && state_rate_.due(rate);
    /* While a blade cuts, the topology changes in every step. Publish it at most as often as states. */
    if (state_due || (state_.getNumSubscribers() == 0 && topology_rate_.due(rate))) follow_topology(snapshot);
    if (!state_due && !marker_due && !points_due) return;
    boost::shared_ptr<MeshState> state = state_of(snapshot);
    if (state_due) send_state(snapshot, state);
    if (marker_due) surface_ = surface_of(*snapshot.body, surface_);
    const std::shared_ptr<const pliant_surface> surface = surface_;
    hold.unlock();
    const double *positions = snapshot.positions.data();
    if (marker_due) {
        auto marker = boost::make_shared<visualization_msgs::Marker>();
        marker->header = state->header;
        marker_message(*surface, positions, state->scalar, marker.get());
        publish_with_priority(marker_, marker);
    }
    if (points_due) {
        auto points = boost::make_shared<sensor_msgs::PointCloud2>();
        points->header = state->header;
        points_message(*snapshot.body, positions, state->scalar, points.get());
        publish_with_priority(points_, points);
    }
}

} // namespace pliant_ros
