/* Publish the deformed volume and its slices. A separate thread computes them while there are subscribers. */
#ifndef PLIANT_ROS_OUTPUT_VOLUME_OUTPUT_H
#define PLIANT_ROS_OUTPUT_VOLUME_OUTPUT_H

#include "ros/sim/settings_server.h"
#include "ros/output/mesh_output.h"
#include "ros/output/volume_stream.h"

#include <ros/node_handle.h>

#include <atomic>
#include <functional>
#include <mutex>
#include <thread>

namespace pliant_ros {

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
