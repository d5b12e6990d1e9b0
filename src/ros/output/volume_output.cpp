#include "ros/output/volume_output.h"

#include "ros/sim/realtime_priority.h"

#include <algorithm>

namespace pliant_ros {

namespace {

enum { POLL_MILLISECONDS = 100, SOON_MILLISECONDS = 2 /* where somebody is not ready yet */ };

} // namespace

VolumeOutput::VolumeOutput(ros::NodeHandle handle, const Parameters &parameters, SettingsServer *live,
                           Snapshots *snapshots, MeshOutput *mesh_output)
    : frame_(parameters.tissue_frame), stream_(handle, parameters, snapshots->keeps_all()), live_(live),
      snapshots_(snapshots), mesh_output_(mesh_output), preview_step_(static_cast<uint32_t>(parameters.preview_step))
{
    static const char *const topics[] = {"volume/slice/axial", "volume/slice/coronal", "volume/slice/sagittal"};
    const auto on_connect = [this](const ros::SingleSubscriberPublisher &) { slices_fresh_ = true; };
    for (int plane = 0; plane < 3; ++plane) {
        slices_[plane] = handle.advertise<sensor_msgs::Image>(topics[plane], 1, on_connect);
        placed_[plane] = handle.advertise<Volume>(std::string(topics[plane]) + "/placed", 1, on_connect);
    }
    preview_ = handle.advertise<Volume>("volume/preview", 1,
                                        [this](const ros::SingleSubscriberPublisher &) { preview_fresh_ = true; });
    thread_ = std::thread(&VolumeOutput::run, this);
}

VolumeOutput::~VolumeOutput()
{
    stopping_ = true;
    thread_.join();
    /* Stop the subscriber callbacks before the members that they write are destroyed. */
    preview_.shutdown();
    for (ros::Publisher &slice : slices_) slice.shutdown();
    for (ros::Publisher &slice : placed_) slice.shutdown();
}

bool VolumeOutput::slice_wanted() const
{
    const auto wanted = [](const ros::Publisher &slice) { return slice.getNumSubscribers() > 0; };
    return std::any_of(slices_, slices_ + 3, wanted) || std::any_of(placed_, placed_ + 3, wanted);
}

void VolumeOutput::run()
{
    Snapshots::Reader reader(snapshots_);
    while (!stopping_) {
        bool wanted = stream_.wanted() || preview_wanted() || slice_wanted();
        reader.want(wanted);
        if (!wanted) {
            drop(); /* release the memory while there are no subscribers */
            problem_.set("");
            std::this_thread::sleep_for(std::chrono::milliseconds(POLL_MILLISECONDS));
            continue;
        }
        const std::chrono::milliseconds patience(stream_.waits() ? SOON_MILLISECONDS : POLL_MILLISECONDS);
        std::shared_ptr<const Snapshot> snapshot = reader.wait(patience);
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
    stream_.start();
}

bool VolumeOutput::look(const std::function<void(const DeformedVolume &, const Snapshot &)> &function)
{
    std::lock_guard<std::mutex> hold(lock_);
    if (warped_ && shown_now_) function(*warped_, *shown_now_);
    return warped_ && shown_now_;
}

void VolumeOutput::publish(const std::shared_ptr<const Snapshot> &newest)
{
    const Snapshot &snapshot = *newest;
    std::lock_guard<std::mutex> hold(lock_);
    RuntimeSettings settings = live_->get();
    if (!(settings.warp_rate > 0)) return;
    bool is_new = !warped_ || warped_->loaded() != snapshot.loaded.get();
    bool changed = false;
    if (is_new || snapshots_->keeps_all() || warp_rate_.due(settings.warp_rate)) {
        if (mesh_output_ && !mesh_output_->publish_state(snapshot)) return; /* a later step follows */
        if (is_new) {
            shown_now_.reset();
            warped_.reset(); /* free its memory before the next volume is allocated */
            warped_.reset(new DeformedVolume(snapshot.loaded, snapshot.body));
            stream_.start();
        }
        warped_->set_body(snapshot.body);
        warped_->update(snapshot.positions);
        shown_now_ = newest;
        changed = stream_.add(*warped_) || is_new;
    }
    stream_.send(*warped_, *shown_now_);
    publish_preview(*shown_now_, changed);
    publish_slices(shown_now_->stamp, settings, changed);
}

void VolumeOutput::publish_again()
{
    std::lock_guard<std::mutex> hold(lock_);
    if (!warped_ || !shown_now_) return;
    stream_.send(*warped_, *shown_now_);
    publish_preview(*shown_now_, false);
    publish_slices(shown_now_->stamp, live_->get(), false);
}

void VolumeOutput::describe(const ros::Time &stamp, uint64_t *sequence, Volume *message) const
{
    message->header.stamp = stamp;
    message->header.frame_id = frame_;
    message->scan_id = shown_now_->loaded->scan->volume.id;
    message->revision = shown_now_->revision;
    message->sequence = ++*sequence;
}

void VolumeOutput::publish_preview(const Snapshot &snapshot, bool is_new)
{
    if (is_new) preview_fresh_ = true;
    if (!preview_wanted() || !preview_fresh_.exchange(false)) return;
    auto message = boost::make_shared<Volume>();
    describe(snapshot.stamp, &preview_sequence_, message.get());
    preview_message(warped_->volume(), stream_.region(), preview_step_, message.get());
    publish_with_priority(preview_, message);
}

/* Publish the slices again if the volume or the slice position has changed, or if a new subscriber has connected. */
void VolumeOutput::publish_slices(const ros::Time &stamp, const RuntimeSettings &settings, bool is_new)
{
    bool moved = !std::equal(shown_, shown_ + 3, settings.slice);
    if (is_new || moved) slices_fresh_ = true;
    if (!slices_fresh_ || !slice_wanted() || !slice_rate_.due(settings.slice_rate)) return;
    slices_fresh_ = false;
    std::copy(settings.slice, settings.slice + 3, shown_);
    for (int plane = 0; plane < 3; ++plane) {
        if (placed_[plane].getNumSubscribers() > 0) {
            auto placed = boost::make_shared<Volume>();
            describe(stamp, &placed_sequence_[plane], placed.get());
            placed_slice_message(warped_->volume(), static_cast<Plane>(plane), settings.slice[plane], placed.get());
            publish_with_priority(placed_[plane], placed);
        }
        if (slices_[plane].getNumSubscribers() == 0) continue;
        auto image = boost::make_shared<sensor_msgs::Image>();
        image->header.stamp = stamp;
        image->header.frame_id = frame_;
        slice_message(warped_->volume(), static_cast<Plane>(plane), settings.slice[plane], image.get());
        publish_with_priority(slices_[plane], image);
    }
}

} // namespace pliant_ros
