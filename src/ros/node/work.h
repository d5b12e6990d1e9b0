/* Run long work in a separate thread, one job at a time. A job may be cancelled. */
#ifndef PLIANT_ROS_NODE_WORK_H
#define PLIANT_ROS_NODE_WORK_H

#include "ros/sim/loaded_model.h"
#include "ros/sim/state.h"

#include <atomic>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

namespace pliant_ros {

class Work {
public:
    explicit Work(State *state) : state_(state) {}
    /* Cancel the running job and wait for its end. */
    ~Work();
    void stop() { stopping_ = true; }

    /* Run a function in a separate thread and wait until it returns or is cancelled. The function returns a message, or
     * throws. Return false and set *message if the function was refused (other work runs), failed, or was cancelled. A
     * cancelled function runs until its next progress report, so it must not refer to memory of the caller. The next
     * job starts after it has returned. */
    bool run(const std::string &name, std::string *message, std::function<std::string()> function,
             bool may_be_cancelled = true);
    /* Cancel the running job. Return false and set *message if no job runs or the job cannot be cancelled any more. */
    bool cancel(std::string *message);
    /* Called by the function before it changes the state. After this call it cannot be cancelled. Throw Failure if it
     * was cancelled. */
    void commit();
    /* Called by the function. Return a callback that reports the progress of one part of the job, from and to in [0,
     * 1]. */
    pliant_progress progress(double from = 0, double to = 1);

private:
    struct Job {
        std::string name, message;
        std::function<std::string()> function;
        std::mutex lock; /* guards the members below */
        std::condition_variable changed;
        bool is_committed = false, is_cancelled = false, is_done = false, is_good = false;
    };

    void run_here(const std::shared_ptr<Job> &job);
    bool may_continue() const;

    State *state_;
    std::atomic<bool> stopping_{false};
    double progress_from_ = 0, progress_to_ = 1;
    std::shared_ptr<Job> running_; /* used only by the worker thread */
    std::mutex lock_;              /* guards latest_ */
    std::shared_ptr<Job> latest_;
    std::thread thread_;
};

} // namespace pliant_ros

#endif
