/* Positions after a step, passed from the simulation thread to the publishing threads. */
#ifndef PLIANT_ROS_SIM_SNAPSHOT_H
#define PLIANT_ROS_SIM_SNAPSHOT_H

#include "ros/sim/loaded_model.h"

#include <ros/time.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <vector>

namespace pliant_ros {

using Clock = std::chrono::steady_clock;

/* Limit an average rate. due returns true at most `rate` times per second; never for rate 0. */
class Rate {
public:
    bool due(double rate)
    {
        if (!(rate > 0) || Clock::now() < next_) return false;
        spend(rate);
        return true;
    }
    /* Count one event, due or not; rate 0 counts nothing. */
    void spend(double rate)
    {
        if (!(rate > 0)) return;
        auto period = std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1 / rate));
        /* count from the due time, so that a slightly late step does not halve the rate */
        next_ = std::max(next_ + period, Clock::now());
    }

private:
    Clock::time_point next_{};
};

struct Snapshot {
    std::shared_ptr<const LoadedModel> loaded;
    std::shared_ptr<const pliant_body> body; /* body at the time of the snapshot */
    std::vector<double> positions; /* (body's fine.num_nodes x 3) LPS [m], rounded to float as in MeshState */
    pliant_scalar scalar;          /* requested scalar field */
    std::vector<float> contact_force; /* (fine.num_nodes) [N], if requested */
    uint32_t revision;             /* revision of the mesh/topology of these positions */
    uint64_t step;
    ros::Time stamp;
};

/* Take a snapshot of a simulation. The revision is numbered within this load. */
inline void take_snapshot(std::shared_ptr<const LoadedModel> loaded, const pliant_data &data, const ros::Time &stamp,
                          pliant_scalar scalar, Snapshot *out)
{
    const pliant_body *body = pliant_data_get_body(&data);
    const double *positions = pliant_data_get_positions(&data, nullptr);
    out->body = share_body(body);
    out->scalar = scalar;
    if (scalar == PLIANT_SCALAR_CONTACT_FORCE) {
        out->contact_force.resize(static_cast<size_t>(body->fine.num_nodes));
        if (pliant_data_get_scalar(loaded->model, &data, PLIANT_SCALAR_CONTACT_FORCE, out->contact_force.data()) < 0)
            out->contact_force.clear();
    }
    out->revision = revision_of(*loaded, body->revision);
    out->loaded = std::move(loaded);
    out->step = pliant_data_get_statistics(&data)->step;
    out->stamp = stamp;
    out->positions.resize(3 * static_cast<size_t>(body->fine.num_nodes));
    for (size_t i = 0; i < out->positions.size(); ++i) out->positions[i] = static_cast<float>(positions[i]);
}

/* period at which the threads of readers check whether to stop */
constexpr std::chrono::milliseconds poll_period(100);

class Snapshots {
public:
    /* A reader declares whether it needs snapshots; without such readers the simulation creates none. */
    class Reader {
    public:
        explicit Reader(Snapshots *all) : all_(all) {}
        ~Reader() { want(false); }
        void want(bool wanted);
        /* Return the most recent snapshot that this reader has not received, or the next one if all are kept; empty
         * after the timeout. */
        std::shared_ptr<const Snapshot> wait(std::chrono::milliseconds timeout);

    private:
        Snapshots *all_;
        bool wanted_ = false;
        uint64_t seen_ = 0;
    };

    /* keeps_all: the only reader gets every snapshot in order, starting with the last one before it asked */
    explicit Snapshots(bool keeps_all = false) : keeps_all_(keeps_all) {}
    bool keeps_all() const { return keeps_all_; }
    bool wanted() const { return readers_ > 0; }
    void put(std::shared_ptr<const Snapshot> snapshot);

private:
    const bool keeps_all_;
    std::atomic<int> readers_{0};
    std::mutex lock_;
    std::deque<std::shared_ptr<const Snapshot>> kept_;
    std::condition_variable fresh_;
    std::shared_ptr<const Snapshot> newest_;
    uint64_t count_ = 0;
};

inline void Snapshots::put(std::shared_ptr<const Snapshot> snapshot)
{
    {
        std::lock_guard<std::mutex> hold(lock_);
        if (keeps_all_ && wanted()) kept_.push_back(snapshot);
        newest_.swap(snapshot); /* the old snapshot is freed outside the lock */
        ++count_;
    }
    fresh_.notify_all();
}

inline void Snapshots::Reader::want(bool wanted)
{
    if (wanted == wanted_) return;
    wanted_ = wanted;
    all_->readers_ += wanted ? 1 : -1;
    std::lock_guard<std::mutex> hold(all_->lock_);
    if (all_->keeps_all_) {
        all_->kept_.clear();
        if (wanted && all_->newest_) all_->kept_.push_back(all_->newest_);
    } else if (wanted) {
        seen_ = all_->count_; /* a reader that starts to wait gets no old snapshot */
    } else if (all_->readers_ == 0) {
        all_->newest_.reset();
    }
}

inline std::shared_ptr<const Snapshot> Snapshots::Reader::wait(std::chrono::milliseconds timeout)
{
    std::unique_lock<std::mutex> hold(all_->lock_);
    if (all_->keeps_all_) {
        if (!all_->fresh_.wait_for(hold, timeout, [this] { return !all_->kept_.empty(); })) return nullptr;
        std::shared_ptr<const Snapshot> next = std::move(all_->kept_.front());
        all_->kept_.pop_front();
        return next;
    }
    if (!all_->fresh_.wait_for(hold, timeout, [this] { return all_->count_ > seen_; })) return nullptr;
    seen_ = all_->count_;
    return all_->newest_;
}

} // namespace pliant_ros

#endif
