/* A message that a thread sets while it cannot do its work. Diagnostics publish it. */
#ifndef PLIANT_ROS_PARAMS_PROBLEM_H
#define PLIANT_ROS_PARAMS_PROBLEM_H

#include <mutex>
#include <string>

namespace pliant_ros {

class Problem {
public:
    /* An empty text means that there is no problem. */
    void set(const std::string &text)
    {
        std::lock_guard<std::mutex> hold(lock_);
        text_ = text;
    }
    std::string get() const
    {
        std::lock_guard<std::mutex> hold(lock_);
        return text_;
    }

private:
    mutable std::mutex lock_;
    std::string text_;
};

} // namespace pliant_ros

#endif
