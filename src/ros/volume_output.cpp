#include "volume_output.h"

#include <algorithm>
#include <cmath>

namespace pliant_ros {

namespace {

enum { POLL_MILLISECONDS = 100 };
const size_t max_target_voxels = size_t(1) << 31;

int threads_of(const pliant_scene &scene)
{
    if (scene.solver.threads > 0) return scene.solver.threads;
    return static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
}

struct WorldBox {
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};

    void grow(const double *point, double margin)
    {
        for (int d = 0; d < 3; ++d) {
            low[d] = std::min(low[d], point[d] - margin);
            high[d] = std::max(high[d], point[d] + margin);
        }
    }
    bool holds(const double *point) const
    {
        for (int d = 0; d < 3; ++d)
            if (point[d] < low[d] || point[d] > high[d]) return false;
        return true;
    }
};

/* The mesh at rest and a margin, so that the same scan always gets the same grid; more only where nodes lie outside. */
WorldBox box_of(const pliant_mesh &mesh, const std::vector<double> &positions, double margin)
{
    WorldBox box;
    for (int32_t node = 0; node < mesh.num_nodes; ++node) box.grow(&mesh.rest[3 * node], margin);
    const WorldBox at_rest = box;
    for (size_t node = 0; node < positions.size(); node += 3)
        if (!at_rest.holds(&positions[node])) box.grow(&positions[node], margin);
    return box;
}

} // namespace

Warped::Warped(std::shared_ptr<const Loaded> loaded, const std::vector<double> &positions, double margin)
    : loaded_(std::move(loaded)), grows_(margin > 0)
{
    const pliant_model &model = *loaded_->model;
    const pliant_volume &scan = loaded_->scan->volume;
    WorldBox box = box_of(model.fine, positions, margin);
    pliant_geometry target;
    check(pliant_warp_target(&scan.geometry, grows_ ? box.low : nullptr, grows_ ? box.high : nullptr, max_target_voxels,
                             &target));
    check(pliant_warp_create(&scan, &model.fine, &target, threads_of(model.scene), &warp_));
}

bool Warped::holds(const std::vector<double> &positions) const
{
    const pliant_geometry &target = volume().geometry;
    for (size_t node = 0; grows_ && node < positions.size(); node += 3) {
        double index[3];
        pliant_geometry_to_index(&target, &positions[node], index);
        for (int d = 0; d < 3; ++d)
            if (index[d] < -0.5 || index[d] > target.size[d] - 0.5) return false;
    }
    return true;
}

void Warped::update(const std::vector<double> &positions) { check(pliant_warp_update(warp_, positions.data())); }

std::vector<Box> Warped::changed() const
{
    int32_t count[3];
    const uint8_t *changed;
    pliant_warp_bricks(warp_, count, &changed);
    return changed_boxes(count, changed, volume().geometry.size);
}

VolumeOutput::VolumeOutput(ros::NodeHandle handle, const Parameters &parameters, Live *live, Snapshots *snapshots)
    : frame_(parameters.tissue_frame), live_(live), snapshots_(snapshots)
{
    /* room for the boxes of one update */
    volume_ = handle.advertise<Volume>("volume", 16, [this](const ros::SingleSubscriberPublisher &) { whole_wanted_ = true; });
    static const char *const planes[] = {"axial", "coronal", "sagittal"};
    for (int plane = 0; plane < 3; ++plane)
        slices_[plane] = handle.advertise<sensor_msgs::Image>(std::string("volume/slice/") + planes[plane], 1,
                                                              [this](const ros::SingleSubscriberPublisher &) { slices_fresh_ = true; });
    thread_ = std::thread(&VolumeOutput::run, this);
}

VolumeOutput::~VolumeOutput()
{
    stopping_ = true;
    thread_.join();
}

bool VolumeOutput::slice_wanted() const
{
    return std::any_of(slices_, slices_ + 3, [](const ros::Publisher &slice) { return slice.getNumSubscribers() > 0; });
}

void VolumeOutput::run()
{
    Snapshots::Reader reader(snapshots_);
    while (!stopping_) {
        bool wanted = volume_.getNumSubscribers() > 0 || slice_wanted();
        reader.want(wanted);
        if (!wanted) {
            drop(); /* what nobody looks at holds no memory */
            std::this_thread::sleep_for(std::chrono::milliseconds(POLL_MILLISECONDS));
            continue;
        }
        std::shared_ptr<const Snapshot> snapshot = reader.wait(std::chrono::milliseconds(POLL_MILLISECONDS));
        if (!snapshot) continue;
        try {
            publish(snapshot);
        } catch (const std::exception &failed) {
            drop();
            ROS_ERROR_THROTTLE(5, "no deformed volume: %s", failed.what());
        }
    }
}

void VolumeOutput::drop()
{
    std::lock_guard<std::mutex> hold(lock_);
    warped_.reset();
    shown_now_.reset();
}

bool VolumeOutput::look(const std::function<void(const pliant_volume &, const Snapshot &)> &function)
{
    std::lock_guard<std::mutex> hold(lock_);
    if (warped_ && shown_now_) function(warped_->volume(), *shown_now_);
    return warped_ && shown_now_;
}

void VolumeOutput::publish(const std::shared_ptr<const Snapshot> &newest)
{
    const Snapshot &snapshot = *newest;
    std::lock_guard<std::mutex> hold(lock_);
    LiveSettings settings = live_->get();
    if (!(settings.warp_rate > 0)) return;
    bool is_new = !warped_ || warped_->loaded() != snapshot.loaded.get() || !warped_->holds(snapshot.positions);
    bool changed = false;
    if (is_new || warp_rate_.due(settings.warp_rate)) {
        if (is_new) {
            shown_now_.reset();
            warped_.reset(); /* before the next one takes its memory */
            warped_.reset(new Warped(snapshot.loaded, snapshot.positions, snapshot.loaded->model->scene.warp.margin));
        }
        warped_->update(snapshot.positions);
        shown_now_ = newest;
        std::vector<Box> boxes = warped_->changed();
        changed = is_new || !boxes.empty();
        bool whole = whole_wanted_.exchange(false) || is_new;
        if (whole) {
            const int32_t *size = warped_->volume().geometry.size;
            boxes.assign(1, Box{{0, 0, 0}, {uint32_t(size[0]), uint32_t(size[1]), uint32_t(size[2])}});
        }
        if (volume_.getNumSubscribers() > 0) publish_boxes(*snapshot.loaded, boxes, snapshot.stamp);
    }
    publish_slices(snapshot.stamp, settings, changed);
}

void VolumeOutput::publish_boxes(const Loaded &loaded, const std::vector<Box> &boxes, const ros::Time &stamp)
{
    for (const Box &box : boxes) {
        auto message = boost::make_shared<Volume>();
        message->header.stamp = stamp;
        message->header.frame_id = frame_;
        message->scan_id = loaded.scan->volume.id;
        message->revision = loaded.revision;
        message->sequence = ++sequence_;
        volume_message(warped_->volume(), box, message.get());
        volume_.publish(message);
    }
}

/* A slice is sent again when the volume or its place has changed, or somebody new looks. */
void VolumeOutput::publish_slices(const ros::Time &stamp, const LiveSettings &settings, bool is_new)
{
    bool moved = !std::equal(shown_, shown_ + 3, settings.slice);
    if (is_new || moved) slices_fresh_ = true;
    if (!slices_fresh_ || !slice_wanted() || !slice_rate_.due(settings.slice_rate)) return;
    slices_fresh_ = false;
    std::copy(settings.slice, settings.slice + 3, shown_);
    for (int plane = 0; plane < 3; ++plane) {
        if (slices_[plane].getNumSubscribers() == 0) continue;
        auto image = boost::make_shared<sensor_msgs::Image>();
        image->header.stamp = stamp;
        image->header.frame_id = frame_;
        slice_message(warped_->volume(), static_cast<Plane>(plane), settings.slice[plane], image.get());
        slices_[plane].publish(image);
    }
}

} // namespace pliant_ros
