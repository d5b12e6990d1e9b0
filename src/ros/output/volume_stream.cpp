#include "ros/output/volume_stream.h"

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
const std::chrono::milliseconds patience(100);  /* maximum time for which a slow subscriber delays the others */
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
    if (!is_behind_ || (held && (!has_ready_subscriber() || now - sent_at_ < patience))) return;
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
