/* A recorded session computed again: from what its tools did, not from where its nodes were. */
#ifndef PLIANT_ROS_RECORD_RERUN_H
#define PLIANT_ROS_RECORD_RERUN_H

#include "ros/sim/snapshot.h"
#include "ros/sim/stepping.h"

namespace pliant_ros {

class Rerun {
public:
    /* Model: that of the recording (scan, scene, threads, backend). */
    explicit Rerun(std::shared_ptr<const Loaded> loaded) : loaded_(std::move(loaded)) {}

    /* From the next turn on that follows a load. */
    void set_model(std::shared_ptr<const Loaded> loaded);
    /* The next turn. False while there is nothing to begin with: a rerun begins where a load or a reset was recorded. Throws Failure where
       messages are missing, and waits for the next reset then. */
    bool take(const Step &recorded);
    /* After the last turn, as the live node had it to show. */
    std::shared_ptr<const Snapshot> snapshot() const;

    uint64_t made() const { return made_; }           /* turns */
    uint64_t differing() const { return differing_; } /* of those, how many did not end as recorded, to the bit */
    std::string summary() const;

private:
    void begin(const Step &first);

    std::shared_ptr<const Loaded> loaded_;
    Data data_;
    Step last_;
    bool begun_ = false;
    uint64_t made_ = 0, differing_ = 0, first_differing_ = 0, skipped_ = 0;
};

} // namespace pliant_ros

#endif
