/* The deformed volume and its slices, made in a thread of their own and only while somebody subscribes. */
#ifndef PLIANT_ROS_VOLUME_OUTPUT_H
#define PLIANT_ROS_VOLUME_OUTPUT_H

#include "live.h"
#include "snapshot.h"

#include <ros/node_handle.h>

#include <atomic>
#include <functional>
#include <mutex>
#include <thread>

namespace pliant_ros {

/* A warp and the model that it borrows from. */
class Warped {
public:
    /* Target: the scan's grid, grown to hold the mesh at rest, the positions, and a margin [m]; without a margin it stays
       the scan's grid, and tissue that leaves it is cut off. Throws Failure. */
    Warped(std::shared_ptr<const Loaded> loaded, const std::vector<double> &positions, double margin);
    ~Warped() { pliant_warp_free(warp_); }
    Warped(const Warped &) = delete;
    /* False when the positions have left the target grid: make another. */
    bool holds(const std::vector<double> &positions) const;
    void update(const std::vector<double> &positions);
    const Loaded *loaded() const { return loaded_.get(); }
    const pliant_volume &volume() const { return *pliant_warp_volume(warp_); }
    std::vector<Box> changed() const;

private:
    std::shared_ptr<const Loaded> loaded_;
    pliant_warp *warp_ = nullptr;
    bool grows_;
};

class VolumeOutput {
public:
    VolumeOutput(ros::NodeHandle handle, const Parameters &parameters, Live *live, Snapshots *snapshots);
    ~VolumeOutput();

    /* Show the volume that subscribers see, and the positions that made it, to a function; false when there is none now. */
    bool look(const std::function<void(const pliant_volume &, const Snapshot &)> &function);

private:
    void run();
    bool slice_wanted() const;
    void drop();
    void publish(const std::shared_ptr<const Snapshot> &snapshot);
    void publish_boxes(const Loaded &loaded, const std::vector<Box> &boxes, const ros::Time &stamp);
    void publish_slices(const ros::Time &stamp, const LiveSettings &settings, bool is_new);

    const std::string frame_;
    Live *live_;
    Snapshots *snapshots_;
    ros::Publisher volume_, slices_[3];
    std::atomic<bool> whole_wanted_{false}, slices_fresh_{false}, stopping_{false};
    Rate warp_rate_, slice_rate_;
    std::mutex lock_; /* of the warp, and of what made it */
    std::unique_ptr<Warped> warped_;
    std::shared_ptr<const Snapshot> shown_now_;
    double shown_[3] = {-1, -1, -1}; /* where the slices published last lie */
    uint64_t sequence_ = 0;
    std::thread thread_;
};

} // namespace pliant_ros

#endif
