/* The topic `volume`: what has changed, to whoever is ready for it. A subscriber that is slow gets fewer and larger boxes, never a queue of
   old ones: a link holds at most what is being written and one message that waits, and a newer one takes that one's place. So that nothing
   is lost by that, a box has all that changed since the last message that every link has surely written. Bricks that changed by less than the
   scan's noise are sent once the tissue rests. */
#ifndef PLIANT_ROS_OUTPUT_VOLUME_STREAM_H
#define PLIANT_ROS_OUTPUT_VOLUME_STREAM_H

#include "ros/output/sent_volume.h"
#include "ros/output/warped.h"
#include "ros/params/params.h"
#include "ros/sim/snapshot.h"

#include <boost/shared_array.hpp>
#include <ros/node_handle.h>
#include <std_msgs/Empty.h>

#include <atomic>

namespace pliant_ros {

class VolumeStream {
public:
    /* keeps_all: every change is sent at once, and all of them wait for who is slow. */
    VolumeStream(ros::NodeHandle handle, const Parameters &parameters, bool keeps_all);
    ~VolumeStream();
    bool wanted() const { return publisher_.getNumSubscribers() > 0; }
    /* Another volume from now on, or none: the next message is the whole. */
    void start();
    /* What the last update of it changed is still to be sent. False: nothing has changed. */
    bool add(const Warped &warped);
    /* Voxels of subscribers differ from the deformed volume by less than this while the tissue moves, by nothing at rest [values of the scan]. Any thread. */
    double bound() const { return bound_; }
    /* Bytes of messages that links still hold. A link holds the one that it writes, and all share the newest one: one more than links. Any thread. */
    size_t held_bytes() const { return held_bytes_; }
    /* What the topic's whole is, once there is any. */
    const Box &region() const { return region_; }
    /* Something is, and who reads it was not ready. */
    bool waits() const { return is_behind_; }
    /* What is to be sent, as far as somebody is ready for it. */
    void send(const Warped &warped, const Snapshot &snapshot);

private:
    bool is_held() const { return last_.use_count() > 1; }
    void forget_written();
    bool somebody_is_ready() const;
    void send_whole(const Warped &warped, const Snapshot &snapshot, bool held);
    void send_changes(const Warped &warped, const Snapshot &snapshot, bool held);
    void publish(const Warped &warped, const Snapshot &snapshot, const Box &box);
    std::vector<Box> changed_boxes_of(const Warped &warped) const;

    const std::string frame_;
    const bool keeps_all_;
    const double threshold_; /* NaN: the scan's noise */
    double low_[3], high_[3];
    ros::Publisher publisher_;
    ros::Subscriber resend_;
    std::atomic<bool> whole_wanted_{true}, resend_wanted_{false};
    Rate resend_rate_;
    bool is_behind_ = false;
    Box region_;
    uint64_t sequence_ = 0, base_ = 0;     /* sent last; the last one that everybody has */
    boost::shared_array<uint8_t> last_;    /* what was sent last; a link that has not written it holds it, too */
    size_t last_bytes_ = 0;
    std::vector<std::pair<boost::shared_array<uint8_t>, size_t>> held_; /* older ones, with their bytes, that a link has not written yet */
    std::atomic<size_t> held_bytes_{0};
    Clock::time_point sent_at_{}, clear_at_{}; /* when that was, and when nobody held any */
    bool gap_ = false;                     /* somebody has one */
    std::vector<uint8_t> fresh_, unsure_;  /* bricks that no message has yet; that changed since base_ */
    std::vector<Box> pending_;             /* of the last changes, not yet sent */
    bool has_begun_ = false, rests_ = false;
    std::atomic<double> bound_{0};         /* that voxels of subscribers may differ by while the tissue moves [values of the scan] */
    Clock::time_point changed_at_{};       /* the last change of the volume */
    SentVolume sent_;
};

} // namespace pliant_ros

#endif
