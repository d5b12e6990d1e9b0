#include "ros/node/work.h"

#include <ros/console.h>

#include <new>

namespace pliant_ros {

Work::~Work()
{
    stop();
    if (thread_.joinable()) thread_.join();
}

bool Work::run(const std::string &name, std::string *message, std::function<std::string()> function,
               bool may_be_cancelled)
{
    if (!state_->begin(name, message)) return false;
    auto job = std::make_shared<Job>();
    job->name = name;
    job->function = std::move(function);
    job->is_committed = !may_be_cancelled;
    {
        std::lock_guard<std::mutex> hold(lock_);
        latest_ = job;
        thread_ = std::thread([this, job, before = std::move(thread_)]() mutable {
            if (before.joinable()) before.join(); /* wait for a cancelled job */
            run_here(job);
        });
    }
    bool good;
    {
        std::unique_lock<std::mutex> hold(job->lock);
        job->changed.wait(hold, [&] { return job->is_done || job->is_cancelled; });
        good = job->is_done && job->is_good;
        *message = job->is_done ? job->message : name + ": cancelled; the previous simulation continues";
    }
    state_->end(good, *message);
    if (good) ROS_INFO("%s", message->c_str());
    else ROS_ERROR("%s", message->c_str());
    return good;
}

void Work::run_here(const std::shared_ptr<Job> &job)
{
    running_ = job;
    bool good = false;
    std::string message;
    try {
        if (!may_continue()) throw Failure(PLIANT_ERROR_CANCELLED, "cancelled");
        message = job->function();
        good = true;
    } catch (const std::bad_alloc &) {
        message = job->name + ": out of memory";
    } catch (const std::exception &failed) {
        message = job->name + ": " + failed.what();
    }
    job->function = nullptr;
    std::lock_guard<std::mutex> hold(job->lock);
    job->message = message;
    job->is_good = good;
    job->is_done = true;
    job->changed.notify_all();
}

bool Work::may_continue() const
{
    if (stopping_) return false;
    std::lock_guard<std::mutex> hold(running_->lock);
    return !running_->is_cancelled;
}

bool Work::cancel(std::string *message)
{
    std::shared_ptr<Job> job;
    {
        std::lock_guard<std::mutex> hold(lock_);
        job = latest_;
    }
    *message = "nothing runs that could be cancelled";
    if (!job) return false;
    std::lock_guard<std::mutex> hold(job->lock);
    if (job->is_done || job->is_cancelled) return false;
    *message = job->name + (job->is_committed ? " cannot be cancelled any more" : ": cancelled");
    if (job->is_committed) return false;
    job->is_cancelled = true;
    job->changed.notify_all();
    return true;
}

void Work::commit()
{
    std::lock_guard<std::mutex> hold(running_->lock);
    if (running_->is_cancelled) throw Failure(PLIANT_ERROR_CANCELLED, "cancelled");
    running_->is_committed = true;
}

pliant_progress Work::progress(double from, double to)
{
    progress_from_ = from;
    progress_to_ = to;
    return pliant_progress{[](double fraction, const char *stage, void *user) {
                               Work *self = static_cast<Work *>(user);
                               if (!self->may_continue()) return false;
                               self->state_->progress(self->progress_from_ +
                                                          (self->progress_to_ - self->progress_from_) * fraction,
                                                      stage);
                               return true;
                           },
                           this};
}

} // namespace pliant_ros
