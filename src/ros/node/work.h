/* Long work beside the simulation: one at a time, in a thread of its own, which may be cancelled. */
#ifndef PLIANT_ROS_NODE_WORK_H
#define PLIANT_ROS_NODE_WORK_H

#include "ros/sim/loaded.h"
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
    /* Cancels what runs, and waits for its end. */
    ~Work();
    void stop() { stopping_ = true; }

    /* Run a function in a thread of its own, and wait until it returns or is cancelled. It returns a message, or throws. False: it was
     * refused (other work runs), failed or was cancelled, and *message says why. A cancelled function goes on until its progress is reported
     * next; so it may refer to nothing that the caller owns. The next work begins when it has returned. */
    bool run(const std::string &name, std::string *message, std::function<std::string()> function, bool may_be_cancelled = true);
    /* Cancel what runs. False: nothing runs, or it cannot be cancelled any more; *message says so. */
    bool cancel(std::string *message);
    /* By the function, before it changes anything: from then on it cannot be cancelled. Throws Failure if it was. */
    void commit();
    /* By the function: report a part of the work's progress. */
    pliant_progress progress(double from = 0, double to = 1);

private:
    struct Job {
        std::string name, message;
        std::function<std::string()> function;
        std::mutex lock; /* of what follows */
        std::condition_variable changed;
        bool is_committed = false, is_cancelled = false, is_done = false, is_good = false;
    };

    void run_here(const std::shared_ptr<Job> &job);
    bool goes_on() const;

    State *state_;
    std::atomic<bool> stopping_{false};
    double progress_from_ = 0, progress_to_ = 1;
    std::shared_ptr<Job> running_; /* of the thread alone */
    std::mutex lock_;              /* of what follows */
    std::shared_ptr<Job> latest_;
    std::thread thread_;
};

} // namespace pliant_ros

#endif
