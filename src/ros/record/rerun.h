/* Recompute a recorded session from its tool motions. */
#ifndef PLIANT_ROS_RECORD_RERUN_H
#define PLIANT_ROS_RECORD_RERUN_H

#include "ros/sim/snapshot.h"
#include "ros/sim/stepping.h"

namespace pliant_ros {

class Rerun {
public:
    /* Use the model of the recording (scan, scene, threads, backend). */
    explicit Rerun(std::shared_ptr<const LoadedModel> loaded) : loaded_(std::move(loaded)) {}

    /* Use another model from the next step that follows a load. */
    void set_model(std::shared_ptr<const LoadedModel> loaded);
    /* Compute the next step. Return false until a load or a reset was recorded, because a rerun starts there. Throws
     * Failure if messages are missing, and then waits for the next reset. */
    bool take(const Step &recorded);
    /* Return the state after the last step, as the live node would publish it. */
    std::shared_ptr<const Snapshot> snapshot() const;

    uint64_t made() const { return made_; }           /* number of computed steps */
    /* number of steps whose result is not bitwise identical to the recording */
    uint64_t differing() const { return differing_; }
    std::string summary() const;

private:
    void begin(const Step &first);

    std::shared_ptr<const LoadedModel> loaded_;
    Data data_;
    Step last_;
    bool begun_ = false;
    uint64_t made_ = 0, differing_ = 0, first_differing_ = 0, skipped_ = 0;
};

} // namespace pliant_ros

#endif
