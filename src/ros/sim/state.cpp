#include "ros/sim/state.h"

#include "pliant/ros/convert.h"

#include <algorithm>
#include <cmath>

namespace pliant_ros {

State::State(ros::NodeHandle handle, const std::string &frame)
{
    publisher_ = handle.advertise<SimState>("state", 10, true);
    current_.header.frame_id = frame;
    current_.state = SimState::LOADING;
    choice_message(pliant_choice{}, &current_);
    publish();
}

void State::publish()
{
    current_.header.stamp = ros::Time::now();
    publisher_.publish(current_);
}

void State::set(uint8_t state, const std::string &message)
{
    std::lock_guard<std::mutex> hold(lock_);
    const std::string &shown = current_.is_busy ? current_.message : message.empty() ? persistent_message_ : message;
    bool same = current_.state == state && current_.message == shown;
    current_.state = state;
    if (!same) current_.message = std::string(shown);
    if (!same) publish();
}

bool State::begin(const std::string &work, std::string *message)
{
    std::lock_guard<std::mutex> hold(lock_);
    if (current_.is_busy) {
        *message = "busy with " + work_ + "; try again when it is done";
        return false;
    }
    work_ = work;
    current_.is_busy = true;
    current_.progress = 0;
    current_.message = work;
    publish();
    return true;
}

void State::progress(double fraction, const std::string &stage)
{
    std::lock_guard<std::mutex> hold(lock_);
    float rounded = static_cast<float>(std::floor(100 * std::min(std::max(fraction, 0.0), 1.0)) / 100);
    std::string message = work_ + ": " + stage;
    if (rounded == current_.progress && message == current_.message) return;
    current_.progress = rounded;
    current_.message = message;
    publish();
}

void State::end(bool good, const std::string &message)
{
    std::lock_guard<std::mutex> hold(lock_);
    persistent_message_ = good ? "" : message;
    current_.is_busy = false;
    current_.progress = 0;
    current_.message = message;
    publish();
}

void State::note(const std::string &message)
{
    std::lock_guard<std::mutex> hold(lock_);
    persistent_message_ = current_.message = message;
    publish();
}

void State::set_choice(const pliant_choice &choice)
{
    std::lock_guard<std::mutex> hold(lock_);
    choice_message(choice, &current_);
    publish();
}

uint8_t State::state() const
{
    std::lock_guard<std::mutex> hold(lock_);
    return current_.state;
}

} // namespace pliant_ros
