/* Write the file ~checkpoint after each cut and every ~checkpoint_period, in a separate thread. Without ~checkpoint
 * there is no thread. */
#ifndef PLIANT_ROS_NODE_CHECKPOINT_WRITER_H
#define PLIANT_ROS_NODE_CHECKPOINT_WRITER_H

#include "ros/node/registration.h"
#include "ros/node/services.h"
#include "ros/params/problem.h"
#include "topology/visible_surface.h"

namespace pliant_ros {

class CheckpointWriter {
public:
    CheckpointWriter(ros::NodeHandle handle, const Parameters &parameters, Simulation *simulation,
                     const Sessions *sessions, const Services *services, const Registration *registration);
    ~CheckpointWriter();

    /* Return why the checkpoint cannot be written; empty if it can. */
    std::string problem() const { return problem_.get(); }

private:
    void run();
    bool due() const;
    void write();

    const Parameters parameters_;
    const std::string name_;
    Simulation *simulation_;
    const Sessions *sessions_;
    const Services *services_;
    const Registration *registration_;
    std::shared_ptr<const pliant_surface> surface_;
    Clock::time_point written_at_{};
    uint32_t written_revision_ = 0;
    Problem problem_;
    std::mutex lock_;
    std::condition_variable ends_;
    bool stopping_ = false;
    std::thread thread_;
};

} // namespace pliant_ros

#endif
