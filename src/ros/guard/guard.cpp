#include "ros/guard/guard.h"

#include <algorithm>
#include <cmath>

namespace pliant_ros {

const char *guard_state_name(GuardState state)
{
    static const char *const names[] = {"closed", "rising", "open", "ending", "fault"};
    return names[static_cast<int>(state)];
}

void Guard::pose(double now, bool valid)
{
    pose_at_ = now;
    pose_valid_ = valid;
}

void Guard::wrench(double now, const double force[3])
{
    wrench_at_ = now;
    finite_ = std::isfinite(force[0]) && std::isfinite(force[1]) && std::isfinite(force[2]);
    for (int d = 0; d < 3; ++d) wanted_[d] = finite_ ? -settings_.gain * force[d] : 0;
}

void Guard::error(double now, double metres)
{
    error_at_ = now;
    error_ = metres;
}

void Guard::fault(const std::string &why)
{
    fault_ = why;
    if (state_ == GuardState::CLOSED && !shut_) state_ = GuardState::FAULT;
}

std::string Guard::why(double now) const
{
    if (shut_) return "the node is shutting down";
    if (!fault_.empty()) return fault_;
    if (!settings_.enabled) return "~haptic is false";
    if (settings_.needs_following && !following_) return "the teleoperation does not follow";
    if (!runs_) return "the simulation does not run";
    if (!pose_valid_ || !(now - pose_at_ <= settings_.timeout)) return "no valid pose of the tool";
    if (!(now - wrench_at_ <= settings_.timeout)) return "no force from the simulation";
    if (!finite_) return "the force is not finite";
    if (std::isinf(settings_.largest_error)) return "";
    if (!(now - error_at_ <= settings_.error_timeout) || error_ == 0) return "the simulation does not report its error";
    if (!(error_ <= settings_.largest_error)) return "the simulation's error is too large";
    return "";
}

void Guard::enter_state(GuardState next, double now)
{
    state_ = next;
    since_ = now;
    if (next != GuardState::RISING && next != GuardState::ENDING) return;
    for (int d = 0; d < 3; ++d) smooth_[d] = sent_[d] = 0;
}

/* Apply a first-order low-pass, exact for a force that is constant during the update, then limit the magnitude and the
 * rate. */
void Guard::filter(double elapsed)
{
    const double fraction = 1 - std::exp(-2 * M_PI * settings_.cutoff * elapsed);
    double size = 0, goal[3], squares = 0;
    for (int d = 0; d < 3; ++d) {
        smooth_[d] += fraction * (wanted_[d] - smooth_[d]);
        size += smooth_[d] * smooth_[d];
    }
    const double scale = std::sqrt(size) > settings_.largest ? settings_.largest / std::sqrt(size) : 1;
    for (int d = 0; d < 3; ++d) {
        goal[d] = scale * smooth_[d];
        squares += (goal[d] - sent_[d]) * (goal[d] - sent_[d]);
    }
    const double reach = settings_.rate * elapsed, part = std::sqrt(squares) > reach ? reach / std::sqrt(squares) : 1;
    for (int d = 0; d < 3; ++d) sent_[d] += part * (goal[d] - sent_[d]);
    clamped_ += scale < 1 || part < 1;
}

Guard::Output Guard::update(double now)
{
    const double elapsed = began_ ? std::min(std::max(now - last_, 0.0), 0.1) : 0;
    if (!began_) since_ = now;
    last_ = now;
    began_ = true;
    const bool open = why(now).empty(), moves = state_ == GuardState::RISING || state_ == GuardState::OPEN;
    if (open && !moves) enter_state(GuardState::RISING, now);
    else if (!open && moves) enter_state(GuardState::ENDING, now);
    else if (state_ == GuardState::RISING && now - since_ >= settings_.ramp) state_ = GuardState::OPEN;
    else if (state_ == GuardState::ENDING && now - since_ >= settings_.tail)
        state_ = fault_.empty() ? GuardState::CLOSED : GuardState::FAULT;

    const bool rises = state_ == GuardState::RISING, passes = rises || state_ == GuardState::OPEN;
    Output out{passes || state_ == GuardState::ENDING, {0, 0, 0}};
    if (!passes) return out;
    filter(elapsed);
    const double rise = !rises || !(settings_.ramp > 0) ? 1 : std::min(1.0, (now - since_) / settings_.ramp);
    for (int d = 0; d < 3; ++d) out.force[d] = rise * sent_[d];
    return out;
}

Guard::Output Guard::shut_down()
{
    shut_ = true;
    enter_state(GuardState::ENDING, last_);
    state_ = GuardState::CLOSED;
    return {true, {0, 0, 0}};
}

} // namespace pliant_ros
