/* Publish the deformed volume and its slices. A separate thread draws the volume while there are subscribers. */
#ifndef PLIANT_ROS_OUTPUT_VOLUME_OUTPUT_H
#define PLIANT_ROS_OUTPUT_VOLUME_OUTPUT_H

#include "ros/sim/settings_server.h"
#include "ros/output/mesh_output.h"
#include "ros/output/deformed_volume.h"
#include "ros/output/sent_volume.h"
#include "ros/params/params.h"
#include "ros/sim/snapshot.h"

#include <boost/shared_array.hpp>
#include <ros/node_handle.h>
#include <std_msgs/Empty.h>

#include <atomic>
#include <functional>
#include <mutex>
#include <thread>

namespace pliant_ros {

/* The topic `volume` sends changed voxels to each subscriber that is ready. A slow subscriber receives fewer and larger
 * boxes instead of a queue of old ones. A link (connection to a subscriber) holds at most two messages: one is being
 * written and one waits. A newer message replaces the waiting one. To lose no change, a box covers all changes since
 * the last message that every link has certainly written. Bricks that changed by less than the scan's noise are sent
 * when the tissue rests. */
class VolumeStream {
public:
    /* keeps_all: send every change at once; all subscribers wait for the slowest one. */
    VolumeStream(ros::NodeHandle handle, const Parameters &parameters, bool keeps_all);
    ~VolumeStream();
    bool wanted() const { return publisher_.getNumSubscribers() > 0; }
    /* Start a new volume, or stop. The next message contains the whole volume. */
    void start();
    /* Add the changes of the volume's last update to the pending ones. Return false if nothing has changed. */
    bool add(const DeformedVolume &warped);
    /* Return the bound on the difference between subscribers' voxels and the deformed volume while the tissue moves
     * [values of the scan]. At rest the difference is zero. Thread-safe. */
    double bound() const { return bound_; }
    /* Return the number of bytes of messages that links still hold. Each link holds the message that it writes, and all
     * links share the most recent one. Thread-safe. */
    size_t held_bytes() const { return held_bytes_; }
    /* Return the region of the topic's volume; call after the first add. */
    const Box &region() const { return region_; }
    /* Return whether changes are pending because a subscriber was not ready. */
    bool waits() const { return is_behind_; }
    /* Send the pending changes to ready subscribers. */
    void send(const DeformedVolume &warped, const Snapshot &snapshot);

private:
    bool is_held() const { return last_.use_count() > 1; }
    void forget_written();
    bool has_ready_subscriber() const;
    void send_whole(const DeformedVolume &warped, const Snapshot &snapshot, bool held);
    void send_changes(const DeformedVolume &warped, const Snapshot &snapshot, bool held);
    void publish(const DeformedVolume &warped, const Snapshot &snapshot, const Box &box);
    std::vector<Box> changed_boxes_of(const DeformedVolume &warped) const;

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
    /* sequence_: last sent message; base_: last message that every subscriber has */
    uint64_t sequence_ = 0, base_ = 0;
    boost::shared_array<uint8_t> last_;    /* last sent message; links that have not written it hold a reference */
    size_t last_bytes_ = 0;
    /* older messages that links have not written yet, with their size in bytes */
    std::vector<std::pair<boost::shared_array<uint8_t>, size_t>> held_;
    std::atomic<size_t> held_bytes_{0};
    Clock::time_point sent_at_{}, clear_at_{}; /* time of the last message; last time at which no link held a message */
    bool has_missing_changes_ = false;                     /* whether a subscriber misses changes */
    std::vector<uint8_t> fresh_, unconfirmed_bricks_;  /* bricks changed but not sent; bricks changed since base_ */
    std::vector<Box> pending_;             /* boxes of the last changes that are not sent yet */
    bool has_begun_ = false, rests_ = false;
    /* bound on the voxel difference while the tissue moves [values of the scan] */
    std::atomic<double> bound_{0};
    Clock::time_point changed_at_{};       /* time of the volume's last change */
    SentVolume sent_;
};

class VolumeOutput {
public:
    /* Process every snapshot if all are kept, otherwise at the rate of the live settings.
     * mesh_output: Nullable; publishes the state of every published volume */
    VolumeOutput(ros::NodeHandle handle, const Parameters &parameters, SettingsServer *live, Snapshots *snapshots,
                 MeshOutput *mesh_output);
    ~VolumeOutput();

    /* Call a function with the displayed volume and the positions from which it was computed. Return false if there is
     * no volume. */
    bool look(const std::function<void(const DeformedVolume &, const Snapshot &)> &function);
    std::string problem() const { return problem_.get(); }
    const VolumeStream &stream() const { return stream_; }

private:
    void run();
    bool slice_wanted() const;
    void drop();
    void publish(const std::shared_ptr<const Snapshot> &snapshot);
    /* Publish the pending parts of the last volume while no new snapshot arrives. */
    void publish_again();
    bool preview_wanted() const { return preview_.getNumSubscribers() > 0; }
    void publish_preview(const Snapshot &snapshot, bool is_new);
    void describe(const ros::Time &stamp, uint64_t *sequence, Volume *message) const;
    void publish_slices(const ros::Time &stamp, const RuntimeSettings &settings, bool is_new);

    const std::string frame_;
    VolumeStream stream_;
    SettingsServer *live_;
    Snapshots *snapshots_;
    MeshOutput *mesh_output_;
    const uint32_t preview_step_;
    ros::Publisher preview_, slices_[3], placed_[3];
    std::atomic<bool> preview_fresh_{false}, slices_fresh_{false}, stopping_{false};
    Rate warp_rate_, slice_rate_;
    std::mutex lock_; /* guards warped_ and shown_now_ */
    std::unique_ptr<DeformedVolume> warped_;
    std::shared_ptr<const Snapshot> shown_now_;
    double shown_[3] = {-1, -1, -1}; /* positions of the last published slices */
    uint64_t preview_sequence_ = 0, placed_sequence_[3] = {};
    Problem problem_;
    std::thread thread_;
};

} // namespace pliant_ros

#endif
