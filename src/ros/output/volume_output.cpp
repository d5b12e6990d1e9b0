#include "ros/output/volume_output.h"

#include <algorithm>

namespace pliant_ros {

namespace {

enum {
    POLL_MILLISECONDS = 100,
    LIVE_QUEUE = 16,    /* boxes; who falls behind gets the newest, and a gap */
    REPLAY_QUEUE = 1024 /* states come as fast as a bag is played, and none is to be missed */
};

} // namespace

VolumeOutput::VolumeOutput(ros::NodeHandle handle, const Parameters &parameters, Live *live, Snapshots *snapshots,
                           MeshOutput *mesh_output)
    : frame_(parameters.tissue_frame), live_(live), snapshots_(snapshots), mesh_output_(mesh_output)
{
    uint32_t room = snapshots_->keeps_all() ? REPLAY_QUEUE : LIVE_QUEUE;
    volume_ = handle.advertise<Volume>("volume", room,
                                       [this](const ros::SingleSubscriberPublisher &) { whole_wanted_ = true; });
    static const char *const topics[] = {"volume/slice/axial", "volume/slice/coronal", "volume/slice/sagittal"};
    for (int plane = 0; plane < 3; ++plane)
        slices_[plane] = handle.advertise<sensor_msgs::Image>(
            topics[plane], 1, [this](const ros::SingleSubscriberPublisher &) { slices_fresh_ = true; });
    thread_ = std::thread(&VolumeOutput::run, this);
}

VolumeOutput::~VolumeOutput()
{
    stopping_ = true;
    thread_.join();
    /* before what their callbacks write */
    volume_.shutdown();
    for (ros::Publisher &slice : slices_) slice.shutdown();
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
            problem_.set("");
            std::this_thread::sleep_for(std::chrono::milliseconds(POLL_MILLISECONDS));
            continue;
        }
        std::shared_ptr<const Snapshot> snapshot = reader.wait(std::chrono::milliseconds(POLL_MILLISECONDS));
        try {
            if (!snapshot) {
                publish_again();
                continue;
            }
            publish(snapshot);
            problem_.set("");
        } catch (const std::exception &failed) {
            drop();
            problem_.set(std::string("no deformed volume: ") + failed.what());
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

bool VolumeOutput::look(const std::function<void(const Warped &, const Snapshot &)> &function)
{
    std::lock_guard<std::mutex> hold(lock_);
    if (warped_ && shown_now_) function(*warped_, *shown_now_);
    return warped_ && shown_now_;
}

void VolumeOutput::publish(const std::shared_ptr<const Snapshot> &newest)
{
    const Snapshot &snapshot = *newest;
    std::lock_guard<std::mutex> hold(lock_);
    LiveSettings settings = live_->get();
    if (!(settings.warp_rate > 0)) return;
    bool is_new = !warped_ || warped_->loaded() != snapshot.loaded.get();
    bool changed = false;
    if (is_new || snapshots_->keeps_all() || warp_rate_.due(settings.warp_rate)) {
        if (mesh_output_) mesh_output_->publish_state(snapshot);
        if (is_new) {
            shown_now_.reset();
            warped_.reset(); /* before the next one takes its memory */
            warped_.reset(new Warped(snapshot.loaded, snapshot.body));
        }
        warped_->set_body(snapshot.body);
        warped_->update(snapshot.positions);
        shown_now_ = newest;
        std::vector<Box> boxes = warped_->changed();
        changed = is_new || !boxes.empty();
        bool whole = whole_wanted_.exchange(false) || is_new;
        if (whole) boxes.assign(1, whole_box());
        if (volume_.getNumSubscribers() > 0) publish_boxes(snapshot, boxes);
    }
    publish_slices(shown_now_->stamp, settings, changed);
}

void VolumeOutput::publish_again()
{
    std::lock_guard<std::mutex> hold(lock_);
    if (!warped_ || !shown_now_) return;
    if (whole_wanted_.exchange(false)) publish_boxes(*shown_now_, std::vector<Box>(1, whole_box()));
    publish_slices(shown_now_->stamp, live_->get(), false);
}

Box VolumeOutput::whole_box() const
{
    const int32_t *size = warped_->target().size;
    return Box{{0, 0, 0}, {uint32_t(size[0]), uint32_t(size[1]), uint32_t(size[2])}};
}

void VolumeOutput::publish_boxes(const Snapshot &snapshot, const std::vector<Box> &boxes)
{
    for (const Box &box : boxes) {
        auto message = boost::make_shared<Volume>();
        message->header.stamp = snapshot.stamp;
        message->header.frame_id = frame_;
        message->scan_id = snapshot.loaded->scan->volume.id;
        message->revision = snapshot.revision;
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
