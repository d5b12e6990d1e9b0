/* Draw the deformed volume of the newest snapshot (warp/warp.c), and publish its changed bricks, preview and slices. */
#include "ros/output/volume_output.h"

#include "ros/output/noise.h"
#include "ros/sim/realtime_priority.h"

#include <ros/publication.h>
#include <ros/topic_manager.h>

#include <algorithm>
#include <cmath>

namespace pliant_ros {

namespace {

enum {
    MAX_BOXES = 8,       /* maximum number of boxes per update */
    REPLAY_QUEUE = 1024   /* large enough that no state of a replayed bag is lost */
};
const std::chrono::milliseconds soon(2); /* wait for a subscriber that is not ready yet */
const std::chrono::milliseconds link_patience(100);  /* maximum time for which a slow subscriber delays the others */
/* a subscriber with a larger delay receives the whole volume as soon as it is ready */
const std::chrono::seconds whole_volume_after(60);
const double resend_rate = 1;                   /* [Hz] */
const std::chrono::milliseconds rests_after(200); /* time without any change after which small changes are sent, too */

bool any(const std::vector<uint8_t> &bricks)
{
    return std::find(bricks.begin(), bricks.end(), 1) != bricks.end();
}

bool same(const Box &a, const Box &b)
{
    return std::equal(a.offset, a.offset + 3, b.offset) && std::equal(a.size, a.size + 3, b.size);
}

} // namespace

/* ---- draw */

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
            std::this_thread::sleep_for(poll_period);
            continue;
        }
        std::shared_ptr<const Snapshot> snapshot = reader.wait(stream_.waits() ? soon : poll_period);
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

/* ---- the topic `volume` */

VolumeStream::VolumeStream(ros::NodeHandle handle, const Parameters &parameters, bool keeps_all)
    : frame_(parameters.tissue_frame), keeps_all_(keeps_all), threshold_(parameters.volume_threshold)
{
    std::copy(parameters.volume_low, parameters.volume_low + 3, low_);
    std::copy(parameters.volume_high, parameters.volume_high + 3, high_);
    publisher_ = handle.advertise<Volume>("volume", keeps_all ? REPLAY_QUEUE : 1,
                                          [this](const ros::SingleSubscriberPublisher &) { whole_wanted_ = true; });
    resend_ = handle.subscribe<std_msgs::Empty>("volume/resend", 1,
                                                [this](const std_msgs::Empty::ConstPtr &) { resend_wanted_ = true; });
}

VolumeStream::~VolumeStream()
{
    /* Stop the subscriber callbacks before the members that they write are destroyed. */
    resend_.shutdown();
    publisher_.shutdown();
}

void VolumeStream::start()
{
    whole_wanted_ = true;
    is_behind_ = has_missing_changes_ = false;
    clear_at_ = Clock::now();
    has_begun_ = false;
    forget_written();
    fresh_.clear();
    unconfirmed_bricks_.clear();
    pending_.clear();
}

bool VolumeStream::add(const DeformedVolume &warped)
{
    if (!has_begun_) {
        region_ = region_box(warped.target(), low_, high_);
        const double bound = !std::isnan(threshold_) ? threshold_
                             : keeps_all_            ? 0
                                                     : noise_of(warped.loaded()->scan->volume);
        sent_.start(bound, region_);
        bound_ = bound;
    }
    has_begun_ = true;
    const bool changed = warped.add_changed(&fresh_);
    if (changed) changed_at_ = Clock::now();
    unconfirmed_bricks_.resize(fresh_.size());
    return changed;
}

bool VolumeStream::has_ready_subscriber() const
{
    return last_.use_count() - 1 < static_cast<long>(publisher_.getNumSubscribers());
}

void VolumeStream::forget_written()
{
    held_.erase(
        std::remove_if(held_.begin(), held_.end(), [](const auto &each) { return each.first.use_count() == 1; }),
        held_.end());
    size_t bytes = is_held() ? last_bytes_ : 0;
    for (const auto &each : held_) bytes += each.second;
    held_bytes_ = bytes;
}

void VolumeStream::send(const DeformedVolume &warped, const Snapshot &snapshot)
{
    forget_written();
    if (!wanted()) return;
    if (resend_wanted_ && resend_rate_.due(resend_rate)) {
        resend_wanted_ = false;
        whole_wanted_ = true;
    }
    const bool held = is_held();
    const Clock::time_point now = Clock::now();
    if (!held) {
        if (has_missing_changes_) whole_wanted_ = true;
        has_missing_changes_ = false;
        clear_at_ = now;
        base_ = sequence_;
    }
    rests_ = now - changed_at_ > rests_after;
    is_behind_ = whole_wanted_ || !pending_.empty() || any(fresh_) || (rests_ && sent_.has_unsent_bricks());
    if (!is_behind_ || (held && (!has_ready_subscriber() || now - sent_at_ < link_patience))) return;
    if (now - clear_at_ > whole_volume_after) {
        has_missing_changes_ = true;
        clear_at_ = now;
        base_ = sequence_;
        if (pending_.empty()) std::fill(unconfirmed_bricks_.begin(), unconfirmed_bricks_.end(), 0);
    }
    if (whole_wanted_.exchange(false)) send_whole(warped, snapshot, held);
    else send_changes(warped, snapshot, held);
    is_behind_ = !pending_.empty();
}

/* If no link holds an older message, every link writes this message at once, and no later message can replace it. */
void VolumeStream::send_whole(const DeformedVolume &warped, const Snapshot &snapshot, bool held)
{
    publish(warped, snapshot, region_);
    for (size_t i = 0; i < fresh_.size(); ++i) unconfirmed_bricks_[i] = held && (unconfirmed_bricks_[i] || fresh_[i]);
    std::fill(fresh_.begin(), fresh_.end(), 0);
    pending_.clear();
    if (!held) base_ = sequence_;
}

void VolumeStream::send_changes(const DeformedVolume &warped, const Snapshot &snapshot, bool held)
{
    if (held || pending_.empty()) {
        sent_.select(warped.volume(), rests_, &fresh_);
        if (pending_.empty() && !any(fresh_)) return;
        for (size_t i = 0; i < fresh_.size(); ++i)
            unconfirmed_bricks_[i] = fresh_[i] || (held && unconfirmed_bricks_[i]);
        std::fill(fresh_.begin(), fresh_.end(), 0);
        pending_ = merged_boxes(changed_boxes_of(warped), held ? 1 : MAX_BOXES);
    }
    while (!pending_.empty()) {
        publish(warped, snapshot, pending_.back());
        pending_.pop_back();
        if (held) continue;
        base_ = sequence_;
        if (is_held()) break;
    }
}

std::vector<Box> VolumeStream::changed_boxes_of(const DeformedVolume &warped) const
{
    std::vector<Box> boxes = warped.boxes_of(unconfirmed_bricks_), inside;
    for (const Box &box : boxes) {
        const Box common = common_box(box, region_);
        if (common.size[0] && common.size[1] && common.size[2]) inside.push_back(common);
    }
    return inside;
}

void VolumeStream::publish(const DeformedVolume &warped, const Snapshot &snapshot, const Box &box)
{
    const pliant_volume &volume = warped.volume();
    auto message = boost::make_shared<Volume>();
    message->header.stamp = snapshot.stamp;
    message->header.frame_id = frame_;
    message->scan_id = snapshot.loaded->scan->volume.id;
    message->revision = snapshot.revision;
    message->since = same(box, region_) ? 0 : base_;
    message->sequence = ++sequence_;
    volume_message(volume, region_, box, message.get());
    sent_.keep(volume, box);
    sent_at_ = Clock::now();
    if (keeps_all_) {
        publish_with_priority(publisher_, message);
        return;
    }
    /* Publish in the same way as Publisher::publish, which does not report which messages the links still hold. */
    ros::SerializedMessage serialized;
    serialized.type_info = &typeid(Volume);
    serialized.message = message;
    if (is_held()) held_.emplace_back(last_, last_bytes_);
    last_.reset();
    /* Serialize before publishing, because TopicManager::publish holds a lock that all publishers share. */
    ros::SerializedMessage made;
    bool over_links = false, in_process = false;
    ros::TopicManager &topics = *ros::TopicManager::instance();
    if (ros::PublicationPtr publication = topics.lookupPublication(publisher_.getTopic()))
        publication->getPublishTypes(over_links, in_process, typeid(Volume));
    const auto serialize = [this, &message, &made] {
        if (!made.buf) made = ros::serialization::serializeMessage<Volume>(*message);
        last_ = made.buf;
        last_bytes_ = made.num_bytes;
        return made;
    };
    if (over_links) serialize();
    const PublishingPriority urgent;
    topics.publish(publisher_.getTopic(), serialize, serialized);
}

} // namespace pliant_ros
